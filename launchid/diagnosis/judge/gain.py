"""The gain of the extension, measured on data that no parameter was fitted to.

Blocks of the log are left out in turn: everything (causes from their own first search, deviations of a6 and k1,
noise levels) is fitted to the others and judged on them.  With a second log, everything is fitted to the first.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ..causes import Cause, pinned
from ..controller.kind import ControllerCheck
from ..data.record import CHANNELS, Record
from ..model.level_fit import fit_levels
from ..model.noise import Filter, Refilter, declared, dynamics, first_filter, nothing_foreseen, run_filter
from ..model.nuisance import WORST_WHITE, Problem
from ..model.point import DEVIATIONS, Point, innovations, prediction_errors
from ..search.fit import Fit, fit
from ..search.foresight import CHANCE, SPACING, settling, spans
from ..search.profile import Model
from ..search.scan import scan
from .closed_loop import closed_loop_errors, rms

LONG = 1.25            # s left out at a time: a prediction over 1 s fits in
SHORT = 0.1            # s
FOLDS_SEED = 11
LEAST_EXCESS = 0.1     # of the squared error that noise alone gives: less is not told from chance within a log
CONFIDENCE = 1.645     # standard deviations: one side, 95 %
LARGEST = 1e100        # error of a prediction, by an unstable model: its square is still a number
NOISIEST = 1.5         # factor of the declared levels up to which fitted ones count as noise


@dataclass(frozen=True, eq=False)
class Gain:
    """Held-out quality of the nominal and of the extended model.

    log_likelihood  per row, (nominal, extended);  nats: their difference over the whole log
    nrmse           horizon [s], the longest last -> channel -> (nominal, extended): RMS prediction error over the RMS
                    change of the channel
    squared         channel -> mean square of the errors over the longest horizon of nominal and extended model, and
                    what the extended one's noise alone would give [of the channel's unit]
    closed_loop  (nominal, extended) RMS of measured less simulated attitude [rad], mean over noise draws; or None
    source          where it was measured
    horizons        channel -> how many of the longest stand side by side in what `squared` was measured on
    numbers         that the extended model has more
    """

    log_likelihood: tuple[float, float]
    nats: float
    nrmse: dict[float, dict[str, tuple[float, float]]]
    squared: dict[str, tuple[float, float, float]]
    closed_loop: tuple[float, float] | None
    source: str
    horizons: dict[str, float] = field(default_factory=dict)
    numbers: int = 0

    @property
    def longest(self) -> float:
        """The horizon [s] by which causes are judged."""
        return max(self.nrmse)

    @property
    def is_lost(self) -> bool:
        """The extended model is less likely, in a log too short for predictions by more than chance: a number that two
        halves tell nothing of but their noise costs 1 nat, with a variance of 5."""
        chance = self.numbers + CONFIDENCE * math.sqrt(5.0 * self.numbers) if not self.squared else 0.0
        return not self.nats > -chance

    @property
    def is_left(self) -> bool:
        """The extended model's squared errors exceed what noise gives by more than chance: a mean of n independent
        squares of normal variables is off by (2/n)^1/2 of itself, one sigma."""
        return any(extended / noise - 1.0 > CHANCE * math.sqrt(2.0 / self.horizons.get(name, math.inf))
                   for name, (_, extended, noise) in self.squared.items())

    @property
    def excess(self) -> tuple[float, float]:
        """The excess of the squared errors of nominal and extended model over what noise gives, relative to that,
        summed over the channels.  The noise is the extended model's: the nominal's holds what it does not model."""
        made = [(max(0.0, nominal / noise - 1.0), max(0.0, extended / noise - 1.0))
                for nominal, extended, noise in self.squared.values()]
        return sum(before for before, _ in made), sum(after for _, after in made)

    @property
    def share(self) -> float | None:
        """The share of the nominal's excess that the extended model leaves, 0 to 1; None where there is none to speak
        of, or no more than chance makes of so many horizons."""
        before, after = self.excess
        chance = CHANCE * math.sqrt(sum(2.0 / self.horizons.get(name, math.inf) for name in self.squared))
        return min(1.0, after / before) if before > max(LEAST_EXCESS * len(self.squared), chance) else None

    @property
    def whole(self) -> float:
        """The extended model's squared errors over the nominal's, noise included, mean over the channels; 0 in logs too
        short for any."""
        ratios = [extended / nominal for nominal, extended, _ in self.squared.values()]
        return sum(ratios) / len(ratios) if ratios else 0.0


@dataclass(frozen=True, eq=False)
class Trained:
    """A model fitted to some rows: what it believes, and its filter."""

    point: Point
    filter: Filter


def short_folds(record: Record) -> list[np.ndarray]:
    """Two masks (n,) bool of rows to fit to, the rest of each left out, for likelihoods: each row is predicted from
    all before it, so blocks may be short.  When a cause begins is not fitted anew: in weather a tenth of a second tells
    it, which one of the two does not have.  They are dealt out at random: a regular pattern would let a line pass for
    its alias.  The first rows are fitted to by both and judged by neither: they alone tell where the state began,
    without them what is constant may be anything."""
    block = (np.arange(record.rows) * record.period / SHORT).astype(np.int64)
    odd = np.random.default_rng(FOLDS_SEED).permutation(np.arange(block[-1] + 1) % 2)[block] == 1
    early = np.arange(record.rows) * record.period < settling(record)
    return [odd | early, ~odd | early]


def long_folds(record: Record) -> list[np.ndarray]:
    """The same for predictions: a block holds a horizon of 1 s, and of every two in turn each mask has one, which is
    drawn: of an experiment that repeats itself a regular pattern gives all motion to one mask and none to the other.
    When a cause begins and how long it lasts is not fitted anew: blocks that hold an onset would be judged without it.
    """
    block = (np.arange(record.rows) * record.period / LONG).astype(np.int64)
    swapped = np.random.default_rng(FOLDS_SEED).random(block[-1] // 2 + 1) < 0.5
    odd = (block % 2 == 1) ^ swapped[block // 2]
    return [odd, ~odd]


def trained(record: Record, causes: Sequence[Cause], start: Filter, mask: np.ndarray | None) -> Trained:
    """Causes and noise levels fitted to the rows of `mask`: from where a search on these rows would start and from the
    values given, whichever these rows prefer."""
    problem = Problem(record, start, mask)
    given = fit(problem, causes, np.zeros(DEVIATIONS))
    fitted = fit(problem, (), np.zeros(DEVIATIONS), iterations=0)
    for cause in causes:
        candidates = scan(problem, fitted, (cause.hypothesis,)) if not cause.hypothesis.is_timed else ()
        best = Cause(candidates[0].hypothesis, candidates[0].values) if candidates else cause
        if candidates or cause.hypothesis.is_timed:
            fitted = fit(problem, (*fitted.causes, best), fitted.delta)
    return Trained(*_judged(record, min(fitted, given, key=lambda each: each.cost), start, mask))


def _judged(record: Record, fitted: Fit, start: Filter, mask: np.ndarray | None) -> tuple[Point, Filter]:
    """A fit's model with its own noise levels."""
    fitted, filt = _levelled(record, fitted, start, mask)
    return fitted.point, filt


def within(record: Record, of: Trained, mask: np.ndarray | None) -> Trained:
    """The model with the deviations of a6 and k1 that the tolerance allows, and the noise levels that go with them: a
    nominal that needs more is another model."""
    point = Problem(record, of.filter).within_reach(of.point)
    if point == of.point:
        return of
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


def held_out(model: Model, nominal: Model, controller: ControllerCheck | None = None, is_named: bool = True) -> Gain:
    """The gain on blocked folds of the log itself, each model in its own world; the controller found on board flies in
    the closed loop.

    is_named  what weather nobody declared makes counts as noise, for it is told; else it counts as error
    """
    record, own = nominal.fit.record, model.fit.record
    totals, errors, changes, noises = np.zeros(2), [], [], []
    timed = [Cause(*pinned(cause.hypothesis, cause.values)) for cause in model.causes]
    for mask in short_folds(record):
        pair = (within(record, trained(record, (), nominal.fit.filter, mask), mask),
                trained(own, timed, model.fit.filter, mask))
        totals += [log_likelihood(of, each, ~mask) for of, each in zip((record, own), pair, strict=True)]
    for mask in long_folds(record):
        pair = (refitted(record, (), nominal.fit.filter, mask), refitted(own, timed, model.fit.filter, mask))
        made, change = _errors((record, own), pair, ~mask)
        errors.append(made)
        changes.append(change)
        noises.append(_noises(own, pair[1], spans(record), is_named))
    ahead = _Ahead(np.concatenate(errors, axis=1), np.concatenate(changes), np.concatenate(noises))
    closed_loop = closed_loop_errors(record, model.fit.point.effects, controller)
    numbers = sum(len(cause.values) for cause in timed)
    return replace(_gain(record, totals, ahead, closed_loop, "blocked folds", is_named), numbers=numbers)


def removed(model: Model, gain: Gain) -> tuple[float, ...]:
    """The share, of the nominal's squared error over the longest horizon beyond noise (`Gain.excess`), that comes back
    on the held-out rows without each cause, the others fitted anew; () where the nominal has none to speak of."""
    before, after = gain.excess
    if gain.share is None:
        return ()
    if len(model.causes) == 1:
        return (1.0 - gain.share,)
    record, found = model.fit.record, []
    timed = [Cause(*pinned(cause.hypothesis, cause.values)) for cause in model.causes]
    for k in range(len(timed)):
        errors = []
        for mask in long_folds(record):
            one = refitted(record, timed[:k] + timed[k + 1:], model.fit.filter, mask)
            errors.append(_errors((record,), (one,), ~mask)[0][0])
        last = np.concatenate(errors)[:, len(gain.nrmse) - 1]
        excess = sum(max(0.0, float(np.nanmean(last[:, CHANNELS.index(name)]**2)) / noise - 1.0)
                     for name, (_, _, noise) in gain.squared.items())
        found.append((excess - after) / before)
    return tuple(found)


def _noises(record: Record, of: Trained, over: Sequence[float], is_named: bool) -> np.ndarray:
    """(s, h, 3) `_noise` over each horizon [s]."""
    return np.stack([_noise(record, of, horizon, is_named) for horizon in over], axis=1)


def _noise(record: Record, of: Trained, horizon: float, is_named: bool = True) -> np.ndarray:
    """(s, 3) mean squares over a horizon [s] that noise alone gives this model's predictions, the declared noise
    as far as the log does not show less; is_named as `held_out`."""
    levels = of.filter.levels.copy()
    for k, each in enumerate(record.world.levels, start=5):
        if each.unsought is not None and not is_named:
            levels[k] = each.unsought
    levels[:5] = np.minimum(levels[:5], NOISIEST * declared(record)[:5])
    ahead = max(1, round(horizon / record.period))
    refilter = Refilter(record, dynamics(record, of.point), record.z)
    return refilter.horizon_variances(levels, max(1, round(SPACING / record.period)), ahead)


def on_another(other: Record, model: Model, nominal: Model, controller: ControllerCheck | None = None,
               is_named: bool = True) -> Gain:
    """The gain on a second log: the causes at the values fitted to the first; its own noise levels are not fitted.
    is_named as `held_out`."""
    everything = np.ones(other.rows, bool)
    records = [replace(other, world=each.fit.record.world) for each in (nominal, model)]
    pair = []
    for record, each in zip(records, (nominal, model), strict=True):
        point = each.fit.point
        start = first_filter(record, each.fit.filter.levels)
        e, _, _ = innovations(record, start, point)
        pair.append(Trained(point, run_filter(record, dynamics(record, point), start.levels, e, start)))
    pair[0] = within(records[0], pair[0], None)
    totals = np.array([log_likelihood(record, each, everything) for record, each in zip(records, pair, strict=True)])
    over = spans(records[0])
    ahead = _Ahead(*_errors(records, pair, everything), _noises(records[1], pair[1], over, is_named))
    closed_loop = closed_loop_errors(other, model.fit.point.effects, controller)
    return _gain(records[0], totals, ahead, closed_loop, "a second log", is_named)


def log_likelihood(record: Record, of: Trained, rows: np.ndarray) -> float:
    """The log-likelihood of the rows (n,) bool, each predicted from all before it."""
    e, _, _ = innovations(record, of.filter, of.point)
    white = np.clip(of.filter.whiten(e), -WORST_WHITE, WORST_WHITE)[rows]
    measured = np.isfinite(record.z)[rows]
    diagonal = np.einsum("kaa->ka", of.filter.low)[rows]
    likely = float(-0.5 * np.sum(white[measured]**2) - np.sum(np.log(diagonal[measured]))
                   - 0.5 * math.log(2.0 * math.pi) * measured.sum())
    return max(likely, nothing_foreseen(record, rows)) if math.isfinite(likely) else likely


def _errors(records: Sequence[Record], models: Sequence[Trained],
            rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Prediction errors (models, s, h, 3) whose whole horizon lies in rows left out and which begin when the filter has
    settled, and the channels' changes (s, h, 3)."""
    over = spans(records[0])
    made = np.stack([prediction_errors(of, each.filter, each.point, over, SPACING)
                     for of, each in zip(records, models, strict=True)]).clip(-LARGEST, LARGEST)
    record = records[0]
    spacing = max(1, round(SPACING / record.period))
    starts = spacing * np.arange(made.shape[1])
    change = np.full(made.shape[1:], math.nan)
    settled = starts * record.period >= settling(record)
    for h, horizon in enumerate(over):
        ahead = max(1, round(horizon / record.period))
        inside = starts + ahead < record.rows
        whole = np.zeros(len(starts), bool)
        total = np.concatenate([[0], np.cumsum(rows)])
        whole[inside] = total[starts[inside] + ahead + 1] - total[starts[inside]] == ahead + 1
        made[:, ~(whole & settled), h] = math.nan
        change[inside, h] = record.z[starts[inside] + ahead] - record.z[starts[inside]]
    change[~np.isfinite(made[0])] = math.nan
    return made, change


class _Ahead(NamedTuple):
    """Predictions of both models, NaN where their horizon is not in rows left out.

    errors (2, s, h, 3), changes (s, h, 3) of the channels, noise (s, h, 3) mean squares of it
    """

    errors: np.ndarray
    changes: np.ndarray
    noise: np.ndarray


def _gain(record: Record, totals: np.ndarray, ahead: _Ahead, closed_loop: tuple[float, float] | None, source: str,
          is_named: bool) -> Gain:
    """The gain over the longest horizon, or beside weather that nothing names over that at which most is removed: over
    the longer ones a loop's commands answer what the weather did since."""
    over = spans(record)
    made = [_gain_over(record, totals, ahead, closed_loop, source, over[:count])
            for count in range(len(over), len(over) - 1 if is_named else 0, -1)]
    return min(made, key=lambda each: 1.0 if each.share is None else each.share)


def _gain_over(record: Record, totals: np.ndarray, ahead: _Ahead, closed_loop: tuple[float, float] | None, source: str,
               over: Sequence[float]) -> Gain:
    """The gain over the last of these horizons [s]."""
    nrmse: dict[float, dict[str, tuple[float, float]]] = {}
    for h, horizon in enumerate(over):
        nrmse[horizon] = {}
        for c, channel in enumerate(CHANNELS):
            scale = rms(ahead.changes[:, h, c])
            if channel in record.channels and scale > 0.0:
                before, after = (rms(errors[:, h, c]) / scale for errors in ahead.errors)
                nrmse[horizon][channel] = (before, after)
    squared, horizons, last = {}, {}, len(over) - 1
    for c, channel in enumerate(CHANNELS):
        errors = ahead.errors[:, :, last, c]
        seen = np.isfinite(errors).all(axis=0)
        if channel in record.channels and seen.any():
            before, after = np.mean(errors[:, seen]**2, axis=1).tolist()
            squared[channel] = before, after, float(np.mean(ahead.noise[seen, last, c]))
            horizons[channel] = max(1.0, float(seen.sum()) * min(SPACING, over[last]) / over[last])
    return Gain((float(totals[0] / record.rows), float(totals[1] / record.rows)), float(totals[1] - totals[0]), nrmse,
                squared, closed_loop, source, horizons)
