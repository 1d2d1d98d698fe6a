"""Files of other programs, written for the tests: a ULog by its specification, an MCAP by its library."""

import json
import struct
from pathlib import Path

import numpy as np

Topics = dict[str, dict[str, np.ndarray]]   # topic -> field -> (n,); an array field is (n, k)
TYPES = {"u": "uint64_t", "f": "double"}


def write_ulog(path: Path, topics: Topics) -> None:
    """docs.px4.io/main/en/dev_log/ulog_file_format: header, flags, formats, subscriptions, data in order of time."""
    def message(kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0), message("B", bytes(40))]
    rows = []
    for number, (topic, fields) in enumerate(topics.items()):
        words = [f"{TYPES[x.dtype.kind]}{f'[{x.shape[1]}]' if x.ndim == 2 else ''} {name}"
                 for name, x in fields.items()]
        parts.append(message("F", f"{topic}:{';'.join(words)};".encode()))
        for k, stamp in enumerate(fields["timestamp"]):
            data = b"".join(np.atleast_1d(x[k]).astype(x.dtype.newbyteorder("<")).tobytes() for x in fields.values())
            rows.append((int(stamp), message("D", struct.pack("<H", number) + data)))
    parts += [message("A", struct.pack("<BH", 0, number) + topic.encode()) for number, topic in enumerate(topics)]
    path.write_bytes(b"".join(parts) + b"".join(row for _, row in sorted(rows, key=lambda row: row[0])))


def write_mcap(path: Path, topics: Topics) -> None:
    """One JSON message a row; `timestamp` is its time [ns]."""
    from mcap.writer import Writer
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema(name="any", encoding="jsonschema", data=b'{"type": "object"}')
        for topic, fields in topics.items():
            channel = writer.register_channel(topic=f"/{topic}", message_encoding="json", schema_id=schema)
            for k, stamp in enumerate(fields["timestamp"]):
                data = {name: x[k].tolist() for name, x in fields.items() if name != "timestamp"}
                writer.add_message(channel_id=channel, log_time=int(stamp), publish_time=int(stamp),
                                   data=json.dumps({"motion": data}).encode())
        writer.finish()
