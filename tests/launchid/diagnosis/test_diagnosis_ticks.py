"""launchid diagnose on logs that are read by a clock of their own: rows fall between the controller's ticks."""

import dataclasses
import functools

import numpy as np
import pytest
from shortened import short
from test_diagnosis import log_of

from launchid.controller.command import record
from launchid.controller.ticks import ticks_of
from launchid.diagnosis.verdict import diagnose
from launchid.log.detect import check
from launchid.log.log import OPTIONAL, REQUIRED
from sim.effects import from_text
from sim.flight import fly_whole

NOMINAL = short(40.0)
TICK = NOMINAL.controller.period
FINE = 0.001             # s of the flights that logs are read from


@functools.cache
def flight(effect="", seed=6):
    return fly_whole(NOMINAL, seed, period=FINE, effects=[from_text(effect)] if effect else [])


def read_at(whole, period, jitter, begin=0.0, seed=3):
    """The values (rows,) of a flight that a logger with this clock [s] reads: the last ones that there were."""
    n = int((whole.t[-1] - begin - 0.1) / period)
    away = np.random.default_rng(seed).uniform(-jitter, jitter, n)
    return np.unique(np.round((begin + np.arange(n) * period + away).clip(0.0) / FINE).astype(int))


def logged(clock, effect="", begin=0.0):
    log = log_of(flight(effect))
    rows = read_at(log, *clock, begin)
    return dataclasses.replace(log, **{name: getattr(log, name)[rows] for name in (*REQUIRED, *OPTIONAL)})


def test_a_cause_is_named_by_a_clock_that_jitters():
    made = diagnose(logged((0.02, 0.003), effect="control_effectiveness:scale=1.3"), NOMINAL)
    cause, = made.named
    assert cause.cause == "control_effectiveness"
    assert abs(cause.values["scale"] - 1.3) < max(4.0 * cause.std["scale"], 0.065)


@pytest.mark.parametrize("begin", [0.0, 0.008])
def test_commands_that_change_tell_the_controllers_ticks(begin):
    log = logged((0.007, 0.0), begin=begin)
    r = record(log, NOMINAL, check(log, NOMINAL))
    ticks = ticks_of(r, log.beta_cmd)
    assert ticks.spread < 0.06 * ticks.period
    assert r.nominal.diagnosis.timing < 1.2 * NOMINAL.diagnosis.timing
    assert ticks.period * r.step == pytest.approx(TICK)
    away = (ticks.phase * r.step + r.first_step * r.step) / TICK
    assert abs(away - round(away)) < 0.06
