"""The innovations form: a Kalman predictor of the vehicle with its sensitivities.

State x = (theta, theta_dot, beta, beta_dot), input the actuator's command, process
noise on the command and on the acceleration, held over a sample.  Beside x and
its covariance run

* s, the derivative of the predicted state for an offset at the block's start
  (4 columns) and for each library term of theta_ddot (q columns);
* the derivative of x and of the covariance for the five log noise levels.

The innovation obeys e = H s (p - p_bar) + white noise, a linear regression that
neither the nozzle sensor's noise (errors in variables) nor unmodelled
accelerations (a random walk once integrated) bias.
Sources: Ljung, System Identification, 2nd ed., section 9.4; Gupta & Mehra, IEEE TAC 19, 1974.

Assumption: derivatives of the gain for p are left out (their part in the
innovations is white and second order).
"""

from typing import NamedTuple

import numpy as np

from .belief import A6, AT_BETA, AT_THETA, DAMPING, DELAY, FREQUENCY, K1, MISSING, PERIOD, profile_at
from .kernels import inner, once, shared
from .library import MAX_POWER, N_VARIABLES, library_row
from .memory import take, take2, take3
from .model import N_NOISES

N_STATES = 4
N_CHANNELS = 3  # theta, theta_dot, beta
MAX_DELAY_SAMPLES = 64
TAYLOR_ORDER = 24
UNKNOWN_COMMAND_STD = 0.02      # rad: how far the nozzle may be sent without our knowing, if no command is logged
UNKNOWN_RATE_STD = 1.0          # rad/s, of theta_dot before the first measurement if there is no gyro
START_NOZZLE_RATE_STD = 0.5     # rad/s, of beta_dot at the start of a segment
OUTLIER = 8.0                   # standard deviations of an innovation: beyond it a measurement is left out
MAX_OUTLIERS = 5                # in a row of one channel; then the filter is wrong, not the sensor, and starts afresh
SAME_STEP = 1.0e-6              # relative difference of two time steps that share their constants

# time (f8)
LAST, RUNNING = range(2)  # stamp of the last sample [s]; 1 if there was one in this segment
# note (i8): what the filter did of its own accord since the start
OUTLIERS, RESTARTS, LEVEL_CLAMPS = range(3)
N_NOTES = 3

# step (f8): constants of one time step
STEP = 0
PHI = 1    # 2x2 transition of the nozzle
GAMMA = 5  # 2 effect of the command on it
J1 = 7     # 3: integral of beta over the step, from beta, beta_dot, command
J2 = 10    # 3: double integral
N_STEP = 13


class Filter(NamedTuple):
    """State of the predictor."""

    x: np.ndarray          # (4,) predicted state
    p: np.ndarray          # (4, 4) its covariance
    s: np.ndarray          # (4, 4 + q) sensitivities: offset at the block's start, terms
    p_bar: np.ndarray      # (2,) relative deviations of a6, k1 it is linearised about
    level: np.ndarray      # (5,) log of noise standard deviations over the declared ones
    sx: np.ndarray         # (4, 5) derivative of x for the levels
    sp: np.ndarray         # (5, 4, 4) derivative of p for the levels
    command: np.ndarray    # (MAX_DELAY_SAMPLES,) past commands, newest first
    time: np.ndarray       # (2,) LAST, RUNNING
    step: np.ndarray       # (N_STEP,) constants of the last time step
    cell: np.ndarray       # (1,) int64 cell of the profile
    outliers: np.ndarray   # (3,) int64 measurements in a row that each channel's gate refused
    note: np.ndarray       # (N_NOTES,) int64 counters


class FilterWork(NamedTuple):
    """Scratch of the predictor."""

    transition: np.ndarray  # (4, 4)
    matrix: np.ndarray     # (4, 4)
    column: np.ndarray     # (4,)
    gain: np.ndarray       # (4,)
    slope: np.ndarray      # (4,)
    taylor: np.ndarray     # (2, 5, 5)
    raw: np.ndarray        # (4,)
    powers: np.ndarray     # (4, MAX_POWER + 1)
    row: np.ndarray        # (q,)
    drive: np.ndarray      # (2, q) effect of each term on theta, theta_dot over a step
    out: np.ndarray        # (4 + q,) sensitivities of the last innovation
    de: np.ndarray         # (5,) its derivative for the noise levels
    dv: np.ndarray         # (5,) relative derivative of its variance for them


@shared
def view_filter(f, at, i, m, q):
    """Cut it from floats f at `at` and integers i at `m` for q terms; returns (it, next at, next m)."""
    x, at = take(f, at, N_STATES)
    p, at = take2(f, at, N_STATES, N_STATES)
    s, at = take2(f, at, N_STATES, N_STATES + q)
    p_bar, at = take(f, at, 2)
    level, at = take(f, at, N_NOISES)
    sx, at = take2(f, at, N_STATES, N_NOISES)
    sp, at = take3(f, at, N_NOISES, N_STATES, N_STATES)
    command, at = take(f, at, MAX_DELAY_SAMPLES)
    time, at = take(f, at, 2)
    step, at = take(f, at, N_STEP)
    cell, m = take(i, m, 1)
    outliers, m = take(i, m, N_CHANNELS)
    note, m = take(i, m, N_NOTES)
    return Filter(x, p, s, p_bar, level, sx, sp, command, time, step, cell, outliers, note), at, m


@shared
def view_filter_work(f, at, i, m, q):
    """Cut it from floats f at `at` and integers i at `m` for q terms; returns (it, next at, next m)."""
    transition, at = take2(f, at, N_STATES, N_STATES)
    matrix, at = take2(f, at, N_STATES, N_STATES)
    column, at = take(f, at, N_STATES)
    gain, at = take(f, at, N_STATES)
    slope, at = take(f, at, N_STATES)
    taylor, at = take3(f, at, 2, 5, 5)
    raw, at = take(f, at, N_VARIABLES)
    powers, at = take2(f, at, N_VARIABLES, MAX_POWER + 1)
    row, at = take(f, at, q)
    drive, at = take2(f, at, 2, q)
    out, at = take(f, at, N_STATES + q)
    de, at = take(f, at, N_NOISES)
    dv, at = take(f, at, N_NOISES)
    return FilterWork(transition, matrix, column, gain, slope, taylor, raw, powers, row, drive, out, de, dv), at, m


@once
def set_step(constant, h, work, step):
    """Constants of a time step h [s]: exp of (double integral, integral, beta, beta_dot, u) by its Taylor series.

    Assumption: w h <= 4, where the remainder after TAYLOR_ORDER terms is below 1e-9.
    """
    w, zeta = constant[FREQUENCY], constant[DAMPING]
    term, total = work.taylor[0], work.taylor[1]
    for i in range(5):
        for j in range(5):
            term[i, j] = 1.0 if i == j else 0.0
            total[i, j] = term[i, j]
    for order in range(1, TAYLOR_ORDER + 1):
        scale = h / order
        for j in range(5):
            y1, y2, y3, y4 = term[1, j], term[2, j], term[3, j], term[4, j]
            term[0, j] = scale * y1
            term[1, j] = scale * y2
            term[2, j] = scale * y3
            term[3, j] = scale * (w * w * (y4 - y2) - 2.0 * zeta * w * y3)
            term[4, j] = 0.0
            for i in range(5):
                total[i, j] += term[i, j]
    step[STEP] = h
    step[PHI] = total[2, 2]
    step[PHI + 1] = total[2, 3]
    step[PHI + 2] = total[3, 2]
    step[PHI + 3] = total[3, 3]
    step[GAMMA] = total[2, 4]
    step[GAMMA + 1] = total[3, 4]
    for j in range(3):
        step[J1 + j] = total[1, 2 + j]
        step[J2 + j] = total[0, 2 + j]


@once
def start_segment(belief, fil, t, theta, theta_dot, beta):
    """Begin at a sample with nothing known of before: state from it, sensitivities afresh."""
    fil.x[0] = theta
    fil.x[1] = 0.0 if np.isnan(theta_dot) else theta_dot
    fil.x[2] = beta
    fil.x[3] = 0.0
    fil.p[:, :] = 0.0
    fil.sx[:, :] = 0.0
    fil.sp[:, :, :] = 0.0
    fil.s[:, :] = 0.0
    for i in range(N_CHANNELS):
        variance = belief.variance[i] * np.exp(2.0 * fil.level[i])
        fil.p[i, i] = variance
        fil.sp[i, i, i] = 2.0 * variance
    if np.isnan(theta_dot):
        fil.p[1, 1] = UNKNOWN_RATE_STD * UNKNOWN_RATE_STD
        fil.sp[1, 1, 1] = 0.0
    fil.p[3, 3] = START_NOZZLE_RATE_STD * START_NOZZLE_RATE_STD
    for i in range(N_STATES):
        fil.s[i, i] = 1.0
    fil.command[:] = np.nan
    fil.outliers[:] = 0
    fil.time[LAST] = t
    fil.time[RUNNING] = 1.0


@once
def delayed_input(constant, fil):
    """Command that acts over the coming step: `delay` old, linear between samples; NaN if not logged."""
    steps = constant[DELAY] / constant[PERIOD]
    whole = int(steps)
    share = steps - whole
    newer = fil.command[min(whole, MAX_DELAY_SAMPLES - 1)]
    if share == 0.0:
        return newer
    return (1.0 - share) * newer + share * fil.command[min(whole + 1, MAX_DELAY_SAMPLES - 1)]


@once
def take_command(constant, fil, command):
    """Shift a command into the history (only as far as the delay needs)."""
    depth = min(int(constant[DELAY] / constant[PERIOD]) + 1, MAX_DELAY_SAMPLES - 1)
    for k in range(depth, 0, -1):
        fil.command[k] = fil.command[k - 1]
    fil.command[0] = command


@once
def drive_terms(belief, fil, work, a6, k1, u):
    """Effect of a unit of each term's coefficient on theta and theta_dot over the step.

    For theta and beta the unit is the nominal's own a6, k1 (a relative deviation).
    """
    h = fil.step[STEP]
    x = fil.x
    for v in range(3):
        work.raw[v] = x[v]
    work.raw[0] += 0.5 * h * x[1]
    work.raw[2] += 0.5 * h * x[3]
    work.raw[3] = 0.0
    library_row(belief.codes, work.raw, work.raw, work.powers, work.row)
    for j in range(belief.codes.shape[0]):
        work.drive[0, j] = 0.5 * h * h * work.row[j]
        work.drive[1, j] = h * work.row[j]
    theta, beta = belief.term[AT_THETA], belief.term[AT_BETA]
    work.drive[0, theta] = a6 * h * h * (0.5 * x[0] + h / 6.0 * x[1])
    work.drive[1, theta] = a6 * h * (x[0] + 0.5 * h * x[1])
    work.drive[0, beta] = k1 * (fil.step[J2] * x[2] + fil.step[J2 + 1] * x[3] + fil.step[J2 + 2] * u)
    work.drive[1, beta] = k1 * (fil.step[J1] * x[2] + fil.step[J1 + 1] * x[3] + fil.step[J1 + 2] * u)


@once
def fill_transition(fil, f, a6, k1):
    """Transition matrix of the step.  Left out: a6 h^2/6 of the nozzle's effect on the attitude, 3e-5 of k1 here."""
    h = fil.step[STEP]
    c = 1.0 + 0.5 * a6 * h * h
    s = h + a6 * h * h * h / 6.0
    f[0, 0], f[0, 1] = c, s
    f[1, 0], f[1, 1] = a6 * s, c
    f[0, 2], f[0, 3] = k1 * fil.step[J2], k1 * fil.step[J2 + 1]
    f[1, 2], f[1, 3] = k1 * fil.step[J1], k1 * fil.step[J1 + 1]
    f[2, 2], f[2, 3] = fil.step[PHI], fil.step[PHI + 1]
    f[3, 2], f[3, 3] = fil.step[PHI + 2], fil.step[PHI + 3]


@inner
def congruence(f, p, work):
    """p <- F p F' for symmetric p, F block upper triangular (its lower left 2x2 is zero)."""
    m = work
    for j in range(N_STATES):
        m[0, j] = f[0, 0] * p[0, j] + f[0, 1] * p[1, j] + f[0, 2] * p[2, j] + f[0, 3] * p[3, j]
        m[1, j] = f[1, 0] * p[0, j] + f[1, 1] * p[1, j] + f[1, 2] * p[2, j] + f[1, 3] * p[3, j]
        m[2, j] = f[2, 2] * p[2, j] + f[2, 3] * p[3, j]
        m[3, j] = f[3, 2] * p[2, j] + f[3, 3] * p[3, j]
    for i in range(N_STATES):
        p[i, 0] = m[i, 0] * f[0, 0] + m[i, 1] * f[0, 1] + m[i, 2] * f[0, 2] + m[i, 3] * f[0, 3]
        p[i, 1] = m[i, 0] * f[1, 0] + m[i, 1] * f[1, 1] + m[i, 2] * f[1, 2] + m[i, 3] * f[1, 3]
        p[i, 2] = m[i, 2] * f[2, 2] + m[i, 3] * f[2, 3]
        p[i, 3] = m[i, 2] * f[3, 2] + m[i, 3] * f[3, 3]


@inner
def carry(f, s):
    """s <- F s, column by column.  s (4, n) inout."""
    for j in range(s.shape[1]):
        y0, y1, y2, y3 = s[0, j], s[1, j], s[2, j], s[3, j]
        s[0, j] = f[0, 0] * y0 + f[0, 1] * y1 + f[0, 2] * y2 + f[0, 3] * y3
        s[1, j] = f[1, 0] * y0 + f[1, 1] * y1 + f[1, 2] * y2 + f[1, 3] * y3
        s[2, j] = f[2, 2] * y2 + f[2, 3] * y3
        s[3, j] = f[3, 2] * y2 + f[3, 3] * y3


@inner
def predict(belief, fil, work, t, command):
    """Time update from the last stamp to t [s], whose sample has `command` [rad].

    Of samples slower than the controller the commands between are not known.  The last one is taken as held; for the
    share of the step in which it may not be, it is uncertain by its whole change.
    """
    h = t - fil.time[LAST]
    if abs(h - fil.step[STEP]) > SAME_STEP * h:
        set_step(belief.constant, h, work, fil.step)
    a6, k1 = profile_at(belief, fil.cell, fil.time[LAST] + 0.5 * h)
    u = delayed_input(belief.constant, fil)
    command_variance = belief.variance[3] * np.exp(2.0 * fil.level[3])
    if np.isnan(u):
        u = fil.x[2]
        command_variance = UNKNOWN_COMMAND_STD * UNKNOWN_COMMAND_STD
    elif belief.constant[MISSING] > 0.0 and np.isfinite(command):
        change = belief.constant[MISSING] * (command - fil.command[0])
        command_variance += change * change
    drive_terms(belief, fil, work, a6, k1, u)
    a6 *= 1.0 + fil.p_bar[A6]
    k1 *= 1.0 + fil.p_bar[K1]
    f = work.transition
    fill_transition(fil, f, a6, k1)
    x = fil.x
    y0, y1, y2, y3 = x[0], x[1], x[2], x[3]
    b0, b1, b2, b3 = k1 * fil.step[J2 + 2], k1 * fil.step[J1 + 2], fil.step[GAMMA], fil.step[GAMMA + 1]
    x[0] = f[0, 0] * y0 + f[0, 1] * y1 + f[0, 2] * y2 + f[0, 3] * y3 + b0 * u
    x[1] = f[1, 0] * y0 + f[1, 1] * y1 + f[1, 2] * y2 + f[1, 3] * y3 + b1 * u
    x[2] = f[2, 2] * y2 + f[2, 3] * y3 + b2 * u
    x[3] = f[3, 2] * y2 + f[3, 3] * y3 + b3 * u
    carry(f, fil.s)
    for j in range(belief.codes.shape[0]):
        fil.s[0, N_STATES + j] += work.drive[0, j]
        fil.s[1, N_STATES + j] += work.drive[1, j]
    carry(f, fil.sx)
    congruence(f, fil.p, work.matrix)
    for k in range(N_NOISES):
        congruence(f, fil.sp[k], work.matrix)
    add_process_noise(fil, b0, b1, b2, b3, command_variance, belief.variance[4] * np.exp(2.0 * fil.level[4]))
    fil.time[LAST] = t


@once
def add_process_noise(fil, b0, b1, b2, b3, command_variance, acceleration_variance):
    """Process noise of one step into the covariance and its derivative for the two process levels."""
    h = fil.step[STEP]
    b = (b0, b1, b2, b3)
    w = (0.5 * h * h, h)
    for i in range(N_STATES):
        for j in range(N_STATES):
            q = b[i] * b[j] * command_variance
            fil.p[i, j] += q
            fil.sp[3, i, j] += 2.0 * q
    for i in range(2):
        for j in range(2):
            q = w[i] * w[j] * acceleration_variance
            fil.p[i, j] += q
            fil.sp[4, i, j] += 2.0 * q


@once
def is_outlier(fil, channel, z, r):
    """Whether a measurement lies so far off that it is left out (the channel's count follows)."""
    e = z - fil.x[channel]
    outlier = e * e > OUTLIER * OUTLIER * (fil.p[channel, channel] + r)
    fil.outliers[channel] = fil.outliers[channel] + 1 if outlier else 0
    fil.note[OUTLIERS] += int(outlier)
    return outlier


@inner
def begins_anew(fil, t, max_gap):
    """Whether a sample at t [s] begins a segment: the first, after a gap, or as the filter has lost the sensors."""
    lost = max(fil.outliers[0], fil.outliers[1], fil.outliers[2]) >= MAX_OUTLIERS
    return lost or fil.time[RUNNING] == 0.0 or not 0.0 < t - fil.time[LAST] <= max_gap


@once
def correct_level(fil, work, k, channel, ds, e, variance):
    """Derivative of one measurement update for noise level k: dK = (dP h - K dS)/S and what follows from it."""
    sp = fil.sp[k]
    for i in range(N_STATES):
        work.slope[i] = (sp[i, channel] - work.gain[i] * ds) / variance
        fil.sx[i, k] += work.slope[i] * e + work.gain[i] * work.de[k]
    y0, y1, y2, y3 = sp[channel, 0], sp[channel, 1], sp[channel, 2], sp[channel, 3]
    for i in range(N_STATES):
        g, d = work.gain[i], work.slope[i]
        sp[i, 0] -= d * work.column[0] + g * y0
        sp[i, 1] -= d * work.column[1] + g * y1
        sp[i, 2] -= d * work.column[2] + g * y2
        sp[i, 3] -= d * work.column[3] + g * y3


@inner
def correct(fil, work, channel, z, r, score, information):
    """Scalar measurement update of one channel; returns (innovation, its variance), sensitivities in work.out.

    score (5,), information (5, 5) inout: Fisher scoring of the log noise levels,
    d ln L = sum (e de/S - (1 - e^2/S) dS/(2 S)), expected information de de'/S + dS dS'/(2 S^2).
    """
    x, p, s = fil.x, fil.p, fil.s
    variance = p[channel, channel] + r
    e = z - x[channel]
    for i in range(N_STATES):
        work.gain[i] = p[i, channel] / variance
        work.column[i] = p[channel, i]
    surplus = 1.0 - e * e / variance
    for k in range(N_NOISES):
        ds = fil.sp[k, channel, channel] + (2.0 * r if k == channel else 0.0)
        work.dv[k] = ds / variance
        work.de[k] = -fil.sx[channel, k]
        score[k] -= e * work.de[k] / variance + 0.5 * surplus * work.dv[k]
        correct_level(fil, work, k, channel, ds, e, variance)
    for k in range(N_NOISES):
        for m in range(N_NOISES):
            information[k, m] += work.de[k] * work.de[m] / variance + 0.5 * work.dv[k] * work.dv[m]
    for j in range(s.shape[1]):
        work.out[j] = s[channel, j]
    for i in range(N_STATES):
        g = work.gain[i]
        x[i] += g * e
        for j in range(s.shape[1]):
            s[i, j] -= g * work.out[j]
        for j in range(N_STATES):
            p[i, j] -= g * work.column[j]
    return e, variance
