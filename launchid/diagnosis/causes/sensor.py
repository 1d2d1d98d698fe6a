"""Causes in the sensors."""

import math

from ..data.record import Record
from .environment import REFERENCE
from .hypothesis import Correction, Hypothesis, as_aside, as_commanded, as_timed, by_its_size, far_delays, is_told, size
from .plant import ANOTHER_PROFILE


def _gyro(record: Record) -> bool:
    return "theta_dot" in record.channels


def _gyro_is_told(record: Record) -> bool:
    return is_told(record, "theta_dot", "theta")


def _attitude_is_told(record: Record) -> bool:
    return is_told(record, "theta", "theta_dot")


def _nozzle(record: Record) -> bool:
    """The nozzle's sensor is beside a command to compare it with."""
    return "beta" in record.channels and record.command_is_known


CAUSES = (
    Hypothesis("attitude_bias", (size("angle", 1e-3, -math.pi, math.pi),), 0.0,
               "the attitude sensor reads {angle} too much",
               decides=(("steady_wind", REFERENCE), ("thrust_misalignment", ANOTHER_PROFILE)),
               corrections=(Correction("theta", lambda x, of: x - of["angle"]),), held=as_aside),
    Hypothesis("attitude_delay", (size("delay", 2e-3, 0.0, 1.0),), 0.0, "the attitude is measured {delay} late",
               visible=_attitude_is_told, far=far_delays, late=by_its_size, floor=as_timed),
    Hypothesis("gyro_bias", (size("rate", 1e-4),), 0.0,
               "the gyro reads {rate} too much (an attitude reference that drifts by as much looks the same)",
               visible=_gyro, imitated=("theta", "time"),  # told apart by a6 times the drift, if at all
               corrections=(Correction("theta_dot", lambda x, of: x - of["rate"]),)),
    Hypothesis("gyro_scale", (size("scale", 0.005, -3.0, 5.0),), 1.0,
               "the gyro's scale factor is {scale} (an attitude read at the inverse of it looks much the same)",
               visible=_gyro_is_told,  # it scales, then adds its bias
               corrections=(Correction("theta_dot", lambda x, of: x / of["scale"], is_outer=True),)),
    Hypothesis("gyro_delay", (size("delay", 2e-3, 0.0, 1.0),), 0.0, "the gyro is {delay} late",
               visible=_gyro_is_told, far=far_delays, late=by_its_size, floor=as_timed),
    Hypothesis("nozzle_sensor_bias", (size("angle", 1e-4),), 0.0, "the nozzle sensor reads {angle} too much",
               visible=_nozzle, corrections=(Correction("beta", lambda x, of: x - of["angle"]),), floor=as_commanded),
)
