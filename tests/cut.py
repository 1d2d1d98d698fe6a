"""Memory of an estimator before its first sample, for tests of single kernels.

Seals that fit a state which a test has changed by hand: else the estimator would begin anew.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from unjitted import unjitted

from launchid_core import Config, Estimator, Sample
from launchid_core.algebra.compress import first_state
from launchid_core.filter.filtered import filter_sample
from launchid_core.order import onboard
from launchid_core.order.memory import Memory, allocate, dtype_of, members
from launchid_core.order.table import FILTERED, MOMENTS, Struct, size_of
from launchid_core.regression import regression


class Cut(NamedTuple):
    """fixed, state, work: named tuples of views, as much as is in use; apart, memory: as `order.memory.Memory`."""

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
    return Cut(memory.parts.fixed, memory.parts.state, memory.parts.work, memory.given, memory)


def fed(estimator: Estimator, samples: Iterable[Sample]) -> Estimator:
    """The estimator after these samples."""
    for sample in samples:
        estimator.update(sample)
    return estimator


def take(cut: Cut, row: np.ndarray) -> None:
    """One sample into the filter."""
    state, apart = cut.state, cut.apart
    unjitted(filter_sample)(cut.fixed.belief, apart["profile"], apart["air"], apart["modes"], apart["known"],
                            apart["shown"], state.filter, cut.work.filter, state.acc, apart["rows"], state.check, row,
                            0.015)


def scratch(struct: Struct, terms: int) -> Any:
    """The arrays and numbers of a struct of the table, all zero, as much as an estimator of so many terms uses."""
    return members(struct, np.zeros(1, dtype_of(struct)), size_of(terms))


def moments(*numbers: float) -> Any:
    """What is believed of a6 and k1: means, variance of a6, covariance, variance of k1."""
    made = scratch(MOMENTS, 2)
    for to, number in zip(made, numbers, strict=True):
        to[...] = number
    return made


def copied(struct: Struct, given: Any) -> Any:
    """A copy of a struct's memory."""
    made = scratch(struct, 2)
    for to, of in zip(made, given, strict=True):
        to[...] = of
    return made


def persisting(estimator: Estimator) -> dict[str, np.ndarray]:
    """Everything that an estimator remembers from one sample to the next, by name."""
    return {name.removeprefix("state."): array for name, array in estimator._memory.state_arrays()}


def flip(array: np.ndarray, place: int, bit: int) -> None:
    """One bit of the array's number `place` becomes the other; the array may have gaps in memory."""
    at = np.unravel_index(place, array.shape)
    array.view(np.int64)[at] ^= np.uint64(1 << bit).astype(np.int64)


WORD = 2**64


def mixed(seal: int) -> int:
    """A step of xorshift64."""
    seal ^= seal << 13 & WORD - 1
    seal ^= seal >> 7
    return seal ^ (seal << 17 & WORD - 1)


def folded(*arrays: np.ndarray) -> int:
    """The seal of all words of these arrays, in whole numbers of Python."""
    words = np.concatenate([np.ascontiguousarray(x).view(np.int64).ravel() for x in arrays]).tolist()
    seal = 0
    for k, word in enumerate(words):
        seal = mixed(seal) if k % 64 == 0 else seal
        turned = (word % WORD) << k % 64
        seal ^= turned % WORD | turned // WORD
    return seal


def carried(memory) -> int:
    """The seal of what a memory carries on, as it stands in the guard."""
    seal = folded(memory.words)
    if memory.struct is FILTERED:
        inner = 0
        for row in memory.apart["rows"][:, :memory.parts.state.acc.counts.rows]:
            inner = mixed(inner) ^ folded(row)
        seal = mixed(seal) ^ inner
    return signed(seal)


def signed(seal: int) -> int:
    return seal - WORD if seal >= WORD // 2 else seal


def reseal(estimator: Estimator) -> None:
    memory, state = estimator._memory, estimator._memory.parts.state
    state.guard.control = signed(folded(*state.clock, *state.counts[:-1]))  # all but the answers
    state.guard.carried = carried(memory)
