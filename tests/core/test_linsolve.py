"""Least squares by pivoted Householder QR: laws of orthogonal factors, ranks by name, NIST's certified digits.

NIST StRD linear regression sets: data and certified coefficients.

Source: National Institute of Standards and Technology, Statistical Reference
Datasets, Linear Regression: Norris, Pontius, NoInt1, Longley, Wampler1..5, Filip.
Values are kept as decimal text, so that they can be read exactly as rationals;
a test solves every set in rationals and so checks this file as well.
"""

import math
from fractions import Fraction
from typing import NamedTuple

import numpy as np
import pytest
from every import every
from hypothesis import assume, given
from hypothesis import strategies as st
from unjitted import unjitted

from launchid_core.algebra import linsolve, sparse
from launchid_core.algebra.linsolve import EPS

WAMPLER_X = " ".join(str(i) for i in range(21))

NORRIS_X = """
0.2 337.4 118.2 884.6 10.1 226.5 666.3 996.3 448.6 777.0 558.2 0.4 0.6 775.5 666.9 338.0 447.5 11.6 556.0 228.1
995.8 887.6 120.2 0.3 0.3 556.8 339.1 887.2 999.0 779.0 11.1 118.3 229.2 669.1 448.9 0.5
"""
NORRIS_Y = """
0.1 338.8 118.1 888.0 9.2 228.1 668.5 998.5 449.1 778.9 559.2 0.3 0.1 778.1 668.8 339.3 448.9 10.8 557.7 228.3
998.0 888.8 119.6 0.3 0.6 557.6 339.3 888.0 998.5 778.9 10.2 117.6 228.9 668.4 449.2 0.2
"""

PONTIUS_X = " ".join(str(150000 * (1 + i % 20)) for i in range(40))
PONTIUS_Y = """
.11019 .21956 .32949 .43899 .54803 .65694 .76562 .87487 .98292 1.09146 1.20001 1.30822 1.41599 1.52399 1.63194
1.73947 1.84646 1.95392 2.06128 2.16844 .11052 .22018 .32939 .43886 .54798 .65739 .76596 .87474 .98300 1.09150
1.20004 1.30818 1.41613 1.52408 1.63159 1.73965 1.84696 1.95445 2.06177 2.16829
"""

NOINT1_X = "60 61 62 63 64 65 66 67 68 69 70"
NOINT1_Y = "130 131 132 133 134 135 136 137 138 139 140"

# one line per observation: x1 .. x6
LONGLEY_X = """
83.0  234289 2356 1590 107608 1947
88.5  259426 2325 1456 108632 1948
88.2  258054 3682 1616 109773 1949
89.5  284599 3351 1650 110929 1950
96.2  328975 2099 3099 112075 1951
98.1  346999 1932 3594 113270 1952
99.0  365385 1870 3547 115094 1953
100.0 363112 3578 3350 116219 1954
101.2 397469 2904 3048 117388 1955
104.6 419180 2822 2857 118734 1956
108.4 442769 2936 2798 120445 1957
110.8 444546 4681 2637 121950 1958
112.6 482704 3813 2552 123366 1959
114.2 502601 3931 2514 125368 1960
115.7 518173 4806 2572 127852 1961
116.9 554894 4007 2827 130081 1962
"""
LONGLEY_Y = "60323 61122 60171 61187 63221 63639 64989 63761 66019 67857 68169 66513 68655 69564 69331 70551"

WAMPLER_Y = (
    """1 6 63 364 1365 3906 9331 19608 37449 66430 111111 177156 271453 402234 579195 813616 1118481 1508598 2000719
    2613660 3368421""",
    """1.00000 1.11111 1.24992 1.42753 1.65984 1.96875 2.38336 2.94117 3.68928 4.68559 6.00000 7.71561 9.92992 12.75603
    16.32384 20.78125 26.29536 33.05367 41.26528 51.16209 63.00000""",
    """760 -2042 2111 -1684 3888 1858 11379 17560 39287 64382 113159 175108 273291 400186 581243 811568 1121004 1506550
    2002767 2611612 3369180""",
    """75901 -204794 204863 -204436 253665 -200894 214131 -185192 221249 -138370 315911 -27644 455253 197434 783995
    608816 1370781 1303798 2205519 2408860 3444321""",
    """7590001 -20479994 20480063 -20479636 25231365 -20476094 20489331 -20460392 18417449 -20413570 20591111 -20302844
    18651453 -20077766 21059195 -19666384 26348481 -18971402 22480719 -17866340 10958421""",
)

FILIP_X = """
-6.860120914 -4.324130045 -4.358625055 -4.358426747 -6.955852379 -6.661145254 -6.355462942 -6.118102026 -7.115148017
-6.815308569 -6.519993057 -6.204119983 -5.853871964 -6.109523091 -5.79832982 -5.482672118 -5.171791386 -4.851705903
-4.517126416 -4.143573228 -3.709075441 -3.499489089 -6.300769497 -5.953504836 -5.642065153 -5.031376979 -4.680685696
-4.329846955 -3.928486195 -8.56735134 -8.363211311 -8.107682739 -7.823908741 -7.522878745 -7.218819279 -6.920818754
-6.628932138 -6.323946875 -5.991399828 -8.781464495 -8.663140179 -8.473531488 -8.247337057 -7.971428747 -7.676129393
-7.352812702 -7.072065318 -6.774174009 -6.478861916 -6.159517513 -6.835647144 -6.53165267 -6.224098421 -5.910094889
-5.598599459 -5.290645224 -4.974284616 -4.64454848 -4.290560426 -3.885055584 -3.408378962 -3.13200249 -8.726767166
-8.66695597 -8.511026475 -8.165388579 -7.886056648 -7.588043762 -7.283412422 -6.995678626 -6.691862621 -6.392544977
-6.067374056 -6.684029655 -6.378719832 -6.065855188 -5.752272167 -5.132414673 -4.811352704 -4.098269308 -3.66174277
-3.2644011
"""
FILIP_Y = """
0.8116 0.9072 0.9052 0.9039 0.8053 0.8377 0.8667 0.8809 0.7975 0.8162 0.8515 0.8766 0.8885 0.8859 0.8959 0.8913
0.8959 0.8971 0.9021 0.9090 0.9139 0.9199 0.8692 0.8872 0.8900 0.8910 0.8977 0.9035 0.9078 0.7675 0.7705 0.7713
0.7736 0.7775 0.7841 0.7971 0.8329 0.8641 0.8804 0.7668 0.7633 0.7678 0.7697 0.7700 0.7749 0.7796 0.7897 0.8131
0.8498 0.8741 0.8061 0.8460 0.8751 0.8856 0.8919 0.8934 0.8940 0.8957 0.9047 0.9129 0.9209 0.9219 0.7739 0.7681
0.7665 0.7703 0.7702 0.7761 0.7809 0.7961 0.8253 0.8602 0.8809 0.8301 0.8664 0.8834 0.8898 0.8964 0.8963 0.9074
0.9119 0.9228
"""


class Dataset(NamedTuple):
    """One set: predictors and response as text, powers of the predictors in the model, certified coefficients."""

    predictors: str
    response: str
    powers: tuple[int, ...]     # columns of the model are x^p of one predictor; (): intercept, then all predictors
    certified: tuple[str, ...]

    def exact_columns(self) -> list[list[Fraction]]:
        """Columns of the model matrix as rationals."""
        if self.powers:
            x = [Fraction(word) for word in self.predictors.split()]
            return [[value ** power for value in x] for power in self.powers]
        lines = self.predictors.strip().split("\n")
        rows = [[Fraction(1), *(Fraction(word) for word in line.split())] for line in lines]
        return [list(column) for column in zip(*rows, strict=True)]

    def exact_response(self) -> list[Fraction]:
        return [Fraction(word) for word in self.response.split()]

    def columns(self) -> np.ndarray:
        """The model matrix (n, m), one row per column, every entry rounded once."""
        return np.array([[float(value) for value in column] for column in self.exact_columns()])

    def right_hand_side(self) -> np.ndarray:
        return np.array([float(value) for value in self.exact_response()])


def _wampler(number: int, certified: tuple[str, ...]) -> Dataset:
    return Dataset(WAMPLER_X, WAMPLER_Y[number - 1], (0, 1, 2, 3, 4, 5), certified)


ONES = ("1", "1", "1", "1", "1", "1")
DATASETS = {
    "Norris": Dataset(NORRIS_X, NORRIS_Y, (0, 1), ("-0.262323073774029", "1.00211681802045")),
    "Pontius": Dataset(PONTIUS_X, PONTIUS_Y, (0, 1, 2),
                       ("0.673565789473684E-03", "0.732059160401003E-06", "-0.316081871345029E-14")),
    "NoInt1": Dataset(NOINT1_X, NOINT1_Y, (1,), ("2.07438016528926",)),
    "Longley": Dataset(LONGLEY_X, LONGLEY_Y, (),
                       ("-3482258.63459582", "15.0618722713733", "-0.358191792925910E-01", "-2.02022980381683",
                        "-1.03322686717359", "-0.511041056535807E-01", "1829.15146461355")),
    "Wampler1": _wampler(1, ONES),
    "Wampler2": _wampler(2, ("1", "0.1", "0.01", "0.001", "0.0001", "0.00001")),
    "Wampler3": _wampler(3, ONES),
    "Wampler4": _wampler(4, ONES),
    "Wampler5": _wampler(5, ONES),
    "Filip": Dataset(FILIP_X, FILIP_Y, tuple(range(11)),
                     ("-1467.48961422980", "-2772.17959193342", "-2316.37108160893", "-1127.97394098372",
                      "-354.478233703349", "-75.1242017393757", "-10.8753180355343", "-1.06221498588947",
                      "-0.670191154593408E-01", "-0.246781078275479E-02", "-0.402962525080404E-04")),
}


apply_q_transposed, dot, invert, qr_factor, scale_columns, solve_triangle = map(unjitted, (
    linsolve.apply_q_transposed, linsolve.dot, sparse.invert, linsolve.qr_factor, linsolve.scale_columns,
    linsolve.solve_triangle))

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
    assert pivots[0] / pivots[-1] <= np.linalg.cond(at.T) * (1 + 1e-6)


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


# ---- rotations


def test_a_rotation_turns_two_rows_so_that_one_element_is_nothing():
    rng, turn = np.random.default_rng(3), unjitted(linsolve.turn)
    for length in range(1, 20):
        a, b = rng.normal(size=(2, length))
        pivot, given = int(rng.integers(0, length)), np.array((a, b))
        turn(a, b, pivot, length)
        assert abs(b[pivot]) < 1e-15 and math.isclose(a[pivot], math.hypot(*given[:, pivot]), rel_tol=1e-15)
        assert np.allclose(np.array((a, b)).T @ np.array((a, b)), given.T @ given, rtol=0.0, atol=1e-14)
    a, b = np.array([0.0, 3.0]), np.array([0.0, 4.0])
    turn(a, b, 0, 2)   # no direction: nothing turns
    assert a.tolist() == [0.0, 3.0] and b.tolist() == [0.0, 4.0]
