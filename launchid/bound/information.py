"""Kalman filter about the true parameters and its sensitivities: Fisher information of each window, bounds from it."""

from dataclasses import dataclass

import numpy as np

from sim.kernels import kernel

from .modes import NO_MODES, Modes
from .step import (
    BY_SERVO_FREQUENCY,
    FIRST_ORDER,
    N_STATES,
    add_noise,
    combine,
    fill,
    multiply,
    transition,
)
from .world import ATTITUDE_BIAS_STATE, PATH_STATE, World, calm, contiguous


@dataclass(frozen=True, eq=False)
class Bound:
    """Cramer-Rao bound in each window of one flight, arrays (windows,): start [s], std of a6 and k1 relative to the
    truth, their correlation; servo (windows, u) std of its u unknown numbers, modes (windows, v) of theirs."""

    t_start: np.ndarray      # s
    a6: np.ndarray           # relative standard deviation
    k1: np.ndarray
    correlation: np.ndarray
    servo: np.ndarray        # (windows, unknown ones): relative frequency, relative damping ratio, delay [s]
    modes: np.ndarray        # (windows, unknown ones): of each mode relative frequency, size, damping ratio


def without_offset(information: np.ndarray, states: int = N_STATES) -> np.ndarray:
    """Return information (w, n - states, n - states) from (w, n, n): the initial state, its first so many, removed
    (Schur complement).

    A state of which no measurement says anything (the nozzle's rate behind a first-order servo) drops out.
    """
    nuisance = information[:, :states, :states]
    cross = information[:, :states, states:]
    scale = np.sqrt(np.einsum("wii->wi", nuisance))
    silent = scale == 0.0
    scale = np.where(silent, 1.0, scale)
    scaled = nuisance / scale[:, :, None] / scale[:, None, :] + silent[:, :, None] * np.eye(states)
    explained = np.einsum("wki,wkj->wij", cross / scale[:, :, None],
                          np.linalg.solve(scaled, cross / scale[:, :, None]))
    return information[:, states:, states:] - explained


def with_prior(information: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Add what is known before the flight to information (w, 2 + k, 2 + k) about a6, k1 and k further numbers; return
    (w, 2 + u, 2 + u).

    sigma (k,)  one sigma of the further numbers; u are above 0, those of 0 are known and left out"""
    unknown = np.flatnonzero(sigma > 0.0)
    kept = np.concatenate([[0, 1], 2 + unknown])
    prior = np.diag(np.concatenate([np.zeros(2), sigma[unknown] ** -2.0]))
    return information[:, kept][:, :, kept] + prior


def bounds_of(information: np.ndarray, window: float, modes: int = 0) -> Bound:
    """Return bounds from information (w, n, n) on a6, k1, the servo's unknowns and so many of modes, of w adjoining
    windows of `window` [s]."""
    covariance = np.linalg.inv(information)
    std = np.sqrt(np.einsum("wii->wi", covariance))
    own = std.shape[1] - modes
    return Bound(np.arange(len(std)) * window, std[:, 0], std[:, 1], covariance[:, 0, 1] / (std[:, 0] * std[:, 1]),
                 std[:, 2:own], std[:, own:])


N_CHANNELS = 3     # theta, theta_dot, beta
N_UNKNOWN = 6      # four initial states, relative a6, relative k1
N_SERVO = 3        # relative frequency, relative damping ratio, delay [s]
WITH_SERVO = N_UNKNOWN + N_SERVO   # the delay last: it is in the command alone, and so in no covariance
DIFFUSE = np.array([0.1, 1.0, 0.1, 10.0])  # rad, rad/s, rad, rad/s: all of what small angles hold


@kernel
def predict_slopes(p, dp, f, slopes, value, full, moved, noises):
    """Propagate dp (p, n, n), inout, over a step: the derivatives of covariance p (n, n) for relative a6, k1, servo.

    Products are written out: numba's need scipy, which an installation need not have.
    """
    n, v = len(p), len(f) - 2
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
        for i in range(v):
            for j in range(v):
                new[i, j] += value[m] * (slopes[m, i, v] * f[j, v] * noises[3]
                                         + slopes[m, i, v + 1] * f[j, v + 1] * noises[4])
        combine(0.0, dp[m], 1.0, new)
        combine(1.0, dp[m], 1.0, new.T)


@kernel
def switch_command(s, x, jump, f, slopes, value, frequency, damping):
    """Add to x (n,) and sensitivities s (n, unknowns), after `predict`, the effect of a command that rises by `jump`
    [rad] within the step.

    f (v + 2, v + 2), slopes (p, v + 2, v + 2)   `transition` over the part of the step after the jump, which a longer
                                                 delay shortens
    """
    v = len(f) - 2
    for i in range(v):
        x[i] += f[i, v] * jump
        for m in range(len(value)):
            s[i, v + m] += value[m] * slopes[m, i, v] * jump
        s[i, v + len(value)] -= jump * frequency * (f[i, 2] if damping == FIRST_ORDER else f[i, 3] * frequency)


@kernel
def predict(x, p, s, dp, u, known, f, slopes, value, full, moved, air, noises):
    """Propagate state x (n,), covariance p (n, n), the state's sensitivities s (n, unknowns) and, with further states,
    the covariance's dp (p, n, n) over a step, in place; without the world's noise (`add_noise`).

    u [rad]  command;  known [rad]  angle of attack beside theta
    """
    n, unknowns, v = len(x), s.shape[1], len(f) - 2
    new_x, new_s, fp, new_p = np.zeros(n), np.zeros((n, unknowns)), np.zeros((n, n)), np.zeros((n, n))
    for i in range(n):
        moves = i < v
        new_x[i] = air[0, i] * known + (f[i, v] * u if moves else 0.0)
        for m in range(len(value)):
            new_s[i, v + m] = air[1 + m, i] * known + (value[m] * slopes[m, i, v] * u if moves else 0.0)
        for k in range(n):
            if full[i, k] == 0.0:
                continue
            new_x[i] += full[i, k] * x[k]
            for m in range(len(value)):
                new_s[i, v + m] += moved[m, i, k] * x[k]
            for j in range(unknowns):
                new_s[i, j] += full[i, k] * s[k, j]
            for j in range(n):
                fp[i, j] += full[i, k] * p[k, j]
    for i in range(v):
        for j in range(v):
            new_p[i, j] = f[i, v] * f[j, v] * noises[3] + f[i, v + 1] * f[j, v + 1] * noises[4]
    multiply(fp, full.T, new_p, 1.0)
    if n > v:
        predict_slopes(p, dp, f, slopes, value, full, moved, noises)
    for i in range(n):
        x[i] = new_x[i]
    combine(0.0, s, 1.0, new_s)
    combine(0.0, p, 0.5, new_p)  # what is not symmetric no measurement sees, and it grows as the vehicle does
    combine(1.0, p, 0.5, new_p.T)


@kernel
def correct_slopes(s, dp, first, seen, gain, variance, innovation, information):
    """Correct dp (p, n, n) with a scalar measurement; add the gain's derivatives to s, variance's to information, both
    of the unknowns from `first` on."""
    n = len(gain)
    share, slope = np.zeros(len(dp)), np.zeros(n)
    for m in range(len(dp)):
        slope[:] = 0.0
        by = 0.0
        for k in range(n):
            if seen[k] == 0.0:
                continue
            for i in range(n):
                slope[i] += seen[k] * dp[m, k, i]
        for k in range(n):
            by += seen[k] * slope[k]
        share[m] = by / variance
        for i in range(n):
            s[i, first + m] += (slope[i] - gain[i] * by) / variance * innovation
            for j in range(n):
                dp[m, i, j] += by * gain[i] * gain[j] - slope[i] * gain[j] - gain[i] * slope[j]
    for i in range(len(dp)):
        for j in range(len(dp)):
            information[first + i, first + j] += 0.5 * share[i] * share[j]


@kernel
def correct(x, p, s, dp, states, seen, z, r, information, score):
    """Correct x, p, s, dp with a scalar measurement z of variance r, in place; add to information, score (unknowns,).

    states  of the vehicle, before the world's;  seen (n,)  what the sensor shows of each state
    """
    n, unknowns = len(x), s.shape[1]
    column, row, gain = np.zeros(n), np.zeros(unknowns), np.zeros(n)
    variance, innovation = r, z
    for k in range(n):
        if seen[k] == 0.0:
            continue
        innovation -= seen[k] * x[k]
        for j in range(n):
            column[j] += seen[k] * p[k, j]
        for j in range(unknowns):
            row[j] += seen[k] * s[k, j]
    for k in range(n):
        variance += seen[k] * column[k]
    for j in range(n):
        gain[j] = column[j] / variance
    for i in range(unknowns):
        score[i] += row[i] * innovation / variance
        for j in range(unknowns):
            information[i, j] += row[i] * row[j] / variance
    if n > states:
        correct_slopes(s, dp, states, seen, gain, variance, innovation, information)
    for i in range(n):
        x[i] += gain[i] * innovation
        for j in range(unknowns):
            s[i, j] -= gain[i] * row[j]
        for j in range(n):
            p[i, j] -= gain[i] * column[j]


@kernel
def start_window(world, modes, row, x, p, s, dp):
    """Reset sensitivities s for a new window; where the world restarts, also x's and p's start, and dp to 0.

    A mode has no spread there: its first state is unknown as the others', and how a spread dies away over a window
    that is not much longer than the mode's period would count as information about its frequency.
    """
    v = N_STATES + 2 * len(modes.bends)
    s[:, :] = 0.0
    for i in range(v):
        s[i, i] = 1.0
    if not world.restarts:
        return
    p[:, :] = 0.0
    dp[:, :, :] = 0.0
    for i in range(N_STATES):
        p[i, i] = DIFFUSE[i] * DIFFUSE[i]
    for j in range(len(world.role)):
        c = v + j
        x[c] = world.gamma[row] if world.role[j] == PATH_STATE else 0.0
        p[c, c] = world.start[j, row]


@kernel
def fill_seen(world, modes, seen):
    """Fill seen (3, n): what each sensor shows of each state: its own angle or rate, its offset, bending."""
    v = N_STATES + 2 * len(modes.bends)
    for channel in range(N_CHANNELS):
        seen[channel, channel] = 1.0
    for i in range(len(modes.bends)):
        k = N_STATES + 2 * i
        seen[0, k], seen[1, k + 1] = modes.shown[i, 0], modes.shown[i, 1]
    for j in range(len(world.role)):
        if world.role[j] >= ATTITUDE_BIAS_STATE:
            seen[world.role[j] - ATTITUDE_BIAS_STATE, v + j] = 1.0


@kernel
def information_in(world, modes, t, z, u, newer, switch, a6, k1, actuator, noises, window_of, information, score,
                   k1_information):
    """Fill information, score and k1_information, arguments as `window_information`, world, modes, newer and score
    given."""
    count = len(modes.bends)
    v, unknowns = N_STATES + 2 * count, information.shape[1]
    n = v + len(world.role)
    knows_servo = unknowns == v + 2 + 3 * count
    moving = unknowns - v - (0 if knows_servo else 1)
    x, p, s, dp = np.zeros(n), np.zeros((n, n)), np.zeros((n, unknowns)), np.zeros((moving, n, n))
    f, slopes, value = np.zeros((v + 2, v + 2)), np.zeros((moving, v + 2, v + 2)), np.zeros(moving)
    rest, rest_slopes = np.zeros((v + 2, v + 2)), np.zeros((moving, v + 2, v + 2))
    full, moved, air = np.zeros((n, n)), np.zeros((moving, n, n)), np.zeros((1 + moving, n))
    unused, unscored = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
    seen, values = np.zeros((N_CHANNELS, n)), np.zeros(4 + 3 * count)
    fill_seen(world, modes, seen)
    for j in range(len(world.role)):
        x[v + j] = world.gamma[0] if world.role[j] == PATH_STATE else 0.0
        p[v + j, v + j] = world.start[j, 0]
    for channel in range(N_CHANNELS):
        x[channel] = z[0, channel]
        p[channel, channel] = noises[channel]
        for j in range(v, n):
            p[channel, channel] += seen[channel, j] * p[j, j]
    current = -1
    for k in range(len(t)):
        if window_of[k] != current:
            current = window_of[k]
            start_window(world, modes, k, x, p, s, dp)
        for channel in range(N_CHANNELS):
            if np.isfinite(z[k, channel]):
                correct(x, p, s, dp, v, seen[channel], z[k, channel], noises[channel],
                        information[current] if current >= 0 else unused,
                        score[current] if current >= 0 else unscored)
        k1_information[k] = information[current, v + 1, v + 1] if current >= 0 else 0.0
        if k + 1 < len(t):
            h = t[k + 1] - t[k]
            values[0], values[1], values[2], values[3] = a6[k], k1[k], actuator[0], actuator[1]
            for i in range(count):
                for j in range(3):
                    values[4 + 3 * i + j] = modes.numbers[k, i, j]
            for m in range(moving):
                value[m] = values[m + 2 if knows_servo and m >= BY_SERVO_FREQUENCY else m]
            transition(values, modes.bends, h, f, slopes)
            fill(world, f, slopes, value, h, k, full, moved, air)
            predict(x, p, s, dp, u[k], world.air[k], f, slopes, value, full, moved, air, noises)
            if not knows_servo and h > switch and newer[k] != u[k]:
                transition(values, modes.bends, h - switch, rest, rest_slopes)
                switch_command(s, x, newer[k] - u[k], rest, rest_slopes, value, actuator[0], actuator[1])
            add_noise(world, f, modes.bends, a6[k], h, k, p, dp[0])


def window_information(t: np.ndarray, z: np.ndarray, u: np.ndarray, a6: np.ndarray, k1: np.ndarray,
                       actuator: np.ndarray, noises: np.ndarray, window_of: np.ndarray, information: np.ndarray,
                       k1_information: np.ndarray, world: World | None = None,
                       newer: np.ndarray | None = None, switch: float = 0.0, score: np.ndarray | None = None,
                       modes: Modes = NO_MODES) -> None:
    """Compute the Fisher information of each window about (initial state (4 + 2 m), relative a6, relative k1, of each
    of m modes relative frequency, size, damping ratio) and, if matrices are (w, 9 + 5 m, 9 + 5 m), behind k1 the
    servo's relative frequency and damping ratio, and last its delay [s].

    t, u (n,)   [s, rad]  in     u the command that acts from each row on
    z (n, 3)              in   theta, theta_dot, beta
    a6, k1 (n,) [1/s^2]   in   true, at the middle of the step from each row
    actuator (2,)         in   natural frequency [rad/s], damping ratio; of first order 1/time constant, FIRST_ORDER
    noises (5,)           in   variances: theta, theta_dot, beta, command, acceleration (held over a sample)
    window_of (n,)        in   int64 window of each row, -1 for none
    information (w, 6 + 5 m, 6 + 5 m) or (w, 9 + 5 m, 9 + 5 m) out
    k1_information (n,)   out  that of relative k1, the state at the window's start known, by each row
    world                 in   what else is not known; None: nothing
    modes                 in   slosh and bending
    newer (n,) [rad]      in   with the servo: the command that acts from `switch` [s] after each row on, u until then
    score (w, unknowns)   out  derivative of the log-likelihood, the gain held; 0 on average at the truth
    """
    newer = u if newer is None else newer
    score = np.zeros(information.shape[:2]) if score is None else score
    numbers = np.ascontiguousarray(np.broadcast_to(modes.numbers, (len(t), *modes.numbers.shape[1:])))
    information_in(contiguous(calm(len(t)) if world is None else world), modes._replace(numbers=numbers), t, z, u,
                   newer, switch, a6, k1, actuator, noises, window_of, information, score, k1_information)
