"""Compiled kernels on disk: outside the packages, kept at once, nobody else's, anew when a source changes.

On a package of four modules: two entries of `a` call a kernel of `b`, which takes a constant of `c`; nobody needs `d`.

Each run is a process of its own, which imports numba: a second and a half, so most of the cases are in the campaign.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numba
import pytest

ROOT = Path(__file__).resolve().parents[2]
CAMPAIGN = pytest.mark.campaign
POSIX = pytest.mark.skipif(os.name != "posix", reason="POSIX owners, modes and limits")
SOURCES = {"__init__": "", "c": "FACTOR = 3.0\n", "d": "OTHER = 1\n", "a": """
from launchid_core import compiled
from .b import deep

@compiled()
def outer(x):
    return deep(x) + 1.0

@compiled()
def other(x):
    return deep(x) - 1.0
""", "b": """
from launchid_core import compiled
from .c import FACTOR

@compiled(no_cpython_wrapper=True)
def deep(x):
    return x * FACTOR
"""}
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
print(a.outer(2.0), a.other(2.0), len(made))
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
COLD, WARM = (7.0, 5.0, 3), (7.0, 5.0, 0)  # what the entries return, how many kernels were compiled


class Toy:
    """The package, and processes that run it."""

    def __init__(self, root: Path) -> None:
        self.root, self.cache = root, root / "cache"
        (root / "sim").mkdir()
        for name, text in SOURCES.items():
            self.write(name, text)

    def write(self, name: str, text: str) -> None:
        path = self.root / "sim" / f"{name}.py"
        path.write_text(text)
        os.utime(path, (time.time() - 100,) * 2)  # edited a while ago, and always then

    def start(self, *words: str, code: str = RUN, **variables: str) -> subprocess.Popen:
        environment = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "LAUNCHID_CACHE")}
        environment |= {"PYTHONPATH": f"{self.root}{os.pathsep}{ROOT}", "PYTHONDONTWRITEBYTECODE": "1",
                        "LAUNCHID_CACHE": str(self.cache), **variables}
        program = self.root / "program.py"
        program.write_text(code)
        return subprocess.Popen([sys.executable, program, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                text=True, cwd=self.root, env=environment)

    def run(self, code: str = RUN, **variables: str) -> tuple[float, float, int]:
        """The values that the entries return, and how many kernels were compiled."""
        return self.result(self.start(code=code, **variables))

    def result(self, process: subprocess.Popen) -> tuple[float, float, int]:
        out, err = process.communicate()
        assert (process.returncode, err) == (0, "")
        one, two, made = out.split()
        return float(one), float(two), int(made)

    def kept(self, under: str = "cache", suffix: str = "nbc") -> list[Path]:
        return sorted((self.root / under).rglob(f"*.{suffix}"))

    def folder(self) -> Path:
        """The folder of the first module's kernels."""
        folder, = (self.cache / "kernels").glob("sim.a-*")
        return folder


@pytest.fixture
def toy(tmp_path: Path) -> Toy:
    if numba.config.DISABLE_JIT:
        pytest.skip("nothing is compiled")
    return Toy(tmp_path)


def test_a_kernel_is_compiled_once_and_kept_outside_the_packages(toy):
    assert toy.run() == COLD
    assert toy.run() == WARM
    assert len(toy.kept()) == len(toy.kept(suffix="nbi")) == 3
    assert toy.kept("sim") == toy.kept("sim", "nbi") == []


# ---- an edit compiles anew what may depend on it, and nothing else


def test_an_edit_compiles_anew_what_imports_the_file_whatever_its_time_and_size(toy):
    assert toy.run() == COLD
    for edited, old, new, result in (("a", "+ 1", "+ 2", (8.0, 5.0, 2)), ("c", "3.0", "4.0", (9.0, 7.0, 3)),
                                     ("d", "1", "2", WARM)):
        toy.write(edited, SOURCES[edited].replace(old, new))
        assert toy.run() == result, edited
        toy.write(edited, SOURCES[edited])
    assert toy.run() == WARM, "what was kept of the first is still good"


@CAMPAIGN
@pytest.mark.parametrize("variables", [{"NUMBA_BOUNDSCHECK": "1"}, {"NUMBA_OPT": "1"}])
def test_numba_s_settings_are_told_apart(toy, variables):
    assert toy.run() == toy.run(**variables) == COLD
    assert toy.run(**variables) == WARM


@CAMPAIGN
def test_a_folder_that_nobody_used_for_long_is_deleted(toy):
    (toy.cache / "kernels").mkdir(parents=True, mode=0o700)
    old, new = (toy.cache / "kernels" / name for name in ("sim.a-1", "sim.a-2"))
    for path, days in ((old, 31), (new, 29)):
        path.mkdir()
        os.utime(path, (time.time() - days * 86400,) * 2)
    assert toy.run() == COLD
    assert not old.exists() and new.exists()


# ---- where


@CAMPAIGN
def test_numba_s_own_variable_is_honoured(toy):
    mine = toy.root / "mine"
    assert toy.run(LAUNCHID_CACHE="", NUMBA_CACHE_DIR=str(mine)) == COLD
    assert toy.run(LAUNCHID_CACHE="", NUMBA_CACHE_DIR=str(mine)) == WARM
    assert len(toy.kept("mine")) == 3 and toy.kept() == []


@pytest.mark.parametrize("chosen", [False, pytest.param(True, marks=CAMPAIGN)])
def test_a_host_s_own_kernels_stay_where_numba_puts_them(toy, chosen):
    mine = toy.root / ("mine" if chosen else "__pycache__")
    variables = {"NUMBA_CACHE_DIR": str(mine)} if chosen else {}
    assert toy.run(HOST, **variables) == (7.0, 5.0, 4)
    assert len(toy.kept(mine.name)) == 1 and len(toy.kept()) == 3
    assert [path.name for path in toy.kept() if "mine" in path.name] == []


@pytest.mark.parametrize("where", [
    "a file", pytest.param("below a file", marks=CAMPAIGN), pytest.param("no home", marks=CAMPAIGN)])
def test_an_unwritable_cache_is_no_error(toy, where):
    (toy.root / "file").write_text("")
    place = {"a file": "file", "below a file": "file/below", "no home": ""}[where]
    variables = {"LAUNCHID_CACHE": str(toy.root / place) if place else ""}
    if where == "no home":
        variables |= {"HOME": str(toy.root / "file" / "home"), "XDG_CACHE_HOME": ""}
    assert toy.run(**variables) == COLD


@POSIX
@CAMPAIGN
@pytest.mark.parametrize("disk", ["ro", "size=64k"])
def test_a_read_only_cache_or_a_full_disk_is_no_error(toy, disk):
    toy.cache.mkdir()
    mounted = os.geteuid() == 0  # whom no mode stops
    if mounted and subprocess.run(["mount", "-t", "tmpfs", "-o", disk, "none", toy.cache], check=False).returncode:
        pytest.skip("root may not mount here")
    if not mounted and disk != "ro":
        pytest.skip("only root mounts a small disk")
    toy.cache.chmod(0o500) if not mounted else None
    try:
        assert toy.run() == COLD
    finally:
        subprocess.run(["umount", toy.cache], check=True) if mounted else toy.cache.chmod(0o700)


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


@POSIX
@pytest.mark.parametrize(("unsafe", "compiled"), [
    (widen, 2), pytest.param(widen_above, 3, marks=CAMPAIGN), pytest.param(give_away, 2, marks=CAMPAIGN),
    pytest.param(lead_elsewhere, 2, marks=CAMPAIGN)])
def test_a_folder_that_others_may_write_to_is_neither_read_nor_written(toy, unsafe, compiled):
    assert toy.run() == COLD
    unsafe(toy, toy.folder())
    before = {path: path.read_bytes() for path in toy.root.rglob("*.nb?")}
    assert toy.run() == (7.0, 5.0, compiled)
    assert {path: path.read_bytes() for path in toy.root.rglob("*.nb?")} == before != {}


# ---- nothing that was compiled is lost, and what is damaged is compiled anew


DAMAGES = {   # suffix of the files -> what becomes of their bytes; None: they are lost
    "lost": ("nbc", lambda data: None), "cut short": ("nbi", lambda data: data[:100]),
    "empty": ("nbi", lambda data: b""),
    "something else": ("nbc", lambda data: bytes(range(256)) * (len(data) // 256 + 1))}


@pytest.mark.parametrize("name", [
    "cut short", *(pytest.param(name, marks=CAMPAIGN) for name in DAMAGES if name != "cut short")])
def test_a_damaged_file_is_compiled_anew(toy, name):
    assert toy.run() == COLD
    suffix, damage = DAMAGES[name]
    for path in toy.kept(suffix=suffix):
        data = damage(path.read_bytes())
        path.unlink() if data is None else path.write_bytes(data)
    assert toy.run() == COLD
    assert toy.run() == WARM


@CAMPAIGN
def test_processes_that_need_the_same_kernel_at_once_do_each_other_no_harm(toy):
    at = str(time.time() + 2.0)
    results = [toy.result(process) for process in [toy.start(at) for _ in range(3)]]
    assert [answers for *answers, _ in results] == [[7.0, 5.0]] * 3
    assert toy.run() == WARM


@CAMPAIGN
def test_of_a_killed_process_all_is_kept_but_the_kernel_in_work(toy):
    """And a process that starts meanwhile deletes nothing of it."""
    many = 20
    toy.write("b", SOURCES["b"] + "".join(f"""
@compiled()
def number_{k}(x):
    return deep(x) + {k}.0
""" for k in range(many)))
    code = RUN + f"""
from sim import b
print([getattr(b, f"number_{{k}}")(2.0) for k in range({many})] == [6.0 + k for k in range({many})], len(made))
"""
    process = toy.start(code=code)
    while len(toy.kept()) < 5:
        time.sleep(0.01)
    meanwhile = toy.start()
    while len(toy.kept()) < 7:
        time.sleep(0.01)
    process.kill()
    assert toy.result(meanwhile)[:2] == (7.0, 5.0)
    process.communicate()
    assert process.returncode == -signal.SIGKILL
    kept = {path.name for path in toy.kept()}
    assert 5 <= len(kept) < 3 + many
    out, err = toy.start(code=code).communicate()
    assert (out.splitlines()[1].split(), err) == (["True", str(3 + many - len(kept))], "")
    assert kept < {path.name for path in toy.kept()}
