"""Fit a log in weak form: first numbers for the search of a model, and the share of held-out rows predicted.

It needs no noise level and no start.
"""

import math

import numpy as np

from ..judge.terms import INCREMENT
from ..series import filled
from ..sums import combined, least_squares, square
from ..weakform.late import acting_later
from ..weakform.modes import increments
from ..weakform.noise import with_noise_levels
from ..weakform.prepare import LONGEST_ROW_STEP
from ..weakform.rows import SLOPE_SPAN, Rows, slope
from .channels import Channels
from .model import BY_COMMAND, BY_MEASUREMENT, Model, command

TRIM_PIECE = 10.0      # s over which one set of coefficients and one trim hold
HELD_OUT_SHARE = 0.4   # the last part of the log
MIN_INCREMENTS = 5     # increments without overlap in it


def motion(c: Channels, source_is_beta: bool) -> Rows:
    """Return rows of the weak form, the input as beta; a missing rate is theta's slope, a missing theta its
    integral."""
    u = filled(c.beta if source_is_beta else command(c), c.t)
    rate = filled(c.theta_dot, c.t) if c.has("theta_dot") else np.zeros(0)
    if c.has("theta"):
        theta = filled(c.theta, c.t)
        rate = rate if len(rate) else slope(c.t, theta, max(1, round(SLOPE_SPAN / c.period)))
    else:
        theta = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(c.t) * (rate[1:] + rate[:-1]))])
        theta = theta - theta.mean()
    step = np.diff(c.t)
    cuts = np.flatnonzero(step > LONGEST_ROW_STEP * np.median(step)) + 1
    return with_noise_levels(Rows(c.t, theta, c.gamma, rate, u, c.has("theta_dot"), bool(np.any(c.gamma != 0.0)),
                                  np.concatenate([[0], cuts, [len(c.t)]])))


def acting(rows: Rows, model: Model) -> np.ndarray:
    """Return beta (n,) [rad] of the rows as it acts in the model: after its delay and a servo that no sensor shows.

    By the servo's frequency response on an even grid; the first value holds before the log.
    """
    source, numbers = model.source, model.numbers
    if model.no_input or (source == BY_COMMAND and "r_beta" in numbers):
        return rows.beta
    held = 0.0 if source == BY_MEASUREMENT else 0.5 * rows.period   # lines between rows are half a step early
    t = np.arange(rows.t[0], rows.t[-1] + rows.period, rows.period)
    u = np.interp(t, rows.t, rows.beta)
    s = 2j * np.pi * np.fft.rfftfreq(2 * len(t), rows.period)
    response = np.exp(-s * (numbers["delay"] + held))
    if source == BY_COMMAND:
        w, zeta = numbers["servo"], numbers["damping"]
        response = response / (1.0 + 2.0 * zeta * s / w + (s / w) ** 2)
    moved = np.fft.irfft(np.fft.rfft(u - u[0], 2 * len(t)) * response, 2 * len(t))[:len(t)]
    return np.asarray(u[0] + np.interp(rows.t, t, moved))


def columns(rows: Rows, terms: tuple[str, ...], delay: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return middle times (k,), increments of the rate (k,), integrals (k, n) of the terms, the constant first."""
    begin, end, y, phi = increments(acting_later(rows, delay, 0.0), ("1", *terms), INCREMENT)
    return 0.5 * (begin + end), y, phi


def solve(phi: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the least-squares coefficients (n,) of y (k,) on phi (k, n), columns scaled to one size."""
    scale = np.sqrt(np.mean(phi**2, axis=0)) + 1e-300
    return least_squares(phi / scale, y, 1e-9) / scale


def best_delay(rows: Rows, terms: tuple[str, ...], low: float, high: float, step: float) -> float:
    """Return the input delay [s] of a grid (low, high, step) whose fits over pieces of TRIM_PIECE leave least."""
    def left(delay: float) -> float:
        t, y, phi = columns(rows, terms, delay)
        parts = np.array_split(np.arange(len(t)), max(1, round((t[-1] - t[0]) / TRIM_PIECE))) if len(t) else []
        return sum(square(y[part] - combined(phi[part], solve(phi[part], y[part]))) for part in parts)

    grid = np.arange(low, high + 0.5 * step, step)
    return float(grid[int(np.argmin([left(delay) for delay in grid.tolist()]))])


def held_out(rows: Rows, terms: tuple[str, ...], delay: float) -> float:
    """Return the share of variance of the last part's increments that the first part's fit predicts; 0: too short."""
    t, y, phi = columns(rows, terms, delay)
    split = rows.t[0] + (1.0 - HELD_OUT_SHARE) * (rows.t[-1] - rows.t[0])
    first, last = t < split, t >= split
    if np.count_nonzero(first) <= phi.shape[1] or np.count_nonzero(last) < math.ceil(MIN_INCREMENTS
                                                                                     * INCREMENT / rows.period):
        return 0.0
    e, s = y[last] - combined(phi[last], solve(phi[first], y[first])), y[last] - y[last].mean()
    e = e - e.mean()  # a trim that is another one is no contradiction
    return 1.0 - square(e) / square(s) if square(s) > 0.0 else 0.0
