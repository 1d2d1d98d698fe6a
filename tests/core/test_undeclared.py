"""Wind and misalignment that no nominal declared: never a confident number once they can be told."""

import dataclasses
import functools
import math

import numpy as np
import pytest
from cut import carried, cut_of, fed, reseal
from unjitted import unjitted

from launchid.identification.windows import run
from launchid.judge.refusal import withdrawn
from launchid.report.identification import next_step, report
from launchid.robustness.level import ranged_model
from launchid_core import Config, EstimateStatus, Estimator, Status
from launchid_core.filter import states as sx
from launchid_core.order.memory import named_arrays
from launchid_core.watch import undeclared as un
from sim.effects import from_text
from sim.flight import fly_whole
from sim.nominal import load_nominal
from sim.onboard import onboard_model
from sim.plant import parameters
from sim.sections import Offsets, Wind

NOMINALS = ("constant", "vega_like", "greensite_cr826")
WINDOW = 5.0
FAR = 3.0  # own standard deviations
SEED = 31

distance, restart, reduce_moment, begin_block, go_back = map(unjitted, (
    un.distance, un.restart_undeclared, un.reduce_moment, un.begin_block, un.go_back))


def config(nominal) -> Config:
    return Config(window=WINDOW, formulation="filtered", model=onboard_model(nominal))


@pytest.fixture
def state():
    return cut_of(config(load_nominal("constant"))).state.undeclared


def sudden(name: str, effect: str) -> Estimator:
    """The estimator after a flight whose nominal declares nothing."""
    nominal = load_nominal(name)
    return run(config(nominal), fly_whole(nominal, SEED, effects=[from_text(effect)]).samples())[1]


@functools.cache
def flown(name: str, effect: str = ""):
    """The windows of one flight whose nominal declares nothing, whether it was there at their ends, which of them
    lie."""
    nominal, effects = load_nominal(name), [from_text(effect)] if effect else []
    flight = fly_whole(nominal, SEED, effects=effects)
    estimator, windows, there = Estimator(config(nominal)), [], []
    for sample in flight.samples():
        if estimator.update(sample) is Status.WINDOW_COMPLETE:
            windows.append(estimator.estimate())
            there.append(int(estimator._parts.state.undeclared.found))
    (a6, k1) = parameters(nominal, np.array([0.5 * (w.t_start + w.t_end) for w in windows]), effects=effects)
    lies = [w.valid and (abs(w.a6 - a) > FAR * w.a6_std or abs(w.k1 - k) > FAR * w.k1_std)
            for w, a, k in zip(windows, a6, k1, strict=True)]
    return windows, np.array(there), np.array(lies)


# ---- the law


def test_the_distance_is_walds(state):
    random = np.random.default_rng(1)
    root = random.standard_normal((un.UNDECLARED_SIZE, un.UNDECLARED_SIZE))
    mean, covariance = random.standard_normal(un.UNDECLARED_SIZE), root @ root.T
    part, square = mean[un.WIND_STATES:], covariance[un.WIND_STATES:, un.WIND_STATES:]
    assert distance(mean, covariance) == pytest.approx(part @ np.linalg.solve(square, part))
    covariance[4, 4] = -covariance[4, 4]
    assert distance(mean, covariance) == math.inf
    assert distance(np.zeros(un.UNDECLARED_SIZE), np.eye(un.UNDECLARED_SIZE)) == 0.0


def test_what_hides_in_the_declared_noise_contradicts_nothing():
    """A block of noise at a fifth of the declared says what it would say in the declared noise."""
    cut = cut_of(config(load_nominal("constant")))
    work, triangle = cut.work.undeclared, np.triu(np.random.default_rng(2).standard_normal((11, 11)))
    reduce_moment(cut.fixed.belief, work, triangle, 1.0)
    whole = work.triangle.copy()
    gram = triangle[:, [4 + cut.memory.size.theta, 4 + cut.memory.size.beta, 8, 10]]
    assert whole.T @ whole == pytest.approx(gram.T @ gram)
    reduce_moment(cut.fixed.belief, work, triangle, 0.2)
    assert work.triangle == pytest.approx(0.2 * whole)


# ---- in flight


@pytest.mark.parametrize("name", NOMINALS)
def test_a_clean_flight_is_believed(name):
    windows, there, lies = flown(name)
    assert not there.any() and lies.sum() <= 1 and all(w.status is EstimateStatus.OK for w in windows)
    assert windows[-1].tracked.valid


@pytest.mark.parametrize("name", NOMINALS)
def test_a_steady_wind_that_rests_on_a6_is_found_and_never_lied_of_again(name):
    """Half a degree: within a window it is another a6, 20 to 60 % off, with standard deviations of a few percent."""
    windows, there, lies = flown(name, "steady_wind:angle=0.0087")
    assert there[-1] == 1 and not windows[-1].tracked.valid and not windows[-1].valid
    first = int(np.argmax(there))
    assert first * WINDOW <= 45.0 and not lies[first:].any()  # quiet parts tell nothing: no reason to believe


@pytest.mark.parametrize("name", NOMINALS)
def test_a_misalignment_is_found(name):
    windows, there, lies = flown(name, "thrust_misalignment:angle=0.003")
    assert there[-1] == 1 and lies.sum() <= 1 and not windows[-1].valid


@pytest.mark.parametrize("name", NOMINALS)
def test_a_lost_k1_is_none(name):
    windows, there, _ = flown(name, "control_loss:fraction=0.3,time=20")
    assert not there.any() and windows[-1].tracked.valid


@pytest.mark.parametrize("name", ["vega_like", "greensite_cr826"])
def test_it_is_believed_again_when_the_wind_has_gone(name):
    """A wind that swells and falls within 40 s."""
    windows, there, _ = flown(name, "gust:angle=0.02,time=5,duration=40")
    assert there.any() and there[-1] == 0 and windows[-1].tracked.valid


@pytest.mark.parametrize("name", NOMINALS)
def test_a_gust_is_no_chain_of_sudden_changes_that_the_tracked_estimate_follows(name):
    """Three degrees for 6 s: a6 was tracked as gone, then as several times itself, each a valid change."""
    windows, _, _ = flown(name, "gust:angle=0.05,time=30,duration=6")
    nominal = load_nominal(name)
    _, k1 = parameters(nominal, np.array([w.t_end for w in windows]))
    wrong = [w.tracked.valid and abs(w.tracked.k1 - true) > 5.0 * w.tracked.k1_std
             for w, true in zip(windows, k1, strict=True)]
    assert sum(wrong) <= 1 and windows[-1].tracked.valid


@pytest.mark.parametrize("effect", ["steady_wind:angle=0.03", "thrust_misalignment:angle=0.004",
                                    "attitude_bias:angle=0.005", "gust:angle=0.05,time=30,duration=6",
                                    "periodic_disturbance:amplitude=0.01,frequency=5", "bending:gain=0.1,frequency=15"])
@pytest.mark.parametrize("name", NOMINALS)
def test_what_contradicts_the_model_was_no_sudden_change(name, effect):
    """Each raises an alarm before it contradicts; what is asked for afterwards holds none, and counts them."""
    estimator = sudden(name, effect)
    assert estimator.changes() == ()
    assert estimator.counts["CHANGE_WITHDRAWN"] > 0 or not estimator._parts.state.watch.counts.events


@pytest.mark.parametrize("blocks", [1, 2, sx.CHANGE_BLOCKS - 1, sx.CHANGE_BLOCKS])
def test_a_change_takes_back_what_was_learned_since_its_onset_and_at_most_two_looks_back_more(state, blocks):
    """The law holds after each number of blocks: the mean says in how many it was learned."""
    restart(state)
    for taken in range(1, 4 * sx.CHANGE_BLOCKS):
        begin_block(state)
        state.mean[un.CONSTANT, 4], state.covariance[un.CONSTANT, 5, 5] = taken, 1.0 + taken
        before = state.mean.copy(), state.covariance.copy(), state.past.copy()
        go_back(state, blocks)
        left = state.mean[un.CONSTANT, 4]
        assert max(taken - 2 * sx.CHANGE_BLOCKS, 0) <= left <= max(taken - blocks, 0)
        assert left == 0.0 or state.covariance[un.CONSTANT, 5, 5] == 1.0 + left
        assert state.covariance[un.CONSTANT, 0, 0] == sx.FIRST_STD**2 and not state.mean[un.CONSTANT, :4].any()
        assert (state.mean[un.NEW] == before[0][un.NEW]).all() and (state.past == before[2]).all()
        state.mean[...], state.covariance[...] = before[:2]


@pytest.mark.parametrize(("name", "seed"), [("constant", 300006), ("constant", 300100), ("vega_like", 300018)])
def test_a_loss_that_passed_for_wind_until_it_was_found_is_not_taken_back(name, seed):
    """The wind that was learned in the tenth of a second before the alarm stood after it: `MODEL` followed two seconds
    later."""
    nominal = load_nominal(name)
    duration, rng = nominal.simulation.duration, np.random.default_rng((734, seed))
    deviation, onset = 0.25 * rng.uniform(-1.0, 1.0, 2), rng.uniform(6.5, duration - 8.0)
    flight = fly_whole(nominal, seed, a6_factor=1.0 + deviation[0],
                       k1_factor=lambda t: (1.0 + deviation[1]) * np.where(t >= onset, 0.7, 1.0))
    _, estimator = run(Config(formulation="filtered", model=onboard_model(nominal)), flight.samples())
    assert [abs(change.t - onset) < 0.2 for change in estimator.changes() if change.parameter == "k1"] == [True]
    assert estimator.counts["CHANGE_WITHDRAWN"] == 0


@pytest.mark.parametrize("fraction", [0.15, 0.3, 0.7])
@pytest.mark.parametrize("name", NOMINALS)
def test_a_loss_of_control_is_one_and_stays_one(name, fraction):
    estimator = sudden(name, f"control_loss:fraction={fraction},time=33")
    assert any(change.parameter == "k1" and abs(change.t - 33.0) < 0.2 for change in estimator.changes())
    assert estimator.counts["CHANGE_WITHDRAWN"] == 0


def test_what_a_contradiction_follows_within_20_s_is_withdrawn():
    """Windows that it follows later, or that come after it, stay; a window without a number keeps its own reason."""
    windows, _, _ = flown("constant")
    given = [dataclasses.replace(w, status=EstimateStatus.MODEL, valid=False) if k == 8 else w
             for k, w in enumerate(windows)]
    given[6] = dataclasses.replace(given[6], status=EstimateStatus.GAP, valid=False)
    made = withdrawn(given)
    refused = [k for k, w in enumerate(made) if w.status is EstimateStatus.MODEL]
    assert given[8].t_end - given[4].t_end == pytest.approx(20.0) and refused == [4, 5, 7, 8]
    assert made[6].status is EstimateStatus.GAP
    for k in (4, 5, 6, 7):
        assert not made[k].valid and not made[k].tracked.valid and math.isnan(made[k].tracked.a6)
        assert made[k].offsets == {} and math.isnan(made[k].wind)
    assert math.isnan(made[5].a6) and math.isnan(made[5].k1_std) and made[5].t_end == given[5].t_end
    assert all(made[k] is given[k] for k in range(len(given)) if k not in (4, 5, 6, 7))


@pytest.mark.parametrize("effect", ["", "thrust_misalignment:angle=0.003", "steady_wind:angle=0.0087"])
@pytest.mark.parametrize("name", NOMINALS)
def test_identify_gives_no_number_that_a_contradiction_follows(name, effect):
    """A wind or misalignment that nobody declared is known on board after some windows, which then are believed."""
    windows, _, lies = flown(name, effect)
    told = [w.t_end for w in windows if w.status is EstimateStatus.MODEL]
    made = report(windows, run(config(load_nominal(name)), ())[1], tracked=True)
    assert [w["valid"] for w in made["windows"]] == [
        w.valid and not any(0.0 < t - w.t_end <= 20.0 for t in told) for w in windows]
    assert bool(effect) == bool(told)
    assert sum(lie and w["valid"] for lie, w in zip(lies, made["windows"], strict=True)) <= 1


def test_identify_says_what_a_contradicted_nominal_lacks():
    nominal = load_nominal("constant")
    declared = dataclasses.replace(nominal, wind=Wind(walk=0.005, turbulence=0.005))
    for believed, lacks in ((nominal, "no [wind] and no [offsets]"), (declared, "no [offsets]")):
        said = next_step([{"status": "MODEL"}, {"status": "OK"}], onboard_model(believed))
        assert said.startswith("1 of 2 windows contradict the model (MODEL)") and f"declares {lacks}:" in said
    full = dataclasses.replace(declared, offsets=Offsets(attitude_bias=0.005))
    assert "declares" not in next_step([{"status": "MODEL"}], onboard_model(full))
    assert next_step([{"status": "OK"}], onboard_model(nominal)) == ""


def test_noise_far_above_the_declared_is_none():
    """The gyro three and five times as noisy as declared, for 40 s; at five other checks contradict the model."""
    right = load_nominal("constant")
    for factor in (3.0, 5.0):
        noisy = dataclasses.replace(right, sensors=dataclasses.replace(
            right.sensors, theta_dot_std=factor * right.sensors.theta_dot_std))
        estimator = Estimator(config(right))
        for sample in list(fly_whole(noisy, SEED).samples())[:4000]:
            estimator.update(sample)
            assert estimator._parts.state.undeclared.found == 0


def test_drifting_a6_and_k1_are_none():
    """10 % with a period of 60 s, as the tracker follows them."""
    nominal = load_nominal("vega_like")
    flight = fly_whole(nominal, SEED, a6_factor=lambda t: 1.0 + 0.1 * np.sin(2.0 * np.pi * t / 60.0),
                       k1_factor=lambda t: 1.0 + 0.1 * np.cos(2.0 * np.pi * t / 60.0))
    estimator = Estimator(config(nominal))
    for sample in flight.samples():
        estimator.update(sample)
        assert estimator._parts.state.undeclared.found == 0


@pytest.mark.parametrize("library", ["rigid-body", "quadratic"])
@pytest.mark.parametrize("air", ["still", "wind"])
def test_the_kernels_seal_is_that_of_every_array_that_is_carried(air, library):
    """A word that a kernel leaves out of its seal may flip unseen: all but the gate's clock and counts, and the
    outcome."""
    nominal = load_nominal("constant")
    if air == "wind":
        nominal = dataclasses.replace(nominal, wind=Wind(walk=0.005, turbulence=0.005), offsets=Offsets(gyro_bias=1e-3))
    estimator = fed(Estimator(Config(formulation="filtered", library=library, model=ranged_model(nominal))),
                    list(fly_whole(nominal, SEED).samples())[:1500])
    state, memory = estimator._parts.state, estimator._memory
    gate = state._replace(clock=None, counts=None, guard=None, outcome=None)
    assert all(np.shares_memory(array, memory.words) for _, array in named_arrays(gate) if array.size)
    assert state.guard.carried == carried(memory)


def test_rounding_that_breaks_the_covariance_begins_it_anew():
    """No number of it can stay NaN, or contradict for ever."""
    nominal = load_nominal("constant")
    estimator, samples = Estimator(config(nominal)), list(fly_whole(nominal, SEED).samples())
    fed(estimator, samples[:500])
    state = estimator._parts.state
    state.undeclared.covariance[0, 4, 4] = math.nan
    reseal(estimator)
    fed(estimator, samples[500:520])
    assert np.isfinite(state.undeclared.covariance).all() and estimator.counts["RECOVERED"] == 0
