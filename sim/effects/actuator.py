"""Effects between the command and the nozzle.

The command with its noise goes through delay, gain, bias, backlash and wash-out,
in this order, into the second-order servo, whose natural frequency and rate have effects
of their own.  Of several of one kind delays, biases and plays add, gains and
bandwidths multiply, the lowest rate limits.

Two have a second form, in a parameter beside the usual one: a slow servo may be
so by a first-order lag before it (`lag`), and the rate that a saturated servo asks
for may run ahead of its limit (`wind_up`).

Assumptions: nozzle, play, lag and what washes out rest at 0 before t = 0; a lag's
output over a step of integration acts by its mean.

To add an effect: its row in ACTUATOR_EFFECTS, its branch in `change`, its equation in a kernel.
"""

import math
from collections.abc import Mapping

from ..kernels import asked, inner
from .table import Cause, Changes, Parameter

PLAY, LAG, WASHOUT = range(3)  # kinds of what remembers

LONGEST_DELAY = 10.0     # s: no attitude loop outlives a tenth of it
WIDEST_BANDWIDTH = 10.0  # the servo must stay within what the integration step resolves

ACTUATOR_EFFECTS = (
    Cause("actuator_delay", "actuator", (
        Parameter("delay", "s", neutral=0.0, low=0.0, high=LONGEST_DELAY, into="actuator_delay"),),
        "u(t) -> u(t - delay), added to the nominal's"),
    Cause("actuator_gain", "actuator", (  # of the servo's amplifier
        Parameter("scale", "", neutral=1.0, into="actuator_gain"),),
        "u -> scale*u"),
    Cause("actuator_bias", "actuator", (Parameter("angle", "rad", neutral=0.0, into="actuator_bias"),),
        "u -> u + angle"),  # its null
    Cause("actuator_backlash", "actuator", (Parameter("half_width", "rad", neutral=0.0, low=0.0),),
        "backlash of half_width each way on u"),
    Cause("actuator_bandwidth", "actuator", (
        Parameter("scale", "", neutral=1.0, low=0.0, high=WIDEST_BANDWIDTH, above=True),
        Parameter("lag", "", neutral=0.0, low=0.0, high=1.0)),
        "natural frequency (or 1/time constant) -> scale*it; `lag` = 1: as slow by a first-order lag before the "
        "servo instead"),
    Cause("actuator_rate_limit", "actuator", (
        Parameter("rate", "rad/s", neutral=math.inf, low=0.0, above=True),
        Parameter("wind_up", "", neutral=0.0, low=0.0)),
        "abs(b') <= rate; `wind_up`: the commanded rate may exceed the limit by this share of it (a first-order "
        "servo has none)"),
    Cause("input_washout", "actuator", (
        Parameter("time_constant", "s", neutral=math.inf, low=0.0, above=True),),
        "u -> u - w, time_constant*w' = u - w from w(0) = 0: u less its slow part (a motor's back-EMF)"),
)


def change(of: Changes, name: str, p: Mapping[str, float]) -> None:
    """Add effect `name` with values p to `of`, in place; parameters with `into` are not added here."""
    match name:
        case "actuator_backlash":
            of.inputs.append((PLAY, p["half_width"], 0.0))
        case "actuator_bandwidth":
            of.bandwidths.append((p["scale"], p["lag"]))
        case "actuator_rate_limit":
            if p["rate"] < of.rate_limit:
                of.rate_limit, of.rate_reach = p["rate"], (1.0 + p["wind_up"]) * p["rate"]
        case "input_washout":
            if p["time_constant"] < math.inf:
                of.inputs.append((WASHOUT, p["time_constant"], 0.0))


def slowed(scale: float, lag: float, frequency: float, damping: float) -> tuple[float, float]:
    """Return (natural frequency [rad/s], time constant [s] of a lag before the servo) of a servo slower by `scale`.

    lag  share, 0 to 1, of the slowing that the lag makes; slow commands are late by 2 zeta/(w scale) with any share.  A
         scale above 1 changes the frequency alone.
    """
    if lag == 0.0 or scale >= 1.0:
        return scale * frequency, 0.0
    slowing = 1.0 / scale - 1.0
    return frequency / (1.0 + (1.0 - lag) * slowing), lag * slowing * 2.0 * damping / frequency


@asked
def play(half_width, u, w):
    """Return the play operator's output w <- max(u - h, min(u + h, w)), w the driven side (Krasnosel'skii and
    Pokrovskii, Systems with Hysteresis, 1989); half width h = 0 gives u."""
    return max(u - half_width, min(u + half_width, w))


@inner
def servo_input(v, inputs, h, u):
    """Return the servo's mean input [rad] over h [s] for the delayed command u [rad]; moves `inputs` over the step."""
    u = v.actuator_gain * u + v.actuator_bias
    if inputs is not None:
        for each in inputs:
            if each.kind == PLAY:
                each.x = u = play(each.value, u, each.x)
            else:  # tau x' = u - x with u held: its mean over the step
                left = math.exp(-h / each.value)
                mean = u + (each.x - u) * (1.0 - left) * each.value / h
                each.x = u + (each.x - u) * left
                u = mean if each.kind == LAG else u - mean
    return u
