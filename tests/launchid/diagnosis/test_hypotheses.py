"""A stranger's log is judged by hypotheses, each with its own noise: laws of the search, and what a column shows."""

from dataclasses import replace

import numpy as np
import pytest

from launchid.diagnosis.adapter import read
from launchid.diagnosis.answer import report
from launchid.diagnosis.dissipation import same_energy
from launchid.diagnosis.hypotheses import Hypotheses, won
from launchid.diagnosis.model import Model
from launchid.diagnosis.numbers import FORM, KINEMATIC
from launchid.diagnosis.start import everything
from launchid.diagnosis.stranger import errors_left
from launchid.diagnosis.verdict import diagnose


def searched(log, nominal):
    m = Model.of(read(log, nominal).track)
    notes = frozenset(m.table.index(x) for x in (*KINEMATIC, *FORM) if x in m.table)
    return Hypotheses(*everything(m), notes)


@pytest.fixture(scope="module")
def found(strangers):
    return searched(*strangers.made("drone", "k1", 9001))


def test_more_freedom_is_never_less_likely(found):
    """Each hypothesis is inside everything free, and holds the nominal: the search finds no worse optimum."""
    assert all(one.value > found.nominal.value - 0.5 for one in found.alone.values())
    assert all(one.value < found.full.value + 0.5 for one in found.alone.values())


def test_what_one_hypothesis_wins_the_other_loses(found):
    one = max(found.alone.values(), key=lambda each: each.value)
    there, back = won(one, found.nominal), won(found.nominal, one)
    assert there.nats == -back.nats > 0.0
    assert np.isclose(np.sum(found.nominal.losses() - one.losses()), there.nats, atol=0.1 * there.nats + 2.0)
    assert errors_left(one, one, []) == 1.0 and errors_left(one, found.nominal, []) < 1.0


def test_the_noise_of_a_wrong_nominal_is_louder_than_that_of_the_right_number(found):
    """What the number explains is no noise: else the nominal would hide it."""
    k1 = next(one for group, one in found.alone.items() if group.name == "k1")
    moves = found.nominal.m.levels - k1.m.levels
    assert moves[found.nominal.m.noise.moves].sum() > 0.0


def test_what_is_likelier_and_predicts_no_better_is_no_cause_and_not_consistent(strangers):
    """A robot's input is 15 ms late, in a loop that hides it: the log shows it, and nothing is the better for it."""
    answer = report(diagnose(*strangers.made("robot", "late", 9532)))
    assert answer["verdict"] == "unexplained" and not answer["causes"]
    assert any("delay" in words for words in answer["doubts"])


@pytest.mark.parametrize("kind", ["drone", "bench"])
def test_a_column_of_the_other_sign_is_said_and_no_cause_is_named(strangers, kind):
    log, nominal = strangers.made(kind, "", 9015)
    turned = replace(log, beta=-log.beta, beta_cmd=-log.beta_cmd)
    answer = report(diagnose(turned, nominal))
    assert answer["verdict"] == "bad-data" and not answer["causes"], answer["doubts"]
    assert "sign" in [fault["kind"] for fault in answer["data"]["faults"]]


@pytest.mark.parametrize(("wrong", "is_same"), [("", True), ("friction", False), ("own damping", False)])
def test_damping_and_friction_are_judged_by_the_energy_that_they_take(strangers, wrong, is_same):
    """The stand's nominal has the damping and friction that a regression gives: their energy is the body's, if not each
    of them; with one of them wrong it is not."""
    assert (same_energy(searched(*strangers.made("stand", wrong, 9062))) is not None) == is_same
