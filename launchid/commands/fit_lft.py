"""The command `launchid fit-lft`: its options, and its run."""

import argparse
from typing import Any

from sim.errors import UsageError

from ..cli.common import check_outputs, read_nominal, read_noting, warn
from ..cli.options import add_command, add_map, add_strict
from ..cli.terminal import answer


def add(commands: Any) -> None:
    """Add the command and its options to the parser."""
    sub = add_command(commands, "fit-lft", "fit the ranges sigma of a6 and k1 to flights",
                      "launchid fit-lft flight1.csv flight2.csv constant --out new.toml")
    sub.add_argument("logs", nargs="+", metavar="LOG.csv... NOMINAL.toml",
                     help="read one log a flight; the nominal comes last")
    sub.add_argument("--out", required=True, metavar="NEW.toml",
                     help="write the nominal with its [uncertainty] to this file")
    sub.add_argument("--share", type=float, default=0.95, metavar="X",
                     help="let the range hold this share of vehicles, between 0 and 1 (default %(default)s)")
    sub.add_argument("--confidence", type=float, default=0.95, metavar="X",
                     help="hold them with this confidence, between 0 and 1 (default %(default)s)")
    sub.add_argument("--profile", action="store_true",
                     help="fit sigma over flight time, where the flights determine it, into a CSV beside NEW.toml")
    add_map(sub)
    add_strict(sub)
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid fit-lft`."""
    *paths, nominal_path = args.logs
    if not paths:
        raise UsageError("fit-lft: expected at least one LOG.csv before NOMINAL.toml")
    for name, value in (("--share", args.share), ("--confidence", args.confidence)):
        if not 0.0 < value < 1.0:
            raise UsageError(f"{name} {value!r}: expected a number between 0 and 1")
    nominal = read_nominal(nominal_path)
    logs = [read_noting(path, map_path=args.map) for path in paths]
    check_outputs(args.out)
    from ..results.of_logs import fit_lft
    result = fit_lft(logs, nominal, share=args.share, confidence=args.confidence, profile=args.profile,
                     strict=args.strict)
    result.write(args.out)
    warn(result)
    answer(result.summary(args.out))
