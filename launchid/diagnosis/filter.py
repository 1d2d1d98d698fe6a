"""One extended Kalman filter of vehicle and servo over the rows of a log, compiled.

    theta' = omega
    omega' = f + c1 theta + c2 omega + curved(theta, omega) + k b + k2 b^2 + kappa b'' + am m + ag g + white noise
    m      a slow disturbance, g turbulence: first-order Markov processes (m a random walk where its time is infinite)
    b, v   nozzle angle and rate: second order or first; driven by the command and its noise, held over its period

    z_theta = theta - dt omega + dt^2/2 omega' + n
    z_rate  = s (omega - dw omega') + g0 + n
    z_beta  = b + b0 + n

Between two rows lie `sub` steps.  The servo is exact over each (the command is its mean), the vehicle is of second
order in the step.  Anderson and Moore, Optimal Filtering, 1979, ch. 8 (EKF) and 6.2 (one scalar measurement at a time);
Jazwinski 1970, th. 7.2 (prediction).
"""

import math

import numpy as np

from sim.vehicle.kernels import apart, kernel

TH, OM, M, G, B, V = range(6)
N = 6
SECOND_ORDER_SERVO, FIRST_ORDER_SERVO = range(2)  # orders of the servo
# what every run reads of the model as one array of numbers
(DT, DW, SCALE, GYRO, NULL, SOFT, SIN, COS, SQUARE, CUBE, SIGN, CROSS, K2, KAPPA, SERVO_ORDER_PLACE, W, ZETA,
 TAU_M, TAU_G, COMMAND_PERIOD) = range(20)
N_FILTER_CONSTANTS = 20
COMMAND_SLOPE = 6                     # the command's column in the slopes of a step
RT, RW, RB, QA, QC, QM, QG = range(7)  # levels: sensors [unit], densities of acceleration and command, sigmas of m, g
RAN_AWAY = 1e7                         # rad or rad/s: a model that ran away is set back to the log


@apart
def _is_curved(c):
    return c[SIN] != 0.0 or c[COS] != 0.0 or c[SQUARE] != 0.0 or c[CUBE] != 0.0 or c[SIGN] != 0.0 or c[CROSS] != 0.0


@apart
def _acceleration(x, f, c1, c2, k, am, ag, b, c, curved):
    """Return omega' without kappa's part, and its slopes in theta, omega and b."""
    a = f + c1 * x[TH] + c2 * x[OM] + k * b + c[K2] * b * b + am * x[M] + ag * x[G]
    at, aw, ab = c1, c2, k + 2.0 * c[K2] * b
    if curved:
        th, om = x[TH], x[OM]
        a += (c[SQUARE] + c[CUBE] * th) * th * th + c[CROSS] * th * om
        at += (2.0 * c[SQUARE] + 3.0 * c[CUBE] * th) * th + c[CROSS] * om
        aw += c[CROSS] * th
        if c[SIN] != 0.0 or c[COS] != 0.0:
            s, co = math.sin(th), math.cos(th)
            a += c[SIN] * s + c[COS] * co
            at += c[SIN] * co - c[COS] * s
        if c[SIGN] != 0.0:
            s = math.tanh(om / c[SOFT])
            a += c[SIGN] * s
            aw += c[SIGN] * (1.0 - s * s) / c[SOFT]
    return a, at, aw, ab


@apart
def servo_of(c, h, s):
    """Write a servo's step of h [s] to s (9,): transition f11, f12, f21, f22 of (b - u, v), i1, i2 of the mean of b -
    u, h, and the shares of m and g that stay."""
    s[:] = 0.0
    s[6], s[7], s[8] = h, math.exp(-h / c[TAU_M]), math.exp(-h / c[TAU_G])
    w, z = c[W], min(c[ZETA], 0.999)
    if c[SERVO_ORDER_PLACE] == FIRST_ORDER_SERVO:
        s[0] = math.exp(-w * h)
        s[4] = (1.0 - s[0]) / (w * h)
        return
    d = w * math.sqrt(1.0 - z * z)
    e, co, k = math.exp(-z * w * h), math.cos(d * h), math.sin(d * h)
    s[0], s[1] = e * (co + z * w / d * k), e * k / d
    s[2], s[3] = -e * w * w / d * k, e * (co - z * w / d * k)
    s[4] = -(s[2] + 2.0 * z * w * (s[0] - 1.0)) / (w * w * h)
    s[5] = -(s[3] - 1.0 + 2.0 * z * w * s[1]) / (w * w * h)


@apart
def _move(x, u, s, f, c1, c2, k, am, ag, c, curved, F, wants):
    """Move x (6,) over one step, in place; F (2, 7) out: slopes of theta and omega in x and in the command."""
    h, off = s[6], x[B] - u
    b = u + s[4] * off + s[5] * x[V]
    nv = s[2] * off + s[3] * x[V]
    a, at, aw, ab = _acceleration(x, f, c1, c2, k, am, ag, b, c, curved)
    kick = c[KAPPA] * (nv - x[V])
    th, om = x[TH], x[OM]
    if wants:
        q = 0.5 * h * h
        F[0, TH], F[0, OM], F[0, M], F[0, G] = 1.0 + q * at, h + q * aw, q * am, q * ag
        F[0, B], F[0, V], F[0, COMMAND_SLOPE] = q * ab * s[4], q * ab * s[5], q * ab * (1.0 - s[4])
        F[1, TH], F[1, OM] = h * at + q * aw * at, max(1.0 + h * aw + q * (at + aw * aw), 0.0)
        F[1, M], F[1, G] = (h + q * aw) * am, (h + q * aw) * ag
        F[1, B], F[1, V] = h * ab * s[4] + c[KAPPA] * s[2], h * ab * s[5] + c[KAPPA] * (s[3] - 1.0)
        F[1, COMMAND_SLOPE] = h * ab * (1.0 - s[4]) - c[KAPPA] * s[2]
    x[TH] = th + h * om
    x[OM] = om + h * a
    a2, at, aw, ab = _acceleration(x, f, c1, c2, k, am, ag, b, c, curved)
    x[TH] = th + h * (om + h * (2.0 * a + a2) / 6.0 + 0.5 * kick)
    x[OM] = om + 0.5 * h * (a + a2) + kick
    x[M] *= s[7]
    x[G] *= s[8]
    x[B] = u + s[0] * off + s[1] * x[V]
    x[V] = nv


@apart
def _update(x, P, H, e, r, K):
    """Correct x, P (inout) by a scalar measurement with innovation e; K (6,) out; return the innovation's variance."""
    v0 = v1 = v2 = v3 = v4 = v5 = 0.0
    for j in range(N):
        h = H[j]
        v0 += P[0, j] * h
        v1 += P[1, j] * h
        v2 += P[2, j] * h
        v3 += P[3, j] * h
        v4 += P[4, j] * h
        v5 += P[5, j] * h
    s = r + H[0] * v0 + H[1] * v1 + H[2] * v2 + H[3] * v3 + H[4] * v4 + H[5] * v5
    K[0], K[1], K[2], K[3], K[4], K[5] = v0 / s, v1 / s, v2 / s, v3 / s, v4 / s, v5 / s
    for i in range(N):
        x[i] += K[i] * e
        P[i, 0] -= K[i] * v0
        P[i, 1] -= K[i] * v1
        P[i, 2] -= K[i] * v2
        P[i, 3] -= K[i] * v3
        P[i, 4] -= K[i] * v4
        P[i, 5] -= K[i] * v5
    return s


@apart
def _spread(P, T, F, s, qa, qm, qg):
    """Propagate P (6, 6) over one step, in place; qa noise density of acceleration, qm, qg variances; T scratch."""
    h, em, eg = s[6], s[7], s[8]
    for i in range(N):
        p0, p1, p2, p3, p4, p5 = P[0, i], P[1, i], P[2, i], P[3, i], P[4, i], P[5, i]
        T[0, i] = F[0, 0] * p0 + F[0, 1] * p1 + F[0, 2] * p2 + F[0, 3] * p3 + F[0, 4] * p4 + F[0, 5] * p5
        T[1, i] = F[1, 0] * p0 + F[1, 1] * p1 + F[1, 2] * p2 + F[1, 3] * p3 + F[1, 4] * p4 + F[1, 5] * p5
        T[2, i] = em * p2
        T[3, i] = eg * p3
        T[4, i] = s[0] * p4 + s[1] * p5
        T[5, i] = s[2] * p4 + s[3] * p5
    for i in range(N):
        p0, p1, p2, p3, p4, p5 = T[i, 0], T[i, 1], T[i, 2], T[i, 3], T[i, 4], T[i, 5]
        P[i, 0] = F[0, 0] * p0 + F[0, 1] * p1 + F[0, 2] * p2 + F[0, 3] * p3 + F[0, 4] * p4 + F[0, 5] * p5
        P[i, 1] = F[1, 0] * p0 + F[1, 1] * p1 + F[1, 2] * p2 + F[1, 3] * p3 + F[1, 4] * p4 + F[1, 5] * p5
        P[i, 2] = em * p2
        P[i, 3] = eg * p3
        P[i, 4] = s[0] * p4 + s[1] * p5
        P[i, 5] = s[2] * p4 + s[3] * p5
    P[0, 0] += qa * h * h * h / 3.0
    P[0, 1] += qa * h * h / 2.0
    P[1, 0] += qa * h * h / 2.0
    P[1, 1] += qa * h
    P[2, 2] += qm
    P[3, 3] += qg


@apart
def _hold(g, F, s):
    """Propagate g (6,) over one step, in place: the effect of a unit error of the command since it began."""
    th, om, b, v = g[TH], g[OM], g[B], g[V]
    g[TH] = F[0, TH] * th + F[0, OM] * om + F[0, B] * b + F[0, V] * v + F[0, COMMAND_SLOPE]
    g[OM] = F[1, TH] * th + F[1, OM] * om + F[1, B] * b + F[1, V] * v + F[1, COMMAND_SLOPE]
    g[B] = s[0] * b + s[1] * v + 1.0 - s[0]
    g[V] = s[2] * b + s[3] * v - s[2]


@apart
def _release(P, g, variance):
    """Add to P (6, 6), in place, the command's error of this variance, held until now; g back to 0 for the next."""
    for i in range(N):
        for j in range(N):
            P[i, j] += variance * g[i] * g[j]
    g[:] = 0.0


@apart
def _over_row(h, u, row, c, levels, curved, wants, x, P, T, F, s, g, A):
    """Propagate x, and P if `wants`, over one row in steps of h [s] with commands u (sub,); row (6,) as in `run`; A
    (6,) out: slopes at its beginning; T, F, s, g scratch, g and s kept from row to row."""
    sub = len(u)
    if abs(h - s[6]) > 1e-9 * h:
        servo_of(c, h, s)
    qa, qg = levels[QA] * levels[QA], levels[QG] * levels[QG] * (1.0 - s[8] * s[8])
    qm = levels[QM] * levels[QM] * (h if math.isinf(c[TAU_M]) else 1.0 - s[7] * s[7])
    held = max(round(c[COMMAND_PERIOD] / h), 1)
    for j in range(sub):
        _move(x, u[j], s, row[0], row[1], row[2], row[3], row[4], row[5], c, curved, F, wants)
        if not wants:
            continue
        if j == 0:
            A[0], A[1], A[2] = F[1, TH] / h, (F[1, OM] - 1.0) / h, F[1, B]
        _spread(P, T, F, s, qa, qm, qg)
        _hold(g, F, s)
        if (j + 1) % held == 0 or j + 1 == sub:
            _release(P, g, levels[QC] * levels[QC] / h / (j % held + 1))


@kernel
def run(t, z, u, rows, c, levels, P0, sub, frozen, E, S, K, X, A, C):  # noqa: PLR0912, PLR0915 - one algorithm, in order
    """Filter a log; or, `frozen`, follow it with the gains that the last filter left in K.

    t (n + 1,) times [s], z (n, 3) theta, theta_dot, beta, NaN where not measured; u (n, sub) commands, each the mean
    over its step; rows (n, 6): f, c1, c2, k, am, ag over each row; c (N_FILTER_CONSTANTS,), levels (7,), P0 (6,)
    variances
    E (n, 3) innovations, S (n, 3) their variances, NaN where none; K (n, 3, 6) gains; X (n, 6) filtered states;
    A (n, 6) slopes of omega' in theta, omega, b with the innovations' own; C (n, 6, 6) covariances of X, or none: out
    """
    n = len(z)
    x, P, F, s = np.zeros(N), np.zeros((N, N)), np.zeros((2, N + 1)), np.zeros(9)
    T, H, g = np.zeros((N, N)), np.zeros(N), np.zeros(N)
    curved = _is_curved(c)
    for i in range(N):
        P[i, i] = P0[i]
    first, whole = True, t[1] - t[0]
    for k in range(n):
        if k == 0:
            x[B] = u[0, 0]
            if not math.isnan(z[0, 1]):
                x[OM] = z[0, 1]
        if first and not math.isnan(z[k, 0]):
            x[TH] = z[k, 0]
            first = False
        c1, c2, kb, am, ag = rows[k, 1], rows[k, 2], rows[k, 3], rows[k, 4], rows[k, 5]
        before = rows[max(k - 1, 0), 0]
        b = x[B]
        for ch in range(3):
            E[k, ch] = 0.0
            if not frozen:
                S[k, ch] = np.nan
            if math.isnan(z[k, ch]):
                continue
            if ch == 2:
                e = z[k, 2] - x[B] - c[NULL]
                H[:] = 0.0
                H[B] = 1.0
            else:
                a, at, aw, ab = _acceleration(x, before, c1, c2, kb, am, ag, b, c, curved)
                if ch == 0:
                    q = 0.5 * c[DT] * c[DT]
                    e = z[k, 0] - x[TH] + c[DT] * x[OM] - q * a
                    H[TH], H[OM], H[M], H[G], H[B], H[V] = 1.0 + q * at, q * aw - c[DT], q * am, q * ag, q * ab, 0.0
                else:
                    q = c[SCALE] * c[DW]
                    e = z[k, 1] - c[SCALE] * x[OM] + q * a - c[GYRO]
                    H[TH], H[OM], H[M] = -q * at, c[SCALE] - q * aw, -q * am
                    H[G], H[B], H[V] = -q * ag, -q * ab, 0.0
            E[k, ch] = e
            if frozen:
                for i in range(N):
                    x[i] += K[k, ch, i] * e
            else:
                S[k, ch] = _update(x, P, H, e, levels[ch] * levels[ch], K[k, ch])
        if not frozen:
            for i in range(N):
                X[k, i] = x[i]
            if len(C):
                C[k] = P
        if k == n - 1:
            break
        _over_row((t[k + 1] - t[k]) / sub, u[k], rows[k], c, levels, curved, not frozen, x, P, T, F, s, g, A[k])
        if not frozen:   # rounding makes no difference of P and its transpose, which an unstable vehicle would let grow
            for i in range(N):
                for j in range(i):
                    P[i, j] = P[j, i] = 0.5 * (P[i, j] + P[j, i])
        gap = t[k + 1] - t[k] > 20.0 * whole
        if gap or not (abs(x[TH]) < RAN_AWAY and abs(x[OM]) < RAN_AWAY):
            first = True
            x[OM] = 0.0
            if not gap:
                x[TH] = 0.0
                x[M] = 0.0
            if not frozen:
                P[:, :] = 0.0
                for i in range(N):
                    P[i, i] = P0[i]


@kernel
def nozzle_path(X, u, c, h):
    """Return the nozzle (n sub,) [rad] at the start of each step h [s] of commands u (n, sub), from filtered rows X (n,
    6)."""
    n, sub = u.shape
    s, out = np.zeros(9), np.empty(n * sub)
    servo_of(c, h, s)
    for k in range(n):
        b, v = X[k, B], X[k, V]
        for j in range(sub):
            out[k * sub + j] = b
            off = b - u[k, j]
            b, v = u[k, j] + s[0] * off + s[1] * v, s[2] * off + s[3] * v
    return out


@kernel
def respond(t, z, rows, c, sub, K, A, force, command, shift, E):
    """Write the change of the innovations by a small forcing to E (n, 3): force (n,) [rad/s^2] and command (n,)
    [rad] over each row, shift (n, 3) of the measurements.  Linear, about the last filter's path."""
    n = len(z)
    x, s = np.zeros(N), np.zeros(9)
    for k in range(n):
        for ch in range(3):
            E[k, ch] = 0.0
            if math.isnan(z[k, ch]):
                continue
            if ch == 0:
                e = shift[k, 0] - x[TH] + c[DT] * x[OM]
            elif ch == 1:
                e = shift[k, 1] - c[SCALE] * x[OM]
            else:
                e = shift[k, 2] - x[B]
            E[k, ch] = e
            for i in range(N):
                x[i] += K[k, ch, i] * e
        if k == n - 1:
            break
        h = (t[k + 1] - t[k]) / sub
        if abs(h - s[6]) > 1e-9 * h:
            servo_of(c, h, s)
        at, aw, kb, am, ag = A[k, 0], A[k, 1], rows[k, 3], rows[k, 4], rows[k, 5]
        for _ in range(sub):
            off = x[B] - command[k]
            b = command[k] + s[4] * off + s[5] * x[V]
            a = force[k] + at * x[TH] + aw * x[OM] + kb * b + am * x[M] + ag * x[G]
            x[TH] += h * (x[OM] + 0.5 * h * a)
            x[OM] += h * a
            x[M] *= s[7]
            x[G] *= s[8]
            x[B] = command[k] + s[0] * off + s[1] * x[V]
            x[V] = s[2] * off + s[3] * x[V]


@kernel
def whiten(E, S, at, out):
    """Write innovations over std to out, those beyond 8 shortened (Huber 1964); return the sum of log variances."""
    total = 0.0
    for i in range(len(at)):
        s = S[at[i]]
        e = E[at[i]] / math.sqrt(s)
        total += math.log(s)
        if not abs(e) < 1e3:
            e = 1e3 if not e < 0.0 else -1e3
        if abs(e) > 8.0:
            e = math.copysign(math.sqrt(16.0 * abs(e) - 64.0), e)
        out[i] = e
    return total


@kernel
def played(u, width, noise, out):
    """Write to out (m,) the mean of commands u (m,) [rad] behind a play of +-width, with white noise on each.

    The noise works its way through a play that is not far wider.  The driven side is a normal variable of mean y and
    variance v; d, what is asked of it, is one too, and moves it by what is beyond the play: by the means of that, its
    square and its product with d (Gelb and Vander Velde, Multiple-Input Describing Functions, 1968, ch. 7).
    """
    y, v = u[0], 0.0
    for i in range(len(u)):
        if noise == 0.0:
            y = min(max(y, u[i] - width), u[i] + width)
        else:
            s = math.sqrt(noise * noise + v)
            above, below = (u[i] - y - width) / s, (y - u[i] - width) / s
            pa, pb = 0.5 * math.erfc(-above / math.sqrt(2.0)), 0.5 * math.erfc(-below / math.sqrt(2.0))
            fa = math.exp(-0.5 * above * above) / math.sqrt(2.0 * math.pi)
            fb = math.exp(-0.5 * below * below) / math.sqrt(2.0 * math.pi)
            moved = s * (above * pa + fa - below * pb - fb)
            squares = s * s * ((1.0 + above * above) * pa + above * fa + (1.0 + below * below) * pb + below * fb)
            r = v / (s * s)                   # the driven side's own part of d
            y += moved
            v = r * noise * noise + max(squares - moved * moved - 2.0 * r * s * s * (pa + pb) + r * v, 0.0)
        out[i] = y


@kernel
def nozzle_input(u, h, c, lag, washout, rate, out):
    """Write to out (m,) the servo's input for commands u (m,), means over steps h (m,) [s]: behind a first-order lag,
    and less its low-pass of time 1/washout; of a servo that moves no faster than `rate`, the input at which the linear
    servo moves alike, by the trapezoidal rule, which gives u back where nothing is limited."""
    low, y = 0.0, u[0]
    b, v = u[0], 0.0
    w, z = c[W], c[ZETA]
    for i in range(len(u)):
        x = u[i]
        if lag > 0.0:
            a = math.exp(-h[i] / lag)
            mean = x + (y - x) * (1.0 - a) * lag / h[i]
            y = x + (y - x) * a
            x = mean
        if washout > 0.0:
            a = math.exp(-h[i] * washout)
            mean = x + (low - x) * (1.0 - a) / (washout * h[i])
            low = x + (low - x) * a
            x = x - mean
        if rate > 0.0:
            m = max(1, math.ceil(w * h[i] / 0.1))
            g, total = h[i] / m, 0.0
            for _ in range(m):
                if c[SERVO_ORDER_PLACE] == FIRST_ORDER_SERVO:
                    mid = min(max(w * (x - b) / (1.0 + 0.5 * g * w), -rate), rate)
                    total += mid / w
                else:
                    drag = g * w * (0.25 * g * w + z)
                    nv = (v * (1.0 - drag) + g * w * w * (x - b)) / (1.0 + drag)
                    nv = min(max(nv, -rate), rate)
                    mid = 0.5 * (nv + v)
                    total += 2.0 * z / w * mid + (nv - v) / g / (w * w)
                    v = nv
                total += b + 0.5 * g * mid
                b += g * mid
            x = total / m
        out[i] = x


@kernel
def ahead(t, z, u, rows, c, levels, sub, X, C, starts, spans, out, variances):
    """Write errors of open-loop predictions to out (starts, spans, 3): measured less predicted, from states X at rows
    `starts`, `spans` (increasing) rows ahead; NaN where not measured or beyond the log.  variances: of the errors, if
    covariances C of X are given."""
    n, wants = len(z), len(C) > 0
    x, F, s, g = np.zeros(N), np.zeros((2, N + 1)), np.zeros(9), np.zeros(N)
    P, T, A = np.zeros((N, N)), np.zeros((N, N)), np.zeros(N)
    curved = _is_curved(c)
    out[:] = np.nan
    variances[:] = np.nan
    for i in range(len(starts)):
        k = starts[i]
        x[:] = X[k]
        if wants:
            P[:, :] = C[k]
        for q in range(len(spans)):
            end = starts[i] + spans[q]
            if end >= n:
                break
            while k < end:
                _over_row((t[k + 1] - t[k]) / sub, u[k], rows[k], c, levels, curved, wants, x, P, T, F, s, g, A)
                k += 1
            a = _acceleration(x, rows[k - 1, 0], rows[k, 1], rows[k, 2], rows[k, 3], rows[k, 4], rows[k, 5], x[B], c,
                              curved)[0]
            if abs(x[TH]) < RAN_AWAY and abs(x[OM]) < RAN_AWAY:
                out[i, q, 0] = z[end, 0] - x[TH] + c[DT] * x[OM] - 0.5 * c[DT] * c[DT] * a
                out[i, q, 1] = z[end, 1] - c[SCALE] * (x[OM] - c[DW] * a) - c[GYRO]
                out[i, q, 2] = z[end, 2] - x[B] - c[NULL]
                if wants:
                    variances[i, q, 0] = P[TH, TH] + levels[0] * levels[0]
                    variances[i, q, 1] = c[SCALE] * c[SCALE] * P[OM, OM] + levels[1] * levels[1]
                    variances[i, q, 2] = P[B, B] + levels[2] * levels[2]
