"""The columns of a log that the equation of motion is made of, and the input between command and nozzle."""

from dataclasses import dataclass

import numpy as np

from launchid.diagnosis.data.record import BETA, THETA, THETA_DOT, Record
from sim.sections import Actuator
from sim.vehicle.actuator import FIRST_ORDER_DAMPING, fastest_pole, free_servo
from sim.vehicle.kernels import kernel

TRUSTED = (0.3, 3.0)   # times the declared noise: what the columns themselves show is taken within it
THIRD = 20.0           # variance of a third difference of white noise over the noise's
HELD = 3               # rows: over a longer gap nothing is interpolated
MEASURED = 0.5         # of the rows, from which on a column is one

Travel = dict[str, float]  # what may be on the way: see `on_its_way`


@kernel
def moved_servo(xx, xr, rx, rr, command, beta):
    """beta (n,) [rad] of a servo that rests at first, from each held command (n,) [rad] to the next.

    xx .. rr  `free_servo` over the time between
    """
    off, rate = 0.0, 0.0
    beta[0] = command[0]
    for i in range(1, len(command)):
        off = beta[i - 1] - command[i - 1]
        beta[i] = command[i - 1] + xx * off + xr * rate
        rate = rx * off + rr * rate


@kernel
def with_play(half_width, command, out):
    """out (n,) [rad] what a play of +-half_width [rad] lets pass of a command (n,) [rad]."""
    at = command[0]
    for i in range(len(command)):
        at = min(max(at, command[i] - half_width), command[i] + half_width)
        out[i] = at


@kernel
def with_limit(most, command, out):
    """out (n,) [rad] what follows a command (n,) [rad] by at most `most` [rad] from each to the next."""
    at = command[0]
    for i in range(len(command)):
        at = min(max(command[i], at - most), at + most)
        out[i] = at


@kernel
def second_order(a1, a2, b0, b1, b2, x, y):
    """y (n,): y_k = b0 x_k + b1 x_(k-1) + b2 x_(k-2) - a1 y_(k-1) - a2 y_(k-2), from rest, of x (n,) less x_0."""
    x1, x2, y1, y2 = 0.0, 0.0, 0.0, 0.0
    for i in range(len(x)):
        now = x[i] - x[0]
        y[i] = b0 * now + b1 * x1 + b2 * x2 - a1 * y1 - a2 * y2
        x1, x2, y1, y2 = now, x1, y[i], y1


def mode(x: np.ndarray, frequency: float, damping: float, period: float, numerator: tuple[float, float]) -> np.ndarray:
    """(n,) x through (n2 s^2 + n0)/(s^2 + 2 zeta w s + w^2), w [rad/s], by the trapezium rule; numerator (n2, n0)."""
    c, (n2, n0) = 2.0 / period, numerator
    a = np.array([c * c + 2.0 * damping * frequency * c + frequency**2, 2.0 * (frequency**2 - c * c),
                  c * c - 2.0 * damping * frequency * c + frequency**2])
    b = np.array([n2 * c * c + n0, 2.0 * (n0 - n2 * c * c), n2 * c * c + n0])
    y = np.empty(len(x))
    a1, a2, b0, b1, b2 = (np.concatenate([a[1:], b]) / a[0]).tolist()
    second_order(a1, a2, b0, b1, b2, x, y)
    return y


def lagged(x: np.ndarray, time_constant: float, period: float) -> np.ndarray:
    """(n,) x through 1/(1 + T s), T [s], from its first value on."""
    c = 2.0 * time_constant / period
    y = np.empty(len(x))
    second_order((1.0 - c) / (1.0 + c), 0.0, 1.0 / (1.0 + c), 1.0 / (1.0 + c), 0.0, x, y)
    return y + x[0]


def shifted(x: np.ndarray, late: float, period: float) -> np.ndarray:
    """(n,) x later by so much [s], held at its ends."""
    at = np.arange(len(x), dtype=float)
    return np.interp(at - late / period, at, x)


@dataclass(frozen=True, eq=False)
class Signals:
    """The signals of a log on a uniform grid of n samples a period [s] apart.

    theta, rate   [rad], [rad/s]; the one that is not measured is made of the other
    attack        (n,) [rad] theta with the known wind in it
    has_rate      whether the rate is measured: the equation is then of its first derivative, else of theta's second
    nozzle        (n,) [rad] the measured nozzle; None where the command is all there is
    commands      on a grid of their own, `tick` [s] apart
    missing       (n,) where a sample is interpolated over more than HELD rows
    a6, k1        (n,) [1/s^2] of the nominal
    record        that all this is of
    """

    period: float
    theta: np.ndarray
    rate: np.ndarray
    attack: np.ndarray
    has_rate: bool
    nozzle: np.ndarray | None
    commands: np.ndarray
    tick: float
    missing: np.ndarray
    a6: np.ndarray
    k1: np.ndarray
    record: Record

    @property
    def t(self) -> np.ndarray:
        """(n,) [s] Times from the first sample on."""
        return np.arange(len(self.theta)) * self.period

    @property
    def equation(self) -> tuple[np.ndarray, int]:
        """(the column that the equation is of, the order of its derivative)."""
        return (self.rate, 1) if self.has_rate else (self.theta, 2)

    @property
    def noise(self) -> float:
        """Noise of the equation's column, rms: what its third differences show, within what is declared."""
        sensors = self.record.nominal.sensors
        declared = sensors.theta_dot_std if self.has_rate else sensors.theta_std
        shown = float(np.sqrt(np.mean(np.diff(self.equation[0], 3) ** 2) / THIRD))
        return min(max(shown, TRUSTED[0] * declared), TRUSTED[1] * declared) if declared > 0.0 else shown

    def on_its_way(self, travel: Travel) -> np.ndarray:
        """(n,) [rad] The input that turns the vehicle: the measured nozzle, or what the servo makes of the command.

        travel  what is on the way beside the nominal's: `delay` [s], servo's `lag` [s], `play` [rad], `rate` [rad/s]
        """
        if self.nozzle is not None:
            beta = lagged(self.nozzle, travel["lag"], self.period) if "lag" in travel else self.nozzle
            return shifted(beta, travel["delay"], self.period) if "delay" in travel else beta
        servo, command = self.record.actuator, self.commands
        if "play" in travel:
            with_play(travel["play"], command, command := np.empty(len(command)))
        frequency, damping = _slowed(servo, travel.get("lag", 0.0))
        beta = np.empty(len(command))
        pole = fastest_pole(frequency, damping)
        xx, xr, rx, rr = free_servo(frequency, damping, pole, servo.is_first_order, self.tick)
        moved_servo(xx, xr, rx, rr, command, beta)
        if "rate" in travel:
            with_limit(travel["rate"] * self.tick, beta, beta := np.empty(len(beta)))
        late = (servo.delay + travel.get("delay", 0.0)) / self.tick
        at = np.arange(len(self.theta)) * (self.period / self.tick)
        return np.interp(at - late, np.arange(len(beta), dtype=float), beta)


def _slowed(servo: Actuator, lag: float) -> tuple[float, float]:
    """(w [rad/s], zeta) of a servo that follows slow commands later by a lag [s]."""
    damping = FIRST_ORDER_DAMPING if servo.is_first_order else servo.damping_ratio
    return 2.0 * damping / (2.0 * damping / servo.frequency + lag), damping


def _filled(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(x (n,) with lines over what is missing, where so much is missing that a line is no measurement)."""
    known = np.flatnonzero(np.isfinite(x))
    after = np.searchsorted(known, np.arange(len(x)))
    apart = np.diff(np.concatenate([[-1], known, [len(x)]]))[after]
    return np.interp(np.arange(len(x)), known, x[known]), ~np.isfinite(x) & (apart > HELD + 1)


def _is_measured(x: np.ndarray) -> bool:
    return bool(np.mean(np.isfinite(x)) > MEASURED)


def signals_of(record: Record) -> Signals:
    """The signals of a record with its commands; of one with jittering stamps, on the grid of their mean period."""
    n, period = record.rows, record.period
    at, even = record.at, record.every * np.arange(n)
    missing = np.zeros(n, bool)

    def column(k: int) -> np.ndarray | None:
        nonlocal missing
        if not _is_measured(record.z[:, k]):
            return None
        x, gap = _filled(record.z[:, k])
        missing |= gap
        return np.interp(even, at, x) if record.fine > 1 else x

    theta, rate, nozzle = column(THETA), column(THETA_DOT), column(BETA)
    has_rate = rate is not None
    if theta is None and rate is None:
        raise ValueError("neither theta nor theta_dot is measured in more than half of the rows")
    if theta is None:
        assert rate is not None
        theta = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]))]) * period
    if rate is None:
        rate = np.gradient(theta, period)
    half = 2 * (record.first_step + even)
    wind = record.wind[record.first_step + even] if len(record.wind) else 0.0
    return Signals(period, theta, rate, theta + wind, has_rate, nozzle, record.commands, record.tick * record.step,
                   missing, record.a6[half], record.k1[half], record)
