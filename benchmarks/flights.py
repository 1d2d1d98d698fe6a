"""Flights for the benchmarks: dispersed vehicles, noise declared right or wrong, on all cores."""

import dataclasses
import math
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np

from sim.flight import is_whole
from sim.nominal import Multisine, Nominal, Offsets, Wind, built_in, load_nominal

NOMINALS = ("constant", "vega_like", "greensite_cr826")
FACTORS = 5  # theta, theta_dot, beta, command, acceleration
AIRS = ("calm", "offsets", "wind", "excited")  # calm; unknown offsets; wind too; a multisine on the command too
OFFSETS = Offsets(thrust_misalignment=0.004, attitude_bias=0.005)
WIND = Wind(walk=0.005, turbulence=0.005)
TONES = (1.5, 3.1, 5.0, 7.2, 9.9, 13.0)  # rad/s, no two in a ratio of whole numbers, about the loop's bandwidth
TEST_RMS = math.radians(0.5)             # of the multisine, rad
WRONG_LEVEL = 2.0                        # a level is declared within this factor of the true one
FINEST = 0.0005                          # s: a step of the simulation for periods that its own does not divide


def nominal(name: str, command_noise: float | None = None) -> Nominal:
    """A built-in nominal, with another command noise [rad] if asked."""
    loaded = load_nominal(built_in(name))
    if command_noise is None:
        return loaded
    assert loaded.actuator is not None
    return dataclasses.replace(loaded, actuator=dataclasses.replace(loaded.actuator, command_noise_std=command_noise))


def at_rate(believed: Nominal, rate: float) -> Nominal:
    """The nominal with controller and sensors at another rate [Hz]; the noise of a draw stays."""
    assert believed.controller is not None and believed.simulation is not None
    step = believed.simulation.step
    return dataclasses.replace(
        believed, controller=dataclasses.replace(believed.controller, period=1.0 / rate),
        sensors=dataclasses.replace(believed.sensors, period=1.0 / rate),
        simulation=dataclasses.replace(believed.simulation, step=step if is_whole(1.0 / rate, step) else FINEST))


def multisine(duration: float) -> Multisine:
    """TONES of equal amplitude with Schroeder's phases, TEST_RMS in all."""
    n = len(TONES)
    return Multisine(start=0.0, duration=duration, frequency=TONES, amplitude=(TEST_RMS * math.sqrt(2.0 / n),) * n,
                     phase=tuple(-math.pi * k * (k + 1) / n for k in range(n)))


def in_air(believed: Nominal, air: str) -> Nominal:
    """The nominal in one of AIRS."""
    assert believed.simulation is not None
    return dataclasses.replace(
        believed, offsets=None if air == "calm" else OFFSETS, wind=WIND if air in ("wind", "excited") else None,
        test_input=multisine(believed.simulation.duration) if air == "excited" else None)


def with_levels(declared: Nominal, seed: int) -> Nominal:
    """The vehicle and air whose noise levels, of the wind too, are each a factor within WRONG_LEVEL off."""
    factors = np.exp(np.random.default_rng((918, seed)).uniform(-1.0, 1.0, FACTORS + 2) * math.log(WRONG_LEVEL))
    true = with_noise(declared, factors[:FACTORS])
    if true.wind is None:
        return true
    walk, turbulence = true.wind.walk * factors[-2], true.wind.turbulence * factors[-1]
    return dataclasses.replace(true, wind=dataclasses.replace(true.wind, walk=walk, turbulence=turbulence))


def with_noise(believed: Nominal, factors: np.ndarray) -> Nominal:
    """The vehicle whose five noise levels are `factors` times the declared ones."""
    s, a, m = believed.sensors, believed.actuator, believed.simulation
    assert a is not None and m is not None
    return dataclasses.replace(
        believed,
        sensors=dataclasses.replace(s, theta_std=s.theta_std * factors[0], theta_dot_std=s.theta_dot_std * factors[1],
                                    beta_std=s.beta_std * factors[2]),
        actuator=dataclasses.replace(a, command_noise_std=a.command_noise_std * factors[3]),
        simulation=dataclasses.replace(m, acceleration_noise_std=m.acceleration_noise_std * factors[4]))


def draw(seed: int, spread: float, noise_spread: bool) -> tuple[np.ndarray, np.ndarray]:
    """Relative deviations of a6 and k1, uniform in +-spread, and the noise factors, log-uniform in 0.67..1.5 or 1."""
    rng = np.random.default_rng((917, seed))
    deviation = rng.uniform(-spread, spread, 2)
    low, high = math.log(0.67), math.log(1.5)
    factors = np.exp(rng.uniform(low, high, FACTORS)) if noise_spread else np.ones(FACTORS)
    return deviation, factors


def run_jobs(job: Callable[..., Any], arguments: Iterable[tuple[Any, ...]]) -> list[Any]:
    """job(*arguments) for all, in order, one process a core."""
    with ProcessPoolExecutor(max_workers=os.cpu_count()) as executor:
        return list(executor.map(job, *zip(*arguments, strict=True), chunksize=4))
