"""The measured logs: physics that nobody of this project simulated, and logs that are read by name.

Pendulums: theta_ddot = -a sin(theta) + b torque - friction, a = 20.3..21.4 1/s^2 by the device's own data sheet.
"""

import importlib
import json
from pathlib import Path

import numpy as np
import pytest

from sim.cli import main
from sim.effects import CATALOGUE
from sim.log import MEASURED, measured_logs, read_log
from sim.nominal import STANDS, load_nominal

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data" / "real"  # from which they were taken
DEVICE = (20.3, 21.4)  # 1/s^2
LOGS = ("dircol", "ddp")
WITH_FRICTION, WITHOUT = "sin(theta),beta,sign(theta_dot)", "sin(theta),beta"


def terms(capsys, folder: Path, name: str, library: str) -> dict[str, float]:
    """Active terms of the one window over the whole log."""
    status = main(["identify", str(folder / f"dfki_pendulum_{name}.csv"), "--library", library,
                   "--formulation", "integral", "--window", "all", "--json", "-"])
    out = capsys.readouterr().out
    assert status == 0
    windows = json.loads(out)["windows"]
    assert len(windows) == 1 and windows[0]["valid"]
    return windows[0]["terms"]


@pytest.mark.parametrize("name", LOGS)
def test_gravity_term_is_the_device_s(real_logs, capsys, name):
    found = terms(capsys, real_logs, name, WITH_FRICTION)
    assert 0.85 * DEVICE[0] <= -found["sin(theta)"] <= 1.15 * DEVICE[1]
    assert found["sign(theta_dot)"] < 0 < found["beta"]


def test_without_friction_the_second_log_is_refused_and_the_friction_named(real_logs, capsys):
    with_friction = -terms(capsys, real_logs, "ddp", WITH_FRICTION)["sin(theta)"]
    assert with_friction >= 17.3  # the data sheet's is in DEVICE
    assert main(["identify", str(real_logs / "dfki_pendulum_ddp.csv"), "--library", WITHOUT, "--window", "all",
                 "--json", "-"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert [window["status"] for window in said["windows"]] == ["MODEL"]  # it would be 15.9
    assert "sign(theta_dot)" in [lack["what"] for lack in said["lacks"]]


def test_large_library_keeps_gravity_and_torque(real_logs, capsys):
    found = terms(capsys, real_logs, "dircol", "quadratic+sin")
    assert {"sin(theta)", "beta"} <= set(found)
    assert found["sin(theta)"] < 0 < found["beta"]


# ---- by name


def test_every_log_of_the_package_is_read_by_its_name_and_says_so(capsys):
    assert len(measured_logs()) >= 6
    for name in measured_logs():
        log = read_log(name, ("t", "theta"))
        assert log.path == name and len(log.t) > 1000


def test_identify_takes_a_log_by_name_as_by_path(capsys):
    said = []
    for log in ("dfki_pendulum_dircol", str(MEASURED / "dfki_pendulum_dircol.csv")):
        assert main(["identify", log, "--library", WITHOUT, "--window", "all", "--json", "-"]) == 0
        said.append(capsys.readouterr().out)
    assert said[0] == said[1]


def test_a_file_that_exists_wins_over_the_name_and_a_folder_does_not(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("map_single_free").mkdir()
    assert len(read_log("map_single_free").t) > 1000
    Path("map_single_free").rmdir()
    Path("map_single_free").write_text("t,theta,beta\n0,1,2\n", encoding="utf-8")
    assert len(read_log("map_single_free").t) == 1


def test_what_is_neither_file_nor_name_is_told_the_names(capsys):
    assert main(["identify", "dfki_pendulum"]) == 3
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and all(name in said for name in measured_logs())


@pytest.mark.parametrize("name", STANDS)
def test_the_stands_nominals_are_read_by_name(name):
    assert load_nominal(name).name == name


def test_every_log_has_its_source_and_its_licence_beside_it():
    sources = (MEASURED / "SOURCES.md").read_text(encoding="utf-8")
    assert all(f"`{name}`" in sources for name in measured_logs())
    licences = {path.name for path in MEASURED.glob("LICENCE-*.txt")}
    assert len(licences) == 3 and all(f"`{name}`" in sources for name in licences)


@pytest.mark.skipif(not SHARED.is_dir(), reason="the real logs (shared/data/real beside the checkout) are not here")
def test_the_logs_are_those_that_were_measured_to_the_byte():
    for path in SHARED.glob("*.csv"):
        assert path.read_bytes() == (MEASURED / path.name).read_bytes()


# ---- what is known of them (benchmarks/real_suite.py)


@pytest.fixture
def suite(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[1] / "benchmarks"))
    return importlib.import_module("real_suite")


def test_every_log_of_the_package_has_a_nominal_and_what_is_known_of_it(suite):
    found = {name: known for name, _, known in suite.logs(MEASURED, [], False)}
    assert set(found) == set(measured_logs())
    assert all(known.nominal in STANDS and known.main and set(sum(known.main, ())) <= set(CATALOGUE)
               and set(known.beside) <= set(CATALOGUE) | {"moment_step", "wind_walk", "turbulence"}
               for known in found.values())
    assert "bam_xl330_kp400_lift_and_drop" not in {name for name, *_ in suite.logs(MEASURED, [], True)}  # a judge


def test_the_placebo_moves_the_input_and_nothing_else_by_30_to_50_percent(suite):
    log = read_log("dfki_pendulum_dircol")
    moved = suite.moved(log, "dfki_pendulum_dircol")
    at = next(k for k in range(len(log.t)) if np.array_equal(np.roll(log.beta, k), moved.beta))
    assert 0.3 <= at / len(log.t) <= 0.5 and np.array_equal(np.roll(log.beta_cmd, at), moved.beta_cmd)
    assert moved.theta is log.theta and moved.theta_dot is log.theta_dot


def test_an_input_taken_as_a_command_is_the_same_input(suite):
    log = read_log("bam_xl330_kp200_sin_time_square")
    command = suite.as_command(log)
    assert np.isnan(command.beta).all() and command.beta_cmd is log.beta and "beta_cmd" in command.columns
    assert suite.as_input(command).beta is log.beta


def test_names_are_right_beside_or_wrong(suite):
    def named(cause: str, term: str | None = None, alike: tuple[str, ...] = ()):
        parameters = {} if term is None else {"term": {"value": term, "std": None, "unit": "term"}}
        return {"cause": cause, "where": "plant", "parameters": parameters, "indistinguishable_from": list(alike)}

    known = suite.KNOWN["dfki_pendulum_ddp"]
    result = {"verdict": "dominant", "causes": [named("missing_term", "sin(theta)"), named("friction")]}
    assert suite.found(result, known) == "all" and suite.wrong_names(result, known) == []
    other = {"verdict": "dominant", "causes": [named("missing_term", "theta*beta"), named("slosh")]}
    assert suite.wrong_names(other, known) == ["missing_term", "slosh"]
    assert suite.found({"verdict": "unexplained", "causes": []}, known) == "none"
    assert suite.of_input(other) == ["missing_term"]
    robot = suite.KNOWN["mcar_8_3_1"]  # two defects
    assert suite.found({"verdict": "dominant", "causes": [named("attitude_bias")]}, robot) == "some"
    assert suite.found({"verdict": "dominant", "causes": [named("friction", None, ("steady_wind",)),
                                                          named("actuator_delay")]}, robot) == "all"


@pytest.mark.campaign
@pytest.mark.parametrize("name", sorted(log for log in measured_logs() if log != "bam_xl330_kp400_lift_and_drop"))
def test_the_main_defect_of_every_open_log_is_named_and_nothing_else(suite, name):
    [(_, path, known)] = suite.logs(MEASURED, [name], True)
    result = suite.diagnosed(read_log(path, ("t",)), known)
    assert (suite.found(result, known), suite.wrong_names(result, known)) == ("all", [])
