"""The innovations form: a Kalman predictor of the vehicle with its sensitivities.

State x = (theta, theta_dot, beta, beta_dot) and r nuisances: the wind's random walk
and turbulence, thrust misalignment, moment, sensor offsets (`model.WALK` and on);
theta as measured where its bias is one of them (`disturbances`).
Input is the actuator's command, process noise on the command and on the
acceleration, held over a sample.  Beside x (n = 4 + r) and its covariance run

* s, the derivative of the predicted state for an offset at the block's start
  (n columns), for each library term of theta_ddot (q columns), for what is not
  known of the servo (`unknown_servo`) and for what no model has (N_TESTS columns,
  for the check of the model);
* the derivative of x and of the covariance for the L log noise levels.

The innovation obeys e = H s (p - p_bar) + white noise, a linear regression that
neither the nozzle sensor's noise (errors in variables) nor unmodelled
accelerations (a random walk once integrated) bias.
Sources: Ljung, System Identification, 2nd ed., section 9.4; Gupta & Mehra, IEEE TAC 19, 1974.

Assumption: derivatives of the gain for p are left out (their part in the
innovations is white and second order).
"""

import numpy as np

from ..algebra.elementary import exp_of
from ..kernels import inner
from ..model import TURBULENCE
from . import belief as bl
from . import states as sx
from .belief import profile_at
from .disturbances import add_wind, fill_push, follow_path, spread_at
from .servo import SAME_STEP, STEP_PLACE, set_steps
from .transition import (
    add_held_noise,
    add_process_noise,
    advance_state,
    drive_terms,
    drive_tests,
    fill_transition,
    propagate_covariance,
    propagate_sensitivities,
)
from .unknown_servo import acting_commands, add_change, drive_servo

UNKNOWN_COMMAND_STD = 0.02      # rad: how far the nozzle may be sent without our knowing, if no command is logged
JUMP_MEMORY = 1.0               # s: long beside the noise that makes a command jump, short beside a manoeuvre
UNKNOWN_RATE_STD = 1.0          # rad/s, of theta_dot before the first measurement if there is no gyro
START_NOZZLE_RATE_STD = 0.5     # rad/s, of beta_dot at the start of a segment
OUTLIER = 8.0                   # standard deviations of an innovation: beyond it a measurement is left out
MAX_OUTLIERS = 5                # in a row of one channel, for SPIKE_LASTS: then the filter is wrong, and starts afresh
SPIKE_LASTS = 0.05              # s: so long may a sensor's spike last at any rate
SMALL_ANGLE = 0.5               # rad: a flight-path angle beyond it is none of this model's


@inner
def start_segment(belief, fil, t, theta, theta_dot, beta, gamma):
    """Begin at a sample with nothing known of before: state from it, nuisances as declared, sensitivities afresh."""
    n = belief.size.states
    fil.x[:] = 0.0
    fil.x[0] = theta
    fil.x[1] = 0.0 if np.isnan(theta_dot) else theta_dot
    fil.x[2] = beta
    fil.p[:, :] = 0.0
    fil.sx[:, :] = 0.0
    fil.sp[:, :, :] = 0.0
    fil.s[:, :] = 0.0
    if fil.note[sx.SEGMENTS] == 0:
        fil.time[sx.FIRST] = t
    fil.note[sx.SEGMENTS] += 1
    for j in range(n - sx.N_STATES):
        k = sx.N_STATES + j
        fil.p[k, k] = spread_at(belief, fil, j, t)
        if belief.role[j] == TURBULENCE:
            fil.sp[belief.level[j], k, k] = 2.0 * fil.p[k, k]
    for i in range(sx.N_CHANNELS):
        variance = belief.variance[i] * exp_of(2.0 * fil.level[i])
        fil.p[i, i] = variance
        fil.sp[i, i, i] = 2.0 * variance
        k = belief.partner[i]
        if k >= 0:
            fil.p[i, i] += fil.p[k, k]
            fil.p[i, k], fil.p[k, i] = -fil.p[k, k], -fil.p[k, k]
    if np.isnan(theta_dot):
        for k in range(n):
            fil.p[1, k], fil.p[k, 1] = 0.0, 0.0
        fil.p[1, 1] = UNKNOWN_RATE_STD * UNKNOWN_RATE_STD
        if belief.partner[1] >= 0:
            fil.p[belief.partner[1], belief.partner[1]] = spread_at(belief, fil, belief.partner[1] - sx.N_STATES, t)
        fil.sp[1, 1, 1] = 0.0
    fil.p[3, 3] = START_NOZZLE_RATE_STD * START_NOZZLE_RATE_STD
    for i in range(n):
        fil.s[i, i] = 1.0
    if np.isfinite(gamma):
        fil.path[sx.GAMMA_NOW] = gamma
    elif is_lost(belief, fil) and (belief.constant[bl.AIRY] == 0.0 or abs(fil.path[sx.GAMMA_NOW]) > SMALL_ANGLE):
        fil.path[sx.GAMMA_NOW] = 0.0  # the last one measured may be what misled it
    fil.command[:] = np.nan
    fil.outliers[:] = 0
    fil.time[sx.LAST] = t
    fil.time[sx.RUNNING] = 1.0


@inner
def delayed_input(constant, fil):
    """Command that acts over the coming step: `delay` old, linear between samples; NaN if not logged."""
    steps = constant[bl.DELAY] / constant[bl.CONTROLLER_PERIOD]
    whole = int(steps)
    share = steps - whole
    newer = fil.command[min(whole, sx.MAX_DELAY_SAMPLES - 1)]
    if share == 0.0:
        return newer
    return (1.0 - share) * newer + share * fil.command[min(whole + 1, sx.MAX_DELAY_SAMPLES - 1)]


@inner
def take_command(constant, servo, fil, command):
    """Shift a command into the history: only as far as the delay needs, or all of it where it is not known.

    servo  in  how many of the servo's numbers are not
    """
    depth = min(int(constant[bl.DELAY] / constant[bl.CONTROLLER_PERIOD]) + 1, sx.MAX_DELAY_SAMPLES - 1)
    if servo > 0:
        depth = sx.MAX_DELAY_SAMPLES - 1
    for k in range(depth, 0, -1):
        fil.command[k] = fil.command[k - 1]
    fil.command[0] = constant[bl.COMMAND_GAIN] * command + constant[bl.COMMAND_OFFSET]


@inner
def step_input(belief, fil, u):
    """(command that acts over the step [rad], its variance); u the logged one, NaN if it is not known."""
    if np.isnan(u):
        return fil.x[2], UNKNOWN_COMMAND_STD * UNKNOWN_COMMAND_STD
    return u, belief.variance[sx.COMMAND_NOISE] * exp_of(2.0 * fil.level[sx.COMMAND_NOISE])


@inner
def add_missed(belief, fil, k1, command):
    """Process noise of commands that no sample holds, of samples slower than the controller: in the last part of a step
    the command is off the last one by as much as it changes from sample to sample, in the mean of JUMP_MEMORY."""
    if belief.constant[bl.MISSING] == 0.0:
        return
    change = command - fil.command[0]
    if np.isfinite(change):
        share = 1.0 if fil.jump[0] == 0.0 else min(fil.step[STEP_PLACE] / JUMP_MEMORY, 1.0)
        fil.jump[0] += share * (change * change - fil.jump[0])
    add_held_noise(fil.missed, k1, fil.jump[0], fil.p[:])


@inner
def predict(belief, profile, air, fil, work, t, command, gamma):
    """Propagate to t [s]: x = F x + B u, s = F s + drive, P = F P F' + Q.

    command, gamma [rad]  of the sample at t;  of an estimated servo `set_unknown_step` has set the step
    """
    n, h = belief.size.states, t - fil.time[sx.LAST]
    if belief.size.servo == 0 and abs(h - fil.step[STEP_PLACE]) > SAME_STEP * h:
        set_steps(belief, fil, work, belief.constant[bl.FREQUENCY], belief.constant[bl.DAMPING], h)
    a6, k1 = profile_at(profile, fil.time[sx.LAST] + 0.5 * h)
    acting, change = delayed_input(belief.constant, fil), 0.0
    if belief.size.servo > 0:
        acting, change = acting_commands(belief, fil)
    u, command_variance = step_input(belief, fil, acting)
    known_air = follow_path(belief, air, fil, h, gamma)
    drive_terms(belief, fil, work, a6, k1, u, known_air)
    fill_push(belief, a6, k1, work.push)
    acceleration_variance = belief.variance[sx.ACCELERATION_NOISE] * exp_of(2.0 * fil.level[sx.ACCELERATION_NOISE])
    believed_a6, believed_k1 = a6 * (1.0 + fil.p_bar[bl.A6]), k1 * (1.0 + fil.p_bar[bl.K1])
    f, g = work.transition[:], work.transition[:]
    fill_transition(belief, fil, f, believed_a6, believed_k1, work.push)
    gain_k1 = believed_k1
    if belief.constant[bl.HELD] == 1.0:  # P moves with the nominal's F
        g, gain_k1 = work.steady[:], k1
        fill_transition(belief, fil, g, a6, k1, work.push)
    drive_servo(belief, fil, work, believed_k1, u, change)
    known = believed_a6 * known_air + believed_k1 * belief.constant[bl.LEAN]
    advance_state(belief, fil, f, believed_k1, u, known)             # x = F x + B u
    propagate_sensitivities(f, n, fil.s[:], belief.size.sensitivities)   # s = F s + drive
    if belief.size.servo > 0:
        add_change(belief, fil, work, k1, believed_k1, change)
    for j in range(belief.size.terms):
        fil.s[0, n + j] += work.drive[0, j]
        fil.s[1, n + j] += work.drive[1, j]
    drive_tests(belief, fil, work, t - 0.5 * h - fil.time[sx.FIRST])
    propagate_sensitivities(f, n, fil.sx[:], belief.size.levels)
    propagate_covariance(g, n, fil.p[:], work.matrix)   # P = F P F' + Q, and its derivatives for the noise levels
    for k in range(belief.size.levels):
        propagate_covariance(g, n, fil.sp[k], work.matrix)
    add_process_noise(fil, gain_k1, command_variance, acceleration_variance)
    add_missed(belief, fil, gain_k1, command)
    gamma_noise = a6 * belief.constant[bl.GAMMA_STD]
    add_wind(belief, fil, gamma_noise * gamma_noise)
    fil.time[sx.LAST] = t


@inner
def seen_variance(fil, channel, partner):
    """Variance of what a channel shows, without its own noise."""
    variance = fil.p[channel, channel]
    if partner >= 0:
        variance += 2.0 * fil.p[channel, partner] + fil.p[partner, partner]
    return variance


@inner
def innovation(fil, channel, partner, z):
    """A measurement less its prediction."""
    e = z - fil.x[channel]
    if partner >= 0:
        e -= fil.x[partner]
    return e


@inner
def is_lost(belief, fil):
    """Whether so many measurements in a row, over so long a time, were left out that the filter is wrong, not the
    sensor."""
    row = max(fil.outliers[0], fil.outliers[1], fil.outliers[2])
    return row >= MAX_OUTLIERS and (row + 0.5) * belief.constant[bl.CONTROLLER_PERIOD] >= SPIKE_LASTS


@inner
def is_outlier(fil, channel, partner, z, r):
    """Whether a measurement lies so far off that it is left out (the channel's count follows)."""
    e = innovation(fil, channel, partner, z)
    outlier = e * e > OUTLIER * OUTLIER * (seen_variance(fil, channel, partner) + r)
    fil.outliers[channel] = fil.outliers[channel] + 1 if outlier else 0
    fil.note[sx.OUTLIERS] += int(outlier)
    return outlier


@inner
def begins_anew(belief, fil, t, max_gap):
    """Whether a sample at t [s] begins a segment: the first, after a gap, or as the filter has lost the sensors."""
    return is_lost(belief, fil) or fil.time[sx.RUNNING] == 0.0 or not 0.0 < t - fil.time[sx.LAST] <= max_gap


@inner
def apply_h(matrix, channel, partner, shown, m):
    """Compute H M, H being 1 at the channel and at its offset.  shown (m,) out"""
    for j in range(m):
        shown[j] = matrix[channel, j]
    if partner >= 0:
        for j in range(m):
            shown[j] += matrix[partner, j]


@inner
def correct_level(size, fil, work, k, channel, partner, r, e, variance):
    """Derivative of one measurement update for noise level k: dK = (dP h - K dS)/S and what follows from it.

    Uses de[k], gain and column of `work`; dv[k] out.
    """
    sp, n = fil.sp[k], size.states
    y = work.shown[:]
    apply_h(sp, channel, partner, y, n)
    ds = y[channel] + (y[partner] if partner >= 0 else 0.0) + (2.0 * r if k == channel else 0.0)
    work.dv[k] = ds / variance
    for i in range(n):
        work.slope[i] = (y[i] - work.gain[i] * ds) / variance
        fil.sx[i, k] += work.slope[i] * e + work.gain[i] * work.de[k]
    for i in range(n):
        g, d = work.gain[i], work.slope[i]
        for j in range(n):
            sp[i, j] -= d * work.column[j] + g * y[j]


@inner
def correct(size, fil, work, channel, partner, z, r, score, information):
    """Update with one scalar measurement z of noise variance r: e = z - H x, S = H P H' + r, K = P H'/S.

    H is 1 at `channel` and, unless NONE, at `partner`, its sensor's offset.  Returns (e, S); work.out: H s.
    score (L,), information (L, L) inout: Fisher scoring of the log noise levels,
    d ln L = - sum (e de/S + (1 - e^2/S) dS/(2 S)), expected information de de'/S + dS dS'/(2 S^2).
    """
    x, p, s = fil.x, fil.p, fil.s
    n, levels = size.states, size.levels
    variance = seen_variance(fil, channel, partner) + r        # S = H P H' + r
    e = innovation(fil, channel, partner, z)                   # z - H x
    apply_h(p[:], channel, partner, work.column[:], n)         # P H'
    apply_h(s[:], channel, partner, work.out[:], size.sensitivities)   # H s
    if channel == 1:
        work.out[size.sensitivities - sx.N_TESTS + sx.GYRO_TEST] += 1.0
    for i in range(n):
        work.gain[i] = work.column[i] / variance               # K
    surplus = 1.0 - e * e / variance
    for k in range(levels):
        work.de[k] = -fil.sx[channel, k]
        if partner >= 0:
            work.de[k] -= fil.sx[partner, k]
        correct_level(size, fil, work, k, channel, partner, r, e, variance)
        score[k] -= e * work.de[k] / variance + 0.5 * surplus * work.dv[k]
    for k in range(levels):
        for m in range(levels):
            information[k, m] += work.de[k] * work.de[m] / variance + 0.5 * work.dv[k] * work.dv[m]
    for i in range(n):  # x <- x + K e,  s <- s - K H s,  P <- P - K (P H')'
        g = work.gain[i]
        x[i] += g * e
        for j in range(size.sensitivities):
            s[i, j] -= g * work.out[j]
        for j in range(n):
            p[i, j] -= g * work.column[j]
    return e, variance
