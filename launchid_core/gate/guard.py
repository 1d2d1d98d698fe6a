"""Seals over the memory that steers the estimator or is carried on: they show whether it changed by itself.

A seal is the exclusive or of all words of what it guards, each turned by its place, and mixed anew after every GROUP
words: one word that changed by itself is seen, whichever bits of it did (radiation, a stray write), and so are the same
bit in two words, two neighbours exchanged and words that became zero.  Three of them:

* CONTROL, over clock and window counts, looked at and renewed with every sample;
* one for each row of the ring, looked at when the row is used;
* CARRIED, over everything else that persists (filter, information, tracker, detectors, structure, range, generator of
  rows), looked at before a block or a window uses it and renewed afterwards.

Not guarded: the counters of answers, and the last outcome, which the next window overwrites.  Whatever a seal says,
no place and no count of rows is used that does not lie within its array (`is_control_whole`, `onboard.check_block`).

What is not as it was left is not used: the kernel answers RECOVERED and the caller begins anew.  So does it where what
is carried is no longer sound: not finite, or absurd (`filtered.is_sound`).
"""

import numpy as np

from ..kernels import inner
from . import ring as rb

GROUP = 64     # words: the bits of a word, so that no two of a group are turned alike


@inner
def seal_integer(seal, n, place):
    """Return the seal with the integer n taken in, rotated to the left by its place."""
    bits, turn = np.int64(n).view(np.uint64), np.uint64(place & 63)
    turned = (bits << turn) | (bits >> ((np.uint64(64) - turn) & np.uint64(63)))
    return seal ^ np.uint64(turned).view(np.int64)


@inner
def seal_double(seal, x, place):
    """Return the seal with the bits of the double x taken in, rotated to the left by its place."""
    return seal_integer(seal, np.float64(x).view(np.int64), place)


@inner
def mixed(seal):
    """The seal's bits spread over it: a step of the generator xorshift64 (Marsaglia, J. Stat. Softw. 8, 2003)."""
    bits = np.int64(seal).view(np.uint64)
    bits ^= bits << np.uint64(13)
    bits ^= bits >> np.uint64(7)
    bits ^= bits << np.uint64(17)
    return np.uint64(bits).view(np.int64)


@inner
def fold(x, count):
    """Seal of the first `count` doubles of a vector."""
    seal = 0
    for k in range(count):
        if k % GROUP == 0:
            seal = mixed(seal)
        seal = seal_double(seal, x[k], k)
    return seal


@inner
def fold_words(words):
    """Seal of the words that an estimator carries on, seen as int64."""
    seal = 0
    for begin in range(0, words.shape[0], GROUP):
        part = 0
        for k in range(begin, min(begin + GROUP, words.shape[0])):
            part = seal_integer(part, words[np.uint64(k)], k)
        seal = mixed(seal) ^ part
    return seal


# ---- clock, counts and rows


@inner
def seal_control(clock, counts):
    """Seal of the clock and of the counts that place samples and close windows: all but the counts of answers."""
    stamps = (clock.first, clock.last, clock.candidate, clock.closed, clock.turned, clock.before)
    places = (counts.head, counts.rows, counts.closed_rows, counts.closed_back, counts.started, counts.index,
              counts.candidates, counts.waiting, counts.estimates, counts.stuck, counts.wraps)
    seal = 0
    for k in range(len(stamps)):
        seal = seal_double(seal, stamps[k], k)
    for k in range(len(places)):
        seal = seal_integer(seal, places[k], len(stamps) + k)
    return seal


@inner
def is_row_whole(ring, seals, at):
    """Whether a row of the ring is as it was written."""
    return fold(ring[at], rb.N_COLUMNS) == seals[at]


@inner
def is_control_whole(state, capacity):
    """Whether clock and counts are as they were left, and within a ring of so many rows."""
    counts = state.counts
    within = 0 <= counts.head < capacity and 0 <= counts.rows < capacity
    within = within and 0 <= counts.closed_rows < capacity and 0 <= counts.closed_back <= 1
    return within and counts.waiting >= 0 and seal_control(state.clock, counts) == state.guard.control


@inner
def take_sample(fixed, state, ring, seals, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Pass a sample through gate and ring; return its Status.  Its row, clock and counts stay as they are until they
    are used.

    Where memory is damaged nothing is taken: RECOVERED, or why this sample cannot be the first of all.
    """
    counts = state.counts
    if not is_control_whole(state, ring.shape[0]):
        code = rb.gate(fixed.limits, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
        if code == rb.ACCEPTED:
            return rb.RECOVERED
        counts.answers[code - rb.BUSY] += 1
        return code
    newest = counts.head
    code = rb.push(fixed.limits, state.clock, counts, ring, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    if code >= 0:
        seals[newest] = fold(ring[newest], rb.N_COLUMNS)
    state.guard.control = seal_control(state.clock, counts)
    return code


@inner
def give_up(counts, code):
    """Answer RECOVERED for a sample that was counted as `code` before its memory was found damaged."""
    counts.answers[code - rb.BUSY] -= 1
    return rb.RECOVERED
