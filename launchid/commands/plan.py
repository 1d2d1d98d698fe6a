"""The command `launchid plan`: its options, and its run."""

import argparse
from typing import Any

from ..cli.common import check_outputs, read_nominal
from ..cli.options import NOMINAL_HELP, add_command
from ..cli.terminal import answer
from ..progress import report


def add(commands: Any) -> None:
    """Add the command and its options to the parser."""
    sub = add_command(commands, "plan", "design the smallest test input that reaches an accuracy",
                      "launchid plan constant --accuracy 0.01 --window 5 --out new.toml")
    sub.add_argument("nominal", metavar="NOMINAL.toml", help=f"design it for {NOMINAL_HELP}")
    sub.add_argument("--accuracy", type=float, required=True, metavar="X",
                     help="reach this relative standard deviation of a6 and k1, above 0 and below 1")
    sub.add_argument("--window", type=float, required=True, metavar="S", help="set the length of a window [s]")
    sub.add_argument("--out", required=True, metavar="NEW.toml",
                     help="write the nominal with its [test_input] to this file")
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid plan`."""
    nominal = read_nominal(args.nominal)
    check_outputs(args.out)
    from ..results.of_nominals import plan
    report("designing the test input")
    result = plan(nominal, accuracy=args.accuracy, window=args.window)
    result.write(args.out)
    answer(result.summary(args.out))
