"""Channels of another rate than the log's, whose last value a logger wrote into the rows between.

Each value stands for a regular number of rows, to the bit, and its steps are larger than a quantum: a quantised channel
repeats where it moves slowly.  Taken for measurements the repeats are a late sensor, or a slow servo.
"""

import math
from collections.abc import Iterator

import numpy as np

from .fault import Fault

FEWEST_VALUES = 20     # less tell no rate
REGULAR = 0.9          # of the values stay for the usual number of rows, or one more or less
QUANTA = 3.5           # times the smallest step the usual one is at least
SMALLEST = 0.2         # of the steps may be about the smallest: of a quantised motion most are


def filled_forward(name: str, t: np.ndarray, x: np.ndarray, mask: np.ndarray) -> Iterator[Fault]:
    """The repeats in a channel x (n,) of another rate; clears them in mask (n,) inout."""
    rows = np.flatnonzero(mask)
    begins = np.flatnonzero(np.diff(x[rows], prepend=math.nan) != 0.0)
    if len(begins) < FEWEST_VALUES:
        return
    lengths, moves = np.diff(begins), np.abs(np.diff(x[rows][begins]))
    usual = int(np.median(lengths))
    if usual < 2 or np.mean(np.abs(lengths - usual) <= 1) < REGULAR or \
            np.median(moves) < QUANTA * np.min(moves) or np.mean(moves < 1.5 * np.min(moves)) > SMALLEST:
        return
    repeats = np.setdiff1d(rows, rows[begins])
    mask[repeats] = False
    rate = 1.0 / float(np.median(np.diff(t[rows[begins]])))
    yield Fault("stale", name, float(t[repeats[0]]), float(t[repeats[-1]]), len(repeats),
                f"{name} is of {rate:.3g} Hz, each value repeated in the rows up to the next: the first of each "
                "counts, the repeats are left out")
