"""Translate an estimator to C files: its memory (fixed, persistent, scratch) as structs, its kernels as functions.

`Unit` is the C file being made: its structs, constants and functions, each after what it needs.
"""

import ast
import hashlib
import inspect
import math
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from string import Template
from types import ModuleType
from typing import Any

import numpy as np

from launchid_core import EDGES, Config, EstimateStatus, Port, Status, __version__, port_of

from .expressions import EXACT_FUNCTIONS
from .folding import Fact, differ, shared
from .kernel import Kernel, typed
from .kinds import (
    ELEMENTS,
    FLOAT,
    Array,
    Kind,
    Known,
    Scalar,
    Struct,
    array_types,
    kind_of,
    literal,
    struct_of,
)

TEMPLATES = Path(__file__).parent / "template"
NUMBERS_A_LINE = 6
BYTES_A_LINE = 20
STACK_LIMIT = 2048     # bytes of the deepest call at -O2; tests/launchid/c_export/test_port_kit.py computes it
OWN_CONSTANT = re.compile(r"\b(RING|WINDOW)_([A-Z0-9_]+)\b")
FIXED, STATE, WORK = "fixed", "state", "work"
C_GUARD = f"{STATE}.guard"
INT_MAX = 2**31 - 1    # of an enumerator
Key = tuple[Callable[..., Any], tuple[Kind, ...]]


def c_files(config: Config, vectors: dict[str, int] | None = None) -> dict[str, str]:
    """Return file name -> text (launchid.h, launchid.c, replay.c, README.md) of an estimator with this configuration;
    vectors: numbers of `flights` and `samples` it is checked with."""
    program = _Program(config, port_of(config))
    header, source = program.header(), program.source()
    functions = sorted(name for name in (*EXACT_FUNCTIONS, "fabs", "frexp", "ldexp")
                       if re.search(rf"\b{name}\(", source))
    return {"launchid.h": header, "launchid.c": source, "replay.c": template("replay.c", {}),
            "README.md": template("README.md", program.sizes() | {"functions": ", ".join(functions)}
                                  | (vectors or {"flights": 0, "samples": 0}))}


def template(name: str, values: dict[str, object]) -> str:
    """Return the text of a file of TEMPLATES, its $placeholders replaced by `values`."""
    text = (TEMPLATES / name).read_text(encoding="utf-8")
    return Template(text).substitute(values) if values else text


OF_LOGS = ("UNCHECKED",)   # statuses that no flight has


def _enumeration(names: type[Status] | type[EstimateStatus]) -> str:
    return "\n".join(f"    LAUNCHID_{each.name} = {each.value}," for each in names if each.name not in OF_LOGS)


class _Program:
    """The C program of one configuration."""

    def __init__(self, config: Config, port: Port) -> None:
        self.config, self.port, self.unit = config, port, Unit()
        memory = port.memory
        parts = memory.parts._asdict()
        structs = {name: struct_of(part, constant=name == FIXED) for name, part in parts.items()}
        self.structs: dict[str, Struct] = structs
        self.block = Struct(type(memory.parts), tuple(structs.values()), constant=True, placed=True)
        apart: dict[str, Kind] = {
            name: Array(ELEMENTS[array.dtype.kind], array.ndim, constant=port.apart[name] == FIXED)
            for name, array in memory.apart.items()}
        self.kinds: dict[str, Kind] = {"size": struct_of(memory.size), "block": self.block, "words": structs[STATE],
                                       "state": structs[STATE], **apart}
        self.unit.struct(self.block)
        roots = self._roots()
        for root in roots:
            self.unit.kernel(*root, partial(roots.__getitem__, root))
        self.unit.settle(roots)
        self.update, self.report = self._call(port.update), self._call(port.report)
        self.seal = self._call(port.seal) or f"fold_words(&state->{STATE})"

    def _roots(self) -> dict[Key, list[Fact]]:
        """Return the kernels that are called from outside -> facts of their arguments (fixed arrays, else extents)."""
        apart = {name: array if self.port.apart[name] == FIXED else array.shape
                 for name, array in self.port.memory.apart.items()}
        called = [each for each in (self.port.update, self.port.report, self.port.seal) if each is not None]
        return {self._key(function): [apart.get(name) for name in _arguments(function)] for function in called}

    def _key(self, function: Any) -> Key:
        kinds = [self.kinds.get(name, FLOAT) for name in _arguments(function)]
        if function is self.port.seal:  # nothing may change what is saved
            kinds = [replace(kind, constant=True) for kind in kinds if isinstance(kind, (Array, Struct))]
        return getattr(function, "py_func", function), tuple(kinds)

    def _apart(self, kind: str) -> dict[str, np.ndarray]:
        """Return the arrays outside the structs that are fixed, persist or are scratch (`kind`), by name."""
        return {name: array for name, array in self.port.memory.apart.items() if self.port.apart[name] == kind}

    def _call(self, function: Any) -> str:
        """Return C of a call of the kernel with the memory that it takes, and a sample `s`."""
        if function is None:
            return ""
        key = self._key(function)
        kernel = self.unit.kernel(*key)
        given = kernel.written(zip(_arguments(function), key[1], strict=True))
        return f"{kernel.name}({', '.join(self._given(name, kind) for name, kind in given)})"

    def _given(self, name: str, kind: Kind) -> str:
        """Return C of what is passed for the argument `name` of a kernel."""
        if name == "block":
            return "&block"
        if name in ("words", "state"):
            return f"&state->{STATE}"
        if not isinstance(kind, Array):
            return f"s->{name}"
        array, owner = self.port.memory.apart[name], self.port.apart[name]
        place = name.upper() if owner == FIXED else f"{owner}->{name}"
        return f"({kind.c}){{{place}, {', '.join(map(str, array.shape))}}}"

    def _initial(self) -> Iterator[str]:
        """Yield C statements that set, after a reset, each element of the state that is not zero."""
        for path, array in self._state():
            flat = array.ravel()
            places = np.flatnonzero((flat != 0) | np.signbit(flat) if flat.dtype.kind == "f" else flat != 0)
            for k in places.tolist() if not path.startswith(C_GUARD) else ():
                yield f"    state->{path}{f'[{k}]' if array.ndim else ''} = {literal(flat[k])};\n"

    def _seal(self) -> str:
        """Return C of the checksum of the carried state, array by array as the core's `fold_words`."""
        state = self.port.memory.parts.state
        first = state._fields.index(self.port.carried)
        lines = [template("seal.c", {}),
                 f"static int64_t fold_words(const {self.unit.struct(self.structs[STATE])} *state)",
                 "{", "    int64_t seal = 0;"]
        for name, part in list(zip(state._fields, state, strict=True))[first:]:
            lines += [f"    seal = fold_{'numbers' if array.dtype.kind == 'f' else 'counts'}(seal, "
                      f"{_address(path, array)}, {array.size});" for path, array in _arrays(part, name) if array.size]
        return "\n".join([*lines, "    return seal;", "}\n"])

    def _constants(self) -> str:
        """Return C of the tables and of the fixed struct."""
        fixed = self.port.memory.parts.fixed
        tables = [f"static const double {name.upper()}[] = {_numbers(array, 1)};\n"
                  for name, array in self._apart(FIXED).items()
                  if re.search(rf"\b{name.upper()}\b", self.update + self.report)]
        return "\n".join([*tables, f"static const {self.unit.struct(self.structs[FIXED])} FIXED = "
                                   f"{_initialiser(fixed)};\n"])

    # ---- files

    def header(self) -> str:
        """Return the text of launchid.h."""
        return template("launchid.h", self.sizes() | {
            "terms": len(self.config.terms), "max_changes": core_module("changes").MAX_EVENTS,
            "modes": len(self.config.model.modes) if self.config.model is not None else 0,
            "statuses": _enumeration(Status),
            "estimate_statuses": _enumeration(EstimateStatus), "structs": "\n".join(self.unit.declarations),
            "state": self._members(STATE), "work": self._members(WORK),
            **{f"edge_{k}": literal(edge) for k, edge in enumerate(EDGES)}})

    def _state(self) -> Iterator[tuple[str, np.ndarray]]:
        """Yield (C path, array) of the memory that persists, in the order in which it is saved."""
        yield from _arrays(self.port.memory.parts.state, STATE)
        yield from self._apart(STATE).items()

    def _saved(self) -> dict[str, object]:
        """Return the values of the template save.c: C that saves and restores the Python estimator's bytes."""
        head = self.port.preface
        rows = [", ".join(map(str, head[k:k + BYTES_A_LINE])) for k in range(0, len(head), BYTES_A_LINE)]
        kinds = [(_address(path, array), array.size, "numbers" if array.dtype.kind == "f" else "words")
                 for path, array in self._state() if array.size]
        saves, restores = ("".join(f"    at = {does}_{kind}(saved, at, {address}, {n}U);\n"
                                   for address, n, kind in kinds) for does in ("put", "take"))
        saves = saves.replace(f"state->{C_GUARD}.carried", "carried")
        return {"preface": ",\n    ".join(rows), "saves": saves, "restores": restores, "seal": self.seal}

    def sizes(self) -> dict[str, object]:
        """Return values for the templates: version, names and numbers of the configuration, bytes of memory."""
        config = self.config
        return {"version": __version__, "digest": hashlib.sha256(self.port.preface).hexdigest()[:16],
                "formulation": config.formulation, "library": ", ".join(config.terms),
                "window": literal(config.window), "period": literal(config.sample_period),
                "state_bytes": self._bytes(STATE) + 8,  # `busy`
                "work_bytes": self._bytes(WORK), "fixed_bytes": self._bytes(FIXED),
                "saved_bytes": self.port.saved_bytes, "stack_bytes": STACK_LIMIT,
                "largest": max(array.size for kind in (FIXED, STATE, WORK) for _, array in self._all(kind))}

    def _all(self, kind: str) -> Iterator[tuple[str, np.ndarray]]:
        """Yield (C path, array) of all memory that is fixed, persists or is scratch (`kind`)."""
        yield from _arrays(getattr(self.port.memory.parts, kind), kind)
        yield from self._apart(kind).items()

    def _members(self, kind: str) -> str:
        apart = [f"    {ELEMENTS[array.dtype.kind].c} {name}[{max(array.size, 1)}];"
                 for name, array in self._apart(kind).items()]
        return "\n".join([f"    {self.unit.struct(self.structs[kind])} {kind};", *apart])

    def _bytes(self, kind: str) -> int:
        """Return the bytes of all memory that is fixed, persists or is scratch (`kind`)."""
        return sum(max(array.nbytes, array.itemsize) for _, array in self._all(kind))

    def source(self) -> str:
        """Return the text of launchid.c."""
        block = (f"const {self.unit.struct(self.block)} block = "
                 f"{{&FIXED, &state->{STATE}, &work->{WORK}}};")
        report: dict[str, object] = {"report": self.report, "block": block}
        own = "\n".join([
            template("report.c" if self.report else "no_report.c", report),
            template("level.c" if self.port.memory.size.ranged else "no_level.c", report),
            template("estimator.c", {"initial": "".join(self._initial()), "update": self.update, "block": block,
                                      "seal": self.seal}),
            template("save.c", self._saved())])
        for module, name in OWN_CONSTANT.findall(own):
            home = core_module(module.lower())
            self.unit.constant(home.__name__, name, getattr(home, name))
        self.unit.own = own
        names = ",\n    ".join(f'"{term}"' for term in self.config.terms)
        body = "\n".join([
            f"const char *const launchid_terms[LAUNCHID_TERMS] = {{\n    {names}}};\n",
            "/* ---- choices */\n", self._constants(), "/* ---- kernels */\n", self._seal(), self.unit.source(), own])
        common = template("common.c", {"arrays": array_types(body)}).split("\n\n")
        whole = "\n".join([*common, body])
        return "\n".join(["\n\n".join(part for part in common if not _is_spare(part, whole)), body])


def _is_spare(part: str, source: str) -> bool:
    """Whether a part of the source defines an inline function that nothing calls."""
    made = re.match(r"(?:/\*[^*]*\*/\n)?static inline \w+ (\w+)", part)
    return made is not None and len(re.findall(rf"\b{made[1]}\(", source)) < 2


def _arguments(function: Any) -> Iterator[str]:
    """Yield the names of a kernel's arguments."""
    code = getattr(function, "py_func", function).__code__
    yield from code.co_varnames[:code.co_argcount]


def _arrays(value: Any, path: str) -> Iterator[tuple[str, np.ndarray]]:
    """Yield (C path, array) for every array of a nest of named tuples."""
    if isinstance(value, np.ndarray):
        yield path, value
    elif isinstance(value, tuple):
        for name, each in zip(value._fields, value, strict=True):  # type: ignore[attr-defined]
            yield from _arrays(each, f"{path}.{name}")


def _address(path: str, array: np.ndarray) -> str:
    """Return C of the address of an array's first number, or of a number, of the state."""
    return f"{'' if array.ndim else '&'}state->{path}"


def _numbers(array: np.ndarray, depth: int) -> str:
    """Return the C initialiser of an array, indented by `depth`."""
    numbers = [literal(x) for x in array.ravel()] or [literal(array.dtype.type(0))]  # C has no empty array
    rows = [", ".join(numbers[k:k + NUMBERS_A_LINE]) for k in range(0, len(numbers), NUMBERS_A_LINE)]
    between = ",\n" + "    " * (depth + 1)
    return f"{{{between.join(rows)}}}"


def _initialiser(value: Any, depth: int = 1) -> str:
    """Return the C initialiser of a constant struct, without integers known before flight."""
    space, lines = "    " * depth, []
    for name, each in zip(value._fields, value, strict=True):
        if isinstance(each, np.ndarray):
            lines.append(f"{space}.{name} = {_numbers(each, depth) if each.ndim else literal(each[()])}")
        elif isinstance(each, tuple) and not all(isinstance(one, int) for one in each):
            lines.append(f"{space}.{name} = {_initialiser(each, depth + 1)}")
    return "{\n" + ",\n".join(lines) + "}"


def core_module(name: str) -> ModuleType:
    """Return the imported module of launchid_core whose dotted path ends in `name`."""
    return next(module for path, module in sorted(sys.modules.items())
                if path.startswith("launchid_core.") and path.endswith(f".{name}"))


# ---- the C file being made


class Unit:
    """The C file being made.  A kernel is translated when first asked for, once for each choice of argument kinds."""

    def __init__(self) -> None:
        self.kernels: dict[Key, Kernel] = {}
        self.order: list[Kernel] = []
        self.structs: dict[Kind, str] = {}
        self.declarations: list[str] = []
        self.results: list[str] = []
        self.constants: dict[str, str] = {}
        self.named: dict[str, int] = {}
        self.reached: set[Kernel] = set()
        self.own = ""       # C that is written by hand

    def kernel(self, dispatcher: Any, kinds: Iterable[Kind], given: Callable[[], list[Fact]] | None = None) -> Kernel:
        """Return the translation of a kernel for arguments of these kinds.  given: returns facts of the arguments in
        its first call; the translation relies on them until `settle` has compared all calls."""
        function = getattr(dispatcher, "py_func", dispatcher)
        key = function, tuple(kinds)
        if key not in self.kernels:
            count = self.named.get(function.__name__, 0) + 1
            self.named[function.__name__] = count
            name = function.__name__ if count == 1 else f"{function.__name__}_{count}"
            self.kernels[key] = made = Kernel(self, function, key[1], name)
            if given is not None:
                made.given = given()
            made.translate()
            self.order.append(made)
        return self.kernels[key]

    def c(self, kind: Kind) -> str:
        """Return the C type of a kind; a struct is declared when first met."""
        if isinstance(kind, (Scalar, Array)):
            return kind.c
        assert not isinstance(kind, Known)
        if isinstance(kind, Struct):
            return f"{'const ' if kind.constant else ''}{self.struct(kind)} *"
        if kind not in self.structs:
            body = "".join(f"    {self.c(each)} v{k};\n" for k, each in enumerate(kind.kinds))
            self.structs[kind] = f"Results{len(self.structs)}"
            self.results.append(f"typedef struct {{\n{body}}} {self.structs[kind]};\n")
        return self.structs[kind]

    def struct(self, kind: Struct) -> str:
        """Return the C name of a named tuple's struct, which is declared in the header when first met."""
        key = _writable(kind)
        if key not in self.structs:
            fields = zip(kind.fields, kind.kinds, strict=True)
            body = "".join(f"    {self._field(name, each, kind.placed)}\n" for name, each in fields
                           if not (isinstance(each, Known) or (isinstance(each, Struct) and each.is_known)))
            self.structs[key] = name = f"Launchid{kind.of.__name__}"
            about = (inspect.getdoc(kind.of) or "").split("\n\n")[0].replace("\n", " ")
            self.declarations.append(f"/* {about} */\ntypedef struct {{\n{body}}} {name};\n")
        return self.structs[key]

    def _field(self, name: str, kind: Kind, placed: bool) -> str:
        if placed:
            return f"{typed(self.c(kind), name)};"
        if isinstance(kind, Array) and kind.dimensions == 0:
            return f"{kind.element.c} {name};"
        if isinstance(kind, Array):
            shape = f"  /* {' x '.join(map(str, kind.extents))} */" if kind.dimensions > 1 else ""
            return f"{kind.element.c} {name}[{max(math.prod(kind.extents), 1)}];{shape}"  # C has no empty array
        assert isinstance(kind, Struct)
        return f"{self.struct(kind)} {name};"

    def constant(self, module: str, name: str, value: Any) -> str:
        """Return the C name, MODULE_NAME, of a module's constant, which is defined when first met."""
        home = defined_in(module, name)
        label = f"{home.rsplit('.', 1)[-1]}_{name}".upper()
        if label not in self.constants:
            self.constants[label] = _definition(label, value)
        return label

    def settle(self, roots: dict[Key, list[Fact]]) -> None:
        """Translate kernels again until each relies on facts that all its calls share.

        roots: (kernel, kinds) called from C written by hand -> facts of its arguments
        """
        news = self._news(roots)
        while news:
            while news:
                kernel = next(each for each in self.order if each in news)  # the called before their callers
                if kernel.learn(news.pop(kernel)):
                    news = {each: each.given for each in self.order if kernel in each.asked} | news
            news = self._news(roots)

    def _news(self, roots: dict[Key, list[Fact]]) -> dict[Kernel, list[Fact]]:
        """Return called kernels -> facts that all their calls share, where the kernel relies on others."""
        found = {self.kernels[key]: facts for key, facts in roots.items()}
        waiting = list(found)
        while waiting:
            for called, facts in waiting.pop().c.calls:
                if called in found:
                    found[called] = [shared(a, b) for a, b in zip(found[called], facts, strict=True)]
                else:
                    found[called] = facts
                    waiting.append(called)
        self.reached = set(found)
        return {kernel: facts for kernel, facts in found.items() if any(map(differ, facts, kernel.given))}

    def source(self) -> str:
        """Return C of the constants, result structs and functions that are used."""
        functions = self._functions()
        used = set(re.findall(r"\w+", "\n".join(functions) + self.own))
        constants = {label: text for label, text in self.constants.items() if label in used}
        counts = [text for text in constants.values() if text.startswith(" ")]
        others = [text for text in constants.values() if not text.startswith(" ")]
        results = [text for text in self.results if re.findall(r"\w+", text)[-1] in used]
        return "\n".join(["enum {", *counts, "};\n", *others, "", *results, *functions])

    def _functions(self) -> list[str]:
        """Return C of the functions that are reached, the called before their callers; without those whose calls stood
        in assignments that nothing reads."""
        functions, words = list[str](), set(re.findall(r"\w+", self.own))
        for made in reversed(self.order):
            if not self.reached or (made in self.reached and (made.name in words or not self.own)):
                functions.insert(0, made.source())
                words |= set(re.findall(r"\w+", functions[0]))
        return functions


def _writable(kind: Kind) -> Kind:
    """Return a struct or array kind without `constant`; a struct of pointers keeps it for what they point to."""
    if isinstance(kind, Struct):
        return replace(kind, constant=False,
                       kinds=kind.kinds if kind.placed else tuple(_writable(each) for each in kind.kinds))
    return replace(kind, constant=False) if isinstance(kind, Array) else kind


def _definition(label: str, value: Any) -> str:
    """Return C that defines a constant: an enumerator, a macro, or an array."""
    if isinstance(value, (int, np.integer)) and not isinstance(value, bool) and abs(int(value)) < INT_MAX:
        return f"    {label} = {int(value)},"
    if not isinstance(value, (np.ndarray, tuple)):
        number = literal(value)
        return f"#define {label} {f'({number})' if number[0] in '-(' else number}"
    array = np.array(value)
    kind = kind_of(array)
    assert isinstance(kind, Array)
    numbers = ", ".join(literal(each) for each in array.ravel())
    return (f"static const {kind.element.c} {label}_numbers[] = {{{numbers}}};\n"
            f"static const {kind.c} {label} = {{{label}_numbers, "
            f"{', '.join(map(str, array.shape))}}};")


@cache
def _tree(module: str) -> ast.Module:
    return ast.parse(inspect.getsource(sys.modules[module]))


@cache
def defined_in(module: str, name: str) -> str:
    """Return the dotted path of the module that defines `name`, following relative imports from `module`."""
    for node in _tree(module).body:
        if isinstance(node, ast.ImportFrom) and node.level > 0:
            for alias in node.names:
                if (alias.asname or alias.name) == name:
                    around = module.rsplit(".", node.level)[0]
                    return defined_in(f"{around}.{node.module}", alias.name)
    return module
