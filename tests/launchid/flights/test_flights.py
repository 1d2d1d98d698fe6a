"""Several flights of one vehicle: the joint answer covers, another vehicle is found, the scatter too."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import launchid
from launchid.flights.pooled import Told, pooled, scatter
from launchid.main import main
from sim.nominal import load_nominal, write_nominal

A6, K1 = 2.0, -7.0   # of the nominal `constant`


def drawn(rng: np.random.Generator, n: int, std: float = 0.01, correlation: float = 0.9) -> list[Told]:
    covariance = std**2 * np.array([[1.0, correlation], [correlation, 1.0]])
    return [Told(f"f{k}", rng.multivariate_normal([1.0, 1.0], covariance), covariance) for k in range(n)]


def test_flights_of_one_vehicle_cover_and_are_rarely_called_two():
    rng = np.random.default_rng(1)
    off, false = [], 0
    for _ in range(200):
        joint = pooled(drawn(rng, 3))
        off += (np.abs(joint.value - 1.0) / joint.std).tolist()
        false += bool(joint.others)
        assert joint.std[0] == pytest.approx(0.01 / math.sqrt(3.0), rel=0.3 if joint.others else 1e-9)
    assert 0.93 < np.mean(np.array(off) < 1.96) < 0.97
    assert false <= 0.02 * 200


def test_another_vehicle_is_found_with_the_number_that_differs():
    rng, found = np.random.default_rng(2), 0
    for _ in range(200):
        flights = drawn(rng, 4)
        flights[2] = replace(flights[2], value=flights[2].value + np.array([0.0, 0.06]))
        found += pooled(flights).others == {2: "k1"}
    assert found >= 0.95 * 200


def test_the_scatter_between_flights_has_its_interval():
    rng, held = np.random.default_rng(3), 0
    for _ in range(300):
        value = 1.0 + 0.03 * rng.standard_normal(5) + 0.01 * rng.standard_normal(5)
        sigma = scatter(value, np.full(5, 0.01))
        held += sigma.low <= 0.03 <= sigma.high
    assert 0.92 < held / 300 < 0.98
    assert scatter(np.ones(4), np.full(4, 0.01)).sigma == 0.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Four flights of 30 s: three of the nominal `constant`, one with k1 20 % smaller."""
    path = tmp_path_factory.mktemp("flights")
    nominal = load_nominal("constant")
    nominal = replace(nominal, simulation=replace(nominal.simulation, duration=30.0))
    write_nominal(nominal, path / "n.toml")
    for k in range(4):
        launchid.simulate(nominal, seed=401 + k, effects=["control_effectiveness:scale=0.8"] * (k == 3)).write(
            path / f"f{k}.csv")
    return path


def asked(folder, *words: str) -> dict:
    out = folder / "out.json"
    assert main([*(str(folder / word) if "." in word else word for word in words), "--json", str(out)]) == 0
    return json.loads(out.read_text())


def test_the_joint_answer_of_identify(folder):
    found = asked(folder, "identify", "f0.csv", "f1.csv", "f2.csv", "n.toml")
    joint, single = found["joint"], found["flights"][0]["windows"]
    assert abs(joint["a6"]["value"] - A6) < 3.0 * joint["a6"]["std"]
    assert abs(joint["k1"]["value"] - K1) < 3.0 * joint["k1"]["std"]
    assert joint["k1"]["std"] < 0.5 * min(window["k1_std"] for window in single)
    assert found["one_vehicle"]["p"] > 0.01 and found["one_vehicle"]["differs"] == []
    assert {"headline", "next", "scatter"} <= set(found) and len(found["flights"]) == 3


def test_the_flight_of_another_vehicle_is_named(folder):
    for words in (["identify", "f0.csv", "f1.csv", "f2.csv", "f3.csv", "n.toml"],
                  ["identify", "f0.csv", "f1.csv", "f2.csv", "f3.csv"]):
        found = asked(folder, *words)
        (other,) = found["one_vehicle"]["differs"]
        assert other["log"].endswith("f3.csv") and other["in"] == "k1"
        assert abs(found["joint"]["k1"]["value"] - K1) < 3.0 * found["joint"]["k1"]["std"]


def test_one_first_nominal_of_three_flights(folder):
    logs = [str(folder / f"f{k}.csv") for k in range(3)]
    made, one = launchid.nominal(logs), launchid.nominal(logs[0])
    assert abs(made.numbers.k1[0] - K1) < 3.0 * made.numbers.k1_std[0]
    assert made.numbers.k1_std[0] < 0.75 * one.numbers.k1_std[0]
    assert made.nominal.actuator.natural_frequency == pytest.approx(50.0, rel=0.03)


def test_compare_takes_flights_and_says_which_nominal_predicts_them(folder):
    found = asked(folder, "compare", "f0.csv", "f1.csv", "n.toml", "--flights", "0")
    assert len(found["flights"]) == 2 and "n predicts theta of 2 flights" in found["headline"]
    assert found["next"].startswith("launchid ")


def test_flights_are_given_once_and_two_that_differ_have_no_joint_answer(folder, capsys):
    assert main(["identify", str(folder / "f0.csv"), str(folder / "f0.csv")]) == 3
    assert "the same flight" in capsys.readouterr().err
    assert asked(folder, "identify", "f0.csv", "f3.csv", "n.toml")["joint"] is None
