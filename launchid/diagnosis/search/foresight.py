"""The foresight of a model: its predictions over a horizon, begun all along the log.

Where the noise is far from the declared, or a moment that nobody declared is in the model, the likelihood of one row
after the other is bought with noise: a model that follows the sensors closely then beats one that knows where the
vehicle goes.  There the predictions decide which cause may stand (`foreseen`); they are of the rows that were fitted
to, since all that compete have few numbers.  What is named is judged on rows left out (`judge.gain`).
"""

import math

import numpy as np

from ..data.record import Record
from ..data.world import SLOW_MOMENT
from ..model.noise import ACCELERATION, declared
from ..model.nuisance import Problem
from ..model.point import prediction_errors
from .profile import Model

LONGEST = 1.0          # s of a prediction
SHORTER = (0.1, 0.5, 1.0)  # of the longest
GROWTH = 3.0           # time constants of an unstable vehicle in the longest: an error of its state grows e^3-fold
SPACING = 0.125        # s between predictions
SETTLED = 2.0          # s: before, the state is hardly known, and the square of one error there outweighs all others
CHANCE = 2.5           # standard deviations of a mean square, beyond which it is more than noise
FARTHEST = 1e30        # an error beyond which none is further off, or below whose inverse none is nearer
LEAST_REMOVED = 0.05   # share of the nominal's squared error that a cause beside others must take away
STRAINED = 3.0         # times the declared: noise of the acceleration that stands for what is not modelled


def spans(record: Record) -> tuple[float, ...]:
    """The horizons [s] of the predictions, the longest last.  Over longer ones a vehicle that is fast unstable shows
    nothing but the error of its state at their beginning, and one in weather that nobody declared nothing but what that
    became."""
    fastest = math.sqrt(max(float(np.max(record.a6)), 0.0))
    longest = min(LONGEST, GROWTH / fastest) if fastest > 0.0 else LONGEST
    longest = min([longest, *(each.time_constant for each in record.world.sources if each.is_sought)])
    return tuple(float(f"{share * longest:.2g}") for share in SHORTER)


def settling(record: Record) -> float:
    """The time [s] from the first row until the filter knows the state."""
    return min(SETTLED, 0.25 * record.rows * record.period)


def is_strained(model: Model) -> bool:
    """Whether the model's likelihood is bought with noise."""
    record, levels = model.fit.record, model.fit.filter.levels
    return bool(levels[ACCELERATION] > STRAINED * declared(record)[ACCELERATION]) or \
        any(each.is_sought and each.name == SLOW_MOMENT for each in record.world.sources)


def foreseen(base: Model, models: list[Model]) -> list[bool]:
    """A mask of these models, most likely first, that may stand: what predicts worse than the base may not, nor what
    predicts worse than another and is more likely; all may where the most likely is not strained."""
    if not models or not is_strained(models[0]):
        return [True] * len(models)
    before, errors = _errors(base), [_errors(model) for model in models]
    best = min(range(len(models)), key=lambda k: float(np.min(np.sum(errors[k][0] / before[0], axis=1))))
    return [not _is_worse(errors[k], before) and (k >= best or not _is_worse(errors[k], errors[best]))
            for k in range(len(models))]


def is_idle(nominal: Model, base: Model, other: Model) -> bool:
    """The other, the base with one more cause, is strained and takes next to nothing more away of what the nominal's
    predictions are off."""
    if not is_strained(other):
        return False
    none = _errors(nominal)[0]
    before, after = (np.mean(_errors(each)[0] / none, axis=1) for each in (base, other))
    return bool(np.all(before - after < LEAST_REMOVED))


def _errors(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """(h, c) mean squares of the predictions of each measured channel, and how many horizons stand side by side in
    each.

    They are over the longest horizon; over all in a disturbance that nobody declared, which a loop's commands answer
    within the longest.
    """
    record = model.fit.record
    over = spans(record) if any(each.is_sought for each in record.world.sources) else spans(record)[-1:]
    point = Problem(record, model.fit.filter).within_reach(model.fit.point)
    errors = prediction_errors(record, model.fit.filter, point, over, SPACING)
    pairs = [_squares(record, errors[:, h], horizon) for h, horizon in enumerate(over)]
    return np.stack([squares for squares, _ in pairs]), np.stack([count for _, count in pairs])


def _squares(record: Record, errors: np.ndarray, over: float) -> tuple[np.ndarray, np.ndarray]:
    """`_errors` of one horizon [s], with errors (s, 3)."""
    apart, ahead = (max(1, round(seconds / record.period)) for seconds in (SPACING, over))
    starts = apart * np.arange(len(errors))
    inside = (starts * record.period >= settling(record)) & (starts + ahead < record.rows)
    errors, seen = errors[inside], np.isfinite(record.z[starts[inside] + ahead])
    count = seen.sum(axis=0)
    there = count > 0
    off = np.nan_to_num(np.clip(errors, -FARTHEST, FARTHEST), nan=FARTHEST)  # what did not stay with the log is far off
    squares = np.sum(np.where(seen, off, 0.0)**2, axis=0)[there] / count[there]
    return np.maximum(squares, FARTHEST**-2), np.maximum(1.0, count[there] * min(1.0, apart * record.period / over))


def _is_worse(one: tuple[np.ndarray, np.ndarray], other: tuple[np.ndarray, np.ndarray]) -> bool:
    """One's squared errors exceed the other's by more than chance over every horizon, all channels together."""
    excess = np.sum(one[0] / other[0] - 1.0, axis=1)
    return bool(np.all(excess > CHANCE * np.sqrt(np.sum(2.0 / one[1], axis=1))))
