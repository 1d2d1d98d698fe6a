"""The most likely noise levels of a log, by Newton's method on their logarithms."""

from collections.abc import Callable

import numpy as np

from ..data.record import Record
from .noise import Disturbance, Dynamics, Filter, Refilter, bounds, declared

PRIOR = 1.0            # one sigma of the log of a factor: nobody declares noise within better than e
WIDE, WIDE_PRIOR = 1e4, 3.0  # span of a level that is sought, not declared, and its prior's sigma
LEVEL_TOLERANCE = 0.02  # of a log factor: levels are found to 2 %
LEVEL_ITERATIONS = 12
LEVEL_GAIN = 0.03      # nats that an iteration must bring to go on
LEVEL_STEP = 0.05      # of a log factor, for slopes and curvatures

Values = Callable[[np.ndarray], np.ndarray]


def fit_levels(record: Record, dyn: Dynamics, base: np.ndarray, of: Filter, start: np.ndarray,
               disturbance: Disturbance | None = None, counts: np.ndarray | None = None) -> Filter:
    """The most likely levels, from a start (5 + the world's,): Newton's method on the logarithms with a numerical
    curvature.

    base, of     innovations (n, 3), and the filter that made them
    disturbance  beside the model, if any;  counts (n,) bool, rows that count, None: all
    """
    reference, (least, most) = declared(record), bounds(record)
    low, high = np.log(least), np.log(most)
    free = [k for k in range(len(reference)) if high[k] > low[k] and (k >= 3 or np.isfinite(base[:, k]).any())]
    wide = np.where(most / least > WIDE, WIDE_PRIOR, PRIOR)
    refilter = Refilter(record, dyn, base, of, counts)

    def values(x: np.ndarray) -> np.ndarray:
        return refilter.log_likelihoods(reference * np.exp(x), disturbance) - 0.5 * np.sum((x / wide)**2, axis=1)

    x = np.clip(np.log(start / reference), low, high)
    best, curvature = values(x[None])[0], np.zeros(len(x))
    for iteration in range(LEVEL_ITERATIONS):
        step, promised, curvature = _newton_step(values, x, best, free, curvature, anew=iteration % 3 == 0)
        if promised < LEVEL_GAIN:
            break
        size = 1.0
        while size > 0.05:
            trial = np.clip(x + size * step, low, high)
            new = values(trial[None])[0]
            if new > best:
                break
            size *= 0.4
        else:
            break
        moved, gained = float(np.max(np.abs(trial - x))), new - best
        x, best = trial, new
        if moved < LEVEL_TOLERANCE or gained < LEVEL_GAIN:
            break
    return refilter.filter(reference * np.exp(x), disturbance)


def _newton_step(values: Values, x: np.ndarray, best: float, free: list[int], curvature: np.ndarray,
                 anew: bool) -> tuple[np.ndarray, float, np.ndarray]:
    """Ascent direction and the gain it promises: each level's own slope over its own curvature (they are nearly
    independent).

    values     of each row of numbers (k, levels)
    curvature  (levels,) of the last step; made anew by central differences, or kept for one-sided ones
    """
    step, slopes, curvature = np.zeros(len(x)), np.zeros(len(x)), curvature.copy()
    if not free:
        return step, 0.0, curvature
    moves = LEVEL_STEP * np.eye(len(x))[free]
    found = values(x + (np.concatenate([moves, -moves]) if anew else moves))
    high = found[:len(free)]
    if anew:
        curvature[free] = (high - 2.0 * best + found[len(free):]) / LEVEL_STEP**2
    slopes[free] = (high - best) / LEVEL_STEP - 0.5 * LEVEL_STEP * curvature[free]
    for k in free:
        flattest = max(-curvature[k], 1.0 / WIDE_PRIOR**2)
        step[k] = slopes[k] / flattest if curvature[k] < 0.0 else np.sign(slopes[k]) * 0.5
    step = np.clip(step, -1.5, 1.5)
    return step, 0.5 * float(slopes @ step), curvature
