"""The faults of one channel by itself: infinite or absurd values, dropouts, stale runs, spikes.

Nothing here asks what the vehicle should do; a physical effect must pass.  A run of
equal values is bad where the channel's own rate of repeats next to it makes it
impossible, or where the channel moves on with a jump that nothing beside it has.  A
spike is what its neighbours (and for the nozzle the command) do not interpolate.
"""

from collections.abc import Collection, Iterator, Mapping

import numpy as np

from ...sums import along, combined, products
from .fault import Fault
from .runs import runs_of
from .stops import SENSED, stopped

MEASURED = ("theta", "theta_dot", "beta")  # by sensors: these may freeze and spike
NOZZLE, COMMAND = "beta", "beta_cmd"
ABSURD = 1e4             # rad, rad/s: beyond it no channel holds a measurement, in degrees neither
NAN_RUN = 5              # rows without a value that make a dropout in a measured channel
ZERO_RUN = 5             # rows of exact zeros
STALE_RUN = 10           # rows of one value
BESIDE = 60              # rows on either side of a run that tell how often the channel repeats by itself
FEWEST_BESIDE = 30       # rows there that suffice
SELDOM = 0.001           # of steps begin a run: the channel is not quantised, wherever one looks
QUIET = 0.98             # quantile of the blocks of so many rows, by their repeats: frozen ones hide no others
OFTEN = 0.6              # of steps repeat: the quantum hides the noise, and a run tells nothing by its length
DITHER = 0.25            # of movements reverse the one before: noise moves the value, not only the motion
DITHER_SOME = 0.08       # the same in a channel that hardly ever repeats: the motion is fast, or nothing is noisy
FEWEST_MOVES = 12        # movements there that tell so
INDEPENDENT = 0.75       # of the repeats of a quantised channel count as chance, the rest as lack of motion
ENTRY_STEPS = 5          # before a run: if the largest is less than
ENTRY_SHARE = 0.1        # of the usual movement, the channel has settled, not frozen
RUN_CHANCE = 1e-7        # of a run like this anywhere in a clean log
JUMP_QUANTA = 3.5        # at a run's end: rounding alone gives 1, with noise 2
JUMP_STEPS = 4.0         # times the largest step beside the run
JUMP_BESIDE = 12         # rows that count as beside it
SPIKE_SIGMAS = 11.0      # clean samples reach 5.5 in a million; spikes of 30 noise std reach 20
SPIKE_LOCAL = 8.0        # times the median residual of the rows next to it: bursts of vibration are no spikes
SPIKE_QUANTA = 2.5       # rounding moves a residual by at most 1.4
SPIKE_ALONE = 1.4        # times the largest step beside it: fast motion is no spike
SPIKE_END_ALONE = 4.0    # the same for the first and the last row, which have one side only
SPIKE_STEPS = 6          # rows on either side that count as beside it
SPIKE_PASSES = 8         # of marking the largest of each cluster and looking again
LEVEL_SHIFT = 0.7        # of the spike: if the rows before and after differ by more, the signal has moved
GAUSS_MAD = 1.4826       # std of a normal variable over its median absolute deviation
INTERPOLATION = np.array([-1.0, 4.0, 0.0, 4.0, -1.0]) / 6.0  # cubic, from two rows on either side
EDGE = 2                 # rows at either end that are judged by the median of the
EDGE_ROWS = 7            # first or last rows
FEWEST_MEASURED = 20     # less tell nothing about a channel's noise


def _plural(count: int, word: str) -> str:
    return f"{count} {word}" if count == 1 else f"{count} {word}s"


def judged(t: np.ndarray, columns: Mapping[str, np.ndarray], usable: np.ndarray,
           repeating: Collection[str]) -> tuple[dict[str, np.ndarray], list[Fault]]:
    """(masks as `check.DataCheck`'s, faults) of every column (n,) by itself.

    usable (n,) bool: of the stamps;  repeating  columns of a slower channel, whose repeats are no fault
    """
    masks: dict[str, np.ndarray] = {}
    faults: list[Fault] = []
    for name, x in columns.items():
        masks[name] = np.isfinite(x) & usable
        faults += out_of_range(name, t, x, masks[name])
        faults += missing_runs(name, t, x)
    resting = _resting(columns)
    for name in MEASURED:
        x = columns[name]
        command = _filled(columns[COMMAND], masks[COMMAND]) if name == NOZZLE else np.full(len(x), np.nan)
        if name in SENSED:
            faults += stopped(name, t, x, masks[name])
        if name not in repeating:
            faults += frozen_runs(name, t, x, masks[name], resting)
        faults += spikes(name, t, x, masks[name], command)
    return masks, faults


def _filled(x: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """x (n,) with what may not be used interpolated by row; NaN throughout if that is more than half."""
    rows = np.flatnonzero(mask)
    if 2 * len(rows) <= len(x):
        return np.full(len(x), np.nan)
    return np.interp(np.arange(len(x)), rows, x[rows])


def _resting(columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """(n,) bool: up to this row two or more measured channels have been exactly zero: an ideal vehicle on the pad."""
    still = np.sum([np.asarray(columns[name] == 0.0, int) for name in MEASURED], axis=0) >= 2
    return np.asarray(np.logical_and.accumulate(still))


def out_of_range(name: str, t: np.ndarray, x: np.ndarray, mask: np.ndarray) -> Iterator[Fault]:
    """Infinite or absurd values of x (n,); clears them in mask (n,) inout."""
    for bad, what in ((np.isinf(x), "infinite"), (np.isfinite(x) & (np.abs(x) > ABSURD), "absurdly large")):
        rows = np.flatnonzero(bad)
        if len(rows) > 0:
            mask[rows] = False
            yield Fault("range", name, float(t[rows[0]]), float(t[rows[-1]]), len(rows),
                        f"{name} is {what} in {_plural(len(rows), 'row')}, first at t = {t[rows[0]]:.6g} s "
                        f"({x[rows[0]]:.3g}): an overflow or a marker of missing data; leave the cell empty")


# ---- runs


def missing_runs(name: str, t: np.ndarray, x: np.ndarray) -> Iterator[Fault]:
    """Runs of NaN in a channel x (n,) that is measured elsewhere in the log."""
    empty = np.isnan(x)
    if empty.all():
        return
    runs = [run for run in runs_of(empty) if run[1] - run[0] >= NAN_RUN]
    if runs and 2 * len(runs) < len(x) / NAN_RUN:
        count = int(sum(end - start for start, end in runs))
        start, end = runs[0][0], runs[-1][1] - 1
        yield Fault("dropout", name, float(t[start]), float(t[end]), count,
                    f"{name} has no value in {_plural(count, 'row')} ({_plural(len(runs), 'dropout')}), first at "
                    f"t = {t[start]:.6g} s: the sensor or its link was off; these rows are left out")


def frozen_runs(name: str, t: np.ndarray, x: np.ndarray, mask: np.ndarray, resting: np.ndarray) -> Iterator[Fault]:
    """Runs of exact zeros (dropout) and of one other value (stale) in x (n,); clears them in mask (n,) inout.

    resting (n,) bool  nothing has moved yet: without noise zero is then the truth
    """
    rows = np.flatnonzero(mask)
    values = x[rows]
    equal = np.diff(values) == 0.0
    runs = runs_of(equal)
    runs[:, 1] += 1  # k equal steps are k + 1 equal values
    runs = runs[runs[:, 1] - runs[:, 0] >= min(ZERO_RUN, STALE_RUN)]
    if len(runs) == 0 or len(values) < FEWEST_MEASURED:
        return
    moves = np.abs(np.diff(values))
    if not moves.any():
        return
    seldom = np.count_nonzero(equal[1:] & ~equal[:-1]) <= max(SELDOM * len(equal), 1.0)
    usual = SELDOM if seldom else _quiet_share(equal)
    quantum = float(np.min(moves[moves > 0.0]))
    bad: dict[str, list[tuple[int, int]]] = {"dropout": [], "stale": []}
    for start, end in runs:
        zero = values[start] == 0.0
        if end - start < (ZERO_RUN if zero else STALE_RUN):
            continue
        if _jumps(values, start, end, quantum) or (
                not (zero and resting[rows[start]]) and _improbable(values, start, end, usual)):
            bad["dropout" if zero else "stale"].append((start, end))
    yield from _frozen_faults(name, t, x, mask, rows, bad)


def _frozen_faults(name: str, t: np.ndarray, x: np.ndarray, mask: np.ndarray, rows: np.ndarray,
                   bad: dict[str, list[tuple[int, int]]]) -> Iterator[Fault]:
    """The faults of these runs (in indices of `rows`); clears them in mask."""
    for kind, runs in bad.items():
        if not runs:
            continue
        for start, end in runs:
            # the first of equal values was still measured, zeros were not
            mask[rows[start + (kind == "stale"):end]] = False
        count = int(sum(end - start for start, end in runs))
        first, last = rows[runs[0][0]], rows[runs[-1][1] - 1]
        what = "is exactly zero" if kind == "dropout" else f"repeats its value ({x[first]:.4g})"
        why = "the sensor or its link was off" if kind == "dropout" else "the sensor or its link froze"
        if kind == "stale" and x[first] in (np.min(x[rows]), np.max(x[rows])):
            why = "the sensor is at an end of its range, or froze"
        yield Fault(kind, name, float(t[first]), float(t[last]), count,
                    f"{name} {what} for {_plural(count, 'row')} ({_plural(len(runs), 'run')}), first at "
                    f"t = {t[first]:.6g} s: {why}; these rows are left out")


def _quiet_share(equal: np.ndarray) -> float:
    """Share of repeats where a quantised channel hardly moves, equal (n,) bool its steps: runs are long there."""
    whole = equal[:len(equal) // BESIDE * BESIDE].reshape(-1, BESIDE)
    counts = whole.sum(axis=1) if len(whole) > 0 else np.array([BESIDE])
    return float((np.quantile(counts, QUIET) + 2.0) / (BESIDE + 2.0))


def _improbable(values: np.ndarray, start: int, end: int, usual: float) -> bool:
    """The channel's own rate of repeats beside the run [start, end) does not give a run like it.

    usual  its share of repeats elsewhere
    """
    chance = usual
    told = 0
    for low, high in ((max(0, start - BESIDE), start), (end - 1, end - 1 + BESIDE)):
        steps = np.diff(values[low:high + 1])
        if len(steps) < FEWEST_BESIDE:
            continue
        moves = steps[steps != 0.0]
        if len(moves) < FEWEST_MOVES:
            return False
        repeats = 1.0 - len(moves) / len(steps)
        if repeats > OFTEN or np.mean(moves[1:] * moves[:-1] < 0.0) < (DITHER if usual > SELDOM else DITHER_SOME):
            return False
        if high == start and np.max(np.abs(steps[-ENTRY_STEPS:])) < ENTRY_SHARE * np.median(np.abs(moves)):
            return False  # it came to rest: a nozzle held by backlash, without noise
        told += 1
        if usual > SELDOM:
            chance = max(chance, (len(steps) - len(moves) + 2.0) / (len(steps) + 2.0))
    if usual > SELDOM:
        return told == 2 and len(values) * chance ** (INDEPENDENT * (end - start - 1)) < RUN_CHANCE
    return told > 0 and len(values) * chance ** (end - start - 1) < RUN_CHANCE


def _jumps(values: np.ndarray, start: int, end: int, quantum: float) -> bool:
    """The value enters or leaves the run [start, end) with a jump that the rows beside it do not have."""
    before = np.abs(np.diff(values[max(0, start - JUMP_BESIDE):start]))
    after = np.abs(np.diff(values[end:end + JUMP_BESIDE]))
    beside = np.concatenate((before, after))
    if len(beside) < JUMP_BESIDE // 2:
        return False
    least = max(JUMP_QUANTA * quantum, JUMP_STEPS * float(np.max(beside)))
    enters = start > 0 and abs(values[start] - values[start - 1]) > least and values[start] == 0.0
    leaves = end < len(values) and abs(values[end] - values[end - 1]) > least
    return bool(enters or leaves)


# ---- spikes


def spikes(name: str, t: np.ndarray, x: np.ndarray, mask: np.ndarray, command: np.ndarray) -> Iterator[Fault]:
    """Outliers of single rows in x (n,); clears them in mask (n,) inout.

    command (n,)  the actuator's command, for the nozzle; NaN where there is none
    """
    rows = np.flatnonzero(mask)
    if len(rows) < FEWEST_MEASURED:
        return
    found = rows[spike_rows(x[rows], command[rows])]
    if name == NOZZLE:  # a servo is fast enough to begin a motion with the last row, or end one with the first
        found = found[(found > rows[0]) & (found < rows[-1])]
    if len(found) == 0:
        return
    mask[found] = False
    first, last = found[0], found[-1]
    yield Fault("spike", name, float(t[first]), float(t[last]), len(found),
                f"{name} has {_plural(len(found), 'spike')}, first at t = {t[first]:.6g} s ({x[first]:.4g}): "
                "values that no motion reaches and leaves at once; these rows are left out")


def spike_rows(x: np.ndarray, command: np.ndarray) -> np.ndarray:
    """Indices of the spikes in x (n,), all measured."""
    quantum = _quantum(x)
    marked = np.zeros(len(x), bool)
    weights = _weights(x, command, marked)
    for _ in range(SPIKE_PASSES):
        clean = x if not marked.any() else np.interp(np.arange(len(x)), np.flatnonzero(~marked), x[~marked])
        residual = _residual(clean, command, weights)
        size = np.where(marked, 0.0, np.abs(residual))
        scale = GAUSS_MAD * float(np.median(size))
        candidates = np.flatnonzero(size > max(SPIKE_SIGMAS * scale, SPIKE_QUANTA * quantum)).tolist()
        new = [k for k in candidates if size[k] >= np.max(size[max(0, k - 3):k + 4])
               and _stands_alone(clean, size, k)]
        if not new:
            break
        marked[new] = True
        weights = _weights(x, command, marked)
    return np.flatnonzero(marked)


def _quantum(x: np.ndarray) -> float:
    """The step of a quantised signal, 0 if it is none."""
    moves = np.abs(np.diff(x))
    if np.mean(moves == 0.0) < SELDOM:
        return 0.0
    moves = moves[moves > 0.0]
    return float(np.min(moves)) if len(moves) > 0 else 0.0


def _neighbours(x: np.ndarray, command: np.ndarray) -> np.ndarray:
    """The values that row k may be interpolated from, (n, columns): three rows either side, for the nozzle also the
    command."""
    padded = np.pad(x, 3, mode="reflect")
    n = len(x)
    columns = [padded[3 + lag:3 + lag + n] for lag in (-3, -2, -1, 1, 2, 3)]
    if np.isfinite(command).all():
        columns += [np.pad(command, (5, 1), mode="edge")[5 + lag:5 + lag + n] for lag in range(-5, 2)]
    return np.stack([*columns, np.ones(n)], axis=1)


def _cubic_residual(x: np.ndarray) -> np.ndarray:
    """x - its cubic interpolation from two rows either side."""
    return np.asarray(x - np.convolve(np.pad(x, 2, mode="reflect", reflect_type="odd"), INTERPOLATION, mode="valid"))


def _weights(x: np.ndarray, command: np.ndarray, marked: np.ndarray) -> np.ndarray:
    """Least-squares interpolation weights from the log itself, rows near outliers left out."""
    residual = _cubic_residual(x)
    size = np.abs(residual)
    bad = marked | (size > SPIKE_SIGMAS * GAUSS_MAD * max(float(np.median(size)), 1e-300))
    near = np.convolve(bad, np.ones(7), mode="same") > 0.5
    if np.count_nonzero(~near) < max(len(x) // 2, 2 * FEWEST_MEASURED):
        near = np.zeros(len(x), bool)
    rows = _neighbours(x, command)
    centre = x.mean()
    rows[:, :6] -= centre
    good = rows[~near]
    # deviations from the cubic interpolation are what is fitted: the ridge then pulls towards it, not towards 0
    matrix = products(good, good)
    matrix[np.diag_indices_from(matrix)] *= 1.0 + 1e-9
    weights, *_ = np.linalg.lstsq(matrix, along(good, residual[~near]), rcond=1e-12)
    return np.asarray(weights)


def _residual(x: np.ndarray, command: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The part of x that the neighbours do not interpolate (n,)."""
    rows = _neighbours(x, command)
    rows[:, :6] -= x.mean()
    residual = np.asarray(_cubic_residual(x) - combined(rows, weights))
    for k in range(EDGE):  # with a neighbour on one side only the stencil mistakes the neighbour's error for the row's
        for row, beside in ((k, x[:EDGE_ROWS]), (len(x) - 1 - k, x[-EDGE_ROWS:])):
            residual[row] = x[row] - np.median(beside)
    return residual


def _stands_alone(x: np.ndarray, size: np.ndarray, k: int) -> bool:
    """Row k leaves its neighbours and comes back at once, and nothing like it happens beside it."""
    n = len(x)
    left, right = size[max(0, k - 12):max(0, k - 3)], size[k + 4:k + 13]
    local = max((float(np.median(part)) for part in (left, right) if len(part) >= 4), default=0.0)
    steps = np.abs(np.diff(x[max(0, k - SPIKE_STEPS):k])), np.abs(np.diff(x[k + 1:k + 1 + SPIKE_STEPS]))
    beside = max((float(np.max(part)) for part in steps if len(part) > 0), default=0.0)
    away = [abs(x[k] - x[j]) for j in (k - 1, k + 1) if 0 <= j < n]
    if 0 < k < n - 1:
        back = (x[k] - x[k - 1]) * (x[k] - x[k + 1]) > 0.0 and abs(x[k + 1] - x[k - 1]) <= LEVEL_SHIFT * min(away)
    else:
        # one side only: where nothing dithers the row may be the first of a motion
        inside = np.diff(x[:SPIKE_STEPS + 2][1:] if k == 0 else x[-SPIKE_STEPS - 2:-1])
        dithers = np.count_nonzero(inside[1:] * inside[:-1] < 0.0) >= 2
        back = dithers and min(away) > SPIKE_END_ALONE * beside
    return bool(back and size[k] > SPIKE_LOCAL * GAUSS_MAD * local and min(away) > SPIKE_ALONE * beside)
