"""Find columns sampled more slowly than the log, between whose values the logger wrote others that nobody measured.

A logger repeats the last value of a slower channel, to the bit, for a regular number of rows, and its steps are larger
than a quantum (a quantised channel repeats where it moves slowly).  A resampling draws straight lines between the
values, with corners a regular number of rows apart and many slopes (a motion of a few constant rates has few slopes).
Taken for measurements, the rows between look like a late sensor or a slow servo.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .fault import Fault
from .stamps import usable_rows

OWN, HELD_WORD, INTERPOLATED = "own", "held", "interpolated"
FEWEST_VALUES = 20     # less tell no rate
REGULAR = 0.9          # of the values stay for the usual number of rows, or one more or less
QUANTA = 3.5           # times the smallest step the usual one is at least
SMALLEST_STEPS = 0.2   # of the steps may be about the smallest: of a quantised motion most are
# of the largest bend: corners are above one, rounding below
BEND_LEVELS = tuple(10.0 ** (-0.5 * k) for k in range(1, 21))
STRAIGHT = 0.1         # of a corner's bend, at most of a line's
CORNER = 2             # rows at most: one that falls between two rows bends both
# of the largest value, and of the longest line over the stamps: the computer's own rounding
COMPUTER_ROUNDING = 1.0e-15
FEWEST_SLOPES = 10     # of lines: a triangular or rate-limited motion has two or three
SAME_SLOPE = 1.0e-3    # of their root mean square


@dataclass(frozen=True, eq=False)
class Rate:
    """The rate at which a column (n,) of a log was sampled.

    kind    `own`: the log's, or too little to tell; `held`, `interpolated`: what the logger wrote between own values
    period  [s] between own values, NaN of kind `own`;  own  (n,) bool: rows with an own value, of kind `own` all
    """

    kind: str
    period: float
    own: np.ndarray

    @property
    def words(self) -> str:
        """Words for a slower column: its rate in Hz, and what stands between its own values."""
        between = "each value repeated in the rows up to the next" if self.kind == HELD_WORD else \
            "interpolated: what it did between is not in the log"
        return f"of {1.0 / self.period:.3g} Hz, {between}"


@np.errstate(over="ignore", invalid="ignore")  # of numbers that no log holds
def rate_of(t: np.ndarray, x: np.ndarray) -> Rate:
    """Return the rate of a column x (n,) with stamps t (n,) [s], by its finite values with usable stamps."""
    rows = np.flatnonzero(usable_rows(t) & np.isfinite(x))
    for kind, find in ((HELD_WORD, _values), (INTERPOLATED, _corners)):
        begins = find(t[rows], x[rows])
        if len(begins):
            own = np.zeros(len(x), bool)
            own[rows[begins]] = True
            return Rate(kind, float(np.median(np.diff(t[rows[begins]]))), own)
    return Rate(OWN, math.nan, np.ones(len(x), bool))


def _values(t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the rows (k,) in which the values of a held column x (n,) begin; none if it is not held."""
    begins = np.flatnonzero(np.diff(x, prepend=math.nan) != 0.0)
    if len(begins) < FEWEST_VALUES:
        return begins[:0]
    lengths, moves = np.diff(begins), np.abs(np.diff(x[begins]))
    inside = (x[begins] > np.min(x)) & (x[begins] < np.max(x))  # at a limit one value follows another unseen
    usual = _usual(lengths[inside[:-1]])
    if usual < 2 or np.median(moves) < QUANTA * np.min(moves) or np.mean(moves < 1.5 * np.min(moves)) > SMALLEST_STEPS:
        return begins[:0]
    return begins


def _corners(t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the rows (k,) in which the lines of an interpolated column x (n,) begin; none if it has no lines.

    A corner between two rows bends both: the first of them counts.
    """
    none = np.zeros(0, int)
    if len(x) < FEWEST_VALUES:
        return none
    h, step = np.diff(t), np.diff(x)
    bends = np.abs(step[1:] * h[:-1] - step[:-1] * h[1:]) / (h[1:] + h[:-1])
    exact = COMPUTER_ROUNDING * (np.max(np.abs(x)) + np.max(np.abs(step)) * np.max(np.abs(t)) / np.median(h))
    largest = np.max(bends)
    if not np.isfinite(largest):
        return none
    most = none
    for level in BEND_LEVELS:
        if not level * largest > exact:
            break
        bent = np.concatenate([[False], bends > level * largest, [False]])
        corners, ends = (np.flatnonzero(each) + 1 for each in (bent[1:] & ~bent[:-1], bent[:-1] & ~bent[1:]))
        if len(corners) < max(FEWEST_VALUES, len(most)) or np.mean(ends - corners <= CORNER) < REGULAR:
            continue
        sharp = bends[corners - 1]
        straight = np.quantile(bends[bends <= level * largest], REGULAR) < STRAIGHT * np.median(sharp)
        if straight and _are_lines(t, x, corners):
            most = corners
    return most


def _are_lines(t: np.ndarray, x: np.ndarray, corners: np.ndarray) -> bool:
    """Whether corners (k,) are a regular number of rows apart, with many slopes between them that do not just alternate
    in sign, as those of an oscillation of four rows do."""
    slopes = np.diff(x[corners]) / np.diff(t[corners])
    size = math.sqrt(float(np.mean(slopes**2)))
    if _usual(np.diff(corners)[slopes != 0.0]) < 2 or np.mean(slopes[1:] * slopes[:-1] < 0.0) > REGULAR:
        return False
    return len(np.unique(np.round(slopes / (SAME_SLOPE * size)))) >= FEWEST_SLOPES


def _usual(lengths: np.ndarray) -> int:
    """Return the number of rows that nearly all values stay for, of each value's (k,); 0 if there is none."""
    usual = int(np.median(lengths)) if len(lengths) else 0
    return usual if usual and np.mean(np.abs(lengths - usual) <= (1 if usual > 2 else 0)) >= REGULAR else 0


def slower(name: str, t: np.ndarray, rate: Rate, mask: np.ndarray) -> Iterator[Fault]:
    """Yield the Fault of a column whose rate is lower than the log's; set mask (n,) False between its own values, in
    place."""
    between = np.flatnonzero(mask & ~rate.own)
    if len(between):
        mask[between] = False
        yield Fault("stale", name, float(t[between[0]]), float(t[between[-1]]), len(between),
                    f"{name} is {rate.words}; these rows are left out")
