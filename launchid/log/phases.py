"""Find the phases of a flight in its log: where beta moves the vehicle, where it does not, where the pad holds it.

The rate's changes over hops of HOP are regressed, in every stretch of the log, on a constant, the attitude and beta, as
late as it explains most (a servo's delay and lag).  Three equations compete in each stretch:

    beta moves the vehicle    rate change = c + a theta + k beta + noise
    it does not               rate change = c + a theta + noise
    the pad holds it          rate = constant + white noise

Stretches and equations are chosen together, by optimal partitioning (Jackson et al., IEEE Signal Proc. Letters 12,
2005) with the Bayesian information criterion.  All numbers, the noise too, are each stretch's own, so nothing depends
on a unit or a vehicle.  Where beta acts best is the reference.

A stretch is another phase only if the log decides so, at SIGMAS: against an effect of beta of ACTING of that in the
reference, and rather for none than for WEAKEST, which would be a loss of control.  The constant, theta's and the rate's
coefficients beside it are those of the reference, but for shares of what beta does there: a loop that goes on
commanding moves beta as a sum of these, which would else hide that beta does nothing.  Of a vehicle that leaves its
range SIGMAS_AWAY decide.  Noise of the nozzle's sensor is taken off what beta moves.  A pad, on which nothing
moves the attitude, lies before the first stretch in which beta acts beyond doubt, other phases behind the last: what
lies between is one flight.  So a calm stretch is no phase.  Of a servo that stands still the vehicle's motion must
tell, or that the stretch follows one in which beta did not act.
"""

import itertools
import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sim.nominal import Nominal

from ..placebo import is_placebo, of_other_times
from ..series import white_squares
from ..sums import combined, least_squares, square
from .check import CheckedLog, checked
from .cut import Cut
from .detect import DataCheck, related
from .fault import Fault
from .log import Log

HOP = 0.04           # s, of one change of the rate: short beside any motion, long beside a sample
LAG = 0.03           # s, from one delay of beta that is tried to the next
LAGS = 4             # delays that are tried: 0 to 0.09 s
HOP_OF_ATTITUDE = 0.08   # s, the same where no gyro measures the rate
JERK = 8.0           # times the largest twentieth of the rate's changes, beyond which one is a parachute's jerk
BLOCKS = (25, 50, 100)   # hops, over which what beta explains is summed over a log
FOUND = 24.0         # nats, that beta explains of the reference at least: the best stretch of a log has 20 by chance
SHORTEST = 20        # hops of a stretch: five times the numbers that are fitted in it
EDGES = 240          # places where a stretch may begin or end: their number's square is the work
SIGMAS = 5.0         # standard deviations, by which an effect of beta is excluded: odds of two million to one
SIGMAS_AWAY = 3.0    # the same, of a vehicle that leaves its range: that is evidence too
ACTING = 0.5          # of beta's effect in the reference, at least where it acts like it
WEAKEST = 0.2        # of beta's effect in the reference, below which beta does not act
AWAY = 0.5           # of the range of attitude and rate in flight, by which they leave it
CALM = 0.25          # of the walk's variance in the reference, that a calmer flight may have
SHARED = (-0.25, -0.1, 0.0, 0.1, 0.2, 0.3, 0.4, 0.45, 0.48, 0.495)  # of the variance, that neighbouring changes share
WHITE = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 1e4)   # variances of the rate's white noise, for one of the walk
MEANS_OVERLAP = 2.0 - math.sqrt(3.0)   # of a walk's last step in the next change of its means: a triangle's, 1/4 shared
MOST_HOPS = 400      # of a stretch, next to the reference, that tell whether beta acts there: 16 s
DIFFUSE = 1e3        # of a regressor's scale, one sigma of a coefficient that nothing is known of
MOST_SHARED = 0.4999  # the same of white noise alone: a half
OTHER_TIMES = (0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85)  # of the log: shifts of beta that must explain less
AHEAD = 0.55         # of the nats that beta saves: a shifted beta saves so much less
SAME_TRIM, SAME_SLOPE, SAME_DAMPING = 0.5, 0.1, 0.05  # of what beta does in the reference, one sigma of what the
#                      constant, theta and the rate do otherwise elsewhere
LEAST_MOVED = 0.5    # of what beta moves beside theta, that its sensor's noise may not be
FLOOR = 1e-12        # of the variance of the rate's changes: below is rounding
MOVES, DOES_NOT, HELD = "beta moves the vehicle", "beta does not move it", "the pad holds it"
STILL = "the servo stands still"
KINDS = (MOVES, DOES_NOT, HELD)


@dataclass(frozen=True)
class Phase:
    """A stretch of a log, from `first` to `last` [s of the log's own time], and what it is in words: MOVES, ..."""

    kind: str
    first: float
    last: float


@dataclass(frozen=True, eq=False)
class _Hops:
    """Changes y (n,) of the rate from t (n,) to `end` (n,) [s], and their regressors x (n, 3): 1, theta, beta as late
    as it acts, all scaled to their rms; rate, theta, beta (n,) at t, in the unit of y and in rad; noise (n,) of its
    sensor as a variance of the regressor of beta; size [rad] of that; reach: hops that it reaches back."""

    t: np.ndarray
    end: np.ndarray
    y: np.ndarray
    x: np.ndarray
    rate: np.ndarray
    theta: np.ndarray
    beta: np.ndarray
    noise: np.ndarray
    size: float
    reach: int


def phases_of(log: Log, data: DataCheck) -> list[Phase]:
    """Return the phases of a log in order; [] if it has one alone, or too little to tell.

    Parameters
    ----------
    log : Log
        As the data check has mended it.
    data : DataCheck
        Its masks: what is at fault is not used.
    """
    hops = _hops(log, data)
    if hops is None:
        return []
    sums = _Sums(hops)
    parts = _partition(sums, len(hops.y))
    gains = [_gain(sums, first, end) if kind == 0 else -math.inf for first, end, kind in parts]
    if not gains or not max(gains) > FOUND:
        return []
    reference = int(np.argmax(gains))
    if _is_idle(hops):
        return []
    parts = _refined(sums, parts, reference)
    labels = _labels(hops, sums, parts, reference)
    runs = [[*part[:2], label] for part, label in zip(parts, labels, strict=True)]
    merged = [runs[0]]
    for run in runs[1:]:
        if run[2] == merged[-1][2]:
            merged[-1][1] = run[1]
        else:
            merged.append(run)
    for before, after in itertools.pairwise(merged):
        next_end = min(end for _, end, _ in parts if end > after[0]) if after[2] == 1 else after[1]
        before[1] = after[0] = _edge(sums, before, [after[0], next_end, after[2]])   # a parachute tells no burn-out
    if len(merged) == 1:
        return []
    last = len(merged) - 1
    t = log.t[np.isfinite(log.t)]
    return [Phase(_words(hops, first, end, label), float(hops.t[first + 1] if k > 0 else np.min(t)),
                  float(hops.end[end - 2] if k < last else np.max(t)))
            for k, (first, end, label) in enumerate(merged)]


def flown_phase(phases: list[Phase]) -> Phase | None:
    """Return the phase in which beta moves the vehicle, the longest of several; None if a log has one phase alone."""
    return max((each for each in phases if each.kind == MOVES), key=lambda each: each.last - each.first, default=None)


# ---- hops and their likelihoods


def _hops(log: Log, data: DataCheck) -> _Hops | None:
    """Return the log's hops; None if it has too few rows, no attitude, or neither beta nor a command that moves."""
    t, columns = related(log, data.usable, data.masks)
    theta, beta = columns.get("theta"), columns.get("beta", columns.get("beta_cmd"))
    if theta is None or beta is None or not np.ptp(beta) > 0.0:
        return None
    period = float(t[1] - t[0])
    rows = max(1, round((HOP if "theta_dot" in columns else HOP_OF_ATTITUDE) / period))
    count = len(t) // rows
    if count < 3 * SHORTEST:
        return None

    def means(x: np.ndarray) -> np.ndarray:
        return np.asarray(x[:count * rows].reshape(count, rows).mean(axis=1))

    rate = means(columns["theta_dot"] if "theta_dot" in columns else np.gradient(theta, period))
    held, lean, apart = means(beta), means(theta), max(1, round(LAG / period))
    first = -(-(LAGS - 1) * apart // rows)   # hops that the last lag reaches back
    y, at = np.diff(rate)[first:], 0.5 * (lean[1:] + lean[:-1])[first:]
    most = JERK * float(np.quantile(np.abs(y), 0.95))
    y = np.clip(y, -most, most) if most > 0.0 else y
    total = np.concatenate([[0.0], np.cumsum(beta)])
    begin = rows * np.arange(first, count - 1)
    lags = [(total[begin + 2 * rows - j * apart] - total[begin - j * apart]) / (2 * rows) for j in range(LAGS)]
    x = np.stack([np.ones(len(y)), at - at.mean(), *(each - beta.mean() for each in lags)], axis=1)
    size, scale = np.sqrt(np.mean(x**2, axis=0)), float(np.std(y))
    if not (np.all(size > 0.0) and scale > 0.0 and np.all(np.isfinite(x)) and math.isfinite(scale)):
        return None
    x, y = x / size, y / scale
    explained = [_explained(x[:, [0, 1, 2 + j]], y) for j in range(LAGS)]
    acts = 2 + int(np.argmax(explained))
    noise = white_squares(beta) if "beta" in columns else np.zeros(len(t))
    return _Hops(t[begin], t[begin] + 2.0 * rows * period, y, x[:, [0, 1, acts]], rate[first:-1] / scale,
                 lean[first:-1], held[first:-1], means(noise)[first:-1] / (2.0 * rows), float(size[acts]),
                 first)


def _explained(x: np.ndarray, y: np.ndarray) -> float:
    """Return the nats by which beta, the third column of x (n, 3), explains y (n,) better than the first two do, summed
    over the blocks of the log where it does; of the length of block that tells most.

    What acts late acts with one sign.  Several lags at once, of changing sign, would make derivatives of beta, which
    follow the rate wherever a loop goes on commanding.
    """
    z = np.column_stack([x, y])
    running = np.concatenate([np.zeros((1, 4, 4)), np.cumsum(z[:, :, None] * z[:, None, :], axis=0)])
    best = 0.0
    for length in BLOCKS:
        for first in (0, length // 2):
            edges = np.arange(first, len(y) + 1, length)
            p = np.diff(running[edges], axis=0)
            with_it, without = (np.maximum(_left(p, count), FLOOR) for count in (3, 2))
            nats = 0.5 * length * np.log(without / with_it) - 0.5 * math.log(length)
            best = max(best, float(np.sum(np.maximum(nats, 0.0))))
    return best


class _Sums:
    """Products summed over any stretch of hops, as differences of running sums."""

    def __init__(self, hops: _Hops) -> None:
        z, r = np.column_stack([hops.x, hops.y]), np.stack([hops.rate - hops.rate.mean()] * 2, axis=1)
        r[:, 1] **= 2
        self._products = np.concatenate([np.zeros((1, z.shape[1], z.shape[1])),
                                         np.cumsum(z[:, :, None] * z[:, None, :], axis=0)])
        self._rates = np.concatenate([np.zeros((1, 2)), np.cumsum(r, axis=0)])

    def likelihoods(self, first: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Return ln L less half ln n for each number fitted, (m, 3), of the equations of KINDS in hops first to
        end - 1, each (m,)."""
        n, p = (end - first).astype(float), self._products[end] - self._products[first]
        mean, squares = (self._rates[end] - self._rates[first]).T / n
        left = np.stack([_left(p, 3), _left(p, 2), n * (squares - mean**2)], axis=1)
        ln_l = -0.5 * n[:, None] * (np.log(2.0 * math.pi * np.maximum(left / n[:, None], FLOOR)) + 1.0)
        return np.asarray(ln_l - 0.5 * np.log(n)[:, None] * np.array([4.0, 3.0, 2.0]))


def _left(p: np.ndarray, count: int) -> np.ndarray:
    """Return the sum of squares (m,) of y that the first `count` regressors leave, from products p (m, q, q)."""
    a, b = p[:, :count, :count], p[:, :count, -1]
    ridge = 1e-10 * np.trace(a, axis1=1, axis2=2)[:, None, None] * np.eye(count)
    xi = np.linalg.solve(a + ridge, b[:, :, None])[:, :, 0]
    return np.asarray(p[:, -1, -1] - np.einsum("mk,mk->m", b, xi))


def _partition(sums: _Sums, count: int) -> list[tuple[int, int, int]]:
    """Return the likeliest stretches (first hop, end, place in KINDS) of all hops, in order."""
    edges = np.unique(np.append(np.arange(0, count, max(1, math.ceil(count / EDGES))), count))
    best, before, kind = np.full(len(edges), -math.inf), np.zeros(len(edges), int), np.zeros(len(edges), int)
    best[0] = 0.0
    for j in range(1, len(edges)):
        starts = np.flatnonzero((edges[j] - edges[:j] >= SHORTEST) & np.isfinite(best[:j]))
        if len(starts):
            total = best[starts, None] - 0.5 * math.log(count) + sums.likelihoods(
                edges[starts], np.full(len(starts), edges[j]))
            k = int(np.argmax(total))
            best[j], before[j], kind[j] = total.flat[k], starts[k // len(KINDS)], k % len(KINDS)
    parts, j = list[tuple[int, int, int]](), len(edges) - 1
    while j > 0:
        parts.append((int(edges[before[j]]), int(edges[j]), int(kind[j])))
        j = int(before[j])
    return parts[::-1]


def _gain(sums: _Sums, first: int, end: int) -> float:
    """Return by how many nats beta explains the stretch better than nothing does."""
    moves, does_not, _ = sums.likelihoods(np.array([first]), np.array([end]))[0]
    return float(moves - does_not)


def _is_idle(hops: _Hops) -> bool:
    """Whether beta explains hardly more than beta of another time of the log: then it is no input of this motion, and
    tells no phase."""
    others = (_explained(np.column_stack([hops.x[:, :2], beta]), hops.y)
              for beta in of_other_times(hops.x[:, 2], OTHER_TIMES))
    return is_placebo(_explained(hops.x, hops.y), others, AHEAD)


def _edge(sums: _Sums, before: list[int], after: list[int]) -> int:
    """Return the likeliest hop at which one stretch (first, end, place in KINDS) ends and the next begins."""
    low, high = before[0] + SHORTEST, after[1] - SHORTEST
    reach = max(1, math.ceil((after[1] - before[0]) / EDGES)) + SHORTEST
    at = np.arange(max(low, before[1] - reach), min(high, before[1] + reach) + 1)
    if not len(at):
        return before[1]
    left = sums.likelihoods(np.full(len(at), before[0]), at)[:, before[2]]
    right = sums.likelihoods(at, np.full(len(at), after[1]))[:, after[2]]
    return int(at[np.argmax(left + right)])


# ---- which stretches are another phase than the reference


def _refined(sums: _Sums, parts: list[tuple[int, int, int]], reference: int) -> list[tuple[int, int, int]]:
    """Return the stretches with their edges where a change from beta's acting to its not acting is likeliest, seen from
    the reference: a stretch that begins too soon holds some of both."""
    edges = [parts[0][0], *(end for _, end, _ in parts)]
    for k in (*range(reference + 1, len(parts)), *range(reference, 0, -1)):
        inner, outer = (0, 1) if k > reference else (1, 0)
        edges[k] = _edge(sums, [edges[k - 1], edges[k], inner], [edges[k], edges[k + 1], outer])
    return [(edges[k], edges[k + 1], kind) for k, (_, _, kind) in enumerate(parts)]


def _labels(hops: _Hops, sums: _Sums, parts: list[tuple[int, int, int]], reference: int) -> list[int]:
    """Return for each stretch the place in KINDS of what it is beyond doubt, MOVES where there is doubt."""
    first, end, _ = parts[reference]
    effect = _effect(hops, first, end)
    known = _share(hops, first, end, effect)
    shares = [_share(hops, *_near(hops, parts, k, reference), effect, known) for k in range(len(parts))]
    acting = [k for k, each in enumerate(shares) if k == reference or (
        each.size - SIGMAS * each.std > WEAKEST and _gain(sums, *parts[k][:2]) > 0.5 * SIGMAS**2)]
    steepest = max(abs(shares[k].beside[1]) for k in acting)
    labels = [0] * len(parts)
    left = hops.y[first:end] - combined(hops.x[first:end], least_squares(hops.x[first:end], hops.y[first:end], 1e-9))
    walk, motion = _walk(left), _walk(np.diff(hops.theta[first:end]))
    behind, is_away = range(acting[-1] + 1, len(parts)), _runs_away(hops, parts[acting[0]][0], parts[acting[-1]][1])
    if not is_away:
        for k in behind:
            shares[k] = _share(hops, *_near(hops, parts, k, reference), effect, known, is_trimmed=False)
    last = acting[-1] + 1 + _first_off([shares[k] for k in behind], is_away)
    swinging = [k for k in behind if not np.ptp(hops.beta[slice(*parts[k][:2])]) and shares[k].swings(steepest)]
    for k in range(min([last, *swinging]), len(parts)):
        labels[k] = 1
    for k in range(acting[0]):   # nothing but a pad comes before the flight
        y, theta = hops.y[slice(*parts[k][:2])], np.diff(hops.theta[slice(*parts[k][:2])])
        is_at_rest = _is_without_walk(y, walk) or (labels[-1] == 1 and _is_without_walk(theta, motion))
        if parts[k][2] == 2 and (_first_off([shares[k]]) == 0 or is_at_rest):
            labels[:k + 1] = [2] * (k + 1)
    return labels


def _effect(hops: _Hops, first: int, end: int) -> float:
    """Return what beta does in a stretch, by least squares."""
    return float(least_squares(hops.x[first:end], hops.y[first:end], 1e-9)[2])


def _near(hops: _Hops, parts: list[tuple[int, int, int]], k: int, reference: int) -> tuple[int, int]:
    """Return the hops of stretch k next to the reference, of which no lag reaches into the stretch before."""
    first, end, _ = parts[k]
    first += hops.reach + 1 if k > 0 else 0
    return (max(first, end - MOST_HOPS), end) if k < reference else (first, min(end, first + MOST_HOPS))


def _first_off(shares: list["_Share"], is_away: bool = False) -> int:
    """Return from which stretch on, counted outward from the reference, another phase begins; len(shares): none does.

    What stretches that follow one another say adds up.  It must decide against an effect like the reference's (ACTING),
    and be against a weak one (WEAKEST) too, which would be a loss of control; but of a vehicle that runs away
    (`is_away`) nobody has control.
    """
    best, first, total, weak, begin = 0.5 * (SIGMAS_AWAY if is_away else SIGMAS)**2, len(shares), 0.0, 0.0, 0
    for k, share in enumerate(shares):
        if total <= 0.0:
            total, weak, begin = 0.0, 0.0, k
        total, weak = total + share.doubt(ACTING), weak + share.doubt(WEAKEST)
        if total > best and (weak > 0.0 or is_away):
            best, first = total, begin
    return first


@dataclass(frozen=True)
class _Share:
    """Of a stretch: beta's effect as a share `size` of that in the reference, with its deviation `std`; the constant
    and the coefficients of theta and rate `beside` it, with the deviation `slope_std` of theta's; `moved`, the share of
    what beta does that is not its sensor's noise; `width`, one sigma of what stands beside in other stretches."""

    size: float
    std: float
    beside: tuple[float, float, float]
    slope_std: float
    moved: float
    width: tuple[float, ...]

    def doubt(self, least: float) -> float:
        """Return the evidence [nats] that no effect acts over one stretch of at least `least`; of one stretch at most
        as many as decide."""
        if not (math.isfinite(self.std) and self.moved > LEAST_MOVED):
            return 0.0
        of_none, of_least = self.size / self.std, max(least * self.moved - self.size, 0.0) / self.std
        return float(np.clip(0.5 * (of_least**2 - of_none**2), -0.5 * SIGMAS**2, 0.5 * SIGMAS**2 + 1.0))

    def swings(self, steepest: float) -> bool:
        """Whether theta is drawn back harder than it acts anywhere where beta acts, as under a parachute."""
        return self.beside[1] + SIGMAS * self.slope_std < -steepest


def _share(hops: _Hops, first: int, end: int, effect: float, reference: _Share | None = None,
           is_trimmed: bool = True) -> _Share:
    """Return beta's effect in hops first to end - 1 as a share of `effect`, under the rate's own noise: a
    random walk, and a sensor's white noise.

    Beside beta stand a constant, theta and the rate.  A loop that goes on commanding moves beta as a sum of the latter
    two: their coefficients are those of the reference, but for a share of what beta does there; the constant too if
    `is_trimmed`, as that of a vehicle is that nothing controls, which no wind holds in balance.
    """
    x, act = hops.x[first:end], effect * hops.x[first:end, 2]
    rate = np.append(hops.rate[first:end], hops.rate[end - 1] + hops.y[end - 1])
    turning = rate[:-1] - hops.rate.mean()
    z, n = np.column_stack([act, x[:, 0], x[:, 1], np.full(len(x), -hops.rate.mean())]), len(x)
    scale = np.sqrt([max(square(each) / n, FLOOR) for each in (act, x[:, 0], x[:, 1], turning)])
    free = _tracked(z, rate, np.asarray(WHITE), np.zeros(4), DIFFUSE / scale)
    best = int(np.argmax(free.ln_l))
    found, noise = free, math.sqrt(max(free.variance[best], FLOOR))
    if reference is not None:
        believed = np.append(0.0, reference.beside)
        width = np.append(DIFFUSE / scale[0], np.array(reference.width) / noise)
        if not is_trimmed:
            believed[1], width[1] = 0.0, DIFFUSE / scale[1]
        found = _tracked(z, rate, np.asarray(WHITE[best:best + 1]), believed, width)
        best = 0
    b, covariance = found.mean[best], found.covariance[best] * noise**2
    unmoved = float(np.mean(hops.noise[first:end])) * (effect / hops.size)**2
    own = act - combined(x[:, :2], least_squares(x[:, :2], act, 1e-9))
    widths = tuple(same * scale[0] / each for same, each in zip((SAME_TRIM, SAME_SLOPE, SAME_DAMPING), scale[1:],
                                                                  strict=True))
    moved = 1.0 - n * unmoved / max(square(own), FLOOR)
    return _Share(float(b[0]), math.sqrt(covariance[0, 0]), (float(b[1]), float(b[2]), float(b[3])),
                  math.sqrt(covariance[2, 2]), moved, widths)


class _Tracked(NamedTuple):
    """What a filter finds: mean (m, 4) and covariance (m, 4, 4) of coefficients, in variances of the walk; variance
    (m,) of the walk; ln_l (m,) of the rates."""

    mean: np.ndarray
    covariance: np.ndarray
    variance: np.ndarray
    ln_l: np.ndarray


def _tracked(z: np.ndarray, rate: np.ndarray, white: np.ndarray, mean: np.ndarray, sigma: np.ndarray) -> _Tracked:
    """Return the coefficients of a rate that wanders, seen with white noise:

        rate_(k+1) = rate_k + z_k b + b_4 rate_k + w_k + MEANS_OVERLAP w_(k-1)

    A loop feeds the sensor's noise back: a regression of the rate's changes on beta would take that for an effect.  The
    filter's rate is what is known before the command, so its innovations are independent of it (Ljung, System
    Identification, 1999, ch. 13).

    z (n, 4)     regressors, the last one the offset of the rate in its own;  rate (n + 1,);  white (m,) variances of
    the rate's noise, each a hypothesis, for a walk of variance 1;  mean, sigma (4,) of the coefficients before
    """
    m, size = len(white), 2 + len(mean)
    x, p = np.zeros((m, size)), np.zeros((m, size, size))
    x[:, 0], x[:, 2:] = rate[0], mean
    p[:, 0, 0] = white
    p[:, range(2, size), range(2, size)] = sigma**2
    step = np.tile(np.eye(size), (m, 1, 1))
    step[:, 1, 1], step[:, 0, 1] = 0.0, MEANS_OVERLAP
    squares, log_determinant = np.zeros(m), np.zeros(m)
    for k in range(len(z)):
        step[:, 0, 2:] = z[k]
        step[:, 0, -1] += x[:, 0]
        x = np.concatenate([np.sum(step[:, 0] * x, axis=1, keepdims=True), np.zeros((m, 1)), x[:, 2:]], axis=1)
        p = step @ p @ step.transpose(0, 2, 1)
        p[:, :2, :2] += 1.0
        variance = p[:, 0, 0] + white
        innovation, gain = rate[k + 1] - x[:, 0], p[:, :, 0] / variance[:, None]
        x = x + gain * innovation[:, None]
        p = p - gain[:, :, None] * p[:, None, 0, :]
        squares += innovation**2 / variance
        log_determinant += np.log(variance)
    n = len(z)
    walk = np.maximum(squares / n, FLOOR)
    return _Tracked(x[:, 2:], p[:, 2:, 2:], walk, -0.5 * (n * np.log(walk) + log_determinant))


def _walk(e: np.ndarray) -> float:
    """Return the variance by which changes e (n,) wander in a hop, of the rate beside what beta explains or of theta:
    the part that neighbours do not share; the lower quartile of its blocks, so that no manoeuvre counts."""
    blocks = np.array_split(e, max(1, len(e) // SHORTEST))
    return float(np.quantile([np.mean(each**2) + 2.0 * np.mean(each[1:] * each[:-1]) for each in blocks], 0.25))


def _runs_away(hops: _Hops, first: int, end: int) -> bool:
    """Whether attitude or rate leave, behind a stretch, their range in it: nothing controls the vehicle."""
    for x in (hops.x[:, 1], hops.rate):
        low, high = float(np.min(x[first:end])), float(np.max(x[first:end]))
        if np.any(x[end:] < low - AWAY * (high - low)) or np.any(x[end:] > high + AWAY * (high - low)):
            return True
    return False


def _whitened(z: np.ndarray, shared: float) -> tuple[np.ndarray, float]:
    """Return (z (n, k) with its rows made independent, ln of the determinant) for noise of variance 1 of which each row
    shares -`shared` with the next: the factors of a tridiagonal matrix."""
    if shared == 0.0:
        return z, 0.0
    out, root, before, log_determinant = np.empty_like(z), np.empty(len(z)), 1.0, 0.0
    for k in range(len(z)):
        now = 1.0 - (shared**2 / before if k > 0 else 0.0)
        out[k] = z[k] + (shared / before * out[k - 1] if k > 0 else 0.0)
        root[k], before = math.sqrt(now), now
        log_determinant += math.log(now)
    return out / root[:, None], log_determinant


def _is_without_walk(y: np.ndarray, walk: float) -> bool:
    """Whether changes y (n,) of rate or theta are a sensor's white noise alone, without a walk of at least CALM times
    the variance `walk`, that of the reference: what moves a vehicle in flight is missing on the pad.  An engine that
    runs may shake the gyro there, but not the attitude; and a friction may hold a vehicle, so that of a log which ends
    in flight the rate decides."""
    if not walk > 0.0:
        return False
    y, n = y[:, None], len(y)
    white, log_determinant = _whitened(y, MOST_SHARED)
    at_rest = -0.5 * n * (math.log(max(square(white[:, 0]) / n, FLOOR)) + 1.0) - 0.5 * log_determinant
    flying = -math.inf
    for shared in SHARED:
        white, log_determinant = _whitened(y, shared)
        variance = max(CALM * walk / (1.0 - 2.0 * shared), square(white[:, 0]) / n)
        flying = max(flying, -0.5 * (square(white[:, 0]) / variance + n * math.log(variance) + log_determinant))
    return at_rest - flying > 0.5 * SIGMAS**2


def _words(hops: _Hops, first: int, end: int, label: int) -> str:
    """Return what a phase is, in words."""
    return STILL if label == 1 and not np.ptp(hops.beta[first:end]) else KINDS[label]


# ---- the log of the flown phase


def checked_flight(log: Log, nominal: Nominal | None = None, *, strict: bool = False,
                   refuse_columns: bool = False) -> CheckedLog:
    """Check a log as `check.checked`, cut to the phase in which beta moves the vehicle; a log whose rows a user chose,
    or that has one phase alone, stays whole.  A note says which phases there are and which is used."""
    seen = checked(log, nominal)
    part, said = _flight(log, seen)
    if said is None:
        return checked(log, nominal, strict=strict, refuse_columns=refuse_columns) if strict or refuse_columns else seen
    made = checked(part, nominal, strict=strict, refuse_columns=refuse_columns)
    return replace(made, mended=(said, *made.mended))


def flight_of(log: Log, nominal: Nominal | None = None) -> tuple[Log, tuple[str, ...]]:
    """Return (the rows of a log in which beta moves the vehicle, a line that says so); the whole log and () if a user
    chose its rows, or it has one phase alone."""
    part, said = _flight(log, checked(log, nominal))
    return part, () if said is None else (f"{log.path}: {said.message}",)


def _flight(log: Log, seen: CheckedLog) -> tuple[Log, Fault | None]:
    """Return (the flown rows of a log, what says so); (log, None) if they are all."""
    phases = [] if log.is_chosen else phases_of(seen.log, seen.data)
    phase = flown_phase(phases)
    if phase is None:
        return log, None
    return Cut(phase.first, phase.last, True).of(log), Fault(
        "phases", None, phase.first, phase.last, 0, f"{words_of(phases)}; used: {phase.first:.6g} to {phase.last:.6g}"
                                                    " s (all rows: --from start)")


def words_of(phases: list[Phase]) -> str:
    """Return phases in one line: `the pad holds it to 3 s, beta moves the vehicle to 7.48 s, ...`."""
    return ", ".join(f"{each.kind} from {each.first:.6g} to {each.last:.6g} s" for each in phases)


def phase_note(raw: Log, log: Log, data: DataCheck) -> tuple[str, ...]:
    """Return one line that says a log's phases and how to use the flown one alone; () of one phase, or rows that a user
    chose.  raw, log, data: the log as it was read, as it was mended, its data check."""
    phases = [] if raw.is_chosen else phases_of(log, data)
    phase = flown_phase(phases)
    if phase is None:
        return ()
    return (f"{raw.path}: {words_of(phases)}: --from {phase.first:.6g} --to {phase.last:.6g} uses the flight alone",)
