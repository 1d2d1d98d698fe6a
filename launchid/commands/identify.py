"""The command `launchid identify`: its options, and its run."""

import argparse
from typing import Any

from ..cli.common import check_folders, check_outputs, check_plot, read_nominal, read_noting, tell
from ..cli.options import (
    LOG_HELP,
    NOMINAL_HELP,
    add_choices,
    add_command,
    add_map,
    add_nominal,
    add_outputs,
    add_report,
    add_strict,
    choices,
    nominal_of,
)


def add(commands: Any) -> None:
    """Add the command and its options to the parser."""
    sub = add_command(commands, "identify", "estimate a6, k1 and the active terms of a log, window by window",
                      "launchid identify v.csv --nominal vega_like --window 5 --tracked --plot v.png")
    sub.add_argument("log", metavar="LOG.csv", help=LOG_HELP)
    add_nominal(sub, f"identify with {NOMINAL_HELP} (default: none, the log alone)")
    sub.add_argument("--window", default="1", metavar="S|all",
                     help="set the length of a window [s], or all: one window, the whole log (default %(default)s)")
    add_choices(sub)
    sub.add_argument("--tracked", action="store_true",
                     help="also print the tracked estimate (from all samples so far, at each window's end) and sudden "
                          "changes; needs --nominal")
    add_report(sub, "identify.json")
    add_map(sub)
    add_strict(sub)
    add_outputs(sub, plot=True)
    sub.add_argument("--resid", metavar="PATH",
                     help="draw the residuals of the windows, their whiteness, and predictions 0.1, 0.5 and 1 s ahead "
                          "into this .png, .svg or .pdf (default: none)")
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid identify`."""
    log = read_noting(args.log, map_path=args.map)
    source = nominal_of(args)
    nominal = read_nominal(source) if source else None
    check_outputs(args.json, args.plot, args.resid)
    check_plot(args.plot)
    check_plot(args.resid)
    check_folders(args.report)
    from ..results.of_logs import identify
    result = identify(log, nominal, window=args.window, formulation=args.formulation, tracked=args.tracked,
                      strict=args.strict, **choices(args))
    if args.report:
        result.write_report(args.report)
    if args.resid:
        result.residuals(args.resid)
    tell(result, args.json, args.plot)
