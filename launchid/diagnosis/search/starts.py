"""The filters under which a further cause is sought: it may have passed for noise, or for weather."""

import math

import numpy as np

from ..data.record import Record
from ..model.noise import WRONG_NOISE, Refilter, declared, run_filter
from ..model.nuisance import Problem
from .fit import fit
from .profile import Model

BLOWN_UP = 1.4        # times the declared: weather that may have taken in what a cause does
QUIETER = (1.0, 0.5, 0.25, 0.12, 0.06, 0.03, 0.015)  # factors of a weather's level
QUIET_SEGMENTS = 8
FARTHEST = 100.0      # times below the fitted levels, of another start: farther no filter stays with the log
UNSTEADY = 0.3        # of its level: weather with which half of the log does not do is none


def quiet(model: Model) -> float:
    """Factor of the level of the weather that is sought, 1 or below, that half of the log's segments do with; 1 where
    none is sought.  What sets in, or passes, makes the others' weather, and is no weather."""
    record, levels = model.fit.record, model.fit.filter.levels
    at = [5 + k for k, each in enumerate(record.world.levels) if each.is_sought]
    if not at:
        return 1.0
    refilter = Refilter(record, model.dynamics, model.fit.innovations, model.fit.filter)
    likely = []
    for factor in QUIETER:
        calmer = levels.copy()
        calmer[at] *= factor
        filt = refilter.filter(calmer)
        diagonal = np.einsum("kaa->ka", filt.low)
        row = np.sum(np.where(diagonal > 0.0, -np.log(np.maximum(diagonal, 1e-300)) - 0.5 * filt.whitened**2, 0.0), 1)
        likely.append([float(part.sum()) for part in np.array_split(row, QUIET_SEGMENTS)])
    return float(np.median([QUIETER[k] for k in np.argmax(np.array(likely), axis=0)]))


def starts(record: Record, base: Model) -> list[Model]:
    """The base under its fitted noise; and under the declared, where what is sought may have passed for noise or for
    the declared weather, or under the weather of the log's quieter half, where it may have passed for weather."""
    levels = np.maximum(declared(record), base.fit.filter.levels / FARTHEST)
    calmer, most = quiet(base), np.full(len(levels), WRONG_NOISE)
    for k, each in enumerate(record.world.levels, start=5):
        most[k] = BLOWN_UP
        if each.is_sought:
            levels[k], most[k] = base.fit.filter.levels[k] * calmer, math.inf
    if calmer > UNSTEADY and np.all(base.fit.filter.levels < most * levels):
        return [base]
    filt = run_filter(record, base.dynamics, levels, base.fit.innovations, base.fit.filter)
    fitted = fit(Problem(record, filt), base.causes, base.fit.delta, iterations=3)
    return [base, Model(fitted, base.log_likelihood, base.dynamics)]
