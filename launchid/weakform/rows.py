"""The rows of a log as the weak form sees them, in stretches without a gap."""

import itertools
import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ..series import white_variance

SLOPE_SPAN = 0.05    # s to either side, at most, of a rate that is the slope of a column, where a rate is a term
FINE_RATE = 0.3      # of the rate's own deviation, that its noise over a row to either side may be to be taken off
RATE_NOISE = 0.05    # of the rate's own deviation, that its noise may be: 0.25 % of its square
MIN_ROWS_A_STRETCH = 4  # rows of a stretch
BRIEF = 0.02         # s of a slope of beta: a nozzle does nothing faster


@dataclass(frozen=True, eq=False)
class Rows:
    """The usable rows of a log: times that increase, everything finite.

    t [s], theta, gamma [rad] (0 where no flight path is known), theta_dot [rad/s], beta [rad], each (n,)
    has_rate   theta_dot was measured, not made of theta;  has_theta  theta was, not made of theta_dot
    has_gamma  a flight path is known
    bounds     first row of each stretch without a gap, and n at the end
    is_held    beta is constant from each of its values to the next;  is_command: it is the command itself
    theta_noise, rate_noise, beta_noise  variances of the sensors' white noise, as their rows show it
    beta_doubt  uncertainty of beta_noise: it is noise, or motion from row to row
    reach      [s] to either side of a slope that stands for theta_dot
    is_fine    where theta_dot was not measured theta's changes over a row are its integral: they have little noise
    top    [rad/s]  modes that are faster are not used
    fast (n,)  theta less its mean over FAST_TIME before, by the whole log;  (0,): not computed yet
    """

    t: np.ndarray
    theta: np.ndarray
    gamma: np.ndarray
    theta_dot: np.ndarray
    beta: np.ndarray
    has_rate: bool
    has_gamma: bool
    bounds: np.ndarray
    theta_noise: float = 0.0
    rate_noise: float = 0.0
    beta_noise: float = 0.0
    beta_doubt: float = 0.0
    is_held: bool = False
    is_command: bool = False
    has_theta: bool = True
    reach: float = SLOPE_SPAN
    is_fine: bool = False
    top: float = math.inf
    fast: np.ndarray = field(default_factory=lambda: np.zeros(0))
    transformed: dict[str, Any] = field(default_factory=dict, init=False)   # what `modes` made of the rows so far

    @cached_property
    def attack(self) -> np.ndarray:
        """Angle of attack theta - gamma (n,) [rad], which a6 multiplies."""
        return self.theta - self.gamma

    @cached_property
    def stretches(self) -> list[tuple[int, int]]:
        """(First row, row behind the last) of each stretch without a gap that is long enough for modes."""
        return [(a, b) for a, b in itertools.pairwise(self.bounds.tolist()) if b - a >= MIN_ROWS_A_STRETCH]

    @cached_property
    def period(self) -> float:
        """Median step between the rows [s]."""
        return float(np.median(np.diff(self.t)))

    @property
    def stretch(self) -> float:
        """Typical length [s] of a stretch without a gap: half of the rows are in longer ones."""
        rows = np.diff(self.bounds)
        return float(np.median(np.repeat(rows, rows))) * self.period

    def cut(self, t_start: float, t_end: float) -> slice:
        """Return the slice of rows with t_start <= t < t_end [s]."""
        first, end = np.searchsorted(self.t, (t_start, t_end)).tolist()
        return slice(first, end)

    def within(self, part: "Rows") -> slice:
        """Return the slice of these rows that makes `part`, rows cut out of them."""
        return self.cut(part.t[0], math.nextafter(part.t[-1], math.inf))

    def part(self, at: slice) -> "Rows":
        """Return the rows of a slice, with the stretches inside it."""
        n = len(self.t[at])
        inside = self.bounds[(self.bounds > at.start) & (self.bounds < at.stop)] - at.start
        names = ("t", "theta", "gamma", "theta_dot", "beta", "fast")
        return replace(self, **{name: getattr(self, name)[at] for name in names},
                       bounds=np.concatenate([[0], inside, [n]]))


def slope(t: np.ndarray, x: np.ndarray, rows: int) -> np.ndarray:
    """Return the slope (n,) of x (n,) over t (n,), from `rows` rows before to as many after, fewer at the ends."""
    if len(t) < 2:
        return np.zeros(len(t))
    at = np.arange(len(t))
    before, after = np.maximum(at - rows, 0), np.minimum(at + rows, len(t) - 1)
    return np.asarray((x[after] - x[before]) / (t[after] - t[before]))


def rate_of(t: np.ndarray, theta: np.ndarray, period: float) -> tuple[np.ndarray, float, bool]:
    """Return (the rate (n,) [rad/s] of theta (n,) [rad] over t (n,) [s], rows `period` [s] apart: its slope; over which
    time [s] to either side, as few rows as make theta's noise RATE_NOISE of the rate, or reach SLOPE_SPAN, for a wider
    one flattens what is fast; whether over one row the noise is less than FINE_RATE)."""
    most = max(1, round(SLOPE_SPAN / period))
    widest = slope(t, theta, most)
    noise = math.sqrt(0.5 * white_variance(theta, typical=True)) / period
    fewest = max(1, math.ceil(noise / max(RATE_NOISE * float(np.std(widest)), 1e-300)))
    rows = min(most, fewest)
    return slope(t, theta, rows), rows * period, noise < FINE_RATE * float(np.std(widest))


def means_about(t: np.ndarray, x: np.ndarray, around: int) -> np.ndarray:
    """Return means (n - 2 around, q) of x (n, q) over `around` rows of t (n,) to either side, by the trapezium rule."""
    whole = np.vstack([np.zeros((1, x.shape[1])), np.cumsum(0.5 * np.diff(t)[:, None] * (x[1:] + x[:-1]), axis=0)])
    return np.asarray((whole[2 * around:] - whole[:-2 * around]) / (t[2 * around:] - t[:-2 * around])[:, None])

FAST_TIME = 1.0      # s: what theta does in a shorter time is its fast part


def before(x: np.ndarray) -> np.ndarray:
    """Return x (n,) shifted by a row: the value before each, the first twice."""
    return np.concatenate([x[:1], x[:-1]])


def fast_part(t: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Return theta (n,) less its mean over FAST_TIME before each time of t (n,) [s], with lines across gaps."""
    whole = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(t) * (theta[1:] + theta[:-1]))])
    begin = np.maximum(t - FAST_TIME, t[0])
    area, time = whole - np.interp(begin, t, whole), t - begin
    return theta - np.divide(area, time, out=theta.copy(), where=time > 0.0)
