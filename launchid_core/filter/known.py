"""What is known beside a6 and k1: accelerations in time, terms that are not linear, and the command's path.

An acceleration of time acts by its value at a step's middle.  A term c f(theta, theta_dot, beta) acts by its value at
the predicted state there, and by its slope in F (extended Kalman filter: Gelb, Applied Optimal Estimation, 1974,
section 6.1); sign(x) by its mean over what is not known of x, erf(x/(sqrt(2) std)) (statistical linearisation, ibid.,
section 6.2).  The command passes play, lag and wash-out, in this order, before the servo (`sim.effects.actuator`).  At
the limit of its rate the nozzle moves as predicted from its state; the covariance moves as without one.

Assumptions: the command is held from sample to sample; play, lag and what washes out rest at 0 before the first sample.
"""

import math

import numpy as np

from ..algebra.elementary import erfc_of, exp_of, sin_of
from ..algebra.library import function_value
from ..kernels import inner
from ..model import ATTITUDE_BIAS, TURBULENCE, WALK
from . import states as sx

SIGN = 3                    # place of sign in `library.FUNCTIONS`
SLOPE_DIFFERENCE = 1.0e-5   # rad, rad/s: half the span of a term's central difference
LIMIT_PARTS = 16            # of a step in which the servo may reach the limit of its rate
LEAST_SPREAD = 1.0e-9       # rad, rad/s: of what a sign is of
# belief.command (f8): half width of the play [rad], time constants of lag and wash-out [s]; 0: none
HALF_WIDTH, LAG, WASHOUT = range(3)
N_COMMAND_PATH = 3
# a row of the known acceleration's nodes (f8): time [s], acceleration [rad/s^2]
NODE_T, NODE_MOMENT = range(2)
N_KNOWN_NODE = 2
# slope (f8) of the known acceleration for theta, theta_dot, beta
N_SLOPES = 3


@inner
def term_value(code, theta, theta_dot, beta, spread):
    """Return a term at a state; `spread` is the standard deviation of what its sign, if it has one, is of."""
    value = 1.0
    for _ in range(code[0]):
        value *= theta
    for _ in range(code[1]):
        value *= theta_dot
    for _ in range(code[2]):
        value *= beta
    states = (theta, theta_dot, beta)
    argument = states[code[5]]
    if code[4] == SIGN:
        return value * (1.0 - erfc_of(argument / (math.sqrt(2.0) * spread)))
    return value * function_value(code[4], argument)


@inner
def known_acceleration(belief, nodes, fil, work, a6, believed_a6, known_air):
    """Return the known acceleration [rad/s^2] over the step; its slopes into work.known, a6's part into its drive.

    nodes (n, N_KNOWN_NODE)  of what is known in time
    a6, believed_a6 [1/s^2]  the nominal's, and as believed;  known_air [rad]  what is known of alpha beside theta
    """
    if belief.size.known == 0:
        return 0.0
    h, x, reach = fil.step.h, fil.x, fil.step.reach
    middle = fil.time.last + 0.5 * h
    total = sx.air_at(nodes, NODE_MOMENT, middle)
    for j in range(belief.size.sines):
        sine = belief.sines[j]
        swept = sine[1] * h  # the mean over the step is sin(swept/2)/(swept/2) of the value at its middle
        total += sine[0] * sin_of(sine[1] * middle + sine[2]) * (1.0 - swept * swept / 24.0)
    theta, theta_dot, beta = x[0] + 0.5 * h * x[1], x[1], x[2] + 0.5 * h * x[3]
    d = SLOPE_DIFFERENCE
    work.known[:] = 0.0
    for j in range(belief.size.known_terms):
        code, c = belief.known_codes[j], belief.known_coefficient[j]
        spread = math.sqrt(max(fil.p[code[5], code[5]], LEAST_SPREAD * LEAST_SPREAD))
        total += c * term_value(code, theta, theta_dot, beta, spread)
        work.known[0] += c * (term_value(code, theta + d, theta_dot, beta, spread)
                              - term_value(code, theta - d, theta_dot, beta, spread)) / (2.0 * d)
        work.known[1] += c * (term_value(code, theta, theta_dot + d, beta, spread)
                              - term_value(code, theta, theta_dot - d, beta, spread)) / (2.0 * d)
        work.known[2] += c * (term_value(code, theta, theta_dot, beta + d, spread)
                              - term_value(code, theta, theta_dot, beta - d, spread)) / (2.0 * d)
    cubic = belief.cubic
    if cubic != 0.0:
        alpha = theta + known_air
        for j in range(belief.size.nuisances):
            role, nuisance = belief.role[j], x[sx.N_STATES + j]
            if role == WALK or role == TURBULENCE:
                alpha += nuisance
            elif role == ATTITUDE_BIAS:
                alpha -= nuisance
        moment = cubic * alpha * alpha * alpha
        total += believed_a6 * moment
        work.known[0] += believed_a6 * (3.0 * cubic * alpha * alpha)
        work.drive[0, belief.size.theta] += 0.5 * h * reach * (a6 * moment)
        work.drive[1, belief.size.theta] += reach * (a6 * moment)
    return total


@inner
def tilt_transitions(belief, fil, work, f, g):
    """Add to the transition f of the step what the slopes of the known acceleration contribute; to g as well, where the
    covariance has a transition of its own."""
    if belief.size.known == 0:
        return
    h, reach, slope = fil.step.h, fil.step.reach, work.known
    row = (slope[0], slope[1] + 0.5 * h * slope[0], slope[2], 0.5 * h * slope[2])
    for j in range(sx.N_STATES):
        f[0, j] += 0.5 * h * reach * row[j]
        f[1, j] += reach * row[j]
        if belief.constant.held == 1.0:
            g[0, j] += 0.5 * h * reach * row[j]
            g[1, j] += reach * row[j]


@inner
def nozzle_acceleration(belief, fil, u, beta, beta_dot):
    """Return the second-order servo's beta_ddot [rad/s^2] under the command u [rad], without a limit of its rate."""
    constant = belief.constant
    w = fil.servo.frequency if belief.size.servo > 0 else constant.frequency
    damping = fil.servo.damping if belief.size.servo > 0 else constant.damping
    return w * w * (u - beta) - 2.0 * damping * w * beta_dot


@inner
def limited_path(belief, fil, u, limit, reach, out):
    """Move the nozzle over the step by the midpoint rule in LIMIT_PARTS parts; return whether its rate was beyond
    `limit` [rad/s].

    reach [rad/s]  in   that its own rate may run to
    out (4,)       out  double integral and integral of the angle, angle and rate at the end
    """
    h, beta, beta_dot = fil.step.h / LIMIT_PARTS, fil.x[2], fil.x[3]
    time = belief.constant.time_constant
    once, twice, beyond = 0.0, 0.0, False
    for _ in range(LIMIT_PARTS):
        rate = (u - beta) / time if time > 0.0 else beta_dot
        middle = beta + 0.5 * h * min(max(rate, -limit), limit)
        push = 0.0
        if time > 0.0:
            rate = (u - middle) / time
        else:
            first = nozzle_acceleration(belief, fil, u, beta, rate)
            push = nozzle_acceleration(belief, fil, u, middle, rate + 0.5 * h * first)
            rate += 0.5 * h * push
        beyond = beyond or abs(rate) > limit
        twice += h * (once + 0.5 * h * middle)
        once += h * middle
        beta += h * min(max(rate, -limit), limit)
        beta_dot = min(max(beta_dot + h * push, -reach), reach)
    out[0], out[1], out[2], out[3] = twice, once, beta, beta_dot
    return beyond


@inner
def limit_rate(belief, fil, work, u):
    """What the limit of the servo's rate takes from the nozzle over the step, into work.limited (4,): as
    `limited_path`; zeros where it is not reached."""
    if belief.rate_limit == 0.0:
        return
    free, limited = work.unlimited[:], work.limited[:]
    beyond = limited_path(belief, fil, u, belief.rate_limit, belief.rate_reach, limited)
    limited_path(belief, fil, u, np.inf, np.inf, free)
    for i in range(4):
        limited[i] = limited[i] - free[i] if beyond else 0.0


@inner
def add_limit(belief, fil, work, k1):
    """Add what `limit_rate` found to the state, moved as if there were no limit, and to the drive of k1."""
    if belief.rate_limit == 0.0:
        return
    for i in range(2):
        fil.x[i] += k1 * work.limited[i]
        fil.x[2 + i] += work.limited[2 + i]
        work.drive[i, belief.size.beta] += k1 / (1.0 + fil.p_bar[sx.K1]) * work.limited[i]


@inner
def shape_command(belief, fil):
    """Pass the newest command through play, lag and wash-out; a command that is not known moves none of them."""
    u, h, path = fil.command[0], belief.constant.controller_period, belief.command
    if belief.size.shaped == 0 or np.isnan(u):
        return
    if path[HALF_WIDTH] > 0.0:
        fil.shaped[HALF_WIDTH] = max(u - path[HALF_WIDTH], min(u + path[HALF_WIDTH], fil.shaped[HALF_WIDTH]))
        u = fil.shaped[HALF_WIDTH]
    for k in range(LAG, WASHOUT + 1):
        if path[k] > 0.0:  # tau x' = u - x with u held: its mean over the period
            left = exp_of(-h / path[k])
            mean = u + (fil.shaped[k] - u) * (1.0 - left) * path[k] / h
            fil.shaped[k] = u + (fil.shaped[k] - u) * left
            u = mean if k == LAG else u - mean
    fil.command[0] = u
