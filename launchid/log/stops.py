"""End stops of a sensor, as its column shows them: the largest or the smallest value comes again and again, to the bit,
far more often than those next to it, and the motion runs into it and leaves again.

A quantised channel is at its last step hardly more often than at those before; what comes to rest comes slowly; a
channel of a slower rate, or a reference, repeats elsewhere too.  The nozzle is not asked: at the command's limit it
really is there.

Limitations: noise added after the stop hides it, and so does a quantum beyond the noise; a stand that runs into a stop
of its own, rests and leaves it, looks the same.
"""

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from .fault import Fault
from .log import Log
from .runs import runs_of

SENSED = ("theta", "theta_dot")
FEWEST_STOPPED = 5     # rows at a stop
BESIDE_VALUES = 3      # values next to the last one
MORE_OFTEN = 4.0       # times as many rows as any of these: at the crest of a quantised sine 2.4
SELDOM = 0.2           # of the other rows repeat the one before, at most: a reference rests elsewhere too
ONE_SIDED = 0.5        # of the largest value: a range is as wide to both sides, but for an offset
ENTRY = 3              # steps before a run
FAST = 0.1             # of the usual step, the largest of these: what comes to rest is slower


def end_stops(x: np.ndarray) -> np.ndarray:
    """(n,) bool: the rows of x (n,), all finite, at an end stop."""
    stopped = np.zeros(len(x), bool)
    steps = np.abs(np.diff(x))
    if not steps.any():
        return stopped
    values, rows = np.unique(x, return_counts=True)
    repeats, usual = steps == 0.0, float(np.median(steps[steps > 0.0]))
    ends = [value for value, count, beside in ((values[-1], rows[-1], rows[-1 - BESIDE_VALUES:-1]),
                                               (values[0], rows[0], rows[1:1 + BESIDE_VALUES]))
            if abs(value) > ONE_SIDED * np.max(np.abs(x)) and count >= max(FEWEST_STOPPED, MORE_OFTEN * np.max(beside))]
    elsewhere = ~np.isin(x[1:], ends)
    if np.count_nonzero(repeats & elsewhere) > SELDOM * np.count_nonzero(elsewhere):
        return stopped
    for at in (x == value for value in ends):
        entries = [steps[max(0, start - ENTRY):start].max(initial=0.0) for start, end in runs_of(at) if end < len(x)]
        if max(entries, default=0.0) > FAST * usual:
            stopped |= at
    return stopped


def stopped(name: str, t: np.ndarray, x: np.ndarray, mask: np.ndarray) -> Iterator[Fault]:
    """Rows of x (n,) at an end stop of its sensor; clears them in mask (n,) inout."""
    rows = np.flatnonzero(mask)
    at = rows[end_stops(x[rows])] if len(rows) else rows
    if len(at):
        mask[at] = False
        ends = " and ".join(f"{value:.4g}" for value in np.unique(x[at]))
        yield Fault("stale", name, float(t[at[0]]), float(t[at[-1]]), len(at),
                    f"{name} is at an end stop of its sensor ({ends}) in {len(at)} rows, first at t = "
                    f"{t[at[0]]:.6g} s; what it measured there is left out")


def without_stops(log: Log) -> Log:
    """The log, nothing measured where a sensor is at its end stop."""
    cleared = {}
    for name in SENSED:
        x, rows = getattr(log, name).copy(), np.flatnonzero(log.in_range(name))
        x[rows[end_stops(x[rows])]] = math.nan
        cleared[name] = x
    return dataclasses.replace(log, **cleared)


def saturations(log: Log) -> dict[str, Any]:
    """The end stops that a log's sensors show, as fields of `Config`; a range is taken for as wide to both sides."""
    found = {}
    for name in SENSED:
        x = getattr(log, name)[log.in_range(name)]
        if (at := end_stops(x)).any():
            found[f"{name}_saturation"] = float(np.min(np.abs(x[at])))
    return found
