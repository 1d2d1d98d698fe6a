"""Damping that the nominal does not have: the likelihood tells it, also where a6 and k1 change; what it cannot tell."""

from dataclasses import replace

import numpy as np
import pytest

import launchid
from launchid.robustness.airframe import NOT_TOLD
from launchid.robustness.damping import damping_of
from launchid.sources import read_log
from sim.effects import effect
from sim.nominal import load_nominal


def damped(name: str, coefficient: float, seed: int):
    believed = load_nominal(name)
    more = () if coefficient == 0.0 else (effect("aero_damping", coefficient=coefficient),)
    return believed, launchid.simulate(replace(believed, effects=more), seed=seed)


@pytest.mark.parametrize("coefficient", [0.0, 0.3])
@pytest.mark.parametrize("name", ["constant", "vega_like"])
def test_damping_is_told_where_a6_changes_and_where_it_does_not(name, coefficient):
    errors = []
    for seed in range(2):
        believed, log = damped(name, coefficient, seed)
        told = damping_of(read_log(log), believed)
        assert told.std < 0.06
        errors.append((told.value - coefficient) / told.std)
    assert np.max(np.abs(errors)) < 3.5 and np.sum(np.square(errors)) < 10.6   # 99.5 % of a chi square of two


def test_no_window_is_refused_for_damping_and_the_low_gain_margin_is_the_vehicles():
    believed, log = damped("vega_like", 0.3, 7)
    found = launchid.margins(log, believed)
    assert abs(found.report["damping"]["value"] - 0.3) < 3.5 * found.report["damping"]["std"]
    assert all(each.window.status == "OK" for each in found.windows)
    inside = []
    for each in found.windows:
        a6, k1 = believed.vehicle.at(np.array([0.5 * (each.t_start + each.t_end)]))
        right = 20.0 * np.log10(a6[0] / (believed.controller.kp * abs(k1[0]))) if a6[0] > 0.0 else -np.inf
        inside.append(each.window.spread.gain_low_db.low <= right <= each.window.spread.gain_low_db.high)
    assert np.mean(inside) > 0.75


def test_with_its_damping_declared_the_log_tells_the_same():
    believed, log = damped("vega_like", 0.3, 3)
    declared = replace(believed, effects=(effect("aero_damping", coefficient=0.3),))
    one, other = (damping_of(read_log(log), each) for each in (believed, declared))
    assert abs(one.value - other.value) < 0.1 * one.std and np.isclose(one.std, other.std, rtol=0.1)


def test_a_nominal_with_modes_is_not_asked():
    believed, log = damped("constant", 0.0, 1)
    assert damping_of(read_log(log), replace(believed, effects=(
        effect("slosh", coupling=0.02, frequency=4.0),))) == NOT_TOLD


def test_a_log_of_a_few_rows_tells_nothing():
    believed = load_nominal("constant")
    brief = replace(believed, simulation=replace(believed.simulation, duration=0.3))
    assert damping_of(read_log(launchid.simulate(brief, seed=1)), brief) == NOT_TOLD
