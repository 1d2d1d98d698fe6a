"""The number of steps of the grid that are integrated at once, and that it changes nothing that a log could show."""

import dataclasses

import numpy as np
import pytest
from test_diagnosis_used import as_record

from launchid.diagnosis.data.record import LONGEST_AT_ONCE, WITHIN, Record, no_servo
from launchid.diagnosis.data.used import thinned
from launchid.diagnosis.model.noise import declared, first_filter
from launchid.diagnosis.model.point import FASTEST, Point, innovations, vehicle
from sim.effects import effect

EFFECTS = ((), (effect("actuator_backlash", half_width=0.002),), (effect("actuator_delay", delay=0.013),),
           (effect("gyro_delay", delay=0.013),), (effect("gust", angle=0.05, time=2.0, duration=1.0),),
           (effect("moment_step", acceleration=0.1, time=2.003),), (effect("control_loss", fraction=0.3, time=2.003),),
           (effect("bending", gain=0.05, frequency=30.0, damping_ratio=0.02),))


def finer(record, times=8):
    """The same log on a finer grid."""
    steps = np.arange((len(record.a6) - 1) * times + 1) / times
    a6, k1 = (np.interp(steps, np.arange(len(x)), x) for x in (record.a6, record.k1))
    return dataclasses.replace(record, step=record.step / times, every=times * record.every, tick=times * record.tick,
                               at=times * record.at, first_step=times * record.first_step, a6=a6, k1=k1)


@pytest.fixture(scope="module")
def record():
    """`constant` at 100 Hz: a servo of 50 rad/s on a grid of 2.5 ms."""
    return as_record(0.01)


def frequency(record, later):
    return vehicle(record, Point(deviations=(0.0, 0.0, 0.0, 0.0, later))).flight[0].frequency


def test_a_quarter_of_a_row_at_most_is_integrated_at_once_whatever_the_servo(record):
    assert record.at_once == 1 and finer(record).at_once == 8 == int(WITHIN * record.period / finer(record).step)
    slow = finer(thinned(record, 4), 4)
    assert slow.at_once * slow.step == pytest.approx(LONGEST_AT_ONCE) and LONGEST_AT_ONCE < WITHIN * slow.period
    fast = dataclasses.replace(slow, actuator=dataclasses.replace(record.actuator, natural_frequency=2000.0))
    assert fast.at_once == slow.at_once
    assert finer(record).resolution >= record.step  # no oscillation is sought that so long a step does not resolve


def test_a_later_servo_is_slower_but_not_without_end(record):
    lag = record.actuator.lag
    assert frequency(record, 0.0) == 50.0 and frequency(record, lag) == pytest.approx(25.0)
    assert frequency(record, -0.9 * lag) == pytest.approx(50.0 / FASTEST)


@pytest.mark.parametrize(("period", "lag"), [(0.001, 0.001 / 3.0), (0.005, 0.005 / 3.0), (0.02, 0.003)])
def test_the_servo_that_stands_for_none_lags_by_a_third_of_a_row_and_no_more_than_3_ms(period, lag):
    assert no_servo(period).lag == pytest.approx(lag, rel=0.08)


@pytest.mark.parametrize("effects", EFFECTS, ids=lambda each: each[0].name if each else "nominal")
def test_steps_at_once_change_the_innovations_by_less_than_any_noise(record, monkeypatch, effects):
    """A thirtieth of the sensors' noise, a tenth at the row where something begins within a step."""
    fine = finer(record)
    filt = first_filter(fine, declared(fine))
    at_once = innovations(fine, filt, Point(effects))[0]
    monkeypatch.setattr(Record, "at_once", 1)
    each = innovations(dataclasses.replace(fine), filt, Point(effects))[0]
    apart = np.abs(at_once - each) / declared(fine)[:3]
    assert not np.array_equal(at_once, each)
    assert np.quantile(apart, 0.99) < 3e-2 and apart.max() < 0.1
