"""Sudden changes of a6 or k1: found, dated, sized.

Every block, for each of several onsets in the last seconds, two beliefs about
the deviations since then are compared: unchanged (the tracked posterior as it
was, grown by a drift) and changed (the same, grown by a jump of k1, of a6 or of
both).  Their log Bayes factor, maximised over onsets and kinds, raises the alarm
(generalised likelihood ratio: Basseville & Nikiforov, Detection of Abrupt
Changes, 1993, section 4.4; with a prior on the jump instead of a maximum).

A block's data are its information matrix L (2x2) and vector g = L p-hat; with the
belief p ~ N(m, V) their log density is, but for a constant,
-1/2 ln|I + V L| + 1/2 d' V (I + L V)^-1 d,  d = g - L m.
"""

import math
from typing import NamedTuple

import numpy as np

from .kernels import kernel

HISTORY = 40                                 # blocks kept: onsets up to 4 s back at 0.1 s
LENGTHS = (1, 2, 3, 4, 6, 8, 11, 15, 20, 28, 39)  # blocks since the onset that are tried
JUMP_STD = 0.4                               # relative: a jump worth an alarm, one sigma
DRIFT = 0.02                                 # relative per sqrt(s): what an unchanged deviation may do
THRESHOLD = 12.0                             # nats; see benchmarks/changes.py: at most one false alarm in 10 h
SETTLE = 20                                  # blocks after the onset before the size is final: 2 s
MAX_EVENTS = 16
KINDS = ("k1", "a6", "a6+k1")
K1_JUMP, A6_JUMP, BOTH_JUMP = range(3)

# event (f8)
(E_TIME, E_TIME_STD, E_KIND, E_A6_BEFORE, E_A6_AFTER, E_A6_VARIANCE, E_K1_BEFORE, E_K1_AFTER, E_K1_VARIANCE,
 E_ALARM, E_FINAL) = range(11)
N_EVENT = 11


class Watch(NamedTuple):
    """State of the detector."""

    information: np.ndarray  # (HISTORY, 5) of each block: L aa, ak, kk, g a, g k
    belief: np.ndarray       # (HISTORY, 5) tracked before each block: mean a, k, covariance aa, ak, kk
    start: np.ndarray        # (HISTORY,) s, when each block began
    counts: np.ndarray       # (4,) int64: next slot, blocks kept, events, blocks since the last alarm
    event: np.ndarray        # (MAX_EVENTS, N_EVENT)
    onset: np.ndarray        # (len(LENGTHS),) log Bayes factors of the onsets tried
    reference: np.ndarray    # (5,) belief before the last change


def watch() -> Watch:
    """Allocate the detector."""
    return Watch(np.zeros((HISTORY, 5)), np.zeros((HISTORY, 5)), np.zeros(HISTORY), np.zeros(4, np.int64),
                 np.zeros((MAX_EVENTS, N_EVENT)), np.zeros(len(LENGTHS)), np.zeros(5))


@kernel
def log_density(l_aa, l_ak, l_kk, d_a, d_k, v_aa, v_ak, v_kk):
    """-1/2 ln|I + V L| + 1/2 d' V (I + L V)^-1 d for symmetric 2x2 L, V."""
    m11 = 1.0 + l_aa * v_aa + l_ak * v_ak
    m12 = l_aa * v_ak + l_ak * v_kk
    m21 = l_ak * v_aa + l_kk * v_ak
    m22 = 1.0 + l_ak * v_ak + l_kk * v_kk
    determinant = m11 * m22 - m12 * m21
    x_a = (m22 * d_a - m12 * d_k) / determinant
    x_k = (m11 * d_k - m21 * d_a) / determinant
    quadratic = d_a * (v_aa * x_a + v_ak * x_k) + d_k * (v_ak * x_a + v_kk * x_k)
    return 0.5 * quadratic - 0.5 * math.log(determinant)


@kernel
def remember(state, belief, block, t):
    """Store a block that began at t: what was believed before it, and what it says."""
    slot = state.counts[0]
    for k in range(5):
        state.belief[slot, k] = belief[k]
    a, b, c = block[0, 0], block[0, 1], block[1, 1]
    row = state.information[slot]
    row[0], row[1], row[2] = a * a, a * b, b * b + c * c
    row[3], row[4] = a * block[0, 2], b * block[0, 2] + c * block[1, 2]
    state.start[slot] = t
    state.counts[0] = (slot + 1) % HISTORY
    state.counts[1] = min(state.counts[1] + 1, HISTORY)
    state.counts[3] += 1


@kernel
def bayes_factor(total, belief, kind, duration):
    """Log Bayes factor of a jump of this kind against none, for summed information `total` (5,) since the onset."""
    m_a, m_k = belief[0], belief[1]
    d_a = total[3] - total[0] * m_a - total[1] * m_k
    d_k = total[4] - total[1] * m_a - total[2] * m_k
    drift = DRIFT * DRIFT * duration
    v_aa, v_ak, v_kk = belief[2] + drift, belief[3], belief[4] + drift
    still = log_density(total[0], total[1], total[2], d_a, d_k, v_aa, v_ak, v_kk)
    jump = JUMP_STD * JUMP_STD
    if kind != K1_JUMP:
        v_aa += jump
    if kind != A6_JUMP:
        v_kk += jump
    return log_density(total[0], total[1], total[2], d_a, d_k, v_aa, v_ak, v_kk) - still


@kernel
def search(state, total, dt):
    """Best onset and kind; returns (log Bayes factor, blocks since the onset, kind).  total (5,) scratch."""
    total[:] = 0.0
    best, best_length, best_kind = -np.inf, 0, 0
    done = 0
    for k in range(len(LENGTHS)):
        state.onset[k] = -np.inf
        length = LENGTHS[k]
        if length > state.counts[1]:
            continue
        for back in range(done, length):
            row = state.information[(state.counts[0] - 1 - back) % HISTORY]
            for i in range(5):
                total[i] += row[i]
        done = length
        belief = state.belief[(state.counts[0] - length) % HISTORY]
        for kind in range(3):
            value = bayes_factor(total, belief, kind, length * dt)
            state.onset[k] = max(state.onset[k], value)
            if value > best:
                best, best_length, best_kind = value, length, kind
    return best, best_length, best_kind


@kernel
def onset_time(state, length, dt):
    """Mean and std [s] of the onset, the onsets tried weighted by their Bayes factors."""
    best = -np.inf
    for k in range(len(LENGTHS)):
        best = max(best, state.onset[k])
    norm = mean = square = 0.0
    for k in range(len(LENGTHS)):
        w = math.exp(state.onset[k] - best)
        age = LENGTHS[k] * dt
        norm += w
        mean += w * age
        square += w * age * age
    mean /= norm
    now = state.start[(state.counts[0] - 1) % HISTORY] + dt
    return now - mean, math.sqrt(max(square / norm - mean * mean, 0.0) + dt * dt / 3.0)


@kernel
def update_gaussian(belief, total):
    """Belief (5,) inout: mean and covariance after the information `total` (5,)."""
    l_aa, l_ak, l_kk = total[0], total[1], total[2]
    d_a = total[3] - l_aa * belief[0] - l_ak * belief[1]
    d_k = total[4] - l_ak * belief[0] - l_kk * belief[1]
    v_aa, v_ak, v_kk = belief[2], belief[3], belief[4]
    m11, m12 = 1.0 + v_aa * l_aa + v_ak * l_ak, v_aa * l_ak + v_ak * l_kk
    m21, m22 = v_ak * l_aa + v_kk * l_ak, 1.0 + v_ak * l_ak + v_kk * l_kk
    determinant = m11 * m22 - m12 * m21
    belief[2] = (m22 * v_aa - m12 * v_ak) / determinant
    belief[3] = (m22 * v_ak - m12 * v_kk) / determinant
    belief[4] = (m11 * v_kk - m21 * v_ak) / determinant
    belief[0] += belief[2] * d_a + belief[3] * d_k
    belief[1] += belief[3] * d_a + belief[4] * d_k


@kernel
def raise_alarm(state, length, kind, t_onset, t_std, t_now, total, after):
    """Record an event, and what to believe now: the belief before the onset, a jump, and the data since.

    total (5,) scratch;  after (5,) out, the belief to restart the tracker with
    """
    before = state.belief[(state.counts[0] - length) % HISTORY]
    total[:] = 0.0
    for back in range(length):
        row = state.information[(state.counts[0] - 1 - back) % HISTORY]
        for i in range(5):
            total[i] += row[i]
    jump = JUMP_STD * JUMP_STD
    for i in range(5):
        state.reference[i] = before[i]
        after[i] = before[i]
    after[2] += jump if kind != K1_JUMP else 0.0
    after[4] += jump if kind != A6_JUMP else 0.0
    update_gaussian(after, total)
    event = state.event[state.counts[2] % MAX_EVENTS]
    event[:] = 0.0
    event[E_TIME], event[E_TIME_STD], event[E_KIND], event[E_ALARM] = t_onset, t_std, kind, t_now
    size_event(state, event, after)
    state.counts[2] += 1
    state.counts[1] = 0
    state.counts[3] = length


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
    if state.counts[2] == 0 or state.counts[3] < SETTLE:
        return
    event = state.event[(state.counts[2] - 1) % MAX_EVENTS]
    if event[E_FINAL] == 0.0:
        size_event(state, event, belief)
        event[E_FINAL] = 1.0
