"""Read a nominal from the table of its TOML file, section by section."""

import math
import tomllib
from dataclasses import MISSING, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError, UsageError, did_you_mean
from ..files import reads
from ..sections import (
    DRIFT_RATES,
    MOST_MODES,
    Bending,
    Controller,
    Diagnosis,
    Drift,
    Forecast,
    Nominal,
    Offsets,
    Profile,
    Required,
    Sensors,
    Simulation,
    Slosh,
    Wind,
)
from .control import actuator_of, controller_of, guidance_of, test_input_of
from .profiles import DRIFT_COLUMNS, FORECAST, VEHICLE, constant_profile
from .table import Table

if TYPE_CHECKING:
    from ..effects import Effect

RADIANS_PER_STEP = 0.5  # as of `effects.catalogue`: what Runge-Kutta 4 resolves of an oscillation
PARTS_OF_PERIOD = 50  # of the shorter period, beyond the fewest, tried for a step that divides both


def text_of(path: Path, expected: str = "expected a nominal TOML file") -> str:
    """Return the text of a nominal file; InputError, with `expected` where there is no file, if it cannot be read."""
    reads(path)
    try:
        return path.read_bytes().decode("utf-8-sig")  # TOML knows no byte order mark, editors write one
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); {expected}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is not UTF-8; expected a nominal TOML file") from None


def parsed(path: Path, text: str) -> Nominal:
    """Return the nominal that a TOML text defines, checked; InputError naming file and place."""
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # TOMLDecodeError is a ValueError; so is an integer of 5000 digits
        swapped = ": this looks like a log, which comes before the nominal" if path.suffix == ".csv" else ""
        raise InputError(f"{path}: {error}; expected TOML{swapped}") from None
    return nominal_of(Table(path, table))


def nominal_of(file: Table) -> Nominal:
    """Return the nominal of a table, all sections checked; InputError naming the place of whatever is wrong."""
    known = {"name", "vehicle", "uncertainty", "actuator", "controller", "guidance", "sensors", "simulation",
             "diagnosis", "margins", "test_input", "drift", "wind", "offsets", "effects", "slosh", "bending"}
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
        **drift_rates_of(file),
        actuator=actuator_of(file), controller=controller, guidance=guidance_of(file, controller),
        simulation=simulation, diagnosis=diagnosis or Diagnosis(),
        margins=file.section("margins", Required) or Required(), test_input=test_input_of(file),
        drift=drift_of(file), wind=wind_of(file),
        offsets=file.section("offsets", Offsets), slosh=modes_of(file, "slosh", Slosh, simulation),
        bending=modes_of(file, "bending", Bending, simulation), effects=effects_of(file), path=str(file.path))


def with_whole_steps(file: Table, simulation: Simulation, controller: Controller | None,
                     sensors: Sensors) -> Simulation:
    """Return [simulation] with, if the file names no step, the longest up to the default that divides the controller's
    and the sensors' periods; InputError if a period is no whole number of steps."""
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
    """Return the longest step [s], at most `longest`, that divides all periods [s]; `longest` where there is none."""
    shortest = min(periods)
    first = max(1, math.ceil(shortest / longest - 1e-9))
    for parts in range(first, first + PARTS_OF_PERIOD):
        if all(_is_whole(period, shortest / parts) for period in periods):
            return longest if abs(shortest / parts / longest - 1.0) < 1e-9 else shortest / parts
    return longest


# ---- the sections that fly: [vehicle] and its range, [drift], [wind], [[effects]]


def vehicle_of(file: Table) -> tuple[Profile, tuple[tuple[str, float], ...]]:
    """Return a6 and k1 over time, and further terms (name, coefficient), of [vehicle]; InputError if wrong."""
    table = file.keys("vehicle", {"a6", "k1", "profile", "terms"}, set())
    for key, what in (("profile", "a profile"), ("terms", "terms")):
        if key in table and len(table) > 1:
            raise InputError(f"{file.path}: [vehicle] has {what} and other keys; expected one or the other")
    if "profile" in table:
        return profile_of(file, "vehicle.profile", table["profile"]), ()
    if "terms" in table:
        terms = terms_of(file, table["terms"])
        return (constant_profile(terms.pop("theta", 0.0), terms.pop("beta", 0.0)), tuple(terms.items()))
    file.keys("vehicle", {"a6", "k1"}, {"a6", "k1"})
    return constant_profile(file.number("vehicle.a6", table["a6"]), file.number("vehicle.k1", table["k1"])), ()


def profile_of(file: Table, place: str, value: object) -> Profile:
    columns, path = file.csv(place, value, VEHICLE)
    return Profile(path=path, **columns)


def terms_of(file: Table, table: object) -> dict[str, float]:
    """Return [vehicle.terms], canonical name of a library term -> its coefficient; InputError if wrong."""
    if not isinstance(table, dict) or not table:
        raise file.fail("vehicle.terms", table, "library terms with their coefficients")
    from ..effects import effect
    terms: dict[str, float] = {}
    for key, value in table.items():
        coefficient = file.number(f"vehicle.terms.{key!r}", value)
        try:
            name = effect("missing_term", term=key, coefficient=coefficient).values[0]
        except UsageError:
            raise InputError(f"{file.path}: [vehicle.terms] {key!r}: expected a library term of theta, theta_dot, "
                             "beta such as theta^3 or sin(theta)") from None
        if name in terms:
            raise InputError(f"{file.path}: [vehicle.terms] {key!r}: the term {name!r} stands twice")
        terms[str(name)] = coefficient
    return terms


def uncertainty_of(file: Table) -> Profile | None:
    if "uncertainty" not in file.table:
        return None
    table = file.keys("uncertainty", {"a6", "k1", "profile", *DRIFT_RATES}, set())
    if table and all(key in DRIFT_RATES for key in table):
        return None
    if "profile" in table:
        sigma = profile_of(file, "uncertainty.profile", table["profile"])
        if not (np.all(sigma.a6 > 0) and np.all(sigma.k1 > 0)):
            raise file.fail("uncertainty.profile", table["profile"], "every sigma above 0")
        return sigma
    file.keys("uncertainty", {"a6", "k1", *DRIFT_RATES}, {"a6", "k1"})
    return constant_profile(file.number("uncertainty.a6", table["a6"], above=0.0),
                            file.number("uncertainty.k1", table["k1"], above=0.0))


def drift_rates_of(file: Table) -> dict[str, float]:
    """Return what [uncertainty] declares of how fast a6 and k1 leave the profile, 1/min."""
    table = file.table.get("uncertainty", {})
    return {key: file.number(f"uncertainty.{key}", table[key], least=0.0) for key in DRIFT_RATES if key in table}


def drift_of(file: Table) -> Drift | None:
    """Return [drift], from two numbers or a CSV file; None without it; InputError if wrong."""
    if "drift" not in file.table:
        return None
    table = file.keys("drift", {"z_alpha", "z_beta", "profile"}, set())
    if "profile" in table:
        if len(table) > 1:
            raise InputError(f"{file.path}: [drift] has a profile and other keys; expected one or the other")
        columns, path = file.csv("drift.profile", table["profile"], DRIFT_COLUMNS)
        return Drift(path=path, **columns)
    file.keys("drift", {"z_alpha", "z_beta", "profile"}, {"z_alpha", "z_beta"})
    z_alpha, z_beta = (np.array([file.number(f"drift.{key}", table[key])]) for key in DRIFT_COLUMNS[1:])
    return Drift(np.zeros(1), z_alpha, z_beta)


def wind_of(file: Table) -> Wind | None:
    """Return [wind]: levels, and a forecast from a CSV file; None without it; InputError if wrong."""
    if "wind" not in file.table:
        return None
    table = dict(file.keys("wind", {f.name for f in fields(Wind)}, set()))
    forecast = None
    if "profile" in table:
        columns, path = file.csv("wind.profile", table.pop("profile"), FORECAST)
        forecast = Forecast(path=path, **columns)
    return Wind(profile=forecast, **file.values("wind", table))


def modes_of(file: Table, section: str, kind: type[Any], simulation: Simulation | None) -> tuple[Any, ...]:
    """Return [[slosh]] or [[bending]] in the order of the file, () without any; InputError if wrong."""
    tables = file.table.get(section, [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise file.fail(section, tables, f"[[{section}]] tables")
    if len(tables) > MOST_MODES:
        raise InputError(f"{file.path}: [[{section}]] stands {len(tables)} times; expected at most {MOST_MODES}")
    return tuple(mode_of(file, f"{section}[{k}]", table, kind, simulation) for k, table in enumerate(tables))


def mode_of(file: Table, place: str, table: dict[str, Any], kind: type[Any], simulation: Simulation | None) -> Any:
    """Return one mode, each of its numbers in its range, and its frequency within what the simulation resolves."""
    from ..effects import CATALOGUE
    known = {f.name: f for f in fields(kind)}
    ranges = {p.name: p for p in CATALOGUE[kind.__name__.lower()].parameters}
    for key in table:
        if key not in known:
            raise InputError(f"{file.path}: unknown key '{place}.{key}'; "
                             + did_you_mean(key, sorted(known), f"expected one of {', '.join(sorted(known))}"))
    for key, field in known.items():
        if field.default is MISSING and key not in table:
            raise InputError(f"{file.path}: key '{place}.{key}' is missing")
    given: dict[str, Any] = {}
    for key, value in table.items():
        if key.endswith("_sigma"):
            given[key] = file.number(f"{place}.{key}", value, least=0.0)
            continue
        given[key] = file.in_time(f"{place}.{key}", value)
        allowed = ranges.get(key, ranges.get("gain"))
        for x in given[key].value:
            if allowed is not None and not allowed.allows(x):
                raise file.fail(f"{place}.{key}", x, allowed.expected)
    mode = kind(**given)
    if isinstance(mode, Bending) and mode.gyro_gain is not None and any(mode.gain.value):
        t = np.union1d(mode.gain.t, mode.gyro_gain.t)
        gain, seen = mode.gain.at(t), mode.gyro_gain.at(t)
        if not np.allclose(seen * (gain @ gain), gain * (gain @ seen), rtol=1e-6, atol=1e-12):
            raise file.fail(f"{place}.gyro_gain", list(mode.gyro_gain.value), "the same share of gain at all times")
    fastest = max(given["frequency"].value)
    if simulation is not None and fastest * simulation.step > RADIANS_PER_STEP:
        raise file.fail(f"{place}.frequency", fastest, f"at most {RADIANS_PER_STEP / simulation.step:g} rad/s, what "
                        f"the simulation's step of {simulation.step:g} s resolves")
    return mode


def effects_of(file: Table) -> tuple["Effect", ...]:
    """Return [[effects]] in the order of the file, () without any; InputError if wrong."""
    tables = file.table.get("effects", [])
    if not isinstance(tables, list):
        raise file.fail("effects", tables, "[[effects]] tables")
    if not tables:
        return ()
    from ..effects import from_table
    effects = []
    for k, table in enumerate(tables):
        try:
            effects.append(from_table(table))
        except UsageError as error:
            raise InputError(f"{file.path}: effects[{k}]: {error}") from None
    return tuple(effects)
