"""The outcome that a window's close leaves behind."""

import numpy as np

from ..kernels import inner
from ..status import EstimateStatus

EQUATIONS = 3  # theta_dot, theta_ddot, beta_dot
THETA_REPEATS = 1  # the equation that a6 and k1 live in

# number (f8) of an outcome
O_A6, O_K1, O_A6_STD, O_K1_STD, O_CORRELATION, O_A6_DOT, O_K1_DOT, O_A6_BOUND, O_K1_BOUND, O_CONDITION, O_WHITENESS = (
    range(11))
N_WINDOW_NUMBERS = 11
# flag (i8) of an outcome: an EstimateStatus, rows used, gaps inside the window
STATUS, USED, GAPS_SEEN = range(3)
N_WINDOW_FLAGS = 3

OK, SHORT, GAP, RANK, LOW_INFORMATION, SATURATED, NUMERICS, MODEL, SEPARATION, STUCK, _ = map(int, EstimateStatus)

INTERVAL = 1.96        # standard deviations of a 95 % limit
UNKNOWN_STD = 1.0      # relative standard deviation of both: a window says nothing of a6 and k1
ONE_DIRECTION = 0.99   # |correlation| beyond which a6 and k1 are one direction
UNKNOWN_APART = 0.3    # relative standard deviation of both, in one direction: only a combination is known


@inner
def knows_nothing(a6, k1):
    """Whether a window says nothing of a6 and k1, by their relative standard deviations (NaN: none)."""
    return not (a6 <= UNKNOWN_STD or k1 <= UNKNOWN_STD)


@inner
def knows_one_direction(a6, k1, correlation):
    """Whether a window knows only what a6 and k1 have in common, by their relative standard deviations."""
    return abs(correlation) > ONE_DIRECTION and a6 > UNKNOWN_APART and k1 > UNKNOWN_APART


@inner
def clear_outcome(out, status):
    """No estimate, for the reason `status`."""
    out.number[:] = np.nan
    out.xi[:, :] = np.nan
    out.support[:, :] = 0
    out.std[:] = np.nan
    out.absent[:] = np.nan
    out.flag[STATUS] = status
