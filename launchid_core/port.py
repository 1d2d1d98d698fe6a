"""The parts of an estimator that a port to another language needs: its memory by name, and the functions that it
calls."""

from collections.abc import Callable
from typing import Any, NamedTuple

from . import checkpoint
from .config import Config
from .order import onboard
from .order.assembly import Memory, allocate
from .order.block import seal_carried
from .order.entries import calls_of
from .order.table import CARRIED_FROM, FILTERED, SEPARATE_ARRAYS
from .regression import regression


class Port(NamedTuple):
    """An estimator before its first sample.

    memory   its arrays by name (`parts`, `apart`) and the table that they come from
    apart    of each array that stands apart, its part: `fixed`, `state` or `work`
    carried  first line of the state that is sealed, with all after it
    update   function of the memory and a Sample -> Status
    report   function of the memory, filling the report; None for the formulations without one
    seal     function of state, its words and rows -> seal of what is carried on; None where it is `guard.fold_words`
    preface  what a saved state begins with; behind it the words of what persists, least byte first, and the CRC-32 of
             all before (`Estimator.save`)
    saved_bytes  of a saved state
    """

    memory: Memory
    apart: dict[str, str]
    carried: str
    update: Callable[..., Any]
    report: Callable[..., Any] | None
    seal: Callable[..., Any] | None
    preface: bytes
    saved_bytes: int


def port_of(config: Config) -> Port:
    """Memory and functions of a configuration."""
    memory = allocate(config)
    calls_of(config, memory).restart()
    saved = checkpoint.preface(config, memory), len(checkpoint.save(config, memory))
    apart, carried = {name: part for name, part,
                      *_ in SEPARATE_ARRAYS[memory.struct.name]}, CARRIED_FROM[memory.struct.name]
    if memory.struct is FILTERED:
        return Port(memory, apart, carried, onboard.update_filtered, onboard.report_now, seal_carried, *saved)
    return Port(memory, apart, carried, regression.update_regression, None, None, *saved)
