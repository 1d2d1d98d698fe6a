"""Vehicles and logs unlike the shipped ones: a6 of zero, an odd period, an attitude beyond half a turn."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from launchid.diagnosis.controller.command import record
from launchid.diagnosis.judge import gain
from launchid.diagnosis.judge.closed_loop import closed_loop_errors, flown_along
from launchid.diagnosis.judge.user_gain import _judged, user_gain
from launchid.diagnosis.verdict import diagnose
from launchid.log.detect import check
from launchid.log.log import Log
from launchid.log.turns import SEAM, unwrapped
from launchid_core.gate import ring
from sim.effects import effect
from sim.flight import fly_whole
from sim.nominal import load_nominal
from sim.nominal.profiles import constant_profile
from sim.sections import Profile


def nominal(**changed):
    made = load_nominal("constant")
    return replace(made, simulation=replace(made.simulation, duration=11.0), **changed)


def log_of(flight, faster):
    """The log as a logger would write it whose clock runs `faster` times too fast."""
    unknown = np.full(len(flight.t), math.nan)
    return Log("flight.csv", ("t", "theta", "theta_dot", "beta", "beta_cmd", "theta_ref"), (), flight.t * faster,
               flight.theta, flight.theta_dot, flight.beta, unknown, flight.beta_cmd, flight.theta_ref)


def test_of_a_vehicle_without_an_instability_the_gain_in_k1_is_told_and_none_in_a6():
    lander = nominal(vehicle=constant_profile(0.0, -1.7), controller=replace(nominal().controller, kp=0.9, kd=1.0))
    made = user_gain(lander, replace(lander, effects=(effect("gyro_scale", scale=1.01),)))
    assert made is not None
    assert all(map(math.isnan, (*made.error["a6"], *made.coverage["a6"])))
    assert 0.0 < made.error["k1"][1] < 0.2
    assert 0.0 <= made.coverage["k1"][0] <= 1.0 and made.coverage["k1"][1] >= 0.5


def test_a_window_is_judged_by_the_vehicle_of_its_centre():
    """The a6 and k1 change over the flight: exact estimates of the centre are no error, those of the window's end are
    one."""
    changing = nominal(vehicle=Profile(np.array([0.0, 100.0]), np.array([1.0, 3.0]), np.array([-5.0, -9.0])))
    window = {"t_start": 40.0, "t_end": 60.0, "a6_std": 0.1, "k1_std": 0.2}
    assert _judged(changing, SimpleNamespace(**window, a6=2.0, k1=-7.0)) == pytest.approx((0.0, 0.0, 0.0, 0.0))
    assert _judged(changing, SimpleNamespace(**window, a6=2.2, k1=-7.4)) == pytest.approx((0.1, -0.4 / 7.0, 2.0, -2.0))


@pytest.mark.parametrize("faster", [1.03, 0.97])
def test_a_log_whose_period_is_no_whole_number_of_steps_is_flown_at_its_own_rows(faster):
    flown = nominal(guidance=replace(nominal().guidance, t=(0.0, 1.0, 2.0), theta_ref=(0.0, 0.0, 0.1)))
    log = log_of(fly_whole(flown, 1), faster)
    made = record(log, flown, check(log, flown))
    assert made.period == pytest.approx(faster * flown.sensors.period)
    flight = flown_along(made, flown, 0)
    at = made.period * np.arange(len(flight.t))
    assert np.all(np.abs(flight.t - at) <= 0.501 * flown.simulation.step)
    assert flight.period == made.period and len(flight.t) == pytest.approx(min(made.rows, 11.0 / made.period), abs=1)
    before, after = closed_loop_errors(made, (effect("control_effectiveness", scale=0.6),))
    assert 0.0 < before < after


def test_a_log_of_the_nominals_own_period_is_flown_to_the_bit():
    flown = nominal()
    log = log_of(fly_whole(flown, 1), 1.0)
    made = record(log, flown, check(log, flown))
    np.testing.assert_array_equal(flown_along(made, flown, 2).theta, fly_whole(flown, 2).theta)


# ---- whole turns


def turned(theta, reference=None):
    made = log_of(fly_whole(nominal(), 1), 1.0)
    n = len(theta)
    columns = {name: getattr(made, name)[:n] for name in ("t", "theta_dot", "beta", "theta_ddot", "beta_cmd")}
    absent = np.full(n, math.nan)
    return replace(made, **columns, theta=theta, theta_ref=absent if reference is None else reference,
                   gamma=absent, alpha=absent, rate_ref=absent)


@given(st.floats(-20.0, 20.0), st.floats(-0.3, 0.3), st.integers(0, 2**32 - 1))
def test_an_attitude_logged_within_one_turn_gets_its_turns_back(start, slope, seed):
    """The turns before the log's beginning stay unknown; lost rows show none either way."""
    theta = start + np.cumsum(slope + 0.1 * np.random.default_rng(seed).uniform(-1.0, 1.0, 300))
    wrapped = np.angle(np.exp(1j * theta))
    wrapped[100:103] = math.nan
    wrapped[np.abs(np.abs(wrapped) - math.pi) < 1e-6] = math.nan
    log, faults = unwrapped(turned(wrapped))
    rest = (log.theta - theta)[np.isfinite(wrapped)][:90]
    assert np.all(np.abs(rest - rest[0]) < 1e-9)
    assert len(faults) > 0 or not np.any(np.abs(np.diff(wrapped)) > math.pi)


def test_what_does_not_cross_the_seam_is_left_as_it_is_to_the_bit():
    """A step through zero, a spike, an attitude near half a turn that stays on its side."""
    quiet = np.concatenate([np.full(50, 3.1), np.full(50, 2.9), [0.0, -0.1, 8.0], np.linspace(-2.0, 2.0, 50)])
    log = turned(quiet)
    again, faults = unwrapped(log)
    assert again is log and faults == ()
    assert SEAM == ring.SEAM   # on board the same is undone


def test_a_reference_is_turned_with_the_attitude_and_the_verdict_says_so():
    """A lander that turns over was a bad attitude of 10^9 nats; the reference may cross before the attitude."""
    reference = np.concatenate([np.full(50, 3.1), np.full(100, -3.1)])
    theta = np.concatenate([np.full(60, 3.05), np.full(90, -3.12)])
    log, faults = unwrapped(turned(theta, reference))
    np.testing.assert_allclose(log.theta_ref[50:], 2.0 * math.pi - 3.1)
    np.testing.assert_allclose(log.theta[60:], 2.0 * math.pi - 3.12)
    assert [(each.kind, each.channel, each.rows) for each in faults] == [("wrapped", "theta", 0),
                                                                          ("wrapped", "theta_ref", 0)]
    assert "1 times, first at 0.6 s" in faults[0].message


def test_a_log_that_turns_over_is_judged_as_if_it_had_not():
    lander = nominal(vehicle=constant_profile(0.0, -1.7), controller=replace(nominal().controller, kp=0.9, kd=1.0),
                     guidance=replace(nominal().guidance, t=(0.0, 1.0, 3.0, 6.0, 8.0),
                                      theta_ref=(0.0, 0.0, 0.3, 0.3, -0.1)))
    log = log_of(fly_whole(lander, 3), 1.0)
    log = replace(log, theta=log.theta + 3.0, theta_ref=log.theta_ref + 3.0)   # without a6 no attitude is another's
    assert log.theta.min() + 0.2 < math.pi < log.theta.max() - 0.1
    wrapped = replace(log, theta=np.angle(np.exp(1j * log.theta)), theta_ref=np.angle(np.exp(1j * log.theta_ref)))
    made = diagnose(wrapped, lander, hypotheses=())
    assert made.verdict == "consistent" and made.data.faults[0].kind == "wrapped"
    np.testing.assert_allclose(made.log.theta, log.theta, atol=1e-12)


def test_the_errors_of_a_model_that_runs_away_have_a_square(monkeypatch):
    log = log_of(fly_whole(nominal(), 1), 1.0)
    made = record(log, nominal(), check(log, nominal()))
    size = len(range(0, made.rows, max(1, round(gain.SPACING / made.period)))), len(gain.spans(made)), 3
    monkeypatch.setattr(gain, "prediction_errors", lambda *given: np.full(size, -1e200))
    errors, _ = gain._errors((made,), (SimpleNamespace(filter=None, point=None),), np.ones(made.rows, bool))
    assert np.nanmax(errors**2) == gain.LARGEST**2
