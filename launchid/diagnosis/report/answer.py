"""A diagnosis as the contract's JSON."""

import math
from typing import Any

from ..causes import what_decides
from ..controller.kind import ControllerCheck
from ..judge.diagnosis import Diagnosis
from ..judge.gain import Gain
from ..judge.limits import Limit
from ..judge.measure import unit_of
from ..judge.named import Named
from ..search.selection import Weather

NEARLY_ALIKE = 0.9     # |cosine| of the responses of two causes from which the pair is listed


def report(made: Diagnosis) -> dict[str, Any]:
    """The contract's diagnose JSON, and more."""
    selection = made.selection
    return {
        "verdict": made.verdict, "where": made.where,
        "causes": [_cause_json(cause) for cause in made.causes],
        "noise": made.noise,
        "limits": {each.cause: _limit_json(each) for each in made.limits},
        "remainder": None if made.remainder is None else
        {"share": number(made.remainder.share), "where": made.remainder.where, "words": made.remainder.words},
        "remaining": list(made.remaining) if made.verdict == "dominant" else [],
        "gain": _gain_json(made.gain) if made.verdict in ("explained", "dominant", "unexplained") else None,
        "within_tolerance": [_cause_json(cause) for cause in made.open],
        "cut_short": made.is_cut_short, "effort_spent": made.is_spent,
        "estimator": None if made.user is None else {
            name: {"error": dict(zip(("before", "after"), map(number, made.user.error[name]), strict=True)),
                   "coverage": dict(zip(("before", "after"), map(number, made.user.coverage[name]), strict=True))}
            for name in ("a6", "k1")},
        "doubts": list(made.doubts),
        "weather": None if selection is None or selection.weather is None else _weather_json(selection.weather),
        "nearest": [_nearest_json(cause) for cause in made.nearest],
        "data": {"rows": len(made.log.t), "usable": int(made.data.usable.sum()),
                 "used": None if made.used is None else made.used._asdict(),
                 "faults": [fault.__dict__ for fault in made.data.faults]},
        "proposal": made.proposal.equation if made.proposal is not None and made.verdict == "unexplained" else None,
        "controller": _controller_json(made.controller),
        "leftover": [{"place": each.disturbance.place, "shape": each.shape or None, "nats": number(each.gain)}
                     for each in made.left],
        "ranking": [] if selection is None else
        [[{"cause": each.cause.hypothesis.cause, "evidence": number(each.evidence)} for each in step]
         for step in selection.rankings],
        "look_alikes": [] if made.isolability is None else
        [{"causes": [a, b], "cosine": round(c, 4)} for a, b, c in made.isolability.pairs(NEARLY_ALIKE)],
        "threshold": made.threshold,
        "deviation": None if selection is None else {"a6": float(selection.model.fit.delta[0]),
                                                     "k1": float(selection.model.fit.delta[1])},
    }


def _weather_json(weather: Weather) -> dict[str, Any]:
    return {"source": weather.source.name, "level": number(weather.level), "std": number(weather.std),
            "unit": unit_of(weather.source.name), "nats": number(weather.gain)}


def number(x: float) -> float | None:
    """A JSON number: null for what is not finite."""
    return float(x) if math.isfinite(x) else None


def _cause_json(cause: Named) -> dict[str, Any]:
    evidence: dict[str, Any] = {"nats": number(cause.evidence)}
    if cause.constancy is not None:
        evidence["constancy_chi_squared"] = number(cause.constancy.chi_squared)
    parameters: dict[str, Any] = {}
    for name, value in cause.values.items():
        parameters[name] = {"value": value if isinstance(value, str) else number(value),
                            "std": number(cause.std[name]) if name in cause.std else None,
                            "unit": cause.units.get(name, "term")}
    return {"cause": cause.cause, "where": cause.where, "parameters": parameters,
            "indistinguishable_from": list(cause.rivals), "would_decide": what_decides(cause.cause, cause.rivals),
            "evidence": evidence, "removed": None if cause.removed is None else number(cause.removed),
            "steps": [{"time": time, "fraction": fraction} for time, fraction in cause.steps]}


def _nearest_json(cause: Named) -> dict[str, Any]:
    return {"resembles": cause.cause, "nats": number(cause.evidence)}


def _limit_json(limit: Limit) -> dict[str, Any]:
    return {"parameter": limit.parameter, "unit": limit.unit, "size": limit.size,
            "neutral": number(limit.neutral), "at": dict(limit.at)}


def _controller_json(check_: ControllerCheck | None) -> dict[str, Any] | None:
    if check_ is None:
        return None
    return {"mismatch": check_.kind, "rms_before": check_.before, "rms_after": check_.after,
            "time_constant": check_.time_constant}


def _gain_json(gain: Gain | None) -> dict[str, Any] | None:
    if gain is None:
        return None
    table = {f"{horizon:g}": {channel: {"before": number(b), "after": number(a)} for channel, (b, a) in row.items()}
             for horizon, row in gain.nrmse.items()}
    first = gain.nrmse[gain.longest].get("theta", (math.nan, math.nan))
    return {"horizon": gain.longest, "held_out": True, "channels": table[f"{gain.longest:g}"],
            "before": number(first[0]), "after": number(first[1]), "horizons": table, "nats": number(gain.nats),
            "source": gain.source,
            "log_likelihood_per_row": {"before": number(gain.log_likelihood[0]),
                                       "after": number(gain.log_likelihood[1])},
            "closed_loop": None if gain.closed_loop is None else
            {"before": number(gain.closed_loop[0]), "after": number(gain.closed_loop[1]), "unit": "rad"}}

