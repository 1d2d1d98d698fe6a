"""A controller as a linear law of attitude and rate: its transfer functions, its gains, the same law with other gains.

    command = N_theta(w)/D(w) (theta - theta_ref) + N_rate(w)/D(w) (theta_dot - rate_ref),   w = z - 1

Polynomials are in w, the delta operator (Middleton and Goodwin, Digital Control and Estimation, 1990), powers falling:
poles and zeros of a controller crowd around z = 1, where polynomials in z lose half of their digits.

Gains are those that the law has at low frequency, where every PD, PID and lead is alike: with s = 0 on,
command = ki/s + kp + kd s; an integral is the simulator's, by backward Euler: ki T z/(z - 1).
"""

import math
from dataclasses import dataclass

import numpy as np

from sim.nominal import Controller

INTEGRAL = 1e-7   # of the sum of |coefficients|: a D(0) below it is that of an integral


@dataclass(frozen=True, eq=False)
class Law:
    """A linear law, or m of them.

    theta, rate   (n + 1,) or (m, n + 1)  numerators of attitude and of rate [s]
    lag           the same shape  the common denominator
    period        s
    """

    theta: np.ndarray
    rate: np.ndarray
    lag: np.ndarray
    period: float

    @property
    def is_of_rate(self) -> bool:
        """Whether the law answers the rate alone."""
        return not np.any(self.theta) and bool(np.any(self.rate))

    @property
    def has_integral(self) -> bool:
        """Whether the law remembers what it answered for ever: a pole at z = 1."""
        return bool(np.all(np.abs(self.lag[..., -1]) <= INTEGRAL * np.abs(self.lag).sum(axis=-1)))

    def at(self, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the law's responses (p,) to attitude and rate at w (p,) = exp(i omega T) - 1; of one law."""
        lag = np.polyval(self.lag, w)
        return np.polyval(self.theta, w) / lag, np.polyval(self.rate, w) / lag

    def gains(self) -> dict[str, float]:
        """Return kp, kd [s] and, of a law with an integral, ki [1/s]; of a law of the rate alone kp [s] and ki [1]."""
        own = self.rate if self.is_of_rate else self.theta
        integral, kp, slope = _expanded(own, self.lag, self.period, self.has_integral)
        found = {"kp": float(kp)}
        if not self.is_of_rate:
            found["kd"] = float(slope + _expanded(self.rate, self.lag, self.period, self.has_integral)[1])
        return found | ({"ki": float(integral)} if self.has_integral else {})

    def scaled(self, kp: float = 1.0, kd: float = 1.0) -> "Law":
        """Return the law, or laws, with kp times what it answers to an attitude that stands, integral included, and kd
        times the rest: the gyro's path, or without one what it makes of the attitude's changes.

        Of a law of the rate alone kp is a factor on all of it.
        """
        if kp == 1.0 and kd == 1.0:
            return self
        if self.is_of_rate:
            return Law(self.theta, kp * self.rate, self.lag, self.period)
        if np.any(self.rate):
            return Law(kp * self.theta, kd * self.rate, self.lag, self.period)
        integral, gain, _ = (x[..., None] for x in _expanded(self.theta, self.lag, self.period, self.has_integral))
        standing = gain * self.lag
        if self.has_integral:   # ki T (w + 1)/w over the common denominator w D'
            without = self.lag[..., :-1]
            none = np.zeros_like(without[..., :1])
            standing = standing + integral * self.period * (np.concatenate([without, none], axis=-1)
                                                            + np.concatenate([none, without], axis=-1))
        return Law(kp * standing + kd * (self.theta - standing), self.rate, self.lag, self.period)

    def times(self, gain: float) -> "Law":
        """Return the law with `gain` times its commands."""
        return self if gain == 1.0 else Law(gain * self.theta, gain * self.rate, self.lag, self.period)


def _expanded(top: np.ndarray, lag: np.ndarray, period: float,
              has_integral: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return ki, kp, kd (...) of top(w)/lag(w) = ki/s + kp + kd s at low frequency, the integral by backward Euler."""
    residue = np.zeros(top.shape[:-1])
    if has_integral:
        lag = lag[..., :-1]
        residue = top[..., -1] / lag[..., -1]
        none = np.zeros_like(lag[..., :1])
        top = (top - residue[..., None] * np.concatenate([none, lag], axis=-1))[..., :-1]
    none = np.zeros((*top.shape[:-1], 1))
    top, lag = (np.concatenate([none, x], axis=-1)[..., -2:] for x in (top, lag))
    gain = top[..., 1] / lag[..., 1]
    slope = period * (top[..., 0] * lag[..., 1] - top[..., 1] * lag[..., 0]) / lag[..., 1] ** 2
    return residue / period, gain - residue, slope


def law_of(controller: Controller, kp: float | None = None, kd: float | None = None, late: float = 0.0) -> Law:
    """Return the law of a nominal's controller, its filters in it.

    kp, kd  [s] replace the controller's gains;  late  periods of computing time, a fraction as the mean over a period
    """
    kp, kd = controller.kp if kp is None else kp, controller.kd if kd is None else kd
    period, rate = controller.period, np.zeros(1)   # numerator of the rate, of a law that reads attitude and rate
    if controller.law == "gyro":
        top, rate, bottom = np.array([kp]), np.array([kd]), np.array([1.0])
    elif controller.is_rate_law:
        step = controller.ki * period
        top, bottom = np.array([kp + step, step]), np.array([1.0, 0.0])
        if step == 0.0:
            top, bottom = np.array([kp]), np.array([1.0])
    else:
        lag = controller.derivative_time_constant + period
        top, bottom = np.array([kp * lag + kd, kp * period]), np.array([lag, period])
    for section in controller.filters:
        top, rate, bottom = (np.convolve(x, delta(of)) for x, of in ((top, section.b), (rate, section.b),
                                                                     (bottom, section.a)))
    whole, part = int(late), late - int(late)
    if late > 0.0:
        waits = (*(0.0,) * whole, 1.0 - part, part) if part > 0.0 else (*(0.0,) * whole, 1.0)
        top, rate, bottom = (np.convolve(x, delta(of)) for x, of in ((top, waits), (rate, waits), (
            bottom, (1.0, *(0.0,) * (len(waits) - 1)))))
    none = np.zeros_like(top)
    if controller.is_rate_law:
        return Law(none, top, bottom, period)
    return Law(top, rate if controller.law == "gyro" else none, bottom, period)


def delta(coefficients: tuple[float, ...] | np.ndarray) -> np.ndarray:
    """Return polynomials in w = z - 1 (..., n + 1) from coefficients of 1, z^-1, ..., z^-n times z^n: Taylor's
    shift."""
    return np.asarray(coefficients, dtype=float) @ shift(np.shape(coefficients)[-1])


def shift(count: int) -> np.ndarray:
    """Return the matrix (count, count) that takes coefficients of falling powers of z to falling powers of z - 1."""
    n = count - 1
    matrix = np.zeros((count, count))
    for i in range(count):            # z^(n - i) = (w + 1)^(n - i)
        for j in range(i, count):     # its w^(n - j)
            matrix[i, j] = math.comb(n - i, n - j)
    return matrix
