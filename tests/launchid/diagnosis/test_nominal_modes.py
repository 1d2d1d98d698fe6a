"""A nominal with slosh and bending: they are states of the filter, and its own flight is consistent with it."""

import dataclasses
import functools

import numpy as np
import pytest
from test_diagnosis import short

from launchid.diagnosis.adapter import read
from launchid.diagnosis.model import Model
from launchid.diagnosis.verdict import diagnose
from launchid.likelihood.estimate import evaluate
from launchid.log.log import flown_log
from sim.effects import from_text
from sim.flight import fly_whole
from sim.sections import Bending, InTime, Slosh, constant

SLOSH = Slosh(frequency=InTime((0.0, 20.0), (3.0, 5.0)), coupling=constant(0.08))
BENDING = Bending(frequency=InTime((0.0, 20.0), (15.0, 25.0)), gain=constant(0.1), gyro_gain=constant(0.05))
MODES = dataclasses.replace(short(20.0), slosh=(SLOSH,), bending=(BENDING,))


@functools.cache
def log_with(*effects: str):
    return flown_log(fly_whole(MODES, 3, effects=[from_text(each) for each in effects]), "flight")


def squares(nominal) -> np.ndarray:
    """Mean squares of the whitened innovations of attitude and rate, levels as declared."""
    m = Model.of(read(log_with(), nominal).track)
    e = evaluate(m, m.table.null).e
    return np.array([np.mean(e[m.log.channel == channel]**2) for channel in (0, 1)])


def test_modes_that_change_with_time_leave_white_innovations():
    assert squares(MODES) == pytest.approx(1.0, abs=0.15)
    assert np.all(squares(dataclasses.replace(MODES, slosh=(), bending=())) > 1.5)


def test_a_flight_is_consistent_with_its_own_modes():
    assert diagnose(log_with(), MODES).verdict == "consistent"


def test_beside_its_modes_another_cause_is_named():
    cause, = diagnose(log_with("aero_damping:coefficient=0.4"), MODES).named
    value, std = cause.parameters["coefficient"]
    assert cause.cause == "aero_damping" and abs(value - 0.4) < 4.0 * std
