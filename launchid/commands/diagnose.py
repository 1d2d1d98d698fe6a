"""Find why a simulation disagrees with a log: `launchid diagnose`, `launchid.diagnose`."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..argument_checks import integer, word
from ..cli.common import at_least, check_outputs, read_nominal, read_noting, reading, tell
from ..cli.options import (
    LOG_HELP,
    NOISE_CHOICES,
    NOMINAL_HELP,
    add_command,
    add_map,
    add_outputs,
    add_report,
    add_strict,
    given,
)
from ..results.answer import Answer, flat

if TYPE_CHECKING:
    from sim.nominal import Nominal
    from sim.result import Columns, Figure

    from ..comparison.result import Comparison
    from ..diagnosis.verdict import Result
    from ..sources import LogSource, NominalSource


def add(commands: Any) -> None:
    """Add `launchid diagnose` and its options to argparse's subparsers `commands`."""
    sub = add_command(commands, "diagnose", "find why a simulation disagrees with a log, and how much the fix gains",
                      "launchid diagnose v.csv vega_like --report report", diagnose)
    sub.add_argument("log", metavar="LOG.csv", help=f"{LOG_HELP}; one of theta and theta_dot, and one of beta and "
                                                    "beta_cmd, is enough")
    sub.add_argument("nominal", metavar="NOMINAL.toml", help=f"compare the log with {NOMINAL_HELP}")
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
    log, nominal = read_noting(args.log, "t", **reading(args)), read_nominal(args.nominal)
    holdout = read_noting(args.holdout, "t", **reading(args)) if args.holdout else None
    check_outputs(args.json, folder=args.report)
    args.holdout = holdout
    result = diagnose(log, nominal, **given(diagnose, args))
    if args.report:
        result.write_report(args.report)
    tell(result, args.json)


def diagnose(log: LogSource, nominal: NominalSource, *, holdout: LogSource | None = None, bootstrap: int = 0,
             noise: str = "bounded", strict: bool = False) -> Diagnosed:
    """Find why a simulation disagrees with a log, and how much the fix improves its predictions.

    Parameters
    ----------
    log : path, data frame, mapping of arrays, Log
        One of theta and theta_dot, and one of beta and beta_cmd, is enough.
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
    """
    from ..diagnosis.answer import report
    from ..diagnosis.verdict import diagnose as examine
    from ..log.check import checked, ideal_note
    from ..log.phases import phase_note
    from ..progress import report as show
    from ..sources import load_nominal, read_log
    bootstrap, noise = integer("--bootstrap", bootstrap, 0), word("--noise", noise, NOISE_CHOICES)
    log, nominal = read_log(log, ("t",)), load_nominal(nominal)
    second = None if holdout is None else read_log(holdout, ("t",))
    for each in (log, second):
        if each is not None:
            each.check_clock()
    if strict:
        checked(log, nominal, strict=strict)
    result = examine(log, nominal, second, bootstrap=bootstrap, say=show, noise=noise)
    reading = result.reading
    return Diagnosed(result, report(result), (*ideal_note(log), *phase_note(log, reading.log, reading.data)))


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
        return "\n".join(lines(self.diagnosis))

    def columns(self) -> Columns:
        rows = [{"cause": cause["cause"], "where": cause["where"], "parameter": name, **value}
                for cause in self.report["causes"] for name, value in cause["parameters"].items()]
        return flat(rows) or {name: [] for name in ("cause", "where", "parameter", "value", "std", "unit")}

    def _figure(self) -> Figure:
        from ..diagnosis.report.figures import REPORT_FIGURES, drawable
        for name in drawable(self.diagnosis):
            if figure := REPORT_FIGURES[name](self.diagnosis):
                return figure
        return super()._figure()

    def write_report(self, folder: str | Path) -> None:
        """Write report.html, verdict.json, extension.toml and the figures into a folder."""
        from ..diagnosis.report.page import write_report
        write_report(self.diagnosis, self.report, folder, self._comparison())

    def _comparison(self) -> Comparison | None:
        """Compare the log with the nominal and its extension; None if that is impossible."""
        from sim.errors import InputError

        from ..progress import report
        from .compare import compare
        extended = self.extension
        report("comparing the log with the simulation")
        try:
            return compare(self.diagnosis.reading.raw, self.diagnosis.nominal,
                           *([] if extended is None else [replace(extended, path="extension.toml")]), flights=0)
        except InputError:
            return None
