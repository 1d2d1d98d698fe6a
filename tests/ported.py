"""Exported estimators that the port's tests share: configurations, flights, and the program that replays them."""

import dataclasses
import math
import shutil
import subprocess
from collections.abc import Iterable, Iterator
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from launchid.c_export.program import c_files
from launchid.robustness.level import ranged_model
from launchid_core import Config, Sample
from sim.effects import from_text
from sim.flight import fly
from sim.nominal import Nominal, load_nominal
from sim.onboard import onboard_model
from sim.sections import Bending, Drift, InTime, Offsets, Slosh, Wind, constant

CC = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
needs_compiler = pytest.mark.skipif(CC is None, reason="no C compiler here")
WARNINGS = ("-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wsign-conversion", "-Wdouble-promotion", "-Wshadow",
            "-Werror")
STRICT = ("-std=c99", *WARNINGS, "-ffp-contract=off")
NAN = math.nan
SHARED = Path(__file__).parent
MOST_SAMPLES = 25_000  # of a flight: 25 s at 1 kHz, with the loss at 20 s; at 100 Hz all


_translated: dict[str, dict[str, str]] = {}


def translated(config: Config) -> dict[str, str]:
    """`c_files`, once a process for each configuration (two that are equal may differ by the sign of a zero)."""
    key = repr(config)
    if key not in _translated:
        _translated[key] = c_files(config)
    return _translated[key]


def written(folder: Path, config: Config) -> Path:
    """The folder, with all files of a configuration."""
    for name, text in translated(config).items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def built(folder: Path, config: Config, *flags: str) -> Path:
    """The replay program of a configuration; compiled quickly where no flags are given, for what optimisation does to
    the bits is asked by tests of its own."""
    program = written(folder, config) / "replay"
    subprocess.run([str(CC), *STRICT, *(flags or ("-O0",)), "replay.c", "launchid.c", "-lm", "-o", str(program)],
                   cwd=folder, check=True)
    return program


def as_text(samples: list[Sample]) -> str:
    """The samples as the port's programs read them."""
    return "".join(" ".join(repr(float(x)) for x in sample) + "\n" for sample in samples)


def replayed(program: Path, samples: list[Sample]) -> list[str]:
    """The answers of the port."""
    done = subprocess.run([str(program)], input=as_text(samples), capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return done.stdout.splitlines()


def filtered(name: str = "constant", ranged: bool = False, **choices) -> Config:
    nominal = load_nominal(name)
    model = ranged_model(nominal) if ranged else onboard_model(nominal)
    return Config(**{"window": 1.0, "sample_period": 0.01, "formulation": "filtered", "model": model} | choices)


ROUGH = {"wind": Wind(walk=0.005, turbulence=0.005),
         "offsets": Offsets(thrust_misalignment=0.004, attitude_bias=0.005, gyro_bias=1e-4, nozzle_sensor_bias=1e-3,
                            moment=1e-3),
         "drift": Drift(np.zeros(1), np.array([0.03]), np.array([0.02]))}


def rough(**choices) -> Config:
    """The configuration of the constant nominal in wind, with every offset and with drift."""
    return filtered(model=onboard_model(dataclasses.replace(load_nominal("constant"), **ROUGH)), **choices)


UNSURE = {"natural_frequency_sigma": 0.3, "damping_ratio_sigma": 0.3, "delay_sigma": 0.02}


def unsure(sections=None, **choices) -> Config:
    """The constant nominal with a servo that is not known, and with these sections."""
    nominal = dataclasses.replace(load_nominal("constant"), **(sections or {}))
    assert nominal.actuator is not None
    servo = dataclasses.replace(nominal.actuator, **UNSURE)
    return filtered(model=onboard_model(dataclasses.replace(nominal, actuator=servo)), **choices)


KNOWN = {"effects": tuple(map(from_text, (
    "moment_step:acceleration=0.05,time=20.003", "periodic_disturbance:amplitude=0.04,frequency=3,phase=0.4",
    "aero_cubic:coefficient=10", "missing_term:term=theta^2,coefficient=8",
    "missing_term:term=sin(beta),coefficient=1", "actuator_backlash:half_width=0.002",
    "actuator_bandwidth:scale=0.6,lag=1", "input_washout:time_constant=15", "nozzle_inertia:coefficient=-0.01",
    "actuator_rate_limit:rate=0.3")))}


def known(**choices) -> Config:
    """The constant nominal with what the filter knows beside a6 and k1."""
    return filtered(model=onboard_model(dataclasses.replace(load_nominal("constant"), **KNOWN)), **choices)


MODES = {"slosh": (Slosh(constant(3.5), constant(0.05), constant(0.01), frequency_sigma=0.1, coupling_sigma=0.5),
                   Slosh(InTime((0.0, 40.0), (5.5, 6.5)), constant(0.02))),
         "bending": (Bending(constant(19.0), constant(0.02), constant(0.01), gyro_gain=constant(-0.015),
                             frequency_sigma=0.1, gain_sigma=0.5, damping_ratio_sigma=0.3),)}


def flexible(sections=None, servo=None, **choices) -> Config:
    """The constant nominal with slosh and bending, known and not, and with these sections and what its servo lacks."""
    nominal = dataclasses.replace(load_nominal("constant"), **MODES, **(sections or {}))
    assert nominal.actuator is not None
    actuator = dataclasses.replace(nominal.actuator, **(servo or {}))
    return filtered(model=onboard_model(dataclasses.replace(nominal, actuator=actuator)), **choices)


def regression(formulation: str, **choices) -> Config:
    return Config(**{"window": 1.0, "sample_period": 0.01, "formulation": formulation, "library": "quadratic+sin"}
                  | choices)


CONFIGS = {
    "filtered": filtered(window=5.0),
    "filtered-vega": filtered("vega_like"),
    "filtered-range": filtered(ranged=True),
    "filtered-vega-range": filtered("vega_like", True, window=5.0),
    "filtered-terms": filtered(library="quadratic", window=5.0),
    "filtered-wind": rough(window=10.0),
    "filtered-servo": unsure(),
    "filtered-wind-servo": unsure(ROUGH, window=10.0),
    "filtered-known": known(window=5.0),
    "filtered-modes": flexible(window=5.0),
    "filtered-modes-wind-servo": flexible(ROUGH, UNSURE, window=10.0),
    "filtered-still": filtered("cr826_max_q"),
    "filtered-declared": filtered(noise="declared"),
    "measured-stls": regression("measured", compression=3),
    "difference-sr3": regression("difference", solver="sr3", compression=2),
    "integral-ssr": regression("integral", solver="ssr", seed=7),
    "integral-lasso": regression("integral", solver="lasso", compression=2),
    "filtered-functions": filtered("greensite_cr826", library="theta,beta,sign(theta_dot),cos(theta),theta*beta"),
    "filtered-sine": filtered(library="quadratic+sin", window=5.0),
    "lpv": regression("integral", library="lpv", window=0.3, solver="ssr", seed=7),
}

CERTIFIED = {  # what is asked of every part of a port that a reviewer certifies
    "constant": CONFIGS["filtered-range"],
    "vega_like": CONFIGS["filtered-vega-range"],
    "wind": rough(window=5.0),
    "servo": CONFIGS["filtered-servo"],
    "integral": regression("integral", library="rigid-body"),
    "terms": CONFIGS["filtered-terms"],
}


def some(*names: str, of: Iterable[str] = CONFIGS) -> list[Any]:
    """The named ones of these configurations in every run, the others, cases of the same law, with `-m campaign`."""
    return [name if name in names else pytest.param(name, marks=pytest.mark.campaign) for name in of]


@cache
def _flown(name: str, suite: str) -> tuple[Sample, ...]:
    return tuple(islice(_flight(load_nominal(name), suite), MOST_SAMPLES))


def _flight(nominal: Nominal, suite: str) -> Iterator[Sample]:
    return fly(nominal, seed=3, suite=suite, effects=[from_text("control_loss:fraction=0.4,time=20")])


def flight(name: str = "constant", suite: str = "flight", **sections) -> list[Sample]:
    """A flight that loses control efficiency on the way."""
    if sections:
        return list(_flight(dataclasses.replace(load_nominal(name), **sections), suite))
    return list(_flown(name, suite))


def hostile(seed: int, length: int = 600) -> list[Sample]:
    """Samples with gaps, clocks set back, stamps repeated, infinities, missing and absurd values."""
    rng = np.random.default_rng(seed)
    t, samples = 0.0, []
    for _ in range(length):
        t += float(rng.choice([0.01, 0.01, 0.01, 0.01, 0.01, 0.0, 0.5, -0.01, -3.0, 1e-9], p=[.19] * 5 + [.01] * 5))
        values = 0.05 * rng.standard_normal(5)
        for k in range(5):
            if rng.random() < 0.02:
                values[k] = rng.choice([NAN, math.inf, -math.inf, 1e300, 0.0, -0.0, 1e-310])
        samples.append(Sample(NAN if rng.random() < 0.005 else t, *values.tolist()))
    return samples
