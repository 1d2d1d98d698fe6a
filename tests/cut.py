"""Memory of an estimator before its first sample, for tests of single kernels."""

from typing import Any, NamedTuple

import numpy as np

from launchid_core import Config, Estimator
from launchid_core.algebra.compress import first_state
from launchid_core.order import onboard
from launchid_core.order.assembly import Memory, allocate
from launchid_core.order.memory import dtype_of, members
from launchid_core.order.table import FILTERED, Struct, size_of
from launchid_core.regression import regression


class Cut(NamedTuple):
    """fixed, state, work: named tuples of views, as much as is in use; apart, memory: as `assembly.Memory`."""

    fixed: Any
    state: Any
    work: Any
    apart: dict[str, Any]
    memory: Memory


def cut_of(config: Config) -> Cut:
    """The memory of a configuration, as it is before the first sample."""
    memory = allocate(config)
    if memory.struct is FILTERED:
        onboard.restart_filtered(memory.seen, memory.apart["rows"], memory.words)
    else:
        regression.restart_regression(memory.seen, memory.words, first_state(config.seed))
    return Cut(memory.parts.fixed, memory.parts.state, memory.parts.work, memory.apart, memory)


def scratch(struct: Struct, terms: int) -> Any:
    """The arrays of a struct of the table, all zero, as much as an estimator of so many terms uses."""
    return members(struct, np.zeros(1, dtype_of(struct)), size_of(terms))


def persisting(estimator: Estimator) -> dict[str, np.ndarray]:
    """Everything that an estimator remembers from one sample to the next, by name."""
    return {name.removeprefix("state."): array for name, array in estimator._memory.state_arrays()}


def flip(array: np.ndarray, place: int, bit: int) -> None:
    """One bit of the array's number `place` becomes the other; the array may have gaps in memory."""
    at = np.unravel_index(place, array.shape)
    array.view(np.int64)[at] ^= np.uint64(1 << bit).astype(np.int64)
