"""A window closes: its triangle is solved, and what becomes of the answer."""

import numpy as np

from ..algebra.linsolve import absorb_columns
from ..gate import window as wn
from ..gate.window import knows_nothing, knows_one_direction
from ..kernels import inner
from .belief import AT_BETA, AT_THETA, profile_at
from .states import N_SLOPES, N_TESTS
from .unknown_servo import first_column
from .whiteness import IN_WINDOW

# deviation (f8): standard deviations of theta's and beta's relative deviation, their correlation
STD_A6, STD_K1, CORR = range(3)


@inner
def begin_columns(size, columns):
    """Columns of what is solved for first, offset and servo; returns how many."""
    for j in range(size.states):
        columns[j] = j
    for j in range(size.servo):
        columns[size.states + j] = first_column(size) + j
    return size.states + size.servo


@inner
def select_columns(size, active, theta, beta, columns):
    """Columns of the window's triangle to keep, in the order offset, servo, other active terms, theta, beta, tests,
    right-hand side.

    columns (c,) out int64;  returns how many.
    """
    n, q = size.states, size.terms
    m = begin_columns(size, columns)
    for j in range(q):
        if active[j] and j != theta and j != beta:
            columns[m] = n + j
            m += 1
    if active[theta]:
        columns[m] = n + theta
        m += 1
    if active[beta]:
        columns[m] = n + beta
        m += 1
    for j in range(N_TESTS + 1):
        columns[m + j] = n + q + size.servo + j
    return m + N_TESTS + 1


@inner
def reduce_columns(width, acc, work, r):
    """Triangle r (m, m) out, at the head of work.scratch, of the first m columns of the window that work.columns
    names; width columns in all."""
    m = r.shape[0]
    r[:, :] = 0.0
    absorb_columns(r, acc.window[:], work.columns[:], m, width, work.scratch[m * m:])


@inner
def solve_absent(size, acc, work, active, term):
    """(coefficient, standard deviation) that a term has beside the active ones, or would have, as of `solve_window`."""
    n, m = size.states, begin_columns(size, work.columns[:])
    for j in range(size.terms):
        if active[j] and j != term:
            work.columns[m] = n + j
            m += 1
    work.columns[m], work.columns[m + 1] = n + term, size.sensitivities
    r = work.scratch[:(m + 2) * (m + 2)].reshape((m + 2, m + 2))
    reduce_columns(size.columns, acc, work, r)
    return r[m, m + 1] / r[m, m], 1.0 / abs(r[m, m])


@inner
def solve_window(belief, acc, work, active):
    """Least squares of the window's active terms on its own data.

    active (q,) in
    work   out  coefficient (theta's and beta's are relative deviations; 0 for inactive terms), deviation (NaN where
                inactive)
    Returns by how much the tests would reduce the sum of squares beside the slopes: chi square of two if the model is
    true.
    """
    n = belief.size.states
    theta, beta = belief.term[AT_THETA], belief.term[AT_BETA]
    columns, coefficient, deviation = work.columns[:], work.coefficient, work.deviation
    m = select_columns(belief.size, active, theta, beta, columns)
    r = work.scratch[:m * m].reshape((m, m))
    reduce_columns(belief.size.columns, acc, work, r)
    coefficient[:] = 0.0
    last = m - N_TESTS - 2  # of the terms
    for k in range(last, n + belief.size.servo - 1, -1):
        value = r[k, m - 1]
        for j in range(k + 1, last + 1):
            value -= r[k, j] * coefficient[columns[j] - n]
        coefficient[columns[k] - n] = value / r[k, k]
    deviation[:] = np.nan
    if active[theta] and active[beta]:
        a, b, c = r[last - 1, last - 1], r[last - 1, last], r[last, last]
        deviation[STD_A6] = np.sqrt(1.0 + (b / c) * (b / c)) / abs(a)
        deviation[STD_K1] = 1.0 / abs(c)
        deviation[CORR] = -(b / abs(c)) / np.sqrt(1.0 + (b / c) * (b / c)) * (1.0 if a > 0.0 else -1.0)
    elif active[theta]:
        deviation[STD_A6] = 1.0 / abs(r[last, last])
    elif active[beta]:
        deviation[STD_K1] = 1.0 / abs(r[last, last])
    unexplained = 0.0
    for k in range(last + 1 + N_SLOPES, m - 1):
        unexplained += r[k, m - 1] * r[k, m - 1]
    return unexplained


@inner
def limit_absent(belief, profile, state, work, t_centre):
    """95 % limits of the terms that were left out of a valid window; an absent a6 or k1 is 0 with the standard
    deviation that it would have."""
    out = state.outcome
    if out.flag[wn.STATUS] == wn.OK:
        a6, k1 = profile_at(profile, t_centre)
        for j in range(belief.size.terms):
            is_rigid = j == belief.term[AT_THETA] or j == belief.term[AT_BETA]
            if state.active[j] and is_rigid:
                continue
            value, std = solve_absent(belief.size, state.acc, work, state.active[:], j)
            if state.active[j]:
                out.std[j] = std
                continue
            if j == belief.term[AT_THETA]:
                value, std = a6 * (1.0 + value), abs(a6) * std
                out.number[wn.O_A6_STD] = std
            elif j == belief.term[AT_BETA]:
                value, std = k1 * (1.0 + value), abs(k1) * std
                out.number[wn.O_K1_STD] = std
            out.absent[j] = abs(value) + wn.INTERVAL * std


@inner
def report_window(belief, profile, state, work, t_centre):
    """Relative deviations into a6, k1 and their standard deviations at the window's centre; returns the status."""
    out, coefficient = state.outcome, work.coefficient
    theta, beta = belief.term[AT_THETA], belief.term[AT_BETA]
    std_a, std_k, correlation = work.deviation[STD_A6], work.deviation[STD_K1], work.deviation[CORR]
    a6, k1 = profile_at(profile, t_centre)
    out.number[wn.O_A6_BOUND], out.number[wn.O_K1_BOUND] = abs(a6) * std_a, abs(k1) * std_k
    out.number[wn.O_CONDITION] = np.sqrt((1.0 + abs(correlation)) / (1.0 - abs(correlation)))
    if knows_nothing(std_a, std_k):
        return wn.LOW_INFORMATION
    if state.check.flag[IN_WINDOW] == 1:
        return wn.MODEL
    if knows_one_direction(std_a, std_k, correlation):
        return wn.SEPARATION
    for j in range(belief.size.terms):
        out.xi[j, wn.THETA_REPEATS] = coefficient[j]
        out.support[j, wn.THETA_REPEATS] = state.active[j]
    out.xi[theta, wn.THETA_REPEATS] = a6 * (1.0 + coefficient[theta]) if state.active[theta] else 0.0
    out.xi[beta, wn.THETA_REPEATS] = k1 * (1.0 + coefficient[beta]) if state.active[beta] else 0.0
    out.number[wn.O_A6], out.number[wn.O_K1] = out.xi[theta, wn.THETA_REPEATS], out.xi[beta, wn.THETA_REPEATS]
    out.number[wn.O_A6_STD], out.number[wn.O_K1_STD] = out.number[wn.O_A6_BOUND], out.number[wn.O_K1_BOUND]
    if state.active[theta]:
        out.std[theta] = out.number[wn.O_A6_STD]
    if state.active[beta]:
        out.std[beta] = out.number[wn.O_K1_STD]
    out.number[wn.O_CORRELATION] = correlation if a6 * k1 > 0.0 else -correlation  # a product leaves a NaN's sign open
    if not np.isfinite(out.number[wn.O_A6] + out.number[wn.O_K1]):
        return wn.NUMERICS
    return wn.OK
