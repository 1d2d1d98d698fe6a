"""The one step: sensors, controller, log row, Runge-Kutta 4.

`advance` runs any number of steps, so a host loop that takes one sample at a
time and a whole flight run the same code and give the same bits.

Effects act at five places, which this file asks by name (`sim.effects.plant`, ...);
what an effect does it does not know.  Without effects every place answers with its
neutral element.
"""

from typing import NamedTuple

import numpy as np

from ..effects import actuator, controller, environment, plant, sensor
from ..effects.table import empty_table
from .actuator import delayed_command, servo_slopes
from .controller import pd_command, pseudo_derivative
from .kernels import inner, kernel
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
# columns of a row; exact: as the sensor reads it without noise and quantisation
COLUMNS = ("t", "theta_ref", "beta_cmd", "beta", "theta", "theta_dot",
           "exact_beta", "exact_theta", "exact_theta_dot", "true_theta_ddot")
NO_EFFECT = empty_table()


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
    computed: np.ndarray = np.zeros(0)     # (ticks,) rad, the controller's commands, filled as it flies
    excitation: np.ndarray = np.zeros(0)   # (ticks,) rad, the test input
    history: np.ndarray = np.zeros((2, 0))  # (2, steps) attitude and rate at the sensors, or (2, 0): no sensor effect
    # effects, (n, columns of `sim.effects.table`) each
    plant: np.ndarray = NO_EFFECT.plant
    environment: np.ndarray = NO_EFFECT.environment
    actuator: np.ndarray = NO_EFFECT.actuator
    sensor: np.ndarray = NO_EFFECT.sensor
    controller: np.ndarray = NO_EFFECT.controller


@inner
def attitude(v, i):
    """What the attitude sensor makes of step i, without noise [rad]."""
    theta = v.state[THETA] + plant.deflection(v.plant)[0]
    return sensor.attitude(v.sensor, v.history, i, v.constant[STEP], theta)


@inner
def gyro(v, i):
    """What the gyro makes of step i, without noise [rad/s]."""
    theta_dot = v.state[THETA_DOT] + plant.deflection(v.plant)[1]
    return sensor.gyro(v.sensor, v.history, i, v.constant[STEP], theta_dot)


@inner
def remember(v, i):
    """Keep attitude and rate where the sensors sit; theirs may be late."""
    eta, eta_dot = plant.deflection(v.plant)
    v.history[sensor.ATTITUDE, i] = v.state[THETA] + eta
    v.history[sensor.RATE, i] = v.state[THETA_DOT] + eta_dot


@inner
def control(v, i, tick):
    """The controller's period begins: measure the attitude, command the nozzle."""
    c, x = v.constant, v.state
    error = measure(attitude(v, i), v.theta_noise[i], c[THETA_STEP]) - v.reference[tick]
    if tick == 0:
        x[ERROR] = error
    x[DERIVATIVE] = pseudo_derivative(c[TIME_CONSTANT], c[PERIOD], error, x[ERROR], x[DERIVATIVE])
    x[ERROR] = error
    kp, kd = controller.gains(v.controller, c[KP], c[KD])
    v.computed[tick] = pd_command(kp, kd, c[LIMIT], error, x[DERIVATIVE], v.excitation[tick])
    x[COMMAND] = delayed_command(v.computed, tick, 0.0, c[PERIOD], c[PERIOD], controller.latency(v.controller))
    v.commands[tick] = x[COMMAND] + v.command_noise[tick]


@inner
def acceleration(moments, winds, a6, k1, t, disturbance, theta, theta_dot, beta):
    """theta_ddot [rad/s^2] of a state at t [s]: rigid body, plant's effects (n, columns), environment's."""
    return (angular_acceleration(a6, k1, theta, beta, disturbance)
            + plant.acceleration(moments, a6, k1, theta, theta_dot, beta) + environment.acceleration(winds, a6, t))


@inner
def write_row(v, i, tick, row):
    """Measured and true values at the start of step i."""
    c, x = v.constant, v.state
    row[6] = sensor.nozzle(v.sensor, x[BETA])
    row[7] = attitude(v, i)
    row[8] = gyro(v, i)
    row[9] = acceleration(v.plant, v.environment, v.a6[2 * i], v.k1[2 * i], i * c[STEP], v.acceleration[tick],
                          x[THETA], x[THETA_DOT], x[BETA])
    row[0] = i * c[STEP]
    row[1] = v.reference[tick]
    row[2] = x[COMMAND]
    row[3] = measure(row[6], v.beta_noise[i], c[BETA_STEP])
    row[4] = measure(row[7], v.theta_noise[i], c[THETA_STEP])
    row[5] = measure(row[8], v.theta_dot_noise[i], c[THETA_DOT_STEP])


@inner
def runge_kutta_4(v, i, u, disturbance):
    """One step of the classical fourth-order scheme for theta, theta_dot, beta, beta_dot and the plant's modes.

    u [rad] is the servo's input and `disturbance` [rad/s^2] the unmodelled acceleration, both held.
    In a stage: q = theta_dot, r = the servo's rate, s = beta' (r within its limit), q1 and r1 their derivatives.
    """
    c, x, modes, winds = v.constant, v.state, v.plant, v.environment
    h, t, zeta = c[STEP], i * c[STEP], c[DAMPING]
    w, rate, reach = actuator.servo(v.actuator, c[FREQUENCY], zeta)
    th, q, b, r = x[THETA], x[THETA_DOT], x[BETA], x[BETA_DOT]
    a_0, a_1, a_2 = v.a6[2 * i], v.a6[2 * i + 1], v.a6[2 * i + 2]
    k_0, k_1, k_2 = v.k1[2 * i], v.k1[2 * i + 1], v.k1[2 * i + 2]
    plant.begin_modes(modes)

    q1 = acceleration(modes, winds, a_0, k_0, t, disturbance, th, q, b)
    s1, r1 = servo_slopes(w, zeta, rate, reach, u, b, r)
    plant.advance_modes(modes, 1.0, 0.5 * h, q1, b)
    th2, qq2, b2, rr2 = th + 0.5 * h * q, q + 0.5 * h * q1, b + 0.5 * h * s1, r + 0.5 * h * r1
    q2 = acceleration(modes, winds, a_1, k_1, t + 0.5 * h, disturbance, th2, qq2, b2)
    s2, r2 = servo_slopes(w, zeta, rate, reach, u, b2, rr2)
    plant.advance_modes(modes, 2.0, 0.5 * h, q2, b2)
    th3, qq3, b3, rr3 = th + 0.5 * h * qq2, q + 0.5 * h * q2, b + 0.5 * h * s2, r + 0.5 * h * r2
    q3 = acceleration(modes, winds, a_1, k_1, t + 0.5 * h, disturbance, th3, qq3, b3)
    s3, r3 = servo_slopes(w, zeta, rate, reach, u, b3, rr3)
    plant.advance_modes(modes, 2.0, h, q3, b3)
    th4, qq4, b4, rr4 = th + h * qq3, q + h * q3, b + h * s3, r + h * r3
    q4 = acceleration(modes, winds, a_2, k_2, t + h, disturbance, th4, qq4, b4)
    s4, r4 = servo_slopes(w, zeta, rate, reach, u, b4, rr4)
    plant.advance_modes(modes, 1.0, h, q4, b4)

    plant.end_modes(modes, h)
    x[THETA] = th + h / 6.0 * (q + 2.0 * qq2 + 2.0 * qq3 + qq4)
    x[THETA_DOT] = q + h / 6.0 * (q1 + 2.0 * q2 + 2.0 * q3 + q4)
    x[BETA] = b + h / 6.0 * (s1 + 2.0 * s2 + 2.0 * s3 + s4)
    x[BETA_DOT] = actuator.limited_rate(reach, r + h / 6.0 * (r1 + 2.0 * r2 + 2.0 * r3 + r4))


@kernel
def advance(v, steps, rows):
    """Fly `steps` steps and write the log rows that fall due.

    v            inout
    steps        in    how many steps, at most what is left
    rows  (r, 10) out   from index counter[ROWS] on
    Stops early when the attitude leaves +-LOST_ANGLE (counter[LOST] = 1).
    """
    c, n, servo_input = v.constant, v.counter, v.actuator
    delay = c[DELAY] + actuator.latency(servo_input)
    remembers = v.history.shape[1] > 0
    for _ in range(steps):
        i = n[AT]
        tick = i // n[CONTROL_EVERY]
        phase = i - tick * n[CONTROL_EVERY]
        if not abs(v.state[THETA]) <= c[LOST_ANGLE]:
            n[LOST] = 1
            return
        if remembers:
            remember(v, i)
        if phase == 0:
            control(v, i, tick)
        if i % n[LOG_EVERY] == 0:
            write_row(v, i, tick, rows[n[ROWS]])
            n[ROWS] += 1
        u = delayed_command(v.commands, tick, phase * c[STEP], c[STEP], c[PERIOD], delay)
        u = actuator.command(servo_input, c[FREQUENCY], c[DAMPING], c[STEP], u)
        runge_kutta_4(v, i, u, v.acceleration[tick])
        n[AT] = i + 1
