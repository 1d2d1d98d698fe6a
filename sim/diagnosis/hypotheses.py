"""What may be wrong: every cause of the catalogue as a family of models with few free numbers.

A hypothesis says which parameters of its effect are free, from where the search starts, and what the log must hold
for it to be visible at all.  The physics is the effect's own (`sim.effects`); nothing of it stands here.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..effects import CATALOGUE, Effect, effect
from .record import Record

Values = tuple[float, ...]


@dataclass(frozen=True)
class Free:
    """One free number: the parameter's name, its range, the step of its slope, and whether it is searched as a log."""

    name: str
    step: float
    low: float = -math.inf
    high: float = math.inf
    logarithmic: bool = False


@dataclass(frozen=True)
class Hypothesis:
    """One cause; free[0] is its size, whose `neutral` value makes no difference.

    shapes   of a record: values of the other free numbers to start from
    sizes    of a record: sizes to try where the response is not proportional to the size; None: it is
    visible  of a record: whether the log has the columns that could show it
    dithered how much of the command noise's rms its size may be off: the noise keeps a play moving, which the
             prediction, run on the mean command, does not see
    """

    cause: str
    free: tuple[Free, ...]
    neutral: float
    shapes: Callable[[Record], list[Values]]
    visible: Callable[[Record], bool]
    sizes: Callable[[Record], list[float]] | None = None
    fixed: tuple[tuple[str, str | float], ...] = ()   # parameters that are not searched (the term of `missing_term`)
    dithered: float = 0.0

    def effect(self, values: Values) -> Effect:
        """The simulator's effect at these values of the free numbers, and the fixed ones."""
        return effect(self.cause, **dict(self.fixed), **dict(zip((f.name for f in self.free), values, strict=True)))

    @property
    def label(self) -> str:
        """Its cause, with what is fixed."""
        return self.cause + "".join(f"({value})" for _, value in self.fixed)

    @property
    def where(self) -> str:
        return CATALOGUE[self.cause].where

    def unit(self, name: str) -> str:
        """Unit of one of its parameters."""
        return next(p.unit for p in CATALOGUE[self.cause].parameters if p.name == name)


def only_start(record: Record) -> list[Values]:
    """No other free numbers to start from."""
    return [()]


def _always(record: Record) -> bool:
    return True


def _gyro(record: Record) -> bool:
    return "theta_dot" in record.channels


def _nozzle(record: Record) -> bool:
    """The nozzle's sensor is beside a command to compare it with."""
    return "beta" in record.channels and record.command_is_known


def command_is_known(record: Record) -> bool:
    """The log has the command, or reference and controller make it."""
    return record.command_is_known


EARLIEST = 2.0           # s: an onset so near an end is no onset, it is a constant cause
SLOSH_FREQUENCIES = tuple(np.geomspace(1.0, 20.0, 14))      # rad/s: liquid propellant, 0.15 to 3 Hz
BENDING_PER_NYQUIST = 0.9   # highest bending frequency tried over the log's Nyquist frequency
LOWEST_BENDING = 6.0     # rad/s
TIMES = ("time", "duration")
START_DAMPING = 0.05     # broad enough for a coarse grid of frequencies
RATE_SHARES = (0.02, 0.04, 0.07, 0.12, 0.2, 0.35)  # of the fastest command: the servo follows a part of it
PLAYS = (3e-4, 1e-3, 3e-3, 1e-2)    # rad


def _slosh(record: Record) -> list[Values]:
    return [(float(w), START_DAMPING) for w in SLOSH_FREQUENCIES]


def _bending(record: Record) -> list[Values]:
    top = min(BENDING_PER_NYQUIST * math.pi / record.period, 0.45 / record.resolution)
    count = max(4, round(6.0 * math.log(top / LOWEST_BENDING)))
    return [(float(w), START_DAMPING) for w in np.geomspace(LOWEST_BENDING, top, count)]


def rates(record: Record) -> list[float]:
    """Rate limits [rad/s] that would bind on this log's command."""
    smooth = np.diff(record.commands) / (record.tick * record.step)
    largest = float(np.quantile(np.abs(smooth), 0.999)) if len(smooth) else 0.0
    return [share * largest for share in RATE_SHARES if largest > 0.0]


def _plays(record: Record) -> list[float]:
    return list(PLAYS)


def size(name: str, step: float, low: float = -math.inf, high: float = math.inf) -> Free:
    """A free number that is searched as it is."""
    return Free(name, step, low, high)


def rate_limits() -> Free:
    """Of the nozzle's rate [rad/s]."""
    return Free("rate", 0.01, 1e-3, 50.0, logarithmic=True)


_FREQUENCY = Free("frequency", 2e-3, 0.2, 300.0, logarithmic=True)
_LINE = Free("frequency", 1e-4, 0.05, 300.0, logarithmic=True)  # its phase drifts over the whole log
_SLOSH = Free("frequency", 2e-3, 0.2, 60.0, logarithmic=True)   # faster, it is no liquid
_GUST = Free("duration", 0.02, 0.2, 20.0, logarithmic=True)     # s: longer, the wind has changed
_DAMPING = Free("damping_ratio", 0.1, 0.002, 0.5, logarithmic=True)  # beyond it a mode is a filter for anything

HYPOTHESES: tuple[Hypothesis, ...] = (
    Hypothesis("control_effectiveness", (size("scale", 0.01, 0.05, 5.0),), 1.0, only_start, _always),
    Hypothesis("control_loss", (size("fraction", 0.01, -0.95, 0.95), Free("time", 0.05)), 0.0, only_start, _always),
    Hypothesis("aero_instability", (size("scale", 0.01, -5.0, 10.0),), 1.0, only_start, _always),
    Hypothesis("aero_damping", (size("coefficient", 0.01),), 0.0, only_start, _always),
    Hypothesis("aero_cubic", (size("coefficient", 0.5),), 0.0, only_start, _always),
    Hypothesis("friction", (size("coefficient", 1e-3, 0.0),), 0.0, only_start, _always),
    Hypothesis("thrust_misalignment", (size("angle", 1e-4),), 0.0, only_start, _always),
    Hypothesis("slosh", (size("coupling", 0.005, -0.8, 5.0), _SLOSH, _DAMPING), 0.0, _slosh, _always),
    Hypothesis("bending", (size("gain", 1e-4), _FREQUENCY, _DAMPING), 0.0, _bending, _always),
    Hypothesis("gust", (size("angle", 1e-3), Free("time", 0.05), _GUST), 0.0,
               only_start, _always),
    Hypothesis("steady_wind", (size("angle", 1e-3),), 0.0, only_start, _always),
    Hypothesis("actuator_delay", (size("delay", 1e-3, 0.0, 1.0),), 0.0, only_start, command_is_known),
    Hypothesis("actuator_bandwidth", (size("scale", 0.02, 0.02, 5.0),), 1.0, only_start, command_is_known),
    Hypothesis("actuator_gain", (size("scale", 0.005, -3.0, 5.0),), 1.0, only_start, command_is_known),
    Hypothesis("actuator_rate_limit", (rate_limits(),), math.inf, only_start, command_is_known, rates),
    Hypothesis("actuator_backlash", (size("half_width", 5e-5, 0.0, 0.2),), 0.0, only_start, command_is_known, _plays,
               dithered=0.1),
    Hypothesis("actuator_bias", (size("angle", 1e-4),), 0.0, only_start, command_is_known),
    Hypothesis("attitude_bias", (size("angle", 1e-3),), 0.0, only_start, _always),
    Hypothesis("attitude_delay", (size("delay", 2e-3, 0.0, 1.0),), 0.0, only_start, _always),
    Hypothesis("gyro_bias", (size("rate", 1e-4),), 0.0, only_start, _gyro),
    Hypothesis("gyro_scale", (size("scale", 0.005, -3.0, 5.0),), 1.0, only_start, _gyro),
    Hypothesis("gyro_delay", (size("delay", 2e-3, 0.0, 1.0),), 0.0, only_start, _gyro),
    Hypothesis("nozzle_sensor_bias", (size("angle", 1e-4),), 0.0, only_start, _nozzle),
)
# its start, like those of `control_loss` and `gust`, is found by a search of its own (`scan`)
PERIODIC = Hypothesis("periodic_disturbance", (size("amplitude", 1e-4), _LINE, Free("phase", 0.02)), 0.0,
                      only_start, _always)


def pinned(hypothesis: Hypothesis, values: Values) -> tuple[Hypothesis, Values]:
    """The hypothesis with its times as they are, and the values of what stays free."""
    times = tuple((free.name, value) for free, value in zip(hypothesis.free, values, strict=True) if free.name in TIMES)
    kept = [(free, value) for free, value in zip(hypothesis.free, values, strict=True) if free.name not in TIMES]
    return (replace(hypothesis, free=tuple(free for free, _ in kept), fixed=(*hypothesis.fixed, *times)),
            tuple(value for _, value in kept))


def missing_term(term: str) -> Hypothesis:
    """A library term with a free coefficient."""
    return Hypothesis("missing_term", (size("coefficient", 1e-3),), 0.0, only_start, _always, fixed=(("term", term),))
