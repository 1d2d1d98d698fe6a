"""The diagnosis anew: what is hidden in a flight is named, what is not there is not, and the laws of its parts."""

import json

import numpy as np
import pytest
from hidden import draw_spec, fly

from launchid.diagnosis.adapter import read
from launchid.diagnosis.answer import lines, report
from launchid.diagnosis.candidates import CANDIDATE_KINDS, usual
from launchid.diagnosis.estimate import fit_levels
from launchid.diagnosis.model import Model
from launchid.diagnosis.verdict import diagnose
from launchid.log.log import log_of_values
from sim.effects import CATALOGUE
from sim.nominal import load_nominal

LONG = pytest.mark.campaign


def hidden(causes, seed, nominal="constant", factor=2.0, **given):
    """(log, truth) of a flight of the independent generator."""
    columns, label = fly(draw_spec(seed, causes, nominal, factor, **({"duration": 45.0, "rate": 100.0} | given)))
    return log_of_values("log.csv", columns), label


@pytest.fixture(scope="module")
def clean():
    """The model of a flight with nothing hidden."""
    log, _ = hidden(None, 71001, duration=30.0)
    m = Model(read(log, load_nominal("constant")).track)
    m.with_numbers(usual(m), [])
    return m


# ---- the answer with a known truth


def test_the_answer_is_the_contracts():
    log, label = hidden(("gyro_bias",), 71007, factor=4.0, duration=20.0)
    result = diagnose(log, load_nominal("constant"))
    answer = json.loads(json.dumps(report(result), allow_nan=False))
    assert {"verdict", "where", "causes", "noise", "limits", "gain", "either", "data", "remainder"} <= set(answer)
    cause = answer["causes"][0]
    assert cause["cause"] in CATALOGUE
    assert {"value", "std", "unit"} == set(rate := cause["parameters"]["rate"])
    assert abs(rate["value"] - label.causes[0]["parameters"]["rate"]) < 4.0 * rate["std"]
    assert cause["evidence"]["nats"] > 10.0
    assert 0.05 < cause["evidence"]["held_out"]
    assert answer["gain"]["held_out"] is True
    assert answer["gain"]["after"] <= answer["gain"]["before"]
    assert lines(result)[0].startswith("EXPLAINED (sensor): gyro_bias")


# ---- laws of the parts


def test_whitened_innovations_of_the_truth_are_white(clean):
    fit_levels(clean, clean.null, 4)
    e = clean.white(clean.null)
    assert abs(np.mean(e**2) - 1.0) < 0.05
    for channel in range(3):
        x = e[clean.channel == channel]
        assert abs(np.corrcoef(x[1:], x[:-1])[0, 1]) < 0.08


def test_every_listed_cause_of_the_table_is_in_the_catalogue(clean):
    causes = {each.cause for each in (*clean.numbers, *CANDIDATE_KINDS)} - {""}
    assert causes <= set(CATALOGUE)
