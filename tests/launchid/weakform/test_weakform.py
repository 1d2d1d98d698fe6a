"""The weak form: the truth under gyro noise and disturbances in any mix, the law of its weights, and its judge.

The laws are numpy's; flights are `public_flights`, a6 = 2 and k1 = -6.
"""

import dataclasses
import itertools
import math

import numpy as np
import public_flights as flights
import pytest

import launchid
from launchid.judge.question import Question, question
from launchid.log.check import checked
from launchid.log.log import log_of
from launchid.sources import read_log
from launchid.weakform.fit import SPAN, gls, noise_likelihoods, spectrum, whiteness
from launchid.weakform.late import acting_later, without_beginnings
from launchid.weakform.modes import FAST_THETA, sines, term_modes
from launchid.weakform.prepare import usable
from launchid.weakform.rows import Rows
from sim.nominal import load_nominal
from sim.plant import parameters

TERMS = ("theta", "beta", "1")
H = 0.01


def rows_of(columns: dict[str, np.ndarray]) -> Rows:
    rows = usable(checked(log_of(columns)))
    assert rows is not None
    return rows


def asked(columns: dict[str, np.ndarray], terms: tuple[str, ...] = TERMS, optional: tuple[str, ...] = ()) -> Question:
    return question(rows_of(columns), terms, optional)


def named(columns: dict[str, np.ndarray], terms: tuple[str, ...] = TERMS) -> list[str]:
    return [lack.what for lack in asked(columns, terms).lacks]


def driven(seconds: float, gyro: float, disturbance: float, seed: int, quiet: float = 0.0) -> Rows:
    """theta_ddot = -4 theta - 6 beta + 0.1 + white disturbance, without any other noise; beta of eight tones, next to
    none in the last `quiet` s."""
    rng, n = np.random.default_rng(seed), round(seconds / H)
    t = np.arange(n) * H
    beta = 0.02 * np.sum([np.sin(w * t + rng.uniform(0.0, 6.28)) for w in np.linspace(0.5, 12.0, 8)], axis=0)
    beta *= np.where(t < seconds - quiet, 1.0, 1e-4)
    w, c, s = 2.0, math.cos(2.0 * H), math.sin(2.0 * H)
    x, v = np.zeros(n), np.zeros(n)
    for k in range(n - 1):
        u = (-6.0 * 0.5 * (beta[k] + beta[k + 1]) + 0.1) / w**2
        x[k + 1] = u + (x[k] - u) * c + v[k] / w * s
        v[k + 1] = -(x[k] - u) * w * s + v[k] * c + disturbance * rng.normal() * H
    return Rows(t, x, np.zeros(n), v + gyro * rng.normal(size=n), beta, True, False, np.array([0, n]))


# ---- the law


def test_the_sines_make_every_mode_independent_whatever_the_levels():
    n, q, r = 40, 0.3, 2.0
    covariance = (q + 2.0 * r) * np.eye(n) - r * (np.eye(n, k=1) + np.eye(n, k=-1))
    s = sines(np.eye(n))
    inside = s @ covariance @ s.T
    expected = q + r * (2.0 - 2.0 * np.cos(np.pi * np.arange(1, n + 1) / (n + 1)))
    assert np.allclose(s @ s.T, np.eye(n)) and np.allclose(inside, np.diag(expected))


@pytest.mark.parametrize(("gyro", "disturbance"), [(1e-5, 0.02), (2e-3, 1e-4), (5e-4, 0.005)])
def test_deviations_are_what_the_errors_are_at_any_mix(gyro, disturbance):
    off = []
    for seed in range(60):
        fit = gls(term_modes(driven(5.0, gyro, disturbance, seed), TERMS))
        off.append((fit.xi - (-4.0, -6.0, 0.1)) / np.sqrt(np.diag(fit.covariance)))
    rms = np.sqrt(np.mean(np.square(off), axis=0))
    assert np.all(rms[:2] > 0.7) and np.all(rms < 1.3)


def test_noise_of_the_attitude_does_not_draw_a6_to_zero():
    """What it adds to the products is taken off them; where it is most of them, nothing is said."""
    off, plain = [], []
    for seed in range(20):
        rows = driven(10.0, 1e-4, 1e-3, seed)
        noise = 0.04 * float(np.std(rows.theta))
        theta = rows.theta + noise * np.random.default_rng(seed).normal(size=len(rows.t))
        known = Rows(rows.t, theta, rows.gamma, rows.theta_dot, rows.beta, True, False, rows.bounds, noise**2, 0.0)
        off.append(gls(term_modes(known, TERMS)).xi[0])
        blind = Rows(rows.t, theta, rows.gamma, rows.theta_dot, rows.beta, True, False, rows.bounds)
        plain.append(gls(term_modes(blind, TERMS)).xi[0])
    assert abs(np.mean(off) + 4.0) < abs(np.mean(plain) + 4.0) and abs(np.mean(off) + 4.0) < 0.02
    hidden = Rows(rows.t, rows.theta + 0.3 * noise / 0.04 * np.random.default_rng(1).normal(size=len(rows.t)),
                  rows.gamma, rows.theta_dot, rows.beta, True, False, rows.bounds, (0.3 * noise / 0.04) ** 2, 0.0)
    fit = gls(term_modes(hidden, TERMS))
    assert fit.is_singular or abs(fit.xi[0] + 4.0) < 4.0 * math.sqrt(fit.covariance[0, 0])


@pytest.mark.parametrize(("period", "noise"), [
    (0.005, {"beta_std": 1.5e-3}),
    (0.02, {"theta_std": 1e-3, "theta_dot_std": 1e-4, "beta_std": 1e-5})], ids=["nozzle", "attitude"])
def test_noise_of_a_sensor_under_feedback_biases_nothing(period, noise):
    """Noise of the nozzle's sensor drew k1 8 % to zero, what the controller answers to that of the attitude made a6 and
    k1 3 % larger: windows weighted together, whose deviation is below 1 %."""
    nominal = load_nominal("constant")
    nominal = dataclasses.replace(
        nominal, sensors=dataclasses.replace(nominal.sensors, period=period, **noise),
        controller=dataclasses.replace(nominal.controller, period=period),
        simulation=dataclasses.replace(nominal.simulation, duration=60.0))
    told = [each for seed in range(2) for each in
            launchid.identify(launchid.simulate(nominal, seed=seed), window=10.0).report["windows"] if each["valid"]]
    value, std = (np.array([[each[name] for name in pair] for each in told]) for pair in (
        ("a6", "k1"), ("a6_std", "k1_std")))
    weight = 1.0 / std**2
    off = np.sum(weight * (value - (2.0, -7.0)), axis=0) / np.sum(weight, axis=0)
    assert len(told) >= 10 and np.all(np.abs(off) < 3.0 / np.sqrt(np.sum(weight, axis=0)))
    assert np.all(np.abs(off) < 0.02 * np.array([2.0, 7.0]))


@pytest.mark.parametrize(("period", "noise"), [(0.02, 7e-4), (0.01, 3.5e-4), (0.005, 1e-3)])
def test_noise_of_the_nozzle_s_sensor_is_told_from_its_motion(period, noise):
    """White noise is as large in differences of any order; what answers theta, its rate or the command acts."""
    nominal = load_nominal("constant")
    nominal = dataclasses.replace(nominal, sensors=dataclasses.replace(nominal.sensors, period=period, beta_std=noise),
                                  controller=dataclasses.replace(nominal.controller, period=period))
    columns = read_log(launchid.simulate(nominal, seed=3)).measured()
    assert math.sqrt(rows_of(columns).beta_noise) == pytest.approx(noise, rel=0.1)
    command = {name: x for name, x in columns.items() if name != "beta_cmd"} | {"beta": columns["beta_cmd"]}
    assert math.sqrt(rows_of(command).beta_noise) < 0.05 * float(np.std(np.diff(columns["beta_cmd"])))


def test_the_likelihood_of_the_noise_is_that_of_the_whole_covariance():
    """Restricted (Patterson and Thompson 1971), of as many modes as bins: each has its own weight."""
    m = term_modes(driven(0.8, 1e-3, 0.01, 3), TERMS)
    order = np.argsort(m.curl)
    value = np.zeros((len(SPAN), len(SPAN)))
    for i, j in itertools.product(range(0, len(SPAN), 6), repeat=2):
        s = 1.0 + 10.0**SPAN[i] * m.curl + 10.0**SPAN[j] / m.curl
        sums = np.split(np.arange(len(s)), np.unique(np.round(np.geomspace(1.0, len(s), len(s))).astype(int))[:-1])
        s[order] = np.concatenate([np.full(len(at), s[order][at].mean()) for at in sums])
        gram = m.phi.T @ (m.phi / s[:, None])
        e = m.y - m.phi @ np.linalg.solve(gram, m.phi.T @ (m.y / s))
        n, q = m.phi.shape
        value[i, j] = -0.5 * ((n - q) * math.log(e @ (e / s)) + np.sum(np.log(s)) + np.linalg.slogdet(gram)[1])
    told = noise_likelihoods([m])[0].restricted[::6, ::6]
    assert np.allclose(told - told[0, 0], value[::6, ::6] - value[0, 0], rtol=1e-8, atol=1e-8)


def test_whiteness_is_a_p_value_of_white_rests():
    low = 0
    for seed in range(40):
        rows = driven(10.0, 1e-3, 1e-3, seed)
        m = term_modes(rows, TERMS)
        _, squares, many, _ = spectrum(gls(m), m, 12)
        low += whiteness(squares, many) < 0.05
    assert low <= 6


def test_a_window_in_which_beta_may_do_nothing_is_not_valid():
    """The swing goes on and tells a6 to a per cent; k1 is zero within its deviation: any column would do as well."""
    rows = driven(40.0, 1e-3, 0.02, 1, quiet=10.0)
    columns = {"t": rows.t, "theta": rows.theta + 1e-5 * np.random.default_rng(2).normal(size=len(rows.t)),
               "theta_dot": rows.theta_dot, "beta": rows.beta}
    found = launchid.identify(columns, window=10.0).report["windows"]
    assert [w["valid"] for w in found] == [True, True, True, False] and found[3]["status"] == "LOW_INFORMATION"


# ---- the judge


@pytest.fixture(scope="module")
def flown() -> dict[str, np.ndarray]:
    columns = flights.fly(30.0)
    return {name: columns[name] for name in ("t", "theta", "theta_dot", "beta")}


def test_of_a_clean_flight_nothing_is_lacking(flown):
    made = asked(flown, optional=("theta_dot",))
    assert made.lacks == [] and made.unchecked == ""
    assert made.lead is not None and abs(made.lead.value) < 5.0 * made.lead.std < 0.01


@pytest.mark.parametrize(("choices", "term", "size"), [
    ({"moment": 0.2}, "1", 0.2), ({"damping": -1.5}, "theta_dot", -1.5),
    ({"square": 3.0, "amplitude": 0.1}, "beta^2", -18.0)])
def test_a_term_that_acts_is_named_with_its_size(choices, term, size):
    columns = flights.fly(20.0, **choices)
    plain = {name: columns[name] for name in ("t", "theta", "theta_dot", "beta")}
    made = asked(plain, ("theta", "beta") if term == "1" else TERMS)
    assert [lack.what for lack in made.lacks] == [term] and made.lacks[0].size == pytest.approx(size, rel=0.05)
    assert made.lead is not None and abs(made.lead.value) < 0.002   # damping looks like a beta that acts sooner


def test_a_clock_that_runs_slow_is_no_delay(flown):
    late = np.interp(flown["t"] * 1.005, flown["t"], flown["beta"])
    assert named(flown | {"beta": late}) == ["clock"]


def test_a_delay_that_comes_and_goes_is_no_clock(flown):
    """Of measured flights of one craft with 50 ms the clocks were said to part by -0.6 to 0.8 ms a second."""
    t = flown["t"]
    late = np.array([0.02, 0.05, 0.09, 0.03, 0.05, 0.07])[np.minimum(t // 5.0, 5.0).astype(int)]
    found = named(flown | {"beta": np.interp(t + late, t, flown["beta"])})
    assert found and "clock" not in found


def test_an_input_that_repeats_is_no_placebo():
    """A doublet series is what textbooks ask for: all windows were refused."""
    t = np.arange(0.0, 40.0, H)
    once = driven(10.0, 1e-3, 1e-3, 3).beta
    beta = np.tile(once, 4)
    x, v = np.zeros(len(t)), np.zeros(len(t))
    for k in range(len(t) - 1):
        a = -4.0 * x[k] - 0.8 * v[k] - 6.0 * 0.5 * (beta[k] + beta[k + 1])
        x[k + 1], v[k + 1] = x[k] + H * v[k] + 0.5 * H * H * a, v[k] + H * a
    rate = v + 1e-3 * np.random.default_rng(1).normal(size=len(t))
    assert "placebo" not in named({"t": t, "theta": x, "theta_dot": rate, "beta": beta}, (*TERMS, "theta_dot"))


def test_a_flight_path_that_nobody_logged_is_told_as_that():
    """A gravity turn: the acceleration of beta was said to act."""
    columns = flights.fly(30.0)
    turn = 0.03 * columns["t"]
    columns = {name: columns[name] for name in ("t", "theta", "theta_dot", "beta")}
    columns |= {"theta": columns["theta"] + turn, "theta_dot": columns["theta_dot"] + 0.03}
    assert named(columns)[:1] == [FAST_THETA]
    assert named(columns | {"gamma": turn}) == []
    rows = np.arange(len(turn)) % 300 < 285   # stretches of 3 s: the fast part is that of the whole log
    assert named({name: x[rows] for name, x in columns.items()})[:1] == [FAST_THETA]


def test_what_cannot_be_asked_says_what_would_allow_it(flown):
    rows = np.arange(len(flown["t"])) % 40 < 34
    assert "without a gap" in asked({name: x[rows] for name, x in flown.items()}).unchecked
    assert "too few" in asked({name: x[:20] for name, x in flown.items()}).unchecked
    still = asked(flown | {"beta": np.full(len(flown["t"]), 0.01)}).unchecked
    assert "hardly move" in still and "too few" not in still


@pytest.mark.parametrize(("name", "least", "most"),
                         [("vega_like", 0, 8), ("greensite_cr826", 0, 12), ("constant", 10, 14)])
def test_a_trimmed_vehicle_that_changes_is_far_off_in_no_window(name, least, most):
    """A change of a6 within a window goes into a6 with the trim: it counts as not known, where the log shows one."""
    made = launchid.identify(launchid.simulate(name, seed=21))
    valid = [e for e in made.estimates if e.valid]
    assert least <= len(valid) <= most
    for e in valid:
        a6, k1 = map(float, parameters(load_nominal(name), np.array(0.5 * (e.t_start + e.t_end)), 1.0, 1.0))
        assert abs(e.a6 - a6) < 4.0 * e.a6_std and abs(e.k1 - k1) < 4.0 * e.k1_std


# ---- a beta that acts later


@pytest.mark.parametrize(("order", "response"), [
    (1, lambda x: 1.0 - np.exp(-x)), (2, lambda x: 1.0 - np.exp(-2.0 * x) * (1.0 + 2.0 * x))])
@pytest.mark.parametrize("is_held", [True, False])
def test_a_step_behind_a_lag_is_its_step_response(order, response, is_held):
    """Of both stretches of a log, with a gap between them; the beginnings, which nobody knows, can be left out."""
    t = np.concatenate([np.arange(100), np.arange(150, 300)]) * H
    step = np.where(np.arange(len(t)) % 100 < 20, 1.0, 3.0)
    rows = dataclasses.replace(rows_of({"t": t, "theta": np.sin(t), "beta": step}), is_held=is_held)
    late = acting_later(rows, 0.0, 0.1, order)
    within = np.linspace(0.0, H, 101) if is_held else np.array([0.5 * H])   # a held beta is the mean over each step
    since = np.maximum(t[:100, None] - t[20] + within, 0.0)
    assert np.allclose(late.beta[:100], 1.0 + 2.0 * response(since / 0.1).mean(axis=1), atol=1e-4 if is_held else 0.03)
    left = without_beginnings(late, 0.3)
    assert left.t[0] == pytest.approx(0.3) and left.t[left.bounds[1]] == pytest.approx(1.8)


def test_a_held_beta_delayed_by_parts_of_a_row_is_the_mean_of_what_acts():
    """Behind a lag, at delays of -0.4 to 2.3 rows: of the response, on a grid 200 times as fine."""
    t, rng = np.arange(200) * H, np.random.default_rng(3)
    command = rng.normal(size=200)
    command[-3:] = command[-4]
    rows = dataclasses.replace(rows_of({"t": t, "theta": np.sin(t), "beta": command}), is_held=True)
    fine = np.arange(200 * 200) * H / 200
    for delay in (-0.4 * H, 0.0, 0.7 * H, 2.3 * H):
        at = np.floor((fine - delay) / H + 1e-9).astype(int)
        nozzle = command[np.clip(at, 0, 199)] - command[0]
        acting, gone = np.zeros(len(fine)), math.exp(-H / 200 / 0.035)
        for k in range(1, len(fine)):
            acting[k] = gone * acting[k - 1] + (1.0 - gone) * nozzle[k - 1]
        mean = command[0] + acting.reshape(200, 200).mean(axis=1)
        assert np.allclose(acting_later(rows, delay, 0.035).beta, mean, atol=0.01)


def test_two_clocks_are_no_late_beta():
    """beta's clock is 0.5 % fast: no one delay is right, and windows are refused for it."""
    flown = flights.fly(60.0)
    made = launchid.identify(flown | {"beta": np.interp(1.005 * flown["t"], flown["t"], flown["beta"])}, window=5.0)
    assert "late" not in made.report and not any(each["valid"] for each in made.report["windows"][6:])


def test_of_a_free_swing_the_rest_is_identified_as_advised():
    """theta_ddot = -4 theta - 0.3 theta_dot + 0.2 with a beta that never moves; of a log at rest nothing is advised."""
    rng, t = np.random.default_rng(0), np.arange(2000) * H
    swing = 0.3 * np.exp((-0.15 + 1j * math.sqrt(3.9775)) * t)
    log = {"t": t, "theta": swing.real + 0.05, "beta": np.full(2000, 0.02),
           "theta_dot": (swing * (-0.15 + 1j * math.sqrt(3.9775))).real + 1e-3 * rng.normal(size=2000)}
    made = launchid.identify(log, window="all").report
    assert [lack["what"] for lack in made["lacks"]] == ["beta at rest"] and not made["windows"][0]["valid"]
    (window,) = launchid.identify(log, window="all", library=made["next"].split()[-1]).report["windows"]
    for term, truth in {"theta": -4.0, "theta_dot": -0.3, "1": 0.2}.items():
        assert abs(window["terms"][term] - truth) < 4.0 * window["terms_std"][term] < 0.02
    at_rest = launchid.identify(log | {"theta": 0.0 * t, "theta_dot": 1e-3 * rng.normal(size=2000)}).report
    assert "unchecked" in at_rest and "--library" not in at_rest.get("next", "")


def test_a_controller_that_answers_noise_at_once_does_not_say_when_beta_acts():
    """Behind a friction nothing moves in two thirds of the log: there beta follows the noise of theta, and with
    coefficients of their own 40 ms and a lag were found."""
    rng, n, moving = np.random.default_rng(0), 9000, 3000
    t, fine = np.arange(n) * H, H / 5
    wanted = 0.3 * np.sin(2.0 * math.pi * (0.1 * t + t**2 / 120.0)) * (np.arange(n) < moving)
    theta, beta, (x, v), whole = np.zeros(n), np.zeros(n), (0.0, 0.0), 0.0
    for k in range(n):
        theta[k] = x + 1e-4 * rng.normal()
        whole += 0.3 * H * (wanted[k] - theta[k])
        beta[k] = 0.6 * wanted[k] - 0.3 * theta[k] + whole - 0.05 * (theta[k] - theta[max(k - 1, 0)]) / H
        for _ in range(5):
            a = -9.0 * x - v + 30.0 * beta[k - 10] * (k >= 10)
            sticks = abs(v) < 2e-3 and abs(a) < 0.3
            v = 0.0 if sticks else v + fine * (a - 0.3 * np.sign(v))
            x += fine * v
    made = launchid.identify({"t": t, "theta": theta, "beta": beta}, window=5.0,
                             library="theta,beta,theta_dot,1,sign(theta_dot)")
    late, (a6, k1) = made.report["late"], np.array([[each.a6, each.k1] for each in made.estimates[:5]]).T
    assert late["lag"] is None and late["delay"]["value"] == pytest.approx(0.1, abs=0.01)
    assert a6 == pytest.approx(-9.0, rel=0.05) and k1 == pytest.approx(30.0, rel=0.05)


def test_a_late_beta_on_stamps_that_jitter_is_late():
    rng = np.random.default_rng(3)
    flown = flights.fly(30.0)
    jittered = flown["t"] + H * rng.uniform(-0.2, 0.2, len(flown["t"]))
    made = launchid.identify({name: np.interp(jittered, flown["t"], x) for name, x in flown.items()
                              if name in ("t", "theta", "theta_dot")} | {
        "t": jittered, "beta": np.interp(jittered + 0.04, flown["t"], flown["beta"])}, window=5.0)
    assert made.report["late"]["delay"]["value"] == pytest.approx(0.04, abs=0.01)
