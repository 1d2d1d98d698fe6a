"""launchid diagnose"""

import argparse
from typing import Any

from ..terminal import Progress
from ..words import LOG_HELP, NOMINAL_HELP, WITHIN, add_command, add_map, add_outputs, add_strict
from .talk import at_least, check_folders, check_outputs, read_noting, tell


def add(commands: Any) -> None:
    """Its words."""
    sub = add_command(commands, "diagnose", "what the simulation gets wrong on a log, why, and what fixing it gains",
                      "launchid diagnose v.csv vega_like --report report")
    sub.add_argument("log", metavar="LOG.csv", help=f"{LOG_HELP}; here one of theta and theta_dot, and one of beta and "
                                                    "beta_cmd, is enough")
    sub.add_argument("nominal", metavar="NOMINAL.toml", help=f"what the simulation believes: {NOMINAL_HELP}")
    sub.add_argument("--holdout", metavar="LOG2.csv",
                     help="a second log, to judge the extended model on (default: parts of the first, left out)")
    sub.add_argument("--bootstrap", type=int, default=0, metavar="N",
                     help="measure the threshold on N clean flights of the nominal along this log, cached; "
                          "0: the built-in one (default %(default)s)")
    sub.add_argument("--noise", default="bounded", choices=WITHIN,
                     help="how far noise may be from the declared: within 0.3 to 3 times (wind up to 2 times, and as "
                          "calm as it was), not at all, or however it is (default %(default)s)")
    sub.add_argument("--report", metavar="DIR",
                     help="folder for report.html, verdict.json, extension.toml, figures (default: none)")
    add_map(sub)
    add_strict(sub)
    add_outputs(sub)
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """launchid diagnose"""
    from ..nominal import load_nominal
    at_least("--bootstrap", args.bootstrap, 0)
    log, nominal = read_noting(args.log, "t", of=args.map), load_nominal(args.nominal)
    holdout = read_noting(args.holdout, "t", of=args.map) if args.holdout else None
    check_outputs(args.json)
    check_folders(args.report)
    from ..answers.of_logs import diagnose
    progress = Progress()
    made = diagnose(log, nominal, holdout=holdout, bootstrap=args.bootstrap, strict=args.strict, say=progress,
                    noise=args.noise)
    progress("")
    if args.report:
        made.write_report(args.report)
    tell(made, args.json)
