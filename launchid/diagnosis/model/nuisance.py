"""The numbers that may be off without being wrong: a6 and k1 within their tolerance, the servo's timing; and the
residuals at any numbers.

    minimise  1/2 |L^-1 e(p)|^2 + 1/2 |deviations/prior|^2

(prediction-error method: Ljung, System Identification, 2nd ed., ch. 7 and 10).  L, the factor of the innovations'
covariance, and the Kalman gains are those of one filter (`noise`).
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..data.record import Record
from .noise import Filter
from .point import DEVIATIONS, Point, innovations

DRIFT = 0.25           # of the tolerance, one sigma: what a deviation of a6 or k1 may change from the middle to an end
LARGEST_DEVIATION = (0.9, 0.9, 0.9, 0.9, 0.02)  # of a6 and k1: the sign is the nominal's; s of the timing
DEVIATION_STEPS = (1e-3, 1e-3, 1e-3, 1e-3, 2e-4)  # of numerical slopes
REACH = 2.0            # standard deviations of a deviation that a model may have when its predictions are judged
WORST_WHITE = 1.0e4    # whitened innovations beyond it are cut, so that sums stay finite

Cut = Callable[[np.ndarray], tuple[np.ndarray, Point]]


class Problem:
    """A log under one filter: residuals (whitened innovations, then the prior's) at any values.

    mask  (n,) bool, rows that count; None: all
    """

    def __init__(self, record: Record, of: Filter, mask: np.ndarray | None = None) -> None:
        self.record, self.filter, self.mask = record, of, mask
        own = record.nominal.diagnosis
        self.prior = np.append(max(own.tolerance, 1e-6) * np.array([1.0, 1.0, DRIFT, DRIFT]), max(own.timing, 1e-9))

    def white(self, point: Point) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
        """(whitened (n, 3), innovations, states, stayed with the log)."""
        self.record.work.count(self.record.rows * self.record.every // self.record.at_once)
        e, states, stayed = innovations(self.record, self.filter, point)
        white = self.filter.whiten(e)
        stayed = stayed and bool(np.all(np.isfinite(white)))
        if not stayed:
            white[:] = WORST_WHITE
        np.clip(white, -WORST_WHITE, WORST_WHITE, out=white)
        return self.counted(white), e, states, stayed

    def within_reach(self, point: Point) -> Point:
        """The point with deviations that the tolerance allows: a nominal that needs more is another model."""
        most = REACH * self.prior
        return replace(point, deviations=tuple(np.clip(point.deviations, -most, most).tolist()))

    def counted(self, white: np.ndarray) -> np.ndarray:
        """The same array (n, 3) with rows that do not count set to 0."""
        if self.mask is not None:
            white[~self.mask] = 0.0
        return white

    def residual(self, point: Point) -> np.ndarray:
        """The residual (3n + 5,): whitened innovations, and deviations over their prior."""
        return np.concatenate([self.white(point)[0].ravel(), np.array(point.deviations) / self.prior])

    def deviation_slopes(self) -> np.ndarray:
        """The slopes (3n + 5, 5) of the residual at the nominal."""
        def cut(x: np.ndarray) -> tuple[np.ndarray, Point]:
            within = within_sign(x)
            return within, Point((), tuple(float(d) for d in within))

        r = self.residual(Point())
        jacobian = np.zeros((len(r), DEVIATIONS))
        self.fill_slopes(np.zeros(DEVIATIONS), np.array(DEVIATION_STEPS), r, cut, jacobian)
        return jacobian

    def fill_slopes(self, x: np.ndarray, steps: np.ndarray, r: np.ndarray, cut: Cut, jacobian: np.ndarray) -> None:
        """The first len(steps) columns of jacobian (3n + 5, k) inout: forward differences of the residual, which is r
        at the numbers x (k,), turned where a range ends.

        cut  numbers -> what their ranges leave of them, and the point there
        """
        for k, step in enumerate(steps):
            moved = x.copy()
            for signed in (step, -step):
                moved[k] = x[k] + signed
                within, point = cut(moved)
                if abs(within[k] - x[k]) > 0.5 * step:
                    jacobian[:, k] = (self.residual(point) - r) / signed
                    break


def within_sign(deviations: np.ndarray) -> np.ndarray:
    """Deviations (5,) that keep the signs of a6 and k1."""
    return np.clip(deviations, np.negative(LARGEST_DEVIATION), LARGEST_DEVIATION)
