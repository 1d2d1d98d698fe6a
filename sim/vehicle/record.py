"""The record of a flight: what the compiled step reads and writes.

One record holds the constants, what effects change as numbers, and the state; tables hold what has a value at every
controller period, step or half step.  What remembers, or may be many, is a table each, which a plain flight does not
have: it compiles, and runs, a step without them.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ..effects import Changes
from ..effects.actuator import LAG, slowed
from ..effects.table import INPUT_EFFECT, MODE, TERM, TIMED, record
from .actuator import FREE_MOTION, POLE_STEP, fastest_pole

NUMBER_EFFECTS = tuple(each.name for each in dataclasses.fields(Changes) if each.type is float)  # of effects
FLIGHT = record(  # SI units
    "step", "lost_angle",
    "frequency", "damping", "pole", "delay", "limit",  # of the servo, pole [rad/s] its fastest; of the command
    "period", "kp", "kd", "ki", "time_constant",       # of the controller and its derivative
    "theta_step", "theta_dot_step", "beta_step",       # of the sensors: quantisation
    *NUMBER_EFFECTS,
    "theta", "theta_dot", "beta", "beta_dot", "gamma",  # state of the vehicle
    "error", "derivative", "integral", "command",       # state of the controller
    counts=("first_order", "law", "lost",              # 1 yes, 0 no; of the law its number in LAWS
            "control_every", "log_every", "at_once",   # steps; the last of the diagnosis, which takes several at once
            "at", "rows"))                             # the next step; rows written
CONTROLLER_TICK = record("reference", "rate_reference", "excitation", "noise", "acceleration")  # of a controller period
SENSOR_NOISE = record("theta", "theta_dot", "beta")  # of the sensors, at a step
STAGE = record("beta", "beta_ddot")             # the nozzle at a stage of Runge-Kutta
SECTION = record("b0", "b1", "b2", "a1", "a2", "first", "second")  # of a filter, with what it remembers
LOG_ROW = record(  # of a log
    "t", "theta_ref", "beta_cmd", "beta", "theta", "theta_dot",
    "exact_beta", "exact_theta", "exact_theta_dot",  # as the sensor reads it without noise and quantisation
    "true_theta_ddot", "true_gamma", "wind",
    "true_theta", "true_theta_dot", "true_beta", "true_beta_dot")  # of the rigid body and the nozzle
Table = Any  # an array, or None in a plain flight


class Vehicle(NamedTuple):
    """A flight's data for the compiled step: record `flight` (constants, state) and tables; None: no such effect."""

    flight: np.ndarray    # (1,) FLIGHT
    ticks: np.ndarray     # (ticks,) CONTROLLER_TICK
    noise: np.ndarray     # (steps,) SENSOR_NOISE
    a6: np.ndarray        # (2 steps + 1,) 1/s^2 at every half step
    k1: np.ndarray        # (2 steps + 1,)
    computed: np.ndarray  # (ticks,) rad, the controller's commands, filled as it flies
    commands: np.ndarray  # (ticks,) rad, those issued, with noise
    filters: np.ndarray   # (n,) SECTION, of the controller
    stages: np.ndarray    # (4,) STAGE, scratch
    free: Table     # (1,) FREE_MOTION, of a servo that may be stiff; None: none
    wind: Table     # (steps + 1,) rad at every step, without the effects'; -0.0, which changes no bit: calm
    drift: Table    # z_alpha, z_beta (2, 2 steps + 1) 1/s at every half step, or (2, 0): none
    modes: Table    # (n,) MODE
    terms: Table    # (n,) TERM; None: none
    timed: Table    # (n,) TIMED
    inputs: Table   # (n,) INPUT_EFFECT
    tuning: Table   # (n, 3, steps) stiffness, drag, gain of the modes at every step; None: they are constant
    history: Table  # (2, steps + 1) attitude and rate at the sensors, or (2, 0): no sensor is late


def assembled(constants: Mapping[str, float], changes: Changes, ticks: np.ndarray, noise: np.ndarray, a6: np.ndarray,
              k1: np.ndarray, commands: np.ndarray, filters: np.ndarray, wind: np.ndarray | None,
              drift: np.ndarray | None, is_plain: bool = True, tuning: np.ndarray | None = None) -> Vehicle:
    """Return a vehicle at rest, with what effects change.

    constants  of FLIGHT;  others  of `Vehicle`; wind, drift, tuning  None: none
    is_plain   tables that no effect fills are None (else empty arrays)
    """
    flight = np.zeros(1, FLIGHT)
    v = flight[0]
    for name, value in constants.items():
        setattr(v, name, value)
    for name in NUMBER_EFFECTS:
        setattr(v, name, getattr(changes, name))
    v.delay += changes.actuator_delay
    v.kp, v.kd = changes.kp_scale * v.kp, changes.kd_scale * v.kd
    inputs = list(changes.inputs)
    for scale, lag in changes.bandwidths:
        v.frequency, lag_time = slowed(scale, lag, v.frequency, v.damping)
        if lag_time > 0.0:
            inputs.append((LAG, lag_time, 0.0))
    v.pole = fastest_pole(v.frequency, v.damping)
    free = np.full(1, math.nan, FREE_MOTION) if not is_plain or v.pole * v.step > POLE_STEP else None
    own = Vehicle(flight, ticks, noise, a6, k1, np.zeros(len(commands)), commands, filters, np.zeros(4, STAGE), free,
                  *[None] * 8)
    is_late = changes.attitude_delay > 0.0 or changes.gyro_delay > 0.0
    drifts = drift is not None or changes.z_alpha != 0.0 or changes.z_beta != 0.0
    if is_plain and not (wind is not None or drifts or is_late or changes.modes or changes.terms or changes.timed
                         or inputs):
        return own
    steps = len(a6) // 2
    return own._replace(
        wind=np.full(steps + 1, -0.0) if wind is None else wind, drift=np.zeros((2, 0)) if drift is None else drift,
        modes=np.array(changes.modes, MODE), tuning=tuning,
        terms=None if is_plain and not changes.terms else np.array(changes.terms, TERM),
        timed=np.array(changes.timed, TIMED), inputs=np.array(sorted(inputs, key=lambda row: row[0]), INPUT_EFFECT),
        history=np.zeros((2, steps + 1 if is_late else 0)))
