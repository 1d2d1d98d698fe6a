"""Turn a log into what the filter reads: rows, commands, and the nominal's numbers along the rows."""

import math
from dataclasses import dataclass, replace

import numpy as np

from sim.errors import InputError
from sim.nominal import Nominal

from ..controller.check import ControllerCheck
from ..controller.command import record
from ..controller.gaps import Seen
from ..controller.issued import with_commands
from ..log.check import examined
from ..log.detect import DataCheck
from ..log.log import Log
from ..sums import combined, least_squares
from . import filter as ekf
from .data.record import Z_THETA, Z_THETA_DOT, Record
from .data.used import Used, shortened, sparser, used

MASKED = ("stamps", "range", "stale", "dropout", "spike")   # faults of rows; others are of whole columns
FEWEST_ROWS = 40       # without which nothing is fitted: twice as many as there are unknown numbers
FEWEST_USABLE = 0.5    # of the rows: with fewer left a log is bad data
ALERT = 30.0           # times the declared acceleration noise, between rows: the plant may be wrong, follow the sensors
ESCAPED = 1.0e3        # rad beyond where the log has been: a model that diverges so far is not followed further
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


@dataclass(frozen=True, eq=False)
class Reading:
    """A log that was read: checked, raw, its faults, the track to filter (None: bad data or too few rows), the check of
    its commands, and the rows used."""

    log: Log
    raw: Log
    data: DataCheck
    track: Track | None
    controller: ControllerCheck | None = None
    used: Used | None = None
    is_bad: bool = False


def read(log: Log, nominal: Nominal) -> Reading:
    """Return the log without faulty rows, with every command that was issued; InputError if it has no input."""
    seen = examined(log, nominal)
    log, raw, data = seen.log, seen.raw, seen.data
    told = replace(data, faults=(*seen.mended, *data.faults)) if seen.mended else data
    is_few = data.is_bad and data.usable.sum() < max(FEWEST_ROWS, FEWEST_USABLE * len(log.t))
    if is_few or not all(fault.kind in MASKED for fault in data.faults):
        return Reading(log, raw, told, None, is_bad=True)
    try:
        r = record(log, nominal, sparser(data, log.t, nominal))
    except InputError:
        if not data.is_bad:
            raise
        return Reading(log, raw, told, None, is_bad=True)
    if r.rows < FEWEST_ROWS:
        return Reading(log, raw, told, None)
    r, controller = with_commands(shortened(r), follow)
    r, rows = used(r, log.t[data.usable])
    return Reading(log, raw, told, track_of(r), controller, rows)


def follow(record: Record) -> Seen | None:
    """Filter a log slower than its controller with the nominal; return attitude at every tick and innovations, None if
    the model leaves the log."""
    from .candidates import usual
    from .model import Model
    parts = record.every // record.tick
    rows = record.rows * parts
    place = np.minimum(record.at // record.tick, rows - 1)
    z = np.full((rows, 3), math.nan)
    z[place] = record.z
    at = record.tick * np.arange(rows, dtype=np.int64)
    m = Model(track_of(replace(record, z=z, at=at, every=record.tick, reference=np.full(rows, math.nan))))
    m.with_numbers(usual(m), [])
    m.levels[ekf.QA] += math.log(ALERT)
    m.run(m.null)
    attitude, measured = m.X[:, 0].copy(), np.isfinite(record.z[:, Z_THETA])
    turned = record.z[:, Z_THETA] if measured.any() else \
        np.cumsum(np.nan_to_num(record.z[:, Z_THETA_DOT])) * record.period
    if not np.all(np.abs(attitude) < ESCAPED + np.nanmax(np.abs(turned))):   # no body turns so far, however it spins
        return None
    if np.count_nonzero(measured) > FEWEST_ROWS:   # what a wrong gyro slowly takes the attitude off
        slow = np.vander(np.linspace(-1.0, 1.0, rows), 3)
        off = record.z[measured, Z_THETA] - attitude[place[measured]]
        attitude += combined(slow, least_squares(slow[place[measured]], off))
    return Seen(attitude, np.where(np.isfinite(z), m.E, math.nan)[place])


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
