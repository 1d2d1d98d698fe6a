"""The foreign judge itself: JSBSim's J246 obeys the nominal that the harness writes, and its flights repeat.

Needs the `jsbsim` package (extra `judges`).
"""

import math

import numpy as np
import pytest

pytest.importorskip("jsbsim", reason="JSBSim (extra `judges`) is not installed")

from foreign import j246, j246_cases

from launchid.log.log import read_log
from sim.nominal import load_nominal

SEED, DURATION = 1, 24.0  # s
UNMODELLED = 0.05         # share of theta_ddot's variance that the nominal may leave: its declared noise leaves 0.003


@pytest.fixture(scope="module")
def calm() -> j246.Flight:
    return j246.fly(j246.Faults(), SEED, DURATION)


def integrated(values: np.ndarray) -> np.ndarray:
    """(n,) trapezoidal integral over the log's rows."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]))]) * j246.PERIOD


def test_the_nominal_predicts_theta_ddot(calm):
    left, all_of_it = j246_cases.unexplained(calm), calm.truth["theta_ddot"]
    assert np.var(left) < UNMODELLED * np.var(all_of_it)
    assert abs(float(np.std(left)) / j246.NOISE["moment"] - 1.0) < 0.1   # what is left is the noise that was put in
    slow = np.convolve(left, np.full(200, 1 / 200), "valid")             # 2 s means: nothing stays
    assert np.max(np.abs(slow)) < 4.0 * j246.NOISE["moment"] / math.sqrt(200)


def test_the_nominal_s_k1_and_a6_are_those_of_a_regression_on_jsbsim_s_own_acceleration():
    """Finite differences by flight: two flights that differ in how the nozzle moves, in a gust."""
    base = j246.fly(j246.Faults(), SEED, DURATION).truth
    ref = j246.reference()
    for faults, term, parameter in ((j246.Faults(lag=15.0), "beta", "k1"),
                                    (j246.Faults(gust=15.0, gust_time=2.0, gust_duration=8.0), "alpha", "a6")):
        moved = j246.fly(faults, SEED, DURATION).truth
        change = moved["theta_ddot"] - base["theta_ddot"]
        columns = np.column_stack([ref[name][:len(change)] * (moved[of] - base[of])
                                   for name, of in (("a6", "alpha"), ("k1", "beta"))])
        assert np.ptp(moved[term] - base[term]) > 1e-3
        fit, *_ = np.linalg.lstsq(columns, change, rcond=None)
        assert abs(fit[("a6", "k1").index(parameter)] - 1.0) < 0.02


def test_the_nominal_s_drift_is_the_flight_path_s(calm):
    ref, true = j246.reference(), calm.truth
    rows = len(true["theta"])
    gamma_dot = ref["z_alpha"][:rows] * (true["theta"] - true["gamma"]) + ref["z_beta"][:rows] * true["beta"]
    assert np.max(np.abs(true["gamma"])) > 5e-3
    assert np.max(np.abs(integrated(gamma_dot) - true["gamma"])) < 2e-3  # rad: a6 times it is 2e-4 rad/s^2, slow
    fall = 9.8 * np.sin(ref["gamma"][:rows]) / ref["speed"][:rows] * true["gamma"]  # gravity, which [drift] leaves out
    assert np.max(np.abs(integrated(gamma_dot + fall) - true["gamma"])) < 1e-4


def test_the_servo_is_the_first_order_lag_of_the_nominal(calm):
    """60 rad/s behind half a JSBSim step, exactly; commands are held over a period."""
    rng = np.random.default_rng([SEED, 0])
    drawn = {name: std * rng.standard_normal(len(calm.columns["t"])) for name, std in j246.NOISE.items()}
    commands = calm.columns["beta_cmd"] + drawn["command"] + j246.reference()["beta"][:len(drawn["command"])]
    true = calm.truth["beta"] + j246.reference()["beta"][:len(commands)]
    late, rest = math.exp(-60.0 * 0.5 * j246.STEP), math.exp(-60.0 * (j246.PERIOD - 0.5 * j246.STEP))
    nozzle = np.empty_like(true)
    nozzle[:2] = true[:2]
    for k in range(1, len(true) - 1):
        nozzle[k + 1] = commands[k] + (commands[k - 1] + (nozzle[k] - commands[k - 1]) * late - commands[k]) * rest
    assert np.max(np.abs(nozzle - true)) < 2e-5


def test_flights_repeat_by_seed_to_the_bit():
    of = j246_cases.case("windy", SEED)
    first, second, other = (j246.fly(of.faults, seed, 2.0).columns for seed in (SEED, SEED, SEED + 1))
    assert all(np.array_equal(first[column], second[column]) for column in first)
    assert not np.array_equal(first["theta"], other["theta"])


def test_what_is_written_is_read(tmp_path, calm):
    of = j246_cases.case("windy", SEED)
    j246_cases.write_log(tmp_path / "a.csv", calm)
    log = read_log(tmp_path / "a.csv")
    assert np.array_equal(log.theta, calm.columns["theta"]) and log.ignored == () and np.isnan(log.gamma).all()
    j246_cases.write_log(tmp_path / "b.csv", calm, navigated=True)
    assert 0.5 < np.std(read_log(tmp_path / "b.csv").gamma - calm.truth["gamma"]) / j246.GAMMA_NOISE < 1.5
    j246_cases.write_nominal(tmp_path / "plain.toml", of, SEED, plain=True)
    plain = load_nominal(tmp_path / "plain.toml")
    assert plain.drift is None and plain.wind is None and plain.actuator.natural_frequency > 0
    j246_cases.write_nominal(tmp_path / "a.toml", j246_cases.case("calm", SEED), SEED)
    nominal = load_nominal(tmp_path / "a.toml")
    assert nominal.drift is not None and nominal.actuator.time_constant == 1.0 / 60.0
    assert np.array_equal(nominal.guidance.attitude_at(log.t), log.theta_ref)


def test_cases_and_their_sizes_are_by_seed():
    assert all(j246_cases.case(name, SEED) == j246_cases.case(name, SEED) for name in j246_cases.CASES)
