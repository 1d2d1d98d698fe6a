"""The check whether a cause is outdone by something that is not listed.

A true cause, in its true form, explains all of its own misfit, so nothing else alone explains more than chance adds.
Of what is no cause of the catalogue (an attitude reference that drifts, a bent characteristic) the best imitation may
explain nearly all; but the generic shape that it is like (`shapes`) explains more in the place of that cause, or as
much as the log can tell and something beside it.  A line that one sensor alone sees (a gyro that vibrates with the
engine) is no moment: the attitude does not follow it.  A tone that comes and goes is no mode and no line, though a few
of them together imitate it.  And a moment that grows steadily from the start (fuel that is
burnt unevenly) is imitated by any two causes that nearly cancel each other.
"""

import math

from ..model.nuisance import Problem
from ..search.fit import fit
from ..search.profile import Model
from ..search.selection import Selection, in_a_block, strongest
from .leftover import LINE, SHAPE_LIMIT, Leftover
from .shapes import line_gain, ramp_gain, shape_gains, swell_gain

ODDS = math.log(5.0)   # nats: a cause of the catalogue is so many times as common as its one twin that is none
RARE = math.log(1e4)   # nats
RAMP_NUMBERS = 2       # that a straight line in time has
PARALLEL = 0.9  # of what a cause explains, |cos|^2 of 0.95: a shape that is left and explains so much is its rival


def outdone(selection: Selection, left: tuple[Leftover, ...]) -> str | None:
    """The words for a shape that explains more than the strongest cause (or the block that it is part of) in its place,
    by more than the best of so many shapes does by chance, or nearly as much and is left beside it; None: nothing.

    Both under the filter of the model with the cause;  left  what disturbances find beside the model
    """
    model = selection.model
    first = strongest(selection)
    alone, cause = not in_a_block(model.causes, first), model.causes[first].hypothesis
    others = tuple(each for k, each in enumerate(model.causes)
                   if k != first and (alone or not in_a_block(model.causes, k)))
    problem = Problem(model.fit.record, model.fit.filter)
    base = fit(problem, others, model.fit.delta)
    own = base.cost - model.fit.cost
    for place in model.fit.record.channels if cause.is_line else ():
        gain, frequency = line_gain(problem, base, place, model.causes[first].values[1]), model.causes[first].values[1]
        if gain > own + SHAPE_LIMIT:
            return words(cause.cause, f"{LINE}({frequency:.4g} t)", place, gain, own)
    if (rival := _swelling(problem, model) or _ramping(problem, model)) is not None:
        return rival
    beside = {(each.disturbance.place, each.shape) for each in left if each.gain > each.limit}
    for place, shape, _, gain in shape_gains(problem, base):
        margin = ODDS if cause.imitated == (place, shape) else SHAPE_LIMIT
        if gain > own + margin or ((place, shape) in beside and gain > PARALLEL * own):
            return words(cause.cause, shape, place, gain, own)
    return None


def _swelling(problem: Problem, model: Model) -> str | None:
    """The words for a moment that comes and goes and explains more than all modes and lines together, by more than so
    many free amplitudes do by chance once in 1e4 logs, at most (Laurent and Massart, Ann. Statist. 28 (2000), lemma
    1)."""
    waves = [k for k, cause in enumerate(model.causes) if cause.hypothesis.is_line or cause.hypothesis.is_mode]
    if not waves:
        return None
    base = fit(problem, tuple(cause for k, cause in enumerate(model.causes) if k not in waves), model.fit.delta)
    own = max(base.cost - model.fit.cost, 0.0)
    gain, frequency, knots = swell_gain(problem, base, [model.causes[k].values[1] for k in waves])
    if gain <= own + knots + math.sqrt(2 * knots * RARE) + RARE:
        return None
    named = " and ".join(model.causes[k].hypothesis.cause for k in waves)
    return words(named, f"{LINE}({frequency:.4g} t) that comes and goes", "plant", gain, own)


def _ramping(problem: Problem, model: Model) -> str | None:
    """The words for a moment on a straight line in time that explains more than all causes together, of as many numbers
    or more."""
    if sum(len(cause.values) for cause in model.causes) < RAMP_NUMBERS:
        return None
    base = fit(problem, (), model.fit.delta)
    own, gain = max(base.cost - model.fit.cost, 0.0), ramp_gain(problem, base)
    if gain <= own:
        return None
    named = " and ".join(dict.fromkeys(cause.hypothesis.cause for cause in model.causes))
    return words(named, "a straight line in time", "plant", gain, own)


def words(cause: str, shape: str, place: str, gain: float, own: float) -> str:
    """The sentence that speaks against a cause, or several;  gain, own [nats] of the shape, of the cause."""
    return f"{cause}: a disturbance proportional to {shape} at the {place} alone explains {gain:.0f} nats, it {own:.0f}"
