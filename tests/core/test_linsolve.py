"""Least squares by pivoted Householder QR: laws of orthogonal factors, ranks by name, NIST's certified digits."""

import math
from fractions import Fraction

import numpy as np
import pytest
from every import every
from hypothesis import assume, given
from hypothesis import strategies as st
from nist import DATASETS
from unjitted import unjitted

from launchid_core.algebra import lanes, linsolve, sparse
from launchid_core.algebra.linsolve import EPS

apply_q_transposed, dot, invert, pivot_ratio, qr_factor, scale_columns, solve_triangle = map(unjitted, (
    linsolve.apply_q_transposed, lanes.dot, sparse.invert, linsolve.pivot_ratio, linsolve.qr_factor,
    linsolve.scale_columns, linsolve.solve_triangle))

RANK_TOLERANCE = 1.0e-12
seeds = st.integers(0, 2**32 - 1)


def fit(at, y, tolerance=RANK_TOLERANCE):
    """(x, rank) of min |A x - y|, the inputs left alone."""
    at, y, n = np.array(at, dtype=float), np.array(y, dtype=float), len(at)
    order, tau, norms, z, x = np.zeros(n, np.int64), np.zeros(n), np.zeros(n), np.zeros(n), np.full(n, np.nan)
    scale_columns(at, norms)
    rank = qr_factor(at, order, tau, tolerance)
    if rank == n:
        apply_q_transposed(at, tau, n, y)
        solve_triangle(at, n, y, z)
        x[order] = z / norms[order]
    return x, rank


def factor(at, tolerance=RANK_TOLERANCE):
    """(factored at, order, tau, rank) of a copy of `at`."""
    n = at.shape[0]
    at, order, tau = np.array(at, dtype=float), np.zeros(n, np.int64), np.zeros(n)
    rank = qr_factor(at, order, tau, tolerance)
    return at, order, tau, rank


def triangle(at, n):
    """R as a square matrix from the factored storage."""
    return np.array([[at[j, i] if i <= j else 0.0 for j in range(n)] for i in range(n)])


def exact_least_squares(columns, y):
    """Solution of the normal equations in rationals; the columns must be independent."""
    n = len(columns)
    rows = [[sum(a * b for a, b in zip(p, q, strict=True)) for q in [*columns, y]] for p in columns]
    for k in range(n):
        pivot = next(i for i in range(k, n) if rows[i][k] != 0)
        rows[k], rows[pivot] = rows[pivot], rows[k]
        for i in range(n):
            if i != k:
                share = rows[i][k] / rows[k][k]
                rows[i] = [a - share * b for a, b in zip(rows[i], rows[k], strict=True)]
    return [rows[i][n] / rows[i][i] for i in range(n)]


def digits(x, reference):
    """-log10 of the largest relative error, at most 15; the comparison itself is exact."""
    worst = max(abs(Fraction(float(a)) - b) / abs(b) for a, b in zip(x, reference, strict=True))
    return 15.0 if worst == 0 else min(15.0, -math.log10(worst))


@st.composite
def problems(draw, spread=4.0):
    """(at, y): Gaussian columns, norms over `spread` decades either way."""
    rng = np.random.default_rng(draw(seeds))
    n = draw(st.integers(1, 6))
    m = n + draw(st.integers(0, 14))
    at = rng.standard_normal((n, m)) * 10.0 ** rng.uniform(-spread, spread, (n, 1))
    return at, rng.standard_normal(m)


# ---------------------------------------------------------------- laws


@given(problems())
def test_residual_is_orthogonal_to_every_column(problem):
    at, y = problem
    x, rank = fit(at, y)
    assume(rank == at.shape[0])
    m = y.size
    exact = [Fraction(v) for v in y]
    for column, value in zip(at, x, strict=True):
        exact = [e - Fraction(a) * Fraction(value) for e, a in zip(exact, column, strict=True)]
    residual = np.array([float(e) for e in exact])
    norms = np.linalg.norm(at, axis=1)
    assert np.all(np.abs(at @ residual) <= 20 * m * EPS * norms * (norms @ np.abs(x) + np.linalg.norm(y)))


@given(problems())
def test_reflections_keep_the_norm_of_any_vector(problem):
    at, y = problem
    at, _, tau, rank = factor(at)
    turned = y.copy()
    apply_q_transposed(at, tau, rank, turned)
    assert math.isclose(np.linalg.norm(turned), np.linalg.norm(y), rel_tol=8 * (rank + 1) * EPS)


@given(problems())
def test_q_is_orthogonal(problem):
    at, y = problem
    m = y.size
    at, _, tau, rank = factor(at)
    q = np.eye(m)
    for row in q:
        apply_q_transposed(at, tau, rank, row)  # row i becomes Q' e_i, so q is Q
    assert np.max(np.abs(q.T @ q - np.eye(m))) <= 8 * (rank + 1) * EPS


@given(problems())
def test_q_transposed_times_the_permuted_matrix_is_r(problem):
    original, _ = problem
    at, order, tau, rank = factor(original)
    n = original.shape[0]
    assume(rank == n)
    assert sorted(order) == list(range(n))
    r = triangle(at, n)
    for k in range(n):
        column = original[order[k]].copy()
        size = np.linalg.norm(column)
        apply_q_transposed(at, tau, rank, column)
        assert np.max(np.abs(column[:n] - r[:, k])) <= 8 * (n + 1) * EPS * size
        assert np.all(np.abs(column[n:]) <= 8 * (n + 1) * EPS * size)


@given(problems(), st.integers(1, 3))
def test_columns_behind_those_that_are_factored_turn_along(problem, more):
    original, y = problem
    behind = np.outer(np.arange(1.0, more + 1), y)
    at, order, tau, rank = factor(original)
    whole, along, again = np.vstack((original, behind)), np.zeros(len(original), np.int64), np.zeros(len(original))
    assert qr_factor(whole, along, again, RANK_TOLERANCE) == rank and np.array_equal(along, order)
    assert np.allclose(whole[:len(original)], at, rtol=1e-12, atol=1e-12 * np.max(np.abs(original)))
    for row, column in zip(whole[len(original):], behind, strict=True):
        apply_q_transposed(at, tau, rank, column)
        assert np.allclose(row, column, rtol=0.0, atol=1e-13 * np.linalg.norm(column))


@given(problems())
def test_pivots_fall_and_their_ratio_bounds_the_condition_from_below(problem):
    at, _ = problem
    factored, _, _, rank = factor(at)
    n = at.shape[0]
    assume(rank == n)
    pivots = np.abs(np.diag(triangle(factored, n)))
    assert np.all(pivots[1:] <= pivots[:-1] * (1 + 1e-13))
    assert pivot_ratio(factored, rank) == pivots[0] / pivots[-1]
    assert pivot_ratio(factored, rank) <= np.linalg.cond(at.T) * (1 + 1e-6)


@given(problems(), seeds)
def test_order_of_rows_does_not_matter(problem, seed):
    at, y = problem
    norms = np.linalg.norm(at, axis=1)
    singular = np.linalg.svd(at.T / norms, compute_uv=False)
    assume(singular[-1] > 1e-2)
    rows = np.random.default_rng(seed).permutation(y.size)
    x, _ = fit(at, y)
    shuffled, _ = fit(np.ascontiguousarray(at[:, rows]), y[rows])
    bound = 50 * y.size * EPS * (singular[0] / singular[-1]) * np.linalg.norm(y) / singular[-1]
    assert np.all(np.abs(shuffled - x) * norms <= bound)


@given(problems(), st.data())
def test_scaling_by_powers_of_two_is_exact(problem, data):
    """Column j times 2^k divides x_j by 2^k, y times 2^k multiplies x: to the last bit."""
    at, y = problem
    powers = np.array(data.draw(st.lists(st.integers(-200, 200), min_size=len(at), max_size=len(at))))
    shift = data.draw(st.integers(-200, 200))
    x, rank = fit(at, y)
    scaled, same = fit(np.ldexp(at, powers[:, None]), np.ldexp(y, shift))
    assert same == rank
    assert np.array_equal(scaled, np.ldexp(x, shift - powers), equal_nan=True)


@given(st.data())
def test_agrees_with_rationals_on_integer_matrices(data):
    n = data.draw(st.integers(1, 4))
    m = n + data.draw(st.integers(0, 4))
    whole = st.lists(st.integers(-9, 9), min_size=m, max_size=m)
    columns = [data.draw(whole) for _ in range(n)]
    y = data.draw(whole)
    at = np.array(columns, dtype=float)
    norms = np.linalg.norm(at, axis=1)
    assume(np.all(norms > 0))
    singular = np.linalg.svd(at.T / norms, compute_uv=False)
    assume(singular[-1] > 1e-3)
    x, rank = fit(at, y)
    exact = exact_least_squares([[Fraction(v) for v in c] for c in columns], [Fraction(v) for v in y])
    assert rank == n
    bound = 50 * m * EPS * (singular[0] / singular[-1]) * np.linalg.norm(y) / singular[-1]
    for value, reference, norm in zip(x, exact, norms, strict=True):
        assert abs(float(Fraction(float(value)) - reference)) * norm <= bound


@given(st.data())
def test_inverse_of_an_integer_triangle_is_exact(data):
    """A triangle with 1 or -1 on its diagonal has an integer inverse."""
    n = data.draw(st.integers(1, 5))
    rows = np.zeros((n, 4 * n))
    for j in range(n):
        rows[:j, j] = data.draw(st.lists(st.integers(-9, 9), min_size=j, max_size=j))
        rows[j, j] = data.draw(st.sampled_from((-1, 1)))
    invert(n, n, np.arange(n), rows)
    inverse = rows[:, n:2 * n].T
    assert np.array_equal(rows[:, :n] @ inverse, np.eye(n))
    assert np.array_equal(inverse, np.triu(inverse))


@given(problems())
def test_inverse_times_triangle_is_the_identity(problem):
    at, _ = problem
    scale_columns(at, np.zeros(len(at)))
    at, _, _, rank = factor(at)
    n = len(at)
    assume(rank == n)
    r = triangle(at, n)
    rows = np.zeros((n, 4 * n))
    rows[:, :n] = r
    invert(n, n, np.arange(n), rows)
    inverse = rows[:, n:2 * n].T
    assert np.all(np.abs(r @ inverse - np.eye(n)) <= 4 * n * EPS * (np.abs(r) @ np.abs(inverse)))


@given(st.data())
def test_back_substitution_solves_the_triangle(data):
    """Unit triangle, integers throughout: exact."""
    n = data.draw(st.integers(1, 6))
    at = np.zeros((n, n))
    for j in range(n):
        at[j, :j] = data.draw(st.lists(st.integers(-9, 9), min_size=j, max_size=j))
        at[j, j] = 1.0
    x = np.array(data.draw(st.lists(st.integers(-99, 99), min_size=n, max_size=n)), dtype=float)
    solved = np.zeros(n)
    solve_triangle(at, n, triangle(at, n) @ x, solved)
    assert np.array_equal(solved, x)


@given(st.lists(st.tuples(*[st.floats(-1e6, 1e6).filter(lambda v: v == 0 or abs(v) > 1e-6)] * 2), max_size=40),
       st.data())
def test_dot_is_the_exact_sum_to_rounding(pairs, data):
    a = np.array([pair[0] for pair in pairs])
    b = np.array([pair[1] for pair in pairs])
    start = data.draw(st.integers(0, len(pairs)))
    stop = data.draw(st.integers(start, len(pairs)))
    products = a[start:stop] * b[start:stop]
    error = abs(dot(a, b, start, stop) - math.fsum(products))
    assert error <= ((stop - start) // 4 + 6) * EPS * math.fsum(np.abs(products))


@given(problems(spread=100.0))
def test_scaled_columns_have_unit_norm(problem):
    at, y = problem
    scaled, norms = at.copy(), np.zeros(len(at))
    scale_columns(scaled, norms)
    assert np.allclose(np.linalg.norm(scaled, axis=1), 1.0, rtol=(y.size + 4) * EPS, atol=0.0)
    assert np.allclose(scaled * norms[:, None], at, rtol=8 * EPS, atol=0.0)


@pytest.mark.parametrize("power", [-308, -170, -160, -155, 155, 170, 300])
def test_columns_whose_squares_are_no_numbers_are_scaled_all_the_same(power):
    """A square has lost digits below 1e-154, below 1e-162 it is 0, above 1e154 it is inf."""
    column = np.array([3.0, -1.0, 2.5, 4.0, 0.5]) * 10.0**power
    scaled, norms = column[None].copy(), np.zeros(1)
    scale_columns(scaled, norms)
    assert np.allclose(np.linalg.norm(scaled), 1.0, rtol=8 * EPS, atol=0.0)
    assert np.allclose(scaled[0] * norms[0], column, rtol=1e-14 if power > -308 else 1e-13, atol=0.0)


@given(problems(), st.integers(0, 3))
def test_of_columns_of_one_norm_the_first_is_taken_whatever_their_rounding(problem, ulps):
    at, _ = problem
    assume(len(at) > 1)
    scale_columns(at, np.zeros(len(at)))
    assume(np.all(np.linalg.norm(at, axis=1) > 0.5))  # none is zero
    at[1:] *= 1.0 + ulps * EPS
    assert factor(at)[1][0] == 0


# ---------------------------------------------------------------- degenerate cases


SINGULAR = {  # name -> columns, rank
    "a duplicate column": ([[1, 2, 3, 4], [1, -1, 1, -1], [1, 2, 3, 4]], 2),
    "a multiple of another": ([[0.1, 0.2, 0.7], [0.1e9, 0.2e9, 0.7e9]], 1),
    **{f"a zero column at {place}": (np.insert([[1, 2, 3, 4], [1, -1, 1, -1]], place, 0, axis=0), 2)
       for place in range(3)},
    "a zero matrix": (np.zeros((2, 3)), 0), "a matrix of NaN": (np.full((2, 3), np.nan), 0),
    "fewer rows than columns": ([[1, 2], [2, 1], [1, 1]], 2)}


@pytest.mark.parametrize("name", SINGULAR)
def test_a_singular_matrix_has_its_rank_and_no_solution(name):
    columns, expected = SINGULAR[name]
    x, rank = fit(columns, np.arange(1.0, np.shape(columns)[1] + 1))
    assert rank == expected
    assert np.all(np.isnan(x))


def test_no_tolerance_still_finds_a_zero_column():
    x, rank = fit(np.array([[1.0, 2.0], [0.0, 0.0]]), np.array([1.0, 1.0]), 0.0)
    assert rank == 1
    assert np.all(np.isnan(x))


@every("bad", [np.nan, np.inf, -np.inf])
@every("column", range(2))
@every("row", range(4))
def test_one_entry_that_is_not_finite(bad, column, row):
    columns = np.array([[1.0, 2.0, 3.0, 4.0], [1.0, -1.0, 1.0, -1.0]])
    columns[column, row] = bad
    x, rank = fit(columns, np.arange(1.0, 5.0))
    assert rank < 2
    assert np.all(np.isnan(x))


def test_nan_on_the_right_hand_side_reaches_x():
    x, rank = fit(np.array([[1.0, 2.0, 3.0], [1.0, 1.0, 1.0]]), np.array([1.0, np.nan, 2.0]))
    assert rank == 2
    assert np.all(np.isnan(x))


@pytest.mark.parametrize(("columns", "y", "expected", "ulps"), [
    pytest.param([[-4.0]], [1.0], [-0.25], 0, id="one by one"),
    pytest.param([[2.0, 1.0], [1.0, 3.0]], [3.0, 4.0], [1.0, 1.0], 4, id="square: no residual"),
    pytest.param([[1.0, 2.0, 3.0], [1.0, 1.0, 1.0]], [0.0, 0.0, 0.0], [0.0, 0.0], 0, id="zero right-hand side"),
    pytest.param([[3e200, 4e200, 0.0], [0.0, 0.0, 1e-200]], [3.0, 4.0, 2.0], [1e-200, 2e200], 16,
                 id="norms whose squares overflow or vanish")])
def test_a_regular_matrix_has_its_solution(columns, y, expected, ulps):
    x, rank = fit(columns, y)
    assert rank == len(columns)
    assert np.allclose(x, expected, rtol=ulps * EPS, atol=0.0)


def test_empty_range_of_a_dot_product():
    assert dot(np.ones(3), np.ones(3), 2, 2) == 0.0


# ---------------------------------------------------------------- textbook numbers


@pytest.mark.parametrize("name", DATASETS)
def test_nist_certified_values_follow_from_the_data(name):
    """The data file against itself: rational least squares gives every certified digit (15 significant)."""
    data = DATASETS[name]
    exact = exact_least_squares(data.exact_columns(), data.exact_response())
    for value, certified in zip(exact, data.certified, strict=True):
        assert abs(value - Fraction(certified)) <= Fraction(5, 10**15) * abs(value)


@pytest.mark.parametrize(("name", "wanted"), [
    ("Norris", 12), ("Pontius", 12), ("NoInt1", 14), ("Longley", 11), ("Wampler1", 9), ("Wampler2", 12),
    ("Wampler3", 9), ("Wampler4", 7), ("Wampler5", 5), ("Filip", 7)])
def test_nist_linear_regression(name, wanted):
    """Certified values, NIST StRD, median digits over the order of the rows, which decides a digit or two by chance.

    Not a digit below LAPACK's QR with column pivoting (dgelsy) of the same columns of unit norm in the same orders.
    No tolerance: Filip's condition is 1e15, and 5e9 with columns of unit norm.
    """
    lapack = pytest.importorskip("scipy.linalg").lstsq
    data, rng = DATASETS[name], np.random.default_rng(1)
    columns, y = np.array(data.columns(), dtype=float), np.array(data.right_hand_side(), dtype=float)
    certified, norms, found = [Fraction(text) for text in data.certified], np.linalg.norm(columns, axis=1), []
    for _ in range(41):
        rows = rng.permutation(len(y))
        at = np.ascontiguousarray(columns[:, rows])
        x, rank = fit(at, y[rows], 0.0)
        assert rank == len(certified)
        beside = lapack((at / norms[:, None]).T, y[rows], cond=EPS / 64.0, lapack_driver="gelsy")[0] / norms
        found.append((digits(x, certified), digits(beside, certified)))
    ours, theirs = np.median(found, axis=0)
    assert ours >= max(wanted, theirs - 1.0)


@pytest.mark.parametrize("power", [-20, -27, -40])
def test_laeuchli_matrix_whose_gram_matrix_is_singular(power):
    """(1 1; e 0; 0 e) of Läuchli, Numer. Math. 3, 1961: 1 + e^2 rounds to 1, yet x = (1, 1)/(2 + e^2); e = 2^power."""
    e = 2.0**power
    x, rank = fit(np.array([[1.0, e, 0.0], [1.0, 0.0, e]]), np.array([1.0, 0.0, 0.0]), EPS)
    exact = 1 / (2 + Fraction(e)**2)
    assert rank == 2
    # the condition is sqrt(2)/e: the sum of the coefficients is well determined, their difference is not
    assert math.isclose(x[0] + x[1], 2 * float(exact), rel_tol=16 * EPS)
    assert abs(x[0] - x[1]) <= 16 * EPS / e
