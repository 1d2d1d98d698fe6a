"""The margins of a flight: python-control's numbers, brute force, textbook loops; intervals, warnings, refusals."""

import json
import math
import warnings
from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest
from test_lft import delayed, held

import launchid
from launchid.main import main
from launchid.robustness import flight_margins as fm
from launchid.robustness.blocks import Plants, plants_of
from launchid.robustness.lft import lft_at, loop_gain, sample, spectral_radius
from launchid.robustness.loops import loops
from launchid.robustness.margin_spread import (
    MARGIN_NAMES,
    Interval,
    Known,
    margin_spread,
    margin_table,
)
from sim.effects import effect
from sim.errors import InputError
from sim.nominal import Actuator, Controller, Nominal, Required, constant_profile, load_nominal, nominal_lines

control = pytest.importorskip("control")

CONSTANT = load_nominal("constant")
PD = CONSTANT.controller
CENTRES = [(2.0, -7.0, 50.0, 0.7, 0.0), (2.4, -5.5, 42.0, 0.55, 0.013), (1.3, -9.0, 60.0, 0.9, 0.03),
           (-1.0, -6.0, 50.0, 0.7, 0.02)]
SPREADS = {"calm, servo known": (0.08, 0.3, 0.0, 0.0, 0.0), "wind": (0.9, 0.6, 0.0, 0.0, 0.0),
           "calm, servo estimated": (0.08, 0.1, 2.0, 0.05, 0.001), "servo hardly known": (0.3, 0.5, 8.0, 0.15, 0.004)}


def known(mean: tuple[float, ...], std: tuple[float, ...], correlation: float = -0.6) -> Known:
    covariance = np.diag(np.square(std))
    covariance[0, 1] = covariance[1, 0] = correlation * std[0] * std[1]
    return Known(np.array(mean), covariance)


def frozen(p: tuple[float, ...], nominal: Nominal = CONSTANT) -> Nominal:
    """The nominal with these a6, k1, natural frequency, damping ratio and delay."""
    return replace(nominal, vehicle=constant_profile(p[0], p[1]), actuator=replace(
        nominal.actuator, natural_frequency=p[2], damping_ratio=p[3], delay=p[4]))


# ---- the loops, and their margins


@pytest.mark.parametrize("p", CENTRES)
def test_margins_are_python_controls(p):
    a6, k1, w, zeta, delay = p
    period, tau = PD.period, PD.derivative_time_constant
    a = np.array([[0, 1, 0, 0], [a6, 0, k1, 0], [0, 0, 0, 1], [0, 0, -w * w, -2 * zeta * w]])
    b = np.array([[0], [0], [0], [w * w]])
    whole, rest = int(delay / period + 1e-9), delay - int(delay / period + 1e-9) * period
    late = held(a, b, period - rest)
    move = np.block([[held(a, b, period)[0], late[0] @ held(a, b, rest)[1]], [np.zeros((1, 5))]])
    plant = control.ss(move, np.vstack([late[1], [[1.0]]]), [[1.0, 0, 0, 0, 0]], 0, period)
    law = control.ss(control.tf([PD.kp], [1], period) + PD.kd * control.tf([1, -1], [tau + period, -tau], period))
    loop = -law * control.ss(control.tf([1], [1, *[0] * whole], period)) * plant
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        gains, phases, _, _, at, _ = control.stability_margins(loop, returnall=True, method="frd")
    table = margin_table(loops(plants_of(np.array([p])), PD))[0]
    assert table[0] == pytest.approx(20 * math.log10(a6 / (PD.kp * -k1)) if a6 > 0 else -math.inf)
    assert table[1] == pytest.approx(20 * math.log10(min(g for g in gains if g > 1.0)), rel=1e-6)
    if len(phases):
        assert table[2] == pytest.approx(min(abs(phases)), rel=1e-6)
        assert table[3] == pytest.approx(1e3 * min(np.mod(np.radians(phases), 2 * np.pi) / at), rel=1e-6)


@pytest.mark.parametrize("name", ["constant", "vega_like", "greensite_cr826"])
def test_loops_are_the_lfts(name):
    nominal = load_nominal(name)
    omega = np.geomspace(1e-3, 0.999 * np.pi / nominal.controller.period, 60)
    for delay in (0.0, 0.004, 0.01, 0.023):
        lft = lft_at(delayed(nominal, delay), 50.0)
        delta = np.random.default_rng(1).uniform(-1.0, 1.0, (5, 2))
        a6, k1 = lft.parameters(delta)
        servo = nominal.actuator
        many = loops(Plants(a6, k1, *(np.full(5, x) for x in (servo.natural_frequency, servo.damping_ratio, delay))),
                     nominal.controller)
        assert np.max(np.abs(many.gain(omega) / loop_gain(sample(lft, delta), omega) - 1.0)) < 1e-11


def test_loops_are_stable_where_the_lfts_eigenvalues_are_in_the_circle():
    """Delays of different lengths side by side; some unstable."""
    random = np.random.default_rng(2)
    ends = ((-2, 6), (-12, -1), (8, 60), (0.2, 1.2), (0, 0.12))
    rows = np.column_stack([random.uniform(low, high, 150) for low, high in ends])
    theirs = [spectral_radius(sample(lft_at(frozen(row), 0.0), np.zeros(2))) < 1.0 for row in rows]
    mine = loops(plants_of(rows), PD).stable()
    assert mine.tolist() == theirs and 20 < mine.sum() < 140


def continuous(a6: float, k1: float, kp: float, kd: float) -> np.ndarray:
    """Margins of a PD at 10 kHz behind a servo that is as fast as none."""
    fast = Controller(kp=kp, kd=kd, derivative_time_constant=0.0, period=1e-4)
    return margin_table(loops(plants_of(np.array([[a6, k1, 2e4, 0.7, 0.0]])), fast))[0]


@pytest.mark.parametrize("a6", [0.5, 2.0, 9.0])
def test_the_textbook_gains_keep_6_dB_and_30_degrees(a6):
    """kp = 2 a6/|k1|, kd = sqrt(a6)/|k1|: the gain may halve; atan(x/2) is left at x^4 + x^2 = 3, x = w/sqrt(a6)."""
    table = continuous(a6, -7.0, 2 * a6 / 7.0, math.sqrt(a6) / 7.0)
    crossover = math.sqrt((math.sqrt(13.0) - 1.0) / 2.0)
    assert table[0] == pytest.approx(-6.02, abs=0.005)
    assert math.degrees(math.atan(crossover / 2.0)) == pytest.approx(29.71, abs=0.005)
    assert table[2] == pytest.approx(29.71, abs=0.03)


def test_a_published_launchers_decoupled_loop():
    """HM3 of github.com/nickdambr/dynamics-control-launch-vehicles, report, Task 1: A6 = 3.382 1/s^2, A6/K1 = 0.74, the
    starting gains give 6 dB and 30 degrees.  Every other row of its Tasks 1 to 3 feeds the lateral drift back."""
    k1 = 3.382 / 0.74
    table = continuous(3.382, -k1, 2 * 3.382 / k1, math.sqrt(3.382) / k1)
    assert round(-table[0]) == 6 and round(table[2]) == 30


# ---- what is not known of them


@pytest.mark.parametrize(("mean", "std"), [
    *((CENTRES[2], std) for std in SPREADS.values()), *((mean, SPREADS["servo hardly known"]) for mean in CENTRES[:2])],
    ids=[*SPREADS, "no delay", "ridge of the phase"])
def test_intervals_are_those_of_brute_force(mean, std):
    """The reference is the 2.5 and 97.5 % quantiles of 4,000 drawn loops: each end within 0.25 standard deviations."""
    of = known(mean, std)
    draws = np.random.default_rng(3).multivariate_normal(of.mean, of.covariance, 4000, check_valid="ignore")
    draws[:, 2:4] = np.maximum(draws[:, 2:4], 1e-3)
    table = margin_table(loops(plants_of(draws), PD))
    spread = margin_spread(of, PD)
    for k, name in enumerate(MARGIN_NAMES):
        interval, column = getattr(spread, name), table[:, k]
        found = np.array([interval.low, interval.high])
        if name == "gain_low_db":  # its factor: in dB the tail of a plant that is hardly unstable has no end
            column, found = 10 ** (column / 20.0), 10 ** (found / 20.0)
        ends = np.quantile(column, [0.025, 0.975], method="closest_observation")
        assert found == pytest.approx(ends, abs=0.25 * (ends[1] - ends[0]) / 4.0)
        assert interval.low <= interval.value <= interval.high
        if np.isfinite(table[:, k]).all() and std[0] < 0.9:
            assert interval.std == pytest.approx(np.std(table[:, k]), rel=0.2)
    assert spread.stable == pytest.approx(np.mean(table.any(axis=1)), abs=0.003)


def test_intervals_hold_the_truth_in_95_of_100():
    """Estimates drawn around a truth near the ridge of the phase, where no margin is linear."""
    truth = known(CENTRES[1], SPREADS["servo hardly known"])
    table = margin_table(loops(plants_of(truth.mean[None]), PD))[0]
    drawn = np.random.default_rng(4).multivariate_normal(truth.mean, truth.covariance, 60)
    spreads = [margin_spread(Known(mean, truth.covariance), PD) for mean in drawn]
    for k, name in enumerate(MARGIN_NAMES):
        held_truth = [getattr(each, name).low <= table[k] <= getattr(each, name).high for each in spreads]
        assert 0.87 <= np.mean(held_truth)


def test_the_low_gain_margins_interval_is_fiellers():
    """a6/|k1| <= c is a half-plane: its probability is known exactly, and so are both ends."""
    of = known((2.0, -7.0, 50.0, 0.7, 0.0), (0.6, 0.8, 0, 0, 0))
    spread = margin_spread(of, PD)
    for end, probability in ((spread.gain_low_db.low, 0.025), (spread.gain_low_db.high, 0.975)):
        slope = np.array([1.0, PD.kp * 10 ** (end / 20.0)])  # of a6 + c kp k1 <= 0
        std = math.sqrt(slope @ of.covariance[:2, :2] @ slope)
        assert NormalDist().cdf(-float(slope @ of.mean[:2]) / std) == pytest.approx(probability, abs=3e-4)


def test_a_plant_that_may_be_stable_has_a_one_sided_low_gain_margin():
    spread = margin_spread(known((1.0, -7.0, 50.0, 0.7, 0.0), (0.8, 0.1, 0, 0, 0)), PD)
    assert spread.gain_low_db.low == -math.inf and -25.0 < spread.gain_low_db.high < -6.0
    assert math.isnan(spread.gain_low_db.std) and math.isfinite(spread.phase_deg.low)
    assert fm.margins_json(fm.Judged(fm.OK_MARK, None, spread))["gain_low_db"]["low"] is None


def test_a_loop_that_may_be_unstable_says_how_probably():
    """Statically lost where kp |k1| < a6: a half-plane again; and what may be lost keeps 0 of every margin."""
    of = known((6.0, -6.0, 50.0, 0.7, 0.0), (1.0, 0.5, 0, 0, 0), 0.0)
    spread = margin_spread(of, PD)
    probability = NormalDist().cdf((1.2 * 6.0 - 6.0) / math.hypot(1.0, 1.2 * 0.5))
    assert spread.stable == pytest.approx(probability, abs=0.01)
    assert spread.gain_low_db.high == spread.phase_deg.low == spread.gain_high_db.low == spread.delay_ms.low == 0.0
    assert margin_spread(known((9.0, -6.0, 50.0, 0.7, 0.0), (0.1, 0.1, 0, 0, 0)), PD).phase_deg == Interval(0, 0, 0, 0)


# ---- of a flight


@pytest.fixture(scope="module")
def flight():
    return launchid.simulate("constant", seed=1, effects="control_loss:fraction=0.45,time=32")


@pytest.fixture(scope="module")
def made(flight):
    return launchid.margins(flight, "constant", tracked=True)


def test_margins_of_a_flight_are_the_frozen_truths(made):
    """The margins are judged before and after 45 % of k1 are lost."""
    for window, tracked in ((made.windows[4], made.windows[4].tracked), (made.windows[9], made.windows[13].tracked)):
        k1 = -7.0 if window.t_end < 32.0 else -7.0 * 0.55
        truth = margin_table(loops(plants_of(np.array([[2.0, k1, 50.0, 0.7, 0.0]])), PD))[0]
        for spread, most in ((window.window.spread, 4.0), (tracked.spread, 4.0)):
            for k, name in enumerate(MARGIN_NAMES):
                interval = getattr(spread, name)
                half = max(interval.high - interval.value, interval.value - interval.low) / 1.96
                assert abs(interval.value - truth[k]) <= most * half


def test_a_windows_a6_and_k1_share_with_a_tracked_mode_what_least_squares_says():
    """A window's rows tell (a6, k1, d), other rows d alone, and a6 and k1 are solved for without those: then the errors
    of a6, k1 and of d from all rows share what the estimate of all rows has."""
    random = np.random.default_rng(3)
    rows = random.standard_normal((12, 4))
    window = rows.T @ rows
    others = np.diag([0.0, 0.0, *random.uniform(5.0, 20.0, 2)])
    gain_window, gain_all = np.linalg.inv(window), np.linalg.inv(window + others)
    # errors are gain times score: that of the window is in both
    exact = (gain_window @ window @ gain_all)[:2, 2:]
    covariance = np.zeros((8, 8))
    covariance[:2, :2], covariance[6:, 6:] = gain_window[:2, :2], np.diag(np.diag(gain_all)[2:])
    fm.share_modes(covariance, gain_all)
    assert np.allclose(covariance[:2, 6:], exact) and np.allclose(covariance[6:, 6:], gain_all[2:, 2:])
    assert np.allclose(covariance, covariance.T)


def test_what_is_shared_is_never_more_than_there_is():
    covariance, shared = np.diag([1.0, 1.0, 0, 0, 0, 0, 4.0, 0.0]), np.diag([9.0, 9.0, 4.0, 0.0])
    shared[1, 2] = shared[2, 1] = 5.9
    fm.share_modes(covariance, shared)
    assert np.linalg.eigvalsh(covariance).min() > -1e-12 and covariance[1, 6] > 1.9 and not covariance[7].any()


def test_a_window_of_a_sudden_change_has_no_margins(made):
    statuses = {window["t_start"]: window["status"] for window in made.report["windows"]}
    assert statuses[30.0] == fm.CHANGE_MARK and statuses[25.0] == statuses[35.0] == "OK"
    assert made.windows[6].window.spread is None and made.windows[6].tracked.status == "OK"  # settled at 35 s
    nothing = made.report["windows"][6]["phase_deg"]
    assert nothing == {"value": None, "std": None, "low": None, "high": None}


def test_the_json_is_the_contracts(made):
    said = json.loads(made.to_json())
    assert list(said) == ["windows", "actuator", "below", "may_be_below", "findings", "assumed", "controller", "gains",
                          "gains_of", "damping", "excitation", "headline", "next"]
    first = said["windows"][0]
    assert list(first) == ["t_start", "t_end", "valid", "status", *MARGIN_NAMES, "stable", "ms", "crossover",
                           "crossings", "controller", "tracked"]
    assert first["ms"] == pytest.approx(1.0 / first["modulus_margin"]["value"]) and len(first["crossover"]) == 1
    assert said["controller"] == {"source": "nominal", "kp": PD.kp, "kp_std": 0.0, "kd": PD.kd, "kd_std": 0.0,
                                  "period": PD.period}
    assert set(said["gains"]) == {"kp", "kd"} and all(least < 1.0 < most for least, most in said["gains"].values())
    assert list(first["phase_deg"]) == ["value", "std", "low", "high"] and list(first["stable"]) == ["probability"]
    assert set(said["actuator"]) == {"natural_frequency", "damping_ratio", "delay"}
    assert said["actuator"]["natural_frequency"] == {"value": 50.0, "std": 0.0}


def test_a_contradicted_model_has_no_margins():
    """An offset that the nominal does not declare."""
    found = launchid.margins(launchid.simulate("constant", seed=2, effects="attitude_bias:angle=0.02"), "constant",
                             tracked=True)
    refused = [window for window in found.windows if window.window.status == "MODEL"]
    assert refused and all(not each.window.valid and not each.tracked.valid for each in refused)


def test_identified_windows_have_the_same_margins(flight, made):
    found = launchid.identify(flight, "constant", window=5.0, tracked=True).margins()
    assert found.to_json() == made.to_json()
    assert "tracked" not in launchid.identify(flight, "constant", window=5.0).margins().report["windows"][0]


def test_damping_and_a_servo_of_first_order_are_in_the_loop():
    """The margins of python-control's loop, and no status but OK."""
    lag = replace(CONSTANT, actuator=Actuator(time_constant=0.03, command_noise_std=7e-4, deflection_limit=0.12),
                  effects=(effect("aero_damping", coefficient=0.4),),
                  simulation=replace(CONSTANT.simulation, duration=20.0))
    found = launchid.margins(launchid.simulate(lag, seed=3), lag)
    period, tau = PD.period, PD.derivative_time_constant
    a = np.array([[0, 1, 0], [2.0, -0.4, -7.0], [0, 0, -1 / 0.03]])
    plant = control.ss(*held(a, np.array([[0], [0], [1 / 0.03]]), period), [[1.0, 0, 0]], 0, period)
    law = control.ss(control.tf([PD.kp], [1], period) + PD.kd * control.tf([1, -1], [tau + period, -tau], period))
    _, phase, least, *_ = control.stability_margins(-law * plant, method="frd")
    for each in found.windows:
        assert each.window.status == "OK"
        spread = each.window.spread
        for right, margin in ((phase, spread.phase_deg), (least, spread.modulus_margin)):
            assert abs(right - margin.value) < max(margin.high - margin.value, margin.value - margin.low) + 1e-3
    assert set(found.report["actuator"]) == {"time_constant", "delay"}


# ---- what is required


def test_windows_below_are_listed_and_said(flight, made):
    demand = made.windows[4].window.spread.phase_deg.value
    asked = replace(CONSTANT, margins=Required(gain_db=6.0, phase_deg=demand))
    found = launchid.margins(flight, asked, tracked=True)
    listed = {(each["t_start"], each["estimate"], each["margin"]) for each in found.report["below"]}
    for each, window in zip(found.windows, made.windows, strict=True):
        for of in ("window", "tracked"):
            spread = getattr(window, of).spread
            certain = spread is not None and spread.phase_deg.high < demand
            assert ((each.t_start, of, "phase_deg") in listed) == certain
    assert listed and found.report["may_be_below"]
    assert f"phase margin (window) is below {demand:g} degrees in" in found.summary()
    assert "may be below" in found.summary() and "all keep" not in found.summary()
    missed = {each["t_start"] for each in found.report["below"] + found.report["may_be_below"]
              if each["estimate"] == "window"}
    valid = sum(each["valid"] for each in found.report["windows"])
    kept = f"{valid - len(missed)} keep" if valid > len(missed) else "none keeps"
    assert f"{valid} of 14 windows have margins; of those {kept} what" in found.summary()


def test_the_nominals_margins_are_read_checked_and_written(tmp_path):
    text = "\n".join(nominal_lines(CONSTANT, tmp_path / "a.toml"))
    assert "[margins]" not in text
    path = tmp_path / "b.toml"
    path.write_text(text + "\n[margins]\ngain_db = 9.0\ndelay_ms = 40\n")
    found = load_nominal(path)
    assert found.margins == Required(9.0, 30.0, 40.0)
    assert load_nominal_of(found, tmp_path).margins == found.margins
    path.write_text(text + "\n[margins]\nphase_deg = -1.0\n")
    with pytest.raises(InputError, match=r"margins.phase_deg = -1.0: expected a number of at least 0"):
        load_nominal(path)


def load_nominal_of(nominal: Nominal, folder) -> Nominal:
    path = folder / "again.toml"
    path.write_text("\n".join(nominal_lines(nominal, path)) + "\n")
    return load_nominal(path)


# ---- a servo that is not known


UNKNOWN = {"natural_frequency_sigma": 0.3, "damping_ratio_sigma": 0.3, "delay_sigma": 0.02}


def unsure(**sections) -> Nominal:
    return replace(CONSTANT, actuator=replace(CONSTANT.actuator, **UNKNOWN), **sections)


@pytest.fixture(scope="module")
def slow():
    """A flight whose servo has 36 rad/s instead of 50 and 15.2 ms of delay."""
    true = replace(CONSTANT, simulation=replace(CONSTANT.simulation, duration=30.0),
                   actuator=replace(CONSTANT.actuator, natural_frequency=36.0, delay=0.0152))
    return launchid.simulate(true, seed=5)


@pytest.fixture(scope="module")
def estimated(slow):
    return launchid.margins(slow, unsure(), tracked=True)


def test_an_unknown_servo_is_estimated_and_is_in_the_margins(estimated):
    found = estimated
    std = np.sqrt(np.diag(found.servo.covariance))
    assert np.all(np.abs(found.servo.mean - [36.0, 0.7, 0.0152]) < 3.5 * std) and np.all(std < [1.0, 0.03, 1e-3])
    said = found.report["actuator"]["delay"]
    assert said == {"value": found.servo.mean[2], "std": std[2]}
    truth = margin_table(loops(plants_of(np.array([[2.0, -7.0, 36.0, 0.7, 0.0152]])), PD))[0]
    held_truth = np.array([[getattr(of.spread, name).low <= x <= getattr(of.spread, name).high
                            for name, x in zip(MARGIN_NAMES, truth, strict=True)]
                           for window in found.windows for of in (window.window, window.tracked)])
    assert held_truth.mean() > 0.85 and len(held_truth) == 12
    assert "servo as estimated" in found.summary()


def test_a_known_servo_that_is_another_one_has_no_margins(slow):
    """Without the servo's sigma the phase margin would be beyond its interval in every window."""
    found = launchid.margins(slow, CONSTANT)
    assert [each["status"] for each in found.report["windows"]] == ["MODEL"] * 6


def test_without_the_command_the_servo_is_as_declared_and_that_is_said(slow):
    """The interval of the delay margin is as wide as what was declared."""
    columns = {name: getattr(slow.flight, name) for name in ("t", "theta", "theta_dot", "beta")}
    found = launchid.margins(columns, unsure())
    assert found.servo.mean == pytest.approx([50.0, 0.7, 0.0], abs=1e-3)
    assert np.sqrt(np.diag(found.servo.covariance)) == pytest.approx([15.0, 0.21, 0.02], rel=1e-3)
    assert any("without the command nothing is known of the servo's" in each for each in found.warnings)


# ---- the command, the picture


def test_the_command_writes_what_python_has(flight, made, tmp_path, capsys):
    log, answer = tmp_path / "a.csv", tmp_path / "a.json"
    flight.write(log)
    assert main(["margins", str(log), "constant", "--tracked", "--json", str(answer)]) == 0
    said, python = json.loads(answer.read_text()), json.loads(made.to_json())
    assert str(log) in said.pop("next") and "launchid compare" in python.pop("next")
    assert said == python
    assert "13 of 14 windows have margins; of those all keep what [margins] requires" in capsys.readouterr().out
    assert main(["margins", str(log), "constant", "--window", "100"]) == 0
    assert "no window of 100 s is complete" in capsys.readouterr().out
    assert main(["margins", str(log), "pendulum_linear"]) == 3
