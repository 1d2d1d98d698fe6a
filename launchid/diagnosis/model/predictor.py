"""The simulator, corrected by the log row by row: innovations and their likelihood under any set of effects.

`follow` runs the very Runge-Kutta step and the very effects of `sim.vehicle.step` from row to row on the logged
commands, and corrects attitude, rate and nozzle by fixed Kalman gains (innovations form: Ljung, System
Identification, 2nd ed., ch. 4.3 and 7).  A correction of the rate is an angular acceleration that was not modelled, so
a sloshing mass feels it too.  Gains are those of a gyro that tells rad/s: one with a scale factor corrects by its
innovation over that factor, else the factor would make the filter slower or faster and be liked for that alone.  And
what a late sensor shows was so then and has been ever since: the past that it is still to show is corrected with the
state, else the same error is corrected again and again until it has been shown.
"""

import math

import numpy as np

from sim.effects import actuator, plant, sensor
from sim.vehicle.actuator import delayed_command
from sim.vehicle.kernels import apart, asked, inner, kernel
from sim.vehicle.step import runge_kutta_4

from ..data.world import ATTITUDE, GYRO, MOMENT, NOZZLE, NOZZLE_SENSOR, WIND
from .likelihood import N_CHANNELS

N_RIGID = 6         # theta, theta_dot, beta, beta_dot, held command noise [rad], held acceleration [rad/s^2]
WHOLE = 1.0e-6      # of a step: nearer to its end a command begins there
DEAF = 0.1          # least scale factor of a gyro that is made good: of one that shows less, noise would be the rate


@inner
def expected(v, i, world, air, row):
    """The sensors' readings at step i without noise: row (3,) out."""
    x = v.flight[0]
    row[0], row[1] = sensor.read(x, v.modes, v.history, i)
    row[2] = x.beta + x.nozzle_sensor_bias
    for a in range(len(air)):
        if world[a, 0] == ATTITUDE:
            row[0] += air[a]
        elif world[a, 0] == GYRO:
            row[1] += air[a]
        elif world[a, 0] == NOZZLE_SENSOR:
            row[2] += air[a]


@inner
def push(v, i, world, air, a6):
    """The acceleration [rad/s^2] that the world's states (`data.world`) add at step i.

    a6 (2 steps + 1,) in  [1/s^2] the nominal's at every half step: the wind is an acceleration in its units, so that no
    other a6 of the vehicle is the better for making the wind's declared levels larger or smaller
    """
    total = 0.0
    for a in range(len(air)):
        if world[a, 0] == WIND:
            total += a6[2 * i] * air[a]
        elif world[a, 0] == NOZZLE:
            total += v.k1[2 * i] * air[a]
        elif world[a, 0] == MOMENT:
            total += air[a]
    return total


@inner
def shift_state(v, slots, held, air, k, gains, row):
    """Add gains[k] (6 + 2 modes + air's, 3) times row (3,) to the state; unmeasured channels are 0 in row."""
    x = v.flight[0]
    first = gains.shape[1] - len(air)
    for a in range(len(air)):
        for c in range(N_CHANNELS):
            air[a] += gains[k, first + a, c] * row[c]
    rate = 0.0
    for c in range(N_CHANNELS):
        x.theta += gains[k, 0, c] * row[c]
        rate += gains[k, 1, c] * row[c]
        x.beta += gains[k, 2, c] * row[c]
        x.beta_dot += gains[k, 3, c] * row[c]
        held[0] += gains[k, 4, c] * row[c]
        held[1] += gains[k, 5, c] * row[c]
    x.theta_dot += rate
    for e in range(len(slots)):
        mode = v.modes[e]
        if slots[e] >= 0:
            for c in range(N_CHANNELS):
                mode.x += gains[k, slots[e], c] * row[c]
                mode.x_dot += gains[k, slots[e] + 1, c] * row[c]
        elif mode.bends == 0.0:
            mode.x_dot -= rate


@asked
def made_good(scale):
    """The scale factor by which a gyro's innovations are divided before they correct."""
    return scale if abs(scale) > DEAF else math.copysign(DEAF, scale)


@inner
def shift_past(v, i, angle, rate):
    """Move what late sensors have still to show at step i by what the state there was moved."""
    x = v.flight[0]
    delay = max(x.attitude_delay, x.gyro_delay)
    for j in range(max(0, i - math.ceil(delay / x.step)), i + 1):
        v.history[sensor.ATTITUDE, j] += angle
        v.history[sensor.RATE, j] += rate


@inner
def correct_row(v, slots, held, world, air, i, k, z, gains, row):
    """Correct the state at row k, step i; row (3,) out: the innovations, 0 where not measured."""
    x = v.flight[0]
    sensor.remember(x, v.modes, v.history, i)
    if v.history.shape[1] > 0 and k == 0:  # before the log the vehicle stood as at its first row
        for j in range(i):
            v.history[0, j], v.history[1, j] = v.history[0, i], v.history[1, i]
    expected(v, i, world, air, row)
    for c in range(N_CHANNELS):
        row[c] = 0.0 if np.isnan(z[k, c]) else z[k, c] - row[c]
    rate, before, before_dot = row[1], x.theta, x.theta_dot
    row[1] = rate / made_good(x.gyro_scale)
    shift_state(v, slots, held, air, k, gains, row)
    row[1] = rate
    if v.history.shape[1] > 0:
        shift_past(v, i, x.theta - before, x.theta_dot - before_dot)


@inner
def remember_between(v, i, n):
    """Fill the sensors' past for the steps that were passed over, on a line from step i to where the state is."""
    x, (eta, eta_dot) = v.flight[0], plant.deflection(v.modes)
    for k in range(1, n):
        share = k / n
        for row, value in ((sensor.ATTITUDE, x.theta + eta), (sensor.RATE, x.theta_dot + eta_dot)):
            v.history[row, i + k] = (1.0 - share) * v.history[row, i] + share * value


@inner
def before_late(n, phase, late):
    """The number of steps, at most n, from step `phase` of a command's time, when the one before ends after `late`
    steps of it."""
    whole = int(late + WHOLE)
    if phase < whole:
        return min(n, whole - phase)
    return 1 if phase == whole and late - whole > WHOLE else n


@inner
def advance_row(v, held, pushed, first, last, begin):
    """Integrate from step `first` to `last`, `pushed` [rad/s^2] by the world; `begin` is the step of commands[0].

    As many steps at once as `at_once` allows, within one command; one where a late command begins: the mean
    over more would be half of it at first, which a servo answers otherwise.
    """
    x = v.flight[0]
    tick_steps, most = x.control_every, x.at_once
    i = first
    while i < last:
        sensor.remember(x, v.modes, v.history, i)
        tick = (i - begin) // tick_steps
        phase = (i - begin) - tick * tick_steps
        n = min(most, last - i, tick_steps - phase)
        if x.delay > 0.0:
            n = before_late(n, phase, x.delay / x.step % tick_steps)
        u = delayed_command(v.commands, tick, phase * x.step, n * x.step, x.period, x.delay) + held[0]
        u = actuator.servo_input(x, v.inputs, n * x.step, u)
        runge_kutta_4(v, i, n, u, v.ticks[tick].acceleration + held[1] + pushed)
        if v.history.shape[1] > 0:
            remember_between(v, i, n)
        i += n


@apart
def correct_apart(v, slots, held, world, air, i, k, z, gains, row):
    """`correct_row`, of its own: where a row costs less than to compile it in yet another place."""
    correct_row(v, slots, held, world, air, i, k, z, gains, row)


@apart
def advance_apart(v, held, pushed, first, last, begin):
    """`advance_row`, of its own."""
    advance_row(v, held, pushed, first, last, begin)


@kernel
def follow(v, slots, world, a6, at, z, gains, held_rows, held_phase, innovations, states):
    """Innovations of a log under a vehicle.  Returns False if the model ran away.

    v                        inout  at the first row; control_every steps a command
    slots (modes,)           in     where in the gains each mode's value stands, -1: it has none there
    world (w, 2)             in     the world's states: where they enter, what is left of them after a row
    a6 (2 steps + 1,)        in     as `push`
    at (n,)                  in     steps from the first row to each
    z (n, 3)                 in     measured; NaN: not
    gains (n, 6 + 2 modes + w, 3)  in   Kalman gains of each row
    held_rows, held_phase    in     the held noises are drawn anew each held_rows rows, from row held_phase on; 1: each
    innovations (n, 3)       out    measured less predicted, NaN where not measured
    states (n, 4)            out    theta, theta_dot, beta, beta_dot after the correction
    """
    x = v.flight[0]
    begin = x.at
    held, air, row = np.zeros(2), np.zeros(len(world)), np.zeros(N_CHANNELS)
    for k in range(len(z)):
        i = begin + at[k]
        if held_rows == 1 or (k - held_phase) % held_rows == 0:
            held[0], held[1] = 0.0, 0.0
        correct_row(v, slots, held, world, air, i, k, z, gains, row)
        for c in range(N_CHANNELS):
            innovations[k, c] = math.nan if np.isnan(z[k, c]) else row[c]
        if not abs(x.theta) < x.lost_angle:
            innovations[k:] = math.nan
            states[k:] = math.nan
            return False
        states[k, 0], states[k, 1], states[k, 2], states[k, 3] = x.theta, x.theta_dot, x.beta, x.beta_dot
        if k + 1 < len(z):
            advance_row(v, held, push(v, i, world, air, a6), i, begin + at[k + 1], begin)
            air *= world[:, 1]
    return True


@kernel
def tick_attitudes(v, slots, world, a6, at, z, gains, attitudes):
    """The readings of the attitude sensor at every tick of the commands: attitudes (ticks,) out [rad]."""
    x = v.flight[0]
    begin, tick = x.at, x.control_every
    held, air, row = np.zeros(2), np.zeros(len(world)), np.zeros(N_CHANNELS)
    k, pushed, here = 0, 0.0, begin + at[0]
    for j in range(len(attitudes)):
        i = begin + j * tick
        while k < len(z) and begin + at[k] <= i:
            advance_apart(v, held, pushed, here, begin + at[k], begin)
            here = begin + at[k]
            if k > 0:
                air *= world[:, 1]
            correct_apart(v, slots, held, world, air, here, k, z, gains, row)
            pushed = push(v, here, world, air, a6)
            k += 1
        advance_apart(v, held, pushed, here, i, begin)
        here = max(here, i)
        sensor.remember(x, v.modes, v.history, i)
        attitudes[j] = sensor.read(x, v.modes, v.history, i)[0]


@kernel
def horizon_errors(v, slots, world, a6, at, z, gains, held_rows, held_phase, spacing, ahead, errors):
    """Errors of predictions without correction, begun from the corrected state every `spacing` rows.

    v, slots, world, a6, at, z, gains, held_rows, held_phase   as `follow`
    spacing          in    rows between starts; the first starts at row 0
    ahead (h,)       in    horizons in rows, increasing
    errors (s, h, 3) out   measured less predicted of start s, NaN where not measured or beyond the log
    """
    x = v.flight[0]
    begin, n = x.at, len(z)
    held, ahead_held, row = np.zeros(2), np.zeros(2), np.zeros(N_CHANNELS)
    air, ahead_air = np.zeros(len(world)), np.zeros(len(world))
    flight, modes, inputs = v.flight.copy(), v.modes.copy(), v.inputs.copy()
    for k in range(n):
        i = begin + at[k]
        if held_rows == 1 or (k - held_phase) % held_rows == 0:
            held[0], held[1] = 0.0, 0.0
        correct_apart(v, slots, held, world, air, i, k, z, gains, row)
        if k % spacing == 0 and k // spacing < len(errors):
            flight[:], modes[:], inputs[:] = v.flight, v.modes, v.inputs
            reached, ahead_air[:], ahead_held[:] = k, air, held
            for b in range(len(ahead)):
                if k + ahead[b] >= n:
                    errors[k // spacing, b] = math.nan
                    continue
                while reached < k + ahead[b]:
                    if reached > k and (held_rows == 1 or (reached - held_phase) % held_rows == 0):
                        ahead_held[:] = 0.0
                    pushed = push(v, begin + at[reached], world, ahead_air, a6)
                    advance_apart(v, ahead_held, pushed, begin + at[reached], begin + at[reached + 1], begin)
                    ahead_air *= world[:, 1]
                    reached += 1
                sensor.remember(x, v.modes, v.history, begin + at[reached])
                expected(v, begin + at[reached], world, ahead_air, row)
                for c in range(N_CHANNELS):
                    errors[k // spacing, b, c] = z[reached, c] - row[c]
            v.flight[:], v.modes[:], v.inputs[:] = flight, modes, inputs
        if k + 1 < n:
            advance_apart(v, held, push(v, i, world, air, a6), i, begin + at[k + 1], begin)
            air *= world[:, 1]
