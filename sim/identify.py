"""Runs the on-board estimator over a log or a flight, and puts its words into the contract's JSON."""

import math
from collections.abc import Callable, Iterable
from typing import Any

from launchid_core import Config, Estimate, Estimator, Sample, Status

Progress = Callable[[], None]


def run(config: Config, samples: Iterable[Sample]) -> tuple[list[Estimate], Estimator]:
    """Feed samples one at a time; the estimate of every window that closed, and the estimator for its counters."""
    estimator = Estimator(config)
    update = estimator.update
    estimates = []
    for sample in samples:
        if update(sample) == Status.WINDOW_COMPLETE:
            estimate = estimator.estimate()
            assert estimate is not None
            estimates.append(estimate)
    return estimates, estimator


def whole_log(rows: int, period: float, t_first: float, t_last: float) -> dict[str, float]:
    """Config fields `window` and `sample_period` that make one window of a whole log."""
    span = max(t_last - t_first, period)
    period = min(period, span / max(rows - 1, 1))
    return {"window": span + period, "sample_period": period}


def number(x: float) -> float | None:
    """A JSON number: null for what is not finite."""
    return float(x) if math.isfinite(x) else None


def window_json(estimate: Estimate) -> dict[str, Any]:
    """One window in the contract's words."""
    names = ("a6", "k1", "a6_std", "k1_std", "a6_k1_corr", "a6_dot", "k1_dot", "a6_bound", "k1_bound", "condition")
    active = [(term, estimate.xi[j, 1]) for j, term in enumerate(estimate.terms) if estimate.support[j, 1]]
    return {"t_start": estimate.t_start, "t_end": estimate.t_end, "valid": bool(estimate.valid),
            "status": estimate.status.name, **{name: number(getattr(estimate, name)) for name in names},
            "terms": {term: number(value) for term, value in active}}


def report(estimates: list[Estimate], estimator: Estimator) -> dict[str, Any]:
    """The identify JSON: windows, and what became of the samples."""
    counts = estimator.counts
    return {"windows": [window_json(estimate) for estimate in estimates],
            "samples": {"accepted": sum(n for name, n in counts.items() if Status[name] >= 0),
                        "rejected": {name: n for name, n in counts.items() if Status[name] < 0 and n > 0}}}
