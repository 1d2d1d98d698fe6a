"""What the simulation believes: a TOML file <-> the frozen dataclasses of `sections`.

The schema by example is `sim/data/nominal/constant.toml`.  Unknown keys are
refused; every message names the file, the key, the value and what was expected.
SI units throughout (s, rad).
"""

import json
import math
import os
import tomllib
from collections.abc import Iterator
from dataclasses import MISSING, Field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .csv_text import AS_TEXT, rows
from .errors import InputError, UsageError
from .files import reads, write_text
from .log_table import number, shown
from .sections import (
    Actuator,
    Controller,
    Diagnosis,
    Drift,
    Forecast,
    Guidance,
    Multisine,
    Nominal,
    Offsets,
    Profile,
    Section,
    Sensors,
    Simulation,
    Wind,
)

if TYPE_CHECKING:
    from .effects import Effect

__all__ = ["BUILT_IN", "Actuator", "Controller", "Diagnosis", "Drift", "Forecast", "Guidance", "Multisine", "Nominal",
           "Offsets", "Profile", "Section", "Sensors", "Simulation", "Wind", "built_in", "constant_profile",
           "load_nominal", "locate", "nominal_lines", "read_profile", "write_nominal"]

DATA = Path(__file__).parent / "data"
BUILT_IN = ("constant", "vega_like", "greensite_cr826")  # launchers, which fly
STANDS = ("pendulum_linear", "servo_xl330", "single_pendulum_linear", "balancing_robot", "tailsitter_roll",
          "hobby_rocket_tvc", "aeropendulum", "sounding_rocket_roll")  # what others measured: for `diagnose`


def built_in(name: str) -> Path:
    """Path of a nominal that comes with the package."""
    return DATA / "nominal" / f"{name}.toml"


def locate(text: str) -> Path:
    """A nominal by path, or by the name of a built-in one when no such file exists."""
    path = Path(text)
    return built_in(text) if text in BUILT_IN + STANDS and not path.exists() else path


def load_nominal(path: str | Path) -> Nominal:
    """Read and check a nominal file; InputError in one line if it cannot be used."""
    path = locate(str(path))
    reads(path)
    try:
        text = path.read_bytes().decode("utf-8-sig")  # TOML knows no byte order mark, editors write one
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected a nominal TOML file "
                         f"or one of {', '.join(BUILT_IN)}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is not UTF-8; expected a nominal TOML file") from None
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # TOMLDecodeError is a ValueError; so is an integer of 5000 digits
        raise InputError(one_line(f"{path}: {error}; expected TOML")) from None
    try:
        return Reader(path, table).nominal()
    except InputError as error:
        raise InputError(one_line(str(error))) from None


def one_line(text: str) -> str:
    """A message in one line, whatever keys and paths hold."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


LARGEST = 1e300  # a number beyond it is no physical quantity
WORDS = {"law": ("attitude", "rate"), "alpha_source": ("inertial", "air")}  # keys that are no numbers
POSITIVE = {"natural_frequency", "deflection_limit", "period", "step", "duration", "time_constant", "turbulence_time",
            "time_limit"}
SIGNED = {"kp", "kd", "ki"}
ONLY_ATTITUDE, ONLY_RATE = ("kd", "derivative_time_constant"), ("ki",)  # keys of the controller's laws
VEHICLE, DRIFT, FORECAST = ("t", "a6", "k1"), ("t", "z_alpha", "z_beta"), ("t", "wind")  # headers of CSV files


class Reader:
    """Turns the parsed table of one file into a Nominal, naming the place of whatever is wrong."""

    def __init__(self, path: Path, table: dict[str, Any]) -> None:
        self.path = path
        self.table = table

    def fail(self, place: str, value: object, expected: str) -> InputError:
        shown = repr(value) if not isinstance(value, int) or abs(value) < 10**40 else "an integer of many digits"
        return InputError(f"{self.path}: {place} = {shown}: expected {expected}")

    def nominal(self) -> Nominal:
        known = {"name", "vehicle", "uncertainty", "actuator", "controller", "guidance", "sensors", "simulation",
                 "diagnosis", "test_input", "drift", "wind", "offsets", "effects"}
        for key in self.table:
            if key not in known:
                raise InputError(f"{self.path}: unknown key '{key}'; expected one of {', '.join(sorted(known))}")
        name = self.table.get("name", self.path.stem)
        if not isinstance(name, str):
            raise self.fail("name", name, "a text")
        for section in ("vehicle", "sensors"):
            if section not in self.table:
                raise InputError(f"{self.path}: section [{section}] is missing; every nominal needs it")
        simulation = self.section("simulation", Simulation)
        diagnosis = self.section("diagnosis", Diagnosis)
        controller = self.controller()
        sensors = self.section("sensors", Sensors)
        assert sensors is not None
        if simulation is not None:
            self.whole_steps(simulation, controller, sensors)
        vehicle, terms = self.vehicle()
        return Nominal(
            name=name, vehicle=vehicle, terms=terms, sensors=sensors, uncertainty=self.uncertainty(),
            actuator=self.actuator(), controller=controller, guidance=self.guidance(controller), simulation=simulation,
            diagnosis=diagnosis or Diagnosis(), test_input=self.test_input(), drift=self.drift(), wind=self.wind(),
            offsets=self.section("offsets", Offsets), effects=self.effects(), path=str(self.path))

    def keys(self, section: str, allowed: set[str], required: set[str]) -> dict[str, Any]:
        table = self.table[section]
        if not isinstance(table, dict):
            raise self.fail(section, table, "a section")
        for key in table:
            if key not in allowed:
                raise InputError(f"{self.path}: unknown key '{section}.{key}'; "
                                 f"expected one of {', '.join(sorted(allowed))}")
        for key in sorted(required - set(table)):
            raise InputError(f"{self.path}: key '{section}.{key}' is missing")
        return table

    def number(self, place: str, value: object, above: float | None = None, least: float | None = None) -> float:
        expected = "a number" + (f" above {above:g}" if above is not None else "") + \
            (f" of at least {least:g}" if least is not None else "")
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not -LARGEST < value < LARGEST:
            raise self.fail(place, value, expected)
        if (above is not None and not value > above) or (least is not None and not value >= least):
            raise self.fail(place, value, expected)
        return float(value)

    def section(self, section: str, kind: type) -> Any:
        """A section whose keys are the fields of a dataclass of numbers and words."""
        if section not in self.table:
            return None
        names = {f.name for f in fields(kind)}
        required = {f.name for f in fields(kind) if f.default is MISSING}
        return kind(**self.values(section, self.keys(section, names, required)))

    def values(self, section: str, table: dict[str, Any]) -> dict[str, Any]:
        """The numbers and words of a section, checked by their keys."""
        return {key: self.value(f"{section}.{key}", key, value) for key, value in table.items()}

    def value(self, place: str, key: str, value: object) -> float | str:
        if key in WORDS:
            if not isinstance(value, str) or value not in WORDS[key]:
                raise self.fail(place, value, " or ".join(f'"{word}"' for word in WORDS[key]))
            return value
        if key in POSITIVE:
            return self.number(place, value, above=0.0)
        return self.number(place, value, least=None if key in SIGNED else 0.0)

    def actuator(self) -> Actuator | None:
        """[actuator]: natural_frequency and damping_ratio, or time_constant."""
        if "actuator" not in self.table:
            return None
        table = self.keys("actuator", {f.name for f in fields(Actuator)}, set())
        second = {"natural_frequency", "damping_ratio"}
        if "time_constant" in table and second & set(table):
            raise InputError(f"{self.path}: [actuator] has time_constant and {min(second & set(table))}; expected "
                             "natural_frequency and damping_ratio, or time_constant")
        for key in sorted(second - set(table)) if "time_constant" not in table else ():
            raise InputError(f"{self.path}: key 'actuator.{key}' is missing; expected natural_frequency and "
                             "damping_ratio, or time_constant")
        return Actuator(**self.values("actuator", table))

    def controller(self) -> Controller | None:
        """[controller] of either law, with [[controller.filters]]."""
        if "controller" not in self.table:
            return None
        names = {f.name for f in fields(Controller)}
        table = dict(self.keys("controller", names, {"kp", "period"}))
        filters = table.pop("filters", [])
        given = self.values("controller", table)
        law = given.get("law", "attitude")
        for key in ONLY_RATE if law == "attitude" else ONLY_ATTITUDE:
            if key in given:
                raise InputError(f"{self.path}: key 'controller.{key}' is not of law \"{law}\"; expected it left out")
        if law == "attitude":
            self.keys("controller", names, {"kp", "period", *ONLY_ATTITUDE})
        elif law == "rate":
            given |= dict.fromkeys(ONLY_ATTITUDE, 0.0)
        return Controller(filters=self.filters(filters, float(given["period"])), **given)

    def filters(self, tables: object, period: float) -> tuple[Section, ...]:
        """[[controller.filters]]: sections at the controller's period [s], by coefficients or by kind."""
        if not isinstance(tables, list):
            raise self.fail("controller.filters", tables, "[[controller.filters]] tables")
        return tuple(self.filter(f"controller.filters[{k}]", table, period) for k, table in enumerate(tables))

    def filter(self, place: str, table: object, period: float) -> Section:
        if not isinstance(table, dict):
            raise self.fail(place, table, "a table with b and a, or with kind")
        kind = table.get("kind", "")
        names = KINDS.get(kind) if isinstance(kind, str) else None
        if names is None:
            raise self.fail(f"{place}.kind", kind, " or ".join(f'"{word}"' for word in KINDS if word))
        for key in table:
            if key not in {*names, *(["kind"] if kind else [])}:
                raise InputError(f"{self.path}: unknown key '{place}.{key}'; expected one of {', '.join(names)}")
        for key in names:
            if key not in table:
                raise InputError(f"{self.path}: key '{place}.{key}' is missing")
        if not kind:
            return self.coefficients(place, table)
        numbers = [self.number(f"{place}.{key}", table[key], least=0.0) for key in names]
        if not 0.0 < numbers[0] * period < math.pi:
            raise self.fail(f"{place}.frequency", table["frequency"],
                            f"a number above 0 and below {math.pi / period:g} rad/s, half the controller's rate")
        return tustin(kind, period, *numbers)

    def coefficients(self, place: str, table: dict[str, Any]) -> Section:
        b, a = (self.numbers(f"{place}.{key}", table[key]) for key in ("b", "a"))
        for key, values in (("b", b), ("a", a)):
            if len(values) != 3:
                raise self.fail(f"{place}.{key}", list(values), "three numbers")
        if a[0] != 1.0:
            raise self.fail(f"{place}.a", list(a), "1 as the first number")
        return Section((b[0], b[1], b[2]), (a[0], a[1], a[2]))

    def drift(self) -> Drift | None:
        """[drift]: two numbers, or a CSV file."""
        if "drift" not in self.table:
            return None
        table = self.keys("drift", {"z_alpha", "z_beta", "profile"}, set())
        if "profile" in table:
            if len(table) > 1:
                raise InputError(f"{self.path}: [drift] has a profile and other keys; expected one or the other")
            columns, path = self.csv("drift.profile", table["profile"], DRIFT)
            return Drift(path=path, **columns)
        self.keys("drift", {"z_alpha", "z_beta", "profile"}, {"z_alpha", "z_beta"})
        z_alpha, z_beta = (np.array([self.number(f"drift.{key}", table[key])]) for key in DRIFT[1:])
        return Drift(np.zeros(1), z_alpha, z_beta)

    def wind(self) -> Wind | None:
        """[wind]: levels, and a forecast from a CSV file."""
        if "wind" not in self.table:
            return None
        table = dict(self.keys("wind", {f.name for f in fields(Wind)}, set()))
        forecast = None
        if "profile" in table:
            columns, path = self.csv("wind.profile", table.pop("profile"), FORECAST)
            forecast = Forecast(path=path, **columns)
        return Wind(profile=forecast, **self.values("wind", table))

    def csv(self, place: str, value: object, header: tuple[str, ...]) -> tuple[dict[str, np.ndarray], str]:
        """The columns of a CSV file beside the nominal, and its path."""
        if not isinstance(value, str):
            raise self.fail(place, value, f"the path of a CSV file {','.join(header)}")
        path = self.path.parent / value
        return read_columns(path, header), str(path)

    def whole_steps(self, simulation: Simulation, controller: Controller | None, sensors: Sensors) -> None:
        """The controller's and the sensors' periods must be whole numbers of integration steps."""
        periods = {"sensors.period": sensors.period}
        if controller is not None:
            periods["controller.period"] = controller.period
        for place, period in periods.items():
            steps = period / simulation.step
            if round(steps) < 1 or abs(steps - round(steps)) > 1e-6:
                raise self.fail(place, period, f"a whole number of simulation steps ({simulation.step} s)")

    def profile(self, place: str, value: object) -> Profile:
        columns, path = self.csv(place, value, VEHICLE)
        return Profile(path=path, **columns)

    def vehicle(self) -> tuple[Profile, tuple[tuple[str, float], ...]]:
        """a6 and k1 over time, and the further terms: from two numbers, a CSV file, or terms with coefficients."""
        table = self.keys("vehicle", {"a6", "k1", "profile", "terms"}, set())
        for key, what in (("profile", "a profile"), ("terms", "terms")):
            if key in table and len(table) > 1:
                raise InputError(f"{self.path}: [vehicle] has {what} and other keys; expected one or the other")
        if "profile" in table:
            return self.profile("vehicle.profile", table["profile"]), ()
        if "terms" in table:
            terms = self.terms(table["terms"])
            return (constant_profile(terms.pop("theta", 0.0), terms.pop("beta", 0.0)), tuple(terms.items()))
        self.keys("vehicle", {"a6", "k1"}, {"a6", "k1"})
        return constant_profile(self.number("vehicle.a6", table["a6"]), self.number("vehicle.k1", table["k1"])), ()

    def terms(self, table: object) -> dict[str, float]:
        """[vehicle.terms]: canonical name of a library term -> its coefficient."""
        if not isinstance(table, dict) or not table:
            raise self.fail("vehicle.terms", table, "library terms with their coefficients")
        from .effects import effect
        found: dict[str, float] = {}
        for key, value in table.items():
            coefficient = self.number(f"vehicle.terms.{key!r}", value)
            try:
                name = effect("missing_term", term=key, coefficient=coefficient).values[0]
            except UsageError:
                raise InputError(f"{self.path}: [vehicle.terms] {key!r}: expected a library term of theta, theta_dot, "
                                 "beta such as theta^3 or sin(theta)") from None
            if name in found:
                raise InputError(f"{self.path}: [vehicle.terms] {key!r}: the term {name!r} stands twice")
            found[str(name)] = coefficient
        return found

    def effects(self) -> tuple["Effect", ...]:
        """[[effects]], in the order of the file."""
        tables = self.table.get("effects", [])
        if not isinstance(tables, list):
            raise self.fail("effects", tables, "[[effects]] tables")
        if not tables:
            return ()
        from .effects import from_table
        found = []
        for k, table in enumerate(tables):
            try:
                found.append(from_table(table))
            except UsageError as error:
                raise InputError(f"{self.path}: effects[{k}]: {error}") from None
        return tuple(found)

    def uncertainty(self) -> Profile | None:
        if "uncertainty" not in self.table:
            return None
        table = self.keys("uncertainty", {"a6", "k1", "profile"}, set())
        if "profile" in table:
            sigma = self.profile("uncertainty.profile", table["profile"])
            if not (np.all(sigma.a6 > 0) and np.all(sigma.k1 > 0)):
                raise self.fail("uncertainty.profile", table["profile"], "every sigma above 0")
            return sigma
        self.keys("uncertainty", {"a6", "k1"}, {"a6", "k1"})
        return constant_profile(self.number("uncertainty.a6", table["a6"], above=0.0),
                                self.number("uncertainty.k1", table["k1"], above=0.0))

    def guidance(self, controller: Controller | None) -> Guidance | None:
        """[guidance]: theta_ref, for the law `rate` also or instead rate_ref."""
        if "guidance" not in self.table:
            return None
        keys = ("t", "theta_ref", "rate_ref")
        table = self.keys("guidance", set(keys), {"t"})
        alone = "rate_ref" in table and controller is not None and controller.is_rate_law
        self.keys("guidance", set(keys), {"t"} if alone else {"t", "theta_ref"})
        columns = {key: self.numbers(f"guidance.{key}", table[key]) for key in keys if key in table}
        self.same_length("guidance", columns)
        if any(b <= a for a, b in zip(columns["t"], columns["t"][1:], strict=False)):
            raise self.fail("guidance.t", list(columns["t"]), "increasing times")
        return Guidance(**{"theta_ref": (0.0,) * len(columns["t"])} | columns)

    def test_input(self) -> Multisine | None:
        if "test_input" not in self.table:
            return None
        names = {f.name for f in fields(Multisine)}
        table = self.keys("test_input", names, names)
        columns = {"frequency": self.numbers("test_input.frequency", table["frequency"], above=0.0),
                   "amplitude": self.numbers("test_input.amplitude", table["amplitude"], least=0.0),
                   "phase": self.numbers("test_input.phase", table["phase"])}
        self.same_length("test_input", columns)
        return Multisine(self.number("test_input.start", table["start"], least=0.0),
                         self.number("test_input.duration", table["duration"], above=0.0), **columns)

    def numbers(self, place: str, value: object, above: float | None = None,
                least: float | None = None) -> tuple[float, ...]:
        """A list of at least one number."""
        if not isinstance(value, list) or not value:
            raise self.fail(place, value, "a list of numbers")
        return tuple(self.number(f"{place}[{i}]", x, above, least) for i, x in enumerate(value))

    def same_length(self, section: str, columns: dict[str, tuple[float, ...]]) -> None:
        (first, head), *others = columns.items()
        for key, column in others:
            if len(column) != len(head):
                raise InputError(f"{self.path}: {section}.{first} has {len(head)} numbers and {section}.{key} "
                                 f"{len(column)}; expected as many")


def constant_profile(a6: float, k1: float) -> Profile:
    """The same a6 and k1 at all times."""
    return Profile(np.zeros(1), np.array([a6]), np.array([k1]))


# keys of a filter by its kind; "": by its coefficients
KINDS = {"": ("b", "a"), "notch": ("frequency", "depth_damping", "width_damping"),
         "lowpass": ("frequency", "damping_ratio")}


def tustin(kind: str, period: float, frequency: float, *damping: float) -> Section:
    """The continuous notch or lowpass by Tustin's rule, prewarped at w = frequency [rad/s]: s = w/c (z - 1)/(z + 1),
    c = tan(w period/2) (Astrom and Wittenmark, Computer-Controlled Systems, 3rd ed., ch. 8.3).

    damping  notch: of the numerator, of the denominator; lowpass: of the denominator
    """
    c = math.tan(0.5 * frequency * period)

    def quadratic(zeta: float) -> tuple[float, float, float]:
        """c^2/w^2 (s^2 + 2 zeta w s + w^2) (z + 1)^2, powers of z falling."""
        return 1.0 + 2.0 * zeta * c + c * c, 2.0 * (c * c - 1.0), 1.0 - 2.0 * zeta * c + c * c

    numerator = quadratic(damping[0]) if kind == "notch" else (c * c, 2.0 * c * c, c * c)
    a0, a1, a2 = quadratic(damping[-1])
    b0, b1, b2 = numerator
    return Section((b0 / a0, b1 / a0, b2 / a0), (1.0, a1 / a0, a2 / a0))


def read_profile(path: Path) -> Profile:
    """Read a CSV with the header t,a6,k1 and increasing times; InputError naming line and column otherwise."""
    return Profile(path=str(path), **read_columns(path, VEHICLE))


def read_columns(path: Path, header: tuple[str, ...]) -> dict[str, np.ndarray]:
    """The columns of a CSV with this header, t first and increasing; InputError naming line and column otherwise."""
    reads(path)
    names = ",".join(header)
    columns: list[list[float]] = [[] for _ in header]
    try:
        with open(path, **AS_TEXT) as file:
            read = rows(str(path), file)
            if [cell.strip() for cell in next(read, (1, []))[1]] != list(header):
                raise InputError(f"{path}: line 1: expected the header {names}")
            for line, cells in read:
                _take(path, line, cells, header, columns)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected a CSV file {names}") from None
    except ValueError as error:  # a NUL in the path
        raise InputError(f"{path}: cannot be read ({error}); expected a CSV file {names}") from None
    if not columns[0]:
        raise InputError(f"{path}: no rows; expected {names} over the flight")
    return {name: np.array(column) for name, column in zip(header, columns, strict=True)}


def _take(path: Path, line: int, cells: list[str], header: tuple[str, ...], columns: list[list[float]]) -> None:
    """One row to the columns; InputError naming line and column."""
    if len(cells) != len(header):
        raise InputError(f"{path}: line {line}: {len(cells)} cells, expected {len(header)} as in the header")
    for name, column, cell in zip(header, columns, cells, strict=True):
        value = number(cell)
        if value is None or not math.isfinite(value):
            raise InputError(f"{path}: line {line}, column {name}: {shown(cell.strip())} is no number; expected one "
                             "such as -0.0123")
        if name == "t" and column and value <= column[-1]:
            raise InputError(f"{path}: line {line}, column t: {value} is not after {column[-1]}; expected increasing "
                             "times")
        column.append(value)


# ---- writing


def write_nominal(nominal: Nominal, path: str | Path) -> None:
    """Write a nominal that reads back equal; shortest numbers that read back to the same bits."""
    write_text(path, (line + "\n" for line in nominal_lines(nominal, path)))


def nominal_lines(nominal: Nominal, path: str | Path) -> list[str]:
    """The lines of a nominal file at this path.

    A profile that came from a file and still equals it is named by its path from the new file's folder; any other
    is written beside the new file as NAME.SECTION.csv (vehicle, uncertainty, drift, wind).
    """
    path = Path(path)
    if nominal.terms and len(nominal.vehicle.t) > 1:
        raise UsageError(f"nominal {nominal.name!r} has a profile and terms; a nominal file holds one or the other")
    lines = [f"name = {_literal(nominal.name)}", *_vehicle_lines(nominal, path)]
    for section, header, part in (("uncertainty", VEHICLE, nominal.uncertainty), ("drift", DRIFT, nominal.drift)):
        if part is not None:
            lines += ["", f"[{section}]", *_profile_lines(part, path, section, header)]
    if nominal.wind is not None:
        lines += ["", "[wind]", *_number_lines(nominal.wind)]
        if nominal.wind.profile is not None:
            lines.append(_path_line(nominal.wind.profile, path, "wind", FORECAST))
    for section in ("offsets", "actuator", "controller", "guidance", "sensors", "simulation", "diagnosis",
                    "test_input"):
        plain = getattr(nominal, section)
        if plain is not None:
            lines += ["", f"[{section}]", *_number_lines(plain)]
        for each in plain.filters if isinstance(plain, Controller) else ():
            lines += ["", "[[controller.filters]]", f"b = {_literal(each.b)}", f"a = {_literal(each.a)}"]
    for of in nominal.effects:
        from .effects import values
        lines += ["", "[[effects]]", f"name = {_literal(of.name)}"]
        lines += [f"{key} = {_literal(value)}" for key, value in values(of).items()]
    return lines


def _number_lines(part: Any) -> Iterator[str]:
    """The keys of a section that are not their defaults: numbers, lists of them, words."""
    foreign = ONLY_ATTITUDE if isinstance(part, Controller) and part.is_rate_law else ()
    for key in fields(part):
        value = getattr(part, key.name)
        if key.name not in ("filters", "profile", *foreign) and not _is_default(key, value):
            yield f"{key.name} = {_literal(value)}"


def _is_default(key: "Field[Any]", value: object) -> bool:
    return value == key.default or (isinstance(value, float) and math.isnan(value))


def _literal(value: float | str | tuple[float, ...]) -> str:
    """A TOML value."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_literal, value)) + "]"
    return repr(float(value))


def _vehicle_lines(nominal: Nominal, path: Path) -> Iterator[str]:
    if not nominal.terms:
        yield from ("", "[vehicle]", *_profile_lines(nominal.vehicle, path, "vehicle", VEHICLE))
        return
    yield from ("", "[vehicle.terms]")
    rigid = (("theta", float(nominal.vehicle.a6[0])), ("beta", float(nominal.vehicle.k1[0])))
    for term, coefficient in (*rigid, *nominal.terms):
        yield f"{_literal(term)} = {_literal(coefficient)}"


def _profile_lines(profile: Profile | Drift, path: Path, section: str, header: tuple[str, ...]) -> list[str]:
    """Two numbers if it is constant, else the path of its CSV file."""
    if len(profile.t) == 1:
        return [f"{key} = {_literal(getattr(profile, key)[0])}" for key in header[1:]]
    return [_path_line(profile, path, section, header)]


def _path_line(profile: Profile | Drift | Forecast, path: Path, section: str, header: tuple[str, ...]) -> str:
    """The path of its CSV file, which is written unless it is there."""
    if profile.path and _same(profile, profile.path, header):
        return f"profile = {_literal(Path(os.path.relpath(profile.path, path.parent)).as_posix())}"
    beside = path.with_name(f"{path.stem}.{section}.csv")
    table = zip(*(getattr(profile, key).tolist() for key in header), strict=True)
    write_text(beside, [",".join(header) + "\n", *(",".join(map(repr, row)) + "\n" for row in table)])
    return f"profile = {_literal(beside.name)}"


def _same(profile: Profile | Drift | Forecast, path: str, header: tuple[str, ...]) -> bool:
    """The file at `path` still holds this profile."""
    try:
        columns = read_columns(Path(path), header)
    except InputError:
        return False
    return all(np.array_equal(getattr(profile, key), column) for key, column in columns.items())
