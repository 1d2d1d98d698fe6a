"""The search for something left that the named causes do not explain.

A stochastic disturbance of any colour, in the plant, at the actuator or on a sensor, a deterministic shape (`shapes`),
or a line must find nothing worth its place beside them.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..data.record import Record
from ..model.lanes import LANES
from ..model.level_fit import fit_levels
from ..model.noise import Disturbance, Refilter, largest, nothing_foreseen
from ..model.nuisance import Problem
from ..search.profile import Model
from ..search.scan import lines
from .shapes import shape_gains

LEFTOVER_LIMIT = 10.0      # nats: true causes left 1, unlisted ones 13 and more
SHAPE_LIMIT = 11.0         # nats of one of forty shapes, or of a line at a mode: noise reaches it once in 1e4 logs
CREEP_LIMIT = 15.0         # nats of a shape that grows with time: a size that creeps by some per cent is that cause's
LINE_LIMIT = 17.0          # nats of one of some thousand lines: as often
OWN_BINS = 3.0             # of the log's resolution, within which a line is at a mode: no mode is driven by itself
LINE = "sin"               # what the shape of a line begins with
TIME = "time"              # what stands in the shape of a drift
TIME_CONSTANTS = (0.3, 2.0, 15.0)   # s
SMALLEST = 7e-4            # of the largest standard deviation searched (`noise.largest`)
WORTH_A_SEARCH = 0.5       # nats of the best of them
RELEVELLED = 2.0           # nats from which the noise levels are fitted anew beside the disturbance
PLACE_OF = {"plant": "plant", "actuator": "actuator", "theta": "sensor", "theta_dot": "sensor", "beta": "sensor"}


@dataclass(frozen=True, eq=False)
class Leftover:
    """The gain [nats] of a generic disturbance at one place beside the model.

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
        """The gain [nats] that may be left."""
        if self.is_line and not self.at_mode:
            return LINE_LIMIT
        if TIME in self.shape:
            return CREEP_LIMIT
        return SHAPE_LIMIT if self.shape else LEFTOVER_LIMIT

    @property
    def words(self) -> str:
        """The shape of the disturbance in words."""
        return f"proportional to {self.shape}" if self.shape else "of unknown shape"


def leftovers(model: Model) -> list[Leftover]:
    """The stochastic disturbance and the shape that gain most at each place the log can show, the best first."""
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
    named = [cause.values[1] for cause in model.causes if cause.hypothesis.is_line]
    modes = [cause.values[1] for cause in model.causes if cause.hypothesis.is_mode]
    resolution = 2.0 * math.pi / (model.fit.record.rows * model.fit.record.period)
    left = []
    for (amplitude, frequency, _), gain in lines(problem, model.fit):
        if any(is_harmonic(frequency, base, resolution) for base in named):
            continue
        of = Disturbance("plant", amplitude / math.sqrt(2.0), math.inf)
        at_mode = any(abs(frequency - mode) < OWN_BINS * resolution for mode in modes)
        left.append(Leftover(of, gain, f"{LINE}({frequency:.4g} t)", at_mode))
    return [*found, *sorted(left, key=lambda line: line.limit - line.gain)[:1]]


def is_harmonic(frequency: float, base: float, resolution: float) -> bool:
    """A multiple of a named line, within what the log resolves [rad/s]: what is periodic need not be a sine."""
    multiple = round(frequency / base)
    return multiple > 1 and abs(frequency - multiple * base) < resolution


def _relevelled(record: Record, model: Model, leftover: Leftover) -> Leftover:
    """The gain when the noise levels may give way to the disturbance."""
    fitted = model.fit
    filt = fit_levels(record, model.dynamics, fitted.innovations, fitted.filter, fitted.filter.levels,
                      leftover.disturbance)
    own = _refilter(record, model).log_likelihood(fitted.filter.levels)
    gain = filt.log_likelihood - max(own, nothing_foreseen(record))
    return Leftover(leftover.disturbance, max(gain, leftover.gain))


def _refilter(record: Record, model: Model) -> Refilter:
    return Refilter(record, model.dynamics, model.fit.innovations, model.fit.filter)


def _best_size(record: Record, model: Model, place: str, tau: float) -> Leftover:
    """The standard deviation that gains most: a coarse look, and where it gains anything a closer one."""
    levels, refilter = model.fit.filter.levels, _refilter(record, model)
    base = max(refilter.log_likelihood(levels), nothing_foreseen(record))

    def look(low: float, high: float) -> tuple[float, float, np.ndarray]:
        """(gain, size) of the best of LANES sizes, evenly over the logarithm, and the sizes beside it."""
        sizes = np.geomspace(low, high, LANES)
        gains = refilter.with_sizes(levels, place, sizes, tau) - base
        k = int(np.argmax(gains))
        return float(gains[k]), float(sizes[k]), sizes[[max(k - 1, 0), min(k + 1, LANES - 1)]]

    most = largest(record, place)
    gain, size, beside = look(SMALLEST * most, most)
    if gain > WORTH_A_SEARCH:
        gain, size, _ = look(*beside)
    return Leftover(Disturbance(place, size, tau), max(gain, 0.0))
