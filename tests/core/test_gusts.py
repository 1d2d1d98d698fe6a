"""Wind that begins anew after calm: the hypothesis beside the sudden changes, and what the filter makes of it."""

import dataclasses
import functools
import math

import numpy as np
import pytest
from cut import cut_of, moments, reseal
from unjitted import unjitted

from launchid.identification.windows import run
from launchid_core import Config, Estimator
from launchid_core.watch import gusts as gu
from sim.effects import from_text
from sim.flight import Flight, fly_whole
from sim.nominal import load_nominal
from sim.onboard import onboard_model
from sim.sections import Offsets, Wind

CALM = load_nominal("constant")
DECLARED = dataclasses.replace(CALM, wind=Wind(walk=0.005, turbulence=0.005),
                               offsets=Offsets(thrust_misalignment=0.004, attitude_bias=0.005))
BELIEF = np.array([0.1, -0.2, 0.01, 0.002, 0.02])  # mean of a6, of k1, their variances with the covariance between
FAR = 4.0  # own standard deviations

mix_gust, blow, see_block, carry_gust, follow_gust, accept_gust = map(
    unjitted, (gu.mix_gust, gu.blow, gu.see_block, gu.carry_gust, gu.follow_gust, gu.accept_gust))


def config(nominal=DECLARED, window: float = 1.0) -> Config:
    return Config(window=window, formulation="filtered", model=onboard_model(nominal))


@pytest.fixture
def cut():
    """Memory of an estimator that expects a tenth of the declared wind."""
    made = cut_of(config())
    made.state.filter.level[5:] = math.log(0.1)
    return made


def guessed(gust, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Some mean and covariance, put into the hypothesis; copies."""
    random, g = np.random.default_rng(seed), len(gust.mean)
    root = random.standard_normal((g, g))
    gust.mean[:], gust.covariance[...] = random.standard_normal(g), root @ root.T
    return gust.mean.copy(), gust.covariance.copy()


# ---- the law


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_the_mixed_start_has_the_mixtures_moments(cut, share):
    mean, covariance = guessed(cut.state.gust, 0)
    calm = np.zeros(len(mean))
    calm[-2:] = BELIEF[:2]
    still = np.zeros_like(covariance)
    still[-2:, -2:] = [[BELIEF[2], BELIEF[3]], [BELIEF[3], BELIEF[4]]]
    mix_gust(len(mean), cut.state.gust, moments(*BELIEF), share)
    d = mean - calm
    assert cut.state.gust.mean == pytest.approx((1.0 - share) * mean + share * calm)
    assert cut.state.gust.covariance == pytest.approx(
        (1.0 - share) * covariance + share * still + share * (1.0 - share) * np.outer(d, d))


def test_a_block_is_seen_as_by_a_linear_regression_and_carried_on(cut):
    gust = cut.state.gust
    mean, covariance = guessed(gust, 1)
    g = len(mean)
    random = np.random.default_rng(2)
    pair, transition = np.triu(random.standard_normal((g + 1, g + 1))), random.standard_normal((g - 2, g))
    h, z = pair[:g, :g], pair[:g, g]
    s, e = h @ covariance @ h.T + np.eye(g), z - h @ mean
    gain = covariance @ h.T @ np.linalg.inv(s)
    density = see_block(g, gust, cut.work.gust, pair)
    assert density == pytest.approx(-0.5 * (np.linalg.slogdet(s)[1] + e @ np.linalg.solve(s, e)))
    f = np.eye(g)
    f[:-2, :-2] = transition[:, :-2]
    carry_gust(cut.memory.size, gust, cut.work.gust, transition)
    assert gust.mean == pytest.approx(f @ (mean + gain @ e))
    assert gust.covariance == pytest.approx(f @ (covariance - gain @ h @ covariance) @ f.T)
    assert gust.covariance == pytest.approx(gust.covariance.T, rel=1e-12)


def test_without_data_a_gust_is_as_likely_as_they_come_and_go(cut):
    """A block that tells nothing has density 1 under both: the share goes to APART^-1/(APART^-1 + LASTS^-1)."""
    n = len(cut.state.gust.mean)
    for _ in range(400):
        density = follow_gust(cut.fixed.belief, cut.state.filter, cut.state.gust, cut.work.gust,
                              np.zeros((n + 1, n + 1)), moments(*BELIEF), 0.1, 0.0)
        assert density == pytest.approx(0.0, abs=1e-12)
    assert cut.state.gust.probability == pytest.approx(gu.GUST_LASTS / (gu.MEAN_CALM + gu.GUST_LASTS),
                                                                 rel=0.05)


# ---- in flight


@functools.cache
def gusty(angle: float) -> Flight:
    return fly_whole(CALM, 3, effects=[from_text(f"gust:angle={angle},time=40,duration=3")])


@pytest.mark.parametrize("angle", [0.01, -0.05])
def test_a_gust_after_calm_is_no_sudden_change_and_misleads_nobody(angle):
    """A gust of up to ten times the declared turbulence; without the hypothesis a change and 27 standard deviations of
    k1."""
    flight = gusty(angle)
    estimates, estimator = run(config(), (sample for sample in flight.samples() if sample.t < 48.0))
    assert estimator.changes() == ()
    told = [e for e in estimates if e.t_end > 30.0]
    assert all(e.tracked.valid for e in told)
    for e in told:
        assert abs(e.tracked.a6 - 2.0) < FAR * e.tracked.a6_std and abs(e.tracked.k1 + 7.0) < FAR * e.tracked.k1_std
        assert not e.valid or max(abs(e.a6 - 2.0) / e.a6_std, abs(e.k1 + 7.0) / e.k1_std) < FAR


def test_what_was_suspected_before_a_gap_is_nothing_after_it():
    """The error of a state that is unknown again: an estimator that never suspected a gust goes on with the same bits.
    """
    one, rows = Estimator(config()), list(gusty(-0.05).samples())
    state = one._parts.state
    at = next(k for k, row in enumerate(rows)
              if one.update(row) >= 0 and row.t > 40.0
              and state.acc.counts.rows == state.counts.waiting == 0
              and 0.01 < state.gust.probability < 0.9)
    two = Estimator(config())
    two.restore(one.save())
    two._parts.state.gust.probability, two._parts.state.gust.mean[:] = 0.0, 0.0
    two._parts.state.gust.covariance[...] = 0.0
    reseal(two)
    assert one.save() != two.save()
    for row in rows[at + 30:at + 130]:
        assert one.update(row) is two.update(row)
    assert one.save() == two.save()


def test_a_lost_k1_after_calm_is_still_found_within_a_second():
    flight = fly_whole(CALM, 3, k1_factor=lambda t: np.where(t >= 40.0, 0.7, 1.0))
    estimator = Estimator(config())
    for sample in flight.samples():
        if sample.t > 44.0:
            break
        estimator.update(sample)
    change, = estimator.changes()
    assert change.parameter == "k1" and 0.0 < change.alarm - 40.0 < 1.0
    assert abs(change.size - 2.1) < FAR * change.size_std
