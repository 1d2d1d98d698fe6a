"""The step from a window's rows to coefficients: the library's QR, the three equations' sparse solutions, their errors.

The entries of a close between its rows and its end; `regress` is their order.
Source: Navarro-Tapia et al., eq. 5 and 6; reduction to q x q in `sparse`.
"""

import numpy as np

from ..algebra import sparse
from ..algebra.lanes import dot
from ..algebra.library import raw_from_standard
from ..algebra.linsolve import pivot_ratio, qr_factor, rotate, rotate_transposed, scale_columns
from ..algebra.sparse import count_active, factor_whole, solve_lasso, solve_own, solve_sr3, solve_ssr, solve_stls
from ..gate import window as wn
from ..gate.window import knows_nothing, knows_one_direction
from ..kernels import inner, kernel
from .plan import HELD, INTEGRAL, OWN_SHARE, PAIR, RAW, TERM_A6, TERM_A6_DOT
from .residual import report_absent, report_others, report_spread, solve_absent, solve_extended
from .rows import integral_error

RANK_TOLERANCE = 1.0e-12  # on standardised columns of unit norm: 4 digits above rounding
RATE = 1                  # theta_dot, as the argument of a term's function


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
def is_driven(codes, support):
    """Whether any active term of theta_ddot is one in theta or beta.  codes (q, 6), support (q, 3)  in"""
    for j in range(codes.shape[0]):
        in_function = codes[j, 4] > 0 and codes[j, 5] != RATE
        if support[j, wn.ATTITUDE] == 1 and (codes[j, 0] > 0 or codes[j, 2] > 0 or in_function):
            return True
    return False


@kernel
def factor_library(block, phi, target, drift, count, pieces):
    """Factor the library of `count` rows; returns OK, RANK, or GAP where each piece's own unknown beginning leaves too
    few rows.

    Source: Navarro-Tapia et al., eq. 5 and 6; reduction to q x q in `sparse`.
    """
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    q = fixed.size.terms
    if pieces > 0 and count - pieces <= q:
        return wn.GAP
    at = phi[:q * count].reshape((q, count))
    scale_columns(at, work.norms[:])
    rank = qr_factor(at, work.order[:], work.tau[:], RANK_TOLERANCE)
    if rank < q:
        return wn.RANK
    state.outcome.number[wn.O_CONDITION] = pivot_ratio(at, rank)
    raw_from_standard(fixed.codes[:q], work.centre, work.scale, work.tt)
    reduce_library(work, at, q)
    factor_whole(q, work.mt, work.whole)
    rotate_transposed(at, work.tau[:], q, drift[:PAIR * count].reshape((PAIR, count)))
    rotate_transposed(at, work.tau[:], q, target[:wn.EQUATIONS * count].reshape((wn.EQUATIONS, count)))
    return wn.OK


@inner
def thresholds_of(fixed, y, count):
    """The threshold in raw units, and what a term must explain by itself of the squares of y."""
    return fixed.threshold[RAW], fixed.threshold[OWN_SHARE] * dot(y, y, 0, count)


@kernel
def choose_by_threshold(block, target, e, count):
    """Sequentially thresholded least squares of equation e; returns its passes, -1 if columns it took are dependent."""
    fixed, work = block[0].fixed, block[0].work
    q, y = fixed.size.terms, target[e * count:(e + 1) * count]
    return solve_stls(q, work.mt[:], work.whole, y[:q], fixed.threshold[RAW], work.xi[:], work.active[:], work.sparse)


@kernel
def choose_by_share(block, target, e, count):
    """Backward elimination of equation e by what a term explains by itself; as `choose_by_threshold`."""
    fixed, work = block[0].fixed, block[0].work
    q, y = fixed.size.terms, target[e * count:(e + 1) * count]
    _, needed = thresholds_of(fixed, y, count)
    return solve_own(q, work.mt[:], y[:q], needed, work.xi[:], work.active[:], work.sparse)


@kernel
def choose_stepwise(block, target, e, count):
    """Stepwise sparse regression of equation e; as `choose_by_threshold`."""
    fixed, work = block[0].fixed, block[0].work
    q, y = fixed.size.terms, target[e * count:(e + 1) * count]
    return solve_ssr(q, work.mt[:], work.whole, y[:q], fixed.threshold[RAW], work.xi[:], work.active[:], work.sparse)


@kernel
def choose_by_lasso(block, target, e, count):
    """The lasso's support of equation e, solved by least squares; as `choose_by_threshold`."""
    fixed, work = block[0].fixed, block[0].work
    q, y = fixed.size.terms, target[e * count:(e + 1) * count]
    threshold, needed = thresholds_of(fixed, y, count)
    return solve_lasso(q, work.mt[:], y[:q], threshold, needed, work.xi[:], work.active[:], work.sparse)


@kernel
def choose_relaxed(block, target, e, count):
    """Sparse relaxed regularized regression of equation e; as `choose_by_threshold`."""
    fixed, work = block[0].fixed, block[0].work
    q, y = fixed.size.terms, target[e * count:(e + 1) * count]
    threshold, needed = thresholds_of(fixed, y, count)
    return solve_sr3(q, work.mt[:], work.whole, y[:q], threshold, needed, work.xi[:], work.active[:], work.sparse)


@kernel
def keep_equation(block, e, passes):
    """The coefficients of equation e into the outcome; returns OK, RANK or NUMERICS."""
    fixed, work, out = block[0].fixed, block[0].work, block[0].state.outcome
    if passes < 0 and e == wn.ATTITUDE:
        return wn.RANK
    for j in range(fixed.size.terms):
        if passes > 0 and not np.isfinite(work.xi[j]):
            return wn.NUMERICS
        out.xi[j, e] = work.xi[j] if passes > 0 else np.nan
        out.support[j, e] = int(work.active[j] == 1 and passes > 0)
    if e == wn.ATTITUDE:
        for p in range(PAIR):
            out.number[wn.O_A6 + p] = coefficient(work, fixed.plan[TERM_A6 + p])
            out.number[wn.O_A6_DOT + p] = coefficient(work, fixed.plan[TERM_A6_DOT + p])
    return wn.OK


@kernel
def solve_with_drifts(block, target, drift, extended, series, count, pieces):
    """The theta_ddot equation again with the drifts of a6 and k1 beside its terms: residual and influences into
    series (0 to 2); returns how many terms that solution has."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    y = target[wn.ATTITUDE * count:(wn.ATTITUDE + 1) * count]
    return solve_extended(fixed.plan, fixed.size.terms, work, state.outcome, y,
                          drift[:PAIR * count].reshape((PAIR, count)), extended,
                          series[:(2 + PAIR) * count].reshape((2 + PAIR, count)), count - pieces)


@kernel
def solve_without_absent(block, target, series, count, pieces):
    """The residual of the active terms alone into series (3); whether there is one, and terms that are absent."""
    q, work = block[0].fixed.size.terms, block[0].work
    y = target[wn.ATTITUDE * count:(wn.ATTITUDE + 1) * count]
    size = count_active(q, work.active)
    return solve_absent(q, work, y, series[(1 + PAIR) * count:(2 + PAIR) * count], size, count - pieces)


@kernel
def report_deviations(block, rows, marks, phi, extended, series, n, count, pieces, width, known):
    """Standard deviations and correlation of the active terms of theta_ddot, 95 % limits of the others.

    width  of `solve_with_drifts`;  known  of `solve_without_absent`
    """
    fixed, work, out = block[0].fixed, block[0].work, block[0].state.outcome
    plan, q, free = fixed.plan, fixed.size.terms, count - pieces
    at = phi[:q * count].reshape((q, count))
    several = series[:(2 + PAIR) * count].reshape((2 + PAIR, count))
    rotate(at, work.tau[:], q, several, 0 if width > 0 else 1 + PAIR, 2 + PAIR if known else 1 + PAIR)  # in time
    if width > 0:
        if plan[INTEGRAL] == 1:
            integral_error(fixed.codes[:q], work, rows, marks, n, work.xi, plan[HELD])
        report_spread(plan, q, work, out, rows, marks, several, free - width)
        report_others(plan, work, out, rows, marks, at, extended, several, width, free - width)


@kernel
def report_limits(block, phi, extended, series, count, pieces, known):
    """95 % limits of the terms of theta_ddot that are not active; known  of `solve_without_absent`."""
    fixed, work, out = block[0].fixed, block[0].work, block[0].state.outcome
    q = fixed.size.terms
    size = count_active(q, work.active)
    if size < q:
        report_absent(fixed.plan, work, out, phi[:q * count].reshape((q, count)),
                      series[(1 + PAIR) * count:(2 + PAIR) * count], extended, size, known, count - pieces - size - 1)


def solve_equation(solver, by_share, block, target, e, count):
    """Equation e by the solver; returns OK, RANK or NUMERICS.

    solver  index into SOLVERS;  by_share  1: a term stays by what it explains by itself, not by a threshold
    """
    if solver == sparse.SR3:
        passes = choose_relaxed(block, target, e, count)
    elif solver == sparse.LASSO:
        passes = choose_by_lasso(block, target, e, count)
    elif by_share == 1:
        passes = choose_by_share(block, target, e, count)
    elif solver == sparse.SSR:
        passes = choose_stepwise(block, target, e, count)
    else:
        passes = choose_by_threshold(block, target, e, count)
    return keep_equation(block, e, passes)


def regress(size, block, rows, marks, phi, target, drift, extended, series, n, count, pieces):
    """Factor the library, solve the three equations, fill the outcome; returns its status."""
    status = factor_library(block, phi, target, drift, count, pieces)
    for e in range(wn.EQUATIONS):
        if status == wn.OK:
            status = solve_equation(size.solver, size.by_share, block, target, e, count)
            if e == wn.ATTITUDE and status == wn.OK:
                width = solve_with_drifts(block, target, drift, extended, series, count, pieces)
                known = solve_without_absent(block, target, series, count, pieces)
                report_deviations(block, rows, marks, phi, extended, series, n, count, pieces, width, known)
                report_limits(block, phi, extended, series, count, pieces, known)
    return status
