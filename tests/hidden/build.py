"""The step from a Spec to the arrays and numbers that `motion.run` flies: first the clean vehicle, then each effect on
it.

Attitude programmes unlike the nominal's: steps, ramps and doublets in random order.
"""

import zlib
from typing import Any

import numpy as np

from .motion import Clock, Course, Knobs
from .spec import Spec
from .vehicles import vehicle
from .weather import blown

LARGEST = 0.14        # rad: never beyond, whatever the vehicle's own programme reaches
QUIET_START = 2.0     # s before anything moves
RISE = 0.5            # s that a step takes; a faster one would only drive the command into its limit
STEP = 0.2            # of the bound, largest step or doublet
RATE = 0.02           # rad/s, fastest ramp


def rough_programme(rng: np.random.Generator, duration: float, amplitude: float) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (t [s], angle [rad]) up to `duration`, within +-min(1.1 amplitude, LARGEST)."""
    bound = min(1.1 * amplitude, LARGEST)
    t, angle = [0.0, QUIET_START], [0.0, 0.0]

    def go(to: float, over: float) -> None:
        t.append(t[-1] + over)
        angle.append(float(np.clip(to, -bound, bound)))

    while t[-1] < duration:
        kind, here = rng.integers(3), angle[-1]
        jump = float(rng.uniform(0.3, 1.0) * STEP * bound) * (1.0 if rng.random() < 0.5 else -1.0)
        if kind == 0:
            go(here + jump, RISE)
        elif kind == 1:
            goal = float(rng.uniform(-bound, bound))
            go(goal, abs(goal - here) / (RATE * float(rng.uniform(0.3, 1.0))) + RISE)
        else:
            half = float(rng.uniform(0.5, 2.0))
            for to in (here + jump, here + jump, here - jump, here - jump, here):
                go(to, RISE if to != angle[-1] else half)
        go(angle[-1], float(rng.uniform(0.5, 5.0)))
    return np.array(t), np.array(angle)


SUBSTEP = 2.5e-4  # s: half of the shortest delay that a log shows (0.5 ms); divides controller and log periods
CREEP = 0.05      # an effect that creeps is this much smaller at the start of the flight and larger at its end
STAMP_DIGITS = 9  # decimals of a time stamp [s] in the log


def random(seed: int, stream: str) -> np.random.Generator:
    """Independent generator of a named stream."""
    return np.random.default_rng((zlib.crc32(stream.encode()), seed))


class Build:
    """One flight in the making.  Effects change the arrays (in place) and call `set`; `parts` closes it.

    Arrays on half sub-steps (t): a6, k1 [1/s^2], wind [rad], tilt [rad], torque [rad/s^2], drift_alpha, drift_beta
    [1/s].
    Arrays on controller ticks (t_tick): late [s], servo_gain, servo_null [rad].
    Arrays on sensing instants (t_sense): attitude_bias [rad], gyro_gain, gyro_bias [rad/s], pickup_bias [rad].
    """

    def __init__(self, spec: Spec) -> None:
        craft = vehicle(spec.nominal)
        duration = craft.duration if spec.duration is None else spec.duration
        if abs(1.0 / (spec.rate * SUBSTEP) % 1.0 - 0.5) < 0.5 - 1e-6:
            raise ValueError(f"rate {spec.rate!r} Hz: expected a whole number of sub-steps of {SUBSTEP} s a row")
        self.spec, self.vehicle, self.duration = spec, craft, duration
        self.steps = round(duration / SUBSTEP)
        self.control_every = round(craft.period / SUBSTEP)
        self.log_every = round(1.0 / (spec.rate * SUBSTEP))
        self.sense_every = int(np.gcd(self.control_every, self.log_every))
        self.t = np.arange(2 * self.steps + 1) * (0.5 * SUBSTEP)
        self.t_tick = np.arange(-(-self.steps // self.control_every)) * craft.period
        self.t_sense = np.arange(-(-self.steps // self.sense_every)) * (self.sense_every * SUBSTEP)
        a6, k1 = craft.parameters(self.t)
        self.a6, self.k1 = (1.0 + spec.dispersion[0]) * a6, (1.0 + spec.dispersion[1]) * k1
        self.wind = blown(spec.wind, (self.random("weather turbulence"), self.random("weather walk")), self.t)
        self.tilt, self.torque, self.drift_alpha, self.drift_beta = (np.zeros(len(self.t)) for _ in range(4))
        self.late, self.servo_null = np.zeros(len(self.t_tick)), np.zeros(len(self.t_tick))
        self.servo_gain = np.ones(len(self.t_tick))
        self.attitude_bias, self.gyro_bias, self.pickup_bias = (np.zeros(len(self.t_sense)) for _ in range(3))
        self.gyro_gain = np.ones(len(self.t_sense))
        self.attitude_late = self.gyro_late = 0.0  # s
        self.late_ticks = 0                        # controller periods
        self.knobs: dict[str, float] = {}

    def set(self, **knobs: float) -> None:
        """Turn knobs of `motion.Knobs`; ValueError if another effect has turned one of them."""
        for name, value in knobs.items():
            if name in self.knobs:
                raise ValueError(f"two effects on {name} in one flight: {self.spec!r}")
            self.knobs[name] = value

    def random(self, stream: str) -> np.random.Generator:
        return random(self.spec.seed, stream)

    def creep(self, t: np.ndarray) -> np.ndarray:
        """1 - CREEP at the start of the flight to 1 + CREEP at its end."""
        return 1.0 + CREEP * (2.0 * t / self.duration - 1.0)

    def programme(self, t: np.ndarray) -> np.ndarray:
        """Attitude reference [rad] at times t [s]."""
        if self.spec.reference == "nominal":
            return np.interp(t, self.vehicle.turn_t, self.vehicle.turn)
        if self.spec.reference == "rough":
            nodes, angles = rough_programme(random(self.spec.seed, "rough"), self.duration,
                                            self.vehicle.turn_amplitude)
            return np.interp(t, nodes, angles)
        raise ValueError(f"reference {self.spec.reference!r}: expected nominal or rough")

    def noise(self, stream: str, level: float, count: int) -> np.ndarray:
        """White noise of this standard deviation; the draws do not depend on the level."""
        return level * self.random(stream).standard_normal(count)

    def parts(self) -> tuple[Knobs, Clock, Course]:
        """Everything that `motion.run` takes."""
        craft, factor, senses, ticks = self.vehicle, self.spec.noise, len(self.t_sense), len(self.t_tick)
        own: dict[str, Any] = {
            "substep": SUBSTEP, "servo_frequency": craft.servo_frequency, "servo_damping": craft.servo_damping,
            "deflection_limit": craft.deflection_limit, "kp": craft.kp, "kd": craft.kd,
            "filter_time": craft.filter_time, "period": craft.period}
        if self.spec.first_order:
            own["servo_time"] = 2.0 * craft.servo_damping / craft.servo_frequency
        servo_late = np.round(self.late / SUBSTEP).astype(np.int64)
        sensor_late = (round(self.attitude_late / SUBSTEP), round(self.gyro_late / SUBSTEP))
        course = Course(
            a6=self.a6, k1=self.k1, push=self.a6 * self.wind + self.k1 * self.tilt + self.torque,
            drift_alpha=self.drift_alpha, drift_beta=self.drift_beta,
            sway=self.drift_alpha * self.wind + self.drift_beta * self.tilt,
            rattle=self.noise("push", factor.push * craft.push_noise, ticks), reference=self.programme(self.t_tick),
            command_noise=self.noise("command", factor.command * craft.command_noise, ticks),
            servo_late=servo_late, servo_gain=self.servo_gain, servo_null=self.servo_null,
            attitude_add=self.attitude_bias + self.noise("attitude", factor.attitude * craft.attitude_noise, senses),
            gyro_gain=self.gyro_gain,
            gyro_add=self.gyro_bias + self.noise("gyro", factor.gyro * craft.gyro_noise, senses),
            pickup_add=self.pickup_bias + self.noise("nozzle", factor.nozzle * craft.nozzle_noise, senses))
        clock = Clock(self.steps, self.control_every, self.sense_every, self.log_every, self.late_ticks, *sensor_late,
                      memory=max(int(servo_late.max()), *sensor_late) + 1)
        return Knobs(**(own | self.knobs)), clock, course
