"""Small dense least squares by Householder QR with column pivoting.

numba without scipy has no linear algebra inside kernels.  No Gram matrix is ever formed: on the ten-term library normal
equations lose all digits (raw condition up to 8e8, squared 6e17).

Storage: a matrix A (m x n) is kept as `at` (n, m), row j of `at` being column j of A, so that every inner loop runs
along contiguous memory, four numbers at a time, each sum in its own fixed order: the same bits everywhere.  Positions
start .. stop-1 of a loop must lie inside its vectors.

Source: Golub & Van Loan, Matrix Computations, 4th ed., algorithms 5.1.1, 5.2.1, 5.4.1.
"""

import math

import numpy as np

from ..kernels import inner

EPS = np.finfo(np.float64).eps
LARGER = 1.0 + 1.0e-12  # so much is no rounding: of columns of one norm the first is the pivot, on any machine
# share of a column's square: less left of it by subtraction has lost three digits, and is summed anew
MIN_LEFT = 1.0e-3
LEAST_SQUARE = 1.0e-200  # of a column: below it, and above its inverse, a number's own square may be 0 or inf
U = np.uint64  # of an index: numba asks a signed one whether it counts from the end, and takes one number at a time


@inner
def dot(a, b, start, stop):
    """sum a[i]*b[i], i in start..stop-1, in four interleaved partial sums (fixed order: same bits everywhere)."""
    s0 = s1 = s2 = s3 = 0.0
    quads = (stop - start) // 4
    for k in range(quads):
        i = U(start + 4 * k)
        s0 += a[i] * b[i]
        s1 += a[i + U(1)] * b[i + U(1)]
        s2 += a[i + U(2)] * b[i + U(2)]
        s3 += a[i + U(3)] * b[i + U(3)]
    for k in range(start + 4 * quads, stop):
        i = U(k)
        s0 += a[i] * b[i]
    return (s0 + s1) + (s2 + s3)


@inner
def total(x, start, stop):
    """The sum of x[i], i in start..stop-1, in four interleaved partial sums."""
    s0 = s1 = s2 = s3 = 0.0
    quads = (stop - start) // 4
    for k in range(quads):
        i = U(start + 4 * k)
        s0 += x[i]
        s1 += x[i + U(1)]
        s2 += x[i + U(2)]
        s3 += x[i + U(3)]
    for k in range(start + 4 * quads, stop):
        s0 += x[U(k)]
    return (s0 + s1) + (s2 + s3)


@inner
def four_dots(v, a, b, c, d, start, stop):
    """The sums v[i]*a[i], .. v[i]*d[i], i in start..stop-1, side by side: none waits for another.

    Each in two partial sums, of every other number.
    """
    a0 = b0 = c0 = d0 = 0.0
    a1 = b1 = c1 = d1 = 0.0
    pairs = (stop - start) // 2
    for k in range(pairs):
        i = U(start + 2 * k)
        x, y = v[i], v[i + U(1)]
        a0 += x * a[i]
        b0 += x * b[i]
        c0 += x * c[i]
        d0 += x * d[i]
        a1 += y * a[i + U(1)]
        b1 += y * b[i + U(1)]
        c1 += y * c[i + U(1)]
        d1 += y * d[i + U(1)]
    for k in range(start + 2 * pairs, stop):
        i = U(k)
        a0 += v[i] * a[i]
        b0 += v[i] * b[i]
        c0 += v[i] * c[i]
        d0 += v[i] * d[i]
    return a0 + a1, b0 + b1, c0 + c1, d0 + d1


@inner
def subtract(y, s, x, start, stop):
    """Subtract a multiple: y[i] -= s*x[i], i in start..stop-1."""
    for k in range(start, stop):
        i = U(k)
        y[i] -= s * x[i]


@inner
def reflect(v, tau, columns, first, last, start, stop):
    """Householder's reflection of rows first .. last-1 of `columns` (n, m), four at a time."""
    fours = (last - first) // 4
    for four in range(fours):
        j = first + 4 * four
        a, b, c, d = columns[j], columns[j + 1], columns[j + 2], columns[j + 3]
        of_a, of_b, of_c, of_d = four_dots(v, a, b, c, d, start + 1, stop)
        shares = (of_a, of_b, of_c, of_d)
        for k in range(4):
            s = tau * (columns[j + k, start] + shares[k])
            columns[j + k, start] -= s
            subtract(columns[j + k], s, v, start + 1, stop)
    for j in range(first + 4 * fours, last):
        s = tau * (columns[j, start] + dot(v, columns[j], start + 1, stop))
        columns[j, start] -= s
        subtract(columns[j], s, v, start + 1, stop)


@inner
def turn(a, b, pivot, stop):
    """Rotate the rows a and b (>=stop,) in place so that b[pivot] becomes 0 (Givens; Golub & Van Loan, 5.1.8)."""
    size = math.sqrt(a[pivot] * a[pivot] + b[pivot] * b[pivot])
    if size == 0.0:
        return
    c, s = a[pivot] / size, b[pivot] / size
    for k in range(stop):
        i = U(k)
        x, y = a[i], b[i]
        a[i] = c * x + s * y
        b[i] = c * y - s * x


@inner
def scale_columns(at, norms):
    """Divide every column by its 2-norm, norms (n,) out; a zero column, or one that is not finite, keeps its values,
    norm 1."""
    n, m = at.shape
    for j in range(n):
        column = at[j]
        square = dot(column, column, 0, m)
        if LEAST_SQUARE < square < 1.0 / LEAST_SQUARE:
            norms[j] = math.sqrt(square)
            inverse = 1.0 / norms[j]
            for i in range(m):
                column[U(i)] *= inverse
            continue
        largest, norms[j] = 0.0, 1.0
        for i in range(m):
            largest = max(largest, abs(column[U(i)]))
        if 0.0 < largest < np.inf:
            for i in range(m):
                column[U(i)] /= largest
            norm = math.sqrt(dot(column, column, 0, m))
            for i in range(m):
                column[U(i)] /= norm
            norms[j] = largest * norm


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
        tau[best] = tau[k]
        order[k], order[best] = order[best], order[k]
        if best != k:
            a, b = at[k], at[best]
            for i in range(m):
                a[i], b[i] = b[i], a[i]
        v = at[k]
        norm = math.sqrt(dot(v, v, k, m))
        if k == 0:
            first = norm
        if not norm > tolerance * first:  # nor is infinity more than a share of infinity
            break
        beta = -math.copysign(norm, v[k])
        tau[k] = (beta - v[k]) / beta
        inverse = 1.0 / (v[k] - beta)
        for i in range(k + 1, m):
            v[U(i)] *= inverse
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
def measure(mean, covariance, row, first, n, z, column):
    """Update a Kalman filter of n states with one scalar measurement z = row . state + unit noise; return (innovation,
    its variance).

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
    """Add k rows of data to a square-root information matrix R: write the triangle of [R; rows], by Householder
    reflections.

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
