"""The answer of identify as JSON, and in words: a line for each window, what is missing, what to do next."""

import collections
import dataclasses
import itertools
import math
from typing import Any

from launchid_core import Change, Estimate, Estimator, Model, Status
from sim.sections import SERVO, Offsets

from ..formatting import json_number, mode_lines, servo_lines, with_std
from ..identification.windows import Identified
from ..judge.lack import AT_REST, LIBRARY, Lack
from ..judge.refusal import withdrawn
from ..judge.windows import Judged
from ..weakform.modes import FAST_THETA

OFFSET_FIELDS = tuple(field.name for field in dataclasses.fields(Offsets))
NO_SERVO: dict[str, Any] = {name: {"value": None, "std": None} for name in SERVO}  # the model is contradicted
IN_COLUMNS = ("theta", "beta")  # terms whose coefficients stand under a6 and k1, with their deviations
FILTER_WORDS = {"OUTLIER": "measurements left out as outliers", "RESTART": "restarts of the filter",
                "LEVEL_CLAMP": "noise-level steps limited (normal at the start)",
                "CHANGE_WITHDRAWN": "sudden changes withdrawn", "STUCK": "windows with a sensor that stood still",
                "WRAP": "jumps of theta by a whole turn undone"}


def window_json(estimate: Estimate) -> dict[str, Any]:
    """Return the estimate of one window as an entry of `windows` in the identify JSON."""
    names = ("a6", "k1", "a6_std", "k1_std", "a6_k1_corr", "a6_dot", "k1_dot", "a6_bound", "k1_bound", "condition")
    active = [(term, estimate.xi[j, 1]) for j, term in enumerate(estimate.terms) if estimate.support[j, 1]]
    return {"t_start": estimate.t_start, "t_end": estimate.t_end, "valid": bool(estimate.valid),
            "status": estimate.status.name, **{name: json_number(getattr(estimate, name)) for name in names},
            "terms": {term: json_number(value) for term, value in active},
            "terms_std": {term: json_number(std) for term, std in estimate.terms_std.items()},
            "absent": {term: json_number(limit) for term, limit in estimate.absent.items()}, **air_json(estimate),
            **actuator_json(estimate), "modes": modes_json(estimate)}


def modes_json(estimate: Estimate) -> dict[str, dict[str, float | None]]:
    """Return slosh and bending at the end of a window, from all data so far, for JSON: name -> numbers with std."""
    said = {}
    for mode in estimate.modes:
        size = "coupling" if mode.name.startswith("slosh") else "gain"
        said[mode.name] = {"frequency": json_number(mode.frequency), "frequency_std": json_number(mode.frequency_std),
                           size: json_number(mode.size), f"{size}_std": json_number(mode.size_std)}
    return said


def air_json(estimate: Estimate) -> dict[str, Any]:
    """Return wind angle [rad] and sensor offsets at the end of a window, with their deviations, for JSON."""
    return {"wind": json_number(estimate.wind), "wind_std": json_number(estimate.wind_std),
            "offsets": {name: {"value": json_number(offset.value), "std": json_number(offset.std)}
                        for name, offset in estimate.offsets.items()}}


def actuator_json(estimate: Estimate) -> dict[str, Any]:
    """Return the servo's parameters at the end of a window, from all data so far, for JSON; {} if not estimated."""
    if estimate.actuator is None:
        return {}
    return {"actuator": {name: {"value": json_number(each.value), "std": json_number(each.std)}
                         for name, each in estimate.actuator.items()}}


def tracked_json(estimate: Estimate) -> dict[str, Any]:
    """Return the tracked estimate at the end of a window, which must have one, for JSON."""
    tracked = estimate.tracked
    assert tracked is not None
    return {"valid": tracked.valid, **{name: json_number(getattr(tracked, name))
                                       for name in ("a6", "k1", "a6_std", "k1_std", "a6_k1_corr")},
            **air_json(estimate)}


def change_json(change: Change) -> dict[str, Any]:
    """Return one sudden change of a6 or k1 for JSON."""
    return {"t": change.t, "t_std": change.t_std, "parameter": change.parameter, "before": change.before,
            "after": change.after, "size": change.size, "size_std": change.size_std}


def report(estimates: list[Estimate], estimator: Estimator, tracked: bool = False,
           judged: Judged | None = None) -> dict[str, Any]:
    """Return the identify JSON: windows, samples, filter events; with `tracked`, tracked estimates and changes.

    judged   the windows of a whole log as the judge left them; None: of a log that goes on, in which a contradiction of
             the model by the filter takes back the windows of the 20 s before it
    """
    counts, config = estimator.counts, estimator.config
    said: dict[str, Any] = {}
    if judged is not None:
        estimates = judged.estimates
    elif config.formulation == "filtered":
        estimates = withdrawn(estimates)
    windows = [window_json(estimate) for estimate in estimates]
    if judged is not None:
        for window, fit in zip(windows, judged.fits, strict=True):
            window["fit"] = {"r2_held_out": fit.r2, "whiteness": fit.whiteness}
        if config.formulation != "filtered":
            said["lacks"] = [lack_json(lack) for lack in judged.lacks]
        if judged.unchecked:
            said["unchecked"] = judged.unchecked
        if judged.lacks:
            missing = [lack.what for lack in judged.lacks if lack.what in LIBRARY]
            library = ",".join((*(judged.terms or config.terms), *missing))   # those that joined by themselves, too
            said["next"] = "; ".join(lack_words(lack, library) for lack in judged.lacks)
    if tracked:
        for window, estimate in zip(windows, estimates, strict=True):
            window["tracked"] = tracked_json(estimate)
    if not any(window["valid"] for window in windows):
        said["why"] = why(windows)
        said |= {"next": said["unchecked"]} if "unchecked" in said else {}   # it says what would allow the test
    if config.model is not None and (asked := next_step(windows, config.model)):
        said["next"] = asked
    known = [window["actuator"] for window in windows if window.get("actuator", NO_SERVO) != NO_SERVO]
    if config.model is not None and not all(getattr(config.model, f"{name}_sigma") == 0.0 for name in SERVO):
        said["actuator"] = known[-1] if known else NO_SERVO
    changes = {"changes": [change_json(change) for change in estimator.changes()]} if tracked else {}
    return {"windows": windows, **changes, **said,
            "samples": {"accepted": sum(counts[status.name] for status in Status if status >= 0),
                        "rejected": {status.name: counts[status.name] for status in Status
                                     if status < 0 and counts[status.name] > 0}},
            "filter": {name: n for name, n in counts.items() if name not in Status.__members__}}


def report_of(result: Identified, tracked: bool = False) -> dict[str, Any]:
    """Return the identify JSON of a whole log: `report`, with what to do next, and the delay and lag of beta."""
    said = report(result.estimates, result.estimator, tracked, result.judged)
    if "why" in said and (reason := result.log.raw.unusable()):
        said["why"] += f"; {reason}"
    if result.log.foreign:
        said["next"] = f"correct the log first: {result.log.foreign}"
    elif result.config.formulation == "filtered" and result.log.sensed is not None and result.log.sensed.coarse:
        said["next"] = result.log.sensed.coarse
    elif result.warnings:
        said["warnings"] = list(result.warnings)
        if result.told.refuses:
            said["next"] = result.told.next
    if result.told.hint and not result.told.refuses and result.config.model is not None and (
            found := next_step(said["windows"], result.config.model, result.told.hint)):
        said["next"] = found
    if result.config.formulation == "filtered":
        return said
    if "next" not in said and result.log.doubtful:
        said["next"] = result.log.doubtful
    lead, late = result.judged.lead, result.judged.late
    if late is not None:
        said["late"] = late.json
    if math.isfinite(result.judged.top):
        said["top"] = json_number(result.judged.top)
    return said | {"delay": None if lead is None else lead.json}

REASONS = {"SHORT": "too few usable rows", "GAP": "a gap leaves too few rows",
           "RANK": "the terms cannot be told apart: one of them does not move, or two move as one",
           "LOW_INFORMATION": "noise hides what could be known", "SATURATED": "sensors at their end stops",
           "NUMERICS": "results are not finite", "MODEL": "the log contradicts the model",
           "SEPARATION": "a6 and k1 cannot be told apart", "CHANGE": "a6 or k1 changed suddenly",
           "CONTROLLER": "the commands are not the nominal controller's",
           "UNCHECKED": "what the numbers rest on could not be tested"}


def why(windows: list[dict[str, Any]]) -> str:
    """Return one sentence that says why no window is valid, from their statuses; windows as in the JSON."""
    if not windows:
        return "no window of this log is valid: none is complete"
    counts = collections.Counter(window["status"] for window in windows)
    said = [f"{REASONS.get(status, status)} ({status}, {n} of {len(windows)} windows)"
            for status, n in counts.most_common()]
    return f"no window of this log is valid: {'; '.join(said)}"


def next_step(windows: list[dict[str, Any]], model: Model, found: str = "") -> str:
    """Return advice if windows (JSON) contradict the model, else "": declare what was found of the loop (`found`), else
    wind or sensor offsets that the nominal lacks; then look for the cause."""
    refused = sum(window["status"] == "MODEL" for window in windows)
    if not refused:
        return ""
    if found:
        return (f"{refused} of {len(windows)} windows contradict the model (MODEL): {found}; `launchid diagnose` looks "
                "for other causes")
    declared = {"[wind]": any(getattr(model, name) > 0.0 for name in ("walk", "wind_initial", "turbulence")),
                "[offsets]": any(getattr(model, name) > 0.0 for name in OFFSET_FIELDS)}
    lacks = " and no ".join(section for section, there in declared.items() if not there)
    declare = f"its nominal declares no {lacks}: declare what there may be, and it is estimated; " if lacks else ""
    return (f"{refused} of {len(windows)} windows contradict the model (MODEL): {declare}"
            "`launchid diagnose` looks for the cause")


def lack_json(lack: Lack) -> dict[str, Any]:
    """Return a `Lack`, something that an answer misses, as an entry of `lacks` in the identify JSON."""
    return {"what": lack.what, "before": json_number(lack.before), "after": json_number(lack.after),
            "size": None if lack.size is None else json_number(lack.size)}


def lack_words(lack: Lack, library: str) -> str:
    """Return one line on what an answer lacks, how much, and what to do; library: terms for --library, by commas."""
    said = {
        "interpolated": "beta has fewer values than the log has rows, and lines between them: log beta at every row, "
                        "as it acts",
        "coefficients": "the weak form under the log's own noise gives other coefficients of the same terms: noise in "
                        "theta or beta, or something slow, draws these off; leave --formulation out",
        "placebo": "beta of another time of the log explains the motion as well as beta does (placebo): k1 cannot be "
                   "determined; log a stretch in which beta moves by itself",
        FAST_THETA: "what theta does slowly does not act as what it does fast: a6 multiplies theta less the flight "
                    "path; log gamma or alpha, or give theta less its reference",
        "gamma": "gamma does not act as theta does with the other sign: it is in another unit, or of the other sign"}
    if lack.what in said:
        return said[lack.what]
    if lack.what == AT_REST:
        return f"beta never moves: k1 cannot be determined; for the rest identify with --library {library}"
    assert lack.size is not None
    if lack.what == "driving":
        return (f"the rate damping comes out {with_std(lack.size, lack.std)} 1/s, of the wrong sign: beta is "
                "filtered or late, or it answers the motion and little else moves it; log a stretch with a test input")
    if lack.what == "unexplained":
        return (f"what the terms leave is {lack.after:.3g} times its noise about {lack.size:.3g} rad/s: something of "
                "that frequency acts, or noise that changes")
    if lack.what == "clock":
        return (f"the time by which beta leads grows by {1e3 * lack.size:.3g} ms a second: beta and theta are stamped "
                "by two clocks, which no shift mends")
    if lack.what == "delay":
        late = "later" if lack.size > 0.0 else "sooner"
        return (f"beta acts {abs(1e3 * lack.size):.3g} ms {late} than it is logged ({lack.shares}): shift it by that, "
                "or let `launchid nominal` fit it")
    if lack.what == "beta_ddot":
        return (f"the acceleration of beta acts too, with the coefficient {lack.size:.3g} ({lack.shares}): no library "
                "has that term, the cause nozzle_inertia of `launchid diagnose` has")
    what = f"a constant of {lack.size:.3g} rad/s^2" if lack.what == "1" else \
        f"the term {lack.what} with the coefficient {lack.size:.3g}"
    slope = "; a6 is then not the slope of the moment at the log's attitude" if lack.what == "sin(theta)" else ""
    return f"{what} acts in the log ({lack.shares}): identify with --library {library}{slope}"


def structure_lines(windows: list[dict[str, Any]]) -> list[str]:
    """Return a line for each valid window (JSON) where a term of theta_ddot enters or leaves since the one before."""
    lines = []
    valid = [w for w in windows if w["valid"]]
    for before, after in itertools.pairwise(valid):
        entered = [term for term in after["terms"] if term not in before["terms"]]
        left = [term for term in before["terms"] if term not in after["terms"]]
        if entered or left:
            words = [f"{', '.join(terms)} {verb}" for terms, verb in ((entered, "enters"), (left, "leaves")) if terms]
            lines.append(f"structure from {after['t_start']:.2f} s on: {'; '.join(words)}")
    return lines


def share_of(change: dict[str, Any]) -> str:
    """Return ", N % more" or less: by how much a sudden change (JSON) alters its parameter; "" if it reverses."""
    before, after = change["before"], change["after"]
    if not before or before * after < 0.0:
        return ""
    return f", {100.0 * abs(after / before - 1.0):.0f} % {'less' if abs(after) < abs(before) else 'more'}"


def table(result: dict[str, Any]) -> str:
    """Return the identify JSON as text for a terminal: a line for each window, changes, servo, advice, counts."""
    tracked = any("tracked" in w for w in result["windows"])
    heads = ["a6 +- std [1/s^2]", "k1 +- std [1/s^2]", *(("tracked a6 +- std", "tracked k1 +- std") if tracked else ())]
    lines = [f"{'t_start':>9} {'t_end':>9} {'status':<15} {' '.join(f'{head:>20}' for head in heads)}  active terms"]

    def pair(numbers: dict[str, Any], name: str) -> str:
        return f"{with_std(numbers[name], numbers[f'{name}_std']):>20}"

    for w in result["windows"]:
        terms = ", ".join(term if term in IN_COLUMNS else f"{term} {with_std(value, w['terms_std'].get(term))}"
                          for term, value in w["terms"].items())
        pairs = [pair(numbers, name) for numbers in (w, *([w["tracked"]] if tracked else [])) for name in ("a6", "k1")]
        lines.append(f"{w['t_start']:>9.3f} {w['t_end']:>9.3f} {w['status']:<15} {' '.join(pairs)}  {terms}")
    lines += structure_lines(result["windows"])
    for c in result.get("changes", []):
        before, after = (with_std(c[name], c["size_std"]).split(" ")[0] for name in ("before", "after"))
        lines.append(f"sudden change of {c['parameter']} at {with_std(c['t'], c['t_std'])} s: {before} -> {after} "
                     f"1/s^2 (size {with_std(c['size'], c['size_std'])}{share_of(c)})")
    lines += servo_lines(result.get("actuator", {}))
    lines += mode_lines([w["modes"] for w in result["windows"]])
    if "late" in result:
        parts = {"a delay": result["late"]["delay"], "a lag": result["late"]["lag"]}
        said = " and ".join(f"{name} of {with_std(1e3 * each['value'], 1e3 * (each['std'] or 0.0))} ms"
                            for name, each in parts.items() if each and each["value"])
        lines.append(f"beta acts behind {said}: a6 and k1 are of beta as it acts")
    lines += [result[words] for words in ("why", "unchecked", "next") if words in result]
    samples = result["samples"]
    rejected = ", ".join(f"{name} {n}" for name, n in samples["rejected"].items()) or "none"
    lines.append(f"samples accepted {samples['accepted']}, rejected: {rejected}")
    done = ", ".join(f"{FILTER_WORDS[name]}: {n}" for name, n in result["filter"].items() if n > 0)
    if done:
        lines.append(f"filter: {done}")
    return "\n".join(lines)
