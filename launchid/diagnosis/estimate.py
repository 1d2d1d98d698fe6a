"""Estimates: Gauss-Newton with priors on the whitened innovations, noise levels by likelihood."""

import math
from typing import NamedTuple

import numpy as np

from sim.vehicle.kernels import kernel

from ..sums import along, square
from .model import Model

CONVERGED = 0.05       # of the objective: less in a step ends the iterations
LEVEL_STEP = 1.0       # of a level's logarithm, the largest in a step


class Fit(NamedTuple):
    """A fit at its minimum: all numbers p, the indices free, those within their tolerance (band); whitened innovations
    e (r,), their slopes J (r, free)."""

    p: np.ndarray
    e: np.ndarray
    J: np.ndarray
    free: tuple[int, ...]
    band: frozenset[int]

    def at(self, j: int) -> int:
        return self.free.index(j)


@kernel
def _gram(A, out):
    """Write the products of the rows of A (k, n) to out (k, k), summed in order on one thread (`sums`)."""
    for i in range(len(A)):
        for j in range(i + 1):
            s = 0.0
            for n in range(A.shape[1]):
                s += A[i, n] * A[j, n]
            out[i, j] = out[j, i] = s


def gram(J: np.ndarray) -> np.ndarray:
    """Return J' J (k, k) of J (r, k)."""
    out = np.empty((J.shape[1], J.shape[1]))
    _gram(np.ascontiguousarray(J.T), out)
    return out


def limits(m: Model, band: frozenset[int]) -> tuple[np.ndarray, np.ndarray]:
    """Return (lowest, highest) values of all numbers: their range, for those in the band their tolerance."""
    low, high = m.low.copy(), m.high.copy()
    for j in band:
        low[j], high[j] = max(low[j], m.null[j] - m.tol[j]), min(high[j], m.null[j] + m.tol[j])
    return low, high


def objective(m: Model, e: np.ndarray, p: np.ndarray) -> float:
    d = (p - m.null) / m.prior
    return square(e) + square(d)


def slopes(m: Model, p: np.ndarray, free: tuple[int, ...]) -> np.ndarray:
    """Return the slopes J (r, free) of the whitened innovations at p by differences, the last filter's gains held."""
    base = m.white(p, frozen=True)
    J = np.empty((len(free), len(base)))
    for i, j in enumerate(free):
        q = p.copy()
        step = m.step[j] if p[j] + m.step[j] <= m.high[j] else -m.step[j]
        q[j] += step
        J[i] = (m.white(q, frozen=True) - base) / step
    return J.T


def information(m: Model, fit: Fit) -> np.ndarray:
    """Return the posterior's information matrix (free, free); a number in its band has its tolerance as prior."""
    prior = np.array([m.tol[j] if j in fit.band else m.prior[j] for j in fit.free])
    return gram(fit.J) + np.diag(prior**-2.0)


def inverse(m: Model, fit: Fit) -> np.ndarray:
    """Return the inverse of the information: the posterior's covariance."""
    A = information(m, fit)
    return np.linalg.inv(A + 1e-12 * np.diag(np.diag(A)))


def gauss_newton(m: Model, p: np.ndarray, free: tuple[int, ...], band: frozenset[int] = frozenset(),
                 rounds: int = 3, J: np.ndarray | None = None) -> Fit:
    """Minimise squares and priors over `free`, numbers held at a bound that they press against (Bertsekas 1982); return
    the fit.  rounds: those that do not halve the objective; J (r, free): slopes at p, if known."""
    F = np.array(free, int)
    low, high = limits(m, band)
    p = p.copy()
    p[F] = np.clip(p[F], low[F], high[F])
    e = m.white(p)
    J = slopes(m, p, free) if J is None else J
    best = objective(m, e, p)
    while rounds > 0 and len(F):
        w = m.prior[F]**-2.0
        A = gram(J) + np.diag(w)
        b = -along(J, e) - w * (p - m.null)[F]
        s = 1.0 / np.sqrt(np.diag(A))
        A = A * np.outer(s, s)
        for damping in (0.0, 0.1, 1.0, 10.0):
            inside = np.ones(len(F), bool)
            d = np.zeros(len(F))
            for _ in range(4):
                d[:] = 0.0
                d[inside] = np.linalg.solve(A[np.ix_(inside, inside)] + (1e-10 + damping) * np.eye(inside.sum()),
                                            (b * s)[inside]) * s[inside]
                out = inside & ((p[F] >= high[F] - 1e-12) & (d > 0.0) | (p[F] <= low[F] + 1e-12) & (d < 0.0))
                if not out.any():
                    break
                inside &= ~out
            q = p.copy()
            q[F] = np.clip(p[F] + d, low[F], high[F])
            eq = m.white(q)
            value = objective(m, eq, q)
            if value < best:
                done = best - value < CONVERGED   # the slopes are then those of a point next to it
                rounds -= value > 0.5 * best
                p, e, best = q, eq, value
                break
        else:
            e, done = m.white(p), True            # the filter is where p is
        if done:
            break
        J = slopes(m, p, free)
    return Fit(p, e, J, tuple(free), band)


def at_bound(m: Model, fit: Fit) -> list[int]:
    """Return the columns of J whose numbers stand at a bound, so that they are not estimated."""
    low, high = limits(m, fit.band)
    return [i for i, j in enumerate(fit.free) if fit.p[j] <= low[j] + 1e-9 or fit.p[j] >= high[j] - 1e-9]


def likelihood(m: Model, e: np.ndarray) -> float:
    """Return the log likelihood [nats] of the last filter's whitened innovations e (r,), with the levels' prior."""
    d = (m.levels - m.levels0)[m.moves] / m.spread[m.moves]
    return -0.5 * (square(e) + m.log_variance + square(d))


def level_information(m: Model, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (gradient (moves,), twice the information (moves, moves)) of -2 log likelihood in the levels' logarithms,
    with a normal prior about the declared (Astrom 1980; Klein and Morelli 2006, eq. 6.49)."""
    h, e = 0.05, m.white(p)
    v = np.log(m.S.ravel()[m.flat])
    D, V = np.empty((2, len(m.moves), len(e)))
    for row, i in enumerate(m.moves):
        m.levels[i] += h
        D[row] = (m.white(p) - e) / h
        V[row] = (np.log(m.S.ravel()[m.flat]) - v) / h
        m.levels[i] -= h
    w = m.spread[m.moves]**-2.0
    R = D + 0.5 * e * V                 # slopes of the innovations themselves
    return 2.0 * along(D.T, e) + V.sum(1) + 2.0 * w * (m.levels - m.levels0)[m.moves], \
        gram(V.T) + 2.0 * gram(R.T) + np.diag(2.0 * w + 1e-9)


def fit_levels(m: Model, p: np.ndarray, rounds: int = 3) -> None:
    """Fit the model's noise levels (in place) by Fisher scoring of the innovations' likelihood, with the numbers p."""
    best = likelihood(m, m.white(p))
    for _ in range(rounds):
        g, A = level_information(m, p)
        old = m.levels.copy()
        for shorter in (1.0, 0.3, 0.1):
            d = np.clip(-shorter * np.linalg.solve(A, g), -LEVEL_STEP, LEVEL_STEP)
            m.levels[m.moves] = np.minimum(old[m.moves] + d, (m.levels0 + m.cap)[m.moves])
            if (value := likelihood(m, m.white(p))) > best:
                gain, best = value - best, value
                break
        else:
            m.levels, gain = old, 0.0
            m.move_to(p)
        if gain < 0.25:
            return


def level_deviation(m: Model, p: np.ndarray, k: int) -> float:
    """Return the standard deviation of noise level k, in its unit."""
    C = np.linalg.inv(0.5 * level_information(m, p)[1])
    at = int(np.flatnonzero(m.moves == k)[0])
    m.move_to(p)
    return float(math.exp(m.levels[k]) * math.sqrt(C[at, at]))
