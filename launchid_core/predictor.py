"""The innovations form: a Kalman predictor of the vehicle with its sensitivities.

State x = (theta, theta_dot, beta, beta_dot) and r nuisances: the wind's random walk
and turbulence, thrust misalignment, moment, sensor offsets (`model.WALK` and on).
Input is the actuator's command, process noise on the command and on the
acceleration, held over a sample.  Beside x (n = 4 + r) and its covariance run

* s, the derivative of the predicted state for an offset at the block's start
  (n columns), for each library term of theta_ddot (q columns) and for what no
  model has (N_TESTS columns, for the check of the model);
* the derivative of x and of the covariance for the L log noise levels.

What is not known of the wind, w, is an acceleration a6_nominal w, and the gains of
a model with wind levels are those of its nominal: whitening that moves with a6 would
want the log-determinant in the fit of a6.

The innovation obeys e = H s (p - p_bar) + white noise, a linear regression that
neither the nozzle sensor's noise (errors in variables) nor unmodelled
accelerations (a random walk once integrated) bias.
Sources: Ljung, System Identification, 2nd ed., section 9.4; Gupta & Mehra, IEEE TAC 19, 1974.

Assumption: derivatives of the gain for p are left out (their part in the
innovations is white and second order).
"""

from typing import NamedTuple

import numpy as np

from .belief import (
    A6,
    AIR_ALPHA,
    AIR_BETA,
    AIR_WIND,
    AIRY,
    AT_BETA,
    AT_THETA,
    COMMAND_GAIN,
    COMMAND_OFFSET,
    DAMPING,
    DELAY,
    FREQUENCY,
    GAMMA_STD,
    HELD,
    K1,
    LEAN,
    MISSING,
    PERIOD,
    TIME_CONSTANT,
    TURBULENCE_TIME,
    air_at,
    profile_at,
)
from .elementary import exp_of
from .kernels import inner, once, shared
from .library import MAX_POWER, N_VARIABLES, library_row
from .memory import take, take2, take3
from .model import MISALIGNMENT, MOMENT, TURBULENCE, WALK

N_STATES = 4    # of the vehicle
N_CHANNELS = 3  # theta, theta_dot, beta
N_TESTS = 4     # slopes of a6 and k1; what no model has: an acceleration that stays, an offset of the gyro
SLOPE_A6, SLOPE_K1, MOMENT_TEST, GYRO_TEST = range(4)
N_SLOPES = 2
MAX_DELAY_SAMPLES = 64
TAYLOR_ORDER = 12
SCALED = 0.25                   # norm of the matrix whose exponential is summed; the remainder is below 1e-17
MAX_SQUARINGS = 24
UNKNOWN_COMMAND_STD = 0.02      # rad: how far the nozzle may be sent without our knowing, if no command is logged
UNKNOWN_RATE_STD = 1.0          # rad/s, of theta_dot before the first measurement if there is no gyro
START_NOZZLE_RATE_STD = 0.5     # rad/s, of beta_dot at the start of a segment
OUTLIER = 8.0                   # standard deviations of an innovation: beyond it a measurement is left out
MAX_OUTLIERS = 5                # in a row of one channel; then the filter is wrong, not the sensor, and starts afresh
OFFSET_TIME = 6000.0            # s: in it an offset may change by its whole spread, one sigma; by 11 % in 70 s
SMALL_ANGLE = 0.5               # rad: a flight-path angle beyond it is none of this model's
SAME_STEP = 1.0e-6              # relative difference of two time steps that share their constants

# time (f8)
LAST, RUNNING, FIRST = range(3)  # stamp of the last sample [s]; 1 if there was one in this segment; the first of all
N_TIME = 3
# note (i8): what the filter did of its own accord since the start
OUTLIERS, RESTARTS, LEVEL_CLAMPS, SEGMENTS = range(4)
N_NOTES = 4

# step (f8): constants of one time step
STEP = 0
PHI = 1    # 2x2 transition of the nozzle
GAMMA = 5  # 2 effect of the command on it
J1 = 7     # 3: integral of beta over the step, from beta, beta_dot, command
J2 = 10    # 3: double integral
KEEP = 13  # what is left of the turbulence
N_STEP = 14

# path (f8): flight-path angle at the last stamp [rad]
GAMMA_NOW = 0
# process noise beside the levels' (index of the command's and the acceleration's levels)
COMMAND_NOISE, ACCELERATION_NOISE = 3, 4


class Filter(NamedTuple):
    """State of the predictor: n states, L noise levels."""

    x: np.ndarray          # (n,) predicted state
    p: np.ndarray          # (n, n) its covariance
    s: np.ndarray          # (n, n + q + N_TESTS) sensitivities: offset at the block's start, terms, tests
    p_bar: np.ndarray      # (2,) relative deviations of a6, k1 it is linearised about
    level: np.ndarray      # (L,) log of noise standard deviations over the declared ones
    sx: np.ndarray         # (n, L) derivative of x for the levels
    sp: np.ndarray         # (L, n, n) derivative of p for the levels
    command: np.ndarray    # (MAX_DELAY_SAMPLES,) past commands, newest first
    time: np.ndarray       # (N_TIME,) LAST, RUNNING, FIRST
    path: np.ndarray       # (1,) GAMMA_NOW
    step: np.ndarray       # (N_STEP,) constants of the last time step
    cell: np.ndarray       # (1,) int64 cell of the profile
    outliers: np.ndarray   # (3,) int64 measurements in a row that each channel's gate refused
    note: np.ndarray       # (N_NOTES,) int64 counters


class FilterWork(NamedTuple):
    """Scratch of the predictor."""

    transition: np.ndarray  # (n, n) about the parameters believed
    steady: np.ndarray     # (n, n) about the nominal's, for the gains
    matrix: np.ndarray     # (n, n)
    push: np.ndarray       # (r,) acceleration that a unit of each nuisance is
    column: np.ndarray     # (n,)
    gain: np.ndarray       # (n,)
    shown: np.ndarray      # (n,)
    slope: np.ndarray      # (n,)
    taylor: np.ndarray     # (4, 5, 5)
    raw: np.ndarray        # (4,)
    powers: np.ndarray     # (4, MAX_POWER + 1)
    row: np.ndarray        # (q,)
    drive: np.ndarray      # (2, q) effect of each term on theta, theta_dot over a step
    out: np.ndarray        # (n + q + N_TESTS,) sensitivities of the last innovation
    de: np.ndarray         # (L,) its derivative for the noise levels
    dv: np.ndarray         # (L,) relative derivative of its variance for them


@shared
def view_filter(f, at, i, m, q, n, levels):
    """Cut it from floats f at `at` and integers i at `m`: q terms, n states; returns (it, next at, next m)."""
    x, at = take(f, at, n)
    p, at = take2(f, at, n, n)
    s, at = take2(f, at, n, n + q + N_TESTS)
    p_bar, at = take(f, at, 2)
    level, at = take(f, at, levels)
    sx, at = take2(f, at, n, levels)
    sp, at = take3(f, at, levels, n, n)
    command, at = take(f, at, MAX_DELAY_SAMPLES)
    time, at = take(f, at, N_TIME)
    path, at = take(f, at, 1)
    step, at = take(f, at, N_STEP)
    cell, m = take(i, m, 1)
    outliers, m = take(i, m, N_CHANNELS)
    note, m = take(i, m, N_NOTES)
    return Filter(x, p, s, p_bar, level, sx, sp, command, time, path, step, cell, outliers, note), at, m


@shared
def view_filter_work(f, at, i, m, q, n, levels):
    """Cut it from floats f at `at` and integers i at `m`: q terms, n states; returns (it, next at, next m)."""
    transition, at = take2(f, at, n, n)
    steady, at = take2(f, at, n, n)
    matrix, at = take2(f, at, n, n)
    push, at = take(f, at, n - N_STATES)
    column, at = take(f, at, n)
    gain, at = take(f, at, n)
    shown, at = take(f, at, n)
    slope, at = take(f, at, n)
    taylor, at = take3(f, at, 4, 5, 5)
    raw, at = take(f, at, N_VARIABLES)
    powers, at = take2(f, at, N_VARIABLES, MAX_POWER + 1)
    row, at = take(f, at, q)
    drive, at = take2(f, at, 2, q)
    out, at = take(f, at, n + q + N_TESTS)
    de, at = take(f, at, levels)
    dv, at = take(f, at, levels)
    return FilterWork(transition, steady, matrix, push, column, gain, shown, slope, taylor, raw, powers, row, drive,
                      out, de, dv), at, m


@once
def servo_matrix(constant, h, m):
    """Generator times h of (double integral, integral, beta, beta_dot / w, u), the servo's own.  m (5, 5) out.

    beta_dot is divided by w, so that the entries are of one size; of a first-order servo, which has none, it is 0.
    """
    m[:, :] = 0.0
    m[0, 1] = h
    m[1, 2] = h
    if constant[TIME_CONSTANT] > 0.0:
        m[2, 2], m[2, 4] = -h / constant[TIME_CONSTANT], h / constant[TIME_CONSTANT]
        return
    w = constant[FREQUENCY] * h
    m[2, 3] = w
    m[3, 2], m[3, 3], m[3, 4] = -w, -2.0 * constant[DAMPING] * w, w


@inner
def multiply(a, b, out):
    """out (5, 5) = a b."""
    for i in range(5):
        for j in range(5):
            value = 0.0
            for k in range(5):
                value += a[i, k] * b[k, j]
            out[i, j] = value


@once
def exponential(m, total, term, spare):
    """total (5, 5) out: exp(m) by scaling and squaring (Higham, SIAM J. Matrix Anal. 26, 2005); m is overwritten."""
    norm = 0.0
    for i in range(5):
        row = 0.0
        for j in range(5):
            row += abs(m[i, j])
        norm = max(norm, row)
    squarings, scale = 0, 1.0
    for _ in range(MAX_SQUARINGS):
        if norm * scale <= SCALED:
            break
        scale *= 0.5
        squarings += 1
    for i in range(5):
        for j in range(5):
            m[i, j] *= scale
            term[i, j] = 1.0 if i == j else 0.0
            total[i, j] = term[i, j]
    for order in range(1, TAYLOR_ORDER + 1):
        multiply(m, term, spare)
        for i in range(5):
            for j in range(5):
                term[i, j] = spare[i, j] / order
                total[i, j] += term[i, j]
    for _ in range(squarings):
        multiply(total, total, spare)
        for i in range(5):
            for j in range(5):
                total[i, j] = spare[i, j]


@once
def set_step(constant, h, work, step):
    """Constants of a time step h [s]: exp of the servo's generator over it, and the turbulence's decay."""
    m, total, term, spare = work.taylor[0], work.taylor[1], work.taylor[2], work.taylor[3]
    servo_matrix(constant, h, m)
    exponential(m, total, term, spare)
    w = 1.0 if constant[TIME_CONSTANT] > 0.0 else constant[FREQUENCY]
    step[STEP] = h
    step[PHI] = total[2, 2]
    step[PHI + 1] = total[2, 3] / w
    step[PHI + 2] = total[3, 2] * w
    step[PHI + 3] = total[3, 3] if constant[TIME_CONSTANT] == 0.0 else 0.0
    step[GAMMA] = total[2, 4]
    step[GAMMA + 1] = total[3, 4] * w
    for j in range(3):
        scale = 1.0 / w if j == 1 else 1.0
        step[J1 + j] = total[1, 2 + j] * scale
        step[J2 + j] = total[0, 2 + j] * scale
    step[KEEP] = exp_of(-h / constant[TURBULENCE_TIME])


@inner
def spread_at(belief, fil, j, t):
    """Variance of nuisance j at t [s] before any data: a walk has gone on since the first sample."""
    variance = belief.spread[j] * belief.spread[j]
    at = belief.level[j]
    if at < 0:
        return variance
    factor = exp_of(2.0 * fil.level[at])
    if belief.role[j] == WALK:
        return variance + factor * belief.variance[at] * max(t - fil.time[FIRST], 0.0)
    return factor * variance


@inner
def is_lost(fil):
    """Whether so many measurements in a row were left out that the filter is wrong, not the sensor."""
    return max(fil.outliers[0], fil.outliers[1], fil.outliers[2]) >= MAX_OUTLIERS


@once
def start_segment(belief, fil, t, theta, theta_dot, beta, gamma):
    """Begin at a sample with nothing known of before: state from it, nuisances as declared, sensitivities afresh."""
    n = fil.x.shape[0]
    fil.x[:] = 0.0
    fil.x[0] = theta
    fil.x[1] = 0.0 if np.isnan(theta_dot) else theta_dot
    fil.x[2] = beta
    fil.p[:, :] = 0.0
    fil.sx[:, :] = 0.0
    fil.sp[:, :, :] = 0.0
    fil.s[:, :] = 0.0
    if fil.note[SEGMENTS] == 0:
        fil.time[FIRST] = t
    fil.note[SEGMENTS] += 1
    for j in range(n - N_STATES):
        k = N_STATES + j
        fil.p[k, k] = spread_at(belief, fil, j, t)
        if belief.role[j] == TURBULENCE:
            fil.sp[belief.level[j], k, k] = 2.0 * fil.p[k, k]
    for i in range(N_CHANNELS):
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
            fil.p[belief.partner[1], belief.partner[1]] = spread_at(belief, fil, belief.partner[1] - N_STATES, t)
        fil.sp[1, 1, 1] = 0.0
    fil.p[3, 3] = START_NOZZLE_RATE_STD * START_NOZZLE_RATE_STD
    for i in range(n):
        fil.s[i, i] = 1.0
    if np.isfinite(gamma):
        fil.path[GAMMA_NOW] = gamma
    elif is_lost(fil) and (belief.constant[AIRY] == 0.0 or abs(fil.path[GAMMA_NOW]) > SMALL_ANGLE):
        fil.path[GAMMA_NOW] = 0.0  # the last one measured may be what misled it
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
    fil.command[0] = constant[COMMAND_GAIN] * command + constant[COMMAND_OFFSET]


@once
def drive_terms(belief, fil, work, a6, k1, u, air):
    """Effect of a unit of each term's coefficient on theta and theta_dot over the step.

    For theta and beta the unit is the nominal's own a6, k1 (a relative deviation); they multiply the angle of attack,
    whose part `air` [rad] is known, and the deflection with the lean that is known.
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
    y0 = x[0] + air
    work.drive[0, theta] = a6 * h * h * (0.5 * y0 + h / 6.0 * x[1])
    work.drive[1, theta] = a6 * h * (y0 + 0.5 * h * x[1])
    lean = belief.constant[LEAN]
    work.drive[0, beta] = k1 * (fil.step[J2] * x[2] + fil.step[J2 + 1] * x[3] + fil.step[J2 + 2] * u
                                + 0.5 * h * h * lean)
    work.drive[1, beta] = k1 * (fil.step[J1] * x[2] + fil.step[J1 + 1] * x[3] + fil.step[J1 + 2] * u + h * lean)


@once
def fill_push(belief, a6, k1, push):
    """Acceleration that a unit of each nuisance is, with the nominal's a6 and k1.  push (r,) out."""
    for j in range(push.shape[0]):
        role = belief.role[j]
        push[j] = 0.0
        if role == WALK or role == TURBULENCE:
            push[j] = a6
        elif role == MISALIGNMENT:
            push[j] = k1
        elif role == MOMENT:
            push[j] = 1.0


@inner
def fill_transition(fil, f, a6, k1, role, push):
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
    for j in range(push.shape[0]):
        f[0, N_STATES + j], f[1, N_STATES + j] = 0.5 * h * h * push[j], h * push[j]
        f[N_STATES + j, N_STATES + j] = fil.step[KEEP] if role[j] == TURBULENCE else 1.0


@inner
def congruence(f, p, work):
    """p <- F p F' for symmetric p (n, n); F is block upper triangular, diagonal in the nuisances."""
    m = work
    n = p.shape[0]
    for j in range(n):
        m[0, j] = f[0, 0] * p[0, j] + f[0, 1] * p[1, j] + f[0, 2] * p[2, j] + f[0, 3] * p[3, j]
        m[1, j] = f[1, 0] * p[0, j] + f[1, 1] * p[1, j] + f[1, 2] * p[2, j] + f[1, 3] * p[3, j]
        m[2, j] = f[2, 2] * p[2, j] + f[2, 3] * p[3, j]
        m[3, j] = f[3, 2] * p[2, j] + f[3, 3] * p[3, j]
    for k in range(N_STATES, n):
        for j in range(n):
            m[0, j] += f[0, k] * p[k, j]
            m[1, j] += f[1, k] * p[k, j]
            m[k, j] = f[k, k] * p[k, j]
    for i in range(n):  # the lower triangle, mirrored: what is not symmetric would grow as the vehicle does
        p[i, 0] = m[i, 0] * f[0, 0] + m[i, 1] * f[0, 1] + m[i, 2] * f[0, 2] + m[i, 3] * f[0, 3]
        p[i, 1] = m[i, 0] * f[1, 0] + m[i, 1] * f[1, 1] + m[i, 2] * f[1, 2] + m[i, 3] * f[1, 3]
        p[i, 2] = m[i, 2] * f[2, 2] + m[i, 3] * f[2, 3]
        p[i, 3] = m[i, 2] * f[3, 2] + m[i, 3] * f[3, 3]
        for k in range(N_STATES, n):
            p[i, 0] += m[i, k] * f[0, k]
            p[i, 1] += m[i, k] * f[1, k]
        for k in range(N_STATES, i + 1):
            p[i, k] = m[i, k] * f[k, k]
    for i in range(1, n):
        for j in range(i):
            p[j, i] = p[i, j]


@inner
def carry(f, s):
    """s <- F s, column by column.  s (n, any) inout."""
    n = s.shape[0]
    for j in range(s.shape[1]):
        y0, y1, y2, y3 = s[0, j], s[1, j], s[2, j], s[3, j]
        s[0, j] = f[0, 0] * y0 + f[0, 1] * y1 + f[0, 2] * y2 + f[0, 3] * y3
        s[1, j] = f[1, 0] * y0 + f[1, 1] * y1 + f[1, 2] * y2 + f[1, 3] * y3
        s[2, j] = f[2, 2] * y2 + f[2, 3] * y3
        s[3, j] = f[3, 2] * y2 + f[3, 3] * y3
    for k in range(N_STATES, n):
        for j in range(s.shape[1]):
            s[0, j] += f[0, k] * s[k, j]
            s[1, j] += f[1, k] * s[k, j]
            s[k, j] *= f[k, k]


@inner
def guessed_wind(belief, x):
    """What the filter believes of the wind that is not known beforehand [rad]."""
    wind = 0.0
    for j in range(belief.role.shape[0]):
        if belief.role[j] == WALK or belief.role[j] == TURBULENCE:
            wind += x[N_STATES + j]
    return wind


@once
def follow_path(belief, fil, h, gamma):
    """Flight-path angle over the step: as measured, or by the drift from what the filter believes, or held; returns
    the part of the angle of attack that is known beside theta, forecast - gamma, at the step's middle [rad].

    Left out: what an error of a6 does to gamma through the wind believed.
    """
    before = fil.path[GAMMA_NOW]
    wind = 0.0
    after = before
    if belief.constant[AIRY] == 1.0:
        middle = fil.time[LAST] + 0.5 * h
        wind = air_at(belief.air, AIR_WIND, middle)
        x = fil.x
        alpha = x[0] + 0.5 * h * x[1] - before + wind + guessed_wind(belief, x)
        lean = belief.constant[LEAN]
        for j in range(belief.role.shape[0]):
            if belief.role[j] == MISALIGNMENT:
                lean += x[N_STATES + j]
        after = before + h * (air_at(belief.air, AIR_ALPHA, middle) * alpha
                              + air_at(belief.air, AIR_BETA, middle) * (x[2] + 0.5 * h * x[3] + lean))
    if np.isfinite(gamma):
        after = gamma
    fil.path[GAMMA_NOW] = after
    return wind - 0.5 * (before + after)


@once
def step_input(belief, fil, command):
    """(command that acts over the step [rad], its variance).

    Of samples slower than the controller the commands between are not known.  The last one is taken as held; for the
    share of the step in which it may not be, it is uncertain by its whole change.
    """
    u = delayed_input(belief.constant, fil)
    variance = belief.variance[COMMAND_NOISE] * exp_of(2.0 * fil.level[COMMAND_NOISE])
    if np.isnan(u):
        u = fil.x[2]
        variance = UNKNOWN_COMMAND_STD * UNKNOWN_COMMAND_STD
    elif belief.constant[MISSING] > 0.0 and np.isfinite(command):
        change = belief.constant[MISSING] * (command - fil.command[0])
        variance += change * change
    return u, variance


@inner
def predict(belief, fil, work, t, command, gamma):
    """Time update from the last stamp to t [s], whose sample has `command` [rad] and `gamma` [rad]."""
    h = t - fil.time[LAST]
    if abs(h - fil.step[STEP]) > SAME_STEP * h:
        set_step(belief.constant, h, work, fil.step)
    a6, k1 = profile_at(belief, fil.cell, fil.time[LAST] + 0.5 * h)
    u, command_variance = step_input(belief, fil, command)
    air = follow_path(belief, fil, h, gamma)
    drive_terms(belief, fil, work, a6, k1, u, air)
    fill_push(belief, a6, k1, work.push)
    acceleration_variance = belief.variance[ACCELERATION_NOISE] * exp_of(2.0 * fil.level[ACCELERATION_NOISE])
    believed_a6, believed_k1 = a6 * (1.0 + fil.p_bar[A6]), k1 * (1.0 + fil.p_bar[K1])
    f, g = work.transition, work.transition
    fill_transition(fil, f, believed_a6, believed_k1, belief.role, work.push)
    gain_k1 = believed_k1
    if belief.constant[HELD] == 1.0:
        g, gain_k1 = work.steady, k1
        fill_transition(fil, g, a6, k1, belief.role, work.push)
    known = believed_a6 * air + believed_k1 * belief.constant[LEAN]
    advance_state(fil, f, believed_k1, u, known)
    carry(f, fil.s)
    for j in range(belief.codes.shape[0]):
        fil.s[0, fil.x.shape[0] + j] += work.drive[0, j]
        fil.s[1, fil.x.shape[0] + j] += work.drive[1, j]
    drive_tests(belief, fil, work, t - 0.5 * h - fil.time[FIRST])
    carry(f, fil.sx)
    congruence(g, fil.p, work.matrix)
    for k in range(fil.level.shape[0]):
        congruence(g, fil.sp[k], work.matrix)
    add_process_noise(fil, gain_k1, command_variance, acceleration_variance)
    seen = a6 * belief.constant[GAMMA_STD]
    add_wind(belief, fil, seen * seen)
    fil.time[LAST] = t


@once
def drive_tests(belief, fil, work, age):
    """Effect of the tests' units on theta and theta_dot over the step, `age` [s] after the first sample."""
    h, first = fil.step[STEP], fil.s.shape[1] - N_TESTS
    theta, beta = belief.term[AT_THETA], belief.term[AT_BETA]
    for i in range(2):
        fil.s[i, first + SLOPE_A6] += age * work.drive[i, theta]
        fil.s[i, first + SLOPE_K1] += age * work.drive[i, beta]
    fil.s[0, first + MOMENT_TEST] += 0.5 * h * h
    fil.s[1, first + MOMENT_TEST] += h


@once
def advance_state(fil, f, k1, u, known):
    """x over the step.  u [rad] command, `known` [rad/s^2] acceleration, both held."""
    x, h = fil.x, fil.step[STEP]
    y0, y1, y2, y3 = x[0], x[1], x[2], x[3]
    b0, b1 = k1 * fil.step[J2 + 2], k1 * fil.step[J1 + 2]
    x[0] = f[0, 0] * y0 + f[0, 1] * y1 + f[0, 2] * y2 + f[0, 3] * y3 + b0 * u
    x[1] = f[1, 0] * y0 + f[1, 1] * y1 + f[1, 2] * y2 + f[1, 3] * y3 + b1 * u
    x[2] = f[2, 2] * y2 + f[2, 3] * y3 + fil.step[GAMMA] * u
    x[3] = f[3, 2] * y2 + f[3, 3] * y3 + fil.step[GAMMA + 1] * u
    x[0] += 0.5 * h * h * known
    x[1] += h * known
    for k in range(N_STATES, x.shape[0]):
        x[0] += f[0, k] * x[k]
        x[1] += f[1, k] * x[k]
        x[k] *= f[k, k]


@once
def add_process_noise(fil, k1, command_variance, acceleration_variance):
    """Process noise of one step into the covariance and its derivative for the two process levels."""
    h = fil.step[STEP]
    b = (k1 * fil.step[J2 + 2], k1 * fil.step[J1 + 2], fil.step[GAMMA], fil.step[GAMMA + 1])
    w = (0.5 * h * h, h)
    for i in range(N_STATES):
        for j in range(N_STATES):
            q = b[i] * b[j] * command_variance
            fil.p[i, j] += q
            fil.sp[COMMAND_NOISE, i, j] += 2.0 * q
    for i in range(2):
        for j in range(2):
            q = w[i] * w[j] * acceleration_variance
            fil.p[i, j] += q
            fil.sp[ACCELERATION_NOISE, i, j] += 2.0 * q


@once
def add_wind(belief, fil, gamma_variance):
    """What the wind may have changed over the step, and gamma's noise as an acceleration [rad^2/s^4]."""
    h, keep = fil.step[STEP], fil.step[KEEP]
    for j in range(belief.role.shape[0]):
        k, at = N_STATES + j, belief.level[j]
        if at < 0:
            continue
        q = belief.variance[at] * exp_of(2.0 * fil.level[at])
        q *= h if belief.role[j] == WALK else 1.0 - keep * keep
        fil.p[k, k] += q
        fil.sp[at, k, k] += 2.0 * q
    if gamma_variance > 0.0:
        w = (0.5 * h * h, h)
        for i in range(2):
            for j in range(2):
                fil.p[i, j] += w[i] * w[j] * gamma_variance


@inner
def let_offsets_wander(belief, fil, span):
    """What offsets may have changed in `span` [s], added where a window ends.

    They are constants to a window.  Over a flight no misalignment and no bias is, and a filter that believed so would
    hold on for ever to how an offset and a6 once were related (`OFFSET_TIME`).
    """
    for j in range(belief.role.shape[0]):
        if belief.level[j] < 0:
            fil.p[N_STATES + j, N_STATES + j] += belief.spread[j] * belief.spread[j] * span / OFFSET_TIME


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


@once
def is_outlier(fil, channel, partner, z, r):
    """Whether a measurement lies so far off that it is left out (the channel's count follows)."""
    e = innovation(fil, channel, partner, z)
    outlier = e * e > OUTLIER * OUTLIER * (seen_variance(fil, channel, partner) + r)
    fil.outliers[channel] = fil.outliers[channel] + 1 if outlier else 0
    fil.note[OUTLIERS] += int(outlier)
    return outlier


@inner
def begins_anew(fil, t, max_gap):
    """Whether a sample at t [s] begins a segment: the first, after a gap, or as the filter has lost the sensors."""
    return is_lost(fil) or fil.time[RUNNING] == 0.0 or not 0.0 < t - fil.time[LAST] <= max_gap


@inner
def see(matrix, channel, partner, shown):
    """Row of a matrix (n, m) that a channel shows, its own and its offset's.  shown (m,) out"""
    for j in range(shown.shape[0]):
        shown[j] = matrix[channel, j]
    if partner >= 0:
        for j in range(shown.shape[0]):
            shown[j] += matrix[partner, j]


@once
def correct_level(fil, work, k, channel, partner, r, e, variance):
    """Derivative of one measurement update for noise level k: dK = (dP h - K dS)/S and what follows from it.

    Uses de[k], gain and column of `work`; dv[k] out.
    """
    sp = fil.sp[k]
    n = sp.shape[0]
    y = work.shown
    see(sp, channel, partner, y)
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
def correct(fil, work, channel, partner, z, r, score, information):
    """Scalar measurement update of one channel; returns (innovation, its variance), sensitivities in work.out.

    partner  the state that the channel shows beside its own, or NONE
    score (L,), information (L, L) inout: Fisher scoring of the log noise levels,
    d ln L = sum (e de/S - (1 - e^2/S) dS/(2 S)), expected information de de'/S + dS dS'/(2 S^2).
    """
    x, p, s = fil.x, fil.p, fil.s
    n, levels = x.shape[0], fil.level.shape[0]
    variance = seen_variance(fil, channel, partner) + r
    e = innovation(fil, channel, partner, z)
    see(p, channel, partner, work.column)
    see(s, channel, partner, work.out)
    if channel == 1:
        work.out[s.shape[1] - N_TESTS + GYRO_TEST] += 1.0
    for i in range(n):
        work.gain[i] = work.column[i] / variance
    surplus = 1.0 - e * e / variance
    for k in range(levels):
        work.de[k] = -fil.sx[channel, k]
        if partner >= 0:
            work.de[k] -= fil.sx[partner, k]
        correct_level(fil, work, k, channel, partner, r, e, variance)
        score[k] -= e * work.de[k] / variance + 0.5 * surplus * work.dv[k]
    for k in range(levels):
        for m in range(levels):
            information[k, m] += work.de[k] * work.de[m] / variance + 0.5 * work.dv[k] * work.dv[m]
    for i in range(n):
        g = work.gain[i]
        x[i] += g * e
        for j in range(s.shape[1]):
            s[i, j] -= g * work.out[j]
        for j in range(n):
            p[i, j] -= g * work.column[j]
    return e, variance
