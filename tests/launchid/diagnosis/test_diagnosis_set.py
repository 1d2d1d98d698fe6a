"""The labelled set of the diagnosis: the answers of a tenth of it, and the laws of how it is read, judged and compared.

All of it: `python benchmarks/diagnosis_set.py`.
"""

import argparse
import dataclasses
import importlib
import json
from pathlib import Path

import numpy as np
import pytest
from hidden import LISTED, OTHER, PLAIN, UNLISTED

from launchid.log.log import measured_logs, read_log
from sim.nominal import BUILT_IN, STANDS

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
    assert all(case.nominal in STANDS or case.nominal in NOMINALS for case in measured.values())


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


@pytest.mark.parametrize(("line", "said"), [
    ('name = "a", seed = 1', "expected one of hidden"), ('name = "a", hidden = "", seed = 1', "accepted answers"),
    ('name = "a", hidden = "slosh", accepted = ["slush"]', "slush: no cause"),
    ('name = "a", hidden = "slosh", never = ["slush"]', "slush: no cause"),
    ('name = "a", hidden = "slosh", sead = 1', "sead: no cause, no verdict and no option"),
    ('name = "a", hidden = "slosh", part = "mine"', "a part out of"),
    ('name = "a", hidden = "slosh"}, {name = "a", hidden = "slosh"', "a name of its own")])
def test_a_case_that_is_wrong_is_refused_by_its_name(bench, tmp_path, line, said):
    path = tmp_path / "set.toml"
    path.write_text(f'[nominals]\n[groups.g]\nkind = "k"\nnominal = "constant"\ncases = [{{{line}}}]\n')
    with pytest.raises(ValueError, match=said) as refused:
        bench[0].read_set(path)
    assert "g/a" in str(refused.value)


def test_fresh_flights_are_of_the_same_kinds_with_seeds_of_their_own(bench):
    drawn = bench[2].fresh(CASES, 90_000, 40)
    assert [case.options["seed"] for case in drawn] == list(range(90_000, 90_040))
    assert {case.options["rate"] for case in drawn} == {25.0, 50.0, 100.0, 200.0}
    assert {"listed", "unlisted", "pairs", "clean", "clean-windy", "dropped"} <= {case.group for case in drawn}


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


def test_a_name_of_the_input_is_known_by_place_cause_or_term(bench):
    of_input = bench[0].is_of_input
    assert of_input(named("actuator_delay", where="actuator")) and of_input(named("control_loss"))
    assert of_input(named("missing_term", term="beta^2")) and not of_input(SIN)


# ---- sources


def test_a_placebo_moves_the_input_and_nothing_else(bench):
    log = read_log("dfki_pendulum_dircol")
    moved = bench[1].shifted(log, 0.41)
    at = round(0.41 * len(log.t))
    assert np.array_equal(np.roll(log.beta, at), moved.beta) and np.array_equal(np.roll(log.beta_cmd, at),
                                                                                moved.beta_cmd)
    assert moved.theta is log.theta and moved.theta_dot is log.theta_dot and moved.t is log.t


def test_an_input_taken_as_a_command_is_the_same_input(bench):
    log = read_log("bam_xl330_kp200_sin_time_square")
    command = bench[1].as_command(log)
    assert np.isnan(command.beta).all() and command.beta_cmd is log.beta and "beta_cmd" in command.columns


def test_a_case_s_log_is_the_same_whenever_it_is_asked_for_and_has_no_dropped_column(bench):
    case = next(case for case in CASES if case.options.get("drop") and case.source[0] == "simulated")
    one, two = (bench[1].material(case, NOMINALS) for _ in range(2))
    assert np.array_equal(one.log.theta_dot, two.log.theta_dot, equal_nan=True)
    assert not set(case.options["drop"]) & set(one.log.columns)


def test_the_truth_of_a_flight_is_the_generator_s(bench):
    case = next(case for case in CASES if case.name == "listed/gyro_bias-1")
    there = bench[1].material(case, NOMINALS)
    assert set(there.truth) == {"gyro_bias.rate"} and abs(there.truth["gyro_bias.rate"]) == pytest.approx(2e-4)
    assert there.places == ("sensor",)


def test_what_is_not_here_is_said(bench, tmp_path):
    case = next(case for case in CASES if case.source == ("log", "ubc_tvc"))
    answer = bench[2].answered(case, NOMINALS, (tmp_path,), "")
    assert "ubc_tvc.csv is in none of the folders" in answer["absent"] and "verdict" not in answer


# ---- the command


def options(**given):
    return argparse.Namespace(**{"groups": None, "kinds": None, "cases": None, "tenth": False, "judge": False,
                                 "folder": [], "jobs": 1} | given)


def test_the_judges_run_on_demand_alone(bench):
    chosen = bench[2].chosen
    assert not JUDGES & {case.source[1] for case in chosen(CASES, options())}
    assert {case.source[1] for case in chosen(CASES, options(judge=True, kinds=["measured"]))} >= JUDGES
    assert chosen(CASES, options(tenth=True)) == TENTH


@pytest.fixture
def counted(bench, monkeypatch):
    """The command with a diagnosis that takes no time: the cases it was asked."""
    command, calls = bench[2], []

    def answered(case, nominals, folders, sources):
        calls.append(case.name)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return row("consistent", case=case.name, sources=sources, asked=command.asked(case, nominals))

    monkeypatch.setattr(command, "answered", answered)
    monkeypatch.setattr(command, "warmed", lambda: None)
    return command, calls


def test_an_interrupted_run_keeps_what_it_has_and_goes_on(counted, tmp_path, capsys):
    command, calls = counted
    cases, path = [case for case in CASES if case.group == "clean"][:5], tmp_path / "new" / "a.jsonl"
    first = command.run(cases, NOMINALS, options(), path)
    assert len(first) == 2 and "goes on" in capsys.readouterr().err
    path.write_text(path.read_text() + '{"case": "clean/9", "verd')  # a line that was cut off
    again = command.run(cases, NOMINALS, options(), path)
    assert [each["case"] for each in again] == [case.name for case in cases]
    assert sorted(set(calls)) == sorted(case.name for case in cases) and len(calls) == 6


def test_an_answer_is_asked_again_where_sources_or_the_case_differ_and_not_where_its_label_does(
        counted, tmp_path, monkeypatch):
    command, calls = counted
    calls += ["", "", ""]
    case, path = CASES[0], tmp_path / "a.jsonl"
    command.run([case], NOMINALS, options(), path)
    command.run([dataclasses.replace(case, accepted=("slosh",), words="other")], NOMINALS, options(), path)
    assert calls[3:] == [case.name]
    command.run([dataclasses.replace(case, options=case.options | {"seed": 1})], NOMINALS, options(), path)
    monkeypatch.setattr(command, "sources_now", lambda: "others")
    command.run([case], NOMINALS, options(), path)
    assert calls[3:] == [case.name] * 3


def test_the_table_counts_by_group_and_by_kind(bench):
    cases = [case(bench, ["slosh"])] * 4
    cases = [dataclasses.replace(each, name=f"{group}/{k}", group=group, kind="k")
             for k, (each, group) in enumerate(zip(cases, ("g", "g", "h", "h"), strict=True))]
    answers = [row("explained", named("slosh", coupling=[0.2, 0.01]), truth={"slosh.coupling": 0.21}, seconds=2.0),
               row("explained", named("slosh", coupling=[0.2, 0.01]), truth={"slosh.coupling": 0.9}, seconds=4.0),
               row("explained", named("gust")), row("unexplained")]
    rows = [each | {"case": of.name} for each, of in zip(answers, cases, strict=True)]
    lines = {line.split()[0]: line.split()[1:] for line in bench[2].table(cases, [rows])[1:]}
    assert lines["g"] == ["2", "2", "0", "0", "1", "/", "2", "0.50", "3.0", "3.8"]
    assert lines["h"][:4] == ["2", "0", "1", "1"] and lines["k"][:4] == ["4", "2", "1", "1"]
    assert lines["all"][:4] == ["4", "2", "1", "1"]
    listed = list(bench[2].not_right(cases, rows))
    assert len(listed) == 2 and "WRONG gust" in listed[0] and listed[1].startswith("refused h/3: unexplained")


def test_a_comparison_says_what_got_worse_and_better(bench):
    cases = [dataclasses.replace(case(bench, ["slosh"]), name=f"g/{k}") for k in range(5)]
    right, wrong, none = row("explained", named("slosh")), row("explained", named("gust")), row("unexplained")
    other = row("dominant", named("slosh"))

    def run(*answers):
        return [each | {"case": f"g/{k}"} for k, each in enumerate(answers)]

    lines, is_worse = bench[2].compared(cases, run(right, none, none, right), run(none, wrong, right, other, right))
    text = "\n".join(lines)
    assert is_worse and "worse: 2" in text and "better: 1" in text and "other words: 1" in text
    assert "g/0: right explained: slosh  ->  refused unexplained" in text and "only after: g/4" in text
    assert not bench[2].compared(cases, run(none), run(right))[1]


def test_rows_are_json_that_reads_back(bench, tmp_path):
    path = tmp_path / "a.jsonl"
    path.write_text(json.dumps(row("consistent")) + "\n" + json.dumps(row("unexplained")) + "\n")
    assert [each["verdict"] for each in bench[2].read_rows(path)] == ["unexplained"]  # the last answer of a case counts
    assert bench[2].read_rows(tmp_path / "none.jsonl") == []


def test_answers_to_what_a_case_does_not_ask_any_more_are_left_out_and_said(bench, tmp_path, capsys):
    command, (one, other) = bench[2], CASES[:2]
    path = tmp_path / "a.jsonl"
    rows = [row("consistent", case=each.name, asked=command.asked(each, NOMINALS)) for each in (one, other)]
    rows[1]["asked"] = "another"
    path.write_text("\n".join(map(json.dumps, rows)))
    assert [each["case"] for each in command.still_asked(CASES, NOMINALS, path)] == [one.name]
    assert f"another one now: {other.name}" in capsys.readouterr().out
