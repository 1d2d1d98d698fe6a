"""A gust after calm: wind that begins anew is no sudden change of a6 or k1 (docs/method.md, "Sudden changes").

While a wind's level is low, the null hypothesis of `changes` is a mixture of two: the filter's own prediction, and that
of a wind that begins anew with the declared levels.  Of the second runs an error d of the filter's state, jointly with
the deviations of a6 and k1.  Both are weighted by how well they predict each block and how often wind begins and ends
(interacting multiple models: Blom & Bar-Shalom, IEEE TAC 33, 1988; only the windy one is restarted from the other).
Assumption: an increment of the wind comes at a block's start.
"""

from ..algebra.elementary import exp_of, log_of
from ..algebra.linsolve import carry_columns, carry_vector, measure
from ..filter import states as sx
from ..filter.filtered import move_wind_level
from ..filter.whiteness import forget_blocks
from ..kernels import inner
from ..model import WALK
from .changes import JUMP_STD
from .tracker import restart_bank

MEAN_CALM = 60.0    # s from a gust to the next after calm, in the mean
GUST_LASTS = 3.0    # s
CALM_LEVEL = -0.6931471805599453  # ln 0.5, of a wind's log level: below it the filter does not expect the declared wind
GUST_PROBABILITY = 0.9  # probability of the gust from which on the filter takes it over
WANDER = 0.003      # relative per sqrt(s), of a6 and k1 meanwhile, as of the tracker's quick member


@inner
def forget_gust(gust):
    """Reset the windy hypothesis: no wind has begun."""
    gust.mean[:] = 0.0
    gust.covariance[:, :] = 0.0
    gust.probability = 0.0


@inner
def is_unexpected(belief, fil, j):
    """Whether nuisance j is a wind whose declared level the filter does not expect."""
    return belief.level[j] >= 0 and fil.level[belief.level[j]] < CALM_LEVEL


@inner
def mix_gust(g, gust, total, share):
    """Let the windy hypothesis start from the calm one with probability `share`, else go on.  total Moments"""
    mean, covariance = gust.mean, gust.covariance
    a, k = g - 2, g - 1
    mean[a] -= total.mean_a6
    mean[k] -= total.mean_k1
    for i in range(g):
        for j in range(g):
            covariance[i, j] = (1.0 - share) * (covariance[i, j] + share * mean[i] * mean[j])
    covariance[a, a] += share * total.var_a6
    covariance[a, k] += share * total.cov
    covariance[k, a] += share * total.cov
    covariance[k, k] += share * total.var_k1
    for i in range(g):
        mean[i] *= 1.0 - share
    mean[a] += total.mean_a6
    mean[k] += total.mean_k1


@inner
def blow(belief, fil, gust, dt):
    """Add to gust.covariance, over a block of dt [s], the declared wind's variance beyond what the filter expects, and
    the wander of a6 and k1."""
    for j in range(belief.size.nuisances):
        if not is_unexpected(belief, fil, j):
            continue
        at = belief.level[j]
        keep = exp_of(-dt / belief.constant.turbulence_time)
        q = belief.variance[at] * (1.0 - exp_of(2.0 * fil.level[at]))
        q *= dt if belief.role[j] == WALK else 1.0 - keep * keep
        gust.covariance[sx.N_STATES + j, sx.N_STATES + j] += q
    for i in range(belief.size.gust - 2, belief.size.gust):
        gust.covariance[i, i] += WANDER * WANDER * dt


@inner
def see_block(g, gust, column, pair):
    """Update the windy hypothesis with the block's rows of unit noise; return their log predictive density.

    column (g,) scratch;  pair (g + 1, g + 1) in  square-root information: d, a6, k1, right-hand side
    """
    mean, covariance = gust.mean[:], gust.covariance[:]
    volume, square = 1.0, 0.0
    for row in range(g):
        e, variance = measure(mean, covariance, pair[row], row, g, pair[row, g], column)
        volume *= variance
        square += e * e / variance
    return -0.5 * (log_of(volume) + square)


@inner
def carry_gust(size, gust, column, transition):
    """Carry the windy hypothesis's error of the state over the block by its transition (n, >=n)."""
    carry_vector(transition, size.states, gust.mean[:], column)
    for i in range(size.gust):  # symmetric: rows are columns
        carry_vector(transition, size.states, gust.covariance[i], column)
    carry_columns(transition, size.states, gust.covariance[:], size.gust, column)


@inner
def follow_gust(belief, fil, gust, column, pair, before, dt, still):
    """Give a block to both; returns the log predictive density of their mixture, `still` where wind is expected anyway.

    column (g,) scratch;  pair (n + 3, n + 3) in  square-root information: offset at the block's start, a6, k1, right
    before  Moments, the tracked belief before the block;  dt [s];  still: log density of the filter's own
    """
    calm = False
    for j in range(belief.size.nuisances):
        calm = calm or is_unexpected(belief, fil, j)
    if not calm:
        forget_gust(gust)
        return still
    begins = (1.0 - gust.probability) * (1.0 - exp_of(-dt / MEAN_CALM))
    prior = begins + gust.probability * exp_of(-dt / GUST_LASTS)
    mix_gust(belief.size.gust, gust, before, begins / prior)
    blow(belief, fil, gust, dt)
    windy = see_block(belief.size.gust, gust, column, pair)
    carry_gust(belief.size, gust, column, fil.s[:])
    best = max(still, windy)
    both = best + log_of((1.0 - prior) * exp_of(still - best) + prior * exp_of(windy - best))
    gust.probability = prior * exp_of(windy - both)
    return both


@inner
def take_gust(belief, fil, acc, gust):
    """Replace the filter's state, covariance and sensitivities by those of the windy hypothesis, and its levels by the
    declared ones.

    d = mean + G (p - p_hat) + r with G = C V^-1, so x + s (p - p_bar) + d is of the same form again.  Left out: what r
    owes to each of the wind's levels.
    """
    n = belief.size.states
    theta, beta = n + belief.size.theta, n + belief.size.beta
    mean, covariance = gust.mean, gust.covariance
    aa, ak, kk = covariance[n, n], covariance[n, n + 1], covariance[n + 1, n + 1]
    volume = aa * kk - ak * ak
    for i in range(n):
        ca, ck = covariance[i, n], covariance[i, n + 1]
        by_a, by_k = (ca * kk - ck * ak) / volume, (ck * aa - ca * ak) / volume
        fil.x[i] += mean[i] + by_a * (fil.p_bar[sx.A6] - mean[n]) + by_k * (fil.p_bar[sx.K1] - mean[n + 1])
        fil.s[i, theta] += by_a
        fil.s[i, beta] += by_k
        for j in range(i + 1):
            fil.p[i, j] += covariance[i, j] - by_a * covariance[j, n] - by_k * covariance[j, n + 1]
            fil.p[j, i] = fil.p[i, j]
    for j in range(belief.size.nuisances):
        if is_unexpected(belief, fil, j):
            at = belief.level[j]
            move_wind_level(belief.size.levels, fil, acc, at, -fil.level[at])


@inner
def accept_gust(belief, state, factor, dt):
    """Let the filter take over wind that has likely begun; returns whether it has.

    It has if it explains the blocks as well as a jump: in the mixture it has paid for being rare, the jump, whose log
    Bayes factor against the mixture is `factor`, has not.  It may have been a loss of k1 after all, which a quiet loop
    tells no better from a gust: k1 is open as after an alarm, so that the tracked estimate follows it and says that it
    is not known.
    """
    gust = state.gust
    a, k = belief.size.gust - 2, belief.size.gust - 1
    if belief.size.gust == 0 or gust.probability <= GUST_PROBABILITY or factor >= log_of(MEAN_CALM / dt):
        return False
    take_gust(belief, state.filter, state.acc, gust)
    restart_bank(belief.slopes[:], state.bank, gust.mean[a], gust.mean[k], gust.covariance[a, a],
                 gust.covariance[a, k], gust.covariance[k, k] + JUMP_STD * JUMP_STD)
    state.watch.counts.kept = 0
    forget_blocks(state.check)
    forget_gust(gust)
    return True
