"""Figures of how well a simulated series meets a measured one.

References
----------
H. Theil, Applied Economic Forecasting, North-Holland, 1966, ch. 2: the inequality coefficient, and the three shares of
the mean squared error.  R. V. Jategaonkar, Flight Vehicle System Identification, AIAA, 2006, ch. 11: their use on
flight data; a coefficient below 0.25 to 0.3 is commonly accepted there.  L. Ljung, System Identification Toolbox,
`compare`: the fit.
"""

import math
from typing import NamedTuple

import numpy as np

MIN_VALUES = 2  # values that have a mean and a spread


class Statistics(NamedTuple):
    """How well a simulated series y meets a measured one z; NaN where there is none.

    fit         [%] 100 (1 - |z - y| / |z - mean z|): 100 is exact, 0 no better than the mean
    rms         of z - y, in the channel's unit
    largest     of |z - y|, in the channel's unit
    tic         Theil's inequality coefficient, rms(z - y) / (rms z + rms y): 0 exact, 1 no relation
    bias        share of the mean square of z - y that is of the means: (mean z - mean y)^2
    variance    share that is of the spreads: (std z - std y)^2
    covariance  share that is left, 2 (1 - correlation) std z std y: what no shift or scale of y takes away
    """

    fit: float
    rms: float
    largest: float
    tic: float
    bias: float
    variance: float
    covariance: float


NO_STATISTICS = Statistics(*[math.nan] * len(Statistics._fields))


def statistics(measured: np.ndarray, simulated: np.ndarray) -> Statistics:
    """Return the statistics of two series (n,), of the values that both have.

    Examples
    --------
    >>> statistics(np.array([0.0, 1.0, 2.0]), np.array([1.0, 2.0, 3.0])).bias
    1.0
    """
    both = np.isfinite(measured) & np.isfinite(simulated)
    z, y = measured[both], simulated[both]
    if len(z) < MIN_VALUES:
        return NO_STATISTICS
    error = z - y
    square, spread = float(np.mean(error**2)), float(np.std(z))
    size = math.sqrt(float(np.mean(z**2))) + math.sqrt(float(np.mean(y**2)))
    bias, variance = float(np.mean(error))**2, (spread - float(np.std(y)))**2
    shares = [x / square if square > 0.0 else math.nan for x in (bias, variance, max(0.0, square - bias - variance))]
    return Statistics(100.0 * (1.0 - math.sqrt(square) / spread) if spread > 0.0 else math.nan, math.sqrt(square),
                      float(np.max(np.abs(error))), math.sqrt(square) / size if size > 0.0 else math.nan, *shares)
