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
from hidden import LISTED, OTHER, PLAIN, QUIET, UNLISTED, Noise, Spec, draw_spec, fly, hide, size_at
from hidden.build import Build
from hidden.catalogue import CAUSES, CHANCE
from hidden.flight import COLUMNS
from hidden.listed import FITS
from hidden.motion import LOST
from hidden.unlisted import EFFECTS
from hidden.vehicles import NAMES, PROFILES, vehicle
from scipy.linalg import expm

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


@functools.cache
def noisy():
    """The same with noise, of seed 11."""
    return fly(Spec(seed=11))[0]


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


# ---- every effect


ALIKE = [cause for cause in LISTED if cause not in {"actuator_rate_limit"} | CHANCE]  # whose forms do much the same


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
    assert any(not np.array_equal(flown[column], noisy()[column][:n]) for column in MEASURED), spec
    assert (label.names == (name,)) == (name in LISTED) and (label.unlisted == (name,)) == (name in UNLISTED)
    assert len(label.places) == 1 and label.places[0] <= PLACES


SIMILAR = 0.9  # cosine of what two forms of a cause do to a noise-free flight; friction, which sticks there: 0.949
SIZE_RANGE = 1.35  # and the ratio of their sizes, either way


@pytest.mark.parametrize("cause", [pytest.param(cause, marks=[pytest.mark.campaign] if k % 3 else [])
                                   for k, cause in enumerate(ALIKE)])
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


@pytest.mark.parametrize("seed", range(2))
def test_pairs_agree_with_the_project(seed):
    rng = np.random.default_rng(seed)
    names = rng.choice(sorted(set(LISTED) - {"friction"} - CHANCE), 2, replace=False)
    spec = draw_spec(seed, tuple(str(name) for name in names), "vega_like", factor=1.0)
    assert disagreement("vega_like", spec.effects) < AGREE_STEP, spec


# ---- drawing, labels, files


def test_same_seed_same_bits_and_another_seed_another_flight():
    first, again, other = (fly(draw_spec(seed, "slosh", "vega_like")) for seed in (3, 3, 4))
    assert first[1] == again[1] and first[1] != other[1]
    assert all(np.array_equal(first[0][name], again[0][name]) for name in COLUMNS)
    assert not np.array_equal(first[0]["theta"][:100], other[0]["theta"][:100])


def test_draws_stay_in_their_ranges():
    specs = [draw_spec(seed) for seed in range(300)]
    factors = np.array([dataclasses.astuple(spec.noise) for spec in specs])
    assert 0.67 <= factors.min() < 0.75 and 1.35 < factors.max() <= 1.5
    deviations = np.array([spec.dispersion for spec in specs])
    assert np.std(deviations) == pytest.approx(0.02, rel=0.1) and np.abs(deviations).max() <= 0.05
    assert {spec.rate for spec in specs} == {50.0, 100.0, 200.0}
    assert draw_spec(1, rate=50.0, drop=("beta",)).drop == ("beta",)


@pytest.mark.parametrize("nominal", ["constant", "vega_like"])
def test_rough_reference_is_another_of_similar_amplitude(nominal):
    flown, label = fly(Spec(nominal=nominal, seed=1, reference="rough"))
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
