"""Flights of a known truth, written from scratch for tests: nothing of the project's own simulator is in them."""

import functools
import math
from collections.abc import Callable

import numpy as np

STEP = 0.001  # s, of Runge and Kutta's fourth order


def test_input(seed: int, amplitude: float, tones: int = 8, low: float = 0.5, high: float = 12.0):
    """A sum of tones [rad/s] of random phase, as a function of time."""
    phase = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, tones)
    frequency = np.linspace(low, high, tones)
    return lambda t: amplitude * float(np.sum(np.sin(frequency * t + phase))) / math.sqrt(tones)


def runge_kutta(slope: Callable[[list[float]], list[float]], x: list[float], step: float) -> list[float]:
    """The state a step [s] later."""
    a = slope(x)
    b = slope([p + 0.5 * step * q for p, q in zip(x, a, strict=True)])
    c = slope([p + 0.5 * step * q for p, q in zip(x, b, strict=True)])
    d = slope([p + step * q for p, q in zip(x, c, strict=True)])
    return [p + step / 6.0 * (q + 2.0 * r + 2.0 * u + v) for p, q, r, u, v in zip(x, a, b, c, d, strict=True)]


def fly(seconds: float, **choices: float) -> dict[str, np.ndarray]:
    """The columns of `flown`, which is flown once."""
    return {name: x.copy() for name, x in flown(seconds, **choices).items()}


@functools.cache
def flown(seconds: float, *, a6: float = 2.0, k1: float = -6.0, damping: float = 0.0, moment: float = 0.0,
          drift: float = 0.0, square: float = 0.0, lag: float = 0.03, row: float = 0.01, seed: int = 1,
          amplitude: float = 0.02) -> dict[str, np.ndarray]:
    """A log of theta_ddot = a6 (theta - gamma) + damping theta_dot + k1 (b + square b^2) + moment under PD control.

    drift [1/s]  gamma_dot = drift (theta - gamma);  lag [s]  of the nozzle b behind its command;  row [s]
    """
    rng, excite = np.random.default_rng(seed), test_input(seed + 2, amplitude)
    x, command, rows = [0.0] * 4, 0.0, []  # theta, theta_dot, gamma, b

    def slope(x: list[float]) -> list[float]:
        attack, b = x[0] - x[2], x[3]
        return [x[1], a6 * attack + damping * x[1] + k1 * (b + square * b * b) + moment, drift * attack,
                (command - b) / lag]

    every = round(row / STEP)
    for k in range(round(seconds / STEP)):
        if k % every == 0:
            theta, rate = x[0] + 2e-4 * rng.normal(), x[1] + 2e-3 * rng.normal()
            command = float(np.clip(1.5 * theta + 0.8 * rate + excite(k * STEP), -0.2, 0.2))
            rows.append((k * STEP, theta, rate, x[3] + 1e-4 * rng.normal(), command, x[2]))
        x = runge_kutta(slope, x, STEP)
    return dict(zip(("t", "theta", "theta_dot", "beta", "beta_cmd", "gamma"), np.array(rows).T, strict=True))


def ship(window_noise: float = 1e-4) -> dict[str, np.ndarray]:
    """100 s of a body that is slow: theta_ddot = -0.0172 beta - 0.087 theta_dot, zig-zag input at a limited rate."""
    rng, h, rows = np.random.default_rng(7), 0.05, []
    theta = rate = beta = 0.0
    goal = -math.radians(20.0)
    for k in range(2000):
        rows.append((k * h, theta + 5e-4 * rng.normal(), rate + window_noise * rng.normal(), beta))
        if abs(theta) > math.radians(10.0) and theta * goal < 0.0:
            goal = math.copysign(math.radians(20.0), theta)
        step = math.radians(15.8) * h
        beta += min(max(goal - beta, -step), step)
        decay = math.exp(-0.087 * h)
        steady = -0.0172 * beta / 0.087
        theta += steady * h + (rate - steady) * (1.0 - decay) / 0.087
        rate = steady + (rate - steady) * decay
    return dict(zip(("t", "theta", "theta_dot", "beta"), np.array(rows).T, strict=True))


def tail_wags_dog(seconds: float = 8.0) -> dict[str, np.ndarray]:
    """theta_ddot = 23.6 theta + 10.1 beta - 0.53 beta_ddot, balanced by full state feedback: theta and beta move as
    one."""
    from scipy.linalg import solve_continuous_are
    a = np.zeros((4, 4))
    a[0, 1] = a[2, 3] = 1.0
    a[1, 0], a[1, 2] = 23.6, 10.1
    b = np.array([[0.0], [-0.53], [0.0], [1.0]])
    gain = b.T @ solve_continuous_are(a, b, np.diag([10.0, 1.0, 10.0, 1.0]), np.array([[0.02]])) / 0.02
    rng, x, u, rows = np.random.default_rng(7), np.array([0.05, 0.0, -0.1, 0.0]), 0.0, []
    for k in range(round(seconds / STEP)):
        if k % 5 == 0:
            rows.append((k * STEP, *x[:3] + np.array([3e-4, 0.1, 3e-4]) * rng.normal(size=3)))
        if k % 2 == 0:
            seen = x + np.array([3e-4, 0.05, 3e-4, 0.05]) * rng.normal(size=4)
            u = float(np.clip(-(gain @ seen)[0], -400.0, 400.0))
        slope = a @ x + b[:, 0] * u
        x = x + STEP * (slope + 0.5 * STEP * (a @ slope))
    return dict(zip(("t", "theta", "theta_dot", "beta"), np.array(rows).T, strict=True))


def spinning() -> dict[str, np.ndarray]:
    """A body that turns on and on: theta_ddot = 4000 beta - 0.73 theta_dot, through thousands of radians."""
    t = np.arange(2000) * 0.01
    rate = np.zeros(2000)
    beta = np.where(t // 2 % 2 == 0, -0.03, -0.045)
    for k in range(1999):
        steady = 4000.0 * beta[k] / 0.73
        rate[k + 1] = steady + (rate[k] - steady) * math.exp(-0.0073)
    theta = np.concatenate([[0.0], np.cumsum(0.005 * (rate[1:] + rate[:-1]))])
    return {"t": t, "theta": theta, "theta_dot": rate, "beta": beta}


def propeller(square: float = 26.0, lag: float = 0.1) -> dict[str, np.ndarray]:
    """A pendulum driven by a propeller: thrust as the square of the input behind a lag; no rate, 100 Hz."""
    rng, h, x, u, rows = np.random.default_rng(7), 0.002, [0.2, 0.0, 1.0], 1.0, []

    def slope(x: list[float]) -> list[float]:
        return [x[1], -86.0 * math.sin(x[0]) + square * x[2] ** 2 - 5.7 - x[1], (u - x[2]) / lag]

    for k in range(10000):
        if k % 350 == 0:
            u = rng.uniform(0.6, 1.9)
        if k % 5 == 0:
            rows.append((k * h, round((x[0] + 2e-4 * rng.normal()) / 1.15e-3) * 1.15e-3, u))
        x = runge_kutta(slope, x, h)
    return dict(zip(("t", "theta", "beta"), np.array(rows).T, strict=True))


def wheel(washout: float = 1.0, half_period: float = 5.0) -> dict[str, np.ndarray]:
    """50 s of a pendulum under a reaction wheel with back-EMF: theta_ddot = -10.5 sin(theta) - 3.4 (u - x) - 0.1
    theta_dot, x' = (u - x)/washout; a square input of this half period [s], 20 Hz, no rate."""
    rng, h, x, u, rows = np.random.default_rng(7), 0.005, [0.0] * 3, 0.0, []

    def slope(x: list[float]) -> list[float]:
        return [x[1], -10.5 * math.sin(x[0]) - 3.4 * (u - x[2]) - 0.1 * x[1], (u - x[2]) / washout]

    for k in range(10000):
        u = 0.2 if (k * h // half_period) % 2 else -0.2
        if k % 10 == 0:
            rows.append((k * h, round((x[0] + 5e-5 * rng.normal()) / 3.14e-4) * 3.14e-4, u))
        x = runge_kutta(slope, x, h)
    return dict(zip(("t", "theta", "beta_cmd"), np.array(rows).T, strict=True))


def rate_loop(delay: float = 0.034, gain: float = 88.0) -> dict[str, np.ndarray]:
    """4 s of a small quadrotor's roll at 500 Hz, gyro and command alone: theta_ddot = gain u(t - delay) + 3 sin(2t), a
    loop that closes on the rate."""
    rng, h, x, wanted, rows = np.random.default_rng(7), 0.002, np.zeros(2), 0.0, []
    line = [0.0] * (round(delay / h) + 1)
    for k in range(2000):
        rate = x[1] + 0.01 * rng.normal()
        wanted = rng.uniform(-1.0, 1.0) if k % 50 == 0 else wanted
        command = float(np.clip(0.12 * (wanted - rate) + 0.05 * rng.normal(), -1.0, 1.0))
        rows.append((k * h, rate, command))
        line = [*line[1:], command]
        a = gain * line[0] + 3.0 * math.sin(2.0 * k * h)
        x = x + h * np.array([x[1] + 0.5 * h * a, a])
    return dict(zip(("t", "theta_dot", "beta_cmd"), np.array(rows).T, strict=True))


def swing(friction: float = 0.15, closed_up: bool = False) -> dict[str, np.ndarray]:
    """23 s of a free pendulum with Coulomb friction [rad/s^2], 20 Hz; closed_up: three samples that were lost at 0.3 s
    are missing from the stamps too."""
    h, x, angles = 0.005, [-0.67, 0.0], []

    def slope(x: list[float]) -> list[float]:
        return [x[1], -10.4 * math.sin(x[0]) - friction * math.tanh(x[1] / 0.005)]

    for k in range(4600):
        if k % 10 == 0 and not (closed_up and 60 <= k < 90):
            angles.append(round(x[0] / 3.14e-4) * 3.14e-4)
        x = runge_kutta(slope, x, h)
    theta = np.array(angles)
    return {"t": 0.05 * np.arange(len(theta)), "theta": theta, "beta_cmd": np.zeros(len(theta))}
