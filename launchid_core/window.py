"""What a window's close leaves behind."""

from typing import NamedTuple

import numpy as np

from .kernels import shared
from .memory import take, take2
from .records import store

EQUATIONS = 3  # theta_dot, theta_ddot, beta_dot
ATTITUDE = 1   # the equation that a6 and k1 live in

# number (f8) of an outcome
O_A6, O_K1, O_A6_STD, O_K1_STD, O_CORRELATION, O_A6_DOT, O_K1_DOT, O_A6_BOUND, O_K1_BOUND, O_CONDITION, O_WHITENESS = (
    range(11))
N_NUMBERS = 11
# flag (i8) of an outcome: an EstimateStatus, rows used, gaps inside the window
STATUS, USED, GAPS_SEEN = range(3)
N_FLAGS = 3


@store
class Outcome(NamedTuple):
    """Result of the last window."""

    number: np.ndarray   # (N_NUMBERS,)
    flag: np.ndarray     # (N_FLAGS,) int64
    xi: np.ndarray       # (q, 3)
    support: np.ndarray  # (q, 3) int64, 1: active
    std: np.ndarray      # (q,) standard deviation of a term of theta_ddot that is active; NaN for those that are not
    absent: np.ndarray   # (q,) 95 % limit of a term of theta_ddot that is not active; NaN for those that are


@shared
def view_outcome(f, at, i, m, q):
    """Cut it from floats f at `at` and integers i at `m` for q terms; returns (it, next at, next m)."""
    number, at = take(f, at, N_NUMBERS)
    flag, m = take(i, m, N_FLAGS)
    xi, at = take2(f, at, q, EQUATIONS)
    support, m = take2(i, m, q, EQUATIONS)
    std, at = take(f, at, q)
    absent, at = take(f, at, q)
    return Outcome(number, flag, xi, support, std, absent), at, m


@shared
def clear_outcome(out, status):
    """No estimate, for the reason `status`."""
    out.number[:] = np.nan
    out.xi[:, :] = np.nan
    out.support[:, :] = 0
    out.std[:] = np.nan
    out.absent[:] = np.nan
    out.flag[STATUS] = status
