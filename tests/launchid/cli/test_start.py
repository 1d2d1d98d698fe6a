"""The cost of starting: help, wrong words and missing files import no numba; the core little beside it."""

import os
import re
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from launchid.main import main

ROOT = Path(__file__).resolve().parents[3]
MOST_MODULES = 70  # of the core, that an estimator imports


def python(*words: object, **variables: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, *map(str, words)], cwd=ROOT, capture_output=True, text=True, timeout=300,
                          check=False, env={**os.environ, **variables})


@pytest.mark.parametrize(("words", "status"), [
    (["--help"], 0), ([], 2), (["identify", "x.csv", "--solver", "omp"], 2), (["identify", "none.csv"], 3),
    (["simulate", "none.toml", "--out", "x.csv"], 3), (["diagnose", "none.csv", "constant"], 3),
    (["plan", "none.toml", "--accuracy", "0.1", "--window", "1", "--out", "x.toml"], 3)],
    ids=lambda x: " ".join(x) if isinstance(x, list) else "")
def test_what_needs_no_kernel_imports_no_numba(words, status):
    done = python("-X", "importtime", "-m", "sim", *words)
    assert done.returncode == status
    loaded = set(re.findall(r"\| +([\w.]+)$", done.stderr, re.MULTILINE))
    assert "launchid_core" in loaded
    assert not {name for name in loaded if name.split(".")[0] in {"numba", "llvmlite", "matplotlib"}}


# ---- streams that are not there, and interrupts


def closed(*numbers: int, words: str) -> subprocess.CompletedProcess:
    def close() -> None:
        for number in numbers:
            os.close(number)
    return subprocess.run([sys.executable, "-m", "sim", *words.split()], cwd=ROOT, capture_output=True, text=True,
                          timeout=300, check=False, preexec_fn=close)


@pytest.mark.skipif(os.name != "posix", reason="POSIX descriptors")
def test_a_closed_stdout_matters_to_what_writes_there_alone(tmp_path):
    for words in ("effects", "--help"):
        done = closed(1, words=words)
        assert (done.returncode, len(done.stderr.splitlines())) == (3, 1) and "standard output" in done.stderr
    done = closed(1, words=f"effects --json {tmp_path}/effects.json")
    assert done.returncode == 3 and (tmp_path / "effects.json").read_text().startswith("{")
    done = closed(0, 1, words=f"simulate constant --period 0.1 --out {tmp_path}/log.csv")
    assert done.returncode == 0 and (tmp_path / "log.csv").is_file()


def test_a_full_disk_behind_stdout_is_one_line(tmp_path):
    node = tmp_path / "full"
    try:
        os.mknod(node, 0o666 | stat.S_IFCHR, os.makedev(1, 7))
        full = node.open("w")
    except (AttributeError, OSError) as error:
        pytest.skip(f"no private device can be made or opened here ({error})")
    with full:
        for words in (["effects"], ["--help"]):
            done = subprocess.run([sys.executable, "-m", "sim", *words], cwd=ROOT, stdout=full, text=True,
                                  stderr=subprocess.PIPE, timeout=300, check=False)
            assert done.returncode == 3
            assert len(done.stderr.splitlines()) == 1 and "standard output: cannot be written" in done.stderr


STOPPED = """
import os, signal, sys
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "MODULE":
            sys.meta_path.remove(self)
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Finder())
from launchid.__main__ import command
sys.exit(command())
"""


@pytest.mark.skipif(os.name != "posix", reason="POSIX signals")
@pytest.mark.parametrize("module", ["argparse", "launchid.main", "sim.effects"])
def test_an_interrupt_while_modules_are_imported_is_one_line(module):
    done = python("-c", STOPPED.replace("MODULE", module), "effects")
    assert done.returncode == 130
    assert done.stderr == "launchid: interrupted; files already written are whole\n"


@pytest.mark.parametrize("words", ["identify LOG", "uncertainty LOG vega_like"])
def test_without_matplotlib_one_line_says_what_to_install(tmp_path, words):
    """The environment is like one with the wheel alone."""
    log = tmp_path / "log.csv"
    log.write_text("t,theta,beta\n" + "".join(f"{k / 100},{k % 7},{k % 5}\n" for k in range(300)))
    (tmp_path / "without.py").write_text("import sys; sys.modules['matplotlib'] = None\n"
                                         "from launchid.main import main; sys.exit(main(sys.argv[1:]))")
    words = [*words.replace("LOG", str(log)).split(), "--plot", "x.png", "--quiet"]
    done = python(tmp_path / "without.py", *words, PYTHONPATH=str(ROOT))
    assert done.returncode == 2, done.stderr
    assert done.stderr.splitlines()[-1].endswith("pip install 'launchid[plots]'")
    assert len(done.stderr.splitlines()) == 1
    assert not (ROOT / "x.png").exists()


def test_the_core_imports_its_own_modules_alone_beside_numba():
    script = ("import sys, numba; before = set(sys.modules); from launchid_core import Estimator; "
              "print(*sorted(name.split('.')[0] for name in set(sys.modules) - before))")
    found = python("-c", script).stdout.split()
    assert set(found) - set(sys.stdlib_module_names) <= {"launchid_core", "numba", "numpy", "llvmlite"}
    assert found.count("launchid_core") <= MOST_MODULES


@pytest.mark.campaign
def test_export_c_writes_the_same_bytes_without_the_compiler(tmp_path):
    words = ["export-c", "constant", "--window", "1", "--formulation", "integral", "--quiet"]
    done = python("-m", "sim", *words, "--out", tmp_path / "plain", NUMBA_DISABLE_JIT="1")
    assert done.returncode == 0 and len(done.stderr.splitlines()) == 1
    assert main([*words, "--out", str(tmp_path / "compiled")]) == 0
    made = sorted((tmp_path / "plain").iterdir())
    assert len(made) > 10
    for path in made:
        assert path.read_bytes() == (tmp_path / "compiled" / path.name).read_bytes(), path.name
