"""The gate: rescheduled gains are adopted only while the margins that are required hold with them."""

import dataclasses
import functools
import math

import numpy as np
import pytest

from launchid.robustness import reconfigure as rc
from launchid.robustness.loops import loops, plants_of
from launchid.robustness.margin_spread import margin_table
from launchid_core import Tracked
from sim.nominal import Nominal, Required, load_nominal

CONSTANT = load_nominal("constant")


def tracked(a6: float, k1: float, std: float = 0.01) -> Tracked:
    return Tracked(True, a6, k1, std * abs(a6), std * abs(k1), 0.0)


def asking(**required: float) -> Nominal:
    return dataclasses.replace(CONSTANT, margins=Required(**required))


@functools.cache
def lossy(nominal_margins: tuple[tuple[str, float], ...]) -> rc.Flown:
    """A flight that loses 45 % of k1 at 30 s, of 40 s."""
    nominal = asking(**dict(nominal_margins))
    nominal = dataclasses.replace(nominal, simulation=dataclasses.replace(nominal.simulation, duration=40.0))
    return rc.fly_reconfigured(nominal, 0, 1.0, lambda t: np.where(t >= 30.0, 0.55, 1.0))


# ---- the judgement


def test_gains_that_keep_what_is_required_pass():
    decision = rc.Gate(CONSTANT).judge(30.0, tracked(2.0, -7.0 * 0.55), (1.2 / 0.55, 0.5 / 0.55))
    assert decision == rc.Decision(30.0, True, (1.2 / 0.55, 0.5 / 0.55), "")


@pytest.mark.parametrize("gains", [(3.0, 1.25), (3.0, 0.5), (1.2, 1.25), (1.25, 0.5)])
@pytest.mark.parametrize("k1", [-3.0, -7.0, -14.0])
def test_what_passes_keeps_the_required_margins(gains, k1):
    """Gains that do not pass miss one, where a6 and k1 are known all but exactly; what misses one passes where the
    legacy gains miss it by more."""
    truth = margin_table(loops(plants_of(np.array([[2.0, k1, 50.0, 0.7, 0.0]])), CONSTANT.controller, *gains))[0]
    legacy = margin_table(loops(plants_of(np.array([[2.0, k1, 50.0, 0.7, 0.0]])), CONSTANT.controller))[0]
    demand, sign = np.array([6.0, 6.0, 30.0]), np.array([-1.0, 1.0, 1.0])
    missed = sign * truth[:3] < demand
    worse = missed.any() and bool((sign * legacy[:3] < sign * truth[:3])[missed].all())
    decision = rc.Gate(CONSTANT).judge(30.0, tracked(2.0, k1, 1e-6), gains)
    assert decision.adopted == (not missed.any() or worse) and bool(decision.reason) == missed.any()
    assert decision.reason.endswith("the legacy gains keep less") == worse


def test_a_true_phase_margin_below_20_degrees_is_refused():
    """Estimates of a vehicle with twice the k1 that gains for a weak one would fly."""
    gains, truth = (3.0, 1.25), (2.0, -24.0)
    table = margin_table(loops(plants_of(np.array([[*truth, 50.0, 0.7, 0.0]])), CONSTANT.controller, *gains))[0]
    assert table[2] < 20.0
    random = np.random.default_rng(1)
    drawn = np.array(truth) * (1 + 0.03 * random.standard_normal((15, 2)))
    decisions = [rc.Gate(CONSTANT).judge(30.0, tracked(*row, 0.03), gains) for row in drawn.tolist()]
    assert all(not each.adopted and "phase margin" in each.reason for each in decisions)


def test_an_estimate_that_is_not_sure_does_not_pass_where_a_sure_one_does():
    gains = (1.2 / 0.55, 0.5 / 0.55)
    sure, not_sure = (rc.Gate(CONSTANT).judge(30.0, tracked(2.0, -7.0 * 0.55, std), gains) for std in (0.02, 0.4))
    assert sure.adopted and not not_sure.adopted
    assert "required" in not_sure.reason


def test_a_servo_that_may_be_slow_refuses_what_a_known_one_lets_pass():
    gains, estimate = (2.6, 1.1), tracked(2.0, -7.0)
    unsure = dataclasses.replace(CONSTANT, actuator=dataclasses.replace(CONSTANT.actuator, delay_sigma=0.03))
    assert rc.Gate(CONSTANT).judge(30.0, estimate, gains).adopted
    assert not rc.Gate(unsure).judge(30.0, estimate, gains).adopted


def test_an_estimate_without_numbers_does_not_pass():
    wrong = Tracked(True, math.nan, -7.0, 0.1, 0.1, 0.0)
    assert rc.Gate(CONSTANT).judge(30.0, wrong, (2.0, 0.8)).reason == "the tracked estimate is not finite"


def test_a_judgement_holds_for_a_second_if_the_gains_stay():
    gate = rc.Gate(CONSTANT)
    first = gate.judge(30.0, tracked(2.0, -4.0), (2.0, 0.8))
    assert gate.judge(30.9, tracked(2.0, -4.0), (2.01, 0.8)) is first
    assert gate.judge(31.1, tracked(2.0, -4.0), (2.01, 0.8)) is not first
    assert gate.judge(31.2, tracked(2.0, -4.0), (2.2, 0.8)).gains == (2.2, 0.8)


def test_what_the_legacy_gains_would_lose_is_not_left_to_them():
    """Three quarters of k1 gone: kp |k1| no longer holds a6 with the legacy gains, hardly with others."""
    decision = rc.Gate(CONSTANT).judge(30.0, tracked(2.0, -1.6), (2.4, 1.0))
    assert decision.adopted and "low gain margin" in decision.reason
    assert decision.reason.endswith("the legacy gains keep less")


# ---- the flight


def test_gains_that_pass_fly():
    flown = lossy(())
    assert flown.gains[-1] == pytest.approx([1.2 / 0.55, 0.5 / 0.55], rel=0.1)
    assert [each.adopted for each in flown.decisions] == [True]  # from the first gains beside the legacy ones on


def test_what_cannot_be_kept_leaves_the_legacy_gains_and_says_why():
    flown = lossy((("delay_ms", 1000.0),))  # of which more gain keeps less
    assert (flown.gains == [1.2, 0.5]).all()
    refused = flown.decisions[-1]
    assert not refused.adopted
    assert refused.reason.startswith("delay margin") and refused.reason.endswith("required 1000")


def test_nothing_required_changes_no_bit_of_what_is_believed(monkeypatch):
    """The reference is a supervisor without a gate."""
    free = lossy((("gain_db", 0.0), ("phase_deg", 0.0)))
    monkeypatch.setattr(rc.Supervisor, "passed", lambda self, estimate, belief: belief)
    lossy.cache_clear()
    without = lossy((("gain_db", 0.0), ("phase_deg", 0.0)))
    assert np.array_equal(free.rows, without.rows) and np.array_equal(free.gains, without.gains)
