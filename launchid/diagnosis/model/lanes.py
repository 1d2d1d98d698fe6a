"""The likelihood of a log under eight sets of noise levels at once.

Levels are sought by differences, which asks for the same filter again and again with other variances and nothing else
different.  Here eight of them run side by side, each in its lane: an instruction that adds one number adds eight, so
eight cost less than eight times `likelihood.likelihood`, whose numbers, operation by operation, these are.

A compiler makes such instructions only where it knows that no row is written before all of it is read, so every
operation on a row of arrays (rows, LANES) reads all lanes first.
"""

import math

import numpy as np

from sim.vehicle.kernels import inner, kernel

from .likelihood import LOG_TWO_PI, N_CHANNELS

LANES = 8


@inner
def add_scaled(to, i, number, of, j):
    """Add a multiple: to[i] += number * of[j]."""
    a, b = to[i], of[j]
    (a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7]) = (
        a[0] + number * b[0], a[1] + number * b[1], a[2] + number * b[2], a[3] + number * b[3],
        a[4] + number * b[4], a[5] + number * b[5], a[6] + number * b[6], a[7] + number * b[7])


@inner
def subtract_product(to, i, first, j, second, k):
    """Subtract a product: to[i] -= first[j] * second[k]."""
    a, b, c = to[i], first[j], second[k]
    (a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7]) = (
        a[0] - b[0] * c[0], a[1] - b[1] * c[1], a[2] - b[2] * c[2], a[3] - b[3] * c[3],
        a[4] - b[4] * c[4], a[5] - b[5] * c[5], a[6] - b[6] * c[6], a[7] - b[7] * c[7])


@inner
def add_product(to, i, first, j, second, k):
    """Add a product: to[i] += first[j] * second[k]."""
    a, b, c = to[i], first[j], second[k]
    (a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7]) = (
        a[0] + b[0] * c[0], a[1] + b[1] * c[1], a[2] + b[2] * c[2], a[3] + b[3] * c[3],
        a[4] + b[4] * c[4], a[5] + b[5] * c[5], a[6] + b[6] * c[6], a[7] + b[7] * c[7])


@inner
def multiply(to, i, by, j):
    """Multiply: to[i] *= by[j]."""
    a, b = to[i], by[j]
    (a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7]) = (
        a[0] * b[0], a[1] * b[1], a[2] * b[2], a[3] * b[3],
        a[4] * b[4], a[5] * b[5], a[6] * b[6], a[7] * b[7])


@inner
def copy(to, i, of, j):
    """Copy: to[i] = of[j]."""
    a, b = to[i], of[j]
    (a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7]) = (
        b[0], b[1], b[2], b[3],
        b[4], b[5], b[6], b[7])


@inner
def fill(to, i, number):
    """Fill: to[i] = number."""
    a = to[i]
    for lane in range(LANES):
        a[lane] = number


@kernel
def likelihoods(f, block, q, c, r, p, resets, reset_variances, base, base_gains, counts, totals):
    """Log-likelihoods of a log under LANES sets of variances, from the innovations of a filter with other gains.

    f, block, c, resets, base, base_gains, counts   in   as `likelihood`
    q (b m^2, LANES), r (3, LANES), reset_variances (s, LANES)   in   the variances
    p (m^2, LANES)     inout  covariances before the first row, of which the lower half is used; scratch afterwards
    totals (1, LANES)  out
    """
    n, m = len(base), f.shape[1]
    d, new_d, fp = np.zeros((m, LANES)), np.zeros((m, LANES)), np.zeros((m * m, LANES))
    y, w = np.zeros((N_CHANNELS * m, LANES)), np.zeros((N_CHANNELS, LANES))
    factor, spare = np.zeros((N_CHANNELS * N_CHANNELS, LANES)), np.zeros((3, LANES))
    fill(totals, 0, 0.0)
    for k in range(n):
        if resets[k]:
            for a in range(len(reset_variances)):
                begin_anew(4 + a, a, m, reset_variances, p, d)
        measured = 0
        fill(spare, 0, 1.0)  # the determinant's root
        for a in range(N_CHANNELS):
            if not math.isnan(base[k, a]):
                measure(a, k, m, base, c, d, p, r, y, w, factor, spare)
                measured += 1
        if counts[k]:
            for lane in range(LANES):
                totals[0, lane] -= math.log(spare[0, lane]) + 0.5 * measured * LOG_TWO_PI
            for a in range(N_CHANNELS):
                if not math.isnan(base[k, a]):
                    for lane in range(LANES):
                        totals[0, lane] -= 0.5 * w[a, lane] * w[a, lane]
        correct(k, m, base, base_gains, y, w, d, spare)
        if k + 1 < n:
            propagate(block[k], m, f, q, d, new_d, p, fp)


@inner
def begin_anew(state, a, m, variances, p, d):
    """A held noise is drawn anew."""
    for j in range(m):
        fill(p, max(state, j) * m + min(state, j), 0.0)
    copy(p, state * m + state, variances, a)
    fill(d, state, 0.0)


@inner
def project(a, k, m, base, c, d, p, r, y, factor, spare):
    """Channel a of row k before its root is known: rows a of y = C P, of the factor, the innovation (spare[1]) and its
    variance (spare[2])."""
    for j in range(m):
        fill(y, a * m + j, 0.0)
    for b in range(a):
        fill(factor, a * N_CHANNELS + b, 0.0)
    fill(spare, 1, base[k, a])
    copy(spare, 2, r, a)
    for i in range(m):
        if c[a, i] != 0.0:
            add_scaled(spare, 1, -c[a, i], d, i)
            for j in range(m):
                add_scaled(y, a * m + j, c[a, i], p, max(i, j) * m + min(i, j))
            for b in range(a):
                if not math.isnan(base[k, b]):
                    add_scaled(factor, a * N_CHANNELS + b, c[a, i], y, b * m + i)
    for i in range(m):
        if c[a, i] != 0.0:
            add_scaled(spare, 2, c[a, i], y, a * m + i)


@inner
def measure(a, k, m, base, c, d, p, r, y, w, factor, spare):
    """Take in channel a of row k; spare[0] is multiplied by the root of its innovation's variance."""
    project(a, k, m, base, c, d, p, r, y, factor, spare)
    for b in range(a):
        if not math.isnan(base[k, b]):
            subtract_product(spare, 1, factor, a * N_CHANNELS + b, w, b)
    for lane in range(LANES):
        root = math.sqrt(max(spare[2, lane], 1e-300))
        spare[0, lane] *= root
        w[a, lane] = spare[1, lane] / root
        spare[2, lane] = 1.0 / root
    for j in range(m):
        multiply(y, a * m + j, spare, 2)
    for i in range(m):
        for j in range(i + 1):
            subtract_product(p, i * m + j, y, a * m + i, y, a * m + j)


@inner
def correct(k, m, base, base_gains, y, w, d, spare):
    """d, the deviation from the base filter's state, after row k's measurements."""
    for a in range(N_CHANNELS):
        if not math.isnan(base[k, a]):
            fill(spare, 1, 0.0)
            add_scaled(spare, 1, -1.0, w, a)
            fill(spare, 2, base[k, a])
            for j in range(m):
                subtract_product(d, j, y, a * m + j, spare, 1)
            for j in range(base_gains.shape[1]):
                add_scaled(d, j, -base_gains[k, j, a], spare, 2)


@inner
def carry(at, m, f, d, new_d):
    """d <- F d, of block `at`."""
    for i in range(m):
        fill(new_d, i, 0.0)
        for x in range(m):
            if f[at, i, x] != 0.0:
                add_scaled(new_d, i, f[at, i, x], d, x)
    for i in range(m):
        copy(d, i, new_d, i)


@inner
def propagate(at, m, f, q, d, new_d, p, fp):
    """d <- F d, P <- F P F' + Q, of block `at`."""
    carry(at, m, f, d, new_d)
    for i in range(m):
        for j in range(m):
            fill(fp, i * m + j, 0.0)
        for x in range(m):
            if f[at, i, x] != 0.0:
                for j in range(m):
                    add_scaled(fp, i * m + j, f[at, i, x], p, max(x, j) * m + min(x, j))
    for i in range(m):
        for j in range(i + 1):
            copy(p, i * m + j, q, (at * m + i) * m + j)
            for x in range(m):
                if f[at, j, x] != 0.0:
                    add_scaled(p, i * m + j, f[at, j, x], fp, i * m + x)
