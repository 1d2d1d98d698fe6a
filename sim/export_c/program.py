"""An estimator as C files: what is fixed, what persists and scratch as structs, and its two kernels."""

import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from launchid_core import EDGES, Config, EstimateStatus, Port, Status, port_of

from .expressions import FUNCTIONS
from .kinds import ABSENT, FLOAT, Kind, Struct, array_types, literal, struct_of
from .unit import PACKAGE, Unit

TEMPLATES = Path(__file__).parent / "template"
NUMBERS_A_LINE = 6
BYTES_A_LINE = 20
STACK_LIMIT = 2048     # bytes of the deepest call at -O2; tests/test_port_kit.py computes it
OWN_CONSTANT = re.compile(r"\b(RING|WINDOW|REPORT|STATES)_([A-Z0-9_]+)\b")
FIXED, STATE, WORK = "fixed", "state", "work"


def c_files(config: Config) -> dict[str, str]:
    """File name -> text of an estimator with this configuration.  Nothing is compiled for it."""
    program = _Program(config, port_of(config))
    header, source = program.header(), program.source()
    functions = sorted(name for name in (*FUNCTIONS, "fabs", "frexp", "ldexp") if re.search(rf"\b{name}\(", source))
    return {"launchid.h": header, "launchid.c": source, "replay.c": template("replay.c", {}),
            "README.md": template("README.md", program.sizes() | {"functions": ", ".join(functions)})}


def template(name: str, values: dict[str, object]) -> str:
    """The text of a template with its values."""
    text = (TEMPLATES / name).read_text(encoding="utf-8")
    return Template(text).substitute(values) if values else text


def _enumeration(names: type[Status] | type[EstimateStatus]) -> str:
    return "\n".join(f"    LAUNCHID_{each.name} = {each.value}," for each in names)


class _Program:
    """One configuration's."""

    def __init__(self, config: Config, port: Port) -> None:
        self.config, self.port, self.unit = config, port, Unit()
        self.there = {name: part for name, part in zip(port.parts._fields, port.parts, strict=True)
                      if part is not None}
        kinds: dict[str, Kind] = dict.fromkeys(port.parts._fields, ABSENT)
        self.structs: dict[str, Struct] = {}
        for name, part in self.there.items():
            self.structs[name] = replace(struct_of(part), constant=port.kinds[name] == FIXED)
            self.unit.struct(self.structs[name])
        self.kinds = kinds | self.structs
        self.update, self.report = self._call(port.update), self._call(port.report)

    def _of(self, kind: str) -> list[str]:
        """Names of the parts that are fixed, persist or are scratch."""
        return [name for name in self.there if self.port.kinds[name] == kind]

    def _call(self, function: Any) -> str:
        """C of a call with the parts that the kernel takes, and a sample `s`."""
        if function is None:
            return ""
        names = list(_arguments(function))
        kinds = [self.kinds.get({"rep": "report"}.get(name, name), FLOAT) for name in names]
        kernel = self.unit.kernel(function, kinds)
        given = []
        for name, kind in zip(names, kinds, strict=True):
            part = {"rep": "report"}.get(name, name)
            if part in self.there:
                of = self.port.kinds[part]
                given.append(f"&{part.upper()}" if of == FIXED else f"&{of}->{part}")
            elif kind != ABSENT:
                given.append(f"s->{name}")
        return f"{kernel.name}({', '.join(given)})"

    def _initial(self) -> Iterator[str]:
        """Statements that set what is not zero after a reset."""
        for path, array in self._state():
            flat = array.ravel()
            places = np.flatnonzero((flat != 0) | np.signbit(flat) if flat.dtype.kind == "f" else flat != 0)
            for k in places.tolist():
                yield f"    state->{path}[{k}] = {literal(flat[k])};\n"

    def _constants(self) -> str:
        """Structs that never change."""
        return "\n".join(f"static const {self.unit.struct(self.structs[name])} {name.upper()} = "
                         f"{_initialiser(self.there[name])};\n" for name in self._of(FIXED))

    # ---- files

    def header(self) -> str:
        """launchid.h"""
        return template("launchid.h", self.sizes() | {
            "terms": len(self.config.terms), "max_changes": _of_module("changes", "MAX_EVENTS"),
            "statuses": _enumeration(Status),
            "estimate_statuses": _enumeration(EstimateStatus), "structs": "\n".join(self.unit.declarations),
            "state": self._members(STATE), "work": self._members(WORK),
            **{f"edge_{k}": literal(edge) for k, edge in enumerate(EDGES)}})

    def _state(self) -> Iterator[tuple[str, np.ndarray]]:
        """Arrays that persist, in the order in which they are saved, by their C path."""
        for name in self._of(STATE):
            yield from _arrays(self.there[name], name)

    def _saved(self) -> dict[str, object]:
        """What saves and restores: the same bytes as the Python estimator's."""
        head = self.port.preface
        rows = [", ".join(map(str, head[k:k + BYTES_A_LINE])) for k in range(0, len(head), BYTES_A_LINE)]
        kinds = [(path, array.size, "numbers" if array.dtype.kind == "f" else "words")
                 for path, array in self._state() if array.size]
        saves, restores = ("".join(f"    at = {does}_{kind}(saved, at, state->{path}, {n}U);\n"
                                   for path, n, kind in kinds) for does in ("put", "take"))
        return {"preface": ",\n    ".join(rows), "saves": saves, "restores": restores}

    def sizes(self) -> dict[str, object]:
        """What the configuration is, and how large."""
        config = self.config
        return {"formulation": config.formulation, "library": ", ".join(config.terms),
                "window": literal(config.window), "period": literal(config.sample_period),
                "state_bytes": self._bytes(STATE) + 8,  # `busy`
                "work_bytes": self._bytes(WORK), "fixed_bytes": self._bytes(FIXED),
                "saved_bytes": self.port.saved_bytes, "stack_bytes": STACK_LIMIT,
                "largest": max(array.size for name, part in self.there.items() for _, array in _arrays(part, name))}

    def _members(self, kind: str) -> str:
        return "\n".join(f"    {self.unit.struct(self.structs[name])} {name};" for name in self._of(kind))

    def _bytes(self, kind: str) -> int:
        """Of the arrays."""
        return sum(max(array.nbytes, array.itemsize) for name in self._of(kind)
                   for _, array in _arrays(self.there[name], name))

    def source(self) -> str:
        """launchid.c"""
        own = "\n".join([
            template("report.c", {"report": self.report}) if self.port.report else template("no_report.c", {}),
            template("estimator.c", {"initial": "".join(self._initial()), "update": self.update}),
            template("save.c", self._saved())])
        for module, name in OWN_CONSTANT.findall(own):
            self.unit.constant(f"{PACKAGE}.{module.lower()}", name, _of_module(module.lower(), name))
        names = ",\n    ".join(f'"{term}"' for term in self.config.terms)
        body = "\n".join([
            f"const char *const launchid_terms[LAUNCHID_TERMS] = {{\n    {names}}};\n",
            "/* ---- choices */\n", self._constants(), "/* ---- kernels */\n", self.unit.source(), own])
        common = template("common.c", {"arrays": array_types(body)}).split("\n\n")
        whole = "\n".join([*common, body])
        return "\n".join(["\n\n".join(part for part in common if not _is_spare(part, whole)), body])


def _is_spare(part: str, source: str) -> bool:
    """Whether a part of the source defines a function that is not called."""
    made = re.match(r"(?:/\*[^*]*\*/\n)?static inline \w+ (\w+)", part)
    return made is not None and len(re.findall(rf"\b{made[1]}\(", source)) < 2


def _arguments(function: Any) -> Iterator[str]:
    """Names of a kernel's arguments."""
    code = getattr(function, "py_func", function).__code__
    yield from code.co_varnames[:code.co_argcount]


def _arrays(value: Any, path: str) -> Iterator[tuple[str, np.ndarray]]:
    """Every array of a nest of named tuples, by its C path."""
    if isinstance(value, np.ndarray):
        yield path, value
        return
    for name, each in zip(value._fields, value, strict=True):
        yield from _arrays(each, f"{path}.{name}")


def _initialiser(value: Any, depth: int = 1) -> str:
    """Of a constant struct."""
    space, lines = "    " * depth, []
    for name, each in zip(value._fields, value, strict=True):
        if isinstance(each, np.ndarray):
            numbers = [literal(x) for x in each.ravel()] or [literal(each.dtype.type(0))]  # C has no empty array
            rows = [", ".join(numbers[k:k + NUMBERS_A_LINE]) for k in range(0, len(numbers), NUMBERS_A_LINE)]
            lines.append(f"{space}.{name} = {{{f',{chr(10)}{space}    '.join(rows)}}}")
        else:
            lines.append(f"{space}.{name} = {_initialiser(each, depth + 1)}")
    return "{\n" + ",\n".join(lines) + "}"


def _of_module(module: str, name: str) -> Any:
    """A constant of the core."""
    return getattr(sys.modules[f"{PACKAGE}.{module}"], name)
