"""The step from a closed window's samples to rows: slopes, standardised variables, library columns and targets.

Throughout: rows (N_SERIES, m) and marks (N_MARKS, m) as named below.
"""

import numpy as np

from ..algebra.derivative import differentiate
from ..algebra.library import N_VARIABLES, TAU, library_column
from ..algebra.linsolve import EPS, U, total
from ..gate.ring import ATTACK, BETA, GAMMA, THETA, THETA_DDOT, THETA_DOT, T
from ..gate.window import EQUATIONS
from ..kernels import inner

ROWS_OF_DIFFERENCE = 4  # rows of a piece that has a third difference
STILL = 64.0 * EPS  # a variable that moves less than this of its size does not move
PAIR = 2  # a6 and k1, and their drifts tau*theta and tau*beta

# rows (N_SERIES, m) of a window's close: the ring's columns, and behind them
SLOPE_COLUMN = 7  # 3: derivatives of theta, theta_dot, beta
STATES = 10   # 4: theta, theta_dot, beta, tau
STANDARD = 14  # 4: the same, standardised
WEIGHT = 18   # 4: of the rows around a step in the integral over it
HALF_INTEGRAL = 22  # scratch of the integrals
ROW_ERROR = 23  # by how much the numerical derivative or integral of a row may be off
VALUE = 24    # a library column at every row
N_SERIES = 25
# marks (N_MARKS, m) int64: gap-free piece; 1 where the row may be used; rows kept
SEGMENT, USABLE, KEPT = range(3)
N_MARKS = 3


@inner
def is_active(plan, active, term):
    """Whether a term is in the equation: where nothing selects, all are."""
    return plan.sparse == 0 or active[term] == 1


@inner
def fill_rate(rows, marks, n):
    """Difference theta where theta_dot was not measured; rows[ROW_ERROR] holds what such a rate may be off, else 0."""
    missing = False
    for i in range(n):
        rows[ROW_ERROR, i] = 0.0
        missing = missing or np.isnan(rows[THETA_DOT, i])
    if missing:
        differentiate(rows[T], rows[THETA], n, marks[SEGMENT], rows[SLOPE_COLUMN], rows[ROW_ERROR])
        for i in range(n):
            if np.isnan(rows[THETA_DOT, i]):
                rows[THETA_DOT, i] = rows[SLOPE_COLUMN, i]
            else:
                rows[ROW_ERROR, i] = 0.0


@inner
def fill_attack(rows, n):
    """Turn the flight-path angle gamma of every row into the angle of attack theta - gamma, which a6 multiplies.

    Rows without gamma lie on the line between the known ones, before the first and after the last on its value; of a
    window without any the angle of attack is theta.
    """
    time, gamma = rows[T], rows[GAMMA]
    last = -1
    for i in range(n):
        if np.isnan(gamma[i]):
            continue
        for k in range(last + 1, i):
            share = (time[k] - time[last]) / (time[i] - time[last]) if last >= 0 else 1.0
            gamma[k] = gamma[i] if last < 0 else gamma[last] + share * (gamma[i] - gamma[last])
        last = i
    for k in range(last + 1, n):
        gamma[k] = gamma[last] if last >= 0 else 0.0
    for i in range(n):
        rows[ATTACK, i] = rows[THETA, i] - gamma[i]


@inner
def fill_slopes(rows, marks, n, measured):
    """Derivatives of theta, theta_dot and beta at every row; theta_ddot as measured if `measured` is 1.

    rows[ROW_ERROR] holds what the numerical derivative theta_ddot may be off at every row, 0 where it is measured.
    """
    for i in range(n):
        rows[SLOPE_COLUMN, i] = rows[THETA_DOT, i]
        rows[SLOPE_COLUMN + 1, i] = rows[THETA_DDOT, i]
    differentiate(rows[T], rows[BETA], n, marks[SEGMENT], rows[SLOPE_COLUMN + 2], rows[ROW_ERROR])
    if measured == 0:
        differentiate(rows[T], rows[THETA_DOT], n, marks[SEGMENT], rows[SLOPE_COLUMN + 1], rows[ROW_ERROR])
    else:
        for i in range(n):
            rows[ROW_ERROR, i] = 0.0


@inner
def standardise(work, rows, marks, centred, count, n, t_centre):
    """Variables of rows 0..n-1 (theta, the angle of attack where gamma is known, theta_dot, beta, tau), and the same
    standardised by mean and root mean square deviation over the kept rows (centre 0 where not `centred`)."""
    for i in range(n):
        rows[STATES, i] = rows[ATTACK, i]
        rows[STATES + 1, i] = rows[THETA_DOT, i]
        rows[STATES + 2, i] = rows[BETA, i]
        rows[STATES + TAU, i] = rows[T, i] - t_centre
    for v in range(N_VARIABLES):
        x, kept, centre = rows[STATES + v], marks[KEPT], 0.0
        square = largest = 0.0
        if centred[v] == 1:
            for r in range(count):
                centre += x[kept[r]]
            centre /= count
        for r in range(count):
            square += (x[kept[r]] - centre) * (x[kept[r]] - centre)
            largest = max(largest, abs(x[kept[r]]))
        scale = np.sqrt(square / count)
        if not scale > STILL * largest:
            scale = np.inf  # stands still: its standardised value is exactly 0, and the rank test sees it
        work.centre[v], work.scale[v] = centre, scale
        for i in range(n):
            rows[STANDARD + v, U(i)] = (x[U(i)] - centre) / scale


@inner
def pointwise_rows(codes, rows, marks, at, count, t_centre):
    """Library columns, derivatives, tau*theta and tau*beta at the kept rows.  at (q + EQUATIONS + PAIR, count)  out"""
    q = codes.shape[0]
    for v in range(N_VARIABLES):
        for r in range(count):  # in place: kept[r] >= r
            i = marks[KEPT, r]
            rows[STATES + v, r], rows[STANDARD + v, r] = rows[STATES + v, i], rows[STANDARD + v, i]
    for j in range(q):
        library_column(codes[j], rows[STANDARD:STANDARD + N_VARIABLES], rows[STATES + codes[j, 5]], count, at[j])
    for r in range(count):
        i = marks[KEPT, r]
        for e in range(EQUATIONS):
            at[q + e, r] = rows[SLOPE_COLUMN + e, i]
        tau = rows[T, i] - t_centre
        at[q + EQUATIONS, r], at[q + EQUATIONS + 1, r] = tau * rows[ATTACK, i], tau * rows[BETA, i]


@inner
def fill_weights(rows, marks, n):
    """Weights (4, n) of the four rows around every step in the integral over it, into the rows from WEIGHT on: column i
    is of the step that ends at row i, for the rows from i - 2 on.

    The mean of the parabolas through either neighbour (Gregory's rule; of equal steps h/24*(-1, 13, 13, -1)), one of
    them at the ends of a gap-free piece, none in a piece of two rows.  A step that begins a piece has no weight.
    """
    time, segment = rows[T], marks[SEGMENT]
    for i in range(n):
        for k in range(4):
            rows[WEIGHT + k, i] = 0.0
        if i == 0 or segment[i] != segment[i - 1]:
            continue
        step = time[i] - time[i - 1]
        before = i > 1 and segment[i - 2] == segment[i]
        after = i + 1 < n and segment[i + 1] == segment[i]
        sides = int(before) + int(after)
        rows[WEIGHT + 1, i] = 0.5 * step
        rows[WEIGHT + 2, i] = 0.5 * step
        if before:  # less step^3/6 of the divided difference over rows i - 2, i - 1, i
            share = step * step * step / (6.0 * sides)
            far, whole = time[i - 1] - time[i - 2], time[i] - time[i - 2]
            rows[WEIGHT, i] -= share / (far * whole)
            rows[WEIGHT + 1, i] += share / (far * step)
            rows[WEIGHT + 2, i] -= share / (step * whole)
        if after:   # the same over rows i - 1, i, i + 1
            share = step * step * step / (6.0 * sides)
            far, whole = time[i + 1] - time[i], time[i + 1] - time[i - 1]
            rows[WEIGHT + 1, i] -= share / (step * whole)
            rows[WEIGHT + 2, i] += share / (far * step)
            rows[WEIGHT + 3, i] -= share / (far * whole)


@inner
def integrate(rows, marks, n, x, total, held):
    """Running integral total (>=n,) of x (>=n,), from 0 at the first row of each gap-free piece: by `fill_weights`, or,
    of what is held, as it stays from each row to the next."""
    running = 0.0
    for i in range(n):
        if i == 0 or marks[SEGMENT, i] != marks[SEGMENT, i - 1]:
            running = 0.0
        elif held:
            running += (rows[T, i] - rows[T, i - 1]) * x[i - 1]
        else:
            before, after = max(i - 2, 0), min(i + 1, n - 1)
            running += rows[WEIGHT + 1, i] * x[i - 1] + rows[WEIGHT + 2, i] * x[i]
            if rows[WEIGHT, i] != 0.0:
                running += rows[WEIGHT, i] * x[before]
            if rows[WEIGHT + 3, i] != 0.0:
                running += rows[WEIGHT + 3, i] * x[after]
        total[i] = running


@inner
def is_held(code, held):
    """Whether a term of code (6,) is a power of beta alone, which is held if `held` is 1."""
    return held == 1 and code[0] == 0 and code[1] == 0 and code[2] > 0 and code[3] == 0 and code[4] == 0


@inner
def integral_rows(codes, rows, marks, at, n, count, t_centre, held):
    """Running integrals of the library columns, the states, and integrals of tau*theta and tau*beta at the kept rows.

    at (q + EQUATIONS + PAIR, count)  out;  held  1: beta stays from each row to the next
    """
    q = codes.shape[0]
    fill_weights(rows, marks, n)
    for j in range(q):
        library_column(codes[j], rows[STANDARD:STANDARD + N_VARIABLES], rows[STATES + codes[j, 5]], n, rows[VALUE])
        integrate(rows, marks, n, rows[VALUE], rows[HALF_INTEGRAL], is_held(codes[j], held))
        for r in range(count):
            at[j, r] = rows[HALF_INTEGRAL, marks[KEPT, r]]
    for r in range(count):
        i = marks[KEPT, r]
        at[q, r], at[q + 1, r], at[q + 2, r] = rows[THETA, i], rows[THETA_DOT, i], rows[BETA, i]
    for d in range(PAIR):
        for i in range(n):
            rows[VALUE, i] = (rows[T, i] - t_centre) * rows[ATTACK if d == 0 else BETA, i]
        integrate(rows, marks, n, rows[VALUE], rows[HALF_INTEGRAL], d == 1 and held == 1)
        for r in range(count):
            at[q + EQUATIONS + d, r] = rows[HALF_INTEGRAL, marks[KEPT, r]]


@inner
def integral_error(codes, work, rows, marks, n, xi, held):
    """Add to rows[ROW_ERROR] by how much the running integral of the solved acceleration may be off at every row.

    xi (q,) in  coefficients of the terms as they are
    The quadrature's next term with its sign, so that errors cancel here which cancel from step to step: 11/720 of a
    step's fourth difference, at the ends of a piece, where one parabola stands alone, 1/24 of its third.  0 in a piece
    of fewer than four rows.  What is held (1) is exact.
    """
    q, time, f, bend = codes.shape[0], rows[T], rows[VALUE], rows[HALF_INTEGRAL]
    f[:] = 0.0
    for j in range(q):  # the sum of the terms that are not held
        share = 0.0
        for k in range(q):
            share += xi[k] * work.tt[k, j]
        if share != 0.0 and not is_held(codes[j], held):
            library_column(codes[j], rows[STANDARD:STANDARD + N_VARIABLES], rows[STATES + codes[j, 5]], n, bend)
            for i in range(n):
                f[i] += share * bend[i]
    first = 0
    for end in range(1, n + 1):
        if end < n and marks[SEGMENT, end] == marks[SEGMENT, first]:
            continue
        if end - first >= ROWS_OF_DIFFERENCE:
            for i in range(first + 1, end - 1):
                bend[i] = f[i + 1] - 2.0 * f[i] + f[i - 1]
            running = 0.0
            for i in range(first + 1, end):
                step = time[i] - time[i - 1]
                if i == first + 1:
                    running += step / 24.0 * (bend[i + 1] - bend[i])
                elif i == end - 1:
                    running -= step / 24.0 * (bend[i - 1] - bend[i - 2])
                elif first + 2 < i < end - 2:
                    running += 11.0 / 1440.0 * step * (bend[i - 2] - bend[i - 1] - bend[i] + bend[i + 1])
                rows[ROW_ERROR, i] += running
        first = end


@inner
def centre_segments(columns, marks, count):
    """Subtract from each column its mean over every gap-free piece; returns the number of pieces."""
    pieces = 0
    first = 0
    for end in range(1, count + 1):
        if end < count and marks[SEGMENT, marks[KEPT, end]] == marks[SEGMENT, marks[KEPT, first]]:
            continue
        pieces += 1
        for j in range(columns.shape[0]):
            mean = total(columns[j], first, end) / (end - first)
            for r in range(first, end):
                columns[j, U(r)] -= mean
        first = end
    return pieces
