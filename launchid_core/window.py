"""The arrays of a window's close: what is fixed, scratch, and the result."""

from typing import NamedTuple

import numpy as np

from .library import N_VARIABLES
from .ring import N_COLUMNS
from .sparse import SparseWork, sparse_work

EQUATIONS = 3  # theta_dot, theta_ddot, beta_dot
ATTITUDE = 1   # the equation that a6 and k1 live in

# plan (i8): what is fixed at construction
KEEP, SOLVER, TERM_A6, TERM_K1, TERM_A6_DOT, TERM_K1_DOT, MEASURED = range(7)
N_PLAN = 7

# number (f8) of an outcome
A6, K1, A6_STD, K1_STD, CORRELATION, A6_DOT, K1_DOT, A6_BOUND, K1_BOUND, CONDITION = range(10)
N_NUMBERS = 10
# flag (i8) of an outcome
STATUS, USED, GAPS = range(3)
N_FLAGS = 3

class Plan(NamedTuple):
    """Fixed at construction."""

    codes: np.ndarray       # (q, 6) int64 terms
    centred: np.ndarray     # (4,) int64 variables that may be centred
    plan: np.ndarray        # (N_PLAN,) int64
    threshold: np.ndarray   # (1,) raw units
    max_gap: np.ndarray     # (1,) s
    saturation: np.ndarray  # (6,) end stops by ring column


class Work(NamedTuple):
    """Scratch of a window's close; meaningless on return."""

    signal: np.ndarray      # (6, m) samples by column
    slope: np.ndarray       # (3, m) derivatives of theta, theta_dot, beta
    segment: np.ndarray     # (m,) int64
    usable: np.ndarray      # (m,) int64
    kept: np.ndarray        # (m,) int64
    phi: np.ndarray         # (q*p,) library columns one after the other
    target: np.ndarray      # (3*p,)
    centre: np.ndarray      # (4,)
    scale: np.ndarray       # (4,)
    raw: np.ndarray         # (4,)
    z: np.ndarray           # (4,)
    powers: np.ndarray      # (4, MAX_POWER + 1)
    row: np.ndarray         # (q,)
    previous: np.ndarray    # (q,)
    running: np.ndarray     # (q,)
    order: np.ndarray       # (q,) int64
    tau: np.ndarray         # (q,)
    norms: np.ndarray       # (q,)
    tt: np.ndarray          # (q, q)
    mt: np.ndarray          # (q, q)
    xi: np.ndarray          # (q,)
    active: np.ndarray      # (q,) bool
    sparse: SparseWork


class Outcome(NamedTuple):
    """Result of the last window."""

    number: np.ndarray   # (N_NUMBERS,)
    flag: np.ndarray     # (N_FLAGS,) int64
    xi: np.ndarray       # (q, 3)
    support: np.ndarray  # (q, 3) bool


def regression_work(m: int, p: int, q: int, powers: int) -> Work:
    """Allocate the scratch for windows of m rows, p kept, q terms."""
    def floats(*shape: int) -> np.ndarray:
        return np.zeros(shape)

    def integers(*shape: int) -> np.ndarray:
        return np.zeros(shape, np.int64)

    return Work(floats(N_COLUMNS, m), floats(EQUATIONS, m), integers(m), integers(m), integers(m),
                floats(q * p), floats(EQUATIONS * p), floats(4), floats(4), floats(4), floats(4),
                floats(N_VARIABLES, powers), floats(q), floats(q), floats(q), integers(q), floats(q), floats(q),
                floats(q, q), floats(q, q), floats(q), np.zeros(q, np.bool_), sparse_work(q))


def outcome(q: int) -> Outcome:
    """Allocate the result for q terms."""
    return Outcome(np.full(N_NUMBERS, np.nan), np.zeros(N_FLAGS, np.int64),
                   np.full((q, EQUATIONS), np.nan), np.zeros((q, EQUATIONS), np.bool_))
