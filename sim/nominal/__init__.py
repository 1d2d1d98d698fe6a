"""The nominal, which is what the simulation assumes: a TOML file <-> the frozen dataclasses of `sections`.

The schema by example is `sim/data/nominal/constant.toml`.  Unknown keys are
refused; every message names the file, the key, the value and what was expected.
SI units throughout (s, rad).
"""

from pathlib import Path

from ..errors import did_you_mean
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
from .profiles import constant_profile
from .reader import parsed, text_of
from .rewriter import rewrite_nominal
from .writer import nominal_lines, write_nominal

__all__ = ["BUILT_IN", "NAMES", "Actuator", "Controller", "Diagnosis", "Drift", "Forecast", "Guidance", "Multisine",
           "Nominal",
           "Offsets", "Profile", "Required", "Section", "Sensors", "Simulation", "Wind", "built_in", "constant_profile",
           "load_nominal", "locate", "nominal_lines", "rewrite_nominal", "write_nominal",
           "wrong_feedback"]

DATA = Path(__file__).parents[1] / "data"
BUILT_IN = ("constant", "vega_like", "greensite_cr826")  # rigid launchers, which fly
FLEXIBLE = ("cr826_max_q",)  # with slosh and bending
STAND_NOMINALS = ("pendulum_linear", "servo_xl330", "single_pendulum_linear", "balancing_robot", "tailsitter_roll",
                  "hobby_rocket_tvc", "aeropendulum", "sounding_rocket_roll")  # what others measured: for `diagnose`
NAMES = BUILT_IN + FLEXIBLE + STAND_NOMINALS


def built_in(name: str) -> Path:
    """Return the path of a nominal file that comes with the package."""
    return DATA / "nominal" / f"{name}.toml"


def locate(text: str) -> Path:
    """Return the path of a nominal given as path, or as name of one in the package if no such file exists."""
    path = Path(text)
    return built_in(text) if text in NAMES and not path.exists() else path


def wrong_feedback(nominal: Nominal) -> str:
    """Return a warning of a controller that pushes the vehicle away from its reference; '' if it does not."""
    controller, k1 = nominal.controller, nominal.vehicle.k1
    if controller is None or not (k1 * controller.kp > 0.0).all():
        return ""
    return (f"{nominal.path}: k1 and kp have the same sign: the controller turns the vehicle away from its reference; "
            "expected k1 < 0 with kp > 0, as theta_ddot = a6*theta + k1*beta and beta = kp*(theta - theta_ref)")


def load_nominal(path: str | Path) -> Nominal:
    """Read and check a nominal file; InputError in one line if it cannot be used."""
    path = locate(str(path))
    wanted = did_you_mean(path.name, NAMES, f"expected a nominal TOML file or one of {', '.join(NAMES)}")
    return parsed(path, text_of(path, wanted))
