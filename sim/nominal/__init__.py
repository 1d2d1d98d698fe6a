"""The nominal, which is what the simulation assumes: a TOML file <-> the frozen dataclasses of `sections`.

The schema by example is `sim/data/nominal/constant.toml`.  Unknown keys are
refused; every message names the file, the key, the value and what was expected.
SI units throughout (s, rad).
"""

from pathlib import Path

from ..sections import (
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
    Required,
    Section,
    Sensors,
    Simulation,
    Wind,
)
from .profiles import constant_profile, read_profile
from .reader import parsed, text_of
from .rewriter import rewrite_nominal
from .writer import nominal_lines, write_nominal

__all__ = ["BUILT_IN", "Actuator", "Controller", "Diagnosis", "Drift", "Forecast", "Guidance", "Multisine", "Nominal",
           "Offsets", "Profile", "Required", "Section", "Sensors", "Simulation", "Wind", "built_in", "constant_profile",
           "load_nominal", "locate", "nominal_lines", "read_profile", "rewrite_nominal", "write_nominal"]

DATA = Path(__file__).parents[1] / "data"
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
    return parsed(path, text_of(path, f"a nominal TOML file or one of {', '.join(BUILT_IN)}"))
