"""The one step: sensors, controller, log row, Runge-Kutta 4.

`advance` runs any number of steps, so a host loop that takes one sample at a
time and a whole flight run the same code and give the same bits.
"""

from typing import NamedTuple

import numpy as np

from .actuator import delayed_command, nozzle_acceleration
from .controller import pd_command, pseudo_derivative
from .kernels import kernel
from .plant import angular_acceleration
from .sensors import measure

# constant (f8)
(STEP, PERIOD, FREQUENCY, DAMPING, DELAY, LIMIT, KP, KD, TIME_CONSTANT,
 THETA_STEP, THETA_DOT_STEP, BETA_STEP, LOST_ANGLE) = range(13)
N_CONSTANTS = 13
# state (f8)
THETA, THETA_DOT, BETA, BETA_DOT, ERROR, DERIVATIVE, COMMAND = range(7)
N_STATE = 7
# counter (i8)
AT, CONTROL_EVERY, LOG_EVERY, ROWS, LOST = range(5)
N_COUNTERS = 5
# columns of a row
COLUMNS = ("t", "theta_ref", "beta_cmd", "beta", "theta", "theta_dot",
           "true_beta", "true_theta", "true_theta_dot", "true_theta_ddot")


class Vehicle(NamedTuple):
    """One flight: what it is made of, and where it is."""

    constant: np.ndarray        # (N_CONSTANTS,)
    state: np.ndarray           # (N_STATE,)
    counter: np.ndarray         # (N_COUNTERS,) int64
    a6: np.ndarray              # (2 steps + 1,) at every half step, 1/s^2
    k1: np.ndarray              # (2 steps + 1,)
    reference: np.ndarray       # (ticks,) rad
    command_noise: np.ndarray   # (ticks,) rad
    acceleration: np.ndarray    # (ticks,) rad/s^2
    theta_noise: np.ndarray     # (steps,) rad
    theta_dot_noise: np.ndarray  # (steps,) rad/s
    beta_noise: np.ndarray      # (steps,) rad
    commands: np.ndarray        # (ticks,) rad, command plus noise, filled as it flies


@kernel
def control(v, i, tick):
    """The controller's period begins: measure the attitude, command the nozzle."""
    c, x = v.constant, v.state
    error = measure(x[THETA], v.theta_noise[i], c[THETA_STEP]) - v.reference[tick]
    if tick == 0:
        x[ERROR] = error
    x[DERIVATIVE] = pseudo_derivative(c[TIME_CONSTANT], c[PERIOD], error, x[ERROR], x[DERIVATIVE])
    x[ERROR] = error
    x[COMMAND] = pd_command(c[KP], c[KD], c[LIMIT], error, x[DERIVATIVE])
    v.commands[tick] = x[COMMAND] + v.command_noise[tick]


@kernel
def write_row(v, i, tick, row):
    """Measured and true values at the start of step i."""
    c, x = v.constant, v.state
    row[0] = i * c[STEP]
    row[1] = v.reference[tick]
    row[2] = x[COMMAND]
    row[3] = measure(x[BETA], v.beta_noise[i], c[BETA_STEP])
    row[4] = measure(x[THETA], v.theta_noise[i], c[THETA_STEP])
    row[5] = measure(x[THETA_DOT], v.theta_dot_noise[i], c[THETA_DOT_STEP])
    row[6] = x[BETA]
    row[7] = x[THETA]
    row[8] = x[THETA_DOT]
    row[9] = angular_acceleration(v.a6[2 * i], v.k1[2 * i], x[THETA], x[BETA], v.acceleration[tick])


@kernel
def runge_kutta_4(v, i, u, disturbance):
    """One step of the classical fourth-order scheme for theta, theta_dot, beta, beta_dot.

    u [rad] is the actuator's input and `disturbance` [rad/s^2] the unmodelled acceleration, both held.
    """
    c, x = v.constant, v.state
    h = c[STEP]
    w, zeta = c[FREQUENCY], c[DAMPING]
    th, q, b, r = x[THETA], x[THETA_DOT], x[BETA], x[BETA_DOT]
    a_0, a_1, a_2 = v.a6[2 * i], v.a6[2 * i + 1], v.a6[2 * i + 2]
    k_0, k_1, k_2 = v.k1[2 * i], v.k1[2 * i + 1], v.k1[2 * i + 2]

    q1 = angular_acceleration(a_0, k_0, th, b, disturbance)
    r1 = nozzle_acceleration(w, zeta, u, b, r)
    th2, qq2, b2, rr2 = th + 0.5 * h * q, q + 0.5 * h * q1, b + 0.5 * h * r, r + 0.5 * h * r1
    q2 = angular_acceleration(a_1, k_1, th2, b2, disturbance)
    r2 = nozzle_acceleration(w, zeta, u, b2, rr2)
    th3, qq3, b3, rr3 = th + 0.5 * h * qq2, q + 0.5 * h * q2, b + 0.5 * h * rr2, r + 0.5 * h * r2
    q3 = angular_acceleration(a_1, k_1, th3, b3, disturbance)
    r3 = nozzle_acceleration(w, zeta, u, b3, rr3)
    th4, qq4, b4, rr4 = th + h * qq3, q + h * q3, b + h * rr3, r + h * r3
    q4 = angular_acceleration(a_2, k_2, th4, b4, disturbance)
    r4 = nozzle_acceleration(w, zeta, u, b4, rr4)

    x[THETA] = th + h / 6.0 * (q + 2.0 * qq2 + 2.0 * qq3 + qq4)
    x[THETA_DOT] = q + h / 6.0 * (q1 + 2.0 * q2 + 2.0 * q3 + q4)
    x[BETA] = b + h / 6.0 * (r + 2.0 * rr2 + 2.0 * rr3 + rr4)
    x[BETA_DOT] = r + h / 6.0 * (r1 + 2.0 * r2 + 2.0 * r3 + r4)


@kernel
def advance(v, steps, rows):
    """Fly `steps` steps and write the log rows that fall due.

    v            inout
    steps        in    how many steps, at most what is left
    rows  (r, 10) out   from index counter[ROWS] on
    Stops early when the attitude leaves +-LOST_ANGLE (counter[LOST] = 1).
    """
    c, n = v.constant, v.counter
    for _ in range(steps):
        i = n[AT]
        tick = i // n[CONTROL_EVERY]
        phase = i - tick * n[CONTROL_EVERY]
        if not abs(v.state[THETA]) <= c[LOST_ANGLE]:
            n[LOST] = 1
            return
        if phase == 0:
            control(v, i, tick)
        if i % n[LOG_EVERY] == 0:
            write_row(v, i, tick, rows[n[ROWS]])
            n[ROWS] += 1
        u = delayed_command(v.commands, tick, phase * c[STEP], c[STEP], c[PERIOD], c[DELAY])
        runge_kutta_4(v, i, u, v.acceleration[tick])
        n[AT] = i + 1
