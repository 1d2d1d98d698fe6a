"""The controller of a log slower than it, by everything that log tells: also nozzle and vehicle answer the commands
between the rows.

What `controller_gaps` leaves open of gains and filter (some tenths of a per cent, and along a line on which a shorter
filter is a higher derivative gain some per cent) would make the commands between the rows wrong all along the log, and
pass for an actuator that is.  So the equation of the gaps and the innovations of the nominal on the commands so filled
are fitted together, a6 and k1 free within their tolerance (Gauss-Newton).
"""

import math
from dataclasses import replace
from typing import Protocol

import numpy as np

from ...sums import along, combined, orthonormal, square
from ..data.record import BETA, Record
from .fill import Controller, as_believed, filled, on_board
from .gaps import EXPLAINS, LATEST, Backwards, Gaps, Seen, gaps_of, is_noise, rms, with_numbers
from .kind import NONE, UNKNOWN, ControllerCheck
from .numbers import NEUTRAL, newton, simplest

REFINING_STEPS = 3
CONFIRMED = 300.0      # nats that the nozzle must have for another controller: it sees every command's answer
UNCONFIRMED = 150.0    # nats of the gaps that do without a nozzle sensor
GAINS_AND_FILTER = 8.0  # nats that both together must bring: here they are told apart


class Vehicle(Protocol):
    """The vehicle that answers a record's commands, as the nominal has it, at noise levels of its own: a model, handed
    in by who has one."""

    def residual(self, record: Record) -> np.ndarray:
        """(3 rows + k,) whitened innovations, then what is expected of the k numbers that may be off (zeros)."""

    def slopes(self, record: Record) -> np.ndarray:
        """(3 rows + k, k) of it over these numbers."""


def refined(record: Record, seen: Seen, found: ControllerCheck, of: Vehicle) -> tuple[ControllerCheck, Controller]:
    """(What was found, with all the log's word; the controller whose commands are the likeliest between the rows).  A
    mismatch that the nozzle does not confirm is none: the errors were predicted by a sensor that is wrong.

    record  with commands filled as found;  of  the nominal's vehicle at the declared noise
    """
    own = on_board(record)
    period, late = own.period, found.late(own.period)
    others = (late - 2, late + 2) if (late + own.late) % 2 and record.every == 2 * record.tick else ()
    tries = [_fitted(record, seen, replace(found, delay=each * period), of)
             for each in (late, *others) if 0 <= each <= LATEST]
    _, confirmed, check, likeliest = min(tries, key=lambda tried: tried[0])
    if confirmed > CONFIRMED or check.kind == UNKNOWN:
        return check, likeliest
    gaps = gaps_of(record, seen, 0)
    kind = NONE if is_noise(record, gaps, gaps.rest(NEUTRAL)) else UNKNOWN
    return ControllerCheck(kind, check.before, check.before, evidence=check.evidence), as_believed(record)


def _fitted(record: Record, seen: Seen, found: ControllerCheck,
            of: Vehicle) -> tuple[float, float, ControllerCheck, Controller]:
    """The fit for one computing time: cost, what the nozzle has for it over the nominal's controller (both [nats]),
    what was found, and the likeliest controller."""
    gaps = gaps_of(record, seen, found.late(on_board(record).period))
    if gaps.tau == 0.0:
        return 0.0, math.inf, found, Controller(found.kp_scale, found.kd_scale, 0.0, gaps.late)
    tau = gaps.tau if found.time_constant is None else found.time_constant
    x = np.array([found.kp_scale, found.kd_scale, math.log(tau / gaps.tau)])
    evidence = _Evidence(record, seen, gaps, of, x)
    x, information = newton(evidence.residual, x, REFINING_STEPS)
    r = evidence.residual(x)
    cost = 0.5 * square(r) + record.rows * math.log(evidence.noise)
    confirmed = evidence.of_nozzle(as_believed(record)) - evidence.of_nozzle(_controller(x, gaps))
    if not np.isfinite(record.z[:, BETA]).any():
        confirmed = math.inf if found.evidence > UNCONFIRMED else -math.inf
    if not is_noise(record, gaps, gaps.rest(x), EXPLAINS):
        found = replace(found, kind=UNKNOWN)
    named = found if found.kind == UNKNOWN else with_numbers(found, gaps, x, information, GAINS_AND_FILTER)
    return cost, confirmed, named, _controller(simplest(x, information, 0.0).x, gaps)


def _controller(x: np.ndarray, gaps: Gaps | Backwards) -> Controller:
    return Controller(float(x[0]), float(x[1]), gaps.tau * math.exp(float(x[2])), gaps.late)


class _Evidence:
    """The residual of both, each in its standard deviation."""

    def __init__(self, record: Record, seen: Seen, gaps: Gaps | Backwards, of: Vehicle, x: np.ndarray) -> None:
        self.record, self.seen, self.gaps, self.vehicle = record, seen, gaps, of
        self.noise = rms(gaps.rest(x))
        self.basis = orthonormal(of.slopes(self._filled(_controller(x, gaps))))[0]

    def _filled(self, of: Controller) -> Record:
        return filled(self.record, self.seen.attitude, of)

    def innovations(self, of: Controller) -> np.ndarray:
        """(3 rows + 4,) whitened, a6 and k1 free within their tolerance, on the commands of this controller."""
        white = self.vehicle.residual(self._filled(of))
        return white - combined(self.basis, along(self.basis, white))

    def of_nozzle(self, of: Controller) -> float:
        """The evidence [nats] against these commands by the nozzle alone: a fault of another sensor does not move
        it."""
        rows = self.innovations(of)[:3 * self.record.rows].reshape(-1, 3)
        return 0.5 * square(rows[:, BETA])

    def residual(self, x: np.ndarray) -> np.ndarray:
        """The residual (gaps + 3 rows + 4,) at kp and kd over the nominal's and the logarithm of tau over the
        nominal's."""
        return np.concatenate([self.gaps.rest(x) / self.noise, self.innovations(_controller(x, self.gaps))])
