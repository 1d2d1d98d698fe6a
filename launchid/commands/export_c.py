"""The command `launchid export-c`: its options, and its run."""

import argparse
from pathlib import Path
from typing import Any

from ..argument_checks import WINDOW
from ..cli.common import check_folders, read_nominal
from ..cli.options import NOMINAL_HELP, add_choices, add_command, choices
from ..cli.terminal import say


def add(commands: Any) -> None:
    """Add the command and its options to the parser."""
    sub = add_command(commands, "export-c", "write the estimator in C99 for a flight computer, with the same bits",
                      "launchid export-c constant --out port --window 5")
    sub.add_argument("nominal", metavar="NOMINAL.toml", help=f"export the estimator of {NOMINAL_HELP}")
    sub.add_argument("--out", required=True, metavar="DIR",
                     help="write launchid.c, launchid.h, replay vectors, README.md and the rest into this folder")
    sub.add_argument("--window", type=float, default=WINDOW, metavar="S",
                     help="set the length of a window [s] (default %(default)s)")
    sub.add_argument("--period", type=float, metavar="S", help="set the time between samples [s] (default: "
                                                                         "the nominal's)")
    add_choices(sub, "rigid-body")
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid export-c`."""
    nominal = read_nominal(args.nominal)
    check_folders(args.out)
    from ..results.of_nominals import export_c
    result = export_c(nominal, window=args.window, period=args.period, formulation=args.formulation,
                      **choices(args))
    replaced = " (what was there of these files is replaced)" if (Path(args.out) / "launchid.c").exists() else ""
    result.write(args.out)
    say(result.summary(args.out) + replaced)
