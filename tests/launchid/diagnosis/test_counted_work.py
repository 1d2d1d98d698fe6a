"""A diagnosis is bounded by counted work, which its log alone decides: no clock, no load, no number of threads is in
its answer.  What the emergency brake stops has no answer, and says so on every surface."""

import ast
import dataclasses
import itertools
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_diagnosis_world import NOMINAL, flown

from launchid import sums
from launchid.diagnosis.causes import RECORDS
from launchid.diagnosis.data import work
from launchid.diagnosis.data.work import Stopped, Work
from launchid.diagnosis.report.answer import report
from launchid.diagnosis.report.page import write_report
from launchid.diagnosis.report.words import headline, lines
from launchid.diagnosis.verdict import diagnose
from launchid.log.log import write_flight
from sim.effects import from_text
from sim.flight import fly_whole
from sim.nominal import load_nominal

ROOT = Path(__file__).resolve().parents[3]
DAMPED = "aero_damping:coefficient=0.8"
AMONG = tuple(RECORDS[name] for name in ("aero_damping", "gyro_bias", "actuator_delay"))
FEW = 1e-6         # of the ordinary effort: less than one step along any log


def diagnosed(**changes):
    """The verdict on a flight with another damping, where [diagnosis] says so."""
    nominal = dataclasses.replace(NOMINAL, diagnosis=dataclasses.replace(NOMINAL.diagnosis, **changes))
    return diagnose(flown(NOMINAL, DAMPED), nominal, hypotheses=AMONG)


@pytest.fixture(scope="module")
def patient():
    """A diagnosis with all the time and effort that it needs."""
    made = diagnosed()
    assert [each.cause for each in made.causes] == ["aero_damping"]
    assert not (made.is_cut_short or made.is_spent or report(made)["cut_short"] or report(made)["effort_spent"])
    return made


# ---- counted work


def test_the_answer_is_the_same_however_fast_the_clock_runs(patient, monkeypatch):
    ticks = itertools.count(step=0.1)
    monkeypatch.setattr(work.time, "monotonic", lambda: next(ticks))
    assert json.dumps(report(diagnosed(time_limit=1e9))) == json.dumps(report(patient))
    assert next(ticks) > 10.0   # it was asked: one look a pass along the log


def test_no_other_file_of_the_diagnosis_knows_the_time():
    for path in sorted((ROOT / "launchid" / "diagnosis").rglob("*.py")):
        names = {alias.name for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
                 if isinstance(node, ast.Import) for alias in node.names}
        assert path.name == "work.py" or not names & {"time", "datetime"}, path


def test_a_search_without_effort_ends_before_its_first_cause_and_says_so():
    made = diagnosed(effort=FEW)
    assert made.is_spent and not made.is_cut_short and made.verdict == "unexplained" and not made.nearest
    assert report(made)["effort_spent"] and any("[diagnosis] effort" in line for line in lines(made))


def test_work_is_shared_by_all_that_are_made_of_a_record(patient):
    assert patient.record.work is patient.selection.model.fit.record.work
    assert patient.record.work.brake == np.inf   # what is drawn of it later is stopped by nothing


# ---- the brake


def test_the_brake_stops_what_goes_on_and_is_taken_off():
    of = Work()
    of.count(5)
    of.limit(1.0, -1.0)
    with pytest.raises(Stopped):
        of.count(1)
    of.release()
    of.count(work.STEPS)
    assert of.is_spent


def test_what_the_brake_stopped_has_no_answer_and_says_so_everywhere(tmp_path):
    made = diagnosed(time_limit=1e-9)
    found = report(made)
    assert (found["verdict"], found["cut_short"], found["causes"], found["nearest"]) == ("unexplained", True, [], [])
    assert found["ranking"] == [] and found["limits"] == {} and found["gain"] is None and found["proposal"] is None
    assert "stopped" in headline(made) and any("[diagnosis] time_limit" in line for line in lines(made))
    write_report(made, found, tmp_path)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    first, rest = page.split("<nav>")
    assert "stopped after 1e-09 s" in first and "no known cause" not in page and "clearly worse" not in page
    assert "Ranked hypotheses" not in rest and not list(tmp_path.glob("*.png"))


# ---- threads


ASKED = """
import json, sys
import launchid
sys.stdout.write(json.dumps(launchid.diagnose(sys.argv[1], "constant").report))
"""
PYTHON, COMMAND = ("-c", ASKED, "LOG"), ("-m", "sim", "diagnose", "LOG", "constant", "--json", "-")


@pytest.mark.parametrize(("words", "effect"), [
    (PYTHON, ""), *(pytest.param(words, DAMPED, marks=pytest.mark.campaign) for words in (PYTHON, COMMAND))])
def test_threads_change_no_byte(tmp_path, words, effect):
    """A log of 70 s has sums over 21,000 numbers, which the linear algebra behind numpy splits among its threads."""
    log = tmp_path / "log.csv"
    write_flight(log, fly_whole(load_nominal("constant"), 1, effects=[from_text(effect)] if effect else ()))
    said = [subprocess.run([sys.executable, *(str(log) if word == "LOG" else word for word in words)], cwd=ROOT,
                           check=True, capture_output=True, timeout=600,
                           env={**os.environ, "OPENBLAS_NUM_THREADS": threads}).stdout for threads in ("1", "2")]
    assert said[0] == said[1] and (b"aero_damping" in said[0]) >= bool(effect)


def test_the_command_has_one_thread_before_numpy_reads_how_many():
    said = ("import os, sys; import launchid.__main__ as m; assert 'numpy' not in sys.modules; "
            "sys.argv[1:] = ['effects']; s = m.command(); assert 'numpy' in sys.modules; "
            "assert {os.environ[k] for k in m.THREADS} == {'1'}")
    subprocess.run([sys.executable, "-c", said], cwd=ROOT, check=True, capture_output=True, timeout=300,
                   env={**os.environ, "OMP_NUM_THREADS": "7"})


# ---- sums


@given(st.integers(1, 6), st.integers(6, 40), st.integers(0, 2**32 - 1), st.booleans())
def test_sums_are_those_of_linear_algebra(k, n, seed, is_dependent):
    rng = np.random.default_rng(seed)
    a, b, y = rng.standard_normal((n, k)), rng.standard_normal((n, 3)), rng.standard_normal(n)
    if is_dependent:
        a[:, -1] = a[:, 0]
    assert sums.products(a, b) == pytest.approx(a.T @ b) and sums.along(a, y) == pytest.approx(a.T @ y)
    assert sums.combined(a, y[:k]) == pytest.approx(a @ y[:k]) and sums.square(y) == pytest.approx(y @ y)
    q, r = sums.orthonormal(a)
    assert q @ r == pytest.approx(a) and np.count_nonzero(q.any(axis=0)) == np.linalg.matrix_rank(a)
    assert q.T @ q == pytest.approx(np.diag(q.any(axis=0).astype(float)), abs=1e-12)
    assert sums.least_squares(a, y) == pytest.approx(np.linalg.lstsq(a, y, rcond=None)[0])


def test_a_column_of_zeros_and_one_that_is_no_number():
    a = np.array([[0.0, 1.0], [0.0, 2.0], [0.0, 2.0]])
    assert sums.least_squares(a, np.array([1.0, 2.0, 2.0])) == pytest.approx([0.0, 1.0])
    a[1, 1] = np.nan
    assert np.isnan(sums.orthonormal(a)[0][:, 1]).all()
