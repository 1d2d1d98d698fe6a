"""The data check of a source's first rows."""

from sim.errors import InputError
from sim.nominal import Nominal

from ..log.check import faults
from ..log.live import rows_of
from ..log.log import REQUIRED, Log, log_of

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

    def checked(self, nominal: Nominal, period: float, ended: bool) -> str:
        """Return the data check's finding, once: when rows suffice or no more come.  Else ''."""
        if self._done or (self.count < min(CHECKED / period, MOST_CHECKED) and not ended):
            return ""
        try:
            rows = log_of(rows_of(*self._logs).measured() if self._logs else dict.fromkeys(REQUIRED, ()), self._path)
            words = "; ".join(fault.message for fault in faults(rows, nominal))
        except InputError as error:
            words = str(error)
        self._done, self._logs, self.count = True, [], 0
        return f"{self._path}: the data check of the first rows: {words}" if words else ""
