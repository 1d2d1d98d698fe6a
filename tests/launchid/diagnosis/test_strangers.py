"""Strangers' logs: a late input is one cause, own terms are causes, what no model has is nobody's fault.

More of them: `python benchmarks/strangers.py`.
"""

from pathlib import Path

import numpy as np
import pytest

from launchid.diagnosis.adapter import read
from launchid.diagnosis.answer import extension, report
from launchid.diagnosis.model import Model
from launchid.diagnosis.verdict import diagnose
from launchid.likelihood.estimate import evaluate
from launchid.log.log import log_of_values
from sim.nominal.reader import nominal_of
from sim.nominal.table import Table


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


def test_an_input_that_acts_by_its_square_alone_may_be_late_too():
    rng, late, step, every = np.random.default_rng(7), 0.08, 1e-3, 10
    t = np.arange(0.0, 16.0, step)
    sent = np.repeat(rng.uniform(0.2, 1.2, 1 + len(t) // 700), 700)[:len(t)]
    theta, omega, rows = 0.0, 0.0, []
    for u in np.concatenate([np.full(round(late / step), sent[0]), sent])[:len(t)]:
        rows.append((theta, omega))
        omega += step * (-20.0 * np.sin(theta) - 1.0 * omega + 15.0 * u * u)
        theta += step * omega
    seen = np.array(rows)[::every] + rng.normal(size=(len(t) // every, 2)) * (1e-3, 1e-2)
    log = log_of_values("square", {"t": t[::every], "theta": seen[:, 0], "theta_dot": seen[:, 1],
                                   "beta_cmd": sent[::every]})
    table = {"vehicle": {"terms": {"sin(theta)": -20.0, "theta_dot": -1.0, "beta^2": 15.0}},
             "sensors": {"period": 0.01, "theta_std": 1e-3, "theta_dot_std": 1e-2, "beta_std": 1e-3},
             "actuator": {"natural_frequency": 500.0, "damping_ratio": 0.7}}
    found, = diagnose(log, nominal_of(Table(Path("square.toml"), table | {"name": "square"}))).named
    assert found.cause == "actuator_delay"
    assert found.values["delay"] == pytest.approx(late, abs=0.01)


def test_the_motion_that_no_model_has_is_a_state_of_a_strangers_log_alone(strangers):
    log, nominal = strangers.made("bench", "late", 9012)
    m = Model.of(read(log, nominal).track)
    assert not m.log.is_flown and np.all(m.parameters(m.table.null).rows["g"] == 1.0)
    assert np.all(np.isfinite(evaluate(m, m.table.null).e))
