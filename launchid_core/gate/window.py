"""The outcome that a window's close leaves behind."""

import numpy as np

from ..kernels import inner
from ..status import EstimateStatus

EQUATIONS = 3  # theta_dot, theta_ddot, beta_dot
ATTITUDE = 1   # place of theta_ddot's equation, which a6 and k1 live in

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
    """Clear the outcome: no estimate, for the reason `status`."""
    out.a6 = np.nan
    out.k1 = np.nan
    out.a6_std = np.nan
    out.k1_std = np.nan
    out.correlation = np.nan
    out.a6_dot = np.nan
    out.k1_dot = np.nan
    out.a6_bound = np.nan
    out.k1_bound = np.nan
    out.condition = np.nan
    out.whiteness = np.nan
    out.xi[:, :] = np.nan
    out.support[:, :] = 0
    out.std[:] = np.nan
    out.absent[:] = np.nan
    out.status = status
