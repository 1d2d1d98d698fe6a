"""Find why a simulation disagrees with a log: `launchid diagnose`, `launchid.diagnose`."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from ..argument_checks import integer, word
from ..cli.common import at_least, check_outputs, read_nominal, read_noting, reading, tell
from ..cli.options import (
    LOG_HELP,
    NOISE_CHOICES,
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
    from sim.nominal import Nominal
    from sim.result import Columns, Figure

    from ..diagnosis.named import Result
    from ..log.log import Log
    from ..report.comparison import Comparison
    from ..sources import LogSource, LogSources, NominalSource

FOLDER = "report"  # of the report, where no other is named


def add(commands: Any) -> None:
    """Add `launchid diagnose` and its options to argparse's subparsers `commands`."""
    sub = add_command(commands, "diagnose", "find why a simulation disagrees with a log, and how much the fix gains",
                      "launchid diagnose v.csv vega_like --report report", diagnose)
    add_logs(sub, f"{LOG_HELP}; one of theta and theta_dot, and one of beta and beta_cmd, is enough",
             f"compare the log with {NOMINAL_HELP}", required=True)
    sub.add_argument("--holdout", metavar="LOG2.csv",
                     help="judge the extended nominal on this second log (default: on parts of the first that are held "
                          "out)")
    sub.add_argument("--bootstrap", type=int, metavar="N",
                     help="diagnose N clean flights of the nominal too, and say how many are not found consistent "
                          "(default %(default)s)")
    sub.add_argument("--noise", choices=NOISE_CHOICES,
                     help="choose how noise levels are fitted. bounded: within 0.3 to 3 times the nominal's (wind 0 "
                          "to 2 times); declared: fixed at the nominal's; free: without limits (default %(default)s)")
    add_report(sub, "verdict.json, extension.toml")
    add_map(sub)
    add_strict(sub)
    add_outputs(sub)
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid diagnose` with its parsed arguments: print the diagnosis, and write what options ask for."""
    at_least("--bootstrap", args.bootstrap, 0)
    names, nominals = logs_of(args)
    logs = [read_noting(name, "t", **reading(args)) for name in names]
    nominal = read_nominal(nominals[0])
    holdout = read_noting(args.holdout, "t", **reading(args)) if args.holdout else None
    check_outputs(args.json, folder=args.report)
    args.holdout = holdout
    result = _diagnosed(logs if len(logs) > 1 else logs[0], nominal, args.report or FOLDER, **given(diagnose, args))
    if args.report:
        result.write_report(args.report)
    tell(result, args.json)


def diagnose(log: LogSources, nominal: NominalSource, *, holdout: LogSource | None = None, bootstrap: int = 0,
             noise: str = "bounded", strict: bool = False) -> Diagnosed | Diagnoses:
    """Find why a simulation disagrees with a log, and how much the fix improves its predictions.

    Parameters
    ----------
    log : path, data frame, mapping of arrays, Log; or a list of these
        A list: flights of one vehicle, each diagnosed, and all of them in one fit. One of theta and theta_dot, and one
        of beta and beta_cmd, is enough.
    nominal : path, name of a built-in one, or Nominal
    holdout : as log, optional
        A second log, to judge the extended model on; None: parts of the first.
    bootstrap : int
        Clean flights of the nominal that are diagnosed too, to count false alarms.
    noise : str
        How far noise levels may be from the declared: "bounded", "declared" (not at all) or "free".
    strict : bool
        Raise InputError where the data check finds a fault.

    Returns
    -------
    Diagnosed
        Of a list of logs Diagnoses, which hold that of each.
    """
    return _diagnosed(log, nominal, FOLDER, holdout=holdout, bootstrap=bootstrap, noise=noise, strict=strict)


def _diagnosed(log: LogSources, nominal: NominalSource, folder: str, *, holdout: LogSource | None, bootstrap: int,
               noise: str, strict: bool) -> Diagnosed | Diagnoses:
    """Diagnose as `diagnose`; folder: where the command to run next looks for the extension."""
    from ..diagnosis.answer import extension, report
    from ..diagnosis.verdict import diagnose as examine
    from ..log.check import checked, ideal_note
    from ..log.phases import flight_of
    from ..progress import report as show
    from ..report.headline import of_diagnosed, shown_path
    from ..sources import is_several, load_nominal, read_log, several_logs
    bootstrap, noise = integer("--bootstrap", bootstrap, 0), word("--noise", noise, NOISE_CHOICES)
    nominal = load_nominal(nominal)
    if is_several(log):
        found = [cast("Diagnosed", _diagnosed(each, nominal, folder, holdout=holdout, bootstrap=bootstrap, noise=noise,
                                              strict=strict)) for each in several_logs(log, ("t",))]
        return Diagnoses(found, nominal, noise, folder) if len(found) > 1 else found[0]
    log = read_log(cast("LogSource", log), ("t",))
    log, noted = flight_of(log, nominal)
    second = None if holdout is None else flight_of(read_log(holdout, ("t",)), nominal)[0]
    for each in (log, second):
        if each is not None:
            each.check_clock()
    if strict:
        checked(log, nominal, strict=strict)
    result = examine(log, nominal, second, bootstrap=bootstrap, say=show, noise=noise)
    extended = extension(result)
    said = report(result)
    said |= of_diagnosed(said, log.path, log.options, shown_path(nominal.path or nominal.name),
                         None if extended is None else _fits(log, nominal, extended, strict), extended is not None,
                         folder, nominal.uncertainty is not None or nominal.actuator is None)
    return Diagnosed(result, said, (*ideal_note(log), *noted))


def _fits(log: Log, nominal: Nominal, extended: Nominal, strict: bool) -> tuple[float, float, float] | None:
    """Return how well theta is predicted [%] with the nominal and with its extension, and how far ahead [s]; None if
    that cannot be asked."""
    from sim.errors import InputError

    from ..comparison.prediction import predictions, statistics
    from ..log.check import checked
    try:
        found = [predictions(seen.log, each, seen.data).get("theta", {}) for each in (nominal, extended)
                 for seen in (checked(log, each, strict=strict),)]
    except InputError:
        return None
    horizons = set(found[0]) & set(found[1])
    if not horizons:
        return None
    h = max(horizons)
    before, after = (statistics(each[h].measured, each[h].predicted).fit for each in found)
    return (before, after, h) if math.isfinite(before + after) else None


@dataclass(frozen=True, eq=False)
class Diagnosed(Answer):
    """Result of `diagnose`: what the simulation gets wrong on a log, and why."""

    diagnosis: Result
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    @property
    def verdict(self) -> str:
        return str(self.report["verdict"])

    @property
    def extension(self) -> Nominal | None:
        """The nominal extended by the causes that were found; None if there is none."""
        from ..diagnosis.answer import extension
        return extension(self.diagnosis)

    def summary(self) -> str:
        from ..diagnosis.answer import lines
        from ..report.headline import closing
        return "\n".join([*lines(self.diagnosis), *closing(self.report)])

    def columns(self) -> Columns:
        rows = [{"cause": cause["cause"], "where": cause["where"], "parameter": name, **value}
                for cause in self.report["causes"] for name, value in cause["parameters"].items()]
        return flat(rows) or {name: [] for name in ("cause", "where", "parameter", "value", "std", "unit")}

    def _figure(self) -> Figure:
        from ..report.diagnosis_page import pictures_of
        for each in pictures_of(self.diagnosis).values():
            if figure := each.draw():
                return figure
        return super()._figure()

    def write_report(self, folder: str | Path) -> None:
        """Write report.html, verdict.json, the figures and, of a cause that was found, extension.toml into a folder."""
        from ..report.diagnosis_page import write_report
        write_report(self.diagnosis, self.report, folder, self._comparison())

    def _comparison(self) -> Comparison | None:
        """Compare the log with the nominal and its extension; None if that is impossible."""
        from sim.errors import InputError

        from ..progress import report
        from .compare import compare
        extended = self.extension
        report("comparing the log with the simulation")
        try:
            return cast("Comparison", compare(
                self.diagnosis.reading.raw, self.diagnosis.nominal,
                *([] if extended is None else [replace(extended, path="extension.toml")]), flights=0))
        except InputError:
            return None


def _told_by_identification(logs: Sequence[Log], nominal: Nominal) -> dict[str, Any]:
    """Return the joint part of the JSON of several flights, by identifying each; without numbers where that cannot be
    asked."""
    from sim.errors import InputError, UsageError

    from ..report.flights import joint_report
    from .identify import identify
    try:
        found = identify(logs, nominal)
    except (InputError, UsageError):
        return joint_report([], None, None)
    return {name: found.report.get(name) for name in ("joint", "one_vehicle", "scatter")}


TOGETHER = ("verdict", "where", "causes", "noise", "limits", "either", "nearest", "doubts")   # of the joint diagnosis


class Diagnoses(Answer):
    """Diagnoses of several flights of one vehicle with one nominal: that of each, that of all of them in one fit
    (`together`, None where that cannot be made), and whether it is one vehicle."""

    def __init__(self, flights: Sequence[Diagnosed], nominal: Nominal, noise: str = "bounded",
                 folder: str = FOLDER) -> None:
        from ..diagnosis.answer import report
        self.flights, self.nominal, self._folder = list(flights), nominal, folder
        logs = [each.diagnosis.reading.raw for each in flights]
        joint = _told_by_identification(logs, nominal)
        self.together, self.apart = self._joint(noise, joint["one_vehicle"])
        own = dict.fromkeys(TOGETHER) if self.together is None else {
            name: value for name, value in report(self.together).items() if name in TOGETHER}
        self.report = {**joint, **own, "apart": self.apart, "flights": [
            {"log": log.path, **each.report} for log, each in zip(logs, flights, strict=True)]}
        self.report |= self._words()
        self.warnings = tuple(dict.fromkeys(line for each in flights for line in each.warnings))

    def _joint(self, noise: str, one_vehicle: dict[str, Any] | None) -> tuple[Result | None, str]:
        """Return (the diagnosis of all flights in one fit, "") or (None, why there is none)."""
        from ..diagnosis.several import diagnose_jointly
        from ..progress import report as show
        if one_vehicle is not None and one_vehicle["differs"]:
            return None, "the flights are not of one vehicle"
        if once := sorted({cause["cause"] for each in self.flights for cause in each.report["causes"]
                           if "time" in cause["parameters"]}):
            return None, f"{', '.join(once)} is one flight's own"
        if any(each.verdict in ("bad-data", "unexplained") for each in self.flights):
            return None, "a flight alone is not explained"
        found = diagnose_jointly([each.diagnosis.reading.raw for each in self.flights], self.nominal, noise, show)
        return (None, found) if isinstance(found, str) else (found, "")

    @property
    def extension(self) -> Nominal | None:
        """The nominal extended by the causes that all flights together show; None if there is none."""
        from ..diagnosis.answer import extension
        return None if self.together is None else extension(self.together)

    def _words(self) -> dict[str, str]:
        """Return the headline of all flights and the command to run next: the causes, each with how many flights have
        it."""
        named = [tuple(cause["cause"] for cause in each.report["causes"]) for each in self.flights]
        count = {cause: sum(cause in each for each in named) for each in named for cause in each}
        n = len(self.flights)
        if self.together is not None and self.report["causes"]:
            return self._words_together(count)
        wrong = [each for each in self.flights if each.report["verdict"] not in ("consistent", "bad-data")]
        if not wrong:
            return {"headline": f"None of {n} flights shows anything wrong.", "next": self.flights[0].report["next"]}
        said = ", ".join(f"{cause} in {k} of {n}" for cause, k in sorted(count.items(), key=lambda each: -each[1]))
        unknown = sum(not each for each in named) - (n - len(wrong))
        rest = f"{'; ' if said else ''}nothing known fits {unknown} of {n}" if unknown > 0 else ""
        return {"headline": f"{said}{rest}.", "next": wrong[0].report["next"]}

    def _words_together(self, count: dict[str, int]) -> dict[str, str]:
        """Return headline and next command of causes that all flights together show."""
        from ..report.headline import of_cause, shown_path
        said = "; ".join(of_cause(each["cause"], each["parameters"]) for each in self.report["causes"])
        alone = ", ".join(f"{each['cause']} in {count.get(each['cause'], 0)} of {len(self.flights)}"
                          for each in self.report["causes"])
        logs = " ".join(each["log"] for each in self.report["flights"])
        nominal = shown_path(f"{self._folder}/extension.toml") if self.extension is not None else \
            shown_path(self.nominal.path or self.nominal.name)
        options = self.flights[0].diagnosis.reading.raw.options
        return {"headline": f"All flights together: {said}; alone it shows as {alone}.",
                "next": f"launchid identify {logs} {nominal}{options}"}

    def summary(self) -> str:
        from ..diagnosis.answer import lines
        from ..report.headline import closing
        parts = [f"{Path(each['log']).name}: {each['headline']}" for each in self.report["flights"]]
        parts += [f"all flights in one fit: {self.apart}"] if self.together is None else [
            f"all flights in one fit: {lines(self.together)[0]}", *lines(self.together)[2:]]
        p = self.report["one_vehicle"]
        one = [] if p is None else [f"one vehicle, by a6 and k1 of each flight: p {p['p']:.2g}"]
        return "\n".join([*parts, *one, *closing(self.report)])

    def columns(self) -> Columns:
        rows = [{"flight": Path(each["log"]).name, "cause": cause["cause"], "where": cause["where"], "parameter": name,
                 **value} for each in self.report["flights"] for cause in each["causes"]
                for name, value in cause["parameters"].items()]
        return flat(rows) or {name: [] for name in ("flight", "cause", "where", "parameter", "value", "std", "unit")}

    def write_report(self, folder: str | Path) -> None:
        """Write the report of each flight into a folder of its name within this one; of all flights in one fit the
        verdict and the extension."""
        from sim.files import make_folder, write_text
        from sim.nominal import rewrite_nominal
        write_text(make_folder(folder) / "verdict.json", [self.to_json(), "\n"])
        if (extended := self.extension) is not None:
            rewrite_nominal(extended, Path(folder) / "extension.toml")
        for each, said in zip(self.flights, self.report["flights"], strict=True):
            each.write_report(Path(folder) / Path(said["log"]).stem)
