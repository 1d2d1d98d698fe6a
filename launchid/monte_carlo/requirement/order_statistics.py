"""A planned number of flights: how many failures may be among them (order statistics, the exact binomial).

Of n independent flights that fail with probability p the number of failures is binomial.  k failures of n prove that
the probability is below p with confidence C if k or fewer would come with a probability of at most 1 - C if it were p.
Then, too, the (k + 1)-th largest of n values is above their quantile of order 1 - p with confidence C (Wilks, Annals of
Mathematical Statistics 12, 1941; Hanson & Beard, NASA/TP-2010-216447: 99.865 % with confidence 90 % takes 1,705 flights
without a failure, 2,880 with one).  The bounds are those of Clopper & Pearson, Biometrika 26, 1934, one-sided.

It holds for a number of flights that was fixed before the first; who looks and stops wants `sequential`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


def cumulative(most: int, flights: int, probability: float) -> np.ndarray:
    """(most + 1,) probability of at most 0, 1, ... `most` failures among n flights that fail with this probability."""
    j = np.arange(1, most + 1)
    ratios = np.log((flights - j + 1) / j) + (math.log(probability) - math.log1p(-probability))
    first = flights * math.log1p(-probability)
    return np.cumsum(np.exp(np.concatenate([[first], first + np.cumsum(ratios)])))


def wilks_rank(n: int, share: float, confidence: float) -> int:
    """Largest r such that the r-th largest of n holds `share` with `confidence`; 0: too few."""
    return 0 if n == 0 else int(np.sum(cumulative(n - 1, n, 1.0 - share) <= 1.0 - confidence))


@dataclass(frozen=True)
class Planned:
    """n flights, all flown, then judged: do they prove a probability of failure below `probability`, or above it."""

    probability: float
    confidence: float

    def allowed(self, n: int) -> int:
        """The most failures of n that prove it is below; -1: n are too few."""
        return wilks_rank(n, 1.0 - self.probability, self.confidence) - 1

    def is_met(self, n: int, failures: int) -> bool:
        return failures <= self.allowed(n)

    def is_refuted(self, n: int, failures: int) -> bool:
        """Do they prove that it is above."""
        return failures > 0 and self._at_least(n, failures, self.probability) <= 1.0 - self.confidence

    def flights_needed(self, failures: int) -> int:
        """The smallest n of which so many failures are allowed."""
        high = failures + 1
        while not self._proves(high, failures, self.probability):
            high *= 2
        low = failures
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if self._proves(middle, failures, self.probability) else (middle, high)
        return high

    def bounds(self, n: int, failures: int) -> tuple[float, float]:
        """The probability of failure is above the first, and below the second, each with the confidence."""
        upper = 1.0 if failures == n else halved(
            failures / n, 1.0, lambda p: self._proves(n, failures, p))
        lower = 0.0 if failures == 0 else halved(
            failures / n, 0.0, lambda p: self._at_least(n, failures, p) <= 1.0 - self.confidence)
        return lower, upper

    def _proves(self, n: int, failures: int, probability: float) -> bool:
        return failures < n and float(cumulative(failures, n, probability)[-1]) <= 1.0 - self.confidence

    @staticmethod
    def _at_least(n: int, failures: int, probability: float) -> float:
        """Probability of so many failures or more: of as few successes."""
        return float(cumulative(n - failures, n, 1.0 - probability)[-1])


def halved(inside: float, outside: float, holds: Callable[[float], bool]) -> float:
    """The place where `holds`, false at `inside`, becomes true for good on the way to `outside`, which is never
    evaluated."""
    for _ in range(60):  # to the last bits of a double
        middle = 0.5 * (inside + outside)
        inside, outside = (inside, middle) if holds(middle) else (middle, outside)
    return outside
