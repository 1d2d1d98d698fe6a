"""Compiled kernels on disk: outside the packages, anew when a source changes, nobody else's, never damaged.

On a package of three modules: `a` has an entry with a constant of `b`, and another; nothing of `a` comes from `c`.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numba
import pytest
from forked import Forked

from launchid_core import cache

ROOT = Path(__file__).resolve().parents[2]
A = """
from launchid_core import compiled
from .b import FACTOR

kernel, inner = compiled(), compiled(kept=False)

@inner
def deep(x):
    return x * FACTOR

@kernel
def outer(x):
    return deep(x) + 1.0

@kernel
def other(x):
    return deep(x) - 1.0
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
print(a.outer(2.0), a.other(2.0), len(made) - made.count("deep"))
"""
HOST = """
import numba
before = numba.config.CACHE_DIR
from sim import a
@numba.njit(cache=True)
def mine(x):
    return x + 3.0
print(a.outer(2.0), a.other(2.0), int(mine(1.0)) if numba.config.CACHE_DIR == before else "moved")
"""
COLD, WARM = (7.0, 5.0, 2), (7.0, 5.0, 0)  # what the entries return, how many of them were compiled


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
        os.utime(path, (time.time() - 100,) * 2)  # edited a while ago, and always then

    def start(self, *words: str, code: str = RUN, **variables: str) -> subprocess.Popen | Forked:
        environment = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "LAUNCHID_CACHE")}
        environment |= {"PYTHONPATH": f"{self.root}{os.pathsep}{ROOT}", "PYTHONDONTWRITEBYTECODE": "1",
                        "LAUNCHID_CACHE": str(self.cache), **variables}
        if code is RUN and not {name for name in variables if name.startswith("NUMBA")}:
            return Forked(code, words, self.root, environment)
        program = self.root / "program.py"
        program.write_text(code)
        return subprocess.Popen([sys.executable, program, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                text=True, cwd=self.root, env=environment)

    def run(self, code: str = RUN, **variables: str) -> tuple[float, float, int]:
        """The values that the entries return, and how many of them were compiled."""
        return self.result(self.start(code=code, **variables))

    def result(self, process: subprocess.Popen | Forked) -> tuple[float, float, int]:
        out, err = process.communicate()
        assert (process.returncode, err) == (0, "")
        one, two, made = out.split()
        return float(one), float(two), int(made)

    def kept(self, under: str = "cache", suffix: str = "nbc") -> list[Path]:
        return sorted((self.root / under).rglob(f"*.{suffix}"))

    def folder(self) -> Path:
        """The one folder of the package's kernels."""
        folder, = (self.cache / "kernels").glob("sim-*")
        return folder


@pytest.fixture
def toy(tmp_path: Path) -> Toy:
    if numba.config.DISABLE_JIT:
        pytest.skip("nothing is compiled")
    return Toy(tmp_path)


def test_a_kernel_is_compiled_once_and_kept_outside_the_packages(toy):
    assert toy.run() == COLD
    assert toy.run() == WARM
    assert len(toy.kept()) == len(toy.kept(suffix="nbi")) == 2  # of what others call there is none
    assert toy.kept("sim") == toy.kept("sim", "nbi") == []


@pytest.mark.parametrize("edited", [("b", "FACTOR = 4.0\n", (9.0, 7.0)), ("c", "OTHER = 2\n", (7.0, 5.0))])
def test_an_edit_in_any_file_compiles_anew_whatever_its_time_and_size(toy, edited):
    name, text, answers = edited
    old = (toy.root / "sim" / f"{name}.py").read_text()
    assert toy.run() == COLD and len(text) == len(old)
    toy.write(name, text)
    assert toy.run() == (*answers, 2)
    toy.write(name, old)
    assert toy.run() == WARM, "what was kept of the first is still good"


def test_the_digest_is_of_every_source_of_the_core_too(tmp_path, monkeypatch):
    """A byte more in any one of them is another digest."""
    for path in ROOT.glob("launchid_core/*.py"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    monkeypatch.setattr(sys.modules["launchid_core"], "__file__", str(tmp_path / "__init__.py"))
    before = cache.digest_of("sim"), cache.digest_of("launchid_core")
    for path in sorted(tmp_path.glob("*.py")):
        whole = path.read_bytes()
        path.write_bytes(whole + b"\n")
        assert cache.digest_of("sim") != before[0] and cache.digest_of("launchid_core") != before[1], path.name
        path.write_bytes(whole)
    assert (cache.digest_of("sim"), cache.digest_of("launchid_core")) == before


def test_few_folders_of_a_package_are_kept(toy):
    others = [toy.cache / "kernels" / f"sim-{k:020}" for k in range(cache.OLD + 3)]
    another = toy.cache / "kernels" / "simulator-longer"
    for age, path in enumerate([*others, another]):
        path.mkdir(parents=True)
        os.utime(path, (time.time() - 1000 - age,) * 2)
    assert toy.run() == COLD
    assert [path.exists() for path in others] == [True] * (cache.OLD - 1) + [False] * 4
    assert another.exists()


def test_numba_s_own_variable_is_honoured(toy):
    mine = toy.root / "mine"
    assert toy.run(LAUNCHID_CACHE="", NUMBA_CACHE_DIR=str(mine)) == COLD
    assert toy.run(LAUNCHID_CACHE="", NUMBA_CACHE_DIR=str(mine)) == WARM
    assert len(toy.kept("mine")) == 2 and toy.kept() == []


@pytest.mark.parametrize("chosen", [False, True])
def test_a_host_s_own_kernels_stay_where_numba_puts_them(toy, chosen):
    mine = toy.root / ("mine" if chosen else "__pycache__")
    variables = {"NUMBA_CACHE_DIR": str(mine)} if chosen else {}
    assert toy.run(HOST, **variables) == (7.0, 5.0, 4)
    assert len(toy.kept(mine.name)) == 1 and len(toy.kept()) == 2
    assert [path.name for path in toy.kept() if "mine" in path.name] == []


def test_numba_s_settings_are_told_apart(toy):
    toy.run()
    assert toy.run(NUMBA_BOUNDSCHECK="1") == COLD


@pytest.mark.parametrize("where", ["a file", "below a file", "no home"])
def test_an_unwritable_cache_is_no_error(toy, where):
    (toy.root / "file").write_text("")
    place = {"a file": "file", "below a file": "file/below", "no home": ""}[where]
    variables = {"LAUNCHID_CACHE": str(toy.root / place) if place else ""}
    if where == "no home":
        variables |= {"HOME": str(toy.root / "file" / "home"), "XDG_CACHE_HOME": ""}
    for _ in range(2):
        assert toy.run(**variables) == COLD


# ---- what is not this user's own is not loaded: it would run


def widen(toy: Toy, folder: Path) -> None:
    folder.chmod(0o777)


def widen_above(toy: Toy, folder: Path) -> None:
    folder.parent.chmod(0o770)


def give_away(toy: Toy, folder: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("only root gives a folder away")
    os.chown(folder, 12345, -1)


def lead_elsewhere(toy: Toy, folder: Path) -> None:
    folder.rename(toy.root / "elsewhere")
    folder.symlink_to(toy.root / "elsewhere")


@pytest.mark.skipif(os.name != "posix", reason="POSIX owners and modes")
@pytest.mark.parametrize("unsafe", [widen, widen_above, give_away, lead_elsewhere])
def test_a_folder_that_others_may_write_to_is_neither_read_nor_written(toy, unsafe):
    assert toy.run() == COLD and toy.run() == WARM
    unsafe(toy, toy.folder())
    before = {path: path.read_bytes() for path in toy.root.rglob("*.nb?")}
    assert toy.run() == toy.run() == COLD
    assert {path: path.read_bytes() for path in toy.root.rglob("*.nb?")} == before != {}


@pytest.mark.skipif(os.name != "posix", reason="POSIX owners and modes")
def test_a_file_that_others_may_write_to_is_not_loaded(toy):
    toy.run()
    for path in toy.kept() + toy.kept(suffix="nbi"):
        if ".outer-" in path.name:
            path.chmod(0o666)
    assert toy.run() == (7.0, 5.0, 1)
    assert toy.run() == WARM


# ---- what is damaged is compiled anew


def cut_short(paths: list[Path]) -> None:
    for path in paths:
        path.write_bytes(path.read_bytes()[:100])


def empty(paths: list[Path]) -> None:
    for path in paths:
        path.write_bytes(b"")


def fill(paths: list[Path]) -> None:
    for path in paths:
        path.write_bytes(bytes(range(256)) * (path.stat().st_size // 256 + 1))


def exchange(paths: list[Path]) -> None:
    one, two = paths
    first, second = one.read_bytes(), two.read_bytes()
    one.write_bytes(second)
    two.write_bytes(first)


def change_a_byte(paths: list[Path]) -> None:
    for path in paths:
        whole = bytearray(path.read_bytes())
        whole[len(whole) // 2] ^= 1
        path.write_bytes(whole)


def lose(paths: list[Path]) -> None:
    for path in paths:
        path.unlink()


def lose_sums(paths: list[Path]) -> None:
    lose([path.with_name(path.name + cache.SUM) for path in paths])


@pytest.mark.parametrize("suffix", ["nbc", "nbi"])
@pytest.mark.parametrize("damage", [cut_short, empty, fill, exchange, change_a_byte, lose, lose_sums])
def test_a_damaged_file_is_compiled_anew(toy, damage, suffix):
    assert toy.run() == COLD
    damage(toy.kept(suffix=suffix))
    assert toy.run() == COLD
    assert toy.run() == WARM


def test_processes_that_need_the_same_kernel_at_once_do_each_other_no_harm(toy):
    at = str(time.time() + 2.0)
    results = [toy.result(process) for process in [toy.start(at) for _ in range(3)]]
    assert [answers for *answers, _ in results] == [[7.0, 5.0]] * 3
    toy.run()  # a digest may be of what the other wrote
    assert toy.run() == WARM


def test_a_process_killed_while_it_compiles_blocks_nobody(toy):
    ended = []
    for pause in (0.02, 0.05, 0.1, 0.2, 0.3, 0.5):
        process = toy.start()
        time.sleep(pause)
        process.kill()
        process.communicate()
        ended.append(process.returncode)
    assert -signal.SIGKILL in ended
    assert toy.run()[:2] == (7.0, 5.0)
    assert toy.run() == WARM
