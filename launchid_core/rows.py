"""From a closed window's samples to rows: slopes, standardised variables, library columns and targets.

`regression` says which formulation takes what, and goes on from there.
"""

import numpy as np

from .derivative import differentiate
from .kernels import inner, once
from .lanes import largest_size, standard
from .library import N_VARIABLES, TAU, library_column
from .linsolve import EPS
from .ring import BETA, THETA, THETA_DDOT, THETA_DOT, T
from .window import EQUATIONS

STILL = 64.0 * EPS  # a variable that moves less than this of its size does not move


@once
def fill_rate(work, n):
    """Difference theta where theta_dot was not measured."""
    missing = False
    for i in range(n):
        missing = missing or np.isnan(work.signal[THETA_DOT, i])
    if missing:
        differentiate(work.signal[T], work.signal[THETA], n, work.segment, work.slope[0])
        for i in range(n):
            if np.isnan(work.signal[THETA_DOT, i]):
                work.signal[THETA_DOT, i] = work.slope[0, i]


@once
def fill_slopes(work, n, measured):
    """Derivatives of theta, theta_dot and beta at every row; theta_ddot as measured if `measured` is 1."""
    for i in range(n):
        work.slope[0, i] = work.signal[THETA_DOT, i]
        work.slope[1, i] = work.signal[THETA_DDOT, i]
    if measured == 0:
        differentiate(work.signal[T], work.signal[THETA_DOT], n, work.segment, work.slope[1])
    differentiate(work.signal[T], work.signal[BETA], n, work.segment, work.slope[2])


@once
def sum_squares(work, count):
    """Squared deviations from the centres over the kept rows, into work.scale; sums side by side, as above."""
    theta = theta_dot = beta = tau = 0.0
    for r in range(count):
        i = work.kept[r]
        x, y = work.raw[0, i] - work.centre[0], work.raw[1, i] - work.centre[1]
        z, t = work.raw[2, i] - work.centre[2], work.raw[TAU, i] - work.centre[TAU]
        theta += x * x
        theta_dot += y * y
        beta += z * z
        tau += t * t
    work.scale[0], work.scale[1], work.scale[2], work.scale[TAU] = theta, theta_dot, beta, tau


@once
def largest_kept(x, kept, count):
    """Largest |x| of the kept rows."""
    largest = 0.0
    for r in range(count):
        largest = max(largest, abs(x[kept[r]]))
    return largest


@inner
def standardise(work, centred, count, n):
    """Standardised variables of rows 0..n-1, by mean and root mean square deviation over the kept rows (centre 0 where
    not `centred`)."""
    theta = theta_dot = beta = tau = 0.0  # side by side: a sum waits for none of the others
    for r in range(count):
        i = work.kept[r]
        theta += work.raw[0, i]
        theta_dot += work.raw[1, i]
        beta += work.raw[2, i]
        tau += work.raw[TAU, i]
    work.centre[0], work.centre[1], work.centre[2], work.centre[TAU] = theta, theta_dot, beta, tau
    for v in range(N_VARIABLES):
        work.centre[v] = work.centre[v] / count if centred[v] == 1 else 0.0
    sum_squares(work, count)
    for v in range(N_VARIABLES):
        scale = np.sqrt(work.scale[v] / count)
        largest = largest_size(work.raw[v], 0, n) if count == n else largest_kept(work.raw[v], work.kept, count)
        if not scale > STILL * largest:
            scale = np.inf  # stands still: its standardised value is exactly 0, and the rank test sees it
        work.scale[v] = scale
        standard(work.z[v], work.raw[v], work.centre[v], scale, 0, n)


@inner
def fill_states(work, n, t_centre):
    """theta, theta_dot, beta, tau of every row."""
    for i in range(n):
        work.raw[0, i] = work.signal[THETA, i]
        work.raw[1, i] = work.signal[THETA_DOT, i]
        work.raw[2, i] = work.signal[BETA, i]
        work.raw[TAU, i] = work.signal[T, i] - t_centre


@once
def pointwise_rows(codes, work, count):
    """Library columns and derivative targets at the kept rows."""
    q = codes.shape[0]
    phi = work.phi[:q * count].reshape((q, count))
    target = work.target[:EQUATIONS * count].reshape((EQUATIONS, count))
    for v in range(N_VARIABLES):
        for r in range(count):  # in place: kept[r] >= r
            work.raw[v, r], work.z[v, r] = work.raw[v, work.kept[r]], work.z[v, work.kept[r]]
    for j in range(q):
        library_column(codes[j], work.z, work.raw[codes[j, 5]], count, phi[j])
    for e in range(EQUATIONS):
        for r in range(count):
            target[e, r] = work.slope[e, work.kept[r]]


@once
def integral_rows(codes, work, n, count):
    """Running integrals (trapezoid) of the library columns, and the states, at the kept rows."""
    q = codes.shape[0]
    phi = work.phi[:q * count].reshape((q, count))
    target = work.target[:EQUATIONS * count].reshape((EQUATIONS, count))
    for i in range(1, n):
        work.half[i] = 0.5 * (work.signal[T, i] - work.signal[T, i - 1])
    for j in range(q):
        library_column(codes[j], work.z, work.raw[codes[j, 5]], n, work.value)
        running = before = 0.0
        r = 0
        for i in range(n):
            now = work.value[i]
            if i == 0 or work.segment[i] != work.segment[i - 1]:
                running = 0.0
            else:
                running += work.half[i] * (before + now)
            before = now
            if r < count and work.kept[r] == i:
                phi[j, r] = running
                r += 1
    for r in range(count):
        i = work.kept[r]
        target[0, r] = work.signal[THETA, i]
        target[1, r] = work.signal[THETA_DOT, i]
        target[2, r] = work.signal[BETA, i]


@inner
def centre_segments(columns, work, count):
    """Subtract from each column its mean over every gap-free piece; returns the number of pieces."""
    pieces = 0
    first = 0
    for end in range(1, count + 1):
        if end < count and work.segment[work.kept[end]] == work.segment[work.kept[first]]:
            continue
        pieces += 1
        for j in range(columns.shape[0]):
            mean = 0.0
            for r in range(first, end):
                mean += columns[j, r]
            mean /= end - first
            for r in range(first, end):
                columns[j, r] -= mean
        first = end
    return pieces
