"""Sparse regression on the factored library: which terms, and their coefficients.

All solvers see the reduced problem: with Phi_raw = Q M (Q orthonormal, M q x q)
the residual of any coefficient vector is |Q'y - M xi| plus a constant, so a
window costs one tall QR and every later solve is q x q; that with all columns is
factored once for the window's equations (`factor_whole`).

A term stays by one of two measures.  A threshold is in raw units of each coefficient, as in pysindy's STLSQ.  `needed`
has no unit but that of y'y: what a term must explain by itself, in squares, so that it does not depend on the units of
the variables.  `stls` and `ssr` then leave out the weakest term while leaving it out loses less than `needed` (backward
elimination; of nearly dependent terms, which explain much in common and little by themselves, one stays); `sr3` and
`lasso` compare |coefficient| times |column| with its root.

Each solver: (q, mt, whole, y, threshold, needed, xi, active, work) -> number of passes, where
mt (>=q, >=q) holds the columns of M as rows, whole the factor of all of them, y (q,) is
Q'y, xi (q,) and active (q,) are results, `work` a SparseWork; one of threshold and needed is 0.
After it xi solves least squares on the active columns and is 0 elsewhere.
"""

import numpy as np

from ..kernels import inner
from .lanes import dot, subtract
from .linsolve import apply_q_transposed, invert_triangle, place_of, qr_factor, scale_columns, solve_triangle

STLS, SR3, SSR, LASSO = range(4)

ACTIVE_TOLERANCE = 1.0e-14  # active columns are raw: condition up to 1e9 is data, 1e14 is rounding
LASSO_SWEEPS = 200          # coordinate descent: bound on the work, not a promise of convergence
SR3_ITERATIONS = 60
SR3_RELAXATION = 1.0        # nu, for columns of unit norm (Zheng et al. 2019: results vary little over decades)


@inner
def factor_whole(q, mt, whole):
    """Factor all q columns of M, which every equation's first pass takes."""
    columns = whole.columns[:q * q].reshape((q, q))
    for j in range(q):
        for i in range(q):
            columns[j, i] = mt[j, i]
    scale_columns(columns, whole.norms[:])
    whole.rank[0] = qr_factor(columns, whole.order[:], whole.tau[:], ACTIVE_TOLERANCE)


@inner
def solve_factored(q, n, factor, rank, y, xi, work):
    """Coefficients xi at work.places (n,) out of the factor of n columns, Whole or SparseWork; its rank deficiency."""
    if rank < n:
        return n - rank
    at, right = factor.columns[:n * q].reshape((n, q)), work.right[:q]
    for i in range(q):
        right[i] = y[i]
    apply_q_transposed(at, factor.tau[:], n, right)
    solve_triangle(at, n, right, work.solution[:])
    for k in range(n):
        column = factor.order[k]
        xi[work.places[column]] = work.solution[k] / factor.norms[column]
    return 0


@inner
def solve_whole(q, whole, y, xi, work):
    """`solve_active` with all columns active, but for the factor that it leaves in `work`."""
    for j in range(q):
        xi[j], work.places[j] = 0.0, j
    return solve_factored(q, q, whole, whole.rank[0], y, xi, work)


@inner
def solve_active(q, mt, y, active, xi, work):
    """Least squares on the active ones of q columns: xi there, 0 elsewhere; returns their rank deficiency (0 is good).

    Leaves the factor of the scaled active columns in `work` (columns, order, norms, index).
    """
    n = 0
    for j in range(q):
        xi[j] = 0.0
        if active[j]:
            work.places[n] = j
            n += 1
    at = work.columns[:n * q].reshape((n, q))
    for k in range(n):
        for i in range(q):
            at[k, i] = mt[work.places[k], i]
    scale_columns(at, work.norms[:n])
    rank = qr_factor(at, work.order[:n], work.tau[:n], ACTIVE_TOLERANCE)
    return solve_factored(q, n, work, rank, y, xi, work)


@inner
def count_active(q, active):
    """The number of active terms among the first q."""
    size = 0
    for j in range(q):
        if active[j]:
            size += 1
    return size


@inner
def covariance_entry(size, work, a, b):
    """Entry (a, b) of (M_S' M_S)^-1 after `solve_active` on S, a and b being positions within S; size terms."""
    n, row_a, row_b = 0.0, place_of(work.order, a, size), place_of(work.order, b, size)
    for k in range(max(row_a, row_b), size):
        n += work.inverse[row_a, k] * work.inverse[row_b, k]
    return n / (work.norms[a] * work.norms[b])


@inner
def invert_active(q, work, n):
    """Inverse of the active factor's triangle into work.inverse, zero-padded beyond n (for `covariance_entry`)."""
    for i in range(q):
        for j in range(q):
            work.inverse[i, j] = 0.0
    invert_triangle(work.columns[:n * q].reshape((n, q)), n, work.inverse[:])


@inner
def cut_below(q, xi, active, threshold):
    """Deactivate active terms with |xi| < threshold; returns how many."""
    cut = 0
    for j in range(q):
        if active[j] and abs(xi[j]) < threshold:
            active[j] = False
            xi[j] = 0.0
            cut += 1
    return cut


@inner
def solve_stls(q, mt, whole, y, threshold, xi, active, work):
    """Sequentially thresholded least squares (Brunton, Proctor & Kutz, PNAS 113, 2016).

    The active set only shrinks, so q + 1 passes suffice.
    """
    active[:] = True
    for passes in range(q + 1):
        deficient = solve_whole(q, whole, y, xi, work) if passes == 0 else solve_active(q, mt, y, active, xi, work)
        if deficient > 0:
            return -1
        if cut_below(q, xi, active, threshold) == 0:
            return passes + 1
    return q + 1


@inner
def solve_ssr(q, mt, whole, y, threshold, xi, active, work):
    """Stepwise sparse regression (Boninsegna, Nueske & Clementi, J. Chem. Phys. 148, 2018).

    Removes the one smallest coefficient below the threshold at a time and solves again.
    """
    active[:] = True
    for passes in range(q + 1):
        deficient = solve_whole(q, whole, y, xi, work) if passes == 0 else solve_active(q, mt, y, active, xi, work)
        if deficient > 0:
            return -1
        smallest = -1
        for j in range(q):
            if active[j] and abs(xi[j]) < threshold and (smallest < 0 or abs(xi[j]) < abs(xi[smallest])):
                smallest = j
        if smallest < 0:
            return passes + 1
        active[smallest] = False
    return q + 1


@inner
def solve_own(q, mt, y, needed, xi, active, work):
    """Backward elimination: the term that explains least by itself goes, until all that stay explain at least `needed`.

    What a term explains by itself is the square of its coefficient over its entry of (M'M)^-1: by so much the sum of
    squares grows without it (Draper & Smith, Applied Regression Analysis, the extra sum of squares).
    """
    active[:] = True
    for passes in range(q + 1):
        if solve_active(q, mt, y, active, xi, work) > 0:
            return -1
        size = count_active(q, active)
        invert_active(q, work, size)
        weakest, least = -1, needed
        place = 0
        for j in range(q):
            if active[j]:
                explained = xi[j] * xi[j] / covariance_entry(q, work, place, place)
                if explained < least:
                    weakest, least = j, explained
                place += 1
        if weakest < 0:
            return passes + 1
        active[weakest] = False
    return q + 1


@inner
def load_scaled(q, mt, work):
    """The q columns of M, scaled to unit norm, one after the other in work.scaled, with their norms in work.weight."""
    scaled = work.scaled[:q * q].reshape((q, q))
    for j in range(q):
        for i in range(q):
            scaled[j, i] = mt[j, i]
    scale_columns(scaled, work.weight[:])


@inner
def solve_lasso(q, mt, y, threshold, needed, xi, active, work):
    """Lasso by coordinate descent (Friedman, Hastie & Tibshirani, JSS 33, 2010), then least squares on its support.

    Penalties are weighted by |column|^2, so that with orthogonal columns exactly
    the coefficients below the raw threshold vanish; the refit removes shrinkage.
    """
    root = np.sqrt(needed)
    load_scaled(q, mt, work)
    scaled = work.scaled[:q * q].reshape((q, q))
    residual = work.auxiliary[:]
    for i in range(q):
        residual[i] = y[i]
        work.solution[i] = 0.0
    sweeps = 0
    for sweep in range(LASSO_SWEEPS):
        sweeps = sweep + 1
        largest_step = 0.0
        largest = 0.0
        for j in range(q):
            column = scaled[j]
            old = work.solution[j]
            free = old + dot(column, residual, 0, q)
            soft = max(abs(free) - threshold * work.weight[j] - root, 0.0)
            new = soft if free > 0.0 else -soft
            subtract(residual, new - old, column, 0, q)
            work.solution[j] = new
            largest_step = max(largest_step, abs(new - old))
            largest = max(largest, abs(new))
        if largest_step <= 1.0e-12 * largest:
            break
    for j in range(q):
        active[j] = work.solution[j] != 0.0 or threshold + needed == 0.0
    return -1 if solve_active(q, mt, y, active, xi, work) > 0 else sweeps


@inner
def solve_sr3(q, mt, whole, y, threshold, needed, xi, active, work):
    """Sparse relaxed regularized regression (Zheng et al., IEEE Access 7, 2019), hard threshold, then refit.

    min |y - C u|^2 + nu |u - w|^2 with w = u cut at the threshold; [C; sqrt(nu) I] is factored once.
    """
    load_scaled(q, mt, work)
    scaled = work.scaled[:q * q].reshape((q, q))
    root, least = np.sqrt(SR3_RELAXATION), np.sqrt(needed)
    active[:] = True
    if solve_whole(q, whole, y, xi, work) > 0:
        return -1
    w = work.auxiliary
    stacked = work.columns[:2 * q * q].reshape((q, 2 * q))
    for j in range(q):
        size = abs(xi[j]) * work.weight[j]
        w[j] = 0.0 if size < threshold * work.weight[j] + least else xi[j] * work.weight[j]
        for i in range(q):
            stacked[j, i] = scaled[j, i]
            stacked[j, q + i] = root if i == j else 0.0
    rank = qr_factor(stacked, work.order[:], work.tau[:], ACTIVE_TOLERANCE)
    right = work.right[:2 * q]
    for _ in range(SR3_ITERATIONS):
        for i in range(q):
            right[i] = y[i]
            right[q + i] = root * w[i]
        apply_q_transposed(stacked, work.tau[:], rank, right)
        solve_triangle(stacked, rank, right, work.solution[:])
        change = 0.0
        for k in range(q):
            j = work.order[k]
            active[j] = not abs(work.solution[k]) < threshold * work.weight[j] + least
            new = work.solution[k] if active[j] else 0.0
            change = max(change, abs(new - w[j]))
            w[j] = new
        if change == 0.0:
            break
    return -1 if solve_active(q, mt, y, active, xi, work) > 0 else SR3_ITERATIONS

