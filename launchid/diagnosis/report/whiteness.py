"""The randomness of what is left: correlations and spectra of whitened innovations."""

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from ...sums import inner, square
from ..data.record import CHANNELS

LAGS = 25
BAND_99 = 2.576        # standard deviations that 99 % of a normal variable stay within
SEGMENT = 1024         # rows of a spectrum's segment at most
PARTS = 4              # segments' lengths that a log must hold
LINES_NAMED = 3        # the strongest
CHANCE = 0.01          # that white noise shows a line in a spectrum of one channel
AROUND = 10            # bins to either side of a line that are its surroundings: five times a Hann window's lobe


@dataclass(frozen=True, eq=False)
class Correlation:
    """Correlations of whitened innovations at positive lags: `values` (lags,) of `channel` with `with_channel`'s past.

    band  half-width that 99 % of a white sequence's correlations stay within
    """

    channel: str
    with_channel: str
    values: np.ndarray
    band: float


def correlations(whitened: np.ndarray, lags: int = LAGS) -> list[Correlation]:
    """Auto- and cross-correlations of every measured pair."""
    measured = [k for k in range(3) if np.any(whitened[:, k] != 0.0)]
    n = len(whitened)
    found = []
    for a in measured:
        for b in measured:
            x, y = whitened[:, a], whitened[:, b]
            scale = math.sqrt(square(x) * square(y)) or 1.0
            values = np.array([inner(x[lag:], y[:n - lag]) / scale for lag in range(1, lags + 1)])
            found.append(Correlation(CHANNELS[a], CHANNELS[b], values, BAND_99 / math.sqrt(n)))
    return found


def spectrum(x: np.ndarray, period: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Welch's spectrum of x (n,), 1 for white noise of variance 1: (frequency [Hz], density, degrees of freedom).

    Hann segments, half overlapped; their mean has 36 K^2/(19 K - 1) degrees of freedom for K of them (Percival and
    Walden, Spectral Analysis for Physical Applications, 1993, ch. 6.17).
    """
    rows = min(SEGMENT, max(len(x) // PARTS, 2))
    window = np.hanning(rows)
    starts = range(0, len(x) - rows + 1, max(1, rows // 2))
    parts = np.array([np.abs(np.fft.rfft(window * x[s:s + rows]))**2 for s in starts]) / np.sum(window**2)
    count = len(parts)
    return np.fft.rfftfreq(rows, period)[1:], np.mean(parts, axis=0)[1:], 36.0 * count**2 / (19.0 * count - 1.0)


def chance_level(bins: int, freedom: float) -> float:
    """Density that white noise passes anywhere in so many bins with probability CHANCE (Wilson and Hilferty 1931)."""
    z = NormalDist().inv_cdf(1.0 - CHANCE / bins)
    spread = 2.0 / (9.0 * freedom)
    return (1.0 - spread + z * math.sqrt(spread))**3


def strongest(frequency: np.ndarray, density: np.ndarray, level: float) -> list[tuple[float, float]]:
    """(frequency [Hz], density) of the strongest lines: tops that pass the level as many times as their surroundings
    pass white noise; between bins by a parabola through the logarithms."""
    found, logarithm = [], np.log(np.maximum(density, 1e-12))
    for k in range(1, len(density) - 1):
        around = float(np.median(density[max(0, k - AROUND):k + AROUND + 1]))
        a, b, c = logarithm[k - 1:k + 2]
        if a < b >= c and density[k] > level * max(1.0, around):
            between = 0.5 * (a - c) / (a - 2.0 * b + c)
            found.append((float(frequency[k] + between * (frequency[1] - frequency[0])), float(density[k])))
    return sorted(found, key=lambda line: -line[1])[:LINES_NAMED]
