"""One measure of what causes are worth, in three ratios instead of absolute gates: no model is exact, so an absolute
limit in nats fails every log that is long enough.

    variation  of a cause's size over the log, beyond what chance gives, over the size itself: a cause is the same all
               along, what stands in for another is not
    left       evidence of what a disturbance still finds, over that of the causes: what mimics an effect leaves the
               part of it that is not alike, 1 - cos^2.  A disturbance of a sensor moves no vehicle, and is no doubt of
               what does
    share      of the held-out squared errors over 1 s or less (`foresight.spans`), beyond noise, that remains
               (`gain.Gain.share`); a moment that nobody declared and nothing names is no noise

A ratio counts from where it is beyond chance: the constancy's chi-squared, the leftover's own limit, the spread of a
mean square of so many horizons (`Gain.is_left`).  Each threshold:

    name                meaning                                                        set on
    EXPLAINED.variation a size that creeps by a seventh is still that cause's          the project's hidden flights
    EXPLAINED.left      no form of a cause is known to a tenth, whose square this is   the same
    EXPLAINED.share     nine tenths of the error beyond noise are gone                 meaning only
    DOMINANT.variation  more than half as different along the log is not one cause     meaning only
    DOMINANT.left       a tenth of what is explained: something small beside it        unlisted effects leave 0.14
    DOMINANT.share      a quarter of the error gone: the least that a main defect does real logs marked open: 0.31
    command.UNSURE      nats a row that one command feigns which no row saw            clean flights, trims: 0.027
    named.OLDEST        times the age of a sample, below which a delay may be that     meaning only
    weather.TWICE, FAR  of the weather's gain, where only it leaves the noise declared a foreign simulator's turbulence
    outdone.PARALLEL    share of a cause's evidence that its rival shape makes alone   meaning only: |cos| above 0.95
    gaps.EXPLAINS       times what noise leaves, that other gains may in a slow log    own flights: 1.2 at most
    gain.CONFIDENCE     of chance in a log too short for predictions                   meaning only: 95 %
    PER_ROW             nats a row that no cause need explain: 0.3 % of the variance   meaning only
    foresight.LEAST_REMOVED  share of the error that a cause beside others must take away    meaning only
    NOISE               times the declared, from which noise hides what is not modelled   the contract
"""

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..causes import RECORDS
from ..data.record import Record
from ..data.used import SINE
from ..search.selection import Selection
from .constancy import CONSTANCY_LIMIT, Constancy
from .gain import Gain
from .leftover import OWN_BINS, Leftover
from .named import Named, undetermined


@dataclass(frozen=True)
class Bounds:
    """Largest ratios of a verdict."""

    variation: float
    left: float
    share: float


EXPLAINED = Bounds(0.15, 0.01, 0.1)
DOMINANT = Bounds(0.5, 0.1, 0.75)
PER_ROW = 1.5e-3
NOISE = 3.0
AND = " and "


@dataclass(frozen=True)
class Remainder:
    """The remainder beside `dominant` causes: share of the held-out error, where it is, what it looks like."""

    share: float
    where: str
    words: str


def variation(of: Constancy | None, neutral: float) -> float:
    """RMS change of a size along the log beyond chance, over its distance from `neutral`; 0 where chance makes it."""
    if of is None or of.chi_squared <= CONSTANCY_LIMIT:
        return 0.0
    size, weight = np.array(of.size), 1.0 / np.maximum(np.array(of.std), 1e-300)**2
    mean = float(weight @ size / weight.sum())
    spread = float(weight @ (size - mean)**2 - (len(size) - 1)) / float(weight.sum())
    away = abs(mean - (0.0 if math.isinf(neutral) else neutral))
    return math.sqrt(max(spread, 0.0)) / away if away > 0.0 else math.inf


def left_beyond(left: tuple[Leftover, ...], named: tuple[Named, ...], feigned: float, bounds: Bounds,
                same_place: bool) -> tuple[Leftover, tuple[Named, ...]] | None:
    """The disturbance that explains more than the bounds allow beside the causes that it speaks against, and these
    causes; None: there is none.

    feigned  [nats] that no cause need explain;  same_place  judged against the causes of its own place only.  Else it
    speaks against all causes, but one of a sensor, which moves nothing, against those of sensors alone.
    """
    for each in left:
        own = tuple(cause for cause in named if cause.where == each.where
                    or not (same_place or each.where == "sensor"))
        if (own or same_place) and each.gain > max(each.limit, bounds.left * sum(cause.evidence for cause in own),
                                                   feigned):
            return each, own
    return None


def doubts(named: tuple[Named, ...], left: tuple[Leftover, ...], feigned: float, span: tuple[float, float],
           bounds: Bounds, same_place: bool) -> list[str]:
    """The reasons why these causes do not keep the bounds, a line each;  feigned [nats] that no cause need explain;
    span [s]: the log's first and last row."""
    found = []
    for each in named:
        varies = variation(each.constancy, each.record.neutral)
        if varies > bounds.variation:
            found.append(f"{each.cause}: its size is not the same all along the log (it varies by {100 * varies:.0f} % "
                         f"of itself, at most {100 * bounds.variation:.0f} %)")
        found += undetermined(each, span[0])
    found += _unresolved(named, span)
    more = left_beyond(left, named, feigned, bounds, same_place)
    if more is not None:
        what, beside = more
        against = dict.fromkeys(each.cause for each in beside) if not same_place and len(beside) < len(named) else {}
        found.append(f"{AND.join(against)}{': ' if against else ''}a disturbance {what.words} at the "
                     f"{what.disturbance.place} explains {what.gain:.0f} nats more")
    return found


def accused(doubt: str) -> list[str]:
    """The causes that a line of `doubts` speaks against; none of the catalogue where it speaks against all."""
    return doubt.partition(":")[0].split(AND)


def _unresolved(named: tuple[Named, ...], span: tuple[float, float]) -> list[str]:
    """Oscillations of one cause so near each other that they stand for one that changes along the log, a line each."""
    resolution = 2.0 * math.pi / (span[1] - span[0])
    waves = sorted((each.cause, float(each.values["frequency"])) for each in named
                   if each.record.is_line or each.record.is_mode)
    return [f"{one}: two oscillations, of {low:.4g} and {high:.4g} rad/s, in a log that resolves {resolution:.2g} "
            "rad/s, stand for one that changes" for (one, low), (other, high) in itertools.pairwise(waves)
            if one == other and high - low < OWN_BINS * resolution]


def own_oscillation(each: Named, record: Record) -> list[str]:
    """The doubt that a mode or a line is what the vehicle does by itself: a6 or a damping is off then."""
    if not (each.record.is_line or each.record.is_mode):
        return []
    stiffness = -float(np.mean(record.a6)) - sum(value for term, value in record.nominal.terms if term == SINE)
    if stiffness <= 0.0:
        return []
    own, frequency = math.sqrt(stiffness), float(each.values["frequency"])
    if abs(frequency - own) >= OWN_BINS * 2.0 * math.pi / (record.rows * record.period):
        return []
    return [f"{each.cause}: {frequency:.4g} rad/s is the vehicle's own oscillation, of {own:.4g} rad/s: an a6 or a "
            "damping that is off looks like it"]


def of_gain(gain: Gain, bounds: Bounds, is_part: bool = False) -> list[str]:
    """The reasons why the held-out gain does not keep the bounds;  is_part  something remains beside the causes: they
    must predict better, though noise may make all of the nominal's error."""
    if gain.is_lost:
        return [f"on data left out of the fit the causes lose {-gain.nats:.0f} nats"]
    if gain.share is not None and gain.share > bounds.share and gain.is_left:
        return [f"on data left out of the fit {percent(gain.share)[1]} of the squared error over {gain.longest:g} s "
                f"remain (at most {100 * bounds.share:.0f} %)"]
    if is_part and gain.share is None and gain.whole >= 1.0:
        return [f"on data left out of the fit predictions over {gain.longest:g} s are no better with the causes"]
    return []


def percent(left: float) -> tuple[str, str]:
    """The words for the share of a whole that is gone and the share that is left, neither of which is all or
    nothing."""
    whole = round(100.0 * left)
    if whole < 1:
        return "> 99 %", "< 1 %"
    return ("< 1 %", "> 99 %") if whole > 99 else (f"{100 - whole} %", f"{whole} %")


def too_noisy(noise: dict[str, dict[str, Any]], but: str = "") -> str | None:
    """The level that is beyond doubt beyond NOISE times the declared, in words; whatever is told of `but`."""
    for name, level in noise.items():
        if level["beyond"] and name != but:
            return f"noise of {name} at {level['factor']:.3g} times the declared stands for what is not modelled"
    return None


def remainder(gain: Gain | None, left: tuple[Leftover, ...], selection: Selection, where: str | None,
              noisy: str | None) -> Remainder:
    """The remainder beside the causes."""
    share = gain.share if gain is not None and gain.share is not None else 0.0
    best = max((each for each in left if each.gain > each.limit), key=lambda each: each.gain, default=None)
    weather = selection.weather
    if where is not None:
        return Remainder(share, where, "the command is not the nominal controller's")
    if weather is not None and (best is None or weather.gain > best.gain):
        return Remainder(share, "environment" if weather.is_wind else "plant", weather_words(selection))
    if best is not None:
        return Remainder(share, best.where,
                         f"a disturbance {best.words} at the {best.disturbance.place} ({best.gain:.0f} nats)")
    return Remainder(share, "plant", noisy or "what is left is no more than noise")


def weather_words(selection: Selection) -> str:
    """The undeclared disturbance of a selection."""
    weather = selection.weather
    assert weather is not None
    name = weather.source.name.replace("_", " ") if weather.is_wind else "a moment"
    time = "" if math.isinf(weather.source.time_constant) else \
        f" that changes within {weather.source.time_constant:g} s"
    return f"{name} of {weather.level:.2g} {unit_of(weather.source.name)}{time} ({weather.gain:.0f} nats)"


def unit_of(source: str) -> str:
    """The unit of the level of a source of the world."""
    return RECORDS[source].unit("level") if source in RECORDS else "rad/s^2"
