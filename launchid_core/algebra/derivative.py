"""Derivatives of sampled signals: true time stamps, never across a gap.

The slope of the five-point interpolating polynomial, central inside a segment, one-sided at its ends (fourth order;
fewer points in shorter segments; weights: Fornberg, Math. Comp. 51, 1988).  Limitation: a held command makes the
nozzle's acceleration jump once per controller period, and the rows beside a jump are only second-order accurate.
"""

from ..kernels import inner
from .linsolve import U

STENCIL = 5


@inner
def mark_segments(time, n, max_gap, segment):
    """Number the gap-free pieces of a window from 0 on, segment (>=n,) out; more than max_gap [s] between two rows of
    time (>=n,) is a gap.  Returns the number of gaps."""
    number = 0
    for i in range(n):
        if i > 0 and time[i] - time[i - 1] > max_gap:
            number += 1
        segment[i] = number
    return number


@inner
def newton_slope(time, x, first, points, at):
    """Slope at time[at] of the polynomial through `points` (2..4) rows from `first` on.

    Newton's divided differences, built in scalars so that nothing is allocated.
    """
    t0, t1 = time[first], time[first + 1]
    s = time[at]
    d01 = (x[first + 1] - x[first]) / (t1 - t0)
    slope = d01
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
            slope += c3 * (a0 * a1 + (a0 + a1) * (s - t2))
    return slope


@inner
def slopes_of_piece(time, x, first, end, slope, fifth):
    """Slopes at the rows first..end-1 of a gap-free piece of at least STENCIL rows, and what the fifth point adds.

    As `newton_slope`; from stencil to stencil the differences move on by a row, so that four are new instead of ten.
    """
    t0, t1, t2, t3, x3 = time[first], time[first + 1], time[first + 2], time[first + 3], x[first + 3]
    d01 = (x[first + 1] - x[first]) / (t1 - t0)
    d12 = (x[first + 2] - x[first + 1]) / (t2 - t1)
    d23 = (x3 - x[first + 2]) / (t3 - t2)
    d012 = (d12 - d01) / (t2 - t0)
    d123 = (d23 - d12) / (t3 - t1)
    d0123 = (d123 - d012) / (t3 - t0)
    for start in range(first, end - STENCIL + 1):
        t4, x4 = time[U(start + 4)], x[U(start + 4)]
        d34 = (x4 - x3) / (t4 - t3)
        d234 = (d34 - d23) / (t4 - t2)
        d1234 = (d234 - d123) / (t4 - t1)
        c4 = (d1234 - d0123) / (t4 - t0)
        low = first if start == first else start + STENCIL // 2
        high = end if start == end - STENCIL else start + STENCIL // 2 + 1
        for k in range(low, high):
            at = U(k)
            a0, a1, a2, a3 = time[at] - t0, time[at] - t1, time[at] - t2, time[at] - t3
            value = d01
            value += d012 * (a0 + a1)
            value += d0123 * (a0 * a1 + (a0 + a1) * a2)
            fifth[at] = c4 * ((a0 + a1) * a2 * a3 + a0 * a1 * (a2 + a3))
            slope[at] = value + fifth[at]
        t0, t1, t2, t3, x3 = t1, t2, t3, t4, x4
        d01, d12, d23 = d12, d23, d34
        d012, d123 = d123, d234
        d0123 = d1234


@inner
def differentiate(time, x, n, segment, slope, fifth):
    """Derivative of x (>=n,) [u] at every row of a window, segment (>=n,) being of `mark_segments`.

    slope (>=n,) [u/s] out  NaN in a segment of one row
    fifth (>=n,) [u/s] out  what the stencil's fifth point adds to the slope, an estimate of its error; 0 in a segment
                            of fewer rows
    """
    first = 0
    for end in range(1, n + 1):
        if end < n and segment[end] == segment[first]:
            continue
        points = end - first
        if points >= STENCIL:
            slopes_of_piece(time, x, first, end, slope, fifth)
        else:
            for i in range(first, end):
                slope[i] = newton_slope(time, x, first, points, i) if points > 1 else float("nan")
                fifth[i] = 0.0
        first = end
