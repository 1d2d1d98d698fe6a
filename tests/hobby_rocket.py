"""A model rocket with thrust vectoring, from the pad to the parachute, as its flight computer logs it (own simulation).

theta'' = a6(t) theta + k1 (nozzle + lean) + push while the engine burns; nothing on the pad; theta'' = a6 theta + push
while it coasts; a pendulum with damping under the parachute.  The servo is first order behind a delay.
"""

import math
from dataclasses import dataclass

import numpy as np

STEP = 0.001   # s


@dataclass(frozen=True)
class Rocket:
    """Numbers of a flight: times [s], thrust [N], arm [m], inertia [kg m^2], controller, servo, noises."""

    pad: float = 2.5
    burn: float = 3.8
    coast: float = 2.5
    chute: float = 4.0
    thrust: float = 11.0
    arm: float = 0.33
    inertia: float = 0.052
    pressure: float = 0.11      # a6 = pressure t^2
    kp: float = 0.45
    kd: float = 0.13
    lag: float = 0.035
    delay: float = 0.02
    period: float = 0.02
    limit: float = 0.12
    lean: float = math.radians(0.25)
    push: float = 0.25
    theta_std: float = 1.2e-3
    rate_std: float = 2.5e-3
    beta_std: float = 0.0       # of a nozzle's sensor; 0: none
    is_still_on_pad: bool = False

    @property
    def k1(self) -> float:
        """Return -thrust arm / inertia [1/s^2]."""
        return -self.thrust * self.arm / self.inertia

    def a6(self, t: float) -> float:
        """Return a6 [1/s^2] at t [s] after ignition."""
        return self.pressure * min(max(t, 0.0), self.burn)**2


def fly(rocket: Rocket, seed: int) -> dict[str, np.ndarray]:
    """Return the columns t, theta, theta_dot, beta_cmd (and beta) that the flight computer logs, in SI units."""
    r, draw = rocket, np.random.default_rng(seed)
    every = round(r.period / STEP)
    x, line, command, push = np.zeros(3), [0.0] * (round(r.delay / STEP) + 1), 0.0, 0.0
    rows = list[tuple[float, ...]]()

    def slope(x: np.ndarray, u: float, t: float) -> np.ndarray:
        theta, rate, nozzle = x
        acceleration = 0.0
        if 0.0 <= t < r.burn:
            acceleration = r.a6(t) * theta + r.k1 * (nozzle + r.lean) + push
        elif r.burn <= t < r.burn + r.coast:
            acceleration = r.a6(t) * math.exp(-(t - r.burn)) * theta + push
        elif t >= r.burn + r.coast:
            acceleration = -7.0 * math.sin(theta - 0.2) - 1.2 * rate + 8.0 * push
        return np.array([rate if t >= 0.0 else 0.0, acceleration, (u - nozzle) / r.lag])

    for k in range(round((r.pad + r.burn + r.coast + r.chute) / STEP)):
        t = k * STEP - r.pad
        if k % every == 0:
            theta, rate = x[0] + draw.normal(0.0, r.theta_std), x[1] + draw.normal(0.0, r.rate_std)
            is_steered = 0.3 < t < r.burn - 0.3
            asked = math.radians(5.0) * np.sign(np.sin(2.0 * math.pi * (t - 0.3) / 1.3)) if is_steered else 0.0
            command = float(np.clip(r.kp * (theta - asked) + r.kd * rate, -r.limit, r.limit))
            if r.is_still_on_pad and t < 0.0:
                command = 0.0
            push = draw.normal(0.0, r.push)
            beta = (x[2] + draw.normal(0.0, r.beta_std),) if r.beta_std > 0.0 else ()
            rows.append((k * STEP, theta, rate, command, *beta))
        line = [command, *line[:-1]]
        u = line[-1]
        a = slope(x, u, t)
        b = slope(x + 0.5 * STEP * a, u, t + 0.5 * STEP)
        x = x + STEP * b
    return dict(zip(("t", "theta", "theta_dot", "beta_cmd", "beta"), np.array(rows).T, strict=False))


def as_hobby_csv(columns: dict[str, np.ndarray], seed: int = 0) -> str:
    """Return the flight as a hobbyist's CSV: ms, degrees of three decimals, servo microseconds (0.02 degrees each)."""
    lines = ["time_ms,pitch_deg,gyro_y_dps,servo_us"]
    logged = (columns[name] for name in ("t", "theta", "theta_dot", "beta_cmd"))
    for t, theta, rate, command in zip(*logged, strict=True):
        lines.append(f"{round(1e3 * t) + 40000},{math.degrees(theta):.3f},{math.degrees(rate):.3f},"
                     f"{round(1500 - math.degrees(command) / 0.02)}")
    return "\n".join(lines) + "\n"
