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
from sim.effects.plant import SLOSH
from sim.effects.table import CODE, MEMORY, MEMORY_DOT
from sim.vehicle.actuator import delayed_command
from sim.vehicle.kernels import apart, asked, inner, kernel
from sim.vehicle.step import (
    BETA,
    BETA_DOT,
    DAMPING,
    DELAY,
    FREQUENCY,
    LOST_ANGLE,
    N_COUNTERS,
    PERIOD,
    STEP,
    THETA,
    THETA_DOT,
    attitude,
    gyro,
    remember,
    runge_kutta_4,
)

from ..data.world import ATTITUDE, GYRO, MOMENT, NOZZLE, NOZZLE_SENSOR, WIND
from .likelihood import N_CHANNELS

AT_ONCE = N_COUNTERS  # of the vehicle's counters, behind the simulator's
N_RIGID = 6         # theta, theta_dot, beta, beta_dot, held command noise [rad], held acceleration [rad/s^2]
WHOLE = 1.0e-6      # of a step: nearer to its end a command begins there
DEAF = 0.1          # least scale factor of a gyro that is made good: of one that shows less, noise would be the rate


@inner
def expected(v, i, world, air, row):
    """The sensors' readings at step i without noise: row (3,) out."""
    row[0] = attitude(v, i)
    row[1] = gyro(v, i)
    row[2] = sensor.nozzle(v.sensor, v.state[BETA])
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
    x = v.state
    first = gains.shape[1] - len(air)
    for a in range(len(air)):
        for c in range(N_CHANNELS):
            air[a] += gains[k, first + a, c] * row[c]
    rate = 0.0
    for c in range(N_CHANNELS):
        x[THETA] += gains[k, 0, c] * row[c]
        rate += gains[k, 1, c] * row[c]
        x[BETA] += gains[k, 2, c] * row[c]
        x[BETA_DOT] += gains[k, 3, c] * row[c]
        held[0] += gains[k, 4, c] * row[c]
        held[1] += gains[k, 5, c] * row[c]
    x[THETA_DOT] += rate
    for e in range(v.plant.shape[0]):
        if slots[e] >= 0:
            for c in range(N_CHANNELS):
                v.plant[e, MEMORY] += gains[k, slots[e], c] * row[c]
                v.plant[e, MEMORY_DOT] += gains[k, slots[e] + 1, c] * row[c]
        elif v.plant[e, CODE] == SLOSH:
            v.plant[e, MEMORY_DOT] -= rate


@asked
def made_good(scale):
    """The scale factor by which a gyro's innovations are divided before they correct."""
    return scale if abs(scale) > DEAF else math.copysign(DEAF, scale)


@inner
def shift_past(v, i, angle, rate):
    """Move what late sensors have still to show at step i by what the state there was moved."""
    delay = max(sensor.latency(v.sensor, sensor.ATTITUDE_DELAY), sensor.latency(v.sensor, sensor.GYRO_DELAY))
    for j in range(max(0, i - math.ceil(delay / v.constant[STEP])), i + 1):
        v.history[sensor.ATTITUDE, j] += angle
        v.history[sensor.RATE, j] += rate


@inner
def correct_row(v, slots, held, world, air, i, k, z, gains, row):
    """Correct the state at row k, step i; row (3,) out: the innovations, 0 where not measured."""
    if v.history.shape[1] > 0:
        remember(v, i)
        if k == 0:  # before the log the vehicle stood as at its first row
            for j in range(i):
                v.history[0, j], v.history[1, j] = v.history[0, i], v.history[1, i]
    expected(v, i, world, air, row)
    for c in range(N_CHANNELS):
        row[c] = 0.0 if np.isnan(z[k, c]) else z[k, c] - row[c]
    rate, before, before_dot = row[1], v.state[THETA], v.state[THETA_DOT]
    row[1] = rate / made_good(sensor.rate_scale(v.sensor))
    shift_state(v, slots, held, air, k, gains, row)
    row[1] = rate
    if v.history.shape[1] > 0:
        shift_past(v, i, v.state[THETA] - before, v.state[THETA_DOT] - before_dot)


@inner
def remember_between(v, i, n):
    """Fill the sensors' past for the steps that were passed over, on a line from step i to where the state is."""
    eta, eta_dot = plant.deflection(v.plant)
    for k in range(1, n):
        share = k / n
        for row, value in ((sensor.ATTITUDE, v.state[THETA] + eta), (sensor.RATE, v.state[THETA_DOT] + eta_dot)):
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

    As many steps at once as counter[AT_ONCE] allows, within one command; one where a late command begins: the mean
    over more would be half of it at first, which a servo answers otherwise.
    """
    c = v.constant
    tick_steps, most = v.counter[1], v.counter[AT_ONCE]
    delay = c[DELAY] + actuator.latency(v.actuator)
    remembers = v.history.shape[1] > 0
    i = first
    while i < last:
        if remembers:
            remember(v, i)
        tick = (i - begin) // tick_steps
        phase = (i - begin) - tick * tick_steps
        n = min(most, last - i, tick_steps - phase)
        if delay > 0.0:
            n = before_late(n, phase, delay / c[STEP] % tick_steps)
        u = delayed_command(v.commands, tick, phase * c[STEP], n * c[STEP], c[PERIOD], delay) + held[0]
        u = actuator.command(v.actuator, c[FREQUENCY], c[DAMPING], n * c[STEP], u)
        runge_kutta_4(v, i, n, u, v.acceleration[tick] + held[1] + pushed)
        if remembers:
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

    v                        inout  at the first row; counter[CONTROL_EVERY] steps a command
    slots (plant's rows,)    in     where in the gains each mode's value stands, -1: it has none there
    world (w, 2)             in     the world's states: where they enter, what is left of them after a row
    a6 (2 steps + 1,)        in     as `push`
    at (n,)                  in     steps from the first row to each
    z (n, 3)                 in     measured; NaN: not
    gains (n, 6 + 2 modes + w, 3)  in   Kalman gains of each row
    held_rows, held_phase    in     the held noises are drawn anew each held_rows rows, from row held_phase on; 1: each
    innovations (n, 3)       out    measured less predicted, NaN where not measured
    states (n, 4)            out    theta, theta_dot, beta, beta_dot after the correction
    """
    begin = v.counter[0]
    held, air, row = np.zeros(2), np.zeros(len(world)), np.zeros(N_CHANNELS)
    for k in range(len(z)):
        i = begin + at[k]
        if held_rows == 1 or (k - held_phase) % held_rows == 0:
            held[0], held[1] = 0.0, 0.0
        correct_row(v, slots, held, world, air, i, k, z, gains, row)
        for c in range(N_CHANNELS):
            innovations[k, c] = math.nan if np.isnan(z[k, c]) else row[c]
        if not abs(v.state[THETA]) < v.constant[LOST_ANGLE]:
            innovations[k:] = math.nan
            states[k:] = math.nan
            return False
        for j in range(4):
            states[k, j] = v.state[j]
        if k + 1 < len(z):
            advance_row(v, held, push(v, i, world, air, a6), i, begin + at[k + 1], begin)
            air *= world[:, 1]
    return True


@kernel
def tick_attitudes(v, slots, world, a6, at, z, gains, attitudes):
    """The readings of the attitude sensor at every tick of the commands: attitudes (ticks,) out [rad]."""
    begin, tick = v.counter[0], v.counter[1]
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
        if v.history.shape[1] > 0:
            remember(v, i)
        attitudes[j] = attitude(v, i)


@kernel
def horizon_errors(v, slots, world, a6, at, z, gains, held_rows, held_phase, spacing, ahead, errors):
    """Errors of predictions without correction, begun from the corrected state every `spacing` rows.

    v, slots, world, a6, at, z, gains, held_rows, held_phase   as `follow`
    spacing          in    rows between starts; the first starts at row 0
    ahead (h,)       in    horizons in rows, increasing
    errors (s, h, 3) out   measured less predicted of start s, NaN where not measured or beyond the log
    """
    begin, n = v.counter[0], len(z)
    held, ahead_held, row, kept = np.zeros(2), np.zeros(2), np.zeros(N_CHANNELS), np.zeros(len(v.state))
    air, ahead_air = np.zeros(len(world)), np.zeros(len(world))
    moments, servo = np.zeros_like(v.plant), np.zeros_like(v.actuator)
    for k in range(n):
        i = begin + at[k]
        if held_rows == 1 or (k - held_phase) % held_rows == 0:
            held[0], held[1] = 0.0, 0.0
        correct_apart(v, slots, held, world, air, i, k, z, gains, row)
        if k % spacing == 0 and k // spacing < len(errors):
            kept[:], moments[:, :], servo[:, :] = v.state, v.plant, v.actuator
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
                if v.history.shape[1] > 0:
                    remember(v, begin + at[reached])
                expected(v, begin + at[reached], world, ahead_air, row)
                for c in range(N_CHANNELS):
                    errors[k // spacing, b, c] = z[reached, c] - row[c]
            v.state[:], v.plant[:, :], v.actuator[:, :] = kept, moments, servo
        if k + 1 < n:
            advance_apart(v, held, push(v, i, world, air, a6), i, begin + at[k + 1], begin)
            air *= world[:, 1]
