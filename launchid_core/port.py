"""What a port to another language needs of an estimator: its memory by name, and the two kernels that it calls."""

from collections.abc import Callable
from typing import Any, NamedTuple

from . import checkpoint
from . import onboard as ob
from . import regression as rg
from .assembly import KINDS, Parts, allocate
from .config import Config


class Port(NamedTuple):
    """An estimator before its first sample.  Nothing is compiled for it.

    parts    its memory
    kinds    of each part: `fixed`, `state` or `work`
    update   kernel (fixed, state, work[, learner, learning, sigma, gauge], Sample) -> Status
    report   kernel (fixed, state, gauge, rep), filling the report; None for the formulations without one
    preface  what a saved state begins with; behind it the words of the parts that persist, least byte first, and the
             CRC-32 of all before (`Estimator.save`)
    saved_bytes  of a saved state
    """

    parts: Parts
    kinds: dict[str, str]
    update: Callable[..., Any]
    report: Callable[..., Any] | None
    preface: bytes
    saved_bytes: int


def port_of(config: Config) -> Port:
    """Memory and kernels of a configuration."""
    _, parts = allocate(config)
    saved = checkpoint.preface(config, parts), len(checkpoint.save(config, parts))
    if config.formulation == "filtered":
        return Port(parts, KINDS, ob.update_filtered, ob.report_now, *saved)
    update = rg.update_integral if config.formulation == "integral" else rg.update_pointwise
    return Port(parts, KINDS, update, None, *saved)
