"""Causes as they are reported: values in the catalogue's names, look-alikes, and what makes a name doubtful."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...sums import square
from ..causes import MISMATCH, RECORDS, Cause, Hypothesis
from ..controller.kind import ControllerCheck
from ..data.record import Record
from ..data.world import TURBULENCE, WALK
from ..model.nuisance import Problem
from ..search.fit import point_of
from ..search.profile import TOLD_APART, Model, penalty, profile
from ..search.selection import Ranked, Selection, Weather
from .constancy import Constancy, constancy

SIGNIFICANT = 3.0      # standard deviations: of an onset from the log's beginning, of a noise level from the declared
OLDEST = 1.5           # times the age of a sample that a logger reads: the servo's timing is free besides
SCALE = "scale"        # of what is multiplied
IDLE = tuple(0.05 * 2.0**k for k in range(8))  # s to either side of an onset, at which it is tried
UNTRIED = 4.5          # nats: at an onset that costs more it was not
BLURRED = 0.05         # of its evidence: a cause so alike (|cos| 0.975) is not told apart beside what nothing names


@dataclass(frozen=True, eq=False)
class Named:
    """One cause as reported.

    values, std, units   of its parameters, in the catalogue's names
    rivals               causes that explain the log as well, without itself
    constancy            None for the controller's, which is exact
    is_at_an_end         of the range searched: whatever it stands for, it is not this cause
    steps                (time [s], size) of one that comes gradually, () of all else
    removed              share of the nominal's held-out squared error beyond noise that comes back without it (and
                         all else fitted anew); None: not told
    """

    cause: str
    values: dict[str, float | str]
    std: dict[str, float]
    units: dict[str, str]
    rivals: tuple[str, ...]
    evidence: float
    constancy: Constancy | None
    is_at_an_end: bool = False
    steps: tuple[tuple[float, float], ...] = ()
    removed: float | None = None

    @property
    def record(self) -> Hypothesis:
        """The catalogue's record of this cause."""
        return RECORDS[self.cause]

    @property
    def where(self) -> str:
        return self.record.where

    def is_open(self, record: Record) -> bool:
        """Whether its size is within what the nominal leaves open (`Hypothesis.floor`), so that it explains nothing."""
        of = self.record
        size = self.values.get(of.free[0].name)
        return not self.is_weather and isinstance(size, float) and abs(size - of.neutral) < of.floor(record)

    @property
    def is_weather(self) -> bool:
        """A level of the wind, which is not in the model's effects."""
        return self.cause in (TURBULENCE, WALK)

    @property
    def label(self) -> str:
        """The cause's name, with the term of a missing one."""
        return f"{self.cause} {self.values['term']}" if "term" in self.values else self.cause


def named_causes(selection: Selection) -> tuple[Named, ...]:
    """The causes of a selection's model; one that comes in steps is one cause."""
    return tuple(_named(selection, group[0]) if len(group) == 1 else _gradual(selection, group)
                 for group in together(selection.model))


def with_removed(named: tuple[Named, ...], model: Model, shares: Sequence[float]) -> tuple[Named, ...]:
    """The causes of a model with what each of them removes, from the shares of its single ones; () is not told."""
    if not shares:
        return named
    of = [sum(shares[k] for k in group) for group in together(model)]
    return tuple(replace(each, removed=share) for each, share in zip(named, of, strict=False)) + named[len(of):]


def together(model: Model) -> Iterator[list[int]]:
    """Indices of the causes; the steps of one cause together, in the order of their times."""
    gradual = sorted((cause.values[1], k) for k, cause in enumerate(model.causes) if cause.hypothesis.steps is not None)
    group: list[int] = []
    for _, k in gradual:
        if group and not _belong_together(model.causes[group[-1]], model.causes[k]):
            yield group
            group = []
        group.append(k)
    if group:
        yield group
    for k, cause in enumerate(model.causes):
        if cause.hypothesis.steps is None:
            yield [k]


def _belong_together(one: Cause, next_one: Cause) -> bool:
    """Two steps are of one cause: of the same, the same way, soon after one another."""
    steps = one.hypothesis.steps
    return steps is not None and one.hypothesis.cause == next_one.hypothesis.cause and \
        not (next_one.values[1] - one.values[1] > steps.near or next_one.values[0] * one.values[0] < 0.0)


def _named(selection: Selection, k: int) -> Named:
    model = selection.model
    cause, std, t = model.causes[k], model.fit.std(k), model.fit.record.t
    names = [free.name for free in cause.hypothesis.free]
    values = {**dict(cause.hypothesis.fixed), **dict(zip(names, cause.values, strict=True))}
    if "time" in names:
        values["time"] = cause.values[names.index("time")] + model.fit.record.shift  # the log's clock
    if cause.hypothesis.tells_onset and "time" in names:
        at = names.index("time")
        std = (*std[:at], max(std[at], _onset_std(model, k, at)), *std[at + 1:])
    return Named(cause.hypothesis.cause, values,
                 dict(zip(names, std, strict=True)), {name: cause.hypothesis.unit(name) for name in values},
                 _rivals(cause.hypothesis.cause, selection.rivals[k], _blurred(selection), (float(t[0]), float(t[-1]))),
                 selection.evidence[k],
                 constancy(model, k),
                 cause.is_at_an_end)


def _onset_std(model: Model, index: int, at: int) -> float:
    """The standard deviation [s] of cause `index`'s onset, its value `at`, as wide as the log is silent about it: an
    onset while nothing moves is anywhere between two manoeuvres, whatever the curvature at the best one says."""
    fitted, widest = model.fit, 0.0
    problem, t = Problem(fitted.record, fitted.filter), fitted.record.t
    for away in (*IDLE, *(-each for each in IDLE)):
        values = list(fitted.causes[index].values)
        values[at] += away
        if not t[0] <= values[at] <= t[-1]:
            continue
        moved = list(fitted.causes)
        moved[index] = replace(moved[index], values=tuple(values))
        r = problem.residual(point_of(moved, fitted.delta))
        costs = 0.5 * square(r) - fitted.cost
        if costs < UNTRIED:
            widest = max(widest, abs(away) / math.sqrt(2.0 * max(costs, 0.5)))
    return widest


def _gradual(selection: Selection, group: list[int]) -> Named:
    """The steps of one cause as one: what is lost in all, in the middle."""
    model, parts = selection.model, [_named(selection, k) for k in group]
    size, time = (free.name for free in model.causes[group[0]].hypothesis.free)
    fractions = np.array([model.causes[k].values[0] for k in group])
    times = np.array([float(part.values[time]) for part in parts])
    kept = np.prod(1.0 - fractions)
    first = [sum(len(cause.values) for cause in model.causes[:k]) for k in group]
    slope, weight = kept / (1.0 - fractions), fractions / fractions.sum()
    covariance = model.fit.covariance
    variances = [part @ covariance[np.ix_(at, at)] @ part
                 for part, at in ((slope, first), (weight, [k + 1 for k in first]))]
    others = tuple(cause for k, cause in enumerate(model.causes) if k not in group)
    without = profile(model.fit.record, others, model.fit.delta, model.fit.filter) if others else selection.nominal
    evidence = model.log_likelihood - without.log_likelihood \
        - sum(penalty(model.fit.record, model.causes[k].hypothesis) for k in group)
    worst, of = max(zip(parts, fractions, strict=True), key=lambda pair: _chi_squared(pair[0]))
    assert worst.constancy is not None
    whole = float(1.0 - kept)
    return replace(worst, values={size: whole, time: float(weight @ times)},
                   std=dict(zip((size, time), (math.sqrt(max(v, 0.0)) for v in variances), strict=True)),
                   rivals=tuple(each for each in parts[0].rivals if all(each in part.rivals for part in parts)),
                   evidence=evidence, is_at_an_end=any(part.is_at_an_end for part in parts),
                   constancy=replace(worst.constancy, size=tuple(each + whole - of for each in worst.constancy.size)),
                   steps=tuple(zip(times.tolist(), fractions.tolist(), strict=True)))


def _blurred(selection: Selection) -> float:
    """Share of a cause's evidence by which no rival is told from it: what nothing names can be on either's side."""
    return BLURRED if selection.weather is not None and not selection.weather.is_wind else 0.0


def _rivals(name: str, ranking: list[Ranked], blurred: float, span: tuple[float, float]) -> tuple[str, ...]:
    """Causes within TOLD_APART of the best in the same place of the model, or within a share of its evidence; none that
    begins and ends, but neither within the log, span [s] first and last row: a gust that lasts is a steady wind."""
    if not ranking:
        return ()
    best = max(each.evidence for each in ranking)
    near = [each.cause.hypothesis.cause for each in ranking if each.evidence > best - max(TOLD_APART, blurred * best)
            and _is_seen(each.cause, span)]
    return tuple(dict.fromkeys(each for each in near if each != name))


def _is_seen(cause: Cause, span: tuple[float, float]) -> bool:
    """Whether a cause has no time, or begins or ends within the log."""
    values = dict(zip((free.name for free in cause.hypothesis.free), cause.values, strict=True))
    edges = [values["time"], values["time"] + values.get("duration", math.inf)] if "time" in values else []
    return not edges or any(span[0] <= edge <= span[1] for edge in edges)


def named_weather(weather: Weather) -> Named:
    """Wind that nobody declared."""
    source = weather.source
    values: dict[str, float | str] = {"level": weather.level}
    std = {"level": weather.std}
    if source.name == TURBULENCE:
        values["time_constant"] = source.time_constant
    units = {name: RECORDS[source.name].unit(name) for name in values}
    return Named(source.name, values, std, units, weather.rivals, weather.gain, None)


def mismatch(controller: ControllerCheck) -> Named:
    """The controller's cause."""
    values: dict[str, float | str] = {"kp_scale": controller.kp_scale, "kd_scale": controller.kd_scale,
                                      "delay": controller.delay}
    return Named(MISMATCH.cause, values, dict(zip(values, controller.std, strict=True)),
                 {name: MISMATCH.unit(name) for name in values}, (), controller.evidence, None)


def _chi_squared(named: Named) -> float:
    """The chi squared of a cause's size over the log; the controller's is exact."""
    return 0.0 if named.constancy is None else named.constancy.chi_squared


def undetermined(each: Named, began: float) -> list[str]:
    """Doubts about the numbers that make a cause this one and no simpler one: its size, its onset."""
    found = [f"{each.cause}: a value is at the end of the range searched"] if each.is_at_an_end else []
    size, std = each.values.get(SCALE), each.std.get(SCALE, 0.0)
    if isinstance(size, float) and abs(size) < SIGNIFICANT * std:
        found.append(f"{each.cause}: a scale of {size:.2g} +- {std:.2g} is none: the log does not follow that input, "
                     "as where it is of another time")
    time = each.values.get("time")
    if each.record.tells_onset and isinstance(time, float) and time - SIGNIFICANT * each.std["time"] < began:
        found.append(f"{each.cause}: the log does not tell its onset from the log's beginning ({time:.3g} +- "
                     f"{each.std['time']:.2g} s)")
    return found


def aged(each: Named, record: Record) -> list[str]:
    """The doubt that a delay is the age of samples that a logger read by a clock of its own."""
    size = each.values.get(each.record.free[0].name) if each.record.free else None
    late = each.record.late(record, size) if isinstance(size, float) else 0.0
    if not 0.0 < late < OLDEST * record.age or each.is_open(record):
        return []
    return [f"{each.cause}: {late:.2g} s may be the age of what the logger read by its own clock (up to "
            f"{record.age:.2g} s)"]
