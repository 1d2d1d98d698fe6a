"""JSBSim's J246 launcher, flown in pitch under the contract's own PD law.

The model is the `jsbsim` package's (extra `judges`; educational, LGPL, never shipped): its files are read where the
package has them, changed in memory and written to a folder that goes with the flight.  What is changed: pitch and yaw
commands come from here instead of from the model's guidance; the two solid boosters' gimbals, which are all that
moves, have one gain each; sensors, and a moment for the noise of unmodelled moments, are added.  Bias, hysteresis and
rate limit of the pitch servo are the model's own, and off unless asked for.

A flight begins in the air, 30 s after lift-off would be, at zero angle of attack, and follows the gravity turn that the
same vehicle flies without any fault (`reference`).  theta, theta_dot and gamma are relative to it, and so is
beta: its trim on the reference, 1e-4 rad, is added to every command on its way.  Sign: beta > 0 turns the nose down, so
k1 < 0.
"""

import functools
import math
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path

import jsbsim
import numpy as np

STEP = 0.001             # s, of JSBSim: its servo and its integrators are then within 1 ms of continuous
PERIOD = 0.01            # s, of controller and log
TICK = round(PERIOD / STEP)
WARM_UP = 6.0            # s, on the reference, before the log begins: thrust builds up, and what the start left goes
LONGEST = 70.0           # s, of a log
ALTITUDE, SPEED, CLIMB, HEADING = 10000.0, 718.0, 75.0, 90.0  # ft, ft/s, degrees: as the model's own ascent at 30 s
BURNT = {0: 240e3, 1: 240e3, 2: 96e3, 3: 16e3}  # lb by tank, boosters and core, by then; they last for LONGEST
BOOSTERS, CORE = (0, 1), (2, 3, 4, 5)            # engines; the boosters' nozzles move
NOZZLE = 3500.0          # in, station of the gimbals
AERO = 1500.0            # in, station where the aerodynamic force acts
KP, KD, TAU = 1.0, 0.9, 0.05                     # -, s, s: closed loop near 1.2 rad/s
LIMIT = 0.12             # rad, on the command
NOISE = {"theta": 3.5e-4, "theta_dot": 5.2e-4, "beta": 3.5e-4, "command": 7e-4, "moment": 8.7e-4}  # the nominals'
GAMMA_NOISE = 2e-4       # rad, of navigation's flight-path angle
MOST_ATTITUDE = 0.04     # rad, of the reference's ramps
FOOT = 0.3048            # m
GRAVITY = 32.1           # ft/s^2, at 10 km
MILSPEC, BODY_FRAME = 3, 1   # JSBSim's numbers for its turbulence by MIL-F-8785C and for a gust along the body's axes
YAW_KP, YAW_KD = 1.0, 1.2    # -, s: heading and roll are held by the truth, and not logged; roll by opposite
ROLL_KP, ROLL_KD = 1.0, 1.0  # deflections of the two nozzles
ALPHA_KP, ALPHA_KD = 1.0, 0.9  # -, s: the reference's angle of attack is held at 0

SYSTEM = "Systems/J246FirstStageEffectors.xml"


@dataclass(frozen=True)
class Faults:
    """The faults of a flight; the defaults are none."""

    gimbal: float = 1.0            # share of its command that the right nozzle does in pitch
    gimbal_time: float = 0.0       # s of the log's clock, from which on
    lag: float = 60.0              # rad/s, first-order servo
    servo_bias: bool = False       # the model's own 0.0017 rad
    servo_hysteresis: bool = False  # the model's own width of 0.0017 rad
    servo_rate: bool = False       # the model's own limit of 0.085 rad/s
    servo_delay: float = 0.0       # s
    gyro_bias: float = 0.0         # rad/s
    gyro_delay: float = 0.0        # s
    attitude_bias: float = 0.0     # rad
    gust: float = 0.0              # m/s, 1 - cos, on the angle of attack
    gust_time: float = 0.0         # s
    gust_duration: float = 4.0     # s
    severity: int = 0              # JSBSim's turbulence (Milspec) by its index of probability; 0: calm
    engine_out: float = math.inf   # s: the lower outer core engine stops
    trim: bool = True              # the reference's trim is known and added; False: it is left to the controller


@dataclass(frozen=True, eq=False)
class Flight:
    """Columns by row (t = 0, PERIOD, ...), measured and true; SI units, relative to the reference."""

    columns: dict[str, np.ndarray]  # t, theta_ref, beta_cmd, beta, theta, theta_dot: the log
    gamma: np.ndarray               # rad, as navigation has it: a column that a log may have or not
    truth: dict[str, np.ndarray]    # theta, theta_dot, theta_ddot, gamma, alpha, beta, wind and the vehicle's a6, ...


def change(text: str, pattern: str, by: str) -> str:
    """One replacement, which must find its place: the package's files may have changed."""
    changed, count = re.subn(pattern, by, text, count=1, flags=re.DOTALL)
    if count != 1:
        raise RuntimeError(f"jsbsim's J246 no longer has {pattern!r}")
    return changed


def effectors(text: str, faults: Faults) -> str:
    """The first stage's effectors with commands from outside, the faults of the pitch servo, sensors."""
    pitch, rest = text.split('<channel name="Roll">', 1)
    pitch = change(pitch, "fcs/pitch-output-selector</input>", "launchid/pitch</input>")
    pitch = change(pitch, "<lag> 60 </lag>", f"<lag> {faults.lag!r} </lag>"
                   + (f'<delay type="time"> {faults.servo_delay!r} </delay>' if faults.servo_delay else ""))
    for tag, is_on in (("bias", faults.servo_bias), ("hysteresis_width", faults.servo_hysteresis),
                       ("rate_limit", faults.servo_rate)):
        if not is_on:
            pitch = change(pitch, rf"<{tag}>.*?</{tag}>", "")
    for engine in BOOSTERS:
        pitch = change(pitch, rf"<output>propulsion/engine\[{engine}\]/pitch-angle-rad</output>", "")
    gimbals = "".join(f"""<fcs_function name="launchid/gimbal-{engine}"><function><sum>
        <product><property>fcs/pitch-actuator-pos</property><property>launchid/share-{engine}</property></product>
        <product><property>launchid/roll</property><value>{sign}</value></product></sum></function>
        <output>propulsion/engine[{engine}]/pitch-angle-rad</output></fcs_function>"""
                      for engine, sign in ((0, 1), (1, -1)))
    sensors = f"""<channel name="Sensors">
        {sensor("attitude", "attitude/theta-rad", faults.attitude_bias, 0.0)}
        {sensor("gyro", "velocities/q-rad_sec", faults.gyro_bias, faults.gyro_delay)}</channel>"""
    pitch = change(pitch, "</channel>", gimbals + "</channel>" + sensors)
    rest = change(rest, "fcs/yaw-output-selector</input>", "launchid/yaw</input>")
    own = "".join(f'<property value="{value}">launchid/{name}</property>'
                  for name, value in (("pitch", 0), ("yaw", 0), ("roll", 0), ("share-0", 1), ("share-1", 1)))
    for tag in ("bias", "hysteresis_width"):
        rest = change(rest, rf"<{tag}>.*?</{tag}>", "")
    return change(pitch, '(<channel name="Pitch">)', own + r"\1") + '<channel name="Roll">' + rest


def sensor(name: str, of: str, bias: float, delay: float) -> str:
    """A JSBSim sensor."""
    late = f'<delay type="time"> {delay!r} </delay>' if delay else ""
    return f'<sensor name="launchid/{name}"><input>{of}</input><bias> {bias!r} </bias>{late}</sensor>'


def vehicle(folder: Path, faults: Faults) -> jsbsim.FGFDMExec:
    """A J246 in the air with these faults; `folder` takes the changed files."""
    root = Path(jsbsim.get_default_root_dir())
    there = root / "aircraft" / "J246"
    here = folder / "aircraft" / "J246"
    for path in there.rglob("*.xml"):
        text = path.read_text(encoding="utf-8")
        if path == there / SYSTEM:
            text = effectors(text, faults)
        elif path == there / "J246.xml":
            text = change(text, "<aerodynamics>", '<external_reactions><moment name="unmodelled" frame="BODY">'
                          "<direction><x>0</x><y>1</y><z>0</z></direction></moment></external_reactions>"
                          "<aerodynamics>")
        (here / path.relative_to(there)).parent.mkdir(parents=True, exist_ok=True)
        (here / path.relative_to(there)).write_text(text, encoding="utf-8")
    fdm = jsbsim.FGFDMExec(str(root))
    fdm.set_debug_level(0)
    fdm.set_aircraft_path(str(folder / "aircraft"))
    fdm.set_systems_path("systems")
    fdm.set_dt(STEP)  # before the model is loaded: its filters take their coefficients from it there
    if not fdm.load_model("J246"):
        raise RuntimeError("jsbsim could not load the changed J246")
    return fdm


def start(fdm: jsbsim.FGFDMExec, seed: int) -> None:
    """Put it on the ascent, engines burning."""
    fdm["simulation/randomseed"] = seed
    for name, value in (("h-sl-ft", ALTITUDE), ("vt-fps", SPEED), ("gamma-deg", CLIMB), ("theta-deg", CLIMB),
                        ("psi-true-deg", HEADING), ("phi-deg", 0.0), ("alpha-deg", 0.0), ("beta-deg", 0.0),
                        ("lat-geod-deg", 28.6), ("long-gc-deg", -80.6)):
        fdm[f"ic/{name}"] = value
    fdm.run_ic()
    for tank, burnt in BURNT.items():
        fdm[f"propulsion/tank[{tank}]/contents-lbs"] -= burnt
    for engine in BOOSTERS + CORE:
        fdm[f"fcs/throttle-cmd-norm[{engine}]"] = 1.0
    for kind in ("rotational", "translational"):
        fdm[f"simulation/integrator/rate/{kind}"] = 3  # second-order Adams-Bashforth
        fdm[f"simulation/integrator/position/{kind}"] = 3


def hold_sideways(fdm: jsbsim.FGFDMExec) -> None:
    """Heading and roll, by the truth."""
    away = (fdm["attitude/psi-rad"] - math.radians(HEADING)) * math.cos(fdm["attitude/theta-rad"])
    fdm["launchid/yaw"] = YAW_KP * away + YAW_KD * fdm["velocities/r-rad_sec"]
    fdm["launchid/roll"] = -ROLL_KP * fdm["attitude/phi-rad"] - ROLL_KD * fdm["velocities/p-rad_sec"]


def hold_alpha(fdm: jsbsim.FGFDMExec) -> float:
    """Command [rad] of the reference: no angle of attack, turning as gravity turns the flight path."""
    turn = -GRAVITY * math.cos(fdm["flight-path/gamma-rad"]) / fdm["velocities/vt-fps"]
    return ALPHA_KP * fdm["aero/alpha-rad"] + ALPHA_KD * (fdm["velocities/q-rad_sec"] - turn)


def run(fdm: jsbsim.FGFDMExec) -> None:
    """One controller period."""
    for _ in range(TICK):
        fdm.run()


TRUTH = {"theta": "attitude/theta-rad", "theta_dot": "velocities/q-rad_sec", "gamma": "flight-path/gamma-rad",
         "theta_ddot": "accelerations/qdot-rad_sec2", "alpha": "aero/alpha-rad", "beta": "fcs/pitch-actuator-pos",
         "roll": "attitude/phi-rad"}


def vehicle_parameters(fdm: jsbsim.FGFDMExec) -> tuple[float, float, float, float, float]:
    """(a6, k1 [1/s^2], z_alpha, z_beta [1/s], speed [m/s]) from its loads, masses and places: rigid-body mechanics.

    a6 = q S (CL_alpha + CD) arm/I, k1 = -T arm/I of the boosters; m V gamma_dot = (q S CL_alpha + thrust) alpha
    + T beta, all of it divided by the mass and the speed.
    """
    inertia, mass, speed = fdm["inertia/iyy-slugs_ft2"], fdm["inertia/mass-slugs"], fdm["velocities/vt-fps"]
    load = fdm["aero/qbar-psf"] * fdm["metrics/Sw-sqft"]
    lift, drag = load * fdm["aero/coefficient/CL_alpha"], load * fdm["aero/coefficient/CD_min"]
    gravity_centre = fdm["inertia/cg-x-in"]
    swivelled = sum(fdm[f"propulsion/engine[{engine}]/thrust-lbs"] for engine in BOOSTERS)
    thrust = swivelled + sum(fdm[f"propulsion/engine[{engine}]/thrust-lbs"] for engine in CORE)
    return ((lift + drag) * (gravity_centre - AERO) / 12.0 / inertia,
            -swivelled * (NOZZLE - gravity_centre) / 12.0 / inertia,
            (lift + thrust) / (mass * speed), swivelled / (mass * speed), speed * FOOT)


@functools.cache
def reference() -> dict[str, np.ndarray]:
    """The gravity turn without faults, by row of the longest log: TRUTH's names, a6, k1, z_alpha, z_beta, speed."""
    with tempfile.TemporaryDirectory() as folder:
        fdm = vehicle(Path(folder), Faults())
        start(fdm, 0)
        rows, names = [], (*TRUTH, "a6", "k1", "z_alpha", "z_beta", "speed")
        for tick in range(-round(WARM_UP / PERIOD), round(LONGEST / PERIOD) + 1):
            if tick >= 0:
                rows.append([fdm[path] for path in TRUTH.values()] + list(vehicle_parameters(fdm)))
            fdm["launchid/pitch"] = hold_alpha(fdm)
            hold_sideways(fdm)
            run(fdm)
    return dict(zip(names, np.array(rows).T.copy(), strict=True))


def attitude_reference(t: np.ndarray, seed: int) -> np.ndarray:
    """Ramps between held attitudes [rad], as the nominals' guidance; by seed."""
    nodes_t, nodes = guidance(seed)
    return np.interp(t, nodes_t, nodes)


def guidance(seed: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """(t [s], theta_ref [rad]): a ramp of 1 to 3 s every 4 to 8 s, to within MOST_ATTITUDE."""
    rng = np.random.default_rng([seed, 1])
    t, at = [0.0], [0.0]
    while t[-1] < LONGEST:
        t.append(round(t[-1] + rng.uniform(3.0, 6.0), 2))
        at.append(at[-1])
        t.append(round(t[-1] + rng.uniform(1.0, 3.0), 2))
        at.append(round(float(rng.uniform(-MOST_ATTITUDE, MOST_ATTITUDE)), 4))
    return tuple(t), tuple(at)


def fly(faults: Faults, seed: int, duration: float) -> Flight:
    """One log of `duration` [s]; the same by seed, to the bit."""
    with tempfile.TemporaryDirectory() as folder:
        fdm = vehicle(Path(folder), faults)
        return logged(fdm, faults, seed, duration)


def logged(fdm: jsbsim.FGFDMExec, faults: Faults, seed: int, duration: float) -> Flight:
    """The flight of a loaded vehicle."""
    start(fdm, seed)
    if faults.severity:
        fdm["atmosphere/turb-type"] = MILSPEC
        fdm["atmosphere/turbulence/milspec/severity"] = faults.severity
        fdm["atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps"] = 25.0
    for _ in range(round(WARM_UP / PERIOD)):
        fdm["launchid/pitch"] = hold_alpha(fdm)
        hold_sideways(fdm)
        run(fdm)
    rows = round(duration / PERIOD)
    ref = reference()
    t = np.round(np.arange(rows) * PERIOD, 9)
    theta_ref = attitude_reference(t, seed)
    rng = np.random.default_rng([seed, 0])
    noise = {name: std * rng.standard_normal(rows) for name, std in NOISE.items()}
    kept, before, d = [], math.nan, 0.0
    for k in range(rows):
        events(fdm, faults, k)
        theta = fdm["launchid/attitude"] - ref["theta"][k] + noise["theta"][k]
        error = theta - theta_ref[k]
        before = error if k == 0 else before
        d = (TAU * d + error - before) / (TAU + PERIOD)
        before = error
        command = min(max(KP * error + KD * d, -LIMIT), LIMIT)
        kept.append([command, theta, fdm["launchid/gyro"] - ref["theta_dot"][k] + noise["theta_dot"][k]]
                    + [fdm[path] for path in TRUTH.values()] + list(vehicle_parameters(fdm)))
        fdm["launchid/pitch"] = command + noise["command"][k] + (ref["beta"][k] if faults.trim else 0.0)
        fdm["external_reactions/unmodelled/magnitude-lbsft"] = noise["moment"][k] * fdm["inertia/iyy-slugs_ft2"]
        hold_sideways(fdm)
        run(fdm)
    command, theta, rate, *true = np.array(kept).T.copy()
    truth = dict(zip((*TRUTH, "a6", "k1", "z_alpha", "z_beta", "speed"), true, strict=True))
    truth["wind"] = truth["alpha"] - (truth["theta"] - truth["gamma"])
    for name in ("theta", "theta_dot", "theta_ddot", "gamma", *(["beta"] if faults.trim else [])):
        truth[name] = truth[name] - ref[name][:rows]
    columns = {"t": t, "theta_ref": theta_ref, "beta_cmd": command, "beta": truth["beta"] + noise["beta"],
               "theta": theta, "theta_dot": rate}
    gamma = truth["gamma"] + GAMMA_NOISE * np.random.default_rng([seed, 3]).standard_normal(rows)
    return Flight(columns, gamma, truth)


def events(fdm: jsbsim.FGFDMExec, faults: Faults, row: int) -> None:
    """Begin the faults of this row."""
    if row == round(faults.gimbal_time / PERIOD):
        fdm["launchid/share-1"] = faults.gimbal
    if faults.gust and row == round(faults.gust_time / PERIOD):
        gust = {"startup-duration-sec": 0.5 * faults.gust_duration, "steady-duration-sec": 0.0,
                "end-duration-sec": 0.5 * faults.gust_duration, "magnitude-ft_sec": abs(faults.gust) / FOOT,
                "frame": BODY_FRAME, "X-velocity-ft_sec": 0.0, "Y-velocity-ft_sec": 0.0,
                "Z-velocity-ft_sec": -math.copysign(1.0, faults.gust), "start": 1}
        for name, value in gust.items():
            fdm[f"atmosphere/cosine-gust/{name}"] = value
    if faults.engine_out < math.inf and row == round(faults.engine_out / PERIOD):
        fdm[f"fcs/throttle-cmd-norm[{CORE[0]}]"] = 0.0
