"""Ask once for a log, before any window: is this the nominal of this vehicle?

A nominal of another vehicle may be noisy enough to pass every window, whose numbers are then wrong. Five of its numbers
are compared with what the log shows: the controller's period with that of the commands, its commands with the logged
ones, the servo's speed with that from command to nozzle, and k1 and a6 of the first windows with their declared range.

The vehicle's own numbers decide alone. A period, a controller or a servo that is another one is a doubt, for each of
them may differ on the right vehicle too; two of them are another vehicle. Limits are beyond what a fault in flight
does: a loss of thrust, a slow servo or a changed gain is a change of this vehicle, and is judged window by window.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from launchid_core import Config, Estimate
from sim.nominal import Actuator, Nominal

from ..formatting import with_std
from ..log.check import CheckedLog
from ..log.loop import Loop, loop_of
from .line import Line, undeclared_line
from .slosh import undeclared_slosh
from .table import TESTS

MANY = 0.25            # of the windows that tell: a nominal may be like another for a part of the flight
FEWEST = 3             # windows outside, where others are inside
RANGES = TESTS["a6 and k1 of the nominal"].limit  # of [uncertainty]
SURE = 3.0             # standard deviations of a window's a6 and k1
UNSTATED = 3.0         # of a6 and k1 themselves, where no range is declared
LEAST_CONTROL = 0.1    # of the nominal's k1, whatever range is declared
LEAST_OF_LARGEST = 0.1  # of the largest of the profile: the range of a number near zero is no smaller
SMALLEST = 1e-9        # 1/s^2: the range of a number that is 0 in all of the profile
OTHERWISE = 0.5        # ranges: a number that is as far off is named
PARAMETERS = ("a6", "k1")
UNRELATED = 0.5        # of the variance of the commands, that a controller's own law explains at least
SAME_SERVO = 1.2       # of its speed, either way: closer is the nominal's
DOUBTS = 2             # of period, commands and servo, that make another vehicle


@dataclass(frozen=True)
class NominalTest:
    """What the comparison of a log with its nominal found.

    decisive   numbers of the vehicle that do not fit, in words;  doubts  those of controller and servo
    mode       a line or a slosh of the log of which the nominal has no mode
    hint       what to declare where windows contradict the model, "" if the loop shows nothing
    """

    decisive: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    mode: Line | None = None
    hint: str = ""

    @property
    def is_other(self) -> bool:
        """Whether the nominal is of another vehicle, so that no window is valid."""
        return bool(self.decisive) or len(self.doubts) >= DOUBTS

    @property
    def refuses(self) -> bool:
        """Whether no window is valid."""
        return self.is_other or self.mode is not None

    @property
    def next(self) -> str:
        """What to do next where no window is valid; "" else."""
        if self.is_other:
            return "identify with the nominal of the vehicle that flew, or without one"
        if self.mode is None:
            return ""
        return (f"declare [[{self.mode.kind}]] near {self.mode.frequency:.3g} rad/s in the nominal; `launchid "
                "diagnose` tells its size")

    def line(self, nominal: Nominal) -> str:
        """Return one line that says which numbers do not fit; "" if all do."""
        if self.mode is not None and not self.is_other:
            return f"{self.mode.words}; no window is valid ({nominal.path or nominal.name})"
        said = "; ".join((*self.decisive, *self.doubts))
        if not said:
            return ""
        if self.is_other:
            return (f"{nominal.path or nominal.name} is not the nominal of this log: {said}: another vehicle, or other "
                    "units? No window is valid; expected the nominal of the vehicle that flew")
        return f"{nominal.path or nominal.name}: {said}: a6 and k1 do not rest on it; correct it"


FITS = NominalTest()   # nothing that does not fit


def tested(seen: CheckedLog, nominal: Nominal | None, estimates: Sequence[Estimate], config: Config) -> NominalTest:
    """Compare a log with its nominal; a log with a column of another quantity is not asked.

    estimates  of the windows, by the filtered formulation with this nominal, as `config` has it
    """
    if nominal is None or seen.foreign:
        return FITS
    loop = loop_of(seen, nominal)
    mode = undeclared_line(seen, nominal) or undeclared_slosh(seen, config, estimates)
    return NominalTest(_own(nominal, estimates), tuple(_loop(loop, nominal)), mode, _hint(loop, nominal))


def lines(seen: CheckedLog, told: NominalTest) -> tuple[str, ...]:
    """Return one line, with the log's path, on a nominal that is not this log's; () if all of its numbers fit."""
    line = told.line(seen.nominal) if seen.nominal is not None else ""
    return (f"{seen.raw.path}: {line}",) if line else ()


def _hint(loop: Loop, nominal: Nominal) -> str:
    """Return what to declare of a servo that is another one than the nominal's; "" if it is the nominal's."""
    if nominal.actuator is None or _near(loop.speed, SAME_SERVO):
        return ""
    return (f"{_late(loop, nominal.actuator)}: declare that, or natural_frequency_sigma and delay_sigma in [actuator], "
            "and it is estimated")


def _late(loop: Loop, servo: Actuator) -> str:
    """Return in words how late the nozzle follows its command, and how late the servo of the nominal does."""
    late = 1e3 * (servo.lag + servo.delay)
    return (f"the nozzle follows its command after about {late / loop.speed:.2g} ms, the nominal's servo after "
            f"{late:.2g} ms")


def _loop(loop: Loop, nominal: Nominal) -> Iterator[str]:
    """Yield in words each of period, commands and servo that is not the nominal's."""
    controller, servo = nominal.controller, nominal.actuator
    if controller is not None and not _near(loop.period / controller.period, TESTS["period of the nominal"].limit):
        yield (f"commands change every {loop.period:.4g} s, the nominal's controller gives one every "
               f"{controller.period:g} s")
    if loop.explained < UNRELATED:
        yield "its controller's law explains none of the commands"
    elif not _near(loop.gain, TESTS["commands of the nominal"].limit):
        yield f"the commands are {loop.gain:.2g} times what its controller makes of theta"
    if servo is not None and not _near(loop.speed, TESTS["servo of the nominal"].limit):
        yield _late(loop, servo)


def _near(ratio: float, limit: float) -> bool:
    """Whether a ratio is 1 within a factor `limit`, or not known."""
    return not (ratio > limit or ratio < 1.0 / limit)


def _own(nominal: Nominal, estimates: Sequence[Estimate]) -> tuple[str, ...]:
    """Return in words that a6 and k1 of more than MANY of the windows before any sudden change are together outside of
    RANGES times their declared range; () if not."""
    beyond, within = list[Estimate](), 0
    for e in estimates:
        if e.status.name == "CHANGE":
            break
        if e.valid and math.isfinite(e.a6_std + e.k1_std):
            off, std = _ranges_off(nominal, e)
            if float(np.linalg.norm(np.maximum(np.abs(off) - SURE * std, 0.0))) > RANGES:
                beyond.append(e)
            elif float(np.linalg.norm(np.abs(off) + SURE * std)) <= RANGES:
                within += 1
    if not len(beyond) > MANY * (len(beyond) + within) or (within and len(beyond) < FEWEST):
        return ()
    e = min(beyond, key=lambda each: float(np.linalg.norm(_ranges_off(nominal, each)[1])))
    off, std = _ranges_off(nominal, e)
    counts = np.abs(off) - SURE * std > OTHERWISE
    return tuple(_share(name, nominal, e) for name, is_off in zip(PARAMETERS, counts.tolist(), strict=True) if is_off)


def _believed(nominal: Nominal, e: Estimate) -> np.ndarray:
    """Return a6 and k1 (2,) of the nominal in the middle of a window."""
    return np.ravel(nominal.vehicle.at(np.array([0.5 * (e.t_start + e.t_end)])))


def _ranges_off(nominal: Nominal, e: Estimate) -> tuple[np.ndarray, np.ndarray]:
    """Return by how many of their ranges a6 and k1 of a window differ from the nominal (2,), and the deviations (2,).

    Of a k1 that is LEAST_CONTROL of the nominal's, or of the other sign, the range is no wider than to there.
    """
    believed, middle = _believed(nominal, e), np.array([0.5 * (e.t_start + e.t_end)])
    largest = np.array([np.max(np.abs(nominal.vehicle.a6)), np.max(np.abs(nominal.vehicle.k1))])
    sigma = np.full(2, UNSTATED / RANGES) if nominal.uncertainty is None else np.ravel(nominal.uncertainty.at(middle))
    value, std = np.array([e.a6, e.k1]), np.array([e.a6_std, e.k1_std])
    if value[1] * np.sign(believed[1]) < LEAST_CONTROL * abs(believed[1]):
        sigma[1] = min(sigma[1], (1.0 - LEAST_CONTROL) / RANGES)
    scale = np.maximum(sigma * np.maximum(np.abs(believed), LEAST_OF_LARGEST * largest), SMALLEST)
    return (value - believed) / scale, std / scale


def _share(name: str, nominal: Nominal, e: Estimate) -> str:
    """Return in words what share of the nominal's a6 or k1 a window has."""
    value, std, believed = getattr(e, name), getattr(e, f"{name}_std"), _believed(nominal, e)[PARAMETERS.index(name)]
    share = f"{value / believed:.2g} of the nominal's {believed:.4g}" if believed else "0 in the nominal"
    return f"{name} is {share} ({with_std(value, std)} 1/s^2 from {e.t_start:g} to {e.t_end:g} s)"
