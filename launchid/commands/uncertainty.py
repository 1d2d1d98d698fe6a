"""Tell where each parameter lies within its declared range: `launchid uncertainty`, `launchid.uncertainty`."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sim.errors import UsageError

from ..argument_checks import DEFAULT_WINDOW, window_seconds
from ..cli.common import check_outputs, read_nominal, read_noting, reading, tell
from ..cli.options import LOG_HELP, NOMINAL_HELP, add_command, add_map, add_outputs, add_strict, given
from ..report.answer import Answer, flat

if TYPE_CHECKING:
    from launchid_core import Estimate
    from sim.nominal import Nominal
    from sim.result import Columns, Figure

    from ..log.log import Log
    from ..sources import LogSource, NominalSource


def add(commands: Any) -> None:
    """Add `launchid uncertainty` and its options to argparse's subparsers `commands`."""
    sub = add_command(commands, "uncertainty", "report where each parameter lies within its declared range",
                      "launchid uncertainty v.csv vega_like --plot level.png", uncertainty)
    sub.add_argument("log", metavar="LOG.csv", help=LOG_HELP)
    sub.add_argument("nominal", metavar="NOMINAL.toml",
                     help=f"compare the log with the [uncertainty] of {NOMINAL_HELP}")
    sub.add_argument("--window", metavar="S|all",
                     help="set the length of a window [s], or all: one window, the whole log (default %(default)s, at "
                          "most a third of the log)")
    add_map(sub)
    add_strict(sub)
    add_outputs(sub, plot=True)
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid uncertainty` with its parsed arguments: print the levels, and write what options ask for."""
    log = read_noting(args.log, **reading(args))
    nominal = read_nominal(args.nominal)
    check_outputs(args.json, plots=(args.plot,))
    tell(uncertainty(log, nominal, **given(uncertainty, args)), args.json, args.plot)


def uncertainty(log: LogSource, nominal: NominalSource, *, window: float | str = DEFAULT_WINDOW,
                strict: bool = False) -> UncertaintyLevel:
    """Return where a6 and k1 lie in their declared ranges, window by window, and since when one is outside.

    Parameters
    ----------
    log : path, data frame, mapping of arrays, Log
    nominal : path, name of a built-in one, or Nominal
        With [uncertainty].
    window : float or "all"
        Length of a window [s]; "all": the whole log is one.
    strict : bool
        Raise InputError where the data check finds a fault.

    Returns
    -------
    UncertaintyLevel
    """
    from ..judge.nominal import lines, tested
    from ..log.commanded import with_nozzle
    from ..log.phases import checked_flight
    from ..robustness import level
    from ..sources import load_nominal, read_log
    nominal = load_nominal(nominal)
    seen = checked_flight(read_log(log), nominal, strict=strict)
    seen, believed, said = with_nozzle(seen, nominal)
    length = window_seconds(window, seen.log)
    try:
        estimates = level.follow(seen, believed, length)
    except ValueError as error:
        raise UsageError(str(error)) from None
    told = tested(seen, nominal, estimates, level.config_of(seen, believed, length))
    warnings = (*seen.warnings, *said, *lines(seen, told))
    return UncertaintyLevel(seen.log, nominal, length, estimates, level.report(estimates), warnings)


@dataclass(frozen=True, eq=False)
class UncertaintyLevel(Answer):
    """Result of `uncertainty`: delta of a6 and k1, as a = a0*(1 + sigma*delta), window by window."""

    log: Log
    nominal: Nominal
    window: float
    estimates: list[Estimate]
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    def summary(self) -> str:
        from ..robustness import level
        head = (f"{self.log.path}: delta of a = a0*(1 + sigma*delta) from the tracked estimate, "
                f"window {self.window:g} s, period {self.log.period:g} s, range of {self.nominal.name}")
        return "\n".join([head, level.table(self.estimates) if self.estimates else self.log.too_short(self.window)])

    def columns(self) -> Columns:
        return flat(self.report["windows"])

    def _figure(self) -> Figure:
        from ..report.uncertainty_figures import uncertainty_figure
        return uncertainty_figure(self.log, self.estimates, self.nominal)
