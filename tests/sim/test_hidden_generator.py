"""The generator of hidden effects: independent of the project, right by the equations, and of one mind with it."""

import ast
import dataclasses
import functools
import math
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hidden import LISTED, OTHER, PLAIN, QUIET, UNLISTED, Noise, Spec, draw_spec, fly, hide, size_at, write_csv
from hidden.build import SUBSTEP, Build
from hidden.catalogue import CAUSES, CHANCE, told
from hidden.flight import COLUMNS
from hidden.listed import FITS
from hidden.motion import LOST
from hidden.unlisted import EFFECTS
from hidden.vehicles import NAMES, PROFILES, vehicle
from scipy.linalg import expm

from launchid.log.log import read_log
from sim.effects import CATALOGUE, effect
from sim.flight import fly_whole
from sim.nominal import Nominal, load_nominal

FOLDER = Path(__file__).parents[1] / "hidden"
MEASURED = COLUMNS[2:]
FORMS = {"lag", "wind_up", "middle"}   # parameters of the project's beside the contract's
PLACES = {"plant", "environment", "actuator", "sensor", "controller", "data"}


def quiet(*effects, **fields):
    """Columns of a noise-free flight."""
    return fly(Spec(noise=QUIET, effects=effects, **fields))[0]


@functools.cache
def undisturbed():
    """A noise-free flight in which nothing is hidden; shared, so nobody changes it."""
    return quiet()


def rms(x):
    return float(np.sqrt(np.mean(np.square(x))))


def change(columns, clean):
    """The change of the measured columns by an effect, each in units of its rms, as one vector."""
    n = min(len(columns["t"]), len(clean["t"]))
    return np.concatenate([(columns[name][:n] - clean[name][:n]) / rms(clean[name]) for name in MEASURED])


def cause_at(cause, factor=2.0, sign=1.0, variant=PLAIN, nominal="constant"):
    return hide(cause, size_at(cause, factor, sign, nominal), variant)


# ---- independence


ALLOWED = {"numpy", "numba"} | set(sys.stdlib_module_names) - {"importlib", "runpy", "subprocess"}


def foreign(text):
    """Lines of a module that reach beyond the generator, numpy, numba and the standard library."""
    lines = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            strange = not {alias.name.split(".")[0] for alias in node.names} <= ALLOWED
        elif isinstance(node, ast.ImportFrom):
            strange = node.level > 1 or (node.level == 0 and str(node.module).split(".")[0] not in ALLOWED)
        else:
            called = getattr(node.func, "id", getattr(node.func, "attr", "")) if isinstance(node, ast.Call) else ""
            strange = called in {"__import__", "exec", "eval", "import_module"}
        if strange:
            lines.append(node.lineno)
    return lines


@pytest.mark.parametrize("path", sorted(FOLDER.rglob("*.py")), ids=lambda path: path.name)
def test_generator_imports_nothing_of_the_project(path):
    assert foreign(path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize("text", ["import sim", "from sim.effects import plant", "import numpy, launchid_core.ring",
                                  "from .. import conftest", "from launchid_core import Sample", "import scipy",
                                  "def f():\n    import sim.flight as f", "__import__('sim')", "importlib.import_module"
                                  "('sim')"])
def test_the_walk_sees_what_is_foreign(text):
    assert foreign(text) and len(list(FOLDER.rglob("*.py"))) >= 8


@pytest.mark.parametrize("name", NAMES)
def test_vehicle_is_the_nominal_s(name):
    craft, path = vehicle(name), PROFILES.parent / "nominal" / f"{name}.toml"
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    servo, pilot, sensors, guidance = (table[key] for key in ("actuator", "controller", "sensors", "guidance"))
    assert (craft.servo_frequency, craft.servo_damping, craft.command_noise, craft.deflection_limit) == (
        servo["natural_frequency"], servo["damping_ratio"], servo["command_noise_std"], servo["deflection_limit"])
    assert (craft.kp, craft.kd, craft.filter_time, craft.period) == (
        pilot["kp"], pilot["kd"], pilot["derivative_time_constant"], pilot["period"])
    assert (craft.attitude_noise, craft.gyro_noise, craft.nozzle_noise) == (
        sensors["theta_std"], sensors["theta_dot_std"], sensors["beta_std"])
    assert (list(craft.turn_t), list(craft.turn)) == (guidance["t"], guidance["theta_ref"])
    assert (craft.duration, craft.push_noise) == (
        table["simulation"]["duration"], table["simulation"]["acceleration_noise_std"])
    t = np.arange(0.0, craft.duration, 0.37)
    assert np.array_equal(craft.parameters(t), load_nominal(name).vehicle.at(t))


def test_lists_are_the_contract_s_and_more():
    assert set(LISTED) == set(CATALOGUE) - {"missing_term"}
    assert {cause: listed.place for cause, listed in CAUSES.items()} == {
        cause: CATALOGUE[cause].where for cause in LISTED}
    assert {listed.name for listed in CAUSES.values()} == set(FITS)
    assert len(UNLISTED) >= 8 and not set(UNLISTED) & (set(CATALOGUE) | set(FITS))
    assert all(one.places and one.places <= PLACES for one in EFFECTS.values())


# ---- the equations, without noise


def servo_steps(command, period, w, zeta, washout=math.inf):
    """Exact answer of the second-order servo to a command held over each period: angle at each period's start.
    washout [s]: of the command's slow part, which does not act."""
    a = np.array([[0.0, 1.0, 0.0, 0.0], [-w * w, -2.0 * zeta * w, -w * w, w * w],
                  [0.0, 0.0, -1.0 / washout, 1.0 / washout], [0.0, 0.0, 0.0, 0.0]])
    move = expm(a * period)
    state, angles = np.zeros(4), []
    for value in command:
        state[3] = value
        angles.append(state[0])
        state = move @ state
    return np.array(angles)


def test_clean_flight_is_the_exact_solution_of_the_linear_loop():
    craft = vehicle("constant")
    w, zeta, tau, period = craft.servo_frequency, craft.servo_damping, craft.filter_time, craft.period
    a = np.zeros((5, 5))  # theta, theta_dot, beta, beta_dot, command
    a[0, 1], a[1, 0], a[1, 2], a[2, 3] = 1.0, 2.0, -7.0, 1.0
    a[3] = 0.0, 0.0, -w * w, -2.0 * zeta * w, w * w
    move = expm(a * period)
    flown = quiet(duration=40.0)
    x, derivative, last, rows = np.zeros(5), 0.0, None, []
    for t in flown["t"]:
        error = x[0] - np.interp(t, craft.turn_t, craft.turn)
        last = error if last is None else last
        derivative = (tau * derivative + error - last) / (tau + period)
        last = error
        x[4] = craft.kp * error + craft.kd * derivative
        rows.append((x[4], x[2], x[0], x[1]))
        x = move @ x
    for name, column in zip(MEASURED, np.array(rows).T, strict=True):
        assert np.abs(column).max() < craft.deflection_limit or name != "beta_cmd"
        assert rms(flown[name] - column) < 1e-7 * rms(column), name


@pytest.mark.parametrize("delay", [0.0, 0.00025, 0.0325])
def test_actuator_delay_is_what_it_says(delay):
    """The nozzle answers the logged command exactly `delay` later."""
    effects = (hide("actuator_delay", {"delay": delay}),) if delay else ()
    flown = quiet(*effects, duration=20.0)
    per_period, late = round(0.01 / SUBSTEP), round(delay / SUBSTEP)
    command = np.concatenate([np.zeros(late), np.repeat(flown["beta_cmd"], per_period)])
    exact = servo_steps(command, SUBSTEP, 50.0, 0.7)[:per_period * len(flown["t"]):per_period]
    assert rms(flown["beta"] - exact) < 1e-6 * rms(exact)


@pytest.mark.parametrize(("cause", "parameters", "expected"), [
    ("actuator_gain", {"scale": 0.9}, lambda u: servo_steps(0.9 * u, 0.01, 50.0, 0.7)),
    ("actuator_bias", {"angle": 0.01}, lambda u: servo_steps(u + 0.01, 0.01, 50.0, 0.7)),
    ("input_washout", {"time_constant": 2.0}, lambda u: servo_steps(u, 0.01, 50.0, 0.7, 2.0)),
    ("actuator_bandwidth", {"scale": 0.6}, lambda u: servo_steps(u, 0.01, 30.0, 0.7)),
    ("nozzle_sensor_bias", {"angle": -0.01}, lambda u: servo_steps(u, 0.01, 50.0, 0.7) - 0.01)])
def test_actuator_and_nozzle_sensor_by_their_equation(cause, parameters, expected):
    flown = quiet(hide(cause, parameters), duration=20.0)
    exact = expected(flown["beta_cmd"])
    assert rms(flown["beta"] - exact) < 1e-6 * rms(exact)


def test_backlash_holds_the_nozzle_within_its_play_of_the_command():
    slow = quiet(hide("actuator_backlash", {"half_width": 0.002}), duration=20.0)
    climbing = slice(1000, 1500)  # rows of a steady ramp: the nozzle trails by the play and a little servo lag
    assert 0.002 < (slow["beta"] - slow["beta_cmd"])[climbing].max() < 1.15 * 0.002


@pytest.mark.parametrize("variant", [PLAIN, OTHER])
def test_rate_limit_holds(variant):
    """The limit also holds with the noise that drives the nozzle fastest."""
    noise = Noise(nozzle=0.0)
    limited = fly(Spec(noise=noise, duration=20.0, effects=(hide("actuator_rate_limit", {"rate": 0.1}, variant),)))[0]
    free = fly(Spec(noise=noise, duration=20.0))[0]
    assert np.abs(np.diff(limited["beta"])).max() <= 0.1 * 0.01 * (1 + 1e-9)
    assert np.abs(np.diff(free["beta"])).max() > 0.15 * 0.01


EXTRA = {  # cause -> parameters, and the angular acceleration beside 2 theta - 7 beta of columns c
    "control_effectiveness": ({"scale": 0.8}, lambda c: 0.2 * 7.0 * c["beta"]),
    "control_loss": ({"fraction": 0.2, "time": 9.0}, lambda c: 0.2 * 7.0 * c["beta"] * (c["t"] >= 9.0)),
    "aero_instability": ({"scale": 1.2}, lambda c: 0.2 * 2.0 * c["theta"]),
    "aero_damping": ({"coefficient": 0.5}, lambda c: -0.5 * c["theta_dot"]),
    "aero_cubic": ({"coefficient": -8.0}, lambda c: 2.0 * -8.0 * c["theta"]**3),
    "friction": ({"coefficient": 0.01}, lambda c: -0.01 * np.sign(c["theta_dot"])),
    "thrust_misalignment": ({"angle": 0.01}, lambda c: -7.0 * 0.01 * np.ones(len(c["t"]))),
    "steady_wind": ({"angle": 0.01}, lambda c: 2.0 * 0.01 * np.ones(len(c["t"]))),
    "gust": ({"angle": 0.02, "time": 8.0, "duration": 4.0}, lambda c: 2.0 * 0.02 * np.where(
        (c["t"] > 8.0) & (c["t"] < 12.0), (1.0 - np.cos(2.0 * np.pi * (c["t"] - 8.0) / 4.0)) / 2.0, 0.0)),
    "periodic_disturbance": ({"amplitude": 0.02, "frequency": 5.0, "phase": 0.7},
                             lambda c: 0.02 * np.sin(5.0 * c["t"] + 0.7))}


@pytest.mark.parametrize("cause", EXTRA)
def test_plant_and_environment_by_their_equation(cause):
    parameters, expected = EXTRA[cause]
    flown = quiet(hide(cause, parameters), rate=1000.0, duration=15.0)
    turn = np.gradient(flown["theta_dot"], flown["t"])
    extra = expected(flown)
    busy = flown["t"] > 6.5
    assert rms((turn - 2.0 * flown["theta"] + 7.0 * flown["beta"] - extra)[busy]) < 0.03 * rms(extra[busy])


def test_slosh_rings_at_its_frequency_and_by_its_law():
    """The moment left over drives the contract's oscillator back to itself."""
    w, coupling, damping = 4.0, 0.2, 0.05
    flown = quiet(hide("slosh", {"coupling": coupling, "frequency": w, "damping_ratio": damping}), rate=1000.0,
                  duration=15.0)
    turn, h = np.gradient(flown["theta_dot"], flown["t"]), 1e-3
    psi = (turn - 2.0 * flown["theta"] + 7.0 * flown["beta"]) / (coupling * w * w)
    x, predicted = np.zeros(2), []
    for push in turn:  # semi-implicit Euler is enough for 1 %
        predicted.append(x[0])
        x[1] += h * (-push - 2.0 * damping * w * x[1] - w * w * x[0])
        x[0] += h * x[1]
    assert rms(psi - predicted) < 0.02 * rms(psi)


def test_bending_at_rest_deflects_by_its_gain():
    """A quarter of a minute of constant nozzle angle: z_theta is theta plus gain times beta."""
    still = hide("steady_wind", {"angle": 0.02})
    bent = quiet(still, hide("bending", {"gain": 0.05, "frequency": 25.0, "damping_ratio": 0.1}), rate=200.0,
                 duration=6.0)
    last = {name: column[-1] for name, column in bent.items()}
    true = 3.5 * last["beta"] - 0.02  # trim of 2 (theta + wind) - 7 beta = 0
    assert last["theta"] - true == pytest.approx(0.05 * last["beta"], rel=0.05)


# ---- sensors


def test_gyro_and_nozzle_sensor_faults_leave_the_flight_alone():
    clean = fly(Spec(seed=4, duration=20.0))[0]
    for cause in ("gyro_bias", "gyro_scale", "gyro_delay", "nozzle_sensor_bias"):
        flown = fly(Spec(seed=4, duration=20.0, effects=(cause_at(cause),)))[0]
        differs = {name for name in COLUMNS if not np.array_equal(flown[name], clean[name])}
        assert differs == {"beta" if cause.startswith("nozzle") else "theta_dot"}


def test_gyro_delay_bias_and_scale_are_what_they_say():
    clean = quiet(rate=200.0, duration=20.0)["theta_dot"]
    late = quiet(hide("gyro_delay", {"delay": 0.015}), rate=200.0, duration=20.0)["theta_dot"]
    assert np.array_equal(late[3:], clean[:-3]) and not late[:3].any()
    assert np.allclose(quiet(hide("gyro_bias", {"rate": 0.02}), rate=200.0, duration=20.0)["theta_dot"], clean + 0.02)
    assert np.allclose(quiet(hide("gyro_scale", {"scale": 0.9}), rate=200.0, duration=20.0)["theta_dot"], 0.9 * clean)


@pytest.mark.parametrize("delay", [0.0, 0.025])
def test_attitude_delay_is_what_it_says(delay):
    """The attitude is the rate's integral, `delay` ago."""
    flown = quiet(*((hide("attitude_delay", {"delay": delay}),) if delay else ()), rate=200.0, duration=20.0)
    rate, rows = flown["theta_dot"], round(delay * 200.0)
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]))]) / 200.0
    assert rms(flown["theta"][rows:] - integral[:len(rate) - rows]) < 1e-4 * rms(integral)


def test_attitude_bias_is_seen_by_the_controller_too():
    flown = quiet(hide("attitude_bias", {"angle": 0.02}), duration=5.0)
    assert flown["theta"][0] == 0.02
    assert flown["beta_cmd"][0] == pytest.approx(1.2 * 0.02)  # the derivative starts at rest


# ---- controller, noise, rates


def commands(columns, kp=1.2, kd=0.5, tau=0.05, period=0.01):
    """The nominal controller's output, recomputed from the log (every tick a row)."""
    error = columns["theta"] - columns["theta_ref"]
    derivative, out = 0.0, []
    for now, last in zip(error, np.concatenate([error[:1], error[:-1]]), strict=True):
        derivative = (tau * derivative + now - last) / (tau + period)
        out.append(min(max(kp * now + kd * derivative, -0.12), 0.12))
    return np.array(out)


def test_logged_command_is_the_nominal_controller_s_of_the_logged_attitude():
    flown = fly(Spec(seed=1))[0]
    assert np.abs(commands(flown) - flown["beta_cmd"]).max() < 1e-12
    fast = fly(Spec(seed=1, rate=200.0))[0]
    even = {name: column[::2] for name, column in fast.items()}
    assert np.abs(commands(even) - even["beta_cmd"]).max() < 1e-12
    assert np.array_equal(fast["beta_cmd"][1::2], fast["beta_cmd"][::2])


def test_controller_mismatch_by_its_equation():
    off = hide("controller_mismatch", {"kp_scale": 0.9, "kd_scale": 1.2, "delay": 0.02})
    flown = fly(Spec(seed=1, effects=(off,)))[0]
    computed = commands(flown, kp=0.9 * 1.2, kd=1.2 * 0.5)
    assert np.abs(computed[:-2] - flown["beta_cmd"][2:]).max() < 1e-12 and not flown["beta_cmd"][:2].any()


def test_half_the_rate_is_the_same_flight():
    full, half = fly(Spec(seed=2))[0], fly(Spec(seed=2, rate=50.0))[0]
    assert all(np.array_equal(full[name][::2], half[name]) for name in COLUMNS)


def test_noise_is_as_declared():
    craft, clean = vehicle("constant"), quiet()
    for name, level, noise in (("theta_dot", craft.gyro_noise, Noise(0.0, 1.3, 0.0, 0.0, 0.0)),
                               ("beta", craft.nozzle_noise, Noise(0.0, 0.0, 1.3, 0.0, 0.0))):
        error = fly(Spec(seed=3, noise=noise))[0][name] - clean[name]
        assert np.std(error) == pytest.approx(1.3 * level, rel=0.03)
        assert abs(np.mean(error[1:] * error[:-1])) < 0.05 * np.var(error)
    theta = fly(Spec(seed=3, noise=dataclasses.replace(QUIET, attitude=1.3), rate=200.0))[0]["theta"]
    assert np.std(np.diff(theta, 3)) / math.sqrt(20.0) == pytest.approx(1.3 * craft.attitude_noise, rel=0.05)
    course = Build(Spec(seed=3, noise=Noise(command=0.7, push=1.4))).parts()[2]
    assert np.std(course.command_noise) == pytest.approx(0.7 * craft.command_noise, rel=0.03)
    assert np.std(course.rattle) == pytest.approx(1.4 * craft.push_noise, rel=0.03)


def test_command_noise_comes_after_the_logged_command():
    noise = dataclasses.replace(QUIET, command=1.0)
    flown = fly(Spec(seed=5, noise=noise, duration=20.0))[0]
    course = Build(Spec(seed=5, noise=noise, duration=20.0)).parts()[2]
    exact = servo_steps(flown["beta_cmd"] + course.command_noise, 0.01, 50.0, 0.7)
    assert rms(flown["beta"] - exact) < 1e-6 * rms(exact)


# ---- every effect


ALIKE = [cause for cause in LISTED if cause not in {"actuator_rate_limit"} | CHANCE]  # whose forms do much the same
CLEAN = {seed: fly(Spec(seed=seed))[0] for seed in (11,)}


@pytest.mark.parametrize(("name", "variant"), [
    *((name, PLAIN) for name in (*sorted(CHANCE), *UNLISTED)), *((name, OTHER) for name in LISTED if name not in ALIKE),
    *(pytest.param(name, variant, marks=pytest.mark.campaign) for name in ALIKE for variant in (PLAIN, OTHER))])
def test_every_effect_flies_and_shows(name, variant):
    spec = dataclasses.replace(draw_spec(11, name, factor=1.0, variant=variant), noise=Noise(), dispersion=(0.0, 0.0),
                               rate=100.0)
    flown, label = fly(spec)
    assert all(np.isfinite(column).all() for column in flown.values()), spec
    assert len(flown["t"]) > 1000, spec
    n = len(flown["t"])
    assert any(not np.array_equal(flown[column], CLEAN[11][column][:n]) for column in MEASURED), spec
    assert (label.names == (name,)) == (name in LISTED) and (label.unlisted == (name,)) == (name in UNLISTED)
    assert len(label.places) == 1 and label.places[0] <= PLACES


SIMILAR = 0.9  # cosine of what two forms of a cause do to a noise-free flight; friction, which sticks there: 0.949
SIZE_RANGE = 1.35  # and the ratio of their sizes, either way


@pytest.mark.parametrize("cause", ALIKE)
def test_other_form_does_much_the_same(cause):
    sign = -1.0 if cause == "actuator_bandwidth" else 1.0
    plain, other = (change(quiet(cause_at(cause, 1.0, sign, variant), duration=ENOUGH), undisturbed())
                    for variant in (PLAIN, OTHER))
    cosine = plain @ other / (np.linalg.norm(plain) * np.linalg.norm(other))
    ratio = np.linalg.norm(other) / np.linalg.norm(plain)
    assert not np.array_equal(plain, other)
    assert cosine > SIMILAR and 1.0 / SIZE_RANGE < ratio < SIZE_RANGE, (cosine, ratio)


# ---- against the project's simulator


def silenced(name: str) -> Nominal:
    nominal = load_nominal(name)
    assert nominal.actuator is not None and nominal.simulation is not None
    return dataclasses.replace(
        nominal, actuator=dataclasses.replace(nominal.actuator, command_noise_std=0.0),
        sensors=dataclasses.replace(nominal.sensors, theta_std=0.0, theta_dot_std=0.0, beta_std=0.0),
        simulation=dataclasses.replace(nominal.simulation, acceleration_noise_std=0.0))


SILENT = {name: silenced(name) for name in NAMES}
AGREE, AGREE_STEP = 1e-7, 1e-4  # of a column's rms: smooth causes; causes with an instant or a kink on the 1 ms grid
STEPPED = {"control_loss", "actuator_rate_limit", "moment_step"}
LATE = {"control_loss", "moment_step", "gust"}  # which begin somewhere in a flight
ENOUGH = 40.0  # s: two turns and half of vega_like's; pairs and clean flights agree to the end
AGREE_FRICTION = 1e-3  # at rest the project's friction chatters with coefficient times its step


def disagreement(nominal, effects, **fields):
    """Largest rms difference over the columns, in units of the column's rms."""
    flown, label = fly(Spec(nominal=nominal, noise=QUIET, effects=effects, **fields))
    same = [effect(cause["cause"], **cause["parameters"]) for cause in label.causes]
    believed = SILENT[nominal]
    if "duration" in fields:
        believed = dataclasses.replace(believed, simulation=dataclasses.replace(
            believed.simulation, duration=fields["duration"]))
    theirs = fly_whole(believed, effects=same, period=1.0 / fields.get("rate", 100.0))
    assert len(theirs.t) == len(flown["t"]) and theirs.lost == label.lost
    return max(rms(getattr(theirs, name) - flown[name]) / rms(flown[name]) for name in COLUMNS)


@pytest.mark.parametrize(("nominal", "rate"), [*zip(NAMES, (50.0, 100.0, 200.0), strict=True)])
def test_clean_flight_agrees_with_the_project(nominal, rate):
    assert disagreement(nominal, (), rate=rate) < 1e-8


@pytest.mark.parametrize(("nominal", "sign"), [
    ("constant", -1.0), *(pytest.param(name, 1.0, marks=pytest.mark.campaign) for name in ("constant", "vega_like"))])
@pytest.mark.parametrize("cause", [cause for cause in LISTED if cause not in CHANCE])
def test_every_cause_agrees_with_the_project(cause, nominal, sign):
    hidden = LISTED[cause](3.0, np.random.default_rng(5), nominal, sign=sign)
    allowed = AGREE_FRICTION if cause == "friction" else AGREE_STEP if cause in STEPPED else AGREE
    assert disagreement(nominal, (hidden,), **({} if cause in LATE else {"duration": ENOUGH})) < allowed


@pytest.mark.parametrize("seed", range(8))
def test_pairs_agree_with_the_project(seed):
    rng = np.random.default_rng(seed)
    names = rng.choice(sorted(set(LISTED) - {"friction"} - CHANCE), 2, replace=False)
    spec = draw_spec(seed, tuple(str(name) for name in names), "vega_like", factor=1.0)
    assert disagreement("vega_like", spec.effects) < AGREE_STEP, spec


SCATTER = 0.12  # relative, of a standard deviation from 4 flights with some 50 independent stretches each


@pytest.mark.parametrize("nominal", [pytest.param("constant", marks=pytest.mark.campaign), "vega_like"])
def test_noise_does_the_same_as_the_project_s(nominal):
    """Standard deviation of every measured column about the noise-free flight, and of its row-to-row changes."""
    quiet_ones = quiet(nominal=nominal), vars(fly_whole(SILENT[nominal]))
    flights = [fly(Spec(nominal, seed))[0] for seed in range(4)], \
        [vars(fly_whole(load_nominal(nominal), seed)) for seed in range(4)]
    for name in MEASURED:
        errors = [[flight[name] - calm[name] for flight in noisy]
                  for noisy, calm in zip(flights, quiet_ones, strict=True)]
        for order in (0, 1):
            mine, other = (rms(np.diff(error, order)) for error in errors)
            assert mine == pytest.approx(other, rel=SCATTER if order == 0 else 0.03), (name, order)


# ---- drawing, labels, files


def test_same_seed_same_bits_and_another_seed_another_flight():
    first, again, other = (fly(draw_spec(seed, "slosh", "vega_like")) for seed in (3, 3, 4))
    assert first[1] == again[1] and first[1] != other[1]
    assert all(np.array_equal(first[0][name], again[0][name]) for name in COLUMNS)
    assert not np.array_equal(first[0]["theta"][:100], other[0]["theta"][:100])


def test_double_the_size_changes_nothing_else():
    for cause in ("gust", "slosh", "periodic_disturbance", "control_loss"):
        once, twice = draw_spec(9, cause), draw_spec(9, cause, factor=2.0)
        assert dataclasses.replace(once, effects=()) == dataclasses.replace(twice, effects=())
        first, second = (told(spec.effects[0])["parameters"] for spec in (once, twice))
        size = CATALOGUE[cause].parameters[0].name
        assert second.pop(size) == pytest.approx(2.0 * first.pop(size))
        assert first == second


def test_draws_stay_in_their_ranges():
    specs = [draw_spec(seed) for seed in range(300)]
    factors = np.array([dataclasses.astuple(spec.noise) for spec in specs])
    assert 0.67 <= factors.min() < 0.75 and 1.35 < factors.max() <= 1.5
    deviations = np.array([spec.dispersion for spec in specs])
    assert np.std(deviations) == pytest.approx(0.02, rel=0.1) and np.abs(deviations).max() <= 0.05
    assert {spec.rate for spec in specs} == {50.0, 100.0, 200.0}
    assert draw_spec(1, rate=50.0, drop=("beta",)).drop == ("beta",)


@pytest.mark.parametrize("nominal", NAMES)
def test_times_fall_into_the_flight(nominal):
    end = vehicle(nominal).duration
    for seed in range(40):
        rng = np.random.default_rng(seed)
        gust, loss = (told(LISTED[cause](1.0, rng, nominal))["parameters"] for cause in ("gust", "control_loss"))
        flip = UNLISTED["gyro_flip"](1.0, rng, nominal)
        assert 5.0 <= gust["time"] and gust["time"] + gust["duration"] <= end - 4.9
        assert 10.0 < loss["time"] < end - 20.0
        assert 5.0 < flip["at_s"] and flip["at_s"] + flip["length_s"] < end


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("nominal", ["constant", "vega_like"])
def test_rough_reference_is_another_of_similar_amplitude(nominal, seed):
    flown, label = fly(Spec(nominal=nominal, seed=seed, reference="rough"))
    assert not label.lost and label.causes == ()
    largest = np.abs(flown["theta_ref"]).max()
    assert 0.2 * vehicle(nominal).turn_amplitude < largest <= 0.14
    assert not np.allclose(flown["theta_ref"], fly(Spec(nominal=nominal))[0]["theta_ref"])
    assert np.mean(np.abs(flown["beta_cmd"]) >= 0.12) < 0.01


@pytest.mark.parametrize("cause", LISTED)
def test_label_gives_back_what_was_hidden(cause):
    parameters = size_at(cause, 1.7, -1.0)
    assert set(parameters) == {parameter.name for parameter in CATALOGUE[cause].parameters} - FORMS
    label = fly(Spec(effects=(hide(cause, parameters),), duration=0.1))[1]
    assert label.names == (cause,) and label.places == (frozenset({CATALOGUE[cause].where}),)
    assert label.causes[0]["parameters"] == pytest.approx(parameters, rel=1e-12, abs=1e-15)
    effect(cause, **label.causes[0]["parameters"])


def test_lost_vehicle_ends_its_log():
    flown, label = fly(Spec(effects=(hide("control_effectiveness", {"scale": 0.3}),)))
    assert label.lost and label.t_end == flown["t"][-1] < 69.0
    assert 0.45 < np.abs(flown["theta"]).max() < LOST + 0.01
    assert not fly(Spec())[1].lost


def test_places_widen_when_the_deciding_column_is_dropped():
    friction = UNLISTED["servo_friction"](1.0, np.random.default_rng(0))
    full, label = fly(Spec(effects=(friction,), duration=1.0))
    assert label.places == (frozenset({"actuator"}),) and set(full) == set(COLUMNS)
    cut, label = fly(Spec(effects=(friction,), duration=1.0, drop=("beta",)))
    assert label.places[0] > {"actuator"} and set(cut) == set(COLUMNS) - {"beta"}


def test_one_effect_of_a_kind_a_delay_off_the_grid_and_unknown_names_are_refused():
    slosh = cause_at("slosh")
    with pytest.raises(ValueError, match="two effects"):
        fly(Spec(effects=(slosh, slosh)))
    with pytest.raises(ValueError, match="whole number"):
        hide("actuator_delay", {"delay": 0.0003})
    with pytest.raises(ValueError, match="whole number"):
        hide("controller_mismatch", {"kp_scale": 1.0, "kd_scale": 1.0, "delay": 0.005})
    with pytest.raises(ValueError, match="expected one of"):
        fly(Spec(nominal="saturn"))
    with pytest.raises(ValueError, match="whole number"):
        fly(Spec(rate=300.0))


def test_csv_holds_the_columns_and_nothing_else(tmp_path):
    flown, _ = fly(draw_spec(6, "gyro_bias", duration=5.0, rate=100.0))
    order = ("theta_dot", "beta", "t", "theta")
    write_csv(tmp_path / "some.csv", flown, order)
    write_csv(tmp_path / "all.csv", flown)
    log = read_log(tmp_path / "some.csv")
    assert (tmp_path / "some.csv").read_text().splitlines()[0] == ",".join(order) and log.ignored == ()
    assert all(np.array_equal(getattr(log, name), flown[name]) for name in order)
    whole = read_log(tmp_path / "all.csv")
    assert all(np.array_equal(getattr(whole, name), flown[name]) for name in COLUMNS)
    assert np.array_equal(flown["t"], np.round(0.01 * np.arange(500), 12))
