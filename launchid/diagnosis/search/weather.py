"""The search with the weather in it: a disturbance that nobody declared, and the causes sought beside it.

Turbulence, a walk of the wind, or a slow moment that is no wind at all, whichever the log likes best.  It can absorb
what a cause does (a gain that is wrong looks like weather that goes with the manoeuvres), so it is asked only for what
the best causes leave, or where it explains more than any single one; and it is charged for its level and its time.

Weather keeps to no law exactly (a shear is a ramp, no walk): what turns the vehicle has to explain more than that.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..causes import SOUGHT, Cause, Hypothesis
from ..data.record import Record
from ..data.world import SLOW_MOMENT, TURBULENCE, WALK, Source, sought
from ..model.level_fit import LEVEL_STEP, fit_levels
from ..model.noise import (
    ACCELERATION,
    WRONG_NOISE,
    Disturbance,
    Filter,
    Refilter,
    bounds,
    declared,
    dynamics,
    first_filter,
    largest,
)
from ..model.point import innovations
from .profile import TOLD_APART, Model, as_simulated, profile
from .selection import FURTHER, MOST_CAUSES, THRESHOLD, Say, Selection, Weather, grown, needed, select_from, swinging
from .starts import UNSTEADY, quiet

TIMES = (0.3, 1.0, 3.0, 10.0)   # s, of turbulence and of the moment: a factor 3 apart a time is told from the next
SIZES = np.geomspace(1e-3, 1.0, 8)  # of a first look, over the largest
WORTH = 4.0                     # nats of the first look, from which weather is fitted
HALF = 0.5                      # of what weather gains: a single cause that gains more is not taken for weather, but
TWICE = 2.0                     # where the weather alone leaves the noise what is declared
FAR = 3.0                       # times the declared, of such noise
DISAGREE = 1.0                  # nats a row: far beyond what noise, or a cause of the vehicle, makes
FULL = 0.99                     # of a level's largest, from which it is that
LAW = 0.1                       # of what weather explains alone: no weather keeps to a law better, so causes of the
                                # vehicle's motion that explain no more beyond it stand for its own shape (|cos| 0.95)
CARRIED = 4                     # first causes of the search in calm air that are tried in weather too
NUMBERS = 2                     # free numbers that it is charged for: level and time
WIND = (TURBULENCE, WALK)


@dataclass(frozen=True, eq=False)
class _Fitted:
    """Causes in a weather, everything refitted, and what that brings over the same causes without it [nats]."""

    source: Source
    model: Model
    gain: float
    rivals: tuple[str, ...]


def select(record: Record, threshold: float = THRESHOLD, hypotheses: Iterable[Hypothesis] | None = None,
           say: Say = lambda text: None) -> Selection:
    """Find up to three causes, and the weather that they are in."""
    known = tuple(hypotheses) if hypotheses is not None else SOUGHT
    say("noise levels")
    nominal = as_simulated(record)
    blocks = swinging(nominal) if hypotheses is None else ()
    one = select_from(nominal, known, threshold, 1, say, blocks)
    if sensors_disagree(one.model):
        return one  # no cause of the vehicle is told from what the sensors make of it
    say("weather")
    carried = [each.cause for each in one.rankings[0][:CARRIED]] if one.rankings else []
    settled = one.model.causes and _first_look(one.model) is None  # nothing is left for weather
    feigned = "theta_dot" not in nominal.fit.record.channels and _noisy(one.model) > FAR  # its noise is the weather
    first = None if settled and not feigned else _weathered(nominal)
    single = one.model.log_likelihood - nominal.log_likelihood
    share = TWICE if first is not None and feigned and _noisy(first.model) < WRONG_NOISE else 0.0 if settled else HALF
    if first is not None and first.gain > needed(threshold, 0) and single < share * first.gain:
        return _in_weather(nominal, first, known, threshold, say, carried)
    found = one
    if one.model.causes:
        two = Selection(nominal, one.model)
        if not settled and grown(two, known, threshold, blocks):
            beside, second = _weathered(one.model), two.model.log_likelihood - one.model.log_likelihood
            if beside is not None and beside.gain > needed(threshold, 1) and second < HALF * beside.gain:
                return _in_weather(nominal, beside, known, threshold, say, carried)
        found = select_from(nominal, known, threshold, MOST_CAUSES, say, blocks, two.model, one.rankings[0])
    beside = _weathered(found.model) if found.model.causes else first
    if beside is None or beside.gain < needed(threshold, len(found.model.causes)):
        return found
    return _in_weather(nominal, beside, known, threshold, say, carried)


def _noisy(model: Model) -> float:
    """The acceleration's noise over the declared: far more stands for what is not modelled, and what a controller makes
    of that looks like another gain."""
    return float(model.fit.filter.levels[ACCELERATION] / declared(model.fit.record)[ACCELERATION])


def sensors_disagree(model: Model) -> bool:
    """Whether attitude and rate are measured, and the model does not make them one motion.  Then a disturbance of one
    of them, as large as its innovations, is worth DISAGREE nats a row; or beside a cause of a sensor the noise of one
    of them is as large as it may be."""
    record, fitted = model.fit.record, model.fit
    if not {"theta", "theta_dot"} <= set(record.channels):
        return False
    most = (bounds(record)[1] * declared(record))[:2]
    if record.noise == "bounded" and any(cause.hypothesis.where == "sensor" for cause in model.causes) and \
            np.any(fitted.filter.levels[:2] > FULL * most):
        return True
    refilter = Refilter(record, model.dynamics, fitted.innovations, fitted.filter)
    own = refilter.log_likelihood(fitted.filter.levels)
    sizes = np.sqrt(np.nanmean(fitted.innovations[:, :2]**2, axis=0)).tolist()
    gains = [refilter.log_likelihood(fitted.filter.levels, Disturbance(name, size, TIMES[0])) - own
             for name, size in zip(("theta", "theta_dot"), sizes, strict=True)]
    return max(gains) > DISAGREE * record.rows


def _in_weather(calm: Model, of: _Fitted, known: tuple[Hypothesis, ...], threshold: float, say: Say,
                also: Sequence[Cause] = ()) -> Selection:
    """The search from these causes on, all in the weather; and without it again where its causes make it needless.

    also  first causes that explained most in calm air: weather of a tenth of a second follows the sensors so closely
          that a score there promises nothing, though they alone predict
    """
    causes = of.model.causes
    nominal = _refitted(of.model.fit.record, (), of.model) if causes else of.model
    blocks = () if causes else swinging(nominal)
    found = select_from(nominal, known, threshold, MOST_CAUSES, say, blocks, of.model if causes else None, also=also)
    return _kept(calm, found, of, known, threshold, say, also)


def _kept(calm: Model, found: Selection, of: "_Fitted | Weather", known: tuple[Hypothesis, ...], threshold: float,
          say: Say, also: Sequence[Cause] = ()) -> Selection:
    """The selection in a weather, with what that gains beside it; sought in calm air again where it is needless."""
    record = found.nominal.fit.record
    same = _refitted(calm.fit.record, found.model.causes, calm)
    gain = found.model.log_likelihood - same.log_likelihood - _charge(record)
    if gain < (FURTHER if found.model.causes else threshold):
        return select_from(calm, known, threshold, MOST_CAUSES, say, (), same)
    if any(is_outside(cause.hypothesis) for cause in found.model.causes):
        alone = _weathered(calm)
        if alone is not None and found.model.log_likelihood - alone.model.log_likelihood < LAW * alone.gain:
            apart = tuple(hypothesis for hypothesis in known if not is_outside(hypothesis))
            within = [cause for cause in also if not is_outside(cause.hypothesis)]
            found.instead = _in_weather(calm, alone, apart, threshold, say, within)
    found.calm = calm
    found.weather = Weather(of.source, *_level(found.model, of.source), gain, of.rivals,
                            quiet(found.model) > UNSTEADY)
    return found


def is_outside(of: Hypothesis) -> bool:
    """Whether a cause turns the vehicle as weather does."""
    return of.where in ("plant", "environment")


def in_its_weather(of: Selection, found: Selection, threshold: float, say: Say) -> Selection:
    """Another selection from the same nominal, with what the first one's weather gains beside it, if it has one."""
    if of.weather is None or of.calm is None:
        return found
    known = tuple(cause.hypothesis for cause in found.model.causes)
    return _kept(of.calm, found, of.weather, known, threshold, say)


def _refitted(record: Record, causes: tuple[Cause, ...], near: Model) -> Model:
    """Causes in the world of a record, from a model of another."""
    levels = declared(record)
    levels[:5] = near.fit.filter.levels[:5]
    return profile(record, causes, near.fit.delta, first_filter(record, levels))


def _charge(record: Record) -> float:
    """Schwarz's penalty of a weather [nats]."""
    return 0.5 * NUMBERS * math.log(record.rows)


def _weathered(model: Model) -> _Fitted | None:
    """The causes in the weather of the highest likelihood; None: a first look finds none."""
    record = model.fit.record
    time = _first_look(model)
    if time is None:
        return None
    tried = sorted((_levelled(model, source) for source in _candidates(record, time)), key=lambda each: -each[1])
    best = tried[0][1]
    alike = [each for each in tried if each[1] > best - TOLD_APART and each[0].name in WIND]
    source, _, filt, free = (alike or tried)[0]  # what may be wind is called so
    made = profile(free, model.causes, model.fit.delta, filt)
    names = {each[0].name for each in alike} - {source.name}
    return _Fitted(source, made, made.log_likelihood - model.log_likelihood - _charge(record), tuple(sorted(names)))


def _first_look(model: Model) -> float | None:
    """The time constant [s] of the disturbance of the plant that gains most at the model's own levels, or with the
    unmodelled acceleration near the declared; None: none."""
    record, levels = model.fit.record, model.fit.filter.levels
    refilter = Refilter(record, model.dynamics, model.fit.innovations, model.fit.filter)
    own = refilter.log_likelihood(levels)
    sizes = SIZES * largest(record, "plant")
    calmer = levels.copy()  # unmodelled acceleration may have taken in what changes slowly
    calmer[ACCELERATION] = min(levels[ACCELERATION], WRONG_NOISE * declared(record)[ACCELERATION])
    tried = [levels, calmer] if calmer[ACCELERATION] < levels[ACCELERATION] else [levels]
    gain, time = max((float(np.max(refilter.with_sizes(each, "plant", sizes, time))) - own, time)
                     for each in tried for time in TIMES)
    return time if gain > WORTH else None


def _candidates(record: Record, time: float) -> list[Source]:
    """Sources to fit: the wind's where the air turns the vehicle, and a moment."""
    floor = next(each.level for each in record.world.sources if each.name == SLOW_MOMENT)
    near = [each for each in TIMES if 1.0 / 4.0 < each / time < 4.0]
    most = largest(record, "plant")
    found = [sought(SLOW_MOMENT, record.nominal, floor, each, most) for each in near]
    if np.any(record.a6):
        found += [sought(TURBULENCE, record.nominal, floor, each) for each in near]
        found.append(sought(WALK, record.nominal, floor))
    return found


def _levelled(model: Model, source: Source) -> tuple[Source, float, Filter, Record]:
    """The source, the log-likelihood at the model's causes with levels fitted, that filter, the record with the
    source."""
    record = model.fit.record
    free = replace(record, world=record.world.with_weather(source))
    levels = declared(free)
    levels[:5] = np.minimum(model.fit.filter.levels[:5], levels[:5])
    start = first_filter(free, levels)
    e, _, _ = innovations(free, start, model.fit.point)
    fitted = fit_levels(free, dynamics(free, model.fit.point), e, start, levels)
    return source, fitted.log_likelihood, fitted, free


def _level(model: Model, source: Source) -> tuple[float, float]:
    """(level, its standard deviation from the likelihood's curvature) of a source, in its unit."""
    fitted = model.fit
    names = [each.name for each in fitted.record.world.levels]
    at = 5 + names.index(source.name)
    refilter = Refilter(fitted.record, model.dynamics, fitted.innovations, fitted.filter)
    moved = np.tile(fitted.filter.levels, (3, 1))
    moved[:, at] *= np.exp(np.array([-1.0, 0.0, 1.0]) * LEVEL_STEP)
    values = refilter.log_likelihoods(moved)
    curvature = (2.0 * values[1] - values[0] - values[2]) / LEVEL_STEP**2
    level = float(fitted.filter.levels[at])
    return level, level / math.sqrt(curvature) if curvature > 0.0 else math.inf
