"""The terms that the vehicle has, learned on many windows' information.

Per window the data cannot tell ten terms apart under sensor noise; the whitened
innovations of the last ten seconds can.  Backward elimination by t-value on a
square-root information matrix with forgetting; a term enters above ENTER and
leaves below LEAVE; the nominal's own two, theta and beta, stay above NOMINAL.
"""

import math

from ..algebra.elementary import exp_of
from ..algebra.linsolve import absorb_columns
from ..algebra.sparse import count_active, covariance_entry, invert_active, solve_active
from ..kernels import inner

ENTER = 4.5       # t-value: ten terms, two sides, once in 15,000 independent looks by chance
LEAVE = 3.5
NOMINAL = 1.0     # theta and beta, the nominal's terms, stay above this: where theta is a ramp theta^2 looks alike
MEMORY = 9.5      # s: forgetting of 0.9 per second
PRIOR = 1.0e-4    # 1/(raw units): keeps the triangle regular before there are data


@inner
def absorb_structure(size, r, work, dt):
    """Fade the information r (q+1, q+1) by a block's time dt [s] and add the block's triangle, the state being known.

    work  AccumulatorWork, triangle in
    """
    n, rows = size.terms + 1, size.columns
    fade = exp_of(-0.5 * dt / MEMORY)
    for i in range(n):
        for j in range(n):
            r[i, j] *= fade
        work.columns[i] = size.states + i if i < n - 1 else rows - 1
    absorb_columns(r, work.triangle[:], work.columns[:], n, rows, work.scratch[:])


@inner
def weakest(q, active, held, theta, beta, coefficient, work):
    """The active term whose t-value falls furthest below its limit; -1 if none does."""
    size = count_active(q, active)
    invert_active(q, work, size)
    worst, worst_share = -1, 1.0
    place = 0
    for j in range(q):
        if active[j]:
            std = math.sqrt(covariance_entry(q, work, place, place))
            limit = LEAVE if held[j] else ENTER
            if j in (theta, beta):
                limit = NOMINAL
            share = abs(coefficient[j]) / (std * limit)
            if share < worst_share:
                worst, worst_share = j, share
            place += 1
    return worst


@inner
def select_terms(q, r, theta, beta, active, coefficient, work):
    """Terms of theta_ddot that the accumulated information supports.

    q                      terms
    r      (q+1, q+1) in   square-root information, right-hand side last, theta's and beta's columns relative
    active (q,) inout      int64, 1 for the terms believed so far; out: believed now
    coefficient (q,) out   of the last solve;  work Learning
    """
    held, mt, y = work.held[:], work.mt[:], work.y[:]
    for j in range(q):
        held[j] = active[j]
        active[j] = 1
        for i in range(q):
            mt[j, i] = r[i, j]
        y[j] = r[j, q] + r[j, theta] + r[j, beta]  # whole coefficients, not deviations from the nominal
    for _ in range(q):
        if solve_active(q, mt, y, active, coefficient, work.sparse) > 0:
            break
        worst = weakest(q, active, held, theta, beta, coefficient, work.sparse)
        if worst < 0:
            break
        active[worst] = 0
        coefficient[worst] = 0.0
