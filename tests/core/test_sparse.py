"""Sparse regression on the reduced problem: laws all four solvers share, and what each adds."""

import itertools
import math

import numpy as np
import pytest
from cut import scratch
from hypothesis import assume, given
from hypothesis import strategies as st
from unjitted import unjitted

from launchid_core import SOLVERS
from launchid_core.algebra import sparse
from launchid_core.algebra.sparse import LASSO, LASSO_SWEEPS, SR3, SR3_ITERATIONS, SSR, STLS
from launchid_core.order.table import SPARSE_WORK, WHOLE

factor_whole, refit = map(unjitted, (sparse.factor_whole, sparse.refit))
solve_stls, solve_stepwise, solve_lasso, solve_sr3 = map(unjitted, (
    sparse.solve_stls, sparse.solve_stepwise, sparse.solve_lasso, sparse.solve_sr3))

EPS = np.finfo(np.float64).eps
ALL = range(len(SOLVERS))


seeds = st.integers(0, 2**32 - 1)
thresholds = st.sampled_from((0.0, 0.05, 0.2, 0.5, 1.0, 2.0))


def solve_reduced(solver, mt, y, threshold, own=0.0):
    """(passes, xi, active, work) on a given reduced problem, columns of M as rows of mt."""
    mt, y = np.array(mt, dtype=float), np.array(y, dtype=float)
    q = y.size
    xi, active, work = np.full(q, np.nan), np.zeros(q, dtype=bool), scratch(SPARSE_WORK, q)
    whole = scratch(WHOLE, q)
    factor_whole(q, mt, whole, work.columns)
    threshold, own, out = float(threshold), float(own), (xi, active, work)
    if solver == SR3:
        passes = solve_sr3(q, mt, whole, y, threshold, own, *out)
    elif solver == LASSO:
        passes = solve_lasso(q, mt, whole, y, threshold, own, *out)
    elif own > 0.0 or solver == SSR:
        passes = solve_stepwise(q, whole, y, int(own > 0.0), own or threshold, *out)
    else:
        passes = solve_stls(q, whole, y, threshold, *out)
    return passes, *out


def solve(solver, a, y, threshold, own=0.0):
    """The same from a tall problem, reduced by numpy's QR."""
    q, r = np.linalg.qr(a)
    return solve_reduced(solver, r.T.copy(), q.T @ y, threshold, own)


def tall_least_squares(a, y):
    """numpy's answer on unit columns."""
    norms = np.linalg.norm(a, axis=0)
    return np.linalg.lstsq(a / norms, y, rcond=None)[0] / norms


def assert_least_squares_on_the_active_set(a, y, xi, active):
    assert np.all(xi[~active] == 0.0)
    norms = np.linalg.norm(a, axis=0)
    bound = 50 * y.size * EPS * norms * (norms @ np.abs(xi) + np.linalg.norm(y))
    assert np.all(np.abs(a.T @ (a @ xi - y))[active] <= bound[active])


@st.composite
def tall_problems(draw, noises=(0.0, 0.1, 3.0)):
    """(a, y, threshold): well-conditioned Gaussian columns of norms over two decades, sparse truth, noise."""
    rng = np.random.default_rng(draw(seeds))
    q = draw(st.integers(1, 8))
    m = 4 * q + draw(st.integers(0, 20))
    a = rng.standard_normal((m, q)) * 10.0 ** rng.uniform(-1, 1, q)
    truth = rng.uniform(-2, 2, q) * (rng.random(q) < 0.7)
    return a, a @ truth + draw(st.sampled_from(noises)) * rng.standard_normal(m), draw(thresholds)


def nearly_orthogonal(rng, m, q):
    """Columns of one common size, their cosines a few hundredths: here every solver finds every support."""
    basis = np.linalg.qr(rng.standard_normal((m, q)))[0]
    return basis @ (np.eye(q) + rng.uniform(-0.02, 0.02, (q, q))) * 10.0 ** rng.uniform(-2, 2)


# ---------------------------------------------------------------- laws of all solvers


@pytest.mark.parametrize("solver", ALL, ids=SOLVERS)
@given(problem=tall_problems())
def test_least_squares_on_the_active_terms_and_zero_elsewhere(solver, problem):
    a, y, threshold = problem
    passes, xi, active, _ = solve(solver, a, y, threshold)
    assert passes > 0
    assert_least_squares_on_the_active_set(a, y, xi, active)


@pytest.mark.parametrize("solver", ALL, ids=SOLVERS)
@given(problem=tall_problems())
def test_work_is_bounded(solver, problem):
    a, y, threshold = problem
    passes = solve(solver, a, y, threshold)[0]
    most = {STLS: a.shape[1] + 1, SSR: a.shape[1] + 1, SR3: SR3_ITERATIONS, LASSO: LASSO_SWEEPS}
    assert 1 <= passes <= most[solver]


@pytest.mark.parametrize("solver", ALL, ids=SOLVERS)
@given(problem=tall_problems(noises=(0.1, 3.0)))
def test_threshold_zero_keeps_every_term(solver, problem):
    a, y, _ = problem
    _, xi, active, _ = solve(solver, a, y, 0.0)
    assert np.all(active)
    norms = np.linalg.norm(a, axis=0)
    assert np.all(np.abs(xi - tall_least_squares(a, y)) * norms <= 1e-12 * np.linalg.norm(y))


@pytest.mark.parametrize("solver", ALL, ids=SOLVERS)
@given(seed=seeds, q=st.integers(1, 8))
def test_noise_free_sparse_truth_is_found(solver, seed, q):
    rng = np.random.default_rng(seed)
    a = nearly_orthogonal(rng, 5 * q, q)
    truth = rng.choice((-1.0, 1.0), q) * rng.uniform(1.5, 3.0, q) * (rng.random(q) < 0.6)
    _, xi, active, _ = solve(solver, a, a @ truth, 0.5)
    assert np.array_equal(active, truth != 0.0)
    assert np.allclose(xi, truth, rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("solver", ALL, ids=SOLVERS)
@given(seed=seeds, q=st.integers(1, 8), threshold=thresholds)
def test_orthogonal_columns_keep_exactly_the_coefficients_above_the_raw_threshold(solver, seed, q, threshold):
    """The norms of the columns do not matter: the threshold is in units of each coefficient."""
    rng = np.random.default_rng(seed)
    norms = 10.0 ** rng.uniform(-2, 2, q)
    basis = np.linalg.qr(rng.standard_normal((3 * q, q + 1)))[0]  # the last one is noise no column sees
    truth = rng.uniform(-3, 3, q)
    assume(np.min(np.abs(np.abs(truth) - threshold)) > 1e-3)
    _, xi, active, _ = solve(solver, basis[:, :q] * norms, basis[:, :q] @ (norms * truth) + basis[:, q], threshold)
    assert np.array_equal(active, np.abs(truth) >= threshold)
    assert np.allclose(xi, np.where(active, truth, 0.0), rtol=0.0, atol=1e-10)


# ---------------------------------------------------------------- laws of single solvers


def reference_stls(a, y, threshold):
    """Sequentially thresholded least squares in numpy; also how close any coefficient came to the threshold."""
    active = np.ones(a.shape[1], dtype=bool)
    margin = np.inf
    while True:
        xi = np.zeros(a.shape[1])
        if active.any():
            xi[active] = tall_least_squares(a[:, active], y)
            margin = min(margin, np.min(np.abs(np.abs(xi[active]) - threshold)))
        keep = active & (np.abs(xi) >= threshold)
        if np.array_equal(keep, active):
            return xi, active, margin
        active = keep


@pytest.mark.filterwarnings("ignore:Sparsity parameter is too big")
@pytest.mark.parametrize("threshold", [0.05, 0.5, 1.0])
def test_stls_is_pysindys(threshold):
    """pysindy's STLSQ without ridge and without its final refit, on twenty random problems."""
    stlsq = pytest.importorskip("pysindy").STLSQ
    rng = np.random.default_rng(7)
    for _ in range(20):
        q = int(rng.integers(2, 9))
        a = rng.standard_normal((60, q)) * 10.0 ** rng.uniform(-1, 1, q)
        y = a @ rng.uniform(-2, 2, q) + 0.5 * rng.standard_normal(60)
        peer = stlsq(threshold=threshold, alpha=0.0, unbias=False).fit(a, y[:, None]).coef_[0]
        _, xi, active, _ = solve(STLS, a, y, threshold)
        assert np.array_equal(active, peer != 0.0)
        assert np.allclose(xi, peer, rtol=1e-10, atol=1e-10)


def reference_ssr(a, y, threshold):
    """Stepwise sparse regression in numpy; also the smallest difference a decision hung on."""
    active = np.ones(a.shape[1], dtype=bool)
    margin = np.inf
    while active.any():
        xi = np.zeros(a.shape[1])
        xi[active] = tall_least_squares(a[:, active], y)
        sizes = np.sort(np.abs(xi[active]))
        margin = min(margin, abs(sizes[0] - threshold), *np.diff(sizes[:2]))
        if sizes[0] >= threshold:
            return xi, active, margin
        active &= np.abs(xi) > sizes[0]
    return np.zeros(a.shape[1]), active, margin


@pytest.mark.parametrize(("solver", "reference"), [(STLS, reference_stls), (SSR, reference_ssr)])
@given(problem=tall_problems())
def test_stls_and_ssr_are_the_plain_algorithms(solver, reference, problem):
    a, y, threshold = problem
    wanted, kept, margin = reference(a, y, threshold)
    assume(margin > 1e-9)
    _, xi, active, _ = solve(solver, a, y, threshold)
    assert np.array_equal(active, kept)
    assert np.all(np.abs(xi - wanted) * np.linalg.norm(a, axis=0) <= 1e-12 * np.linalg.norm(y))


@pytest.mark.parametrize("solver", ALL, ids=SOLVERS)
@given(problem=tall_problems())
def test_the_factor_of_the_active_terms_is_that_of_their_columns(solver, problem):
    """R'R is their Gram matrix, of unit columns, which is harmless at these conditions; beside it its inverse, the
    orthonormal basis and Q'y, turned alike.  Terms that left keep their length."""
    a, y, threshold = problem
    _, _, active, work = solve(solver, a, y, threshold)
    m, z = np.linalg.qr(a)[1], np.linalg.qr(a)[0].T @ y
    q, n = len(m), int(np.sum(active))
    rows, order = work.rows.reshape(q, 4 * q), work.order
    r, inverse, basis = rows[:, :q], rows[:n, q:2 * q], rows[:, 2 * q:3 * q]
    assert sorted(order[:n]) == np.flatnonzero(active).tolist() and sorted(order) == list(range(q))
    units = m / np.linalg.norm(m, axis=0)
    assert np.allclose(r.T @ r, units.T @ units, rtol=0.0, atol=1e-13)
    assert np.allclose(np.tril(r[:n][:, order[:n]], -1), 0.0, rtol=0.0, atol=1e-13)
    assert np.allclose(r[n:][:, order[:n]], 0.0, rtol=0.0, atol=1e-13)
    assert np.allclose(r[:n][:, order[:n]] @ inverse[:, order[:n]].T, np.eye(n), rtol=0.0, atol=1e-11)
    assert np.allclose(basis @ units, r, rtol=0.0, atol=1e-13)
    assert np.allclose(basis @ z, rows[:, 3 * q], rtol=0.0, atol=1e-13 * (1.0 + np.linalg.norm(z)))


@given(problem=tall_problems(), data=st.data())
def test_terms_leave_in_any_order(problem, data):
    """Least squares on what is left is that of a factorisation anew (Golub & Van Loan, 6.5.2)."""
    a, y, _ = problem
    kept = np.array(data.draw(st.lists(st.booleans(), min_size=a.shape[1], max_size=a.shape[1])))
    q, r = np.linalg.qr(a)
    xi, work, whole = np.full(len(r), np.nan), scratch(SPARSE_WORK, len(r)), scratch(WHOLE, len(r))
    factor_whole(len(r), r.T.copy(), whole, work.columns)
    assert refit(len(r), whole, q.T @ y, xi, kept, work)
    wanted = np.zeros(len(r))
    wanted[kept] = tall_least_squares(a[:, kept], y) if kept.any() else 0.0
    assert np.all(np.abs(xi - wanted) * np.linalg.norm(a, axis=0) <= 1e-12 * np.linalg.norm(y))


# ---------------------------------------------------------------- degenerate cases


def three_columns(rng):
    return rng.standard_normal((20, 3)), rng.standard_normal(20)


@pytest.mark.parametrize(("solver", "threshold"), [*itertools.product((STLS, SR3, SSR), (0.0, 0.5)), (LASSO, 0.0)])
@pytest.mark.parametrize("kind", ["duplicate", "sum of two", "zero"])
def test_dependent_columns(kind, solver, threshold):
    a, y = three_columns(np.random.default_rng(2))
    extra = {"duplicate": a[:, 1], "sum of two": a[:, 0] + a[:, 2], "zero": np.zeros(20)}[kind]
    passes, xi, _, _ = solve(solver, np.column_stack((a, extra)), y, threshold)
    assert passes == -1
    assert np.array_equal(xi, np.zeros(4))


@pytest.mark.parametrize("kind", ["sum of two", "zero"])
def test_lasso_chooses_among_dependent_columns(kind):
    """The lasso never solves on all columns, so only a dependent support fails."""
    rng = np.random.default_rng(3)
    a, _ = three_columns(rng)
    a = np.column_stack((a, a[:, 0] + a[:, 2] if kind == "sum of two" else np.zeros(20)))
    y = 2.0 * a[:, 0] + 3.0 * a[:, 1]
    passes, xi, active, _ = solve(LASSO, a, y, 0.5)
    assert passes > 0
    assert active.tolist() == [True, True, False, False]
    assert np.allclose(xi, [2.0, 3.0, 0.0, 0.0], rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("solver", ALL, ids=SOLVERS)
def test_nan_column(solver):
    passes, xi, _, _ = solve_reduced(solver, [[1.0, 0.0], [np.nan, np.nan]], [1.0, 2.0], 0.5)
    assert passes == -1
    assert np.array_equal(xi, [0.0, 0.0])


@pytest.mark.parametrize("solver", ALL, ids=SOLVERS)
def test_nan_on_the_right_hand_side_is_not_an_empty_model(solver):
    passes, xi, _, _ = solve_reduced(solver, np.eye(2), [np.nan, 2.0], 0.5)
    assert passes == -1 or np.any(np.isnan(xi))


@pytest.mark.parametrize("solver", ALL, ids=SOLVERS)
@pytest.mark.parametrize("y", [[1.0, -2.0, 3.0], [0.0, 0.0, 0.0]], ids=["all below", "zero"])
def test_threshold_above_every_coefficient_leaves_nothing(solver, y):
    passes, xi, active, _ = solve_reduced(solver, np.eye(3), y, 10.0)
    assert passes > 0
    assert not active.any()
    assert np.array_equal(xi, np.zeros(3))


@pytest.mark.parametrize("solver", ALL, ids=SOLVERS)
def test_threshold_zero_keeps_a_coefficient_that_is_exactly_zero(solver):
    passes, xi, active, _ = solve_reduced(solver, np.eye(2), [1.0, 0.0], 0.0)
    assert passes > 0
    assert np.array_equal(xi, [1.0, 0.0])
    assert active.tolist() == [True, True]


@pytest.mark.parametrize("solver", [STLS, SSR], ids=["stls", "ssr"])
def test_coefficient_equal_to_the_threshold_stays(solver):
    _, xi, active, _ = solve_reduced(solver, [[1.0]], [0.5], 0.5)
    assert active.tolist() == [True]
    assert xi.tolist() == [0.5]


# ---------------------------------------------------------------- textbook numbers


def test_stls_cuts_two_terms_at_once_where_ssr_keeps_one():
    """Columns (1, 0) and (1/2, 1), y = 0.4 a + 0.45 b: without a, b has 0.45 + 0.4 (a'b)/(b'b) = 0.61 > 0.5."""
    mt = [[1.0, 0.0], [0.5, 1.0]]
    y = [0.4 + 0.45 * 0.5, 0.45]
    assert solve_reduced(STLS, mt, y, 0.5)[1].tolist() == [0.0, 0.0]
    _, xi, active, _ = solve_reduced(SSR, mt, y, 0.5)
    assert active.tolist() == [False, True]
    assert math.isclose(xi[1], 0.61, rel_tol=8 * EPS)


# ---------------------------------------------------------------- what a term must explain by itself


def reference_own(a, y, own):
    """Backward elimination in numpy; also how close the growth of the squares came to `own`, or two terms to each
    other."""
    kept, margin = list(range(a.shape[1])), np.inf
    while kept:
        def left(columns):
            e = y - a[:, columns] @ np.linalg.lstsq(a[:, columns], y, rcond=None)[0]
            return e @ e

        growth = np.sort([left([k for k in kept if k != j]) - left(kept) for j in kept])
        margin = min(margin, abs(growth[0] - own), *np.diff(growth[:2]))
        if growth[0] >= own:
            break
        kept.pop(int(np.argmin([left([k for k in kept if k != j]) - left(kept) for j in kept])))
    return kept, margin


@pytest.mark.parametrize("solver", [STLS, SSR])
@given(problem=tall_problems(), share=st.sampled_from((1e-4, 0.01, 0.1, 0.5)))
def test_the_weakest_term_goes_while_it_explains_too_little_by_itself(solver, problem, share):
    a, y, _ = problem
    own = share * float(y @ y)
    wanted, margin = reference_own(a, y, own)
    assume(own > 0.0 and margin > 1e-6 * float(y @ y))
    _, _, active, _ = solve(solver, a, y, 0.0, own)
    assert np.flatnonzero(active).tolist() == wanted


@pytest.mark.parametrize("solver", ALL)
@given(problem=tall_problems(), exponents=st.lists(st.integers(-40, 40), min_size=8, max_size=8))
def test_what_stays_does_not_depend_on_the_units_of_the_terms(solver, problem, exponents):
    """Units by powers of two: the arithmetic is the same to the bit but for the scales."""
    a, y, _ = problem
    own = 0.01 * float(y @ y)
    scale = 2.0 ** np.array(exponents[:a.shape[1]])
    _, plain, active, _ = solve(solver, a, y, 0.0, own)
    _, scaled, same, _ = solve(solver, a * scale, y, 0.0, own)
    assert np.array_equal(active, same) and scaled * scale == pytest.approx(plain, rel=1e-9, abs=1e-12)
