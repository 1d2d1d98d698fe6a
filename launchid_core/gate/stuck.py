"""A sensor that stands still: the same value over and over while what it measures moves.

A run of n repeats has the chance p^n, p being the channel's share of repeats, learned from window to window and in the
window outside the longest run.  A run below IMPROBABLE is a stuck sensor if its neighbour moved meanwhile by more
than QUANTUM_STEPS of the channel's smallest steps: the rate's integral for theta, theta for the rate, the command for
the nozzle.  A nozzle without a logged command is not judged (it may be held), nor is a channel that never moved.
"""

import numpy as np

from ..kernels import inner
from .ring import BETA, BETA_CMD, THETA, THETA_DOT, T, place_of_row

MIN_REPEATS = 5       # repeats: below it no sensor is called stuck
IMPROBABLE = 1.0e-12  # once in 300 years at 100 Hz
QUANTUM_STEPS = 3.0   # of the channel's smallest: a quantised value is off by half a step
NEW_WEIGHT = 0.1      # weight of a window's share of repeats: the last ten windows
N_WATCHED = 3         # theta, theta_dot, beta


@inner
def longest_run(ring, counts, column, stop):
    """(repeats in the longest run, its last row, repeats in all, smallest step) of a channel in the closed window."""
    run, longest, end, repeats, smallest = 0, 0, 0, 0, np.inf
    before = ring[place_of_row(counts, ring, 0), column]
    for k in range(1, counts.closed_rows):
        now = ring[place_of_row(counts, ring, k), column]
        if before == now and (stop == np.inf or abs(now) < stop):  # at its end stop it may stand still
            run += 1
            repeats += 1
            if run > longest:
                longest, end = run, k
        else:
            run = 0
            step = abs(now - before)
            if 0.0 < step < smallest:
                smallest = step
        before = now
    return longest, end, repeats, smallest


@inner
def contradiction(ring, counts, column, first, last):
    """The motion of a channel, by its neighbour, while its value stood still, rows `first` to `last` [its unit]."""
    begin, end = ring[place_of_row(counts, ring, first)], ring[place_of_row(counts, ring, last)]
    span = end[T] - begin[T]
    if column == BETA:
        return abs(end[BETA_CMD] - begin[BETA_CMD])
    if column == THETA_DOT:
        return abs(end[THETA] - begin[THETA] - span * begin[THETA_DOT]) / span
    moved = 0.0
    for k in range(first + 1, last + 1):
        before, now = ring[place_of_row(counts, ring, k - 1)], ring[place_of_row(counts, ring, k)]
        moved += 0.5 * (before[THETA_DOT] + now[THETA_DOT]) * (now[T] - before[T])
    return abs(moved)


@inner
def is_stuck(ring, counts, learned, channel, stop):
    """Whether a channel stood still in the closed window; what it is like otherwise is learned.  learned  Repeats"""
    column = THETA + channel
    run, last, repeats, smallest = longest_run(ring, counts, column, stop)
    rows = counts.closed_rows
    share, chance = max((repeats - run + 1.0) / (rows - run + 1.0), learned.share[channel]), 1.0
    if run >= MIN_REPEATS:
        for _ in range(run):
            chance *= share
    if learned.step[channel] > 0.0 and chance < IMPROBABLE:
        if contradiction(ring, counts, column, last - run, last) > QUANTUM_STEPS * learned.step[channel]:
            return True
    if rows > 1:
        learned.share[channel] += NEW_WEIGHT * (repeats / (rows - 1.0) - learned.share[channel])
    if np.isfinite(smallest):
        learned.step[channel] = min(smallest, learned.step[channel]) if learned.step[channel] > 0.0 else smallest
    return False


@inner
def stands_still(ring, counts, learned, stops):
    """Whether any channel stood still in the closed window; counted.  stops (>=3,): of theta, theta_dot, beta"""
    stuck = False
    for k in range(N_WATCHED):
        stuck = is_stuck(ring, counts, learned, k, stops[k]) or stuck
    counts.stuck += int(stuck)
    return stuck
