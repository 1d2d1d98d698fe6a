"""Sudden changes of a6 or k1: found, dated, sized.

For every block of the last seconds, two trackers are kept that start with the
belief of that moment and a jump added to it: of k1 alone, and of both
parameters.  What each predicted since, against what the tracker without a jump
predicted, is the log Bayes factor of a change at that block; the largest raises
the alarm (Basseville & Nikiforov, Detection of Abrupt Changes, 1993, section
4.4; with a prior on the jump instead of a maximum over it).

All trackers let the deviations drift, so that a slow drift, which a constant fit
over the last seconds would twist into a jump, raises no alarm.
"""

import math
from typing import NamedTuple

import numpy as np

from .kernels import kernel
from .memory import take, take2, take3

ONSETS = 24         # blocks looked back: 2.4 s at 0.1 s
OFFSET = 4          # states
JUMP_STD = 0.4      # relative: a jump worth an alarm, one sigma
DRIFT = 0.02        # relative per sqrt(s): what the deviations may do beside the jump
THRESHOLD = 12.0    # nats; see benchmarks/changes.py: at most one false alarm in 10 h
SETTLE = 20         # blocks after the onset before the size is final: 2 s
MAX_EVENTS = 16
KINDS = ("k1", "a6+k1")
K1_JUMP, BOTH_JUMP = range(2)

# event (f8)
(E_TIME, E_TIME_STD, E_KIND, E_A6_BEFORE, E_A6_AFTER, E_A6_VARIANCE, E_K1_BEFORE, E_K1_AFTER, E_K1_VARIANCE,
 E_ALARM, E_FINAL) = range(11)
N_EVENT = 11

# counts (i8)
NEXT, KEPT, EVENTS, SINCE = range(4)
N_COUNTS = 4


class Watch(NamedTuple):
    """State of the detector."""

    mean: np.ndarray        # (ONSETS, 2, 2) deviations by onset, kind, parameter
    covariance: np.ndarray  # (ONSETS, 2, 3)
    factor: np.ndarray      # (ONSETS, 2) log Bayes factors
    before: np.ndarray      # (ONSETS, 5) tracked belief before each onset
    start: np.ndarray       # (ONSETS,) s
    carried: np.ndarray     # (ONSETS, 4, 2) sensitivities at each onset, carried to the current block's start
    row: np.ndarray         # (8,) scratch
    counts: np.ndarray      # (N_COUNTS,) int64
    event: np.ndarray       # (MAX_EVENTS, N_EVENT)
    reference: np.ndarray   # (5,) belief before the last change


@kernel
def view_watch(f, at, i, m, q):
    """Cut it from floats f at `at` and integers i at `m` for q terms; returns (it, next at, next m)."""
    mean, at = take3(f, at, ONSETS, 2, 2)
    covariance, at = take3(f, at, ONSETS, 2, 3)
    factor, at = take2(f, at, ONSETS, 2)
    before, at = take2(f, at, ONSETS, 5)
    start, at = take(f, at, ONSETS)
    carried, at = take3(f, at, ONSETS, OFFSET, 2)
    row, at = take(f, at, 2 * OFFSET)
    counts, m = take(i, m, N_COUNTS)
    event, at = take2(f, at, MAX_EVENTS, N_EVENT)
    reference, at = take(f, at, 5)
    return Watch(mean, covariance, factor, before, start, carried, row, counts, event, reference), at, m


@kernel
def measure(mean, covariance, h0, h1, z):
    """One scalar measurement z = h0 a + h1 k + unit noise of one onset; returns (variance, e^2/variance)."""
    c0, c1, c2 = covariance[0], covariance[1], covariance[2]
    y0, y1 = c0 * h0 + c1 * h1, c1 * h0 + c2 * h1
    variance = h0 * y0 + h1 * y1 + 1.0
    e = z - h0 * mean[0] - h1 * mean[1]
    mean[0] += y0 / variance * e
    mean[1] += y1 / variance * e
    covariance[0] = c0 - y0 * y0 / variance
    covariance[1] = c1 - y0 * y1 / variance
    covariance[2] = c2 - y1 * y1 / variance
    return variance, e * e / variance


@kernel
def open_onset(state, belief, s_start, t):
    """A block began at t with sensitivities s_start (4, 2): a change may have begun with it."""
    slot = state.counts[NEXT]
    for i in range(OFFSET):
        for j in range(2):
            state.carried[slot, i, j] = s_start[i, j]
    jump = JUMP_STD * JUMP_STD
    for k in range(5):
        state.before[slot, k] = belief[k]
    for kind in range(2):
        state.mean[slot, kind, 0], state.mean[slot, kind, 1] = belief[0], belief[1]
        state.covariance[slot, kind, 0] = belief[2] + (jump if kind == BOTH_JUMP else 0.0)
        state.covariance[slot, kind, 1] = belief[3]
        state.covariance[slot, kind, 2] = belief[4] + jump
        state.factor[slot, kind] = 0.0
    state.start[slot] = t
    state.counts[NEXT] = (slot + 1) % ONSETS
    state.counts[KEPT] = min(state.counts[KEPT] + 1, ONSETS)
    state.counts[SINCE] += 1


@kernel
def follow_onset(state, slot, kind, pair, dt):
    """Give a block to one onset's tracker; returns its log predictive density.

    After a jump by d at the onset the innovations are h p - h_past d: the state had not yet felt the new parameters,
    so the offset -carried d, which leads there, is subtracted from the terms' columns.
    """
    mean, covariance = state.mean[slot, kind], state.covariance[slot, kind]
    covariance[0] += DRIFT * DRIFT * dt
    covariance[2] += DRIFT * DRIFT * dt
    carried, before = state.carried[slot], state.before[slot]
    volume, square = 1.0, 0.0
    for i in range(OFFSET + 2):
        past_a = past_k = 0.0
        for k in range(i, OFFSET):
            past_a += pair[i, k] * carried[k, 0]
            past_k += pair[i, k] * carried[k, 1]
        z = pair[i, OFFSET + 2] - past_a * before[0] - past_k * before[1]
        variance, share = measure(mean, covariance, pair[i, OFFSET] - past_a, pair[i, OFFSET + 1] - past_k, z)
        volume *= variance
        square += share
    return -0.5 * (math.log(volume) + square)


@kernel
def carry_onset(state, slot, transition):
    """Carry the sensitivities of an onset over the block.  transition (4, >=4) in."""
    carried = state.carried[slot]
    for j in range(2):
        for i in range(OFFSET):
            value = 0.0
            for k in range(OFFSET):
                value += transition[i, k] * carried[k, j]
            state.row[i] = value
        for i in range(OFFSET):
            carried[i, j] = state.row[i]


@kernel
def follow_onsets(state, pair, transition, dt, still):
    """Give a block to every onset's trackers; returns (largest log Bayes factor, its slot, its kind).

    pair (7, 7) in square-root information: offset at the block's start, a6, k1, right-hand side
    transition (4, >=4) in of the offset over the block
    dt [s];  still: log density of the block without a jump
    """
    best, best_slot, best_kind = -np.inf, 0, 0
    for back in range(state.counts[KEPT]):
        slot = (state.counts[NEXT] - 1 - back) % ONSETS
        for kind in range(2):
            state.factor[slot, kind] += follow_onset(state, slot, kind, pair, dt) - still
            if state.factor[slot, kind] > best:
                best, best_slot, best_kind = state.factor[slot, kind], slot, kind
        carry_onset(state, slot, transition)
    return best, best_slot, best_kind


@kernel
def onset_time(state, kind, best, dt):
    """Mean and std [s] of the onset, the blocks weighted by their Bayes factors, and a block's own width."""
    norm = mean = square = 0.0
    reference = state.start[(state.counts[NEXT] - 1) % ONSETS]
    for back in range(state.counts[KEPT]):
        slot = (state.counts[NEXT] - 1 - back) % ONSETS
        w = math.exp(state.factor[slot, kind] - best)
        age = state.start[slot] - reference
        norm += w
        mean += w * age
        square += w * age * age
    mean /= norm
    return reference + mean, math.sqrt(max(square / norm - mean * mean, 0.0) + dt * dt / 12.0)


@kernel
def raise_alarm(state, slot, kind, best, dt, t_now, after):
    """Record an event and forget the onsets.  after (5,) out: the belief to restart the tracker with.

    Its mean is the onset's estimate, its variance the jump's again: the onset lies somewhere in its block, so what the
    first tenths of a second say of the size is biased.  An alarm while the last event's size is open belongs to it.
    """
    t_onset, t_std = onset_time(state, kind, best, dt)
    last = state.event[(state.counts[EVENTS] - 1) % MAX_EVENTS]
    open_event = state.counts[EVENTS] > 0 and last[E_FINAL] == 0.0
    before = state.before[slot]
    jump = JUMP_STD * JUMP_STD
    after[0], after[1] = state.mean[slot, kind, 0], state.mean[slot, kind, 1]
    after[2] = before[2] + (jump if kind == BOTH_JUMP else 0.0)
    after[3] = before[3]
    after[4] = before[4] + jump
    state.counts[KEPT] = 0
    if open_event:
        last[E_KIND] = max(last[E_KIND], float(kind))
        size_event(state, last, after)
        return
    for i in range(5):
        state.reference[i] = before[i]
    event = state.event[state.counts[EVENTS] % MAX_EVENTS]
    event[:] = 0.0
    event[E_TIME], event[E_TIME_STD], event[E_KIND], event[E_ALARM] = t_onset, t_std, kind, t_now
    size_event(state, event, after)
    state.counts[EVENTS] += 1
    state.counts[SINCE] = (state.counts[NEXT] - slot) % ONSETS


@kernel
def size_event(state, event, belief):
    """Before, after and the variance of the jump, relative to the nominal."""
    event[E_A6_BEFORE], event[E_K1_BEFORE] = state.reference[0], state.reference[1]
    event[E_A6_AFTER], event[E_K1_AFTER] = belief[0], belief[1]
    event[E_A6_VARIANCE] = state.reference[2] + belief[2]
    event[E_K1_VARIANCE] = state.reference[4] + belief[4]


@kernel
def settle_event(state, belief):
    """SETTLE blocks after its onset, an event's size becomes final."""
    if state.counts[EVENTS] == 0 or state.counts[SINCE] < SETTLE:
        return
    event = state.event[(state.counts[EVENTS] - 1) % MAX_EVENTS]
    if event[E_FINAL] == 0.0:
        size_event(state, event, belief)
        event[E_FINAL] = 1.0
