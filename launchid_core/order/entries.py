"""The entries that an estimator needs, compiled before the first sample; its three calls, with their memory given."""

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
from ..filter import filtered, modes, servo, structure
from ..gate import ring as rb
from ..regression import regression
from ..sample import Sample
from ..watch import undeclared
from . import onboard
from .memory import Memory, allocate, dtype_of
from .table import FILTERED, Struct

_numba: Any = numba
NUMBERS = (*Sample._fields, "still")  # arguments of the entries that are floats; every other number is an integer

FILTERED_ENTRIES = (
    onboard.push_sample, onboard.check_block, onboard.gather, filtered.reduce_rows, undeclared.follow_undeclared,
    onboard.track_block, onboard.detect_change, onboard.use_rows, onboard.end_block, onboard.solve_closed,
    onboard.begin_next_window, onboard.abandon_window, onboard.seal_block, onboard.restart_filtered, onboard.report_now)
STRUCTURE_ENTRIES = (structure.learn_structure, structure.choose_terms, filtered.limit_terms)
RANGE_ENTRIES = (onboard.follow_range,)
MODE_ENTRIES = (modes.set_modes, modes.relinearise_modes)
NUMBER_ENTRIES = (modes.widen_mode_check, filtered.update_numbers, modes.open_rigid)
SERVO_ENTRIES = (servo.set_servo_step, servo.widen_check, filtered.update_servo, servo.relinearise_servo)
REGRESSION_ENTRIES = (regression.push_sample, regression.open_window, regression.end_window,
                      regression.restart_regression)


class Calls(NamedTuple):
    """An estimator's calls, with its memory."""

    update: Callable[..., int]         # a sample's fields -> Status
    restart: Callable[[], None]        # forget every sample
    report: Callable[[], None] | None  # fill the report; None for the formulations without one


def entries_of(config: Config, memory: Memory) -> tuple[Any, ...]:
    """The entries that a configuration needs."""
    if memory.struct is FILTERED:
        return (FILTERED_ENTRIES + STRUCTURE_ENTRIES * memory.size.structured + RANGE_ENTRIES * memory.size.ranged
                + SERVO_ENTRIES * (memory.size.servo > 0) + MODE_ENTRIES * (memory.size.modes > 0)
                + NUMBER_ENTRIES * (memory.size.numbers > 0))
    return *REGRESSION_ENTRIES, regression.relax if config.solver in ("sr3", "lasso") else regression.eliminate


@functools.cache
def block_type(struct: Struct, with_modes: bool) -> Any:
    """numba's type of an estimator's block, which it takes a tenth of a second to make."""
    return _numba.typeof(np.zeros(1, dtype_of(struct, with_modes)))


def compile_entries(entries: tuple[Any, ...], memory: Memory) -> None:
    """Compile the entries or load them from the cache, then refuse to compile in flight: an int is cast."""
    given = {"words": memory.words, **memory.given}
    types = {"block": block_type(memory.struct, memory.size.modes > 0),
             **{name: _numba.typeof(array) for name, array in given.items()}}
    with cache.alone:  # two estimators may be made in two threads
        for entry in entries:
            if not hasattr(entry, "py_func"):  # nothing is compiled
                continue
            kinds = tuple(types.get(name) or (_numba.float64 if name in NUMBERS else _numba.int64)
                          for name in inspect.signature(entry.py_func).parameters)
            if kinds not in entry.signatures:
                entry.disable_compile(False)
                entry.compile(kinds)
                entry.disable_compile(True)


def precompile(config: Config, backwards: bool = False) -> bool:
    """Compile what an `Estimator` of this configuration needs; return whether it can be kept on disk, else do nothing.

    Two processes, one of which goes backwards, compile half of it each: what the other has kept is loaded.
    """
    is_kept = cache.folder_of(__name__) is not None
    if is_kept:
        memory = allocate(config)
        compile_entries(entries_of(config, memory)[::-1 if backwards else 1], memory)
    return is_kept


def calls_of(config: Config, memory: Memory) -> Calls:
    """The calls of an estimator with this memory, compiled."""
    compile_entries(entries_of(config, memory), memory)
    seen, words, apart = memory.seen, memory.words, memory.given
    report = None
    if memory.struct is FILTERED:
        update: Callable[..., int] = onboard.update_filtered
        begin = partial(onboard.restart_filtered, seen, apart["rows"], words)
        report = partial(onboard.report_now, seen, apart["profile"], apart["air"], apart["modes"])
    else:
        update = regression.update_regression
        begin = partial(regression.restart_regression, seen, words, first_state(config.seed))

    def restart() -> None:
        words[:] = 0  # a flipped bit beyond the extents in use, too
        for _, array in memory.state_arrays():
            array[...] = 0
        begin()

    return Calls(partial(update, memory.size, seen, words, *apart.values()), restart, report)


def table_of(samples: Any) -> np.ndarray:
    """Samples as (n, 7) float64, the fields of `Sample` in their order; ValueError for another shape."""
    table = np.ascontiguousarray(samples if isinstance(samples, np.ndarray) else list(samples), np.float64)
    if table.size == 0:
        return np.zeros((0, rb.N_COLUMNS))
    if table.ndim != 2 or table.shape[1] != rb.N_COLUMNS:
        raise ValueError(f"samples of shape {table.shape}: expected (n, {rb.N_COLUMNS}), the fields of Sample: "
                         f"{', '.join(Sample._fields)}")
    return table


def loop_of(memory: Memory) -> Callable[[np.ndarray, int], tuple[int, int]]:
    """The loop of an estimator over samples, for whole logs: with the kernels and the arguments of `update`, so the
    same bits.  It takes rows of a table from a row on; returns the row after the last taken, and WINDOW_COMPLETE or
    RECOVERED where that one answered so, else ACCEPTED.
    """
    seen, apart = memory.seen, memory.given
    if memory.struct is FILTERED:
        push = partial(onboard.push_until_due, seen, apart["ring"], apart["seals"], apart["rows"])
        close: Callable[..., int] = onboard.process_samples
    else:
        push = partial(regression.push_until_due, seen, apart["ring"], apart["seals"])
        close = regression.close_window

    def take(table: np.ndarray, at: int) -> tuple[int, int]:
        while at < len(table):
            at, code = push(table, at)
            if code >= rb.DUE:
                code = close(memory.size, seen, memory.words, *apart.values(), code - rb.DUE)
            if code in (rb.WINDOW_COMPLETE, rb.RECOVERED):
                return at, code
        return at, rb.ACCEPTED

    return take
