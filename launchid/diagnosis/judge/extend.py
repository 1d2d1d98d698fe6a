"""The extended model: the nominal with the causes as `[[effects]]`, which `simulate` flies and `diagnose` accepts."""

from collections.abc import Iterable
from dataclasses import replace

from sim.effects import Effect, effect, values
from sim.effects.table import CENTRE
from sim.nominal import Nominal

from ..causes import MISMATCH, Cause
from ..controller.kind import ControllerCheck
from .named import Named


def extended(nominal: Nominal, causes: Iterable[Cause], shift: float = 0.0,
             controller: ControllerCheck | None = None, centre: float = CENTRE,
             weather: Iterable[Named] = ()) -> Nominal:
    """The nominal with these causes.

    shift   [s] log's clock less the grid's: times of effects are written in the log's clock
    centre  [s] of the log, grid's clock: written where an effect turns about it, for a flight's may be another
    """
    effects = [_in_log_time(cause, shift, centre) for cause in causes]
    effects += [effect(each.cause, **each.values) for each in weather]
    return with_controller(replace(nominal, name=f"{nominal.name}-extended", effects=(*nominal.effects, *effects)),
                           controller)


def with_controller(nominal: Nominal, found: ControllerCheck | None) -> Nominal:
    """The nominal with the controller on board, if it is known: its filter, and gains and computing time as an
    effect."""
    if found is None or not found.is_named:
        return nominal
    own = nominal.controller
    if own is not None and found.time_constant is not None:
        own = replace(own, derivative_time_constant=found.time_constant)
    mismatch = MISMATCH.effect((found.kp_scale, found.kd_scale, found.delay))
    return replace(nominal, controller=own, effects=(*nominal.effects, mismatch))


def _in_log_time(cause: Cause, shift: float, centre: float) -> Effect:
    given = tuple(value + shift if free.name == "time" else value
                  for free, value in zip(cause.hypothesis.free, cause.values, strict=True))
    made = cause.hypothesis.effect(given)
    known = values(made)
    return effect(made.name, **{**known, "middle": centre + shift}) if "middle" in known else made
