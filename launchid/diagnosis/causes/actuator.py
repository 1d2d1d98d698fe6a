"""Causes in the servo, and its other physical forms: a first-order lag, a rate limit that winds up."""

import math

import numpy as np

from ..data.record import Record
from .hypothesis import (
    FAR_DELAYS,
    Correction,
    Form,
    Free,
    Hypothesis,
    Values,
    as_commanded,
    as_deflected,
    as_timed,
    by_its_size,
    command_moves,
    far_delays,
    only_start,
    size,
)

RATE_SHARES = (0.02, 0.04, 0.07, 0.12, 0.2, 0.35)  # of the fastest command: the servo follows a part of it
FASTEST = 0.999        # quantile of the command's rate that counts as its largest
PLAYS = (3e-4, 1e-3, 3e-3, 1e-2)    # rad
FIRST_WIND_UP = 0.3    # from where its search starts, and the share of the rate limit that it makes up for
MOST_WIND_UP = 20.0
RATE = Free("rate", 0.01, 1e-3, 50.0, logarithmic=True)  # rad/s
SLOWEST = 1e-3         # of a fast servo's frequency: a lag of 0.3 s where one of 1 ms is believed
WASHOUT = Free("time_constant", 0.05, 0.02, 1e3, logarithmic=True)  # s
WASHOUTS = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)  # s
NOZZLE_SENSOR = "the nozzle sensor"
FAST_NOZZLE_SENSOR = "the nozzle sensor several times as often as commands come"
LIKE_A_DELAY = "a first-order lag of the servo is like a delay"


def _rates(record: Record) -> list[float]:
    """Rate limits [rad/s] that would bind on this log's command."""
    smooth = np.diff(record.commands) / (record.tick * record.step)
    largest = float(np.quantile(np.abs(smooth), FASTEST)) if len(smooth) else 0.0
    return [share * largest for share in RATE_SHARES if largest > 0.0]


def _plays(record: Record) -> list[float]:
    return list(PLAYS)


def _washouts(record: Record) -> list[float]:
    return list(WASHOUTS)


def _as_lag(record: Record, values: Values) -> Values:
    """A lag as late as the delay [s]."""
    servo = record.actuator
    return (1.0 / (1.0 + values[0] / servo.lag),)


def _by_its_lag(record: Record, scale: float) -> float:
    """The time [s] by which a scaled bandwidth is late."""
    return (1.0 / scale - 1.0) * record.actuator.lag


def _far_lags(record: Record) -> Values:
    """Scales that are as late as the delays from which a search starts."""
    return tuple(1.0 / (1.0 + delay / record.actuator.lag) for delay in FAR_DELAYS)


def _as_slow(record: Record, values: Values) -> Values:
    return (min(values[0], 1.0),)


def _ahead(record: Record, values: Values) -> Values:
    """The lower limit that a servo wound up keeps to as often."""
    return values[0] / (1.0 + FIRST_WIND_UP), FIRST_WIND_UP


SLOWER = "the servo's natural frequency is {scale} of the simulated one"
SLOW_AS_LAG = "a first-order lag makes the servo as slow as {scale} of its natural frequency would"
LIMITED = "the nozzle cannot move faster than {rate}"
LIMITED_WOUND_UP = "the nozzle cannot move faster than {rate}, and what is asked of it runs ahead by {wind_up} of that"

LAG = Hypothesis("actuator_bandwidth", (Free("scale", 0.02, SLOWEST, 1.0, logarithmic=True),), 1.0, SLOW_AS_LAG,
                 visible=command_moves, fixed=(("lag", 1.0),))
WIND_UP = Hypothesis("actuator_rate_limit", (RATE, size("wind_up", 0.05, 0.0, MOST_WIND_UP)), math.inf,
                     LIMITED_WOUND_UP, lambda record: [(FIRST_WIND_UP,)], command_moves, _rates)

CAUSES = (
    Hypothesis("actuator_delay", (size("delay", 1e-3, 0.0, 1.0),), 0.0,
               "the actuator answers {delay} later than simulated", visible=command_moves, far=far_delays,
               form=Form(LAG, _as_lag, "lag"), decides=(("actuator_bandwidth", FAST_NOZZLE_SENSOR),),
               like=(("actuator_bandwidth", LIKE_A_DELAY),), floor=as_timed, late=by_its_size),
    Hypothesis("actuator_bandwidth", (Free("scale", 0.02, SLOWEST, 5.0, logarithmic=True),), 1.0, SLOWER,
               visible=command_moves, far=_far_lags, late=_by_its_lag, form=Form(LAG, _as_slow, "lag")),
    Hypothesis("actuator_gain", (size("scale", 0.005, -3.0, 5.0),), 1.0,
               "the servo moves {scale} of what is commanded (a nozzle sensor that shows so much of it looks the same "
               "within the tolerance of k1)", visible=command_moves,
               decides=(("control_effectiveness", NOZZLE_SENSOR),), twin="control_effectiveness",
               corrections=(Correction("beta_cmd", lambda x, of: x * of["scale"]),)),
    Hypothesis("actuator_rate_limit", (RATE,), math.inf, LIMITED, only_start, command_moves, _rates,
               form=Form(WIND_UP, _ahead, "wind_up")),
    Hypothesis("actuator_backlash", (size("half_width", 5e-5, 0.0, 0.2),), 0.0,
               "the servo has a play of {half_width} each way", only_start, command_moves, _plays, dithered=0.1),
    Hypothesis("actuator_bias", (size("angle", 1e-4),), 0.0, "the servo's null is off by {angle}",
               visible=command_moves,
               decides=tuple((other, NOZZLE_SENSOR) for other in ("thrust_misalignment", "steady_wind",
                                                                  "attitude_bias")),
               corrections=(Correction("beta_cmd", lambda x, of: x + of["angle"], is_outer=True),), floor=as_commanded,
               held=as_deflected),
    Hypothesis("input_washout", (WASHOUT,), math.inf,
               "the input washes out: what acts is less its slow part, of a time constant of {time_constant}",
               only_start, command_moves, _washouts),
)
