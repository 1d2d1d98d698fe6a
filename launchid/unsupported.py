"""The refusal, in one line, of what a command has no model of: it is not ignored."""

from sim.errors import InputError
from sim.nominal import Nominal


def refuse_foreign_loop(nominal: Nominal, who: str) -> None:
    """InputError naming the section for which the loop is no rigid body, second-order servo and PD of attitude."""
    actuator, controller = nominal.actuator, nominal.controller
    _refuse(nominal, who, (
        ("[drift]", nominal.drift is not None),
        ("[actuator] time_constant", actuator is not None and actuator.is_first_order),
        ('[controller] law = "rate"', controller is not None and controller.is_rate_law),
        ("[[controller.filters]]", controller is not None and len(controller.filters) > 0)))


def _refuse(nominal: Nominal, who: str, sections: tuple[tuple[str, bool], ...]) -> None:
    for name, is_there in sections:
        if is_there:
            raise InputError(f"{nominal.path}: {name}: {who} has no model of it yet; expected a nominal without it")
