"""Choose the rows to fit: all of an ordinary log, of a larger one as many as are answered in time.

A log that is fast for its vehicle is thinned: every k-th row keeps its measurements, all commands stay, and nothing is
averaged or late.  What is longer still is cut to the stretch in which the commands move most.  Both lose information
and nothing else: deviations and limits are those of the rows that are used.  Where no servo is between command and
motion, the input between two rows that are kept is the line between them.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sim.nominal import Nominal

from ..log.detect import DataCheck
from ..log.record import Record

ROWS_FITTED = 8_000    # rows that are fitted: 80 s at 100 Hz
SWING_TERM = "sin(theta)"  # the term of a body that swings, beside a6
LONGEST_PERIOD = 0.02  # s between rows that are kept of a faster log: two fifths of a servo's time constant of 0.05 s
MOTION_STEP = 0.3      # rad of the nominal's own motion, of frequency |a6|^1/2, between them: 20 rows a period


class Used(NamedTuple):
    """The rows of a log that are fitted: `rows` of them, one in `every`, from `begin` to `end` [s, the log's clock]."""

    rows: int
    every: int
    begin: float
    end: float

    @property
    def words(self) -> str:
        """The choice of rows as one line of text."""
        return f"{self.rows} rows are fitted, one in {self.every} from {self.begin:.6g} to {self.end:.6g} s"


def sparser(data: DataCheck, t: np.ndarray, nominal: Nominal) -> DataCheck:
    """Return the check with so many rows usable as are fitted, if the log is a test stand's without servo; t (n,) [s]
    stamps."""
    rows = np.flatnonzero(data.usable)
    if nominal.actuator is not None or nominal.controller is not None or len(rows) <= ROWS_FITTED:
        return data
    every = _every(len(rows), float(np.median(np.diff(t[rows]))), nominal, t[rows])
    kept = np.zeros_like(data.usable)
    kept[rows[::every]] = True
    return replace(data, usable=kept)


def _every(rows: int, period: float, nominal: Nominal, t: np.ndarray) -> int:
    stiffness = float(np.max(np.abs(nominal.vehicle.at(t)[0]))) + sum(
        abs(of) for term, of in nominal.terms if term == SWING_TERM)
    longest = min(LONGEST_PERIOD, MOTION_STEP / math.sqrt(stiffness)) if stiffness > 0.0 else LONGEST_PERIOD
    return max(1, min(math.ceil(rows / ROWS_FITTED), math.floor(longest / period + 1e-9)))


def shortened(record: Record) -> Record:
    """Cut the record to the most rows that `used` can thin to ROWS_FITTED; further rows would not be used."""
    if record.rows <= ROWS_FITTED:
        return record
    longest = ROWS_FITTED * _every(record.rows, record.period, record.nominal, record.t + record.shift)
    return cut(record, longest) if record.rows > longest else record


def used(record: Record, t: np.ndarray) -> tuple[Record, Used | None]:
    """Return the record with at most ROWS_FITTED rows, and which rows of the log's usable stamps t (n,) [s] they are:
    None if all."""
    every = _every(record.rows, record.period, record.nominal, record.t + record.shift)
    made = thinned(record, record.held * max(1, round(every / record.held))) if every > 1 else record
    made = cut(made, ROWS_FITTED) if made.rows > ROWS_FITTED else made
    times = round(made.period / float(np.median(np.diff(t))))
    if made is record and times <= 1:
        return record, None
    return made, Used(made.rows, times, float(made.t[0]) + made.shift, float(made.t[-1]) + made.shift)


def thinned(record: Record, every: int) -> Record:
    """Return the record with one row in `every`, a multiple of `held`, from the first row at which a command is issued.
    In a jittered log `every` parts of a command become one: its place is as exact for the rows left as it was for
    all."""
    first, held = record.held_phase, record.held
    begin = int(record.at[first])
    kept = slice(first, None, every)
    commands = record.commands[begin // record.tick:]
    merged = every if record.fine > 1 else held
    if held > 1:  # one tick a command then
        commands = commands[::held]
    elif merged > 1:
        whole = np.append(commands, np.full(-len(commands) % merged, commands[-1]))
        commands = np.ascontiguousarray(whole.reshape(-1, merged).mean(axis=1))
    at = record.at[kept] - begin
    ticks = len(at) * (record.every * every // (record.tick * merged))  # as many as the last row would hold, too
    commands = np.append(commands[:ticks], np.full(max(0, ticks - len(commands)), commands[-1]))

    def some(column: np.ndarray) -> np.ndarray:  # in one piece, for which alone the kernels are compiled
        return np.ascontiguousarray(column[kept])

    return replace(record, z=some(record.z), reference=some(record.reference), at=at,
                   first_step=record.first_step + begin, every=record.every * every, tick=record.tick * merged,
                   commands=commands, logged=None if record.logged is None else some(record.logged),
                   held=1, held_phase=0, unsure=record.unsure * every)


def cut(record: Record, most: int) -> Record:
    """Return the stretch of `most` rows in which the commands move most."""
    ticks = record.every // record.tick
    moved = np.concatenate([[0.0], np.abs(np.diff(record.commands))])
    by_row = np.add.reduceat(moved, np.arange(0, len(moved), ticks))[:record.rows]
    total = np.concatenate([[0.0], np.cumsum(by_row)])
    first = int(np.argmax(total[most:] - total[:-most]))
    first -= (first - record.held_phase) % record.held
    return stretch(record, max(first, record.held_phase if record.held > 1 else 0), most)


def stretch(record: Record, first: int, rows: int) -> Record:
    """Return `rows` rows of a record from `first` on, a row at which a command is issued."""
    ticks = record.every // record.tick
    part = slice(first, first + rows)
    begin = first * record.every
    at = np.maximum(record.at[part] - begin, 0)  # its first stamp may be early
    return replace(record, z=record.z[part], reference=record.reference[part], at=at,
                   first_step=record.first_step + begin, commands=record.commands[first * ticks:(first + rows) * ticks],
                   logged=None if record.logged is None else record.logged[part], held_phase=0)
