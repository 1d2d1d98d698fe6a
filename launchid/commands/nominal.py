"""Write the first nominal of a vehicle from its logs alone: `launchid nominal`, `launchid.nominal`."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from sim.errors import InputError, UsageError
from sim.files import write_text

from ..cli.common import check_outputs, read_noting, reading
from ..cli.options import LOG_HELP, add_command, add_logs, add_map, add_outputs, logs_of
from ..cli.terminal import answer
from ..report.answer import Answer, flat, json_text

if TYPE_CHECKING:
    from sim.nominal import Nominal
    from sim.result import Columns, Figure

    from ..first_nominal import First
    from ..flights.pooled import Joint, Told
    from ..log.log import Log
    from ..sources import LogSource, LogSources

ANY = ("t",)   # columns that every log must have: one of theta and theta_dot, one of beta and beta_cmd, is enough


def add(commands: Any) -> None:
    """Add `launchid nominal` and its options to argparse's subparsers `commands`."""
    sub = add_command(commands, "nominal", "write the first nominal of a vehicle from its log alone",
                      "launchid nominal dfki_pendulum_ddp --out mine.toml")
    add_logs(sub, f"{LOG_HELP}; one of theta and theta_dot, and one of beta and beta_cmd, is enough",
             "none, for one is made", most=0)
    sub.add_argument("--out", required=True, metavar="NEW.toml", help="write the nominal to this file")
    add_map(sub)
    add_outputs(sub)
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid nominal` with its parsed arguments: write the first nominal, and print it."""
    names, _ = logs_of(args)
    logs = [read_noting(name, *ANY, **reading(args)) for name in names]
    check_outputs(args.out, args.json)
    result = determined(logs)
    report = result.report | result.words(args.out)
    if args.json:
        text = json_text(report)
        if args.json == "-":
            answer(text)
        else:
            write_text(args.json, [text, "\n"])
    result.check()
    result.write(args.out)
    if args.json != "-":
        answer(result.lines(args.out))


def nominal(log: LogSources) -> FirstNominal:
    """Determine the first nominal of a vehicle from its log alone, or from those of several flights.

    Parameters
    ----------
    log : path, data frame, mapping of arrays, Log; or a list of these
        One of theta and theta_dot, and one of beta and beta_cmd, is enough.

    Returns
    -------
    FirstNominal
        Its `nominal` is what the other functions take; `write` makes a file of it.

    Raises
    ------
    InputError
        With the reason, if the log cannot tell a6 and k1.
    """
    from ..sources import is_several, read_log, several_logs
    logs = several_logs(log, ANY) if is_several(log) else [read_log(cast("LogSource", log), ANY)]
    result = determined(logs)
    result.check()
    return result


def determined(logs: list[Log]) -> FirstNominal:
    """Return the first nominal of logs, with the reasons for what they cannot tell."""
    from .. import progress
    from ..first_nominal import first, of_flights, report
    from ..report.flights import joint_report
    names, options = tuple(log.path for log in logs), logs[0].options
    firsts = [first(log) for log in (progress.each(logs, "logs fitted") if len(logs) > 1 else logs)]
    if len(firsts) == 1:
        return FirstNominal(firsts[0], report(firsts[0]), names, options)
    made, joint, told = of_flights(firsts)
    said = joint_report(told, joint, None)
    del said["joint"]   # the numbers stand where those of one log do
    said |= report(made) | {"flights": [report(each) for each in firsts]}
    return FirstNominal(made, said, names, options, joint, tuple(told))


@dataclass(frozen=True, eq=False)
class FirstNominal(Answer):
    """Result of `nominal`: the vehicle's numbers with their standard deviations.

    logs, options  that it is of, as a command names them;  told, joint  what several flights tell, and how they agree
    """

    numbers: First
    report: dict[str, Any]
    logs: tuple[str, ...]
    options: str = ""
    joint: Joint | None = None
    told: tuple[Told, ...] = ()
    warnings: tuple[str, ...] = ()

    def check(self) -> None:
        """Raise InputError with the reasons, if a6 and k1 cannot be told."""
        if self.numbers.refused:
            raise InputError(f"{self.numbers.path}: {'; '.join(self.numbers.refused)}")

    @property
    def nominal(self) -> Nominal:
        """The nominal, as the other functions take it."""
        from ..first_nominal import nominal_of
        return nominal_of(self.numbers, "first")

    def write(self, path: str | Path) -> None:
        """Write the nominal as TOML, standard deviations and units as comments."""
        from ..first_nominal import write
        write(self.numbers, path)

    def words(self, out: str = "first.toml") -> dict[str, str]:
        """Return the headline and the command to run next; out: where the nominal is."""
        from ..report.flights import differing
        from ..report.headline import of_first
        names = " ".join([*self.logs, out]) + self.options
        return of_first(self.numbers, names, differing(self.told, self.joint))

    def lines(self, out: str = "nominal") -> str:
        """Return the numbers as text for a terminal; `out` names the file that was written."""
        from ..first_nominal import lines
        from ..report.headline import closing
        return "\n".join([*lines(self.numbers, out), *closing(self.words(out))])

    def summary(self) -> str:
        from ..first_nominal import lines
        return "\n".join([self.words()["headline"], *lines(self.numbers, "nominal")[:-1]])

    def columns(self) -> Columns:
        n = self.numbers
        rows = [dict(zip(("t", "a6", "a6_std", "k1", "k1_std"), map(float, row), strict=True))
                for row in zip(n.t, n.a6, n.a6_std, n.k1, n.k1_std, strict=True)]
        return flat(rows)

    def _figure(self) -> Figure:
        raise UsageError("nominal: there is nothing to draw; identify with it, and draw that")
