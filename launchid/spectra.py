"""Segments of a record for averaged spectra (Welch, IEEE Trans. Audio Electroacoustics 15, 1967)."""

from collections.abc import Sequence

import numpy as np


def hann(rows: int) -> np.ndarray:
    """Return the Hann window (rows,) of a segment, which is periodic: the next row would be 0 again."""
    return 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(rows) / rows)


def segments(x: np.ndarray, starts: Sequence[int], window: np.ndarray) -> np.ndarray:
    """Return the segments of x (..., n) that begin at rows `starts` (s,), each without its mean, times the window (r,):
    (..., s, r)."""
    cut = np.stack([x[..., k:k + len(window)] for k in starts], axis=-2)
    return np.asarray((cut - cut.mean(axis=-1, keepdims=True)) * window)
