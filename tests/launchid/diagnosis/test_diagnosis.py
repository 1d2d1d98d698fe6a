"""launchid diagnose on flights of the project's own simulator: verdicts, sets, JSON, the extension, what a nominal may
declare, columns that are missing (flights of another generator: test_estimate_and_take_away.py, test_diagnosis_set.py).
"""

import dataclasses
import functools
import itertools
import json
import math
import os
import subprocess
import sys

import numpy as np
import pytest
from shortened import short

from launchid.diagnosis import model
from launchid.diagnosis.answer import extension, headline, lines, report
from launchid.diagnosis.verdict import diagnose
from launchid.log.log import OPTIONAL, REQUIRED, Log, read_log, write_flight
from launchid.main import main
from launchid.report.diagnosis_page import write_report
from sim.effects import from_text, values
from sim.flight import fly_whole
from sim.nominal import load_nominal, write_nominal
from sim.sections import Drift, Offsets, Wind

LONG = pytest.mark.campaign  # the same law once more: one of each stays in the default run


NOMINAL = short(30.0)  # a turn from 6 to 16 s, and the start of the next


def log_of(flight, drop=()):
    """A log as `read_log` would give it."""
    columns = {name: getattr(flight, name).copy() if hasattr(flight, name) and name not in drop
               else np.full(len(flight.t), math.nan) for name in REQUIRED + OPTIONAL}
    known = tuple(name for name, values in columns.items() if np.isfinite(values).any())
    return Log("flight.csv", known, (), **columns)


def flown(*effects, seed=1, drop=(), period=None, nominal=NOMINAL):
    return log_of(fly_whole(nominal, seed, period=period, effects=[from_text(text) for text in effects]), drop)


def found(*effects, nominal=NOMINAL, **options):
    return report(diagnose(flown(*effects, nominal=nominal, **options), nominal))


@functools.cache
def damped():
    """The diagnosis of a flight of 20 s with damping: three tests read it."""
    nominal = short(20.0)
    return diagnose(flown("aero_damping:coefficient=0.3", seed=3, nominal=nominal), nominal,
                    holdout=flown("aero_damping:coefficient=0.3", seed=2, nominal=nominal))


def named(result):
    return [cause["cause"] for cause in result["causes"]]


def changed(log, **columns):
    """The log with functions applied to copies of its columns."""
    return dataclasses.replace(log, **{name: change(getattr(log, name).copy()) for name, change in columns.items()})


# ---- verdicts


def test_a_clean_flight_is_consistent_and_says_what_it_would_have_shown():
    result = found(seed=7)
    assert (result["verdict"], result["where"], result["causes"]) == ("consistent", None, [])
    assert not any(level["significant"] for level in result["noise"].values())
    assert 1e-3 < result["limits"]["actuator_delay"]["size"] < 5e-3   # s, what the nominal leaves open and more
    assert 3e-5 < result["limits"]["gyro_bias"]["size"] < 3e-4        # rad/s
    json.dumps(result, allow_nan=False)


def test_what_this_log_cannot_tell_apart_is_answered_by_the_set():
    result, members = found("steady_wind:angle=0.01"), {"steady_wind", "attitude_bias", "thrust_misalignment"}
    assert members <= {result["causes"][0]["cause"], *result["causes"][0]["indistinguishable_from"]}
    assert result["causes"][0]["would_decide"] and set(result["either"][0]) >= members


@pytest.mark.parametrize("drop", [
    ("theta_ref", "beta_cmd"), ("theta_dot", "beta", "beta_cmd"), pytest.param(("theta",), marks=LONG)])
def test_missing_columns_remove_channels_and_never_fail(drop):
    result = found(drop=drop, seed=3, nominal=short(20.0))
    assert result["verdict"] == "consistent", result["doubts"]
    assert set(result["noise"]) <= {"theta", "theta_dot", "beta", "command", "acceleration"} - set(drop)


# ---- what a nominal may declare


@pytest.mark.parametrize("effects", [
    "aero_damping:coefficient=0.3 gyro_bias:rate=0.004 slosh:coupling=0.2,frequency=5 actuator_delay:delay=0.02",
    pytest.param("control_loss:fraction=0.3,time=10 gust:angle=0.02,time=15,duration=4 attitude_bias:angle=0.01 "
                 "actuator_backlash:half_width=0.002", marks=LONG),
    pytest.param("aero_cubic:coefficient=8 bending:gain=0.004,frequency=25 gyro_scale:scale=0.9 "
                 "actuator_rate_limit:rate=0.1 moment_step:acceleration=0.02,time=12", marks=LONG),
    pytest.param("periodic_disturbance:amplitude=0.02,frequency=6 actuator_bandwidth:scale=0.6 "
                 "attitude_delay:delay=0.02 missing_term:term=theta_dot^3,coefficient=-2", marks=LONG)])
def test_effects_that_the_nominal_has_are_no_cause(effects):
    """Flown with them, and believed with them."""
    believed = dataclasses.replace(NOMINAL, effects=tuple(from_text(each) for each in effects.split()))
    result = report(diagnose(log_of(fly_whole(believed, 5)), believed))
    assert result["verdict"] == "consistent", result["doubts"]


@pytest.mark.parametrize("sections", [
    {"drift": Drift(np.zeros(1), np.array([0.08]), np.array([0.04])), "wind": Wind(walk=0.003)},
    pytest.param({"wind": Wind(walk=0.002, turbulence=0.005)}, marks=LONG),
    pytest.param({"offsets": Offsets(thrust_misalignment=0.004, gyro_bias=2e-3, nozzle_sensor_bias=2e-3)}, marks=LONG)])
def test_drift_wind_and_offsets_that_the_nominal_declares_are_no_cause(sections):
    believed = dataclasses.replace(short(20.0), **sections)
    result = report(diagnose(log_of(fly_whole(believed, 5)), believed))
    assert result["verdict"] == "consistent", result["doubts"]


# ---- bad, short and late logs


def stuck(x):
    x[700:740] = x[700]
    return x


def test_faults_of_rows_are_masked_and_the_rest_is_judged():
    """The verdict is the rest's, and what is wrong with the log is said."""
    result = report(diagnose(changed(flown("gyro_bias:rate=0.003", seed=4), theta_dot=stuck), NOMINAL))
    assert (result["verdict"], named(result)) == ("explained", ["gyro_bias"])
    fault, = result["data"]["faults"]
    assert (fault["kind"], fault["channel"]) == ("stale", "theta_dot") and "theta_dot" in fault["message"]


@pytest.mark.parametrize("columns", [{"theta_dot": np.degrees}, {"t": lambda t: 1000.0 * t}, {"beta": np.negative}])
def test_faults_of_columns_stop_the_diagnosis(columns):
    result = report(diagnose(changed(flown(seed=4), **columns), NOMINAL))
    assert (result["verdict"], result["where"], result["causes"], result["gain"]) == ("bad-data", "data", [], None)
    assert result["remainder"] is None and result["remaining"] == []
    json.dumps(result, allow_nan=False)


@pytest.mark.parametrize(("rows", "verdict"), [(2, "unexplained"), (30, "unexplained"), (120, "consistent")])
def test_a_short_log_shows_nothing_and_a_shorter_one_is_not_tested(rows, verdict):
    whole = flown(seed=4)
    log = dataclasses.replace(whole, **{name: getattr(whole, name)[:rows] for name in REQUIRED + OPTIONAL})
    made = report(diagnose(log, NOMINAL))
    assert made["verdict"] == verdict and made["causes"] == []


def test_the_extension_holds_the_standard_deviations_of_what_was_found():
    """Slosh becomes [[slosh]] with its sigmas, which its size keeps, and a servo's delay [actuator] delay_sigma."""
    log = flown("slosh:coupling=0.2,frequency=5")
    mode, = extension(diagnose(log, NOMINAL)).slosh
    (coupling,), (frequency,) = mode.coupling.value, mode.frequency.value
    assert abs(coupling - 0.2) < 4.0 * mode.coupling_sigma * coupling < 0.1
    assert abs(frequency - 5.0) < 4.0 * mode.frequency_sigma * frequency < 0.5
    late = extension(diagnose(flown("actuator_delay:delay=0.03"), NOMINAL))
    delay, = (values(each)["delay"] for each in late.effects)
    assert abs(delay - 0.03) < 4.0 * late.actuator.delay_sigma < 0.02


@LONG
def test_times_are_those_of_the_logs_clock():
    """A log whose clock starts at 20,000 s: the loss is reported, written and accepted at that clock."""
    log = changed(flown("control_loss:fraction=0.2,time=12"), t=lambda t: t + 20000.0)
    made = diagnose(log, NOMINAL)
    assert report(made)["causes"][0]["parameters"]["time"]["value"] == pytest.approx(20012.0, abs=0.2)
    assert report(diagnose(log, extension(made)))["verdict"] == "consistent"


def test_a_second_log_judges_the_extension():
    gain = report(damped())["gain"]
    assert gain["source"] == "a second log" and gain["nats"] > 50.0
    assert gain["after"] < 0.6 * gain["before"]


@LONG
def test_clean_flights_of_the_nominal_are_counted_beside():
    result = report(diagnose(flown(seed=4), NOMINAL, bootstrap=2))
    assert result["false_alarms"]["flights"] == 2 >= result["false_alarms"]["not_consistent"]


def test_the_same_log_gives_the_same_bytes_on_any_number_of_threads(tmp_path):
    log, nominal = tmp_path / "log.csv", tmp_path / "nominal.toml"
    write_flight(log, fly_whole(short(12.0), 2, effects=[from_text("gyro_bias:rate=0.003")]))
    write_nominal(short(12.0), nominal)
    said = {subprocess.run([sys.executable, "-m", "launchid", "diagnose", str(log), str(nominal), "--json", "-"],
                           env=os.environ | {"OPENBLAS_NUM_THREADS": threads}, capture_output=True, check=True,
                           text=True).stdout for threads in ("1", "2")}
    assert len(said) == 1 and "gyro_bias" in said.pop()


# ---- the emergency brake


def test_what_the_brake_stops_has_no_answer_and_says_so_everywhere(monkeypatch, tmp_path):
    ticks = itertools.count(step=200.0)
    monkeypatch.setattr(model.time, "monotonic", lambda: next(ticks))
    made = diagnose(flown("aero_damping:coefficient=0.8"), NOMINAL)
    answer = report(made)
    assert (answer["verdict"], answer["cut_short"]) == ("unexplained", True)
    assert answer["causes"] == answer["nearest"] == []
    write_report(made, answer, tmp_path)
    for words in (headline(made), "\n".join(lines(made)), (tmp_path / "report.html").read_text()):
        assert "cut short" in words.lower()


# ---- files


def test_the_extension_flies_and_explains(tmp_path, capsys):
    """simulate --effect, diagnose, then diagnose with the extension: consistent."""
    log, path = tmp_path / "log.csv", tmp_path / "extension.toml"
    write_flight(log, fly_whole(short(20.0), 3, effects=[from_text("aero_damping:coefficient=0.3")]))
    cause, = report(damped())["causes"]
    value = cause["parameters"]["coefficient"]
    assert (damped().verdict, cause["cause"], cause["where"]) == ("explained", "aero_damping", "plant")
    assert abs(value["value"] - 0.3) < 4.0 * value["std"]
    write_nominal(extension(damped()), path)
    assert main(["diagnose", str(log), str(path), "--json", "-"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["verdict"] == "consistent", again["doubts"]
    assert main(["simulate", str(path), "--out", str(tmp_path / "new.csv")]) == 0


def test_a_log_without_nozzle_and_command_needs_a_reference(tmp_path, capsys):
    path = tmp_path / "log.csv"
    path.write_text("t,theta\n" + "".join(f"{0.01 * k},{1e-3 * math.sin(0.1 * k)}\n" for k in range(200)))
    assert main(["diagnose", str(path), "constant"]) == 3
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "beta_cmd" in error


# ---- real logs


@pytest.mark.parametrize("name", ["dircol", pytest.param("ddp", marks=LONG)])
def test_a_real_pendulum_gets_its_sine(real_logs, name):
    """A nominal wrong on purpose, linear in theta and without friction: sin(theta) comes in the place of theta, and the
    error on blocks left out falls, the nominal in the noise that makes it likeliest."""
    made = diagnose(read_log(real_logs / f"dfki_pendulum_{name}.csv"), load_nominal("pendulum_linear"))
    sines = [each.values["coefficient"] for each in (*made.named, *made.nearest)
             if each.values.get("term") == "sin(theta)"]
    assert len(sines) == 1 and -23.0 < sines[0] < -15.0
    before, after = made.gain.nrmse(max(made.gain.squares))["theta_dot"]
    assert after < 0.25 * before
    assert made.gain.nats > 50.0
