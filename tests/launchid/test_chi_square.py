"""Chi square and averaged spectra, which judge, weak form, flights and ranges share."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from launchid.chi_square import quantile, tail
from launchid.spectra import hann, segments


@pytest.mark.parametrize(("probability", "degrees", "value"), [  # Abramowitz & Stegun, table 26.8
    (0.05, 1, 0.00393214), (0.05, 10, 3.94030), (0.05, 30, 18.4926), (0.95, 5, 11.0705), (0.99, 100, 135.807)])
def test_quantiles_are_the_tables(probability, degrees, value):
    assert quantile(probability, degrees) == pytest.approx(value, rel=1e-5)


@given(st.floats(1e-6, 1.0 - 1e-6), st.integers(1, 600))
def test_the_tail_beyond_a_quantile_is_the_rest(probability, degrees):
    assert tail(quantile(probability, degrees), degrees) == pytest.approx(1.0 - probability, rel=1e-6)


@given(st.floats(0.01, 0.99), st.floats(2.0, 100.0))
def test_quantiles_rise_with_degrees_that_need_not_be_whole(probability, degrees):
    low, between, high = (quantile(probability, x) for x in (degrees, degrees + 0.5, degrees + 1.0))
    assert low < between < high


def test_nothing_is_beyond_infinity_and_all_beyond_0():
    assert tail(0.0, 3) == 1.0 and tail(-1.0, 2) == 1.0 and tail(1e6, 5) == 0.0


def test_a_sine_has_its_power_and_a_mean_none():
    rows, bin_ = 64, 5
    t = np.arange(4 * rows)
    power = np.mean(np.abs(np.fft.rfft(segments(
        7.0 + 2.0 * np.sin(2.0 * np.pi * bin_ * t / rows), range(0, 3 * rows + 1, rows // 2), hann(rows))))**2, axis=0)
    assert power[bin_] == pytest.approx(np.sum(hann(rows))**2)   # (2 sum / 2)^2, of amplitude 2
    assert power[0] == pytest.approx(0.0, abs=1e-18) and power[bin_ + 3] == pytest.approx(0.0, abs=1e-18)
