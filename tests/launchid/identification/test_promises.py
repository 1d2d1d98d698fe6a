"""What a window's number rests on is tested on its log: the trim, the damping's sign, noise in beta, stretches without
a gap."""

import numpy as np
import pytest

from launchid.commands.identify import identify
from launchid.log.log import Log, flown_log, log_of
from sim.effects import from_text
from sim.flight import fly_whole
from sim.nominal import load_nominal


def flown(*effects: str) -> Log:
    return flown_log(fly_whole(load_nominal("constant"), 1, effects=tuple(from_text(text) for text in effects)))


def refused(log: Log, **choices: str) -> list[str]:
    """What the log lacks of the answer to the whole of it, which contradicts the model."""
    made = identify(log, window="all", **choices).report
    assert [(w["status"], w["valid"], w["k1"]) for w in made["windows"]] == [("MODEL", False, None)]
    return [lack["what"] for lack in made["lacks"]]


def test_a_trim_is_in_the_default_library_and_refuses_one_that_lacks_it():
    """A wind of 1.7 degrees makes a6 40 % wrong without a constant."""
    log = flown("steady_wind:angle=0.03")
    made = identify(log, window="all").report["windows"][0]
    assert made["status"] == "OK" and abs(made["a6"] - 2.0) < 3.0 * made["a6_std"] < 0.2
    assert made["terms"]["1"] == pytest.approx(0.06, abs=4.0 * made["terms_std"]["1"])
    assert "1" in refused(log, library="rigid-body")


def test_a_damping_of_the_wrong_sign_is_refused():
    """theta_ddot = theta_dot - 7 beta, and beta answers the motion."""
    rng, step = np.random.default_rng(0), 0.001
    theta = rate = beta = 0.0
    rows = []
    for k in range(40_000):
        if k % 1000 == 0:
            reference = rng.choice([-0.05, 0.0, 0.05])
        if k % 10 == 0:
            rows.append((k * step, theta, rate, beta))
            command = 0.9 * (theta - reference) + 0.6 * rate
        beta += step * (command - beta) / 0.03
        rate += step * (rate - 7.0 * beta)
        theta += step * rate
    table = np.array(rows)
    table[:, 1:] += 1e-5 * rng.standard_normal((len(table), 3))
    assert refused(log_of(dict(zip(("t", "theta", "theta_dot", "beta"), table.T, strict=True)))) == ["driving"]


def test_coefficients_that_noise_in_beta_draws_off_are_refused():
    """A formulation that takes beta for exact; the log's own noise gives other coefficients."""
    columns = {name: x for name, x in flown().measured().items() if name in ("t", "theta", "theta_dot", "beta")}
    columns["beta"] = columns["beta"] + 1e-3 * np.random.default_rng(0).standard_normal(len(columns["t"]))
    assert refused(log_of(columns), formulation="difference") == ["coefficients"]


def test_a_log_of_short_stretches_is_unchecked_and_says_what_would_allow_it():
    """Rows are lost every 0.34 s."""
    log = flown()
    rows = np.arange(len(log.t)) % 40 < 34
    made = identify(log_of({name: x[rows] for name, x in log.measured().items()}), window=5.0).report
    assert {w["status"] for w in made["windows"]} <= {"UNCHECKED", "LOW_INFORMATION", "SEPARATION", "RANK", "GAP"}
    assert "UNCHECKED" in {w["status"] for w in made["windows"]} and "without a gap" in made["unchecked"]
