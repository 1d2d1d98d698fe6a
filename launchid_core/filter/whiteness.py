"""The test whether the model is true, on the innovations, block by block: docs/method.md, "Is the model true?".

Of the right model the sums of a block's normalised innovations are white from block to block, in each channel.  Kept
are fading sums of their means and of their products with earlier blocks: a portmanteau statistic (Ljung & Box,
Biometrika 65, 1978).  A window's score test (Rao, Proc. Camb. Phil. Soc. 44, 1948) asks for a constant acceleration and
an offset of the gyro; `undeclared` asks the same of many windows together.
"""

import math

from ..algebra.elementary import erfc_of, exp_of, log_of
from ..kernels import inner
from ..model import N_NOISES
from . import states as sx

WHITENESS_LAGS = 20     # blocks: 2 s at 0.1 s, a quarter period of 8 s
CHECK_MEMORY = 10.0     # s
CONTRADICTING_STATISTIC = 200.0  # of the statistic
BELIEVED = 90.0
MANY_LOSSES = 3.5       # restarts within CHECK_MEMORY: a change costs one or two, more are a sensor or model gone wrong
LONGEST_MEMORY = 20.0   # s after which whatever contradicted the model, however strongly, is forgotten
# BELIEVED exp(2 LONGEST_MEMORY/CHECK_MEMORY), which has fallen to BELIEVED by then
LARGEST_STATISTIC = 4913.833502982981
MERGED = 2.5            # s: alarms so soon after a first one are of the same change
STEADY_WINDOW = 15.0    # 6e-4 a window, were its noise levels known
FAR_WINDOW = 25.0       # 4e-6
BLOCK_SIGMAS = 4.0      # standard deviations of a block: a moment's surprise is no habit
HIGHEST_LEVEL = 2.302585092994046  # ln 10, of the sensors', the command's and the acceleration's noise levels
MEAN_STATISTIC = float(sx.N_CHANNELS * (WHITENESS_LAGS + 1))  # of white innovations
MIN_STATISTIC = 1.0e-30  # of a statistic whose logarithm is asked for
FREEDOM = 30.0          # of the chi square of that mean and of the statistic's variance, 16.3^2: products of normals

# sums (f8), a row a channel: of the sums, then of the products with 1 .. WHITENESS_LAGS blocks before
MEAN = 0
PASSED, FAILED, FAILED_BEYOND_CHANCE = range(3)  # a window's test
# what contradicts the model of what is seen here: the statistic; changes that follow one another, a stuck sensor
NO_VERDICT, BLOCKS, KEEPS_CHANGING = range(3)


@inner
def quietest_share(level):
    """Return the largest of the log noise levels `level` (L,) as a factor of the declared noise, at most 1: how much
    quieter than declared all channels are."""
    highest = level[0]
    for k in range(1, N_NOISES):
        highest = max(highest, level[k])
    return exp_of(min(highest, 0.0))


@inner
def queue_block(check, level, p_bar, total):
    """Queue the block's normalised sums, which wait before they count.

    They are taken about the tracked belief: about the deviations that the filter is linearised about, the quick
    member's, which follow the noise, they would not be white.

    level (L,), p_bar (2,), total (Moments)  in  log noise levels, deviations that the innovations are about, the
    belief before the block
    """
    slot = (check.oldest + check.waiting) % sx.CHANGE_BLOCKS
    for c in range(sx.N_CHANNELS):
        e, a, k = check.innovation[c], check.for_a6[c], check.for_k1[c]
        e += a * (p_bar[sx.A6] - total.mean_a6) + k * (p_bar[sx.K1] - total.mean_k1)
        variance = check.seen[c] + a * a * total.var_a6 + 2.0 * a * k * total.cov + k * k * total.var_k1
        u = e / math.sqrt(variance) if check.seen[c] > 0 else 0.0
        u *= exp_of(min(max(level[c], level[sx.ACCELERATION_NOISE]), 0.0))  # what hides in it contradicts nothing
        check.pending[slot, c] = min(max(u, -BLOCK_SIGMAS), BLOCK_SIGMAS)
        check.seen[c] = 0
    check.innovation[:] = 0.0
    check.for_a6[:] = 0.0
    check.for_k1[:] = 0.0
    check.waiting += 1


@inner
def drop_blocks(check, blocks, t):
    """Drop the newest blocks, which belong to a sudden change whose alarm was raised at t [s].  A change that follows
    another within CHECK_MEMORY drops none: what keeps changing was not understood.  Within MERGED of its first alarm it
    is the same change."""
    check.waiting = max(check.waiting - blocks, 0)
    since = t - check.last_change
    if check.changed == 1 and 0.0 <= since <= MERGED:
        return
    if check.changed == 1 and MERGED < since < CHECK_MEMORY:
        check.restless = t
        check.is_restless = 1
    check.last_change = t
    check.changed = 1


@inner
def take_block(check, dt):
    """Add the oldest block, which has waited long enough, to the sums, and compute the statistic anew.  dt [s]"""
    slot = check.oldest
    check.oldest = (slot + 1) % sx.CHANGE_BLOCKS
    check.waiting -= 1
    fade = exp_of(-dt / CHECK_MEMORY)
    weight = fade * fade * check.sum_weight + 1.0
    check.sum_weight = weight
    statistic = 0.0
    for c in range(sx.N_CHANNELS):
        u, sums = check.pending[slot, c], check.sums[c]
        sums[MEAN] = fade * sums[MEAN] + u
        statistic += sums[MEAN] * sums[MEAN]
        for lag in range(WHITENESS_LAGS):
            sums[1 + lag] = fade * sums[1 + lag] + u * check.history[lag, c]
            statistic += sums[1 + lag] * sums[1 + lag]
        for lag in range(WHITENESS_LAGS - 1, 0, -1):
            check.history[lag, c] = check.history[lag - 1, c]
        check.history[0, c] = u
    check.statistic = statistic / weight
    if check.statistic > LARGEST_STATISTIC:
        share = math.sqrt(LARGEST_STATISTIC / check.statistic)
        for c in range(sx.N_CHANNELS):
            for lag in range(WHITENESS_LAGS + 1):
                check.sums[c, lag] *= share
        check.statistic = LARGEST_STATISTIC


@inner
def contradict(check, t):
    """Contradict the model for CHECK_MEMORY from t [s] on: something is wrong that no block shows."""
    check.restless = t
    check.is_restless, check.raised, check.beyond_chance = 1, 1, 1


@inner
def note_loss(check, t):
    """Count that the filter restarts at t [s] because it had lost the sensors; if that happens often the model is at
    fault."""
    since = t - check.last_loss
    kept = check.losses * exp_of(-since / CHECK_MEMORY) if since >= 0.0 else 0.0
    check.losses, check.last_loss = kept + 1.0, t
    if kept + 1.0 > MANY_LOSSES:
        contradict(check, t)


@inner
def contradicted_by(check):
    """Return what of the blocks contradicts the model: NO_VERDICT, BLOCKS (the statistic) or KEEPS_CHANGING."""
    if check.is_restless == 1:
        return KEEPS_CHANGING
    return BLOCKS if check.statistic > CONTRADICTING_STATISTIC else NO_VERDICT


@inner
def judge_model(check, level, undeclared, t):
    """Raise or clear the contradiction at t [s]; returns True where one that was beyond chance clears.

    level (L,) in  log noise levels;  undeclared  in  1: wind or misalignment that no nominal declared
    """
    highest = 0.0
    for k in range(N_NOISES):
        highest = max(highest, level[k])
    if not 0.0 <= t - check.restless <= CHECK_MEMORY:  # it is over, or the clock was set back
        check.is_restless = 0
    persists = check.is_restless == 1 or check.by_window == FAILED_BEYOND_CHANCE or undeclared == 1
    if persists or check.statistic > CONTRADICTING_STATISTIC or highest > HIGHEST_LEVEL:
        check.raised, check.beyond_chance = 1, 1
    elif check.by_window == FAILED:
        check.raised = 1
    elif check.statistic < BELIEVED or check.beyond_chance == 0:
        check.raised = 0
    check.in_window = max(check.in_window, check.raised)
    cleared = check.raised == 0 and check.beyond_chance == 1
    check.beyond_chance = min(check.beyond_chance, check.raised)
    return cleared


@inner
def judge_window(check, level, unexplained, t):
    """A window closed at t [s], whose tests would reduce its sum of squares by `unexplained`.  level (L,) in"""
    share = quietest_share(level)
    unexplained *= share * share
    if not unexplained > STEADY_WINDOW:
        check.by_window = PASSED
        return
    again = check.has_failed == 1 and 0.0 <= t - check.last_failed <= LONGEST_MEMORY
    check.by_window = FAILED_BEYOND_CHANCE if again or unexplained > FAR_WINDOW else FAILED
    check.last_failed = t
    check.raised, check.in_window, check.has_failed = 1, 1, 1


@inner
def forget_blocks(check):
    """Drop what was gathered of the block, as the state is unknown again (a gap)."""
    check.innovation[:] = 0.0
    check.for_a6[:] = 0.0
    check.for_k1[:] = 0.0
    check.seen[:] = 0
    check.servo[:, :] = 0.0
    check.waiting = 0
    check.numbers[:, :] = 0.0
    check.history[:, :] = 0.0


@inner
def likelihood_of_chance(check):
    """Return the p-value of the statistic, a chi square of FREEDOM, by its cube root (Wilson & Hilferty, PNAS 17,
    1931)."""
    share = 2.0 / (9.0 * FREEDOM)
    root = exp_of(log_of(max(check.statistic / MEAN_STATISTIC, MIN_STATISTIC)) / 3.0)
    z = (root - 1.0 + share) / math.sqrt(share)
    return 0.5 * erfc_of(z / math.sqrt(2.0))
