"""Predictions, flights and dispersions: of a nominal's own flights what noise allows, of others what is wrong."""

import dataclasses
import functools

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are
from scipy.stats import kstest

from launchid.commands.compare import compare
from launchid.comparison.flown import FIRST_SEED, Draw, along, dispersed, drawn, flown, fly_drawn, quiet
from launchid.comparison.prediction import predictions, statistics
from launchid.log.detect import check
from launchid.log.log import Log, flown_log
from launchid.report.comparison import Comparison
from sim.effects import effect
from sim.flight import fly_whole
from sim.nominal import load_nominal

CONSTANT = load_nominal("constant")
assert CONSTANT.simulation is not None and CONSTANT.actuator is not None
SHORT = dataclasses.replace(CONSTANT, simulation=dataclasses.replace(CONSTANT.simulation, duration=10.0))
DELAY = effect("actuator_delay", delay=0.03)
CHANNELS = ("theta", "theta_dot", "beta")


@functools.cache
def log_of_seed(seed: int, *effects) -> Log:
    return flown_log(fly_whole(CONSTANT, seed, effects=effects))


def points_off(log: Log, nominal, channel: str, horizon: float = 1.0) -> float:
    """By how many points the fit of a prediction is below what noise allows."""
    found = predictions(log, nominal, check(log, nominal))[channel][horizon]
    spread = float(np.nanstd(found.measured))
    return 100.0 * (1.0 - found.noise / spread) - statistics(found.measured, found.predicted).fit


# ---- predictions


def test_what_noise_allows_is_the_stationary_kalman_filters():
    """Process and sensor noise of the linear plant, discretised by itself, through scipy's Riccati equation."""
    w, zeta, period = 50.0, 0.7, 0.01
    a = np.zeros((6, 6))   # theta, theta_dot, beta, beta_dot; held command and acceleration
    a[0, 1], a[1, 0], a[1, 2], a[1, 5], a[2, 3] = 1.0, 2.0, -7.0, 1.0, 1.0
    a[3, 2], a[3, 3], a[3, 4] = -w * w, -2.0 * zeta * w, w * w
    whole = expm(a * period)
    f, enters = whole[:4, :4], whole[:4, 4:]
    q = enters @ np.diag([7.0e-4**2, 8.7e-4**2]) @ enters.T
    c, r = np.eye(4)[:3], np.diag([3.5e-4**2, 5.2e-4**2, 3.5e-4**2])
    before = solve_discrete_are(f.T, c.T, q, r)
    p = before - before @ c.T @ np.linalg.solve(c @ before @ c.T + r, c @ before)
    for _ in range(100):
        p = f @ p @ f.T + q
    expected = np.sqrt(np.diag(c @ p @ c.T + r))
    log = log_of_seed(1)
    made = predictions(log, CONSTANT, check(log, CONSTANT))
    assert [made[name][1.0].noise for name in CHANNELS] == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_true_nominal_predicts_what_noise_allows(seed):
    for channel in CHANNELS:
        assert abs(points_off(log_of_seed(seed), CONSTANT, channel)) < 2.0


def test_without_noise_a_nominal_predicts_its_own_flight():
    log = flown_log(fly_whole(quiet(CONSTANT)))
    made = predictions(log, CONSTANT, check(log, CONSTANT))
    assert {name: set(of) for name, of in made.items()} == {name: {0.1, 0.5, 1.0} for name in (*CHANNELS, "beta_cmd")}
    for name, of in made.items():
        for horizon, found in of.items():
            assert np.max(np.abs(found.measured - found.predicted)) < 2e-5, (name, horizon)


def test_missing_rows_cost_nothing_but_themselves():
    log = log_of_seed(1)
    gone = np.random.default_rng(0).random(len(log.t)) < 0.1
    holed = dataclasses.replace(log, theta=np.where(gone, np.nan, log.theta), beta=np.where(gone, np.nan, log.beta),
                                theta_dot=np.where(gone, np.nan, log.theta_dot))
    for channel in CHANNELS:
        assert abs(points_off(holed, CONSTANT, channel)) < 2.0


def test_a_hidden_cause_raises_the_coefficient_and_its_extension_takes_it_back():
    hidden, own = log_of_seed(3, DELAY), log_of_seed(3)
    extension = dataclasses.replace(CONSTANT, effects=(DELAY,))

    def tic(log: Log, nominal, channel: str) -> float:
        found = predictions(log, nominal, check(log, nominal))[channel][1.0]
        return statistics(found.measured, found.predicted).tic

    for channel in ("theta_dot", "beta"):
        before, after, true = (tic(log, nominal, channel) for log, nominal in (
            (hidden, CONSTANT), (hidden, extension), (own, CONSTANT)))
        assert after < 0.8 * before and after == pytest.approx(true, rel=0.05)


# ---- flown


def test_the_last_lines_say_which_nominal_is_as_good_as_noise_allows():
    hidden, extension = log_of_seed(3, DELAY), dataclasses.replace(CONSTANT, effects=(DELAY,))
    right, wrong = ("\n".join(compare(hidden, nominal, flights=0).summary().splitlines()[-3:])
                    for nominal in (extension, CONSTANT))
    assert "launchid diagnose" in wrong and "launchid diagnose" not in right and "theta_dot 1." in right


def test_a_flight_without_noise_is_flown_again():
    log = flown_log(fly_whole(quiet(SHORT)))
    again = flown(log, CONSTANT)
    assert again is not None
    for name in ("theta", "theta_dot", "beta", "beta_cmd"):
        assert again[name] == pytest.approx(getattr(log, name), abs=1e-12)


def test_what_has_no_reference_or_controller_is_not_flown():
    log = log_of_seed(1)
    assert flown(dataclasses.replace(log, theta_ref=np.full(len(log.t), np.nan)), CONSTANT) is None
    assert flown(log, dataclasses.replace(CONSTANT, controller=None)) is None


# ---- dispersions


def test_a_draw_has_the_sigmas_of_the_nominal_and_is_the_same_again():
    unsure = dataclasses.replace(CONSTANT, actuator=dataclasses.replace(
        CONSTANT.actuator, natural_frequency_sigma=0.1, damping_ratio_sigma=0.05, delay_sigma=0.002, delay=0.02))
    draws = [drawn(unsure, seed) for seed in range(400)]
    servos = np.array([[craft.actuator.natural_frequency, craft.actuator.damping_ratio, craft.actuator.delay]
                       for craft, *_ in draws])
    assert servos.std(axis=0) == pytest.approx([5.0, 0.035, 0.002], rel=0.15)
    assert servos.mean(axis=0) == pytest.approx([50.0, 0.7, 0.02], rel=0.05)
    deltas = np.array([each[1:] for each in draws])
    assert np.abs(deltas).max() <= 1.0 and deltas.std(axis=0) == pytest.approx([3**-0.5] * 2, rel=0.1)
    log = log_of_seed(1)
    there = np.ones((4, len(log.t)), bool)
    one, other = (fly_drawn(SHORT, log.t, there, 0.01, Draw(7)) for _ in range(2))
    assert np.array_equal(one[0], other[0], equal_nan=True) and np.array_equal(one[1], other[1])


def peaks_of(flights: int, among: int) -> dict[str, list[float]]:
    """The place of the peaks of a nominal's own flights, each among as many others of its own."""
    there = np.ones((4, 1000), bool)
    t = 0.01 * np.arange(1000)
    all_peaks = np.array([fly_drawn(SHORT, t, there, 0.01, Draw(FIRST_SEED + k))[1]
                          for k in range(flights * (among + 1))])
    own, others = all_peaks[:flights], all_peaks[flights:].reshape(flights, among, 4)
    return dict(zip(("theta", "theta_dot", "beta", "beta_cmd"), np.mean(others < own[:, None], axis=1).T.tolist(),
                    strict=True))


@pytest.mark.parametrize(("flights", "among"), [
    (20, 20), pytest.param(200, 200, marks=pytest.mark.campaign)])
def test_peaks_of_the_nominals_own_flights_are_uniform(flights, among):
    for name, places in peaks_of(flights, among).items():
        assert kstest(places, "uniform").pvalue > 0.05, name
        if flights >= 200:
            assert np.mean((np.array(places) < 0.025) | (np.array(places) > 0.975)) <= 0.08, name


def test_a_flight_of_the_nominal_is_in_its_band_and_a_biased_one_is_not():
    found = dispersed(flown_log(fly_whole(SHORT, 5)), SHORT, flights=40)
    biased = dispersed(flown_log(fly_whole(SHORT, 5, effects=(effect("gyro_bias", rate=0.05),))), SHORT, flights=40)
    assert found is not None and biased is not None
    assert found.places["theta_dot"].outside < 0.2
    assert biased.places["theta_dot"].outside > 0.9 and biased.places["theta_dot"].peak > 0.9


def test_a_log_that_begins_in_flight_is_not_flown_and_that_is_said():
    log = log_of_seed(1)
    late = dataclasses.replace(log, t=log.t + 30.0)
    assert along(late, CONSTANT) is None and dispersed(late, CONSTANT, 2) is None
    assert "begins at 30 s" in compare(late, CONSTANT, flights=2).warnings[-1]


# ---- the answer


@pytest.fixture(scope="module")
def made() -> Comparison:
    extension = dataclasses.replace(CONSTANT, effects=(DELAY,), path="x/ext.toml")
    return compare(log_of_seed(3, DELAY), CONSTANT, extension, flights=20)


def test_its_json_is_the_contracts(made):
    report = made.report
    assert [each["nominal"] for each in report["nominals"]] == ["constant", "ext"]
    for each in report["nominals"]:
        assert set(each["channels"]) == {"theta", "theta_dot", "beta", "beta_cmd"}
        for channel in each["channels"].values():
            assert set(channel["ahead"]) == {"0.1", "0.5", "1"}
            for found in (*channel["ahead"].values(), channel["flown"]):
                assert {"fit", "rms", "largest", "tic", "bias", "variance", "covariance"} <= set(found)
            assert set(channel["percentile"]) == {"share_outside_90", "peak"}
        pairs = [(one["from"], one["to"], one["instrument"]) for one in each["frequency_response"]]
        assert pairs == [("beta", "theta_ddot", "theta_ref"), ("beta", "theta_ddot", None),
                         ("beta_cmd", "beta", "theta_ref"), ("beta_cmd", "beta", None)]
        for one in each["frequency_response"]:
            sizes = {len(one[key]) for key in ("frequency", "gain_db", "gain_db_std", "phase_deg", "phase_deg_std",
                                               "coherence", "nominal_gain_db", "nominal_phase_deg")}
            assert len(sizes) == 1


def test_a_nominal_that_answers_too_early_is_outside_the_measured_region(made):
    lines = [line for line in made.summary().splitlines() if line.startswith("beta_cmd -> beta, of the input itself")]
    assert len(lines) == 1 and "constant at 0 %" in lines[0] and int(lines[0].rsplit("ext at ", 1)[1].split()[0]) > 85


def test_its_report_is_one_page_with_live_charts(made, tmp_path):
    pytest.importorskip("matplotlib")
    made.write_report(tmp_path / "report")
    names = {"report.html", "compare.json", "comparison.png", "dispersions.png", "responses.png"}
    assert {path.name for path in (tmp_path / "report").iterdir()} == names
    page = (tmp_path / "report" / "report.html").read_text(encoding="utf-8")
    assert page.count('class="chart"') == 3 and "src=\"http" not in page
    assert (tmp_path / "report" / "compare.json").read_text(encoding="utf-8") == made.to_json() + "\n"
