"""Slosh and bending as states of the predictor, and what is not known of their numbers.

Slosh   p = C (psi + theta), C = coupling w^2: the mass against inertial space, as the acceleration that it makes;
        p'' = -w^2 (p - C theta) - 2 z w (p' - C theta'),  theta_ddot += p - C theta
Bending eta'' = w^2 (g beta - eta) - 2 z w eta',  shown by attitude sensor and gyro (`shown`)
With p the coupling stands in what drives a mode alone, so that no unknown amplitude passes for a coupling, and no
acceleration enters a mode but by theta.  (Pendulum analogy: NASA SP-106, ch. 6.  Bending: NASA CR-826, A.3.)

Over a step the oscillator's own transition is exact, with its integrals; theta moves by its rate, the nozzle by its
servo.  Left out is what the acceleration within a step does to p beside C theta, w^2 h^2/6 of it.

Unknown are relative deviations d of frequency, coupling or gain, and damping, in standard deviations of what was known
before the flight.  Their sensitivities run beside those of a6 and k1; every block is a measurement of (a6, k1, d),
which walk (a Kalman filter; of a6 and k1 this one is its own).  An error of frequency turns a mode's phase out of what
is linear, by the square of the error; so what was learned fades as long as the frequency is in doubt (`renew_numbers`),
and what the data tell of a frequency is its product with the size (`rescale_frequency`).  Of bending, which the loop
hardly feels, the doubt is process noise meanwhile (`add_doubt`).
"""

import math

import numpy as np

from ..algebra.elementary import exp_of
from ..algebra.linsolve import U, absorb_rows, measure
from ..kernels import inner, kernel
from . import servo as sv
from . import states as sx

LINEAR = 0.03        # relative: about a bending frequency known so well the filter may be linearised
DOUBT = 10.0         # until then its variance is process noise of the mode, times this over w h
RENEWAL = 3.0        # 1/rad: of a mode's numbers, by the square of its frequency's doubt and radian of its phase
NUMBER_WALK = 0.001  # 1/sqrt(s), relative, of a mode's numbers
RIGID_WALK = 0.003   # 1/sqrt(s), relative, of a6 and k1 beside them
REOPENED = 0.4       # relative, of a6 and k1 after a sudden change
MODE_DIFFERENCE = 1.0e-3  # relative frequency, damping ratio: of a central difference
LEAST_FREQUENCY, MOST_FREQUENCY = 0.3, 3.0  # of the nominal's: no filter is linearised about others
PROVEN = 4.5         # standard deviations of a size from 0: the mode is there
SETTLED = 0.05       # standard deviations: from a number so near the filter need not move
SAME_SLOPE = 0.005   # relative: at a frequency so near the derivatives, which only weigh innovations, are the same
SLOSH_SPREAD = 0.1   # rad, of psi before any data
NOZZLE_SPREAD = 0.05  # rad: bending before any data is that of a nozzle so far off
LEAST_PIVOT = 1.0e-12  # of a covariance's factor

# number (i8): what of a mode an unknown number is
BY_FREQUENCY, BY_SIZE, BY_DAMPING = range(3)
# now (f8), a row a mode: frequency [rad/s], C [1/s^2] or gain, damping ratio, as believed and as the nominal has them
M_FREQUENCY, M_SIZE, M_DAMPING, M_FREQUENCY_0, M_SIZE_0, M_DAMPING_0 = range(6)
N_NOW = 6
# own (f8), a row a mode: over a step its transition (4); of slosh the integral and double integral of p (2, 2); of
# bending what beta, beta_dot, command and its change within the step make of eta and eta', and a missed command
M_PHI, M_ONCE, M_TWICE = 0, 4, 6
M_ETA, M_ETA_DOT, M_MISSED = 4, 8, 12
N_OWN = 14
# a row of the modes' nodes (f8): time [s]; of each mode frequency, coupling or gain, damping ratio
NODE_T = 0
N_MODE_COLUMNS = 3


# ---- a step


@inner
def fill_own(belief, fil, work, slosh, w, z, h, out):
    """Fill a mode's constants `out` (N_OWN,) over h [s]."""
    constant, m, total = belief.constant, work.taylor[0], work.taylor[1]
    m[:, :] = 0.0  # generator times h: entries of one size
    out[:] = 0.0
    if slosh:  # of (double integral, integral, p, p'/w)
        m[0, 1], m[1, 1], m[1, 2] = h, 0.0 - h * constant.aero_damping, h
        m[2, 3], m[3, 2], m[3, 3] = w * h, -(w * h), -2.0 * z * (w * h)
        sv.exponential(m, total, work.taylor[2], work.taylor[3])
        out[M_PHI], out[M_PHI + 1] = total[2, 2], total[2, 3] / w
        out[M_PHI + 2], out[M_PHI + 3] = total[3, 2] * w, total[3, 3]
        out[M_ONCE], out[M_ONCE + 1] = total[1, 2], total[1, 3] / w
        out[M_TWICE], out[M_TWICE + 1] = total[0, 2], total[0, 3] / w
        return
    bend(belief, fil, w, z, h, work)
    servo = believed_servo(belief, fil)
    out[M_PHI], out[M_PHI + 1] = total[0, 0], total[0, 1] / w
    out[M_PHI + 2], out[M_PHI + 3] = total[1, 0] * w, total[1, 1]
    for row in range(2):
        at, scale = M_ETA + 4 * row, 1.0 if row == 0 else w
        out[at], out[at + 1], out[at + 2] = (scale * total[row, 2], scale * total[row, 3] / servo,
                                             scale * total[row, 4])
    if belief.size.servo > 0:
        bend(belief, fil, w, z, sv.left_after_switch(belief, fil, h), work)
        out[M_ETA + 3], out[M_ETA_DOT + 3] = total[0, 4], w * total[1, 4]
    if constant.missing > 0.0:
        bend(belief, fil, w, z, constant.missing * h, work)
        out[M_MISSED], out[M_MISSED + 1] = total[0, 4], w * total[1, 4]


@inner
def believed_servo(belief, fil):
    """Return the frequency [rad/s] by which the servo's rate is scaled."""
    if belief.constant.time_constant > 0.0:
        return 1.0
    return fil.servo.frequency if belief.size.servo > 0 else belief.constant.frequency


@inner
def bend(belief, fil, w, z, h, work):
    """work.taylor[1] out: exp over h [s] of (eta, eta'/w, beta, beta_dot/servo, command) with a gain of 1."""
    constant, m, servo = belief.constant, work.taylor[0], believed_servo(belief, fil)
    damping = fil.servo.damping if belief.size.servo > 0 else constant.damping
    m[:, :] = 0.0
    m[0, 1], m[1, 0], m[1, 1], m[1, 2] = w * h, -(w * h), -2.0 * z * (w * h), w * h
    if constant.time_constant > 0.0:
        m[2, 2], m[2, 4] = -h / constant.time_constant, h / constant.time_constant
    else:
        m[2, 3] = servo * h
        m[3, 2], m[3, 3], m[3, 4] = -(servo * h), -2.0 * damping * (servo * h), servo * h
    sv.exponential(m, work.taylor[1], work.taylor[2], work.taylor[3])


@inner
def believe_modes(belief, nodes, fil):
    """Fill modes.now: every mode's numbers at the last sample, the nominal's and as believed."""
    modes, t = fil.modes, fil.time.last
    for i in range(belief.size.modes):
        now, at = modes.now[i], NODE_T + 1 + N_MODE_COLUMNS * i
        for k in range(3):
            now[M_FREQUENCY_0 + k] = sx.air_at(nodes, at + k, t)
            now[k] = now[M_FREQUENCY_0 + k]
    for j in range(belief.size.numbers):
        now, what = modes.now[belief.mode_of[j]], belief.number[j]
        factor = 1.0 + belief.number_sigma[j] * modes.about[j]
        if what == BY_FREQUENCY:
            factor = min(max(factor, LEAST_FREQUENCY), MOST_FREQUENCY)
        elif what == BY_DAMPING:
            factor = max(factor, 0.0)
        now[what] *= factor
    for i in range(belief.size.sloshes):  # C = coupling w^2
        now = modes.now[i]
        now[M_SIZE] *= now[M_FREQUENCY] * now[M_FREQUENCY]
        now[M_SIZE_0] *= now[M_FREQUENCY] * now[M_FREQUENCY]


@kernel
def set_modes(block, modes):
    """Set the modes' constants of the next time step, and the derivatives of those whose frequency has moved."""
    belief, fil, work = block[0].fixed.belief, block[0].state.filter, block[0].work.filter
    constant, size = belief.constant, belief.size
    h = fil.servo.next_step if size.servo > 0 else fil.modes.next_step
    fresh = fil.modes.is_set == 0
    if size.servo == 0:
        sv.set_step(constant, constant.frequency, constant.damping, h, work, fil.step)
        if constant.missing > 0.0:
            sv.set_step(constant, constant.frequency, constant.damping, constant.missing * h, work,
                        fil.missed)
    if fresh:
        believe_modes(belief, modes, fil)
    for i in range(size.modes):
        now = fil.modes.now[i]
        fill_own(belief, fil, work, i < size.sloshes, now[M_FREQUENCY], now[M_DAMPING], h, fil.modes.own[i])
    period = constant.controller_period
    for j in range(size.numbers):
        what, i = belief.number[j], belief.mode_of[j]
        now, slope = fil.modes.now[i], fil.modes.slope[j]
        if abs(now[M_FREQUENCY] - fil.modes.sloped[j]) <= SAME_SLOPE * now[M_FREQUENCY]:
            continue
        fil.modes.sloped[j] = now[M_FREQUENCY]
        slope[:] = 0.0
        if what == BY_SIZE:
            continue
        for side in range(2):
            d = MODE_DIFFERENCE if side == 0 else -MODE_DIFFERENCE
            w = now[M_FREQUENCY] * (1.0 + d) if what == BY_FREQUENCY else now[M_FREQUENCY]
            z = now[M_DAMPING] + d * now[M_DAMPING_0] if what == BY_DAMPING else now[M_DAMPING]
            fill_own(belief, fil, work, i < size.sloshes, w, z, period, work.own[:])
            scale = belief.number_sigma[j] / (2.0 * d)
            if what == BY_FREQUENCY:
                scale *= now[M_FREQUENCY_0] / now[M_FREQUENCY]
            for k in range(N_OWN):
                slope[k] += scale * work.own[k]
    fil.modes.is_set = 1


@inner
def fill_modes(belief, fil, f):
    """Add the modes' rows and columns to the transition f of the rigid body, servo and nuisances.

    Of slosh theta and theta_dot get the integrals of p - C theta; the columns hold those of p.
    """
    size, h = belief.size, fil.step.h
    for i in range(size.modes):
        own, k = fil.modes.own[i], size.mode_at + 2 * i
        c = fil.modes.now[i, M_SIZE]
        f[k, k], f[k, k + 1] = own[M_PHI], own[M_PHI + 1]
        f[k + 1, k], f[k + 1, k + 1] = own[M_PHI + 2], own[M_PHI + 3]
        if i < size.sloshes:
            f[k, 0], f[k, 1] = c * (1.0 - own[M_PHI]), c * (h - own[M_PHI + 1])
            f[k + 1, 0], f[k + 1, 1] = -(c * own[M_PHI + 2]), c * (1.0 - own[M_PHI + 3])
            for j in range(2):
                f[0, k + j], f[1, k + j] = own[M_TWICE + j], own[M_ONCE + j]
        else:
            f[k, 2], f[k, 3] = c * own[M_ETA], c * own[M_ETA + 1]
            f[k + 1, 2], f[k + 1, 3] = c * own[M_ETA_DOT], c * own[M_ETA_DOT + 1]


@inner
def drive_numbers(belief, fil, work, u, change):
    """Effect of a unit of each unknown number on the state over the step, into work.number_drive (numbers, n).

    u, change [rad]  in  command that acts, its change within the step (0 or NaN: none is known)
    """
    size, x, h = belief.size, fil.x, fil.step.h
    ratio, turned = h / belief.constant.controller_period, 0.0 if np.isnan(change) else change
    for j in range(size.numbers):
        what, i = belief.number[j], belief.mode_of[j]
        out = work.number_drive[j]
        own, slope, now = fil.modes.own[i], fil.modes.slope[j], fil.modes.now[i]
        k, c, sigma = size.mode_at + 2 * i, now[M_SIZE], belief.number_sigma[j]
        out[:] = 0.0
        if i < size.sloshes:
            more = 0.0  # of C
            if what == BY_FREQUENCY:
                more = 2.0 * c * sigma * now[M_FREQUENCY_0] / now[M_FREQUENCY]
            elif what == BY_SIZE:
                more = sigma * now[M_SIZE_0]
            own_0, own_1 = x[k] - c * x[0], x[k + 1] - c * x[1]
            more_0, more_1 = more * x[0], more * x[1]
            for row in range(2):
                at, over = M_PHI + 2 * row, M_TWICE if row == 0 else M_ONCE
                out[k + row] = (ratio * (slope[at] * own_0 + slope[at + 1] * own_1)
                                - (own[at] * more_0 + own[at + 1] * more_1))
                out[row] = (ratio * (slope[over] * own_0 + slope[over + 1] * own_1)
                            - (own[over] * more_0 + own[over + 1] * more_1))
            out[k] += more_0 + h * more_1
            out[k + 1] += more_1
        else:
            for row in range(2):
                at = M_ETA + 4 * row
                if what == BY_SIZE:
                    out[k + row] = sigma * now[M_SIZE_0] * (own[at] * x[2] + own[at + 1] * x[3] + own[at + 2] * u
                                                            + own[at + 3] * turned)
                else:
                    out[k + row] = ratio * (c * (slope[at] * x[2] + slope[at + 1] * x[3] + slope[at + 2] * u
                                                 + slope[at + 3] * turned)
                                            + slope[M_PHI + 2 * row] * x[k] + slope[M_PHI + 2 * row + 1] * x[k + 1])


@inner
def advance_columns(size, modes, now, f, m, columns, push):
    """m <- F m for so many columns of m inout, the rows of so many modes, and what slosh adds to theta, theta_dot into
    push (2, >=columns); `kalman.propagate_sensitivities` then moves the other rows, and `push` is to be added."""
    for c in range(columns):
        j = U(c)
        push[0, j], push[1, j] = 0.0, 0.0
    for i in range(modes):
        k = size.mode_at + 2 * i
        by = 0 if i < size.sloshes else 2
        a0, a1, a2, a3 = f[k, by], f[k, by + 1], f[k, k], f[k, k + 1]
        b0, b1, b2, b3 = f[k + 1, by], f[k + 1, by + 1], f[k + 1, k], f[k + 1, k + 1]
        if by == 0:
            c0, c1, d0, d1, stiffness = f[0, k], f[0, k + 1], f[1, k], f[1, k + 1], now[i, M_SIZE]
            for c in range(columns):
                j = U(c)
                y0, y1 = m[k, j] - stiffness * m[0, j], m[k + 1, j] - stiffness * m[1, j]
                push[0, j] += c0 * y0 + c1 * y1
                push[1, j] += d0 * y0 + d1 * y1
        for c in range(columns):
            j = U(c)
            x0, x1, y0, y1 = m[by, j], m[by + 1, j], m[k, j], m[k + 1, j]
            m[k, j] = a0 * x0 + a1 * x1 + a2 * y0 + a3 * y1
            m[k + 1, j] = b0 * x0 + b1 * x1 + b2 * y0 + b3 * y1


@inner
def add_push(m, columns, push):
    """Add `push` (2, >=columns) to the first two rows of m."""
    for i in range(2):
        for c in range(columns):
            j = U(c)
            m[i, j] += push[i, j]


@inner
def transpose(m, n):
    """Transpose the first n rows and columns of m in place."""
    for i in range(1, n):
        for c in range(i):
            k, j = U(i), U(c)
            held = m[k, j]
            m[k, j] = m[j, k]
            m[j, k] = held


@inner
def mirror(m, n):
    """Copy the lower triangle of m to the upper: what is not symmetric would grow as the vehicle does."""
    for i in range(1, n):
        for c in range(i):
            k, j = U(i), U(c)
            m[j, k] = m[k, j]


@inner
def add_number_drives(belief, fil, work):
    """Add to the sensitivities what the modes' numbers do over the step."""
    for j in range(belief.size.numbers):
        for i in range(belief.size.states):
            fil.s[i, belief.size.number_at + j] += work.number_drive[j, i]


@inner
def push_by_slosh(fil, work):
    """Add to theta and theta_dot what slosh does over the step."""
    for i in range(2):
        fil.x[i] += work.slosh[i]


@inner
def advance_modes(belief, fil, work, f, u, change):
    """Move the modes' states over the step, before the rest moves; what slosh adds to theta, theta_dot into
    work.slosh (2,).  Arguments as `drive_numbers`."""
    size, x = belief.size, fil.x
    turned = 0.0 if np.isnan(change) else change
    work.slosh[0], work.slosh[1] = 0.0, 0.0
    for i in range(size.modes):
        own, k, c = fil.modes.own[i], size.mode_at + 2 * i, fil.modes.now[i, M_SIZE]
        b = 0 if i < size.sloshes else 2
        y0, y1 = x[k], x[k + 1]
        own_0, own_1 = y0 - c * x[0], y1 - c * x[1]
        for row in range(2):
            x[k + row] = (f[k + row, b] * x[b] + f[k + row, b + 1] * x[b + 1] + f[k + row, k] * y0
                          + f[k + row, k + 1] * y1)
            if b == 0:
                work.slosh[row] += f[row, k] * own_0 + f[row, k + 1] * own_1
            else:
                at = M_ETA + 4 * row
                x[k + row] += c * (own[at + 2] * u + own[at + 3] * turned)


@inner
def add_bending_noise(belief, fil, work, k1, variance, missed, p):
    """Add to a covariance p what a command of this variance [rad^2], held over the step, makes of bending.

    missed  1: over the step's last part, in which no sample holds it
    """
    size, b = belief.size, work.held
    step = fil.missed if missed == 1 else fil.step
    b[0], b[1] = k1 * step.twice[2], k1 * step.once[2]
    b[2], b[3] = step.by_command[0], step.by_command[1]
    for i in range(size.sloshes, size.modes):
        own, k, c = fil.modes.own[i], size.mode_at + 2 * i, fil.modes.now[i, M_SIZE]
        b[k] = c * (own[M_MISSED] if missed == 1 else own[M_ETA + 2])
        b[k + 1] = c * (own[M_MISSED + 1] if missed == 1 else own[M_ETA_DOT + 2])
    first = size.mode_at + 2 * size.sloshes
    for i in range(first, size.states):
        for j in range(sx.N_STATES):
            q = b[i] * b[j] * variance
            p[i, j] += q
            p[j, i] += q
        for j in range(first, size.states):
            p[i, j] += b[i] * b[j] * variance


@inner
def add_doubt(belief, fil, work):
    """Add to P the doubt of each bending frequency that is not known within LINEAR, as process noise of its mode.

    Not of slosh, which would take what else turns the vehicle.
    """
    size, p, modes = belief.size, fil.p, fil.modes
    for j in range(size.numbers):
        known = LINEAR / belief.number_sigma[j]
        doubt = modes.covariance[2 + j, 2 + j] - known * known
        if belief.number[j] != BY_FREQUENCY or belief.mode_of[j] < size.sloshes or doubt <= 0.0:
            continue
        doubt *= DOUBT / (modes.now[belief.mode_of[j], M_FREQUENCY] * fil.step.h)
        drive = work.number_drive[j]
        for i in range(size.states):
            for k in range(size.states):
                p[i, k] += doubt * (drive[i] * drive[k])


@inner
def start_modes(belief, nodes, shown, fil):
    """Begin a segment: bending and slosh of their usual size, which theta and theta_dot as measured hold."""
    size, p = belief.size, fil.p
    believe_modes(belief, nodes, fil)
    for i in range(size.sloshes, size.modes):
        for row in range(2):
            at = size.mode_at + 2 * i + row
            share, now = shown[row, at] if shown is not None else 0.0, fil.modes.now[i]
            spread = NOZZLE_SPREAD * now[M_SIZE] * (1.0 if row == 0 else now[M_FREQUENCY])
            p[at, at] = spread * spread
            p[row, row] += share * share * p[at, at]  # theta = measured - eta
            p[at, row] = -(share * p[at, at])
            p[row, at] = p[at, row]
    for i in range(size.sloshes):
        c = fil.modes.now[i, M_SIZE]
        for row in range(2):
            at = size.mode_at + 2 * i + row
            spread = SLOSH_SPREAD * c * (1.0 if row == 0 else fil.modes.now[i, M_FREQUENCY])
            fil.x[at] = c * fil.x[row]
            for j in range(size.states):  # p = C theta + what psi makes
                shared = c * p[row, j]
                p[at, j], p[j, at] = shared, shared
            p[at, at] = c * c * p[row, row] + spread * spread
            for level in range(size.levels):
                sp = fil.sp[level]
                sp[at, row] = c * sp[row, row]
                sp[row, at] = sp[at, row]
                sp[at, at] = c * c * sp[row, row]
    for k in range(size.mode_at, size.states):
        fil.s[k, k] = 1.0


# ---- what is not known yet


@inner
def doubt_of_modes(belief, modes, s):
    """Return the variance that the unknown numbers add to a prediction of sensitivities s (>=numbers,) for them."""
    doubt = 0.0
    for i in range(belief.size.numbers):
        for j in range(belief.size.numbers):
            doubt += s[i] * modes.covariance[2 + i, 2 + j] * s[j]
    return max(doubt, 0.0)


@inner
def factor_numbers(belief, modes, root):
    """root (numbers, numbers) out: lower triangle whose square is the numbers' covariance (Cholesky)."""
    for j in range(belief.size.numbers):
        for i in range(j, belief.size.numbers):
            value = modes.covariance[2 + i, 2 + j]
            for k in range(j):
                value -= root[i, k] * root[j, k]
            if i == j:
                root[j, j] = math.sqrt(max(value, LEAST_PIVOT))
            else:
                root[i, j] = value / root[j, j]


@inner
def widen_pair(belief, fil, work):
    """Widen the block's triangle of offset, a6 and k1 by what is not known of the servo and of the modes."""
    size, servo, modes, root = belief.size, fil.servo, fil.modes, work.root
    n, c, first = size.states, size.columns, size.servo
    factor_numbers(belief, modes, root)
    known = size.servo + size.numbers
    width = known + size.pair
    r = work.scratch[:width * width].reshape((width, width))
    rt = work.scratch[width * width:width * (width + c)].reshape((width, c))
    r[:, :] = 0.0
    for j in range(known):  # deviations from what is believed, of unit covariance
        r[j, j] = 1.0
    for i in range(c):
        row = work.triangle[i]
        rt[width - 1, i] = row[c - 1]
        for j in range(n):
            rt[known + j, i] = row[j]
        rt[width - 3, i], rt[width - 2, i] = row[n + size.theta], row[n + size.beta]
        for j in range(size.servo):
            rt[j, i] = 0.0
            for k in range(j + 1):
                rt[j, i] += row[size.servo_at + k] * servo.root[k, j]
            rt[width - 1, i] -= row[size.servo_at + j] * (servo.mean[j] - servo.about[j])
        for j in range(size.numbers):
            rt[first + j, i] = 0.0
            for k in range(j, size.numbers):
                rt[first + j, i] += row[size.number_at + k] * root[k, j]
            rt[width - 1, i] -= row[size.number_at + j] * (modes.mean[2 + j] - modes.about[j])
    absorb_rows(r, rt, width, c)
    for i in range(size.pair):
        for j in range(size.pair):
            work.pair[i, j] = r[known + i, known + j]


@kernel
def widen_mode_check(block):
    """Shrink the block's mean innovations by what the unknown numbers add to their variance: that is no wrong model."""
    belief, modes, check = block[0].fixed.belief, block[0].state.filter.modes, block[0].state.check
    for c in range(sx.N_CHANNELS):
        if check.seen[c] > 0:
            narrower = 1.0 / math.sqrt(1.0 + doubt_of_modes(belief, modes, check.numbers[c]) / check.seen[c])
            check.innovation[c] *= narrower
            check.for_a6[c] *= narrower
            check.for_k1[c] *= narrower
        for j in range(belief.size.numbers):
            check.numbers[c, j] = 0.0


# ---- what a block says


@inner
def is_proven(belief, modes, i):
    """Whether mode i is there beyond doubt, so that its frequency means something: its size is known, or PROVEN."""
    for j in range(belief.size.numbers):
        if belief.mode_of[j] == i and belief.number[j] == BY_SIZE:
            sigma = belief.number_sigma[j]
            return 1.0 + sigma * modes.mean[2 + j] > PROVEN * sigma * math.sqrt(modes.covariance[2 + j, 2 + j])
    return True


@inner
def age_numbers(belief, modes, dt):
    """Widen what is known of the modes' numbers, and of a6 and k1 beside them, by what they may change in dt [s]
    (random walks)."""
    for j in range(belief.size.numbers):
        walk = NUMBER_WALK / belief.number_sigma[j]
        modes.covariance[2 + j, 2 + j] += walk * walk * dt
    for j in range(2):
        modes.covariance[j, j] += RIGID_WALK * RIGID_WALK * dt


@inner
def learn_numbers(belief, fil, work):
    """Update what is known of a6, k1 and the modes' unknown numbers with the block as a measurement of them, the state
    being known (square-root information filter)."""
    size, modes, servo = belief.size, fil.modes, fil.servo
    n, c, width = size.states, size.columns, size.numbers + 3
    r = work.scratch[:width * width].reshape((width, width))
    rt = work.scratch[width * width:width * (width + c)].reshape((width, c))
    r[:, :] = 0.0
    for i in range(c):
        row = work.triangle[i]
        rt[sx.A6, i], rt[sx.K1, i] = row[n + size.theta], row[n + size.beta]
        rt[width - 1, i] = row[c - 1]
        for j in range(size.numbers):
            rt[2 + j, i] = row[size.number_at + j]
            rt[width - 1, i] += row[size.number_at + j] * modes.about[j]
        for j in range(size.servo):
            rt[width - 1, i] -= row[size.servo_at + j] * (servo.mean[j] - servo.about[j])
    absorb_rows(r, rt, width, c)
    for i in range(size.modes):
        work.sizes[i] = square_of_size(belief, modes, i)
    for i in range(width - 1):
        measure(modes.mean[:], modes.covariance[:], r[i], i, width - 1, r[i, width - 1], work.number_column[:])
    for i in range(size.modes):
        rescale_frequency(belief, fil, i, work.sizes[i])


@inner
def forget_numbers(belief, modes, left):
    """Open what was learned of the numbers while the model is contradicted; `left` is left of it after the block."""
    for j in range(belief.size.numbers):
        modes.covariance[2 + j, 2 + j] += 1.0 - left
    for j in range(2):
        modes.covariance[j, j] += (1.0 - left) * sx.FIRST_STD * sx.FIRST_STD


@kernel
def open_rigid(block):
    """Widen what the modes' estimate knows of a6 and k1, which have changed suddenly."""
    covariance = block[0].state.filter.modes.covariance
    for j in range(2):
        covariance[j, j] += REOPENED * REOPENED


@inner
def number_of(belief, i, what):
    """Return which unknown number is this one (BY_FREQUENCY, ...) of mode i; ABSENT if it is known."""
    for j in range(belief.size.numbers):
        if belief.mode_of[j] == i and belief.number[j] == what:
            return j
    return sx.ABSENT


@inner
def square_of_size(belief, modes, i):
    """Return the mean square of mode i's size over the nominal's."""
    j = number_of(belief, i, BY_SIZE)
    if j == sx.ABSENT:
        return 1.0
    sigma, size = belief.number_sigma[j], 1.0 + belief.number_sigma[j] * modes.mean[2 + j]
    return size * size + sigma * sigma * modes.covariance[2 + j, 2 + j]


@inner
def rescale_frequency(belief, fil, i, before):
    """Rescale what is known of the frequency of mode i as its size moves: the data tell the product of both.

    before  `square_of_size` when its sensitivities were made
    """
    j, modes = number_of(belief, i, BY_FREQUENCY), fil.modes
    if j == sx.ABSENT:
        return
    ratio = math.sqrt(square_of_size(belief, modes, i) / before)
    variance = modes.covariance[2 + j, 2 + j]
    larger = min(1.0 / ratio, 1.0 / math.sqrt(variance))  # it is never less known than before the flight
    modes.mean[2 + j] = modes.about[j] + (modes.mean[2 + j] - modes.about[j]) / ratio
    for k in range(belief.size.numbers + 2):
        modes.covariance[2 + j, k] *= larger
        modes.covariance[k, 2 + j] *= larger
    for k in range(belief.size.states):
        fil.s[k, belief.size.number_at + j] *= ratio


@inner
def renew_numbers(belief, fil, dt):
    """Let the numbers of a mode fade towards the prior while its frequency is in doubt, dt [s].

    Of the information that the flight gave exp(-2 RENEWAL w var dt) is left, var being the variance of the relative
    frequency: data that were linearised so far off count so much less.  What a frequency's deviation did to the state
    and no longer tells goes from its sensitivities into P, so that the state's variance is the same; of a size, in
    which the state is linear, the sensitivities fade alone.
    """
    size, modes, p, s = belief.size, fil.modes, fil.p, fil.s
    for j in range(size.numbers):
        i, at = belief.mode_of[j], size.number_at + j
        f = number_of(belief, i, BY_FREQUENCY)
        if f == sx.ABSENT:
            continue
        doubt = belief.number_sigma[f] * belief.number_sigma[f] * modes.covariance[2 + f, 2 + f]
        keep = exp_of(-(RENEWAL * doubt * modes.now[i, M_FREQUENCY_0] * dt))
        old = modes.covariance[2 + j, 2 + j]
        new = old / (old + keep * keep * (1.0 - old))
        share = keep * old / new  # of the old deviation that the new one tells
        untold = old * (1.0 - share * keep) if j == f else 0.0
        moved = (1.0 - keep * keep * new / old) * modes.mean[2 + j]
        modes.mean[2 + j] -= moved
        for k in range(size.states):
            for m in range(size.states):
                p[k, m] += untold * (s[k, at] * s[m, at])
        for k in range(size.states):
            s[k, at] *= share
            fil.x[k] += s[k, at] * moved
        for k in range(size.numbers + 2):
            modes.covariance[2 + j, k] *= keep
            modes.covariance[k, 2 + j] *= keep
        modes.covariance[2 + j, 2 + j] = new


@kernel
def relinearise_modes(block):
    """Linearise the filter, with its state, about the modes' numbers as the flight shows them, unless it is there
    already; numbers that are profiles in time are set anew in any case."""
    belief, fil = block[0].fixed.belief, block[0].state.filter
    size, modes = belief.size, fil.modes
    away = size.swept == 1
    for j in range(size.numbers):
        std = math.sqrt(modes.covariance[2 + j, 2 + j])
        away = away or abs(modes.mean[2 + j] - modes.about[j]) > SETTLED * std
    for j in range(size.numbers):
        if not away:
            break
        wanted, sigma = modes.mean[2 + j], belief.number_sigma[j]
        if belief.number[j] == BY_FREQUENCY:
            wanted = min(max(wanted, (LEAST_FREQUENCY - 1.0) / sigma), (MOST_FREQUENCY - 1.0) / sigma)
        elif belief.number[j] == BY_DAMPING:
            wanted = max(wanted, -1.0 / sigma)
        step = wanted - modes.about[j]
        for i in range(size.states):
            fil.x[i] += fil.s[i, size.number_at + j] * step
        modes.about[j] += step
    if away:
        fil.step.h = 0.0
        modes.is_set = 0


@inner
def restart_numbers(belief, modes):
    """Set what is known of the numbers, and of a6 and k1 beside them, before the first sample."""
    for j in range(belief.size.numbers):
        modes.covariance[2 + j, 2 + j] = 1.0
    for j in range(2):
        modes.covariance[j, j] = sx.FIRST_STD * sx.FIRST_STD
