"""The time by which beta leads what it causes, from a log alone."""

import itertools
import math
from typing import NamedTuple

import numpy as np

from launchid_core import Config

from ..log.log import Log
from ..sums import along, combined, inner, least_squares, orthonormal, square
from .missing_terms import PIECE, SHIFTS, STARTS
from .weak_form import Rows, increments, left, term_integrals, thinned, usable

SURE = 3.0           # standard deviations by which beta must lead or lag
SEARCHED = 0.5       # of the gain at the best delay, which was sought, that a placebo, which was not, may have
MOST_DELAY = 0.3     # s either way
COARSE = 12          # steps of the first search either way, in each of which the second makes as many


class Lead(NamedTuple):
    """The time by which beta leads what it causes [s], and its standard deviation.

    is_vain  a beta of another time explains nearly as much: of a search for the best shift that is no proof
    """

    value: float
    std: float
    is_vain: bool

    @property
    def json(self) -> dict[str, float] | None:
        """The delay as the JSON has it; None where it is not proved."""
        return None if self.is_vain else {"value": self.value, "std": self.std}

    def significant(self) -> float | None:
        """The shift [s]; None where it may be 0, or is to before the cause without proof."""
        is_one = abs(self.value) > SURE * self.std and not (self.is_vain and self.value < 0.0)
        return self.value if is_one else None


def delay(log: Log, config: Config) -> Lead | None:
    """The time by which the beta of a log leads; None where beta explains nothing."""
    rows = usable(log)
    rows = None if rows is None else thinned(rows)
    return None if rows is None else lead_of(rows, config.terms)


class Stretch(NamedTuple):
    """A piece of a log: its rows, how many of them there are from an increment to the next; what the terms without beta
    leave of the increments of theta_dot, y (k,), and an orthonormal basis of theirs (k, q)."""

    at: slice
    stride: int
    y: np.ndarray
    basis: np.ndarray

    def columns(self, rows: Rows, terms: tuple[str, ...], beta: np.ndarray) -> np.ndarray:
        """The rest (k, b) that the terms without beta leave of the increments of those in a beta (n,)."""
        integrals = term_integrals(rows, self.at, terms, beta)
        steps = increments(rows.t[self.at], integrals, rows.span, self.stride)[1]
        return steps - np.column_stack([combined(self.basis, along(self.basis, x)) for x in steps.T])


def lead_of(rows: Rows, terms: tuple[str, ...]) -> Lead | None:
    """The time by which beta leads what it causes through the terms, as in `delay`: the shift at which it explains
    most."""
    inputs = tuple(term for term in terms if "beta" in term)
    if not inputs:
        return None
    stretches = [stretch for at in pieces_of(rows) if (stretch := _stretch(rows, at, terms)) is not None]

    def explained(beta: np.ndarray) -> float:
        return sum(square(each.y) - square(left(each.columns(rows, inputs, beta), each.y)) for each in stretches)

    def moved(lead: float) -> np.ndarray:
        return np.interp(rows.t - lead, rows.t, rows.beta)

    def gain(step: int) -> float:
        if step not in gains:
            gains[step] = explained(moved(step * fine))
        return gains[step]

    fine, gains = max(rows.period, MOST_DELAY / (COARSE * COARSE)), dict[int, float]()
    most = round(MOST_DELAY / fine)
    stride = max(1, round(most / COARSE))
    near = max(range(-most // stride * stride, most + 1, stride), key=gain)
    best = max(range(max(near - stride, -most), min(near + stride, most) + 1), key=gain)
    vain = max(explained(np.roll(rows.beta, round(share * len(rows.t)))) for share in SHIFTS)
    if not gain(best) > 0.0 or abs(best) >= most:
        return None
    low, middle, high = (gain(best + side) for side in (-1, 0, 1))
    bend = low - 2.0 * middle + high
    value = best * fine + (0.5 * fine * (low - high) / bend if bend < 0.0 else 0.0)
    above = below = 0.0
    for each in stretches:
        phi = each.columns(rows, inputs, moved(value))
        xi = least_squares(phi, each.y)
        later, sooner = (each.columns(rows, inputs, moved(value + side * fine)) for side in (1, -1))
        steep = left(phi, combined(later - sooner, xi) / (2.0 * fine))
        v = steep * (each.y - combined(phi, xi))
        lags = min(2 * rows.span // each.stride, len(v) - 1)
        above += square(v) + 2.0 * sum((1.0 - k / (lags + 1)) * inner(v[k:], v[:-k]) for k in range(1, lags + 1))
        below += square(steep)
    if not (below > 0.0 and above >= 0.0):
        return None
    return Lead(value, math.sqrt(above) / below, vain >= SEARCHED * gain(best))


def _stretch(rows: Rows, at: slice, terms: tuple[str, ...]) -> Stretch | None:
    """A piece; None where it has too few increments to say anything."""
    stride = max(1, rows.span // STARTS)
    others = tuple(term for term in terms if "beta" not in term)
    integrals = np.column_stack([term_integrals(rows, at, others, rows.beta), rows.theta_dot[at]])
    steps = increments(rows.t[at], integrals, rows.span, stride)[1]
    if len(steps) <= len(terms):
        return None
    basis = orthonormal(steps[:, :-1])[0]
    y = steps[:, -1] - combined(basis, along(basis, steps[:, -1]))
    return Stretch(at, stride, y, basis)


def pieces_of(rows: Rows) -> list[slice]:
    """Pieces of about PIECE, each of a few increments at least."""
    count = max(1, min(round(len(rows.t) * rows.period / PIECE), len(rows.t) // (4 * rows.span)))
    edges = np.linspace(0, len(rows.t), count + 1).astype(int).tolist()
    return [slice(a, b) for a, b in itertools.pairwise(edges)]
