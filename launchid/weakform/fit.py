"""Fit the weak form by generalised least squares: coefficients, their covariance, and the noise by its likelihood.

The variance of a mode (one sine of the log, see `rows`) is s = q + r lambda + a/lambda: an accumulated white
disturbance, white noise of the gyro (r lambda^2 for a rate that is made of theta), and a disturbance that wanders. The
ratios r/q and a/q are those of the largest restricted likelihood (Patterson and Thompson 1971), the scale follows. With
r = 0 this is least squares on differences of theta_dot (`difference`), with q = 0 on theta_dot itself (`integral`).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..chi_square import tail
from ..sums import along, combined, products
from .modes import Modes

BINS = 120            # of neighbouring modes that share a weight while the noise is sought
SPAN = np.arange(-6.0, 6.01, 0.5)    # decades of the ratios of the noises
MIN_COLUMN_LEFT = 1.0e-11  # of a column's square, that is left beside the others
SPECTRUM_BANDS = 12   # of the residual's spectrum
SIGNAL = 0.5          # of the columns' products, in every direction, that must be left without the sensors' noise
SPECTRUM_PRIOR = 20.0  # modes, by which the rest's spectrum is drawn to the noise's
UNEVEN = 0.01         # p-value below which the rest's own spectrum is its noise
FEWEST_IN_BAND = 4    # modes
BATCH = 16            # regressions that are computed together: what is at work fits into a processor's cache


Prior = Sequence[tuple[int, float, float]]


class Noise(NamedTuple):
    """Likelihood of a regression's noise over the ratios of sensor's and of wandering to accumulated noise, 10**SPAN.

    restricted (SPAN, SPAN)  logarithm of the restricted likelihood, less its maximum;  scale (SPAN, SPAN)  variance of
    the accumulated noise;  largest (SPAN, SPAN)  logarithm of the likelihood at its best coefficients, by which columns
    are compared
    """

    restricted: np.ndarray
    scale: np.ndarray
    largest: np.ndarray


@dataclass(frozen=True, eq=False)
class Fit:
    """Coefficients xi (q,) and covariance (q, q) of a regression in n modes, and how its residual is spread.

    variance (n,) of each mode;  whitened (n,) residuals over their standard deviations;  leverage (n,) of each mode on
    xi, q in sum;  disturbed (n,) share of a mode's noise that is disturbance;  left  modes less coefficients
    is_singular  columns cannot be told apart, xi is NaN
    """

    xi: np.ndarray
    covariance: np.ndarray
    variance: np.ndarray
    whitened: np.ndarray
    leverage: np.ndarray
    disturbed: np.ndarray
    left: int
    is_singular: bool = False


def gls(m: Modes, likelihood: np.ndarray | None = None, prior: Prior = (), own: Noise | None = None) -> Fit:
    """Fit a regression by generalised least squares.

    likelihood (SPAN, SPAN)  logarithm of that of the noise's ratios; None: the regression's own
    own     the regression's own `Noise`, if that is computed already
    prior   (column, value, standard deviation) of coefficients that are known from elsewhere

    Where the residual is not as white as the two ratios make it, its own spectrum in bands is taken for the noise.
    """
    return gls_of_all([m], None if likelihood is None else [likelihood], None if own is None else [own], prior)[0]


def alike(regressions: Sequence[Modes]) -> list[list[int]]:
    """Return groups of indices of regressions with the same modes and number of columns, at most BATCH in a group."""
    groups = dict[tuple[int, ...], list[int]]()
    for k, m in enumerate(regressions):
        groups.setdefault((id(m.noises), m.phi.shape[1], m.ends.shape[1]), []).append(k)
    return [group[k:k + BATCH] for group in groups.values() for k in range(0, len(group), BATCH)]


def gls_of_all(regressions: Sequence[Modes], likelihoods: Sequence[np.ndarray] | None = None,
               owns: Sequence[Noise] | None = None, prior: Prior = ()) -> list[Fit]:
    """Fit many regressions, those with the same modes together; arguments as of `gls`, one for each regression."""
    owns = noise_likelihoods(regressions) if owns is None else owns
    likelihoods = [own.restricted for own in owns] if likelihoods is None else likelihoods
    fits = dict[int, Fit]()
    for group in alike(regressions):
        stack = Stack.of([regressions[k] for k in group])
        n, q = stack.phi.shape[2], stack.phi.shape[1] + stack.ends.shape[1]
        s, accumulated = mixed(stack, np.stack([likelihoods[k] for k in group]),
                               np.stack([owns[k].scale for k in group]))
        disturbed = accumulated / s
        fits |= {k: unknown(regressions[k], np.ones(n), y) for k, y in zip(group, stack.y, strict=True) if not y.any()}
        left = [j for j, k in enumerate(group) if k not in fits]   # the others are at rest
        for step in range(3):   # scale; what the quadrature of these coefficients may be off; the rest's own spectrum
            if not left:
                break
            at = stack.part(left)
            root = np.sqrt(s[left])
            w = apart(at, root, at.phi) / root[:, None]
            xi, covariance, is_told = solved(at, s[left], w, prior if step else (), np.sum(disturbed[left], axis=1))
            e = apart(at, root, (at.y - np.einsum("akn,ak->an", at.phi, xi))[:, None])[:, 0] / root
            leverage = np.einsum("akn,akn->an", np.einsum("akl,aln->akn", covariance, w), w)
            scale = np.maximum(np.einsum("an,an->a", e, e) / max(n - q, 1), 1e-300)
            doubt = quadrature(at, xi) if step == 0 else None
            going = list[int]()
            for i, j in enumerate(left):
                k = group[j]
                m = regressions[k]
                if not is_told[i]:
                    fits[k] = unknown(m, s[j].copy(), np.full(n, math.nan))
                    continue
                if doubt is not None:
                    s[j] = s[j] * scale[i] + doubt[i]
                    going.append(j)
                    continue
                fit = Fit(xi[i], covariance[i], s[j].copy(), e[i], leverage[i], disturbed[j], n - q)
                frequency, squares, many, _ = spectrum(fit, m, SPECTRUM_BANDS)
                p = whiteness(squares, many)
                if p is None or p > UNEVEN or step == 2:
                    fits[k] = fit
                    continue
                told = (many * squares + SPECTRUM_PRIOR) / (many + SPECTRUM_PRIOR)  # few modes tell little of their own
                s[j] = s[j] * np.exp(np.interp(np.log(m.frequency), np.log(frequency), np.log(told)))
                going.append(j)
            left = going
    return [fits[k] for k in range(len(regressions))]


def unknown(m: Modes, variance: np.ndarray, nothing: np.ndarray) -> Fit:
    """Return a Fit without coefficients, for columns that cannot be told apart; `nothing` (n,) for its residuals."""
    q = m.phi.shape[1]
    return Fit(np.full(q, math.nan), np.full((q, q), math.nan), variance, nothing, nothing, nothing,
               len(m.y) - q - m.ends.shape[1], True)


@dataclass(frozen=True, eq=False)
class Stack:
    """Regressions with the same modes: the arrays of `Modes` with the number a of the regression first, the modes last.

    y, step (a, n);  phi, doubt (a, q, n);  ends (a, k, n);  sensor, unsure (a, q, q);  motion, turned, ahead (a, q)
    first  one of the regressions, for what all have in common
    """

    y: np.ndarray
    step: np.ndarray
    phi: np.ndarray
    doubt: np.ndarray
    ends: np.ndarray
    sensor: np.ndarray
    unsure: np.ndarray
    motion: np.ndarray
    turned: np.ndarray
    ahead: np.ndarray
    first: Modes

    @staticmethod
    def of(regressions: Sequence[Modes]) -> "Stack":
        """Return the stack of regressions, which must have the same modes."""
        names = ("y", "step", "sensor", "unsure", "motion", "turned", "ahead")
        y, step, sensor, unsure, motion, turned, ahead = (np.stack([getattr(m, name) for m in regressions])
                                                          for name in names)
        phi, doubt, ends = (np.ascontiguousarray(np.stack([getattr(m, name).T for m in regressions]))
                            for name in ("phi", "doubt", "ends"))
        return Stack(y, step, phi, doubt, ends, sensor, unsure, motion, turned, ahead, regressions[0])

    def part(self, at: list[int]) -> "Stack":
        """Return the stack of the regressions with indices `at`."""
        return self if len(at) == len(self.y) else Stack(
            self.y[at], self.step[at], self.phi[at], self.doubt[at], self.ends[at], self.sensor[at], self.unsure[at],
            self.motion[at], self.turned[at], self.ahead[at], self.first)


def apart(m: Stack, root: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return columns x (a, q, n) less their projection on `m.ends`, weighted by standard deviations root (a, n)."""
    if not m.ends.shape[1]:
        return x
    ends = m.ends / root[:, None]
    size = np.sqrt(np.maximum(np.einsum("akn,akn->ak", ends, ends), 1e-300))
    ends /= size[:, :, None]
    inverse = np.linalg.pinv(np.einsum("akn,aln->akl", ends, ends), MIN_COLUMN_LEFT, hermitian=True)
    told = np.einsum("akl,aql->aqk", inverse, np.einsum("akn,aqn->aqk", ends, x / root[:, None]))
    return x - np.einsum("aqk,akn->aqn", told, ends) * root[:, None]


def whitened_columns(m: Modes, variance: np.ndarray) -> np.ndarray:
    """Return the columns (n, q) of a regression over the standard deviations of its modes, less their projection on
    `m.ends`; variance (n,) of the modes."""
    root = np.sqrt(variance)[None]
    return np.asarray((apart(Stack.of([m]), root, np.ascontiguousarray(m.phi.T)[None])[0] / root).T)


def solved(m: Stack, s: np.ndarray, w: np.ndarray, prior: Prior,
           disturbed: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return (coefficients (a, q), covariances (a, q, q), (a,) bool: the columns can be told apart) from whitened
    columns w (a, q, n) and variances s (a, n) of the modes.

    What the sensors' noise adds to the columns' products is taken off them (errors in variables: bias-compensated least
    squares), and from products with a slope of theta what its noise adds; so is what a disturbance adds to a measured
    rate within its row: `disturbed` (a,) is the number of modes whose noise is disturbance.
    """
    gram, right = np.einsum("akn,aln->akl", w, w), np.einsum("akn,an->ak", w, m.y / np.sqrt(s))
    of_square, of_motion, of_turn = passed_by(m.first)
    passed = m.step**2 * of_square / s
    total = np.sum(passed, axis=1)[:, None, None]
    turned = m.turned * np.sum(of_turn / s, axis=1)[:, None]
    inner = gram - m.sensor * total - turned[:, :, None] * np.eye(turned.shape[1])
    right = right - m.ahead * disturbed[:, None]
    right = right + m.motion * np.sum(of_motion / s, axis=1)[:, None]
    for k, value, std in prior:
        gram[:, k, k] += 1.0 / std**2
        inner[:, k, k] += 1.0 / std**2
        right[:, k] += value / std**2
    size = np.sqrt(np.maximum(np.einsum("akk->ak", gram), 1e-300))
    square_of = size[:, :, None] * size[:, None, :]
    scaled, whole = inner / square_of, gram / square_of
    inverse, half = inverted(scaled), inverted(whole, is_root=True)
    is_told = np.isfinite(inverse).all(axis=(1, 2)) & np.isfinite(half).all(axis=(1, 2))
    signal = np.full(len(s), -math.inf)
    signal[is_told] = np.linalg.eigvalsh((half @ scaled @ np.swapaxes(half, 1, 2))[is_told])[:, 0]
    with np.errstate(invalid="ignore"):
        is_told &= (signal >= SIGNAL) & ~(np.max(np.einsum("akk->ak", inverse), axis=1) > 1.0 / MIN_COLUMN_LEFT)
        xi = np.einsum("akl,al->ak", inverse, right / size)
        off = np.einsum("akl,alm,am->ak", inverse, m.unsure * total / square_of, xi)
        spread = inverse @ whole @ inverse + off[:, :, None] * off[:, None, :]
        return xi / size, spread / square_of, is_told


def passed_by(m: Modes) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what unit white noise of a term, over unit steps, adds to each mode (n,): (to the square of the term's
    integral, to its product with the change of a theta_dot that is made of theta, whose noise it is); and what that of
    theta adds to the square of its own change over a row."""
    trapezium = (1.0 - 0.25 * m.curl) * (1.0 + m.curl / 12.0) ** 2   # of Gregory's rule
    mean_over_row = 1.0 - m.curl / 12.0 - m.curl**2 / 48.0
    if m.has_rate:
        return trapezium, np.zeros(len(m.curl)), np.zeros(len(m.curl))
    return mean_over_row**2, m.curl * mean_over_row, m.curl * trapezium


def inverted(a: np.ndarray, is_root: bool = False) -> np.ndarray:
    """Return the inverses of matrices a (a, q, q), or those of their Cholesky roots; NaN where there is none."""
    try:
        return np.asarray(np.linalg.inv(np.linalg.cholesky(a) if is_root else a))
    except np.linalg.LinAlgError:
        return np.full_like(a, math.nan) if len(a) == 1 else np.concatenate([inverted(a[k:k + 1], is_root)
                                                                             for k in range(len(a))])


def least(phi: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the coefficients (q,) or (q, k) of least squares of y (n,) or (n, k) on phi (n, q)."""
    size = np.sqrt(np.maximum(np.sum(phi**2, axis=0), 1e-300))
    scaled = phi / size
    gram = products(scaled, scaled)
    if y.ndim == 1:
        return np.asarray(np.linalg.lstsq(gram, along(scaled, y), rcond=MIN_COLUMN_LEFT)[0] / size)
    return np.asarray(np.linalg.lstsq(gram, products(scaled, y), rcond=MIN_COLUMN_LEFT)[0] / size[:, None])


def rest(phi: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the residual (n,) of y (n,) after least squares on columns phi (n, q)."""
    return y - combined(phi, least(phi, y)) if phi.shape[1] else y


def least_squares_covariance(m: Modes, variance: np.ndarray, formulation: str) -> np.ndarray:
    """Return the covariance (q, q) of coefficients by least squares on differences of theta_dot (`difference`) or on
    theta_dot itself (`integral`), in modes of this variance (n,).

    Both weigh the modes as if their noise were another one, by 1 and by 1/lambda: (X'WX)^-1 X'WSWX (X'WX)^-1, S the
    noise's (White, Econometrica 48, 1980).
    """
    weight = np.ones(len(m.y)) if formulation == "difference" else 1.0 / m.curl
    size = np.sqrt(np.maximum(np.sum(m.phi**2 * weight[:, None], axis=0), 1e-300))
    phi = m.phi / size
    inverse = np.linalg.pinv(products(phi * weight[:, None], phi), MIN_COLUMN_LEFT, hermitian=True)
    inner = products(phi * (weight**2 * variance)[:, None], phi)
    return np.asarray(inverse @ inner @ inverse / np.outer(size, size))


def quadrature(m: Stack, xi: np.ndarray) -> np.ndarray:
    """Return variances (a, n) of the integrals' error for coefficients xi (a, q): the square of a fourth of what
    Gregory's rule adds to the trapezium, averaged over neighbouring modes."""
    squares, reach = (0.25 * np.einsum("akn,ak->an", m.doubt, xi)) ** 2, 4
    if squares.shape[1] <= 2 * reach + 1:
        return np.repeat(np.mean(squares, axis=1, keepdims=True), squares.shape[1], axis=1)
    padded = np.pad(squares, ((0, 0), (reach, reach)))
    return np.asarray(np.mean(np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=1), axis=2))


def mixed(m: Stack, likelihood: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (variances (a, n) of the modes, the accumulated noise in them (a, n)): means over the noise's ratios,
    weighted by their log-likelihood (a, SPAN, SPAN); scale (a, SPAN, SPAN): variance of the accumulated noise.

    If a window hardly shows the accumulated noise, its most likely level is zero, and the mean is not.
    """
    weight = np.exp(likelihood - np.max(likelihood, axis=(1, 2), keepdims=True))
    weight = weight / np.sum(weight, axis=(1, 2), keepdims=True) * scale
    ratio = 10.0**SPAN
    by_sensor, by_slow = np.sum(weight, axis=2), np.sum(weight, axis=1)
    levels = np.stack([np.sum(by_slow, axis=1), by_sensor @ ratio, by_slow @ ratio])
    parts = levels[:, :, None] * m.first.noises[:, None]
    return np.asarray(parts[0] + parts[1] + parts[2]), parts[0]


@lru_cache(maxsize=32)
def weights(noises: bytes, curl: bytes) -> tuple[np.ndarray, ...]:
    """Return for modes with noises (3, n) and lambda (n,), as bytes: (their order by lambda, where each bin begins in
    it, one over the variance of a mode in each bin (bins, SPAN^2), sum of logarithms of all variances (SPAN^2,))."""
    shapes, order = np.reshape(np.frombuffer(noises), (3, -1)), np.argsort(np.frombuffer(curl), kind="stable")
    n = len(order)
    edges = np.unique(np.round(np.concatenate([[0.0], np.geomspace(1.0, n, min(BINS, n))])).astype(int))
    many = np.diff(edges).astype(float)
    means = np.add.reduceat(shapes[:, order], edges[:-1], axis=1) / many
    sensor, slow = (each.ravel() for each in np.meshgrid(10.0**SPAN, 10.0**SPAN, indexing="ij"))
    s = means[0][:, None] + sensor * means[1][:, None] + slow * means[2][:, None]
    return order, edges[:-1], 1.0 / s, np.einsum("b,bg->g", many, np.log(s))


def noise_likelihoods(regressions: Sequence[Modes]) -> list[Noise]:
    """Return the `Noise` of each regression; neighbouring modes share a weight, in BINS bins at most.

    The columns are eliminated from y one after the other (Cholesky), for all ratios at once.
    """
    made = dict[int, Noise]()
    for group in alike(regressions):
        m = Stack.of([regressions[k] for k in group])
        order, first, inverse, logarithms = weights(m.first.noises.tobytes(), m.first.curl.tobytes())
        table = np.concatenate([m.phi, m.ends, m.y[:, None]], axis=1)
        many, q, n, ratios = len(table), table.shape[1] - 1, table.shape[2], inverse.shape[1]
        size = np.sqrt(np.einsum("aqn,aqn->aq", table, table))
        size[:, q] = 1.0
        table = (table / np.where(size > 0.0, size, 1.0)[:, :, None])[:, :, order]
        low, high = np.tril_indices(q + 1)
        bins = np.add.reduceat(np.swapaxes(table[:, low] * table[:, high], 0, 1), first, axis=2)
        told = np.einsum("bg,pb->pg", inverse, np.reshape(bins, (-1, len(first))))
        gram = np.zeros((q + 1, q + 1, many, ratios))
        gram[low, high] = gram[high, low] = np.reshape(told, (-1, many, ratios))
        diagonal = np.arange(q)
        size = np.sqrt(np.maximum(gram[diagonal, diagonal], 1e-300))
        yy = gram[q, q].copy()
        gram[:q] /= size[:, None]
        gram[:, :q] /= size
        gram[diagonal, diagonal] += 1e-13
        determinant = 2.0 * np.sum(np.log(size), axis=0)
        for k in range(q):
            determinant += np.log(gram[k, k])
            gram[k + 1:, k + 1:] -= gram[k + 1:, None, k] * (gram[None, k, k + 1:] / gram[k, k])
        left = np.maximum(gram[q, q], 1e-14 * yy + 1e-300)
        degrees = max(n - q, 1)
        largest = -0.5 * (n * np.log(left) + logarithms)
        value = -0.5 * (degrees * np.log(left) + logarithms + determinant)
        grid = many, len(SPAN), len(SPAN)
        told_of = (np.reshape(each, grid) for each in (
            value - np.max(value, axis=1, keepdims=True), left / degrees, largest))
        made |= {k: Noise(*each) for k, each in zip(group, zip(*told_of, strict=True), strict=True)}
    return [made[k] for k in range(len(regressions))]


@lru_cache(maxsize=128)
def edges_of(n: int, bands: int) -> np.ndarray:
    """Return (k + 1,) int, k <= bands: the first of n modes, sorted by frequency, of each band, and n."""
    count = max(1, min(bands, n // FEWEST_IN_BAND))
    ends = np.round(np.geomspace(FEWEST_IN_BAND, max(n, FEWEST_IN_BAND), count)).astype(int)
    return np.unique(np.concatenate([[0], np.minimum(ends, n)]))


def spectrum(fit: Fit, m: Modes, bands: int) -> tuple[np.ndarray, ...]:
    """Return (frequencies [rad/s], mean squares, modes, shares of leverage) (k,) of the whitened residual in bands.

    Mean squares are 1 where the noise that was assumed is true.
    """
    edges = edges_of(len(m.y), bands)
    many = np.diff(edges)
    table = np.stack([m.frequency, fit.whitened**2, fit.leverage])
    if np.any(table[0, 1:] < table[0, :-1]):   # of several stretches
        table = table[:, np.argsort(m.frequency, kind="stable")]
    frequency, squares, leverage = np.add.reduceat(table, edges[:-1], axis=1)
    return frequency / many, squares / many, many, leverage / max(float(np.sum(fit.leverage)), 1e-300)


def whiteness(squares: np.ndarray, many: np.ndarray) -> float | None:
    """Return the p-value of mean squares (k,) of `many` (k,) modes in k bands being all 1; None of fewer than 3.

    2 ln Q of the likelihood ratio of one variance a band against 1 (Bartlett 1937), as chi square.
    """
    degrees = len(squares) - 1
    if degrees < 2:
        return None
    return tail(max(float(np.sum(many * (squares - 1.0 - np.log(np.maximum(squares, 1e-12))))), 0.0), degrees)
