"""Fit the scale of a gyro and its lag behind the attitude, from theta and theta_dot alone.

A gyro of scale s behind a lag T measures g, T g' + g = s theta_dot (of a delay T nearly the same), so that

    theta = c + (integral of g + T g)/s + b t + n,     c wanders by the integral of the gyro's noise, n is theta's noise

whatever the vehicle does. The filter (1 - q)/(1 - (1 - K) q), q a row's delay, makes the rest white; it looks at
earlier rows alone, as a controller answers n in later ones, and a regression that sees both takes the answer for a lag
(Ljung, System Identification, 1999, 13.4: prediction errors under feedback). K is that with the least rest.
A negative lag is one of the attitude.
"""

import math
from typing import NamedTuple

import numpy as np

from ..series import white_variance
from ..sums import along, combined, least_squares, products, square
from .relations import filtered
from .slope import Columns, integral

GAINS = np.geomspace(0.002, 0.5, 9)  # K of the filter, that are tried
PIECE = 5.0            # s, over which a6 and k1 are constant
FEWEST_ROWS_LATE = 1.5   # rows of a lag, that a delay differs from
CLEARLY = 0.06         # of what either shape explains, that the rarer one, a delay, must explain more
FADED = 1e-3           # of a filter's answer, that may be cut off
FEWEST_ROWS = 500      # less tell no lag
SEGMENTS = 20          # of the rows, whose scatter gives the standard deviations, if that is more than white noise's
ONE_GYRO = 0.3         # of the variance of theta's filtered changes, that theta_dot must explain
MOST_NOISE = 3.0       # times the noise of theta: more that is left is no gyro of one scale and lag


class Gyro(NamedTuple):
    """Scale of theta_dot over the slope of theta, lag [s] of theta_dot behind theta, and their deviations."""

    scale: float
    scale_std: float
    lag: float
    lag_std: float


def gyro_of(columns: Columns, period: float, known: np.ndarray) -> Gyro | None:
    """Return the gyro that theta and theta_dot show; None if they are too few, at rest, or of more than one gyro.

    columns  on a grid of rows `period` [s] apart;  known (n,) bool  both were measured there
    """
    if not {"theta", "theta_dot"} <= set(columns) or np.count_nonzero(known) < FEWEST_ROWS:
        return None
    theta, rate = columns["theta"], columns["theta_dot"]
    parts = [theta, integral(rate, period), rate, period * np.arange(len(rate))]
    best, rate_noise = None, white_variance(rate[known])
    for gain in GAINS.tolist():
        y, *columns_of = (_innovations(x - x[0], gain) for x in parts)
        rows = known.copy()
        rows[:1] = False
        design, wanted = np.column_stack(columns_of)[rows], y[rows]
        size = np.sqrt(np.maximum(np.sum(design**2, axis=0), 1e-300))
        walked = 0.25 + (1.0 - 0.5 * gain)**2 / (1.0 - (1.0 - gain)**2)   # of the integral of noise, filtered
        noisy = len(wanted) * rate_noise * np.array([period**2 * walked, 1.0, 0.0])
        taken = np.diag(noisy) / np.outer(size, size)   # errors in variables
        x = least_squares(products(design / size, design / size) - taken, along(design / size, wanted), 1e-10) / size
        rest = wanted - combined(design, x)
        if best is None or square(rest) < square(best[2]):
            best = x, design, rest, wanted
    if best is None:
        return None
    x, design, rest, wanted = best
    noise = white_variance(theta[known])
    left, total = square(rest) / len(rest), square(wanted - wanted.mean()) / len(rest)
    if not (total > 0.0 and 1.0 - left / total > ONE_GYRO and x[0] > 0.0) or left > MOST_NOISE**2 * noise:
        return None
    inverse = np.linalg.pinv(products(design, design), 1e-12, hermitian=True)
    scores = np.array([along(a, b) for a, b in zip(np.array_split(design, SEGMENTS), np.array_split(rest, SEGMENTS),
                                                   strict=True)])
    scattered = inverse @ products(scores, scores) @ inverse * SEGMENTS / (SEGMENTS - 1.0)
    std = np.sqrt(np.maximum(np.diag(inverse) * left, np.diag(scattered)))
    return Gyro(1.0 / float(x[0]), float(std[0] / x[0]**2), float(x[1] / x[0]), float(std[1] / x[0]))


def _innovations(x: np.ndarray, gain: float) -> np.ndarray:
    """Return (1 - q)/(1 - (1 - gain) q) x (n,), q a row's delay."""
    count = min(len(x), math.ceil(math.log(FADED) / math.log(1.0 - gain)) + 1)
    before = np.concatenate([[0.0], gain * (1.0 - gain) ** np.arange(count - 1)])
    return np.asarray(x - filtered(x, before)) if count > 1 else x


def is_delayed(columns: Columns, period: float, known: np.ndarray, lag: float) -> bool:
    """Whether a gyro that is `lag` [s] behind is so by a delay, and not by a lag of first order.

    theta_dot is the integral of a6 theta + k1 beta, and so of both behind the same lag or delay: the one that leaves
    less in pieces of PIECE s, each with its own a6, k1 and constant, is the gyro's.
    """
    if not {"theta", "theta_dot", "beta"} <= set(columns) or lag < FEWEST_ROWS_LATE * period:
        return False
    rate, t = columns["theta_dot"], period * np.arange(len(known))
    count = math.ceil(-lag / period * math.log(FADED)) + 1
    edges = np.exp(-period / lag * np.arange(count + 1))
    response = -np.diff(edges)
    steady = {name: 0.5 * (columns[name] + np.concatenate([columns[name][:1], columns[name][:-1]]))
              for name in ("theta", "beta")}

    def rest(gain: float, shape: str) -> float:
        acting = [columns[name] if shape == "none" else np.interp(t - lag, t, columns[name]) if shape == "delay" else
                  filtered(x, response) for name, x in steady.items()]
        y, *parts = (_innovations(x - x[0], gain) for x in (rate, *(integral(x, period) for x in acting), t))
        left = 0.0
        for rows in np.array_split(np.flatnonzero(known), max(1, round(len(known) * period / PIECE))):
            design = np.column_stack([part[rows] for part in parts])
            size = np.sqrt(np.maximum(np.sum(design**2, axis=0), 1e-300))
            left += square(y[rows] - combined(design / size, least_squares(design / size, y[rows], 1e-10)))
        return left

    gain = min(GAINS.tolist(), key=lambda gain: rest(gain, "lag"))
    at_once, lagging, delayed = (rest(gain, shape) for shape in ("none", "lag", "delay"))
    return lagging - delayed > CLEARLY * (at_once - delayed)


def without_lag(t: np.ndarray, x: np.ndarray, lag: float, is_delay: bool) -> np.ndarray:
    """Return x (n,) at stamps t (n,) [s] less a lag [s] of first order: x + lag x'; less a delay: lag^2 x''/2 more.

    Slope and curvature reach over as many rows as add to the noise of x no more than half of itself.
    """
    rows = max(1, math.ceil(math.sqrt(2.0) * abs(lag) / float(np.median(np.diff(t)))))
    at = np.arange(len(t))
    before, after = np.maximum(at - rows, 0), np.minimum(at + rows, len(t) - 1)
    ahead, behind = (np.divide(x[b] - x[a], t[b] - t[a], out=np.zeros(len(t)), where=t[b] > t[a])
                     for a, b in ((at, after), (before, at)))
    curvature = 2.0 * (ahead - behind) / (t[after] - t[before]) * ((before < at) & (at < after))
    return np.asarray(x + lag * (x[after] - x[before]) / (t[after] - t[before]) + 0.5 * lag**2 * curvature * is_delay)
