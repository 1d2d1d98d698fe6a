"""Fit, Theil's coefficient and its shares: by their definition on series made by hand, then their laws."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from launchid.comparison.prediction import NO_STATISTICS, statistics

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


def test_the_opposite_is_the_worst():
    assert statistics(Z - 1.5, 1.5 - Z).tic == pytest.approx(1.0)


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
