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
# number (f8)
STATISTIC, SUM_WEIGHT, LAST_CHANGE, RESTLESS, LOSSES, LAST_LOSS, LAST_FAILED = range(7)
# SUM_WEIGHT: sum of squared fading weights, the variance of each sum; LAST_CHANGE, RESTLESS [s]: alarm of a sudden
# change, of one soon after another; LOSSES: fading count of restarts because the filter had lost the sensors, the last
# at LAST_LOSS [s]; LAST_FAILED: of a window's test [s]
N_WHITENESS_NUMBERS = 7
# flag (i8)
(OLDEST, BLOCKS_WAITING, WHITENESS_RAISED, IN_WINDOW, RAISED_BY_WINDOW, CHANGED, IS_RESTLESS, HAS_FAILED,
 BEYOND_CHANCE) = range(9)
# place of the oldest block that waits; how many; 1: contradicted; or was so in the window; what the window's test said;
# there was a sudden change; and another one soon after; a window's test has failed before; contradicted beyond chance
N_WHITENESS_FLAGS = 9
PASSED, FAILED, FAILED_BEYOND_CHANCE = range(3)  # a window's test
# what contradicts the model of what is seen here: the statistic; changes that follow one another, a stuck sensor
NO_VERDICT, BLOCKS, KEEPS_CHANGING = range(3)
# mean (f8) of a block, a row a channel: sums of normalised innovations and of their sensitivities for a6 and k1
INNOVATION, FOR_A6, FOR_K1 = range(3)


@inner
def quietest_share(level):
    """Return the largest noise level as a factor of the declared, at most 1, of log levels `level` (L,)."""
    highest = level[0]
    for k in range(1, N_NOISES):
        highest = max(highest, level[k])
    return exp_of(min(highest, 0.0))


@inner
def queue_block(check, level, p_bar, total):
    """The block's sums, normalised, begin to wait.

    They are taken about the tracked belief: about the deviations that the filter is linearised about, the quick
    member's, which follow the noise, they would not be white.

    level (L,), p_bar (2,), total (N_BELIEF,)  in  log noise levels, deviations that the innovations are about, the
    belief before the block
    """
    slot = (check.flag[OLDEST] + check.flag[BLOCKS_WAITING]) % sx.CHANGE_BLOCKS
    for c in range(sx.N_CHANNELS):
        e, a, k = check.mean[c, INNOVATION], check.mean[c, FOR_A6], check.mean[c, FOR_K1]
        e += a * (p_bar[sx.A6] - total[sx.MEAN_A6]) + k * (p_bar[sx.K1] - total[sx.MEAN_K1])
        variance = check.seen[c] + a * a * total[sx.VAR_A6] + 2.0 * a * k * total[sx.COV] + k * k * total[sx.VAR_K1]
        u = e / math.sqrt(variance) if check.seen[c] > 0 else 0.0
        u *= exp_of(min(max(level[c], level[sx.ACCELERATION_NOISE]), 0.0))  # what hides in it contradicts nothing
        check.pending[slot, c] = min(max(u, -BLOCK_SIGMAS), BLOCK_SIGMAS)
        check.seen[c] = 0
    check.mean[:, :] = 0.0
    check.flag[BLOCKS_WAITING] += 1


@inner
def drop_blocks(check, blocks, t):
    """The newest blocks are a sudden change's, whose alarm was raised at t [s].  One that follows another within
    CHECK_MEMORY is none: what keeps changing was not understood.  Within MERGED of its first alarm it is the same one.
    """
    check.flag[BLOCKS_WAITING] = max(check.flag[BLOCKS_WAITING] - blocks, 0)
    since = t - check.number[LAST_CHANGE]
    if check.flag[CHANGED] == 1 and 0.0 <= since <= MERGED:
        return
    if check.flag[CHANGED] == 1 and MERGED < since < CHECK_MEMORY:
        check.number[RESTLESS] = t
        check.flag[IS_RESTLESS] = 1
    check.number[LAST_CHANGE] = t
    check.flag[CHANGED] = 1


@inner
def take_block(check, dt):
    """The oldest block has waited long enough: its products join the sums, and the statistic follows.  dt [s]"""
    slot = check.flag[OLDEST]
    check.flag[OLDEST] = (slot + 1) % sx.CHANGE_BLOCKS
    check.flag[BLOCKS_WAITING] -= 1
    fade = exp_of(-dt / CHECK_MEMORY)
    weight = fade * fade * check.number[SUM_WEIGHT] + 1.0
    check.number[SUM_WEIGHT] = weight
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
    check.number[STATISTIC] = statistic / weight
    if check.number[STATISTIC] > LARGEST_STATISTIC:
        share = math.sqrt(LARGEST_STATISTIC / check.number[STATISTIC])
        for c in range(sx.N_CHANNELS):
            for lag in range(WHITENESS_LAGS + 1):
                check.sums[c, lag] *= share
        check.number[STATISTIC] = LARGEST_STATISTIC


@inner
def contradict(check, t):
    """Contradict the model for CHECK_MEMORY from t [s] on: something is wrong that no block shows."""
    check.number[RESTLESS] = t
    check.flag[IS_RESTLESS], check.flag[WHITENESS_RAISED], check.flag[BEYOND_CHANCE] = 1, 1, 1


@inner
def note_loss(check, t):
    """The filter begins anew at t [s] because it had lost the sensors; often is a fault of the model."""
    since = t - check.number[LAST_LOSS]
    kept = check.number[LOSSES] * exp_of(-since / CHECK_MEMORY) if since >= 0.0 else 0.0
    check.number[LOSSES], check.number[LAST_LOSS] = kept + 1.0, t
    if kept + 1.0 > MANY_LOSSES:
        contradict(check, t)


@inner
def contradicted_by(check):
    """Return what of the blocks contradicts the model: NO_VERDICT, BLOCKS (the statistic) or KEEPS_CHANGING."""
    if check.flag[IS_RESTLESS] == 1:
        return KEEPS_CHANGING
    return BLOCKS if check.number[STATISTIC] > CONTRADICTING_STATISTIC else NO_VERDICT


@inner
def judge_model(check, level, undeclared, t):
    """Raise or clear the contradiction at t [s]; returns True where one that was beyond chance clears.

    level (L,) in  log noise levels;  undeclared  in  1: wind or misalignment that no nominal declared
    """
    highest = 0.0
    for k in range(N_NOISES):
        highest = max(highest, level[k])
    flag = check.flag
    if not 0.0 <= t - check.number[RESTLESS] <= CHECK_MEMORY:  # it is over, or the clock was set back
        flag[IS_RESTLESS] = 0
    persists = flag[IS_RESTLESS] == 1 or flag[RAISED_BY_WINDOW] == FAILED_BEYOND_CHANCE or undeclared == 1
    if persists or check.number[STATISTIC] > CONTRADICTING_STATISTIC or highest > HIGHEST_LEVEL:
        flag[WHITENESS_RAISED], flag[BEYOND_CHANCE] = 1, 1
    elif flag[RAISED_BY_WINDOW] == FAILED:
        flag[WHITENESS_RAISED] = 1
    elif check.number[STATISTIC] < BELIEVED or flag[BEYOND_CHANCE] == 0:
        flag[WHITENESS_RAISED] = 0
    flag[IN_WINDOW] = max(flag[IN_WINDOW], flag[WHITENESS_RAISED])
    cleared = flag[WHITENESS_RAISED] == 0 and flag[BEYOND_CHANCE] == 1
    flag[BEYOND_CHANCE] = min(flag[BEYOND_CHANCE], flag[WHITENESS_RAISED])
    return cleared


@inner
def judge_window(check, level, unexplained, t):
    """A window closed at t [s], whose tests would reduce its sum of squares by `unexplained`.  level (L,) in"""
    share = quietest_share(level)
    unexplained *= share * share
    if not unexplained > STEADY_WINDOW:
        check.flag[RAISED_BY_WINDOW] = PASSED
        return
    again = check.flag[HAS_FAILED] == 1 and 0.0 <= t - check.number[LAST_FAILED] <= LONGEST_MEMORY
    check.flag[RAISED_BY_WINDOW] = FAILED_BEYOND_CHANCE if again or unexplained > FAR_WINDOW else FAILED
    check.number[LAST_FAILED] = t
    check.flag[WHITENESS_RAISED], check.flag[IN_WINDOW], check.flag[HAS_FAILED] = 1, 1, 1


@inner
def forget_blocks(check):
    """The state is unknown again (a gap): what was gathered of a block is dropped, and the past is no neighbour."""
    check.mean[:, :] = 0.0
    check.seen[:] = 0
    check.servo[:, :] = 0.0
    check.flag[BLOCKS_WAITING] = 0
    check.history[:, :] = 0.0


@inner
def likelihood_of_chance(check):
    """p-value of the statistic: a chi square of FREEDOM, by the cube root (Wilson & Hilferty, PNAS 17, 1931)."""
    share = 2.0 / (9.0 * FREEDOM)
    root = exp_of(log_of(max(check.number[STATISTIC] / MEAN_STATISTIC, MIN_STATISTIC)) / 3.0)
    z = (root - 1.0 + share) / math.sqrt(share)
    return 0.5 * erfc_of(z / math.sqrt(2.0))
