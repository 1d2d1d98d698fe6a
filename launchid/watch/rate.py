"""The sample period, as the rows that come say it."""

from collections.abc import Iterator

import numpy as np

from ..log.live import part
from ..log.log import Log, log_of

PERIOD_ROWS = 64  # whose median step is the sample period


class Rate:
    """The sample period of rows that come, by PERIOD_ROWS.  What the estimator would reject for its stamp, theta or
    beta says nothing of the rate."""

    def __init__(self, path: str) -> None:
        self._path, self._t = path, list[float]()

    def parts(self, log: Log) -> Iterator[tuple[Log, float | None]]:
        """The log cut behind each row that completes so many, with the median step [s] between their stamps there; None
        at its end, and where all stamps are one."""
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
        """The same of fewer rows, when no more come; InputError if they do not say it."""
        nothing = np.zeros(len(self._t))
        return log_of({"t": self._t, "theta": nothing, "beta": nothing}, self._path).period
