"""How many steps of the grid are integrated at once, and that it changes nothing that a log could tell."""

import dataclasses

import numpy as np
import pytest
from test_diagnosis_used import as_record

from sim.diagnosis.data.record import AT_ONCE, DIRECT, DIRECT_PARTS, WITHIN, Record, fastest_servo
from sim.diagnosis.data.used import thinned
from sim.diagnosis.model.noise import declared, first_filter
from sim.diagnosis.model.point import FASTEST, Point, innovations, servo_frequency
from sim.effects import effect
from sim.flight import packed

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


def frequency(record, *effects, later=0.0):
    return servo_frequency(record, packed(record.nominal, effects, record.centre), later)


def test_a_quarter_of_a_row_at_most_is_integrated_at_once_and_what_resolves_the_servo(record):
    assert record.at_once == 1 and finer(record).at_once == 8 == int(WITHIN * record.period / finer(record).step)
    slow = finer(thinned(record, 4), 4)
    assert slow.at_once * slow.step <= AT_ONCE / record.actuator.frequency < WITHIN * slow.period
    assert finer(record).resolution >= record.step  # no oscillation is sought that so long a step does not resolve


def test_a_later_servo_is_slower_but_not_without_end(record):
    lag = record.actuator.lag
    assert frequency(record) == 50.0 and frequency(record, later=lag) == pytest.approx(25.0)
    assert frequency(record, later=-0.9 * lag) == pytest.approx(50.0 / FASTEST)


def test_a_servo_faster_than_the_rows_resolve_stands_for_none(record):
    """Its lag is then a third of a row, whatever the nominal says; slower ones are what they are."""
    fastest = fastest_servo(record.period)
    assert fastest == pytest.approx(DIRECT / min(0.003, record.period / DIRECT_PARTS))
    fast = dataclasses.replace(record, actuator=dataclasses.replace(record.actuator, natural_frequency=2000.0))
    assert frequency(fast) == pytest.approx(fastest)
    assert frequency(fast, effect("actuator_bandwidth", scale=0.5)) * 0.5 == pytest.approx(fastest)
    assert frequency(fast, effect("actuator_bandwidth", scale=0.02)) == 2000.0  # 40 rad/s, as the log would show it
    assert frequency(fast, effect("actuator_bandwidth", scale=0.02, lag=1.0)) == 2000.0  # in proportion to the servo


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
