"""The form in which a file's readers hand over its content: channels, what is no channel and why; limits of sizes.

What a file declares (rows, columns, bytes) is compared with the file's own size before anything is read.
"""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

MOST_COLUMNS = 64      # of a two-dimensional array: a longer side is time
MOST_NUMBERS = 1 << 28  # of one array: three days at 1 kHz, 2 GB
EXPANSION = 1032       # bytes of numbers a byte of the file: the most that deflate packs
NOT_ASKED = "not asked for"
Wanted = frozenset[str] | None   # names of channels; None: all


class Channels(dict[str, np.ndarray]):
    """Name -> (n,).

    unread  name -> why what has this name in the file is no channel
    notes   one line each: what was damaged or left out on the way
    """

    def __init__(self, values: Iterable[tuple[str, np.ndarray]] = ()) -> None:
        super().__init__(values)
        self.unread: dict[str, str] = {}
        self.notes: list[str] = []

    def take(self, name: str, values: Any, wanted: Wanted) -> None:
        """One array: itself, or its columns, as far as they are asked for; a reason if it is no channel."""
        array = np.asarray(values)
        if reason := _no_channel(array):
            self.unread[name] = reason
            return
        for each, column in _columns(name, array):
            if wanted is None or each in wanted:
                self[each] = column
            else:
                self.unread[each] = NOT_ASKED


def _no_channel(array: np.ndarray) -> str:
    """The reason why an array is no channel; "" if it is one."""
    if array.dtype.kind not in "biufmM":
        return "holds no numbers"
    if array.size < 2:
        return "has one row" if array.size else "is empty"
    return f"has {array.ndim} dimensions" if array.ndim > 2 and 1 not in array.shape else ""


def _columns(name: str, array: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """A channel, or NAME[0], NAME[1], ...; a date is numpy's, in nanoseconds, a duration an integer."""
    if array.dtype.kind == "M":
        array = array.astype("M8[ns]")
    elif array.dtype.kind == "m":
        array = array.astype(np.int64)
    array = np.squeeze(array)
    if array.ndim == 1:
        yield name, array
    elif array.ndim == 2:
        tall = array if array.shape[1] <= MOST_COLUMNS or array.shape[0] > array.shape[1] else array.T
        for k in range(tall.shape[1]):
            yield f"{name}[{k}]", tall[:, k]


def is_asked(name: str, wanted: Wanted) -> bool:
    """Whether a channel of this name is wanted, or one inside the array or the group of this name."""
    return wanted is None or any(each == name or each.startswith((f"{name}[", f"{name}/", f"{name}."))
                                 for each in wanted)


def too_large(numbers: int, itemsize: int, file_size: int) -> str:
    """The reason why so many declared numbers of a file are not read; "" if they are."""
    if numbers * itemsize > EXPANSION * file_size:
        return f"declares {numbers:.4g} numbers, which a file of {file_size:.4g} bytes cannot hold"
    if numbers > MOST_NUMBERS:
        return f"declares {numbers:.4g} numbers; expected at most {MOST_NUMBERS:.4g}"
    return ""
