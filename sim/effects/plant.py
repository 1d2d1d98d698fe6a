"""Effects on the vehicle's rotation: what it is beside a rigid body with the nominal's a6 and k1.

Every moment is an angular acceleration [rad/s^2] that adds to a6 theta + k1 beta; `lateral_drift` turns the flight
path instead, by the equation and with the state of [drift].

Assumptions: small angles, one plane; a mode is one linear oscillator, at rest at
t = 0, and does not act back on other modes but through theta_ddot.
Limitations: `bending` moves the sensors, not the centre of mass; `nozzle_inertia`
turns the rigid vehicle, and does not load the servo.

To add an effect: its kernel, its branch below, its row in EFFECTS.
"""

from launchid_core import function_value

from ..vehicle.kernels import inner, kernel
from .table import (
    CENTRE,
    CODE,
    MEMORY,
    MEMORY_DOT,
    P0,
    P1,
    P2,
    START,
    START_DOT,
    TERM,
    TOTAL,
    TOTAL_DOT,
    Cause,
    Parameter,
)

(CONTROL_EFFECTIVENESS, CONTROL_LOSS, AERO_INSTABILITY, AERO_DAMPING, AERO_CUBIC, FRICTION, THRUST_MISALIGNMENT,
 SLOSH, BENDING, MISSING_TERM, MOMENT_STEP, NOZZLE_INERTIA, CONTROL_SLOPE, LATERAL_DRIFT) = range(14)

SAME_INSTANT = 1e-9  # s: a time of the integration that near an onset is the onset

EFFECTS = (
    Cause("control_effectiveness", "plant", (Parameter("scale", "", neutral=1.0),)),
    Cause("control_loss", "plant", (
        Parameter("fraction", "", neutral=0.0, low=-1.0, high=1.0),  # below 0: thrust or arm gained
        Parameter("time", "s"))),
    Cause("aero_instability", "plant", (Parameter("scale", "", neutral=1.0),)),
    Cause("aero_damping", "plant", (Parameter("coefficient", "1/s", neutral=0.0),)),
    Cause("aero_cubic", "plant", (Parameter("coefficient", "1/rad^2", neutral=0.0),)),
    Cause("friction", "plant", (Parameter("coefficient", "rad/s^2", neutral=0.0, low=0.0),)),
    Cause("thrust_misalignment", "plant", (Parameter("angle", "rad", neutral=0.0),)),
    Cause("slosh", "plant", (
        Parameter("coupling", "", neutral=0.0, low=-0.9, high=10.0),  # -1 takes all stiffness from the mode
        Parameter("frequency", "rad/s", low=0.0, above=True),
        Parameter("damping_ratio", "", default=0.02, low=0.0, high=2.0))),
    Cause("bending", "plant", (
        Parameter("gain", "rad/rad", neutral=0.0),
        Parameter("frequency", "rad/s", low=0.0, above=True),
        Parameter("damping_ratio", "", default=0.03, low=0.0, high=2.0))),
    Cause("missing_term", "plant", (
        Parameter("term", "term"),
        Parameter("coefficient", "rad/s^2 per unit of the term", neutral=0.0))),
    Cause("moment_step", "plant", (Parameter("acceleration", "rad/s^2", neutral=0.0), Parameter("time", "s"))),
    Cause("nozzle_inertia", "plant", (Parameter("coefficient", "", neutral=0.0),)),
    Cause("control_slope", "plant", (Parameter("slope", "1/s", neutral=0.0), Parameter("middle", "s", default=CENTRE))),
    Cause("lateral_drift", "plant", (Parameter("z_alpha", "1/s"), Parameter("z_beta", "1/s"))),
)


# ---- the physics


@kernel
def scaled(scale, value):
    """scale * value: of k1 for `control_effectiveness`, of a6 for `aero_instability` (dispersions of thrust,
    lever arm, dynamic pressure; NASA CR-826, table 1)."""
    return scale * value


@kernel
def lost_control(fraction, time, t, k1):
    """k1 from `time` [s] on is (1 - fraction) k1: an engine out, a leak (k1 = -T l/J with less thrust T)."""
    return (1.0 - fraction) * k1 if t >= time else k1


@kernel
def aero_damping(coefficient, theta_dot):
    """-coefficient theta_dot, coefficient = N_alpha l_cp^2/(J V) [1/s]: the turning nose meets the air at an angle
    (N_alpha normal force per angle, l_cp from centre of mass to centre of pressure, J inertia, V air speed)."""
    return -coefficient * theta_dot


@kernel
def aero_cubic(coefficient, a6, alpha):
    """a6 coefficient alpha^3: the normal force's next odd term in the angle of attack (vortex lift, slender bodies)."""
    return a6 * (coefficient * alpha * alpha * alpha)


@kernel
def friction(coefficient, theta_dot):
    """-coefficient sign(theta_dot), sign(0) = 0: Coulomb's law at a test stand's bearing.
    At rest it changes sign from step to step and holds theta_dot within coefficient times step."""
    if theta_dot > 0.0:
        return -coefficient
    return coefficient if theta_dot < 0.0 else 0.0


@kernel
def thrust_misalignment(angle, k1):
    """k1 angle: the thrust is off the nozzle's axis, or the centre of mass off the vehicle's."""
    return k1 * angle


@kernel
def slosh_moment(coupling, frequency, psi):
    """coupling w^2 psi: the sloshing mass pulls on the tank (pendulum analogy, NASA SP-106; NASA CR-826, eq. 68)."""
    return coupling * frequency * frequency * psi


@kernel
def slosh_mode(frequency, damping_ratio, psi, psi_dot, theta_ddot):
    """psi'' = -theta_ddot - 2 z w psi' - w^2 psi, theta_ddot with the slosh moment in it (NASA SP-106, ch. 6)."""
    return -theta_ddot - 2.0 * damping_ratio * frequency * psi_dot - frequency * frequency * psi


@kernel
def bending_mode(gain, frequency, damping_ratio, eta, eta_dot, beta):
    """eta'' = gain w^2 beta - 2 z w eta' - w^2 eta, eta the slope at the sensor (NASA CR-826, A.3):
    gain = sigma phi_tvc T/w^2, the static slope per nozzle angle."""
    return frequency * frequency * (gain * beta - eta) - 2.0 * damping_ratio * frequency * eta_dot


@kernel
def missing_term(coefficient, fx, e, theta, theta_dot, beta):
    """[rad/s^2] coefficient theta^e0 theta_dot^e1 beta^e2 f(state): a library term, its code in row e from TERM on."""
    value = coefficient
    for k, x in ((0, theta), (1, theta_dot), (2, beta)):
        for _ in range(int(fx[e, TERM + k])):
            value *= x
    argument = theta if fx[e, TERM + 5] == 0.0 else (theta_dot if fx[e, TERM + 5] == 1.0 else beta)
    return value * function_value(int(fx[e, TERM + 4]), argument)


@kernel
def stepped_moment(acceleration, time, t):
    """acceleration [rad/s^2] from `time` [s] on: an engine out, off the axis; a fin or a fairing that is gone."""
    return acceleration if t > time - SAME_INSTANT else 0.0


@kernel
def nozzle_reaction(coefficient, beta_ddot):
    """The swung engine's reaction, coefficient beta'' (tail wags dog).  For a launcher coefficient = -(I_R + m_R l_R
    l_c)/J (NASA CR-826, A.2: inertia, mass and arm of the engine about its gimbal, J of the vehicle, l_c from its
    centre of mass to the gimbal)."""
    return coefficient * beta_ddot


@kernel
def sloping(slope, middle, t, k1):
    """k1 (1 + slope (t - middle)): thrust, arm or inertia run away from what was believed of them."""
    return k1 * (1.0 + slope * (t - middle))


# ---- the place: fx (n, N_COLUMNS) inout, its rows of the table


@kernel
def parameters(fx, t, a6, k1):
    """(a6, k1) [1/s^2] at t [s] with the effects on them."""
    for e in range(fx.shape[0]):
        if fx[e, CODE] == CONTROL_EFFECTIVENESS:
            k1 = scaled(fx[e, P0], k1)
        elif fx[e, CODE] == CONTROL_LOSS:
            k1 = lost_control(fx[e, P0], fx[e, P1], t, k1)
        elif fx[e, CODE] == AERO_INSTABILITY:
            a6 = scaled(fx[e, P0], a6)
        elif fx[e, CODE] == CONTROL_SLOPE:
            k1 = sloping(fx[e, P0], fx[e, P1], t, k1)
    return a6, k1


@kernel
def change_parameters(fx):
    """Whether any effect is one on a6 or k1."""
    for e in range(fx.shape[0]):
        if fx[e, CODE] in (CONTROL_EFFECTIVENESS, CONTROL_LOSS, AERO_INSTABILITY, CONTROL_SLOPE):
            return True
    return False


@kernel
def parameters_over_time(fx, t, a6, k1):
    """`parameters` at every time.  t (n,) in; a6, k1 (n,) inout."""
    for i in range(t.shape[0]):
        a6[i], k1[i] = parameters(fx, t[i], a6[i], k1[i])


@inner
def acceleration(fx, a6, k1, alpha, theta, theta_dot, beta):
    """Sum of the plant's moments [rad/s^2] at a state; modes are read from their rows.

    alpha [rad]  angle of attack, without the winds among the effects
    """
    total = 0.0
    for e in range(fx.shape[0]):
        code = fx[e, CODE]
        if code == AERO_DAMPING:
            total += aero_damping(fx[e, P0], theta_dot)
        elif code == AERO_CUBIC:
            total += aero_cubic(fx[e, P0], a6, alpha)
        elif code == FRICTION:
            total += friction(fx[e, P0], theta_dot)
        elif code == THRUST_MISALIGNMENT:
            total += thrust_misalignment(fx[e, P0], k1)
        elif code == SLOSH:
            total += slosh_moment(fx[e, P0], fx[e, P1], fx[e, MEMORY])
        elif code == MISSING_TERM:
            total += missing_term(fx[e, P1], fx, e, theta, theta_dot, beta)
    return total


@inner
def moment_over_time(fx, t):
    """Sum of the moments [rad/s^2] that nothing but the time t [s] makes; -0.0 where there is none."""
    total = -0.0
    for e in range(fx.shape[0]):
        if fx[e, CODE] == MOMENT_STEP:
            total += stepped_moment(fx[e, P0], fx[e, P1], t)
    return total


@inner
def reaction(fx, beta_ddot):
    """Sum of the moments [rad/s^2] of the nozzle's acceleration [rad/s^2]; -0.0 where there is none."""
    total = -0.0
    for e in range(fx.shape[0]):
        if fx[e, CODE] == NOZZLE_INERTIA:
            total += nozzle_reaction(fx[e, P0], beta_ddot)
    return total


@inner
def drift(fx):
    """(z_alpha, z_beta) [1/s] beside the nominal's; (-0.0, -0.0) where there are none."""
    z_alpha, z_beta = -0.0, -0.0
    for e in range(fx.shape[0]):
        if fx[e, CODE] == LATERAL_DRIFT:
            z_alpha += fx[e, P0]
            z_beta += fx[e, P1]
    return z_alpha, z_beta


@inner
def misalignment(fx):
    """Sum of the thrust's angles [rad] off the nozzle's axis; -0.0 where there is none."""
    total = -0.0
    for e in range(fx.shape[0]):
        if fx[e, CODE] == THRUST_MISALIGNMENT:
            total += fx[e, P0]
    return total


@inner
def mode_acceleration(fx, e, theta_ddot, beta):
    """Second derivative of the mode of row e; 0 where there is none."""
    if fx[e, CODE] == SLOSH:
        return slosh_mode(fx[e, P1], fx[e, P2], fx[e, MEMORY], fx[e, MEMORY_DOT], theta_ddot)
    if fx[e, CODE] == BENDING:
        return bending_mode(fx[e, P0], fx[e, P1], fx[e, P2], fx[e, MEMORY], fx[e, MEMORY_DOT], beta)
    return 0.0


@inner
def jolt_modes(fx, jump):
    """The modes where theta_dot jumps by `jump` [rad/s]: psi'' = -theta_ddot - ..."""
    for e in range(fx.shape[0]):
        if fx[e, CODE] == SLOSH:
            fx[e, MEMORY_DOT] -= jump


@inner
def begin_modes(fx):
    """Remember the modes, before the four stages of a Runge-Kutta step."""
    for e in range(fx.shape[0]):
        fx[e, START], fx[e, START_DOT] = fx[e, MEMORY], fx[e, MEMORY_DOT]
        fx[e, TOTAL], fx[e, TOTAL_DOT] = 0.0, 0.0


@inner
def advance_modes(fx, weight, step, theta_ddot, beta):
    """Add a stage's slopes with their weight, and move the modes to the next stage, `step` [s] on."""
    for e in range(fx.shape[0]):
        slope, slope_dot = fx[e, MEMORY_DOT], mode_acceleration(fx, e, theta_ddot, beta)
        fx[e, TOTAL] += weight * slope
        fx[e, TOTAL_DOT] += weight * slope_dot
        fx[e, MEMORY] = fx[e, START] + step * slope
        fx[e, MEMORY_DOT] = fx[e, START_DOT] + step * slope_dot


@inner
def end_modes(fx, step):
    """Put the modes at the step's end, after the last stage."""
    for e in range(fx.shape[0]):
        fx[e, MEMORY] = fx[e, START] + step / 6.0 * fx[e, TOTAL]
        fx[e, MEMORY_DOT] = fx[e, START_DOT] + step / 6.0 * fx[e, TOTAL_DOT]


@inner
def deflection(fx):
    """(rad, rad/s) that bending adds where attitude and rate are measured: z_theta += eta, z_theta_dot += eta'."""
    slope, slope_dot = 0.0, 0.0
    for e in range(fx.shape[0]):
        if fx[e, CODE] == BENDING:
            slope += fx[e, MEMORY]
            slope_dot += fx[e, MEMORY_DOT]
    return slope, slope_dot
