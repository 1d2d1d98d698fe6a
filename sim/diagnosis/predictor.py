"""The simulator, corrected by the log row by row: innovations and their likelihood under any set of effects.

`follow` runs the very Runge-Kutta step and the very effects of `sim.vehicle.step` from row to row on the logged
commands, and corrects attitude, rate and nozzle by fixed Kalman gains (innovations form: Ljung, System
Identification, 2nd ed., ch. 4.3 and 7).  A correction of the rate is an angular acceleration that was not modelled, so
a sloshing mass feels it too.  `likelihood` is a linear filter on top of the innovations of `follow`: it answers what
other noise levels, or a generic disturbance beside them, would have made of the same data, without running it again.

Assumption of `likelihood`: deviations between two filters are small, so the rigid body's linear dynamics carry them.
"""

import math

import numpy as np

from ..effects import actuator, sensor
from ..effects.plant import SLOSH
from ..effects.table import CODE, MEMORY, MEMORY_DOT
from ..vehicle.actuator import delayed_command
from ..vehicle.kernels import inner, kernel
from ..vehicle.step import (
    BETA,
    BETA_DOT,
    DELAY,
    LOG_EVERY,
    PERIOD,
    STEP,
    THETA,
    THETA_DOT,
    attitude,
    gyro,
    remember,
    runge_kutta_4,
)

N_RIGID = 6         # theta, theta_dot, beta, beta_dot, held command noise [rad], held acceleration [rad/s^2]
N_CHANNELS = 3
ESCAPED = 1.0e3     # rad: a model that diverges from the log is not followed further
LOG_TWO_PI = math.log(2.0 * math.pi)


@inner
def expected(v, i, row):
    """What the sensors should read at step i without noise: row (3,) out."""
    row[0] = attitude(v, i)
    row[1] = gyro(v, i)
    row[2] = sensor.nozzle(v.sensor, v.state[BETA])


@inner
def shift_state(v, slots, held, k, gains, row):
    """Add gains[k] (6 + 2 modes, 3) times row (3,) to the state; unmeasured channels are 0 in row."""
    x = v.state
    rate = 0.0
    for c in range(N_CHANNELS):
        x[THETA] += gains[k, 0, c] * row[c]
        rate += gains[k, 1, c] * row[c]
        x[BETA] += gains[k, 2, c] * row[c]
        x[BETA_DOT] += gains[k, 3, c] * row[c]
        held[0] += gains[k, 4, c] * row[c]
        held[1] += gains[k, 5, c] * row[c]
    x[THETA_DOT] += rate
    for e in range(v.plant.shape[0]):
        if slots[e] >= 0:
            for c in range(N_CHANNELS):
                v.plant[e, MEMORY] += gains[k, slots[e], c] * row[c]
                v.plant[e, MEMORY_DOT] += gains[k, slots[e] + 1, c] * row[c]
        elif v.plant[e, CODE] == SLOSH:
            v.plant[e, MEMORY_DOT] -= rate


@kernel
def correct_row(v, slots, held, i, k, z, gains, row):
    """Correct the state at row k, step i; row (3,) out: the innovations, 0 where not measured."""
    if v.history.shape[1] > 0:
        remember(v, i)
        if k == 0:  # before the log the vehicle stood as at its first row
            for j in range(i):
                v.history[0, j], v.history[1, j] = v.history[0, i], v.history[1, i]
    expected(v, i, row)
    for c in range(N_CHANNELS):
        row[c] = 0.0 if np.isnan(z[k, c]) else z[k, c] - row[c]
    shift_state(v, slots, held, k, gains, row)


@kernel
def advance_row(v, held, first, last, begin):
    """Integrate from step `first` to `last`; `begin` is the step of commands[0]."""
    c = v.constant
    tick_steps = v.counter[1]
    delay = c[DELAY] + actuator.latency(v.actuator)
    remembers = v.history.shape[1] > 0
    for i in range(first, last):
        if remembers:
            remember(v, i)
        tick = (i - begin) // tick_steps
        age = ((i - begin) - tick * tick_steps) * c[STEP]
        u = delayed_command(v.commands, tick, age, c[STEP], c[PERIOD], delay) + held[0]
        runge_kutta_4(v, i, actuator.command(v.actuator, u), v.acceleration[tick] + held[1])


@kernel
def follow(v, slots, z, gains, held_rows, held_phase, innovations, states):
    """Innovations of a log under a vehicle.  Returns False if the model ran away.

    v                        inout  at the first row; counter[LOG_EVERY] steps a row, counter[CONTROL_EVERY] a command
    slots (plant's rows,)    in     where in the gains each mode's value stands, -1: it has none there
    z (n, 3)                 in     measured; NaN: not
    gains (n, 6 + 2 modes, 3)  in   Kalman gains of each row
    held_rows, held_phase    in     the held noises are drawn anew each held_rows rows, from row held_phase on; 1: each
    innovations (n, 3)       out    measured less predicted, NaN where not measured
    states (n, 4)            out    theta, theta_dot, beta, beta_dot after the correction
    """
    every, begin = v.counter[LOG_EVERY], v.counter[0]
    held, row = np.zeros(2), np.zeros(N_CHANNELS)
    for k in range(len(z)):
        i = begin + k * every
        if held_rows == 1 or (k - held_phase) % held_rows == 0:
            held[0], held[1] = 0.0, 0.0
        correct_row(v, slots, held, i, k, z, gains, row)
        for c in range(N_CHANNELS):
            innovations[k, c] = math.nan if np.isnan(z[k, c]) else row[c]
        if not abs(v.state[THETA]) < ESCAPED:
            innovations[k:] = math.nan
            states[k:] = math.nan
            return False
        for j in range(4):
            states[k, j] = v.state[j]
        if k + 1 < len(z):
            advance_row(v, held, i, i + every, begin)
    return True


@kernel
def tick_attitudes(v, slots, z, gains, attitudes):
    """What the attitude sensor would have read at every tick of the commands: attitudes (ticks,) out [rad]."""
    every, begin, tick = v.counter[LOG_EVERY], v.counter[0], v.counter[1]
    held, row, per_row = np.zeros(2), np.zeros(N_CHANNELS), every // tick
    for k in range(len(z)):
        correct_row(v, slots, held, begin + k * every, k, z, gains, row)
        for j in range(per_row):
            i = begin + k * every + j * tick
            if v.history.shape[1] > 0:
                remember(v, i)
            attitudes[k * per_row + j] = attitude(v, i)
            if k + 1 < len(z) or j + 1 < per_row:
                advance_row(v, held, i, i + tick, begin)


@kernel
def cholesky_3(s, present, low):
    """Lower factor of the measured channels' covariance s (3, 3) into low (3, 3), rows of others 0; the log of its
    determinant."""
    log_determinant = 0.0
    for a in range(N_CHANNELS):
        for b in range(N_CHANNELS):
            low[a, b] = 0.0
        if not present[a]:
            continue
        for b in range(a + 1):
            if not present[b]:
                continue
            total = s[a, b]
            for c in range(b):
                total -= low[a, c] * low[b, c]
            low[a, b] = math.sqrt(max(total, 1e-300)) if a == b else total / low[b, b]
        log_determinant += 2.0 * math.log(low[a, a])
    return log_determinant


@kernel
def likelihood(f, block, q, c, r, p, resets, reset_variances, base, base_gains, counts, gains, low, whitened):
    """Log-likelihood of a log under noise levels, from the innovations of a filter with other gains.

    f (b, m, m)           in     transition over a row, block[k] of it from row k to k + 1
    q (b, m, m)           in     process noise over a row
    c (3, m)              in     what is measured
    r (3,)                in     variances of the sensors
    p (m, m)              inout  covariance before the first row; scratch afterwards
    resets (n,)           in     bool: at this row the states from 4 to 4 + len(reset_variances) are drawn anew
    reset_variances (s,)  in     their variances
    base (n, 3)           in     innovations under the gains base_gains (n, 6, 3); NaN: not measured
    counts (n,)           in     bool: rows whose measurements count in the likelihood (all correct the state)
    gains (n, m, 3), low (n, 3, 3)   out   Kalman gains, lower factor of the innovations' covariance
    whitened (n, 3)       out    innovations of this filter times the factor's inverse, 0 where not measured
    """
    n, m = len(base), f.shape[1]
    d, new_d = np.zeros(m), np.zeros(m)
    pc, fp, s = np.zeros((m, N_CHANNELS)), np.zeros((m, m)), np.zeros((N_CHANNELS, N_CHANNELS))
    present, e, y = np.zeros(N_CHANNELS, np.bool_), np.zeros(N_CHANNELS), np.zeros((N_CHANNELS, m))
    total = 0.0
    for k in range(n):
        if resets[k]:
            reset(p, d, reset_variances)
        innovation_of(base[k], c, d, p, r, present, e, pc, s)
        log_determinant = cholesky_3(s, present, low[k])
        solve_row(low[k], present, e, pc, y, whitened[k])
        if counts[k]:
            total -= 0.5 * log_determinant
            for a in range(N_CHANNELS):
                if present[a]:
                    total -= 0.5 * (whitened[k, a] * whitened[k, a] + LOG_TWO_PI)
        back_substitute(low[k], present, y, gains[k])
        correct(base[k], base_gains[k], gains[k], present, e, y, d, p)
        if k + 1 < n:
            propagate(f[block[k]], q[block[k]], d, new_d, p, fp)
    return total


@inner
def reset(p, d, variances):
    """Held noises are drawn anew."""
    for a in range(len(variances)):
        p[4 + a, :] = 0.0
        p[:, 4 + a] = 0.0
        p[4 + a, 4 + a] = variances[a]
        d[4 + a] = 0.0


@inner
def innovation_of(base, c, d, p, r, present, e, pc, s):
    """e (3,), its covariance s (3, 3) and pc = P C' (m, 3) of this filter at a row; present (3,): what is measured."""
    for a in range(N_CHANNELS):
        present[a] = not np.isnan(base[a])
        e[a] = base[a] if present[a] else 0.0
        for j in range(len(d)):
            pc[j, a] = 0.0
            for i in range(len(d)):
                pc[j, a] += p[j, i] * c[a, i]
            if present[a]:
                e[a] -= c[a, j] * d[j]
    for a in range(N_CHANNELS):
        for b in range(N_CHANNELS):
            s[a, b] = r[a] if a == b else 0.0
            for j in range(len(d)):
                s[a, b] += c[a, j] * pc[j, b]


@inner
def correct(base, base_gains, gains, present, e, y, d, p):
    """d, the deviation from the base filter's state, and P after a row's measurement."""
    for j in range(len(d)):
        for a in range(N_CHANNELS):
            if present[a]:
                d[j] += gains[j, a] * e[a]
                if j < len(base_gains):
                    d[j] -= base_gains[j, a] * base[a]
        for i in range(len(d)):
            for a in range(N_CHANNELS):
                p[j, i] -= y[a, j] * y[a, i]


@inner
def solve_row(low, present, e, pc, y, whitened):
    """whitened = low^-1 e and y = low^-1 (P C')' for the measured channels, 0 for others."""
    m = y.shape[1]
    for a in range(N_CHANNELS):
        whitened[a] = 0.0
        for j in range(m):
            y[a, j] = 0.0
        if not present[a]:
            continue
        value = e[a]
        for b in range(a):
            value -= low[a, b] * whitened[b]
        whitened[a] = value / low[a, a]
        for j in range(m):
            value = pc[j, a]
            for b in range(a):
                value -= low[a, b] * y[b, j]
            y[a, j] = value / low[a, a]


@inner
def back_substitute(low, present, y, gains):
    """gains (m, 3) = y' low^-1: the Kalman gains; 0 for channels not measured."""
    for j in range(y.shape[1]):
        for a in range(N_CHANNELS - 1, -1, -1):
            gains[j, a] = 0.0
            if not present[a]:
                continue
            value = y[a, j]
            for b in range(a + 1, N_CHANNELS):
                if present[b]:
                    value -= low[b, a] * gains[j, b]
            gains[j, a] = value / low[a, a]


@inner
def propagate(f, q, d, new_d, p, fp):
    """d <- F d, P <- F P F' + Q."""
    m = len(d)
    for i in range(m):
        new_d[i] = 0.0
        for k in range(m):
            new_d[i] += f[i, k] * d[k]
        for j in range(m):
            fp[i, j] = 0.0
            for k in range(m):
                fp[i, j] += f[i, k] * p[k, j]
    for i in range(m):
        d[i] = new_d[i]
        for j in range(i + 1):
            total = q[i, j]
            for k in range(m):
                total += fp[i, k] * f[j, k]
            p[i, j] = total
            p[j, i] = total


@kernel
def whiten(low, innovations, whitened):
    """whitened (n, 3) out = low^-1 innovations, 0 where not measured."""
    for k in range(len(innovations)):
        for a in range(N_CHANNELS):
            whitened[k, a] = 0.0
            if np.isnan(innovations[k, a]):
                continue
            value = innovations[k, a]
            for b in range(a):
                value -= low[k, a, b] * whitened[k, b]
            whitened[k, a] = value / low[k, a, a]


@kernel
def horizon_errors(v, slots, z, gains, held_rows, held_phase, spacing, ahead, errors):
    """Errors of predictions without correction, begun from the corrected state every `spacing` rows.

    v, slots, z, gains, held_rows, held_phase   as `follow`
    spacing          in    rows between starts; the first starts at row 0
    ahead (h,)       in    horizons in rows, increasing
    errors (s, h, 3) out   measured less predicted of start s, NaN where not measured or beyond the log
    """
    every, begin, n = v.counter[LOG_EVERY], v.counter[0], len(z)
    held, row, kept = np.zeros(2), np.zeros(N_CHANNELS), np.zeros(len(v.state))
    moments, servo = np.zeros_like(v.plant), np.zeros_like(v.actuator)
    for k in range(n):
        i = begin + k * every
        if held_rows == 1 or (k - held_phase) % held_rows == 0:
            held[0], held[1] = 0.0, 0.0
        correct_row(v, slots, held, i, k, z, gains, row)
        if k % spacing == 0 and k // spacing < len(errors):
            kept[:], moments[:, :], servo[:, :] = v.state, v.plant, v.actuator
            at = k
            for b in range(len(ahead)):
                if k + ahead[b] >= n:
                    errors[k // spacing, b] = math.nan
                    continue
                advance_row(v, held, begin + at * every, begin + (k + ahead[b]) * every, begin)
                at = k + ahead[b]
                if v.history.shape[1] > 0:
                    remember(v, begin + at * every)
                expected(v, begin + at * every, row)
                for c in range(N_CHANNELS):
                    errors[k // spacing, b, c] = z[at, c] - row[c]
            v.state[:], v.plant[:, :], v.actuator[:, :] = kept, moments, servo
        if k + 1 < n:
            advance_row(v, held, i, i + every, begin)
