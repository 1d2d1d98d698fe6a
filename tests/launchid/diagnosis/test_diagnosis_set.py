"""The labelled set of the diagnosis: the answers of a tenth of it, and the laws of how it is read, judged and compared.

All of it: `python benchmarks/diagnosis_set.py`.
"""

import argparse
import importlib
from pathlib import Path

import numpy as np
import pytest
from hidden import LISTED, OTHER, PLAIN, UNLISTED

from launchid.log.log import measured_logs, read_log
from sim.nominal import BUILT_IN, STAND_NOMINALS

BENCHMARKS = Path(__file__).resolve().parents[3] / "benchmarks"
JUDGES = {"bam_xl330_kp400_lift_and_drop", "aeropendulum_aprbs_1"}  # nothing may be chosen on them


@pytest.fixture(scope="module")
def bench():
    """(diagnosis_labels, diagnosis_sources, diagnosis_set), which are no installed packages."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCHMARKS))
        return tuple(map(importlib.import_module, ("diagnosis_labels", "diagnosis_sources", "diagnosis_set")))


def the_set():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCHMARKS))
        return importlib.import_module("diagnosis_labels").read_set()


CASES, NOMINALS = the_set()
TENTH = [case for case in CASES if case.in_tests]
CAMPAIGN = {"clean/10", "clean-windy/1", "dropped/slosh-theta_dot", "j246/weak_gimbal", "listed/bending-1",
            "listed/control_loss-1", "listed/friction-1", "listed/gust-1", "listed/slosh-1",
            "measured/dfki_pendulum_dircol", "pairs/attitude_delay+aero_damping", "rebuilt/ship", "small/control_loss",
            "unlisted/servo_friction-1"}   # 3 to 8 s each; the others 1.5 s, about


# ---- the answers


@pytest.mark.parametrize("case", [pytest.param(case, id=case.name, marks=pytest.mark.campaign if case.name in CAMPAIGN
                                               else ()) for case in TENTH])
def test_the_answer_is_right_and_so_are_the_sizes(bench, case):
    labels, _, command = bench
    row = command.answered(case, NOMINALS, (), "")
    if "absent" in row:
        pytest.skip(row["absent"])
    assert labels.outcome(case, row) == "right", (labels.said(row), case.accepted, labels.wrong_names(case, row))
    assert all(away <= labels.FAR * std for _, away, std in labels.sizes(case, row)), row["named"]


# ---- the set


def test_a_tenth_is_answered_in_every_run_and_has_some_of_every_kind():
    assert len(CASES) >= 250 and len(TENTH) >= 40
    assert {case.kind for case in TENTH} == {case.kind for case in CASES}
    assert not any(case.part == "judge" for case in TENTH)


def test_every_measured_log_of_the_package_has_its_label_and_the_judges_are_marked():
    measured = {case.source[1]: case for case in CASES if case.kind == "measured"}
    assert set(measured_logs()) <= set(measured)
    assert {name for name, case in measured.items() if case.part == "judge"} == JUDGES
    assert not any(case.source[1] in JUDGES for case in CASES if case.kind != "measured")
    assert all(case.nominal in STAND_NOMINALS or case.nominal in NOMINALS for case in measured.values())


def test_every_cause_in_both_forms_and_every_effect_that_nobody_listed_is_hidden_somewhere():
    hidden = [(case.group, case.source[1], case.options.get("variant", PLAIN)) for case in CASES]
    assert {(name, form) for group, name, form in hidden if group == "listed"} == {
        (name, form) for name in LISTED for form in (PLAIN, OTHER)}
    assert {name for group, name, _ in hidden if group == "unlisted"} == set(UNLISTED)


def test_what_is_held_out_or_placebo_is_what_it_says():
    hidden = [case for case in CASES if case.source[0] == "hidden"]
    assert len({case.options["seed"] for case in hidden}) == len(hidden)
    assert all(case.nominal in BUILT_IN and "rate" in case.options for case in hidden)
    placebos = [case for case in CASES if case.kind == "placebo"]
    assert len(placebos) >= 20 and all(0.3 <= case.options["shift"] <= 0.5 for case in placebos)
    assert all(case.kind == "placebo" or "shift" not in case.options for case in CASES)
    foreign = [case for case in CASES if case.kind == "foreign"]
    assert foreign and all(case.options["seed"] < 1000 for case in foreign)  # from 1000 on they judge


# ---- judging


def named(cause, *alike, term="", where="plant", **sizes):
    return {"cause": cause, "term": term, "alike": list(alike), "where": where, "sizes": sizes}


def row(verdict, *answers, **more):
    return {"case": "g/a", "verdict": verdict, "named": list(answers), "where": None, "truth": {}, "seconds": 1.0,
            "nearest": [], "places": []} | more


def case(bench, accepted, beside=(), never=("others",), **more):
    return bench[0].Case("g/a", "g", "k", ("log", "a"), "constant", tuple(accepted), beside=tuple(beside),
                         never=tuple(never), **more)


SIN = named("missing_term", term="sin(theta)")


@pytest.mark.parametrize(("accepted", "beside", "never", "answer", "expected"), [
    (["slosh"], [], ["others"], row("explained", named("slosh")), "right"),
    (["slosh"], [], ["others"], row("dominant", named("gust", "slosh")), "right"),            # in a set of two
    (["slosh"], [], ["others"], row("dominant", named("gust", "slosh", "bending", "friction")), "refused"),  # of four
    (["slosh"], [], ["others"], row("dominant", named("slosh"), named("gust")), "wrong"),
    (["slosh"], ["gust"], ["others"], row("dominant", named("slosh"), named("gust")), "right"),
    (["slosh"], ["gust"], ["others"], row("dominant", named("gust")), "refused"),              # true, and a part
    (["slosh"], [], ["others"], row("unexplained", named("gust")), "refused"),                 # names nothing
    (["slosh"], [], ["others"], row("consistent"), "refused"),
    (["slosh"], [], ["others", "consistent"], row("consistent"), "wrong"),
    (["slosh+gyro_bias"], [], ["others"], row("dominant", named("slosh")), "refused"),
    (["slosh+gyro_bias"], [], ["others"], row("dominant", named("gyro_bias"), named("slosh")), "right"),
    (["control_loss+control_loss"], [], ["others"], row("explained", named("control_loss")), "refused"),
    (["actuator_delay/actuator_bandwidth"], [], ["others"], row("explained", named("actuator_bandwidth")), "right"),
    (["missing_term(sin(theta))"], [], ["others"], row("dominant", SIN), "right"),
    (["missing_term"], [], ["others"], row("dominant", SIN), "right"),
    (["missing_term(beta^2)"], [], ["others"], row("dominant", SIN), "wrong"),
    (["unexplained"], [], ["others"], row("unexplained"), "right"),
    (["unexplained"], [], ["others"], row("unexplained", where="sensor", places=["sensor"]), "right"),
    (["unexplained"], [], ["others"], row("unexplained", where="plant", places=["sensor"]), "refused"),
    (["consistent"], [], ["others", "unexplained"], row("unexplained"), "wrong"),              # a false alarm
    (["anything"], ["friction"], ["others"], row("dominant", named("friction")), "right"),
    (["anything"], [], ["gust"], row("dominant", named("friction")), "right"),
    (["anything"], [], ["gust"], row("dominant", named("gust")), "wrong"),
    (["anything"], [], ["others", "consistent"], row("bad-data"), "right"),
    (["slosh"], [], ["others"], row("refused"), "refused"),
    (["anything"], [], ["others"], row("crashed"), "wrong")])
def test_an_answer_is_right_wrong_or_refused(bench, accepted, beside, never, answer, expected):
    assert bench[0].outcome(case(bench, accepted, beside, never), answer) == expected


def test_sizes_are_as_far_as_their_range_is_and_of_right_names_alone(bench):
    labels = bench[0]
    known = case(bench, ["slosh"], sizes={"slosh.coupling": (0.1, 0.2)})
    far = row("dominant", named("slosh", coupling=[0.3, 0.01]), named("gust", angle=[1.0, 0.1]))
    assert list(labels.sizes(known, far)) == [("slosh.coupling", pytest.approx(0.1), 0.01)]
    assert list(labels.sizes(known, row("dominant", named("slosh", coupling=[0.15, None])))) == [
        ("slosh.coupling", 0.0, 0.0)]
    flown = row("explained", named("gust", angle=[0.5, 0.1]), truth={"gust.angle": 0.2})
    assert list(labels.sizes(case(bench, ["gust"]), flown)) == [("gust.angle", pytest.approx(0.3), 0.1)]
    assert list(labels.sizes(known, row("unexplained", named("slosh", coupling=[0.3, 0.01])))) == []


# ---- sources


def test_a_placebo_moves_the_input_and_nothing_else(bench):
    log = read_log("dfki_pendulum_dircol")
    moved = bench[1].shifted(log, 0.41)
    at = round(0.41 * len(log.t))
    assert np.array_equal(np.roll(log.beta, at), moved.beta) and np.array_equal(np.roll(log.beta_cmd, at),
                                                                                moved.beta_cmd)
    assert moved.theta is log.theta and moved.theta_dot is log.theta_dot and moved.t is log.t


# ---- the command


def options(**given):
    return argparse.Namespace(**{"groups": None, "kinds": None, "cases": None, "tenth": False, "judge": False,
                                 "folder": [], "jobs": 1} | given)


def test_the_judges_run_on_demand_alone(bench):
    chosen = bench[2].chosen
    assert not JUDGES & {case.source[1] for case in chosen(CASES, options())}
    assert {case.source[1] for case in chosen(CASES, options(judge=True, kinds=["measured"]))} >= JUDGES
    assert chosen(CASES, options(tenth=True)) == TENTH
