"""Every gate, clamp and restart of the filter: the test that fails without it, and what it did is counted."""

import dataclasses
import math

import numpy as np
import pytest
from cut import cut_of
from sealed import reseal
from unjitted import unjitted

from launchid.identification.windows import onboard_model
from launchid_core import Config, Estimator, Sample, Status
from launchid_core.filter import belief as bl
from launchid_core.filter import filtered as fl
from launchid_core.filter import predictor as pr
from launchid_core.filter import servo as sv
from launchid_core.filter import states as sx
from launchid_core.filter import structure as sr
from launchid_core.filter import whiteness as wh
from launchid_core.gate import ring as rb
from launchid_core.order.table import LARGEST
from launchid_core.watch import changes as ch
from launchid_core.watch import report as rp
from launchid_core.watch import tracker as tr
from sim.flight import fly_whole
from sim.nominal import load_nominal

begins_anew, delayed_input, is_outlier, start_segment, take_command, take_sample, update_levels, relax_levels = map(
    unjitted, (pr.begins_anew, pr.delayed_input, pr.is_outlier, pr.start_segment, pr.take_command, fl.take_sample,
               fl.update_levels, fl.relax_levels))

absorb_structure = unjitted(sr.absorb_structure)
MAX_GAP = 0.015
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
    state, before = cut.state, int(cut.state.acc.counts[fl.ROWS])
    row = np.array([t, theta, theta_dot, beta, math.nan, beta_cmd, math.nan])
    take_sample(cut.fixed.belief, cut.apart["profile"], cut.apart["air"], state.filter, cut.work.filter, state.acc,
                cut.apart["rows"], state.check, row, MAX_GAP)
    return int(state.acc.counts[fl.ROWS]) - before


@pytest.fixture(scope="module")
def samples() -> list[Sample]:
    """The first 6 s of a flight."""
    return list(fly_whole(load_nominal("constant"), 5).samples())[:600]


def flown(samples, of: Config | None = None) -> Estimator:
    estimator = Estimator(of or config())
    for sample in samples:
        estimator.update(sample)
    return estimator


def noted(estimator: Estimator) -> tuple[int, int]:
    return estimator.counts["OUTLIER"], estimator.counts["RESTART"]


# ---- a measurement is left out


@pytest.mark.parametrize("channel", range(3))
def test_a_measurement_is_an_outlier_beyond_eight_sigma_of_its_innovation(channel):
    fil = parts().state.filter
    fil.x[channel], fil.p[channel, channel] = 1.0, 0.75
    limit = 8.0 * math.sqrt(0.75 + 0.25)
    for e, outlier, row, total in ((limit, False, 0, 0), (1.001 * limit, True, 1, 1), (-1.001 * limit, True, 2, 2),
                                   (-limit, False, 0, 2), (1.001 * limit, True, 1, 3)):
        assert is_outlier(fil, channel, bl.NONE, 1.0 + e, 0.25) == outlier
        assert fil.outliers[channel] == row and fil.note[sx.OUTLIERS] == total
    assert fil.outliers.sum() == 1  # the other channels' are their own


def test_a_measurement_that_is_missing_saturated_or_an_outlier_is_no_row():
    cut = parts(theta_dot_saturation=0.1)
    assert take(cut, 0.0) == 3
    assert take(cut, 0.01, theta_dot=math.nan) == 2
    assert take(cut, 0.02, theta_dot=0.1) == 2 and take(cut, 0.03, theta_dot=-0.1) == 2
    assert cut.state.filter.note.tolist() == [0, 0, 0, 1, 0]  # an end stop is the sensor's own word; one segment began
    x = cut.state.filter.x.copy()
    assert take(cut, 0.04, theta=1.0) == 2
    assert cut.state.filter.note.tolist() == [1, 0, 0, 1, 0]
    assert abs(cut.state.filter.x[0] - x[0]) < 1e-3  # it moved nothing
    assert cut.state.acc.counts[fl.SAMPLES] == 5


@pytest.mark.parametrize("channel", CHANNELS)
@pytest.mark.parametrize("spikes", [1, 7])
def test_a_flight_with_so_many_spikes_counts_so_many_outliers(samples, channel, spikes):
    hit = list(samples)
    for k in range(spikes):
        at = 150 + 31 * k
        hit[at] = hit[at]._replace(**{channel: getattr(hit[at], channel) + 0.2})
    assert noted(flown(hit)) == (spikes, 0)
    assert noted(flown(samples)) == (0, 0)


# ---- the filter begins anew


def test_when_a_segment_begins():
    cut = parts()
    belief, fil = cut.fixed.belief, cut.state.filter
    for t in (0.0, 0.01):  # the first sample of all, whatever its t
        assert begins_anew(belief, fil, t, MAX_GAP)
    start_segment(belief, fil, 1.0, 0.0, 0.0, 0.0, math.nan)
    for dt, anew in ((0.01, False), (0.0149, False), (0.0151, True), (0.0, True), (-0.01, True), (math.nan, True)):
        assert begins_anew(belief, fil, 1.0 + dt, MAX_GAP) == anew


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


def test_a_segment_begins_with_its_sample_and_nothing_of_before():
    cut = parts()
    fil, belief = cut.state.filter, cut.fixed.belief
    for array in (fil.x, fil.p, fil.s, fil.sx, fil.sp, fil.command, fil.time):
        array[...] = 9.0
    fil.outliers[:], fil.level[:], fil.note[:] = 5, 0.1, 7
    variance = belief.variance[:3] * math.exp(0.2)
    start_segment(belief, fil, 3.0, 0.1, 0.2, 0.3, math.nan)
    assert fil.x.tolist() == [0.1, 0.2, 0.3, 0.0] and fil.time.tolist() == [3.0, 1.0, 9.0]
    assert fil.p == pytest.approx(np.diag([*variance, pr.START_NOZZLE_RATE_STD**2]))
    assert fil.s.tolist() == np.eye(4, fil.s.shape[1]).tolist() and not fil.sx.any()
    assert fil.sp == pytest.approx(np.array([np.diag(2.0 * p * row) for p, row in zip(
        [*variance, 0.0, 0.0], np.eye(5, 4), strict=True)]))
    assert np.isnan(fil.command).all() and not fil.outliers.any()
    assert fil.level.tolist() == [0.1] * 5 and fil.note.tolist() == [7, 7, 7, 8, 7]  # what it has learned stays
    start_segment(belief, fil, 3.0, 0.1, math.nan, 0.3, math.nan)
    assert fil.x[1] == 0.0 and fil.p[1, 1] == pr.UNKNOWN_RATE_STD**2 and not fil.sp[1].any()


def test_a_gap_is_counted_and_leaves_the_window_its_terms_but_not_its_offset():
    cut = parts()
    acc, note = cut.state.acc, cut.state.filter.note
    take(cut, 0.0)
    take(cut, 0.01)
    assert acc.counts[fl.GAPS] == 0 and note[sx.RESTARTS] == 0  # the first sample of all follows no gap
    acc.window[...], acc.psi[...] = 3.0, 4.0
    take(cut, 0.01 + MAX_GAP + 1e-6)
    assert acc.counts[fl.GAPS] == 1 and note[sx.RESTARTS] == 1
    assert not acc.window[:4].any() and (acc.window[4:] == 3.0).all() and acc.psi.tolist() == np.eye(4).tolist()


def test_a_gap_in_flight_is_one_restart(samples):
    assert noted(flown(samples[:250] + samples[280:])) == (0, 1)
    assert flown(samples[:250] + samples[280:300]).estimate().gaps == 1
    assert flown(samples[:250] + samples[280:400]).estimate().gaps == 0  # the next window has none
    assert noted(flown(samples[:250] + samples[280:400] + samples[402:])) == (0, 2)


@pytest.mark.parametrize("channel", CHANNELS)
@pytest.mark.parametrize(("row", "restarts"), [(4, 0), (5, 1)])
def test_five_outliers_in_a_row_restart_the_filter(samples, channel, row, restarts):
    hit = list(samples)
    for at in range(250, 250 + row):
        hit[at] = hit[at]._replace(**{channel: getattr(hit[at], channel) + 0.2})
    assert noted(flown(hit)) == (row, restarts)


def test_a_clock_set_back_gives_up_the_window_and_is_no_restart_of_the_filters_own(samples):
    """The fifth stamp of the earlier clock is believed: a window of that clock begins, with nothing of before."""
    back = [sample._replace(t=sample.t - 2.0) for sample in samples[350:460]]
    estimator = Estimator(config())
    answers = [estimator.update(sample) for sample in samples[:350] + back]
    assert answers.count(Status.CLOCK_RESET) == 1 and noted(estimator) == (0, 0)
    estimate = estimator.estimate()
    assert estimate.t_start == pytest.approx(1.54) and estimate.rows == 100 and estimate.gaps == 0


def test_a_window_that_closes_and_a_clock_set_back_end_the_block(samples):
    """95 samples a window, so that its last block is not full; the clock is set back after 3 of a block."""
    estimator = flown(samples[:95], config(window=0.95))
    counts = estimator._parts.state.acc.counts
    assert estimator.counts["WINDOW_COMPLETE"] == 1 and counts[fl.ROWS] == 0
    for sample in [*samples[95:148], *(sample._replace(t=sample.t - 1.0) for sample in samples[148:153])]:
        estimator.update(sample)
    assert estimator.counts["CLOCK_RESET"] == 1 and counts[fl.ROWS] == 0


def test_a_block_ends_where_a_segment_does(samples):
    """Ten samples, three and then a gap: blocks of ten, of three, and one that begins after the gap."""
    estimator = flown(samples[:13] + samples[20:30])
    watch = estimator._parts.state.watch
    assert watch.counts[ch.KEPT] == 2  # closed blocks; the third waits
    for sample in samples[30:43]:
        estimator.update(sample)
    assert watch.start[:3] == pytest.approx([0.0, 0.1, 0.2])


def test_a_new_flight_begins_with_nothing_noted(samples):
    hit = [*samples[:100], samples[100]._replace(theta=1.0), *samples[110:200]]
    estimator = flown(hit)
    assert noted(estimator) == (1, 1)
    estimator.reset()
    assert noted(estimator) == (0, 0) and estimator.counts["LEVEL_CLAMP"] == 0


def test_an_irregular_step_has_its_own_constants():
    cut = parts()
    step = cut.state.filter.step
    take(cut, 0.0)
    for t, h in ((0.01, 0.01), (0.02, 0.01), (0.032, 0.012), (0.042, 0.01)):
        take(cut, t)
        assert step[sv.STEP] == pytest.approx(h, rel=1e-6)
        assert step[sv.GAMMA] == pytest.approx(0.5 * (50.0 * h) ** 2, rel=0.3)  # of a nozzle at w = 50 rad/s, early on


# ---- the command


def test_the_command_acts_after_its_delay_linear_between_samples():
    cut = parts(model=dataclasses.replace(onboard_model(load_nominal("constant")), delay=0.025))
    constant, fil = cut.fixed.belief.constant, cut.state.filter
    for command in (9.0, 8.0, 1.0, 2.0, 4.0):
        take_command(constant, 0, fil, command)
    assert fil.command[:4].tolist() == [4.0, 2.0, 1.0, 8.0]
    assert delayed_input(constant, fil) == pytest.approx(0.5 * 1.0 + 0.5 * 8.0)


def test_without_a_delay_a_command_acts_at_once():
    cut = parts(model=dataclasses.replace(onboard_model(load_nominal("constant")), delay=0.0))
    fil = cut.state.filter
    fil.command[1] = math.nan
    take_command(cut.fixed.belief.constant, 0, fil, 3.0)
    assert delayed_input(cut.fixed.belief.constant, fil) == 3.0


def test_an_unknown_command_is_the_nozzles_place_and_some_doubt():
    """theta, beta quiet at 0.01 rad: after a step the nozzle is still there, its variance that of a command unknown."""
    known, unknown = parts(), parts()
    for cut, command in ((known, 0.01), (unknown, math.nan)):
        take(cut, 0.0, beta=0.01, beta_cmd=command)
        take(cut, 0.01, theta=math.nan, theta_dot=math.nan, beta=math.nan)
    assert unknown.state.filter.x == pytest.approx(known.state.filter.x)
    doubt = pr.UNKNOWN_COMMAND_STD**2 - known.fixed.belief.variance[3]
    gamma = known.state.filter.step[sv.GAMMA]
    assert unknown.state.filter.p[2, 2] - known.state.filter.p[2, 2] == pytest.approx(gamma**2 * doubt)


# ---- noise levels


def test_a_noise_levels_step_is_cut_at_its_limit_and_counted():
    """Five steps wanted, three beyond 0.05 on either side."""
    cut = parts()
    fil, acc = cut.state.filter, cut.state.acc
    wanted = np.array([0.2, -0.3, 0.01, -0.02, 0.0501])
    acc.information[...] = np.diag([1e3, 2e3, 3e3, 4e3, 5e3]) + 100.0
    acc.score[:] = (acc.information + fl.LEVEL_PRIOR * np.eye(5)) @ wanted
    update_levels(cut.fixed.belief, fil, acc, cut.work.acc)
    assert fil.level == pytest.approx([0.05, -0.05, 0.01, -0.02, 0.05], rel=1e-9)
    assert fil.note.tolist() == [0, 0, 3, 0, 0]
    assert not acc.score.any() and not acc.information.any()
    acc.score[:] = 1.0
    update_levels(cut.fixed.belief, fil, acc, cut.work.acc)
    assert fil.note.tolist() == [0, 0, 3, 0, 0]  # small steps are not


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
    assert estimator._parts.state.check.number[wh.WEIGHT] == pytest.approx(weight, rel=1e-3)


@pytest.mark.parametrize("dt", [0.02, 0.1, 0.5])
def test_of_what_is_known_of_the_terms_nine_tenths_are_left_after_a_second(dt):
    """The nine tenths are of the information, the triangle's square; whatever a block lasts."""
    learner, size, work = np.triu(np.ones((4, 4))), LARGEST._replace(terms=3, states=2, columns=6), parts().work.acc
    for _ in range(round(1.0 / dt)):
        absorb_structure(size, learner, work, dt)
    assert learner.T @ learner == pytest.approx(0.9 * np.triu(np.ones((4, 4))).T @ np.triu(np.ones((4, 4))), rel=0.002)


def test_a_block_is_no_longer_than_its_window():
    assert parts(window=0.05).apart["rows"].shape[1] == 3 * 5
    assert parts(window=5e-5, sample_period=1e-6).apart["rows"].shape[1] == 3 * 50


def test_what_is_known_of_the_noise_levels_fades_towards_the_prior():
    cut = parts()
    fil, acc = cut.state.filter, cut.state.acc
    acc.level_information[...] = np.diag([10.0, 20.0, 30.0, 40.0, 50.0]) + 1.0
    prior = fl.LEVEL_PRIOR * np.eye(5)
    expected = prior + fl.LEVEL_MEMORY * (acc.level_information - prior) + 2.0 * np.eye(5)
    acc.information[...] = 2.0 * np.eye(5)
    update_levels(cut.fixed.belief, fil, acc, cut.work.acc)
    assert acc.level_information == pytest.approx(expected)


def test_noise_levels_that_nothing_is_known_of_stay():
    cut = parts()
    fil, acc = cut.state.filter, cut.state.acc
    fil.level[:] = 0.3
    acc.level_information[...] = fl.LEVEL_PRIOR * np.eye(5)
    acc.information[...] = -fl.LEVEL_PRIOR * np.eye(5)
    acc.score[:] = 1.0
    update_levels(cut.fixed.belief, fil, acc, cut.work.acc)
    assert fil.level.tolist() == [0.3] * 5 and fil.note.tolist() == [0, 0, 0, 0, 0]


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


def test_the_filter_is_linearised_about_the_member_that_drifts(samples):
    """A drift does then not pass for noise."""
    estimator = flown(samples[:400])
    state = estimator._parts.state
    assert state.counts[rb.WAITING] == 0  # a block has just closed
    assert state.filter.p_bar.tolist() == state.bank.mean[tr.MEMBERS[:, tr.WALK].argmax(), :2].tolist()
    assert abs(state.bank.mean[0, :2] - state.bank.mean[1, :2]).max() > 1e-4  # or there was nothing to tell


def test_a_block_that_raises_the_alarm_is_neither_noise_nor_structure_nor_the_windows(samples):
    estimator = flown(samples[:305], config(library="quadratic"))
    state, learner = estimator._parts.state, estimator._parts.state.learner
    level, structure = state.filter.level.copy(), learner.r.copy()
    newest = (state.watch.counts[ch.NEXT] - 1) % ch.ONSETS
    state.watch.factor[newest] = 1e3
    reseal(estimator)
    for sample in samples[305:310]:
        estimator.update(sample)
    assert state.watch.counts[ch.EVENTS] == 1
    assert state.filter.level.tolist() == level.tolist() and learner.r.tolist() == structure.tolist()
    assert not state.acc.score.any() and not state.acc.information.any()
    terms = np.zeros_like(state.acc.window)
    known = range(4, len(terms) - 1 - sx.N_TESTS)
    terms[known, known] = fl.WEAK_PRIOR
    assert state.acc.window.tolist() == terms.tolist() and state.acc.counts[fl.SAMPLES] == 0


def test_a_block_without_a_row_changes_nothing(samples):
    """Every sensor at its end stop."""
    estimator = flown(samples[:100], config(theta_saturation=1.0, theta_dot_saturation=1.0, beta_saturation=1.0))
    state = estimator._parts.state
    before = state.bank.total.copy()
    for sample in samples[100:205]:  # a window closes, too
        estimator.update(sample._replace(theta=1.0, theta_dot=1.0, beta=1.0))
    assert state.bank.total.tolist() == before.tolist() and state.watch.counts[ch.KEPT] == 10


# ---- a window, and what is reported


def test_a_window_of_too_few_samples_is_short_or_has_a_gap(samples):
    """Every third sample is 34 of 100, fewer than half: SHORT where that is no gap, GAP where it is."""
    for max_gap, status in ((0.05, "SHORT"), (0.015, "GAP")):
        estimate = flown(samples[:300:3], config(max_gap=max_gap)).estimate()
        assert not estimate.valid and estimate.status.name == status and math.isnan(estimate.a6)


@pytest.mark.parametrize(("share", "known"), [(0.99, 1), (1.01, 0), (math.nan, 0)])
@pytest.mark.parametrize("place", [tr.VAR_A6, tr.VAR_K1])
def test_the_tracked_estimate_is_valid_once_something_is_known(share, known, place):
    estimator = Estimator(config())
    total = estimator._parts.state.bank.total
    total[:] = 0.0, 0.0, bl.FIRST_STD**2, 0.0, bl.FIRST_STD**2
    total[place] = (share * rp.KNOWN * bl.FIRST_STD) ** 2
    assert estimator._report().flag[rp.IS_TRACKED] == known
    total[tr.MEAN_K1] = math.nan
    assert estimator._report().flag[rp.IS_TRACKED] == 0
