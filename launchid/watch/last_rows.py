"""Run the data check on the last rows of a stream: it finds what only many rows show (units, signs, stamps)."""

import math

import numpy as np

from sim.errors import InputError
from sim.nominal import Nominal

from ..log.check import checked
from ..log.cut import Cut
from ..log.live import part, rows_of
from ..log.log import REQUIRED, Log, log_of
from ..log.phases import HELD, MOVES, flown_phase, phases_of

CHECKED = 10.0         # s of the log: by then a reversed sign shows, too; the check takes some 15 ms
MOST_CHECKED = 20_000  # rows
MOST_PIECES = 256      # that are kept one by one


class LastRows:
    """The last rows of a stream, MOST_CHECKED at most, and the data check of them, which runs at the end of the first
    window, at CHECKED [s] of rows at the latest, again whenever the rows have doubled, and then whenever half of them
    are new: rest shows no reversed sign.

    is_asked  whether the check has run;  foreign: text naming columns that hold another quantity, "" if none do
    pad_until [s] the pad held the vehicle so far, -inf if it did not;  flown_until [s]: from then on beta moves nothing
    """

    def __init__(self, path: str, window: float) -> None:
        self._path, self._first = path, min(CHECKED, window)
        self._said: set[tuple[str, str | None]] = set()
        self._begin(())

    def _begin(self, columns: tuple[str, ...]) -> None:
        """Forget all rows: nothing is known of these columns."""
        self._columns, self._logs, self._asked_at = columns, list[Log](), 0
        self.count = 0  # rows that are kept
        self.is_asked, self.foreign, self._was_foreign = False, "", ""
        self.pad_until, self.flown_until = -math.inf, math.inf

    def add(self, log: Log) -> None:
        """Keep further rows for the check.

        Rows under another header replace all before them.  Once MOST_CHECKED are kept, further ones are left out.
        """
        if self._columns != log.columns:
            self._begin(log.columns)
        if self.count >= MOST_CHECKED:
            return
        self._logs.append(log)
        self.count += len(log.t)
        if len(self._logs) > MOST_PIECES:
            self._logs = [rows_of(*self._logs)]

    def after(self, t: float) -> list[Log]:
        """Return the kept rows behind t [s]."""
        rows = rows_of(*self._logs)
        return [part(rows, int(np.argmax(rows.t > t)), len(rows.t))]

    def checked(self, nominal: Nominal, period: float, ended: bool) -> str:
        """Run the data check if it is due or `ended` (no more rows come); return one line of new findings, else ""."""
        is_due = self.count >= min(max(self._first / period, 2 * self._asked_at), MOST_CHECKED) or ended
        if not is_due or (self.is_asked and self.count <= self._asked_at):
            return ""
        self.is_asked, self._asked_at = True, self.count
        try:
            log = log_of(rows_of(*self._logs).measured() if self._logs else dict.fromkeys(REQUIRED, ()), self._path)
            seen = checked(log, nominal)
            phases = phases_of(seen.log, seen.data)
            self.pad_until = max([self.pad_until, *(each.last for each in phases if each.kind == HELD)])
            self.flown_until = next((each.first for each in phases if each.kind not in (HELD, MOVES)), math.inf)
            if flown := flown_phase(phases):   # what no flight shows, as a parachute, is no reason against a flight
                seen = checked(Cut(flown.first, flown.last, True).of(log), nominal)
            self.foreign = seen.foreign or self._was_foreign
            found = (*seen.faults, *(seen.sensed.faults if seen.sensed is not None else ()))
            words = "; ".join(fault.message for fault in found if (fault.kind, fault.channel) not in self._said)
            self._said |= {(fault.kind, fault.channel) for fault in found}
        except InputError as error:
            words = self.foreign = str(error)
        if self.count >= MOST_CHECKED:
            rows = rows_of(*self._logs)
            self._logs, self.count = [part(rows, len(rows.t) - MOST_CHECKED // 2, len(rows.t))], MOST_CHECKED // 2
            self._asked_at, self._was_foreign = self.count, self.foreign
        return f"{self._path}: the data check of the last rows: {words}" if words else ""
