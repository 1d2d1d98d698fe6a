"""The simulator: its integration, loop and sensors against plain Python, and nominal files that cannot be used."""

import copy
import itertools
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
from every import every
from hypothesis import given
from hypothesis import strategies as hs
from shortened import short
from unjitted import unjitted, unjitted_module

from sim.effects import Changes, from_text
from sim.errors import InputError, UsageError
from sim.flight import SUITES, Flight, fly, fly_whole, noise
from sim.nominal import BUILT_IN, built_in, load_nominal
from sim.plant import dispersion
from sim.sections import Section
from sim.vehicle.actuator import delayed_command
from sim.vehicle.controller import limited
from sim.vehicle.record import CONTROLLER_TICK, SECTION, SENSOR_NOISE, Vehicle, assembled
from sim.vehicle.step import measure, runge_kutta_4

CONSTANT = tomllib.loads(built_in("constant").read_text(encoding="utf-8"))
SECTIONS = ("actuator", "controller", "guidance", "sensors", "simulation", "uncertainty", "vehicle")


def columns(flight: Flight) -> dict[str, np.ndarray]:
    names = ("t", "theta_ref", "beta_cmd", "beta", "theta", "theta_dot", "theta_ddot", "a6", "k1")
    return {name: getattr(flight, name) for name in names}


# ---- integration


def vehicle_at(h: float, a6: np.ndarray, k1: np.ndarray, **state: float) -> Vehicle:
    """A vehicle in a state, in steps of h [s], without commands; of a6 and k1 at every half step."""
    made = assembled({"step": h, "frequency": 20.0, "damping": 0.7}, Changes(), np.zeros(1, CONTROLLER_TICK),
                     np.zeros(1, SENSOR_NOISE),
                     a6, k1, np.zeros(1), np.zeros(0, SECTION), wind=None, drift=None)
    for name, value in state.items():
        made.flight[name] = value
    return made


def fly_open_loop(steps: int, duration: float = 0.4) -> np.ndarray:
    """State after `duration` of a varying plant under a constant command, in this many steps."""
    h = duration / steps
    half = np.arange(2 * steps + 1) * (0.5 * h)
    vehicle = vehicle_at(h, 2.0 + np.sin(9.0 * half), -7.0 + np.cos(7.0 * half), theta=0.1, theta_dot=-0.2, beta=0.05,
                         beta_dot=0.3)
    for i in range(steps):
        unjitted(runge_kutta_4)(vehicle, i, 1, 0.04, 0.1)
    return np.array(vehicle.flight[["theta", "theta_dot", "beta", "beta_dot"]][0].tolist())


def test_runge_kutta_is_of_fourth_order():
    fine = fly_open_loop(4 * 128)
    errors = [np.linalg.norm(fly_open_loop(steps) - fine) for steps in (32, 64, 128)]
    orders = np.log2([errors[0] / errors[1], errors[1] / errors[2]])
    assert (np.abs(orders - 4.0) < 0.35).all(), orders


def test_runge_kutta_on_a_constant_plant_is_the_exponential():
    """theta alone, k1 = 0: theta = c cosh + s sinh."""
    h, steps, a6 = 0.001, 500, 2.0
    vehicle = vehicle_at(h, np.full(2 * steps + 1, a6), np.zeros(2 * steps + 1), theta=0.1, theta_dot=0.3)
    for i in range(steps):
        unjitted(runge_kutta_4)(vehicle, i, 1, 0.0, 0.0)
    root, t, (state,) = math.sqrt(a6), h * steps, vehicle.flight
    assert state.theta == pytest.approx(0.1 * math.cosh(root * t) + 0.3 / root * math.sinh(root * t), rel=1e-12)
    assert state.theta_dot == pytest.approx(0.1 * root * math.sinh(root * t) + 0.3 * math.cosh(root * t), rel=1e-12)


EVERYTHING = (
    "aero_damping:coefficient=0.05", "aero_cubic:coefficient=3", "friction:coefficient=0.002",
    "thrust_misalignment:angle=0.003", "slosh:coupling=0.1,frequency=3", "bending:gain=0.05,frequency=20",
    "missing_term:term=theta*sin(beta),coefficient=5", "moment_step:acceleration=0.01,time=0.1",
    "nozzle_inertia:coefficient=-0.02", "lateral_drift:z_alpha=0.05,z_beta=0.02", "gust:angle=0.02,time=0,duration=0.3",
    "steady_wind:angle=0.01", "periodic_disturbance:amplitude=0.01,frequency=2", "actuator_delay:delay=0.013",
    "actuator_gain:scale=0.9", "actuator_bias:angle=0.002", "actuator_backlash:half_width=0.002",
    "actuator_bandwidth:scale=0.7,lag=0.5", "actuator_rate_limit:rate=0.3,wind_up=0.1", "input_washout:time_constant=5",
    "attitude_delay:delay=0.01", "attitude_bias:angle=0.005", "gyro_delay:delay=0.0234", "gyro_scale:scale=1.05",
    "gyro_bias:rate=0.002", "nozzle_sensor_bias:angle=0.002", "controller_mismatch:kp_scale=1.1,delay=0.013")
STIFF = {"natural_frequency": 900.0, "damping_ratio": 1.5}
FIRST_ORDER = {"natural_frequency": math.nan, "damping_ratio": math.nan, "time_constant": 0.02}
OTHER_LAW = {"law": "rate", "ki": 1.0, "kd": 0.0, "derivative_time_constant": 0.0,
             "filters": (Section((0.5, 0.2, -0.1), (1.0, -0.6, 0.2)),)}


@pytest.mark.parametrize(("servo", "law"), [({}, {}), (STIFF, {}), (FIRST_ORDER, OTHER_LAW)])
def test_compiled_steps_are_those_of_plain_python_bit_for_bit(servo, law):
    """Every effect at once and none, servos that a step resolves, stiff, and of first order, both laws, filters."""
    nominal = short(0.4, actuator=servo, controller=law)
    flights = [[columns(of(nominal, 1, "ideal", effects=[from_text(text) for text in texts]))
                for of in (fly_whole, unjitted_module("sim.flight").fly_whole)] for texts in ((), EVERYTHING)]
    for compiled, written in flights:
        assert len(compiled["t"]) == 400 and {name: column.tobytes() for name, column in compiled.items()} == {
            name: column.tobytes() for name, column in written.items()}
    assert flights[0][0]["beta"].tobytes() != flights[1][0]["beta"].tobytes()


# ---- the log


@pytest.mark.parametrize("suite", SUITES)
@pytest.mark.parametrize(("seed", "period"), [(0, None), (3, 0.02), (7, 0.003)])
def test_one_sample_at_a_time_is_the_whole_flight_bit_for_bit(suite, seed, period):
    nominal = short()
    whole = list(fly_whole(nominal, seed, suite, period).samples())
    one_by_one = list(fly(nominal, seed, suite, period))
    assert len(whole) > 100
    assert np.array(whole).tobytes() == np.array(one_by_one).tobytes()


@pytest.mark.parametrize("suite", SUITES)
def test_lost_flight_ends_alike_in_both(suite):
    nominal = short(20.0)
    flight = fly_whole(nominal, 0, suite, a6_factor=40.0)
    assert flight.lost and 1 < len(flight.t) < 20.0 / flight.period
    one_by_one = list(fly(nominal, 0, suite, a6_factor=40.0))
    assert np.array(list(flight.samples())).tobytes() == np.array(one_by_one).tobytes()


@pytest.mark.parametrize("suite", SUITES)
@pytest.mark.parametrize("every", [2, 5, 10])
def test_noise_does_not_depend_on_the_period_of_the_log(suite, every):
    nominal = short()
    fine = columns(fly_whole(nominal, 5, suite, 0.001))
    coarse = columns(fly_whole(nominal, 5, suite, 0.001 * every))
    for name, column in coarse.items():
        assert column.tobytes() == fine[name][::every].tobytes(), name


def test_streams_are_independent():
    draws = {name: noise(3, name, 1.0, 4000) for name in ("theta", "theta_dot", "beta", "command", "acceleration")}
    for a, b in itertools.combinations(draws, 2):
        assert abs(np.corrcoef(draws[a], draws[b])[0, 1]) < 0.08, (a, b)
    assert np.array_equal(noise(3, "beta", 2.0, 4000), 2.0 * draws["beta"])
    assert not np.array_equal(noise(4, "beta", 1.0, 4000), draws["beta"])
    assert np.array_equal(noise(3, "theta", 0.0, 5), np.zeros(5))


@pytest.mark.parametrize(("suite", "period"), [("flight", 0.01), ("ideal", 0.001)])
def test_rows_are_every_period_from_zero_to_before_the_end(suite, period):
    flight = fly_whole(short(3.0), 0, suite)
    assert flight.period == pytest.approx(period, rel=1e-12)
    assert flight.t.tolist() == [round(k * period, 12) for k in range(round(3.0 / period))]
    assert np.isnan(flight.theta_ddot).all() == (suite == "flight")


def test_ideal_sensors_read_the_truth_and_flight_sensors_have_the_nominal_s_noise():
    nominal = short(60.0, simulation={"acceleration_noise_std": 0.0})
    truth, read = fly_whole(nominal, 0, "ideal", 0.01), fly_whole(nominal, 0, "flight", 0.01)
    for name in ("theta", "theta_dot", "beta"):
        residual = getattr(read, name) - getattr(truth, name)
        assert np.std(residual) == pytest.approx(getattr(nominal.sensors, f"{name}_std"), rel=0.05)
        assert abs(np.mean(residual)) < 5 * np.std(residual) / math.sqrt(len(residual))


@pytest.mark.parametrize(("name", "value"), [
    *(("period", value) for value in (0.0105, -0.01, 0.0, 1e-4, math.nan, math.inf)), ("suite", "perfect")])
def test_period_that_is_no_whole_number_of_steps_and_unknown_suite_are_refused(name, value):
    with pytest.raises(UsageError, match=name):
        fly_whole(short(), **{name: value})


# ---- sensors


@given(truth=hs.floats(-10, 10), error=hs.floats(-1, 1), step=hs.floats(1e-6, 0.5))
def test_quantised_value_is_the_nearest_multiple(truth, error, step):
    value = unjitted(measure)(truth, error, step)
    assert abs(value / step - round(value / step)) < 1e-9
    assert abs(value - (truth + error)) <= 0.5 * step * (1 + 1e-9)


def test_quantised_flight_shows_multiples_only():
    steps = {"theta_step": 2.0**-12, "theta_dot_step": 2.0**-10, "beta_step": 2.0**-11}
    flight = fly_whole(short(sensors=steps), 0)
    for name in ("theta", "theta_dot", "beta"):
        multiple = getattr(flight, name) / steps[f"{name}_step"]
        assert np.array_equal(multiple, np.round(multiple)), name
        assert len(set(multiple.tolist())) > 3


# ---- the loop


def test_command_is_held_over_the_controller_s_period():
    flight = fly_whole(short(2.0), 0, "flight", 0.001)
    held = flight.beta_cmd.reshape(-1, 10)
    assert (held == held[:, :1]).all()
    assert len(np.unique(held[:, 0])) > 150


def test_reference_is_the_guidance_table():
    flight = fly_whole(load_nominal("constant"), 0)
    expected = np.interp(flight.t, CONSTANT["guidance"]["t"], CONSTANT["guidance"]["theta_ref"])
    assert np.allclose(flight.theta_ref, expected, atol=1e-15)
    assert np.abs(flight.theta - flight.theta_ref).max() < 0.1


@given(free=hs.floats(-5, 5))
def test_command_is_within_its_limit(free):
    assert unjitted(limited)(0.12, free) == (free if abs(free) <= 0.12 else math.copysign(0.12, free))


# ---- the actuator's delay


@given(seed=hs.integers(0, 1000), tick=hs.integers(0, 19), phase=hs.integers(0, 9),
       delay=hs.one_of(hs.floats(0.0, 0.15), hs.integers(0, 150).map(lambda k: k * 0.001)))
def test_delayed_command_is_the_mean_of_the_held_command_over_the_step(seed, tick, phase, delay):
    period, step = 0.01, 0.001
    commands = np.random.default_rng(seed).standard_normal(20)
    first = tick * period + phase * step - delay
    overlap = [max(0.0, min(first + step, (k + 1) * period) - max(first, k * period)) for k in range(20)]
    expected = float(np.dot(commands, overlap)) / step
    made = unjitted(delayed_command)(commands, tick, phase * step, step, period, delay)
    assert made == pytest.approx(expected, abs=1e-9)


def test_delay_destabilises_what_was_stable():
    assert not fly_whole(short(40.0), 0).lost
    assert fly_whole(short(40.0, actuator={"delay": 0.3}), 0).lost


# ---- the nominals that come with it


@pytest.mark.parametrize("name", BUILT_IN)
def test_built_in_nominal_has_every_section(name):
    nominal = load_nominal(name)
    nominal.require(*SECTIONS)
    assert nominal.name == name
    assert (nominal.vehicle.k1 < 0).all()
    assert load_nominal(built_in(name)).name == name


def test_constant_nominal_is_its_file():
    nominal = load_nominal("constant")
    for section in ("actuator", "controller", "sensors", "simulation"):
        for key, value in CONSTANT[section].items():
            assert getattr(getattr(nominal, section), key) == value, (section, key)
    assert (nominal.vehicle.a6.tolist(), nominal.vehicle.k1.tolist()) == ([2.0], [-7.0])
    assert (nominal.actuator.delay, nominal.diagnosis.tolerance, nominal.sensors.theta_step) == (0.0, 0.02, 0.0)


@pytest.mark.parametrize("name", BUILT_IN)
@pytest.mark.parametrize("corner", list(itertools.product((-1, 1), repeat=2)))
def test_dispersed_flights_are_not_lost(name, corner):
    nominal = load_nominal(name)
    a6_factor, k1_factor = dispersion(nominal, *corner)
    flight = fly_whole(nominal, 1, a6_factor=a6_factor, k1_factor=k1_factor)
    assert not flight.lost
    assert len(flight.t) == round(nominal.simulation.duration / flight.period)
    a6, k1 = nominal.vehicle.at(flight.t)
    sigma_a6, sigma_k1 = nominal.uncertainty.at(flight.t)
    assert np.allclose(flight.a6, a6 * (1 + corner[0] * sigma_a6))
    assert np.allclose(flight.k1, k1 * (1 + corner[1] * sigma_k1))


# ---- files that cannot be used


def toml_of(table: dict) -> str:
    """A TOML writer that is just enough for nominals."""
    def literal(value) -> str:
        if isinstance(value, bool):
            return str(value).lower()
        if isinstance(value, str):
            return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
        return "[" + ", ".join(map(literal, value)) + "]" if isinstance(value, list) else repr(value)

    plain = [f"{key} = {literal(value)}" for key, value in table.items() if not isinstance(value, dict)]
    parts = [f"\n[{name}]\n" + "\n".join(f"{key} = {literal(value)}" for key, value in section.items())
             for name, section in table.items() if isinstance(section, dict)]
    return "\n".join(plain + parts) + "\n"


def refused(path: Path, text: str | bytes) -> str:
    """The message with which a file is refused: one line that begins with its name."""
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError) as caught:
        load_nominal(path)
    message = str(caught.value)
    assert len(message.splitlines()) == 1
    assert message.startswith(str(path.parent))
    return message


def edited(section: str, key: str, value: object) -> str:
    table = copy.deepcopy(CONSTANT)
    table.setdefault(section, {})[key] = value
    return toml_of(table)


NUMBERS = [(section, key) for section in SECTIONS for key, value in CONSTANT[section].items()
           if not isinstance(value, list)]
OPTIONAL = {("actuator", "delay"), ("actuator", "command_noise_std"), ("actuator", "deflection_limit"),
            ("simulation", "step"), ("simulation", "acceleration_noise_std")}
EXTRA = [("actuator", "delay"), ("sensors", "theta_step"), ("sensors", "theta_dot_step"), ("sensors", "beta_step"),
         ("diagnosis", "tolerance")]
SIGNED = {("vehicle", "a6"), ("vehicle", "k1"), ("controller", "kp"), ("controller", "kd")}
POSITIVE = {("actuator", "natural_frequency"), ("actuator", "deflection_limit"), ("controller", "period"),
            ("sensors", "period"), ("simulation", "step"), ("simulation", "duration"), ("uncertainty", "a6"),
            ("uncertainty", "k1")}


@every(("section", "key"), NUMBERS + EXTRA)
@every("value", ["2.0", True, math.nan, math.inf, [1.0], -1.0, 0.0])
def test_wrong_number_is_named(tmp_path, section, key, value):
    place = (section, key)
    fine = (value == -1.0 and place in SIGNED) or (value == 0.0 and place not in POSITIVE)
    path = tmp_path / "nominal.toml"
    if fine and not isinstance(value, (bool, str, list)):
        path.write_text(edited(section, key, value))
        assert load_nominal(path).name == "constant"
        return
    message = refused(path, edited(section, key, value))
    assert f"{section}.{key}" in message
    assert repr(value) in message
    assert "expected a number" in message


@every(("section", "key"), [*NUMBERS, ("guidance", "t"), ("guidance", "theta_ref")])
def test_missing_key_is_named_unless_it_has_a_default(tmp_path, section, key):
    table = copy.deepcopy(CONSTANT)
    del table[section][key]
    path = tmp_path / "nominal.toml"
    if (section, key) in OPTIONAL:
        path.write_text(toml_of(table))
        assert load_nominal(path).name == "constant"
    else:
        assert f"'{section}.{key}' is missing" in refused(path, toml_of(table))


@pytest.mark.parametrize("section", ["actuator", "controller", "guidance", "simulation"])
def test_section_that_a_flight_needs_is_named(tmp_path, section):
    path = tmp_path / "nominal.toml"
    path.write_text(toml_of({name: value for name, value in CONSTANT.items() if name != section}))
    with pytest.raises(InputError, match=rf"\[{section}\] is missing") as caught:
        fly_whole(load_nominal(path))
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(("section", "key", "value"), [
    ("sensors", "period", 0.0105), ("controller", "period", 0.0005), ("simulation", "step", 0.003),
    ("simulation", "step", 0.02)])
def test_periods_that_are_no_whole_steps_are_named(tmp_path, section, key, value):
    message = refused(tmp_path / "nominal.toml", edited(section, key, value))
    assert "period" in message and "whole number of simulation steps" in message


@pytest.mark.parametrize("text", [
    pytest.param(edited("vehicle", "a6", 10**400), id="integer beyond float: OverflowError"),
    pytest.param(edited("vehicle", "a6", 0.0).replace("a6 = 0.0", "a6 = 1" + "0" * 5000),
                 id="integer beyond Python's digits: ValueError of tomllib"),
    pytest.param(edited("vehicle", "a6", 0.0).replace("a6 = 0.0", "a6 = " + "[" * 5000), id="nesting: RecursionError"),
    pytest.param('"two\\nlines" = 1\n' + toml_of(CONSTANT), id="key with a line feed: two lines of message"),
    pytest.param(toml_of({**CONSTANT, "vehicle": {"profile": "a"}}).replace('"a"', '"a\\u0000b"'),
                 id="profile path with NUL: ValueError"),
    pytest.param(toml_of({**CONSTANT, "vehicle": {"profile": "a"}}).replace('"a"', '"a\\nb"'),
                 id="profile path with a line feed: two lines of message"),
])
def test_odd_file_is_refused_in_one_line(tmp_path, text):
    refused(tmp_path / "nominal.toml", text)


@pytest.mark.parametrize("duration", [1e300, 1e12])
def test_absurd_duration_is_refused(duration):
    with pytest.raises((InputError, UsageError), match="duration"):
        fly_whole(short(duration))


def test_missing_file_and_folder_are_named(tmp_path):
    for path in (tmp_path / "none.toml", tmp_path):
        with pytest.raises(InputError) as caught:
            load_nominal(path)
        assert str(path) in str(caught.value) and len(str(caught.value).splitlines()) == 1


def test_profile_is_found_beside_its_nominal(tmp_path):
    (tmp_path / "profile.csv").write_text("t,a6,k1\n0,1,-2\n\n10,3,-4\n")
    (tmp_path / "nominal.toml").write_text(toml_of({**CONSTANT, "vehicle": {"profile": "profile.csv"}}))
    assert load_nominal(tmp_path / "nominal.toml").vehicle.a6.tolist() == [1.0, 3.0]
    message = refused(tmp_path / "other.toml", toml_of({**CONSTANT, "vehicle": {"profile": "none.csv"}}))
    assert str(tmp_path / "none.csv") in message


@pytest.mark.parametrize(("column", "text"), [("a6", "t,a6,k1\n0,0,1\n"), ("k1", "t,a6,k1\n0,1,-1\n")])
def test_sigma_profile_must_be_positive(tmp_path, column, text):
    (tmp_path / "sigma.csv").write_text(text)
    message = refused(tmp_path / "n.toml", toml_of({**CONSTANT, "uncertainty": {"profile": "sigma.csv"}}))
    assert "uncertainty.profile" in message and "above 0" in message


@pytest.mark.parametrize(("period", "step"), [(0.01, 0.001), (1 / 128, 1 / 1024), (1 / 400, 1 / 1200), (0.004, 0.001)])
def test_a_step_that_is_not_named_follows_from_the_periods(tmp_path, period, step):
    """128 and 400 Hz are no whole numbers of milliseconds."""
    (tmp_path / "n.toml").write_text(f"""[vehicle]
a6 = 2.0
k1 = -7.0
[sensors]
period = {period!r}
theta_std = 0.0
theta_dot_std = 0.0
beta_std = 0.0
[simulation]
duration = 1.0
""")
    made = load_nominal(tmp_path / "n.toml").simulation.step
    assert made == pytest.approx(step) and period / made == pytest.approx(round(period / made), abs=1e-9)
