"""Samples through an estimator, one at a time."""

from collections.abc import Iterable

from launchid_core import Config, Estimate, Estimator, Sample, Status


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
