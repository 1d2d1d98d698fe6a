"""One block of memory for an estimator, cut into named arrays.

A call from Python into compiled code costs 0.2 microseconds an array, and an estimator has up to a hundred of them.
They are therefore views of two flat buffers, floats and integers, cut by the same function on both sides of the call.
What never changes in flight (`Fixed`), what persists between samples (`State`) and what is meaningless between calls
(`Work`) follow one another in both buffers; a C port makes them structs of their own.

Each `take` returns the view at `at` and where the next one begins.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numba import extending
from numba.core import cgutils, types

from .kernels import inner, shared
from .parts import stand_in

_extending: Any = extending  # typed by numba only in part


@_extending.intrinsic
def _piece(typing, buffer, at, shape):
    """Array of this shape from `at` on; numba's own slices compile ten times as long."""
    from numba.np.arrayobj import populate_array  # here: numba takes 50 ms for it, which an import need not wait for

    made = types.Array(buffer.dtype, len(shape), "C")

    def build(context, builder, signature, arguments):
        whole = context.make_array(signature.args[0])(context, builder, arguments[0])
        first = builder.gep(whole.data, [arguments[1]])
        extents = cgutils.unpack_tuple(builder, arguments[2])
        size = context.get_abi_sizeof(context.get_data_type(made.dtype))
        itemsize = context.get_constant(types.intp, size)
        strides = [itemsize]
        for extent in extents[:0:-1]:
            strides.insert(0, builder.mul(strides[0], extent))
        array = context.make_array(made)(context, builder)
        populate_array(array, data=first, shape=extents, strides=strides, itemsize=itemsize, meminfo=None)
        return array._getvalue()

    return made(buffer, at, shape), build


QUAD = 4  # doubles, of the vectors in which `lanes` are compiled


def quads_of(n):
    """Zeros (n,) whose first begins a whole four in memory."""
    buffer = np.zeros(n + QUAD)
    begin = (-buffer.ctypes.data // buffer.itemsize) % QUAD
    return buffer[begin:begin + n]


@shared
def at_quad(at):
    """Where the next whole four begins: columns that reflections run along are read fastest from there on."""
    return at + QUAD - 1 - (at + QUAD - 1) % QUAD


def take(buffer, at, n):
    """(n,) view"""
    return buffer[at:at + n], at + n


def take2(buffer, at, n, m):
    """(n, m) view"""
    return buffer[at:at + n * m].reshape((n, m)), at + n * m


def take3(buffer, at, n, m, k):
    """(n, m, k) view"""
    return buffer[at:at + n * m * k].reshape((n, m, k)), at + n * m * k


@inner
def _take(buffer, at, n):
    return _piece(buffer, at, (n,)), at + n


@inner
def _take2(buffer, at, n, m):
    return _piece(buffer, at, (n, m)), at + n * m


@inner
def _take3(buffer, at, n, m, k):
    return _piece(buffer, at, (n, m, k)), at + n * m * k


stand_in(take, _take)
stand_in(take2, _take2)
stand_in(take3, _take3)


class Block(NamedTuple):
    """The buffers as they cross into compiled code; integers begin with the sizes that the cuts need."""

    floats: np.ndarray
    integers: np.ndarray


def named_arrays(value: Any, prefix: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Every array of a nest of named tuples, by its dotted name."""
    if isinstance(value, np.ndarray):
        yield prefix, value
    elif isinstance(value, tuple):
        for name, each in zip(value._fields, value, strict=True):  # type: ignore[attr-defined]
            yield from named_arrays(each, f"{prefix}.{name}" if prefix else name)
