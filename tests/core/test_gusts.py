"""Wind that begins anew after calm: the hypothesis beside the sudden changes, and what the filter makes of it."""

import dataclasses
import functools

import numpy as np
import pytest
from sealed import reseal

from launchid.identification.windows import onboard_model, run
from launchid_core import Config, Estimator
from launchid_core.filter import filtered as fl
from launchid_core.gate import ring as rb
from launchid_core.watch import gusts as gu
from sim.effects import from_text
from sim.flight import Flight, fly_whole
from sim.nominal import load_nominal
from sim.sections import Offsets, Wind

CALM = load_nominal("constant")
DECLARED = dataclasses.replace(CALM, wind=Wind(walk=0.005, turbulence=0.005),
                               offsets=Offsets(thrust_misalignment=0.004, attitude_bias=0.005))
FAR = 4.0  # own standard deviations


def config(nominal=DECLARED, window: float = 1.0) -> Config:
    return Config(window=window, formulation="filtered", model=onboard_model(nominal))


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
              if one.update(row) >= 0 and row.t > 40.0 and state.acc.counts[fl.ROWS] == state.counts[rb.WAITING] == 0
              and 0.01 < state.gust.number[gu.SHARE] < 0.9)
    two = Estimator(config())
    two.restore(one.save())
    two._parts.state.gust.number[:], two._parts.state.gust.mean[:] = 0.0, 0.0
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
