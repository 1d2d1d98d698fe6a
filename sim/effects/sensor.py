"""Effects on what is measured, before noise and quantisation.

A sensor reads the value `delay` ago (linear between integration steps; before
t = 0 the vehicle stood as at t = 0), then the gyro scales, then each adds its
bias.  The controller sees the attitude, of law `rate` the gyro; the nozzle sensor
goes to the log only.  Of several of one kind delays and biases add, scales multiply.  They act in
the `ideal` suite as well: its sensors are free of noise, not of these.

Assumption: `bending` moves the place where attitude and rate are measured, so it
comes before these.

To add an effect: its row in SENSOR_EFFECTS, its branch in `change`, its equation in a kernel.
"""

import math
from collections.abc import Mapping

from ..vehicle.kernels import inner
from .actuator import LONGEST_DELAY
from .plant import deflection
from .table import Cause, Changes, Parameter

ATTITUDE_ROW, RATE_ROW = range(2)  # rows of the history

SENSOR_EFFECTS = (
    Cause("attitude_delay", "sensor", (Parameter("delay", "s", neutral=0.0, low=0.0, high=LONGEST_DELAY),)),
    Cause("attitude_bias", "sensor", (Parameter("angle", "rad", neutral=0.0),)),
    Cause("gyro_delay", "sensor", (Parameter("delay", "s", neutral=0.0, low=0.0, high=LONGEST_DELAY),)),
    Cause("gyro_scale", "sensor", (Parameter("scale", "", neutral=1.0),)),
    Cause("gyro_bias", "sensor", (Parameter("rate", "rad/s", neutral=0.0),)),
    Cause("nozzle_sensor_bias", "sensor", (Parameter("angle", "rad", neutral=0.0),)),
)


def change(of: Changes, name: str, p: Mapping[str, float]) -> None:
    """Add the effect of this name, with these values, to what the flight's effects change."""
    match name:
        case "attitude_delay":
            of.attitude_delay += p["delay"]
        case "attitude_bias":  # mounting of the attitude reference
            of.attitude_bias += p["angle"]
        case "gyro_delay":
            of.gyro_delay += p["delay"]
        case "gyro_scale":
            of.gyro_scale *= p["scale"]
        case "gyro_bias":  # drift of the gyro
            of.gyro_bias += p["rate"]
        case "nozzle_sensor_bias":  # null of the nozzle's sensor
            of.nozzle_sensor_bias += p["angle"]


@inner
def remember(v, modes, history, i):
    """Keep attitude and rate of step i where the sensors sit; history (2, steps), or (2, 0): no sensor is late."""
    if history is not None:
        if history.shape[1] > 0:
            eta, eta_dot = deflection(modes)
            history[ATTITUDE_ROW, i], history[RATE_ROW, i] = v.theta + eta, v.theta_dot + eta_dot


@inner
def past(history, i, delay, step):
    """Value `delay` [s] before step i, linear between steps; history (steps,) in, filled up to i."""
    position = i - delay / step
    if position <= 0.0:
        return history[0]
    k = math.floor(position)
    share = position - k
    early = history[k]
    return early if share == 0.0 else (1.0 - share) * early + share * history[k + 1]


@inner
def read(v, modes, history, i):
    """What attitude sensor [rad] and gyro [rad/s] show at step i, without noise."""
    eta, eta_dot = deflection(modes)
    theta, theta_dot = v.theta + eta, v.theta_dot + eta_dot
    if history is not None:
        if v.attitude_delay > 0.0:
            theta = past(history[ATTITUDE_ROW], i, v.attitude_delay, v.step)
        if v.gyro_delay > 0.0:
            theta_dot = past(history[RATE_ROW], i, v.gyro_delay, v.step)
    return theta + v.attitude_bias, v.gyro_scale * theta_dot + v.gyro_bias
