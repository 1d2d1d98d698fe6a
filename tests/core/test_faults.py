"""The fault table of docs/faults.md, a test a row: the flag, what is held meanwhile, the exact count, the recovery.

What a sensor, a clock or memory may do to an estimator in flight.  The sweep over every sample, field and kind is
`-m campaign` (`test_faults_sweep.py`).
"""

import dataclasses
import functools
import math
from collections import Counter
from collections.abc import Callable, Iterable

import numba
import numpy as np
import pytest
from cut import fed, flip, persisting, reseal
from test_estimator import trajectory
from unjitted import unjitted

from launchid_core import Config, Estimate, EstimateStatus, Estimator, Sample, Status
from launchid_core.filter import filtered
from launchid_core.order.memory import named_arrays
from sim.flight import fly_whole
from sim.nominal import load_nominal
from sim.onboard import onboard_model
from sim.sections import Offsets, Wind

is_sound = unjitted(filtered.is_sound)
NAN, INF = math.nan, math.inf
JIT = not numba.config.DISABLE_JIT
PERIOD = 0.01
CONSTANT = load_nominal("constant")
IN_WIND = dataclasses.replace(CONSTANT, wind=Wind(walk=0.005, turbulence=0.005),
                              offsets=Offsets(thrust_misalignment=0.004, attitude_bias=0.005))
A6, K1 = 2.0, -7.0
FORMULATIONS = ("integral", "filtered")
ACCEPTED, COMPLETE = Status.ACCEPTED, Status.WINDOW_COMPLETE
FORGOTTEN = 25.0  # s after a fault, at most, until windows of `filtered` are believed again (docs/faults.md)
@functools.cache
def flight(seed: int = 5) -> tuple[Sample, ...]:
    return tuple(fly_whole(CONSTANT, seed).samples())


def config(formulation: str = "integral", **choices) -> Config:
    model = onboard_model(CONSTANT) if formulation == "filtered" else None
    return Config(**{"window": 1.0, "sample_period": PERIOD, "formulation": formulation, "model": model} | choices)


@dataclasses.dataclass
class Flown:
    """The answers of an estimator."""

    estimator: Estimator
    statuses: list[Status]
    estimates: list[Estimate]

    @property
    def counted(self) -> Counter[str]:
        return Counter({name: n for name, n in self.estimator.counts.items() if n})


def fly(of: Config, samples: Iterable[Sample]) -> Flown:
    estimator, statuses, estimates = Estimator(of), [], []
    for sample in samples:
        statuses.append(estimator.update(sample))
        if statuses[-1] is COMPLETE:
            estimates.append(estimator.estimate())
    counts = Counter(statuses)
    assert all(counts[status] == estimator.counts[status.name] for status in Status)  # every call counted, once
    return Flown(estimator, statuses, estimates)


def hit(rows: range | Iterable[int], change: Callable[[Sample], Sample], length: int = 4000) -> list[Sample]:
    """The flight with some samples changed."""
    rows = frozenset(rows)
    return [change(sample) if k in rows else sample for k, sample in enumerate(flight()[:length])]


def remembered(estimator: Estimator) -> dict[str, bytes]:
    """All that persists but the counters of answers, and what follows an earlier clock."""
    found = {name: array.copy() for name, array in persisting(estimator).items()}
    for name in ("counts.answers", "clock.candidate", "guard.control", "guard.carried"):
        del found[name]
    return {name: array.tobytes() for name, array in found.items()}


def far_off(estimate: Estimate) -> float:
    """The larger error of a valid window in its own standard deviations."""
    return max(abs(estimate.a6 - A6) / estimate.a6_std, abs(estimate.k1 - K1) / estimate.k1_std)


def assert_honest(flown: Flown, most: float = 7.0) -> None:
    """Nothing that is called valid is far off, window by window and tracked."""
    for estimate in flown.estimates:
        assert not estimate.valid or far_off(estimate) < most, (estimate.t_start, estimate.a6, estimate.k1)
        tracked = estimate.tracked
        assert tracked is None or not tracked.valid or abs(tracked.a6 - A6) < most * tracked.a6_std, estimate.t_start


def assert_believed_again(flown: Flown, end: float, within: float) -> None:
    """Nine of ten windows that begin `within` s after the fault's end are valid."""
    later = [estimate.valid for estimate in flown.estimates if estimate.t_start >= end + within]
    assert len(later) >= 5 and sum(later) >= 0.9 * len(later)


# ---- one sample that is refused: as if it had not been there


REFUSED = {
    **{f"{name} {value}": ({name: value}, Status.NONFINITE) for name in ("t", "theta", "beta")
       for value in (NAN, INF, -INF)},
    **{f"{name} {value}": ({name: value}, Status.NONFINITE) for name in ("theta_dot", "theta_ddot", "beta_cmd", "gamma")
       for value in (INF, -INF)},
    **{f"{name} {value:g}": ({name: value}, Status.RANGE) for name in ("t", "theta", "beta", "theta_dot", "theta_ddot",
                                                                      "beta_cmd", "gamma")
       for value in (1e12, -1e77, 1e154, -1e300, 1.7976931348623157e308)},
}


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_sample_that_is_no_measurement_is_refused_and_leaves_nothing_behind(formulation):
    of, rows = config(formulation), flight()[:260]
    dropped = fly(of, rows[:133] + rows[134:])
    estimator = Estimator(of)
    for name, (change, status) in REFUSED.items():
        estimator.reset()
        answers = [estimator.update(row._replace(**change) if k == 133 else row) for k, row in enumerate(rows)]
        assert answers[133] is status, name
        assert answers[:133] + answers[134:] == dropped.statuses, name
        assert estimator.counts[status.name] == 1, name
        assert remembered(estimator) == remembered(dropped.estimator), name


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("name", ["theta_dot", "theta_ddot", "beta_cmd", "gamma"])
def test_what_may_be_missing_is_accepted_without(formulation, name):
    flown = fly(config(formulation), hit([133], lambda s: s._replace(**{name: NAN}), 260))
    assert flown.counted["ACCEPTED"] == 258 and flown.counted["WINDOW_COMPLETE"] == 2


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize(("back", "status"), [(1, Status.DT_ZERO), (2, Status.DT_NEGATIVE), (50, Status.DT_NEGATIVE)])
def test_a_stamp_repeated_or_late_is_refused_and_leaves_nothing_behind(formulation, back, status):
    of, rows = config(formulation), list(flight()[:260])
    late = [*rows[:133], rows[133]._replace(t=rows[133 - back].t, theta=0.5), *rows[134:]]
    flown, dropped = fly(of, late), fly(of, rows[:133] + rows[134:])
    assert flown.statuses[133] is status and flown.counted[status.name] == 1
    assert remembered(flown.estimator) == remembered(dropped.estimator)


# ---- the clock


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_clock_set_back_is_believed_after_five_samples(formulation):
    flown = fly(config(formulation), hit(range(1500, 4000), lambda s: s._replace(t=s.t - 7.0)))
    assert flown.statuses[1500:1505] == [Status.DT_NEGATIVE] * 4 + [Status.CLOCK_RESET]
    assert (flown.counted["DT_NEGATIVE"], flown.counted["CLOCK_RESET"]) == (4, 1)
    assert flown.statuses[1505:1604] == [*[ACCEPTED] * 98, COMPLETE]  # a whole window later
    assert_honest(flown)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_clock_set_back_again_and_again_is_followed_once_it_runs_for_five_samples(formulation):
    rows = [s._replace(t=s.t - 0.2 * ((min(k, 2000) - 1000) // 4)) if k >= 1000 else s
            for k, s in enumerate(flight()[:3000])]
    flown = fly(config(formulation), rows)
    assert set(flown.statuses[1004:2000]) == {Status.DT_NEGATIVE}
    assert flown.counted["CLOCK_RESET"] == 1 and flown.statuses.index(Status.CLOCK_RESET) <= 2004
    assert flown.statuses[-100:].count(COMPLETE) == 1


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_one_stamp_far_ahead_costs_five_samples(formulation):
    flown = fly(config(formulation), hit([1500], lambda s: s._replace(t=1e9)))
    assert flown.statuses[1500] in (Status.AFTER_GAP, COMPLETE)
    assert flown.statuses[1501:1506] == [Status.DT_NEGATIVE] * 4 + [Status.CLOCK_RESET]
    assert_honest(flown)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_clock_that_stands_still_is_refused_until_it_runs(formulation):
    flown = fly(config(formulation), hit(range(1500, 1600), lambda s: s._replace(t=14.99)))
    assert flown.statuses[1500:1600] == [Status.DT_ZERO] * 100 and flown.counted["DT_ZERO"] == 100
    assert flown.statuses[1600] is COMPLETE or flown.statuses[1600] is Status.AFTER_GAP
    assert ACCEPTED in flown.statuses[1601:1603]


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("length", [1, 50, 100, 1234])
def test_a_gap_is_one_new_segment_and_the_next_whole_window_is_good(formulation, length):
    rows = list(flight()[:4000])
    flown = fly(config(formulation), rows[:1533] + rows[1533 + length:])
    assert flown.statuses[1533] is (Status.AFTER_GAP if length < 67 else COMPLETE)
    assert flown.counted["AFTER_GAP"] == int(length < 67)
    assert flown.counted["RESTART"] == int(formulation == "filtered")
    assert all(status in (ACCEPTED, COMPLETE) for status in flown.statuses[1534:])
    assert_honest(flown)


def exact(t: np.ndarray) -> list[Sample]:
    """theta_ddot = A6 theta + K1 beta along a sum of sines, at any stamps."""
    theta, rate, ddot = trajectory(t)
    return [Sample(*row) for row in np.column_stack([t, theta, rate, (ddot - A6 * theta) / K1]).tolist()]


@pytest.mark.parametrize("share", [0.01, 0.1, 0.2])
def test_jitter_of_true_stamps_biases_nothing(share):
    """Uniform steps assumed instead would be off by the jitter's share."""
    shifts = np.random.default_rng(1).uniform(-share, share, 500)
    errors = {}
    for name, jitter in (("none", 0.0), ("jitter", 1.0)):
        flown = fly(config(), exact((np.arange(500) + jitter * shifts) * PERIOD))
        assert set(flown.statuses) == {ACCEPTED, COMPLETE}
        errors[name] = max(max(abs(e.a6 - A6) / A6, abs(e.k1 / K1 - 1.0)) for e in flown.estimates)
    assert errors["jitter"] < errors["none"] + 0.1 * share


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_half_the_rate_is_all_gaps_until_the_rate_is_back(formulation):
    rows = list(flight()[:4000])
    flown = fly(config(formulation), rows[:1500] + rows[1500:2500:2] + rows[2500:])
    slow = [e for e in flown.estimates if 15.0 <= e.t_start < 24.9]
    assert set(flown.statuses[1501:1990]) <= {Status.AFTER_GAP, COMPLETE} and not any(e.valid for e in slow)
    assert {e.status for e in slow} <= {EstimateStatus.GAP, EstimateStatus.LOW_INFORMATION, EstimateStatus.MODEL}
    assert_honest(flown)
    if formulation == "filtered":  # a third of the others' windows are SEPARATION on this flight
        assert_believed_again(flown, 25.0, 1.0)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_twice_the_rate_is_used(formulation):
    rows = exact(np.arange(1000) * PERIOD / 2) if formulation == "integral" else []
    for k, (one, two) in enumerate(zip(flight()[1000:1999], flight()[1001:2000], strict=True)) if not rows else ():
        middle = Sample(*(0.5 * (a + b) for a, b in zip(one, two, strict=True)))
        rows += [one._replace(t=2.0 * k * PERIOD / 2), middle._replace(t=(2.0 * k + 1.0) * PERIOD / 2)]
    flown = fly(config(formulation), rows)
    assert set(flown.statuses) == {ACCEPTED, COMPLETE}
    assert len(flown.estimates) == (5 if formulation == "integral" else 9)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("origin", [1.7e9, -1.7e9, 9.9e9])
def test_stamps_since_1970_change_nothing_that_matters(formulation, origin):
    """The stamps' rounding, 2.4e-7 s (1.9e-6 s at 1e10), is all that differs."""
    here, there = (fly(config(formulation), (s._replace(t=s.t + first) for s in flight()[:1500]))
                   for first in (0.0, origin))
    assert there.statuses == here.statuses
    for one, two in zip(here.estimates, there.estimates, strict=True):
        assert one.status == two.status
        assert not one.valid or (abs(one.a6 - two.a6) < 0.01 * one.a6_std and abs(one.k1 - two.k1) < 0.01 * one.k1_std)


def test_windows_are_counted_beyond_2_to_the_31():
    of = Config(window=0.004, sample_period=0.001)
    estimator = Estimator(of)
    for first in (0.0, 9.9e6, 9.9e9):
        answers = [estimator.update(Sample(first + k * 0.001, 0.1, 0.2, 0.3)) for k in range(40)]
        assert answers.count(COMPLETE) >= 9
        assert first - 1e-5 <= estimator.estimate().t_start <= first + 0.04
    assert estimator._parts.state.counts.index > 2**31


@pytest.mark.parametrize("near", [2**31, 2**32, 2**53])
def test_counters_go_on_beyond_the_sizes_of_smaller_numbers(near):
    estimator = Estimator(config())
    estimator._parts.state.counts.answers[:] = near - 3
    for k in range(10):
        estimator.update(Sample(k * PERIOD, 0.1, 0.2, 0.3))
    assert estimator.counts["ACCEPTED"] == near + 7


# ---- the sensors


STUCK_AT = range(2000, 2500)


@pytest.mark.parametrize("channel", ["theta", "theta_dot", "beta"])
def test_a_sensor_that_stands_still_is_stuck_and_the_next_window_is_free(channel):
    value = getattr(flight()[2000], channel)
    flown = fly(config(), hit(STUCK_AT, lambda s: s._replace(**{channel: value})))
    during = [e.status for e in flown.estimates[20:25]]
    assert during == [EstimateStatus.STUCK] * 5 and flown.counted["STUCK"] == 5
    clean = fly(config(), flight()[:4000])
    assert [e.status for e in flown.estimates[25:]] == [e.status for e in clean.estimates[25:]]
    assert [e.a6 for e in flown.estimates[25:] if e.valid] == [e.a6 for e in clean.estimates[25:] if e.valid]


@pytest.mark.parametrize("channel", ["theta", "theta_dot", "beta"])
def test_the_filter_is_honest_while_a_sensor_stands_still_and_believed_again_after(channel):
    value = getattr(flight()[1500], channel)
    flown = fly(config("filtered"), hit(range(1500, 1700), lambda s: s._replace(**{channel: value}), 7000))
    assert not any(e.valid for e in flown.estimates if 15.0 < e.t_start < 16.5) and flown.counted["STUCK"] >= 1
    assert_honest(flown)
    assert_believed_again(flown, 17.0, FORGOTTEN)


@pytest.mark.parametrize("coarse", [1e-6, 1e-4, 1e-3, 3e-3])
def test_a_coarse_sensor_is_not_stuck(coarse):
    """Steps from a hundredth to ten times the noise; how often neighbours are equal is learned."""
    rows = [s._replace(theta=round(s.theta / coarse) * coarse, theta_dot=round(s.theta_dot / coarse) * coarse,
                       beta=round(s.beta / coarse) * coarse) for s in flight()[:7000]]
    assert fly(config(), rows).counted["STUCK"] == 0


def test_a_sensor_at_its_end_stop_is_not_stuck():
    """A value that stands still there is left out as saturated."""
    rows = hit(range(2000, 2030), lambda s: s._replace(theta=0.05))
    assert fly(config(theta_saturation=0.05), rows).counted["STUCK"] == 0
    assert fly(config(), rows).counted["STUCK"] == 1


@pytest.mark.skipif(not JIT, reason="NUMBA_DISABLE_JIT=1: thousands of samples through the predictor take minutes")
@pytest.mark.parametrize("channel", ["theta", "theta_dot", "beta"])
@pytest.mark.parametrize("size", [1e-3, 1e-2, 0.1, 1.0, 30.0])
def test_one_spike_is_left_out_or_harmless(channel, size):
    flown = fly(config("filtered"), hit([2050], lambda s: s._replace(**{channel: getattr(s, channel) + size})))
    clean = fly(config("filtered"), flight()[:4000])
    assert flown.statuses == clean.statuses
    assert flown.counted["OUTLIER"] <= 1 and flown.counted["RESTART"] == 0
    assert flown.counted["OUTLIER"] == 1 or size < 0.1
    assert_honest(flown)
    assert_believed_again(flown, 20.5, 1.0)
    spoilt = fly(config(), hit([2050], lambda s: s._replace(**{channel: getattr(s, channel) + size})))
    for one, two in zip(spoilt.estimates[21:], fly(config(), flight()[:4000]).estimates[21:], strict=True):
        assert repr((one.status, one.a6, one.k1)) == repr((two.status, two.a6, two.k1))


@pytest.mark.skipif(not JIT, reason="NUMBA_DISABLE_JIT=1: thousands of samples through the predictor take minutes")
@pytest.mark.parametrize("share", [0.01, 0.05, 0.2, 0.5])
@pytest.mark.parametrize("channel", ["theta", "theta_dot"])
def test_bursts_of_spikes_are_left_out_or_flagged_and_then_forgotten(channel, share):
    random = np.random.default_rng(3)
    spikes = {k: random.choice([-1.0, 1.0]) * random.uniform(0.05, 1.0) for k in range(2000, 2500)
              if random.uniform() < share}
    rows = [s._replace(**{channel: getattr(s, channel) + spikes.get(k, 0.0)}) for k, s in enumerate(flight()[:7000])]
    flown = fly(config("filtered"), rows)
    assert flown.counted["OUTLIER"] >= 0.5 * len(spikes)
    assert_honest(flown)
    assert_believed_again(flown, 25.0, FORGOTTEN)


@pytest.mark.skipif(not JIT, reason="NUMBA_DISABLE_JIT=1: thousands of samples through the predictor take minutes")
def test_a_step_is_refused_five_times_and_then_believed():
    """No gate locks out for ever: an attitude that stays there is right."""
    step = hit(range(2050, 4000), lambda s: s._replace(theta=s.theta + 0.1))
    note = fly(config("filtered"), step[:2150]).counted
    assert 5 <= note["OUTLIER"] <= 30 and note["RESTART"] >= 1  # in three channels, twice at most; not one a sample
    assert np.median([e.rows for e in fly(config("filtered"), step).estimates[22:]]) == 100


@pytest.mark.skipif(not JIT, reason="NUMBA_DISABLE_JIT=1: thousands of samples through the predictor take minutes")
@pytest.mark.parametrize("channel", ["theta_dot", "beta"])
def test_an_offset_that_the_other_sensors_contradict_is_the_models_fault_until_it_goes(channel):
    flown = fly(config("filtered"), hit(range(2050, 3000), lambda s: s._replace(
        **{channel: getattr(s, channel) + 0.1}), 7000))
    during = [e for e in flown.estimates if 22.0 <= e.t_start < 29.0]
    assert not any(e.valid or e.tracked.valid for e in during)
    assert_honest(flown)
    assert_believed_again(flown, 30.0, 35.0)


def test_denormals_are_measurements_of_nothing():
    tiny = [s._replace(theta=1e-310 * s.theta, theta_dot=1e-310 * s.theta_dot, beta=5e-324 * math.copysign(1.0, s.beta),
                       beta_cmd=1e-310 * s.beta_cmd) for s in flight()[:500]]
    for formulation, status in (("integral", EstimateStatus.RANK), ("filtered", EstimateStatus.LOW_INFORMATION)):
        flown = fly(config(formulation), tiny)
        assert {e.status for e in flown.estimates} == {status}


def test_minus_zero_is_zero():
    one = fly(config(), (s._replace(beta=0.0) if k % 3 else s for k, s in enumerate(flight()[:500])))
    two = fly(config(), (s._replace(beta=-0.0) if k % 3 else s for k, s in enumerate(flight()[:500])))
    assert [(e.status, e.k1) for e in one.estimates if e.valid] == [(e.status, e.k1) for e in two.estimates if e.valid]


def test_a_flight_path_angle_gone_wrong_is_forgotten_when_it_is_missing_again():
    flown = fly(config("filtered"), hit(range(1500, 1510), lambda s: s._replace(gamma=90.0), 7000))
    assert flown.counted["RESTART"] <= 10
    assert_honest(flown)
    assert_believed_again(flown, 15.1, FORGOTTEN)


def swinging(turn: bool) -> list[Sample]:
    """A body that passes +-pi six times; `turn`: its sensor wraps there."""
    t = np.arange(400) * PERIOD
    theta = math.pi + 0.5 * np.sin(5.0 * t + 0.1) + 0.2 * np.sin(11.0 * t)
    rate = 2.5 * np.cos(5.0 * t + 0.1) + 2.2 * np.cos(11.0 * t)
    ddot = -12.5 * np.sin(5.0 * t + 0.1) - 24.2 * np.sin(11.0 * t)
    beta = (ddot - A6 * theta) / K1
    if turn:
        theta = np.mod(theta + math.pi, 2.0 * math.pi) - math.pi
    return [Sample(*row) for row in np.column_stack([t, theta, rate, beta]).tolist()]


def test_an_angle_that_wraps_is_unwrapped_and_counted():
    of = config(library="1,theta,beta", threshold=0.0)  # 1: whole turns are an acceleration
    wrapped, whole = fly(of, swinging(True)), fly(of, swinging(False))
    jumps = int((np.abs(np.diff([s.theta for s in swinging(True)])) > 3.0).sum())
    assert wrapped.counted["WRAP"] == jumps > 5 and whole.counted["WRAP"] == 0
    assert all(e.valid for e in wrapped.estimates)
    for one, two in zip(wrapped.estimates, whole.estimates, strict=True):
        assert (one.a6, one.k1) == (pytest.approx(two.a6, rel=1e-9), pytest.approx(two.k1, rel=1e-9))


def test_turns_are_forgotten_across_a_gap_and_a_spike_is_no_turn():
    rows = swinging(True)
    crossing = next(k for k in range(1, 400) if abs(rows[k].theta - rows[k - 1].theta) > 3.0)
    estimator = fly(config(), rows[:crossing + 1]).estimator
    assert abs(estimator._parts.state.clock.turned) == 2.0 * math.pi
    estimator.update(rows[crossing + 50])
    assert estimator._parts.state.clock.turned == 0.0
    for spike in (2.0, 3.0, -3.0, 3.2, 90.0):
        assert fly(config(), hit([1500], lambda s, spike=spike: s._replace(theta=spike), 1600)).counted["WRAP"] == 0


# ---- the vehicle


def test_a_dead_actuator_is_not_called_an_effect():
    """The nozzle stays where it is from 20 s on, whatever is commanded; the vehicle goes its way."""
    rows, random = list(flight()[:2000]), np.random.default_rng(2)
    theta, rate, beta = rows[-1].theta, rows[-1].theta_dot, rows[-1].beta
    for k in range(2000, 2300):
        theta, rate = theta + PERIOD * rate, rate + PERIOD * (A6 * theta + K1 * beta)
        noise = random.standard_normal(3)
        command = 0.01 * math.sin(0.3 * k) - 0.5 * theta
        rows.append(Sample(k * PERIOD, theta + 2e-4 * noise[0], rate + 2e-4 * noise[1], beta + 1e-4 * noise[2], NAN,
                           command))
    flown = fly(config("filtered"), rows)
    assert flown.counted["RESTART"] > 3  # the nozzle is not where the command sends it
    assert not any(e.valid for e in flown.estimates[21:])
    integral = fly(config(), rows)
    assert not any(e.valid and abs(e.k1) > 3.0 * e.k1_std and far_off(e) > 7.0 for e in integral.estimates[20:])


# ---- memory


@pytest.mark.parametrize("of", [
    config("integral"), config("filtered", model=onboard_model(IN_WIND)),  # in wind, as much of the memory as there is
    pytest.param(config("filtered"), marks=pytest.mark.campaign)], ids=["integral", "filtered in wind", "filtered"])
def test_every_word_of_the_state_that_changes_by_itself_is_seen(of):
    """The change is seen within a window, at the first use; then everything is as of a new estimator that begins with
    that sample."""
    rows = flight()[:400]
    one = fly(of, rows[:155]).estimator
    saved, counted = one.save(), one.counts
    for name, array in persisting(one).items():
        if name.startswith("outcome") or name == "counts.answers":
            continue
        own = range(array.size)
        # each word of the small arrays, some of the large ones; every bit in turn
        for turn, place in enumerate(own if len(own) < 40 else own[::max(1, len(own) // 25)]):
            one.restore(saved)
            flip(array, place, 7 * turn % 63)
            assert_found(one, of, rows, counted, f"{name}[{place}]", unused=name in ("ring", "seals", "rows"))


@pytest.mark.parametrize("place", [0, 10])
def test_a_row_of_the_block_that_changes_by_itself_is_seen(place):
    """A block at 1 kHz is gathered ten samples at a time: its rows wait from one to the next."""
    of = config("filtered", window=0.5, sample_period=0.001, model=onboard_model(CONSTANT, 0.001))
    rows = [Sample(0.001 * k, 1e-4 * math.sin(k), 1e-4 * math.cos(k), 1e-4 * math.sin(2 * k), NAN, 0.0)
            for k in range(200)]
    one = fly(of, rows[:155]).estimator
    waiting = persisting(one)["rows"]
    count = one._parts.state.acc.counts.rows
    assert count == 3 * 50 and waiting[place, :count].any()
    flip(waiting, int(np.ravel_multi_index((place, count), waiting.shape)), 3)  # is written before it is read
    flip(waiting, int(np.ravel_multi_index((place, count - 1), waiting.shape)), 3)
    answers = [one.update(row) for row in rows[155:]]
    assert answers.index(Status.RECOVERED) == 4 and answers.count(Status.RECOVERED) == 1


def assert_found(one: Estimator, of: Config, rows: tuple[Sample, ...], counted: dict[str, int], name: str,
                 unused: bool) -> None:
    answers = []
    for k in range(155, 300):
        answers.append(one.update(rows[k]))
        if answers[-1] is Status.RECOVERED:
            break
    if unused and Status.RECOVERED not in answers:
        return  # a row that was used before, or is written before it is read
    assert answers[-1] is Status.RECOVERED, name
    assert one.counts["RECOVERED"] == 1 and len(answers) <= 45, name
    assert sum(one.counts[s.name] for s in Status) == sum(counted[s.name] for s in Status) + len(answers)
    new = fly(of, rows[k:k + 1]).estimator
    assert remembered(one) == remembered(new), name


def test_a_damaged_outcome_raises_nothing_and_is_overwritten_by_the_next_window():
    of, rows = config(), flight()[:300]
    one = fly(of, rows[:155]).estimator
    saved = one.save()
    clean = fly(of, rows).estimates[-1]
    for name, array in named_arrays(one._parts.state.outcome):
        for place in range(array.size):
            for bit in (0, 33, 62):
                one.restore(saved)
                flip(array, place, bit)
                assert isinstance(one.estimate(), Estimate), name
                for row in rows[155:]:
                    one.update(row)
                assert (one.estimate().a6, one.estimate().status) == (clean.a6, clean.status)


def test_a_bad_sample_does_not_begin_anew():
    one = fly(config(), flight()[:155]).estimator
    one._parts.state.clock.first += 0.25
    assert one.update(Sample(NAN, 0.0, 0.0, 0.0)) is Status.NONFINITE
    assert one.update(flight()[155]) is Status.RECOVERED
    assert one.counts["NONFINITE"] == one.counts["RECOVERED"] == 1


def test_what_cannot_be_is_not_sound_each_by_itself():
    """A variance of 0 is (a known parameter), one below is not; nor is anything that is no number, nor a noise level
    1e10 times the declared."""
    parts = fly(config("filtered"), flight()[:155]).estimator._parts
    size, fil, total = parts.fixed.belief.size, parts.state.filter, parts.state.bank.total
    assert is_sound(size, fil, total)
    for array in (fil.x, fil.p, fil.level, *total):
        for place in np.ndindex(array.shape):
            kept = array[place]
            array[place] = NAN
            assert not is_sound(size, fil, total), place
            array[place] = kept
    for name in ("var_a6", "var_k1"):
        for value, sound in ((0.0, True), (-1e-12, False)):
            kept = getattr(total, name)
            setattr(total, name, value)
            assert is_sound(size, fil, total) == sound
            setattr(total, name, kept)
    for place in range(len(fil.level)):
        fil.level[place] = -math.log(1e10)
        assert not is_sound(size, fil, total)
        fil.level[place] = 0.0


@pytest.mark.parametrize("part", ["x", "p", "level"])
def test_what_is_not_sound_is_forgotten_and_said(part):
    """The way it came about does not matter: the seals fit."""
    one = fly(config("filtered"), flight()[:1500]).estimator
    getattr(one._parts.state.filter, part).flat[0] = NAN
    reseal(one)
    answers = [one.update(row) for row in flight()[1500:1600]]
    assert answers.count(Status.RECOVERED) == 1 and answers.index(Status.RECOVERED) < 10
    one = fed(one, flight()[1600:7000])
    assert one.estimate().tracked.valid and abs(one.estimate().tracked.a6 - A6) < 6 * one.estimate().tracked.a6_std
