"""The diagnosis' knowledge of one cause: a record, and a cause at its values.

A record says which parameters of its effect are free, from where the search starts, what the log must hold for it to
be visible at all, how its limit is given, what else it may look like, what would decide, and what it means in words.
The physics is the effect's own (`sim.effects`); nothing of it stands here.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from sim.effects import CATALOGUE, Effect, effect

from ..data.record import Record

Values = tuple[float, ...]
AT_END = 1e-6          # relative, of a value to its range's end
TIMES = ("time", "duration")
FAR_DELAYS = tuple(np.geomspace(0.005, 0.3, 12).tolist())  # s: what turns a vehicle is late by less, and half the way
                                                           # from one to the next is a fifth of it


@dataclass(frozen=True)
class Free:
    """One free number: the parameter's name, its range, the step of its slope, and whether it is searched as a log."""

    name: str
    step: float
    low: float = -math.inf
    high: float = math.inf
    logarithmic: bool = False


class Start(Enum):
    """The way in which the search finds its start.  It begins from the response to a small size or at the sizes of the
    record, along all onsets of a loss of k1, along all onsets of a moment, along all pulses of the angle of attack, or
    in the spectrum."""

    RESPONSE = 0
    ONSET = 1
    PULSE = 2
    LINE = 3
    STEP = 4


@dataclass(frozen=True)
class Form:
    """Another physical law of a cause, fitted in the place of a found one that is like it (see `causes`).

    hypothesis  under the other law;  start  where its search begins, from the found one's values
    parameter   that is not 0 under it, and none of the contract's
    """

    hypothesis: "Hypothesis"
    start: Callable[[Record, Values], Values]
    parameter: str


@dataclass(frozen=True)
class Steps:
    """The steps of a cause that may come gradually, each a cause of its own: free numbers size and time, the size a
    share of what the steps before left.

    near   [s] between steps that belong to one;  apart  [s] from the middle, of two halves to try
    """

    near: float
    apart: tuple[float, ...]


@dataclass(frozen=True)
class Correction:
    """The way in which a flight computer takes a known effect off a column of samples; `is_outer` ones after all
    others."""

    column: str
    without: Callable[[np.ndarray, Mapping[str, float | str]], np.ndarray]
    is_outer: bool = False


def only_start(record: Record) -> list[Values]:
    """No other free numbers to start from."""
    return [()]


def nothing_given(record: Record) -> Values:
    """No other parameters to give a limit for."""
    return ()


def no_floor(record: Record) -> float:
    """The floor of a size of which the nominal leaves nothing open: 0."""
    return 0.0


def any_size(record: Record) -> float:
    """The nozzle need not hold it."""
    return math.inf


def as_deflected(record: Record) -> float:
    """[rad] The nozzle's limit."""
    return record.actuator.deflection_limit


def as_aside(record: Record) -> float:
    """[rad] The angle of attack whose moment the nozzle at its limit outweighs all along the log."""
    unstable = record.a6 > 0.0
    if not unstable.any():
        return math.inf
    return float(record.actuator.deflection_limit * np.min(np.abs(record.k1[unstable]) / record.a6[unstable]))


def nothing_far(record: Record) -> Values:
    """No size far from neutral to start from."""
    return ()


def far_delays(record: Record) -> Values:
    """[s] Range of a delay of which only a small part of the log's motion is proportional to it."""
    return FAR_DELAYS


def not_late(record: Record, size: float) -> float:
    """The lateness [s] of a cause that delays nothing: 0."""
    return 0.0


def by_its_size(record: Record, size: float) -> float:
    """The lateness [s] of a cause whose size is a delay."""
    return size


def as_timed(record: Record) -> float:
    """[s] Servo and transport times may be off by this, one sigma, without being wrong; and by a row where the measured
    nozzle stands for the command, for nobody knows what it did between the rows."""
    return max(record.nominal.diagnosis.timing, 0.0 if record.command_is_known else record.period)


def as_commanded(record: Record) -> float:
    """The error [rad] within which a command need be reproduced."""
    return record.nominal.diagnosis.command


def as_dispersed(record: Record) -> float:
    """The nominal's tolerance of a6 and k1, relative, one sigma."""
    return record.nominal.diagnosis.tolerance


def always(record: Record) -> bool:
    """The condition of a cause that any log can show."""
    return True


def input_moves(record: Record) -> bool:
    """The input moves, by more than its noise: what acts on it shows."""
    noise = record.actuator.command_noise_std if record.command_is_known else record.nominal.sensors.beta_std
    return bool(np.std(record.commands) > noise)


def command_moves(record: Record) -> bool:
    """The same of a command, between which and the vehicle there is an actuator: the log has it, or reference and
    controller make it."""
    return record.command_is_known and input_moves(record)


def is_told(record: Record, channel: str, other: str) -> bool:
    """A channel is measured, and another one or the input tells what it should show."""
    return channel in record.channels and (other in record.channels or input_moves(record))


@dataclass(frozen=True)
class Hypothesis:
    """One cause; free[0] is its size, whose `neutral` value makes no difference (of several sizes all at it).

    words    what it means, with its parameters in braces
    shapes   of a record: values of the other free numbers to start from
    sizes    of a record: sizes to try where the response is not proportional to the size; None: it is
    far      of a record: sizes to start from beside the one that a response proportional to the size promises
    visible  of a record: whether the log has the columns that could show it
    fixed    parameters that are not searched (the term of a missing one)
    dithered how much of the command noise's rms its size may be off: the noise keeps a play moving, which the
             prediction, run on the mean command, does not see
    start    how the search begins
    limit_at of a record: values of the other parameters for which the limit is given;  largest: a larger is none
    form     another law of it; steps: it may come gradually;  tells_onset: what begins with the log is another cause
    is_mode  an oscillation of the vehicle, at its free[1]; may_repeat: there may be two
    twin     the cause that it cannot be told from, and so does not join, where no sensor tells the nozzle
    imitated (place, shape: `judge.shapes`) that is its one twin outside the catalogue, and less common
    decides  (cause, what would tell this one from it)
    like     (cause, in which way this one is like it, where the catalogue's own form is not)
    corrections  take it off what an estimator sees, () if there it is not seen; None: that cannot be done
    floor    of a record: a size nearer to neutral is within what the nominal leaves open, and explains nothing
    late     of a record and a size: how much later [s] something is for it; 0 of most
    held     of a record: the largest size that its nozzle can hold; what is larger, the vehicle does not survive
    """

    cause: str
    free: tuple[Free, ...]
    neutral: float
    words: str
    shapes: Callable[[Record], list[Values]] = only_start
    visible: Callable[[Record], bool] = always
    sizes: Callable[[Record], list[float]] | None = None
    far: Callable[[Record], Values] = nothing_far
    fixed: tuple[tuple[str, str | float], ...] = ()
    dithered: float = 0.0
    start: Start = Start.RESPONSE
    limit_at: Callable[[Record], Values] = nothing_given
    largest: float = math.inf
    form: Form | None = None
    steps: Steps | None = None
    tells_onset: bool = False
    is_mode: bool = False
    may_repeat: bool = False
    twin: str = ""
    imitated: tuple[str, str] = ("", "")
    decides: tuple[tuple[str, str], ...] = ()
    like: tuple[tuple[str, str], ...] = ()
    corrections: tuple[Correction, ...] | None = None
    floor: Callable[[Record], float] = no_floor
    late: Callable[[Record, float], float] = not_late
    held: Callable[[Record], float] = any_size

    def effect(self, values: Values) -> Effect:
        """The simulator's effect at these values of the free numbers, and the fixed ones."""
        return effect(self.cause, **dict(self.fixed), **dict(zip((f.name for f in self.free), values, strict=True)))

    @property
    def label(self) -> str:
        """The cause's name, with what is fixed."""
        return self.cause + "".join(f"({value})" for _, value in self.fixed)

    @property
    def where(self) -> str:
        return CATALOGUE[self.cause].where

    @property
    def is_timed(self) -> bool:
        """Whether its times are fixed (`pinned`)."""
        return any(name in TIMES for name, _ in self.fixed)

    @property
    def is_line(self) -> bool:
        """A sine of any frequency, its free[1]."""
        return self.start is Start.LINE

    @property
    def reach(self) -> float:
        """The distance from neutral within which a size is sought, in its unit: a larger one is none."""
        if math.isinf(self.neutral):
            return self.largest
        return min(self.largest, max(self.free[0].high - self.neutral, self.neutral - self.free[0].low))

    def unit(self, name: str) -> str:
        """Unit of one of its parameters."""
        return next(p.unit for p in CATALOGUE[self.cause].parameters if p.name == name)

    def meaning(self, values: Mapping[str, float | str]) -> str:
        """The cause's words at these values."""
        return self.form.hypothesis.words if self.form is not None and values.get(self.form.parameter) else self.words


@dataclass(frozen=True)
class Cause:
    """A hypothesis at its values."""

    hypothesis: Hypothesis
    values: Values

    @property
    def is_at_an_end(self) -> bool:
        """A value is at the end of the range that was searched: whatever it stands for, it is not this cause."""
        for free, value in zip(self.hypothesis.free, self.values, strict=True):
            ends = [end for end in (free.low, free.high)
                    if math.isfinite(end) and end not in (0.0, self.hypothesis.neutral)]
            if any(abs(value - end) <= AT_END * abs(end) for end in ends):
                return True
        return False


def size(name: str, step: float, low: float = -math.inf, high: float = math.inf) -> Free:
    """A free number that is searched as it is."""
    return Free(name, step, low, high)


def pinned(hypothesis: Hypothesis, values: Values) -> tuple[Hypothesis, Values]:
    """The hypothesis with its times as they are, and the values of what stays free."""
    times = tuple((free.name, value) for free, value in zip(hypothesis.free, values, strict=True) if free.name in TIMES)
    kept = [(free, value) for free, value in zip(hypothesis.free, values, strict=True) if free.name not in TIMES]
    return (replace(hypothesis, free=tuple(free for free, _ in kept), fixed=(*hypothesis.fixed, *times)),
            tuple(value for _, value in kept))
