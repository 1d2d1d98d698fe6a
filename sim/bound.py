"""The Cramer-Rao bound: the least error any unbiased estimator can have on a window of data.

Unknown: a constant relative deviation of a6 and of k1 from the nominal's profile
over the window, the vehicle's state at its start (diffuse), and what [wind] and
[offsets] leave open: the wind's walk and turbulence, misalignment, moment and
sensor offsets, at the window's start no better known than before the flight.
Known: the command, the actuator, the flight path, and the levels of the noises
(sensor noise as measurement noise; command noise and unmodelled acceleration as
process noise, held over a sample), of wind and of offsets.

Method: prediction-error sensitivities through the exact Kalman filter about the
true parameters (Ljung, System Identification, 2nd ed., section 9.4, and Gupta &
Mehra, IEEE TAC 19, 1974), nuisances as states beside the vehicle's.  In calm air the
filter's own start does not matter: an unknown initial offset with a flat prior
added to any finite covariance is a diffuse start, so its four sensitivities join
the two of the parameters and a Schur complement removes them.

With such states the derivative of the filter's covariance for a6 and k1 is carried
too, and what it adds to the Fisher information counted: through the gain's derivative
in the sensitivities, and as tr(S^-1 dS S^-1 dS)/2.  It is first order: a constant
offset that is seen through a6 alone would otherwise seem to shift the angle of attack
while the filter learns it, an excitation that is not there (vega_like, attitude bias
unknown, 10 s: 4.0 % with it, 2.4 % without; greensite_cr826 7 and 3.6 %).

What the size of the wind's response tells of a6 counts only with `levels_known`.  The
wind enters as a6 w: known levels of w make of every gust a measurement of a6 (constant
nominal, 10 s: 9 % instead of 21 %), levels that are to be estimated do not, and so by
default it is the law of the acceleration a6 w that is known, at the true a6.

Limitation: in calm air the information in the innovations' covariance is left out; on
these vehicles it is below 0.1 %.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .flight import Factor, Flight, fly_whole, parameters
from .nominal import Nominal
from .vehicle.kernels import kernel

N_STATES = 4       # theta, theta_dot, beta, beta_dot
N_AUGMENTED = 6    # and the held command and acceleration
N_UNKNOWN = 6      # four initial states, relative a6, relative k1
TAYLOR_ORDER = 12  # |A h| <= 0.6 here: the remainder is below 1e-12
FIRST_ORDER = -1.0  # damping ratio of a servo without a second order, whose frequency is 1/time constant
DIFFUSE = np.array([0.1, 1.0, 0.1, 10.0])  # rad, rad/s, rad, rad/s: all of what small angles hold
# what a further state is
WALK, TURBULENCE, PATH, MISALIGNMENT, MOMENT, ATTITUDE_BIAS, GYRO_BIAS, NOZZLE_BIAS = range(8)
OFFSETS = {"thrust_misalignment": MISALIGNMENT, "moment": MOMENT, "attitude_bias": ATTITUDE_BIAS,
           "gyro_bias": GYRO_BIAS, "nozzle_sensor_bias": NOZZLE_BIAS}


class World(NamedTuple):
    """What is outside the vehicle: r states of its own, what is known of the air, over n rows."""

    role: np.ndarray      # (r,) int64, WALK .. NOZZLE_BIAS
    start: np.ndarray     # (r, n) variance of each before any data, were a window to begin at the row
    fresh: np.ndarray     # (r,) variance that a second adds; of turbulence that a step adds is start (1 - keep^2)
    fade: np.ndarray      # (r,) [s] in which it falls to 1/e; inf: it stays
    air: np.ndarray       # (n,) [rad] known part of the angle of attack beside theta, over the step from the row
    drift: np.ndarray     # (2, n) [1/s] z_alpha, z_beta over the step from the row, of PATH
    gamma: np.ndarray     # (n,) [rad] PATH at the row, where a window begins
    gamma_variance: float  # [rad^2] of the measured flight path, within `air`
    restarts: bool        # a window knows nothing of the data before it
    levels_known: bool    # the size of the wind's response tells of a6


def calm(n: int) -> World:
    """Nothing unknown but the vehicle, n rows."""
    return World(np.zeros(0, np.int64), np.zeros((0, n)), np.zeros(0), np.zeros(0), np.zeros(n), np.zeros((2, n)),
                 np.zeros(n), 0.0, False, False)


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
    if damping == FIRST_ORDER:
        a[2, 2] = -frequency
        a[2, 4] = frequency
    else:
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
def fill(world, f, fa, fk, a6, k1, h, row, full, full_a, full_k, air):
    """The vehicle's and the world's transition over a step, and its derivatives for relative a6 and k1.

    f, fa, fk (6, 6) in     of `transition`
    full, full_a, full_k (n, n) out
    air (3, n)       out    what the known angle of attack does, and its two derivatives
    """
    for i in range(N_STATES):
        for j in range(N_STATES):
            full[i, j], full_a[i, j], full_k[i, j] = f[i, j], a6 * fa[i, j], k1 * fk[i, j]
        air[0, i] = a6 * f[i, 5]
        air[1, i] = a6 * f[i, 5] + a6 * a6 * fa[i, 5]
        air[2, i] = k1 * a6 * fk[i, 5]
    z_alpha, z_beta = world.drift[0, row], world.drift[1, row]
    for j in range(len(world.role)):
        role, c = world.role[j], N_STATES + j
        keep = math.exp(-h / world.fade[j])
        mean = 0.5 * (1.0 + keep)
        push, by_a6, by_k1 = 0.0, 0.0, 0.0
        if role == WALK or role == TURBULENCE:
            push = a6 * mean
            by_a6 = push if world.levels_known else 0.0
        elif role == PATH:
            push = by_a6 = -a6
        elif role == MISALIGNMENT:
            push = by_k1 = k1
        elif role == MOMENT:
            push = 1.0
        for i in range(N_STATES):
            full[i, c] = push * f[i, 5]
            full_a[i, c] = by_a6 * f[i, 5] + push * a6 * fa[i, 5]
            full_k[i, c] = by_k1 * f[i, 5] + push * k1 * fk[i, 5]
        full[c, c] = keep
        if role == PATH:
            full[c, 0], full[c, 1] = h * z_alpha, 0.5 * h * h * z_alpha
            full[c, 2], full[c, 3] = h * z_beta, 0.5 * h * h * z_beta
            full[c, c] = 1.0 - h * z_alpha
            air[0, c] = h * z_alpha
            for k in range(len(world.role)):
                if world.role[k] == WALK or world.role[k] == TURBULENCE:
                    full[c, N_STATES + k] = h * z_alpha
                elif world.role[k] == MISALIGNMENT:
                    full[c, N_STATES + k] = h * z_beta


@kernel
def add_noise(world, f, a6, h, row, noises, p):
    """Adds the process noise of a step to p (n, n), its derivative for relative a6 to the second (2, n, n) of p.

    Of the wind to the leading order in h: theta_ddot = a6 w, w_dot white.
    """
    q, dq = p[0], p[1]
    for i in range(N_STATES):
        for j in range(N_STATES):
            q[i, j] += a6 * a6 * world.gamma_variance * f[i, 5] * f[j, 5]
            dq[i, j] += 2.0 * a6 * a6 * world.gamma_variance * f[i, 5] * f[j, 5]
    for k in range(len(world.role)):
        c = N_STATES + k
        grown = world.fresh[k] * h
        if world.role[k] == TURBULENCE:
            grown = world.start[k, row] * (1.0 - math.exp(-2.0 * h / world.fade[k]))
        if grown == 0.0:
            continue
        once, twice = a6 * a6 * grown * h * h, a6 * grown * h
        q[0, 0] += once * h * h / 20.0
        q[0, 1] += once * h / 8.0
        q[1, 0] += once * h / 8.0
        q[1, 1] += once / 3.0
        q[0, c] += twice * h / 6.0
        q[c, 0] += twice * h / 6.0
        q[1, c] += twice / 2.0
        q[c, 1] += twice / 2.0
        q[c, c] += grown
        if not world.levels_known:
            continue
        dq[0, 0] += once * h * h / 10.0
        dq[0, 1] += once * h / 4.0
        dq[1, 0] += once * h / 4.0
        dq[1, 1] += once / 1.5
        dq[0, c] += twice * h / 6.0
        dq[c, 0] += twice * h / 6.0
        dq[1, c] += twice / 2.0
        dq[c, 1] += twice / 2.0


@kernel
def predict_slopes(p, dp, f, fa, fk, a6, k1, full, full_a, full_k, noises):
    """Time update of dp (2, n, n), the derivatives of the covariance p (n, n) for relative a6 and k1."""
    for m in range(2):
        slope, share, by = (full_a, a6, fa) if m == 0 else (full_k, k1, fk)
        left = slope @ p + 0.5 * (full @ dp[m])
        new = left @ full.T
        for i in range(N_STATES):
            for j in range(N_STATES):
                new[i, j] += share * (by[i, 4] * f[j, 4] * noises[3] + by[i, 5] * f[j, 5] * noises[4])
        dp[m] = new + new.T


@kernel
def predict(x, p, s, dp, u, known, f, fa, fk, a6, k1, full, full_a, full_k, air, noises):
    """Time update of the state x (n,), its covariance p (n, n), the sensitivities s (n, 6) of the one and, beyond the
    vehicle alone, dp (2, n, n) of the other; the world's noise is not in it.

    u [rad]  command;  known [rad]  angle of attack beside theta
    """
    n = len(x)
    new_x, new_s, fp, new_p = np.zeros(n), np.zeros((n, N_UNKNOWN)), np.zeros((n, n)), np.zeros((n, n))
    for i in range(n):
        new_x[i] = air[0, i] * known
        new_s[i, 4] = air[1, i] * known
        new_s[i, 5] = air[2, i] * known
        if i < N_STATES:
            new_x[i] += f[i, 4] * u
            new_s[i, 4] += a6 * fa[i, 4] * u
            new_s[i, 5] += k1 * fk[i, 4] * u
        for k in range(n):
            if full[i, k] == 0.0:
                continue
            new_x[i] += full[i, k] * x[k]
            new_s[i, 4] += full_a[i, k] * x[k]
            new_s[i, 5] += full_k[i, k] * x[k]
            for j in range(N_UNKNOWN):
                new_s[i, j] += full[i, k] * s[k, j]
            for j in range(n):
                fp[i, j] += full[i, k] * p[k, j]
    for i in range(n):
        for j in range(n):
            if i < N_STATES and j < N_STATES:
                new_p[i, j] = f[i, 4] * f[j, 4] * noises[3] + f[i, 5] * f[j, 5] * noises[4]
            for k in range(n):
                new_p[i, j] += fp[i, k] * full[j, k]
    if n > N_STATES:
        new_p = 0.5 * (new_p + new_p.T)  # what is not symmetric no measurement sees, and it grows as the vehicle does
        predict_slopes(p, dp, f, fa, fk, a6, k1, full, full_a, full_k, noises)
    x[:] = new_x
    p[:, :] = new_p
    s[:, :] = new_s


@kernel
def correct_slopes(s, dp, channel, partner, gain, variance, innovation, information):
    """Measurement update of dp (2, n, n), the gain's derivatives into s, and what the variance tells."""
    n = len(gain)
    share = np.zeros(2)
    for m in range(2):
        slope = dp[m, channel].copy()
        if partner >= 0:
            slope += dp[m, partner]
        by = slope[channel] + (slope[partner] if partner >= 0 else 0.0)
        share[m] = by / variance
        for i in range(n):
            s[i, 4 + m] += (slope[i] - gain[i] * by) / variance * innovation
            for j in range(n):
                dp[m, i, j] += by * gain[i] * gain[j] - slope[i] * gain[j] - gain[i] * slope[j]
    for i in range(2):
        for j in range(2):
            information[4 + i, 4 + j] += 0.5 * share[i] * share[j]


@kernel
def correct(x, p, s, dp, channel, partner, z, r, information):
    """Scalar measurement update; adds the innovation's information about the six unknowns.

    partner  the state that is this sensor's offset, -1 for none
    """
    n = len(x)
    column, row, expected = p[channel].copy(), s[channel].copy(), x[channel]
    if partner >= 0:
        column += p[partner]
        row += s[partner]
        expected += x[partner]
    variance = column[channel] + r
    if partner >= 0:
        variance += column[partner]
    innovation = z - expected
    gain = column / variance
    for i in range(N_UNKNOWN):
        for j in range(N_UNKNOWN):
            information[i, j] += row[i] * row[j] / variance
    if n > N_STATES:
        correct_slopes(s, dp, channel, partner, gain, variance, innovation, information)
    for i in range(n):
        x[i] += gain[i] * innovation
        for j in range(N_UNKNOWN):
            s[i, j] -= gain[i] * row[j]
        for j in range(n):
            p[i, j] -= gain[i] * column[j]


@kernel
def start_window(world, row, x, p, s, dp):
    """The sensitivities afresh and, of a window that knows nothing of the data before it, the filter too."""
    s[:, :] = 0.0
    for i in range(N_STATES):
        s[i, i] = 1.0
    if not world.restarts:
        return
    p[:, :] = 0.0
    dp[:, :, :] = 0.0
    for i in range(N_STATES):
        p[i, i] = DIFFUSE[i] * DIFFUSE[i]
    for j in range(len(world.role)):
        c = N_STATES + j
        x[c] = world.gamma[row] if world.role[j] == PATH else 0.0
        p[c, c] = world.start[j, row]


@kernel
def information_in(world, t, z, u, a6, k1, actuator, noises, window_of, information, k1_information):
    """`window_information` in a world."""
    n = N_STATES + len(world.role)
    x, p, s, dp = np.zeros(n), np.zeros((2, n, n)), np.zeros((n, N_UNKNOWN)), np.zeros((2, n, n))
    f, fa, fk = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 6))
    full, full_a, full_k, air = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n)), np.zeros((3, n))
    unused = np.zeros((N_UNKNOWN, N_UNKNOWN))
    channels = (0, 1, 2)
    partner = np.full(3, -1)
    for j in range(len(world.role)):
        if world.role[j] >= ATTITUDE_BIAS:
            partner[world.role[j] - ATTITUDE_BIAS] = N_STATES + j
        x[N_STATES + j] = world.gamma[0] if world.role[j] == PATH else 0.0
        p[0, N_STATES + j, N_STATES + j] = world.start[j, 0]
    for channel in channels:
        x[channel] = z[0, channel]
        p[0, channel, channel] = noises[channel]
        if partner[channel] >= 0:
            p[0, channel, channel] += p[0, partner[channel], partner[channel]]
    current = -1
    for k in range(len(t)):
        if window_of[k] != current:
            current = window_of[k]
            start_window(world, k, x, p[0], s, dp)
        for channel in channels:
            if np.isfinite(z[k, channel]):
                correct(x, p[0], s, dp, channel, partner[channel], z[k, channel], noises[channel],
                        information[current] if current >= 0 else unused)
        k1_information[k] = information[current, 5, 5] if current >= 0 else 0.0
        if k + 1 < len(t):
            h = t[k + 1] - t[k]
            transition(a6[k], k1[k], actuator[0], actuator[1], h, f, fa, fk)
            fill(world, f, fa, fk, a6[k], k1[k], h, k, full, full_a, full_k, air)
            predict(x, p[0], s, dp, u[k], world.air[k], f, fa, fk, a6[k], k1[k], full, full_a, full_k, air, noises)
            p[1] = 0.0
            add_noise(world, f, a6[k], h, k, noises, p)
            dp[0] += p[1]


def window_information(t: np.ndarray, z: np.ndarray, u: np.ndarray, a6: np.ndarray, k1: np.ndarray,
                       actuator: np.ndarray, noises: np.ndarray, window_of: np.ndarray, information: np.ndarray,
                       k1_information: np.ndarray, world: World | None = None) -> None:
    """Information of each window about (initial state, relative a6, relative k1).

    t, u (n,)   [s, rad]  in
    z (n, 3)              in   theta, theta_dot, beta
    a6, k1 (n,) [1/s^2]   in   true, at the middle of the step from each row
    actuator (2,)         in   natural frequency [rad/s], damping ratio; of first order 1/time constant, FIRST_ORDER
    noises (5,)           in   variances: theta, theta_dot, beta, command, acceleration (held over a sample)
    window_of (n,)        in   int64 window of each row, -1 for none
    information (w, 6, 6) out
    k1_information (n,)   out  that of relative k1, the state at the window's start known, by each row
    world                 in   what else is not known; None: nothing
    """
    information_in(calm(len(t)) if world is None else world, t, z, u, a6, k1, actuator, noises, window_of,
                   information, k1_information)


def noise_variances(nominal: Nominal, period: float) -> np.ndarray:
    """Variances (5,) of theta, theta_dot, beta, command, acceleration; held noise keeps its density at `period`."""
    nominal.require("actuator", "controller", "simulation")
    sensors, actuator, simulation = nominal.sensors, nominal.actuator, nominal.simulation
    assert actuator is not None and simulation is not None and nominal.controller is not None
    held = nominal.controller.period / period
    return np.array([sensors.theta_std**2, sensors.theta_dot_std**2, sensors.beta_std**2,
                     actuator.command_noise_std**2 * held, simulation.acceleration_noise_std**2 * held])


def world_of(nominal: Nominal, flight: Flight, restarts: bool = True, path_known: bool = True,
             levels_known: bool = False) -> World:
    """What [wind], [offsets] and [drift] leave open, over a flight's rows; arguments as `flight_information`."""
    t, h = flight.t, flight.period
    n, wind, offsets, drift = len(t), nominal.wind, nominal.offsets, nominal.drift
    seen = nominal.sensors.alpha_source == "air"  # an angle of attack that holds the wind
    states: list[tuple[int, np.ndarray, float, float]] = []
    if wind is not None and not seen:
        if wind.walk > 0.0 or wind.initial > 0.0:
            states.append((WALK, wind.initial**2 + wind.walk**2 * (t - t[0]), wind.walk**2, math.inf))
        if wind.turbulence > 0.0:
            states.append((TURBULENCE, np.full(n, wind.turbulence**2), 0.0, wind.turbulence_time))
    unseen = drift is not None and not path_known
    if unseen:
        states.append((PATH, np.zeros(n), 0.0, math.inf))
    if offsets is not None:
        states += [(role, np.full(n, getattr(offsets, name)**2), 0.0, math.inf) for name, role in OFFSETS.items()
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


def over_steps(value: np.ndarray) -> np.ndarray:
    """Means of a signal over the steps from each row; the last row's own."""
    return 0.5 * (value + np.append(value[1:], value[-1]))


def servo_of(nominal: Nominal) -> np.ndarray:
    """(2,) actuator of `window_information`."""
    actuator = nominal.actuator
    assert actuator is not None
    if actuator.is_first_order:
        return np.array([1.0 / actuator.time_constant, FIRST_ORDER])
    return np.array([actuator.natural_frequency, actuator.damping_ratio])


def acting_command(nominal: Nominal, flight: Flight) -> np.ndarray:
    """Command that acts over the step from each row [rad]: the actuator's delay old, 0 before the first."""
    assert nominal.actuator is not None
    if nominal.actuator.delay == 0.0:
        return flight.beta_cmd
    late = nominal.actuator.delay / flight.period
    whole = math.floor(late)
    past = np.concatenate([np.zeros(whole + 1), flight.beta_cmd])
    newer, older = past[1:len(flight.t) + 1], past[:len(flight.t)]
    return newer + (late - whole) * (older - newer)


def flight_information(nominal: Nominal, window: float, seed: int = 0, period: float | None = None,
                       a6_factor: Factor = 1.0, k1_factor: Factor = 1.0, *, path_known: bool = True,
                       levels_known: bool = False) -> np.ndarray:
    """Information (w, 2, 2) about (relative a6, relative k1) in each window of one flight (`flight` suite).

    nominal  what flies, how noisy it is, and in what air;  window [s];  period [s] of the log, None: sensors.period
    a6_factor, k1_factor  true parameters over the nominal's
    path_known   the log says the flight path of [drift]; else it follows from where it truly is at a window's start
    levels_known  of the wind: how strongly the vehicle answers it tells of a6
    """
    flight = fly_whole(nominal, seed, "flight", period, a6_factor, k1_factor)
    t = flight.t
    middle_a6, middle_k1 = parameters(nominal, t + 0.5 * flight.period, a6_factor, k1_factor)
    index = np.floor(t / window + 1e-9).astype(np.int64)
    windows = math.floor((t[-1] + 1.5 * flight.period) / window)
    index[index >= windows] = -1
    information = np.zeros((windows, N_UNKNOWN, N_UNKNOWN))
    window_information(t, np.column_stack([flight.theta, flight.theta_dot, flight.beta]),
                       acting_command(nominal, flight), middle_a6, middle_k1, servo_of(nominal),
                       noise_variances(nominal, flight.period), index, information, np.zeros(len(t)),
                       world_of(nominal, flight, path_known=path_known, levels_known=levels_known))
    return without_offset(information)


def flight_bound(nominal: Nominal, window: float, seed: int = 0, period: float | None = None,
                 a6_factor: Factor = 1.0, k1_factor: Factor = 1.0, *, path_known: bool = True,
                 levels_known: bool = False) -> Bound:
    """Bound of every window of one flight; arguments as `flight_information`."""
    return bounds_of(flight_information(nominal, window, seed, period, a6_factor, k1_factor, path_known=path_known,
                                        levels_known=levels_known), window)


def known_state_information(nominal: Nominal, flight: Flight, onset: float, a6_factor: Factor = 1.0,
                            k1_factor: Factor = 1.0, horizon: float = 4.0) -> tuple[np.ndarray, np.ndarray]:
    """Information about a relative change of k1 at `onset`, the state before it known, as it grows with time.

    Wind and offsets are known as well as two seconds before tell.

    Returns times [s] of the rows after the onset, up to `horizon` later, and the information (1/relative^2) by then.
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


def without_offset(information: np.ndarray) -> np.ndarray:
    """(w, 2, 2) from (w, 6, 6): the unknown initial state removed by a Schur complement.

    A state of which no measurement says anything (the nozzle's rate behind a first-order servo) drops out.
    """
    nuisance = information[:, :4, :4]
    cross = information[:, :4, 4:]
    scale = np.sqrt(np.einsum("wii->wi", nuisance))
    silent = scale == 0.0
    scale = np.where(silent, 1.0, scale)
    scaled = nuisance / scale[:, :, None] / scale[:, None, :] + silent[:, :, None] * np.eye(4)
    explained = np.einsum("wki,wkj->wij", cross / scale[:, :, None],
                          np.linalg.solve(scaled, cross / scale[:, :, None]))
    return information[:, 4:, 4:] - explained


def bounds_of(information: np.ndarray, window: float) -> Bound:
    """Bounds from information matrices (w, 2, 2) of windows end to end."""
    covariance = np.linalg.inv(information)
    std = np.sqrt(np.einsum("wii->wi", covariance))
    return Bound(np.arange(len(std)) * window, std[:, 0], std[:, 1], covariance[:, 0, 1] / (std[:, 0] * std[:, 1]))
