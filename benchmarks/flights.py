"""Common parts of the benchmarks: options, flights of dispersed vehicles on all cores, their estimates, tables."""

import argparse
import dataclasses
import math
import os
import re
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np

from launchid.identification.windows import run
from launchid_core import Config, Estimate, Tracked
from sim.flight import Flight, is_whole
from sim.nominal import Multisine, Nominal, Offsets, Wind, built_in, load_nominal
from sim.onboard import onboard_model

NOMINALS = ("constant", "vega_like", "greensite_cr826")
FACTORS = 5  # theta, theta_dot, beta, command, acceleration
AIRS = ("calm", "offsets", "wind", "excited")  # calm; unknown offsets; wind too; a multisine on the command too
OFFSETS = Offsets(thrust_misalignment=0.004, attitude_bias=0.005)
WIND = Wind(walk=0.005, turbulence=0.005)
TONES = (1.5, 3.1, 5.0, 7.2, 9.9, 13.0)  # rad/s, no two in a ratio of whole numbers, about the loop's bandwidth
TEST_RMS = math.radians(0.5)             # of the multisine, rad
WRONG_LEVEL = 2.0                        # a level is declared within this factor of the true one
INTERVAL = 1.96                          # standard deviations of a 95 % interval
FINEST = 0.0005                          # s: a step of the simulation for periods that its own does not divide


def arguments(doc: str, parts: Iterable[str] = (), **defaults: Any) -> argparse.Namespace:
    """Return the command's options, one for each default: of a tuple the first is the default and the others may be
    chosen; of a list all are, and any may be, of numbers others too.  doc: help text; `part`: one of `parts`, if there
    are any; `seeds`: those of the flights from `seed` on."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    if parts:
        parser.add_argument("part", choices=parts)
    defaults["nominal"] = list(NOMINALS)
    for name, default in defaults.items():
        option = f"--{name.replace('_', '-')}"
        if isinstance(default, bool):
            parser.add_argument(option, action="store_true")
        elif isinstance(default, list):
            parser.add_argument(option, type=type(default[0]), action="append",
                                choices=default if isinstance(default[0], str) else None)
        elif isinstance(default, tuple):
            parser.add_argument(option, choices=default, default=default[0])
        else:
            parser.add_argument(option, type=type(default), default=default)
    args = parser.parse_args()
    for name, default in defaults.items():
        setattr(args, name, default if getattr(args, name) is None else getattr(args, name))
    if "seed" in defaults:
        args.seeds = range(args.seed, args.seed + args.flights)
    return args


class Table:
    """A table on the terminal: `Table("nominal 16", "RMS/bound 9.3f")` prints its head, `row` a line.  A column is a
    heading and the format of its cells (of text the width alone).  missed: the number of rows that miss their
    demand."""

    def __init__(self, *columns: str) -> None:
        self.missed = 0
        self.cells: list[str] = []
        head = []
        for column in columns:
            heading, width, kind = re.fullmatch(r"(.*) (\d+)(.*)", column).groups()
            place = f"{'>' if kind else '<'}{max(int(width), len(heading))}"
            head.append(f"{heading:{place}}")
            self.cells.append(place + kind)
        print(*head)

    def row(self, *cells: Any, good: bool = True) -> None:
        """Print a line; if not `good`, marked MISSED and counted."""
        self.missed += not good
        texts = [f"{cell:{form}}" for cell, form in zip(cells, self.cells, strict=True)]
        print(*texts, "" if good else "MISSED", flush=True)


def nominal(name: str) -> Nominal:
    """Return a built-in nominal."""
    return load_nominal(built_in(name))


def at_rate(believed: Nominal, rate: float) -> Nominal:
    """Return the nominal with controller and sensors at another rate [Hz]; the standard deviation of a draw stays."""
    step = believed.simulation.step
    return dataclasses.replace(
        believed, controller=dataclasses.replace(believed.controller, period=1.0 / rate),
        sensors=dataclasses.replace(believed.sensors, period=1.0 / rate),
        simulation=dataclasses.replace(believed.simulation, step=step if is_whole(1.0 / rate, step) else FINEST))


def multisine(duration: float) -> Multisine:
    """Return a multisine over `duration` [s]: TONES of equal amplitude, Schroeder's phases, TEST_RMS in all."""
    n = len(TONES)
    return Multisine(start=0.0, duration=duration, frequency=TONES, amplitude=(TEST_RMS * math.sqrt(2.0 / n),) * n,
                     phase=tuple(-math.pi * k * (k + 1) / n for k in range(n)))


def in_air(believed: Nominal, air: str) -> Nominal:
    """Return the nominal in one of AIRS."""
    return dataclasses.replace(
        believed, offsets=None if air == "calm" else OFFSETS, wind=WIND if air in ("wind", "excited") else None,
        test_input=multisine(believed.simulation.duration) if air == "excited" else None)


def with_levels(declared: Nominal, seed: int) -> Nominal:
    """Return the nominal with each noise level, of the wind too, off by a factor within WRONG_LEVEL, drawn by seed."""
    factors = np.exp(np.random.default_rng((918, seed)).uniform(-1.0, 1.0, FACTORS + 2) * math.log(WRONG_LEVEL))
    true = with_noise(declared, factors[:FACTORS])
    if true.wind is None:
        return true
    walk, turbulence = true.wind.walk * factors[-2], true.wind.turbulence * factors[-1]
    return dataclasses.replace(true, wind=dataclasses.replace(true.wind, walk=walk, turbulence=turbulence))


def with_noise(believed: Nominal, factors: np.ndarray) -> Nominal:
    """Return the nominal with its five noise levels multiplied by `factors` (5,)."""
    s, a, m = believed.sensors, believed.actuator, believed.simulation
    return dataclasses.replace(
        believed,
        sensors=dataclasses.replace(s, theta_std=s.theta_std * factors[0], theta_dot_std=s.theta_dot_std * factors[1],
                                    beta_std=s.beta_std * factors[2]),
        actuator=dataclasses.replace(a, command_noise_std=a.command_noise_std * factors[3]),
        simulation=dataclasses.replace(m, acceleration_noise_std=m.acceleration_noise_std * factors[4]))


def draw(seed: int, spread: float, noise_spread: bool) -> tuple[np.ndarray, np.ndarray]:
    """Draw relative deviations (2,) of a6, k1, uniform in +-spread, and noise factors, log-uniform 0.67..1.5, or 1."""
    rng = np.random.default_rng((917, seed))
    deviation = rng.uniform(-spread, spread, 2)
    low, high = math.log(0.67), math.log(1.5)
    factors = np.exp(rng.uniform(low, high, FACTORS)) if noise_spread else np.ones(FACTORS)
    return deviation, factors


def estimates_of(flight: Flight, believed: Nominal, window: float, **choices: Any) -> list[Estimate]:
    """Return the estimates of `filtered` on a flight, in windows of this length [s]."""
    return run(Config(window=window, sample_period=flight.period, formulation="filtered",
                      model=onboard_model(believed), **choices), flight.rows())[0]


def relative(of: Sequence[Estimate | Tracked], a6: np.ndarray, k1: np.ndarray) -> np.ndarray:
    """Return errors of a6 and k1, then their standard deviations, relative to the truth a6, k1 (n,): shape (n, 4)."""
    rows = np.array([[each.a6, each.k1, each.a6_std, each.k1_std] for each in of]).reshape(-1, 4)
    truth = np.column_stack([a6, k1])
    return np.column_stack([rows[:, :2] - truth, rows[:, 2:]]) / np.tile(np.abs(truth), 2)


def run_jobs(job: Callable[..., Any], arguments: Iterable[tuple[Any, ...]]) -> list[Any]:
    """Return job(*arguments) for all, in order, run in one process a core."""
    with ProcessPoolExecutor(max_workers=os.cpu_count()) as executor:
        return list(executor.map(job, *zip(*arguments, strict=True), chunksize=4))
