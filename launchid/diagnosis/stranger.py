"""Decide which one thing of the nominal a stranger's log contradicts: the hypothesis that explains most and predicts.

A cause is named if its hypothesis makes the log clearly likelier than the nominal does, explains most of what
everything free explains, and predicts better than the nominal.  What is left beside it is said, and not named: small
motions that no model has make small numbers significant.  A nominal is consistent if everything free predicts no
better.
"""

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from sim.nominal import Nominal

from .adapter import Reading
from .adequacy import acts, adequacy, untested
from .decision import no_cause
from .elimination import (
    ALIKE_Z,
    EVENT,
    MIN_SQUARES_SAVED,
    MOST,
    RARE,
    RIVAL_MARGIN,
    SAME_LAW,
    Elimination,
    Group,
    Kept,
    Z,
)
from .gain import Gain, held_out
from .hypotheses import Hypotheses, Hypothesis, won
from .model import Model
from .named import Result, named_beside, named_of, noted
from .numbers import FORM, KINEMATIC
from .score import deviations

PREDICTS = 0.9         # of the nominal's squared errors ahead, that the nominal with its cause leaves
ADEQUATE = 0.85        # of a model's squared errors ahead, that everything free leaves beside one that is adequate
DISSIPATION = {"damping": "aero_damping", "term theta_dot": "aero_damping",   # number: cause. Small motions do not tell
               "friction": "friction", "term sign(theta_dot)": "friction"}     # one from the other
INPUT_NUMBERS = ("k1", "k1_slope", "delay", "lag", "washout", "bandwidth", "inertia", "term beta^2",   # of the input
                 "control_loss", "bending", "actuator_backlash", "actuator_rate_limit")


class Best(NamedTuple):
    """The group of numbers that is wrong, its hypothesis, the share of what everything free explains, the groups that
    do as well in its place."""

    group: Group
    one: Hypothesis
    share: float
    alike: tuple[Group, ...]


def errors_left(one: Hypothesis, over: Hypothesis, ahead: Iterable[tuple[float, float]]) -> float:
    """Return the share of squared error that `one` leaves of what `over` leaves: geometric mean over one row, by the
    likelihood, and the horizons of `ahead` (squares of one, of over)."""
    row = -2.0 * (one.value - over.value) / len(one.fit.e)
    return math.exp(float(np.mean([row, *(math.log(a / b) for a, b in ahead if a > 0.0 and b > 0.0)])))


class Stranger:
    """The hypotheses of a stranger's log, and the one that stands."""

    def __init__(self, m: Model, p: np.ndarray, notes: frozenset[int]) -> None:
        self.of = Hypotheses(m, p, notes)
        self.best = self.standing()
        self.final = self.of.nominal if self.best is None else self.best.one

    def gain(self, one: Hypothesis) -> Gain:
        """Return the gain of a hypothesis over the nominal beside that of everything free."""
        nats = one.value - self.of.nominal.value
        return held_out([(each.m, each.fit) for each in (self.of.nominal, one, self.of.full)], nats)

    def standing(self) -> Best | None:
        """Return what stands; None if nothing does.  A rare cause stands behind what does as well."""
        of, nominal = self.of.alone, self.of.nominal
        nats = max(self.of.full.value - nominal.value, 1e-9)
        order = sorted((g for g in of if is_needed(g, of[g], nominal)), key=lambda g: -of[g].value)
        for first in order:
            same = [first, *(g for g in of if g is not first and g.cause and does_as_well(g, first, of, nominal))]
            usual = [g for g in order if g in same and g.kind not in RARE]
            best = usual[0] if first.kind in RARE and usual else first
            ahead = self.gain(of[best]).of_motion()
            left = errors_left(of[best], nominal, [(a, b) for b, a, _ in ahead])
            of_errors = math.log(left) / math.log(min(errors_left(self.of.full, nominal, [(a, b) for b, _, a in ahead]),
                                                      left))
            share = (of[best].value - nominal.value) / nats
            if left < PREDICTS and 0.5 * (share + of_errors) > MOST:
                return Best(best, of[best], share, tuple(g for g in same if g is not best))
        return None

    def kept(self, best: Best) -> Kept:
        """Return what stands as an elimination keeps a group."""
        nats, error = won(best.one, self.of.nominal)
        alike = tuple(DISSIPATION.get(g.name, g.cause) if best.group.name in DISSIPATION else g.cause
                      for g in best.alike)
        return Kept(best.group, 2.0 * nats, 2.0 * error, best.share, alike, self.of.nominal.fit.p,
                    deviations(best.one.m, best.one.fit, unit_of(best.one)))

    def elimination(self) -> Elimination:
        """Return the fits as an elimination leaves them."""
        nominal, full = self.of.nominal.fit, self.of.full
        return Elimination(nominal, full.fit, self.final.fit, nominal.e, full.fit.e, self.final.fit.e, unit_of(full),
                           () if self.best is None else (self.kept(self.best),),
                           deviations(full.m, full.fit, unit_of(full)), tuple(self.of.notes))


def unit_of(one: Hypothesis) -> float:
    """Return the variance of a whitened error."""
    return max(float(np.mean(one.fit.e**2)), 0.2)


def is_needed(group: Group, one: Hypothesis, base: Hypothesis) -> bool:
    """Whether one group more makes the log clearly likelier, as blocks scatter."""
    nats, error = won(one, base)
    least = EVENT * group.chance if group.is_event else MIN_SQUARES_SAVED
    return 2.0 * nats > least and nats > Z * error


def does_as_well(other: Group, best: Group, beside: dict[Group, Hypothesis], base: Hypothesis) -> bool:
    """Whether another group in the place of the best is as good as it, as blocks scatter."""
    nats, error = won(beside[best], beside[other])
    z = Z if best.name in DISSIPATION and other.name in DISSIPATION else ALIKE_Z
    is_same = SAME_LAW.get(best.name) == other.name and not base.m.log.has_stiffness
    return is_same or nats < max(z * error, RIVAL_MARGIN * (beside[best].value - base.value))


def judged(m: Model, p: np.ndarray, reading: Reading, nominal: Nominal, own: frozenset[int] = frozenset()) -> Result:
    """Diagnose a stranger's log, of which everything is fitted with numbers p; own: numbers that are free in all."""
    columns = (*KINEMATIC, *FORM) if m.log.is_blind else KINEMATIC
    notes = own | {m.table.index(name) for name in columns if name in m.table}
    found = Stranger(m, p, notes)
    m, el = found.final.m, found.elimination()
    gain, controller = found.gain(found.final), reading.controller
    inadequate, misfit = adequacy(m, el.final)
    kept, words = [*el.kept], []
    for k in el.kept:
        if why := no_cause(m, el, k, controller):
            kept.remove(k)
            words.append(why)
        elif k.group.kind in INPUT_NUMBERS and not acts(found.of.full.m, el):
            kept.remove(k)
            words.append("the input of another time explains as much as the log's own: nothing is said of it")
    left = errors_left(found.of.full, found.final, [(full, after) for _, after, full in gain.of_motion()])
    if left < ADEQUATE:
        words.append(f"everything free leaves {left:.2f} of the errors ahead")
    beside = named_beside(m, el, controller, is_weather=False)
    names = (*beside, *(each for k in kept for each in named_of(m, el, k)))
    is_foreign, where = controller is not None and controller.is_foreign, misfit
    if controller is not None and is_foreign:
        words.insert(0, f"the command is not the nominal controller's: {controller.words}")
        where = "controller"
    against, notes_said = (*words, *inadequate), tuple(noted(m, el))

    def result(verdict: str, where: str | None, **more: Any) -> Result:
        fitted = tuple((each.m, each.fit) for each in (found.of.nominal, found.final, found.of.full))
        return Result(reading, nominal, m, el, verdict, where, notes=notes_said, gain=gain, fitted=fitted, **more)

    if names and not is_foreign:
        if not against:
            return result("explained", names[0].where, named=names)
        return result("dominant", names[0].where, named=names, remaining=against, share=gain.share,
                      remaining_where=where)
    if not (against or names):
        against = tuple(untested(m, el))
    if not (against or names):
        return result("consistent", None)
    return result("unexplained", where or (names[0].where if names else "plant"), nearest=names, doubts=against)
