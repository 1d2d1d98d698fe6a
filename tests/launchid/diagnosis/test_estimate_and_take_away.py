"""The diagnosis anew: what is hidden in a flight is named, what is not there is not, and the laws of its parts."""

import json

import numpy as np
import pytest
from hidden import draw_spec, fly

from launchid.diagnosis.adapter import read
from launchid.diagnosis.answer import lines, report
from launchid.diagnosis.candidates import CANDIDATE_KINDS, usual
from launchid.diagnosis.estimate import fit_levels, level_deviation
from launchid.diagnosis.filter import played
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


def test_a_noise_level_has_the_deviation_of_a_normal_sample(clean):
    """Of n rows the level is known to 1/sqrt(2 n) of itself, and less well by what the state takes of them."""
    fit_levels(clean, clean.null, 4)
    rows = np.count_nonzero(clean.channel == 2)
    share = level_deviation(clean, clean.null, 2) / np.exp(clean.levels[2])
    assert 1.0 < share * np.sqrt(2.0 * rows) < 1.6


def test_a_play_passes_on_the_mean_of_what_noise_makes_of_it():
    """Against 4000 noisy plays flown one by one; without noise it is the play itself."""
    rng, width, noise = np.random.default_rng(3), 8e-4, 7e-4
    u = 3e-3 * (np.sin(0.011 * np.arange(800)) + 0.5 * np.sin(0.029 * np.arange(800) + 1.0))
    sides, mean, plain, y = np.full(4000, u[0]), np.empty(800), np.empty(800), u[0]
    for i, x in enumerate(u):
        asked = x + noise * rng.normal(size=4000)
        sides = np.clip(sides, asked - width, asked + width)
        mean[i], y = sides.mean(), min(max(y, x - width), x + width)
        plain[i] = y
    out = np.empty(800)
    played(u, width, noise, out)
    assert np.std(out - mean) < 0.15 * np.std(mean - u) < 0.05 * np.std(plain - u)
    played(u, width, 0.0, out)
    assert np.array_equal(out, plain)


def test_a_gyro_that_is_whole_rows_late_is_put_back(clean):
    """The innovations of a column four rows late are those of the column itself, but for the rows that are lost."""
    columns, _ = fly(draw_spec(71001, None, "constant", 2.0, duration=30.0, rate=100.0))
    late = columns | {"theta_dot": np.append(np.full(4, columns["theta_dot"][0]), columns["theta_dot"][:-4])}
    m = Model(read(log_of_values("log.csv", late), load_nominal("constant")).track)
    m.with_numbers(usual(m), [])
    m.retime(0.041)
    assert m.retimed == pytest.approx(0.04)
    p = m.null.copy()
    p[m.index("gyro_delay")] = m.retimed
    m.levels[:] = clean.levels
    clean.white(clean.null)
    m.white(p)
    assert m.E[:-4] == pytest.approx(clean.E[:-4], abs=1e-8)
    m.retime(0.043)
    assert m.retimed == pytest.approx(0.04)
