"""Map rows of a growing CSV to rows of a log as they come, with the numbers that `convert` makes of the whole file.

Limitation: a stream has one clock, so every column is stamped by the same channel.
"""

import dataclasses
import math

import numpy as np

from sim.errors import InputError

from ..log.log import Log, log_of_values
from .columns import ATTITUDES, sampled, stamps_name
from .mapping import Map, Source
from .text import decimal_number

ONE_TURN = 2.0 * math.pi


class MappedStream:
    """A map (`of`) applied to a growing log.  It keeps the first stamp, each quaternion's reference and last angle."""

    def __init__(self, mapping: Map) -> None:
        self.of = mapping
        whole = [*(["period"] if mapping.period is not None else []), *({"header", "format"} & mapping.options.keys())]
        if whole:
            raise InputError(f"{mapping.path}: {whole[0]} is for whole files; a log that grows has a header first, and "
                             "stamps that are numbers: expected launchid convert, of the whole file")
        self.delimiter, self._decimal = mapping.options.get("delimiter", ","), mapping.options.get("decimal", ".")
        self._sources = list(mapping.sources)
        self._origin: float | None = None if mapping.from_first else 0.0
        self._turned: dict[str, float] = {}

    def columns(self, path: str, header: list[str], where: str) -> "MappedColumns":
        """Return the reader of rows below this header; InputError if a channel is missing, or there are two clocks."""
        names = [name.strip() for name in header]
        there = dict.fromkeys(names, np.empty(0))
        clocks = {stamps_name(path, there, self.of, source) for source in self._sources}
        if len(clocks) > 1:
            raise InputError(f"{path}: {where}{self.of.path} has the clocks {', '.join(sorted(clocks))}; a log that "
                             "grows can have one: expected launchid convert, of the whole file")
        for source in self._sources:
            sampled(path, there, self.of, source)
        return MappedColumns(self, path, names)

    def log(self, path: str, channels: dict[str, np.ndarray]) -> Log:
        """Return further rows as a log in SI units, from channels (n,); t and angles continue those of the previous
        call (t = 0 at the first stamp, no jumps of a turn)."""
        values = {}
        for k, source in enumerate(self._sources):
            if source.axis is not None and source.reference is None:
                self._sources[k] = _referred(channels, source)
            stamps, column = sampled(path, channels, self.of, self._sources[k])
            is_turn = source.axis is not None or source.column in ATTITUDES
            values[source.column] = self._unwrapped(source, column) if is_turn else column
        fair = stamps[np.isfinite(stamps)]
        if self._origin is None and len(fair):
            self._origin = float(fair[0])
        return log_of_values(path, {"t": (stamps - (self._origin or 0.0)) / self.of.units, **values})

    def number(self, cell: str) -> float:
        """Return the number in a cell, with the map's decimal point; NaN if it is none."""
        return decimal_number(cell, self._decimal)

    def _unwrapped(self, source: Source, column: np.ndarray) -> np.ndarray:
        """Return angles (n,) shifted by whole turns so that they continue those of the rows before."""
        fair = column[np.isfinite(column)]
        if len(fair) == 0:
            return column
        turn = ONE_TURN if source.axis is None else ONE_TURN * source.scale * source.factor
        last = self._turned.get(source.column, fair[0])
        shift = turn * round((last - fair[0]) / turn) if turn else 0.0
        self._turned[source.column] = fair[-1] + shift
        return column + shift


class MappedColumns:
    """Reader of the rows under one header, by a map; methods of `launchid.log.table.Columns`, which reads plain logs.

    ignored  empty: a map takes only what it names
    """

    ignored: tuple[str, ...] = ()

    def __init__(self, stream: MappedStream, path: str, names: list[str]) -> None:
        self._stream, self._path, self._names = stream, path, names

    def numbers(self, line: int, cells: list[str]) -> list[float]:
        """Return the numbers of one row's cells, NaN for no number; InputError with the line if the count is wrong."""
        if len(cells) != len(self._names):
            raise InputError(f"{self._path}: line {line}: {len(cells)} cells, expected {len(self._names)} as in the "
                             "header")
        return [self._stream.number(cell) for cell in cells]

    def log(self, rows: list[list[float]]) -> Log:
        """Return rows of numbers, as `numbers` gives them, as a log; values need not be finite."""
        return self._stream.log(self._path, dict(zip(self._names, np.array(rows).T, strict=True)))


def _referred(channels: dict[str, np.ndarray], source: Source) -> Source:
    """Return the source with the first finite attitude as its reference; unchanged if no row has one."""
    q = np.stack([channels[name] for name in source.channels], axis=1)
    fair = q[np.isfinite(q).all(axis=1)]
    return source if len(fair) == 0 else dataclasses.replace(source, reference=tuple(fair[0].tolist()))
