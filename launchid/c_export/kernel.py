"""Translate one kernel (compiled function of launchid_core) to a static C function of its name and docstring."""

import ast
import inspect
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from .expressions import SYMBOLS, UNARY, Expressions, times, word
from .folding import Fact, changed, extents_of, walk
from .inference import Inference, indices
from .kinds import (
    DIMENSIONS,
    FLOAT,
    INTEGER,
    TRUTH,
    VOID,
    Array,
    Kind,
    Several,
    Struct,
    Untranslatable,
)

if TYPE_CHECKING:
    from .program import Unit

INDENT = "    "
ZERO: dict[Kind, str] = {FLOAT: "0.0", INTEGER: "0", TRUTH: "false"}
NOWHERE: dict[type, str] = {Struct: "NULL"}
UNUSED_NAME = "_"
TURNS_TRIED = 16       # turns of a loop that are gone through to see whether a test in it has one answer
PURE = {"modulo", "quotient", "counted", "as_real", "as_whole", "fabs", "sqrt", "floor", "min_double", "max_double",
        "min_integer", "max_integer"}
Block = tuple[int, ...]
CHANGED_ARGUMENT = "{}_given"  # an argument that the kernel changes: its own copy has the name


def _names(nodes: Sequence[ast.AST], context: type) -> set[str]:
    """Return the names that these nodes store (ast.Store) or load (ast.Load)."""
    return {each.id for node in nodes for each in walk(node)
            if isinstance(each, ast.Name) and isinstance(each.ctx, context)}


def typed(c: str, name: str) -> str:
    """Return the C declaration of `name` with type `c`; the star of a pointer type stands at the name."""
    return f"{c}{name}" if c.endswith("*") else f"{c} {name}"


def comment_of(about: str) -> str:
    """Return a docstring as a C comment; marks of comments in it are broken up."""
    lines = about.replace("//", "/ /").replace("/*", "/ *").replace("*/", "* /").split("\n")
    return "\n   ".join([f"/* {lines[0]}", *lines[1:]]).replace("\n   \n", "\n\n") + " */\n"


def _without_unused(lines: list[str], pure: set[str]) -> list[str]:
    """Return lines of C without declarations of variables that nothing reads, if all calls in them are of `pure`."""
    kept: list[str] = []
    read: set[str] = set()
    for line in reversed(lines):
        declared = re.match(r"\s*(?:const )?\w+ \*?(\w+)(?:\[\])? = .*;$|\s*\(void\)(?=\w+ [^=])", line)
        if not declared or declared[1] in read or not set(re.findall(r"(\w+)\(", line)) <= pure:
            kept.append(line)
            read |= _words([line.split(" = ", 1)[1] if declared else line])
    return kept[::-1]


def _words(lines: list[str]) -> set[str]:
    """Return the names in lines of C, members of structs left out."""
    return set(re.findall(r"(?<![\w.>])[A-Za-z_]\w*", "\n".join(lines)))


def rename_counters(tree: ast.FunctionDef) -> None:
    """Rename in place each loop variable that is stored elsewhere too: C's, declared in the loop, must hide none."""
    loops = [node for node in walk(tree) if isinstance(node, ast.For) and isinstance(node.target, ast.Name)]
    targets = {id(loop.target) for loop in loops}
    stored = {node.id for node in walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
              and id(node) not in targets} | {argument.arg for argument in tree.args.args}
    for number, loop in enumerate(loops, start=1):
        name = loop.target.id  # type: ignore[attr-defined]
        if name not in stored or name == UNUSED_NAME or name in _names(loop.body, ast.Store):
            continue
        for node in (each for part in (loop.target, *loop.body) for each in walk(part)):
            if isinstance(node, ast.Name) and node.id == name:
                node.id = f"{name}{number}_"


@cache
def _source(function: Callable[..., Any]) -> str:
    return textwrap.dedent(inspect.getsource(function))


# ---- where variables can be declared: at their first assignment, in the block that holds all uses


def _statements(body: list[ast.stmt], block: Block) -> Iterator[tuple[Block, ast.stmt]]:
    """Yield (blocks around it, outermost first; statement) for every statement, in the order of the text."""
    for node in body:
        yield block, node
        for inner in ("body", "orelse"):
            yield from _statements(getattr(node, inner, []), (*block, id(getattr(node, inner, None))))


def _own_names(node: ast.stmt) -> Iterator[ast.Name]:
    """Yield the names in a statement itself, not in the blocks inside it."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.expr):
            yield from (each for each in walk(child) if isinstance(each, ast.Name))


def _common(a: Block, b: Block) -> Block:
    shared = 0
    while shared < min(len(a), len(b)) and a[shared] == b[shared]:
        shared += 1
    return a[:shared]


def first_assignments(function: ast.FunctionDef) -> dict[int, set[str]]:
    """Return id of an assignment -> names that C can declare in it: it is their first use and does not read them, and
    all other uses are in its block."""
    home: dict[str, Block] = {}
    first: dict[str, tuple[Block, ast.stmt]] = {}
    for block, node in _statements(function.body, ()):
        inside = (*block, id(node.body)) if isinstance(node, ast.For) else block
        for name in _own_names(node):
            at = inside if isinstance(node, ast.For) and name is node.target else block
            home[name.id] = _common(home[name.id], at) if name.id in home else at
            first.setdefault(name.id, (at, node))
    found: dict[int, set[str]] = {}
    for variable, (block, node) in first.items():
        reads = {name.id for name in _own_names(node) if isinstance(name.ctx, ast.Load)}
        if isinstance(node, ast.Assign) and block == home[variable] and variable not in reads:
            found.setdefault(id(node), set()).add(variable)
    return found


class Kernel:
    """Translation of one kernel to C for one choice of its arguments' kinds (C types)."""

    def __init__(self, unit: "Unit", function: Callable[..., Any], arguments: tuple[Kind, ...], name: str) -> None:
        self.unit, self.name, self.function, self.arguments = unit, name, function, arguments
        self.module, self.around = function.__module__, function.__globals__
        self.given: list[Fact] = [None] * len(arguments)

    @property
    def result(self) -> Kind | None:
        """Kind (C type) of the return value; VOID if nothing is returned."""
        return self.kinds.result

    def translate(self) -> None:
        """Translate the function's body into `lines` of C, after the kernels that it calls; raise Untranslatable, which
        names the kernel, if it has no C."""
        tree = ast.parse(_source(self.function)).body[0]
        assert isinstance(tree, ast.FunctionDef)
        self.tree, self.temporaries = tree, 0
        self.lines: list[str] = []
        try:
            for node in walk(self.tree):
                if isinstance(node, ast.For) and isinstance(node.target, ast.Name):
                    self._refuse_reading_after(node, node.target.id)
            rename_counters(self.tree)
            size = 0
            while size != len(walk(self.tree)):  # what is gone may leave a name with one value
                size = len(walk(self.tree))
                self.kinds = Inference(self.unit, self.tree, self.around, self.arguments, self.given)
                self._drop_unread()
                self.tree.body = self._alive(self.tree.body)
                if len(self.tree.body) > 1 and isinstance(self.tree.body[-1], ast.Return) \
                        and self.tree.body[-1].value is None:
                    self.tree.body.pop()
                changed(self.tree)
            self.local_arrays = self._local_arrays()
            self.first = first_assignments(self.tree)
            self.c = Expressions(self.unit, self.kinds, self.module, self.local_arrays)
            self._block(self.tree.body, 1)
        except Untranslatable as error:
            text = str(error)
            raise Untranslatable(text if text.startswith("kernel ") else
                                 f"kernel {self.module}.{self.tree.name}: {text}") from None
        self.answer, self.hands_on = self._answer(), self._hands_on()

    def learn(self, given: list[Fact]) -> bool:
        """Translate again with `given`, a fact for each argument; return whether C that calls this kernel has to
        change."""
        before, self.given = (repr(self.answer), self.hands_on), given
        self.translate()
        return before != (repr(self.answer), self.hands_on)

    @property
    def asked(self) -> "set[Kernel]":
        """Kernels that this kernel calls."""
        return self.kinds.asked

    def _alive(self, body: list[ast.stmt]) -> list[ast.stmt]:
        """Return the statements of a body that can run with these arguments, branches and loops cut down in place."""
        kept = []
        for node in self.kinds.alive(body):
            around = self.kinds.facts.ranges
            if isinstance(node, ast.For) and isinstance(node.target, ast.Name):
                through = self.kinds.facts.range_of(node)
                if through is not None and len(through) <= TURNS_TRIED:
                    self.kinds.facts.ranges = around | {node.target.id: through}
            if isinstance(node, (ast.If, ast.For)):
                node.body, node.orelse = self._alive(node.body), self._alive(node.orelse)
                if isinstance(node, ast.If) and not node.body and node.orelse:
                    node.test, node.body, node.orelse = ast.UnaryOp(ast.Not(), node.test), node.orelse, []
            if not isinstance(node, (ast.If, ast.For)) or node.body:
                kept.append(node)
            self.kinds.facts.ranges = around
        return kept

    def _drop_unread(self) -> None:
        """Rename in place to `_` each assigned variable that nothing reads; a call that gives it stays."""
        statements = [node for node in walk(self.tree) if isinstance(node, (ast.Assign, ast.AugAssign))]
        targets = {id(node): node.targets if isinstance(node, ast.Assign) else [node.target] for node in statements}
        unread = [node for node in statements if self._is_known(targets[id(node)][0])]
        of_unread = {id(each) for node in unread for each in walk(node)}
        read = {node.id for node in walk(self.tree) if isinstance(node, ast.Name) and id(node) not in of_unread
                and isinstance(node.ctx, ast.Load)}
        for node in statements:
            names = [each for target in targets[id(node)] for each in
                     (target.elts if isinstance(target, ast.Tuple) and isinstance(node.value, (ast.Call, ast.Attribute))
                      else [target])]
            for each in names:
                if isinstance(each, ast.Name) and each.id not in read:
                    each.id = UNUSED_NAME

    def _answer(self) -> Fact:
        """Return the number that the kernel always returns, if it is known and a call has no effect; else None."""
        nodes = walk(self.tree)
        found = {repr(self.kinds.facts.number(node.value)): self.kinds.facts.number(node.value) for node in nodes
                 if isinstance(node, ast.Return)}
        return next(iter(found.values())) if self.is_pure and len(found) == 1 else None

    @property
    def is_pure(self) -> bool:
        """Whether a call has no effect but its result: this kernel and all that it calls store into no memory."""
        return (all(called.is_pure for called in self.asked) and not any(
            isinstance(node, ast.Subscript | ast.Attribute) and isinstance(node.ctx, ast.Store)
            for node in walk(self.tree)))

    def written(self, given: Iterable[Any]) -> list[Any]:
        """Return the items of `given` (one for each argument) that C passes: those that the translated body reads."""
        return [each for each, is_written in zip(given, self.hands_on, strict=True) if is_written]

    def _hands_on(self) -> list[bool]:
        pure = PURE | {called.name for called in self.asked if called.is_pure}
        self.lines = _without_unused(
            [*self._declarations([each.arg for each in self.tree.args.args]), *self.lines], pure)
        read = _words(self.lines)
        return [word(each.arg) in read for each in self.tree.args.args]

    def source(self) -> str:
        """Return the text of the C function, its docstring as a comment above it."""
        names = (argument.arg for argument in self.tree.args.args)
        given = dict(self.written(zip(names, self.arguments, strict=True)))
        stored = _names(self.tree.body, ast.Store)
        arguments = ", ".join(
            typed(self.unit.c(kind), CHANGED_ARGUMENT.format(name) if name in stored else word(name))
            for name, kind in given.items()) or "void"
        result = self.kinds.result
        assert result is not None
        own = [f"{INDENT}{typed(self.unit.c(kind), word(name))} = {CHANGED_ARGUMENT.format(name)};"
               for name, kind in given.items() if name in stored]
        body = "\n".join([*own, *self.lines])
        head = f"static {typed(self.unit.c(result), self.name)}({arguments})"
        about = f"{ast.get_docstring(self.tree) or ''} [{self.module.removeprefix('launchid_core.')}]".lstrip()
        return f"{comment_of(about)}{head}\n{{\n{body}\n}}\n"

    # ---- variables

    def _local_arrays(self) -> tuple[str, ...]:
        """Return the names of local tuples that a variable indexes."""
        return tuple({node.value.id for node in walk(self.tree) if isinstance(node, ast.Subscript)
                      and isinstance(node.value, ast.Name) and not isinstance(node.slice, ast.Constant)
                      and isinstance(self.kinds.names.get(node.value.id), Several)})

    def _counters(self) -> set[str]:
        """Return the loop variables that only their loops store."""
        loops = [node.target for node in walk(self.tree) if isinstance(node, ast.For)]
        others = {node.id for node in walk(self.tree) if isinstance(node, ast.Name)
                  and isinstance(node.ctx, ast.Store) and not any(node is loop for loop in loops)}
        return {loop.id for loop in loops if isinstance(loop, ast.Name)} - others

    def _declarations(self, arguments: list[str]) -> list[str]:
        """Return C that declares, at the begin of the function, local variables that no assignment can declare."""
        declared = set().union(*self.first.values()) if self.first else set()
        known = {name for name in self.kinds.names if self._is_known(ast.Name(name, ast.Load()))}
        left_out = {*arguments, *self._counters(), *self.local_arrays, *declared, *known, UNUSED_NAME}
        return [f"{INDENT}{typed(self.unit.c(kind), word(name))} = {ZERO.get(kind, NOWHERE.get(type(kind), '{0}'))};"
                for name, kind in self.kinds.names.items() if name not in left_out]

    def _target(self, target: ast.expr, of: ast.Assign) -> str:
        """Return C of the left side of an assignment, which declares the variable where it can."""
        if isinstance(target, ast.Name) and target.id in self.first.get(id(of), ()):
            return typed(self.unit.c(self.kinds.names[target.id]), word(target.id))
        return self.c(target)

    def _is_known(self, target: ast.expr) -> bool:
        """Whether the value of a variable is known before flight, so that C needs no variable."""
        kind = self.kinds.names.get(target.id) if isinstance(target, ast.Name) else None
        if kind in (INTEGER, TRUTH):
            return self.kinds.facts.number(target) is not None
        return isinstance(kind, Struct) and kind.is_known

    def _temporary(self, name: str) -> str:
        self.temporaries += 1
        return f"{name}{self.temporaries}"

    # ---- statements

    def _line(self, depth: int, text: str) -> None:
        self.lines.append(INDENT * depth + text)

    def _block(self, body: list[ast.stmt], depth: int) -> None:
        for node in body:
            writer: Callable[[Any, int], None] = getattr(self, f"_{type(node).__name__.lower()}")
            writer(node, depth)

    def _pass(self, node: ast.Pass, depth: int) -> None:
        self._line(depth, ";")

    def _break(self, node: ast.Break, depth: int) -> None:
        self._line(depth, "break;")

    def _continue(self, node: ast.Continue, depth: int) -> None:
        self._line(depth, "continue;")

    def _expr(self, node: ast.Expr, depth: int) -> None:
        if not isinstance(node.value, ast.Constant):
            unread = "" if self.kinds.of(node.value) == VOID else "(void)"
            self._line(depth, f"{unread}{self.c(node.value)};")

    def _return(self, node: ast.Return, depth: int) -> None:
        self._line(depth, "return;" if node.value is None else f"return {self._returned(node.value)};")

    def _returned(self, value: ast.expr) -> str:
        kind = self.kinds.result
        if isinstance(value, ast.Tuple) and isinstance(kind, Several):
            parts = ", ".join(self.c.turned(each, of) for each, of in zip(value.elts, kind.kinds, strict=True))
            return f"({self.unit.c(kind)}){{{parts}}}"
        return self.c.turned(value, kind)

    def _if(self, node: ast.If, depth: int) -> None:
        self._line(depth, f"if ({self.c.truth(node.test)}) {{")
        self._block(node.body, depth + 1)
        rest = node.orelse
        while len(rest) == 1 and isinstance(rest[0], ast.If):
            self._line(depth, f"}} else if ({self.c.truth(rest[0].test)}) {{")
            self._block(rest[0].body, depth + 1)
            if not rest[0].orelse:  # MISRA C:2012, 15.7
                self._line(depth, "} else {")
                self._line(depth + 1, "/* nothing */")
            rest = rest[0].orelse
        if rest:
            self._line(depth, "} else {")
            self._block(rest, depth + 1)
        self._line(depth, "}")

    def _for(self, node: ast.For, depth: int) -> None:
        """Write a loop over `range`, whose ends are evaluated once; Untranslatable for any other loop."""
        assert isinstance(node.iter, ast.Call) and isinstance(node.target, ast.Name)
        arguments = node.iter.args
        low = "0" if len(arguments) == 1 else self.c(arguments[0])
        high = arguments[0] if len(arguments) == 1 else arguments[1]
        step = ast.literal_eval(arguments[2]) if len(arguments) == 3 else 1
        stored = _names(node.body, ast.Store)
        if node.target.id in stored or abs(step) != 1:
            raise Untranslatable(f"line {node.lineno}: a loop that sets its own variable, or by a step of {step}")
        end = self.c(high, UNARY)
        moves = not end.isdigit() and any(
            isinstance(each, ast.Subscript | ast.Call)
            or (isinstance(each, ast.Attribute) and not self.kinds.of_neighbour(each)) for each in walk(high))
        if moves or stored & _names([high], ast.Load):
            end = self._temporary("end")
            self._line(depth, f"const int64_t {end} = {self.c(high)};")
        i = self._temporary("pass") if node.target.id == UNUSED_NAME else word(node.target.id)
        most = self._most_turns(node, node.target.id)
        if most > 0:
            self._line(depth, f"/*@ loop unroll {most}; */")
        self._line(depth, f"for (int64_t {i} = {low}; {i} {'<' if step > 0 else '>'} {end}; "
                          f"{i}{'++' if step > 0 else '--'}) {{")
        self._block(node.body, depth + 1)
        self._line(depth, "}")

    def _most_turns(self, loop: ast.For, name: str) -> int:
        """Return how often a loop that counts can turn at most, by the extents of arrays that its variable indexes; 0
        for other loops.  Frama-C finds no bound of the count otherwise."""
        nodes = walk(loop)
        counts = any(isinstance(each, ast.AugAssign) and isinstance(each.target, ast.Name)
                     and self.kinds.of(each.target) == INTEGER for each in nodes)
        if not counts or self.kinds.facts.turns(loop) is not None:
            return 0
        extents = [0]
        for each in nodes:
            kind = self.kinds.of(each.value) if isinstance(each, ast.Subscript) else None
            if isinstance(each, ast.Subscript) and isinstance(kind, Array):
                known = extents_of(self.kinds.facts(each.value), kind.dimensions)
                extents += [n for n, at in zip(known, indices(each), strict=False)
                            if n is not None and any(isinstance(x, ast.Name) and x.id == name for x in walk(at))]
        return max(extents)

    def _refuse_reading_after(self, loop: ast.For, name: str) -> None:
        """Raise Untranslatable if a loop's variable is read after the loop, where C's is gone."""
        later = [each for each in walk(self.tree) if isinstance(each, ast.Name) and each.id == name
                 and each.lineno > (loop.end_lineno or loop.lineno)]
        if later and isinstance(min(later, key=lambda each: (each.lineno, each.col_offset)).ctx, ast.Load):
            raise Untranslatable(f"line {loop.lineno}: {name} is read after its loop")

    def _augassign(self, node: ast.AugAssign, depth: int) -> None:
        if type(node.op) not in SYMBOLS:
            raise Untranslatable(f"{ast.unparse(node)}: expected +=, -=, *= or /=")
        if isinstance(node.target, ast.Name) and node.target.id == UNUSED_NAME:
            return
        value = self.c.turned(node.value, self.kinds.of(node.target))
        self._line(depth, f"{self.c(node.target)} {SYMBOLS[type(node.op)][0]}= {value};")

    def _assign(self, node: ast.Assign, depth: int) -> None:
        if len(node.targets) > 1 and not isinstance(node.value, ast.Constant):
            raise Untranslatable(f"{ast.unparse(node)}: expected one target, or a constant")
        for target in node.targets:
            if isinstance(target, ast.Name) and target.id == UNUSED_NAME:
                if any(isinstance(each, ast.Call) for each in walk(node.value)):
                    self._line(depth, f"(void){self.c(node.value)};")
            elif isinstance(target, ast.Tuple):
                self._unpack(target, node, depth)
            elif isinstance(target, ast.Subscript) and any(isinstance(at, ast.Slice) for at in indices(target)):
                self._fill(target, node.value, depth)
            elif isinstance(target, ast.Name) and target.id in self.local_arrays:
                self._list(target, node.value, depth)
            else:
                if self._is_known(target):
                    continue
                value = self.c.turned(node.value, self.kinds.of(target))
                self._line(depth, f"{self._target(target, node)} = {value};")

    def _list(self, target: ast.Name, value: ast.expr, depth: int) -> None:
        """Write a local tuple as a C array."""
        kind = self.kinds.names[target.id]
        if not isinstance(value, ast.Tuple) or not isinstance(kind, Several) or len(set(kind.kinds)) != 1:
            raise Untranslatable(f"{target.id}: expected a tuple of one kind where a variable indexes it")
        self._line(depth, f"const {self.unit.c(kind.kinds[0])} {word(target.id)}[] = {{{self.c.listed(value.elts)}}};")

    def _unpack(self, target: ast.Tuple, node: ast.Assign, depth: int) -> None:
        """Write a, b = c, d: all of the right side is evaluated before any of the left is stored."""
        value = node.value
        if isinstance(value, ast.Attribute) and value.attr == "shape":
            parts = self.c.array(value.value)[1]
        elif isinstance(value, ast.Tuple):
            parts = self._at_once(target, value, depth)
        else:
            name = self._temporary("result")
            self._line(depth, f"const {self.unit.c(self.kinds.of(value))} {name} = {self.c(value)};")
            parts = [f"{name}.v{k}" for k in range(len(target.elts))]
        for each, part in zip(target.elts, parts, strict=True):
            if not (isinstance(each, ast.Name) and each.id == UNUSED_NAME) and not self._is_known(each):
                self._line(depth, f"{self._target(each, node)} = {part};")

    def _at_once(self, target: ast.Tuple, value: ast.Tuple, depth: int) -> list[str]:
        """Return C of a tuple's values, as temporaries if storing one target could change a later value."""
        plain = all(isinstance(each, ast.Name) for each in target.elts)
        if plain and not _names(target.elts, ast.Store) & _names(value.elts, ast.Load):
            return [self.c.turned(each, self.kinds.of(to)) for to, each in zip(target.elts, value.elts, strict=True)]
        names = []
        for to, each in zip(target.elts, value.elts, strict=True):
            kind = self.kinds.of(to)
            names.append(self._temporary("value"))
            self._line(depth, f"const {self.unit.c(kind)} {names[-1]} = {self.c.turned(each, kind)};")
        return names

    def _fill(self, target: ast.Subscript, value: ast.expr, depth: int) -> None:
        """Write a[i, :] = x: x, a number or an array, into all elements of an array, or of its row or layer."""
        lead = [at for at in indices(target) if not isinstance(at, ast.Slice)]
        if any(isinstance(at, ast.Slice) and (at.lower or at.upper or at.step) for at in indices(target)):
            raise Untranslatable(f"{ast.unparse(target)} = ...: expected [:]")
        if any(isinstance(at, ast.Slice) for at in indices(target)[:len(lead)]):
            raise Untranslatable(f"{ast.unparse(target)} = ...: expected the last extents whole")
        whole = ast.Subscript(target.value, ast.Tuple(lead, ast.Load()), ast.Load()) if lead else target.value
        kind, of = self.kinds.of(whole), self.kinds.of(value)
        assert isinstance(kind, Array)
        if 0 in extents_of(self.kinds.facts(whole), kind.dimensions):
            return
        to, at = self._temporary("to"), self._temporary("at")
        self._line(depth, f"const {kind.c} {to} = {self.c(whole)};")
        source = self.c.turned(value, kind.element)
        if isinstance(of, Array):
            source = self._temporary("from")
            self._line(depth, f"const {of.c} {source} = {self.c(value)};")
            source = f"{source}.p[{at}]"
        elif not isinstance(value, (ast.Constant, ast.Name, ast.Attribute)):
            source = self._temporary("value")
            self._line(depth, f"const {kind.element.c} {source} = {self.c.turned(value, kind.element)};")
        count = "1"
        for d, n in zip(DIMENSIONS, extents_of(self.kinds.facts(whole), kind.dimensions), strict=False):
            count = times(count, f"{to}.{d}" if n is None else str(n))
        self._line(depth, f"for (int64_t {at} = 0; {at} < {f'({count})' if ' ' in count else count}; {at}++) {{")
        self._line(depth + 1, f"{to}.p[{at}] = {source};")
        self._line(depth, "}")
