"""Answers from other people's files: convert."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..convert.columns import converted
from ..convert.mapping import Map
from ..convert.readers import read_channels
from ..log import REQUIRED, Log, write_columns
from ..result import Columns
from .answer import Answer

if TYPE_CHECKING:
    from ..result import Figure


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


def convert(path: str, of: Map, required: tuple[str, ...] = REQUIRED) -> Converted:
    """The log that a map makes of a flight's file."""
    log, notes = converted(path, of, required)
    t = log.t[np.isfinite(log.t)]
    return Converted(log, {
        "rows": len(log.t), "span": float(np.ptp(t)), "period": log.period,
        "measured": {name: float(np.isfinite(x).mean()) for name, x in log.measured().items() if name != "t"}},
        notes)


def channel_lines(path: str, options: dict[str, str]) -> Iterable[str]:
    """What a file holds: each channel with its rows and its range."""
    for name, x in read_channels(path, options).items():
        fair = x[np.isfinite(x)]
        span = f"{np.min(fair):.6g} .. {np.max(fair):.6g}" if len(fair) else "nothing"
        yield f"{name}  {len(x)} rows, {span}"
