"""What a window's close leaves behind."""

import numpy as np

from .kernels import inner

EQUATIONS = 3  # theta_dot, theta_ddot, beta_dot
ATTITUDE = 1   # the equation that a6 and k1 live in

# number (f8) of an outcome
O_A6, O_K1, O_A6_STD, O_K1_STD, O_CORRELATION, O_A6_DOT, O_K1_DOT, O_A6_BOUND, O_K1_BOUND, O_CONDITION, O_WHITENESS = (
    range(11))
N_NUMBERS = 11
# flag (i8) of an outcome: an EstimateStatus, rows used, gaps inside the window
STATUS, USED, GAPS_SEEN = range(3)
N_FLAGS = 3


@inner
def clear_outcome(out, status):
    """No estimate, for the reason `status`."""
    out.number[:] = np.nan
    out.xi[:, :] = np.nan
    out.support[:, :] = 0
    out.std[:] = np.nan
    out.absent[:] = np.nan
    out.flag[STATUS] = status
