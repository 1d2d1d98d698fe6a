"""Sudden changes of a6 or k1: found, dated, sized.

For every block of the last seconds two trackers begin with the belief of that moment and a jump added, of k1 alone and
of both.  What each predicted since, over what the tracker without a jump predicted, is the log Bayes factor of a change
at that block (Basseville & Nikiforov, Detection of Abrupt Changes, 1993, section 4.4; with a prior on the jump instead
of a maximum over it); the largest raises the alarm.  See docs/method.md, "Sudden changes".
"""

import math

import numpy as np

from ..algebra.elementary import exp_of, log_of
from ..algebra.linsolve import carry_columns, measure
from ..filter import states as sx
from ..kernels import inner

JUMP_STD = 0.4      # relative: a jump worth an alarm, one sigma
DRIFT = 0.02        # relative per sqrt(s): what the deviations may do beside the jump
THRESHOLD = 12.0    # nats; see benchmarks/changes.py: at most one false alarm in 10 h
SETTLE = 20         # blocks after the onset before the size is final: 2 s
MAX_EVENTS = 16
K1_JUMP, BOTH_JUMP = range(2)

# stage of an event
OPEN = 0.0        # its size is still to settle
FINAL = 1.0       # it is settled
WITHDRAWN = -1.0  # there was no change


@inner
def open_onset(states, state, belief, s_start, t):
    """Begin a pair of trackers, of a change that may have begun at t [s] with sensitivities s_start (n, 2)."""
    slot = state.counts.next
    for i in range(states):
        for j in range(2):
            state.carried[slot, i, j] = s_start[i, j]
    jump = JUMP_STD * JUMP_STD
    before = state.before
    before.mean_a6[slot], before.mean_k1[slot] = belief.mean_a6, belief.mean_k1
    before.var_a6[slot], before.cov[slot], before.var_k1[slot] = belief.var_a6, belief.cov, belief.var_k1
    for kind in range(2):
        state.mean[slot, kind, sx.A6], state.mean[slot, kind, sx.K1] = belief.mean_a6, belief.mean_k1
        covariance = state.covariance[2 * slot + kind]
        covariance[sx.A6, sx.A6] = belief.var_a6 + (jump if kind == BOTH_JUMP else 0.0)
        covariance[sx.A6, sx.K1], covariance[sx.K1, sx.A6] = belief.cov, belief.cov
        covariance[sx.K1, sx.K1] = belief.var_k1 + jump
        state.factor[slot, kind] = 0.0
    state.start[slot] = t
    state.counts.next = (slot + 1) % sx.CHANGE_BLOCKS
    state.counts.kept = min(state.counts.kept + 1, sx.CHANGE_BLOCKS)
    state.counts.since += 1


@inner
def follow_onset(n, state, work, slot, kind, pair, dt):
    """Give a block to one onset's tracker; returns its log predictive density.

    After a jump by d at the onset the innovations are h p - h_past d: the state had not yet felt the new parameters,
    so the offset -carried d, which leads there, is subtracted from the terms' columns.  work  BankWork
    """
    mean, covariance, row = state.mean[slot, kind], state.covariance[2 * slot + kind], work.row[:]
    covariance[sx.A6, sx.A6] += DRIFT * DRIFT * dt
    covariance[sx.K1, sx.K1] += DRIFT * DRIFT * dt
    carried, before = state.carried[slot], state.before
    volume, square = 1.0, 0.0
    for i in range(n + 2):
        past_a = past_k = 0.0
        for k in range(i, n):
            past_a += pair[i, k] * carried[k, sx.A6]
            past_k += pair[i, k] * carried[k, sx.K1]
        z = pair[i, n + 2] - past_a * before.mean_a6[slot] - past_k * before.mean_k1[slot]
        row[sx.A6], row[sx.K1] = pair[i, n] - past_a, pair[i, n + 1] - past_k
        e, variance = measure(mean, covariance, row, 0, 2, z, work.column[:])
        volume *= variance
        square += e * e / variance
    return -0.5 * (log_of(volume) + square)


@inner
def follow_onsets(n, state, work, column, pair, transition, dt, still):
    """Give a block to every onset's trackers; returns (largest log Bayes factor, its slot, its kind).

    pair (n + 3, n + 3) in  square-root information: offset at the block's start, a6, k1, right-hand side
    transition (n, >=n) in  of the offset over the block;  dt [s];  still: log density of the block without a jump
    """
    best, best_slot, best_kind = -np.inf, 0, 0
    for back in range(state.counts.kept):
        slot = (state.counts.next - 1 - back) % sx.CHANGE_BLOCKS
        for kind in range(2):
            state.factor[slot, kind] += follow_onset(n, state, work, slot, kind, pair, dt) - still
            if state.factor[slot, kind] > best:
                best, best_slot, best_kind = state.factor[slot, kind], slot, kind
        carry_columns(transition, n, state.carried[slot], 2, column)
    return best, best_slot, best_kind


@inner
def onset_time(state, kind, best, dt):
    """Mean and std [s] of the onset, the blocks weighted by their Bayes factors, and a block's own width."""
    norm = mean = square = 0.0
    reference = state.start[(state.counts.next - 1) % sx.CHANGE_BLOCKS]
    for back in range(state.counts.kept):
        slot = (state.counts.next - 1 - back) % sx.CHANGE_BLOCKS
        w = exp_of(state.factor[slot, kind] - best)
        age = state.start[slot] - reference
        norm += w
        mean += w * age
        square += w * age * age
    mean /= norm
    return reference + mean, math.sqrt(max(square / norm - mean * mean, 0.0) + dt * dt / 12.0)


@inner
def raise_alarm(state, slot, kind, best, dt, t_now, after):
    """Record an event and forget the onsets.  after  out: the belief to restart the tracker with.

    Its mean is the onset's estimate, its variance the jump's again: the onset lies somewhere in its block, so what the
    first tenths of a second say of the size is biased.  An alarm while the last event's size is open belongs to it.
    """
    t_onset, t_std = onset_time(state, kind, best, dt)
    event, last = state.event, (state.counts.events - 1) % MAX_EVENTS
    open_event = state.counts.events > 0 and event.stage[last] == OPEN
    before = state.before
    jump = JUMP_STD * JUMP_STD
    after.mean_a6, after.mean_k1 = state.mean[slot, kind, sx.A6], state.mean[slot, kind, sx.K1]
    after.var_a6 = before.var_a6[slot] + (jump if kind == BOTH_JUMP else 0.0)
    after.cov = before.cov[slot]
    after.var_k1 = before.var_k1[slot] + jump
    state.counts.kept = 0
    if open_event:
        event.kind[last] = max(event.kind[last], float(kind))
        size_event(state, last, after)
        return
    reference = state.reference
    reference.mean_a6, reference.mean_k1 = before.mean_a6[slot], before.mean_k1[slot]
    reference.var_a6, reference.cov, reference.var_k1 = before.var_a6[slot], before.cov[slot], before.var_k1[slot]
    new = state.counts.events % MAX_EVENTS
    event.time[new], event.time_std[new], event.kind[new], event.alarm[new] = t_onset, t_std, kind, t_now
    event.stage[new] = OPEN
    size_event(state, new, after)
    state.counts.events += 1
    state.counts.since = (state.counts.next - slot) % sx.CHANGE_BLOCKS


@inner
def size_event(state, k, belief):
    """Give event k the values before and after and the variance of the jump, relative to the nominal."""
    event = state.event
    event.a6_before[k], event.k1_before[k] = state.reference.mean_a6, state.reference.mean_k1
    event.a6_after[k], event.k1_after[k] = belief.mean_a6, belief.mean_k1
    event.a6_variance[k] = state.reference.var_a6 + belief.var_a6
    event.k1_variance[k] = state.reference.var_k1 + belief.var_k1


@inner
def settle_event(state, belief):
    """Size the last event for good once SETTLE blocks have passed since its onset."""
    last = (state.counts.events - 1) % MAX_EVENTS
    if state.counts.events > 0 and state.counts.since >= SETTLE and state.event.stage[last] == OPEN:
        size_event(state, last, belief)
        state.event.stage[last] = FINAL


@inner
def withdraw_since(state, t):
    """Withdraw the events that began after t [s]: what the model contradicts was no change; return how many."""
    event, withdrawn = state.event, 0
    for k in range(min(state.counts.events, MAX_EVENTS)):
        if event.time[k] > t and event.stage[k] != WITHDRAWN:
            event.stage[k] = WITHDRAWN
            withdrawn += 1
    return withdrawn
