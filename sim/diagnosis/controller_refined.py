"""The controller of a log slower than it, by everything that log tells: also nozzle and vehicle answer the commands
between the rows.

What `controller_gaps` leaves open of gains and filter (some tenths of a per cent, and along a line on which a shorter
filter is a higher derivative gain some per cent) would make the commands between the rows wrong all along the log, and
pass for an actuator that is.  So the equation of the gaps and the innovations of the nominal on the commands so filled
are fitted together, a6 and k1 free within their tolerance (Gauss-Newton).
"""

import math
from dataclasses import replace

import numpy as np

from .controller_gaps import LATEST, Backwards, Gaps, Seen, gaps_of, with_numbers
from .controller_kind import ControllerCheck
from .controller_numbers import newton, simplest
from .fill import Controller, filled, on_board
from .fit import Problem
from .model import DEVIATIONS, Point
from .noise import Filter
from .record import Record

ITERATIONS = 3
CLEARLY = 8.0          # nats that gains and filter together must bring: here they are told apart (by 90 and more)


def refined(record: Record, seen: Seen, found: ControllerCheck, of: Filter) -> tuple[ControllerCheck, Controller]:
    """(What was found, with all the log's word; the controller whose commands are the likeliest between the rows).

    record  with commands filled as found;  of  the nominal's filter at the declared noise
    """
    own = on_board(record)
    period, late = own.period, found.late(own.period)
    others = (late - 2, late + 2) if (late + own.late) % 2 and record.every == 2 * record.tick else ()
    tries = [_fitted(record, seen, replace(found, delay=each * period), of)
             for each in (late, *others) if 0 <= each <= LATEST]
    return min(tries, key=lambda tried: tried[0])[1:]


def _fitted(record: Record, seen: Seen, found: ControllerCheck,
            of: Filter) -> tuple[float, ControllerCheck, Controller]:
    """(cost [nats], what was found, the likeliest controller) for one computing time."""
    gaps = gaps_of(record, seen, found.late(on_board(record).period))
    if gaps.tau == 0.0:
        return 0.0, found, Controller(found.kp_scale, found.kd_scale, 0.0, gaps.late)
    tau = gaps.tau if found.time_constant is None else found.time_constant
    x = np.array([found.kp_scale, found.kd_scale, math.log(tau / gaps.tau)])
    evidence = _Evidence(record, seen, gaps, of, x)
    x, information = newton(evidence.residual, x, ITERATIONS)
    r = evidence.residual(x)
    cost = 0.5 * float(r @ r) + record.rows * math.log(evidence.noise)
    return cost, with_numbers(found, gaps, x, information, CLEARLY), _controller(simplest(x, information, 0.0).x, gaps)


def _controller(x: np.ndarray, gaps: Gaps | Backwards) -> Controller:
    return Controller(float(x[0]), float(x[1]), gaps.tau * math.exp(float(x[2])), gaps.late)


class _Evidence:
    """The residual of both, each in its standard deviation."""

    def __init__(self, record: Record, seen: Seen, gaps: Gaps | Backwards, of: Filter, x: np.ndarray) -> None:
        self.record, self.seen, self.gaps, self.filter = record, seen, gaps, of
        self.noise = float(np.sqrt(np.mean(gaps.rest(x)**2)))
        problem = self._problem(x)
        slopes = problem.slopes((), np.zeros(DEVIATIONS), problem.residual(Point()))
        self.basis = np.linalg.qr(slopes)[0]

    def _problem(self, x: np.ndarray) -> Problem:
        return Problem(filled(self.record, self.seen.attitude, _controller(x, self.gaps)), self.filter)

    def residual(self, x: np.ndarray) -> np.ndarray:
        """(gaps + 3 rows + 4,) at kp and kd over the nominal's and the logarithm of tau over the nominal's."""
        white = self._problem(x).residual(Point())
        white -= self.basis @ (self.basis.T @ white)
        return np.concatenate([self.gaps.rest(x) / self.noise, white])
