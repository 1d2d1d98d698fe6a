"""Loops along a column, four numbers at a time, each sum in its own fixed order: the same bits everywhere.

Indices are unsigned: numba asks a signed one whether it counts from the end, and compiles such a loop to one number at
a time.  Positions start .. stop-1 must lie inside the vectors, and start <= stop.
"""

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
def dot_by_place(a, b, start, stop):
    """The dot product as `dot` has it, but number i goes into partial sum i mod 4; without a whole four all go into the
    first."""
    s0 = 0.0
    s1 = 0.0
    s2 = 0.0
    s3 = 0.0
    begin = start + 3 - (start + 3) % 4
    if begin > stop:
        begin = start
    for k in range(start, begin):
        i = U(k)
        if k % 4 == 1:
            s1 += a[i] * b[i]
        elif k % 4 == 2:
            s2 += a[i] * b[i]
        else:
            s3 += a[i] * b[i]
    quads = (stop - begin) // 4 if begin % 4 == 0 else 0
    for k in range(quads):
        i = U(begin + 4 * k)
        s0 += a[i] * b[i]
        s1 += a[i + U(1)] * b[i + U(1)]
        s2 += a[i + U(2)] * b[i + U(2)]
        s3 += a[i + U(3)] * b[i + U(3)]
    for k in range(begin + 4 * quads, stop):
        i = U(k)
        s0 += a[i] * b[i]
    return (s0 + s1) + (s2 + s3)


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
    """Householder's reflection of rows first .. last-1 of `columns` (n, m)."""
    for j in range(first, last):
        column = columns[j]
        s = tau * (column[start] + dot_by_place(v, column, start + 1, stop))
        column[start] -= s
        subtract(column, s, v, start + 1, stop)


@inner
def reflect_sized(v, tau, columns, first, last, start, stop, squares):
    """Apply `reflect` and also give squares[j] (n,) out: the sum of the new c[i]*c[i], i in start+1..stop-1."""
    for j in range(first, last):
        column = columns[j]
        s = tau * (column[start] + dot_by_place(v, column, start + 1, stop))
        column[start] -= s
        subtract(column, s, v, start + 1, stop)
        squares[j] = dot_by_place(column, column, start + 1, stop)


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
