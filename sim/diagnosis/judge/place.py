"""The place of the misfit."""

from ..controller.issued import is_slow
from ..controller.kind import UNKNOWN
from .diagnosis import Diagnosis


def unheard(made: Diagnosis) -> list[str]:
    """The doubts about the actuator's causes in a log slower than a controller that is not known, a line each: what
    the nozzle did between the rows it may have been told to."""
    assert made.record is not None
    if made.controller is None or made.controller.kind != UNKNOWN or not is_slow(made.record):
        return []
    return [f"{each.cause}: the commands between the rows are not known, since no gains make the logged ones"
            for each in made.nearest if each.where == "actuator"]


def place(made: Diagnosis) -> str:
    """The place of the misfit: the controller if its command is foreign, else where a disturbance helps most, or the
    place of the nearest cause where that explains more.  Of a controller that is not known a slow log does not have the
    commands between its rows, which then seems the actuator's fault."""
    assert made.selection is not None and made.record is not None
    slow = is_slow(made.record)
    foreign = made.controller if made.controller is not None and made.controller.is_foreign else None
    left = made.left_nominal or made.left
    best = max((each for each in left if not each.is_line), key=lambda leftover: leftover.gain)
    if foreign is not None and (foreign.evidence > best.gain or not slow):
        return "controller"
    weather = made.selection.weather
    where, most = (best.where, best.gain) if weather is None or weather.gain < best.gain else ("plant", weather.gain)
    strongest = max(made.nearest, key=lambda cause: cause.evidence, default=None)
    where = strongest.where if strongest is not None and strongest.evidence > most else where
    return "controller" if foreign is not None and where == "actuator" else where
