"""The filtered formulation: prediction-error estimates of a window from whitened innovations.

Each innovation is one row of a linear regression on (initial offset, terms); rows
are gathered over a block of samples and absorbed into square-root information
matrices: one per window (with the initial offset, so that only the window's own
data speak), one for the structure (with forgetting, over many windows), and one
per block for the tracker.
"""

from typing import NamedTuple

import numpy as np

from .belief import SATURATION
from .kernels import kernel
from .linsolve import absorb_rows, apply_q_transposed, qr_factor, solve_triangle
from .memory import take, take2
from .model import N_NOISES
from .predictor import (
    MAX_OUTLIERS,
    correct,
    is_outlier,
    predict,
    start_segment,
    take_command,
)
from .ring import BETA, BETA_CMD, THETA, THETA_DOT, T
from .status import EstimateStatus

BLOCK = 10              # samples per block: 0.1 s at 100 Hz, the step of tracking and of change detection
N_OFFSET = 4            # columns of the initial offset
PAIR = N_OFFSET + 3     # offset, theta, beta, right-hand side
WEAK_PRIOR = 1.0e-4     # 1/(relative deviation): a parameter without any data is 0 +- 10,000 times its nominal
LEVEL_PRIOR = 1.0 / 0.4**2  # declared noise levels are believed to a factor exp(0.4) = 1.5, one sigma
LEVEL_STEP = 0.05       # most that a log level moves in a block: a jump of a6 or k1 is no noise (1 s for a factor 1.6)
LEVEL_MEMORY = 0.9995   # forgetting per block: noise levels may change over minutes

OK = int(EstimateStatus.OK)
LOW_INFORMATION = int(EstimateStatus.LOW_INFORMATION)
NUMERICS = int(EstimateStatus.NUMERICS)
SHORT = int(EstimateStatus.SHORT)
GAP = int(EstimateStatus.GAP)


class Accumulator(NamedTuple):
    """Square-root information and the rows on their way into it.  n = 4 + q + 1 columns, right-hand side last.

    The initial offset's sensitivities restart with every block; `psi` carries them back to the window's start.
    """

    window: np.ndarray       # (n, n) of the current window: offset at its start, terms
    triangle: np.ndarray     # (n, n) of the current block: offset at its start, terms
    pair: np.ndarray         # (7, 7) of the block: offset, theta, beta, right-hand side
    block: np.ndarray        # (3, 3) of the block, the state known: theta, beta, right-hand side
    psi: np.ndarray          # (4, 4) transition of an offset from the window's start to the block's
    product: np.ndarray      # (4, 4) scratch
    s_start: np.ndarray      # (4, 2) sensitivities for theta and beta at the block's start
    rows: np.ndarray         # (n, 3 BLOCK) whitened innovations of the block, column by column
    scratch: np.ndarray      # (2 * n * n,)
    counts: np.ndarray       # (3,) int64: rows in the block, samples and gaps in the window
    score: np.ndarray        # (5,) of the noise levels over the block
    information: np.ndarray  # (5, 5) of the noise levels over the block
    level_information: np.ndarray  # (5, 5) over the flight, prior included
    square: np.ndarray       # (5, 5) scratch
    order: np.ndarray        # (5,) int64 scratch
    tau: np.ndarray          # (5,) scratch
    right: np.ndarray        # (5,) scratch
    step: np.ndarray         # (5,) scratch


@kernel
def view_accumulator(f, at, i, m, q):
    """Cut it from floats f at `at` and integers i at `m` for q terms; returns (it, next at, next m)."""
    n = N_OFFSET + q + 1
    window, at = take2(f, at, n, n)
    triangle, at = take2(f, at, n, n)
    pair, at = take2(f, at, PAIR, PAIR)
    block, at = take2(f, at, 3, 3)
    psi, at = take2(f, at, N_OFFSET, N_OFFSET)
    product, at = take2(f, at, N_OFFSET, N_OFFSET)
    s_start, at = take2(f, at, N_OFFSET, 2)
    rows, at = take2(f, at, n, 3 * BLOCK)
    scratch, at = take(f, at, 2 * n * n)
    counts, m = take(i, m, 3)
    score, at = take(f, at, N_NOISES)
    information, at = take2(f, at, N_NOISES, N_NOISES)
    level_information, at = take2(f, at, N_NOISES, N_NOISES)
    square, at = take2(f, at, N_NOISES, N_NOISES)
    order, m = take(i, m, N_NOISES)
    tau, at = take(f, at, N_NOISES)
    right, at = take(f, at, N_NOISES)
    step, at = take(f, at, N_NOISES)
    return Accumulator(window, triangle, pair, block, psi, product, s_start, rows, scratch, counts, score,
                       information, level_information, square, order, tau, right, step), at, m


@kernel
def start_window(acc):
    """Forget the window's information but for the weak prior on the terms."""
    acc.window[:, :] = 0.0
    for j in range(N_OFFSET, acc.window.shape[0] - 1):
        acc.window[j, j] = WEAK_PRIOR
    set_identity(acc.psi)
    acc.counts[1] = 0
    acc.counts[2] = 0


@kernel
def set_identity(matrix):
    """matrix (4, 4) out"""
    for i in range(4):
        for j in range(4):
            matrix[i, j] = 1.0 if i == j else 0.0


@kernel
def forget_offset(acc):
    """The state is unknown again (a gap): keep what is known of the terms, drop the initial offset's rows."""
    for i in range(N_OFFSET):
        for j in range(acc.window.shape[0]):
            acc.window[i, j] = 0.0
    set_identity(acc.psi)


@kernel
def begin_block(belief, fil, acc):
    """A block begins: the offset's sensitivities are the identity, the terms' are remembered."""
    for i in range(N_OFFSET):
        for j in range(N_OFFSET):
            fil.s[i, j] = 1.0 if i == j else 0.0
        acc.s_start[i, 0] = fil.s[i, N_OFFSET + belief.term[0]]
        acc.s_start[i, 1] = fil.s[i, N_OFFSET + belief.term[1]]


@kernel
def reduce_block(acc, theta, beta):
    """Triangles of the block's rows: of all columns, of (offset, theta, beta), and of (theta, beta), state known."""
    n = acc.window.shape[0]
    acc.triangle[:, :] = 0.0
    absorb_rows(acc.triangle, acc.rows, acc.counts[0])
    pair = acc.scratch[:PAIR * n].reshape((PAIR, n))
    for i in range(n):
        for j in range(N_OFFSET):
            pair[j, i] = acc.triangle[i, j]
        pair[N_OFFSET, i] = acc.triangle[i, N_OFFSET + theta]
        pair[N_OFFSET + 1, i] = acc.triangle[i, N_OFFSET + beta]
        pair[N_OFFSET + 2, i] = acc.triangle[i, n - 1]
    acc.pair[:, :] = 0.0
    absorb_rows(acc.pair, pair, n)
    known = acc.scratch[:3 * (PAIR - 1)].reshape((3, PAIR - 1))
    for i in range(PAIR - 1):
        for j in range(3):
            known[j, i] = acc.pair[i, N_OFFSET + j]
    acc.block[:, :] = 0.0
    absorb_rows(acc.block, known, PAIR - 1)


@kernel
def absorb_block(acc):
    """Add the block to the window's information, its offset carried back to the window's start."""
    n = acc.window.shape[0]
    copy = acc.scratch[:n * n].reshape((n, n))
    for i in range(n):
        for c in range(N_OFFSET):
            value = 0.0
            for k in range(i, N_OFFSET):
                value += acc.triangle[i, k] * acc.psi[k, c]
            copy[c, i] = value
        for c in range(N_OFFSET, n):
            copy[c, i] = acc.triangle[i, c]
    absorb_rows(acc.window, copy, n)


@kernel
def advance_psi(fil, acc):
    """psi <- (transition over the block) psi."""
    for i in range(N_OFFSET):
        for j in range(N_OFFSET):
            value = 0.0
            for k in range(N_OFFSET):
                value += fil.s[i, k] * acc.psi[k, j]
            acc.product[i, j] = value
    for i in range(N_OFFSET):
        for j in range(N_OFFSET):
            acc.psi[i, j] = acc.product[i, j]


@kernel
def take_sample(belief, fil, work, acc, row, max_gap):
    """One sample of the ring into the predictor; its innovations become rows of the block.

    row (6,) in   a row of the ring
    """
    t = row[T]
    broken = max(fil.outliers[0], fil.outliers[1], fil.outliers[2]) >= MAX_OUTLIERS
    if broken or fil.time[1] == 0.0 or t - fil.time[0] > max_gap or t <= fil.time[0]:
        acc.counts[2] += int(fil.time[1])  # a gap, unless it is the first sample of all
        start_segment(belief, fil, t, row[THETA], row[THETA_DOT], row[BETA])
        forget_offset(acc)
    else:
        predict(belief, fil, work, t)
    theta, beta = N_OFFSET + belief.term[0], N_OFFSET + belief.term[1]
    for channel in range(3):
        z = row[THETA + channel]
        if np.isnan(z) or abs(z) >= belief.constant[SATURATION + channel]:
            continue
        r = belief.variance[channel] * np.exp(2.0 * fil.level[channel])
        if is_outlier(fil, channel, z, r):
            continue
        e, variance = correct(fil, work, channel, z, r, acc.score, acc.information)
        scale = 1.0 / np.sqrt(variance)
        k = acc.counts[0]
        n = work.out.shape[0]
        for j in range(n):
            acc.rows[j, k] = work.out[j] * scale
        acc.rows[n, k] = (e + work.out[theta] * fil.p_bar[0] + work.out[beta] * fil.p_bar[1]) * scale
        acc.counts[0] = k + 1
    acc.counts[1] += 1
    take_command(belief.constant, fil, row[BETA_CMD])


@kernel
def update_levels(fil, acc):
    """One step of Fisher scoring of the log noise levels with the block's score, then clear it."""
    n = acc.score.shape[0]
    for i in range(n):
        for j in range(n):
            prior = LEVEL_PRIOR if i == j else 0.0
            old = LEVEL_MEMORY * (acc.level_information[i, j] - prior) + prior
            acc.level_information[i, j] = old + acc.information[i, j]
            acc.square[j, i] = acc.level_information[i, j]
            acc.information[i, j] = 0.0
        acc.right[i] = acc.score[i]
        acc.score[i] = 0.0
    rank = qr_factor(acc.square, acc.order, acc.tau, 1.0e-12)
    if rank < n:
        return
    apply_q_transposed(acc.square, acc.tau, n, acc.right)
    solve_triangle(acc.square, n, acc.right, acc.step)
    for k in range(n):
        fil.level[acc.order[k]] += min(max(acc.step[k], -LEVEL_STEP), LEVEL_STEP)


@kernel
def relinearise(belief, fil, a, k):
    """Move the point of linearisation to relative deviations (a, k), and the state with it."""
    for i in range(fil.x.shape[0]):
        fil.x[i] += (fil.s[i, N_OFFSET + belief.term[0]] * (a - fil.p_bar[0])
                     + fil.s[i, N_OFFSET + belief.term[1]] * (k - fil.p_bar[1]))
    fil.p_bar[0], fil.p_bar[1] = a, k


@kernel
def jump(belief, fil, carried, blocks, before_a, before_k, after_a, after_k):
    """The parameters jumped: move state and linearisation, forget how the state depended on the values before.

    carried (4, 2) in  sensitivities at the onset, carried to now
    blocks         in  since the onset; it lies somewhere within the first, which leaves the state uncertain by what
                       one block of the new parameters does to it, uniformly
    """
    theta, beta = N_OFFSET + belief.term[0], N_OFFSET + belief.term[1]
    relinearise(belief, fil, before_a, before_k)
    for i in range(fil.x.shape[0]):
        fil.s[i, theta] -= carried[i, 0]
        fil.s[i, beta] -= carried[i, 1]
    for i in range(fil.x.shape[0]):
        for j in range(fil.x.shape[0]):
            slip_i = fil.s[i, theta] * (after_a - before_a) + fil.s[i, beta] * (after_k - before_k)
            slip_j = fil.s[j, theta] * (after_a - before_a) + fil.s[j, beta] * (after_k - before_k)
            fil.p[i, j] += slip_i * slip_j / (12.0 * blocks * blocks)
    relinearise(belief, fil, after_a, after_k)


@kernel
def select_columns(acc, active, theta, beta, columns):
    """Columns of the window's triangle to keep, in the order offset, other active terms, theta, beta, right-hand side.

    columns (n,) out int64;  returns how many.
    """
    n = acc.window.shape[0]
    m = N_OFFSET
    for j in range(N_OFFSET):
        columns[j] = j
    for j in range(n - 1 - N_OFFSET):
        if active[j] and j != theta and j != beta:
            columns[m] = N_OFFSET + j
            m += 1
    if active[theta]:
        columns[m] = N_OFFSET + theta
        m += 1
    if active[beta]:
        columns[m] = N_OFFSET + beta
        m += 1
    columns[m] = n - 1
    return m + 1


@kernel
def solve_window(belief, acc, active, columns, coefficient, deviation):
    """Least squares of the window's active terms on its own data.

    active      (q,) in   bool
    columns     (n,) scratch int64
    coefficient (q,) out  theta's and beta's are relative deviations; 0 for inactive terms
    deviation   (3,) out  std of theta's, std of beta's, their correlation (NaN where inactive)
    """
    n = acc.window.shape[0]
    theta, beta = belief.term[0], belief.term[1]
    m = select_columns(acc, active, theta, beta, columns)
    r = acc.scratch[:m * m].reshape((m, m))
    rt = acc.scratch[m * m:m * m + m * n].reshape((m, n))
    for c in range(m):
        for i in range(m):
            r[c, i] = 0.0
        for i in range(n):
            rt[c, i] = acc.window[i, columns[c]]
    absorb_rows(r, rt, n)
    coefficient[:] = 0.0
    for k in range(m - 2, N_OFFSET - 1, -1):
        value = r[k, m - 1]
        for j in range(k + 1, m - 1):
            value -= r[k, j] * coefficient[columns[j] - N_OFFSET]
        coefficient[columns[k] - N_OFFSET] = value / r[k, k]
    deviation[:] = np.nan
    if active[theta] and active[beta]:
        a, b, c = r[m - 3, m - 3], r[m - 3, m - 2], r[m - 2, m - 2]
        deviation[0] = np.sqrt(1.0 + (b / c) * (b / c)) / abs(a)
        deviation[1] = 1.0 / abs(c)
        deviation[2] = -(b / c) / np.sqrt(1.0 + (b / c) * (b / c)) * (1.0 if a > 0.0 else -1.0)
    elif active[theta]:
        deviation[0] = 1.0 / abs(r[m - 2, m - 2])
    elif active[beta]:
        deviation[1] = 1.0 / abs(r[m - 2, m - 2])
