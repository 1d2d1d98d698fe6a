"""An extended Kalman filter over the events of a log, with the derivative of its innovations for each coefficient.

    theta'' = sum of coefficients*terms + c(t) w + m + white,     b  the nozzle
    command:  b'' = W^2 (u(t - delay) - b) - 2 zeta W b' + W^2 white
    nozzle :  b'' = -b'/tau + white                  (no command in the log: the nozzle is a process of its own)
    direct :  b   = u(t - delay)

w is the wind (turbulence of first order, and a random walk) in units of a given c(t), which does not move
with a6: whitening must not depend on what is fitted (docs/method.md, wind).  m is a constant moment, g the gyro's
constant offset.
Events are a motion row, a nozzle row, and a change of the input, each at its own time: stamps are never resampled, a
delay is any number.  The derivative of the state for each coefficient is propagated too, gains held (their part of
the innovations is white and of second order: docs/method.md, the filtered formulation).
"""

import math
from typing import NamedTuple

import numpy as np

from sim.vehicle.kernels import inner, kernel

STATE_THETA, OMEGA, STATE_NOZZLE, NOZZLE_RATE, STATE_MOMENT = range(5)  # the states that are always there
BASE = 5
MOTION_ROW, NOZZLE_ROW, INPUT_CHANGE = range(3)        # kinds of event
BY_COMMAND, BY_MEASUREMENT, BY_INPUT = range(3)        # where the nozzle comes from
(Q_A, R_THETA, R_OMEGA, R_BETA, Q_B, WALK_DENSITY, TURBULENCE_STD, TURBULENCE_CORRELATION, SERVO_FREQUENCY,
 SERVO_DAMPING_RATIO, FRICTION_RATE,
 LONGEST_GAP) = range(12)  # numbers of a filter: spectral densities, variances, rad/sqrt(s), rad, s, rad/s, 1, rad/s, s
N_FILTER_NUMBERS = 12
SERIES_ORDER = 6    # of the step's series; the step is cut to where it holds 1e-6
STEP_NORM = 0.5     # norm of the dynamics times the step
DIFFUSE_FACTOR = 1e3  # times a channel's size: what is not known before the first sample


class Shape(NamedTuple):
    """Structure of the filter: how the nozzle is driven, which states and rate terms it has.

    source  BY_COMMAND, BY_MEASUREMENT or BY_INPUT;  sine  sin(theta) in place of theta
    gyro, walk, turbulence  places of their states, -1: none;  states  number of states
    damping, friction  whether theta_dot and sign(theta_dot) are terms
    """

    source: int
    sine: bool
    gyro: int
    walk: int
    turbulence: int
    states: int
    damping: bool
    friction: bool


@inner
def _weights(t, nodes, out):
    """Return the index of the node left of t; write the share of the right node to out[0]."""
    n = nodes.shape[0]
    out[0] = 0.0
    if n == 1 or t <= nodes[0]:
        return 0
    if t >= nodes[n - 1]:
        return n - 1
    k = np.searchsorted(nodes, t, side="right") - 1
    out[0] = (t - nodes[k]) / (nodes[k + 1] - nodes[k])
    return k


@inner
def _transition(row1, row3, decay, shape, dt, f, half, phi, power):
    """Rows 0 to 3 of f = exp(A dt), half = exp(A dt/2), phi = (f - 1)/(A dt) by their series; A is sparse.

    row1 (n,)  the acceleration's row of A;  row3 (2,)  the nozzle's of (b, b');  decay  of the turbulence
    power (n,) scratch.  Of the other states only the turbulence moves, by itself: f[k, k].
    """
    n = shape.states
    for i in range(4):
        for j in range(n):
            power[j] = 1.0 if i == j else 0.0
            f[i, j], half[i, j], phi[i, j] = power[j], power[j], power[j]
        scale, halved = 1.0, 1.0
        for order in range(1, SERIES_ORDER + 1):
            scale *= dt / order
            halved *= 0.5
            r0, r1, r2, r3 = power[0], power[1], power[2], power[3]
            for j in range(4, n):
                power[j] = r1 * row1[j] + (decay * power[j] if j == shape.turbulence else 0.0)
            power[0], power[1] = r1 * row1[0], r0 + r1 * row1[1]
            power[2], power[3] = r1 * row1[2] + r3 * row3[0], (r2 if shape.source != BY_INPUT else 0.0) + r3 * row3[1]
            for j in range(n):
                f[i, j] += power[j] * scale
                half[i, j] += power[j] * scale * halved
                phi[i, j] += power[j] * scale / (order + 1)
    for i in range(4, n):
        alone = math.exp(decay * dt) if i == shape.turbulence else 1.0
        f[i, i] = alone
        half[i, i] = math.exp(0.5 * decay * dt) if i == shape.turbulence else 1.0
        phi[i, i] = (alone - 1.0) / (decay * dt) if i == shape.turbulence else 1.0


@inner
def _times(f, x, out):
    """Write out = f x, f with the zeros that `_transition` leaves."""
    n = x.shape[0]
    for i in range(2):
        total = 0.0
        for j in range(n):
            total += f[i, j] * x[j]
        out[i] = total
    out[2] = f[2, 2] * x[2] + f[2, 3] * x[3]
    out[3] = f[3, 2] * x[2] + f[3, 3] * x[3]
    for i in range(4, n):
        out[i] = f[i, i] * x[i]


@inner
def _noise(p, f, half, i, top, q, h):
    """p += q times the integral over the step of F(s) e_i (F(s) e_i)', by Simpson; e_i moves states < top, and i."""
    if q <= 0.0:
        return
    for a in range(top):
        for b in range(top):
            p[a, b] += q * h / 6.0 * ((1.0 if a == i and b == i else 0.0) + 4.0 * half[a, i] * half[b, i]
                                      + f[a, i] * f[b, i])
    if i >= top:
        for a in range(top):
            cross = q * h / 6.0 * (4.0 * half[a, i] * half[i, i] + f[a, i] * f[i, i])
            p[a, i] += cross
            p[i, a] += cross
        p[i, i] += q * h / 6.0 * (1.0 + 4.0 * half[i, i] ** 2 + f[i, i] ** 2)


@inner
def _measure(z, i, extra, r, x, p, s, e, variance, h, count, gain):
    """Correct x, p, s with a measurement z of state i (plus state `extra` if >= 0), variance r; fill row `count` of e,
    variance, h."""
    n, q = x.shape[0], s.shape[0]
    innovation = z - x[i]
    total = p[i, i] + r
    for a in range(n):
        gain[a] = p[a, i]
    if extra >= 0:
        innovation -= x[extra]
        total += 2.0 * p[i, extra] + p[extra, extra]
        for a in range(n):
            gain[a] += p[a, extra]
    e[count], variance[count] = innovation, total
    for j in range(q):
        slope = s[j, i] + (s[j, extra] if extra >= 0 else 0.0)
        h[count, j] = slope
        for a in range(n):
            s[j, a] -= gain[a] / total * slope
    for a in range(n):
        x[a] += gain[a] / total * innovation
    for a in range(n):
        for b in range(a, n):
            p[a, b] -= gain[a] * gain[b] / total
            p[b, a] = p[a, b]


@inner
def _forget(x, p, s, shape, wide, whole):
    """Reset the motion's states to unknown (whole: all states), with variances `wide`."""
    n = x.shape[0]
    for a in range(n if whole else 4):
        x[a] = 0.0
        for b in range(n):
            p[a, b] = 0.0
            p[b, a] = 0.0
        p[a, a] = wide[a]
        for j in range(s.shape[0]):
            s[j, a] = 0.0
    if shape.source == BY_INPUT:  # the input is known
        p[2, 2], p[3, 3] = 0.0, 0.0


@kernel
def run(  # noqa: PLR0912, PLR0915  one loop: what it calls per event costs more than the event
        event_t, event_kind, event_row, event_path, u, theta, omega, beta, shape, number, wide, node_a, a6, node_k, k1,
        node_c, coupling, rate, e, variance, h, channel, row, end_x, end_p, end_s):
    """Filter the events; return the number c of innovations written.

    event_t (m,) [s], event_kind, event_row (m,)   in time's order;  event_path (m,) [rad]  flight path there
    u, theta, omega, beta (n,)   columns; NaN: not measured
    number (N_FILTER_NUMBERS,), wide (states,)   numbers of the filter; variances of unknown states
    node_a, a6, node_k, k1   coefficients of theta (sin(theta)) and of the nozzle, linear between the nodes
    node_c, coupling   acceleration [rad/s^2] of a unit of wind, linear between the nodes
    rate (2,)   coefficients of theta_dot and sign(theta_dot)
    e, variance (c,), h (c, q), channel, row (c,)   out: innovation, its variance, derivative of the prediction
    for the coefficients (those of a6, of k1, of rate that the shape has), 0 theta 1 theta_dot 2 beta, row of the log
    end_x (states,), end_p (states, states), end_s (q, states)   out: state, its covariance and derivatives at the end
    """
    n, q = shape.states, h.shape[1]
    na, nk = a6.shape[0], k1.shape[0]
    x, p, s = end_x, end_p, end_s
    f, half, phi, work = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
    row1, row3, slope, step, share = np.zeros(n), np.zeros(2), np.zeros(n), np.zeros(n), np.zeros(1)
    gain = np.zeros(n)
    before = np.zeros(n)
    _forget(x, p, s, shape, wide, True)
    if shape.source == BY_COMMAND:
        row3[0], row3[1] = -number[SERVO_FREQUENCY] ** 2, -2.0 * number[SERVO_DAMPING_RATIO] * number[SERVO_FREQUENCY]
    elif shape.source == BY_MEASUREMENT:
        row3[1] = -number[SERVO_FREQUENCY]
    decay = -1.0 / number[TURBULENCE_CORRELATION]
    q_b = number[Q_B] * (number[SERVO_FREQUENCY] ** 4 if shape.source == 0 else 1.0)
    held, count, now = 0.0, 0, event_t[0]
    for index in range(event_t.shape[0]):
        span = event_t[index] - now
        if span > number[LONGEST_GAP]:
            _forget(x, p, s, shape, wide, False)
            if shape.source == BY_INPUT:
                x[2] = held
        elif span > 0.0:
            fastest = max(math.fabs(row3[1]), math.sqrt(math.fabs(row3[0])))
            parts = max(1, math.ceil(span * fastest / STEP_NORM))
            dt = span / parts
            path = 0.5 * (event_path[index - 1] + event_path[index])
            for part in range(parts):
                middle = now + (part + 0.5) * dt
                ka = _weights(middle, node_a, share)
                wa = share[0]
                a = a6[ka] if wa == 0.0 else a6[ka] * (1.0 - wa) + a6[ka + 1] * wa
                kk = _weights(middle, node_k, share)
                wk = share[0]
                k = k1[kk] if wk == 0.0 else k1[kk] * (1.0 - wk) + k1[kk + 1] * wk
                kc = _weights(middle, node_c, share)
                per = coupling[kc]
                if share[0] > 0.0:
                    per += (coupling[kc + 1] - per) * share[0]
                attack = x[0] - path
                sine, cosine = math.sin(attack), math.cos(attack)
                term = sine if shape.sine else attack
                smooth = math.tanh(x[1] / number[FRICTION_RATE])
                for j in range(n):
                    row1[j] = 0.0
                row1[0] = a * cosine if shape.sine else a
                row1[1] = rate[0] + rate[1] * (1.0 - smooth * smooth) / number[FRICTION_RATE]
                row1[2], row1[4] = k, 1.0
                wind = 0.0
                if shape.walk >= 0:
                    row1[shape.walk] = per
                    wind += x[shape.walk]
                if shape.turbulence >= 0:
                    row1[shape.turbulence] = per
                    wind += x[shape.turbulence]
                for j in range(n):
                    slope[j] = 0.0
                slope[0] = x[1]
                slope[1] = a * term + per * wind + k * x[2] + rate[0] * x[1] + rate[1] * smooth + x[4]
                if shape.source != BY_INPUT:
                    slope[2] = x[3]
                    slope[3] = row3[0] * (x[2] - held) + row3[1] * x[3]
                if shape.turbulence >= 0:
                    slope[shape.turbulence] = decay * x[shape.turbulence]
                _transition(row1, row3, decay, shape, dt, f, half, phi, gain)
                _times(phi, slope, step)
                for r in range(n):
                    before[r] = x[r]
                    x[r] += dt * step[r]
                for r in range(n):
                    _times(f, p[r], work[r])       # P F', P symmetric
                for c in range(n):
                    for r in range(n):
                        gain[r] = work[r, c]
                    _times(f, gain, step)
                    for r in range(n):
                        p[r, c] = step[r]
                _noise(p, f, half, 1, 2, number[Q_A], dt)
                if shape.source != BY_INPUT:
                    _noise(p, f, half, 3, 4, q_b, dt)
                if shape.walk >= 0:
                    _noise(p, f, half, shape.walk, 2, number[WALK_DENSITY] ** 2, dt)
                if shape.turbulence >= 0:
                    _noise(p, f, half, shape.turbulence, 2, -2.0 * decay * number[TURBULENCE_STD] ** 2, dt)
                # sensitivities
                was, now_is = before[0] - path, x[0] - path
                value = 0.5 * ((math.sin(was) + math.sin(now_is)) if shape.sine else (was + now_is))
                nozzle, omega_mid = 0.5 * (before[2] + x[2]), 0.5 * (before[1] + x[1])
                for j in range(q):
                    if j < na:
                        weight = (1.0 - wa) if j == ka else (wa if j == ka + 1 else 0.0)
                        drive = weight * value
                    elif j < na + nk:
                        weight = (1.0 - wk) if j - na == kk else (wk if j - na == kk + 1 else 0.0)
                        drive = weight * nozzle
                    elif shape.damping and j == na + nk:
                        drive = omega_mid
                    else:
                        drive = math.tanh(omega_mid / number[FRICTION_RATE])
                    _times(f, s[j], gain)
                    gain[0] += dt * phi[0, 1] * drive
                    gain[1] += dt * phi[1, 1] * drive
                    for r in range(n):
                        s[j, r] = gain[r]
        now = event_t[index]
        k_row = event_row[index]
        if event_kind[index] == INPUT_CHANGE:
            held = u[k_row]
            if shape.source == BY_INPUT:
                x[2] = held
        elif event_kind[index] == NOZZLE_ROW:
            _measure(beta[k_row], 2, -1, number[R_BETA], x, p, s, e, variance, h, count, gain)
            channel[count], row[count] = 2, k_row
            count += 1
        else:
            if math.isfinite(theta[k_row]):
                _measure(theta[k_row], 0, -1, number[R_THETA], x, p, s, e, variance, h, count, gain)
                channel[count], row[count] = 0, k_row
                count += 1
            if math.isfinite(omega[k_row]):
                _measure(omega[k_row], 1, shape.gyro, number[R_OMEGA], x, p, s, e, variance, h, count, gain)
                channel[count], row[count] = 1, k_row
                count += 1
    return count
