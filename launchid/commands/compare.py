"""The command `launchid compare`: its options, and its run."""

import argparse
from typing import Any

from ..cli.common import at_least, check_folders, check_outputs, check_plot, read_nominal, read_noting, tell
from ..cli.options import LOG_HELP, NOMINAL_HELP, add_command, add_map, add_outputs, add_report, add_strict


def add(commands: Any) -> None:
    """Add the command and its options to the parser."""
    sub = add_command(commands, "compare", "hold a log beside nominals: predictions, flights, dispersions, responses",
                      "launchid compare v.csv vega_like report/extension.toml --report compared")
    sub.add_argument("log", metavar="LOG.csv", help=LOG_HELP)
    sub.add_argument("nominals", metavar="NOMINAL.toml", nargs="+",
                     help=f"hold the log beside {NOMINAL_HELP}; of several, such as one and the extension.toml that "
                          "diagnose made of it, each")
    sub.add_argument("--flights", type=int, default=200, metavar="N",
                     help="fly each nominal this often with its dispersions, and give the log's place among them; 0: "
                          "none (default %(default)s)")
    add_report(sub, "compare.json")
    add_map(sub)
    add_strict(sub)
    add_outputs(sub, plot=True)
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid compare`."""
    at_least("--flights", args.flights, 0)
    log = read_noting(args.log, map_path=args.map)
    nominals = [read_nominal(path) for path in args.nominals]
    check_outputs(args.json, args.plot)
    check_plot(args.plot)
    check_folders(args.report)
    from ..comparison.result import compare
    result = compare(log, nominals, flights=args.flights, strict=args.strict)
    if args.report:
        result.write_report(args.report)
    tell(result, args.json, args.plot)
