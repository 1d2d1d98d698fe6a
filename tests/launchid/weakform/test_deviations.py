"""Deviations of `integral` and `difference` are those of the log's own noise."""

from types import SimpleNamespace

import numpy as np
import pytest
from hidden import Spec, fly

import launchid
from launchid.weakform.fit import least_squares_covariance
from launchid.weakform.modes import noises_of

A6, K1 = 2.0, -7.0   # of the generator's `constant`


@pytest.mark.parametrize("formulation", ["integral", "difference"])
def test_the_covariance_is_the_scatter_under_any_noise(formulation):
    rng, n = np.random.default_rng(1), 300
    _, curl, shapes = noises_of(n, True)
    phi, variance = rng.standard_normal((n, 2)) * np.sqrt(curl)[:, None], np.array([1.0, 3.0, 1e-3]) @ shapes
    weight = np.ones(n) if formulation == "difference" else 1.0 / curl
    estimator = np.linalg.solve((phi * weight[:, None]).T @ phi, (phi * weight[:, None]).T)
    drawn = estimator @ (np.sqrt(variance)[:, None] * rng.standard_normal((n, 4000)))
    modes = SimpleNamespace(phi=phi, curl=curl, y=np.zeros(n))
    assert np.cov(drawn) == pytest.approx(least_squares_covariance(modes, variance, formulation), rel=0.1,
                                          abs=0.05 * np.max(np.cov(drawn)))


@pytest.mark.filterwarnings("ignore")
def test_intervals_of_integral_hold_in_windows_of_5_s():
    off = []
    for seed in range(4):
        columns, _ = fly(Spec(nominal="constant", seed=seed, reference="rough", duration=60.0))
        for e in launchid.identify(columns, window=5.0, formulation="integral").estimates:
            off += [[(e.a6 - A6) / e.a6_std, (e.k1 - K1) / e.k1_std]] if e.valid else []
    off = np.array(off)
    assert len(off) > 36
    assert np.all(np.mean(np.abs(off) < 1.96, axis=0) > 0.87) and np.all(np.sqrt(np.mean(off**2, axis=0)) < 1.25)
