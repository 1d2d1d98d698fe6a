"""Attitudes that were logged within one turn: a jump across +-pi is a whole turn that the logger took off.

The rule is the on-board estimator's: two measured values in a row of opposite sign, both near half a turn.
"""

import math
from dataclasses import replace

import numpy as np

from .fault import Fault
from .log import Log

SEAM = 0.5   # rad, from half a turn: no vehicle turns by more between two rows
ANGLES = ("theta", "theta_ref")


def unwrapped(log: Log) -> tuple[Log, tuple[Fault, ...]]:
    """The log with its whole turns put back, and what was done, one for each angle."""
    found, columns = [], {}
    for name in ANGLES:
        x = getattr(log, name)
        rows = np.flatnonzero(np.isfinite(x))
        seen = x[rows]
        near = np.abs(np.abs(seen) - math.pi) < SEAM
        jump = near[:-1] & near[1:] & (seen[:-1] * seen[1:] < 0.0)
        if not jump.any():
            continue
        turns = np.concatenate([[0.0], np.cumsum(np.where(jump, np.sign(seen[:-1]), 0.0))])
        columns[name] = x.copy()
        columns[name][rows] += 2.0 * math.pi * turns
        at = log.t[rows[1:][jump]]
        found.append(Fault("wrapped", name, float(at[0]), float(at[-1]), 0,
                           f"{name} jumps across +-pi {len(at)} times, first at {at[0]:.6g} s: the whole turns are put "
                           "back"))
    return (replace(log, **columns) if columns else log), tuple(found)
