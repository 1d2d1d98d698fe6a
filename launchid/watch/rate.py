"""Tell the sample period from rows as they come."""

from collections.abc import Iterator

import numpy as np

from ..log.live import part
from ..log.log import Log, log_of

PERIOD_ROWS = 64  # whose median step is the sample period


class Rate:
    """Sample period [s] as the median step of each PERIOD_ROWS rows that come; rows whose t, theta or beta the
    estimator would reject are not counted."""

    def __init__(self, path: str) -> None:
        self._path, self._t = path, list[float]()

    def parts(self, log: Log) -> Iterator[tuple[Log, float | None]]:
        """Yield (part of the log, period [s]); a part ends where PERIOD_ROWS rows are complete, the last one may have
        fewer: its period is None, as that of equal stamps."""
        sound = log.in_range("t") & np.isfinite(log.theta) & np.isfinite(log.beta)
        begin = 0
        for row in np.flatnonzero(sound).tolist():
            self._t.append(float(log.t[row]))
            if len(self._t) == PERIOD_ROWS:
                steps = np.diff(np.unique(self._t))  # in order: what stands among them backward takes one
                self._t.clear()
                yield part(log, begin, row + 1), float(np.median(steps)) if len(steps) else None
                begin = row + 1
        if begin < len(log.t):
            yield part(log, begin, len(log.t)), None

    def of_few(self) -> float:
        """Return the period [s] of the rows since the last complete PERIOD_ROWS; InputError if they are too few."""
        nothing = np.zeros(len(self._t))
        return log_of({"t": self._t, "theta": nothing, "beta": nothing}, self._path).period
