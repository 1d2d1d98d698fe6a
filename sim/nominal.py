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
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .errors import InputError, UsageError
from .files import reads, write_text
from .sections import Actuator, Controller, Diagnosis, Guidance, Multisine, Nominal, Profile, Sensors, Simulation

if TYPE_CHECKING:
    from .effects import Effect

__all__ = ["BUILT_IN", "Actuator", "Controller", "Diagnosis", "Guidance", "Multisine", "Nominal", "Profile", "Sensors",
           "Simulation", "built_in", "constant_profile", "load_nominal", "locate", "read_profile", "write_nominal"]

DATA = Path(__file__).parent / "data"
BUILT_IN = ("constant", "vega_like", "greensite_cr826")  # launchers, which fly
STANDS = ("pendulum_linear",)   # plants of test stands, given by their terms: for `diagnose`


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
        text = path.read_bytes().decode("utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected a nominal TOML file "
                         f"or one of {', '.join(BUILT_IN)}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is not UTF-8; expected a nominal TOML file") from None
    try:
        table = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # TOMLDecodeError is a ValueError; so is an integer of 5000 digits
        raise InputError(one_line(f"{path}: {error}")) from None
    try:
        return Reader(path, table).nominal()
    except InputError as error:
        raise InputError(one_line(str(error))) from None


def one_line(text: str) -> str:
    """A message in one line, whatever keys and paths hold."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


LARGEST = 1e300  # a number beyond it is no physical quantity


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
                 "diagnosis", "test_input", "effects"}
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
        actuator = self.section("actuator", Actuator)
        controller = self.section("controller", Controller)
        sensors = self.section("sensors", Sensors)
        assert sensors is not None
        if simulation is not None:
            self.whole_steps(simulation, controller, sensors)
        vehicle, terms = self.vehicle()
        return Nominal(
            name=name, vehicle=vehicle, terms=terms, sensors=sensors, uncertainty=self.uncertainty(), actuator=actuator,
            controller=controller, guidance=self.guidance(), simulation=simulation,
            diagnosis=diagnosis or Diagnosis(), test_input=self.test_input(), effects=self.effects(),
            path=str(self.path))

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
        """A section whose keys are the fields of a dataclass of numbers."""
        if section not in self.table:
            return None
        names = {f.name for f in fields(kind)}
        required = {f.name for f in fields(kind) if not isinstance(f.default, float)}
        table = self.keys(section, names, required)
        positive = {"natural_frequency", "deflection_limit", "period", "step", "duration"}
        free = {"kp", "kd"}
        values = {}
        for key, value in table.items():
            place = f"{section}.{key}"
            if key in positive:
                values[key] = self.number(place, value, above=0.0)
            elif key in free:
                values[key] = self.number(place, value)
            else:
                values[key] = self.number(place, value, least=0.0)
        return kind(**values)

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
        if not isinstance(value, str):
            raise self.fail(place, value, "the path of a CSV file t,a6,k1")
        return read_profile(self.path.parent / value)

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

    def guidance(self) -> Guidance | None:
        if "guidance" not in self.table:
            return None
        table = self.keys("guidance", {"t", "theta_ref"}, {"t", "theta_ref"})
        columns = {key: self.numbers(f"guidance.{key}", table[key]) for key in ("t", "theta_ref")}
        self.same_length("guidance", columns)
        if any(b <= a for a, b in zip(columns["t"], columns["t"][1:], strict=False)):
            raise self.fail("guidance.t", list(columns["t"]), "increasing times")
        return Guidance(**columns)

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


def read_profile(path: Path) -> Profile:
    """Read a CSV with the header t,a6,k1 and increasing times; InputError naming line and column otherwise."""
    reads(path)
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, ValueError) as error:  # a NUL in the path, and bytes that are not UTF-8, are ValueErrors
        raise InputError(f"{path}: profile cannot be read ({error})") from None
    if not lines or [c.strip() for c in lines[0].split(",")] != ["t", "a6", "k1"]:
        raise InputError(f"{path}: line 1: expected the header t,a6,k1")
    rows = []
    for number, line in enumerate(lines[1:], start=2):
        if not line.strip():
            continue
        cells = line.split(",")
        if len(cells) != 3:
            raise InputError(f"{path}: line {number}: {len(cells)} columns, expected 3")
        for column, cell in zip(("t", "a6", "k1"), cells, strict=True):
            try:
                if not math.isfinite(float(cell)):
                    raise ValueError
            except ValueError:
                raise InputError(f"{path}: line {number}, column {column}: {cell.strip()[:40]!r} "
                                 "is no number") from None
        rows.append([float(cell) for cell in cells])
        if len(rows) > 1 and rows[-1][0] <= rows[-2][0]:
            raise InputError(f"{path}: line {number}, column t: {rows[-1][0]} is not after {rows[-2][0]}")
    if not rows:
        raise InputError(f"{path}: no rows; expected t,a6,k1 over the flight")
    table = np.array(rows)
    return Profile(table[:, 0].copy(), table[:, 1].copy(), table[:, 2].copy(), str(path))


# ---- writing


def write_nominal(nominal: Nominal, path: str | Path) -> None:
    """Write a nominal that reads back equal; shortest numbers that read back to the same bits.

    A profile that came from a file and still equals it is named by its path from the new file's folder; any other
    is written beside the new file as NAME.vehicle.csv or NAME.uncertainty.csv.
    """
    path = Path(path)
    if nominal.terms and len(nominal.vehicle.t) > 1:
        raise UsageError(f"nominal {nominal.name!r} has a profile and terms; a nominal file holds one or the other")
    lines = [f"name = {_literal(nominal.name)}", *_vehicle_lines(nominal, path)]
    if nominal.uncertainty is not None:
        lines += ["", "[uncertainty]", *_profile_lines(nominal.uncertainty, path, "uncertainty")]
    for section in ("actuator", "controller", "guidance", "sensors", "simulation", "diagnosis", "test_input"):
        part = getattr(nominal, section)
        if part is not None:
            lines += ["", f"[{section}]"]
            lines += [f"{f.name} = {_literal(getattr(part, f.name))}" for f in fields(part)
                      if getattr(part, f.name) != f.default]
    for of in nominal.effects:
        from .effects import values
        lines += ["", "[[effects]]", f"name = {_literal(of.name)}"]
        lines += [f"{key} = {_literal(value)}" for key, value in values(of).items()]
    write_text(path, (line + "\n" for line in lines))


def _literal(value: float | str | tuple[float, ...]) -> str:
    """A TOML value."""
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, tuple):
        return "[" + ", ".join(map(_literal, value)) + "]"
    return repr(float(value))


def _vehicle_lines(nominal: Nominal, path: Path) -> Iterator[str]:
    if not nominal.terms:
        yield from ("", "[vehicle]", *_profile_lines(nominal.vehicle, path, "vehicle"))
        return
    yield from ("", "[vehicle.terms]")
    rigid = (("theta", float(nominal.vehicle.a6[0])), ("beta", float(nominal.vehicle.k1[0])))
    for term, coefficient in (*rigid, *nominal.terms):
        yield f"{_literal(term)} = {_literal(coefficient)}"


def _profile_lines(profile: Profile, path: Path, section: str) -> list[str]:
    """Two numbers if it is constant, else the path of its CSV file, which is written unless it is there."""
    if len(profile.t) == 1:
        return [f"a6 = {_literal(profile.a6[0])}", f"k1 = {_literal(profile.k1[0])}"]
    if profile.path and _same(profile, profile.path):
        return [f"profile = {_literal(Path(os.path.relpath(profile.path, path.parent)).as_posix())}"]
    beside = path.with_name(f"{path.stem}.{section}.csv")
    rows = zip(profile.t.tolist(), profile.a6.tolist(), profile.k1.tolist(), strict=True)
    write_text(beside, ["t,a6,k1\n", *(",".join(map(repr, row)) + "\n" for row in rows)])
    return [f"profile = {_literal(beside.name)}"]


def _same(profile: Profile, path: str) -> bool:
    """The file at `path` still holds this profile."""
    try:
        other = read_profile(Path(path))
    except InputError:
        return False
    return all(np.array_equal(getattr(profile, key), getattr(other, key)) for key in ("t", "a6", "k1"))
