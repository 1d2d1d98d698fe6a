"""The log's reference flown again in closed loop, by the nominal and by the extended one."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...effects import Effect
from ...errors import InputError
from ...flight import fly_whole
from ...nominal import Nominal
from ...sections import Guidance
from ..controller.kind import ControllerCheck
from ..data.record import Record
from .extend import with_controller

DRAWS = 8              # noise draws


def rms(x: np.ndarray) -> float:
    """Of the finite values, NaN if there is none."""
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


def simulated(record: Record, flown: Nominal, effects: Sequence[Effect], seed: int) -> np.ndarray:
    """Attitude [rad] of one closed-loop flight, at the log's period."""
    try:
        flight = fly_whole(flown, seed, "flight", record.period, effects=effects)
    except InputError:
        return np.zeros(0)
    return flight.theta
