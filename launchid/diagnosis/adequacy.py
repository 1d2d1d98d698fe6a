"""What speaks against a model or against a number of it: errors that are not noise, other shapes, a placebo."""

import math
from typing import NamedTuple

import numpy as np

from ..formatting import with_std
from ..likelihood.estimate import Fit, evaluate, fit_levels, gauss_newton, gram, log_likelihood, refreshed
from ..likelihood.likelihood import LEVELS
from ..placebo import is_placebo, of_other_times
from ..sums import along, square
from .candidates import CANDIDATE_KINDS
from .elimination import ALIKE_Z, MIN_SQUARES_SAVED, Elimination, Kept, Z
from .known import SCORE_BLOCKS
from .model import Model
from .noise import WEATHER
from .scan import Found, with_shape
from .score import compare, deviations, left_out
from .start import WEATHER_NATS

GOES_Z = 4.5           # block-robust z with which errors follow a signal: something is missing
GOES = 0.003           # and the share of their squares that does
FEWEST_ERRORS = 200    # of a column, without which nothing is asked of them
LOUD_LEVEL = 2.9       # times the declared, from which a level hides what is not modelled
WHITE_SQUARES = 1.35   # mean square of whitened errors that a model at its noise may leave
EXCLUDED = 0.25        # of k1, 2 dB: an error of it that a stranger's log excludes if it is called consistent
OTHER_TIMES = (0.2, 0.45, 0.7)   # of the log, by which the input is shifted
AHEAD_OF_OTHERS = 0.5  # of what the input saves, by which it must be ahead of a shifted one
LEAST_OF_INPUT = 5.0   # squares, that a shifted one saves at least by chance


class Followed(NamedTuple):
    """A signal that the whitened errors of a column go with: its standard errors over blocks, and its share of their
    squares."""

    column: str
    what: str
    z: float
    share: float

    @property
    def words(self) -> str:
        return f"errors of {self.column} go with {self.what} (z {self.z:.1f}, {100 * self.share:.1f} %)"


def followed(m: Model, fit: Fit) -> list[Followed]:
    """Return the signals that the whitened errors of a refreshed fit go with: something is missing."""
    e, sent, motion = fit.e, fit.run.parameters.u.mean(axis=1), m.path.motion
    signals = {"the rate": motion[:, 1], "the rate's sign": np.sign(motion[:, 1]), "the attitude": motion[:, 0],
               "the attitude's square": (motion[:, 0] - motion[:, 0].mean())**2,
               "the input": sent, "the input's square": (sent - sent.mean())**2, "time": m.log.tau}
    if not m.log.is_flown:
        del signals["time"]     # a slow drift of a sensor or of a moment is no number's, and others' logs have one
    found = []
    for ch, name in enumerate(("theta", "theta_dot", "beta")):
        mine = m.log.channel == ch
        if mine.sum() < FEWEST_ERRORS:
            continue
        k, x = m.log.rows[mine], e[mine]
        for what, signal in signals.items():
            s = signal[np.maximum(k - 2, 0)]
            s = s - s.mean()
            s = s / (s.std() + 1e-300)
            y = np.bincount(m.log.block[mine], s * x, minlength=SCORE_BLOCKS)
            z, r = float(y.sum() / (math.sqrt(SCORE_BLOCKS) * y.std(ddof=1) + 1e-9)), float(np.mean(s * x))
            share = r * r / float(np.mean(x * x))
            if abs(z) > GOES_Z and share > GOES:
                found.append(Followed(name, what, z, share))
    return found


def adequacy(m: Model, fit: Fit) -> tuple[list[str], str | None]:
    """Return what speaks against a model of a flown log by itself, in words, and where: whitened errors that go with a
    signal, are larger than their noise, or are no longer white."""
    fit = refreshed(m, fit)
    goes = followed(m, fit)
    words, place = [each.words for each in goes], "actuator" if any(each.column == "beta" for each in goes) else None
    for ch, name in enumerate(("theta", "theta_dot", "beta")):
        mine = m.log.channel == ch
        if mine.sum() < FEWEST_ERRORS:
            continue
        size, factor = math.sqrt(np.mean(fit.e[mine]**2)), math.exp(m.levels[ch] - m.noise.declared[ch])
        if factor * size > LOUD_LEVEL:
            words.append(f"noise of {name} is {factor * size:.1f} times the declared")
            place = place or ("actuator" if ch == 2 else "sensor")
        elif size * size > WHITE_SQUARES:
            words.append(f"errors of {name} are {size:.2f} times their noise")
            place = place or ("actuator" if ch == 2 else None)
    loud = math.exp((m.levels - m.noise.declared)[LEVELS.index("acceleration")])
    if loud > LOUD_LEVEL:
        words.append(f"noise of the acceleration is {loud:.1f} times the declared")
    return words, place


def other_shape(m: Model, el: Elimination, k: Kept) -> str:
    """Return in words what else, of no known cause, a kept number may be, so that it is not named; "": nothing.

    An attitude that drifts parts the columns as a gyro's bias does, and only the moment of the drift that the vehicle
    feels, which a slow disturbance may be too, tells the two apart: what the bias leaves by not being the same along
    the log stands beside neither.  A disturbance that weather leaves is neither, nor are gusts that overlap.
    """
    name = k.group.kind
    if any(overlap(el.final.p, k, other) for other in el.kept if other is not k):
        return f"what overlaps another {name} has a form that is no {name}'s"
    if m.air.weather and name != k.group.name and k.group.place == "environment":
        return f"what {m.air.weather} leaves of the disturbance is like a {name}: it is neither"
    if name != "gyro_bias":
        return ""
    bias = m.table.index("gyro_bias")
    drift = next(kind for kind in CANDIDATE_KINDS if kind.name == "attitude_walk")
    rests = [j for each in el.kept if is_rest(m, el, each, k) for j in each.group.numbers]
    left = tuple(j for j in el.final.free if j not in rests)

    def without_rests(p: np.ndarray) -> np.ndarray:
        q = p.copy()
        q[rests] = m.table.null[rests]
        return q

    own = left_out(m, gauss_newton(m, without_rests(el.final.p), left, el.final.band, 2)) if rests else el.e_final
    drifting, p = with_shape(m, without_rests(k.without), Found(drift, (), np.zeros(1), 0.0))
    fit = gauss_newton(drifting, p, tuple(sorted({*left, bias, len(p) - 1})), el.final.band | {bias}, 2)
    costs, error = compare(m, left_out(drifting, fit), own, el.unit)
    return "an attitude reference that drifts explains as much as a gyro_bias: another reference would decide" \
        if costs < ALIKE_Z * error else ""


def overlap(p: np.ndarray, one: Kept, other: Kept) -> bool:
    """Whether two events of one kind with durations are there at one time; p: the model's numbers."""
    if not one.group.is_event or one.group.kind != other.group.kind or len(one.group.numbers) < 3:
        return False
    (begin, lasts), (start, stays) = (p[list(each.group.numbers[1:])] for each in (one, other))
    return bool(begin < start + stays and start < begin + lasts)


def as_weather(m: Model, el: Elimination, k: Kept) -> tuple[str, ...]:
    """Return the weather that nobody declared and that, of a level that is fitted, explains a log as well as a gust
    does in its place: within what makes it a cause elsewhere.  Air that wanders has its gusts."""
    if k.group.kind != "gust" or m.air.weather or m.air.is_windy:
        return ()
    least = log_likelihood(m, evaluate(m, el.final.p)) - WEATHER_NATS
    free, out = tuple(j for j in el.final.free if j not in k.group.numbers), []
    for name in WEATHER:
        windy = m.in_weather(name)
        fit = gauss_newton(windy, k.without, free, el.final.band, 2)
        fitted = fit_levels(windy, fit.p, 4)
        if log_likelihood(fitted, evaluate(fitted, fit.p)) > least:
            out.append(name)
    return tuple(out)


def is_rest(m: Model, el: Elimination, k: Kept, largest: Kept) -> bool:
    """Whether a number fits only what the largest cause leaves by not being the same along the log: where that changes
    with time and its square, by as much as itself, the number is not needed."""
    if k is largest or k.group.is_event or largest.group.is_event:
        return False
    fit, of = el.final, largest.group.numbers[:largest.group.linear]
    off, tau = (fit.p - m.table.null)[list(fit.free)], m.log.tau[m.log.rows]
    J = np.column_stack([fit.J, *(fit.J[:, fit.at(j)] * by for j in of for by in (tau, tau**2))])
    sizes = [abs(fit.p[j] - m.table.null[j]) + 1e-12 for j in of for _ in range(2)]
    prior = np.concatenate([m.table.prior[list(fit.free)], sizes])**-2.0
    C = np.linalg.inv(gram(J) + np.diag(prior))
    moved = -C @ (along(J, fit.e) + prior * np.append(off, np.zeros(len(sizes))))
    at = [fit.at(j) for j in k.group.numbers[:k.group.linear]]
    left = off[at] + moved[at]
    return float(left @ np.linalg.solve(C[np.ix_(at, at)], left)) < MIN_SQUARES_SAVED * len(at)


def untested(m: Model, el: Elimination) -> list[str]:
    """Return that a stranger's log leaves room for a wrong k1: with its band open, it may be off by EXCLUDED."""
    if "k1" not in m.table:
        return []
    j = m.table.index("k1")
    free = tuple(sorted({*el.final.free, j}))
    fit = gauss_newton(m, el.final.p, free, el.final.band - {j}, 2)
    off, std = fit.p[j] - m.table.null[j], deviations(m, fit, el.unit)[j]
    if abs(off) + Z * std < EXCLUDED:
        return []
    return [f"k1 is not tested: this log gives {with_std(float(fit.p[j]), float(std))} times the nominal's"]


def acts(m: Model, el: Elimination) -> bool:
    """Whether the log's own input explains clearly more than the input of another time (a placebo)."""
    inputs = [m.table.index(name) for name in ("k1", "term beta^2", "inertia") if name in m.table]
    rest = tuple(j for j in range(len(m.table.numbers)) if j not in inputs and m.table.numbers[j].name not in
                 ("delay", "lag", "washout", "k1_slope", "bandwidth", "gain", "null_angle"))
    q = el.full.p.copy()
    q[inputs] = 0.0
    none = gauss_newton(m, q, rest, frozenset(), 2)
    without = square(none.e)
    own = without - square(evaluate(m, el.full.p).e)
    wins = []
    for commands in of_other_times(m.log.track.commands, OTHER_TIMES):
        turned = m.with_commands(commands)
        fit = gauss_newton(turned, none.p, tuple(sorted({*rest, *inputs})), frozenset(), 2)
        wins.append(without - square(fit.e))
    return not is_placebo(own, [LEAST_OF_INPUT, *wins], AHEAD_OF_OTHERS)
