"""Estimates from the likelihood: numbers by Gauss-Newton with priors, noise levels by Fisher scoring.

A model is frozen: it makes `Parameters` of numbers p.  Its levels are fitted by making another model.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol, Self, TypeVar

import numpy as np

from sim.kernels import kernel

from ..sums import along, square
from .likelihood import Parameters, Run, follow, run, whitened

CONVERGED = 0.05       # of the objective: less in a step ends the iterations
LEVEL_DIFFERENCE = 0.05  # of a level's logarithm, over which its slopes are taken
LEVEL_STEP = 1.0       # of a level's logarithm, the largest in a step
LEVEL_SHARES = (1.0, 0.3, 0.1)  # of a step of the levels, tried until one is likelier
LEVELS_CONVERGED = 0.25  # nats: less in a step ends the fit of the levels
DAMPINGS = (0.0, 0.1, 1.0, 10.0)  # of Gauss-Newton, of the scaled diagonal, tried until the objective falls


class Number(NamedTuple):
    """One number of a model: null its nominal value, tol how far from it is nobody's fault, prior one sigma, step of
    its slope, low and high its range, cause and parameter in the catalogue's words ("": none)."""

    name: str
    null: float
    tol: float
    prior: float
    step: float
    low: float = -math.inf
    high: float = math.inf
    cause: str = ""
    parameter: str = ""


@dataclass(frozen=True, eq=False)
class Table:
    """The numbers of a model, in order; their columns as arrays."""

    numbers: tuple[Number, ...]
    null: np.ndarray
    tol: np.ndarray
    prior: np.ndarray
    step: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @classmethod
    def of(cls, numbers: Sequence[Number]) -> Self:
        return cls(tuple(numbers), *(np.array([each[k] for each in numbers]) for k in range(1, 7)))

    @cached_property
    def places(self) -> dict[str, int]:
        """Name -> index of every number."""
        return {each.name: k for k, each in enumerate(self.numbers)}

    def __contains__(self, name: str) -> bool:
        return name in self.places

    def __len__(self) -> int:
        return len(self.numbers)

    def index(self, name: str) -> int:
        return self.places[name]


class Noise(NamedTuple):
    """What is believed of the noise levels, (7,) each in the order of `likelihood.LEVELS`: logarithms as declared,
    sigma of the logarithm (0: not fitted), largest logarithm of a level over the declared."""

    declared: np.ndarray
    spread: np.ndarray
    cap: np.ndarray

    @property
    def moves(self) -> np.ndarray:
        """Return the indices of the levels that are fitted."""
        return np.flatnonzero(self.spread > 0.0)


class Model(Protocol):
    """What an estimate reads of a model: its numbers, its noise and levels (7,) (logarithms), the innovations that are
    scored (an index into all), and the parameters of given numbers."""

    @property
    def table(self) -> Table: ...

    @property
    def noise(self) -> Noise: ...

    @property
    def levels(self) -> np.ndarray: ...

    @property
    def scored(self) -> np.ndarray: ...

    def parameters(self, p: np.ndarray) -> Parameters: ...

    def with_levels(self, levels: np.ndarray) -> Self: ...


AnyModel = TypeVar("AnyModel", bound=Model)


class Evaluation(NamedTuple):
    """A model at numbers p: the filter's run, whitened innovations e (r,), the sum of their log variances."""

    p: np.ndarray
    run: Run
    e: np.ndarray
    log_variance: float


class Fit(NamedTuple):
    """A fit at its minimum: all numbers p, the indices free, those within their tolerance (band); whitened innovations
    e (r,), their slopes J (r, free); the filter's run there."""

    p: np.ndarray
    e: np.ndarray
    J: np.ndarray
    free: tuple[int, ...]
    band: frozenset[int]
    run: Run

    def at(self, j: int) -> int:
        return self.free.index(j)


def evaluate(m: Model, p: np.ndarray) -> Evaluation:
    """Return the model at numbers p."""
    made = run(m.parameters(p))
    return Evaluation(p, made, *whitened(made.E, made.S, m.scored))


def evaluate_held(m: Model, base: Run, p: np.ndarray) -> np.ndarray:
    """Return the whitened innovations (r,) with numbers p, gains and variances of `base` held."""
    return whitened(follow(base, m.parameters(p)), base.S, m.scored)[0]


def refreshed(m: Model, fit: Fit) -> Fit:
    """Return the fit with run and innovations computed anew for model `m`, which may differ from the one it was made
    with."""
    at = evaluate(m, fit.p)
    return fit._replace(run=at.run, e=at.e)


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


# ---- numbers


def limits(m: Model, band: frozenset[int]) -> tuple[np.ndarray, np.ndarray]:
    """Return (lowest, highest) values of all numbers: their range, for those in the band their tolerance."""
    of = m.table
    low, high = of.low.copy(), of.high.copy()
    for j in band:
        low[j], high[j] = max(low[j], of.null[j] - of.tol[j]), min(high[j], of.null[j] + of.tol[j])
    return low, high


def objective(m: Model, e: np.ndarray, p: np.ndarray) -> float:
    """Return the squares of whitened innovations e (r,) and of the numbers p over their priors."""
    return square(e) + square((p - m.table.null) / m.table.prior)


def slopes(m: Model, at: Evaluation | Fit, free: tuple[int, ...]) -> np.ndarray:
    """Return the slopes J (r, free) of the whitened innovations by differences, the gains of the run there held.

    What moves the gains changes the innovations by white noise of second order (docs/method.md)."""
    J = np.empty((len(free), len(at.e)))
    for i, j in enumerate(free):
        q = at.p.copy()
        step = m.table.step[j] if q[j] + m.table.step[j] <= m.table.high[j] else -m.table.step[j]
        q[j] += step
        J[i] = (evaluate_held(m, at.run, q) - at.e) / step
    return J.T


def information(m: Model, fit: Fit) -> np.ndarray:
    """Return the posterior's information matrix (free, free); a number in its band has its tolerance as prior."""
    prior = np.array([m.table.tol[j] if j in fit.band else m.table.prior[j] for j in fit.free])
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
    at = evaluate(m, p)
    J = slopes(m, at, free) if J is None else J
    best = objective(m, at.e, p)
    while rounds > 0 and len(F):
        w = m.table.prior[F]**-2.0
        A = gram(J) + np.diag(w)
        b = -along(J, at.e) - w * (at.p - m.table.null)[F]
        s = 1.0 / np.sqrt(np.diag(A))
        A = A * np.outer(s, s)
        for damping in DAMPINGS:
            q = at.p.copy()
            q[F] = np.clip(q[F] + _step(A, b, s, damping, q[F] - low[F], high[F] - q[F]), low[F], high[F])
            tried = evaluate(m, q)
            value = objective(m, tried.e, q)
            if value < best:
                break
        else:
            break
        done = best - value < CONVERGED   # the slopes are then those of a point next to it
        rounds -= value > 0.5 * best
        at, best = tried, value
        if done:
            break
        J = slopes(m, at, free)
    return Fit(at.p, at.e, J, tuple(free), band, at.run)


def _step(A: np.ndarray, b: np.ndarray, s: np.ndarray, damping: float, below: np.ndarray,
          above: np.ndarray) -> np.ndarray:
    """Return the step (k,) of the scaled normal equations A, b, with scales s; numbers that press against a bound, to
    which they are `below` and `above` away, stay."""
    inside = np.ones(len(b), bool)
    d = np.zeros(len(b))
    for _ in range(4):
        d[:] = 0.0
        d[inside] = np.linalg.solve(A[np.ix_(inside, inside)] + (1e-10 + damping) * np.eye(inside.sum()),
                                    (b * s)[inside]) * s[inside]
        out = inside & ((above <= 1e-12) & (d > 0.0) | (below <= 1e-12) & (d < 0.0))
        if not out.any():
            break
        inside &= ~out
    return d


def at_bound(m: Model, fit: Fit) -> list[int]:
    """Return the columns of J whose numbers stand at a bound, so that they are not estimated."""
    low, high = limits(m, fit.band)
    return [i for i, j in enumerate(fit.free) if fit.p[j] <= low[j] + 1e-9 or fit.p[j] >= high[j] - 1e-9]


# ---- what moves the variances too


def score(e: np.ndarray, R: np.ndarray, V: np.ndarray) -> np.ndarray:
    """Return the slopes (r, k) of each innovation's log likelihood (Astrom 1980).

    e  (r,) innovations over their standard deviation s;  R (r, k) their own slopes, over s, in k numbers
    V  (r, k) slopes of log s^2
    """
    return -e[:, None] * R - 0.5 * (1.0 - e * e)[:, None] * V


def fisher_information(R: np.ndarray, V: np.ndarray) -> np.ndarray:
    """Return the information (k, k) of the log likelihood about k numbers; R, V as in `score` (Klein and Morelli 2006,
    eq. 6.49)."""
    return gram(R) + 0.5 * gram(V)


def log_likelihood(m: Model, at: Evaluation) -> float:
    """Return the log likelihood [nats] of a model at its numbers, with the levels' prior."""
    moves = m.noise.moves
    d = (m.levels - m.noise.declared)[moves] / m.noise.spread[moves]
    return -0.5 * (square(at.e) + at.log_variance + square(d))


def level_information(m: Model, at: Evaluation) -> tuple[np.ndarray, np.ndarray]:
    """Return gradient (moves,) and information (moves, moves) of the log likelihood in the levels' logarithms, with a
    normal prior about the declared."""
    h, moves = LEVEL_DIFFERENCE, m.noise.moves
    v = np.log(at.run.S.ravel()[m.scored])
    D, V = np.empty((2, len(at.e), len(moves)))
    for k, i in enumerate(moves):
        levels = m.levels.copy()
        levels[i] += h
        moved = evaluate(m.with_levels(levels), at.p)
        D[:, k] = (moved.e - at.e) / h
        V[:, k] = (np.log(moved.run.S.ravel()[m.scored]) - v) / h
    w = m.noise.spread[moves]**-2.0
    R = D + 0.5 * at.e[:, None] * V     # of the innovations themselves
    gradient = score(at.e, R, V).sum(axis=0) - w * (m.levels - m.noise.declared)[moves]
    return gradient, fisher_information(R, V) + np.diag(w + 1e-9)


def fit_levels(m: AnyModel, p: np.ndarray, rounds: int = 3) -> AnyModel:
    """Return the model with its noise levels fitted, numbers p held: Fisher scoring of the innovations' likelihood."""
    at, moves = evaluate(m, p), m.noise.moves
    best = log_likelihood(m, at)
    for _ in range(rounds):
        g, A = level_information(m, at)
        step = np.linalg.solve(A, g)
        for share in LEVEL_SHARES:
            levels = m.levels.copy()
            levels[moves] = np.minimum(levels[moves] + np.clip(share * step, -LEVEL_STEP, LEVEL_STEP),
                                       (m.noise.declared + m.noise.cap)[moves])
            tried = m.with_levels(levels)
            there = evaluate(tried, p)
            value = log_likelihood(tried, there)
            if value > best:
                break
        else:
            return m
        m, at, gain, best = tried, there, value - best, value
        if gain < LEVELS_CONVERGED:
            return m
    return m


def level_deviation(m: Model, p: np.ndarray, k: int) -> float:
    """Return the standard deviation of noise level k, in its unit."""
    C = np.linalg.inv(level_information(m, evaluate(m, p))[1])
    at = int(np.flatnonzero(m.noise.moves == k)[0])
    return float(math.exp(m.levels[k]) * math.sqrt(C[at, at]))
