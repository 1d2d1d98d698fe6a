"""The diagnosis of one log: the checks in their order, and the verdict."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..errors import InputError
from ..log import Log
from ..nominal import Nominal
from .controller_check import check_controller
from .controller_gaps import Seen
from .controller_kind import FILTER, NONE, UNKNOWN, ControllerCheck
from .controller_refined import refined
from .data_check import DataCheck, check
from .extend import extended
from .fill import Controller, as_believed, filled
from .gain import Gain, held_out, on_another
from .goodness import Leftover, leftovers
from .hypotheses import Hypothesis
from .limits import Isolability, Limit, limits, unseen
from .model import Point, innovations, predicted_attitude
from .named import Named, doubts_about, mismatch, named_causes
from .noise import LEVELS, Refilter, declared
from .predictor import ESCAPED
from .proposal import Proposal, propose
from .record import CHANNELS, Record, record
from .selection import THRESHOLD, Model, Selection, first_filter, select
from .threshold import threshold as measured_threshold
from .user_gain import UserGain, user_gain

MASKED = ("stamps", "range", "stale", "dropout", "spike")   # faults of rows; others are of whole columns
FEWEST = 100           # rows, without which nothing is fitted
SIGNIFICANT = 3.0      # standard deviations of a noise level
LEVEL_STEP = 0.05      # of a log factor, for its standard deviation
ALERT = np.array([1.0, 1.0, 1.0, 1.0, 30.0])  # levels between rows: the plant may be wrong, follow the sensors
FILLINGS = 2           # passes over a slow log: the second has the first's commands to predict with
TERM_MARGIN = 10.0     # nats that missing terms may lose against the doubted causes and still be the better answer
DECIDES = {
    frozenset({"steady_wind", "attitude_bias"}): "an independent attitude reference, or air data",
    frozenset({"thrust_misalignment", "steady_wind"}): "a flight in which a6 and k1 change differently",
    frozenset({"thrust_misalignment", "attitude_bias"}): "a flight in which a6 and k1 change differently",
    frozenset({"actuator_gain", "control_effectiveness"}): "the nozzle sensor",
    frozenset({"actuator_bias", "thrust_misalignment"}): "the nozzle sensor",
    frozenset({"actuator_bias", "steady_wind"}): "the nozzle sensor",
    frozenset({"actuator_bias", "attitude_bias"}): "the nozzle sensor",
    frozenset({"actuator_delay", "actuator_bandwidth"}): "the nozzle sensor several times as often as commands come",
}

Say = Callable[[str], None]


@dataclass(eq=False)
class Diagnosis:
    """Everything that was found; arrays and models for the report, words for the verdict.

    doubts     why the best causes are not believed (unexplained), one line each
    nearest    the best causes of an `unexplained` log: they are not its cause
    proposal   missing terms that would help an `unexplained` log
    beneath    of `bad-data` whose faults can be masked: verdict and causes of what is left
    catalogue  whether all causes were allowed, missing terms too
    """

    log: Log
    nominal: Nominal
    data: DataCheck
    verdict: str = "bad-data"
    where: str | None = None
    causes: tuple[Named, ...] = ()
    nearest: tuple[Named, ...] = ()
    doubts: tuple[str, ...] = ()
    record: Record | None = None
    selection: Selection | None = None
    controller: ControllerCheck | None = None
    left_nominal: tuple[Leftover, ...] = ()
    left: tuple[Leftover, ...] = ()
    limits: tuple[Limit, ...] = ()
    isolability: Isolability | None = None
    noise: dict[str, dict[str, Any]] = field(default_factory=dict)
    gain: Gain | None = None
    extension: Nominal | None = None
    user: UserGain | None = None
    proposal: Proposal | None = None
    beneath: tuple[str, tuple[str, ...]] | None = None
    threshold: float = THRESHOLD
    catalogue: bool = True


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
    threshold = made.threshold
    r = made.record = record(made.log, made.nominal, made.data)
    if r.rows < FEWEST:
        made.verdict = "consistent"  # nothing is wrong that so short a log could show, and the limits say none could
        made.limits = tuple(unseen())
        return made
    r, made.controller = with_commands(r)
    made.record = r
    if bootstrap > 0:
        threshold = made.threshold = measured_threshold(r, bootstrap, say)
    made.selection = select(r, threshold, hypotheses, say)
    say("goodness")
    _judge(made, holdout, say)
    say("detection limits")
    found, made.isolability = limits(r, made.selection.model, threshold)
    made.limits = tuple(found)
    made.noise = noise_of(made.selection.model)
    return made


def with_commands(r: Record) -> tuple[Record, ControllerCheck | None]:
    """The controller's check; and of a log slower than the controller the missing commands, where the check allows."""
    if not _is_slow(r) or not np.isfinite(r.reference).any():
        return r, check_controller(r)
    checked, unfilled = None, r
    for _ in range(FILLINGS):
        gains = first_filter(r, declared(r) * ALERT)
        seen = Seen(predicted_attitude(r, gains), innovations(r, gains, Point())[0])
        if not np.all(np.abs(seen.attitude) < ESCAPED):
            return unfilled, None  # the nominal does not stay with the log
        checked = check_controller(r, seen)
        if checked is not None and checked.kind == UNKNOWN:
            return unfilled, checked
        believed = as_believed(r)
        r = filled(r, seen.attitude, believed if checked is None or checked.kind == NONE else Controller(
            checked.kp_scale, checked.kd_scale, checked.time_constant or believed.time_constant,
            checked.late(r.tick * r.step)))
    if checked is not None and checked.kind != NONE:
        checked, likeliest = refined(r, seen, checked, first_filter(r, declared(r)))
        r = filled(r, seen.attitude, likeliest)
    return r, checked


def _is_slow(r: Record | None) -> bool:
    """The log has not every command that its controller issued."""
    return r is not None and r.every > r.tick and r.input == "beta_cmd" and r.nominal.controller is not None


def _judge(made: Diagnosis, holdout: Log | None, say: Say) -> None:
    """Verdict, place, causes, gain."""
    controller = made.controller
    assert made.selection is not None
    doubts = _tested(made, made.selection, holdout, say)
    foreign = controller is not None and controller.is_foreign
    if doubts or foreign:
        nominal = made.selection.nominal
        made.left_nominal = made.left if made.selection.model is nominal else tuple(leftovers(nominal))
    if doubts and not foreign and made.catalogue and _place(made) in ("plant", "environment"):
        doubts = _with_terms(made, holdout, doubts, say)
    if foreign:
        assert controller is not None
        doubts.append(f"the logged command is not the nominal controller's ({_controller_words(controller)})")
    if doubts:
        _unexplained(made, doubts, holdout)
        return
    causes = list(made.nearest)
    if controller is not None and controller.is_named:
        causes.append(mismatch(controller))
        made.gain = made.gain or _gain_of(made, made.selection, holdout)
    causes.sort(key=lambda cause: -cause.evidence)
    made.causes, made.nearest = tuple(causes), ()
    made.verdict = "explained" if causes else "consistent"
    made.where = causes[0].where if causes else None
    if causes:
        assert made.record is not None
        made.extension = extended(made.nominal, made.selection.model.causes, made.record.shift, controller)
        say("gain for the estimator's user")
        made.user = user_gain(made.nominal, made.extension)


def _tested(made: Diagnosis, selection: Selection, holdout: Log | None, say: Say) -> list[str]:
    """The best causes of a selection into `nearest`, with what is left and what they gain; the doubts about them."""
    made.nearest = named_causes(selection)
    made.left = tuple(leftovers(selection.model))
    made.gain = None
    assert made.record is not None
    first, last = (float(made.record.t[k]) + made.record.shift for k in (0, -1))
    doubts = doubts_about(made.nearest, made.left, first, last)
    if made.nearest and not doubts:
        say("held-out gain")
        made.gain = _gain_of(made, selection, holdout)
        if not made.gain.nats > 0.0:
            doubts.append(f"on data left out of the fit the causes lose {-made.gain.nats:.0f} nats")
    return doubts


def _with_terms(made: Diagnosis, holdout: Log | None, doubts: list[str], say: Say) -> list[str]:
    """Missing terms in the place of the catalogue's causes: kept where they pass every test, else a proposal."""
    assert made.selection is not None
    before = made.nearest, made.left, made.gain
    found = propose(made.selection.nominal, made.threshold, say)
    if found is None:
        return doubts
    made.proposal, selection = found
    again = _tested(made, selection, holdout, say)
    if not again and selection.model.log_likelihood > made.selection.model.log_likelihood - TERM_MARGIN:
        made.selection = selection
        return []
    made.nearest, made.left, made.gain = before
    return doubts


def _unexplained(made: Diagnosis, doubts: list[str], holdout: Log | None) -> None:
    selection = made.selection
    assert selection is not None
    made.verdict, made.doubts = "unexplained", tuple(doubts)
    made.where = _place(made)
    if made.gain is None and made.nearest:
        made.gain = _gain_of(made, selection, holdout)


def _gain_of(made: Diagnosis, selection: Selection, holdout: Log | None) -> Gain:
    assert made.record is not None
    model, nominal = selection.model, selection.nominal
    if holdout is not None:
        data = check(holdout, made.nominal)
        return on_another(with_commands(record(holdout, made.nominal, data))[0], model, nominal, made.controller)
    return held_out(made.record, model, nominal, made.controller)


def _controller_words(controller: ControllerCheck) -> str:
    if controller.kind == FILTER and controller.time_constant is not None:
        return f"a derivative time constant of {controller.time_constant:.4g} s would explain it"
    return f"{controller.before:.2g} rad rms apart, {controller.after:.2g} after the best gains and delay"


def _place(made: Diagnosis) -> str:
    """Where the misfit is: the controller if its command is foreign, else where a disturbance helps most, or the
    place of the nearest cause where that explains more.  Of a controller that is not known a slow log does not have the
    commands between its rows, which then seems the actuator's fault."""
    assert made.selection is not None
    foreign = made.controller if made.controller is not None and made.controller.is_foreign else None
    best = max((each for each in made.left_nominal if not each.is_line), key=lambda leftover: leftover.gain)
    if foreign is not None and (foreign.evidence > best.gain or not _is_slow(made.record)):
        return "controller"
    strongest = max(made.nearest, key=lambda cause: cause.evidence, default=None)
    where = strongest.where if strongest is not None and strongest.evidence > best.gain else best.where
    return "controller" if foreign is not None and where == "actuator" and _is_slow(made.record) else where


def noise_of(model: Model) -> dict[str, dict[str, Any]]:
    """Each level over the declared, and whether it differs beyond doubt."""
    r, fitted = model.fit.record, model.fit
    base, refilter = declared(r), Refilter(r, model.dynamics, fitted.innovations, fitted.filter)
    found: dict[str, dict[str, Any]] = {}
    values = {}
    for k, name in enumerate(LEVELS):
        if (name in CHANNELS and name not in r.channels) or (name == "command" and not r.command_is_known):
            continue
        for sign in (-1.0, 0.0, 1.0):
            levels = fitted.filter.levels.copy()
            levels[k] *= math.exp(sign * LEVEL_STEP)
            values[sign] = refilter.log_likelihood(levels)
        curvature = (2.0 * values[0.0] - values[-1.0] - values[1.0]) / LEVEL_STEP**2
        std = 1.0 / math.sqrt(curvature) if curvature > 0.0 else math.inf
        factor = float(fitted.filter.levels[k] / base[k])
        if not (math.isfinite(factor) and factor > 0.0):
            continue  # the model does not stay with the log, so its noise is unknown
        found[name] = {"factor": factor, "std": std * factor if math.isfinite(std) else None,
                       "significant": bool(abs(math.log(factor)) > SIGNIFICANT * std)}
    return found
