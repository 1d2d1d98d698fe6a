"""The way from a closed window's samples to coefficients: rows, library, QR, sparse solve.

Two formulations of theta_ddot = Theta(x) xi (and of theta_dot, beta_dot):

* pointwise: derivative at every kept row, measured or differenced;
* integral (weak form): x(t) - mean = (integral of Theta dt - mean) xi, means over
  each gap-free piece, which frees its unknown starting value.
  Messenger & Bortz, Multiscale Model. Simul. 19, 2021, with a step as test function.
"""

import numpy as np

from ..algebra import sparse
from ..algebra.compress import choose_rows
from ..algebra.derivative import mark_segments
from ..gate import ring as rb
from ..gate.guard import CARRIED, are_rows_whole, close_control, fold_words, give_up, take_sample
from ..gate.ring import BETA, THETA, THETA_DOT
from ..gate.stuck import stands_still
from ..gate.window import EQUATIONS, GAP, GAPS_SEEN, LOW_INFORMATION, OK, SATURATED, SHORT, STUCK, USED, clear_outcome
from ..kernels import inner, kernel
from . import equations as eq
from . import rows as rw
from .plan import ENOUGH, INTEGRAL, KEEP, KEPT, MEASURED, PAIR, SEGMENT, SLOPE_COLUMN, TERMS_HELD, USABLE
from .residual import drift_integral, drift_pointwise, report_attitude

# ---- a sample


@kernel
def push_sample(block, ring, seals, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Take one sample; returns its Status.  WINDOW_COMPLETE: the window's close has to follow, and says what it is.

    block  (1,) inout  of the estimator (`table.REGRESSION`);  ring (m + 1, 7), seals (m + 1,)  inout
    RECOVERED: memory is damaged, the caller has to begin anew with it.
    """
    fixed, state = block[0].fixed, block[0].state
    return take_sample(fixed, state, ring, seals, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)


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


@inner
def take_window(fixed, state, ring, seals, words, rows, marks):
    """The closed window's samples into `rows`; returns (WINDOW_COMPLETE or RECOVERED, OK or the reason why not to use
    them, how many, rows to keep, gaps).

    words  in  of the block what is carried on, seen as int64
    rows (N_SERIES, m), marks (N_MARKS, m)  out  as `plan` names them
    """
    plan, stop, counts = fixed.plan, fixed.saturation, state.counts
    whole = fold_words(words) == state.guard[CARRIED]
    if not (whole and are_rows_whole(ring, seals, counts)):
        return give_up(counts, rb.WINDOW_COMPLETE), OK, 0, 0, 0
    clear_outcome(state.outcome, OK)
    n, saturated = rb.copy_window(ring, counts, stop, rows)
    gaps = mark_segments(rows[rb.T], n, fixed.limits[rb.MAX_GAP], marks[SEGMENT])
    rw.fill_rate(rows, marks, n)
    rw.fill_attack(rows, n)
    if plan[INTEGRAL] == 0:
        rw.fill_slopes(rows, marks, n, plan[MEASURED])
    for i in range(n):
        x = rows[THETA_DOT, i] if plan[INTEGRAL] == 1 else rows[SLOPE_COLUMN, i] + rows[SLOPE_COLUMN + 1,
                                                                                        i] + rows[SLOPE_COLUMN + 2, i]
        marks[USABLE, i] = int(np.isfinite(x))
    kept = choose_rows(marks[USABLE], n, plan[KEEP], state.random, marks[KEPT])
    still = stands_still(ring, counts, state.repeats, stop[THETA], stop[THETA_DOT], stop[BETA])
    status = STUCK if still else OK
    if kept < plan[ENOUGH]:
        status = SATURATED if kept + saturated >= plan[ENOUGH] else GAP if gaps > 0 else SHORT
    return rb.WINDOW_COMPLETE, status, n, kept, gaps


@kernel
def open_pointwise(block, words, ring, seals, rows, marks, columns):
    """A closed window to its factored library in the pointwise form; returns as `take_window`, and 0, the pieces whose
    means were taken."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    code, status, n, kept, gaps = take_window(fixed, state, ring, seals, words, rows, marks)
    if status == OK and code == rb.WINDOW_COMPLETE:
        q, t_centre = fixed.size.terms, rb.centre_of(fixed, state)
        rw.fill_states(rows, n, t_centre)
        rw.standardise(work, rows, marks, fixed.centred, kept, n)
        at = columns[:(q + EQUATIONS + PAIR) * kept].reshape((q + EQUATIONS + PAIR, kept))
        rw.pointwise_rows(fixed.codes[:q], rows, marks, at, at[q:], kept)
        drift_pointwise(rows, marks, at[q + EQUATIONS:], kept, t_centre)
        status = eq.factor_library(fixed, state, work, at, 0)
    return code, status, n, kept, gaps, 0


@kernel
def open_integral(block, words, ring, seals, rows, marks, columns):
    """The same in the integral form, whose columns and targets are less their means over each gap-free piece."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    code, status, n, kept, gaps = take_window(fixed, state, ring, seals, words, rows, marks)
    pieces = 0
    if status == OK and code == rb.WINDOW_COMPLETE:
        q, t_centre, held = fixed.size.terms, rb.centre_of(fixed, state), fixed.plan[TERMS_HELD]
        rw.fill_states(rows, n, t_centre)
        rw.standardise(work, rows, marks, fixed.centred, kept, n)
        at = columns[:(q + EQUATIONS + PAIR) * kept].reshape((q + EQUATIONS + PAIR, kept))
        rw.integral_rows(fixed.codes[:q], rows, marks, at, at[q:], n, kept, held)
        drift_integral(rows, marks, at[q + EQUATIONS:], n, kept, t_centre, held)
        pieces = rw.centre_segments(at, marks, kept)
        status = eq.factor_library(fixed, state, work, at, pieces)
    return code, status, n, kept, gaps, pieces


@inner
def end_window(fixed, state, work, words, rows, marks, columns, series, status, n, kept, gaps, pieces):
    """The outcome's standard deviations and flags; what is carried on stays as it is until the next close, clock and
    counts until the next sample.  A window that failed says only why."""
    out, q = state.outcome, fixed.size.terms
    if status == OK:
        report_attitude(fixed.plan, fixed.codes[:q], work, out, rows, marks,
                        columns[:(q + EQUATIONS + PAIR) * kept].reshape((q + EQUATIONS + PAIR, kept)),
                        series[:(2 + q) * kept].reshape((2 + q, kept)), n, kept - pieces)
        driven = eq.is_driven(fixed.plan, fixed.codes[:q], work.active[:])
        status = eq.judge_separation(out.number) if driven else LOW_INFORMATION
    if status != OK:
        clear_outcome(out, status)
    out.flag[USED] = kept
    out.flag[GAPS_SEEN] = gaps
    state.counts[rb.ESTIMATES], state.counts[rb.WAITING] = 1, state.counts[rb.CLOSED_BACK]
    state.guard[CARRIED] = fold_words(words)
    close_control(state)


@kernel
def end_by_threshold(block, words, rows, marks, columns, series, status, n, kept, gaps, pieces):
    """The second half of a close, from the factored library on; status .. pieces  of the first."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    if status == OK:
        status = eq.choose_by_threshold(fixed, work, state.outcome, columns, kept)
    end_window(fixed, state, work, words, rows, marks, columns, series, status, n, kept, gaps, pieces)


@kernel
def end_stepwise(block, words, rows, marks, columns, series, status, n, kept, gaps, pieces):
    """As `end_by_threshold`, by stepwise sparse regression."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    if status == OK:
        status = eq.choose_stepwise(fixed, work, state.outcome, columns, kept)
    end_window(fixed, state, work, words, rows, marks, columns, series, status, n, kept, gaps, pieces)


@kernel
def end_by_share(block, words, rows, marks, columns, series, status, n, kept, gaps, pieces):
    """As `end_by_threshold`, by what a term explains by itself."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    if status == OK:
        status = eq.choose_by_share(fixed, work, state.outcome, columns, kept)
    end_window(fixed, state, work, words, rows, marks, columns, series, status, n, kept, gaps, pieces)


@kernel
def end_by_lasso(block, words, rows, marks, columns, series, status, n, kept, gaps, pieces):
    """As `end_by_threshold`, by the lasso."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    if status == OK:
        status = eq.choose_by_lasso(fixed, work, state.outcome, columns, kept)
    end_window(fixed, state, work, words, rows, marks, columns, series, status, n, kept, gaps, pieces)


@kernel
def end_relaxed(block, words, rows, marks, columns, series, status, n, kept, gaps, pieces):
    """As `end_by_threshold`, by sparse relaxed regularized regression."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    if status == OK:
        status = eq.choose_relaxed(fixed, work, state.outcome, columns, kept)
    end_window(fixed, state, work, words, rows, marks, columns, series, status, n, kept, gaps, pieces)


def close_window(size, block, words, ring, seals, rows, marks, columns, series):
    """Estimate from the window that just closed; returns WINDOW_COMPLETE, or RECOVERED where memory is damaged."""
    if size.integral == 1:
        code, status, n, kept, gaps, pieces = open_integral(block, words, ring, seals, rows, marks, columns)
    else:
        code, status, n, kept, gaps, pieces = open_pointwise(block, words, ring, seals, rows, marks, columns)
    if code == rb.WINDOW_COMPLETE:
        if size.solver == sparse.SR3:
            end_relaxed(block, words, rows, marks, columns, series, status, n, kept, gaps, pieces)
        elif size.solver == sparse.LASSO:
            end_by_lasso(block, words, rows, marks, columns, series, status, n, kept, gaps, pieces)
        elif size.by_share == 1:
            end_by_share(block, words, rows, marks, columns, series, status, n, kept, gaps, pieces)
        elif size.solver == sparse.SSR:
            end_stepwise(block, words, rows, marks, columns, series, status, n, kept, gaps, pieces)
        else:
            end_by_threshold(block, words, rows, marks, columns, series, status, n, kept, gaps, pieces)
    return code


def update_regression(size, block, words, ring, seals, rows, marks, columns, series, t, theta, theta_dot,
                      beta, theta_ddot, beta_cmd, gamma):
    """Take one sample; returns its Status.  RECOVERED: memory is damaged, the caller has to begin anew with it.

    size  in  how much of the memory is in use, and the formulation;  the rest as of the entries, in the order of
    `table.APART`
    """
    code = push_sample(block, ring, seals, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    if code == rb.WINDOW_COMPLETE:
        code = close_window(size, block, words, ring, seals, rows, marks, columns, series)
    return code


@kernel
def restart_regression(block, words, seed):
    """Set what is not zero before the first sample; seed  first state of the row choice."""
    state = block[0].state
    clear_outcome(state.outcome, SHORT)
    state.random[0] = seed
    state.guard[CARRIED] = fold_words(words)
