"""The diagnosis of one log: through the rooms in their order, and the verdict."""

import functools
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..errors import InputError
from ..log import Log
from ..nominal import Nominal
from .causes import RECORDS, Hypothesis
from .controller.command import record
from .controller.issued import with_commands
from .data.check import check
from .data.record import THETA_DOT, Record
from .data.turns import unwrapped
from .data.used import shortened, sparser, used
from .data.vehicle import plant_faults
from .data.work import Stopped
from .judge.diagnosis import Diagnosis
from .judge.extend import extended
from .judge.gain import Gain, held_out, on_another, removed
from .judge.leftover import leftovers
from .judge.levels import noise_of
from .judge.limits import limits, unseen
from .judge.measure import (
    DOMINANT,
    EXPLAINED,
    PER_ROW,
    Remainder,
    doubts,
    of_gain,
    remainder,
    small,
    too_noisy,
    weather_words,
)
from .judge.mistimed import mistimed
from .judge.named import aged, clocked, idle_of, mismatch, named_causes, named_weather, with_removed
from .judge.outdone import outdone, outdone_beside
from .judge.place import place, unheard
from .judge.threshold import threshold as measured_threshold
from .judge.user_gain import user_gain
from .model.follower import NominalFollower, lost
from .model.noise import ACCELERATION, LEVELS
from .relations.look import MAIN, called, look
from .search.changed import instead_of_each
from .search.foresight import LEAST_REMOVED
from .search.profile import Model
from .search.proposal import propose
from .search.selection import THRESHOLD, Say, Selection, fewer, only_strongest
from .search.weather import select

__all__ = ["Diagnosis", "diagnose"]

MASKED = ("stamps", "range", "stale", "dropout", "spike")   # faults of rows; others are of whole columns
FEWEST_ROWS = 40       # without which nothing is fitted: about twice as many as there are unknown numbers
FEWEST_USABLE = 0.5    # of the rows: with fewer left a log is bad data
TERM_MARGIN = 10.0     # nats that missing terms may lose against the doubted causes and still be the better answer
FREE = ("plant", "environment")  # places where a term of the equation may be missing, and where weather acts
GROSS = 0.25           # of the squared error over 1 s: more may not stay without the gyro, for theta may be wrong

NUMBERS = tuple(RECORDS[name] for name in ("control_effectiveness", "aero_instability", "thrust_misalignment",
                                           "actuator_bias", "nozzle_sensor_bias", "attitude_bias"))  # of the nominal

Measure = Callable[[Selection], Gain]


def diagnose(log: Log, nominal: Nominal, holdout: Log | None = None, threshold: float = THRESHOLD,
             hypotheses: tuple[Hypothesis, ...] | None = None, bootstrap: int = 0,
             say: Say = lambda text: None, noise: str = "bounded") -> Diagnosis:
    """Why measurement and simulation part.

    log, nominal  what was measured, what is believed;  holdout  a second log to judge the extension on
    threshold     [nats] of evidence for a first cause
    hypotheses    to choose from; None: the catalogue
    bootstrap     clean flights to measure the threshold on; 0: take `threshold`
    say           told what is being done
    noise         how far levels may be from the declared: "bounded", "declared" or "free"
    """
    say("data check")
    log, turns = unwrapped(log)
    data = check(log, nominal)
    told = replace(data, faults=(*turns, *data.faults)) if turns else data
    made = Diagnosis(log, nominal, told, threshold=threshold, catalogue=hypotheses is None)
    if not all(fault.kind in MASKED for fault in data.faults):
        made.where = "data"
        return made
    try:
        r = record(log, nominal, sparser(data, log.t, nominal))
    except InputError:
        if not data.is_bad:
            raise
        made.where = "data"
        return made
    made.record = replace(r, noise=noise)
    if data.is_bad and data.usable.sum() < max(FEWEST_ROWS, FEWEST_USABLE * len(log.t)):
        made.where = "data"
        return made
    return _examined(made, holdout, bootstrap, hypotheses, say)


def _examined(made: Diagnosis, holdout: Log | None, bootstrap: int, hypotheses: tuple[Hypothesis, ...] | None,
              say: Say) -> Diagnosis:
    """Everything after the data check."""
    r = made.record
    assert r is not None
    if r.rows < FEWEST_ROWS:
        made.verdict = "consistent"  # nothing is wrong that so short a log could show, and the limits say none could
        made.limits = tuple(unseen())
        return made
    r, made.controller = with_commands(shortened(r), NominalFollower())
    r, made.used = used(r, made.log.t[made.data.usable])
    made.record = r
    if away := lost(r):
        whole = plant_faults(made.log, made.nominal, made.data.masks)
        made.verdict, made.limits = "unexplained", tuple(unseen())
        made.doubts = (away, *(fault.message for fault in whole))
        return made
    if bootstrap > 0:
        made.threshold = measured_threshold(r, bootstrap, say)
    made.threshold = max(made.threshold, r.unsure * r.rows)
    r.work.limit(made.nominal.diagnosis.effort, made.nominal.diagnosis.time_limit)
    try:
        return _explained(made, holdout, hypotheses, say)
    except Stopped:
        return made.stopped()
    finally:
        r.work.release()


def _explained(made: Diagnosis, holdout: Log | None, hypotheses: tuple[Hypothesis, ...] | None,
               say: Say) -> Diagnosis:
    """With causes and verdict, and what could not have been seen; Stopped by the brake."""
    made = _searched(made, holdout, hypotheses, say)
    if _sensors_disagree(made):
        made = _without_gyro(made, holdout, hypotheses, say)
    if made.verdict == "unexplained" and made.catalogue:
        made = _by_regression(made, holdout, say)
    assert made.selection is not None
    if made.verdict == "unexplained":  # for the unit or the sign of a column, which no cause of the vehicle is
        whole = plant_faults(made.log, made.nominal, made.data.masks)
        made.doubts = (*(fault.message for fault in whole), *made.doubts)
    say("detection limits")
    found, made.isolability = limits(made.selection.model.fit.record, made.selection.model, made.threshold)
    made.limits = tuple(found)
    return made


def _searched(made: Diagnosis, holdout: Log | None, hypotheses: tuple[Hypothesis, ...] | None,
              say: Say) -> Diagnosis:
    """With the search and the verdict on this record."""
    assert made.record is not None
    made.selection = select(made.record, made.threshold, hypotheses, say)
    made.is_spent = made.record.work.is_spent
    say("goodness")
    _judge(made, _measure(made, holdout), say)
    return made


def _sensors_disagree(made: Diagnosis) -> bool:
    """Attitude and rate are measured, and no cause makes them one motion: what helps the nominal most is a disturbance
    of one of them."""
    r = made.record
    if made.verdict != "unexplained" or r is None or not {"theta", "theta_dot"} <= set(r.channels):
        return False
    best = max(made.left_nominal, key=lambda each: each.gain, default=None)
    return best is not None and best.disturbance.place in ("theta", "theta_dot")


def _without_gyro(made: Diagnosis, holdout: Log | None, hypotheses: tuple[Hypothesis, ...] | None,
                  say: Say) -> Diagnosis:
    """The same on the attitude alone (a device may have filtered its rate), where that is dominant then; else as it
    was."""
    assert made.record is not None
    say("without theta_dot, which does not fit theta")
    z = made.record.z.copy()
    z[:, THETA_DOT] = np.nan
    again = Diagnosis(made.log, made.nominal, made.data, controller=made.controller, threshold=made.threshold,
                      catalogue=made.catalogue, used=made.used, record=replace(made.record, z=z))
    again = _searched(again, holdout, hypotheses, say)
    if again.verdict not in ("explained", "dominant") or again.gain is None or \
            not all(after < GROSS * before for before, after, _, _ in again.gain.squared.values()):
        return made
    share = again.gain.share if again.gain is not None and again.gain.share is not None else 0.0
    again.verdict = "dominant"
    again.remaining = ("theta_dot does not fit theta and was left out", *again.remaining)
    again.remainder = Remainder(share, "sensor", again.remaining[0])
    return again


def _by_regression(made: Diagnosis, holdout: Log | None, say: Say) -> Diagnosis:
    """The causes that the regression finds first, with the likelihood's sizes, where they predict rows left out better
    and only the likelihood's goodness refuses them; else as it was."""
    r, controller = made.record, made.controller
    assert r is not None
    say("which part of the equation is missing")
    seen = look(r)
    if seen is None or not seen.steps or not (seen.steps[0].is_listed and seen.steps[0].share > MAIN):
        return made
    names = {name for step in seen.steps if step.is_listed for name in (step.name, *step.alike)}
    again = Diagnosis(made.log, made.nominal, made.data, controller=controller, threshold=made.threshold,
                      catalogue=False, used=made.used, record=r, left_nominal=made.left_nominal)
    again.selection = select(r, made.threshold, (*called(names), *NUMBERS), say)
    measure = _measure(again, holdout)
    again.remaining = tuple(_tested(again, again.selection, measure, say))
    first = {seen.steps[0].name, *seen.steps[0].alike}
    if not any(each.hypothesis.label in first for each in again.selection.model.causes):
        return made
    again.gain = again.gain or measure(again.selection)
    if of_gain(again.gain, DOMINANT):
        return made
    _concluded(again, measure, say)
    again.catalogue = True
    return again if again.causes else made


def _measure(made: Diagnosis, holdout: Log | None) -> Measure:
    """How a selection's gain is measured: on folds of the record, or on a second log, which passes the first rooms
    once, when it is first asked for."""
    nominal = made.nominal
    if holdout is None:
        return lambda each: held_out(each.model, _before(each), made.controller, _is_named(each))

    @functools.cache
    def second() -> Record:
        assert holdout is not None
        log = unwrapped(holdout)[0]
        data = sparser(check(log, nominal), log.t, nominal)
        r = shortened(record(log, nominal, data))
        return used(with_commands(r, NominalFollower())[0], log.t)[0]

    return lambda each: on_another(second(), each.model, _before(each), made.controller, _is_named(each))


def _is_named(selection: Selection) -> bool:
    """Of undeclared weather there is none, or it is told."""
    return selection.weather is None or selection.weather.is_wind


def _before(selection: Selection) -> Model:
    """What a selection is an extension of: where the weather is all there is, the nominal without it."""
    return selection.nominal if selection.model.causes or selection.calm is None else selection.calm


def _judge(made: Diagnosis, measure: Measure, say: Say) -> None:
    """Verdict, place, causes, gain, what remains."""
    assert made.selection is not None and made.record is not None
    controller = made.controller
    foreign = controller is not None and controller.is_foreign
    found = _tested(made, made.selection, measure, say)
    if found or foreign:
        nominal = made.selection.nominal
        made.left_nominal = made.left if made.selection.model is nominal else tuple(leftovers(nominal))
    if found and made.catalogue and not foreign and place(made) in FREE:
        found = _with_terms(made, measure, found, say)
    if found and made.nearest:
        found = _with_fewer(made, measure, _with_rivals(made, measure, found, say), say)
    if foreign and not made.nearest:
        assert controller is not None
        found = [*found, f"the logged command is not the nominal controller's ({controller.words})"]
    if found:
        _unexplained(made, found, measure)
        return
    _concluded(made, measure, say)


def _concluded(made: Diagnosis, measure: Measure, say: Say) -> None:
    """The verdict of a selection that is not in doubt: its causes by what they remove, and what remains."""
    assert made.selection is not None and made.record is not None
    controller = made.controller
    foreign = controller is not None and controller.is_foreign
    if made.gain is not None:
        shares = removed(made.selection.model, made.gain)
        if (made.remaining or made.selection.weather is not None) and _without_idle(made, shares, measure, say):
            shares = removed(made.selection.model, made.gain)
        made.nearest = with_removed(made.nearest, made.selection.model, shares)
    made.open = tuple(cause for cause in made.nearest if cause.is_open(made.record))
    idle = idle_of(made.nearest) if made.remaining else ()
    causes = [cause for cause in made.nearest if cause not in (*made.open, *idle)]
    if controller is not None and controller.is_named:
        causes.append(mismatch(controller))
        made.gain = made.gain or measure(made.selection)
    told = all(cause.removed is not None for cause in causes)
    causes.sort(key=lambda cause: (-(cause.removed or 0.0) if told else 0.0, -cause.evidence))
    made.causes, made.nearest = tuple(causes), ()
    if not causes:
        made.verdict, made.where = "consistent", None
        return
    made.where = causes[0].where
    made.verdict = "explained" if not made.remaining and not foreign else "dominant"
    if made.verdict == "dominant":
        made.remainder = remainder(made.gain, made.left, made.selection, "controller" if foreign else None,
                                   too_noisy(made.noise), idle)
    made.extension = extended(made.nominal, made.selection.model.causes, made.record.shift, controller,
                              made.record.centre, tuple(cause for cause in causes if cause.is_weather), idle)
    say("gain for the estimator's user")
    made.user = user_gain(made.nominal, made.extension)


def _tested(made: Diagnosis, selection: Selection, measure: Measure, say: Say) -> list[str]:
    """The causes of a selection into `nearest`, with what is left and what they gain; why they are not even dominant.
    What forbids `explained` alone goes into `remaining`."""
    assert made.record is not None
    made.nearest = named_causes(selection)
    made.left = tuple(leftovers(selection.model))
    made.noise = noise_of(selection.model)
    made.gain, made.remaining = None, ()
    feigned, span = max(PER_ROW, made.record.unsure) * made.record.rows, _span(made.record)
    found = doubts(made.nearest, made.left, feigned, span, DOMINANT, same_place=False)
    t = made.log.t[made.data.usable]
    found += unheard(made) + [words for each in made.nearest
                              for words in (*aged(each, made.record), *clocked(each, made.record, t))]
    strict = doubts(made.nearest, made.left, feigned, span, EXPLAINED, same_place=True)
    noisy = too_noisy(made.noise, _pushed_by_chance(made.record))
    weather = selection.weather
    if weather is not None and _is_named(selection) and not strict and noisy is None:
        made.nearest = (*made.nearest, named_weather(weather))
    elif weather is not None and not small(weather, made.nearest):
        strict.append(f"{weather_words(selection)} remains")
    if noisy is not None:
        strict.append(noisy)
    if not made.nearest:
        return strict
    if not found and selection.model.causes:
        better = outdone(selection, made.left) or mistimed(selection) or \
            (outdone_beside(selection, made.left) if strict else None)
        found += [better.words] if better is not None else []
    if selection.instead is not None and any(each.where in FREE for each in made.nearest if not each.is_weather):
        found.append("weather alone explains nearly as much as these causes in weather do")
    if found:
        return found
    say("held-out gain")
    made.gain = measure(selection)
    made.remaining = (*strict, *of_gain(made.gain, EXPLAINED))
    return of_gain(made.gain, DOMINANT)


def _pushed_by_chance(r: Record) -> str:
    """The level of commands that nothing tells, neither log nor nozzle; "" where there are none."""
    return LEVELS[ACCELERATION] if r.unsure > 0.0 and "beta" not in r.channels else ""


def _span(r: Record) -> tuple[float, float]:
    """[s] of the log's clock: first and last row."""
    return float(r.t[0]) + r.shift, float(r.t[-1]) + r.shift


def _with_terms(made: Diagnosis, measure: Measure, found: list[str], say: Say) -> list[str]:
    """Missing terms in the place of the catalogue's causes: kept where they explain everything (a term that leaves
    something, be it called weather, may stand for anything), else a proposal."""
    assert made.selection is not None
    before = made.nearest, made.left, made.gain, made.noise, made.remaining
    terms = propose(made.selection, made.threshold, say)
    if terms is None:
        return found
    made.proposal, selection = terms
    again = _tested(made, selection, measure, say)
    behind = made.selection.model.log_likelihood - selection.model.log_likelihood
    own = made.gain or measure(selection)
    if not (own.nats > 0.0 and (own.share is None or own.share < 1.0)):
        made.proposal = None  # what does not predict better is none, though a short log may lose by chance
    elif not again and not made.remaining and selection.weather is None and behind < TERM_MARGIN:
        made.selection = selection
        return []
    made.nearest, made.left, made.gain, made.noise, made.remaining = before
    return found


def _with_fewer(made: Diagnosis, measure: Measure, found: list[str], say: Say) -> list[str]:
    """The strongest cause alone (with what makes sense together with it only), where several together are in doubt; the
    weather alone, where causes in it are."""
    assert made.selection is not None
    kept = [k for k, stays in enumerate(only_strongest(made.selection)) if stays]
    if len(kept) < len(made.selection.model.causes):
        found = _instead(made, fewer(made.selection, kept), measure, found, say)
    if found and made.selection.instead is not None:
        found = _instead(made, made.selection.instead, measure, found, say)
    return found


def _with_rivals(made: Diagnosis, measure: Measure, found: list[str], say: Say) -> list[str]:
    """A cause in doubt replaced by one that explains the log as well and is in none: a trim of another place, say."""
    assert made.selection is not None
    for other in instead_of_each(made.selection):
        if not found:
            break
        found = _instead(made, other, measure, found, say)
    return found


def _instead(made: Diagnosis, selection: Selection, measure: Measure, found: list[str], say: Say) -> list[str]:
    """What is in doubt replaced by another selection if that is not."""
    before = made.nearest, made.left, made.gain, made.noise, made.remaining
    if not _tested(made, selection, measure, say):
        made.selection = selection
        return []
    made.nearest, made.left, made.gain, made.noise, made.remaining = before
    return found


def _without_idle(made: Diagnosis, shares: tuple[float, ...], measure: Measure, say: Say) -> bool:
    """Where something remains, or is called weather, without the causes that do next to nothing for the predictions:
    they stand in for it.  True where that is so."""
    selection = made.selection
    assert selection is not None
    kept = [k for k, share in enumerate(shares) if share > LEAST_REMOVED]
    wind_alone = selection.weather is not None and selection.weather.is_wind
    if len(kept) == len(shares) or not (kept or wind_alone):
        return False
    before = made.nearest, made.left, made.gain, made.noise, made.remaining
    without = fewer(selection, kept)
    if _tested(made, without, measure, say):
        made.nearest, made.left, made.gain, made.noise, made.remaining = before
        return False
    made.selection = without
    return True


def _unexplained(made: Diagnosis, found: list[str], measure: Measure) -> None:
    selection = made.selection
    assert selection is not None
    other = mistimed(selection) if selection.model.causes else None
    made.verdict = "unexplained"
    made.doubts = tuple(dict.fromkeys([*found, *([other.words] if other is not None else [])]))
    made.where = "sensor" if other is not None and other.is_all else place(made)
    made.nearest = tuple(cause for cause in made.nearest if not cause.is_weather)
    if made.gain is None and made.nearest:
        made.gain = measure(selection)
