"""Pool what several flights tell of two numbers of one vehicle, a6 and k1.

Each flight has its own weather, offsets and start; what it tells of the two numbers is an estimate x_i with covariance
C_i.  If the vehicle is one, the best joint estimate weights each by its information, and

    Q = sum (x_i - x)' C_i^-1 (x_i - x)

is chi square of 2 (n - 1) (Cochran, Biometrics 10, 1954).  Each flight against the others' joint estimate tells which
one differs, and in what.  The scatter sigma of one number between flights is that at which its own Q is n - 1 (Paule
and Mandel, J. Res. NBS 87, 1982), and its interval ends where Q meets the quantiles of chi square (Viechtbauer,
Statist. Med. 26, 2007).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from ..chi_square import quantile, tail

OTHER_VEHICLE = 0.01   # probability of so much scatter of one vehicle's flights, below which one of them is another's
INTERVAL = 0.95
PARAMETERS = ("a6", "k1")


@dataclass(frozen=True, eq=False)
class Told:
    """What one flight tells of a6 and k1: value (2,), covariance (2, 2); in the unit of the pooled answer."""

    log: str
    value: np.ndarray
    covariance: np.ndarray


class Scatter(NamedTuple):
    """Scatter of one number between flights, one sigma, with its 95 % interval."""

    sigma: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Joint:
    """The joint answer of several flights.

    value (2,), covariance (2, 2)  of a6 and k1, of the flights that are of one vehicle
    p        probability that flights of one vehicle scatter as much, all of them together
    each     of each flight against the others' joint answer
    others   places of flights that are of another vehicle, with the number in which each differs most
    scatter  of a6 and of k1 between all flights
    """

    value: np.ndarray
    covariance: np.ndarray
    p: float
    each: tuple[float, ...]
    others: dict[int, str]
    scatter: tuple[Scatter, Scatter]

    @property
    def is_of_two(self) -> bool:
        """Whether it is of two vehicles, of which nobody can tell which one is meant: two flights that disagree."""
        return len(self.each) - len(self.others) == 2 and self.p < OTHER_VEHICLE and not self.others

    @property
    def std(self) -> np.ndarray:
        """Standard deviations (2,) of a6 and k1."""
        return np.sqrt(np.diag(self.covariance))


def mean(told: Sequence[Told]) -> tuple[np.ndarray, np.ndarray]:
    """Return (value (2,), covariance (2, 2)) weighted by information."""
    weights = [np.linalg.inv(each.covariance) for each in told]
    covariance = np.linalg.inv(np.sum(weights, axis=0))
    return covariance @ np.sum([w @ each.value for w, each in zip(weights, told, strict=True)], axis=0), covariance


def pooled(told: Sequence[Told]) -> Joint:
    """Return the joint answer of at least two flights; those that are of another vehicle are left out one by one, as
    long as two remain, that one first without which the others agree best."""
    kept, others = list(range(len(told))), dict[int, str]()
    p, each = _probabilities(told)
    while len(kept) > 2 and tail(_disagreement([told[k] for k in kept]), 2 * (len(kept) - 1)) < OTHER_VEHICLE:
        out = min(kept, key=lambda k: _disagreement([told[j] for j in kept if j != k]))
        kept.remove(out)
        value, covariance = mean([told[k] for k in kept])
        off = np.abs(told[out].value - value) / np.sqrt(np.diag(told[out].covariance + covariance))
        others[out] = PARAMETERS[int(np.argmax(off))]
    value, covariance = mean([told[k] for k in kept])
    scatters = [scatter(np.array([x.value[j] for x in told]), np.array([math.sqrt(x.covariance[j, j]) for x in told]))
                for j in range(2)]
    return Joint(value, covariance, p, tuple(each), others, (scatters[0], scatters[1]))


def _disagreement(told: Sequence[Told]) -> float:
    """Return Q of flights."""
    value, _ = mean(told)
    return sum(_square(each.value - value, each.covariance) for each in told)


def _probabilities(told: Sequence[Told]) -> tuple[float, list[float]]:
    """Return (probability that flights of one vehicle scatter as much, that of each against the others)."""
    against = []
    for k, each in enumerate(told):
        rest, covariance = mean([x for j, x in enumerate(told) if j != k])
        against.append(tail(_square(each.value - rest, each.covariance + covariance), 2))
    return tail(_disagreement(told), 2 * (len(told) - 1)), against


def _square(off: np.ndarray, covariance: np.ndarray) -> float:
    return float(off @ np.linalg.solve(covariance, off))


def scatter(value: np.ndarray, std: np.ndarray) -> Scatter:
    """Return the scatter of estimates, value (n,), beyond their standard deviations std (n,), with its interval."""
    n = len(value)

    def beyond(sigma: float) -> float:
        w = 1.0 / (std**2 + sigma**2)
        return float(np.sum(w * (value - np.sum(w * value) / np.sum(w))**2))

    def at(target: float) -> float:
        if not beyond(0.0) > target:
            return 0.0
        low, high = 0.0, math.sqrt(float(np.sum((value - np.mean(value))**2)) / target)
        for _ in range(100):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if beyond(middle) > target else (low, middle)
        return high

    ends = [at(quantile(q, n - 1)) for q in (0.5 + 0.5 * INTERVAL, 0.5 - 0.5 * INTERVAL)]
    return Scatter(at(n - 1.0), *ends)


def sigmas(p: float) -> float:
    """Return how many standard deviations of a normal law a two-sided probability is."""
    return NormalDist().inv_cdf(1.0 - 0.5 * max(p, 1e-15))
