"""Gates, clamps and restarts of the filter, and that what they did is counted."""

import dataclasses
import math

import pytest
from cut import cut_of
from unjitted import unjitted

from launchid.identification.windows import onboard_model
from launchid_core import Config, Estimator, Sample
from launchid_core.filter import belief as bl
from launchid_core.filter import predictor as pr
from launchid_core.filter import states as sx
from launchid_core.watch import report as rp
from launchid_core.watch import tracker as tr
from sim.flight import fly_whole
from sim.nominal import load_nominal

begins_anew, is_outlier, start_segment = map(unjitted, (pr.begins_anew, pr.is_outlier, pr.start_segment))


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


@pytest.fixture(scope="module")
def samples() -> list[Sample]:
    """The first 6 s of a flight."""
    return list(fly_whole(load_nominal("constant"), 5).samples())[:600]


def flown(samples, of: Config | None = None) -> Estimator:
    estimator = Estimator(of or config())
    for sample in samples:
        estimator.update(sample)
    return estimator


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


# ---- noise levels


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


# ---- a window, and what is reported


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
