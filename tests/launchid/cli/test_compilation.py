"""What the command does while it compiles: one line, a count, a second process; and `launchid warm`."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numba
import pytest

from launchid.cli.compilation import HELPER
from sim.errors import INTERRUPTED, INTERRUPTED_STATUS

ROOT = Path(__file__).resolve().parents[3]
COMPILED = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
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
from launchid.cli.compilation import Compilation
from launchid.cli import compilation
compilation.OFTEN = float("inf")  # s
compile_listeners += [Compilation()] * {said}
import toy
print(toy.first(1.0) + toy.second(1.0))
"""


def environment(**variables: object) -> dict[str, str]:
    return {**os.environ, "NUMBA_CACHE_DIR": "", **{name: str(value) for name, value in variables.items()}}


def python(*words: object, **variables: object) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, *map(str, words)], cwd=ROOT, capture_output=True, text=True, timeout=300,
                          check=False, env=environment(**variables))


# ---- what is said


@COMPILED
def test_the_command_says_once_that_it_compiles_and_the_core_nothing(tmp_path):
    (tmp_path / "toy.py").write_text(KERNELS)
    variables = {"LAUNCHID_CACHE": tmp_path / "cache", "PYTHONPATH": f"{tmp_path}{os.pathsep}{ROOT}"}
    cold = python("-c", RUN.format(said=1), **variables)
    silent = python("-c", RUN.format(said=0), **{**variables, "LAUNCHID_CACHE": tmp_path / "another"})
    assert cold.stdout == silent.stdout == "5.0\n"
    assert cold.stderr.startswith("launchid: compiling") and len(cold.stderr.splitlines()) == 1
    assert silent.stderr == ""


# ---- the second process


@COMPILED
@pytest.mark.skipif(os.name != "posix", reason="a parent that has gone is POSIX's")
def test_the_second_process_ends_with_the_first_and_its_work_is_kept(tmp_path):
    """Its output is a pipe that closes when it ends; the whole formulation would be some hundred kernels."""
    first = ("import subprocess, sys, time; from pathlib import Path\n"
             f"subprocess.Popen([sys.executable, '-c', {HELPER!r}, 'integral'])\n"
             f"while not list(Path({str(tmp_path)!r}).rglob('*.nbc')): time.sleep(0.01)")
    done = python("-c", first, LAUNCHID_CACHE=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert 1 <= len(list(tmp_path.rglob("*.nbc"))) < 20


# ---- launchid warm


def test_where_nothing_can_be_kept_warm_says_so(tmp_path):
    (tmp_path / "file").write_text("")
    done = python("-m", "launchid", "warm", LAUNCHID_CACHE=tmp_path / "file")
    assert done.returncode == 3 and done.stdout == ""
    assert done.stderr.splitlines() == [f"launchid: {tmp_path / 'file'}: it cannot be written, is full, or others may "
                                        "write to it"]


@COMPILED
@pytest.mark.skipif(os.name != "posix", reason="POSIX signals")
def test_an_interrupt_ends_all_processes_of_warm_and_loses_nothing(tmp_path):
    process = subprocess.Popen([sys.executable, "-m", "launchid", "warm"], cwd=ROOT, start_new_session=True,
                               stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                               env=environment(LAUNCHID_CACHE=tmp_path))
    while len(list(tmp_path.rglob("*.nbc"))) < 3 and process.poll() is None:
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=60)  # the ends of its pipes are in every process
    assert (process.returncode, out, err.splitlines()[-1]) == (INTERRUPTED_STATUS, "", INTERRUPTED)
    assert "Traceback" not in err
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)
    assert len(list(tmp_path.rglob("*.nbc"))) >= 3
