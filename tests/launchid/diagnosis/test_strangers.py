"""Strangers' logs: a late input is one cause, own terms are causes, what no model has is nobody's fault.

More of them: `python benchmarks/strangers.py`.
"""

import importlib
from pathlib import Path

import numpy as np
import pytest

from launchid.diagnosis.adapter import read
from launchid.diagnosis.answer import extension, report
from launchid.diagnosis.model import Model
from launchid.diagnosis.verdict import diagnose
from launchid.likelihood.estimate import evaluate

BENCHMARKS = Path(__file__).resolve().parents[3] / "benchmarks"


@pytest.fixture(scope="module")
def strangers():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCHMARKS))
        return importlib.import_module("strangers")


@pytest.mark.parametrize(("kind", "wrong", "seed"), [
    ("drone", "late", 9002), ("drone", "damping", 9003), ("bench", "", 9015), ("pendulum", "sine", 9044),
    ("pendulum", "friction", 9042), ("robot", "k1", 9031), ("robot", "", 9035), ("stand", "", 9054),
    ("stand", "friction", 9062), ("stand", "own damping", 9058)])
def test_the_one_thing_that_is_wrong_is_named_and_nothing_else(strangers, kind, wrong, seed):
    answer = report(diagnose(*strangers.made(kind, wrong, seed)))
    assert strangers.outcome(kind, wrong, answer) == "right", (answer["verdict"], answer["causes"], answer["doubts"])


def test_a_term_of_the_nominal_is_named_with_what_it_lacks_and_flies_in_the_extension(strangers):
    log, nominal = strangers.made("bench", "sine", 9013)
    result = diagnose(log, nominal)
    values = result.named[0].values
    believed = dict(nominal.terms)["sin(theta)"]
    assert values["term"] == "sin(theta)" and values["believed"] == believed
    truth = strangers.drawn("bench", np.random.default_rng(9013)).g
    assert abs(believed + values["coefficient"] + truth) < 3.0 * result.named[0].std["coefficient"] + 0.03 * truth
    flown = next(each for each in extension(result).effects if each.name == "missing_term")
    assert flown.values == ("sin(theta)", values["coefficient"])


def test_the_lateness_of_an_input_does_not_depend_on_its_form(strangers):
    """A ramp behind a delay and a lag is late by their sum: `delay` is all of it, whatever part is a lag."""
    log, nominal = strangers.made("bench", "late", 9012)
    m = Model.of(read(log, nominal).track)
    ramp = m.log.track.ticks[:-1]
    ramps = type(m.log.track)(**{**vars(m.log.track), "commands": ramp})
    known = type(m.log)(ramps, m.log.z)
    sent = {lag: known.input_of(lambda name, missing=0.0, lag=lag: {"delay": 0.1, "lag": lag}.get(name, missing))
            for lag in (0.0, 0.02, 0.06)}
    settled = known.t[:-1] > known.t[0] + 2.0
    for each in sent.values():
        assert np.allclose(each[settled], sent[0.0][settled], atol=1e-6)


def test_the_motion_that_no_model_has_is_a_state_of_a_strangers_log_alone(strangers):
    log, nominal = strangers.made("bench", "late", 9012)
    m = Model.of(read(log, nominal).track)
    assert not m.log.is_flown and np.all(m.parameters(m.table.null).rows["g"] == 1.0)
    assert np.all(np.isfinite(evaluate(m, m.table.null).e))
