"""The contract's causes in the generator's own names and units, each in its plain and in a physically other form.

Every function fits one effect to a flight in the making.  What a value's name ends in is its unit; `percent` is
a deviation from 100.  The other forms are documented where they stand; the sizes mean the same in both.
"""

import math
from collections.abc import Callable

import numpy as np

from .build import SUBSTEP, Build
from .spec import OTHER, Hidden
from .weather import turbulence, wandering

Fit = Callable[[Build, Hidden], None]

RAMP = 1.0            # s that a thrust loss takes in its other form, centred on the plain one's instant
SQUARE_SHARE = 0.1    # of the damping that grows with the rate, at the programme's largest rate
RUB_WIDTH = 5.0e-4    # rad/s: the smooth friction's sign changes over the gyro's noise
PENDULUM = 4.0        # swing of the propellant's pendulum over the rigid body's angle psi (arm over pendulum length)
SECOND_MODE = (2.7, -0.2)  # frequency and gain of a second bending mode over the first's: a free beam's 2.76
OVERTONE = 0.05       # of a disturbance that is no pure sine, at twice its frequency
JITTER = 0.1          # of a delay, uniform, drawn every controller period
LEAK = 0.1            # of an input that washes out
SETTLING = 3.0        # s in which a servo amplifier's gain warms up
TAIL_OFF = 0.4        # s in which the thrust of an engine that is out falls to 1/e
MOUNT = 4.0e-3        # s by which the engine's mount yields
THINNING = 0.3        # of the drift's rates, by which they are larger at the start of a flight and smaller at its end
RUB_SHARE = 0.1       # of the play, as the command that the servo's own friction swallows


def is_other(hidden: Hidden) -> bool:
    return hidden.variant == OTHER


def thrust_percent(b: Build, x: Hidden) -> None:
    """The thrust is off by a share.  Other: the deviation creeps."""
    share = x["percent"] / 100.0
    b.k1 *= 1.0 + share * (b.creep(b.t) if is_other(x) else 1.0)


def thrust_drop(b: Build, x: Hidden) -> None:
    """A part of the thrust is lost at once.  Other: over RAMP seconds."""
    if is_other(x):
        gone = np.clip((b.t - x["at_s"]) / RAMP + 0.5, 0.0, 1.0)
    else:
        gone = (b.t >= x["at_s"] - 1e-9).astype(float)
    b.k1 *= 1.0 - x["percent"] / 100.0 * gone


def aero_percent(b: Build, x: Hidden) -> None:
    """The air's moment is off by a share.  Other: the deviation creeps."""
    b.a6 *= 1.0 + x["percent"] / 100.0 * (b.creep(b.t) if is_other(x) else 1.0)


def rate_drag(b: Build, x: Hidden) -> None:
    """A moment grows with the rate.  Other: a part grows with its square; the coefficient is that at half the largest
    rate."""
    if is_other(x):
        b.set(drag=(1.0 - 0.5 * SQUARE_SHARE) * x["per_s"],
              drag_square=SQUARE_SHARE * x["per_s"] / b.vehicle.turn_rate)
    else:
        b.set(drag=x["per_s"])


def aero_curve(b: Build, x: Hidden) -> None:
    """The air's moment has a cube of the angle.  Other: sinh (or sin) of the angle, whose third-order term is the
    coefficient."""
    if is_other(x):
        b.set(aero_bend=math.copysign(math.sqrt(6.0 * abs(x["per_rad2"])), x["per_rad2"]))
    else:
        b.set(aero_third=x["per_rad2"])


def bearing_rub(b: Build, x: Hidden) -> None:
    """A bearing has dry friction.  Other: smooth through zero rate."""
    b.set(rub=math.radians(x["deg_per_s2"]), rub_width=RUB_WIDTH if is_other(x) else 0.0)


def thrust_tilt(b: Build, x: Hidden) -> None:
    """The thrust is tilted.  Other: the centre of mass is off the axis and its lever creeps as propellant burns."""
    b.tilt += math.radians(x["deg"]) * (b.creep(b.t) if is_other(x) else 1.0)


def tank(b: Build, x: Hidden) -> None:
    """A tank sloshes.  Other: a pendulum with the sine of its angle."""
    b.set(tank_pull=x["pull"], tank_frequency=2.0 * math.pi * x["hz"], tank_damping=x["damping"],
          tank_ratio=PENDULUM if is_other(x) else 0.0)


def flex(b: Build, x: Hidden) -> None:
    """The body bends.  Other: with a small second mode."""
    w = 2.0 * math.pi * x["hz"]
    b.set(flex_gain=x["gain"], flex_frequency=w, flex_damping=x["damping"])
    if is_other(x):
        b.set(flex2_gain=SECOND_MODE[1] * x["gain"], flex2_frequency=SECOND_MODE[0] * w, flex2_damping=x["damping"])


def gust_pulse(b: Build, x: Hidden) -> None:
    """A gust comes and goes.  Other: a triangle of the same height and length."""
    share = np.clip((b.t - x["at_s"]) / x["length_s"], 0.0, 1.0)
    shape = 1.0 - np.abs(2.0 * share - 1.0) if is_other(x) else 0.5 - 0.5 * np.cos(2.0 * math.pi * share)
    b.wind += math.radians(x["deg"]) * shape


def wind(b: Build, x: Hidden) -> None:
    """A steady wind blows.  Other: it creeps."""
    b.wind += math.radians(x["deg"]) * (b.creep(b.t) if is_other(x) else 1.0)


def hum(b: Build, x: Hidden) -> None:
    """A moment swings at one frequency.  Other: with a little of its octave."""
    phase = 2.0 * math.pi * x["hz"] * b.t + math.radians(x["phase_deg"])
    shape = np.sin(phase) + (OVERTONE * np.sin(2.0 * phase) if is_other(x) else 0.0)
    b.torque += math.radians(x["deg_per_s2"]) * shape


def engine_out(b: Build, x: Hidden) -> None:
    """One engine ends, which turns the vehicle.  Other: as the thrust tails off, begun so much earlier that the
    momentum lost is the same."""
    since = b.t - x["at_s"] + (TAIL_OFF if is_other(x) else 1e-9)
    shape = 1.0 - np.exp(-np.maximum(since, 0.0) / TAIL_OFF) if is_other(x) else (since >= 0.0).astype(float)
    b.torque += math.radians(x["deg_per_s2"]) * shape


def heavy_nozzle(b: Build, x: Hidden) -> None:
    """The nozzle's inertia kicks the vehicle.  Other: through a mount that yields."""
    b.set(kick=x["kick"], mount=MOUNT if is_other(x) else 0.0)


def thrust_trend(b: Build, x: Hidden) -> None:
    """The thrust grows with time.  Other: with the square of time, the same in the middle of the flight and as steep
    there."""
    since = b.t - 0.5 * b.duration
    b.k1 *= 1.0 + x["percent_per_s"] / 100.0 * (since + (since**2 / b.duration if is_other(x) else 0.0))


def sideways(b: Build, x: Hidden) -> None:
    """The flight path drifts.  Other: profiles, for the vehicle gets faster."""
    profile = 1.0 + (THINNING * (1.0 - 2.0 * b.t / b.duration) if is_other(x) else 0.0)
    b.drift_alpha += x["alpha_per_s"] * profile
    b.drift_beta += x["nozzle_per_s"] * profile


def bumpy_air(b: Build, x: Hidden) -> None:
    """The air is turbulent.  Other: a Dryden spectrum of second order."""
    b.wind += turbulence(b.random("bumpy_air"), math.radians(x["deg"]), x["time_s"], x.variant, b.t)


def shifting_wind(b: Build, x: Hidden) -> None:
    """The wind wanders.  Other: shear as a polygon."""
    b.wind += wandering(b.random("shifting_wind"), math.radians(x["deg_per_root_s"]), x.variant, b.t)


def late_servo(b: Build, x: Hidden) -> None:
    """The servo is late.  Other: jittered by JITTER, at least a sub-step, from one controller period to the next; the
    mean stays."""
    delay = 1e-3 * x["ms"]
    b.late += delay
    if is_other(x):
        b.late += max(JITTER * delay, SUBSTEP) * b.random("jitter").uniform(-1.0, 1.0, len(b.t_tick))


def lazy_servo(b: Build, x: Hidden) -> None:
    """The servo is slower.  Other: a first-order lag before the servo that delays slow commands as much (2 zeta/w);
    slower servos only."""
    scale = 1.0 + x["percent"] / 100.0
    craft = b.vehicle
    if is_other(x):
        b.set(servo_lag=2.0 * craft.servo_damping / craft.servo_frequency * (1.0 / scale - 1.0))
    else:
        b.set(servo_frequency=scale * craft.servo_frequency)


def servo_gain(b: Build, x: Hidden) -> None:
    """The servo's gain is off.  Other: the deviation settles over the first seconds."""
    settled = 1.0 - np.exp(-b.t_tick / SETTLING) if is_other(x) else 1.0
    b.servo_gain *= 1.0 + x["percent"] / 100.0 * settled


def valve_limit(b: Build, x: Hidden) -> None:
    """The servo's rate is limited.  Other: the rate bends softly into its limit, and the demand winds up a little."""
    b.set(rate_limit=math.radians(x["deg_per_s"]), soft=1.0 if is_other(x) else 0.0)


def washed_out(b: Build, x: Hidden) -> None:
    """The other form: LEAK of the slow part acts all the same."""
    b.set(washout=x["slow_s"], washout_leak=LEAK if is_other(x) else 0.0)


def servo_play(b: Build, x: Hidden) -> None:
    """The servo has backlash.  Other: with some Coulomb friction in the servo."""
    b.set(play=math.radians(x["deg"]))
    if is_other(x):
        b.set(servo_rub=RUB_SHARE * math.radians(x["deg"]) * b.vehicle.servo_frequency**2)


def servo_null(b: Build, x: Hidden) -> None:
    """The servo's zero is off.  Other: bent linkage between servo and nozzle, there from the first instant."""
    if is_other(x):
        b.set(linkage=math.radians(x["deg"]))
    else:
        b.servo_null += math.radians(x["deg"])


def tilted_platform(b: Build, x: Hidden) -> None:
    """The attitude has a constant error.  Other: it creeps."""
    b.attitude_bias += math.radians(x["deg"]) * (b.creep(b.t_sense) if is_other(x) else 1.0)


def late_platform(b: Build, x: Hidden) -> None:
    """The attitude is late.  Other: a first-order lag of the same time."""
    if is_other(x):
        b.set(attitude_lag=1e-3 * x["ms"])
    else:
        b.attitude_late += 1e-3 * x["ms"]


def gyro_offset(b: Build, x: Hidden) -> None:
    """The gyro has a constant error.  Other: it creeps."""
    b.gyro_bias += math.radians(x["deg_per_s"]) * (b.creep(b.t_sense) if is_other(x) else 1.0)


def gyro_percent(b: Build, x: Hidden) -> None:
    """The gyro's scale is off.  Other: it creeps."""
    b.gyro_gain *= 1.0 + x["percent"] / 100.0 * (b.creep(b.t_sense) if is_other(x) else 1.0)


def late_gyro(b: Build, x: Hidden) -> None:
    """The gyro is late.  Other: a first-order lag of the same time."""
    if is_other(x):
        b.set(gyro_lag=1e-3 * x["ms"])
    else:
        b.gyro_late += 1e-3 * x["ms"]


def pickup_offset(b: Build, x: Hidden) -> None:
    """The nozzle's sensor has a constant error.  Other: it creeps."""
    b.pickup_bias += math.radians(x["deg"]) * (b.creep(b.t_sense) if is_other(x) else 1.0)


def other_autopilot(b: Build, x: Hidden) -> None:
    """The controller is another one.  Other: its derivative filter follows the trapezoidal rule."""
    craft = b.vehicle
    b.set(kp=craft.kp * (1.0 + x["kp_percent"] / 100.0), kd=craft.kd * (1.0 + x["kd_percent"] / 100.0),
          trapezoid=1.0 if is_other(x) else 0.0)
    b.late_ticks += round(x["late_ticks"])


FITS: dict[str, Fit] = {fit.__name__: fit for fit in (
    thrust_percent, thrust_drop, aero_percent, rate_drag, aero_curve, bearing_rub, thrust_tilt, tank, flex,
    gust_pulse, wind, hum, late_servo, lazy_servo, servo_gain, valve_limit, servo_play, servo_null,
    tilted_platform, late_platform, gyro_offset, gyro_percent, late_gyro, pickup_offset, other_autopilot, engine_out,
    heavy_nozzle, thrust_trend, sideways, bumpy_air, shifting_wind, washed_out)}
