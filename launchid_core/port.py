"""What a port to another language needs of an estimator: its memory by name, and the kernels that it calls.

The order of the calls is `Estimator`'s (`update`, `_take_regression`, `_take_filtered`); the rest is in the kernels.
"""

from typing import Any, NamedTuple

import numpy as np

from . import onboard as ob
from . import ring as rb
from . import uncertainty as un
from .estimator import Estimator


class Given(NamedTuple):
    """An argument that differs from call to call.  like: a value of its type."""

    like: float | int


class Call(NamedTuple):
    """A kernel, and its arguments: numbers, memory (arrays, in named tuples or not), `Given`."""

    kernel: Any
    arguments: tuple[Any, ...]


class Port(NamedTuple):
    """An estimator's memory, by name, and its calls.

    constants  arrays that no call changes
    state      those that persist, as after `reset`
    scratch    meaningless between calls
    calls      every kernel that the estimator calls, `Estimator.reset`'s left out: `state` is what they make
    """

    constants: dict[str, np.ndarray]
    state: dict[str, np.ndarray]
    scratch: dict[str, np.ndarray]
    calls: tuple[Call, ...]


def _named(prefix: str, value: Any) -> dict[str, np.ndarray]:
    """Arrays of a nest of named tuples."""
    if isinstance(value, np.ndarray):
        return {prefix: value}
    found: dict[str, np.ndarray] = {}
    for name, each in zip(value._fields, value, strict=True):
        if isinstance(each, (np.ndarray, tuple)):
            found |= _named(f"{prefix}_{name}", each)
    return found


def port_of(estimator: Estimator) -> Port:
    """Of an estimator that has taken no sample since it was made or reset."""
    e = estimator
    constants = {"limits": e._limits}
    state = {"clock": e._clock, "count": e._count, "ring": e._ring, **_named("outcome", e._outcome)}
    scratch: dict[str, np.ndarray] = {}
    number, whole = Given(0.0), Given(0)
    calls = [Call(rb.push, (e._limits, e._clock, e._count, e._ring, *(number,) * rb.N_COLUMNS))]
    if e._onboard is None:
        constants |= _named("plan", e._plan)
        state["random"] = e._random
        scratch |= _named("work", e._work)
        calls.append(Call(e._close, (e._plan, e._work, e._outcome, e._ring, e._count, e._random, number)))
        return Port(constants, state, scratch, tuple(calls))
    memory, period = e._memory, e.config.sample_period
    state |= {"floats": memory.floats, "integers": memory.integers}
    calls += [Call(ob.take_samples, (*memory, e._ring, e._count, whole, whole, whole, e.config.max_gap, period)),
              Call(ob.close_filtered, (*memory, e._outcome, number, e._enough)),
              Call(ob.abandon_window, memory), Call(ob.view_onboard, memory)]
    if e._gauge is not None:
        state |= {"range_floats": e._range.floats, "range_integers": e._range.integers}
        total, watch = e._onboard.bank.total, e._onboard.watch
        calls += [Call(un.watch_range, (*e._range, total, e._onboard.filter.time, number, watch.counts, watch.event)),
                  Call(un.close_range, (*e._range, total, number)), Call(un.view_gauge, e._range)]
    return Port(constants, state, scratch, tuple(calls))
