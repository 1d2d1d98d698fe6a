"""Unknowns outside the vehicle (wind, offsets, flight path) as further states of the bound's filter."""

import math
from typing import Any, NamedTuple, Protocol

import numpy as np

from sim.nominal import Nominal

# what a further state is
(WALK_STATE, TURBULENCE_STATE, PATH_STATE, MISALIGNMENT_STATE, MOMENT_STATE, ATTITUDE_BIAS_STATE, GYRO_BIAS_STATE,
 NOZZLE_BIAS_STATE) = range(8)
OFFSET_ROLES = {"thrust_misalignment": MISALIGNMENT_STATE, "moment": MOMENT_STATE, "attitude_bias": ATTITUDE_BIAS_STATE,
                "gyro_bias": GYRO_BIAS_STATE, "nozzle_sensor_bias": NOZZLE_BIAS_STATE}


class Path(Protocol):
    """The columns of a flight or of a log that `world_of` needs."""

    @property
    def t(self) -> np.ndarray:
        """Return the times (n,) [s] of the rows."""

    @property
    def period(self) -> float:
        """Return the time [s] between rows."""

    @property
    def wind(self) -> np.ndarray:
        """Return the wind angle (n,) [rad], as a sensor of the air's angle of attack has it."""

    @property
    def true_gamma(self) -> np.ndarray:
        """Return the flight-path angle (n,) [rad]."""


class World(NamedTuple):
    """States outside the vehicle (r: wind, offsets, path) with their variances, and the known air, over n rows."""

    role: np.ndarray      # (r,) int64, WALK_STATE .. NOZZLE_BIAS_STATE
    start: np.ndarray     # (r, n) variance of each before any data, were a window to begin at the row
    fresh: np.ndarray     # (r,) variance that a second adds; of turbulence that a step adds is start (1 - keep^2)
    fade: np.ndarray      # (r,) [s] in which it falls to 1/e; inf: it stays
    air: np.ndarray       # (n,) [rad] known part of the angle of attack beside theta, over the step from the row
    drift: np.ndarray     # (2, n) [1/s] z_alpha, z_beta over the step from the row, of PATH_STATE
    gamma: np.ndarray     # (n,) [rad] PATH_STATE at the row, where a window begins
    gamma_variance: float  # [rad^2] of the measured flight path, within `air`
    restarts: bool        # a window knows nothing of the data before it
    levels_known: bool    # the size of the wind's response tells of a6


def calm(n: int) -> World:
    """Return a world of n rows in which nothing but the vehicle is unknown."""
    return World(np.zeros(0, np.int64), np.zeros((0, n)), np.zeros(0), np.zeros(0), np.zeros(n), np.zeros((2, n)),
                 np.zeros(n), 0.0, False, False)


def world_of(nominal: Nominal, flight: Path, restarts: bool = True, path_known: bool = True,
             levels_known: bool = False) -> World:
    """Return the world that a nominal's [wind], [offsets] and [drift] leave unknown over a flight's rows; restarts:
    windows know nothing of earlier data; the others as `flight_information`."""
    t, h = flight.t, flight.period
    n, wind, offsets, drift = len(t), nominal.wind, nominal.offsets, nominal.drift
    seen = nominal.sensors.alpha_source == "air"  # an angle of attack that holds the wind
    states: list[tuple[int, np.ndarray, float, float]] = []
    if wind is not None and not seen:
        if wind.walk > 0.0 or wind.initial > 0.0:
            states.append((WALK_STATE, wind.initial**2 + wind.walk**2 * (t - t[0]), wind.walk**2, math.inf))
        if wind.turbulence > 0.0:
            states.append((TURBULENCE_STATE, np.full(n, wind.turbulence**2), 0.0, wind.turbulence_time))
    unseen = drift is not None and not path_known
    if unseen:
        states.append((PATH_STATE, np.zeros(n), 0.0, math.inf))
    if offsets is not None:
        states += [(role, np.full(n, getattr(offsets, name)**2), 0.0, math.inf) for name, role in OFFSET_ROLES.items()
                   if getattr(offsets, name) > 0.0]
    world = calm(n)
    air = world.air
    if seen:
        air = air + over_steps(flight.wind)
    elif wind is not None and wind.profile is not None:
        air = air + wind.profile.at(t + 0.5 * h)
    gamma_variance = 0.0
    if drift is not None and path_known:
        air = air - over_steps(flight.true_gamma)  # the noise of the measured one excites nothing
        gamma_variance = max(nominal.sensors.gamma_std, nominal.sensors.alpha_std)**2
    role, start, fresh, fade = zip(*states, strict=True) if states else ((), (), (), ())
    return World(np.array(role, np.int64), np.array(start).reshape(len(states), n), np.array(fresh, np.float64),
                 np.array(fade, np.float64), air,
                 np.stack(drift.at(t + 0.5 * h)) if drift is not None and unseen else world.drift,
                 flight.true_gamma if unseen else world.gamma, gamma_variance, restarts and len(states) > 0,
                 levels_known)


def contiguous(world: World) -> World:
    """Return the world with C-contiguous arrays, for which alone the kernels are compiled."""
    whole: dict[str, Any] = {name: np.ascontiguousarray(each) for name, each in world._asdict().items()
                             if isinstance(each, np.ndarray)}
    return world._replace(**whole)


def over_steps(value: np.ndarray) -> np.ndarray:
    """Return the mean of a signal (n,) over the step from each row to the next; for the last row its own value."""
    return 0.5 * (value + np.append(value[1:], value[-1]))
