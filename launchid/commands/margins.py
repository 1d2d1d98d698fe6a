"""The command `launchid margins`: its options, and its run."""

import argparse
from typing import Any

from ..cli.common import check_folders, check_outputs, check_plot, read_nominal, read_noting, tell
from ..cli.options import LOG_HELP, NOMINAL_HELP, add_command, add_map, add_outputs, add_report, add_strict


def add(commands: Any) -> None:
    """Add the command and its options to the parser."""
    sub = add_command(commands, "margins", "give the stability margins of the flight's loop, with intervals",
                      "launchid margins v.csv vega_like --window 5 --tracked --plot margins.png")
    sub.add_argument("log", metavar="LOG.csv", help=LOG_HELP)
    sub.add_argument("nominal", metavar="NOMINAL.toml",
                     help=f"identify with {NOMINAL_HELP}; with [actuator] and [controller]")
    sub.add_argument("--window", type=float, default=5.0, metavar="S",
                     help="set the length of a window [s] (default %(default)s)")
    sub.add_argument("--tracked", action="store_true",
                     help="give those of the tracked estimate too, at each window's end")
    add_report(sub, "margins.json")
    add_map(sub)
    add_strict(sub)
    add_outputs(sub, plot=True)
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid margins`."""
    log = read_noting(args.log, map_path=args.map)
    nominal = read_nominal(args.nominal)
    check_outputs(args.json, args.plot)
    check_plot(args.plot)
    check_folders(args.report)
    from ..results.of_margins import margins
    result = margins(log, nominal, window=args.window, tracked=args.tracked, strict=args.strict)
    if args.report:
        result.write_report(args.report)
    tell(result, args.json, args.plot)
