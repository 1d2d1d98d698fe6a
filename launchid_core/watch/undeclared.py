"""Wind and misalignment that no nominal declared: followed beside a6 and k1, only to know whether they are there.

A Kalman filter over (a6, k1, their slopes, w, d) takes the acceleration a6_nominal(t) w + k1_nominal(t) d from the
blocks (Wald's test, Trans. Am. Math. Soc. 54, 1943); a second one, which forgets w and d over NEW_MEMORY, follows what
begins or ends (Page's test, Biometrika 41, 1954).  How they go on after a change, a contradiction or a gust:
docs/method.md, "Is the model true?".  Assumption: the acceleration acts on a block as if its a6 and k1 were the
nominal's.
"""

import math

import numpy as np

from ..algebra.elementary import exp_of, log_of
from ..algebra.linsolve import absorb_rows, measure
from ..filter import states as sx
from ..filter.filtered import span_of
from ..filter.whiteness import KEEPS_CHANGING, NO_VERDICT, contradicted_by, quietest_share
from ..kernels import inner, kernel
from .tracker import DRIFTING, MEMBERS, TRACKER_SLOPE, TRACKER_WALK, move

# a filter's state: a6, k1, their slopes, w, d
WIND_STATES = 4            # place of w, and of the first that is no a6 or k1
LEAN_STATE = 5             # place of d
UNDECLARED_SIZE = 6
# the filters
CONSTANT = 0               # of w and d that have been there for long
NEW = 1                    # of such that began or ended lately
FILTERS = 2
N_BLOCK_COLUMNS = 4        # columns of a block: a6, k1, acceleration, right-hand side
UNDECLARED_STD = 0.1       # rad
UNDECLARED_WALK = 5.0e-6   # rad/sqrt(s)
NEW_MEMORY = 5.0           # s
SECOND_EVENT = 4.0         # nats
THERE = 20.0               # of the chi square, which true models exceeded once in 26 h (900 dispersed flights)
LEVEL_PATIENCE = 2.0       # s beyond THERE: a noise level that rises as fast as it may has risen by twice RISEN
RISEN = 0.4                # of a sensor's log noise level
GONE = 9.0                 # below it the model may be believed again


@inner
def forget_places(state, f, first, last):
    """Reset places first .. last-1 of filter f's state to what was known at the beginning."""
    for i in range(first, last):
        state.mean[f, i] = 0.0
        for j in range(UNDECLARED_SIZE):
            state.covariance[f, i, j], state.covariance[f, j, i] = 0.0, 0.0
        std = sx.FIRST_STD if i <= sx.K1 else (UNDECLARED_STD if i >= WIND_STATES else DRIFTING[TRACKER_SLOPE])
        state.covariance[f, i, i] = std * std


@inner
def copy_knowledge(mean, covariance, to_mean, to_covariance):
    """Copy a mean (u,) and covariance (u, u) to to_mean, to_covariance out."""
    for i in range(UNDECLARED_SIZE):
        to_mean[i] = mean[i]
        for j in range(UNDECLARED_SIZE):
            to_covariance[i, j] = covariance[i, j]


@inner
def restart_undeclared(state):
    """Reset both filters to what is known before the first sample."""
    for f in range(FILTERS):
        forget_places(state, f, 0, UNDECLARED_SIZE)
        state.better[f] = 0.0
    state.found = 0
    state.doubt = 0
    state.newer = 0
    state.age = 0
    for slot in range(2):
        copy_knowledge(state.mean[CONSTANT], state.covariance[CONSTANT], state.past[slot], state.past_covariance[slot])
    state.lasted = 0.0


@inner
def begin_block(state):
    """Remember the first filter's knowledge before the block, in a ring of the last CHANGE_BLOCKS blocks."""
    if state.age >= sx.CHANGE_BLOCKS:
        state.newer, state.age = 1 - state.newer, 0
        slot = state.newer
        copy_knowledge(state.mean[CONSTANT], state.covariance[CONSTANT], state.past[slot], state.past_covariance[slot])
    state.age += 1


@inner
def go_back(state, blocks):
    """Set the first filter's knowledge of w and d back to what it was `blocks` (at most CHANGE_BLOCKS) ago, when a6 or
    k1 changed, and forget its a6 and k1."""
    slot = state.newer if state.age >= blocks else 1 - state.newer
    copy_knowledge(state.past[slot], state.past_covariance[slot], state.mean[CONSTANT], state.covariance[CONSTANT])
    forget_places(state, CONSTANT, 0, WIND_STATES)


@inner
def settle_doubt(state, doubt, level):
    """Forget what was learned in doubt, or of a sensor that turned out noisier by RISEN than it was taken for: once
    nothing else contradicts the model any more a6 and k1 are open, and after a gust, of which they learned as it began,
    w and d too.  doubt  what else contradicts the model;  level (L,) in"""
    if doubt != NO_VERDICT:
        state.doubt = max(state.doubt, doubt)
    elif state.doubt == KEEPS_CHANGING:
        restart_undeclared(state)
    elif state.doubt != NO_VERDICT:
        for f in range(FILTERS):
            forget_places(state, f, 0, WIND_STATES)
        state.doubt = NO_VERDICT
    highest = max(level[0], level[1], level[2], 0.0)
    if highest > state.noise + RISEN:
        state.noise = highest
        restart_undeclared(state)


@inner
def forget_constants(covariance, dt):
    """Widen w and d by what NEW_MEMORY forgets in dt [s], never beyond what was known at first."""
    grow = exp_of(0.5 * dt / NEW_MEMORY)
    for k in range(WIND_STATES, UNDECLARED_SIZE):
        if covariance[k, k] * grow * grow <= UNDECLARED_STD * UNDECLARED_STD:
            for j in range(UNDECLARED_SIZE):
                covariance[k, j] *= grow
            for j in range(UNDECLARED_SIZE):
                covariance[j, k] *= grow


@inner
def distance(mean, covariance):
    """Return the Wald statistic, a chi square of two, of w = d = 0; inf if rounding has left no covariance."""
    w, d, c = mean[WIND_STATES], mean[LEAN_STATE], covariance[WIND_STATES:]
    ww, wd, dd = c[0, WIND_STATES], c[0, LEAN_STATE], c[1, LEAN_STATE]
    determinant = ww * dd - wd * wd
    return max(dd * w * w - 2.0 * wd * w * d + ww * d * d, 0.0) / determinant if determinant > 0.0 else np.inf


@inner
def reduce_moment(belief, work, triangle, share):
    """work.triangle (N_BLOCK_COLUMNS, N_BLOCK_COLUMNS) out: of the block's (c, c), the columns of a6, k1, acceleration,
    right-hand side, as if its noise were 1/share of what it is."""
    c = belief.size.columns
    first = c - 1 - sx.N_TESTS
    for i in range(c):
        work.rows[0, i] = share * triangle[i, belief.size.states + belief.size.theta]
        work.rows[1, i] = share * triangle[i, belief.size.states + belief.size.beta]
        work.rows[2, i] = share * triangle[i, first + sx.MOMENT_TEST]
        work.rows[3, i] = share * triangle[i, c - 1]
    work.triangle[:, :] = 0.0
    absorb_rows(work.triangle[:], work.rows[:], N_BLOCK_COLUMNS, c)


@kernel
def follow_undeclared(block, profile):
    """Update both filters of undeclared wind and misalignment with the gathered block; raise or clear FOUND."""
    belief, fil, state, work = block[0].fixed.belief, block[0].state.filter, block[0].state.undeclared, block[0].work
    if belief.size.undeclared == 0:
        return
    doubt = contradicted_by(block[0].state.check)
    dt, t = span_of(block[0].fixed, block[0].state)
    settle_doubt(state, doubt, fil.level)
    if doubt == KEEPS_CHANGING:
        return
    begin_block(state)
    reduce_moment(belief, work.undeclared, work.acc.triangle, quietest_share(fil.level))
    a6, k1 = sx.profile_at(profile, t)
    better = walk = slope_a6 = slope_k1 = 0.0
    slopes = belief.slopes
    for i in range(len(MEMBERS)):  # variances of a6's and k1's walk and slope, as the tracker weighs its members
        walk += block[0].state.bank.weight[i] * MEMBERS[i, TRACKER_WALK] * MEMBERS[i, TRACKER_WALK]
        slope_a6 += block[0].state.bank.weight[i] * slopes[i, 0] * slopes[i, 0]
        slope_k1 += block[0].state.bank.weight[i] * slopes[i, 1] * slopes[i, 1]
    walk, slope_a6, slope_k1 = math.sqrt(walk), math.sqrt(slope_a6), math.sqrt(slope_k1)
    for f in range(FILTERS):
        mean, covariance = state.mean[f], state.covariance[f]
        move(mean, covariance, UNDECLARED_SIZE, walk, slope_a6, slope_k1, dt)
        if f == NEW:
            forget_constants(covariance, dt)
        for k in range(WIND_STATES, UNDECLARED_SIZE):
            covariance[k, k] += UNDECLARED_WALK * UNDECLARED_WALK * dt
        for i in range(N_BLOCK_COLUMNS - 1):
            r, row, column = work.undeclared.triangle[i], work.undeclared.row[:], work.undeclared.column[:]
            row[:] = 0.0
            row[sx.A6], row[sx.K1], row[WIND_STATES], row[LEAN_STATE] = r[0], r[1], a6 * r[2], k1 * r[2]
            e, variance = measure(mean, covariance, row, 0, UNDECLARED_SIZE, r[N_BLOCK_COLUMNS - 1], column)
            density = -0.5 * (log_of(variance) + e * e / variance)
            better += density if f == NEW else -density
    state.better[NEW] = max(state.better[NEW] + better, 0.0)  # nats by which the second predicted the blocks better
    state.better[CONSTANT] = max(state.better[CONSTANT] - better, 0.0)
    for f in range(FILTERS):
        if state.better[f] > SECOND_EVENT:  # both go on from it
            copy_knowledge(state.mean[f], state.covariance[f], state.mean[1 - f], state.covariance[1 - f])
            state.better[:] = 0.0
    contradiction = distance(state.mean[CONSTANT], state.covariance[CONSTANT])
    if not contradiction < np.inf:
        restart_undeclared(state)
        return
    state.lasted = state.lasted + dt if contradiction > THERE else 0.0
    if state.lasted > LEVEL_PATIENCE:
        state.found = 1
    elif contradiction < GONE:
        state.found = 0
