"""The likelihood of other noise levels from one filter's innovations, with what the world may do and without, and how
far predictions are off, against the joint Gaussian written out."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from launchid.diagnosis.model.ahead import horizon_variances
from launchid.diagnosis.model.lanes import LANES, likelihoods
from launchid.diagnosis.model.likelihood import likelihood, whiten

stats = pytest.importorskip("scipy.stats")
ROWS, BLOCKS = 9, 3


def system(seed, m):
    """Random stable-enough dynamics (BLOCKS, m, m), noise, measurement (3, m), sensor variances, first covariance."""
    rng = np.random.default_rng(seed)
    f = np.eye(m) + 0.2 * rng.standard_normal((BLOCKS, m, m))
    roots = 0.3 * rng.standard_normal((BLOCKS, m, m))
    c = np.zeros((3, m))
    c[[0, 1, 2], [0, 1, 2]] = 1.0
    c[1, m - 1] = 0.7   # a mode seen by the gyro
    p = np.diag(rng.uniform(0.1, 2.0, m))
    return rng, f, roots @ roots.transpose(0, 2, 1), c, rng.uniform(0.05, 0.5, 3), p


# of what the world may do: what is left after a row, one sigma that a row adds, whether a sensor sees it
WORLD = ((0.9, 0.4, False), (1.0, 0.3, False), (1.0, 0.0, True), (1.0, 0.0, False))


def in_the_world(rng, f, q, c, p, kinds):
    """The same with these states behind: they drive the others or stand on a sensor, and nothing drives them."""
    (b, m, _), w = f.shape, len(kinds)
    new_f, new_q, new_p = np.zeros((b, m + w, m + w)), np.zeros((b, m + w, m + w)), np.zeros((m + w, m + w))
    new_f[:, :m, :m], new_q[:, :m, :m], new_p[:m, :m] = f, q, p
    new_c = np.pad(c, ((0, 0), (0, w)))
    for j, (keep, fresh, is_seen) in enumerate(kinds, start=m):
        new_f[:, j, j], new_q[:, j, j], new_p[j, j] = keep, fresh**2, rng.uniform(0.1, 2.0)
        if is_seen:
            new_c[1, j] = 1.0
        else:
            new_f[:, :4, j] = 0.5 * rng.standard_normal((b, 4))
    return new_f, new_q, new_c, new_p


def root(q):
    """A factor of a covariance that may be singular: a constant has no noise."""
    values, vectors = np.linalg.eigh(q)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def written_out(block, f, q, c, r, p, resets, variances):
    """Covariance (3n, 3n) of all measurements: every state as a map from independent unit draws."""
    state, maps = np.linalg.cholesky(p), []
    for k in range(ROWS):
        if resets[k]:
            state[4:4 + len(variances)] = 0.0
            fresh = np.zeros((len(p), len(variances)))
            fresh[4:4 + len(variances)] = np.diag(np.sqrt(variances))
            state = np.hstack([state, fresh])
        maps.append(state)
        state = np.hstack([f[block[k]] @ state, root(q[block[k]])])
    width = max(each.shape[1] for each in maps)
    seen = np.vstack([c @ np.pad(each, ((0, 0), (0, width - each.shape[1]))) for each in maps])
    return seen @ seen.T + np.diag(np.tile(r, ROWS))


def innovations(z, block, f, c, gains, resets, held):
    """The innovations (n, 3) of a filter with these gains that starts at 0."""
    x, found = np.zeros(f.shape[1]), np.zeros((ROWS, 3))
    for k in range(ROWS):
        if resets[k]:
            x[4:4 + held] = 0.0
        found[k] = z[k] - c @ x
        x = f[block[k]] @ (x + gains[k] @ np.where(np.isnan(found[k]), 0.0, found[k]))
    return found


def run(arrays, base, base_gains, m, size=ROWS):
    f, block, q, c, r, p, resets, variances = arrays
    gains, low, white = np.zeros((size, m, 3)), np.zeros((size, 3, 3)), np.zeros((size, 3))
    all_rows = np.ones(ROWS, bool)
    total = likelihood(f, block, q, c, r, p.copy(), resets, variances, base, base_gains, all_rows, gains, low, white)
    return total, gains, low, white


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**20), held=st.booleans(), share=st.sampled_from([0.0, 0.3, 0.9]),
       world=st.lists(st.sampled_from(WORLD), max_size=3))
def test_it_is_the_joint_gaussian_whatever_filter_made_the_innovations(seed, held, share, world):
    m = 6 if held else 5
    rng, f, q, c, r, p = system(seed, m)
    f, q, c, p = in_the_world(rng, f, q, c, p, world)
    m += len(world)
    block = np.arange(ROWS) * BLOCKS // ROWS
    resets = np.arange(ROWS) % 2 == 0 if held else np.zeros(ROWS, bool)
    variances = np.array([0.4, 0.9]) if held else np.zeros(0)
    z = rng.standard_normal((ROWS, 3))
    z[rng.random((ROWS, 3)) < share] = math.nan
    base_gains = 0.3 * rng.standard_normal((ROWS, m, 3))
    base = innovations(z, block, f, c, base_gains, resets, len(variances))
    arrays = (f, block, q, c, r, p, resets, variances)
    total, gains, low, white = run(arrays, base, base_gains, m)
    seen = np.isfinite(z).ravel()
    covariance = written_out(block, f, q, c, r, p, resets, variances)[np.ix_(seen, seen)]
    expected = stats.multivariate_normal.logpdf(z.ravel()[seen], cov=covariance) if seen.any() else 0.0
    assert total == pytest.approx(expected, rel=1e-9, abs=1e-8)
    own = innovations(z, block, f, c, gains, resets, len(variances))  # its gains and factors are those of the filter
    again = np.zeros_like(own)
    whiten(low, own, again)
    np.testing.assert_allclose(again, white, rtol=1e-7, atol=1e-9)
    assert run(arrays, base, base_gains, m, 0)[0] == total  # nothing written, the same number


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**20), held=st.booleans(), share=st.sampled_from([0.0, 0.3, 0.9]),
       world=st.lists(st.sampled_from(WORLD), max_size=3))
def test_each_of_eight_abreast_is_what_it_is_alone_to_the_bit(seed, held, share, world):
    rng, f, q, c, r, p = system(seed, 6 if held else 5)
    f, q, c, p = in_the_world(rng, f, q, c, p, world)
    m, variances = len(p), np.array([0.4, 0.9]) if held else np.zeros(0)
    resets = np.arange(ROWS) % 2 == 0 if held else np.zeros(ROWS, bool)
    base, base_gains = rng.standard_normal((ROWS, 3)), 0.3 * rng.standard_normal((ROWS, m, 3))
    base[rng.random((ROWS, 3)) < share] = math.nan
    block, counts, scales = np.arange(ROWS) * BLOCKS // ROWS, rng.random(ROWS) < 0.7, rng.uniform(0.2, 5.0, (4, LANES))
    each = [(q * a, r * b, p * d, variances * e) for a, b, d, e in scales.T]
    totals = np.zeros((1, LANES))
    q8, r8, p8, held8 = (np.stack([one[k].ravel() for one in each], axis=-1) for k in range(4))
    likelihoods(f, block, q8, c, r8, p8, resets, held8, base, base_gains, counts, totals)
    alone = [likelihood(f, block, own_q, c, own_r, own_p.copy(), resets, held_variances, base, base_gains, counts,
                        np.zeros((0, m, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3)))
             for own_q, own_r, own_p, held_variances in each]
    assert totals[0].tolist() == alone


def test_a_log_without_measurements_has_no_information():
    _, f, q, c, r, p = system(1, 4)
    block, none = np.zeros(ROWS, np.int64), np.full((ROWS, 3), math.nan)
    total, gains, _, white = run((f, block, q, c, r, p, np.zeros(ROWS, bool), np.zeros(0)), none,
                                 np.zeros((ROWS, 4, 3)), 4)
    assert total == 0.0 and not gains.any() and not white.any()


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**20), held=st.booleans(), share=st.sampled_from([0.0, 0.4]),
       world=st.lists(st.sampled_from(WORLD), max_size=2), spacing=st.integers(1, 3), ahead=st.integers(1, 4))
def test_a_prediction_is_off_by_what_is_unknown_given_all_up_to_its_start(seed, held, share, world, spacing, ahead):
    """The conditional covariance of the joint Gaussian (Anderson, An Introduction to Multivariate Statistical Analysis,
    3rd ed., 2.5.1); held noises are drawn anew within the horizon too."""
    rng, f, q, c, r, p = system(seed, 6)
    f, q, c, p = in_the_world(rng, f, q, c, p, world)
    block, resets = np.arange(ROWS) * BLOCKS // ROWS, np.arange(ROWS) % 3 == 0 if held else np.zeros(ROWS, bool)
    variances = np.array([0.4, 0.9]) if held else np.zeros(0)
    measured = rng.random((ROWS, 3)) >= share
    found = np.zeros((-(-ROWS // spacing), 3))
    horizon_variances(f, block, q, c, r, p.copy(), resets, variances, measured, spacing, ahead, found)
    whole = written_out(block, f, q, c, r, p, resets, variances)
    for k in range(0, ROWS - ahead, spacing):
        seen = np.flatnonzero(measured[:k + 1].ravel())
        there = 3 * (k + ahead) + np.arange(3)
        known = whole[np.ix_(there, seen)] @ np.linalg.solve(whole[np.ix_(seen, seen)], whole[np.ix_(seen, there)]) \
            if len(seen) else np.zeros((3, 3))
        expected = np.diag(whole[np.ix_(there, there)] - known)
        np.testing.assert_allclose(found[k // spacing], expected, rtol=1e-7, atol=1e-9)
