"""One integration step of a flight: sensors, controller, log row, Runge-Kutta 4.

`advance` runs any number of steps, so a host loop that takes one sample at a
time and a whole flight run the same code and give the same bits.

Effects act at five places, which this file calls by name (`sim.effects.plant`, ...);
it does not know single effects.

Assumptions: small angles, one plane, wind as an angle.
"""

import math

from ..effects import actuator, environment, plant, sensor
from ..kernels import apart, inner
from .actuator import POLE_STEP, delayed_command, lag_rate, nozzle_stages, servo_flow
from .controller import GYRO_LAW, RATE_LAW, filtered, limited, pseudo_derivative


@inner
def measure(truth, noise, step):
    """Return truth + noise, rounded to a multiple of `step` (0: not quantised)."""
    value = truth + noise
    return step * math.floor(value / step + 0.5) if step > 0.0 else value


@inner
def control(v, now, noise, filters, computed, commands, tick, theta, theta_dot):
    """Run the controller at the start of period `tick`; write computed[tick], and with noise commands[tick] [rad].

    PD of the attitude's error, its derivative made of the attitude or the gyro's; or PI of the rate's error with the
    current sample in the integral, which a limited command does not change; then the test input.
    """
    integral = v.integral
    if v.law != RATE_LAW:
        error = measure(theta, noise.theta, v.theta_step) - now.reference
        if v.law == GYRO_LAW:
            v.derivative = measure(theta_dot, noise.theta_dot, v.theta_dot_step) - now.rate_reference
        else:
            if tick == 0:
                v.error = error
            v.derivative = pseudo_derivative(v.time_constant, v.period, error, v.error, v.derivative)
            v.error = error
        command = v.kp * error + v.kd * v.derivative
    else:
        error = measure(theta_dot, noise.theta_dot, v.theta_dot_step) - now.rate_reference
        v.integral += v.period * error
        command = v.kp * error + v.ki * v.integral
    command = filtered(filters, command) + now.excitation
    computed[tick] = limited(v.limit, command)
    if computed[tick] != command:
        v.integral = integral
    v.command = delayed_command(computed, tick, 0.0, v.period, v.period, v.computing_time)
    commands[tick] = v.command + now.noise


@inner
def acceleration(v, modes, terms, timed, a6, k1, t, disturbance, alpha, theta, theta_dot, beta, beta_ddot):
    """Return (theta_ddot [rad/s^2], wind of the effects [rad]) in a state at t [s].

    Rigid body (Navarro-Tapia et al., eq. 8), the plant's effects, the air's, and the swung engine's reaction, tail wags
    dog: nozzle_inertia = -(I_R + m_R l_R l_c)/J (NASA CR-826, A.2: inertia, mass and arm of the engine about its
    gimbal, J of the vehicle, l_c from its centre of mass to the gimbal).

    alpha [rad]   theta - gamma + wind, without the effects' wind
    """
    moment, begun, wind = environment.air(v, timed, a6, t)
    own = plant.acceleration(v, modes, terms, a6, k1, alpha, theta, theta_dot, beta)
    return a6 * alpha + k1 * beta + disturbance + own + moment + begun + v.nozzle_inertia * beta_ddot, wind


@inner
def drift_rate(v, drift, half, alpha, beta):
    """Return gamma_dot [rad/s] = z_alpha alpha + z_beta beta at half step `half`: lift, thrust over mass and speed."""
    if drift is None:
        return 0.0
    z_alpha, z_beta = v.z_alpha, v.z_beta
    if drift.shape[1] > 0:
        z_alpha, z_beta = z_alpha + drift[0, half], z_beta + drift[1, half]
    return z_alpha * alpha + z_beta * (beta + v.thrust_misalignment)


@inner
def wind_at(wind, i):
    """Return the wind [rad] at step i, without that of effects; -0.0 if it is calm."""
    return -0.0 if wind is None else wind[i]


@inner
def runge_kutta_4(f, i, n, u, disturbance):
    """Integrate theta, theta_dot, gamma and the plant's modes from step i over n steps at once, by the classical
    fourth-order scheme.  The nozzle is moved first, since the vehicle's motion does not act on it.

    f (`Vehicle`) is inout; u [rad] is the servo's input and `disturbance` [rad/s^2] the unmodelled acceleration, both
    held; the wind is linear over the step.
    """
    v = f.flight[0]
    h, t = n * v.step, i * v.step
    jump = 0.0
    if v.first_order != 0 and v.pole * h <= POLE_STEP:  # its inertia turns the vehicle at once; beta_dot: before
        jump = v.nozzle_inertia * (lag_rate(v, u, v.beta) - v.beta_dot)
    v.theta_dot += jump
    plant.begin_modes(f.modes, jump)
    nozzle_stages(v, f.free, f.stages, u, h)
    wind_0, wind_2 = wind_at(f.wind, i), wind_at(f.wind, i + n)
    half, time, wind = 2 * i, t, wind_0
    theta, theta_dot, gamma = v.theta, v.theta_dot, v.gamma
    theta_sum, theta_dot_sum, gamma_sum = -0.0, -0.0, -0.0
    for s in range(4):
        beta, alpha = f.stages[s].beta, theta - gamma + wind
        theta_ddot, blown = acceleration(v, f.modes, f.terms, f.timed, f.a6[half], f.k1[half], time, disturbance,
                                         alpha, theta, theta_dot, beta, f.stages[s].beta_ddot)
        gamma_dot = drift_rate(v, f.drift, half, alpha + blown, beta)
        weight, on = 1.0 if s == 0 or s == 3 else 2.0, 0.5 * h if s < 2 else h
        plant.advance_modes(f.modes, weight, on, theta_ddot, beta)
        theta_sum += weight * theta_dot
        theta_dot_sum += weight * theta_ddot
        gamma_sum += weight * gamma_dot
        theta, theta_dot, gamma = v.theta + on * theta_dot, v.theta_dot + on * theta_ddot, v.gamma + on * gamma_dot
        if s < 2:
            half, time, wind = 2 * i + n, t + on, 0.5 * (wind_0 + wind_2)
        else:
            half, time, wind = 2 * (i + n), t + on, wind_2
    plant.end_modes(f.modes, h)
    v.theta += h / 6.0 * theta_sum
    v.theta_dot += h / 6.0 * theta_dot_sum
    v.gamma += h / 6.0 * gamma_sum
    if v.first_order != 0:
        v.beta_dot = lag_rate(v, u, v.beta)


@inner
def write_row(f, i, tick, u, theta, theta_dot, row):
    """Write measured and true values at the start of step i to `row`; u [rad] the servo's input over the step; theta,
    theta_dot as the sensors show them."""
    v, noise, now, wind = f.flight[0], f.noise[i], f.ticks[tick], wind_at(f.wind, i)
    t, alpha = i * v.step, v.theta - v.gamma + wind
    beta_ddot = servo_flow(v, u, v.beta, v.beta_dot)[2]
    row.t, row.theta_ref, row.beta_cmd = t, now.reference, v.command
    row.exact_beta, row.exact_theta, row.exact_theta_dot = v.beta + v.nozzle_sensor_bias, theta, theta_dot
    row.beta = measure(row.exact_beta, noise.beta, v.beta_step)
    row.theta = measure(theta, noise.theta, v.theta_step)
    row.theta_dot = measure(theta_dot, noise.theta_dot, v.theta_dot_step)
    row.true_theta_ddot, blown = acceleration(v, f.modes, f.terms, f.timed, f.a6[2 * i], f.k1[2 * i], t,
                                              now.acceleration, alpha, v.theta, v.theta_dot, v.beta, beta_ddot)
    row.true_gamma, row.wind = v.gamma, wind + blown + 0.0  # 0.0, not -0.0, if calm
    row.true_theta, row.true_theta_dot, row.true_beta, row.true_beta_dot = v.theta, v.theta_dot, v.beta, v.beta_dot


@apart
def advance(f, steps, rows):
    """Fly `steps` steps and write the log rows that fall due.

    f               inout  `Vehicle`
    steps           in     how many steps, at most what is left
    rows  (r,) LOG_ROW  out    from index `rows` of the flight on
    Stops early when the attitude leaves +-lost_angle (`lost` = 1).
    """
    v = f.flight[0]
    for _ in range(steps):
        i = v.at
        tick = i // v.control_every
        phase = i - tick * v.control_every
        if not abs(v.theta) <= v.lost_angle:
            v.lost = 1
            return
        plant.tune_modes(f.modes, f.tuning, i)
        sensor.remember(v, f.modes, f.history, i)
        theta, theta_dot = sensor.read(v, f.modes, f.history, i)
        if phase == 0:
            control(v, f.ticks[tick], f.noise[i], f.filters, f.computed, f.commands, tick, theta, theta_dot)
        u = delayed_command(f.commands, tick, phase * v.step, v.step, v.period, v.delay)
        u = actuator.servo_input(v, f.inputs, v.step, u)
        if i % v.log_every == 0:
            write_row(f, i, tick, u, theta, theta_dot, rows[v.rows])
            v.rows += 1
        runge_kutta_4(f, i, 1, u, f.ticks[tick].acceleration)
        v.at = i + 1
