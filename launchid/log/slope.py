"""Compare theta_dot with the slope of theta: one regression shows the unit of t, of theta and of theta_dot, a sign, a
scale, and a body that turns about other axes than theta's.

    change of theta between blocks = gain * integral of theta_dot + bias

The gain is 1 where all is well, whatever the vehicle does.  Degrees make it 57.3 or its inverse, a t in another unit
that unit in seconds.  As long as the unit of t is unknown, so is the length of a block: of lengths that double, that
one is taken at which theta_dot explains most.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..formatting import SLOWEST_PERIOD
from ..sums import combined, least_squares, square

DEGREES = 180.0 / math.pi  # in a radian
RATE_BLOCK = 0.2         # s: long enough to average the noise, short beside the motion
FEWEST_BLOCKS = 15
CLEAR = 0.5              # share of variance a relation must explain to tell unit or sign
SAME_UNIT = 1.6          # a gain of a unit within this factor: milliseconds and degrees are 3.3 from degrees alone
ENOUGH_BLOCKS = 30       # of the longest length: the best of several by chance explains less than CLEAR
ONE_MOTION = 0.98        # share of the variance of theta's changes that theta_dot must explain to tell a scale
SAME_SCALE = 0.01        # relative: nobody calibrates a gyro better in a vehicle
SLOPE_SIGMAS = 5.0       # standard deviations
SHARED_RESIDUALS = 2.0   # times the variance of independent residuals: those of neighbouring blocks share one
NOISE_SHARE = 0.1        # of the changes of theta: what else theta_dot leaves of them is motion
TIME_SCALES = (("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9), ("", 1.0))  # "": seconds
LONG_UNITS = (("minutes", 1.0 / 60.0), ("hours", 1.0 / 3600.0), ("days", 1.0 / 86400.0))  # how many are a second
SAME_CLOCK = 0.04        # relative, of a gain that is a long unit of time: 60 (minutes) is 4.7 % from 57.3 (degrees)

Columns = dict[str, np.ndarray]  # channel -> (n,) on a uniform grid; absent: not measured


class Fit(NamedTuple):
    """Regression: gain of each part, share of variance explained, and the share of the others' rest each explains."""

    gain: tuple[float, ...]
    explained: float
    partial: tuple[float, ...]


NO_FIT = Fit((math.nan, math.nan), 0.0, (0.0, 0.0))


def near(gain: float, target: float, slack: float) -> bool:
    """Whether gain has target's sign and is within a factor `slack` of it."""
    return math.isfinite(gain) and gain * target > 0.0 and 1.0 / slack <= gain / target <= slack


def regress(y: np.ndarray, parts: list[np.ndarray]) -> Fit:
    """Fit y (n,) = sum of gain * part (n,) + constant by least squares; NO_FIT of few rows or no variance."""
    if len(y) < FEWEST_BLOCKS:
        return NO_FIT
    y = y - y.mean()
    matrix = np.stack([part - part.mean() for part in parts], axis=1)
    total = square(y)
    size = np.sqrt(np.sum(matrix * matrix, axis=0))
    if total <= 0.0 or not np.all(np.isfinite(size)) or size[0] <= 0.0:
        return NO_FIT

    def solved(keep: list[int]) -> tuple[np.ndarray, float]:
        kept = [k for k in keep if size[k] > 0.0]
        scaled = matrix[:, kept] / size[kept]
        weights = np.zeros(len(parts))
        weights[kept] = least_squares(scaled, y, 1e-10) / size[kept]
        rest = y - combined(matrix, weights)
        return weights, square(rest)

    gains, left = solved(list(range(len(parts))))
    without = [solved([j for j in range(len(parts)) if j != k])[1] for k in range(len(parts))]
    partial = tuple(1.0 - left / rest if rest > 0.0 else 0.0 for rest in without)
    return Fit(tuple(float(g) for g in gains), 1.0 - left / total, partial)


def block_means(x: np.ndarray, rows: int) -> np.ndarray:
    """Return the means (n // rows,) of x (n,) over whole blocks of `rows` rows."""
    return np.asarray(x[:len(x) // rows * rows].reshape(-1, rows).mean(axis=1))


def integral(x: np.ndarray, period: float) -> np.ndarray:
    """Return the integral (n,) of x (n,) with rows `period` apart, 0 at the first row, by the trapezium rule."""
    return np.concatenate(([0.0], np.cumsum(0.5 * (x[1:] + x[:-1]) * period)))


def rate_fit(columns: Columns, angle: str, rate: str, period: float, known: np.ndarray | None = None) -> Fit:
    """Fit change of column `angle` between blocks of RATE_BLOCK = gain * integral of column `rate` + bias, in blocks
    whose rows are all `known` (n,) bool; NO_FIT if a column is missing."""
    if angle not in columns or rate not in columns:
        return NO_FIT
    rows = max(2, round(RATE_BLOCK / period))
    rise, part = (np.diff(block_means(x, rows)) for x in (columns[angle], integral(columns[rate], period)))
    if known is not None:
        whole = block_means(known, rows) == 1.0
        rise, part = (x[whole[1:] & whole[:-1]] for x in (rise, part))
    return regress(rise, [part])


def lengths(rows: int) -> Iterator[int]:
    """Yield block lengths 2, 4, 8, ... [rows] of which `rows` rows hold at least ENOUGH_BLOCKS."""
    length = 2
    while rows >= ENOUGH_BLOCKS * length:
        yield length
        length *= 2


def slope_fit(columns: Columns, period: float, known: np.ndarray | None = None) -> tuple[Fit, bool]:
    """Return (fit of theta = gain * integral of theta_dot + bias at the block length at which it explains most; whether
    theta changes by more than the noise of both columns at any length).

    period  between rows, in any unit of time;  known (n,) bool: both were measured; None: in all rows
    Of rows that were not measured, for a gyro stood at its limit, lines are no motion: blocks with any are left out.
    """
    theta, theta_dot = columns["theta"], columns["theta_dot"]
    both = np.ones(len(theta), bool) if known is None else known
    turned, best, moves = integral(theta_dot, period), NO_FIT, False
    noise = [0.5 * float(np.var(np.diff(x))) for x in (theta, theta_dot)]  # of a row, the motion's steps in it
    for rows in lengths(len(theta)):
        whole = block_means(both, rows) == 1.0
        whole = whole[1:] & whole[:-1]
        if np.count_nonzero(whole) < (1 if known is None else ENOUGH_BLOCKS):
            continue
        change = np.diff(block_means(theta, rows))[whole]
        fit = regress(change, [np.diff(block_means(turned, rows))[whole]])
        best = fit if fit.explained > best.explained else best
        by_noise = 2.0 * noise[0] / rows + 2.0 / 3.0 * rows * period**2 * noise[1]
        moves = moves or by_noise < NOISE_SHARE * float(np.var(change))
    return best, moves


def is_other_motion(columns: Columns, period: float, known: np.ndarray) -> bool:
    """Whether theta moves and theta_dot is not its slope at any block length, in rows where both are measured, known
    (n,) bool: the body turns about other axes too."""
    if not {"theta", "theta_dot"} <= set(columns):
        return False
    fit, moves = slope_fit(columns, period, known)
    return moves and fit.explained < CLEAR


def foreign_scale(columns: Columns, period: float, known: np.ndarray) -> tuple[float, float] | None:
    """Return (theta_dot over the slope of theta, its standard deviation) if that is not 1, else None; from rows where
    both are measured, known (n,) bool."""
    fit = rate_fit(columns, "theta", "theta_dot", period, known)
    gain, blocks = fit.gain[0], np.count_nonzero(known) * period / RATE_BLOCK
    if blocks < ENOUGH_BLOCKS or fit.explained < ONE_MOTION:
        return None
    std = abs(gain) * math.sqrt(SHARED_RESIDUALS * (1.0 / fit.explained - 1.0) / blocks)
    return (1.0 / gain, std / gain**2) if abs(gain - 1.0) > max(SLOPE_SIGMAS * std, SAME_SCALE) else None


def unit_of_time(columns: Columns, period: float) -> tuple[str, float, str] | None:
    """Return (unit, units in a second, why) of stamps `period` apart, by the slope of theta; ("", 1, "") for seconds,
    None if it does not tell.

    Rows of a log are less than SLOWEST_PERIOD apart: if these are farther, t is in another unit, and the gain tells
    which.
    """
    if not {"theta", "theta_dot"} <= set(columns):
        return None
    fit, _ = slope_fit(columns, period)
    gain = abs(fit.gain[0])
    if not (fit.explained > CLEAR and 0.0 < gain < math.inf):
        return None
    for name, factor in LONG_UNITS if not near(gain, 1.0, SAME_UNIT) else ():
        if abs(gain * factor - 1.0) < SAME_CLOCK:
            return name, factor, f"theta_dot is {1.0 / gain:.4g} times the slope of theta"
    if not period > SLOWEST_PERIOD or near(gain, 1.0, SAME_UNIT):
        return "", 1.0, ""
    why = f"theta_dot is {1.0 / gain:.4g} times the slope of theta"
    if period == 1.0:
        return "row numbers", 1.0 / gain, f"its step is 1, {why}"
    for name, factor in TIME_SCALES:
        if any(near(gain * factor, angle, SAME_UNIT) for angle in (1.0, DEGREES, 1.0 / DEGREES)):
            return name, factor, f"its step is {period:.4g}, {why}" if name else ""
    return f"units of {gain:.3g} s", 1.0 / gain, f"its step is {period:.4g}, {why}"
