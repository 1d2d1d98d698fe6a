"""How `lanes` is compiled: loops in vectors of four doubles, and several columns at a time.

The operations are those of the loops as written there, each sum in its own order.
"""

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any

import numpy as np
from numba.core import cgutils, types

LANES = 4
TOGETHER = (4, 3, 2, 1)  # columns that are worked on together: no sum waits for another

ir: Any = cgutils.ir  # llvmlite's, by way of numba
NUMBER = ir.DoubleType()
VECTOR = ir.VectorType(NUMBER, LANES)
ZERO = ir.Constant(VECTOR, [0.0] * LANES)
_ALIGNED = np.dtype(np.float64).alignment


def filled(builder: Any, number: Any) -> Any:
    """A vector of one number."""
    vector = ir.Constant(VECTOR, ir.Undefined)
    for k in range(LANES):
        vector = builder.insert_element(vector, number, ir.Constant(ir.IntType(32), k))
    return vector


class Column:
    """A (n,) array's numbers, one or four from a position on; one after another in memory, or it does not compile."""

    def __init__(self, context: Any, builder: Any, kind: Any, array: Any) -> None:
        if kind.ndim != 1 or kind.layout == "A" or kind.dtype != types.float64:
            raise TypeError(f"a column of doubles one after another is needed, not {kind}")
        self._data, self._builder = context.make_array(kind)(context, builder, array).data, builder

    @classmethod
    def of(cls, builder: Any, first: Any) -> "Column":
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


def along(builder: Any, work: Callable[[Any, Any], None], start: Any, stop: Any,
          between: Callable[[], None] = lambda: None) -> None:
    """`work` at every fourth position with vectors, then `between`, then `work` at each of the rest with numbers."""
    one, four = (ir.Constant(start.type, n) for n in (1, LANES))
    rest = builder.sub(stop, builder.srem(builder.sub(stop, start), four))
    with cgutils.for_range_slice(builder, start, rest, four, inc=True) as (at, _):
        work(at, VECTOR)
    between()
    with cgutils.for_range_slice(builder, rest, stop, one, inc=True) as (at, _):
        work(at, NUMBER)


def along_places(builder: Any, work: Callable[..., None], start: Any, stop: Any,
                 between: Callable[[], None] = lambda: None) -> None:
    """As `along`, but vectors at multiples of four alone.

    Where a whole four begins behind `start`, `work` has the one before it too, and is told which of its numbers count.
    """
    one, four, whole = (ir.Constant(start.type, n) for n in (1, LANES, -LANES))
    begin = builder.and_(builder.add(start, ir.Constant(start.type, LANES - 1)), whole)
    inside = builder.icmp_signed("<=", begin, stop)
    with builder.if_then(builder.and_(inside, builder.icmp_signed("<", start, begin))):
        at, places = builder.sub(begin, four), ir.VectorType(start.type, LANES)
        spread = ir.Constant(places, ir.Undefined)
        for k in range(LANES):
            place = builder.add(at, ir.Constant(start.type, k))
            spread = builder.insert_element(spread, builder.sub(place, start), ir.Constant(ir.IntType(32), k))
        work(at, VECTOR, builder.icmp_signed(">=", spread, ir.Constant(places, [0] * LANES)))
    first = builder.select(inside, begin, start)
    rest = builder.add(first, builder.select(inside, builder.and_(builder.sub(stop, begin), whole),
                                             ir.Constant(start.type, 0)))
    with cgutils.for_range_slice(builder, first, rest, four, inc=True) as (at, _):
        work(at, VECTOR)
    between()
    with cgutils.for_range_slice(builder, rest, stop, one, inc=True) as (at, _):
        work(at, NUMBER)


def elementwise(change: Callable[..., Any], columns: int, numbers: int, reads: bool) -> Any:
    """An intrinsic (y, other columns.., numbers.., start, stop): y[i] = change(builder, y[i] if it reads it, ...)."""
    def build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        rows = [Column(context, builder, kind, each)
                for kind, each in zip(signature.args[:columns], arguments[:columns], strict=True)]
        scalars = arguments[columns:columns + numbers]
        spread = [filled(builder, each) for each in scalars]

        def work(at: Any, kind: Any) -> None:
            given = [row.load(at, kind) for row in (rows if reads else rows[1:])]
            rows[0].store(at, change(builder, *given, *(spread if kind is VECTOR else scalars)))

        along(builder, work, *arguments[columns + numbers:])
        return context.get_dummy_value()

    return build


def sum_of(builder: Any, vector: Any, rest: Any) -> Any:
    """Of four partial sums, `rest` in the place of the first."""
    s = [builder.extract_element(vector, ir.Constant(ir.IntType(32), k)) for k in range(1, LANES)]
    return builder.fadd(builder.fadd(rest, s[0]), builder.fadd(s[1], s[2]))


class Sums:
    """Partial sums of several columns, added to one after the other: in vectors, then in numbers to the first."""

    def __init__(self, builder: Any, count: int) -> None:
        self._builder = builder
        self._vectors = [cgutils.alloca_once(builder, VECTOR) for _ in range(count)]
        self._numbers = [cgutils.alloca_once(builder, NUMBER) for _ in range(count)]
        for place in self._vectors:
            builder.store(ZERO, place)

    def begin_rest(self, *those: int) -> None:
        """Numbers follow, of all columns or of those."""
        for k in those or range(len(self._vectors)):
            whole = self._builder.load(self._vectors[k])
            self._builder.store(self._builder.extract_element(whole, ir.Constant(ir.IntType(32), 0)), self._numbers[k])

    def add(self, k: int, value: Any) -> None:
        """To those of column k."""
        place = (self._vectors if value.type is VECTOR else self._numbers)[k]
        self._builder.store(self._builder.fadd(self._builder.load(place), value), place)

    def total(self, k: int) -> Any:
        """Of column k."""
        return sum_of(self._builder, self._builder.load(self._vectors[k]), self._builder.load(self._numbers[k]))


def together(builder: Any, first: Any, last: Any) -> Iterator[list[Any]]:
    """Places first .. last-1, several at a time, in the loops that they are for."""
    for count in TOGETHER:
        step = ir.Constant(first.type, count)
        end = builder.sub(last, builder.srem(builder.sub(last, first), step))
        with cgutils.for_range_slice(builder, first, end, step, inc=True) as (at, _):
            yield [builder.add(at, ir.Constant(first.type, k)) for k in range(count)]
        first = end


def _reflect_together(builder: Any, v: Column, tau: Any, columns: list[Column], start: Any, stop: Any,
                      sized: bool) -> list[Any]:
    """`reflect` of these columns; their sums of squares if `sized`."""
    after = builder.add(start, ir.Constant(start.type, 1))
    sums, squares = Sums(builder, len(columns)), Sums(builder, len(columns))

    def multiply_columns(at: Any, kind: Any, counts: Any = None) -> None:
        given = v.load(at, kind)
        for k, column in enumerate(columns):
            product = builder.fmul(given, column.load(at, kind))
            sums.add(k, product if counts is None else builder.select(counts, product, ZERO))

    along_places(builder, multiply_columns, after, stop, sums.begin_rest)
    shares = []
    for k, column in enumerate(columns):
        head = column.load(start, NUMBER)
        shares.append(builder.fmul(tau, builder.fadd(head, sums.total(k))))
        column.store(start, builder.fsub(head, shares[-1]))
    spread = [filled(builder, each) for each in shares]

    def subtract_columns(at: Any, kind: Any, counts: Any = None) -> None:
        given, by = v.load(at, kind), spread if kind is VECTOR else shares
        old = [column.load(at, kind) for column in columns]
        new = [builder.fsub(each, builder.fmul(s, given)) for each, s in zip(old, by, strict=True)]
        for k, column in enumerate(columns):
            column.store(at, new[k] if counts is None else builder.select(counts, new[k], old[k]))
            if sized:
                square = builder.fmul(new[k], new[k])
                squares.add(k, square if counts is None else builder.select(counts, square, ZERO))

    along_places(builder, subtract_columns, after, stop, squares.begin_rest)
    return [squares.total(k) for k in range(len(columns))] if sized else []


def reflect_build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Of `lanes.reflect` and `lanes.reflect_sized`."""
    kinds, (v, tau, matrix, first, last, start, stop, *sized) = signature.args, arguments
    if kinds[2].ndim != 2 or kinds[2].layout != "C" or kinds[2].dtype != types.float64:
        raise TypeError(f"a matrix of doubles row after row is needed, not {kinds[2]}")
    builder.function.attributes.add("noinline")
    whole = context.make_array(kinds[2])(context, builder, matrix)
    length = cgutils.unpack_tuple(builder, whole.shape)[1]
    reflector = Column(context, builder, kinds[0], v)
    squares = Column(context, builder, kinds[7], sized[0]) if sized else None
    for places in together(builder, first, last):
        columns = [Column.of(builder, builder.gep(whole.data, [builder.mul(place, length)])) for place in places]
        found = _reflect_together(builder, reflector, tau, columns, start, stop, squares is not None)
        if squares is not None:
            for place, square in zip(places, found, strict=True):
                squares.store(place, square)
    return context.get_dummy_value()


def lagged_build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Of `lanes.lagged`."""
    builder.function.attributes.add("noinline")
    given, (a, b, first, last, n, sums) = signature.args, arguments
    ahead, behind, found = (Column(context, builder, kind, each)
                            for kind, each in zip((given[0], given[1], given[5]), (a, b, sums), strict=True))
    for places in together(builder, first, last):
        for place, total in zip(places, _lagged_together(builder, ahead, behind, places, n), strict=True):
            found.store(place, total)
    return context.get_dummy_value()


def _lagged_together(builder: Any, ahead: Column, behind: Column, lags: list[Any], n: Any) -> list[Any]:
    """Of lags that follow one another: what all have together in vectors, then what is left of each."""
    sums, zero = Sums(builder, len(lags)), ir.Constant(n.type, 0)

    def add(those: Iterable[int]) -> Callable[[Any, Any], None]:
        def work(at: Any, kind: Any) -> None:
            number = behind.load(at, kind)
            for k in those:
                sums.add(k, builder.fmul(ahead.load(builder.add(at, lags[k]), kind), number))

        return work

    shortest = builder.sub(n, lags[-1])
    common = builder.sub(shortest, builder.srem(shortest, ir.Constant(n.type, LANES)))
    along(builder, add(range(len(lags))), zero, common)
    for k, lag in enumerate(lags):
        along(builder, add((k,)), common, builder.sub(n, lag), partial(sums.begin_rest, k))
    return [sums.total(k) for k in range(len(lags))]
