"""The airframe of a frozen loop beside a6 and k1: damping of its rate, modes; and a servo that nobody saw.

Damping.  The filter that flies has none but the nominal's.  What the log tells of it is fitted window by window, with a
nominal by the likelihood (`damping.py`), else by the weak form (`pooled_damping`), and pooled.  a6 and k1 are
identified with what the log tells, about the nominal's to DAMPING_PRIOR; where no log is asked, with the nominal's,
known to DAMPING_SUPPOSED.  In both cases its error is in the margins, and a6 and k1 move with it as they do in the fit:
by their slopes in the damping, cov(a6, damping)/var(damping).

A servo that nobody saw.  A log whose beta is the command, or that has none, shows its servo in the motion alone.  There
the servo is unknown, by SUPPOSED about the nominal's, and estimated beside a6 and k1.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from launchid_core import Estimate, function_value, parse_term
from sim.effects import effect as made_effect
from sim.effects import values
from sim.errors import InputError
from sim.flight import packed
from sim.nominal import Nominal
from sim.onboard import REFUSED, servo_of

from ..controller.law import Law, law_of
from ..formatting import with_std
from ..log.log import Log
from .blocks import NOTHING_FURTHER, Further, Mode, Plants

DAMPING_SUPPOSED = 0.05  # 1/s, one sigma about the nominal's where no log is asked: of launchers at greatest dynamic
#                        pressure
DAMPING_PRIOR = 0.3    # 1/s, the same where a log is asked, which decides: six times as much
DAMPING_SIGMAS = 4.0   # beyond which a damping is another one than the nominal's, beyond doubt
DAMPING_ROWS = 2       # windows, at least, of the weak form
DAMPING_FAR = 5.0      # standard deviations from the median: of another vehicle than in the other windows
SLOPE_STEP = 1e-4      # rad: of a function's slope at 0
SUPPOSED = {"natural_frequency_sigma": 0.3, "damping_ratio_sigma": 0.3, "delay_sigma": 0.02}   # of a servo nobody saw


class Airframe(NamedTuple):
    """What is known of the loop beside a6, k1, servo and controller: damping [1/s], its standard deviation and by how
    much a6 and k1 move with it, a factor on the commands, modes, and the rest."""

    damping: float = 0.0
    damping_std: float = 0.0
    gain: float = 1.0
    modes: tuple[Mode, ...] = ()
    modes_std: tuple[float, ...] = ()   # of frequency [rad/s] and size of each mode
    modes_shared: np.ndarray | None = None   # `Estimate.modes_covariance`
    slopes: tuple[float, float] = (0.0, 0.0)   # of a6, k1 [1/s^2] in the damping [1/s]
    further: Further = NOTHING_FURTHER


class DampedWindow(NamedTuple):
    """A window that tells the damping [1/s], and how a6 and k1 move with it."""

    middle: float    # s
    damping: float   # 1/s
    std: float
    slopes: tuple[float, float]


@dataclass(frozen=True)
class Damping:
    """The damping of the rate [1/s] as a log tells it, its standard deviation (inf: not told), the nominal's before."""

    value: float
    std: float
    windows: tuple[DampedWindow, ...] = ()
    believed: float = 0.0

    @property
    def is_told(self) -> bool:
        return math.isfinite(self.std)

    @property
    def is_another(self) -> bool:
        """Whether it is not the nominal's, beyond doubt."""
        return self.is_told and abs(self.value - self.believed) > DAMPING_SIGMAS * self.std

    @property
    def used(self) -> tuple[float, float]:
        """Return the damping that the loop has, and its standard deviation: the log's, about the nominal's to
        DAMPING_PRIOR; the nominal's to DAMPING_SUPPOSED where no log was asked."""
        if not self.is_told:
            return self.believed, DAMPING_SUPPOSED
        own, before = 1.0 / self.std**2, 1.0 / DAMPING_PRIOR**2
        return (own * self.value + before * self.believed) / (own + before), 1.0 / math.sqrt(own + before)

    def slopes_at(self, t: float) -> tuple[float, float]:
        """Return by how much a6 and k1 move with the damping in the window next to t [s]."""
        if not math.isfinite(self.std):
            return 0.0, 0.0
        return min(self.windows, key=lambda each: abs(each.middle - t)).slopes

    @property
    def json(self) -> dict[str, float | None]:
        return dict(zip(("value", "std"), self.used, strict=True))

    @property
    def words(self) -> list[str]:
        """Return one sentence on the damping, [] where it does not matter."""
        value, std = self.used
        if self.is_another:
            return [f"the airframe's damping is {with_std(value, std)} 1/s, the nominal has {self.believed:.3g}: a6, "
                    "k1 and the loop are with the log's"]
        if not self.is_told:
            return [f"the airframe's damping is the nominal's to {std:.2g} 1/s, which is in the intervals (the log "
                    "does not tell it)"]
        if std > DAMPING_SUPPOSED:
            return [f"the airframe's damping is {with_std(value, std)} 1/s, all that the log tells of it, which is in "
                    "the intervals"]
        return []


NOT_TOLD = Damping(0.0, math.inf)


def pooled_damping(estimates: Sequence[Estimate], covariances: Sequence[np.ndarray | None],
                   has_offset: bool = True) -> Damping:
    """Return the damping that windows with the term theta_dot agree on, not told if fewer than DAMPING_ROWS do.

    covariances  of the terms of each window;  has_offset: a6 and k1 are fitted beside an offset that nobody knows.
    """
    windows = []
    for e, covariance in zip(estimates, covariances, strict=True):
        if not e.valid or covariance is None or not {"theta", "beta", "theta_dot"} <= set(e.terms):
            continue
        k = e.terms.index("theta_dot")
        free = [e.terms.index(term) for term in ("theta", "beta", *(("1",) if has_offset and "1" in e.terms else ()))]
        information = np.linalg.inv(covariance)
        slopes = np.linalg.solve(information[np.ix_(free, free)], information[free, k])   # the damping is less the term
        windows.append(DampedWindow(0.5 * (e.t_start + e.t_end), -float(e.xi[k, 1]), math.sqrt(covariance[k, k]),
                                    (float(slopes[0]), float(slopes[1]))))
    return pooled(windows)


def pooled(windows: Sequence[DampedWindow], least: int = DAMPING_ROWS) -> Damping:
    """Return the damping that windows agree on, not told if fewer than `least` do.

    Windows far from the others, in which k1 changed for one, are left out. Where the rest is further apart than chance
    has it, the deviation is larger by as much (Birge, Phys. Rev. 40, 1932).
    """
    if len(windows) < least:
        return Damping(0.0, math.inf, tuple(windows))
    value, std = np.array([(each.damping, each.std) for each in windows]).T
    near = np.abs(value - np.median(value)) < DAMPING_FAR * np.hypot(std, np.median(std))
    value, weight = value[near], 1.0 / std[near]**2
    if len(value) < max(least, len(windows) // 2):
        return Damping(0.0, math.inf, tuple(windows))
    mean = float(np.sum(weight * value) / np.sum(weight))
    apart = float(np.sum(weight * (value - mean)**2)) / max(len(value) - 1, 1)
    return Damping(mean, math.sqrt(max(apart, 1.0) / float(np.sum(weight))), tuple(windows))


def with_damping(nominal: Nominal, told: Damping) -> tuple[Nominal, Damping]:
    """Return the nominal with the damping that the log shows, and what is said of it beside the nominal's own."""
    told = replace(told, believed=airframe_of(nominal).damping)
    if not told.is_told:
        return nominal, told
    more = made_effect("aero_damping", coefficient=told.used[0] - told.believed)
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


def airframe_of(nominal: Nominal, t: float = 0.0, seen: Sequence[Any] = (), told: Damping | None = None,
                shared: np.ndarray | None = None) -> Airframe:
    """Return what a nominal's modes and effects add to the loop frozen at t [s].

    seen    the modes as an estimate has them (`Estimate.modes`), in place of the nominal's numbers
    told    how well the damping is known, None: it is the nominal's
    shared  `Estimate.modes_covariance`, None: the modes' numbers have nothing in common with a6 and k1
    """
    modes, std = modes_at(nominal, t)
    for each in seen:
        k = next(k for k, mode in enumerate(modes) if mode.name == each.name)
        modes[k] = modes[k]._replace(frequency=each.frequency, size=each.size)
        std[2 * k:2 * k + 2] = each.frequency_std, each.size_std
    changes = packed(nominal)
    damping, gain = changes.aero_damping, changes.actuator_gain
    further = Further(**{name: getattr(changes, name) for name in Further._fields if hasattr(changes, name)})
    if nominal.drift is not None:
        z_alpha, z_beta = (float(x) for x in nominal.drift.at(np.array(t)))
        further = further._replace(z_alpha=further.z_alpha + z_alpha, z_beta=further.z_beta + z_beta)
    for effect in nominal.effects:
        given = values(effect)
        match effect.name:
            case "friction" | "attitude_delay" | "gyro_delay":
                raise InputError(f"{nominal.path}: effect {effect.name!r}: the frozen loop has no model of it; "
                                 + REFUSED[effect.name])
            case "input_washout":
                further = further._replace(washout=float(given["time_constant"]) if math.isfinite(
                    float(given["time_constant"])) else 0.0)
            case "missing_term":
                lean, slowed, turn = slopes_of(str(given["term"]), float(given["coefficient"]))
                damping -= slowed
                further = further._replace(lean=further.lean + lean, turn=further.turn + turn)
    for term, coefficient in nominal.terms:
        lean, slowed, turn = slopes_of(term, coefficient)
        damping -= slowed
        further = further._replace(lean=further.lean + lean, turn=further.turn + turn)
    if nominal.actuator is not None:
        further = further._replace(command_lag=servo_of(nominal, nominal.actuator)["command_lag"])
    damping_std, moved = (0.0, (0.0, 0.0)) if told is None else (told.used[1], told.slopes_at(t))
    return Airframe(damping, damping_std, gain, tuple(modes), tuple(std), shared, moved, further)


def slopes_of(term: str, coefficient: float) -> tuple[float, float, float]:
    """Return the slopes of a library term's acceleration in theta, theta_dot and beta, where all stand at 0."""
    *powers, _, function, argument = parse_term(term)[:6]
    at_rest = function_value(function, 0.0) if function else 1.0
    slope = [0.0, 0.0, 0.0]
    if sum(powers) == 1:
        slope[powers.index(1)] = coefficient * at_rest
    elif sum(powers) == 0 and function:
        ends = [function_value(function, x) for x in (-SLOPE_STEP, SLOPE_STEP)]
        slope[argument] = coefficient * (ends[1] - ends[0]) / (2.0 * SLOPE_STEP)
    lean, slowed, turn = slope
    return lean, slowed, turn


def frozen(nominal: Nominal, t: float, a6: float, k1: float, kp: float | None = None,
           kd: float | None = None) -> tuple[Plants, Law]:
    """Return a nominal's plant (1) with a6, k1 [1/s^2] and its controller's law, frozen at t [s]; kp, kd [s] in place
    of the controller's gains."""
    assert nominal.actuator is not None and nominal.controller is not None
    airframe, servo, one = airframe_of(nominal, t), servo_of(nominal, nominal.actuator), np.ones(1)
    is_first_order = nominal.actuator.is_first_order
    w = 1.0 / servo["time_constant"] if is_first_order else servo["natural_frequency"]
    plant = Plants(a6 * one, k1 * one, w * one, servo["damping_ratio"] * one, servo["delay"] * one, airframe.damping,
                   is_first_order, airframe.modes, airframe.further)
    own, changed = nominal.controller, packed(nominal)
    own = replace(own, kp=changed.kp_scale * (own.kp if kp is None else kp), kd=changed.kd_scale * (
        own.kd if kd is None else kd))
    return plant, law_of(own, late=changed.computing_time / own.period).times(airframe.gain)


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
