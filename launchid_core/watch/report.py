"""What leaves the estimator beside a window's outcome: tracked estimate, uncertainty level, sudden changes."""

import numpy as np

from ..filter import states as sx
from ..filter.modes import BY_DAMPING, BY_FREQUENCY, N_MODE_COLUMNS, NODE_T, is_proven
from ..filter.servo import BY_DELAY, std_of
from ..kernels import inner
from ..model import ATTITUDE_BIAS, MISALIGNMENT, TURBULENCE, WALK
from . import changes as ch
from .uncertainty import OUT

KNOWN_SHARE = 0.9  # of FIRST_STD: the data have said something of a parameter



@inner
def report_tracked(profile, total, contradicted, t, rep):
    """The tracked estimate at t [s], its share on the profile there: valid once a parameter is known better than before
    the first sample, unless the innovations contradict the model."""
    tracked = rep.tracked
    tracked.a6 = np.nan
    tracked.k1 = np.nan
    tracked.a6_std = np.nan
    tracked.k1_std = np.nan
    tracked.correlation = np.nan
    first = KNOWN_SHARE * sx.FIRST_STD
    known = min(total.var_a6, total.var_k1) < first * first and not contradicted
    known = known and np.isfinite(total.mean_a6 + total.mean_k1)
    rep.is_tracked = int(known)
    if not known:
        return
    a6, k1 = sx.profile_at(profile, t)
    tracked.a6 = a6 * (1.0 + total.mean_a6)
    tracked.k1 = k1 * (1.0 + total.mean_k1)
    tracked.a6_std = abs(a6) * np.sqrt(total.var_a6)
    tracked.k1_std = abs(k1) * np.sqrt(total.var_k1)
    sign = -1.0 if a6 * k1 < 0.0 else 1.0
    tracked.correlation = sign * total.cov / np.sqrt(total.var_a6 * total.var_k1)


@inner
def report_part(total, value, variance, for_a6, for_k1, out):
    """Write a value that moves by `for_a6`, `for_k1` a deviation, and its standard deviation, to out (2,)."""
    variance += (for_a6 * for_a6 * total.var_a6 + 2.0 * for_a6 * for_k1 * total.cov
                 + for_k1 * for_k1 * total.var_k1)
    out[0], out[1] = value, np.sqrt(variance)


@inner
def report_air(belief, air, fil, total, contradicted, rep):
    """Report wind and offsets as of the filter's last sample.

    In the filter the wind is an acceleration in units of the nominal's a6, the misalignment one of its k1.
    """
    rep.air[:] = np.nan
    rep.offset[:, :] = np.nan
    if contradicted:
        return
    n = belief.size.states
    theta, beta = n + belief.size.theta, n + belief.size.beta
    a, k = 1.0 + fil.p_bar[sx.A6], 1.0 + fil.p_bar[sx.K1]
    wind = variance = for_a6 = for_k1 = 0.0
    blows = False
    for j in range(belief.size.nuisances):
        at, role = sx.N_STATES + j, belief.role[j]
        x, p = fil.x[at], fil.p[at, at]
        if role == WALK or role == TURBULENCE:
            wind += x
            for i in range(belief.size.nuisances):
                if belief.role[i] == WALK or belief.role[i] == TURBULENCE:
                    variance += fil.p[at, sx.N_STATES + i]
            for_a6 += fil.s[at, theta]
            for_k1 += fil.s[at, beta]
            blows = True
        elif role == MISALIGNMENT:
            report_part(total, x / k, p / (k * k), fil.s[at, theta] / k, (fil.s[at, beta] - x / k) / k,
                        rep.offset[role - MISALIGNMENT])
        elif role == ATTITUDE_BIAS:
            report_part(total, x / a, p / (a * a), (fil.s[at, theta] - x / a) / a, fil.s[at, beta] / a,
                        rep.offset[role - MISALIGNMENT])
        else:
            report_part(total, x, p, fil.s[at, theta], fil.s[at, beta], rep.offset[role - MISALIGNMENT])
    if blows:
        known = sx.air_at(air, sx.AIR_WIND, fil.time.last) if belief.constant.airy == 1.0 else 0.0
        report_part(total, wind / a, variance / (a * a), (for_a6 - wind / a) / a, for_k1 / a, rep.air[:])
        rep.air[0] += known


@inner
def report_servo(belief, fil, contradicted, rep):
    """Report the servo that is not known, as the flight has shown it so far: numbers, their standard deviations and
    correlations."""
    rep.actuator[:, :] = np.nan
    rep.actuator_corr[:] = np.nan
    constant, servo = belief.constant, fil.servo
    unit = (constant.frequency, constant.damping, 1.0)
    for j in range(belief.size.servo):
        if contradicted:
            continue
        scale = belief.servo[j] * unit[j]
        rep.actuator[j, 0] = (constant.delay if j == BY_DELAY else unit[j]) + scale * servo.mean[j]
        rep.actuator[j, 1] = scale * std_of(belief.size, servo, j)
        for i in range(j):
            shared = 0.0
            for k in range(j, belief.size.servo):
                shared += servo.root[i, k] * servo.root[j, k]
            rep.actuator_corr[i + j - 1] = shared / (std_of(belief.size, servo, i) * std_of(belief.size, servo, j))


@inner
def report_modes(belief, nodes, fil, contradicted, t, rep):
    """Report frequency and size of every mode at t [s], as the flight has shown them so far, each with its standard
    deviation."""
    modes = fil.modes
    for i in range(belief.size.modes):
        at = NODE_T + 1 + N_MODE_COLUMNS * i
        for k in range(2):
            rep.mode[i, 2 * k] = np.nan if contradicted else sx.air_at(nodes, at + k, t)
            rep.mode[i, 2 * k + 1] = np.nan if contradicted else 0.0
    for j in range(belief.size.numbers):
        i, what, sigma = belief.mode_of[j], belief.number[j], belief.number_sigma[j]
        if what == BY_DAMPING or contradicted:
            continue
        nominal = rep.mode[i, 2 * what]
        if what == BY_FREQUENCY and not is_proven(belief, modes, i):
            rep.mode[i, 1] = nominal * sigma
            continue
        rep.mode[i, 2 * what] = nominal * (1.0 + sigma * modes.mean[2 + j])
        rep.mode[i, 2 * what + 1] = abs(nominal) * sigma * np.sqrt(modes.covariance[2 + j, 2 + j])


@inner
def report_level(size, gauge, rep):
    """Give the place of each parameter in its range, if there is one and anything is known of them."""
    rep.delta[:] = np.nan
    rep.delta_std[:] = np.nan
    rep.out_since[:] = np.nan
    rep.probability[:, :] = np.nan
    rep.has_level = rep.is_tracked * size.ranged
    if size.ranged == 0:
        return
    for p in range(2):
        rep.raised[p] = gauge.raised[p]
        rep.band[p] = gauge.band[p]
        if rep.raised[p] == 1:
            rep.out_since[p] = gauge.since[p]
        if rep.has_level == 1:
            rep.delta[p], rep.delta_std[p] = gauge.delta[p], gauge.delta_std[p]
            for k in range(OUT + 1):
                rep.probability[p, k] = gauge.probability[p, k]


@inner
def report_change(event, at, before, after, nominal, variance, parameter, rep):
    """Write one parameter's part of sudden change `at` as a row of the report.  before, after, variance  relative"""
    k, change = rep.changes, rep.change
    change.time[k], change.time_std[k], change.alarm[k] = event.time[at], event.time_std[at], event.alarm[at]
    change.before[k], change.after[k] = nominal * (1.0 + before), nominal * (1.0 + after)
    change.size[k], change.size_std[k] = nominal * (after - before), abs(nominal) * np.sqrt(variance)
    change.parameter[k], change.final[k] = parameter, int(event.stage[at] == ch.FINAL)
    rep.changes = k + 1


@inner
def report_changes(profile, watch, rep):
    """Give those of the last MAX_EVENTS sudden changes that stand, oldest first; a change of both parameters is two
    rows."""
    rep.changes = 0
    event, events = watch.event, max(0, watch.counts.events)
    for number in range(max(0, events - ch.MAX_EVENTS), events):
        at = number % ch.MAX_EVENTS
        if event.stage[at] == ch.WITHDRAWN:
            continue
        a6, k1 = sx.profile_at(profile, event.time[at])
        if event.kind[at] != ch.K1_JUMP:
            report_change(event, at, event.a6_before[at], event.a6_after[at], a6, event.a6_variance[at], sx.A6, rep)
        report_change(event, at, event.k1_before[at], event.k1_after[at], k1, event.k1_variance[at], sx.K1, rep)
