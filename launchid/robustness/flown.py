"""Which loop flew: its controller and its servo, asked of a log window by window.

Controller.  The nominal's is one hypothesis: it is replayed over the log, and where its commands are the log's it flew.
Where they are not, or where it cannot be replayed, the law is fitted to the log (`controller.fit`), over the whole
flight or, if that does not explain the commands, window by window; else, where the columns are not what the controller
saw, by the likelihood of the closed loop (`closed_loop`).  What is left is refused: CONTROLLER where commands
are there that no law explains, UNCHECKED where there is nothing to ask.  A log without commands still has its nozzle:
where that answers the commands that the nominal's controller would have issued as the servo does, both flew.

Servo.  `servo_check` asks it.  One that cannot be asked, and that the nominal declares as known, is UNCHECKED; one that
the log tells no better than [diagnosis] timing is as uncertain as the log leaves it.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from launchid_core import Estimate
from sim.errors import UsageError
from sim.nominal import Controller, Nominal
from sim.nominal.control import OF_LAW
from sim.onboard import onboard_model
from sim.plant import packed

from ..controller.fit import FittedLaw, answered, fit_law
from ..controller.law import Law, law_of
from ..controller.replay import MIN_COMMANDS, NO_COMMANDS, Replay, constants_of, issued, replay, rms
from ..log.log import Log
from .airframe import DAMPING_SUPPOSED, SUPPOSED, Damping, airframe_of
from .closed_loop import data_of, fit_closed_loop
from .servo_check import contradictions, followed, words

CONTROLLER, MODEL_MARK, UNCHECKED = "CONTROLLER", "MODEL", "UNCHECKED"   # another controller, another servo, not asked
FROZEN = "no {}, limit of angle or rate in the loop, all of which stands still"   # of what is left out
DECLARE = "; declare natural_frequency_sigma, damping_ratio_sigma, delay_sigma in [actuator], and it is estimated"
AUTO, OF_NOMINAL, OF_LOG, GIVEN = "auto", "nominal", "log", "given"      # sources of the controller that is judged
SLOWER = 1.5   # of the controller's period: rows that far apart miss commands
SCALABLE = ("kp", "kd")
OFF_GRID = 0.02        # of a period, by which rows may be off the controller's
MOST_PERIODS = 3       # of the controller between two rows
STILL = 3.0            # mean square of windows' a6 and k1 about their mean, over their variances, of a constant vehicle
WIDER = 2.0            # times the deviation of that mean, for the closed loop's own a6 and k1
SERVO_NEAR = np.array([0.02, 0.02, 5e-4])   # ln frequency, ln damping ratio, delay [s]: as a known servo is known
ANOTHER_SERVO = 16.3   # chi square of three, 99.9 %


class Servo(NamedTuple):
    """What is known of a servo: natural frequency [rad/s], damping ratio, delay [s] (3,), their covariance (3, 3).

    A servo of first order has 1 over its time constant in place of the natural frequency, and no damping ratio (1).
    """

    mean: np.ndarray
    covariance: np.ndarray
    is_first_order: bool = False


@dataclass(frozen=True)
class Choice:
    """Which controller is judged.

    source   auto: the nominal's where it flew, else the log's; nominal; log; given: what may never have flown
    given    name -> number of the nominal's controller that is replaced
    kp, kd   factors on the gains
    """

    source: str = AUTO
    given: Mapping[str, float] = field(default_factory=dict)
    kp: float = 1.0
    kd: float = 1.0

    @property
    def is_question(self) -> bool:
        """Whether the loop that is judged is not the one that flew."""
        return self.source == GIVEN or self.kp != 1.0 or self.kd != 1.0


def choice(controller: str = AUTO, scale: str | None = None) -> Choice:
    """Return the choice of `--controller` and `--scale`: words, or numbers as kp=1.5,kd=0.6; UsageError if wrong."""
    factors = _numbers("--scale", scale, SCALABLE) if scale else {}
    for name, factor in factors.items():
        if not factor > 0.0:
            raise UsageError(f"--scale {name}={factor:g}: expected a factor above 0")
    if controller in (AUTO, OF_NOMINAL, OF_LOG):
        return Choice(controller, {}, **factors)
    names = ("kp", "kd", "ki", "derivative_time_constant", "period")
    if "=" not in controller:
        raise UsageError(f"--controller {controller!r}: expected nominal, log, or numbers such as kp=1.5,kd=0.6")
    return Choice(GIVEN, _numbers("--controller", controller, names), **factors)


def _numbers(option: str, text: str, names: Sequence[str]) -> dict[str, float]:
    found: dict[str, float] = {}
    for part in text.split(","):
        name, _, value = (x.strip() for x in part.partition("="))
        try:
            found[name] = float(value)
        except ValueError:
            raise UsageError(f"{option} {text!r}: expected NAME=NUMBER[,NAME=NUMBER...]") from None
        if name not in names or not math.isfinite(found[name]):
            raise UsageError(f"{option} {part!r}: expected a finite number of {', '.join(names)}")
    return found


@dataclass(frozen=True, eq=False)
class Judged:
    """The controller of a window: source (nominal, log, given), its law, and what is not known of it (`fitted`)."""

    source: str
    law: Law
    fitted: FittedLaw | None = None
    others: tuple[FittedLaw, ...] = ()     # that are as likely as the fitted one
    controller: Controller | None = None   # of the nominal, or given
    late: float = 0.0                      # periods of computing time of `controller`
    kp: float = 1.0                        # factors on the gains
    kd: float = 1.0

    def scaled(self, kp: float = 1.0, kd: float = 1.0) -> "Judged":
        """Return it with factors on its gains."""
        if kp == 1.0 and kd == 1.0:
            return self
        if self.controller is None:
            return replace(self, law=self.law.scaled(kp, kd), kp=kp * self.kp, kd=kd * self.kd)
        own = replace(self.controller, kp=kp * self.controller.kp, ki=kp * self.controller.ki,
                      kd=kd * self.controller.kd)
        return replace(self, controller=own, law=law_of(own, late=self.late), kp=kp * self.kp, kd=kd * self.kd)

    def laws(self, numbers: np.ndarray) -> Law:
        """Return the laws of rows of the fitted law's numbers (m, k)."""
        assert self.fitted is not None
        return self.fitted.laws(numbers).scaled(self.kp, self.kd)

    @property
    def each(self) -> list["Judged"]:
        """Return it with each of the laws that the log leaves, the fitted one first."""
        return [self, *(replace(self, law=each.law.scaled(self.kp, self.kd), fitted=each) for each in self.others)]

    @property
    def json(self) -> dict[str, float | str]:
        """The source, the gains with their standard deviations, the period [s]."""
        gains = self.law.gains()
        std = dict.fromkeys(gains, 0.0) if self.fitted is None else {
            name: x * {"kp": self.kp, "kd": self.kd}.get(name, self.kp)
            for name, x in self.fitted.gains_std.items()}
        if self.controller is not None:   # the numbers of the file, whatever filters make of them
            own = self.controller
            gains = {"kp": own.kp, "kd": own.kd} if not own.is_rate_law else {"kp": own.kp, "ki": own.ki}
        said: dict[str, float | str] = {"source": self.source}
        for name, gain in gains.items():
            said |= {name: gain, f"{name}_std": std.get(name, 0.0)}
        return said | {"period": self.law.period}

    @property
    def words(self) -> str:
        """The gains and the period in words."""
        said, names = self.json, ("kp", "kd", "ki")
        gains = ", ".join(f"{name} {said[name]:.4g}" for name in names if name in said)
        of = "" if self.fitted is None else f"; {_remembers(self.fitted)}"
        return f"{gains}, every {self.law.period:g} s{of}"


def _remembers(fitted: FittedLaw) -> str:
    names = {"error": "theta less theta_ref", "rate_error": "theta_dot less rate_ref"}
    order = f"{fitted.order} command{'s' * (fitted.order != 1)} back" if fitted.order else "no memory"
    return f"a law of {' and '.join(names.get(name, name) for name in fitted.of)}, {order}"


@dataclass
class Flown:
    """The loop that flew.

    judged    for each window its controller, None where it is refused
    refused   window number -> status (CONTROLLER, MODEL or UNCHECKED)
    servo     of a servo that is declared as known: what the log leaves of it; None: as declared
    findings  sentences on them;  assumed  sentences on what the log cannot test
    """

    judged: list[Judged | None]
    refused: dict[int, str] = field(default_factory=dict)
    servo: Servo | None = None
    findings: list[str] = field(default_factory=list)
    assumed: list[str] = field(default_factory=list)


def of_nominal(nominal: Nominal) -> Judged:
    """Return the nominal's controller, with its effects on gains and computing time."""
    own = nominal.controller
    assert own is not None
    on_board = packed(nominal)
    late = on_board.computing_time / own.period
    own = replace(own, kp=on_board.kp_scale * own.kp, kd=on_board.kd_scale * own.kd)
    return Judged(OF_NOMINAL, law_of(own, late=late), controller=own, late=late)


def loop_that_flew(log: Log, nominal: Nominal, estimates: Sequence[Estimate], servos: Sequence[Servo],
                   asked: Choice | None = None, damping: Damping | None = None) -> Flown:
    """Return the controller of each window (estimate), and why windows are refused; servos: what is known of the servo
    in each window; damping: of the airframe."""
    asked = Choice() if asked is None else asked
    flown = Flown([None] * len(estimates))
    if asked.source == GIVEN:
        given = _given(nominal, asked)
        flown.judged = [given] * len(estimates)
        flown.assumed.append(f"the controller is the given one, which need not have flown ({given.words})")
        commands = log
    else:
        commands = _controllers(flown, log, nominal, estimates, servos, asked, damping)
    _servos(flown, commands, nominal, estimates, servos)
    flown.judged = [None if k in flown.refused or each is None else each.scaled(asked.kp, asked.kd)
                    for k, each in enumerate(flown.judged)]
    return flown


def _given(nominal: Nominal, asked: Choice) -> Judged:
    """Return the nominal's controller with the given numbers in place of its own."""
    nominal.require("controller")
    own = of_nominal(nominal)
    assert own.controller is not None
    lacks = {"ki", "kd", "derivative_time_constant"} - set(OF_LAW[own.controller.law])
    for name in asked.given:
        if name in lacks:
            raise UsageError(f"--controller {name}: the nominal's law \"{own.controller.law}\" has no {name}")
    numbers: dict[str, Any] = dict(asked.given)
    controller = replace(own.controller, **numbers)
    if not controller.period > 0.0 or controller.derivative_time_constant < 0.0:
        raise UsageError("--controller: expected a period above 0 s and a time constant of at least 0 s")
    return Judged(GIVEN, law_of(controller, late=own.late), controller=controller, late=own.late)


# ---- the controller


def _controllers(flown: Flown, log: Log, nominal: Nominal, estimates: Sequence[Estimate], servos: Sequence[Servo],
                 asked: Choice, damping: Damping | None) -> Log:
    """Find the controller of each window; return the log with its commands, recomputed if it has none."""
    own = None if nominal.controller is None else of_nominal(nominal)
    left = list(range(len(estimates)))      # windows whose controller is not known yet
    untested, contradicted = "", ""
    if asked.source != OF_LOG:
        replayed = replay(log, nominal)
        if isinstance(replayed, str):
            untested = replayed
        else:
            left, contradicted = _replayed(flown, replayed, own, estimates, asked)
    if own is not None and untested and asked.source == OF_NOMINAL:
        flown.judged = [own] * len(estimates)
        flown.assumed.append(f"the controller is the nominal's (not tested: {untested})")
        left = []
    if not left or asked.source == OF_NOMINAL:
        return log
    reason = fitted_laws(flown, log, nominal, estimates, left, contradicted)
    if own is not None and asked.source == AUTO and not np.isfinite(log.beta_cmd).any():
        return _by_the_nozzle(flown, log, nominal, estimates, servos, own, untested)
    still = [k for k in left if flown.judged[k] is None]
    if still and np.isfinite(log.beta_cmd).any():
        reason = likely_laws(flown, log, nominal, estimates, servos, still, damping, contradicted) or reason
        still = [k for k in still if flown.judged[k] is None]
    if still:
        is_there = np.isfinite(log.beta_cmd).any() and (bool(contradicted) or asked.source == OF_LOG)
        status = CONTROLLER if is_there else UNCHECKED
        flown.refused |= dict.fromkeys(still, status)
        why = contradicted if contradicted else f"whose controller flew cannot be tested ({untested or reason})"
        if is_there and not contradicted:
            why = "the commands are not explained"
        law = f"; no law fitted to the log explains them: {reason}" if reason and reason not in why else ""
        flown.findings.append(f"in {counted(still, estimates)} {why} ({status}){law}")
    return log


def _replayed(flown: Flown, replayed: Replay, own: Judged | None, estimates: Sequence[Estimate],
              asked: Choice) -> tuple[list[int], str]:
    """Give the nominal's controller to windows whose commands are its own; return the others, and what they say."""
    ticks = [replayed.judged(e.t_start, e.t_end) for e in estimates]
    few = [int(np.count_nonzero(each)) < MIN_COMMANDS for each in ticks]
    others = [k for k, each in enumerate(ticks) if not few[k] and replayed.contradicts(each)]
    for k in range(len(estimates)):
        if k not in others and (not few[k] or asked.source == OF_NOMINAL):
            flown.judged[k] = own
    if any(few) and asked.source == OF_NOMINAL:
        flown.assumed.append(f"the controller is the nominal's (not tested in {sum(few)} of {len(few)} windows: too "
                             "few rows)")
    if not others:
        return [k for k in range(len(estimates)) if flown.judged[k] is None], ""
    of_others = np.any([ticks[k] for k in others], axis=0)
    said = (f"the commands are not the nominal controller's (CONTROLLER): rms "
            f"{rms(replayed.misfit[of_others]):.2g} rad apart, {replayed.tolerance:.2g} would be none; "
            f"{replayed.words(replayed.explained(of_others))}")
    if asked.source == OF_NOMINAL:
        flown.refused |= dict.fromkeys(others, CONTROLLER)
        flown.findings.append(f"in {counted(others, estimates)} {said}")
    return [k for k in range(len(estimates)) if flown.judged[k] is None], said.replace(" (CONTROLLER)", "")


def fitted_laws(flown: Flown, log: Log, nominal: Nominal | None, estimates: Sequence[Estimate], windows: Sequence[int],
            contradicted: str = "") -> str:
    """Judge windows by the log's own law, written to `flown`: that of the whole flight or, without one, each its own.

    Return why some windows have none; "" if all have.
    """
    ticks = answered(log, nominal)
    if isinstance(ticks, str):
        return ticks
    whole, reason = _as_fast(fit_law(ticks), log, nominal), ""
    taken = []
    for k in windows:
        own = whole
        if isinstance(own, str):
            part = ticks.part(estimates[k].t_start, estimates[k].t_end)
            own = _as_fast(fit_law(part), log, nominal)
            own = _as_fast(fit_law(part, slow=True), log, nominal) if isinstance(own, str) else own
        if isinstance(own, str):
            reason = reason or own
        elif np.count_nonzero(np.isfinite(ticks.part(estimates[k].t_start, estimates[k].t_end).command)) \
                < MIN_COMMANDS:
            reason = reason or "too few rows"
        else:
            flown.judged[k] = Judged(OF_LOG, own.law, own)
            taken.append(k)
    if taken:
        last = flown.judged[taken[-1]]
        assert last is not None
        how = "" if not isinstance(whole, str) else " each window's own; the last:"
        before = f"{contradicted}; " if contradicted else ""
        flown.findings.append(f"in {counted(taken, estimates)} {before}the controller is the log's:{how} {last.words}")
    return reason


def likely_laws(flown: Flown, log: Log, nominal: Nominal | None, estimates: Sequence[Estimate],
                servos: Sequence[Servo], windows: Sequence[int], damping: Damping | None,
                contradicted: str = "") -> str:
    """Give windows the law that the closed loop's likelihood finds, of a log whose columns are not what the controller
    saw, or whose rows are slower than it; return why there is none, or ""."""
    ticks, own = answered(log, nominal), None if nominal is None else nominal.controller
    if isinstance(ticks, str):
        return ticks
    m = 1 if own is None else max(1, round(ticks.period / own.period))
    is_off = own is not None and abs(ticks.period / own.period - m) > OFF_GRID
    if is_off or m > MOST_PERIODS:
        return f"the log's rows are {ticks.period:g} s apart, more than {MOST_PERIODS} or no whole number of periods"
    if nominal is not None and (nominal.test_input is not None or airframe_of(nominal).modes):
        return "with a test input or modes the likelihood of the closed loop is not made"
    data, plant = data_of(ticks, m), _plant(estimates, servos, damping, m > 1)
    if isinstance(data, str) or isinstance(plant, str):
        return data if isinstance(data, str) else str(plant)
    found = fit_closed_loop(data, *plant)
    if isinstance(found, str):
        return found
    first = found[0]
    judged = Judged(OF_LOG, first.law.law, first.law, tuple(each.law for each in found[1:]))
    if m > 1:
        turn = np.array([math.exp(first.plant[2]), math.exp(first.plant[3]), 1.0])
        servo = Servo(first.plant[2:5] * [0.0, 0.0, 1.0] + turn * [1.0, 1.0, 0.0],
                      first.plant_covariance[2:5, 2:5] * np.outer(turn, turn))
        if why := _another_servo(servo, servos):
            flown.refused |= dict.fromkeys(windows, MODEL_MARK)
            flown.findings.append(f"in {counted(windows, estimates)} {why} (MODEL)")
            return ""
        flown.servo = servo
    for k in windows:
        flown.judged[k] = judged
    of = f"{m} periods of the controller lie between rows" if m > 1 else "its columns are not what the controller saw"
    before = f"{contradicted}; " if contradicted else ""
    flown.findings.append(
        f"in {counted(windows, estimates)} {before}the controller is the log's, by the likelihood of the closed loop ("
        f"{of}): {judged.words}" + (f"; {len(found) - 1} other laws are as likely, and in the intervals"
                                     if len(found) > 1 else ""))
    return ""


def _plant(estimates: Sequence[Estimate], servos: Sequence[Servo], damping: Damping | None,
           is_servo_free: bool) -> tuple[np.ndarray, np.ndarray] | str:
    """Return the plant (6,) for the likelihood of the closed loop, a6, k1, ln frequency, ln damping ratio, delay of the
    servo, damping, and what is not known of it (6, 6); a sentence if it is no constant one.

    is_servo_free  the servo is as unknown as SUPPOSED
    """
    told = np.array([(e.a6, e.k1, e.a6_std, e.k1_std) for e in estimates if e.valid]).reshape(-1, 4)
    if not len(told):
        return "no window has a6 and k1"
    value, std = told[:, :2], np.maximum(told[:, 2:], 1e-9)
    weight = 1.0 / std**2
    mean = np.sum(weight * value, axis=0) / np.sum(weight, axis=0)
    if np.any(np.mean(((value - mean) / std)**2, axis=0) > STILL):
        return "a6 or k1 change in the flight, for which the likelihood of the closed loop has no place"
    servo = servos[-1]
    if servo.is_first_order or not np.isfinite(servo.mean).all():
        return "the servo is not of second order"
    unit = np.array([1.0 / servo.mean[0], 1.0 / servo.mean[1], 1.0])
    covariance = np.zeros((6, 6))
    covariance[:2, :2] = np.diag(WIDER**2 / np.sum(weight, axis=0))
    covariance[2:5, 2:5] = servo.covariance * np.outer(unit, unit) + np.diag(np.square(SERVO_NEAR))
    if is_servo_free:
        covariance[2:5, 2:5] = np.diag(np.square(list(SUPPOSED.values())))
    d, d_std = (0.0, DAMPING_SUPPOSED) if damping is None else damping.used
    covariance[5, 5] = d_std**2
    return np.array([*mean, math.log(servo.mean[0]), math.log(servo.mean[1]), servo.mean[2], d]), covariance


def _another_servo(found: Servo, servos: Sequence[Servo]) -> str:
    """Return a sentence if the servo that the closed loop shows is not the one that is declared, else ""."""
    off = found.mean - servos[-1].mean
    spread = found.covariance + servos[-1].covariance + np.diag(np.square(SERVO_NEAR * np.array(
        [found.mean[0], found.mean[1], 1.0])))
    chi = float(off @ np.linalg.solve(spread, off))
    if chi < ANOTHER_SERVO:
        return ""
    w, zeta, delay = found.mean
    return (f"the servo is another: {w:.3g} rad/s, damping ratio {zeta:.2g}, delay {1e3 * delay:.3g} ms make the "
            "closed loop likelier")


def _as_fast(law: FittedLaw | str, log: Log, nominal: Nominal | None) -> FittedLaw | str:
    """Return a law, or why it need not be the controller's: one without memory explains every second command too, so
    the rows of a log slower than the nominal's controller need not be all its ticks."""
    own = None if nominal is None else nominal.controller
    if isinstance(law, str) or own is None or log.period <= SLOWER * own.period or law.order > 0:
        return law
    return f"the log's rows are {log.period:g} s apart, the controller's commands {own.period:g} s"


def _by_the_nozzle(flown: Flown, log: Log, nominal: Nominal, estimates: Sequence[Estimate], servos: Sequence[Servo],
                   own: Judged, untested: str) -> Log:
    """Ask the nozzle of a log without commands whether it answers those that the nominal's controller would have
    issued; return the log with them.  What it does not answer is UNCHECKED."""
    made = recomputed(log, nominal)
    if isinstance(made, str):
        why = untested if made in untested else f"{untested}; {made}"
        flown.refused |= dict.fromkeys(range(len(estimates)), UNCHECKED)
        flown.findings.append(f"in {counted(range(len(estimates)), estimates)} whose controller flew cannot be tested "
                              f"({why}) (UNCHECKED)")
        return log
    follows = followed(made, onboard_model(nominal))
    found: Sequence[bool | None] = [None] * len(estimates)
    if not isinstance(follows, str):
        found = contradictions(follows, [(e.t_start, e.t_end) for e in estimates],
                               [(each.mean, each.covariance) for each in servos]).found
    flown.judged = [own if each is False else None for each in found]
    others = [k for k, each in enumerate(found) if each is not False]
    if others:
        flown.refused |= dict.fromkeys(others, UNCHECKED)
        flown.findings.append(
            f"in {counted(others, estimates)} the log has no beta_cmd, and the nozzle does not answer the commands "
            "that the nominal's controller would have issued as the servo does: which of the two is another cannot be "
            "told (UNCHECKED)")
    if len(others) < len(found):
        flown.assumed.append("the commands are those that the nominal's controller makes of theta and theta_ref (the "
                             "log has none; its nozzle answers them)")
    return made


def recomputed(log: Log, nominal: Nominal) -> Log | str:
    """Return the log with the commands that the nominal's controller would have issued; a sentence if that cannot be
    known."""
    own = nominal.controller
    assert own is not None
    lacking = [name for name in (*(name for pair in own.reads for name in pair), "beta")
               if not np.isfinite(getattr(log, name)).any()]
    if lacking:
        return f"the log has no {' and no '.join(lacking)}"
    if own.followed:
        return "a filter of it follows a mode, which the estimator on board told with the commands"
    held = max(1, round(own.period / log.period))
    if log.period > SLOWER * own.period:
        return f"the log's rows are {log.period:g} s apart, the controller's commands {own.period:g} s"
    error, *rates = ((getattr(log, seen) - getattr(log, reference))[::held] for seen, reference in own.reads)
    commands, _ = issued(nominal, constants_of(nominal), error, np.full(len(error), -0.0),
                         rates=rates[0] if rates else NO_COMMANDS)
    return replace(log, beta_cmd=np.repeat(commands, held)[:len(log.t)])


# ---- the servo


def _servos(flown: Flown, log: Log, nominal: Nominal, estimates: Sequence[Estimate], servos: Sequence[Servo]) -> None:
    """Refuse windows whose nozzle does not answer the commands as the servo does, or cannot be asked."""
    model = onboard_model(nominal)
    of_log = [each.law.period for each in flown.judged if each is not None and each.source == OF_LOG]
    follows = followed(log, replace(model, noise_period=min(of_log)) if of_log else model)
    is_known = not any(each.covariance.any() for each in servos)
    if isinstance(follows, str):
        if flown.servo is not None:   # the closed loop told it
            flown.assumed.append("the servo does not change (its numbers are the closed loop's)")
            return
        if not is_known:
            flown.assumed.append("the servo does not change, and is what the motion shows of it about the declared one "
                                 f"(not tested: {follows})")
            return
        others = [k for k in range(len(estimates)) if k not in flown.refused]
        flown.refused |= dict.fromkeys(others, UNCHECKED)
        if others:
            flown.findings.append(f"in {counted(others, estimates)} the servo cannot be tested ({follows}) and is "
                                  f"declared as known (UNCHECKED){DECLARE}")
        return
    windows = [(e.t_start, e.t_end) for e in estimates]
    asked = contradictions(follows, windows, [(each.mean, each.covariance) for each in servos])
    if is_known and np.isfinite(asked.shown).all():
        w, zeta, delay = asked.shown
        told = "the servo's numbers are those declared: differences below"
        if asked.deviation[2] > nominal.diagnosis.timing:
            flown.servo = servos[0]._replace(covariance=asked.covariance)
            told = "the servo is as uncertain as the log leaves it, about the declared numbers: differences below"
        flown.assumed.append(f"{told} {w:.2g} rad/s, {zeta:.2g} of the damping ratio, {1e3 * delay:.2g} ms of delay "
                             "would not have shown" + DECLARE)
    untold = [k for k, each in enumerate(asked.found) if each is None]
    if untold and not is_known:
        flown.assumed.append(f"the servo does not change (not tested in {len(untold)} of {len(asked.found)} windows: "
                             "too few rows)")
    elif untold:
        flown.refused |= dict.fromkeys((k for k in untold if k not in flown.refused), UNCHECKED)
        flown.findings.append(f"in {counted(untold, estimates)} the servo cannot be tested: too few rows (UNCHECKED)")
    if another := [k for k, is_other in enumerate(asked.found) if is_other and flown.refused.get(k) != UNCHECKED]:
        flown.refused |= {k: MODEL_MARK for k in another if k not in flown.refused}
        flown.findings.append(
            f"in {counted(another, estimates)} the nozzle does not answer the commands as the servo does (MODEL): "
            + words(follows, windows[another[-1]], servos[another[-1]].mean) + DECLARE * is_known)


def counted(which: Sequence[int], estimates: Sequence[Estimate]) -> str:
    """Return how many windows `which` (numbers) lists, and from when on: `3 of 14 windows, from 30 s on,`."""
    return f"{len(which)} of {len(estimates)} windows, from {estimates[which[0]].t_start:g} s on,"


