"""A nominal out of the table of its file."""

import math
import tomllib
from dataclasses import replace
from pathlib import Path

from ..errors import InputError, did_you_mean
from ..files import reads
from ..sections import Controller, Diagnosis, Nominal, Offsets, Required, Sensors, Simulation
from .control import actuator_of, controller_of, guidance_of, test_input_of
from .plant import drift_of, effects_of, uncertainty_of, vehicle_of, wind_of
from .table import Table

PARTS_OF_PERIOD = 50  # of the shorter period, beyond the fewest, tried for a step that divides both


def text_of(path: Path, expected: str = "expected a nominal TOML file") -> str:
    """The text of a nominal file; InputError in one line if it has none; `expected` where there is no file."""
    reads(path)
    try:
        return path.read_bytes().decode("utf-8-sig")  # TOML knows no byte order mark, editors write one
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); {expected}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is not UTF-8; expected a nominal TOML file") from None


def parsed(path: Path, text: str) -> Nominal:
    """The nominal of a file's text, checked."""
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # TOMLDecodeError is a ValueError; so is an integer of 5000 digits
        swapped = ": this looks like a log, which comes before the nominal" if path.suffix == ".csv" else ""
        raise InputError(f"{path}: {error}; expected TOML{swapped}") from None
    return nominal_of(Table(path, table))


def nominal_of(file: Table) -> Nominal:
    """All sections, checked; InputError naming the place of whatever is wrong."""
    known = {"name", "vehicle", "uncertainty", "actuator", "controller", "guidance", "sensors", "simulation",
             "diagnosis", "margins", "test_input", "drift", "wind", "offsets", "effects"}
    for key in file.table:
        if key not in known:
            raise InputError(f"{file.path}: unknown key '{key}'; "
                             + did_you_mean(key, sorted(known), f"expected one of {', '.join(sorted(known))}"))
    name = file.table.get("name", file.path.stem)
    if not isinstance(name, str):
        raise file.fail("name", name, "a text")
    for section in ("vehicle", "sensors"):
        if section not in file.table:
            raise InputError(f"{file.path}: section [{section}] is missing; every nominal needs it")
    simulation = file.section("simulation", Simulation)
    diagnosis = file.section("diagnosis", Diagnosis)
    controller = controller_of(file)
    sensors = file.section("sensors", Sensors)
    assert sensors is not None
    if simulation is not None:
        simulation = with_whole_steps(file, simulation, controller, sensors)
    vehicle, terms = vehicle_of(file)
    return Nominal(
        name=name, vehicle=vehicle, terms=terms, sensors=sensors, uncertainty=uncertainty_of(file),
        actuator=actuator_of(file), controller=controller, guidance=guidance_of(file, controller),
        simulation=simulation, diagnosis=diagnosis or Diagnosis(),
        margins=file.section("margins", Required) or Required(), test_input=test_input_of(file),
        drift=drift_of(file), wind=wind_of(file),
        offsets=file.section("offsets", Offsets), effects=effects_of(file), path=str(file.path))


def with_whole_steps(file: Table, simulation: Simulation, controller: Controller | None,
                     sensors: Sensors) -> Simulation:
    """The controller's and the sensors' periods must be whole numbers of integration steps; where the file names no
    step, it is the longest up to the default for which they are."""
    periods = {"sensors.period": sensors.period}
    if controller is not None:
        periods["controller.period"] = controller.period
    if "step" not in file.table["simulation"]:
        simulation = replace(simulation, step=_whole_step(simulation.step, tuple(periods.values())))
    for place, period in periods.items():
        if not _is_whole(period, simulation.step):
            raise file.fail(place, period, f"a whole number of simulation steps ({simulation.step} s)")
    return simulation


def _is_whole(period: float, step: float) -> bool:
    steps = period / step
    return round(steps) >= 1 and abs(steps - round(steps)) <= 1e-6


def _whole_step(longest: float, periods: tuple[float, ...]) -> float:
    """The longest step [s], at most `longest`, of which all periods [s] are whole numbers; `longest` where there is
    none."""
    shortest = min(periods)
    first = max(1, math.ceil(shortest / longest - 1e-9))
    for parts in range(first, first + PARTS_OF_PERIOD):
        if all(_is_whole(period, shortest / parts) for period in periods):
            return longest if abs(shortest / parts / longest - 1.0) < 1e-9 else shortest / parts
    return longest
