"""The limits of this log: the smallest size of each cause that would be found, and which causes look alike.

The smallest size is the one whose expected gain of log-likelihood, everything else refitted (the wind's levels:
`absorbed`), pays the threshold and the penalty: about even odds of being found.  What the nozzle cannot hold is none.
Both tables are made of the model's own responses, so they hold for this log, its manoeuvres, its noise and its columns.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...sums import products, square
from ..causes import SOUGHT, Cause, Hypothesis, Values
from ..data.record import Record
from ..model.nuisance import Problem
from ..search.profile import Model, penalty
from ..search.scan import Projector, response, with_effect
from .absorbed import Absorbing

LOOK_ALIKE = 0.999     # |cosine| from which two causes cannot be told apart by any size
BEYOND = 30.0          # times the smallest and the largest size of a record, between which one is sought
PRECISE = 1.02         # factor to which it is found
PROPORTIONAL = 0.2     # of the gain, by which a response may miss being proportional to the size
CONFIRMED = 1.1        # factor to which a size is found whose response does


@dataclass(frozen=True)
class Limit:
    """Smallest size of a cause that this log would show, away from `neutral`; None: no size.

    at  values of its other parameters for which it is given
    """

    cause: str
    parameter: str
    unit: str
    size: float | None
    neutral: float
    at: tuple[tuple[str, float], ...]


@dataclass(frozen=True, eq=False)
class Isolability:
    """The likeness of the responses of visible causes.

    products  (c, c) of the responses, each of length 1
    """

    names: tuple[str, ...]
    products: np.ndarray

    @property
    def cosine(self) -> np.ndarray:
        """(c, c) |cosine| between the responses: 1 cannot be told apart, 0 is perfectly told apart."""
        return np.abs(self.products)

    def pairs(self, least: float) -> list[tuple[str, str, float]]:
        """Pairs from this |cosine| on, the most alike first."""
        n = len(self.names)
        found = [(self.names[a], self.names[b], float(self.cosine[a, b])) for a in range(n) for b in range(a)
                 if self.cosine[a, b] >= least]
        return sorted(found, key=lambda pair: -pair[2])


def limits(record: Record, model: Model, threshold: float) -> tuple[list[Limit], Isolability]:
    """The limit of every hypothesis, and the isolability of those that the log's columns can show."""
    problem = Problem(record, model.fit.filter)
    project, absorbing = Projector(problem, model.fit, causes=False), Absorbing(model)
    found, responses, names = [], [], []
    for hypothesis in SOUGHT:
        shape = hypothesis.limit_at(record)
        size = hypothesis.free[0]
        at = tuple(zip((free.name for free in hypothesis.free[1:]), shape, strict=True))
        amount, change = None, None
        if hypothesis.visible(record):
            needed = threshold + penalty(record, hypothesis)
            if hypothesis.sizes is None:
                change = project.out(response(problem, model.fit, project, hypothesis, shape))
                amount = absorbing.multiple(change, needed)
            else:
                amount, change = _bisected(problem, model, project, absorbing, hypothesis, needed)
            most = min(hypothesis.reach, hypothesis.held(record))
            if amount is not None and amount <= most and hypothesis.sizes is None:
                def gain(size: float, hypothesis: Hypothesis = hypothesis, shape: Values = shape) -> float:
                    cause = Cause(hypothesis, (_away(hypothesis, size), *shape))
                    moved = problem.residual(with_effect(model.fit, cause)) - project.residual
                    return absorbing.gain(project.out(moved))

                amount = _confirmed(gain, amount, most, needed)
            if amount is not None:
                amount = max(amount, hypothesis.floor(record))
            if amount is not None and amount > most:
                amount = None
        found.append(Limit(hypothesis.cause, size.name, hypothesis.unit(size.name), amount, hypothesis.neutral, at))
        if change is not None and square(change) > 0.0:
            responses.append(change / np.sqrt(square(change)))
            names.append(hypothesis.cause)
    stack = np.array(responses).reshape(len(names), len(project.residual))
    return found, Isolability(tuple(names), products(stack.T, stack.T))


def _away(hypothesis: Hypothesis, size: float) -> float:
    """A size's value, on the side of neutral to which the range is open."""
    return hypothesis.neutral + (size if hypothesis.neutral + size <= hypothesis.free[0].high else -size)


def _confirmed(gain: Callable[[float], float], size: float, most: float, needed: float) -> float | None:
    """The smallest size that gains what is needed, from the one that would if the response were proportional to it;
    None: there is none up to `most`."""
    first = gain(size)
    if abs(first / needed - 1.0) < PROPORTIONAL:
        return size
    low, high = (size, min(most, size * BEYOND)) if first < needed else (size / BEYOND, size)
    if high <= low or (first < needed and gain(high) < needed):
        return None
    while high / low >= CONFIRMED:
        middle = math.sqrt(low * high)
        if gain(middle) >= needed:
            high = middle
        else:
            low = middle
    return math.sqrt(low * high)


def unseen() -> list[Limit]:
    """The limits of a log too short for any."""
    return [Limit(each.cause, each.free[0].name, each.unit(each.free[0].name), None, each.neutral, ())
            for each in SOUGHT]


def _bisected(problem: Problem, model: Model, project: Projector, absorbing: Absorbing, hypothesis: Hypothesis,
              needed: float) -> tuple[float | None, np.ndarray | None]:
    """Smallest size (a play) or largest (a rate limit) that pays, where the response is not proportional to it."""
    shrinks = math.isinf(hypothesis.neutral)
    assert hypothesis.sizes is not None
    tries = hypothesis.sizes(problem.record)
    if not tries:
        return None, None

    def change(size: float) -> np.ndarray:
        moved = problem.residual(with_effect(model.fit, Cause(hypothesis, (size,))))
        return project.out(moved - project.residual)

    def pays(size: float) -> bool:
        return absorbing.gain(change(size)) >= needed

    low, high = min(tries) / BEYOND, max(tries) * BEYOND
    if not pays(low if shrinks else high):
        return None, None
    while high / low >= PRECISE:
        middle = math.sqrt(low * high)
        if pays(middle) == shrinks:
            low = middle
        else:
            high = middle
    size = math.sqrt(low * high)
    return size, change(size)
