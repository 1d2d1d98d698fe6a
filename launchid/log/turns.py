"""Make attitudes continuous that a logger kept within one turn, and that jump by a whole turn where it took one off.

Only an angle that lies within one turn is changed: raw counts, degrees read as radians and markers of missing data stay
as they are, for the data check to find.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from .fault import Fault
from .log import Log

SEAM = 0.5   # rad, from half a turn: no vehicle turns by more between two rows
TURNING_COLUMNS = ("theta", "theta_ref")
TURN = 2.0 * math.pi
FIRST_ATTITUDES = 5  # rows whose median is where an attitude starts
MOST_TURNS = 3.0  # turns: an attitude that starts farther is none in radians


def continuous(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (angle x (n,) [rad] with its whole turns put back, rows (k,) just behind a jump by a turn).

    A jump is from one end of a turn to the other, both within SEAM of it; NaN are passed over.
    """
    rows = np.flatnonzero(np.isfinite(x))
    seen = x[rows]
    if len(seen) < 2 or np.ptp(seen) > TURN * (1.0 + 1e-3):
        return x, rows[:0]
    middle = 0.0 if np.min(seen) < -SEAM else math.pi  # of -pi to pi, or of 0 to 2 pi
    off = seen - middle
    near = np.abs(np.abs(off) - math.pi) < SEAM
    jump = near[:-1] & near[1:] & (off[:-1] * off[1:] < 0.0)
    if not jump.any():
        return x, rows[:0]
    turns = np.concatenate([[0.0], np.cumsum(np.where(jump, np.sign(off[:-1]), 0.0))])
    whole = x.copy()
    whole[rows] += TURN * turns
    return whole, rows[1:][jump]


def unwrapped(log: Log) -> tuple[Log, tuple[Fault, ...]]:
    """Return (the log with whole turns put back in theta and theta_ref, a Fault for each thing done).

    If theta starts beyond half a turn, its whole turns are taken off theta and theta_ref.
    """
    found, columns = list[Fault](), dict[str, Any]()
    for name in TURNING_COLUMNS:
        columns[name], rows = continuous(getattr(log, name))
        if len(rows):
            at = log.t[rows]
            found.append(Fault("wrapped", name, float(at[0]), float(at[-1]), 0,
                               f"{name} jumps across +-pi {len(at)} times, first at {at[0]:.6g} s: the whole turns are "
                               "put back"))
    theta = columns["theta"][np.isfinite(columns["theta"])]
    first = float(np.median(theta[:FIRST_ATTITUDES])) if len(theta) else 0.0
    if turns := round(first / TURN) if abs(first) < MOST_TURNS * TURN and abs(first) > math.pi + SEAM else 0:
        columns = {name: x - TURN * turns for name, x in columns.items()}
        found.append(Fault("turned", "theta", float(log.t[0]), float(log.t[-1]), 0,
                           f"theta starts at {first:.4g} rad: {turns} whole turn{'s' * (abs(turns) != 1)} taken out"))
    return (replace(log, **columns) if found else log), tuple(found)
