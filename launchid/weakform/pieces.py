"""Cut a log into pieces, and fit the terms of an equation in each, with the noise that is most likely in all."""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ..sums import square
from .fit import MIN_COLUMN_LEFT, Fit, Noise, gls_of_all, noise_likelihoods, rest
from .late import later, with_betas
from .modes import Modes, term_modes
from .rows import Rows

JUDGE_PIECE = 5.0    # s over which one set of coefficients holds while the log is asked,
ROWS_A_PIECE = 250   # and rows: of a slow log the vehicle is slower, too
MOST_PIECES = 60     # evenly over a longer log: the work is bounded
PER_COEFFICIENT = 5  # modes, without which an answer cannot be tested
MOST_TOGETHER = 100_000  # rows of shifted betas that are computed at once: some 20 MB


@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch of the log, its regression on the terms of the equation, the fit, and the noise's likelihood.

    delayed   beta (n,) at a further delay [s], where more is known of it than its rows show; None: `later` of the rows
    """

    rows: Rows
    modes: Modes
    fit: Fit
    noise: Noise
    delayed: Callable[[float], np.ndarray] | None = None

    @property
    def weight(self) -> np.ndarray:
        """One over the standard deviation (n,) of each mode."""
        return np.asarray(1.0 / np.sqrt(self.fit.variance))

    def shifted(self, terms: tuple[str, ...], leads: list[float]) -> np.ndarray:
        """Return the columns (n, k, q) of terms in n modes, with beta delayed by each of k leads [s]."""
        return with_betas(self.rows, self.modes, terms, [self.beta_at(lead) for lead in leads])

    def beta_at(self, lead: float) -> np.ndarray:
        """Return beta (n,) delayed by `lead` [s]."""
        return self.delayed(lead) if self.delayed is not None else later(self.rows, lead)

    def unexplained(self, terms: tuple[str, ...], leads: list[float]) -> np.ndarray:
        """Return the weighted squares (k,) that terms leave with beta delayed by each of k leads [s]."""
        if len(leads) > 1 and len(leads) * len(self.rows.t) > MOST_TOGETHER:
            half = len(leads) // 2
            return np.concatenate([self.unexplained(terms, leads[:half]), self.unexplained(terms, leads[half:])])
        w, ends = self.weight, np.repeat(self.modes.ends[:, None, :], len(leads), axis=1)
        phi = np.transpose(np.concatenate([self.shifted(terms, leads), ends], axis=2), (1, 2, 0))
        phi = np.multiply(phi, w, order="C")
        phi /= np.sqrt(np.maximum(np.einsum("kqn,kqn->kq", phi, phi), 1e-300))[:, :, None]
        inverse = np.linalg.pinv(np.einsum("kqn,krn->kqr", phi, phi), MIN_COLUMN_LEFT, hermitian=True)
        y = self.modes.y * w
        xi = np.einsum("kqr,kr->kq", inverse, np.einsum("kqn,n->kq", phi, y))
        left = y - np.einsum("kq,kqn->kn", xi, phi)
        return np.einsum("kn,kn->k", left, left)


@dataclass(frozen=True, eq=False)
class Whole:
    """Terms that were fitted to the pieces of a whole log; known: coefficient and deviation of those that joined;
    doubt: variance of each term by what the equation lacks at other frequencies; is_constant: no coefficient changes
    with time, so a nominal says."""

    terms: tuple[str, ...]
    pieces: list[Piece]
    known: dict[str, tuple[float, float]]
    doubt: dict[str, float] = field(default_factory=dict)
    is_constant: bool = False


def pieces_of(rows: Rows, terms: tuple[str, ...]) -> list[Piece]:
    """Cut rows into pieces and fit those that are long enough, with one noise ratio by the likelihood of all."""
    count = max(1, round((rows.t[-1] - rows.t[0]) / max(JUDGE_PIECE, ROWS_A_PIECE * rows.period)))
    edges = np.linspace(rows.t[0], rows.t[-1] + rows.period, count + 1)
    parts = [rows.part(rows.cut(a, b)) for a, b in itertools.pairwise(edges.tolist())]
    asked = parts if len(parts) <= MOST_PIECES else \
        [parts[k] for k in np.linspace(0, len(parts) - 1, MOST_PIECES).round().astype(int)]
    made = [(part, term_modes(part, terms)) for part in asked if len(part.t) > 1]
    return fitted([(part, m) for part, m in made if len(m.y) >= PER_COEFFICIENT * (len(terms) + 1)])


def fitted(made: list[tuple[Rows, Modes]]) -> list[Piece]:
    """Fit (rows, their regression) pairs with noise ratios by the likelihood of all; return them as pieces."""
    regressions = [m for _, m in made]
    noises = noise_likelihoods(regressions)
    whole = np.sum([noise.restricted for noise in noises], axis=0)
    fits = gls_of_all(regressions, [whole] * len(made), noises)
    return [Piece(part, m, fit, own) for (part, m), fit, own in zip(made, fits, noises, strict=True)]


def likelihood(pieces: list[Rows], terms: tuple[str, ...]) -> float:
    """Return the largest log-likelihood of terms in pieces, each with its coefficients, all with one noise."""
    noises = noise_likelihoods([term_modes(rows, terms) for rows in pieces])
    return float(np.max(np.sum([noise.largest for noise in noises], axis=0)))


def beside(pieces: list[Piece], terms: tuple[str, ...]) -> list[Piece]:
    """Fit other terms to the stretches of `pieces`, and return them as new pieces."""
    return fitted([(piece.rows, term_modes(piece.rows, terms)) for piece in pieces])


def means_of(pieces: list[Piece], terms: tuple[str, ...]) -> dict[str, float]:
    """Return by term the mean of the pieces' coefficients, each weighted by what it tells of them."""
    told = [piece.fit for piece in pieces if not piece.fit.is_singular]
    information = [np.linalg.inv(fit.covariance) for fit in told]
    if not told:
        return {}
    mean = np.linalg.solve(np.sum(information, axis=0), np.sum([each @ fit.xi for each, fit in zip(
        information, told, strict=True)], axis=0))
    return dict(zip(terms, mean.tolist(), strict=True))


def moved(piece: Piece, lead: float) -> Rows:
    """Return the rows of a piece with beta delayed by `lead` [s]."""
    return replace(piece.rows, beta=piece.beta_at(lead)) if lead else piece.rows


def pooled(pieces: list[Piece]) -> tuple[float, float, float]:
    """Return (coefficient, standard deviation, share of its column that the others explain) of the last term, with one
    coefficient in all pieces; the others have one in each."""
    told = [piece for piece in pieces if not piece.fit.is_singular]
    below = sum(1.0 / float(piece.fit.covariance[-1, -1]) for piece in told)
    if not below > 0.0:
        return 0.0, math.inf, 1.0
    size = sum(float(piece.fit.xi[-1] / piece.fit.covariance[-1, -1]) for piece in told) / below
    columns = [piece.modes.phi * piece.weight[:, None] for piece in pieces]
    left, whole = (sum(map(square, each)) for each in (
        [rest(phi[:, :-1], phi[:, -1]) for phi in columns], [phi[:, -1] for phi in columns]))
    return size, 1.0 / math.sqrt(below), 1.0 - left / whole if whole > 0.0 else 1.0
