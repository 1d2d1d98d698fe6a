"""Constant folding of the C export: what is known of an expression before flight (number, constant array or extents).

Facts come from the configuration (fields of `Size`, the fixed struct, tables), from constants of modules and, for an
argument, from what every call of the kernel gives it (`program.Unit`).  What they decide is not written in C: a known
condition, a branch that it excludes, a loop of no turns.  An element that an unknown index takes from a table is one of
several (`Among`); a test of it is decided if all of them give one answer.
"""

import ast
import itertools
import math
import operator
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .kinds import INTEGER, TRUTH, Array, Known, Several, Struct

if TYPE_CHECKING:
    from .inference import Inference

Fact = Any  # int, float, bool; an array that never changes; a tuple of an array's extents, None where unknown; None
PLAIN_NUMBERS = (bool, int, float)
MOST_FACTS = 64  # facts among which one is
OPERATIONS: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.FloorDiv: operator.floordiv, ast.Mod: operator.mod, ast.Eq: operator.eq, ast.NotEq: operator.ne,
    ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge,
    ast.In: lambda a, b: None if None in b else a in b}
CALLS: dict[str, Callable[..., Any]] = {
    "abs": abs, "min": min, "max": max, "int": int, "float": float, "np.isfinite": np.isfinite, "np.isnan": np.isnan,
    "np.isinf": np.isinf}


def walk(tree: ast.AST) -> list[ast.AST]:
    """Return the nodes of `ast.walk(tree)`, statements in its order.  The list is kept for an expression or a function:
    who removes statements of a function calls `changed` after it."""
    known: list[ast.AST] | None = tree.__dict__.get("nodes")
    if known is not None:
        return known
    if isinstance(tree, ast.expr):
        known = tree.__dict__["nodes"] = list(ast.walk(tree))
        return known
    found, waiting = list[ast.AST](), deque([tree])
    while waiting:
        node = waiting.popleft()
        found.append(node)
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.expr):
                found += walk(child)
            else:
                waiting.append(child)
    if isinstance(tree, ast.FunctionDef):
        tree.__dict__["nodes"] = found
    return found


def changed(tree: ast.FunctionDef) -> None:
    """Drop the list of nodes that `walk` keeps for a function, after its statements have changed."""
    tree.__dict__.pop("nodes", None)


@dataclass(frozen=True)
class Among:
    """A value of which is known that it is one of `facts`: numbers, or arrays of one shape."""

    facts: tuple[Fact, ...]


def among(facts: Iterable[Fact]) -> Fact:
    """Join facts about one value: the fact itself if all agree, `Among` of the distinct ones, None if any is unknown,
    or there are none or more than MOST_FACTS."""
    parts = [part for fact in facts for part in (fact.facts if isinstance(fact, Among) else (fact,))]
    distinct = {repr(part): part for part in parts}
    if any(part is None for part in parts) or not 0 < len(distinct) <= MOST_FACTS:
        return None
    return parts[0] if len(distinct) == 1 else Among(tuple(distinct[key] for key in sorted(distinct)))


def fact_of(value: Any) -> Fact:
    """Return what is known of a Python value: the number, or the array (also of a plain tuple); else None."""
    if isinstance(value, (np.generic, *PLAIN_NUMBERS)):
        return value.item() if isinstance(value, np.generic) else value
    if isinstance(value, tuple) and not hasattr(value, "_fields"):
        value = np.array(value)
    return value if isinstance(value, np.ndarray) and value.dtype.kind in "bif" else None


def shared(a: Fact, b: Fact) -> Fact:
    """Return what two facts about one argument, from two calls, have in common: the value if they are equal; numbers of
    both if a is an `Among` of numbers; of arrays the extents, None where they differ; None if there is nothing."""
    if isinstance(a, Among) and isinstance(b, (Among, *PLAIN_NUMBERS)):
        if all(isinstance(each, PLAIN_NUMBERS) for each in a.facts):
            return among([a, b])
        return a if repr(a) == repr(b) else None
    if isinstance(a, PLAIN_NUMBERS) or isinstance(b, PLAIN_NUMBERS):
        return a if type(a) is type(b) and repr(a) == repr(b) else None
    if a is None or b is None or a is b:
        return a if a is b else None
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray) and a.shape == b.shape and a.tobytes() == b.tobytes():
        return a
    x, y = (each.shape if isinstance(each, np.ndarray) else each for each in (a, b))
    return tuple(m if m == n else None for m, n in zip(x, y, strict=True))


def differ(a: Fact, b: Fact) -> bool:
    """Whether two facts about a value are different (other numbers, shapes or extents)."""
    if a is b:
        return False
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return (a.shape, a.dtype) != (b.shape, b.dtype) or a.tobytes() != b.tobytes()
    both = shared(a, b)
    return repr(both) != repr(a) or repr(both) != repr(b)


def extents_of(fact: Fact, dimensions: int) -> tuple[int | None, ...]:
    """Return the extents of an array, one for each dimension, from the fact about it; None where unknown."""
    fact = fact.facts[0] if isinstance(fact, Among) else fact
    if isinstance(fact, np.ndarray):
        return fact.shape
    return fact if isinstance(fact, tuple) else (None,) * dimensions


class Facts:
    """What is known before flight of one kernel's expressions; calling it with an expression returns its fact, or None.
    given: facts of the kernel's arguments, by name"""

    def __init__(self, kinds: "Inference", tree: ast.FunctionDef, given: dict[str, Fact]) -> None:
        self.kinds = kinds
        self.kept: dict[int, tuple[ast.expr, Fact]] = {}
        self.ranges: dict[str, range] = {}   # of the loops around a statement, as far as they are short
        stores = [node.id for node in walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)]
        self.given = {name: fact for name, fact in given.items() if name not in stores}
        self.once = {name: value for name, value in _assignments(tree) if stores.count(name) == 1 and name not in given}

    def number(self, node: ast.expr | None) -> Any:
        """Return the int, float or bool that an expression has before flight; None if it is unknown."""
        fact = None if node is None else self(node)
        return fact if isinstance(fact, PLAIN_NUMBERS) else None

    def options(self, node: ast.expr | None) -> tuple[Any, ...] | None:
        """Return the numbers that an expression can have in the turns of loops around it; None if one is unknown."""
        if node is None:
            return None
        names = [name for name in self.ranges if name in self._reads(node)]
        found, before = list[Fact](), (self.given, self.kept, self.ranges)
        for values in itertools.product(*(self.ranges[name] for name in names)):
            if names:
                self.given, self.kept = before[0] | dict(zip(names, values, strict=True)), {}
                self.ranges = {name: turns for name, turns in before[2].items() if name not in names}
            found.append(self(node))
        self.given, self.kept, self.ranges = before
        fact = among(found)
        if isinstance(fact, Among) and isinstance(fact.facts[0], PLAIN_NUMBERS):
            return fact.facts
        return (fact,) if isinstance(fact, PLAIN_NUMBERS) else None

    def _reads(self, node: ast.expr) -> set[str]:
        """Return the names that an expression depends on, also through variables that are assigned once."""
        names, waiting = set[str](), [node]
        while waiting:
            new = {each.id for each in walk(waiting.pop()) if isinstance(each, ast.Name)} - names
            names |= new
            waiting += [self.once[name] for name in new if name in self.once]
        return names

    def decided(self, test: ast.expr) -> Any:
        """Return the value of a test if it is known and the same in every turn of the loops around it; else None."""
        answers = self.options(test)
        return answers[0] if answers is not None and len(answers) == 1 else None

    def turns(self, loop: ast.For) -> int | None:
        """Return how many turns a loop over `range` makes; None if unknown, or if outer loops change it."""
        ends = [self.options(each) for each in loop.iter.args] if isinstance(loop.iter, ast.Call) else [None]
        if None in ends:
            return None
        turns = {len(range(*map(int, each))) for each in itertools.product(*ends)}  # type: ignore[arg-type]
        return turns.pop() if len(turns) == 1 else None

    def range_of(self, loop: ast.For) -> range | None:
        """Return the range that a loop goes through, if its ends are known before flight; else None."""
        ends = [self.number(each) for each in loop.iter.args] if isinstance(loop.iter, ast.Call) else [None]
        return None if None in ends else range(*map(int, ends))  # type: ignore[arg-type]

    def __call__(self, node: ast.expr) -> Fact:
        """Return what is known before flight of an expression: a number, array, extents or `Among`; None if nothing."""
        if id(node) in self.kept:
            return self.kept[id(node)][1]
        reader: Callable[[Any], Fact] | None = getattr(self, f"_{type(node).__name__.lower()}", None)
        fact = None if reader is None else reader(node)
        if self.kinds.settled:
            self.kept[id(node)] = node, fact
        return fact

    def _constant(self, node: ast.Constant) -> Fact:
        return fact_of(node.value)

    def _name(self, node: ast.Name) -> Fact:
        if node.id not in self.kinds.names:
            return fact_of(self.kinds.globals[node.id])
        if node.id in self.given:
            return self.given[node.id]
        fact = self(self.once[node.id]) if node.id in self.once else None
        if isinstance(fact, PLAIN_NUMBERS) and self.kinds.names[node.id] not in (INTEGER, TRUTH):
            return float(fact)
        return fact

    def _attribute(self, node: ast.Attribute) -> Fact:
        if isinstance(node.value, ast.Name) and node.value.id in ("np", "math"):
            return fact_of(getattr(np, node.attr))
        if self.kinds.of_neighbour(node):
            return fact_of(self.kinds.outside(node))
        kind = self.kinds.of(node.value)
        if not isinstance(kind, Struct):
            return None
        field = kind.field(node.attr)
        if isinstance(field, Known):
            return field.value
        if isinstance(field, Array) and field.dimensions == 0:
            return None if field.value is None else field.value.item()
        return (field.extents if field.value is None else field.value) if isinstance(field, Array) else None

    def _subscript(self, node: ast.Subscript) -> Fact:
        at = list(node.slice.elts) if isinstance(node.slice, ast.Tuple) else [node.slice]
        if isinstance(node.value, ast.Attribute) and node.value.attr == "shape":
            kind = self.kinds.of(node.value.value)
            assert isinstance(kind, Array)
            extents = extents_of(self(node.value.value), kind.dimensions)
            return extents[at[0].value]  # type: ignore[attr-defined]
        base = self(node.value)
        places = [self._slice(each) if isinstance(each, ast.Slice) else self.number(each) for each in at]
        if isinstance(base, (np.ndarray, Among)):
            parts = self._chosen(base, at, places)
            if parts is not None:
                return parts
        if not isinstance(base, (np.ndarray, tuple)):
            return None
        whole = extents_of(base, 0)
        parts = [self._part(each, n) for each, n in zip(at, whole, strict=False) if isinstance(each, ast.Slice)]
        return (*parts, *whole[len(at):]) or None

    @staticmethod
    def _chosen(base: Fact, at: list[ast.expr], places: list[Any]) -> Fact:
        """Return the part of a table (or one of several) at an index that may be unknown: `Among` of all it can be."""
        tables = base.facts if isinstance(base, Among) else (base,)
        if not all(isinstance(table, np.ndarray) for table in tables):
            return None
        open_ = [place is None and not isinstance(each, ast.Slice) for each, place in zip(at, places, strict=True)]
        if any(place is None and isinstance(each, ast.Slice) for each, place in zip(at, places, strict=True)):
            return None
        choices = [range(n) if is_open else [place]
                   for is_open, place, n in zip(open_, places, tables[0].shape, strict=False)]
        if len(tables) * math.prod(map(len, choices)) > MOST_FACTS:
            return None
        found = [table[place] for table in tables for place in itertools.product(*choices)]
        return among(part if isinstance(part, np.ndarray) else part.item() for part in found)

    def _slice(self, node: ast.Slice) -> slice | None:
        low, high = self.number(node.lower), self.number(node.upper)
        is_known = (low is None) == (node.lower is None) and (high is None) == (node.upper is None)
        return slice(low, high) if is_known else None

    def _part(self, node: ast.Slice, extent: int | None) -> int | None:
        """Return the extent of a slice of a dimension with this extent; None if unknown."""
        low = 0 if node.lower is None else self.number(node.lower)
        high = extent if node.upper is None else self.number(node.upper)
        return None if low is None or high is None else int(high) - int(low)

    def _binop(self, node: ast.BinOp) -> Fact:
        left, right = self.number(node.left), self.number(node.right)
        if isinstance(node.op, ast.Mult) and self.kinds.of(node) == INTEGER and 0 in (left, right):
            return 0
        return self._both(node.op, left, right)

    def _both(self, op: ast.operator | ast.cmpop, a: Fact, b: Fact) -> Fact:
        operation = OPERATIONS.get(type(op))
        if a is None or b is None or operation is None:
            return None
        try:
            return operation(a, b)
        except (ZeroDivisionError, OverflowError):
            return None

    def _unaryop(self, node: ast.UnaryOp) -> Fact:
        number = self.number(node.operand)
        return None if number is None else not number if isinstance(node.op, ast.Not) else -number

    def _compare(self, node: ast.Compare) -> Fact:
        if len(node.ops) > 1:
            return None
        right = node.comparators[0]
        if isinstance(node.ops[0], ast.Is | ast.IsNot):  # None: an array that is left out, here of no elements
            return (0 in extents_of(self(node.left), 1)) == isinstance(node.ops[0], ast.Is)
        if isinstance(right, ast.Tuple):
            return self._both(node.ops[0], self.number(node.left), [self.number(each) for each in right.elts])
        a, b = self.options(node.left), self.options(right)
        if isinstance(node.ops[0], ast.Lt) and isinstance(node.left, ast.Call) and b and max(b) <= 0:
            if ast.unparse(node.left.func) == "abs":
                return False
        return None if a is None or b is None else among(self._both(node.ops[0], x, y) for x in a for y in b)

    def _boolop(self, node: ast.BoolOp) -> Fact:
        left = self.undecided(node)
        last = self.number(left[-1])
        return bool(last) if len(left) == 1 and last is not None else None

    def undecided(self, node: ast.BoolOp) -> list[ast.expr]:
        """Return the terms of an `and` or `or` that C must test: no term of known value, except one that decides, which
        is last; if no term is left, the last term of all."""
        decisive = isinstance(node.op, ast.Or)
        left: list[ast.expr] = []
        for each in node.values:
            number = self.number(each)
            if number is None:
                left.append(each)
            elif bool(number) == decisive:
                is_pure = not any(isinstance(part, ast.Call) for one in left for part in walk(one))
                return [each] if is_pure else [*left, each]
        return left or [node.values[-1]]

    def _tuple(self, node: ast.Tuple) -> Fact:
        numbers = [self.number(each) for each in node.elts]
        return None if None in numbers else np.array(numbers)

    def _ifexp(self, node: ast.IfExp) -> Fact:
        test = self.number(node.test)
        return None if test is None else self(node.body if test else node.orelse)

    def _call(self, node: ast.Call) -> Fact:
        name = ast.unparse(node.func)
        if name in ("U", "np.uint64"):
            return self(node.args[0])
        if name == "len":
            kind = self.kinds.of(node.args[0])
            return len(kind.kinds) if isinstance(kind, Several) else extents_of(self(node.args[0]), 1)[0]
        if name in CALLS:
            numbers = [self.number(each) for each in node.args]
            return None if None in numbers else fact_of(CALLS[name](*numbers))
        if isinstance(node.func, ast.Attribute) and node.func.attr == "reshape":
            shape = node.args[0]
            assert isinstance(shape, ast.Tuple)
            return tuple(self.number(each) for each in shape.elts)
        if isinstance(node.func, ast.Attribute) and ast.unparse(node.func.value) in ("np", "math"):
            return None
        return self.kinds.result_of(node)


def _assignments(tree: ast.FunctionDef) -> Iterator[tuple[str, ast.expr]]:
    """Yield (name, assigned expression) of all assignments in a function."""
    for node in walk(tree):
        if not isinstance(node, ast.Assign):
            continue
        for target in node.targets:
            if isinstance(target, ast.Name):
                yield target.id, node.value
            elif isinstance(target, ast.Tuple) and isinstance(node.value, (ast.Tuple, ast.Attribute)):
                values = node.value.elts if isinstance(node.value, ast.Tuple) else \
                    [ast.Subscript(node.value, ast.Constant(k), ast.Load()) for k in range(len(target.elts))]
                yield from ((each.id, value) for each, value in zip(target.elts, values, strict=True)
                            if isinstance(each, ast.Name))
