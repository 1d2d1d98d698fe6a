"""The filtered formulation, block by block: predict, gather, track, watch, relinearise.

`take_samples` is called by the estimator whenever BLOCK samples are waiting in
the ring or a window closed, so the cost of a call into compiled code is shared.
"""

from typing import NamedTuple

import numpy as np

from .changes import (
    THRESHOLD,
    Watch,
    onset_time,
    raise_alarm,
    remember,
    search,
    settle_event,
    watch,
)
from .filtered import (
    BLOCK,
    LEVEL_PRIOR,
    LOW_INFORMATION,
    N_OFFSET,
    NUMERICS,
    OK,
    SHORT,
    Accumulator,
    absorb_block,
    accumulator,
    reduce_block,
    relinearise,
    solve_window,
    start_window,
    take_sample,
    update_levels,
)
from .kernels import kernel
from .predictor import Belief, Filter, FilterWork, filter_work, new_filter, profile_at, restart_offset
from .regression import A6, A6_BOUND, A6_STD, ATTITUDE, CONDITION, CORRELATION, GAPS, K1, K1_BOUND, K1_STD, STATUS, USED
from .ring import HEAD
from .sparse import SparseWork, sparse_work
from .structure import PRIOR, absorb_structure, select_terms
from .tracker import FIRST_STD, SPEEDS, Bank, bank, restart_bank, track
from .tracker import MEMORY as TRACK_MEMORY

NOTHING_KNOWN = 1.0  # relative: with both bounds above it a window says nothing of a6 and k1


class Learner(NamedTuple):
    """Structure over many windows, and its scratch."""

    r: np.ndarray            # (q+1, q+1)
    active: np.ndarray       # (q,) bool
    held: np.ndarray         # (q,) bool
    mt: np.ndarray           # (q, q)
    y: np.ndarray            # (q,)
    coefficient: np.ndarray  # (q,)
    columns: np.ndarray      # (4 + q + 1,) int64
    deviation: np.ndarray    # (3,)
    belief: np.ndarray       # (5,)
    total: np.ndarray        # (5,)
    span: np.ndarray         # (2,) s: first stamp of the block; unused
    option: np.ndarray       # (2,) int64: estimate the noise levels; learn the structure
    speeds: np.ndarray       # (b,)
    sparse: SparseWork


def learner(q: int, estimate_noise: bool) -> Learner:
    """Allocate; with two terms there is no structure to learn."""
    n = N_OFFSET + q + 1
    return Learner(np.zeros((q + 1, q + 1)), np.ones(q, np.bool_), np.zeros(q, np.bool_), np.zeros((q, q)),
                   np.zeros(q), np.zeros(q), np.zeros(n, np.int64), np.zeros(3), np.zeros(5), np.zeros(5), np.zeros(2),
                   np.array([int(estimate_noise), int(q > 2)]), np.array(SPEEDS), sparse_work(q))


class Onboard(NamedTuple):
    """All of the filtered formulation."""

    belief: Belief
    filter: Filter
    work: FilterWork
    acc: Accumulator
    bank: Bank
    watch: Watch
    learner: Learner


def onboard(belief: Belief, estimate_noise: bool) -> Onboard:
    """Allocate for a belief."""
    q = len(belief.codes)
    return Onboard(belief, new_filter(q), filter_work(q), accumulator(q), bank(), watch(), learner(q, estimate_noise))


@kernel
def restart(ob):
    """Forget everything learned in flight."""
    fil, acc = ob.filter, ob.acc
    fil.time[:] = 0.0
    fil.p_bar[:] = 0.0
    fil.level[:] = 0.0
    fil.step[:] = 0.0
    fil.s[:, :] = 0.0
    acc.score[:] = 0.0
    acc.information[:, :] = 0.0
    acc.level_information[:, :] = 0.0
    for k in range(acc.level_information.shape[0]):
        acc.level_information[k, k] = LEVEL_PRIOR
    acc.counts[:] = 0
    start_window(acc)
    ob.bank.evidence[:] = 0.0
    restart_bank(ob.bank, 0.0, 0.0, FIRST_STD * FIRST_STD, 0.0, FIRST_STD * FIRST_STD)
    ob.watch.counts[:] = 0
    ob.learner.r[:, :] = 0.0
    for j in range(ob.learner.active.shape[0]):
        ob.learner.r[j, j] = PRIOR
        ob.learner.active[j] = True


@kernel
def close_block(ob, t_end, period):
    """Use the rows gathered: structure, tracker, change detection, window, noise levels, linearisation."""
    acc, learn = ob.acc, ob.learner
    if acc.counts[0] == 0:
        return
    theta, beta = ob.belief.term[0], ob.belief.term[1]
    dt = t_end - learn.span[0] + period
    reduce_block(acc, theta, beta)
    remember(ob.watch, ob.bank.total, acc.block, learn.span[0])
    track(ob.bank, learn.speeds, TRACK_MEMORY, dt, acc.block)
    value, length, kind = search(ob.watch, learn.total, dt)
    if value > THRESHOLD:
        t_onset, t_std = onset_time(ob.watch, length, dt)
        raise_alarm(ob.watch, length, kind, t_onset, t_std, t_end, learn.total, learn.belief)
        restart_bank(ob.bank, learn.belief[0], learn.belief[1], learn.belief[2], learn.belief[3], learn.belief[4])
    settle_event(ob.watch, ob.bank.total)
    if learn.option[1] == 1:
        absorb_structure(learn.r, acc.rows, N_OFFSET, acc.counts[0], acc.scratch, dt)
    absorb_block(acc)
    acc.counts[0] = 0
    if learn.option[0] == 1:
        update_levels(ob.filter, acc)
    relinearise(ob.belief, ob.filter, ob.bank.total[0], ob.bank.total[1])


@kernel
def take_samples(ob, ring, count, waiting, spare, max_gap, period):
    """Take the `waiting` newest samples of the ring but for the newest `spare`, oldest first.

    A gap or a full block of rows closes the block.
    """
    capacity = ring.shape[0]
    acc = ob.acc
    for back in range(waiting, spare, -1):
        row = ring[(count[HEAD] - back) % capacity]
        gap = ob.filter.time[1] == 1.0 and not (0.0 < row[0] - ob.filter.time[0] <= max_gap)
        if gap or acc.counts[0] > 3 * (BLOCK - 1):
            close_block(ob, ob.filter.time[0], period)
        if acc.counts[0] == 0:
            ob.learner.span[0] = row[0]
        take_sample(ob.belief, ob.filter, ob.work, acc, row, max_gap)
    if acc.counts[0] > 3 * (BLOCK - 1):
        close_block(ob, ob.filter.time[0], period)


@kernel
def close_filtered(ob, out, t_centre, enough, period):
    """Close the window: its own estimate into `out`, and begin the next one.

    out  Outcome;  t_centre [s];  enough: samples below which a window is SHORT
    """
    close_block(ob, ob.filter.time[0], period)
    acc, learn = ob.acc, ob.learner
    theta, beta = ob.belief.term[0], ob.belief.term[1]
    if learn.option[1] == 1:
        select_terms(learn.r, theta, beta, learn.active, learn.held, learn.mt, learn.y, learn.coefficient, learn.sparse)
    out.number[:] = np.nan
    out.xi[:, :] = np.nan
    out.support[:, :] = False
    out.flag[USED] = acc.counts[1]
    out.flag[GAPS] = 0
    if acc.counts[1] < enough:
        out.flag[STATUS] = SHORT
    else:
        solve_window(ob.belief, acc, learn.active, learn.columns, learn.coefficient, learn.deviation)
        out.flag[STATUS] = report_filtered(ob, out, t_centre)
    start_window(acc)
    restart_offset(ob.filter)


@kernel
def report_filtered(ob, out, t_centre):
    """Relative deviations into a6, k1 and their standard deviations at the window's centre; returns the status."""
    learn = ob.learner
    theta, beta = ob.belief.term[0], ob.belief.term[1]
    std_a, std_k = learn.deviation[0], learn.deviation[1]
    a6, k1 = profile_at(ob.belief, ob.filter.cell, t_centre)
    out.number[A6_BOUND], out.number[K1_BOUND] = abs(a6) * std_a, abs(k1) * std_k
    correlation = learn.deviation[2]
    out.number[CONDITION] = np.sqrt((1.0 + abs(correlation)) / (1.0 - abs(correlation)))
    if not (std_a <= NOTHING_KNOWN or std_k <= NOTHING_KNOWN):
        return LOW_INFORMATION
    for j in range(learn.coefficient.shape[0]):
        out.xi[j, ATTITUDE] = learn.coefficient[j]
        out.support[j, ATTITUDE] = learn.active[j]
    out.xi[theta, ATTITUDE] = a6 * (1.0 + learn.coefficient[theta]) if learn.active[theta] else 0.0
    out.xi[beta, ATTITUDE] = k1 * (1.0 + learn.coefficient[beta]) if learn.active[beta] else 0.0
    out.number[A6], out.number[K1] = out.xi[theta, ATTITUDE], out.xi[beta, ATTITUDE]
    out.number[A6_STD], out.number[K1_STD] = out.number[A6_BOUND], out.number[K1_BOUND]
    out.number[CORRELATION] = correlation * (1.0 if a6 * k1 > 0.0 else -1.0)
    if not np.isfinite(out.number[A6] + out.number[K1]):
        return NUMERICS
    return OK


@kernel
def abandon_window(ob, period):
    """The clock was set back: the window is given up and the next one begins."""
    close_block(ob, ob.filter.time[0], period)
    ob.filter.time[1] = 0.0
    start_window(ob.acc)
    restart_offset(ob.filter)
