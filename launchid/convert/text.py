"""Read tables of text as channels: find where the table begins and its delimiter, then let numpy read it.

`numpy.loadtxt` is the reader: it is wherever launchid is, knows quotes and runs of blanks, and refuses a row of another
width, which readers of data frames fill up.  What it does not know is where a table begins; that is here.
"""

import csv
import itertools
import math
import re
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from sim.csv_text import AS_TEXT, Lines, number, rows, shown
from sim.errors import InputError

MOST_COLUMNS = 64      # of a two-dimensional array: a longer side is time
MOST_NUMBERS = 1 << 28  # of one array: three days at 1 kHz, 2 GB
EXPANSION = 1032       # bytes of numbers a byte of the file: the most that deflate packs
NOT_ASKED = "not asked for"
Wanted = frozenset[str] | None   # names of channels; None: all


class Channels(dict[str, np.ndarray]):
    """Channels of a file: name -> numbers (n,).

    unread  name -> reason why it is not read, as a text
    notes   one line each: what was damaged or left out in reading
    """

    def __init__(self, values: Iterable[tuple[str, np.ndarray]] = ()) -> None:
        super().__init__(values)
        self.unread: dict[str, str] = {}
        self.notes: list[str] = []

    def take(self, name: str, values: Any, wanted: Wanted) -> None:
        """Add an array (n,) as channel `name`, of (n, k) the columns as NAME[0], NAME[1], ..., as far as they are
        `wanted`; note in `unread` why others are left out."""
        array = np.asarray(values)
        if reason := _no_channel(array):
            self.unread[name] = reason
            return
        for each, column in _columns(name, array):
            if wanted is None or each in wanted:
                self[each] = column
            else:
                self.unread[each] = NOT_ASKED


def _no_channel(array: np.ndarray) -> str:
    """Return the reason why an array is no channel; "" if it is one."""
    if array.dtype.kind not in "biufmM":
        return "holds no numbers"
    if array.size < 2:
        return "has one row" if array.size else "is empty"
    return f"has {array.ndim} dimensions" if array.ndim > 2 and 1 not in array.shape else ""


def _columns(name: str, array: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Yield (name, values (n,)) of a vector, or (NAME[k], column k) of a matrix; dates in ns, durations as integers."""
    if array.dtype.kind == "M":
        array = array.astype("M8[ns]")
    elif array.dtype.kind == "m":
        array = array.astype(np.int64)
    array = np.squeeze(array)
    if array.ndim == 1:
        yield name, array
    elif array.ndim == 2:
        tall = array if array.shape[1] <= MOST_COLUMNS or array.shape[0] > array.shape[1] else array.T
        for k in range(tall.shape[1]):
            yield f"{name}[{k}]", tall[:, k]


def is_asked(name: str, wanted: Wanted) -> bool:
    """Whether `wanted` (None: all) holds this name, or a channel in the array or group of this name."""
    return wanted is None or any(each == name or each.startswith((f"{name}[", f"{name}/", f"{name}."))
                                 for each in wanted)


def too_large(numbers: int, itemsize: int, file_size: int) -> str:
    """Return the reason why so many declared numbers of a file are not read; "" if they are."""
    if numbers * itemsize > EXPANSION * file_size:
        return f"declares {numbers:.4g} numbers, which a file of {file_size:.4g} bytes cannot hold"
    if numbers > MOST_NUMBERS:
        return f"declares {numbers:.4g} numbers; expected at most {MOST_NUMBERS:.4g}"
    return ""


HEAD_LINES = 1000           # in which a table begins
HEAD_CHARACTERS = 1 << 18   # and characters
BLANKS = " "          # as a delimiter: any run of blanks and tabs
DELIMITERS = (",", ";", "\t", "|", BLANKS)
DECIMAL_POINTS = (".", ",")
COMMENT = "#%"        # before a header, as numpy.savetxt and MATLAB write it
EPOCH = datetime(1970, 1, 1)
MOST_CHANNELS = 64       # channels, at most, of a table that has one value a row
PLAIN_NUMBER = re.compile(r"-?[0-9]+(\.[0-9]+)?(e-?[0-9]{1,3})?").fullmatch
NO_DATE = int(np.iinfo(np.int64).min)   # numpy's NaT


@dataclass(frozen=True)
class Layout:
    """Place and form of a table in a text file.

    names   of its columns
    header  index of its header among the file's lines; None: it has none
    first   index of its first row among the file's lines
    is_commented   comments stand before its rows; comment lines between them are left out
    """

    names: list[str]
    header: int | None
    first: int
    delimiter: str
    decimal: str
    is_commented: bool = False


def read_text(path: str, options: dict[str, Any], wanted: Wanted) -> Channels:
    """Return columns of a table in a text file, named by its header, or 0, 1, 2, ... if it has none.

    A cell that is no number is NaN, a date a datetime64[ns]; a column with neither is no channel.

    options  `delimiter`, `decimal` (default: told by the text), `header` (its line, 0: none; default: the first line
             with wanted names), `format` of the dates in the columns `stamps` (default: ISO 8601)
    """
    with open(path, **AS_TEXT) as file:
        lines = Lines(path, file)
        head = list(_head(lines))
        layout = _layout(path, head, options, wanted)
        channels = Channels()
        channels.notes += _left_out(path, head, layout, options)
        _refuse_long(path, head, layout, wanted)
        asked = _asked(path, layout, wanted)
        channels.unread.update({name: NOT_ASKED for k, name in enumerate(layout.names) if k not in asked})
        first = [cells_of(line, layout.delimiter) for line in head[layout.first:]
                 if not (layout.is_commented and is_comment(line))]
        readers = {k: _reader([row[k] for row in first if len(row) > k and row[k]], layout, options, name)
                   for k, name in asked.items()}
        comments = itertools.count()
        table = _table(path, layout, _numbered(lines, head, layout, comments), readers)
        if skipped := next(comments):
            channels.notes.append(f"{path}: {skipped} comment line{'s' * (skipped > 1)} between the rows left out")
    for k, name in asked.items():
        if readers[k].count:
            channels.take(name, table[f"f{k}"], None)
            channels.notes += readers[k].note(path, name, len(table))
        else:
            channels.unread[name] = f"holds no numbers ({readers[k].odd})" if readers[k].odd else "is empty"
    return channels


def _head(lines: Lines) -> Iterator[str]:
    characters = 0
    for line in itertools.islice(lines, HEAD_LINES):
        yield line
        characters += len(line)
        if characters > HEAD_CHARACTERS:
            return


def cells_of(line: str, delimiter: str) -> list[str]:
    """Return the cells of one line, split at `delimiter` (quotes respected) and stripped."""
    if delimiter == BLANKS:
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error:
        return [line]


def _split(head: list[str], delimiter: str) -> list[list[str]]:
    """Return for each line the cells of the row that begins on it; [] for a line within a quoted cell."""
    if delimiter == BLANKS or not any('"' in line for line in head):
        return [cells_of(line, delimiter) for line in head]
    cells: list[list[str]] = [[] for _ in head]
    reader, begins = csv.reader(head, delimiter=delimiter), 0
    try:
        for row in reader:
            cells[begins] = [cell.strip() for cell in row]
            begins = reader.line_num
    except csv.Error:  # a cell that is far too long: a quote, most likely
        cells[begins:] = [cells_of(line, delimiter) for line in head[begins:]]
    return cells


def decimal_number(cell: str, decimal: str) -> float:
    """Return the number in a cell with this decimal point; NaN if it is no number."""
    value = number(cell.replace(decimal, ".") if decimal != "." else cell)
    return np.nan if value is None else value


# ---- where the table is


class _Rows:
    """The first lines of a text, split into cells by one delimiter and decimal point.

    cells, numbers  of each line, and how many of them are numbers
    width           cells of the lines that hold the most numbers; `score`: how well this delimiter and point fit
    """

    def __init__(self, head: list[str], delimiter: str, decimal: str) -> None:
        self.delimiter, self.decimal, self._head = delimiter, decimal, head
        self.cells = _split(head, delimiter)
        point = str.maketrans({decimal: "."})
        self.numbers = [sum(1 for cell in row if cell and number(cell.translate(point)) is not None)
                        for row in self.cells]
        held: Counter[int] = Counter()
        filled: Counter[int] = Counter()
        for row, count in zip(self.cells, self.numbers, strict=True):
            held[len(row)] += count
            filled[len(row)] += sum(1 for cell in row if cell)
        self._lines = Counter(len(row) for row in self.cells)
        self.score, self.width = max((((held[w] ** 2 / max(filled[w], 1), self._lines[w]), w) for w in held),
                                     default=((0.0, 0), 0))
        self._usual = held[self.width] / max(self._lines[self.width], 1)

    def is_row(self, k: int) -> bool:
        """Whether line k has the table's width and at least half as many numbers as its lines have on average."""
        return len(self.cells[k]) == self.width and 2.0 * self.numbers[k] >= self._usual

    def names(self, k: int) -> list[str]:
        """Return the names in line k, taken as a header; an empty cell's name is its index."""
        bare = self._head[k].lstrip()
        cells = cells_of(bare.lstrip(COMMENT), self.delimiter) if bare[:1] in COMMENT else self.cells[k]
        return [cell or str(place) for place, cell in enumerate(cells)]


def _layout(path: str, head: list[str], options: dict[str, Any], wanted: Wanted) -> Layout:
    """Return the layout of the text's table; InputError if there is none, or its header cannot be told."""
    if not head:
        raise InputError(f"{path}: an empty file; expected a table of numbers")
    line: int | None = options.get("header")
    if line is not None and line > len(head):
        raise InputError(f"{path}: line {line}, the map's [file] header, is not among the first {len(head)}")
    text = "".join(head)
    delimiters = options.get("delimiter") or [each for each in DELIMITERS[:-1] if each in text] + [BLANKS]
    rows = max((_Rows(head[line or 0:], delimiter, decimal) for decimal in options.get("decimal", DECIMAL_POINTS)
                for delimiter in delimiters if delimiter != decimal), key=lambda each: each.score)
    if not any(rows.numbers):
        between = f" with {options['delimiter']!r} between cells" if "delimiter" in options else ""
        raise InputError(f"{path}: no row of numbers{between} in its first {len(head)} lines; expected text with a "
                         "table of numbers, ULog, ArduPilot's DataFlash, MCAP, MAT, HDF5 or Parquet")
    if line:
        rows = _Rows(head, rows.delimiter, rows.decimal)
    header = line - 1 if line else None if line == 0 else _named(rows, head, wanted)
    first = next(k for k in range(len(head)) if rows.is_row(k)) if header is None else header + 1
    if header is None and line is None:
        header = _before(path, rows, head, first)
    names = [str(k) for k in range(rows.width)] if header is None else rows.names(header)
    is_commented = any(map(is_comment, head[:first + 1]))
    if header is not None:  # units, say, stand between
        first = next((k for k in range(header + 1, len(head)) if not (is_commented and is_comment(head[k])) and
                      (rows.numbers[k] or len(rows.cells[k]) not in (0, len(names)))), header + 1)
    return Layout(names, header, first, rows.delimiter, rows.decimal, is_commented)


def is_comment(line: str) -> bool:
    """Whether a line begins with # or %, as numpy.savetxt, MATLAB and OpenRocket write comments."""
    return line.lstrip()[:1] in COMMENT and line.strip() != ""


def _named(rows: _Rows, head: list[str], wanted: Wanted) -> int | None:
    """Return the index of the line that holds the most of the wanted names; None if no line has one."""
    if wanted is None:
        return None
    shares = [0 if rows.is_row(k) else len(wanted.intersection(rows.names(k))) for k in range(len(head))]
    return shares.index(max(shares)) if max(shares) else None


def _before(path: str, rows: _Rows, head: list[str], first: int) -> int | None:
    """Return the index of the header of a table whose rows begin at `first`, None if it has none; else InputError."""
    above = [k for k in range(first) if rows.cells[k]]
    header = None
    while above and len(rows.cells[above[-1]]) == rows.width:
        header = above.pop()
    if header is not None:
        return header
    comments = itertools.takewhile(lambda k: is_comment(head[k]), reversed(above))  # events, say, stand below it
    header = next((k for k in comments if len(rows.names(k)) == rows.width), None)
    if header is not None:
        return header
    above = [k for k in above if head[k].lstrip()[0] not in COMMENT]
    if above:
        k = above[-1]
        raise InputError(f"{path}: line {first + 1}: {rows.width} cells, expected {len(rows.cells[k])} as in line "
                         f"{k + 1}; [file] header = N in a map says which line is the header (0: none)")
    return None


def _left_out(path: str, head: list[str], layout: Layout, options: dict[str, Any]) -> Iterator[str]:
    """Yield notes on lines that are left out, and on what was assumed about header and decimal point."""
    end = layout.first if layout.header is None else layout.header
    before = [k + 1 for k in range(end) if head[k].strip()]
    if before:
        what = "the first row of numbers" if layout.header is None else "the header"
        yield f"{path}: lines {before[0]} to {before[-1]} stand before {what} in line {end + 1} and are left out"
    between = [k + 1 for k in range(end + 1, layout.first) if head[k].strip() and layout.header is not None]
    if between:
        yield f"{path}: line {between[0]}, between the header and the first row of numbers, is left out"
    if layout.header is None and options.get("header") is None:
        yield f"{path}: the first row is numbers and no header: the columns are called 0 to {len(layout.names) - 1}"
    if layout.decimal != "." and "decimal" not in options:
        yield f"{path}: its numbers seem to have decimal commas and are read so"


def _refuse_long(path: str, head: list[str], layout: Layout, wanted: Wanted) -> None:
    """Raise InputError for a long table: one value a row, with its channel's name in another column."""
    lines = (cells_of(line, layout.delimiter) for line in head[layout.first:])
    rows = [cells for cells in lines if len(cells) == len(layout.names)]
    for k, name in enumerate(layout.names):
        held = {row[k] for row in rows}
        few = 1 < len(held) <= MOST_CHANNELS and len(layout.names) == 3 and len(rows) > 4 * len(held)
        is_text = all(number(cell) is None for cell in held)
        if is_text and (few if wanted is None else held & (wanted - set(layout.names))):
            raise InputError(f"{path}: a long table: each row holds one value, and column {shown(name)} says of which "
                             f"channel ({', '.join(sorted(held)[:3])}, ...); expected a column for each channel: pivot "
                             "the table first")


def _asked(path: str, layout: Layout, wanted: Wanted) -> dict[int, str]:
    """Return index -> name of the wanted columns; InputError if there is none, or a name stands for two."""
    asked = {k: name for k, name in enumerate(layout.names) if wanted is None or name in wanted}
    if not asked and layout.header is None:
        raise InputError(f"{path}: line {layout.first + 1}: the first row is numbers and no header, so the columns are "
                         f"called 0 to {len(layout.names) - 1}; the map names none of them")
    for name, times in Counter(asked.values()).items():
        if times > 1:
            raise InputError(f"{path}: {times} columns are called {shown(name)}; expected one ([file] header = 0 in a "
                             "map calls the columns 0, 1, 2, ...)")
    return asked


# ---- its rows


class _Numbers:
    """Reader of a column's cells as float64.  count: cells that are numbers; odd: the first cell that is none."""

    kind = "f8"
    what = "numbers"

    def __init__(self, decimal: str) -> None:
        self.count, self.decimal, self.odds, self.odd = 0, decimal, 0, ""

    def __call__(self, cell: str) -> float:
        if PLAIN_NUMBER(cell):  # as nearly all are: what `number` does, quickly
            self.count += 1
            return float(cell)
        value = decimal_number(cell, self.decimal)
        if math.isnan(value):
            self._count_odd(cell)
        else:
            self.count += 1
        return value

    def _count_odd(self, cell: str) -> None:
        if number(cell) is None:  # and not a cell that says: not measured
            self.odds += 1
            self.odd = self.odd or shown(cell.strip())

    def note(self, path: str, name: str, rows: int) -> list[str]:
        """Return a list of one line that counts cells which are no number, [] if there are none."""
        return [f"{path}: column {shown(name)[1:-1]}: {self.odds} of {rows} cells are no {self.what} ({self.odd}) and "
                "count as not measured"] if self.odds else []


class _Dates(_Numbers):
    """Reader of a column's cells as dates: integer ns since 1970 in UTC; a date without a zone is UTC."""

    kind = "i8"
    what = "dates"

    def __init__(self, form: str | None) -> None:
        super().__init__(".")
        self.form = form

    def __call__(self, cell: str) -> int:
        stamp = _date(cell.strip(), self.form)
        if stamp is None:
            self._count_odd(cell)
            return NO_DATE
        self.count += 1
        return stamp


def _date(cell: str, form: str | None) -> int | None:
    """Return the nanoseconds since 1970 of a date in the format `form` (None: ISO 8601); None if the cell is no
    date."""
    try:
        date = datetime.strptime(cell, form) if form else datetime.fromisoformat(cell)
        if date.tzinfo is not None:
            date = date.astimezone(UTC).replace(tzinfo=None)
    except (ValueError, OverflowError):
        return None
    since = date - EPOCH
    stamp = ((since.days * 86400 + since.seconds) * 10**6 + since.microseconds) * 1000  # us to ns
    return stamp if abs(stamp) < -NO_DATE else None


def _reader(cells: Iterable[str], layout: Layout, options: dict[str, Any], name: str) -> _Numbers:
    """Return the reader of a column (numbers or dates), chosen by its first cells."""
    form = options.get("format")
    if form and name in options.get("stamps", ()):
        return _Dates(form)
    first = next(iter(cells), "")
    is_date = np.isnan(decimal_number(first, layout.decimal)) and _date(first, None) is not None
    return _Dates(None) if is_date else _Numbers(layout.decimal)


def _check_quotes(path: str, delimiter: str) -> None:
    """Raise InputError for a quote that is not closed, which would make one cell of the rest."""
    with open(path, **AS_TEXT) as file:
        for _ in rows(path, file, delimiter):
            pass


def _numbered(lines: Lines, head: list[str], layout: Layout, comments: Iterator[int]) -> Iterator[tuple[int, str]]:
    """Yield (line number, line) of the table's rows; each comment left out advances `comments` by one."""
    after = ((lines.number, line) for line in lines)
    for place, line in itertools.chain(enumerate(head[layout.first:], layout.first + 1), after):
        if layout.is_commented and is_comment(line):
            next(comments)
        else:
            yield place, line


def _table(path: str, layout: Layout, lines: Iterator[tuple[int, str]], readers: dict[int, _Numbers]) -> np.ndarray:
    """Return the rows as a structured array, field f0 for column 0 and so on; InputError naming the line."""
    last, quotes = (layout.first, ""), 0

    def text() -> Iterator[str]:
        nonlocal last, quotes
        for last in lines:
            quotes += last[1].count('"')
            yield last[1]
    kinds = [(f"f{k}", readers[k].kind if k in readers else "U1") for k in range(len(layout.names))]
    blanks = layout.delimiter == BLANKS
    converters: dict[int | str, Any] = dict(readers.items())
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that there is no row, which the columns say
            table = np.loadtxt(text(), np.dtype(kinds), comments=None, delimiter=None if blanks else layout.delimiter,
                               converters=converters, ndmin=1, quotechar=None if blanks else '"')
    except ValueError as error:
        if not blanks:
            _check_quotes(path, layout.delimiter)
        cells = len(cells_of(last[1], layout.delimiter))
        reason = str(error).splitlines()[0] if cells == len(layout.names) else \
            f"{cells} cell{'s' * (cells != 1)}, expected {len(layout.names)} as in the " + (
                "first row" if layout.header is None else "header")
        raise InputError(f"{path}: line {last[0]}: {reason}") from None
    if quotes % 2 and not blanks:
        _check_quotes(path, layout.delimiter)
    for k, reader in readers.items():
        if reader.kind == "i8":
            kinds[k] = (f"f{k}", "M8[ns]")
    return table.view(np.dtype(kinds))
