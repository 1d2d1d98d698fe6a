"""The servo: constants of a time step, its transition with its integrals; and one that is not known.

Unknown are d, deviations of natural frequency, damping ratio and delay from the nominal's, in standard deviations of
what was known before the flight (`Model.servo_sigma`).  Beside the predictor's state run its derivatives for d: over a
step s <- F s + R_d (beta, beta_dot, u, c), R being the servo's response to its state, to the command u that acts as the
step begins and to the change c within it, R_d central differences of R.  The flight's own estimate is a square-root
information about d: docs/method.md, "A servo that is not known".

Assumptions: one servo for the whole flight; the gains' derivatives for d are left out, as those for a6 and k1 are; what
is left of d is independent from block to block where it widens the tracked a6 and k1.
"""

import math

import numpy as np

from ..algebra.elementary import exp_of
from ..algebra.linsolve import absorb_columns, absorb_rows
from ..kernels import inner, kernel
from ..model import SERVO
from . import states as sx

SERVO_ORDER = 12                # of the exponential's series
SCALED = 0.25                   # norm of the matrix whose exponential is summed; the remainder is below 1e-17
MAX_SQUARINGS = 24              # of a matrix whose norm is 4e6 at most
SAME_STEP = 1.0e-6              # relative difference of two time steps that share their constants

N_SERVO = len(SERVO)
BY_FREQUENCY, BY_DAMPING, BY_DELAY = range(N_SERVO)
# columns of a response: of beta, beta_dot, the command as the step begins, its change within the step
SERVO_BETA, SERVO_BETA_DOT, SERVO_COMMAND, SERVO_CHANGE = range(4)

SERVO_DIFFERENCE = 1.0e-3  # of a central difference: relative frequency, damping ratio, delay over the sample period
# of the nominal's frequency and damping: no filter is linearised about others
LEAST_FACTOR = 0.1
MOST_FACTOR = 10.0
SETTLED_SIGMAS = 0.2    # standard deviations: from an estimate so near the filter need not move
# of a move's square: by so much what was learned before counts as wrong.  0.5, what is not linear of it, is too little
CURVED = 2.0
UNSETTLED = 0.2         # share of a block's squares by what is unknown of the servo, beyond which it tells of no noise


@inner
def multiply(a, b, out):
    """Write the product a b of matrices (5, 5) to out (5, 5)."""
    for i in range(5):
        for j in range(5):
            value = 0.0
            for k in range(5):
                value += a[i, k] * b[k, j]
            out[i, j] = value


@inner
def exponential(m, total, term, spare):
    """Write exp(m) of a matrix (5, 5) to total, by scaling and squaring (Higham, SIAM J. Matrix Anal. 26, 2005); m is
    overwritten."""
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
    for order in range(1, SERVO_ORDER + 1):
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


@inner
def set_step(constant, frequency, damping, h, work, step):
    """Constants of a time step h [s]: exp of a servo's generator over it, and the turbulence's decay.

    frequency [rad/s], damping  of a second-order servo
    """
    m, total, term, spare = work.taylor[0], work.taylor[1], work.taylor[2], work.taylor[3]
    m[:, :] = 0.0  # generator times h of (double integral, integral, beta, beta_dot / w, u): entries of one size
    m[0, 1], m[1, 1], m[1, 2] = h, 0.0 - h * constant.aero_damping, h
    if constant.time_constant > 0.0:
        m[2, 2], m[2, 4] = -h / constant.time_constant, h / constant.time_constant
    else:
        m[2, 3] = frequency * h
        m[3, 2], m[3, 3], m[3, 4] = -(frequency * h), -2.0 * damping * (frequency * h), frequency * h
    exponential(m, total, term, spare)
    w = 1.0 if constant.time_constant > 0.0 else frequency
    step.h = h
    step.phi[0, 0] = total[2, 2]
    step.phi[0, 1] = total[2, 3] / w
    step.phi[1, 0] = total[3, 2] * w
    step.phi[1, 1] = total[3, 3] if constant.time_constant == 0.0 else 0.0
    step.by_command[0] = total[2, 4]
    step.by_command[1] = total[3, 4] * w
    for j in range(3):
        scale = 1.0 / w if j == 1 else 1.0
        step.once[j] = total[1, 2 + j] * scale
        step.twice[j] = total[0, 2 + j] * scale
    step.fade, step.reach = total[1, 1], total[0, 1]
    step.keep = exp_of(-h / constant.turbulence_time)


@inner
def believe_servo(belief, fil):
    """Set the servo's numbers from the deviations that the filter is linearised about; the next step is set afresh."""
    servo, about, constant = fil.servo, fil.servo.about, belief.constant
    servo.frequency = constant.frequency * (1.0 + belief.servo[BY_FREQUENCY] * about[BY_FREQUENCY])
    servo.damping = constant.damping * (1.0 + belief.servo[BY_DAMPING] * about[BY_DAMPING])
    servo.delay = constant.delay + belief.servo[BY_DELAY] * about[BY_DELAY]
    fil.step.h = 0.0


# ---- a step


@inner
def fill_response(constant, frequency, damping, h, left, work, step, out):
    """The effect of beta, beta_dot and command over a step: rows (theta, theta_dot) per unit of k1, beta, beta_dot.

    h, left [s]  in   the step, and what is left of it when the command changes
    step, out (4, 4)  out
    """
    late = work.late
    set_step(constant, frequency, damping, h, work, step)
    set_step(constant, frequency, damping, left, work, late)
    for j in range(3):
        out[0, j], out[1, j] = step.twice[j], step.once[j]
    for i in range(2):
        out[2 + i, SERVO_BETA], out[2 + i, SERVO_BETA_DOT] = step.phi[i, 0], step.phi[i, 1]
        out[2 + i, SERVO_COMMAND], out[2 + i, SERVO_CHANGE] = step.by_command[i], late.by_command[i]
    out[0, SERVO_CHANGE], out[1, SERVO_CHANGE] = late.twice[2], late.once[2]


@inner
def left_after_switch(belief, fil, h):
    """Return how much [s] of a step of h [s] is left when the command that is held, `delay` old, changes."""
    delay = fil.servo.delay
    whole = int(delay / belief.constant.controller_period)
    return max(h - (delay - whole * belief.constant.controller_period), 0.0)


@inner
def set_slopes(belief, fil, work):
    """Compute the derivatives of the servo's response over a sample period by its deviations d (frequency, damping,
    delay).  Steps of another length take them in proportion, since they only weigh the innovations."""
    servo, constant = fil.servo, belief.constant
    h, left = constant.controller_period, left_after_switch(belief, fil, constant.controller_period)
    unit = (constant.frequency / servo.frequency, constant.damping, 1.0 / constant.controller_period)
    for j in range(belief.size.servo):
        slope = fil.servo.response[1 + j]
        slope[:, :] = 0.0
        if belief.servo[j] == 0.0:
            continue
        for side in range(2):
            d = SERVO_DIFFERENCE if side == 0 else -SERVO_DIFFERENCE
            frequency = servo.frequency * (1.0 + d) if j == BY_FREQUENCY else servo.frequency
            damping = servo.damping + d if j == BY_DAMPING else servo.damping
            later = d * constant.controller_period if j == BY_DELAY else 0.0
            fill_response(constant, frequency, damping, h, max(left - later, 0.0), work, work.other, work.moved[:])
            scale = belief.servo[j] * unit[j] / (2.0 * d)
            for i in range(sx.N_STATES):
                for k in range(sx.N_STATES):
                    slope[i, k] += scale * work.moved[i, k]


@kernel
def set_servo_step(block):
    """Set the constants of the next time step for the servo as estimated, and its slopes if that moved."""
    belief, fil, work = block[0].fixed.belief, block[0].state.filter, block[0].work.filter
    servo = fil.servo
    if fil.step.h == 0.0:
        set_slopes(belief, fil, work)
    h = servo.next_step
    fill_response(belief.constant, servo.frequency, servo.damping, h, left_after_switch(belief, fil, h), work,
                  fil.step, fil.servo.response[0])
    missing = belief.constant.missing
    if missing > 0.0:
        set_step(belief.constant, servo.frequency, servo.damping, missing * h, work, fil.missed)


@inner
def drive_servo(belief, fil, work, k1, u, change):
    """Effect of a unit of each deviation on the state over the step, into work.servo_drive (servo, 4).

    There is none where the command is not known, as between samples slower than the controller: what the nozzle does
    then says nothing of the servo.
    """
    x = fil.x
    is_known = belief.constant.missing == 0.0 and not np.isnan(change)
    for j in range(belief.size.servo):
        response = fil.servo.response[1 + j]
        ratio = 1.0 if j == BY_DELAY else fil.step.h / belief.constant.controller_period
        for i in range(sx.N_STATES):
            effect = ratio * (response[i, SERVO_BETA] * x[2] + response[i, SERVO_BETA_DOT] * x[3]
                              + response[i, SERVO_COMMAND] * u
                              + response[i, SERVO_CHANGE] * change)
            if i < 2:
                effect *= k1
            work.servo_drive[j, i] = effect if is_known else 0.0


@inner
def add_change(belief, fil, work, k1, believed_k1, change):
    """Add the change of the command within the step to the state and to beta's drive, then the servo's own drive.

    k1, believed_k1 [1/s^2]  the nominal's, and as believed
    """
    at, beta = belief.size.servo_at, belief.size.beta
    for i in range(sx.N_STATES):
        for j in range(belief.size.servo):
            fil.s[i, at + j] += work.servo_drive[j, i]
        if np.isnan(change):
            continue
        effect = fil.servo.response[0, i, SERVO_CHANGE] * change
        fil.x[i] += believed_k1 * effect if i < 2 else effect
        if i < 2:
            work.drive[i, beta] += k1 * effect


# ---- what is not known yet


@inner
def doubt_of(size, servo, s):
    """Return the variance that the unknown servo adds to a prediction of sensitivities s (>=servo,) for its numbers."""
    doubt = 0.0
    for k in range(size.servo):
        seen = 0.0
        for j in range(k + 1):
            seen += s[j] * servo.root[j, k]
        doubt += seen * seen
    return doubt


@kernel
def widen_check(block):
    """Shrink the block's mean innovations by what the unknown servo adds to their variance: that is no wrong model."""
    belief, fil, check = block[0].fixed.belief, block[0].state.filter, block[0].state.check
    for c in range(sx.N_CHANNELS):
        if check.seen[c] > 0:
            narrower = 1.0 / math.sqrt(1.0 + doubt_of(belief.size, fil.servo, check.servo[c]) / check.seen[c])
            check.innovation[c] *= narrower
            check.for_a6[c] *= narrower
            check.for_k1[c] *= narrower
        for j in range(belief.size.servo):
            check.servo[c, j] = 0.0


@inner
def widen_pair(belief, fil, work):
    """Widen the block's triangle of offset, a6 and k1 by what is not known of the servo."""
    size, servo = belief.size, fil.servo
    at, n, c, known = size.servo_at, size.states, size.columns, size.servo
    width = known + size.pair
    r, columns = work.scratch[:width * width].reshape((width, width)), work.columns[:]
    r[:, :] = 0.0
    for i in range(known):
        columns[i] = at + i
        r[i, width - 1] = servo.r[i, known]
        for j in range(i, known):
            r[i, j] = servo.r[i, j]
            r[i, width - 1] -= servo.r[i, j] * servo.about[j]
    for j in range(n):
        columns[known + j] = j
    columns[width - 3], columns[width - 2] = n + belief.size.theta, n + belief.size.beta
    columns[width - 1] = c - 1
    absorb_columns(r, work.triangle[:], columns, width, c, work.scratch[width * width:])
    for i in range(size.pair):
        for j in range(size.pair):
            work.pair[i, j] = r[known + i, known + j]


# ---- what a block says


@inner
def learn_servo(belief, fil, work):
    """Add the block's information about the servo's deviations to the flight's, the block having an a6 and a k1 of its
    own."""
    size, servo = belief.size, fil.servo
    at, n, c, known = size.servo_at, size.states, size.columns, size.servo
    width = 3 + known
    r = work.scratch[:width * width].reshape((width, width))
    rt = work.scratch[width * width:width * (width + c)].reshape((width, c))
    r[:, :] = 0.0
    for p in range(2):
        r[p, p] = 1.0 / sx.FIRST_STD
        r[p, width - 1] = fil.p_bar[p] / sx.FIRST_STD
    for i in range(c):
        rt[sx.A6, i] = work.triangle[i, n + belief.size.theta]
        rt[sx.K1, i] = work.triangle[i, n + belief.size.beta]
        rt[width - 1, i] = work.triangle[i, c - 1]
        for j in range(known):
            rt[2 + j, i] = work.triangle[i, at + j]
            rt[width - 1, i] += work.triangle[i, at + j] * servo.about[j]
    absorb_rows(r, rt, width, c)
    for j in range(1 + known):
        work.columns[j] = 2 + j
    absorb_columns(servo.r[:], r[2:], work.columns[:], 1 + known, 1 + known, work.scratch[width * width:])


@inner
def fade_servo(size, servo, work, keep):
    """Forget all but the share `keep` of the flight's information on the servo; what was known before it stays."""
    n = size.servo
    if keep == 1.0:
        return
    root = math.sqrt(keep)
    prior = work.scratch[:n * (1 + n)].reshape((1 + n, n))
    for i in range(n):
        for j in range(1 + n):
            servo.r[i, j] *= root
            prior[j, i] = math.sqrt(1.0 - keep) if i == j else 0.0
    servo.r[n, n] = 0.0
    absorb_rows(servo.r[:], prior, 1 + n, n)


@inner
def solve_servo(size, servo):
    """Estimate and root of its covariance, R^-1, of R d = y."""
    n, r, root = size.servo, servo.r, servo.root
    for k in range(n):
        for i in range(k, -1, -1):
            value = 1.0 if i == k else 0.0
            for j in range(i + 1, k + 1):
                value -= r[i, j] * root[j, k]
            root[i, k] = value / r[i, i]
    for i in range(n):
        servo.mean[i] = 0.0
        for k in range(i, n):
            servo.mean[i] += root[i, k] * r[k, n]


@inner
def std_of(size, servo, j):
    """Return the standard deviation of deviation j of the servo, as a share of the one before the flight."""
    square = 0.0
    for k in range(j, size.servo):
        square += servo.root[j, k] * servo.root[j, k]
    return math.sqrt(square)


@inner
def within_reach(belief, j, d):
    """Return the deviation nearest to d about which the filter may be linearised."""
    sigma, constant = belief.servo[j], belief.constant
    if sigma == 0.0:
        return 0.0
    if j == BY_DELAY:
        most = (sx.MAX_DELAY_SAMPLES - 2) * constant.controller_period
        return min(max(d, -constant.delay / sigma), (most - constant.delay) / sigma)
    return min(max(d, (LEAST_FACTOR - 1.0) / sigma), (MOST_FACTOR - 1.0) / sigma)


@kernel
def relinearise_servo(block):
    """Linearise the filter, with its state, about the servo as the flight shows it, unless it is there already.

    What was learned a move ago from there is wrong by what is not linear in the move: by its square, frequency and
    damping being relative and the delay in radians of the servo's frequency, times CURVED.  It counts for no more.
    """
    belief, fil, work = block[0].fixed.belief, block[0].state.filter, block[0].work.acc
    size, servo = belief.size, fil.servo
    at, square, far, away = size.servo_at, 0.0, 0.0, False
    for j in range(size.servo):
        step = within_reach(belief, j, servo.mean[j]) - servo.about[j]
        away = away or abs(step) > SETTLED_SIGMAS * std_of(size, servo, j)
    if not away:
        return
    time = belief.constant.time_constant
    speed = 1.0 / time if time > 0.0 else servo.frequency
    unit = (1.0, belief.constant.damping, speed)
    for j in range(size.servo):
        if belief.servo[j] == 0.0:
            continue
        step = within_reach(belief, j, servo.mean[j]) - servo.about[j]
        moved = step * belief.servo[j] * unit[j]
        square += moved * moved
        for i in range(size.states):
            fil.x[i] += fil.s[i, at + j] * step
        servo.about[j] += step
    for j in range(size.servo):
        if belief.servo[j] > 0.0:
            wrong = CURVED * square / (belief.servo[j] * unit[j] * std_of(size, servo, j))
            far += wrong * wrong
    fade_servo(size, servo, work, 1.0 / (1.0 + far))
    solve_servo(size, servo)
    believe_servo(belief, fil)
