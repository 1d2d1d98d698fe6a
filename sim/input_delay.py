"""By how much beta leads what it causes, out of a log alone."""

import itertools
import math

import numpy as np

from launchid_core import Config

from .lacking import PIECE, SHIFTS, STARTS
from .log import Log
from .sums import combined, inner, least_squares, square
from .weak_form import Rows, increments, left, term_integrals, usable

SEARCHED = 0.5       # of the gain at the best delay, which was sought, that a placebo, which was not, may have
MOST_DELAY = 0.3     # s either way


def delay(log: Log, config: Config) -> dict[str, float] | None:
    """By how much the beta of a log leads [s], and its standard deviation; None where beta explains nothing."""
    rows = usable(log)
    return None if rows is None else lead_of(rows, config.terms)


def lead_of(rows: Rows, terms: tuple[str, ...]) -> dict[str, float] | None:
    """By how much beta leads what it causes through the terms, as of `delay`: the shift at which it explains most."""
    if not any("beta" in term for term in terms):
        return None
    pieces, stride = pieces_of(rows), max(1, rows.span // STARTS)
    own = [k for k, term in enumerate(terms) if "beta" not in term]

    def of(at: slice, beta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        made = increments(rows.t[at], np.column_stack([term_integrals(rows, at, terms, beta),
                                                       rows.theta_dot[at]]), rows.span, stride)[1]
        return made[:, :-1], made[:, -1]

    def explained(beta: np.ndarray) -> float:
        total = 0.0
        for at in pieces:
            phi, y = of(at, beta)
            if len(y) > len(terms):
                total += float(np.sum(left(phi[:, own], y) ** 2) - np.sum(left(phi, y) ** 2))
        return total

    def moved(lead: float) -> np.ndarray:
        return np.interp(rows.t - lead, rows.t, rows.beta)

    step = max(rows.period, MOST_DELAY / 60.0)
    most = round(MOST_DELAY / step)
    gains = [explained(moved(k * step)) for k in range(-most, most + 1)]
    best = int(np.argmax(gains))
    vain = [explained(np.roll(rows.beta, round(share * len(rows.t)))) for share in SHIFTS]
    if not gains[best] > 0.0 or best in (0, 2 * most) or max(vain) >= SEARCHED * gains[best]:
        return None
    low, middle, high = gains[best - 1:best + 2]
    bend = low - 2.0 * middle + high
    value = (best - most) * step + (0.5 * step * (low - high) / bend if bend < 0.0 else 0.0)
    above = below = 0.0
    for at in pieces:
        phi, y = of(at, moved(value))
        if len(y) <= len(terms):
            continue
        xi = least_squares(phi, y)
        later, sooner = (of(at, moved(value + side * step))[0] for side in (1, -1))
        steep = left(phi, combined(later - sooner, xi) / (2.0 * step))
        v = steep * (y - combined(phi, xi))
        lags = min(2 * rows.span // stride, len(v) - 1)
        above += square(v) + 2.0 * sum((1.0 - k / (lags + 1)) * inner(v[k:], v[:-k]) for k in range(1, lags + 1))
        below += square(steep)
    if not (below > 0.0 and above >= 0.0):
        return None
    return {"value": value, "std": math.sqrt(above) / below}


def pieces_of(rows: Rows) -> list[slice]:
    """Pieces of about PIECE."""
    count = max(1, round((rows.t[-1] - rows.t[0]) / PIECE))
    edges = np.linspace(0, len(rows.t), count + 1).astype(int).tolist()
    return [slice(a, b) for a, b in itertools.pairwise(edges)]
