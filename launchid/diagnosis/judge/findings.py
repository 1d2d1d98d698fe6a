"""Frozen findings about one selection, and the verdict, which is a function of them.

Nothing here is measured or searched: the same findings give the same conclusion.
"""

from dataclasses import dataclass
from typing import Any

from ..controller.issued import is_slow
from ..controller.kind import ControllerCheck
from ..data.record import Record
from ..search.selection import Selection
from .gain import Gain
from .leftover import Leftover
from .measure import Remainder, remainder, too_noisy
from .named import Named, mismatch


@dataclass(frozen=True, eq=False)
class Findings:
    """One selection, tested.

    named      its causes as they are reported, weather that can be called so among them
    left       what disturbances find beside it;  noise  its levels
    doubts     why its causes are not even dominant, one line each;  remaining  why they do not explain everything
    gain       on rows left out; None where it was not measured, since there were doubts before
    needed     share of the error that each of its causes must take away to be named
    """

    selection: Selection
    named: tuple[Named, ...]
    left: tuple[Leftover, ...]
    noise: dict[str, dict[str, Any]]
    doubts: tuple[str, ...] = ()
    remaining: tuple[str, ...] = ()
    gain: Gain | None = None
    needed: float = 0.0


@dataclass(frozen=True, eq=False)
class Conclusion:
    """The verdict: see `Diagnosis`, whose fields these are."""

    verdict: str
    where: str | None = None
    causes: tuple[Named, ...] = ()
    open: tuple[Named, ...] = ()
    nearest: tuple[Named, ...] = ()
    doubts: tuple[str, ...] = ()
    remainder: Remainder | None = None


def concluded(found: Findings, controller: ControllerCheck | None, record: Record,
              left_nominal: tuple[Leftover, ...]) -> Conclusion:
    """The conclusion from findings;  left_nominal  what disturbances find beside the nominal, () where that was not
    asked."""
    foreign = controller is not None and controller.is_foreign
    doubts = found.doubts
    if controller is not None and foreign and not found.named:
        doubts = (*doubts, f"the logged command is not the nominal controller's ({controller.words})")
    if doubts:
        return Conclusion("unexplained", place(found, controller, record, left_nominal),
                          nearest=tuple(each for each in found.named if not each.is_weather),
                          doubts=tuple(dict.fromkeys(doubts)))
    within = tuple(each for each in found.named if each.is_open(record))
    causes = [each for each in found.named if each not in within]
    if controller is not None and controller.is_named:
        causes.append(mismatch(controller))
    told = all(each.removed is not None for each in causes)
    causes.sort(key=lambda each: (-(each.removed or 0.0) if told else 0.0, -each.evidence))
    if not causes:
        return Conclusion("consistent", open=within)
    if not (found.remaining or foreign):
        return Conclusion("explained", causes[0].where, tuple(causes), within)
    left = remainder(found.gain, found.left, found.selection, "controller" if foreign else None,
                     too_noisy(found.noise))
    return Conclusion("dominant", causes[0].where, tuple(causes), within, remainder=left)


def place(found: Findings, controller: ControllerCheck | None, record: Record,
          left_nominal: tuple[Leftover, ...]) -> str:
    """The place of the misfit: the controller if its command is foreign, else where a disturbance helps most, or the
    place of the nearest cause where that explains more.  Of a controller that is not known a slow log does not have the
    commands between its rows, which then seems the actuator's fault."""
    slow = is_slow(record)
    foreign = controller if controller is not None and controller.is_foreign else None
    best = max((each for each in left_nominal or found.left if not each.is_line), key=lambda leftover: leftover.gain)
    if foreign is not None and (foreign.evidence > best.gain or not slow):
        return "controller"
    weather = found.selection.weather
    where, most = (best.where, best.gain) if weather is None or weather.gain < best.gain else ("plant", weather.gain)
    strongest = max(found.named, key=lambda cause: cause.evidence, default=None)
    where = strongest.where if strongest is not None and strongest.evidence > most else where
    return "controller" if foreign is not None and where == "actuator" else where
