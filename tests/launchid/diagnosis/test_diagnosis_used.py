"""The rows of a large log that are fitted (`launchid.diagnosis.data.used`): fewer rows, the same motion."""

import dataclasses

import numpy as np
import pytest
from shortened import short

from launchid.diagnosis.adapter import track_of
from launchid.diagnosis.candidates import usual
from launchid.diagnosis.controller.command import record
from launchid.diagnosis.data.used import LONGEST_PERIOD, MOTION_STEP, cut, shortened, slowest, sparser, thinned, used
from launchid.diagnosis.model import Model
from launchid.log.detect import check
from launchid.log.log import OPTIONAL, REQUIRED, Log
from sim.flight import fly_whole
from sim.nominal import built_in, constant_profile, load_nominal


def logged(period, duration=6.0, drop=()):
    """A flight of `constant` as a log of this period [s], and its nominal."""
    nominal = short(duration, sensors={"period": period})
    flown = fly_whole(nominal, 3)
    columns = {name: getattr(flown, name, np.full(len(flown.t), np.nan)) for name in REQUIRED + OPTIONAL}
    columns = {name: np.full(len(flown.t), np.nan) if name in drop else x for name, x in columns.items()}
    return Log("flown", tuple(name for name in columns if np.isfinite(columns[name]).any()), (), **columns), nominal


def as_record(period, **given):
    log, nominal = logged(period, **given)
    return record(log, nominal, check(log, nominal))


def test_what_is_cut_is_the_stretch_with_most_input():
    r = as_record(0.01)
    quiet = dataclasses.replace(r, commands=np.where(np.arange(len(r.commands)) < 300, 0.0, r.commands))
    part = cut(quiet, 200)
    assert part.rows == 200 and part.t[0] >= 3.0 - 0.01 and part.at[0] == 0
    first = round(part.t[0] / 0.01)
    assert np.array_equal(part.z, quiet.z[first:first + 200], equal_nan=True)
    assert np.array_equal(part.commands, quiet.commands[first:first + 200])


def test_a_large_log_is_thinned_and_then_cut():
    """600 rows at 10 ms, of which 100 may be used: every second, 20 ms apart, and of those the 100 with most input."""
    r = as_record(0.01)
    made, said = used(r, r.t, most=100)
    assert made.rows == 100 and made.period == pytest.approx(LONGEST_PERIOD)
    assert said.every == 2 and said.end - said.begin == pytest.approx(99 * LONGEST_PERIOD)
    assert "100 rows are fitted, one in 2 from" in said.words


def test_a_fast_vehicle_s_own_oscillation_stays_resolved():
    """A pendulum of 60 Hz in a log of 1 kHz, of which one row in three seemed a nozzle's inertia."""
    nominal = load_nominal(built_in("constant"))
    fast = np.array([-(2.0 * np.pi * 60.0)**2])
    assert slowest(nominal, fast) == pytest.approx(MOTION_STEP / (2.0 * np.pi * 60.0))
    swinging = dataclasses.replace(nominal, terms=(("sin(theta)", float(fast[0])), ("theta_dot", -1e9)))
    assert slowest(swinging, np.zeros(1)) == slowest(nominal, -fast) == slowest(nominal, fast)
    assert slowest(nominal, np.zeros(1)) == slowest(nominal, np.array([-68.0, 4.0])) == LONGEST_PERIOD
    r = as_record(0.002)
    r = dataclasses.replace(r, nominal=dataclasses.replace(r.nominal, vehicle=constant_profile(-1e4, 1.0)))   # 1.5 rows
    made, said = used(r, r.t, most=1000)
    assert said.every == 1 and made.rows == 1000 and shortened(r, most=1000).rows == 1000


def test_the_nozzle_between_two_rows_is_driven_by_each_command():
    """A fast servo in a log of which one row in two is fitted: it seemed limited in rate, for a step of the filter had
    the mean of two commands.  At those rows it is where it is at those of the whole log."""
    log, nominal = logged(0.01)
    assert nominal.actuator is not None
    nominal = dataclasses.replace(nominal, actuator=dataclasses.replace(nominal.actuator, natural_frequency=66.0))
    r = record(log, nominal, check(log, nominal))
    beta = []
    for each in (r, thinned(r, 2)):
        m = Model(track_of(dataclasses.replace(each, z=np.full_like(each.z, np.nan))))
        m.with_numbers(usual(m), [])
        m.run(m.null)
        beta.append(m.X[:, 4])
    assert np.max(np.abs(beta[1] - beta[0][::2])) < 1e-6 * np.max(np.abs(beta[0]))


def test_a_test_stand_s_log_is_thinned_before_it_has_a_grid():
    log, nominal = logged(0.002, drop=("beta_cmd", "theta_ref"))
    stand = dataclasses.replace(nominal, actuator=None, controller=None)
    data = check(log, stand)
    sparse = sparser(data, log.t, stand, most=1000)
    assert sparse.usable.sum() == np.ceil(data.usable.sum() / 3)
    assert record(log, stand, sparse).period == pytest.approx(0.006)
    assert sparser(data, log.t, nominal, most=1000) is data    # what has a servo keeps all its commands
    assert sparser(data, log.t, stand) is data

