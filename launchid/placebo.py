"""Placebo: an input that makes a motion explains it better than the same input of another time of the log does."""

from collections.abc import Iterable, Sequence

import numpy as np


def of_other_times(x: np.ndarray, shares: Sequence[float]) -> list[np.ndarray]:
    """Return x (n, ...) shifted along the log by shares of its length, its end before its beginning."""
    return [np.roll(x, round(share * len(x)), axis=0) for share in shares]


def is_placebo(own: float, others: Iterable[float], share: float, least: float = 0.0) -> bool:
    """Return whether an input explains a motion no better than the inputs of other times do.

    Parameters
    ----------
    own, others : float, floats
        What the input gains over none (nats, or squares), and what those of other times gain; less than 0 is 0.
    share : float
        Of its own gain, by which it must be ahead of all others.
    least : float
        By which it must be ahead at least.
    """
    return own - max(0.0, *others) < max(least, share * own)
