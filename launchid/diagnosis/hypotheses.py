"""Of a stranger's log: which one thing of the nominal is wrong.

A hypothesis is the nominal with one group of numbers free.  A model explains what it lacks by louder noise, so each
hypothesis has the noise levels that make it likeliest (profile likelihood: Barndorff-Nielsen and Cox 1994, ch. 3), and
is judged by two things: by how much likelier it makes the log than the nominal does, block for block, and by how much
better it then predicts.  Small motions that no model has make small numbers significant; they predict nothing.

Everything free is a hypothesis too.  It tells how much of what parts the nominal from the log a model can explain.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..likelihood.estimate import Fit, evaluate, fit_levels, gauss_newton, gram, log_likelihood, objective, slopes
from ..likelihood.likelihood import LEVELS
from ..sums import along, square
from .elimination import Group, groups_of
from .known import SCORE_BLOCKS
from .model import Model
from .start import with_found

CLIMBS = 3             # rounds of numbers, then levels, after the first
CLIMBED = 0.3          # nats: less in a round ends them
OTHER_NOISES: tuple[dict[str, float], ...] = (   # logarithms, by which starts differ
    {}, {"walk": -2.5, "turbulence": -2.0, "acceleration": -3.0}, {"walk": 2.0, "acceleration": -2.0},
    {"walk": -2.5, "turbulence": 2.0, "acceleration": -3.0})
DELAYS = (0.5, 1.0, 2.0, 4.0, 8.0)  # rows
PASSES = 2             # of all hypotheses: noise that one finds is tried for the others
FOUND = 3.0            # nats by which it is a better one
CONTENDERS = 6         # groups that are fitted alone
LATENESS = ("delay", "washout")


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A model with the levels and the numbers that make the log likeliest, and that likelihood with its priors
    [nats]."""

    m: Model
    fit: Fit
    value: float

    def losses(self) -> np.ndarray:
        """Return minus the log likelihood (SCORE_BLOCKS,) of each block's innovations [nats]."""
        log = self.m.log
        each = 0.5 * (self.fit.e**2 + np.log(self.fit.run.S.ravel()[self.m.scored]))
        return np.bincount(log.block, each, minlength=SCORE_BLOCKS)


def stepped(m: Model, p: np.ndarray, free: tuple[int, ...], band: frozenset[int]) -> Hypothesis:
    """Return the hypothesis with `free` numbers after one round: numbers from p with the levels of m, then levels."""
    fit = gauss_newton(m, p, free, band)
    m = fit_levels(m, fit.p)
    at = evaluate(m, fit.p)
    value = log_likelihood(m, at) + 0.5 * (square(at.e) - objective(m, at.e, fit.p))
    return Hypothesis(m, fit._replace(e=at.e, run=at.run), value)


def climbed(starts: Iterable[tuple[Model, np.ndarray]], free: tuple[int, ...], band: frozenset[int]) -> Hypothesis:
    """Return the hypothesis with `free` numbers, fitted by turns with the levels, from the start that is likeliest
    after one round."""
    best = likeliest(*(stepped(m, p, free, band) for m, p in starts))
    for _ in range(CLIMBS):
        again = stepped(best.m, best.fit.p, free, band)
        if again.value < best.value + CLIMBED:
            break
        best = again
    return best


def likeliest(*found: Hypothesis) -> Hypothesis:
    return max(found, key=lambda each: each.value)


def in_noises(m: Model) -> list[Model]:
    """Return a model with the noises that a search of the likeliest starts from."""
    moves = [np.array([each.get(name, 0.0) for name in LEVELS]) for each in OTHER_NOISES]
    return [m.with_levels(m.levels + each) for each in moves]


class Won(NamedTuple):
    """What a hypothesis gains over another: nats, their standard error by blocks."""

    nats: float
    error: float


def won(one: Hypothesis, over: Hypothesis) -> Won:
    """Return the nats by which `one` is likelier, and their standard error over blocks: of the blocks' gains or of
    their roots, whichever tells most."""
    d = over.losses() - one.losses()
    z = max(float(x.mean() / (x.std(ddof=1) / math.sqrt(SCORE_BLOCKS) + 1e-9))
            for x in (d, np.sign(d) * np.sqrt(np.abs(d))))
    nats = one.value - over.value
    return Won(nats, abs(nats) / max(z, 1e-9))


class Hypotheses:
    """The nominal, the groups of numbers that may explain most, each alone, and everything free."""

    def __init__(self, m: Model, p: np.ndarray, notes: frozenset[int]) -> None:
        """Fit them.  p: numbers of the fit with everything free;  notes: numbers that are free in all of them."""
        band = frozenset(j for g in groups_of(m, notes) if g.has_band for j in g.numbers)
        always = tuple(sorted(band | notes))
        self.nominal = climbed(((each, only(p, m, always)) for each in in_noises(m)), always, band)
        wider, p = with_found(self.nominal.m, self.nominal.fit, p)   # shapes that the nominal shows
        if len(p) > len(m.table):
            m = wider.with_levels(m.levels)
            self.nominal = climbed([(wider, only(p, m, always))], always, band)
        self.groups = [g for g in groups_of(m, notes) if "@" not in g.name]   # those are each flight's own
        self.notes, self.all = notes, tuple(range(len(m.table)))
        self.full = climbed([(m, p)], self.all, frozenset())
        self.alone: dict[Group, Hypothesis] = {}
        for _ in range(PASSES):
            for g in self.contenders():
                self.alone[g] = likeliest(*([self.alone[g]] if g in self.alone else []), self.single(g))
            best = likeliest(*self.alone.values())
            before, self.nominal = self.nominal, likeliest(
                self.nominal, climbed([(best.m, only(best.fit.p, m, always))], always, band))
            if self.nominal.value < before.value + FOUND:
                break
        if self.full.value < best.value + CLIMBED:   # it stands in a worse minimum
            self.full = likeliest(self.full, climbed([(best.m, best.fit.p)], self.all, frozenset()))

    def contenders(self) -> list[Group]:
        """Return the groups that by the slopes at the nominal, in its own noise or in that of the full fit, would save
        most, and the lateness, of which slopes say little."""
        p = self.nominal.fit.p.copy()
        for g in self.groups:
            p[list(g.numbers[g.linear:])] = self.full.fit.p[list(g.numbers[g.linear:])]
        worth = dict.fromkeys(self.groups, 0.0)
        for m in (self.nominal.m, self.full.m):
            at = evaluate(m, p)
            J = slopes(m, at, self.all)
            A, b = gram(J) + np.diag(m.table.prior**-2.0), along(J, at.e) + (p - m.table.null) / m.table.prior**2
            for g in self.groups:
                free = sorted({*self.notes, *g.numbers[:g.linear]})
                worth[g] = max(worth[g], float(b[free] @ np.linalg.solve(A[np.ix_(free, free)], b[free])))
        most = sorted(self.groups, key=lambda g: -worth[g])[:CONTENDERS]
        return [g for g in self.groups if g in most or g.name in LATENESS]

    def single(self, group: Group) -> Hypothesis:
        """Return the hypothesis that one group of numbers is wrong."""
        return self.several([group])

    def several(self, groups: list[Group]) -> Hypothesis:
        """Return the hypothesis that these groups of numbers are wrong, fitted from where they are in the full fit, and
        from the noises of the nominal and of the full fit."""
        base, numbers = self.nominal, [j for g in groups for j in g.numbers]
        p = base.fit.p.copy()
        p[numbers] = self.full.fit.p[numbers]
        late = latest(base, groups[0]) if groups[0].name == "delay" else p
        free, band = tuple(sorted({*base.fit.free, *numbers})), base.fit.band - {*numbers}
        return likeliest(*(climbed([each], free, band) for each in ((base.m, late), (self.full.m, p))))


def only(p: np.ndarray, m: Model, free: tuple[int, ...]) -> np.ndarray:
    """Return the nominal's numbers, the `free` ones from p."""
    q = m.table.null.copy()
    q[list(free)] = p[list(free)]
    return q


def latest(base: Hypothesis, group: Group) -> np.ndarray:
    """Return the numbers of `base` with the delay of a few that leaves least."""
    found = []
    for rows in DELAYS:
        q = base.fit.p.copy()
        q[group.numbers[0]] += rows * base.m.log.period
        found.append((square(evaluate(base.m, q).e), rows, q))
    return min(found, key=lambda each: each[:2])[2]
