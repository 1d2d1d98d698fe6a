"""Stability margins of the loop that flew, from a log: `launchid margins`, `launchid.margins`."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from sim.errors import UsageError
from sim.sections import Required

from .. import progress
from ..argument_checks import DEFAULT_WINDOW, Default, real, window_for
from ..cli.common import check_outputs, read_nominal, read_noting, reading, tell
from ..cli.options import (
    LOG_HELP,
    NOMINAL_HELP,
    add_command,
    add_logs,
    add_map,
    add_outputs,
    add_report,
    add_strict,
    given,
    logs_of,
)
from ..report.answer import Answer, flat

if TYPE_CHECKING:
    from launchid_core import Change, Config, Estimate
    from sim.nominal import Nominal
    from sim.result import Columns, Figure

    from ..log.log import Log
    from ..robustness.airframe import Damping
    from ..robustness.flight_margins import Servo, WindowMargins
    from ..robustness.flown import Choice
    from ..sources import LogSource, LogSources, NominalSource


DAMPING_LIBRARY = "theta,beta,1,theta_dot"


def add(commands: Any) -> None:
    """Add `launchid margins` and its options to argparse's subparsers `commands`."""
    sub = add_command(commands, "margins", "give the stability margins of the flight's loop, with intervals",
                      "launchid margins v.csv vega_like --window 5 --tracked --plot margins.png", margins)
    add_logs(sub, LOG_HELP, f"identify with {NOMINAL_HELP}; with [actuator] (default: none, the log alone)")
    sub.add_argument("--window", metavar="S|all",
                     help="set the length of a window [s], or all: one window, the whole log (default %(default)s, at "
                          "most a third of the log)")
    sub.add_argument("--controller", metavar="WHICH",
                     help="judge this controller: auto, the nominal's where its commands are the log's, else the law "
                          "that the log tells; nominal; log; or numbers as kp=1.5,kd=0.6, which need not have flown "
                          "(default %(default)s)")
    sub.add_argument("--scale", metavar="kp=F,kd=G",
                     help="judge it with these factors on its gains (default: none)")
    sub.add_argument("--tracked", action="store_true",
                     help="give those of the tracked estimate too, at each window's end")
    add_report(sub, "margins.json")
    add_map(sub)
    add_strict(sub)
    add_outputs(sub, plot=True)
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid margins` with its parsed arguments: print the margins, and write what options ask for."""
    names, nominals = logs_of(args)
    logs = [read_noting(name, **reading(args)) for name in names]
    nominal = read_nominal(nominals[0]) if nominals else None
    check_outputs(args.json, plots=(args.plot,), folder=args.report)
    result = margins(logs if len(logs) > 1 else logs[0], nominal, **given(margins, args))
    if args.report:
        result.write_report(args.report)
    tell(result, args.json, args.plot)


def margins(log: LogSources, nominal: NominalSource | None = None, *, window: float | str = DEFAULT_WINDOW,
            tracked: bool = False, controller: str = "auto", scale: str | None = None,
            strict: bool = False) -> FlightMargins | SeveralMargins:
    """Return the stability margins of the flight's loop as identified, with 95 % intervals, window by window.

    Parameters
    ----------
    log : path, data frame, mapping of arrays, Log, or a list of them
    nominal : path, name of a built-in one, or Nominal, optional
        With [actuator]; None: a6, k1, servo and controller are the log's.
    window : float or "all"
        Length of a window [s]; "all": the whole log is one.
    tracked : bool
        Also those of the tracked estimate at each window's end; needs a nominal.
    controller : str
        Whose margins: of the controller that flew ("auto": the nominal's if its commands are the log's, else the law
        that the log tells), "nominal", "log", or numbers such as "kp=1.5,kd=0.6", which need not have flown.
    scale : str, optional
        Factors on the gains, such as "kd=1.3".
    strict : bool
        Raise InputError where the data check finds a fault.

    Returns
    -------
    FlightMargins
        Per window: low and high gain [dB], phase [deg], delay [ms], modulus margin, each with its 95 % interval; why
        where there is none.  Of a list of logs SeveralMargins, which holds that of each.

    Raises
    ------
    InputError
        A nominal without [actuator], or with a loop that is not modelled.
    """
    from ..identification.config import log_config, refuse_too_long, servo_note
    from ..identification.windows import identified
    from ..log.commanded import measured_alone, with_nozzle
    from ..log.phases import checked_flight
    from ..robustness.airframe import is_command, with_damping, with_unknown_servo, without_nozzle
    from ..robustness.damping import damping_of
    from ..robustness.flight_margins import declared_servo
    from ..robustness.flown import choice
    from ..sources import is_several, load_nominal, read_log, several_logs
    asked = choice(controller, scale)
    nominal = None if nominal is None else load_nominal(nominal)
    if is_several(log):
        found = [margins(each, nominal, window=window, tracked=tracked, controller=controller, scale=scale,
                         strict=strict) for each in progress.each(several_logs(log), "logs judged")]
        flights = [each for each in found if isinstance(each, FlightMargins)]
        return SeveralMargins(flights, several_report(flights)) if len(flights) > 1 else flights[0]
    log = cast("LogSource", log)
    if nominal is None:
        if tracked:
            raise UsageError("--tracked needs a nominal")
        return _alone(log, window, strict, asked)
    declared_servo(nominal)  # InputError for a loop without this model, before the log is checked
    if not isinstance(window, (str, Default)):
        window = real("--window", window, "seconds or 'all'")
    seen = checked_flight(read_log(log), nominal, strict=strict)
    if is_command(seen.log):   # nobody saw the nozzle: its servo is estimated from the motion
        seen = replace(seen, log=without_nozzle(seen.log))
        nominal = with_unknown_servo(nominal)
    nominal, damping = with_damping(nominal, damping_of(seen.log, nominal))
    seen, believed, said = with_nozzle(seen, nominal)
    if window == "all":
        refuse_too_long(seen.log)
    config = log_config(seen.log, believed, str(window_for(window, seen.log)), "filtered", True, seen.bridged,
                        library="rigid-body")
    warnings = (*seen.warnings, *said, *servo_note(measured_alone(seen.log), nominal, config))
    result = identified(config, seen)
    return of_identified(measured_alone(seen.log), nominal, result.config, result.judged.estimates,
                         result.estimator.changes(), tracked, (*warnings, *result.warnings), asked, damping)


def _alone(log: LogSource, window: float | str, strict: bool, asked: Choice) -> FlightMargins:
    """Return the margins out of a log alone."""
    from ..identification.log import identified_log
    from ..report.headline import of_identified as headline_of
    from ..report.headline import of_margins
    from ..report.identification import report_of, why
    from ..robustness import flight_margins as fm
    from ..robustness.excitation import excitation
    from ..robustness.log_alone import margins_alone
    from ..sources import read_log
    found = identified_log(read_log(log), window=window, strict=strict, library=DAMPING_LIBRARY)
    answer = report_of(found.result)
    answer |= headline_of(answer, found.log.path, found.log.options, None, False)
    judged = found.result.judged
    windows, servo, flown = margins_alone(found.log, judged.estimates, judged.covariances, judged.late,
                                          answer.get("delay"), asked)
    report = fm.report(windows, servo, Required(), False, flown)
    report["excitation"] = excitation(windows, Required(), found.result.config.window, None)
    if not any(each["valid"] for each in report["windows"]):
        report["why"] = why(report["windows"]).replace("is valid", "has margins")
    report["next"] = answer["next"]
    report |= of_margins(report, Required(), found.log.path, found.log.options, None)
    return FlightMargins(found.log, None, found.result.config, windows, servo, report, found.warnings)


def of_identified(log: Log, nominal: Nominal, config: Config, estimates: Sequence[Estimate],
                  changes: Sequence[Change], tracked: bool, warnings: tuple[str, ...] = (),
                  asked: Choice | None = None, damping: Damping | None = None) -> FlightMargins:
    """Return the stability margins of the windows that `identify` has estimated (`filtered`); tracked: also of its
    tracked estimates; warnings: become the result's; asked: which controller's; damping: of the airframe, as the log
    tells it and `nominal` has it."""
    from ..report.headline import of_margins, shown_path
    from ..report.identification import next_step, why
    from ..robustness import flight_margins as fm
    from ..robustness.excitation import excitation
    from ..robustness.flown import loop_that_flew
    declared = fm.declared_servo(nominal)
    servos = [fm.servo_at(declared, e) for e in estimates]
    flown = loop_that_flew(log, nominal, estimates, servos, asked, damping)
    if damping is not None:
        (flown.findings if damping.is_another else flown.assumed).extend(damping.words)
    windows = fm.flight_margins(estimates, changes, flown, servos, nominal, tracked, damping)
    servo = fm.last_servo(servos, declared)
    report = fm.report(windows, servo, nominal.margins, tracked, flown)
    report["damping"] = None if damping is None else damping.json
    report["excitation"] = excitation(windows, nominal.margins, config.window, shown_path(nominal.path or nominal.name))
    if not any(window["valid"] for window in report["windows"]):
        report["why"] = why(report["windows"]).replace("is valid", "has margins")
    tested = [{"status": e.status.name} for k, e in enumerate(estimates) if k not in flown.refused]
    if config.model is not None and (advice := next_step(tested, config.model)):
        report["next"] = advice
    report |= of_margins(report, nominal.margins, log.path, log.options, shown_path(nominal.path or nominal.name))
    return FlightMargins(log, nominal, config, windows, servo, report, warnings)


@dataclass(frozen=True, eq=False)
class FlightMargins(Answer):
    """Result of `margins`: the stability margins of a flight's loop, window by window."""

    log: Log
    nominal: Nominal | None
    config: Config
    windows: list[WindowMargins]
    servo: Servo
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    def summary(self) -> str:
        from ..report.headline import closing
        from ..robustness import flight_margins as fm
        required = Required() if self.nominal is None else self.nominal.margins
        whose = "out of the log alone" if self.nominal is None else f"of the loop of {self.nominal.name} as identified"
        head = (f"{self.log.path}: margins {whose}, window "
                f"{self.config.window:g} s, value (95 % interval); required: {required.words}")
        if not self.windows:
            return (f"{head}\nno window of {self.config.window:g} s is complete: expected a longer log, or a smaller "
                    "window")
        return "\n".join([head, fm.table(self.report), *closing(self.report)])

    def columns(self) -> Columns:
        return flat(self.report["windows"])

    def write_report(self, folder: str | Path) -> None:
        """Write report.html, margins.json and the figure into a folder."""
        from ..report.margins_page import margins_report
        margins_report(self, folder)

    def _figure(self) -> Figure:
        from ..report.margins_figures import margins_figure
        return margins_figure(self.log, self.nominal, self.windows, self.report)


@dataclass(frozen=True, eq=False)
class SeveralMargins(Answer):
    """Result of `margins` for several flights: that of each, and the factors on the gains that all of them bear."""

    flights: Sequence[FlightMargins]
    report: dict[str, Any]

    @property
    def warnings(self) -> tuple[str, ...]:   # type: ignore[override]
        return tuple(line for each in self.flights for line in each.warnings)

    def summary(self) -> str:
        from ..robustness import flight_margins as fm
        return "\n".join([*(each.summary() for each in self.flights), "all flights:", *fm.gain_lines(self.report)])

    def columns(self) -> Columns:
        return flat([{"log": each.log.path, **window} for each in self.flights for window in each.report["windows"]])

    def write_report(self, folder: str | Path) -> None:
        """Write the report of each flight into a folder of its own, named after its log."""
        for each in self.flights:
            each.write_report(Path(folder) / Path(each.log.path).stem)

    def _figure(self) -> Figure:
        return self.flights[-1]._figure()


def several_report(flights: Sequence[FlightMargins]) -> dict[str, Any]:
    """Return the JSON of several flights: that of each, and the factors on gains that all of them bear."""
    gains: dict[str, list[float | None]] = {}
    for name in ("kp", "kd"):
        ranges = [each.report["gains"][name] for each in flights if name in each.report["gains"]]
        if not ranges:
            continue
        least, largest = math.nan, math.nan
        if [None, None] not in ranges:
            least, largest = max(low for low, _ in ranges), min(high for _, high in ranges)
        gains[name] = [least, largest] if least <= largest else [None, None]
    return {"flights": [{"log": each.log.path, **each.report} for each in flights], "gains": gains}
