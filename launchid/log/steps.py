"""Find the step of a sensor: every value of its column is a whole number of steps from every other."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from sim.nominal import Nominal

from .log import Log

STEPPED = ("theta", "theta_dot", "beta")
FEWEST_STEPS = 3       # different values
MANY_VALUES = 20       # different values, of which none is between two steps by chance
MOST_DIFFERENT = 0.5   # of the rows, that have a value of their own: of a column that is not stepped all have
OFF_STEP = 0.05        # of a step, that a printed value may be off
COUNTS = 0.1           # of a declared deviation, that step/sqrt(12) must be to count
SYSTEMATIC = 0.5       # of the declared deviation, that an error which depends on theta may be


def step_of(x: np.ndarray) -> float:
    """Return the step of a column x (n,); 0 if it has none."""
    known = x[np.isfinite(x)]
    values = np.unique(known)
    if not FEWEST_STEPS <= len(values) <= MOST_DIFFERENT * len(known):
        return 0.0
    apart = np.diff(values)
    apart = apart[apart > 1e-6 * np.ptp(values)]
    step = float(np.min(apart, initial=math.inf))
    if not math.isfinite(step):
        return 0.0
    step = float(np.median(apart[apart < 1.5 * step]))   # less the rounding of one
    many = (values - values[0]) / step
    return step if np.max(np.abs(many - np.rint(many))) < OFF_STEP else 0.0


def quantum_of(x: np.ndarray) -> float:
    """Return the largest number [the column's unit] that every difference of values of x (n,) is a multiple of; 0 if
    there is none.  A column of few digits in another unit has one in ours, as degrees of three decimals in rad."""
    values = np.unique(x[np.isfinite(x)])
    if len(values) < MANY_VALUES:
        return 0.0
    apart = np.diff(values)
    apart = apart[apart > 1e-9 * np.ptp(values)]
    for parts in (1, 2, 3):
        step = float(np.min(apart)) / parts
        step = float(np.ptp(values)) / max(round(float(np.ptp(values)) / step), 1)   # of all of them the best known
        many = (values - values[0]) / step
        if np.max(np.abs(many - np.rint(many))) < OFF_STEP:
            return step
    return 0.0


def with_steps(nominal: Nominal, log: Log) -> Nominal:
    """Return the nominal with the steps of the log's columns in [sensors], where they are larger than declared and
    count beside the declared noise."""
    more, sensors = dict[str, Any](), nominal.sensors
    for name in STEPPED:
        step, std = step_of(getattr(log, name)), getattr(sensors, f"{name}_std")
        if step > getattr(sensors, f"{name}_step") and step / math.sqrt(12.0) > COUNTS * std:
            more[f"{name}_step"] = step
    return replace(nominal, sensors=replace(nominal.sensors, **more)) if more else nominal


def systematic_step(nominal: Nominal, log: Log) -> str:
    """Return in words that theta comes in undeclared steps whose error is no noise; "" if not.

    With noise of deviation s before it a step d leaves an error that follows theta, d/pi exp(-2 pi^2 (s/d)^2) large at
    most (Widrow and Kollar, Quantization Noise, 2008, 4): white if s is a third of d, a mistaken angle if it is less.
    """
    std, step = nominal.sensors.theta_std, step_of(log.theta)
    if step <= nominal.sensors.theta_step or std == 0.0:
        return ""
    error = step / math.pi * math.exp(-2.0 * (math.pi * std / step)**2)
    if error <= SYSTEMATIC * std:
        return ""
    return (f"theta comes in steps of {step:.3g} rad, {step / std:.2g} times its declared noise: what rounding leaves "
            "is no noise, and a6 and k1 are not known; log theta with more digits, or identify without a nominal")
