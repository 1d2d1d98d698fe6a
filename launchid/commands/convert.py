"""Convert other programs' files to logs: `launchid convert`."""

from __future__ import annotations

import argparse
import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sim.errors import InputError, UsageError, one_line

from ..cli.common import check_outputs, warn
from ..cli.options import add_command, add_map
from ..cli.terminal import answer, say
from ..progress import report
from ..report.answer import Answer

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np

    from sim.result import Columns, Figure

    from ..convert.mapping import Map
    from ..log.log import Log

REASONS_SHOWN = 3  # reasons, of a file that holds nothing


def add(commands: Any) -> None:
    """Add `launchid convert` and its options to argparse's subparsers `commands`."""
    sub = add_command(commands, "convert", "turn a file (ULog, DataFlash, MCAP, MAT, HDF5, Parquet, text) into a log",
                      "launchid convert flight.ulg --map px4.toml --out log.csv")
    sub.add_argument("flight", metavar="FLIGHT", help="read this file; its first bytes decide the format")
    add_map(sub)
    sub.add_argument("--out", metavar="LOG.csv", help="write the log to this file (default: none, with --list)")
    sub.add_argument("--list", action="store_true", help="list the channels of the file instead: the names for the map")
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid convert` with its parsed arguments: write the log, or print the channels of the file (--list)."""
    if not args.list and not (args.map and args.out):
        raise UsageError("convert: expected --map MAP.toml and --out LOG.csv, or --list")
    from ..convert.mapping import map_for
    mapping = map_for(args.flight, args.map) if args.map else None
    mapping = mapping and dataclasses.replace(mapping, cut=mapping.cut.but(args.from_, args.to))
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


@dataclass(frozen=True, eq=False)
class Converted(Answer):
    """Result of `convert`: the log of a flight's file."""

    log: Log
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    def summary(self, of: str = "log") -> str:
        return self.log.summary(of)

    def columns(self) -> Columns:
        return self.log.table()

    def _figure(self) -> Figure:
        from ..report.log_figures import logs_figure, looked_at
        return logs_figure([looked_at(self.log)])

    def write(self, path: str | Path) -> None:
        """Write the log as CSV to `path`."""
        from ..log.log import write_columns
        write_columns(path, self.log.measured())


def convert(path: str, mapping: Map, required: tuple[str, ...] = ("t", "theta", "beta or beta_cmd")) -> Converted:
    """Return the log that a map makes of a flight's file; InputError if a required column is missing."""
    import numpy as np

    from ..convert.columns import converted
    log, notes = converted(path, mapping, required)
    t = log.t[np.isfinite(log.t)]
    return Converted(log, {
        "rows": len(log.t), "span": float(np.ptp(t)), "period": log.period,
        "measured": {name: float(np.isfinite(x).mean()) for name, x in log.measured().items() if name != "t"}},
        notes)


def channel_lines(path: str, options: dict[str, Any]) -> tuple[list[str], tuple[str, ...]]:
    """Return (lines, notes) on a file's content: a line for each channel with rows and range, and for what is no
    channel the reason; InputError if it holds no channel."""
    from ..convert.readers import read_channels
    channels = read_channels(path, options)
    if not channels:
        why = [f"{name} {reason}" for name, reason in channels.unread.items()]
        raise InputError(f"{path}: it holds no channel of numbers" + (f": {'; '.join(why[:REASONS_SHOWN])}" if why
                                                                      else ""))
    lines = [f"{one_line(name)}  {_rows(x)}" for name, x in channels.items()]
    lines += [f"{one_line(name)}  not read: it {reason}" for name, reason in channels.unread.items()]
    return lines, tuple(channels.notes)


def _rows(x: np.ndarray) -> str:
    """Return a channel's rows, how many of them have numbers if not all, and its range, as text."""
    import numpy as np
    fair = x[~np.isnat(x)] if x.dtype.kind == "M" else x[np.isfinite(x)]
    count = f"{len(x)} rows" if len(fair) == len(x) else f"{len(x)} rows, {len(fair)} with numbers"
    if not len(fair):
        return count
    low, high = np.min(fair), np.max(fair)
    return f"{count}, {low} .. {high}" if x.dtype.kind == "M" else f"{count}, {low:.6g} .. {high:.6g}"
