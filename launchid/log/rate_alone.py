"""Give a log of rates alone an attitude, where no term of the equation needs one.

The weak form takes the motion from theta_dot where that is measured.  theta stands then in the terms alone: of a
vehicle whose terms have none (a motor, a wheel, a multirotor's rate) it is only needed to be finite.  What is given
is the rate's own integral, less what is slower than FADES, so that a shaft that turns on stays an angle.
"""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from ..series import filled
from .check import CheckedLog
from .log import Log
from .table import DRIVEN, places

FADES = 1.0   # s


def has_attitude(log: Log) -> bool:
    """Whether a log has a column theta."""
    return "theta" in log.columns


def with_attitude(seen: CheckedLog, terms: Collection[str]) -> tuple[CheckedLog, tuple[str, ...]]:
    """Return (the checked log with an attitude, a note on it), of a log of rates alone; any other log as it is.

    terms   of the equation; InputError if one of them needs theta
    """
    log = seen.log
    if has_attitude(log):
        return seen, ()
    if any("theta" in term.replace("theta_dot", "") for term in terms):
        places(log.path, list(log.columns), DRIVEN)   # raises
    t = np.isfinite(log.t) & np.isfinite(log.theta_dot)
    rate, step = filled(np.where(t, log.theta_dot, np.nan), log.t), np.diff(log.t, prepend=log.t[:1])
    theta = np.zeros(len(log.t))
    kept = np.exp(-np.clip(np.where(np.isfinite(step), step, 0.0), 0.0, None) / FADES)
    for k in range(1, len(theta)):
        theta[k] = kept[k] * theta[k - 1] + (1.0 - kept[k]) * FADES * 0.5 * (rate[k] + rate[k - 1])
    columns = (log.columns[0], "theta", *log.columns[1:])
    return replace(seen, log=replace(log, theta=np.where(t, theta, np.nan), columns=columns)), (
        f"{log.path}: no column theta: no term needs it, and the rate alone is fitted",)
