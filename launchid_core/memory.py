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

from .kernels import shared


@shared
def take(buffer, at, n):
    """(n,) view"""
    return buffer[at:at + n], at + n


@shared
def take2(buffer, at, n, m):
    """(n, m) view"""
    return buffer[at:at + n * m].reshape((n, m)), at + n * m


@shared
def take3(buffer, at, n, m, k):
    """(n, m, k) view"""
    return buffer[at:at + n * m * k].reshape((n, m, k)), at + n * m * k


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
