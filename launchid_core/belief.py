"""What the filtered formulation believes, as its kernels read it."""

from typing import NamedTuple

import numpy as np

from .kernels import inner, shared
from .library import CODE_LENGTH
from .memory import take, take2
from .model import N_NOISES

# constant (f8)
FREQUENCY, DAMPING, DELAY, PERIOD, MISSING, SATURATION = range(6)
# MISSING: share of the time between two samples with a command that no sample holds; SATURATION: end stops of theta,
# theta_dot, beta
N_CONSTANTS = SATURATION + 3
# term (i8)
AT_THETA, AT_BETA = range(2)
# a relative deviation from the nominal
A6, K1 = range(2)


class Belief(NamedTuple):
    """Fixed at construction."""

    time: np.ndarray       # (k,) s, nodes of the profile
    a6: np.ndarray         # (k,) 1/s^2
    k1: np.ndarray         # (k,) 1/s^2
    constant: np.ndarray   # (N_CONSTANTS,)
    variance: np.ndarray   # (5,) declared noises, order of model.NOISES
    codes: np.ndarray      # (q, 6) int64 library terms
    term: np.ndarray       # (2,) int64 places of theta and beta among them


@shared
def view_belief(f, at, i, m, q, nodes):
    """Cut it from floats f at `at` and integers i at `m` for q terms, `nodes` nodes; returns (it, next at, next m)."""
    time, at = take(f, at, nodes)
    a6, at = take(f, at, nodes)
    k1, at = take(f, at, nodes)
    constant, at = take(f, at, N_CONSTANTS)
    variance, at = take(f, at, N_NOISES)
    codes, m = take2(i, m, q, CODE_LENGTH)
    term, m = take(i, m, 2)
    return Belief(time, a6, k1, constant, variance, codes, term), at, m


@inner
def profile_at(belief, cell, t):
    """(a6, k1) of the profile at t, the first node's at a t that is no number; `cell` (1,) remembers the last cell
    (bisection when t left it)."""
    time = belief.time
    last = time.shape[0] - 1
    if not t > time[0]:
        return belief.a6[0], belief.k1[0]
    if t >= time[last]:
        return belief.a6[last], belief.k1[last]
    low = cell[0]
    if not (time[low] <= t < time[low + 1]):
        low, high = 0, last
        for _ in range(64):  # bisection of at most 2^63 nodes
            if high - low <= 1:
                break
            middle = (low + high) // 2
            if time[middle] <= t:
                low = middle
            else:
                high = middle
        cell[0] = low
    share = (t - time[low]) / (time[low + 1] - time[low])
    return (belief.a6[low] + share * (belief.a6[low + 1] - belief.a6[low]),
            belief.k1[low] + share * (belief.k1[low + 1] - belief.k1[low]))
