"""From a closed window's samples to coefficients: rows, library, QR, sparse solve.

Two formulations of theta_ddot = Theta(x) xi (and of theta_dot, beta_dot):

* pointwise: derivative at every kept row, measured or differenced;
* integral (weak form): x(t) - mean = (integral of Theta dt - mean) xi, means over
  each gap-free piece, which frees its unknown starting value.
  Messenger & Bortz, Multiscale Model. Simul. 19, 2021, with a step as test function.
"""

import numpy as np

from . import ring as rb
from .compress import choose_rows
from .derivative import mark_segments
from .guard import (
    CARRIED,
    are_rows_whole,
    close_control,
    fold_words,
    give_up,
    is_control_whole,
    refuse,
    seal_newest,
)
from .kernels import inner, kernel
from .lanes import dot
from .library import raw_from_standard
from .linsolve import pivot_ratio, qr_factor, rotate, rotate_transposed, scale_columns
from .plan import (
    ENOUGH,
    HELD,
    INTEGRAL,
    KEEP,
    KEPT,
    MEASURED,
    OWN_SHARE,
    PAIR,
    RAW,
    SEGMENT,
    SLOPE,
    TERM_A6,
    TERM_A6_DOT,
    TERM_K1,
    TERM_K1_DOT,
    USABLE,
)
from .residual import (
    count_active,
    drift_integral,
    drift_pointwise,
    report_absent,
    report_others,
    report_spread,
    solve_absent,
    solve_extended,
)
from .ring import BETA, THETA, THETA_DOT
from .rows import (
    centre_segments,
    fill_attack,
    fill_rate,
    fill_slopes,
    fill_states,
    integral_error,
    integral_rows,
    pointwise_rows,
    standardise,
)
from .sparse import LASSO, SR3, SSR, factor_whole, solve_lasso, solve_own, solve_sr3, solve_ssr, solve_stls
from .status import EstimateStatus
from .stuck import stands_still
from .window import (
    ATTITUDE,
    EQUATIONS,
    GAPS_SEEN,
    O_A6,
    O_A6_DOT,
    O_A6_STD,
    O_CONDITION,
    O_CORRELATION,
    O_K1,
    O_K1_DOT,
    O_K1_STD,
    USED,
    clear_outcome,
    knows_nothing,
    knows_one_direction,
)

RANK_TOLERANCE = 1.0e-12  # on standardised columns of unit norm: 4 digits above rounding
RATE = 1                  # theta_dot, as the argument of a term's function

OK = int(EstimateStatus.OK)
SHORT = int(EstimateStatus.SHORT)
GAP = int(EstimateStatus.GAP)
RANK = int(EstimateStatus.RANK)
SATURATED = int(EstimateStatus.SATURATED)
NUMERICS = int(EstimateStatus.NUMERICS)
LOW_INFORMATION = int(EstimateStatus.LOW_INFORMATION)
SEPARATION = int(EstimateStatus.SEPARATION)
STUCK = int(EstimateStatus.STUCK)


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
    a6, k1 = number[O_A6_STD] / abs(number[O_A6]), number[O_K1_STD] / abs(number[O_K1])
    if knows_one_direction(a6, k1, number[O_CORRELATION]):
        return SEPARATION
    return LOW_INFORMATION if knows_nothing(a6, k1) else OK


@inner
def is_driven(codes, support):
    """Whether any active term of theta_ddot is one in theta or beta.  codes (q, 6), support (q, 3)  in"""
    for j in range(codes.shape[0]):
        in_function = codes[j, 4] > 0 and codes[j, 5] != RATE
        if support[j, ATTITUDE] == 1 and (codes[j, 0] > 0 or codes[j, 2] > 0 or in_function):
            return True
    return False


@inner
def report_coefficients(plan, work, number):
    """a6, k1 and their slopes, from the theta_ddot equation just solved."""
    number[O_A6] = coefficient(work, plan[TERM_A6])
    number[O_K1] = coefficient(work, plan[TERM_K1])
    number[O_A6_DOT] = coefficient(work, plan[TERM_A6_DOT])
    number[O_K1_DOT] = coefficient(work, plan[TERM_K1_DOT])


# ---- a sample


@inner
def take_sample(fixed, state, ring, seals, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Gate and ring, as `push_sample`."""
    if not is_control_whole(state):
        return refuse(fixed.limits, state.counts, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    code = rb.push(fixed.limits, state.clock, state.counts, ring, t, theta, theta_dot, beta, theta_ddot, beta_cmd,
                   gamma)
    if code >= 0:
        seal_newest(state.counts, ring, seals)
    if code != rb.WINDOW_COMPLETE:
        close_control(state)
    return code


@kernel
def push_sample(block, ring, seals, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Take one sample; returns its Status.  WINDOW_COMPLETE: the window's close has to follow, and says what it is.

    block  (1,) inout  of the estimator (`memory.REGRESSION`);  ring (m + 1, 7), seals (m + 1,)  inout
    RECOVERED: memory is damaged, the caller has to begin anew with it.
    """
    return take_sample(block[0].fixed, block[0].state, ring, seals, t, theta, theta_dot, beta, theta_ddot, beta_cmd,
                       gamma)


@kernel
def push_within(block, ring, seals, samples, at):
    """Take rows of samples (n, 7) from `at` on until one may close a window or answers RECOVERED.

    Returns (the row after the last taken, ACCEPTED); (that after the damage, RECOVERED).
    """
    fixed, state = block[0].fixed, block[0].state
    for k in range(at, samples.shape[0]):
        s = samples[k]
        if not rb.stays_within(fixed.limits, state.clock, state.counts, s[0]):
            return k, rb.ACCEPTED
        if take_sample(fixed, state, ring, seals, s[0], s[1], s[2], s[3], s[4], s[5], s[6]) == rb.RECOVERED:
            return k + 1, rb.RECOVERED
    return samples.shape[0], rb.ACCEPTED


# ---- a window


@kernel
def open_window(block, ring, seals, words, rows, marks):
    """The closed window's samples into `rows`; returns (WINDOW_COMPLETE or RECOVERED, how many, rows to keep, OK or the
    reason why not to use them, gaps).

    words  in  of the block what is carried on, seen as int64
    rows (N_SERIES, m), marks (N_MARKS, m)  out  as `plan` names them
    """
    fixed, state = block[0].fixed, block[0].state
    plan, stop, counts = fixed.plan, fixed.saturation, state.counts
    whole = fold_words(words) == state.guard[CARRIED]
    if not (whole and are_rows_whole(ring, seals, counts)):
        return give_up(counts, rb.WINDOW_COMPLETE), 0, 0, OK, 0
    clear_outcome(state.outcome, OK)
    n, saturated = rb.copy_window(ring, counts, stop, rows)
    gaps = mark_segments(rows[rb.T], n, fixed.limits[rb.MAX_GAP], marks[SEGMENT])
    fill_rate(rows, marks, n)
    fill_attack(rows, n)
    if plan[INTEGRAL] == 0:
        fill_slopes(rows, marks, n, plan[MEASURED])
    for i in range(n):
        x = rows[THETA_DOT, i] if plan[INTEGRAL] == 1 else rows[SLOPE, i] + rows[SLOPE + 1, i] + rows[SLOPE + 2, i]
        marks[USABLE, i] = int(np.isfinite(x))
    kept = choose_rows(marks[USABLE], n, plan[KEEP], state.random, marks[KEPT])
    still = stands_still(ring, counts, state.repeats, stop[THETA], stop[THETA_DOT], stop[BETA])
    status = STUCK if still else OK
    if kept < plan[ENOUGH]:
        status = SATURATED if kept + saturated >= plan[ENOUGH] else GAP if gaps > 0 else SHORT
    return rb.WINDOW_COMPLETE, n, kept, status, gaps


@inner
def centre_of(fixed, state):
    """The closed window's centre [s]."""
    return state.clock[rb.T_CLOSED] + 0.5 * fixed.limits[rb.WINDOW]


@kernel
def fill_pointwise(block, rows, marks, phi, target, drift, n, kept):
    """Library columns (q, kept), targets (3, kept) and drifts (2, kept) of the pointwise form; returns 0, the pieces
    whose means were taken."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    q, t_centre = fixed.size.terms, centre_of(fixed, state)
    fill_states(rows, n, t_centre)
    standardise(work, rows, marks, fixed.centred, kept, n)
    pointwise_rows(fixed.codes[:q], rows, marks, phi[:q * kept].reshape((q, kept)),
                   target[:EQUATIONS * kept].reshape((EQUATIONS, kept)), kept)
    drift_pointwise(rows, marks, drift[:PAIR * kept].reshape((PAIR, kept)), kept, t_centre)
    return 0


@kernel
def fill_integral(block, rows, marks, phi, target, drift, n, kept):
    """As `fill_pointwise`, of the integral form, less their means over each gap-free piece; returns the pieces."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    q, t_centre, held = fixed.size.terms, centre_of(fixed, state), fixed.plan[HELD]
    columns = phi[:q * kept].reshape((q, kept))
    states = target[:EQUATIONS * kept].reshape((EQUATIONS, kept))
    drifts = drift[:PAIR * kept].reshape((PAIR, kept))
    fill_states(rows, n, t_centre)
    standardise(work, rows, marks, fixed.centred, kept, n)
    integral_rows(fixed.codes[:q], rows, marks, columns, states, n, kept, held)
    drift_integral(rows, marks, drifts, n, kept, t_centre, held)
    centre_segments(drifts, marks, kept)
    centre_segments(states, marks, kept)
    return centre_segments(columns, marks, kept)


@kernel
def factor_library(block, phi, target, drift, count, pieces):
    """Factor the library of `count` rows; returns OK, RANK, or GAP where each piece's own unknown beginning leaves too
    few rows.

    Source: Navarro-Tapia et al., eq. 5 and 6; reduction to q x q in `sparse`.
    """
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    q = fixed.size.terms
    if pieces > 0 and count - pieces <= q:
        return GAP
    at = phi[:q * count].reshape((q, count))
    scale_columns(at, work.norms[:])
    rank = qr_factor(at, work.order[:], work.tau[:], RANK_TOLERANCE)
    if rank < q:
        return RANK
    state.outcome.number[O_CONDITION] = pivot_ratio(at, rank)
    raw_from_standard(fixed.codes[:q], work.centre, work.scale, work.tt)
    reduce_library(work, at, q)
    factor_whole(q, work.mt, work.whole)
    rotate_transposed(at, work.tau[:], q, drift[:PAIR * count].reshape((PAIR, count)))
    rotate_transposed(at, work.tau[:], q, target[:EQUATIONS * count].reshape((EQUATIONS, count)))
    return OK


@inner
def thresholds_of(fixed, y, count):
    """(threshold in raw units, what a term must explain by itself of the squares of y)"""
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
    _, own = thresholds_of(fixed, y, count)
    return solve_own(q, work.mt[:], y[:q], own, work.xi[:], work.active[:], work.sparse)


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
    threshold, own = thresholds_of(fixed, y, count)
    return solve_lasso(q, work.mt[:], y[:q], threshold, own, work.xi[:], work.active[:], work.sparse)


@kernel
def choose_relaxed(block, target, e, count):
    """Sparse relaxed regularized regression of equation e; as `choose_by_threshold`."""
    fixed, work = block[0].fixed, block[0].work
    q, y = fixed.size.terms, target[e * count:(e + 1) * count]
    threshold, own = thresholds_of(fixed, y, count)
    return solve_sr3(q, work.mt[:], work.whole, y[:q], threshold, own, work.xi[:], work.active[:], work.sparse)


@kernel
def keep_equation(block, e, passes):
    """The coefficients of equation e into the outcome; returns OK, RANK or NUMERICS."""
    fixed, work, out = block[0].fixed, block[0].work, block[0].state.outcome
    if passes < 0 and e == ATTITUDE:
        return RANK
    for j in range(fixed.size.terms):
        if passes > 0 and not np.isfinite(work.xi[j]):
            return NUMERICS
        out.xi[j, e] = work.xi[j] if passes > 0 else np.nan
        out.support[j, e] = int(work.active[j] == 1 and passes > 0)
    if e == ATTITUDE:
        report_coefficients(fixed.plan, work, out.number)
    return OK


@kernel
def solve_with_drifts(block, target, drift, extended, series, count, pieces):
    """The theta_ddot equation again with the drifts of a6 and k1 beside its terms: residual and influences into
    series (0 to 2); returns how many terms that solution has."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    y = target[ATTITUDE * count:(ATTITUDE + 1) * count]
    return solve_extended(fixed.plan, fixed.size.terms, work, state.outcome, y,
                          drift[:PAIR * count].reshape((PAIR, count)), extended,
                          series[:(2 + PAIR) * count].reshape((2 + PAIR, count)), count - pieces)


@kernel
def solve_without_absent(block, target, series, count, pieces):
    """The residual of the active terms alone into series (3); whether there is one, and terms that are absent."""
    q, work = block[0].fixed.size.terms, block[0].work
    y = target[ATTITUDE * count:(ATTITUDE + 1) * count]
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
def report_limits(block, rows, phi, extended, series, count, pieces, known):
    """95 % limits of the terms of theta_ddot that are not active; known  of `solve_without_absent`."""
    fixed, work, out = block[0].fixed, block[0].work, block[0].state.outcome
    q = fixed.size.terms
    size = count_active(q, work.active)
    if size < q:
        report_absent(fixed.plan, work, out, rows, phi[:q * count].reshape((q, count)),
                      series[(1 + PAIR) * count:(2 + PAIR) * count], extended, size, known, count - pieces - size - 1)


@kernel
def end_window(block, words, status, kept, gaps):
    """The outcome's flags; what is carried on stays as it is until the next close, clock and counts until the next
    sample.  A window that failed says only why."""
    fixed, state = block[0].fixed, block[0].state
    out = state.outcome
    if status == OK:
        driven = is_driven(fixed.codes[:fixed.size.terms], out.support)
        status = judge_separation(out.number) if driven else LOW_INFORMATION
    if status != OK:
        clear_outcome(out, status)
    out.flag[USED] = kept
    out.flag[GAPS_SEEN] = gaps
    state.counts[rb.ESTIMATES] = 1
    state.guard[CARRIED] = fold_words(words)
    close_control(state)


# ---- the order


def solve_equation(solver, by_share, block, target, e, count):
    """Equation e by the solver; returns OK, RANK or NUMERICS.

    solver  index into SOLVERS;  by_share  1: a term stays by what it explains by itself, not by a threshold
    """
    if solver == SR3:
        passes = choose_relaxed(block, target, e, count)
    elif solver == LASSO:
        passes = choose_by_lasso(block, target, e, count)
    elif by_share == 1:
        passes = choose_by_share(block, target, e, count)
    elif solver == SSR:
        passes = choose_stepwise(block, target, e, count)
    else:
        passes = choose_by_threshold(block, target, e, count)
    return keep_equation(block, e, passes)


def regress(size, block, rows, marks, phi, target, drift, extended, series, n, count, pieces):
    """Factor the library, solve the three equations, fill the outcome; returns its status."""
    status = factor_library(block, phi, target, drift, count, pieces)
    for e in range(EQUATIONS):
        if status == OK:
            status = solve_equation(size.solver, size.by_share, block, target, e, count)
            if e == ATTITUDE and status == OK:
                width = solve_with_drifts(block, target, drift, extended, series, count, pieces)
                known = solve_without_absent(block, target, series, count, pieces)
                report_deviations(block, rows, marks, phi, extended, series, n, count, pieces, width, known)
                report_limits(block, rows, phi, extended, series, count, pieces, known)
    return status


def close_window(size, block, words, ring, seals, rows, marks, phi, target, drift, extended, series):
    """Estimate from the window that just closed; returns WINDOW_COMPLETE, or RECOVERED where memory is damaged."""
    code, n, kept, status, gaps = open_window(block, ring, seals, words, rows, marks)
    if code == rb.WINDOW_COMPLETE:
        if status == OK:
            if size.integral == 1:
                pieces = fill_integral(block, rows, marks, phi, target, drift, n, kept)
            else:
                pieces = fill_pointwise(block, rows, marks, phi, target, drift, n, kept)
            status = regress(size, block, rows, marks, phi, target, drift, extended, series, n, kept, pieces)
        end_window(block, words, status, kept, gaps)
    return code


def update_regression(size, block, words, ring, seals, rows, marks, phi, target, drift, extended, series, t, theta,
                      theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Take one sample; returns its Status.  RECOVERED: memory is damaged, the caller has to begin anew with it.

    size  in  how much of the memory is in use, and the formulation;  the rest as of the entries, in the order of
    `memory.APART`
    """
    code = push_sample(block, ring, seals, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    if code == rb.WINDOW_COMPLETE:
        code = close_window(size, block, words, ring, seals, rows, marks, phi, target, drift, extended, series)
    return code


@kernel
def restart_regression(block, words, seed):
    """What is not zero before the first sample; seed  first state of the row choice."""
    state = block[0].state
    clear_outcome(state.outcome, SHORT)
    state.random[0] = seed
    state.guard[CARRIED] = fold_words(words)
