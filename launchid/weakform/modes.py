"""The regression of the weak form, in the frequencies of each stretch without a gap.

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
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from launchid_core import parse_term

from ..sums import products
from .rows import BRIEF, MIN_ROWS_A_STRETCH, SLOPE_SPAN, Rows, before, means_about

FAST_THETA = "fast theta"
FRICTION = "sign(theta_dot)"
SURE_SIGN = 1.0      # standard deviations of a rate's noise, below which its sign is told in proportion to it
NUDGE = 1.0e-6      # rad, rad/s: of a difference quotient
FRAME = "frame"   # no term
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
    turned (q,)  variance of the noise of theta in a term whose integral is theta
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
    turned: np.ndarray
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
def noises_of(n: int, has_rate: bool, used: int | None = None) -> tuple[np.ndarray, ...]:
    """Return for the first `used` = k of n modes of a stretch, None: all, (angles (k,) [rad], lambda (k,), noise
    variances (3, k) as in `Modes`)."""
    used = n if used is None else used
    angle = np.pi * np.arange(1, used + 1) / (n + 1)
    curl = 2.0 - 2.0 * np.cos(angle)
    return angle, curl, np.stack([np.ones(used), curl if has_rate else curl**2, 1.0 / curl])


def sines(x: np.ndarray) -> np.ndarray:
    """Return the orthonormal sine transform DST-I (n, k) of columns x (n, k)."""
    n = len(x)
    odd = np.zeros((2 * (n + 1), x.shape[1]))
    odd[1:n + 1] = x
    odd[n + 2:] = -x[::-1]
    return np.asarray(-np.fft.rfft(odd, axis=0).imag[1:n + 1] / math.sqrt(2.0 * (n + 1)))


def areas(t: np.ndarray, values: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (integrals (n - 1, q) of terms over steps of t (n,) [s], what Gregory's rule takes off the trapezium's).

    values, ends (n, q)  terms as a step begins at each row, and as the one before ends: they differ by a held input
    """
    off = bends(t, values) * np.all(values == ends, axis=0)
    return 0.5 * np.diff(t)[:, None] * (ends[1:] + values[:-1]) - off, off


def used_modes(rows: Rows, a: int, b: int) -> int:
    """Return how many modes of the stretch from row a to row b - 1 are used: those that are no faster than rows.top."""
    n = b - a - (1 if rows.has_rate else 2)
    if not math.isfinite(rows.top):
        return n
    step = (rows.t[b - 1] - rows.t[a]) / (b - a - 1)
    return min(n, max(int(rows.top * step * (n + 1) / math.pi), 1))


def frame_of(rows: Rows) -> Frame:
    """Return the changes of theta_dot, or of theta's slopes where it is not measured, in modes, with their noise."""
    parts, ends, noises = list[tuple[np.ndarray, ...]](), list[np.ndarray](), list[np.ndarray]()
    for a, b in rows.stretches:
        step = np.diff(rows.t[a:b])
        rise = np.diff(rows.theta_dot[a:b]) if rows.has_rate else np.diff(np.diff(rows.theta[a:b]) / step)
        n, h = len(rise), float(np.mean(step))
        used = used_modes(rows, a, b)
        angle, curl, shapes = noises_of(n, rows.has_rate, used)
        noises.append(shapes)
        parts.append((sines(rise[:, None])[:used, 0], curl, np.full(used, h), angle / h))
        if not rows.has_rate:
            first = np.sqrt(2.0 / (n + 1)) * np.sin(angle)
            ends.append(np.column_stack([first, first * (-1.0) ** np.arange(used)]))
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
        if not rows.has_rate:  # of the integrals' means over the rows, by the rule of Euler and Maclaurin
            whole = np.vstack([np.zeros(q), np.cumsum(area, axis=0)])
            bent = np.diff(rows.t[a:b])[:, None] / 12.0 * (ends[a + 1:b] - values[a:b - 1])
            area, off = np.diff(0.5 * (whole[1:] + whole[:-1]) - bent, axis=0), off[1:] + np.diff(bent, axis=0)
        parts.append(sines(np.hstack([area, off]) if with_doubt else area)[:used_modes(rows, a, b)])
    return parts[-1] if len(parts) == 2 else np.concatenate(parts)


def turned_modes(rows: Rows) -> np.ndarray:
    """Return the integral of theta_dot in the modes (n,) of each stretch, which is theta, where that is all that is
    measured: the changes of its means over the rows, by the cubic through four."""
    parts = [np.zeros(0)]
    for a, b in rows.stretches:
        theta = rows.theta[a:b]
        mean = 0.5 * (theta[1:] + theta[:-1])
        mean[1:-1] -= (theta[3:] - theta[2:-1] - theta[1:-2] + theta[:-3]) / 24.0
        parts.append(sines(np.diff(mean)[:, None])[:used_modes(rows, a, b), 0])
    return np.concatenate(parts)


def values_of(rows: Rows, term: str, attack: np.ndarray, rate: np.ndarray, beta: np.ndarray) -> np.ndarray:
    """Return a term (n,) of a library, gamma, beta_ddot or FAST_THETA at the rows with this attack, rate, beta (n,); of
    FRICTION the mean over the step to the next row."""
    if term == FAST_THETA:
        return rows.fast
    if term == "gamma":
        return rows.gamma
    if term == FRICTION:   # of a rate that moves along a line, which may turn within the step
        least = max(SURE_SIGN * math.sqrt(rows.rate_noise), 1e-300)
        size, change, sign = np.abs(rate), np.diff(rate), np.clip(rate / least, -1.0, 1.0)
        braked = np.where(size > least, size - 0.5 * least, 0.5 * size**2 / least)   # the integral of that sign
        return np.append(np.divide(np.diff(braked), change, out=sign[:-1].copy(), where=change != 0.0), sign[-1:])
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


def term_modes(rows: Rows, terms: tuple[str, ...]) -> Modes:
    """Return the regression of theta_dot on terms in the rows' modes; what is new is added to
    rows.transformed, in place."""
    made = rows.transformed   # the columns of the terms asked for so far; FRAME: the regression without its terms
    if FRAME not in made:
        made[FRAME] = frame_of(rows)
    missing = tuple(dict.fromkeys(term for term in terms if term not in made))
    if missing:
        values, q = table_of(rows, missing, rows.attack, rows.theta_dot), len(missing)
        both = in_modes(rows, values, ends_of(rows, missing, values, rows.beta))
        for k, term in enumerate(missing):
            phi = turned_modes(rows) if term == "theta_dot" and rows.is_fine else both[:, k]
            made[term] = Column(phi, both[:, q + k], *derivatives(rows, term, values[:, k]))
    phi, doubt, by_theta, by_rate, by_beta = (np.stack(each, axis=1) for each in zip(
        *(made[term] for term in terms), strict=True))
    nozzle = products(by_beta, by_beta) / len(rows.t)
    sensor = (rows.theta_noise * products(by_theta, by_theta) + rows.rate_noise * products(by_rate, by_rate)
              ) / len(rows.t) + rows.beta_noise * nozzle
    y, curl, step, frequency, ends, noises = made[FRAME]
    return Modes(y, phi, doubt, curl, step, frequency, rows.has_rate, ends, noises, sensor,
                 rows.beta_doubt * nozzle,
                 rows.theta_noise * by_theta.mean(axis=0),
                 rows.theta_noise * np.array([term == "theta_dot" and rows.is_fine for term in terms]),
                 0.5 * rows.period * by_rate.mean(axis=0))


def together(parts: Sequence[Modes]) -> Modes:
    """Return regressions with the same terms as one, whose coefficients all have; without the noise beyond their ends.
    """
    y, phi, doubt, curl, step, frequency = (np.concatenate([getattr(m, name) for m in parts]) for name in (
        "y", "phi", "doubt", "curl", "step", "frequency"))
    return replace(parts[0], y=y, phi=phi, doubt=doubt, curl=curl, step=step, frequency=frequency,
                   ends=np.zeros((len(y), 0)), noises=np.concatenate([m.noises for m in parts], axis=1))


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
    ends = values.copy()
    for k in (k for k, term in enumerate(terms) if term == FRICTION):
        ends[:, k] = before(values[:, k])
    for k in (k for k, term in enumerate(terms) if rows.is_held and "beta" in term):
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
