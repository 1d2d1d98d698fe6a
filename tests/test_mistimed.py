"""A column that is of another time than its stamps is no cause: early, or a nozzle angle that is late, it stands for
none of the catalogue, though an actuator's or an attitude's delay resembles it."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from every import every
from test_diagnosis import LONG, NEAR, log_of
from test_diagnosis_ticks import FINE, NOMINAL, flight, log_at

from sim.diagnosis.causes import SOUGHT
from sim.diagnosis.controller.command import record
from sim.diagnosis.data.check import check
from sim.diagnosis.judge import mistimed
from sim.diagnosis.judge.mistimed import moved
from sim.diagnosis.verdict import diagnose

ROWS = np.arange(100, 40_000 - 100, 10)  # of a flight at FINE: every 10 ms
TIMED = (*NEAR, *(each for each in SOUGHT if each.cause in ("attitude_delay", "gyro_delay", "gyro_scale")))


def stamped(effect="", **late):
    """A log whose columns are so many s late (early: negative)."""
    whole = log_of(flight(effect))
    log = log_at(whole, ROWS)
    return dataclasses.replace(log, **{name: getattr(whole, name)[ROWS - round(by / FINE)]
                                       for name, by in late.items()})


@pytest.mark.parametrize(("column", "late"), [
    ("beta", 0.012), ("theta_dot", -0.01),
    pytest.param("theta_dot", -0.02, marks=LONG), pytest.param("beta", -0.01, marks=LONG)])
def test_a_column_of_another_time_is_no_cause(column, late):
    made = diagnose(stamped(**{column: late}), NOMINAL, hypotheses=TIMED)
    assert (made.verdict, made.where) == ("unexplained", "sensor")
    said = [doubt for doubt in made.doubts if f"a column {column} that is" in doubt]
    assert len(said) == 1 and ("late" in said[0]) == (late > 0.0)
    told = float(said[0].split(" that is ")[1].split()[0])
    assert told == pytest.approx(abs(late), abs=0.003)


@every("late", [0.4, 1.1, 2.3, 3.0, 4.7])
def test_how_late_a_column_is_is_the_top_of_the_parabola_between_the_tries(monkeypatch, late):
    """The time is found either way, of parts of a row; and as far as the tries go where it never falls."""
    def found(way, likelihood):
        monkeypatch.setattr(mistimed, "moved", lambda record, channel, rows: rows)
        monkeypatch.setattr(mistimed, "profile", lambda rows, *given: SimpleNamespace(log_likelihood=likelihood(rows)))
        model = SimpleNamespace(fit=SimpleNamespace(record=None, delta=None, filter=None))
        return mistimed._best(model, (), "beta", way)[0]

    for way in (-1.0, 1.0):
        assert found(way, lambda rows, way=way: -7.0 * (rows - way * late)**2) == pytest.approx(way * late, abs=1e-9)
        assert found(way, lambda rows, way=way: way * rows) == pytest.approx(
            way * mistimed.STEP * (mistimed.FURTHEST - 1), rel=0.3)


@pytest.mark.parametrize("effect", ["actuator_delay:delay=0.012", *(pytest.param(each, marks=LONG) for each in (
    "gyro_delay:delay=0.01", "attitude_delay:delay=0.015", "actuator_bandwidth:scale=0.6"))])
def test_what_is_late_itself_is_named(effect):
    made = diagnose(stamped(effect), NOMINAL, hypotheses=TIMED)
    assert (made.verdict, [cause.cause for cause in made.causes]) == ("explained", [effect.split(":")[0]])


@pytest.mark.parametrize("rows", [0.25, 0.5, 0.8, 1.0, 1.3, 2.5, 4.0])
@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_a_column_is_moved_by_parts_of_a_row_and_its_noise_stays_as_white_and_as_large(rows, way):
    log = stamped()
    of = record(log, NOMINAL, check(log, NOMINAL))
    t = np.arange(of.rows, dtype=float)
    wave, noise = np.sin(0.05 * t), np.random.default_rng(5).standard_normal(of.rows)
    z = np.column_stack([wave, noise, np.full(of.rows, 3.0)])
    by = moved(moved(moved(dataclasses.replace(of, z=z), "theta", way * rows), "theta_dot", way * rows),
               "beta", way * rows).z
    inner = slice(20, -20)
    assert by[inner, 0] == pytest.approx(np.sin(0.05 * (t + way * rows))[inner], abs=2e-5)
    assert np.var(by[inner, 1]) == pytest.approx(np.var(noise[inner]), rel=0.02)
    assert abs(np.mean(by[10:-10, 1] * by[11:-9, 1])) < 4.0 / np.sqrt(of.rows)
    assert by[:, 2] == pytest.approx(3.0)


def test_rows_that_measure_nothing_stay_so():
    log = stamped()
    of = record(log, NOMINAL, check(log, NOMINAL))
    z = of.z.copy()
    z[50:60, 2] = np.nan
    missing = np.flatnonzero(~np.isfinite(moved(dataclasses.replace(of, z=z), "beta", 1.0).z[:, 2]))
    assert missing.tolist() == list(range(49, 59))
