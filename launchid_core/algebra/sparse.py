"""Sparse regression on the factored library: which terms, and their coefficients.

All solvers see the reduced problem: with Phi_raw = Q M (Q orthonormal, M q x q) the residual of any coefficient vector
is |Q'y - M xi| plus a constant, so a window costs one tall QR, and one of M that all its equations begin with.  A term
leaves by Givens rotations, without another factorisation.

The factor of n active columns of M, scaled to unit norm, lies by rows of 4 q numbers:

* R, a column a term (columns of terms that left stay, as long as they are);
* the inverse of the active triangle, transposed, a column a term: a coefficient is its column times Q'y;
* the orthonormal basis, a row of Q';
* Q'y, one number.

All four turn with the rows.  Row k's diagonal element is of the term order[k].

A term stays by one of two measures.  A threshold is in raw units of each coefficient, as in pysindy's STLSQ.  `needed`
has no unit but that of y'y: what a term must explain by itself, in squares, so that it does not depend on the units of
the variables.  The elimination then leaves out the weakest term while leaving it out loses less than `needed` (backward
elimination; of nearly dependent terms, which explain much in common and little by themselves, one stays); `sr3` and
`lasso` compare |coefficient| times |column| with its root.

Each solver returns the number of passes (sr3: its most), or -1 if columns it took are dependent.  whole: the factor of
all columns;  y (q,): Q'y;  mt (>=q, >=q): M', of sr3 and lasso;  xi (q,), active (q,): out.  xi then solves least
squares on the active columns and is 0 elsewhere, and `work` holds their factor.
"""

import numpy as np

from ..kernels import inner
from .linsolve import apply_q_transposed, dot, qr_factor, scale_columns, solve_triangle, subtract, turn

STLS, SR3, SSR, LASSO = range(4)

ACTIVE_TOLERANCE = 1.0e-14  # active columns are raw: condition up to 1e9 is data, 1e14 is rounding
LASSO_SWEEPS = 200          # coordinate descent: bound on the work, not a promise of convergence
SR3_ITERATIONS = 60
SR3_RELAXATION = 1.0        # nu, for columns of unit norm (Zheng et al. 2019: results vary little over decades)


# ---- the factor


@inner
def factor_whole(q, mt, whole, scratch):
    """Factor all q columns of M, with which every equation begins.  scratch (>=2*q*q,)"""
    columns, rows = scratch[:2 * q * q].reshape((2 * q, q)), whole.rows[:4 * q * q].reshape((q, 4 * q))
    for j in range(q):
        for i in range(q):
            columns[j, i] = mt[j, i]
            columns[q + j, i] = 1.0 if i == j else 0.0
    scale_columns(columns[:q], whole.norms[:])
    qr_factor(columns, whole.order[:q], whole.tau[:], 0.0)
    for i in range(q):
        for j in range(q):
            rows[i, whole.order[j]] = columns[j, i] if j >= i else 0.0
            rows[i, 2 * q + j] = columns[q + j, i]
    invert(q, q, whole.order[:], rows)


@inner
def invert(q, n, order, rows):
    """Fill the inverse of a triangle of n terms, transposed, beside it."""
    for i in range(n):
        inverse = rows[i][q:2 * q]
        inverse[:] = 0.0
        inverse[order[i]] = 1.0 / rows[i, order[i]]
        for k in range(i - 1, -1, -1):
            inverse[order[k]] = -dot(rows[k], inverse, 0, q) / rows[k, order[k]]


@inner
def begin(q, whole, y, xi, work):
    """Take all terms into the work, and y; whether their columns are independent."""
    rows = work.rows[:4 * q * q].reshape((q, 4 * q))
    for k in range(4 * q * q):
        work.rows[k] = whole.rows[k]
    for i in range(q):
        rows[i, 3 * q] = dot(rows[i][2 * q:3 * q], y, 0, q)
        xi[i], work.order[i], work.norms[i] = 0.0, whole.order[i], whole.norms[i]
    return is_regular(q, work.order[:], rows)


@inner
def is_regular(n, order, rows):
    """Whether no element of a triangle's diagonal is rounding beside its largest."""
    largest = 0.0
    for k in range(n):
        largest = max(largest, abs(rows[k, order[k]]))
    for k in range(n):
        if not abs(rows[k, order[k]]) > ACTIVE_TOLERANCE * largest:
            return False
    return True


@inner
def leave(q, n, term, order, rows):
    """Take a term out of the factor of n: its column goes, rotations make a triangle of the rest; returns n - 1.

    Source: Golub & Van Loan, Matrix Computations, 4th ed., 6.5.2.
    """
    passed = False
    for k in range(n - 1):
        passed = passed or order[k] == term
        if passed:
            order[k] = order[k + 1]
            turn(rows[k], rows[k + 1], order[k], 3 * q + 1)
    order[n - 1] = term
    return n - 1


@inner
def solve(q, n, order, norms, rows, xi):
    """Coefficients xi (q,) of the n active terms, 0 of the others, by back substitution."""
    for j in range(q):
        xi[j] = 0.0
    for k in range(n - 1, -1, -1):
        j = order[k]
        xi[j] = (rows[k, 3 * q] - dot(rows[k], xi, 0, q)) / rows[k, j]
    for j in range(q):
        xi[j] /= norms[j]


@inner
def variances(q, n, rows, variance):
    """Variance (q,) of each active coefficient, of scaled columns, for errors of unit variance."""
    for j in range(q):
        variance[j] = 0.0
    for i in range(n):
        for j in range(q):
            variance[j] += rows[i, q + j] * rows[i, q + j]


# ---- the solvers


@inner
def solve_stls(q, whole, y, threshold, xi, active, work):
    """Sequentially thresholded least squares (Brunton, Proctor & Kutz, PNAS 113, 2016).

    The active set only shrinks, so q + 1 passes suffice.
    """
    order, norms, rows = work.order[:], work.norms[:], work.rows[:4 * q * q].reshape((q, 4 * q))
    active[:] = True
    if not begin(q, whole, y, xi, work):
        return -1
    n = q
    solve(q, n, order, norms, rows, xi)
    if not threshold > 0.0:
        return 1
    for passes in range(1, q + 1):
        before = n
        for j in range(q):
            if active[j] and abs(xi[j]) < threshold:
                active[j] = False
                n = leave(q, n, j, order, rows)
        if n == before:
            return passes
        solve(q, n, order, norms, rows, xi)
    return q + 1


@inner
def solve_stepwise(q, whole, y, by_share, least, xi, active, work):
    """Take out the weakest term at a time and solve again, until none that stays is below `least`.

    by_share  0: the smallest coefficient below a raw threshold goes: stepwise sparse regression (Boninsegna, Nueske &
    Clementi, J. Chem. Phys. 148, 2018).  1: the term that explains least by itself, the square of its coefficient over
    its entry of (M'M)^-1: by so much the sum of squares grows without it (Draper & Smith, Applied Regression Analysis,
    the extra sum of squares): backward elimination.
    """
    order, norms, rows = work.order[:], work.norms[:], work.rows[:4 * q * q].reshape((q, 4 * q))
    active[:] = True
    if not begin(q, whole, y, xi, work):
        return -1
    for gone in range(q + 1):
        solve(q, q - gone, order, norms, rows, xi)
        variances(q, q - gone, rows, work.weight[:])
        weakest, strength = -1, least
        for j in range(q):
            if active[j]:
                own = xi[j] * norms[j] * xi[j] * norms[j] / work.weight[j] if by_share == 1 else abs(xi[j])
                if own < strength:
                    weakest, strength = j, own
        if weakest < 0:
            return gone + 1
        active[weakest] = False
        leave(q, q - gone, weakest, order, rows)
    return q + 1


@inner
def refit(q, whole, y, xi, active, work):
    """Least squares on the terms that `active` names; whether their columns are independent."""
    order, rows = work.order[:], work.rows[:4 * q * q].reshape((q, 4 * q))
    begin(q, whole, y, xi, work)
    n = q
    for j in range(q):
        if not active[j]:
            n = leave(q, n, j, order, rows)
    if not is_regular(n, order, rows):
        return False
    invert(q, n, order, rows)
    solve(q, n, order, work.norms[:], rows, xi)
    return True


@inner
def load_scaled(q, mt, work):
    """The q columns of M, scaled to unit norm, one after the other in work.scaled, with their norms in work.weight."""
    scaled = work.scaled[:q * q].reshape((q, q))
    for j in range(q):
        for i in range(q):
            scaled[j, i] = mt[j, i]
    scale_columns(scaled, work.weight[:])


@inner
def solve_lasso(q, mt, whole, y, threshold, needed, xi, active, work):
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
    return sweeps if refit(q, whole, y, xi, active, work) else -1


@inner
def solve_sr3(q, mt, whole, y, threshold, needed, xi, active, work):
    """Sparse relaxed regularized regression (Zheng et al., IEEE Access 7, 2019), hard threshold, then refit.

    min |y - C u|^2 + nu |u - w|^2 with w = u cut at the threshold; [C; sqrt(nu) I] is factored once.
    """
    load_scaled(q, mt, work)
    scaled = work.scaled[:q * q].reshape((q, q))
    root, least = np.sqrt(SR3_RELAXATION), np.sqrt(needed)
    active[:] = True
    if not begin(q, whole, y, xi, work):
        return -1
    solve(q, q, work.order[:], work.norms[:], work.rows[:4 * q * q].reshape((q, 4 * q)), xi)
    w = work.auxiliary
    stacked = work.columns[:2 * q * q].reshape((q, 2 * q))
    for j in range(q):
        size = abs(xi[j]) * work.weight[j]
        w[j] = 0.0 if size < threshold * work.weight[j] + least else xi[j] * work.weight[j]
        for i in range(q):
            stacked[j, i] = scaled[j, i]
            stacked[j, q + i] = root if i == j else 0.0
    rank = qr_factor(stacked, work.order[:q], work.tau[:], ACTIVE_TOLERANCE)
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
    return SR3_ITERATIONS if refit(q, whole, y, xi, active, work) else -1
