"""What a port to another language needs of an estimator before its first sample."""

from collections.abc import Callable
from typing import Any, NamedTuple

from . import checkpoint
from .config import Config
from .order import onboard
from .order.entries import calls_of
from .order.memory import Memory, allocate
from .order.table import CARRIED_FROM, FILTERED, SEPARATE_ARRAYS
from .regression import regression


class Port(NamedTuple):
    """An estimator before its first sample, for a port to another language."""

    memory: Memory              # its arrays by name (`parts`, `apart`) and the table that they come from
    apart: dict[str, str]       # of each array that stands apart, its part: `fixed`, `state` or `work`
    carried: str                # first line of the state that is sealed, with all after it
    update: Callable[..., Any]  # of the memory and a Sample -> Status
    report: Callable[..., Any] | None  # of the memory, fills the report; None for the formulations without one
    seal: Callable[..., Any] | None  # of state, its words and rows -> seal of what is carried on; None: `fold_words`
    preface: bytes              # of a saved state; then the words of what persists, least byte first, and the CRC-32
    saved_bytes: int            # of a saved state


def port_of(config: Config) -> Port:
    """Memory and functions of a configuration."""
    memory = allocate(config)
    calls_of(config, memory).restart()
    saved = checkpoint.preface(config, memory), len(checkpoint.save(config, memory))
    name = memory.struct.name
    apart, carried = {line[0]: line[1] for line in SEPARATE_ARRAYS[name]}, CARRIED_FROM[name]
    if memory.struct is FILTERED:
        return Port(memory, apart, carried, onboard.update_filtered, onboard.report_now, onboard.seal_carried, *saved)
    return Port(memory, apart, carried, regression.update_regression, None, None, *saved)
