"""Read the rows of a CSV text one at a time, each with the line that it begins on.

Anything else is an InputError of one line that names it: another kind of file, another encoding, a quote that is
not closed, a line without an end.  Memory is that of one row, whatever the file holds.
"""

import csv
import math
import re
from collections.abc import Iterator
from typing import Any, TextIO

from .errors import InputError

CELL_CHARACTERS = 40  # characters of a cell in a message
LONGEST_CSV_LINE = 1 << 20  # characters: a sample's line has a few hundred
BOM_16 = (b"\xff\xfe", b"\xfe\xff")
FOREIGN_FILES = (  # first bytes -> what such a file is, and what to do with it; the first that fits
    (b"\xff\xfe\x00\x00", "UTF-32 text; save it as UTF-8"), (BOM_16[0], "UTF-16 text; save it as UTF-8"),
    (BOM_16[1], "UTF-16 text; save it as UTF-8"),
    (b"\x1f\x8b", "a gzip archive; unpack it first"), (b"BZh", "a bzip2 archive; unpack it first"),
    (b"\xfd7zXZ\x00", "an xz archive; unpack it first"), (b"\x28\xb5\x2f\xfd", "a zstd archive; unpack it first"),
    (b"PK\x03\x04", "a zip archive, as a spreadsheet is; unpack it, or save the sheet as CSV"),
    (b"\xd0\xcf\x11\xe0", "a spreadsheet or document; save the sheet as CSV"),
    (b"\x89PNG", "a picture"), (b"\xff\xd8\xff", "a picture"), (b"GIF8", "a picture"), (b"%PDF-", "a PDF"),
    (b"SQLite format 3\x00", "an SQLite database; export the table as CSV"), (b"\x7fELF", "a program"),
    (b"\x93NUMPY", "a numpy array; write it with numpy.savetxt, or hand it over from Python"),
    (b"ARROW1", "a Feather (Arrow) file; write it as Parquet or CSV"),
    (b"PAR1", "a Parquet file; read it with --map MAP.toml"),
    (b"#ROSBAG V2.0", "a ROS 1 bag; turn it into MCAP (rosbags-convert), which --map reads"),
    (b"H Product:Blackbox", "a Blackbox log; decode it with blackbox_decode, whose CSV --map reads"),
    (b"<?xml", "XML"), (b"<!DOCTYPE", "a web page"), (b"<html", "a web page"))

TLOG = (b"\xfe", b"\xfd")   # a MAVLink packet's first byte, behind a stamp of eight
# float() alone takes 1_000, Arabic-Indic digits and more; a log's cell is a plain ASCII number
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,4})?\Z|[+-]?inf(inity)?\Z", re.ASCII | re.IGNORECASE)
_NOT_MEASURED = re.compile(r"([+-]?nan)?\Z", re.ASCII | re.IGNORECASE)  # C prints -nan
# of `open` for a file that `rows` reads
AS_TEXT: Any = {"encoding": "utf-8-sig", "errors": "surrogateescape", "newline": ""}


def number(text: str) -> float | None:
    """Return a cell's number; NaN: not measured; None: no number."""
    text = text.strip()
    if _NOT_MEASURED.match(text):
        return math.nan
    return float(text) if _NUMBER.match(text) else None


def shown(cell: str) -> str:
    """Return a cell as text for a message: escaped, and cut to CELL_CHARACTERS."""
    return ascii(cell if len(cell) <= CELL_CHARACTERS else cell[:CELL_CHARACTERS] + "...")


def rows(path: str, file: TextIO, delimiter: str = ",") -> Iterator[tuple[int, list[str]]]:
    """Yield (line it begins on, cells) of every row that is not blank; InputError for a text that is not CSV.

    file  opened with AS_TEXT: bytes that are not UTF-8 are found here, with their line; path  for messages
    """
    lines = Lines(path, file)
    reader = csv.reader(lines, delimiter=delimiter, strict=True)
    while True:
        begins = lines.number + 1
        try:
            cells = next(reader, None)
        except csv.Error as error:
            reason = _reason(str(error), lines.number > begins, delimiter)
            raise InputError(f"{path}: line {begins}: {reason}") from None
        if cells is None:
            return
        if cells:
            yield begins, cells


class Lines:
    """Iterator over the lines of a file, each checked (InputError); `number` is that of the last line given.

    A line without an end is the last: what a file that grows has got meanwhile would be its other half.
    """

    def __init__(self, path: str, file: TextIO) -> None:
        self.path, self.number, self._readline, self._has_ended = path, 0, file.readline, False

    def __iter__(self) -> "Lines":
        return self

    def __next__(self) -> str:
        line = "" if self._has_ended else self._readline(LONGEST_CSV_LINE)
        if not line:
            raise StopIteration
        self._has_ended = not line.endswith(("\n", "\r"))
        self.number += 1
        if self.number == 1:
            self._check_kind(line)
        if not line.isascii():
            self._check_encoding(line)
        if len(line) == LONGEST_CSV_LINE:
            raise InputError(f"{self.path}: line {self.number}: more than {LONGEST_CSV_LINE} characters; expected one "
                             "sample a line")
        return line

    def _check_kind(self, line: str) -> None:
        first = line.encode("utf-8", "surrogateescape")
        for magic, what in FOREIGN_FILES:
            if first.startswith(magic):
                raise InputError(f"{self.path}: this is {what}; expected a UTF-8 CSV file")
        if first[:1] == b"\x00" and first[8:9] in TLOG:
            raise InputError(f"{self.path}: this is a MAVLink telemetry log (tlog); decode it with mavlogdump; "
                             "expected a UTF-8 CSV file")
        if "\0" in line:
            raise InputError(f"{self.path}: line 1: a NUL character, as UTF-16 and binary files have; expected a UTF-8 "
                             "CSV file")

    def _check_encoding(self, line: str) -> None:
        try:
            line.encode("utf-8")
        except UnicodeEncodeError as error:
            byte = line[error.start].encode("utf-8", "surrogateescape")[0]
            raise InputError(f"{self.path}: line {self.number}: the byte 0x{byte:02x} is not UTF-8; expected a UTF-8 "
                             "CSV file") from None


def _reason(error: str, over_lines: bool, delimiter: str) -> str:
    """Return what an error of the csv module means, and what was expected."""
    if "end of data" in error or ("field limit" in error and over_lines):
        return "a quote is opened and not closed; expected a closing quote, or none"
    if "field limit" in error:
        return f"a cell of more than {csv.field_size_limit()} characters; expected a number"
    if "expected after" in error:
        return f"text behind a closing quote; expected {delimiter!r} there"
    return f"{error}; expected cells between {delimiter!r}"
