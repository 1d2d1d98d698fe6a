"""Kinds of a kernel's values, and their C types.

A kernel's values are numbers, truth values, contiguous arrays of up to three dimensions, named tuples of these (a C
struct, passed by its address) and, as results, plain tuples.  An integer in a named tuple is known before flight (how
much of the memory is in use): C has its number where it is used.
"""

import math
import re
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sim.errors import UsageError


@dataclass(frozen=True)
class Scalar:
    """Kind of a number or a truth value; c: its C type."""

    c: str


FLOAT = Scalar("double")
INTEGER = Scalar("int64_t")
TRUTH = Scalar("bool")
VOID = Scalar("void")
DIMENSIONS = "nmk"     # how the C structs call the extents of an array
ELEMENTS = {"f": FLOAT, "i": INTEGER, "b": TRUTH}
TYPE_NAMES = {FLOAT: ("Vector", "Matrix", "Cube"), INTEGER: ("Integers", "IntegerMatrix", "IntegerCube"),
              TRUTH: ("Truths", "TruthMatrix", "TruthCube")}


@dataclass(frozen=True)
class Array:
    """Kind of a contiguous array.  extents: of a struct's own array, () if they vary; constant: never written to;
    value: its numbers, if they never change.  Of no dimensions: a number of a struct."""

    element: Scalar
    dimensions: int
    extents: tuple[int, ...] = ()
    constant: bool = False
    value: Any = field(default=None, compare=False, repr=False)

    @property
    def loose(self) -> "Array":
        """This kind without extents and value, as functions take an array."""
        return Array(self.element, self.dimensions, constant=self.constant)

    @property
    def c(self) -> str:
        return ("Const" if self.constant else "") + TYPE_NAMES[self.element][self.dimensions - 1]


def array_types(source: str) -> str:
    """Return the C typedefs of the array structs (Vector, ConstMatrix, ...) that a C source uses."""
    kinds = (Array(element, dimensions, constant=constant) for element in TYPE_NAMES
             for dimensions in range(1, len(DIMENSIONS) + 1) for constant in (False, True))
    return "".join(
        f"typedef struct {{ {'const ' if kind.constant else ''}{kind.element.c} *p; "
        f"{' '.join(f'int64_t {d};' for d in DIMENSIONS[:kind.dimensions])} }} {kind.c};\n"
        for kind in kinds if re.search(rf"\b{kind.c}\b", source))


@dataclass(frozen=True)
class Known:
    """Kind of an integer whose value is known before flight: C has the number in its place."""

    value: int


@dataclass(frozen=True)
class Struct:
    """Kind of a named tuple of type `of`: a C struct.  constant: never written to; placed: its fields are pointers."""

    of: type
    kinds: "tuple[Kind, ...]"
    constant: bool = False
    placed: bool = False

    @property
    def fields(self) -> tuple[str, ...]:
        return self.of._fields  # type: ignore[attr-defined, no-any-return]

    def field(self, name: str) -> "Kind":
        kind = self.kinds[self.fields.index(name)]
        if isinstance(kind, (Array, Struct)) and not self.placed:
            return replace(kind, constant=self.constant or kind.constant)
        return kind

    @property
    def is_known(self) -> bool:
        """Whether all fields are known before flight; then C has no such struct."""
        return all(isinstance(kind, Known) for kind in self.kinds)


@dataclass(frozen=True)
class Several:
    """Kind of a plain tuple, as kernels return it; kinds: of its elements."""

    kinds: "tuple[Kind, ...]"


Kind = Scalar | Known | Array | Struct | Several


class Untranslatable(UsageError):
    """Error: a kernel has a construct that this package cannot translate to C."""


def kind_of(value: Any) -> Kind:
    """Return the kind (C type) of a number, array or tuple; raise Untranslatable for any other value."""
    if isinstance(value, (bool, np.bool_)):
        return TRUTH
    if isinstance(value, (int, np.integer)):
        return INTEGER
    if isinstance(value, (float, np.floating)):
        return FLOAT
    if isinstance(value, np.ndarray) and value.dtype.kind in ELEMENTS and value.ndim <= len(DIMENSIONS):
        return Array(ELEMENTS[value.dtype.kind], value.ndim, constant=True)  # of a module
    if isinstance(value, tuple):
        kinds = tuple(kind_of(each) for each in value)
        return struct_of(value) if hasattr(value, "_fields") else Several(kinds)
    raise Untranslatable(f"a {type(value).__name__} in a kernel: expected a number, an array or a tuple of these")


def struct_of(value: Any, constant: bool = False) -> Struct:
    """Return the kind of a named tuple of integers (`Known`), arrays with extents (values if `constant`), tuples."""
    kinds: list[Kind] = []
    for each in value:
        if isinstance(each, int):
            kinds.append(Known(each))
        elif isinstance(each, np.ndarray):
            kinds.append(Array(ELEMENTS[each.dtype.kind], each.ndim, each.shape, constant, each if constant else None))
        else:
            kinds.append(struct_of(each, constant))
    return Struct(type(value), tuple(kinds), constant)


def loosened(kind: Kind) -> Kind:
    """Return the kind that an argument or variable has for a value of this kind: arrays without extents and value."""
    if isinstance(kind, Array):
        return kind.loose
    return Several(tuple(map(loosened, kind.kinds))) if isinstance(kind, Several) else kind


def join(a: Kind | None, b: Kind | None) -> Kind | None:
    """Return the kind that holds both, as numba unifies them; None is neutral.  Untranslatable if no kind does."""
    if a is None or b is None or a == b:
        return b if a is None else a
    if isinstance(a, Scalar) and isinstance(b, Scalar) and VOID not in (a, b):
        return FLOAT if FLOAT in (a, b) else INTEGER
    if isinstance(a, Several) and isinstance(b, Several) and len(a.kinds) == len(b.kinds):
        return Several(tuple(_must(join(x, y)) for x, y in zip(a.kinds, b.kinds, strict=True)))
    raise Untranslatable(f"a variable that is {a} here and {b} there")


def _must(kind: Kind | None) -> Kind:
    assert kind is not None
    return kind


def literal(value: Any) -> str:
    """Return a number or truth value as a C literal with the same bits."""
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, (int, np.integer)):
        return str(int(value)) if abs(int(value)) < 2**31 else f"INT64_C({int(value)})"
    number = float(value)
    if math.isnan(number):
        return "(double)NAN"      # C's own is a float
    if math.isinf(number):
        return "(double)INFINITY" if number > 0 else "-(double)INFINITY"
    return repr(number)
