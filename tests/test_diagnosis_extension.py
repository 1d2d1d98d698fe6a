"""What an extension buys its user, on vehicles and clocks unlike the shipped ones: a6 of zero, an odd period."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sim.diagnosis.controller.command import record
from sim.diagnosis.data.check import check
from sim.diagnosis.judge.closed_loop import closed_loop_errors, flown_along
from sim.diagnosis.judge.user_gain import user_gain
from sim.effects import effect
from sim.flight import fly_whole
from sim.log import Log
from sim.nominal import load_nominal
from sim.nominal.profiles import constant_profile


def nominal(**changed):
    made = load_nominal("constant")
    return replace(made, simulation=replace(made.simulation, duration=11.0), **changed)


def log_of(flight, faster):
    """As a logger would write it whose clock runs `faster` times too fast."""
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
