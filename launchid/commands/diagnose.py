"""The command `launchid diagnose`: its options, and its run."""

import argparse
from typing import Any

from ..cli.common import at_least, check_folders, check_outputs, read_nominal, read_noting, tell
from ..cli.options import LOG_HELP, NOMINAL_HELP, WITHIN, add_command, add_map, add_outputs, add_strict
from ..progress import report


def add(commands: Any) -> None:
    """Add the command and its options to the parser."""
    sub = add_command(commands, "diagnose", "find why a simulation disagrees with a log, and how much the fix gains",
                      "launchid diagnose v.csv vega_like --report report")
    sub.add_argument("log", metavar="LOG.csv", help=f"{LOG_HELP}; one of theta and theta_dot, and one of beta and "
                                                    "beta_cmd, is enough")
    sub.add_argument("nominal", metavar="NOMINAL.toml", help=f"compare the log with {NOMINAL_HELP}")
    sub.add_argument("--holdout", metavar="LOG2.csv",
                     help="judge the extended nominal on this second log (default: on parts of the first that are held "
                          "out)")
    sub.add_argument("--bootstrap", type=int, default=0, metavar="N",
                     help="diagnose N clean flights of the nominal too, and say how many are not found consistent "
                          "(default %(default)s)")
    sub.add_argument("--noise", default="bounded", choices=WITHIN,
                     help="choose how noise levels are fitted. bounded: within 0.3 to 3 times the nominal's (wind 0 "
                          "to 2 times); declared: fixed at the nominal's; free: without limits (default %(default)s)")
    sub.add_argument("--report", metavar="DIR",
                     help="write report.html, verdict.json, extension.toml and the figures into this folder (default: "
                          "none)")
    add_map(sub)
    add_strict(sub)
    add_outputs(sub)
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid diagnose`."""
    at_least("--bootstrap", args.bootstrap, 0)
    log, nominal = read_noting(args.log, "t", map_path=args.map), read_nominal(args.nominal)
    holdout = read_noting(args.holdout, "t", map_path=args.map) if args.holdout else None
    check_outputs(args.json)
    check_folders(args.report)
    from ..results.of_logs import diagnose
    result = diagnose(log, nominal, holdout=holdout, bootstrap=args.bootstrap, strict=args.strict, say=report,
                      noise=args.noise)
    if args.report:
        result.write_report(args.report)
    tell(result, args.json)
