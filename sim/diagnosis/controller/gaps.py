"""The controller's check of a log slower than the controller: the errors between its rows are predicted ones.

With alpha = tau/(tau + T) and m ticks a row the commands of two rows obey

    c(k+1) - alpha^m c(k) = kp (e(k+1) - alpha^m e(k)) + kd sum alpha^(m-j) (e(j) - e(j-1))/(tau + T),

which is linear in the gains (`Gaps`).  What a predicted error is wrong by shows in part at the next row, so that row's
innovations and their means stand beside the gains (without them these are biased, most with a wrong sensor).
What is left is the noise of the attitudes that the log does not have: white, and no larger than the sensor's makes it.

Where computing takes an odd number of periods and the log has every other tick, the errors that the logged commands
answer are the ones between its rows.  Then the controller is run backwards (`Backwards`): the errors that it must have
seen are compared with the predicted ones.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...sums import along, combined, least_squares, orthonormal, products
from ..data.record import THETA, Record
from .fill import errors_seen, on_board, run_backwards, shifted, test_issued
from .kind import FEWEST, NEAR_LIMIT, NONE, ROUNDING, UNKNOWN, ControllerCheck
from .numbers import FREE_NUMBER, NEUTRAL, lowest, newton, simplest

SAME_PREDICTED = 0.02  # relative, of a gain and of a time constant: closer is the same
NOISE = 4.0            # times what the attitude's noise between rows makes: more is no difference of gains
EXPLAINS = 2.0         # times it, that other numbers may leave: true ones leave 0.95 to 1.2, an integral part 2.9
CLEARLY = 30.0         # nats that a mismatch must gain; and gains and filter together over either
GAINS: tuple[tuple[int, ...], ...] = ((0,), (1,), (0, 1))  # which may be free
MEANS = (8, 32)        # rows, of innovations: over longer times they would take the gains' part too
COLOURED = 0.3         # correlation from gap to gap: more is neither noise nor a sensor's fault,
BY_CHANCE = 4.0        # if it is also more than so many of its standard deviations in white noise, 1/sqrt(gaps)
LATEST = 3             # periods of computing time tried
NEWTON_STEPS = 6
SETTLING = 0.25        # s that a controller run backwards takes to forget its start: five usual filters of 0.05 s
NEAR_FILTERS = np.geomspace(0.2, 5.0, 41)  # of the derivative's time constant
TEN_THOUSANDTH = 20    # golden sections between two of them, to so much of their distance


def settling(period: float) -> int:
    """SETTLING in a controller's periods [s]."""
    return math.ceil(SETTLING / period - ROUNDING)


class Seen(NamedTuple):
    """The predictions of a model that follows the log: attitude (ticks,) [rad] at every tick, innovations (rows, 3)."""

    attitude: np.ndarray
    innovations: np.ndarray


def rms(x: np.ndarray) -> float:
    """Root mean square, above 0 so that it has a logarithm."""
    return max(float(np.sqrt(np.mean(x**2))), 1e-12)


@dataclass(frozen=True, eq=False)
class Left:
    """The rest that an explanation leaves: rest (gaps,) [rad]; gains over the nominal's and their std (2,), filter tau
    [s], how many numbers were free."""

    rest: np.ndarray
    gains: np.ndarray
    std: np.ndarray
    tau: float
    numbers: int

    @property
    def rms(self) -> float:
        return rms(self.rest)

    def over(self, other: "Left") -> float:
        """Evidence [nats] over another explanation, less what a free number must bring."""
        return len(self.rest) * math.log(other.rms / self.rms) - FREE_NUMBER * (self.numbers - other.numbers)


class Gaps:
    """Fair pairs of neighbouring rows: both measured, neither command at the nozzle's limit.

    late  periods that computing takes beside the nominal's, with these a whole number of rows: the command answers an
          error so much older
    """

    def __init__(self, record: Record, seen: Seen, late: int = 0) -> None:
        self.kp, self.kd, self.tau, self.period, limit, own_late = on_board(record)
        self.ticks = m = record.every // record.tick
        self.late = late
        late += own_late
        self.error = shifted(errors_seen(record, seen.attitude), late)
        issued = record.commands[::m]
        self.command = issued - test_issued(record, late)[::m]
        measured = shifted(np.isfinite(record.z[:, THETA]), late // m)
        largest = np.maximum(np.abs(issued[1:]), np.abs(issued[:-1]))
        self.fair = measured[1:] & measured[:-1] & (largest < NEAR_LIMIT * limit)
        self.fair[:late // m + 1] = False
        if record.logged is not None:
            self.fair &= record.logged[1:] & record.logged[:-1]
        self.surprise = shifted(_surprises(seen), late // m)[1:][self.fair]
        self.known = orthonormal(self.surprise)[0]

    def relation(self, tau: float) -> tuple[np.ndarray, np.ndarray]:
        """(left-hand side (gaps,) [rad], right-hand side (gaps, 2) at the nominal's gains) with this filter [s]."""
        m, e, n = self.ticks, self.error, len(self.command)
        alpha = tau / (tau + self.period)
        steps = sum(alpha**(m - j) * (e[j:(n - 1) * m + j:m] - e[j - 1:(n - 1) * m + j - 1:m])
                    for j in range(1, m + 1)) / (tau + self.period)
        proportional = e[m::m] - alpha**m * e[:-m:m]
        wanted = self.command[1:] - alpha**m * self.command[:-1]
        return wanted[self.fair], np.column_stack([self.kp * proportional, self.kd * steps])[self.fair]

    def left(self, tau: float, free: tuple[int, ...]) -> "Left":
        """The rest with this filter [s], and the nominal's gains but for the free ones (0: kp, 1: kd)."""
        wanted, design = self.relation(tau)
        fixed = [k for k in range(2) if k not in free]
        wanted = wanted - design[:, fixed].sum(axis=1)
        among = np.column_stack([design[:, list(free)], self.surprise])
        values = least_squares(among, wanted)
        rest = wanted - combined(among, values)
        gains, std = np.ones(2), np.zeros(2)
        gains[list(free)] = values[:len(free)]
        spread = np.sqrt(np.mean(rest**2) * np.diag(np.linalg.pinv(products(among, among))))
        std[list(free)] = spread[:len(free)]
        return Left(rest, gains, std, tau, len(free))

    def filtered(self, free: tuple[int, ...]) -> "Left":
        """The rest with the filter that leaves least."""
        def after(tau: float) -> float:
            return self.left(tau, free).rms

        taus = self.tau * NEAR_FILTERS
        k = int(np.argmin([after(float(tau)) for tau in taus]))
        tau = lowest(after, float(taus[max(k - 1, 0)]), float(taus[min(k + 1, len(taus) - 1)]), TEN_THOUSANDTH)
        best = self.left(tau, free)
        return replace(best, numbers=best.numbers + 1)

    def rest(self, x: np.ndarray) -> np.ndarray:
        """The rest (gaps,) [rad] that a controller's numbers x (3,) leave."""
        wanted, design = self.relation(self.tau * math.exp(x[2]))
        rest = wanted - combined(design, x[:2])
        return rest - combined(self.known, along(self.known, rest))

    def noise_of(self, attitude: float) -> float:
        """The rest [rad] that the noise of an attitude [rad] that the log does not have leaves in a gap."""
        late = self.tau + self.period
        return attitude * self.kd * self.period / late**2


class Backwards:
    """The errors of every other tick from the commands of the log's rows, `late` periods later (with the
    nominal's an odd number)."""

    def __init__(self, record: Record, seen: Seen, late: int) -> None:
        self.kp, self.kd, self.tau, self.period, self.limit, own_late = on_board(record)
        self.late = late
        late += own_late
        self.commands = record.commands - test_issued(record, late)
        self.error = shifted(errors_seen(record, seen.attitude), late)
        measured = np.zeros(len(self.error), bool)
        measured[::2] = np.isfinite(record.z[:, THETA])
        self.measured = shifted(measured, late)
        self.logged = (np.arange(len(self.error)) % 2 == 0) & (np.abs(record.commands) < self.limit)
        self.fair = np.abs(record.commands[::2]) < NEAR_LIMIT * self.limit
        self.fair[:late + settling(self.period)] = False
        if record.logged is not None:
            self.fair &= record.logged
        self.known = orthonormal(shifted(_surprises(seen), late // 2)[self.fair])[0]

    def rest(self, x: np.ndarray) -> np.ndarray:
        """The rest (rows,) [rad] of the errors that a controller of these numbers must have seen less the predicted
        ones, times what it makes of them: of the commands, so that no gain is the better for answering less."""
        error = self.error.copy()
        run_backwards(x[0] * self.kp, x[1] * self.kd, self.tau * math.exp(x[2]), self.period, math.inf,
                      math.inf, self.logged, self.measured, error, self.commands.copy())
        gain = x[0] * self.kp + x[1] * self.kd / (self.tau * math.exp(x[2]) + self.period)
        rest = gain * (error - self.error)[::2][self.fair]
        return rest - combined(self.known, along(self.known, rest))

    def noise_of(self, attitude: float) -> float:
        """The error of a command [rad] by the noise of an attitude [rad] that the log does not have."""
        return attitude * (self.kp + self.kd / (self.tau + self.period))


def _surprises(seen: Seen) -> np.ndarray:
    """(rows, columns) what tells how wrong the errors predicted for the ticks before a row are: its innovations, and
    their means over some time, which a sensor that is wrong leaves."""
    e = np.nan_to_num(seen.innovations[:, :2])
    total = np.concatenate([np.zeros((1, 2)), np.cumsum(e, axis=0)])
    rows = np.arange(1, len(e) + 1)
    means = [(total[rows] - total[np.maximum(rows - w, 0)]) / np.minimum(rows, w)[:, None] for w in MEANS]
    return np.hstack([e, *means, np.ones((len(e), 1))])


def gaps_of(record: Record, seen: Seen, late: int) -> "Gaps | Backwards":
    """The relation that distinguishes a controller so late [periods] from the nominal's."""
    odd = (late + on_board(record).late) % (record.every // record.tick)
    return Backwards(record, seen, late) if odd else Gaps(record, seen, late)


def check_gaps(record: Record, seen: Seen | None) -> ControllerCheck | None:
    """The check of a slow log; None where it is not possible: without a rate the predicted errors are too poor."""
    if seen is None or "theta_dot" not in record.channels:
        return None
    own, ticks = on_board(record), record.every // record.tick
    if own.kd == 0.0 or own.kp == 0.0 or own.tau == 0.0 or (own.late % ticks and ticks > 2):
        return None
    gaps = gaps_of(record, seen, 0)
    if gaps.fair.sum() < FEWEST:
        return None
    if isinstance(gaps, Backwards):
        before = rms(gaps.rest(NEUTRAL))
        return _late(record, seen, ControllerCheck(UNKNOWN, before, before, evidence=-math.inf), first=0)
    believed, best = gaps.left(gaps.tau, ()), _explained(gaps)
    tau = best.tau if best.tau != gaps.tau and abs(best.tau / gaps.tau - 1.0) > SAME_PREDICTED else None
    found = ControllerCheck("", believed.rms, best.rms, float(best.gains[0]), float(best.gains[1]), 0.0,
                            (float(best.std[0]), float(best.std[1]), 0.0), tau, best.over(believed))
    if found.evidence < CLEARLY and is_noise(record, gaps, believed.rest):
        return ControllerCheck(NONE, believed.rms, believed.rms)
    if not is_noise(record, gaps, best.rest, EXPLAINS):
        return _late(record, seen, replace(found, kind=UNKNOWN))
    return found.of_kind(SAME_PREDICTED, gaps.period)


def _late(record: Record, seen: Seen, found: ControllerCheck, first: int = 1) -> ControllerCheck:
    """The likeliest computing time from `first` periods on, with other gains and another filter or without, if it
    leaves nothing but noise; else what was found without."""
    least = found.evidence
    for late in range(first, LATEST + 1) if record.every == 2 * record.tick else ():
        gaps = gaps_of(record, seen, late)
        if gaps.fair.sum() < FEWEST:
            continue
        x, information = newton(gaps.rest, NEUTRAL, NEWTON_STEPS)
        rest = gaps.rest(x)
        after = rms(rest)
        information = information / after**2
        evidence = record.rows * math.log(found.before / after) - simplest(x, information, CLEARLY, late=True).cost
        if evidence > least and is_noise(record, gaps, rest, EXPLAINS):
            least = evidence
            found = with_numbers(replace(found, after=after, delay=late * gaps.period, evidence=evidence), gaps, x,
                                 information)
    return found if math.isfinite(found.evidence) else replace(found, evidence=0.0)


def with_numbers(found: ControllerCheck, gaps: "Gaps | Backwards", x: np.ndarray, information: np.ndarray,
                 clearly: float = CLEARLY) -> ControllerCheck:
    """The check with these numbers, as many of them the nominal's as may be; information  of them, inverse
    covariance; clearly  as `simplest`."""
    named, std, _ = simplest(x, information, clearly, gaps.late > 0)
    other = abs(math.expm1(named[2])) > SAME_PREDICTED
    return replace(found, kp_scale=float(named[0]), kd_scale=float(named[1]), std=(float(std[0]), float(std[1]), 0.0),
                   time_constant=gaps.tau * math.exp(float(named[2])) if other else None).of_kind(
                       SAME_PREDICTED, gaps.period)


def _is_small(record: Record, gaps: "Gaps | Backwards", rest: np.ndarray, most: float) -> bool:
    """Whether what is left is at most so many times noise."""
    sensors = record.nominal.sensors
    attitude = max(math.hypot(sensors.theta_std, sensors.theta_step / 12**0.5), ROUNDING)
    return rms(rest) <= most * gaps.noise_of(attitude)


def is_noise(record: Record, gaps: "Gaps | Backwards", rest: np.ndarray, most: float = NOISE) -> bool:
    """Whether what is left is no larger than so many times noise, and white."""
    colour = float(np.mean(rest[1:] * rest[:-1])) / rms(rest)**2
    return _is_small(record, gaps, rest, most) and abs(colour) <= max(COLOURED, BY_CHANCE / math.sqrt(len(rest)))


def _explained(gaps: Gaps) -> Left:
    """The best explanation.

    A shorter filter is much like a higher derivative gain: where the gains alone do no better, it may be the filter,
    and both are asked for only where they bring clearly more.
    """
    best = gaps.left(gaps.tau, ())
    for free in GAINS:
        other = gaps.left(gaps.tau, free)
        best = other if other.over(best) > 0.0 else best
    if gaps.tau > 0.0:
        for free, least in (((), -FREE_NUMBER), *((free, CLEARLY) for free in GAINS)):
            other = gaps.filtered(free)
            if other.over(best) > least and abs(other.tau / gaps.tau - 1.0) > SAME_PREDICTED:
                best = other
    return best
