"""The weight of changes of a filter's innovations under other noise levels: the squares of what filters with these
levels make of them, whitened.

As far as covariances go all changes are alike, so gains and whitening are made once per set of levels; a change is then
carried through all sets side by side, each in its lane (`lanes`).  The same as twice what it takes from
`likelihood.likelihood`, in exact arithmetic.
"""

import math

import numpy as np

from sim.vehicle.kernels import inner, kernel

from .lanes import LANES, add_product, add_scaled, carry, copy, fill, multiply, subtract_product
from .likelihood import N_CHANNELS
from .noise import Refilter


class Weighing:
    """Filters of so many sets of levels (k, 5 + the world's), from the innovations of one (`Refilter`)."""

    def __init__(self, of: Refilter, levels: np.ndarray) -> None:
        self.of, self.sets = of, len(levels)
        n, m = of.record.rows, of.dyn.f.shape[1]
        batches = -(-self.sets // LANES)
        self.gains = np.zeros((batches, n * N_CHANNELS * m, LANES))
        self.lows = np.zeros((batches, n * N_CHANNELS * N_CHANNELS, LANES))
        for k, own in enumerate(levels):
            gains, low = of.gains(own)
            self.gains[k // LANES, :, k % LANES] = gains.transpose(0, 2, 1).ravel()
            diagonal = np.einsum("kaa->ka", low)
            diagonal[diagonal > 0.0] = 1.0 / diagonal[diagonal > 0.0]
            self.lows[k // LANES, :, k % LANES] = low.ravel()

    def energies(self, change: np.ndarray) -> np.ndarray:
        """(k,) sums of squares, of a change (n, 3) of the innovations, NaN where not measured."""
        of, totals = self.of, np.zeros((len(self.gains), LANES))
        held = 2 if of.record.held > 1 else 0
        for k in range(len(totals)):
            energies(of.dyn.f, of.dyn.block, of.dyn.c, self.gains[k], self.lows[k], of.dyn.resets, held, change,
                     of.base_gains, totals[k:k + 1])
        return totals.ravel()[:self.sets]


@kernel
def energies(f, block, c, gains, lows, resets, held, change, base_gains, totals):
    """Sums of squares of a change under LANES filters.

    f, block, c, resets, base_gains   in   as `likelihood`;  held  states from 4 on that are drawn anew at a reset
    gains (3 n m, LANES)   in   of each row and channel, to the states
    lows (9 n, LANES)      in   of each row, the innovations' lower factor; of its diagonal the inverse
    change (n, 3)          in   NaN: not measured
    totals (1, LANES)      out
    """
    n, m = len(change), f.shape[1]
    d, new_d, e = np.zeros((m, LANES)), np.zeros((m, LANES)), np.zeros((N_CHANNELS, LANES))
    w, spare = np.zeros((N_CHANNELS, LANES)), np.zeros((1, LANES))
    fill(totals, 0, 0.0)
    for k in range(n):
        if resets[k]:
            for a in range(held):
                fill(d, 4 + a, 0.0)
        for a in range(N_CHANNELS):
            if not math.isnan(change[k, a]):
                fill(e, a, change[k, a])
                for i in range(m):
                    if c[a, i] != 0.0:
                        add_scaled(e, a, -c[a, i], d, i)
                whiten(a, k, lows, change, e, w)
                add_product(totals, 0, w, a, w, a)
        correct(k, m, change, gains, base_gains, e, d, spare)
        if k + 1 < n:
            carry(block[k], m, f, d, new_d)


@inner
def whiten(a, k, lows, change, e, w):
    """w[a] of row k."""
    copy(w, a, e, a)
    for b in range(a):
        if not math.isnan(change[k, b]):
            subtract_product(w, a, lows, (k * N_CHANNELS + a) * N_CHANNELS + b, w, b)
    multiply(w, a, lows, (k * N_CHANNELS + a) * N_CHANNELS + a)


@inner
def correct(k, m, change, gains, base_gains, e, d, spare):
    """d, the deviation from the base filter's state, after row k's measurements."""
    for a in range(N_CHANNELS):
        if not math.isnan(change[k, a]):
            for j in range(m):
                add_product(d, j, gains, (k * N_CHANNELS + a) * m + j, e, a)
            fill(spare, 0, change[k, a])
            for j in range(base_gains.shape[1]):
                add_scaled(d, j, -base_gains[k, j, a], spare, 0)
