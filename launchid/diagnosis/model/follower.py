"""The nominal as it follows a log: what the room of the controller needs of a model and is handed."""

import numpy as np

from ...sums import least_squares
from ..controller.gaps import Seen
from ..data.record import ESCAPED, THETA, Record
from .noise import declared, first_filter
from .nuisance import Problem
from .point import Point, innovations, predicted_attitude

ALERT = np.array([1.0, 1.0, 1.0, 1.0, 30.0])  # levels between rows: the plant may be wrong, follow the sensors
SLOW = 2       # powers of time in what a biased gyro takes the attitude off
FEWEST = 20    # rows that tell them


def lost(record: Record) -> str:
    """The reason why there is no likelihood of this log, in words; "" where there is one.  The nominal, at its declared
    noise, runs away from the log or predicts what is no number: what causes gained over that would be no evidence."""
    filt = first_filter(record, declared(record))
    _, _, states, stayed = Problem(record, filt).white(Point())
    if stayed:
        return ""
    gone = np.flatnonzero(~np.isfinite(states[:, THETA]))
    since = f"from {record.t[gone[0]] + record.shift:.6g} s on" if len(gone) else "somewhere"
    return f"{since} the nominal's simulation is off by more than {ESCAPED:g} rad, or no number, although every row " \
           "corrects it"


class NominalFollower:
    """The nominal without causes (`controller.issued.Follower`)."""

    def seen(self, record: Record) -> Seen | None:
        """The predictions between the rows; None: the model does not stay with the log."""
        levels = declared(record)
        levels[:len(ALERT)] *= ALERT
        gains = first_filter(record, levels)
        seen = Seen(predicted_attitude(record, gains), innovations(record, gains, Point())[0])
        return _as_measured(record, seen) if np.all(np.abs(seen.attitude) < record.farthest) else None


def _as_measured(record: Record, seen: Seen) -> Seen:
    """The predictions with the attitude that the controller measured, where a gyro's bias takes the predicted one off
    it: less the slow part of what it differs by at the rows."""
    measured = np.isfinite(record.z[:, THETA])
    if np.count_nonzero(measured) < FEWEST:
        return seen
    ticks = record.tick * np.arange(len(seen.attitude), dtype=np.float64)
    at = record.at[measured].astype(np.float64)
    middle, half = ticks.mean(), 0.5 * max(float(np.ptp(ticks)), 1.0)
    off = record.z[measured, THETA] - np.interp(at, ticks, seen.attitude)
    slow = least_squares(np.vander((at - middle) / half, SLOW + 1), off)
    return seen._replace(attitude=seen.attitude + np.polyval(slow, (ticks - middle) / half))
