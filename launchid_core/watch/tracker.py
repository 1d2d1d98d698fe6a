"""The tracked estimate: relative deviations of a6 and k1, followed from block to block.

A bank of Kalman filters, each with its own random walk and a slope that forgets itself over SLOPE_TIME, weighted by how
well each predicted the last seconds (dynamic model averaging: Raftery, Karny & Ettler, Technometrics 52, 2010).  A
block's data are two scalar measurements with unit noise, the rows of its square-root information.
"""

import numpy as np

from ..algebra.elementary import exp_of, log_of
from ..algebra.linsolve import measure
from ..filter import states as sx
from ..filter.kalman import spread_at
from ..kernels import inner
from ..model import TURBULENCE

# (random walk [relative per sqrt(s)], standard deviation of the slope [relative per s]) of each member
STEADY = (0.0015, 0.0)     # 1.3 % in 70 s
DRIFTING = (0.003, 0.01)   # 10 % with a period of 60 s has slopes of 0.0074, root mean square
MEMBERS = np.array([STEADY, DRIFTING])
TRACKER_WALK, TRACKER_SLOPE = range(2)
MEMBER_STATES = 4
SLOPE_TIME = 20.0          # s: a slope is forgotten over this time
DRIFT_LEVELS = (1.0, 3.0)  # of the members' slopes over those that are declared
MINUTE = 60.0              # s
TRACKER_MEMORY = 30.0      # s over which the members are judged


def slopes_of(a6_drift, k1_drift):
    """Return one sigma of the slopes of a6 and k1 (members, 2) [relative, 1/s], from those declared [1/min]."""
    if a6_drift == k1_drift == 0.0:
        return np.repeat(MEMBERS[:, TRACKER_SLOPE:], 2, axis=1)
    return np.outer(DRIFT_LEVELS, (a6_drift / MINUTE, k1_drift / MINUTE))


@inner
def restart_bank(slopes, state, mean_a6, mean_k1, v_aa, v_ak, v_kk):
    """Give every member this mean and covariance of (a6, k1), slopes 0; the members' weights stay.

    slopes (members, 2)  in  one sigma of the slopes of a6 and k1, 1/s
    """
    for i in range(len(MEMBERS)):
        state.mean[i, :] = 0.0
        state.mean[i, 0], state.mean[i, 1] = mean_a6, mean_k1
        state.covariance[i, :, :] = 0.0
        state.covariance[i, 0, 0], state.covariance[i, 1, 1] = v_aa, v_kk
        state.covariance[i, 0, 1], state.covariance[i, 1, 0] = v_ak, v_ak
        for k in range(2, 4):
            state.covariance[i, k, k] = slopes[i, k - 2] * slopes[i, k - 2]
    mix(state)


@inner
def move(mean, covariance, states, walk, slope_a6, slope_k1, dt):
    """Propagate one member's state (a6, k1, their slopes, and what does not move) over dt [s].  mean (m,), covariance
    (m, m), m states"""
    keep = exp_of(-dt / SLOPE_TIME)
    for i in range(2):
        mean[i] += dt * mean[2 + i]
        mean[2 + i] *= keep
    for j in range(states):
        for i in range(2):
            covariance[i, j] += dt * covariance[2 + i, j]
            covariance[2 + i, j] *= keep
    for i in range(states):
        for j in range(2):
            covariance[i, j] += dt * covariance[i, 2 + j]
            covariance[i, 2 + j] *= keep
    for i in range(2):
        covariance[i, i] += walk * walk * dt
    covariance[2, 2] += slope_a6 * slope_a6 * (1.0 - keep * keep)
    covariance[3, 3] += slope_k1 * slope_k1 * (1.0 - keep * keep)


@inner
def absorb(mean, covariance, work, h0, h1, z):
    """Update one member with a scalar measurement z = h0 a6 + h1 k1 + unit noise; return its log predictive density."""
    row = work.row
    row[:] = 0.0
    row[sx.A6], row[sx.K1] = h0, h1
    e, variance = measure(mean, covariance, row[:], 0, MEMBER_STATES, z, work.column[:])
    return -0.5 * (log_of(variance) + e * e / variance)


@inner
def mix(state):
    """Write mean and covariance of the weighted members to `total`."""
    b = len(MEMBERS)
    best = state.evidence[0]
    for i in range(1, b):
        best = max(best, state.evidence[i])
    norm = 0.0
    for i in range(b):
        state.weight[i] = exp_of(state.evidence[i] - best)
        norm += state.weight[i]
    total = state.total
    total.mean_a6, total.mean_k1 = 0.0, 0.0
    total.var_a6, total.cov, total.var_k1 = 0.0, 0.0, 0.0
    for i in range(b):
        state.weight[i] /= norm
        total.mean_a6 += state.weight[i] * state.mean[i, sx.A6]
        total.mean_k1 += state.weight[i] * state.mean[i, sx.K1]
    for i in range(b):
        w, d0, d1 = state.weight[i], state.mean[i, sx.A6] - total.mean_a6, state.mean[i, sx.K1] - total.mean_k1
        total.var_a6 += w * (state.covariance[i, sx.A6, sx.A6] + d0 * d0)
        total.cov += w * (state.covariance[i, sx.A6, sx.K1] + d0 * d1)
        total.var_k1 += w * (state.covariance[i, sx.K1, sx.K1] + d1 * d1)


@inner
def track(slopes, state, work, memory, dt, block):
    """Follow one block of dt [s], block (3, 3) being its square-root information about (a6, k1), right-hand side last;
    returns its log predictive density, but for a constant."""
    fade = exp_of(-dt / memory)
    best = -np.inf
    for i in range(len(MEMBERS)):
        mean, covariance = state.mean[i], state.covariance[i]
        move(mean, covariance, MEMBER_STATES, MEMBERS[i, TRACKER_WALK], slopes[i, 0], slopes[i, 1], dt)
        density = absorb(mean, covariance, work, block[0, 0], block[0, 1], block[0, 2])
        density += absorb(mean, covariance, work, 0.0, block[1, 1], block[1, 2])
        state.evidence[i] = fade * state.evidence[i] + density
        work.density[i] = density
        best = max(best, density)
    total = 0.0
    for i in range(len(MEMBERS)):
        total += state.weight[i] * exp_of(work.density[i] - best)
    mix(state)
    return best + log_of(total)


@inner
def restate_declared(belief, fil, bank, work, dt):
    """Tell the quick member again what is declared of the constants that nobody knows.

    A constant offset is tied to the deviations p, x + s (p - p_bar), by the data that do not tell them apart; as the
    member lets p wander over SLOPE_TIME, it would take the offset along, beyond anything declared.
    """
    n, quickest = belief.size.states, len(MEMBERS) - 1
    theta, beta = n + belief.size.theta, n + belief.size.beta
    for k in range(sx.N_STATES, sx.N_STATES + belief.size.nuisances):
        role = belief.role[k - sx.N_STATES]
        if role == TURBULENCE:
            continue
        variance = spread_at(belief, fil, k - sx.N_STATES, fil.time.last)
        known = 1.0 - fil.p[k, k] / variance
        if not known > 0.0:
            continue
        w = np.sqrt(known / variance * dt / SLOPE_TIME)
        z = w * (fil.s[k, theta] * fil.p_bar[sx.A6] + fil.s[k, beta] * fil.p_bar[sx.K1] - fil.x[k])
        absorb(bank.mean[quickest], bank.covariance[quickest], work, w * fil.s[k, theta], w * fil.s[k, beta], z)
    if belief.size.nuisances > 0:
        mix(bank)
