"""Small dense least squares by Householder QR with column pivoting.

numba without scipy has no linear algebra inside kernels, hence this file.  No
Gram matrix is ever formed: on the ten-term library normal equations lose all
digits (raw condition up to 8e8, squared 6e17).

Storage: a matrix A (m x n) is kept as `at` (n, m), row j of `at` being column j
of A, so that every inner loop runs along contiguous memory.

Source: Golub & Van Loan, Matrix Computations, 4th ed., algorithms 5.1.1, 5.2.1, 5.4.1.
"""

import math

import numpy as np

from ..kernels import inner
from .lanes import divide, dot, largest_size, reflect, scale, subtract

EPS = np.finfo(np.float64).eps
LARGER = 1.0 + 1.0e-12  # so much is no rounding: of columns of one norm the first is the pivot, on any machine
# share of a column's square: less left of it by subtraction has lost three digits, and is summed anew
MIN_LEFT = 1.0e-3
LEAST_SQUARE = 1.0e-200  # of a column: below it, and above its inverse, a number's own square may be 0 or inf


@inner
def scale_columns(at, norms):
    """Divide every column by its 2-norm; a zero column (or one that is not finite) keeps its values, norm 1.

    at    (n, m) inout
    norms (n,)   out
    """
    n, m = at.shape
    for j in range(n):
        column = at[j]
        square = dot(column, column, 0, m)
        if LEAST_SQUARE < square < 1.0 / LEAST_SQUARE:
            norms[j] = math.sqrt(square)
            scale(column, 1.0 / norms[j], 0, m)
            continue
        largest = largest_size(column, 0, m)
        norms[j] = 1.0
        if 0.0 < largest < np.inf:
            divide(column, largest, 0, m)
            norm = math.sqrt(dot(column, column, 0, m))
            divide(column, norm, 0, m)
            norms[j] = largest * norm


@inner
def swap_columns(at, order, j, k):
    """Exchange columns j and k of A and their entries in `order`."""
    if j == k:
        return
    a, b = at[j], at[k]
    for i in range(at.shape[1]):
        keep = a[i]
        a[i] = b[i]
        b[i] = keep
    number = order[j]
    order[j] = order[k]
    order[k] = number


@inner
def qr_factor(at, order, tau, tolerance):
    """A P = Q R in place; returns the numerical rank.

    at        (>=n, m) inout  columns of A; out: R in at[j, :j+1], Householder vectors below (leading 1 implied);
                            columns behind the first n turn along, they become Q' times themselves
    order     (n,)   out    int64: column k of A P is column order[k] of A
    tau       (n,)   out    Householder factors
    tolerance              a pivot at most this times the first one ends the factorisation
    Returns the number of pivots above the tolerance, 0..min(m, n); a column that is not finite counts as dependent.
    """
    n, m = order.shape[0], at.shape[1]
    for j in range(n):
        order[j] = j
        tau[j] = dot(at[j], at[j], 0, m)  # square of what is left of a column, until it is one of R
    first = 0.0
    rank = 0
    for k in range(min(n, m)):
        best = k
        square = -1.0
        for j in range(k, n):
            if tau[j] > LARGER * square:
                best, square = j, tau[j]
        swap_columns(at, order, k, best)
        tau[best] = tau[k]
        v = at[k]
        norm = math.sqrt(dot(v, v, k, m))
        if k == 0:
            first = norm
        if not norm > tolerance * first:  # nor is infinity more than a share of infinity
            break
        beta = -math.copysign(norm, v[k])
        tau[k] = (beta - v[k]) / beta
        inverse = 1.0 / (v[k] - beta)
        scale(v, inverse, k + 1, m)
        v[k] = beta
        reflect(v, tau[k], at, k + 1, at.shape[0], k, m)
        for j in range(k + 1, n):
            tau[j] -= at[j, k] * at[j, k]
            if not tau[j] > MIN_LEFT * first * first:
                tau[j] = dot(at[j], at[j], k + 1, m)
        rank += 1
    for j in range(rank, n):
        tau[j] = 0.0
    return rank


@inner
def place_of(order, column, n):
    """The place of a column in the pivoted order; -1: it is not there."""
    for k in range(n):
        if order[k] == column:
            return k
    return -1


@inner
def apply_q_transposed(at, tau, rank, y):
    """y <- Q' y for the factor made by `qr_factor`.  y (m,) inout."""
    m = at.shape[1]
    for k in range(rank):
        v = at[k]
        s = tau[k] * (y[k] + dot(v, y, k + 1, m))
        y[k] -= s
        subtract(y, s, v, k + 1, m)


@inner
def rotate(at, tau, rank, columns, first, last):
    """columns[j] <- Q columns[j], j = first..last-1, for the factor made by `qr_factor`.  columns (>=last, m) inout."""
    for back in range(rank):
        k = rank - 1 - back
        reflect(at[k], tau[k], columns, first, last, k, at.shape[1])


@inner
def solve_triangle(at, n, y, x):
    """Back substitution R x = y[:n] with R in at[j, :j+1].  x (n,) out, in pivoted order."""
    for k in range(n - 1, -1, -1):
        s = y[k]
        for j in range(k + 1, n):
            s -= at[j, k] * x[j]
        x[k] = s / at[k, k]


@inner
def pivot_ratio(at, rank):
    """First pivot over last of rank >= 1: a lower bound of the condition number, within a small factor in practice."""
    return abs(at[0, 0]) / abs(at[rank - 1, rank - 1])


@inner
def measure(mean, covariance, row, first, n, z, column):
    """One scalar measurement z = row . state + unit noise of a Kalman filter of n states; returns (innovation, its
    variance).

    mean (>=n,), covariance (>=n, >=n)  inout;  row (>=n,)  in, from `first` on, 0 before;  column (>=n,)  scratch
    Source: Anderson & Moore, Optimal Filtering, 1979, section 5.3.
    """
    e, variance = z, 1.0
    for i in range(first, n):
        e -= row[i] * mean[i]
    for i in range(n):
        column[i] = 0.0
        for j in range(first, n):
            column[i] += covariance[i, j] * row[j]
    for i in range(first, n):
        variance += row[i] * column[i]
    for i in range(n):
        gain = column[i] / variance
        mean[i] += gain * e
        for j in range(n):
            covariance[i, j] -= gain * column[j]
    return e, variance


@inner
def absorb_rows(r, rt, n, k):
    """Triangle of [R; rows]: adds k rows of data to a square-root information matrix, by Householder.

    r  (>=n, >=n) inout  upper triangular
    rt (>=n, >=k) inout  the rows, column by column; destroyed
    Source: Bierman, Factorization Methods for Discrete Sequential Estimation, 1977, chapter IV.
    """
    for j in range(n):
        v = rt[j]
        square = dot(v, v, 0, k)
        if square == 0.0:
            continue
        alpha = r[j, j]
        beta = -math.copysign(math.sqrt(alpha * alpha + square), alpha)
        tau = (beta - alpha) / beta
        inverse = 1.0 / (alpha - beta)
        for i in range(k):
            v[i] *= inverse
        r[j, j] = beta
        for c in range(j + 1, n):
            column = rt[c]
            s = tau * (r[j, c] + dot(v, column, 0, k))
            r[j, c] -= s
            subtract(column, s, v, 0, k)


@inner
def absorb_columns(r, matrix, columns, n, k, scratch):
    """`absorb_rows` of the first k rows of a matrix, of its columns that `columns` (>=n,) names.  scratch (>=n k,)"""
    rt = scratch[:n * k].reshape((n, k))
    for j in range(n):
        for i in range(k):
            rt[j, i] = matrix[i, columns[j]]
    absorb_rows(r, rt, n, k)


@inner
def carry_vector(transition, n, v, column):
    """v <- transition v for the first n of v.  transition (>=n, >=n)  in;  column (>=n,)  scratch"""
    for i in range(n):
        column[i] = 0.0
        for k in range(n):
            column[i] += transition[i, k] * v[k]
    for i in range(n):
        v[i] = column[i]


@inner
def carry_columns(transition, n, matrix, count, column):
    """Apply `carry_vector` to `count` columns of a matrix."""
    for j in range(count):
        for i in range(n):
            column[i] = 0.0
            for k in range(n):
                column[i] += transition[i, k] * matrix[k, j]
        for i in range(n):
            matrix[i, j] = column[i]
