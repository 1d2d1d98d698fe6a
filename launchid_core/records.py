"""How a store, a named tuple of arrays, is held in compiled code: of each array its place and extents, no more.

numba's own named tuple holds of each array seven words or more (owner, count, size of a number, strides ..), and hands
all of them to every function that a store is passed to: up to 925 words a call, and most of what the compiler had to
read.  Here an array of a store is its first number's address and its extents; what else an array has follows from
those, since all are cut from one block (`memory`), one number after the other.  An attribute makes the array of them
again.  The operations on its numbers are the same, so are the bits; in plain Python a store is the named tuple that it
is.

Not part of what flies, as `parts`.
"""

import hashlib
from typing import Any, TypeVar

from numba import extending
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.core.typing import templates

_extending: Any = extending  # typed by numba only in part
_templates: Any = templates
ir: Any = cgutils.ir
Class = TypeVar("Class", bound=type)


class Place(types.Type):
    """Of an array that lies in one piece: where it begins, and its extents."""

    def __init__(self, array: Any) -> None:
        self.dtype, self.ndim = array.dtype, array.ndim
        super().__init__(f"place({self.dtype},{self.ndim})")


class Store(types.Type):
    """A named tuple class with the types of its members; each of its attributes is one."""

    def __init__(self, made: type, members: tuple[Any, ...]) -> None:
        self.fields: tuple[str, ...] = made._fields  # type: ignore[attr-defined]
        self.members = members
        digest = hashlib.sha256(",".join(map(str, members)).encode()).hexdigest()[:8]
        super().__init__(f"{made.__module__}.{made.__qualname__}.{digest}")


def _kept(kind: Any) -> Any:
    """What a store holds of a member of this type."""
    return Place(kind) if isinstance(kind, types.Array) and kind.layout == "C" and kind.aligned else kind


@_extending.register_model(Place)
class _PlaceModel(models.StructModel):
    def __init__(self, manager: Any, kind: Place) -> None:
        super().__init__(manager, kind, [("data", types.CPointer(kind.dtype)),
                                         ("shape", types.UniTuple(types.intp, kind.ndim))])


@_extending.register_model(Store)
class _StoreModel(models.StructModel):
    def __init__(self, manager: Any, kind: Store) -> None:
        super().__init__(manager, kind, list(zip(kind.fields, map(_kept, kind.members), strict=True)))


def _position(context: Any, kind: Any, field: str) -> Any:
    return context.data_model_manager[kind].get_field_position(field)


def _placed(context: Any, builder: Any, kind: Any, array: Any) -> Any:
    """Place of an array."""
    place = ir.Constant(context.get_value_type(Place(kind)), ir.Undefined)
    for k, field in enumerate(("data", "shape")):
        place = builder.insert_value(place, builder.extract_value(array, _position(context, kind, field)), k)
    return place


def _array(context: Any, builder: Any, kind: Any, place: Any) -> Any:
    """The array at a place."""
    whole, number = context.get_value_type(kind), context.get_value_type(types.intp)
    size = ir.Constant(number, kind.dtype.bitwidth // 8)
    data, shape = (builder.extract_value(place, k) for k in range(2))
    strides, count = [size], builder.extract_value(shape, kind.ndim - 1)
    for k in range(kind.ndim - 2, -1, -1):
        strides.insert(0, builder.mul(count, size))
        count = builder.mul(count, builder.extract_value(shape, k))
    at = {field: _position(context, kind, field) for field in ("nitems", "itemsize", "data", "shape", "strides")}
    given = [ir.Constant(each, None) for each in whole.elements]
    given[at["itemsize"]] = size
    given[at["strides"]] = ir.Constant(whole.elements[at["strides"]], [size] * kind.ndim)
    array = ir.Constant(whole, given)
    for field, value in (("nitems", count), ("data", data), ("shape", shape)):
        array = builder.insert_value(array, value, at[field])
    for k, stride in enumerate(strides[:-1]):
        array = builder.insert_value(array, stride, (at["strides"], k))
    return array


class _Attributes(_templates.AttributeTemplate):  # type: ignore[misc]
    key = Store

    def generic_resolve(self, kind: Store, name: str) -> Any:
        return kind.members[kind.fields.index(name)] if name in kind.fields else None


_templates.infer_getattr(_Attributes)


@_extending.lower_getattr_generic(Store)
def _attribute(context: Any, builder: Any, kind: Store, store: Any, name: str) -> Any:
    k = kind.fields.index(name)
    held, member = builder.extract_value(store, k), kind.members[k]
    return _array(context, builder, member, held) if isinstance(_kept(member), Place) else held


def _build(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    store = ir.Constant(context.get_value_type(signature.return_type), ir.Undefined)
    for k, (kind, value) in enumerate(zip(signature.args, arguments, strict=True)):
        held = _placed(context, builder, kind, value) if isinstance(_kept(kind), Place) else value
        store = builder.insert_value(store, held, k)
    return store


_classes: dict[type, Any] = {}
_usual = _extending.typeof_impl.dispatch(type)


@_extending.typeof_impl.register(type)
def _class_type(made: type, c: Any) -> Any:
    """Of a class that a kernel names."""
    return _classes.get(made) or _usual(made, c)


def store(made: Class) -> Class:
    """A named tuple class whose instances kernels make and take; it is returned as it is."""
    class Made(_templates.AbstractTemplate):  # type: ignore[misc]
        key = made

        def generic(self, args: Any, kws: Any) -> Any:
            members = tuple(types.unliteral(each) for each in args)
            return _templates.signature(Store(made, members), *members)

    _classes[made] = types.Function(Made)
    _extending.lower_builtin(made, types.VarArg(types.Any))(_build)
    return made
