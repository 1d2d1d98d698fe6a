"""Effects of the air and of whatever else turns the vehicle from outside.

Wind is the angle [rad] that it adds to the angle of attack: theta_ddot += a6 angle, and with [drift]
gamma_dot += z_alpha angle.

Assumptions: the aerodynamic moment is a6 times the angle (of a plant given by its
terms: the coefficient of `theta` times it); without [drift] wind turns the vehicle
and does not drift it.

`turbulence` and `wind_walk` are chance, not functions of time: their rows stand here,
`sim.disturbance_draws` draws them with the nominal's [wind], by the same law.

To add an effect: its row in ENVIRONMENT_EFFECTS, its branch in `change`, its equation in a kernel.
"""

import math
from collections.abc import Mapping

from ..kernels import inner, kernel
from .table import Cause, Changes, Parameter

GUST_KIND, SINE_KIND, JUMP_KIND = range(3)  # kinds of what the time decides; the last is the plant's `moment_step`

ENVIRONMENT_EFFECTS = (
    Cause("gust", "environment", (
        Parameter("angle", "rad", neutral=0.0),
        Parameter("time", "s"),
        Parameter("duration", "s", low=0.0, above=True)),
        "a6*theta -> a6*(theta + angle*(1 - cos(2 pi (t - time)/duration))/2) while it lasts"),
    Cause("steady_wind", "environment", (Parameter("angle", "rad", neutral=0.0, into="steady_wind"),),
        "a6*theta -> a6*(theta + angle)"),
    Cause("periodic_disturbance", "environment", (
        Parameter("amplitude", "rad/s^2", neutral=0.0),
        Parameter("frequency", "rad/s", low=0.0, above=True),
        Parameter("phase", "rad", default=0.0)),
        "theta_ddot += amplitude*sin(frequency*t + phase)"),
    Cause("turbulence", "environment", (
        Parameter("level", "rad", neutral=0.0, low=0.0),
        Parameter("time_constant", "s", default=1.0, low=0.0, above=True)),
        "the wind of `[wind]` `turbulence`, beside the nominal's; drawn from the seed"),
    Cause("wind_walk", "environment", (Parameter("level", "rad/sqrt(s)", neutral=0.0, low=0.0),),
        "the wind of `[wind]` `walk`, from 0 at t = 0, beside the nominal's; drawn from the seed"),
)


def change(of: Changes, name: str, p: Mapping[str, float]) -> None:
    """Add effect `name` with values p to `of`, in place; parameters with `into` are not added here."""
    match name:
        case "gust":
            of.timed.append((GUST_KIND, p["angle"], p["time"], p["duration"]))
        case "periodic_disturbance":
            of.timed.append((SINE_KIND, p["amplitude"], p["frequency"], p["phase"]))
        case "turbulence":
            of.turbulences.append((p["level"], p["time_constant"]))
        case "wind_walk":
            of.walks.append((p["level"], 0.0))


@kernel
def gust_angle(angle, time, duration, t):
    """Return the wind [rad] of a gust at t [s]: angle (1 - cos(2 pi (t - time)/duration))/2 while it lasts, else 0."""
    share = (t - time) / duration
    return angle * (0.5 * (1.0 - math.cos(2.0 * math.pi * share))) if 0.0 < share < 1.0 else 0.0


@inner
def air(v, timed, a6, t):
    """Return at t [s] the moments of wind and periodic disturbances, those begun in flight [rad/s^2], the wind [rad].

    Periodic: machinery, a structural tone, a swinging cable of a stand.  Begun in flight: an engine out, off the axis;
    a fin or a fairing that is gone.
    """
    moment, begun, wind = 0.0, -0.0, -0.0
    if timed is not None:
        for each in timed:
            if each.kind == GUST_KIND:
                angle = gust_angle(each.amount, each.first, each.second, t)
                moment += a6 * angle
                wind += angle
            elif each.kind == JUMP_KIND and t > each.first:
                begun += each.amount
    moment += a6 * v.steady_wind
    if timed is not None:
        for each in timed:
            if each.kind == SINE_KIND:
                moment += each.amount * math.sin(each.first * t + each.second)
    return moment, begun, wind + v.steady_wind
