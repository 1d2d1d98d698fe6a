"""An estimator's state as bytes, to go on from after a restart: versioned, checked, of one configuration; no pickle.

    header   MAGIC, CHECKPOINT_FORMAT, number of choices, version of the package, layout of the state, number of words
    choices  a digest of each field of the configuration, so that one that differs is named
    words    the state's arrays, one after the other: float64 or int64, little endian
    end      CRC-32 of everything before, which sees every flipped bit and every burst of up to 32

What is refused says why in a ValueError, and nothing has been restored then.
"""

import dataclasses
import hashlib
import struct
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np

from .config import Config
from .gate.guard import GROUP
from .order.memory import Memory
from .order.table import FILTERED
from .version import VERSION

MAGIC = b"launchid"
CHECKPOINT_FORMAT = 2
HEADER = struct.Struct("<8sHH16s16sQ")
END = struct.Struct("<I")
DIGEST = 8      # bytes of a choice's digest: two that differ are taken for equal once in 2^64
WORD = 8        # bytes
CARRIED = "state.guard.carried"


def _choices(value: Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Every field of a configuration and of its model, by its dotted name, in words that keep every bit."""
    for field in dataclasses.fields(value):
        chosen = getattr(value, field.name)
        if dataclasses.is_dataclass(chosen):
            yield from _choices(chosen, f"{prefix}{field.name}.")
        else:  # a library may be given by its name or term by term
            yield prefix + field.name, repr(value.terms if field.name == "library" else chosen)


def _digests(config: Config) -> dict[str, bytes]:
    return {name: hashlib.blake2b(f"{name}={words}".encode(), digest_size=DIGEST).digest()
            for name, words in _choices(config)}


def _layout(arrays: list[tuple[str, np.ndarray]]) -> bytes:
    """A digest of names, types and shapes: what the words mean to this version of the package."""
    words = repr([(name, array.dtype.str, array.shape) for name, array in arrays])
    return hashlib.blake2b(words.encode(), digest_size=16).digest()


def preface(config: Config, memory: Memory) -> bytes:
    """Header and choices: the same bytes in every saved state of this configuration, whatever the language."""
    arrays = memory.state_arrays()
    digests = b"".join(_digests(config).values())
    size = sum(array.size for _, array in arrays)
    return HEADER.pack(MAGIC, CHECKPOINT_FORMAT, len(digests) // DIGEST, VERSION.encode(), _layout(arrays),
                       size) + digests


def save(config: Config, memory: Memory) -> bytes:
    """Return the state of an estimator with this configuration as bytes."""
    arrays = dict(memory.state_arrays())
    # what the seal is off, 0 but in damaged memory: the seal itself depends on the extents of records
    arrays[CARRIED] = arrays[CARRIED] ^ seal_of(memory)
    words = b"".join(array.astype(array.dtype.newbyteorder("<")).tobytes() for array in arrays.values())
    whole = preface(config, memory) + words
    return whole + END.pack(zlib.crc32(whole))


def restore(config: Config, memory: Memory, saved: bytes) -> None:
    """Overwrite the state with what `save` gave for the same configuration; ValueError says what is wrong with it."""
    saved, arrays = bytes(saved), memory.state_arrays()
    at = _check(config, arrays, saved)
    memory.words[:] = 0  # a flipped bit beyond the extents in use, too
    for _, array in arrays:
        kind = array.dtype.newbyteorder("<")
        array[...] = np.frombuffer(saved, kind, array.size, at).reshape(array.shape)
        at += WORD * array.size
    memory.parts.state.guard.carried ^= seal_of(memory)


def seal_of(memory: Memory) -> np.int64:
    """Compute the seal of the persistent arrays by numpy, equal to the kernels' (`onboard.seal_carried`)."""
    seal = _folded(memory.words)
    if memory.struct is FILTERED:
        inner = np.uint64(0)
        for row in memory.apart["rows"][:, :max(memory.parts.state.acc.counts.rows, 0)]:
            inner = _mixed(inner) ^ _folded(row)
        seal = _mixed(seal) ^ inner
    return seal.view(np.int64)


def _folded(words: np.ndarray) -> np.uint64:
    """`guard.fold` and `guard.fold_words`."""
    bits, seal = np.ascontiguousarray(words).view(np.uint64), np.uint64(0)
    turn = np.arange(bits.size, dtype=np.uint64) % np.uint64(GROUP)
    turned = (bits << turn) | (bits >> ((np.uint64(GROUP) - turn) % np.uint64(GROUP)))
    for begin in range(0, bits.size, GROUP):
        seal = _mixed(seal) ^ np.bitwise_xor.reduce(turned[begin:begin + GROUP])
    return seal


def _mixed(seal: np.uint64) -> np.uint64:
    """`guard.mixed`."""
    seal ^= seal << np.uint64(13)
    seal ^= seal >> np.uint64(7)
    return seal ^ (seal << np.uint64(17))


def _check(config: Config, arrays: list[tuple[str, np.ndarray]], saved: bytes) -> int:
    """The byte at which the words begin; ValueError for anything that `save` did not give for this configuration."""
    if len(saved) < HEADER.size or not saved.startswith(MAGIC):
        raise ValueError(f"saved state: {len(saved)} bytes that do not begin as a saved estimator does")
    _, number, fields, version, layout, size = HEADER.unpack_from(saved)
    if number != CHECKPOINT_FORMAT:
        raise ValueError(f"saved state: format {number}, expected {CHECKPOINT_FORMAT}")
    words: int = HEADER.size + fields * DIGEST
    expected = words + size * WORD + END.size
    if len(saved) != expected:
        raise ValueError(f"saved state: {len(saved)} bytes, expected {expected}: it is not whole")
    if zlib.crc32(saved[:-END.size]) != END.unpack_from(saved, expected - END.size)[0]:
        raise ValueError("saved state: its checksum does not fit: it was damaged")
    written = version.rstrip(b"\0").decode("ascii", "replace")
    if written != VERSION:
        raise ValueError(f"saved state: of launchid {written}, expected {VERSION}")
    for k, (name, digest) in enumerate(_digests(config).items()):
        at = HEADER.size + k * DIGEST
        if k >= fields or saved[at:at + DIGEST] != digest:
            raise ValueError(f"saved state: of a configuration with another {name}")
    if layout != _layout(arrays):
        raise ValueError("saved state: its layout is another build's")
    return words
