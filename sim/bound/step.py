"""A step of the vehicle and its world: the transition, its derivatives for a6 and k1, the noise."""

import math

import numpy as np

from ..vehicle.actuator import fastest_pole
from ..vehicle.kernels import kernel
from .world import MISALIGNMENT, MOMENT, PATH, TURBULENCE, WALK

N_STATES = 4       # theta, theta_dot, beta, beta_dot
N_AUGMENTED = 6    # and the held command and acceleration
TAYLOR_ORDER = 12  # of a part of the step; the remainder is below 1e-12
RESOLVED = 0.6     # rad a part, of the servo's fastest pole: the step of an ordinary servo is one part
FIRST_ORDER = -1.0  # damping ratio of a servo without a second order, whose frequency is 1/time constant


@kernel
def transition(a6, k1, frequency, damping, h, f, fa, fk):
    """exp(A h) of the augmented system and its derivatives for da6, dk1: of a part of h, squared up (Moler and Van Loan
    2003, method 3).  f, fa, fk (6, 6) out."""
    n = N_AUGMENTED
    a = np.zeros((n, n))
    a[0, 1] = 1.0
    a[1, 0] = a6
    a[1, 2] = k1
    a[1, 5] = 1.0
    if damping == FIRST_ORDER:
        a[2, 2] = -frequency
        a[2, 4] = frequency
    else:
        a[2, 3] = 1.0
        a[3, 2] = -frequency * frequency
        a[3, 3] = -2.0 * damping * frequency
        a[3, 4] = frequency * frequency
    squarings = max(0, math.ceil(math.log2(fastest_pole(frequency, damping) * h / RESOLVED)))
    h /= 2.0**squarings
    term, term_a, term_k = np.eye(n), np.zeros((n, n)), np.zeros((n, n))
    f[:, :] = np.eye(n)
    fa[:, :] = 0.0
    fk[:, :] = 0.0
    for order in range(1, TAYLOR_ORDER + 1):
        new, new_a, new_k = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
        for i in range(n):
            for j in range(n):
                for k in range(n):
                    if a[i, k] != 0.0:
                        new[i, j] += a[i, k] * term[k, j]
                        new_a[i, j] += a[i, k] * term_a[k, j]
                        new_k[i, j] += a[i, k] * term_k[k, j]
        for j in range(n):
            new_a[1, j] += term[0, j]
            new_k[1, j] += term[2, j]
        term, term_a, term_k = new * (h / order), new_a * (h / order), new_k * (h / order)
        f += term
        fa += term_a
        fk += term_k
    for _ in range(squarings):
        fa[:, :] = product(fa, f) + product(f, fa)
        fk[:, :] = product(fk, f) + product(f, fk)
        f[:, :] = product(f, f)


@kernel
def product(a, b):
    """a b (n, n), written out: numba's needs scipy, which an installation need not have."""
    n = len(a)
    out = np.zeros((n, n))
    for i in range(n):
        for k in range(n):
            if a[i, k] != 0.0:
                for j in range(n):
                    out[i, j] += a[i, k] * b[k, j]
    return out


@kernel
def fill(world, f, fa, fk, a6, k1, h, row, full, full_a, full_k, air):
    """The vehicle's and the world's transition over a step, and its derivatives for relative a6 and k1.

    f, fa, fk (6, 6) in     of `transition`
    full, full_a, full_k (n, n) out
    air (3, n)       out    what the known angle of attack does, and its two derivatives
    """
    for i in range(N_STATES):
        for j in range(N_STATES):
            full[i, j], full_a[i, j], full_k[i, j] = f[i, j], a6 * fa[i, j], k1 * fk[i, j]
        air[0, i] = a6 * f[i, 5]
        air[1, i] = a6 * f[i, 5] + a6 * a6 * fa[i, 5]
        air[2, i] = k1 * a6 * fk[i, 5]
    z_alpha, z_beta = world.drift[0, row], world.drift[1, row]
    for j in range(len(world.role)):
        role, c = world.role[j], N_STATES + j
        keep = math.exp(-h / world.fade[j])
        mean = 0.5 * (1.0 + keep)
        push, by_a6, by_k1 = 0.0, 0.0, 0.0
        if role == WALK or role == TURBULENCE:
            push = a6 * mean
            by_a6 = push if world.levels_known else 0.0
        elif role == PATH:
            push = by_a6 = -a6
        elif role == MISALIGNMENT:
            push = by_k1 = k1
        elif role == MOMENT:
            push = 1.0
        for i in range(N_STATES):
            full[i, c] = push * f[i, 5]
            full_a[i, c] = by_a6 * f[i, 5] + push * a6 * fa[i, 5]
            full_k[i, c] = by_k1 * f[i, 5] + push * k1 * fk[i, 5]
        full[c, c] = keep
        if role == PATH:
            full[c, 0], full[c, 1] = h * z_alpha, 0.5 * h * h * z_alpha
            full[c, 2], full[c, 3] = h * z_beta, 0.5 * h * h * z_beta
            full[c, c] = 1.0 - h * z_alpha
            air[0, c] = h * z_alpha
            for k in range(len(world.role)):
                if world.role[k] == WALK or world.role[k] == TURBULENCE:
                    full[c, N_STATES + k] = h * z_alpha
                elif world.role[k] == MISALIGNMENT:
                    full[c, N_STATES + k] = h * z_beta


@kernel
def add_noise(world, f, a6, h, row, noises, p):
    """Adds the process noise of a step to p (n, n), its derivative for relative a6 to the second (2, n, n) of p.

    Of the wind to the leading order in h: theta_ddot = a6 w, w_dot white.
    """
    q, dq = p[0], p[1]
    for i in range(N_STATES):
        for j in range(N_STATES):
            q[i, j] += a6 * a6 * world.gamma_variance * f[i, 5] * f[j, 5]
            dq[i, j] += 2.0 * a6 * a6 * world.gamma_variance * f[i, 5] * f[j, 5]
    for k in range(len(world.role)):
        c = N_STATES + k
        grown = world.fresh[k] * h
        if world.role[k] == TURBULENCE:
            grown = world.start[k, row] * (1.0 - math.exp(-2.0 * h / world.fade[k]))
        if grown == 0.0:
            continue
        once, twice = a6 * a6 * grown * h * h, a6 * grown * h
        q[0, 0] += once * h * h / 20.0
        q[0, 1] += once * h / 8.0
        q[1, 0] += once * h / 8.0
        q[1, 1] += once / 3.0
        q[0, c] += twice * h / 6.0
        q[c, 0] += twice * h / 6.0
        q[1, c] += twice / 2.0
        q[c, 1] += twice / 2.0
        q[c, c] += grown
        if not world.levels_known:
            continue
        dq[0, 0] += once * h * h / 10.0
        dq[0, 1] += once * h / 4.0
        dq[1, 0] += once * h / 4.0
        dq[1, 1] += once / 1.5
        dq[0, c] += twice * h / 6.0
        dq[c, 0] += twice * h / 6.0
        dq[1, c] += twice / 2.0
        dq[c, 1] += twice / 2.0
