"""Commands issued at ticks that no row of the log saw, where its rows fall between the controller's ticks (`ticks`).

The controller is run on the attitude that a model predicts, and backwards where a command is logged: what noise it saw
there follows.  With the reference its gains and its computing time are fitted on the way.  Without, or where what it
heard is no noise, what it was asked is made of the commands, too: a median over rows, which takes no part of the noise
for asked and no edge for noise.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from ...sums import along, inner, products, square
from ..data.record import Record
from .asked import of_noise, unsure
from .fill import OnBoard, on_board, run_backwards, shifted, test_of
from .gaps import BY_CHANCE, CLEARLY, GAINS, LATEST, NEWTON_STEPS, SAME_PREDICTED, rms, settling
from .kind import FEWEST, NEAR_LIMIT, NONE, ROUNDING, ControllerCheck
from .numbers import FREE_NUMBER, RIDGE
from .ticks import NORMAL, issued_at, lined, noise_std, over_grid, ticks_of

# Nats a row that one unseen command a row may feign (`asked.unsure`): 1.6 times the most that any cause or disturbance
# found in clean flights of the three nominals, read by seven clocks, calm and windy (seeds 9740 and 9744), and of a
# foreign simulator's trimmed vehicles
HEARD = 0.012       # reference and commands
UNHEARD = 0.015     # no commands at all
UNTOLD = 0.15       # no reference: most about a trim, where the commands are noise alone
SLOPE_STEP, SCALES = 0.01, (0.05, 20.0)  # of gains over the nominal's: of a numerical slope, and what is tried
KD_OFF = 0.05  # of kd, one sigma: what noise that no row saw makes of it, seen in flights with another kd
SURELY = 60.0  # nats that another kd or computing time must bring: a gyro's scale and a late attitude feigned 33
ROWS = 5     # of a median over what was asked
MOST = 8.0   # standard deviations of the attitude's noise: an error that was heard leaves the predicted one by more
LOUD = 2.0   # times the attitude's noise: what is heard and is more is no noise (1.0 with the right gains)
JUMP = 5.0   # standard deviations of the attitude's noise: what is asked leaves the line of its neighbours
MOST_JUMPS = 0.1     # of the rows: more is no staircase
HEARD_AFTER = 12     # ticks that tell when a jump was heard
LONGEST_DOUBT = 5    # rows
LARGE = 0.9  # quantile beyond which an error is cut, as at a step of the reference between rows


@dataclass(frozen=True, eq=False)
class _Heard:
    """A controller at its ticks.  error: as a model predicts it; logged: the log's commands without the test input,
    NaN: it has not, or the nozzle's limit cut them, and the test input, (ticks,) [rad]; and the most [rad] that noise
    makes of an error."""

    own: OnBoard
    error: np.ndarray
    logged: np.ndarray
    test: np.ndarray
    most: float

    def late(self, by: int) -> "_Heard":
        """The errors with so many more periods of computing time."""
        test = shifted(self.test, by)
        return replace(self, error=shifted(self.error, by), logged=self.logged + self.test - test, test=test)

    @property
    def tells(self) -> np.ndarray:
        """The ticks (ticks,) bool whose command is known."""
        return np.isfinite(self.logged)

    def run(self) -> tuple[np.ndarray, np.ndarray]:
        """(Errors, commands), (ticks,) [rad], without limit: the predicted ones, but as the logged commands say."""
        error, commands, own = self.error.copy(), np.where(self.tells, self.logged, 0.0), self.own
        run_backwards(own.kp, own.kd, own.tau, own.period, math.inf, self.most, self.tells, np.zeros(len(error), bool),
                      error, commands)
        return error, commands

    @property
    def answer(self) -> float:
        """The gain from an error to the command's answer at once."""
        return self.own.kp + self.own.kd / (self.own.tau + self.own.period)

    def off(self) -> np.ndarray:
        """The differences [rad] of the errors that it had from the predicted ones."""
        return (self.run()[0] - self.error)[self.tells][settling(self.own.period):]

    def noise(self) -> np.ndarray:
        """The noise [rad]: the differences, cut where they are none."""
        return np.clip(self.off(), -self.most, self.most)

    def with_gains(self, x: np.ndarray) -> "_Heard":
        """The errors with kp and kd times these (2,)."""
        return replace(self, own=self.own._replace(kp=x[0] * self.own.kp, kd=x[1] * self.own.kd))

    def rest(self, x: np.ndarray) -> np.ndarray:
        """The rest [rad] of the commands that gains so much larger leave, cut where it is no noise."""
        other, most = replace(self.with_gains(x), most=math.inf), self.most * abs(self.answer)
        return np.clip(other.answer * other.off(), -most, most)

    def gains(self, free: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
        """(kp and kd over the nominal's with which the errors answer the commands best, their std (2,)), the nominal's
        but for the free ones (0: kp, 1: kd): Gauss-Newton."""
        x, std, among = np.ones(2), np.zeros(2), list(free)
        information = np.eye(len(among))
        for _ in range(NEWTON_STEPS):
            left = self.rest(x)
            slopes = np.column_stack([(self.rest(x + SLOPE_STEP * np.eye(2)[k]) - left) / SLOPE_STEP for k in among])
            information = products(slopes, slopes)
            information += RIDGE * (np.trace(information) + RIDGE) * np.eye(len(among))
            x[among] = np.clip(x[among] - np.linalg.solve(information, along(slopes, left)), *SCALES)
        std[among] = rms(self.rest(x)) * np.sqrt(np.diag(np.linalg.inv(information)))
        return x, std

    def asked(self) -> np.ndarray:
        """The correction (ticks,) [rad] that, taken off the errors, gives the commands but for noise."""
        made = replace(self, logged=np.full(len(self.error), math.nan)).run()[1]
        asks, index = lined(made - self.logged), np.arange(len(made))
        start = asks / self.own.kp if self.own.kp != 0.0 else np.zeros(len(asks))
        rough = replace(self, error=start, logged=asks, most=math.inf).run()[0][self.tells]
        padded = np.pad(rough, ROWS // 2, mode="edge")
        return np.interp(index, index[self.tells],
                         np.median(np.lib.stride_tricks.sliding_window_view(padded, ROWS), axis=1))


def with_unseen(record: Record, attitude: np.ndarray) -> tuple[Record, ControllerCheck | None]:
    """The record with the commands of the ticks that no row saw and how far they are off, and the controller's check;
    None: it is the nominal's as far as such a log tells.

    attitude  (grid's ticks,) [rad] predicted
    """
    assert record.issued is not None
    ticks, own = ticks_of(record, record.issued), on_board(record)
    assert ticks is not None
    logged = issued_at(ticks, record, record.issued)
    known = np.isfinite(logged)
    if own.kp + own.kd / (own.tau + own.period) == 0.0:
        return record, None
    at = ticks.phase + ticks.period * np.arange(len(logged))
    first = round((record.first_step + ticks.phase) / ticks.period)
    test = test_of(record, first - own.late, len(at))
    told, seen = np.isfinite(record.reference), ticks.of(record.at)
    asked = np.interp(record.at, record.at[told], record.reference[told]) if told.any() else np.zeros(record.rows)
    theta = np.interp(at, record.tick * np.arange(len(attitude)), attitude)
    error = theta - np.interp(at, record.at, asked)
    free = np.where(np.abs(logged) < NEAR_LIMIT * own.limit, logged - test, math.nan)
    heard = _Heard(own, shifted(error, own.late), free, test, MOST * max(noise_std(record), ROUNDING))
    steps = _jumps(asked, record)
    check, is_told = None, told.any()
    if np.count_nonzero(heard.tells) >= FEWEST + settling(own.period):
        if is_told:
            tries = [_placed(heard.late(late), asked, np.flatnonzero(steps), seen + own.late + late)
                     for late in range(LATEST + 1)]
            heard, check, is_told = _checked(tries)
        if known.all():
            return record, check
        if not is_told:
            asks = heard.asked()
            heard = replace(heard, error=heard.error - asks)
            steps = np.maximum(steps, _jumps(asks[np.maximum(seen, 0)], record))
            cut = np.abs(record.issued) >= NEAR_LIMIT * own.limit
            steps[cut[1:] != cut[:-1]] = own.limit / of_noise(record)
    elif known.all() or not is_told:
        return record, None
    of = UNTOLD if not is_told else HEARD if known.any() else UNHEARD
    commands = np.where(known, logged, np.clip(heard.run()[1] + heard.test, -own.limit, own.limit))
    if known.any():  # between two rows at the same limit it is there
        sides = lined(np.where(np.abs(logged) < NEAR_LIMIT * own.limit, 0.0, np.sign(logged)))
        commands = np.where(np.abs(sides) == 1.0, own.limit * sides, commands)
    share, unseen = np.mean(~known), np.count_nonzero(~known) / record.rows
    record = _in_doubt(record, steps, heard.tells[np.maximum(seen, 0)])
    return replace(record, commands=over_grid(ticks, record, commands),
                   fill_gain=abs(heard.answer) * math.sqrt(share * min(1.0, ticks.period / record.every)),
                   unsure=unsure(record, of * (heard.answer / of_noise(record))**2, max(unseen, unseen**2))), check


def _jumps(asked: np.ndarray, record: Record) -> np.ndarray:
    """The steps (n - 1,) [rad] by which the reference, asked (n,) [rad], jumps after a row: where it leaves the line of
    its neighbours by more than noise; else 0."""
    step, least = np.diff(asked), JUMP * max(noise_std(record), ROUNDING)
    beside = np.convolve(np.pad(step, 1, mode="edge"), [0.5, 0.0, 0.5], mode="valid")
    jumps = np.where((np.abs(step - beside) > least) & (np.abs(step) > least), np.abs(step), 0.0)
    return jumps if np.count_nonzero(jumps) < MOST_JUMPS * len(jumps) else np.zeros(len(jumps))


def _placed(heard: _Heard, asked: np.ndarray, jumps: np.ndarray, seen: np.ndarray) -> _Heard:
    """The errors with jumps of the reference asked (n,) [rad] of rows that saw the ticks seen (n,) at the ticks that
    the next commands tell."""
    for k in jumps.tolist():
        first, last = seen[k] + 1, min(seen[k + 1] + 1, len(heard.error) - 1)
        after = np.arange(last, min(last + HEARD_AFTER, len(heard.error)))
        after = after[heard.tells[after]]
        line = np.interp(np.arange(first, last + 1), [seen[k], seen[k + 1]], asked[[k, k + 1]])
        best, least = heard, math.inf
        for place in range(first, last + 1):
            error = heard.error.copy()
            error[first:last + 1] += line - np.where(np.arange(first, last + 1) >= place, asked[k + 1], asked[k])
            tried = replace(heard, error=error)
            left = float(np.sum(np.abs((tried.run()[0] - error)[after])))
            best, least = (tried, left) if left < least else (best, least)
        heard = best
    return heard


def _in_doubt(record: Record, steps: np.ndarray, tells: np.ndarray) -> Record:
    """The record with the rows after steps (n - 1,) [rad] of what was asked lost, up to the next one whose command
    tells (n,): when a step was heard decides what the nozzle did."""
    jumps, own = np.flatnonzero(steps), on_board(record)
    if not len(jumps):
        return record
    lost = np.zeros(record.rows, bool) if record.lost is None else record.lost.copy()
    kicks = np.minimum(steps[jumps] * of_noise(record), 2.0 * own.limit) * min(1.0, own.period / record.period)
    total = record.unknown**2 * np.count_nonzero(lost) + square(kicks)
    for k in jumps.tolist():
        until = k + 1
        while until < min(k + LONGEST_DOUBT, record.rows - 1) and not tells[until]:
            until += 1
        lost[k:until] = True
    return replace(record, lost=lost, unknown=math.sqrt(total / np.count_nonzero(lost)))


def _checked(tries: list[_Heard]) -> tuple[_Heard, ControllerCheck | None, bool]:
    """(With the gains and the computing time that it has, what these are, whether what it heard is noise: else it was
    asked something else);  tries  with so many periods of computing time beside the nominal's."""
    believed, neutral = tries[0], np.ones(2)
    before = rms(believed.rest(neutral))
    made: list[tuple[float, _Heard, ControllerCheck]] = []
    for late, heard in enumerate(tries):
        for free in ((), *GAINS):
            x, std = heard.gains(free) if free else (neutral, np.zeros(2))
            after, own = rms(heard.rest(x)), heard.with_gains(x)
            surely = SURELY if late > 0 or 1 in free else 0.0
            cost = len(believed.off()) * math.log(after / before) + FREE_NUMBER * (len(free) + (late > 0)) + surely
            std[1] = math.hypot(std[1], KD_OFF * x[1]) if 1 in free else 0.0
            made.append((cost, own, ControllerCheck("", before, after, float(x[0]), float(x[1]),
                                                    late * own.own.period, (float(std[0]), float(std[1]), 0.0),
                                                    evidence=surely - cost)))
    cost, heard, found = min(made, key=lambda each: each[0])
    if not cost < 0.0:
        return believed, None, _is_noise(believed)
    if not _is_noise(heard):
        return believed, None, False  # no gains make what it heard of this reference
    found = found.of_kind(SAME_PREDICTED, heard.own.period)
    return heard, found if found.kind != NONE and found.evidence > CLEARLY else None, True


def _is_noise(heard: _Heard) -> bool:
    """Whether what it heard beside what is predicted is noise: of no colour, and of the attitude's size."""
    size = float(np.median(np.abs(heard.off()))) / NORMAL
    return not _is_coloured(heard.noise()) and size < LOUD * heard.most / MOST


def _is_coloured(x: np.ndarray) -> bool:
    """Whether errors x (n,) [rad] are no noise."""
    most = np.quantile(np.abs(x - np.median(x)), LARGE)
    x = np.clip(x - np.median(x), -most, most)
    return inner(x[1:], x[:-1]) > BY_CHANCE / math.sqrt(len(x)) * square(x)
