"""Find the controller's ticks in a log whose rows fall between them, and the commands issued at each.

A logger that reads by a clock of its own sees a command some time after it was issued, some twice and some never.  In
rows faster than the controller the commands' changes tell where its ticks are; in slower ones they are taken to be
where the log's clock has them, and the servo's timing is as free as that is unknown.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..log.record import Z_THETA, Record
from ..series import MEDIAN_OF_NORMAL, filled
from ..sums import combined, least_squares
from .replay import KD, KP, LAW_PERIOD, LAW_TIME_CONSTANT, NEAR_LIMIT, constants_of

SLOWER = 1.01     # of the controller's period: rows that far apart see a new command each
STAYS = 0.02      # of the rows repeat their command, if ticks are to be told
AGREES = 0.85     # of the rows that do, and of those that do not, must as the ticks say: a row stands within its step
PHASES_TRIED = 60  # tried
LAW_ROWS = 3      # rows of a linear law
MIN_ROWS_A_LAW = 60  # rows that tell one
OTHERS = 0.6      # of what the attitude's noise makes of a command: more is noise that the rows do not have
LINE_ROWS = 3     # rows to either side that a line is drawn by
JUMP_SIGMAS = 5.0  # standard deviations by which a value leaves the line of its neighbours
AT_TICK = 1e-6    # of a period: a row so close before a tick sees its command


class Ticks(NamedTuple):
    """The controller's ticks, in grid steps from the record's first row: phase of one of them, period, and one sigma
    (`spread`) of their place."""

    phase: float
    period: float
    spread: float

    def of(self, at: np.ndarray) -> np.ndarray:
        """Return the number (n,) int64 of the tick whose command is seen at grid steps at (n,)."""
        return np.floor((at - self.phase) / self.period + AT_TICK).astype(np.int64)


def ticks_of(record: Record, command: np.ndarray) -> Ticks | None:
    """Return the controller's ticks in a log that does not see all of them; None: they are rows', or cannot be told.

    command  (n,) [rad] logged, NaN where it is not
    """
    own = record.nominal.controller
    if own is None or record.fine == 1:
        return Ticks(0.0, float(record.tick), 0.0) if own is not None and record.every > record.tick else None
    period, known = own.period / record.step, np.isfinite(command)
    anywhere = period / math.sqrt(12.0)
    if record.period > SLOWER * own.period or not known.any():
        return Ticks(-float(np.fmod(record.first_step, period)), period, anywhere)
    told = _told(record.at[known], command[known], period, NEAR_LIMIT * record.actuator.deflection_limit)
    return Ticks(-0.5 * period, period, anywhere) if told is None and falls_between(record, command) else told


def noise_std(record: Record) -> float:
    """Return the standard deviation [rad] of the attitude's noise, quantisation included."""
    sensors = record.nominal.sensors
    return math.hypot(sensors.theta_std, sensors.theta_step / 12**0.5)


def command_noise(record: Record) -> float:
    """Return one sigma [rad] of the command that the controller makes at once of the attitude's noise."""
    c = constants_of(record.nominal)
    return float(abs(c[KP] + c[KD] / (c[LAW_TIME_CONSTANT] + c[LAW_PERIOD]))) * noise_std(record)


def falls_between(record: Record, command: np.ndarray) -> bool:
    """Whether the controller answered attitudes between the rows: no linear law of neighbouring rows reproduces the
    commands (n,) [rad] (NaN: not logged) to within the noise of a command."""
    if record.nominal.controller is None or noise_std(record) == 0.0 or not np.isfinite(command).any():
        return False
    first, stride = record.held_phase, record.held
    theta, command = record.z[first::stride, Z_THETA], command[first::stride]
    free = np.where(np.abs(command) < NEAR_LIMIT * record.actuator.deflection_limit, command, math.nan)
    n = len(free) - LAW_ROWS
    if n < MIN_ROWS_A_LAW:
        return False
    among = np.column_stack([*(theta[LAW_ROWS - j:LAW_ROWS - j + n] for j in range(LAW_ROWS + 1)),
                             *(free[LAW_ROWS - j:LAW_ROWS - j + n] for j in range(1, LAW_ROWS + 1)), np.ones(n),
                             np.arange(n) / n])
    wanted = free[LAW_ROWS:]
    whole = np.isfinite(among).all(axis=1) & np.isfinite(wanted)
    if np.count_nonzero(whole) < MIN_ROWS_A_LAW:
        return False
    rest = wanted[whole] - combined(among[whole], least_squares(among[whole], wanted[whole]))
    return float(np.median(np.abs(rest))) > MEDIAN_OF_NORMAL * OTHERS * command_noise(record)


def _told(at: np.ndarray, command: np.ndarray, period: float, limit: float) -> Ticks | None:
    """Return the ticks at which commands (n,), seen at grid steps at (n,), change between rows, and at no others (those
    at the limit need not); None if none fit."""
    free = np.abs(command[1:]) < limit
    changed = (np.diff(command) != 0.0)[free]
    if changed.size == 0 or not STAYS <= np.mean(~changed) <= 1.0 - STAYS:
        return None

    def agreement(phase: float) -> tuple[float, float]:
        passed = np.diff(Ticks(phase, period, 0.0).of(at))[free] > 0
        return float(np.mean(passed[changed])), float(np.mean(~passed[~changed]))

    tried = [(min(agreement(phase)), phase) for phase in -np.arange(PHASES_TRIED) * period / PHASES_TRIED]
    best = max(tried)[0]
    if best < AGREES:
        return None
    turns = np.exp(2j * math.pi * np.array([phase for agrees, phase in tried if agrees > best - 1e-9]) / period)
    middle = float(np.angle(np.sum(turns))) * period / (2.0 * math.pi)
    return Ticks(middle - period if middle > 0.0 else middle, period,
                 len(turns) * period / PHASES_TRIED / math.sqrt(12.0))


def between(record: Record, ticks: Ticks) -> Record:
    """Return the record with the nominal's tolerance of timing widened by the uncertainty of these ticks."""
    if ticks.spread == 0.0:
        return record
    own, diagnosis = record.nominal.controller, record.nominal.diagnosis
    assert own is not None
    unknown = ticks.spread / ticks.period * own.period
    timed = replace(record.nominal, diagnosis=replace(diagnosis, timing=math.hypot(diagnosis.timing, unknown)))
    return replace(record, nominal=timed)


def issued_at(ticks: Ticks, record: Record, command: np.ndarray) -> np.ndarray:
    """Return commands (ticks,) [rad], NaN if not logged, from the tick before the first row to the last step's.

    command  (n,) [rad] of the rows, NaN where it is not logged
    """
    known = np.isfinite(command)
    made = np.full(int(ticks.of(np.array([record.rows * record.every]))[0]) + 1, math.nan)
    made[np.maximum(ticks.of(record.at[known]), 0)] = command[known]
    return made


def over_grid(ticks: Ticks, record: Record, commands: np.ndarray) -> np.ndarray:
    """Return the means (grid's ticks,) [rad] over each grid tick of commands (ticks,) held from tick to tick."""
    count = record.rows * record.every // record.tick
    if ticks.period == record.tick:
        return commands[:count]
    edges = record.tick * np.arange(count + 1, dtype=np.float64)
    begins = ticks.phase + ticks.period * np.arange(len(commands) + 1)
    integral = np.concatenate([[0.0], np.cumsum(commands) * ticks.period])
    return np.asarray(np.diff(np.interp(edges, begins, integral)) / record.tick)


def carried(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Split x (n,) of rows, NaN: not logged, into the line (n,) that carries over to between rows, how far (n,) it is
    off the rows (0 where not logged), and whether x jumps there (n,) bool, so that this is no noise.

    The line is a mean over neighbours, with the weights with which those at twice the distance give the rows themselves
    where nothing jumps: noise of a row alone is in no other's.
    """
    known, rows = np.isfinite(x), np.arange(len(x))
    whole = filled(x)

    def of(away: int) -> np.ndarray:
        return np.asarray(0.5 * (whole[np.clip(rows - away, 0, rows[-1])] + whole[np.clip(rows + away, 0, rows[-1])]))

    twice = np.column_stack([0.5 * (of(2 * j - 1) + of(2 * j + 1)) for j in range(LINE_ROWS + 1)])

    def off(weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rest = np.where(known, whole - combined(twice, weights), 0.0)
        return rest, np.abs(rest) > JUMP_SIGMAS / MEDIAN_OF_NORMAL * np.median(np.abs(rest[known]))

    plain = np.append(1.0, np.full(LINE_ROWS, 2.0)) / (1.0 + 2.0 * LINE_ROWS)
    steady = known & ~off(plain)[1]
    weights = least_squares(twice[steady], x[steady])
    rest, jumps = off(weights)
    line = combined(np.column_stack([of(j) for j in range(LINE_ROWS + 1)]), weights)
    return np.where(jumps, whole, line), rest, jumps
