"""Decide which one thing of the nominal a stranger's log contradicts: the hypothesis that explains most and predicts.

A cause is named if its hypothesis makes the log clearly likelier than the nominal does, explains most of what
everything free explains, and predicts better than the nominal.  What is left beside it is said, and not named: small
motions that no model has make small numbers significant.  A nominal is consistent if everything free predicts no
better, no cause alone makes the log clearly likelier, and k1 is tested.
"""

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from sim.nominal import Nominal

from ..controller.check import ControllerCheck
from ..log.fault import Fault
from ..log.log import Log
from ..log.vehicle import of_ratio
from .adapter import Reading
from .adequacy import Followed, acts, followed, untested
from .decision import no_cause
from .dissipation import FAMILY, same_energy
from .elimination import (
    ALIKE_Z,
    EVENT,
    MIN_SQUARES_SAVED,
    MOST,
    PRODUCTS,
    RARE,
    RIVAL_MARGIN,
    SAME_LAW,
    SHAPE_Z,
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
from .score import deviations, unit_of

PREDICTS = 0.9         # of the nominal's squared errors ahead, that the nominal with its cause leaves
ADEQUATE = 0.85        # of a model's squared errors ahead, that everything free leaves beside one that is adequate
SAME_LEFT = 1.05       # times the errors ahead that another leaves, within which it predicts as well
CURVES = {"cubic", "term beta^2", *PRODUCTS}   # which are what much is that no model has
OF_RATE, OF_ATTITUDE = ("the rate", "the rate's sign"), ("the attitude",)
OWN_SIGNALS = {"damping": OF_RATE, "term theta_dot": OF_RATE, "friction": OF_RATE, "term sign(theta_dot)": OF_RATE,
               "a6": OF_ATTITUDE, "sine": OF_ATTITUDE, "term theta": OF_ATTITUDE, "term sin(theta)": OF_ATTITUDE,
               "k1": ("the input",), "term beta^2": ("the input's square",), "theta^2": ("the attitude's square",)}
INPUT_NUMBERS = ("k1", "k1_slope", "delay", "lag", "washout", "bandwidth", "inertia", "term beta^2",   # of the input
                 "control_loss", "bending", "actuator_backlash", "actuator_rate_limit")


class Best(NamedTuple):
    """The group of numbers that is wrong, its hypothesis, the share of what everything free explains, the share of the
    nominal's squared errors that it leaves, the groups that do as well in its place."""

    group: Group
    one: Hypothesis
    share: float
    left: float
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
        ahead = {g: self.gain(one).of_motion() for g, one in of.items() if is_needed(g, one, nominal)}
        left = {g: errors_left(of[g], nominal, [(a, b) for b, a, _ in rows]) for g, rows in ahead.items()}
        order = sorted(left, key=lambda g: -of[g].value)
        for first in (g for g in order if left[g] < PREDICTS):
            share = (of[first].value - nominal.value) / max(self.of.full.value - nominal.value, 1e-9)
            all_left = errors_left(self.of.full, nominal, [(a, b) for b, _, a in ahead[first]])
            of_errors = math.log(left[first]) / math.log(min(all_left, left[first]))
            if not 0.5 * (share + of_errors) > MOST:
                continue
            same = [first, *(g for g in order if g is not first and g.cause and left[g] < 1.0 and (
                does_as_well(g, first, of, nominal) or left[g] < SAME_LEFT * left[first]))]
            usual = [g for g in same if g.kind not in RARE]
            best = usual[0] if first.kind in RARE and usual else first
            return Best(best, of[best], share, left[best], tuple(g for g in same if g is not best))
        return None

    def idle(self) -> str:
        """Return in words what makes the log likelier where nothing stands, and predicts no better; "": nothing."""
        of, nominal = self.of.alone, self.of.nominal
        nats = max(self.of.full.value - nominal.value, 1e-9)
        g = max((g for g in of if is_needed(g, of[g], nominal) and of[g].value - nominal.value > MOST * nats),
                key=lambda g: of[g].value, default=None)
        if self.best is not None or g is None:
            return ""
        gained = of[g].value - nominal.value
        return f"{g.kind} would make the log {gained:.0f} nats likelier, and predicts hardly better"

    def kept(self, best: Best) -> Kept:
        """Return what stands as an elimination keeps a group."""
        nats, error = won(best.one, self.of.nominal)
        forms = {"theta_dot": "aero_damping", "sign(theta_dot)": "friction"}   # of terms, in the catalogue's words
        alike = tuple(forms[FAMILY[g.name][0]] if g.name in FAMILY else g.cause for g in best.alike)
        return Kept(best.group, 2.0 * nats, 2.0 * error, best.share, alike, self.of.nominal.fit.p,
                    deviations(best.one.m, best.one.fit, unit_of(best.one.fit)))

    def elimination(self) -> Elimination:
        """Return the fits as an elimination leaves them."""
        nominal, full = self.of.nominal.fit, self.of.full
        return Elimination(nominal, full.fit, self.final.fit, nominal.e, full.fit.e, self.final.fit.e,
                           unit_of(full.fit), () if self.best is None else (self.kept(self.best),),
                           deviations(full.m, full.fit, unit_of(full.fit)), tuple(self.of.notes))


def is_needed(group: Group, one: Hypothesis, base: Hypothesis) -> bool:
    """Whether one group more makes the log clearly likelier, as blocks scatter."""
    nats, error = won(one, base)
    least = EVENT * group.chance if group.is_event else MIN_SQUARES_SAVED
    z = SHAPE_Z if group.kind in CURVES else Z
    return 2.0 * nats > least and nats > z * error


def does_as_well(other: Group, best: Group, beside: dict[Group, Hypothesis], base: Hypothesis) -> bool:
    """Whether another group in the place of the best is as good as it, as blocks scatter."""
    nats, error = won(beside[best], beside[other])
    z = Z if best.name in FAMILY and other.name in FAMILY else ALIKE_Z
    is_same = SAME_LAW.get(best.name) == other.name and not base.m.log.has_stiffness
    return is_same or nats < max(z * error, RIVAL_MARGIN * (beside[best].value - base.value))


def fault_of_input(found: Stranger, log: Log) -> Fault | None:
    """Return the fault of beta, in sign or unit, that a k1 shows that stands or does as well; None: it may be true."""
    best = found.best
    k1 = None if best is None else next((g for g in (best.group, *best.alike) if g.name == "k1"), None)
    if best is None or k1 is None:
        return None
    one = found.of.alone[k1]
    std = deviations(one.m, one.fit, unit_of(one.fit))[k1.numbers[0]]
    told = of_ratio(float(one.fit.p[k1.numbers[0]]), float(std), 1.0 - best.left)
    return None if told is None else Fault(told[0], told[1], float(log.t[0]), float(log.t[-1]), len(log.t), told[2])


def not_alone(found: Stranger, el: Elimination, k: Kept, goes: list[Followed],
              controller: ControllerCheck | None) -> str:
    """Return why what stands is not named; "": it is."""
    of = OWN_SIGNALS.get(k.group.kind, ()) if found.best is not None and found.best.left > MOST else ()
    still = [each.what for each in goes if each.what in of]
    if why := no_cause(found.final.m, el, k, controller):
        return why
    if k.group.kind in INPUT_NUMBERS and not acts(found.of.full.m, el):
        return "the input of another time explains as much as the log's own: nothing is said of it"
    return f"{k.group.kind} explains most, and errors still go with {still[0]}: it is not it alone" if still else ""


def judged(m: Model, p: np.ndarray, reading: Reading, nominal: Nominal, own: frozenset[int] = frozenset()) -> Result:
    """Diagnose a stranger's log, of which everything is fitted with numbers p; own: numbers that are free in all."""
    columns = (*KINEMATIC, *FORM) if m.log.is_blind else KINEMATIC
    notes = own | {m.table.index(name) for name in columns if name in m.table}
    found = Stranger(m, p, notes)
    said, idle = list[str](), found.idle()
    if found.best is not None and found.best.group.name in FAMILY and (both := same_energy(found.of)):
        said.append(f"{found.best.group.name} differs, the energy that damping and friction take together does not "
                    "(no cause)")
        found.best, found.final = None, both
    m, el = found.final.m, found.elimination()
    if fault := fault_of_input(found, reading.log):
        return Result(replace(reading, data=replace(reading.data, faults=(*reading.data.faults, fault)), is_bad=True),
                      nominal, None, None, "bad-data", "data")
    gain, controller = found.gain(found.final), reading.controller
    goes = followed(m, el.final)
    words = [why for k in el.kept if (why := not_alone(found, el, k, goes, controller))]
    kept = [] if words else el.kept
    left = errors_left(found.of.full, found.final, [(full, after) for _, after, full in gain.of_motion()])
    if left < ADEQUATE:
        words.append(f"everything free leaves {left:.2f} of the errors ahead")
    if idle:
        words.append(idle)
    beside = named_beside(m, el, controller, is_weather=False)
    names = (*beside, *(each for k in kept for each in named_of(m, el, k)))
    is_foreign = controller is not None and controller.is_foreign
    where = "actuator" if any(each.column == "beta" for each in goes) else None
    if controller is not None and is_foreign:
        words.insert(0, f"the command is not the nominal controller's: {controller.words}")
        where = "controller"
    against, notes_said = (*words, *(each.words for each in goes)), (*noted(m, el), *said)

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
