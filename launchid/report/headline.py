"""What an engineer would say of a result in one sentence, and the command to run next."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..formatting import with_std

if TYPE_CHECKING:
    from sim.sections import Required

    from ..first_nominal import First

SIGMAS = 3.0     # standard deviations, by which a number is another than the nominal's or than before
BEYOND_NOISE = 1.2  # times the error that noise makes, from which a cause is worth looking for
SPREAD = 2.0     # of the windows' chi square over its degrees of freedom, from which their mean is no summary
UNIT = "1/s^2"


def closing(report: dict[str, Any]) -> list[str]:
    """Return the last lines of a command's text: its headline, and the command to run next."""
    said = [report["headline"]] if report.get("headline") else []
    return said + ([f"Next: {report['next']}"] if report.get("next") else [])


def changed(changes: Sequence[dict[str, Any]]) -> str:
    """Return the largest sudden change in a sentence; "" if there is none."""
    if not changes:
        return ""
    most = max(changes, key=lambda each: abs(each["size"]) / max(each["size_std"], 1e-300))
    before, after, std = most["before"], most["after"], most["size_std"]
    if not before or before * after < 0.0:
        size = f"{most['parameter']} goes from {with_std(before, std)} to {with_std(after, std)} {UNIT}"
    else:
        share, word = 100.0 * abs(after / before - 1.0), "lower" if abs(after) < abs(before) else "higher"
        size = f"{most['parameter']} is {with_std(share, 100.0 * std / abs(before))} % {word}"
    more = f" ({len(changes)} sudden changes in all)" if len(changes) > 1 else ""
    return f"From {most['t']:.1f} s on {size}{more}"


def over_windows(windows: Sequence[dict[str, Any]], name: str) -> str:
    """Return a parameter over its valid windows: one value where they agree, else the first and the last; "" if no
    window has it."""
    rows = [(w[name], w[f"{name}_std"]) for w in windows
            if w["valid"] and w[name] is not None and w[f"{name}_std"] is not None and w[f"{name}_std"] > 0.0]
    if not rows:
        return ""
    value, std = np.array(rows).T
    weight = 1.0 / std**2
    mean = float(np.sum(weight * value) / np.sum(weight))
    if len(rows) > 1 and float(np.sum(weight * (value - mean)**2)) > SPREAD * (len(rows) - 1) + SIGMAS:
        return f"{name} goes from {with_std(*rows[0])} to {with_std(*rows[-1])} {UNIT}"
    return f"{name} {with_std(mean, 1.0 / math.sqrt(float(np.sum(weight))))} {UNIT}"


def of_identified(report: dict[str, Any], log: str, options: str, nominal: str | None,
                  has_controller: bool) -> dict[str, str]:
    """Return {"headline", "next"} of the identify JSON; what the answer lacks comes first.

    log, options  as a command names the log;  nominal  path or name;  has_controller  whether margins can be asked for
    """
    windows = report["windows"]
    valid = sum(window["valid"] for window in windows)
    if not valid:
        head = report.get("why", f"no window of {log} is complete")
        follow = f"launchid show {log}" if nominal is None else f"launchid diagnose {log} {nominal} --report report"
        return {"headline": f"{head[:1].upper()}{head[1:]}.", "next": report.get("next", follow + options)}
    span = [window for window in windows if window["valid"]]
    numbers = " and ".join(filter(None, (over_windows(windows, name) for name in ("a6", "k1"))))
    change = changed(report.get("changes", []))
    if change:
        head = f"{change}."
    elif numbers:
        head = f"{numbers[:1].upper() if numbers[:1] != 'a' else 'a'}{numbers[1:]}, {span[0]['t_start']:.4g} to " \
               f"{span[-1]['t_end']:.4g} s ({valid} of {len(windows)} windows)."
    else:
        head = f"{valid} of {len(windows)} windows are valid; their terms are {', '.join(span[0]['terms'])}."
    if nominal is None:
        follow = f"launchid nominal {log} --out first.toml"
    elif has_controller and not change:
        follow = f"launchid margins {log} {nominal}"
    else:
        follow = f"launchid diagnose {log} {nominal} --report report"
    return {"headline": head, "next": report.get("next", follow + options)}


def of_cause(cause: str, parameters: dict[str, Any]) -> str:
    """Return a cause as an engineer would say it; parameters as in the diagnose JSON."""
    def of(name: str) -> tuple[float, float]:
        return parameters[name]["value"], parameters[name]["std"] or 0.0

    def share(value: float, std: float, what: str) -> str:
        return f"{what} is {with_std(100.0 * abs(value), 100.0 * std)} % {'lower' if value < 0.0 else 'higher'}"

    given = {name for name, each in parameters.items() if each["value"] is not None}
    if cause == "control_loss" and {"time", "fraction"} <= given:
        fraction, std = of("fraction")
        return f"from {of('time')[0]:.1f} s on {share(-fraction, std, 'k1')}"
    for name, what in (("control_effectiveness", "k1"), ("aero_instability", "a6")):
        if cause == name and "scale" in given:
            scale, std = of("scale")
            return share(scale - 1.0, std, f"{what} of the whole flight")
    sizes = ", ".join(f"{name} {each['value']}" if isinstance(each["value"], str) else
                      f"{name} {with_std(each['value'], each['std'])} {each['unit']}".strip()
                      for name, each in parameters.items() if each["value"] is not None)
    return f"{cause} ({sizes})"


def of_diagnosed(report: dict[str, Any], log: str, options: str, nominal: str,
                 fits: tuple[float, float, float] | None, has_extension: bool, folder: str,
                 has_range: bool = True) -> dict[str, str]:
    """Return {"headline", "next"} of the diagnose JSON.

    log, options, nominal  as a command names them;  fits  how well theta is predicted [%] before and after, and how far
    ahead [s];  has_extension  whether --report writes an extension.toml;  folder  of the report;  has_range  whether
    the nominal has an [uncertainty]
    """
    again = f"launchid diagnose {log} {nominal} --report report{options}"
    if report["verdict"] == "bad-data":
        faults = [fault["message"] for fault in report["data"]["faults"]]
        said = f"{faults[0][:1].upper()}{faults[0][1:]}" if len(faults) == 1 else \
            "The log has faults that leave too little of it"
        return {"headline": f"{said}; nothing about the vehicle is claimed.",
                "next": f"launchid show {log}{options}"}
    if report["verdict"] == "consistent":
        return {"headline": f"The log is what {nominal} predicts: nothing is wrong that it could show.",
                "next": f"launchid {'uncertainty' if has_range else 'margins'} {log} {nominal}{options}"}
    if not report["causes"]:
        where = f", at the {report['where']}" if report["where"] else ""
        return {"headline": f"{nominal} does not predict this log{where}, and no known cause fits.",
                "next": f"launchid compare {log} {nominal} --report compared{options}"}
    said = "; ".join(of_cause(each["cause"], each["parameters"]) for each in report["causes"])
    alike = [each["indistinguishable_from"] for each in report["causes"] if each["indistinguishable_from"]]
    doubt = f" (or {' or '.join(alike[0])}: this log cannot tell)" if alike else ""
    gain = "" if fits is None else (f"; predictions of theta {fits[2]:g} s ahead improve from {_percent(fits[0])} to "
                                    f"{_percent(fits[1])} %")
    rest = "; something else remains" if report["verdict"] == "dominant" else ""
    head = f"{said[:1].upper() if said[:3] not in ('a6 ', 'k1 ') else said[:1]}{said[1:]}{doubt}{gain}{rest}."
    follow = f"launchid identify {log} {shown_path(f'{folder}/extension.toml')}{options}" if has_extension else again
    return {"headline": head, "next": follow}


def _percent(x: float) -> str:
    """Return a fit [%]: with one digit near 100, whole elsewhere; one that is worse than the mean says so."""
    return f"{x:.1f}" if x > 90.0 else f"{x:.0f}" if x >= 0.0 else "below 0"


def of_compared(report: dict[str, Any], log: str, options: str, nominals: Sequence[str]) -> dict[str, str]:
    """Return {"headline", "next"} of the compare JSON: which nominal predicts best the longest way ahead, and whether
    that is as well as its declared noise allows.  nominals: as a command names them, in the order of the JSON"""
    rows = []
    for each, name in zip(report["nominals"], nominals, strict=True):
        said = each["channels"].get("theta") or each["channels"].get("theta_dot") or {"ahead": {}}
        ahead = {h: one for h, one in said["ahead"].items() if one["fit"] is not None}
        if ahead:
            h = max(ahead, key=float)
            noise = ahead[h]["noise_fit"]
            over = None if noise is None or not noise < 100.0 else (100.0 - ahead[h]["fit"]) / (100.0 - noise)
            rows.append((ahead[h]["fit"], over, name, h))
    if not rows:
        return {"headline": f"No nominal predicts {log} far enough ahead to be judged.",
                "next": f"launchid show {log}{options}"}
    fit, over, name, h = max(rows)
    others = [f"{other} {_percent(x)} %" for x, _, other, _ in sorted(rows, reverse=True)[1:]]
    beside = f" (beside it {', '.join(others)})" if others else ""
    if over is None or over <= BEYOND_NOISE:
        return {"headline": f"{name} predicts theta {h} s ahead to {_percent(fit)} %{beside}, as well as its noise "
                            "allows.", "next": f"launchid margins {log} {name}{options}"}
    return {"headline": f"{name} predicts theta {h} s ahead to {_percent(fit)} %{beside}, with {over:.1f} times the "
                        "error that its noise would make: something is missing.",
            "next": f"launchid diagnose {log} {name} --report report{options}"}


def of_margins(report: dict[str, Any], required: "Required", log: str, options: str,
               nominal: str | None) -> dict[str, str]:
    """Return {"headline", "next"} of the margins JSON: the worst window, whether what is required is kept, and the
    command to run next.  nominal: as a command names it, None: out of the log alone"""
    told = [each for each in report["windows"] if each["valid"] and each["phase_deg"]["value"] is not None]
    of = "" if nominal is None else f" {nominal}"
    if not told:
        follow = f"launchid diagnose {log}{of} --report report{options}" if nominal else f"launchid show {log}{options}"
        return {"headline": f"{report['why'][:1].upper()}{report['why'][1:]}." if "why" in report else
                "No window has margins.", "next": report.get("next", follow)}

    def interval(window: dict[str, Any], name: str, unit: str) -> str:
        x = window[name]
        return f"{x['value']:.3g} ({x['low']:.3g} .. {x['high']:.3g}) {unit}"

    phase = min(told, key=lambda each: each["phase_deg"]["value"])
    gains = [each for each in told if each["gain_high_db"]["value"] is not None]
    said = [f"phase margin {interval(phase, 'phase_deg', 'degrees')}"]
    lowest = min(gains, key=lambda each: each["gain_high_db"]["value"], default=None)
    if lowest is not None and None not in lowest["gain_high_db"].values():
        said.append(f"the gain may rise by {interval(lowest, 'gain_high_db', 'dB')}")
    kept = "less than" if report["below"] else "perhaps less than" if report["may_be_below"] else "at least"
    head = (f"At worst {' and '.join(said)}: {kept} the {required.phase_deg:g} degrees and {required.gain_db:g} dB "
            "that [margins] requires.")
    factors = next(((name, x) for name, x in report["gains"].items() if x[0] is not None and x[1] is not None), None)
    if nominal is None:
        follow = f"launchid nominal {log} --out first.toml{options}"
    elif kept == "at least" or factors is None:
        follow = f"launchid compare {log}{of} --report compared{options}"
    else:
        name, (low, high) = factors
        follow = f"launchid margins {log}{of} --scale {name}={math.sqrt(low * high):.2g}{options}"
    return {"headline": head, "next": report.get("next", follow)}


def of_first(numbers: "First", names: str, differing: str) -> dict[str, str]:
    """Return {"headline", "next"} of a first nominal.

    names  its logs and its own file, as a command takes them;  differing  which flights are not of the vehicle
    """
    if numbers.refused:
        return {"headline": f"{numbers.refused[0][:1].upper()}{numbers.refused[0][1:]}.",
                "next": f"launchid show {names}"}
    pairs = [(name, getattr(numbers, name), getattr(numbers, f"{name}_std")) for name in ("a6", "k1")]
    said = " and ".join(f"{name} {with_std(value[0], std[0])}" if len(value) == 1 else
                        f"{name} from {with_std(value[0], std[0])} to {with_std(value[-1], std[-1])}"
                        for name, value, std in pairs)
    late = [] if numbers.delay is None or not numbers.delay[0] > numbers.delay[1] else [
        f"a delay of {with_std(*(1e3 * x for x in numbers.delay))} ms"]
    late += [] if numbers.servo is None else [f"a servo of {with_std(*numbers.servo[0])} rad/s"]
    behind = f" behind {' and '.join(late)}" if late else ""
    head = f"{said} {UNIT}{behind}."
    return {"headline": f"{differing}; of the others: {head}" if differing else head,
            "next": f"launchid identify {names}"}


def shown_path(path: str) -> str:
    """Return a path as a command would name it: that of a built-in nominal by its name."""
    from sim.nominal import NAMES, built_in
    name = Path(path).stem
    return name if name in NAMES and Path(path) == built_in(name) else path
