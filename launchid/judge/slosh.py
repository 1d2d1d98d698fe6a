"""Ask a contradicted log for a slosh that its nominal does not declare.

A slosh of a few per cent moves a6 and k1 by several deviations for half a minute before the whiteness of the
innovations contradicts the model, since it swings slowly.  What contradicts may be something else, of a moment.  So the
filter is run again with a slosh whose coupling is not known, at each of the frequencies that a tank may have, so near
each other that the problem is linear: where one has a size beyond doubt and nothing contradicts the model any more, it
was there all the time.

In declared wind it is not asked: there wind takes the slosh, and makes room for it.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from launchid_core import Config, Estimate, EstimateStatus, Estimator, Mode, Model, Oscillator

from ..log.check import CheckedLog
from .line import Line
from .table import TESTS

LOWEST, HIGHEST = 1.5, 9.5   # rad/s; above them a line is seen
APART = 1.04                 # of one frequency over the last
FREQUENCY_SIGMA = 0.02       # of each: half of that, so little that the problem stays linear
COUPLING = 0.05              # its sigma is as large
DAMPING = 0.02               # ratio, of a baffled tank
FEWEST = 2                   # contradicted windows, without which nothing is asked


def undeclared_slosh(seen: CheckedLog, config: Config, estimates: Sequence[Estimate]) -> Line | None:
    """Return the slosh with which nothing contradicts a log whose nominal has none; None without one, in declared wind,
    and of a log that is not contradicted.

    config     of the filtered formulation with the nominal's model;  estimates  of the windows, with it
    """
    model = config.model
    contradicted = sum(e.status == EstimateStatus.MODEL for e in estimates)
    if model is None or contradicted < FEWEST:
        return None
    if model.walk + model.turbulence + model.wind_initial > 0.0 or any(each.kind == "slosh" for each in model.modes):
        return None
    rows, count = seen.estimated.rows(), 1 + math.floor(math.log(HIGHEST / LOWEST) / math.log(APART))
    told = [_mode_of(replace(config, model=with_slosh(model, LOWEST * APART**k)), rows) for k in range(count)]
    found = [Line(mode.frequency, mode.size / mode.size_std, "slosh") for mode in told
             if mode is not None and mode.size > TESTS["no undeclared slosh"].limit * mode.size_std]
    return max(found, key=lambda each: each.ratio, default=None)


def _mode_of(config: Config, rows: np.ndarray) -> Mode | None:
    """Return the first mode of the model as it is at the end of samples (n, 7); None where they contradict the model,
    from when on no more are taken."""
    estimator, last = Estimator(config), None
    for k in range(0, len(rows), config.rows):
        for e in estimator.replay(rows[k:k + config.rows]):
            if e.status == EstimateStatus.MODEL:
                return None
            last = e.modes[0]
    return last


def with_slosh(model: Model, frequency: float) -> Model:
    """Return a model with one slosh more, near `frequency` [rad/s], of a coupling that is not known."""
    slosh = Oscillator(kind="slosh", t=(0.0,), frequency=(frequency,), size=(COUPLING,), damping_ratio=(DAMPING,),
                       frequency_sigma=FREQUENCY_SIGMA, size_sigma=1.0)
    return replace(model, modes=(slosh, *model.modes))
