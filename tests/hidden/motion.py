"""The equations of motion and the clockwork around them, in one compiled loop.

    theta_ddot = a6 (theta + ...) + k1 nozzle + push;   servo'' = w^2 (u - servo) - 2 z w servo'

The inertia c of the nozzle, theta_ddot += c servo'', is carried by the momentum theta_dot - c servo', which no jump of
the servo's rate makes jump; the flight path is carried as what it adds to the angle, minus gamma.

Integrated by Kutta's third-order rule (Kutta 1901; nodes 0, 1/2, 1) in sub-steps of `Knobs.substep`.  Delays are
ring buffers read a whole number of sub-steps back.  Dry friction holds its direction over a sub-step and sticks
when the velocity passes through zero.  Everything that depends on time alone comes in as arrays (`Course`).
"""

import math
from typing import NamedTuple

import numba
import numpy as np

fast = numba.njit(cache=True, error_model="numpy", nogil=True)

(TH, Q, B, R, PSI, PSI_DOT, ETA, ETA_DOT, ETA2, ETA2_DOT, SERVO_IN, ATTITUDE_SEEN, RATE_SEEN, WANDER,
 MOUNTED, WASHED) = range(16)  # Q: theta_dot less the nozzle's momentum; PSI_DOT: the swing's rate with it
N_STATE = 16
LOST = 0.5  # rad: beyond it small angles fail, and the log ends
KNEE = 8.0     # exponent of the soft rate limit: at the limit itself 8 % are gone
WIND_UP = 0.5  # of the rate limit, by which a soft valve's demand may run ahead of it


class Knobs(NamedTuple):
    """The numbers that do not change in flight: the vehicle's, then those of what may be wrong with it, at neutral
    values."""

    substep: float              # s
    servo_frequency: float      # rad/s
    servo_damping: float
    deflection_limit: float     # rad
    kp: float
    kd: float                   # s
    filter_time: float          # s
    period: float               # s, of the controller
    ki: float = 0.0             # 1/s
    trapezoid: float = 0.0      # 1: the derivative filter by the trapezoidal rule, 0: by backward Euler
    drag: float = 0.0           # 1/s
    drag_square: float = 0.0    # 1/rad
    aero_third: float = 0.0     # 1/rad^2
    aero_bend: float = 0.0      # 1/rad: angle -> sinh(s angle)/s for s > 0, sin(s angle)/s for s < 0
    rub: float = 0.0            # rad/s^2
    rub_width: float = 0.0      # rad/s: over which the smooth form of `rub` changes sign; 0: dry
    tank_pull: float = 0.0
    tank_frequency: float = 0.0  # rad/s
    tank_damping: float = 0.0
    tank_ratio: float = 0.0     # pendulum angle over psi; 0: linear
    flex_gain: float = 0.0      # rad/rad
    flex_frequency: float = 0.0  # rad/s
    flex_damping: float = 0.0
    flex2_gain: float = 0.0
    flex2_frequency: float = 0.0
    flex2_damping: float = 0.0
    kick: float = 0.0           # of the nozzle's acceleration
    mount: float = 0.0          # s, first-order, through which the nozzle's rate reaches the vehicle; 0: stiff
    servo_time: float = 0.0     # s, of a first-order servo; 0: second order
    rate_limit: float = math.inf      # rad/s, of the nozzle
    soft: float = 0.0           # 1: the nozzle's rate bends into its limit instead of hitting it
    play: float = 0.0           # rad, half width
    servo_rub: float = 0.0      # rad/s^2
    servo_lag: float = 0.0      # s, first-order, before the servo
    washout: float = 0.0        # s, of the input's slow part, which does not act; 0: all acts
    washout_leak: float = 0.0   # share of the slow part that acts all the same
    servo_odd: float = 0.0      # 1/rad: u + c u abs(u)
    servo_even: float = 0.0     # 1/rad: u + c u^2
    linkage: float = 0.0        # rad, between servo and nozzle
    attitude_lag: float = 0.0   # s, first-order
    gyro_lag: float = 0.0       # s, first-order
    attitude_third: float = 0.0  # 1/rad^2
    attitude_knee: float = 0.0  # change of scale on either side of knee_at
    knee_at: float = 0.0        # rad
    gyro_ceiling: float = math.inf  # rad/s
    gyro_dead: float = 0.0      # rad/s, half width


class Clock(NamedTuple):
    """Whole numbers: sub-steps of the flight, and sub-steps or ticks between and behind."""

    steps: int
    control_every: int
    sense_every: int
    log_every: int
    late_ticks: int      # of the controller
    attitude_late: int   # sub-steps
    gyro_late: int       # sub-steps
    memory: int          # length of the ring buffers, above every delay


class Course(NamedTuple):
    """The values that change with time alone."""

    a6: np.ndarray              # (2 steps + 1,) 1/s^2 at every half sub-step
    k1: np.ndarray              # (2 steps + 1,) 1/s^2
    push: np.ndarray            # (2 steps + 1,) rad/s^2
    drift_alpha: np.ndarray     # (2 steps + 1,) 1/s
    drift_beta: np.ndarray      # (2 steps + 1,) 1/s
    sway: np.ndarray            # (2 steps + 1,) rad/s, of wind and tilt on the flight path
    rattle: np.ndarray          # (ticks,) rad/s^2, held
    reference: np.ndarray       # (ticks,) rad
    command_noise: np.ndarray   # (ticks,) rad
    servo_late: np.ndarray      # (ticks,) int64 sub-steps
    servo_gain: np.ndarray      # (ticks,)
    servo_null: np.ndarray      # (ticks,) rad
    attitude_add: np.ndarray    # (senses,) rad: bias and noise
    gyro_gain: np.ndarray       # (senses,)
    gyro_add: np.ndarray        # (senses,) rad/s
    pickup_add: np.ndarray      # (senses,) rad


@fast
def aero_angle(k, y):
    """The angle [rad] that a6 multiplies."""
    attack = y[TH] + y[WANDER]
    angle = attack + k.aero_third * attack ** 3
    if k.aero_bend > 0.0:
        angle += math.sinh(k.aero_bend * attack) / k.aero_bend - attack
    elif k.aero_bend < 0.0:
        angle += math.sin(k.aero_bend * attack) / k.aero_bend - attack
    return angle


@fast
def limited(k, rate):
    """The nozzle's rate [rad/s] of the one that the servo asks for."""
    if k.soft > 0.0:
        return rate / (1.0 + abs(rate / k.rate_limit) ** KNEE) ** (1.0 / KNEE)
    return min(max(rate, -k.rate_limit), k.rate_limit)


@fast
def acting(k, u, y):
    """The part of the servo's input u [rad] that acts."""
    if k.washout == 0.0:
        return u
    return u - (1.0 - k.washout_leak) * y[WASHED]


@fast
def nozzle_rate(k, u, y):
    """The nozzle's own rate [rad/s] where the servo's input, or its lag's, is u [rad]."""
    u = acting(k, u, y)
    if k.servo_time > 0.0:
        return limited(k, ((y[SERVO_IN] if k.servo_lag > 0.0 else u) - y[B]) / k.servo_time)
    return limited(k, y[R])


@fast
def kicked(k, u, y):
    """The part of the vehicle's rate [rad/s] that the moving nozzle adds."""
    if k.kick == 0.0:
        return 0.0
    return k.kick * (y[MOUNTED] if k.mount > 0.0 else nozzle_rate(k, u, y))


@fast
def slopes(k, a6, k1, push, drift_alpha, drift_beta, sway, u, dry, y, dy):
    """dy (N_STATE,) out: time derivative of y (N_STATE,).

    dry (4,) in: dry friction on attitude and servo [rad/s^2], and whether attitude and servo stick (1.0)
    """
    nozzle = y[B] + k.linkage
    kick = kicked(k, u, y)
    rate, swing_rate = y[Q] + kick, y[PSI_DOT] - kick
    swing = y[PSI] if k.tank_ratio == 0.0 else math.sin(k.tank_ratio * y[PSI]) / k.tank_ratio
    w = k.tank_frequency
    turn = (a6 * aero_angle(k, y) + k1 * nozzle + push + dry[0] + k.tank_pull * w * w * swing
            - k.drag * rate - k.drag_square * rate * abs(rate))
    if k.rub_width > 0.0:
        turn -= k.rub * math.tanh(rate / k.rub_width)
    if dry[2] > 0.0:
        turn = 0.0
    dy[TH], dy[Q] = rate, turn
    dy[PSI], dy[PSI_DOT] = swing_rate, -turn - 2.0 * k.tank_damping * w * swing_rate - w * w * swing

    v = k.servo_frequency
    entry = y[SERVO_IN] if k.servo_lag > 0.0 else acting(k, u, y)
    dy[SERVO_IN] = (acting(k, u, y) - y[SERVO_IN]) / k.servo_lag if k.servo_lag > 0.0 else 0.0
    dy[WASHED] = (u - y[WASHED]) / k.washout if k.washout > 0.0 else 0.0
    dy[B] = nozzle_rate(k, u, y)
    dy[MOUNTED] = (dy[B] - y[MOUNTED]) / k.mount if k.mount > 0.0 else 0.0
    dy[R] = v * v * (entry - y[B]) - 2.0 * k.servo_damping * v * y[R] + dry[1]
    if dry[3] > 0.0 or k.servo_time > 0.0:
        dy[R] = 0.0

    f = k.flex_frequency
    dy[ETA], dy[ETA_DOT] = y[ETA_DOT], f * f * (k.flex_gain * nozzle - y[ETA]) - 2.0 * k.flex_damping * f * y[ETA_DOT]
    f = k.flex2_frequency
    dy[ETA2] = y[ETA2_DOT]
    dy[ETA2_DOT] = f * f * (k.flex2_gain * nozzle - y[ETA2]) - 2.0 * k.flex2_damping * f * y[ETA2_DOT]

    seen, seen_rate = y[TH] + y[ETA] + y[ETA2], rate + y[ETA_DOT] + y[ETA2_DOT]
    dy[ATTITUDE_SEEN] = (seen - y[ATTITUDE_SEEN]) / k.attitude_lag if k.attitude_lag > 0.0 else 0.0
    dy[RATE_SEEN] = (seen_rate - y[RATE_SEEN]) / k.gyro_lag if k.gyro_lag > 0.0 else 0.0
    dy[WANDER] = -(drift_alpha * (y[TH] + y[WANDER]) + drift_beta * nozzle + sway)


@fast
def rubbing(limit, velocity, drive):
    """(friction, sticks) of Coulomb's law with `limit` at this velocity, against a drive of the same unit."""
    if limit == 0.0:
        return 0.0, 0.0
    if velocity != 0.0:
        return -math.copysign(limit, velocity), 0.0
    return (0.0, 1.0) if abs(drive) <= limit else (-math.copysign(limit, drive), 0.0)


@fast
def move(k, c, i, rattle, u, y, work):
    """One sub-step of Kutta's third-order rule.  y (N_STATE,) inout; work (5, N_STATE) scratch."""
    h = k.substep
    first, second, third, stage, dry = work[0], work[1], work[2], work[3], work[4]
    n0, n1, n2 = 2 * i, 2 * i + 1, 2 * i + 2
    dry[:4] = 0.0
    rub = 0.0 if k.rub_width > 0.0 else k.rub
    if rub > 0.0 or k.servo_rub > 0.0:
        slopes(k, c.a6[n0], c.k1[n0], c.push[n0] + rattle, c.drift_alpha[n0], c.drift_beta[n0], c.sway[n0], u, dry,
               y, first)
        dry[0], dry[2] = rubbing(rub, y[Q], first[Q])
        dry[1], dry[3] = rubbing(k.servo_rub, y[R], first[R])
    q, r = y[Q], y[R]
    slopes(k, c.a6[n0], c.k1[n0], c.push[n0] + rattle, c.drift_alpha[n0], c.drift_beta[n0], c.sway[n0], u, dry,
           y, first)
    for n in range(N_STATE):
        stage[n] = y[n] + 0.5 * h * first[n]
    slopes(k, c.a6[n1], c.k1[n1], c.push[n1] + rattle, c.drift_alpha[n1], c.drift_beta[n1], c.sway[n1], u, dry,
           stage, second)
    for n in range(N_STATE):
        stage[n] = y[n] - h * first[n] + 2.0 * h * second[n]
    slopes(k, c.a6[n2], c.k1[n2], c.push[n2] + rattle, c.drift_alpha[n2], c.drift_beta[n2], c.sway[n2], u, dry,
           stage, third)
    for n in range(N_STATE):
        y[n] += h / 6.0 * (first[n] + 4.0 * second[n] + third[n])
    reach = k.rate_limit * (1.0 + k.soft * WIND_UP)
    y[R] = min(max(y[R], -reach), reach)
    if rub > 0.0 and q * y[Q] < 0.0:
        y[Q] = 0.0
    if k.servo_rub > 0.0 and r * y[R] < 0.0:
        y[R] = 0.0


@fast
def seen_attitude(k, angle):
    """The attitude sensor's own curve [rad]."""
    return angle + k.attitude_third * angle**3 + k.attitude_knee * (abs(angle - k.knee_at) - abs(k.knee_at))


@fast
def seen_rate(k, rate):
    """The gyro's own curve [rad/s]: dead zone, then ceiling."""
    if k.gyro_dead > 0.0:
        rate = math.copysign(max(abs(rate) - k.gyro_dead, 0.0), rate)
    return min(max(rate, -k.gyro_ceiling), k.gyro_ceiling)


@fast
def autopilot(k, error, memory):
    """The controller's output [rad].  memory (4,) inout: last error, derivative, integral, 1.0 once it has run."""
    if memory[3] == 0.0:
        memory[0], memory[3] = error, 1.0
    tau, period = k.filter_time, k.period
    if k.trapezoid > 0.0:
        memory[1] = ((2.0 * tau - period) * memory[1] + 2.0 * (error - memory[0])) / (2.0 * tau + period)
    else:
        memory[1] = (tau * memory[1] + error - memory[0]) / (tau + period)
    memory[0] = error
    memory[2] += period * error
    command = k.kp * error + k.kd * memory[1] + k.ki * memory[2]
    return min(max(command, -k.deflection_limit), k.deflection_limit)


@fast
def servo_entry(k, u, held):
    """The part of the delayed command that reaches the servo [rad].  held (1,) inout: driven side of the play."""
    u = u + k.servo_odd * u * abs(u) + k.servo_even * u * u
    if k.play > 0.0:
        held[0] = max(u - k.play, min(u + k.play, held[0]))
        u = held[0]
    return u


@fast
def run(k, clock, c, rows):
    """Fly; rows (n, 6) out: t, theta_ref, beta_cmd, beta, theta, theta_dot.  Returns (rows written, lost)."""
    y, work = np.zeros(N_STATE), np.zeros((5, N_STATE))
    ring = np.zeros((3, clock.memory))  # attitude, rate, command; all at rest before t = 0
    computed = np.zeros(clock.steps // clock.control_every + 2)
    pilot, held = np.zeros(4), np.zeros(1)
    command, written, u = 0.0, 0, 0.0
    for i in range(clock.steps):
        if not abs(y[TH]) <= LOST:
            return written, True
        at, tick = i % clock.memory, i // clock.control_every
        ring[0, at] = y[ATTITUDE_SEEN] if k.attitude_lag > 0.0 else y[TH] + y[ETA] + y[ETA2]
        ring[1, at] = y[RATE_SEEN] if k.gyro_lag > 0.0 else y[Q] + kicked(k, u, y) + y[ETA_DOT] + y[ETA2_DOT]
        if i % clock.sense_every == 0:
            s = i // clock.sense_every
            z = seen_attitude(k, ring[0, (i - clock.attitude_late) % clock.memory]) + c.attitude_add[s]
            if i % clock.control_every == 0:
                computed[tick] = autopilot(k, z - c.reference[tick], pilot)
                command = computed[tick - clock.late_ticks] if tick >= clock.late_ticks else 0.0
            if i % clock.log_every == 0:
                rate = seen_rate(k, c.gyro_gain[s] * ring[1, (i - clock.gyro_late) % clock.memory])
                row = rows[written]
                row[0], row[1], row[2] = i * k.substep, c.reference[tick], command
                row[3], row[4], row[5] = y[B] + k.linkage + c.pickup_add[s], z, rate + c.gyro_add[s]
                written += 1
        ring[2, at] = command + c.command_noise[tick]
        arrived = ring[2, (i - c.servo_late[tick]) % clock.memory]
        u = servo_entry(k, c.servo_gain[tick] * arrived + c.servo_null[tick], held)
        move(k, c, i, c.rattle[tick], u, y, work)
    return written, False
