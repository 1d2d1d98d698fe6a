"""Margins of a loop that is known with a covariance: value, standard deviation, 95 % interval.

The loop's a6, k1, its servo's natural frequency, damping ratio and delay, its damping and the numbers of a law that was
fitted are normally distributed.  A margin is no
linear function of them: the phase has a ridge where the gain is the best, the low gain margin in dB has none where a6
is 0, an unstable loop has none at all.  So the interval is that of the profile likelihood: the least and
the greatest margin over the ellipsoid of INTERVAL standard deviations.  It is exact for whatever is a straight line in
the parameters, as a limit on a6/k1 is (Fieller, JRSS B 16, 1954), to second order for whatever is not (Hasofer and
Lind, J. Eng. Mech. Div. 100, 1974, call the same distance the reliability index), and it is the same for a margin in dB
or as a factor.  The extremes are sought among quasi-random points of the ellipsoid and climbed to from the best ones.

An unstable loop keeps no margin: all are 0.  Where nothing limits a margin it is infinite, the low gain margin of
a stable plant -inf dB.

`gain_low_db` is below 0: by so much may the gain fall, as in `margins`.
"""

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np

from sim.nominal import Controller
from sim.sections import Required

from ..controller.law import Law
from ..formatting import json_number
from .blocks import NOTHING_FURTHER, Further, Mode, Plants, plants_of
from .loops import Loops, loops
from .margins import NEAR_PEAK, crossings, disk_margin, frequency_grid, gain_margins, modulus_margin, phase_margins


class Margin(NamedTuple):
    """Name and unit of a margin, the key of [margins] that requires it ("": none), the sign in which more is better (-1
    or 1)."""

    words: str
    unit: str
    required: str
    sign: float = 1.0


MARGINS = {"gain_low_db": Margin("low gain margin", "dB", "gain_db", -1.0),
           "gain_high_db": Margin("high gain margin", "dB", "gain_db"),
           "phase_deg": Margin("phase margin", "degrees", "phase_deg"),
           "delay_ms": Margin("delay margin", "ms", "delay_ms"),
           "modulus_margin": Margin("modulus margin", "", ""),
           "disk_margin": Margin("disk margin", "", "")}
MARGIN_NAMES = tuple(MARGINS)
INTERVAL = 1.96        # standard deviations: 95 %
INSIDE = 48            # quasi-random points of the distribution
ON_ELLIPSOID = 48      # and on the ellipsoid
MODULUS_ZOOMS = 2      # of the modulus margin's minimum: to 1e-6 of it
CLIMBS = 2             # of each extreme, each to where the last slope points
SLOPE_STEP = 0.05      # standard deviations: of a slope's difference
STABLE_WITHIN = 4.0    # standard deviations: where no loop is unstable within them, the loop is stable
# of ln frequency: a crossing so near a mode is the mode's; slosh is a pole beside a zero, beyond which it is not seen
NEAR_BENDING, NEAR_SLOSH = math.log(1.25), math.log(1.05)
RIGID = ("gain_low_db", "gain_high_db", "phase_deg")   # margins of the crossings that are no mode's
MANY = 2048            # points that count how probable it is, where one is
KNOWN_DIRECTION = 1e-12  # of the largest share of the spread: below it a direction is known

Judge = Callable[[np.ndarray], np.ndarray]


class Interval(NamedTuple):
    """A margin: value at the estimate, standard deviation (NaN if some possible loop's is infinite), ends low, high of
    its 95 % interval; infinite where nothing limits it."""

    value: float
    std: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Known:
    """What is known of a loop: mean (k,) and covariance (k, k) of its numbers.

    The first `count` are the plant's: a6, k1 [1/s^2], the servo's natural frequency [rad/s], damping ratio and delay
    [s], and, if there are more, the damping of its rate [1/s], then frequency [rad/s] and size of each of its modes;
    the others those of a law that was fitted.
    """

    mean: np.ndarray
    covariance: np.ndarray
    count: int = 5
    is_first_order: bool = False      # the servo
    modes: tuple[Mode, ...] = ()
    laws: Callable[[np.ndarray], Law] | None = None   # of rows of the further numbers
    gain: float = 1.0                 # times the law's commands
    further: Further = NOTHING_FURTHER   # what is in the loop besides, and known

    def plants(self, numbers: np.ndarray) -> Plants:
        """Return the plants of rows of the plant's numbers (m, count)."""
        return plants_of(numbers, self.is_first_order, self.modes, self.further)

    def loops(self, numbers: np.ndarray, controller: Controller | Law, kp: float | None = None,
              kd: float | None = None) -> Loops:
        """Return the loops of rows of numbers (m, k) with a controller, or with the fitted law if they hold one."""
        if self.laws is not None and numbers.shape[1] > self.count:
            controller = self.laws(numbers[:, self.count:])
        if isinstance(controller, Law):
            controller = controller.times(self.gain)
        return loops(self.plants(numbers[:, :self.count]), controller, kp, kd)


class Crossing(NamedTuple):
    """Where L crosses the unit circle (kind "phase": margin [deg], by which it is off -180 degrees) or the negative
    real axis (kind "gain": margin [dB], the factor on the gain that makes it -1), at `frequency` [rad/s]; of the rigid
    body or of a mode, by name, whose frequency is near."""

    kind: str
    frequency: float
    margin: float
    of: str


class ModeMargin(NamedTuple):
    """A mode in the loop: how far its peak is below 1 [dB] (gain stabilised where that is above 0), and the least phase
    margin [deg] where its peak crosses 1 (else phase stabilised; infinite where nothing crosses)."""

    name: str
    gain_db: Interval
    phase_deg: Interval

    @property
    def is_gain_stabilised(self) -> bool:
        return self.gain_db.value > 0.0

    @property
    def json(self) -> dict[str, Any]:
        """Which margin holds it, and both with their intervals."""
        return {"stabilised": "gain" if self.is_gain_stabilised else "phase",
                **{key: {end: json_number(x) for end, x in getattr(self, key)._asdict().items()}
                   for key in ("gain_db", "phase_deg")}}


@dataclass(frozen=True)
class Spread:
    """Margins of a loop that is known with a covariance, and the probability `stable` that it is stable.

    crossings  of the estimate: where L crosses the unit circle and the negative real axis;  worst (w, k) numbers at
    which one of the required margins is at the worse end of its interval
    """

    gain_low_db: Interval
    gain_high_db: Interval
    phase_deg: Interval
    delay_ms: Interval
    modulus_margin: Interval
    disk_margin: Interval
    stable: float          # the probability that the loop is
    crossings: tuple[Crossing, ...] = ()
    rigid: tuple[Interval, ...] = ()   # of a loop with modes: RIGID of the crossings that are no mode's
    modes: tuple["ModeMargin", ...] = ()
    worst: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)), compare=False, repr=False)

    @property
    def ms(self) -> float:
        """The largest sensitivity 1/|1 + L|; inf of an unstable loop."""
        return 1.0 / self.modulus_margin.value if self.modulus_margin.value > 0.0 else math.inf

    def ends(self, name: str) -> tuple[float, float]:
        """Return (worse, better) end of margin `name`'s 95 % interval, its sign turned so that more is better."""
        interval = getattr(self, name)
        return (-interval.high, -interval.low) if MARGINS[name].sign < 0.0 else (interval.low, interval.high)

    def below(self, required: Required) -> dict[str, bool]:
        """Return margin name -> whether its whole interval misses `required`; only margins whose worse end does."""
        misses = {}
        for name, margin in MARGINS.items():
            if not margin.required:
                continue
            demand, (least, most) = getattr(required, margin.required), self.ends(name)
            if least < demand:
                misses[name] = most < demand
        return misses


def grid_of(many: Loops) -> np.ndarray:
    """Return the grid (p,) [rad/s] of m loops, or (m, p), each its own, where their modes lie apart."""
    omega = frequency_grid(many.period, (float(np.max(many.whole)) + 1.0) * many.period, many.peaks)
    centres = many.centres
    if centres is None or not np.ptp(centres, axis=0).any():
        return omega
    own = (centres[:, :, None] * np.exp(np.concatenate([-NEAR_PEAK, [0.0], NEAR_PEAK]))).reshape(len(centres), -1)
    common = np.broadcast_to(omega, (len(centres), len(omega)))
    return np.sort(np.concatenate([common, np.clip(own, omega[0], omega[-2])], axis=1), axis=1)


def margin_table(many: Loops, modes: tuple[Mode, ...] = ()) -> np.ndarray:
    """Return margins (m, 6) of m loops in order of MARGIN_NAMES: 0 if unstable, infinite where nothing limits one.

    modes: with them (m, 9 + 2 k), also those of RIGID, then of each of k modes the margin [dB] by which its peak is
    below 1 and the least phase margin [deg] where its peak crosses 1
    """
    omega = grid_of(many)
    gain = many.gain(omega)
    low, high = gain_margins(many, omega, gain, many.static)
    phase, delay = phase_margins(many, omega, gain)
    modulus, disk = (of(many, omega, gain, MODULUS_ZOOMS) for of in (modulus_margin, disk_margin))
    with np.errstate(divide="ignore"):
        table = np.column_stack([20.0 * np.log10(low), 20.0 * np.log10(high), np.degrees(phase), 1e3 * delay, modulus,
                                 disk])
    if modes:
        table = np.column_stack([table, *_by_owner(many, modes, omega, gain)])
    table[~many.stable()] = 0.0
    return table


def _by_owner(many: Loops, modes: tuple[Mode, ...], omega: np.ndarray, gain: np.ndarray) -> list[np.ndarray]:
    """Return the columns of `margin_table` beyond those of MARGIN_NAMES; omega, gain as there."""
    assert many.centres is not None
    count, every = len(gain), np.broadcast_to(omega, gain.shape)

    def of(k: int, which: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Whether frequencies `at` [rad/s] of loops `which` are mode k's."""
        near = NEAR_BENDING if modes[k].is_bending else NEAR_SLOSH
        assert many.centres is not None
        return np.abs(np.log(at / many.centres[which, k])) < near

    on, on_omega, on_gain = crossings(many, lambda x: x.real**2 + x.imag**2 - 1.0, omega, gain)
    axis, axis_omega, axis_gain = crossings(many, np.imag, omega[..., :-1], gain[:, :-1])
    with np.errstate(divide="ignore"):
        factor, phase = -1.0 / axis_gain.real, np.degrees(np.abs(np.angle(-on_gain)))
    owned = [(of(k, on, on_omega), of(k, axis, axis_omega)) for k in range(len(modes))]
    free, free_axis = (~np.any(each, axis=0) for each in zip(*owned, strict=True))
    low, high = np.zeros(count), np.full(count, np.inf)
    static = np.where(many.static < 1.0, many.static, 0.0)
    np.maximum(low, static, out=low, where=static > 0.0)
    falls, rises = free_axis & (factor < 1.0), free_axis & (factor > 1.0)
    np.maximum.at(low, axis[falls], factor[falls])
    np.minimum.at(high, axis[rises], factor[rises])

    def least(taken: np.ndarray) -> np.ndarray:
        found = np.full(count, np.inf)
        np.minimum.at(found, on[taken], phase[taken])
        return found

    with np.errstate(divide="ignore"):
        columns = [20.0 * np.log10(low), 20.0 * np.log10(high), least(free)]
        for k in range(len(modes)):
            there = np.abs(np.log(np.maximum(every, omega[..., :1]) / many.centres[:, k:k + 1])) < NEAR_SLOSH
            columns += [-20.0 * np.log10(np.max(np.abs(gain) * there, axis=1)), least(owned[k][0])]
    return columns


def crossings_of(many: Loops, modes: tuple[Mode, ...]) -> tuple[Crossing, ...]:
    """Return the crossings of the first loop, by frequency; a crossing near a mode is the mode's."""
    one = many.take(np.arange(1))
    omega = grid_of(one)
    gain = one.gain(omega)

    def owner(frequency: float) -> str:
        assert one.centres is not None or not modes
        off = [] if one.centres is None else np.abs(np.log(one.centres[0] / frequency)).tolist()
        near = [(x, mode.name) for x, mode in zip(off, modes, strict=True)
                if x < (NEAR_BENDING if mode.is_bending else NEAR_SLOSH)]
        return min(near)[1] if near else "rigid"

    _, on_circle, at_circle = crossings(one, lambda x: x.real**2 + x.imag**2 - 1.0, omega, gain)
    _, on_axis, at_axis = crossings(one, np.imag, omega[:-1], gain[:, :-1])
    found = [Crossing("phase", w, math.degrees(np.angle(-x)), owner(w))
             for w, x in zip(on_circle.tolist(), at_circle.tolist(), strict=True)]
    found += [Crossing("gain", w, -20.0 * math.log10(-x.real), owner(w))
              for w, x in zip(on_axis.tolist(), at_axis.tolist(), strict=True) if x.real < 0.0]
    return tuple(sorted(found, key=lambda each: each.frequency))


def margin_spread(known: Known, controller: Controller | Law, kp: float | None = None,
                  kd: float | None = None) -> Spread:
    """Return margins with 95 % intervals of a loop, from mean and covariance; kp, kd [s] replace the controller's."""
    root = _root(known.covariance)
    count = root.shape[1]

    def loops_at(u: np.ndarray) -> Loops:
        return known.loops(known.mean + u @ root.T, controller, kp, kd)

    def judge(u: np.ndarray) -> np.ndarray:
        return margin_table(loops_at(u), known.modes)

    def made(intervals: list[Interval]) -> dict[str, Any]:
        """Return the fields of `Spread` for the columns of `margin_table`."""
        named = dict(zip(MARGIN_NAMES, intervals, strict=False))
        first = len(MARGIN_NAMES) + len(RIGID)
        own = [ModeMargin(mode.name, *intervals[first + 2 * k:first + 2 * k + 2])
               for k, mode in enumerate(known.modes)]
        return {**named, "rigid": tuple(intervals[len(MARGIN_NAMES):first]), "modes": tuple(own)}

    crossing = crossings_of(loops_at(np.zeros((1, count))), known.modes)
    if count == 0:
        value = judge(np.zeros((1, 0)))[0]
        return Spread(**made([Interval(x, 0.0, x, x) for x in value.tolist()]),
                      stable=float(loops_at(np.zeros((1, 0))).stable()[0]), crossings=crossing, worst=known.mean[None])
    inside, on = normal_points(INSIDE, count), INTERVAL * _unit(normal_points(ON_ELLIPSOID, count))
    points = np.concatenate([np.zeros((1, count)), inside, on])
    table = judge(points)
    low, high, at_low, at_high = _extremes(judge, points, table)
    with np.errstate(invalid="ignore"):
        std = np.std(table[1:1 + INSIDE], axis=0)
    intervals = [Interval(*map(float, each)) for each in zip(table[0], std, low, high, strict=True)]
    stable = 1.0
    if not loops_at(STABLE_WITHIN * _unit(normal_points(ON_ELLIPSOID, count))).stable().all() \
            or not table.any(axis=1).all():
        stable = float(np.mean(loops_at(normal_points(MANY, count)).stable()))
    worst = [(at_low if each.sign > 0.0 else at_high)[k] for k, each in enumerate(MARGINS.values()) if each.required]
    return Spread(**made(intervals), stable=stable, crossings=crossing,
                  worst=known.mean + np.array([np.zeros(count), *worst]) @ root.T)


def joined(spreads: Sequence[Spread]) -> Spread:
    """Return the first of some spreads with intervals that hold those of all: laws that the log cannot tell apart."""
    if len(spreads) == 1:
        return spreads[0]
    intervals = {}
    for name in MARGIN_NAMES:
        every = [getattr(each, name) for each in spreads]
        intervals[name] = every[0]._replace(low=min(x.low for x in every), high=max(x.high for x in every))
    return replace(spreads[0], **intervals, stable=min(each.stable for each in spreads))


def ellipsoid(known: Known, count: int) -> np.ndarray:
    """Return `count` parameter sets (count, k) on the ellipsoid of INTERVAL standard deviations about the mean."""
    root = _root(known.covariance)
    if root.shape[1] == 0:
        return np.tile(known.mean, (count, 1))
    return known.mean + INTERVAL * _unit(normal_points(count, root.shape[1])) @ root.T


def _root(covariance: np.ndarray) -> np.ndarray:
    """Return a square root (5, d) of the covariance, one column for each of the d directions that are uncertain."""
    std = np.sqrt(np.diag(covariance))
    scale = np.where(std > 0.0, std, 1.0)
    share, direction = np.linalg.eigh(covariance / np.outer(scale, scale))
    open_ = share > KNOWN_DIRECTION * max(float(share[-1]), KNOWN_DIRECTION)
    return scale[:, None] * direction[:, open_] * np.sqrt(share[open_])


def _unit(points: np.ndarray) -> np.ndarray:
    """Return points (n, d), each scaled to the unit sphere."""
    return points / np.linalg.norm(points, axis=1, keepdims=True)


@functools.cache
def normal_points(count: int, dimensions: int) -> np.ndarray:
    """Return points (count, dimensions) of a standard normal distribution, evenly spread, read-only: each with its
    mirror image, of unit covariance, by the golden ratio's generalised additive sequence (Roberts 2018) and normal
    quantiles."""
    ratio = 2.0
    for _ in range(64):
        ratio = (1.0 + ratio) ** (1.0 / (dimensions + 1.0))
    half = count // 2
    uniform = (0.5 + np.outer(np.arange(1, half + 1), ratio ** -np.arange(1.0, dimensions + 1.0))) % 1.0
    quantile = NormalDist().inv_cdf
    points = np.array([[quantile(x) for x in row] for row in uniform.tolist()])
    points = np.concatenate([points, -points])
    points = points @ np.linalg.inv(np.linalg.cholesky(points.T @ points / len(points))).T
    points.flags.writeable = False
    return points


def _extremes(judge: Judge, points: np.ndarray,
              table: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return least and greatest (e,) of each margin over the ball of INTERVAL standard deviations, and where (e, d).

    judge  points -> margins;  points (n, d) to start from, those outside the ball left out;  table (n, e) margins there
    """
    within = np.linalg.norm(points, axis=1) <= INTERVAL * (1.0 + 1e-9)
    points, table = points[within], table[within]
    ends, dimensions = table.shape[1], points.shape[1]
    column, sign = np.tile(np.arange(ends), 2), np.repeat([-1.0, 1.0], ends)
    at = points[np.concatenate([np.argmin(table, axis=0), np.argmax(table, axis=0)])]
    best = np.concatenate([table.min(axis=0), table.max(axis=0)])
    around = SLOPE_STEP * np.concatenate([np.eye(dimensions), -np.eye(dimensions)])
    every = np.arange(2 * ends)
    for _ in range(CLIMBS):
        rim = np.linalg.norm(at, axis=1) > INTERVAL * (1.0 - 1e-9)  # an extreme inside has no slope
        near = judge((at[:, None] + around).reshape(-1, dimensions)).reshape(2 * ends, 2 * dimensions, ends)
        beside = near[every, :, column]
        with np.errstate(invalid="ignore", divide="ignore"):
            slope = sign[:, None] * (beside[:, :dimensions] - beside[:, dimensions:])
            target = INTERVAL * _unit(slope)
        can = rim & np.isfinite(target).all(axis=1)
        target[~can] = at[~can]
        value = judge(target)[every, column]
        better = can & (sign * value > sign * best)
        at, best = np.where(better[:, None], target, at), np.where(better, value, best)
    return best[:ends], best[ends:], at[:ends], at[ends:]
