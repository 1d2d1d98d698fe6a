"""The memory that an estimator's table describes: the structured type of its block, views by name, what is sealed."""

import math
from collections import namedtuple
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np

from .table import CARRIED_FROM, I8, LARGEST_SIZE, STATE, Extent, Grown, Size, Struct


def extents(shape: tuple[Extent, ...], size: Size | Grown) -> tuple[int, ...]:
    """Shape of an array, as much of it as is in use."""
    def of(extent: Extent) -> int:
        if isinstance(extent, tuple):
            return math.prod(of(each) for each in extent)
        return extent if isinstance(extent, int) else int(getattr(size, extent))

    return tuple(of(each) for each in shape)


@cache
def dtype_of(struct: Struct) -> "np.dtype[Any]":
    """The structured type of a struct, with the extents of LARGEST_SIZE."""
    return np.dtype([(line.name, dtype_of(line.kind), ()) if isinstance(line.kind, Struct)
                     else (line.name, line.kind, extents(line.shape, LARGEST_SIZE)) for line in struct.lines],
                     align=True)


def carried_words(struct: Struct, block: np.ndarray) -> np.ndarray:
    """View of the words of an estimator's block that are carried on, and sealed, as int64."""
    whole, state = dtype_of(struct), dtype_of(struct)[STATE]
    begin = whole.fields[STATE][1]  # type: ignore[index]
    first = begin + state.fields[CARRIED_FROM[struct.name]][1]  # type: ignore[index]
    return block.view(np.int64)[first // I8.itemsize:(begin + state.itemsize) // I8.itemsize]


@cache
def members_of(struct: Struct) -> type[tuple[Any, ...]]:
    """The named tuple of a struct's arrays and structs."""
    made: type[tuple[Any, ...]] = namedtuple(struct.name, [line.name for line in struct.lines])  # type: ignore[misc]
    made.__doc__ = struct.about
    return made


def members(struct: Struct, block: np.ndarray, size: Size | None = None) -> Any:
    """Views of a block (1,) by their names: whole arrays, or with a size as much as is in use.

    Numbers of `Size` are integers; everything else is a view, in which Python reads and writes the same memory.
    """
    values: list[Any] = []
    for line in struct.lines:
        part = block[line.name]
        if isinstance(line.kind, Struct):
            values.append(members(line.kind, part, size))
        elif not line.shape:
            values.append(int(part[0]))
        else:
            values.append(part[0] if size is None else part[0][tuple(slice(n) for n in extents(line.shape, size))])
    return members_of(struct)(*values)


def named_arrays(value: Any, prefix: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Every array of a nest of named tuples, by its dotted name."""
    if isinstance(value, np.ndarray):
        yield prefix, value
    elif isinstance(value, tuple):
        for name, each in zip(value._fields, value, strict=True):  # type: ignore[attr-defined]
            yield from named_arrays(each, f"{prefix}.{name}" if prefix else name)
