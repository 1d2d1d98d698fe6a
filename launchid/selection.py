"""Choose the parts of a model step by step, forward or backward, by whatever score the caller has."""

from collections.abc import Callable, Iterable
from typing import TypeVar

Model = TypeVar("Model")


def step_by_step(now: Model, neighbours: Callable[[Model], Iterable[Model]],
                 takes_over: Callable[[Model, Model], bool]) -> Model:
    """Go from a model to the first of its neighbours that takes its place, until none does.

    Parameters
    ----------
    now : model
        Where to begin.
    neighbours : callable
        model -> models with one part more (forward) or less (backward), the most promising first.
    takes_over : callable
        (neighbour, model) -> whether the neighbour is the better of the two.  No model may come back.

    References
    ----------
    Efroymson, Multiple regression analysis, in Mathematical Methods for Digital Computers (1960).
    """
    while (other := next((each for each in neighbours(now) if takes_over(each, now)), None)) is not None:
        now = other
    return now
