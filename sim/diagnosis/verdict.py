"""The diagnosis of one log: through the rooms in their order, and the verdict."""

import functools
from collections.abc import Callable
from dataclasses import replace

from ..errors import InputError
from ..log import Log
from ..nominal import Nominal
from .causes import Hypothesis
from .controller.command import record
from .controller.issued import is_slow, with_commands
from .controller.kind import FILTER, ControllerCheck
from .data.check import check
from .data.record import Record
from .judge.diagnosis import Diagnosis
from .judge.extend import extended
from .judge.gain import Gain, held_out, on_another
from .judge.leftover import leftovers
from .judge.levels import noise_of
from .judge.limits import limits, unseen
from .judge.named import doubts_about, mismatch, named_causes
from .judge.threshold import threshold as measured_threshold
from .judge.user_gain import user_gain
from .model.follower import NominalFollower
from .search.proposal import propose
from .search.selection import THRESHOLD, Say, Selection
from .search.weather import select

__all__ = ["Diagnosis", "diagnose"]

MASKED = ("stamps", "range", "stale", "dropout", "spike")   # faults of rows; others are of whole columns
FEWEST_ROWS = 100      # without which nothing is fitted
TERM_MARGIN = 10.0     # nats that missing terms may lose against the doubted causes and still be the better answer
FREE = ("plant", "environment")  # places where a term of the equation may be missing

Measure = Callable[[Selection], Gain]


def diagnose(log: Log, nominal: Nominal, holdout: Log | None = None, threshold: float = THRESHOLD,
             hypotheses: tuple[Hypothesis, ...] | None = None, bootstrap: int = 0,
             say: Say = lambda text: None) -> Diagnosis:
    """Why measurement and simulation part.

    log, nominal  what was measured, what is believed;  holdout  a second log to judge the extension on
    threshold     [nats] of evidence for a first cause
    hypotheses    to choose from; None: the catalogue
    bootstrap     clean flights to measure the threshold on; 0: take `threshold`
    say           told what is being done
    """
    say("data check")
    data = check(log, nominal)
    made = Diagnosis(log, nominal, data, threshold=threshold, catalogue=hypotheses is None)
    if data.is_bad:
        made.where = "data"
        return made if not all(fault.kind in MASKED for fault in data.faults) else _beneath(made, say)
    return _examined(made, holdout, bootstrap, hypotheses, say)


def _beneath(made: Diagnosis, say: Say) -> Diagnosis:
    """A log with faults that can be masked: the verdict stays `bad-data`; what the rest would have said is kept."""
    rest = replace(made)
    try:
        _examined(rest, None, 0, None, say)
    except InputError:
        return made  # too little is left
    made.beneath = (rest.verdict, tuple(cause.cause for cause in rest.causes))
    made.record, made.selection, made.noise = rest.record, rest.selection, rest.noise
    made.limits, made.isolability, made.controller = rest.limits, rest.isolability, rest.controller
    return made


def _examined(made: Diagnosis, holdout: Log | None, bootstrap: int, hypotheses: tuple[Hypothesis, ...] | None,
              say: Say) -> Diagnosis:
    """Everything after the data check; InputError where the log holds no input."""
    r = made.record = record(made.log, made.nominal, made.data)
    if r.rows < FEWEST_ROWS:
        made.verdict = "consistent"  # nothing is wrong that so short a log could show, and the limits say none could
        made.limits = tuple(unseen())
        return made
    r, made.controller = with_commands(r, NominalFollower())
    made.record = r
    if bootstrap > 0:
        made.threshold = measured_threshold(r, bootstrap, say)
    made.selection = select(r, made.threshold, hypotheses, say)
    say("goodness")
    _judge(made, _measure(made, holdout), say)
    say("detection limits")
    found, made.isolability = limits(r, made.selection.model, made.threshold)
    made.limits = tuple(found)
    made.noise = noise_of(made.selection.model)
    return made


def _measure(made: Diagnosis, holdout: Log | None) -> Measure:
    """How a selection's gain is measured: on folds of the record, or on a second log, which passes the first rooms
    once, when it is first asked for."""
    r, nominal = made.record, made.nominal
    if holdout is None:
        assert r is not None
        return lambda selection: held_out(r, selection.model, selection.nominal, made.controller)

    @functools.cache
    def second() -> Record:
        assert holdout is not None
        return with_commands(record(holdout, nominal, check(holdout, nominal)), NominalFollower())[0]

    return lambda selection: on_another(second(), selection.model, selection.nominal, made.controller)


def _judge(made: Diagnosis, measure: Measure, say: Say) -> None:
    """Verdict, place, causes, gain."""
    controller = made.controller
    assert made.selection is not None
    doubts = _tested(made, made.selection, measure, say)
    foreign = controller is not None and controller.is_foreign
    if doubts or foreign:
        nominal = made.selection.nominal
        made.left_nominal = made.left if made.selection.model is nominal else tuple(leftovers(nominal))
    if doubts and not foreign and made.catalogue and _place(made) in FREE:
        doubts = _with_terms(made, measure, doubts, say)
    if foreign:
        assert controller is not None
        doubts.append(f"the logged command is not the nominal controller's ({_controller_words(controller)})")
    if doubts:
        _unexplained(made, doubts, measure)
        return
    causes = list(made.nearest)
    if controller is not None and controller.is_named:
        causes.append(mismatch(controller))
        made.gain = made.gain or measure(made.selection)
    causes.sort(key=lambda cause: -cause.evidence)
    made.causes, made.nearest = tuple(causes), ()
    made.verdict = "explained" if causes else "consistent"
    made.where = causes[0].where if causes else None
    if causes:
        assert made.record is not None
        made.extension = extended(made.nominal, made.selection.model.causes, made.record.shift, controller,
                                  made.record.centre)
        say("gain for the estimator's user")
        made.user = user_gain(made.nominal, made.extension)


def _tested(made: Diagnosis, selection: Selection, measure: Measure, say: Say) -> list[str]:
    """The best causes of a selection into `nearest`, with what is left and what they gain; the doubts about them."""
    made.nearest = named_causes(selection)
    made.left = tuple(leftovers(selection.model))
    assert made.record is not None
    first, last = (float(made.record.t[k]) + made.record.shift for k in (0, -1))
    doubts = doubts_about(made.nearest, made.left, first, last)
    if made.nearest and not doubts:
        say("held-out gain")
        made.gain = measure(selection)
        if not made.gain.nats > 0.0:
            doubts.append(f"on data left out of the fit the causes lose {-made.gain.nats:.0f} nats")
    return doubts


def _with_terms(made: Diagnosis, measure: Measure, doubts: list[str], say: Say) -> list[str]:
    """Missing terms in the place of the catalogue's causes: kept where they pass every test, else a proposal."""
    assert made.selection is not None
    before = made.nearest, made.left, made.gain
    found = propose(made.selection.nominal, made.threshold, say)
    if found is None:
        return doubts
    made.proposal, selection = found
    again = _tested(made, selection, measure, say)
    if not again and selection.model.log_likelihood > made.selection.model.log_likelihood - TERM_MARGIN:
        made.selection = selection
        return []
    made.nearest, made.left, made.gain = before
    return doubts


def _unexplained(made: Diagnosis, doubts: list[str], measure: Measure) -> None:
    selection = made.selection
    assert selection is not None
    made.verdict, made.doubts = "unexplained", tuple(doubts)
    made.where = _place(made)
    if made.gain is None and made.nearest:
        made.gain = measure(selection)


def _controller_words(controller: ControllerCheck) -> str:
    if controller.kind == FILTER and controller.time_constant is not None:
        return f"a derivative time constant of {controller.time_constant:.4g} s would explain it"
    return f"{controller.before:.2g} rad rms apart, {controller.after:.2g} after the best gains and delay"


def _place(made: Diagnosis) -> str:
    """Where the misfit is: the controller if its command is foreign, else where a disturbance helps most, or the
    place of the nearest cause where that explains more.  Of a controller that is not known a slow log does not have the
    commands between its rows, which then seems the actuator's fault."""
    assert made.selection is not None and made.record is not None
    slow = is_slow(made.record)
    foreign = made.controller if made.controller is not None and made.controller.is_foreign else None
    best = max((each for each in made.left_nominal if not each.is_line), key=lambda leftover: leftover.gain)
    if foreign is not None and (foreign.evidence > best.gain or not slow):
        return "controller"
    strongest = max(made.nearest, key=lambda cause: cause.evidence, default=None)
    where = strongest.where if strongest is not None and strongest.evidence > best.gain else best.where
    return "controller" if foreign is not None and where == "actuator" else where
