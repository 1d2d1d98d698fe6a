"""The step from a window's rows to coefficients: the library's QR, and the three equations' sparse solutions.

Source: Navarro-Tapia et al., eq. 5 and 6; reduction to q x q in `sparse`.
"""

import numpy as np

from ..algebra.lanes import dot
from ..algebra.library import raw_from_standard
from ..algebra.linsolve import pivot_ratio, qr_factor, scale_columns
from ..algebra.sparse import factor_whole, solve_lasso, solve_own, solve_sr3, solve_ssr, solve_stls
from ..gate import window as wn
from ..gate.window import knows_nothing, knows_one_direction
from ..kernels import inner
from .plan import OWN_SHARE, PAIR, RAW, TERM_A6, TERM_A6_DOT, is_active

EQUATION_ORDER = (0, 2, wn.THETA_REPEATS)  # of the equations: the last one's factor stays, for its standard deviations
RANK_TOLERANCE = 1.0e-12  # on standardised columns of unit norm: 4 digits above rounding
RATE_ARGUMENT = 1         # theta_dot, as the argument of a term's function


@inner
def reduce_library(work, at, q):
    """M with Phi_raw = Q M from the factor of the scaled Phi_std: column i of M into work.mt[i]."""
    for i in range(q):
        for r in range(q):
            work.mt[i, r] = 0.0
        for k in range(q):
            j = work.order[k]
            if work.tt[i, j] != 0.0:
                for r in range(k + 1):
                    work.mt[i, r] += at[k, r] * work.norms[j] * work.tt[i, j]


@inner
def coefficient(work, term):
    """Coefficient of a term; NaN if the library lacks it."""
    return work.xi[term] if term >= 0 else np.nan


@inner
def judge_separation(number):
    """OK, or why a6 and k1 are not known apart, or not at all."""
    a6, k1 = number[wn.O_A6_STD] / abs(number[wn.O_A6]), number[wn.O_K1_STD] / abs(number[wn.O_K1])
    if knows_one_direction(a6, k1, number[wn.O_CORRELATION]):
        return wn.SEPARATION
    return wn.LOW_INFORMATION if knows_nothing(a6, k1) else wn.OK


@inner
def is_driven(plan, codes, active):
    """Whether any active term of theta_ddot is one in theta or beta.  codes (q, 6), active (q,)  in"""
    for j in range(codes.shape[0]):
        if codes[j, 0] > 0 or codes[j, 2] > 0 or (codes[j, 4] > 0 and codes[j, 5] != RATE_ARGUMENT):
            if is_active(plan, active, j):
                return True
    return False


@inner
def factor_library(fixed, state, work, at, pieces):
    """Factor the library; returns OK, RANK, or GAP where each piece's own unknown beginning leaves too few rows.

    at (q + EQUATIONS + PAIR, count)  inout  library columns, targets and drifts, these into the factor's coordinates
    """
    q = fixed.size.terms
    if at.shape[1] - pieces <= q:
        return wn.GAP
    scale_columns(at[:q], work.norms[:])
    rank = qr_factor(at, work.order[:q], work.tau[:], RANK_TOLERANCE)
    if rank < q:
        return wn.RANK
    state.outcome.number[wn.O_CONDITION] = pivot_ratio(at, rank)
    raw_from_standard(fixed.codes[:q], work.centre, work.scale, work.tt)
    reduce_library(work, at, q)
    factor_whole(q, work.mt, work.whole, work.sparse.columns[:])
    return wn.OK


@inner
def keep_equation(fixed, work, out, e, is_solved):
    """The coefficients of equation e into the outcome; returns OK, RANK or NUMERICS."""
    if not is_solved and e == wn.THETA_REPEATS:
        return wn.RANK
    for j in range(fixed.size.terms):
        if is_solved and not np.isfinite(work.xi[j]):
            return wn.NUMERICS
        out.xi[j, e] = work.xi[j] if is_solved else np.nan
        out.support[j, e] = int(is_solved and is_active(fixed.plan, work.active[:], j))
    if e == wn.THETA_REPEATS:
        for p in range(PAIR):
            out.number[wn.O_A6 + p] = coefficient(work, fixed.plan[TERM_A6 + p])
            out.number[wn.O_A6_DOT + p] = coefficient(work, fixed.plan[TERM_A6_DOT + p])
    return wn.OK


@inner
def choose_by_threshold(fixed, work, out, columns, count):
    """Sequentially thresholded least squares of the three equations; returns OK, RANK or NUMERICS."""
    q, status = fixed.size.terms, wn.OK
    for k in range(wn.EQUATIONS):
        if status == wn.OK:
            y = columns[(q + EQUATION_ORDER[k]) * count:(q + EQUATION_ORDER[k]) * count + q]
            passes = solve_stls(q, work.whole, y, fixed.threshold[RAW], work.xi[:], work.active[:], work.sparse)
            status = wn.RANK if passes < 0 else keep_equation(fixed, work, out, EQUATION_ORDER[k], True)
    return status


@inner
def choose_stepwise(fixed, work, out, columns, count):
    """Stepwise sparse regression; as `choose_by_threshold`."""
    q, status = fixed.size.terms, wn.OK
    for k in range(wn.EQUATIONS):
        if status == wn.OK:
            y = columns[(q + EQUATION_ORDER[k]) * count:(q + EQUATION_ORDER[k]) * count + q]
            passes = solve_ssr(q, work.whole, y, fixed.threshold[RAW], work.xi[:], work.active[:], work.sparse)
            status = wn.RANK if passes < 0 else keep_equation(fixed, work, out, EQUATION_ORDER[k], True)
    return status


@inner
def choose_by_share(fixed, work, out, columns, count):
    """Backward elimination by what a term explains by itself; as `choose_by_threshold`."""
    q, status = fixed.size.terms, wn.OK
    for k in range(wn.EQUATIONS):
        if status == wn.OK:
            y = columns[(q + EQUATION_ORDER[k]) * count:(q + EQUATION_ORDER[k] + 1) * count]
            needed = fixed.threshold[OWN_SHARE] * dot(y, y, 0, count)
            passes = solve_own(q, work.whole, y, needed, work.xi[:], work.active[:], work.sparse)
            status = wn.RANK if passes < 0 else keep_equation(fixed, work, out, EQUATION_ORDER[k], True)
    return status


@inner
def choose_by_lasso(fixed, work, out, columns, count):
    """The lasso's support, solved by least squares; as `choose_by_threshold`."""
    q, threshold, status = fixed.size.terms, fixed.threshold[RAW], wn.OK
    for k in range(wn.EQUATIONS):
        if status == wn.OK:
            y = columns[(q + EQUATION_ORDER[k]) * count:(q + EQUATION_ORDER[k] + 1) * count]
            needed = fixed.threshold[OWN_SHARE] * dot(y, y, 0, count)
            passes = solve_lasso(q, work.mt[:], work.whole, y, threshold, needed, work.xi[:], work.active[:],
                                 work.sparse)
            status = keep_equation(fixed, work, out, EQUATION_ORDER[k], passes > 0)
    return status


@inner
def choose_relaxed(fixed, work, out, columns, count):
    """Sparse relaxed regularized regression; as `choose_by_threshold`."""
    q, threshold, status = fixed.size.terms, fixed.threshold[RAW], wn.OK
    for k in range(wn.EQUATIONS):
        if status == wn.OK:
            y = columns[(q + EQUATION_ORDER[k]) * count:(q + EQUATION_ORDER[k] + 1) * count]
            needed = fixed.threshold[OWN_SHARE] * dot(y, y, 0, count)
            passes = solve_sr3(q, work.mt[:], work.whole, y, threshold, needed, work.xi[:], work.active[:], work.sparse)
            status = keep_equation(fixed, work, out, EQUATION_ORDER[k], passes > 0)
    return status
