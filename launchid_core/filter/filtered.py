"""The filtered formulation: prediction-error estimates of a window from whitened innovations.

Each innovation is one row of a linear regression on (initial offset, terms); rows
are gathered over a block of samples and absorbed into square-root information
matrices: one per window (with the initial offset, so that only the window's own
data speak), one for the structure (with forgetting, over many windows), and one
per block for the tracker.
"""

import math

import numpy as np

from ..algebra.elementary import exp_of, log_of
from ..algebra.linsolve import absorb_columns, absorb_rows, apply_q_transposed, qr_factor, solve_triangle
from ..gate.ring import BETA_CMD, GAMMA, THETA, T
from ..kernels import inner
from ..model import N_NOISES
from .belief import A6, AT_BETA, AT_THETA, BLOCK_SHARE, GYRO_SCALE, K1, OFFSET, SATURATION
from .disturbances import spread_at
from .predictor import apply_h, begins_anew, correct, is_lost, is_outlier, predict, start_segment, take_command
from .states import LEVEL_CLAMPS, N_CHANNELS, N_STATES, RESTARTS, RUNNING
from .unknown_servo import doubt_of, first_column, note_servo
from .whiteness import forget_blocks, note_innovation, note_loss

BLOCK = 0.1             # s: the step of tracking, of change detection and of the check; in whole samples, one at least
WEAK_PRIOR = 1.0e-4     # 1/(relative deviation): a parameter without any data is 0 +- 10,000 times its nominal
LEVEL_PRIOR = 1.0 / 0.4**2  # declared noise levels are believed to a factor exp(0.4) = 1.5, one sigma
WIND_PRIOR = 1.0 / 0.7**2   # and the wind's to a factor 2
LEVEL_STEP_A_BLOCK = 0.05  # most that a log level moves in BLOCK: a jump of a6 or k1 is no noise (1 s for a factor 1.6)
WIND_STEP = 0.4         # and one of the wind: what follows a calm is wind within a second, or passes for sudden changes
LEAST_WIND = math.log(0.02)  # of a log level of the wind: lower ones change nothing, and wind may rise again
LEVEL_RELAXES = 0.97     # of a log level in BLOCK, while the model is contradicted: 3 s
RANK_TOLERANCE = 1.0e-12  # of the levels' information: below it a level is not known at all
LEVEL_MEMORY = 0.9995   # what is left after BLOCK of what was known: noise levels may change over minutes

# counts (i8) of an accumulator: rows in the block, samples and gaps in the window
BLOCK_ROWS, SAMPLES, BLOCK_GAPS = range(3)


@inner
def clear_window(size, acc):
    """Forget the window's information but for the weak prior on the terms, and what was declared of the servo."""
    acc.window[:, :] = 0.0
    for j in range(size.states, size.states + size.terms):
        acc.window[j, j] = WEAK_PRIOR
    for j in range(size.servo):
        acc.window[first_column(size) + j, first_column(size) + j] = 1.0
    set_identity(size, acc.psi)
    acc.counts[SAMPLES] = 0
    acc.counts[BLOCK_GAPS] = 0


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
    theta, beta = n + belief.term[AT_THETA], n + belief.term[AT_BETA]
    for k in range(N_STATES, n):
        w = 1.0 / np.sqrt(spread_at(belief, fil, k - N_STATES, t))
        acc.window[k, k] = w
        for j in range(n, last):
            acc.window[k, j] = w * fil.s[k, j]
        acc.window[k, last] = w * (fil.s[k, theta] * fil.p_bar[A6] + fil.s[k, beta] * fil.p_bar[K1] - fil.x[k])
        for j in range(belief.size.servo):
            acc.window[k, last] += w * fil.s[k, first_column(belief.size) + j] * fil.servo.about[j]


@inner
def forget_offset(belief, fil, acc, t):
    """The state is unknown again (a gap): keep what is known of the terms, drop the initial offset's rows."""
    for i in range(belief.size.states):
        for j in range(belief.size.columns):
            acc.window[i, j] = 0.0
    set_identity(belief.size, acc.psi)
    believe_nuisances(belief, fil, acc, t)


@inner
def begin_block(belief, fil, acc):
    """A block begins: the offset's sensitivities are the identity, the terms' are remembered."""
    n = belief.size.states
    set_identity(belief.size, fil.s[:])
    for i in range(n):
        acc.s_start[i, A6] = fil.s[i, n + belief.term[AT_THETA]]
        acc.s_start[i, K1] = fil.s[i, n + belief.term[AT_BETA]]


@inner
def reduce_block(size, acc, rows, work, theta, beta):
    """Triangles of the block's rows: of all columns, of (offset, theta, beta), and of (theta, beta), state known.

    rows (c, 3 b)  in  whitened innovations of a block of b samples, column by column; destroyed
    """
    c, n, width = size.columns, size.states, size.pair
    work.triangle[:, :] = 0.0
    absorb_rows(work.triangle[:], rows, c, acc.counts[BLOCK_ROWS])
    for j in range(n):
        work.columns[j] = j
    work.columns[n], work.columns[n + 1], work.columns[n + 2] = n + theta, n + beta, c - 1
    work.pair[:, :] = 0.0
    absorb_columns(work.pair[:], work.triangle[:], work.columns[:], width, c, work.scratch[:])
    reduce_pair(size, work)


@inner
def reduce_pair(size, work):
    """Reduce work.pair (offset, theta, beta) to work.block (theta, beta), the offset being 0."""
    width, n = size.pair, size.states
    for j in range(3):
        work.columns[j] = n + j
    work.block[:, :] = 0.0
    absorb_columns(work.block[:], work.pair[:], work.columns[:], 3, width - 1, work.scratch[:])


@inner
def absorb_block(size, acc, work, about):
    """Add the block to the window's information, its offset carried back to the window's start.

    about (servo,)  in  deviations of the servo that its rows are linearised about
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
            copy[width - 1, i] += work.triangle[i, first_column(size) + j] * about[j]
    absorb_rows(acc.window[:], copy, width, width)


@inner
def measured(belief, row, channel):
    """theta, theta_dot or beta of a ring row without the sensor errors that are known."""
    z = row[THETA + channel] - belief.constant[OFFSET + channel]
    return z / belief.constant[GYRO_SCALE] if channel == 1 else z


@inner
def filter_sample(belief, profile, air, fil, work, acc, rows, check, row, max_gap):
    """One sample of the ring into the predictor; its innovations become rows of the block.

    rows (c, 3 b)  inout  of the block
    row (7,)       in     a row of the ring
    """
    t = row[T]
    if begins_anew(belief, fil, t, max_gap):
        acc.counts[BLOCK_GAPS] += int(fil.time[RUNNING])  # a gap, unless it is the first sample of all
        fil.note[RESTARTS] += int(fil.time[RUNNING])
        if is_lost(belief, fil):
            note_loss(check, t)
        start_segment(belief, fil, t, measured(belief, row, 0), measured(belief, row, 1), measured(belief, row, 2),
                      row[GAMMA])
        acc.s_start[:, :] = 0.0
        forget_offset(belief, fil, acc, t)
        forget_blocks(check)
    else:
        predict(belief, profile, air, fil, work, t, row[BETA_CMD], row[GAMMA])
    n, last = belief.size.states, belief.size.sensitivities
    theta, beta = n + belief.term[AT_THETA], n + belief.term[AT_BETA]
    for channel in range(3):
        if np.isnan(row[THETA + channel]) or abs(row[THETA + channel]) >= belief.constant[SATURATION + channel]:
            continue
        z = measured(belief, row, channel)
        r = belief.variance[channel] * exp_of(2.0 * fil.level[channel])
        partner = belief.partner[channel]
        doubt, out = 0.0, work.out[:]
        if belief.size.servo > 0:
            apply_h(fil.s[:], channel, partner, out, last)
            doubt = doubt_of(belief.size, fil.servo, out[first_column(belief.size):])
        if is_outlier(fil, channel, partner, z, r + doubt):
            continue
        e, variance = correct(belief.size, fil, work, channel, partner, z, r, acc.score, acc.information)
        scale = 1.0 / np.sqrt(variance)
        k = acc.counts[BLOCK_ROWS]
        for j in range(last):
            rows[j, k] = out[j] * scale
        rows[last, k] = (e + out[theta] * fil.p_bar[A6] + out[beta] * fil.p_bar[K1]) * scale
        acc.counts[BLOCK_ROWS] = k + 1
        note_innovation(check, channel, e * scale, out[theta] * scale, out[beta] * scale)
        note_servo(belief, check, channel, out, scale)
    acc.counts[SAMPLES] += 1
    take_command(belief.constant, belief.size.servo, fil, row[BETA_CMD])


@inner
def is_full(acc, rows):
    """Whether the block's rows (c, 3 b) leave no room for another sample's."""
    return acc.counts[BLOCK_ROWS] > rows.shape[1] - N_CHANNELS


@inner
def left_after(share, left):
    """The share that is left after `share` times BLOCK where `left` is after one."""
    return left * exp_of((share - 1.0) * log_of(left))


@inner
def update_levels(belief, fil, acc, work):
    """One step of Fisher scoring of the log noise levels with the block's score, then clear it."""
    n = belief.size.levels
    share = belief.constant[BLOCK_SHARE]
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
        fil.note[LEVEL_CLAMPS] += int(abs(work.step[k]) > most)
        if is_wind:
            move_wind_level(n, fil, acc, j, moved)
        else:
            fil.level[j] += moved


@inner
def move_wind_level(levels, fil, acc, j, moved):
    """A log level of the wind moves by so much, and what is known of it is carried over.

    The wind may not blow at all, which no log level is: what calm air tells of a level, in nats, is in proportion to
    the level itself (the frequencies at which such a wind would show are), so information about its square root keeps
    its value, and about its logarithm it falls as the level does.  Kept as it was made, at levels far above, it would
    stop the fall: after 70 s of calm air at a twentieth of the declared, where a fiftieth can be told from it.  Where
    the level stands at its least, what is known of it falls on, so that it rises with the first gust.
    """
    fil.level[j] = max(fil.level[j] + moved, LEAST_WIND)
    share = exp_of(0.5 * moved)
    for i in range(levels):
        acc.level_information[i, j] *= share
        acc.level_information[j, i] *= share


@inner
def relax_levels(belief, fil, acc):
    """A model that is contradicted teaches nothing about noise: the levels go back towards the declared."""
    left = left_after(belief.constant[BLOCK_SHARE], LEVEL_RELAXES)
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
        fil.x[i] += (fil.s[i, n + belief.term[AT_THETA]] * (a - fil.p_bar[A6])
                     + fil.s[i, n + belief.term[AT_BETA]] * (k - fil.p_bar[K1]))
    fil.p_bar[A6], fil.p_bar[K1] = a, k


@inner
def jump(belief, fil, carried, blocks, before_a, before_k, after_a, after_k):
    """The parameters jumped: move state and linearisation, forget how the state depended on the values before.

    carried (n, 2) in  sensitivities at the onset, carried to now
    blocks         in  since the onset; it lies somewhere within the first, which leaves the state uncertain by what
                       one block of the new parameters does to it, uniformly
    """
    n = belief.size.states
    theta, beta = n + belief.term[AT_THETA], n + belief.term[AT_BETA]
    relinearise(belief, fil, before_a, before_k)
    for i in range(n):
        fil.s[i, theta] -= carried[i, A6]
        fil.s[i, beta] -= carried[i, K1]
    for i in range(n):
        for j in range(n):
            slip_i = fil.s[i, theta] * (after_a - before_a) + fil.s[i, beta] * (after_k - before_k)
            slip_j = fil.s[j, theta] * (after_a - before_a) + fil.s[j, beta] * (after_k - before_k)
            fil.p[i, j] += slip_i * slip_j / (12.0 * blocks * blocks)
    relinearise(belief, fil, after_a, after_k)
