"""What the simulation believes: a TOML file <-> frozen dataclasses.

The schema by example is `sim/data/nominal/constant.toml`.  Unknown keys are
refused; every message names the file, the key, the value and what was expected.
SI units throughout (s, rad).
"""

import math
import tomllib
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from .errors import InputError

DATA = Path(__file__).parent / "data"
BUILT_IN = ("constant", "vega_like", "greensite_cr826")


@dataclass(frozen=True, eq=False)
class Profile:
    """a6 and k1 over flight time, linear between the nodes.  Arrays of equal length, t increasing."""

    t: np.ndarray    # s
    a6: np.ndarray   # 1/s^2
    k1: np.ndarray   # 1/s^2

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(a6, k1) at times t [s], held constant beyond the ends."""
        return np.interp(t, self.t, self.a6), np.interp(t, self.t, self.k1)


@dataclass(frozen=True)
class Actuator:
    """beta_ddot = w^2 (u - beta) - 2 zeta w beta_dot, u the delayed command plus noise."""

    natural_frequency: float          # w, rad/s
    damping_ratio: float              # zeta
    command_noise_std: float = 0.0    # rad, one draw per controller period
    deflection_limit: float = math.inf  # rad, on the controller's output
    delay: float = 0.0                # s


@dataclass(frozen=True)
class Controller:
    """command = kp e + kd d, d = (tau d + e - e_previous)/(tau + period), e = theta_measured - theta_ref."""

    kp: float
    kd: float                         # s
    derivative_time_constant: float   # s
    period: float                     # s


@dataclass(frozen=True)
class Guidance:
    """Attitude reference, linear between the nodes, held beyond the ends."""

    t: tuple[float, ...]              # s, increasing
    theta_ref: tuple[float, ...]      # rad


@dataclass(frozen=True)
class Sensors:
    """White noise, one draw per sample; quantisation 0 is none."""

    period: float                     # s
    theta_std: float                  # rad
    theta_dot_std: float              # rad/s
    beta_std: float                   # rad
    theta_step: float = 0.0           # rad
    theta_dot_step: float = 0.0       # rad/s
    beta_step: float = 0.0            # rad


@dataclass(frozen=True)
class Simulation:
    """How it is integrated."""

    duration: float                   # s
    step: float = 0.001               # s, Runge-Kutta 4
    acceleration_noise_std: float = 0.0  # rad/s^2, one draw per controller period


@dataclass(frozen=True)
class Diagnosis:
    """One-sigma relative error of a6 and k1 that is not worth calling wrong."""

    tolerance: float = 0.02


@dataclass(frozen=True, eq=False)
class Nominal:
    """One nominal file.  Sections a command does not need may be absent (None); `require` asks for them."""

    name: str
    vehicle: Profile
    sensors: Sensors
    uncertainty: Profile | None = None   # sigma of a6 and k1 over time
    actuator: Actuator | None = None
    controller: Controller | None = None
    guidance: Guidance | None = None
    simulation: Simulation | None = None
    diagnosis: Diagnosis = field(default_factory=Diagnosis)
    path: str = ""

    def require(self, *sections: str) -> None:
        """Raise InputError naming the first of these sections that the file lacks."""
        for section in sections:
            if getattr(self, section) is None:
                raise InputError(f"{self.path}: section [{section}] is missing; this command needs it")


def built_in(name: str) -> Path:
    """Path of a nominal that comes with the package."""
    return DATA / "nominal" / f"{name}.toml"


def locate(text: str) -> Path:
    """A nominal by path, or by the name of a built-in one when no such file exists."""
    path = Path(text)
    return built_in(text) if text in BUILT_IN and not path.exists() else path


def load_nominal(path: str | Path) -> Nominal:
    """Read and check a nominal file; InputError in one line if it cannot be used."""
    path = locate(str(path))
    try:
        text = path.read_bytes().decode("utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected a nominal TOML file "
                         f"or one of {', '.join(BUILT_IN)}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: byte {error.start} is not UTF-8; expected a nominal TOML file") from None
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: {error}") from None
    return Reader(path, table).nominal()


class Reader:
    """Turns the parsed table of one file into a Nominal, naming the place of whatever is wrong."""

    def __init__(self, path: Path, table: dict[str, Any]) -> None:
        self.path = path
        self.table = table

    def fail(self, place: str, value: object, expected: str) -> InputError:
        return InputError(f"{self.path}: {place} = {value!r}: expected {expected}")

    def nominal(self) -> Nominal:
        known = {"name", "vehicle", "uncertainty", "actuator", "controller", "guidance", "sensors", "simulation",
                 "diagnosis"}
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
        return Nominal(
            name=name, vehicle=self.vehicle(), sensors=sensors, uncertainty=self.uncertainty(), actuator=actuator,
            controller=controller, guidance=self.guidance(), simulation=simulation,
            diagnosis=diagnosis or Diagnosis(), path=str(self.path))

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
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
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

    def vehicle(self) -> Profile:
        table = self.keys("vehicle", {"a6", "k1", "profile"}, set())
        if "profile" in table:
            if len(table) > 1:
                raise InputError(f"{self.path}: [vehicle] has a profile and numbers; expected one or the other")
            return self.profile("vehicle.profile", table["profile"])
        self.keys("vehicle", {"a6", "k1"}, {"a6", "k1"})
        return constant_profile(self.number("vehicle.a6", table["a6"]), self.number("vehicle.k1", table["k1"]))

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
        columns = {}
        for key in ("t", "theta_ref"):
            if not isinstance(table[key], list) or not table[key]:
                raise self.fail(f"guidance.{key}", table[key], "a list of numbers")
            columns[key] = tuple(self.number(f"guidance.{key}[{i}]", x) for i, x in enumerate(table[key]))
        if len(columns["t"]) != len(columns["theta_ref"]):
            raise InputError(f"{self.path}: guidance.t has {len(columns['t'])} numbers and guidance.theta_ref "
                             f"{len(columns['theta_ref'])}; expected as many")
        if any(b <= a for a, b in zip(columns["t"], columns["t"][1:], strict=False)):
            raise self.fail("guidance.t", list(columns["t"]), "increasing times")
        return Guidance(**columns)


def constant_profile(a6: float, k1: float) -> Profile:
    """The same a6 and k1 at all times."""
    return Profile(np.zeros(1), np.array([a6]), np.array([k1]))


def read_profile(path: Path) -> Profile:
    """Read a CSV with the header t,a6,k1 and increasing times; InputError naming line and column otherwise."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
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
    return Profile(table[:, 0].copy(), table[:, 1].copy(), table[:, 2].copy())
