"""Gain, phase and delay margins of a flight from its estimates: of every window, and of the tracked estimate at its
end.

Loop: the nominal's controller around the rigid launcher as identified, a6 and k1 frozen (at the window's centre, or
tracked at its end), behind the servo: the nominal's or, where the nominal declares it uncertain, the one estimated by
the window's end.  Errors of the servo are in a6, k1 and their covariance already; the correlation between their errors
and the servo's is left out (`docs/margins.md` says how that was checked).

No margins has: a window that the estimator refuses; a window in which a6 or k1 changed suddenly (status CHANGE), nor
the tracked estimate until CHANGE_SETTLED after it, since no frozen loop is that flight's; and a window in which another
loop flew: its commands are not the nominal controller's (CONTROLLER), or its nozzle does not answer them as the servo
does (MODEL).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from launchid_core import Change, Estimate
from sim.effects import values
from sim.errors import InputError
from sim.nominal import Nominal
from sim.sections import SERVO, Required

from ..controller.replay import MIN_COMMANDS, Replay, replay, rms
from ..log.log import Log
from ..onboard import onboard_model
from ..shown import servo_lines
from .lft import refuse_foreign_loop
from .margin_spread import MARGIN_NAMES, MARGINS, Known, Spread, json_number, margin_spread
from .servo_check import contradictions, followed, words

# of what has margins or has none; else the estimator's own status
OK_MARK, CHANGE_MARK, UNKNOWN_MARK = "OK", "CHANGE", "UNKNOWN"
CONTROLLER, MODEL_MARK = "CONTROLLER", "MODEL"    # another controller flew, another servo
FROZEN = "no bending, slosh, lateral drift, limit of angle or rate in the loop, all of which stands still"
DECLARE = "; declare natural_frequency_sigma, damping_ratio_sigma, delay_sigma in [actuator], and it is estimated"
CHANGE_SETTLED = 2.0  # s after a sudden change, when its size is final
NO_MARGIN = {"value": None, "std": None, "low": None, "high": None}
OTHER_LOOP = ("aero_damping", "actuator_gain")    # effects that the estimator knows of and the frozen loop does not


class Servo(NamedTuple):
    """What is known of a servo: natural frequency [rad/s], damping ratio, delay [s] (3,), their covariance (3, 3)."""

    mean: np.ndarray
    covariance: np.ndarray


class Judged(NamedTuple):
    """Margins of one estimate (`spread`), and its a6, k1 and servo (`known`); both None unless `status` is "OK"."""

    status: str
    known: Known | None = None
    spread: Spread | None = None

    @property
    def valid(self) -> bool:
        return self.spread is not None


class WindowMargins(NamedTuple):
    """Margins of a window's own a6 and k1 (`window`) and of the estimate tracked at its end (`tracked`); times [s]."""

    t_start: float
    t_end: float
    window: Judged
    tracked: Judged


def declared_servo(nominal: Nominal) -> Servo:
    """Return a nominal's servo, its sigma as covariance; InputError if the loop is not rigid body, servo and PD."""
    nominal.require("actuator", "controller")
    refuse_foreign_loop(nominal, "the frozen loop")
    for effect in nominal.effects:
        given = values(effect)
        is_neutral = given.get("scale", 1.0) == 1.0 and given.get("coefficient", 0.0) == 0.0
        if effect.name in OTHER_LOOP and not is_neutral:
            raise InputError(f"{nominal.path}: effect {effect.name!r}: the frozen loop has no model of it; expected a "
                             "nominal without it")
    model = onboard_model(nominal)
    sigma = (model.natural_frequency_sigma * model.natural_frequency, model.damping_ratio_sigma * model.damping_ratio,
             model.delay_sigma)
    return Servo(np.array([model.natural_frequency, model.damping_ratio, model.delay]), np.diag(np.square(sigma)))


def servo_at(declared: Servo, e: Estimate) -> Servo:
    """Return the servo that estimate `e` holds at its window's end; `declared` if the servo is not estimated."""
    if e.actuator is None:
        return declared
    mean, std = np.array([(each.value, each.std) for each in e.actuator.values()]).T
    first, second, third = e.actuator_corr
    shared = np.array([[1.0, first, second], [first, 1.0, third], [second, third, 1.0]])
    return Servo(mean, np.outer(std, std) * shared)


def last_servo(declared: Servo, estimates: Sequence[Estimate]) -> Servo:
    """Servo of the last window whose estimate is finite (the model was not contradicted); `declared` if there is
    none."""
    shown = (servo_at(declared, e) for e in reversed(estimates))
    return next((servo for servo in shown if np.isfinite(servo.mean).all()), declared)


@dataclass
class Flown:
    """Whether the nominal's controller and servo flew; margins hold for them alone.

    refused   window number -> status (CONTROLLER or MODEL), of the windows in which another loop flew
    findings  sentences on them;  assumed  sentences on what the log cannot test
    """

    refused: dict[int, str] = field(default_factory=dict)
    findings: list[str] = field(default_factory=list)
    assumed: list[str] = field(default_factory=lambda: [FROZEN])


def loop_that_flew(log: Log, nominal: Nominal, estimates: Sequence[Estimate]) -> Flown:
    """Return for each window whether the log's commands are the nominal controller's and its nozzle the servo's."""
    flown = Flown()
    replayed, follows = replay(log, nominal), followed(log, onboard_model(nominal))
    if isinstance(replayed, str):
        flown.assumed.append(f"the controller is the nominal's (not tested: {replayed})")
    else:
        _test_controller(flown, replayed, estimates)
    if isinstance(follows, str):
        flown.assumed.append(f"the servo is as declared, and does not change (not tested: {follows})")
    else:
        declared = declared_servo(nominal)
        servos = [servo_at(declared, e) for e in estimates]
        windows = [(e.t_start, e.t_end) for e in estimates]
        asked = contradictions(follows, windows, servos)
        found = asked.found
        if not declared.covariance.any() and np.isfinite(asked.shown).all():
            w, zeta, delay = asked.shown
            flown.assumed.append(f"the servo's numbers are those declared: differences below {w:.2g} rad/s, "
                                 f"{zeta:.2g} of the damping ratio, {1e3 * delay:.2g} ms of delay would not have shown"
                                 + DECLARE)
        _note(flown.assumed, "the servo does not change", [each is None for each in found])
        if another := [k for k, is_other in enumerate(found) if is_other]:
            flown.refused |= {k: MODEL_MARK for k in another if k not in flown.refused}
            flown.findings.append(
                f"in {_count(another, estimates)} the nozzle does not answer the commands as the servo does (MODEL): "
                + words(follows, windows[another[-1]], servos[another[-1]].mean)
                + DECLARE * (not declared.covariance.any()))
    return flown


def _test_controller(flown: Flown, replayed: Replay, estimates: Sequence[Estimate]) -> None:
    judged = [replayed.judged(e.t_start, e.t_end) for e in estimates]
    few = [int(np.count_nonzero(ticks)) < MIN_COMMANDS for ticks in judged]
    _note(flown.assumed, "the controller is the nominal's", few)
    others = [k for k, ticks in enumerate(judged) if not few[k] and replayed.contradicts(ticks)]
    if others:
        flown.refused |= dict.fromkeys(others, CONTROLLER)
        ticks = np.any([judged[k] for k in others], axis=0)
        flown.findings.append(
            f"in {_count(others, estimates)} the commands are not the nominal controller's (CONTROLLER): rms "
            f"{rms(replayed.misfit[ticks]):.2g} rad apart, {replayed.tolerance:.2g} would be none; "
            f"{replayed.words(replayed.explained(ticks))}")


def _count(which: Sequence[int], estimates: Sequence[Estimate]) -> str:
    """Return how many windows `which` (numbers) lists, and from when on: `3 of 14 windows, from 30 s on,`."""
    return f"{len(which)} of {len(estimates)} windows, from {estimates[which[0]].t_start:g} s on,"


def _note(assumed: list[str], what: str, unasked: Sequence[bool]) -> None:
    if any(unasked):
        assumed.append(f"{what} (not tested in {sum(unasked)} of {len(unasked)} windows: too few rows)")


def flight_margins(nominal: Nominal, estimates: Sequence[Estimate], changes: Sequence[Change],
                   refused: Mapping[int, str] | None = None) -> list[WindowMargins]:
    """Return the margins of each window (estimate) with the nominal's controller; InputError as `declared_servo`.

    refused  window number -> status, of windows in which another loop flew: they get this status and no margins
    """
    declared, windows = declared_servo(nominal), []
    for k, e in enumerate(estimates):
        if refused is not None and k in refused:
            of_window = of_tracked = Judged(refused[k])
        else:
            servo = servo_at(declared, e)
            of_window, of_tracked = _of_window(nominal, e, changes, servo), _of_tracked(nominal, e, changes, servo)
        windows.append(WindowMargins(e.t_start, e.t_end, of_window, of_tracked))
    return windows


def _of_window(nominal: Nominal, e: Estimate, changes: Sequence[Change], servo: Servo) -> Judged:
    if not e.valid:
        return Judged(e.status.name)
    if any(e.t_start < change.t < e.t_end for change in changes):
        return Judged(CHANGE_MARK)
    return judged(nominal, (e.a6, e.k1, e.a6_std, e.k1_std, e.a6_k1_corr), servo)


def _of_tracked(nominal: Nominal, e: Estimate, changes: Sequence[Change], servo: Servo) -> Judged:
    if e.status.name == MODEL_MARK:
        return Judged(MODEL_MARK)
    if e.tracked is None or not e.tracked.valid:
        return Judged(UNKNOWN_MARK)
    if any(change.t <= e.t_end < change.t + CHANGE_SETTLED for change in changes):
        return Judged(CHANGE_MARK)
    return judged(nominal, tuple(e.tracked)[1:], servo)


def judged(nominal: Nominal, rigid: Sequence[float], servo: Servo, gains: tuple[float, float] | None = None) -> Judged:
    """Return the margins with `rigid` = (a6, k1 [1/s^2], their two stds, their correlation), the nominal's controller
    and `servo`; gains (kp, kd [s]) replace the controller's.  Status UNKNOWN and no margins if a number is not
    finite."""
    if not all(map(math.isfinite, (*rigid, *servo.mean.tolist()))):
        return Judged(UNKNOWN_MARK)
    a6, k1, a6_std, k1_std, correlation = rigid
    covariance = np.zeros((5, 5))
    covariance[:2, :2] = np.outer((a6_std, k1_std), (a6_std, k1_std)) * [[1.0, correlation], [correlation, 1.0]]
    covariance[2:, 2:] = servo.covariance
    known = Known(np.array([a6, k1, *servo.mean]), covariance)
    assert nominal.controller is not None
    return Judged(OK_MARK, known, margin_spread(known, nominal.controller, *(gains or ())))


# ---- the answer


def interval_json(spread: Spread, name: str) -> dict[str, float | None]:
    """Return value, std, low, high of margin `name`; None for what is not finite."""
    return {key: json_number(x) for key, x in getattr(spread, name)._asdict().items()}


def margins_json(judgement: Judged) -> dict[str, Any]:
    """Return one estimate's margins as JSON: valid, status, value/std/low/high of each of MARGIN_NAMES, stable."""
    spread = judgement.spread
    said: dict[str, Any] = {"valid": judgement.valid, "status": judgement.status}
    for name in MARGIN_NAMES:
        said[name] = dict(NO_MARGIN) if spread is None else interval_json(spread, name)
    return said | {"stable": {"probability": None if spread is None else spread.stable}}


def below_json(windows: Sequence[WindowMargins], required: Required, is_tracked: bool) -> list[dict[str, Any]]:
    """Return a row per margin whose 95 % interval begins below `required`; `certain`: it ends there too.  is_tracked:
    also those of the tracked estimate."""
    rows: list[dict[str, Any]] = []
    for each in windows:
        for estimate, judgement in (("window", each.window), *((("tracked", each.tracked),) if is_tracked else ())):
            if judgement.spread is None:
                continue
            for name, certain in judgement.spread.below(required).items():
                rows.append({"t_start": each.t_start, "t_end": each.t_end, "estimate": estimate, "margin": name,
                             "required": required_of(required, name), **interval_json(judgement.spread, name),
                             "certain": certain})
    return rows


def miss_words(spread: Spread, name: str, required: Required) -> str:
    """Return the margin `name`, its 95 % interval and the required value as text, for a margin that may be below it."""
    unit = MARGINS[name].unit
    return (f"{MARGINS[name].words} {interval_words(interval_json(spread, name), unit)} {unit}, required "
            f"{required_of(required, name):g}")


def required_of(required: Required, name: str) -> float:
    """Return the required value of margin `name` (one of MARGIN_NAMES), below 0 for `gain_low_db`."""
    return MARGINS[name].sign * float(getattr(required, MARGINS[name].required))


def report(windows: Sequence[WindowMargins], servo: Servo, required: Required, is_tracked: bool,
           flown: Flown) -> dict[str, Any]:
    """Return the JSON of `launchid margins`: windows, actuator (`servo`), margins below and maybe below `required`,
    findings, assumed.  is_tracked: with the tracked estimates' margins."""
    reached = below_json(windows, required, is_tracked)
    std = np.sqrt(np.diag(servo.covariance))
    return {"windows": [{"t_start": each.t_start, "t_end": each.t_end, **margins_json(each.window),
                         **({"tracked": margins_json(each.tracked)} if is_tracked else {})} for each in windows],
            "actuator": {name: {"value": float(servo.mean[k]), "std": float(std[k])} for k, name in enumerate(SERVO)},
            "below": [{key: x for key, x in each.items() if key != "certain"} for each in reached if each["certain"]],
            "may_be_below": [{key: x for key, x in each.items() if key != "certain"} for each in reached
                             if not each["certain"]],
            "findings": flown.findings, "assumed": flown.assumed}


def interval_words(interval: dict[str, float | None], unit: str = "") -> str:
    """Return a value and its interval as text, `37.51 (36.38..38.57)`; a None is inf or -inf, all None are "-"."""
    if interval["value"] is None and interval["low"] is None and interval["high"] is None:
        return "-"
    decimals = 1 if unit == "ms" else 2
    bottom, top = ("-inf" if interval["high"] is not None else "inf"), "inf"
    value, low, high = (other if interval[key] is None else f"{interval[key]:.{decimals}f}"
                        for key, other in (("value", bottom), ("low", "-inf"), ("high", top)))
    return f"{value} ({low}..{high})"


def table(said: dict[str, Any]) -> str:
    """Return the JSON of `report` as text for a terminal: a line per window, servo, margins too low, findings."""
    heads = [f"{MARGINS[name].words} [{MARGINS[name].unit}]" for name in MARGIN_NAMES]
    lines = [f"{'t_start':>9} {'t_end':>9} {'of':<8} {'status':<15} " + " ".join(f"{head:>26}" for head in heads)
             + f" {'P(stable)':>10}"]
    for window in said["windows"]:
        for estimate, one in (("window", window), *((("tracked", window["tracked"]),) if "tracked" in window else ())):
            cells = " ".join(f"{interval_words(one[name], MARGINS[name].unit):>26}" for name in MARGIN_NAMES)
            stable = one["stable"]["probability"]
            lines.append(f"{window['t_start']:>9.3f} {window['t_end']:>9.3f} {estimate:<8} {one['status']:<15} {cells} "
                         f"{'-' if stable is None else f'{stable:.4f}':>10}")
    lines += servo_lines(said["actuator"])
    lines += [*below_lines(said["below"], "is"), *below_lines(said["may_be_below"], "may be")]
    lines += [*said["findings"], *(f"assumed: {each}" for each in said["assumed"])]
    return "\n".join([*lines, *closing_lines(said)])


def closing_lines(said: dict[str, Any]) -> list[str]:
    """Return how many windows of `said` (the JSON of `report`) have margins and keep the required ones, as text; for
    the window's and for the tracked estimates."""
    lines = []
    for of in ("window", "tracked"):
        there = [window for window in said["windows"] if (window | window.get(of, {}))["valid"]]
        missed = {each["t_start"] for each in said["below"] + said["may_be_below"] if each["estimate"] == of}
        kept = sum(window["t_start"] not in missed for window in there)
        if there and (of == "window" or of in said["windows"][0]):
            who = "of those " + ("all keep" if kept == len(there) else f"{kept} keep" if kept else "none keeps")
            lines.append(f"{len(there)} of {len(said['windows'])} windows have margins{' tracked' * (of == 'tracked')}"
                         f"; {who} what [margins] requires, with the whole 95 % interval")
    return lines


def below_lines(reached: list[dict[str, Any]], verb: str) -> list[str]:
    """Return a line per margin and estimate of `reached` (rows of `below_json`): how many windows, and the worst.
    verb: "is" or "may be"."""
    lines = []
    for name in MARGIN_NAMES:
        for estimate in ("window", "tracked"):
            rows = [each for each in reached if each["margin"] == name and each["estimate"] == estimate]
            if not rows:
                continue
            worst = (max if name == "gain_low_db" else min)(
                rows, key=lambda each: -math.inf if each["value"] is None else each["value"])
            lines.append(f"{MARGINS[name].words} ({estimate}) {verb} below {abs(rows[0]['required']):g} "
                         f"{MARGINS[name].unit} in {len(rows)} window{'s' * (len(rows) > 1)}, worst "
                         f"{interval_words(worst, MARGINS[name].unit)} in {worst['t_start']:g}..{worst['t_end']:g} s")
    return lines
