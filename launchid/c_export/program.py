"""An estimator as C files: what is fixed, what persists and scratch as structs, and its two kernels."""

import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from string import Template
from types import ModuleType
from typing import Any

import numpy as np

from launchid_core import EDGES, Config, EstimateStatus, Port, Status, port_of

from .expressions import EXACT_FUNCTIONS
from .folding import Fact
from .kinds import ELEMENTS, FLOAT, Array, Kind, Struct, array_types, literal, struct_of
from .unit import Key, Unit

TEMPLATES = Path(__file__).parent / "template"
NUMBERS_A_LINE = 6
BYTES_A_LINE = 20
STACK_LIMIT = 2048     # bytes of the deepest call at -O2; tests/launchid/c_export/test_port_kit.py computes it
OWN_CONSTANT = re.compile(r"\b(RING|WINDOW|REPORT|STATES|GUARD)_([A-Z0-9_]+)\b")
FIXED, STATE, WORK = "fixed", "state", "work"
C_GUARD = f"{STATE}.guard"


def c_files(config: Config, general: bool = False, vectors: dict[str, int] | None = None) -> dict[str, str]:
    """File name -> text of an estimator with this configuration; `general`: kernels that know nothing of their callers,
    to count what they do of arrays of any extents; vectors: how many `flights` and `samples` it is checked with."""
    program = _Program(config, port_of(config), general)
    header, source = program.header(), program.source()
    functions = sorted(name for name in (*EXACT_FUNCTIONS, "fabs", "frexp", "ldexp")
                       if re.search(rf"\b{name}\(", source))
    return {"launchid.h": header, "launchid.c": source, "replay.c": template("replay.c", {}),
            "README.md": template("README.md", program.sizes() | {"functions": ", ".join(functions)}
                                  | (vectors or {"flights": 0, "samples": 0}))}


def template(name: str, values: dict[str, object]) -> str:
    """The text of a template with its values."""
    text = (TEMPLATES / name).read_text(encoding="utf-8")
    return Template(text).substitute(values) if values else text


OF_LOGS = ("UNCHECKED",)   # statuses that no flight has


def _enumeration(names: type[Status] | type[EstimateStatus]) -> str:
    return "\n".join(f"    LAUNCHID_{each.name} = {each.value}," for each in names if each.name not in OF_LOGS)


class _Program:
    """One configuration's."""

    def __init__(self, config: Config, port: Port, general: bool) -> None:
        self.config, self.port, self.unit = config, port, Unit(general)
        memory = port.memory
        parts = memory.parts._asdict()
        structs = {name: struct_of(part, constant=name == FIXED) for name, part in parts.items()}
        self.structs: dict[str, Struct] = structs
        self.block = Struct(type(memory.parts), tuple(structs.values()), constant=True, placed=True)
        apart: dict[str, Kind] = {
            name: Array(ELEMENTS[array.dtype.kind], array.ndim, constant=port.apart[name] == FIXED)
            for name, array in memory.apart.items()}
        self.kinds: dict[str, Kind] = {"size": struct_of(memory.size), "block": self.block, "words": structs[STATE],
                                       **apart}
        self.unit.struct(self.block)
        roots = self._roots()
        sealed = replace(structs[STATE], constant=True)
        if port.seal is not None:
            rows = memory.apart["rows"]
            key: Key = getattr(port.seal, "py_func", port.seal), (sealed, sealed, Array(FLOAT, 2, constant=True))
            roots[key] = [None, None, rows.shape]
        for root in roots:
            self.unit.kernel(*root, partial(roots.__getitem__, root))
        if not general:
            self.unit.settle(roots)
        self.seal = f"fold_words(&state->{STATE})"
        if port.seal is not None:
            kernel, extents = self.unit.kernel(*key), ", ".join(map(str, rows.shape))
            given = f"&state->{STATE}", f"&state->{STATE}", f"(ConstMatrix){{state->rows, {extents}}}"
            self.seal = f"{kernel.name}({', '.join(kernel.written(given))})"
        self.update, self.report = self._call(port.update), self._call(port.report)

    def _roots(self) -> dict[Key, list[Fact]]:
        """What is known of the memory that the two kernels take."""
        apart = {name: array if self.port.apart[name] == FIXED else array.shape
                 for name, array in self.port.memory.apart.items()}
        called = [function for function in (self.port.update, self.port.report) if function is not None]
        return {self._key(function): [apart.get(name) for name in _arguments(function)] for function in called}

    def _key(self, function: Any) -> Key:
        return (getattr(function, "py_func", function),
                tuple(self.kinds.get(name, FLOAT) for name in _arguments(function)))

    def _apart(self, kind: str) -> dict[str, np.ndarray]:
        """The arrays that stand apart, of what is fixed, persists or is scratch."""
        return {name: array for name, array in self.port.memory.apart.items() if self.port.apart[name] == kind}

    def _call(self, function: Any) -> str:
        """C of a call with the memory that the function takes, and a sample `s`."""
        if function is None:
            return ""
        kernel = self.unit.kernel(*self._key(function))
        return f"{kernel.name}({', '.join(map(self._given, kernel.written(_arguments(function))))})"

    def _given(self, name: str) -> str:
        """C of an argument."""
        if name == "block":
            return "&block"
        if name == "words":
            return f"&state->{STATE}"
        array, kind = self.port.memory.apart.get(name), self.kinds.get(name)
        if array is None or not isinstance(kind, Array):
            return f"s->{name}"
        place = name.upper() if kind.constant else f"{self.port.apart[name]}->{name}"
        return f"({kind.c}){{{place}, {', '.join(map(str, array.shape))}}}"

    def _initial(self) -> Iterator[str]:
        """Statements that set what is not zero after a reset."""
        for path, array in self._state():
            flat = array.ravel()
            places = np.flatnonzero((flat != 0) | np.signbit(flat) if flat.dtype.kind == "f" else flat != 0)
            for k in places.tolist() if path != C_GUARD else ():
                yield f"    state->{path}[{k}] = {literal(flat[k])};\n"

    def _seal(self) -> str:
        """The seal of what is carried on: as the core's `fold_words`, array by array in the extents in use."""
        state = self.port.memory.parts.state
        first = state._fields.index(self.port.carried)
        lines = [template("seal.c", {}),
                 f"static int64_t fold_words(const {self.unit.struct(self.structs[STATE])} *state)",
                 "{", "    int64_t seal = 0;"]
        for name, part in list(zip(state._fields, state, strict=True))[first:]:
            lines += [f"    seal = fold_{'numbers' if array.dtype.kind == 'f' else 'counts'}(seal, state->{path}, "
                      f"{array.size});" for path, array in _arrays(part, name) if array.size]
        return "\n".join([*lines, "    return seal;", "}\n"])

    def _constants(self) -> str:
        """The constants: tables and the fixed struct."""
        fixed = self.port.memory.parts.fixed
        tables = [f"static const double {name.upper()}[] = {_numbers(array, 1)};\n"
                  for name, array in self._apart(FIXED).items()
                  if re.search(rf"\b{name.upper()}\b", self.update + self.report)]
        return "\n".join([*tables, f"static const {self.unit.struct(self.structs[FIXED])} FIXED = "
                                   f"{_initialiser(fixed)};\n"])

    # ---- files

    def header(self) -> str:
        """The text of launchid.h."""
        return template("launchid.h", self.sizes() | {
            "terms": len(self.config.terms), "max_changes": core_module("changes").MAX_EVENTS,
            "statuses": _enumeration(Status),
            "estimate_statuses": _enumeration(EstimateStatus), "structs": "\n".join(self.unit.declarations),
            "state": self._members(STATE), "work": self._members(WORK),
            **{f"edge_{k}": literal(edge) for k, edge in enumerate(EDGES)}})

    def _state(self) -> Iterator[tuple[str, np.ndarray]]:
        """Arrays that persist, in the order in which they are saved, by their C path."""
        yield from _arrays(self.port.memory.parts.state, STATE)
        yield from self._apart(STATE).items()

    def _saved(self) -> dict[str, object]:
        """The code that saves and restores: the same bytes as the Python estimator's."""
        head = self.port.preface
        rows = [", ".join(map(str, head[k:k + BYTES_A_LINE])) for k in range(0, len(head), BYTES_A_LINE)]
        kinds = [(path, array.size, "numbers" if array.dtype.kind == "f" else "words")
                 for path, array in self._state() if array.size]
        saves, restores = ("".join(f"    at = {does}_{kind}(saved, at, state->{path}, {n}U);\n"
                                   for path, n, kind in kinds) for does in ("put", "take"))
        saves = saves.replace(f"state->{C_GUARD}", "guard")
        return {"preface": ",\n    ".join(rows), "saves": saves, "restores": restores, "seal": self.seal}

    def sizes(self) -> dict[str, object]:
        """The configuration in words, and its sizes."""
        config = self.config
        return {"formulation": config.formulation, "library": ", ".join(config.terms),
                "window": literal(config.window), "period": literal(config.sample_period),
                "state_bytes": self._bytes(STATE) + 8,  # `busy`
                "work_bytes": self._bytes(WORK), "fixed_bytes": self._bytes(FIXED),
                "saved_bytes": self.port.saved_bytes, "stack_bytes": STACK_LIMIT,
                "largest": max(array.size for kind in (FIXED, STATE, WORK) for _, array in self._all(kind))}

    def _all(self, kind: str) -> Iterator[tuple[str, np.ndarray]]:
        """Every array of a part, and of what stands apart of its kind."""
        yield from _arrays(getattr(self.port.memory.parts, kind), kind)
        yield from self._apart(kind).items()

    def _members(self, kind: str) -> str:
        apart = [f"    {ELEMENTS[array.dtype.kind].c} {name}[{max(array.size, 1)}];"
                 for name, array in self._apart(kind).items()]
        return "\n".join([f"    {self.unit.struct(self.structs[kind])} {kind};", *apart])

    def _bytes(self, kind: str) -> int:
        """The bytes of the arrays."""
        return sum(max(array.nbytes, array.itemsize) for _, array in self._all(kind))

    def source(self) -> str:
        """The text of launchid.c."""
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
    elif isinstance(value, tuple):
        for name, each in zip(value._fields, value, strict=True):  # type: ignore[attr-defined]
            yield from _arrays(each, f"{path}.{name}")


def _numbers(array: np.ndarray, depth: int) -> str:
    """The initialiser of an array."""
    numbers = [literal(x) for x in array.ravel()] or [literal(array.dtype.type(0))]  # C has no empty array
    rows = [", ".join(numbers[k:k + NUMBERS_A_LINE]) for k in range(0, len(numbers), NUMBERS_A_LINE)]
    between = ",\n" + "    " * (depth + 1)
    return f"{{{between.join(rows)}}}"


def _initialiser(value: Any, depth: int = 1) -> str:
    """The initialiser of a constant struct, without what is known."""
    space, lines = "    " * depth, []
    for name, each in zip(value._fields, value, strict=True):
        if isinstance(each, np.ndarray):
            lines.append(f"{space}.{name} = {_numbers(each, depth)}")
        elif isinstance(each, tuple) and not all(isinstance(one, int) for one in each):
            lines.append(f"{space}.{name} = {_initialiser(each, depth + 1)}")
    return "{\n" + ",\n".join(lines) + "}"


def core_module(name: str) -> ModuleType:
    """A module of the core by the last part of its name."""
    return next(module for path, module in sorted(sys.modules.items())
                if path.startswith("launchid_core.") and path.endswith(f".{name}"))
