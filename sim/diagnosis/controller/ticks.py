"""The controller's own ticks in a log whose rows fall between them, and the commands issued at each.

A logger that reads by a clock of its own sees a command some time after it was issued, some twice and some never.  In
rows faster than the controller the commands' changes tell where its ticks are; in slower ones they are taken to be
where the log's clock has them, and the servo's timing is as free as that is unknown.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...nominal import Nominal
from ..data.record import Record

SLOWER = 1.01     # of the controller's period: rows that far apart see a new command each
STAYS = 0.02      # of the rows repeat their command, if ticks are to be told
AGREES = 0.9      # of the rows that do, and of those that do not, must as the ticks say
PHASES = 60       # tried
ON = 1e-6         # of a period: a row so close before a tick sees its command


class Ticks(NamedTuple):
    """[steps of the grid] from the record's first row: one of them, and from one to the next; whether the commands
    tell where they are."""

    phase: float
    period: float
    are_told: bool

    def of(self, at: np.ndarray) -> np.ndarray:
        """(n,) int64: the tick whose command is seen at steps at (n,)."""
        return np.floor((at - self.phase) / self.period + ON).astype(np.int64)


def ticks_of(record: Record, command: np.ndarray) -> Ticks | None:
    """The controller's, of a log whose rows fall between them; None: they are the rows' own, or cannot be told.

    command  (n,) [rad] logged, NaN where it is not
    """
    own = record.nominal.controller
    if own is None or record.fine == 1:
        return None
    period, known = own.period / record.step, np.isfinite(command)
    if record.period > SLOWER * own.period or not known.any():
        return Ticks(-float(np.fmod(record.first_step, period)), period, False)
    return _told(record.at[known], command[known], period)


def _told(at: np.ndarray, command: np.ndarray, period: float) -> Ticks | None:
    """Of commands (n,) at steps at (n,) so that they change where ticks are between rows, and nowhere else."""
    changed = np.diff(command) != 0.0
    if changed.size == 0 or not STAYS <= np.mean(~changed) <= 1.0 - STAYS:
        return None

    def agreement(phase: float) -> tuple[float, float]:
        passed = np.diff(Ticks(phase, period, True).of(at)) > 0
        return float(np.mean(passed[changed])), float(np.mean(~passed[~changed]))

    tried = [(min(agreement(phase)), phase) for phase in -np.arange(PHASES) * period / PHASES]
    best = max(tried)[0]
    if best < AGREES:
        return None
    turns = np.exp(2j * math.pi * np.array([phase for agrees, phase in tried if agrees > best - 1e-9]) / period)
    middle = float(np.angle(np.sum(turns))) * period / (2.0 * math.pi)
    return Ticks(middle - period if middle > 0.0 else middle, period, True)


def with_timing(nominal: Nominal, ticks: Ticks) -> Nominal:
    """The nominal with its servo's timing as free as the ticks are unknown: anywhere within their period."""
    if ticks.are_told or nominal.controller is None:
        return nominal
    timing = math.hypot(nominal.diagnosis.timing, nominal.controller.period / math.sqrt(12.0))
    return replace(nominal, diagnosis=replace(nominal.diagnosis, timing=timing))


def issued_at(ticks: Ticks, record: Record, command: np.ndarray) -> np.ndarray:
    """(ticks,) [rad] commands from the tick before the first row to that of the record's last step; NaN: not logged.

    command  (n,) [rad] of the rows, NaN where it is not logged
    """
    known = np.isfinite(command)
    made = np.full(int(ticks.of(np.array([record.rows * record.every]))[0]) + 1, math.nan)
    made[np.maximum(ticks.of(record.at[known]), 0)] = command[known]
    return made


def over_grid(ticks: Ticks, record: Record, commands: np.ndarray) -> np.ndarray:
    """(grid's ticks,) [rad] mean over each of commands (ticks,) that are held from tick to tick."""
    edges = record.tick * np.arange(record.rows * record.every // record.tick + 1, dtype=np.float64)
    begins = ticks.phase + ticks.period * np.arange(len(commands) + 1)
    integral = np.concatenate([[0.0], np.cumsum(commands) * ticks.period])
    return np.asarray(np.diff(np.interp(edges, begins, integral)) / record.tick)


def lined(commands: np.ndarray) -> np.ndarray:
    """(ticks,) with lines over those that are not logged."""
    known, index = np.isfinite(commands), np.arange(len(commands))
    return np.interp(index, index[known], commands[known])
