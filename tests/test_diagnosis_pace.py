"""How many steps of the grid are integrated at once, and that it changes nothing that a log could tell."""

import dataclasses
import math

import numpy as np
import pytest
from test_diagnosis_used import as_record

from sim.diagnosis.data.record import DIRECT, DIRECT_PARTS, LONGEST_AT_ONCE, fastest_servo
from sim.diagnosis.model.noise import declared, first_filter
from sim.diagnosis.model.pace import OSCILLATION_STEP, WITHIN, servo_of
from sim.diagnosis.model.point import Point, innovations
from sim.effects import effect
from sim.flight import packed

SLOWEST = 0.65


@pytest.fixture(scope="module")
def record():
    """`constant` at 100 Hz: a servo of 50 rad/s on a grid of 2.5 ms."""
    return as_record(0.01)


def paced(record, *effects, later=0.0):
    return servo_of(record, packed(record.nominal, effects, record.centre), later, SLOWEST)


def test_two_steps_resolve_the_nominal_s_servo(record):
    assert paced(record) == (50.0, 2) and record.step == 0.0025
    assert paced(record, effect("actuator_bandwidth", scale=3.0)) == (50.0, 1)


def test_a_later_servo_is_slower_but_not_without_end(record):
    lag = record.actuator.lag
    assert paced(record, later=lag)[0] == pytest.approx(25.0)
    assert paced(record, later=-0.9 * lag)[0] == pytest.approx(50.0 / SLOWEST)


def test_a_servo_faster_than_the_rows_resolve_stands_for_none(record):
    """Its lag is then a third of a row, whatever the nominal says; slower ones are what they are."""
    fastest = fastest_servo(record.period)
    assert fastest == pytest.approx(DIRECT / min(0.003, record.period / DIRECT_PARTS))
    fast = dataclasses.replace(record, actuator=dataclasses.replace(record.actuator, natural_frequency=2000.0))
    assert paced(fast) == (pytest.approx(fastest), 1)
    assert paced(fast, effect("actuator_bandwidth", scale=0.5))[0] * 0.5 == pytest.approx(fastest)
    assert paced(fast, effect("actuator_bandwidth", scale=0.02)) == (2000.0, 2)  # 40 rad/s, as the log would show it
    assert paced(fast, effect("actuator_bandwidth", scale=0.02, lag=1.0))[0] == 2000.0  # in proportion to the servo


def test_late_sensors_onsets_and_oscillations_ask_for_short_steps(record):
    assert paced(record, effect("gyro_delay", delay=0.02))[1] == 1
    grid = dataclasses.replace(record, step=record.step / 8.0, every=8 * record.every, tick=8 * record.tick)
    longest = math.floor(LONGEST_AT_ONCE / grid.step + 1e-9)
    assert paced(grid)[1] == longest
    for frequency in (100.0, 300.0):
        swinging = effect("bending", gain=0.1, frequency=frequency, damping_ratio=0.01)
        assert paced(grid, swinging)[1] == int(OSCILLATION_STEP / frequency / grid.step)
    for begins in (effect("actuator_delay", delay=0.013), effect("gust", angle=0.05, time=2.0, duration=1.0),
                   effect("moment_step", acceleration=0.1, time=2.0), effect("control_loss", fraction=0.3, time=2.0)):
        assert paced(grid, begins)[1] == int(WITHIN * record.period / grid.step)
    assert paced(grid, effect("periodic_disturbance", amplitude=0.1, frequency=150.0))[1] == \
        int(OSCILLATION_STEP / 150.0 / grid.step)


@pytest.mark.parametrize("effects", [(), (effect("actuator_backlash", half_width=0.002),),
                                     (effect("actuator_delay", delay=0.013),),
                                     (effect("gust", angle=0.05, time=2.0, duration=1.0),)])
def test_steps_at_once_change_the_innovations_by_less_than_any_noise(record, monkeypatch, effects):
    """A hundredth of the sensors' noise."""
    filt = first_filter(record, declared(record))
    at_once = innovations(record, filt, Point(effects))[0]
    monkeypatch.setattr("sim.diagnosis.model.point.servo_of", lambda *given: (servo_of(*given)[0], 1))
    each = innovations(record, filt, Point(effects))[0]
    assert (np.abs(at_once - each) <= 1e-2 * declared(record)[:3]).all()
