"""The one type that the simulator (or a vehicle) and the estimator share."""

from typing import NamedTuple

NAN = float("nan")


class Sample(NamedTuple):
    """One instant of measurements.  SI units; NaN means "not measured".

    t           [s]       time stamp, any origin
    theta       [rad]     attitude
    theta_dot   [rad/s]   attitude rate; NaN: theta is differenced
    beta        [rad]     nozzle deflection (any input on a test stand)
    theta_ddot  [rad/s^2] angular acceleration, optional
    beta_cmd    [rad]     command to the actuator from t on, optional
    gamma       [rad]     flight-path angle; theta and gamma relative to the reference flight path, optional
    """

    t: float
    theta: float
    theta_dot: float
    beta: float
    theta_ddot: float = NAN
    beta_cmd: float = NAN
    gamma: float = NAN
