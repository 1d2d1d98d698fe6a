"""Gates, clamps and restarts of the filter, and that what they did is counted."""

import dataclasses
import math

import numpy as np
import pytest
from cut import cut_of, fed, reseal
from cut import take as take_row
from unjitted import unjitted

from launchid_core import Config, Estimator, Sample
from launchid_core.filter import filtered as fl
from launchid_core.filter import kalman as km
from launchid_core.filter import states as sx
from launchid_core.filter import structure as sr
from launchid_core.watch import report as rp
from sim.flight import fly_whole
from sim.nominal import load_nominal
from sim.onboard import onboard_model

begins_anew, delayed_input, start_segment, take_command, update_levels, relax_levels = map(unjitted, (
    km.begins_anew, km.delayed_input, km.start_segment, km.take_command, fl.update_levels, fl.relax_levels))

learn_structure = unjitted(sr.learn_structure)
CHANNELS = ("theta", "theta_dot", "beta")


def config(nominal=None, **choices) -> Config:
    model = onboard_model(nominal or load_nominal("constant"))
    return Config(**{"window": 1.0, "formulation": "filtered", "model": model, **choices})


def parts(nominal=None, **choices):
    """Memory of a nominal's estimator (the constant one's), ready for the first sample."""
    return cut_of(config(nominal, **choices))


def parts_at(rate: float):
    """The same, controller and sensors at a rate [Hz]."""
    nominal = load_nominal("constant")
    controller = dataclasses.replace(nominal.controller, period=1.0 / rate)
    return parts(dataclasses.replace(nominal, controller=controller), sample_period=1.0 / rate)


def take(cut, t: float, theta=0.0, theta_dot=0.0, beta=0.0, beta_cmd=0.0) -> int:
    """Give the filter one sample; returns how many rows it became."""
    state, before = cut.state, int(cut.state.acc.counts.rows)
    take_row(cut, np.array([t, theta, theta_dot, beta, math.nan, beta_cmd, math.nan]))
    return int(state.acc.counts.rows) - before


@pytest.fixture(scope="module")
def samples() -> list[Sample]:
    """The first 6 s of a flight."""
    return list(fly_whole(load_nominal("constant"), 5).samples())[:600]


def flown(samples, of: Config | None = None) -> Estimator:
    return fed(Estimator(of or config()), samples)


def noted(estimator: Estimator) -> tuple[int, int]:
    return estimator.counts["OUTLIER"], estimator.counts["RESTART"]


# ---- a measurement is left out


@pytest.mark.parametrize("channel", range(3))
def test_a_measurement_is_an_outlier_beyond_eight_sigma_of_its_innovation(channel):
    nothing = dict.fromkeys(CHANNELS, math.nan)
    predicted = parts()
    take(predicted, 0.0)
    take(predicted, 0.01, **nothing)
    fil = predicted.state.filter
    limit = 8.0 * math.sqrt(fil.p[channel, channel] + predicted.fixed.belief.variance[channel])
    for share, outlier in ((0.999, 0), (-0.999, 0), (1.001, 1), (-1.001, 1)):
        cut = parts()
        take(cut, 0.0)
        z = fil.x[channel] + share * limit
        assert take(cut, 0.01, **nothing | {CHANNELS[channel]: z}) == 1 - outlier
        assert cut.state.filter.outliers.tolist() == [outlier * (k == channel) for k in range(3)]
        assert cut.state.filter.note.outliers == outlier


# ---- the filter begins anew


@pytest.mark.parametrize("channel", range(3))
@pytest.mark.parametrize(("rate", "row"), [(25, 5), (50, 5), (100, 5), (200, 10), (400, 20), (1000, 50)])
def test_so_many_outliers_in_a_row_are_0_05_s_at_every_rate_and_five_at_least(channel, rate, row):
    cut = parts_at(rate)
    belief, fil = cut.fixed.belief, cut.state.filter
    start_segment(belief, fil, 1.0, 0.0, 0.0, 0.0, math.nan)
    fil.outliers[channel] = row - 1
    assert not begins_anew(belief, fil, 1.0 + 1.0 / rate, 1.0)
    fil.outliers[channel] = row
    assert begins_anew(belief, fil, 1.0 + 1.0 / rate, 1.0)


def test_a_gap_in_flight_is_one_restart(samples):
    assert noted(flown(samples[:250] + samples[280:])) == (0, 1)
    assert flown(samples[:250] + samples[280:300]).estimate().gaps == 1
    assert flown(samples[:250] + samples[280:400]).estimate().gaps == 0  # the next window has none
    assert noted(flown(samples[:250] + samples[280:400] + samples[402:])) == (0, 2)


# ---- the command


def test_the_command_acts_after_its_delay_linear_between_samples():
    cut = parts(model=dataclasses.replace(onboard_model(load_nominal("constant")), delay=0.025))
    constant, fil = cut.fixed.belief.constant, cut.state.filter
    for command in (9.0, 8.0, 1.0, 2.0, 4.0):
        take_command(cut.fixed.belief, None, fil, command)
    assert fil.command[:4].tolist() == [4.0, 2.0, 1.0, 8.0]
    assert delayed_input(constant, fil) == pytest.approx(0.5 * 1.0 + 0.5 * 8.0)


def test_an_unknown_command_is_the_nozzles_place_and_some_doubt():
    """theta, beta quiet at 0.01 rad: after a step the nozzle is still there, its variance that of a command unknown."""
    known, unknown = parts(), parts()
    for cut, command in ((known, 0.01), (unknown, math.nan)):
        take(cut, 0.0, beta=0.01, beta_cmd=command)
        take(cut, 0.01, theta=math.nan, theta_dot=math.nan, beta=math.nan)
    assert unknown.state.filter.x == pytest.approx(known.state.filter.x)
    doubt = km.UNKNOWN_COMMAND_STD**2 - known.fixed.belief.variance[3]
    gamma = known.state.filter.step.by_command[0]
    assert unknown.state.filter.p[2, 2] - known.state.filter.p[2, 2] == pytest.approx(gamma**2 * doubt)


# ---- noise levels


@pytest.mark.parametrize(("rate", "samples", "share"), [
    (10, 1, 1.0), (25, 3, 1.2), (50, 5, 1.0), (100, 10, 1.0), (125, 13, 1.04), (400, 40, 1.0), (1000, 100, 1.0),
    (5, 1, 2.0)])
def test_a_block_and_what_a_noise_level_does_in_it_are_of_seconds(rate, samples, share):
    """0.1 s in whole samples; most that a level moves, and what is forgotten, in proportion to what came of it."""
    cut = parts_at(rate)
    fil, acc = cut.state.filter, cut.state.acc
    assert cut.apart["rows"].shape[1] == 3 * samples
    acc.level_information[...] = 1e3 * np.eye(5)
    acc.score[:] = 1e6
    update_levels(cut.fixed.belief, fil, acc, cut.work.acc)
    assert fil.level == pytest.approx(np.full(5, 0.05 * share))
    prior = fl.LEVEL_PRIOR
    assert np.diag(acc.level_information) == pytest.approx(prior + 0.9995**share * (1e3 - prior), rel=1e-12)
    relax_levels(cut.fixed.belief, fil, acc)
    assert fil.level == pytest.approx(np.full(5, 0.05 * share * 0.97**share))


@pytest.mark.parametrize("rate", [10, 100, 400])
def test_a_block_lasts_until_the_next_one_so_that_what_fades_does_so_in_seconds(rate):
    """The weight that the check of the model has gathered after a minute is that of its memory of 10 s.  At 10 Hz a
    block is one sample: without the step after it nothing would ever fade."""
    nominal = load_nominal("constant")
    controller = dataclasses.replace(nominal.controller, period=1.0 / rate)
    estimator = Estimator(config(dataclasses.replace(nominal, controller=controller), sample_period=1.0 / rate))
    noise = 1e-4 * np.random.default_rng(1).standard_normal((60 * rate, 3))
    for k, row in enumerate(noise.tolist()):
        estimator.update(Sample(k / rate, *row, beta_cmd=0.0))
    weight = 1.0 / (1.0 - math.exp(-2.0 * 0.1 / 10.0))
    assert estimator._parts.state.check.sum_weight == pytest.approx(weight, rel=1e-3)


@pytest.mark.parametrize("dt", [0.02, 0.1, 0.5])
def test_of_what_is_known_of_the_terms_nine_tenths_are_left_after_a_second(dt):
    """The nine tenths are of the information, the triangle's square; whatever a block lasts."""
    cut = parts(library="theta,beta,theta_dot")
    learned, ones = cut.state.learned, np.triu(np.ones((4, 4)))
    learned[...] = ones
    cut.state.filter.time.last = dt - cut.fixed.limits.period
    for _ in range(round(1.0 / dt)):
        learn_structure((cut.memory.parts,))
    assert learned.T @ learned == pytest.approx(0.9 * ones.T @ ones, rel=0.002)


def test_a_noise_declared_five_times_too_small_is_followed_in_cut_steps(samples):
    """log 5 in steps of 0.05 is 32 blocks at least; a noise declared right is cut in few of the 60 blocks."""
    right = load_nominal("constant")
    quiet = dataclasses.replace(right, sensors=dataclasses.replace(
        right.sensors, theta_dot_std=0.2 * right.sensors.theta_dot_std))
    wrong, clean = flown(samples, config(quiet)), flown(samples)
    assert wrong.counts["LEVEL_CLAMP"] >= 32 + clean.counts["LEVEL_CLAMP"]
    assert clean.counts["LEVEL_CLAMP"] <= 20
    assert wrong.noise_levels["theta_dot_std"] == pytest.approx(5.0, rel=0.2)
    declared = flown(samples, config(quiet, noise="declared"))
    assert declared.counts["LEVEL_CLAMP"] == 0 and set(declared.noise_levels.values()) == {1.0}


# ---- a block


def test_a_block_that_raises_the_alarm_is_neither_noise_nor_structure_nor_the_windows(samples):
    estimator = flown(samples[:305], config(library="quadratic"))
    state, learned = estimator._parts.state, estimator._parts.state.learned
    level, structure = state.filter.level.copy(), learned.copy()
    newest = (state.watch.counts.next - 1) % sx.CHANGE_BLOCKS
    state.watch.factor[newest] = 1e3
    reseal(estimator)
    fed(estimator, samples[305:310])
    assert state.watch.counts.events == 1
    assert state.filter.level.tolist() == level.tolist() and learned.tolist() == structure.tolist()
    assert not state.acc.score.any() and not state.acc.information.any()
    terms = np.zeros_like(state.acc.window)
    known = range(4, len(terms) - 1 - sx.N_TESTS)
    terms[known, known] = fl.WEAK_PRIOR
    assert state.acc.window.tolist() == terms.tolist() and state.acc.counts.samples == 0


# ---- a window, and what is reported


def test_a_window_of_too_few_samples_is_short_or_has_a_gap(samples):
    """Every third sample is 34 of 100, fewer than half: SHORT where that is no gap, GAP where it is."""
    for max_gap, status in ((0.05, "SHORT"), (0.015, "GAP")):
        estimate = flown(samples[:300:3], config(max_gap=max_gap)).estimate()
        assert not estimate.valid and estimate.status.name == status and math.isnan(estimate.a6)


@pytest.mark.parametrize(("share", "known"), [(0.99, 1), (1.01, 0), (math.nan, 0)])
@pytest.mark.parametrize("name", ["var_a6", "var_k1"])
def test_the_tracked_estimate_is_valid_once_something_is_known(share, known, name):
    estimator = Estimator(config())
    total = estimator._parts.state.bank.total
    assert (total.mean_a6, total.var_a6, total.cov, total.var_k1) == (0.0, sx.FIRST_STD**2, 0.0, sx.FIRST_STD**2)
    setattr(total, name, (share * rp.KNOWN_SHARE * sx.FIRST_STD) ** 2)
    assert estimator._report().is_tracked == known
    total.mean_k1 = math.nan
    assert estimator._report().is_tracked == 0
