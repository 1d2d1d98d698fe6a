"""The entries that an estimator needs, compiled before the first sample, and its three calls with their memory
given."""

import functools
import inspect
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numba
import numpy as np

from .. import cache
from ..algebra.compress import first_state
from ..config import Config
from ..regression import regression
from ..sample import Sample
from . import block, onboard
from .assembly import Memory, allocate
from .memory import dtype_of
from .table import FILTERED, Struct

_numba: Any = numba
NUMBER_TYPES = {**dict.fromkeys((*Sample._fields, "still"), _numba.float64),
                # of the entries' arguments; every other is an integer
                **dict.fromkeys(("stuck", "known"), _numba.boolean)}

FILTERED_ENTRIES = (
    onboard.push_sample, block.is_block_whole, block.gather, block.reduce_rows, block.estimate_undeclared_wind,
    block.track_block, block.detect_change, block.use_rows, block.end_block, onboard.look_at_sensors,
    onboard.solve_closed, onboard.begin_next_window, onboard.abandon_window, onboard.seal_block, onboard.drop_sample,
    onboard.restart_filtered, onboard.report_now)
STRUCTURE_ENTRIES = (block.learn_structure, onboard.choose_terms, onboard.limit_terms)
RANGE_ENTRIES = (onboard.follow_range,)
SERVO_ENTRIES = (block.set_servo_step, block.widen_check_by_servo, block.update_servo, block.relinearise_servo)
REGRESSION_ENTRIES = (regression.push_sample, regression.restart_regression)
SOLVER_ENTRIES = {"stls": regression.end_by_threshold, "sr3": regression.end_relaxed,
                  "ssr": regression.end_stepwise, "lasso": regression.end_by_lasso}


class Calls(NamedTuple):
    """An estimator's calls, with its memory.

    update   a sample's fields -> Status
    restart  forget every sample
    report   fill the report; None for the formulations without one
    """

    update: Callable[..., int]
    restart: Callable[[], None]
    report: Callable[[], None] | None


def entries_of(config: Config, memory: Memory) -> tuple[Any, ...]:
    """The entries that a configuration needs."""
    if memory.struct is FILTERED:
        return (FILTERED_ENTRIES + STRUCTURE_ENTRIES * memory.size.structured + RANGE_ENTRIES * memory.size.ranged
                + SERVO_ENTRIES * (memory.size.servo > 0))
    form = regression.open_integral if memory.size.integral else regression.open_pointwise
    relaxed = config.solver in ("sr3", "lasso")
    by_share = memory.size.by_share and not relaxed
    return (*REGRESSION_ENTRIES, form, regression.end_by_share if by_share else SOLVER_ENTRIES[config.solver])


@functools.cache
def block_type(struct: Struct) -> Any:
    """numba's type of an estimator's block, which it takes a tenth of a second to make."""
    return _numba.typeof(np.zeros(1, dtype_of(struct)))


@functools.cache
def parameters_of(function: Callable[..., Any]) -> tuple[str, ...]:
    """Names of the arguments."""
    return tuple(inspect.signature(function).parameters)


def compile_entries(entries: tuple[Any, ...], memory: Memory) -> None:
    """Compile the entries or load them from the cache, then refuse to compile in flight: an int is cast."""
    given = {"words": memory.words, **memory.apart}
    types = {"block": block_type(memory.struct), **{name: _numba.typeof(array) for name, array in given.items()}}
    with cache.alone:  # two estimators may be made in two threads
        for entry in entries:
            if not hasattr(entry, "py_func"):  # nothing is compiled
                continue
            kinds = tuple(types.get(name) or NUMBER_TYPES.get(name, _numba.int64)
                          for name in parameters_of(entry.py_func))
            if kinds not in entry.signatures:
                entry.disable_compile(False)
                entry.compile(kinds)
                entry.disable_compile(True)


def precompile(config: Config, backwards: bool = False) -> bool:
    """Compile what an `Estimator` of this configuration needs; return whether it can be kept on disk, else do nothing.

    Two processes, one of which goes backwards, compile half of it each: what the other has kept is loaded.

    Example
    -------
    >>> precompile(Config(formulation="difference"))
    """
    is_kept = cache.folder_of(__name__) is not None
    if is_kept:
        memory = allocate(config)
        compile_entries(entries_of(config, memory)[::-1 if backwards else 1], memory)
    return is_kept


def calls_of(config: Config, memory: Memory) -> Calls:
    """The calls of an estimator with this memory, compiled."""
    compile_entries(entries_of(config, memory), memory)
    seen, words, apart = memory.seen, memory.words, memory.apart
    report = None
    if memory.struct is FILTERED:
        update: Callable[..., int] = onboard.update_filtered
        begin = partial(onboard.restart_filtered, seen, apart["rows"], words)
        report = partial(onboard.report_now, seen, apart["profile"], apart["air"])
    else:
        update = regression.update_regression
        begin = partial(regression.restart_regression, seen, words, first_state(config.seed))

    def restart() -> None:
        words[:] = 0  # a flipped bit beyond the extents in use, too
        for _, array in memory.state_arrays():
            array[...] = 0
        begin()

    return Calls(partial(update, memory.size, seen, words, *apart.values()), restart, report)
