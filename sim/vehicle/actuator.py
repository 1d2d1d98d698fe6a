"""Thrust vector control: a servo of second or first order behind a transport delay.

A first-order servo is given as w = 1/T with zeta = 1/2, for which 2 zeta/w, by how much slow commands are late, is T.
"""

import math

from ..effects.actuator import limited_acceleration, limited_rate
from .kernels import kernel

FIRST_ORDER_DAMPING = 0.5


@kernel
def nozzle_acceleration(frequency, damping, command, beta, beta_dot):
    """beta_ddot [rad/s^2] = w^2 (command - beta) - 2 zeta w beta_dot."""
    return frequency * frequency * (command - beta) - 2.0 * damping * frequency * beta_dot


@kernel
def servo_slopes(frequency, damping, rate, reach, command, beta, beta_dot):
    """(beta' [rad/s], beta_dot' [rad/s^2]) of the servo behind its rate limit; reach: of the demanded rate
    (both [rad/s], inf: none)."""
    beta_ddot = nozzle_acceleration(frequency, damping, command, beta, beta_dot)
    return limited_rate(rate, beta_dot), limited_acceleration(reach, beta_dot, beta_ddot)


@kernel
def lag_slopes(frequency, rate, command, beta):
    """(beta' [rad/s], 0) of a first-order servo: w (command - beta) within +-rate [rad/s]; no rate to wind up."""
    return limited_rate(rate, frequency * (command - beta)), 0.0


@kernel
def delayed_command(commands, tick, age, step, period, delay):
    """Mean of the command over a step, seen `delay` later.  Assumption: step <= period.

    commands (ticks,) [rad] in   noisy command of each controller period; before the first it was 0
    tick            current controller period
    age       [s]   time since it began, at the step's start
    step, period, delay [s]
    """
    if delay == 0.0:
        return commands[tick]
    start = tick * period + age - delay
    first = math.floor(start / period + 1e-9)
    share = min(max(((first + 1) * period - start) / step, 0.0), 1.0)
    early = commands[first] if first >= 0 else 0.0
    if share == 1.0:
        return early
    late = commands[first + 1] if first + 1 >= 0 else 0.0
    return share * early + (1.0 - share) * late
