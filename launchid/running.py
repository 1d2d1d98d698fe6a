"""A whole log through an estimator."""

from collections.abc import Iterable

import numpy as np

from launchid_core import Config, Estimate, Estimator, Sample

from . import progress

PART = 50_000  # samples between two reports of progress: about a fifth of a second


def run(config: Config, samples: np.ndarray | Iterable[Sample]) -> tuple[list[Estimate], Estimator]:
    """Replay samples, (n, 7) or one by one; the estimate of every window that closed, and the estimator."""
    estimator = Estimator(config)
    if not isinstance(samples, np.ndarray):
        return estimator.replay(samples), estimator
    estimates = []
    for k in range(0, len(samples), PART):
        progress.report("samples", k, len(samples))
        estimates += estimator.replay(samples[k:k + PART])
    return estimates, estimator
