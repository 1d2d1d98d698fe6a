"""Show the loop of a log: the period of its commands, what the controller makes of theta, the speed of the servo."""

import math
from dataclasses import dataclass, replace

import numpy as np

from sim.nominal import Nominal

from .check import CheckedLog
from .detect import related
from .rates import HELD_WORD, OWN, rate_of
from .relations import NO_FIT, answered, control_fit
from .slope import Columns, block_means, regress

NOT_SLOWER = 1.1       # of the controller's period, that rows may be apart to show its commands
CHANGING = 0.5         # of the rows that have another command than the one before: each row has its own
SPEEDS = np.geomspace(1.0 / 8.0, 8.0, 33)  # of the servo, that are tried
SERVO_BLOCK = 0.04     # s: about a servo's own time, over which the nozzle's noise is averaged
FOLLOWS = 0.3          # of the variance of the nozzle's changes, that a servo of any speed explains at least


@dataclass(frozen=True)
class Loop:
    """The loop that a log shows; NaN where it does not tell.

    period     [s] at which commands change, if that is not hidden by rows as far apart as the nominal's period
    gain       of the commands on what the nominal's controller makes of theta;  explained  share of their variance
    speed      at which the nominal's servo explains the nozzle best, over its own
    """

    period: float = math.nan
    gain: float = math.nan
    explained: float = math.nan
    speed: float = math.nan


def loop_of(seen: CheckedLog, nominal: Nominal) -> Loop:
    """Return the loop that a log shows beside that of a nominal."""
    times, columns = related(seen.log, seen.data.usable, seen.data.masks)
    if not columns:
        return Loop(_command_period(seen, nominal))
    step, controller = float(times[1] - times[0]), nominal.controller
    fit = NO_FIT
    if controller is not None and controller.law == "attitude" and step <= NOT_SLOWER * controller.period:
        fit = control_fit(columns, "theta", "theta_ref", step, nominal, times)
    explained = math.nan if fit is NO_FIT else fit.explained
    return Loop(_command_period(seen, nominal), fit.gain[0], explained, _servo_speed(columns, step, nominal))


def _command_period(seen: CheckedLog, nominal: Nominal) -> float:
    """Return the period [s] at which commands change; NaN if rows are too far apart to tell it from the nominal's."""
    log, controller = seen.log, nominal.controller
    if controller is None or "beta_cmd" not in log.columns:
        return math.nan
    rate = rate_of(log.t, log.beta_cmd)
    if rate.kind == HELD_WORD:
        return rate.period
    known = log.beta_cmd[np.isfinite(log.beta_cmd)]
    is_own = rate.kind == OWN and len(known) > 1 and float(np.mean(np.diff(known) != 0.0)) > CHANGING
    return log.period if is_own and log.period < controller.period else math.nan


def _servo_speed(columns: Columns, period: float, nominal: Nominal) -> float:
    """Return the speed at which the nominal's servo explains the nozzle best, over its own; NaN if none does."""
    servo = nominal.actuator
    if servo is None or not {"beta", "beta_cmd"} <= set(columns) or servo.lag + servo.delay < period:
        return math.nan
    rows = max(1, round(SERVO_BLOCK / period))
    moved = np.diff(block_means(columns["beta"], rows))
    told = []
    for speed in SPEEDS.tolist():
        other = replace(servo, natural_frequency=speed * servo.natural_frequency,
                        time_constant=servo.time_constant / speed, delay=servo.delay / speed)
        answer = answered(columns["beta_cmd"], period, replace(nominal, actuator=other))
        told.append(regress(moved, [np.diff(block_means(answer, rows))]).explained)
    best = int(np.argmax(told))
    return float(SPEEDS[best]) if told[best] > FOLLOWS else math.nan
