"""Thrust vector control: a servo of second or first order behind a transport delay.

A first-order servo is given as w = 1/T with zeta = 1/2, for which 2 zeta/w, by how much slow commands are late, is T.

A servo that a step resolves is integrated beside the vehicle, by the same Runge-Kutta scheme; a stiff one would be
unstable there.  No vehicle moves its servo, so a stiff one is integrated first, exactly, whatever its poles are; and
the vehicle sees the line that has the mean and the first moment of what the nozzle did over the step.  Runge-Kutta 4
weights what drives its stages such that the vehicle's rate and angle are then those of the nozzle itself.
"""

import math

from ..effects.table import record
from ..kernels import asked, inner
from .controller import limited

FIRST_ORDER_DAMPING = 0.5
POLE_STEP = 0.3  # rad a step, of the fastest pole: Runge-Kutta 4 is then exact to (sh)^4/120 = 7e-5 of what it moves
PARTS_OF_STEP = 16  # of a step, of a stiff servo at its rate limit: that begins and ends within such a part, unseen
# of the last step of a stiff servo: the part [s] of it that was integrated at once, and what follows of that
FREE_MOTION = record("part", "xx", "xr", "rx", "rr")


@inner
def lag_rate(v, u, beta):
    """Return beta' [rad/s] of a first-order servo under the command u [rad], within its rate limit."""
    return limited(v.rate_limit, v.frequency * (u - beta))


@inner
def servo_flow(v, u, beta, beta_dot):
    """Return (beta' [rad/s], beta_dot' [rad/s^2], the nozzle's acceleration [rad/s^2]) under the command u [rad].

    Second order: beta_ddot = w^2 (u - beta) - 2 zeta w beta_dot, none that drives the rate further beyond its reach;
    first order: beta' = w (u - beta), with no rate to wind up.  Both move within +-rate [rad/s], at which the valve is
    full open and the nozzle does not accelerate.
    """
    w, rate = v.frequency, v.rate_limit
    if v.first_order != 0:
        moved = lag_rate(v, u, beta)
        return moved, 0.0, -w * moved if abs(moved) < rate else 0.0
    beta_ddot = w * w * (u - beta) - 2.0 * v.damping * w * beta_dot
    if abs(beta_dot) >= v.rate_reach and beta_dot * beta_ddot > 0.0:
        beta_ddot = 0.0
    return limited(rate, beta_dot), beta_ddot, beta_ddot if abs(beta_dot) <= rate else 0.0


@inner
def nozzle_stages(v, free, stages, u, h):
    """Move the nozzle (v) over h [s] under the command u [rad]; stages (4,) STAGE out: its motion for Runge-Kutta."""
    if free is not None:
        if v.pole * h > POLE_STEP:
            stiff_stages(v, free[0], stages, u, h)
            return
    beta, beta_dot, beta_sum, beta_dot_sum = v.beta, v.beta_dot, -0.0, -0.0
    for s in range(4):
        slope, slope_dot, beta_ddot = servo_flow(v, u, beta, beta_dot)
        stages[s].beta, stages[s].beta_ddot = beta, beta_ddot
        weight, on = 1.0 if s == 0 or s == 3 else 2.0, 0.5 * h if s < 2 else h
        beta_sum += weight * slope
        beta_dot_sum += weight * slope_dot
        beta, beta_dot = v.beta + on * slope, v.beta_dot + on * slope_dot
    v.beta += h / 6.0 * beta_sum
    v.beta_dot = limited(v.rate_reach, v.beta_dot + h / 6.0 * beta_dot_sum)


@inner
def stiff_stages(v, free, stages, u, h):
    """Move the nozzle of a stiff servo exactly, arguments as `nozzle_stages`: the stages are of the lines with the mean
    and first moment of its motion, and of its rate's, with the jolt of a command that jumps."""
    beta, rate = v.beta, limited(v.rate_limit, v.beta_dot)
    once, twice = servo_motion(v, free, h, u)
    after = servo_flow(v, u, v.beta, v.beta_dot)[0]
    first, middle, last = as_line(h, once, twice)
    swing, swung, still = as_line(h, after - rate, v.beta - beta - h * rate)
    for s in range(4):
        stages[s].beta, stages[s].beta_ddot = middle, swung
    stages[0].beta, stages[0].beta_ddot = first, swing
    stages[3].beta, stages[3].beta_ddot = last, still


def fastest_pole(frequency: float, damping: float) -> float:
    """Return the size [rad/s] of the fastest root of s^2 + 2 zeta w s + w^2, w = frequency [rad/s], zeta = damping."""
    return frequency * (damping + math.sqrt(damping * damping - 1.0)) if damping > 1.0 else frequency


@asked
def free_servo(frequency, damping, pole, is_lag, h):
    """Return the servo's transition (xx, xr, rx, rr) over h [s]: (beta - u, beta_dot) at the end are ((xx, xr), (rx,
    rr)) times those at the start.  is_lag: first order, whose rate does not matter; pole [rad/s] the fastest."""
    if is_lag:
        left = math.exp(-frequency * h)
        return left, 0.0, -frequency * left, 0.0
    if damping < 1.0:
        decay, turn = damping * frequency, frequency * math.sqrt(1.0 - damping * damping)
        left = math.exp(-decay * h)
        xr = left * math.sin(turn * h) / turn
        return left * math.cos(turn * h) + decay * xr, xr, -frequency * frequency * xr, \
            left * math.cos(turn * h) - decay * xr
    slow = frequency * frequency / pole
    left, apart = math.exp(-slow * h), pole - slow
    xr = left * (-math.expm1(-apart * h) / apart if apart > 0.0 else h)
    return left + slow * xr, xr, -frequency * frequency * xr, left - pole * xr


@inner
def servo_motion(v, free, h, u):
    """Move the nozzle (v) over h [s] of a held command u [rad]; return the integral [rad s] of beta and its double
    integral [rad s^2] over h.

    Exact without a rate limit, whatever the servo's poles; with one in parts of h, as many as its begin and end need,
    each exact or moved at the limit.  The integrals are those of the servo's equation, inertia x'' + drag x' +
    spring x = 0 of x = beta - u.
    """
    w, rate, parts = v.frequency, v.rate_limit, 1
    if rate < math.inf:
        parts = math.ceil(min(max(v.pole * h / POLE_STEP, 1.0), PARTS_OF_STEP))
    part = h / parts
    if free.part != part:
        free.part = part
        free.xx, free.xr, free.rx, free.rr = free_servo(w, v.damping, v.pole, v.first_order != 0, part)
    inertia, drag, spring = (0.0, 1.0, w) if v.first_order != 0 else (1.0, 2.0 * v.damping * w, w * w)
    off, beta_dot, once, twice = v.beta - u, v.beta_dot, 0.0, 0.0
    for _ in range(parts):
        after = free.rx * off + free.rr * beta_dot
        moved = (free.xx - 1.0) * off + free.xr * beta_dot
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
        beta_dot = limited(v.rate_reach, after)
    v.beta, v.beta_dot = u + off, beta_dot
    return u * h + once, 0.5 * u * h * h + twice


@asked
def as_line(h, once, twice):
    """Return (start, middle, end) of the line over h [s] with this integral `once` and double integral `twice`."""
    middle = once / h
    lean = 3.0 * (middle - 2.0 * twice / (h * h))
    return middle - lean, middle, middle + lean


@inner
def delayed_command(commands, tick, age, step, period, delay):
    """Return the mean command [rad] over a step, seen `delay` later.  Assumption: step <= period.

    commands (ticks,) [rad] in   noisy command of each controller period; before the first it was 0
    tick            current controller period
    age       [s]   time since it began, at the step's start
    step, period, delay [s]
    """
    if delay == 0.0:
        return commands[tick]
    start = tick * period + age - delay
    first = math.floor(start / period + 1e-9)
    share = ((first + 1) * period - start) / step
    share = 1.0 if share > 1.0 else (0.0 if share < 0.0 else share)
    early = commands[first] if first >= 0 else 0.0
    if share == 1.0:
        return early
    late = commands[first + 1] if first + 1 >= 0 else 0.0
    return share * early + (1.0 - share) * late
