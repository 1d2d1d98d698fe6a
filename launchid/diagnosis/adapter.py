"""Read a log: check it, mask faulty rows, find every command, and lay it along its rows."""

import math
from dataclasses import dataclass, replace

import numpy as np

from sim.errors import InputError
from sim.nominal import Nominal

from ..controller.check import ControllerCheck
from ..controller.command import record
from ..controller.gaps import Seen
from ..controller.issued import with_commands
from ..likelihood import likelihood
from ..log.check import examined
from ..log.detect import DataCheck
from ..log.log import Log
from ..log.record import Z_THETA, Z_THETA_DOT, Record
from ..sums import combined, least_squares
from .model import Model
from .track import Track, track_of
from .used import Used, shortened, sparser, used

MASKED = ("stamps", "range", "stale", "dropout", "spike")   # faults of rows; others are of whole columns
FEWEST_ROWS = 40       # without which nothing is fitted: twice as many as there are unknown numbers
FEWEST_USABLE = 0.5    # of the rows: with fewer left a log is bad data
ALERT = 30.0           # times the declared acceleration noise, between rows: the plant may be wrong, follow the sensors
ESCAPED = 1.0e3        # rad beyond where the log has been: a model that diverges so far is not followed further


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
    signs = tuple(fault for fault in seen.faults if fault.kind == "sign")
    if signs:   # of beta and its command together, which only the vehicle shows
        return Reading(log, raw, replace(told, faults=(*told.faults, *signs)), None, is_bad=True)
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
    parts = record.every // record.tick
    rows = record.rows * parts
    place = np.minimum(record.at // record.tick, rows - 1)
    z = np.full((rows, 3), math.nan)
    z[place] = record.z
    at = record.tick * np.arange(rows, dtype=np.int64)
    m = Model.of(track_of(replace(record, z=z, at=at, every=record.tick, reference=np.full(rows, math.nan))))
    alert = np.array([math.log(ALERT) if name == "acceleration" else 0.0 for name in likelihood.LEVELS])
    made = likelihood.run(m.with_levels(m.levels + alert).parameters(m.table.null))
    attitude, measured = made.X[:, 0].copy(), np.isfinite(record.z[:, Z_THETA])
    turned = record.z[:, Z_THETA] if measured.any() else \
        np.cumsum(np.nan_to_num(record.z[:, Z_THETA_DOT])) * record.period
    if not np.all(np.abs(attitude) < ESCAPED + np.nanmax(np.abs(turned))):   # no body turns so far, however it spins
        return None
    if np.count_nonzero(measured) > FEWEST_ROWS:   # what a wrong gyro slowly takes the attitude off
        slow = np.vander(np.linspace(-1.0, 1.0, rows), 3)
        off = record.z[measured, Z_THETA] - attitude[place[measured]]
        attitude += combined(slow, least_squares(slow[place[measured]], off))
    return Seen(attitude, np.where(np.isfinite(z), made.E, math.nan)[place])
