"""Cut the bytes of a stream into rows, and the rows into logs.

A row that cannot be read is reported in one line with its number, counted, and left out.
"""

import csv
from collections.abc import Callable, Iterator

from launchid_core import Sample
from sim.errors import InputError

from ..convert.mapping import Map
from ..convert.stream import MappedColumns, MappedStream
from ..convert.text import BLANKS
from ..log.log import Log, log_of_values
from ..log.table import REQUIRED, Columns

COLUMN_ORDER = Sample._fields  # of columns without a header row
MIN_COLUMNS = 4          # of them: up to beta
LONGEST_LINE = 1 << 16   # bytes of a line: a row has a few hundred
MOST_MESSAGES = 20       # messages about what came: of more, rows that cannot be read are counted
LONGEST_SAID = 300       # characters of one
BOM = b"\xef\xbb\xbf"


class Lines:
    """Reader of a stream's bytes as CSV rows, by the rules of `launchid.log.log`.

    path       name of the stream in messages
    strict     raise InputError if the columns cannot be used (a file); else count such a row as malformed (a socket,
               where anybody may send anything)
    say        called with each message
    mapping    map of rows with other names and units; None: columns of a log, in SI units
    required   columns that rows must have
    malformed, last   how many rows could not be read; the message about the last of them
    """

    def __init__(self, path: str, strict: bool, say: Callable[[str], None], mapping: Map | None = None,
                 required: tuple[str, ...] = REQUIRED) -> None:
        self._required = required
        self.path, self._strict, self._say = path, strict, say
        self._mapped = None if mapping is None else MappedStream(mapping)
        self._clock = "t" if mapping is None else mapping.time
        self.malformed, self.last, self._said = 0, "", 0
        self.number, self._torn = 0, b""
        self.begin_anew()

    def begin_anew(self) -> None:
        """Begin another stream: an unfinished line is dropped as malformed, and a new header is expected."""
        if self._torn:
            self._refuse(f"{self.path}: line {self.number + 1}: cut short")
        self._torn, self._too_long, self.number = b"", False, 0
        self._columns: Columns | MappedColumns | None = None
        self._headless = True  # no header was refused, so rows without one are in COLUMN_ORDER

    def logs(self, piece: bytes) -> Iterator[Log]:
        """Yield the rows that this piece of bytes completes, as one log for each header; an unfinished line waits for
        the next piece."""
        *lines, self._torn = (self._torn + piece).split(b"\n")
        rows: list[list[float]] = []
        for line in lines:
            before = self._columns
            row = self._row(line)
            if before is not None and before is not self._columns and rows:
                yield _log(before, rows)
                rows = []
            if row is not None:
                rows.append(row)
        if rows and self._columns is not None:
            yield _log(self._columns, rows)
        if len(self._torn) > LONGEST_LINE:
            self._torn, self._too_long = b"", True

    def _row(self, line: bytes) -> list[float] | None:
        """Return the numbers of a line; None for a header, a blank line or a malformed row."""
        self.number += 1
        too_long, self._too_long = self._too_long or len(line) > LONGEST_LINE, False
        if too_long:
            self._refuse(f"{self.path}: line {self.number}: more than {LONGEST_LINE} bytes; expected a row")
            return None
        try:
            cells = self._cells(line)
            if cells and self._is_header(cells):
                self._take_header(cells)
                return None
            if cells and self._columns is None:
                self._columns = self._by_order(cells)
            return self._columns.numbers(self.number, cells) if cells and self._columns is not None else None
        except InputError as error:
            if self._strict and self._columns is None:
                raise
            self._refuse(str(error))
            return None

    def _cells(self, line: bytes) -> list[str]:
        try:
            text = line.removeprefix(BOM if self.number == 1 else b"").rstrip(b"\r").decode("utf-8")
            delimiter = "," if self._mapped is None else self._mapped.delimiter
            if delimiter == BLANKS:
                return text.split()
            return next(csv.reader([text], strict=True, delimiter=delimiter), [])
        except UnicodeDecodeError:
            raise InputError(f"{self.path}: line {self.number}: not UTF-8; expected a UTF-8 CSV row") from None
        except csv.Error as error:
            raise InputError(f"{self.path}: line {self.number}: {error}; expected comma-separated cells") from None

    def _is_header(self, cells: list[str]) -> bool:
        """Whether the cells name the column of stamps; of a file also a first line that is no row of numbers."""
        return self._clock in map(str.strip, cells) or (self._strict and self.number == 1 and not _are_numbers(cells))

    def _take_header(self, cells: list[str]) -> None:
        self._columns, self._headless = None, False
        where = f"line {self.number}: "
        self._columns = (Columns(self.path, cells, self._required, where) if self._mapped is None else
                         self._mapped.columns(self.path, cells, where))
        if self._columns.ignored:
            self._tell(f"{self.path}: columns ignored: "
                       + ", ".join(ascii(name)[1:-1] for name in self._columns.ignored))

    def _by_order(self, cells: list[str]) -> Columns:
        if self._mapped is not None:
            raise InputError(f"{self.path}: line {self.number}: a row before a header row, without which "
                             f"{self._mapped.of.path} tells nothing; expected one with {self._clock!r}")
        if not self._headless:
            raise InputError(f"{self.path}: line {self.number}: its header row could not be used")
        if not MIN_COLUMNS <= len(cells) <= len(COLUMN_ORDER):
            raise InputError(f"{self.path}: line {self.number}: {len(cells)} cells and no header row; expected one, or "
                             f"{MIN_COLUMNS} to {len(COLUMN_ORDER)} cells in the order {','.join(COLUMN_ORDER)}")
        self._tell(f"{self.path}: no header row: the columns are taken for {','.join(COLUMN_ORDER[:len(cells)])}")
        return Columns(self.path, list(COLUMN_ORDER[:len(cells)]))

    def _refuse(self, text: str) -> None:
        self.malformed += 1
        self.last = text
        self._tell(f"{self.last}; the row is left out")

    def _tell(self, text: str) -> None:
        """Report a message, MOST_MESSAGES at most, whatever a sender does."""
        self._said += 1
        if self._said <= MOST_MESSAGES:
            self._say(text if len(text) <= LONGEST_SAID else f"{text[:LONGEST_SAID]}...")
        elif self._said == MOST_MESSAGES + 1:
            self._say(f"{self.path}: further messages of its rows are left out; those that cannot be read are counted")


def _log(columns: Columns | MappedColumns, rows: list[list[float]]) -> Log:
    if isinstance(columns, MappedColumns):
        return columns.log(rows)
    return log_of_values(columns.path, columns.values(rows), columns.ignored)


def _are_numbers(cells: list[str]) -> bool:
    try:
        return bool([float(cell or "nan") for cell in cells])
    except ValueError:
        return False
