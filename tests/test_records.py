"""Stores in compiled code: a named tuple of arrays goes in, through and out as it is in plain Python."""

import gc
from typing import NamedTuple

import numpy as np
import pytest
from compiled import compiled
from hypothesis import given
from hypothesis import strategies as st

from launchid_core.kernels import inner, shared
from launchid_core.memory import take, take2, take3
from launchid_core.parts import GARBAGE, collecting_seldom, remembering
from launchid_core.records import store


@store
class Few(NamedTuple):
    """A store inside another."""

    number: np.ndarray  # (n,)
    count: np.ndarray   # (m,) int64


@store
class Many(NamedTuple):
    """Arrays of every kind, a store, a scalar."""

    few: Few
    plane: np.ndarray   # (n, m)
    solid: np.ndarray   # (2, n, m)
    factor: float


@shared
def view_many(f, i, n, m, factor):
    """Cut it from floats f and integers i."""
    number, at = take(f, 0, n)
    count, _ = take(i, 0, m)
    plane, at = take2(f, at, n, m)
    solid, at = take3(f, at, 2, n, m)
    return Many(Few(number, count), plane, solid, factor), at


@inner
def change(many):
    """Read and write whole arrays, rows, numbers, through two levels."""
    few, total = many.few, 0.0
    for k in range(few.number.shape[0]):
        few.number[k] += many.factor * k
        many.plane[k, :] = few.number[k]
        row = many.solid[1, k]
        for j in range(row.shape[0]):
            row[j] -= many.plane[k, j] * few.count[j]
            total += row[j]
    few.count[:] = few.count.size + few.count[::-1].sum()
    return total + many.plane.size + many.solid.shape[0] + many.solid.nbytes


def use(f, i, n, m, factor):
    """Cut, change, say where the cut ends and the strides of what was cut."""
    many, at = view_many(f, i, n, m, factor)
    total = change(many)
    return total, at, many.plane.strides, many.solid.strides, many.solid.T.shape, many.few.number.itemsize


@given(n=st.integers(1, 5), m=st.integers(1, 4), factor=st.floats(-2.0, 2.0))
def test_a_store_in_compiled_code_is_the_named_tuple(n, m, factor):
    floats, integers = np.arange(100.0), np.arange(10)
    made, whole = floats.copy(), integers.copy()
    plain = getattr(change, "py_func", change)
    many, at = view_many(floats, integers, n, m, factor)
    wanted = plain(many), at, many.plane.strides, many.solid.strides, many.solid.T.shape, many.few.number.itemsize
    assert compiled(use)(made, whole, n, m, factor) == wanted
    assert np.array_equal(made, floats) and np.array_equal(whole, integers)


def test_its_words_are_an_address_and_extents():
    from numba import typeof
    from numba.core.registry import cpu_target
    from numba.core.types import float64

    from launchid_core.records import Store
    arrays = [typeof(np.zeros(shape)) for shape in (1, (1, 1), (1, 1, 1))]
    context = cpu_target.target_context
    held = Store(Few, (arrays[0], typeof(np.zeros(1, np.int64))))
    whole = Store(Many, (held, arrays[1], arrays[2], float64))
    words = context.get_abi_sizeof(context.get_value_type(whole)) // 8
    assert words == 2 * 2 + 3 + 4 + 1


def test_an_array_that_does_not_lie_in_one_piece_is_held_whole():
    from numba import typeof
    from numba.core.registry import cpu_target

    from launchid_core.records import Store
    sparse, counts = typeof(np.zeros(4)[::2]), typeof(np.zeros(1, np.int64))
    context = cpu_target.target_context
    held = context.get_value_type(Store(Few, (sparse, counts)))
    assert held.elements[0] == context.get_value_type(sparse)


def test_operators_mean_afterwards_what_they_meant_before():
    from numba.core import types
    before = types.BaseFunction.get_call_type
    with pytest.raises(KeyError), remembering():
        assert types.BaseFunction.get_call_type is not before
        raise KeyError
    assert types.BaseFunction.get_call_type is before


@pytest.mark.parametrize("usual", [(700, 10, 10), (0, 10, 10)])
def test_garbage_is_collected_afterwards_as_before(usual):
    before = gc.get_threshold()
    try:
        gc.set_threshold(*usual)
        with pytest.raises(KeyError), collecting_seldom():
            assert gc.get_threshold() == (GARBAGE if usual[0] else usual)
            raise KeyError
        assert gc.get_threshold() == usual
    finally:
        gc.set_threshold(*before)
