"""Fit the ranges of a6 and k1 to flights: `launchid fit-lft`, `launchid.fit_lft`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sim.errors import InputError, UsageError

from .. import progress
from ..argument_checks import real
from ..cli.common import check_outputs, read_nominal, read_noting, reading, warn
from ..cli.options import add_command, add_map, add_strict, given
from ..cli.terminal import answer
from ..report.answer import Answer, flat

if TYPE_CHECKING:
    from pathlib import Path

    from sim.nominal import Nominal
    from sim.result import Columns, Figure

    from ..robustness import greybox
    from ..sources import LogSource, NominalSource


def add(commands: Any) -> None:
    """Add `launchid fit-lft` and its options to argparse's subparsers `commands`."""
    sub = add_command(commands, "fit-lft", "fit the ranges sigma of a6 and k1 to flights",
                      "launchid fit-lft flight1.csv flight2.csv constant --out new.toml", fit_lft)
    sub.add_argument("logs", nargs="+", metavar="LOG.csv... NOMINAL.toml",
                     help="read one log a flight; the nominal comes last")
    sub.add_argument("--out", required=True, metavar="NEW.toml",
                     help="write the nominal with its [uncertainty] to this file")
    sub.add_argument("--share", type=float, metavar="X",
                     help="let the range hold this share of vehicles, between 0 and 1 (default %(default)s)")
    sub.add_argument("--confidence", type=float, metavar="X",
                     help="hold them with this confidence, between 0 and 1 (default %(default)s)")
    sub.add_argument("--profile", action="store_true",
                     help="fit sigma over flight time, where the flights determine it, into a CSV beside NEW.toml")
    add_map(sub)
    add_strict(sub)
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid fit-lft` with its parsed arguments: write the nominal with its ranges, and print them."""
    *paths, nominal_path = args.logs
    if not paths:
        raise UsageError("fit-lft: expected at least one LOG.csv before NOMINAL.toml")
    for name, value in (("--share", args.share), ("--confidence", args.confidence)):
        if not 0.0 < value < 1.0:
            raise UsageError(f"{name} {value!r}: expected a number between 0 and 1")
    nominal = read_nominal(nominal_path)
    logs = [read_noting(path, **reading(args)) for path in paths]
    check_outputs(args.out)
    result = fit_lft(logs, nominal, **given(fit_lft, args))
    result.write(args.out)
    warn(result)
    answer(result.summary(args.out))


def fit_lft(logs: Sequence[LogSource], nominal: NominalSource, *, share: float = 0.95, confidence: float = 0.95,
            profile: bool = False, strict: bool = False) -> FittedRange:
    """Fit the relative ranges sigma of a6 and k1 that hold a share of vehicles with a confidence, to flights.

    Parameters
    ----------
    logs : sequence
        One a flight.
    nominal : path, name of a built-in one, or Nominal
    share, confidence : float
        Between 0 and 1.
    profile : bool
        Sigma over flight time, where the flights determine it.
    strict : bool
        Raise InputError where the data check finds a fault.

    Returns
    -------
    FittedRange

    Raises
    ------
    InputError
        For a log whose columns are in another unit, of another sign or exchanged, or one that is given twice.
    """
    from ..log.commanded import with_nozzle
    from ..log.phases import checked_flight
    from ..robustness import greybox, level
    from ..sources import each_of, load_nominal, read_log
    if not logs:
        raise UsageError("fit-lft: expected at least one log")
    nominal, read = load_nominal(nominal), [read_log(log) for log in each_of(logs)]
    for k, log in enumerate(read):
        if again := next((one for one in read[:k] if log.is_same(one)), None):
            raise InputError(f"{log.path}: the same flight as {again.path}; expected each once")
    for name, value in (("share", share), ("confidence", confidence)):
        if not 0.0 < real(name, value, "a number between 0 and 1") < 1.0:
            raise UsageError(f"{name} {value!r}: expected a number between 0 and 1")
    said: tuple[str, ...] = ()
    flights = []
    for log in progress.each(read, "logs fitted"):
        seen = checked_flight(log, nominal, strict=strict, refuse_columns=True)
        seen, believed, note = with_nozzle(seen, nominal)
        said += (*seen.warnings, *note)
        flights.append(greybox.deviations(seen, believed))
    fit = greybox.fit(flights, share, confidence, profile)
    ranges = {name: {key: getattr(each, key) for key in ("sigma", "method", "spread", "within", "noise", "held")}
              for name, each in zip(level.UNCERTAIN_PARAMETERS, fit.ranges, strict=True)}
    return FittedRange(fit, greybox.with_range(nominal, fit), {"flights": fit.flights, "ranges": ranges}, said)


@dataclass(frozen=True, eq=False)
class FittedRange(Answer):
    """Result of `fit_lft`: the ranges sigma of a6 and k1, and the nominal with them."""

    fit: greybox.Fit
    nominal: Nominal        # with its [uncertainty]
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    def summary(self, of: str = "fitted range") -> str:
        from ..robustness import greybox
        return greybox.table(self.fit, of)

    def columns(self) -> Columns:
        return flat([{"parameter": name, **values} for name, values in self.report["ranges"].items()])

    def _figure(self) -> Figure:
        from sim.pictures import range_figure
        return range_figure(self.nominal)

    def write(self, path: str | Path) -> None:
        """Write the nominal as TOML: the file that it came from, with its new [uncertainty]."""
        from sim.nominal import rewrite_nominal
        rewrite_nominal(self.nominal, path)
