"""Effects on what is measured, before noise and quantisation.

A sensor reads the value `delay` ago (linear between integration steps; before
t = 0 the vehicle stood as at t = 0), then the gyro scales, then each adds its
bias.  The controller sees the attitude, of law `rate` the gyro; the nozzle sensor
goes to the log only.  Of several of one kind delays and biases add, scales multiply.  They act in
the `ideal` suite as well: its sensors are free of noise, not of these.

Assumption: `bending` moves the place where attitude and rate are measured, so it
comes before these.

To add an effect: its kernel, its branch below, its row in EFFECTS.
"""

import math

import numpy as np

from ..vehicle.kernels import asked, inner, kernel
from .actuator import LONGEST_DELAY
from .table import CODE, P0, Cause, Parameter

ATTITUDE_DELAY, ATTITUDE_BIAS, GYRO_DELAY, GYRO_SCALE, GYRO_BIAS, NOZZLE_SENSOR_BIAS = range(6)

ATTITUDE, RATE = range(2)  # rows of the history

EFFECTS = (
    Cause("attitude_delay", "sensor", (Parameter("delay", "s", neutral=0.0, low=0.0, high=LONGEST_DELAY),)),
    Cause("attitude_bias", "sensor", (Parameter("angle", "rad", neutral=0.0),)),
    Cause("gyro_delay", "sensor", (Parameter("delay", "s", neutral=0.0, low=0.0, high=LONGEST_DELAY),)),
    Cause("gyro_scale", "sensor", (Parameter("scale", "", neutral=1.0),)),
    Cause("gyro_bias", "sensor", (Parameter("rate", "rad/s", neutral=0.0),)),
    Cause("nozzle_sensor_bias", "sensor", (Parameter("angle", "rad", neutral=0.0),)),
)


# ---- the physics


@kernel
def past(history, row, i, delay, step):
    """Value `delay` [s] before step i, linear between steps; `history` (2, steps) in, its row filled up to i."""
    position = i - delay / step
    if position <= 0.0:
        return history[row, 0]
    k = math.floor(position)
    share = position - k
    early = history[row, k]
    return early if share == 0.0 else (1.0 - share) * early + share * history[row, k + 1]


@kernel
def biased(bias, value):
    """value + bias: mounting of the attitude reference, drift of the gyro, null of the nozzle's sensor."""
    return value + bias


@kernel
def scaled(scale, value):
    """scale value: the gyro's scale factor."""
    return scale * value


def nulls(fx: np.ndarray) -> tuple[float, float, float]:
    """The readings of attitude [rad], gyro [rad/s] and nozzle sensor [rad] at a true value of 0: their biases."""
    attitude, rate, angle = (float(fx[fx[:, CODE] == code, P0].sum())
                             for code in (ATTITUDE_BIAS, GYRO_BIAS, NOZZLE_SENSOR_BIAS))
    return attitude, rate, angle


# ---- the place: fx (n, N_COLUMNS) inout, its rows of the table


@inner
def latency(fx, code):
    """Sum of the delays [s] of one kind: ATTITUDE_DELAY or GYRO_DELAY."""
    delay = 0.0
    for e in range(fx.shape[0]):
        if fx[e, CODE] == code:
            delay += fx[e, P0]
    return delay


@asked
def rate_scale(fx):
    """The gyro's reading at 1 rad/s: the product of its scale factors."""
    scale = 1.0
    for e in range(fx.shape[0]):
        if fx[e, CODE] == GYRO_SCALE:
            scale *= fx[e, P0]
    return scale


@inner
def attitude(fx, history, i, step, theta):
    """z_theta [rad] at step i of the true attitude there; history (2, steps) of the true values."""
    delay = latency(fx, ATTITUDE_DELAY)
    if delay > 0.0:
        theta = past(history, ATTITUDE, i, delay, step)
    for e in range(fx.shape[0]):
        if fx[e, CODE] == ATTITUDE_BIAS:
            theta = biased(fx[e, P0], theta)
    return theta


@inner
def gyro(fx, history, i, step, theta_dot):
    """z_theta_dot [rad/s] at step i of the true rate there; history (2, steps) of the true values."""
    delay = latency(fx, GYRO_DELAY)
    if delay > 0.0:
        theta_dot = past(history, RATE, i, delay, step)
    for e in range(fx.shape[0]):
        if fx[e, CODE] == GYRO_SCALE:
            theta_dot = scaled(fx[e, P0], theta_dot)
        elif fx[e, CODE] == GYRO_BIAS:
            theta_dot = biased(fx[e, P0], theta_dot)
    return theta_dot


@inner
def nozzle(fx, beta):
    """z_beta [rad] of the true nozzle angle."""
    for e in range(fx.shape[0]):
        if fx[e, CODE] == NOZZLE_SENSOR_BIAS:
            beta = biased(fx[e, P0], beta)
    return beta
