"""The estimator: exact recovery inside the model class, refusal outside it, and invariants that hold bit for bit.

Truth is analytic: theta is a sum of sines, and beta is whatever makes theta_ddot = a6 theta + k1 beta exact.
"""

import dataclasses
import math
import threading
from collections.abc import Iterable

import numba
import numpy as np
import pytest
from cut import fed
from every import every
from hypothesis import assume, example, given
from hypothesis import strategies as hs
from numba.core.runtime import _nrt_python, rtsys

from launchid_core import FORMULATIONS, SOLVERS, Config, Estimate, EstimateStatus, Estimator, Sample, Status, kernels
from launchid_core.gate import ring as rb
from launchid_core.order.entries import entries_of
from sim.nominal import load_nominal
from sim.onboard import onboard_model

NAN, INF = math.nan, math.inf
JIT = not numba.config.DISABLE_JIT
PERIOD = 1.0 / 128.0  # dyadic: k*PERIOD is exact
TONES = ((0.05, 2.0, 0.3), (0.03, 4.5, 1.1), (0.02, 7.0, 2.0))  # amplitude [rad], frequency [rad/s], phase
REGRESSIONS = ("measured", "difference", "integral")
UNKNOWN = (EstimateStatus.LOW_INFORMATION, EstimateStatus.SEPARATION)
NUMBERS = ("a6", "k1", "a6_std", "k1_std", "a6_k1_corr", "a6_dot", "k1_dot", "a6_bound", "k1_bound", "condition")

a6_values = hs.floats(-20.0, 20.0)
k1_values = hs.floats(-30.0, -0.5)


def trajectory(t: np.ndarray, tones=TONES) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """theta, theta_dot, theta_ddot of a sum of sines."""
    theta = sum(a * np.sin(w * t + p) for a, w, p in tones)
    theta_dot = sum(a * w * np.cos(w * t + p) for a, w, p in tones)
    theta_ddot = sum(-a * w * w * np.sin(w * t + p) for a, w, p in tones)
    return theta, theta_dot, theta_ddot


def flight(a6: float, k1: float, rows: int = 256, period: float = PERIOD, first: float = 0.0, tones=TONES,
           measured: bool = True) -> list[Sample]:
    """Noise-free samples of theta_ddot = a6 theta + k1 beta."""
    t = np.arange(rows) * period
    theta, theta_dot, theta_ddot = trajectory(t, tones)
    beta = (theta_ddot - a6 * theta) / k1
    ddot = theta_ddot if measured else np.full(rows, NAN)
    return [Sample(*row) for row in np.column_stack([first + t, theta, theta_dot, beta, ddot]).tolist()]


def feed(config: Config, samples: Iterable[Sample]) -> list[Estimate]:
    """The estimate of every window."""
    estimator = Estimator(config)
    return [estimator.estimate() for sample in samples if estimator.update(sample) is Status.WINDOW_COMPLETE]


def one(config: Config, samples: Iterable[Sample]) -> Estimate:
    """The estimate of the only window."""
    estimates = feed(config, samples)
    assert len(estimates) == 1
    return estimates[0]


def config_of(formulation: str, rows: int = 256, period: float = PERIOD, **more) -> Config:
    return Config(window=rows * period, sample_period=period, formulation=formulation, **more)


def bits(estimate: Estimate) -> tuple[bytes, ...]:
    """Everything in an estimate but its times, bit for bit."""
    numbers = np.array([getattr(estimate, name) for name in NUMBERS])
    return (numbers.tobytes(), estimate.xi.tobytes(), estimate.support.tobytes(), bytes([estimate.status]),
            bytes([estimate.valid]), str((estimate.rows, estimate.gaps)).encode())


def assert_refused(estimate: Estimate, status: EstimateStatus) -> None:
    """valid False, the reason, and NaN for every number: never a guess."""
    assert estimate.status is status
    assert estimate.valid is False
    assert all(math.isnan(getattr(estimate, name)) for name in NUMBERS)
    assert np.isnan(estimate.xi).all()
    assert not estimate.support.any()


# ---- recovery


@pytest.mark.parametrize("solver", SOLVERS)
@given(a6=a6_values, k1=k1_values)
def test_measured_recovers_to_rounding(solver, a6, k1):
    estimate = one(config_of("measured", 64, solver=solver), flight(a6, k1, 64))
    assert estimate.valid and estimate.status is EstimateStatus.OK
    assert abs(estimate.a6 - a6) <= 1e-10 * (1 + abs(a6))
    assert abs(estimate.k1 - k1) <= 1e-10 * abs(k1)
    assert estimate.a6_std <= 1e-9 and estimate.k1_std <= 1e-9


@pytest.mark.parametrize(("formulation", "order"), [("difference", 4), ("integral", 2)])
@given(a6=a6_values, k1=k1_values)
def test_unmeasured_recovers_within_its_scheme_s_error(formulation, order, a6, k1):
    """Both fit a wrong frequency response: off by (w h)^order of theta_ddot at most, here w h = 7/128."""
    estimate = one(config_of(formulation), flight(a6, k1, measured=False))
    error = (7 * PERIOD) ** order
    assert estimate.valid
    assert abs(estimate.a6 - a6) <= error * 7**2
    assert abs(estimate.k1 - k1) <= error * abs(k1)


@pytest.mark.parametrize(("formulation", "order"), [("difference", 4), ("integral", 4)])
def test_error_falls_with_the_scheme_s_order(formulation, order):
    errors = []
    for rows in (64, 128, 256):
        estimate = one(config_of(formulation, rows, 2.0 / rows), flight(2.0, -7.0, rows, 2.0 / rows, measured=False))
        errors.append(max(abs(estimate.a6 - 2.0), abs(estimate.k1 + 7.0)))
    ratios = np.log2([errors[0] / errors[1], errors[1] / errors[2]])
    assert (np.abs(ratios - order) < 0.8).all(), ratios


def test_rate_that_was_not_measured_is_differenced():
    samples = [sample._replace(theta_dot=NAN, theta_ddot=NAN) for sample in flight(2.0, -7.0)]
    for formulation in ("difference", "integral"):
        estimate = one(config_of(formulation), samples)
        assert estimate.valid
        assert abs(estimate.a6 - 2.0) < 0.2 and abs(estimate.k1 + 7.0) < 0.07


@pytest.mark.parametrize("solver", ["stls", "sr3", "ssr"])
@given(a6=hs.floats(1.0, 20.0), sign=hs.sampled_from([-1, 1]), k1=hs.floats(-20.0, -1.0))
def test_quadratic_library_finds_the_exact_support(solver, a6, sign, k1):
    config = config_of("measured", 128, library="quadratic", solver=solver)
    estimate = one(config, flight(sign * a6, k1, 128))
    active = [term for term, on in zip(estimate.terms, estimate.support[:, 1], strict=True) if on]
    assert estimate.valid
    assert active == ["theta", "beta"]
    assert estimate.a6 == pytest.approx(sign * a6, rel=1e-9)
    assert estimate.k1 == pytest.approx(k1, rel=1e-9)
    assert (estimate.xi[:, 1] != 0).tolist() == estimate.support[:, 1].tolist()


def test_xi_has_the_kinematic_row_too():
    """theta_dot = theta_dot is the first equation of the paper's Xi."""
    estimate = one(config_of("measured", library="linear"), flight(2.0, -7.0))
    assert estimate.terms == ("1", "theta", "theta_dot", "beta")
    assert np.allclose(estimate.xi[:, 0], [0, 0, 1, 0], atol=1e-12)
    assert np.allclose(estimate.xi[:, 1], [0, 2, 0, -7], atol=1e-10)
    assert estimate.xi.shape == estimate.support.shape == (4, 3)


@given(a6=a6_values, k1=k1_values, a6_dot=hs.floats(-2.0, 2.0), k1_dot=hs.floats(-0.2, 0.2))
def test_lpv_recovers_the_slopes(a6, k1, a6_dot, k1_dot):
    rows = 128
    t = np.arange(rows) * PERIOD
    tau = t - 0.5 * rows * PERIOD
    theta, theta_dot, theta_ddot = trajectory(t)
    beta = (theta_ddot - (a6 + a6_dot * tau) * theta) / (k1 + k1_dot * tau)
    samples = [Sample(*row) for row in np.column_stack([t, theta, theta_dot, beta, theta_ddot]).tolist()]
    estimate = one(config_of("measured", rows, library="lpv"), samples)
    assert estimate.valid
    found = (estimate.a6, estimate.k1, estimate.a6_dot, estimate.k1_dot)
    assert np.allclose(found, (a6, k1, a6_dot, k1_dot), rtol=1e-8, atol=1e-8)


@given(a6=a6_values, k1=k1_values, seed=hs.integers(0, 2**63 - 1), compression=hs.integers(1, 8))
def test_compression_keeps_the_answer_on_clean_data(a6, k1, seed, compression):
    config = config_of("measured", 64, compression=compression, seed=seed)
    estimate = one(config, flight(a6, k1, 64))
    assert estimate.rows == config.kept_rows == 64 // compression
    assert estimate.a6 == pytest.approx(a6, rel=1e-8, abs=1e-8)
    assert estimate.k1 == pytest.approx(k1, rel=1e-8)


@given(seed=hs.integers(0, 2**32 - 1), noise=hs.floats(1e-4, 1e-2))
def test_noisy_least_squares_is_numpy_s(seed, noise):
    """The standard deviations are tested in `test_honest_windows.py`."""
    samples = [s._replace(theta_ddot=s.theta_ddot + e)
               for s, e in zip(flight(2.0, -7.0), (noise * np.random.default_rng(seed).standard_normal(256)).tolist(),
                               strict=True)]
    estimate = one(config_of("measured"), samples)
    table = np.array(samples)
    assert np.allclose((estimate.a6, estimate.k1), np.linalg.lstsq(table[:, [1, 3]], table[:, 4])[0], rtol=1e-10)


def test_what_the_library_lacks_is_nan_and_what_is_cut_is_zero():
    estimate = one(config_of("measured", library=("theta_dot", "beta", "theta"), threshold=5.0), flight(2.0, -7.0))
    assert estimate.valid
    assert estimate.a6 == 0.0 and 0.0 <= estimate.a6_std < 1e-9 and estimate.absent["theta"] == pytest.approx(2.0)
    assert math.isnan(estimate.a6_dot) and math.isnan(estimate.k1_dot)
    assert math.isnan(one(config_of("measured", library="beta,theta_dot"), flight(2.0, -7.0)).a6)


# ---- refusal


@pytest.mark.parametrize("formulation", REGRESSIONS)
@given(a6=a6_values, k1=k1_values, share=hs.one_of(hs.floats(0.01, 100.0), hs.floats(-100.0, -0.01)))
def test_dependent_columns_are_rank(formulation, a6, k1, share):
    """theta is always zero; nothing moves; beta is in proportion to theta; a single sine has theta_ddot = -w^2 theta:
    any a6 fits with the k1 that makes up for it."""
    assume(abs(4.5**2 + a6) > 0.1)
    samples = flight(a6, k1, 64)
    for dependent in ([s._replace(theta=0.0, theta_dot=0.0, theta_ddot=k1 * s.beta) for s in samples],
                      [Sample(s.t, 0.0, 0.0, 0.0, 0.0) for s in samples],
                      [s._replace(beta=share * s.theta) for s in samples], flight(a6, k1, 64, tones=TONES[1:2])):
        assert_refused(one(config_of(formulation, 64), dependent), EstimateStatus.RANK)


@pytest.mark.parametrize("apart", [1e-2, 1e-4, 1e-6, 1e-13, 1e-15])
def test_nearly_dependent_columns_lose_digits_and_then_are_refused(apart):
    """beta = theta + a little of theta_dot: good to rounding over the little one, until that is rounding itself."""
    samples = [s._replace(beta=s.theta + apart * s.theta_dot) for s in flight(2.0, -7.0)]
    samples = [s._replace(theta_ddot=2.0 * s.theta - 7.0 * s.beta) for s in samples]
    estimate = one(config_of("measured"), samples)
    if apart < 1e-12:
        assert_refused(estimate, EstimateStatus.RANK)
    else:
        assert estimate.valid and estimate.condition > 0.1 / apart
        assert abs(estimate.a6 - 2.0) + abs(estimate.k1 + 7.0) < 1e-13 / apart


@pytest.mark.parametrize("formulation", REGRESSIONS)
def test_slow_samples_without_a_gap_and_an_acceleration_that_was_not_measured_are_short(formulation):
    """Every eighth sample, and max_gap so wide that none is a gap."""
    config = config_of(formulation, 64, max_gap=1.0)
    assert_refused(feed(config, flight(2.0, -7.0, 128)[::8])[0], EstimateStatus.SHORT)
    assert_refused(one(config_of("measured", 64), flight(2.0, -7.0, 64, measured=False)), EstimateStatus.SHORT)


@pytest.mark.parametrize("formulation", REGRESSIONS)
def test_dropout_of_most_of_the_window_is_gap(formulation):
    samples = flight(2.0, -7.0, 64)
    estimate = one(config_of(formulation, 64), samples[:10] + samples[-10:])
    assert_refused(estimate, EstimateStatus.GAP)
    assert (estimate.gaps, estimate.rows) == (1, 20)


@pytest.mark.parametrize("formulation", REGRESSIONS)
def test_nothing_is_differenced_or_integrated_across_a_gap(formulation):
    """The vehicle is on quite another trajectory behind the gap; a6 and k1 are found all the same."""
    before, after = flight(2.0, -7.0)[:110], flight(2.0, -7.0, first=0.0, tones=((0.06, 3.0, 4.0), (0.04, 6.0, 0.1)))
    estimate = one(config_of(formulation), before + after[140:])
    assert estimate.valid and estimate.gaps == 1
    assert estimate.a6 == pytest.approx(2.0, abs=0.15)
    assert estimate.k1 == pytest.approx(-7.0, abs=0.02)


@pytest.mark.parametrize("formulation", REGRESSIONS)
@pytest.mark.parametrize("channel", ["theta", "theta_dot", "beta"])
def test_sensor_at_its_end_stop_is_saturated(formulation, channel):
    samples = flight(2.0, -7.0, 64)
    stop = float(np.quantile(np.abs([getattr(s, channel) for s in samples]), 0.2))
    samples = [s._replace(**{channel: math.copysign(min(abs(getattr(s, channel)), stop), getattr(s, channel))})
               for s in samples]
    config = config_of(formulation, 64, **{f"{channel}_saturation": stop})
    assert_refused(one(config, samples), EstimateStatus.SATURATED)


def test_few_samples_at_the_end_stop_are_left_out_and_bias_nothing():
    samples = flight(2.0, -7.0, 128)
    stop = float(np.quantile([s.theta for s in samples], 0.8))
    clipped = [s._replace(theta=min(s.theta, stop)) for s in samples]
    estimate = one(config_of("measured", 128, theta_saturation=stop), clipped)
    assert estimate.valid and estimate.rows < 128
    assert (estimate.a6, estimate.k1) == (pytest.approx(2.0, abs=1e-9), pytest.approx(-7.0, abs=1e-9))


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # without JIT numpy tells of every overflow
def test_overflow_is_refused_with_numerics():
    """An acceleration of 1.7e308 is possible beyond the default ranges only."""
    samples = [s._replace(theta_ddot=math.copysign(1.7e308, s.theta)) for s in flight(2.0, -7.0, 64)]
    estimate = one(config_of("measured", 64, theta_ddot_limit=INF), samples)
    assert_refused(estimate, EstimateStatus.NUMERICS)


# ---- replay, reset, and what leaves


@pytest.mark.parametrize("formulation", REGRESSIONS)
def test_same_samples_same_bits_and_reset_is_as_new(formulation):
    samples = [s._replace(theta_ddot=s.theta_ddot + 1e-3 * math.sin(1e4 * s.t)) for s in flight(2.0, -7.0, 256)]
    config = config_of(formulation, 32, compression=2, seed=7, library="linear")
    first, again = feed(config, samples), feed(config, samples)
    estimator = fed(Estimator(config), samples[:77])
    estimator.reset()
    assert estimator.estimate() is None
    assert set(estimator.counts.values()) == {0}
    after = [estimator.estimate() for s in samples if estimator.update(s) is Status.WINDOW_COMPLETE]
    assert len(first) == 8
    assert [bits(e) for e in first] == [bits(e) for e in again] == [bits(e) for e in after]


def test_seed_chooses_the_rows():
    samples = [s._replace(theta_ddot=s.theta_ddot + 1e-3 * math.sin(1e4 * s.t)) for s in flight(2.0, -7.0, 64)]
    estimates = [one(config_of("measured", 64, compression=4, seed=seed), samples) for seed in (0, 0, 1)]
    assert bits(estimates[0]) == bits(estimates[1]) != bits(estimates[2])


def test_two_estimators_in_two_threads_are_as_one_after_the_other():
    logs = [flight(2.0, -7.0, 512), flight(-3.0, -2.0, 512)]
    config = config_of("integral", 32)
    serial = [[bits(e) for e in feed(config, log)] for log in logs]
    parallel: list = [None, None]

    def work(k: int) -> None:
        parallel[k] = [bits(e) for e in feed(config, logs[k])]

    threads = [threading.Thread(target=work, args=(k,)) for k in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert parallel == serial


def test_no_estimate_before_the_first_window():
    estimator = Estimator(config_of("measured", 64))
    assert estimator.estimate() is None
    for sample in flight(2.0, -7.0, 63):
        assert estimator.update(sample) is Status.ACCEPTED
    assert estimator.estimate() is None


def test_estimate_is_read_only_and_detached():
    estimator = Estimator(config_of("measured", 64))
    samples = flight(2.0, -7.0, 64)
    fed(estimator, samples)
    estimate = estimator.estimate()
    kept = bits(estimate)
    for array in (estimate.xi, estimate.support):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 0
    with pytest.raises(dataclasses.FrozenInstanceError):
        estimate.a6 = 0.0
    for sample in samples:
        estimator.update(sample._replace(t=sample.t + 64 * PERIOD, theta_ddot=sample.theta))
    assert bits(estimator.estimate()) != kept
    assert bits(estimate) == kept
    estimator.reset()
    assert bits(estimate) == kept


# ---- any float at all

odd_floats = hs.one_of(hs.floats(), hs.floats(-100.0, 100.0), hs.floats(-1.0, 1.0),
                       hs.sampled_from([0.0, -0.0, 5e-324, -2e-308, 1e-160, 99.9, 1e77, 1e154, 1e308, NAN, INF]))


def answers_hold(estimator: Estimator, samples: Iterable[Sample]) -> int:
    """Feed anything: a Status each time, and estimates that are either all there or all NaN; returns the windows."""
    windows = 0
    for sample in samples:
        status = estimator.update(sample)
        assert isinstance(status, Status)
        if status is Status.WINDOW_COMPLETE:
            windows += 1
            estimate = estimator.estimate()
            assert estimate.valid == (estimate.status is EstimateStatus.OK)
            if estimate.valid:
                assert np.isfinite(estimate.xi[:, 1]).all()
                assert math.isfinite(estimate.condition)
            else:
                assert_refused(estimate, estimate.status)
    return windows


@given(rows=hs.lists(hs.tuples(*[odd_floats] * 7), max_size=12))
def test_update_never_raises_for_any_float(rows):
    estimator = Estimator(Config(window=0.04, sample_period=0.01))
    answers_hold(estimator, (Sample(*row) for row in rows))
    assert sum(estimator.counts[status.name] for status in Status) == len(rows)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # without JIT numpy tells of every overflow
@given(rows=hs.lists(hs.tuples(*[odd_floats] * 6), min_size=8, max_size=16), wide=hs.booleans(),
       formulation=hs.sampled_from(REGRESSIONS), solver=hs.sampled_from(SOLVERS),
       library=hs.sampled_from(["rigid-body", "theta,theta^5", "sin(theta),sign(beta)", "tau*theta,theta_dot^2*beta"]))
def test_windows_of_any_floats_never_raise(rows, wide, formulation, solver, library):
    """Good stamps, so that windows close over whatever passes the gate; `wide`: with no gate but for infinities."""
    names = ("theta_limit", "theta_dot_limit", "beta_limit", "theta_ddot_limit", "beta_cmd_limit", "gamma_limit")
    config = Config(window=0.04, sample_period=0.01, formulation=formulation, library=library, solver=solver,
                    max_gap=1.0, **(dict.fromkeys(names, INF) if wide else {}))
    answers_hold(Estimator(config), (Sample(0.01 * k, *row) for k, row in enumerate(rows)))


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@given(unit=hs.sampled_from([5e-324, 1e-310, 1e-200, 1e-160, 1e-100, 1e-20]), formulation=hs.sampled_from(REGRESSIONS))
def test_subnormal_signals_never_raise_and_never_invent(unit, formulation):
    samples = [Sample(s.t, *(unit * x for x in s[1:5])) for s in flight(2.0, -7.0, 64)]
    assert answers_hold(Estimator(config_of(formulation, 32)), samples) == 2


def test_largest_t_limit_keeps_windows_around_their_samples():
    with pytest.raises(ValueError, match="t_limit"):  # windows are counted in 64 bits
        Config(t_limit=INF)
    estimator = Estimator(Config(window=0.04, sample_period=0.01, t_limit=1e12))
    for t in (0.0, 1e300, 1e12, math.nextafter(1e12, 0.0)):
        if estimator.update(Sample(t, 0.1, 0.2, 0.3)) is Status.WINDOW_COMPLETE:
            assert 0.0 <= estimator.estimate().t_start <= t


# ---- metamorphic: bit for bit


@pytest.mark.parametrize("channel", ["theta", "theta_dot", "beta", "theta_ddot"])
@given(exponent=hs.floats(9.0, 300.0), sign=hs.sampled_from([-1, 1]), at=hs.integers(1, 95))
@example(exponent=300.0, sign=1, at=64)
def test_spike_is_rejected_and_leaves_nothing_behind(channel, exponent, sign, at):
    config = config_of("measured", 32, library="linear")
    samples = flight(2.0, -7.0, 96)
    clean, hit = Estimator(config), Estimator(config)
    for k, sample in enumerate(samples):
        if k == at:
            spike = sample._replace(t=sample.t - 0.5 * PERIOD, **{channel: sign * 10.0**exponent})
            assert hit.update(spike) is Status.RANGE
        assert hit.update(sample) is clean.update(sample)
        if hit.estimate() is not None:
            assert bits(hit.estimate()) == bits(clean.estimate())
    assert hit._memory.apart["ring"].tobytes() == clean._memory.apart["ring"].tobytes()
    assert np.array(hit._parts.state.clock).tobytes() == np.array(clean._parts.state.clock).tobytes()


def jagged(rows: int = 64, size: float = 1.0) -> list[Sample]:
    """A flight off the model, so that no residual is zero."""
    return [s._replace(theta_ddot=s.theta_ddot + 0.1 * size * math.sin(1e4 * s.t),
                       theta_dot=s.theta_dot + 1e-3 * size * math.cos(7e3 * s.t)) for s in flight(2.0, -7.0, rows)]


@pytest.mark.parametrize("formulation", REGRESSIONS)
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("library", ["rigid-body", "lpv", "quadratic", "sin(theta),beta,sign(theta_dot)"])
def test_mirror_keeps_odd_coefficients_and_turns_even_ones(formulation, solver, library):
    config = config_of(formulation, library=library, solver=solver)
    up = one(config, jagged(256))
    down = one(config, [Sample(s.t, -s.theta, -s.theta_dot, -s.beta, -s.theta_ddot) for s in jagged(256)])
    even = np.array([sum(t.count(v) for v in ("theta", "beta")) + sum(t.count(f"{v}^2") for v in
                     ("theta", "theta_dot", "beta")) for t in up.terms]) % 2 == 0
    assert even.sum() == (7 if library == "quadratic" else 0)
    assert (up.valid and up.support.any()) or (library == "quadratic" and up.status in UNKNOWN)
    assert np.array_equal(down.xi, np.where(even[:, None], -up.xi, up.xi), equal_nan=True)
    assert np.array_equal(down.support, up.support)
    assert all(np.array_equal(getattr(down, name), getattr(up, name), equal_nan=True) for name in NUMBERS)


@pytest.mark.parametrize("formulation", REGRESSIONS)
@given(first=hs.integers(-2**30, 2**30))
def test_time_shift_changes_no_bit(formulation, first):
    """Shifts and stamps are multiples of the dyadic period, so their sums are exact."""
    config = config_of(formulation, 64, library="lpv")
    here = one(config, jagged())
    there = one(config, [s._replace(t=s.t + first) for s in jagged()])
    assert there.t_start == first
    assert bits(there) == bits(here)


@pytest.mark.parametrize("formulation", REGRESSIONS)
@pytest.mark.parametrize("library", ["rigid-body", "lpv"])
@given(power=hs.integers(-60, 8))
def test_units_scaled_by_a_power_of_two_keep_every_bit(formulation, library, power):
    unit = 2.0**power
    config = config_of(formulation, 64, library=library, threshold=0.0)
    samples = jagged(size=0.01)  # a derivative of what is as jagged as elsewhere is not known at all
    here = one(config, samples)
    there = one(config, [Sample(s.t, *(unit * x for x in s[1:5])) for s in samples])
    assert here.valid and bits(there) == bits(here)


@given(power=hs.integers(-20, 8))
def test_beta_in_other_units_moves_k1_alone(power):
    unit = 2.0**power
    config = config_of("measured", 64, threshold=0.0)
    here, there = one(config, jagged()), one(config, [s._replace(beta=unit * s.beta) for s in jagged()])
    assert (there.a6, there.k1 * unit, there.condition) == (here.a6, here.k1, here.condition)


@given(time=hs.integers(-6, 6))
def test_time_in_other_units_scales_a6_and_k1_by_its_square(time):
    unit = 2.0**time
    here = one(config_of("integral", 64, threshold=0.0), jagged())
    changed = [Sample(unit * s.t, s.theta, s.theta_dot / unit, s.beta) for s in jagged()]
    there = one(config_of("integral", 64, unit * PERIOD, threshold=0.0), changed)
    assert (there.a6 * unit**2, there.k1 * unit**2) == (here.a6, here.k1)


# ---- nothing is compiled or allocated in flight


@pytest.mark.skipif(not JIT, reason="NUMBA_DISABLE_JIT=1: there is nothing to compile")
@pytest.mark.parametrize("kind", [int, bool, np.float32, np.int8, np.float64])
def test_no_kernel_compiles_after_construction(kind):
    estimator = Estimator(config_of("integral", 64))
    used = entries_of(estimator.config, estimator._memory)
    before = [len(entry.signatures) for entry in used]
    assert min(before) >= 1
    for k, sample in enumerate(flight(2.0, -7.0, 128)):
        mixed = [kind(k)] + [kind(x) for x in sample[1:4]] if kind in (int, bool, np.int8) and k == 64 else \
            [sample.t, *(kind(x) for x in sample[1:4])]
        assert isinstance(estimator.update((*mixed, NAN, NAN, NAN)), Status)
    assert estimator.counts["WINDOW_COMPLETE"] >= 1
    assert [len(entry.signatures) for entry in used] == before


def allocating(n):
    """The positive control: an array per pass."""
    total = 0.0
    for k in range(n):
        total += np.full(3 + k % 2, 1.0).sum()
    return total


@pytest.fixture
def allocations():
    """The allocations of numba's runtime during a call."""
    if not JIT:
        pytest.skip("NUMBA_DISABLE_JIT=1: numba's runtime allocates nothing to count")
    assert hasattr(_nrt_python, "memsys_enable_stats"), "numba's allocation statistics moved: mend this test"
    rtsys.initialize(numba.core.registry.cpu_target.target_context)
    _nrt_python.memsys_enable_stats()

    def count(function, *arguments) -> tuple[int, object]:
        before = rtsys.get_allocation_stats()
        result = function(*arguments)
        after = rtsys.get_allocation_stats()
        return after.alloc - before.alloc, result

    yield count
    _nrt_python.memsys_disable_stats()


def test_positive_control_allocates_with_every_pass(allocations):
    kernel = numba.njit(allocating)
    kernel(1)
    few, _ = allocations(kernel, 10)
    many, _ = allocations(kernel, 1000)
    assert many - few >= 990


def test_a_kernel_that_allocates_does_not_compile():
    """A kernel has no numba run time, which the decorators of `launchid_core.kernels` rest on."""
    if JIT:
        with pytest.raises(numba.core.errors.TypingError):
            kernels.kernel(allocating)(1)


def flown(estimator: Estimator, samples: np.ndarray) -> int:
    """`update` without the estimates that the host makes; returns how many windows closed."""
    step = estimator._step
    return sum(step(*sample) == rb.WINDOW_COMPLETE for sample in samples.tolist())


@pytest.mark.parametrize(("formulation", "library", "solver"), [
    ("measured", "quadratic", "stls"), ("difference", "lpv", "sr3"), ("difference", "quadratic+sin", "ssr"),
    ("measured", "linear", "lasso"), ("integral", "quadratic", "stls"), ("integral", "linear", "sr3"),
    ("filtered", "rigid-body", "stls"), ("filtered", "quadratic", "stls"), ("ranged", "rigid-body", "stls"),
    pytest.param("ranged", "quadratic", "stls", marks=pytest.mark.campaign)])  # a build of its own: 15 s
def test_a_flight_allocates_nothing(allocations, formulation, library, solver):
    rows, filtered = 32, formulation in ("filtered", "ranged")
    model = onboard_model(load_nominal("constant"))
    if formulation == "ranged":
        model = dataclasses.replace(model, sigma_t=(0.0,), sigma_a6=(0.25,), sigma_k1=(0.25,))
    config = config_of("filtered" if filtered else formulation, rows, library=library, solver=solver,
                       model=model if filtered else None)
    estimator = Estimator(config)
    samples = np.array([s._replace(beta_cmd=s.beta) for s in jagged(rows)])

    def windows(n: int) -> int:
        estimator.reset()
        table = np.tile(samples, (n, 1))
        table[:, rb.T] = np.arange(n * rows) * config.sample_period
        used, closed = allocations(flown, estimator, table)
        assert closed == n
        assert filtered or estimator.estimate().status in (EstimateStatus.OK, *UNKNOWN)  # solved to the end
        return used

    windows(1)  # compiles
    assert windows(10) == windows(1000)


# ---- configuration


@every(("field", "value", "allowed"), [
    *[("sample_period", value, ("1e-06", "10000")) for value in (0.0, -0.01, NAN, INF, 1e-7, 2e4, "0.01", None, True)],
    *[("window", value, ("0.04", "10000")) for value in (0.0, -1.0, 0.03, 1e6, NAN, INF, "1", None, True, [1.0], 1j)],
    *[("compression", value, ("1 to 100",)) for value in (0, -1, 101, 1.0, "3", None, True)],
    ("compression", 50, ("1..25",)),
    *[("seed", value, ("0 to 9223372036854775807",)) for value in (-1, 2**63, 0.5, "0", None, False)],
    *[("formulation", value, FORMULATIONS) for value in ("weak", "", None, 3, ["integral"])],
    *[("solver", value, SOLVERS) for value in ("omp", "STLS", None, 0)],
    *[("threshold", value, ("0 to 1e+12",)) for value in (-0.5, NAN, INF, "0.5", True)],
    *[("max_gap", value, ("0.01 to 1e+10",)) for value in (0.0, 0.009, NAN, INF, "1")],
    *[("library", value, ("rigid-body", "theta_dot")) for value in ("nonsense", "theta,x", "", "theta;beta", "t^6x")],
    ("library", (), ("1..40",)),
    ("library", tuple(f"tau^{i}*theta^{j}*theta_dot^{k}" for i in range(5) for j in range(5) for k in range(5))[1:],
     ("1..40",)),
    *[(f"{name}_limit", value, ("above 0",)) for name in ("t", "theta", "theta_dot", "beta", "theta_ddot",
                                                         "beta_cmd", "gamma")
      for value in (0.0, -1.0, NAN, "1", None)],
    *[(f"{name}_saturation", value, ("above 0",)) for name in ("theta", "theta_dot", "beta")
      for value in (0.0, -1.0, NAN, None)],
])
def test_wrong_value_is_named_with_its_field_and_range(field, value, allowed):
    with pytest.raises(ValueError) as caught:
        Config(**{field: value})
    message = str(caught.value)
    assert field in message
    assert (repr(value) in message) or (isinstance(value, tuple) and repr(value[:1])[1:-2] in message)
    assert all(text in message for text in allowed)
    assert "\n" not in message


@every(("changes", "named"), [
    ({"model": None}, "^model=None: formulation 'filtered' expects a Model"), ({"compression": 2}, "^compression=2: "),
    *(({"library": library}, "^library=.*expects theta, beta and no term in tau")
      for library in ("theta", "beta", "theta_dot", "1,theta,theta_dot", "theta_dot,beta", "lpv")),
    ({"sample_period": 0.026}, "^sample_period=0.026: "), ({"delay": 3.0}, "^model.delay=3.0: "),
    ({"natural_frequency": 1e7}, "^model.natural_frequency=.*a first-order one")])
def test_what_the_filter_cannot_do_is_refused_by_name(changes, named):
    """The model of `constant` is taken as it flies, at 2.5 of the controller's periods too."""
    model = onboard_model(load_nominal("constant"))
    Config(formulation="filtered", model=model)
    Config(formulation="filtered", model=model, sample_period=0.025)
    fields = {f.name for f in dataclasses.fields(Config)}
    of_model = {name: value for name, value in changes.items() if name not in fields}
    given = {"model": dataclasses.replace(model, **of_model), **{k: v for k, v in changes.items() if k in fields}}
    with pytest.raises(ValueError, match=named) as caught:
        Config(formulation="filtered", **given)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("field", "value"), [
    pytest.param("library", None, id="library None"), pytest.param("library", 5, id="library 5"),
    pytest.param("library", ("theta", 3), id="library with a number"), pytest.param("library", b"theta", id="bytes"),
    pytest.param("window", 10**400, id="window beyond float"), pytest.param("window", np.zeros(2), id="window array"),
    pytest.param("compression", np.zeros(2, int), id="compression array"),
    pytest.param("threshold", 10**400, id="threshold beyond float")])
def test_wrong_type_is_a_value_error_too(field, value):
    with pytest.raises(ValueError, match=field):
        Config(**{field: value})


def test_rows_follow_the_contract():
    config = Config(window=0.3, sample_period=0.001, compression=7)
    assert (config.rows, config.kept_rows) == (300, 42)
    assert Config(window=1.0, sample_period=0.15).rows == 7  # 6.67


@pytest.mark.parametrize("library", [["theta", "beta"], ("theta", "beta"), "theta, beta", "rigid-body"])
def test_library_by_name_list_or_tuple_is_the_same(library):
    assert Config(library=library).terms == ("theta", "beta")
