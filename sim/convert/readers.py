"""What a file holds, as channels: name -> (n,) numbers; one function a format, each with the library that knows it.

A two-dimensional array is NAME[0], NAME[1], ...; groups, topics and structs stand before a `/`.  The format is told by
the file's first bytes.  The libraries are the extra `logs`.
"""

import contextlib
import io
import json
import math
import os
from array import array
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ..csv_text import AS_TEXT, rows
from ..errors import InputError, UsageError, extras_named
from ..files import reads
from ..log_table import number


class Channels(dict[str, np.ndarray]):
    """Name -> (n,); `notes` are lines of what was damaged on the way."""

    notes: tuple[str, ...] = ()


FIRST_BYTES = 16
MOST_COLUMNS = 64   # of a two-dimensional array: a longer side is time
ULOG_HEADER = 16
ULOG_DEFINITIONS = tuple(bytes([kind]) for kind in b"BFIMPQ")
ULOG_DATA = tuple(bytes([kind]) for kind in b"ARDLCSO")
NANOSECONDS = "log_time"  # of a message, as an MCAP file stamps it


def read_channels(path: str, options: dict[str, str]) -> Channels:
    """Every channel of a flight's file; InputError in one line if it cannot be read.

    options  of a CSV: `delimiter`, `decimal`
    """
    try:
        reads(path)
        with open(path, "rb") as file:
            first = file.read(FIRST_BYTES)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    found = next(((name, reader) for magic, name, reader in FORMATS if magic(first)), None)
    if found is None:
        return read_csv(path, options)
    name, reader = found
    try:
        with extras_named():
            return reader(path)
    except (UsageError, MemoryError):
        raise
    except Exception as error:  # of a damaged file a library raises what it likes
        reason = (str(error).splitlines() or [""])[0][:120]
        raise InputError(f"{path}: cannot be read as {name} ({type(error).__name__}: {reason})") from None


def _columns(name: str, values: Any) -> Iterator[tuple[str, np.ndarray]]:
    """The channels of one array: itself, or its columns; none of what is no number or has one row."""
    array = np.asarray(values)
    if array.dtype.kind in "mM":
        array = array.astype(np.int64)
    if array.dtype.kind not in "biuf" or array.size < 2:
        return
    if array.ndim == 2 and 1 in array.shape:
        array = array.reshape(-1)
    if array.ndim == 1:
        yield name, array
    elif array.ndim == 2:
        tall = array if array.shape[1] <= MOST_COLUMNS or array.shape[0] > array.shape[1] else array.T
        for k in range(tall.shape[1]):
            yield f"{name}[{k}]", tall[:, k]


# ---- CSV


def read_csv(path: str, options: dict[str, str]) -> Channels:
    """Columns by their header; a cell that is no number is NaN, and a column without one is none."""
    delimiter, decimal = options.get("delimiter", ","), options.get("decimal", ".")
    with open(path, **AS_TEXT) as file:
        read = rows(path, file, delimiter)
        _, head = next(read, (0, []))
        names = [name.strip() for name in head]
        columns = [array("d") for _ in names]
        for line, cells in read:
            if len(cells) != len(names):
                raise InputError(f"{path}: line {line}: {len(cells)} cells, expected {len(names)} as in the header")
            for column, cell in zip(columns, cells, strict=True):
                column.append(decimal_number(cell, decimal))
    table = {name: np.array(column) for name, column in zip(names, columns, strict=True)}
    return Channels({name: x for name, x in table.items() if np.isfinite(x).any()})


def decimal_number(cell: str, decimal: str) -> float:
    """A cell with this decimal point; NaN for what is no number."""
    value = number(cell.replace(decimal, ".") if decimal != "." else cell)
    return math.nan if value is None else value


# ---- formats of libraries


def read_parquet(path: str) -> Channels:
    """Columns of a Parquet file; a list column is one of equally long rows."""
    import pyarrow.parquet
    table = pyarrow.parquet.read_table(path)
    channels = Channels()
    for name in table.column_names:
        column = table.column(name)
        values = column.to_pylist() if "list" in str(column.type) else column.to_numpy(zero_copy_only=False)
        channels.update(_columns(name, values))
    return channels


def read_hdf5(path: str) -> Channels:
    """Datasets of an HDF5 file, and of MATLAB's 7.3, by their place in it."""
    import h5py
    channels = Channels()
    with h5py.File(path, "r") as file:
        def visit(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and item.dtype.names:
                for field in item.dtype.names:
                    channels.update(_columns(f"{name}/{field}", item[field]))
            elif isinstance(item, h5py.Dataset) and not name.startswith("#"):
                channels.update(_columns(name, item[()]))
        file.visititems(visit)
    return channels


def read_mat(path: str) -> Channels:
    """Variables of a MAT file of version 4 to 7, fields of structs behind a `/`."""
    import scipy.io
    return Channels(_nested("", scipy.io.loadmat(path, simplify_cells=True)))


def _nested(prefix: str, table: dict[str, Any]) -> Iterator[tuple[str, np.ndarray]]:
    for name, value in table.items():
        if name.startswith("__"):
            continue
        if isinstance(value, dict):
            yield from _nested(f"{prefix}{name}/", value)
        else:
            yield from _columns(prefix + name, value)


def read_ulog(path: str) -> Channels:
    """Topics of a PX4 log: TOPIC/FIELD, of a further instance TOPIC.1/FIELD."""
    import pyulog
    _walk_definitions(path)
    channels = Channels()
    with contextlib.redirect_stdout(io.StringIO()):  # where it would talk of damage
        log = pyulog.ULog(path)
    if log.file_corruption:
        channels.notes = (f"{path}: the file is damaged; what could be read is used",)
    for data in log.data_list:
        topic = data.name + (f".{data.multi_id}" if data.multi_id else "")
        channels.update({f"{topic}/{field}": x for field, x in data.data.items() if len(x) > 1})
    return channels


def _walk_definitions(path: str) -> None:
    """ValueError if the messages before the first of data are damaged: there the library would not end."""
    with open(path, "rb") as file:
        file.seek(ULOG_HEADER)
        while len(head := file.read(3)) == 3 and head[2:] in ULOG_DEFINITIONS:
            size = int.from_bytes(head[:2], "little")
            if len(file.read(size)) < size:
                break
        if len(head) == 3 and head[2:] not in ULOG_DATA:
            raise ValueError(f"damaged before byte {file.tell()}")


def read_mcap(path: str) -> Channels:
    """Topics of an MCAP file: TOPIC/FIELD.FIELD[k], with TOPIC/log_time in ns.  Those in JSON; in the encoding of ROS 2
    or protobuf if `mcap-ros2-support` or `mcap-protobuf-support` is installed; others are left out."""
    from mcap.reader import make_reader
    factories = _factories()
    decoders: dict[int, Callable[[bytes], Any] | None] = {}
    rows: dict[str, list[dict[str, float]]] = {}
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.id not in decoders:
                decoders[channel.id] = _decoder(factories, channel.message_encoding, schema)
            decode = decoders[channel.id]
            if decode is not None:
                row = dict(_fields("", decode(message.data))) | {NANOSECONDS: message.log_time}
                rows.setdefault(channel.topic.strip("/"), []).append(row)
    channels = Channels()
    for topic, table in rows.items():
        for field in dict.fromkeys(name for row in table for name in row):
            values = [row.get(field, float("nan")) for row in table]
            if len(values) > 1:
                channels[f"{topic}/{field}"] = np.array(values)
    return channels


def _decoder(factories: list[Any], encoding: str, schema: Any) -> Callable[[bytes], Any] | None:
    """Bytes of a message -> its fields; None: nothing here reads this encoding."""
    if encoding == "json":
        return json.loads
    return next((decode for factory in factories if (decode := factory.decoder_for(encoding, schema))), None)


def _factories() -> list[Any]:
    """Of encodings beside JSON, those that are installed."""
    found: list[Any] = []
    try:
        from mcap_ros2.decoder import DecoderFactory as Ros2
        found.append(Ros2())
    except ModuleNotFoundError:
        pass
    try:
        from mcap_protobuf.decoder import DecoderFactory as Protobuf
        found.append(Protobuf())
    except ModuleNotFoundError:
        pass
    return found


def _fields(prefix: str, value: Any) -> Iterator[tuple[str, float]]:
    """The numbers of a decoded message, by the path to them."""
    if isinstance(value, (bool, int, float)):
        yield prefix, value
    elif isinstance(value, dict):
        for name, each in value.items():
            yield from _fields(f"{prefix}.{name}" if prefix else name, each)
    elif isinstance(value, (list, tuple)):
        for k, each in enumerate(value[:MOST_COLUMNS]):
            yield from _fields(f"{prefix}[{k}]", each)
    elif hasattr(value, "__slots__"):
        for name in value.__slots__:
            yield from _fields(f"{prefix}.{name}" if prefix else name, getattr(value, name, None))


FORMATS: list[tuple[Callable[[bytes], bool], str, Callable[[str], Channels]]] = [
    (lambda first: first.startswith(b"ULog\x01\x12\x35"), "ULog", read_ulog),
    (lambda first: first.startswith(b"\x89MCAP"), "MCAP", read_mcap),
    (lambda first: first.startswith(b"\x89HDF\r\n\x1a\n") or first.startswith(b"MATLAB 7.3"), "HDF5", read_hdf5),
    (lambda first: first.startswith(b"PAR1"), "Parquet", read_parquet),
    (lambda first: first.startswith(b"MATLAB 5.0"), "MAT", read_mat)]


def foreign_format(path: str) -> str | None:
    """The name of a file's format if it is one of these."""
    if not os.path.isfile(path):  # a pipe could not be read again
        return None
    try:
        with open(path, "rb") as file:
            first = file.read(FIRST_BYTES)
    except OSError:
        return None
    return next((name for magic, name, _ in FORMATS if magic(first)), None)
