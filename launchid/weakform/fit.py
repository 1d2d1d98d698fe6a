"""Generalised least squares in the weak form: coefficients, their covariance, and the noise by its likelihood.

The variance of a mode is s = q + r lambda + a/lambda: an accumulated white disturbance, white noise of the gyro, and a
disturbance that wanders; of a rate that is made of theta r lambda^2. Their two ratios are those of the largest
restricted likelihood (Patterson and Thompson 1971), the scale follows. With r = 0 this is least squares on differences
of theta_dot (`difference`), with q = 0 on theta_dot itself (`integral`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..sums import combined, products, square
from .rows import Modes

BINS = 120            # of neighbouring modes that share a weight while the noise is sought
SPAN = np.arange(-6.0, 6.01, 0.5)    # decades of the ratios of the noises
RANK = 1.0e-11        # of a column's square, that is left beside the others
BANDS = 12            # of the residual's spectrum
SIGNAL = 0.5          # of the columns' products, in every direction, that must be left without the sensors' noise
UNTOLD = 20.0         # modes, by which the rest's spectrum is drawn to the noise's
UNEVEN = 0.01         # p-value below which the rest's own spectrum is its noise
FEWEST_IN_BAND = 4    # modes


Prior = Sequence[tuple[int, float, float]]


class Noise(NamedTuple):
    """What a regression says of the ratios of the sensor's and of the wandering noise to the accumulated one.

    restricted (SPAN, SPAN)  logarithm of the restricted likelihood, less its maximum;  scale (SPAN, SPAN)  the variance
    of the accumulated noise;  largest (SPAN, SPAN)  logarithm of the largest likelihood over the coefficients, by which
    columns are compared
    """

    restricted: np.ndarray
    scale: np.ndarray
    largest: np.ndarray


@dataclass(frozen=True, eq=False)
class Fit:
    """Coefficients xi (q,) and covariance (q, q) of a regression, and how its residual is spread.

    variance (n,) of each mode;  whitened (n,) residuals over their standard deviations;  leverage (n,) share of each
    mode in the coefficients, q in sum;  left  modes beyond the coefficients;  is_singular  columns cannot be told apart
    """

    xi: np.ndarray
    covariance: np.ndarray
    variance: np.ndarray
    whitened: np.ndarray
    leverage: np.ndarray
    left: int
    is_singular: bool = False


def gls(m: Modes, likelihood: np.ndarray | None = None, prior: Prior = (), own: Noise | None = None) -> Fit:
    """Return the fit of a regression.

    likelihood (SPAN, SPAN)  of the noise's ratios; None: the regression's own
    own     the regression's own noise, where it is known
    prior   (column, value, standard deviation) of coefficients that are known from elsewhere

    Where the rest is not as white as the two ratios make it, its own spectrum in bands is the noise.
    """
    n, q = len(m.y), m.phi.shape[1] + m.ends.shape[1]
    if not np.any(m.y):   # at rest
        k = m.phi.shape[1]
        return Fit(np.full(k, math.nan), np.full((k, k), math.nan), np.ones(n), m.y, m.y, n - q, True)
    own = own or noise_likelihood(m)
    s, accumulated = mixed(m, own.restricted if likelihood is None else likelihood, own.scale)
    disturbed = float(np.sum(accumulated / s))
    for step in range(3):   # the scale; what the quadrature of these coefficients may be off; the rest's own spectrum
        xi, covariance = solved(m, s, prior if step else (), disturbed)
        if covariance is None:
            nothing = np.full(n, math.nan)
            return Fit(xi, np.full((len(xi), len(xi)), math.nan), s, nothing, nothing, n - q, True)
        e = apart(m, s, m.y - combined(m.phi, xi))
        if step == 0:
            s = s * max(square(e / np.sqrt(s)) / max(n - q, 1), 1e-300) + quadrature(m, xi)
        else:
            w = apart(m, s, m.phi) / np.sqrt(s)[:, None]
            fit = Fit(xi, covariance, s, e / np.sqrt(s), np.einsum("nk,kl,nl->n", w, covariance, w), n - q)
            frequency, squares, many, _ = spectrum(fit, m, BANDS)
            p = whiteness(squares, many)
            if p is None or p > UNEVEN or step == 2:
                return fit
            told = (many * squares + UNTOLD) / (many + UNTOLD)   # few modes tell little of their own
            s = s * np.exp(np.interp(np.log(m.frequency), np.log(frequency), np.log(told)))
    raise AssertionError("unreachable")


def apart(m: Modes, s: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return x (n,) or (n, q) without what the ends of the stretches may be in it, under variances s (n,)."""
    if not m.ends.shape[1]:
        return x
    w = 1.0 / np.sqrt(s)[:, None]
    weighted = x[:, None] * w if x.ndim == 1 else x * w
    told = np.column_stack([least(m.ends * w, each) for each in weighted.T]) if weighted.shape[1] else \
        np.zeros((m.ends.shape[1], 0))
    return x - np.reshape(np.stack([combined(m.ends, each) for each in told.T], axis=-1), x.shape) if told.size else x


def solved(m: Modes, s: np.ndarray, prior: Prior = (), disturbed: float = 0.0) -> tuple[np.ndarray, np.ndarray | None]:
    """Return (coefficients, covariance) under variances s (n,), the latter None where columns cannot be told apart.

    What the sensors' noise adds to the columns' products is taken off them (errors in variables: bias-compensated least
    squares), and from those with the slope of theta what its own noise adds; so is, of a rate, what disturbs it during
    the row itself: `disturbed` modes of their noise are disturbances.
    """
    w = apart(m, s, m.phi) / np.sqrt(s)[:, None]
    gram, right = products(w, w), products(w, (m.y / np.sqrt(s))[:, None])[:, 0]
    passed = m.step**2 * (1.0 - 0.25 * m.curl) * (1.0 + m.curl / 12.0) ** 2 / s   # of Gregory's rule
    inner = gram - m.sensor * float(np.sum(passed))
    right = right - m.ahead * disturbed
    if not m.has_rate:
        right = right + m.motion * float(np.sum(m.curl * (1.0 - 0.25 * m.curl) / s))
    for k, value, std in prior:
        add = np.zeros_like(gram)
        add[k, k] = 1.0 / std**2
        gram, inner = gram + add, inner + add
        right[k] += value / std**2
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    scaled, whole = inner / np.outer(size, size), gram / np.outer(size, size)
    try:
        inverse, half = np.linalg.inv(scaled), np.linalg.inv(np.linalg.cholesky(whole))
    except np.linalg.LinAlgError:
        return np.full(len(right), math.nan), None
    if np.linalg.eigvalsh(half @ scaled @ half.T)[0] < SIGNAL:
        return np.full(len(right), math.nan), None
    if not np.all(np.isfinite(inverse)) or np.max(np.diag(inverse)) > 1.0 / RANK:
        return np.full(len(right), math.nan), None
    spread = inverse @ whole @ inverse
    return inverse @ (right / size) / size, spread / np.outer(size, size)


def least(phi: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the coefficients (q,) of least squares of y (n,) on phi (n, q)."""
    size = np.sqrt(np.maximum(np.sum(phi**2, axis=0), 1e-300))
    scaled = phi / size
    gram, right = products(scaled, scaled), products(scaled, y[:, None])[:, 0]
    return np.asarray(np.linalg.lstsq(gram, right, rcond=RANK)[0] / size)


def rest(phi: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return what columns phi (n, q) leave of y (n,) by least squares."""
    return y - combined(phi, least(phi, y)) if phi.shape[1] else y


def quadrature(m: Modes, xi: np.ndarray) -> np.ndarray:
    """Return the square (n,) of what the integrals may be off: a fourth of what Gregory's rule adds to the trapezium,
    taken over neighbouring modes."""
    off = 0.25 * combined(m.doubt, xi)
    reach = 4
    sums = np.concatenate([np.zeros(reach + 1), np.cumsum(off**2), np.full(reach, np.sum(off**2))])
    sums[:reach + 1] = 0.0
    many = 2 * reach + 1
    return np.asarray((sums[many:] - sums[:-many]) / many) if len(off) > many else np.full(len(off), np.mean(off**2))


def mixed(m: Modes, likelihood: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the variance (n,) of each mode, its mean over the ratios by their likelihood (SPAN, SPAN), and of it what
    is accumulated.

    Of an accumulated noise that a window hardly shows the most likely level is zero, and the mean is not.
    """
    weight = np.exp(likelihood - np.max(likelihood))
    weight = weight / np.sum(weight) * scale
    ratio = 10.0**SPAN
    levels = (np.sum(weight), np.sum(ratio[:, None] * weight), np.sum(ratio * weight))
    parts = [level * shape for level, shape in zip(levels, parts_of_noise(m), strict=True)]
    return np.asarray(sum(parts)), parts[0]


def parts_of_noise(m: Modes) -> np.ndarray:
    """Return the shapes (3, n) of the noise: accumulated, of the sensor, wandering."""
    sensor = m.curl if m.has_rate else m.curl**2
    return np.stack([np.ones(len(m.curl)), sensor, 1.0 / m.curl]) * (m.step / np.median(m.step))


def noise_likelihood(m: Modes) -> Noise:
    """Return the likelihood of the noise's ratios, each mode being one of BINS, which share a weight."""
    shapes = parts_of_noise(m)
    order = np.argsort(m.curl, kind="stable")
    edges = np.unique(np.round(np.concatenate([[0.0], np.geomspace(1.0, len(m.y), min(BINS, len(m.y)))])).astype(int))
    phi = np.column_stack([m.phi, m.ends])
    columns = np.sqrt(np.sum(phi**2, axis=0))
    columns = np.where(columns > 0.0, columns, 1.0)
    table = np.column_stack([phi / columns, m.y])[order]
    bins = np.repeat(np.arange(len(edges) - 1), np.diff(edges))
    many = np.bincount(bins).astype(float)
    grams = np.add.reduceat(table[:, :, None] * table[:, None, :], edges[:-1], axis=0)
    means = np.array([np.bincount(bins, shape[order]) / many for shape in shapes])
    sensor, slow = (each.ravel() for each in np.meshgrid(SPAN, SPAN, indexing="ij"))
    s = means[0] + 10.0**sensor[:, None] * means[1] + 10.0**slow[:, None] * means[2]
    gram = np.reshape(products((1.0 / s).T, np.reshape(grams, (len(many), -1))), (len(s), *grams.shape[1:]))
    inner, right, yy = gram[:, :-1, :-1], gram[:, :-1, -1], gram[:, -1, -1]
    size = np.sqrt(np.maximum(np.einsum("gii->gi", inner), 1e-300))
    scaled = inner / size[:, :, None] / size[:, None, :] + 1e-13 * np.eye(inner.shape[1])
    xi = np.linalg.solve(scaled, (right / size)[:, :, None])[:, :, 0]
    left = yy - np.einsum("gi,gi->g", xi, right / size)
    left = np.maximum(left, 1e-14 * yy + 1e-300)
    degrees = max(len(m.y) - phi.shape[1], 1)
    shapes_of = np.einsum("b,gb->g", many, np.log(s))
    largest = -0.5 * (len(m.y) * np.log(left) + shapes_of)
    value = -0.5 * (degrees * np.log(left) + shapes_of
                    + np.linalg.slogdet(scaled)[1] + 2.0 * np.sum(np.log(size), axis=1))
    grid = len(SPAN), len(SPAN)
    return Noise(*(np.reshape(each, grid) for each in (value - np.max(value), left / degrees, largest)))


def spectrum(fit: Fit, m: Modes, bands: int) -> tuple[np.ndarray, ...]:
    """Return (frequencies [rad/s], mean squares, modes, shares of the leverage) of the whitened residual in bands.

    Mean squares are 1 where the noise is as it was taken.
    """
    order = np.argsort(m.frequency, kind="stable")
    n = len(order)
    count = max(1, min(bands, n // FEWEST_IN_BAND))
    edges = np.unique(np.round(np.geomspace(FEWEST_IN_BAND, max(n, FEWEST_IN_BAND), count)).astype(int))
    rows = [order[a:b] for a, b in zip([0, *edges[:-1].tolist()], edges.tolist(), strict=True) if b > a]
    whole = max(float(np.sum(fit.leverage)), 1e-300)
    return (np.array([np.mean(m.frequency[each]) for each in rows]),
            np.array([np.mean(fit.whitened[each] ** 2) for each in rows]), np.array([len(each) for each in rows]),
            np.array([np.sum(fit.leverage[each]) / whole for each in rows]))


def whiteness(squares: np.ndarray, many: np.ndarray) -> float | None:
    """Return the p-value of mean squares in bands being 1; None of too few bands.

    2 ln Q of the likelihood ratio of one variance a band against 1 (Bartlett 1937), as chi square.
    """
    degrees = len(squares) - 1
    if degrees < 2:
        return None
    half = 0.5 * max(float(np.sum(many * (squares - 1.0 - np.log(np.maximum(squares, 1e-12))))), 0.0)
    if half > 700.0:
        return 0.0
    if degrees % 2 == 0:
        return math.exp(-half) * sum(half**k / math.factorial(k) for k in range(degrees // 2))
    return math.erfc(math.sqrt(half)) + math.exp(-half) * sum(
        half ** (k + 0.5) / math.gamma(k + 1.5) for k in range((degrees - 1) // 2))
