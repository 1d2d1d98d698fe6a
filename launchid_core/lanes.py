"""Loops along a column, four numbers at a time: as written here in Python and C, in vectors when compiled by numba.

Every operation is done on the same numbers in the same order as written, so the bits are those of the loops.  numba's
own machine code of them is scalar: an index may be negative there, and two views of one block may overlap, for all it
knows.  Positions start .. stop-1 must lie inside the vectors, and start <= stop.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import extending
from numba.core import cgutils, types

from .parts import OF_A_PART

LANES = 4

_extending: Any = extending  # typed by numba only in part
ir: Any = cgutils.ir  # llvmlite's, by way of numba
_AS_WRITTEN: dict[str, Any] = {"_nrt": False, "forceinline": True, **OF_A_PART}
_NUMBER = ir.DoubleType()
_VECTOR = ir.VectorType(_NUMBER, LANES)
_ZERO = ir.Constant(_VECTOR, [0.0] * LANES)
_ALIGNED = np.dtype(np.float64).alignment


def dot(a, b, start, stop):
    """sum a[i]*b[i], i in start..stop-1, in four interleaved partial sums (fixed order: same bits everywhere)."""
    s0 = 0.0
    s1 = 0.0
    s2 = 0.0
    s3 = 0.0
    quads = (stop - start) // 4
    for k in range(quads):
        i = start + 4 * k
        s0 += a[i] * b[i]
        s1 += a[i + 1] * b[i + 1]
        s2 += a[i + 2] * b[i + 2]
        s3 += a[i + 3] * b[i + 3]
    for i in range(start + 4 * quads, stop):
        s0 += a[i] * b[i]
    return (s0 + s1) + (s2 + s3)


def subtract(y, s, x, start, stop):
    """y[i] -= s*x[i]"""
    for i in range(start, stop):
        y[i] -= s * x[i]


def multiply(y, x, start, stop):
    """y[i] *= x[i]"""
    for i in range(start, stop):
        y[i] *= x[i]


def divide(y, by, start, stop):
    """y[i] /= by"""
    for i in range(start, stop):
        y[i] /= by


def standard(y, x, centre, scale, start, stop):
    """y[i] = (x[i] - centre)/scale"""
    for i in range(start, stop):
        y[i] = (x[i] - centre) / scale


def largest_size(x, start, stop):
    """Largest |x[i]|, which a NaN is not; 0 of none."""
    largest = 0.0
    for i in range(start, stop):
        largest = max(largest, abs(x[i]))
    return largest


# ---- the same as numba compiles it: an intrinsic each, which an overload calls (numba takes no intrinsic as one)


def _filled(builder: Any, number: Any) -> Any:
    """A vector of one number."""
    vector = ir.Constant(_VECTOR, ir.Undefined)
    for k in range(LANES):
        vector = builder.insert_element(vector, number, ir.Constant(ir.IntType(32), k))
    return vector


class _Column:
    """A (n,) array's numbers, one or four from a position on; one after another in memory, or it does not compile."""

    def __init__(self, context: Any, builder: Any, kind: Any, array: Any) -> None:
        if kind.ndim != 1 or kind.layout == "A" or kind.dtype != types.float64:
            raise TypeError(f"a column of doubles one after another is needed, not {kind}")
        self._data, self._builder = context.make_array(kind)(context, builder, array).data, builder

    def _place(self, at: Any, kind: Any) -> Any:
        return self._builder.bitcast(self._builder.gep(self._data, [at]), kind.as_pointer())

    def load(self, at: Any, kind: Any) -> Any:
        """One or four, as `kind` says."""
        return self._builder.load(self._place(at, kind), align=_ALIGNED)

    def store(self, at: Any, numbers: Any) -> None:
        """One or four."""
        self._builder.store(numbers, self._place(at, numbers.type)).align = _ALIGNED


def _along(builder: Any, work: Callable[[Any, Any], None], start: Any, stop: Any) -> None:
    """`work` at every fourth position with vectors, then at each of the rest with numbers."""
    one, four = (ir.Constant(start.type, n) for n in (1, LANES))
    rest = builder.sub(stop, builder.srem(builder.sub(stop, start), four))
    with cgutils.for_range_slice(builder, start, rest, four, inc=True) as (at, _):
        work(at, _VECTOR)
    with cgutils.for_range_slice(builder, rest, stop, one, inc=True) as (at, _):
        work(at, _NUMBER)


def _elementwise(change: Callable[..., Any], columns: int, numbers: int, reads: bool) -> Any:
    """An intrinsic (y, other columns.., numbers.., start, stop): y[i] = change(builder, y[i] if it reads it, ...)."""
    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        rows = [_Column(context, builder, kind, each)
                for kind, each in zip(signature.args[:columns], arguments[:columns], strict=True)]
        scalars = arguments[columns:columns + numbers]
        filled = [_filled(builder, each) for each in scalars]

        def work(at: Any, kind: Any) -> None:
            given = [row.load(at, kind) for row in (rows if reads else rows[1:])]
            rows[0].store(at, change(builder, *given, *(filled if kind is _VECTOR else scalars)))

        _along(builder, work, *arguments[columns + numbers:])
        return context.get_dummy_value()

    return build


def _typed(columns: Any, numbers: Any, start: Any, stop: Any) -> Any:
    return types.void(*columns, *(types.float64 for _ in numbers), types.intp, types.intp)


_subtract_build = _elementwise(lambda b, y, x, s: b.fsub(y, b.fmul(s, x)), 2, 1, True)
_multiply_build = _elementwise(lambda b, y, x: b.fmul(y, x), 2, 0, True)
_divide_build = _elementwise(lambda b, y, by: b.fdiv(y, by), 1, 1, True)
_standard_build = _elementwise(lambda b, x, centre, scale: b.fdiv(b.fsub(x, centre), scale), 2, 2, False)


@_extending.intrinsic
def _subtract(typing, y, s, x, start, stop):
    def build(context, builder, signature, arguments):
        y, s, x, start, stop = arguments
        kinds = types.void(signature.args[0], signature.args[2], signature.args[1], *signature.args[3:])
        return _subtract_build(context, builder, kinds, (y, x, s, start, stop))

    return types.void(y, types.float64, x, types.intp, types.intp), build


@_extending.intrinsic
def _multiply(typing, y, x, start, stop):
    return _typed((y, x), (), start, stop), _multiply_build


@_extending.intrinsic
def _divide(typing, y, by, start, stop):
    return _typed((y,), (by,), start, stop), _divide_build


@_extending.intrinsic
def _standard(typing, y, x, centre, scale, start, stop):
    return _typed((y, x), (centre, scale), start, stop), _standard_build


@_extending.intrinsic
def _dot(typing, a, b, start, stop):
    def build(context, builder, signature, arguments):
        left, right = (_Column(context, builder, kind, each)
                       for kind, each in zip(signature.args[:2], arguments[:2], strict=True))
        sums = cgutils.alloca_once_value(builder, _ZERO)
        first = ir.Constant(ir.IntType(32), 0)

        def work(at, kind):
            product = builder.fmul(left.load(at, kind), right.load(at, kind))
            so_far = builder.load(sums)
            if kind is _VECTOR:
                builder.store(builder.fadd(so_far, product), sums)
            else:
                builder.store(builder.insert_element(
                    so_far, builder.fadd(builder.extract_element(so_far, first), product), first), sums)

        _along(builder, work, *arguments[2:])
        whole = builder.load(sums)
        s = [builder.extract_element(whole, ir.Constant(ir.IntType(32), k)) for k in range(LANES)]
        return builder.fadd(builder.fadd(s[0], s[1]), builder.fadd(s[2], s[3]))

    return types.float64(a, b, types.intp, types.intp), build


@_extending.intrinsic
def _largest_size(typing, x, start, stop):
    def build(context, builder, signature, arguments):
        column = _Column(context, builder, signature.args[0], arguments[0])
        vector, number = (cgutils.alloca_once_value(builder, zero) for zero in (_ZERO, ir.Constant(_NUMBER, 0.0)))

        def larger(so_far, new):
            return builder.select(builder.fcmp_ordered(">", new, so_far), new, so_far)

        def work(at, kind):
            into = vector if kind is _VECTOR else number
            given, zero = column.load(at, kind), _ZERO if kind is _VECTOR else ir.Constant(_NUMBER, 0.0)
            size = builder.select(builder.fcmp_ordered("<", given, zero), builder.fsub(zero, given), given)
            builder.store(larger(builder.load(into), size), into)

        _along(builder, work, *arguments[1:])
        whole, largest = builder.load(vector), builder.load(number)
        for k in range(LANES):
            largest = larger(largest, builder.extract_element(whole, ir.Constant(ir.IntType(32), k)))
        return largest

    return types.float64(x, types.intp, types.intp), build


@_extending.overload(dot, jit_options=_AS_WRITTEN)
def _dot_compiled(a, b, start, stop):
    return lambda a, b, start, stop: _dot(a, b, start, stop)  # noqa: PLW0108


@_extending.overload(subtract, jit_options=_AS_WRITTEN)
def _subtract_compiled(y, s, x, start, stop):
    return lambda y, s, x, start, stop: _subtract(y, s, x, start, stop)  # noqa: PLW0108


@_extending.overload(multiply, jit_options=_AS_WRITTEN)
def _multiply_compiled(y, x, start, stop):
    return lambda y, x, start, stop: _multiply(y, x, start, stop)  # noqa: PLW0108


@_extending.overload(divide, jit_options=_AS_WRITTEN)
def _divide_compiled(y, by, start, stop):
    return lambda y, by, start, stop: _divide(y, by, start, stop)  # noqa: PLW0108


@_extending.overload(standard, jit_options=_AS_WRITTEN)
def _standard_compiled(y, x, centre, scale, start, stop):
    return lambda y, x, centre, scale, start, stop: _standard(y, x, centre, scale, start, stop)  # noqa: PLW0108


@_extending.overload(largest_size, jit_options=_AS_WRITTEN)
def _largest_size_compiled(x, start, stop):
    return lambda x, start, stop: _largest_size(x, start, stop)  # noqa: PLW0108
