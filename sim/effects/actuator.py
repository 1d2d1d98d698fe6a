"""Effects between the command and the nozzle.

The command with its noise goes through delay, gain, bias, backlash and wash-out,
in this order, into the second-order servo, whose natural frequency and rate have effects
of their own.  Of several of one kind delays, biases and plays add, gains and
bandwidths multiply, the lowest rate limits.

Two have a second form, in a parameter beside the contract's: a slow servo may be
so by a first-order lag before it (`lag`), and the rate that a saturated servo asks
for may run ahead of its limit (`wind_up`).

Assumptions: nozzle, play, lag and what washes out rest at 0 before t = 0; a lag's
output over a step of integration acts by its mean.

To add an effect: its kernel, its branch below, its row in EFFECTS.
"""

import math

from ..vehicle.kernels import inner, kernel
from .table import CODE, MEMORY, P0, P1, Cause, Parameter

(ACTUATOR_DELAY, ACTUATOR_GAIN, ACTUATOR_BIAS, ACTUATOR_BACKLASH, ACTUATOR_BANDWIDTH, ACTUATOR_RATE_LIMIT,
 INPUT_WASHOUT) = range(7)

LONGEST_DELAY = 10.0     # s: no attitude loop outlives a tenth of it
WIDEST_BANDWIDTH = 10.0  # the servo must stay within what the integration step resolves

EFFECTS = (
    Cause("actuator_delay", "actuator", (Parameter("delay", "s", neutral=0.0, low=0.0, high=LONGEST_DELAY),)),
    Cause("actuator_gain", "actuator", (Parameter("scale", "", neutral=1.0),)),
    Cause("actuator_bias", "actuator", (Parameter("angle", "rad", neutral=0.0),)),
    Cause("actuator_backlash", "actuator", (Parameter("half_width", "rad", neutral=0.0, low=0.0),)),
    Cause("actuator_bandwidth", "actuator", (
        Parameter("scale", "", neutral=1.0, low=0.0, high=WIDEST_BANDWIDTH, above=True),
        Parameter("lag", "", neutral=0.0, low=0.0, high=1.0))),
    Cause("actuator_rate_limit", "actuator", (
        Parameter("rate", "rad/s", neutral=math.inf, low=0.0, above=True),
        Parameter("wind_up", "", neutral=0.0, low=0.0))),
    Cause("input_washout", "actuator", (
        Parameter("time_constant", "s", neutral=math.inf, low=0.0, above=True),)),
)


# ---- the physics


@kernel
def amplified(scale, u):
    """scale u [rad]: the servo amplifier's gain (`actuator_gain`)."""
    return scale * u


@kernel
def offset(angle, u):
    """u + angle [rad]: the servo's null is off (`actuator_bias`)."""
    return u + angle


@kernel
def play(half_width, u, w):
    """Play operator: w <- max(u - h, min(u + h, w)), w the driven side (Krasnosel'skii and Pokrovskii,
    Systems with Hysteresis, 1989); h = 0 gives u."""
    return max(u - half_width, min(u + half_width, w))


@kernel
def slowed(scale, lag, frequency, damping):
    """(natural frequency w [rad/s], time constant [s] of a lag before the servo) of a servo slower by `scale`.

    lag  share of the slowing that the lag makes; slow commands, 2 zeta/w late, are as late with any.  Faster by a lag
         no servo can be: then it is the frequency alone.
    """
    if lag == 0.0 or scale >= 1.0:
        return scale * frequency, 0.0
    slowing = 1.0 / scale - 1.0
    return frequency / (1.0 + (1.0 - lag) * slowing), lag * slowing * 2.0 * damping / frequency


@kernel
def lagged(tau, step, u, w):
    """(mean [rad] over the step of the output of tau w' = u - w with u held, w at its end)."""
    left = math.exp(-step / tau)
    return u + (w - u) * (1.0 - left) * tau / step, u + (w - u) * left


@kernel
def limited_rate(rate, beta_dot):
    """beta' = beta_dot within +-rate [rad/s]: the servo valve is full open."""
    return min(max(beta_dot, -rate), rate)


@kernel
def limited_acceleration(reach, beta_dot, beta_ddot):
    """beta_dot' [rad/s^2]: none that drives the rate further beyond its reach [rad/s] (no wind-up beyond it)."""
    return 0.0 if abs(beta_dot) >= reach and beta_dot * beta_ddot > 0.0 else beta_ddot


# ---- the place: fx (n, N_COLUMNS) inout, its rows of the table


@inner
def latency(fx):
    """Delay [s] beside the nominal's: u(t) -> u(t - delay)."""
    delay = 0.0
    for e in range(fx.shape[0]):
        if fx[e, CODE] == ACTUATOR_DELAY:
            delay += fx[e, P0]
    return delay


@inner
def command(fx, frequency, damping, step, u):
    """The servo's input [rad] over a step [s] of the delayed command u; what row e remembers is kept in it.

    frequency [rad/s], damping   of the nominal's servo
    """
    for e in range(fx.shape[0]):
        code, value = fx[e, CODE], fx[e, P0]
        if code == ACTUATOR_GAIN:
            u = amplified(value, u)
        elif code == ACTUATOR_BIAS:
            u = offset(value, u)
        elif code == ACTUATOR_BACKLASH:
            u = play(value, u, fx[e, MEMORY])
            fx[e, MEMORY] = u
        elif code == ACTUATOR_BANDWIDTH:
            frequency, tau = slowed(value, fx[e, P1], frequency, damping)
            if tau > 0.0:
                u, fx[e, MEMORY] = lagged(tau, step, u, fx[e, MEMORY])
        elif code == INPUT_WASHOUT and value < math.inf:
            slow, fx[e, MEMORY] = lagged(value, step, u, fx[e, MEMORY])
            u -= slow
    return u


@inner
def servo(fx, frequency, damping):
    """(natural frequency, rate limit, what the demanded rate may reach) of the nominal's servo, all [rad/s]."""
    rate = reach = math.inf
    for e in range(fx.shape[0]):
        if fx[e, CODE] == ACTUATOR_BANDWIDTH:
            frequency = slowed(fx[e, P0], fx[e, P1], frequency, damping)[0]
        elif fx[e, CODE] == ACTUATOR_RATE_LIMIT and fx[e, P0] < rate:
            rate, reach = fx[e, P0], (1.0 + fx[e, P1]) * fx[e, P0]
    return frequency, rate, reach
