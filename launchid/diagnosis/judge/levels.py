"""The noise levels of a log over the declared ones."""

import math
from typing import Any

import numpy as np

from ..data.record import CHANNELS
from ..data.world import WEATHER
from ..model.level_fit import LEVEL_STEP
from ..model.noise import LEVELS, Refilter, declared
from ..search.profile import Model
from .measure import NOISE
from .named import SIGNIFICANT


def noise_of(model: Model) -> dict[str, dict[str, Any]]:
    """Each level over the declared, whether it differs beyond doubt, and whether it is beyond NOISE times the declared
    beyond doubt (by likelihood ratio: where the weather hides a level, one factor is as good as another)."""
    r, fitted = model.fit.record, model.fit
    base, refilter = declared(r), Refilter(r, model.dynamics, fitted.innovations, fitted.filter)
    found: dict[str, dict[str, Any]] = {}
    for k, name in enumerate((*LEVELS, *(each.name if each.span == WEATHER else "" for each in r.world.levels))):
        if not name:
            continue  # declared by nobody
        if (name in CHANNELS and name not in r.channels) or (name == "command" and not r.command_is_known):
            continue
        moved = np.tile(fitted.filter.levels, (4, 1))
        moved[:3, k] *= np.exp(np.array([-1.0, 0.0, 1.0]) * LEVEL_STEP)
        moved[3, k] = NOISE * base[k]
        below, own, above, at_limit = refilter.log_likelihoods(moved)
        curvature = (2.0 * own - below - above) / LEVEL_STEP**2
        std = 1.0 / math.sqrt(curvature) if curvature > 0.0 else math.inf
        factor = float(fitted.filter.levels[k] / base[k])
        if not (math.isfinite(factor) and factor > 0.0):
            continue  # the model does not stay with the log, so its noise is unknown
        found[name] = {"factor": factor, "std": std * factor if math.isfinite(std) else None,
                       "significant": bool(abs(math.log(factor)) > SIGNIFICANT * std),
                       "beyond": bool(factor > NOISE and own - at_limit > 0.5 * SIGNIFICANT**2)}
    return found
