"""Margins: what they promise, by eigenvalues of the loop they judge; python-control's numbers; the box's worst."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from test_lft import delayed, held, plant

from launchid.robustness.lft import close, lft_at, sample, spectral_radius, split_delay
from launchid.robustness.margins import margins, margins_over_time, worst_margins
from sim.nominal import BUILT_IN, Nominal, constant_profile, load_nominal

FLIGHTS = [("constant", 0.0, 0.0), ("vega_like", 50.0, 0.0), ("vega_like", 90.0, 0.0), ("greensite_cr826", 76.0, 0.0),
           ("constant", 0.0, 0.03), ("constant", 0.0, 0.014)]


def scaled(nominal: Nominal, t: float, factor: float) -> Nominal:
    """Frozen at t with `factor` on k1, which is a factor on the loop gain."""
    a6, k1 = nominal.vehicle.at(t)
    return replace(nominal, vehicle=constant_profile(float(a6), factor * float(k1)))


def radius(nominal: Nominal, t: float = 0.0, delta=(0.0, 0.0)) -> float:
    return float(spectral_radius(sample(lft_at(nominal, t), np.array(delta))))


def actuator_delay_margin(nominal: Nominal, t: float) -> float:
    """Least transport delay [s], added to the actuator's, that destabilises the loop; 0 if unstable, inf if none.

    Exact for delays inside a period, by eigenvalues, where `Margins.delay` turns the sampled loop by omega tau.
    """
    def unstable(extra: float) -> bool:
        return radius(delayed(nominal, nominal.actuator.delay + extra), t) >= 1.0

    lft = lft_at(nominal, t)
    classical = float(margins(lft).delay[0])
    if np.isnan(classical):
        return 0.0
    if np.isinf(classical):
        return np.inf
    step = min(classical, lft.period) / 4.0
    low = 0.0
    while not unstable(low + step):
        low += step
    high = low + step
    while high - low > 1e-10 * high:
        low, high = (low, 0.5 * (low + high)) if unstable(0.5 * (low + high)) else (0.5 * (low + high), high)
    return high


# ---- the law: the loop is stable up to its margin and not beyond


@pytest.mark.parametrize("name, t, delay", FLIGHTS)
def test_loop_is_stable_between_its_gain_margins_only(name, t, delay):
    nominal = delayed(load_nominal(name), delay)
    found = margins(lft_at(nominal, t))
    low, high = float(found.gain_low[0]), float(found.gain_high[0])
    assert low < 1.0 < high
    for factor in np.geomspace(low * (1 + 1e-6), high * (1 - 1e-6), 15):
        assert radius(scaled(nominal, t, factor)) < 1.0
    assert radius(scaled(nominal, t, low * (1 - 1e-6))) > 1.0
    assert radius(scaled(nominal, t, high * (1 + 1e-6))) > 1.0
    assert radius(scaled(nominal, t, high)) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("name, t, delay", FLIGHTS)
def test_loop_is_stable_up_to_its_actuator_delay_margin(name, t, delay):
    nominal = delayed(load_nominal(name), delay)
    exact = actuator_delay_margin(nominal, t)
    assert radius(delayed(nominal, delay + exact * (1 - 1e-6)), t) < 1.0
    assert radius(delayed(nominal, delay + exact * (1 + 1e-6)), t) > 1.0
    assert margins(lft_at(nominal, t)).delay[0] == pytest.approx(exact, rel=1e-3)


def test_low_gain_margin_is_the_static_balance():
    """a6/(kp |k1|) = 2/(1.2*7): below it the nozzle cannot hold the aerodynamic moment."""
    assert margins(lft_at(load_nominal("constant"), 0.0)).gain_low[0] == pytest.approx(2.0 / (1.2 * 7.0), rel=1e-14)


@pytest.mark.parametrize("name, t, delay", FLIGHTS)
def test_margins_are_python_controls(name, t, delay):
    control = pytest.importorskip("control")
    nominal = delayed(load_nominal(name), delay)
    period, tau = nominal.controller.period, nominal.controller.derivative_time_constant
    whole, rest = split_delay(delay, period)
    a, b = plant(nominal, t, (0.0, 0.0))
    sampled = control.c2d(control.ss(a, b, [[1.0, 0, 0, 0]], 0), period, "zoh")
    if rest > 0.0:
        late_a, late_b = held(a, b, period - rest)
        sampled = control.ss(np.block([[held(a, b, period)[0], late_a @ held(a, b, rest)[1]], [np.zeros((1, 5))]]),
                             np.vstack([late_b, [[1.0]]]), [[1.0, 0, 0, 0, 0]], 0, period)
    pd = control.ss(control.tf([nominal.controller.kp], [1], period) + nominal.controller.kd * control.tf(
        [1, -1], [tau + period, -tau], period))
    loop = -pd * control.ss(control.tf([1], [1, *[0] * whole], period)) * sampled
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")     # of the polynomial method's conditioning: only its low gain is taken
        gains, phases, distances, _, at, _ = control.stability_margins(loop, returnall=True, method="frd")
        low = control.stability_margins(loop, returnall=True, method="poly")[0]
    found = margins(lft_at(nominal, t))
    assert found.gain_high[0] == pytest.approx(min(g for g in gains if g > 1.0), rel=1e-6)
    assert found.gain_low[0] == pytest.approx(max(g for g in low if g < 1.0), rel=1e-6)
    assert found.phase_deg[0] == pytest.approx(min(abs(phases)), rel=1e-6)
    assert found.modulus[0] == pytest.approx(min(distances), rel=1e-6)
    assert found.delay[0] == pytest.approx(min(np.radians(phases) / at), rel=1e-6)


def test_modulus_margin_bounds_the_others():
    """Least |1 + L| = m gives gain factors beyond 1/(1 -+ m) and a phase of 2 arcsin(m/2)."""
    for name in BUILT_IN:
        found = margins(lft_at(load_nominal(name), 60.0))
        m = found.modulus[0]
        assert found.gain_low[0] <= 1.0 / (1.0 + m) and found.gain_high[0] >= 1.0 / (1.0 - m)
        assert found.phase[0] >= 2.0 * np.arcsin(m / 2.0)


# ---- degenerate loops by name


def test_unstable_loop_has_no_margins():
    nominal = scaled(load_nominal("constant"), 0.0, 0.2)
    found = margins(lft_at(nominal, 0.0))
    assert not found.stable[0] and all(np.isnan(x[0]) for x in found[1:])
    assert actuator_delay_margin(nominal, 0.0) == 0.0


def test_stable_plant_may_lose_its_feedback():
    nominal = replace(load_nominal("constant"), vehicle=constant_profile(-2.0, -7.0))
    assert margins(lft_at(nominal, 0.0)).gain_low[0] == pytest.approx(0.0, abs=1e-12)


def test_slow_sampling_is_lost_at_half_the_sampling_rate():
    """A hardly damped actuator beside a slow controller: the upper gain margin sits at z = -1, where L is real."""
    nominal = load_nominal("constant")
    nominal = replace(
        nominal, vehicle=constant_profile(-1.56, -4.29),
        actuator=replace(nominal.actuator, natural_frequency=30.0, damping_ratio=0.0515, delay=0.0517),
        controller=replace(nominal.controller, kp=0.3, kd=0.975, period=0.1, derivative_time_constant=0.0))
    high = float(margins(lft_at(nominal, 0.0)).gain_high[0])
    assert radius(nominal) < 1.0 < high
    loop = sample(lft_at(scaled(nominal, 0.0, high), 0.0), np.zeros(2))
    assert np.min(np.abs(np.linalg.eigvals(close(loop)) + 1.0)) < 1e-9
    assert radius(scaled(nominal, 0.0, high * (1 - 1e-6))) < 1.0 < radius(scaled(nominal, 0.0, high * (1 + 1e-6)))


# ---- the worst over a box


@pytest.mark.parametrize("name, t", [("constant", 0.0), ("vega_like", 50.0), ("greensite_cr826", 76.0)])
def test_no_delta_of_the_box_is_worse_than_the_worst(name, t):
    lft = lft_at(load_nominal(name), t)
    worst = worst_margins(lft)
    found = margins(lft, np.random.default_rng(2).uniform(-1.0, 1.0, (200, 2)))
    assert found.stable.all() and worst.stable[0]
    assert found.gain_low.max() <= worst.gain_low[0]
    for mine, theirs in zip(worst[2:], found[2:], strict=True):
        assert theirs.min() >= mine[0] * (1 - 1e-3)


def test_worst_low_gain_margin_is_the_vertex():
    a6, k1 = 2.0 * 1.25, 7.0 * 0.75
    assert worst_margins(lft_at(load_nominal("constant"), 0.0)).gain_low[0] == pytest.approx(a6 / (1.2 * k1), rel=1e-12)


def test_identified_box_has_better_margins_than_the_full():
    nominal, times = load_nominal("vega_like"), np.array([10.0, 50.0, 90.0])
    before = margins_over_time(nominal, times)
    after = margins_over_time(nominal, times, np.array([0.4, -0.3]), np.array([0.1, 0.1]))
    assert before.stable.all() and after.stable.all() and before.phase.shape == (3,)
    assert np.all(after.gain_low < before.gain_low)
    for x, y in zip(after[2:], before[2:], strict=True):
        assert np.all(x > y)


def test_box_with_an_unstable_corner_is_unstable():
    worst = worst_margins(lft_at(load_nominal("constant"), 0.0), (0.0, 0.0), (2.6, 2.6))
    assert not worst.stable[0] and np.isnan(worst.phase[0])
