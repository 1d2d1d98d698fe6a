"""Laws of the tracker and of the detector of changes; what becomes of a flight stands in test_filtered.

Kernels are called once, on a state that was made for it; the law is written beside them in numpy.
"""

import math

import numpy as np
import pytest
from cut import cut_of
from unjitted import unjitted

from launchid.identification.windows import onboard_model
from launchid_core import Config, Estimator
from launchid_core.filter import belief as bl
from launchid_core.watch import changes as ch
from launchid_core.watch import tracker as tr
from sim.nominal import load_nominal

mix, onset_time, open_onset, raise_alarm = map(unjitted, (tr.mix, ch.onset_time, ch.open_onset, ch.raise_alarm))

BELIEF = np.array([0.1, -0.2, 0.01, 0.002, 0.02])  # mean of a6, of k1, their variances with the covariance between
N = 4  # states of its filter
QUIET = (N, 2)  # shape of sensitivities that carry nothing


def config() -> Config:
    return Config(window=1.0, formulation="filtered", model=onboard_model(load_nominal("constant")))


def parts():
    """Memory of the constant nominal's estimator, ready for the first sample."""
    return cut_of(config())


def opened(watch, blocks: int, belief=BELIEF, first: float = 0.0) -> None:
    """`blocks` blocks of 0.1 s began, with nothing carried."""
    for k in range(blocks):
        open_onset(N, watch, belief, np.zeros(QUIET), first + 0.1 * k)


# ---- tracker


def test_evidence_is_judged_by_its_differences_alone():
    """exp of a flight's log density underflows: the largest is taken out first."""
    bank = parts().state.bank
    bank.evidence[:] = -5000.0, -5001.0
    mix(bank)
    assert bank.weight == pytest.approx([1.0 / (1.0 + math.exp(-1.0)), 1.0 / (1.0 + math.e)])


# ---- changes: onsets


def test_the_onsets_spread_is_never_the_root_of_a_rounding_error():
    """All but the newest block, after a long gap, began together: the variance is zero but for rounding."""
    watch = parts().state.watch
    opened(watch, 4)
    watch.start[:3], watch.start[3] = 0.0, 1e12
    for w in np.linspace(0.01, 0.99, 50):
        watch.factor[:4, 0] = 0.0, math.log(w), -1e6, -1e6
        assert onset_time(watch, 0, 0.0, 0.1)[1] >= 0.1 / math.sqrt(12.0)


# ---- changes: events


def alarm(watch, slot: int, kind: int, t_now: float):
    """Raise it; returns the belief after, and the last event."""
    after = np.zeros(bl.N_BELIEF)
    raise_alarm(watch, slot, kind, float(watch.factor[slot, kind]), 0.1, t_now, after)
    return after, watch.event[(watch.counts[ch.EVENTS] - 1) % ch.MAX_EVENTS]


def test_the_last_events_leave_oldest_first():
    estimator = Estimator(config())
    watch = estimator._parts.state.watch
    for k in range(ch.MAX_EVENTS + 3):
        opened(watch, 1, first=float(k))
        _, event = alarm(watch, int(watch.counts[ch.NEXT] - 1) % ch.ONSETS, ch.K1_JUMP, float(k))
        assert event[ch.E_STAGE] == ch.OPEN  # also where an older one stood
        event[ch.E_STAGE] = ch.FINAL
    for _ in range(2):  # asking changes nothing
        assert [change.t for change in estimator.changes()] == list(range(3, ch.MAX_EVENTS + 3))
        assert {change.parameter for change in estimator.changes()} == {"k1"}
