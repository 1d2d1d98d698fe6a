"""Judge a table of flights against the requirements: JSON, text for a terminal, figure."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...formatting import json_number
from .flight import METRICS
from .folder import Definition, Flights
from .grammar import Requirement
from .sequential import NOT_MET, UNDECIDED, Count, Watch


def judged(definition: Definition, requirements: Sequence[Requirement], flights: Flights) -> dict[str, Any]:
    """Return the JSON of `launchid campaign`: flights, losses, verdicts on each and on all requirements, metrics."""
    watch = Watch(requirements, definition.planned)
    for number, outcome in enumerate(flights.outcomes):
        watch(number, outcome)
    watch.end()
    rows = [row for row in flights.outcomes if isinstance(row, dict)]
    return {
        **definition.as_json(), "flown": len(flights.outcomes), "lost": sum(bool(row["lost"]) for row in rows),
        "without_result": len(flights.outcomes) - len(rows),
        "verdict": _overall(watch.counts), "results": [_result(count, flights) for count in watch.counts],
        "metrics": {name: _metric([float(row[name]) for row in rows if not row["lost"]], unit)
                    for name, unit in METRICS.items()}}


def _overall(counts: Sequence[Count]) -> str | None:
    """Return the verdict on all requirements, the worst of theirs; None without requirements."""
    said = {count.verdict for count in counts}
    if len(said) <= 1:
        return said.pop() if said else None
    return NOT_MET if NOT_MET in said else UNDECIDED


def _result(count: Count, flights: Flights) -> dict[str, Any]:
    asked = count.requirement
    lower = count.rule.bounds(count.flights, count.failures)[0]
    upper = count.rule.bounds(count.flights, min(count.failures + count.errors, count.flights))[1]
    return {
        "requirement": asked.text, "metric": asked.metric, "limit": asked.limit, "probability": asked.probability,
        "confidence": asked.confidence, "verdict": count.verdict, "decided_at": count.decided_at,
        "failures": count.failures, "flights": count.flights,
        "allowed": _none_below_0(count.rule.allowed(count.flights)), "lower": lower, "upper": upper,
        "flights_needed": count.flights_needed if count.verdict == UNDECIDED else None,
        "quantile": None if asked.limit is None else quantile(count, flights)}


def _none_below_0(allowed: int) -> int | None:
    return allowed if allowed >= 0 else None


def quantile(count: Count, flights: Flights) -> dict[str, Any]:
    """Return the JSON of an upper bound of the metric's quantile of order 1 - probability, at the confidence asked for.

    The bound is an order statistic.  A flight that is lost, or has no result, counts as beyond all others; the value is
    None if the statistic is such a flight, or flights are too few for one.
    """
    asked = count.requirement
    rank = count.rule.allowed(count.flights) + 1
    values = sorted((_value(outcome, asked.metric) for outcome in flights.outcomes[:count.flights]), reverse=True)
    value = values[rank - 1] if rank > 0 else math.inf
    return {"share": 1.0 - asked.probability, "unit": METRICS[asked.metric],
            "value": json_number(value), "rank_from_largest": rank if rank > 0 else None}


def _value(outcome: Any, metric: str) -> float:
    if isinstance(outcome, str) or outcome["lost"] or math.isnan(outcome[metric]):
        return math.inf
    return float(outcome[metric])


def _metric(values: Sequence[float], unit: str) -> dict[str, Any]:
    """Return median and largest finite value of a metric over the flights that were not lost; None without any."""
    known = [x for x in values if math.isfinite(x)]
    if not known:
        return {"unit": unit, "median": None, "largest": None}
    return {"unit": unit, "median": float(np.median(known)), "largest": max(known)}


# ---- words


def said(report: dict[str, Any], name: str) -> str:
    """Return the JSON `report` of a campaign as text for a terminal; `name` begins it."""
    last = report["seed"] + report["flown"] - 1
    early = "" if report["flown"] == report["flights"] else f" of {report['flights']}, and no more were needed"
    lines = [f"{name}: {report['nominal']}, {report['flown']} flights{early} (seeds {report['seed']} to {last}): "
             f"{report['lost']} lost" + (f", {report['without_result']} without a result"
                                         if report["without_result"] else "")]
    lines += [_in_words(result, report["stop"] == "never") for result in report["results"]]
    if not report["results"]:
        lines += [f"{name}: median {m['median']:.3g}, largest {m['largest']:.3g} {m['unit']}"
                  for name, m in report["metrics"].items() if m["median"] is not None]
    return "\n".join(lines)


def _in_words(r: dict[str, Any], planned: bool) -> str:
    head = f"{r['requirement']}: {r['verdict'].upper()}"
    if r["decided_at"] is not None and not planned:
        head += f" after {r['decided_at']} flights"
    text = f"{head}; {r['failures']} of {r['flights']} failed, a flight fails with a probability below {r['upper']:.3g}"
    text += f" and above {r['lower']:.3g} (each with " if r["lower"] > 0.0 else " ("
    text += f"confidence {r['confidence']:g})"
    known = r["quantile"]
    if known is not None and known["value"] is not None:
        text += f"; {100.0 * known['share']:.6g} % of flights are below {known['value']:.4g} {known['unit']}"
    if r["verdict"] == UNDECIDED:
        text += f"; {r['flights_needed']} flights without a further failure would " + (
            "have been a plan that proves it" if planned else "prove it")
    return text
