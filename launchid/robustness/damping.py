"""Damping of a flight's rate by the likelihood of its log: a6 and k1 are factors on the nominal's profiles.

The log is laid in windows.  In each the filter of `launchid/likelihood` has everything free that a flight may have
beside its damping: factors on a6(t) and k1(t), how k1 changes, misalignment, moment and steady wind, offsets of the
sensors, the servo's speed, delay and gain; gusts, sensors' and acceleration's noise are as declared.  So a window tells
the damping as well as its motion lets it, whether a6 and k1 change within it or not, and `airframe.pooled` joins what
the windows say.
"""

import math

import numpy as np

from sim.errors import InputError
from sim.nominal import Nominal

from ..diagnosis.adapter import FEWEST_ROWS, read
from ..diagnosis.model import Model
from ..diagnosis.track import track_of
from ..diagnosis.used import stretch
from ..likelihood.estimate import gauss_newton, inverse
from ..likelihood.likelihood import LEVELS
from ..log.log import Log
from .airframe import NOT_TOLD, DampedWindow, Damping, airframe_of, modes_at, pooled

WINDOW = 10.0   # s of a window that tells the damping: shorter ones tell it from a6 no better
STILL = -20.0   # ln of the level at which no moment wanders: as in the filter that identifies a6 and k1
ROUNDS = 2      # of Gauss-Newton that do not halve the objective
DAMPING = "damping"
FREE = (DAMPING, "a6", "k1", "k1_slope", "misalignment", "moment", "wind", "term 1", "gyro_bias", "nozzle_bias",
        "bandwidth", "delay", "gain")   # numbers of the diagnosis' model that are free, where the log has them


def damping_of(log: Log, nominal: Nominal) -> Damping:
    """Return the damping of the rate [1/s] that a log tells with the nominal's profiles and effects.

    It is not asked of a nominal with modes, whose swing hides it, or with a term of the rate, and not of a log that
    cannot be filtered.
    """
    if modes_at(nominal, 0.0)[0]:
        return NOT_TOLD
    try:
        track = read(log, nominal).track
    except InputError:   # nothing drives the vehicle, for one
        return NOT_TOLD
    if track is None:
        return NOT_TOLD
    r = track.record
    rows = min(round(WINDOW / r.period), r.rows - r.held_phase)
    rows -= rows % r.held
    if rows < FEWEST_ROWS:
        return NOT_TOLD
    believed, windows = airframe_of(nominal).damping, []
    for first in range(r.held_phase, r.rows - rows + 1, rows):
        windows += of_window(Model.of(track_of(stretch(r, first, rows))), believed)
    return pooled(windows, 1)


def of_window(m: Model, believed: float) -> list[DampedWindow]:
    """Return what the window of a model tells of the damping, [] if nothing; believed: the nominal's damping [1/s]."""
    if DAMPING not in m.table:
        return []
    if not m.air.is_windy:
        m = m.with_levels(np.where(np.arange(len(LEVELS)) == LEVELS.index("walk"), STILL, m.levels))
    fit = gauss_newton(m, m.table.null, tuple(m.table.index(name) for name in FREE if name in m.table), frozenset(),
                       ROUNDS)
    j = m.table.index(DAMPING)
    k, covariance = fit.at(j), inverse(m, fit)
    if not (math.isfinite(fit.p[j]) and covariance[k, k] > 0.0):
        return []
    slopes = [0.0 if name not in m.table else float(np.mean(of)) * float(
        covariance[fit.at(m.table.index(name)), k] / covariance[k, k])
        for name, of in (("a6", m.log.a6), ("k1", m.log.k1))]
    middle = 0.5 * float(m.log.t[0] + m.log.t[-1]) + m.log.track.record.shift
    return [DampedWindow(middle, believed + float(fit.p[j] - m.table.null[j]), math.sqrt(covariance[k, k]),
                         (slopes[0], slopes[1]))]
