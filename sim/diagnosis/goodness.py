"""Is the named cause believable?  Fit and whiteness do not stop a wrong name; these tests do.

* Constancy: the size of a true cause is the same in every part of the log (score test over segments of equal
  information; Nyblom 1989, Andrews 1993 for the idea).
* Generic discrepancy: a stochastic disturbance of any colour, in the plant, at the actuator or on a sensor, a
  deterministic shape (`shapes`), or a line must find nothing worth its place beside the causes.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .fit import Problem
from .noise import Disturbance, Refilter, fit_levels
from .record import CHANNELS, Record
from .scan import _norms, lines
from .selection import Model
from .shapes import shape_gains

SEGMENTS = 8
CONSTANCY_LIMIT = 40.0     # chi-squared of 7 degrees of freedom: true causes reached 31, foreign ones began at 47
LEFTOVER_LIMIT = 10.0      # nats: true causes left 1, unlisted ones 13 and more
SHAPE_LIMIT = 11.0         # nats of one of forty shapes, or of a line at a mode: noise reaches it once in 1e4 logs
CREEP_LIMIT = 15.0         # nats of a shape that grows with time: a size that creeps by some per cent is that cause's
LINE_LIMIT = 17.0          # nats of one of some thousand lines: as often
OWN_BINS = 3.0             # of the log's resolution, within which a line is at a mode: no mode is driven by itself
MODES = ("slosh", "bending")
BINS = 1.0                 # of the log's resolution, within which a line is a harmonic
LINE = "sin"               # what the shape of a line begins with
TIME = "time"              # what stands in the shape of a drift
TIME_CONSTANTS = (0.3, 2.0, 15.0)   # s
SIZES = {"plant": (2e-4, 0.3), "actuator": (5e-5, 0.05), "theta": (3e-5, 0.05), "theta_dot": (3e-5, 0.05),
         "beta": (3e-5, 0.05)}  # rad/s^2, rad, rad, rad/s, rad: standard deviations searched
COARSE = 5                 # sizes of a first look, evenly over the logarithm
WORTH_A_SEARCH = 0.5       # nats of the best of them
EVALUATIONS = 4            # of a golden-section search between its neighbours
RELEVELLED = 2.0           # nats from which the noise levels are fitted anew beside the disturbance
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
PLACE_OF = {"plant": "plant", "actuator": "actuator", "theta": "sensor", "theta_dot": "sensor", "beta": "sensor"}


@dataclass(frozen=True)
class Constancy:
    """Size of one cause per segment.

    t      (9,) [s] the segments' ends;  size, std (8,) of the size in each
    """

    chi_squared: float
    t: tuple[float, ...]
    size: tuple[float, ...]
    std: tuple[float, ...]


def constancy(model: Model, index: int) -> Constancy:
    """Is the size of cause `index` the same all along?"""
    fitted = model.fit
    column = sum(len(cause.values) for cause in fitted.causes[:index])
    slopes, r = fitted.slopes, fitted.whitened.ravel()
    own = slopes[:, column]
    others = np.delete(slopes, column, axis=1)
    basis, _ = np.linalg.qr(others / _norms(others))
    own = own - basis @ (basis.T @ own)
    rows = len(fitted.whitened)
    energy = np.sum((own * own).reshape(rows, -1), axis=1)
    score = np.sum((own * r).reshape(rows, -1), axis=1)
    total = np.cumsum(energy)
    cuts = [0, *np.searchsorted(total, total[-1] * np.arange(1, SEGMENTS) / SEGMENTS), rows]
    t = fitted.record.t
    information = np.array([energy[a:b].sum() for a, b in itertools.pairwise(cuts)])
    slope = np.array([score[a:b].sum() for a, b in itertools.pairwise(cuts)])
    information = np.maximum(information, 1e-12 * total[-1] + 1e-300)
    moved = -slope / information
    chi = float(np.sum(slope**2 / information) - np.sum(slope)**2 / np.sum(information))
    value = fitted.causes[index].values[0]
    size = fitted.causes[index].hypothesis.free[0]
    sizes = value * np.exp(moved) if size.logarithmic else value + moved
    spread = 1.0 / np.sqrt(information) * (value if size.logarithmic else 1.0)
    ends = [float(t[min(c, rows - 1)]) for c in cuts]
    return Constancy(chi, tuple(ends), tuple(map(float, sizes)), tuple(map(float, spread)))


@dataclass(frozen=True, eq=False)
class Leftover:
    """What a generic disturbance at one place gains [nats] beside the model.

    shape    "" for a stochastic one, else the signal it is proportional to (then `std` is its RMS)
    at_mode  a line at the frequency of a named mode
    """

    disturbance: Disturbance
    gain: float
    shape: str = ""
    at_mode: bool = False

    @property
    def where(self) -> str:
        return PLACE_OF[self.disturbance.place]

    @property
    def is_line(self) -> bool:
        return self.shape.startswith(LINE)

    @property
    def limit(self) -> float:
        """[nats] that may be left."""
        if self.is_line and not self.at_mode:
            return LINE_LIMIT
        if TIME in self.shape:
            return CREEP_LIMIT
        return SHAPE_LIMIT if self.shape else LEFTOVER_LIMIT

    @property
    def words(self) -> str:
        """What it looks like."""
        return f"proportional to {self.shape}" if self.shape else "of unknown shape"


def leftovers(model: Model) -> list[Leftover]:
    """Of every place the log can show the stochastic disturbance and the shape that gain most, the best first."""
    record = model.fit.record
    places = ["plant", *(["actuator"] if record.command_is_known else []), *record.channels]
    found = []
    for place in places:
        tried = [_best_size(record, model, place, tau) for tau in TIME_CONSTANTS]
        found.append(max(tried, key=lambda leftover: leftover.gain))
    found = [_relevelled(record, model, each) if each.gain > RELEVELLED else each for each in found]
    return sorted([*found, *_shaped(model)], key=lambda leftover: -leftover.gain)


def _shaped(model: Model) -> list[Leftover]:
    """The shape of each place that gains most, and the strongest line of the acceleration."""
    best: dict[str, Leftover] = {}
    problem = Problem(model.fit.record, model.fit.filter)
    for place, name, amplitude, gain in shape_gains(problem, model.fit):
        best.setdefault(place, Leftover(Disturbance(place, abs(amplitude), math.inf), gain, name))
    found = list(best.values())
    known = [cause.values[1] for cause in model.causes if cause.hypothesis.cause == "periodic_disturbance"]
    resolution = BINS * 2.0 * math.pi / (model.fit.record.rows * model.fit.record.period)
    foreign = [line for line in lines(problem, model.fit)
               if not any(_is_harmonic(line.values[1], base, resolution) for base in known)]
    modes = [cause.values[1] for cause in model.causes if cause.hypothesis.cause in MODES]
    left = []
    for line in foreign:
        amplitude, frequency, _ = line.values
        of = Disturbance("plant", amplitude / math.sqrt(2.0), math.inf)
        at_mode = any(abs(frequency - mode) < OWN_BINS / BINS * resolution for mode in modes)
        left.append(Leftover(of, line.gain, f"{LINE}({frequency:.4g} t)", at_mode))
    return [*found, *sorted(left, key=lambda line: line.limit - line.gain)[:1]]


def _is_harmonic(frequency: float, base: float, resolution: float) -> bool:
    """A multiple of a named line, within what the log resolves [rad/s]: what is periodic need not be a sine."""
    multiple = round(frequency / base)
    return multiple > 1 and abs(frequency - multiple * base) < resolution


def _relevelled(record: Record, model: Model, leftover: Leftover) -> Leftover:
    """The gain when the noise levels may give way to the disturbance."""
    fitted = model.fit
    filt = fit_levels(record, model.dynamics, fitted.innovations, fitted.filter, fitted.filter.levels,
                      leftover.disturbance)
    gain = filt.log_likelihood - _refilter(record, model).log_likelihood(fitted.filter.levels)
    return Leftover(leftover.disturbance, max(gain, leftover.gain))


def _refilter(record: Record, model: Model) -> Refilter:
    return Refilter(record, model.dynamics, model.fit.innovations, model.fit.filter)


def _best_size(record: Record, model: Model, place: str, tau: float) -> Leftover:
    """The standard deviation that gains most: a coarse look, and where it gains anything a golden-section search."""
    levels, refilter = model.fit.filter.levels, _refilter(record, model)
    base = refilter.log_likelihood(levels)

    def gain(x: float) -> float:
        return refilter.log_likelihood(levels, Disturbance(place, math.exp(x), tau)) - base

    grid = np.linspace(*(math.log(size) for size in SIZES[place]), COARSE)
    looked = [gain(x) for x in grid]
    k = int(np.argmax(looked))
    low, high = grid[max(k - 1, 0)], grid[min(k + 1, COARSE - 1)]
    best = looked[k], grid[k]
    if looked[k] > WORTH_A_SEARCH:
        best = max(best, _golden(gain, low, high))
    return Leftover(Disturbance(place, math.exp(best[1]), tau), max(best[0], 0.0))


def _golden(gain: Callable[[float], float], low: float, high: float) -> tuple[float, float]:
    """(gain, place) of the maximum between low and high."""
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at_left, at_right = gain(left), gain(right)
    for _ in range(EVALUATIONS):
        if at_left > at_right:
            high, right, at_right = right, left, at_left
            left = high - GOLDEN * (high - low)
            at_left = gain(left)
        else:
            low, left, at_left = left, right, at_right
            right = low + GOLDEN * (high - low)
            at_right = gain(right)
    return max((at_left, left), (at_right, right))


# ---- whiteness


@dataclass(frozen=True, eq=False)
class Correlation:
    """Correlations of whitened innovations at positive lags: `values` (lags,) of `channel` with `with_channel`'s past.

    band  half-width that 99 % of a white sequence's correlations stay within
    """

    channel: str
    with_channel: str
    values: np.ndarray
    band: float


LAGS = 25
BAND_99 = 2.576


def correlations(whitened: np.ndarray, lags: int = LAGS) -> list[Correlation]:
    """Auto- and cross-correlations of every measured pair."""
    measured = [k for k in range(3) if np.any(whitened[:, k] != 0.0)]
    n = len(whitened)
    found = []
    for a in measured:
        for b in measured:
            x, y = whitened[:, a], whitened[:, b]
            scale = math.sqrt(float(x @ x) * float(y @ y)) or 1.0
            values = np.array([float(x[lag:] @ y[:n - lag]) / scale for lag in range(1, lags + 1)])
            found.append(Correlation(CHANNELS[a], CHANNELS[b], values, BAND_99 / math.sqrt(n)))
    return found

