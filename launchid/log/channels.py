"""Find faults of one log column by itself: infinite or absurd values, dropouts, stale runs, spikes.

No model of the vehicle is used, and a physical effect must pass.  A run of one value is bad where it is far longer than
the channel's usual runs although noise moves the rows beside it, or where the channel leaves it with a jump that
nothing beside it has.  A spike is a row that neither the noise nor the motion beside it explains.

Limitations: a channel without noise, or with a quantum that hides it, shows a stale run only by the jump at its end; a
spike of two rows or more is not found.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from .fault import Fault
from .runs import runs_of
from .stops import SENSED, Ends, ran_over, stopped

SENSOR_COLUMNS = ("theta", "theta_dot", "beta")  # by sensors: these may freeze and spike
NOZZLE_COLUMN, COMMAND_COLUMN = "beta", "beta_cmd"
LARGEST_ANGLE = 1e4  # rad, rad/s: beyond it no channel holds a measurement, in degrees neither
FEWEST_RUN = 5       # rows without a value, or of zeros
FEWEST_STALE = 10    # rows of one value: an input at its limit is there for fewer
USUAL = 0.99         # of a channel's runs, single values among them, are no longer than its usual ones
LONGER = 5.0         # times as long: the longest of a clean channel whose noise shows are 3.5 times
DITHER = 0.12        # of the steps on one side reverse the one before: noise moves the value, not the motion alone
QUANTISED_STEPS = 0.4  # of the steps on one side are none: the quantum hides the noise, a run's length tells nothing
JUMP_OVER_STEP = 4.0  # times the largest step beside a run, or the quantum
REST_STEP = 0.2      # of the usual step there, the largest of those next to the run: less is coming to rest
ROWS_AROUND = 40     # rows on either side that count as beside a run or a spike
FEWEST_BESIDE = 8    # of them tell something
SPIKE_OVER_RESIDUAL = 7.5  # times the usual residual: nine standard deviations of the noise
SERVO_STEP = 0.25    # of a step of the command that lasts for a row, at most, comes through
ROWS_NEXT_TO = 6     # rows on either side that count as next to it
USUAL_SHARE = 0.75   # of steps and residuals there are no larger than the usual one: others belong to another spike
SPIKE_OVER_STEP = 1.4  # times the usual step: a fast motion is no spike
LEVEL_SHIFT = 0.7    # of the spike: if the rows before and after differ by more, the signal has moved
SPIKE_PASSES = 8     # of marking the largest and looking again
INTERPOLATION = np.array([-1.0, 4.0, 0.0, 4.0, -1.0]) / 6.0  # cubic, from two rows on either side
FEWEST_MEASURED = 20     # less tell nothing about a channel's noise


def _plural(count: int, word: str) -> str:
    return f"{count} {word}" if count == 1 else f"{count} {word}s"


def judged(t: np.ndarray, columns: Mapping[str, np.ndarray], usable: np.ndarray,
           own: Mapping[str, np.ndarray], ends: Mapping[str, Ends]) -> tuple[dict[str, np.ndarray], list[Fault]]:
    """Check each column (n,) by itself; return (masks, faults), mask (n,) bool: the value may be used.

    usable (n,) bool: good stamp;  own  sensor column -> (n,) bool: measured, not filled in by a logger
    ends   column -> `stops.ends_of` of all rows so far, where these rows continue a log
    """
    masks: dict[str, np.ndarray] = {}
    faults: list[Fault] = []
    for name, x in columns.items():
        masks[name] = np.isfinite(x) & usable
        faults += out_of_range(name, t, x, masks[name])
        faults += missing_runs(name, t, x)
    still = np.sum([columns[name] == 0.0 for name in SENSOR_COLUMNS], axis=0) >= 2
    resting = int(np.argmin(np.append(still, False)))  # rows in which an ideal vehicle has not moved yet
    faults += zero_rows(t, columns, masks, resting)
    for name in SENSOR_COLUMNS:
        if name == "theta_dot":
            faults += ran_over(name, t, columns[name], masks[name])
        if name in SENSED:
            faults += stopped(name, t, columns[name], masks[name], ends.get(name))
        faults += frozen_runs(name, t, columns[name], masks[name], own[name], resting)
        command = np.where(masks[COMMAND_COLUMN], columns[COMMAND_COLUMN],
                           np.nan) if name == NOZZLE_COLUMN else np.full(len(t), np.nan)
        faults += spikes(name, t, columns[name], masks[name], own[name], command)
    return masks, faults


def out_of_range(name: str, t: np.ndarray, x: np.ndarray, mask: np.ndarray) -> Iterator[Fault]:
    """Yield a Fault for infinite and one for absurdly large values of x (n,); set mask (n,) False there, in place."""
    for bad, what in ((np.isinf(x), "infinite"), (np.isfinite(x) & (np.abs(x) > LARGEST_ANGLE), "absurdly large")):
        rows = np.flatnonzero(bad)
        if len(rows) > 0:
            mask[rows] = False
            yield Fault("range", name, float(t[rows[0]]), float(t[rows[-1]]), len(rows),
                        f"{name} is {what} in {_plural(len(rows), 'row')}, first at t = {t[rows[0]]:.6g} s "
                        f"({x[rows[0]]:.3g}): an overflow or a marker of missing data; leave the cell empty")


# ---- runs


def missing_runs(name: str, t: np.ndarray, x: np.ndarray) -> Iterator[Fault]:
    """Yield one Fault for dropouts of x (n,), runs of FEWEST_RUN NaN or more, unless all is NaN or runs are many."""
    empty = np.isnan(x)
    if empty.all():
        return
    runs = [run for run in runs_of(empty) if run[1] - run[0] >= FEWEST_RUN]
    if runs and 2 * len(runs) < len(x) / FEWEST_RUN:
        count = int(sum(end - start for start, end in runs))
        start, end = runs[0][0], runs[-1][1] - 1
        yield Fault("dropout", name, float(t[start]), float(t[end]), count,
                    f"{name} has no value in {_plural(count, 'row')} ({_plural(len(runs), 'dropout')}), first at "
                    f"t = {t[start]:.6g} s: the sensor or its link was off; these rows are left out")


def zero_rows(t: np.ndarray, columns: Mapping[str, np.ndarray], masks: dict[str, np.ndarray],
              resting: int) -> Iterator[Fault]:
    """Yield one Fault for rows in which all sensors read exactly 0 although one of them is far from 0 beside most such
    rows: a logger writes 0 for a missing value.  Set masks (column -> (n,) bool) False there, in place.

    resting  number of first rows in which the vehicle has not moved yet: zeros there are true
    """
    there = {name: columns[name] for name in SENSOR_COLUMNS if np.isfinite(columns[name]).any()}
    zero = np.logical_and.reduce([np.arange(len(t)) >= resting, *(x == 0.0 for x in there.values())])
    runs = runs_of(zero)
    if len(there) < 2 or not 0 < 2 * len(runs) < len(t):
        return
    jumps = np.zeros(len(runs), bool)
    for x in there.values():
        moves = np.abs(np.diff(x[~zero & np.isfinite(x)]))
        usual = float(np.median(moves[moves > 0.0])) if (moves > 0.0).any() else 0.0
        beside = np.stack([np.abs(x[np.maximum(runs[:, 0] - 1, 0)]), np.abs(x[np.minimum(runs[:, 1], len(x) - 1)])])
        beside[0, runs[:, 0] == 0] = beside[1, runs[:, 1] == len(x)] = np.nan
        with np.errstate(invalid="ignore"):
            jumps |= np.fmin(beside[0], beside[1]) > JUMP_OVER_STEP * usual
    if np.mean(jumps) < 0.5:
        return
    rows = np.flatnonzero(zero)
    for name in there:
        masks[name][rows] = False
    yield Fault("dropout", None, float(t[rows[0]]), float(t[rows[-1]]), len(rows),
                f"{', '.join(there)} are exactly zero at once in {_plural(len(rows), 'row')}, first at t = "
                f"{t[rows[0]]:.6g} s: a logger writes 0 for what did not come; these rows are left out")


def frozen_runs(name: str, t: np.ndarray, x: np.ndarray, mask: np.ndarray, own: np.ndarray,
                resting: int) -> Iterator[Fault]:
    """Yield a Fault for runs of zeros (dropout) and one for runs of another value (stale) in x (n,), among the rows
    where mask (n,) and own (n,) are True; set mask False there, in place.

    resting  number of first rows in which the vehicle has not moved yet: a run that begins there is no fault
    """
    rows = np.flatnonzero(mask & own)
    values = x[rows]
    moves = np.abs(np.diff(values))
    if len(values) < FEWEST_MEASURED or not moves.any():
        return
    bounds = np.concatenate(([0], np.flatnonzero(moves) + 1, [len(values)]))
    lengths = np.diff(bounds)
    usual = np.sort(lengths)[int(USUAL * (len(lengths) - 1))]
    quantum = float(np.min(moves[moves > 0.0]))
    bad: dict[str, list[tuple[int, int]]] = {"dropout": [], "stale": []}
    for k in np.flatnonzero(lengths >= FEWEST_RUN):
        start, end = int(bounds[k]), int(bounds[k + 1])
        if rows[start] < resting or (values[start] != 0.0 and end - start < FEWEST_STALE):
            continue
        if (lengths[k] >= LONGER * usual and _dithers(values, start, end)) or _jumps(values, start, end, quantum):
            bad["dropout" if values[start] == 0.0 else "stale"].append((start, end))
    yield from _frozen_faults(name, t, x, mask, rows, bad)


def _frozen_faults(name: str, t: np.ndarray, x: np.ndarray, mask: np.ndarray, rows: np.ndarray,
                   bad: dict[str, list[tuple[int, int]]]) -> Iterator[Fault]:
    """Yield one Fault for each kind in `bad` (kind -> runs as indices of `rows`); set mask False there, in place."""
    for kind, runs in bad.items():
        if not runs:
            continue
        ends = np.min(x[rows]), np.max(x[rows])
        for start, end in runs:
            # the first of equal values was still measured, zeros were not
            mask[rows[start + (kind == "stale"):end]] = False
        count = int(sum(end - start for start, end in runs))
        first, last = rows[runs[0][0]], rows[runs[-1][1] - 1]
        what = "is exactly zero" if kind == "dropout" else f"repeats its value ({x[first]:.4g})"
        why = "the sensor or its link was off" if kind == "dropout" else "the sensor or its link froze"
        if kind == "stale" and x[first] in ends:
            why = "the sensor is at an end of its range, or froze"
        yield Fault(kind, name, float(t[first]), float(t[last]), count,
                    f"{name} {what} for {_plural(count, 'row')} ({_plural(len(runs), 'run')}), first at "
                    f"t = {t[first]:.6g} s: {why}; these rows are left out")


def _dithers(values: np.ndarray, start: int, end: int) -> bool:
    """Whether noise moves the values on both sides of run [start, end), up to its ends (a motion stops smoothly)."""
    before = np.diff(values[max(0, start - ROWS_AROUND):start + 1])[::-1]
    sides = [steps for steps in (before, np.diff(values[end - 1:end + ROWS_AROUND])) if len(steps) >= FEWEST_BESIDE]
    return len(sides) > 0 and all(
        np.mean(steps[1:] * steps[:-1] < 0.0) >= DITHER and np.mean(steps == 0.0) < QUANTISED_STEPS
        and np.max(np.abs(steps[:ROWS_NEXT_TO])) > REST_STEP * np.median(np.abs(steps)) for steps in sides)


def _jumps(values: np.ndarray, start: int, end: int, quantum: float) -> bool:
    """Whether the value jumps out of run [start, end), or into a run of zeros, by more than any step beside it."""
    beside = np.abs(np.concatenate((np.diff(values[max(0, start - ROWS_AROUND):start]),
                                    np.diff(values[end:end + ROWS_AROUND]))))
    if len(beside) < FEWEST_BESIDE:
        return False
    least = JUMP_OVER_STEP * max(quantum, float(np.max(beside)))
    enters = start > 0 and abs(values[start] - values[start - 1]) > least and values[start] == 0.0
    leaves = end < len(values) and abs(values[end] - values[end - 1]) > least
    return bool(enters or leaves)


# ---- spikes


def spikes(name: str, t: np.ndarray, x: np.ndarray, mask: np.ndarray, own: np.ndarray,
           command: np.ndarray) -> Iterator[Fault]:
    """Yield one Fault for the spikes of x (n,) where mask (n,) and own (n,) are True; set mask False there, in place.

    command (n,)  nozzle command that x follows, whose steps are no spikes; NaN where there is none
    """
    rows = np.flatnonzero(mask & own)
    if len(rows) < FEWEST_MEASURED:
        return
    outliers = rows[spike_rows(x[rows], command[rows])]
    if len(outliers) == 0:
        return
    mask[outliers] = False
    first, last = outliers[0], outliers[-1]
    yield Fault("spike", name, float(t[first]), float(t[last]), len(outliers),
                f"{name} has {_plural(len(outliers), 'spike')}, first at t = {t[first]:.6g} s ({x[first]:.4g}): "
                "values that no motion reaches and leaves at once; these rows are left out")


def spike_rows(x: np.ndarray, command: np.ndarray) -> np.ndarray:
    """Return the indices of spikes in x (n,), all finite.  command (n,): the nozzle's if x follows it, else NaN."""
    n, marked = len(x), np.zeros(len(x), bool)
    asked = SERVO_STEP * np.nan_to_num(np.abs(np.diff(command, prepend=command[:1])))
    asked = np.max(np.lib.stride_tricks.sliding_window_view(np.pad(asked, (ROWS_NEXT_TO, 0)), ROWS_NEXT_TO + 1), axis=1)
    moves = np.abs(np.diff(x))
    quantum = float(np.min(moves[moves > 0.0], initial=np.inf))
    for _ in range(SPIKE_PASSES):
        clean = np.interp(np.arange(n), np.flatnonzero(~marked), x[~marked])
        size = np.abs(clean - np.convolve(np.pad(clean, 2), INTERPOLATION, mode="valid"))
        for end, beside in ((slice(0, 2), clean[:ROWS_NEXT_TO]), (slice(n - 2, n), clean[-ROWS_NEXT_TO:])):
            size[end] = np.abs(clean[end] - np.median(beside))
        size[marked] = 0.0
        highest = np.max(np.lib.stride_tricks.sliding_window_view(np.pad(size, 3), 7), axis=1)
        least = SPIKE_OVER_RESIDUAL * float(np.quantile(size, USUAL_SHARE))
        before, after = clean[np.maximum(np.arange(n) - 1, 0)], clean[np.minimum(np.arange(n) + 1, n - 1)]
        before[0], after[-1] = after[0], before[-1]   # an end has one neighbour
        away = np.minimum(np.abs(clean - before), np.abs(clean - after))
        returns = ((clean - before) * (clean - after) > 0.0) & ~(np.abs(after - before) > LEVEL_SHIFT * away)
        new = [k for k in np.flatnonzero((size > least) & (size == highest) & returns).tolist()
               if _stands_alone(clean, size, k, float(away[k]), max(JUMP_OVER_STEP * quantum, float(asked[k])))]
        if not new:
            break
        marked[new] = True
    return np.flatnonzero(marked)


def _stands_alone(x: np.ndarray, size: np.ndarray, k: int, away: float, least: float) -> bool:
    """Whether row k of x (n,), which leaves both neighbours and returns at once, has nothing like it beside it.

    size (n,)  residuals against interpolation;  away  k's distance from its nearer neighbour;  least  its lower limit
    """
    moves = np.abs(np.concatenate((np.diff(x[max(0, k - ROWS_NEXT_TO):k]), np.diff(x[k + 1:k + ROWS_NEXT_TO + 1]))))
    inside = 0 < k < len(x) - 1
    if not away > least or not away > (
            SPIKE_OVER_STEP * np.quantile(moves, USUAL_SHARE) if inside else JUMP_OVER_STEP * np.max(moves)):
        return False
    sides = size[max(0, k - ROWS_AROUND):max(0, k - 2)], size[k + 3:k + ROWS_AROUND + 1]
    noise = max((float(np.quantile(side, USUAL_SHARE)) for side in sides if len(side) >= FEWEST_BESIDE), default=0.0)
    return bool(size[k] > SPIKE_OVER_RESIDUAL * noise)
