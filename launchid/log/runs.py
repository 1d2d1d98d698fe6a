"""Find runs of True in a flag that each row has."""

import numpy as np


def runs_of(flag: np.ndarray) -> np.ndarray:
    """Return (k, 2) int: first row, and the row after the last, of each run of True in flag (n,)."""
    edges = np.diff(np.concatenate(([0], flag.astype(np.int8), [0])))
    return np.stack((np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)), axis=1)
