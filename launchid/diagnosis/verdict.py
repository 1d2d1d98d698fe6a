"""The diagnosis of one log: through the rooms in their order, and the verdict."""

import functools
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from sim.errors import InputError
from sim.nominal import Nominal

from ..log.detect import check
from ..log.log import Log
from ..log.turns import unwrapped
from ..log.vehicle import plant_faults
from .causes import Hypothesis
from .controller.command import record
from .controller.issued import with_commands
from .data.record import THETA_DOT, Record
from .data.used import shortened, sparser, used
from .data.work import Stopped
from .judge.diagnosis import Diagnosis
from .judge.extend import extended
from .judge.findings import Findings, concluded, place
from .judge.gain import Gain, held_out, on_another, removed
from .judge.leftover import leftovers
from .judge.levels import noise_of
from .judge.limits import limits, unseen
from .judge.measure import (
    DOMINANT,
    EXPLAINED,
    PER_ROW,
    Remainder,
    accused,
    doubts,
    of_gain,
    own_oscillation,
    too_noisy,
    weather_words,
)
from .judge.named import aged, named_causes, named_weather, together, with_removed
from .judge.outdone import outdone
from .judge.threshold import threshold as measured_threshold
from .judge.user_gain import user_gain
from .model.follower import NominalFollower, lost
from .model.noise import ACCELERATION, LEVELS
from .search.changed import instead_of_each
from .search.foresight import LEAST_REMOVED
from .search.profile import Model
from .search.proposal import Proposal, propose
from .search.selection import Say, Selection, fewer, only_strongest
from .search.weather import select

__all__ = ["Diagnosis", "diagnose"]

MASKED = ("stamps", "range", "stale", "dropout", "spike")   # faults of rows; others are of whole columns
FEWEST_ROWS = 40       # without which nothing is fitted: about twice as many as there are unknown numbers
FEWEST_USABLE = 0.5    # of the rows: with fewer left a log is bad data
TERM_MARGIN = 10.0     # nats that missing terms may lose against the doubted causes and still be the better answer
FREE = ("plant", "environment")  # places where a term of the equation may be missing, and where weather acts
LEAST_NAMED = 0.01     # share of the error that a cause must take away to be named where nothing else is left
GROSS = 0.25           # of the squared error over 1 s: more may not stay without the gyro, for theta may be wrong

Measure = Callable[[Selection], Gain]


def diagnose(log: Log, nominal: Nominal, holdout: Log | None = None,
             hypotheses: tuple[Hypothesis, ...] | None = None, bootstrap: int = 0,
             say: Say = lambda text: None, noise: str = "bounded") -> Diagnosis:
    """Diagnose why measurement and simulation part.

    log, nominal  what was measured, what is believed;  holdout  a second log to judge the extension on
    hypotheses    to choose from; None: the catalogue
    bootstrap     clean flights to measure the threshold on; 0: none
    say           told what is being done
    noise         how far levels may be from the declared: "bounded", "declared" or "free"
    """
    say("data check")
    log, turns = unwrapped(log)
    data = check(log, nominal)
    told = replace(data, faults=(*turns, *data.faults)) if turns else data
    made = Diagnosis(log, nominal, told, catalogue=hypotheses is None)
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
    """The diagnosis with causes and verdict, and what could not have been seen; Stopped by the brake."""
    made = _searched(made, holdout, hypotheses, say)
    if _sensors_disagree(made):
        made = _without_gyro(made, holdout, hypotheses, say)
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
    """The diagnosis with the search and the verdict on this record."""
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
            not all(after < GROSS * before for before, after, _ in again.gain.squared.values()):
        return made
    share = again.gain.share if again.gain is not None and again.gain.share is not None else 0.0
    again.verdict = "dominant"
    again.remaining = ("theta_dot does not fit theta and was left out", *again.remaining)
    again.remainder = Remainder(share, "sensor", again.remaining[0])
    return again


def _measure(made: Diagnosis, holdout: Log | None) -> Measure:
    """The measure of a selection's gain: on folds of the record, or on a second log, which passes the first rooms
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
    """Whether there is no undeclared weather, or it is named."""
    return selection.weather is None or selection.weather.is_wind


def _before(selection: Selection) -> Model:
    """The model that a selection extends: where the weather is all there is, the nominal without it."""
    return selection.nominal if selection.model.causes or selection.calm is None else selection.calm


def _judge(made: Diagnosis, measure: Measure, say: Say) -> None:
    """Verdict, place, causes, gain, what remains."""
    assert made.selection is not None and made.record is not None
    nominal, controller, record = made.selection.nominal, made.controller, made.record
    foreign = controller is not None and controller.is_foreign
    found = _tested(made, made.selection, measure, say)
    if found.doubts or foreign:
        made.left_nominal = found.left if made.selection.model is nominal else tuple(leftovers(nominal))
    if found.doubts and made.catalogue and not foreign and \
            place(found, controller, record, made.left_nominal) in FREE:
        found, made.proposal = _with_terms(made, found, measure, say)
    if found.doubts and found.named:
        tried = (_tested(made, each, measure, say) for each in _instead(found))
        found = next((each for each in tried if not each.doubts), found)
    if not found.doubts:
        found = _needed(made, found, measure, say)
    elif found.gain is None and any(not each.is_weather for each in found.named):
        found = replace(found, gain=measure(found.selection))
    end = concluded(found, controller, record, made.left_nominal)
    made.selection, made.left, made.noise, made.gain = found.selection, found.left, found.noise, found.gain
    made.verdict, made.where, made.causes, made.open = end.verdict, end.where, end.causes, end.open
    made.nearest, made.doubts, made.remainder, made.remaining = end.nearest, end.doubts, end.remainder, found.remaining
    if not made.causes:
        return
    if controller is not None and controller.is_named:
        made.gain = made.gain or measure(made.selection)
    made.extension = extended(made.nominal, made.selection.model.causes, record.shift, controller, record.centre,
                              tuple(each for each in made.causes if each.is_weather))
    say("gain for the estimator's user")
    made.user = user_gain(made.nominal, made.extension)


def _tested(made: Diagnosis, selection: Selection, measure: Measure, say: Say) -> Findings:
    """The causes of a selection, what is left beside them, what they gain, and what speaks against them."""
    record = made.record
    assert record is not None
    named, left, noise = named_causes(selection), tuple(leftovers(selection.model)), noise_of(selection.model)
    feigned, span = max(PER_ROW, record.unsure) * record.rows, _span(record)
    found = doubts(named, left, feigned, span, DOMINANT, same_place=False)
    found += [words for each in named for words in (*aged(each, record), *own_oscillation(each, record))]
    strict = doubts(named, left, feigned, span, EXPLAINED, same_place=True)
    noisy = too_noisy(noise, _pushed_by_chance(record))
    weather = selection.weather
    if weather is not None and _is_named(selection) and not strict and noisy is None:
        named = (*named, named_weather(weather))
    elif weather is not None:
        strict.append(f"{weather_words(selection)} remains")
    if noisy is not None:
        strict.append(noisy)
    plain = Findings(selection, named, left, noise)
    if not named:
        return replace(plain, doubts=tuple(strict))
    if not found and selection.model.causes and (better := outdone(selection, left)) is not None:
        found.append(better)
    if selection.instead is not None and any(each.where in FREE for each in named if not each.is_weather):
        found.append("weather alone explains nearly as much as these causes in weather do")
    if found:
        return replace(plain, doubts=tuple(found))
    say("held-out gain")
    gain = measure(selection)
    remaining = (*strict, *of_gain(gain, EXPLAINED))
    least = LEAST_REMOVED if remaining or weather is not None else LEAST_NAMED
    return replace(plain, doubts=tuple(of_gain(gain, DOMINANT, is_part=bool(remaining))), remaining=remaining,
                   gain=gain, needed=least)


def _pushed_by_chance(r: Record) -> str:
    """The level of commands that nothing tells, neither log nor nozzle; "" where there are none."""
    return LEVELS[ACCELERATION] if r.unsure > 0.0 and "beta" not in r.channels else ""


def _span(r: Record) -> tuple[float, float]:
    """The times [s] of first and last row, of the log's clock."""
    return float(r.t[0]) + r.shift, float(r.t[-1]) + r.shift


def _with_terms(made: Diagnosis, found: Findings, measure: Measure, say: Say) -> tuple[Findings, Proposal | None]:
    """Missing terms in the place of causes in doubt, and the proposal: they stand where they explain everything (a term
    that leaves something, be it called weather, may stand for anything)."""
    terms = propose(found.selection, made.threshold, say)
    if terms is None:
        return found, None
    proposal, selection = terms
    again = _tested(made, selection, measure, say)
    behind = found.selection.model.log_likelihood - selection.model.log_likelihood
    own = again.gain or measure(selection)
    if not (own.nats > 0.0 and (own.share is None or own.share < 1.0)):
        return found, None  # what does not predict better is none, though a short log may lose by chance
    explains = not again.doubts and not again.remaining and selection.weather is None and behind < TERM_MARGIN
    return again if explains else found, proposal


def _instead(found: Findings) -> Iterator[Selection]:
    """Selections that may stand where one is in doubt.

    They are: one cause replaced by another that explains the log as well; the causes without those that are in doubt
    themselves; the strongest alone, with what makes sense together with it only; the weather alone.
    """
    of = found.selection
    yield from instead_of_each(of)
    doubted, causes = {name for words in found.doubts for name in accused(words)}, of.model.causes
    sound = [k for k, cause in enumerate(causes) if cause.hypothesis.cause not in doubted]
    strongest = [k for k, stays in enumerate(only_strongest(of)) if stays]
    for kept in (sound, strongest) if sound != strongest else (strongest,):
        if 0 < len(kept) < len(causes):
            yield fewer(of, kept)
    if of.instead is not None:
        yield of.instead


def _needed(made: Diagnosis, found: Findings, measure: Measure, say: Say) -> Findings:
    """Findings without the causes, the idlest first, that take less of the error away than a named one must, each
    judged beside those that are left; and what those take away.  What cannot go for the others' sake stays, and is not
    named."""
    while found.gain is not None:
        selection = found.selection
        shares = removed(selection.model, found.gain)
        groups = list(together(selection.model)) if shares else []
        idle = [(sum(shares[k] for k in group), sum(selection.evidence[k] for k in group), group) for group in groups]
        idle = [each for each in idle if each[0] <= found.needed]
        wind_alone = selection.weather is not None and selection.weather.is_wind
        if idle and (len(groups) > 1 or wind_alone):
            gone = min(idle)[2]
            again = _tested(made, fewer(selection, [k for k in range(len(shares)) if k not in gone]), measure, say)
            if not again.doubts:
                found = again
                continue
        named = with_removed(found.named, selection.model, shares)
        enough = tuple(each for each in named if each.removed is None or each.removed > found.needed)
        return replace(found, named=enough or named)
    return found
