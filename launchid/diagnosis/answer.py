"""Turn a diagnosis into its JSON (docs/formats.md), text for a terminal, and an extended nominal."""

import math
from dataclasses import fields, replace
from typing import Any

from sim.effects import CATALOGUE, effect
from sim.effects.table import CENTRE
from sim.nominal import Nominal
from sim.sections import MOST_MODES, Actuator, Bending, Slosh, constant

from ..formatting import json_number, with_std
from .elimination import MIN_SQUARES_SAVED, Z
from .gain import Gain
from .named import Named, Result

CHANNEL_LEVELS = (("theta", 0), ("theta_dot", 1), ("beta", 2), ("command", 4), ("acceleration", 3))
MODES: dict[str, type[Slosh] | type[Bending]] = {"slosh": Slosh, "bending": Bending}
SERVO_SIGMAS = {"actuator_delay": ("delay", "delay_sigma"), "actuator_bandwidth": ("scale", "natural_frequency_sigma")}
SIGNIFICANT = 1.5      # times the declared, from which a noise level differs
DECIDES = {
    frozenset({"steady_wind", "attitude_bias"}): "an independent attitude reference, or air data",
    frozenset({"thrust_misalignment", "steady_wind"}): "a flight in which a6 and k1 change differently",
    frozenset({"thrust_misalignment", "attitude_bias"}): "a flight in which a6 and k1 change differently",
    frozenset({"actuator_delay", "actuator_bandwidth"}): "the nozzle sensor several times as often as commands come",
    frozenset({"actuator_gain", "control_effectiveness"}): "the nozzle sensor",
    frozenset({"actuator_bias", "thrust_misalignment"}): "the nozzle sensor",
    frozenset({"actuator_bias", "nozzle_sensor_bias"}): "a longer log",
    frozenset({"control_slope", "control_effectiveness"}): "a longer log",
    frozenset({"lateral_drift", "aero_instability"}): "the flight-path angle of the navigation (column gamma)"}


def would_decide(named: Named) -> list[str]:
    """Return the measurements that would tell a cause from those that look alike."""
    found = (DECIDES.get(frozenset({named.cause, other})) for other in named.alike)
    return list(dict.fromkeys(each for each in found if each))


def unit_of(cause: str, parameter: str) -> str:
    return next((p.unit for p in CATALOGUE[cause].parameters if p.name == parameter), "")


def extension(result: Result) -> Nominal | None:
    """Return the nominal with the named causes; None if none is named, or a value is not allowed.

    Slosh and bending become `[[slosh]]` and `[[bending]]`, with their standard deviations as sigmas; those of a servo's
    delay and bandwidth become sigmas of `[actuator]`; all other causes are `[[effects]]`.
    """
    nominal, reading = result.nominal, result.reading
    if not result.named or result.model is None:
        return None
    shift, centre = result.model.log.track.record.shift, result.model.log.centre
    effects = []
    for each in result.named:
        given = each.values
        parameters = {p.name: p for p in CATALOGUE[each.cause].parameters}
        if "time" in given:
            given["time"] += shift
        if any(p.default == CENTRE for p in parameters.values()):
            given["middle"] = centre + shift
        for key, p in parameters.items():
            if key in given and not isinstance(given[key], str) and not p.allows(float(given[key])):
                return None
        if each.cause in MODES and len(getattr(nominal, each.cause)) < MOST_MODES:
            modes: dict[str, Any] = {each.cause: (*getattr(nominal, each.cause), _mode(each))}
            nominal = replace(nominal, **modes)
            continue
        effects.append(effect(each.cause, **{key: v for key, v in given.items() if key in parameters}))
        nominal = replace(nominal, actuator=_servo(nominal.actuator, each))
    out = replace(nominal, name=f"{nominal.name}-extended", effects=(*nominal.effects, *effects))
    c = reading.controller
    if c is not None and c.is_named and c.time_constant is not None and out.controller is not None:
        out = replace(out, controller=replace(out.controller, derivative_time_constant=c.time_constant))
    return out


def _mode(each: Named) -> Slosh | Bending:
    """Return the section of a mode that was found, its standard deviations as shares."""
    kind, given = MODES[each.cause], each.values
    known = {field.name for field in fields(kind)}
    numbers: dict[str, Any] = {name: constant(float(value)) for name, value in given.items() if name in known}
    sigma: dict[str, Any] = {f"{name}_sigma": abs(std / given[name]) for name, std in each.std.items()
             if std is not None and f"{name}_sigma" in known}
    return kind(**numbers, **sigma)


def _servo(actuator: Actuator | None, each: Named) -> Actuator | None:
    """Return the actuator with the standard deviation of a delay or a bandwidth that was found as its sigma."""
    if actuator is None or each.cause not in SERVO_SIGMAS:
        return actuator
    number, key = SERVO_SIGMAS[each.cause]
    std = each.std.get(number)
    if std is None or (actuator.is_first_order and key != "delay_sigma"):
        return actuator
    scale = 1.0 if key == "delay_sigma" else each.values[number]
    sigma: dict[str, Any] = {key: math.hypot(getattr(actuator, key), std / scale)}
    return replace(actuator, **sigma)


def report(result: Result) -> dict[str, Any]:
    """Return the JSON of `launchid diagnose`: verdict, causes, noise, limits, what remains, held-out gain, checks."""
    r, m = result.reading, result.model
    return {
        "verdict": result.verdict, "where": result.where,
        "causes": [_cause(each, result) for each in result.named],
        "noise": {} if m is None else {
            name: {"factor": json_number(math.exp(m.levels[k] - m.noise.declared[k])),
                   "significant": bool(abs(m.levels[k] - m.noise.declared[k]) > math.log(SIGNIFICANT))}
            for name, k in CHANNEL_LEVELS if k in m.noise.moves},
        "limits": _limits(result),
        "remainder": {"share": json_number(result.share), "where": result.remaining_where or result.where,
                      "words": result.remaining[0]} if result.verdict == "dominant" and result.remaining else None,
        "remaining": list(result.remaining), "gain": _gain(result.gain),
        "doubts": list(result.doubts), "notes": list(result.notes),
        "nearest": [{"resembles": each.cause, "nats": json_number(each.nats)} for each in result.nearest],
        "either": [[each.cause, *each.alike] for each in result.named if each.alike],
        "within_tolerance": [], "cut_short": result.is_cut_short, "effort_spent": False,
        "false_alarms": result.false_alarms,
        "data": {"rows": len(r.log.t), "usable": int(r.data.usable.sum()),
                 "used": None if r.used is None else r.used._asdict(),
                 "faults": [fault.__dict__ for fault in r.data.faults]},
        "controller": None if r.controller is None else {
            "mismatch": r.controller.kind, "rms_before": r.controller.before, "rms_after": r.controller.after,
            "time_constant": r.controller.time_constant},
        "deviation": None if result.elimination is None or m is None else {
            name: json_number(result.elimination.final.p[m.table.index(name)] - 1.0)
            for name in ("a6", "k1") if name in m.table},
    }


def _limits(result: Result) -> dict[str, Any]:
    """Return for each cause of one number the size that this log would have shown, if all else is free: it saves
    MIN_SQUARES_SAVED squares and is Z standard errors; null where the log says nothing of it."""
    m, el = result.model, result.elimination
    found: dict[str, Any] = {}
    if m is None or el is None:
        return found
    for j, std in el.std_full.items():
        of = m.table.numbers[j]
        neutral = {p.name: p.neutral for p in CATALOGUE[of.cause].parameters} if of.cause in CATALOGUE else {}
        if "#" not in of.name and of.cause not in found and neutral.get(of.parameter, math.nan) == of.null:
            found[of.cause] = {
                "parameter": of.parameter, "unit": unit_of(of.cause, of.parameter),
                "size": json_number(max(Z, math.sqrt(MIN_SQUARES_SAVED)) * std + of.tol), "neutral": of.null, "at": {}}
    return found


def _cause(each: Named, result: Result) -> dict[str, Any]:
    shift = result.model.log.track.record.shift if result.model is not None else 0.0
    return {"cause": each.cause, "where": each.where,
            "parameters": {key: {"value": value, "std": None, "unit": "term"} if isinstance(value, str) else {
                "value": json_number(value + shift if key == "time" else value), "std": json_number(std),
                "unit": unit_of(each.cause, key)} for key, (value, std) in each.parameters.items()},
            "indistinguishable_from": list(each.alike), "would_decide": would_decide(each),
            "evidence": {"nats": json_number(each.nats), "held_out": json_number(each.share)},
            "removed": json_number(each.share), "steps": []}


def _gain(gain: Gain | None) -> dict[str, Any] | None:
    if gain is None:
        return None
    table = {f"{h:g}": {name: {"before": json_number(before), "after": json_number(after)}
                        for name, (before, after) in gain.nrmse(h).items()} for h in gain.squares}
    last = table[f"{gain.longest:g}"]
    first = last.get("theta", last.get("theta_dot", {"before": None, "after": None}))
    return {"horizon": gain.longest, "held_out": True, "channels": last, "before": first["before"],
            "after": first["after"], "horizons": table, "nats": json_number(gain.nats), "source": gain.source,
            "closed_loop": None}


def headline(result: Result) -> str:
    """Return the verdict in one sentence."""
    causes = " and ".join(" or ".join((each.cause, *each.alike)) for each in result.named)
    if result.verdict == "bad-data":
        return f"BAD DATA: {len(result.reading.data.faults)} fault(s) in the log; nothing about the vehicle is claimed."
    if result.verdict == "consistent":
        return "CONSISTENT: the log is what the simulation would have given; nothing is wrong that it could show."
    if result.model is None:
        why = "cut short by the emergency brake, [diagnosis] time_limit" if result.is_cut_short else "too few rows"
        return f"UNEXPLAINED: {why}; nothing is concluded."
    if result.verdict == "unexplained":
        return f"UNEXPLAINED: simulation and measurement part at the {result.where}, and no known cause fits."
    places = " and ".join(dict.fromkeys(each.where for each in result.named))
    if result.verdict == "dominant":
        rest = f"; {100 * (1 - result.share):.0f} % of the error explained, {100 * result.share:.0f} % remain" \
            if result.share is not None else ""
        return f"DOMINANT ({places}): {causes}{rest}."
    return f"EXPLAINED ({places}): {causes}."


def lines(result: Result) -> list[str]:
    """Return the whole diagnosis as lines for a terminal, the verdict first."""
    said = [headline(result)] + [f"  {fault.message}" for fault in result.reading.data.faults]
    if result.reading.used is not None:
        said.append(f"  {result.reading.used.words}")
    how = "likelier" if result.model is not None and not result.model.log.is_flown else "on blocks left out"
    for each in result.named:
        said.append(f"  {each.cause}: {sizes(each)} ({each.nats:.0f} nats {how})")
        if each.alike:
            decides = would_decide(each)
            said.append(f"    this log cannot distinguish it from {', '.join(each.alike)}"
                        + (f"; this would: {' or '.join(decides)}" if decides else ""))
    said += [f"  doubt: {words}" for words in result.doubts]
    said += [f"  not everything is explained: {words}" for words in result.remaining]
    said += [f"  nearest (not the cause): resembles {each.cause}, {sizes(each)}" for each in result.nearest]
    said += [f"  note: {words}" for words in result.notes]
    if result.gain is not None:
        said.append(f"gain on {result.gain.source} (nothing fitted to them): prediction error over its change "
                    "(0: perfect, 1: no better than no change),")
        for horizon in result.gain.squares:
            said.append(f"  {horizon:>6g} s  " + "  ".join(f"{name} {b:.3g} -> {a:.3g}" for name, (b, a)
                                                          in result.gain.nrmse(horizon).items()))
    return said


def sizes(each: Named) -> str:
    """Return a cause's parameters as text, each with unit and one standard deviation."""
    words, given = [], each.values
    for key, (value, std) in each.parameters.items():
        if key == "coefficient" and "believed" in given:
            words.append(with_std(value + given["believed"], std))
        elif key == "believed":
            words.append(f"for {value:.4g}")
        elif isinstance(value, str):
            words.append(f"{key} {value}")
        else:
            unit = unit_of(each.cause, key)
            words.append(f"{key} {with_std(value, std)}" + (f" {unit}" if unit else ""))
    return ", ".join(words)
