"""The data check of a source's first rows."""

import numpy as np

from sim.errors import InputError
from sim.nominal import Nominal

from ..log.check import faults
from ..log.log import Log, log_of

CHECKED = 10.0         # s of the log: by then a reversed sign shows, too; the check takes some 15 ms
MOST_CHECKED = 20_000  # rows


class FirstRows:
    """The first rows, kept until there are enough of them for the check."""

    def __init__(self, path: str) -> None:
        self._path, self._logs, self._done = path, list[Log](), False
        self.count = 0  # rows that are kept

    def add(self, log: Log) -> None:
        """Rows that came.  Those before another header are not kept."""
        if self._done or self.count >= MOST_CHECKED:
            return
        if self._logs and log.columns != self._logs[0].columns:
            self._logs, self.count = [], 0
        self._logs.append(log)
        self.count += len(log.t)

    def _together(self) -> Log:
        """The rows so far as one log; InputError if no row of it can be used."""
        columns = self._logs[0].columns if self._logs else ("t", "theta", "beta")
        return log_of({name: np.concatenate([np.empty(0), *(getattr(log, name) for log in self._logs)])
                       for name in columns}, self._path)

    def checked(self, nominal: Nominal, period: float, ended: bool) -> str:
        """Return the data check's finding, once: when rows suffice or no more come.  Else ''."""
        if self._done or (self.count < min(CHECKED / period, MOST_CHECKED) and not ended):
            return ""
        try:
            words = "; ".join(fault.message for fault in faults(self._together(), nominal))
        except InputError as error:
            words = str(error)
        self._done, self._logs, self.count = True, [], 0
        return f"{self._path}: the data check of the first rows: {words}" if words else ""
