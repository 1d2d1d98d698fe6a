"""An estimator as two C files: its memory in one struct, its kernels, and the order in which they are called."""

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from launchid_core import EDGES, Call, Config, EstimateStatus, Estimator, Given, Port, Status, port_of

from .expressions import word
from .kinds import Array, kind_of, literal
from .unit import PACKAGE, Unit

TEMPLATES = Path(__file__).parent / "template"
NUMBERS_A_LINE = 6
OWN_CONSTANT = re.compile(r"\b(RING|WINDOW|CHANGES|FILTERED|UNCERTAINTY)_([A-Z0-9_]+)\b")


def c_files(config: Config) -> dict[str, str]:
    """File name -> text of an estimator with this configuration."""
    estimator = Estimator(config)
    program = _Program(estimator, port_of(estimator))
    return {"launchid.h": program.header(), "launchid.c": program.source(), "replay.c": _template("replay.c", {})}


def _template(name: str, values: dict[str, object]) -> str:
    text = (TEMPLATES / name).read_text(encoding="utf-8")
    return Template(text).substitute(values) if values else text


def _enumeration(names: type[Status] | type[EstimateStatus]) -> str:
    return "\n".join(f"    LAUNCHID_{each.name} = {each.value}," for each in names)


class _Program:
    """One estimator's."""

    def __init__(self, estimator: Estimator, of: Port) -> None:
        self.estimator, self.port, self.unit = estimator, of, Unit()
        self.memory = of.state | of.scratch
        self.calls = "\n".join(self._call(each) for each in of.calls)

    # ---- memory

    def _place(self, array: np.ndarray) -> str:
        """C of an array's first number: in the memory, or a part of an array there."""
        address = array.__array_interface__["data"][0]
        for name, whole in (self.memory | self.port.constants).items():
            offset = address - whole.__array_interface__["data"][0]
            if 0 <= offset < max(whole.nbytes, 1):
                begin = f"e->{name}" if name in self.memory else f"(void *){name.upper()}"
                return f"{begin} + {offset // whole.itemsize}" if offset else begin
        raise KeyError("an array of a call that the port does not name")

    def _literal(self, value: Any) -> str:
        """C of an argument."""
        if isinstance(value, np.ndarray):
            kind = kind_of(value)
            assert isinstance(kind, Array)
            return f"({kind.c}){{{self._place(value)}, {', '.join(map(str, value.shape))}}}"
        if isinstance(value, tuple):
            return f"({self.unit.c(kind_of(value))}){{{', '.join(self._literal(each) for each in value)}}}"
        return literal(value)

    def _call(self, call: Call) -> str:
        """A function call_KERNEL(e, what is given) that knows the rest."""
        kinds = [kind_of(each.like if isinstance(each, Given) else each) for each in call.arguments]
        kernel = self.unit.kernel(call.kernel, kinds)
        names = [word(argument.arg) for argument in kernel.tree.args.args]
        given = [f"{self.unit.c(kind)} {name}" for name, kind, each in zip(names, kinds, call.arguments, strict=True)
                 if isinstance(each, Given)]
        arguments = [name if isinstance(each, Given) else self._literal(each)
                     for name, each in zip(names, call.arguments, strict=True)]
        result = self.unit.c(kernel.kinds.result or kinds[0])
        joined = (",\n" + " " * (12 + len(kernel.name))).join(arguments)
        return (f"static {result} call_{kernel.name}({', '.join(['launchid_estimator *e', *given])})\n{{\n"
                f"    {'' if result == 'void' else 'return '}{kernel.name}({joined});\n}}\n")

    def _fields(self) -> str:
        """Of the struct."""
        lines = []
        for name, array in self.memory.items():
            kind = kind_of(array)
            assert isinstance(kind, Array)
            shape = f"  /* {' x '.join(map(str, array.shape))} */" if array.ndim > 1 else ""
            lines.append(f"    {kind.element.c} {name}[{max(array.size, 1)}];{shape}")
        return "\n".join(lines)

    def _initial(self) -> Iterator[str]:
        """Statements that set what is not zero after a reset."""
        for name, array in self.port.state.items():
            flat = array.ravel()
            places = np.flatnonzero((flat != 0) | np.signbit(flat) if flat.dtype.kind == "f" else flat != 0)
            for k in places.tolist():
                yield f"    e->{name}[{k}] = {literal(flat[k])};\n"

    def _constants(self) -> str:
        """Arrays that never change."""
        lines = []
        for name, array in self.port.constants.items():
            kind = kind_of(array)
            assert isinstance(kind, Array)
            numbers = [literal(each) for each in array.ravel()]
            rows = [", ".join(numbers[k:k + NUMBERS_A_LINE]) for k in range(0, len(numbers), NUMBERS_A_LINE)]
            joined = ",\n    ".join(rows)
            lines.append(f"static const {kind.element.c} {name.upper()}[{array.size}] = {{\n    {joined}}};\n")
        return "\n".join(lines)

    # ---- files

    def header(self) -> str:
        """launchid.h"""
        config = self.estimator.config
        return _template("launchid.h", {
            "formulation": config.formulation, "library": ", ".join(config.terms), "bytes": self._bytes(),
            "window": literal(config.window), "period": literal(config.sample_period), "terms": len(config.terms),
            "max_changes": _of_module("changes", "MAX_EVENTS"), "statuses": _enumeration(Status),
            "estimate_statuses": _enumeration(EstimateStatus), "fields": self._fields(),
            **{f"edge_{k}": literal(edge) for k, edge in enumerate(EDGES)}})

    def _bytes(self) -> int:
        """Of the struct's arrays, to 8 each."""
        return sum(-(-array.nbytes // 8) * 8 for array in self.memory.values()) + 16

    def source(self) -> str:
        """launchid.c"""
        own = self._own()
        for module, name in OWN_CONSTANT.findall(own):
            self.unit.constant(f"{PACKAGE}.{module.lower()}", name, _of_module(module.lower(), name))
        names = ",\n    ".join(f'"{term}"' for term in self.estimator.config.terms)
        return "\n".join([
            _template("common.c", {}), f"const char *const launchid_terms[LAUNCHID_TERMS] = {{\n    {names}}};\n",
            "/* ---- choices */\n", self._constants(), "/* ---- kernels */\n", self.unit.source(),
            "/* ---- the kernels' arguments */\n", self.calls, own])

    def _own(self) -> str:
        """What is not translated: the order of the calls, and the way out."""
        called = [each.kernel.__name__ for each in self.port.calls]
        end = _template("estimator.c", {"initial": "".join(self._initial())})
        if self.estimator.config.formulation != "filtered":
            close = next(name for name in called if name.startswith("close"))
            return "\n".join([_template("no_range.c", {}), _template("regression.c", {"close": close}), end])
        known = _template("known.c", {"known": literal(_of_module("estimator", "KNOWN")),
                                      "first_std": literal(_of_module("tracker", "FIRST_STD"))})
        has_range = "watch_range" in called
        level = _template("range.c" if has_range else "no_range.c", {})
        follow = _template("filtered.c", {"watch": "    watch(e, complete);\n" if has_range else ""})
        return "\n".join([known, level, follow, end])


def _of_module(module: str, name: str) -> Any:
    """A constant of the core."""
    return getattr(sys.modules[f"{PACKAGE}.{module}"], name)
