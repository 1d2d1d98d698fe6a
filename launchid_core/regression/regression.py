"""The way from a closed window's samples to coefficients: rows, library, QR, sparse solve.

Two formulations of theta_ddot = Theta(x) xi (and of theta_dot, beta_dot): pointwise, the derivative at every kept row,
measured or differenced; integral (weak form), x(t) - mean = (integral of Theta dt - mean) xi, means over each gap-free
piece, which frees its unknown starting value (Messenger & Bortz, Multiscale Model. Simul. 19, 2021, with a step as test
function).  Navarro-Tapia et al., eq. 5 and 6; reduction to q x q in `sparse`.
"""

import numpy as np

from ..algebra import sparse
from ..algebra.compress import choose_rows
from ..algebra.derivative import mark_segments
from ..algebra.library import raw_from_standard
from ..algebra.linsolve import dot, qr_factor, scale_columns
from ..gate import ring as rb
from ..gate import window as wn
from ..gate.guard import fold_words, give_up, is_row_whole, seal_control, take_sample
from ..gate.stuck import stands_still
from ..kernels import inner, kernel
from . import rows as rw
from .residual import report_attitude

EQUATION_ORDER = (0, 2, wn.ATTITUDE)  # of the equations: the last one's factor stays, for its standard deviations
RANK_TOLERANCE = 1.0e-12  # on standardised columns of unit norm: 4 digits above rounding
RATE_ARGUMENT = 1         # theta_dot, as the argument of a term's function


@kernel
def push_sample(block, ring, seals, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Take one sample; returns its Status.  WINDOW_COMPLETE: the window's close has to follow, and says what it is.

    RECOVERED: memory is damaged, the caller has to begin anew with it.
    """
    fixed, state = block[0].fixed, block[0].state
    return take_sample(fixed, state, ring, seals, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)


@kernel
def push_until_due(block, ring, seals, samples, at):
    """`push_sample` for rows of samples (n, 7) from `at` on, until one closes a window or answers RECOVERED.

    Returns (the row after the last taken, its answer, DUE more where a window closes); (n, ACCEPTED) at the end.
    """
    fixed, state = block[0].fixed, block[0].state
    for k in range(at, samples.shape[0]):
        s = samples[k]
        code = take_sample(fixed, state, ring, seals, s[0], s[1], s[2], s[3], s[4], s[5], s[6])
        if code == rb.WINDOW_COMPLETE:
            return k + 1, code + rb.DUE
        if code == rb.RECOVERED:
            return k + 1, code
    return samples.shape[0], rb.ACCEPTED


# ---- a window


@inner
def take_window(fixed, state, ring, seals, words, rows, marks):
    """Copy the closed window's samples to `rows`; return (WINDOW_COMPLETE or RECOVERED, OK or why not to use them, how
    many, rows to keep, gaps)."""
    plan, stop, counts = fixed.plan, fixed.saturation, state.counts
    whole = fold_words(words) == state.guard.carried
    for k in range(counts.closed_rows):
        whole = whole and is_row_whole(ring, seals, rb.place_of_row(counts, ring, k))
    if not whole:
        return give_up(counts, rb.WINDOW_COMPLETE), wn.OK, 0, 0, 0
    wn.clear_outcome(state.outcome, wn.OK)
    n, saturated = rb.copy_window(ring, counts, stop, rows)
    gaps = mark_segments(rows[rb.T], n, fixed.limits.max_gap, marks[rw.SEGMENT])
    rw.fill_rate(rows, marks, n)
    rw.fill_attack(rows, n)
    if fixed.size.integral == 0:
        rw.fill_slopes(rows, marks, n, plan.measured)
    for i in range(n):
        x = rows[rb.THETA_DOT, i]
        if fixed.size.integral == 0:
            x = rows[rw.SLOPE_COLUMN, i] + rows[rw.SLOPE_COLUMN + 1, i] + rows[rw.SLOPE_COLUMN + 2, i]
        marks[rw.USABLE, i] = int(np.isfinite(x))
    kept = choose_rows(marks[rw.USABLE], n, plan.keep, state, marks[rw.KEPT])
    status = wn.STUCK if stands_still(ring, counts, state.repeats, stop[rb.THETA:]) else wn.OK
    if kept < plan.enough:
        status = wn.SATURATED if kept + saturated >= plan.enough else wn.GAP if gaps > 0 else wn.SHORT
    return rb.WINDOW_COMPLETE, status, n, kept, gaps


@inner
def factor_library(fixed, state, work, at, pieces):
    """Factor the library; returns OK, RANK, or GAP where each piece's own unknown beginning leaves too few rows.

    at (q + EQUATIONS + PAIR, count)  inout  library columns, targets and drifts, these into the factor's coordinates
    """
    q, tt = fixed.size.terms, work.tt
    if at.shape[1] - pieces <= q:
        return wn.GAP
    scale_columns(at[:q], work.norms[:])
    rank = qr_factor(at, work.order[:q], work.tau[:], RANK_TOLERANCE)
    if rank < q:
        return wn.RANK
    state.outcome.condition = abs(at[0, 0]) / abs(at[rank - 1, rank - 1])
    raw_from_standard(fixed.codes[:q], work.centre, work.scale, tt)
    for i in range(q):  # M with Phi_raw = Q M: column i of M into work.mt[i]
        for r in range(q):
            work.mt[i, r] = 0.0
        for k in range(q):
            j = work.order[k]
            if tt[i, j] != 0.0:
                for r in range(k + 1):
                    work.mt[i, r] += at[k, r] * work.norms[j] * tt[i, j]
    sparse.factor_whole(q, work.mt, work.whole, work.sparse.columns[:])
    return wn.OK


@kernel
def open_window(block, words, ring, seals, rows, marks, columns):
    """Turn a closed window into its factored library; return as `take_window`, and the number of pieces whose means
    were taken off.

    In the integral form columns and targets are less their means over each gap-free piece.
    """
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    code, status, n, kept, gaps = take_window(fixed, state, ring, seals, words, rows, marks)
    pieces = 0
    if status == wn.OK and code == rb.WINDOW_COMPLETE:
        q, t_centre, held = fixed.size.terms, rb.centre_of(fixed, state), fixed.plan.held
        rw.standardise(work, rows, marks, fixed.centred, kept, n, t_centre)
        at = columns[:(q + wn.EQUATIONS + rw.PAIR) * kept].reshape((q + wn.EQUATIONS + rw.PAIR, kept))
        if fixed.size.integral == 1:
            rw.integral_rows(fixed.codes[:q], rows, marks, at, n, kept, t_centre, held)
            pieces = rw.centre_segments(at, marks, kept)
        else:
            rw.pointwise_rows(fixed.codes[:q], rows, marks, at, kept, t_centre)
        status = factor_library(fixed, state, work, at, pieces)
    return code, status, n, kept, gaps, pieces


@inner
def keep_equation(fixed, work, out, e, is_solved):
    """Write the coefficients of equation e to the outcome; return OK, RANK or NUMERICS."""
    if not is_solved and e == wn.ATTITUDE:
        return wn.RANK
    for j in range(fixed.size.terms):
        if is_solved and not np.isfinite(work.xi[j]):
            return wn.NUMERICS
        out.xi[j, e] = work.xi[j] if is_solved else np.nan
        out.support[j, e] = int(is_solved and rw.is_active(fixed.plan, work.active[:], j))
    return wn.OK


@kernel
def eliminate(block, columns, status, count):
    """Solve the three equations by leaving terms out; returns OK, RANK or NUMERICS, or a status that was not OK.

    columns  in  of the window's factor, each of `count` numbers, behind them the targets in its coordinates
    """
    fixed, work, out = block[0].fixed, block[0].work, block[0].state.outcome
    q, whole, xi, active, by_share = fixed.size.terms, work.whole, work.xi[:], work.active[:], fixed.size.by_share
    for k in range(wn.EQUATIONS):
        if status == wn.OK:
            e, raw = EQUATION_ORDER[k], fixed.threshold.raw
            y = columns[(q + e) * count:(q + e + 1) * count]
            if by_share == 1:
                needed = fixed.threshold.own_share * dot(y, y, 0, count)
                passes = sparse.solve_stepwise(q, whole, y, 1, needed, xi, active, work.sparse)
            elif fixed.size.solver == sparse.SSR:
                passes = sparse.solve_stepwise(q, whole, y, 0, raw, xi, active, work.sparse)
            else:
                passes = sparse.solve_stls(q, whole, y, raw, xi, active, work.sparse)
            status = wn.RANK if passes < 0 else keep_equation(fixed, work, out, e, True)
    return status


@kernel
def relax(block, columns, status, count):
    """Choose and fit terms by a relaxed problem, that of SR3 or of the lasso."""
    fixed, work, out = block[0].fixed, block[0].work, block[0].state.outcome
    q, whole, xi, active, raw = fixed.size.terms, work.whole, work.xi[:], work.active[:], fixed.threshold.raw
    for k in range(wn.EQUATIONS):
        if status == wn.OK:
            e = EQUATION_ORDER[k]
            y = columns[(q + e) * count:(q + e + 1) * count]
            needed = fixed.threshold.own_share * dot(y, y, 0, count)
            if fixed.size.solver == sparse.SR3:
                passes = sparse.solve_sr3(q, work.mt[:], whole, y, raw, needed, xi, active, work.sparse)
            else:
                passes = sparse.solve_lasso(q, work.mt[:], whole, y, raw, needed, xi, active, work.sparse)
            status = keep_equation(fixed, work, out, e, passes > 0)
    return status


@inner
def judge_separation(fixed, work, out):
    """Return OK, or why a6 and k1 are not known apart, or not at all."""
    codes, drives = fixed.codes, 0
    for j in range(fixed.size.terms):
        if codes[j, 0] > 0 or codes[j, 2] > 0 or (codes[j, 4] > 0 and codes[j, 5] != RATE_ARGUMENT):
            if rw.is_active(fixed.plan, work.active[:], j):  # a term in theta or beta drives
                drives = 1
    if drives == 0:
        return wn.LOW_INFORMATION
    a6, k1 = out.a6_std / abs(out.a6), out.k1_std / abs(out.k1)
    if wn.knows_one_direction(a6, k1, out.correlation):
        return wn.SEPARATION
    return wn.LOW_INFORMATION if wn.knows_nothing(a6, k1) else wn.OK


@inner
def coefficient_of(work, place):
    """Return the coefficient of the term at this place of the library, NaN where it has none."""
    return work.xi[place] if place >= 0 else np.nan


@kernel
def end_window(block, words, rows, marks, columns, series, status, n, kept, gaps, pieces):
    """Finish a close once the equations are solved: a6, k1, standard deviations, flags.

    status .. pieces  of the parts before.  A window that failed says only why.  What is carried on stays as it is
    until the next close, clock and counts until the next sample.
    """
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    out, q, plan = state.outcome, fixed.size.terms, fixed.plan
    if status == wn.OK:
        out.a6 = coefficient_of(work, plan.term[0])
        out.k1 = coefficient_of(work, plan.term[1])
        out.a6_dot = coefficient_of(work, plan.slope[0])
        out.k1_dot = coefficient_of(work, plan.slope[1])
        report_attitude(fixed, work, out, rows, marks,
                        columns[:(q + wn.EQUATIONS + rw.PAIR) * kept].reshape((q + wn.EQUATIONS + rw.PAIR, kept)),
                        series[:(2 + q) * kept].reshape((2 + q, kept)), n, kept - pieces)
        status = judge_separation(fixed, work, out)
    if status != wn.OK:
        wn.clear_outcome(out, status)
    out.used = kept
    out.gaps = gaps
    state.counts.estimates, state.counts.waiting = 1, state.counts.closed_back
    state.guard.carried = fold_words(words)
    state.guard.control = seal_control(state.clock, state.counts)


def close_window(size, block, words, ring, seals, rows, marks, columns, series, code):
    """Estimate from the window that just closed; returns WINDOW_COMPLETE, or RECOVERED where memory is damaged."""
    answer, status, n, kept, gaps, pieces = open_window(block, words, ring, seals, rows, marks, columns)
    if answer == code:
        if size.solver in (sparse.SR3, sparse.LASSO):
            status = relax(block, columns, status, kept)
        else:
            status = eliminate(block, columns, status, kept)
        end_window(block, words, rows, marks, columns, series, status, n, kept, gaps, pieces)
    return answer


def update_regression(size, block, words, ring, seals, rows, marks, columns, series, t, theta, theta_dot,
                      beta, theta_ddot, beta_cmd, gamma):
    """Take a sample (`push_sample`), and close the window if it is complete."""
    code = push_sample(block, ring, seals, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    if code == rb.WINDOW_COMPLETE:
        code = close_window(size, block, words, ring, seals, rows, marks, columns, series, code)
    return code


@kernel
def restart_regression(block, words, seed):
    """Set what is not zero before the first sample; seed  first state of the row choice."""
    state = block[0].state
    wn.clear_outcome(state.outcome, wn.SHORT)
    state.random = seed
    state.guard.carried = fold_words(words)
