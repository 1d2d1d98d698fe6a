"""Flights for the benchmarks: dispersed vehicles, noise declared right or wrong, on all cores."""

import dataclasses
import math
import os
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np

from sim.nominal import Nominal, built_in, load_nominal

NOMINALS = ("constant", "vega_like", "greensite_cr826")
FACTORS = 5  # theta, theta_dot, beta, command, acceleration


def nominal(name: str, command_noise: float | None = None) -> Nominal:
    """A built-in nominal, with another command noise [rad] if asked."""
    loaded = load_nominal(built_in(name))
    if command_noise is None:
        return loaded
    assert loaded.actuator is not None
    return dataclasses.replace(loaded, actuator=dataclasses.replace(loaded.actuator, command_noise_std=command_noise))


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
