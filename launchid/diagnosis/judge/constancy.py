"""A test whether the size of a named cause is the same in every part of the log.  A true cause's is (score test over
segments of equal information; Nyblom 1989, Andrews 1993 for the idea).  Fit and whiteness do not stop a wrong name;
this does.

What may change is the part of its response that no other number of the causes makes, or another's change would be
called this one's.  The deviations, which are the same all along by what they are, stay free within their prior: a fault
of k1 may look like the nominal's tolerance of k1 as a whole, but not in one part of the log alone.
"""

import itertools
from dataclasses import dataclass

import numpy as np

from ...sums import along, orthonormal, products, square
from ..model.nuisance import Problem
from ..model.point import DEVIATIONS
from ..search.profile import Model
from ..search.scan import norms

SEGMENTS = 8
CONSTANCY_LIMIT = 40.0     # chi-squared of 7 degrees of freedom: true causes reached 18, a false term 77
NOTHING = 1e-12            # of a size's information: a part with less tells nothing


@dataclass(frozen=True)
class Constancy:
    """Size of one cause per segment: what it is as a whole plus what it is there more or less.

    t      (9,) [s] the segments' ends;  size, std (8,) of the size in each, std as if the parts were told each alone
    """

    chi_squared: float
    t: tuple[float, ...]
    size: tuple[float, ...]
    std: tuple[float, ...]


def constancy(model: Model, index: int) -> Constancy:
    """The test whether the size of cause `index` is the same all along."""
    fitted = model.fit
    column = sum(len(cause.values) for cause in fitted.causes[:index])
    slopes, prior = fitted.slopes, Problem(fitted.record, fitted.filter).prior
    rows, wide = fitted.whitened.shape
    r = np.concatenate([fitted.whitened.ravel(), fitted.delta / prior])
    whole = np.vstack([slopes, np.zeros((DEVIATIONS, slopes.shape[1]))])
    whole[-DEVIATIONS:, -DEVIATIONS:] = np.diag(1.0 / prior)
    own = slopes[:, column] - _within(np.delete(slopes[:, :-DEVIATIONS], column, axis=1), slopes[:, column])
    cuts = _cuts(own, rows)
    apart = np.linalg.svd(np.eye(SEGMENTS) - 1.0 / SEGMENTS)[0][:, :-1]  # changes that leave the sizes' mean
    changes = np.zeros((len(whole), SEGMENTS))
    for k, (a, b) in enumerate(itertools.pairwise(cuts)):
        changes[wide * a:wide * b, k] = own[wide * a:wide * b]
    changes = products(changes.T, apart)
    changes -= _within(whole, changes)
    information = products(changes, changes) + NOTHING * square(slopes[:, column]) * np.eye(SEGMENTS - 1)
    score = along(changes, r)
    moved = -np.linalg.solve(information, score)
    spread = apart @ np.linalg.solve(information, apart.T)
    alone = np.sqrt(np.diag(spread) * SEGMENTS / (SEGMENTS - 1.0))
    value, size = fitted.causes[index].values[0], fitted.causes[index].hypothesis.free[0]
    sizes = value * np.exp(apart @ moved) if size.logarithmic else value + apart @ moved
    t = fitted.record.t
    return Constancy(float(-score @ moved), tuple(float(t[min(c, rows - 1)]) for c in cuts), tuple(map(float, sizes)),
                     tuple(map(float, alone * (abs(value) if size.logarithmic else 1.0))))


def _cuts(own: np.ndarray, rows: int) -> list[int]:
    """(9,) rows at which segments of equal information end, of a size with slopes own (3n,)."""
    total = np.cumsum(np.sum((own * own).reshape(rows, -1), axis=1))
    return [0, *map(int, np.searchsorted(total, total[-1] * np.arange(1, SEGMENTS) / SEGMENTS)), rows]


def _within(slopes: np.ndarray, of: np.ndarray) -> np.ndarray:
    """The part of `of` (m,) or (m, j) that columns of slopes (m, k) make."""
    basis = orthonormal(slopes / norms(slopes))[0]
    share = np.einsum("nk,n...->k...", basis, of)
    return np.asarray(np.einsum("nk,k...->n...", basis, share))
