"""Check time stamps: find the rows with one that can be used, and what is wrong with the others.

Jitter and single odd periods are no fault: a stamp is missing only where the step exceeds the local period by what no
jitter of this log explains.
"""

import math

import numpy as np

from sim.sections import Nominal

from .fault import Fault
from .runs import runs_of
from .slope import LONG_UNITS, TIME_SCALES

LOST_STAMP = 1.75          # local periods: a longer step has lost a stamp (one lost: 2)
GAP_JITTERED = 1.5         # local periods, where the log jitters by 20 %: at most 1.4 without a loss, at least 1.6 with
LOCAL_STEPS = 15           # steps on either side that give the local period: a log may change its rate
SAME_RATE = 0.2            # relative difference of periods that jitter alone makes
JITTER_QUANTILE = 0.95     # of the steps' distance from the period: odd single steps are not jitter
RATE_SLACK = 5.0           # the log's rate may differ from the nominal's by this factor either way
MOST_LOST = 1.0e15         # rows in a gap: beyond, a stamp is no time, and a count of rows no integer
COARSE = 0.5               # of the stamps repeat the one before: rows were not written twice, a clock was printed short
OUT_OF_ORDER = 0.25        # of the steps go back: no clock is reset as often
LONGEST_GRID = 4           # times the rows: a log with one gap of a day must not fill the memory
STAMP_RESOLUTION = 0.01    # of a period: a resolution finer than that changes no step that is seen
LINE_TOLERANCE = 1.1       # resolutions about the line through the rows: the line itself is fitted
FEWEST_TICKS = 20          # stamps: fewer lie near a line by chance
LOCAL = 200                # rows over which the period is taken where rows are lost
COARSE_TICK = 0.25         # of a row's distance: of stamps that are finer the stamp says when the row was measured
OWN_TICK = 0.1             # of a row's distance: rows a tick apart have the stamps that they should
NEARLY_ALL = 0.99          # of the stamps
NEIGHBOURS = 15            # rows, whose mean stamp is free of their ticks
LOST_SLACK = 0.25          # periods that such a mean may be off
FOLLOWED = 0.05            # of its distance from a stamp, by which the grid follows where rows are lost


def usable_rows(t: np.ndarray) -> np.ndarray:
    """Return (n,) bool: stamps t (n,) that are finite and after all usable ones before; one far ahead is left out."""
    usable = np.isfinite(t)
    rows = np.flatnonzero(usable)
    if len(rows) < 2:
        return usable
    stamps = t[rows]
    ahead = np.zeros(len(rows), bool)
    # a stamp above its successor that the successor's neighbours go on without: it alone is wrong
    ahead[1:-1] = (stamps[1:-1] > stamps[2:]) & (stamps[2:] > stamps[:-2]) & (stamps[1:-1] > stamps[:-2])
    ahead[0] = len(rows) > 2 and stamps[0] > stamps[1] and stamps[2] > stamps[1] and stamps[0] > stamps[2]
    stamps = np.where(ahead, -math.inf, stamps)
    before = np.maximum.accumulate(np.concatenate(([-math.inf], stamps[:-1])))
    usable[rows] = stamps > before
    return usable


def tick_of(t: np.ndarray) -> float:
    """Return the resolution [s] of stamps t (n,) that do not decrease: the smallest difference between steps, if it is
    more than STAMP_RESOLUTION of a step and all steps are whole but unequal multiples of it; else 0."""
    steps = np.diff(t)
    apart = np.diff(np.sort(np.append(steps, 0.0)))
    apart = apart[apart > STAMP_RESOLUTION * min(np.mean(steps), np.median(steps[steps > 0.0]))]
    if not len(apart):
        return 0.0
    tick = float(np.min(apart))
    many = np.round(steps / tick)
    return tick if np.ptp(many) > 0.0 and np.max(np.abs(steps - many * tick)) <= STAMP_RESOLUTION * tick else 0.0


@np.errstate(over="ignore", invalid="ignore")
def even_grid(t: np.ndarray, is_twice: bool = True) -> tuple[np.ndarray, float, float] | None:
    """Return (even times (n,), their period, the tick) [s] of stamps t (n,) [s] that were rounded to a tick.

    is_twice  rows with the stamp of the row before, if less than COARSE of all, were written twice

    The times are on a line fitted to stamp over row number (lost rows counted), all stamps within one tick of it, or
    nearly all within a tick and half a row, where ticks are as coarse as rows and rows were stamped early or late. None
    where the stamps are even as they are, jitter, or belong to rows written twice.
    """
    steps = np.diff(t)
    if len(t) < FEWEST_TICKS or not np.all(np.isfinite(t)) or np.any(steps < 0.0):
        return None
    if not np.any(steps > 0.0):
        return None
    tick, mean, usual = tick_of(t), float(np.mean(steps)), float(np.median(steps[steps > 0.0]))
    again = float(np.mean(steps == 0.0))
    if not STAMP_RESOLUTION * mean < tick <= GAP_JITTERED * usual:
        return None
    if 0.0 < again < COARSE and (is_twice or abs(tick - mean) < OWN_TICK * mean):
        return None
    for row in (np.arange(len(t)), _rows_with_lost(t, usual)):
        slope, start = np.polyfit(row, t - t[0], 1)
        grid = t[0] + start + slope * row
        if np.ptp(t - grid) <= LINE_TOLERANCE * tick and slope > 0.0:
            return (grid, float(slope), tick) if np.max(np.abs(t - grid)) > STAMP_RESOLUTION * slope else None
    if tick < COARSE_TICK * mean:
        return None
    row = _rows_by_means(t)
    slope, start = np.polyfit(row, t - t[0], 1)
    grid = t[0] + start + slope * row
    near = float(np.quantile(np.abs(t - grid), NEARLY_ALL)) <= tick + 0.5 * slope
    return (grid, float(slope), tick) if near and slope > 0.0 and abs(tick - slope) > OWN_TICK * slope else None


def _rows_by_means(t: np.ndarray) -> np.ndarray:
    """Return row numbers (n,) of stamps t (n,) that are rounded and early or late: rows are lost where the stamps
    after a step are later than those before by whole periods, in the mean of NEIGHBOURS."""
    reach = min(LOCAL, len(t) // 2)
    period = float(np.median((t[reach:] - t[:-reach]) / reach))
    rows = np.arange(len(t))
    if not period > 0.0 or len(t) <= 2 * NEIGHBOURS:
        return rows
    off = t - period * rows
    means = np.lib.stride_tricks.sliding_window_view(off, NEIGHBOURS).mean(axis=1)
    lost = np.zeros(len(t), dtype=np.int64)   # before each row
    jumps = np.rint((means[NEIGHBOURS:] - means[:-NEIGHBOURS]) / period - LOST_SLACK)
    for begin, end in runs_of(jumps >= 1.0):
        at = begin + NEIGHBOURS + int(np.argmax(np.diff(off)[begin + NEIGHBOURS - 1:end + NEIGHBOURS - 1]))
        lost[at] = int(min(np.max(jumps[begin:end]), MOST_LOST))
    return np.asarray(rows + np.cumsum(lost))


def _rows_with_lost(t: np.ndarray, usual: float) -> np.ndarray:
    """Return row numbers (n,) of stamps t (n,), one left out for each lost row; `usual`: fallback for the period."""
    reach = min(LOCAL, len(t) // 2)
    period = float(np.median((t[reach:] - t[:-reach]) / reach)) or usual
    row, place, numbers = 0, float(t[0]), np.empty(len(t), dtype=np.int64)
    numbers[0] = 0
    for k, stamp in enumerate(t[1:].tolist(), start=1):
        ahead = max(1, round(min((stamp - place) / period, MOST_LOST)))
        row, place = row + ahead, place + ahead * period
        place += FOLLOWED * (stamp - place)
        numbers[k] = row
    return numbers


def local_periods(steps: np.ndarray) -> np.ndarray:
    """Return the median step (n,) around each of steps (n,), over LOCAL_STEPS to either side."""
    padded = np.pad(steps, LOCAL_STEPS, mode="symmetric") if len(steps) > LOCAL_STEPS else None
    if padded is None:
        return np.full(len(steps), np.median(steps))
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * LOCAL_STEPS + 1), axis=1))


@np.errstate(over="ignore", invalid="ignore")  # of stamps that are no times: what is infinite is beyond a limit too
def gaps(t: np.ndarray, row: np.ndarray) -> list[tuple[float, float, int]]:
    """Return (last stamp before, first after, rows lost) of each gap in strictly increasing stamps t (n,) [s].

    row (n,): their row numbers in the log; a row between them with an unusable stamp is not lost
    """
    steps = np.diff(t)
    if len(steps) < 3:
        return []
    period = float(np.median(steps))
    jitter = float(np.quantile(np.abs(steps / period - 1.0), JITTER_QUANTILE))
    limit = GAP_JITTERED if 0.1 < jitter < GAP_JITTERED - 1.0 else LOST_STAMP
    if np.max(steps) <= limit * np.min(steps):
        return []
    local = local_periods(steps)
    # the median of all is the better one where the rate is the same
    relative = steps / np.where(np.abs(local / period - 1.0) < SAME_RATE, period, local) - (np.diff(row) - 1)
    return [(float(t[k]), float(t[k + 1]), max(1, round(min(float(relative[k]), MOST_LOST)) - 1))
            for k in np.flatnonzero(relative > limit)]


def _rows(count: int) -> str:
    return "1 row" if count == 1 else f"{count} rows"


def stamp_faults(t: np.ndarray, usable: np.ndarray) -> list[Fault]:
    """Return a Fault for each sort of bad stamp in t (n,): not finite, out of order, repeated, backward, missing."""
    found = []
    finite = np.isfinite(t)
    if not finite.all():
        none = np.flatnonzero(~finite)
        found.append(Fault("stamps", "t", math.nan, math.nan, len(none),
                           f"the stamp is no number in {_rows(len(none))}, first in row {none[0] + 1}: "
                           "drop these rows or restore their times"))
    rows = np.flatnonzero(finite)
    stamps, good = t[rows], usable[rows]
    back = int(np.count_nonzero(np.diff(stamps) < 0.0))
    if back > OUT_OF_ORDER * len(stamps):
        found.append(Fault("order", "t", float(stamps[0]), float(stamps[-1]), back,
                           f"t is out of order: in {back} of {len(t)} rows it is before the row before; sort the rows "
                           "by t"))
        return found
    again = np.zeros(len(rows), bool)
    again[1:] = stamps[1:] == stamps[:-1]
    for sort, bad, repair in (("repeated", ~good & again, "rows written twice; drop the second of each"),
                              ("backward", ~good & ~again, "a clock reset or rows out of order; cut or sort the log")):
        where = stamps[bad]
        if len(where) > 0:
            coarse = sort == "repeated" and len(where) > COARSE * len(stamps)
            asked = "they have too few digits for these rows; print them with more" if coarse else repair
            found.append(Fault("stamps", "t", float(where[0]), float(where[-1]), len(where),
                               f"{sort} stamps in {_rows(len(where))}, first at t = {where[0]:.6g} s: {asked}"))
    lost = gaps(t[usable], np.flatnonzero(usable))
    if lost:
        count = sum(rows for _, _, rows in lost)
        found.append(Fault("stamps", "t", lost[0][0], lost[-1][1], count,
                           f"about {_rows(count)} missing in {len(lost)} gap{'s' if len(lost) > 1 else ''}, first "
                           f"after t = {lost[0][0]:.6g} s: samples were lost; nothing is made up for them"))
    return found


def unit_fault(t: np.ndarray, nominal: Nominal, by_slope: tuple[str, float, str] | None) -> tuple[list[Fault], float]:
    """Return ([Fault], units in a second) if increasing stamps t (n,) are not in seconds, else ([], 1).

    by_slope  what `slope.unit_of_time` returned; None: the nominal's sample period decides
    """
    unit, factor, why = by_slope or time_unit(t, nominal.sensors.period)
    if not unit:
        return [], 1.0
    return [Fault("unit", "t", float(t[0]), float(t[-1]), len(t),
                  f"t looks like {unit} over the whole log: {why}; "
                  + (f"divide it by {factor:g}" if (unit, factor) in TIME_SCALES else
                     f"multiply it by {1.0 / factor:g}" if (unit, factor) in LONG_UNITS else
                     f"multiply it by about {1.0 / factor:.3g} s"))], factor


def time_unit(t: np.ndarray, period: float) -> tuple[str, float, str]:
    """Return (unit, units in a second, why) of increasing stamps t (n,), by the nominal sample period [s]; ("", 1, "")
    for seconds."""
    step = float(np.median(np.diff(t))) if len(t) > 2 else period
    for name, factor in TIME_SCALES[:-1]:
        if factor / RATE_SLACK <= step / period <= factor * RATE_SLACK:
            return name, factor, f"its step is {step:.4g}, the nominal's {period:.4g} s"
    return "", 1.0, ""


def origin_fault(t: np.ndarray, nominal: Nominal) -> list[Fault]:
    """Return [Fault] if increasing stamps t (n,) [s] and the nominal's profile do not overlap in time; else []."""
    profile = nominal.vehicle.t
    if len(profile) < 2 or len(t) == 0 or (t[0] <= profile[-1] and t[-1] >= profile[0]):
        return []
    return [Fault("origin", "t", float(t[0]), float(t[-1]), len(t),
                  f"t is {t[0]:.10g} to {t[-1]:.10g} s over the whole log, the nominal's profile is of {profile[0]:g} "
                  f"to {profile[-1]:g} s: subtract the time of lift-off from t")]


def uniform_times(t: np.ndarray) -> np.ndarray:
    """Return times (m,), one median step apart, over all of increasing t (n,); m is at most LONGEST_GRID n."""
    period = float(np.median(np.diff(t)))
    count = int(min((t[-1] - t[0]) / period + 1.5, LONGEST_GRID * len(t)))
    return np.asarray(t[0] + period * np.arange(count))
