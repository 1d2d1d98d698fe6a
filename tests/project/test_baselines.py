"""The baselines of the comparison recover a6 and k1 on all but noise-free data: none loses by its implementation.

Each tolerance is the method's own limitation (order of its differences, a band, a prior), not noise.
"""

import dataclasses
import functools
import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

import comparison

from sim.flight import Flight, fly_whole
from sim.nominal import Nominal, built_in, load_nominal
from sim.onboard import onboard_model
from sim.plant import parameters

QUIET = 1.0e-9
SECONDS = 50.0   # of a flight
A6_FACTOR, K1_FACTOR = 1.2, 0.85
TOLERANCE = {  # largest relative error over the windows that move, `constant`, 10 s
    "difference, ten terms": 0.02, "difference, two terms": 0.005, "pysindy weak, tuned": 1e-3, "integral": 0.002,
    "extended Kalman, profile": 0.01, "launchid filtered": 0.04, "launchid tracked": 0.01}
PROFILED = {"extended Kalman, profile": 0.005, "launchid filtered": 0.005, "launchid tracked": 0.001}


def quiet(nominal: Nominal, command_noise: bool) -> Nominal:
    """The nominal with perfect sensors and no unmodelled acceleration, for SECONDS; command noise may stay, as
    excitation."""
    std = nominal.actuator.command_noise_std if command_noise else QUIET
    return dataclasses.replace(
        nominal, actuator=dataclasses.replace(nominal.actuator, command_noise_std=std),
        sensors=dataclasses.replace(nominal.sensors, theta_std=QUIET, theta_dot_std=QUIET, beta_std=QUIET),
        simulation=dataclasses.replace(nominal.simulation, acceleration_noise_std=QUIET, duration=SECONDS))


def method(name: str) -> comparison.Method:
    """A method by name; skips visibly without pysindy."""
    found = next(m for m in comparison.METHODS if m.name == name)
    if found.pysindy and importlib.util.find_spec("pysindy") is None:
        pytest.skip("pysindy is not installed (extra `peers`)")
    return found


@functools.cache
def flown(nominal_name: str, command_noise: bool) -> Flight:
    return fly_whole(quiet(load_nominal(built_in(nominal_name)), command_noise), 3, a6_factor=A6_FACTOR,
                     k1_factor=K1_FACTOR)


def errors(name: str, nominal_name: str, window: float, command_noise: bool = True) -> np.ndarray:
    """Relative errors (windows, 2) of a dispersed, quiet flight; filters believe the nominal's own noises."""
    believed = load_nominal(built_in(nominal_name))
    vehicle = {"a6_factor": A6_FACTOR, "k1_factor": K1_FACTOR}
    flight = flown(nominal_name, command_noise)
    log = comparison.Log(flight.t, flight.theta, flight.theta_dot, flight.beta, flight.beta_cmd)
    chosen = method(name)
    estimate = chosen.run(log, window, onboard_model(believed))
    at = (np.arange(len(estimate)) + (1.0 if chosen.at_end else 0.5)) * window
    truth = np.column_stack(parameters(believed, at, **vehicle))
    return estimate / truth - 1.0


def test_every_method_is_tested():
    assert {m.name for m in comparison.METHODS} == set(TOLERANCE)


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=pytest.mark.campaign) if name in PROFILED or "pysindy" in name else name
    for name in TOLERANCE])
def test_recovers_constant_parameters(name):
    found = errors(name, "constant", 10.0)
    assert found.shape == (5, 2)
    known = np.isfinite(found).all(axis=1)
    assert known.all() or (name == "difference, ten terms" and known.sum() >= 3)  # it refuses what it cannot tell apart
    assert np.abs(found[known]).max() < TOLERANCE[name]


@pytest.mark.parametrize("name", PROFILED)
def test_follows_a_known_profile(name):
    """The flight is judged from 30 s on (before, a6 is next to nothing), without the command noise that these filters
    expect but here could not tell from the parameters' effect."""
    found = np.abs(errors(name, "vega_like", 5.0, command_noise=False)[6:])
    finite = np.isfinite(found)
    assert finite.mean() > 0.25  # launchid's filtered form refuses windows that say next to nothing, or only the trim
    assert found[finite].max() < PROFILED[name]
