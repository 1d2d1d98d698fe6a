"""Define `Fault`, the record of one sort of bad data in a log."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Fault:
    """One sort of bad data in one column or between columns.

    kind     of rows: stamps, wrapped, turned, range, stale, dropout, spike; of the whole log: order and origin (of t),
             unit, sign, swapped, motion (theta_dot is not the slope of theta), scale (it is a multiple of it)
    channel  the column at fault; None: several, or the rows themselves
    t_start, t_end  [s] first and last place, as stamped; NaN if the stamp itself is no number
    rows     how many rows it spoils; 0: none, it was mended
    message  one line: what, where, how many rows, the likely repair
    """

    kind: str
    channel: str | None
    t_start: float
    t_end: float
    rows: int
    message: str
