"""The layers, by walking the syntax trees: what each package may import, call and do."""

import ast
import functools
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

import launchid_core

ROOT = Path(__file__).resolve().parents[2]
CORE = sorted((ROOT / "launchid_core").rglob("*.py"))
SIM = sorted((ROOT / "sim").rglob("*.py"))
GROUND = sorted((ROOT / "launchid").rglob("*.py"))
NOT_ON_BOARD = {"time", "os", "sys", "random", "logging", "datetime", "socket", "subprocess", "pathlib", "io",
                "threading"}
NOT_FLOWN = {"launchid_core/cache.py"}  # where compiled code is kept: nothing calls it after construction
STANDARD = set(sys.stdlib_module_names)
EXTRAS = {"matplotlib", "pandas", "distributed", "argcomplete", "pyulog", "mcap", "mcap_ros2", "mcap_protobuf",
          "h5py", "pyarrow", "scipy", "pymavlink", "zstandard",
          "control"}   # imported where they are used, named by `sim.errors`
ALLOCATORS = {"zeros", "empty", "ones", "full", "array", "eye", "arange", "linspace", "zeros_like", "empty_like",
              "ones_like", "full_like", "asarray", "ascontiguousarray", "copy", "concatenate", "stack", "dot", "matmul",
              "outer", "append"}
BUILT_IN = {"list", "dict", "set", "tuple", "sorted", "open", "print", "str", "eval", "exec"}


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def place(path: Path, line: int, *what: str) -> str:
    """`file:line: what` of a fault, so that a failure lists them all."""
    return f"{name_of(path)}:{line}: {' '.join(what)}"


def top(module: str) -> str:
    return module.split(".", maxsplit=1)[0]


def nowhere(faults: Iterable[str]) -> None:
    """Fail with every fault in a line of its own."""
    said = list(faults)
    assert not said, "\n".join(["", *said])


@functools.cache
def tree_of(path: Path) -> ast.Module:
    """The syntax tree of a file, which nobody changes."""
    return ast.parse(path.read_text(encoding="utf-8"), filename=str(path))


@functools.cache
def imports(path: Path) -> tuple[tuple[str, tuple[str, ...], int], ...]:
    """(absolute module, names taken from it, line) of every import, at any depth of the file."""
    return tuple(imported(path))


def imported(path: Path) -> Iterator[tuple[str, tuple[str, ...], int]]:
    package = path.relative_to(ROOT).with_suffix("").parts[:-1]
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, (), node.lineno
        elif isinstance(node, ast.ImportFrom):
            base = package[:len(package) - node.level + 1] if node.level else ()
            module = ".".join([*base, *([node.module] if node.module else [])])
            yield module, tuple(alias.name for alias in node.names), node.lineno


def dotted(node: ast.expr) -> str:
    """`np.linalg.inv` of the expression that says so; '' for what is no dotted name."""
    parts = []
    while isinstance(node, ast.Attribute):
        parts.append(node.attr)
        node = node.value
    return ".".join([node.id, *reversed(parts)]) if isinstance(node, ast.Name) else ""


@functools.cache
def calls_of(path: Path) -> tuple[tuple[str, int], ...]:
    """All calls of a file: (dotted name, line)."""
    return tuple(calls(tree_of(path)))


def calls(tree: ast.AST) -> Iterator[tuple[str, int]]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            yield dotted(node.func), node.lineno


@functools.cache
def kernels(path: Path) -> list[ast.FunctionDef]:
    """Functions under @kernel (or any form of numba's decorators)."""
    marks = {"kernel", "inner", "apart", "numba.njit", "njit", "numba.jit", "jit"}
    return [node for node in ast.walk(tree_of(path)) if isinstance(node, ast.FunctionDef) and any(
        dotted(d.func if isinstance(d, ast.Call) else d) in marks for d in node.decorator_list)]


def kernel_faults(function: ast.FunctionDef) -> list[str]:
    """The parts of a function that a flight kernel must not have: it raises, may not end, or allocates."""
    faults = []
    forbidden = (ast.Raise, ast.Try, ast.While, ast.ListComp, ast.DictComp, ast.SetComp, ast.GeneratorExp, ast.Lambda,
                 ast.With, ast.Assert, ast.Yield, ast.YieldFrom, ast.List, ast.Dict, ast.Set, ast.Global, ast.JoinedStr)
    for node in ast.walk(function):
        if isinstance(node, forbidden):
            faults.append(f"{type(node).__name__} in line {node.lineno}")
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
            faults.append(f"@ in line {node.lineno}")
        elif isinstance(node, ast.For) and not (isinstance(node.iter, ast.Call) and dotted(node.iter.func) == "range"):
            faults.append(f"for over no range in line {node.lineno}")
        elif isinstance(node, ast.FunctionDef) and node is not function:
            faults.append(f"function inside a function in line {node.lineno}")
        elif isinstance(node, ast.Call):
            name = dotted(node.func)
            method = node.func.attr if isinstance(node.func, ast.Attribute) else ""
            if method in ALLOCATORS or name in BUILT_IN or ".linalg" in name:
                faults.append(f"{name or method}() in line {node.lineno}")
    return faults


# ---- the core


def test_core_imports_numpy_numba_the_standard_library_and_itself():
    allowed = {"numpy", "numba", "launchid_core"} | STANDARD
    nowhere(place(path, line, module) for path in CORE for module, _, line in imports(path)
            if top(module) not in allowed or (top(module) in NOT_ON_BOARD
            and (name_of(path) not in NOT_FLOWN or top(module) == "time")))


ROOMS = ("algebra", "gate", "regression", "filter", "watch", "order")  # each imports those before it only
BELOW = {"kernels", "status", "model"}  # files of the root that rooms import
PUBLIC_NUMBA = {"numba", "numba.core.event"}  # the second is numba's documented way to be told of a compilation


def test_rooms_of_the_core_import_those_before_them_only():
    def fault(path: Path, module: str) -> bool:
        parts, own = module.split("."), path.relative_to(ROOT).parts
        if parts[0] != "launchid_core" or len(own) < 3 or len(parts) < 2:
            return False
        if parts[1] in ROOMS:
            return ROOMS.index(parts[1]) > ROOMS.index(own[1])
        return parts[1] not in BELOW and own[1] != "order"

    packages = {"launchid_core", *(f"launchid_core.{room}" for room in ROOMS)}
    named = ((path, line, f"{module}.{name}" if module in packages else module)
             for path in CORE for module, names, line in imports(path) for name in names or ("",))
    nowhere(place(path, line, module) for path, line, module in named if fault(path, module))


def test_core_takes_public_names_of_numba_only():
    nowhere(place(path, line, module, *names) for path in CORE for module, names, line in imports(path)
            if top(module) == "numba" and not ({module, f"{module}.{names[0]}" if names else module} & PUBLIC_NUMBA))


def test_core_kernels_neither_raise_nor_allocate_nor_loop_without_bound():
    nowhere(f"{name_of(path)}: {function.name}: {fault}" for path in CORE for function in kernels(path)
            for fault in kernel_faults(function))


@pytest.mark.parametrize("body", [
    "raise ValueError", "try:\n  x = 1\n finally:\n  x = 2", "while x:\n  x -= 1", "y = [i for i in x]",
    "y = {i: 1 for i in x}", "y = np.zeros(3)", "y = np.empty(3)", "y = np.ones(3)", "y = np.array(x)",
    "y = np.dot(x, x)", "y = np.linalg.inv(x)", "y = x @ x", "y = x.copy()", "y = []",
    "for i in x:\n  pass", "y = lambda: 1"])
def test_the_walk_sees_every_fault_in_a_kernel(body):
    tree = ast.parse(f"@kernel\ndef f(x):\n {body}\n")
    assert kernel_faults(tree.body[0])


def needs_scipy(function: ast.FunctionDef) -> list[str]:
    """The calls that numba compiles only where scipy is installed: products of matrices, and all of np.linalg."""
    at = "{} in line {}".format
    return [at("@", node.lineno) for node in ast.walk(function)
            if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult)] + [
        at(name, line) for name, line in calls(function)
        if ".linalg" in name or name.endswith((".dot", ".vdot", ".matmul"))]


def test_no_kernel_needs_scipy():
    nowhere(f"{name_of(path)}: {function.name}: {fault}" for path in CORE + SIM + GROUND for function in kernels(path)
            for fault in needs_scipy(function))


@pytest.mark.parametrize("body", ["y = x @ x", "y = np.dot(x, x)", "y = x.dot(x)", "y = np.linalg.inv(x)"])
def test_the_walk_sees_what_needs_scipy(body):
    assert needs_scipy(ast.parse(f"@kernel\ndef f(x):\n {body}\n").body[0])


def test_core_calls_no_kernel_of_its_own_in_a_circle():
    """No recursion: the call graph of the kernels has an order."""
    names = {function.name for path in CORE for function in kernels(path)}
    graph = {function.name: {name for name, _ in calls(function)} & names
             for path in CORE for function in kernels(path)}
    while graph:
        leaves = {name for name, callees in graph.items() if not callees & set(graph)}
        assert leaves, f"a circle among {sorted(graph)}"
        graph = {name: callees for name, callees in graph.items() if name not in leaves}


def test_public_names_exist():
    for name in launchid_core.__all__:
        assert getattr(launchid_core, name) is not None


# ---- the simulator and the ground tool


@pytest.mark.parametrize("files", [SIM, GROUND], ids=["sim", "launchid"])
def test_only_public_names_are_taken_from_the_core(files):
    """The only form is `from launchid_core import ...`, of what `__all__` lists."""
    public = set(launchid_core.__all__)
    nowhere(place(path, line, module, *names) for path in files for module, names, line in imports(path)
            if top(module) == "launchid_core" and module != "launchid_core.version"
            and (module != "launchid_core" or not names or not set(names) <= public))


@pytest.mark.parametrize(("files", "house"), [(SIM, {"sim"}), (GROUND, {"sim", "launchid"})], ids=["sim", "launchid"])
def test_imports_go_one_way_and_extras_are_known(files, house):
    """launchid_core <- sim <- launchid: nothing imports what stands above it; kernels have the core's decorators, which
    keep them in the private folder and the order of their sums, and so no file above the core needs numba."""
    allowed = {"numpy", "launchid_core"} | house | STANDARD | EXTRAS
    nowhere(place(path, line, module) for path in files for module, _, line in imports(path)
            if top(module) not in allowed)


# ---- both


def room_of(module: str) -> str:
    """The package's part that a module is in: `launchid.log` of `launchid.log.check`."""
    return ".".join(module.split(".")[:2])


def imports_when_run(tree: ast.AST) -> Iterator[ast.Import | ast.ImportFrom]:
    """Imports at any depth, but for those under `if TYPE_CHECKING`."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield node
        elif not (isinstance(node, ast.If) and dotted(node.test) == "TYPE_CHECKING"):
            yield from imports_when_run(node)


def import_graph() -> dict[str, set[str]]:
    """Module -> modules of the house that it imports, also those that it imports late."""
    files = {".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
             for path in CORE + SIM + GROUND}
    graph: dict[str, set[str]] = {}
    for module, path in files.items():
        package, found = path.relative_to(ROOT).with_suffix("").parts[:-1], set()
        for node in imports_when_run(tree_of(path)):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
                continue
            base = [*package[:len(package) - node.level + 1]] if node.level else []
            source = ".".join([*base, *([node.module] if node.module else [])])
            found |= {full if (full := f"{source}.{alias.name}") in files else source for alias in node.names}
        graph[module] = found & files.keys() - {module}
    return graph


def circles(graph: dict[str, set[str]]) -> list[str]:
    """What is left when all that imports nothing left, and all that nothing left imports, is taken away."""
    left = {name: set(to) for name, to in graph.items()}
    while True:
        imported = set().union(*left.values()) if left else set()
        out = {name for name, to in left.items() if not to & left.keys() or name not in imported}
        if not out:
            return [f"{name} -> {', '.join(sorted(to & left.keys()))}" for name, to in sorted(left.items())]
        left = {name: to - out for name, to in left.items() if name not in out}


def test_no_imports_go_in_a_circle_within_or_between_packages():
    modules = import_graph()
    rooms: dict[str, set[str]] = {}
    packages = {"launchid_core", "sim", "launchid"}   # whose __init__ offers what their rooms have
    for module, to in modules.items():
        rooms.setdefault(room_of(module), set()).update(room_of(other) for other in to)
    graph = {room: to - {room} - packages for room, to in rooms.items() if room not in packages}
    nowhere([*circles(modules), *circles(graph)])


def test_the_walk_sees_a_circle():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == ["a -> b", "b -> c", "c -> a"]
    assert circles({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == []


def test_nothing_prints_but_the_terminal():
    nowhere(place(path, line, name) for path in CORE + SIM + GROUND if name_of(path) != "launchid/cli/terminal.py"
            for name, line in calls_of(path)
            if name in {"print", "input"} or name.endswith(("stdout.write", "stderr.write")))


def test_no_code_is_made_from_data():
    modules = {"pickle", "cPickle", "dill", "marshal", "shelve", "importlib", "yaml"}
    functions = {"exec", "eval", "__import__", "system", "popen"}
    nowhere(place(path, line, module) for path in CORE + SIM + GROUND for module, _, line in imports(path)
            if top(module) in modules)
    nowhere(place(path, line, name) for path in CORE + SIM + GROUND for name, line in calls_of(path)
            if name.split(".")[-1] in functions or name == "compile")
