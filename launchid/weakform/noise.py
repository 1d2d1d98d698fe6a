"""Tell a column's own noise: by its differences, and of the nozzle by what follows nothing else that is logged."""

import math
from dataclasses import replace

import numpy as np

from ..series import of_differences, white_variance
from ..sums import DEPENDENT, combined, least_squares
from .rows import BRIEF, Rows, fast_part

ROUGH_ORDERS = (3, 8)  # of the differences of beta that tell its noise, which both show alike, from motion
ROUGH_ROWS = 10_000  # to either side of the log's middle, of which its roughness is asked
ROUGH_LAGS = 4       # rows, this one among them, by which beta may follow what else is logged


def nozzle_noise(rows: Rows, others: list[np.ndarray]) -> tuple[float, float]:
    """Return (the variance of the white noise of beta's sensor, its uncertainty) [rad^2].

    others   columns (n,) that beta may answer: what they explain of it within ROUGH_LAGS rows acts, and is no noise

    Differences of white noise show the same variance at any order, those of motion less at a higher one. What may be
    either, which is all of it where rows are slower than the nozzle, counts by half.
    """
    if rows.is_held:
        return 0.0, 0.0
    middle = slice(max(len(rows.t) // 2 - ROUGH_ROWS, 0), len(rows.t) // 2 + ROUGH_ROWS)
    low, high = (roughness(rows.beta[middle], [x[middle] for x in others], order) for order in ROUGH_ORDERS)
    high = min(low, high)
    sure = max(2.0 * high - low, 0.0) if rows.period < 1.1 * BRIEF else 0.0
    return 0.5 * (high + sure), 0.5 * (high - sure)


def roughness(x: np.ndarray, others: list[np.ndarray], order: int) -> float:
    """Return the variance of white noise in x (n,) by its differences of `order`, less what others (n,) explain."""
    rest, *around = (np.diff(each, order) for each in (x, *others))
    if len(rest) < 2 * ROUGH_LAGS * (len(around) + 1):
        return 0.0
    lags = np.column_stack([each[ROUGH_LAGS - 1 - k:len(each) - k] for each in around for k in range(ROUGH_LAGS)])
    rest = rest[ROUGH_LAGS - 1:]
    size = np.sqrt(np.maximum(np.einsum("nk,nk->k", lags, lags), 1e-300))
    rest = rest - combined(lags, least_squares(lags / size, rest, DEPENDENT) / size)
    return of_differences(rest, order, typical=True)


def with_noise_levels(rows: Rows) -> Rows:
    """Return the rows with the noise variances of theta and theta_dot as their differences show them, that of a slope
    by theta's, and with theta's fast part."""
    noise = noise_variance(rows.theta)
    return replace(rows, theta_noise=noise, fast=fast_part(rows.t, rows.theta),
                   rate_noise=noise_variance(rows.theta_dot) if rows.has_rate else 0.5 * noise / rows.reach**2)


def noise_variance(x: np.ndarray) -> float:
    """Return the variance of the noise on a smooth column x (n,): the white noise that it shows, or that of its
    smallest step."""
    quantum = np.diff(np.unique(x[np.isfinite(x)]))
    floor = float(np.min(quantum[quantum > 0.0], initial=math.inf)) if len(quantum) else math.inf
    floor = floor * floor / 12.0 if math.isfinite(floor) else 0.0
    return max(white_variance(x, typical=True), floor, 1e-20)
