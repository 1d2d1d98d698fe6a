"""The contract's causes: their sizes, their names here, and the way back from the generator's units to the contract's.

The size at factor 1 is about twice the detection limit of the prototype's table for a 70 s log at 100 Hz, with
unmodelled accelerations of 0.05 deg/s^2 (a third of the table's 0.15 where these set its limit).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from .build import SUBSTEP
from .spec import OTHER, PLAIN, Hidden
from .unlisted import EFFECTS
from .vehicles import Vehicle, vehicle

Parameters = dict[str, float]
Maker = Callable[..., Hidden]

DEGREE = math.degrees(1.0)
HERTZ = 1.0 / (2.0 * math.pi)


@dataclass(frozen=True)
class Value:
    """One parameter of a cause: own = (contract - neutral) * times, neutral that of the contract's table."""

    contract: str
    own: str
    times: float
    neutral: float = 0.0


@dataclass(frozen=True)
class Listed:
    """A cause of the contract.  size(factor, sign, vehicle): parameters at that factor; draw: what is drawn besides.

    one_sided  the size has no direction
    """

    name: str
    place: str
    values: tuple[Value, ...]
    size: Callable[[float, float, Vehicle], Parameters]
    draw: Callable[[np.random.Generator, Vehicle], Parameters] | None = None
    one_sided: bool = False


def _linear(parameter: str, at_one: float, neutral: float = 0.0) -> Callable[[float, float, Vehicle], Parameters]:
    """neutral + at_one factor sign."""
    return lambda f, s, _: {parameter: neutral + at_one * f * s}


def _late(at_one: float) -> Callable[[float, float, Vehicle], Parameters]:
    """A delay [s], on the ring buffer's grid, at least one step of it."""
    return lambda f, _, __: {"delay": max(round(at_one * f / SUBSTEP), 1) * SUBSTEP}


def _scale(at_one: float) -> Callable[[float, float, Vehicle], Parameters]:
    """A scale, its deviation at most 0.9."""
    return lambda f, s, _: {"scale": 1.0 + min(at_one * f, 0.9) * s}


def _loss(f: float, s: float, v: Vehicle) -> Parameters:
    return {"fraction": min(0.03 * f, 0.9) * s, "time": 0.5 * min(v.duration, 100.0)}


def _gust(f: float, s: float, v: Vehicle) -> Parameters:
    return {"angle": 2.0e-3 * f * s, "time": float(np.mean(v.windy())) - 2.0, "duration": 4.0}


def _tank(f: float, s: float, _: Vehicle) -> Parameters:
    return {"coupling": min(0.03 * f, 0.8) * s, "frequency": 4.0, "damping_ratio": 0.02}


def _flex(f: float, s: float, _: Vehicle) -> Parameters:
    return {"gain": 1.0e-3 * f * s, "frequency": 25.0, "damping_ratio": 0.03}


def _hum(f: float, _: float, __: Vehicle) -> Parameters:
    return {"amplitude": 1.2e-3 * f, "frequency": 4.0, "phase": 0.0}


def _valve(f: float, _: float, v: Vehicle) -> Parameters:
    """The noise of the command alone moves the nozzle at some 0.07 rad/s rms (constant), 0.08 (launchers)."""
    return {"rate": VALVE_RATE[v.name] / f}


def _engine(f: float, s: float, v: Vehicle) -> Parameters:
    return {"acceleration": 2.5e-3 * f * s, "time": 0.5 * min(v.duration, 100.0)}


def _trend(f: float, s: float, v: Vehicle) -> Parameters:
    """k1 keeps a tenth at least, also in the other form, three times as steep at the flight's end."""
    return {"slope": min(2.0e-3 * f, 1.2 / v.duration) * s}


def _sideways(f: float, s: float, _: Vehicle) -> Parameters:
    """A twentieth of a launcher's at 40 s (NASA CR-826: 0.046 and 0.028 1/s)."""
    return {"z_alpha": 2.0e-3 * f * s, "z_beta": 1.2e-3 * f * s}


def _bumpy(f: float, _: float, __: Vehicle) -> Parameters:
    return {"level": 1.75e-3 * f, "time_constant": 1.0}


def _fading(f: float, _: float, __: Vehicle) -> Parameters:
    """No loop keeps an unstable vehicle upright for long with a nozzle that gives way."""
    return {"time_constant": 200.0 / f}


def _autopilot(f: float, s: float, _: Vehicle) -> Parameters:
    return {"kp_scale": 1.0 + 0.05 * f * s, "kd_scale": 1.0, "delay": 0.0}


def _draw_loss(rng: np.random.Generator, v: Vehicle) -> Parameters:
    return {"time": round(float(rng.uniform(0.3, 0.7)) * min(v.duration, 100.0), 2)}


def _draw_gust(rng: np.random.Generator, v: Vehicle) -> Parameters:
    first, last = v.windy()
    length = round(float(rng.uniform(2.0, 6.0)), 2)
    return {"time": round(float(rng.uniform(max(first, 5.0), min(last, v.duration - 5.0) - length)), 2),
            "duration": length}


def _draw_tank(rng: np.random.Generator, _: Vehicle) -> Parameters:
    return {"frequency": float(rng.uniform(2.5, 6.0)), "damping_ratio": float(rng.uniform(0.015, 0.04))}


def _draw_flex(rng: np.random.Generator, _: Vehicle) -> Parameters:
    return {"frequency": float(rng.uniform(18.0, 60.0)), "damping_ratio": float(rng.uniform(0.02, 0.05))}


def _draw_hum(rng: np.random.Generator, _: Vehicle) -> Parameters:
    return {"frequency": float(rng.uniform(1.0, 12.0)), "phase": float(rng.uniform(-3.0, 3.0))}


def _draw_bumpy(rng: np.random.Generator, _: Vehicle) -> Parameters:
    return {"time_constant": float(rng.uniform(0.7, 1.5))}


VALVE_RATE = {"constant": 0.13, "vega_like": 0.17, "greensite_cr826": 0.17}  # rad/s at factor 1, see `_valve`
ANGLE = (Value("angle", "deg", DEGREE),)
PERCENT = (Value("scale", "percent", 100.0, 1.0),)
DELAY = (Value("delay", "ms", 1e3),)

_ALL = (
    Listed("thrust_percent", "plant", PERCENT, _scale(0.14)),
    Listed("thrust_drop", "plant", (Value("fraction", "percent", 100.0), Value("time", "at_s", 1.0)), _loss,
           _draw_loss),
    Listed("aero_percent", "plant", PERCENT, _scale(0.15)),
    Listed("rate_drag", "plant", (Value("coefficient", "per_s", 1.0),), _linear("coefficient", 0.08)),
    Listed("aero_curve", "plant", (Value("coefficient", "per_rad2", 1.0),), _linear("coefficient", 3.0)),
    Listed("bearing_rub", "plant", (Value("coefficient", "deg_per_s2", DEGREE),), _linear("coefficient", 8.0e-4),
           one_sided=True),
    Listed("thrust_tilt", "plant", ANGLE, _linear("angle", 3.0e-4)),
    Listed("tank", "plant", (Value("coupling", "pull", 1.0), Value("frequency", "hz", HERTZ),
                             Value("damping_ratio", "damping", 1.0)), _tank, _draw_tank),
    Listed("flex", "plant", (Value("gain", "gain", 1.0), Value("frequency", "hz", HERTZ),
                             Value("damping_ratio", "damping", 1.0)), _flex, _draw_flex),
    Listed("gust_pulse", "environment", (Value("angle", "deg", DEGREE), Value("time", "at_s", 1.0),
                                         Value("duration", "length_s", 1.0)), _gust, _draw_gust),
    Listed("wind", "environment", ANGLE, _linear("angle", 2.5e-3)),
    Listed("hum", "environment", (Value("amplitude", "deg_per_s2", DEGREE), Value("frequency", "hz", HERTZ),
                                  Value("phase", "phase_deg", DEGREE)), _hum, _draw_hum, one_sided=True),
    Listed("late_servo", "actuator", DELAY, _late(1.0e-3), one_sided=True),
    Listed("lazy_servo", "actuator", PERCENT, _scale(0.06)),
    Listed("servo_gain", "actuator", PERCENT, _scale(0.008)),
    Listed("valve_limit", "actuator", (Value("rate", "deg_per_s", DEGREE),), _valve, one_sided=True),
    Listed("servo_play", "actuator", (Value("half_width", "deg", DEGREE),), _linear("half_width", 4.0e-4),
           one_sided=True),
    Listed("servo_null", "actuator", ANGLE, _linear("angle", 1.5e-4)),
    Listed("tilted_platform", "sensor", ANGLE, _linear("angle", 2.5e-3)),
    Listed("late_platform", "sensor", DELAY, _late(0.025), one_sided=True),
    Listed("gyro_offset", "sensor", (Value("rate", "deg_per_s", DEGREE),), _linear("rate", 1.0e-4)),
    Listed("gyro_percent", "sensor", PERCENT, _scale(0.015)),
    Listed("late_gyro", "sensor", DELAY, _late(8.0e-3), one_sided=True),
    Listed("pickup_offset", "sensor", ANGLE, _linear("angle", 1.5e-4)),
    Listed("other_autopilot", "controller", (Value("kp_scale", "kp_percent", 100.0, 1.0),
                                             Value("kd_scale", "kd_percent", 100.0, 1.0),
                                             Value("delay", "late_ticks", 100.0)), _autopilot),
    Listed("engine_out", "plant", (Value("acceleration", "deg_per_s2", DEGREE), Value("time", "at_s", 1.0)), _engine,
           _draw_loss),
    Listed("heavy_nozzle", "plant", (Value("coefficient", "kick", 1.0),), _linear("coefficient", 1.0e-3)),
    Listed("thrust_trend", "plant", (Value("slope", "percent_per_s", 100.0),), _trend),
    Listed("sideways", "plant", (Value("z_alpha", "alpha_per_s", 1.0), Value("z_beta", "nozzle_per_s", 1.0)),
           _sideways),
    Listed("bumpy_air", "environment", (Value("level", "deg", DEGREE), Value("time_constant", "time_s", 1.0)), _bumpy,
           _draw_bumpy, one_sided=True),
    Listed("shifting_wind", "environment", (Value("level", "deg_per_root_s", DEGREE),), _linear("level", 1.0e-3),
           one_sided=True),
    Listed("washed_out", "actuator", (Value("time_constant", "slow_s", 1.0),), _fading, one_sided=True),
)
_CAUSES = ("control_effectiveness", "control_loss", "aero_instability", "aero_damping", "aero_cubic", "friction",
           "thrust_misalignment", "slosh", "bending", "gust", "steady_wind", "periodic_disturbance", "actuator_delay",
           "actuator_bandwidth", "actuator_gain", "actuator_rate_limit", "actuator_backlash", "actuator_bias",
           "attitude_bias", "attitude_delay", "gyro_bias", "gyro_scale", "gyro_delay", "nozzle_sensor_bias",
           "controller_mismatch", "moment_step", "nozzle_inertia", "control_slope", "lateral_drift", "turbulence",
           "wind_walk", "input_washout")
CHANCE = frozenset({"turbulence", "wind_walk"})  # levels of noise: no two draws are alike
CAUSES: dict[str, Listed] = dict(zip(_CAUSES, _ALL, strict=True))
_CAUSE_OF = {listed.name: cause for cause, listed in CAUSES.items()}


def size_at(cause: str, factor: float, sign: float = 1.0, nominal: str = "constant") -> Parameters:
    """Contract parameters of a listed cause at a size factor; 1: clearly visible.  Times and frequencies typical."""
    listed = CAUSES[cause]
    return listed.size(factor, 1.0 if listed.one_sided else sign, vehicle(nominal))


def hide(cause: str, parameters: Parameters, variant: str = PLAIN) -> Hidden:
    """The generator's effect for a cause with contract parameters (all of them given).

    ValueError for a delay that the ring buffer cannot hold: a whole number of sub-steps, the controller's of periods.
    """
    listed = CAUSES[cause]
    if "delay" in parameters:
        grid = vehicle("constant").period if cause == "controller_mismatch" else SUBSTEP
        if abs(parameters["delay"] / grid - round(parameters["delay"] / grid)) > 1e-6:
            raise ValueError(f"{cause}: delay {parameters['delay']!r} s: expected a whole number of {grid} s")
    return Hidden(listed.name, tuple((v.own, (parameters[v.contract] - v.neutral) * v.times) for v in listed.values),
                  variant)


def told(hidden: Hidden) -> dict[str, Any] | None:
    """{"cause", "parameters"} in the contract's words and units, or None if the contract has no such cause."""
    if hidden.name not in _CAUSE_OF:
        return None
    cause = _CAUSE_OF[hidden.name]
    return {"cause": cause,
            "parameters": {v.contract: hidden[v.own] / v.times + v.neutral for v in CAUSES[cause].values}}


def _maker(cause: str) -> Maker:
    def make(factor: float, rng: np.random.Generator, nominal: str = "constant", variant: str = PLAIN,
             sign: float | None = None) -> Hidden:
        """The cause at this size; sign None: drawn, with times and frequencies."""
        listed, craft = CAUSES[cause], vehicle(nominal)
        sign = float(rng.choice((-1.0, 1.0))) if sign is None else sign
        if cause == "actuator_bandwidth" and variant == OTHER:
            sign = -1.0  # a lag only slows
        parameters = size_at(cause, factor, sign, nominal)
        if listed.draw is not None:
            parameters |= listed.draw(rng, craft)
        if cause == "controller_mismatch":
            parameters |= _gains(parameters["kp_scale"], factor, rng)
        return hide(cause, parameters, variant)
    return make


def _gains(scale: float, factor: float, rng: np.random.Generator) -> Parameters:
    """The part of the controller that is off: one gain, both, or whole periods of computing time."""
    kind = rng.integers(4)
    return {"kp_scale": scale if kind in (0, 2) else 1.0, "kd_scale": scale if kind in (1, 2) else 1.0,
            "delay": 0.01 * max(round(factor), 1) if kind == 3 else 0.0}


def _unlisted_maker(name: str) -> Maker:
    def make(factor: float, rng: np.random.Generator, nominal: str = "constant", variant: str = PLAIN,
             sign: float | None = None) -> Hidden:
        """The effect at this size; it has one form only."""
        sign = float(rng.choice((-1.0, 1.0))) if sign is None else sign
        values = EFFECTS[name].draw(factor, sign, rng, vehicle(nominal))
        return Hidden(name, tuple((key, float(value)) for key, value in values.items()))
    return make


LISTED: dict[str, Maker] = {cause: _maker(cause) for cause in CAUSES}       # by the contract's names
UNLISTED: dict[str, Maker] = {name: _unlisted_maker(name) for name in EFFECTS}  # by the generator's own
