"""Effects on the vehicle's rotation: moments in addition to those of a rigid body with the nominal's a6 and k1.

Every moment is an angular acceleration [rad/s^2] that adds to a6 theta + k1 beta; `lateral_drift` turns the flight
path instead, by the equation and with the state of [drift].

Assumptions: small angles, one plane; a mode is one linear oscillator, at rest at
t = 0, and does not act back on other modes but through theta_ddot.
Limitations: `bending` moves the sensors, not the centre of mass; `nozzle_inertia`
turns the rigid vehicle, and does not load the servo.

To add an effect: its row in PLANT_EFFECTS, its branch in `change`, its equation in a kernel.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from launchid_core import function_value, parse_term

from ..kernels import inner
from .environment import JUMP_KIND
from .table import CENTRE, Cause, Changes, Parameter

AT_ONSET = 1e-9      # s: a time of the integration that near an onset is the onset

PLANT_EFFECTS = (
    Cause("control_effectiveness", "plant", (Parameter("scale", "", neutral=1.0),),
        "k1 -> scale*k1"),
    Cause("control_loss", "plant", (
        Parameter("fraction", "", neutral=0.0, low=-1.0, high=1.0),  # below 0: thrust or arm gained
        Parameter("time", "s")),
        "k1 -> (1 - fraction)*k1 from `time` on"),
    Cause("aero_instability", "plant", (Parameter("scale", "", neutral=1.0),),
        "a6 -> scale*a6"),
    Cause("aero_damping", "plant", (Parameter("coefficient", "1/s", neutral=0.0, into="aero_damping"),),
        "theta_ddot -= coefficient*theta_dot"),
    Cause("aero_cubic", "plant", (Parameter("coefficient", "1/rad^2", neutral=0.0, into="aero_cubic"),),
        "a6*theta -> a6*(theta + coefficient*theta^3)"),
    Cause("friction", "plant", (Parameter("coefficient", "rad/s^2", neutral=0.0, low=0.0, into="friction"),),
        "theta_ddot -= coefficient*sign(theta_dot)"),
    Cause("thrust_misalignment", "plant", (
        Parameter("angle", "rad", neutral=0.0, into="thrust_misalignment"),),
        "k1*b -> k1*(b + angle)"),
    Cause("slosh", "plant", (
        Parameter("coupling", "", neutral=0.0, low=-0.9, high=10.0),  # -1 takes all stiffness from the mode
        Parameter("frequency", "rad/s", low=0.0, above=True),
        Parameter("damping_ratio", "", default=0.02, low=0.0, high=2.0)),
        "psi'' + 2 z w psi' + w^2 psi = -theta_ddot; theta_ddot += coupling*w^2*psi"),
    Cause("bending", "plant", (
        Parameter("gain", "rad/rad", neutral=0.0),
        Parameter("frequency", "rad/s", low=0.0, above=True),
        Parameter("damping_ratio", "", default=0.03, low=0.0, high=2.0)),
        "eta'' + 2 z w eta' + w^2 eta = gain*w^2*b; z_theta += eta, z_theta_dot += eta'"),
    Cause("missing_term", "plant", (
        Parameter("term", "term"),
        Parameter("coefficient", "rad/s^2 per unit of the term", neutral=0.0)),
        "theta_ddot += coefficient*term, a library term; of a term that the nominal has, what it lacks"),
    Cause("moment_step", "plant", (Parameter("acceleration", "rad/s^2", neutral=0.0), Parameter("time", "s")),
        "theta_ddot += acceleration from `time` on"),
    Cause("nozzle_inertia", "plant", (Parameter("coefficient", "", neutral=0.0, into="nozzle_inertia"),),
        "theta_ddot += coefficient*b'' (tail wags dog; of a launcher below 0), b'' the nozzle's own, rate limit and"
        " all"),
    Cause("control_slope", "plant", (Parameter("slope", "1/s", neutral=0.0), Parameter("middle", "s", default=CENTRE)),
        "k1 -> k1*(1 + slope*(t - middle)); `middle` inf or left out: the centre of the log, of the flight in "
        "`simulate`"),
    Cause("lateral_drift", "plant", (
        Parameter("z_alpha", "1/s", into="z_alpha"), Parameter("z_beta", "1/s", into="z_beta")),
        "added to those of `[drift]`, which need not be there; the column `gamma` is the nominal's affair and is "
        "written with `[drift]` only"),
)


def change(of: Changes, name: str, p: Mapping[str, Any]) -> None:
    """Add effect `name` with values p to `of`, in place; parameters with `into` are not added here."""
    match name:
        case "control_effectiveness" | "control_loss" | "aero_instability" | "control_slope":
            of.parameters.append((name, dict(p)))
        case "slosh":
            w = p["frequency"]
            of.modes.append((0.0, w * w, 2.0 * p["damping_ratio"] * w, p["coupling"] * w * w, 1.0, 1.0, *np.zeros(6)))
        case "bending":
            w = p["frequency"]
            of.modes.append((1.0, w * w, 2.0 * p["damping_ratio"] * w, p["gain"], 1.0, 1.0, *np.zeros(6)))
        case "missing_term":
            theta, theta_dot, beta, _, function, argument = parse_term(p["term"])
            of.terms.append((p["coefficient"], theta, theta_dot, beta, function, argument))
        case "moment_step":
            of.timed.append((JUMP_KIND, p["acceleration"], p["time"] - AT_ONSET, 0.0))


def parameters(of: Changes, t: np.ndarray, a6: np.ndarray, k1: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a6 and k1 (n,) [1/s^2] at times t (n,) [s] after the effects on them (`of.parameters`).

    `control_effectiveness`, `aero_instability`: dispersions of thrust, lever arm, dynamic pressure (NASA CR-826, table
    1).  `control_loss`: an engine out, a leak (k1 = -T l/J with less thrust T).  `control_slope`: thrust, arm or
    inertia run away from what was believed of them.
    """
    for name, p in of.parameters:
        match name:
            case "control_effectiveness":
                k1 = p["scale"] * k1
            case "control_loss":
                k1 = np.where(t >= p["time"], (1.0 - p["fraction"]) * k1, k1)
            case "aero_instability":
                a6 = p["scale"] * a6
            case "control_slope":
                k1 = k1 * (1.0 + p["slope"] * (t - p["middle"]))
    return a6, k1


@inner
def acceleration(v, modes, terms, a6, k1, alpha, theta, theta_dot, beta):
    """Return the effects' moments [rad/s^2] in a state: damping, cubic, friction, misalignment, slosh, missing terms.

    alpha [rad]   angle of attack, without the winds among the effects
    `aero_damping`: N_alpha l_cp^2/(J V) [1/s], the turning nose meets the air at an angle (N_alpha normal force per
    angle, l_cp from centre of mass to centre of pressure, J inertia, V air speed).  `aero_cubic`: the normal force's
    next odd term (vortex lift, slender bodies).  `friction`: Coulomb's law at a test stand's bearing; at rest it
    changes sign from step to step and holds theta_dot within coefficient times step.  `thrust_misalignment`: the
    thrust is off the nozzle's axis, or the centre of mass off the vehicle's.
    """
    total = 0.0 - v.aero_damping * theta_dot
    total += a6 * (v.aero_cubic * alpha * alpha * alpha)
    if theta_dot > 0.0:
        total -= v.friction
    elif theta_dot < 0.0:
        total += v.friction
    total += k1 * v.thrust_misalignment
    if modes is not None:
        for mode in modes:
            if mode.bends == 0.0:
                total += mode.gain * mode.x
    if terms is not None:
        for term in terms:
            total += term_moment(term, theta, theta_dot, beta)
    return total


@inner
def term_moment(term, theta, theta_dot, beta):
    """Return a library term's moment [rad/s^2], coefficient theta^e0 theta_dot^e1 beta^e2 f(argument); term  a TERM."""
    value = term.coefficient
    for _ in range(int(term.theta)):
        value *= theta
    for _ in range(int(term.theta_dot)):
        value *= theta_dot
    for _ in range(int(term.beta)):
        value *= beta
    argument = theta if term.argument == 0.0 else (theta_dot if term.argument == 1.0 else beta)
    return value * function_value(int(term.function), argument)


@inner
def mode_acceleration(mode, theta_ddot, beta):
    """Return the second derivative of a mode's coordinate, given theta_ddot [rad/s^2] and beta [rad].

    slosh    psi'' = -theta_ddot - 2 z w psi' - w^2 psi, whose mass pulls on the tank with the moment
             coupling w^2 psi (pendulum analogy, NASA SP-106, ch. 6; NASA CR-826, eq. 68)
    bending  eta'' = gain w^2 beta - 2 z w eta' - w^2 eta, eta the slope at the sensor (NASA CR-826, A.3):
             gain = sigma phi_tvc T/w^2, the static slope per nozzle angle
    """
    if mode.bends == 0.0:
        return -theta_ddot - mode.drag * mode.x_dot - mode.stiffness * mode.x
    return mode.stiffness * (mode.gain * beta - mode.x) - mode.drag * mode.x_dot


@inner
def tune_modes(modes, tuning, i):
    """Set stiffness, drag and gain of modes that change with time at step i; tuning (n, 3, steps) or None."""
    if tuning is not None:
        for k in range(modes.shape[0]):
            modes[k].stiffness, modes[k].drag, modes[k].gain = tuning[k, 0, i], tuning[k, 1, i], tuning[k, 2, i]


@inner
def begin_modes(modes, jump):
    """Store the modes' state at the start of a Runge-Kutta step; a `jump` of theta_dot [rad/s] there jolts slosh."""
    if modes is not None:
        for mode in modes:
            if mode.bends == 0.0:
                mode.x_dot -= jump
            mode.start, mode.start_dot = mode.x, mode.x_dot
            mode.total, mode.total_dot = 0.0, 0.0


@inner
def advance_modes(modes, weight, h, theta_ddot, beta):
    """Add a Runge-Kutta stage's slopes with their weight; move the modes to the next stage, h [s] after the start."""
    if modes is not None:
        for mode in modes:
            slope, slope_dot = mode.x_dot, mode_acceleration(mode, theta_ddot, beta)
            mode.total += weight * slope
            mode.total_dot += weight * slope_dot
            mode.x = mode.start + h * slope
            mode.x_dot = mode.start_dot + h * slope_dot


@inner
def end_modes(modes, h):
    """Move the modes to the end of the Runge-Kutta step of h [s], after its last stage."""
    if modes is not None:
        for mode in modes:
            mode.x = mode.start + h / 6.0 * mode.total
            mode.x_dot = mode.start_dot + h / 6.0 * mode.total_dot


@inner
def deflection(modes):
    """Return (angle [rad], rate [rad/s]) that bending adds to measured attitude and rate, summed over the modes."""
    eta, eta_dot = 0.0, 0.0
    if modes is not None:
        for mode in modes:
            if mode.bends != 0.0:
                eta += mode.angle * mode.x
                eta_dot += mode.rate * mode.x_dot
    return eta, eta_dot
