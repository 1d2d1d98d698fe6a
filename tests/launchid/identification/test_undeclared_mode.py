"""A mode that the nominal does not declare: no window is valid, and the answer says what to declare."""

import dataclasses
import functools
import re

import pytest

import launchid
from launchid.judge.line import undeclared_line
from launchid.log.check import checked
from launchid.log.log import Log
from sim.effects import from_text
from sim.flight import fly_whole
from sim.nominal import load_nominal
from sim.sections import Bending, constant


@functools.cache
def flown(name: str, *effects: str, seed: int = 21) -> Log:
    flight = fly_whole(load_nominal(name), seed, effects=[from_text(each) for each in effects])
    return launchid.read_log({column: getattr(flight, column) for column in ("t", "theta", "theta_dot", "beta",
                                                                            "beta_cmd")})


@pytest.mark.parametrize("frequency", [18.0, 40.0])
def test_an_undeclared_bending_mode_refuses_all_windows_and_is_told_by_its_frequency(frequency):
    log, nominal = flown("constant", f"bending:gain=0.003,frequency={frequency:g}"), load_nominal("constant")
    found = launchid.identify(log, nominal, tracked=True)
    windows = found.report["windows"]
    assert windows and not any(window["valid"] or window["tracked"]["valid"] for window in windows)
    line = undeclared_line(checked(log, nominal), nominal)
    assert line is not None and line.frequency == pytest.approx(frequency, rel=0.1)
    assert "[[bending]]" in found.report["next"]


@pytest.mark.parametrize("effect", ["control_loss:fraction=0.4,time=40", "actuator_backlash:half_width=0.002",
                                    "gust:angle=0.03,time=30,duration=4", "gyro_delay:delay=0.03",
                                    "actuator_bandwidth:scale=0.5", "slosh:coupling=0.05,frequency=4"])
def test_what_is_no_line_is_none(effect):
    nominal = load_nominal("vega_like")
    assert undeclared_line(checked(flown("vega_like", effect), nominal), nominal) is None


def test_a_declared_mode_is_no_undeclared_line():
    log = flown("constant", "bending:gain=0.003,frequency=25")
    nominal = load_nominal("constant")
    assert undeclared_line(checked(log, nominal), nominal) is not None
    declared = dataclasses.replace(nominal, bending=(Bending(constant(24.0), constant(0.003)),))
    assert undeclared_line(checked(log, declared), declared) is None


def test_a_log_without_a_gyro_is_not_asked():
    log = flown("constant", "bending:gain=0.003,frequency=25")
    nominal = load_nominal("constant")
    bare = launchid.read_log({"t": log.t, "theta": log.theta, "beta": log.beta})
    assert undeclared_line(checked(bare, nominal), nominal) is None


def test_an_undeclared_slosh_refuses_the_windows_before_it_contradicts_too():
    """Two per cent near 3.4 rad/s: the filter alone gives half of the windows, off by up to three deviations."""
    log = flown("constant", "slosh:coupling=0.02,frequency=3.4,damping_ratio=0.01", seed=4)
    found = launchid.identify(log, "constant", tracked=True)
    windows = found.report["windows"]
    assert not any(window["valid"] or window["tracked"]["valid"] for window in windows)
    told = re.search(r"\[\[slosh\]\] near ([0-9.]+) rad/s", found.report["next"])
    assert told and float(told[1]) == pytest.approx(3.4, rel=0.02) and any(told[0] in line for line in found.warnings)
    level = launchid.uncertainty(log, "constant")
    assert not any(window["valid"] for window in level.report["windows"])


@pytest.mark.parametrize("effect", ["aero_damping:coefficient=0.2", "gust:angle=0.05,time=30,duration=6"])
def test_what_contradicts_otherwise_is_no_slosh(effect):
    found = launchid.identify(flown("constant", effect), "constant")
    assert "MODEL" in {window["status"] for window in found.report["windows"]}
    assert not any("[[slosh]]" in line for line in found.warnings)
