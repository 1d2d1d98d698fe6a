"""Compiled loops have the bits of the loops as written, whatever the length, the place and the numbers."""

import math

import numba
import numpy as np
import pytest
from unjitted import unjitted_module

from launchid_core.algebra import lanes

ODD = (0.0, -0.0, np.inf, -np.inf, np.nan, 5e-324, -1e-310, 1e308, -1e160)
CASES = {  # loop -> its call
    "dot": (lambda f, y, x, s, c, i, j: f(y, x, i, j)), "subtract": (lambda f, y, x, s, c, i, j: f(y, s, x, i, j)),
    "scale": (lambda f, y, x, s, c, i, j: f(y, s, i, j)), "weigh": (lambda f, y, x, s, c, i, j: f(y, x, s, i, j)),
    "multiply": (lambda f, y, x, s, c, i, j: f(y, x, i, j)), "divide": (lambda f, y, x, s, c, i, j: f(y, s, i, j)),
    "standard": (lambda f, y, x, s, c, i, j: f(y, x, c, s, i, j)),
    "total": (lambda f, y, x, s, c, i, j: f(x, i, j)), "add_squares": (lambda f, y, x, s, c, i, j: f(y, x, i, j)),
    "four_dots": (lambda f, y, x, s, c, i, j: f(y, x, y, x, x, i, j)),
    "largest_size": (lambda f, y, x, s, c, i, j: f(x, i, j))}


WRITTEN = unjitted_module(lanes.__name__)


def called(name):
    """The loop as kernels call it."""
    loop = getattr(lanes, name)
    return numba.njit(error_model="numpy")(lambda *given: loop(*given))  # noqa: PLW0108 (jitted itself it is as written)


def bits(found):
    """The bits of numbers; a NaN is a NaN."""
    found = np.array(found, dtype=float)
    return np.where(np.isnan(found), np.nan, found).tobytes()


@pytest.mark.parametrize("name", CASES)
def test_a_compiled_loop_has_the_bits_of_the_loop_as_written(name):
    rng = np.random.default_rng(1)
    compiled, written, call = called(name), getattr(WRITTEN, name), CASES[name]
    with np.errstate(all="ignore"):
        for length in range(24):
            for start in (0, 1, 3):
                for odd in (False, True):
                    x, y = rng.normal(size=(2, 30)) * 10.0 ** rng.integers(-3, 4, (2, 30))
                    if odd:
                        x[rng.integers(0, 30, 3)] = rng.choice(ODD, 3)
                    s, c = rng.normal(size=2)
                    answers = []
                    for loop in (compiled, written):
                        z = y.copy()
                        answer = call(loop, z, x, float(s), float(c), start, start + length)
                        answers.append((bits(z), bits(0.0 if answer is None else answer)))
                    assert answers[0] == answers[1], (length, start)


def test_columns_reflected_together_have_the_bits_of_the_loop_as_written():
    rng = np.random.default_rng(2)
    compiled, written = called("reflect"), WRITTEN.reflect
    with np.errstate(all="ignore"):
        for columns in range(12):
            for length in (1, 2, 3, 5, 6, 7, 8, 9, 23):
                for first in {0, min(1, columns), columns}:
                    start = int(rng.integers(0, length))
                    at = rng.normal(size=(columns, length)) * 10.0 ** rng.integers(-3, 4, (columns, length))
                    v = rng.normal(size=length)
                    if length > 5 and columns:
                        at[rng.integers(0, columns), rng.integers(0, length)] = rng.choice(ODD)
                    answers = []
                    for loop in (compiled, written):
                        matrix = at.copy()
                        loop(v, 0.7, matrix, first, columns, start, length)
                        answers.append(bits(matrix))
                    assert answers[0] == answers[1], (columns, length, first, start)


def test_a_rotation_turns_two_rows_so_that_one_element_is_nothing():
    rng = np.random.default_rng(3)
    compiled = called("turn")
    for length in range(1, 20):
        a, b = rng.normal(size=(2, length))
        pivot, given = int(rng.integers(0, length)), np.array((a, b))
        compiled(a, b, pivot, length)
        assert abs(b[pivot]) < 1e-15 and math.isclose(a[pivot], math.hypot(*given[:, pivot]), rel_tol=1e-15)
        assert np.allclose(np.array((a, b)).T @ np.array((a, b)), given.T @ given, rtol=0.0, atol=1e-14)
    a, b = np.array([0.0, 3.0]), np.array([0.0, 4.0])
    compiled(a, b, 0, 2)   # no direction: nothing turns
    assert a.tolist() == [0.0, 3.0] and b.tolist() == [0.0, 4.0]


@pytest.mark.parametrize("name", ["dot", "four_dots"])
def test_a_sum_of_products_is_the_sum_of_products(name):
    """Each product once, wherever the column begins and ends: of integers the sum is exact in any order."""
    rng = np.random.default_rng(4)
    compiled = called(name)
    for start in range(9):
        for stop in range(start, 27):
            a, *columns = rng.integers(-99, 99, (5, 30)).astype(float)
            wanted = [math.fsum(a[start:stop] * column[start:stop]) for column in columns]
            found = compiled(a, *columns[:1 if name == "dot" else 4], start, stop)
            assert np.atleast_1d(found).tolist() == wanted[:np.size(found)], (start, stop)
