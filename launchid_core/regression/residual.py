"""Standard deviations of a window's regression from its own residual, which is not white.

The method: docs/method.md, "Standard deviations".

Sources: Newey & West, Econometrica 55, 1987; n/(n - k): MacKinnon & White, J. Econometrics 29, 1985; the lag L by the
plug-in of Andrews, Econometrica 59, 1991, eq. 5.3, 6.2 and 6.4 (Bartlett's weights, a first order autoregression a
series, each series by its own scale).  The estimates stay those of the model with constant a6 and k1.
"""

import math

import numpy as np

from ..algebra import linsolve as ls
from ..algebra.linsolve import EPS, U, dot
from ..algebra.sparse import ACTIVE_TOLERANCE
from ..gate import window as wn
from ..kernels import inner
from . import rows as rw

STEADIEST = 0.97     # largest autoregression believed: beyond, L would be the whole window and S = 0
BARTLETT = 1.1447    # of L for Bartlett's weights (Andrews, eq. 6.2)


@inner
def autoregression(v):
    """Return (numerator, denominator) that a series v (n,) adds to the fraction in Andrews' eq. 6.4."""
    count = v.shape[0]
    before = dot(v, v, 0, count - 1)
    if not before > 0.0:
        return 0.0, 0.0
    rho = min(max(dot(v[1:], v, 0, count - 1) / before, -STEADIEST), STEADIEST)
    share = (1.0 + rho) / (1.0 - rho)  # the innovation's variance over the series', by (1 - rho)^2
    return 4.0 * rho * rho * share * share / ((1.0 - rho * rho) * (1.0 - rho * rho)), share * share


@inner
def bandwidth(above, below, count):
    """Return how many lags L (0..count/2) the sum S goes over, for series of `count` numbers (Andrews, eq. 6.2).

    above, below  sums over the series of what `autoregression` returns
    """
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
def long_run(v, w, lags, freedom, same):
    """Return the element of S (docs/method.md) of two series (n,), which may be the `same`; freedom = n - k."""
    count = v.shape[0]
    value = dot(v, w, 0, count)
    for lag in range(1, lags + 1):
        ahead = dot(v[lag:], w, 0, count - lag)
        behind = ahead if same else dot(w[lag:], v, 0, count - lag)
        value += (1.0 - lag / (lags + 1.0)) * (ahead + behind)
    return value * count / freedom


@inner
def own_variance(v, freedom):
    """Return the element of S of one series v (n,) with itself, lags by its own scale; freedom = n - k."""
    above, below = autoregression(v)
    return long_run(v, v, bandwidth(above, below, v.shape[0]), freedom, True)


@inner
def factor_drifts(plan, q, size, work, drift, count, free):
    """Factor what the drifts of a6 and k1 add to the `size` active terms; returns how many drifts.

    The drift of a term that is active, and its slope not; none where the window cannot tell them from the rest.
    drift (>=2*count,)  inout  in the coordinates of the window's factor; out: what is left of each below the active
    terms, factored, one after the other.  work.heads  out  the rest, in the coordinates of the active terms' factor
    """
    rows = work.sparse.rows[:4 * q * q].reshape((q, 4 * q))
    drifts = 0
    for d in range(rw.PAIR):
        term, slope = plan.term[d], plan.slope[d]
        is_sloped = slope >= 0 and rw.is_active(plan, work.active[:], slope)
        if term >= 0 and rw.is_active(plan, work.active[:], term) and not is_sloped:
            for i in range(count):
                drift[drifts * count + i] = drift[d * count + i]
            drifts += 1
    if drifts == 0 or size + drifts >= free:
        return 0
    ls.scale_columns(drift[:drifts * count].reshape((drifts, count)), work.drift_norms[:])
    left = count - size
    for d in range(drifts):
        column = drift[d * count:(d + 1) * count]
        for i in range(q):
            work.heads[d, i] = dot(rows[i][2 * q:3 * q], column, 0, q)
        for i in range(q - size):
            drift[d * left + i] = work.heads[d, size + i]
        for i in range(q - size, left):
            drift[d * left + i] = column[size + i]
    tails = drift[:drifts * left].reshape((drifts, left))
    rank = ls.qr_factor(tails, work.drift_order[:drifts], work.drift_tau[:], ACTIVE_TOLERANCE)
    return drifts if rank == drifts and abs(tails[0, 0]) > ACTIVE_TOLERANCE else 0


@inner
def fill_series(plan, q, size, work, y, drift, series, drifts, known):
    """Fill residuals and influences in the coordinates of the active terms' factor.

    series (2 + q, count)  out  residual of the active terms with the drifts, residual without, and of each term: the
    influence of the rows on its coefficient, or, where it is not active and `known`, the direction that it adds
    y (count,)  in  theta_ddot in the coordinates of the window's factor;  drift, drifts  of `factor_drifts`
    An influence is a row of the pseudo-inverse, R^-1 Q'.  A term adds one direction d to the active ones (Frisch &
    Waugh, Econometrica 1, 1933; Lovell, JASA 58, 1963): its coefficient is d'y over what of the column lies along d,
    and d'y d what the residual loses.
    """
    left, norms = y.shape[0] - size, work.sparse.norms
    rows = work.sparse.rows[:4 * q * q].reshape((q, 4 * q))
    tails, value, order = drift[:drifts * left].reshape((drifts, left)), work.drift_value[:], work.drift_order
    series[:, :] = 0.0
    for i in range(size, y.shape[0]):
        series[1, i] = rows[i, 3 * q] if i < q else y[i]
        series[0, i] = series[1, i]
    residual = series[0][size:]
    ls.apply_q_transposed(tails, work.drift_tau[:], drifts, residual)
    ls.solve_triangle(tails, drifts, residual, value)
    for k in range(drifts):
        residual[k] = 0.0
    for j in range(q):
        work.change[j] = 0.0
        if rw.is_active(plan, work.active[:], j):
            for i in range(size):
                series[2 + j, i] = rows[i, q + j] / norms[j]
            for k in range(drifts):  # by what the drifts explain of the rows: (R^-1 heads) R_drift^-1
                row = 0.0
                for i in range(size):
                    row -= series[2 + j, i] * work.heads[order[k], i]
                work.change[j] += row * value[k]
                for before in range(k):
                    row -= series[2 + j, size + before] * tails[k, before]
                series[2 + j, size + k] = row / tails[k, k]
        elif known:
            square = 0.0
            for i in range(size, q):
                series[2 + j, i] = rows[i, j]
                square += rows[i, j] * rows[i, j]
            share, work.length[j] = math.sqrt(square), 0.0
            if ACTIVE_TOLERANCE < share < np.inf:
                work.length[j] = share * norms[j]
                for i in range(size, q):
                    series[2 + j, U(i)] /= share
                work.lost[j] = dot(series[2 + j], series[1], size, q)


@inner
def turn_back(plan, at, q, size, work, drift, series, drifts):
    """Turn the series (2 + q, count) into time: by the factors of drifts, active terms, window (`at`, (>=q, count))."""
    rows, left = work.sparse.rows[:4 * q * q].reshape((q, 4 * q)), series.shape[1] - size
    tails = drift[:drifts * left].reshape((drifts, left))
    for k in range(series.shape[0]):
        if k == 0 or (k > 1 and rw.is_active(plan, work.active[:], k - 2)):
            ls.rotate(tails, work.drift_tau[:], drifts, series[k][size:].reshape((1, left)), 0, 1)
        head = work.head[:q]
        head[:] = 0.0
        for i in range(q):
            ls.subtract(head, -series[k, i], rows[i][2 * q:3 * q], 0, q)
        for i in range(q):
            series[k, i] = head[i]
    ls.rotate(at, work.tau[:], q, series, 0, series.shape[0])


@inner
def weigh_influences(plan, q, work, rows, marks, series):
    """Add up by how much quadrature, differencing and rounding may put each active coefficient off, its square into
    work.numeric; then weigh its influences by the residual."""
    count, largest = series.shape[1], 0.0
    for j in range(q):
        largest += abs(work.xi[j]) * work.sparse.norms[j]
    for j in range(q):
        if rw.is_active(plan, work.active[:], j):
            influence, off = series[2 + j], 0.0
            for r in range(count):
                off += influence[r] * rows[rw.ROW_ERROR, marks[rw.KEPT, r]]
            rounding = EPS * largest
            work.numeric[j] = off * off + rounding * rounding * dot(influence, influence, 0, count)
            for i in range(count):
                influence[U(i)] *= series[0, U(i)]


@inner
def report_active(plan, q, work, out, rows, marks, series, freedom):
    """Report standard deviations of the active terms, a6 and k1 with their correlation, from the residual's series in
    time."""
    weigh_influences(plan, q, work, rows, marks, series)
    count = series.shape[1]
    above = below = 0.0
    for p in range(rw.PAIR):
        j = plan.term[p]
        if j >= 0 and rw.is_active(plan, work.active[:], j):
            more, less = autoregression(series[2 + j])
            above, below = above + more, below + less
    lags = bandwidth(above, below, count)  # of a6 and k1 together
    for j in range(q):
        if rw.is_active(plan, work.active[:], j):
            v = series[2 + j]
            if j == plan.term[0] or j == plan.term[1]:
                variance = long_run(v, v, lags, freedom, True)
            else:
                variance = own_variance(v, freedom)
            out.std[j] = math.sqrt(variance + work.change[j] * work.change[j] + work.numeric[j])
    if plan.term[0] >= 0:
        out.a6_std = out.std[plan.term[0]]
    if plan.term[1] >= 0:
        out.k1_std = out.std[plan.term[1]]
    product = out.a6_std * out.k1_std
    if product > 0.0:  # both are active
        a, b = plan.term[0], plan.term[1]
        shared = long_run(series[2 + b], series[2 + a], lags, freedom, False) + work.change[a] * work.change[b]
        out.correlation = min(max(shared / product, -1.0), 1.0)


@inner
def report_attitude(fixed, work, out, rows, marks, at, series, n, free):
    """Report standard deviations and correlation of the active terms of theta_ddot, 95 % limits of the terms left out,
    and a6 and k1 with their standard deviations; a limit is inf where the window cannot tell a term from the active
    ones.

    at (q + EQUATIONS + PAIR, count)  in  the window's factor, in its coordinates targets and drifts (lost);
    series (2 + q, count)  scratch;  n  rows of the window;  free  rows kept less what the pieces' means took
    """
    q, plan, count = fixed.size.terms, fixed.plan, at.shape[1]
    y, drift = at[q + wn.ATTITUDE], at[q + wn.EQUATIONS:].reshape((rw.PAIR * count,))
    size = q
    if plan.sparse == 1:
        for j in range(q):
            size -= int(work.active[j] == 0)
    known = plan.sparse == 1 and free > size + 1
    drifts = factor_drifts(plan, q, size, work, drift, count, free)
    fill_series(plan, q, size, work, y, drift, series, drifts, known)
    turn_back(plan, at, q, size, work, drift, series, drifts)
    if size > 0:
        if fixed.size.integral == 1:
            rw.integral_error(fixed.codes[:q], work, rows, marks, n, work.xi, plan.held)
        report_active(plan, q, work, out, rows, marks, series, free - size - drifts)
    for j in range(q):
        if not rw.is_active(plan, work.active[:], j):
            out.absent[j] = np.inf
            if known and work.length[j] > 0.0:
                for i in range(count):
                    series[2 + j, U(i)] *= series[1, U(i)] - work.lost[j] * series[2 + j, U(i)]
                std = math.sqrt(own_variance(series[2 + j], free - size - 1)) / work.length[j]
                out.absent[j] = abs(work.lost[j] / work.length[j]) + wn.INTERVAL * std
                if j == plan.term[0]:
                    out.a6_std = std
                if j == plan.term[1]:
                    out.k1_std = std
