"""The Cramer-Rao bound: its pieces against scipy and linear algebra, its size against known numbers."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as hs

from launchid.bound.flights import flight_bound
from launchid.bound.information import bounds_of, without_offset
from launchid.bound.modes import NO_MODES
from launchid.bound.step import transition
from sim.errors import InputError
from sim.nominal import load_nominal

linalg = pytest.importorskip("scipy.linalg")

plants = {"a6": hs.floats(-20.0, 20.0), "k1": hs.floats(-30.0, -0.5), "frequency": hs.floats(5.0, 55.0),
          "damping": hs.floats(0.2, 1.2), "h": hs.floats(1e-4, 0.01)}


def system(a6: float, k1: float, frequency: float, damping: float) -> np.ndarray:
    """A of theta, theta_dot, beta, beta_dot and the held command and acceleration, row by row as one reads it."""
    w2 = frequency**2
    return np.array([[0, 1, 0, 0, 0, 0],
                     [a6, 0, k1, 0, 0, 1],
                     [0, 0, 0, 1, 0, 0],
                     [0, 0, -w2, -2 * damping * frequency, w2, 0],
                     [0, 0, 0, 0, 0, 0],
                     [0, 0, 0, 0, 0, 0]], dtype=float)


def computed(a6, k1, frequency, damping, h) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    f, slopes = np.full((6, 6), np.nan), np.full((2, 6, 6), np.nan)
    transition(np.array([a6, k1, frequency, damping]), NO_MODES.bends, h, f, slopes)
    return f, slopes[0], slopes[1]


@given(**plants)
def test_transition_is_the_matrix_exponential(a6, k1, frequency, damping, h):
    f, _, _ = computed(a6, k1, frequency, damping, h)
    assert np.allclose(f, linalg.expm(system(a6, k1, frequency, damping) * h), rtol=1e-10, atol=1e-12)


@given(**plants)
def test_its_derivatives_are_the_central_differences(a6, k1, frequency, damping, h):
    _, fa, fk = computed(a6, k1, frequency, damping, h)
    step = 0.05

    def difference(da6: float, dk1: float) -> np.ndarray:
        up = linalg.expm(system(a6 + da6, k1 + dk1, frequency, damping) * h)
        return (up - linalg.expm(system(a6 - da6, k1 - dk1, frequency, damping) * h)) / (2 * step)

    assert np.allclose(fa, difference(step, 0.0), rtol=1e-6, atol=1e-12)
    assert np.allclose(fk, difference(0.0, step), rtol=1e-6, atol=1e-12)


@given(seed=hs.integers(0, 10_000))
def test_bounds_are_the_corner_of_the_inverse_information(seed):
    random = np.random.default_rng(seed)
    factor = random.standard_normal((3, 6, 9))
    information = factor @ factor.transpose(0, 2, 1)
    bound = bounds_of(without_offset(information), 1.0)
    covariance = np.linalg.inv(information)[:, 4:, 4:]
    assert np.allclose(bound.a6, np.sqrt(covariance[:, 0, 0]), rtol=1e-6)
    assert np.allclose(bound.k1, np.sqrt(covariance[:, 1, 1]), rtol=1e-6)
    assert np.allclose(bound.correlation, covariance[:, 0, 1] / (bound.a6 * bound.k1), atol=1e-6)


@pytest.fixture(scope="module")
def bounds():
    nominal = load_nominal("constant")
    return {window: [flight_bound(nominal, window, seed) for seed in range(3)] for window in (1.0, 5.0, 10.0)}


@pytest.mark.parametrize(("window", "expected"), [(1.0, 0.14), (5.0, 0.041), (10.0, 0.0106)])
def test_median_bound_of_a6_for_the_constant_nominal(bounds, window, expected):
    assert np.median(np.concatenate([bound.a6 for bound in bounds[window]])) == pytest.approx(expected, rel=0.10)


@pytest.mark.parametrize(("long", "part"), [(10.0, 5.0), (5.0, 1.0), (10.0, 1.0)])
def test_longer_window_is_never_worse_than_its_best_part(bounds, long, part):
    """A part's data are among the whole's: 0.1 % is for the filter's own start."""
    n = round(long / part)
    for whole, pieces in zip(bounds[long], bounds[part], strict=True):
        for name in ("a6", "k1"):
            best = getattr(pieces, name)[:n * len(whole.a6)].reshape(-1, n).min(axis=1)
            assert (getattr(whole, name) <= best * 1.001).all()


def test_bound_needs_the_loop(tmp_path):
    path = tmp_path / "bare.toml"
    path.write_text("[vehicle]\na6 = 2.0\nk1 = -7.0\n[sensors]\nperiod = 0.01\ntheta_std = 1e-4\n"
                    "theta_dot_std = 1e-4\nbeta_std = 1e-4\n")
    with pytest.raises(InputError, match=r"\[actuator\] is missing"):
        flight_bound(load_nominal(path), 1.0)
