"""What the filtered formulation believes, as its kernels read it."""

from typing import NamedTuple

import numpy as np

from .kernels import inner, shared
from .library import CODE_LENGTH
from .memory import take, take2
from .records import store

# constant (f8)
(FREQUENCY, DAMPING, TIME_CONSTANT, DELAY, PERIOD, MISSING, HELD, AIRY, TURBULENCE_TIME, GAMMA_STD, LEAN, GYRO_SCALE,
 COMMAND_GAIN, COMMAND_OFFSET, OFFSET, SATURATION, AERO_DAMPING, BLOCK_SHARE) = (*range(15), 17, 20, 21)
# MISSING: share of the time between two samples with a command that no sample holds
# HELD: 1: the gains are the nominal's, whatever a6 and k1 are believed to be (a model with wind levels)
# AIRY: 1: there is a forecast or a drift;  LEAN: known thrust misalignment
# OFFSET, SATURATION: known offsets and end stops of theta, theta_dot, beta;  AERO_DAMPING: known, 1/s
# BLOCK_SHARE: how long a block is over `filtered.BLOCK`: 1 but for whole samples, more where one lasts longer
N_CONSTANTS = BLOCK_SHARE + 1
# term (i8)
AT_THETA, AT_BETA = range(2)
# a relative deviation from the nominal
A6, K1 = range(2)
# a row of `air` (f8)
AIR_T, AIR_WIND, AIR_ALPHA, AIR_BETA = range(4)
N_AIR = 4
NONE = -1


@store
class Belief(NamedTuple):
    """Fixed at construction; r nuisances, L noise levels."""

    time: np.ndarray       # (k,) s, nodes of the profile
    a6: np.ndarray         # (k,) 1/s^2
    k1: np.ndarray         # (k,) 1/s^2
    constant: np.ndarray   # (N_CONSTANTS,)
    variance: np.ndarray   # (L,) declared noises, order of Model.levels
    prior: np.ndarray      # (L,) of their logarithms, 1/variance
    air: np.ndarray        # (n, N_AIR) nodes of forecast wind [rad] and drift [1/s]
    spread: np.ndarray     # (r,) standard deviation of each nuisance at the first sample
    codes: np.ndarray      # (q, 6) int64 library terms
    term: np.ndarray       # (2,) int64 places of theta and beta among them
    role: np.ndarray       # (r,) int64 what each nuisance is, model.WALK .. NOZZLE_BIAS
    level: np.ndarray      # (r,) int64 its place among the noise levels, or NONE
    partner: np.ndarray    # (3,) int64 state that each channel shows beside its own, its offset's, or NONE


@shared
def view_belief(f, at, i, m, q, nodes, r, levels, air_nodes):
    """Cut it from floats f at `at` and integers i at `m`: q terms, r nuisances; returns (it, next at, next m)."""
    time, at = take(f, at, nodes)
    a6, at = take(f, at, nodes)
    k1, at = take(f, at, nodes)
    constant, at = take(f, at, N_CONSTANTS)
    variance, at = take(f, at, levels)
    prior, at = take(f, at, levels)
    air, at = take2(f, at, air_nodes, N_AIR)
    spread, at = take(f, at, r)
    codes, m = take2(i, m, q, CODE_LENGTH)
    term, m = take(i, m, 2)
    role, m = take(i, m, r)
    level, m = take(i, m, r)
    partner, m = take(i, m, 3)
    return Belief(time, a6, k1, constant, variance, prior, air, spread, codes, term, role, level, partner), at, m


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


@inner
def air_at(air, column, t):
    """One column of the air's nodes at t, linear between, held beyond (bisection)."""
    last = air.shape[0] - 1
    if not t > air[0, AIR_T]:
        return air[0, column]
    if t >= air[last, AIR_T]:
        return air[last, column]
    low, high = 0, last
    for _ in range(64):
        if high - low <= 1:
            break
        middle = (low + high) // 2
        if air[middle, AIR_T] <= t:
            low = middle
        else:
            high = middle
    share = (t - air[low, AIR_T]) / (air[high, AIR_T] - air[low, AIR_T])
    return air[low, column] + share * (air[high, column] - air[low, column])
