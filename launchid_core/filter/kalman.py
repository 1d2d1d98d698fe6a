"""The innovations form: a Kalman predictor of the vehicle with its sensitivities.

x         state (n,): theta, theta_dot, beta, beta_dot, r nuisances (`model.WALK` and on), modes (`modes`); theta is as
          measured where its bias is one of them (`fill_push`), and less c beta where c beta_ddot turns the vehicle:
          of y = theta - c beta the plant is y_ddot = a6 y + (k1 + a6 c) beta
P         its covariance (n, n);  F  transition over a sample;  K  gain;  S = H P H' + r  variance of an innovation e
s         derivative (n, ...) of the predicted state for an offset at the block's start (n columns), each library term
          of theta_ddot, what is not known of the servo (`servo`), and what no model has (N_TESTS columns)
sx, sp    derivatives of x and P for the log noise levels, of all states but bending: what the levels do to that is left
          out of the score, whose mean is 0 at the true levels with any derivatives
H         1 at the measured channel and at its offset's state, `partner`; what it shows of others: `shown`

The innovation obeys e = H s (p - p_bar) + white noise, a linear regression that neither the nozzle sensor's noise nor
unmodelled accelerations bias: Ljung, System Identification, 2nd ed., section 9.4; Gupta & Mehra, IEEE TAC 19, 1974.
Assumption: derivatives of the gain for p are left out (their part in the innovations is white and second order).
Why wind and attitude bias act by the nominal's a6: docs/method.md, "Wind, offsets, drift".
"""

import numpy as np

from ..algebra.elementary import exp_of
from ..algebra.library import library_column
from ..kernels import inner
from ..model import ATTITUDE_BIAS, MISALIGNMENT, MOMENT, TURBULENCE, WALK
from . import known as kn
from . import modes as md
from . import servo as sv
from . import states as sx

UNKNOWN_COMMAND_STD = 0.02      # rad: how far the nozzle may be sent without our knowing, if no command is logged
JUMP_MEMORY = 1.0               # s: long beside the noise that makes a command jump, short beside a manoeuvre
UNKNOWN_RATE_STD = 1.0          # rad/s, of theta_dot before the first measurement if there is no gyro
START_NOZZLE_RATE_STD = 0.5     # rad/s, of beta_dot at the start of a segment
OUTLIER = 8.0                   # standard deviations of an innovation: beyond it a measurement is left out
MAX_OUTLIERS = 5                # in a row of one channel, for SPIKE_LASTS: then the filter is wrong, and starts afresh
SPIKE_LASTS = 0.05              # s: so long may a sensor's spike last at any rate
SMALL_ANGLE = 0.5               # rad: a flight-path angle beyond it is none of this model's


@inner
def take_off_inertia(fil, inertia, beta):
    """Begin with a state that is theta less what the nozzle's inertia turns it by, at a nozzle angle `beta` [rad]."""
    fil.x[0] -= inertia * beta
    for i in range(2):
        nozzle = fil.p[2 + i, 2 + i]
        fil.p[i, i] += inertia * inertia * nozzle
        fil.p[i, 2 + i] -= inertia * nozzle
        fil.p[2 + i, i] = fil.p[i, 2 + i]


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
    if fil.note.segments == 0:
        fil.time.first = t
    fil.note.segments += 1
    for j in range(belief.size.nuisances):
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
    take_off_inertia(fil, belief.inertia, beta)
    for i in range(n):
        fil.s[i, i] = 1.0
    if np.isfinite(gamma):
        fil.gamma = gamma
    elif is_lost(belief, fil) and (belief.constant.airy == 0.0 or abs(fil.gamma) > SMALL_ANGLE):
        fil.gamma = 0.0  # the last one measured may be what misled it
    fil.command[:] = np.nan
    fil.outliers[:] = 0
    fil.time.last = t
    fil.time.running = 1.0


@inner
def delayed_input(constant, fil):
    """Command that acts over the coming step: `delay` old, linear between samples; NaN if not logged."""
    steps = constant.delay / constant.controller_period
    whole = int(steps)
    share = steps - whole
    newer = fil.command[min(whole, sx.MAX_DELAY_SAMPLES - 1)]
    if share == 0.0:
        return newer
    return (1.0 - share) * newer + share * fil.command[min(whole + 1, sx.MAX_DELAY_SAMPLES - 1)]


@inner
def take_command(belief, known, fil, command):
    """Shift a command into the history, as far as the delay reaches back; all of it where the delay is estimated."""
    constant = belief.constant
    depth = min(int(constant.delay / constant.controller_period) + 1, sx.MAX_DELAY_SAMPLES - 1)
    if belief.size.servo > 0:
        depth = sx.MAX_DELAY_SAMPLES - 1
    for k in range(depth, 0, -1):
        fil.command[k] = fil.command[k - 1]
    fil.command[0] = constant.command_gain * command + constant.command_offset
    if known is not None:
        kn.shape_command(belief, fil)


@inner
def acting_command(belief, fil):
    """Return the command that acts as the step begins [rad], its change within the step (of an estimated servo; NaN:
    not known), and the variance of its noise [rad^2]."""
    constant = belief.constant
    acting, change = delayed_input(constant, fil), 0.0
    if belief.size.servo > 0:
        whole = int(fil.servo.delay / constant.controller_period)
        older = fil.command[min(whole + 1, sx.MAX_DELAY_SAMPLES - 1)]
        change = fil.command[min(whole, sx.MAX_DELAY_SAMPLES - 1)] - older
        acting = older + 0.0 * change
    if np.isnan(acting):  # it is not known
        return fil.x[2], change, UNKNOWN_COMMAND_STD * UNKNOWN_COMMAND_STD
    return acting, change, belief.variance[sx.COMMAND_NOISE] * exp_of(2.0 * fil.level[sx.COMMAND_NOISE])


@inner
def add_drives(belief, fil, work, age):
    """Add to the sensitivities what terms and tests do over the step, its middle `age` [s] after the
    first sample."""
    n, h, reach = belief.size.states, fil.step.h, fil.step.reach
    for j in range(belief.size.terms):
        fil.s[0, n + j] += work.drive[0, j]
        fil.s[1, n + j] += work.drive[1, j]
    test = belief.size.sensitivities - sx.N_TESTS
    for i in range(2):
        fil.s[i, test + sx.SLOPE_A6] += age * work.drive[i, belief.size.theta]
        fil.s[i, test + sx.SLOPE_K1] += age * work.drive[i, belief.size.beta]
    fil.s[0, test + sx.MOMENT_TEST] += 0.5 * h * reach
    fil.s[1, test + sx.MOMENT_TEST] += reach


@inner
def predict(belief, profile, air, modes, known, fil, work, t, command, gamma):
    """Propagate to t [s]: x = F x + B u, s = F s + drive, P = F P F' + Q.

    modes, known          None where the model has none: then nothing of them is compiled
    command, gamma [rad]  of the sample at t;  of an estimated servo `set_servo_step` has set the step
    """
    h, constant = t - fil.time.last, belief.constant
    if belief.size.servo == 0 and abs(h - fil.step.h) > sv.SAME_STEP * h:
        frequency, damping, missing = constant.frequency, constant.damping, constant.missing
        sv.set_step(constant, frequency, damping, h, work, fil.step)
        if missing > 0.0:  # of the last part, in which a command acts that no sample holds
            sv.set_step(constant, frequency, damping, missing * h, work, fil.missed)
    a6, k1 = sx.profile_at(profile, fil.time.last + 0.5 * h)
    u, change, command_variance = acting_command(belief, fil)
    known_air, inertia = follow_path(belief, air, fil, h, gamma), belief.inertia
    drive_terms(belief, fil, work, a6, k1, u, known_air)
    fill_push(belief, a6, k1, work.push)
    believed_a6, believed_k1 = a6 * (1.0 + fil.p_bar[sx.A6]), k1 * (1.0 + fil.p_bar[sx.K1])
    acceleration = believed_a6 * known_air + believed_k1 * constant.lean
    believed_k1 += believed_a6 * inertia  # of theta less what the nozzle's inertia turns it by
    f, g = work.transition[:], work.transition[:]
    fill_transition(belief, fil, f, believed_a6, believed_k1, work.push)
    gain_k1 = believed_k1
    if constant.held == 1.0:  # P moves with the nominal's F
        g, gain_k1 = work.steady[:], k1 + a6 * inertia
        fill_transition(belief, fil, g, a6, gain_k1, work.push)
    if modes is not None:
        md.fill_modes(belief, fil, f)
        if constant.held == 1.0:
            md.fill_modes(belief, fil, g)
        md.drive_numbers(belief, fil, work, u, change)
        md.advance_modes(belief, fil, work, f, u, change)
    sv.drive_servo(belief, fil, work, believed_k1, u, change)
    if known is not None:
        acceleration += kn.known_acceleration(belief, known, fil, work, a6, believed_a6, known_air)
        kn.limit_rate(belief, fil, work, u)
    advance_state(belief, fil, f, believed_k1, u, acceleration)  # x = F x + B u
    if modes is not None:
        md.push_by_slosh(fil, work)
    if known is not None:
        kn.add_limit(belief, fil, work, believed_k1)
        kn.tilt_transitions(belief, fil, work, f, g)
    advance_uncertainty(belief, modes, fil, work, f, g)          # s = F s, P = F P F'
    if belief.size.servo > 0:
        sv.add_change(belief, fil, work, k1, believed_k1, change)
    add_drives(belief, fil, work, t - 0.5 * h - fil.time.first)  # s = s + drive, P = P + Q
    add_process_noise(belief, fil, a6, gain_k1, command_variance, command)
    if modes is not None:
        add_mode_noise(belief, fil, work, gain_k1, command_variance)
    fil.time.last = t


@inner
def is_lost(belief, fil):
    """Whether so many measurements in a row, over so long a time, were left out that the filter is wrong, not the
    sensor."""
    row = max(fil.outliers[0], fil.outliers[1], fil.outliers[2])
    return row >= MAX_OUTLIERS and (row + 0.5) * belief.constant.controller_period >= SPIKE_LASTS


@inner
def begins_anew(belief, fil, t, max_gap):
    """Whether a sample at t [s] begins a segment: the first, after a gap, or as the filter has lost the sensors."""
    return is_lost(belief, fil) or fil.time.running == 0.0 or not 0.0 < t - fil.time.last <= max_gap


@inner
def shown_state(size, channel, place):
    """Return the state that a channel shows in this place: the nozzle's angle or rate, then each bending mode's."""
    return 2 + channel if place == 0 else size.mode_at + 2 * (size.sloshes + place - 1) + channel


@inner
def apply_h(belief, shown, matrix, bendings, channel, out, m):
    """Compute H M, H being 1 at the channel and at its offset, and `shown` elsewhere, of so many bending modes.

    shown (channels, n)  in   what each channel shows of the states; None: of no others
    out (m,)             out
    """
    partner = belief.partner[channel]
    for j in range(m):
        out[j] = matrix[channel, j]
    if partner >= 0:
        for j in range(m):
            out[j] += matrix[partner, j]
    if shown is not None:
        for place in range(1 + bendings if channel < 2 else 0):
            k = shown_state(belief.size, channel, place)
            share = shown[channel, k]
            for j in range(m):
                out[j] += share * matrix[k, j]


@inner
def shown_of(belief, shown, y, bendings, channel):
    """Return H y of a vector y, as `apply_h`."""
    partner = belief.partner[channel]
    total = y[channel] + (y[partner] if partner >= 0 else 0.0)
    if shown is not None:
        for place in range(1 + bendings if channel < 2 else 0):
            k = shown_state(belief.size, channel, place)
            total += shown[channel, k] * y[k]
    return total


@inner
def correct_level(belief, shown, fil, work, k, channel, r, e, variance):
    """Derivative of one measurement update for noise level k: dK = (dP h - K dS)/S and what follows from it.

    Uses de[k], gain and column of `work`; dv[k] out.
    """
    sp, n = fil.sp[k], belief.size.acting
    y = work.shown[:]
    apply_h(belief, shown, sp, 0, channel, y, n)
    ds = shown_of(belief, shown, y, 0, channel) + (2.0 * r if k == channel else 0.0)
    work.dv[k] = ds / variance
    for i in range(n):
        work.slope[i] = (y[i] - work.gain[i] * ds) / variance
        fil.sx[i, k] += work.slope[i] * e + work.gain[i] * work.de[k]
    for i in range(n):
        g, d = work.gain[i], work.slope[i]
        for j in range(n):
            sp[i, j] -= d * work.column[j] + g * y[j]


@inner
def correct(belief, shown, fil, work, channel, e, variance, r, score, information):
    """Update with one scalar measurement of noise variance r: e = z - H x, S = H P H' + r (`variance`), K = P H'/S.

    work.column, work.out  in  P H', H s
    score (L,), information (L, L) inout: Fisher scoring of the log noise levels,
    d ln L = - sum (e de/S + (1 - e^2/S) dS/(2 S)), expected information de de'/S + dS dS'/(2 S^2).
    """
    x, p, s, size = fil.x, fil.p, fil.s, belief.size
    n, levels = size.states, size.levels
    if channel == 1:
        work.out[size.sensitivities - sx.N_TESTS + sx.GYRO_TEST] += 1.0
    for i in range(n):
        work.gain[i] = work.column[i] / variance               # K
    surplus = 1.0 - e * e / variance
    apply_h(belief, shown, fil.sx[:], 0, channel, work.seen[:], levels)
    for k in range(levels):
        work.de[k] = -work.seen[k]
        correct_level(belief, shown, fil, work, k, channel, r, e, variance)
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


@inner
def spread_at(belief, fil, j, t):
    """Return the variance of nuisance j at t [s] as declared, before any data; a walk's grows from the first sample."""
    variance = belief.spread[j] * belief.spread[j]
    at = belief.level[j]
    if at < 0:
        return variance
    factor = exp_of(2.0 * fil.level[at])
    if belief.role[j] == WALK:
        return variance + factor * belief.variance[at] * max(t - fil.time.first, 0.0)
    return factor * variance


@inner
def fill_push(belief, a6, k1, push):
    """Acceleration that a unit of each nuisance is, with the nominal's a6 and k1.  push (r,) out."""
    for j in range(belief.size.nuisances):
        role = belief.role[j]
        push[j] = 0.0
        if role == WALK or role == TURBULENCE:
            push[j] = a6
        elif role == MISALIGNMENT:
            push[j] = k1
        elif role == MOMENT:
            push[j] = 1.0
        elif role == ATTITUDE_BIAS:
            push[j] = -a6


@inner
def follow_path(belief, air, fil, h, gamma):
    """Flight-path angle over the step: as measured, or by the drift from what the filter believes, or held; returns
    the part of the angle of attack that is known beside theta, forecast - gamma, at the step's middle [rad].

    Left out: what an error of a6 does to gamma through the wind believed.
    """
    before = fil.gamma
    wind = 0.0
    after = before
    if belief.constant.airy == 1.0:
        middle = fil.time.last + 0.5 * h
        wind = sx.air_at(air, sx.AIR_WIND, middle)
        x = fil.x
        guessed, lean = 0.0, belief.constant.lean  # wind that is not known beforehand, less a bias of theta
        for j in range(belief.size.nuisances):
            role, nuisance = belief.role[j], x[sx.N_STATES + j]
            if role == WALK or role == TURBULENCE:
                guessed += nuisance
            elif role == ATTITUDE_BIAS:
                guessed -= nuisance
            elif role == MISALIGNMENT:
                lean += nuisance
        alpha = x[0] + belief.inertia * x[2] + 0.5 * h * x[1] - before + wind + guessed
        after = before + h * (sx.air_at(air, sx.AIR_ALPHA, middle) * alpha
                              + sx.air_at(air, sx.AIR_BETA, middle) * (x[2] + 0.5 * h * x[3] + lean))
    if np.isfinite(gamma):
        after = gamma
    fil.gamma = after
    return wind - 0.5 * (before + after)


@inner
def drive_terms(belief, fil, work, a6, k1, u, air):
    """Effect of a unit of each term's coefficient on theta and theta_dot over the step.

    For theta and beta the unit is the nominal's own a6, k1 (a relative deviation); they multiply the angle of attack,
    whose part `air` [rad] is known, and the deflection with the lean that is known.
    """
    h, reach = fil.step.h, fil.step.reach
    x = fil.x
    work.raw[0, 0], work.raw[1, 0], work.raw[2, 0] = x[0] + 0.5 * h * x[1], x[1], x[2] + 0.5 * h * x[3]
    for j in range(belief.size.terms):
        library_column(belief.codes[j], work.raw[:], work.raw[belief.codes[j, 5]], 1, work.value[:])
        work.drive[0, j] = 0.5 * h * reach * work.value[0]
        work.drive[1, j] = reach * work.value[0]
    theta, beta = belief.size.theta, belief.size.beta
    inertia = belief.inertia
    y0 = x[0] + air
    work.drive[0, theta] = a6 * h * reach * (0.5 * y0 + h / 6.0 * x[1])
    work.drive[1, theta] = a6 * reach * (y0 + 0.5 * h * x[1])
    lean = belief.constant.lean
    once, twice = fil.step.once, fil.step.twice
    work.drive[0, beta] = k1 * (twice[0] * x[2] + twice[1] * x[3] + twice[2] * u + 0.5 * h * reach * lean)
    work.drive[1, beta] = k1 * (once[0] * x[2] + once[1] * x[3] + once[2] * u + reach * lean)
    if inertia != 0.0:
        work.drive[0, theta] += a6 * inertia * (twice[0] * x[2] + twice[1] * x[3] + twice[2] * u)
        work.drive[1, theta] += a6 * inertia * (once[0] * x[2] + once[1] * x[3] + once[2] * u)


@inner
def fill_transition(belief, fil, f, a6, k1, push):
    """Transition matrix of the step.  Left out: a6 h^2/6 of the nozzle's effect on the attitude, 3e-5 of k1 here; of
    known damping d what it does to the effect of a6 within a step, a6 d h^3/6.
    """
    h, reach = fil.step.h, fil.step.reach
    c = 1.0 + 0.5 * a6 * h * h
    s = reach + a6 * h * h * h / 6.0
    f[0, 0], f[0, 1] = c, s
    f[1, 0], f[1, 1] = a6 * s, c * fil.step.fade
    f[0, 2], f[0, 3] = k1 * fil.step.twice[0], k1 * fil.step.twice[1]
    f[1, 2], f[1, 3] = k1 * fil.step.once[0], k1 * fil.step.once[1]
    f[2, 2], f[2, 3] = fil.step.phi[0, 0], fil.step.phi[0, 1]
    f[3, 2], f[3, 3] = fil.step.phi[1, 0], fil.step.phi[1, 1]
    for j in range(belief.size.nuisances):
        f[0, sx.N_STATES + j], f[1, sx.N_STATES + j] = 0.5 * h * reach * push[j], reach * push[j]
        f[sx.N_STATES + j, sx.N_STATES + j] = fil.step.keep if belief.role[j] == TURBULENCE else 1.0


@inner
def propagate_covariance(f, n, p, work):
    """p <- F p F' for the first n rows and columns of a symmetric p; F is block upper
    triangular, diagonal in the nuisances."""
    m = work
    for j in range(n):
        m[0, j] = f[0, 0] * p[0, j] + f[0, 1] * p[1, j] + f[0, 2] * p[2, j] + f[0, 3] * p[3, j]
        m[1, j] = f[1, 0] * p[0, j] + f[1, 1] * p[1, j] + f[1, 2] * p[2, j] + f[1, 3] * p[3, j]
        m[2, j] = f[2, 2] * p[2, j] + f[2, 3] * p[3, j]
        m[3, j] = f[3, 2] * p[2, j] + f[3, 3] * p[3, j]
    for k in range(sx.N_STATES, n):
        for j in range(n):
            m[0, j] += f[0, k] * p[k, j]
            m[1, j] += f[1, k] * p[k, j]
            m[k, j] = f[k, k] * p[k, j]
    for i in range(n):  # the lower triangle, mirrored: what is not symmetric would grow as the vehicle does
        p[i, 0] = m[i, 0] * f[0, 0] + m[i, 1] * f[0, 1] + m[i, 2] * f[0, 2] + m[i, 3] * f[0, 3]
        p[i, 1] = m[i, 0] * f[1, 0] + m[i, 1] * f[1, 1] + m[i, 2] * f[1, 2] + m[i, 3] * f[1, 3]
        p[i, 2] = m[i, 2] * f[2, 2] + m[i, 3] * f[2, 3]
        p[i, 3] = m[i, 2] * f[3, 2] + m[i, 3] * f[3, 3]
        for k in range(sx.N_STATES, n):
            p[i, 0] += m[i, k] * f[0, k]
            p[i, 1] += m[i, k] * f[1, k]
        for k in range(sx.N_STATES, i + 1):
            p[i, k] = m[i, k] * f[k, k]
    for i in range(1, n):
        for j in range(i):
            p[j, i] = p[i, j]


@inner
def propagate_sensitivities(f, n, s, columns):
    """s <- F s for the first n rows and so many columns of s inout."""
    for j in range(columns):
        y0, y1, y2, y3 = s[0, j], s[1, j], s[2, j], s[3, j]
        s[0, j] = f[0, 0] * y0 + f[0, 1] * y1 + f[0, 2] * y2 + f[0, 3] * y3
        s[1, j] = f[1, 0] * y0 + f[1, 1] * y1 + f[1, 2] * y2 + f[1, 3] * y3
        s[2, j] = f[2, 2] * y2 + f[2, 3] * y3
        s[3, j] = f[3, 2] * y2 + f[3, 3] * y3
    for k in range(sx.N_STATES, n):
        for j in range(columns):
            s[0, j] += f[0, k] * s[k, j]
            s[1, j] += f[1, k] * s[k, j]
            s[k, j] *= f[k, k]


@inner
def advance_columns(size, modes, now, f, m, columns, push):
    """m <- F m for the rows of the rigid body and of so many modes, and so many columns of m inout.

    now  numbers of the modes;  push (2, >=columns): scratch
    """
    md.advance_columns(size, modes, now, f, m, columns, push)
    propagate_sensitivities(f, size.mode_at, m, columns)
    md.add_push(m, columns, push)


@inner
def advance_symmetric(size, modes, now, f, p, push):
    """p <- F p F' = F (F p)' of a symmetric p inout, with so many modes.  Arguments as `advance_columns`"""
    n = size.mode_at + 2 * modes
    advance_columns(size, modes, now, f, p, n, push)
    md.transpose(p, n)
    advance_columns(size, modes, now, f, p, n, push)
    md.mirror(p, n)


@inner
def advance_uncertainty(belief, modes, fil, work, f, g):
    """Advance what is not known by one step without its noise: sensitivities by f, covariance by g, and of both their
    derivatives for the noise levels, of the states but bending.  modes  None: the model has none"""
    size, now, push = belief.size, fil.modes.now[:], work.mode_push[:]
    if modes is None:
        propagate_sensitivities(f, size.states, fil.s[:], size.sensitivities)
        propagate_covariance(g, size.states, fil.p[:], work.matrix)
    else:
        advance_columns(size, size.modes, now, f, fil.s[:], size.sensitivities, push)
        advance_symmetric(size, size.modes, now, g, fil.p[:], push)
        md.add_number_drives(belief, fil, work)
    if modes is None or size.sloshes == 0:
        propagate_sensitivities(f, size.acting, fil.sx[:], size.levels)
        for k in range(size.levels):
            propagate_covariance(g, size.acting, fil.sp[k], work.matrix)
    else:
        advance_columns(size, size.sloshes, now, f, fil.sx[:], size.levels, push)
        for k in range(size.levels):
            advance_symmetric(size, size.sloshes, now, g, fil.sp[k], push)


@inner
def add_mode_noise(belief, fil, work, k1, command_variance):
    """Process noise of one step that reaches the modes: the command's, and the doubt of bending's frequencies."""
    md.add_bending_noise(belief, fil, work, k1, command_variance, 0, fil.p[:])
    if belief.constant.missing > 0.0:
        md.add_bending_noise(belief, fil, work, k1, fil.jump, 1, fil.p[:])
    md.add_doubt(belief, fil, work)


@inner
def advance_state(belief, fil, f, k1, u, known):
    """Advance the state by one step.  u [rad] command, `known` [rad/s^2] acceleration, both held."""
    x, h, reach = fil.x, fil.step.h, fil.step.reach
    y0, y1, y2, y3 = x[0], x[1], x[2], x[3]
    b0, b1 = k1 * fil.step.twice[2], k1 * fil.step.once[2]
    x[0] = f[0, 0] * y0 + f[0, 1] * y1 + f[0, 2] * y2 + f[0, 3] * y3 + b0 * u
    x[1] = f[1, 0] * y0 + f[1, 1] * y1 + f[1, 2] * y2 + f[1, 3] * y3 + b1 * u
    x[2] = f[2, 2] * y2 + f[2, 3] * y3 + fil.step.by_command[0] * u
    x[3] = f[3, 2] * y2 + f[3, 3] * y3 + fil.step.by_command[1] * u
    x[0] += 0.5 * h * reach * known
    x[1] += reach * known
    for k in range(sx.N_STATES, sx.N_STATES + belief.size.nuisances):
        x[0] += f[0, k] * x[k]
        x[1] += f[1, k] * x[k]
        x[k] *= f[k, k]


@inner
def add_held_noise(step, k1, variance, p):
    """Add to a covariance p the process noise of a command that is held over a step, of this variance [rad^2]."""
    b = (k1 * step.twice[2], k1 * step.once[2], step.by_command[0], step.by_command[1])
    for i in range(sx.N_STATES):
        for j in range(sx.N_STATES):
            p[i, j] += b[i] * b[j] * variance


@inner
def add_process_noise(belief, fil, a6, k1, command_variance, command):
    """Process noise of one step into the covariance and its derivative for the noise levels: of command, acceleration,
    missed commands, wind, and of the gamma measured, an acceleration.  a6, k1  nominal's a6, and k1 of the gains

    Where samples are slower than the controller no sample holds the command of a step's last part: it is off the last
    one by as much as it changes from sample to sample, in the mean of JUMP_MEMORY.
    """
    h, reach, keep = fil.step.h, fil.step.reach, fil.step.keep
    add_held_noise(fil.step, k1, command_variance, fil.p[:])
    add_held_noise(fil.step, k1, 2.0 * command_variance, fil.sp[sx.COMMAND_NOISE])
    acceleration_variance = belief.variance[sx.ACCELERATION_NOISE] * exp_of(2.0 * fil.level[sx.ACCELERATION_NOISE])
    w = (0.5 * h * reach, reach)
    for i in range(2):
        for j in range(2):
            q = w[i] * w[j] * acceleration_variance
            fil.p[i, j] += q
            fil.sp[sx.ACCELERATION_NOISE, i, j] += 2.0 * q
    if belief.constant.missing > 0.0:
        change = command - fil.command[0]
        if np.isfinite(change):
            share = 1.0 if fil.jump == 0.0 else min(h / JUMP_MEMORY, 1.0)
            fil.jump += share * (change * change - fil.jump)
        add_held_noise(fil.missed, k1, fil.jump, fil.p[:])
    for j in range(belief.size.nuisances):
        k, at = sx.N_STATES + j, belief.level[j]
        if at >= 0:
            q = belief.variance[at] * exp_of(2.0 * fil.level[at])
            q *= h if belief.role[j] == WALK else 1.0 - keep * keep
            fil.p[k, k] += q
            fil.sp[at, k, k] += 2.0 * q
    if belief.constant.gamma_std > 0.0:
        gamma_noise = a6 * belief.constant.gamma_std
        for i in range(2):
            for j in range(2):
                fil.p[i, j] += w[i] * w[j] * (gamma_noise * gamma_noise)
