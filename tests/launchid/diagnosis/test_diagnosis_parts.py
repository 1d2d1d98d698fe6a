"""launchid diagnose on parts of flights: a log need not begin where the flight does, nor be long."""

import dataclasses
import functools
from types import SimpleNamespace

import numpy as np
import pytest
from test_diagnosis import WHOLE, log_of

from launchid.diagnosis.causes import RECORDS
from launchid.diagnosis.controller.check import check_controller
from launchid.diagnosis.controller.command import record
from launchid.diagnosis.controller.kind import FILTER, GAIN, NONE
from launchid.diagnosis.judge.gain import LONG, long_folds
from launchid.diagnosis.model.point import Point, vehicle
from launchid.diagnosis.verdict import FEWEST_ROWS, diagnose
from launchid.log.detect import check
from launchid.log.log import OPTIONAL, REQUIRED
from sim.effects import from_text
from sim.effects.actuator import ACTUATOR_BACKLASH
from sim.effects.plant import BENDING
from sim.effects.table import CODE, MEMORY
from sim.flight import fly_whole

NOMINAL = dataclasses.replace(WHOLE, simulation=dataclasses.replace(WHOLE.simulation, duration=40.0))
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


@pytest.mark.parametrize("length", [0.6, 5.0, 25.0])
@pytest.mark.parametrize("begin", [0.0, TURNING, 12.0])
def test_the_nominal_s_controller_is_recognised_wherever_its_log_begins(begin, length):
    assert kind(cut(flown(), begin, begin + length)).kind == NONE


@pytest.mark.parametrize("begin", [0.0, TURNING])
def test_a_mismatch_is_named_exactly_wherever_its_log_begins(begin):
    found = kind(cut(flown("controller_mismatch:kp_scale=0.9,kd_scale=1.1"), begin))
    assert found.kind == GAIN and (found.kp_scale, found.kd_scale) == pytest.approx((0.9, 1.1), abs=1e-6)
    late = kind(cut(flown("controller_mismatch:delay=0.013"), begin))
    assert late.delay == pytest.approx(0.013, abs=1e-6) and late.kp_scale == pytest.approx(1.0, abs=1e-6)


def test_another_filter_is_another_one_wherever_its_log_begins():
    found = kind(cut(flown(derivative_time_constant=0.08), TURNING))
    assert found.kind == FILTER and found.time_constant == pytest.approx(0.08, rel=1e-4)


@pytest.mark.parametrize("period", [0.01, 0.02])
def test_a_part_of_a_clean_flight_is_consistent(period):
    few = tuple(RECORDS[name] for name in ("actuator_rate_limit", "control_effectiveness", "attitude_bias"))
    for length in (45 * period, 15.0):
        made = diagnose(cut(flown(period=period), TURNING, TURNING + length), NOMINAL, hypotheses=few)
        assert (made.verdict, made.doubts) == ("consistent", ())


# ---- what the vehicle remembers


def test_what_remembers_begins_as_the_nozzle_stands():
    """A mode bent by a trimmed nozzle is in equilibrium with it: from rest it would ring as it never did."""
    log = cut(flown(), 12.0)
    stands = float(log.beta[0])
    assert abs(stands) > 1e-4
    of = record(log, NOMINAL, check(log, NOMINAL))
    point = Point(tuple(from_text(text) for text in ("bending:gain=0.01,frequency=20,damping_ratio=0.01",
                                                     "actuator_backlash:half_width=0.001")))
    made = vehicle(of, point)
    (mode,), (play,) = (table[table[:, CODE] == code] for table, code in
                        ((made.plant, BENDING), (made.actuator, ACTUATOR_BACKLASH)))
    assert mode[MEMORY] == pytest.approx(0.01 * stands) and play[MEMORY] == pytest.approx(stands)


@pytest.mark.parametrize("begin", [12.0, pytest.param(0.0, marks=pytest.mark.campaign)])
def test_a_mode_is_named_wherever_its_log_begins(begin):
    made = diagnose(cut(flown("bending:gain=-0.002,frequency=26,damping_ratio=0.03"), begin), NOMINAL,
                    hypotheses=(RECORDS["bending"], RECORDS["slosh"]))
    assert [cause.cause for cause in made.causes] == ["bending"]
    assert made.causes[0].values["gain"] == pytest.approx(-0.002, abs=4.0 * made.causes[0].std["gain"])


# ---- short ones


def test_a_vehicle_lost_within_a_second_is_not_called_consistent():
    """A trim a hundred times what the nozzle was sized for: the log is short because of it."""
    log = cut(flown("thrust_misalignment:angle=0.16", period=0.02), 0.0, 1.1)
    assert FEWEST_ROWS < len(log.t) < 60
    trims = tuple(RECORDS[name] for name in ("thrust_misalignment", "attitude_bias", "steady_wind", "actuator_gain"))
    made = diagnose(log, NOMINAL, hypotheses=trims)
    names = {name for cause in made.causes for name in (cause.cause, *cause.rivals)}
    assert made.verdict == "explained" and "thrust_misalignment" in names


# ---- predictions are judged on blocks that no experiment can follow


def test_an_experiment_that_repeats_itself_moves_in_both_halves():
    """Steps every second pair of blocks: a regular pattern would give all of them to one half."""
    of = SimpleNamespace(rows=10_000, period=0.01)
    one, other = long_folds(of)
    assert np.array_equal(one, ~other) and 0.45 < one.mean() < 0.55
    moving = np.arange(of.rows) * of.period % (2.0 * LONG) < LONG
    assert 0.3 < (one & moving).sum() / moving.sum() < 0.7
