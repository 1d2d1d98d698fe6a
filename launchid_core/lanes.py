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
TOGETHER = (4, 2, 1)  # columns that are reflected together

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


def scale(y, by, start, stop):
    """y[i] *= by"""
    for i in range(start, stop):
        y[i] *= by


def divide(y, by, start, stop):
    """y[i] /= by"""
    for i in range(start, stop):
        y[i] /= by


def standard(y, x, centre, scale, start, stop):
    """y[i] = (x[i] - centre)/scale"""
    for i in range(start, stop):
        y[i] = (x[i] - centre) / scale


def reflect(v, tau, columns, first, last, start, stop):
    """Householder's reflection of rows first .. last-1 of `columns` (n, m), several at a time.

    c[start] and c[i] less s and s*v[i], i in start+1..stop-1, with s = tau*(c[start] + sum v[i]*c[i]); v, whose own
    v[start] is taken as 1, is none of them.
    """
    for j in range(first, last):
        column = columns[j]
        s = tau * (column[start] + dot(v, column, start + 1, stop))
        column[start] -= s
        subtract(column, s, v, start + 1, stop)


def reflect_sized(v, tau, columns, first, last, start, stop, squares):
    """As `reflect`; squares[j] (n,) out: the sum of the new c[i]*c[i], i in start+1..stop-1."""
    for j in range(first, last):
        column = columns[j]
        s = tau * (column[start] + dot(v, column, start + 1, stop))
        column[start] -= s
        subtract(column, s, v, start + 1, stop)
        squares[j] = dot(column, column, start + 1, stop)


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

    @classmethod
    def of(cls, builder: Any, first: Any) -> "_Column":
        """From a number on."""
        column = cls.__new__(cls)
        column._data, column._builder = first, builder
        return column

    def _place(self, at: Any, kind: Any) -> Any:
        return self._builder.bitcast(self._builder.gep(self._data, [at]), kind.as_pointer())

    def load(self, at: Any, kind: Any) -> Any:
        """One or four, as `kind` says."""
        return self._builder.load(self._place(at, kind), align=_ALIGNED)

    def store(self, at: Any, numbers: Any) -> None:
        """One or four."""
        self._builder.store(numbers, self._place(at, numbers.type)).align = _ALIGNED


def _along(builder: Any, work: Callable[[Any, Any], None], start: Any, stop: Any,
           between: Callable[[], None] = lambda: None) -> None:
    """`work` at every fourth position with vectors, then `between`, then `work` at each of the rest with numbers."""
    one, four = (ir.Constant(start.type, n) for n in (1, LANES))
    rest = builder.sub(stop, builder.srem(builder.sub(stop, start), four))
    with cgutils.for_range_slice(builder, start, rest, four, inc=True) as (at, _):
        work(at, _VECTOR)
    between()
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
_scale_build = _elementwise(lambda b, y, by: b.fmul(y, by), 1, 1, True)
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
def _scale(typing, y, by, start, stop):
    return _typed((y,), (by,), start, stop), _scale_build


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
        sums = _Sums(builder, 1)
        _along(builder, lambda at, kind: sums.add(0, builder.fmul(left.load(at, kind), right.load(at, kind))),
               *arguments[2:], sums.begin_rest)
        return sums.total(0)

    return types.float64(a, b, types.intp, types.intp), build


def _sum_of(builder: Any, vector: Any, rest: Any) -> Any:
    """Of four partial sums, `rest` in the place of the first."""
    s = [builder.extract_element(vector, ir.Constant(ir.IntType(32), k)) for k in range(1, LANES)]
    return builder.fadd(builder.fadd(rest, s[0]), builder.fadd(s[1], s[2]))


class _Sums:
    """Partial sums of several columns, added to one after the other: in vectors, then in numbers to the first."""

    def __init__(self, builder: Any, count: int) -> None:
        self._builder = builder
        self._vectors = [cgutils.alloca_once(builder, _VECTOR) for _ in range(count)]
        self._numbers = [cgutils.alloca_once(builder, _NUMBER) for _ in range(count)]
        for place in self._vectors:
            builder.store(_ZERO, place)

    def begin_rest(self) -> None:
        """Numbers follow."""
        for vector, number in zip(self._vectors, self._numbers, strict=True):
            first = self._builder.extract_element(self._builder.load(vector), ir.Constant(ir.IntType(32), 0))
            self._builder.store(first, number)

    def add(self, k: int, value: Any) -> None:
        """To those of column k."""
        place = (self._vectors if value.type is _VECTOR else self._numbers)[k]
        self._builder.store(self._builder.fadd(self._builder.load(place), value), place)

    def total(self, k: int) -> Any:
        """Of column k."""
        return _sum_of(self._builder, self._builder.load(self._vectors[k]), self._builder.load(self._numbers[k]))


def _reflect_together(builder: Any, v: _Column, tau: Any, columns: list[_Column], start: Any, stop: Any,
                      sized: bool) -> list[Any]:
    """`reflect` of these columns; their sums of squares if `sized`."""
    after = builder.add(start, ir.Constant(start.type, 1))
    sums, squares = _Sums(builder, len(columns)), _Sums(builder, len(columns))

    def multiply_columns(at: Any, kind: Any) -> None:
        given = v.load(at, kind)
        for k, column in enumerate(columns):
            sums.add(k, builder.fmul(given, column.load(at, kind)))

    _along(builder, multiply_columns, after, stop, sums.begin_rest)
    shares = []
    for k, column in enumerate(columns):
        head = column.load(start, _NUMBER)
        shares.append(builder.fmul(tau, builder.fadd(head, sums.total(k))))
        column.store(start, builder.fsub(head, shares[-1]))
    filled = [_filled(builder, each) for each in shares]

    def subtract_columns(at: Any, kind: Any) -> None:
        given, by = v.load(at, kind), filled if kind is _VECTOR else shares
        new = [builder.fsub(column.load(at, kind), builder.fmul(s, given))
               for column, s in zip(columns, by, strict=True)]
        for k, (column, numbers) in enumerate(zip(columns, new, strict=True)):
            column.store(at, numbers)
            if sized:
                squares.add(k, builder.fmul(numbers, numbers))

    _along(builder, subtract_columns, after, stop, squares.begin_rest)
    return [squares.total(k) for k in range(len(columns))] if sized else []


def _reflect_build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Columns by fours, then by twos, then alone."""
    kinds, (v, tau, matrix, first, last, start, stop, *sized) = signature.args, arguments
    if kinds[2].ndim != 2 or kinds[2].layout != "C" or kinds[2].dtype != types.float64:
        raise TypeError(f"a matrix of doubles row after row is needed, not {kinds[2]}")
    whole = context.make_array(kinds[2])(context, builder, matrix)
    length = cgutils.unpack_tuple(builder, whole.shape)[1]
    along = _Column(context, builder, kinds[0], v)
    squares = _Column(context, builder, kinds[7], sized[0]) if sized else None
    begin = first
    for count in TOGETHER:
        step = ir.Constant(first.type, count)
        end = builder.sub(last, builder.srem(builder.sub(last, begin), step))
        with cgutils.for_range_slice(builder, begin, end, step, inc=True) as (at, _):
            places = [builder.add(at, ir.Constant(first.type, k)) for k in range(count)]
            columns = [_Column.of(builder, builder.gep(whole.data, [builder.mul(place, length)])) for place in places]
            found = _reflect_together(builder, along, tau, columns, start, stop, bool(sized))
            for place, square in zip(places, found, strict=False):
                squares.store(place, square)
        begin = end
    return context.get_dummy_value()


@_extending.intrinsic
def _reflect(typing, v, tau, columns, first, last, start, stop):
    return types.void(v, types.float64, columns, *(types.intp,) * 4), _reflect_build


@_extending.intrinsic
def _reflect_sized(typing, v, tau, columns, first, last, start, stop, squares):
    return types.void(v, types.float64, columns, *(types.intp,) * 4, squares), _reflect_build


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


@_extending.overload(scale, jit_options=_AS_WRITTEN)
def _scale_compiled(y, by, start, stop):
    return lambda y, by, start, stop: _scale(y, by, start, stop)  # noqa: PLW0108


@_extending.overload(divide, jit_options=_AS_WRITTEN)
def _divide_compiled(y, by, start, stop):
    return lambda y, by, start, stop: _divide(y, by, start, stop)  # noqa: PLW0108


@_extending.overload(standard, jit_options=_AS_WRITTEN)
def _standard_compiled(y, x, centre, scale, start, stop):
    return lambda y, x, centre, scale, start, stop: _standard(y, x, centre, scale, start, stop)  # noqa: PLW0108


@_extending.overload(largest_size, jit_options=_AS_WRITTEN)
def _largest_size_compiled(x, start, stop):
    return lambda x, start, stop: _largest_size(x, start, stop)  # noqa: PLW0108


@_extending.overload(reflect, jit_options=_AS_WRITTEN)
def _reflect_compiled(v, tau, columns, first, last, start, stop):
    return lambda v, tau, columns, first, last, start, stop: _reflect(  # noqa: PLW0108
        v, tau, columns, first, last, start, stop)


@_extending.overload(reflect_sized, jit_options=_AS_WRITTEN)
def _reflect_sized_compiled(v, tau, columns, first, last, start, stop, squares):
    return lambda v, tau, columns, first, last, start, stop, squares: _reflect_sized(  # noqa: PLW0108
        v, tau, columns, first, last, start, stop, squares)
