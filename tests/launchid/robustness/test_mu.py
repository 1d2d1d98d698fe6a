"""mu: the boundary point is on the boundary, nothing nearer is, gridding agrees; degenerate boxes by name."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as hs

from launchid.robustness.lft import Lft, lft_at, sample, spectral_radius
from launchid.robustness.margins import margins
from launchid.robustness.mu import BOUNDS_GAP, mu
from sim.nominal import Nominal, constant_profile, load_nominal

FLIGHTS = [("constant", 0.0), ("vega_like", 10.0), ("vega_like", 70.0), ("greensite_cr826", 76.0)]


def radii(lft: Lft, delta: np.ndarray) -> np.ndarray:
    return spectral_radius(sample(lft, delta))


def sides(points: int) -> np.ndarray:
    """Points (4 points, 2) on the sides of the square +-1."""
    s, one = np.linspace(-1.0, 1.0, points), np.ones(points)
    return np.concatenate([np.stack(pair, axis=1) for pair in ((s, one), (s, -one), (one, s), (-one, s))])


def gridded(lft: Lft, centre, radius) -> float:
    """1/mu by growing the box until an eigenvalue on its sides leaves the unit circle: at least the true one."""
    def stable(size: float, points: int) -> bool:
        return bool(np.all(radii(lft, np.asarray(centre) + size * np.asarray(radius) * sides(points)) < 1.0))

    size = 0.02
    while not stable(size, 41):   # hardly stable at the centre
        size /= 2.0
    while stable(size, 41):
        size *= 1.04
    low, high = size / 1.04, size
    while high - low > 1e-4 * high:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stable(middle, 101) else (low, middle)
    return high


def check(nominal: Nominal, t: float, centre, radius) -> None:
    """Bounds close; a root on the circle at delta, whose size is 1/lower; the gridding within 1 %."""
    found, lft = mu(nominal, t, centre, radius), lft_at(nominal, t)
    assert found.stable and found.lower <= found.upper <= found.lower * (1.0 + 1.01 * BOUNDS_GAP)
    assert radii(lft, found.delta) == pytest.approx(1.0, abs=1e-8)
    size = np.max(np.abs((found.delta - centre) / radius))
    assert 1.0 / size == pytest.approx(found.lower, rel=1e-9)
    assert found.margin == (1.0 / found.upper, 1.0 / found.lower)
    grid = gridded(lft, centre, radius)
    assert grid >= found.margin[0] * (1.0 - 1e-9)
    assert grid == pytest.approx(size, rel=0.01)


# ---- the law


@pytest.mark.parametrize("name, t, centre, radius", [*((*flight, (0.0, 0.0), (1.0, 1.0)) for flight in FLIGHTS), *(
    ("vega_like", 50.0, *box) for box in (((0.4, -0.3), (0.1, 0.1)), ((-0.9, 0.9), (0.1, 0.02)),
                                          ((0.0, 0.0), (0.01, 1.0)), ((0.0, 0.0), (1.0, 0.01))))])
def test_mu_is_what_gridding_finds(name, t, centre, radius):
    check(load_nominal(name), t, centre, radius)


@pytest.mark.parametrize("name, t", FLIGHTS[::2])
def test_box_of_the_upper_bound_is_stable_inside(name, t):
    lft, found = lft_at(load_nominal(name), t), mu(load_nominal(name), t)
    s = 0.999 * found.margin[0] * np.linspace(-1.0, 1.0, 41)
    assert radii(lft, np.stack(np.meshgrid(s, s), axis=-1).reshape(-1, 2)).max() < 1.0


@pytest.mark.parametrize("delay, kp, kd", [(0.014, 4.2, 1.75), (0.03, 3.36, 1.4), (0.08, 2.4, 1.0)])
def test_delay_moves_the_nearest_root_to_the_crossover(delay, kp, kd):
    nominal = load_nominal("constant")
    nominal = replace(nominal, actuator=replace(nominal.actuator, delay=delay),
                      controller=replace(nominal.controller, kp=kp, kd=kd))
    check(nominal, 0.0, (0.0, 0.0), (1.0, 1.0))
    assert mu(nominal, 0.0).omega > 5.0


@settings(max_examples=5)
@given(a6=hs.floats(-4.0, 4.0), k1=hs.floats(-12.0, -5.0), sigma=hs.floats(0.05, 0.5), kp=hs.floats(1.0, 2.5),
       kd=hs.floats(0.4, 1.0), w=hs.floats(25.0, 60.0), zeta=hs.floats(0.4, 1.2), delay=hs.floats(0.0, 0.05),
       period=hs.sampled_from([0.01, 0.02, 0.04]), centre=hs.tuples(hs.floats(-0.5, 0.5), hs.floats(-0.5, 0.5)),
       width=hs.floats(0.02, 1.0))
def test_mu_of_any_loop_is_what_gridding_finds(a6, k1, sigma, kp, kd, w, zeta, delay, period, centre, width):
    nominal = load_nominal("constant")
    nominal = replace(
        nominal, vehicle=constant_profile(a6, k1), uncertainty=constant_profile(sigma, 0.3),
        actuator=replace(nominal.actuator, natural_frequency=w, damping_ratio=zeta, delay=delay),
        controller=replace(nominal.controller, kp=kp, kd=kd, period=period))
    rho = float(radii(lft_at(nominal, 0.0), np.array(centre)))
    assume(rho < 1.0 - 1e-4 and abs(a6) > 1e-3)
    check(nominal, 0.0, centre, (width, 1.0))


def test_a_loop_that_is_hardly_stable():
    """One percent of the box is enough to lose it."""
    nominal = load_nominal("constant")
    check(replace(nominal, vehicle=constant_profile(-0.5, -11.8125), uncertainty=constant_profile(0.5, 0.3),
                  actuator=replace(nominal.actuator, natural_frequency=53.5, damping_ratio=0.859375, delay=0.041015625),
                  controller=replace(nominal.controller, kp=1.875, kd=0.9921875)), 0.0, (0.0, 0.03125), (1.0, 1.0))


def test_static_boundary_is_exact():
    """Full box of the constant launcher: (kp |k1| - a6)/(sigma (kp |k1| + a6)) = 6.4/2.6 at z = 1."""
    found = mu(load_nominal("constant"), 0.0)
    assert found.lower == pytest.approx(2.6 / 6.4, rel=1e-14) and found.omega == 0.0
    assert found.delta == pytest.approx([6.4 / 2.6, -6.4 / 2.6])


def test_uncertain_gain_alone_is_the_gain_margin():
    """A box without width in a6 asks how far k1 may go: the nearer of the two gain margins, in units of sigma."""
    nominal = load_nominal("constant")
    nominal = replace(nominal, controller=replace(nominal.controller, kp=4.0, kd=1.6))
    gains = margins(lft_at(nominal, 0.0))
    nearest = min(1.0 - gains.gain_low[0], gains.gain_high[0] - 1.0) / 0.25
    found = mu(nominal, 0.0, radius=(1e-6, 1.0))
    assert found.margin[1] == pytest.approx(nearest, rel=1e-4) and found.margin[0] <= nearest * (1 + 1e-6)


def test_mu_scales_with_the_box():
    nominal = load_nominal("vega_like")
    whole, half = mu(nominal, 50.0), mu(nominal, 50.0, radius=(0.5, 0.5))
    assert half.lower == pytest.approx(0.5 * whole.lower, rel=2 * BOUNDS_GAP)
    assert half.delta == pytest.approx(whole.delta, rel=1e-2)


# ---- degenerate boxes and loops by name


def test_vanishing_sigma():
    """mu -> 0 in proportion; the delta that destabilises goes to infinity, the parameters there do not."""
    nominal = load_nominal("constant")
    small = mu(replace(nominal, uncertainty=constant_profile(1e-9, 1e-9)), 0.0)
    assert small.lower == pytest.approx(4e-9 * mu(nominal, 0.0).lower, rel=1e-6) and small.upper < 2e-9


def test_loop_unstable_at_the_centre():
    found = mu(load_nominal("constant"), 0.0, centre=(3.0, -3.0))
    assert not found.stable and found.lower == found.upper == np.inf and found.margin == (0.0, 0.0)


def test_centre_on_the_edge_of_stability():
    """A hair inside the static line: the margin is the hair."""
    found = mu(load_nominal("constant"), 0.0, centre=(6.4 / 2.6 - 1e-6, -6.4 / 2.6 + 1e-6))
    assert found.stable and found.margin[0] == pytest.approx(1e-6, rel=1e-2)


def test_slow_sampling_is_lost_at_half_the_sampling_rate():
    """The nearest root at z = -1: a hardly damped actuator beside a slow controller."""
    nominal = load_nominal("constant")
    nominal = replace(
        nominal, vehicle=constant_profile(-1.56, -4.29),
        actuator=replace(nominal.actuator, natural_frequency=30.0, damping_ratio=0.0515, delay=0.0517),
        controller=replace(nominal.controller, kp=0.3, kd=0.975, period=0.1, derivative_time_constant=0.0))
    check(nominal, 0.0, (0.0, 0.0), (0.1, 1.0))
    assert mu(nominal, 0.0, radius=(0.1, 1.0)).omega == np.pi / 0.1


def test_launcher_on_the_pad_with_almost_no_aerodynamics():
    """a6 ~ 1e-7: only the loss of the whole control effectiveness destabilises, at delta_k1 = -1/sigma."""
    found = mu(load_nominal("vega_like"), 0.0)
    assert found.lower == pytest.approx(0.25, rel=1e-6) and found.upper <= 0.25 * (1 + 2 * BOUNDS_GAP)


@pytest.mark.parametrize("radius", [(0.0, 1.0), (1.0, -1.0), (np.nan, 1.0), (np.inf, 1.0)])
def test_box_without_width(radius):
    with pytest.raises(ValueError, match="radius above 0"):
        mu(load_nominal("constant"), 0.0, radius=radius)
