"""A C file being made: its structs, constants and functions, each after what it needs."""

import ast
import inspect
import math
import re
import sys
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from .folding import Fact, differ, shared
from .kernel import Kernel, typed
from .kinds import Array, Kind, Known, Scalar, Struct, kind_of, literal

INT_MAX = 2**31 - 1    # of an enumerator


Key = tuple[Callable[..., Any], tuple[Kind, ...]]


class Unit:
    """Kernels are translated when they are asked for, once for each kinds of arguments."""

    def __init__(self, is_general: bool = False) -> None:
        self.is_general = is_general    # kernels know nothing of their callers
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
        """The translation of a kernel for arguments of these kinds; given: what its first call says of them, which is
        taken for what all say until `settle` has asked the others."""
        function = getattr(dispatcher, "py_func", dispatcher)
        key = function, tuple(kinds)
        if key not in self.kernels:
            count = self.named.get(function.__name__, 0) + 1
            self.named[function.__name__] = count
            name = function.__name__ if count == 1 else f"{function.__name__}_{count}"
            self.kernels[key] = made = Kernel(self, function, key[1], name)
            if given is not None and not self.is_general:
                made.given = given()
            made.translate()
            self.order.append(made)
        return self.kernels[key]

    def c(self, kind: Kind) -> str:
        """The C type of a kind; a struct is declared when first met."""
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
        """The C name of a named tuple's struct; it is declared when first met, in the header."""
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
        if isinstance(kind, Array):
            shape = f"  /* {' x '.join(map(str, kind.extents))} */" if kind.dimensions > 1 else ""
            return f"{kind.element.c} {name}[{max(math.prod(kind.extents), 1)}];{shape}"  # C has no empty array
        assert isinstance(kind, Struct)
        return f"{self.struct(kind)} {name};"

    def constant(self, module: str, name: str, value: Any) -> str:
        """The C name of a module's constant, MODULE_NAME."""
        home = defined_in(module, name)
        label = f"{home.rsplit('.', 1)[-1]}_{name}".upper()
        if label not in self.constants:
            self.constants[label] = _definition(label, value)
        return label

    def settle(self, roots: dict[Key, list[Fact]]) -> None:
        """Tell each kernel what its calls have in common, until none learns more; roots: what is given from outside."""
        news = self._news(roots)
        while news:
            while news:
                kernel = next(each for each in self.order if each in news)  # the called before their callers
                if kernel.learn(news.pop(kernel)):
                    news = {each: each.given for each in self.order if kernel in each.asked} | news
            news = self._news(roots)

    def _news(self, roots: dict[Key, list[Fact]]) -> dict[Kernel, list[Fact]]:
        """Kernels that are called, and what their calls have in common, where they do not know it yet."""
        found = {self.kernels[key]: facts for key, facts in roots.items()}
        waiting = list(found)
        while waiting:
            for called, facts in waiting.pop().c.calls:
                assert isinstance(called, Kernel)
                if called in found:
                    found[called] = [shared(a, b) for a, b in zip(found[called], facts, strict=True)]
                else:
                    found[called] = facts
                    waiting.append(called)
        self.reached = set(found)
        return {kernel: facts for kernel, facts in found.items() if any(map(differ, facts, kernel.given))}

    def source(self) -> str:
        """Constants, structs of results and functions, as far as they are used."""
        functions = [made.source() for made in self.order if made in self.reached or not self.reached]
        used = set(re.findall(r"\w+", "\n".join(functions) + self.own))
        constants = {label: text for label, text in self.constants.items() if label in used}
        counts = [text for text in constants.values() if text.startswith(" ")]
        others = [text for text in constants.values() if not text.startswith(" ")]
        results = [text for text in self.results if re.findall(r"\w+", text)[-1] in used]
        return "\n".join(["enum {", *counts, "};\n", *others, "", *results, *functions])


def _writable(kind: Kind) -> Kind:
    """A struct without what says that it may not be written to; one of addresses keeps that of each."""
    if isinstance(kind, Struct):
        return replace(kind, constant=False,
                       kinds=kind.kinds if kind.placed else tuple(_writable(each) for each in kind.kinds))
    return replace(kind, constant=False) if isinstance(kind, Array) else kind


def _definition(label: str, value: Any) -> str:
    """The definition of a constant: an enumerator, a macro, or an array."""
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
    """Return the module that defines `name`, following relative imports."""
    for node in _tree(module).body:
        if isinstance(node, ast.ImportFrom) and node.level > 0:
            for alias in node.names:
                if (alias.asname or alias.name) == name:
                    around = module.rsplit(".", node.level)[0]
                    return defined_in(f"{around}.{node.module}", alias.name)
    return module
