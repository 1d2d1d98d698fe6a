"""The selection of the causes that the log needs: forward selection by profile likelihood, with joint refits, swaps and
drops.

Evidence of a cause: gain of the log-likelihood, everything refitted (the other causes, a6 and k1 within their
tolerance, the noise levels), less 1/2 ln n for each of its free numbers (Schwarz 1978).  The first cause must reach
`threshold`, each further one an absolute limit: one that is relative to the first loses half of the second causes.
"""

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..causes import Cause, Hypothesis, has_forms, missing_term, other_form
from ..data.record import Record
from ..data.used import SINE
from ..data.world import TURBULENCE, WALK, Source
from ..model.nuisance import Problem
from .fit import Fit, fit
from .foresight import foreseen, is_idle
from .profile import TOLD_APART, Model, penalty, profile
from .scan import Candidate, scan
from .starts import starts

FAR = 0.3             # rad: below it sin(theta) is theta and theta^3
THRESHOLD = 12.0      # nats of evidence for the first cause, where no bootstrap has measured it
FURTHER = 22.0        # nats for each further one
MOST_CAUSES = 3
TRIED = 8             # candidates of a scan that are fitted
PROFILED = 3          # of these, how many get their own noise levels; and all within NEAR of the best
NEAR = 8.0            # nats
HOPELESS = 0.2        # of the best fit's gain: a scan that promises less is not fitted
FAR_BEHIND = 0.4      # of the best fit's gain: others, with the noise levels of the base, do not get their own
PROMISING = 3.0       # nats after the penalty that a scan must promise
SWAPS = 4             # rounds of swapping a cause for a better one at most
SWAP_GAIN = 1.0       # nats that a swap must bring
UNLIKE_NONE = 2.0     # standard deviations of a weather's level from none, to be called wind

Say = Callable[[str], None]


@dataclass(frozen=True)
class Ranked:
    """One hypothesis in the ranking: its evidence [nats] after the penalty, and its values."""

    cause: Cause
    evidence: float


@dataclass(frozen=True, eq=False)
class Weather:
    """A disturbance that nobody declared (`weather`).

    source  the state that is free;  level, std  fitted, in the source's unit;  gain  [nats] that it brings beside the
    causes, its penalty taken off;  rivals  the wind's other names that explain as much;  is_steady  all along the log
    """

    source: Source
    level: float
    std: float
    gain: float
    rivals: tuple[str, ...] = ()
    is_steady: bool = True

    @property
    def is_wind(self) -> bool:
        """Whether it can be called wind: it enters as wind does, all along the log, at a level that is clearly above
        none."""
        return self.source.name in (TURBULENCE, WALK) and self.is_steady and self.level > UNLIKE_NONE * self.std


@dataclass(eq=False)
class Selection:
    """The result of a search.

    nominal    the model without further causes, noise fitted
    model      with the causes found
    evidence   of each cause of `model`: what is lost without it, everything else refitted, less its penalty
    rivals     of each cause: the ranking of what could stand in its place, itself included
    rankings   of each step, best first
    weather    that nobody declared and both models are in; None: there is none;  calm  the nominal without it
    instead    what else there is in weather alone, where that explains nearly as much as what turns the vehicle in it
    also       first causes that are tried whatever a scan promises: the best in calm air, of a search in weather
    """

    nominal: Model
    model: Model
    evidence: list[float] = field(default_factory=list)
    rivals: list[list[Ranked]] = field(default_factory=list)
    rankings: list[list[Ranked]] = field(default_factory=list)
    weather: Weather | None = None
    calm: "Model | None" = None
    instead: "Selection | None" = None
    also: tuple[Cause, ...] = ()


def needed(threshold: float, causes: int) -> float:
    """Evidence [nats] that a cause must reach beside so many."""
    return max(FURTHER, threshold) if causes else threshold


def swinging(nominal: Model) -> tuple[tuple[Cause, ...], ...]:
    """The first causes of a plant that swings far and has no sine: a6 sin(theta) in the place of a6 theta, two terms at
    once."""
    r, theta = nominal.fit.record, nominal.fit.states[:, 0]
    a6 = float(r.a6[0])
    if not np.all(np.isfinite(theta)) or float(np.max(np.abs(theta))) < FAR or a6 == 0.0 or \
            any(term == SINE for term, _ in r.nominal.terms):
        return ()
    return ((Cause(missing_term(SINE), (a6,)), Cause(missing_term("theta"), (-a6,))),)


def select_from(nominal: Model, known: Sequence[Hypothesis], threshold: float, most: int, say: Say,
                blocks: Sequence[tuple[Cause, ...]] = (), start: Model | None = None,
                ranking: Sequence[Ranked] | None = None, also: Sequence[Cause] = ()) -> Selection:
    """Find up to `most` causes among the known hypotheses, from the nominal with its noise levels fitted.

    blocks  causes that make sense together only, of which one may join
    start   a model of the same record whose causes are kept as long as they are needed; None: the nominal
    ranking of the first cause, where one that begins with causes has it; None: it is made;  also: `Selection`
    """
    record, known = nominal.fit.record, tuple(known)
    found = Selection(nominal, nominal if start is None else start, also=tuple(also))
    if start is not None and start.causes:  # what could stand in the place of the first is still told
        found.rankings.append(list(ranking) if ranking is not None else ranking_of(record, nominal, known))
    while len(found.model.causes) < most and not record.work.is_spent:
        say(f"cause {len(found.model.causes) + 1}: all hypotheses")
        before = len(found.model.causes)
        if not grown(found, known, threshold, blocks):
            break
        most += max(0, len(found.model.causes) - before - 1)  # a block counts as one cause
    for swap in range(SWAPS, -1, -1):
        found.model = _dropped(record, found.model, needed(threshold, 1))
        if not _stood_in(record, found, known, SWAP_GAIN if swap > 0 and not record.work.is_spent else math.inf):
            break
    return found


def grown(found: Selection, known: tuple[Hypothesis, ...], threshold: float,
          blocks: Sequence[tuple[Cause, ...]] = ()) -> bool:
    """Give the model one more cause, or a better form of one that it has; False: the log asks for neither."""
    record, limit = found.model.fit.record, needed(threshold, len(found.model.causes))
    better = _next(record, found, known, limit, blocks if not _has_one(found.model.causes, blocks) else ())
    if better is None:
        return False
    reformed = _reformed(record, found.model, known)
    if reformed is None:
        found.model = better
        return True
    found.model = reformed
    if found.rankings:
        found.rankings.pop()
    return True


def _next(record: Record, found: Selection, known: tuple[Hypothesis, ...], limit: float,
          blocks: Sequence[tuple[Cause, ...]]) -> Model | None:
    """The model with the best further cause, or None if none reaches the limit."""
    base = found.model
    allowed = _allowed(record, known, base.causes)
    ranked = _ranking(record, base, allowed, also=() if base.causes else found.also)
    for block in blocks:
        model = profile(record, (*base.causes, *block), base.fit.delta, base.fit.filter)
        ranked.append((model, model.log_likelihood - base.log_likelihood
                       - sum(penalty(record, cause.hypothesis) for cause in block)))
    ranked.sort(key=lambda pair: -pair[1])
    found.rankings.append([Ranked(model.causes[-1], evidence) for model, evidence in ranked])
    if not ranked or ranked[0][1] < limit or (base.causes and is_idle(found.nominal, base, ranked[0][0])):
        return None
    return ranked[0][0]


def _has_one(causes: Sequence[Cause], blocks: Sequence[tuple[Cause, ...]]) -> bool:
    """A block, or a part of one, is among the causes."""
    labels = {cause.hypothesis.label for block in blocks for cause in block}
    return any(cause.hypothesis.label in labels for cause in causes)


def _allowed(record: Record, known: tuple[Hypothesis, ...], causes: tuple[Cause, ...]) -> list[Hypothesis]:
    """Hypotheses that may join these causes."""
    present = {cause.hypothesis.label for cause in causes}
    forms = {cause.hypothesis.cause for cause in causes if has_forms(cause.hypothesis)}
    twins = {cause.hypothesis.twin for cause in causes if "beta" not in record.channels}
    return [h for h in known if h.may_repeat or not (h.label in present or h.cause in forms | twins)]


def ranking_of(record: Record, base: Model, known: Sequence[Hypothesis]) -> list[Ranked]:
    """Each hypothesis that promises anything as the next cause, best first."""
    return [Ranked(model.causes[-1], evidence)
            for model, evidence in _ranking(record, base, _allowed(record, tuple(known), base.causes))]


def _ranking(record: Record, base: Model, allowed: list[Hypothesis], known: float | None = None,
             also: Sequence[Cause] = ()) -> list[tuple[Model, float]]:
    """Models with one more cause and its evidence, best first; the first few with their own noise levels.  Where noise
    stands for what is not modelled, without those that one of less evidence outdoes in what it predicts (`foreseen`).

    known  gain [nats] of a cause that is to be replaced; None: start from the declared noise levels too
    also   causes that are tried whatever a scan promises
    """
    best: dict[str, tuple[Model, float]] = {}
    given = [fit(Problem(record, base.fit.filter), (*base.causes, cause), base.fit.delta) for cause in also]
    for start in starts(record, base) if known is None else [base]:
        for fitted in itertools.chain(_worth_levels(record, _fits(record, start, allowed, known)), given):
            model = profile(record, fitted.causes, fitted.delta, fitted.filter, fitted=fitted)
            cause = model.causes[-1]
            evidence = model.log_likelihood - base.log_likelihood - penalty(record, cause.hypothesis)
            if not math.isfinite(evidence) or cause.is_at_an_end:
                continue
            if cause.hypothesis.label not in best or evidence > best[cause.hypothesis.label][1]:
                best[cause.hypothesis.label] = model, evidence
        given = []
    ranked = sorted(best.values(), key=lambda pair: -pair[1])
    enough = [pair for pair in ranked if pair[1] > THRESHOLD]
    stand = foreseen(base, [model for model, _ in enough])
    return [pair for pair, stands in zip(enough, stand, strict=True) if stands] + ranked[len(enough):]


def _fits(record: Record, start: Model, allowed: list[Hypothesis], known: float | None) -> list[tuple[Fit, float]]:
    """Fits with one more cause under the filter of a start, and what each gains there after its penalty [nats]; gains
    under another filter are in another currency."""
    fits: list[tuple[Fit, float]] = []
    problem = Problem(record, start.fit.filter)
    promising = [c for c in scan(problem, start.fit, allowed)
                 if c.gain - penalty(record, c.hypothesis) > PROMISING]
    promising.sort(key=lambda c: penalty(record, c.hypothesis) - c.gain)
    most = known or 0.0
    for candidate in promising[:TRIED]:
        if candidate.gain < HOPELESS * most:
            continue
        fitted = _joined(problem, start.fit, candidate)
        gained = start.fit.cost - fitted.cost
        most = max(most, gained)
        if gained > 0.0:  # else it did not stay with the log
            fits.append((fitted, gained - penalty(record, candidate.hypothesis)))
    for fitted in _in_steps(problem, start.fit, allowed):
        fits.append((fitted, start.fit.cost - fitted.cost - penalty(record, fitted.causes[-1].hypothesis)))
    return fits


def _worth_levels(record: Record, fits: list[tuple[Fit, float]]) -> Iterator[Fit]:
    """The fits that get their own noise levels: the best of each cause, a few and all near the best."""
    seen: set[str] = set()
    for fitted, gain in sorted(fits, key=lambda pair: -pair[1]):
        name, most = fitted.causes[-1].hypothesis.label, max(each for _, each in fits)
        far = gain < most - NEAR and (len(seen) >= PROFILED or gain < FAR_BEHIND * most)
        if name not in seen and not far:
            seen.add(name)
            yield fitted


def _joined(problem: Problem, base: Fit, candidate: Candidate) -> Fit:
    causes = (*base.causes, Cause(candidate.hypothesis, candidate.values))
    return fit(problem, causes, base.delta)


def _in_steps(problem: Problem, base: Fit, allowed: list[Hypothesis]) -> Iterator[Fit]:
    """The base with its last gradual cause in two steps: a ramp, of which the second half would else be sought
    elsewhere."""
    known = {h.cause for h in allowed}
    last = next((k for k in range(len(base.causes) - 1, -1, -1) if base.causes[k].hypothesis.steps is not None), None)
    if last is None or base.causes[last].hypothesis.cause not in known:
        return
    (size, time), hypothesis = base.causes[last].values, base.causes[last].hypothesis
    assert hypothesis.steps is not None
    for apart in hypothesis.steps.apart:
        halves = [Cause(hypothesis, (0.5 * size, time + sign * apart)) for sign in (-1.0, 1.0)]
        yield fit(problem, (*base.causes[:last], halves[0], *base.causes[last + 1:], halves[1]), base.delta)


def in_a_block(causes: Sequence[Cause], k: int) -> bool:
    """Cause k makes sense together with another one only (`swinging`), so nothing takes its place alone."""
    terms = {dict(cause.hypothesis.fixed).get("term") for cause in causes}
    return {SINE, "theta"} <= terms and dict(causes[k].hypothesis.fixed).get("term") in (SINE, "theta")


def _dropped(record: Record, model: Model, limit: float) -> Model:
    """The model without the causes that the others made needless; one alone stays."""
    for k in range(len(model.causes) if len(model.causes) > 1 else 0):
        if in_a_block(model.causes, k):
            continue
        others = model.causes[:k] + model.causes[k + 1:]
        without = profile(record, others, model.fit.delta, model.fit.filter)
        loss = model.log_likelihood - without.log_likelihood - penalty(record, model.causes[k].hypothesis)
        if loss < limit:
            return _dropped(record, without, limit)
    return model


def strongest(of: Selection) -> int:
    """Index of the cause with most evidence."""
    return max(range(len(of.evidence)), key=lambda k: of.evidence[k])


def only_strongest(of: Selection) -> tuple[bool, ...]:
    """A mask of the causes that are the strongest or make sense together with that only; () where there is none."""
    causes = of.model.causes
    if not causes:
        return ()
    first = strongest(of)
    return tuple(k == first or (in_a_block(causes, k) and in_a_block(causes, first)) for k in range(len(causes)))


def fewer(of: Selection, kept: Sequence[int]) -> Selection:
    """The selection with some of its causes, all else fitted anew; what could stand in their places is kept."""
    fitted = of.nominal.fit
    model = profile(fitted.record, [of.model.causes[k] for k in kept], fitted.delta, of.model.fit.filter)
    made = Selection(of.nominal, model, rankings=of.rankings, weather=of.weather, calm=of.calm, instead=of.instead)
    for k, cause in enumerate(model.causes):
        others = model.causes[:k] + model.causes[k + 1:]
        without = profile(fitted.record, others, fitted.delta, model.fit.filter) if others else of.nominal
        evidence = model.log_likelihood - without.log_likelihood - penalty(fitted.record, cause.hypothesis)
        made.evidence.append(evidence)
        made.rivals.append([Ranked(cause, evidence), *of.rivals[kept[k]][1:]])
    return made


def _reformed(record: Record, model: Model, known: tuple[Hypothesis, ...]) -> Model | None:
    """The model with one of its causes in another form, where that explains clearly more; else None."""
    for k in range(len(model.causes)):
        other = _in_other_form(record, model, k, known)
        if other is not None and other[1] > TOLD_APART and not other[0].causes[k].is_at_an_end:
            return other[0]
    return None


def _in_other_form(record: Record, model: Model, k: int, known: tuple[Hypothesis, ...]) -> tuple[Model, float] | None:
    """The model with cause k in its other form, if it has one, and what that brings in evidence [nats]."""
    form = other_form(record, model.causes[k], known)
    if form is None:
        return None
    made = profile(record, (*model.causes[:k], form, *model.causes[k + 1:]), model.fit.delta, model.fit.filter)
    more = penalty(record, form.hypothesis) - penalty(record, model.causes[k].hypothesis)
    return made, made.log_likelihood - model.log_likelihood - more


def _stood_in(record: Record, found: Selection, known: tuple[Hypothesis, ...], least: float) -> bool:
    """Evidence of each cause, and the ranking of all that could stand in its place now that the others are in; True
    if one that does better by `least` nats took it, so that all must be looked at again."""
    found.evidence, found.rivals = [], []
    for k, cause in enumerate(found.model.causes):
        model = found.model
        others = model.causes[:k] + model.causes[k + 1:]
        if not others:
            without, ranked = found.nominal, found.rankings[0]
        else:
            without = profile(record, others, model.fit.delta, model.fit.filter)
            gain = model.log_likelihood - without.log_likelihood
            asked = not in_a_block(model.causes, k)
            models = _ranking(record, without, _allowed(record, known, others) if asked else [], gain)
            ranked = [Ranked(made.causes[-1], evidence) for made, evidence in models]
        own = model.log_likelihood - without.log_likelihood - penalty(record, cause.hypothesis)
        if others and models and models[0][1] > own + least and not in_a_block(found.model.causes, k):
            found.model = models[0][0]
            return True
        other = _in_other_form(record, model, k, known)
        if other is not None and other[0].causes[k].is_at_an_end:
            other = None
        if other is not None and other[1] > max(TOLD_APART, least):
            found.model = other[0]
            return True
        if other is not None:
            ranked = [*ranked, Ranked(other[0].causes[k], own + other[1])]
        found.evidence.append(own)
        found.rivals.append([Ranked(cause, own), *(each for each in ranked
                                                   if each.cause.hypothesis.label != cause.hypothesis.label)])
    return False
