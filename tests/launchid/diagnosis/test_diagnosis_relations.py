"""The diagnosis' baseline by regression (`benchmarks/relations`) on logs of a known truth."""

import dataclasses
import importlib
import math
from pathlib import Path

import numpy as np
import public_flights as flights
import pytest

from launchid.diagnosis.controller.command import record
from launchid.diagnosis.controller.issued import with_commands
from launchid.diagnosis.data.record import Record
from launchid.diagnosis.data.used import used
from launchid.diagnosis.model.follower import NominalFollower
from launchid.log.detect import check
from launchid.log.log import log_of_values
from sim.effects import effect
from sim.nominal import load_nominal

with pytest.MonkeyPatch.context() as patch:  # of no installed package
    patch.syspath_prepend(str(Path(__file__).resolve().parents[3] / "benchmarks"))
    look = importlib.import_module("relations.look").look
    score = importlib.import_module("relations.score")

SHIP = "a6 = 0.0\nk1 = -0.0172", "", 0.05, "theta_std = 0.0005\ntheta_dot_std = 0.0001\nbeta_std = 0.0002"
ACROBOT = "a6 = 23.6\nk1 = 10.1", "", 0.005, "theta_std = 0.0005\ntheta_dot_std = 0.3\nbeta_std = 0.0005"
LOOP = ("a6 = 0.0\nk1 = 88.0", "natural_frequency = 500.0\ndamping_ratio = 0.7", 0.002,
        "theta_std = 0.0001\ntheta_dot_std = 0.02\nbeta_std = 0.001")
STAND = ("a6 = 2.0\nk1 = -6.0", "time_constant = 0.03", 0.01,
         "theta_std = 0.0002\ntheta_dot_std = 0.002\nbeta_std = 0.0001")
FRAME = ('terms = {"sin(theta)" = -10.4, beta = -3.4}', "natural_frequency = 1000.0\ndamping_ratio = 0.7", 0.05,
         "theta_std = 0.00015\ntheta_dot_std = 0.005\nbeta_std = 0.001")


@pytest.fixture
def recorded(tmp_path):
    """A record of columns beside a nominal (vehicle, actuator, period, noises)."""
    def make(columns: dict[str, np.ndarray], vehicle: str, actuator: str, period: float, noises: str) -> Record:
        path = tmp_path / "nominal.toml"
        servo = f"[actuator]\n{actuator}\n" if actuator else ""
        path.write_text(f"[vehicle]\n{vehicle}\n{servo}[sensors]\nperiod = {period}\n{noises}\n[simulation]\n"
                        "duration = 20.0\nacceleration_noise_std = 0.01\n")
        nominal, log = load_nominal(path), log_of_values("flown", columns)
        data = check(log, nominal)
        return used(with_commands(record(log, nominal, data), NominalFollower())[0], log.t[data.usable])[0]
    return make


def first(r: Record):
    """The first step of a look, which must be main and told beyond chance."""
    seen = look(r)
    assert seen is not None and seen.steps and seen.steps[0].share > 0.25 and seen.left < 0.5 * seen.free
    return seen.steps[0]


def test_a_ship_lacks_its_damping(recorded):
    step = first(recorded(flights.ship(), *SHIP))
    assert step.name == "aero_damping" and step.is_listed and not step.alike
    assert step.size == pytest.approx(-0.087, rel=0.05)


def test_of_an_attitude_alone_it_is_seen_as_well(recorded):
    columns = flights.ship()
    del columns["theta_dot"]
    step = first(recorded(columns, *SHIP))
    assert step.name == "aero_damping" and step.size == pytest.approx(-0.087, rel=0.1)


def test_a_second_link_kicks_back(recorded):
    step = first(recorded(flights.tail_wags_dog(), *ACROBOT))
    assert step.name == "nozzle_inertia" and step.is_listed


def test_a_loop_acts_late_by_its_delay(recorded):
    step = first(recorded(flights.rate_loop(0.034), *LOOP))
    assert step.name == "actuator_delay" and step.number == pytest.approx(0.034, abs=0.005)


def test_a_thrust_is_the_square_of_the_input(recorded):
    step = first(recorded(flights.fly(20.0, square=3.0, amplitude=0.1), *STAND))
    assert step.name == "missing_term(beta^2)" and step.size == pytest.approx(-18.0, rel=0.1)


def test_dry_friction_stops_a_swing(recorded):
    step = first(recorded(flights.swing(0.15), *FRAME))
    assert step.name == "friction" and step.size == pytest.approx(-0.15, rel=0.1)


def test_a_wheel_s_motor_washes_its_input_out(recorded):
    columns = flights.wheel()
    step = first(recorded(columns, FRAME[0].replace("10.4", "10.5"), *FRAME[1:]))
    assert "input_washout" in (step.name, *step.alike)


@pytest.mark.parametrize("row", [0.005, 0.01])
def test_in_a_log_as_the_nominal_says_nothing_is_missing(recorded, row):
    seen = look(recorded(flights.fly(30.0, row=row), STAND[0], STAND[1], row, STAND[3]))
    assert seen is not None and seen.steps == () and seen.free == pytest.approx(1.0, abs=0.1)


def test_a_number_that_is_off_is_no_structure(recorded):
    seen = look(recorded(flights.fly(30.0, a6=3.0), *STAND))
    assert seen is not None and seen.steps == () and seen.free < 0.9


@pytest.mark.parametrize("share", [0.4])
def test_an_input_of_another_time_names_no_listed_cause(recorded, share):
    columns = flights.fly(30.0, amplitude=0.1)
    for name in ("beta", "beta_cmd"):
        columns[name] = np.roll(columns[name], round(share * len(columns["t"])))
    seen = look(recorded(columns, *STAND))
    assert seen is None or not seen.steps or not seen.steps[0].is_listed or seen.steps[0].share < 0.25


def test_of_too_few_rows_and_of_a_nominal_with_effects_nothing_is_said(recorded):
    columns = flights.ship()
    assert look(recorded({name: x[:150] for name, x in columns.items()}, *SHIP)) is None
    r = recorded(columns, *SHIP)
    damped = dataclasses.replace(r.nominal, effects=(effect("aero_damping", coefficient=0.087),))
    assert look(dataclasses.replace(r, nominal=damped)) is None


# ---- the rows and the score


@pytest.mark.parametrize("order", [1, 2])
def test_a_row_of_a_wave_s_derivative_is_that_of_its_slope(order):
    """The error is of fourth order in the step: a wave of ten samples a period, whose slope a difference quotient
    misses by 6 %."""
    period, w = 0.01, 2.0 * math.pi / 0.1
    t = period * np.arange(41)
    by_parts = score.weights_of(order, 40, period) @ np.cos(w * t)
    slope = -w * np.sin(w * t) if order == 1 else -w * w * np.cos(w * t)
    plain = score.weights_of(0, 40, period, order)
    assert by_parts == pytest.approx(plain @ slope, abs=2e-3 * w**order)


def test_rows_left_out_are_predicted_by_the_others():
    rng = np.random.default_rng(3)
    x, fold = rng.normal(size=(600, 2)), np.arange(600) // 10 % 6
    y = x @ [2.0, -1.0] + 0.1 * rng.normal(size=600)
    fitted = score.left_out([x, x[:, :1]], y, fold)
    assert fitted.at == 0 and fitted.xi == pytest.approx([2.0, -1.0], abs=0.02)
    assert float(np.sqrt(np.mean(fitted.errors**2))) == pytest.approx(0.1, rel=0.1)
    held = x[fold == 2] @ np.linalg.lstsq(x[fold != 2], y[fold != 2], rcond=None)[0]
    assert fitted.errors[fold == 2] == pytest.approx(y[fold == 2] - held, abs=1e-6)


def test_a_column_of_noise_gains_nothing_beyond_chance():
    """Few of 200 columns of noise gain more than two of their standard errors."""
    rng, fold, block = np.random.default_rng(4), np.arange(960) // 20 % 6, np.arange(960) // 40
    base = rng.normal(size=(960, 1))
    y = base[:, 0] + rng.normal(size=960)
    before = score.left_out([base], y, fold).errors
    beyond = 0
    for _ in range(200):
        after = score.left_out([np.column_stack([base, rng.normal(size=960)])], y, fold).errors
        gained, deviation = score.gain(before, after, block)
        beyond += gained > 2.0 * deviation
    assert beyond <= 10


def test_windows_that_hold_a_gap_are_none():
    missing = np.zeros(4000, bool)
    missing[1000:1100] = True
    rows = score.rows_of(4000, 0.01, 1, 20, missing)
    assert rows is not None
    middle, half = rows.middle / 0.01, np.repeat(rows.steps, [len(at) for at in rows.first]) / 2.0
    assert not np.any((middle + half > 1000) & (middle - half < 1099))
    assert score.rows_of(60, 0.01, 1, 20, np.zeros(60, bool)) is None
