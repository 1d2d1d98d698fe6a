"""The one step: sensors, controller, log row, Runge-Kutta 4.

`advance` runs any number of steps, so a host loop that takes one sample at a
time and a whole flight run the same code and give the same bits.

Effects act at five places, which this file asks by name (`sim.effects.plant`, ...);
what an effect does it does not know.  Without effects every place answers with its
neutral element, and so do wind and drift where there are none.
"""

from typing import NamedTuple

import numpy as np

from ..effects import actuator, controller, environment, plant, sensor
from ..effects.table import empty_table
from .actuator import (
    RESOLVED,
    as_line,
    delayed_command,
    fastest_pole,
    free_servo,
    lag_slopes,
    parts_of,
    servo_motion,
    servo_slopes,
)
from .controller import N_SECTION, filtered, limited, pd_law, pi_law, pseudo_derivative
from .kernels import inner, kernel
from .plant import angle_of_attack, angular_acceleration, drift_rate
from .sensors import measure

# constant (f8); FIRST_ORDER and RATE_LAW: 1 yes, 0 no; of a stiff servo behind them the part [s] and the frequency
# [rad/s] of its last step, and the four numbers that follow of them, which most steps share
(STEP, PERIOD, FREQUENCY, DAMPING, DELAY, LIMIT, KP, KD, TIME_CONSTANT,
 THETA_STEP, THETA_DOT_STEP, BETA_STEP, LOST_ANGLE, FIRST_ORDER, RATE_LAW, KI, PART, PART_OF) = range(18)
FREE = 18
N_CONSTANTS = 22
# state (f8)
THETA, THETA_DOT, BETA, BETA_DOT, ERROR, DERIVATIVE, COMMAND, GAMMA, INTEGRAL = range(9)
N_STATE = 9
# counter (i8)
AT, CONTROL_EVERY, LOG_EVERY, ROWS, LOST = range(5)
N_COUNTERS = 5
# columns of a row; exact: as the sensor reads it without noise and quantisation; true: of the rigid body and the nozzle
COLUMNS = ("t", "theta_ref", "beta_cmd", "beta", "theta", "theta_dot",
           "exact_beta", "exact_theta", "exact_theta_dot", "true_theta_ddot", "true_gamma", "wind",
           "true_theta", "true_theta_dot", "true_beta", "true_beta_dot")
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
    wind: np.ndarray = np.zeros(0)         # (steps + 1,) rad at every step, without the effects', or (0,): calm
    drift: np.ndarray = np.zeros((2, 0))   # z_alpha, z_beta (2, 2 steps + 1) 1/s at every half step, or (2, 0): none
    rate_reference: np.ndarray = np.zeros(0)        # (ticks,) rad/s, of the law `rate`
    filters: np.ndarray = np.zeros((0, N_SECTION))  # the controller's sections, with what they remember


@inner
def attitude(v, i):
    """The reading of the attitude sensor at step i, without noise [rad]."""
    theta = v.state[THETA] + plant.deflection(v.plant)[0]
    return sensor.attitude(v.sensor, v.history, i, v.constant[STEP], theta)


@inner
def gyro(v, i):
    """The reading of the gyro at step i, without noise [rad/s]."""
    theta_dot = v.state[THETA_DOT] + plant.deflection(v.plant)[1]
    return sensor.gyro(v.sensor, v.history, i, v.constant[STEP], theta_dot)


@inner
def remember(v, i):
    """Keep attitude and rate where the sensors sit; theirs may be late."""
    eta, eta_dot = plant.deflection(v.plant)
    v.history[sensor.ATTITUDE, i] = v.state[THETA] + eta
    v.history[sensor.RATE, i] = v.state[THETA_DOT] + eta_dot


@inner
def attitude_law(v, i, tick):
    """PD of the measured attitude's error [rad]."""
    c, x = v.constant, v.state
    error = measure(attitude(v, i), v.theta_noise[i], c[THETA_STEP]) - v.reference[tick]
    if tick == 0:
        x[ERROR] = error
    x[DERIVATIVE] = pseudo_derivative(c[TIME_CONSTANT], c[PERIOD], error, x[ERROR], x[DERIVATIVE])
    x[ERROR] = error
    kp, kd = controller.gains(v.controller, c[KP], c[KD])
    return pd_law(kp, kd, error, x[DERIVATIVE])


@inner
def rate_law(v, i, tick):
    """PI of the measured rate's error [rad], the integral with the current sample."""
    c, x = v.constant, v.state
    error = measure(gyro(v, i), v.theta_dot_noise[i], c[THETA_DOT_STEP]) - v.rate_reference[tick]
    x[INTEGRAL] += c[PERIOD] * error
    return pi_law(controller.gains(v.controller, c[KP], 0.0)[0], c[KI], error, x[INTEGRAL])


@inner
def control(v, i, tick):
    """The controller's period begins: measure, command the nozzle; what limits the command holds the integral."""
    c, x = v.constant, v.state
    integral = x[INTEGRAL]
    command = attitude_law(v, i, tick) if c[RATE_LAW] == 0.0 else rate_law(v, i, tick)
    command = filtered(v.filters, command) + v.excitation[tick]
    v.computed[tick] = limited(c[LIMIT], command)
    if v.computed[tick] != command:
        x[INTEGRAL] = integral
    x[COMMAND] = delayed_command(v.computed, tick, 0.0, c[PERIOD], c[PERIOD], controller.latency(v.controller))
    v.commands[tick] = x[COMMAND] + v.command_noise[tick]


@inner
def acceleration(moments, winds, a6, k1, t, disturbance, alpha, theta, theta_dot, beta, beta_ddot):
    """theta_ddot [rad/s^2] of a state at t [s]: rigid body, plant's effects (n, columns), environment's.

    alpha [rad]  angle of attack without the environment's effects, which add their own
    """
    return (angular_acceleration(a6, k1, alpha, beta, disturbance)
            + plant.acceleration(moments, a6, k1, alpha, theta, theta_dot, beta)
            + environment.acceleration(winds, a6, t)
            + plant.moment_over_time(moments, t) + plant.reaction(moments, beta_ddot))


@inner
def drifting(v, half, t, alpha, beta):
    """gamma_dot [rad/s] of a state at t [s], the half step `half`; alpha as in `acceleration`."""
    z_alpha, z_beta = plant.drift(v.plant)
    if v.drift.shape[1] > 0:
        z_alpha, z_beta = z_alpha + v.drift[0, half], z_beta + v.drift[1, half]
    elif z_alpha == 0.0 and z_beta == 0.0:
        return 0.0
    return drift_rate(z_alpha, z_beta, alpha + environment.wind(v.environment, t),
                      beta + plant.misalignment(v.plant))


@inner
def wind_at(v, i):
    """Wind [rad] at step i without the effects'; -0.0 if calm."""
    return v.wind[i] if v.wind.shape[0] > 0 else -0.0


@inner
def servo_flow(c, w, rate, reach, command, beta, beta_dot):
    """(beta', beta_dot', the nozzle's own acceleration) of the servo of natural frequency w [rad/s], or time constant
    1/w.  A nozzle at its rate limit does not accelerate; a command that jumps is `jolt`'s."""
    if c[FIRST_ORDER] != 0.0:
        moved, still = lag_slopes(w, rate, command, beta)
        return moved, still, -w * moved if abs(moved) < rate else 0.0
    moved, beta_ddot = servo_slopes(w, c[DAMPING], rate, reach, command, beta, beta_dot)
    return moved, beta_ddot, beta_ddot if abs(beta_dot) <= rate else 0.0


@inner
def jolt(v, w, rate, u):
    """A command u that jumps makes the rate of a first-order servo's nozzle jump, whose inertia then turns the vehicle
    at once; of such a servo state[BETA_DOT] is the rate before."""
    x = v.state
    jump = plant.reaction(v.plant, lag_slopes(w, rate, u, x[BETA])[0] - x[BETA_DOT])
    x[THETA_DOT] += jump
    plant.jolt_modes(v.plant, jump)


@inner
def write_row(v, i, tick, u, row):
    """Measured and true values at the start of step i, over which the servo's input is u [rad]."""
    c, x = v.constant, v.state
    w, rate, reach = actuator.servo(v.actuator, c[FREQUENCY], c[DAMPING])
    beta_ddot = servo_flow(c, w, rate, reach, u, x[BETA], x[BETA_DOT])[2]
    row[6] = sensor.nozzle(v.sensor, x[BETA])
    row[7] = attitude(v, i)
    row[8] = gyro(v, i)
    wind, t = wind_at(v, i), i * c[STEP]
    row[9] = acceleration(v.plant, v.environment, v.a6[2 * i], v.k1[2 * i], t, v.acceleration[tick],
                          angle_of_attack(x[THETA], x[GAMMA], wind), x[THETA], x[THETA_DOT], x[BETA], beta_ddot)
    row[10] = x[GAMMA]
    row[11] = wind + environment.wind(v.environment, t) + 0.0  # 0.0, not -0.0, if calm
    row[12], row[13], row[14], row[15] = x[THETA], x[THETA_DOT], x[BETA], x[BETA_DOT]
    row[0] = t
    row[1] = v.reference[tick]
    row[2] = x[COMMAND]
    row[3] = measure(row[6], v.beta_noise[i], c[BETA_STEP])
    row[4] = measure(row[7], v.theta_noise[i], c[THETA_STEP])
    row[5] = measure(row[8], v.theta_dot_noise[i], c[THETA_DOT_STEP])


@inner
def nozzle_stages(c, w, rate, reach, u, h, b, r):
    """(beta of the four stages, the nozzle's acceleration of the four, beta and beta_dot at the end) of a Runge-Kutta
    step of h [s] from beta b [rad] and beta_dot r [rad/s]: of a servo that the step resolves."""
    s1, r1, n1 = servo_flow(c, w, rate, reach, u, b, r)
    b2, rr2 = b + 0.5 * h * s1, r + 0.5 * h * r1
    s2, r2, n2 = servo_flow(c, w, rate, reach, u, b2, rr2)
    b3, rr3 = b + 0.5 * h * s2, r + 0.5 * h * r2
    s3, r3, n3 = servo_flow(c, w, rate, reach, u, b3, rr3)
    b4, rr4 = b + h * s3, r + h * r3
    s4, r4, n4 = servo_flow(c, w, rate, reach, u, b4, rr4)
    return (b, b2, b3, b4, n1, n2, n3, n4, b + h / 6.0 * (s1 + 2.0 * s2 + 2.0 * s3 + s4),
            actuator.limited_rate(reach, r + h / 6.0 * (r1 + 2.0 * r2 + 2.0 * r3 + r4)))


@inner
def stiff_stages(c, w, rate, reach, u, h, b, r):
    """The same of a stiff servo: the lines that its motion and its rate's are to the vehicle (`vehicle.actuator`); the
    jolt of a command that jumps is in them."""
    is_lag = c[FIRST_ORDER] != 0.0
    parts = parts_of(fastest_pole(w, c[DAMPING]), rate, h)
    if c[PART] != h / parts or c[PART_OF] != w:
        c[PART], c[PART_OF] = h / parts, w
        c[FREE], c[FREE + 1], c[FREE + 2], c[FREE + 3] = free_servo(w, c[DAMPING], is_lag, h / parts)
    end, end_rate, once, twice = servo_motion(w, c[DAMPING], is_lag, rate, reach, c[FREE:], parts, h, u, b, r)
    before = actuator.limited_rate(rate, r)
    after = servo_flow(c, w, rate, reach, u, end, end_rate)[0]
    b1, b2, b4 = as_line(h, once, twice)
    n1, n2, n4 = as_line(h, after - before, end - b - h * before)
    return b1, b2, b2, b4, n1, n2, n2, n4, end, end_rate


@inner
def runge_kutta_4(v, i, n, u, disturbance):
    """One step of the classical fourth-order scheme for theta, theta_dot, beta, beta_dot, gamma and the plant's modes,
    n of the flight's steps long; of a stiff servo beta and beta_dot are exact.

    u [rad] is the servo's input and `disturbance` [rad/s^2] the unmodelled acceleration, both held; the wind is linear
    over the step.  In a stage: q = theta_dot, b = beta, al = the angle of attack, g = gamma; q1 and g1 their
    derivatives; n1 the nozzle's acceleration.
    """
    c, x, modes, winds = v.constant, v.state, v.plant, v.environment
    h, t = n * c[STEP], i * c[STEP]
    w, rate, reach = actuator.servo(v.actuator, c[FREQUENCY], c[DAMPING])
    stiff = fastest_pole(w, c[DAMPING]) * h > RESOLVED
    if c[FIRST_ORDER] != 0.0 and not stiff:
        jolt(v, w, rate, u)
    th, q, g = x[THETA], x[THETA_DOT], x[GAMMA]
    a_0, a_1, a_2 = v.a6[2 * i], v.a6[2 * i + n], v.a6[2 * (i + n)]
    k_0, k_1, k_2 = v.k1[2 * i], v.k1[2 * i + n], v.k1[2 * (i + n)]
    w_0, w_2 = wind_at(v, i), wind_at(v, i + n)
    w_1 = 0.5 * (w_0 + w_2)
    plant.begin_modes(modes)
    if stiff:
        b, b2, b3, b4, n1, n2, n3, n4, end, end_rate = stiff_stages(c, w, rate, reach, u, h, x[BETA], x[BETA_DOT])
    else:
        b, b2, b3, b4, n1, n2, n3, n4, end, end_rate = nozzle_stages(c, w, rate, reach, u, h, x[BETA], x[BETA_DOT])

    al = angle_of_attack(th, g, w_0)
    q1 = acceleration(modes, winds, a_0, k_0, t, disturbance, al, th, q, b, n1)
    g1 = drifting(v, 2 * i, t, al, b)
    plant.advance_modes(modes, 1.0, 0.5 * h, q1, b)
    th2, qq2 = th + 0.5 * h * q, q + 0.5 * h * q1
    al2 = angle_of_attack(th2, g + 0.5 * h * g1, w_1)
    q2 = acceleration(modes, winds, a_1, k_1, t + 0.5 * h, disturbance, al2, th2, qq2, b2, n2)
    g2 = drifting(v, 2 * i + n, t + 0.5 * h, al2, b2)
    plant.advance_modes(modes, 2.0, 0.5 * h, q2, b2)
    th3, qq3 = th + 0.5 * h * qq2, q + 0.5 * h * q2
    al3 = angle_of_attack(th3, g + 0.5 * h * g2, w_1)
    q3 = acceleration(modes, winds, a_1, k_1, t + 0.5 * h, disturbance, al3, th3, qq3, b3, n3)
    g3 = drifting(v, 2 * i + n, t + 0.5 * h, al3, b3)
    plant.advance_modes(modes, 2.0, h, q3, b3)
    th4, qq4 = th + h * qq3, q + h * q3
    al4 = angle_of_attack(th4, g + h * g3, w_2)
    q4 = acceleration(modes, winds, a_2, k_2, t + h, disturbance, al4, th4, qq4, b4, n4)
    g4 = drifting(v, 2 * (i + n), t + h, al4, b4)
    plant.advance_modes(modes, 1.0, h, q4, b4)

    plant.end_modes(modes, h)
    x[THETA] = th + h / 6.0 * (q + 2.0 * qq2 + 2.0 * qq3 + qq4)
    x[THETA_DOT] = q + h / 6.0 * (q1 + 2.0 * q2 + 2.0 * q3 + q4)
    x[BETA], x[BETA_DOT] = end, end_rate
    x[GAMMA] = g + h / 6.0 * (g1 + 2.0 * g2 + 2.0 * g3 + g4)
    if c[FIRST_ORDER] != 0.0:
        x[BETA_DOT] = lag_slopes(w, rate, u, x[BETA])[0]


@kernel
def advance(v, steps, rows):
    """Fly `steps` steps and write the log rows that fall due.

    v            inout
    steps        in    how many steps, at most what is left
    rows  (r, 16) out   from index counter[ROWS] on
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
        u = delayed_command(v.commands, tick, phase * c[STEP], c[STEP], c[PERIOD], delay)
        u = actuator.command(servo_input, c[FREQUENCY], c[DAMPING], c[STEP], u)
        if i % n[LOG_EVERY] == 0:
            write_row(v, i, tick, u, rows[n[ROWS]])
            n[ROWS] += 1
        runge_kutta_4(v, i, 1, u, v.acceleration[tick])
        n[AT] = i + 1
