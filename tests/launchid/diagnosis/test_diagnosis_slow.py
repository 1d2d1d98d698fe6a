"""launchid diagnose on logs slower than the controller that lack its reference, or its commands: what it commanded
between the rows is not in the log, and nobody takes that for a fault of the vehicle."""

import functools

import numpy as np
import pytest
from shortened import short
from test_diagnosis import log_of

from launchid.diagnosis.adapter import follow
from launchid.diagnosis.controller.command import record
from launchid.diagnosis.controller.issued import with_commands
from launchid.log.detect import check
from launchid.log.log import OPTIONAL
from sim.effects import from_text
from sim.flight import fly_whole

NOMINAL = short(40.0)
SLOW, SLOWER = 0.02, 0.04   # s, of a controller of 0.01 s


@functools.cache
def flight(effect="", period=SLOW, seed=6):
    return fly_whole(NOMINAL, seed, period=period, effects=[from_text(effect)] if effect else [])


def without(drop, effect="", period=SLOW):
    return log_of(flight(effect, period), tuple(drop.split(",")))


def recorded(drop, period=SLOW):
    log = without(drop, period=period)
    return record(log, NOMINAL, check(log, NOMINAL))


def flown(period):
    """The commands (rows - 1, ticks a row) [rad] of the same flight."""
    every = round(period / NOMINAL.controller.period)
    whole = flight(period=0.01).beta_cmd
    return whole[:(len(whole) // every - 1) * every].reshape(-1, every)


@pytest.mark.parametrize("period", [SLOW, SLOWER])
def test_commands_between_rows_are_off_by_what_is_said(period):
    """The commands of the rows are the log's; lines over means of rows miss less than lines from row to row."""
    made, controller = with_commands(recorded("theta_ref", period), follow)
    true = flown(period)
    off = made.commands[:true.size].reshape(true.shape) - true
    assert controller is None and not off[:, 0].any()
    assert np.sqrt(np.mean(off[:, 1:]**2)) == pytest.approx(made.between, rel=0.25)
    ticks = np.arange(true.size)
    lines = np.interp(ticks, ticks[::true.shape[1]], true[:, 0]).reshape(true.shape)
    assert np.std(off[:, 1:]) < 0.95 * np.std((lines - true)[:, 1:])


def test_commands_between_rows_follow_exactly_from_reference_and_commands():
    """The log has all that the derivative's filter remembers."""
    made, controller = with_commands(recorded("gamma"), follow)
    true = flown(SLOW)
    off = made.commands[:true.size].reshape(true.shape) - true
    assert controller.kind == "none" and np.max(np.abs(off[50:])) < 1e-6
    assert "gamma" in OPTIONAL and made.unsure == made.between == 0.0


@pytest.mark.parametrize("drop", ["gamma", "theta_ref", "beta_cmd,beta"])
def test_where_the_model_does_not_stay_with_the_log_the_commands_are_no_better_known(drop):
    made, _ = with_commands(recorded(drop), lambda record: None)
    assert made.unsure > 0.0 and made.between > 0.0
