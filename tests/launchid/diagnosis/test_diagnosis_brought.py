"""launchid diagnose on logs as people bring them: channels of other rates filled forward, stamps printed with few
digits, a sign convention of their own, wind declared for a day that was calm."""

import dataclasses
import functools

import numpy as np
import pytest
from shortened import short
from test_diagnosis import log_of

from launchid.controller.command import _is_held
from launchid.diagnosis.answer import report
from launchid.diagnosis.verdict import diagnose
from launchid.log.check import examined
from launchid.log.detect import check
from launchid.log.record import on_grid
from sim.effects import from_text
from sim.flight import fly_whole

NOMINAL = short(30.0)


@functools.cache
def flown(effect):
    """The log of a flight; shared, so nobody changes it."""
    return log_of(fly_whole(NOMINAL, 1, effects=[from_text(effect)] if effect else []))


def judged(log):
    return report(diagnose(log, NOMINAL))


def forward(x, every):
    """Each so manieth value, repeated in the rows up to the next."""
    return x[np.arange(len(x)) // every * every]


@pytest.mark.parametrize(("channel", "every"), [("theta", 10), pytest.param("beta", 4, marks=pytest.mark.campaign)])
def test_a_channel_of_another_rate_that_was_filled_forward_is_as_slow_as_it_is(channel, every):
    """The verdict was a late attitude, or a slow servo."""
    log = dataclasses.replace(flown(""), **{channel: forward(getattr(flown(""), channel), every)})
    made = check(log, NOMINAL)
    assert made.masks[channel].sum() == pytest.approx(len(log.t) / every, abs=1)
    assert [fault.message for fault in made.faults] == [
        f"{channel} is of {100 / every:.3g} Hz, each value repeated in the rows up to the next; these rows are "
        "left out"]
    assert judged(log)["verdict"] == "consistent"


@pytest.mark.parametrize("x", [
    pytest.param(1e-3 * np.round(3.0 * np.sin(0.01 * np.arange(3000.0))), id="a coarse quantum"),
    pytest.param(1e-3 * np.floor(0.25 * np.arange(3000.0)), id="a ramp in steps of a quantum"),
    pytest.param(np.sin(0.01 * np.arange(3000.0)), id="no noise"),
    pytest.param(np.zeros(3000), id="nothing")])
def test_what_repeats_because_it_is_quantised_is_not_filled_forward(x):
    log = dataclasses.replace(flown(""), theta=x)
    assert not any("Hz" in fault.message for fault in check(log, NOMINAL).faults)


@pytest.mark.parametrize(("clock", "is_even"), [
    (lambda t: np.round(0.78125 * t, 3), True),   # 128 Hz in milliseconds: 4 % of a row, yet no jitter
    (lambda t: 1.7e9 + np.round(0.78125 * t, 3), True),
    (lambda t: np.round(0.78125 * t + np.random.default_rng(1).uniform(-2e-3, 2e-3, len(t)).clip(-t), 3), False)])
def test_stamps_of_a_uniform_log_that_were_rounded_are_uniform(clock, is_even):
    log = dataclasses.replace(flown(""), t=clock(flown("").t))
    nominal = dataclasses.replace(NOMINAL, controller=None,
                                  sensors=dataclasses.replace(NOMINAL.sensors, period=0.0078125))
    seen = examined(log, nominal)   # stamps are put on their grid by the one look at a log
    assert (on_grid(seen.log, nominal, seen.data)[0].fine == 1) == is_even


def test_stamps_of_too_few_digits_are_no_rows_written_twice():
    log = flown("")
    short = check(dataclasses.replace(log, t=np.round(log.t, 1)), NOMINAL).faults[0].message
    assert "repeated stamps in" in short and short.endswith("too few digits for these rows; print them with more")


def test_a_command_is_held_where_it_changes_seldom_and_idle_where_it_does_not():
    """A pilot who rests for half of the log holds no command over rows; a controller of a third of the rate does."""
    idle = np.arange(3000) % 600 < 300
    assert not _is_held(idle)
    assert _is_held(np.arange(3000) % 3 == 0)
    assert _is_held((np.arange(3000) % 3 == 0) & idle)
    assert not _is_held(np.zeros(3000, bool))


@pytest.mark.parametrize("controller", [None, NOMINAL.controller], ids=["no controller", "controller"])
def test_a_vehicle_of_the_other_sign_is_told_so(controller):
    """beta and its command reversed: no gains of the controller and no cause of the catalogue, but a convention."""
    log = flown("")
    made = report(diagnose(dataclasses.replace(log, beta=-log.beta, beta_cmd=-log.beta_cmd),
                           dataclasses.replace(NOMINAL, controller=controller)))
    assert made["verdict"] == "bad-data" and made["causes"] == []
    fault, = made["data"]["faults"]
    assert fault["message"].startswith("beta, or theta and its rate, has the opposite sign over the whole log: k1")
