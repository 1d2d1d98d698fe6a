"""The uncertainty level: probabilities are those of a normal, a band is decided at 95 %, the alarm is sequential."""

import dataclasses
import json
import math
import pickle
from pathlib import Path

import numpy as np
import pytest
from cut import moments, scratch
from hypothesis import given
from hypothesis import strategies as hs
from shortened import short
from unjitted import unjitted

from launchid.identification.windows import run
from launchid.main import main
from launchid.robustness.level import departures, ranged_model
from launchid_core import BANDS, EDGES, Config, Estimate, Estimator, Model
from launchid_core.order.table import EVENTS, GAUGE, ONSETS
from launchid_core.watch import uncertainty as un
from sim.flight import fly_whole
from sim.nominal import Nominal, built_in
from sim.onboard import onboard_model

SIGMA = 0.25
NAN = math.nan


def normal(x: float) -> float:
    """Distribution function of the standard normal."""
    return 0.5 * math.erfc(-x / math.sqrt(2.0))


class Range:
    """A gauge with constant sigma, fed by hand."""

    def __init__(self, sigma: float = SIGMA) -> None:
        self.gauge = scratch(GAUGE, 2)
        unjitted(un.restart_gauge)(self.gauge)
        self.range = np.array([[0.0, sigma, sigma]])
        self.sigma = sigma
        self.counts, self.event = scratch(ONSETS, 2), scratch(EVENTS, 2)

    def see(self, t: float, delta: float, std: float) -> bool:
        """a6 of this delta at t; whether the alarm is raised.  k1 is known to be nominal."""
        total = moments(self.sigma * delta, 0.0, (self.sigma * std) ** 2, 0.0, 1e-8)
        unjitted(un.watch_range)(self.range, self.gauge, total, t, 0.0, self.counts, self.event)
        unjitted(un.close_range)(self.range, self.gauge, total, t)
        assert self.gauge.raised[1] == 0
        return bool(self.gauge.raised[0])


# ---- laws of the bands


@given(delta=hs.floats(-3.0, 3.0), std=hs.floats(1e-3, 10.0))
def test_probabilities_are_the_normals_and_sum_to_one(delta, std):
    gauge = Range()
    gauge.see(1.0, delta, std)
    probability = gauge.gauge.probability[0]
    cumulative = [normal((e - delta) / std) - normal((-e - delta) / std) for e in EDGES]
    assert probability.sum() == pytest.approx(1.0, abs=1e-12)
    assert (probability >= 0.0).all()
    assert np.cumsum(probability)[:3] == pytest.approx(cumulative, abs=1e-12)


@given(delta=hs.floats(-3.0, 3.0), std=hs.floats(1e-3, 10.0))
def test_a_band_is_decided_at_95_percent_and_out_wants_the_alarm(delta, std):
    gauge = Range()
    raised = gauge.see(1.0, delta, std)
    band, probability = gauge.gauge.band[0], gauge.gauge.probability[0]
    best = int(np.argmax(probability))
    decided = probability[best] >= un.DECIDED and (best != un.OUT or raised)
    assert band == (best if decided else un.NO_BAND)


# ---- the alarm


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_alarm_is_raised_at_its_posterior_on_either_side(sign):
    z = 3.7190  # of un.RAISE
    assert normal(z) == pytest.approx(un.RAISE, abs=1e-6)
    assert not Range().see(1.0, sign * (1.0 + 0.99 * z * 0.1), 0.1)
    assert Range().see(1.0, sign * (1.0 + 1.01 * z * 0.1), 0.1)


def test_the_alarm_clears_with_hysteresis():
    gauge = Range()
    assert gauge.see(1.0, 1.6, 0.1)
    assert gauge.see(2.0, 1.05, 0.1)      # more probably out than in
    assert gauge.see(3.0, 0.9, 3.0)       # little is known: |delta| > 1 is still more probable
    assert not gauge.see(4.0, 0.95, 0.1)
    assert math.isnan(gauge.gauge.since[0])
    assert not gauge.see(5.0, 1.2, 0.1)   # and is not raised again by what would not have raised it


# ---- the estimator


@pytest.fixture(scope="module")
def constant() -> Nominal:
    """The paper's launcher, 20 s of it."""
    return short(20.0)


def feed(model: Model, flight) -> tuple[list[Estimate], Estimator]:
    """The estimate of every window of 1 s."""
    return run(Config(sample_period=flight.period, formulation="filtered", model=model), flight.samples())


def test_the_level_is_the_tracked_estimate_over_the_range(constant):
    model = ranged_model(dataclasses.replace(constant, a6_drift=0.0, k1_drift=0.0))
    estimates, estimator = feed(model, fly_whole(constant, 1, a6_factor=1.4))
    for e in estimates:
        u, tracked = e.uncertainty, e.tracked
        for level, value, std, nominal in ((u.a6, tracked.a6, tracked.a6_std, 2.0),
                                           (u.k1, tracked.k1, tracked.k1_std, -7.0)):
            assert level.delta == pytest.approx((value / nominal - 1.0) / SIGMA, abs=1e-9)
            assert level.delta_std == pytest.approx(std / abs(nominal) / SIGMA, rel=1e-9)
            assert len(level.probability) == len(BANDS) and math.fsum(level.probability) == pytest.approx(1.0)
            assert math.isnan(level.out_since) == level.in_range
    last = estimates[-1].uncertainty
    assert (last.a6.band, last.a6.in_range, last.a6.out_since) == ("out", False, 0.0)
    assert (last.k1.band, last.k1.in_range) == ("0-30", True)
    again = pickle.loads(pickle.dumps(estimator))
    assert again.estimate().uncertainty == last
    estimator.reset()
    assert estimator.estimate() is None and not estimator._parts.state.gauge.raised.any()


def test_a_model_without_sigma_has_no_level_and_the_same_estimates(constant):
    flight = fly_whole(constant, 2)
    plain, without = feed(onboard_model(constant), flight)
    ranged, having = feed(ranged_model(constant), flight)
    assert all(e.uncertainty is None for e in plain)
    assert [e.tracked for e in plain] == [e.tracked for e in ranged]
    assert 0 < having.nbytes - without.nbytes < 500


@pytest.mark.parametrize(("fields", "named"), [
    ({"sigma_t": (0.0,), "sigma_a6": (0.0,), "sigma_k1": (0.2,)}, "sigma_a6"),
    ({"sigma_t": (0.0,), "sigma_a6": (0.2,), "sigma_k1": (-0.2,)}, "sigma_k1"),
    ({"sigma_t": (0.0,), "sigma_a6": (0.2,), "sigma_k1": ()}, "sigma_k1"),
    ({"sigma_t": (0.0,), "sigma_a6": (NAN,), "sigma_k1": (0.2,)}, "sigma_a6"),
    ({"sigma_t": (1.0, 1.0), "sigma_a6": (0.2, 0.2), "sigma_k1": (0.2, 0.2)}, "sigma_t"),
    ({"sigma_a6": (0.2,)}, "sigma_a6")])
def test_a_wrong_sigma_is_refused_by_name(constant, fields, named):
    with pytest.raises(ValueError, match=named):
        dataclasses.replace(onboard_model(constant), **fields)


def test_a_loss_in_flight_is_dated(constant):
    nominal = dataclasses.replace(constant)
    flight = fly_whole(nominal, 5, k1_factor=lambda t: np.where(t < 12.0, 1.0, 0.6))
    estimates, _ = feed(ranged_model(nominal), flight)
    (name, since, said, back), = departures(estimates)
    assert name == "k1" and abs(since - 12.0) < 0.3 and said <= 15.0 and math.isnan(back)


# ---- the command


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A nominal of 14 s, a log of it, one of a vehicle whose a6 is out, and nominals with faults."""
    path = tmp_path_factory.mktemp("uncertainty")
    text = built_in("constant").read_text(encoding="utf-8").replace("duration = 70.0", "duration = 14.0")
    box = "a6 = 0.25\nk1 = 0.25"
    assert box in text
    (path / "n.toml").write_text(text, encoding="utf-8")
    (path / "zero.toml").write_text(text.replace(box, "a6 = 0.25\nk1 = 0.0"), encoding="utf-8")
    (path / "short.toml").write_text(text.replace(box, 'profile = "short.csv"'), encoding="utf-8")
    (path / "short.csv").write_text("t,a6,k1\n0,0.2,0.2\n9,0.2,0.2\n", encoding="utf-8")
    head, tail = text[:text.index("a6 = 2.0")], text[text.index("[uncertainty]"):]
    (path / "late.toml").write_text(head + 'profile = "late.csv"\n\n' + tail, encoding="utf-8")
    (path / "late.csv").write_text("t,a6,k1\n3,2,-7\n90,2,-7\n", encoding="utf-8")
    start = text.index("[uncertainty]")
    (path / "none.toml").write_text(text[:start] + text[text.index("[actuator]"):], encoding="utf-8")
    assert main(["simulate", str(path / "n.toml"), "--out", str(path / "in.csv")]) == 0
    assert main(["simulate", str(path / "n.toml"), "--out", str(path / "out.csv"), "--effect",
                 "aero_instability:scale=1.4"]) == 0
    return path


def test_the_json_is_the_contracts(launchid, folder):
    status, out, _ = launchid("uncertainty", folder / "out.csv", folder / "n.toml", "--window", "1", "--json", "-")
    assert status == 0
    result = json.loads(out, parse_constant=pytest.fail)
    assert set(result) == {"windows"} and len(result["windows"]) == 14
    for k, window in enumerate(result["windows"]):
        assert set(window) == {"t_start", "t_end", "valid", "a6", "k1"}
        assert window["t_end"] == k + 1
        for name in ("a6", "k1"):
            level = window[name]
            assert set(level) == {"delta", "delta_std", "band", "probability", "in_range", "out_since"}
            assert list(level["probability"]) == list(BANDS)
            assert level["band"] in (*BANDS, "undecided")
            assert (level["out_since"] is None) == level["in_range"]
    assert [w["a6"]["in_range"] for w in result["windows"]].index(False) < 9
    assert all(w["k1"]["in_range"] for w in result["windows"])
    assert result["windows"][-1]["a6"]["band"] == "out"
    status, again, _ = launchid("uncertainty", folder / "out.csv", folder / "n.toml", "--window", "1", "--json", "-")
    assert again == out


@pytest.mark.parametrize(("nominal", "mentions"), [
    ("none.toml", ("[uncertainty]", "none.toml")), ("zero.toml", ("uncertainty.k1", "above 0")),
    ("short.toml", ("short.csv", "[uncertainty]", "0..9 s")), ("late.toml", ("late.csv", "[vehicle]", "3..90 s"))])
def test_bad_input_is_one_line_and_exit_3(launchid, folder, nominal, mentions):
    status, out, err = launchid("uncertainty", folder / "in.csv", folder / nominal)
    assert (status, out, len(err.splitlines())) == (3, "", 1), err
    assert err.startswith("launchid") and all(mention in err for mention in mentions), err
