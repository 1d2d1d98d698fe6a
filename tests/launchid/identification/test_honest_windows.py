"""Windows tell the truth about themselves, with a nominal and without one.

Without: standard deviations that hold (the law of the covariance is numpy's), refusals where a number would lie, limits
of absent terms. With: a clean flight is not contradicted, at any rate. Those flights are of `benchmarks/rates.py`;
`campaign`: of the windows of a hundred, 1 % may be.
"""

import dataclasses
import json
import math

import numpy as np
import pytest
from unjitted import unjitted

from launchid.commands.identify import identify
from launchid.identification.windows import run
from launchid.judge.refusal import disbelieved
from launchid.log.check import checked
from launchid.log.log import Log, flown_log, log_of, read_log, write_columns, write_flight
from launchid.main import main
from launchid.weakform.prepare import usable
from launchid_core import Config, Estimate, EstimateStatus, Estimator, Sample, Status
from launchid_core.regression import residual
from sim.effects import from_text
from sim.flight import fly_whole
from sim.nominal import Nominal, load_nominal
from sim.onboard import onboard_model
from sim.plant import parameters

PERIOD = 0.01
autoregression, bandwidth, long_run, own_variance = map(unjitted, (
    residual.autoregression, residual.bandwidth, residual.long_run, residual.own_variance))


def numpy_lags(scores: np.ndarray) -> int:
    """Andrews, eq. 5.3, 6.2, 6.4, as they stand there."""
    n, above, below = scores.shape[1], 0.0, 0.0
    for v in scores:
        rho = v[1:] @ v[:-1] / (v[:-1] @ v[:-1])
        variance = 1.0 - rho**2  # of the innovation, the series' own as unit
        above += 4 * rho**2 * variance**2 / ((1 - rho) ** 6 * (1 + rho) ** 2)
        below += variance**2 / (1 - rho) ** 4
    return int(min(1.1447 * (above / below * n) ** (1 / 3), n / 2))


def numpy_long_run(scores: np.ndarray, lags: int) -> np.ndarray:
    """Newey & West, eq. 5: Bartlett's weights as a Toeplitz matrix between the series."""
    n = scores.shape[1]
    weight = np.maximum(0.0, 1.0 - np.abs(np.subtract.outer(np.arange(n), np.arange(n))) / (lags + 1))
    return scores @ weight @ scores.T


def autoregressive(rng: np.random.Generator, rho: float, n: int) -> np.ndarray:
    """Stationary, unit variance."""
    e = math.sqrt(1 - rho**2) * rng.standard_normal(n)
    x = np.empty(n)
    x[0] = rng.standard_normal()
    for i in range(1, n):
        x[i] = rho * x[i - 1] + e[i]
    return x


def one(config: Config, samples: list[Sample]) -> Estimate:
    """The estimate of the only window."""
    estimator = Estimator(config)
    assert [estimator.update(s) for s in samples].count(Status.WINDOW_COMPLETE) == 1
    estimate = estimator.estimate()
    assert estimate is not None
    return estimate


def equation(rows: int, noise: np.ndarray, a6: float = 2.0, k1: float = -7.0, beta: np.ndarray | None = None,
             period: float = PERIOD) -> list[Sample]:
    """Samples with theta_ddot measured, `noise` on it; theta and beta are independent tones."""
    t = np.arange(rows) * period
    theta = 0.05 * np.sin(2.0 * t) + 0.02 * np.sin(7.0 * t)
    beta = 0.04 * np.cos(3.0 * t) + 0.02 * np.sin(11.0 * t) if beta is None else beta
    table = np.column_stack([t, theta, np.gradient(theta, t), beta, a6 * theta + k1 * beta + noise])
    return [Sample(*row) for row in table.tolist()]


def of(rows: int, **choices) -> Config:
    return Config(**{"window": rows * PERIOD, "sample_period": PERIOD, "formulation": "measured"} | choices)


# ---- the law


@pytest.mark.parametrize("rho", [-0.6, 0.0, 0.5, 0.9])
def test_long_run_covariance_is_newey_and_west_s_with_andrews_bandwidth(rho):
    rng = np.random.default_rng(7)
    scores = np.stack([autoregressive(rng, rho, 200), autoregressive(rng, 0.3, 200)])
    above, below = np.sum([autoregression(v) for v in scores], axis=0)
    lags = bandwidth(above, below, 200)
    assert lags == numpy_lags(scores)
    covariance = [[long_run(v, w, lags, 190, v is w) for w in scores] for v in scores]
    assert np.allclose(covariance, numpy_long_run(scores, lags) * 200 / 190, rtol=1e-12)


def test_standard_deviations_are_those_of_the_solution_with_drifts_and_what_it_moves():
    rng = np.random.default_rng(3)
    rows = 200
    samples = equation(rows, 0.02 * autoregressive(rng, 0.7, rows))
    e = one(of(rows), samples)
    table = np.array(samples)
    tau = table[:, 0] - 0.5 * rows * PERIOD
    phi, y = table[:, [1, 3]], table[:, 4]
    wide = np.column_stack([phi, tau[:, None] * phi])
    inverse = np.linalg.pinv(wide)
    moved = (inverse @ y)[:2] - np.linalg.pinv(phi) @ y
    scores = inverse[:2] * (y - wide @ (inverse @ y))
    expected = numpy_long_run(scores, numpy_lags(scores)) * rows / (rows - 4) + np.outer(moved, moved)
    assert np.allclose((e.a6_std, e.k1_std), np.sqrt(np.diag(expected)), rtol=1e-8)
    assert e.a6_k1_corr == pytest.approx(expected[0, 1] / math.sqrt(expected[0, 0] * expected[1, 1]), abs=1e-8)


@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_intervals_hold_under_autocorrelated_noise(rho):
    """The white formula covers 0.5 at rho = 0.8; Newey and West's is known to fall short of 0.95 by some points."""
    rows, inside = 300, []
    estimator = Estimator(of(rows))
    for seed in range(150):
        estimator.reset()
        for sample in equation(rows, 0.02 * autoregressive(np.random.default_rng(seed), rho, rows)):
            estimator.update(sample)
        e = estimator.estimate()
        inside.append((abs(e.a6 - 2.0) < 1.96 * e.a6_std, abs(e.k1 + 7.0) < 1.96 * e.k1_std))
    assert (np.mean(inside, axis=0) >= 0.84).all()


@pytest.mark.parametrize("name", ["constant", "vega_like"])
@pytest.mark.parametrize("window", [1.0, 10.0])
def test_intervals_of_clean_flights_hold(name, window):
    nominal, inside = load_nominal(name), []
    for seed in range(3):
        flight = fly_whole(nominal, seed)
        estimates, _ = run(Config(window=window, sample_period=PERIOD), flight.samples())
        truth = parameters(nominal, np.array([0.5 * (e.t_start + e.t_end) for e in estimates]))
        inside += [(abs(e.a6 - a6) < 1.96 * e.a6_std, abs(e.k1 - k1) < 1.96 * e.k1_std)
                   for e, a6, k1 in zip(estimates, *truth, strict=True) if e.valid]
    assert len(inside) >= 3 and (np.mean(inside, axis=0) >= 0.85).all()


# ---- refusals


def test_one_direction_is_separation():
    """beta = -theta/2 but for a little: only 2 a6 - k1 is known."""
    rows, rng = 200, np.random.default_rng(0)
    theta = np.array(equation(rows, np.zeros(rows)))[:, 1]
    beta = -0.5 * theta + 1e-4 * rng.standard_normal(rows)
    e = one(of(rows), equation(rows, 0.05 * rng.standard_normal(rows), beta=beta))
    assert e.status is EstimateStatus.SEPARATION and not e.valid and math.isnan(e.a6) and math.isnan(e.k1_std)


def test_noise_alone_is_low_information():
    rows, rng = 200, np.random.default_rng(2)
    statuses = {one(of(rows), equation(rows, 30.0 * rng.standard_normal(rows))).status for _ in range(10)}
    assert EstimateStatus.LOW_INFORMATION in statuses


# ---- what was thresholded away


def test_an_absent_term_has_a_limit_and_a6_its_standard_deviation():
    rows, rng = 200, np.random.default_rng(1)
    e = one(of(rows, library="theta,theta_dot,beta", threshold=0.5),
            equation(rows, 0.05 * rng.standard_normal(rows), a6=0.1))
    assert e.valid and e.a6 == 0.0 and e.k1 != 0.0
    assert set(e.absent) == {"theta", "theta_dot"}
    assert 0.1 < e.absent["theta"] < 0.5 and 0.0 < e.a6_std < 0.2
    with pytest.raises(TypeError):
        e.absent["theta"] = 0.0
    assert one(of(rows), equation(rows, np.zeros(rows))).absent == {}


def test_the_limit_is_of_the_term_added_alone():
    rows, rng = 200, np.random.default_rng(4)
    samples = equation(rows, 0.05 * rng.standard_normal(rows), a6=0.1)
    e = one(of(rows, library="theta,beta", threshold=0.5), samples)
    table = np.array(samples)
    inverse = np.linalg.pinv(table[:, [1, 3]])
    xi = inverse @ table[:, 4]
    score = (inverse[:1] * (table[:, 4] - table[:, [1, 3]] @ xi))
    std = math.sqrt(numpy_long_run(score, numpy_lags(score))[0, 0] * rows / (rows - 2))
    assert e.a6_std == pytest.approx(std, rel=1e-8)
    assert e.absent["theta"] == pytest.approx(abs(xi[0]) + 1.96 * std, rel=1e-8)


# ---- the log against a window


@pytest.fixture(scope="module")
def clean(tmp_path_factory) -> Log:
    """A clean flight's log."""
    path = tmp_path_factory.mktemp("logs") / "clean.csv"
    write_flight(path, fly_whole(load_nominal("constant"), 1))
    return read_log(path)


def shifted(log: Log, share: float) -> Log:
    """beta and its command of another time."""
    n = round(share * len(log.t))
    return dataclasses.replace(log, beta=np.roll(log.beta, n), beta_cmd=np.roll(log.beta_cmd, n))


def early(log: Log, rows: int) -> Log:
    """beta so many rows before what it causes."""
    return dataclasses.replace(log, beta=np.roll(log.beta, -rows))


def windows(log: Log, window: float, **choices) -> tuple[Config, list[Estimate]]:
    config = Config(window=window, sample_period=PERIOD, **choices)
    return config, run(config, log.samples())[0]


def statuses(log: Log, window: float | str, **choices) -> list[str]:
    return [w["status"] for w in identify(log, window=window, **choices).report["windows"]]


@pytest.mark.parametrize("formulation", [None, "integral"])
def test_a_clean_flight_keeps_its_windows(clean, formulation):
    made = identify(clean, window=5.0, formulation=formulation).report
    assert [w["status"] for w in made["windows"]].count("OK") >= 0.5 * len(made["windows"])
    assert "MODEL" not in {w["status"] for w in made["windows"]} or formulation
    assert made["lacks"] == [] or formulation


@pytest.mark.parametrize(("share", "window"), [(0.3, 1.0), (0.4, 5.0)])
def test_a_shifted_beta_has_no_valid_k1(clean, share, window):
    made = identify(shifted(clean, share), window=window).report
    assert not any(w["valid"] for w in made["windows"]) and "why" in made
    assert all(w["k1"] is None for w in made["windows"])


@pytest.mark.parametrize("rows", [3, -5, 12])
def test_a_beta_of_another_time_is_found(clean, rows):
    """beta logged `rows` too early is late in the numbers; before its own command, or after what it causes, refused."""
    made = identify(early(clean, rows), window=5.0).report
    found = made["delay"]
    assert abs(found["value"] - rows * PERIOD) < max(4.0 * found["std"], 0.1 * PERIOD)
    assert found["std"] < 0.005
    if rows == 3:
        assert made["late"]["delay"] == found
        holds_the_truth(made["windows"])
    else:
        assert not any(w["valid"] for w in made["windows"])
        assert "delay" in [lack["what"] for lack in made["lacks"]] or "correct the log first" in made["next"]


def holds_the_truth(made: list[dict], a6: float = 2.0, k1: float = -7.0) -> None:
    valid = [w for w in made if w["valid"]]
    assert 2 * len(valid) >= len(made)
    assert all(abs(w[name] - true) < 4.0 * w[f"{name}_std"] for w in valid for name, true in (("a6", a6), ("k1", k1)))


@pytest.mark.parametrize("delay", [0.0, 0.02])
def test_a_command_is_a_beta_behind_the_servo(delay):
    """Of a log without a nozzle the command is taken: the servo (50 rad/s, 0.7: 28 ms) is a delay and a lag."""
    effects = [from_text(f"actuator_delay:delay={delay}")]
    flight = flown_log(fly_whole(load_nominal("constant"), 3, effects=effects)).measured()
    log = log_of({name: flight["beta_cmd" if name == "beta" else name] for name in ("t", "theta", "theta_dot", "beta")})
    made = identify(log, window=5.0)
    late = made.report["late"]
    assert abs(late["delay"]["value"] + late["lag"]["value"] - 0.0275 - 0.5 * PERIOD - delay) < 0.005
    assert "beta acts behind a delay of" in made.summary() and " and a lag of" in made.summary()
    holds_the_truth(made.report["windows"])


def test_numbers_that_scatter_have_deviations_that_hold_it():
    """k1 -7 and -3.5 in turn, 5 s each: no vehicle does, and no window knows better than the log."""
    flight = flown_log(fly_whole(load_nominal("constant"), 3)).measured()
    swaps = np.where(np.floor(flight["t"] / 5.0) % 2 == 0, 1.0, 2.0)
    columns = {name: flight[name] for name in ("t", "theta", "theta_dot")}
    log = log_of(columns | {"beta": flight["beta"] * swaps})
    made = identify(log, window=5.0).report["windows"]
    valid = [w for w in made if w["valid"]]
    assert valid and all(abs(w["k1"] - k1) < 4.0 * w["k1_std"] for w in valid for k1 in (-7.0, -3.5))


def test_a_beta_that_explains_nothing_has_no_valid_window(clean):
    noise = dataclasses.replace(clean, beta=0.01 * np.random.default_rng(0).standard_normal(len(clean.t)))
    assert "OK" not in statuses(noise, 5.0)


def test_without_a_rate_the_attitude_s_slope_judges():
    """A test stand moves a lot: the same law holds, and a beta of another time has no valid window."""
    t = np.arange(0.0, 30.0, PERIOD)
    beta = np.repeat(np.random.default_rng(2).choice([-0.1, 0.0, 0.1], 60), 50)
    rate = np.cumsum(-7.0 * beta) * PERIOD
    theta = np.cumsum(rate) * PERIOD
    log = log_of({"t": t, "theta": theta + 1e-5 * np.random.default_rng(3).normal(size=len(t)), "beta": beta})
    rows = usable(checked(log))
    assert rows.theta_dot[10:-10] == pytest.approx(rate[10:-10], abs=0.05)
    assert "OK" not in statuses(shifted(log, 0.4), 5.0)


def test_of_a_column_of_another_quantity_no_number_is_left():
    """Neither the window's nor the tracked estimate nor the level, whatever the filter made of it."""
    flight = fly_whole(load_nominal("vega_like"), 1)
    found = identify(flown_log(flight), "vega_like", tracked=True).fitted[3]
    assert found.valid and found.tracked.valid
    left = disbelieved(found)
    assert not (left.valid or left.tracked.valid) and left.uncertainty is None
    assert all(math.isnan(x) for x in (left.a6, left.k1, left.tracked.a6, left.wind))


# ---- what cannot be asked


@pytest.mark.parametrize("stamp", [1e308, 1e11, 500.0, -500.0])
def test_one_wrong_stamp_changes_little(clean, stamp):
    t = clean.t.copy()
    t[3000] = stamp
    rows = usable(checked(dataclasses.replace(clean, t=t)))
    assert len(rows.t) == len(t) - 1 and (np.diff(rows.t) > 0.0).all()


@pytest.mark.parametrize("stamps", [
    pytest.param(np.arange(400) * 10.0, id="rows ten seconds apart"),
    pytest.param(np.concatenate([np.arange(1000) * 0.01, 12000.0 + np.arange(1000) * 0.01]), id="a long pause"),
    pytest.param(np.concatenate([np.arange(2000) * 0.01, 15000.0 + np.arange(99) * 0.01]), id="a late end"),
    pytest.param((np.arange(400)[:, None] * 0.008 + np.arange(4) * 0.001).ravel(), id="bursts"),
    pytest.param(np.arange(60) * 0.01, id="less than a piece")])
@pytest.mark.parametrize("still", [False, True])
def test_odd_stamps_and_a_body_at_rest_are_judged_or_not_but_never_a_crash(stamps, still):
    rng = np.random.default_rng(1)
    n = len(stamps)
    theta, rate = (0.0 * stamps, 0.0 * stamps) if still else (0.01 * rng.normal(size=n), 0.01 * rng.normal(size=n))
    log = log_of({"t": stamps, "theta": theta, "theta_dot": rate, "beta": 0.01 * rng.normal(size=n)})
    made = identify(log, window=2.0 if stamps[-1] > 10000.0 else "all")
    assert all(w["status"] != "OK" or w["terms"] for w in made.report["windows"])


def test_rates_that_are_not_measured_cost_little(clean):
    rate = clean.theta_dot.copy()
    rate[150::200] = np.nan
    whole, holed = (statuses(log, 5.0).count("OK") for log in (clean, dataclasses.replace(clean, theta_dot=rate)))
    assert holed >= whole - 2


def test_the_command_says_it(clean, tmp_path, capsys):
    assert main(["identify", clean.path, "--window", "5", "--json", "-"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert abs(said["delay"]["value"]) < 5.0 * said["delay"]["std"]
    assert all(set(w["fit"]) == {"r2_held_out", "whiteness"} and w["absent"] == {} for w in said["windows"])
    log, path = shifted(clean, 0.4), tmp_path / "shifted.csv"
    write_columns(path, {column: getattr(log, column) for column in ("t", "theta", "theta_dot", "beta")})
    assert main(["identify", str(path)]) == 0
    assert "no window of this log is valid" in capsys.readouterr().out.lower()
    assert main(["identify", str(path), "--json", "-"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["delay"] is None
    assert all(w["k1"] is None and w["terms"] == {} and not w["valid"] for w in said["windows"])


NAMES = ("constant", "vega_like", "greensite_cr826")
RATES = (25, 50, 100, 200, 400)
WINDOW = 5.0


def at_rate(name: str, rate: int) -> Nominal:
    """A nominal with controller and sensors at a rate [Hz]."""
    nominal = load_nominal(name)
    period, simulation = 1.0 / rate, dataclasses.replace(nominal.simulation, step=0.0005)
    return dataclasses.replace(nominal, controller=dataclasses.replace(nominal.controller, period=period),
                               sensors=dataclasses.replace(nominal.sensors, period=period),
                               simulation=nominal.simulation if rate < 400 else simulation)


def clean_statuses(nominal: Nominal, seed: int) -> list[EstimateStatus]:
    """The clean_statuses of the windows of a clean flight."""
    flight = fly_whole(nominal, seed)
    config = Config(window=WINDOW, sample_period=flight.period, formulation="filtered", model=onboard_model(nominal))
    return [estimate.status for estimate in run(config, flight.samples())[0]]


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("name", NAMES)
def test_a_clean_flight_is_not_contradicted_at_any_rate(name, rate):
    assert EstimateStatus.MODEL not in clean_statuses(at_rate(name, rate), 7002)


@pytest.mark.campaign
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("name", NAMES)
def test_at_most_one_percent_of_clean_windows_are_contradicted(name, rate):
    nominal = at_rate(name, rate)
    every = [status for seed in range(7000, 7100) for status in clean_statuses(nominal, seed)]
    assert every.count(EstimateStatus.MODEL) <= 0.01 * len(every)
