"""The command `launchid uncertainty`: its options, and its run."""

import argparse
from typing import Any

from ..cli.common import check_outputs, check_plot, read_nominal, read_noting, tell
from ..cli.options import LOG_HELP, NOMINAL_HELP, add_command, add_map, add_outputs, add_strict


def add(commands: Any) -> None:
    """Add the command and its options to the parser."""
    sub = add_command(commands, "uncertainty", "report where each parameter lies within its declared range",
                      "launchid uncertainty v.csv vega_like --plot level.png")
    sub.add_argument("log", metavar="LOG.csv", help=LOG_HELP)
    sub.add_argument("nominal", metavar="NOMINAL.toml",
                     help=f"compare the log with the [uncertainty] of {NOMINAL_HELP}")
    sub.add_argument("--window", type=float, default=1.0, metavar="S",
                     help="set the length of a window [s] (default %(default)s)")
    add_map(sub)
    add_strict(sub)
    add_outputs(sub, plot=True)
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid uncertainty`."""
    log = read_noting(args.log, map_path=args.map)
    nominal = read_nominal(args.nominal)
    check_outputs(args.json, args.plot)
    check_plot(args.plot)
    from ..results.of_logs import uncertainty
    tell(uncertainty(log, nominal, window=args.window, strict=args.strict), args.json, args.plot)
