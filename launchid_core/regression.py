"""From a closed window's samples to coefficients: rows, library, QR, sparse solve.

Two formulations of theta_ddot = Theta(x) xi (and of theta_dot, beta_dot):

* pointwise: derivative at every kept row, measured or differenced;
* integral (weak form): x(t) - mean = (integral of Theta dt - mean) xi, means over
  each gap-free piece, which frees its unknown starting value.
  Messenger & Bortz, Multiscale Model. Simul. 19, 2021, with a step as test function.
"""


import numpy as np

from . import ring as rb
from .batch import (
    ENOUGH,
    HELD,
    INTEGRAL,
    KEEP,
    MEASURED,
    OWN_SHARE,
    PAIR,
    RAW,
    SOLVER,
    TERM_A6,
    TERM_A6_DOT,
    TERM_K1,
    TERM_K1_DOT,
)
from .compress import choose_rows
from .derivative import mark_segments
from .guard import (
    CARRIED,
    are_rows_whole,
    close_control,
    fold_rows,
    give_up,
    is_control_whole,
    refuse,
    seal_newest,
    xor_integer,
)
from .kernels import inner, once
from .lanes import dot
from .library import raw_from_standard
from .linsolve import pivot_ratio, qr_factor, rotate, rotate_transposed, scale_columns
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
from .sparse import factor_whole, sparse_solve
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
)

RANK_TOLERANCE = 1.0e-12  # on standardised columns of unit norm: 4 digits above rounding
ONE_DIRECTION = 0.99      # |correlation| beyond which a6 and k1 are one direction
UNKNOWN_APART = 0.3       # relative standard deviation of both, in one direction: only a combination is known
RATE = 1                  # theta_dot, as the argument of a term's function
UNKNOWN = 1.0             # relative standard deviation of both: nothing is known

OK = int(EstimateStatus.OK)
SHORT = int(EstimateStatus.SHORT)
GAP = int(EstimateStatus.GAP)
RANK = int(EstimateStatus.RANK)
SATURATED = int(EstimateStatus.SATURATED)
NUMERICS = int(EstimateStatus.NUMERICS)
LOW_INFORMATION = int(EstimateStatus.LOW_INFORMATION)
SEPARATION = int(EstimateStatus.SEPARATION)
STUCK = int(EstimateStatus.STUCK)


@once
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


@once
def report_attitude(fixed, work, out, at, y, n, rows):
    """a6, k1, slopes, standard deviations, correlation and limits from the theta_ddot equation just solved.

    at (q, kept), y (kept,)  in  the window's factor, and Q' times theta_ddot;  n, rows  in  rows of the window, and
    kept ones less what the pieces' means took
    """
    plan = fixed.plan
    out.number[O_A6] = coefficient(work, plan[TERM_A6])
    out.number[O_K1] = coefficient(work, plan[TERM_K1])
    out.number[O_A6_DOT] = coefficient(work, plan[TERM_A6_DOT])
    out.number[O_K1_DOT] = coefficient(work, plan[TERM_K1_DOT])
    q, count = at.shape
    size = count_active(work.active)
    width = solve_extended(plan, work, out, y, count, rows)
    known = solve_absent(work, y, size, rows)
    series = work.series[:(2 + PAIR) * count].reshape((2 + PAIR, count))
    rotate(at, work.tau, q, series, 0 if width > 0 else 1 + PAIR, 2 + PAIR if known else 1 + PAIR)  # in time
    if width > 0:
        if plan[INTEGRAL] == 1:
            integral_error(fixed.codes, work, n, work.xi, plan[HELD])
        report_spread(plan, work, out, count, rows - width)
        report_others(plan, work, out, at, count, width, rows - width)
    if size < q:
        report_absent(plan, work, out, at, size, known, rows)


@once
def judge_separation(number):
    """OK, or why a6 and k1 are not known apart, or not at all."""
    a6, k1 = number[O_A6_STD] / abs(number[O_A6]), number[O_K1_STD] / abs(number[O_K1])
    if abs(number[O_CORRELATION]) > ONE_DIRECTION and a6 > UNKNOWN_APART and k1 > UNKNOWN_APART:
        return SEPARATION
    return LOW_INFORMATION if a6 > UNKNOWN and k1 > UNKNOWN else OK


@once
def is_driven(codes, support):
    """Whether any active term of theta_ddot is one in theta or beta.  codes (q, 6), support (q, 3)  in"""
    for j in range(codes.shape[0]):
        in_function = codes[j, 4] > 0 and codes[j, 5] != RATE
        if support[j, ATTITUDE] == 1 and (codes[j, 0] > 0 or codes[j, 2] > 0 or in_function):
            return True
    return False


@inner
def regress(fixed, work, out, n, count, pieces):
    """Factor the library, solve the three equations, fill the outcome; returns its status.

    Source: Navarro-Tapia et al., eq. 5 and 6; reduction to q x q in `sparse`.
    """
    q = fixed.codes.shape[0]
    at = work.phi[:q * count].reshape((q, count))
    target = work.target[:EQUATIONS * count].reshape((EQUATIONS, count))
    scale_columns(at, work.norms)
    rank = qr_factor(at, work.order, work.tau, RANK_TOLERANCE)
    if rank < q:
        return RANK
    out.number[O_CONDITION] = pivot_ratio(at, rank)
    raw_from_standard(fixed.codes, work.centre, work.scale, work.tt)
    reduce_library(work, at, q)
    factor_whole(work.mt, work.whole)
    drift = work.drift[:PAIR * count].reshape((PAIR, count))
    rotate_transposed(at, work.tau, q, drift)
    rotate_transposed(at, work.tau, q, target)
    for e in range(EQUATIONS):
        y = target[e]
        passes = sparse_solve(fixed.plan[SOLVER], work.mt, work.whole, y[:q], fixed.threshold[RAW],
                              fixed.threshold[OWN_SHARE] * dot(y, y, 0, count), work.xi, work.active, work.sparse)
        if passes < 0 and e == ATTITUDE:
            return RANK
        for j in range(q):
            if passes > 0 and not np.isfinite(work.xi[j]):
                return NUMERICS
            out.xi[j, e] = work.xi[j] if passes > 0 else np.nan
            out.support[j, e] = int(work.active[j] == 1 and passes > 0)
        if e == ATTITUDE:
            report_attitude(fixed, work, out, at, y, n, count - pieces)
    return judge_separation(out.number) if is_driven(fixed.codes, out.support) else LOW_INFORMATION


@inner
def choose_window_rows(fixed, state, work, n, saturated, gaps):
    """Choose the rows to keep among the usable ones; returns (rows kept, OK or the reason why not to use them)."""
    plan, stop = fixed.plan, fixed.saturation
    kept = choose_rows(work.usable, n, plan[KEEP], state.random, work.kept)
    still = stands_still(state.ring, state.counts, state.repeats, stop[THETA], stop[THETA_DOT], stop[BETA])
    if kept >= plan[ENOUGH]:
        return kept, STUCK if still else OK
    if kept + saturated >= plan[ENOUGH]:
        return kept, SATURATED
    return kept, GAP if gaps > 0 else SHORT


@inner
def open_close(fixed, state, work):
    """The closed window's samples, theta_dot filled in; returns (how many, left out as saturated, gaps)."""
    clear_outcome(state.outcome, OK)
    n, saturated = rb.copy_window(state.ring, state.counts, fixed.saturation, work.signal)
    gaps = mark_segments(work.signal[rb.T], n, fixed.limits[rb.MAX_GAP], work.segment)
    fill_rate(work, n)
    fill_attack(work, n)
    return n, saturated, gaps


@inner
def end_close(state, status, kept, gaps):
    """The outcome's flags; a window that failed says only why."""
    if status != OK:
        clear_outcome(state.outcome, status)
    state.outcome.flag[USED] = kept
    state.outcome.flag[GAPS_SEEN] = gaps
    state.counts[rb.ESTIMATES] = 1


@once
def close_pointwise(fixed, state, work):
    """Estimate from the window that just closed, formulations `measured` and `difference`."""
    n, saturated, gaps = open_close(fixed, state, work)
    fill_slopes(work, n, fixed.plan[MEASURED])
    for i in range(n):
        work.usable[i] = int(np.isfinite(work.slope[0, i] + work.slope[1, i] + work.slope[2, i]))
    kept, status = choose_window_rows(fixed, state, work, n, saturated, gaps)
    if status == OK:
        t_centre = state.clock[rb.T_CLOSED] + 0.5 * fixed.limits[rb.WINDOW]
        fill_states(work, n, t_centre)
        standardise(work, fixed.centred, kept, n)
        pointwise_rows(fixed.codes, work, kept)
        drift_pointwise(work, kept, t_centre)
        status = regress(fixed, work, state.outcome, n, kept, 0)
    end_close(state, status, kept, gaps)


@once
def close_integral(fixed, state, work):
    """Estimate from the window that just closed, formulation `integral`."""
    n, saturated, gaps = open_close(fixed, state, work)
    q = fixed.codes.shape[0]
    for i in range(n):
        work.usable[i] = int(np.isfinite(work.signal[THETA_DOT, i]))
    kept, status = choose_window_rows(fixed, state, work, n, saturated, gaps)
    if status == OK:
        t_centre = state.clock[rb.T_CLOSED] + 0.5 * fixed.limits[rb.WINDOW]
        fill_states(work, n, t_centre)
        standardise(work, fixed.centred, kept, n)
        integral_rows(fixed.codes, work, n, kept, fixed.plan[HELD])
        drift_integral(work, n, kept, t_centre, fixed.plan[HELD])
        centre_segments(work.drift[:PAIR * kept].reshape((PAIR, kept)), work, kept)
        pieces = centre_segments(work.phi[:q * kept].reshape((q, kept)), work, kept)
        centre_segments(work.target[:EQUATIONS * kept].reshape((EQUATIONS, kept)), work, kept)
        if kept - pieces > q:
            status = regress(fixed, work, state.outcome, n, kept, pieces)
        else:  # each piece has its own unknown beginning
            status = GAP
    end_close(state, status, kept, gaps)


@inner
def is_window_whole(state):
    """Whether the closed window's rows, the generator of the row choice and the shares of repeats are as left."""
    if xor_integer(state.random[0], fold_rows(state.repeats)) != state.guard[CARRIED]:
        return False
    return are_rows_whole(state.ring, state.seals, state.counts)


@inner
def seal_closed(state):
    """What a window's close carries on stays as it is until the next, clock and counts until the next sample."""
    state.guard[CARRIED] = xor_integer(state.random[0], fold_rows(state.repeats))
    close_control(state)


@once
def take_sample(fixed, state, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Take one sample; returns its Status.  WINDOW_COMPLETE: the window's close has to follow, and says what it is.

    RECOVERED: memory is damaged, the caller has to begin anew with it.
    """
    if not is_control_whole(state):
        return refuse(fixed.limits, state.counts, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    code = rb.push(fixed.limits, state.clock, state.counts, state.ring, t, theta, theta_dot, beta, theta_ddot, beta_cmd,
                   gamma)
    if code >= 0:
        seal_newest(state)
    if code != rb.WINDOW_COMPLETE:
        close_control(state)
    return code


@once
def complete_pointwise(fixed, state, work):
    """After `take_sample` completed a window: its estimate; WINDOW_COMPLETE, or RECOVERED as there."""
    if not is_window_whole(state):
        return give_up(state.counts, rb.WINDOW_COMPLETE)
    close_pointwise(fixed, state, work)
    seal_closed(state)
    return rb.WINDOW_COMPLETE


@once
def complete_integral(fixed, state, work):
    """As `complete_pointwise`."""
    if not is_window_whole(state):
        return give_up(state.counts, rb.WINDOW_COMPLETE)
    close_integral(fixed, state, work)
    seal_closed(state)
    return rb.WINDOW_COMPLETE


@once
def update_pointwise(fixed, state, work, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Take one sample; returns its Status.  RECOVERED: memory is damaged, the caller has to begin anew with it."""
    code = take_sample(fixed, state, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    return complete_pointwise(fixed, state, work) if code == rb.WINDOW_COMPLETE else code


@once
def update_integral(fixed, state, work, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Take one sample; returns its Status.  RECOVERED: memory is damaged, the caller has to begin anew with it."""
    code = take_sample(fixed, state, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    return complete_integral(fixed, state, work) if code == rb.WINDOW_COMPLETE else code
