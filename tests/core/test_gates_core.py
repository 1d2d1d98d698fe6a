"""Laws of the tracker and of the detector of changes; what becomes of a flight stands in test_filtered.

Kernels are called once, on a state that was made for it; the law is written beside them in numpy.
"""

import math

import numpy as np
import pytest
from cut import cut_of, moments
from unjitted import unjitted

from launchid_core import Config, Estimator
from launchid_core.filter import states as sx
from launchid_core.watch import changes as ch
from launchid_core.watch import tracker as tr
from sim.nominal import load_nominal
from sim.onboard import onboard_model

absorb, mix, move, track = map(unjitted, (tr.absorb, tr.mix, tr.move, tr.track))
follow_onset, onset_time, open_onset, raise_alarm = map(unjitted, (
    ch.follow_onset, ch.onset_time, ch.open_onset, ch.raise_alarm))

BELIEF = np.array([0.1, -0.2, 0.01, 0.002, 0.02])  # mean of a6, of k1, their variances with the covariance between
N = 4  # states of its filter
QUIET = (N, 2)  # shape of sensitivities that carry nothing


def config() -> Config:
    return Config(window=1.0, formulation="filtered", model=onboard_model(load_nominal("constant")))


def parts():
    """Memory of the constant nominal's estimator, ready for the first sample."""
    return cut_of(config())


def opened(watch, blocks: int, first: float = 0.0) -> None:
    """`blocks` blocks of 0.1 s began, with nothing carried."""
    for k in range(blocks):
        open_onset(N, watch, moments(*BELIEF), np.zeros(QUIET), first + 0.1 * k)


# ---- tracker


def test_the_mixture_has_the_members_spread_in_its_variance():
    bank = parts().state.bank
    bank.evidence[:] = 0.0, math.log(3.0)
    bank.mean[:, :2] = [[0.1, -0.3], [0.5, 0.2]]
    bank.covariance[:, :2, :2] = [[[1.0, 0.2], [0.2, 2.0]], [[3.0, -0.4], [-0.4, 5.0]]]
    mix(bank)
    w, d = np.array([0.25, 0.75]), bank.mean[:, :2] - np.array([0.4, 0.075])
    spread = np.einsum("i,ijk->jk", w, bank.covariance[:, :2, :2] + d[:, :, None] * d[:, None, :])
    assert np.array(bank.total) == pytest.approx([0.4, 0.075, spread[0, 0], spread[0, 1], spread[1, 1]])


def test_a_blocks_density_is_the_members_mixture_and_does_not_underflow():
    """Density of z = e/sqrt(v) far out: the log of the weighted sum, not the log of zero."""
    for z in (2.0, 1e4):
        cut = parts()
        bank = cut.state.bank
        bank.weight[:], bank.evidence[:] = (0.25, 0.75), (-3.0, -1.0)
        block = np.array([[1.0, 0.5, z], [0.0, 2.0, -0.5 * z], [0.0, 0.0, 0.0]])
        weight, mean, covariance = bank.weight.copy(), bank.mean.copy(), bank.covariance.copy()
        total = track(tr.slopes_of(0.0, 0.0), bank, cut.work.bank, 30.0, 0.1, block)
        density = []
        for i, (walk, slope) in enumerate(tr.MEMBERS):
            move(mean[i], covariance[i], 4, walk, slope, slope, 0.1)
            density.append(absorb(mean[i], covariance[i], cut.work.bank, 1.0, 0.5, z)
                           + absorb(mean[i], covariance[i], cut.work.bank, 0.0, 2.0, -0.5 * z))
        assert total == pytest.approx(np.logaddexp(*(np.log(weight) + density)), rel=1e-14)
        assert bank.mean == pytest.approx(mean) and bank.covariance == pytest.approx(covariance)
        assert bank.evidence == pytest.approx(np.array([-3.0, -1.0]) * math.exp(-0.1 / 30.0) + density)
        assert np.array(bank.total[:2]) == pytest.approx(bank.weight @ mean[:, :2])  # mixed with the new evidence


def test_a_member_moves_as_its_model_says():
    """x <- F x, P <- F P F' + Q: the deviations take their slopes' steps, the slopes forget themselves."""
    random = np.random.default_rng(1)
    root, mean, dt = random.standard_normal((4, 4)), random.standard_normal(4), 0.7
    covariance = root @ root.T
    keep = math.exp(-dt / tr.SLOPE_TIME)
    f = np.block([[np.eye(2), dt * np.eye(2)], [np.zeros((2, 2)), keep * np.eye(2)]])
    noise = np.diag([0.3**2 * dt] * 2 + [0.2**2 * (1.0 - keep**2), 0.1**2 * (1.0 - keep**2)])
    expected = f @ mean, f @ covariance @ f.T + noise
    move(mean, covariance, 4, 0.3, 0.2, 0.1, dt)
    assert mean == pytest.approx(expected[0]) and covariance == pytest.approx(expected[1])


def test_a_member_absorbs_as_a_kalman_filter_does():
    random = np.random.default_rng(2)
    root, mean = random.standard_normal((4, 4)), random.standard_normal(4)
    covariance, h = root @ root.T, np.array([0.4, -1.3, 0.0, 0.0])
    s, e = h @ covariance @ h + 1.0, 0.9 - h @ mean
    gain = covariance @ h / s
    expected = mean + gain * e, covariance - np.outer(gain, h @ covariance), -0.5 * (math.log(s) + e * e / s)
    density = absorb(mean, covariance, parts().work.bank, h[0], h[1], 0.9)
    assert mean == pytest.approx(expected[0]) and covariance == pytest.approx(expected[1])
    assert density == pytest.approx(expected[2])


# ---- changes: onsets


@pytest.mark.parametrize("kind", [ch.K1_JUMP, ch.BOTH_JUMP])
def test_after_an_onset_the_state_still_obeys_the_values_before(kind):
    """Density of the block under z = (h - h_past) p + h_past p_before + noise, rows in turn, as plain algebra."""
    random = np.random.default_rng(3)
    pair, carried = np.triu(random.standard_normal((7, 7))), random.standard_normal((4, 2))
    watch = parts().state.watch
    open_onset(N, watch, moments(*BELIEF), carried, 0.0)
    p = watch.covariance[kind] + ch.DRIFT**2 * 0.1 * np.eye(2)
    past = pair[:6, :4] @ carried
    h, z = pair[:6, 4:6] - past, pair[:6, 6] - past @ BELIEF[:2]
    s, e = h @ p @ h.T + np.eye(6), z - h @ BELIEF[:2]
    expected = -0.5 * (np.linalg.slogdet(s)[1] + e @ np.linalg.solve(s, e))
    assert follow_onset(N, watch, parts().work.bank, 0, kind, pair, 0.1) == pytest.approx(expected)
    assert watch.mean[0, kind] == pytest.approx(BELIEF[:2] + p @ h.T @ np.linalg.solve(s, e))


def test_the_onsets_time_is_the_mean_of_the_blocks_by_their_factors():
    watch = parts().state.watch
    opened(watch, 3, first=10.0)
    watch.factor[:3, 1] = math.log(0.2), math.log(0.5), math.log(0.3)
    mean, std = onset_time(watch, 1, 0.0, 0.1)
    assert mean == pytest.approx(0.2 * 10.0 + 0.5 * 10.1 + 0.3 * 10.2)
    assert std == pytest.approx(math.sqrt(0.2 * 0.11**2 + 0.5 * 0.01**2 + 0.3 * 0.09**2 + 0.1**2 / 12.0))


# ---- changes: events


def alarm(watch, slot: int, kind: int, t_now: float):
    """Raise it; returns the belief after, and the place of the last event."""
    after = moments(0.0, 0.0, 0.0, 0.0, 0.0)
    raise_alarm(watch, slot, kind, float(watch.factor[slot, kind]), 0.1, t_now, after)
    return after, (watch.counts.events - 1) % ch.MAX_EVENTS


def test_the_last_events_leave_oldest_first():
    estimator = Estimator(config())
    watch = estimator._parts.state.watch
    for k in range(ch.MAX_EVENTS + 3):
        opened(watch, 1, first=float(k))
        _, last = alarm(watch, int(watch.counts.next - 1) % sx.CHANGE_BLOCKS, ch.K1_JUMP, float(k))
        assert watch.event.stage[last] == ch.OPEN  # also where an older one stood
        watch.event.stage[last] = ch.FINAL
    for _ in range(2):  # asking changes nothing
        assert [change.t for change in estimator.changes()] == list(range(3, ch.MAX_EVENTS + 3))
        assert {change.parameter for change in estimator.changes()} == {"k1"}
