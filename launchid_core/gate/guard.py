"""Seals over the memory that steers the estimator or is carried on: they show whether it changed by itself.

A seal is the exclusive or of all words of what it guards, so any one word that changed by itself is seen, whichever
bits of it did (radiation, a stray write).  Three of them:

* CONTROL, over clock and window counts, looked at and renewed with every sample;
* one for each row of the ring, looked at when the row is used;
* CARRIED, over everything else that persists (filter, information, tracker, detectors, structure, range, generator of
  rows), looked at before a block or a window uses it and renewed afterwards.

Not guarded: the counters of answers, and the last outcome, which the next window overwrites.

What is not as it was left is not used: the kernel answers RECOVERED and the caller begins anew.  So does it where what
is carried is no longer sound: not finite, or absurd (`onboard.is_sound`).
"""

import numpy as np

from ..kernels import inner
from . import ring as rb

CONTROL, CARRIED = range(2)


@inner
def xor_integer(seal, n):
    """The seal with the integer n taken in: seal xor n."""
    return seal ^ n


@inner
def xor_double(seal, x):
    """The seal with the bits of the double x taken in: seal xor these."""
    return seal ^ np.float64(x).view(np.int64)


@inner
def fold(x, count):
    """Seal of the first `count` doubles of a vector."""
    seal = 0
    for k in range(count):
        seal = xor_double(seal, x[k])
    return seal


@inner
def fold_words(words):
    """Seal of the words that an estimator carries on, seen as int64."""
    seal = 0
    for k in range(words.shape[0]):
        seal ^= words[np.uint64(k)]
    return seal


# ---- clock, counts and rows


@inner
def seal_control(clock, counts):
    """Seal of what says where samples go and when windows close."""
    seal = fold(clock, rb.N_CLOCK)
    for k in range(rb.COUNT_FIRST):
        seal = xor_integer(seal, counts[k])
    return seal


@inner
def is_row_whole(ring, seals, at):
    """Whether a row of the ring is as it was written."""
    return fold(ring[at], rb.N_COLUMNS) == seals[at]


@inner
def are_rows_whole(ring, seals, counts):
    """Whether the closed window's rows are as they were written."""
    whole = True
    for k in range(counts[rb.CLOSED_ROWS]):
        whole = whole and is_row_whole(ring, seals, rb.place_of_row(counts, ring, k))
    return whole


@inner
def is_control_whole(state):
    """Whether clock and counts are as they were left."""
    return seal_control(state.clock, state.counts) == state.guard[CONTROL]


@inner
def close_control(state):
    """Clock and counts stay as they are until the next sample."""
    state.guard[CONTROL] = seal_control(state.clock, state.counts)


@inner
def refuse(limits, counts, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Memory is damaged and nothing has been taken: RECOVERED, or why this sample cannot be the first of all."""
    code = rb.gate(limits, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    if code == rb.ACCEPTED:
        return rb.RECOVERED
    counts[rb.COUNT_FIRST + code - rb.BUSY] += 1
    return code


@inner
def take_sample(fixed, state, ring, seals, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Gate and ring: the sample's Status.  Its row, clock and counts stay as they are until they are used."""
    counts = state.counts
    if not is_control_whole(state):
        return refuse(fixed.limits, counts, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    newest = counts[rb.HEAD]
    code = rb.push(fixed.limits, state.clock, counts, ring, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    if code >= 0:
        seals[newest] = fold(ring[newest], rb.N_COLUMNS)
    close_control(state)
    return code


@inner
def give_up(counts, code):
    """Memory is damaged after the sample was taken and counted as `code`: RECOVERED."""
    counts[rb.COUNT_FIRST + code - rb.BUSY] -= 1
    return rb.RECOVERED


# ---- what is carried on


@inner
def fold_rows(rows, columns, count):
    """Seal of the first `count` numbers of so many columns of a block's rows."""
    seal = 0
    for j in range(columns):
        seal = xor_integer(seal, fold(rows[j], count))
    return seal
