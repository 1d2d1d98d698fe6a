"""The step from a closed window's samples to rows: slopes, standardised variables, library columns and targets.

`regression` says which formulation takes what, and goes on from there.  Throughout: rows (N_SERIES, m) and marks
(N_MARKS, m) as `plan` names them; phi (q, count) library columns, target (EQUATIONS, count).
"""

import numpy as np

from ..algebra.derivative import differentiate
from ..algebra.lanes import U, standard, total
from ..algebra.library import N_VARIABLES, TAU, library_column
from ..algebra.linsolve import EPS
from ..gate.ring import ATTACK, BETA, GAMMA, THETA, THETA_DDOT, THETA_DOT, T
from ..gate.window import EQUATIONS
from ..kernels import inner
from .plan import HALF_INTEGRAL, KEPT, ROW_ERROR, SEGMENT, SLOPE_COLUMN, STANDARD, STATES, VALUE, WEIGHT

ROWS_OF_DIFFERENCE = 4  # rows of a piece that has a third difference
STILL = 64.0 * EPS  # a variable that moves less than this of its size does not move


@inner
def fill_rate(rows, marks, n):
    """Difference theta where theta_dot was not measured; rows[ROW_ERROR] holds what such a rate may be off, else 0."""
    missing = False
    for i in range(n):
        missing = missing or np.isnan(rows[THETA_DOT, i])
    if missing:
        differentiate(rows[T], rows[THETA], n, marks[SEGMENT], rows[SLOPE_COLUMN], rows[ROW_ERROR])
        for i in range(n):
            if np.isnan(rows[THETA_DOT, i]):
                rows[THETA_DOT, i] = rows[SLOPE_COLUMN, i]
            else:
                rows[ROW_ERROR, i] = 0.0
    else:
        for i in range(n):
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
def sum_squares(work, rows, marks, count):
    """Squared deviations from the centres over the kept rows, into work.scale; sums side by side, as above."""
    theta = theta_dot = beta = tau = 0.0
    for r in range(count):
        i = marks[KEPT, r]
        x, y = rows[STATES, i] - work.centre[0], rows[STATES + 1, i] - work.centre[1]
        z, t = rows[STATES + 2, i] - work.centre[2], rows[STATES + TAU, i] - work.centre[TAU]
        theta += x * x
        theta_dot += y * y
        beta += z * z
        tau += t * t
    work.scale[0], work.scale[1], work.scale[2], work.scale[TAU] = theta, theta_dot, beta, tau


@inner
def largest_kept(x, kept, count):
    """Largest |x| of the kept rows."""
    largest = 0.0
    for r in range(count):
        largest = max(largest, abs(x[kept[r]]))
    return largest


@inner
def standardise(work, rows, marks, centred, count, n):
    """Standardised variables of rows 0..n-1, by mean and root mean square deviation over the kept rows (centre 0 where
    not `centred`)."""
    theta = theta_dot = beta = tau = 0.0  # side by side: a sum waits for none of the others
    for r in range(count):
        i = marks[KEPT, r]
        theta += rows[STATES, i]
        theta_dot += rows[STATES + 1, i]
        beta += rows[STATES + 2, i]
        tau += rows[STATES + TAU, i]
    work.centre[0], work.centre[1], work.centre[2], work.centre[TAU] = theta, theta_dot, beta, tau
    for v in range(N_VARIABLES):
        work.centre[v] = work.centre[v] / count if centred[v] == 1 else 0.0
    sum_squares(work, rows, marks, count)
    for v in range(N_VARIABLES):
        scale = np.sqrt(work.scale[v] / count)
        x = rows[STATES + v]
        if not scale > STILL * largest_kept(x, marks[KEPT], count):
            scale = np.inf  # stands still: its standardised value is exactly 0, and the rank test sees it
        work.scale[v] = scale
        standard(rows[STANDARD + v], x, work.centre[v], scale, 0, n)


@inner
def fill_states(rows, n, t_centre):
    """theta, theta_dot, beta, tau of every row; theta is the angle of attack where gamma is known."""
    for i in range(n):
        rows[STATES, i] = rows[ATTACK, i]
        rows[STATES + 1, i] = rows[THETA_DOT, i]
        rows[STATES + 2, i] = rows[BETA, i]
        rows[STATES + TAU, i] = rows[T, i] - t_centre


@inner
def pointwise_rows(codes, rows, marks, phi, target, count):
    """Library columns and derivative targets at the kept rows."""
    q = codes.shape[0]
    for v in range(N_VARIABLES):
        for r in range(count):  # in place: kept[r] >= r
            i = marks[KEPT, r]
            rows[STATES + v, r], rows[STANDARD + v, r] = rows[STATES + v, i], rows[STANDARD + v, i]
    for j in range(q):
        library_column(codes[j], rows[STANDARD:STANDARD + N_VARIABLES], rows[STATES + codes[j, 5]], count, phi[j])
    for e in range(EQUATIONS):
        for r in range(count):
            target[e, r] = rows[SLOPE_COLUMN + e, marks[KEPT, r]]


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
def integral_rows(codes, rows, marks, phi, target, n, count, held):
    """Running integrals of the library columns, and the states, at the kept rows; held  1: beta stays from each row to
    the next."""
    q = codes.shape[0]
    fill_weights(rows, marks, n)
    for j in range(q):
        library_column(codes[j], rows[STANDARD:STANDARD + N_VARIABLES], rows[STATES + codes[j, 5]], n, rows[VALUE])
        integrate(rows, marks, n, rows[VALUE], rows[HALF_INTEGRAL], is_held(codes[j], held))
        for r in range(count):
            phi[j, r] = rows[HALF_INTEGRAL, marks[KEPT, r]]
    for r in range(count):
        i = marks[KEPT, r]
        target[0, r] = rows[THETA, i]
        target[1, r] = rows[THETA_DOT, i]
        target[2, r] = rows[BETA, i]


@inner
def integral_error(codes, work, rows, marks, n, xi, held):
    """Add to rows[ROW_ERROR] by how much the running integral of the solved acceleration may be off at every row.

    xi (q,) in  coefficients of the terms as they are
    The quadrature's next term with its sign, so that errors cancel here which cancel from step to step: 11/720 of a
    step's fourth difference, at the ends of a piece, where one parabola stands alone, 1/24 of its third.  0 in a piece
    of fewer than four rows.  What is held (1) is exact.
    """
    time, f, bend = rows[T], rows[VALUE], rows[HALF_INTEGRAL]
    accelerations(codes, work, rows, n, xi, f, held)
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
def accelerations(codes, work, rows, n, xi, f, held):
    """The sum of the terms that are not held at every row, f (>=n,) out, for coefficients xi (q,) of them as they
    are."""
    q = codes.shape[0]
    for i in range(n):
        f[i] = 0.0
    for j in range(q):
        share = 0.0
        for k in range(q):
            share += xi[k] * work.tt[k, j]
        if share != 0.0 and not is_held(codes[j], held):
            library_column(codes[j], rows[STANDARD:STANDARD + N_VARIABLES], rows[STATES + codes[j, 5]], n,
                           rows[HALF_INTEGRAL])
            for i in range(n):
                f[i] += share * rows[HALF_INTEGRAL, i]


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
