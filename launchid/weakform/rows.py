"""Prepare the rows of a log for the weak form, and its regression in the frequencies of each stretch without a gap.

Over a row, theta_dot changes by the integrals of the terms and an accumulated disturbance; a white sensor noise v is
differenced:

    theta_dot[k+1] - theta_dot[k] = sum xi_j (F_j[k+1] - F_j[k]) + w[k] + v[k+1] - v[k],     F_j the integral of term j

The covariance of the right side, q h on the diagonal and r (2, -1) on three, has the sines

    sin(pi j k/(n + 1)),     variance  q h + r lambda_j,     lambda_j = 2 - 2 cos(pi j/(n + 1))

as its eigenvectors (DST-I), whatever q and r are: in these modes the equations are independent, and generalised least
squares is a weight for each. Where theta_dot is not measured, the slope of theta over each row stands for it, and the
columns are means over the row.
"""

import itertools
import math
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from launchid_core import parse_term

from ..log.check import BRIDGED, CheckedLog
from ..log.rates import HELD_WORD
from ..sums import DEPENDENT, combined, least_squares, products

FINE = 0.005         # s from row to row: nothing that a vehicle does is faster
JUDGED_ROWS = 50_000  # that are judged: of a long log means of more of them
LEAST_STEP = 1.0e-6  # of the median step: nothing is known of a rate between stamps that are nearer
FARTHEST_STAMP = 1000.0  # times the log's length: a stamp further from its middle is no time of this log
LONGEST_ROW_STEP = 1.5  # median steps: no row reaches over a longer one
SLOPE_SPAN = 0.05    # s to either side of a rate that is the slope of a column, where a rate is a term
MIN_ROWS_A_STRETCH = 4  # rows of a stretch
BRIEF = 0.02         # s of a slope of beta: a nozzle does nothing faster
FAST_TIME = 1.0      # s: what theta does in a shorter time is its fast part
FAST_THETA = "fast theta"
STEADY_TIME = 0.25   # s to either side at most, over which theta_dot's integral tells what theta does
ROUGH_ORDERS = (3, 8)  # of the differences of beta that tell its noise, which both show alike, from motion
ROUGH_ROWS = 10_000  # to either side of the log's middle, of which its roughness is asked
ROUGH_LAGS = 4       # rows, this one among them, by which beta may follow what else is logged
NUDGE = 1.0e-6      # rad, rad/s: of a difference quotient
TERM_FUNCTIONS = (np.ones_like, np.sin, np.cos, np.sign)  # by their code in a term

code_of = lru_cache(maxsize=256)(parse_term)


class Column(NamedTuple):
    """One term of the equation, transformed to n modes (sines): phi (n,), doubt (n,) error of its quadrature; and at
    the m rows its derivatives (m,) by theta, theta_dot and beta."""

    phi: np.ndarray
    doubt: np.ndarray
    by_theta: np.ndarray
    by_rate: np.ndarray
    by_beta: np.ndarray


@dataclass(frozen=True, eq=False)
class Rows:
    """The usable rows of a log: times that increase, everything finite.

    t [s], theta, gamma [rad] (0 where no flight path is known), theta_dot [rad/s], beta [rad], each (n,)
    has_rate   theta_dot was measured, not made of theta;  has_gamma  a flight path is known
    bounds     first row of each stretch without a gap, and n at the end
    is_held    beta is constant from each of its values to the next
    theta_noise, rate_noise, beta_noise  variances of the sensors' white noise, as their rows show it
    beta_doubt  uncertainty of beta_noise: it is noise, or motion from row to row
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
    fast: np.ndarray = field(default_factory=lambda: np.zeros(0))
    columns: dict[str, Column] = field(default_factory=dict, init=False)   # of the terms that were asked for so far

    @cached_property
    def attack(self) -> np.ndarray:
        """Angle of attack theta - gamma (n,) [rad], which a6 multiplies."""
        return self.theta - self.gamma

    @cached_property
    def stretches(self) -> list[tuple[int, int]]:
        """(First row, row behind the last) of each stretch without a gap that is long enough for modes."""
        return [(a, b) for a, b in itertools.pairwise(self.bounds.tolist()) if b - a >= MIN_ROWS_A_STRETCH]

    @cached_property
    def frame(self) -> "Frame":
        """The regression of the rows in modes, without its terms."""
        return frame_of(self)

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


def usable(seen: CheckedLog, *, is_steadied: bool = True) -> Rows | None:
    """Return the rows of a log that the weak form can use, means over FINE [s] if they are closer; None of too few.

    is_steadied   take fast motion of theta from theta_dot, with less noise than its sensor's; else theta as measured
    One or two missing cells in a row are bridged by lines; a rate that is not measured is the slope of theta.
    """
    log = seen.estimated
    times = log.in_range("t")
    if np.count_nonzero(times) < MIN_ROWS_A_STRETCH:
        return None
    times[times] = near_all(log.t[times], log.period)
    times[times] = forward(log.t[times], LEAST_STEP * log.period)
    t, has_rate = log.t[times], bool(np.mean(log.in_range("theta_dot")) > 0.5)
    names = ("theta", "beta", "theta_dot") if has_rate else ("theta", "beta")
    columns, there = dict[str, np.ndarray](), np.ones(len(t), bool)
    for name in names:
        columns[name], known = bridged(t, np.where(log.in_range(name), getattr(log, name), math.nan)[times])
        there &= known
    if np.count_nonzero(there) < MIN_ROWS_A_STRETCH:
        return None
    t, row = t[there], np.flatnonzero(there)
    theta, beta = columns["theta"][there], columns["beta"][there]
    path = log.flight_path[times][there]
    rate = columns["theta_dot"][there] if has_rate else slope(t, theta, max(1, round(SLOPE_SPAN / log.period)))
    step = np.diff(t)
    cuts = np.flatnonzero((step > LONGEST_ROW_STEP * np.median(step)) | (np.diff(row) > 1)) + 1
    rows = Rows(t, theta, path_angle(t, path), rate, beta, has_rate, bool(np.isfinite(path).any()),
                np.concatenate([[0], cuts, [len(t)]]), is_held=seen.rates["beta"].kind == HELD_WORD)
    command = log.beta_cmd[times][there]
    noise, doubt = nozzle_noise(rows, [theta, *([rate] if has_rate else []), *([command] if np.isfinite(command).all()
                                                                             else [])])
    means = thinned(replace(rows, theta=steadied(rows)) if has_rate and is_steadied else rows)
    return with_noise_levels(replace(means, beta_noise=noise * rows.period / means.period,
                                     beta_doubt=doubt * rows.period / means.period))


def steadied(rows: Rows) -> np.ndarray:
    """Return theta (n,) [rad] with less noise: the integral of a measured theta_dot, about a running mean of theta over
    as many rows as make the noise of both least.

    What the controller answers to theta's own noise is correlated with it: to a regression on theta it is a motion.
    """
    least_noise = math.sqrt(3.0 * noise_variance(rows.theta) / noise_variance(rows.theta_dot)) / rows.period
    most = int(min(least_noise, STEADY_TIME / rows.period))
    parts = []
    for a, b in itertools.pairwise(rows.bounds.tolist()):
        t, rate, at = rows.t[a:b], rows.theta_dot[a:b], np.arange(b - a)
        turned = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(t) * (rate[1:] + rate[:-1]))])
        whole = np.concatenate([[0.0], np.cumsum(rows.theta[a:b] - turned)])
        reach = np.minimum(np.minimum(at, at[::-1]), most)
        parts.append(turned + (whole[at + reach + 1] - whole[at - reach]) / (2 * reach + 1))
    return np.concatenate(parts)


def nozzle_noise(rows: Rows, others: list[np.ndarray]) -> tuple[float, float]:
    """Return (the variance of the white noise of beta's sensor, its uncertainty) [rad^2].

    others   columns (n,) that beta may answer: what they explain of it within ROUGH_LAGS rows acts, and is no noise

    Differences of white noise show the same variance at any order, those of motion less at a higher one. What may be
    either, which is all of it where rows are slower than the nozzle, counts by half.
    """
    if rows.is_held:
        return 0.0, 0.0
    middle = slice(max(len(rows.t) // 2 - ROUGH_ROWS, 0), len(rows.t) // 2 + ROUGH_ROWS)
    low, high = (roughness(rows.beta[middle], [x[middle] for x in others], order) for order in ROUGH_ORDERS)
    high = min(low, high)
    sure = max(2.0 * high - low, 0.0) if rows.period < 1.1 * BRIEF else 0.0
    return 0.5 * (high + sure), 0.5 * (high - sure)


def roughness(x: np.ndarray, others: list[np.ndarray], order: int) -> float:
    """Return the variance of white noise in x (n,) by its differences of `order`, less what others (n,) explain."""
    rest, *around = (np.diff(each, order) for each in (x, *others))
    if len(rest) < 2 * ROUGH_LAGS * (len(around) + 1):
        return 0.0
    lags = np.column_stack([each[ROUGH_LAGS - 1 - k:len(each) - k] for each in around for k in range(ROUGH_LAGS)])
    rest = rest[ROUGH_LAGS - 1:]
    size = np.sqrt(np.maximum(np.einsum("nk,nk->k", lags, lags), 1e-300))
    rest = rest - combined(lags, least_squares(lags / size, rest, DEPENDENT) / size)
    return float(np.median(np.abs(rest)) / 0.6745) ** 2 / math.comb(2 * order, order)


def with_noise_levels(rows: Rows) -> Rows:
    """Return the rows with noise variances, and theta's fast part, set from their own theta and theta_dot."""
    return replace(rows, theta_noise=noise_variance(rows.theta), fast=fast_part(rows.t, rows.theta),
                   rate_noise=noise_variance(rows.theta_dot) if rows.has_rate else 0.0)


def bridged(t: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (x (n,) interpolated over all gaps, (n,) bool: measured, or in a gap of at most BRIDGED cells)."""
    good = np.isfinite(x)
    if good.all() or not good.any():
        return x, good
    at = np.arange(len(x))
    before = np.maximum.accumulate(np.where(good, at, -len(x)))
    after = np.minimum.accumulate(np.where(good, at, 2 * len(x))[::-1])[::-1]
    known = good | (after - before <= BRIDGED + 1)
    return np.interp(t, t[good], x[good]), known


def thinned(rows: Rows) -> Rows:
    """Return means over as many rows as make FINE [s], or leave JUDGED_ROWS in all; the rows as they are if one.

    All that is linear between the columns holds of their means too.
    """
    many = max(int(FINE / rows.period * (1.0 + 1e-9)), math.ceil(len(rows.t) / JUDGED_ROWS))
    if many < 2:
        return rows
    if rows.is_held:   # by lines between the rows it has the integral of its steps where it is the mean of both
        rows = replace(rows, beta=0.5 * (rows.beta + before(rows.beta)), is_held=False)
    whole = [(a, b - (b - a) % many) for a, b in zip(rows.bounds[:-1].tolist(), rows.bounds[1:].tolist(), strict=True)]
    whole = [(a, b) for a, b in whole if b - a >= MIN_ROWS_A_STRETCH * many]
    if not whole:
        return rows
    at = np.concatenate([np.arange(a, b) for a, b in whole])
    means = {name: getattr(rows, name)[at].reshape(-1, many).mean(axis=1)
             for name in ("t", "theta", "gamma", "theta_dot", "beta")}
    return replace(rows, **means, bounds=np.cumsum([0, *((b - a) // many for a, b in whole)]))


def path_angle(t: np.ndarray, gamma: np.ndarray) -> np.ndarray:
    """Return the flight-path angle (n,) [rad] at stamps t (n,): linear between finite gamma (n,), 0 if none is."""
    known = np.isfinite(gamma)
    return np.interp(t, t[known], gamma[known]) if known.any() else np.zeros(len(t))


def slope(t: np.ndarray, x: np.ndarray, rows: int) -> np.ndarray:
    """Return the slope (n,) of x (n,) over t (n,), from `rows` rows before to as many after, fewer at the ends."""
    if len(t) < 2:
        return np.zeros(len(t))
    at = np.arange(len(t))
    before, after = np.maximum(at - rows, 0), np.minimum(at + rows, len(t) - 1)
    return np.asarray((x[after] - x[before]) / (t[after] - t[before]))


def near_all(t: np.ndarray, period: float) -> np.ndarray:
    """Return (n,) bool: stamps t (n,) [s] that are within FARTHEST_STAMP lengths of the log from their median."""
    return np.abs(t - np.median(t)) <= FARTHEST_STAMP * len(t) * period if len(t) else np.zeros(0, bool)


def forward(t: np.ndarray, least: float) -> np.ndarray:
    """Return (n,) bool: stamps t (n,) [s] that go forward by more than `least` [s]: later than all before, or earlier
    than all after, whichever leaves more (one stamp too late spoils the first, one too early the second)."""
    if len(t) == 0:
        return np.zeros(0, bool)
    later = np.concatenate([[True], t[1:] - np.maximum.accumulate(t)[:-1] > least])
    earlier = np.concatenate([np.minimum.accumulate(t[::-1])[::-1][1:] - t[:-1] > least, [True]])
    return later if np.count_nonzero(later) >= np.count_nonzero(earlier) else earlier


def column(term: str, attack: np.ndarray, theta_dot: np.ndarray, beta: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """Return a library term (n,), as `parse_term` reads it, of its variables (n,), `attack` being its theta."""
    *powers, function, argument = code_of(term)
    variables = (attack, theta_dot, beta, tau)
    factors = [x**power for power, x in zip(powers, variables, strict=True) if power]
    if function:
        factors.append(TERM_FUNCTIONS[function](variables[argument]))
    return math.prod(factors[1:], start=factors[0]) if factors else np.ones(len(attack))


def bends(t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return by how much the integrals (n - 1, q) of x (n, q) over each step of t (n,) are less than the trapezium's:
    by the mean bend of the parabolas through either neighbour (Gregory's rule)."""
    step = np.diff(t)[:, None]
    bend = np.zeros(x.shape)
    bend[1:-1] = np.diff(np.diff(x, axis=0) / step, axis=0) / (t[2:] - t[:-2])[:, None]
    halves = np.full((len(t) - 1, 1), 2.0)
    halves[0] -= 1.0
    halves[-1] -= 1.0
    return np.asarray(step**3 / 6.0 * (bend[1:] + bend[:-1]) / np.maximum(halves, 1.0))


@dataclass(frozen=True, eq=False)
class Modes:
    """A regression on q terms in n modes, the sines of each stretch: y = phi xi + noise, one row a mode.

    noises (3, n)  variances by unit noise: accumulated, of the sensor, wandering; one array for all with the same modes
    y (n,) of theta_dot;  phi (n, q) of the terms;  doubt (n, q) the error of their quadrature
    curl (n,)  lambda, the variance by unit white noise on theta_dot;  step (n,) [s] between the mode's rows
    frequency (n,) [rad/s]
    ends (n, k)  columns of theta's noise before the first row and behind the last of each stretch, where theta_dot is
                 made of theta: what is left of the modes' noise beside these is independent
    sensor (q, q)  mean products that the sensors' white noise adds to those of the terms;  unsure (q, q)  their
    uncertainty;  motion (q,)  those of a term with the slope of theta, by theta's noise
    ahead (q,) [s]  how much of a disturbance in a row the term's integral over that row has: half of the row, of a rate
    """

    y: np.ndarray
    phi: np.ndarray
    doubt: np.ndarray
    curl: np.ndarray
    step: np.ndarray
    frequency: np.ndarray
    has_rate: bool
    ends: np.ndarray
    noises: np.ndarray
    sensor: np.ndarray
    unsure: np.ndarray
    motion: np.ndarray
    ahead: np.ndarray



class Frame(NamedTuple):
    """The part of a regression in modes that does not depend on its terms; fields as in `Modes`."""

    y: np.ndarray
    curl: np.ndarray
    step: np.ndarray
    frequency: np.ndarray
    ends: np.ndarray
    noises: np.ndarray


@lru_cache(maxsize=64)
def noises_of(n: int, has_rate: bool) -> tuple[np.ndarray, ...]:
    """Return for n modes of a stretch (angles (n,) [rad], lambda (n,), noise variances (3, n) as in `Modes`)."""
    angle = np.pi * np.arange(1, n + 1) / (n + 1)
    curl = 2.0 - 2.0 * np.cos(angle)
    return angle, curl, np.stack([np.ones(n), curl if has_rate else curl**2, 1.0 / curl])


def sines(x: np.ndarray) -> np.ndarray:
    """Return the orthonormal sine transform DST-I (n, k) of columns x (n, k)."""
    n = len(x)
    odd = np.zeros((2 * (n + 1), x.shape[1]))
    odd[1:n + 1] = x
    odd[n + 2:] = -x[::-1]
    return np.asarray(-np.fft.rfft(odd, axis=0).imag[1:n + 1] / math.sqrt(2.0 * (n + 1)))


def before(x: np.ndarray) -> np.ndarray:
    """Return x (n,) shifted by a row: the value before each, the first twice."""
    return np.concatenate([x[:1], x[:-1]])


def areas(t: np.ndarray, values: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (integrals (n - 1, q) of terms over steps of t (n,) [s], what Gregory's rule takes off the trapezium's).

    values, ends (n, q)  terms as a step begins at each row, and as the one before ends: they differ by a held input
    """
    off = bends(t, values) * np.all(values == ends, axis=0)
    return 0.5 * np.diff(t)[:, None] * (ends[1:] + values[:-1]) - off, off


def frame_of(rows: Rows) -> Frame:
    """Return the changes of theta_dot, or of theta's slopes where it is not measured, in modes, with their noise."""
    parts, ends, noises = list[tuple[np.ndarray, ...]](), list[np.ndarray](), list[np.ndarray]()
    for a, b in rows.stretches:
        step = np.diff(rows.t[a:b])
        rise = np.diff(rows.theta_dot[a:b]) if rows.has_rate else np.diff(np.diff(rows.theta[a:b]) / step)
        n, h = len(rise), float(np.mean(step))
        angle, curl, shapes = noises_of(n, rows.has_rate)
        noises.append(shapes)
        parts.append((sines(rise[:, None])[:, 0], curl, np.full(n, h), angle / h))
        if not rows.has_rate:
            first = np.sqrt(2.0 / (n + 1)) * np.sin(angle)
            ends.append(np.column_stack([first, first * (-1.0) ** np.arange(n)]))
    if len(parts) == 1:
        y, curl, step, frequency = parts[0]
        return Frame(y, curl, step, frequency, ends[0] if ends else np.zeros((len(y), 0)), noises[0])
    y, curl, step, frequency = (np.concatenate([np.zeros(0), *each]) for each in zip(*parts, strict=True)) \
        if parts else [np.zeros(0)] * 4
    apart = np.zeros((len(y), 2 * len(ends)))
    at = 0
    for k, each in enumerate(ends):
        apart[at:at + len(each), 2 * k:2 * k + 2] = each
        at += len(each)
    relative = step / np.median(step) if len(step) else step
    return Frame(y, curl, step, frequency, apart, np.concatenate([np.zeros((3, 0)), *noises], axis=1) * relative)


def in_modes(rows: Rows, values: np.ndarray, ends: np.ndarray, *, with_doubt: bool = True) -> np.ndarray:
    """Return terms in the modes of each stretch, (modes, q), from their values and ends (n, q) at the rows (`areas`);
    `with_doubt` (modes, 2 q), behind them the errors of their quadrature."""
    q = values.shape[1]
    parts = [np.zeros((0, 2 * q if with_doubt else q))]
    for a, b in rows.stretches:
        area, off = areas(rows.t[a:b], values[a:b], ends[a:b])
        if not rows.has_rate:  # of the integrals' means over the rows
            whole = np.vstack([np.zeros(q), np.cumsum(area, axis=0)])
            area, off = np.diff(0.5 * (whole[1:] + whole[:-1]), axis=0), off[1:]
        parts.append(sines(np.hstack([area, off]) if with_doubt else area))
    return parts[-1] if len(parts) == 2 else np.concatenate(parts)


def values_of(rows: Rows, term: str, attack: np.ndarray, rate: np.ndarray, beta: np.ndarray) -> np.ndarray:
    """Return a term (n,) of a library, gamma, beta_ddot or FAST_THETA at the rows with this attack, rate, beta (n,)."""
    if term == FAST_THETA:
        return rows.fast
    if term == "gamma":
        return rows.gamma
    if term == "beta_ddot":
        ends = itertools.pairwise(rows.bounds.tolist())
        reach = max(1, round(BRIEF / rows.period))   # beta's own noise is not its acceleration
        return np.concatenate([behind(rows.t[a:b], behind(rows.t[a:b], beta[a:b], reach), 1) for a, b in ends])
    return column(term, attack, rate, beta, rows.t - 0.5 * (rows.t[0] + rows.t[-1]))


def behind(t: np.ndarray, x: np.ndarray, rows: int) -> np.ndarray:
    """Return the slope (n,) of x (n,) over t (n,) [s], from each row and that `rows` rows before it alone.

    Under feedback what comes after a row answers its noise, and must not be in a column beside it.
    """
    before = np.maximum(np.arange(len(t)) - rows, 0)
    return np.concatenate([[0.0], (x[1:] - x[before[1:]]) / (t[1:] - t[before[1:]])])[:len(t)]


def fast_part(t: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Return theta (n,) less its mean over FAST_TIME before each time of t (n,) [s], with lines across gaps."""
    whole = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(t) * (theta[1:] + theta[:-1]))])
    begin = np.maximum(t - FAST_TIME, t[0])
    area, time = whole - np.interp(begin, t, whole), t - begin
    return theta - np.divide(area, time, out=theta.copy(), where=time > 0.0)


def term_modes(rows: Rows, terms: tuple[str, ...]) -> Modes:
    """Return the regression of theta_dot on terms in the rows' modes; new terms are added to rows.columns, in place."""
    missing = tuple(dict.fromkeys(term for term in terms if term not in rows.columns))
    if missing:
        values, q = table_of(rows, missing, rows.attack, rows.theta_dot), len(missing)
        both = in_modes(rows, values, ends_of(rows, missing, values, rows.beta))
        for k, term in enumerate(missing):
            rows.columns[term] = Column(both[:, k], both[:, q + k], *derivatives(rows, term, values[:, k]))
    phi, doubt, by_theta, by_rate, by_beta = (np.stack(each, axis=1) for each in zip(
        *(rows.columns[term] for term in terms), strict=True))
    nozzle = products(by_beta, by_beta) / len(rows.t)
    sensor = (rows.theta_noise * products(by_theta, by_theta) + rows.rate_noise * products(by_rate, by_rate)
              ) / len(rows.t) + rows.beta_noise * nozzle
    y, curl, step, frequency, ends, noises = rows.frame
    return Modes(y, phi, doubt, curl, step, frequency, rows.has_rate, ends, noises, sensor,
                 rows.beta_doubt * nozzle,
                 rows.theta_noise * by_theta.mean(axis=0), 0.5 * rows.period * by_rate.mean(axis=0))


def derivatives(rows: Rows, term: str, value: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the derivatives (n,) of a term, whose value (n,) is given, by theta, by a measured theta_dot, and by beta:
    difference quotients, 0 where it does not depend on them."""
    none = np.zeros(len(value))
    if term == FAST_THETA:
        return none + 1.0, none, none
    if term in ("gamma", "beta_ddot") or term.startswith("sign"):
        return none, none, none
    theta, rate, beta, *_, function, argument = code_of(term)
    by_theta, by_rate, by_beta = none, none, none
    if theta or (function and argument == 0):
        by_theta = (values_of(rows, term, rows.attack + NUDGE, rows.theta_dot, rows.beta) - value) / NUDGE
    if rows.has_rate and (rate or (function and argument == 1)):
        by_rate = (values_of(rows, term, rows.attack, rows.theta_dot + NUDGE, rows.beta) - value) / NUDGE
    if beta or (function and argument == 2):
        by_beta = (values_of(rows, term, rows.attack, rows.theta_dot, rows.beta + NUDGE) - value) / NUDGE
    return by_theta, by_rate, by_beta


def table_of(rows: Rows, terms: tuple[str, ...], attack: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Return the values (n, q) of terms at the rows, with `attack` for theta and `rate` for theta_dot, (n,) each."""
    return np.column_stack([values_of(rows, term, attack, rate, rows.beta) for term in terms])


def ends_of(rows: Rows, terms: tuple[str, ...], values: np.ndarray, beta: np.ndarray) -> np.ndarray:
    """Return terms (n, q) as the step before each row ends, given their `values` (n, q) as the next one begins."""
    held = [k for k, term in enumerate(terms) if rows.is_held and "beta" in term]
    ends = values.copy()
    for k in held:
        ends[:, k] = values_of(rows, terms[k], rows.attack, rows.theta_dot, before(beta))
    return ends


def increments(rows: Rows, terms: tuple[str, ...], length: float) -> tuple[np.ndarray, ...]:
    """Return (begins (k,), ends (k,) of increments over `length` [s], theta_dot's (k,), the terms' integrals (k, q)).

    All are means about these times, over as much as a slope of theta or beta takes; beta_ddot's integral is beta's
    slope.
    """
    span, around = max(1, round(length / rows.period)), max(1, round((BRIEF if rows.has_rate
                                                                      else SLOPE_SPAN) / rows.period))
    parts: list[tuple[np.ndarray, ...]] = []
    plain = tuple("1" if term == "beta_ddot" else term for term in terms)
    values = np.column_stack([np.zeros((len(rows.t), 0)), *(values_of(
        rows, term, rows.attack, rows.theta_dot, rows.beta) for term in plain)])
    ends = ends_of(rows, plain, values, rows.beta)
    for a, b in itertools.pairwise(rows.bounds.tolist()):
        if b - a <= max(span, MIN_ROWS_A_STRETCH) + 2 * around:
            continue
        t, beta, rate = rows.t[a:b], rows.beta[a:b], rows.theta_dot[a:b]
        area, _ = areas(t, values[a:b], ends[a:b])
        whole = means_about(t, np.vstack([np.zeros(len(terms)), np.cumsum(area, axis=0)]), around)
        rate = means_about(t, rate[:, None], around)[:, 0] if rows.has_rate else rate[around:-around]
        for k in (k for k, term in enumerate(terms) if term == "beta_ddot"):
            whole[:, k] = (beta[2 * around:] - beta[:-2 * around]) / (t[2 * around:] - t[:-2 * around])
        t = t[around:-around]
        parts.append((t[:-span], t[span:], rate[span:] - rate[:-span], whole[span:] - whole[:-span]))
    if not parts:
        return rows.t[:0], rows.t[:0], rows.t[:0], np.zeros((0, len(terms)))
    return tuple(np.concatenate(each) for each in zip(*parts, strict=True))


def means_about(t: np.ndarray, x: np.ndarray, around: int) -> np.ndarray:
    """Return means (n - 2 around, q) of x (n, q) over `around` rows of t (n,) to either side, by the trapezium rule."""
    whole = np.vstack([np.zeros((1, x.shape[1])), np.cumsum(0.5 * np.diff(t)[:, None] * (x[1:] + x[:-1]), axis=0)])
    return np.asarray((whole[2 * around:] - whole[:-2 * around]) / (t[2 * around:] - t[:-2 * around])[:, None])


def noise_variance(x: np.ndarray) -> float:
    """Return the variance of white noise on a smooth channel x (n,): a 20th of that of its third differences."""
    x = x[np.isfinite(x)]
    d = np.diff(x, 3)
    quantum = np.diff(np.unique(x))
    floor = float(np.min(quantum[quantum > 0.0], initial=math.inf)) if len(quantum) else math.inf
    floor = floor * floor / 12.0 if math.isfinite(floor) else 0.0
    usual = float(np.median(np.abs(d)) / 0.6745) ** 2 / 20.0 if len(d) else 0.0
    return max(usual, floor, 1e-20)
