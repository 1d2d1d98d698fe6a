"""The onset of something that stays (`diagnosis.search.onsets`): the adjoint against the responses themselves."""

import dataclasses

import numpy as np
import pytest

from launchid.diagnosis.causes import RECORDS, Cause
from launchid.diagnosis.controller.command import record
from launchid.diagnosis.model.noise import declared, first_filter
from launchid.diagnosis.model.nuisance import Problem
from launchid.diagnosis.model.point import DEVIATIONS
from launchid.diagnosis.search.fit import fit
from launchid.diagnosis.search.onsets import pushes, scores, sharpest
from launchid.diagnosis.search.scan import Projector, response, scan
from launchid.diagnosis.search.selection import _in_steps
from launchid.log.detect import check
from launchid.log.log import OPTIONAL, REQUIRED, Log
from sim.effects import from_text
from sim.flight import fly_whole
from sim.nominal import built_in, load_nominal
from sim.sections import Wind

DECLARED = Wind(turbulence=0.005, walk=0.002)


def posed(wind=None, effect=None, mask=None, period=0.01, masked=None, believed=()):
    """The problem of a flight of `constant` in this weather, and what is believed of it, fitted by nothing."""
    nominal = load_nominal(built_in("constant"))
    nominal = dataclasses.replace(nominal, simulation=dataclasses.replace(nominal.simulation, duration=14.0),
                                  sensors=dataclasses.replace(nominal.sensors, period=period), wind=wind)
    flown = fly_whole(nominal, 5, effects=[from_text(each) for each in (effect or "").split() if each])
    columns = {name: getattr(flown, name, np.full(len(flown.t), np.nan)) for name in REQUIRED + OPTIONAL}
    log = Log("flown", tuple(name for name in columns if np.isfinite(columns[name]).any()), (), **columns)
    r = record(log, nominal, check(log, nominal))
    if masked is not None:
        r.z[masked] = np.nan
    problem = Problem(r, first_filter(r, declared(r)), mask)
    causes = tuple(Cause(RECORDS[name], values) for name, values in believed)
    return problem, fit(problem, causes, np.zeros(DEVIATIONS), iterations=0)


@pytest.mark.parametrize(("cause", "is_loss"), [("moment_step", False), ("control_loss", True)])
@pytest.mark.parametrize("given", [
    {},
    {"wind": DECLARED},
    {"period": 0.002},                        # the controller's noise is held over five rows
    {"mask": np.arange(1400) % 200 < 120},    # rows left out of the fit, which correct the state all the same
    {"masked": slice(500, 900)},              # rows without measurement
    {"believed": [("bending", (0.05, 30.0, 0.02))], "effect": "bending:gain=0.05,frequency=30,damping_ratio=0.02"},
    {"believed": [("gyro_scale", (0.7,))], "effect": "gyro_scale:scale=0.7"},  # of neither the filter knows
])
def test_score_and_information_are_those_of_the_response(cause, is_loss, given):
    """The score agrees to the linear dynamics' 1 %, of a loss to 6 %: the nozzle moves within a row."""
    close = 0.06 if is_loss else 0.01
    problem, base = posed(**given)
    score, information = scores(problem, base, pushes(problem.record, base, is_loss))
    project = Projector(problem, base)
    for t in (4.0, 7.5, 11.0):
        k = int(np.argmin(np.abs(problem.record.t - t)))
        change = response(problem, base, project, RECORDS[cause], (float(problem.record.t[k]),))
        energy, slope = float(change @ change), float(change @ project.residual)
        assert information[k] == pytest.approx(energy, rel=close)
        assert score[k] == pytest.approx(-slope, abs=2.0 * close * np.sqrt(energy) + close * abs(slope))


def test_an_onset_in_weather_is_seen_where_it_is():
    """A step of 0.2 rad/s^2 at 7.23 s in turbulence: between the pieces' half seconds nothing of it is seen."""
    problem, base = posed(DECLARED, "moment_step:acceleration=0.2,time=7.23")
    assert sharpest(problem, base, False) == [pytest.approx(7.23, abs=0.03)]
    best = scan(problem, base, (RECORDS["moment_step"],))[0]
    assert best.values == (pytest.approx(0.2, rel=0.2), pytest.approx(7.23, abs=0.03))


def test_a_log_too_short_for_an_onset_has_none():
    problem, _ = posed()
    short = dataclasses.replace(problem.record, z=problem.record.z[:350], at=problem.record.at[:350])
    part = Problem(short, first_filter(short, declared(short)))
    assert sharpest(part, fit(part, (), np.zeros(DEVIATIONS), iterations=0), False) == []


def test_a_loss_that_comes_gradually_is_tried_in_two_steps_about_its_middle():
    """One onset in the middle of two cannot say what they do: two halves about it come nearer, and are two causes."""
    problem, base = posed(effect="control_loss:fraction=0.3,time=6.5 control_loss:fraction=0.3,time=8",
                          believed=[("control_loss", (0.5, 7.2))])
    one = fit(problem, base.causes, np.zeros(DEVIATIONS))
    tried = list(_in_steps(problem, one, [RECORDS["control_loss"]]))
    best = min(tried, key=lambda each: each.cost)
    assert best.cost < one.cost - 10.0 and len(best.causes) == 2
    assert sorted(cause.values[1] for cause in best.causes) == pytest.approx([6.5, 8.0], abs=0.3)
    assert list(_in_steps(problem, one, [RECORDS["gust"]])) == []   # of a cause that is not sought there is none
    assert list(_in_steps(problem, posed()[1], [RECORDS["control_loss"]])) == []
