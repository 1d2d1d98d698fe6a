"""The check whether a cause is outdone by something that is not listed.

A true cause, in its true form, explains all of its own misfit, so nothing else alone explains more than chance adds.
Of what is no cause of the catalogue (an attitude reference that drifts, a bent characteristic) the best imitation may
explain nearly all; but the generic shape that it is like (`shapes`) explains more in the place of that cause, or as
much as the log can tell and something beside it.
"""

import math

from ..model.nuisance import Problem
from ..search.fit import fit
from ..search.selection import Selection, in_a_block, strongest
from .leftover import SHAPE_LIMIT, Leftover
from .shapes import shape_gains

ODDS = math.log(5.0)   # nats: a cause of the catalogue is so many times as common as its one twin that is none
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
    beside = {(each.disturbance.place, each.shape) for each in left if each.gain > each.limit}
    for place, shape, _, gain in shape_gains(problem, base):
        margin = ODDS if cause.imitated == (place, shape) else SHAPE_LIMIT
        if gain > own + margin or ((place, shape) in beside and gain > PARALLEL * own):
            return (f"{cause.cause}: a disturbance proportional to {shape} at the {place} alone explains {gain:.0f} "
                    f"nats, it {own:.0f}")
    return None
