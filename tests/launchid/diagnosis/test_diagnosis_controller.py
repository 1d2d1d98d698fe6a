"""launchid diagnose on a command that is not the nominal controller's: gains, computing time and filter, from every
command exactly and from every other one by the rows beside a gap."""

import dataclasses
import math

import numpy as np
import pytest
from shortened import short
from test_diagnosis import LONG, NOMINAL, flown, found, named

from launchid.controller.check import NO_MISMATCH, check_controller
from launchid.controller.command import record
from launchid.controller.gaps import on_board, with_commands_between
from launchid.controller.issued import with_commands
from launchid.diagnosis.adapter import follow, read
from launchid.diagnosis.verdict import diagnose
from launchid.log.detect import check
from launchid.log.log import OPTIONAL, REQUIRED
from sim.effects import from_text
from sim.sections import Multisine, lowpass, notch


def test_the_controllers_mismatch_is_named_exactly():
    result = found("controller_mismatch:kp_scale=0.9,kd_scale=1.2,delay=0.01", nominal=short(20.0))
    assert (result["verdict"], result["where"], named(result)) == ("explained", "controller", ["controller_mismatch"])
    values = [result["causes"][0]["parameters"][name]["value"] for name in ("kp_scale", "kd_scale", "delay")]
    assert values == pytest.approx((0.9, 1.2, 0.01), abs=1e-6)


def test_commands_that_cannot_be_of_this_attitude_and_reference_are_another_s():
    """An attitude 3 rad from its reference would have held the command at its limit: that no command told gains was no
    reason to say nothing."""
    log = flown()
    far = dataclasses.replace(log, theta=log.theta + 3.0)
    made = check_controller(record(far, NOMINAL, check(log, NOMINAL)))
    assert made is not None and made.is_foreign and made.before > 0.1
    both = dataclasses.replace(far, theta_ref=log.theta_ref + 3.0)
    assert check_controller(record(both, NOMINAL, check(log, NOMINAL))).kind == NO_MISMATCH


SLOW = 0.02  # s: a log of every other command


def test_another_derivative_filter_is_no_gain():
    controller = dataclasses.replace(NOMINAL.controller, derivative_time_constant=0.08)
    log = flown(nominal=dataclasses.replace(NOMINAL, controller=controller))
    made = diagnose(log, NOMINAL)
    assert made.reading.controller.kind == "filter"
    assert made.reading.controller.time_constant == pytest.approx(0.08, rel=1e-4)
    assert (made.verdict, made.where, made.named) == ("unexplained", "controller", ())


# ---- degenerate logs


def without(log, name, rows):
    """The log with a column not measured in some rows."""
    values = getattr(log, name).copy()
    values[rows] = math.nan
    return dataclasses.replace(log, **{name: values})


def test_without_an_attitude_nothing_is_said_of_the_controller():
    log = without(flown(), "theta", slice(None))
    assert check_controller(record(log, NOMINAL, check(log, NOMINAL))) is None


def test_a_log_that_drifts_through_the_controllers_periods_says_nothing_of_it():
    log = flown(period=0.015)
    assert check_controller(record(log, NOMINAL, check(log, NOMINAL))) is None


def test_a_computing_time_longer_than_the_log():
    nominal = dataclasses.replace(NOMINAL, effects=(from_text("controller_mismatch:delay=6"),))
    log = flown(period=SLOW)
    short = dataclasses.replace(log, **{name: getattr(log, name)[:250] for name in REQUIRED + OPTIONAL})
    assert read(short, nominal).controller is None  # no command of the log answers an error of the log


# ---- with filters


TICK = NOMINAL.controller.period
FILTERED = dataclasses.replace(NOMINAL, controller=dataclasses.replace(NOMINAL.controller, filters=(
    notch(TICK, 30.0, 0.05, 0.5), lowpass(TICK, 60.0, 0.7))))


def told_of_filtered(effect, rows=slice(None), period=None):
    """The check of a controller with filters by these rows of a flight."""
    log = flown(*effect, nominal=FILTERED, period=period)
    log = dataclasses.replace(log, **{name: getattr(log, name)[rows] for name in (*REQUIRED, *OPTIONAL)})
    return with_commands(record(log, FILTERED, check(log, FILTERED)), follow)[1]


@pytest.mark.parametrize("rows", [slice(None), slice(1000, None), np.r_[:800, 803:3000]])
def test_a_filtered_controller_is_recognised_wherever_the_log_begins_and_whatever_it_lost(rows):
    assert told_of_filtered((), rows).kind == NO_MISMATCH
    told = told_of_filtered(("controller_mismatch:kp_scale=1.06,kd_scale=0.91,delay=0.01",), rows)
    assert told.kind == "gain and delay"
    assert (told.kp_scale, told.kd_scale, told.delay) == pytest.approx((1.06, 0.91, 0.01), abs=2e-4)


def test_of_a_filtered_controller_nothing_is_asked_at_another_rate():
    assert told_of_filtered((), period=0.02) is None


TESTED = dataclasses.replace(NOMINAL, test_input=Multisine(
    start=5.0, duration=20.0, frequency=(1.3, 2.9, 5.1), amplitude=(0.006, 0.006, 0.005), phase=(0.3, 1.9, 4.0)))


@pytest.mark.parametrize(("gains", "period"), [
    ((0.94, 1.0, 0.0), SLOW), *(pytest.param(*each, marks=LONG) for each in (
        ((1.0, 1.2, 0.0), 0.01), ((0.9, 1.0, 0.02), SLOW), ((0.9, 1.0, 0.01), 0.01)))])
def test_no_gain_of_the_controller_scales_its_test_input(gains, period):
    """The input is added to what the controller answers, and as late as that."""
    kp, kd, delay = gains
    log = flown(f"controller_mismatch:kp_scale={kp},kd_scale={kd},delay={delay}", period=period, nominal=TESTED)
    made = diagnose(log, TESTED)
    assert [(cause.cause, made.verdict) for cause in made.named] == [("controller_mismatch", "explained")]
    near = 1e-6 if period == TESTED.controller.period else 0.02
    assert list(made.named[0].values.values())[:3] == pytest.approx(gains, abs=near)


def test_a_test_input_between_the_rows_is_in_the_commands():
    nominal = dataclasses.replace(TESTED, actuator=dataclasses.replace(TESTED.actuator, command_noise_std=0.0))
    whole, log = flown(nominal=nominal), flown(nominal=nominal, period=SLOW)
    r = record(log, nominal, check(log, nominal))
    made = with_commands_between(r, whole.theta[:len(r.commands)], on_board(r))
    missing = (made.commands - whole.beta_cmd[:len(made.commands)])[1::2]
    assert np.max(np.abs(missing[60:-1])) < 1e-8
