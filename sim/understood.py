"""What a command has no model of is refused in one line, not ignored."""

import numpy as np

from .errors import InputError
from .log import Log
from .nominal import Nominal

FLIGHT_PATH = ("gamma", "alpha")  # columns of a log


def refuse_foreign_loop(nominal: Nominal, who: str) -> None:
    """InputError naming the section for which the loop is no rigid body, second-order servo and PD of attitude."""
    actuator, controller = nominal.actuator, nominal.controller
    _refuse(nominal, who, (
        ("[drift]", nominal.drift is not None),
        ("[actuator] time_constant", actuator is not None and actuator.is_first_order),
        ('[controller] law = "rate"', controller is not None and controller.is_rate_law),
        ("[[controller.filters]]", controller is not None and len(controller.filters) > 0)))


def refuse_foreign_world(nominal: Nominal, who: str) -> None:
    """InputError naming the section with which the world is not calm and known; levels of 0 pass."""
    wind, offsets = nominal.wind, nominal.offsets
    _refuse(nominal, who, (
        ("[wind]", wind is not None and not wind.is_calm),
        ("[offsets]", offsets is not None and not offsets.is_known)))


def refuse_flight_path(log: Log, who: str) -> None:
    """InputError naming the column of a log that tells of the flight path."""
    for name in FLIGHT_PATH:
        if name in log.columns and np.isfinite(getattr(log, name)).any():
            raise InputError(f"{log.path}: line 1: column {name}: {who} has no model of the flight path yet; "
                             "expected a log without it")


def _refuse(nominal: Nominal, who: str, sections: tuple[tuple[str, bool], ...]) -> None:
    for name, is_there in sections:
        if is_there:
            raise InputError(f"{nominal.path}: {name}: {who} has no model of it yet; expected a nominal without it")
