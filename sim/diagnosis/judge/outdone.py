"""The check whether a cause is outdone by something that is not listed.

A true cause, in its true form, explains all of its own misfit, so nothing else alone explains more than chance adds.
Of what is no cause of the catalogue (a gyro that saturates, a bent characteristic) the best imitation explains most and
leaves little; but the generic shape that it is like (`shapes`) explains more in the place of that cause, or as much as
the log can tell and something beside it.  A line that one sensor alone sees (a gyro that vibrates with the engine) is
no moment: the attitude does not follow it.  An a6 or k1 that swings (buffeting, uneven burning), or a tone that comes
and goes, is no mode and no line, though a few of them together imitate it.  And a moment that grows steadily from the
start (fuel that is burnt unevenly) is imitated by any two causes that nearly cancel each other.
"""

import math
from dataclasses import dataclass

from ..model.nuisance import Problem
from ..search.fit import fit
from ..search.profile import Model
from ..search.selection import Selection, in_a_block, strongest
from .leftover import LINE, PLACE_OF, SHAPE_LIMIT, Leftover
from .shapes import line_gain, ramp_gain, shape_gains, swell_gain, swing_gain

ODDS = math.log(5.0)   # nats: a cause of the catalogue is so many times as common as its one twin that is none
RARE = math.log(1e4)  # nats
PARALLEL = 0.9  # of what a cause explains, |cos|^2 of 0.95: a shape that is left and explains so much is its rival
RAMP_NUMBERS = 2  # that a straight line in time has
UNLIKE = 0.1    # of what a cause explains: a shape that leaves more is another thing, if it is of another place and the
KEPT = 0.5      # cause keeps so much of what it explains beside it; else the cause's own part does something else


@dataclass(frozen=True)
class Rival:
    """A generic shape in the place of a cause: where it enters, what it is proportional to, the share of what the cause
    explains that it does.

    cause  its name, or those of several with "and" between
    """

    cause: str
    place: str
    shape: str
    share: float

    @property
    def words(self) -> str:
        """The sentence that speaks against the cause."""
        whose = "they do" if " and " in self.cause else "it does"
        return (f"{self.cause}: a disturbance proportional to {self.shape} at the {self.place} alone explains "
                f"{100 * self.share:.0f} % of what {whose}")


def outdone(selection: Selection, left: tuple[Leftover, ...]) -> Rival | None:
    """The rival that explains more than the strongest cause (or the block that it is part of) in its place, by more
    than the best of so many shapes does by chance, or nearly as much and is left beside it; None: nothing.

    Both under the filter of the model with the cause;  left  what disturbances find beside the model
    """
    model = selection.model
    first = strongest(selection)
    alone = not in_a_block(model.causes, first)
    others = tuple(cause for k, cause in enumerate(model.causes)
                   if k != first and (alone or not in_a_block(model.causes, k)))
    problem = Problem(model.fit.record, model.fit.filter)
    base = fit(problem, others, model.fit.delta)
    own = base.cost - model.fit.cost
    cause = model.causes[first]
    for place in model.fit.record.channels if cause.hypothesis.is_line else ():
        gain, frequency = line_gain(problem, base, place, cause.values[1]), cause.values[1]
        if gain > own + SHAPE_LIMIT:
            return Rival(cause.hypothesis.cause, place, f"{LINE}({frequency:.4g} t)", gain / own)
    rival = _swinging(problem, model) or _ramping(problem, model)
    if rival is not None:
        return rival
    remaining = _remaining(left)
    for place, shape, _, gain in shape_gains(problem, base):
        margin = ODDS if cause.hypothesis.imitated == (place, shape) else SHAPE_LIMIT
        beside = remaining.get((place, shape), 0.0)
        if gain > own + margin or (beside > 0.0 and gain > PARALLEL * own) or \
                (beside > UNLIKE * own and (PLACE_OF[place] == cause.hypothesis.where
                                            or own + beside - gain < KEPT * own)):
            share = gain / own if own > 0.0 else math.inf  # of nothing, any
            return Rival(cause.hypothesis.cause, place, shape, share)
    return None


def outdone_beside(selection: Selection) -> Rival | None:
    """`outdone` of the causes beside the strongest, for where something remains: what a generic shape makes better is
    no further cause but the strongest one's own misfit; None: of none of them."""
    model = selection.model
    first = strongest(selection)
    problem = Problem(model.fit.record, model.fit.filter)
    for k, cause in enumerate(model.causes):
        if k == first or in_a_block(model.causes, k):
            continue
        base = fit(problem, (*model.causes[:k], *model.causes[k + 1:]), model.fit.delta)
        own = base.cost - model.fit.cost
        for place, shape, _, gain in shape_gains(problem, base):
            if gain > own + SHAPE_LIMIT:
                return Rival(cause.hypothesis.cause, place, shape, gain / own if own > 0.0 else math.inf)
    return None


def _remaining(left: tuple[Leftover, ...]) -> dict[tuple[str, str], float]:
    """(place, shape) -> [nats], of what is left beyond chance."""
    return {(each.disturbance.place, each.shape): each.gain for each in left if each.gain > each.limit}


def _swinging(problem: Problem, model: Model) -> Rival | None:
    """An a6 or k1 that swings, or a moment that comes and goes, and explains more than all modes and lines together."""
    swinging = [k for k, cause in enumerate(model.causes) if cause.hypothesis.is_line or cause.hypothesis.is_mode]
    if not swinging:
        return None
    base = fit(problem, tuple(cause for k, cause in enumerate(model.causes) if k not in swinging), model.fit.delta)
    own = max(base.cost - model.fit.cost, 0.0)
    named = " and ".join(model.causes[k].hypothesis.cause for k in swinging)

    def rival(gain: float, shape: str) -> Rival:
        return Rival(named, "plant", shape, gain / own if own > 0.0 else math.inf)

    gain, name, frequency = swing_gain(problem, base)
    if gain > own + SHAPE_LIMIT:
        return rival(gain, f"{name}*{LINE}({frequency:.4g} t)")
    gain, frequency, knots = swell_gain(problem, base, [model.causes[k].values[1] for k in swinging])
    if gain > own + _chance(2 * knots):
        return rival(gain, f"{LINE}({frequency:.4g} t) that comes and goes")
    return None


def _ramping(problem: Problem, model: Model) -> Rival | None:
    """A moment on a straight line in time that explains more than all causes together, of as many numbers or more."""
    if sum(len(cause.values) for cause in model.causes) < RAMP_NUMBERS:
        return None
    base = fit(problem, (), model.fit.delta)
    own, gain = max(base.cost - model.fit.cost, 0.0), ramp_gain(problem, base)
    if gain <= own:
        return None
    named = " and ".join(dict.fromkeys(cause.hypothesis.cause for cause in model.causes))
    return Rival(named, "plant", "a straight line in time", gain / own if own > 0.0 else math.inf)


def _chance(numbers: int) -> float:
    """The gain [nats] that so many free amplitudes have by chance once in 1e4 logs, at most (Laurent and Massart, Ann.
    Statist. 28 (2000), lemma 1)."""
    return 0.5 * numbers + math.sqrt(numbers * RARE) + RARE
