"""Check a log while it is recorded: each row by the rows before it and a few behind it, with the code of `detect`.

Not found, since only a whole log shows it: what a column holds (unit, sign, another device); stamps on a coarse grid; a
theta logged within one turn (the estimator undoes that by itself); a slower channel in its first rows; an end stop in
its first rows (the ends of all rows so far are kept); a sensor that is still frozen after CONTEXT rows.
"""

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np

from .channels import LARGEST_ANGLE, ROWS_NEXT_TO
from .check import measured
from .detect import check
from .log import Log
from .stops import SENSED, Ends, ends_of

CONTEXT = 300      # rows before a row, by which it is judged
BEHIND = ROWS_NEXT_TO + 3  # rows behind it: a spike shows by these
SAME_MOMENT = 0.5  # s of rows that are judged at once: a page is late by as much


class LiveCheck:
    """Takes new rows by `add` and gives them back a little later, NaN where the data check finds a bad value.

    What comes out depends on the rows alone, not on the pieces they come in, if `rest` is called at their end only.

    period  [s] of the rows
    """

    def __init__(self, period: float) -> None:
        self._block = max(1, round(SAME_MOMENT / period))
        self._kept: Log | None = None
        self._judged = 0   # of the kept rows: these are context
        self._ends: dict[str, Ends] = {}   # of the rows so far

    def add(self, log: Log) -> Iterator[Log]:
        """Yield checked rows that can be judged now that those of `log` came; other columns begin a new log."""
        if self._kept is not None and self._kept.columns != log.columns:   # another header: another log
            yield from self.rest()
            self._kept, self._judged, self._ends = None, 0, {}
        self._kept = log if self._kept is None else rows_of(self._kept, log)
        while len(self._kept.t) - self._judged >= self._block + BEHIND:
            yield self._out(self._judged + self._block, BEHIND)

    def rest(self) -> Iterator[Log]:
        """Yield the checked rows not given back yet; to be called when no rows come any more, or none for a while."""
        if self._kept is not None and len(self._kept.t) > self._judged:
            yield self._out(len(self._kept.t), 0)

    def _out(self, end: int, behind: int) -> Log:
        """Return the kept rows from the first one not judged to `end`, checked with `behind` rows behind them."""
        assert self._kept is not None
        seen = part(self._kept, 0, end + behind)
        new = part(seen, self._judged, end)
        for name in SENSED:
            x = getattr(new, name)
            self._ends[name] = ends_of(x[np.abs(x) <= LARGEST_ANGLE], self._ends.get(name))
        out = part(measured(seen, check(seen, None, self._ends)), self._judged, end)
        begin = max(0, end - CONTEXT)
        self._kept, self._judged = part(self._kept, begin, len(self._kept.t)), end - begin
        return out


def part(log: Log, begin: int, end: int) -> Log:
    """Return a log of the rows begin .. end - 1."""
    arrays: dict[str, Any] = {name: x[begin:end] for name, x in vars(log).items() if isinstance(x, np.ndarray)}
    return dataclasses.replace(log, **arrays)


def rows_of(*logs: Log) -> Log:
    """Return one log with the rows of several logs of the same columns, one after the other."""
    arrays: dict[str, Any] = {name: np.concatenate([getattr(log, name) for log in logs])
                              for name, x in vars(logs[0]).items() if isinstance(x, np.ndarray)}
    return dataclasses.replace(logs[0], **arrays)
