"""Commands between the rows of a slow log without a reference.

The controller is linear: its command is what it makes of the attitude that it measured, F(theta), less what it makes of
the reference.  The log has the second at its rows, as F(theta) of the measured attitude less the command, and it lies
on a line between them; the first is made of the attitude that a model predicts there.

What the controller made of the noise between the rows is then not in the commands between them, but a part of it is
remembered in the rows': an error that goes with the input, which no noise of a filter is.  So a cause must explain more
of such a log than that can feign (`unsure`).
"""

from dataclasses import replace

import numpy as np

from ..data.record import Record
from .command import off_by, recomputed, without_limit
from .fill import on_board
from .kind import FEWEST, NEAR_LIMIT

# Nats a row that unknown commands feign with one tick between rows, nozzle and gyro measured: 1.7 times the most that
# any cause or disturbance found in clean flights of the three nominals at 50 and 25 Hz (seeds 9716 to 9723)
LINES = 0.008          # where what was asked is on lines
RECOMPUTED = 0.004     # where all commands are made of the attitude, with the reference
WITHOUT_NOZZLE = 2.5   # times as many: nothing tells what became of a command
WITHOUT_RATE = 10.0    # times as many: the attitude between rows is hardly known


def unsure(record: Record, of: float, ticks: float | None = None) -> float:
    """[nats] a row that commands may feign of which so many (LINES, RECOMPUTED) are with one tick between rows; they go
    with the square of the ticks (None: those of the grid)."""
    more = (1.0 if "beta" in record.channels else WITHOUT_NOZZLE) * \
        (1.0 if "theta_dot" in record.channels else WITHOUT_RATE)
    return of * more * ((record.every // record.tick - 1)**2 if ticks is None else ticks)


def asked(record: Record, attitude: np.ndarray) -> Record:
    """The record with the commands that its controller issued between its rows, and how far they are off.

    attitude  (ticks,) [rad] predicted
    """
    m, limit = record.every // record.tick, on_board(record).limit
    rows = record.commands[::m]
    free = np.abs(rows) < NEAR_LIMIT * limit
    if record.logged is not None:
        free &= record.logged
    made = replace(record, fill_gain=of_noise(record), unsure=unsure(record, LINES))
    if np.count_nonzero(free) < FEWEST:
        return made
    answer = recomputed(without_limit(replace(record, reference=np.zeros(record.rows))), attitude)
    asks, ticks = answer[::m] - rows, np.arange(len(answer))
    commands = np.clip(answer - np.interp(ticks, ticks[::m][free], asks[free]), -limit, limit)
    commands[::m] = rows
    off = off_by(np.where(free, asks, np.nan), np.arange(record.rows) == 1, record.every * record.step)
    return replace(made, commands=commands, between=off)


def of_noise(record: Record) -> float:
    """Command [rad] at once per attitude noise [rad]."""
    own = on_board(record)
    return abs(own.kp + own.kd / (own.tau + own.period))
