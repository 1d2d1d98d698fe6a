"""Seals that fit a state which a test has changed by hand: else the estimator would begin anew."""

import numpy as np

from launchid_core import Estimator
from launchid_core.gate import guard
from launchid_core.gate import ring as rb
from launchid_core.order.table import FILTERED

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
        for row in memory.apart["rows"][:, :memory.parts.state.acc.counts[0]]:
            inner = mixed(inner) ^ folded(row)
        seal = mixed(seal) ^ inner
    return signed(seal)


def signed(seal: int) -> int:
    return seal - WORD if seal >= WORD // 2 else seal


def reseal(estimator: Estimator) -> None:
    memory, state = estimator._memory, estimator._memory.parts.state
    state.guard[guard.CONTROL] = signed(folded(state.clock, state.counts[:rb.COUNT_FIRST]))
    state.guard[guard.CARRIED] = carried(memory)
