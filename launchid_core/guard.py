"""Has memory changed behind the estimator's back?  Seals over everything that steers it or is carried on.

A seal is the exclusive or of all words of what it guards, so any one word that changed by itself is seen, whichever
bits of it did (radiation, a stray write).  Three of them:

* CONTROL, over clock and window counts, looked at and renewed with every sample;
* one for each row of the ring, looked at when the row is used;
* CARRIED, over everything else that persists (filter, information, tracker, detectors, structure, range, generator of
  rows), looked at before a block or a window uses it and renewed afterwards.

Not guarded: the counters of answers, and the last outcome, which the next window overwrites.

What is not as it was left is not used: the kernel answers RECOVERED and the caller begins anew.  So does it where what
is carried is no longer sound: not finite, or absurd (`is_sound`).
"""

import struct
from collections.abc import Iterable
from typing import Any

import numpy as np
from numba import extending
from numba.core import types

from . import ring as rb
from .kernels import inner, once
from .tracker import COV, MEAN_A6, MEAN_K1, VAR_A6, VAR_K1

CONTROL, CARRIED = range(2)
HIGHEST_LEVEL = 12.0   # of a noise level's logarithm: a factor 160,000 either way is no sensor's

_extending: Any = extending  # typed by numba only in part


@_extending.intrinsic
def _word(typing, x):
    """The 64 bits of a double."""
    def build(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], context.get_value_type(types.int64))

    return types.int64(x), build


def xor_double(seal, x):
    """seal xor the bits of the double x"""
    return seal ^ struct.unpack("<q", struct.pack("<d", x))[0]


@_extending.overload(xor_double, jit_options={"_nrt": False})
def _xor_double(seal, x):
    return lambda seal, x: seal ^ _word(x)


def xor_integer(seal, n):
    """seal xor n"""
    return seal ^ n


@_extending.overload(xor_integer, jit_options={"_nrt": False})
def _xor_integer(seal, n):
    return lambda seal, n: seal ^ n


@inner
def fold(x):
    """Seal of a vector."""
    seal = 0
    for k in range(x.shape[0]):
        seal = xor_double(seal, x[k])
    return seal


@inner
def fold_rows(x):
    """Seal of a matrix."""
    seal = 0
    for k in range(x.shape[0]):
        seal = xor_integer(seal, fold(x[k]))
    return seal


@inner
def fold_layers(x):
    """Seal of an array of three dimensions."""
    seal = 0
    for k in range(x.shape[0]):
        seal = xor_integer(seal, fold_rows(x[k]))
    return seal


@inner
def fold_integers(n, count):
    """Seal of the first integers of a vector."""
    seal = 0
    for k in range(count):
        seal = xor_integer(seal, n[k])
    return seal


# ---- clock, counts and rows


@inner
def seal_control(clock, counts):
    """Seal of what says where samples go and when windows close."""
    return xor_integer(fold(clock), fold_integers(counts, rb.COUNT_FIRST))


@inner
def is_row_whole(ring, seals, at):
    """Whether a row of the ring is as it was written."""
    return fold(ring[at]) == seals[at]


@once
def are_rows_whole(ring, seals, counts):
    """Whether the closed window's rows are as they were written."""
    n, capacity = counts[rb.CLOSED_ROWS], ring.shape[0]
    first = counts[rb.HEAD] - counts[rb.CLOSED_BACK] - n
    if first < 0:
        first += capacity
    whole = True
    at = first
    for _ in range(n):
        whole = whole and is_row_whole(ring, seals, at)
        at = at + 1 if at + 1 < capacity else 0
    return whole


@inner
def is_control_whole(state):
    """Whether clock and counts are as they were left."""
    return seal_control(state.clock, state.counts) == state.guard[CONTROL]


@inner
def close_control(state):
    """Clock and counts stay as they are until the next sample."""
    state.guard[CONTROL] = seal_control(state.clock, state.counts)


@once
def seal_newest(state):
    """The ring's newest row stays as it is until it is used."""
    newest = state.counts[rb.HEAD] - 1
    if newest < 0:
        newest += state.ring.shape[0]
    state.seals[newest] = fold(state.ring[newest])


@inner
def refuse(limits, counts, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Memory is damaged and nothing has been taken: RECOVERED, or why this sample cannot be the first of all."""
    code = rb.gate(limits, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    if code == rb.ACCEPTED:
        return rb.RECOVERED
    counts[rb.COUNT_FIRST + code - rb.BUSY] += 1
    return code


@inner
def give_up(counts, code):
    """Memory is damaged after the sample was taken and counted as `code`: RECOVERED."""
    counts[rb.COUNT_FIRST + code - rb.BUSY] -= 1
    return rb.RECOVERED


# ---- what is carried on


@once
def seal_filter(fil):
    """Seal of the predictor."""
    seal = xor_integer(fold(fil.x), fold_rows(fil.p))
    seal = xor_integer(seal, fold_rows(fil.s))
    seal = xor_integer(seal, xor_integer(fold(fil.p_bar), fold(fil.level)))
    seal = xor_integer(seal, xor_integer(fold_rows(fil.sx), fold_layers(fil.sp)))
    seal = xor_integer(seal, xor_integer(fold(fil.command), fold(fil.time)))
    seal = xor_integer(seal, xor_integer(fold(fil.path), fold(fil.step)))
    seal = xor_integer(seal, fold_integers(fil.cell, fil.cell.shape[0]))
    seal = xor_integer(seal, fold_integers(fil.outliers, fil.outliers.shape[0]))
    return xor_integer(seal, fold_integers(fil.note, fil.note.shape[0]))


@once
def seal_accumulator(acc):
    """Seal of the information gathered."""
    seal = xor_integer(fold_rows(acc.window), fold_rows(acc.psi))
    seal = xor_integer(seal, xor_integer(fold_rows(acc.s_start), fold_rows(acc.rows)))
    seal = xor_integer(seal, fold_integers(acc.counts, acc.counts.shape[0]))
    seal = xor_integer(seal, xor_integer(fold(acc.start), fold(acc.score)))
    return xor_integer(seal, xor_integer(fold_rows(acc.information), fold_rows(acc.level_information)))


@once
def seal_bank(bank):
    """Seal of the tracker."""
    seal = xor_integer(fold_rows(bank.mean), fold_layers(bank.covariance))
    return xor_integer(seal, xor_integer(fold(bank.evidence), xor_integer(fold(bank.total), fold(bank.weight))))


@once
def seal_watch(watch):
    """Seal of the detector of sudden changes."""
    seal = xor_integer(fold_layers(watch.mean), fold_layers(watch.covariance))
    seal = xor_integer(seal, xor_integer(fold_rows(watch.factor), fold_rows(watch.before)))
    seal = xor_integer(seal, xor_integer(fold(watch.start), fold_layers(watch.carried)))
    seal = xor_integer(seal, fold_integers(watch.counts, watch.counts.shape[0]))
    return xor_integer(seal, xor_integer(fold_rows(watch.event), fold(watch.reference)))


@once
def seal_gust(gust):
    """Seal of the gust after calm."""
    return xor_integer(fold(gust.mean), xor_integer(fold_rows(gust.covariance), fold(gust.number)))


@once
def seal_check(check):
    """Seal of the check of the model."""
    seal = xor_integer(fold_rows(check.mean), fold_integers(check.seen, check.seen.shape[0]))
    seal = xor_integer(seal, xor_integer(fold_rows(check.pending), fold_rows(check.history)))
    seal = xor_integer(seal, xor_integer(fold_rows(check.sums), fold(check.number)))
    return xor_integer(seal, fold_integers(check.flag, check.flag.shape[0]))


@once
def seal_undeclared(undeclared):
    """Seal of the wind and misalignment that no nominal declared."""
    seal = xor_integer(fold_rows(undeclared.mean), fold_layers(undeclared.covariance))
    seal = xor_integer(seal, xor_integer(fold_rows(undeclared.past), fold_layers(undeclared.past_covariance)))
    seal = xor_integer(seal, xor_integer(fold(undeclared.better), fold(undeclared.number)))
    return xor_integer(seal, fold_integers(undeclared.flag, undeclared.flag.shape[0]))


@inner
def seal_learner(learner):
    """Seal of the structure, 0 without."""
    if learner is not None:
        return fold_rows(learner.r)
    return 0


@inner
def seal_gauge(gauge):
    """Seal of the uncertainty level, 0 without."""
    if gauge is not None:
        seal = xor_integer(fold(gauge.delta), xor_integer(fold(gauge.delta_std), fold_rows(gauge.probability)))
        seal = xor_integer(seal, xor_integer(fold(gauge.since), fold_integers(gauge.band, gauge.band.shape[0])))
        for p in range(gauge.flag.shape[0]):
            seal = xor_integer(seal, fold_integers(gauge.flag[p], gauge.flag.shape[1]))
        return xor_integer(seal, xor_integer(gauge.events[0], gauge.cell[0]))
    return 0


@inner
def seal_carried(state, learner, gauge):
    """Seal of all that the filtered formulation carries from block to block."""
    seal = xor_integer(seal_filter(state.filter), seal_accumulator(state.acc))
    seal = xor_integer(seal, xor_integer(seal_bank(state.bank), seal_watch(state.watch)))
    seal = xor_integer(seal, xor_integer(seal_check(state.check), seal_gust(state.gust)))
    seal = xor_integer(seal, xor_integer(seal_learner(learner), seal_gauge(gauge)))
    seal = xor_integer(seal, xor_integer(seal_undeclared(state.undeclared), fold_rows(state.repeats)))
    return xor_integer(seal, fold_integers(state.active, state.active.shape[0]))


@once
def is_sound(fil, total):
    """Whether what is carried over the whole flight can be: all finite, no variance below 0, no absurd noise level.

    total (N_BELIEF,) in  the tracked belief
    """
    sound = np.isfinite(total[MEAN_A6] + total[MEAN_K1] + total[COV] + total[VAR_A6] + total[VAR_K1])
    sound = sound and total[VAR_A6] >= 0.0 and total[VAR_K1] >= 0.0
    for i in range(fil.x.shape[0]):
        sound = sound and np.isfinite(fil.x[i])
        for j in range(fil.x.shape[0]):
            sound = sound and np.isfinite(fil.p[i, j])
    for k in range(fil.level.shape[0]):
        sound = sound and abs(fil.level[k]) <= HIGHEST_LEVEL
    return sound


def seal_of(arrays: Iterable[np.ndarray]) -> int:
    """The seal of arrays, as Python makes it before the first sample."""
    seal = 0
    for array in arrays:
        seal ^= int(np.bitwise_xor.reduce(np.ascontiguousarray(array).view(np.int64).ravel(), initial=0))
    return seal
