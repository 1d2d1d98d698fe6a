"""The airframe of a frozen loop beside a6 and k1: damping of its rate, modes; and a servo that nobody saw.

Damping.  The filter that flies has none but the nominal's.  What the log tells of it is fitted window by window by the
weak form, without a nominal, and pooled.  Where it is told well (DAMPING_TOLD) and is not the nominal's beyond doubt
(DAMPING_SIGMAS), the nominal gets it, a6 and k1 are identified with it, and its deviation is in the margins.

A servo that nobody saw.  A log whose beta is the command, or that has none, shows its servo in the motion alone.  There
the servo is unknown, by SUPPOSED about the nominal's, and estimated beside a6 and k1.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from launchid_core import Estimate
from sim.effects import effect as made_effect
from sim.effects import values
from sim.nominal import Nominal

from ..log.log import Log
from .loops import Mode

DAMPING_TOLD = 0.05    # 1/s, one sigma: in wind, which damping looks like, it is four times as large
DAMPING_SIGMAS = 4.0   # beyond which a damping is another one than the nominal's
DAMPING_ROWS = 2       # windows, at least
SUPPOSED = {"natural_frequency_sigma": 0.3, "damping_ratio_sigma": 0.3, "delay_sigma": 0.02}   # of a servo nobody saw


class Airframe(NamedTuple):
    """What is known of the loop beside a6, k1, servo and controller: damping [1/s] and its standard deviation, a factor
    on the commands, modes."""

    damping: float = 0.0
    damping_std: float = 0.0
    gain: float = 1.0
    modes: tuple[Mode, ...] = ()
    modes_std: tuple[float, ...] = ()   # of frequency [rad/s] and size of each mode


@dataclass(frozen=True)
class Damping:
    """The damping of the rate [1/s] as a log tells it, its standard deviation, and the nominal's before."""

    value: float
    std: float
    believed: float = 0.0

    @property
    def is_told(self) -> bool:
        return self.std <= DAMPING_TOLD

    @property
    def is_used(self) -> bool:
        """Whether it is not the nominal's, beyond doubt."""
        return self.is_told and abs(self.value - self.believed) > DAMPING_SIGMAS * self.std

    @property
    def json(self) -> dict[str, float]:
        return {"value": self.value, "std": self.std}

    @property
    def words(self) -> list[str]:
        """One sentence where it matters, else none."""
        if self.is_used:
            return [f"the airframe's damping is {self.value:.3g} +- {self.std:.2g} 1/s, the nominal has "
                    f"{self.believed:.3g}: a6, k1 and the loop are with the log's"]
        if not self.is_told:
            return [f"the airframe's damping is the nominal's (the log tells it to {self.std:.2g} 1/s alone)"]
        return []


def told_damping(estimates: Sequence[Estimate]) -> Damping | None:
    """Return the damping that windows with the term theta_dot agree on; None if fewer than DAMPING_ROWS tell it."""
    told = [(-float(e.xi[e.terms.index("theta_dot"), 1]), e.terms_std["theta_dot"]) for e in estimates
            if e.valid and math.isfinite(e.terms_std.get("theta_dot", math.nan))]
    if len(told) < DAMPING_ROWS:
        return None
    value, std = np.array(told).T
    weight = 1.0 / std**2
    return Damping(float(np.sum(weight * value) / np.sum(weight)), float(1.0 / math.sqrt(np.sum(weight))))


def with_damping(nominal: Nominal, told: Damping | None) -> tuple[Nominal, Damping | None]:
    """Return the nominal with the log's damping where it is another one, and the damping beside the nominal's."""
    if told is None:
        return nominal, None
    told = replace(told, believed=airframe_of(nominal).damping)
    if not told.is_used:
        return nominal, told
    more = made_effect("aero_damping", coefficient=told.value - told.believed)
    return dataclasses.replace(nominal, effects=(*nominal.effects, more)), told


def is_command(log: Log) -> bool:
    """Whether a log has commands, and no nozzle beside them."""
    there = np.isfinite(log.beta) & np.isfinite(log.beta_cmd)
    return bool(np.isfinite(log.beta_cmd).any()) and bool(np.array_equal(log.beta[there], log.beta_cmd[there]))


def without_nozzle(log: Log) -> Log:
    """Return the log without its column beta."""
    return replace(log, columns=tuple(name for name in log.columns if name != "beta"),
                   beta=np.full(len(log.t), math.nan))


def with_unknown_servo(nominal: Nominal) -> Nominal:
    """Return the nominal with a servo of SUPPOSED sigmas, if it declares none; of one of first order the delay's."""
    servo = nominal.actuator
    assert servo is not None
    if not servo.is_known:
        return nominal
    given = {"delay_sigma": SUPPOSED["delay_sigma"]} if servo.is_first_order else SUPPOSED
    return replace(nominal, actuator=replace(servo, **given))


def airframe_of(nominal: Nominal, t: float = 0.0, seen: Sequence[Any] = (), damping_std: float = 0.0) -> Airframe:
    """Return what a nominal's modes and effects add to the loop frozen at t [s].

    seen         the modes as an estimate has them (`Estimate.modes`), in place of the nominal's numbers
    damping_std  [1/s] of the damping
    """
    damping, gain = 0.0, 1.0
    modes, std = modes_at(nominal, t)
    for each in seen:
        k = next(k for k, mode in enumerate(modes) if mode.name == each.name)
        modes[k] = modes[k]._replace(frequency=each.frequency, size=each.size)
        std[2 * k:2 * k + 2] = each.frequency_std, each.size_std
    for effect in nominal.effects:
        given = values(effect)
        if effect.name == "aero_damping":
            damping += float(given["coefficient"])
        elif effect.name == "actuator_gain":
            gain *= float(given["scale"])
    return Airframe(damping, damping_std, gain, tuple(modes), tuple(std))


def modes_at(nominal: Nominal, t: float) -> tuple[list[Mode], list[float]]:
    """Return a nominal's modes at t [s], those of its effects too, and the standard deviations of each one's frequency
    and size, which the nominal declares."""
    modes: list[Mode] = []
    std: list[float] = []
    for k, slosh in enumerate(nominal.slosh, 1):
        frequency, damping, size = (float(x.at(np.array(t)))
                                    for x in (slosh.frequency, slosh.damping_ratio, slosh.coupling))
        modes.append(Mode(f"slosh{k}", frequency, damping, size))
        std += [slosh.frequency_sigma * frequency, slosh.coupling_sigma * abs(size)]
    for k, bending in enumerate(nominal.bending, 1):
        frequency, damping, size, rate = (float(x.at(np.array(t))) for x in (
            bending.frequency, bending.damping_ratio, bending.gain, bending.gyro_gain or bending.gain))
        modes.append(_bending(f"bending{k}", frequency, damping, size, rate))
        std += [bending.frequency_sigma * frequency, bending.gain_sigma * abs(size if size != 0.0 else rate)]
    for effect in nominal.effects:
        if effect.name in ("slosh", "bending"):
            given = {key: float(x) for key, x in values(effect).items()}
            name = f"{effect.name}{1 + sum(mode.name.startswith(effect.name) for mode in modes)}"
            if effect.name == "slosh":
                modes.append(Mode(name, given["frequency"], given["damping_ratio"], given["coupling"]))
            else:
                modes.append(_bending(name, given["frequency"], given["damping_ratio"], given["gain"], given["gain"]))
            std += [0.0, 0.0]
    return modes, std


def _bending(name: str, frequency: float, damping: float, gain: float, rate: float) -> Mode:
    """Return a bending mode that the attitude's sensor sees by `gain` and the gyro by `rate`."""
    return Mode(name, frequency, damping, gain, 1.0, rate / gain) if gain != 0.0 else \
        Mode(name, frequency, damping, rate, 0.0, 1.0)
