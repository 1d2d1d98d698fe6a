"""The Cramer-Rao bound: the least error any unbiased estimator can have on a window of data.

Unknown: a constant relative deviation of a6 and of k1 from the nominal's profile
over the window, and the initial state (diffuse).  Known: the command, the noises
(sensor noise as measurement noise; command noise and unmodelled acceleration as
process noise, held over a sample), the actuator.

Method: prediction-error sensitivities through the Kalman filter (Ljung, System
Identification, 2nd ed., section 9.4, and Gupta & Mehra, IEEE TAC 19, 1974).  The
filter's own start does not matter: an unknown initial offset with a flat prior
added to any finite covariance is a diffuse start, so its four sensitivities join
the two of the parameters and a Schur complement removes them.

Limitation: the information in the innovations' covariance (how noise levels
depend on the parameters) is left out; on these vehicles it is below 0.1 %.
"""

import math
from dataclasses import dataclass

import numpy as np

from .flight import Factor, Flight, fly_whole, parameters
from .nominal import Nominal
from .vehicle.kernels import kernel

N_STATES = 4       # theta, theta_dot, beta, beta_dot
N_AUGMENTED = 6    # and the held command and acceleration
N_UNKNOWN = 6      # four initial states, relative a6, relative k1
TAYLOR_ORDER = 12  # |A h| <= 0.6 here: the remainder is below 1e-12


@dataclass(frozen=True, eq=False)
class Bound:
    """Per window of one flight.  Arrays (windows,); standard deviations are relative to the true value."""

    t_start: np.ndarray      # s
    a6: np.ndarray           # relative standard deviation
    k1: np.ndarray
    correlation: np.ndarray


@kernel
def transition(a6, k1, frequency, damping, h, f, fa, fk):
    """exp(A h) of the augmented system and its derivatives for da6, dk1.  f, fa, fk (6, 6) out."""
    n = N_AUGMENTED
    a = np.zeros((n, n))
    a[0, 1] = 1.0
    a[1, 0] = a6
    a[1, 2] = k1
    a[1, 5] = 1.0
    a[2, 3] = 1.0
    a[3, 2] = -frequency * frequency
    a[3, 3] = -2.0 * damping * frequency
    a[3, 4] = frequency * frequency
    term, term_a, term_k = np.eye(n), np.zeros((n, n)), np.zeros((n, n))
    f[:, :] = np.eye(n)
    fa[:, :] = 0.0
    fk[:, :] = 0.0
    for order in range(1, TAYLOR_ORDER + 1):
        new, new_a, new_k = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
        for i in range(n):
            for j in range(n):
                for k in range(n):
                    if a[i, k] != 0.0:
                        new[i, j] += a[i, k] * term[k, j]
                        new_a[i, j] += a[i, k] * term_a[k, j]
                        new_k[i, j] += a[i, k] * term_k[k, j]
        for j in range(n):
            new_a[1, j] += term[0, j]
            new_k[1, j] += term[2, j]
        term, term_a, term_k = new * (h / order), new_a * (h / order), new_k * (h / order)
        f += term
        fa += term_a
        fk += term_k


@kernel
def predict(x, p, s, u, f, fa, fk, a6, k1, q_command, q_acceleration):
    """Time update of the state x (4,), its covariance p (4, 4) and the sensitivities s (4, 6)."""
    n = N_STATES
    new_x, new_s, fp, new_p = np.zeros(n), np.zeros((n, N_UNKNOWN)), np.zeros((n, n)), np.zeros((n, n))
    for i in range(n):
        new_x[i] = f[i, 4] * u
        new_s[i, 4] = a6 * fa[i, 4] * u
        new_s[i, 5] = k1 * fk[i, 4] * u
        for k in range(n):
            new_x[i] += f[i, k] * x[k]
            new_s[i, 4] += a6 * fa[i, k] * x[k]
            new_s[i, 5] += k1 * fk[i, k] * x[k]
            for j in range(N_UNKNOWN):
                new_s[i, j] += f[i, k] * s[k, j]
            for j in range(n):
                fp[i, j] += f[i, k] * p[k, j]
    for i in range(n):
        for j in range(n):
            new_p[i, j] = f[i, 4] * f[j, 4] * q_command + f[i, 5] * f[j, 5] * q_acceleration
            for k in range(n):
                new_p[i, j] += fp[i, k] * f[j, k]
    x[:] = new_x
    p[:, :] = new_p
    s[:, :] = new_s


@kernel
def correct(x, p, s, channel, z, r, information):
    """Scalar measurement update; adds the innovation's information about the six unknowns."""
    variance = p[channel, channel] + r
    innovation = z - x[channel]
    gain = p[:, channel] / variance
    row = s[channel].copy()
    for i in range(N_UNKNOWN):
        for j in range(N_UNKNOWN):
            information[i, j] += row[i] * row[j] / variance
    column = p[channel].copy()
    for i in range(N_STATES):
        x[i] += gain[i] * innovation
        for j in range(N_UNKNOWN):
            s[i, j] -= gain[i] * row[j]
        for j in range(N_STATES):
            p[i, j] -= gain[i] * column[j]


@kernel
def window_information(t, z, u, a6, k1, actuator, noises, window_of, information, k1_information):
    """Information of each window about (initial state, relative a6, relative k1).

    t, u (n,)   [s, rad]  in
    z (n, 3)              in   theta, theta_dot, beta
    a6, k1 (n,) [1/s^2]   in   true, at the middle of the step from each row
    actuator (2,)         in   natural frequency [rad/s], damping ratio
    noises (5,)           in   variances: theta, theta_dot, beta, command, acceleration (held over a sample)
    window_of (n,)        in   int64 window of each row, -1 for none
    information (w, 6, 6) out
    k1_information (n,)   out  that of relative k1, the state at the window's start known, by each row
    """
    x, p, s = np.zeros(N_STATES), np.zeros((N_STATES, N_STATES)), np.zeros((N_STATES, N_UNKNOWN))
    f, fa, fk = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 6))
    unused = np.zeros((N_UNKNOWN, N_UNKNOWN))
    channels = (0, 1, 2)
    for channel in channels:
        x[channel] = z[0, channel]
        p[channel, channel] = noises[channel]
    current = -1
    for k in range(len(t)):
        if window_of[k] != current:
            current = window_of[k]
            s[:, :] = 0.0
            for i in range(N_STATES):
                s[i, i] = 1.0
        for channel in channels:
            if np.isfinite(z[k, channel]):
                correct(x, p, s, channel, z[k, channel], noises[channel],
                        information[current] if current >= 0 else unused)
        k1_information[k] = information[current, 5, 5] if current >= 0 else 0.0
        if k + 1 < len(t):
            transition(a6[k], k1[k], actuator[0], actuator[1], t[k + 1] - t[k], f, fa, fk)
            predict(x, p, s, u[k], f, fa, fk, a6[k], k1[k], noises[3], noises[4])


def noise_variances(nominal: Nominal, period: float) -> np.ndarray:
    """Variances (5,) of theta, theta_dot, beta, command, acceleration; held noise keeps its density at `period`."""
    nominal.require("actuator", "controller", "simulation")
    sensors, actuator, simulation = nominal.sensors, nominal.actuator, nominal.simulation
    assert actuator is not None and simulation is not None and nominal.controller is not None
    held = nominal.controller.period / period
    return np.array([sensors.theta_std**2, sensors.theta_dot_std**2, sensors.beta_std**2,
                     actuator.command_noise_std**2 * held, simulation.acceleration_noise_std**2 * held])


def flight_information(nominal: Nominal, window: float, seed: int = 0, period: float | None = None,
                       a6_factor: Factor = 1.0, k1_factor: Factor = 1.0) -> np.ndarray:
    """Information (w, 2, 2) about (relative a6, relative k1) in each window of one flight (`flight` suite).

    nominal  what flies and how noisy it is;  window [s];  period [s] of the log, None: sensors.period
    a6_factor, k1_factor  true parameters over the nominal's
    """
    flight = fly_whole(nominal, seed, "flight", period, a6_factor, k1_factor)
    t = flight.t
    middle_a6, middle_k1 = parameters(nominal, t + 0.5 * flight.period, a6_factor, k1_factor)
    index = np.floor(t / window + 1e-9).astype(np.int64)
    windows = math.floor((t[-1] + 1.5 * flight.period) / window)
    index[index >= windows] = -1
    information = np.zeros((windows, N_UNKNOWN, N_UNKNOWN))
    assert nominal.actuator is not None
    actuator = np.array([nominal.actuator.natural_frequency, nominal.actuator.damping_ratio])
    window_information(t, np.column_stack([flight.theta, flight.theta_dot, flight.beta]), flight.beta_cmd, middle_a6,
                       middle_k1, actuator, noise_variances(nominal, flight.period), index, information,
                       np.zeros(len(t)))
    return without_offset(information)


def flight_bound(nominal: Nominal, window: float, seed: int = 0, period: float | None = None,
                 a6_factor: Factor = 1.0, k1_factor: Factor = 1.0) -> Bound:
    """Bound of every window of one flight; arguments as `flight_information`."""
    return bounds_of(flight_information(nominal, window, seed, period, a6_factor, k1_factor), window)


def known_state_information(nominal: Nominal, flight: Flight, onset: float, a6_factor: Factor = 1.0,
                            k1_factor: Factor = 1.0, horizon: float = 4.0) -> tuple[np.ndarray, np.ndarray]:
    """Information about a relative change of k1 at `onset`, the state before it known, as it grows with time.

    Returns times [s] of the rows after the onset, up to `horizon` later, and the information (1/relative^2) by then.
    The factors are those before the change; the flight may have any.
    """
    assert nominal.actuator is not None
    begin = int(np.searchsorted(flight.t, onset))
    first = max(begin - 200, 0)  # 2 s at 100 Hz: the filter's covariance settles
    end = min(len(flight.t), begin + round(horizon / flight.period))
    rows = slice(first, end)
    t = flight.t[rows]
    a6, k1 = parameters(nominal, t + 0.5 * flight.period, a6_factor, k1_factor)
    actuator = np.array([nominal.actuator.natural_frequency, nominal.actuator.damping_ratio])
    z = np.column_stack([flight.theta, flight.theta_dot, flight.beta])[rows]
    variances = noise_variances(nominal, flight.period)
    index = np.where(np.arange(first, end) >= begin, 0, -1).astype(np.int64)
    grown = np.zeros(end - first)
    window_information(t, z, flight.beta_cmd[rows], a6, k1, actuator, variances, index,
                       np.zeros((1, N_UNKNOWN, N_UNKNOWN)), grown)
    return flight.t[begin:end], grown[begin - first:]


def without_offset(information: np.ndarray) -> np.ndarray:
    """(w, 2, 2) from (w, 6, 6): the unknown initial state removed by a Schur complement."""
    nuisance = information[:, :4, :4]
    cross = information[:, :4, 4:]
    scale = np.sqrt(np.einsum("wii->wi", nuisance))
    scaled = nuisance / scale[:, :, None] / scale[:, None, :]
    explained = np.einsum("wki,wkj->wij", cross / scale[:, :, None],
                          np.linalg.solve(scaled, cross / scale[:, :, None]))
    return information[:, 4:, 4:] - explained


def bounds_of(information: np.ndarray, window: float) -> Bound:
    """Bounds from information matrices (w, 2, 2) of windows end to end."""
    covariance = np.linalg.inv(information)
    std = np.sqrt(np.einsum("wii->wi", covariance))
    return Bound(np.arange(len(std)) * window, std[:, 0], std[:, 1], covariance[:, 0, 1] / (std[:, 0] * std[:, 1]))
