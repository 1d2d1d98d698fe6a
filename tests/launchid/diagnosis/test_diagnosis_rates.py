"""The commands of a rate controller are told from those of another, whatever is lost of the log."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from launchid.controller.check import NO_MISMATCH, UNKNOWN_LAW, check_controller
from launchid.controller.command import record
from launchid.log.detect import check
from launchid.log.log import Log
from sim.effects import effect
from sim.flight import fly_whole
from sim.nominal import load_nominal
from sim.nominal.profiles import constant_profile
from sim.sections import Controller, Guidance, Multisine, Sensors

T = (0.0, 1.0, 1.4, 3.0, 3.4, 5.0, 5.4, 8.0)
NAMES = ("t", "theta", "theta_dot", "beta", "beta_cmd", "theta_ref", "rate_ref")


def missile(kp=0.09, ki=0.6, limit=0.25):
    """A finned vehicle whose loop is closed on its rate."""
    built = load_nominal("constant")
    return replace(
        built, vehicle=constant_profile(-20.0, -90.0),
        actuator=replace(built.actuator, natural_frequency=100.0, deflection_limit=limit),
        controller=Controller(kp=kp, kd=0.0, derivative_time_constant=0.0, period=0.005, law="rate", ki=ki),
        guidance=Guidance(T, (0.0, 0.0, 0.12, 0.12, -0.1, -0.1, 0.1, 0.1)),
        sensors=Sensors(0.005, 5e-4, 2e-3, 6e-4), simulation=replace(built.simulation, duration=8.0))


@lru_cache(maxsize=8)
def log_of(kp=1.0, ki=1.0, delay=0.0, limit=0.25):
    flown = missile(0.09, 0.6 * ki, limit)
    effects = () if (kp, delay) == (1.0, 0.0) else (effect("controller_mismatch", kp_scale=kp, delay=delay),)
    flight = fly_whole(flown, 5, effects=effects)
    columns = {name: getattr(flight, name) for name in NAMES}
    return Log("flight.csv", NAMES, (), theta_ddot=np.full(len(flight.t), math.nan), **columns)


def checked(log, nominal):
    return check_controller(record(log, nominal, check(log, nominal)))


def test_the_nominals_own_commands_are_its_own():
    for limit in (0.25, 0.02):   # which holds the integral
        made = checked(log_of(limit=limit), missile(limit=limit))
        assert made is not None and made.kind == NO_MISMATCH and made.before < 1e-9


@pytest.mark.parametrize(("kp", "delay", "limit"), [(1.3, 0.0, 0.25), (0.8, 0.005, 0.25), (1.0, 0.0123, 0.25),
                                                    (1.3, 0.0, 0.02)])
def test_another_gain_and_computing_time_are_named_exactly(kp, delay, limit):
    made = checked(log_of(kp, delay=delay, limit=limit), missile(limit=limit))
    assert made is not None and made.is_named
    assert made.kp_scale == pytest.approx(kp, abs=2e-3) and made.delay == pytest.approx(delay, abs=2e-5)


def test_a_test_input_is_scaled_by_no_gain():
    shaken = replace(missile(), test_input=Multisine(1.0, 6.0, (5.0, 11.0), (0.004, 0.004), (0.0, 1.0)))
    flight = fly_whole(shaken, 5, effects=(effect("controller_mismatch", kp_scale=1.3),))
    log = replace(log_of(), **{name: getattr(flight, name) for name in NAMES})
    made = checked(log, shaken)
    assert made is not None and made.is_named and made.kp_scale == pytest.approx(1.3, abs=1e-4)


def test_another_integral_is_said_and_no_cause():
    made = checked(log_of(ki=1.5), missile())
    assert made is not None and made.kind == UNKNOWN_LAW and made.is_foreign
    assert made.integral_scale == pytest.approx(1.5, abs=1e-3) and "1.5 times the nominal's ki" in made.words


def test_lost_rows_and_a_later_beginning_cost_their_own_rows_only():
    log = log_of(1.3)
    theta_dot, command = log.theta_dot.copy(), log.beta_cmd.copy()
    theta_dot[400:403], command[900] = math.nan, math.nan
    for lost in (replace(log, theta_dot=theta_dot, beta_cmd=command),
                 replace(log, **{name: getattr(log, name)[300:] for name in (*NAMES, "theta_ddot", "gamma", "alpha")})):
        made = checked(lost, missile())
        assert made is not None and made.is_named and made.kp_scale == pytest.approx(1.3, abs=1e-3)


def test_where_it_cannot_be_told_nothing_is_said():
    log, absent = log_of(), np.full(len(log_of().t), math.nan)
    for column in ("rate_ref", "theta_dot", "beta_cmd"):
        assert checked(replace(log, **{column: absent}), missile()) is None
    every = {name: getattr(log, name)[::3] for name in (*NAMES, "theta_ddot", "gamma", "alpha")}
    assert checked(replace(log, **every), missile()) is None   # commands between the rows
