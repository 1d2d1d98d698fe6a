"""The command `launchid convert`: its options, and its run."""

import argparse
from typing import Any

from sim.errors import UsageError

from ..cli.common import check_outputs, warn
from ..cli.options import add_command, add_map
from ..cli.terminal import answer, say
from ..progress import report


def add(commands: Any) -> None:
    """Add the command and its options to the parser."""
    sub = add_command(commands, "convert", "turn a file (ULog, DataFlash, MCAP, MAT, HDF5, Parquet, text) into a log",
                      "launchid convert flight.ulg --map px4.toml --out log.csv")
    sub.add_argument("flight", metavar="FLIGHT", help="read this file; its first bytes decide the format")
    add_map(sub)
    sub.add_argument("--out", metavar="LOG.csv", help="write the log to this file (default: none, with --list)")
    sub.add_argument("--list", action="store_true", help="list the channels of the file instead: the names for the map")
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid convert`."""
    if not args.list and not (args.map and args.out):
        raise UsageError("convert: expected --map MAP.toml and --out LOG.csv, or --list")
    from ..convert.mapping import load_map
    mapping = load_map(args.map) if args.map else None
    from ..results.of_files import channel_lines, convert
    if args.list:
        lines, notes = channel_lines(args.flight, mapping.options if mapping else {})
        for note in notes:
            say(note)
        answer("\n".join(lines))
        return
    assert mapping is not None
    report(f"converting {args.flight}")
    result = convert(args.flight, mapping, ("t",))
    check_outputs(args.out)
    result.write(args.out)
    warn(result)
    say(result.summary(args.out))
