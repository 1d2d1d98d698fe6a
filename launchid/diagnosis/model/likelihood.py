"""The likelihood of the same data at other noise levels, or with a generic disturbance beside them.

A linear Kalman filter on top of the innovations of `predictor.follow`, which need not be run again.  The channels of a
row are taken one after the other, which is the Cholesky factor of their covariance written out (Bierman, Factorization
Methods for Discrete Sequential Estimation, 1977, ch. 5).

Assumption: deviations between two filters are small, so the rigid body's linear dynamics carry them.
"""

import math

import numpy as np

from sim.vehicle.kernels import inner, kernel

N_CHANNELS = 3
LOG_TWO_PI = math.log(2.0 * math.pi)


@kernel
def likelihood(f, block, q, c, r, p, resets, reset_variances, base, base_gains, counts, gains, low, whitened):
    """Log-likelihood of a log under noise levels, from the innovations of a filter with other gains.

    f (b, m, m)           in     transition over a row, block[k] of it from row k to k + 1
    q (b, m, m)           in     process noise over a row
    c (3, m)              in     what is measured
    r (3,)                in     variances of the sensors
    p (m, m)              inout  covariance before the first row; scratch afterwards
    resets (n,)           in     bool: at this row the states from 4 to 4 + len(reset_variances) are drawn anew
    reset_variances (s,)  in     their variances
    base (n, 3)           in     innovations under the gains base_gains (n, 6, 3); NaN: not measured
    counts (n,)           in     bool: rows whose measurements count in the likelihood (all correct the state)
    gains (n, m, 3), low (n, 3, 3)   out   Kalman gains, lower factor of the innovations' covariance; 0 where not
                                           measured.  Without rows, neither they nor `whitened` are written
    whitened (n, 3)       out    innovations of this filter times the factor's inverse, 0 where not measured
    """
    n, m, written = len(base), f.shape[1], len(gains) > 0
    d, new_d, fp = np.zeros(m), np.zeros(m), np.zeros((m, m))
    y, w, factor = np.zeros((N_CHANNELS, m)), np.zeros(N_CHANNELS), np.zeros((N_CHANNELS, N_CHANNELS))
    total = 0.0
    for k in range(n):
        if resets[k]:
            reset(p, d, reset_variances)
        measured, determinant = 0, 1.0
        for a in range(N_CHANNELS):
            if measure(a, base[k, a], c, d, p, r, y, w, factor):
                measured += 1
                determinant *= factor[a, a]
        if counts[k]:
            total -= math.log(determinant) + 0.5 * measured * LOG_TWO_PI
            for a in range(N_CHANNELS):
                total -= 0.5 * w[a] * w[a]
        correct(k, base, base_gains, y, w, d)
        if written:
            whitened[k, :], low[k, :, :] = w, factor
            back_substitute(k, factor, y, gains)
        if k + 1 < n:
            propagate(block[k], f, q, d, new_d, p, fp)
    return total


@inner
def reset(p, d, variances):
    """Held noises are drawn anew."""
    for a in range(len(variances)):
        p[4 + a, :] = 0.0
        p[:, 4 + a] = 0.0
        p[4 + a, 4 + a] = variances[a]
        d[4 + a] = 0.0


@inner
def measure(a, base, c, d, p, r, y, w, factor):
    """Take in channel a of a row: rows a of y = L^-1 C P, of w = L^-1 e and of L, and P after it.  False (and 0) where
    it was not measured; d stays as before the row."""
    m = len(d)
    w[a] = 0.0
    for b in range(N_CHANNELS):
        factor[a, b] = 0.0
    for j in range(m):
        y[a, j] = 0.0
    if math.isnan(base):
        return False
    value, variance = base, r[a]
    for i in range(m):
        if c[a, i] != 0.0:
            value -= c[a, i] * d[i]
            for j in range(m):
                y[a, j] += c[a, i] * p[i, j]
            for b in range(a):
                factor[a, b] += c[a, i] * y[b, i]
    for i in range(m):
        if c[a, i] != 0.0:
            variance += c[a, i] * y[a, i]
    for b in range(a):
        value -= factor[a, b] * w[b]
    factor[a, a] = math.sqrt(max(variance, 1e-300))
    w[a] = value / factor[a, a]
    take_in(a, 1.0 / factor[a, a], y, p)
    return True


@inner
def take_in(a, scale, y, p):
    """y[a] times `scale`, and P less its square."""
    m = y.shape[1]
    for j in range(m):
        y[a, j] *= scale
    for i in range(m):
        for j in range(m):
            p[i, j] -= y[a, i] * y[a, j]


@inner
def correct(k, base, base_gains, y, w, d):
    """d, the deviation from the base filter's state, after row k's measurements."""
    for a in range(N_CHANNELS):
        if not math.isnan(base[k, a]):
            for j in range(y.shape[1]):
                d[j] += y[a, j] * w[a]
            for j in range(base_gains.shape[1]):
                d[j] -= base_gains[k, j, a] * base[k, a]


@inner
def back_substitute(k, factor, y, gains):
    """gains[k] (m, 3) = y' L^-1: the Kalman gains; 0 for channels not measured."""
    for j in range(y.shape[1]):
        for a in range(N_CHANNELS - 1, -1, -1):
            gains[k, j, a] = 0.0
            if factor[a, a] > 0.0:
                value = y[a, j]
                for b in range(a + 1, N_CHANNELS):
                    value -= factor[b, a] * gains[k, j, b]
                gains[k, j, a] = value / factor[a, a]


@inner
def propagate(at, f, q, d, new_d, p, fp):
    """d <- F d, P <- F P F' + Q, of block `at`."""
    m = len(d)
    for i in range(m):
        new_d[i] = 0.0
        for j in range(m):
            fp[i, j] = 0.0
        for k in range(m):
            if f[at, i, k] != 0.0:
                new_d[i] += f[at, i, k] * d[k]
                for j in range(m):
                    fp[i, j] += f[at, i, k] * p[k, j]
    for i in range(m):
        d[i] = new_d[i]
        for j in range(i + 1):
            value = q[at, i, j]
            for k in range(m):
                value += fp[i, k] * f[at, j, k]
            p[i, j] = value
            p[j, i] = value


@kernel
def whiten(low, innovations, whitened):
    """whitened (n, 3) out = low^-1 innovations, 0 where not measured."""
    for k in range(len(innovations)):
        for a in range(N_CHANNELS):
            whitened[k, a] = 0.0
            if math.isnan(innovations[k, a]):
                continue
            value = innovations[k, a]
            for b in range(a):
                value -= low[k, a, b] * whitened[k, b]
            whitened[k, a] = value / low[k, a, a]
