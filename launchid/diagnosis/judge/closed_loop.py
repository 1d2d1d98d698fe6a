"""The log's reference flown again in closed loop, by the nominal and by the extended one."""

import math
from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from sim.effects import Effect
from sim.errors import InputError
from sim.flight import Flight, fly_whole, is_whole
from sim.nominal import Nominal
from sim.sections import Guidance

from ..controller.kind import ControllerCheck
from ..data.record import Record
from .extend import with_controller

DRAWS = 8              # noise draws


def rms(x: np.ndarray) -> float:
    """The root mean square of the finite values, NaN if there is none."""
    x = x[np.isfinite(x)]
    return float(np.sqrt(np.mean(x**2))) if len(x) else math.nan


def closed_loop_errors(record: Record, extension: Sequence[Effect],
                       controller: ControllerCheck | None = None) -> tuple[float, float] | None:
    """RMS of measured less simulated attitude [rad], nominal and extended, mean over noise draws; None where the
    nominal cannot fly this log (no controller, no reference, a shifted clock)."""
    flown = as_flown(record)
    if flown is None:
        return None
    found = []
    for craft, effects in ((flown, ()), (with_controller(flown, controller), tuple(extension))):
        errors = []
        for seed in range(DRAWS):
            theta = simulated(record, craft, effects, seed)
            n = min(len(theta), record.rows)
            rest = record.z[:n, 0] - theta[:n]
            errors.append(rms(rest))
        found.append(float(np.mean(errors)))
    return found[0], found[1]


def as_flown(record: Record) -> Nominal | None:
    """The nominal with the log's reference and duration; None where it cannot fly."""
    nominal = record.nominal
    known = np.isfinite(record.reference)
    if (nominal.controller is None or nominal.simulation is None or nominal.actuator is None or not known.any()
            or record.shift != 0.0 or record.first_step != 0):
        return None
    t = record.t[known]
    duration = float(record.t[-1]) + record.period
    return replace(nominal, guidance=Guidance(tuple(t.tolist()), tuple(record.reference[known].tolist())),
                   simulation=replace(nominal.simulation, duration=duration))


def flown_along(record: Record, flown: Nominal, seed: int, effects: Sequence[Effect] = (), a6_factor: float = 1.0,
                k1_factor: float = 1.0) -> Flight:
    """A flight of `flown` with the log's rows; InputError where it cannot fly.  The log's period need be no whole
    number of simulation steps (a logger's clock is not ours): each row is then the nearest step's."""
    assert flown.simulation is not None
    step = flown.simulation.step
    if is_whole(record.period, step):
        return fly_whole(flown, seed, "flight", record.period, a6_factor, k1_factor, effects)
    flight = fly_whole(flown, seed, "flight", step, a6_factor, k1_factor, effects)
    at = np.round(record.period / step * np.arange(record.rows)).astype(np.int64)
    at = at[at < len(flight.t)]
    columns = {each.name: getattr(flight, each.name)[at] for each in fields(flight)
               if isinstance(getattr(flight, each.name), np.ndarray)}
    return replace(flight, period=record.period, **columns)


def simulated(record: Record, flown: Nominal, effects: Sequence[Effect], seed: int) -> np.ndarray:
    """Attitude [rad] of one closed-loop flight at the log's rows; none where it cannot fly."""
    try:
        return flown_along(record, flown, seed, effects).theta
    except InputError:
        return np.zeros(0)
