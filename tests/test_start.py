"""What starting costs: help, wrong words and missing files import no numba; the core little beside it."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import launchid_core
from sim.__main__ import Announcement

ROOT = Path(__file__).resolve().parents[1]
IMPORT_LIMIT = 0.15  # s of the processor, of the core above numba


def python(*words: object, **variables: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, *map(str, words)], cwd=ROOT, capture_output=True, text=True, timeout=300,
                          check=False, env={**os.environ, **variables})


@pytest.mark.parametrize(("words", "status"), [
    (["--help"], 0), (["--version"], 0), (["identify", "--help"], 0), ([], 2), (["fly"], 2),
    (["identify", "x.csv", "--solver", "omp"], 2), (["identify", "none.csv"], 3),
    (["simulate", "none.toml", "--out", "x.csv"], 3), (["diagnose", "none.csv", "constant"], 3),
    (["uncertainty", "none.csv", "constant"], 3), (["fit-lft", "none.csv", "vega_like", "--out", "x.toml"], 3),
    (["plan", "none.toml", "--accuracy", "0.1", "--window", "1", "--out", "x.toml"], 3),
    (["export-c", "none.toml", "--out", "x"], 3)], ids=lambda x: " ".join(x) if isinstance(x, list) else "")
def test_what_needs_no_kernel_imports_no_numba(words, status):
    done = python("-X", "importtime", "-m", "sim", *words)
    assert done.returncode == status
    loaded = set(re.findall(r"\| +([\w.]+)$", done.stderr, re.MULTILINE))
    assert "launchid_core" in loaded
    assert not {name for name in loaded if name.split(".")[0] in {"numba", "llvmlite", "matplotlib"}}


def test_the_version_has_one_source():
    assert re.fullmatch(r"\d+\.\d+\.\d+.*", launchid_core.__version__)
    assert python("-m", "sim", "--version").stdout == f"launchid {launchid_core.__version__}\n"
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert "version" not in project["project"]
    assert project["tool"]["setuptools"]["dynamic"]["version"] == {"attr": "launchid_core.__version__"}


def test_the_core_costs_little_beside_numba():
    script = ("import time, numba; began = time.process_time(); from launchid_core import Estimator; "
              "print(time.process_time() - began)")
    assert min(float(python("-c", script, PYTHONDONTWRITEBYTECODE="").stdout) for _ in range(5)) < IMPORT_LIMIT


def test_every_public_name_is_found_and_no_other():
    for name in launchid_core.__all__:
        assert getattr(launchid_core, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'wings'"):
        _ = launchid_core.wings


KERNELS = """
from launchid_core import compiled

@compiled()
def first(x):
    return x + 1.0

@compiled()
def second(x):
    return x + 2.0
"""
RUN = """
from launchid_core import compile_listeners
from sim.__main__ import Announcement
compile_listeners += [Announcement()] * {said}
import toy
print(toy.first(1.0) + toy.second(1.0))
"""


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT", "0") != "0", reason="nothing is compiled")
def test_the_command_says_once_that_it_compiles_and_the_core_nothing(tmp_path):
    (tmp_path / "toy.py").write_text(KERNELS)
    variables = {"LAUNCHID_CACHE": str(tmp_path / "cache"), "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    cold, warm = (python("-c", RUN.format(said=1), **variables) for _ in range(2))
    silent = python("-c", RUN.format(said=0), **{**variables, "LAUNCHID_CACHE": str(tmp_path / "another")})
    assert cold.stdout == warm.stdout == silent.stdout == "5.0\n"
    assert cold.stderr.startswith("launchid: compiling") and len(cold.stderr.splitlines()) == 1
    assert warm.stderr == silent.stderr == ""


def test_forked_workers_say_it_once_together(capsys):
    announce = Announcement()
    if not hasattr(os, "fork"):
        pytest.skip("no fork here")
    child = os.fork()
    if child == 0:
        announce.said[0] = 1
        os._exit(0)
    os.waitpid(child, 0)
    announce("sim.flight", "advance")
    assert capsys.readouterr().err == ""
