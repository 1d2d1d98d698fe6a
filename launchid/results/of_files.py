"""Answers from other people's files: convert."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sim.errors import InputError, one_line
from sim.result import Columns

from ..convert.columns import converted
from ..convert.mapping import Map
from ..convert.readers import read_channels
from ..log.log import REQUIRED, Log, write_columns
from .answer import Answer

if TYPE_CHECKING:
    from sim.result import Figure

SHOWN = 3   # reasons, of a file that holds nothing


@dataclass(frozen=True, eq=False)
class Converted(Answer):
    """A flight's file as a log."""

    log: Log
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    def summary(self, of: str = "log") -> str:
        return self.log.summary(of)

    def columns(self) -> Columns:
        return self.log.table()

    def _figure(self) -> "Figure":
        return self.log._figure()

    def write(self, path: str | Path) -> None:
        """The log, as CSV."""
        write_columns(path, self.log.measured())


def convert(path: str, mapping: Map, required: tuple[str, ...] = REQUIRED) -> Converted:
    """The log that a map makes of a flight's file."""
    log, notes = converted(path, mapping, required)
    t = log.t[np.isfinite(log.t)]
    return Converted(log, {
        "rows": len(log.t), "span": float(np.ptp(t)), "period": log.period,
        "measured": {name: float(np.isfinite(x).mean()) for name, x in log.measured().items() if name != "t"}},
        notes)


def channel_lines(path: str, options: dict[str, Any]) -> tuple[list[str], tuple[str, ...]]:
    """The content of a file, a line each: channels with rows and range, what is no channel and why; notes beside it.
    InputError if it holds no channel."""
    channels = read_channels(path, options)
    if not channels:
        why = [f"{name} {reason}" for name, reason in channels.unread.items()]
        raise InputError(f"{path}: it holds no channel of numbers" + (f": {'; '.join(why[:SHOWN])}" if why else ""))
    lines = [f"{one_line(name)}  {_rows(x)}" for name, x in channels.items()]
    lines += [f"{one_line(name)}  not read: it {reason}" for name, reason in channels.unread.items()]
    return lines, tuple(channels.notes)


def _rows(x: np.ndarray) -> str:
    """The rows of a channel, those of them in which it is measured if not all, and its range, in words."""
    fair = x[~np.isnat(x)] if x.dtype.kind == "M" else x[np.isfinite(x)]
    count = f"{len(x)} rows" if len(fair) == len(x) else f"{len(x)} rows, {len(fair)} with numbers"
    if not len(fair):
        return count
    low, high = np.min(fair), np.max(fair)
    return f"{count}, {low} .. {high}" if x.dtype.kind == "M" else f"{count}, {low:.6g} .. {high:.6g}"
