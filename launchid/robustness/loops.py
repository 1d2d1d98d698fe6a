"""Many frozen loops at once, as rational functions: each its own a6, k1, servo, transport delay, damping and law.

The loop of `lft`, cut at the controller's output, with the same hold, sampling and delay, and as exact:

    L(z) = -z^-whole (C_theta(z) P_theta(z) + C_rate(z) P_rate(z)),    P = P_new(z) + P_old(z)/z,    C: `controller.law`

A command waits `whole` periods and a fraction of one: P_new is what it moves in the rest of the period that it arrives
in, P_old what the one before has moved until then.  Both are c (w I - D)^-1 b, D = exp(A T) - I, with numerator and
denominator by Faddeev's recursion (Gantmacher, The Theory of Matrices, 1959, ch. IV.5).  They are polynomials in w, the
delta operator (Middleton and Goodwin, Digital Control and Estimation, 1990), because the slow poles crowd around z = 1,
where those in z lose half of their digits.

Why beside `lft`: a thousand loops cost as much here as ten there, and neither servo nor delay is an uncertainty there.

Assumptions: the plants of `blocks`, any linear law of attitude and rate, all frozen.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.nominal import Controller

from ..controller.law import Law, law_of
from .blocks import Plants, centres_of, flow_of, peaks_of, static_factor
from .lft import WHOLE_PERIOD, exponential


@dataclass(frozen=True, eq=False)
class Loops:
    """m sampled loops as rational functions of w = z - 1, coefficients of falling powers, each (m, .) or (1, .).

    law_theta, law_rate, lag  the controller;  moved_theta, moved_rate  P_new z + P_old, numerators of what the sensors
    of attitude and rate see;  poles  the plant's denominator
    """

    moved_theta: np.ndarray  # (m, n + 1)
    moved_rate: np.ndarray   # (m, n + 1)
    poles: np.ndarray        # (m, n + 1)
    whole: np.ndarray        # (m,) int64, whole periods of delay
    static: np.ndarray       # (m,) the factor on the gain at which the nozzle no longer holds the aerodynamic moment
    law_theta: np.ndarray
    law_rate: np.ndarray
    lag: np.ndarray
    period: float            # s
    peaks: tuple[float, ...] = ()  # rad/s, frequencies of modes and of pits of the law, the middle loop's
    centres: np.ndarray | None = None   # (m, k) rad/s, those of each loop's k modes

    def take(self, index: np.ndarray) -> "Loops":
        """Return those of the m loops that `index` selects."""
        def of(x: np.ndarray) -> np.ndarray:
            return x if len(x) == 1 else x[index]

        return Loops(self.moved_theta[index], self.moved_rate[index], self.poles[index], self.whole[index],
                     self.static[index], of(self.law_theta), of(self.law_rate), of(self.lag), self.period, self.peaks,
                     None if self.centres is None else self.centres[index])

    def gain(self, omega: np.ndarray) -> np.ndarray:
        """Return the loop gain L(exp(i omega T)) (m, p) at omega (p,) or (m, p) [rad/s]."""
        half = 0.5 * self.period * omega
        w = 2j * np.sin(half) * np.exp(1j * half)
        if np.ptp(self.whole) == 0:
            late = np.exp(-2j * half * (float(self.whole[0]) + 1.0))
        else:
            late = np.exp(-2j * half * (self.whole[:, None] + 1.0))
        lag, total = _at(self.lag, w), 0.0
        for law, moved in ((self.law_theta, self.moved_theta), (self.law_rate, self.moved_rate)):
            if np.any(law):
                total = total - _at(law, w) / lag * late * _at(moved, w)
        return total / _at(self.poles, w)

    def stable(self) -> np.ndarray:
        """Return whether all roots of each closed loop (m,) are inside the unit circle."""
        longest = int(np.max(self.whole))
        closed = _product(self.poles, self.lag)
        parts = [_product(moved, law) for law, moved in ((self.law_theta, self.moved_theta),
                                                         (self.law_rate, self.moved_rate)) if np.any(law)]
        top = sum(parts, np.zeros((1, 1)))
        for _ in range(longest + 1):
            closed = _product(closed, np.ones((1, 2)))
        for k in range(longest + 1):
            # a shorter delay than the longest: as many roots more in z = 0 on both sides
            top = np.where((k < longest - self.whole)[:, None], _product(top, np.ones((1, 2))),
                           _product(top, np.array([[0.0, 1.0]])))
        extra = top.shape[1] - closed.shape[1]
        if extra > 0:   # leading zeros
            top = top[:, extra:]
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
        value = value * w
        value += polynomial[:, k:k + 1]
    return value


def _product(polynomial: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Return products (m, n + k) of polynomials (m, n + 1) with others (m, k) or (1, k), falling powers."""
    product = np.zeros((len(polynomial), polynomial.shape[1] + by.shape[1] - 1))
    for k in range(by.shape[1]):
        product[:, k:k + polynomial.shape[1]] += by[:, k:k + 1] * polynomial
    return product


def loops(plants: Plants, controller: Controller | Law, kp: float | None = None, kd: float | None = None) -> Loops:
    """Return the loops of m plants with a controller, exactly sampled.

    controller  a nominal's, whose gains kp, kd [s] replace, or any law (one, or m of them)
    """
    law = controller if isinstance(controller, Law) else law_of(controller, kp, kd)
    law_theta, law_rate, lag = (np.atleast_2d(x) for x in (law.theta, law.rate, law.lag))
    period = law.period
    whole = np.floor(plants.delay / period + WHOLE_PERIOD)
    fraction = np.maximum(plants.delay - whole * period, 0.0)
    own = flow_of(plants)
    flow, sensed = own.state, own.sensed[:, :-1]
    n = sensed.shape[1]
    late, early = (exponential(flow * h[:, None, None]) for h in (period - fraction, fraction))
    move = late[:, :n, :n]
    newer = late[:, :n, n]
    older = np.einsum("mij,mj->mi", move, early[:, :n, n])
    adjugate, poles = faddeev(move @ early[:, :n, :n] - np.eye(n), sensed)
    moved = []
    for row in range(2):
        each = _product(np.einsum("kmj,mj->mk", adjugate[:, row], newer), np.ones((1, 2)))
        each[:, 1:] += np.einsum("kmj,mj->mk", adjugate[:, row], older)
        moved.append(each)
    static = static_factor(plants, law)
    if law.is_of_rate and law.has_integral:   # the sum of the rate is the attitude: its pole and the rate's zero part
        moved[1], lag = moved[1][:, :-1], lag[:, :-1]
    return Loops(moved[0], moved[1], poles, whole.astype(np.int64), static, law_theta, law_rate, lag, period,
                 peaks_of(plants, law), centres_of(plants))


def faddeev(d: np.ndarray, rows: np.ndarray | Sequence[Sequence[float]]) -> tuple[np.ndarray, np.ndarray]:
    """Return rows (r, n) times the adjugate of w I - d (n, r, m, n) and its determinant (m, n + 1), polynomials in w.

    d (m, n, n);  powers fall: along the first axis of the adjugate, along the last of the determinant
    """
    n = d.shape[1]
    found, determinant = [], [np.ones(len(d))]
    matrix = np.broadcast_to(np.eye(n), d.shape)
    for k in range(1, n + 1):
        found.append(np.einsum("ri,mij->rmj", np.asarray(rows), matrix))
        product = d @ matrix
        determinant.append(-np.trace(product, axis1=1, axis2=2) / k)
        matrix = product + determinant[-1][:, None, None] * np.eye(n)
    return np.stack(found), np.stack(determinant, axis=1)
