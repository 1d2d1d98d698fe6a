"""The filtered formulation, block by block: predict, gather, track, watch, relinearise.

`take_samples` is called by the estimator whenever BLOCK samples are waiting in
the ring or a window closed, so the cost of a call into compiled code is shared.
"""

from typing import NamedTuple

import numpy as np

from .belief import N_CONSTANTS, Belief, profile_at
from .changes import NEXT, ONSETS, THRESHOLD, Watch, follow_onsets, open_onset, raise_alarm, settle_event, view_watch
from .filtered import (
    BLOCK,
    GAP,
    LEVEL_PRIOR,
    LOW_INFORMATION,
    N_OFFSET,
    NUMERICS,
    OK,
    SHORT,
    Accumulator,
    absorb_block,
    advance_psi,
    begin_block,
    jump,
    reduce_block,
    relinearise,
    solve_window,
    start_window,
    take_sample,
    update_levels,
    view_accumulator,
)
from .kernels import kernel
from .library import CODE_LENGTH
from .memory import take, take2
from .model import N_NOISES
from .predictor import (
    MAX_OUTLIERS,
    Filter,
    FilterWork,
    view_filter,
    view_filter_work,
)
from .ring import HEAD
from .sparse import SparseWork, view_sparse
from .structure import PRIOR, absorb_structure, select_terms
from .tracker import FIRST_STD, MEMBERS, Bank, restart_bank, track, view_bank
from .tracker import MEMORY as TRACK_MEMORY
from .window import A6, A6_BOUND, A6_STD, ATTITUDE, CONDITION, CORRELATION, GAPS, K1, K1_BOUND, K1_STD, STATUS, USED

ROOM = 60000         # numbers: more than any library's state needs; only counted, then allocated exactly
NOTHING_KNOWN = 1.0  # relative: with both bounds above it a window says nothing of a6 and k1


class Learner(NamedTuple):
    """Structure over many windows, and its scratch."""

    r: np.ndarray            # (q+1, q+1)
    active: np.ndarray       # (q,) int64, 1 for the terms believed to be there
    held: np.ndarray         # (q,) int64 scratch
    mt: np.ndarray           # (q, q)
    y: np.ndarray            # (q,)
    coefficient: np.ndarray  # (q,)
    columns: np.ndarray      # (4 + q + 1,) int64
    deviation: np.ndarray    # (3,)
    belief: np.ndarray       # (5,)
    span: np.ndarray         # (2,) first stamp of the block [s]; the alarm's threshold [nats]
    option: np.ndarray       # (2,) int64: estimate the noise levels; learn the structure
    sparse: SparseWork


@kernel
def view_learner(f, at, i, m, q):
    """Cut it from floats f at `at` and integers i at `m` for q terms; returns (it, next at, next m)."""
    r, at = take2(f, at, q + 1, q + 1)
    active, m = take(i, m, q)
    held, m = take(i, m, q)
    mt, at = take2(f, at, q, q)
    y, at = take(f, at, q)
    coefficient, at = take(f, at, q)
    columns, m = take(i, m, 5 + q)
    deviation, at = take(f, at, 3)
    belief, at = take(f, at, 5)
    span, at = take(f, at, 2)
    option, m = take(i, m, 2)
    sparse, at, m = view_sparse(f, at, i, m, q)
    return Learner(r, active, held, mt, y, coefficient, columns, deviation, belief, span, option, sparse), at, m


class Onboard(NamedTuple):
    """All of the filtered formulation."""

    belief: Belief
    filter: Filter
    work: FilterWork
    acc: Accumulator
    bank: Bank
    watch: Watch
    learner: Learner


@kernel
def view_onboard(f, i, q, nodes):
    """Cut everything from floats f and integers i, for q terms and `nodes` nodes; returns (it, floats, integers)"""
    at, m = 0, 0
    time, at = take(f, at, nodes)
    a6, at = take(f, at, nodes)
    k1, at = take(f, at, nodes)
    constant, at = take(f, at, N_CONSTANTS)
    variance, at = take(f, at, N_NOISES)
    codes, m = take2(i, m, q, CODE_LENGTH)
    term, m = take(i, m, 2)
    fil, at, m = view_filter(f, at, i, m, q)
    work, at, m = view_filter_work(f, at, i, m, q)
    acc, at, m = view_accumulator(f, at, i, m, q)
    bank, at, m = view_bank(f, at, i, m, q)
    watch, at, m = view_watch(f, at, i, m, q)
    learner, at, m = view_learner(f, at, i, m, q)
    return Onboard(Belief(time, a6, k1, constant, variance, codes, term), fil, work, acc, bank, watch, learner), at, m


class Store(NamedTuple):
    """The memory of the filtered formulation, as it crosses into compiled code."""

    floats: np.ndarray
    integers: np.ndarray
    terms: int
    nodes: int


def new_store(belief: Belief, estimate_noise: bool) -> tuple[Store, Onboard]:
    """Allocate for a belief; returns the memory and its named parts."""
    q, nodes = len(belief.codes), len(belief.time)
    floats, integers = np.zeros(ROOM + 3 * nodes), np.zeros(ROOM, np.int64)
    _, at, m = view_onboard(floats, integers, q, nodes)
    store = Store(np.zeros(at), np.zeros(m, np.int64), q, nodes)
    ob, _, _ = view_onboard(*store)
    for part, given in zip(ob.belief, belief, strict=True):
        part[...] = given
    ob.bank.member[...] = MEMBERS
    ob.learner.option[...] = int(estimate_noise), int(q > 2)
    ob.learner.span[1] = THRESHOLD
    restart(*store)
    return store, ob


@kernel
def restart(f, i, q, nodes):
    """Forget everything learned in flight."""
    ob, _, _ = view_onboard(f, i, q, nodes)
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
    ob.bank.weight[:] = 1.0 / ob.bank.weight.shape[0]
    ob.learner.r[:, :] = 0.0
    for j in range(ob.learner.active.shape[0]):
        ob.learner.r[j, j] = PRIOR
        ob.learner.active[j] = 1


@kernel
def watch_block(ob, dt, t_end):
    """Track the block and look for a sudden change; returns True if the alarm was raised."""
    acc, learn, bank, belief = ob.acc, ob.learner, ob.bank, ob.learner.belief
    open_onset(ob.watch, bank.total, acc.s_start, learn.span[0])
    still = track(bank, TRACK_MEMORY, dt, acc.block) - 0.5 * acc.block[2, 2] * acc.block[2, 2]
    factor, slot, kind = follow_onsets(ob.watch, acc.pair, ob.filter.s, dt, still)
    if not factor > learn.span[1]:
        settle_event(ob.watch, bank.total)
        return False
    before = ob.watch.before[slot]
    blocks = (ob.watch.counts[NEXT] - 1 - slot) % ONSETS + 1
    raise_alarm(ob.watch, slot, kind, factor, dt, t_end, belief)
    jump(ob.belief, ob.filter, ob.watch.carried[slot], blocks, before[0], before[1], belief[0], belief[1])
    restart_bank(bank, belief[0], belief[1], belief[2], belief[3], belief[4])
    return True


@kernel
def close_block(ob, t_end, period):
    """Use the rows gathered: tracker, change detection, structure, window, noise levels, linearisation."""
    acc, learn = ob.acc, ob.learner
    if acc.counts[0] == 0:
        return
    dt = t_end - learn.span[0] + period
    reduce_block(acc, ob.belief.term[0], ob.belief.term[1])
    advance_psi(ob.filter, acc)
    alarm = watch_block(ob, dt, t_end)
    if alarm:  # the window begins again, and nothing of this block is noise or structure
        start_window(acc)
        acc.score[:] = 0.0
        acc.information[:, :] = 0.0
    else:
        if learn.option[1] == 1:
            absorb_structure(learn.r, acc.triangle, N_OFFSET, acc.scratch, dt)
        absorb_block(acc)
        if learn.option[0] == 1:
            update_levels(ob.filter, acc)
        quickest = ob.bank.mean.shape[0] - 1  # so that a drift does not pass for noise
        relinearise(ob.belief, ob.filter, ob.bank.mean[quickest, 0], ob.bank.mean[quickest, 1])
    acc.counts[0] = 0
    begin_block(ob.belief, ob.filter, acc)


@kernel
def take_samples(f, i, q, nodes, ring, count, waiting, spare, flush, max_gap, period):
    """Take the `waiting` newest samples of the ring but for the newest `spare`, oldest first.

    A gap or a full block of rows closes the block, and so does the last sample if `flush` is 1 (a window closed).
    """
    ob, _, _ = view_onboard(f, i, q, nodes)
    capacity = ring.shape[0]
    acc = ob.acc
    for back in range(waiting, spare, -1):
        row = ring[(count[HEAD] - back) % capacity]
        worst = max(ob.filter.outliers[0], ob.filter.outliers[1], ob.filter.outliers[2])
        gap = ob.filter.time[1] == 1.0 and (worst >= MAX_OUTLIERS or not 0.0 < row[0] - ob.filter.time[0] <= max_gap)
        if gap or acc.counts[0] > 3 * (BLOCK - 1):
            close_block(ob, ob.filter.time[0], period)
        if acc.counts[0] == 0:
            ob.learner.span[0] = row[0]
            if gap or ob.filter.time[1] == 0.0:
                begin_block(ob.belief, ob.filter, acc)
        take_sample(ob.belief, ob.filter, ob.work, acc, row, max_gap)
    if flush == 1 or acc.counts[0] > 3 * (BLOCK - 1):
        close_block(ob, ob.filter.time[0], period)


@kernel
def close_filtered(f, i, q, nodes, out, t_centre, enough):
    """Close the window, its last block being closed: its own estimate into `out`, and begin the next one.

    out  Outcome;  t_centre [s];  enough: samples below which a window is SHORT
    """
    ob, _, _ = view_onboard(f, i, q, nodes)
    acc, learn = ob.acc, ob.learner
    theta, beta = ob.belief.term[0], ob.belief.term[1]
    if learn.option[1] == 1:
        select_terms(learn.r, theta, beta, learn.active, learn.held, learn.mt, learn.y, learn.coefficient, learn.sparse)
    out.number[:] = np.nan
    out.xi[:, :] = np.nan
    out.support[:, :] = False
    out.flag[USED] = acc.counts[1]
    out.flag[GAPS] = acc.counts[2]
    if acc.counts[1] < enough:
        out.flag[STATUS] = GAP if acc.counts[2] > 0 else SHORT
    else:
        solve_window(ob.belief, acc, learn.active, learn.columns, learn.coefficient, learn.deviation)
        out.flag[STATUS] = report_filtered(ob, out, t_centre)
    start_window(acc)


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
        out.support[j, ATTITUDE] = learn.active[j] == 1
    out.xi[theta, ATTITUDE] = a6 * (1.0 + learn.coefficient[theta]) if learn.active[theta] else 0.0
    out.xi[beta, ATTITUDE] = k1 * (1.0 + learn.coefficient[beta]) if learn.active[beta] else 0.0
    out.number[A6], out.number[K1] = out.xi[theta, ATTITUDE], out.xi[beta, ATTITUDE]
    out.number[A6_STD], out.number[K1_STD] = out.number[A6_BOUND], out.number[K1_BOUND]
    out.number[CORRELATION] = correlation * (1.0 if a6 * k1 > 0.0 else -1.0)
    if not np.isfinite(out.number[A6] + out.number[K1]):
        return NUMERICS
    return OK


@kernel
def abandon_window(f, i, q, nodes):
    """The clock was set back: the window is given up and the next one begins."""
    ob, _, _ = view_onboard(f, i, q, nodes)
    ob.acc.counts[0] = 0
    ob.filter.time[1] = 0.0
    start_window(ob.acc)
