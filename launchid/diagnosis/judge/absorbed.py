"""The part of an effect's gain that is left where nobody models it and the wind's levels change for it.

A model without the effect is not bound to the levels of a clean log: it takes a slow misfit for more wind.  With other
levels the effect's response c weighs less, |c|^2_k instead of |c|^2, and the log without the effect has become less
likely, by d_k [nats].  The best that a model without can do is the least of these, so a cause gains

    min_k ( |c|^2_k / 2 + d_k ),    k = 0: the levels as they are, d_0 = 0

where |c|^2/2 would be expected with levels that are known.  Of an effect that multiplies the wind itself (of a6) the
response is a part of the noise, and what is left of its gain is less than this by up to a half.
"""

import itertools
import math

import numpy as np

from ...sums import square
from ..model.level_fit import PRIOR
from ..model.noise import Refilter, bounds, declared
from ..model.weighing import Weighing
from ..search.profile import Model

FACTORS = (0.7, 1.0, 1.4, 2.0)  # of each level, within its bounds: a source that takes more leaves the other less


class Absorbing:
    """The wind's levels other than a model's, and what they cost."""

    def __init__(self, model: Model) -> None:
        record, fitted = model.fit.record, model.fit
        self.record, self.low = record, fitted.filter.low
        levels, (least, most) = fitted.filter.levels, bounds(record)
        free = [k for k in range(5, len(levels)) if most[k] > least[k]]
        self.levels = np.zeros((0, len(levels)))
        self.costs = np.zeros(0)
        if not free:
            return
        own = declared(record)
        tries = []
        for factors in itertools.product(FACTORS, repeat=len(free)):
            moved = levels.copy()
            moved[free] = np.clip(levels[free] * np.array(factors), own[free] * least[free], own[free] * most[free])
            if not np.array_equal(moved, levels):
                tries.append(moved)
        self.levels = np.array(tries)

        def unlikely(x: np.ndarray) -> np.ndarray:
            return 0.5 * np.sum((np.log(x[..., free] / own[free]) / PRIOR)**2, axis=-1)

        refilter = Refilter(record, model.dynamics, fitted.innovations, fitted.filter)
        likely = refilter.log_likelihoods(np.concatenate([levels[None], self.levels]))
        likely -= unlikely(np.concatenate([levels[None], self.levels]))
        self.costs = np.maximum(likely[0] - likely[1:], 0.0)
        self.weighing = Weighing(refilter, self.levels)

    def _energies(self, change: np.ndarray) -> np.ndarray:
        """(k,) |c|^2 under these levels, of a change (3n + 5,) of the residual."""
        if not len(self.levels):
            return self.costs
        white = change[:3 * self.record.rows].reshape(-1, 3)
        e = np.einsum("kab,kb->ka", self.low, white)
        return self.weighing.energies(np.where(np.isfinite(self.record.z), e, math.nan))

    def gain(self, change: np.ndarray) -> float:
        """The gain [nats] to be expected of a cause with this change (3n + 5,) of the residual."""
        own = 0.5 * square(change)
        return float(min([own, *(0.5 * self._energies(change) + self.costs)]))

    def multiple(self, change: np.ndarray, needed: float) -> float | None:
        """Smallest multiple of a change that gains so much [nats]; None where none does."""
        energies = np.append(self._energies(change), square(change))
        missing = np.maximum(needed - np.append(self.costs, 0.0), 0.0)
        if np.any((energies <= 0.0) & (missing > 0.0)):
            return None
        return float(np.sqrt(np.max(2.0 * missing / np.maximum(energies, 1e-300))))
