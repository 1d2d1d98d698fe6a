"""The diagnosis of the second stage's causes that are no chance: where their search begins, what their numbers are
worth, what an extension means, and that they are named on flights that nobody here simulated."""

import dataclasses

import numpy as np
import pytest
from hidden import draw_spec, fly, hide, write_csv

from launchid.diagnosis.causes import RECORDS, SOUGHT, Cause
from launchid.diagnosis.controller.command import record
from launchid.diagnosis.judge.extend import extended
from launchid.diagnosis.model.linear import state_matrix
from launchid.diagnosis.model.nuisance import Problem
from launchid.diagnosis.model.point import Point, vehicle
from launchid.diagnosis.search.fit import fit, slopes_at
from launchid.diagnosis.search.profile import as_simulated
from launchid.diagnosis.search.scan import scan
from launchid.log.detect import check
from launchid.log.log import read_log
from sim.effects import effect, pack, values
from sim.nominal import load_nominal

CERTAIN = {"moment_step", "nozzle_inertia", "control_slope", "lateral_drift"}
NOBODYS_BEFORE = {"turbulence", "wind_walk"}


def recorded(folder, start=0.0, **drawn):
    """A hidden flight on its grid, its clock moved by `start` [s]."""
    columns, _ = fly(draw_spec(8, rate=100.0, **drawn))
    write_csv(folder / "log.csv", columns | {"t": columns["t"] + start})
    log, nominal = read_log(folder / "log.csv"), load_nominal("constant")
    return record(log, nominal, check(log, nominal))


# ---- moment_step: all onsets at once


@pytest.mark.parametrize("time", [15.9, 28.0])
def test_the_search_for_a_moment_begins_at_its_onset(tmp_path, time):
    """Two seconds beside it lies another minimum, many nats above: at 15.9 s and 18 s in this flight."""
    hidden = hide("moment_step", {"acceleration": -0.0012, "time": time})
    of = recorded(tmp_path, effects=(hidden,), duration=40.0)
    base = as_simulated(of)
    problem = Problem(of, base.fit.filter)
    start, = scan(problem, base.fit, [RECORDS["moment_step"]])
    assert start.values[1] == pytest.approx(time, abs=1.0) and start.values[0] == pytest.approx(-0.0012, rel=0.3)
    found = fit(problem, (Cause(RECORDS["moment_step"], start.values),), np.zeros(5))
    (size, onset), std = found.causes[0].values, found.std(0)
    assert abs(onset - time) < 4.0 * std[1] < 2.0
    assert abs(size + 0.0012) < 4.0 * std[0] < 0.003  # a slow moment of 0.002 is nobody's fault


# ---- nozzle_inertia: in the covariances too


def test_the_covariances_know_the_nozzle_s_inertia():
    plain, heavy, c = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((3, 6))
    for a, effects in ((plain, []), (heavy, [effect("nozzle_inertia", coefficient=-0.004)])):
        table = pack(effects, 0.001)
        state_matrix(table.plant, table.actuator, np.full(len(table.plant), -1), 2.0, -7.0, 50.0, 0.7, False, a, c)
    assert np.allclose(heavy[1], plain[1] - 0.004 * plain[3], rtol=0, atol=1e-12)
    assert np.array_equal(np.delete(heavy, 1, 0), np.delete(plain, 1, 0)) and np.abs(heavy - plain).max() > 1.0


# ---- control_slope: about the log's centre


@pytest.mark.parametrize("start", [0.0, 20.0, 1.0e6])
def test_a_slope_turns_about_the_log_s_centre_and_so_does_its_extension(tmp_path, start):
    """The centre is also that of a log that begins in flight, and of one on a calendar's clock (its grid begins at
    0)."""
    of = recorded(tmp_path, start, duration=10.0)
    centre = start + 0.5 * 9.99
    flown = vehicle(of, Point((effect("control_slope", slope=0.01),)))
    t = np.arange(len(flown.k1)) * (0.5 * of.step) + of.shift
    assert np.allclose(flown.k1, -7.0 * (1.0 + 0.01 * (t - centre)), rtol=0, atol=1e-9)
    nominal = load_nominal("constant")
    longer = extended(nominal, [Cause(RECORDS["control_slope"], (0.01,))], of.shift, centre=of.centre)
    assert values(longer.effects[0]) == pytest.approx({"slope": 0.01, "middle": centre})
    log = read_log(tmp_path / "log.csv")
    again = record(log, longer, check(log, nominal))
    assert np.allclose(vehicle(again, Point()).k1, flown.k1, rtol=0, atol=1e-9)


# ---- lateral_drift: a ridge


def test_the_slopes_of_a_drift_are_small_enough_for_its_ridge(tmp_path):
    """The nozzle's part is like the angle's in trim; what is left of one beside the other must not depend on the
    step."""
    of = recorded(tmp_path, cause="lateral_drift", factor=2.0, duration=40.0)
    base = as_simulated(of)
    problem = Problem(of, base.fit.filter)
    rest = []
    for shrunk in (1.0, 0.1):
        own = RECORDS["lateral_drift"]
        own = dataclasses.replace(own, free=tuple(dataclasses.replace(f, step=shrunk * f.step) for f in own.free))
        cause = Cause(own, (0.004, 0.0024))
        r = problem.residual(Point((own.effect(cause.values),)))
        jacobian = slopes_at(problem, (cause,), np.zeros(5), r)
        basis, _ = np.linalg.qr(np.delete(jacobian, 1, axis=1))
        column = jacobian[:, 1]
        rest.append(np.linalg.norm(column - basis @ (basis.T @ column)))
    assert rest[0] == pytest.approx(rest[1], rel=0.05)


# ---- chance is in the catalogue, and in no search


def test_levels_of_chance_have_a_record_and_no_search():
    assert CERTAIN <= {each.cause for each in SOUGHT} and not NOBODYS_BEFORE & {each.cause for each in SOUGHT}
    for name in NOBODYS_BEFORE:
        assert RECORDS[name].where == "environment" and RECORDS[name].free[0].name == "level"


def test_a_nominal_s_own_chance_moves_no_prediction(tmp_path):
    of = recorded(tmp_path, duration=5.0)
    windy = dataclasses.replace(of.nominal, effects=(effect("turbulence", level=0.01), effect("wind_walk", level=0.01)))
    rough = dataclasses.replace(of, nominal=windy)
    still, blown = (vehicle(each, Point()) for each in (of, rough))
    assert blown.wind.size == 0 and np.array_equal(still.a6, blown.a6)
