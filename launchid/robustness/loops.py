"""Many frozen loops of one controller at once, as rational functions: each its own a6, k1, servo and transport delay.

The loop of `lft`, cut at the controller's output, with the same hold, sampling and delay, and as exact:

    L(z) = -C(z) z^-whole (P_new(z) + P_old(z)/z),    C = kp + kd w/((tau + T) w + T),    w = z - 1

A command waits `whole` periods and a fraction of one: P_new is what it moves in the rest of the period that it arrives
in, P_old what the one before has moved until then.  Both are c (w I - D)^-1 b, D = exp(A T) - I, with numerator and
denominator by Faddeev's recursion (Gantmacher, The Theory of Matrices, 1959, ch. IV.5).  They are polynomials in w, the
delta operator (Middleton and Goodwin, Digital Control and Estimation, 1990), because the slow poles crowd around z = 1,
where those in z lose half of their digits.

Why beside `lft`: a thousand loops cost as much here as ten there, and neither servo nor delay is an uncertainty there.

Assumptions: those of `lft`: rigid launcher, second-order servo, PD of the attitude, all frozen.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sim.nominal import Controller

from .lft import WHOLE_PERIOD, exponential

N_PLANT = 4   # theta, theta_dot, beta, beta_dot/w


class Plants(NamedTuple):
    """m plants, arrays (m,): a6, k1 [1/s^2]; servo frequency [rad/s], damping ratio, transport delay [s], at least
    0."""

    a6: np.ndarray         # 1/s^2
    k1: np.ndarray         # 1/s^2
    frequency: np.ndarray  # rad/s, of the servo
    damping: np.ndarray    # its damping ratio
    delay: np.ndarray      # s, at least 0


@dataclass(frozen=True, eq=False)
class Loops:
    """m sampled loops as rational functions of w = z - 1 (coefficients of falling powers): moved/poles (m, 5) the
    plant, law/lag (2,) the controller, `whole` periods of delay; static = gain factor at which the loop is lost at z =
    1."""

    moved: np.ndarray        # (m, 5) P_new z + P_old, numerator
    poles: np.ndarray        # (m, 5) its denominator
    whole: np.ndarray        # (m,) int64, whole periods of delay
    static: np.ndarray       # (m,) the factor on the gain at which the nozzle no longer holds the aerodynamic moment
    law: np.ndarray          # (2,) numerator of the controller
    lag: np.ndarray          # (2,) its denominator
    period: float            # s

    def take(self, index: np.ndarray) -> "Loops":
        """Return those of the m loops that `index` selects."""
        return Loops(self.moved[index], self.poles[index], self.whole[index], self.static[index], self.law, self.lag,
                     self.period)

    def gain(self, omega: np.ndarray) -> np.ndarray:
        """Return the loop gain L(exp(i omega T)) (m, p) at omega (p,) or (m, p) [rad/s]."""
        half = 0.5 * self.period * omega
        w = 2j * np.sin(half) * np.exp(1j * half)
        if np.ptp(self.whole) == 0:
            late = np.exp(-2j * half * (float(self.whole[0]) + 1.0))
        else:
            late = np.exp(-2j * half * (self.whole[:, None] + 1.0))
        controller = (self.law[0] * w + self.law[1]) / (self.lag[0] * w + self.lag[1]) * late
        return -controller * _at(self.moved, w) / _at(self.poles, w)

    def stable(self) -> np.ndarray:
        """Return whether all roots of each closed loop (m,) are inside the unit circle."""
        longest = int(np.max(self.whole))
        top = _times(self.moved, self.law)
        closed = _times(self.poles, self.lag)
        for _ in range(longest + 1):
            closed = _times(closed, np.ones(2))
        for k in range(longest + 1):
            # a shorter delay than the longest: as many roots more in z = 0 on both sides
            top = np.where((k < longest - self.whole)[:, None], _times(top, np.ones(2)),
                           _times(top, np.array([0.0, 1.0])))
        closed[:, -top.shape[1]:] -= top
        n = closed.shape[1] - 1
        companion = np.zeros((len(closed), n, n))
        companion[:, 0] = -closed[:, 1:] / closed[:, :1]
        companion[:, np.arange(1, n), np.arange(n - 1)] = 1.0
        return np.abs(1.0 + np.linalg.eigvals(companion)).max(axis=1) < 1.0


def _at(polynomial: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Return values (m, p) of polynomials (m, n), falling powers, at w (p,) or (m, p)."""
    value = polynomial[:, :1] * np.ones_like(w)
    for k in range(1, polynomial.shape[1]):
        value *= w
        value += polynomial[:, k:k + 1]
    return value


def _times(polynomial: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Return products (m, n + 1) of polynomials (m, n) with one of first degree (2,)."""
    product = np.zeros((len(polynomial), polynomial.shape[1] + 1))
    product[:, :-1] = by[0] * polynomial
    product[:, 1:] += by[1] * polynomial
    return product


def loops(plants: Plants, controller: Controller, kp: float | None = None, kd: float | None = None) -> Loops:
    """Return the loops of m plants with a controller, exactly sampled; kp, kd [s] replace the controller's gains."""
    kp, kd = controller.kp if kp is None else kp, controller.kd if kd is None else kd
    period, lag = controller.period, controller.derivative_time_constant + controller.period
    whole = np.floor(plants.delay / period + WHOLE_PERIOD)
    fraction = np.maximum(plants.delay - whole * period, 0.0)
    flow = _flow(plants)
    late, early = (exponential(flow * h[:, None, None]) for h in (period - fraction, fraction))
    move, n = late[:, :N_PLANT, :N_PLANT], N_PLANT
    newer = late[:, :n, n]
    older = np.einsum("mij,mj->mi", move, early[:, :n, n])
    adjugate, poles = faddeev(move @ early[:, :n, :n] - np.eye(n))
    with np.errstate(divide="ignore", invalid="ignore"):
        static = -plants.a6 / (kp * plants.k1)
    moved = _times(np.einsum("kmj,mj->mk", adjugate, newer), np.ones(2))
    moved[:, 1:] += np.einsum("kmj,mj->mk", adjugate, older)
    return Loops(moved, poles, whole.astype(np.int64), static, np.array([kp * lag + kd, kp * period]),
                 np.array([lag, period]), period)


def _flow(plants: Plants) -> np.ndarray:
    """Return (m, 5, 5): derivative of theta, theta_dot, beta, beta_dot/w and the servo's input, which is held."""
    flow = np.zeros((len(plants.a6), N_PLANT + 1, N_PLANT + 1))
    flow[:, 0, 1] = 1.0
    flow[:, 1, 0], flow[:, 1, 2] = plants.a6, plants.k1
    flow[:, 2, 3] = flow[:, 3, 4] = plants.frequency
    flow[:, 3, 2], flow[:, 3, 3] = -plants.frequency, -2.0 * plants.damping * plants.frequency
    return flow


def faddeev(d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the first row of the adjugate of w I - d (n, m, n) and its determinant (m, n + 1), polynomials in w.

    d (m, n, n);  powers fall: along the first axis of the row, along the last of the determinant
    """
    n = d.shape[1]
    rows, determinant = [], [np.ones(len(d))]
    matrix = np.broadcast_to(np.eye(n), d.shape)
    for k in range(1, n + 1):
        rows.append(matrix[:, 0])
        product = d @ matrix
        determinant.append(-np.trace(product, axis1=1, axis2=2) / k)
        matrix = product + determinant[-1][:, None, None] * np.eye(n)
    return np.stack(rows), np.stack(determinant, axis=1)


def plants_of(parameters: np.ndarray) -> Plants:
    """Return plants from rows (m, 5) of a6, k1, natural frequency, damping ratio, delay; a delay below 0 becomes 0."""
    a6, k1, frequency, damping, delay = parameters.T
    return Plants(a6, k1, frequency, damping, np.maximum(delay, 0.0))

