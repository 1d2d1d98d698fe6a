"""Fits within bounds: the least of a quadratic form, and the errors of blocks left out, against scipy's solver."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from launchid.diagnosis.estimate import Fit, bounded
from launchid.diagnosis.model import MODEL_FOLDS, SCORE_BLOCKS
from launchid.diagnosis.score import left_out


@pytest.mark.parametrize("seed", range(8))
def test_the_least_within_bounds_is_that_of_scipy(seed):
    rng = np.random.default_rng(seed)
    k = 12
    X = rng.normal(size=(40, k)) * 10.0**rng.uniform(-4, 4, k)
    X[:, 1] += 3.0 * X[:, 0] * np.std(X[:, 1]) / np.std(X[:, 0])     # two that are nearly told together
    y = rng.normal(size=40) * 3.0
    size = np.abs(np.linalg.lstsq(X, y, rcond=None)[0])
    low, high = -size * rng.uniform(0.0, 1.5, k), size * rng.uniform(0.0, 1.5, k)
    low[2], high[3], low[4], high[5] = -np.inf, np.inf, 0.0, 0.0
    known = lsq_linear(X, y, (low, high), method="bvls", tol=1e-14)
    d = bounded(X.T @ X, X.T @ y, low, high)
    assert np.all((d >= low) & (d <= high))
    assert np.any(known.active_mask != 0)
    assert np.all(known.active_mask[[2, 3]] != (-1, 1))
    assert np.allclose(d / size, known.x / size, rtol=1e-5, atol=1e-6)


def test_a_number_that_met_a_bound_on_the_way_is_set_free_again():
    """From (0, 0) towards (-4.2, 5.8) y meets its bound, then x; without x at it the least is (0.1, 1)."""
    A, b = np.array([[1.0, 0.9], [0.9, 1.0]]), np.array([1.0, 2.0])
    assert bounded(A, b, np.array([-1.0, -1.0]), np.array([0.2, 1.0])) == pytest.approx([0.1, 1.0])


def test_two_numbers_that_do_the_same_share_it_and_are_bounded():
    A = np.ones((2, 2))
    free = np.array([np.inf, np.inf])
    assert bounded(A, np.ones(2), -free, free) == pytest.approx([0.5, 0.5])
    assert bounded(A, np.ones(2), -free, np.array([0.1, np.inf])) == pytest.approx([0.1, 0.9])


def test_a_number_that_no_row_tells_stays_where_its_prior_has_it():
    A = np.diag([1.0, 1e-30])
    assert bounded(A, np.array([3.0, 0.0]), np.full(2, -5.0), np.full(2, 5.0)) == pytest.approx([3.0, 0.0])


@pytest.mark.parametrize("room", [0.02, -0.02])
def test_a_block_left_out_is_predicted_by_the_bounded_fit_to_the_others(room):
    """A linear model with one number near its bound, or at it: in some folds it stands there, and the others make up
    for it, in others it does not."""
    rng = np.random.default_rng(5)
    n, k = 240, 3
    X = rng.normal(size=(n, k))
    X[:, 1] += X[:, 0]
    y = X @ np.array([1.0, 0.5, -1.0]) + 2.0 * rng.normal(size=n)
    prior, low, high = np.full(k, 2.0), np.full(k, -np.inf), np.full(k, np.inf)
    rows, wanted = np.vstack([X, np.diag(1.0 / prior)]), np.append(y, np.zeros(k))
    high[0] = np.linalg.lstsq(rows, wanted, rcond=None)[0][0] + room

    def least(of):
        return lsq_linear(rows[of], wanted[of], (low, high), method="bvls", tol=1e-14).x

    best, fold = least(np.ones(n + k, bool)), np.arange(n) * MODEL_FOLDS * 3 // n % MODEL_FOLDS
    m = SimpleNamespace(null=np.zeros(k), prior=prior, tol=np.zeros(k), low=low, high=high, shapes=[], fold=fold,
                        block=np.arange(n) * SCORE_BLOCKS // n, white=lambda p, frozen: y - X @ p)
    errors = left_out(m, Fit(best, y - X @ best, -X, (0, 1, 2), frozenset()))
    is_at_bound = []
    for f in range(MODEL_FOLDS):
        known = least(np.append(fold != f, np.ones(k, bool)))
        is_at_bound.append(known[0] > high[0] - 1e-6)
        assert errors[fold == f] == pytest.approx((y - X @ known)[fold == f], abs=1e-4)
    assert 0 < sum(is_at_bound) < MODEL_FOLDS
