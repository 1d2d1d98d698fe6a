"""Kalman filter about the true parameters and its sensitivities: Fisher information of each window, bounds from it."""

from dataclasses import dataclass

import numpy as np

from sim.kernels import kernel

from .step import FIRST_ORDER, N_STATES, add_noise, combine, fill, multiply, transition
from .world import ATTITUDE_BIAS_STATE, PATH_STATE, World, calm, contiguous


@dataclass(frozen=True, eq=False)
class Bound:
    """Cramer-Rao bound in each window of one flight, arrays (windows,): start [s], std of a6 and k1 relative to the
    truth, their correlation; servo (windows, u) std of its u unknown numbers."""

    t_start: np.ndarray      # s
    a6: np.ndarray           # relative standard deviation
    k1: np.ndarray
    correlation: np.ndarray
    servo: np.ndarray        # (windows, unknown ones): relative frequency, relative damping ratio, delay [s]


def without_offset(information: np.ndarray) -> np.ndarray:
    """Return information (w, n - 4, n - 4) from (w, n, n): the initial state, its first four, removed (Schur
    complement).

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


def with_prior(information: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Add the servo's prior to information (w, 5, 5) about a6, k1, servo frequency, damping, delay; return (w, 2 + u, 2
    + u).

    sigma (3,)  one sigma of the servo's three; u are above 0, those of 0 are known and left out"""
    unknown = np.flatnonzero(sigma > 0.0)
    kept = np.concatenate([[0, 1], 2 + unknown])
    prior = np.diag(np.concatenate([np.zeros(2), sigma[unknown] ** -2.0]))
    return information[:, kept][:, :, kept] + prior


def bounds_of(information: np.ndarray, window: float) -> Bound:
    """Return bounds from information (w, n, n) on a6, k1 and servo unknowns, of w adjoining windows of `window` [s]."""
    covariance = np.linalg.inv(information)
    std = np.sqrt(np.einsum("wii->wi", covariance))
    return Bound(np.arange(len(std)) * window, std[:, 0], std[:, 1], covariance[:, 0, 1] / (std[:, 0] * std[:, 1]),
                 std[:, 2:])


N_CHANNELS = 3     # theta, theta_dot, beta
N_UNKNOWN = 6      # four initial states, relative a6, relative k1
WITH_SERVO = 9     # and the servo's relative frequency, relative damping ratio, delay [s]
BY_SERVO_DELAY = 8  # its place among them: it is in the command alone, and so in no covariance
DIFFUSE = np.array([0.1, 1.0, 0.1, 10.0])  # rad, rad/s, rad, rad/s: all of what small angles hold


@kernel
def predict_slopes(p, dp, f, slopes, value, full, moved, noises):
    """Propagate dp (p, n, n), inout, over a step: the derivatives of covariance p (n, n) for relative a6, k1, servo.

    Products are written out: numba's need scipy, which an installation need not have.
    """
    n = len(p)
    left, new = np.zeros((n, n)), np.zeros((n, n))
    for m in range(len(dp)):
        left[:, :] = 0.0
        for i in range(n):
            for k in range(n):
                if full[i, k] == 0.0 and moved[m, i, k] == 0.0:
                    continue
                for j in range(n):
                    left[i, j] += moved[m, i, k] * p[k, j] + 0.5 * full[i, k] * dp[m, k, j]
        multiply(left, full.T, new, 0.0)
        for i in range(N_STATES):
            for j in range(N_STATES):
                new[i, j] += value[m] * (slopes[m, i, 4] * f[j, 4] * noises[3] + slopes[m, i, 5] * f[j, 5] * noises[4])
        combine(0.0, dp[m], 1.0, new)
        combine(1.0, dp[m], 1.0, new.T)


@kernel
def switch_command(s, x, jump, f, slopes, value, frequency, damping):
    """Add to x (n,) and sensitivities s (n, 9), after `predict`, the effect of a command that rises by `jump` [rad]
    within the step.

    f (6, 6), slopes (p, 6, 6)   `transition` over the part of the step after the jump, which a longer delay shortens
    """
    for i in range(N_STATES):
        x[i] += f[i, 4] * jump
        for m in range(len(value)):
            s[i, 4 + m] += value[m] * slopes[m, i, 4] * jump
        s[i, BY_SERVO_DELAY] -= jump * frequency * (f[i, 2] if damping == FIRST_ORDER else f[i, 3] * frequency)


@kernel
def predict(x, p, s, dp, u, known, f, slopes, value, full, moved, air, noises):
    """Propagate state x (n,), covariance p (n, n), the state's sensitivities s (n, unknowns) and, with further states,
    the covariance's dp (p, n, n) over a step, in place; without the world's noise (`add_noise`).

    u [rad]  command;  known [rad]  angle of attack beside theta
    """
    n, unknowns = len(x), s.shape[1]
    new_x, new_s, fp, new_p = np.zeros(n), np.zeros((n, unknowns)), np.zeros((n, n)), np.zeros((n, n))
    for i in range(n):
        moves = i < N_STATES
        new_x[i] = air[0, i] * known + (f[i, 4] * u if moves else 0.0)
        for m in range(len(value)):
            new_s[i, 4 + m] = air[1 + m, i] * known + (value[m] * slopes[m, i, 4] * u if moves else 0.0)
        for k in range(n):
            if full[i, k] == 0.0:
                continue
            new_x[i] += full[i, k] * x[k]
            for m in range(len(value)):
                new_s[i, 4 + m] += moved[m, i, k] * x[k]
            for j in range(unknowns):
                new_s[i, j] += full[i, k] * s[k, j]
            for j in range(n):
                fp[i, j] += full[i, k] * p[k, j]
    for i in range(N_STATES):
        for j in range(N_STATES):
            new_p[i, j] = f[i, 4] * f[j, 4] * noises[3] + f[i, 5] * f[j, 5] * noises[4]
    multiply(fp, full.T, new_p, 1.0)
    if n > N_STATES:
        predict_slopes(p, dp, f, slopes, value, full, moved, noises)
    for i in range(n):
        x[i] = new_x[i]
    combine(0.0, s, 1.0, new_s)
    combine(0.0, p, 0.5, new_p)  # what is not symmetric no measurement sees, and it grows as the vehicle does
    combine(1.0, p, 0.5, new_p.T)


@kernel
def correct_slopes(s, dp, channel, partner, gain, variance, innovation, information):
    """Correct dp (p, n, n) with a scalar measurement; add the gain's derivatives to s, variance's to information."""
    n = len(gain)
    share, slope = np.zeros(len(dp)), np.zeros(n)
    for m in range(len(dp)):
        for i in range(n):
            slope[i] = dp[m, channel, i] + (dp[m, partner, i] if partner >= 0 else 0.0)
        by = slope[channel] + (slope[partner] if partner >= 0 else 0.0)
        share[m] = by / variance
        for i in range(n):
            s[i, 4 + m] += (slope[i] - gain[i] * by) / variance * innovation
            for j in range(n):
                dp[m, i, j] += by * gain[i] * gain[j] - slope[i] * gain[j] - gain[i] * slope[j]
    for i in range(len(dp)):
        for j in range(len(dp)):
            information[4 + i, 4 + j] += 0.5 * share[i] * share[j]


@kernel
def correct(x, p, s, dp, channel, partner, z, r, information, score):
    """Correct x, p, s, dp with a scalar measurement z of variance r, in place; add to information, score (unknowns,).

    channel  the state measured;  partner  the state that is this sensor's offset, -1 for none
    """
    n, column, row, gain = len(x), np.zeros(len(x)), np.zeros(s.shape[1]), np.zeros(len(x))
    for j in range(n):
        column[j] = p[channel, j] + (p[partner, j] if partner >= 0 else 0.0)
    for j in range(len(row)):
        row[j] = s[channel, j] + (s[partner, j] if partner >= 0 else 0.0)
    variance = column[channel] + r + (column[partner] if partner >= 0 else 0.0)
    innovation = z - (x[channel] + (x[partner] if partner >= 0 else 0.0))
    for j in range(n):
        gain[j] = column[j] / variance
    for i in range(len(row)):
        score[i] += row[i] * innovation / variance
        for j in range(len(row)):
            information[i, j] += row[i] * row[j] / variance
    if n > N_STATES:
        correct_slopes(s, dp, channel, partner, gain, variance, innovation, information)
    for i in range(n):
        x[i] += gain[i] * innovation
        for j in range(len(row)):
            s[i, j] -= gain[i] * row[j]
        for j in range(n):
            p[i, j] -= gain[i] * column[j]


@kernel
def start_window(world, row, x, p, s, dp):
    """Reset sensitivities s for a new window; where the world restarts, also x's and p's start, and dp to 0."""
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
        x[c] = world.gamma[row] if world.role[j] == PATH_STATE else 0.0
        p[c, c] = world.start[j, row]


@kernel
def information_in(world, t, z, u, newer, switch, a6, k1, actuator, noises, window_of, information, score,
                   k1_information):
    """Fill information, score and k1_information, arguments as `window_information`, world, newer and score given."""
    n, unknowns = N_STATES + len(world.role), information.shape[1]
    moving = min(unknowns, BY_SERVO_DELAY) - N_STATES
    x, p, s, dp = np.zeros(n), np.zeros((n, n)), np.zeros((n, unknowns)), np.zeros((moving, n, n))
    f, slopes, value = np.zeros((6, 6)), np.zeros((moving, 6, 6)), np.zeros(moving)
    rest, rest_slopes = np.zeros((6, 6)), np.zeros((moving, 6, 6))
    full, moved, air = np.zeros((n, n)), np.zeros((moving, n, n)), np.zeros((1 + moving, n))
    unused, unscored = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    partner = np.zeros(N_CHANNELS, np.int64)
    for channel in range(N_CHANNELS):
        partner[channel] = -1
    for j in range(len(world.role)):
        if world.role[j] >= ATTITUDE_BIAS_STATE:
            partner[world.role[j] - ATTITUDE_BIAS_STATE] = N_STATES + j
        x[N_STATES + j] = world.gamma[0] if world.role[j] == PATH_STATE else 0.0
        p[N_STATES + j, N_STATES + j] = world.start[j, 0]
    for channel in range(N_CHANNELS):
        x[channel] = z[0, channel]
        p[channel, channel] = noises[channel]
        if partner[channel] >= 0:
            p[channel, channel] += p[partner[channel], partner[channel]]
    current = -1
    for k in range(len(t)):
        if window_of[k] != current:
            current = window_of[k]
            start_window(world, k, x, p, s, dp)
        for channel in range(N_CHANNELS):
            if np.isfinite(z[k, channel]):
                correct(x, p, s, dp, channel, partner[channel], z[k, channel], noises[channel],
                        information[current] if current >= 0 else unused,
                        score[current] if current >= 0 else unscored)
        k1_information[k] = information[current, 5, 5] if current >= 0 else 0.0
        if k + 1 < len(t):
            h = t[k + 1] - t[k]
            transition(a6[k], k1[k], actuator[0], actuator[1], h, f, slopes)
            value[0], value[1] = a6[k], k1[k]
            for m in range(2, moving):
                value[m] = actuator[m - 2]
            fill(world, f, slopes, value, h, k, full, moved, air)
            predict(x, p, s, dp, u[k], world.air[k], f, slopes, value, full, moved, air, noises)
            if unknowns > BY_SERVO_DELAY and h > switch and newer[k] != u[k]:
                transition(a6[k], k1[k], actuator[0], actuator[1], h - switch, rest, rest_slopes)
                switch_command(s, x, newer[k] - u[k], rest, rest_slopes, value, actuator[0], actuator[1])
            add_noise(world, f, a6[k], h, k, p, dp[0])


def window_information(t: np.ndarray, z: np.ndarray, u: np.ndarray, a6: np.ndarray, k1: np.ndarray,
                       actuator: np.ndarray, noises: np.ndarray, window_of: np.ndarray, information: np.ndarray,
                       k1_information: np.ndarray, world: World | None = None,
                       newer: np.ndarray | None = None, switch: float = 0.0, score: np.ndarray | None = None) -> None:
    """Compute the Fisher information of each window about (initial state (4), relative a6, relative k1) and, if
    matrices are (w, 9, 9), the servo's (relative frequency, relative damping ratio, delay [s]).

    t, u (n,)   [s, rad]  in     u the command that acts from each row on
    z (n, 3)              in   theta, theta_dot, beta
    a6, k1 (n,) [1/s^2]   in   true, at the middle of the step from each row
    actuator (2,)         in   natural frequency [rad/s], damping ratio; of first order 1/time constant, FIRST_ORDER
    noises (5,)           in   variances: theta, theta_dot, beta, command, acceleration (held over a sample)
    window_of (n,)        in   int64 window of each row, -1 for none
    information (w, 6, 6) or (w, 9, 9) out
    k1_information (n,)   out  that of relative k1, the state at the window's start known, by each row
    world                 in   what else is not known; None: nothing
    newer (n,) [rad]      in   with the servo: the command that acts from `switch` [s] after each row on, u until then
    score (w, unknowns)   out  derivative of the log-likelihood, the gain held; 0 on average at the truth
    """
    newer = u if newer is None else newer
    score = np.zeros(information.shape[:2]) if score is None else score
    information_in(contiguous(calm(len(t)) if world is None else world), t, z, u, newer, switch, a6, k1, actuator,
                   noises, window_of, information, score, k1_information)
