"""A whole log through an estimator."""

from collections.abc import Iterable

import numpy as np

from launchid_core import Config, Estimate, Estimator, Sample


def run(config: Config, samples: np.ndarray | Iterable[Sample]) -> tuple[list[Estimate], Estimator]:
    """Replay samples, (n, 7) or one by one; the estimate of every window that closed, and the estimator."""
    estimator = Estimator(config)
    return estimator.replay(samples), estimator
