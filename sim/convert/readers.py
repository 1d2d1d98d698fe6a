"""What a file holds, as channels: name -> (n,) numbers; one function a format, each with the library that knows it.

A two-dimensional array is NAME[0], NAME[1], ...; groups, topics and structs stand before a `/`.  The format is told by
the file's first bytes.  The libraries are the extra `logs`, of ArduPilot's logs `ardupilot`; text is `text`'s.
"""

import contextlib
import io
import json
import math
import os
import stat
import struct
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from ..errors import InputError, UsageError, extras_named
from ..files import reads
from .channels import MOST_COLUMNS, MOST_NUMBERS, NOT_ASKED, Channels, Wanted, is_asked, too_large
from .text import read_text

FIRST_BYTES = 128
ULOG_HEADER = 16
ULOG_DEFINITIONS = tuple(bytes([kind]) for kind in b"BFIMPQ")
ULOG_DATA = tuple(bytes([kind]) for kind in b"ARDLCSO")
ULOG_LONGEST = 1 << 16    # bytes of a message, whose length has two
NANOSECONDS = "log_time"  # of a message, as an MCAP file stamps it
LONGEST_NAME = 64         # of a MATLAB variable, with its end
MATLAB_ONLY = {"object", "opaque", "function"}   # classes of variables
DEEPEST = 100             # groups within groups: the library's time grows with the square
MOST_FIELDS = 10_000      # numbers of a message: a hundred times of what one has
OBJECT = "is a MATLAB object (a table, timeseries, ...); save its columns in MATLAB as plain arrays or a struct of them"
LARGEST_CHUNK = 1 << 30   # bytes of an MCAP chunk, unpacked: recorders write megabytes
SAID = 120                # characters of what a library says


def read_channels(path: str, options: dict[str, Any], wanted: Wanted = None) -> Channels:
    """Those channels of a flight's file that are asked for; InputError in one line if it cannot be read.

    options  of a text: see `text.read_text`
    wanted   their names; None: all
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
    """What a library reads, with what goes wrong in it as one line."""
    try:
        with extras_named():
            return reader(path, wanted)
    except (UsageError, InputError):
        raise
    except Exception as error:  # of a damaged file a library raises what it likes
        raise InputError(f"{path}: cannot be read as {name} ({type(error).__name__}: {_shortly(error)})") from None


def _shortly(error: object) -> str:
    return (str(error).splitlines() or [""])[0][:SAID]


# ---- Parquet, HDF5, MAT


def read_parquet(path: str, wanted: Wanted) -> Channels:
    """Columns of a Parquet file; a list column is one of equally long rows."""
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
                column = file.read(columns=[name]).column(0)
                channels.take(name, _of_lists(column) if "list" in str(column.type) else
                              column.to_numpy(zero_copy_only=False), wanted)
    return channels


def _of_lists(column: Any) -> np.ndarray:
    """A Parquet column of lists (n, k), if all are equally long; else of objects."""
    import pyarrow.compute
    flat = column.combine_chunks().flatten().to_numpy(zero_copy_only=False)
    is_table = len(pyarrow.compute.list_value_length(column).unique()) == 1 and len(flat)
    return flat.reshape(len(column), -1) if is_table else np.empty(0, dtype=object)


def read_hdf5(path: str, wanted: Wanted) -> Channels:
    """Datasets of an HDF5 file, and of MATLAB's 7.3, by their place in it; never of another file."""
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
    """Why a name of a group is not followed; "" if it is the thing itself."""
    if hasattr(link, "filename"):
        return f"is a link into another file ({link.filename}), which is not opened"
    return f"is a link to {link.path}; name that" if hasattr(link, "path") else ""


def _not_read(dataset: Any, size: int) -> str:
    """Why a dataset of a file of so many bytes is not read; "" if it is."""
    if dataset.external or dataset.is_virtual:
        return "keeps its numbers in other files, which are not opened"
    if "MATLAB_object_decode" in dataset.attrs:
        return OBJECT
    return too_large(math.prod(dataset.shape or ()), dataset.dtype.itemsize, size)


def read_mat(path: str, wanted: Wanted) -> Channels:
    """Variables of a MAT file of version 4 to 7, fields of structs behind a `/`."""
    import scipy.io
    size = os.path.getsize(path)
    channels = Channels()
    asked = []
    for name, shape, kind in scipy.io.whosmat(path):
        if not is_asked(name, wanted):
            channels.unread[name] = NOT_ASKED
        elif kind in MATLAB_ONLY:
            channels.unread[name] = OBJECT
        elif reason := too_large(math.prod(shape), 1, size):
            channels.unread[name] = reason
        else:
            asked.append(name)
    if asked:
        table = scipy.io.loadmat(path, simplify_cells=True, variable_names=asked)
        _take_nested(channels, "", {name: x for name, x in table.items() if not name.startswith("__")}, wanted)
    return channels


def _take_nested(channels: Channels, prefix: str, table: dict[str, Any], wanted: Wanted) -> None:
    for name, value in table.items():
        if isinstance(value, dict):
            _take_nested(channels, f"{prefix}{name}/", value, wanted)
        else:
            channels.take(prefix + name, value, wanted)


def _is_mat_4(first: bytes) -> bool:
    """Does a file begin as MAT version 4: type, rows, columns, is it complex, length of the name, the name."""
    for order in ("<5i", ">5i"):
        if len(first) > struct.calcsize(order):
            kind, rows, columns, is_complex, length = struct.unpack_from(order, first)
            name = first[20:20 + length]
            if 0 <= kind % 1000 <= 52 and 0 <= kind <= 1052 and min(rows, columns) > 0 and is_complex in (0, 1) and \
                    1 < length <= LONGEST_NAME and name.endswith(b"\0") and name[:-1].isalnum():
                return True
    return False


# ---- logs of autopilots


def _topic(name: str, instance: int) -> str:
    """A further instance of a topic is TOPIC.1, TOPIC.2, ..."""
    return f"{name}.{instance}" if instance else name


def _topics(wanted: Wanted) -> set[str] | None:
    """The topics of the channels that are asked for, without their instances; None: all."""
    return None if wanted is None else {each.rpartition("/")[0].partition(".")[0] for each in wanted}


def read_ulog(path: str, wanted: Wanted) -> Channels:
    """Topics of a PX4 log: TOPIC/FIELD, of a further instance TOPIC.1/FIELD."""
    import pyulog
    _walk_definitions(path)
    channels = Channels()
    topics = _topics(wanted)
    with contextlib.redirect_stdout(io.StringIO()):  # where it would talk of damage
        log = pyulog.ULog(path, None if topics is None else sorted(topics))
    if log.file_corruption:
        channels.notes.append(f"{path}: the file is damaged; what could be read is used")
    for data in log.data_list:
        for field, x in data.data.items():
            channels.take(f"{_topic(data.name, data.multi_id)}/{field}", x, wanted)
    channels.unread.update({name: NOT_ASKED for name in log.message_formats if topics and name not in topics})
    return channels


def _walk_definitions(path: str) -> None:
    """ValueError if the messages before the first of data are damaged, where the library would not end, or declare
    more than a message can hold."""
    formats: dict[bytes, list[bytes]] = {}
    with open(path, "rb") as file:
        file.seek(ULOG_HEADER)
        while len(head := file.read(3)) == 3 and head[2:] in ULOG_DEFINITIONS:
            size = int.from_bytes(head[:2], "little")
            body = file.read(size)
            if len(body) < size:
                break
            if head[2:] == b"F":
                name, _, fields = body.partition(b":")
                formats[name] = fields.split(b";")
        if len(head) == 3 and head[2:] not in ULOG_DATA:
            raise ValueError(f"damaged before byte {file.tell()}")
    known: dict[bytes, int] = {}
    for name in formats:
        if _declared(formats, name, known) > ULOG_LONGEST:
            raise ValueError(f"the format {name[:SAID]!r} is longer than a message can be")


def _declared(formats: dict[bytes, list[bytes]], name: bytes, known: dict[bytes, int]) -> int:
    """Numbers of one ULog format, whose fields are `TYPE[LENGTH] NAME`; RecursionError if it is in itself."""
    if name not in formats:
        return 1
    if name not in known:
        total = 0
        for field in formats[name]:
            kind, _, length = field.partition(b" ")[0].partition(b"[")
            length = length.rstrip(b"]")
            total += _declared(formats, kind, known) * (int(length) if length.isdigit() else 1)
        known[name] = total
    return known[name]


def read_dataflash(path: str, wanted: Wanted) -> Channels:
    """Messages of an ArduPilot log, binary or text: MESSAGE/FIELD, of a further instance MESSAGE.1/FIELD."""
    from pymavlink import DFReader
    with open(path, "rb") as file:
        kind = DFReader.DFReader_text if file.read(3) == b"FMT" else DFReader.DFReader_binary
    topics = _topics(wanted)
    columns: dict[str, list[Any]] = {}
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()), kind(path) as log:
        names = {each.name for each in log.formats.values()}
        asked = names if topics is None else names & topics
        while asked and (message := log.recv_match(type=sorted(asked), strict=True)) is not None:
            instance = getattr(message, message.fmt.instance_field or "", 0)
            topic = _topic(message.fmt.name, instance)
            for field in message.fmt.columns:
                if is_asked(f"{topic}/{field}", wanted):
                    columns.setdefault(f"{topic}/{field}", []).append(getattr(message, field))
    channels = Channels()
    for name, values in columns.items():
        channels.take(name, values, wanted)
    channels.unread.update({name: NOT_ASKED for name in names - asked})
    return channels


# ---- MCAP


def read_mcap(path: str, wanted: Wanted) -> Channels:
    """Topics of an MCAP file: TOPIC/FIELD.FIELD[k], with TOPIC/log_time in ns.  Those in JSON; in the encoding of ROS 2
    or protobuf if `mcap-ros2-support` or `mcap-protobuf-support` is installed; others are left out."""
    from mcap.reader import SeekingReader
    size = os.path.getsize(path)
    factories = _factories()
    channels = Channels()
    decoders: dict[int, Callable[[bytes], Any] | None] = {}
    topics: dict[str, _Topic] = {}
    with open(path, "rb") as file:
        _check_chunks(file, size)
        for schema, channel, message in SeekingReader(file, record_size_limit=size).iter_messages():
            topic = channel.topic.strip("/")
            if channel.id not in decoders:
                decoders[channel.id] = _decoder(factories, channel.message_encoding, schema)
                if not is_asked(topic, wanted):
                    channels.unread[topic] = NOT_ASKED
                elif decoders[channel.id] is None:
                    channels.unread[topic] = (f"is in the encoding {channel.message_encoding!r}; pip install "
                                              "mcap-ros2-support or mcap-protobuf-support for theirs")
            decode = decoders[channel.id]
            if decode is not None and topic not in channels.unread:
                topics.setdefault(topic, _Topic(f"{topic}/", wanted)).add(decode(message.data), message.log_time)
    for each in topics.values():
        each.give(channels)
    return channels


class _Topic:
    """The rows of one topic; of each field the rows that have it."""

    def __init__(self, prefix: str, wanted: Wanted) -> None:
        self.prefix, self.wanted, self.rows = prefix, wanted, 0
        self.fields: dict[str, tuple[list[int], list[float]]] = {}
        self.others: set[str] = set()

    def add(self, message: Any, log_time: int) -> None:
        for name, value in [*_fields("", message), (NANOSECONDS, log_time)]:
            if self.wanted is None or self.prefix + name in self.wanted:
                rows, values = self.fields.setdefault(name, ([], []))
                rows.append(self.rows)
                values.append(value)
            else:
                self.others.add(name)
        self.rows += 1
        if len(self.fields) + len(self.others) > MOST_FIELDS:
            raise ValueError(f"{self.prefix[:-1]} has more than {MOST_FIELDS} fields")

    def give(self, channels: Channels) -> None:
        channels.unread.update({self.prefix + name: NOT_ASKED for name in self.others})
        if self.rows * len(self.fields) > MOST_NUMBERS:
            raise ValueError(f"{self.prefix[:-1]} has {len(self.fields)} fields in {self.rows} messages")
        for name, (rows, values) in self.fields.items():
            column = np.array(values)
            if len(rows) < self.rows:
                column = np.full(self.rows, math.nan)
                column[rows] = values
            channels.take(self.prefix + name, column, self.wanted)


def _check_chunks(file: Any, size: int) -> None:
    """ValueError if a chunk declares more than a recorder writes: the library would ask for that memory."""
    import zstandard
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader
    for record in StreamReader(file, emit_chunks=True, record_size_limit=size).records:
        if not isinstance(record, Chunk):
            continue
        packed = zstandard.frame_content_size(record.data) if record.compression == "zstd" else -1
        if max(record.uncompressed_size, packed) > LARGEST_CHUNK:
            raise ValueError(f"a chunk of {len(record.data)} bytes declares {max(record.uncompressed_size, packed)}")
    file.seek(0)


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
        yield prefix, _fitting(value)
    elif isinstance(value, dict):
        for name, each in value.items():
            yield from _fields(f"{prefix}.{name}" if prefix else name, each)
    elif isinstance(value, (list, tuple)):
        for k, each in enumerate(value[:MOST_COLUMNS]):
            yield from _fields(f"{prefix}[{k}]", each)
    elif hasattr(value, "__slots__"):
        for name in value.__slots__:
            yield from _fields(f"{prefix}.{name}" if prefix else name, getattr(value, name, None))


def _fitting(value: float) -> float:
    """A number as it is, or, of an integer beyond 64 bits, the nearest float; NaN beyond those."""
    if isinstance(value, int) and not -1 << 63 <= value < 1 << 63:
        try:
            return float(value)
        except OverflowError:
            return math.nan
    return value


FORMATS: list[tuple[Callable[[bytes], bool], str, Callable[[str, Wanted], Channels]]] = [
    (lambda first: first.startswith(b"ULog\x01\x12\x35"), "ULog", read_ulog),
    (lambda first: first.startswith(b"\x89MCAP"), "MCAP", read_mcap),
    (lambda first: first.startswith(b"\x89HDF\r\n\x1a\n") or first[124:] in (b"\x00\x02IM", b"\x02\x00MI"), "HDF5",
     read_hdf5),
    (lambda first: first.startswith(b"PAR1"), "Parquet", read_parquet),
    (lambda first: first[124:] in (b"\x00\x01IM", b"\x01\x00MI") or _is_mat_4(first), "MAT", read_mat),
    (lambda first: first.startswith((b"\xa3\x95\x80", b"FMT, 128")), "ArduPilot DataFlash", read_dataflash)]


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
