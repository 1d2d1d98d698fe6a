"""Margins of a flight from its estimates: of every window, and of the tracked estimate at its end.

Loop: the controller that flew (`flown`), or another one that is asked about, around the launcher as identified, a6 and
k1 frozen (at the window's centre, or tracked at its end), behind the servo: the nominal's or, where the nominal
declares it uncertain, the one estimated by the window's end.  Errors of the servo are in a6, k1 and their covariance
already; the correlation between their errors and the servo's is left out (`docs/margins.md` says how that was checked).

No margins has: a window that the estimator refuses; a window in which a6 or k1 changed suddenly (status CHANGE), nor
the tracked estimate until CHANGE_SETTLED after it, since no frozen loop is that flight's; and a window whose loop is
not known: commands that no law explains (CONTROLLER), a nozzle that does not answer them as the servo does (MODEL), or
what cannot be asked (UNCHECKED).
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from launchid_core import Change, Estimate
from sim.nominal import Nominal
from sim.onboard import onboard_model
from sim.sections import SERVO, Required

from ..formatting import json_number, servo_lines
from . import flown as fl
from .airframe import Airframe, Damping, airframe_of
from .gains import allowed, telling
from .margin_spread import MARGIN_NAMES, MARGINS, RIGID, Known, Spread, joined, margin_spread

# of what has margins or has none; else the estimator's own status
OK_MARK, CHANGE_MARK, UNKNOWN_MARK = "OK", "CHANGE", "UNKNOWN"
CHANGE_SETTLED = 2.0  # s after a sudden change, when its size is final
MOST_SHARED = 0.99     # of a variance of a6 and k1, by what they share with the modes' numbers
NO_MARGIN = {"value": None, "std": None, "low": None, "high": None}
Servo = fl.Servo


class Judged(NamedTuple):
    """Margins of one estimate (`spread`), its numbers (`known`) and its controller; None unless `status` is "OK"."""

    status: str
    known: Known | None = None
    spread: Spread | None = None
    controller: fl.Judged | None = None

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
    """Return a nominal's servo, its sigma as covariance; InputError if the filter has no model of a part."""
    nominal.require("actuator")
    model = onboard_model(nominal)
    if model.time_constant > 0.0:
        return Servo(np.array([1.0 / model.time_constant, 1.0, model.delay]),
                     np.diag([0.0, 0.0, model.delay_sigma**2]), True)
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


def last_servo(servos: Sequence[Servo], declared: Servo) -> Servo:
    """Return the servo of the last window whose estimate is finite (the model was not contradicted); `declared` if
    there is none."""
    return next((servo for servo in reversed(servos) if np.isfinite(servo.mean).all()), declared)


def flight_margins(estimates: Sequence[Estimate], changes: Sequence[Change], flown: fl.Flown, servos: Sequence[Servo],
                   nominal: Nominal, is_tracked: bool = True, damping: Damping | None = None) -> list[WindowMargins]:
    """Return the margins of each window (estimate) with the controller that is judged in it.

    is_tracked  also those of the tracked estimates, which else are UNKNOWN;  damping  how well the log tells it
    """
    windows = []
    for k, e in enumerate(estimates):
        controller = flown.judged[k]
        if k in flown.refused or controller is None:
            of_window = of_tracked = Judged(flown.refused.get(k, fl.UNCHECKED))
        else:
            servo = servos[k] if flown.servo is None else flown.servo
            middle, seen = 0.5 * (e.t_start + e.t_end), getattr(e, "modes", ())
            shared = getattr(e, "modes_covariance", None)
            of_window = _of_window(e, changes, servo, controller, airframe_of(nominal, middle, seen, damping, shared))
            of_tracked = Judged(UNKNOWN_MARK)
            if is_tracked:
                of_tracked = _of_tracked(e, changes, servo, controller,
                                         airframe_of(nominal, e.t_end, seen, damping, shared))
        windows.append(WindowMargins(e.t_start, e.t_end, of_window, of_tracked))
    return windows


def _of_window(e: Estimate, changes: Sequence[Change], servo: Servo, controller: fl.Judged,
               airframe: Airframe) -> Judged:
    if not e.valid:
        return Judged(e.status.name)
    if any(e.t_start < change.t < e.t_end for change in changes):
        return Judged(CHANGE_MARK)
    return margins_of((e.a6, e.k1, e.a6_std, e.k1_std, e.a6_k1_corr), servo, controller, airframe)


def _of_tracked(e: Estimate, changes: Sequence[Change], servo: Servo, controller: fl.Judged,
                airframe: Airframe) -> Judged:
    if e.status.name == fl.MODEL_MARK:
        return Judged(fl.MODEL_MARK)
    if e.tracked is None or not e.tracked.valid:
        return Judged(UNKNOWN_MARK)
    if any(change.t <= e.t_end < change.t + CHANGE_SETTLED for change in changes):
        return Judged(CHANGE_MARK)
    return margins_of(tuple(e.tracked)[1:], servo, controller, airframe)


def margins_of(rigid: Sequence[float], servo: Servo, controller: fl.Judged, airframe: Airframe) -> Judged:
    """Return the margins of a loop; status UNKNOWN and no margins if a number is not finite.

    rigid  a6, k1 [1/s^2], their two standard deviations, their correlation
    """
    if not all(map(math.isfinite, (*rigid, *servo.mean.tolist()))):
        return Judged(UNKNOWN_MARK)
    a6, k1, a6_std, k1_std, correlation = rigid
    has_damping = airframe.damping != 0.0 or airframe.damping_std > 0.0
    modes = airframe.modes
    count = 6 + 2 * len(modes) if modes else 6 if has_damping else 5
    mean, covariance = np.zeros(count), np.zeros((count, count))
    mean[:5] = a6, k1, *servo.mean
    covariance[:2, :2] = np.outer((a6_std, k1_std), (a6_std, k1_std)) * [[1.0, correlation], [correlation, 1.0]]
    covariance[2:5, 2:5] = servo.covariance
    if count > 5:
        mean[5], covariance[5, 5] = airframe.damping, airframe.damping_std**2
        moved = np.array(airframe.slopes) * airframe.damping_std   # of a6 and k1, which were fitted with this damping
        covariance[:2, :2] += np.outer(moved, moved)
        covariance[:2, 5] = covariance[5, :2] = moved * airframe.damping_std
        mean[6:] = [float(x) for mode in modes for x in (mode.frequency, mode.size)]
        covariance[6:, 6:] = np.diag(np.square(airframe.modes_std))
        if airframe.modes_shared is not None and airframe.modes_shared.size:
            share_modes(covariance, airframe.modes_shared)
    controller = _following(controller, airframe)
    known = [_with_law(mean, covariance, count, servo, each, airframe) for each in controller.each]
    spread = joined([margin_spread(one, each.law) for one, each in zip(known, controller.each, strict=True)])
    return Judged(OK_MARK, known[0], spread, controller)


def share_modes(covariance: np.ndarray, shared: np.ndarray) -> None:
    """Fill in what the modes' numbers have in common with a6 and k1 and with each other.

    covariance (6 + 2 m, 6 + 2 m) inout  of a window, or tracked: with deviations of the modes' numbers as reported
    shared     (2 + 2 m, 2 + 2 m)  of the modes' filter. What a reported number, or a6 and k1, doubt beyond it is theirs
    alone: the errors of a least-squares fit share with those of its nuisance, as the filter tracks it, the slope in
    the nuisance times its variance.
    """
    own, said = np.sqrt(np.diag(shared)[2:]), np.sqrt(np.diag(covariance)[6:])
    scale = np.where(own > 0.0, own, 1.0)
    correlation = shared[2:, 2:] / np.outer(scale, scale)
    np.fill_diagonal(correlation, 1.0)
    among, cross = correlation * np.outer(said, said), shared[:2, 2:] * (np.minimum(said, own) / scale)
    is_open = said > 0.0
    common = cross[:, is_open] @ np.linalg.solve(among[np.ix_(is_open, is_open)], cross[:, is_open].T)
    share = float(np.max(np.linalg.eigvals(np.linalg.solve(covariance[:2, :2], common)).real, initial=0.0))
    covariance[:2, 6:] = cross * math.sqrt(min(MOST_SHARED / share, 1.0)) if share > 0.0 else cross
    covariance[6:, :2] = covariance[:2, 6:].T
    covariance[6:, 6:] = among


def _with_law(mean: np.ndarray, covariance: np.ndarray, count: int, servo: Servo, controller: fl.Judged,
              airframe: Airframe) -> Known:
    """Return what is known of a loop with the numbers of a law that was fitted beside the plant's `count`."""
    laws = None
    if controller.fitted is not None and controller.fitted.covariance.any():
        numbers, fitted = len(controller.fitted.numbers), controller.fitted
        covariance = np.block([[covariance, np.zeros((count, numbers))],
                               [np.zeros((numbers, count)), fitted.covariance]])
        mean, laws = np.append(mean, fitted.numbers), controller.laws
    return Known(mean, covariance, count, servo.is_first_order, airframe.modes, laws, airframe.gain, airframe.further)


def _following(controller: fl.Judged, airframe: Airframe) -> fl.Judged:
    """Return the nominal's controller with filters that follow a mode where the mode is believed."""
    own = controller.controller
    if own is None or not own.followed:
        return controller
    tuned = own.following({mode.name: float(mode.frequency) for mode in airframe.modes})
    return replace(controller, controller=tuned, law=fl.law_of(tuned, late=controller.late))


def judged(nominal: Nominal, rigid: Sequence[float], servo: Servo, gains: tuple[float, float] | None = None,
           fitted: fl.Judged | None = None) -> Judged:
    """Return the margins with `rigid` = (a6, k1 [1/s^2], their two stds, their correlation), the nominal's controller
    and `servo`; gains (kp, kd [s]) replace the controller's.  Status UNKNOWN and no margins if a number is not
    finite.

    fitted  the controller that a log told (`WindowMargins.window.controller`), in place of the nominal's
    """
    if fitted is not None:
        if gains is not None:
            old = fitted.law.gains()
            fitted = fitted.scaled(gains[0] / old["kp"], gains[1] / old["kd"])
        return margins_of(rigid, servo, fitted, airframe_of(nominal))
    own = fl.of_nominal(nominal)
    assert own.controller is not None
    if gains is not None:
        own = fl.Judged(fl.OF_NOMINAL, fl.law_of(own.controller, *gains, late=own.late), controller=own.controller)
    return margins_of(rigid, servo, own, airframe_of(nominal))


# ---- the answer


def interval_json(spread: Spread, name: str) -> dict[str, float | None]:
    """Return value, std, low, high of margin `name`; None for what is not finite."""
    return {key: json_number(x) for key, x in getattr(spread, name)._asdict().items()}


def margins_json(judgement: Judged) -> dict[str, Any]:
    """Return one estimate's margins as JSON: valid, status, value/std/low/high of each of MARGIN_NAMES, stable, ms,
    crossover [rad/s], controller; of a loop with modes also the margins of the rigid crossings and of each mode."""
    spread = judgement.spread
    said: dict[str, Any] = {"valid": judgement.valid, "status": judgement.status}
    for name in MARGIN_NAMES:
        said[name] = dict(NO_MARGIN) if spread is None else interval_json(spread, name)
    if spread is not None and spread.modes:
        said |= {"rigid": {name: {end: json_number(x) for end, x in interval._asdict().items()}
                           for name, interval in zip(RIGID, spread.rigid, strict=True)},
                 "modes": {each.name: each.json for each in spread.modes}}
    return said | {"stable": {"probability": None if spread is None else spread.stable},
                   "ms": None if spread is None else json_number(spread.ms),
                   "crossover": [] if spread is None else [x.frequency for x in spread.crossings if x.kind == "phase"],
                   "crossings": [] if spread is None else [each._asdict() for each in spread.crossings],
                   "controller": None if judgement.controller is None else judgement.controller.json}


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
    return (f"{MARGINS[name].words} {margin_words(interval_json(spread, name), name)} {unit}, required "
            f"{abs(required_of(required, name)):g}")


def required_of(required: Required, name: str) -> float:
    """Return the required value of margin `name` (one of MARGIN_NAMES), below 0 for `gain_low_db`."""
    return MARGINS[name].sign * float(getattr(required, MARGINS[name].required))


def report(windows: Sequence[WindowMargins], servo: Servo, required: Required, is_tracked: bool,
           flown: fl.Flown) -> dict[str, Any]:
    """Return the JSON of `launchid margins`: windows, actuator (`servo`), margins below and maybe below `required`,
    findings, assumed, controller, gains.  is_tracked: with the tracked estimates' margins."""
    reached = below_json(windows, required, is_tracked)
    std = np.sqrt(np.diag(servo.covariance))
    told = telling(windows, required)
    controller = next((each.window.controller for each in reversed(windows) if each.window.controller), None)
    return {"windows": [{"t_start": each.t_start, "t_end": each.t_end, **margins_json(each.window),
                         **({"tracked": margins_json(each.tracked)} if is_tracked else {})} for each in windows],
            "actuator": servo_json(servo, std),
            "below": [{key: x for key, x in each.items() if key != "certain"} for each in reached if each["certain"]],
            "may_be_below": [{key: x for key, x in each.items() if key != "certain"} for each in reached
                             if not each["certain"]],
            "findings": flown.findings, "assumed": [frozen_words(windows), *flown.assumed],
            "controller": None if controller is None else controller.json,
            "gains": allowed(told, required), "gains_of": len(told)}


def frozen_words(windows: Sequence[WindowMargins]) -> str:
    """Return one sentence on what the frozen loop leaves out."""
    known = next((each.window.known for each in windows if each.window.known is not None), None)
    there = {mode.name.rstrip("0123456789") for mode in known.modes} if known is not None else set()
    left = [kind for kind in ("bending", "slosh") if kind not in there]
    return fl.FROZEN.format(", ".join([*left, "lateral drift"]))


def servo_json(servo: Servo, std: np.ndarray) -> dict[str, Any]:
    """Return the servo's numbers as JSON; those of a first-order servo are its time constant [s] and delay [s]."""
    if servo.is_first_order:
        return {"time_constant": {"value": 1.0 / float(servo.mean[0]), "std": float(std[0] / servo.mean[0]**2)},
                "delay": {"value": float(servo.mean[2]), "std": float(std[2])}}
    return {name: {"value": float(servo.mean[k]), "std": float(std[k])} for k, name in enumerate(SERVO)}


def interval_words(interval: dict[str, Any], unit: str = "", is_low_gain: bool = False) -> str:
    """Return a value and its interval as text, `37.51 (36.38..38.57)`; a None is inf or -inf, all None are "-".

    is_low_gain  the low gain margin, whose JSON is below 0: in words how far the gain may fall, above 0
    """
    if interval["value"] is None and interval["low"] is None and interval["high"] is None:
        return "-"
    if is_low_gain:
        turned = {"value": interval["value"], "low": interval["high"], "high": interval["low"]}
        interval = {key: None if x is None else -x for key, x in turned.items()}
    decimals = 1 if unit == "ms" else 3 if unit == "" else 2
    bottom, top = "-inf" if interval["high"] is not None and not is_low_gain else "inf", "inf"
    value, low, high = (other if interval[key] is None else f"{interval[key]:.{decimals}f}"
                        for key, other in (("value", bottom), ("low", "-inf"), ("high", top)))
    return f"{value} ({low}..{high})"


def margin_words(interval: dict[str, Any], name: str) -> str:
    """Return margin `name` and its interval as text."""
    return interval_words(interval, MARGINS[name].unit, MARGINS[name].sign < 0.0)


def heads() -> list[str]:
    """Return the margins' names with their units, as heads of columns."""
    return [f"{each.words} [{each.unit}]" if each.unit else each.words for each in MARGINS.values()]


def table(said: dict[str, Any]) -> str:
    """Return the JSON of `report` as text for a terminal: a line per window, servo, margins too low, findings."""
    lines = [f"{'t_start':>9} {'t_end':>9} {'of':<8} {'status':<15} " + " ".join(f"{head:>26}" for head in heads())
             + f" {'P(stable)':>10}"]
    for window in said["windows"]:
        for estimate, one in (("window", window), *((("tracked", window["tracked"]),) if "tracked" in window else ())):
            cells = " ".join(f"{margin_words(one[name], name):>26}" for name in MARGIN_NAMES)
            stable = one["stable"]["probability"]
            lines.append(f"{window['t_start']:>9.3f} {window['t_end']:>9.3f} {estimate:<8} {one['status']:<15} {cells} "
                         f"{'-' if stable is None else f'{stable:.4f}':>10}")
    lines += servo_lines(said["actuator"])
    lines += [*below_lines(said["below"], "is"), *below_lines(said["may_be_below"], "may be")]
    lines += [*said["findings"], *(f"assumed: {each}" for each in said["assumed"])]
    return "\n".join([*lines, *crossing_lines(said), *closing_lines(said), *gain_lines(said)])


def crossing_lines(said: dict[str, Any]) -> list[str]:
    """Return a line on the rigid crossings and one on each mode of the last window of `said` that has margins; []
    without modes."""
    there = [window for window in said["windows"] if window.get("modes")]
    if not there:
        return []
    window = there[-1]
    rigid = ", ".join(f"{MARGINS[name].words} {margin_words(window['rigid'][name], name)} {MARGINS[name].unit}"
                      for name in RIGID)
    lines = [f"in {window['t_start']:g}..{window['t_end']:g} s, rigid body: {rigid}"]
    for name, each in window["modes"].items():
        of, unit = ("gain_db", "dB below 1") if each["stabilised"] == "gain" else ("phase_deg", "degrees")
        lines.append(f"{name}: {each['stabilised']} stabilised, by {interval_words(each[of], 'dB')} {unit}")
    return lines


def closing_lines(said: dict[str, Any]) -> list[str]:
    """Return how many windows of `said` (the JSON of `report`) have margins and keep the required ones, as text; for
    the window's and for the tracked estimates; and what the flight does not tell (`excitation`)."""
    lines = []
    for of in ("window", "tracked"):
        there = [window for window in said["windows"] if (window | window.get(of, {}))["valid"]]
        missed = {each["t_start"] for each in said["below"] + said["may_be_below"] if each["estimate"] == of}
        kept = sum(window["t_start"] not in missed for window in there)
        if there and (of == "window" or of in said["windows"][0]):
            who = "of those " + ("all keep" if kept == len(there) else f"{kept} keep" if kept else "none keeps")
            lines.append(f"{len(there)} of {len(said['windows'])} windows have margins{' tracked' * (of == 'tracked')}"
                         f"; {who} what [margins] requires, with the whole 95 % interval")
    untold = said.get("excitation")
    return [*lines, *([untold["words"]] if untold else [])]


def gain_lines(said: dict[str, Any]) -> list[str]:
    """Return one line on the factors on kp and kd that keep what [margins] requires; [] where none were sought."""
    words = []
    for name, (least, largest) in said["gains"].items():
        words.append(f"no factor on {name} does" if least is None else
                     f"{name} may be {least:.2f} to {largest:.2f} times what is judged")
    of = f" in {said['gains_of']} windows" if "gains_of" in said else " in every flight"
    return [f"to keep it{of}, one gain at a time: {'; '.join(words)}"] if words else []


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
                         f"{margin_words(worst, name)} in {worst['t_start']:g}..{worst['t_end']:g} s")
    return lines
