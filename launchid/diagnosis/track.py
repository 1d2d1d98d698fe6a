"""One log, ready to be filtered: rows, commands, and the nominal's numbers along the rows."""

import math
from dataclasses import dataclass

import numpy as np

from sim.nominal import Nominal

from ..log.record import Record

FILTER_STEP = 0.0067    # s of the filter between two rows: a tenth of a servo's time
MOST_COMMANDS = 8       # in a row, each with a step of its own; of more, means


@dataclass(frozen=True, eq=False)
class Track:
    """One log, ready to be filtered.

    t (n + 1,) [s] of the rows and the end of the last; z (n, 3) theta, theta_dot, beta, NaN where not measured
    sub   filter steps between two rows;  edges (n sub + 1,) [s] their ends
    ticks (m + 1,) [s] at which the commands (m,) [rad] change
    a6, k1 (n,) of the nominal over each row [1/s^2];  wind (n,) [rad] that is known
    """

    record: Record
    t: np.ndarray
    z: np.ndarray
    sub: int
    edges: np.ndarray
    ticks: np.ndarray
    commands: np.ndarray
    a6: np.ndarray
    k1: np.ndarray
    wind: np.ndarray

    @property
    def nominal(self) -> Nominal:
        return self.record.nominal

    @property
    def period(self) -> float:
        return self.record.period


def track_of(r: Record) -> Track:
    """Return the record as a track at its rows' stamps, with the nominal's a6, k1 and wind there."""
    at = np.append(r.at, r.at[-1] + r.every)
    t = r.t[0] + at * r.step
    sub, commands = max(1, math.ceil(r.period / FILTER_STEP - 1e-9)), r.every // r.tick
    if r.fine == 1 and 1 < commands <= MOST_COMMANDS:   # no step has two of them: a fast servo tells them apart
        sub = commands * math.ceil(sub / commands)
    edges = np.append((t[:-1, None] + np.diff(t)[:, None] * np.arange(sub) / sub).ravel(), t[-1])
    ticks = t[0] + np.arange(len(r.commands) + 1) * (r.tick * r.step)
    middle = 0.5 * (t[:-1] + t[1:]) + r.shift
    a6, k1 = r.nominal.vehicle.at(middle)
    forecast = r.nominal.wind.profile if r.nominal.wind is not None else None
    wind = forecast.at(middle) if forecast is not None else np.zeros(r.rows)
    if r.path.size:
        wind = wind - np.interp(middle, *r.path)
    return Track(r, t, np.ascontiguousarray(r.z), sub, edges, ticks, r.commands, a6, k1, wind)
