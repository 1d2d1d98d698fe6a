"""Derivatives of sampled signals: true time stamps, never across a gap.

Scheme: the slope of the five-point interpolating polynomial, central inside a
segment, one-sided at its ends (fourth order; fewer points in shorter segments).
Source: Fornberg, Math. Comp. 51, 1988 (the weights of arbitrarily spaced points).

Limitation: a held command makes the nozzle's acceleration jump once per
controller period, and the rows beside a jump are only second-order accurate.
Stencils chosen to avoid the jumps (essentially non-oscillatory) were tried: no
more supports found on clean data, and up to twice the error under noise.
"""

from .kernels import inner, once

STENCIL = 5


@once
def mark_segments(time, n, max_gap, segment):
    """Number the gap-free pieces of a window.

    time    (>=n,) [s] in
    max_gap        [s] more than this between two rows is a gap
    segment (>=n,)     out int64, 0 from the first row on
    Returns the number of gaps.
    """
    number = 0
    for i in range(n):
        if i > 0 and time[i] - time[i - 1] > max_gap:
            number += 1
        segment[i] = number
    return number


@once
def newton_slope(time, x, first, points, at):
    """Slope at time[at] of the polynomial through `points` (2..5) rows from `first` on.

    Newton's divided differences, built in five scalars so that nothing is allocated.
    """
    c0, c1, c2, c3, c4 = x[first], 0.0, 0.0, 0.0, 0.0
    t0, t1 = time[first], time[first + 1]
    s = time[at]
    d01 = (x[first + 1] - c0) / (t1 - t0)
    c1 = d01
    slope = c1
    if points > 2:
        t2 = time[first + 2]
        d12 = (x[first + 2] - x[first + 1]) / (t2 - t1)
        c2 = (d12 - d01) / (t2 - t0)
        a0, a1 = s - t0, s - t1
        slope += c2 * (a0 + a1)
        if points > 3:
            t3 = time[first + 3]
            d23 = (x[first + 3] - x[first + 2]) / (t3 - t2)
            d123 = (d23 - d12) / (t3 - t1)
            c3 = (d123 - c2) / (t3 - t0)
            a2 = s - t2
            slope += c3 * (a0 * a1 + (a0 + a1) * a2)
            if points > 4:
                t4 = time[first + 4]
                d34 = (x[first + 4] - x[first + 3]) / (t4 - t3)
                d234 = (d34 - d23) / (t4 - t2)
                c4 = ((d234 - d123) / (t4 - t1) - c3) / (t4 - t0)
                a3 = s - t3
                slope += c4 * ((a0 + a1) * a2 * a3 + a0 * a1 * (a2 + a3))
    return slope


@inner
def differentiate(time, x, n, segment, slope):
    """Derivative of x at every row of a window.

    time    (>=n,) [s]   in   increasing
    x       (>=n,) [u]   in
    segment (>=n,)       in   int64 from `mark_segments`
    slope   (>=n,) [u/s] out  NaN in a segment of one row
    """
    first = 0
    for end in range(1, n + 1):
        if end < n and segment[end] == segment[first]:
            continue
        points = min(STENCIL, end - first)
        for i in range(first, end):
            start = min(max(i - points // 2, first), end - points)
            slope[i] = newton_slope(time, x, start, points, i) if points > 1 else float("nan")
        first = end
