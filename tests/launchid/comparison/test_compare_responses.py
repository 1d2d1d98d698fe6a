"""Frequency responses and statistics of a comparison, against scipy and python-control, and by their definitions.

The coherence is scipy's, responses are python-control's; fit, Theil's coefficient and its shares are computed by hand
on series, then by their laws.
"""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from launchid.comparison.frequency_response import (
    COHERENT,
    airframe,
    estimated,
    frequency_responses,
    instrument,
    servo,
    transforms,
)
from launchid.comparison.prediction import NO_STATISTICS, statistics
from launchid.log.log import Log, flown_log, log_of
from sim.effects import effect
from sim.flight import fly_whole
from sim.nominal import load_nominal
from sim.sections import Multisine

control = pytest.importorskip("control")
signal = pytest.importorskip("scipy.signal")

CONSTANT = load_nominal("constant")
HERTZ = np.arange(0.2, 6.0, 0.1)
TEST_INPUT = Multisine(0.0, 70.0, tuple(2.0 * math.pi * HERTZ), (5e-4,) * len(HERTZ),
                       tuple(np.random.default_rng(0).uniform(0.0, 2.0 * math.pi, len(HERTZ))))
EXCITED = dataclasses.replace(CONSTANT, test_input=TEST_INPUT)
BODE = np.array([0.2, 0.5, 1.0, 3.0, 8.0, 20.0])


def noise_log(rows: int = 4000, gain: float = 2.0) -> Log:
    """A log whose theta_dot is a multiple of beta, and noise."""
    rng = np.random.default_rng(3)
    beta = rng.standard_normal(rows)
    return log_of({"t": 0.01 * np.arange(rows), "theta": rng.standard_normal(rows), "beta": beta,
                   "beta_cmd": gain * beta + rng.standard_normal(rows)})


def test_the_coherence_is_scipys():
    log = noise_log()
    spectra = transforms(log, "beta_cmd", "beta", None)
    gain, _, coherence = estimated(spectra)
    rows = round(1.0 / (0.01 * spectra.frequency[1]))
    frequency, expected = signal.coherence(log.beta_cmd, log.beta, fs=100.0, window="hann", nperseg=rows)
    assert frequency == pytest.approx(spectra.frequency)
    assert coherence[1:-1] == pytest.approx(expected[1:-1], rel=1e-9)
    _, cross = signal.csd(log.beta_cmd, log.beta, fs=100.0, window="hann", nperseg=rows)
    _, own = signal.welch(log.beta_cmd, fs=100.0, window="hann", nperseg=rows)
    assert gain[1:-1] == pytest.approx((cross / own)[1:-1], rel=1e-9)


def test_the_error_of_a_gain_is_bendat_and_piersols():
    """(1 - coherence)/(2 n coherence), and as many independent runs scatter."""
    spectra = transforms(noise_log(), "beta_cmd", "beta", None)
    _, std, coherence = estimated(spectra)
    n = len(spectra.u) / (1.0 + (len(spectra.u) - 1) / len(spectra.u) / 18.0)
    expected = np.sqrt((1.0 - coherence) / (2.0 * (n - 1.0) * coherence))
    assert std[1:-1] == pytest.approx(expected[1:-1], rel=1e-6)


def test_the_transform_of_theta_ddot_follows_from_that_of_theta_dot():
    t = 0.001 * np.arange(30000)
    theta_dot, theta_ddot = np.sin(3.0 * t) + 0.2 * t, 3.0 * np.cos(3.0 * t) + 0.2
    given = {"t": t, "theta": t, "beta": np.sin(t), "theta_dot": theta_dot}
    by_parts = transforms(log_of(given), "beta", "theta_ddot", None)
    measured = transforms(log_of(given | {"theta_ddot": theta_ddot}), "beta", "theta_ddot", None)
    from_two = np.abs(by_parts.y - measured.y)[:, 2:40]   # below, a mean that is taken off is all that differs
    assert from_two.max() < 1e-5 * np.abs(measured.y).max()


def test_the_airframe_is_python_controls():
    expected = control.tf([-7.0, 0.0, 0.0], [1.0, 0.0, -2.0])(2j * math.pi * BODE)
    assert airframe(CONSTANT, np.array(2.0), np.array(-7.0), BODE) == pytest.approx(expected)
    with_slosh = dataclasses.replace(CONSTANT, effects=(
        effect("slosh", coupling=0.1, frequency=5.0, damping_ratio=0.05), effect("aero_damping", coefficient=0.3)))
    s = control.tf([1.0, 0.0], [1.0])
    mass = 0.1 * 25.0 / (s * s + 0.5 * s + 25.0)
    loop = -7.0 * s * s / (s * s * (1.0 + mass) + 0.3 * s - 2.0)
    assert airframe(with_slosh, np.array(2.0), np.array(-7.0), BODE) == pytest.approx(loop(2j * math.pi * BODE))


@pytest.mark.parametrize("damping", [0.7, 1.0])
@pytest.mark.parametrize("periods", [0, 2])
def test_the_servo_is_python_controls(damping, periods):
    actuator = dataclasses.replace(CONSTANT.actuator, damping_ratio=damping, delay=0.01 * periods)
    plant = control.ss([[0.0, 1.0], [-2500.0, -100.0 * damping]], [[0.0], [2500.0]], [[1.0, 0.0]], [[0.0]])
    z = np.exp(0.02j * math.pi * BODE)
    expected = control.sample_system(plant, 0.01, method="zoh")(z) * z**-periods
    assert servo(dataclasses.replace(CONSTANT, actuator=actuator), BODE, 0.01) == pytest.approx(expected, rel=1e-6)


def inside(flights: int, excited=EXCITED) -> dict[str, tuple[float, float]]:
    """The share of frequencies at which the truth is inside the 95 % intervals of gain and of phase, by input."""
    found: dict[str, list[tuple[float, float]]] = {}
    for seed in range(flights):
        for each in frequency_responses(flown_log(fly_whole(excited, seed)), excited):
            usable = (each.coherence > COHERENT) & (each.instrument == "test_input")
            off = np.log(each.gain / each.nominal)[usable]
            found.setdefault(each.source, []).extend(zip(np.abs(off.real) < 1.96 * each.std[usable],
                                                         np.abs(off.imag) < 1.96 * each.std[usable], strict=True))
    return {source: tuple(np.mean(both, axis=0)) for source, both in found.items()}


def test_a_true_response_is_inside_its_interval():
    shares = inside(6)
    assert set(shares) == {"beta", "beta_cmd"}
    assert all(0.90 <= share <= 0.98 for both in shares.values() for share in both), shares


def test_a_line_between_two_bins_is_estimated_at_its_own_frequency():
    """Beside a line the window shows the line: at the bins' frequencies a servo's phase is inside in 31 % of cases."""
    hertz = np.array([0.4, 0.71, 1.27, 2.03, 3.11, 4.57])
    apart = dataclasses.replace(EXCITED, test_input=dataclasses.replace(
        TEST_INPUT, frequency=tuple(2.0 * np.pi * hertz), amplitude=(3e-3,) * len(hertz), phase=tuple(hertz)))
    shares = inside(8, apart)
    assert all(share >= 0.82 for both in shares.values() for share in both), shares


def test_an_instrument_is_not_drawn_to_the_controller():
    """Strong disturbances in closed loop: the input itself shows more than the airframe does, the test input not."""
    assert EXCITED.simulation is not None
    strong = dataclasses.replace(TEST_INPUT, amplitude=(2e-3,) * len(HERTZ))
    rough = dataclasses.replace(EXCITED, test_input=strong, simulation=dataclasses.replace(
        EXCITED.simulation, acceleration_noise_std=0.3))
    ratios: dict[str | None, list[complex]] = {}
    for seed in range(6):
        for each in frequency_responses(flown_log(fly_whole(rough, seed)), rough):
            if each.source == "beta":
                middle = (each.frequency > 1.5) & (each.frequency < 4.0)
                ratios.setdefault(each.instrument, []).append(complex(np.mean((each.gain / each.nominal)[middle])))
    assert abs(np.mean(ratios[None]) - 1.0) > 0.15
    assert abs(np.mean(ratios["test_input"]) - 1.0) < 0.1


def test_what_moves_nothing_is_no_instrument():
    log = noise_log()
    assert instrument(log, CONSTANT) == (None, None)
    assert instrument(dataclasses.replace(log, theta_ref=np.full(len(log.t), 0.1)), CONSTANT) == (None, None)
    assert [each.instrument for each in frequency_responses(log, CONSTANT)] == [None]


def test_a_gap_costs_its_segments_alone():
    log = noise_log(8000)
    holed = dataclasses.replace(log, beta=np.where((log.t > 20.0) & (log.t < 26.0), np.nan, log.beta))
    whole, part = (transforms(each, "beta_cmd", "beta", None) for each in (log, holed))
    kept = np.isin(whole.middles, part.middles)
    assert 0 < len(part.middles) < len(whole.middles)
    assert part.u == pytest.approx(whole.u[kept])


def test_a_log_of_few_segments_has_no_response():
    assert frequency_responses(noise_log(400), CONSTANT) == []


Z = np.array([0.0, 1.0, 2.0, 3.0])


def test_a_shift_is_all_bias():
    found = statistics(Z, Z + 1.0)
    assert (found.bias, found.variance, found.covariance) == pytest.approx((1.0, 0.0, 0.0))
    assert (found.rms, found.largest) == (1.0, 1.0)
    assert found.tic == pytest.approx(1.0 / (math.sqrt(14.0 / 4.0) + math.sqrt(30.0 / 4.0)))
    assert found.fit == pytest.approx(100.0 * (1.0 - 1.0 / math.sqrt(1.25)))


def test_a_scale_about_the_mean_is_all_variance():
    found = statistics(Z, 1.5 + 2.0 * (Z - 1.5))
    assert (found.bias, found.variance, found.covariance) == pytest.approx((0.0, 1.0, 0.0))
    assert found.fit == pytest.approx(0.0)


def test_series_without_relation_are_all_covariance():
    found = statistics(np.array([1.0, -1.0, 1.0, -1.0]), np.array([1.0, 1.0, -1.0, -1.0]))
    assert (found.bias, found.variance, found.covariance) == pytest.approx((0.0, 0.0, 1.0))
    assert found.tic == pytest.approx(math.sqrt(2.0) / 2.0)
    assert found.fit == pytest.approx(100.0 * (1.0 - math.sqrt(2.0)))


SERIES = st.lists(st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)), min_size=2, max_size=40)


@given(SERIES, st.floats(1e-3, 1e3))
def test_shares_add_up_and_a_unit_changes_none_of_them(pairs, unit):
    z, y = np.array(pairs).T
    found, other = statistics(z, y), statistics(unit * z, unit * y)
    if found.rms > 1e-6:
        assert found.bias + found.variance + found.covariance == pytest.approx(1.0, abs=1e-6)
        assert 0.0 <= found.tic <= 1.0 + 1e-12
        assert other.tic == pytest.approx(found.tic, rel=1e-6)
        assert statistics(y, z).tic == pytest.approx(found.tic, rel=1e-9)


def test_what_is_met_exactly_has_no_shares():
    found = statistics(Z, Z)
    assert (found.fit, found.rms, found.tic) == (100.0, 0.0, 0.0)
    assert math.isnan(found.bias + found.variance + found.covariance)


def test_values_that_one_of_them_lacks_do_not_count():
    gap = np.array([0.0, math.nan, 2.0, 3.0, 9.0])
    assert statistics(gap, np.append(Z + 1.0, math.nan)) == statistics(Z[[0, 2, 3]], Z[[0, 2, 3]] + 1.0)


def test_fewer_than_two_values_have_none():
    assert statistics(Z[:1], Z[:1]) is NO_STATISTICS and statistics(Z, np.full(4, math.nan)) is NO_STATISTICS
