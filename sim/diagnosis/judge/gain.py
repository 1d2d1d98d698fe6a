"""What the extension buys, measured on data that no parameter was fitted to.

Blocks of the log are left out in turn: everything (causes from their own first search, deviations of a6 and k1,
noise levels) is fitted to the others and judged on them.  With a second log, everything is fitted to the first.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..causes import Cause, pinned
from ..controller.kind import ControllerCheck
from ..data.record import CHANNELS, Record
from ..model.noise import Filter, dynamics, first_filter, fit_levels, run_filter
from ..model.nuisance import WORST_WHITE, Problem
from ..model.point import DEVIATIONS, Point, innovations, prediction_errors
from ..search.fit import Fit, fit
from ..search.scan import scan
from ..search.selection import Model
from .closed_loop import closed_loop_errors, rms

HORIZONS = (0.1, 0.5, 1.0)   # s
LONG = 1.25            # s left out at a time: a prediction over 1 s fits in
SHORT = 0.1            # s
FOLDS_SEED = 11
REACH = 2.0            # standard deviations of a deviation that the nominal may have when it is judged
SPACING = 0.125        # s between predictions


@dataclass(frozen=True, eq=False)
class Gain:
    """Held-out quality of the nominal and of the extended model.

    log_likelihood  per row, (nominal, extended);  nats: their difference over the whole log
    nrmse           horizon -> channel -> (nominal, extended): RMS prediction error over the RMS change of the channel
    closed_loop     (nominal, extended) RMS of measured less simulated attitude [rad], mean over noise draws; or None
    source          where it was measured
    """

    log_likelihood: tuple[float, float]
    nats: float
    nrmse: dict[float, dict[str, tuple[float, float]]]
    closed_loop: tuple[float, float] | None
    source: str


@dataclass(frozen=True, eq=False)
class Trained:
    """A model fitted to some rows: what it believes, and its filter."""

    point: Point
    filter: Filter


def short_folds(record: Record) -> list[np.ndarray]:
    """Two masks (n,) bool of rows to fit to, the rest of each left out, for likelihoods: each row is predicted from
    all before it, so blocks may be short, and an onset is never left out with all that tells it.  They are dealt out at
    random: a regular pattern would let a line pass for its alias."""
    block = (np.arange(record.rows) * record.period / SHORT).astype(np.int64)
    odd = np.random.default_rng(FOLDS_SEED).permutation(np.arange(block[-1] + 1) % 2)[block] == 1
    return [odd, ~odd]


def long_folds(record: Record) -> list[np.ndarray]:
    """The same for predictions: a block holds a horizon of 1 s.  When
    a cause begins and how long it lasts is not fitted anew: blocks that hold an onset would be judged without it."""
    odd = (np.arange(record.rows) * record.period / LONG).astype(np.int64) % 2 == 1
    return [odd, ~odd]


def trained(record: Record, causes: Sequence[Cause], start: Filter, mask: np.ndarray | None) -> Trained:
    """Causes and noise levels fitted to the rows of `mask`: from where a search on these rows would start and from the
    values given, whichever these rows prefer."""
    problem = Problem(record, start, mask)
    given = fit(problem, causes, np.zeros(DEVIATIONS))
    fitted = fit(problem, (), np.zeros(DEVIATIONS), iterations=0)
    for cause in causes:
        candidates = scan(problem, fitted, (cause.hypothesis,))
        if candidates:
            best = candidates[0]
            fitted = fit(problem, (*fitted.causes, Cause(best.hypothesis, best.values)), fitted.delta)
    fitted = min(fitted, given, key=lambda each: each.cost)
    fitted, start = _levelled(record, fitted, start, mask)
    return Trained(fitted.point, start)


def within(record: Record, of: Trained, mask: np.ndarray | None) -> Trained:
    """With the deviations of a6 and k1 that the tolerance allows, and the noise levels that go with them: a nominal
    that needs more is another model."""
    reach = REACH * Problem(record, of.filter).prior
    if np.all(np.abs(of.point.deviations) <= reach):
        return of
    point = replace(of.point, deviations=tuple(np.clip(of.point.deviations, -reach, reach).tolist()))
    filt = of.filter
    for _ in range(2):
        e, _, _ = innovations(record, filt, point)
        filt = fit_levels(record, dynamics(record, point), e, filt, filt.levels, counts=mask)
    return Trained(point, filt)


def refitted(record: Record, causes: Sequence[Cause], start: Filter, mask: np.ndarray) -> Trained:
    """Causes, deviations of a6 and k1 within the tolerance, and noise levels fitted to the rows of `mask` from the
    values given.  Without the deviations, which both models may have, an error of 2 % in a6 hides what a small cause
    does."""
    fitted, filt = _levelled(record, fit(Problem(record, start, mask), causes, np.zeros(DEVIATIONS)), start, mask)
    return within(record, Trained(fitted.point, filt), mask)


def _levelled(record: Record, fitted: Fit, start: Filter, mask: np.ndarray | None) -> tuple[Fit, Filter]:
    filt = fit_levels(record, dynamics(record, fitted.point), fitted.innovations, start, start.levels, counts=mask)
    return fit(Problem(record, filt, mask), fitted.causes, fitted.delta, iterations=3), filt


def held_out(record: Record, model: Model, nominal: Model, controller: ControllerCheck | None = None) -> Gain:
    """On blocked folds of the log itself; the controller found on board flies in the closed loop."""
    totals, errors, changes = np.zeros(2), [], []
    for mask in short_folds(record):
        pair = (within(record, trained(record, (), nominal.fit.filter, mask), mask),
                trained(record, model.causes, model.fit.filter, mask))
        totals += [log_likelihood(record, each, ~mask) for each in pair]
    timed = [Cause(*pinned(cause.hypothesis, cause.values)) for cause in model.causes]
    for mask in long_folds(record):
        pair = (refitted(record, (), nominal.fit.filter, mask), refitted(record, timed, model.fit.filter, mask))
        made, change = _errors(record, pair, ~mask)
        errors.append(made)
        changes.append(change)
    errors_, changes_ = np.concatenate(errors, axis=1), np.concatenate(changes)
    closed_loop = closed_loop_errors(record, model.fit.point.effects, controller)
    return _gain(record, totals, errors_, changes_, closed_loop, "blocked folds")


def on_another(other: Record, model: Model, nominal: Model, controller: ControllerCheck | None = None) -> Gain:
    """On a second log: the causes at the values fitted to the first; its own noise levels are not fitted."""
    everything = np.ones(other.rows, bool)
    pair = []
    for each in (nominal, model):
        point = each.fit.point
        start = first_filter(other, each.fit.filter.levels)
        e, _, _ = innovations(other, start, point)
        pair.append(Trained(point, run_filter(other, dynamics(other, point), start.levels, e, start)))
    pair[0] = within(other, pair[0], None)
    totals = np.array([log_likelihood(other, each, everything) for each in pair])
    errors, change = _errors(other, (pair[0], pair[1]), everything)
    closed_loop = closed_loop_errors(other, model.fit.point.effects, controller)
    return _gain(other, totals, errors, change, closed_loop, "a second log")


def log_likelihood(record: Record, of: Trained, rows: np.ndarray) -> float:
    """Of the rows (n,) bool, each predicted from all before it."""
    e, _, _ = innovations(record, of.filter, of.point)
    white = np.clip(of.filter.whiten(e), -WORST_WHITE, WORST_WHITE)[rows]
    measured = np.isfinite(record.z)[rows]
    diagonal = np.einsum("kaa->ka", of.filter.low)[rows]
    return float(-0.5 * np.sum(white[measured]**2) - np.sum(np.log(diagonal[measured]))
                 - 0.5 * math.log(2.0 * math.pi) * measured.sum())


def _errors(record: Record, pair: tuple[Trained, Trained], rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Prediction errors (2, s, h, 3) whose whole horizon lies in rows left out, and the channels' changes (s, h, 3)."""
    made = np.stack([prediction_errors(record, each.filter, each.point, HORIZONS, SPACING) for each in pair])
    spacing = max(1, round(SPACING / record.period))
    starts = spacing * np.arange(made.shape[1])
    change = np.full(made.shape[1:], math.nan)
    for h, horizon in enumerate(HORIZONS):
        ahead = max(1, round(horizon / record.period))
        inside = starts + ahead < record.rows
        whole = np.zeros(len(starts), bool)
        total = np.concatenate([[0], np.cumsum(rows)])
        whole[inside] = total[starts[inside] + ahead + 1] - total[starts[inside]] == ahead + 1
        made[:, ~whole, h] = math.nan
        change[inside, h] = record.z[starts[inside] + ahead] - record.z[starts[inside]]
    change[~np.isfinite(made[0])] = math.nan
    return made, change


def _gain(record: Record, totals: np.ndarray, errors: np.ndarray, changes: np.ndarray,
          closed_loop: tuple[float, float] | None, source: str) -> Gain:
    nrmse: dict[float, dict[str, tuple[float, float]]] = {}
    for h, horizon in enumerate(HORIZONS):
        nrmse[horizon] = {}
        for c, channel in enumerate(CHANNELS):
            scale = rms(changes[:, h, c])
            if channel in record.channels and scale > 0.0:
                nrmse[horizon][channel] = (rms(errors[0, :, h, c]) / scale, rms(errors[1, :, h, c]) / scale)
    return Gain((float(totals[0] / record.rows), float(totals[1] / record.rows)), float(totals[1] - totals[0]), nrmse,
                closed_loop, source)
