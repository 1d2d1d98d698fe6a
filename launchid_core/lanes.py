"""Loops along a column, four numbers at a time: as written here in Python and C, in vectors when compiled by numba.

Every operation is done on the same numbers in the same order as written, so the bits are those of the loops.  numba's
own machine code of them is scalar: an index may be negative there, and two views of one block may overlap, for all it
knows.  Positions start .. stop-1 must lie inside the vectors, and start <= stop.
"""

from typing import Any

from numba import extending
from numba.core import cgutils, types

from .parts import OF_A_PART
from .vectors import LANES, NUMBER, VECTOR, ZERO, Column, Sums, along, elementwise, ir, lagged_build, reflect_build

_extending: Any = extending  # typed by numba only in part
_AS_WRITTEN: dict[str, Any] = {"_nrt": False, "forceinline": True, **OF_A_PART}
_APART: dict[str, Any] = {"_nrt": False, "forceinline": False, **OF_A_PART}  # too long to stand wherever it is called


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


def dot_by_place(a, b, start, stop):
    """As `dot`, number i in partial sum i mod 4, so that fours begin where memory is read fastest.

    Where there is no whole four all are in the first, as is what is left behind the last.
    """
    s0 = 0.0
    s1 = 0.0
    s2 = 0.0
    s3 = 0.0
    begin = start + 3 - (start + 3) % 4
    if begin > stop:
        begin = start
    for i in range(start, begin):
        if i % 4 == 1:
            s1 += a[i] * b[i]
        elif i % 4 == 2:
            s2 += a[i] * b[i]
        else:
            s3 += a[i] * b[i]
    quads = (stop - begin) // 4 if begin % 4 == 0 else 0
    for k in range(quads):
        i = begin + 4 * k
        s0 += a[i] * b[i]
        s1 += a[i + 1] * b[i + 1]
        s2 += a[i + 2] * b[i + 2]
        s3 += a[i + 3] * b[i + 3]
    for i in range(begin + 4 * quads, stop):
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
        s = tau * (column[start] + dot_by_place(v, column, start + 1, stop))
        column[start] -= s
        subtract(column, s, v, start + 1, stop)


def reflect_sized(v, tau, columns, first, last, start, stop, squares):
    """As `reflect`; squares[j] (n,) out: the sum of the new c[i]*c[i], i in start+1..stop-1."""
    for j in range(first, last):
        column = columns[j]
        s = tau * (column[start] + dot_by_place(v, column, start + 1, stop))
        column[start] -= s
        subtract(column, s, v, start + 1, stop)
        squares[j] = dot_by_place(column, column, start + 1, stop)


def lagged(a, b, first, last, n, sums):
    """sums[k] = sum a[i + k]*b[i], i in 0..n-k-1, for k in first..last-1, several at a time."""
    for k in range(first, last):
        sums[k] = dot(a[k:], b, 0, n - k)


def weigh(y, x, s, start, stop):
    """y[i] *= x[i] - s*y[i]"""
    for i in range(start, stop):
        y[i] *= x[i] - s * y[i]


def largest_size(x, start, stop):
    """Largest |x[i]|, which a NaN is not; 0 of none."""
    largest = 0.0
    for i in range(start, stop):
        largest = max(largest, abs(x[i]))
    return largest


# ---- the same as numba compiles it: an intrinsic each, which an overload calls (numba takes no intrinsic as one)


def _typed(columns: Any, numbers: Any, start: Any, stop: Any) -> Any:
    return types.void(*columns, *(types.float64 for _ in numbers), types.intp, types.intp)


_subtract_build = elementwise(lambda b, y, x, s: b.fsub(y, b.fmul(s, x)), 2, 1, True)
_multiply_build = elementwise(lambda b, y, x: b.fmul(y, x), 2, 0, True)
_scale_build = elementwise(lambda b, y, by: b.fmul(y, by), 1, 1, True)
_divide_build = elementwise(lambda b, y, by: b.fdiv(y, by), 1, 1, True)
_standard_build = elementwise(lambda b, x, centre, scale: b.fdiv(b.fsub(x, centre), scale), 2, 2, False)

_weigh_build = elementwise(lambda b, y, x, s: b.fmul(y, b.fsub(x, b.fmul(s, y))), 2, 1, True)


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
def _weigh(typing, y, x, s, start, stop):
    return _typed((y, x), (s,), start, stop), _weigh_build


@_extending.intrinsic
def _divide(typing, y, by, start, stop):
    return _typed((y,), (by,), start, stop), _divide_build


@_extending.intrinsic
def _standard(typing, y, x, centre, scale, start, stop):
    return _typed((y, x), (centre, scale), start, stop), _standard_build


@_extending.intrinsic
def _dot(typing, a, b, start, stop):
    def build(context, builder, signature, arguments):
        left, right = (Column(context, builder, kind, each)
                       for kind, each in zip(signature.args[:2], arguments[:2], strict=True))
        sums = Sums(builder, 1)
        along(builder, lambda at, kind: sums.add(0, builder.fmul(left.load(at, kind), right.load(at, kind))),
              arguments[2], arguments[3], sums.begin_rest)
        return sums.total(0)

    return types.float64(a, b, types.intp, types.intp), build


@_extending.intrinsic
def _reflect(typing, v, tau, columns, first, last, start, stop):
    return types.void(v, types.float64, columns, *(types.intp,) * 4), reflect_build


@_extending.intrinsic
def _reflect_sized(typing, v, tau, columns, first, last, start, stop, squares):
    return types.void(v, types.float64, columns, *(types.intp,) * 4, squares), reflect_build


@_extending.intrinsic
def _lagged(typing, a, b, first, last, n, sums):
    return types.void(a, b, types.intp, types.intp, types.intp, sums), lagged_build


@_extending.intrinsic
def _largest_size(typing, x, start, stop):
    def build(context, builder, signature, arguments):
        column = Column(context, builder, signature.args[0], arguments[0])
        vector, number = (cgutils.alloca_once_value(builder, zero) for zero in (ZERO, ir.Constant(NUMBER, 0.0)))

        def larger(so_far, new):
            return builder.select(builder.fcmp_ordered(">", new, so_far), new, so_far)

        def work(at, kind):
            into = vector if kind is VECTOR else number
            given, zero = column.load(at, kind), ZERO if kind is VECTOR else ir.Constant(NUMBER, 0.0)
            size = builder.select(builder.fcmp_ordered("<", given, zero), builder.fsub(zero, given), given)
            builder.store(larger(builder.load(into), size), into)

        along(builder, work, *arguments[1:])
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


@_extending.overload(weigh, jit_options=_AS_WRITTEN)
def _weigh_compiled(y, x, s, start, stop):
    return lambda y, x, s, start, stop: _weigh(y, x, s, start, stop)  # noqa: PLW0108


@_extending.overload(divide, jit_options=_AS_WRITTEN)
def _divide_compiled(y, by, start, stop):
    return lambda y, by, start, stop: _divide(y, by, start, stop)  # noqa: PLW0108


@_extending.overload(standard, jit_options=_AS_WRITTEN)
def _standard_compiled(y, x, centre, scale, start, stop):
    return lambda y, x, centre, scale, start, stop: _standard(y, x, centre, scale, start, stop)  # noqa: PLW0108


@_extending.overload(largest_size, jit_options=_AS_WRITTEN)
def _largest_size_compiled(x, start, stop):
    return lambda x, start, stop: _largest_size(x, start, stop)  # noqa: PLW0108


@_extending.overload(reflect, jit_options=_APART)
def _reflect_compiled(v, tau, columns, first, last, start, stop):
    return lambda v, tau, columns, first, last, start, stop: _reflect(  # noqa: PLW0108
        v, tau, columns, first, last, start, stop)


@_extending.overload(reflect_sized, jit_options=_APART)
def _reflect_sized_compiled(v, tau, columns, first, last, start, stop, squares):
    return lambda v, tau, columns, first, last, start, stop, squares: _reflect_sized(  # noqa: PLW0108
        v, tau, columns, first, last, start, stop, squares)


@_extending.overload(lagged, jit_options=_APART)
def _lagged_compiled(a, b, first, last, n, sums):
    return lambda a, b, first, last, n, sums: _lagged(a, b, first, last, n, sums)  # noqa: PLW0108
