"""The score of all choices: whitened prediction errors on blocks left out, each fold's numbers fitted to the others."""

import math

import numpy as np

from ..likelihood.estimate import Fit, at_bound, evaluate_held, gram, information, inverse, limits
from ..sums import along, combined, square
from .known import MODEL_FOLDS, SCORE_BLOCKS
from .model import Model

LEAST_UNIT = 0.2       # of a whitened error's variance
FOLD_STEPS = 2         # Gauss-Newton steps of every fold's own fit


def _once(m: Model) -> set[int]:
    """Return the indices of numbers of shapes that happen once."""
    return {m.table.index(name) for shape in m.shapes if shape.kind.once for name in shape.names}


def left_out(m: Model, fit: Fit) -> np.ndarray:
    """Return the errors (r,) of each fold's rows under the numbers fitted to the other folds (Stone 1974; blocks:
    Burman et al. 1994), the fit's gains held."""
    return folds(m, fit)[0]


def folds(m: Model, fit: Fit) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return left-out errors (r,) and each fold's numbers: steps from the fit to all with its slopes, errors anew.

    The gradient left at the fit to all is nobody's; a fold that runs away is taken linearly.  What happens once cannot
    be left out and stays as fitted: its gain must be the larger.
    """
    stuck = set(at_bound(m, fit))
    keep = [i for i in range(len(fit.free)) if i not in stuck and fit.free[i] not in _once(m)]
    if not keep:
        return fit.e.copy(), [fit.p] * MODEL_FOLDS
    F, J, p, e = np.array(fit.free)[keep], fit.J[:, keep], fit.p, fit.e
    out, fits = e.copy(), []
    w = m.table.prior[F]**-2.0
    A = gram(J) + np.diag(w)
    (low, high), g0 = (x[F] for x in limits(m, fit.band)), along(J, e)
    for f in range(MODEL_FOLDS):
        mine = m.log.fold == f
        fits.append(p)
        Jf = J[mine]
        Af = A - gram(Jf)
        s = 1.0 / np.sqrt(np.diag(Af) + 1e-300)
        As = Af * np.outer(s, s) + 1e-9 * np.eye(len(s))

        def worth(er: np.ndarray, q: np.ndarray, mine: np.ndarray = mine) -> float:
            moved = (q - p)[F]
            return square(er) - square(er[mine]) + float((moved * w) @ moved - 2.0 * g0 @ moved)

        q, eq, best, first = p, e, worth(e, p), True
        for _ in range(FOLD_STEPS):
            g = along(J, eq - e) - along(Jf, eq[mine]) + w * (q - p)[F]
            r = q.copy()
            r[F] = np.clip(q[F] - np.linalg.solve(As, g * s) * s, low, high)
            move = r[F] - q[F]
            if first:
                out[mine] = e[mine] + combined(Jf, move)
            elif float(move @ (Af @ move)) < 0.01:
                break
            er = evaluate_held(m, fit.run, r)
            value = worth(er, r)
            if not value < best:
                break
            done, q, eq, best, first = best - value < 0.05, r, er, value, False
            out[mine], fits[-1] = eq[mine], q
            if done:
                break
    return out, fits


def compare(m: Model, e0: np.ndarray, e1: np.ndarray, unit: float) -> tuple[float, float]:
    """Return the squares that e1 saves over e0, and their standard error, at least that of white errors of `unit`.

    By blocks: what a block saves goes with what it can tell, which is the square of the difference, and the error is
    that of their ratio (Cochran 1977, ch. 6).
    """
    d = np.bincount(m.log.block, e0 * e0 - e1 * e1, minlength=SCORE_BLOCKS)
    told = np.bincount(m.log.block, (e0 - e1)**2, minlength=SCORE_BLOCKS)
    gain, white = float(d.sum()), 2.0 * math.sqrt(float(told.sum()) * unit)
    s = math.sqrt(SCORE_BLOCKS * float(d.var(ddof=1)))
    rest = d - gain / max(float(told.sum()), 1e-300) * told
    return gain, max(min(s, math.sqrt(SCORE_BLOCKS / (SCORE_BLOCKS - 1.0) * float(rest @ rest))), white, 1e-9)


def covariance(m: Model, fit: Fit, unit: float) -> np.ndarray:
    """Return the covariance (free, free) of the free numbers: of each the larger variance, by the information or by
    blocks.  The jackknife over blocks is not too small where there are few of them (CR3: Bell and McCaffrey 2002); what
    happens once has the sandwich (White 1982), for no other block tells it."""
    A, C = information(m, fit), inverse(m, fit)
    keep = [i for i, j in enumerate(fit.free) if j not in _once(m)]
    G, moved = np.zeros((SCORE_BLOCKS, len(fit.free))), np.zeros((SCORE_BLOCKS, len(keep)))
    for block in range(SCORE_BLOCKS):
        J = fit.J[m.log.block == block]
        G[block] = along(J, fit.e[m.log.block == block])
        rest = A - gram(J) + 1e-9 * np.diag(np.diag(A))
        moved[block] = np.linalg.solve(rest[np.ix_(keep, keep)], G[block, keep])
    robust = np.square(G @ C).sum(axis=0)
    robust[keep] = (SCORE_BLOCKS - 1.0) / SCORE_BLOCKS * np.square(moved).sum(axis=0)
    wider = np.sqrt(np.maximum(robust / (np.diag(C) * unit), 1.0))
    return unit * C * np.outer(wider, wider)


def unit_of(fit: Fit) -> float:
    """Return the variance of a fit's whitened errors, at least that of errors that hardly are."""
    return max(float(np.mean(fit.e**2)), LEAST_UNIT)


def deviations(m: Model, fit: Fit, unit: float) -> dict[int, float]:
    """Return the standard deviation of each free number, by its index."""
    return dict(zip(fit.free, np.sqrt(np.diag(covariance(m, fit, unit))), strict=True))
