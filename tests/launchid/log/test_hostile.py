"""The front door as a hostile user finds it: what was seen once, and has no test elsewhere."""

import dataclasses
import math
import warnings

import pytest

import launchid
from launchid.diagnosis.data.used import ROWS_FITTED
from sim.nominal import Nominal, load_nominal


@pytest.fixture(scope="module")
def nominal() -> Nominal:
    """The constant nominal, of 20 s."""
    found = load_nominal("constant")
    assert found.simulation is not None
    return dataclasses.replace(found, simulation=dataclasses.replace(found.simulation, duration=20.0))


# ---- a log of the simulator itself, and one of a million rows


@pytest.mark.campaign
def test_the_truth_is_recognised_and_nothing_is_explained_by_it(nominal):
    quiet = dataclasses.replace(nominal, sensors=dataclasses.replace(
        nominal.sensors, theta_std=0.0, theta_dot_std=0.0, beta_std=0.0))
    log = launchid.simulate(quiet, seed=3).log.measured()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        own, other = launchid.diagnose(log, quiet), launchid.diagnose(log, nominal)
    assert own.verdict == "consistent", own.summary()
    assert other.report["causes"] == [] and other.extension is None, other.summary()
    with pytest.warns(launchid.DataWarning, match="ideal suite"):
        launchid.diagnose(launchid.simulate(nominal, seed=3, suite="ideal").log.measured(), nominal)


@pytest.mark.campaign
def test_a_million_rows_are_diagnosed_and_it_is_said_which(nominal):
    assert nominal.simulation is not None
    period, once = 0.001, 1_000_000
    long = dataclasses.replace(nominal, simulation=dataclasses.replace(nominal.simulation, duration=once * period))
    log = launchid.simulate(long, seed=3, period=period).log
    assert len(log.t) == once
    made = launchid.diagnose(log, long)
    used = made.diagnosis.used
    assert used is not None and used.rows <= ROWS_FITTED
    assert math.isclose(used.end - used.begin, used.rows * used.every * period, rel_tol=0.01)
    assert f"  {used.words}" in made.summary().splitlines()
    assert made.verdict == "consistent", made.summary()
