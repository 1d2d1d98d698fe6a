"""Whole logs in one call: a loop over the entries that `update` calls, which hands back where a window closes.

The same kernels with the same arguments, so the same bits as sample by sample.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from .gate import ring as rb
from .order import onboard
from .order.assembly import Memory
from .order.table import FILTERED
from .regression import regression
from .sample import Sample


def table_of(samples: Any) -> np.ndarray:
    """Samples as (n, 7) float64, the fields of `Sample` in their order; ValueError for another shape."""
    table = np.ascontiguousarray(samples if isinstance(samples, np.ndarray) else list(samples), np.float64)
    if table.size == 0:
        return np.zeros((0, rb.N_COLUMNS))
    if table.ndim != 2 or table.shape[1] != rb.N_COLUMNS:
        raise ValueError(f"samples of shape {table.shape}: expected (n, {rb.N_COLUMNS}), the fields of Sample: "
                         f"{', '.join(Sample._fields)}")
    return table


def loop_of(memory: Memory) -> Callable[[np.ndarray, int], tuple[int, int]]:
    """The loop of an estimator: takes rows of a table from a row on; returns the row after the last taken, and
    WINDOW_COMPLETE or RECOVERED where that one answered so, else ACCEPTED.

    A regression's ends before what may close a window, which is for `update`.
    """
    seen, apart = memory.seen, memory.apart
    if memory.struct is not FILTERED:
        return partial(regression.push_within, seen, apart["ring"], apart["seals"])
    waits = partial(onboard.push_until_due, seen, apart["ring"], apart["seals"], apart["rows"])
    process: Callable[[int], int] = partial(onboard.process_samples, memory.size, seen, memory.words, *apart.values())

    def take(table: np.ndarray, at: int) -> tuple[int, int]:
        while at < len(table):
            at, code = waits(table, at)
            if code >= onboard.DUE:
                code = process(code - onboard.DUE)
            if code in (rb.WINDOW_COMPLETE, rb.RECOVERED):
                return at, code
        return at, rb.ACCEPTED

    return take
