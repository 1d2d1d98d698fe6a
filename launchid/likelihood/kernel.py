"""One extended Kalman filter of vehicle, air, servo, modes and sensors over the rows of a log, compiled.

    theta' = omega
    omega' = f + c1 theta + c2 omega + curves(theta, omega) + k b + k2 b^2 + kappa b'' + am m + ag g + slosh
             + white noise
    m      a slow disturbance, g turbulence: first-order Markov processes (m a random walk where its time is infinite)
    b, v   nozzle angle and rate: a servo of first or second order behind the command and its noise, which is held over
           a period; or the command itself; or a process of its own, b'' = -w b' + white noise
    p, p'  of each mode.  Bending: p'' + 2 zeta w p' + w^2 p = w^2 b, felt by the sensors alone.
           Slosh: p'' + 2 zeta w p' + w^2 p = -omega', felt by the vehicle

    z_theta = theta - dt omega + dt^2/2 omega' + bending + n
    z_rate  = s (omega - dw omega') + g0 + bending' + n
    z_beta  = b + b0 + n

Between two rows lie equal steps.  Servo and modes are exact over each (the command is its mean), the vehicle is of
second order in the step.  Anderson and Moore, Optimal Filtering, 1979, ch. 8 (EKF) and 6.2 (one scalar measurement at a
time); Jazwinski 1970, th. 7.2 (prediction).

What a run reads of its model are four arrays: the commands, and three of a structured type, which a kernel sees as
records: NUMBERS (one), ROW (one a row), MODE (one a row and mode).
"""

import math

import numpy as np

from sim.kernels import apart, inner, kernel

TH, OM, M, G, B, V = range(6)   # the states that are always there: theta, omega, m, g, b, v; then each mode's p, p'
CORE = 6
FIRST_ORDER_SERVO, SECOND_ORDER_SERVO, NO_SERVO, FREE_NOZZLE = range(4)
RAN_AWAY = 1e7                  # rad or rad/s: a model that ran away is set back to the log

NUMBERS = np.dtype([(name, np.float64) for name in (
    # sensors: dt, dw [s], s, g0 [rad/s], b0 [rad]
    "attitude_delay", "gyro_delay", "gyro_scale", "gyro_bias", "nozzle_bias",
    # curves of the acceleration: coefficients of theta^2, theta^3, sign(theta_dot) [rad/s^2], theta theta_dot,
    # theta_dot^2, theta b, theta_dot b; the rate [rad/s] over which the sign turns
    "square", "cube", "sign", "cross", "rate_square", "theta_beta", "rate_beta", "sign_rate",
    # nozzle: k2 [1/s^2], kappa, kind of servo, w [rad/s], zeta, the time over which a command's noise is held [s]
    "beta_square", "inertia", "servo", "frequency", "damping_ratio", "command_period",
    # air: times [s] of m and g
    "walk_time", "turbulence_time",
    # noise: one sigma of the sensors [unit], densities of acceleration [rad/s^1.5] and command [rad sqrt(s)] (of a free
    # nozzle: of its acceleration), sigma of m (of a walk: a square root of a second) and of g
    "theta_noise", "theta_dot_noise", "beta_noise", "acceleration_noise", "command_noise", "walk_noise",
    "turbulence_noise",
    # variances before the first row, and after a time [s] between two rows that is longer than `longest_gap`
    "theta_start", "omega_start", "m_start", "g_start", "b_start", "v_start", "longest_gap")])
# of a row: f [rad/s^2], c1, c2, k, am, ag, and the coefficients of sin(theta), cos(theta) [rad/s^2]
ROW = np.dtype([(name, np.float64) for name in ("force", "theta", "theta_dot", "beta", "m", "g", "sine", "cosine")])
# of a mode over a row: w [rad/s], zeta, 1 of bending and 0 of slosh; slosh: its effect on the vehicle [1/s^2]; bending:
# that of p on the attitude sensor and of p' on the gyro
MODE = np.dtype([(name, np.float64) for name in ("frequency", "damping_ratio", "bends", "force", "theta", "theta_dot")])


@apart
def _is_curved(c, rows):
    if c.square != 0.0 or c.cube != 0.0 or c.sign != 0.0 or c.cross != 0.0 or c.rate_square != 0.0 or \
            c.theta_beta != 0.0 or c.rate_beta != 0.0:
        return True
    for k in range(len(rows)):
        if rows[k].sine != 0.0 or rows[k].cosine != 0.0:
            return True
    return False


@apart
def _acceleration(x, force, row, b, c, curved):
    """Return omega' without kappa's part, and its slopes in theta, omega and b; force: f with the modes' [rad/s^2]."""
    a = force + row.theta * x[TH] + row.theta_dot * x[OM] + row.beta * b + c.beta_square * b * b + row.m * x[M] \
        + row.g * x[G]
    at, aw, ab = row.theta, row.theta_dot, row.beta + 2.0 * c.beta_square * b
    if curved:
        th, om = x[TH], x[OM]
        a += (c.square + c.cube * th) * th * th + (c.cross * th + c.rate_square * om) * om
        at += (2.0 * c.square + 3.0 * c.cube * th) * th + c.cross * om + c.theta_beta * b
        aw += c.cross * th + 2.0 * c.rate_square * om + c.rate_beta * b
        by_state = c.theta_beta * th + c.rate_beta * om
        a += by_state * b
        ab += by_state
        if row.sine != 0.0 or row.cosine != 0.0:
            s, co = math.sin(th), math.cos(th)
            a += row.sine * s + row.cosine * co
            at += row.sine * co - row.cosine * s
        if c.sign != 0.0:
            s = math.tanh(om / c.sign_rate)
            a += c.sign * s
            aw += c.sign * (1.0 - s * s) / c.sign_rate
    return a, at, aw, ab


@apart
def _oscillation(w, z, h, s):
    """Write the transition of (p, p') over h [s] of p'' + 2 z w p' + w^2 p = 0 to s[0:4]; z is not 1."""
    d, e = w * math.sqrt(abs(1.0 - z * z)), math.exp(-z * w * h)
    co, k = (math.cos(d * h), math.sin(d * h)) if z < 1.0 else (math.cosh(d * h), math.sinh(d * h))
    s[0], s[1] = e * (co + z * w / d * k), e * k / d
    s[2], s[3] = -e * w * w / d * k, e * (co - z * w / d * k)


@apart
def _ratio(z):
    """Return a damping ratio, never so near to 1 that the transition's formula has no digits left."""
    return 0.999 if 0.999 < z < 1.001 else z


@apart
def _servo(c, h, s):
    """Write a servo's step of h [s] to s (9,): transition f11, f12, f21, f22 of (b - u, v), i1, i2 of the mean of b -
    u, h, and the shares of m and g that stay."""
    s[:] = 0.0
    s[6], s[7], s[8] = h, math.exp(-h / c.walk_time), math.exp(-h / c.turbulence_time)
    w = c.frequency
    if c.servo == SECOND_ORDER_SERVO:
        z = _ratio(c.damping_ratio)
        _oscillation(w, z, h, s)
        s[4] = -(s[2] + 2.0 * z * w * (s[0] - 1.0)) / (w * w * h)
        s[5] = -(s[3] - 1.0 + 2.0 * z * w * s[1]) / (w * w * h)
    elif c.servo == FIRST_ORDER_SERVO:
        s[0] = math.exp(-w * h)
        s[4] = (1.0 - s[0]) / (w * h)
    elif c.servo == FREE_NOZZLE:
        s[3] = math.exp(-w * h)
        s[0], s[1] = 1.0, (1.0 - s[3]) / w
        s[4], s[5] = 1.0, (1.0 - s[1] / h) / w


@apart
def _steps(c, modes, h, s, o):
    """Write the servo's step of h [s] to s (9,), and each mode's transition, frequency and damping ratio to o (modes,
    6), where they are not there."""
    if abs(h - s[6]) > 1e-9 * h:
        _servo(c, h, s)
        o[:] = 0.0
    for j in range(len(modes)):
        w, z = modes[j].frequency, _ratio(modes[j].damping_ratio)
        if w != o[j, 4] or z != o[j, 5]:
            _oscillation(w, z, h, o[j])
            o[j, 4], o[j, 5] = w, z


@apart
def _forces(x, modes, h):
    """Return the modes' moment [rad/s^2] on the vehicle, now and h [s] later."""
    now = later = 0.0
    for j in range(len(modes)):
        now += modes[j].force * x[CORE + 2 * j]
        later += modes[j].force * (x[CORE + 2 * j] + h * x[CORE + 2 * j + 1])
    return now, later


@apart
def _move_modes(x, b, a, at, aw, ab, s, o, row, modes, F, wants):
    """Move the modes in x (n,) over one step, in place: each follows what drives it, b or -omega'/w^2, held at its mean
    b, a; F (n, n + 1) out: the rows of the modes, and their columns of the vehicle's."""
    n, h = len(x), s[6]
    for j in range(len(modes)):
        i, k, w2 = CORE + 2 * j, CORE + 2 * j + 1, modes[j].frequency * modes[j].frequency
        bends = modes[j].bends != 0.0
        to = b if bends else -a / w2
        d, rate = x[i] - to, x[k]
        x[i], x[k] = to + o[j, 0] * d + o[j, 1] * rate, o[j, 2] * d + o[j, 3] * rate
        if not wants:
            continue
        q = 0.5 * h * h
        F[0, i], F[0, k] = q * modes[j].force, 0.0
        F[1, i], F[1, k] = (h + q * aw) * modes[j].force, q * modes[j].force
        for r, by in ((i, 1.0 - o[j, 0]), (k, -o[j, 2])):
            for e in range(n + 1):
                F[r, e] = 0.0
            if bends:
                F[r, B], F[r, V], F[r, n] = by * s[4], by * s[5], by * (1.0 - s[4])
            else:
                of = -by / w2
                F[r, TH], F[r, OM], F[r, M], F[r, G] = of * at, of * aw, of * row.m, of * row.g
                F[r, B], F[r, V], F[r, n] = of * ab * s[4], of * ab * s[5], of * ab * (1.0 - s[4])
                for e in range(len(modes)):
                    F[r, CORE + 2 * e] = of * modes[e].force
        F[i, i] += o[j, 0]
        F[i, k] += o[j, 1]
        F[k, i] += o[j, 2]
        F[k, k] += o[j, 3]


@inner
def _move(x, u, s, o, row, modes, c, curved, F, wants):
    """Move x (n,) over one step, in place; F (n, n + 1) out: slopes of theta, omega and modes in x and the command."""
    n, h, off = len(x), s[6], x[B] - u
    b = u + s[4] * off + s[5] * x[V]
    nv = s[2] * off + s[3] * x[V]
    now = later = row.force
    if n > CORE:
        push, shove = _forces(x, modes, h)
        now += push
        later += shove
    a, at, aw, ab = _acceleration(x, now, row, b, c, curved)
    kick = c.inertia * (nv - x[V])
    th, om = x[TH], x[OM]
    if wants:
        q = 0.5 * h * h
        F[0, TH], F[0, OM], F[0, M], F[0, G] = 1.0 + q * at, h + q * aw, q * row.m, q * row.g
        F[0, B], F[0, V], F[0, n] = q * ab * s[4], q * ab * s[5], q * ab * (1.0 - s[4])
        F[1, TH], F[1, OM] = h * at + q * aw * at, max(1.0 + h * aw + q * (at + aw * aw), 0.0)
        F[1, M], F[1, G] = (h + q * aw) * row.m, (h + q * aw) * row.g
        F[1, B], F[1, V] = h * ab * s[4] + c.inertia * s[2], h * ab * s[5] + c.inertia * (s[3] - 1.0)
        F[1, n] = h * ab * (1.0 - s[4]) - c.inertia * s[2]
    x[TH] = th + h * om
    x[OM] = om + h * a
    a2, at, aw, ab = _acceleration(x, later, row, b, c, curved)
    x[TH] = th + h * (om + h * (2.0 * a + a2) / 6.0 + 0.5 * kick)
    x[OM] = om + 0.5 * h * (a + a2) + kick
    x[M] *= s[7]
    x[G] *= s[8]
    x[B] = u + s[0] * off + s[1] * x[V]
    x[V] = nv
    if n > CORE:
        _move_modes(x, b, 0.5 * (a + a2) + kick / h, at, aw, ab, s, o, row, modes, F, wants)


@apart
def _correct(x, P, H, e, r, K):
    """Correct x, P (inout) by a scalar measurement with innovation e; K (n,) out; return the innovation's variance."""
    n = len(x)
    v0 = v1 = v2 = v3 = v4 = v5 = 0.0
    for j in range(CORE):
        h = H[j]
        v0 += P[0, j] * h
        v1 += P[1, j] * h
        v2 += P[2, j] * h
        v3 += P[3, j] * h
        v4 += P[4, j] * h
        v5 += P[5, j] * h
    for j in range(CORE, n):
        h = H[j]
        v0 += P[0, j] * h
        v1 += P[1, j] * h
        v2 += P[2, j] * h
        v3 += P[3, j] * h
        v4 += P[4, j] * h
        v5 += P[5, j] * h
    s = r + H[0] * v0 + H[1] * v1 + H[2] * v2 + H[3] * v3 + H[4] * v4 + H[5] * v5
    for i in range(CORE, n):
        K[i] = 0.0
        for j in range(n):
            K[i] += P[i, j] * H[j]
        s += H[i] * K[i]
    K[0], K[1], K[2], K[3], K[4], K[5] = v0 / s, v1 / s, v2 / s, v3 / s, v4 / s, v5 / s
    for i in range(CORE, n):
        K[i] /= s
    for i in range(n):
        x[i] += K[i] * e
        P[i, 0] -= K[i] * v0
        P[i, 1] -= K[i] * v1
        P[i, 2] -= K[i] * v2
        P[i, 3] -= K[i] * v3
        P[i, 4] -= K[i] * v4
        P[i, 5] -= K[i] * v5
        for j in range(CORE, n):
            P[i, j] -= K[i] * K[j] * s
    return s


@apart
def _spread(P, T, F, s, qa, qm, qg, qv):
    """Propagate P (n, n) over one step, in place; qa, qv noise densities of the acceleration of vehicle and free
    nozzle, qm, qg variances; T scratch."""
    n, h, em, eg = len(P), s[6], s[7], s[8]
    for i in range(n):
        p0, p1, p2, p3, p4, p5 = P[0, i], P[1, i], P[2, i], P[3, i], P[4, i], P[5, i]
        T[0, i] = F[0, 0] * p0 + F[0, 1] * p1 + F[0, 2] * p2 + F[0, 3] * p3 + F[0, 4] * p4 + F[0, 5] * p5
        T[1, i] = F[1, 0] * p0 + F[1, 1] * p1 + F[1, 2] * p2 + F[1, 3] * p3 + F[1, 4] * p4 + F[1, 5] * p5
        T[2, i] = em * p2
        T[3, i] = eg * p3
        T[4, i] = s[0] * p4 + s[1] * p5
        T[5, i] = s[2] * p4 + s[3] * p5
        for j in range(CORE, n):
            T[0, i] += F[0, j] * P[j, i]
            T[1, i] += F[1, j] * P[j, i]
            T[j, i] = 0.0
            for k in range(n):
                T[j, i] += F[j, k] * P[k, i]
    for i in range(n):
        p0, p1, p2, p3, p4, p5 = T[i, 0], T[i, 1], T[i, 2], T[i, 3], T[i, 4], T[i, 5]
        P[i, 0] = F[0, 0] * p0 + F[0, 1] * p1 + F[0, 2] * p2 + F[0, 3] * p3 + F[0, 4] * p4 + F[0, 5] * p5
        P[i, 1] = F[1, 0] * p0 + F[1, 1] * p1 + F[1, 2] * p2 + F[1, 3] * p3 + F[1, 4] * p4 + F[1, 5] * p5
        P[i, 2] = em * p2
        P[i, 3] = eg * p3
        P[i, 4] = s[0] * p4 + s[1] * p5
        P[i, 5] = s[2] * p4 + s[3] * p5
        for j in range(CORE, n):
            P[i, 0] += F[0, j] * T[i, j]
            P[i, 1] += F[1, j] * T[i, j]
            P[i, j] = 0.0
            for k in range(n):
                P[i, j] += F[j, k] * T[i, k]
    P[0, 0] += qa * h * h * h / 3.0
    P[0, 1] += qa * h * h / 2.0
    P[1, 0] += qa * h * h / 2.0
    P[1, 1] += qa * h
    P[2, 2] += qm
    P[3, 3] += qg
    if qv > 0.0:
        P[4, 4] += qv * h * h * h / 3.0
        P[4, 5] += qv * h * h / 2.0
        P[5, 4] += qv * h * h / 2.0
        P[5, 5] += qv * h


@inner
def _hold(g, F, s, T):
    """Propagate g (n,) over one step, in place: the effect of a unit error of the command since it began; T scratch."""
    n = len(g)
    th, om, b, v = g[TH], g[OM], g[B], g[V]
    if n > CORE:
        for j in range(CORE, n):
            T[0, j] = F[j, n]
            for k in range(n):
                T[0, j] += F[j, k] * g[k]
    g[TH] = F[0, TH] * th + F[0, OM] * om + F[0, B] * b + F[0, V] * v + F[0, n]
    g[OM] = F[1, TH] * th + F[1, OM] * om + F[1, B] * b + F[1, V] * v + F[1, n]
    g[B] = s[0] * b + s[1] * v + 1.0 - s[0]
    g[V] = s[2] * b + s[3] * v - s[2]
    for j in range(CORE, n):
        g[TH] += F[0, j] * g[j]
        g[OM] += F[1, j] * g[j]
    for j in range(CORE, n):
        g[j] = T[0, j]


@apart
def _release(P, g, variance):
    """Add to P (n, n), in place, the command's error of this variance, held until now; g back to 0 for the next."""
    for i in range(len(g)):
        for j in range(len(g)):
            P[i, j] += variance * g[i] * g[j]
    g[:] = 0.0


@apart
def _over_row(h, u, row, modes, c, curved, wants, x, P, T, F, s, o, g, A):
    """Propagate x, and P if `wants`, over one row in steps of h [s] with commands u (steps,); A (3,) out: slopes of
    omega' in theta, omega and b at its beginning; T, F scratch; s, o, g kept from row to row."""
    sub = len(u)
    _steps(c, modes, h, s, o)
    qa, qg = c.acceleration_noise * c.acceleration_noise, c.turbulence_noise * c.turbulence_noise * (1.0 - s[8] * s[8])
    qm = c.walk_noise * c.walk_noise * (h if math.isinf(c.walk_time) else 1.0 - s[7] * s[7])
    is_free = c.servo == FREE_NOZZLE
    qv = c.command_noise * c.command_noise if is_free else 0.0
    held = max(round(c.command_period / h), 1)
    for j in range(sub):
        _move(x, u[j], s, o, row, modes, c, curved, F, wants)
        if not wants:
            continue
        if j == 0:
            A[0], A[1], A[2] = F[1, TH] / h, (F[1, OM] - 1.0) / h, F[1, B]
        _spread(P, T, F, s, qa, qm, qg, qv)
        if is_free:
            continue
        _hold(g, F, s, T)
        if (j + 1) % held == 0 or j + 1 == sub:
            _release(P, g, c.command_noise * c.command_noise / h / (j % held + 1))


@apart
def _begin(P, c):
    """Write the variances before the first row to P (n, n); of a mode, those of one at rest."""
    P[:, :] = 0.0
    P[TH, TH], P[OM, OM], P[M, M] = c.theta_start, c.omega_start, c.m_start
    P[G, G], P[B, B], P[V, V] = c.g_start, c.b_start, c.v_start


@inner
def _innovation(ch, z, x, before, row, modes, b, c, curved, wants, H):
    """Return the innovation of channel ch (0 theta, 1 theta_dot, 2 beta) of the measurement z; H (n,) out: slopes, if
    `wants`."""
    if ch == 2:
        if wants:
            H[:] = 0.0
            H[B] = 1.0
        return z - x[B] - c.nozzle_bias
    force = before
    for j in range(len(modes)):
        force += modes[j].force * x[CORE + 2 * j]
    a, at, aw, ab = _acceleration(x, force, row, b, c, curved)
    if ch == 0:
        q, r = 0.5 * c.attitude_delay * c.attitude_delay, -c.attitude_delay
        e = z - x[TH] - r * x[OM] - q * a
    else:
        q, r = -c.gyro_scale * c.gyro_delay, c.gyro_scale
        e = z - r * x[OM] - q * a - c.gyro_bias
    if wants:
        H[TH], H[OM], H[M] = (1.0 if ch == 0 else 0.0) + q * at, r + q * aw, q * row.m
        H[G], H[B], H[V] = q * row.g, q * ab, 0.0
    for j in range(len(modes)):
        i = CORE + 2 * j
        if ch == 0:
            e -= modes[j].theta * x[i]
        else:
            e -= modes[j].theta_dot * x[i + 1]
        if wants:
            H[i] = q * modes[j].force + (modes[j].theta if ch == 0 else 0.0)
            H[i + 1] = modes[j].theta_dot if ch == 1 else 0.0
    return e


@kernel
def run(t, z, u, rows, modes, numbers, frozen, E, S, K, X, A, C):  # noqa: PLR0912 - one algorithm, in order
    """Filter a log; or, `frozen`, follow it with the gains K of another run.

    t (n + 1,) times [s], z (n, 3) theta, theta_dot, beta, NaN where not measured; u (n, steps) commands, each the mean
    over its step; rows (n,) ROW and modes (n, m) MODE, over each row; numbers (1,) NUMBERS
    E (n, 3) innovations, 0 where nothing was measured; S (n, 3) their variances, NaN there; K (n, 3, states) gains; X
    (n, states) filtered states; A (n, 3) slopes of omega' in theta, omega, b; C (n, states, states) covariances of X,
    or none: out
    """
    c, n, states = numbers[0], len(z), CORE + 2 * modes.shape[1]
    x, P, F, s = np.zeros(states), np.zeros((states, states)), np.zeros((states, states + 1)), np.zeros(9)
    T, H, g, o = np.zeros((states, states)), np.zeros(states), np.zeros(states), np.zeros((modes.shape[1], 6))
    curved = _is_curved(c, rows)
    _begin(P, c)
    first = True
    for k in range(n):
        if k == 0:
            x[B] = u[0, 0]
            if not math.isnan(z[0, 1]):
                x[OM] = z[0, 1]
        if first and not math.isnan(z[k, 0]):
            x[TH] = z[k, 0]
            first = False
        b = x[B]
        for ch in range(3):
            E[k, ch] = 0.0
            if not frozen:
                S[k, ch] = np.nan
            if math.isnan(z[k, ch]):
                continue
            e = _innovation(ch, z[k, ch], x, rows[max(k - 1, 0)].force, rows[k], modes[k], b, c, curved,
                            not frozen, H)
            E[k, ch] = e
            if frozen:
                for i in range(CORE):
                    x[i] += K[k, ch, i] * e
                for i in range(CORE, states):
                    x[i] += K[k, ch, i] * e
            else:
                noise = c.theta_noise if ch == 0 else c.theta_dot_noise if ch == 1 else c.beta_noise
                S[k, ch] = _correct(x, P, H, e, noise * noise, K[k, ch])
        if not frozen:
            for i in range(states):
                X[k, i] = x[i]
            if len(C):
                C[k] = P
        if k == n - 1:
            break
        _over_row((t[k + 1] - t[k]) / u.shape[1], u[k], rows[k], modes[k], c, curved, not frozen, x, P, T, F, s, o, g,
                  A[k])
        if not frozen:   # rounding makes no difference of P and its transpose, which an unstable vehicle would let grow
            for i in range(states):
                for j in range(i):
                    P[i, j] = P[j, i] = 0.5 * (P[i, j] + P[j, i])
        gap = t[k + 1] - t[k] > c.longest_gap
        if gap or not (abs(x[TH]) < RAN_AWAY and abs(x[OM]) < RAN_AWAY):
            first = True
            x[OM] = 0.0
            x[CORE:] = 0.0
            if not gap:
                x[TH] = 0.0
                x[M] = 0.0
            if not frozen:
                slow = max(P[M, M], c.m_start) if gap else c.m_start
                _begin(P, c)
                P[M, M] = slow


@kernel
def nozzle_path(X, u, numbers, h):
    """Return the nozzle (n steps,) [rad] at the start of each step h [s] of commands u (n, steps), from filtered rows X
    (n, states)."""
    n, sub = u.shape
    s, out = np.zeros(9), np.empty(n * sub)
    _servo(numbers[0], h, s)
    for k in range(n):
        b, v = X[k, B], X[k, V]
        for j in range(sub):
            out[k * sub + j] = b
            off = b - u[k, j]
            b, v = u[k, j] + s[0] * off + s[1] * v, s[2] * off + s[3] * v
    return out


@kernel
def respond(t, z, rows, modes, numbers, sub, K, A, force, command, shift, E):
    """Write the change of the innovations by a small forcing to E (n, 3): force (n,) [rad/s^2] and command (n,)
    [rad] over each row, shift (n, 3) of the measurements.  Linear, about the path of the run with gains K, slopes A."""
    c, n, states = numbers[0], len(z), CORE + 2 * modes.shape[1]
    x, s, o = np.zeros(states), np.zeros(9), np.zeros((modes.shape[1], 6))
    for k in range(n):
        for ch in range(3):
            E[k, ch] = 0.0
            if math.isnan(z[k, ch]):
                continue
            if ch == 0:
                e = shift[k, 0] - x[TH] + c.attitude_delay * x[OM]
            elif ch == 1:
                e = shift[k, 1] - c.gyro_scale * x[OM]
            else:
                e = shift[k, 2] - x[B]
            for j in range(modes.shape[1]):
                e -= modes[k, j].theta * x[CORE + 2 * j] if ch == 0 else \
                    modes[k, j].theta_dot * x[CORE + 2 * j + 1] if ch == 1 else 0.0
            E[k, ch] = e
            for i in range(states):
                x[i] += K[k, ch, i] * e
        if k == n - 1:
            break
        h = (t[k + 1] - t[k]) / sub
        _steps(c, modes[k], h, s, o)
        at, aw, row = A[k, 0], A[k, 1], rows[k]
        for _ in range(sub):
            off = x[B] - command[k]
            b = command[k] + s[4] * off + s[5] * x[V]
            a = force[k] + at * x[TH] + aw * x[OM] + row.beta * b + row.m * x[M] + row.g * x[G]
            for j in range(modes.shape[1]):
                a += modes[k, j].force * x[CORE + 2 * j]
            for j in range(modes.shape[1]):
                i = CORE + 2 * j
                to = b if modes[k, j].bends != 0.0 else -a / (modes[k, j].frequency * modes[k, j].frequency)
                d, rate = x[i] - to, x[i + 1]
                x[i], x[i + 1] = to + o[j, 0] * d + o[j, 1] * rate, o[j, 2] * d + o[j, 3] * rate
            x[TH] += h * (x[OM] + 0.5 * h * a)
            x[OM] += h * a
            x[M] *= s[7]
            x[G] *= s[8]
            x[B] = command[k] + s[0] * off + s[1] * x[V]
            x[V] = s[2] * off + s[3] * x[V]


@kernel
def ahead(t, z, u, rows, modes, numbers, X, C, starts, spans, out, variances):
    """Write errors of open-loop predictions to out (starts, spans, 3): measured less predicted, from states X at rows
    `starts`, `spans` (increasing) rows ahead; NaN where not measured or beyond the log.  variances: of the errors, if
    covariances C of X are given."""
    c, n, wants, states = numbers[0], len(z), len(C) > 0, CORE + 2 * modes.shape[1]
    x, F, s, g = np.zeros(states), np.zeros((states, states + 1)), np.zeros(9), np.zeros(states)
    P, T, A = np.zeros((states, states)), np.zeros((states, states)), np.zeros(3)
    H, o = np.zeros(states), np.zeros((modes.shape[1], 6))
    curved = _is_curved(c, rows)
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
                _over_row((t[k + 1] - t[k]) / u.shape[1], u[k], rows[k], modes[k], c, curved, wants, x, P, T, F, s, o,
                          g, A)
                k += 1
            if abs(x[TH]) < RAN_AWAY and abs(x[OM]) < RAN_AWAY:
                for ch in range(3):
                    out[i, q, ch] = _innovation(ch, z[end, ch], x, rows[k - 1].force, rows[k], modes[k], x[B], c,
                                                curved, False, H)
                if wants:
                    variances[i, q, 0] = P[TH, TH] + c.theta_noise * c.theta_noise
                    variances[i, q, 1] = c.gyro_scale * c.gyro_scale * P[OM, OM] + c.theta_dot_noise * c.theta_dot_noise
                    variances[i, q, 2] = P[B, B] + c.beta_noise * c.beta_noise


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
