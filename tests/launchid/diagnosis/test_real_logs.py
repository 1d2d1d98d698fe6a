"""The measured logs: physics that nobody of this project simulated, and logs that are read by name.

Pendulums: theta_ddot = -a sin(theta) + b torque - friction, a = 20.3..21.4 1/s^2 by the device's own data sheet.
"""

import json
import warnings
from pathlib import Path

import numpy as np
import pytest

import launchid
from launchid.log.log import MEASURED_LOGS, measured_logs, read_log
from launchid.main import main
from sim.nominal import STAND_NOMINALS, load_nominal

DEVICE = (20.3, 21.4)  # 1/s^2
WITH_FRICTION, WITHOUT = "sin(theta),beta,sign(theta_dot)", "sin(theta),beta"


def whole(name: str, library: str, late: float = 0.0):
    """The identification of a log as one window, its beta taken as it acts, `late` [s] after it is logged."""
    columns = dict(read_log(f"dfki_pendulum_{name}").measured())
    columns["beta"] = np.interp(columns["t"] - late, columns["t"], columns["beta"])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", launchid.DataWarning)  # of rounded stamps
        return launchid.identify(columns, library=library, window="all")


def terms(name: str, library: str, late: float = 0.0) -> dict[str, float]:
    """Active terms of the one window over the whole log, which must be valid."""
    window, = whole(name, library, late).report["windows"]
    assert window["valid"], window["status"]
    return window["terms"]


@pytest.mark.parametrize("library", [WITH_FRICTION, WITH_FRICTION + ",1"])
def test_a_motor_that_acts_late_is_in_the_numbers_which_are_the_device_s_gravity(library):
    """A log whose torque acts 11 ms after its command; who shifts it before gets the same."""
    said = whole("dircol", library).report
    delay = said["late"]["delay"]["value"]
    assert delay == pytest.approx(0.011, abs=0.003) and said["windows"][0]["valid"]
    for found in (said["windows"][0]["terms"], terms("dircol", library, delay)):
        assert 0.9 * DEVICE[0] <= -found["sin(theta)"] <= 1.1 * DEVICE[1]
        assert found["sign(theta_dot)"] < 0 < found["beta"]


def test_gravity_term_is_the_device_s():
    found = terms("ddp", WITH_FRICTION)
    assert 0.85 * DEVICE[0] <= -found["sin(theta)"] <= 1.15 * DEVICE[1]
    assert found["sign(theta_dot)"] < 0 < found["beta"]


def test_without_friction_the_second_log_is_refused():
    assert -terms("ddp", WITH_FRICTION)["sin(theta)"] >= 17.3  # the data sheet's is in DEVICE
    assert [window["status"] for window in whole("ddp", WITHOUT).report["windows"]] == ["MODEL"]  # it would be 15.9


@pytest.mark.parametrize("window", ["all", "5", "2"])
def test_without_friction_the_friction_is_named(real_logs, capsys, window):
    assert main(["identify", str(real_logs / "dfki_pendulum_ddp.csv"), "--library", WITHOUT, "--window", window,
                 "--json", "-"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert {w["status"] for w in said["windows"]} == {"MODEL"}
    assert said["lacks"][0]["what"] == "sign(theta_dot)" and -1.1 < said["lacks"][0]["size"] < -0.6


def test_a_library_that_is_larger_than_the_log_can_tell_is_refused_or_right():
    window, = whole("dircol", "quadratic+sin").report["windows"]
    assert window["status"] == "MODEL" and window["a6"] is None   # beta acts later than it is logged
    large, = whole("dircol", "quadratic+sin", 0.011).report["windows"]
    small, = whole("dircol", "sin(theta),beta,1", 0.011).report["windows"]
    assert small["valid"]
    for term in ("sin(theta)", "beta"):
        assert not large["valid"] or \
            large["terms"][term] == pytest.approx(small["terms"][term], abs=2.0 * large["terms_std"][term])


# ---- by name


def test_every_log_of_the_package_is_read_by_its_name_and_says_so(capsys):
    assert len(measured_logs()) >= 6
    for name in measured_logs():
        log = read_log(name, ("t", "theta"))
        assert log.path == name and len(log.t) > 1000


def test_a_file_that_exists_wins_over_the_name_and_a_folder_does_not(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("map_single_free").mkdir()
    assert len(read_log("map_single_free").t) > 1000
    Path("map_single_free").rmdir()
    Path("map_single_free").write_text("t,theta,beta\n0,1,2\n", encoding="utf-8")
    assert len(read_log("map_single_free").t) == 1


def test_what_is_neither_file_nor_name_is_told_the_names(capsys):
    assert main(["identify", "nothing_like_it"]) == 3
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and all(name in said for name in measured_logs())
    assert main(["identify", "dfki_pendulum"]) == 3
    assert "did you mean dfki_pendulum_d" in capsys.readouterr().err


@pytest.mark.parametrize("name", STAND_NOMINALS)
def test_the_stands_nominals_are_read_by_name(name):
    assert load_nominal(name).name == name


def test_every_log_has_its_source_and_its_licence_beside_it():
    sources = (MEASURED_LOGS / "SOURCES.md").read_text(encoding="utf-8")
    assert all(f"`{name}`" in sources for name in measured_logs())
    licences = {path.name for path in MEASURED_LOGS.glob("LICENCE-*.txt")}
    assert len(licences) == 3 and all(f"`{name}`" in sources for name in licences)
