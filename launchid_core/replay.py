"""Whole logs in one call: a compiled loop over what `step` does, which hands back to Python where a window closes.

The same kernels with the same arguments, so the same bits as sample by sample; memory is cut once a call.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from . import ring as rb
from . import step as st
from .kernels import kernel
from .onboard import update_filtered
from .regression import take_sample
from .sample import Sample


@kernel
def take_within(f, i, samples, at):
    """Take rows of samples (n, 7) from `at` on until one may close a window or answers RECOVERED: a regression's.

    f, i  inout  of a `memory.Block`
    Returns (the row after the last taken, ACCEPTED); (that after the damage, RECOVERED).
    """
    fixed, state, _, _ = st.cut_sample(f, i)
    for k in range(at, samples.shape[0]):
        s = samples[k]
        if not rb.stays_within(fixed.limits, state.clock, state.counts, s[0]):
            return k, rb.ACCEPTED
        if take_sample(fixed, state, s[0], s[1], s[2], s[3], s[4], s[5], s[6]) == rb.RECOVERED:
            return k + 1, rb.RECOVERED
    return samples.shape[0], rb.ACCEPTED


@kernel
def replay_filtered(f, i, structured, ranged, samples, at):
    """Take rows of samples (n, 7) from `at` on until one answers WINDOW_COMPLETE or RECOVERED: the filter's.

    structured, ranged  in  as of `step_filtered`
    Returns (the row after it, its status); (n, ACCEPTED) at the end.
    """
    fixed, state, work, learner, learning, sigma, gauge = st.cut_whole(f, i, structured, ranged)
    for k in range(at, samples.shape[0]):
        s = samples[k]
        code = update_filtered(fixed, state, work, learner, learning, sigma, gauge, s[0], s[1], s[2], s[3], s[4], s[5],
                               s[6])
        if code == rb.WINDOW_COMPLETE or code == rb.RECOVERED:
            return k + 1, code
    return samples.shape[0], rb.ACCEPTED


def loop_of(formulation: str) -> Callable[..., Any]:
    """The compiled loop of a formulation.

    A regression's ends before what may close a window, which is for its `step`: the close is not compiled again.
    """
    return replay_filtered if formulation == "filtered" else take_within


def table_of(samples: Any) -> np.ndarray:
    """Samples as (n, 7) float64, the fields of `Sample` in their order; ValueError for another shape."""
    table = np.ascontiguousarray(samples if isinstance(samples, np.ndarray) else list(samples), np.float64)
    if table.size == 0:
        return np.zeros((0, rb.N_COLUMNS))
    if table.ndim != 2 or table.shape[1] != rb.N_COLUMNS:
        raise ValueError(f"samples of shape {table.shape}: expected (n, {rb.N_COLUMNS}), the fields of Sample: "
                         f"{', '.join(Sample._fields)}")
    return table
