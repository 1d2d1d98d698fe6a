"""Whole logs in one call: a compiled loop over what `step` does, which hands back to Python where a window has closed.

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
def replay_pointwise(f, i, samples, at):
    """Take rows of samples (n, 7) from `at` on until one answers WINDOW_COMPLETE or RECOVERED.

    f, i  inout  of a `memory.Block`
    Returns (the row after it, its status); (n, ACCEPTED) at the end.
    """
    fixed, state, _, _ = st.cut_sample(f, i)
    for k in range(at, samples.shape[0]):
        s = samples[k]
        code = take_sample(fixed, state, s[0], s[1], s[2], s[3], s[4], s[5], s[6])
        if code == rb.WINDOW_COMPLETE:
            code = st.finish_pointwise(f, i)
        if code == rb.WINDOW_COMPLETE or code == rb.RECOVERED:
            return k + 1, code
    return samples.shape[0], rb.ACCEPTED


@kernel
def replay_integral(f, i, samples, at):
    """As `replay_pointwise`."""
    fixed, state, _, _ = st.cut_sample(f, i)
    for k in range(at, samples.shape[0]):
        s = samples[k]
        code = take_sample(fixed, state, s[0], s[1], s[2], s[3], s[4], s[5], s[6])
        if code == rb.WINDOW_COMPLETE:
            code = st.finish_integral(f, i)
        if code == rb.WINDOW_COMPLETE or code == rb.RECOVERED:
            return k + 1, code
    return samples.shape[0], rb.ACCEPTED


@kernel
def replay_filtered(f, i, structured, ranged, samples, at):
    """As `replay_pointwise`; structured, ranged as of `step_filtered`."""
    fixed, state, work, learner, learning, sigma, gauge = st.cut_whole(f, i, structured, ranged)
    for k in range(at, samples.shape[0]):
        s = samples[k]
        code = update_filtered(fixed, state, work, learner, learning, sigma, gauge, s[0], s[1], s[2], s[3], s[4], s[5],
                               s[6])
        if code == rb.WINDOW_COMPLETE or code == rb.RECOVERED:
            return k + 1, code
    return samples.shape[0], rb.ACCEPTED


def loop_of(formulation: str) -> Callable[..., Any]:
    """The compiled loop of a formulation."""
    if formulation == "filtered":
        return replay_filtered
    return replay_integral if formulation == "integral" else replay_pointwise


def table_of(samples: Any) -> np.ndarray:
    """Samples as (n, 7) float64, the fields of `Sample` in their order; ValueError for another shape."""
    table = np.ascontiguousarray(samples if isinstance(samples, np.ndarray) else list(samples), np.float64)
    if table.size == 0:
        return np.zeros((0, rb.N_COLUMNS))
    if table.ndim != 2 or table.shape[1] != rb.N_COLUMNS:
        raise ValueError(f"samples of shape {table.shape}: expected (n, {rb.N_COLUMNS}), the fields of Sample: "
                         f"{', '.join(Sample._fields)}")
    return table
