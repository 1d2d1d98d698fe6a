"""Which terms the vehicle has, learned on many windows' information.

Per window the data cannot tell ten terms apart under sensor noise; the whitened
innovations of the last ten seconds can.  Backward elimination by t-value on a
square-root information matrix with forgetting; a term enters above ENTER and
leaves below LEAVE; the nominal's own two, theta and beta, stay above NOMINAL.
"""

import math
from typing import NamedTuple

import numpy as np

from .elementary import exp_of
from .kernels import inner, once, shared
from .linsolve import absorb_rows
from .memory import take, take2
from .records import store
from .sparse import SparseWork, covariance_entry, invert_active, solve_active, view_sparse

ENTER = 4.5       # t-value: ten terms, two sides, once in 15,000 independent looks by chance
LEAVE = 3.5
NOMINAL = 1.0     # theta and beta, the nominal's terms, stay above this: where theta is a ramp theta^2 looks alike
MEMORY = 9.5      # s: forgetting of 0.9 per second
PRIOR = 1.0e-4    # 1/(raw units): keeps the triangle regular before there are data


@store
class Learner(NamedTuple):
    """Structure over many windows: what persists."""

    r: np.ndarray       # (q+1, q+1) square-root information, right-hand side last


@store
class Learning(NamedTuple):
    """Its scratch."""

    held: np.ndarray    # (q,) int64
    mt: np.ndarray      # (q, q)
    y: np.ndarray       # (q,)
    sparse: SparseWork


@shared
def view_learner(f, at, i, m, q):
    """Cut it from floats f at `at` for q terms; returns (it, next at, next m)."""
    r, at = take2(f, at, q + 1, q + 1)
    return Learner(r), at, m


@shared
def view_learning(f, at, i, m, q):
    """Cut it from floats f at `at` and integers i at `m` for q terms; returns (it, next at, next m)."""
    held, m = take(i, m, q)
    mt, at = take2(f, at, q, q)
    y, at = take(f, at, q)
    sparse, at, m = view_sparse(f, at, i, m, q)
    return Learning(held, mt, y, sparse), at, m


@once
def absorb_structure(r, triangle, first, scratch, dt):
    """Fade the information r (q+1, q+1) by a block's time dt [s] and add the block's triangle.

    triangle (n, n) in  columns from `first` on belong to the terms, the last to the right-hand side; the state is known
    """
    n, rows = r.shape[0], triangle.shape[0]
    fade = exp_of(-0.5 * dt / MEMORY)
    for i in range(n):
        for j in range(n):
            r[i, j] *= fade
    copy = scratch[:n * rows].reshape((n, rows))
    for j in range(n):
        source = first + j if j < n - 1 else rows - 1
        for i in range(rows):
            copy[j, i] = triangle[i, source]
    absorb_rows(r, copy, rows)


@once
def weakest(active, held, theta, beta, coefficient, work):
    """The active term whose t-value falls furthest below its limit; -1 if none does."""
    size = 0
    for j in range(active.shape[0]):
        if active[j]:
            size += 1
    invert_active(work, size)
    worst, worst_share = -1, 1.0
    place = 0
    for j in range(active.shape[0]):
        if active[j]:
            std = math.sqrt(covariance_entry(work, place, place))
            limit = LEAVE if held[j] else ENTER
            if j in (theta, beta):
                limit = NOMINAL
            share = abs(coefficient[j]) / (std * limit)
            if share < worst_share:
                worst, worst_share = j, share
            place += 1
    return worst


@inner
def select_terms(r, theta, beta, active, coefficient, work):
    """Terms of theta_ddot that the accumulated information supports.

    r      (q+1, q+1) in   square-root information, right-hand side last, theta's and beta's columns relative
    active (q,) inout      int64, 1 for the terms believed so far; out: believed now
    coefficient (q,) out   of the last solve;  work Learning
    Returns how many terms changed.
    """
    q = active.shape[0]
    held, mt, y = work.held, work.mt, work.y
    for j in range(q):
        held[j] = active[j]
        active[j] = 1
        for i in range(q):
            mt[j, i] = r[i, j]
        y[j] = r[j, q] + r[j, theta] + r[j, beta]  # whole coefficients, not deviations from the nominal
    for _ in range(q):
        if solve_active(mt, y, active, coefficient, work.sparse) > 0:
            break
        worst = weakest(active, held, theta, beta, coefficient, work.sparse)
        if worst < 0:
            break
        active[worst] = 0
        coefficient[worst] = 0.0
    changed = 0
    for j in range(q):
        if active[j] != held[j]:
            changed += 1
    return changed
