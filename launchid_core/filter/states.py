"""Places in the filter's state and in its tables; a profile between its nodes."""

from ..kernels import inner

N_STATES = 4    # of the vehicle: theta, theta_dot, beta, beta_dot
N_CHANNELS = 3  # theta, theta_dot, beta
# what a window is tested for: slopes of a6 and k1; what no model has, an acceleration that stays, an offset of the gyro
SLOPE_A6, SLOPE_K1, MOMENT_TEST, GYRO_TEST = range(4)
N_TESTS = 4
N_SLOPES = 2    # of them
MAX_DELAY_SAMPLES = 64  # past commands that are kept
# process noises among the levels
COMMAND_NOISE = 3
ACCELERATION_NOISE = 4
# a relative deviation from the nominal
A6, K1 = range(2)
# what is believed of them
MOMENTS = {"mean_a6": "mean", "mean_k1": "mean", "var_a6": "variance", "cov": "covariance", "var_k1": "variance"}
FIRST_STD = 0.5  # relative: what is known of either before any data
CHANGE_BLOCKS = 24  # blocks that sudden changes are sought in: 2.4 s at 0.1 s
# a row of `air` (f8)
AIR_T, AIR_WIND, AIR_ALPHA, AIR_BETA = range(4)
N_AIR = 4
# a row of a profile (f8): time [s], a6, k1 [1/s^2], or the range of both
NODE_T, NODE_A6, NODE_K1 = range(3)
N_NODE = 3
ABSENT = -1     # a place that is none


@inner
def place_in(nodes, t):
    """Return (row before t [s], row behind, share of the way) in nodes (n, any), held beyond both ends; NaN: the first
    node's."""
    low, high = 0, nodes.shape[0] - 1
    if nodes.shape[0] == 1 or not t > nodes[0, NODE_T]:
        return 0, 0, 0.0
    if t >= nodes[high, NODE_T]:
        return high, high, 0.0
    for _ in range(64):  # bisection of at most 2^63 nodes
        if high - low <= 1:
            break
        middle = (low + high) // 2
        if nodes[middle, NODE_T] <= t:
            low = middle
        else:
            high = middle
    return low, high, (t - nodes[low, NODE_T]) / (nodes[high, NODE_T] - nodes[low, NODE_T])


@inner
def profile_at(profile, t):
    """(a6, k1) of a profile (nodes, 3) at t [s], linear between its nodes."""
    low, high, share = place_in(profile, t)
    return (profile[low, NODE_A6] + share * (profile[high, NODE_A6] - profile[low, NODE_A6]),
            profile[low, NODE_K1] + share * (profile[high, NODE_K1] - profile[low, NODE_K1]))


@inner
def air_at(air, column, t):
    """One column of the air's nodes at t [s], linear between them."""
    low, high, share = place_in(air, t)
    return air[low, column] + share * (air[high, column] - air[low, column])
