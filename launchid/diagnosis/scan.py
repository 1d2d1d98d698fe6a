"""Scan for shapes beyond the usual numbers that would explain more, by superposition on the whitened innovations.

A small forcing changes the innovations linearly, about the filter's path (`likelihood.respond`).  Its column, less what
the free numbers can make of it, times the innovations is the amplitude; the square of that over the column's own is
what fitting it would save (Willsky and Jones 1976).  The places of the best are refined with everything else free.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..likelihood.estimate import Fit, Table, evaluate, gauss_newton, gram, inverse, refreshed, slopes
from ..sums import along, combined
from .candidates import CANDIDATE_KINDS, LINES, Kind, Shape, lines_in
from .elimination import EVENT, MIN_SQUARES_SAVED, RIVAL_MARGIN, RIVAL_SHARE, TWIN_Z, Elimination, Kept
from .model import Model
from .score import compare, left_out

SQUARES_PROMISED = 25.0  # squares that a shape must promise: chance gives the best of 400 places 12
EACH = 6.0             # squares that every number beyond the first must promise besides
CHI_SQUARE_MEDIAN = 0.455  # of one degree: what a number saves by chance, in the middle
LOW_OVERLAP = 0.02     # of a column that the free numbers do not make: less is theirs


class Found(NamedTuple):
    """A candidate's best nonlinear values, its amplitudes there, and the squares that fitting it would save.

    chance: of an event, times the squares of white errors that it saves at the other times of the log once it is
    taken away at its best, at least 1
    """

    kind: Kind
    values: tuple[float, ...]
    sizes: np.ndarray
    saves: float
    chance: float = 1.0


class Scanner:
    """Tries shapes against the innovations of a fit, less what its free numbers can explain: y - J A^-1 J' y."""

    def __init__(self, m: Model, fit: Fit) -> None:
        fit = refreshed(m, fit)
        e, self.run = fit.e, fit.run
        self.m = m.settled(fit.run)
        self.J = np.ascontiguousarray(fit.J.T)
        C = inverse(m, fit)
        self.twice = C @ (gram(fit.J) @ C) - 2.0 * C
        self.e = e - combined(fit.J, C @ along(fit.J, e))

    def responses(self, kind: Kind, values: tuple[float, ...]) -> np.ndarray:
        """Return the changes (c, r) of the whitened innovations by a kind's columns at these nonlinear values."""
        m, none, still = self.m, np.zeros(self.m.log.n), np.zeros((self.m.log.n, 3))
        return np.array([m.response(self.run, none if force is None else force, none if command is None
                                    else command.mean(axis=1), still if shift is None else shift)
                         for force, command, shift in kind.make(m, *values)])

    def tried(self, kind: Kind, values: tuple[float, ...]) -> Found:
        """Return a kind's best amplitudes and the squares they save at these nonlinear values."""
        return Found(kind, values, *self.saved(self.responses(kind, values)))

    def saved(self, Y: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the best amplitudes (c,) of columns Y (c, r), slopes of the whitened innovations, and the squares that
        they save; 0 where the free numbers make the columns."""
        G, size = self.apart(Y)
        b = -np.einsum("cn,n->c", Y, self.e)
        if not np.all(np.isfinite(G)) or np.any(np.diag(G) < LOW_OVERLAP * size):
            return np.zeros(len(b)), 0.0
        G[np.diag_indices_from(G)] *= 1.0 + 1e-9
        sizes = np.linalg.solve(G + 1e-300 * np.eye(len(b)), b)
        return sizes, float(b @ sizes)

    def apart(self, Y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return products (c, c) of what the free numbers do not make of columns Y (c, r), and the columns' squares."""
        V, size = np.einsum("kn,cn->ck", self.J, Y), np.einsum("cn,dn->cd", Y, Y)
        return size + V @ self.twice @ V.T, np.diag(size)

    def told(self, found: Found) -> float:
        """Return the squares by which a shape of its size is told from what the free numbers make of it."""
        return float(found.sizes @ self.apart(self.responses(found.kind, found.values))[0] @ found.sizes)

    def best(self, kind: Kind) -> Found | None:
        """Return the nonlinear values at which a kind saves most; None if it does not fit the log, or has none."""
        m = self.m
        if not kind.fits(m) or not (kind.cause or m.log.is_flown):
            return None
        starts = kind.starts(m)
        if kind.name in LINES:
            climbs = kind.name == "chirp"
            starts = [x for ch in (1, 0) if np.any(m.log.channel == ch) for x in lines_in(m, self.e, ch, climbs)]
        found = [self.tried(kind, values) for values in starts]
        best = max(found, key=lambda each: each.saves, default=None)
        if best is None or not starts[0]:
            return best and best._replace(saves=best.saves - EACH * (kind.linear - 1))
        span, n = m.log.span, kind.linear
        reach = {"time": 0.01 * span} | ({"frequency": 2.0 / span, "climb": 8.0 / span**2} if n > 1 else {})
        shares = {"frequency": 0.12, "damping_ratio": 0.5}
        for scale in (0.5, 0.2, 0.08):       # of the distance to its neighbours
            for i, (name, (_, low, high)) in enumerate(zip(kind.parameters[n:], kind.bounds, strict=True)):
                away = scale * reach.get(name, shares.get(name, 0.3) * best.values[i])
                for x in [best.values[i] + part * away for part in (-2.0, -1.0, 1.0, 2.0)]:
                    if low < x < high:
                        again = self.tried(kind, (*best.values[:i], float(x), *best.values[i + 1:]))
                        best = again if again.saves > best.saves else best
        chance = self.chance(best, starts) if kind.once and best.saves > SQUARES_PROMISED else 1.0
        return best._replace(saves=best.saves / chance - EACH * (n + len(best.values) - 1), chance=chance)


    def chance(self, best: Found, starts: list[tuple[float, ...]]) -> float:
        """Return how many times the squares of white errors an event saves at `starts`, in the middle, beside its best:
        what it is not there for, such as a disturbance that wanders, it explains everywhere."""
        Y = np.concatenate([self.responses(best.kind, values) for values in (best.values, *starts)])
        V, size = np.einsum("kn,cn->ck", self.J, Y), np.einsum("cn,cn->c", Y, Y)
        own = size + np.einsum("ck,ck->c", V @ self.twice, V)
        with_best = np.einsum("cn,n->c", Y, Y[0]) + V @ (self.twice @ V[0])
        left = own - with_best**2 / max(own[0], 1e-300)
        saves = (np.einsum("cn,n->c", Y, self.e) + with_best * best.sizes[0])**2 / np.maximum(left, 1e-300)
        there = left[1:] > LOW_OVERLAP * size[1:]
        return max(1.0, float(np.median(saves[1:][there])) / CHI_SQUARE_MEDIAN) if there.any() else 1.0


@np.errstate(over="ignore", invalid="ignore")   # of a nominal that diverges: what overflows promises nothing
def scan(m: Model, fit: Fit) -> tuple[Model, list[Found]]:
    """Return the model settled on the fit's motion, and each kind that promises more than SQUARES_PROMISED at its best
    values, the best first."""
    s = Scanner(m, fit)
    found = [each for kind in CANDIDATE_KINDS if (each := s.best(kind)) is not None and each.saves > SQUARES_PROMISED]
    return s.m, sorted(found, key=lambda each: -each.saves)


def with_shape(m: Model, p: np.ndarray, found: Found) -> tuple[Model, np.ndarray]:
    """Return the model with a found shape in its table, and the numbers p with the shape's, at the values found."""
    mark = f"{found.kind.name}#{sum(shape.kind is found.kind for shape in m.shapes)}."
    shape = Shape(found.kind, tuple(mark + each for each in found.kind.parameters), found.chance)
    table = Table.of([*m.table.numbers, *found.kind.numbers(m, shape, found.values)])
    return replace(m, table=table, shapes=(*m.shapes, shape)), np.concatenate([p, found.sizes, found.values])


def with_rivals(m: Model, el: Elimination) -> tuple[Model, np.ndarray]:
    """Return the model with the shapes added that do in the place of a number kept as well as it does, and the numbers
    of the full fit with theirs; as they are if none does.

    Along one motion a shape is much like a number of the same place: theta^2 like theta^3, a loss like a k1 that falls,
    a servo's curve like its gain.  Beside the number the scan finds nothing of it.
    """
    there, p, wanted = {shape.kind.name for shape in m.shapes}, el.full.p, {}
    beside = Scanner(m, el.final)
    for k in el.kept:
        free = tuple(j for j in el.final.free if j not in k.group.numbers)
        at = evaluate(m, k.without)
        without = Scanner(m, Fit(at.p, at.e, slopes(m, at, free), free, el.final.band, at.run))
        own = without.saved(slopes(m, at, k.group.numbers[:k.group.linear]).T)[1]
        for kind in CANDIDATE_KINDS:
            is_line = kind.name in LINES and (k.group.is_listed or not kind.cause)
            if kind.place != k.group.place or is_line or (kind.name in there and not kind.once):
                continue
            found = without.best(kind)
            if found is not None and found.saves * found.chance > RIVAL_SHARE * own:
                again = in_place(m, el, k, found)
                # a loss that began with the log is a k1
                if again is not None and (not kind.once or beside.told(again) > EVENT):
                    wanted[kind.name] = again
    for found in wanted.values():
        m, p = with_shape(m, p, found)
    return m, p


def in_place(m: Model, el: Elimination, k: Kept, found: Found) -> Found | None:
    """Return a shape as fitted in the place of a kept number; None if it leaves larger errors on left-out rows.  An
    event must leave smaller ones, for a time that is searched for saves something by itself; what is in no list clearly
    smaller ones."""
    wider, p = with_shape(m, k.without, found)
    own = range(len(k.without), len(p))
    fit = gauss_newton(wider, p, (*(j for j in el.final.free if j not in k.group.numbers), *own), el.final.band, 2)
    costs, error = compare(wider, left_out(wider, fit), el.e_final, el.unit)
    most = max(TWIN_Z * error, MIN_SQUARES_SAVED, RIVAL_MARGIN * k.gain)
    if costs > (-most if not found.kind.cause else 0.0 if found.kind.once else most):
        return None
    sizes, values = np.split(fit.p[list(own)], [found.kind.linear])
    return found._replace(values=tuple(values), sizes=sizes)
