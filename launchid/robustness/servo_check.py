"""Test in every window whether the nozzle answers the logged commands as the servo of the margins does.

A Kalman filter of the servo alone follows the nozzle's sensor, driven by the logged commands and the declared noise of
command and sensor.  If the servo is the one assumed, its whitened innovations are white; a servo of another frequency,
damping ratio, delay or gain, and one with play, adds what a small change of that number would.  Rao's score test (Proc.
Camb. Phil. Soc. 44, 1948) asks for all five at once, with a free constant: in blocks of a second, in
the window, and in the window with earlier ones, which fade.  The uncertainty of an estimated servo widens the test.  So
a servo that changes in flight shows as soon as its own answer and the estimate part.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from launchid_core import Model
from sim.effects.actuator import play
from sim.kernels import kernel
from sim.vehicle.actuator import fastest_pole, free_servo

from ..formatting import PLUS_MINUS, with_std
from ..log.log import Log
from ..sums import along, combined, least_squares, products, square

INNOVATION_BLOCK = 1.0  # s
MEMORIES = (10.0, 30.0)  # s, over which what earlier windows tell fades: of a change, of a known servo
SERVO_CHI_SQUARE = 38.0  # of a chi square of five: 4e-7
LOUD_VARIANCE = 9.0    # times the declared variance: louder residuals are of no declared noise
SERVO_NOISE = 1.1      # times the declared noise: more is left by what no number of a servo is, as play
SETTLED = 0.01         # standard deviations: a shorter step is the last
START_ROUNDS = 3       # of each start, before the best goes on
FIT_ROUNDS = 8         # of Gauss and Newton
FARTHEST = np.array([0.4, 0.3, 0.005, 0.3])  # their longest steps: ln frequency, damping ratio, delay [s], gain
STARTS = (0.0, 0.02, 0.05)  # s later, from where they begin
FIRST_FREQUENCIES = (15.0, 40.0, 100.0)  # rad/s of a servo that nobody knows
FIT_SECONDS = 25.0     # s of the log, from which such a servo is begun with
NOISE_GUESS = 1e-7     # rad^2, variance of the nozzle's sensor to begin with
NOISE_RATIOS = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)  # of the command's noise to it, variances
NOISE_TURNS = 2        # of seeking the ratio, then the servo
INNOVATION_SIGMAS = 5.0  # standard deviations of an innovation: more is a fault of one sample
MIN_INNOVATIONS = 20   # innovations, without which nothing is said
UNKNOWN = 0.1          # rad, one sigma of the nozzle where the log begins
MOST_GAP = 1.5         # of the log's period, behind which it begins anew
SLOPE_STEPS = (0.01, 0.01, 5e-4, 0.01)  # of the slopes: ln frequency, damping ratio, delay [s], gain
ASKED = ("natural_frequency", "damping_ratio", "delay", "gain", "play")
USUAL = [0, 1, 2, 3, 5]  # of ASKED and a constant: all but play


@kernel
def move(x, f):
    """Predict a Kalman filter's state: x <- f x.  x (3,) inout, f (3, 3) in"""
    x0, x1, x2 = x[0], x[1], x[2]
    for a in range(3):
        x[a] = f[a, 0] * x0 + f[a, 1] * x1 + f[a, 2] * x2


@kernel
def move_covariance(p, f, work):
    """Predict its covariance: p <- f p f'.  p (3, 3) inout, f (3, 3) in, work (3, 3) scratch"""
    for a in range(3):
        for b in range(3):
            work[a, b] = f[a, 0] * p[0, b] + f[a, 1] * p[1, b] + f[a, 2] * p[2, b]
    for a in range(3):
        for b in range(3):
            p[a, b] = f[a, 0] * work[b, 0] + f[a, 1] * work[b, 1] + f[a, 2] * work[b, 2]


@kernel
def correct_covariance(p, s, gain, work):
    """Correct its covariance p (3, 3), inout, with a measurement of x[0] whose innovation has variance s; gain (3,)
    out, work (3, 3) scratch."""
    for a in range(3):
        gain[a], work[0, a] = p[0, a] / s, p[0, a]
    for a in range(3):
        for b in range(3):
            p[a, b] -= gain[a] * work[0, b]


@kernel
def follow(t, beta, at, command, servo, noise, most_gap, frozen, e, s, gain):
    """Run a Kalman filter of the servo along a log; write the innovations of the nozzle's sensor.

    t, beta (n,)       in     rows [s], [rad], NaN where not measured
    at, command (m,)   in     when each command was issued [s], the command [rad], NaN where not known
    servo (7,)         in     frequency [rad/s], damping ratio, delay [s], gain and constant [rad] of the command,
                              fastest pole [rad/s], 1 if of first order, its frequency one over the time constant
    noise (2,)         in     variances [rad^2] of the sensor, and of what is drawn with each command
    most_gap           in     [s] between rows, behind which the nozzle is not known
    frozen             in     use the gains and variances of an earlier run
    e, s (n,), gain (n, 3)  inout  innovations [rad], NaN where there is none, their variances, the filter's gains
    """
    w, zeta, delay, r, q = servo[0], servo[1], servo[2], noise[0], noise[1]
    x, p, f, work = np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))  # nozzle, rate, command's noise
    known, j, u = False, -1, math.nan
    for i in range(t.shape[0]):
        now = t[i - 1] if i > 0 else t[i]
        known = known and t[i] - now <= most_gap
        while known and now < t[i]:
            due = at[j + 1] + delay if j + 1 < at.shape[0] else math.inf
            h = min(due, t[i]) - now
            if h > 0.0:
                f[0, 0], f[0, 1], f[1, 0], f[1, 1] = free_servo(w, zeta, servo[5], servo[6] != 0.0, h)
                f[0, 2], f[1, 2], f[2, 2] = 1.0 - f[0, 0], -f[1, 0], 1.0
                x[0] -= u
                move(x, f)
                if not frozen:
                    move_covariance(p, f, work)
                x[0] += u
                now += h
            if due <= t[i]:
                j += 1
                now, u = max(now, due), servo[3] * command[j] + servo[4]
                known = not math.isnan(u)
                x[2], p[2, 0], p[2, 1], p[0, 2], p[1, 2], p[2, 2] = 0.0, 0.0, 0.0, 0.0, 0.0, q
        e[i] = math.nan
        if not known:
            j = np.searchsorted(at, t[i] - delay, side="right") - 1
            u = servo[3] * command[j] + servo[4] if j >= 0 else math.nan
            known = not math.isnan(u + beta[i])
            if known:
                x[0], x[1], x[2] = beta[i], 0.0, 0.0
                p[:, :] = 0.0
                p[0, 0], p[1, 1], p[2, 2] = r, (UNKNOWN * w) ** 2, q
            continue
        if math.isnan(beta[i]):
            continue
        e[i] = beta[i] - x[0]
        if not frozen:
            s[i] = p[0, 0] + r
            correct_covariance(p, s[i], gain[i], work)
        for a in range(3):
            x[a] += gain[i, a] * e[i]


@kernel
def played(half_width, command, out):
    """Write to out (m,) what commands (m,) [rad] become behind a play of +-half_width [rad]; NaN stays NaN."""
    w = command[0]
    for k in range(command.shape[0]):
        w = w if math.isnan(command[k]) else command[k] if math.isnan(w) else play(half_width, command[k], w)
        out[k] = w if not math.isnan(command[k]) else math.nan


@dataclass(frozen=True, eq=False)
class Answer:
    """Evidence of a window about its servo, for the score test.

    score (6,), information (6, 6)  of ASKED and a constant
    left             mean square of the whitened innovations after a fit of all six
    numbers, std (4,)  fitted ln frequency, damping ratio, delay [s] and gain less the servo's, without play
    blocks           largest statistic of a block
    covariance (4, 4)  of the numbers
    """

    score: np.ndarray
    information: np.ndarray
    left: float
    numbers: np.ndarray
    std: np.ndarray
    blocks: float
    covariance: np.ndarray


@dataclass(frozen=True, eq=False)
class Followed:
    """Rows t, beta [s, rad] and commands (at [s], command [rad]) of a log; half_width [rad]: half a play that shows."""

    t: np.ndarray
    beta: np.ndarray
    at: np.ndarray
    command: np.ndarray
    noise: np.ndarray
    most_gap: float
    half_width: float
    is_first_order: bool = False

    def answer(self, t_start: float, t_end: float, servo: np.ndarray, doubt: np.ndarray | None = None) -> Answer | None:
        """Return the evidence of rows from t_start to t_end [s] about servo (4,) = frequency [rad/s], damping ratio,
        delay [s], gain; doubt (3, 3) = covariance of (ln frequency, damping, delay), None: blocks are not asked.  None
        if fewer than MIN_INNOVATIONS rows tell."""
        rows = (self.t >= t_start) & (self.t < t_end)
        t, beta = self.t[rows], self.beta[rows]
        n = len(t)
        s, gain, play_of = np.ones(n), np.zeros((n, 3)), np.empty_like(self.command)
        played(self.half_width, self.command, play_of)

        def innovations(move: np.ndarray, command: np.ndarray, frozen: bool = True) -> np.ndarray:
            e = np.empty(n)
            w, zeta = servo[0] * math.exp(move[0]), servo[1] + move[1]
            values = np.array([w, zeta, *(servo[2:] + move[2:4]), move[4], fastest_pole(w, zeta), self.is_first_order])
            follow(t, beta, self.at, command, values, self.noise, self.most_gap, frozen, e, s, gain)
            return e

        still = innovations(np.zeros(5), self.command, frozen=False)
        moves = np.diag([*SLOPE_STEPS, self.half_width])
        slopes = [(innovations(-move, self.command) - innovations(move, self.command)) / (2.0 * move.max())
                  for move in moves[:3]]
        # innovations are linear in the command
        slopes += [(still - innovations(move, self.command)) / move.max() for move in moves[3:]]
        slopes.insert(4, (still - innovations(np.zeros(5), play_of)) / self.half_width)
        told = np.isfinite(still + sum(slopes))
        if np.count_nonzero(told) < MIN_INNOVATIONS:
            return None
        weight = 1.0 / np.sqrt(s[told])
        e = np.clip(still[told] * weight, -INNOVATION_SIGMAS, INNOVATION_SIGMAS)
        design = np.column_stack(slopes)[told] * weight[:, None]
        score, information = along(design, e), products(design, design)
        worst = 0.0 if doubt is None else _worst_block(design, e, (t[told] - t_start) / INNOVATION_BLOCK, doubt)
        x = least_squares(design, e)
        inverse = np.linalg.pinv(information[np.ix_(USUAL, USUAL)])
        return Answer(score, information, float(np.mean((e - combined(design, x))**2)),
                      (inverse @ score[USUAL])[:4], np.sqrt(np.diag(inverse)[:4]), worst, inverse[:4, :4])

    def likelihood(self, servo: np.ndarray) -> float:
        """Return the logarithm of the likelihood of all innovations, the noise's size free; servo (4,) as in
        `answer`."""
        n = len(self.t)
        e, s = np.empty(n), np.ones(n)
        values = np.array([*servo, 0.0, fastest_pole(servo[0], servo[1]), self.is_first_order])
        follow(self.t, self.beta, self.at, self.command, values, self.noise, self.most_gap, False, e, s,
               np.zeros((n, 3)))
        told = np.isfinite(e)
        if np.count_nonzero(told) < MIN_INNOVATIONS:
            return -math.inf
        e = np.clip(e[told] / np.sqrt(s[told]), -INNOVATION_SIGMAS, INNOVATION_SIGMAS)
        return -0.5 * (len(e) * math.log(square(e) / len(e)) + float(np.sum(np.log(s[told]))))

    def fit(self, t_start: float, t_end: float, servo: np.ndarray,
            rounds: int = FIT_ROUNDS) -> tuple[np.ndarray, Answer] | None:
        """Fit the servo (4,) to rows from t_start to t_end [s] by Gauss-Newton, from `servo`; return it, and the
        evidence about it.  None if too few rows tell."""
        found = self.answer(t_start, t_end, servo)
        for _ in range(rounds):
            if found is None:
                return None
            step = np.clip(found.numbers, -FARTHEST, FARTHEST)
            servo = np.maximum(np.append(servo[0] * math.exp(step[0]), servo[1:] + step[1:]), (1.0, 0.05, 0.0, 0.05))
            if np.all(np.abs(step) < SETTLED * found.std):
                break
            found = self.answer(t_start, t_end, servo)
        return None if found is None else (servo, found)

    def own(self, t_start: float, t_end: float, servo: np.ndarray) -> tuple[np.ndarray, np.ndarray, float] | None:
        """Fit the servo (4,) as `fit`; return it, its standard deviations (4,), and the noise left as a multiple of the
        declared."""
        made = self.fit(t_start, t_end, servo)
        if made is None:
            return None
        servo, found = made
        noise = math.sqrt(found.left)
        return servo, found.std * np.array([servo[0], 1.0, 1.0, 1.0]) * max(noise, 1.0), noise


def _worst_block(design: np.ndarray, e: np.ndarray, at: np.ndarray, doubt: np.ndarray) -> float:
    """Return the largest statistic of whitened innovations e (n,) with slopes (n, 6), block by block; at (n,): blocks
    since the window began."""
    blocks, worst = np.floor(at).astype(int), 0.0
    for one in (blocks == each for each in np.unique(blocks)):
        if np.count_nonzero(one) >= MIN_INNOVATIONS:
            own = products(design[one], design[one])
            worst = max(worst, statistic(along(design[one], e[one]), own, own, doubt))
    return worst


def statistic(score: np.ndarray, information: np.ndarray, variance: np.ndarray, doubt: np.ndarray) -> float:
    """Return the score test's chi square for the five of ASKED, a constant being free.

    score (6,), information (6, 6);  variance (6, 6) of the score;  doubt (3, 3) covariance of the servo under test
    """
    scale = 1.0 / np.sqrt(np.maximum(np.diag(variance), 1e-300))
    g, total = score * scale, variance + information[:, :3] @ doubt @ information[:3]
    total = total * np.outer(scale, scale)
    free = np.outer(total[:, -1], total[-1]) / total[-1, -1]
    g, total = (g - total[:, -1] * g[-1] / total[-1, -1])[:-1], (total - free)[:-1, :-1]
    return float(g @ np.linalg.pinv(total, rcond=1e-9, hermitian=True) @ g)


def followed(log: Log, model: Model) -> Followed | str:
    """Return the commands and the nozzle of a log for the servo test, or in words why the log allows none."""
    return followed_at(log, model.noise_period, np.array([model.beta_std**2, model.command_noise_std**2]),
                       model.time_constant > 0.0)


def followed_at(log: Log, period: float, noise: np.ndarray, is_first_order: bool = False) -> Followed | str:
    """Return the same of commands every `period` [s] and a servo with `noise` (2,) [rad^2], variances of the nozzle's
    sensor and of what is drawn with each command."""
    there = np.isfinite(log.beta_cmd) & np.isfinite(log.beta)
    if not there.any():
        return f"the log has no {'beta_cmd' if not np.isfinite(log.beta_cmd).any() else 'beta'}"
    if np.array_equal(log.beta[there], log.beta_cmd[there]):
        return "column beta is the command itself"
    if log.period > 1.01 * period:
        return f"the log's rows are {log.period:g} s apart, the controller's commands {period:g} s"
    rows = np.flatnonzero(np.isfinite(log.t))
    rows = rows[np.concatenate([[True], np.diff(np.maximum.accumulate(log.t[rows])) > 0.0])]
    t, command = log.t[rows], log.beta_cmd[rows]
    new = np.concatenate([[True], command[1:] != command[:-1]]) if log.period < 0.75 * period else \
        np.ones(len(t), bool)   # a row a period: each has a command of its own, even if it is the one before
    steps = np.abs(np.diff(command[new]))
    half_width = 0.2 * float(np.sqrt(np.nanmean(steps**2))) if np.isfinite(steps).any() else 0.0
    if half_width == 0.0:
        return "the command never changes"
    return Followed(t, log.beta[rows], t[new], command[new],
                    noise, MOST_GAP * log.period, half_width, is_first_order)


def servo_of(log: Log, period: float) -> tuple[np.ndarray, np.ndarray, Followed] | str:
    """Fit the servo, and the noise of command and nozzle, to a log whose nominal nobody has.

    Return frequency [rad/s], damping ratio, delay [s], gain (4,), their covariance (4, 4), and what `contradictions`
    asks; or one sentence.  The noises' ratio and the servo are sought in turn, the ratio by the largest likelihood.
    """
    follow = followed_at(log, period, np.array([1.0, 1.0]) * NOISE_GUESS)
    if isinstance(follow, str):
        return follow
    first, last = float(follow.t[0]), float(follow.t[-1]) + log.period
    short = min(last, first + FIT_SECONDS)
    tried = [follow.fit(first, short, np.array([w, 0.7, delay, 1.0]), START_ROUNDS)
             for w in FIRST_FREQUENCIES for delay in STARTS]
    made = min((each for each in tried if each is not None), key=lambda each: each[1].left, default=None)
    made = None if made is None else follow.fit(first, short, made[0])
    for _ in range(NOISE_TURNS):
        if made is None:
            break
        servo = made[0]
        likely = [replace(follow, noise=np.array([1.0, ratio]) * NOISE_GUESS) for ratio in NOISE_RATIOS]
        follow = max(likely, key=lambda each: each.likelihood(servo))
        found = follow.answer(first, last, servo)
        if found is not None:
            follow = replace(follow, noise=follow.noise * found.left)
        made = follow.fit(first, last, servo)
    if made is None:
        return "too few rows tell the servo"
    servo, found = made
    unit = np.array([servo[0], 1.0, 1.0, 1.0])
    return servo, found.covariance * np.outer(unit, unit) * max(found.left, 1.0), follow


# mean (3,): frequency, damping ratio, delay, or with the gain (4,); covariance (3, 3) of the three
Servos = Sequence[tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Judgement:
    """found: for each window whether it contradicts its servo, None if it cannot be tested; shown (3,): differences of
    natural frequency [rad/s], damping ratio and delay [s] that the most telling window would have shown; covariance
    (3, 3) of the three as the window that tells the delay best leaves them."""

    found: list[bool | None]
    shown: np.ndarray
    covariance: np.ndarray

    @property
    def deviation(self) -> np.ndarray:
        """Return the three standard deviations."""
        return np.sqrt(np.diag(self.covariance))


def contradictions(follow: Followed, windows: Sequence[tuple[float, float]], servos: Servos) -> Judgement:
    """Test the servo in every window (t_start, t_end [s]).  A window too weak to see the servo that contradicting
    windows show counts as one of them."""
    answers, about, doubts = [], [], []
    for (t_start, t_end), (mean, covariance) in zip(windows, servos, strict=True):
        unit = np.array([1.0 / mean[0], 1.0, 1.0])
        about.append(np.array([math.log(mean[0]), *mean[1:3]]))
        doubts.append(covariance * np.outer(unit, unit))
        known = np.isfinite(mean).all()
        answers.append(follow.answer(t_start, t_end, np.append(mean, 1.0)[:4], doubts[-1]) if known else None)
    usual = float(np.median([each.left for each in answers if each is not None] or [1.0]))
    threshold = SERVO_CHI_SQUARE * usual
    statistics, told = np.full((len(windows), len(MEMORIES)), math.nan), [np.zeros((6, 6))] * len(windows)
    for column, memory in enumerate(MEMORIES):
        score, information, variance, before = np.zeros(6), np.zeros((6, 6)), np.zeros((6, 6)), np.zeros(3)
        for k, ((t_start, t_end), answer) in enumerate(zip(windows, answers, strict=True)):
            if answer is not None:
                fade = math.exp(-(t_end - t_start) / memory)
                score = fade * (score + information[:, :3] @ (before - about[k])) + answer.score  # about its servo
                information, variance = fade * information + answer.information, fade**2 * variance + answer.information
                before = about[k]
                statistics[k, column], told[k] = statistic(score, information, variance, doubts[k] / usual), information
    found: list[bool | None] = []
    for faded, answer, doubt in zip(statistics, answers, doubts, strict=True):
        if answer is None:
            found.append(None)
            continue
        own = statistic(answer.score, answer.information, answer.information, doubt / usual)
        found.append(max(answer.blocks, own, *faded) > threshold or answer.left > LOUD_VARIANCE)
    others = [answer for answer, is_other in zip(answers, found, strict=True) if answer is not None and is_other]
    if others:
        score = np.sum([each.score for each in others], axis=0)
        information = np.sum([each.information for each in others], axis=0)
        other = np.linalg.pinv(information[:5, :5], rcond=1e-9, hermitian=True) @ score[:5]
        found = [bool(other @ seen[:5, :5] @ other < threshold) if is_other is False else is_other
                 for is_other, seen in zip(found, told, strict=True)]
    shown, covariance = np.full(3, math.inf), np.full((3, 3), math.inf)
    for mean, information in zip((mean for mean, _ in servos), told, strict=True):
        if information.any():
            scale = 1.0 / np.sqrt(np.diag(information)[USUAL])
            inverse = np.linalg.inv(information[np.ix_(USUAL, USUAL)] * np.outer(scale, scale) + 1e-12 * np.eye(5))
            shown = np.minimum(shown, np.sqrt(threshold * np.diag(inverse)[:3]) * scale[:3] * [mean[0], 1.0, 1.0])
            unit = scale[:3] * [mean[0], 1.0, 1.0]
            left = usual * inverse[:3, :3] * np.outer(unit, unit)
            covariance = left if left[2, 2] < covariance[2, 2] else covariance
    return Judgement(found, shown, covariance)


def words(follow: Followed, window: tuple[float, float], servo: np.ndarray) -> str:
    """Describe in words the servo that best fits a window (t_start, t_end [s]); starts: `servo` (3,), longer delays."""
    found = [follow.own(*window, np.append(servo + np.array([0.0, 0.0, later]), 1.0)) for later in STARTS]
    tried = [each for each in found if each is not None]
    if not tried:
        return "no servo follows"
    (w, zeta, delay, gain), std, noise = min(tried, key=lambda each: each[2])
    left = f", and {noise:.2g} times the declared noise is left" if noise > SERVO_NOISE else ""
    late = with_std(1e3 * delay, 1e3 * std[2])
    return (f"{with_std(w, std[0])} rad/s, damping ratio {with_std(zeta, std[1])}, delay {late} ms, gain "
            f"{with_std(gain, std[3])} would explain {window[0]:g}..{window[1]:g} s best ({PLUS_MINUS}){left}")
