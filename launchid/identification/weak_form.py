"""The weak form of a log: increments of theta_dot over a time against the integrals of the terms over the same time.

No differencing makes it noisy: what a sensor's noise adds to an increment does not grow as the rows come closer.
"""

import math
from dataclasses import dataclass

import numpy as np

from launchid_core import parse_term

from ..log.log import Log
from ..sums import combined, least_squares

INCREMENT = 0.2      # s: within it a loop's period is seen, and sensor noise is small beside what moves
SLOPE = 0.05         # s to either side of a rate that is the slope of a column: small beside an increment
MOST_ROWS = 50_000   # that are judged: of a long log means of more of them
FINE = 0.005         # s from row to row: nothing that a vehicle does is faster
LEAST_STEP = 1.0e-6  # of the median step: nothing is known of a rate between stamps that are nearer
ABSURD = 1000.0      # times the log's length: a stamp further from its middle is no time of this log
GAP = 1.5            # median steps: no increment, and no parabola of the quadrature, reaches over a longer one
FUNCTIONS = (np.ones_like, np.sin, np.cos, np.sign)  # by their code in a term


@dataclass(frozen=True, eq=False)
class Rows:
    """The usable rows of a log: times that increase, everything finite.

    t [s], theta, gamma [rad] (0 where no flight path is known), theta_dot [rad/s], beta (n,)
    span   rows in an increment of INCREMENT;  has_rate  theta_dot was measured, not made of theta
    """

    t: np.ndarray
    theta: np.ndarray
    gamma: np.ndarray
    theta_dot: np.ndarray
    beta: np.ndarray
    span: int
    has_rate: bool = True

    @property
    def attack(self) -> np.ndarray:
        """Angle of attack theta - gamma [rad], which a6 multiplies."""
        return self.theta - self.gamma

    def cut(self, t_start: float, t_end: float) -> slice:
        """Rows of a window."""
        first, end = np.searchsorted(self.t, (t_start, t_end)).tolist()
        return slice(first, end)

    @property
    def period(self) -> float:
        """Median step [s]."""
        return float(np.median(np.diff(self.t)))


def usable(log: Log) -> Rows | None:
    """The rows of a log that every column has; None where they make no two increments.

    Where no rate is measured it is the attitude's (`slope`).  What the estimator rejects as out of range is no row
    here either.
    """
    finite = log.in_range("t") & log.in_range("theta") & log.in_range("beta")
    has_rate = bool(log.in_range("theta_dot").any())
    if has_rate:
        finite &= log.in_range("theta_dot")
    finite[finite] = near_all(log.t[finite], log.period)
    finite[finite] = forward(log.t[finite], LEAST_STEP * log.period)
    span = max(1, round(INCREMENT / log.period))
    if np.count_nonzero(finite) < 2 * span + 2:
        return None
    t, theta = log.t[finite], log.theta[finite]
    rate = log.theta_dot[finite] if has_rate else slope(t, theta)
    return Rows(t, theta, path_angle(t, log.flight_path[finite]), rate, log.beta[finite], span, has_rate)


def thinned(rows: Rows) -> Rows | None:
    """The rows as means over as many of them as make FINE, or leave MOST_ROWS.

    All that is linear between the columns holds of their means too.  Groups over a gap, or longer than the others, are
    left out; None where too few are left for two increments.
    """
    many = max(int(FINE / rows.period * (1.0 + 1e-9)), math.ceil(len(rows.t) / MOST_ROWS))
    if many < 2:
        return rows
    count = len(rows.t) // many

    def means(x: np.ndarray) -> np.ndarray:
        return x[:count * many].reshape(count, many).mean(axis=1)

    lasts = np.diff(rows.t[:count * many].reshape(count, many)[:, [0, -1]], axis=1)[:, 0]
    whole = lasts <= GAP * many * rows.period
    t, theta, gamma, theta_dot, beta = (means(x)[whole] for x in (rows.t, rows.theta, rows.gamma, rows.theta_dot,
                                                                  rows.beta))
    span = max(1, round(INCREMENT / (many * rows.period)))
    return Rows(t, theta, gamma, theta_dot, beta, span, rows.has_rate) if len(t) > 2 * span + 2 else None


def path_angle(t: np.ndarray, gamma: np.ndarray) -> np.ndarray:
    """Flight-path angle [rad] at every stamp t (n,) [s]: linear between the measured ones, 0 where none is."""
    known = np.isfinite(gamma)
    return np.interp(t, t[known], gamma[known]) if known.any() else np.zeros(len(t))


def slope(t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Difference quotient (n,) of x (n,) over SLOPE before and after, over what there is at the ends."""
    at, rows = np.arange(len(t)), slope_rows(t)
    before, after = np.maximum(at - rows, 0), np.minimum(at + rows, len(t) - 1)
    return np.asarray((x[after] - x[before]) / (t[after] - t[before]))


def slope_rows(t: np.ndarray) -> int:
    """Rows in SLOPE."""
    return max(1, round(SLOPE / float(np.median(np.diff(t)))))


def near_all(t: np.ndarray, period: float) -> np.ndarray:
    """The stamps that are times of this log, as a mask."""
    return np.abs(t - np.median(t)) <= ABSURD * len(t) * period if len(t) else np.zeros(0, bool)


def forward(t: np.ndarray, least: float) -> np.ndarray:
    """Stamps that go forward by more than `least` [s]: later than all before, or earlier than all after, whichever
    leaves more.

    One stamp too late spoils the first, one too early the second.
    """
    if len(t) == 0:
        return np.zeros(0, bool)
    later = np.concatenate([[True], t[1:] - np.maximum.accumulate(t)[:-1] > least])
    earlier = np.concatenate([np.minimum.accumulate(t[::-1])[::-1][1:] - t[:-1] > least, [True]])
    return later if np.count_nonzero(later) >= np.count_nonzero(earlier) else earlier


def column(term: str, attack: np.ndarray, theta_dot: np.ndarray, beta: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """A library term (n,) of its variables (n,), `attack` being its theta."""
    *powers, function, argument = parse_term(term)
    variables = (attack, theta_dot, beta, tau)
    value = np.ones(len(attack))
    for power, x in zip(powers, variables, strict=True):
        value = value * x**power
    return value * FUNCTIONS[function](variables[argument]) if function else value


def running_integral(t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Integral (n,) of x (n,) from t[0] on, of third order: the trapezium less the mean bend of the parabolas through
    either neighbour (Gregory's rule)."""
    step = np.diff(t)
    bend = np.zeros(len(t))
    whole = step <= GAP * np.median(step)
    inner = whole[1:] & whole[:-1]
    bend[1:-1][inner] = (np.diff(np.diff(x) / step) / (t[2:] - t[:-2]))[inner]
    known = np.concatenate([[False], inner, [False]]).astype(float)
    sides = np.maximum(known[1:] + known[:-1], 1.0)
    parts = 0.5 * step * (x[1:] + x[:-1]) - step**3 / 6.0 * (bend[1:] + bend[:-1]) / sides
    return np.concatenate([[0.0], np.cumsum(parts)])


def averaged(t: np.ndarray, columns: np.ndarray, rows: int) -> np.ndarray:
    """(n - 2 rows, c) means of columns (n, c) over so many rows before and after each row that has them."""
    whole = np.column_stack([running_integral(t, x) for x in columns.T])
    return np.asarray((whole[2 * rows:] - whole[:-2 * rows]) / (t[2 * rows:] - t[:-2 * rows])[:, None])


def increments(t: np.ndarray, integrals: np.ndarray, span: int, stride: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """(first rows (k,), increments (k, c) of integrals) over `span` rows, from every `stride`-th row.

    t (n,) [s];  integrals (n - 2 m, c)  of the rows but for the first and last m, over which each was averaged
    Without those that a gap is within, be it by what was averaged.
    """
    margin = (len(t) - len(integrals)) // 2
    first = np.arange(0, max(len(integrals) - span, 0), stride)
    if len(first) == 0:
        return first, integrals[:0]
    step = np.diff(t)
    gaps = np.concatenate([[0], np.cumsum(step > GAP * np.median(step))])
    first = first[gaps[first + span + 2 * margin] == gaps[first]]
    return first, integrals[first + span] - integrals[first]


def term_integrals(rows: Rows, at: slice, terms: tuple[str, ...], beta: np.ndarray) -> np.ndarray:
    """(k, q) running integrals of library terms over the rows `at`, tau from their middle, with another beta (n,)."""
    t = rows.t[at]
    tau = t - 0.5 * (t[0] + t[-1])
    columns = [running_integral(t, column(term, rows.attack[at], rows.theta_dot[at], beta[at], tau)) for term in terms]
    return np.column_stack(columns) if columns else np.zeros((len(t), 0))


def window_increments(rows: Rows, at: slice, terms: tuple[str, ...]) -> tuple[np.ndarray, ...]:
    """The increments of a window: times at which they begin and end, of theta_dot (k,), of the terms (k, q)."""
    t = rows.t[at]
    if len(t) <= rows.span:
        return t[:0], t[:0], t[:0], np.zeros((0, len(terms)))
    integrals = np.column_stack([term_integrals(rows, at, terms, rows.beta), rows.theta_dot[at]])
    first, steps = increments(t, integrals, rows.span)
    return t[first], t[first + rows.span], steps[:, -1], steps[:, :-1]


def left(phi: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The residual of y after least squares on phi."""
    return y - combined(phi, least_squares(phi, y)) if phi.shape[1] else y
