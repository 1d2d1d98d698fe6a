"""Maps by name, on files made to the public formats' descriptions: PX4, ArduPilot, Betaflight, hobby rockets."""

import math
from pathlib import Path

import numpy as np
import pytest
from every import every
from test_convert import upright, write_ulog
from test_convert_text import dataflash

import launchid
from launchid.convert.mapping import map_for
from launchid.main import main
from sim.errors import InputError

T = np.arange(600) * 0.02
THETA = 0.1 * np.sin(1.3 * T) + 0.02 * np.sin(4.1 * T)
RATE = 0.13 * np.cos(1.3 * T) + 0.082 * np.cos(4.1 * T)
BETA = 0.05 * np.sin(2.0 * T + 0.4)
SERVO = 0.09 * math.pi / 180.0   # rad a microsecond
STEP = 1e-3 * math.pi / 180.0    # rad: degrees of three decimals


def table(path: Path, columns: dict[str, np.ndarray], form: str = "%.3f") -> str:
    rows = zip(*columns.values(), strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(form % x for x in row) for row in rows)]) + "\n")
    return str(path)


def hobby(columns: dict[str, np.ndarray], tmp_path: Path) -> launchid.Log:
    return launchid.read_log(table(tmp_path / "flight.csv", columns), map="tvc")


def test_px4(tmp_path, capsys):
    pytest.importorskip("pyulog")
    stamps = 7_000_000 + np.round(T * 1e6).astype(np.uint64)
    write_ulog(tmp_path / "f.ulg", {
        "vehicle_attitude": {"timestamp": stamps, "q": upright(THETA)},
        "vehicle_angular_velocity": {"timestamp": stamps, "xyz": np.stack([0 * T, RATE, 0 * T], axis=1)},
        "vehicle_torque_setpoint": {"timestamp": stamps, "xyz": np.stack([0 * T, BETA, 0 * T], axis=1)}})
    for log in (launchid.read_log(tmp_path / "f.ulg", map="px4"), launchid.read_log(tmp_path / "f.ulg")):
        assert np.allclose(log.theta, THETA - THETA[0], atol=1e-6)
        assert np.allclose(log.theta_dot, RATE, atol=1e-6)
        assert np.allclose(log.beta_cmd, BETA, atol=1e-6)
    assert main(["show", str(tmp_path / "f.ulg"), "--out", str(tmp_path / "s.png")]) == 0
    assert "read with --map px4: theta from vehicle_attitude/q" in capsys.readouterr().err


def test_ardupilot_needs_an_elevator_or_says_so(tmp_path):
    pytest.importorskip("pymavlink")
    dataflash(tmp_path / "log.bin")
    with pytest.raises(InputError, match="finds no beta_cmd"):
        launchid.read_log(tmp_path / "log.bin", map="ardupilot")
    (tmp_path / "own.toml").write_text('base = "ardupilot"\n[columns.beta_cmd]\nfrom = "RCOU/C1"\nscale = 0.001\n'
                                       "offset = -1.5\n")
    log = launchid.read_log(tmp_path / "log.bin", map=tmp_path / "own.toml")
    assert {"theta", "theta_dot", "beta_cmd"} <= set(log.columns)


def test_betaflight_in_tenths_of_degrees(tmp_path, capsys):
    path = table(tmp_path / "f.csv", {
        "loopIteration": np.arange(len(T)), "time (us)": np.round(T * 1e6) + 3e6,
        "gyroADC[1] (deg/s)": np.degrees(RATE), "attitude[1]": np.round(10.0 * np.degrees(THETA)),
        "servo[5]": 1500.0 + BETA / SERVO}, "%.10g")
    log = launchid.read_log(path, map="betaflight")
    assert np.allclose(log.theta, THETA, atol=0.06 * math.pi / 180.0)
    assert np.allclose(log.theta_dot, RATE, atol=1e-6)
    assert np.allclose(log.beta_cmd, BETA, atol=1e-6)
    assert launchid.read_log(path).is_same(log)


@every("names", [
    ("time_ms", "pitch_deg", "gyro_y_dps", "servo_us"), ("Time (ms)", "Pitch (deg)", "Gyro Y (dps)", "TVC Y (us)"),
    ("millis", "ori_pitch_deg", "gyroY_dps", "pwm_y"), ("t_ms", "angle_y_deg", "omega_y_dps", "servo_y_us")])
def test_names_of_hobby_logs_with_units(tmp_path, names):
    log = hobby(dict(zip(names, (1e3 * T + 40000.0, np.degrees(THETA), np.degrees(RATE), 1500.0 + BETA / SERVO),
                         strict=True)), tmp_path)
    assert np.allclose(log.t, T, atol=1e-6)
    assert np.allclose(log.theta, THETA, atol=STEP)
    assert np.allclose(log.theta_dot, RATE, atol=STEP)
    assert np.allclose(log.beta_cmd, BETA, atol=1e-5)


@every("factor", [1.0, math.degrees(1.0), 10.0, 10.0 * math.degrees(1.0)])
def test_the_unit_of_a_gyro_is_told_by_the_attitude(tmp_path, factor):
    log = hobby({"time_ms": 1e3 * T, "pitch_deg": np.degrees(THETA), "gyro_y": factor * RATE,
                 "servo_us": 1500.0 + BETA / SERVO}, tmp_path)
    assert np.allclose(log.theta_dot, RATE, atol=2e-3)


def test_quaternions_of_three_decimals(tmp_path):
    half = 0.5 * THETA
    log = hobby({"time_s": T, "q0": np.cos(half), "q1": 0 * T, "q2": np.sin(half), "q3": 0 * T,
                 "gyro_y_dps": np.degrees(RATE), "servo_us": 1500.0 + BETA / SERVO}, tmp_path)
    assert np.allclose(log.theta, THETA - THETA[0], atol=2.5e-3)
    told = hobby({"time_s": T, "q0": np.cos(half), "q1": 0 * T, "q2": np.sin(half), "q3": 0 * T,
                  "gyro_y": np.degrees(RATE), "servo_us": 1500.0 + BETA / SERVO}, tmp_path)
    assert np.allclose(told.theta_dot, RATE, atol=2e-3)


def test_rows_without_a_time_ask_for_a_period_and_take_it(tmp_path):
    columns = {"row": np.arange(len(T)), "pitch_deg": np.degrees(THETA), "gyro_y_dps": np.degrees(RATE),
               "servo_us": 1500.0 + BETA / SERVO}
    with pytest.raises(InputError, match="period"):
        hobby(columns, tmp_path)
    with pytest.raises(InputError, match="period"):
        launchid.read_log(table(tmp_path / "flight.csv", columns))
    (tmp_path / "own.toml").write_text('base = "tvc"\n[time]\nperiod = 0.02\n')
    log = launchid.read_log(table(tmp_path / "flight.csv", columns), map=tmp_path / "own.toml")
    assert np.allclose(log.t, T) and np.allclose(log.theta, THETA, atol=STEP)


def test_keys_of_a_users_map_go_before_the_named_one(tmp_path):
    (tmp_path / "own.toml").write_text('base = "tvc"\n[columns.beta_cmd]\nscale = -0.02\noffset = 30.0\n'
                                       "[cut]\nto = 5.0\n")
    path = table(tmp_path / "flight.csv", {
        "time_ms": 1e3 * T, "pitch_deg": np.degrees(THETA), "servo_us": 1500.0 - np.degrees(BETA) / 0.02}, "%.10g")
    log = launchid.read_log(path, map=tmp_path / "own.toml")
    assert np.allclose(log.beta_cmd, BETA[:251], atol=1e-6)


def test_what_is_ambiguous_is_not_guessed(tmp_path, capsys):
    path = table(tmp_path / "f.csv", {"time_ms": 1e3 * T, "pitch_deg": THETA, "servo_us": BETA, "tvc_us": BETA})
    assert main(["identify", path]) == 3
    assert "column 't' is missing" in capsys.readouterr().err


@every(("name", "mention"), [("px5", "px4"), ("betaflght", "betaflight")])
def test_a_name_that_is_none_is_told(tmp_path, name, mention):
    with pytest.raises(InputError, match=mention):
        map_for(tmp_path / "f.csv", name)
