"""Translate expressions of a kernel (compiled function of launchid_core) to C: the same operations, the same bits.

Nothing is contracted or reordered (compile with -ffp-contract=off); `min` and `max` keep Python's answer to a NaN, `%`
and `//` its sign.  Operators of different precedence stand in brackets, truth values are compared, not numbers, and
casts of sums are calls, as MISRA C:2012 asks (12.1, 14.4, 10.8).
"""

import ast
import inspect
import math
import re
import sys
from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from .folding import Fact, extents_of, walk
from .inference import BY_HAND, TESTS, Inference, indices, is_unsigned, of_module, whole_number
from .kinds import (
    DIMENSIONS,
    FLOAT,
    INTEGER,
    TRUTH,
    Array,
    Kind,
    Several,
    Struct,
    Untranslatable,
    join,
    literal,
)

if TYPE_CHECKING:
    from .kernel import Kernel
    from .program import Unit

# how tightly C's operators bind
ATOM = 20
UNARY = 14
PRODUCT = 13
SUM = 12
PRECEDENCE_OF_ORDER = 10
EQUALITY = 9
AND = 5
OR = 4
CHOICE = 3
SYMBOLS = {ast.Mult: ("*", PRODUCT), ast.Div: ("/", PRODUCT), ast.Add: ("+", SUM), ast.Sub: ("-", SUM)}
COMPARISONS = {ast.Lt: "<", ast.Gt: ">", ast.LtE: "<=", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}
C_CONSTANTS = {"inf": literal(math.inf), "nan": literal(math.nan)}
EXACT_FUNCTIONS = ("sqrt", "floor", "fmod", "copysign")  # exact, or rounded once, by definition
CORE = "launchid_core"
TAKEN = {"double", "int", "auto", "register", "long", "short", "signed", "default", "case", "y0", "y1", "yn", "j0",
         "j1", "jn", "gamma", "index", "time", "static", "const"}   # names that C has given away
Code = tuple[str, int]


@cache
def _of_kernels() -> frozenset[str]:
    """Return the names of the core's functions, which no variable may hide (MISRA C:2012, 5.3)."""
    modules = [module for name, module in sorted(sys.modules.items()) if name.startswith(f"{CORE}.")]
    return frozenset(name for module in modules for name, value in vars(module).items()
                     if inspect.isfunction(getattr(value, "py_func", value)))


def word(name: str) -> str:
    """Return the C identifier of a Python name: `_` is appended if C (TAKEN) or a function of the core has the name."""
    return f"{name}_" if name in TAKEN or name in _of_kernels() else name


def refuse_negative(node: ast.expr | None) -> None:
    """Raise Untranslatable if an index is written as a negative number, which counts from the end in Python."""
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        raise Untranslatable(f"{ast.unparse(node)}: expected no index from the end here")


def _bracketed(code: str) -> str:
    """Return the code in brackets if it has an operator (a blank) outside of brackets; else as it is."""
    depth = 0
    for letter in code:
        depth += (letter in "([{") - (letter in ")]}")
        if letter == " " and depth == 0:
            return f"({code})"
    return code


def times(code: str, extent: str) -> str:
    """Return C of the product code * extent; numbers are multiplied, factors 0 and 1 left out."""
    if code.isdigit() and extent.isdigit():
        return str(int(code) * int(extent))
    if code in ("0", "1"):
        return code if code == "0" else extent
    return code if extent == "1" else f"{_bracketed(code)} * {extent}"


def plus(code: str, more: str) -> str:
    """Return C of the sum code + more; numbers are added, a term 0 is left out."""
    if code.isdigit() and more.isdigit():
        return str(int(code) + int(more))
    if "0" in (code, more):
        return more if code == "0" else code
    return f"{_bracketed(code)} + {_bracketed(more)}"


def less(code: str, by: str) -> str:
    """Return C of the difference code - by, as one number if both are numbers."""
    return str(int(code) - int(by)) if code.isdigit() and by.isdigit() else f"{code} - {by}"


def address(pointer: str, offset: str) -> str:
    """Return C of the address of element `offset` of the array that begins at `pointer`."""
    return pointer if offset == "0" else f"&{pointer}[{offset}]"


class Expressions:
    """Writer of one kernel's expressions (AST nodes) as C text.  arrays: local tuples that become C arrays, because a
    variable indexes them."""

    def __init__(self, unit: "Unit", kinds: Inference, module: str, arrays: Sequence[str]) -> None:
        self.unit, self.kinds, self.module, self.arrays = unit, kinds, module, arrays
        self.calls: list[tuple[Kernel, list[Fact]]] = []

    def __call__(self, node: ast.expr, tightness: int = 0) -> str:
        """Return C of an expression, in brackets if it binds less than `tightness`."""
        return self._bound(self._code(node), tightness)

    def _code(self, node: ast.expr) -> Code:
        writer: Callable[[Any], Code] | None = getattr(self, f"_{type(node).__name__.lower()}", None)
        if writer is None:
            raise Untranslatable(f"no C for {ast.unparse(node)}")
        number = self._known(node)
        if number is None:
            return writer(node)
        code = literal(number)
        return code, UNARY if code[0] == "-" else ATOM

    def _known(self, node: ast.expr) -> int | bool | None:
        """Return the integer or truth value of an expression if known before flight; None also for an expression of
        literals and module constants alone, which is better read as it is written."""
        if isinstance(node, (ast.Constant, ast.Tuple)) or self.kinds.of(node) not in (INTEGER, TRUTH):
            return None
        if not isinstance(node, (ast.Compare, ast.BoolOp, ast.IfExp)) and self._is_named(node):
            return None
        number = self.kinds.facts.number(node)
        return None if number is None else bool(number) if self.kinds.of(node) == TRUTH else int(number)

    def _is_named(self, node: ast.expr) -> bool:
        """Whether an expression consists of literals and constants of modules alone."""
        return all(isinstance(each, (ast.Constant, ast.operator, ast.unaryop, ast.BinOp, ast.UnaryOp, ast.expr_context))
                   or (isinstance(each, ast.Attribute) and self.kinds.of_neighbour(each))
                   or (isinstance(each, ast.Name) and each.id not in self.kinds.names) for each in walk(node))

    @staticmethod
    def _bound(code: Code, tightness: int) -> str:
        """Return the code in brackets if it binds less than `tightness`, or differently (MISRA); else as it is."""
        text, binds = code
        clear = binds >= UNARY or tightness == 0
        return text if binds >= tightness and (clear or binds == tightness) else f"({text})"

    def turned(self, node: ast.expr, kind: Kind | None, tightness: int = 0) -> str:
        """Return C of an expression, cast to double if `kind` is FLOAT; in brackets if it binds less than tightness."""
        of = self.kinds.of(node)
        if kind != FLOAT or of == FLOAT:
            return self(node, tightness)
        if isinstance(node, ast.Constant):
            return literal(float(node.value))  # type: ignore[arg-type]
        return self._bound(self._cast("double", self._code(node), of), tightness)

    @staticmethod
    def _cast(c: str, code: Code, of: Kind) -> Code:
        """Return C cast to type `c`; by a function for more than one value: a cast would widen the sum, not terms."""
        if of == TRUTH:
            inner = f"counted({code[0]})"
            return (inner, ATOM) if c == "int64_t" else (f"(double){inner}", UNARY)
        if code[1] == ATOM:
            return f"({c}){code[0]}", UNARY
        return f"{'as_real' if c == 'double' else 'as_whole'}({code[0]})", ATOM

    def truth(self, node: ast.expr, tightness: int = 0) -> str:
        """Return C of a condition, an integer as `n != 0`; in brackets if it binds less than `tightness`."""
        if self.kinds.of(node) == INTEGER:
            return self._bound((f"{self(node, UNARY)} != 0", EQUALITY), tightness)
        return self(node, tightness)

    def listed(self, nodes: Sequence[ast.expr]) -> str:
        """Return C of the expressions separated by commas, as arguments or an initialiser have them."""
        return ", ".join(self(node) for node in nodes)

    def _constant(self, node: ast.Constant) -> Code:
        code = literal(node.value)
        return code, UNARY if code[0] in "-(" else ATOM

    def _name(self, node: ast.Name) -> Code:
        if node.id in self.kinds.names:
            return word(node.id), ATOM
        return self.unit.constant(self.module, node.id, self.kinds.globals[node.id]), ATOM

    def _attribute(self, node: ast.Attribute) -> Code:
        if of_module(node):
            return C_CONSTANTS[node.attr], UNARY
        if self.kinds.of_neighbour(node):
            module = self.kinds.globals[node.value.id].__name__  # type: ignore[attr-defined]
            return self.unit.constant(module, node.attr, self.kinds.outside(node)), ATOM
        kind = self.kinds.of(node)
        if isinstance(kind, Struct):
            return (self.member(node), ATOM) if self._is_placed(node.value) else (f"&{self.member(node)}", UNARY)
        if not isinstance(kind, Array):  # a number of the struct
            return self.member(node), ATOM
        pointer, extents = self.array(node)
        return f"({kind.c}){{{pointer}, {', '.join(extents)}}}", ATOM

    def member(self, node: ast.expr) -> str:
        """Return C of an attribute of a named tuple as a member of its struct, `a->b.c`, to read or to assign."""
        assert isinstance(node, ast.Attribute)
        base = node.value
        if isinstance(base, ast.Subscript) and isinstance(base.value, ast.Name):  # block[0]
            base = base.value
        if isinstance(base, ast.Name):
            return f"{word(base.id)}->{node.attr}"
        assert isinstance(base, ast.Attribute)
        return f"{self.member(base)}{'->' if self._is_placed(base.value) else '.'}{node.attr}"

    def _is_placed(self, node: ast.expr) -> bool:
        """Whether the expression is a struct whose fields are pointers."""
        kind = self.kinds.of(node)
        return isinstance(kind, Struct) and kind.placed

    def array(self, node: ast.expr) -> tuple[str, list[str]]:
        """Return C of the address of an array's first element, and C of each of its extents."""
        kind = self.kinds.of(node)
        assert isinstance(kind, Array)
        if kind.extents:
            return self.member(node), [str(n) for n in kind.extents]
        base = self(node, ATOM)
        extents = extents_of(self.kinds.facts(node), kind.dimensions)
        return f"{base}.p", [f"{base}.{d}" if n is None else str(n) for d, n in zip(DIMENSIONS, extents, strict=False)]

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
        if kind == INTEGER and isinstance(node.op, (ast.Mult, ast.Add)):
            neutral = int(isinstance(node.op, ast.Mult))
            for part, other in ((node.left, node.right), (node.right, node.left)):
                if self.kinds.facts.number(part) == neutral:
                    return self._code(other)
        if kind == INTEGER and isinstance(node.op, ast.Sub) and self.kinds.facts.number(node.right) == 0:
            return self._code(node.left)
        left, right = self.turned(node.left, kind, tightness), self.turned(node.right, kind, UNARY)
        return f"{left} {symbol} {right}", tightness

    def _unaryop(self, node: ast.UnaryOp) -> Code:
        if isinstance(node.op, ast.Not):
            return f"!{self.truth(node.operand, UNARY + 1)}", UNARY
        return f"-{self(node.operand, UNARY + 1)}", UNARY

    def _compare(self, node: ast.Compare) -> Code:
        if isinstance(node.ops[0], ast.In):
            among = node.comparators[0]
            assert isinstance(among, ast.Tuple)
            left = self(node.left, UNARY)
            return " || ".join(f"({left} == {self(each, UNARY)})" for each in among.elts), OR
        parts, left_node = [], node.left
        for op, right_node in zip(node.ops, node.comparators, strict=True):
            if type(op) not in COMPARISONS:
                raise Untranslatable(f"{ast.unparse(node)}: expected a comparison of numbers")
            symbol = COMPARISONS[type(op)]
            kind = join(self.kinds.of(left_node), self.kinds.of(right_node))
            left, right = (self.turned(each, kind, UNARY) for each in (left_node, right_node))
            parts.append(f"{left} {symbol} {right}")
            left_node = right_node
        return (parts[0], EQUALITY) if len(parts) == 1 else (" && ".join(f"({part})" for part in parts), AND)

    def _boolop(self, node: ast.BoolOp) -> Code:
        symbol, tightness = ("&&", AND) if isinstance(node.op, ast.And) else ("||", OR)
        undecided = self.kinds.facts.undecided(node)
        if len(undecided) == 1:
            code = self.truth(undecided[0])
            return code, ATOM if code.isidentifier() else tightness
        return f" {symbol} ".join(self.truth(each, UNARY) for each in undecided), tightness

    def _ifexp(self, node: ast.IfExp) -> Code:
        kind, test = self.kinds.of(node), self.kinds.facts.number(node.test)
        if test is not None:
            code = self.turned(node.body if test else node.orelse, kind)
            return code, ATOM if re.fullmatch(r"[\w.>-]*", code) else 0
        this, that = (self._branch(each, kind) for each in (node.body, node.orelse))
        return f"{self.truth(node.test, UNARY)} ? {this} : {that}", CHOICE

    def _branch(self, node: ast.expr, kind: Kind) -> str:
        """Return C of a branch of `a if test else b`; a literal integer is cast to int64_t (MISRA C:2012, 10.6)."""
        code = self.turned(node, kind, UNARY)
        return f"(int64_t){code}" if kind == INTEGER and isinstance(node, ast.Constant) else code

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
        rest = Array(kind.element, kind.dimensions - len(at), constant=kind.constant)
        begin = self.offset(node)
        for extent in extents[len(at):]:
            begin = times(begin, extent)
        return f"({rest.c}){{{address(pointer, begin)}, {', '.join(extents[len(at):])}}}", ATOM

    def _of_several(self, value: ast.expr, at: ast.expr) -> str:
        if isinstance(value, ast.Attribute) and value.attr == "shape":
            return self.array(value.value)[1][whole_number(at)]
        if isinstance(value, ast.Name) and value.id in self.arrays:
            return f"{word(value.id)}[{self(at)}]"
        if isinstance(value, ast.Name) and value.id not in self.kinds.names:
            refuse_negative(at)
            return f"{self(value)}.p[{self(at)}]"
        return f"{self(value, ATOM)}.v{whole_number(at)}"

    def offset(self, node: ast.Subscript) -> str:
        """Return C of the offset of a[i, j] from the begin of a; in rows or layers if a has further dimensions."""
        (_, extents), code = self.array(node.value), "0"
        for extent, each in zip(extents, indices(node), strict=False):
            code = plus(times(code, extent), self._place(each, extent))
        return code

    def _place(self, at: ast.expr, extent: str) -> str:
        """Return C of an index; a negative literal counts from the end of `extent`."""
        if isinstance(at, ast.UnaryOp) and isinstance(at.op, ast.USub):
            return less(extent, str(whole_number(at.operand)))
        return self(at, SUM)

    def piece(self, node: ast.Subscript) -> str:
        """Return C of a slice a[i:j] of a vector, or of rows i to j of a matrix, as an array that shares a's memory."""
        kind = self.kinds.of(node)
        assert isinstance(kind, Array)
        begin, length = self._ends(node)
        rest = self.array(node.value)[1][1:]
        return f"({kind.c}){{{', '.join([begin, length, *rest])}}}"

    def _ends(self, node: ast.Subscript) -> tuple[str, str]:
        """Return C of the address where a slice a[i:j] begins, and of its length."""
        at, (pointer, extents) = indices(node), self.array(node.value)
        if len(at) != 1 or not isinstance(at[0], ast.Slice) or at[0].step is not None:
            raise Untranslatable(f"{ast.unparse(node)}: expected a part of a vector")
        low, high = at[0].lower, at[0].upper
        for each in (low, high):
            refuse_negative(each)
        end = extents[0] if high is None else self(high, SUM)
        if low is None:
            return pointer, end
        first = self(low, SUM)
        for extent in extents[1:]:
            first = times(first, extent)
        begin = address(pointer, first)
        if isinstance(high, ast.BinOp) and isinstance(high.op, ast.Add) and ast.dump(high.left) == ast.dump(low):
            return begin, self(high.right)
        return begin, less(end, self(low, UNARY))

    # ---- calls

    def _call(self, node: ast.Call) -> Code:
        name = ast.unparse(node.func)
        if is_unsigned(node):
            return self._code(node.args[0])
        if isinstance(node.func, ast.Attribute) and node.func.attr == "reshape":
            return self._reshaped(node, node.func.value), ATOM
        if name in TESTS:
            return f"{name.removeprefix('np.')}({self.listed(node.args)}) != 0", EQUALITY
        if isinstance(node.func, ast.Attribute) and of_module(node.func):
            if node.func.attr not in EXACT_FUNCTIONS:
                raise Untranslatable(f"{name}: expected one of {', '.join(EXACT_FUNCTIONS)}")
            return f"{node.func.attr}({self.listed(node.args)})", ATOM
        if name in BY_HAND:
            return f"{name}({self.listed(node.args)})", ATOM
        if name in ("int", "float"):
            return self._converted(node.args[0], "int64_t" if name == "int" else "double")
        if name == "len":
            return self._length(node.args[0]), ATOM
        if name in ("abs", "min", "max"):
            return self._extreme(name, node), ATOM
        called = self.kinds.called(node)
        self.calls.append((called, [self.kinds.facts(each) for each in node.args]))
        return f"{called.name}({self.listed(called.written(node.args))})", ATOM

    def _converted(self, argument: ast.expr, c: str) -> Code:
        if isinstance(argument, ast.Constant) and isinstance(argument.value, str):
            return literal(float(argument.value)), UNARY
        of = self.kinds.of(argument)
        if (of, c) in ((FLOAT, "double"), (INTEGER, "int64_t")):
            return self._code(argument)
        return self._cast(c, self._code(argument), of)

    def _length(self, node: ast.expr) -> str:
        if isinstance(node, ast.Name) and node.id not in self.kinds.names:
            return literal(len(self.kinds.globals[node.id]))
        kind = self.kinds.of(node)
        if isinstance(kind, Several):
            return literal(len(kind.kinds))
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
