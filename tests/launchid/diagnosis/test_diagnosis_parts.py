"""launchid diagnose on parts of flights: a log need not begin where the flight does, nor be long."""

import dataclasses
import functools

import pytest
from shortened import short
from test_diagnosis import log_of

from launchid.controller.check import GAIN, NO_MISMATCH, OTHER_FILTER, check_controller
from launchid.controller.command import record
from launchid.diagnosis.adapter import FEWEST_ROWS
from launchid.diagnosis.verdict import diagnose
from launchid.log.detect import check
from launchid.log.log import OPTIONAL, REQUIRED
from sim.effects import from_text
from sim.flight import fly_whole

NOMINAL = short(40.0)
TURNING = 9.37    # s: the programme turns from 6 to 16 s


@functools.cache
def flown(effect="", period=None, **controller):
    nominal = dataclasses.replace(NOMINAL, controller=dataclasses.replace(NOMINAL.controller, **controller))
    return log_of(fly_whole(nominal, 4, period=period, effects=[from_text(effect)] if effect else []))


def cut(log, begin, end=1e9):
    """The rows from one time to another [s]."""
    rows = (log.t >= begin) & (log.t < end)
    return dataclasses.replace(log, **{name: getattr(log, name)[rows] for name in (*REQUIRED, *OPTIONAL)})


def kind(log):
    return check_controller(record(log, NOMINAL, check(log, NOMINAL)))


# ---- the controller remembers what the log does not have


@pytest.mark.parametrize(("begin", "length"), [(0.0, 25.0), (TURNING, 0.6), (12.0, 5.0)])
def test_the_nominal_s_controller_is_recognised_wherever_its_log_begins(begin, length):
    assert kind(cut(flown(), begin, begin + length)).kind == NO_MISMATCH


@pytest.mark.parametrize("begin", [0.0, TURNING])
def test_a_mismatch_is_named_exactly_wherever_its_log_begins(begin):
    found = kind(cut(flown("controller_mismatch:kp_scale=0.9,kd_scale=1.1"), begin))
    assert found.kind == GAIN and (found.kp_scale, found.kd_scale) == pytest.approx((0.9, 1.1), abs=1e-6)
    late = kind(cut(flown("controller_mismatch:delay=0.013"), begin))
    assert late.delay == pytest.approx(0.013, abs=1e-6) and late.kp_scale == pytest.approx(1.0, abs=1e-6)


def test_another_filter_is_another_one_wherever_its_log_begins():
    found = kind(cut(flown(derivative_time_constant=0.08), TURNING))
    assert found.kind == OTHER_FILTER and found.time_constant == pytest.approx(0.08, rel=1e-4)


# ---- short ones


def test_a_vehicle_lost_within_a_second_is_not_called_consistent():
    """A trim a hundred times what the nozzle was sized for: the log is short because of it."""
    log = cut(flown("thrust_misalignment:angle=0.16", period=0.02), 0.0, 1.1)
    assert FEWEST_ROWS < len(log.t) < 60
    made = diagnose(log, NOMINAL)
    names = {name for cause in made.named for name in (cause.cause, *cause.alike)}
    assert made.verdict in ("explained", "dominant") and "thrust_misalignment" in names
