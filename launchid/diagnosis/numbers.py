"""The usual numbers that every model of a log has free: nominal value, tolerance, prior and range of each."""

import math

import numpy as np

from sim.sections import Offsets

from ..likelihood.estimate import Number
from .known import CURVES, KnownLog

TOLERANCE_SIGMAS = 2.5  # of a declared tolerance, within which a number is nobody's fault
SWING = 0.3            # rad rms, from which a body that bends from the line is a pendulum
LARGEST_SHIFT = 2.0    # of a6, k1 and scales over their nominal value: one sigma of what is believed before a log
TIMES = 0.1            # s, one sigma of a delay or lag that nobody declared
LARGEST_DELAY = 1.0    # s, the largest
SHORT_LAG = 0.005      # s, of a servo that is as good as none
KINEMATIC = ("gyro_bias", "gyro_scale", "gyro_delay")   # say something of the columns alone, and turn no vehicle
FORM = ("lag", "bandwidth")   # of a lateness that no nozzle shows: its form, not its size
LIBRARY = ("1", "theta_dot", *CURVES)   # terms of a nominal that are numbers of every model


def usual(log: KnownLog) -> list[Number]:  # noqa: PLR0912, PLR0915 - a table with its conditions
    """Return the numbers that every model of this log has, with nominal value, tolerance, prior and range."""
    s, d = log.scales, log.nominal.diagnosis
    a6, k1 = log.a6, log.k1
    is_linear = bool(np.any(k1 != 0.0)) or "beta" in log.terms
    has_input = is_linear or any("beta" in term for term in log.terms)
    row = log.period
    acc, tol = s.acceleration, TOLERANCE_SIGMAS * d.tolerance
    offsets = log.nominal.offsets or Offsets()
    span, air = log.span, log.known
    calm = math.hypot(offsets.attitude_bias, air.initial, air.walk * math.sqrt(span / 3.0),
                      air.turbulence * math.sqrt(2.0 * air.turbulence_time / span))   # mean of declared weather
    out: list[Number] = []

    def add(name: str, null: float, tol: float, prior: float, cause: str, parameter: str, low: float = -math.inf,
            high: float = math.inf, step: float | None = None) -> None:
        own = log.given.get(name, null)
        if name.endswith("delay"):
            low, high = low + own - null, high + own - null
        out.append(Number(name, own, tol, prior, 1e-3 * prior if step is None else step, low, high, cause, parameter))

    if np.any(a6 != 0.0):
        add("a6", 1.0, tol, LARGEST_SHIFT, "aero_instability", "scale")
    elif "sin(theta)" not in log.terms and log.has["theta"]:
        add("term theta", 0.0, 0.01 * acc / s.theta, acc / s.theta, "missing_term", "theta")
    for name, value in log.terms.items():
        if name in LIBRARY:
            prior = abs(value) * LARGEST_SHIFT + (2.0 * acc if name == "1" else 0.0)
            add("term " + name, value, tol * abs(value), prior, "missing_term", name)
    if is_linear:
        add("k1", 1.0, tol, LARGEST_SHIFT, "control_effectiveness", "scale")
        wears = 0.0 if log.is_flown else 2.0 * tol / span    # within the tolerance of k1 from end to end of the log
        add("k1_slope", 0.0, wears, 2.0 / span, "control_slope", "slope")
    if "theta_dot" not in log.terms:
        add("damping", 0.0, 0.0, acc / s.omega, "aero_damping", "coefficient")
    if "sign(theta_dot)" not in log.terms:
        add("friction", 0.0, 0.0, acc, "friction", "coefficient", low=0.0)
    if "1" not in log.terms:
        if has_input and np.any(k1 != 0.0):
            size = float(np.sqrt(np.mean(k1**2)))
            unknown = math.hypot(offsets.thrust_misalignment, offsets.moment / size,
                                 calm * float(np.sqrt(np.mean(a6**2))) / size)
            add("misalignment", 0.0, TOLERANCE_SIGMAS * unknown, acc / size, "thrust_misalignment", "angle")
        else:
            add("moment", 0.0, TOLERANCE_SIGMAS * offsets.moment, acc, "missing_term", "1")
        if log.is_flown and has_input and float(np.ptp(a6 / np.where(k1 == 0.0, 1.0, k1))) > 0.02 * float(
                np.max(np.abs(a6 / np.where(k1 == 0.0, 1.0, k1)))):
            add("wind", 0.0, TOLERANCE_SIGMAS * calm, acc / float(np.sqrt(np.mean(a6**2))), "steady_wind",
                "angle")
    if log.has["theta"] and "sin(theta)" not in log.terms and np.any(a6 != 0.0):
        if s.theta > SWING and not log.is_flown:
            add("sine", 0.0, 0.0, float(np.max(np.abs(a6))), "missing_term", "sin(theta)")
        else:
            add("cubic", 0.0, 0.0, acc / s.theta**3 / max(float(np.mean(np.abs(a6))), 1e-9), "aero_cubic",
                "coefficient")
    if has_input and "beta^2" not in log.terms:
        add("term beta^2", 0.0, 0.0, acc / s.beta**2, "missing_term", "beta^2")
    if has_input and (log.is_smooth if not log.is_commanded else log.is_flown or log.has_beta):
        add("inertia", 0.0, 0.0, acc * 0.05**2 / s.beta, "nozzle_inertia", "coefficient")
    if has_input:
        timing = d.timing + (0.6 * row if log.is_blind or not log.is_commanded else 0.0)   # a row does not say when
        least = -2.0 * timing - (log.servo.delay + log.servo.lag if log.is_blind and log.is_commanded else 0.0)
        add("delay", 0.0, timing, TIMES, "actuator_delay", "delay", least, LARGEST_DELAY, 1e-4 + 0.01 * row)
        add("washout", 0.0, 0.002, 2.0, "input_washout", "time_constant", 0.0, 50.0, 1e-3)
    if has_input and log.is_commanded and not (log.is_blind and log.servo.lag < max(SHORT_LAG, 0.5 * row)):
        band = min(2.0 * d.timing / max(log.servo.lag, 1e-4), 0.5)
        add("bandwidth", 1.0, band, 1.0, "actuator_bandwidth", "scale", 0.02, 20.0)
    if has_input and log.is_commanded and log.has["beta"]:
        add("gain", 1.0, 0.0, LARGEST_SHIFT, "actuator_gain", "scale")
        add("null_angle", 0.0, d.command, s.beta, "actuator_bias", "angle")
        add("nozzle_bias", 0.0, math.hypot(d.command, TOLERANCE_SIGMAS * offsets.nozzle_sensor_bias), s.beta,
            "nozzle_sensor_bias", "angle")
    if has_input and not log.is_flown:
        add("lag", 0.0, d.timing, TIMES, "actuator_bandwidth", "lag", 0.0, LARGEST_DELAY, 1e-4 + 0.02 * row)
    if log.has_both:
        add("gyro_bias", 0.0, TOLERANCE_SIGMAS * offsets.gyro_bias, s.omega, "gyro_bias", "rate")
        add("gyro_scale", 1.0, 0.0, 0.5, "gyro_scale", "scale", 0.05, 6.0)
        add("gyro_delay", 0.0, d.timing, 0.05, "gyro_delay", "delay", -2.0 * d.timing if log.is_flown else -0.2, 0.4,
            2e-5 + 0.01 * row)
        if log.is_flown:
            add("attitude_delay", 0.0, d.timing, 0.05, "attitude_delay", "delay", -2.0 * d.timing, 0.4,
                1e-4 + 0.01 * row)
    return out
