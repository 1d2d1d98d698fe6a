"""Backward elimination: one loop over one score.

From the fit with everything free, the group of numbers that costs least goes back to the nominal, until every one that
is left costs more on left-out blocks than its error.  A number that the nominal gives with a tolerance goes back into
its band, not to its value.  (Efroymson 1960, with the score of `score`.)
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from sim.effects import CATALOGUE

from ..likelihood.estimate import Fit, evaluate, gauss_newton, gram, inverse, objective, slopes
from ..selection import step_by_step
from ..sums import along, combined, square
from .model import Model
from .numbers import KINEMATIC
from .score import compare, deviations, left_out

Z = 2.3                # standard errors that a number must save on left-out blocks
MIN_SQUARES_SAVED = 8.0  # squares that it must save: 4 nats
NAME_SHARE = 0.05      # of what the full model saves, that it must save
EVENT = 28.0           # squares that is to save what fewer errors or no blocks vouch for: it may be the best of many
BESIDE_EVENT = 0.2     # of what the largest saves, that an event beside it must save: less is the rest of its shape
FREELY = 2.0           # squares that numbers may cost by the information and go at once, untried
HOLDS = 0.1            # of the squares of a change of the errors, by which slopes may tell it wrong and still be taken
TRIES = 3              # groups tried in a step, the cheapest first
EARLIER = 0.3          # of two that cost alike, the one whose cause is rare goes first, as if it cost so much of it
PRODUCTS = {"theta^2", "theta*theta_dot", "theta_dot^2", "theta*beta", "theta_dot*beta"}   # terms of the second order
RARE = {"washout", "lag", "cubic", "term beta^2", "inertia", "gyro_scale", "friction", "k1_slope", "lateral_drift",
        *PRODUCTS}
SHAPES_OF_NUMBERS = {"cubic", "sine", "term beta^2", "friction", *PRODUCTS}
SHAPE_Z = 4.0          # standard errors that a curve of the motion must save, or any number beside a wrong sensor
MOST = 0.5             # of what the full model saves: what saves less is not the cause
ONE_OF = 12.0          # squares by which one of a set of twins may be worse than all of them, to stand for them
AT_END = 0.01          # of an end of a shape's range, within which it stands at it
RIVAL_SHARE = 0.6      # of what another saves, from which a rival is fitted in its place
RIVAL_MARGIN = 0.02    # of what a cause saves, within which another in its place does as well
SAME_EFFECT = ((("null_angle", "nozzle_bias"), "misalignment"),)   # two, of opposite signs, do what one does
SAME_LAW = {"washout": "damping", "damping": "washout"}   # of a vehicle without stiffness, at the same value [1/s]
ALIKE_Z = 1.0          # standard errors within which another number does as well
TWIN_Z = 2.0           # the same of one that correlates beyond TWIN
TWIN = 0.9             # correlation in the full fit
RELATED_CORRELATION = 0.3  # correlation from which another is tried in its place


@dataclass(frozen=True)
class Group:
    """Numbers that are eliminated together: indices, the first `linear` are sizes, 0 or nominal where the group is out.
    kind: its name without a count; cause in the catalogue's words ("": none)."""

    name: str
    kind: str
    numbers: tuple[int, ...]
    linear: int
    cause: str
    place: str
    is_event: bool = False
    has_band: bool = False
    is_listed: bool = True
    chance: float = 1.0


@dataclass(frozen=True, eq=False)
class Kept:
    """A group that stayed: squares saved on left-out blocks (gain), their standard error, share of what the full model
    saves; causes that do as well in its place; numbers `without` it."""

    group: Group
    gain: float
    error: float
    share: float
    alike: tuple[str, ...]
    without: np.ndarray
    std: dict[int, float]


@dataclass(frozen=True, eq=False)
class Elimination:
    """Fits and left-out errors (r,) of the nominal within its tolerances, of everything free, of the groups kept."""

    nominal: Fit
    full: Fit
    final: Fit
    e_nominal: np.ndarray
    e_full: np.ndarray
    e_final: np.ndarray
    unit: float                   # variance of a left-out whitened error
    kept: tuple[Kept, ...] = ()
    std_full: dict[int, float] = field(default_factory=dict)
    notes: tuple[int, ...] = ()

    @property
    def removable(self) -> float:
        best = min(square(self.e_full), square(self.e_final))
        return max(square(self.e_nominal) - best, 1e-9)


class Left(NamedTuple):
    """Groups left in a model, its fit and left-out errors e (r,), the least left-out errors met on the way there."""

    groups: list[Group]
    fit: Fit
    e: np.ndarray
    least: np.ndarray


def groups_of(m: Model, notes: frozenset[int]) -> list[Group]:
    """Return the groups to eliminate: each usual number by itself, each shape's numbers together; `notes` in none."""
    inside = {name for shape in m.shapes for name in shape.names}
    out = [Group(each.name, each.name, (j,), 1, each.cause, CATALOGUE[each.cause].where if each.cause else "plant",
                 has_band=each.tol > 0.0)
           for j, each in enumerate(m.table.numbers) if each.name not in inside and j not in notes]
    for shape in m.shapes:
        kind, numbers = shape.kind, tuple(m.table.index(name) for name in shape.names)
        chance = min(each.chance for each in m.shapes if each.kind is kind)   # of the first, others were unknown then
        out.append(Group(shape.names[0].partition(".")[0], kind.name, numbers, kind.linear, kind.cause, kind.place,
                         is_event=kind.once, is_listed=bool(kind.cause), chance=chance))
    return out


class Search:
    """The backward elimination of one model's groups; `run` does it."""

    def __init__(self, m: Model, notes: frozenset[int] = frozenset()) -> None:
        self.m, self.notes = m, notes
        self.groups = groups_of(m, notes)

    def nearest(self, j: int, value: float) -> float:
        null, tol = self.m.table.null[j], self.m.table.tol[j]
        return float(np.clip(value, null - tol, null + tol))

    def cost(self, fit: Fit, covariance: np.ndarray, groups: list[Group]) -> float:
        """Return the squares that it costs to put the groups back at the nominal, by the information (Wald 1943)."""
        numbers = [j for g in groups for j in g.numbers[:g.linear]]
        d = np.array([fit.p[j] - self.nearest(j, fit.p[j]) for j in numbers])
        at = [fit.at(j) for j in numbers]
        C = covariance[np.ix_(at, at)]
        return float(d @ np.linalg.solve(C + 1e-12 * np.diag(np.diag(C)) + 1e-300 * np.eye(len(d)), d))

    def without(self, fit: Fit, groups: list[Group], rounds: int = 2) -> Fit:
        """Return the fit with these groups back at the nominal, others moved as the information says, and refitted."""
        m = self.m
        covariance = inverse(m, fit)
        numbers = [j for g in groups for j in g.numbers[:g.linear]]
        gone = {j for g in groups for j in g.numbers if not g.has_band}
        at = [fit.at(j) for j in numbers]
        d = np.array([self.nearest(j, fit.p[j]) - fit.p[j] for j in numbers])
        C = covariance[np.ix_(at, at)]
        q = fit.p.copy()
        q[list(fit.free)] += covariance[:, at] @ np.linalg.solve(C + 1e-12 * np.diag(np.diag(C)), d)
        band = fit.band | {j for g in groups if g.has_band for j in g.numbers}
        for j in band:
            q[j] = self.nearest(j, q[j])
        q[list(gone)] = m.table.null[list(gone)]
        r, back = fit.p.copy(), [*band, *gone]
        r[back] = q[back]
        q = np.clip(q, m.table.low, m.table.high)
        kept = [i for i, j in enumerate(fit.free) if j not in gone]
        free = tuple(fit.free[i] for i in kept)
        e = evaluate(m, q).e
        if not np.all(np.isfinite(q)) or square(evaluate(m, r).e) < square(e):
            return gauss_newton(m, r, free, band, rounds)
        told = combined(fit.J, (q - fit.p)[list(fit.free)])
        holds = square(e - fit.e - told) < HOLDS * square(told)
        return gauss_newton(m, q, free, band, rounds, fit.J[:, kept] if holds else None)

    def is_at_an_end(self, fit: Fit, group: Group) -> bool:
        """Whether a shape stands at an end of its range: it then fits what another leaves, and is none of its kind."""
        m, times = self.m, group.numbers[group.linear:][:group.is_event]   # an event's first is its time
        return any(not m.log.t[0] < fit.p[j] < m.log.t[-2] for j in times) or any(
            not m.table.low[j] * (1.0 + AT_END) < fit.p[j] < m.table.high[j] * (1.0 - AT_END)
            for j in group.numbers[group.linear:] if m.table.low[j] > 0.0)

    def is_needed(self, group: Group, gain: float, error: float, removable: float) -> bool:
        """Whether a group, without which rows left out are worse by `gain` squares (+- error), has to stay; removable:
        what the full model saves over the nominal."""
        if gain < self.m.log.unsure and not group.is_event and group.name not in KINEMATIC:
            return False     # wrong commands part no columns; an event pays for what they feign by its chance
        if group.name == "inertia" and not self.m.log.is_commanded and gain < MOST * removable:
            return False     # rows of a measured input that moves between them feign a little of it
        if group.is_event:
            return gain > EVENT * group.chance and gain > NAME_SHARE * removable
        if group.name not in KINEMATIC and gain > SHAPE_Z * error:
            removable -= self.by_sensors
        return gain > Z * error and gain > MIN_SQUARES_SAVED and gain > NAME_SHARE * removable

    def run(self, p: np.ndarray) -> Elimination:
        """Eliminate, starting from all numbers free at p; return fits, errors and the groups kept."""
        m = self.m
        everything = tuple(range(len(m.table.numbers)))
        full = gauss_newton(m, p, everything, frozenset(), 4)
        return self.ended(full, left_out(m, full), full, self.groups)

    def go_on(self, el: Elimination, p: np.ndarray) -> Elimination:
        """Eliminate again what an elimination kept, beside shapes that were added to the model since; p: the numbers of
        its full fit with theirs."""
        m, n = self.m, len(el.full.p)
        added, sizes = tuple(range(n, len(p))), [j for g in self.groups for j in g.numbers[:g.linear] if j >= n]
        q = p.copy()
        q[sizes] = 0.0
        J = slopes(m, el.full._replace(p=q), added)   # where their sizes are 0 they change nothing
        full = el.full._replace(p=p, J=np.column_stack([el.full.J, J]), free=(*el.full.free, *added))
        q = np.concatenate([el.final.p, p[n:]])
        fit = gauss_newton(m, q, (*el.final.free, *added), el.final.band, 3)
        kept = {k.group.name for k in el.kept}
        live = [g for g in self.groups if g.name in kept or g.numbers[0] >= n]
        return self.ended(full, el.e_full, fit, live)

    def ended(self, full: Fit, e_full: np.ndarray, fit: Fit, live: list[Group]) -> Elimination:
        """Take the groups `live` away from a fit, beginning with it; full, e_full: everything free, its left-out
        errors."""
        m = self.m
        self.full = full
        self.unit = max(float(np.mean(e_full**2)), 0.2)
        std_full = deviations(m, full, self.unit)
        band = frozenset(j for g in self.groups if g.has_band for j in g.numbers)
        start = tuple(sorted(band | self.notes))
        nominal = gauss_newton(m, m.table.null.copy(), start, band, 3)
        e_nominal = left_out(m, nominal)
        sensors = {m.table.index(name) for name in KINEMATIC if name in m.table}
        alone = gauss_newton(m, nominal.p, tuple(sorted(band | sensors)), band - sensors, 3)
        self.by_sensors = max(square(e_nominal) - square(left_out(m, alone)), 0.0)
        C = inverse(m, full)
        s = 1.0 / np.sqrt(np.diag(C))
        self.correlation = np.abs(C * np.outer(s, s))
        e_begin = e_full if fit is full else left_out(m, fit)
        fit, live, best, e_end = self.take_away(fit, live, e_nominal, e_begin)
        fit, live, e_end = self.by_one(fit, live, e_end)
        fit = fit._replace(J=slopes(m, fit, fit.free))
        kept, fit, e_end, live, idle = self.judged(fit, live, e_nominal, best, e_end)
        while kept and idle:      # they hide what the others are worth
            kept, fit, e_end, live, idle = self.judged_without(idle, fit, live, e_nominal, best)
        names = [k.group for k in kept]
        if gone := [g for g in live if g not in names]:   # a name that stands by what is not needed is none
            fewer = self.judged_without(gone, fit, names, e_nominal, best)
            if [k.group for k in fewer[0]] != names:
                kept, fit, e_end, live, _ = fewer
        if not kept:
            fit, e_end = nominal, e_nominal
        return Elimination(nominal, full, fit, e_nominal, e_full, e_end, self.unit, kept, std_full, tuple(self.notes))

    def related(self, a: Group, b: Group) -> float:
        """Return the largest |correlation| between sizes of two groups in the full fit."""
        return max(float(self.correlation[i, j]) for i in a.numbers[:a.linear] for j in b.numbers[:b.linear])

    def clusters(self, live: list[Group]) -> list[list[Group]]:
        """Return the sets of groups that correlate beyond TWIN, directly or through others."""
        left, out = list(live), []
        while left:
            cluster = [left.pop(0)]
            for one in cluster:
                for other in [g for g in left if self.related(one, g) > TWIN]:
                    cluster.append(other)
                    left.remove(other)
            if len(cluster) > 1:
                out.append(cluster)
        return out

    def take_away(self, fit: Fit, live: list[Group], e_nominal: np.ndarray,
                  e_end: np.ndarray) -> tuple[Fit, list[Group], np.ndarray, np.ndarray]:
        """Take groups away while errors allow it; return fit, groups left, best left-out errors, the fit's."""
        m, live = self.m, list(live)
        least = e_end
        for cluster in self.clusters(live):
            C = inverse(m, fit)
            others = [[g for g in cluster if g is not one] for one in cluster]
            cost, k = min((self.cost(fit, C, rest), k) for k, rest in enumerate(others))
            if cost < ONE_OF:
                fit = self.without(fit, others[k])
                e_end = left_out(m, fit)
                live = [g for g in live if g not in others[k]]
        start = Left(live, fit, e_end, least)
        if len(together := self.costless(start)) > 1:
            less = self.less(start, together)
            gain, error = compare(m, less.e, start.e, self.unit)
            start = less if gain < max(error, MIN_SQUARES_SAVED) else start

        def smaller(now: Left) -> Iterator[Left]:
            return (self.less(now, [g]) for g in self.by_cost(now)[:TRIES])

        def takes_over(less: Left, now: Left) -> bool:
            gone = next(g for g in now.groups if g not in less.groups)
            gain, error = compare(m, less.e, now.least, self.unit)
            removable = max(square(e_nominal) - square(now.least), 1e-9)
            return self.is_at_an_end(now.fit, gone) or not self.is_needed(gone, gain, error, removable)

        end = step_by_step(start, smaller, takes_over)
        return end.fit, end.groups, end.least, end.e

    def less(self, now: Left, gone: list[Group]) -> Left:
        """Return what is left without the groups `gone`."""
        fit = self.without(now.fit, gone)
        e = left_out(self.m, fit)
        return Left([g for g in now.groups if g not in gone], fit, e, e if square(e) < square(now.least) else now.least)

    def by_cost(self, now: Left) -> list[Group]:
        """Return the groups left, those first whose absence costs least by the information; of a rare cause sooner."""
        C = inverse(self.m, now.fit)
        return sorted(now.groups, key=lambda g: self.cost(now.fit, C, [g]) * (EARLIER if g.kind in RARE else 1.0))

    def costless(self, now: Left) -> list[Group]:
        """Return the groups left that together cost nothing by the information."""
        C, order, most = inverse(self.m, now.fit), self.by_cost(now), 0
        while most < len(order) and self.cost(now.fit, C, [order[most]]) <= FREELY and \
                self.cost(now.fit, C, order[:most + 1]) <= FREELY * (most + 1)**0.5:
            most += 1
        return order[:most]

    def by_one(self, fit: Fit, live: list[Group], e_end: np.ndarray) -> tuple[Fit, list[Group], np.ndarray]:
        """Replace two numbers by one that has the effect of both, where the errors on rows left out do not grow; return
        fit, groups left, left-out errors."""
        named = {g.name: g for g in self.groups}
        for pair, one in SAME_EFFECT:
            two = [g for g in live if g.name in pair]
            if len(two) < len(pair) or one not in named:
                continue
            rest = self.without(fit, two, 3)
            again = rest if named[one] in live else self.with_other(rest, named[one]) or rest
            e = left_out(self.m, again)
            gain, error = compare(self.m, e, e_end, self.unit)
            if gain < ALIKE_Z * error:
                fit, e_end, live = again, e, [*(g for g in live if g not in two and g is not named[one]), named[one]]
        return fit, live, e_end

    def judged(self, fit: Fit, live: list[Group], e_nominal: np.ndarray, best: np.ndarray,
               e_end: np.ndarray) -> tuple[tuple[Kept, ...], Fit, np.ndarray, list[Group], list[Group]]:
        """Judge what each group left saves when it is taken away last, and let a better rival replace it.  Return
        groups kept, fit, left-out errors, groups left, idle ones (at an end of their range, or hardly off the
        nominal)."""
        m = self.m
        for turn in range(3):
            kept, swap = [], None
            std = deviations(m, fit, self.unit)
            removable = max(square(e_nominal) - min(square(best), square(e_end)), 1e-9)
            for g in live:
                rest = self.without(fit, [g], 3)
                e = left_out(m, rest)
                gain, error = compare(m, e, e_end, self.unit)
                alike = []
                for other in self.groups:
                    is_same = SAME_LAW.get(g.name) == other.name and not m.log.has_stiffness
                    if other is g or other in live or (self.related(g, other) < RELATED_CORRELATION and not is_same):
                        continue
                    most = objective(m, fit.e, fit.p) + (1.0 - RIVAL_SHARE) * max(gain, MIN_SQUARES_SAVED)
                    again = self.with_other(rest, other, fit.p[list(g.numbers)] if is_same else None, most)
                    if again is None or self.is_at_an_end(again, other):
                        continue
                    ei = left_out(m, again)
                    gi, si = compare(m, ei, e_end, self.unit)
                    is_common = g.kind in RARE and other.kind not in RARE and not other.is_event and gi < ALIKE_Z * si
                    pays = not (other.is_event and not g.is_event)   # a time searched for saves something by itself
                    margin = pays * RIVAL_MARGIN * gain
                    z = TWIN_Z if self.related(g, other) > TWIN else ALIKE_Z
                    is_alike = gi < z * pays * si or gi < margin
                    is_common |= is_alike and ((other.is_listed and not g.is_listed) or (is_same and g.kind in RARE))
                    is_simpler = g.is_event and not other.is_event and other.kind not in RARE   # it needs no time
                    is_common |= is_alike and is_simpler and other.is_listed
                    is_freer = (other.is_event and not g.is_event) or (g.is_listed and not other.is_listed)
                    clearly = max(z * si, RIVAL_MARGIN * gain) if is_freer else si
                    if (gi < -clearly or is_common) and swap is None and other.kind not in SHAPES_OF_NUMBERS:
                        swap = (again, [each for each in live if each is not g] + [other], ei)
                    if is_alike:
                        alike.append(other.cause)
                kept.append(Kept(g, gain, error, gain / removable, tuple(alike), rest.p, std))
            if swap is None or turn == 2:
                break
            fit, live, e_end = swap
        far = np.abs(fit.p - m.table.null)
        idle = [g for g in live if self.is_at_an_end(fit, g)
                or (g.linear == 1 and far[g.numbers[0]] <= 2.0 * std.get(g.numbers[0], 0.0))]
        kept = [k for k in kept if k.group not in idle and self.is_needed(k.group, k.gain, k.error, removable)]
        largest = max((k.gain for k in kept), default=0.0)
        kept = [k for k in kept if not k.group.is_event or k.gain > BESIDE_EVENT * largest]
        gain, error = compare(m, e_nominal, e_end, self.unit)
        if gain < MIN_SQUARES_SAVED or (gain < error and not any(k.group.is_event for k in kept)):
            kept = []
        return tuple(kept), fit, e_end, [g for g in live if g not in idle], idle

    def judged_without(self, gone: list[Group], fit: Fit, live: list[Group], e_nominal: np.ndarray,
                       best: np.ndarray) -> tuple[tuple[Kept, ...], Fit, np.ndarray, list[Group], list[Group]]:
        """Judge the groups `live` (as `judged`) with the groups `gone` back at their nominal values."""
        m, fit = self.m, self.without(fit, gone, 3)
        return self.judged(fit._replace(J=slopes(m, fit, fit.free)), live, e_nominal, best, left_out(m, fit))

    def with_other(self, rest: Fit, other: Group, start: np.ndarray | None = None,
                   most: float = math.inf) -> Fit | None:
        """Return the fit `rest`, from which a group is out, refitted with the group `other` in, from the numbers
        `start` (None: those of the full fit); None if by its slopes it leaves more than `most` squares."""
        m, p = self.m, rest.p.copy()
        p[list(other.numbers)] = self.full.p[list(other.numbers)] if start is None else start
        free = tuple(sorted({*rest.free, *other.numbers}))
        at = evaluate(m, p)
        new = slopes(m, at, other.numbers)
        J = np.column_stack([new[:, other.numbers.index(j)] if j in other.numbers else rest.J[:, rest.at(j)]
                             for j in free])
        F = list(free)
        w = m.table.prior[F]**-2.0
        b = along(J, at.e) + w * (p - m.table.null)[F]
        A = gram(J) + np.diag(w)
        if objective(m, at.e, p) - float(b @ np.linalg.solve(A + 1e-12 * np.diag(np.diag(A)), b)) > most:
            return None
        return gauss_newton(m, p, free, rest.band - set(other.numbers), 2, J)
