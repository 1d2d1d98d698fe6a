"""Expressions of a kernel in C: the same operations in the same order, so the same bits.

Nothing is contracted or reordered (compile with -ffp-contract=off); `min` and `max` keep Python's answer to a NaN,
`%` and `//` its sign.
"""

import ast
from collections.abc import Callable, Sequence
from typing import Any

from .inference import SEALS, TESTS, Inference, indices, of_module, whole_number
from .kinds import (
    ABSENT,
    DIMENSIONS,
    FLOAT,
    TRUTH,
    Array,
    Kind,
    Several,
    Struct,
    Untranslatable,
    Whole,
    join,
    literal,
    loosened,
)

ATOM, UNARY, PRODUCT, SUM, ORDER, EQUALITY, AND, OR, CHOICE = 20, 14, 13, 12, 10, 9, 5, 4, 3   # how tightly they bind
SYMBOLS = {ast.Mult: ("*", PRODUCT), ast.Div: ("/", PRODUCT), ast.Add: ("+", SUM), ast.Sub: ("-", SUM)}
COMPARISONS = {ast.Lt: "<", ast.Gt: ">", ast.LtE: "<=", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
CONSTANTS = {"inf": "INFINITY", "nan": "NAN"}
FUNCTIONS = ("sqrt", "exp", "log", "sin", "cos", "erfc", "floor", "copysign")
TAKEN = {"double", "int", "auto", "register", "long", "short", "signed", "default", "case", "y0", "y1", "yn", "j0",
         "j1", "jn", "gamma", "index", "time", "static", "const"}   # names that C has given away
Code = tuple[str, int]


def word(name: str) -> str:
    """A Python name in C."""
    return f"{name}_" if name in TAKEN else name


def refuse_negative(node: ast.expr | None) -> None:
    """An index that is written negative counts from the end in Python."""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        raise Untranslatable(f"{ast.unparse(node)}: expected no index from the end here")


class Expressions:
    """Of one kernel.  arrays: local tuples that are indexed by a variable, in C arrays."""

    def __init__(self, unit: Whole, kinds: Inference, module: str, arrays: Sequence[str]) -> None:
        self.unit, self.kinds, self.module, self.arrays = unit, kinds, module, arrays

    def __call__(self, node: ast.expr, tightness: int = 0) -> str:
        """C of an expression, in brackets if it binds less tightly."""
        writer: Callable[[Any], Code] | None = getattr(self, f"_{type(node).__name__.lower()}", None)
        if writer is None:
            raise Untranslatable(f"no C for {ast.unparse(node)}")
        code, binds = writer(node)
        return f"({code})" if binds < tightness else code

    def turned(self, node: ast.expr, kind: Kind | None, tightness: int = 0) -> str:
        """C of an expression that becomes a double where this kind is one."""
        if kind == FLOAT and self.kinds.of(node) != FLOAT:
            code = f"(double){self(node, UNARY)}"
            return f"({code})" if tightness > UNARY else code
        return self(node, tightness)

    def listed(self, nodes: Sequence[ast.expr]) -> str:
        """Separated by commas."""
        return ", ".join(self(node) for node in nodes)

    def _constant(self, node: ast.Constant) -> Code:
        return literal(node.value), ATOM

    def _name(self, node: ast.Name) -> Code:
        if node.id in self.kinds.names:
            return word(node.id), ATOM
        return self.unit.constant(self.module, node.id, self.kinds.globals[node.id]), ATOM

    def _attribute(self, node: ast.Attribute) -> Code:
        if of_module(node):
            return CONSTANTS[node.attr], ATOM
        if self.kinds.of_neighbour(node):
            module = self.kinds.globals[node.value.id].__name__  # type: ignore[attr-defined]
            return self.unit.constant(module, node.attr, self.kinds.outside(node)), ATOM
        kind = self.kinds.of(node)
        if isinstance(kind, Struct):
            return f"&{self.member(node)}", UNARY
        pointer, extents = self.array(node)
        assert isinstance(kind, Array)
        return f"({kind.c}){{{pointer}, {', '.join(extents)}}}", ATOM

    def member(self, node: ast.expr) -> str:
        """C of a struct's member, or of a struct, as a place."""
        assert isinstance(node, ast.Attribute)
        base = node.value
        return f"{word(base.id)}->{node.attr}" if isinstance(base, ast.Name) else f"{self.member(base)}.{node.attr}"

    def array(self, node: ast.expr) -> tuple[str, list[str]]:
        """C of an array's first number's address, and of its extents."""
        kind = self.kinds.of(node)
        assert isinstance(kind, Array)
        if kind.extents:
            pointer = self.member(node)
            return f"({kind.element.c} *){pointer}" if kind.constant else pointer, [str(n) for n in kind.extents]
        base = self(node, ATOM)
        return f"{base}.p", [f"{base}.{d}" for d in DIMENSIONS[:kind.dimensions]]

    def _tuple(self, node: ast.Tuple) -> Code:
        return f"({self.unit.c(self.kinds.of(node))}){{{self.listed(node.elts)}}}", ATOM

    def _binop(self, node: ast.BinOp) -> Code:
        if isinstance(node.op, (ast.Mod, ast.FloorDiv)):
            if self.kinds.of(node) == FLOAT:
                raise Untranslatable(f"{ast.unparse(node)}: expected integers")
            name = "modulo" if isinstance(node.op, ast.Mod) else "quotient"
            return f"{name}({self.listed([node.left, node.right])})", ATOM
        if type(node.op) not in SYMBOLS:
            raise Untranslatable(f"{ast.unparse(node)}: expected one of + - * / // %")
        symbol, tightness = SYMBOLS[type(node.op)]
        kind = self.kinds.of(node)
        left, right = self.turned(node.left, kind, tightness), self.turned(node.right, kind, tightness + 1)
        return f"{left} {symbol} {right}", tightness

    def _unaryop(self, node: ast.UnaryOp) -> Code:
        return ("!" if isinstance(node.op, ast.Not) else "-") + self(node.operand, UNARY + 1), UNARY

    def _compare(self, node: ast.Compare) -> Code:
        if isinstance(node.ops[0], ast.In):
            among = node.comparators[0]
            assert isinstance(among, ast.Tuple)
            left = self(node.left, EQUALITY + 1)
            return " || ".join(f"{left} == {self(each, EQUALITY + 1)}" for each in among.elts), OR
        parts, left_node = [], node.left
        for op, right_node in zip(node.ops, node.comparators, strict=True):
            if type(op) not in COMPARISONS:
                raise Untranslatable(f"{ast.unparse(node)}: expected a comparison of numbers")
            symbol = COMPARISONS[type(op)]
            tightness = (EQUALITY if symbol in ("==", "!=") else ORDER) + 1
            kind = join(self.kinds.of(left_node), self.kinds.of(right_node))
            left, right = (self.turned(each, kind, tightness) for each in (left_node, right_node))
            parts.append(f"{left} {symbol} {right}")
            left_node = right_node
        return " && ".join(parts), EQUALITY if len(parts) == 1 else AND

    def _boolop(self, node: ast.BoolOp) -> Code:
        symbol, tightness = ("&&", AND) if isinstance(node.op, ast.And) else ("||", OR)
        return f" {symbol} ".join(self(each, AND + 1) for each in node.values), tightness

    def _ifexp(self, node: ast.IfExp) -> Code:
        kind = self.kinds.of(node)
        this, that = (self.turned(each, kind, OR) for each in (node.body, node.orelse))
        return f"{self(node.test, OR)} ? {this} : {that}", CHOICE

    # ---- arrays

    def _subscript(self, node: ast.Subscript) -> Code:
        kind, at = self.kinds.of(node.value), indices(node)
        if isinstance(kind, Several):
            return self._of_several(node.value, at[0]), ATOM
        assert isinstance(kind, Array)
        if any(isinstance(each, ast.Slice) for each in at):
            return self.piece(node), ATOM
        if len(at) == kind.dimensions:
            base = self.member(node.value) if kind.extents else f"{self(node.value, ATOM)}.p"
            return f"{base}[{self.offset(node)}]", ATOM
        pointer, extents = self.array(node.value)
        rest = Array(kind.element, kind.dimensions - len(at))
        inner, shape = " * ".join(extents[len(at):]), ", ".join(extents[len(at):])
        return f"({rest.c}){{{pointer} + {self._bracketed(self.offset(node))} * {inner}, {shape}}}", ATOM

    def _of_several(self, value: ast.expr, at: ast.expr) -> str:
        if isinstance(value, ast.Attribute) and value.attr == "shape":
            return self.array(value.value)[1][whole_number(at)]
        if isinstance(value, ast.Name) and value.id in self.arrays:
            return f"{word(value.id)}[{self(at)}]"
        if isinstance(value, ast.Name) and value.id not in self.kinds.names:
            refuse_negative(at)
            return f"{self(value)}.p[{self(at)}]"
        return f"{self(value, ATOM)}.v{whole_number(at)}"

    @staticmethod
    def _bracketed(code: str) -> str:
        return code if code.replace("_", "").isalnum() else f"({code})"

    def offset(self, node: ast.Subscript) -> str:
        """Of an element, or of a row or layer in rows or layers, from the array's begin."""
        (_, extents), code = self.array(node.value), ""
        for extent, each in zip(extents, indices(node), strict=False):
            one = self._place(each, extent)
            code = f"{self._bracketed(code)} * {extent} + {one}" if code else one
        return code

    def _place(self, at: ast.expr, extent: str) -> str:
        """An index; one that is written negative counts from the end."""
        if isinstance(at, ast.UnaryOp) and isinstance(at.op, ast.USub):
            return f"{extent} - {whole_number(at.operand)}"
        return self(at, SUM)

    def piece(self, node: ast.Subscript) -> str:
        """A part of a vector."""
        kind = self.kinds.of(node)
        assert isinstance(kind, Array)
        begin, length = self._ends(node)
        return f"({kind.c}){{{begin}, {length}}}"

    def _ends(self, node: ast.Subscript) -> tuple[str, str]:
        """Where a part of a vector begins, and how long it is."""
        at, (pointer, extents) = indices(node), self.array(node.value)
        if len(at) != 1 or not isinstance(at[0], ast.Slice) or at[0].step is not None:
            raise Untranslatable(f"{ast.unparse(node)}: expected a part of a vector")
        low, high = at[0].lower, at[0].upper
        for each in (low, high):
            refuse_negative(each)
        end = extents[0] if high is None else self(high, SUM)
        if low is None:
            return pointer, end
        if isinstance(high, ast.BinOp) and isinstance(high.op, ast.Add) and ast.dump(high.left) == ast.dump(low):
            return f"{pointer} + {self(low, SUM)}", self(high.right)
        return f"{pointer} + {self(low, SUM)}", f"{end} - {self(low, PRODUCT)}"

    # ---- calls

    def _call(self, node: ast.Call) -> Code:
        name = ast.unparse(node.func)
        if isinstance(node.func, ast.Attribute) and node.func.attr == "reshape":
            return self._reshaped(node, node.func.value), ATOM
        if name in TESTS:
            return f"{name.removeprefix('np.')}({self.listed(node.args)})", ATOM
        if isinstance(node.func, ast.Attribute) and of_module(node.func):
            if node.func.attr not in FUNCTIONS:
                raise Untranslatable(f"{name}: expected one of {', '.join(FUNCTIONS)}")
            return f"{node.func.attr}({self.listed(node.args)})", ATOM
        if name in SEALS:
            return f"{name}({self.listed(node.args)})", ATOM
        if name in ("int", "float"):
            return self._cast(node, "int64_t" if name == "int" else "double")
        if name == "len":
            return self._length(node.args[0]), ATOM
        if name in ("abs", "min", "max"):
            return self._extreme(name, node), ATOM
        called, kinds = self.kinds.outside(node.func), [loosened(self.kinds.of(each)) for each in node.args]
        if isinstance(called, type):
            return f"({self.unit.c(self.kinds.of(node))}){{{self.listed(node.args)}}}", ATOM
        given = [each for each, kind in zip(node.args, kinds, strict=True) if kind != ABSENT]
        return f"{self.unit.kernel(called, kinds).name}({self.listed(given)})", ATOM

    def _cast(self, node: ast.Call, c: str) -> Code:
        argument = node.args[0]
        if isinstance(argument, ast.Constant) and isinstance(argument.value, str):
            return literal(float(argument.value)), ATOM
        if self.kinds.of(argument) == TRUTH:  # C's tests promise no 1
            return f"({c})({self(argument, EQUALITY + 1)} != 0)", UNARY
        return f"({c}){self(argument, UNARY)}", UNARY

    def _length(self, node: ast.expr) -> str:
        if isinstance(node, ast.Name) and node.id not in self.kinds.names:
            return literal(len(self.kinds.globals[node.id]))
        return self.array(node)[1][0]

    def _extreme(self, name: str, node: ast.Call) -> str:
        kind = self.kinds.of(node)
        of = "double" if kind == FLOAT else "integer"
        if name == "abs":
            return f"{'fabs' if of == 'double' else 'llabs'}({self(node.args[0])})"
        code = self.turned(node.args[0], kind)
        for each in node.args[1:]:
            code = f"{name}_{of}({code}, {self.turned(each, kind)})"
        return code

    def _reshaped(self, node: ast.Call, inner: ast.expr) -> str:
        kind, shape = self.kinds.of(node), node.args[0]
        assert isinstance(kind, Array) and isinstance(shape, ast.Tuple)
        begin = self._ends(inner)[0] if isinstance(inner, ast.Subscript) else self.array(inner)[0]
        return f"({kind.c}){{{begin}, {self.listed(shape.elts)}}}"
