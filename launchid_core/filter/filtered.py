"""The filtered formulation: prediction-error estimates of a window from whitened innovations.

Each innovation is one row of a linear regression on (initial offset, terms).  Rows are gathered over a block of samples
and absorbed into square-root information matrices: one per window (with the initial offset, so that only the window's
own data speak; solved at its close), one for the structure (with forgetting, over many windows), one per block for the
tracker.
"""

import math

import numpy as np

from ..algebra.elementary import exp_of, log_of
from ..algebra.linsolve import absorb_columns, absorb_rows, apply_q_transposed, carry_columns, qr_factor, solve_triangle
from ..gate import window as wn
from ..gate.ring import BETA_CMD, GAMMA, THETA, T, centre_of
from ..gate.window import knows_nothing, knows_one_direction
from ..kernels import inner, kernel
from ..model import N_NOISES
from . import kalman as kf
from . import modes as md
from . import servo as sv
from . import states as sx
from .whiteness import forget_blocks, note_loss, queue_block

BLOCK = 0.1             # s: the step of tracking, of change detection and of the check; in whole samples, one at least
WEAK_PRIOR = 1.0e-4     # 1/(relative deviation): a parameter without any data is 0 +- 10,000 times its nominal
LEVEL_PRIOR = 1.0 / 0.4**2  # declared noise levels are believed to a factor exp(0.4) = 1.5, one sigma
WIND_PRIOR = 1.0 / 0.7**2   # and the wind's to a factor 2
LEVEL_STEP_A_BLOCK = 0.05  # most that a log level moves in BLOCK: a jump of a6 or k1 is no noise (1 s for a factor 1.6)
WIND_STEP = 0.4         # and one of the wind: what follows a calm is wind within a second, or passes for sudden changes
LEAST_WIND = math.log(0.02)  # of a log level of the wind: lower ones change nothing, and wind may rise again
LEVEL_RELAXES = 0.97     # of a log level in BLOCK, while the model is contradicted: 3 s
LEAST_DRIFT = 1.0e-9    # relative, 1/s: of one that is declared beside another that is not
RANK_TOLERANCE = 1.0e-12  # of the levels' information: below it a level is not known at all
OFFSET_TIME = 6000.0    # s: in it an offset may change by its whole spread, one sigma; by 11 % in 70 s
ABSURD_LEVEL = 12.0     # of a noise level's logarithm: a factor 160,000 either way is no sensor's
LEVEL_MEMORY = 0.9995   # what is left after BLOCK of what was known: noise levels may change over minutes


@inner
def span_of(fixed, state):
    """Return (length [s], end [s]) of the block that was gathered."""
    t_end = state.filter.time.last
    return t_end - state.acc.start + fixed.limits.period, t_end


@inner
def clear_window(size, acc):
    """Forget the window's information but for the weak prior on the terms, and what was declared of the servo."""
    acc.window[:, :] = 0.0
    for j in range(size.states, size.states + size.terms):
        acc.window[j, j] = WEAK_PRIOR
    for j in range(size.servo + size.numbers):
        acc.window[size.servo_at + j, size.servo_at + j] = 1.0
    set_identity(size, acc.psi)
    acc.counts.samples = 0
    acc.counts.gaps = 0


@inner
def set_identity(size, matrix):
    """Set the first n rows and columns of a matrix to the identity."""
    for i in range(size.states):
        for j in range(size.states):
            matrix[i, j] = 1.0 if i == j else 0.0


@inner
def believe_nuisances(belief, fil, acc, t):
    """Enter what is declared of the nuisances at t [s], where the offset begins, as rows of the window: an offset d and
    deviations p of the terms make a nuisance x + s (p - p_bar) + d, which is 0 with its declared spread.

    Nothing else of the past enters a window.
    """
    n, last = belief.size.states, belief.size.sensitivities
    theta, beta = n + belief.size.theta, n + belief.size.beta
    for k in range(sx.N_STATES, sx.N_STATES + belief.size.nuisances):
        w = 1.0 / np.sqrt(kf.spread_at(belief, fil, k - sx.N_STATES, t))
        acc.window[k, k] = w
        for j in range(n, last):
            acc.window[k, j] = w * fil.s[k, j]
        acc.window[k, last] = w * (fil.s[k, theta] * fil.p_bar[sx.A6] + fil.s[k, beta] * fil.p_bar[sx.K1] - fil.x[k])
        for j in range(belief.size.servo):
            acc.window[k, last] += w * fil.s[k, belief.size.servo_at + j] * fil.servo.about[j]
        for j in range(belief.size.numbers):
            acc.window[k, last] += w * fil.s[k, belief.size.number_at + j] * fil.modes.about[j]


@inner
def free_offsets(belief, fil, span):
    """Let each offset wander by what it may change in `span` [s].

    An offset is a constant to a window.  Over a flight no misalignment and no bias is, and a filter that believed so
    would hold on for ever to how an offset and a6 once were related.
    """
    for k in range(sx.N_STATES, sx.N_STATES + belief.size.nuisances):
        spread = belief.spread[k - sx.N_STATES]
        if belief.level[k - sx.N_STATES] < 0:
            fil.p[k, k] += spread * spread * span / OFFSET_TIME


@inner
def restart_window(fixed, state, t):
    """Drop this block and the window so far; begin one after t [s]."""
    clear_window(fixed.belief.size, state.acc)
    believe_nuisances(fixed.belief, state.filter, state.acc, t)
    state.acc.score[:] = 0.0
    state.acc.information[:, :] = 0.0


@inner
def begin_block(belief, fil, acc):
    """Begin a block: the sensitivities for the offset become the identity, those for the terms go on."""
    n = belief.size.states
    set_identity(belief.size, fil.s[:])
    for i in range(n):
        acc.s_start[i, sx.A6] = fil.s[i, n + belief.size.theta]
        acc.s_start[i, sx.K1] = fil.s[i, n + belief.size.beta]


@kernel
def reduce_rows(block, rows):
    """Triangles of the rows gathered: of all columns, of (offset, theta, beta), and of (theta, beta), state known.

    rows (c, 3 b)  in  whitened innovations of a block of b samples, column by column; destroyed
    """
    fixed, state, work, acc = block[0].fixed, block[0].state, block[0].work.acc, block[0].state.acc
    size, columns = fixed.belief.size, block[0].work.acc.columns[:]
    n, c = size.states, size.columns
    work.triangle[:, :] = 0.0
    absorb_rows(work.triangle[:], rows, c, acc.counts.rows)
    if size.numbers == 0:  # else `update_numbers` does so
        for j in range(n):
            columns[j] = j
        columns[n], columns[n + 1], columns[n + 2] = n + size.theta, n + size.beta, c - 1
        work.pair[:, :] = 0.0
        absorb_columns(work.pair[:], work.triangle[:], columns, size.pair, c, work.scratch[:])
        reduce_pair(size, work)
    carry_columns(state.filter.s[:], n, acc.psi[:], n, work.column[:])
    queue_block(state.check, state.filter.level, state.filter.p_bar, state.bank.total)


@inner
def reduce_pair(size, work):
    """Fill work.block (3, 3), triangle of (theta, beta, right-hand side), from work.pair, which has the offset, too."""
    width, n = size.pair, size.states
    for j in range(3):
        work.columns[j] = n + j
    work.block[:, :] = 0.0
    absorb_columns(work.block[:], work.pair[:], work.columns[:], 3, width - 1, work.scratch[:])


@inner
def absorb_block(size, acc, work, about, numbers):
    """Add the block to the window's information, its offset carried back to the window's start.

    about (servo,), numbers (numbers,)  in  deviations of servo and modes that its rows are linearised about
    """
    width, n = size.columns, size.states
    copy = work.scratch[:width * width].reshape((width, width))
    for i in range(width):
        for c in range(n):
            value = 0.0
            for k in range(i, n):
                value += work.triangle[i, k] * acc.psi[k, c]
            copy[c, i] = value
        for c in range(n, width):
            copy[c, i] = work.triangle[i, c]
        for j in range(size.servo):
            copy[width - 1, i] += work.triangle[i, size.servo_at + j] * about[j]
        for j in range(size.numbers):
            copy[width - 1, i] += work.triangle[i, size.number_at + j] * numbers[j]
    absorb_rows(acc.window[:], copy, width, width)


@inner
def measured(belief, row, channel):
    """theta, theta_dot or beta of a ring row without the sensor errors that are known."""
    z = row[THETA + channel] - belief.constant.offset[channel]
    return z / belief.constant.gyro_scale if channel == 1 else z


@inner
def doubt_of_prediction(belief, modes, fil, out):
    """Return the variance that what is not known of servo and modes adds to a prediction of sensitivities `out`."""
    doubt = 0.0
    if belief.size.servo > 0:
        doubt = sv.doubt_of(belief.size, fil.servo, out[belief.size.servo_at:])
    if modes is not None:
        doubt += md.doubt_of_modes(belief, fil.modes, out[belief.size.number_at:])
    return doubt


@inner
def prediction_of(belief, shown, fil, work, channel, z):
    """Return z - H x and H P H' of a channel; P H' into work.column."""
    partner, bendings = belief.partner[channel], belief.size.modes - belief.size.sloshes
    kf.apply_h(belief, shown, fil.p[:], bendings, channel, work.column[:], belief.size.states)
    if shown is not None:
        return (z - kf.shown_of(belief, shown, fil.x[:], bendings, channel),
                kf.shown_of(belief, shown, work.column[:], bendings, channel))
    e, predicted = z - fil.x[channel], fil.p[channel, channel]
    if partner >= 0:
        e -= fil.x[partner]
        predicted += 2.0 * fil.p[channel, partner] + fil.p[partner, partner]
    return e, predicted


@inner
def note_unknown(size, check, channel, out, scale):
    """Add to the block's check what a measurement depends on servo and modes' numbers, in its standard deviations."""
    for j in range(size.servo):
        check.servo[channel, j] += out[size.servo_at + j] * scale
    for j in range(size.numbers):
        check.numbers[channel, j] += out[size.number_at + j] * scale


@inner
def filter_sample(belief, profile, air, modes, known, shown, fil, work, acc, rows, check, row, max_gap):
    """Predict to a `row` of the ring, correct by its measurements; its whitened innovations join the block's `rows`."""
    t = row[T]
    if kf.begins_anew(belief, fil, t, max_gap):
        acc.counts.gaps += int(fil.time.running)  # a gap, unless it is the first sample of all
        fil.note.restarts += int(fil.time.running)
        if kf.is_lost(belief, fil):
            note_loss(check, t)
        kf.start_segment(belief, fil, t, measured(belief, row, 0), measured(belief, row, 1), measured(belief, row, 2),
                         row[GAMMA])
        acc.s_start[:, :] = 0.0
        for i in range(belief.size.states):  # the offset is another, what is known of the terms stays
            for j in range(belief.size.columns):
                acc.window[i, j] = 0.0
        set_identity(belief.size, acc.psi)
        if modes is not None:
            md.start_modes(belief, modes, shown, fil)
        believe_nuisances(belief, fil, acc, t)
        forget_blocks(check)
    else:
        kf.predict(belief, profile, air, modes, known, fil, work, t, row[BETA_CMD], row[GAMMA])
    n, last = belief.size.states, belief.size.sensitivities
    theta, beta = n + belief.size.theta, n + belief.size.beta
    for channel in range(3):
        if np.isnan(row[THETA + channel]) or abs(row[THETA + channel]) >= belief.constant.saturation[channel]:
            continue
        z = measured(belief, row, channel)
        r = belief.variance[channel] * exp_of(2.0 * fil.level[channel])
        out = work.out[:]
        kf.apply_h(belief, shown, fil.s[:], belief.size.modes - belief.size.sloshes, channel, out, last)
        doubt = doubt_of_prediction(belief, modes, fil, out)
        e, predicted = prediction_of(belief, shown, fil, work, channel, z)
        outlier = e * e > kf.OUTLIER * kf.OUTLIER * (predicted + (r + doubt))
        fil.outliers[channel] = fil.outliers[channel] + 1 if outlier else 0
        fil.note.outliers += int(outlier)
        if outlier:
            continue
        variance = predicted + r  # S
        kf.correct(belief, shown, fil, work, channel, e, variance, r, acc.score, acc.information)
        scale = 1.0 / np.sqrt(variance)
        k = acc.counts.rows
        for j in range(last):
            rows[j, k] = out[j] * scale
        rows[last, k] = (e + out[theta] * fil.p_bar[sx.A6] + out[beta] * fil.p_bar[sx.K1]) * scale
        acc.counts.rows = k + 1
        check.innovation[channel] += e * scale
        check.for_a6[channel] += out[theta] * scale
        check.for_k1[channel] += out[beta] * scale
        check.seen[channel] += 1
        note_unknown(belief.size, check, channel, out, scale)
    acc.counts.samples += 1
    kf.take_command(belief, known, fil, row[BETA_CMD])


@inner
def left_after(share, left):
    """Return left^share: what is left after `share` times BLOCK of what `left` is left of after one."""
    return left * exp_of((share - 1.0) * log_of(left))


@inner
def update_levels(belief, fil, acc, work):
    """One step of Fisher scoring of the log noise levels with the block's score, then clear it."""
    n = belief.size.levels
    share = belief.constant.block_share
    memory = left_after(share, LEVEL_MEMORY)
    square = work.square[:n * n].reshape((n, n))
    for i in range(n):
        for j in range(n):
            prior = belief.prior[i] if i == j else 0.0
            old = memory * (acc.level_information[i, j] - prior) + prior
            acc.level_information[i, j] = old + acc.information[i, j]
            square[j, i] = acc.level_information[i, j]
            acc.information[i, j] = 0.0
        work.right[i] = acc.score[i]
        acc.score[i] = 0.0
    rank = qr_factor(square, work.order[:n], work.tau[:], RANK_TOLERANCE)
    if rank < n:
        return
    apply_q_transposed(square, work.tau[:], n, work.right[:])
    solve_triangle(square, n, work.right[:], work.step[:])
    for k in range(n):
        j = work.order[k]
        is_wind = n > N_NOISES and j >= N_NOISES
        most = share * (WIND_STEP if is_wind else LEVEL_STEP_A_BLOCK)
        moved = min(max(work.step[k], -most), most)
        fil.note.level_clamps += int(abs(work.step[k]) > most)
        if is_wind:
            move_wind_level(n, fil, acc, j, moved)
        else:
            fil.level[j] += moved


@inner
def move_wind_level(levels, fil, acc, j, moved):
    """A log level of the wind moves by so much, and what is known of it is carried over.

    Information about the square root of a level keeps its value, so about its logarithm it falls as the level does
    (docs/method.md, "Wind, offsets, drift"); it falls on where the level stands at its least.
    """
    fil.level[j] = max(fil.level[j] + moved, LEAST_WIND)
    share = exp_of(0.5 * moved)
    for i in range(levels):
        acc.level_information[i, j] *= share
        acc.level_information[j, i] *= share


@inner
def relax_levels(belief, fil, acc):
    """A model that is contradicted teaches nothing about noise: the levels go back towards the declared."""
    left = left_after(belief.constant.block_share, LEVEL_RELAXES)
    for i in range(belief.size.levels):
        fil.level[i] *= left
        acc.score[i] = 0.0
        for j in range(belief.size.levels):
            acc.information[i, j] = 0.0
            acc.level_information[i, j] = belief.prior[i] if i == j else 0.0


@inner
def relinearise(belief, fil, a, k):
    """Move the point of linearisation to relative deviations (a, k), and the state with it."""
    n = belief.size.states
    for i in range(n):
        fil.x[i] += (fil.s[i, n + belief.size.theta] * (a - fil.p_bar[sx.A6])
                     + fil.s[i, n + belief.size.beta] * (k - fil.p_bar[sx.K1]))
    fil.p_bar[sx.A6], fil.p_bar[sx.K1] = a, k


@inner
def jump(belief, fil, carried, blocks, before_a, before_k, after_a, after_k):
    """The parameters jumped: move state and linearisation, forget how the state depended on the values before.

    carried (n, 2) in  sensitivities at the onset, carried to now
    blocks         in  since the onset; it lies somewhere within the first, which leaves the state uncertain by what
                       one block of the new parameters does to it, uniformly
    """
    n = belief.size.states
    theta, beta = n + belief.size.theta, n + belief.size.beta
    relinearise(belief, fil, before_a, before_k)
    for i in range(n):
        fil.s[i, theta] -= carried[i, sx.A6]
        fil.s[i, beta] -= carried[i, sx.K1]
    for i in range(n):
        for j in range(n):
            slip_i = fil.s[i, theta] * (after_a - before_a) + fil.s[i, beta] * (after_k - before_k)
            slip_j = fil.s[j, theta] * (after_a - before_a) + fil.s[j, beta] * (after_k - before_k)
            fil.p[i, j] += slip_i * slip_j / (12.0 * blocks * blocks)
    relinearise(belief, fil, after_a, after_k)


@inner
def is_drifting(belief):
    """Whether a6 or k1 may leave the profile within a window."""
    return belief.constant.a6_drift > 0.0 or belief.constant.k1_drift > 0.0


@inner
def begin_columns(belief, columns):
    """Fill `columns` with those that are solved for first, offset, servo, modes' numbers, and slopes where there are
    any; return how many they are."""
    size = belief.size
    m = size.states + size.servo + size.numbers
    for j in range(size.states):
        columns[j] = j
    for j in range(size.servo + size.numbers):
        columns[size.states + j] = size.servo_at + j
    if is_drifting(belief):
        columns[m], columns[m + 1] = size.sensitivities - sx.N_TESTS, size.sensitivities - sx.N_TESTS + 1
        m += sx.N_SLOPES
    return m


@inner
def reduce_columns(belief, acc, work, age, r):
    """Triangle r (m, m) out, at the head of work.scratch, of the first m columns of the window that work.columns names.

    A slope's column is that of the deviation at the first sample; taken about the window's centre, `age` [s] later, the
    deviations are those of the centre.  Each slope has its declared spread as one more row.
    """
    m, size = r.shape[0], belief.size
    width, slopes = size.columns, size.sensitivities - sx.N_TESTS
    rt = work.scratch[m * m:m * m + m * width].reshape((m, width))
    for j in range(m):
        column = work.columns[j]
        for i in range(width):
            rt[j, i] = acc.window[i, column]
        if is_drifting(belief) and slopes <= column < slopes + sx.N_SLOPES:
            of = size.states + (size.theta if column == slopes else size.beta)
            for i in range(width):
                rt[j, i] -= age * acc.window[i, of]
    r[:, :] = 0.0
    if is_drifting(belief):
        at = size.states + size.servo + size.numbers
        r[at, at] = 1.0 / max(belief.constant.a6_drift, LEAST_DRIFT)
        r[at + 1, at + 1] = 1.0 / max(belief.constant.k1_drift, LEAST_DRIFT)
    absorb_rows(r, rt, m, width)


@inner
def solve_absent(belief, acc, work, active, term, age):
    """Return (coefficient, standard deviation) of a term beside the active ones, from what `solve_window` left."""
    size = belief.size
    n, m = size.states, begin_columns(belief, work.columns[:])
    for j in range(size.terms):
        if active[j] and j != term:
            work.columns[m] = n + j
            m += 1
    work.columns[m], work.columns[m + 1] = n + term, size.sensitivities
    r = work.scratch[:(m + 2) * (m + 2)].reshape((m + 2, m + 2))
    reduce_columns(belief, acc, work, age, r)
    return r[m, m + 1] / r[m, m], 1.0 / abs(r[m, m])


@inner
def solve_window(belief, acc, work, active, age):
    """Least squares of the window's active terms on its own data: of offset, servo, slopes, active terms, tests.

    active (q,) in
    age    in  [s] of the window's centre, since the first sample
    work   out  coefficient (theta's and beta's are relative deviations; 0 for inactive terms), deviation (NaN where
                inactive)
    Returns by how much the tests would reduce the sum of squares beside the slopes: chi square of two if the model is
    true.
    """
    n = belief.size.states
    theta, beta = belief.size.theta, belief.size.beta
    columns, coefficient, deviation = work.columns[:], work.coefficient, work.deviation
    first = begin_columns(belief, columns)
    solved = first - n - belief.size.servo - belief.size.numbers  # slopes that are solved for
    tests, m = sx.N_TESTS - solved, first
    for j in range(belief.size.terms):
        if active[j] and j != theta and j != beta:
            columns[m] = n + j
            m += 1
    if active[theta]:
        columns[m] = n + theta
        m += 1
    if active[beta]:
        columns[m] = n + beta
        m += 1
    for j in range(tests + 1):
        columns[m + j] = belief.size.sensitivities - sx.N_TESTS + solved + j
    m += tests + 1
    r = work.scratch[:m * m].reshape((m, m))
    reduce_columns(belief, acc, work, age, r)
    coefficient[:] = 0.0
    last = m - tests - 2  # of the terms
    for k in range(last, first - 1, -1):
        value = r[k, m - 1]
        for j in range(k + 1, last + 1):
            value -= r[k, j] * coefficient[columns[j] - n]
        coefficient[columns[k] - n] = value / r[k, k]
    deviation.a6 = np.nan
    deviation.k1 = np.nan
    deviation.correlation = np.nan
    if active[theta] and active[beta]:
        a, b, c = r[last - 1, last - 1], r[last - 1, last], r[last, last]
        deviation.a6 = np.sqrt(1.0 + (b / c) * (b / c)) / abs(a)
        deviation.k1 = 1.0 / abs(c)
        deviation.correlation = -(b / abs(c)) / np.sqrt(1.0 + (b / c) * (b / c)) * (1.0 if a > 0.0 else -1.0)
    elif active[theta]:
        deviation.a6 = 1.0 / abs(r[last, last])
    elif active[beta]:
        deviation.k1 = 1.0 / abs(r[last, last])
    unexplained = 0.0
    for k in range(last + 1 + sx.N_SLOPES - solved, m - 1):
        unexplained += r[k, m - 1] * r[k, m - 1]
    return unexplained


@kernel
def limit_terms(block, profile):
    """95 % limits of the terms that were left out of a valid window; an absent a6 or k1 is 0 with the standard
    deviation that it would have."""
    belief, state, work, out = block[0].fixed.belief, block[0].state, block[0].work.acc, block[0].state.outcome
    if out.status == wn.OK:
        t_centre = centre_of(block[0].fixed, state)
        a6, k1 = sx.profile_at(profile, t_centre)
        for j in range(belief.size.terms):
            is_a6, is_k1 = j == belief.size.theta, j == belief.size.beta
            if state.active[j] and (is_a6 or is_k1):
                continue
            value, std = solve_absent(belief, state.acc, work, state.active[:], j,
                                      t_centre - state.filter.time.first)
            if state.active[j]:
                out.std[j] = std
                continue
            if is_a6:
                value, std = a6 * (1.0 + value), abs(a6) * std
                out.a6_std = std
            elif is_k1:
                value, std = k1 * (1.0 + value), abs(k1) * std
                out.k1_std = std
            out.absent[j] = abs(value) + wn.INTERVAL * std


@inner
def report_window(belief, profile, state, work, t_centre):
    """Relative deviations into a6, k1 and their standard deviations at the window's centre; returns the status."""
    out, coefficient = state.outcome, work.coefficient
    theta, beta = belief.size.theta, belief.size.beta
    std_a, std_k, correlation = work.deviation.a6, work.deviation.k1, work.deviation.correlation
    a6, k1 = sx.profile_at(profile, t_centre)
    out.a6_bound, out.k1_bound = abs(a6) * std_a, abs(k1) * std_k
    out.condition = np.sqrt((1.0 + abs(correlation)) / (1.0 - abs(correlation)))
    if knows_nothing(std_a, std_k):
        return wn.LOW_INFORMATION
    if state.check.in_window == 1:
        return wn.MODEL
    if knows_one_direction(std_a, std_k, correlation):
        return wn.SEPARATION
    for j in range(belief.size.terms):
        out.xi[j, wn.ATTITUDE] = coefficient[j]
        out.support[j, wn.ATTITUDE] = state.active[j]
    out.xi[theta, wn.ATTITUDE] = a6 * (1.0 + coefficient[theta]) if state.active[theta] else 0.0
    out.xi[beta, wn.ATTITUDE] = k1 * (1.0 + coefficient[beta]) if state.active[beta] else 0.0
    out.a6, out.k1 = out.xi[theta, wn.ATTITUDE], out.xi[beta, wn.ATTITUDE]
    out.a6_std, out.k1_std = out.a6_bound, out.k1_bound
    if state.active[theta]:
        out.std[theta] = out.a6_std
    if state.active[beta]:
        out.std[beta] = out.k1_std
    out.correlation = correlation if a6 * k1 > 0.0 else -correlation  # a product leaves a NaN's sign open
    if not np.isfinite(out.a6 + out.k1):
        return wn.NUMERICS
    return wn.OK


# ---- servo and modes that are not known; what cannot be


@kernel
def update_servo(block):
    """Add what the block says of the servo to what is known of it; what is not known of it widens what the block says
    of a6 and k1, and is no noise.  While the model is contradicted what was learned of it fades as the levels do."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    belief, fil, acc, servo = fixed.belief, state.filter, state.acc, state.filter.servo
    sv.widen_pair(belief, fil, work.acc)
    reduce_pair(belief.size, work.acc)
    unknown = 0.0  # of the block's expected squares
    for i in range(belief.size.columns):
        row = work.acc.triangle[i]
        unknown += sv.doubt_of(belief.size, servo, row[belief.size.servo_at:])
    if unknown / max(acc.counts.rows, 1) > sv.UNSETTLED:
        acc.score[:] = 0.0
        acc.information[:, :] = 0.0
    if state.check.raised == 1:
        sv.fade_servo(belief.size, servo, work.acc, left_after(belief.constant.block_share, LEVEL_RELAXES))
    sv.learn_servo(belief, fil, work.acc)
    sv.solve_servo(belief.size, servo)


@kernel
def update_numbers(block):
    """Add what the block says of the modes' numbers to what is known of them, as `update_servo` does of the servo's."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    belief, fil, acc, modes = fixed.belief, state.filter, state.acc, state.filter.modes
    md.widen_pair(belief, fil, work.acc)
    reduce_pair(belief.size, work.acc)
    unknown = 0.0
    for i in range(belief.size.columns):
        row = work.acc.triangle[i]
        unknown += md.doubt_of_modes(belief, modes, row[belief.size.number_at:])
    if unknown / max(acc.counts.rows, 1) > sv.UNSETTLED:
        acc.score[:] = 0.0
        acc.information[:, :] = 0.0
    dt, _ = span_of(fixed, state)
    if state.check.raised == 1:
        md.forget_numbers(belief, modes, left_after(belief.constant.block_share, LEVEL_RELAXES))
    md.age_numbers(belief, modes, dt)
    md.learn_numbers(belief, fil, work.acc)
    md.renew_numbers(belief, fil, dt)


@inner
def is_sound(size, fil, total):
    """Whether what is carried over the whole flight can be: all finite, no variance below 0, no absurd noise level."""
    sound = np.isfinite(total.mean_a6 + total.mean_k1 + total.cov + total.var_a6 + total.var_k1)
    sound = sound and total.var_a6 >= 0.0 and total.var_k1 >= 0.0
    for i in range(size.states):
        sound = sound and np.isfinite(fil.x[i])
        for j in range(size.states):
            sound = sound and np.isfinite(fil.p[i, j])
    for j in range(size.servo):
        sound = sound and np.isfinite(fil.servo.mean[j])
    for j in range(size.numbers):
        sound = sound and np.isfinite(fil.modes.mean[2 + j])
    for k in range(size.levels):
        sound = sound and abs(fil.level[k]) <= ABSURD_LEVEL
    return sound
