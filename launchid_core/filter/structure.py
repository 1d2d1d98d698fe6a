"""The terms that the vehicle has, learned on many windows' information.

Per window the data cannot tell ten terms apart under sensor noise; the innovations of the last ten seconds can.
Backward elimination by t-value on a square-root information matrix with forgetting; a term enters above ENTER and
leaves below LEAVE; the nominal's own two, theta and beta, stay above NOMINAL_TERMS_LEVEL.
"""

import math

from ..algebra.elementary import exp_of
from ..algebra.linsolve import absorb_columns
from ..algebra.sparse import invert, is_regular, leave, solve, variances
from ..kernels import kernel
from .filtered import span_of

ENTER = 4.5       # t-value: ten terms, two sides, once in 15,000 independent looks by chance
LEAVE = 3.5
# theta and beta, the nominal's terms, stay above this: where theta is a ramp theta^2 looks alike
NOMINAL_TERMS_LEVEL = 1.0
STRUCTURE_MEMORY = 9.5  # s: forgetting of 0.9 per second
PRIOR = 1.0e-4    # 1/(raw units): keeps the triangle regular before there are data


@kernel
def learn_structure(block):
    """Fade the information about the terms by the block's time, and add the block's triangle, the state being known."""
    fixed, state, work, r = block[0].fixed, block[0].state, block[0].work.acc, block[0].state.learned[:]
    size, dt = fixed.belief.size, span_of(fixed, state)[0]
    n = size.terms + 1
    fade = exp_of(-0.5 * dt / STRUCTURE_MEMORY)
    for i in range(n):
        for j in range(n):
            r[i, j] *= fade
        work.columns[i] = size.states + i if i < n - 1 else size.columns - 1
    absorb_columns(r, work.triangle[:], work.columns[:], n, size.columns, work.scratch[:])


@kernel
def choose_terms(block):
    """Choose the terms of theta_ddot that the information gathered so far supports.

    Its right-hand side stands last, theta's and beta's columns are relative.
    """
    belief, state, work = block[0].fixed.belief, block[0].state, block[0].work
    q, r, active, coefficient = belief.size.terms, state.learned, state.active[:], block[0].work.acc.coefficient[:]
    theta, beta = belief.size.theta, belief.size.beta
    held, order, norms, variance = work.held[:], work.sparse.order[:], work.sparse.norms[:], work.sparse.weight[:]
    rows = work.sparse.rows[:4 * q * q].reshape((q, 4 * q))
    for j in range(q):
        held[j], active[j], order[j], coefficient[j] = active[j], 1, j, 0.0
        square = 0.0
        for i in range(j + 1):
            square += r[i, j] * r[i, j]
        norms[j] = math.sqrt(square)
        for i in range(q):
            rows[i, j] = r[i, j] / norms[j] if i <= j else 0.0
        rows[j, 3 * q] = r[j, q] + r[j, theta] + r[j, beta]  # whole coefficients, not deviations from the nominal
    invert(q, q, order, rows)
    for gone in range(q):
        if not is_regular(q - gone, order, rows):
            break
        solve(q, q - gone, order, norms, rows, coefficient)
        variances(q, q - gone, rows, variance)
        worst, worst_share = -1, 1.0  # whose t-value falls furthest below its limit
        for j in range(q):
            if active[j]:
                limit = NOMINAL_TERMS_LEVEL if j in (theta, beta) else LEAVE if held[j] else ENTER
                share = abs(coefficient[j]) * norms[j] / (math.sqrt(variance[j]) * limit)
                if share < worst_share:
                    worst, worst_share = j, share
        if worst < 0:
            break
        active[worst] = 0
        coefficient[worst] = 0.0
        leave(q, q - gone, worst, order, rows)
