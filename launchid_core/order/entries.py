"""Which entries an estimator needs, compiled before the first sample, and its three calls with their memory given."""

import inspect
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numba

from .. import cache
from ..algebra.compress import first_state
from ..config import Config
from ..regression import equations, regression
from ..sample import Sample
from . import block, onboard
from .assembly import Memory
from .table import FILTERED

_numba: Any = numba
NUMBERS = {**dict.fromkeys((*Sample._fields, "still"), _numba.float64),
           **dict.fromkeys(("stuck", "known"), _numba.boolean)}  # of the entries' arguments; every other is an integer

FILTERED_ENTRIES = (
    onboard.push_sample, block.is_block_whole, block.gather, block.reduce_rows, block.follow_wind,
    block.track_block, block.detect_change, block.use_rows, block.end_block, onboard.look_at_sensors,
    onboard.solve_closed, onboard.end_window, onboard.abandon_window, onboard.seal_block, onboard.drop_sample,
    onboard.restart_filtered, onboard.report_now)
STRUCTURE_ENTRIES = (block.learn_structure, onboard.choose_terms, onboard.limit_terms)
RANGE_ENTRIES = (onboard.follow_range,)
SERVO_ENTRIES = (block.set_servo, block.doubt_servo, block.weigh_servo, block.follow_servo)
REGRESSION_ENTRIES = (
    regression.push_sample, regression.open_window, equations.factor_library, equations.keep_equation,
    equations.solve_with_drifts, equations.solve_without_absent, equations.report_deviations,
    equations.report_limits, regression.end_window, regression.restart_regression)
SOLVER_ENTRIES = {"stls": equations.choose_by_threshold, "sr3": equations.choose_relaxed,
                  "ssr": equations.choose_stepwise, "lasso": equations.choose_by_lasso}


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
    form = regression.fill_integral if memory.size.integral else regression.fill_pointwise
    relaxed = config.solver in ("sr3", "lasso")
    by_share = memory.size.by_share and not relaxed
    return (*REGRESSION_ENTRIES, form, equations.choose_by_share if by_share else SOLVER_ENTRIES[config.solver])


def compile_entries(entries: tuple[Any, ...], memory: Memory) -> None:
    """Compile the entries or load them from the cache, then refuse to compile in flight: an int is cast."""
    given, news = {"block": memory.block, "words": memory.words, **memory.apart}, False
    with cache.alone:  # two estimators may be made in two threads
        for entry in entries:
            if not hasattr(entry, "py_func"):  # nothing is compiled
                continue
            kinds = tuple(_numba.typeof(given[name]) if name in given else NUMBERS.get(name, _numba.int64)
                          for name in inspect.signature(entry.py_func).parameters)
            if kinds not in entry.signatures:
                news = True
                entry.disable_compile(False)
                entry.compile(kinds)
                entry.disable_compile(True)
        if news:
            cache.finish()


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
