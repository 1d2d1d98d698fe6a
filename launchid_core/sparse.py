"""Sparse regression on the factored library: which terms, and their coefficients.

All solvers see the reduced problem: with Phi_raw = Q M (Q orthonormal, M q x q)
the residual of any coefficient vector is |Q'y - M xi| plus a constant, so a
window costs one tall QR and every later solve is q x q; that with all columns is
factored once for the window's equations (`factor_whole`).

A term stays by one of two measures.  A threshold is in raw units of each coefficient, as in pysindy's STLSQ.  `own`
has no unit but that of y'y: what a term must explain by itself, in squares, so that it does not depend on the units of
the variables.  `stls` and `ssr` then leave out the weakest term while leaving it out loses less than `own` (backward
elimination; of nearly dependent terms, which explain much in common and little by themselves, one stays); `sr3` and
`lasso` compare |coefficient| times |column| with its root.

Each solver: (mt, whole, y, threshold, own, xi, active, work) -> number of passes, where
mt (q, q) holds the columns of M as rows, whole the factor of all of them, y (q,) is
Q'y, xi (q,) and active (q,) are results, `work` a SparseWork; one of threshold and own is 0.  After it xi solves least
squares on the active columns and is 0 elsewhere.
"""

from typing import NamedTuple

import numpy as np

from .kernels import inner, once, shared
from .lanes import dot, subtract
from .linsolve import apply_q_transposed, invert_triangle, qr_factor, scale_columns, solve_triangle
from .memory import take, take2
from .records import store

STLS, SR3, SSR, LASSO = range(4)

ACTIVE_TOLERANCE = 1.0e-14  # active columns are raw: condition up to 1e9 is data, 1e14 is rounding
LASSO_SWEEPS = 200          # coordinate descent: bound on the work, not a promise of convergence
SR3_ITERATIONS = 60
SR3_RELAXATION = 1.0        # nu, for columns of unit norm (Zheng et al. 2019: results vary little over decades)


@store
class SparseWork(NamedTuple):
    """Scratch of the solvers for q terms; of use after `solve_active` and `invert_active` alone."""

    columns: np.ndarray   # (2 q^2,) active columns one after the other; 2q rows each for SR3's stacked system
    order: np.ndarray     # (q,) int64
    tau: np.ndarray       # (q,)
    norms: np.ndarray     # (q,)
    right: np.ndarray     # (2q,)
    solution: np.ndarray  # (q,)
    places: np.ndarray    # (q,) int64 active column numbers
    scaled: np.ndarray    # (q, q)
    weight: np.ndarray    # (q,)
    auxiliary: np.ndarray  # (q,)
    inverse: np.ndarray   # (q, q)


@shared
def view_sparse(f, at, i, m, q):
    """Cut it from floats f at `at` and integers i at `m` for q terms; returns (it, next at, next m)."""
    columns, at = take(f, at, 2 * q * q)
    order, m = take(i, m, q)
    tau, at = take(f, at, q)
    norms, at = take(f, at, q)
    right, at = take(f, at, 2 * q)
    solution, at = take(f, at, q)
    places, m = take(i, m, q)
    scaled, at = take2(f, at, q, q)
    weight, at = take(f, at, q)
    auxiliary, at = take(f, at, q)
    inverse, at = take2(f, at, q, q)
    return SparseWork(columns, order, tau, norms, right, solution, places, scaled, weight, auxiliary, inverse), at, m


@store
class Whole(NamedTuple):
    """Factor of all columns of M, scaled."""

    columns: np.ndarray   # (q, q)
    order: np.ndarray     # (q,) int64
    tau: np.ndarray       # (q,)
    norms: np.ndarray     # (q,)
    rank: np.ndarray      # (1,) int64


@shared
def view_whole(f, at, i, m, q):
    """Cut it from floats f at `at` and integers i at `m` for q terms; returns (it, next at, next m)."""
    columns, at = take2(f, at, q, q)
    order, m = take(i, m, q)
    tau, at = take(f, at, q)
    norms, at = take(f, at, q)
    rank, m = take(i, m, 1)
    return Whole(columns, order, tau, norms, rank), at, m


@once
def factor_whole(mt, whole):
    """Factor all columns of M, which every equation's first pass takes."""
    for j in range(mt.shape[0]):
        for i in range(mt.shape[0]):
            whole.columns[j, i] = mt[j, i]
    scale_columns(whole.columns, whole.norms)
    whole.rank[0] = qr_factor(whole.columns, whole.order, whole.tau, ACTIVE_TOLERANCE)


@inner
def solve_whole(whole, y, xi, work):
    """`solve_active` with all columns active, but for the factor that it leaves in `work`."""
    q = y.shape[0]
    for j in range(q):
        xi[j] = 0.0
    if whole.rank[0] < q:
        return q - whole.rank[0]
    right = work.right[:q]
    for i in range(q):
        right[i] = y[i]
    apply_q_transposed(whole.columns, whole.tau, q, right)
    solve_triangle(whole.columns, q, right, work.solution)
    for k in range(q):
        column = whole.order[k]
        xi[column] = work.solution[k] / whole.norms[column]
    return 0


@inner
def solve_active(mt, y, active, xi, work):
    """Least squares on the active columns: xi there, 0 elsewhere; returns their rank deficiency (0 is good).

    Leaves the factor of the scaled active columns in `work` (columns, order, norms, index).
    """
    q = mt.shape[0]
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
    if rank < n:
        return n - rank
    right = work.right[:q]
    for i in range(q):
        right[i] = y[i]
    apply_q_transposed(at, work.tau, n, right)
    solve_triangle(at, n, right, work.solution)
    for k in range(n):
        column = work.order[k]
        xi[work.places[column]] = work.solution[k] / work.norms[column]
    return 0


@inner
def covariance_entry(work, a, b):
    """Entry (a, b) of (M_S' M_S)^-1 after `solve_active` on S, a and b being positions within S."""
    n = 0.0
    row_a = row_b = 0
    size = work.inverse.shape[0]
    for k in range(size):
        if work.order[k] == a:
            row_a = k
            break
    for k in range(size):
        if work.order[k] == b:
            row_b = k
            break
    for k in range(max(row_a, row_b), size):
        n += work.inverse[row_a, k] * work.inverse[row_b, k]
    return n / (work.norms[a] * work.norms[b])


@inner
def invert_active(work, n):
    """Inverse of the active factor's triangle into work.inverse, zero-padded beyond n (for `covariance_entry`)."""
    for i in range(work.inverse.shape[0]):
        for j in range(work.inverse.shape[0]):
            work.inverse[i, j] = 0.0
    q = work.inverse.shape[0]
    invert_triangle(work.columns[:n * q].reshape((n, q)), n, work.inverse)


@once
def cut_below(xi, active, threshold):
    """Deactivate active terms with |xi| < threshold; returns how many."""
    cut = 0
    for j in range(xi.shape[0]):
        if active[j] and abs(xi[j]) < threshold:
            active[j] = False
            xi[j] = 0.0
            cut += 1
    return cut


@once
def solve_stls(mt, whole, y, threshold, xi, active, work):
    """Sequentially thresholded least squares (Brunton, Proctor & Kutz, PNAS 113, 2016).

    The active set only shrinks, so q + 1 passes suffice.
    """
    active[:] = True
    for passes in range(mt.shape[0] + 1):
        deficient = solve_whole(whole, y, xi, work) if passes == 0 else solve_active(mt, y, active, xi, work)
        if deficient > 0:
            return -1
        if cut_below(xi, active, threshold) == 0:
            return passes + 1
    return mt.shape[0] + 1


@once
def solve_ssr(mt, whole, y, threshold, xi, active, work):
    """Stepwise sparse regression (Boninsegna, Nueske & Clementi, J. Chem. Phys. 148, 2018).

    Removes the one smallest coefficient below the threshold at a time and solves again.
    """
    active[:] = True
    for passes in range(mt.shape[0] + 1):
        deficient = solve_whole(whole, y, xi, work) if passes == 0 else solve_active(mt, y, active, xi, work)
        if deficient > 0:
            return -1
        smallest = -1
        for j in range(xi.shape[0]):
            if active[j] and abs(xi[j]) < threshold and (smallest < 0 or abs(xi[j]) < abs(xi[smallest])):
                smallest = j
        if smallest < 0:
            return passes + 1
        active[smallest] = False
    return mt.shape[0] + 1


@once
def solve_own(mt, y, own, xi, active, work):
    """Backward elimination: the term that explains least by itself goes, until all that stay explain at least `own`.

    What a term explains by itself is the square of its coefficient over its entry of (M'M)^-1: by so much the sum of
    squares grows without it (Draper & Smith, Applied Regression Analysis, the extra sum of squares).
    """
    q = mt.shape[0]
    active[:] = True
    for passes in range(q + 1):
        if solve_active(mt, y, active, xi, work) > 0:
            return -1
        size = 0
        for j in range(q):
            if active[j]:
                size += 1
        invert_active(work, size)
        weakest, least = -1, own
        place = 0
        for j in range(q):
            if active[j]:
                explained = xi[j] * xi[j] / covariance_entry(work, place, place)
                if explained < least:
                    weakest, least = j, explained
                place += 1
        if weakest < 0:
            return passes + 1
        active[weakest] = False
    return q + 1


@inner
def load_scaled(mt, work):
    """Columns of M, scaled to unit norm, into work.scaled with their norms in work.weight."""
    q = mt.shape[0]
    for j in range(q):
        for i in range(q):
            work.scaled[j, i] = mt[j, i]
    scale_columns(work.scaled, work.weight)


@once
def solve_lasso(mt, y, threshold, own, xi, active, work):
    """Lasso by coordinate descent (Friedman, Hastie & Tibshirani, JSS 33, 2010), then least squares on its support.

    Penalties are weighted by |column|^2, so that with orthogonal columns exactly
    the coefficients below the raw threshold vanish; the refit removes shrinkage.
    """
    q, root = mt.shape[0], np.sqrt(own)
    load_scaled(mt, work)
    residual = work.auxiliary
    for i in range(q):
        residual[i] = y[i]
        work.solution[i] = 0.0
    sweeps = 0
    for sweep in range(LASSO_SWEEPS):
        sweeps = sweep + 1
        largest_step = 0.0
        largest = 0.0
        for j in range(q):
            column = work.scaled[j]
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
        active[j] = work.solution[j] != 0.0 or threshold + own == 0.0
    return -1 if solve_active(mt, y, active, xi, work) > 0 else sweeps


@once
def solve_sr3(mt, whole, y, threshold, own, xi, active, work):
    """Sparse relaxed regularized regression (Zheng et al., IEEE Access 7, 2019), hard threshold, then refit.

    min |y - C u|^2 + nu |u - w|^2 with w = u cut at the threshold; [C; sqrt(nu) I] is factored once.
    """
    q = mt.shape[0]
    load_scaled(mt, work)
    root, least = np.sqrt(SR3_RELAXATION), np.sqrt(own)
    active[:] = True
    if solve_whole(whole, y, xi, work) > 0:
        return -1
    w = work.auxiliary
    stacked = work.columns.reshape((q, 2 * q))
    for j in range(q):
        size = abs(xi[j]) * work.weight[j]
        w[j] = 0.0 if size < threshold * work.weight[j] + least else xi[j] * work.weight[j]
        for i in range(q):
            stacked[j, i] = work.scaled[j, i]
            stacked[j, q + i] = root if i == j else 0.0
    rank = qr_factor(stacked, work.order, work.tau, ACTIVE_TOLERANCE)
    for _ in range(SR3_ITERATIONS):
        for i in range(q):
            work.right[i] = y[i]
            work.right[q + i] = root * w[i]
        apply_q_transposed(stacked, work.tau, rank, work.right)
        solve_triangle(stacked, rank, work.right, work.solution)
        change = 0.0
        for k in range(q):
            j = work.order[k]
            active[j] = not abs(work.solution[k]) < threshold * work.weight[j] + least
            new = work.solution[k] if active[j] else 0.0
            change = max(change, abs(new - w[j]))
            w[j] = new
        if change == 0.0:
            break
    return -1 if solve_active(mt, y, active, xi, work) > 0 else SR3_ITERATIONS


@once
def sparse_solve(solver, mt, whole, y, threshold, own, xi, active, work):
    """Run solver number `solver` (index into SOLVERS); returns its passes, -1 if columns it took are dependent."""
    if solver == SR3:
        return solve_sr3(mt, whole, y, threshold, own, xi, active, work)
    if solver == LASSO:
        return solve_lasso(mt, y, threshold, own, xi, active, work)
    if own > 0.0:
        return solve_own(mt, y, own, xi, active, work)
    if solver == SSR:
        return solve_ssr(mt, whole, y, threshold, xi, active, work)
    return solve_stls(mt, whole, y, threshold, xi, active, work)
