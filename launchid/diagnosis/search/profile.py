"""A model of a log: causes with everything else refitted, a6 and k1 within their tolerance and the noise levels."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from ..causes import Cause, Hypothesis
from ..data.record import Record
from ..model.level_fit import fit_levels
from ..model.noise import Dynamics, Filter, bounds, declared, dynamics, first_filter, nothing_foreseen
from ..model.nuisance import Problem
from ..model.point import DEVIATIONS, Point, innovations
from .fit import Fit, fit

TOLD_APART = 4.0      # nats: a rival so near explains the log as well (odds of 55 to 1 are beyond doubt's reach)
ROUNDS = 3            # of alternating between causes and noise levels at most
ROUND_GAIN = 0.1      # nats that a round must bring to go on
MEDIAN = 0.6745       # of a normal variable's size, in its standard deviations
UNSEEN = 3.0          # times the declared command and acceleration noise: a start from above


@dataclass(frozen=True, eq=False)
class Model:
    """Causes with everything refitted: the fit, and the log-likelihood less the tolerance's prior."""

    fit: Fit
    log_likelihood: float
    dynamics: Dynamics

    @property
    def causes(self) -> tuple[Cause, ...]:
        return self.fit.causes


def penalty(record: Record, hypothesis: Hypothesis) -> float:
    """Schwarz's, of one cause [nats]."""
    return 0.5 * len(hypothesis.free) * math.log(record.rows)


def profile(record: Record, causes: Iterable[Cause], delta: np.ndarray, start: Filter,
            fitted: Fit | None = None) -> Model:
    """Causes and noise levels fitted in turn until neither brings anything; no less likely than where nothing is
    foreseen.

    fitted  the causes' fit under `start`, where there is one
    """
    found = fitted if fitted is not None else fit(Problem(record, start), tuple(causes), delta)
    made = _model(record, found)
    for _ in range(ROUNDS):
        fitted = made.fit
        new = fit_levels(record, made.dynamics, fitted.innovations, fitted.filter, fitted.filter.levels)
        if new.log_likelihood - _prior(fitted) < made.log_likelihood + ROUND_GAIN:
            break
        better = _model(record, fit(Problem(record, new), fitted.causes, fitted.delta))
        if not better.log_likelihood > made.log_likelihood:
            break
        made = better
    if not math.isfinite(made.log_likelihood):
        return made
    return replace(made, log_likelihood=max(made.log_likelihood, nothing_foreseen(record)))


def _prior(fitted: Fit) -> float:
    """The cost [nats] of the tolerance's prior in the log-likelihood."""
    return 0.5 * float(np.sum((fitted.delta / Problem(fitted.record, fitted.filter).prior)**2))


def _model(record: Record, fitted: Fit) -> Model:
    """A fit with its log-likelihood under its own filter."""
    log_likelihood = -fitted.cost - _constant(fitted.filter, np.isfinite(fitted.innovations))
    return Model(fitted, log_likelihood, dynamics(record, fitted.point))


def _constant(filt: Filter, measured: np.ndarray) -> float:
    """1/2 (log det + count log 2 pi) of the whitening."""
    diagonal = np.einsum("kaa->ka", filt.low)
    if not np.all(diagonal[measured] > 0.0):
        return math.inf  # a model that did not stay with the log has no filter
    return float(np.sum(np.log(diagonal[measured])) + 0.5 * math.log(2.0 * math.pi) * measured.sum())


def as_simulated(record: Record) -> Model:
    """The nominal with its noise levels fitted from two starts: the declared, and what the innovations look like, which
    must do clearly better."""
    levels = declared(record)
    start = first_filter(record, levels)
    models = [profile(record, (), np.zeros(DEVIATIONS), start)]
    e = innovations(record, start, Point())[0]
    seen = levels.copy()
    for k in range(3):
        if np.isfinite(e[:, k]).any():
            ratio = float(np.nanmedian(np.abs(start.whiten(e)[:, k])) / MEDIAN)
            seen[k] *= ratio
    seen[3:5] *= UNSEEN
    low, high = bounds(record)
    seen = levels * np.clip(seen / levels, low, high)
    models.append(profile(record, (), np.zeros(DEVIATIONS), first_filter(record, seen)))
    return models[1] if models[1].log_likelihood > models[0].log_likelihood + TOLD_APART else models[0]
