"""The extended model: the nominal with the causes as `[[effects]]`, which `simulate` flies and `diagnose` accepts."""

from collections.abc import Iterable
from dataclasses import replace

from ..effects import Effect, effect
from ..nominal import Nominal
from .controller_check import ControllerCheck
from .fit import Cause


def extended(nominal: Nominal, causes: Iterable[Cause], shift: float = 0.0,
             controller: ControllerCheck | None = None) -> Nominal:
    """The nominal with these causes.

    shift  [s] log's clock less the grid's: times of effects are written in the log's clock
    """
    effects = [_in_log_time(cause, shift) for cause in causes]
    effects += of_controller(controller)
    return replace(nominal, name=f"{nominal.name}-extended", effects=(*nominal.effects, *effects))


def of_controller(controller: ControllerCheck | None) -> list[Effect]:
    """The controller's mismatch as an effect, if it is one."""
    if controller is None or not controller.is_named:
        return []
    return [effect("controller_mismatch", kp_scale=controller.kp_scale, kd_scale=controller.kd_scale,
                   delay=controller.delay)]


def _in_log_time(cause: Cause, shift: float) -> Effect:
    values = tuple(value + shift if free.name == "time" else value
                   for free, value in zip(cause.hypothesis.free, cause.values, strict=True))
    return cause.hypothesis.effect(values)
