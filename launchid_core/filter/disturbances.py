"""The world beside the vehicle, in the filter: wind, offsets, the flight path.

What is not known of the wind, w, is an acceleration a6_nominal w, and the gains of a model with wind levels are those
of its nominal: whitening that moves with a6 would want the log-determinant in the fit of a6.

An attitude bias b is an acceleration -a6_nominal b', b' = (1 + p) b, and the filter's theta is the attitude as
measured: the same flight, in which no product of a deviation p and a bias is left to linearise.  With b beside the true
theta the sensitivity to p would move with each guess of b, and a quiet first window would take that for information: a6
off by 2.4 of its standard deviations where the misalignment's transient tells of it.
"""

import numpy as np

from ..algebra.elementary import exp_of
from ..kernels import inner
from ..model import ATTITUDE_BIAS, MISALIGNMENT, MOMENT, TURBULENCE, WALK
from .belief import AIR_ALPHA, AIR_BETA, AIR_WIND, AIRY, GAMMA_STD, LEAN, air_at
from .servo import ANGLE_OF_RATE, KEEP_PLACE, STEP_PLACE
from .states import FIRST, GAMMA_NOW, LAST, N_STATES

OFFSET_TIME = 6000.0            # s: in it an offset may change by its whole spread, one sigma; by 11 % in 70 s


@inner
def spread_at(belief, fil, j, t):
    """Variance of nuisance j at t [s] before any data: a walk has gone on since the first sample."""
    variance = belief.spread[j] * belief.spread[j]
    at = belief.level[j]
    if at < 0:
        return variance
    factor = exp_of(2.0 * fil.level[at])
    if belief.role[j] == WALK:
        return variance + factor * belief.variance[at] * max(t - fil.time[FIRST], 0.0)
    return factor * variance


@inner
def fill_push(belief, a6, k1, push):
    """Acceleration that a unit of each nuisance is, with the nominal's a6 and k1.  push (r,) out."""
    for j in range(belief.size.nuisances):
        role = belief.role[j]
        push[j] = 0.0
        if role == WALK or role == TURBULENCE:
            push[j] = a6
        elif role == MISALIGNMENT:
            push[j] = k1
        elif role == MOMENT:
            push[j] = 1.0
        elif role == ATTITUDE_BIAS:
            push[j] = -a6


@inner
def guessed_wind(belief, x):
    """The estimate [rad] of the angle of attack that is neither known beforehand nor theta as measured."""
    wind = 0.0
    for j in range(belief.size.nuisances):
        if belief.role[j] == WALK or belief.role[j] == TURBULENCE:
            wind += x[N_STATES + j]
        elif belief.role[j] == ATTITUDE_BIAS:
            wind -= x[N_STATES + j]
    return wind


@inner
def follow_path(belief, air, fil, h, gamma):
    """Flight-path angle over the step: as measured, or by the drift from what the filter believes, or held; returns
    the part of the angle of attack that is known beside theta, forecast - gamma, at the step's middle [rad].

    Left out: what an error of a6 does to gamma through the wind believed.
    """
    before = fil.path[GAMMA_NOW]
    wind = 0.0
    after = before
    if belief.constant[AIRY] == 1.0:
        middle = fil.time[LAST] + 0.5 * h
        wind = air_at(air, AIR_WIND, middle)
        x = fil.x
        alpha = x[0] + 0.5 * h * x[1] - before + wind + guessed_wind(belief, x)
        lean = belief.constant[LEAN]
        for j in range(belief.size.nuisances):
            if belief.role[j] == MISALIGNMENT:
                lean += x[N_STATES + j]
        after = before + h * (air_at(air, AIR_ALPHA, middle) * alpha
                              + air_at(air, AIR_BETA, middle) * (x[2] + 0.5 * h * x[3] + lean))
    if np.isfinite(gamma):
        after = gamma
    fil.path[GAMMA_NOW] = after
    return wind - 0.5 * (before + after)


@inner
def share_blown(belief, j, h, keep):
    """Share of its variance that wind j, which a walk has in a second, gains over h [s]; `keep`: left of turbulence."""
    return h if belief.role[j] == WALK else 1.0 - keep * keep


@inner
def add_wind(belief, fil, gamma_variance):
    """Add what the wind may have changed over the step, and gamma's noise as an acceleration [rad^2/s^4]."""
    h, keep = fil.step[STEP_PLACE], fil.step[KEEP_PLACE]
    for j in range(belief.size.nuisances):
        k, at = N_STATES + j, belief.level[j]
        if at < 0:
            continue
        q = belief.variance[at] * exp_of(2.0 * fil.level[at])
        q *= share_blown(belief, j, h, keep)
        fil.p[k, k] += q
        fil.sp[at, k, k] += 2.0 * q
    if belief.constant[GAMMA_STD] > 0.0 and gamma_variance > 0.0:
        w = (0.5 * h * fil.step[ANGLE_OF_RATE], fil.step[ANGLE_OF_RATE])
        for i in range(2):
            for j in range(2):
                fil.p[i, j] += w[i] * w[j] * gamma_variance


@inner
def let_offsets_wander(belief, fil, span):
    """Add what offsets may have changed in `span` [s], where a window ends.

    They are constants to a window.  Over a flight no misalignment and no bias is, and a filter that believed so would
    hold on for ever to how an offset and a6 once were related (`OFFSET_TIME`).
    """
    for j in range(belief.size.nuisances):
        if belief.level[j] < 0:
            fil.p[N_STATES + j, N_STATES + j] += belief.spread[j] * belief.spread[j] * span / OFFSET_TIME
