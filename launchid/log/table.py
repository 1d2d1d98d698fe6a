"""Read the columns of a CSV log by name, their cells as numbers.

Rows become numbers in blocks, column by column: a whole log takes the memory of its columns, 8 bytes a number.
"""

import difflib
import itertools
import re
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from sim.csv_text import number, shown
from sim.errors import InputError

REQUIRED = ("t", "theta", "beta")
DRIVEN = ("t", "theta", "beta or beta_cmd")   # the same, where a command may stand for the nozzle
MOVING = ("t", "theta or theta_dot", "beta or beta_cmd")   # the same, where no term of the equation needs theta
OPTIONAL = ("theta_dot", "theta_ddot", "beta_cmd", "theta_ref", "gamma", "alpha", "rate_ref")
UNITS = {"t": "s", "theta": "rad", "beta": "rad", "theta_dot": "rad/s", "theta_ddot": "rad/s^2", "beta_cmd": "rad",
         "theta_ref": "rad", "gamma": "rad", "alpha": "rad", "rate_ref": "rad/s"}
EITHER = " or "
ROWS_A_BLOCK = 4096  # rows that are text at a time
FOREIGN_DELIMITERS = {";": "semicolons", "\t": "tabs", "|": "bars"}  # of other programs' files

OTHER_NAMES = {  # of what other people call a log's columns
    "t": ("time", "timestamp", "seconds"), "theta": ("pitch", "attitude", "angle", "yaw", "roll"),
    "beta": ("nozzle", "gimbal", "tvc", "deflection", "servo", "elevator", "input", "u")}

_INTEGER = re.compile(r" *[+-]?\d+ *\Z", re.ASCII)
_PLAIN = re.compile(r"[0-9+\-.eE \n]*\Z")       # where float() takes what `number` does, but for
_LONG_EXPONENT = re.compile(r"[eE][+-]?\d{5}")  # these


def numbers(cells: Sequence[str]) -> list[float] | None:
    """Return a column of cells as floats, an empty one as NaN (`sim.csv_text.number`); None if one is no number."""
    text = "\n".join(cells)
    if _PLAIN.match(text) and not _LONG_EXPONENT.search(text):
        try:
            return list(map(float, cells))
        except ValueError:  # an empty cell, most likely
            pass
    values = [number(cell) for cell in cells]
    return None if None in values else values  # type: ignore[return-value]


def first_of(required: tuple[str, ...]) -> str:
    """Return the required columns by commas, of two that will do the first."""
    return ", ".join(name.split(EITHER)[0] for name in required)


def places(path: str, header: list[str], required: tuple[str, ...], where: str = "line 1: ") -> dict[str, int]:
    """Return column name -> index in a header; InputError (`where`: its line) if a name is repeated or missing."""
    names = [name.strip() for name in header]
    for name, times in Counter(names).items():
        if times > 1 and name:
            raise InputError(f"{path}: {where}column {shown(name)} stands {times} times; expected once")
    if "gamma" in names and "alpha" in names:
        raise InputError(f"{path}: {where}columns gamma and alpha; expected one of them, the other follows from theta")
    for name in required:
        either = name.split(EITHER)
        if not set(either) & set(names):
            raise InputError(f"{path}: {where}{_without(either[0], names)}; expected a header with "
                             f"{first_of(required)}")
    return {name: k for k, name in enumerate(names)}


def _without(name: str, names: list[str]) -> str:
    """Return half a sentence on a required column `name` that is missing among `names`, and the likely reason."""
    if len(names) == 1:
        for character, words in FOREIGN_DELIMITERS.items():
            if character in names[0]:
                return f"{words} where commas should be (found {shown(names[0])}); a map (--map) reads them"
    bare = {re.sub(r"[\[(].*", "", each).strip().casefold(): each for each in names if each not in REQUIRED + OPTIONAL}
    near = [f"; {shown(bare[each])} is near it: rename it, or name it in a map (--map)"
            for each in difflib.get_close_matches(name, bare, 1)]
    near = near or [f"; {shown(bare[each])} may be it: name it in a map (--map)" for each in OTHER_NAMES.get(name, ())
                    if each in bare][:1]
    if name == "t" and set(REQUIRED[1:]) <= set(names):
        near = near or ["; a map (--map) can give a period in its place"]
    return f"column '{name}' is missing (found {shown(','.join(names))}){''.join(near)}"


class Columns:
    """The columns of a CSV log: checks the header once, then turns any number of rows of cells into numbers.

    known, ignored   name -> index of the columns that are used; names of the others
    InputError for a header that lacks a required column, has a name twice, or both gamma and alpha.
    """

    def __init__(self, path: str, header: list[str], required: tuple[str, ...] = REQUIRED,
                 where: str = "line 1: ") -> None:
        names = places(path, header, required, where)
        self.path, self.width, self._header = path, len(header), header
        self.known = {name: names[name] for name in REQUIRED + OPTIONAL if name in names}
        self.ignored = tuple(name for name in names if name and name not in self.known)

    def numbers(self, line: int, cells: list[str], is_last: Callable[[], bool] = lambda: False) -> list[float]:
        """Return a row's known cells as floats; InputError naming line and column.  is_last(): the file's last row?"""
        if len(cells) != self.width:
            raise InputError(f"{self.path}: line {line}: {self._odd_width(cells, is_last)}")
        if cells == self._header:
            raise InputError(f"{self.path}: line {line}: the header stands here again; expected one log in a file")
        return [self._cell(line, name, cells[k]) for name, k in self.known.items()]

    def _odd_width(self, cells: list[str], is_last: Callable[[], bool]) -> str:
        if any("\0" in cell for cell in cells):
            return "NUL characters; expected a sample (a file that was not closed may end so)"
        hint = ""
        if len(cells) < self.width and is_last():
            hint = "; the file ends there: cut short, or still being written"
        elif len(cells) == 2 * self.width and all(_INTEGER.match(cell) for cell in cells):
            hint = "; the numbers seem to have decimal commas: expected points"
        return f"{len(cells)} cell{'s' * (len(cells) != 1)}, expected {self.width} as in the header{hint}"

    def _cell(self, line: int, name: str, text: str) -> float:
        value = number(text)
        if value is None:
            raise InputError(f"{self.path}: line {line}, column {name}: {shown(text.strip())} is no number; "
                             "expected one such as -0.0123, or an empty cell")
        return value

    def _block(self, rows: list[tuple[int, list[str]]], rest: Iterator[tuple[int, list[str]]],
               ) -> Iterator[Sequence[float]]:
        """Return known columns of rows (line, cells), `rest` behind them; InputError for the first unreadable row."""
        if all(len(cells) == self.width for _, cells in rows):
            turned = list(zip(*(cells for _, cells in rows), strict=True))
            columns = [numbers(turned[k]) for k in self.known.values()]
            whole = [column for column in columns if column is not None]
            if len(whole) == len(columns):
                return iter(whole)
        before = [self.numbers(*row) for row in rows[:-1]]
        return zip(*before, self.numbers(*rows[-1], is_last=lambda: next(rest, None) is None), strict=True)

    def read(self, rows: Iterable[tuple[int, list[str]]]) -> dict[str, np.ndarray]:
        """Return name -> known column (n,) of all rows (line, cells), as `csv_text.rows` yields them."""
        columns = [array("d") for _ in self.known]  # grows where it is: no second copy at the end
        rows = iter(rows)
        while block := list(itertools.islice(rows, ROWS_A_BLOCK)):
            for column, values in zip(columns, self._block(block, rows), strict=True):
                column.extend(values)
        return {name: np.frombuffer(column) if column else np.zeros(0)
                for name, column in zip(self.known, columns, strict=True)}

    def values(self, rows: list[list[float]]) -> dict[str, np.ndarray]:
        """Return name -> known column (n,) from n rows that `numbers` returned."""
        table = np.array(rows, dtype=np.float64).reshape(len(rows), len(self.known))
        return {name: table[:, k].copy() for k, name in enumerate(self.known)}
