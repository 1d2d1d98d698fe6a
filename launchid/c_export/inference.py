"""Infer kinds (C types) of a kernel's names and expressions from those of its arguments, as numba infers its types."""

import ast
import inspect
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from .folding import Fact, Facts
from .kinds import (
    FLOAT,
    INTEGER,
    TRUTH,
    VOID,
    Array,
    Kind,
    Known,
    Several,
    Struct,
    Untranslatable,
    join,
    kind_of,
    loosened,
)

if TYPE_CHECKING:
    from .kernel import Kernel
    from .program import Unit

INFERENCE_PASSES = 8   # a kernel whose kinds do not settle in so many has a variable that changes its kind
TESTS = ("np.isfinite", "np.isnan", "np.isinf")
MODULES = ("np", "math")
BY_HAND: dict[str, Kind] = {  # written in C by hand: seals, powers of two
    "seal_double": INTEGER, "seal_integer": INTEGER, "mixed": INTEGER, "fold_words": INTEGER, "fraction_of": FLOAT,
    "exponent_of": INTEGER, "scaled": FLOAT}


def of_module(node: ast.expr) -> bool:
    """Whether an expression is an attribute of numpy or math (`np.inf`, `math.sqrt`)."""
    return isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in MODULES


def is_unsigned(node: ast.expr) -> bool:
    """Whether an expression is a cast U(i) or np.uint64(i), which numba wants of an index and C does not need."""
    return isinstance(node, ast.Call) and ast.unparse(node.func) in ("U", "np.uint64")


def indices(node: ast.Subscript) -> list[ast.expr]:
    """Return the expressions between the brackets of a subscript: [i, j] for a[i, j]."""
    return list(node.slice.elts) if isinstance(node.slice, ast.Tuple) else [node.slice]


def whole_number(node: ast.expr) -> int:
    """Return the integer of an index that is a literal; raise Untranslatable for any other expression."""
    if isinstance(node, ast.Constant) and isinstance(node.value, int):
        return node.value
    raise Untranslatable(f"[{ast.unparse(node)}]: expected a whole number")


class Inference:
    """Kinds (C types) of one kernel's names and expressions, for one choice of kinds and facts of its arguments."""

    def __init__(self, unit: "Unit", tree: ast.FunctionDef, around: dict[str, Any], kinds: Sequence[Kind],
                 given: Sequence[Fact]) -> None:
        self.unit, self.globals = unit, around
        self.asked: set[Kernel] = set()
        names = [argument.arg for argument in tree.args.args]
        self.names: dict[str, Kind] = dict(zip(names, kinds, strict=True))
        self.facts = Facts(self, tree, dict(zip(names, given, strict=True)))
        self.result: Kind | None = None
        self.settled, self.kept = False, dict[int, tuple[ast.expr, Kind]]()
        for _ in range(INFERENCE_PASSES):
            before = dict(self.names), self.result
            self._read_all(tree.body)
            if before == (self.names, self.result):
                break
        else:
            raise Untranslatable(f"{tree.name}: the kinds of its variables do not settle")
        self.result, self.settled = self.result or VOID, True

    # ---- statements

    def alive(self, body: list[ast.stmt]) -> Iterator[ast.stmt]:
        """Yield the statements of a body that can run: for a decided `if` its branch, no loop without turns, nothing
        after a return.  They come one by one, so that each can be read before the next is decided."""
        for node in body:
            last: ast.stmt = node
            answer = self.facts.decided(node.test) if isinstance(node, ast.If) else None
            if isinstance(node, ast.If) and answer is not None:
                for last in self.alive(node.body if answer else node.orelse):
                    yield last
            elif not isinstance(node, ast.For) or self.facts.turns(node) != 0:
                if isinstance(node, ast.For) and self.settled and self.facts.turns(node) is not None:
                    begin = next(self.alive(node.body), None)  # what it does in its first turn ends it
                    last = begin if isinstance(begin, ast.Return) and isinstance(begin.value, ast.Constant) else node
                yield last
            if isinstance(last, ast.Return):
                return

    def result_of(self, call: ast.Call) -> Fact:
        """Return the number that a kernel's call gives, if known before flight and the call has no effect; else
        None."""
        name = ast.unparse(call.func)
        if name in BY_HAND or name in ("min", "max"):
            return None
        return self.called(call).answer

    def called(self, call: ast.Call) -> "Kernel":
        """Return the kernel that a call names, translated for the kinds of its arguments, and add it to `asked`."""
        kernel = self.unit.kernel(self.outside(call.func), [loosened(self.of(argument)) for argument in call.args],
                                  lambda: [self.facts(argument) for argument in call.args])
        self.asked.add(kernel)
        return kernel

    def _read_all(self, body: list[ast.stmt]) -> None:
        for statement in self.alive(body):
            self._read(statement)

    def _read(self, node: ast.stmt) -> None:
        if isinstance(node, ast.Assign):
            kind = self.of(node.value)
            for target in node.targets:
                self._bind(target, kind)
        elif isinstance(node, ast.AugAssign):
            kind = self.of(ast.BinOp(node.target, node.op, node.value))
            if isinstance(node.target, ast.Name):
                self._bind(node.target, kind)
        elif isinstance(node, ast.Return):
            kind = VOID if node.value is None else self.of(node.value)
            self.result = join(self.result, kind)
        elif isinstance(node, ast.Expr):
            if not isinstance(node.value, ast.Constant):
                self.of(node.value)
        elif isinstance(node, (ast.For, ast.If)):
            self._read_block(node)
        elif not isinstance(node, (ast.Break, ast.Continue, ast.Pass)):
            raise Untranslatable(f"line {node.lineno}: no C for {type(node).__name__}")

    def _read_block(self, node: ast.For | ast.If) -> None:
        if isinstance(node, ast.If):
            self.of(node.test)
        else:
            if not (isinstance(node.iter, ast.Call) and ast.unparse(node.iter.func) == "range") or node.orelse:
                raise Untranslatable(f"line {node.lineno}: a loop over {ast.unparse(node.iter)}: expected range(...)")
            for argument in node.iter.args:
                self.of(argument)
            self._bind(node.target, INTEGER)
        self._read_all(node.body)
        self._read_all(node.orelse)

    def _bind(self, target: ast.expr, kind: Kind) -> None:
        if isinstance(target, ast.Name):
            joined = join(self.names.get(target.id), loosened(kind))
            assert joined is not None
            self.names[target.id] = joined
        elif isinstance(target, ast.Tuple):
            if not isinstance(kind, Several):
                raise Untranslatable(f"line {target.lineno}: {ast.unparse(target)} from one value")
            for each, part in zip(target.elts, kind.kinds, strict=True):
                self._bind(each, part)

    # ---- expressions

    def of(self, node: ast.expr) -> Kind:
        """Return the kind (C type) of an expression; raise Untranslatable if it has none in C."""
        if id(node) in self.kept:
            return self.kept[id(node)][1]
        reader: Callable[[Any], Kind] | None = getattr(self, f"_of_{type(node).__name__.lower()}", None)
        if reader is None:
            raise Untranslatable(f"no C for {ast.unparse(node)}")
        kind = reader(node)
        if self.settled:
            self.kept[id(node)] = node, kind
        return kind

    def _of_constant(self, node: ast.Constant) -> Kind:
        return kind_of(node.value)

    def _of_name(self, node: ast.Name) -> Kind:
        return self.names[node.id] if node.id in self.names else kind_of(self.globals[node.id])

    def outside(self, node: ast.expr) -> Any:
        """Return the object that a name (`PERIOD`) or a module's attribute (`rb.PERIOD`) is in the kernel's module."""
        if isinstance(node, ast.Attribute):
            assert isinstance(node.value, ast.Name)
            return getattr(self.globals[node.value.id], node.attr)
        assert isinstance(node, ast.Name)
        return self.globals[node.id]

    def of_neighbour(self, node: ast.expr) -> bool:
        """Whether an expression is an attribute of a module that the kernel's module imports (`rb.PERIOD`)."""
        return (isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
                and node.value.id not in self.names and inspect.ismodule(self.globals.get(node.value.id)))

    def _of_attribute(self, node: ast.Attribute) -> Kind:
        if of_module(node):
            return FLOAT
        if self.of_neighbour(node):
            return kind_of(self.outside(node))
        kind = self.of(node.value)
        if isinstance(kind, Array) and node.attr == "shape":
            return Several((INTEGER,) * kind.dimensions)
        if not isinstance(kind, Struct):
            raise Untranslatable(f"{ast.unparse(node)}: {ast.unparse(node.value)} has no fields")
        field = kind.field(node.attr)
        if isinstance(field, Array) and field.dimensions == 0:
            return field.element
        return INTEGER if isinstance(field, Known) else field

    def _of_tuple(self, node: ast.Tuple) -> Kind:
        return Several(tuple(self.of(each) for each in node.elts))

    def _of_binop(self, node: ast.BinOp) -> Kind:
        both = join(self.of(node.left), self.of(node.right))
        if isinstance(node.op, ast.Div):
            return FLOAT
        assert both is not None
        return INTEGER if both == TRUTH else both

    def _of_unaryop(self, node: ast.UnaryOp) -> Kind:
        kind = self.of(node.operand)
        return TRUTH if isinstance(node.op, ast.Not) else INTEGER if kind == TRUTH else kind

    def _of_compare(self, node: ast.Compare) -> Kind:
        is_absence = isinstance(node.ops[0], ast.Is | ast.IsNot)
        for each in (node.left,) if is_absence else (node.left, *node.comparators):
            self.of(each)
        return TRUTH

    def _of_boolop(self, node: ast.BoolOp) -> Kind:
        if any(self.of(each) not in (TRUTH, INTEGER) for each in node.values):  # Python's would be the last number
            raise Untranslatable(f"{ast.unparse(node)}: expected truth values or counts")
        return TRUTH

    def _of_ifexp(self, node: ast.IfExp) -> Kind:
        self.of(node.test)
        kind = join(self.of(node.body), self.of(node.orelse))
        assert kind is not None
        return kind

    def _of_subscript(self, node: ast.Subscript) -> Kind:
        kind, at = self.of(node.value), indices(node)
        if isinstance(kind, Several):
            return kind.kinds[whole_number(at[0])] if isinstance(at[0], ast.Constant) else kind.kinds[0]
        if isinstance(kind, Struct) and kind.placed:
            return kind
        if not isinstance(kind, Array):
            raise Untranslatable(f"{ast.unparse(node)}: {ast.unparse(node.value)} is no array")
        for each in at:
            if not isinstance(each, ast.Slice):
                self.of(each)
        kept = kind.dimensions - sum(not isinstance(each, ast.Slice) for each in at)
        return Array(kind.element, kept, constant=kind.constant) if kept else kind.element

    def _of_call(self, node: ast.Call) -> Kind:
        name = ast.unparse(node.func)
        if is_unsigned(node):
            return self.of(node.args[0])
        if isinstance(node.func, ast.Attribute) and node.func.attr == "reshape":
            kind, shape = self.of(node.func.value), node.args[0]
            assert isinstance(kind, Array) and isinstance(shape, ast.Tuple)
            return Array(kind.element, len(shape.elts), constant=kind.constant)
        if name in TESTS:
            return TRUTH
        if of_module(node.func) or name == "float":
            return FLOAT
        if name in BY_HAND:
            return BY_HAND[name]
        if name in ("int", "len"):
            return INTEGER
        if name in ("min", "max", "abs"):
            joined: Kind | None = None
            for argument in node.args:
                joined = join(joined, self.of(argument))
            assert joined is not None
            return joined
        result = self.called(node).result
        assert result is not None
        return result
