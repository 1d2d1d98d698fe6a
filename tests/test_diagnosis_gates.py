"""Every gate between what the search found and what the verdict says, one by one, on constructed findings: what is just
inside passes, what is just outside does not."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sim.diagnosis import verdict
from sim.diagnosis.causes import RECORDS, Cause, missing_term
from sim.diagnosis.controller.kind import DELAY, FILTER, GAIN, NONE, UNKNOWN, ControllerCheck
from sim.diagnosis.data.fault import Fault
from sim.diagnosis.judge.constancy import CONSTANCY_LIMIT, SEGMENTS, Constancy
from sim.diagnosis.judge.diagnosis import Diagnosis
from sim.diagnosis.judge.gain import Gain
from sim.diagnosis.judge.leftover import Leftover
from sim.diagnosis.judge.named import Named, _groups, _rivals, doubts_about
from sim.diagnosis.model.noise import Disturbance
from sim.diagnosis.search import selection

BEGAN, ENDED = 0.0, 45.0   # s


def same(chi_squared):
    """A size over the log."""
    return Constancy(chi_squared, (0.0,) * 9, (1.0,) * 8, (0.1,) * 8)


def cause(name="slosh", evidence=100.0, chi_squared=7.0, **given):
    return Named(name, {}, {}, {}, (), evidence, same(chi_squared), **given)


def left(gain, place="plant", shape="", at_mode=False):
    return Leftover(Disturbance(place, 1.0, 1.0), gain, shape, at_mode)


def doubts(*named, left=()):
    return doubts_about(named, left, BEGAN, ENDED)


# ---- a size that changes


def test_a_size_that_is_not_the_same_all_along_is_doubted():
    assert doubts(cause(chi_squared=CONSTANCY_LIMIT)) == []
    said, = doubts(cause(chi_squared=CONSTANCY_LIMIT + 1.0))
    assert said.startswith("slosh: its size is not the same") and f"over {SEGMENTS} segments" in said
    assert doubts(cause(chi_squared=31.0)) == [] and doubts(cause(chi_squared=47.0))   # seen: a true one, a foreign one
    assert len(doubts(cause(chi_squared=99.0), cause("gust", chi_squared=99.0))) == 2
    assert doubts(replace(cause(), constancy=None)) == []  # the controller's is exact


# ---- what is left


@pytest.mark.parametrize(("shape", "at_mode"), [("", False), ("theta^2", False), ("u*time", False), ("sin(3 t)", False),
                                                ("sin(3 t)", True)])
def test_more_than_may_be_left_is_doubted(shape, at_mode):
    limit = left(0.0, shape=shape, at_mode=at_mode).limit
    assert doubts(left=(left(limit, shape=shape, at_mode=at_mode),)) == []
    said, = doubts(left=(left(limit + 0.1, shape=shape, at_mode=at_mode),))
    assert f"(limit {limit:.0f})" in said and (shape or "unknown shape") in said


def test_a_hundredth_of_what_a_place_s_causes_explain_may_be_left_there():
    large = cause(evidence=2000.0)
    assert doubts(large, left=(left(19.9),)) == []
    assert doubts(large, left=(left(20.1),))
    assert doubts(large, cause("bending", evidence=1000.0), left=(left(29.9),)) == []
    assert doubts(cause("gyro_bias", evidence=2000.0), left=(left(19.9),))   # another place
    assert doubts(cause("gyro_bias", evidence=2000.0), left=(left(19.9, "theta"),)) == []  # any sensor's is theirs


def test_only_the_first_that_is_too_much_is_said():
    assert len(doubts(left=(left(9.0), left(30.0, "beta"), left(20.0)))) == 1


# ---- what the log does not determine


def undetermined(name, at_an_end=False, **values):
    """Doubts about a cause with these (value, std)."""
    each = Named(name, {key: value for key, (value, _) in values.items()}, {key: std for key, (_, std) in
                                                                           values.items()}, {}, (), 100.0, None,
                 at_an_end)
    return doubts(each)


@pytest.mark.parametrize(("inside", "outside", "said"), [
    (("control_loss", {"time": (0.61, 0.2)}), ("control_loss", {"time": (0.59, 0.2)}), "its onset"),
    (("slosh", {"frequency": (4.0, 1.99)}), ("slosh", {"frequency": (4.0, 2.01)}), "its frequency"),
    (("bending", {"frequency": (4.0, 1.99)}), ("bending", {"frequency": (4.0, 2.01)}), "its frequency"),
    (("periodic_disturbance", {"frequency": (0.28, 0.01)}), ("periodic_disturbance", {"frequency": (0.27, 0.01)}),
     "less than 2 of its periods"),
    (("slosh", {"frequency": (0.27, 0.01)}), ("slosh", {"frequency": (0.27, 0.14)}), "its frequency"),
    (("gust", {"time": (0.1, 0.2)}), ("gust", {"time": (0.1, 0.2), "at_an_end": True}), "end of the range")])
def test_what_the_log_does_not_tell_is_doubted(inside, outside, said):
    assert undetermined(inside[0], **inside[1]) == []
    doubt, = undetermined(outside[0], **outside[1])
    assert said in doubt and doubt.startswith(f"{outside[0]}: ")


def test_an_onset_is_judged_from_the_log_s_own_beginning(judged):
    each = Named("control_loss", {"time": 20000.5}, {"time": 0.2}, {}, (), 100.0, None)
    assert doubts_about((each,), (), 20000.0, 20045.0) and not doubts_about((each,), (), 19999.0, 20045.0)
    line = Named("periodic_disturbance", {"frequency": 0.27}, {"frequency": 0.01}, {}, (), 100.0, None)
    assert doubts_about((line,), (), 20000.0, 20045.0) and not doubts_about((line,), (), 20000.0, 20050.0)
    assert judged(Found(each), shift=20000.0).made.doubts and not judged(Found(each), shift=19999.0).made.doubts


# ---- look-alikes and steps


def ranked(*pairs):
    return [selection.Ranked(Cause(RECORDS[name], ()), evidence) for name, evidence in pairs]


def test_look_alikes_are_those_that_explain_the_log_as_well():
    ranking = ranked(("gust", 50.0), ("slosh", 50.0 - selection.TOLD_APART + 0.1), ("friction", 50.0),
                     ("bending", 50.0 - selection.TOLD_APART - 0.1), ("slosh", 49.0))
    assert _rivals("gust", ranking) == ("slosh", "friction")
    assert _rivals("aero_damping", ranked(("gust", 54.1), ("slosh", 50.0))) == ("gust",)  # from the best, not its own
    assert _rivals("aero_damping", ranked(("aero_damping", 50.0), ("gust", 51.0), ("slosh", 56.0))) == ("slosh",)
    assert _rivals("gust", []) == ()


def test_losses_that_come_soon_after_one_another_and_the_same_way_are_one():
    def grouped(*values):
        losses = [Cause(RECORDS["control_loss"], value) for value in values]
        return list(_groups(SimpleNamespace(causes=[*losses, Cause(RECORDS["gust"], (0.1, 20.0, 1.0))])))

    near = RECORDS["control_loss"].steps.near
    assert grouped((0.1, 20.0), (0.1, 20.0 + near)) == [[0, 1], [2]]
    assert grouped((0.1, 20.0 + near), (0.1, 20.0)) == [[1, 0], [2]]
    assert grouped((0.1, 20.0), (0.1, 20.1 + near)) == [[0], [1], [2]]
    assert grouped((0.1, 20.0), (-0.1, 21.0)) == [[0], [1], [2]]
    assert grouped((0.1, 20.0), (0.1, 22.0), (0.1, 24.0)) == [[0, 1, 2], [3]]   # from step to step
    other = replace(RECORDS["gust"], steps=RECORDS["control_loss"].steps)
    two = (Cause(RECORDS["control_loss"], (0.1, 20.0)), Cause(other, (0.1, 20.5)))
    assert list(_groups(SimpleNamespace(causes=two))) == [[0], [1]]   # another cause that may be gradual


def test_a_further_cause_needs_more_than_the_first_and_never_less_than_the_threshold():
    assert [selection.needed(12.0, causes) for causes in (0, 1, 2)] == [12.0, selection.FURTHER, selection.FURTHER]
    assert selection.needed(40.0, 0) == selection.needed(40.0, 1) == 40.0


def test_what_may_join_which_causes():
    known = tuple(RECORDS[name] for name in ("gust", "gyro_bias", "actuator_delay", "actuator_bandwidth"))

    def joining(*present):
        return [each.cause for each in selection._allowed(known, present)]

    delay, lag = RECORDS["actuator_delay"], RECORDS["actuator_delay"].form.hypothesis
    assert joining(Cause(RECORDS["gust"], ()), Cause(RECORDS["gyro_bias"], ())) == \
        ["gust", "actuator_delay", "actuator_bandwidth"]
    assert joining(Cause(delay, ())) == ["gust", "gyro_bias", "actuator_bandwidth"]
    assert joining(Cause(lag, ())) == ["gust", "gyro_bias", "actuator_delay"]   # in whichever form
    terms = (missing_term("theta^2"), missing_term("theta^3"))
    assert selection._allowed(terms, (Cause(terms[0], ()),)) == [terms[1]]


# ---- the verdict


class Found:
    """A selection whose parts are given: the causes it names, what is left beside them, what they gain."""

    def __init__(self, *named, left=(), nats=50.0, log_likelihood=0.0):
        self.named, self.nats = named, nats
        alone = tuple(left) if left and not named else (left_at("plant", 5.0),)
        self.nominal = SimpleNamespace(causes=(), log_likelihood=0.0, left=alone)
        self.model = SimpleNamespace(causes=named, log_likelihood=log_likelihood, left=tuple(left)) if named else \
            self.nominal


def left_at(place, gain):
    return Leftover(Disturbance(place, 1.0, 1.0), gain)


@pytest.fixture
def judged(monkeypatch):
    """The verdict on a `Found`, and of how many selections the gain was measured."""
    monkeypatch.setattr(verdict, "named_causes", lambda found: found.named)
    monkeypatch.setattr(verdict, "leftovers", lambda model: list(model.left))
    monkeypatch.setattr(verdict, "extended", lambda *given: "extended")
    monkeypatch.setattr(verdict, "user_gain", lambda *given: None)

    def judge(found, controller=None, terms=None, catalogue=True, slow=False, shift=0.0):
        asked, measured = [], []
        monkeypatch.setattr(verdict, "propose", lambda *given: asked.append(1) or terms)
        made = Diagnosis(None, None, None, catalogue=catalogue, controller=controller, selection=found)
        made.record = SimpleNamespace(t=np.array([BEGAN, ENDED]), shift=shift, every=2 if slow else 1, tick=1,
                                      input="beta_cmd", nominal=SimpleNamespace(controller=True))

        def measure(of):
            measured.append(of)
            return Gain((0.0, 0.0), of.nats, {}, None, "here")

        verdict._judge(made, measure, lambda text: None)
        return SimpleNamespace(made=made, asked=len(asked), measured=measured)

    return judge


def test_nothing_found_and_nothing_left_is_consistent(judged):
    each = judged(Found())
    assert (each.made.verdict, each.made.where, each.made.causes, each.made.gain) == ("consistent", None, (), None)
    assert each.measured == [] and each.made.extension is None


def test_causes_that_pass_every_test_explain_the_strongest_first(judged):
    weak, strong = cause("gyro_bias", 30.0), cause("slosh", 90.0)
    each = judged(Found(weak, strong))
    assert (each.made.verdict, each.made.where, each.made.causes) == ("explained", "plant", (strong, weak))
    assert each.made.nearest == () and each.made.extension == "extended" and len(each.measured) == 1


@pytest.mark.parametrize("nats", [0.0, -3.0, math.nan, -math.inf])
def test_causes_that_gain_nothing_on_data_left_out_are_not_believed(judged, nats):
    each = judged(Found(cause("gyro_bias"), nats=nats))
    assert (each.made.verdict, each.made.causes) == ("unexplained", ()) and each.made.extension is None
    assert len(each.made.doubts) == 1 and "data left out" in each.made.doubts[0]
    assert [near.cause for near in each.made.nearest] == ["gyro_bias"] and len(each.measured) == 1
    assert judged(Found(cause("gyro_bias"), nats=0.1)).made.verdict == "explained"


@pytest.mark.parametrize("found", [
    Found(cause("gyro_bias", chi_squared=CONSTANCY_LIMIT + 1.0)),
    Found(cause("gyro_bias"), left=[left(11.0)]),
    Found(cause("gyro_bias", is_at_an_end=True)),
    Found(left=[left(11.0, "theta")])])
def test_any_doubt_makes_it_unexplained_and_keeps_what_comes_nearest(judged, found):
    each = judged(found)
    assert each.made.verdict == "unexplained" and len(each.made.doubts) == 1 and each.made.causes == ()
    assert each.made.nearest == found.named
    assert len(each.measured) == len(found.named)   # the nearest's gain is shown all the same
    found.nats = -1.0
    assert len(judged(found).made.doubts) == 1   # but no second doubt


# ---- where it is


def test_the_place_is_where_a_disturbance_helps_the_nominal_most_or_the_nearest_cause_more(judged):
    found = Found(cause("gyro_bias", 30.0, 99.0))
    for gains, place in (({"beta": 31.0, "actuator": 20.0}, "sensor"), ({"actuator": 31.0, "beta": 20.0}, "actuator"),
                         ({"actuator": 29.0}, "sensor")):
        found.nominal.left = tuple(left_at(*each) for each in gains.items())
        assert judged(found).made.where == place
    found.nominal.left = (left(99.0, shape="sin(3 t)"), left_at("actuator", 31.0))   # a line tells no place
    assert judged(found).made.where == "actuator"


# ---- the controller


def controlled(kind, evidence=200.0, **given):
    return ControllerCheck(kind, 1e-3, 1e-5, evidence=evidence, **given)


@pytest.mark.parametrize("kind", [UNKNOWN, FILTER])
def test_a_foreign_controller_is_unexplained_whatever_else_was_found(judged, kind):
    each = judged(Found(cause("gyro_bias")), controlled(kind, time_constant=0.08 if kind == FILTER else None))
    assert (each.made.verdict, each.made.where, each.made.causes) == ("unexplained", "controller", ())
    assert "not the nominal controller's" in each.made.doubts[-1]
    assert ("0.08 s" in each.made.doubts[-1]) == (kind == FILTER)
    assert each.asked == 0   # no term of the plant is sought for it


@pytest.mark.parametrize("kind", [GAIN, DELAY, f"{GAIN} and {DELAY} and {FILTER}"])
def test_other_gains_and_computing_time_are_a_cause_beside_the_others(judged, kind):
    each = judged(Found(cause("gyro_bias")), controlled(kind, kp_scale=1.1))
    assert [(every.cause, every.where) for every in each.made.causes] == [
        ("controller_mismatch", "controller"), ("gyro_bias", "sensor")]
    assert each.made.where == "controller" and len(each.measured) == 1
    alone = judged(Found(), controlled(kind))
    assert alone.made.verdict == "explained" and len(alone.measured) == 1 and alone.made.causes[0].constancy is None


def test_the_nominal_s_own_controller_is_no_cause(judged):
    assert judged(Found(), controlled(NONE)).made.verdict == "consistent"


def test_a_slow_log_lacks_an_unknown_controller_s_commands_which_seems_the_actuator_s_fault(judged):
    found = Found()
    for evidence, place, slow, where in (
            (200.0, "plant", True, "controller"), (50.0, "plant", True, "plant"),
            (50.0, "actuator", True, "controller"), (50.0, "plant", False, "controller")):
        found.nominal.left = (left_at(place, 90.0),)
        each = judged(found, controlled(UNKNOWN, evidence), slow=slow)
        assert (each.made.where, each.asked) == (where, 0)   # and no term of the plant is sought beside it


# ---- missing terms


def term(nats=40.0, log_likelihood=0.0, **given):
    each = Named("missing_term", {"term": "theta^2"}, {}, {}, (), 60.0, same(given.pop("chi_squared", 7.0)))
    return "missing: +1 theta^2", Found(each, nats=nats, log_likelihood=log_likelihood, **given)


DOUBTED = Found(cause("slosh", chi_squared=99.0))


def test_missing_terms_that_pass_every_test_stand_for_doubted_causes(judged):
    each = judged(DOUBTED, terms=term())
    assert (each.made.verdict, each.made.causes[0].label) == ("explained", "missing_term theta^2")
    assert each.made.selection is not DOUBTED and each.made.gain.nats == 40.0


@pytest.mark.parametrize("terms", [
    None, term(nats=-1.0), term(chi_squared=99.0), term(left=[left(11.0)]),
    term(log_likelihood=-verdict.TERM_MARGIN - 0.1)])
def test_missing_terms_with_a_doubt_of_their_own_or_far_behind_are_a_proposal(judged, terms):
    each = judged(DOUBTED, terms=terms)
    assert (each.made.verdict, each.made.nearest, each.asked) == ("unexplained", DOUBTED.named, 1)
    assert each.made.selection is DOUBTED and "its size" in each.made.doubts[0]
    assert each.made.left == () and each.made.gain.nats == DOUBTED.nats
    assert each.made.proposal == (None if terms is None else terms[0])


def test_missing_terms_may_be_a_little_behind(judged):
    assert judged(DOUBTED, terms=term(log_likelihood=-verdict.TERM_MARGIN + 0.1)).made.verdict == "explained"


def test_missing_terms_are_sought_for_doubts_in_plant_or_environment_and_with_the_whole_catalogue(judged):
    assert judged(Found(cause("gust", chi_squared=99.0)), terms=term()).asked == 1
    assert judged(Found(cause("gyro_bias", chi_squared=99.0)), terms=term()).asked == 0
    assert judged(DOUBTED, terms=term(), catalogue=False).asked == 0
    assert judged(Found(cause()), terms=term()).asked == 0


# ---- before and after


@pytest.mark.parametrize(("kinds", "rest"), [(("spike",), True), (("stamps", "range", "stale", "dropout"), True),
                                             (("unit",), False), (("spike", "sign"), False), (("swapped",), False)])
def test_faults_of_rows_are_masked_and_faults_of_columns_are_not(monkeypatch, kinds, rest):
    faults = tuple(Fault(kind, "theta", 0.0, 1.0, 1, kind) for kind in kinds)
    monkeypatch.setattr(verdict, "check", lambda *given: SimpleNamespace(is_bad=True, faults=faults))
    examined = []
    monkeypatch.setattr(verdict, "_refuse_foreign", lambda *given: None)
    monkeypatch.setattr(verdict, "_examined", lambda made, *given: examined.append(made))
    made = verdict.diagnose(None, None)
    assert (made.verdict, made.where, made.causes) == ("bad-data", "data", ()) and len(examined) == rest
    assert (made.beneath is not None) == rest


def test_too_few_rows_are_not_searched(monkeypatch):
    for rows, searched in ((verdict.FEWEST_ROWS - 1, False), (verdict.FEWEST_ROWS, True)):
        record = SimpleNamespace(rows=rows)
        monkeypatch.setattr(verdict, "record", lambda *given, record=record: record)
        found: list[int] = []
        monkeypatch.setattr(verdict, "with_commands", lambda r, model: (r, None))
        monkeypatch.setattr(verdict, "select", lambda *given, found=found: found.append(1) or Found())
        monkeypatch.setattr(verdict, "_judge", lambda *given: None)
        monkeypatch.setattr(verdict, "limits", lambda *given: ([], None))
        monkeypatch.setattr(verdict, "noise_of", lambda model: {})
        made = verdict._examined(Diagnosis(None, None, None), None, 0, None, lambda text: None)
        assert (len(found) == 1) == searched
        assert searched or (made.verdict == "consistent" and {each.size for each in made.limits} == {None})


def test_a_measured_threshold_is_the_one_of_search_and_limits(monkeypatch):
    taken = []
    monkeypatch.setattr(verdict, "record", lambda *given: SimpleNamespace(rows=verdict.FEWEST_ROWS))
    monkeypatch.setattr(verdict, "with_commands", lambda r, model: (r, None))
    monkeypatch.setattr(verdict, "measured_threshold", lambda r, flights, say: 9.0 + flights)
    monkeypatch.setattr(verdict, "select", lambda r, threshold, *given: taken.append(threshold) or Found())
    monkeypatch.setattr(verdict, "_judge", lambda *given: None)
    monkeypatch.setattr(verdict, "limits", lambda r, model, threshold: taken.append(threshold) or ([], None))
    monkeypatch.setattr(verdict, "noise_of", lambda model: {})
    for bootstrap, threshold in ((0, 12.0), (1, 10.0)):
        made = verdict._examined(Diagnosis(None, None, None), None, bootstrap, None, lambda text: None)
        assert made.threshold == threshold and taken[-2:] == [threshold] * 2


def test_a_second_log_is_read_once_and_when_it_is_asked_for(monkeypatch):
    read = []
    monkeypatch.setattr(verdict, "check", lambda log, nominal: read.append(log))
    monkeypatch.setattr(verdict, "record", lambda *given: "record")
    monkeypatch.setattr(verdict, "with_commands", lambda r, model: (r, None))
    monkeypatch.setattr(verdict, "on_another", lambda r, model, nominal, controller: r)
    measure = verdict._measure(Diagnosis(None, None, None), "second log")
    assert read == []
    assert [measure(Found()) for _ in range(3)] == ["record"] * 3 and read == ["second log"]
