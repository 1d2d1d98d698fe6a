"""Many frozen loops at once, as rational functions: each its own a6, k1, servo, transport delay, damping and law.

The loop of `lft`, cut at the controller's output, with the same hold, sampling and delay, and as exact:

    L(z) = -z^-whole (C_theta(z) P_theta(z) + C_rate(z) P_rate(z)),    P = P_new(z) + P_old(z)/z,    C: `controller.law`

A command waits `whole` periods and a fraction of one: P_new is what it moves in the rest of the period that it arrives
in, P_old what the one before has moved until then.  Both are c (w I - D)^-1 b, D = exp(A T) - I, with numerator and
denominator by Faddeev's recursion (Gantmacher, The Theory of Matrices, 1959, ch. IV.5).  They are polynomials in w, the
delta operator (Middleton and Goodwin, Digital Control and Estimation, 1990), because the slow poles crowd around z = 1,
where those in z lose half of their digits.

Why beside `lft`: a thousand loops cost as much here as ten there, and neither servo nor delay is an uncertainty there.

Assumptions: rigid launcher with damping of its rate, servo of second or first order, modes of slosh and bending that
are known, any linear law of attitude and rate, all frozen.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sim.nominal import Controller

from ..controller.law import Law, law_of
from .lft import WHOLE_PERIOD, exponential


class Mode(NamedTuple):
    """A mode of slosh (psi'' + 2 z w psi' + w^2 psi = -theta_ddot, theta_ddot += size w^2 psi) or of bending
    (eta'' + 2 z w eta' + w^2 eta = size w^2 beta; the attitude's sensor sees eta, the gyro `at_rate` eta')."""

    name: str                       # slosh1, bending1, ...
    frequency: np.ndarray | float   # rad/s, of all plants or of each (m,), as the next
    damping: np.ndarray | float     # its damping ratio
    size: np.ndarray | float        # coupling of slosh; gain of bending at the attitude's sensor [rad/rad]
    at_theta: float = 1.0           # of bending: 0 if the attitude's sensor does not see it
    at_rate: float = 1.0            # of bending: gain at the gyro over that at the attitude's sensor

    @property
    def is_bending(self) -> bool:
        return self.name.startswith("bending")


class Plants(NamedTuple):
    """m plants, arrays (m,): a6, k1 [1/s^2]; servo frequency [rad/s], damping ratio, transport delay [s], at least 0.

    rate_damping   [1/s], (m,) or one number: theta_ddot = a6 theta + k1 beta - rate_damping theta_dot
    is_first_order  the servo is beta_dot = frequency (u - beta), its damping ratio unused
    """

    a6: np.ndarray         # 1/s^2
    k1: np.ndarray         # 1/s^2
    frequency: np.ndarray  # rad/s, of the servo
    damping: np.ndarray    # its damping ratio
    delay: np.ndarray      # s, at least 0
    rate_damping: np.ndarray | float = 0.0
    is_first_order: bool = False
    modes: tuple[Mode, ...] = ()


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
    peaks: tuple[float, ...] = ()  # rad/s, frequencies of modes

    def take(self, index: np.ndarray) -> "Loops":
        """Return those of the m loops that `index` selects."""
        def of(x: np.ndarray) -> np.ndarray:
            return x if len(x) == 1 else x[index]

        return Loops(self.moved_theta[index], self.moved_rate[index], self.poles[index], self.whole[index],
                     self.static[index], of(self.law_theta), of(self.law_rate), of(self.lag), self.period, self.peaks)

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
    flow, sensed = _flow(plants)
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
    static = _static(plants, law)
    if law.is_of_rate and law.has_integral:   # the sum of the rate is the attitude: its pole and the rate's zero part
        moved[1], lag = moved[1][:, :-1], lag[:, :-1]
    return Loops(moved[0], moved[1], poles, whole.astype(np.int64), static, law_theta, law_rate, lag, period,
                 tuple(float(np.median(mode.frequency)) for mode in plants.modes))


def _static(plants: Plants, law: Law) -> np.ndarray:
    """Return the factor (m,) on the gain at which a nozzle that stands no longer holds the aerodynamic moment: 1 + g L
    = 0 at z = 1."""
    if law.is_of_rate and not law.has_integral:
        return np.full(len(plants.a6), np.nan)   # nothing answers an attitude that stands
    lag = np.atleast_2d(law.lag)[:, -1]
    top = np.atleast_2d(law.rate if law.is_of_rate else law.theta)[:, -1]
    with np.errstate(divide="ignore", invalid="ignore"):
        if law.is_of_rate:
            kp = top / (np.atleast_2d(law.lag)[:, -2] * law.period)
        else:
            kp = np.where(law.has_integral, np.inf, top / lag)
        bend = sum(mode.size * mode.at_theta for mode in plants.modes if mode.is_bending) * (not law.is_of_rate)
        return np.asarray(-plants.a6 / (kp * plants.k1 * (1.0 - bend * plants.a6 / plants.k1)))


def _flow(plants: Plants) -> tuple[np.ndarray, np.ndarray]:
    """Return the derivative (m, n + 1, n + 1) of theta, theta_dot, beta, (beta_dot/w,) modes (x, x_dot) and the servo's
    input, which is held; and (2, n) what the sensors of attitude and rate see of the n states."""
    servo = 1 if plants.is_first_order else 2
    n, m = 2 + servo + 2 * len(plants.modes), len(plants.a6)
    flow, sensed = np.zeros((m, n + 1, n + 1)), np.zeros((2, n))
    sensed[0, 0] = sensed[1, 1] = 1.0
    flow[:, 0, 1] = 1.0
    flow[:, 1, 0], flow[:, 1, 2] = plants.a6, plants.k1
    flow[:, 1, 1] = -np.asarray(plants.rate_damping)
    w = plants.frequency
    if plants.is_first_order:
        flow[:, 2, 2], flow[:, 2, n] = -w, w
    else:
        flow[:, 2, 3] = flow[:, 3, n] = w
        flow[:, 3, 2], flow[:, 3, 3] = -w, -2.0 * plants.damping * w
    for k, mode in enumerate(plants.modes):
        x, v = 2 + servo + 2 * k, 3 + servo + 2 * k
        stiffness = np.square(mode.frequency)
        flow[:, x, v], flow[:, v, x], flow[:, v, v] = 1.0, -stiffness, -2.0 * mode.damping * mode.frequency
        if mode.is_bending:
            flow[:, v, 2] = mode.size * stiffness
            sensed[0, x], sensed[1, v] = mode.at_theta, mode.at_rate
        else:
            flow[:, 1, x] = mode.size * stiffness
    for k, mode in enumerate(plants.modes):
        if not mode.is_bending:   # driven by the acceleration, with all that is in it
            flow[:, 3 + servo + 2 * k] -= flow[:, 1]
    return flow, sensed


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


def plants_of(parameters: np.ndarray, is_first_order: bool = False, modes: tuple[Mode, ...] = ()) -> Plants:
    """Return plants from rows (m, 5 or more) of a6, k1, natural frequency, damping ratio, delay, rate damping, and
    frequency and size of each of `modes`, which has its other numbers; a delay below 0 becomes 0."""
    a6, k1, frequency, damping, delay = parameters.T[:5]
    rate_damping = parameters[:, 5] if parameters.shape[1] > 5 else 0.0
    modes = tuple(mode._replace(frequency=parameters[:, 6 + 2 * k], size=parameters[:, 7 + 2 * k])
                  for k, mode in enumerate(modes))
    return Plants(a6, k1, frequency, damping, np.maximum(delay, 0.0), rate_damping, is_first_order, modes)
