"""Compiled kernels on disk: outside the packages, anew when any source that counts changes, once for all processes.

On a package of three modules: `a` has a kernel with a constant of `b`; nothing of `a` comes from `c`.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numba
import numpy as np
import pytest
from compiled import compiled
from forked import Forked

import sim.vehicle.step
from launchid_core import kernel_cache, kernels, parts

ROOT = Path(__file__).resolve().parents[1]
A = """
from launchid_core import compiled
from .b import (
    FACTOR,
)

kernel, part = compiled(), compiled(part=True)

@part
def deep(x):
    return x * FACTOR

@part
def inner(x):
    return deep(x)

@kernel
def outer(x):
    return inner(x) + 1.0
"""
RUN = """
import sys, time
from numba.core import event
made = []
class Count(event.Listener):
    def on_start(self, e): made.append(e.data["dispatcher"].py_func.__name__)
    def on_end(self, e): pass
event.register("numba:compile", Count())
from sim import a
if len(sys.argv) > 1:
    while time.time() < float(sys.argv[1]): pass
print(a.outer(2.0), len(made) - made.count("deep"))
"""


class Toy:
    """The package, and processes that run it."""

    def __init__(self, root: Path) -> None:
        self.root, self.cache = root, root / "cache"
        (root / "sim").mkdir()
        for name, text in (("__init__", ""), ("a", A), ("b", "FACTOR = 3.0\n"), ("c", "OTHER = 1\n")):
            self.write(name, text)

    def write(self, name: str, text: str) -> None:
        path = self.root / "sim" / f"{name}.py"
        path.write_text(text)
        os.utime(path, (time.time() - 100, time.time() - 100 - len(text)))  # edited a while ago

    def start(self, *words: str, **variables: str) -> subprocess.Popen | Forked:
        environment = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "LAUNCHID_CACHE")}
        environment |= {"PYTHONPATH": f"{self.root}{os.pathsep}{ROOT}", "PYTHONDONTWRITEBYTECODE": "1",
                        "LAUNCHID_CACHE": str(self.cache), **variables}
        if not {name for name in variables if name.startswith("NUMBA")}:
            return Forked(RUN, words, self.root, environment)
        return subprocess.Popen([sys.executable, "-c", RUN, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                text=True, cwd=self.root, env=environment)

    def run(self, **variables: str) -> tuple[float, int]:
        """(what the kernel returns, how many kernels were compiled)"""
        return self.result(self.start(**variables))

    def result(self, process: subprocess.Popen | Forked) -> tuple[float, int]:
        out, err = process.communicate()
        assert (process.returncode, err) == (0, "")
        value, made = out.split()
        return float(value), int(made)

    def kept(self, under: str = "cache", suffix: str = "nbc") -> list[Path]:
        return sorted((self.root / under).rglob(f"*.{suffix}"))


@pytest.fixture
def toy(tmp_path: Path) -> Toy:
    if os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
        pytest.skip("nothing is compiled")
    return Toy(tmp_path)


def test_a_kernel_is_compiled_once_and_kept_outside_the_packages(toy):
    assert toy.run() == (7.0, 2)
    assert toy.run() == (7.0, 0)
    assert len(toy.kept()) == 3
    assert toy.kept("sim") == toy.kept("sim", "nbi") == []


def test_an_edit_in_another_file_is_noticed_and_one_elsewhere_costs_nothing(toy):
    toy.run()
    toy.write("c", "OTHER = 22222\n")
    assert toy.run() == (7.0, 0)
    toy.write("b", "FACTOR = 4.0\n")
    assert toy.run() == (9.0, 2)
    toy.write("b", "FACTOR = 3.0\n")
    assert toy.run() == (7.0, 0), "what was kept of the first is still good"


def test_few_versions_of_a_module_are_kept(toy):
    others = [toy.cache / "kernels" / f"sim.a-{k:020}" for k in range(kernel_cache.KEEP + 3)]
    another = toy.cache / "kernels" / "sim.ab-longer"
    for age, path in enumerate([*others, another]):
        path.mkdir(parents=True)
        os.utime(path, (time.time() - 1000 - age,) * 2)
    assert toy.run() == (7.0, 2)
    assert [path.exists() for path in others] == [True] * (kernel_cache.KEEP - 1) + [False] * 4
    assert another.exists()


def test_numba_s_own_variable_is_honoured(toy):
    mine = toy.root / "mine"
    assert toy.run(LAUNCHID_CACHE="", NUMBA_CACHE_DIR=str(mine)) == (7.0, 2)
    assert toy.run(LAUNCHID_CACHE="", NUMBA_CACHE_DIR=str(mine)) == (7.0, 0)
    assert len(toy.kept("mine")) == 3 and toy.kept() == []


def test_an_entry_is_compiled_anew_from_parts_that_are_kept(toy):
    """Of a part on the disk there is no machine code: what it calls comes with it."""
    assert toy.run() == (7.0, 2)
    for path in toy.kept():
        if ".deep-" in path.name or ".outer-" in path.name:
            path.unlink()
    assert toy.run() == (7.0, 1)


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT", "0") != "0" or not parts.KNOWN, reason="there are no parts")
def test_a_part_has_no_machine_code_and_its_entry_has_all_of_it():
    @kernels.inner
    def part(x):
        return x + 1.0

    @kernels.kernel
    def entry(x):
        return part(x)

    assert entry(2.0) == 3.0
    one, whole = (each.overloads[each.signatures[0]].library for each in (part, entry))
    assert isinstance(one, parts.Part) and one.get_pointer_to_function("part") == 0
    assert not isinstance(whole, parts.Part)


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT", "0") != "0" or not parts.KNOWN, reason="there are no parts")
def test_a_part_is_compiled_once_for_all_its_callers_and_all_integers():
    @kernels.shared
    def power(x, n):
        return x**n

    @kernels.inner
    def square(x):
        return power(x, 2)

    @kernels.once
    def cube(x):
        return power(x, 3)

    @kernels.kernel
    def entry(x):
        return square(x) + cube(x) + power(x, 4)

    assert entry(2.0) == 28.0 and power(2, 4) == 16
    made = next(each for each in parts._standing if each.py_func is power)
    assert len(made.signatures) == 1


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT", "0") != "0" or not parts.KNOWN, reason="there are no parts")
def test_an_index_is_taken_as_it_is_in_kernels_of_the_core_alone():
    """What others compile beside them keeps numba's meaning of a negative one."""
    def last(x, k):
        return x[k]

    whole = np.arange(4.0)
    assert compiled(last)(whole[2:], -1) == 3.0
    last.__module__ = "launchid_core.last"
    assert numba.njit(error_model="numpy", **parts.OF_AN_ENTRY)(last)(whole[2:], -1) == 1.0  # the number before it


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT", "0") != "0" or not parts.KNOWN, reason="there are no parts")
def test_no_address_of_this_process_stays_in_a_part():
    """numba names what is called by its address; before `or` it does so across a branch."""
    @kernels.inner
    def deep(x, sure):
        return x if sure else -x

    @kernels.inner
    def part(x, y):
        return deep(x, x > 0.0 or y > 0.0)

    @kernels.kernel
    def entry(x, y):
        return part(x, y)

    assert entry(-2.0, 0.0) == 2.0 and entry(-2.0, 1.0) == -2.0
    assert not part.overloads[part.signatures[0]].library.has_dynamic_globals


def test_numba_s_settings_are_told_apart(toy):
    toy.run()
    assert toy.run(NUMBA_BOUNDSCHECK="1") == (7.0, 2)


@pytest.mark.parametrize("where", ["a file", "below a file", "no home"])
def test_an_unwritable_cache_is_no_error(toy, where):
    (toy.root / "file").write_text("")
    place = {"a file": "file", "below a file": "file/below", "no home": ""}[where]
    variables = {"LAUNCHID_CACHE": str(toy.root / place) if place else ""}
    if where == "no home":
        variables |= {"HOME": str(toy.root / "file" / "home"), "XDG_CACHE_HOME": ""}
    for _ in range(2):
        assert toy.run(**variables) == (7.0, 2)


def test_a_torn_file_is_compiled_anew(toy):
    toy.run()
    for path in toy.kept():
        path.write_bytes(path.read_bytes()[:100])
    assert toy.run() == (7.0, 2)
    assert toy.run() == (7.0, 0)
    for path in toy.kept(suffix="nbi"):
        path.write_bytes(b"")
    assert toy.run() == (7.0, 2)


def test_processes_that_need_the_same_kernel_at_once_compile_it_once(toy):
    at = str(time.time() + 2.0)
    results = [toy.result(process) for process in [toy.start(at) for _ in range(3)]]
    assert [value for value, _ in results] == [7.0] * 3
    assert sum(made for _, made in results) == 2


def test_a_process_killed_while_it_compiles_blocks_nobody(toy):
    ended = []
    for pause in (0.02, 0.05, 0.1, 0.2, 0.3, 0.5):
        process = toy.start()
        time.sleep(pause)
        process.kill()
        process.communicate()
        ended.append(process.returncode)
    assert -signal.SIGKILL in ended
    assert toy.run()[0] == 7.0


# ---- what counts of these packages


def reach(module: str) -> set[str]:
    known = {module}
    todo = [module]
    while todo:
        new = kernel_cache.needs(todo.pop()) - known
        known |= new
        todo += new
    return known


def test_an_edit_of_what_a_module_does_not_import_does_not_count():
    assert reach("launchid_core.linsolve") == {"launchid_core.linsolve", "launchid_core.kernels",
                                               "launchid_core.kernel_cache", "launchid_core.compiling",
                                               "launchid_core.lanes", "launchid_core.parts", "launchid_core.vectors"}
    assert "launchid_core.linsolve" in reach("launchid_core.sparse")


def test_a_name_of_a_package_leads_to_its_own_module():
    found = reach(sim.vehicle.step.__name__)
    assert {"launchid_core.kernels", "sim.vehicle.kernels", "sim.vehicle.plant"} <= found
    assert not found & {"launchid_core", "launchid_core.estimator", "launchid_core.linsolve"}
