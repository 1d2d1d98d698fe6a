"""The onset, to a row, of something that stays: the score of an onset at every row, in one pass backwards.

The pieces of `pulses` are half a second long.  In calm air that is near enough to start from; weather makes a slow
change likely and a sharp one telling, so that a tenth of a second beside the onset nothing of it is seen.

An onset at row k is a shock to one more state, which enters the vehicle from then on.  Its score s_k and information
v_k come from the adjoint of the filter's error equation (de Jong and Penzer, Diagnosing shocks in time series, J. Am.
Stat. Assoc. 93, 1998, eq. 8 to 11): the gain is s_k^2/(2 v_k), the size s_k/v_k.  The linear dynamics of the base carry
it; what the model could explain by its other numbers is not taken off.
"""

import numpy as np

from sim.vehicle.kernels import inner, kernel

from ..data.record import Record
from ..model.noise import dynamics, gains_in
from ..model.nuisance import Problem
from ..model.point import vehicle
from .fit import Fit
from .pulses import EARLIEST

N_CHANNELS = 3


@kernel
def onset_scores(f, block, entry, c, resets, held, counts, gains, low, whitened, push, score, information):
    """The scores of onsets, backwards over a filter's rows.

    f (b, m, m)           in   transition over a row, block[k] of it from row k on
    entry (b, m)          in   how an acceleration of 1 held over a row moves the state
    c (3, m)              in   what is measured
    resets (n,)           in   bool: before this row's measurement `held` states from 4 on are drawn anew
    counts (n,)           in   bool: rows whose innovations count (all correct the state)
    gains (n, m, 3), low (n, 3, 3), whitened (n, 3)   in   the filter and its whitened innovations
    push (n,)             in   acceleration over the row [rad/s^2 per unit of the size]
    score, information (n,)  out  of an onset at each row
    """
    n, m = len(whitened), f.shape[1]
    r, cross, big = np.zeros(m), np.zeros(m), np.zeros((m, m))   # adjoint of the state; its information with the size
    back, w, work, half = np.zeros((m, m)), np.zeros((N_CHANNELS, m)), np.zeros(m), np.zeros((m, m))
    s, v = 0.0, 0.0
    for k in range(n - 1, -1, -1):
        at = block[k]
        for i in range(m):
            work[i] = 0.0
            for j in range(m):
                work[i] += big[i, j] * push[k] * entry[at, j]
            s += push[k] * entry[at, i] * r[i]
            v += push[k] * entry[at, i] * (2.0 * cross[i] + work[i])
        for i in range(m):
            cross[i] += work[i]
        score[k], information[k] = s, v
        seen(k, c, low, counts[k], w)
        carried(k, at, f, c, gains, low, back)
        transposed_times(back, r, work)
        transposed_times(back, cross, work)
        for i in range(m):
            for p in range(N_CHANNELS):
                r[i] += w[p, i] * whitened[k, p]
        sandwiched(back, big, half)
        for i in range(m):
            for j in range(m):
                for p in range(N_CHANNELS):
                    big[i, j] += w[p, i] * w[p, j]
        if resets[k]:
            forget(held, r, cross, big)


@inner
def seen(k, c, low, counts, w):
    """w (3, m) out: L^-1 C of row k, 0 where not measured or not counted."""
    for p in range(N_CHANNELS):
        for j in range(w.shape[1]):
            w[p, j] = 0.0
            if counts and low[k, p, p] > 0.0:
                w[p, j] = c[p, j]
                for q in range(p):
                    w[p, j] -= low[k, p, q] * w[q, j]
                w[p, j] /= low[k, p, p]


@inner
def carried(k, at, f, c, gains, low, back):
    """back (m, m) out: F (1 - K C), how an error before row k's measurement stands before the next row's."""
    m = len(back)
    for i in range(m):
        for j in range(m):
            back[i, j] = f[at, i, j]
        for p in range(N_CHANNELS):
            if low[k, p, p] > 0.0:
                gain = 0.0
                for q in range(m):
                    gain += f[at, i, q] * gains[k, q, p]
                for j in range(m):
                    back[i, j] -= gain * c[p, j]


@inner
def transposed_times(matrix, vector, work):
    """vector inout: matrix' vector."""
    for j in range(len(vector)):
        work[j] = 0.0
        for i in range(len(vector)):
            work[j] += matrix[i, j] * vector[i]
    for j in range(len(vector)):
        vector[j] = work[j]


@inner
def sandwiched(matrix, big, half):
    """big inout: matrix' big matrix."""
    m = len(big)
    for i in range(m):
        for j in range(m):
            half[i, j] = 0.0
            for q in range(m):
                half[i, j] += big[i, q] * matrix[q, j]
    for i in range(m):
        for j in range(m):
            big[i, j] = 0.0
            for q in range(m):
                big[i, j] += matrix[q, i] * half[q, j]


@inner
def forget(held, r, cross, big):
    """Clear what is drawn anew at a row: it carries nothing over it."""
    for i in range(4, 4 + held):
        r[i], cross[i] = 0.0, 0.0
        for j in range(len(r)):
            big[i, j], big[j, i] = 0.0, 0.0


def scores(problem: Problem, of: Fit, push: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(score (n,), information (n,)) of an onset at each row under a fit's filter; push (n,) as in `onset_scores`."""
    record, filt, dyn = problem.record, problem.filter, dynamics(problem.record, of.point)
    counts = np.ones(record.rows, bool) if problem.mask is None else problem.mask
    score, information = np.zeros(record.rows), np.zeros(record.rows)
    held = 2 if record.held > 1 else 0
    onset_scores(dyn.f, dyn.block, np.ascontiguousarray(dyn.entry[:, :, 1]), dyn.c, dyn.resets, held, counts,
                 gains_in(dyn, filt, record), filt.low, of.whitened, push, score, information)
    return score, information


def sharpest(problem: Problem, of: Fit, is_loss: bool) -> list[float]:
    """[s] The row at which an onset would gain most, EARLIEST from the ends; [] where nothing tells any."""
    t = problem.record.t
    score, information = scores(problem, of, pushes(problem.record, of, is_loss))
    fair = (t > t[0] + EARLIEST) & (t < t[-1] - EARLIEST) & (information > 0.0)
    if not fair.any():
        return []
    gain = np.where(fair, 0.5 * score**2 / np.where(fair, information, 1.0), 0.0)
    return [float(t[int(np.argmax(gain))])]


def pushes(record: Record, base: Fit, is_loss: bool) -> np.ndarray:
    """(n,) [rad/s^2] over each row, of a loss of all k1 (`is_loss`) or of a moment of 1 rad/s^2."""
    if not is_loss:
        return np.ones(record.rows)
    half = np.minimum(2 * (record.first_step + record.at) + record.every, len(record.k1) - 1)
    return -vehicle(record, base.point).k1[half] * base.states[:, 2]
