"""Standard deviations of a window's regression from its own residual, which is not white.

A coefficient's error is sum c_i e_i over the rows: c its influence (its row of the
pseudo-inverse), e what the model misses.  Two things make the textbook's s^2 (Phi'Phi)^-1
too small, and both are measured on the window itself:

* e is autocorrelated (a running integral of the sensors' noise is a random walk).  The variance of
  the sum is that of the series v_i = c_i r_i at frequency zero:

      S = sum_i v_i v_i' + sum_{l=1}^{L} (1 - l/(L + 1)) sum_i (v_i v_{i-l}' + v_{i-l} v_i'),   times n/(n - k)

  Newey & West, Econometrica 55, 1987; n/(n - k): MacKinnon & White, J. Econometrics 29, 1985.  L by the plug-in of
  Andrews, Econometrica 59, 1991, eq. 5.3, 6.2 and 6.4 (Bartlett's weights, a first order autoregression a series,
  each series by its own scale).
* a6 and k1 are not constant over the window, and the residual does not show it, for a common drift of both looks
  like another pair of constants.  The equation is solved again with tau*theta and tau*beta beside its active terms:
  S is that solution's, and the square of what the two solutions differ by is added.

* derivatives and integrals of sampled signals are inexact, also without noise.  What a row may be off (`plan.ERROR`)
  times its influence adds up to what a coefficient may be off; rounding, a unit in the last place of the largest term,
  to less.  Both squares are added.

The estimates stay those of the constant model.
"""

import math

import numpy as np

from ..algebra import linsolve as ls
from ..algebra.lanes import divide, dot, multiply, subtract, weigh
from ..algebra.linsolve import (
    apply_q_transposed,
    invert_triangle,
    place_of,
    qr_factor,
    rotate,
    scale_columns,
    solve_triangle,
)
from ..algebra.sparse import ACTIVE_TOLERANCE, count_active, solve_active
from ..gate.ring import ATTACK, BETA, T
from ..gate.window import INTERVAL, O_A6, O_A6_STD, O_CORRELATION
from ..kernels import inner
from .plan import ERROR, HALF, KEPT, PAIR, TERM_A6, TERM_A6_DOT, VALUE
from .rows import integrate

STEADIEST = 0.97     # largest autoregression believed: beyond, L would be the whole window and S = 0
BARTLETT = 1.1447    # of L for Bartlett's weights (Andrews, eq. 6.2)


@inner
def apply_q(at, tau, rank, y):
    """y <- Q y for the factor made by `qr_factor`.  y (m,) inout."""
    m = at.shape[1]
    for back in range(rank):
        k = rank - 1 - back
        v = at[k]
        s = tau[k] * (y[k] + dot(v, y, k + 1, m))
        y[k] -= s
        subtract(y, s, v, k + 1, m)


@inner
def bandwidth(scores):
    """Lags L that the series need together, 0..n/2.  scores (k, n) in"""
    count = scores.shape[1]
    above = below = 0.0
    for a in range(scores.shape[0]):
        v = scores[a]
        before = dot(v, v, 0, count - 1)
        if before > 0.0:
            rho = min(max(dot(v[1:], v, 0, count - 1) / before, -STEADIEST), STEADIEST)
            share = (1.0 + rho) / (1.0 - rho)  # the innovation's variance over the series', by (1 - rho)^2
            above += 4.0 * rho * rho * share * share / ((1.0 - rho * rho) * (1.0 - rho * rho))
            below += share * share
    if not below > 0.0:
        return 0
    cube = BARTLETT * BARTLETT * BARTLETT * count * above / below
    lags = 0
    for k in range(1, count // 2 + 1):
        if k * k * k > cube:
            break
        lags = k
    return lags


@inner
def long_run(scores, freedom, covariance):
    """S of the module's head, of series with n - k = `freedom`.

    scores (k, n)  in;  covariance (>=k, >=k)  out
    """
    size, count = scores.shape
    lags = bandwidth(scores)
    for a in range(size):
        for b in range(a + 1):
            v, w = scores[a], scores[b]
            value = dot(v, w, 0, count)
            for lag in range(1, lags + 1):
                ahead = dot(v[lag:], w, 0, count - lag)
                behind = ahead if a == b else dot(w[lag:], v, 0, count - lag)
                value += (1.0 - lag / (lags + 1.0)) * (ahead + behind)
            covariance[a, b] = value * count / freedom
            covariance[b, a] = covariance[a, b]


@inner
def position(active, term):
    """Place of `term` among the active ones, -1 if it is not one (or the library lacks it)."""
    return count_active(term, active) if term >= 0 and active[term] else -1


@inner
def drift_pointwise(rows, marks, drift, count, t_centre):
    """tau*theta and tau*beta at the kept rows."""
    for r in range(count):
        i = marks[KEPT, r]
        tau = rows[T, i] - t_centre
        drift[0, r] = tau * rows[ATTACK, i]
        drift[1, r] = tau * rows[BETA, i]


@inner
def drift_integral(rows, marks, drift, n, count, t_centre, held):
    """The drifts' running integrals at the kept rows, by the weights of `rows.fill_weights`; held  1: beta stays."""
    for d in range(PAIR):
        for i in range(n):
            rows[VALUE, i] = (rows[T, i] - t_centre) * rows[ATTACK if d == 0 else BETA, i]
        integrate(rows, marks, n, rows[VALUE], rows[HALF], d == 1 and held == 1)
        for r in range(count):
            drift[d, r] = rows[HALF, marks[KEPT, r]]


@inner
def has_drift(plan, active, d):
    """Whether the solution is widened by the drift of a6 (d = 0) or k1 (d = 1): active, its slope not."""
    return position(active, plan[TERM_A6 + d]) >= 0 and position(active, plan[TERM_A6_DOT + d]) < 0


@inner
def fill_extended(plan, q, active, mt, drift, with_drifts, columns):
    """Active columns and, where `with_drifts` is 1, the drifts', in the rotated coordinates; returns how many.

    mt (>=q, >=q), drift (2, n)  in;  columns (>= (q + 2)*n,)  out  one after the other
    """
    count = drift.shape[1]
    n = 0
    for j in range(q):
        if active[j]:
            for i in range(count):
                columns[n * count + i] = mt[j, i] if i < q else 0.0
            n += 1
    for d in range(PAIR):
        if with_drifts == 1 and has_drift(plan, active, d):
            for i in range(count):
                columns[n * count + i] = drift[d, i]
            n += 1
    return n


@inner
def fill_influences(plan, work, out, width, series):
    """Influences of the rows on a6 and k1 in the factor's rotation, 0 if not active, into series (3, n); work.change.

    An influence is a row of R^-1 over the column's norm, turned back: (Q Q' (row of R^-1)/norm).
    """
    for p in range(PAIR):
        place = position(work.active, plan[TERM_A6 + p])
        work.change[p] = 0.0
        influence = series[1 + p]
        influence[:] = 0.0
        if place >= 0:
            k = place_of(work.extended_order, place, width)
            norm = work.extended_norms[place]
            work.change[p] = work.extended_solution[k] / norm - out.number[O_A6 + p]
            for i in range(width):
                influence[i] = work.extended_inverse[k, i] / norm


@inner
def solve_extended(plan, q, work, out, y, drift, extended, series, rows):
    """Residual and influences on a6 and k1 with the drifts beside the active terms, in the factor's rotation.

    y (count,), drift (2, count)  in  Q' times theta_ddot, and times the drifts;  rows  count less what the pieces'
    means took.  Into series (0 to 2) and extended; returns how many terms that solution has, 0 if none is.
    """
    count, width = y.shape[0], 0
    for attempt in range(2):  # without the drifts where the window cannot tell them from the rest
        width = fill_extended(plan, q, work.active, work.mt, drift, 1 - attempt, extended)
        factors = extended[:width * count].reshape((width, count))
        scale_columns(factors, work.extended_norms[:])
        if qr_factor(factors, work.extended_order[:], work.extended_tau[:], ACTIVE_TOLERANCE) == width < rows:
            break
        if attempt == 1:
            return 0
    if width == 0:
        return 0
    columns = extended[:width * count].reshape((width, count))
    residual = series[0]
    for i in range(count):
        residual[i] = y[i]
    apply_q_transposed(columns, work.extended_tau[:], width, residual)
    solve_triangle(columns, width, residual, work.extended_solution[:])
    invert_triangle(columns, width, work.extended_inverse[:])
    for k in range(width):
        residual[k] = 0.0
    fill_influences(plan, work, out, width, series)
    rotate(columns, work.extended_tau[:], width, series, 0, 1 + PAIR)
    return width


@inner
def numeric_variance(q, work, rows, marks, influence, count):
    """Square of what quadrature, differencing and rounding may leave in a coefficient with this influence (count,)."""
    largest = off = 0.0
    for j in range(q):
        largest += abs(work.xi[j]) * math.sqrt(dot(work.mt[j], work.mt[j], 0, q))
    for r in range(count):
        off += influence[r] * rows[ERROR, marks[KEPT, r]]
    rounding = ls.EPS * largest
    return off * off + rounding * rounding * dot(influence, influence, 0, count)


@inner
def report_spread(plan, q, work, out, rows, marks, series, freedom):
    """Standard deviations and correlation of a6 and k1, the active ones, from the series in time."""
    count = series.shape[1]
    for p in range(PAIR):
        work.numeric[p] = numeric_variance(q, work, rows, marks, series[1 + p], count)
        if position(work.active, plan[TERM_A6 + p]) >= 0:
            multiply(series[1 + p], series[0], 0, count)
    long_run(series[1:1 + PAIR], freedom, work.covariance[:])
    for p in range(PAIR):
        for r in range(PAIR):
            work.covariance[p, r] += work.change[p] * work.change[r]
        work.covariance[p, p] += work.numeric[p]
        if position(work.active, plan[TERM_A6 + p]) >= 0:
            out.number[O_A6_STD + p] = math.sqrt(work.covariance[p, p])
            out.std[plan[TERM_A6 + p]] = out.number[O_A6_STD + p]
    product = work.covariance[0, 0] * work.covariance[1, 1]
    if product > 0.0:  # both are active
        out.number[O_CORRELATION] = min(max(work.covariance[0, 1] / math.sqrt(product), -1.0), 1.0)


@inner
def report_others(plan, work, out, rows, marks, at, extended, series, width, freedom):
    """Standard deviations of the other active terms, as `report_spread` has those of a6 and k1.

    at (q, count)  in  the window's factor;  width  terms of the extended solution.  Overwrites series (1).
    """
    q, count = at.shape
    columns = extended[:width * count].reshape((width, count))
    for j in range(q):
        if not work.active[j] or j == plan[TERM_A6] or j == plan[TERM_A6 + 1]:
            continue
        k = place_of(work.extended_order, position(work.active, j), width)
        norm = work.extended_norms[position(work.active, j)]
        change = work.extended_solution[k] / norm - work.xi[j]
        for i in range(count):
            series[1, i] = work.extended_inverse[k, i] / norm if i < width else 0.0
        rotate(columns, work.extended_tau[:], width, series, 1, 2)
        rotate(at, work.tau[:], q, series, 1, 2)
        numeric = numeric_variance(q, work, rows, marks, series[1], count)
        multiply(series[1], series[0], 0, count)
        long_run(series[1:2], freedom, work.covariance[:])
        out.std[j] = math.sqrt(work.covariance[0, 0] + change * change + numeric)


@inner
def add_direction(factors, tau, size, direction):
    """Turn a column (q,) into the unit one that it adds to the `size` columns of a factor, in the factor's rotation.

    Returns how much of its length that is, 0 if it adds nothing.
    """
    q = direction.shape[0]
    apply_q_transposed(factors, tau, size, direction)
    share = math.sqrt(dot(direction, direction, size, q))
    for i in range(size):
        direction[i] = 0.0
    if not ACTIVE_TOLERANCE < share < np.inf:
        return 0.0
    divide(direction, share, size, q)
    return share


@inner
def solve_absent(q, work, y, residual, size, rows):
    """Residual (count,) of the `size` active terms in the factor's rotation, out; whether there is one.

    Leaves their factor in work.sparse.  y (count,), rows  in  as of `solve_extended`
    """
    count, sparse = y.shape[0], work.sparse
    if size == q or rows <= size + 1 or solve_active(q, work.mt[:], y[:q], work.active[:], sparse.trial[:],
                                                         sparse) > 0:
        return False
    for i in range(count):
        residual[i] = y[i] if i >= q else (sparse.right[i] if i >= size else 0.0)
    apply_q(sparse.columns[:size * q].reshape((size, q)), sparse.tau[:], size, residual[:q])
    return True


@inner
def report_absent(plan, work, out, at, residual, extended, size, known, freedom):
    """95 % limit of every term that is not active, as if it alone were added; a6 and k1 get their standard deviation.

    at (q, count)  in  the window's factor;  residual (count,), size, known  in  of `solve_absent`;  freedom  rows less
    terms;  extended  scratch
    A term adds one direction d to the active ones (Frisch & Waugh, Econometrica 1, 1933; Lovell, JASA 58, 1963): its
    coefficient is d'y over what of the column lies along d, and d'y d what the residual loses.
    inf: the window cannot tell it from the active ones.
    """
    q, count = at.shape
    direction, sparse = work.direction[:q], work.sparse
    factors = sparse.columns[:size * q].reshape((size, q))
    influences = extended[:(q - size) * count].reshape((q - size, count))
    lost, length, places = sparse.lost, sparse.length, work.extended_order
    reported = 0
    for j in range(q):
        if work.active[j]:
            continue
        out.absent[j] = np.inf
        for i in range(q):
            direction[i] = work.mt[j, i]
        scale_columns(direction.reshape((1, q)), work.length[:])
        share = add_direction(factors, sparse.tau[:], size, direction) if known else 0.0
        if share == 0.0:
            continue
        length[j] = share * work.length[0]
        lost[j] = dot(direction, sparse.right[:], size, q)
        apply_q(factors, sparse.tau[:], size, direction)
        for i in range(count):
            influences[reported, i] = direction[i] if i < q else 0.0
        places[reported] = j
        reported += 1
    rotate(at, work.tau[:], q, influences, 0, reported)  # in time
    for k in range(reported):
        j = places[k]
        weigh(influences[k], residual, lost[j], 0, count)
        long_run(influences[k:k + 1], freedom, work.covariance[:])
        std = math.sqrt(work.covariance[0, 0]) / length[j]
        out.absent[j] = abs(lost[j] / length[j]) + INTERVAL * std
        for p in range(PAIR):
            if j == plan[TERM_A6 + p]:
                out.number[O_A6_STD + p] = std
