"""Write the first nominal of a vehicle from its log alone: `launchid nominal`."""

import argparse
import json
from typing import Any

from sim.errors import InputError
from sim.files import write_text

from ..cli.common import check_outputs, read_noting, reading
from ..cli.options import LOG_HELP, add_command, add_map, add_outputs
from ..cli.terminal import answer


def add(commands: Any) -> None:
    """Add `launchid nominal` and its options to argparse's subparsers `commands`."""
    sub = add_command(commands, "nominal", "write the first nominal of a vehicle from its log alone",
                      "launchid nominal dfki_pendulum_ddp --out mine.toml")
    sub.add_argument("log", metavar="LOG.csv", help=f"{LOG_HELP}; one of theta and theta_dot, and one of beta and "
                                                    "beta_cmd, is enough")
    sub.add_argument("--out", required=True, metavar="NEW.toml", help="write the nominal to this file")
    add_map(sub)
    add_outputs(sub)
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid nominal` with its parsed arguments: write the first nominal, and print it."""
    log = read_noting(args.log, "t", **reading(args))
    check_outputs(args.out, args.json)
    from ..first_nominal import first, lines, report, write
    result = first(log)
    if args.json:
        text = json.dumps(report(result), indent=1)
        if args.json == "-":
            answer(text)
        else:
            write_text(args.json, [text, "\n"])
    if result.refused:
        raise InputError(f"{args.log}: {'; '.join(result.refused)}")
    write(result, args.out)
    if args.json != "-":
        answer("\n".join(lines(result, args.out)))
