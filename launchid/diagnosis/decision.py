"""Decide what the elimination of a log means that the nominal's own simulation may have flown."""

from typing import Any

from sim.nominal import Nominal

from ..controller.check import ControllerCheck
from ..sums import square
from .adapter import Reading
from .adequacy import adequacy, as_weather, is_rest, other_shape
from .elimination import MOST, NAME_SHARE, Elimination, Kept
from .gain import held_out
from .model import Model
from .named import Result, named_beside, named_of, noted

UNKNOWN_LEFT = 0.75    # of the removable error ahead: with more left beside something unknown no cause is named
BETWEEN_THEM = 2.0     # of what everything saves, that names may save last in: more is numbers that undo one another
MODES = ("slosh", "bending")   # of the vehicle: what their form leaves swings on


def decided(m: Model, reading: Reading, nominal: Nominal, el: Elimination) -> Result:
    """Decide the verdict from the elimination, its scores and the model's adequacy."""
    nats = 0.5 * (square(el.e_nominal) - square(el.e_final))
    fitted = (m, el.nominal), (m, el.final), (m, el.full)
    gain = held_out(fitted, nats)
    inadequate, misfit = adequacy(m, el.final)
    controller = reading.controller
    others = {k.group.name: why for k in el.kept if (why := other_shape(m, el, k))}
    listed = [k for k in el.kept if k.group.cause and k.group.name not in others]
    unlisted = [k for k in el.kept if k not in listed]
    notes = tuple(noted(m, el))
    words = []
    for k in tuple(listed):
        if why := no_cause(m, el, k, controller):
            listed.remove(k)
            words.append(why)
    modes = [k.group.kind for k in listed if k.group.kind in MODES]
    if m.air.weather and modes:
        words.append(f"what a {modes[0]} leaves is like {m.air.weather}: it is neither")
    beside = named_beside(m, el, controller, bool(m.air.weather) and not modes)
    names = [*beside, *(each for k in listed for each in named_of(m, el, k, as_weather(m, el, k)))]
    doubts = [others.get(k.group.name) or f"{k.group.kind} explains {0.5 * k.gain:.0f} nats and is no known cause"
              for k in unlisted]
    where = unlisted[0].group.place if unlisted else None
    is_foreign = controller is not None and controller.is_foreign
    if controller is not None and is_foreign:
        doubts.insert(0, f"the command is not the nominal controller's: {controller.words}")
        where = where if where == "sensor" else "controller"   # of a law replayed from a wrong column
    against = [*doubts, *words, *inadequate]

    def result(verdict: str, where: str | None, **more: Any) -> Result:
        return Result(reading, nominal, m, el, verdict, where, notes=notes, gain=gain, fitted=fitted, **more)

    if not (names or against or el.kept):
        return result("consistent", None)
    is_odd = sum(k.gain for k in unlisted) > (1.0 - UNKNOWN_LEFT) * sum(k.gain for k in listed)
    short = 2.0 * nats < MOST * el.removable
    noises = sum("noise of" in each for each in inadequate)
    loud = noises > 1 or (noises == 1 and gain.share > NAME_SHARE)
    is_poor = bool(listed) and bool(against) and (gain.share > UNKNOWN_LEFT or short or loud)
    is_known = bool(names) and not (is_foreign or is_odd or is_poor)
    if is_known and not against:
        return result("explained", names[0].where, named=tuple(names))
    sure = tuple(each for each in names if each.where == "controller" or each.share > MOST)
    if is_known and sure and sum(k.share for k in el.kept) <= BETWEEN_THEM:
        return result("dominant", sure[0].where, named=sure, remaining=tuple(against), share=gain.share,
                      remaining_where=where or misfit)
    return result("unexplained", where or misfit or (names[0].where if names else "plant"), nearest=tuple(names),
                  doubts=tuple(against))


def no_cause(m: Model, el: Elimination, k: Kept, controller: ControllerCheck | None) -> str:
    """Return why a kept number is no cause; "": it may be one.

    A scale of the other sign is a convention of the log or of the nominal; at the end of its range nothing is
    estimated; commands between rows that a found controller made tell nothing of the servo; the acceleration of a
    nozzle that no row measures is as wrong as a stranger's servo; and what another cause leaves by not being the same
    along the log is that cause's.
    """
    j, name = k.group.numbers[0], k.group.kind
    number, value = m.table.numbers[j], el.final.p[j]
    is_own = number.name == "term " + number.parameter and number.null != 0.0
    if (number.parameter == "scale" and not value > 0.0) or (is_own and not value / number.null > 0.0):
        return f"{name} has the opposite sign: a convention, or a wrong nominal"
    if number.name == k.group.name and (value <= m.table.low[j] + 1e-9 or value >= m.table.high[j] - 1e-9):
        return f"{name} would be {value:.3g}, the end of its range, or beyond: something else is wrong"
    if controller is not None and controller.is_named and m.log.unsure > 0.0 and k.group.place == "actuator":
        return f"{name}: the commands between the rows are another controller's, and tell nothing of the servo"
    largest = max(el.kept, key=lambda each: each.gain)
    if is_rest(m, el, k, largest):
        return f"{name} may be what {largest.group.kind} leaves by not being the same along the log"
    return ""
