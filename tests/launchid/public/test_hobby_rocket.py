"""A model rocket's own flight log, from the raw CSV to a6 and k1 in few commands; from a ULog; three together."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hobby_rocket import Rocket, as_hobby_csv, fly
from written import write_mcap, write_ulog

import launchid
from launchid.main import main

ROCKET = Rocket(pad=4.0, burn=4.2, coast=3.0, chute=6.0, thrust=9.5, arm=0.41, inertia=0.06, pressure=0.15, kp=0.5,
                kd=0.14, lag=0.03, delay=0.015)
SIGMAS = 3.0
LINKAGE = """base = "tvc"
[columns.beta_cmd]
scale = -0.02
offset = 30.0
"""


def raw(folder: Path, seed: int) -> str:
    path = folder / f"flight{seed}.csv"
    path.write_text(as_hobby_csv(fly(ROCKET, seed)))
    return str(path)


@pytest.fixture
def linkage(tmp_path: Path) -> list[str]:
    (tmp_path / "linkage.toml").write_text(LINKAGE)
    return ["--map", str(tmp_path / "linkage.toml")]


def answer(words: list[str], path: Path) -> dict:
    assert main([*words, "--json", str(path)]) == 0
    return json.loads(path.read_text())


def is_near(value: float, std: float, low: float, high: float) -> bool:
    return low - SIGMAS * std < value < high + SIGMAS * std


def test_from_the_raw_csv_to_a6_and_k1(tmp_path, linkage, capsys):
    log, first = raw(tmp_path, 31), str(tmp_path / "first.toml")
    assert main(["show", log, "--out", str(tmp_path / "look.png")]) == 0
    said = capsys.readouterr().err
    assert "read with --map tvc" in said and "beta moves the vehicle from 4" in said
    numbers = answer(["nominal", log, *linkage, "--out", first], tmp_path / "n.json")
    assert is_near(numbers["k1"]["value"], numbers["k1"]["std"], ROCKET.k1, ROCKET.k1)
    assert is_near(numbers["a6"]["value"], numbers["a6"]["std"], 0.0, ROCKET.a6(ROCKET.burn))
    for words in ([log], [log, first]):
        windows = answer(["identify", *words, *linkage], tmp_path / "i.json")["windows"]
        valid = [window for window in windows if window["valid"]]
        assert len(windows) == 3 and len(valid) >= 2
        for window in valid:
            begin, end = (window[name] - ROCKET.pad for name in ("t_start", "t_end"))
            assert is_near(window["k1"], window["k1_std"], ROCKET.k1, ROCKET.k1)
            assert is_near(window["a6"], window["a6_std"], ROCKET.a6(begin), ROCKET.a6(end))


def margins_of(a6: float) -> tuple[float, float]:
    """Return the phase margin [deg] and high gain margin [dB] of the sampled loop, frozen at a6: the plant behind hold,
    delay and lag, its response summed over the aliases."""
    w, period = np.linspace(0.5, 100.0, 20000), ROCKET.period
    loop = np.zeros(len(w), complex)
    for k in range(-20, 21):
        s = 1j * (w + 2.0 * math.pi * k / period)
        plant = ROCKET.k1 * np.exp(-s * ROCKET.delay) / ((1.0 + ROCKET.lag * s) * (s * s - a6))
        loop -= (ROCKET.kp + ROCKET.kd * s) * plant * (1.0 - np.exp(-s * period)) / (s * period)
    size = np.abs(loop)
    crossed = np.flatnonzero((size[:-1] > 1.0) & (size[1:] <= 1.0))[-1]
    turned = np.flatnonzero((np.diff(np.sign(loop.imag)) != 0.0) & (loop.real[:-1] < 0.0) & (w[:-1] > w[crossed]))[0]
    return math.degrees(np.angle(-loop[crossed])), -20.0 * math.log10(size[turned])


def test_from_the_raw_csv_to_controller_and_margins(tmp_path, linkage):
    log, first = raw(tmp_path, 31), str(tmp_path / "first.toml")
    law = answer(["nominal", log, *linkage, "--out", first], tmp_path / "n.json")["controller"]
    assert law["law"] == "gyro" and law["period"] == ROCKET.period
    for name, true in (("kp", ROCKET.kp), ("kd", ROCKET.kd)):
        assert is_near(law[name]["value"], law[name]["std"], true, true)
    for words in ([log, first], [log]):
        windows = answer(["margins", *words, *linkage], tmp_path / "m.json")["windows"]
        assert sum(window["valid"] for window in windows) >= 2
        for window in (each for each in windows if each["valid"]):
            middle = 0.5 * (window["t_start"] + window["t_end"]) - ROCKET.pad
            for name, true in zip(("phase_deg", "gain_high_db"), margins_of(ROCKET.a6(middle)), strict=True):
                value, low, high = (window[name][key] for key in ("value", "low", "high"))
                assert is_near(value, (high - low) / (2.0 * 1.96), true, true)


def test_watched_from_the_pad_to_the_parachute(tmp_path, linkage, capsys):
    log, first = raw(tmp_path, 31), str(tmp_path / "first.toml")
    assert main(["nominal", log, *linkage, "--out", first]) == 0
    windows = answer(["watch", log, "--nominal", first, *linkage, "--once"], tmp_path / "w.json")["windows"]
    said = capsys.readouterr().err
    assert "the pad holds it until" in said and "beta does not move the vehicle" in said
    assert len(windows) == 3 and all(window["valid"] for window in windows)
    for window in windows:
        assert ROCKET.pad - 0.1 < window["t_start"] and window["t_end"] < ROCKET.pad + ROCKET.burn + 0.1
        assert is_near(window["k1"], window["k1_std"], ROCKET.k1, ROCKET.k1)


def test_commands_alone_are_compared(tmp_path, linkage):
    log, first = raw(tmp_path, 31), str(tmp_path / "first.toml")
    assert main(["nominal", log, *linkage, "--out", first]) == 0
    one, = answer(["compare", log, first, *linkage, "--flights", "0"], tmp_path / "c.json")["nominals"]
    assert one["channels"]["theta"]["ahead"]["0.1"]["fit"] > 90.0 and "beta" not in one["channels"]


def test_the_same_from_a_ulog(tmp_path):
    pytest.importorskip("pyulog")
    columns = fly(ROCKET, 32)
    stamps, half = 9_000_000 + np.round(columns["t"] * 1e6).astype(np.uint64), 0.5 * columns["theta"]
    none = np.zeros(len(stamps))
    write_ulog(tmp_path / "f.ulg", {
        "vehicle_attitude": {"timestamp": stamps, "q": np.stack([np.cos(half), none, np.sin(half), none], axis=1)},
        "vehicle_angular_velocity": {"timestamp": stamps,
                                     "xyz": np.stack([none, columns["theta_dot"], none], axis=1)},
        "vehicle_torque_setpoint": {"timestamp": stamps, "xyz": np.stack([none, columns["beta_cmd"], none], axis=1)}})
    windows = launchid.identify(tmp_path / "f.ulg", window="all").report["windows"]
    assert windows[0]["valid"] and is_near(windows[0]["k1"], windows[0]["k1_std"], ROCKET.k1, ROCKET.k1)


def test_the_same_from_an_mcap(tmp_path):
    pytest.importorskip("mcap")
    columns = fly(ROCKET, 32)
    stamps, half = 9_000_000_000 + np.round(columns["t"] * 1e9).astype(np.int64), 0.5 * columns["theta"]
    none = np.zeros(len(stamps))
    write_mcap(tmp_path / "f.mcap", {
        "imu": {"timestamp": stamps, "q": np.stack([np.cos(half), none, np.sin(half), none], axis=1),
                "rate": columns["theta_dot"]},
        "servo": {"timestamp": stamps, "angle": columns["beta_cmd"]}})
    (tmp_path / "map.toml").write_text("""[time]
name = "log_time"
unit = "ns"
[columns]
theta = {quaternion = "imu/motion.q", axis = "y"}
theta_dot = {from = "imu/motion.rate"}
beta_cmd = {from = "servo/motion.angle"}
""")
    log = launchid.read_log(tmp_path / "f.mcap", map=tmp_path / "map.toml")
    window, = launchid.identify(log, window="all").report["windows"]
    assert window["valid"] and is_near(window["k1"], window["k1_std"], ROCKET.k1, ROCKET.k1)


def test_a_data_frame_of_polars_goes_in(tmp_path):
    polars = pytest.importorskip("polars")
    columns = fly(ROCKET, 32)
    assert launchid.read_log(polars.DataFrame(columns)).is_same(launchid.read_log(columns))


def test_three_flights_are_one_vehicle(tmp_path, linkage):
    logs = [raw(tmp_path, seed) for seed in (33, 34, 35)]
    made = answer(["nominal", *logs, *linkage, "--out", str(tmp_path / "first.toml")], tmp_path / "n.json")
    assert is_near(made["k1"]["value"], made["k1"]["std"], ROCKET.k1, ROCKET.k1)
    assert made["one_vehicle"]["p"] > 0.01
    found = answer(["identify", *logs, str(tmp_path / "first.toml"), *linkage], tmp_path / "i.json")
    joint, single = found["joint"]["k1"], [flight["windows"] for flight in found["flights"]]
    assert is_near(joint["value"], joint["std"], ROCKET.k1, ROCKET.k1)
    assert joint["std"] < min(window["k1_std"] for flight in single for window in flight if window["valid"])
    assert found["one_vehicle"]["p"] > 0.01 and math.isfinite(found["scatter"]["k1"]["high"])
