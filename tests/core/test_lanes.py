"""Compiled loops have the bits of the loops as written, whatever the length, the place and the numbers."""

import math

import numba
import numpy as np
import pytest
from compiled import as_written

from launchid_core.algebra import lanes

ODD = (0.0, -0.0, np.inf, -np.inf, np.nan, 5e-324, -1e-310, 1e308, -1e160)
CASES = {  # loop -> its call
    "dot": (lambda f, y, x, s, c, i, j: f(y, x, i, j)), "subtract": (lambda f, y, x, s, c, i, j: f(y, s, x, i, j)),
    "scale": (lambda f, y, x, s, c, i, j: f(y, s, i, j)), "weigh": (lambda f, y, x, s, c, i, j: f(y, x, s, i, j)),
    "multiply": (lambda f, y, x, s, c, i, j: f(y, x, i, j)), "divide": (lambda f, y, x, s, c, i, j: f(y, s, i, j)),
    "standard": (lambda f, y, x, s, c, i, j: f(y, x, c, s, i, j)),
    "dot_by_place": (lambda f, y, x, s, c, i, j: f(y, x, i, j)),
    "largest_size": (lambda f, y, x, s, c, i, j: f(x, i, j))}


WRITTEN = as_written(lanes)


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


@pytest.mark.parametrize("name", ["reflect", "reflect_sized"])
def test_columns_reflected_together_have_the_bits_of_one_after_the_other(name):
    rng = np.random.default_rng(2)
    compiled, written = called(name), getattr(WRITTEN, name)
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
                        matrix, squares = at.copy(), np.full(columns, 7.0)
                        more = (squares,) if name == "reflect_sized" else ()
                        loop(v, 0.7, matrix, first, columns, start, length, *more)
                        answers.append((bits(matrix), bits(squares)))
                    assert answers[0] == answers[1], (columns, length, first, start)


@pytest.mark.parametrize("name", ["dot", "dot_by_place"])
def test_a_sum_of_products_is_the_sum_of_products(name):
    """Each product once, wherever the column begins and ends: of integers the sum is exact in any order."""
    rng = np.random.default_rng(4)
    compiled = called(name)
    for start in range(9):
        for stop in range(start, 27):
            a, b = rng.integers(-99, 99, (2, 30)).astype(float)
            assert compiled(a, b, start, stop) == math.fsum(a[start:stop] * b[start:stop]), (start, stop)
