"""Effects that the contract's list does not have, and that no listed one equals.

Each has the places a diagnosis may name: one where physics leaves no choice, more where an unmodelled angular
acceleration could as well come from outside, or one sensor's fault as well from its neighbour.  Of these the gyro's
faults do not show without its column, and then nothing may be said of them.

Sizes at factor 1 are about what a diagnosis should see in a flight of 70 s at 100 Hz (twice its detection limit or
more); `make` draws signs, times and frequencies.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .build import Build
from .listed import Fit
from .spec import Hidden
from .vehicles import Vehicle

Draw = Callable[[float, float, np.random.Generator, Vehicle], dict[str, float]]  # (factor, sign, rng, vehicle)

OUTSIDE = frozenset({"plant", "environment"})


@dataclass(frozen=True)
class Unlisted:
    """An effect's physics, its sizes, and the places that are right for it.

    without  places when a column is dropped: (column, places)
    """

    fit: Fit
    draw: Draw
    places: frozenset[str]
    without: tuple[str, frozenset[str]] | None = None


# ---- physics


def servo_friction(b: Build, x: Hidden) -> None:
    """Coulomb friction that swallows `deg` of command: the servo sticks until the error is larger."""
    b.set(servo_rub=math.radians(x["deg"]) * b.vehicle.servo_frequency**2)


def servo_curve(b: Build, x: Hidden) -> None:
    """u + c u |u|: gain grows (or falls) with the deflection."""
    b.set(servo_odd=x["per_rad"])


def servo_asymmetry(b: Build, x: Hidden) -> None:
    """u + c u^2: stronger to one side."""
    b.set(servo_even=x["per_rad"])


def attitude_curve(b: Build, x: Hidden) -> None:
    """z + c z^3, seen by the controller too."""
    b.set(attitude_third=x["per_rad2"])


def attitude_knee(b: Build, x: Hidden) -> None:
    """The attitude sensor's scale differs on the two sides of an angle."""
    b.set(attitude_knee=x["percent"] / 100.0, knee_at=math.radians(x["at_deg"]))


def attitude_walk(b: Build, x: Hidden) -> None:
    """The attitude reference drifts steadily, `deg` over the flight."""
    b.attitude_bias += math.radians(x["deg"]) * b.t_sense / b.duration


def gyro_ceiling(b: Build, x: Hidden) -> None:
    """The gyro saturates."""
    b.set(gyro_ceiling=math.radians(x["deg_per_s"]))


def gyro_dead_zone(b: Build, x: Hidden) -> None:
    """Small rates read as none."""
    b.set(gyro_dead=math.radians(x["deg_per_s"]))


def gyro_flip(b: Build, x: Hidden) -> None:
    """The gyro's sign is wrong for a second or two."""
    flipped = (b.t_sense >= x["at_s"]) & (b.t_sense < x["at_s"] + x["length_s"])
    b.gyro_gain[flipped] *= -1.0


def gyro_warming(b: Build, x: Hidden) -> None:
    """The gyro's scale drifts with temperature, from none to `percent` over the flight."""
    b.gyro_gain *= 1.0 + x["percent"] / 100.0 * b.t_sense / b.duration


def pickup_drift(b: Build, x: Hidden) -> None:
    """The nozzle sensor's null drifts, from none to `deg` over the flight."""
    b.pickup_bias += math.radians(x["deg"]) * b.t_sense / b.duration


def roll_beat(b: Build, x: Hidden) -> None:
    """A moment that rolling turns into this plane: a tone whose amplitude and phase come and go."""
    beat = 2.0 * math.pi * b.t / x["beat_s"]
    swell, phase = 0.5 - 0.5 * np.cos(beat), 2.0 * math.pi * x["hz"] * b.t + np.sin(0.7 * beat)
    b.torque += math.radians(x["deg_per_s2"]) * swell * np.sin(phase)


def chirp(b: Build, x: Hidden) -> None:
    """A tone that climbs steadily over the flight."""
    climb = (x["to_hz"] - x["from_hz"]) / b.duration
    b.torque += math.radians(x["deg_per_s2"]) * np.sin(2.0 * math.pi * (x["from_hz"] + 0.5 * climb * b.t) * b.t)


def aero_flutter(b: Build, x: Hidden) -> None:
    """a6 swings about its mean (buffeting)."""
    b.a6 *= 1.0 + x["percent"] / 100.0 * np.sin(2.0 * math.pi * x["hz"] * b.t)


def thrust_flutter(b: Build, x: Hidden) -> None:
    """k1 swings about its mean (uneven burning)."""
    b.k1 *= 1.0 + x["percent"] / 100.0 * np.sin(2.0 * math.pi * x["hz"] * b.t)


def pilot_filter(b: Build, x: Hidden) -> None:
    """The controller's derivative filter has another time constant."""
    b.set(filter_time=b.vehicle.filter_time * (1.0 + x["percent"] / 100.0))


def pilot_integral(b: Build, x: Hidden) -> None:
    """The controller has an integral part that the nominal does not know."""
    b.set(ki=x["per_s"])


# ---- sizes


def _turn_time(rng: np.random.Generator, vehicle: Vehicle, length: float) -> float:
    """Start [s] of `length` seconds within a stretch in which the programme turns fast."""
    stretches = vehicle.turning()
    start, end = stretches[rng.integers(len(stretches))]
    return float(rng.uniform(start + 0.5, end - length - 0.5))


def _flip(f: float, _: float, rng: np.random.Generator, vehicle: Vehicle) -> dict[str, float]:
    length = float(np.clip(rng.uniform(1.0, 2.0) * f, 0.3, 4.0))
    return {"at_s": _turn_time(rng, vehicle, length), "length_s": length}


def _ceiling(f: float, _: float, __: np.random.Generator, vehicle: Vehicle) -> dict[str, float]:
    return {"deg_per_s": math.degrees(0.9 * vehicle.turn_rate) / f}


def _knee(f: float, s: float, _: np.random.Generator, vehicle: Vehicle) -> dict[str, float]:
    return {"percent": 3.0 * f * s, "at_deg": math.degrees(-0.4 * vehicle.turn_amplitude)}


def _third(f: float, s: float, _: np.random.Generator, vehicle: Vehicle) -> dict[str, float]:
    """3 % of the angle at the programme's largest."""
    return {"per_rad2": 0.03 * f * s / vehicle.turn_amplitude**2}


def _chirp(f: float, _: float, rng: np.random.Generator, __: Vehicle) -> dict[str, float]:
    return {"deg_per_s2": 0.25 * f, "from_hz": rng.uniform(0.1, 0.3), "to_hz": rng.uniform(0.8, 2.0)}


def _beat(f: float, _: float, rng: np.random.Generator, __: Vehicle) -> dict[str, float]:
    return {"deg_per_s2": 0.3 * f, "hz": rng.uniform(0.3, 1.0), "beat_s": rng.uniform(8.0, 20.0)}


def _flutter(f: float, _: float, rng: np.random.Generator, __: Vehicle) -> dict[str, float]:
    return {"percent": 2.0 * f, "hz": rng.uniform(0.15, 0.5)}


def _signed(key: str, size: float) -> Draw:
    """One value of this size, in either direction."""
    return lambda f, s, _, __: {key: size * f * s}


def _positive(key: str, size: float) -> Draw:
    return lambda f, _, __, ___: {key: size * f}


ACTUATOR, SENSOR, CONTROLLER = frozenset({"actuator"}), frozenset({"sensor"}), frozenset({"controller"})
NO_NOZZLE = ("beta", OUTSIDE | ACTUATOR)
NO_GYRO = ("theta_dot", OUTSIDE | SENSOR)

EFFECTS: dict[str, Unlisted] = {
    "servo_friction": Unlisted(servo_friction, _positive("deg", 0.06), ACTUATOR, NO_NOZZLE),
    "servo_curve": Unlisted(servo_curve, _signed("per_rad", 0.5), ACTUATOR, NO_NOZZLE),
    "servo_asymmetry": Unlisted(servo_asymmetry, _signed("per_rad", 0.5), ACTUATOR, NO_NOZZLE),
    "attitude_curve": Unlisted(attitude_curve, _third, SENSOR, NO_GYRO),
    "attitude_knee": Unlisted(attitude_knee, _knee, SENSOR, NO_GYRO),
    "attitude_walk": Unlisted(attitude_walk, _signed("deg", 0.2), OUTSIDE | SENSOR),
    "gyro_ceiling": Unlisted(gyro_ceiling, _ceiling, SENSOR),
    "gyro_dead_zone": Unlisted(gyro_dead_zone, _positive("deg_per_s", 0.03), SENSOR),
    "gyro_flip": Unlisted(gyro_flip, _flip, SENSOR | {"data"}),
    "gyro_warming": Unlisted(gyro_warming, _signed("percent", 8.0), SENSOR),
    "pickup_drift": Unlisted(pickup_drift, _signed("deg", 0.025), SENSOR | ACTUATOR),
    "roll_beat": Unlisted(roll_beat, _beat, OUTSIDE),
    "chirp": Unlisted(chirp, _chirp, OUTSIDE),
    "aero_flutter": Unlisted(aero_flutter, _flutter, OUTSIDE),
    "thrust_flutter": Unlisted(thrust_flutter, _flutter, OUTSIDE),
    "pilot_filter": Unlisted(pilot_filter, _signed("percent", 20.0), CONTROLLER),
    "pilot_integral": Unlisted(pilot_integral, _positive("per_s", 0.05), CONTROLLER),
}


def places(name: str, drop: tuple[str, ...]) -> frozenset[str]:
    """Places that are right for this effect in a log without the dropped columns."""
    effect = EFFECTS[name]
    if effect.without is not None and effect.without[0] in drop:
        return effect.without[1]
    return effect.places
