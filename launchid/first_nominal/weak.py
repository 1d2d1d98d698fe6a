"""The equation in its weak form: increments of the rate against integrals of the terms.

It needs no noise level and no start: it gives the search its first numbers, and says how well one part of the log
predicts another (held out).
"""

from dataclasses import dataclass

import numpy as np

from ..identification.weak_form import INCREMENT
from ..sums import combined, least_squares, square
from .channels import Channels
from .model import command

SLOPE_HALF = 0.02      # s to either side, of the line that gives a rate from theta alone
PIECE = 10.0           # s over which one set of coefficients and one trim hold
HELD_OUT = 0.4         # the last part of the log


@dataclass(frozen=True, eq=False)
class Motion:
    """theta, its rate and the input on rows without holes.

    t (n,) [s];  gamma (n,) [rad] flight path, 0 where none is known;  span: rows in an increment
    """

    t: np.ndarray
    theta: np.ndarray
    gamma: np.ndarray
    rate: np.ndarray
    u: np.ndarray
    span: int

    def at(self, delay: float) -> np.ndarray:
        """The input, delayed [s]."""
        return np.interp(self.t - delay, self.t, self.u)


def filled(t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Missing values by lines."""
    good = np.isfinite(x)
    return np.interp(t, t[good], x[good])


def motion(c: Channels, source_is_beta: bool) -> Motion:
    """The motion and what drives it; a missing rate is theta's slope, a missing theta the rate's integral."""
    u = filled(c.t, c.beta if source_is_beta else command(c))
    span = max(2, round(INCREMENT / c.period))
    if c.has("theta"):
        theta = filled(c.t, c.theta)
        half = max(1, round(SLOPE_HALF / c.period))
        rate = filled(c.t, c.theta_dot) if c.has("theta_dot") else slopes(c.t, theta, half)
        return Motion(c.t, theta, c.gamma, rate, u, span)
    rate = filled(c.t, c.theta_dot)
    theta = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(c.t) * (rate[1:] + rate[:-1]))])
    return Motion(c.t, theta - theta.mean(), c.gamma, rate, u, span)


def slopes(t: np.ndarray, x: np.ndarray, half: int) -> np.ndarray:
    """Slope at every row of the line through `half` rows to either side; at the ends that of the nearest."""
    def sums(y: np.ndarray) -> np.ndarray:
        whole = np.concatenate([[0.0], np.cumsum(y)])
        return whole[2 * half + 1:] - whole[:-2 * half - 1]
    n = 2 * half + 1
    tc, xc = t - t[0], x - x[0]
    below = sums(tc * tc) - sums(tc) ** 2 / n
    inner = (sums(tc * xc) - sums(tc) * sums(xc) / n) / below
    return np.concatenate([np.full(half, inner[0]), inner, np.full(half, inner[-1])])


def columns(m: Motion, terms: tuple[str, ...], u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middle time (k,), increment of the rate (k,), integrals (k, n) of the terms, the constant first."""
    attack = m.theta - m.gamma
    values = {"theta": attack, "sin(theta)": np.sin(attack), "beta": u, "theta_dot": m.rate,
              "sign(theta_dot)": np.sign(m.rate)}
    half = 0.5 * np.diff(m.t)
    parts = [m.t[m.span:] - m.t[:-m.span]]
    for term in terms:
        x = values[term]
        whole = np.concatenate([[0.0], np.cumsum(half * (x[1:] + x[:-1]))])
        parts.append(whole[m.span:] - whole[:-m.span])
    phi, y = np.column_stack(parts), m.rate[m.span:] - m.rate[:-m.span]
    near = phi[:, 0] <= 1.5 * m.span * float(np.median(np.diff(m.t)))  # no gap within
    return (0.5 * (m.t[m.span:] + m.t[:-m.span]))[near], y[near], phi[near]


def solve(phi: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Least squares with columns of one size."""
    scale = np.sqrt(np.mean(phi**2, axis=0)) + 1e-300
    return least_squares(phi / scale, y, 1e-9) / scale


def left_square(m: Motion, terms: tuple[str, ...], u: np.ndarray) -> float:
    """Squares that the terms, fitted piece by piece, leave."""
    t, y, phi = columns(m, terms, u)
    count = max(1, round((t[-1] - t[0]) / PIECE))
    total = 0.0
    for part in np.array_split(np.arange(len(t)), count):
        left = y[part] - combined(phi[part], solve(phi[part], y[part]))
        total += square(left)
    return total


def best_delay(m: Motion, terms: tuple[str, ...], low: float, high: float, step: float) -> float:
    """The delay [s] of the input, of a grid, at which it explains most."""
    grid = np.arange(low, high + 0.5 * step, step)
    return float(grid[int(np.argmin([left_square(m, terms, m.at(d)) for d in grid]))])


def held_out(m: Motion, terms: tuple[str, ...], delay: float) -> float:
    """Share of the variance of the last part's increments that the first part's fit predicts; 0 of too short a log."""
    t, y, phi = columns(m, terms, m.at(delay))
    split = m.t[0] + (1.0 - HELD_OUT) * (m.t[-1] - m.t[0])
    first, last = t < split, t >= split
    if np.count_nonzero(first) <= phi.shape[1] or np.count_nonzero(last) < 5 * m.span:
        return 0.0
    e, s = y[last] - combined(phi[last], solve(phi[first], y[first])), y[last] - y[last].mean()
    e = e - e.mean()  # a trim that is another one is no contradiction
    return 1.0 - square(e) / square(s) if square(s) > 0.0 else 0.0
