"""Read the channels of a file, name -> (n,) numbers; its first bytes tell the format and so the reader.

A two-dimensional array is NAME[0], NAME[1], ...; groups, topics and structs stand before a `/`.  The libraries are the
extra `logs`, of ArduPilot's logs `ardupilot`; tables of text need none.
"""

import itertools
import math
import os
import stat
import struct
import warnings
import zlib
from collections.abc import Callable, Iterator
from typing import Any, BinaryIO

from sim.csv_text import AS_TEXT
from sim.errors import InputError, UsageError, extras_named
from sim.files import is_read, reads

from . import named
from .messages import read_dataflash, read_mcap, read_ulog
from .text import MOST_NUMBERS, NOT_ASKED, Channels, Wanted, is_asked, read_text, too_large

FIRST_BYTES = 128         # the header of a MAT file
LONGEST_HEADER = 4096     # characters of a first line that may be a log's header
LONGEST_NAME = 64         # of a MATLAB variable, with its end
MAT_OPAQUE = 17
MATLAB_ONLY = {3, 16, MAT_OPAQUE}   # classes of variables: objects, functions, and of these no library knows
MAT_TAG, MAT_MATRIX, MAT_PACKED, MAT_COMPLEX = 8, 14, 15, 1 << 11
MAT_TYPES = {1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 16, 17, 18}   # of numbers and characters
MAT_NUMBERS = {4: 1, 5: 3, **dict.fromkeys(range(6, 16), 1)}   # class -> elements of such types: text, sparse, numbers
DEEPEST = 100             # groups within groups: the library's time grows with the square
OBJECT = "is a MATLAB object (a table, timeseries, ...); save its columns in MATLAB as plain arrays or a struct of them"
LIBRARY_TEXT = 120        # characters of what a library says


def read_channels(path: str, options: dict[str, Any], wanted: Wanted = None) -> Channels:
    """Return the wanted channels of a flight's file of any known format; InputError in one line if it cannot be read.

    options  of a text file: see `text.read_text`
    wanted   names of channels; None: all
    """
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise InputError(f"{path}: not a regular file; expected one, which can be read twice")
        reads(path)
        with open(path, "rb") as file:
            first = file.read(FIRST_BYTES)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    name, reader = next(((name, reader) for magic, name, reader in FORMATS if magic(first)), ("text", None))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        if reader is None:
            channels = read_text(path, options, wanted)
        else:
            channels = _of_library(path, name, reader, wanted)
    channels.notes += dict.fromkeys(f"{path}: {_shortly(each.message)}" for each in said)
    return channels


def _of_library(path: str, name: str, reader: Callable[[str, Wanted], Channels], wanted: Wanted) -> Channels:
    """Return the channels that a library reads; whatever it raises becomes an InputError in one line."""
    try:
        with extras_named():
            return reader(path, wanted)
    except (UsageError, InputError):
        raise
    except Exception as error:  # of a damaged file a library raises what it likes
        raise InputError(f"{path}: cannot be read as {name} ({type(error).__name__}: {_shortly(error)})") from None


def _shortly(error: object) -> str:
    return (str(error).splitlines() or [""])[0][:LIBRARY_TEXT]


# ---- Parquet, HDF5, MAT


def read_parquet(path: str, wanted: Wanted) -> Channels:
    """Return the wanted columns of a Parquet file; a column of lists of equal length gives NAME[0], NAME[1], ..."""
    import pyarrow.parquet
    size = os.path.getsize(path)
    channels = Channels()
    with pyarrow.parquet.ParquetFile(path) as file:
        rows = file.metadata.num_rows
        for name in file.schema_arrow.names:
            if not is_asked(name, wanted):
                channels.unread[name] = NOT_ASKED
            elif reason := too_large(rows, 1, size):
                channels.unread[name] = reason
            else:
                _take_column(channels, name, file.read(columns=[name]).column(0), wanted)
    return channels


def _take_column(channels: Channels, name: str, column: Any, wanted: Wanted) -> None:
    """Add one Parquet column to `channels` in place; lists of equal length k as an array (n, k), others as unread."""
    import pyarrow.compute
    if "list" not in str(column.type):
        channels.take(name, column.to_numpy(zero_copy_only=False), wanted)
        return
    flat = column.combine_chunks().flatten().to_numpy(zero_copy_only=False)
    if len(flat) and len(pyarrow.compute.list_value_length(column).unique()) == 1:
        channels.take(name, flat.reshape(len(column), -1), wanted)
    else:
        channels.unread[name] = "holds lists that are not equally long"


def read_hdf5(path: str, wanted: Wanted) -> Channels:
    """Return the wanted datasets of an HDF5 file (MATLAB 7.3 too), by their path in it; links are not followed."""
    import h5py
    size = os.path.getsize(path)
    channels = Channels()

    def visit(name: str, item: Any) -> None:
        if name.count("/") > DEEPEST:
            raise ValueError(f"groups within more than {DEEPEST} others")
        if isinstance(item, h5py.Group):
            channels.unread.update({f"{name}/{key}".lstrip("/"): reason for key in item if (reason := _is_link(
                item.get(key, getlink=True)))})
        elif not is_asked(name, wanted):
            channels.unread[name] = NOT_ASKED
        elif not name.startswith("#"):
            if reason := _not_read(item, size):
                channels.unread[name] = reason
            elif item.dtype.names:
                for field in item.dtype.names:
                    if is_asked(f"{name}/{field}", wanted):
                        channels.take(f"{name}/{field}", item[field], wanted)
            else:
                channels.take(name, item[()], wanted)

    with h5py.File(path, "r") as file:
        visit("", file)
        file.visititems(visit)
    return channels


def _is_link(link: Any) -> str:
    """Return the reason why a name in a group is not followed (it is a link); "" if it is a dataset or group."""
    if hasattr(link, "filename"):
        return f"is a link into another file ({link.filename}), which is not opened"
    return f"is a link to {link.path}; name that" if hasattr(link, "path") else ""


def _not_read(dataset: Any, size: int) -> str:
    """Return the reason why a dataset is not read from a file of `size` bytes; "" if it is."""
    if dataset.external or dataset.is_virtual:
        return "keeps its numbers in other files, which are not opened"
    if "MATLAB_object_decode" in dataset.attrs:
        return OBJECT
    return too_large(math.prod(dataset.shape or ()), dataset.dtype.itemsize, size)


def read_mat(path: str, wanted: Wanted) -> Channels:
    """Return the wanted variables of a MAT file of version 4 to 7; a field of a struct is VARIABLE/FIELD."""
    import scipy.io
    size = os.path.getsize(path)
    channels = Channels()
    asked = []
    with open(path, "rb") as file:
        order = {b"IM": "<", b"MI": ">"}.get(file.read(FIRST_BYTES)[126:])
        variables = list(_variables(file, order, size) if order else (
            (name, math.prod(shape), 0) for name, shape, _ in scipy.io.whosmat(path)))
    for name, numbers, kind in variables:
        if not is_asked(name, wanted):
            channels.unread[name] = NOT_ASKED
        elif kind in MATLAB_ONLY:
            channels.unread[name] = OBJECT
        elif reason := too_large(numbers, 1, size):
            channels.unread[name] = reason
        else:
            asked.append(name)
    if asked:
        table = scipy.io.loadmat(path, simplify_cells=True, variable_names=asked)
        _take_nested(channels, "", {name: x for name, x in table.items() if not name.startswith("__")}, wanted)
    return channels


def _variables(file: BinaryIO, order: str, file_size: int) -> Iterator[tuple[str, int, int]]:
    """Yield (name, count of numbers, class) of each variable in a MAT file of version 5 to 7, whose header was read.

    Raise ValueError for what would end the process in the library's C code: an array of an unknown type of numbers, or
    cells nested without end.  (The library's own list leaves objects out.)  Framing: MathWorks' "MAT-File Format".
    """
    while len(tag := file.read(MAT_TAG)) == MAT_TAG:
        kind, size = struct.unpack(f"{order}2I", tag)
        data = file.read(min(size, file_size))
        if kind == MAT_PACKED:
            data = zlib.decompressobj().decompress(data, 8 * MOST_NUMBERS)
            kind, data = next(_elements(data, order), (0, b""))
        if kind == MAT_MATRIX and len(data) > 2 * MAT_TAG:
            _walk_matrix(data, order, 0)
            flags, = struct.unpack_from(f"{order}I", data, MAT_TAG)
            parts = [part for _, part in itertools.islice(_elements(data[2 * MAT_TAG:], order), 2)]
            sizes = b"" if flags & 0xFF == MAT_OPAQUE else parts.pop(0)
            shape = struct.unpack(f"{order}{len(sizes) // 4}i", sizes[:len(sizes) // 4 * 4])
            name = parts[0].decode("latin-1") if parts else ""
            if name:  # the one without holds what objects are made of
                yield name, math.prod(shape), flags & 0xFF


def _elements(data: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Yield (type, bytes) of the data elements in a MAT element; the last may be cut short, which the library finds."""
    at = 0
    while at + MAT_TAG <= len(data):
        kind, size = struct.unpack_from(f"{order}2I", data, at)
        if kind >> 16:  # of up to four bytes, in the tag itself
            yield kind & 0xFFFF, data[at + 4:at + 4 + min(kind >> 16, 4)]
            size = 0
        else:
            yield kind, data[at + MAT_TAG:at + MAT_TAG + size]
        at += MAT_TAG + (size + 7) // 8 * 8


def _walk_matrix(data: bytes, order: str, depth: int) -> None:
    """Raise ValueError as `_variables`, for one array: flags behind a tag, dimensions, name, numbers or arrays."""
    if depth > DEEPEST:
        raise ValueError(f"cells within more than {DEEPEST} others")
    if len(data) < 2 * MAT_TAG:  # an empty one
        return
    flags, = struct.unpack_from(f"{order}I", data, MAT_TAG)
    parts = list(_elements(data[2 * MAT_TAG:], order))[2:]
    numbers = MAT_NUMBERS.get(flags & 0xFF, 0) + (1 if flags & MAT_COMPLEX and flags & 0xFF in MAT_NUMBERS else 0)
    if len(parts) < numbers or any(kind not in MAT_TYPES for kind, _ in parts[:numbers]):
        raise ValueError("an array without numbers of a known type")
    for kind, part in parts:
        if kind == MAT_MATRIX:
            _walk_matrix(part, order, depth + 1)


def _take_nested(channels: Channels, prefix: str, table: dict[str, Any], wanted: Wanted) -> None:
    for name, value in table.items():
        if isinstance(value, dict):
            _take_nested(channels, f"{prefix}{name}/", value, wanted)
        else:
            channels.take(prefix + name, value, wanted)


def _is_mat_4(first: bytes) -> bool:
    """Whether a file begins as MAT version 4: type, rows, columns, complex or not, length of the name, the name."""
    for order in ("<5i", ">5i"):
        if len(first) > struct.calcsize(order):
            kind, rows, columns, is_complex, length = struct.unpack_from(order, first)
            name = first[20:20 + length]
            if 0 <= kind % 1000 <= 52 and 0 <= kind <= 1052 and min(rows, columns) > 0 and is_complex in (0, 1) and \
                    1 < length <= LONGEST_NAME and name.endswith(b"\0") and name[:-1].isalnum():
                return True
    return False


FORMATS: list[tuple[Callable[[bytes], bool], str, Callable[[str, Wanted], Channels]]] = [
    (lambda first: first.startswith(b"ULog\x01\x12\x35"), "ULog", read_ulog),
    (lambda first: first.startswith(b"\x89MCAP"), "MCAP", read_mcap),
    (lambda first: first.startswith(b"\x89HDF\r\n\x1a\n") or first[124:] in (b"\x00\x02IM", b"\x02\x00MI"), "HDF5",
     read_hdf5),
    (lambda first: first.startswith(b"PAR1"), "Parquet", read_parquet),
    (lambda first: first[124:] in (b"\x00\x01IM", b"\x01\x00MI") or _is_mat_4(first), "MAT", read_mat),
    (lambda first: first.startswith((b"\xa3\x95\x80", b"FMT, 128")), "ArduPilot DataFlash", read_dataflash)]


def foreign_format(path: str) -> str | None:
    """Return the name of a file's format if it is a known binary one (ULog, HDF5, ...); None for text and pipes."""
    if not os.path.isfile(path):  # a pipe could not be read again
        return None
    try:
        with open(path, "rb") as file:
            first = file.read(FIRST_BYTES)
    except OSError:
        return None
    return next((name for magic, name, _ in FORMATS if magic(first)), None)


def map_by_itself(path: str) -> str | None:
    """Return the named map that a file is read with if nobody names one: by its format, or by the header of a table of
    text that is no log; None if it is not unambiguous."""
    if foreign := foreign_format(path):
        return named.OF_FORMAT.get(foreign)
    if not os.path.isfile(path) or is_read(path):
        return None
    try:
        with open(path, **AS_TEXT) as file:
            names = {each.strip() for each in file.readline(LONGEST_HEADER).split(",")}
        return None if {"t", "theta"} & names else named.recognised(read_channels(path, {}))
    except (InputError, OSError, UnicodeDecodeError):
        return None


def refuse_foreign(path: str) -> None:
    """Raise InputError if a file is of a known binary format (ULog, HDF5, ...), which is read with a map only."""
    if foreign := foreign_format(path):
        raise InputError(f"{path}: a file of the format {foreign}; expected --map MAP.toml, or a CSV log")
