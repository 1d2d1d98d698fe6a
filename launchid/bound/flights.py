"""Fly a nominal and compute the Cramer-Rao bound of a6 and k1 in each window of the flight."""

import math

import numpy as np

from sim.flight import Flight, fly_whole
from sim.nominal import Nominal
from sim.plant import Factor, parameters

from .information import (
    N_SERVO,
    N_UNKNOWN,
    Bound,
    bounds_of,
    window_information,
    with_prior,
    without_offset,
)
from .modes import modes_of
from .step import FIRST_ORDER, N_STATES
from .world import world_of


def noise_variances(nominal: Nominal, period: float) -> np.ndarray:
    """Variances (5,) of theta, theta_dot, beta, command, acceleration; held noise keeps its density at `period` [s]."""
    nominal.require("actuator", "controller", "simulation")
    sensors, actuator, simulation = nominal.sensors, nominal.actuator, nominal.simulation
    assert actuator is not None and simulation is not None and nominal.controller is not None
    held = nominal.controller.period / period
    return np.array([sensors.theta_std**2, sensors.theta_dot_std**2, sensors.beta_std**2,
                     actuator.command_noise_std**2 * held, simulation.acceleration_noise_std**2 * held])


def servo_of(nominal: Nominal) -> np.ndarray:
    """Return (2,) natural frequency [rad/s], damping ratio; of a first-order servo 1/time constant, FIRST_ORDER."""
    actuator = nominal.actuator
    assert actuator is not None
    if actuator.is_first_order:
        return np.array([1.0 / actuator.time_constant, FIRST_ORDER])
    return np.array([actuator.natural_frequency, actuator.damping_ratio])


def servo_sigma(nominal: Nominal) -> np.ndarray:
    """Return (3,) one sigma before the flight: relative frequency, relative damping ratio, delay [s]; 0 is known."""
    actuator = nominal.actuator
    assert actuator is not None
    return np.array([actuator.natural_frequency_sigma, actuator.damping_ratio_sigma, actuator.delay_sigma])


def acting_command(nominal: Nominal, flight: Flight) -> np.ndarray:
    """Return the mean command (n,) [rad] at the servo over the step from each row: delayed, 0 before the first."""
    assert nominal.actuator is not None
    if nominal.actuator.delay == 0.0:
        return flight.beta_cmd
    older, newer, switch = switched(flight.beta_cmd, nominal.actuator.delay, flight.period)
    return newer + switch / flight.period * (older - newer)


def switched(command: np.ndarray, delay: float, period: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Delay a held command (n,) [rad] (0 before its first row) by `delay` [s].  Return the command at the servo at each
    row (n,), the one that replaces it before the next row (n,), and how long [s] after the row it does."""
    whole = math.floor(delay / period)
    past = np.concatenate([np.zeros(whole + 1), command])
    return past[:len(command)], past[1:len(command) + 1], delay - whole * period


def flight_information(nominal: Nominal, window: float, seed: int = 0, period: float | None = None,
                       a6_factor: Factor = 1.0, k1_factor: Factor = 1.0, *, path_known: bool = True,
                       levels_known: bool = False) -> np.ndarray:
    """Fly once (`flight` sensors); return Fisher information (w, 2, 2) about relative a6 and k1 in each of w windows;
    larger where [actuator] or modes have sigmas: the servo's unknowns follow, then the modes'.

    nominal  vehicle, noises and air;  window [s];  period [s] of the log, None: sensors.period
    a6_factor, k1_factor  true parameters over the nominal's
    path_known   the log has the flight path of [drift]; else only its true value at a window's start is known
    levels_known  the wind's levels are known, so the size of the vehicle's response tells of a6
    """
    flight = fly_whole(nominal, seed, "flight", period, a6_factor, k1_factor)
    return information_of(nominal, flight, window, a6_factor, k1_factor, path_known=path_known,
                          levels_known=levels_known)


def information_of(nominal: Nominal, flight: Flight, window: float, a6_factor: Factor = 1.0, k1_factor: Factor = 1.0, *,
                   path_known: bool = True, levels_known: bool = False) -> np.ndarray:
    """Return the information as `flight_information` of a flight that the nominal, its modes' numbers the true ones,
    flew."""
    t = flight.t
    middle_a6, middle_k1 = parameters(nominal, t + 0.5 * flight.period, a6_factor, k1_factor)
    index = np.floor(t / window + 1e-9).astype(np.int64)
    windows = math.floor((t[-1] + 1.5 * flight.period) / window)
    index[index >= windows] = -1
    assert nominal.actuator is not None
    is_known, modes = nominal.actuator.is_known, modes_of(nominal, t + 0.5 * flight.period)
    count = len(modes.bends)
    unknowns = N_UNKNOWN + 5 * count + N_SERVO * (not is_known)
    information = np.zeros((windows, unknowns, unknowns))
    command, newer, switch = switched(flight.beta_cmd, nominal.actuator.delay, flight.period)
    if is_known:
        command = acting_command(nominal, flight)
    window_information(t, np.column_stack([flight.theta, flight.theta_dot, flight.beta]), command, middle_a6, middle_k1,
                       servo_of(nominal), noise_variances(nominal, flight.period), index, information, np.zeros(len(t)),
                       world_of(nominal, flight, path_known=path_known, levels_known=levels_known), newer, switch,
                       modes=modes)
    left = without_offset(information, N_STATES + 2 * count)
    if is_known:
        return with_prior(left, modes.sigma.ravel())
    *shaped, delay = servo_sigma(nominal)
    order = np.concatenate([np.arange(4), [4 + 3 * count], np.arange(4, 4 + 3 * count)])   # the delay to the servo's
    return with_prior(left[:, order][:, :, order], np.concatenate([shaped, [delay], modes.sigma.ravel()]))


def flight_bound(nominal: Nominal, window: float, seed: int = 0, period: float | None = None,
                 a6_factor: Factor = 1.0, k1_factor: Factor = 1.0, *, path_known: bool = True,
                 levels_known: bool = False) -> Bound:
    """Fly once; return the bound of a6 and k1 in every window of `window` [s]; arguments as `flight_information`."""
    information = flight_information(nominal, window, seed, period, a6_factor, k1_factor, path_known=path_known,
                                     levels_known=levels_known)
    return bounds_of(information, window, int(np.count_nonzero(modes_of(nominal, np.zeros(1)).sigma)))


def known_state_information(nominal: Nominal, flight: Flight, onset: float, a6_factor: Factor = 1.0,
                            k1_factor: Factor = 1.0, horizon: float = 4.0) -> tuple[np.ndarray, np.ndarray]:
    """Return times [s] (n,) of the rows from `onset` [s] to `horizon` [s] later, and the information (n,) by then about
    a relative change of k1 at the onset [1/relative^2], the state at the onset known.

    Wind and offsets are known as well as two seconds of data before the onset tell.
    The factors are those before the change; the flight may have any.
    """
    begin = int(np.searchsorted(flight.t, onset))
    first = max(begin - 200, 0)  # 2 s at 100 Hz: the filter's covariance settles
    end = min(len(flight.t), begin + round(horizon / flight.period))
    rows = slice(first, end)
    t = flight.t[rows]
    a6, k1 = parameters(nominal, t + 0.5 * flight.period, a6_factor, k1_factor)
    world = world_of(nominal, flight, restarts=False)
    world = world._replace(start=world.start[:, rows], air=world.air[rows], drift=world.drift[:, rows],
                           gamma=world.gamma[rows])
    z = np.column_stack([flight.theta, flight.theta_dot, flight.beta])[rows]
    variances = noise_variances(nominal, flight.period)
    index = np.where(np.arange(first, end) >= begin, 0, -1).astype(np.int64)
    grown = np.zeros(end - first)
    window_information(t, z, acting_command(nominal, flight)[rows], a6, k1, servo_of(nominal), variances, index,
                       np.zeros((1, N_UNKNOWN, N_UNKNOWN)), grown, world)
    return flight.t[begin:end], grown[begin - first:]
