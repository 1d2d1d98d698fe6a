"""Identify live, from a growing log or a socket: `launchid watch`."""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from launchid_core import NOISE_LEVELS

from ..argument_checks import DEFAULT_WINDOW
from ..cli.common import check_outputs, read_nominal, tell, warn
from ..cli.options import NOMINAL_HELP, add_command, add_map, add_nominal, add_strict, nominal_of
from ..cli.terminal import say


def add(commands: Any) -> None:
    """Add `launchid watch` and its options to argparse's subparsers `commands`."""
    sub = add_command(commands, "watch", "identify live: follow a growing log or a socket, on a page of this machine",
                      "launchid watch flight.csv --nominal vega_like --http 8642")
    sub.add_argument("source", metavar="FILE|udp:PORT|tcp:PORT",
                     help="follow a CSV log that grows, a pipe, - for standard input, or rows sent to a port of "
                          "127.0.0.1 (0: any free one)")
    add_nominal(sub, f"identify with {NOMINAL_HELP}", required=True)
    sub.add_argument("--window", type=float, default=DEFAULT_WINDOW, metavar="S",
                     help="set the length of a window [s] (default %(default)s, at most a third of the nominal's "
                          "duration)")
    sub.add_argument("--period", type=float, metavar="S",
                     help="set the time between samples [s] (default: the median step of the first 64 rows)")
    sub.add_argument("--noise", default="estimated", choices=NOISE_LEVELS,
                     help="estimate the noise levels, from the nominal's on (estimated), or keep them as the nominal "
                          "has them (declared) (default %(default)s)")
    sub.add_argument("--http", type=int, default=0, metavar="PORT",
                     help="serve the page on this port of 127.0.0.1 (default %(default)s: any free one; stderr says "
                          "which)")
    sub.add_argument("--once", action="store_true",
                     help="end with the file's last row, the TCP sender, or an empty datagram (default: end with "
                          "Ctrl-C alone)")
    add_map(sub)
    add_strict(sub)
    sub.add_argument("--json", metavar="PATH|-", help="write the answer at the end as JSON to this file, as identify "
                                                      "does; -: print the JSON alone, on stdout (default: none)")
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid watch` with its parsed arguments: follow the source until it or Ctrl-C ends, print the result."""
    from sim.errors import UsageError

    from ..convert.mapping import load_map, map_for
    from ..convert.named import NAMES
    from ..convert.readers import foreign_format, refuse_foreign
    from ..log.cut import WHOLE
    from ..watch.sources import Source, Whole, open_source
    from .convert import convert
    if not 0 <= args.http < 1 << 16:
        raise UsageError(f"--http {args.http}: expected a port of 0 (any free one) to 65535")
    nominal = read_nominal(nominal_of(args) or "")
    is_there = args.map in NAMES or Path(args.source).is_file()   # then its channels tell what a map leaves open
    mapping = (map_for(args.source, args.map) if is_there else load_map(args.map)) if args.map else None
    cut = (mapping.cut if mapping else WHOLE).but(args.from_, args.to)
    mapping = mapping and replace(mapping, cut=cut)
    source: Source
    if mapping is not None and (foreign := foreign_format(args.source)):
        if not args.once:
            raise UsageError(f"{args.source}: a file of the format {foreign} is not followed while it grows; expected "
                             "--once")
        converted = convert(args.source, mapping)
        warn(converted)
        source, mapping = Whole(converted.log), None
    else:
        refuse_foreign(args.source)
        source = open_source(args.source, args.once, say)
    check_outputs(args.json)
    from ..watch.session import watch
    result = watch(source, nominal, window=args.window, period=args.period, noise=args.noise,
                   strict=args.strict, mapping=mapping, cut=cut, http=args.http, say=say)
    tell(result, args.json)
    if result.interrupted:
        raise KeyboardInterrupt
