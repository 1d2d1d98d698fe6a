"""Sums along the rows of a log: those of numpy, and an orthonormal basis whose dependent columns are 0."""

import numpy as np
import pytest

from launchid.sums import along, combined, inner, orthonormal, products, square

RANDOM = np.random.default_rng(8)
A, B, X, Y = (RANDOM.standard_normal(shape) for shape in ((50, 4), (50, 3), 50, 4))


def test_sums_are_those_of_numpy():
    assert products(A, B) == pytest.approx(A.T @ B)
    assert along(A, X) == pytest.approx(A.T @ X) and combined(A, Y) == pytest.approx(A @ Y)
    assert square(X) == pytest.approx(X @ X) and inner(X, A[:, 0]) == pytest.approx(X @ A[:, 0])


@pytest.mark.parametrize("scale", [1e-100, 1.0, 1e100])
def test_a_basis_is_orthonormal_and_gives_the_columns_back(scale):
    for a in (A, np.vander(np.linspace(0.0, 1.0, 50), 8)):  # the second of condition 1e6
        q, r = orthonormal(scale * a)
        assert q.T @ q == pytest.approx(np.eye(a.shape[1]), abs=1e-12)
        assert q @ (r / scale) == pytest.approx(a, rel=1e-12, abs=1e-13) and np.array_equal(r, np.triu(r))


def test_a_column_that_depends_on_those_before_is_nothing_and_one_that_hardly_does_is_kept():
    """A column that is off by rounding, or by a part in 1e10 of its length."""
    of_others = A[:, 0] - 2.0 * A[:, 1]
    length = np.linalg.norm(of_others)
    for off, kept in ((0.0, False), (1e-15, False), (1e-10, True)):
        q, _ = orthonormal(np.column_stack([A[:, :2], of_others + off * length * A[:, 3], A[:, 2], np.zeros(50)]))
        assert [bool(q[:, k].any()) for k in range(5)] == [True, True, kept, True, False]
