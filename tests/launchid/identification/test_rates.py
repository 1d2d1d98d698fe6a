"""The check of the model keeps its promise at every rate: a clean flight is not contradicted.

The flights are of `benchmarks/rates.py`; those by seed were contradicted while a block was ten samples.  `campaign`: of
the windows of a hundred, 1 %.
"""

import dataclasses

import pytest

from launchid.identification.windows import onboard_model, run
from launchid.robustness.reconfigure import Supervisor
from launchid_core import Config, EstimateStatus
from sim.flight import fly_whole
from sim.nominal import Nominal, load_nominal

NAMES = ("constant", "vega_like", "greensite_cr826")
RATES = (25, 50, 100, 200, 400)
WINDOW = 5.0


def at_rate(name: str, rate: int) -> Nominal:
    """A nominal with controller and sensors at a rate [Hz]."""
    nominal = load_nominal(name)
    period, simulation = 1.0 / rate, dataclasses.replace(nominal.simulation, step=0.0005)
    return dataclasses.replace(nominal, controller=dataclasses.replace(nominal.controller, period=period),
                               sensors=dataclasses.replace(nominal.sensors, period=period),
                               simulation=nominal.simulation if rate < 400 else simulation)


def statuses(nominal: Nominal, seed: int) -> list[EstimateStatus]:
    """The statuses of the windows of a clean flight."""
    flight = fly_whole(nominal, seed)
    config = Config(window=WINDOW, sample_period=flight.period, formulation="filtered", model=onboard_model(nominal))
    return [estimate.status for estimate in run(config, flight.samples())[0]]


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("name", NAMES)
def test_a_clean_flight_is_not_contradicted_at_any_rate(name, rate):
    assert EstimateStatus.MODEL not in statuses(at_rate(name, rate), 7002)


@pytest.mark.parametrize(("name", "rate", "seed"), [
    ("constant", 25, 7030), ("constant", 25, 7037), ("vega_like", 25, 7030), ("vega_like", 25, 7036),
    ("greensite_cr826", 25, 7014)])
def test_what_was_contradicted_while_blocks_were_of_ten_samples(name, rate, seed):
    assert EstimateStatus.MODEL not in statuses(at_rate(name, rate), seed)


@pytest.mark.campaign
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("name", NAMES)
def test_at_most_one_percent_of_clean_windows_are_contradicted(name, rate):
    nominal = at_rate(name, rate)
    every = [status for seed in range(7000, 7100) for status in statuses(nominal, seed)]
    assert every.count(EstimateStatus.MODEL) <= 0.01 * len(every)


@pytest.mark.parametrize(("rate", "window"), [(10, 0.5), (25, 0.2), (50, 0.2), (100, 0.2), (400, 0.2)])
def test_the_supervisor_reads_the_tracked_estimate_in_seconds(rate, window):
    """The window is also five samples at least."""
    assert Supervisor(at_rate("constant", rate), 1.0 / rate).estimator.config.window == pytest.approx(window)
