"""Find rows in which a sensor is at an end stop: the largest or the smallest value of its column comes again and again,
to the bit, far more often than those next to it, and the motion runs into it and leaves again.

A quantised channel is at its last step hardly more often than at those before; what comes to rest comes slowly; a
channel of a slower rate, or a reference, repeats elsewhere too.  The nozzle is not checked: at the command's limit it
really is there.

Limitations: noise added after the stop hides it, and so does a quantum beyond the noise; a stand that runs into a
mechanical stop, rests and leaves it, looks the same.
"""

from collections.abc import Iterator

import numpy as np

from .fault import Fault
from .runs import runs_of

SENSED = ("theta", "theta_dot")
FEWEST_STOPPED = 5     # rows at a stop
FEWEST_LEVELS = 20     # different values: a channel of fewer shows its quantum, and rests at any of them
BESIDE_VALUES = 3      # values next to the last one
MORE_OFTEN = 4.0       # times as many rows as any of these: at the crest of a quantised sine 2.4
SELDOM = 0.2           # of the other rows repeat the one before, at most: a reference rests elsewhere too
MIN_STOP = 0.1         # of the largest value: nearer to zero no sensor's range ends
ENTRY = 3              # steps before a run
LARGEST_STEP_AT_REST = 0.1  # of the usual step, the largest of these: what comes to rest is slower
OVERFLOW = 0.75        # of the whole range, that a number that overflows jumps over
WITHOUT = 2.0          # times as large as any other step
CHOSEN = 3             # rows beside a stop that are left out with it
MIN_ROWS_AT_STOP = 3   # rows beyond the end, once at least: else these are spikes


Ends = tuple[np.ndarray, np.ndarray]  # values in order, and how many rows have each


def ends_of(x: np.ndarray, before: Ends | None = None) -> Ends:
    """Return (values in order, rows of each) of x (n,) with `before`: the lowest and the highest FEWEST_LEVELS."""
    values, rows = np.unique(x, return_counts=True)
    if before is not None:
        values, place = np.unique(np.concatenate([before[0], values]), return_inverse=True)
        rows = np.bincount(place, np.concatenate([before[1], rows]), len(values)).astype(int)
    kept = np.r_[:len(values)] if len(values) <= 2 * FEWEST_LEVELS else np.r_[:FEWEST_LEVELS, -FEWEST_LEVELS:0]
    return values[kept], rows[kept]


def last_values(ends: Ends) -> list[float]:
    """Return the largest and the smallest value, each only if it has far more rows than the values next to it."""
    values, rows = ends
    if len(values) < FEWEST_LEVELS:
        return []
    return [float(value) for value, count, beside in ((values[-1], rows[-1], rows[-1 - BESIDE_VALUES:-1]),
                                                      (values[0], rows[0], rows[1:1 + BESIDE_VALUES]))
            if abs(value) > MIN_STOP * np.max(np.abs(values))
            and count >= max(FEWEST_STOPPED, MORE_OFTEN * np.max(beside))]


def end_stops(x: np.ndarray, ends: Ends | None = None) -> np.ndarray:
    """Return (n,) bool: rows of x (n,), all finite, at an end stop of the sensor.

    ends  `ends_of` all rows so far, of which x are the last; None: x are all
    """
    stopped = np.zeros(len(x), bool)
    steps = np.abs(np.diff(x))
    if not steps.any():
        return stopped
    repeats, usual = steps == 0.0, float(np.median(steps[steps > 0.0]))
    at_end = last_values(ends_of(x))
    if ends is not None:   # what is an end of these rows alone is a place where a coarse channel rests
        at_end = [value for value in at_end if value in last_values(ends)]
    elsewhere = ~np.isin(x[1:], at_end)
    if np.count_nonzero(repeats & elsewhere) > SELDOM * np.count_nonzero(elsewhere):
        return stopped
    for at in (x == value for value in at_end):
        entries = [steps[max(0, start - ENTRY):start].max(initial=0.0) for start, end in runs_of(at) if end < len(x)]
        if max(entries, default=0.0) > LARGEST_STEP_AT_REST * usual:
            stopped |= at
    return stopped


def stopped(name: str, t: np.ndarray, x: np.ndarray, mask: np.ndarray, so_far: Ends | None = None) -> Iterator[Fault]:
    """Yield the Fault of rows of x (n,) at an end stop; set mask (n,) False there and next to them, in place.

    so_far  `ends_of` all rows so far, of which x are the last; None: x are all
    """
    rows = np.flatnonzero(mask)
    at = rows[end_stops(x[rows], so_far)] if len(rows) else rows
    if len(at):
        near = np.convolve(np.isin(rows, at), np.ones(2 * CHOSEN + 1), mode="same") > 0.5
        mask[rows[near]] = False   # of rows beside it noise chose those below it
        ends = " and ".join(f"{value:.4g}" for value in np.unique(x[at]))
        yield Fault("stale", name, float(t[at[0]]), float(t[at[-1]]), len(at),
                    f"{name} is at an end stop of its sensor ({ends}) in {len(at)} rows, first at t = "
                    f"{t[at[0]]:.6g} s; what it measured there is left out: set a wider range of the sensor")


def wrapped_rows(x: np.ndarray) -> np.ndarray:
    """Return (n,) bool: rows of x (n,), all finite, whose number overflowed to the other end of its range.

    Overflow is a jump over nearly the whole range and one back, far larger than any other step; the shorter of the
    stretches between two such jumps is the one beyond the end.
    """
    over = np.zeros(len(x), bool)
    steps, whole = np.abs(np.diff(x)), float(np.ptp(x)) if len(x) else 0.0
    jumps = np.flatnonzero(steps > OVERFLOW * whole)
    others = np.delete(steps, jumps)
    if not 2 <= len(jumps) < SELDOM * len(x) or np.max(others) * WITHOUT > OVERFLOW * whole:
        return over
    up = np.diff(x)[jumps] > 0.0
    level = np.concatenate([[0], np.cumsum(np.where(up, -1, 1))])   # turns of the range to be added
    parts = np.repeat(level, np.diff(np.concatenate([[0], jumps + 1, [len(x)]])))
    values, counts = np.unique(parts, return_counts=True)
    over = np.asarray(parts != values[int(np.argmax(counts))])
    return over if np.max(np.diff(runs_of(over), axis=1)) >= MIN_ROWS_AT_STOP else np.zeros(len(x), bool)


def ran_over(name: str, t: np.ndarray, x: np.ndarray, mask: np.ndarray) -> Iterator[Fault]:
    """Yield the Fault of rows of x (n,) whose number overflowed its range; set mask (n,) False there, in place."""
    rows = np.flatnonzero(mask)
    at = rows[wrapped_rows(x[rows])]
    if len(at):
        mask[at] = False
        yield Fault("stale", name, float(t[at[0]]), float(t[at[-1]]), len(at),
                    f"{name} jumps from one end of its range to the other and back in {len(at)} rows, first at t = "
                    f"{t[at[0]]:.6g} s: its number overflows; these rows are left out")
