"""Read logs of messages as channels TOPIC/FIELD: PX4's ULog, ArduPilot's DataFlash, MCAP of ROS and others."""

import contextlib
import io
import json
import math
import os
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from .text import MOST_COLUMNS, MOST_NUMBERS, NOT_ASKED, Channels, Wanted, is_asked

ULOG_HEADER = 16
ULOG_DEFINITIONS = tuple(bytes([kind]) for kind in b"BFIMPQ")
ULOG_DATA = tuple(bytes([kind]) for kind in b"ARDLCSO")
ULOG_LONGEST = 1 << 16    # bytes of a message, whose length has two
MOST_FIELDS = 10_000      # numbers of a message: a hundred times of what one has
LARGEST_CHUNK = 1 << 30   # bytes of an MCAP chunk, unpacked: recorders write megabytes
DATAFLASH_HEADER = 3      # bytes before a message
MOST_TALK = 200_000       # pieces of what a library says of damage, two a byte: 100 kB that are no log
DAMAGED = "{}: the file is damaged; what could be read is used"
NAME_BYTES = 40           # bytes of a damaged name


def _topic(name: str, instance: int) -> str:
    """Return the name of a topic, TOPIC.1, TOPIC.2, ... for its further instances."""
    return f"{name}.{instance}" if instance else name


def _topics(wanted: Wanted) -> set[str] | None:
    """Return the topics of the wanted channels, without their instances; None: all."""
    return None if wanted is None else {each.rpartition("/")[0].partition(".")[0] for each in wanted}


def read_ulog(path: str, wanted: Wanted) -> Channels:
    """Return the wanted channels of a PX4 log (ULog): TOPIC/FIELD, TOPIC.1/FIELD for a further instance."""
    import pyulog
    _walk_definitions(path)
    channels = Channels()
    topics = _topics(wanted)
    with contextlib.redirect_stdout(_Heard()):
        log = pyulog.ULog(path, None if topics is None else sorted(topics))
    if log.file_corruption:
        channels.notes.append(DAMAGED.format(path))
    for data in log.data_list:
        for field, x in data.data.items():
            channels.take(f"{_topic(data.name, data.multi_id)}/{field}", x, wanted)
    channels.unread.update({name: NOT_ASKED for name in log.message_formats if topics and name not in topics})
    return channels


def _walk_definitions(path: str) -> None:
    """Raise ValueError if the definitions ahead of a ULog's data are damaged (pyulog would not end) or too large."""
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
            raise ValueError(f"the format {name[:NAME_BYTES]!r} is longer than a message can be")


def _declared(formats: dict[bytes, list[bytes]], name: bytes, known: dict[bytes, int]) -> int:
    """Return how many numbers a ULog format has, whose fields are `TYPE[LENGTH] NAME`; RecursionError if it holds
    itself."""
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
    """Return the wanted channels of an ArduPilot log, binary or text: MESSAGE/FIELD, MESSAGE.1/FIELD (instances)."""
    from pymavlink import DFReader

    class Binary(DFReader.DFReader_binary):
        """Reader without the index in C, which writes to the terminal; that in Python writes to `sys.stderr`.  A format
        of no length, which would keep both for ever, is refused."""

        formats: dict[int, Any]

        def init_arrays_fast(self, progress_callback: None = None) -> None:
            self.formats = _Formats(self.formats)
            self.init_arrays(progress_callback)

    with open(path, "rb") as file:
        kind = DFReader.DFReader_text if file.read(3) == b"FMT" else Binary
    topics = _topics(wanted)
    columns: dict[str, list[Any]] = {}
    heard = _Heard()
    with contextlib.redirect_stdout(heard), contextlib.redirect_stderr(heard), kind(path) as log:
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
    channels.notes += [DAMAGED.format(path)] * heard.anything
    return channels


class _Formats(dict[int, Any]):
    """Formats of a DataFlash log by number; setting one that is shorter than its header raises ValueError."""

    def __setitem__(self, kind: int, form: Any) -> None:
        if form.len < DATAFLASH_HEADER:
            raise ValueError(f"messages of {form.len} bytes")
        super().__setitem__(kind, form)


class _Heard(io.TextIOBase):
    """A stream for what a library prints about damage: it notes whether there was any; ValueError if too much."""

    def __init__(self) -> None:
        self.times = 0

    @property
    def anything(self) -> bool:
        return self.times > 0

    def write(self, text: str) -> int:
        self.times += 1
        if self.times > MOST_TALK:
            raise ValueError("it is damaged in too many places")
        return len(text)


# ---- MCAP


def read_mcap(path: str, wanted: Wanted) -> Channels:
    """Return the wanted channels of an MCAP file: TOPIC/FIELD.FIELD[k], TOPIC/log_time [ns].  JSON is read always, ROS
    2 and protobuf with `mcap-ros2-support` or `mcap-protobuf-support`; other encodings are noted as unread."""
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
    """The messages of one topic as columns; a field that a message lacks is NaN in its row."""

    def __init__(self, prefix: str, wanted: Wanted) -> None:
        self.prefix, self.wanted, self.rows = prefix, wanted, 0
        self.fields: dict[str, tuple[list[int], list[float]]] = {}
        self.others: set[str] = set()

    def add(self, message: Any, log_time: int) -> None:
        for name, value in [*_fields("", message), ("log_time", log_time)]:
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
    """Raise ValueError if a chunk declares more bytes than a recorder writes: the library would allocate them."""
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
    """Return the function from a message's bytes to its fields; None if nothing here reads this encoding."""
    if encoding == "json":
        return json.loads
    return next((decode for factory in factories if (decode := factory.decoder_for(encoding, schema))), None)


def _factories() -> list[Any]:
    """Return the installed decoder factories, for encodings other than JSON."""
    factories: list[Any] = []
    try:
        from mcap_ros2.decoder import DecoderFactory as Ros2
        factories.append(Ros2())
    except ModuleNotFoundError:
        pass
    try:
        from mcap_protobuf.decoder import DecoderFactory as Protobuf
        factories.append(Protobuf())
    except ModuleNotFoundError:
        pass
    return factories


def _fields(prefix: str, value: Any) -> Iterator[tuple[str, float]]:
    """Yield (path, number) of all numbers in a decoded message."""
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
    """Return a number as it is; an integer beyond 64 bits as the nearest float, or NaN beyond the floats."""
    if isinstance(value, int) and not -1 << 63 <= value < 1 << 63:
        try:
            return float(value)
        except OverflowError:
            return math.nan
    return value
