"""Is the size of a named cause the same in every part of the log?  A true cause's is (score test over segments of equal
information; Nyblom 1989, Andrews 1993 for the idea).  Fit and whiteness do not stop a wrong name; this does."""

import itertools
from dataclasses import dataclass

import numpy as np

from ..search.profile import Model
from ..search.scan import norms

SEGMENTS = 8
CONSTANCY_LIMIT = 40.0     # chi-squared of 7 degrees of freedom: true causes reached 31, foreign ones began at 47


@dataclass(frozen=True)
class Constancy:
    """Size of one cause per segment.

    t      (9,) [s] the segments' ends;  size, std (8,) of the size in each
    """

    chi_squared: float
    t: tuple[float, ...]
    size: tuple[float, ...]
    std: tuple[float, ...]


def constancy(model: Model, index: int) -> Constancy:
    """Is the size of cause `index` the same all along?"""
    fitted = model.fit
    column = sum(len(cause.values) for cause in fitted.causes[:index])
    slopes, r = fitted.slopes, fitted.whitened.ravel()
    own = slopes[:, column]
    others = np.delete(slopes, column, axis=1)
    basis, _ = np.linalg.qr(others / norms(others))
    own = own - basis @ (basis.T @ own)
    rows = len(fitted.whitened)
    energy = np.sum((own * own).reshape(rows, -1), axis=1)
    score = np.sum((own * r).reshape(rows, -1), axis=1)
    total = np.cumsum(energy)
    cuts = [0, *np.searchsorted(total, total[-1] * np.arange(1, SEGMENTS) / SEGMENTS), rows]
    t = fitted.record.t
    information = np.array([energy[a:b].sum() for a, b in itertools.pairwise(cuts)])
    slope = np.array([score[a:b].sum() for a, b in itertools.pairwise(cuts)])
    information = np.maximum(information, 1e-12 * total[-1] + 1e-300)
    moved = -slope / information
    chi = float(np.sum(slope**2 / information) - np.sum(slope)**2 / np.sum(information))
    value = fitted.causes[index].values[0]
    size = fitted.causes[index].hypothesis.free[0]
    sizes = value * np.exp(moved) if size.logarithmic else value + moved
    spread = 1.0 / np.sqrt(information) * (value if size.logarithmic else 1.0)
    ends = [float(t[min(c, rows - 1)]) for c in cuts]
    return Constancy(chi, tuple(ends), tuple(map(float, sizes)), tuple(map(float, spread)))
