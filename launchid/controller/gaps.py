"""Logs slower than their controller: check the controller, and fill in the commands between rows where they follow.

Every logged command holds what the derivative's filter knew, so with the reference the errors that the log does not
have follow from the commands that it has: the derivative's state is known at either end of a gap
(`with_commands_between`).  The check takes them from what a model predicts.

With alpha = tau/(tau + T) and m ticks a row the commands of two rows obey

    c(k+1) - alpha^m c(k) = kp (e(k+1) - alpha^m e(k)) + kd sum alpha^(m-j) (e(j) - e(j-1))/(tau + T),

which is linear in the gains (`Gaps`).  What a predicted error is wrong by shows in part at the next row, so that row's
innovations and their means stand beside the gains (without them these are biased, most with a wrong sensor).
What is left is the noise of the attitudes that the log does not have: white, and no larger than the sensor's makes it.
Computing time is told in whole rows: of any other the commands answer errors that no row measured.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sim.flight import excitation
from sim.plant import packed

from ..log.record import Z_THETA, Z_THETA_DOT, Record
from ..series import filled
from ..sums import combined, least_squares, products
from .check import COMMAND_ROUNDING, NO_MISMATCH, UNKNOWN_LAW, ControllerCheck
from .command import in_doubt
from .replay import KI, MIN_COMMANDS, NEAR_LIMIT, constants_of, lowest, rms
from .ticks import command_noise, noise_std

SAME_PREDICTED = 0.02  # relative, of a gain and of a time constant: closer is the same
ATTITUDE_NOISE = 4.0   # times what the attitude's noise between rows makes: more is no difference of gains
EXPLAINS = 2.0         # times it, that other numbers may leave: true ones leave 0.95 to 1.2, an integral part 2.9
FREE_NUMBER = 4.0      # nats that a further free number must bring
MISMATCH_NATS = 30.0   # nats that a mismatch must gain; and gains and filter together over either
INTEGRAL = 2           # place of its gain, after kp and kd
GAINS: tuple[tuple[int, ...], ...] = ((0,), (1,), (0, 1))  # which may be free
MOST_COMPUTING_ROWS = 1  # rows of computing time tried beside the nominal's
MEANS = (8, 32)        # rows, of innovations: over longer times they would take the gains' part too
COLOURED = 0.3         # correlation from gap to gap: more is neither noise nor a sensor's fault,
CHANCE_CORRELATION = 4.0  # if it is also more than so many of its standard deviations in white noise, 1/sqrt(gaps)
NEAR_FILTERS = np.geomspace(0.2, 5.0, 41)  # of the derivative's time constant


class Seen(NamedTuple):
    """A log as a model follows it: predicted attitude (ticks,) [rad] at every tick, innovations (rows, 3)."""

    attitude: np.ndarray
    innovations: np.ndarray


class OnBoard(NamedTuple):
    """The controller with the nominal's effects on it: gains, derivative time constant and period [s], limit [rad],
    computing time in periods."""

    kp: float
    kd: float
    tau: float
    period: float
    limit: float
    late: int


def on_board(record: Record) -> OnBoard:
    """Return the nominal's controller with the nominal's effects on it."""
    kp, kd, tau, period, limit = (float(x) for x in constants_of(record.nominal)[:KI])
    return OnBoard(kp, kd, tau, period, limit, round(packed(record.nominal).computing_time / period))


def errors_seen(record: Record, attitude: np.ndarray) -> np.ndarray:
    """Return the errors (ticks,) [rad], attitude less reference: measured at rows, predicted (`attitude`) between."""
    m, n = record.every // record.tick, record.rows
    measured = np.isfinite(record.z[:, Z_THETA])
    reference = filled(record.reference, at=np.arange(n * m) / m)
    error = attitude - reference
    error[::m] = np.where(measured, record.z[:, Z_THETA], attitude[::m]) - reference[::m]
    return error


def shifted(x: np.ndarray, by: int) -> np.ndarray:
    """Return x delayed by `by` places, its first value repeated."""
    by = min(by, len(x))
    return x if by == 0 else np.concatenate([np.repeat(x[:1], by, axis=0), x[:-by]])


def test_issued(record: Record, late: int) -> np.ndarray:
    """Return the test input (ticks,) [rad] in each tick's command, `late` periods after computing; 0 before tick 0."""
    first, ticks = record.first_step // record.tick - late, len(record.commands)
    test = excitation(record.nominal, max(first + ticks, 0), on_board(record).period)
    return np.concatenate([np.zeros(max(-first, 0)), test[max(first, 0):]])[:ticks]


def _derivative(of: OnBoard, error: np.ndarray, before: np.ndarray, derivative: np.ndarray) -> np.ndarray:
    """Return the controller's pseudo-derivative (`vehicle.controller`) a period later, of arrays."""
    return np.asarray((of.tau * derivative + error - before) / (of.tau + of.period))


def with_commands_between(record: Record, attitude: np.ndarray, of: OnBoard) -> Record:
    """Return the record with this controller's commands between its rows, late by whole rows.

    With one tick between rows the commands at either end fix its error exactly; with more they correct the predicted
    ones by the least change, and noise between rows leaves the commands off.

    attitude  (ticks,) [rad] predicted
    """
    m, commands = record.every // record.tick, record.commands.copy()
    kp, kd, tau, period, limit, late = of
    error, test = shifted(errors_seen(record, attitude), late), test_issued(record, late)
    measured = shifted(np.isfinite(record.z[:, Z_THETA]), late // m)
    row = (commands[::m] - test[::m] - kp * error[::m]) / kd
    fair = (np.abs(commands[::m]) < limit) & measured & (record.logged if record.logged is not None else True)
    alpha = tau / (tau + period)
    weights = -alpha**np.arange(m - 2, -1, -1.0) * (1.0 - alpha) / (tau + period)
    arrived, gaps = row[:-1].copy(), record.rows - 1
    for j in range(1, m + 1):
        arrived = _derivative(of, error[j:gaps * m + j:m][:gaps], error[j - 1:gaps * m + j - 1:m][:gaps], arrived)
    missing = np.where(fair[:-1] & fair[1:], row[1:] - arrived, 0.0)
    for j in range(1, m):
        error[j:gaps * m:m] += weights[j - 1] / float(weights @ weights) * missing
    derivative = row
    for j in range(1, m):
        derivative = _derivative(of, error[j::m], error[j - 1::m][:len(error[j::m])], derivative)
        commands[j::m] = np.clip(kp * error[j::m] + kd * derivative + test[j::m], -limit, limit)
    made = replace(record, commands=commands, between=0.0, unsure=0.0)
    return made if m == 2 else in_doubt(made, command_noise(record), m - 1.0)


@dataclass(frozen=True, eq=False)
class Left:
    """What an explanation of the commands leaves: rest (gaps,) [rad]; gains over the nominal's (3,), their std (3,),
    filter tau [s], how many numbers were free."""

    rest: np.ndarray
    gains: np.ndarray
    std: np.ndarray
    tau: float
    numbers: int

    @property
    def rms(self) -> float:
        return max(rms(self.rest), 1e-12)   # it has a logarithm

    def over(self, other: "Left") -> float:
        """Return the evidence [nats] for this explanation over another, less FREE_NUMBER per further free number."""
        return len(self.rest) * math.log(other.rms / self.rms) - FREE_NUMBER * (self.numbers - other.numbers)


class Gaps:
    """The gaps between neighbouring rows that may be judged: both rows measured, neither command at the nozzle's limit.

    late  rows that computing takes in addition to the nominal's, with which they make whole rows
    """

    def __init__(self, record: Record, seen: Seen, late: int = 0) -> None:
        self.own = own = on_board(record)
        self.ticks = m = record.every // record.tick
        self.late = m * late
        late = self.late + own.late
        self.error = shifted(errors_seen(record, seen.attitude), late)
        issued = record.commands[::m]
        self.command = issued - test_issued(record, late)[::m]
        measured = shifted(np.isfinite(record.z[:, Z_THETA]), late // m)
        largest = np.maximum(np.abs(issued[1:]), np.abs(issued[:-1]))
        self.fair = measured[1:] & measured[:-1] & (largest < NEAR_LIMIT * own.limit)
        self.fair[:late // m + 1] = False
        if record.logged is not None:
            self.fair &= record.logged[1:] & record.logged[:-1]
        self.surprise = shifted(_surprises(seen), late // m)[1:][self.fair]
        self.noise = max(noise_std(record), COMMAND_ROUNDING)

    def relation(self, tau: float) -> tuple[np.ndarray, np.ndarray]:
        """Return both sides of the module's equation with filter tau [s]: left (gaps,) [rad], right (gaps, 3), for the
        nominal's kp, kd, and an integral gain of kp times 1/s."""
        m, e, n, period = self.ticks, self.error, len(self.command), self.own.period
        alpha = tau / (tau + period)
        steps = sum(alpha**(m - j) * (e[j:(n - 1) * m + j:m] - e[j - 1:(n - 1) * m + j - 1:m])
                    for j in range(1, m + 1)) / (tau + period)
        proportional = e[m::m] - alpha**m * e[:-m:m]
        wanted, total = self.command[1:] - alpha**m * self.command[:-1], self.own.kp * period * np.cumsum(e)
        design = [self.own.kp * proportional, self.own.kd * steps, total[m::m] - alpha**m * total[:-m:m]]
        return wanted[self.fair], np.column_stack(design)[self.fair]

    def left(self, tau: float, free: tuple[int, ...]) -> "Left":
        """Fit the free gains (0: kp, 1: kd, 2: integral), the others nominal, with filter tau [s]; return the rest."""
        wanted, design = self.relation(tau)
        fixed = [k for k in range(2) if k not in free]
        wanted = wanted - design[:, fixed].sum(axis=1)
        among = np.column_stack([design[:, list(free)], self.surprise])
        values = least_squares(among, wanted)
        rest = wanted - combined(among, values)
        gains, std = np.ones(3), np.zeros(3)
        gains[list(free)] = values[:len(free)]
        spread = np.sqrt(np.mean(rest**2) * np.diag(np.linalg.pinv(products(among, among))))
        std[list(free)] = spread[:len(free)]
        return Left(rest, gains, std, tau, len(free))

    def filtered(self, free: tuple[int, ...]) -> "Left":
        """Fit the free gains, and the filter's time constant that leaves least; return the rest."""
        def after(tau: float) -> float:
            return self.left(tau, free).rms

        taus = self.own.tau * NEAR_FILTERS
        k = int(np.argmin([after(float(tau)) for tau in taus]))
        tau = lowest(after, float(taus[max(k - 1, 0)]), float(taus[min(k + 1, len(taus) - 1)]),
                     20)  # golden sections: to 1e-4 of the bracket
        best = self.left(tau, free)
        return replace(best, numbers=best.numbers + 1)

    def is_noise(self, rest: np.ndarray, most: float = ATTITUDE_NOISE) -> bool:
        """Whether `rest` is white and its rms at most `most` times what the attitude's noise leaves in a gap."""
        own = self.own
        small = most * self.noise * own.kd * own.period / (own.tau + own.period)**2
        colour = float(np.mean(rest[1:] * rest[:-1])) / max(rms(rest), 1e-12)**2
        return rms(rest) <= small and abs(colour) <= max(COLOURED, CHANCE_CORRELATION / math.sqrt(len(rest)))

    def check(self) -> ControllerCheck:
        """Return the check with the gains, filter and computing time that explain these gaps best."""
        believed, best = self.left(self.own.tau, ()), _explained(self)
        other = abs(best.tau / self.own.tau - 1.0) > SAME_PREDICTED
        found = ControllerCheck("", believed.rms, best.rms, float(best.gains[0]), float(best.gains[1]),
                                self.late * self.own.period, (float(best.std[0]), float(best.std[1]), 0.0),
                                best.tau if other else None, best.over(believed))
        if self.late == 0 and found.evidence < MISMATCH_NATS and self.is_noise(believed.rest):
            return ControllerCheck(NO_MISMATCH, believed.rms, believed.rms)
        at_an_end = min(abs(best.tau / (self.own.tau * end) - 1.0) for end in NEAR_FILTERS[[0, -1]]) < SAME_PREDICTED
        return found.of_kind(SAME_PREDICTED, self.own.period) if self.is_noise(best.rest, EXPLAINS) and not at_an_end \
            else replace(found, kind=UNKNOWN_LAW)


def _surprises(seen: Seen) -> np.ndarray:
    """Return (rows, columns) signals of how wrong the errors predicted before each row are: its innovations, and
    their means over some time, which a wrong sensor leaves."""
    e = np.nan_to_num(seen.innovations[:, :2])
    total = np.concatenate([np.zeros((1, 2)), np.cumsum(e, axis=0)])
    rows = np.arange(1, len(e) + 1)
    means = [(total[rows] - total[np.maximum(rows - w, 0)]) / np.minimum(rows, w)[:, None] for w in MEANS]
    return np.hstack([e, *means, np.ones((len(e), 1))])


def check_gaps(record: Record, seen: Seen) -> ControllerCheck | None:
    """Check the commands of a log slower than its controller; None where it is not possible (without a rate the
    predicted errors are too poor)."""
    own, ticks = on_board(record), record.every // record.tick
    if not np.isfinite(record.z[:, Z_THETA_DOT]).any() or not follows(own, ticks) or own.kp == 0.0 or own.tau == 0.0:
        return None
    tries = [gaps for gaps in (Gaps(record, seen, late) for late in range(MOST_COMPUTING_ROWS + 1))
             if gaps.fair.sum() >= MIN_COMMANDS]
    if not tries or tries[0].late > 0:
        return None
    found = tries[0].check()
    if found.kind != UNKNOWN_LAW:
        return found
    others = [each for each in (gaps.check() for gaps in tries[1:]) if each.kind != UNKNOWN_LAW]
    return min(others, key=lambda each: each.after, default=found)


def follows(own: OnBoard, ticks: int) -> bool:
    """Whether this controller's commands between rows, `ticks` ticks apart, follow from those at the rows."""
    return own.kd != 0.0 and own.late % ticks == 0


def _explained(gaps: Gaps) -> Left:
    """Return the best explanation of the gaps.

    A shorter filter is much like a higher derivative gain: of as many numbers the likelier are taken, and one more only
    where it brings clearly more.
    """
    best = gaps.left(gaps.own.tau, ())
    for free in GAINS:
        other = gaps.left(gaps.own.tau, free)
        best = other if other.over(best) > 0.0 else best
    for free, least in (((), -FREE_NUMBER), *((free, MISMATCH_NATS) for free in GAINS)):
        other = gaps.filtered(free)
        needed = least if other.numbers > best.numbers else 0.0
        if other.over(best) > needed and abs(other.tau / gaps.own.tau - 1.0) > SAME_PREDICTED:
            best = other
    return best
