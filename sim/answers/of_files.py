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
from .answer import Answer, Columns

if TYPE_CHECKING:
    from .answer import Figure


@dataclass(frozen=True, eq=False)
class Converted(Answer):
    """A flight's file as a log."""

    log: Log
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    def summary(self, of: str = "log") -> str:
        r = self.report
        shares = ", ".join(f"{name} {100 * share:.4g} %" for name, share in r["measured"].items())
        return f"{of}: {r['rows']} rows over {r['span']:.6g} s, {r['period']:.6g} s apart; measured: {shares}"

    def columns(self) -> Columns:
        return {name: x.tolist() for name, x in self.log.measured().items()}

    def _figure(self) -> "Figure":
        from .figures import log_figure
        return log_figure(self.log)

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
