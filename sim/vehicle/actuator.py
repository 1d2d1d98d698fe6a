"""Thrust vector control: a servo of second or first order behind a transport delay.

A first-order servo is given as w = 1/T with zeta = 1/2, for which 2 zeta/w, by how much slow commands are late, is T.

A servo that a step resolves is integrated beside the vehicle, by the same Runge-Kutta scheme; a stiff one would be
unstable there.  No vehicle moves its servo, so a stiff one is integrated first, exactly, whatever its poles are; and
the vehicle sees the line that has the mean and the first moment of what the nozzle did over the step.  Runge-Kutta 4
weights what drives its stages such that the vehicle's rate and angle are then those of the nozzle itself.
"""

import math

from ..effects.actuator import limited_acceleration, limited_rate
from .kernels import kernel

FIRST_ORDER_DAMPING = 0.5
RESOLVED = 0.3   # rad a step, of the fastest pole: Runge-Kutta 4 is then exact to (sh)^4/120 = 7e-5 of what it moves
MOST_PARTS = 16  # of a step, of a stiff servo at its rate limit: that begins and ends within such a part, unseen


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
def fastest_pole(frequency, damping):
    """[rad/s] size of the fastest root of s^2 + 2 zeta w s + w^2; of a servo of first order 1/T."""
    return frequency * (damping + math.sqrt(damping * damping - 1.0)) if damping > 1.0 else frequency


@kernel
def free_servo(frequency, damping, is_lag, h):
    """exp of the servo's generator over h [s]: (beta - u, beta_dot) at the end are ((xx, xr), (rx, rr)) times those at
    the start; a servo of first order has no rate of its own to remember."""
    if is_lag:
        left = math.exp(-frequency * h)
        return left, 0.0, -frequency * left, 0.0
    if damping < 1.0:
        decay, turn = damping * frequency, frequency * math.sqrt(1.0 - damping * damping)
        left = math.exp(-decay * h)
        xr = left * math.sin(turn * h) / turn
        return left * math.cos(turn * h) + decay * xr, xr, -frequency * frequency * xr, \
            left * math.cos(turn * h) - decay * xr
    fast = fastest_pole(frequency, damping)
    slow = frequency * frequency / fast
    left, apart = math.exp(-slow * h), fast - slow
    xr = left * (-math.expm1(-apart * h) / apart if apart > 0.0 else h)
    return left + slow * xr, xr, -frequency * frequency * xr, left - fast * xr


@kernel
def parts_of(pole, rate, h):
    """Parts of a step h [s] in which a stiff servo is integrated: one, or as many as its limit's begin and end need."""
    return 1 if rate == math.inf else math.ceil(min(max(pole * h / RESOLVED, 1.0), MOST_PARTS))


@kernel
def servo_motion(frequency, damping, is_lag, rate, reach, free, parts, h, command, beta, beta_dot):
    """(beta [rad], beta_dot [rad/s]) after h [s] of a held command [rad], and the integral [rad s] of beta and its
    double integral [rad s^2] over h.

    Exact without a rate limit, whatever the servo's poles; with one in parts of h, each exact or moved at the limit.
    rate, reach   as of `servo_slopes`;  free (4,)  `free_servo` over a part
    The integrals are those of the servo's equation, inertia x'' + drag x' + spring x = 0 of x = beta - u.
    """
    part, xx, xr, rx, rr = h / parts, free[0], free[1], free[2], free[3]
    inertia, drag, spring = (0.0, 1.0, frequency) if is_lag else (1.0, 2.0 * damping * frequency, frequency * frequency)
    off, once, twice = beta - command, 0.0, 0.0
    for _ in range(parts):
        after = rx * off + rr * beta_dot
        moved = (xx - 1.0) * off + xr * beta_dot
        if abs(moved) > rate * part:
            moved = math.copysign(rate * part, moved)
            after = math.copysign(max(abs(after), rate), moved)
            first, second = part * (off + 0.5 * moved), part * part * (0.5 * off + moved / 6.0)
        else:
            first = -(inertia * (after - beta_dot) + drag * moved) / spring
            second = -(inertia * (moved - beta_dot * part) + drag * (first - off * part)) / spring
        twice += once * part + second
        once += first
        off += moved
        beta_dot = limited_rate(reach, after)
    return command + off, beta_dot, command * h + once, 0.5 * command * h * h + twice


@kernel
def as_line(h, once, twice):
    """(start, middle, end) of the line whose integral and double integral over h [s] these are."""
    middle = once / h
    lean = 3.0 * (middle - 2.0 * twice / (h * h))
    return middle - lean, middle, middle + lean


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
