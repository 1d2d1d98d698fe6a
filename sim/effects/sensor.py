"""Effects on the measured signals, before noise and quantisation.

A sensor reads the value `delay` ago (linear between integration steps; before
t = 0 the vehicle stood as at t = 0), then the gyro scales, then each adds its
bias.  The controller sees the attitude, of law `rate` the gyro; the nozzle sensor
goes to the log only.  Of several of one kind delays and biases add, scales multiply.  They act in
the `ideal` suite as well: its sensors are free of noise, not of these.

Assumption: `bending` moves the place where attitude and rate are measured, so it
comes before these.

To add an effect: its row in SENSOR_EFFECTS, its equation in a kernel.
"""

import math

from ..kernels import inner
from .actuator import LONGEST_DELAY
from .plant import deflection
from .table import Cause, Parameter

ATTITUDE_ROW, RATE_ROW = range(2)  # rows of the history

SENSOR_EFFECTS = (
    Cause("attitude_delay", "sensor", (
        Parameter("delay", "s", neutral=0.0, low=0.0, high=LONGEST_DELAY, into="attitude_delay"),),
        "on z_theta, seen by the controller too"),
    Cause("attitude_bias", "sensor", (  # mounting of the attitude reference
        Parameter("angle", "rad", neutral=0.0, into="attitude_bias"),),
        "on z_theta, seen by the controller too"),
    Cause("gyro_delay", "sensor", (
        Parameter("delay", "s", neutral=0.0, low=0.0, high=LONGEST_DELAY, into="gyro_delay"),),
        "on z_theta_dot"),
    Cause("gyro_scale", "sensor", (Parameter("scale", "", neutral=1.0, into="gyro_scale"),),
        "on z_theta_dot"),
    Cause("gyro_bias", "sensor", (Parameter("rate", "rad/s", neutral=0.0, into="gyro_bias"),),
        "on z_theta_dot"),  # drift of the gyro
    Cause("nozzle_sensor_bias", "sensor", (  # null of the nozzle's sensor
        Parameter("angle", "rad", neutral=0.0, into="nozzle_sensor_bias"),),
        "on z_beta"),
)


@inner
def remember(v, modes, history, i):
    """Write attitude and rate at the sensors at step i to history (2, steps); nothing if it is None or (2, 0)."""
    if history is not None:
        if history.shape[1] > 0:
            eta, eta_dot = deflection(modes)
            history[ATTITUDE_ROW, i], history[RATE_ROW, i] = v.theta + eta, v.theta_dot + eta_dot


@inner
def past(history, i, delay, step):
    """Return the value `delay` [s] before step i, linear between steps of `step` [s]; history (steps,), filled to i."""
    position = i - delay / step
    if position <= 0.0:
        return history[0]
    k = math.floor(position)
    share = position - k
    early = history[k]
    return early if share == 0.0 else (1.0 - share) * early + share * history[k + 1]


@inner
def read(v, modes, history, i):
    """Return the reading of attitude sensor [rad] and gyro [rad/s] at step i: delay, scale and bias, without noise."""
    eta, eta_dot = deflection(modes)
    theta, theta_dot = v.theta + eta, v.theta_dot + eta_dot
    if history is not None:
        if v.attitude_delay > 0.0:
            theta = past(history[ATTITUDE_ROW], i, v.attitude_delay, v.step)
        if v.gyro_delay > 0.0:
            theta_dot = past(history[RATE_ROW], i, v.gyro_delay, v.step)
    return theta + v.attitude_bias, v.gyro_scale * theta_dot + v.gyro_bias
