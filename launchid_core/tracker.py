"""The tracked estimate: relative deviations of a6 and k1, followed from block to block.

A bank of Kalman filters, each believing the deviations to be random walks of
another speed, weighted by how well each predicted the last seconds (dynamic
model averaging: Raftery, Karny & Ettler, Technometrics 52, 2010).  No single
speed serves a constant and a drifting deviation; the weights choose.

A block's data reach the bank as two scalar measurements with unit noise, the
rows of its square-root information.
"""

import math
from typing import NamedTuple

import numpy as np

from .kernels import kernel

SPEEDS = (0.0015, 0.008, 0.025)  # relative per sqrt(s): still, slow, and 10 % in a quarter of 60 s
MEMORY = 30.0                    # s over which the speeds are judged
FIRST_STD = 0.5                  # relative: what is known of the deviations before the first sample


class Bank(NamedTuple):
    """State of the tracker with b speeds."""

    mean: np.ndarray        # (b, 2)
    covariance: np.ndarray  # (b, 3) a6 a6, a6 k1, k1 k1
    evidence: np.ndarray    # (b,) forgotten sum of log predictive densities
    total: np.ndarray       # (5,) mean a6, mean k1, covariance (3) of the mixture
    weight: np.ndarray      # (b,)


def bank() -> Bank:
    """Allocate the tracker."""
    b = len(SPEEDS)
    return Bank(np.zeros((b, 2)), np.zeros((b, 3)), np.zeros(b), np.zeros(5), np.full(b, 1.0 / b))


@kernel
def restart_bank(state, mean_a6, mean_k1, v_aa, v_ak, v_kk):
    """Every member believes the same; the speeds' evidence stays."""
    for i in range(state.mean.shape[0]):
        state.mean[i, 0], state.mean[i, 1] = mean_a6, mean_k1
        state.covariance[i, 0], state.covariance[i, 1], state.covariance[i, 2] = v_aa, v_ak, v_kk
    mix(state)


@kernel
def measure(mean, covariance, h0, h1, z):
    """One scalar measurement z = h0 a + h1 k + unit noise of one member; returns its log predictive density."""
    c0, c1, c2 = covariance[0], covariance[1], covariance[2]
    y0, y1 = c0 * h0 + c1 * h1, c1 * h0 + c2 * h1
    variance = h0 * y0 + h1 * y1 + 1.0
    e = z - h0 * mean[0] - h1 * mean[1]
    mean[0] += y0 / variance * e
    mean[1] += y1 / variance * e
    covariance[0] = c0 - y0 * y0 / variance
    covariance[1] = c1 - y0 * y1 / variance
    covariance[2] = c2 - y1 * y1 / variance
    return -0.5 * (math.log(variance) + e * e / variance)


@kernel
def mix(state):
    """Mean and covariance of the weighted members into `total`."""
    b = state.mean.shape[0]
    best = state.evidence[0]
    for i in range(1, b):
        best = max(best, state.evidence[i])
    norm = 0.0
    for i in range(b):
        state.weight[i] = math.exp(state.evidence[i] - best)
        norm += state.weight[i]
    total = state.total
    total[:] = 0.0
    for i in range(b):
        state.weight[i] /= norm
        total[0] += state.weight[i] * state.mean[i, 0]
        total[1] += state.weight[i] * state.mean[i, 1]
    for i in range(b):
        w, d0, d1 = state.weight[i], state.mean[i, 0] - total[0], state.mean[i, 1] - total[1]
        total[2] += w * (state.covariance[i, 0] + d0 * d0)
        total[3] += w * (state.covariance[i, 1] + d0 * d1)
        total[4] += w * (state.covariance[i, 2] + d1 * d1)


@kernel
def track(state, speeds, memory, dt, block):
    """Follow one block.

    state  inout
    speeds (b,) in   relative per sqrt(s)
    memory [s]  in
    dt     [s]  in   time the block spans
    block  (3, 3) in its square-root information about (a6, k1), right-hand side last
    """
    fade = math.exp(-dt / memory)
    for i in range(state.mean.shape[0]):
        growth = speeds[i] * speeds[i] * dt
        mean, covariance = state.mean[i], state.covariance[i]
        covariance[0] += growth
        covariance[2] += growth
        density = measure(mean, covariance, block[0, 0], block[0, 1], block[0, 2])
        density += measure(mean, covariance, 0.0, block[1, 1], block[1, 2])
        state.evidence[i] = fade * state.evidence[i] + density
    mix(state)
