"""Margins out of a log alone: a6, k1 and damping from `identify`, servo and controller from the log.

The servo lies between the command and what acts.  Where the log has a nozzle's sensor, it is fitted to the commands
(`servo_check.servo_of`), and by what beta acts later than it is logged the delay is longer.  Where beta is the command,
the servo is what `identify` finds by how beta acts later: a delay, behind a lag of first order or two of half its
length.

The controller is the law that the commands follow (`controller.fit`), over the whole flight or window by window.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from launchid_core import Estimate

from ..log.log import Log
from ..weakform.late import Late
from . import flown as fl
from .airframe import Airframe, Damping, pooled_damping
from .flight_margins import UNKNOWN_MARK, Judged, Servo, WindowMargins, margins_of
from .servo_check import contradictions, servo_of, words

AS_FAST_AS_NONE = 2000.0   # rad/s, of a servo that does not lag
DAMPING = "theta_dot"   # the term whose coefficient is less the damping


class Alone(NamedTuple):
    """What a log alone tells: margins by window, the servo, the loop that flew."""

    windows: list[WindowMargins]
    servo: Servo
    flown: fl.Flown


def margins_alone(log: Log, estimates: Sequence[Estimate], covariances: Sequence[np.ndarray | None],
                  late: Late | None, delay: dict[str, Any] | None, asked: fl.Choice) -> Alone:
    """Return the margins of the windows that `identify` estimated without a nominal.

    covariances  of the terms of each window
    late, delay  by how much beta acts later than it is logged (`identify`): what is in a6 and k1; its JSON, None: not
                 known
    """
    if asked.source == fl.OF_NOMINAL:
        raise fl.UsageError("--controller nominal: expected a nominal; without one the controller is the log's")
    flown = fl.Flown([None] * len(estimates))
    commands, damping = with_commands(log), pooled_damping(estimates, covariances)
    reason = fl.fitted_laws(flown, commands, None, estimates, range(len(estimates)))
    servo, gain, gain_variance = _servo(flown, commands, estimates, late, delay)
    still = [k for k, each in enumerate(flown.judged) if each is None and k not in flown.refused]
    if still and np.isfinite(log.beta_cmd).any():
        reason = fl.likely_laws(flown, commands, None, estimates, [servo], still, damping) or reason
        still = [k for k in still if flown.judged[k] is None]
    if still:
        is_there = bool(np.isfinite(commands.beta_cmd).any())
        status = fl.CONTROLLER if is_there else fl.UNCHECKED
        _refuse(flown, still, status, f"no controller is found: {reason}", estimates)
    windows = []
    for k, (e, covariance) in enumerate(zip(estimates, covariances, strict=True)):
        controller = flown.judged[k]
        none = Judged(UNKNOWN_MARK)
        if k in flown.refused or controller is None:
            windows.append(WindowMargins(e.t_start, e.t_end, Judged(flown.refused.get(k, fl.UNCHECKED)), none))
            continue
        flown.judged[k] = controller = _asked(controller, asked)
        of_window = Judged(e.status.name)
        if e.valid:
            of_window = _of_window(e, covariance, servo, gain, gain_variance, controller, damping)
        windows.append(WindowMargins(e.t_start, e.t_end, of_window, none))
    return Alone(windows, servo, flown)


def with_commands(log: Log) -> Log:
    """Return the log with beta as its command where it has no other."""
    return log if np.isfinite(log.beta_cmd).any() else replace(log, beta_cmd=log.beta)


def _asked(controller: fl.Judged, asked: fl.Choice) -> fl.Judged:
    """Return the controller with given gains and factors."""
    if asked.source == fl.GIVEN:
        own = controller.law.gains()
        unknown = set(asked.given) - set(own)
        if unknown or "ki" in asked.given:
            raise fl.UsageError(f"--controller {min(unknown or {'ki'})}: without a nominal expected kp and kd alone")
        controller = replace(controller.scaled(**{name: x / own[name] for name, x in asked.given.items()}),
                             source=fl.GIVEN)
    return controller.scaled(asked.kp, asked.kd)


def _servo(flown: fl.Flown, log: Log, estimates: Sequence[Estimate], late: Late | None,
           delay: dict[str, Any] | None) -> tuple[Servo, float, float]:
    """Return the servo, its gain and the gain's variance; refuse windows in which it is another or not known."""
    period = next((each.law.period for each in flown.judged if each is not None), log.period)
    there = np.isfinite(log.beta) & np.isfinite(log.beta_cmd)
    if np.array_equal(log.beta[there], log.beta_cmd[there]):
        return _lag(flown, estimates, late, delay)
    made = servo_of(log, period)
    if isinstance(made, str):
        _refuse(flown, range(len(estimates)), fl.UNCHECKED, f"the servo cannot be fitted: {made}", estimates)
        return Servo(np.full(3, math.nan), np.zeros((3, 3))), 1.0, 0.0
    mean, covariance, follow = made
    windows = [(e.t_start, e.t_end) for e in estimates]
    found = contradictions(follow, windows, [(mean, covariance[:3, :3])] * len(windows)).found
    if another := [k for k, is_other in enumerate(found) if is_other]:
        _refuse(flown, another, fl.MODEL_MARK, "the nozzle does not answer the commands as one servo of second order "
                "does: " + words(follow, windows[another[-1]], mean[:3]), estimates)
    if untold := [k for k, each in enumerate(found) if each is None]:
        _refuse(flown, untold, fl.UNCHECKED, "the servo cannot be tested: too few rows", estimates)
    if late is not None:
        later = late.lead.value + late.lag[0]
        spread = (late.lead.std if math.isfinite(late.lead.std) else 0.0)**2 + late.lag[1]**2 + (0.5 * late.lag[0])**2
        mean[2] += later
        covariance[2, 2] += spread
        flown.assumed.append(f"that beta acts {1e3 * later:.3g} ms after it is logged is a delay of the loop")
    return Servo(mean[:3], covariance[:3, :3]), float(mean[3]), float(covariance[3, 3])


def _lag(flown: fl.Flown, estimates: Sequence[Estimate], late: Late | None,
         delay: dict[str, Any] | None) -> tuple[Servo, float, float]:
    """Return the servo of a log whose beta is the command: how much later it acts than it is logged."""
    if late is None and (delay is None or delay.get("std") is None):
        _refuse(flown, range(len(estimates)), fl.UNCHECKED, "beta is the command, and the log does not tell how much "
                "later it acts", estimates)
        return Servo(np.full(3, math.nan), np.zeros((3, 3))), 1.0, 0.0
    covariance = np.zeros((3, 3))
    if late is None:
        assert delay is not None
        covariance[2, 2] = float(delay["std"])**2
        return Servo(np.array([AS_FAST_AS_NONE, 1.0, 0.0]), covariance, True), 1.0, 0.0
    covariance[2, 2] = (late.lead.std if math.isfinite(late.lead.std) else late.lead.value)**2
    lag = late.lag[0] / late.order
    w = 1.0 / lag if lag > 0.0 else AS_FAST_AS_NONE
    covariance[0, 0] = (w * late.lag[1] / late.lag[0])**2 if lag > 0.0 else 0.0
    return Servo(np.array([w, 1.0, late.lead.value]), covariance, late.order == 1), 1.0, 0.0


def _refuse(flown: fl.Flown, windows: Sequence[int], status: str, why: str, estimates: Sequence[Estimate]) -> None:
    new = [k for k in windows if k not in flown.refused]
    flown.refused |= dict.fromkeys(new, status)
    if new:
        flown.findings.append(f"in {fl.counted(new, estimates)} {why} ({status})")


def _of_window(e: Estimate, covariance: np.ndarray | None, servo: Servo, gain: float, gain_variance: float,
               controller: fl.Judged, pooled: Damping) -> Judged:
    """Return the margins of a window's a6, k1 (with the servo's gain) and of the damping that all windows agree on."""
    a6, k1, shared = e.a6, e.k1, np.outer((e.a6_std, e.k1_std), (e.a6_std, e.k1_std)) \
        * [[1.0, e.a6_k1_corr], [e.a6_k1_corr, 1.0]]
    airframe = Airframe()
    if covariance is not None and {DAMPING, "theta", "beta"} <= set(e.terms):
        k, own = e.terms.index(DAMPING), [e.terms.index(term) for term in ("theta", "beta")]
        value, std = -float(e.xi[k, 1]), math.sqrt(covariance[k, k])
        slopes = -covariance[own, k] / covariance[k, k]
        if pooled.std < std:   # a6 and k1 with the damping of all windows
            a6, k1 = np.array([a6, k1]) + slopes * (pooled.value - value)
            value, std = pooled.value, pooled.std
        shared = covariance[np.ix_(own, own)] - np.outer(slopes, slopes) * covariance[k, k]
        airframe = Airframe(value, std, slopes=(float(slopes[0]), gain * float(slopes[1])))
    k1_std = math.sqrt(gain**2 * shared[1, 1] + k1**2 * gain_variance)
    rigid = (float(a6), gain * float(k1), math.sqrt(shared[0, 0]), k1_std,
             gain * float(shared[0, 1]) / (math.sqrt(shared[0, 0]) * k1_std))
    return margins_of(rigid, servo, controller, airframe)
