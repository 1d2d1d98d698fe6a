"""Effects between the command and the nozzle.

The command with its noise goes through delay, gain, bias and backlash, in this
order, into the second-order servo, whose natural frequency and rate have effects
of their own.  Of several of one kind delays, biases and plays add, gains and
bandwidths multiply, the lowest rate limits.

Assumptions: the nozzle and the play rest at 0 before t = 0; the servo's rate
saturates and its integrator does not wind up.

To add an effect: its kernel, its branch below, its row in EFFECTS.
"""

import math

from ..vehicle.kernels import inner, kernel
from .table import CODE, MEMORY, P0, Cause, Parameter

ACTUATOR_DELAY, ACTUATOR_GAIN, ACTUATOR_BIAS, ACTUATOR_BACKLASH, ACTUATOR_BANDWIDTH, ACTUATOR_RATE_LIMIT = range(6)

LONGEST_DELAY = 10.0     # s: no attitude loop outlives a tenth of it
WIDEST_BANDWIDTH = 10.0  # the servo must stay within what the integration step resolves

EFFECTS = (
    Cause("actuator_delay", "actuator", (Parameter("delay", "s", neutral=0.0, low=0.0, high=LONGEST_DELAY),)),
    Cause("actuator_gain", "actuator", (Parameter("scale", "", neutral=1.0),)),
    Cause("actuator_bias", "actuator", (Parameter("angle", "rad", neutral=0.0),)),
    Cause("actuator_backlash", "actuator", (Parameter("half_width", "rad", neutral=0.0, low=0.0),)),
    Cause("actuator_bandwidth", "actuator", (
        Parameter("scale", "", neutral=1.0, low=0.0, high=WIDEST_BANDWIDTH, above=True),)),
    Cause("actuator_rate_limit", "actuator", (Parameter("rate", "rad/s", neutral=math.inf, low=0.0, above=True),)),
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
def limited_rate(rate, beta_dot):
    """beta' = beta_dot within +-rate [rad/s]: the servo valve is full open."""
    return min(max(beta_dot, -rate), rate)


@kernel
def limited_acceleration(rate, beta_dot, beta_ddot):
    """beta_dot' [rad/s^2]: none that drives the rate further beyond its limit (no wind-up)."""
    return 0.0 if abs(beta_dot) >= rate and beta_dot * beta_ddot > 0.0 else beta_ddot


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
def command(fx, u):
    """The servo's input [rad] of the delayed command u; the play of row e is kept in its row."""
    for e in range(fx.shape[0]):
        code, value = fx[e, CODE], fx[e, P0]
        if code == ACTUATOR_GAIN:
            u = amplified(value, u)
        elif code == ACTUATOR_BIAS:
            u = offset(value, u)
        elif code == ACTUATOR_BACKLASH:
            u = play(value, u, fx[e, MEMORY])
            fx[e, MEMORY] = u
    return u


@inner
def servo(fx, frequency):
    """(natural frequency [rad/s], rate limit [rad/s]) of the servo whose nominal frequency is given."""
    rate = math.inf
    for e in range(fx.shape[0]):
        if fx[e, CODE] == ACTUATOR_BANDWIDTH:
            frequency = fx[e, P0] * frequency
        elif fx[e, CODE] == ACTUATOR_RATE_LIMIT:
            rate = min(rate, fx[e, P0])
    return frequency, rate
