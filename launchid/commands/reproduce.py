"""Repeat the paper's experiments: `launchid reproduce`."""

import argparse
from typing import Any

from ..cli.common import at_least, check_outputs
from ..cli.options import add_command
from ..cli.terminal import answer, say


def add(commands: Any) -> None:
    """Add `launchid reproduce` and its options to argparse's subparsers `commands`."""
    from ..experiments import CASES, CONFIDENCE
    sub = add_command(commands, "reproduce", "repeat the paper's experiments: figures, table, pass or fail",
                      "launchid reproduce --case windowed --seeds 3 --out results")
    sub.add_argument("--case", default="all", choices=[*CASES, CONFIDENCE, "all"],
                     help="run one experiment, or all of them (default %(default)s)")
    sub.add_argument("--seeds", type=int, default=20, metavar="N",
                     help="fly this many flights per case (default %(default)s, the paper's)")
    sub.add_argument("--out", default="results", metavar="DIR",
                     help="write figures and tables into this folder (default %(default)s)")
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid reproduce` with its parsed arguments: repeat experiments into the folder --out, print the table."""
    at_least("--seeds", args.seeds, 1)
    check_outputs(folder=args.out)
    from ..report.paper import reproduce
    answer(reproduce(args.case, args.seeds, args.out, say))
