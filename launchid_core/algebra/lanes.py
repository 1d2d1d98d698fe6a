"""Loops along a column, four numbers at a time, each sum in its own fixed order: the same bits everywhere.

Indices are unsigned: numba asks a signed one whether it counts from the end, and compiles such a loop to one number at
a time.  Positions start .. stop-1 must lie inside the vectors, and start <= stop.
"""

import math

import numpy as np

from ..kernels import inner

U = np.uint64


@inner
def dot(a, b, start, stop):
    """sum a[i]*b[i], i in start..stop-1, in four interleaved partial sums (fixed order: same bits everywhere)."""
    s0 = 0.0
    s1 = 0.0
    s2 = 0.0
    s3 = 0.0
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
def multiply(y, x, start, stop):
    """Multiply: y[i] *= x[i], i in start..stop-1."""
    for k in range(start, stop):
        i = U(k)
        y[i] *= x[i]


@inner
def scale(y, by, start, stop):
    """Multiply by a number: y[i] *= by, i in start..stop-1."""
    for k in range(start, stop):
        y[U(k)] *= by


@inner
def divide(y, by, start, stop):
    """Divide by a number: y[i] /= by, i in start..stop-1."""
    for k in range(start, stop):
        y[U(k)] /= by


@inner
def standard(y, x, centre, scale, start, stop):
    """Standardise: y[i] = (x[i] - centre)/scale, i in start..stop-1."""
    for k in range(start, stop):
        i = U(k)
        y[i] = (x[i] - centre) / scale


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
def add_squares(y, x, start, stop):
    """Add squares: y[i] += x[i]*x[i], i in start..stop-1."""
    for k in range(start, stop):
        i = U(k)
        y[i] += x[i] * x[i]


@inner
def turn(a, b, pivot, stop):
    """Givens rotation of the rows a and b (>=stop,) after which b[pivot] is 0 (Golub & Van Loan, 5.1.8)."""
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
def weigh(y, x, s, start, stop):
    """Weigh: y[i] *= x[i] - s*y[i], i in start..stop-1."""
    for k in range(start, stop):
        i = U(k)
        y[i] *= x[i] - s * y[i]


@inner
def largest_size(x, start, stop):
    """Largest |x[i]|, which a NaN is not; 0 of none."""
    largest = 0.0
    for k in range(start, stop):
        largest = max(largest, abs(x[U(k)]))
    return largest
