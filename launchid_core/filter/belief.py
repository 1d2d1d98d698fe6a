"""The filtered formulation's model, as its kernels read it."""

from ..kernels import inner

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
# what is believed of them (f8): means, variances and covariance
MEAN_A6, MEAN_K1, VAR_A6, COV, VAR_K1 = range(5)
N_BELIEF = 5
ONSETS = 24  # blocks that sudden changes are sought in: 2.4 s at 0.1 s
# a row of `air` (f8)
AIR_T, AIR_WIND, AIR_ALPHA, AIR_BETA = range(4)
N_AIR = 4
# a row of a profile (f8): time [s], a6, k1 [1/s^2], or the range of both
NODE_T, NODE_A6, NODE_K1 = range(3)
N_NODE = 3
NONE = -1


@inner
def cell_of(table, t):
    """The row of table (nodes, any) behind which t [s] lies, between the first node's time and the last one's."""
    low, high = 0, table.shape[0] - 1
    for _ in range(64):  # bisection of at most 2^63 nodes
        if high - low <= 1:
            break
        middle = (low + high) // 2
        if table[middle, NODE_T] <= t:
            low = middle
        else:
            high = middle
    return low


@inner
def profile_at(profile, cell, t):
    """(a6, k1) of a profile (nodes, 3) at t [s], the first node's at a t that is no number; `cell` (1,) remembers the
    last cell (bisection when t left it)."""
    last = profile.shape[0] - 1
    if not t > profile[0, NODE_T]:
        return profile[0, NODE_A6], profile[0, NODE_K1]
    if t >= profile[last, NODE_T]:
        return profile[last, NODE_A6], profile[last, NODE_K1]
    low = cell[0]
    if not (profile[low, NODE_T] <= t < profile[low + 1, NODE_T]):
        low = cell_of(profile, t)
        cell[0] = low
    share = (t - profile[low, NODE_T]) / (profile[low + 1, NODE_T] - profile[low, NODE_T])
    return (profile[low, NODE_A6] + share * (profile[low + 1, NODE_A6] - profile[low, NODE_A6]),
            profile[low, NODE_K1] + share * (profile[low + 1, NODE_K1] - profile[low, NODE_K1]))


@inner
def air_at(air, column, t):
    """One column of the air's nodes at t, linear between, held beyond (bisection)."""
    last = air.shape[0] - 1
    if not t > air[0, AIR_T]:
        return air[0, column]
    if t >= air[last, AIR_T]:
        return air[last, column]
    low = cell_of(air, t)
    share = (t - air[low, AIR_T]) / (air[low + 1, AIR_T] - air[low, AIR_T])
    return air[low, column] + share * (air[low + 1, column] - air[low, column])
