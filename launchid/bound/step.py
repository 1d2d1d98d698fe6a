"""Kernels of a step: transition of vehicle and world, its derivatives for the unknowns, process noise."""

import math

import numpy as np

from sim.kernels import kernel
from sim.vehicle import actuator

from .world import MISALIGNMENT_STATE, MOMENT_STATE, PATH_STATE, TURBULENCE_STATE, WALK_STATE

N_STATES = 4       # theta, theta_dot, beta, beta_dot
N_AUGMENTED = 6    # and the held command and acceleration
TRANSITION_ORDER = 12  # of a part of the step; the remainder is below 1e-12
POLE_PART = 0.6    # rad a part, of the servo's fastest pole: the step of an ordinary servo is one part
# what the transition has derivatives for, the first two or all
BY_A6, BY_K1, BY_SERVO_FREQUENCY, BY_SERVO_DAMPING = range(4)
FIRST_ORDER = -1.0  # damping ratio of a servo without a second order, whose frequency is 1/time constant

fastest_pole = kernel(actuator.fastest_pole)


@kernel
def generator_slope(which, frequency, damping, term, out):
    """Add dA term to out: dA = derivative of the generator A for a6, k1, servo frequency or damping ratio (`which`).

    term, out (6, 6)
    """
    for j in range(N_AUGMENTED):
        if which == BY_A6:
            out[1, j] += term[0, j]
        elif which == BY_K1:
            out[1, j] += term[2, j]
        elif damping == FIRST_ORDER:
            if which == BY_SERVO_FREQUENCY:
                out[2, j] += term[4, j] - term[2, j]
        elif which == BY_SERVO_FREQUENCY:
            out[3, j] += 2.0 * (frequency * (term[4, j] - term[2, j]) - damping * term[3, j])
        else:
            out[3, j] -= 2.0 * frequency * term[3, j]


@kernel
def transition(a6, k1, frequency, damping, h, f, slopes):
    """Compute f = exp(A h) (6, 6), h [s], and slopes (p, 6, 6), its derivatives for the first p of a6, k1, frequency,
    damping (scaling and squaring: Moler and Van Loan 2003, method 3)."""
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
    squarings = max(0, math.ceil(math.log2(fastest_pole(frequency, damping) * h / POLE_PART)))
    h /= 2.0**squarings
    term, new, moved = np.zeros((n, n)), np.zeros((n, n)), np.zeros(slopes.shape)
    f[:, :] = 0.0
    for i in range(n):
        term[i, i] = f[i, i] = 1.0
    slopes[:, :, :] = 0.0
    for order in range(1, TRANSITION_ORDER + 1):
        for m in range(len(slopes)):
            multiply(a, moved[m], new, 0.0)
            generator_slope(m, frequency, damping, term, new)
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

    f (6, 6), slopes (p, 6, 6) in   of `transition`;  value (p,) in   a6, k1, ...
    full (n, n), moved (p, n, n) out
    air (1 + p, n)   out    effect of the known angle of attack (1 rad) on the states, and its derivatives
    """
    a6, k1 = value[BY_A6], value[BY_K1]
    for i in range(N_STATES):
        for j in range(N_STATES):
            full[i, j] = f[i, j]
            for m in range(len(value)):
                moved[m, i, j] = value[m] * slopes[m, i, j]
        air[0, i] = a6 * f[i, 5]
        for m in range(len(value)):
            air[1 + m, i] = value[m] * a6 * slopes[m, i, 5]
        air[1 + BY_A6, i] += a6 * f[i, 5]
    z_alpha, z_beta = world.drift[0, row], world.drift[1, row]
    for j in range(len(world.role)):
        role, c = world.role[j], N_STATES + j
        keep = math.exp(-h / world.fade[j])
        push, by_a6, by_k1 = push_of(role, a6, k1, 0.5 * (1.0 + keep), world.levels_known)
        for i in range(N_STATES):
            full[i, c] = push * f[i, 5]
            for m in range(len(value)):
                moved[m, i, c] = push * value[m] * slopes[m, i, 5]
            moved[BY_A6, i, c] += by_a6 * f[i, 5]
            moved[BY_K1, i, c] += by_k1 * f[i, 5]
        full[c, c] = keep
        if role == PATH_STATE:
            full[c, 0], full[c, 1] = h * z_alpha, 0.5 * h * h * z_alpha
            full[c, 2], full[c, 3] = h * z_beta, 0.5 * h * h * z_beta
            full[c, c] = 1.0 - h * z_alpha
            air[0, c] = h * z_alpha
            for k in range(len(world.role)):
                if world.role[k] == WALK_STATE or world.role[k] == TURBULENCE_STATE:
                    full[c, N_STATES + k] = h * z_alpha
                elif world.role[k] == MISALIGNMENT_STATE:
                    full[c, N_STATES + k] = h * z_beta


@kernel
def add_noise(world, f, a6, h, row, q, dq):
    """Add the process noise of a step to q (n, n), its derivative for relative a6 to dq (n, n).

    Wind to the leading order in h [s]: theta_ddot = a6 w, w_dot white.
    """
    for i in range(N_STATES):
        for j in range(N_STATES):
            q[i, j] += a6 * a6 * world.gamma_variance * f[i, 5] * f[j, 5]
            dq[i, j] += 2.0 * a6 * a6 * world.gamma_variance * f[i, 5] * f[j, 5]
    for k in range(len(world.role)):
        c = N_STATES + k
        grown = world.fresh[k] * h
        if world.role[k] == TURBULENCE_STATE:
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
