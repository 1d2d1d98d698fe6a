"""Derivatives from true time stamps: exact on quartics, fourth order, and blind across gaps."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from unjitted import unjitted

from launchid_core.algebra import derivative
from launchid_core.algebra.derivative import STENCIL

differentiate, mark_segments = unjitted(derivative.differentiate), unjitted(derivative.mark_segments)

EPS = np.finfo(np.float64).eps
STEP = 1 / 64  # [s] one count of the irregular clocks below: sums of it are exact


def slopes(time, x, max_gap=1.0):
    """Derivative of x by way of `mark_segments`."""
    time, x = np.array(time, dtype=float), np.array(x, dtype=float)
    segment, slope = np.zeros(time.size, np.int64), np.full(time.size, -1.0)
    mark_segments(time, time.size, max_gap, segment)
    differentiate(time, x, time.size, segment, slope, np.full(time.size, -1.0))
    return slope


@st.composite
def clocks(draw, low=1, high=30):
    """Irregular time stamps without a gap, as exact multiples of STEP."""
    steps = draw(st.lists(st.integers(1, 4), min_size=low - 1, max_size=high - 1))
    return STEP * (draw(st.integers(-500, 500)) + np.concatenate(([0], np.cumsum(steps, dtype=np.int64))))


# ---------------------------------------------------------------- laws


@given(clocks(low=2), st.lists(st.integers(-9, 9), min_size=STENCIL, max_size=STENCIL))
def test_exact_on_polynomials_of_degree_one_less_than_the_stencil(time, coefficients):
    """Degree 4 from five rows on, 1..3 in shorter segments; errors are those of rounding x alone."""
    coefficients = coefficients[:min(STENCIL, time.size)]
    stamps = [Fraction(t) for t in time]
    exact = [sum(c * t**k for k, c in enumerate(coefficients)) for t in stamps]
    wanted = np.array([float(sum(k * c * t**(k - 1) for k, c in enumerate(coefficients) if k)) for t in stamps])
    x = np.array([float(v) for v in exact])
    assert np.all(np.abs(slopes(time, x) - wanted) <= 200 * EPS * (np.max(np.abs(x)) + 1) / STEP)


@pytest.mark.parametrize("where", ["inside", "at the ends"])
def test_fourth_order_on_a_sine(where):
    """Halving every step divides the error by 2^4, on an unevenly spaced grid."""
    rows = slice(2, -2) if where == "inside" else [0, 1, -2, -1]
    errors = []
    for n in (65, 129, 257):
        grid = np.linspace(0.0, 1.0, n)
        time = 3.0 * (grid + 0.1 * np.sin(2 * np.pi * grid) / (2 * np.pi))
        errors.append(np.max(np.abs(slopes(time, np.sin(time)) - np.cos(time))[rows]))
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(np.abs(orders - 4.0) < 0.2)
    assert errors[-1] < 1e-7


@pytest.mark.filterwarnings("ignore:invalid value encountered:RuntimeWarning")  # inf - inf, un-jitted only
@given(clocks(), clocks(), st.integers(0, 2**32 - 1))
def test_one_side_of_a_gap_does_not_see_the_other(left, right, seed):
    rng = np.random.default_rng(seed)
    right = right - right[0] + left[-1] + 2.0
    before, after = rng.standard_normal(left.size), rng.standard_normal(right.size)
    both = slopes(np.concatenate((left, right)), np.concatenate((before, after)))
    assert both[:left.size].tobytes() == slopes(left, before).tobytes()
    assert both[left.size:].tobytes() == slopes(right, after).tobytes()
    other = slopes(np.concatenate((left, right + 1.0)), np.concatenate((before, np.full(right.size, np.nan))))
    assert other[:left.size].tobytes() == both[:left.size].tobytes()
    other = slopes(np.concatenate((left - 1.0, right)), np.concatenate((np.full(left.size, np.inf), after)))
    assert other[left.size:].tobytes() == both[left.size:].tobytes()


@given(st.lists(st.integers(1, 8), max_size=30), st.integers(0, 9))
def test_segments_are_numbered_in_order_and_their_gaps_counted(steps, max_steps):
    time = np.concatenate(([0.0], STEP * np.cumsum(steps, dtype=np.int64)))
    segment = np.full(time.size, -1)
    gaps = mark_segments(time, time.size, STEP * max_steps, segment)
    wide = [int(step > max_steps) for step in steps]
    assert gaps == sum(wide)
    assert segment.tolist() == [sum(wide[:i]) for i in range(time.size)]


# ---------------------------------------------------------------- degenerate cases


def test_segment_of_one_row_has_no_slope():
    slope = slopes([0.0, 10.0, 10.5, 20.0], [1.0, 2.0, 4.0, 7.0])
    assert np.array_equal(slope, [np.nan, 4.0, 4.0, np.nan], equal_nan=True)


def test_a_step_of_exactly_the_largest_gap_is_none():
    segment = np.zeros(3, np.int64)
    assert mark_segments(np.array([0.0, 0.5, 1.25]), 3, 0.5, segment) == 1
    assert segment.tolist() == [0, 0, 1]


def test_no_rows():
    segment, slope = np.full(2, 7), np.full(2, 7.0)
    assert mark_segments(np.array([0.0, 9.0]), 0, 1.0, segment) == 0
    differentiate(np.array([0.0, 9.0]), np.array([1.0, 2.0]), 0, segment, slope, slope)
    assert segment.tolist() == [7, 7]
    assert slope.tolist() == [7.0, 7.0]


def test_rows_beyond_n_are_neither_read_nor_written():
    time, x = np.arange(8.0), np.arange(8.0)**2
    time[5:], x[5:] = np.nan, np.nan
    segment, slope = np.full(8, 7), np.full(8, 7.0)
    assert mark_segments(time, 5, 1.0, segment) == 0
    differentiate(time, x, 5, segment, slope, np.full(8, 7.0))
    assert segment.tolist() == [0] * 5 + [7] * 3
    assert slope.tolist() == [0.0, 2.0, 4.0, 6.0, 8.0, 7.0, 7.0, 7.0]


# ---------------------------------------------------------------- textbook numbers


@pytest.mark.parametrize(("row", "weights"), [
    (0, (-25, 48, -36, 16, -3)), (1, (-3, -10, 18, -6, 1)), (2, (1, -8, 0, 8, -1)), (3, (-1, 6, -18, 10, 3)),
    (4, (3, -16, 36, -48, 25))])
def test_five_point_weights(row, weights):
    """Twelve times the weights on a unit grid: Abramowitz & Stegun, table 25.2 (k = 1, five points)."""
    found = [slopes(np.arange(5.0), impulse)[row] for impulse in np.eye(5)]
    assert np.allclose(12 * np.array(found), weights, rtol=0.0, atol=64 * EPS)


def test_what_the_fifth_point_adds_is_the_difference_from_the_cubic():
    """The fifth point adds, at the middle of five rows, the slope less that of the cubic through the first four."""
    time, x = np.array([0.0, 1.0, 2.0, 3.0, 4.0]), np.array([0.0, 1.0, 5.0, 2.0, -7.0])
    slope, fifth = np.empty(5), np.empty(5)
    differentiate(time, x, 5, np.zeros(5, np.int64), slope, fifth)
    cubic = np.polyder(np.poly1d(np.polyfit(time[:4], x[:4], 3)))
    assert fifth[2] == pytest.approx(slope[2] - cubic(2.0), rel=1e-9)


def test_a_short_segment_has_no_fifth_point():
    fifth = np.full(4, 7.0)
    differentiate(np.arange(4.0), np.arange(4.0) ** 3, 4, np.zeros(4, np.int64), np.empty(4), fifth)
    assert fifth.tolist() == [0.0] * 4
