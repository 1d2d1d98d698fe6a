"""From a closed window's samples to coefficients: rows, library, QR, sparse solve.

Two formulations of theta_ddot = Theta(x) xi (and of theta_dot, beta_dot):

* pointwise: derivative at every kept row, measured or differenced;
* integral (weak form): x(t) - mean = (integral of Theta dt - mean) xi, means over
  each gap-free piece, which frees its unknown starting value.
  Messenger & Bortz, Multiscale Model. Simul. 19, 2021, with a step as test function.
"""


import numpy as np

from .compress import choose_rows
from .derivative import differentiate, mark_segments
from .kernels import kernel
from .library import N_VARIABLES, TAU, library_row, raw_from_standard
from .linsolve import EPS, apply_q_transposed, pivot_ratio, qr_factor, scale_columns
from .ring import BETA, THETA, THETA_DDOT, THETA_DOT, T, copy_window
from .sparse import covariance_entry, invert_active, sparse_solve
from .status import EstimateStatus
from .window import (
    A6,
    A6_DOT,
    A6_STD,
    ATTITUDE,
    CONDITION,
    CORRELATION,
    EQUATIONS,
    GAPS,
    K1,
    K1_DOT,
    K1_STD,
    KEEP,
    MEASURED,
    SOLVER,
    STATUS,
    TERM_A6,
    TERM_A6_DOT,
    TERM_K1,
    TERM_K1_DOT,
    USED,
)

RANK_TOLERANCE = 1.0e-12  # on standardised columns of unit norm: 4 digits above rounding
STILL = 64.0 * EPS        # a variable that moves less than this of its size does not move

OK = int(EstimateStatus.OK)
SHORT = int(EstimateStatus.SHORT)
GAP = int(EstimateStatus.GAP)
RANK = int(EstimateStatus.RANK)
SATURATED = int(EstimateStatus.SATURATED)
NUMERICS = int(EstimateStatus.NUMERICS)


@kernel
def clear_outcome(out, status):
    """No estimate, for the reason `status`."""
    out.number[:] = np.nan
    out.xi[:, :] = np.nan
    out.support[:, :] = False
    out.flag[STATUS] = status


@kernel
def fill_rate(work, n):
    """Difference theta where theta_dot was not measured."""
    missing = False
    for i in range(n):
        missing = missing or np.isnan(work.signal[THETA_DOT, i])
    if missing:
        differentiate(work.signal[T], work.signal[THETA], n, work.segment, work.slope[0])
        for i in range(n):
            if np.isnan(work.signal[THETA_DOT, i]):
                work.signal[THETA_DOT, i] = work.slope[0, i]


@kernel
def fill_slopes(work, n, measured):
    """Derivatives of theta, theta_dot and beta at every row; theta_ddot as measured if `measured` is 1."""
    for i in range(n):
        work.slope[0, i] = work.signal[THETA_DOT, i]
        work.slope[1, i] = work.signal[THETA_DDOT, i]
    if measured == 0:
        differentiate(work.signal[T], work.signal[THETA_DOT], n, work.segment, work.slope[1])
    differentiate(work.signal[T], work.signal[BETA], n, work.segment, work.slope[2])


@kernel
def state_at(work, i, t_centre, x):
    """theta, theta_dot, beta, tau of row i into x (4,)."""
    x[0] = work.signal[THETA, i]
    x[1] = work.signal[THETA_DOT, i]
    x[2] = work.signal[BETA, i]
    x[TAU] = work.signal[T, i] - t_centre


@kernel
def standardise(work, centred, count, t_centre):
    """Mean and root mean square deviation of each variable over the kept rows (centre 0 where not `centred`)."""
    for v in range(N_VARIABLES):
        work.centre[v] = 0.0
        work.scale[v] = 0.0
    for r in range(count):
        state_at(work, work.kept[r], t_centre, work.raw)
        for v in range(N_VARIABLES):
            work.centre[v] += work.raw[v] * centred[v]
    for v in range(N_VARIABLES):
        work.centre[v] /= count
        work.z[v] = 0.0
    for r in range(count):
        state_at(work, work.kept[r], t_centre, work.raw)
        for v in range(N_VARIABLES):
            deviation = work.raw[v] - work.centre[v]
            work.scale[v] += deviation * deviation
            work.z[v] = max(work.z[v], abs(work.raw[v]))
    for v in range(N_VARIABLES):
        work.scale[v] = np.sqrt(work.scale[v] / count)
        if not work.scale[v] > STILL * work.z[v]:
            work.scale[v] = np.inf  # stands still: its standardised value is exactly 0, and the rank test sees it


@kernel
def standard_row(work, codes, i, t_centre):
    """Row i of Phi_std into work.row."""
    state_at(work, i, t_centre, work.raw)
    for v in range(N_VARIABLES):
        work.z[v] = (work.raw[v] - work.centre[v]) / work.scale[v]
    library_row(codes, work.raw, work.z, work.powers, work.row)


@kernel
def pointwise_rows(plan, work, count, t_centre):
    """Library columns and derivative targets at the kept rows."""
    q = plan.codes.shape[0]
    phi = work.phi[:q * count].reshape((q, count))
    target = work.target[:EQUATIONS * count].reshape((EQUATIONS, count))
    for r in range(count):
        i = work.kept[r]
        standard_row(work, plan.codes, i, t_centre)
        for j in range(q):
            phi[j, r] = work.row[j]
        for e in range(EQUATIONS):
            target[e, r] = work.slope[e, i]


@kernel
def integral_rows(plan, work, n, count, t_centre):
    """Running integrals (trapezoid) of the library columns, and the states, at the kept rows."""
    q = plan.codes.shape[0]
    phi = work.phi[:q * count].reshape((q, count))
    target = work.target[:EQUATIONS * count].reshape((EQUATIONS, count))
    r = 0
    for i in range(n):
        standard_row(work, plan.codes, i, t_centre)
        if i == 0 or work.segment[i] != work.segment[i - 1]:
            work.running[:] = 0.0
        else:
            half = 0.5 * (work.signal[T, i] - work.signal[T, i - 1])
            for j in range(q):
                work.running[j] += half * (work.previous[j] + work.row[j])
        for j in range(q):
            work.previous[j] = work.row[j]
        if r < count and work.kept[r] == i:
            for j in range(q):
                phi[j, r] = work.running[j]
            target[0, r] = work.signal[THETA, i]
            target[1, r] = work.signal[THETA_DOT, i]
            target[2, r] = work.signal[BETA, i]
            r += 1


@kernel
def centre_segments(columns, work, count):
    """Subtract from each column its mean over every gap-free piece; returns the number of pieces."""
    pieces = 0
    first = 0
    for end in range(1, count + 1):
        if end < count and work.segment[work.kept[end]] == work.segment[work.kept[first]]:
            continue
        pieces += 1
        for j in range(columns.shape[0]):
            mean = 0.0
            for r in range(first, end):
                mean += columns[j, r]
            mean /= end - first
            for r in range(first, end):
                columns[j, r] -= mean
        first = end
    return pieces


@kernel
def reduce_library(work, at, q):
    """M with Phi_raw = Q M from the factor of the scaled Phi_std: column i of M into work.mt[i]."""
    for i in range(q):
        for r in range(q):
            value = 0.0
            for k in range(r, q):
                j = work.order[k]
                value += at[k, r] * work.norms[j] * work.tt[i, j]
            work.mt[i, r] = value


@kernel
def residual_square(work, y, q, count):
    """|y - M xi|^2 over the whole window, y being Q' times the target."""
    square = 0.0
    for r in range(q, count):
        square += y[r] * y[r]
    for r in range(q):
        value = y[r]
        for i in range(q):
            value -= work.mt[i, r] * work.xi[i]
        square += value * value
    return square


@kernel
def position(active, term):
    """Place of `term` among the active ones, -1 if it is not one (or the library lacks it)."""
    if term < 0 or not active[term]:
        return -1
    place = 0
    for j in range(term):
        if active[j]:
            place += 1
    return place


@kernel
def coefficient(work, term):
    """Coefficient of a term; NaN if the library lacks it."""
    return work.xi[term] if term >= 0 else np.nan


@kernel
def report_attitude(plan, work, out, square, freedom):
    """a6, k1, slopes, standard deviations and correlation from the theta_ddot equation just solved."""
    a6, k1 = plan.plan[TERM_A6], plan.plan[TERM_K1]
    out.number[A6] = coefficient(work, a6)
    out.number[K1] = coefficient(work, k1)
    out.number[A6_DOT] = coefficient(work, plan.plan[TERM_A6_DOT])
    out.number[K1_DOT] = coefficient(work, plan.plan[TERM_K1_DOT])
    size = 0
    for j in range(work.active.shape[0]):
        if work.active[j]:
            size += 1
    freedom -= size
    if size == 0 or freedom <= 0:
        return
    invert_active(work.sparse, size)
    at_a6, at_k1 = position(work.active, a6), position(work.active, k1)
    if at_a6 >= 0:
        out.number[A6_STD] = np.sqrt(square / freedom * covariance_entry(work.sparse, at_a6, at_a6))
    if at_k1 >= 0:
        out.number[K1_STD] = np.sqrt(square / freedom * covariance_entry(work.sparse, at_k1, at_k1))
    if at_a6 >= 0 and at_k1 >= 0:
        product = covariance_entry(work.sparse, at_a6, at_a6) * covariance_entry(work.sparse, at_k1, at_k1)
        out.number[CORRELATION] = covariance_entry(work.sparse, at_a6, at_k1) / np.sqrt(product)


@kernel
def regress(plan, work, out, count, pieces):
    """Factor the library, solve the three equations, fill the outcome; returns its status.

    Source: Navarro-Tapia et al., eq. 5 and 6; reduction to q x q in `sparse`.
    """
    q = plan.codes.shape[0]
    at = work.phi[:q * count].reshape((q, count))
    target = work.target[:EQUATIONS * count].reshape((EQUATIONS, count))
    scale_columns(at, work.norms)
    rank = qr_factor(at, work.order, work.tau, RANK_TOLERANCE)
    if rank < q:
        return RANK
    out.number[CONDITION] = pivot_ratio(at, rank)
    raw_from_standard(plan.codes, work.centre, work.scale, work.tt)
    reduce_library(work, at, q)
    for e in range(EQUATIONS):
        y = target[e]
        apply_q_transposed(at, work.tau, q, y)
        passes = sparse_solve(plan.plan[SOLVER], work.mt, y[:q], plan.threshold[0], work.xi, work.active, work.sparse)
        if passes < 0 and e == ATTITUDE:
            return RANK
        for j in range(q):
            if passes > 0 and not np.isfinite(work.xi[j]):
                return NUMERICS
            out.xi[j, e] = work.xi[j] if passes > 0 else np.nan
            out.support[j, e] = work.active[j] and passes > 0
        if e == ATTITUDE:
            report_attitude(plan, work, out, residual_square(work, y, q, count), count - pieces)
    return OK


@kernel
def choose_window_rows(plan, work, random, n, saturated, gaps):
    """Choose the rows to keep among the usable ones; returns (rows kept, OK or the reason why they are too few)."""
    p = plan.plan[KEEP]
    kept = choose_rows(work.usable, n, p, random, work.kept)
    enough = max(plan.codes.shape[0] + 2, (p + 1) // 2)
    if kept >= enough:
        return kept, OK
    if kept + saturated >= enough:
        return kept, SATURATED
    return kept, GAP if gaps > 0 else SHORT


@kernel
def close_pointwise(plan, work, out, ring, count, random, t_centre):
    """Estimate from the window that just closed, formulations `measured` and `difference`.

    plan, work, out  Plan in, Work scratch, Outcome out
    ring   (m + 1, 6) in
    count  (N_COUNT,) in    int64
    random (1,)       inout int64 generator state
    t_centre [s]            the window's centre
    """
    clear_outcome(out, OK)
    n, saturated = copy_window(ring, count, plan.saturation, work.signal)
    gaps = mark_segments(work.signal[T], n, plan.max_gap[0], work.segment)
    fill_rate(work, n)
    fill_slopes(work, n, plan.plan[MEASURED])
    for i in range(n):
        work.usable[i] = int(np.isfinite(work.slope[0, i] + work.slope[1, i] + work.slope[2, i]))
    kept, status = choose_window_rows(plan, work, random, n, saturated, gaps)
    if status == OK:
        standardise(work, plan.centred, kept, t_centre)
        pointwise_rows(plan, work, kept, t_centre)
        status = regress(plan, work, out, kept, 0)
    if status != OK:
        clear_outcome(out, status)
    out.flag[USED] = kept
    out.flag[GAPS] = gaps


@kernel
def close_integral(plan, work, out, ring, count, random, t_centre):
    """Estimate from the window that just closed, formulation `integral`; arguments as `close_pointwise`."""
    clear_outcome(out, OK)
    q = plan.codes.shape[0]
    n, saturated = copy_window(ring, count, plan.saturation, work.signal)
    gaps = mark_segments(work.signal[T], n, plan.max_gap[0], work.segment)
    fill_rate(work, n)
    for i in range(n):
        work.usable[i] = int(np.isfinite(work.signal[THETA_DOT, i]))
    kept, status = choose_window_rows(plan, work, random, n, saturated, gaps)
    if status == OK:
        standardise(work, plan.centred, kept, t_centre)
        integral_rows(plan, work, n, kept, t_centre)
        pieces = centre_segments(work.phi[:q * kept].reshape((q, kept)), work, kept)
        centre_segments(work.target[:EQUATIONS * kept].reshape((EQUATIONS, kept)), work, kept)
        status = regress(plan, work, out, kept, pieces)
    if status != OK:
        clear_outcome(out, status)
    out.flag[USED] = kept
    out.flag[GAPS] = gaps
