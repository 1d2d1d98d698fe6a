"""Kernels of a step: transition of vehicle and world, its derivatives for the unknowns, process noise."""

import math

import numpy as np

from sim.kernels import kernel
from sim.vehicle import actuator

from .world import MISALIGNMENT_STATE, MOMENT_STATE, PATH_STATE, TURBULENCE_STATE, WALK_STATE

N_STATES = 4       # theta, theta_dot, beta, beta_dot; then two of each mode; then the held command and acceleration
TRANSITION_ORDER = 12  # of a part of the step; the remainder is below 1e-12
POLE_PART = 0.6    # rad a part, of the fastest pole: the step of an ordinary servo is one part
# what the transition has derivatives for: the first two or four, or these and then those of MODE_NUMBERS of each mode
BY_A6, BY_K1, BY_SERVO_FREQUENCY, BY_SERVO_DAMPING = range(4)
FIRST_ORDER = -1.0  # damping ratio of a servo without a second order, whose frequency is 1/time constant
LEAST_STEP = 0.5   # of a central difference of the generator, whose entries are of second degree at most: any is exact

fastest_pole = kernel(actuator.fastest_pole)


@kernel
def fill_generator(values, bends, a):
    """Fill the generator a (n, n) of the vehicle, its modes, the held command and acceleration.

    values (4 + 3 m,)  a6, k1, servo frequency, servo damping ratio; of each mode frequency, size, damping ratio
    bends (m,)         1: bending, eta'' = w^2 (g beta - eta) - 2 z w eta'; 0: slosh, psi'' = -w^2 psi - 2 z w psi'
                       - theta_ddot, which adds coupling w^2 psi to theta_ddot
    """
    n = len(a)
    command, acceleration = n - 2, n - 1
    frequency, damping = values[BY_SERVO_FREQUENCY], values[BY_SERVO_DAMPING]
    a[:, :] = 0.0
    a[0, 1] = 1.0
    a[1, 0] = values[BY_A6]
    a[1, 2] = values[BY_K1]
    a[1, acceleration] = 1.0
    if damping == FIRST_ORDER:
        a[2, 2] = -frequency
        a[2, command] = frequency
    else:
        a[2, 3] = 1.0
        a[3, 2] = -frequency * frequency
        a[3, 3] = -2.0 * damping * frequency
        a[3, command] = frequency * frequency
    for i in range(len(bends)):
        k, w, size, z = N_STATES + 2 * i, values[4 + 3 * i], values[5 + 3 * i], values[6 + 3 * i]
        a[k, k + 1], a[k + 1, k], a[k + 1, k + 1] = 1.0, -w * w, -2.0 * z * w
        if bends[i] == 1:
            a[k + 1, 2] = size * w * w
        else:
            a[1, k] = size * w * w
    for i in range(len(bends)):
        if bends[i] == 0:
            for j in range(n):
                a[N_STATES + 2 * i + 1, j] -= a[1, j]


@kernel
def differentiate_generator(values, bends, slopes, below):
    """Fill slopes (p, n, n): the generator's derivatives for the first two values, for the first four, or for these and
    the modes'; of known servo (p = 2 + 3 m) without the servo's.  below (n, n): scratch."""
    p, skipped = len(slopes), 0
    for m in range(p):
        if m == BY_SERVO_FREQUENCY and p == 2 + 3 * len(bends):
            skipped = 2
        which = m + skipped
        slopes[m, :, :] = 0.0
        if which == BY_SERVO_DAMPING and values[BY_SERVO_DAMPING] == FIRST_ORDER:
            continue
        held = values[which]
        step = max(abs(held), 1.0) * LEAST_STEP
        values[which] = held + step
        fill_generator(values, bends, slopes[m])
        values[which] = held - step
        fill_generator(values, bends, below)
        values[which] = held
        combine(0.5 / step, slopes[m], -0.5 / step, below)


@kernel
def transition(values, bends, h, f, slopes):
    """Compute f = exp(A h) (n, n), h [s], and slopes (p, n, n), its derivatives for values as
    `differentiate_generator` (scaling and squaring: Moler and Van Loan 2003, method 3)."""
    n = len(f)
    a, term, new = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
    moved, by = np.zeros(slopes.shape), np.zeros(slopes.shape)
    differentiate_generator(values, bends, by, new)
    fill_generator(values, bends, a)
    fastest = fastest_pole(values[BY_SERVO_FREQUENCY], values[BY_SERVO_DAMPING])
    for i in range(len(bends)):
        fastest = max(fastest, values[4 + 3 * i])
    squarings = max(0, math.ceil(math.log2(fastest * h / POLE_PART)))
    h /= 2.0**squarings
    f[:, :] = 0.0
    for i in range(n):
        term[i, i] = f[i, i] = 1.0
    slopes[:, :, :] = 0.0
    for order in range(1, TRANSITION_ORDER + 1):
        for m in range(len(slopes)):
            multiply(a, moved[m], new, 0.0)
            multiply(by[m], term, new, 1.0)
            combine(0.0, moved[m], h / order, new)
            combine(1.0, slopes[m], 1.0, moved[m])
        multiply(a, term, new, 0.0)
        combine(0.0, term, h / order, new)
        combine(1.0, f, 1.0, term)
    for _ in range(squarings):
        for m in range(len(slopes)):
            multiply(slopes[m], f, new, 0.0)
            multiply(f, slopes[m], new, 1.0)
            combine(0.0, slopes[m], 1.0, new)
        multiply(f, f, new, 0.0)
        combine(0.0, f, 1.0, new)


@kernel
def combine(kept, to, by, a):
    """Write to <- kept to + by a, matrices; loops, because a sum of arrays costs numba half a second to compile."""
    for i in range(to.shape[0]):
        for j in range(to.shape[1]):
            to[i, j] = kept * to[i, j] + by * a[i, j]


@kernel
def multiply(a, b, out, kept):
    """Write out <- kept out + a b (n, n); loops, since numba's product needs scipy, which is not always installed."""
    for i in range(len(a)):
        for j in range(len(a)):
            out[i, j] *= kept
        for k in range(len(a)):
            if a[i, k] != 0.0:
                for j in range(len(a)):
                    out[i, j] += a[i, k] * b[k, j]


@kernel
def push_of(role, a6, k1, mean, levels_known):
    """Return the angular acceleration per unit of a world state `role`, and its derivatives for relative a6 and k1.
    mean: share of the state left on average over the step."""
    if role == WALK_STATE or role == TURBULENCE_STATE:
        return a6 * mean, (a6 * mean if levels_known else 0.0), 0.0
    if role == PATH_STATE:
        return -a6, -a6, 0.0
    if role == MISALIGNMENT_STATE:
        return k1, 0.0, k1
    return (1.0 if role == MOMENT_STATE else 0.0), 0.0, 0.0


@kernel
def fill(world, f, slopes, value, h, row, full, moved, air):
    """Fill the transition of vehicle and world over a step of h [s] and its derivatives for relative deviations.

    f (v + 2, v + 2), slopes (p, v + 2, v + 2) in   of `transition`;  value (p,) in   a6, k1, ...
    full (n, n), moved (p, n, n) out
    air (1 + p, n)   out    effect of the known angle of attack (1 rad) on the states, and its derivatives
    """
    a6, k1 = value[BY_A6], value[BY_K1]
    v = len(f) - 2
    acceleration = v + 1
    for i in range(v):
        for j in range(v):
            full[i, j] = f[i, j]
            for m in range(len(value)):
                moved[m, i, j] = value[m] * slopes[m, i, j]
        air[0, i] = a6 * f[i, acceleration]
        for m in range(len(value)):
            air[1 + m, i] = value[m] * a6 * slopes[m, i, acceleration]
        air[1 + BY_A6, i] += a6 * f[i, acceleration]
    z_alpha, z_beta = world.drift[0, row], world.drift[1, row]
    for j in range(len(world.role)):
        role, c = world.role[j], v + j
        keep = math.exp(-h / world.fade[j])
        push, by_a6, by_k1 = push_of(role, a6, k1, 0.5 * (1.0 + keep), world.levels_known)
        for i in range(v):
            full[i, c] = push * f[i, acceleration]
            for m in range(len(value)):
                moved[m, i, c] = push * value[m] * slopes[m, i, acceleration]
            moved[BY_A6, i, c] += by_a6 * f[i, acceleration]
            moved[BY_K1, i, c] += by_k1 * f[i, acceleration]
        full[c, c] = keep
        if role == PATH_STATE:
            full[c, 0], full[c, 1] = h * z_alpha, 0.5 * h * h * z_alpha
            full[c, 2], full[c, 3] = h * z_beta, 0.5 * h * h * z_beta
            full[c, c] = 1.0 - h * z_alpha
            air[0, c] = h * z_alpha
            for k in range(len(world.role)):
                if world.role[k] == WALK_STATE or world.role[k] == TURBULENCE_STATE:
                    full[c, v + k] = h * z_alpha
                elif world.role[k] == MISALIGNMENT_STATE:
                    full[c, v + k] = h * z_beta


@kernel
def add_noise(world, f, bends, a6, h, row, q, dq):
    """Add the process noise of a step to q (n, n), its derivative for relative a6 to dq (n, n).

    Wind to the leading order in h [s]: theta_ddot = a6 w, w_dot white, which slosh (bends 0) feels as it does theta.
    """
    v = len(f) - 2
    for i in range(v):
        for j in range(v):
            gusts = a6 * a6 * world.gamma_variance * f[i, v + 1] * f[j, v + 1]
            q[i, j] += gusts
            dq[i, j] += 2.0 * gusts
    for k in range(len(world.role)):
        c = v + k
        grown = world.fresh[k] * h
        if world.role[k] == TURBULENCE_STATE:
            grown = world.start[k, row] * (1.0 - math.exp(-2.0 * h / world.fade[k]))
        if grown == 0.0:
            continue
        once, twice = a6 * a6 * grown * h * h, a6 * grown * h
        q[c, c] += grown
        for one in range(-1, len(bends)):
            if one >= 0 and bends[one] == 1:
                continue
            i, sign_i = (0, 1.0) if one < 0 else (N_STATES + 2 * one, -1.0)
            across = sign_i * twice
            q[i, c] += across * h / 6.0
            q[c, i] += across * h / 6.0
            q[i + 1, c] += across / 2.0
            q[c, i + 1] += across / 2.0
            if world.levels_known:
                dq[i, c] += across * h / 6.0
                dq[c, i] += across * h / 6.0
                dq[i + 1, c] += across / 2.0
                dq[c, i + 1] += across / 2.0
            for other in range(-1, len(bends)):
                if other >= 0 and bends[other] == 1:
                    continue
                j, sign_j = (0, 1.0) if other < 0 else (N_STATES + 2 * other, -1.0)
                both = sign_i * sign_j * once
                add_square(both, h, i, j, q)
                if world.levels_known:
                    add_square(2.0 * both, h, i, j, dq)


@kernel
def add_square(size, h, i, j, q):
    """Add to q the covariance of (angle i, its rate) with (angle j, its rate), whose acceleration walks."""
    q[i, j] += size * h * h / 20.0
    q[i, j + 1] += size * h / 8.0
    q[i + 1, j] += size * h / 8.0
    q[i + 1, j + 1] += size / 3.0
