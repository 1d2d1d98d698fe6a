"""Effects of the air and of whatever else turns the vehicle from outside.

Wind is the angle [rad] that it adds to the angle of attack: theta_ddot += a6 angle, and with [drift]
gamma_dot += z_alpha angle.

Assumptions: the aerodynamic moment is a6 times the angle (of a plant given by its
terms: the coefficient of `theta` times it); without [drift] wind turns the vehicle
and does not drift it.

`turbulence` and `wind_walk` are chance, not functions of time: their rows stand here,
`sim.disturbance_draws` draws them with the nominal's [wind], by the same law.

To add an effect: its kernel, its branch below, its row in EFFECTS.
"""

import math

from ..vehicle.kernels import inner, kernel
from .table import CODE, P0, P1, P2, Cause, Parameter

GUST, STEADY_WIND, PERIODIC_DISTURBANCE, TURBULENCE, WIND_WALK = range(5)

EFFECTS = (
    Cause("gust", "environment", (
        Parameter("angle", "rad", neutral=0.0),
        Parameter("time", "s"),
        Parameter("duration", "s", low=0.0, above=True))),
    Cause("steady_wind", "environment", (Parameter("angle", "rad", neutral=0.0),)),
    Cause("periodic_disturbance", "environment", (
        Parameter("amplitude", "rad/s^2", neutral=0.0),
        Parameter("frequency", "rad/s", low=0.0, above=True),
        Parameter("phase", "rad", default=0.0))),
    Cause("turbulence", "environment", (
        Parameter("level", "rad", neutral=0.0, low=0.0),
        Parameter("time_constant", "s", default=1.0, low=0.0, above=True))),
    Cause("wind_walk", "environment", (Parameter("level", "rad/sqrt(s)", neutral=0.0, low=0.0),)),
)


# ---- the physics


@kernel
def gust_angle(angle, time, duration, t):
    """angle (1 - cos(2 pi (t - time)/duration))/2 while it lasts: the discrete gust of 14 CFR 25.341, MIL-F-8785C."""
    share = (t - time) / duration
    return angle * (0.5 * (1.0 - math.cos(2.0 * math.pi * share))) if 0.0 < share < 1.0 else 0.0


@kernel
def periodic_disturbance(amplitude, frequency, phase, t):
    """amplitude sin(frequency t + phase) [rad/s^2]: machinery, a structural tone, a swinging cable of a stand."""
    return amplitude * math.sin(frequency * t + phase)


# ---- the place: fx (n, N_COLUMNS) inout, its rows of the table


@inner
def acceleration(fx, a6, t):
    """Sum of the environment's moments [rad/s^2] at t [s]."""
    total = 0.0
    for e in range(fx.shape[0]):
        code = fx[e, CODE]
        if code == GUST:
            total += a6 * gust_angle(fx[e, P0], fx[e, P1], fx[e, P2], t)
        elif code == STEADY_WIND:
            total += a6 * fx[e, P0]
        elif code == PERIODIC_DISTURBANCE:
            total += periodic_disturbance(fx[e, P0], fx[e, P1], fx[e, P2], t)
    return total


@inner
def wind(fx, t):
    """Sum of the winds [rad] at t [s], the same angles as in `acceleration`; -0.0 where there is none."""
    total = -0.0
    for e in range(fx.shape[0]):
        if fx[e, CODE] == GUST:
            total += gust_angle(fx[e, P0], fx[e, P1], fx[e, P2], t)
        elif fx[e, CODE] == STEADY_WIND:
            total += fx[e, P0]
    return total
