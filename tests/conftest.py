"""Hypothesis profiles, one cache of the independent generator's kernels for all processes, and two processes.

Profiles: `same` by default, the same examples each time; `other` and `long`, others, by hand (HYPOTHESIS_PROFILE).
"""

import gc
import math
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from launchid.cli.terminal import Progress
from launchid.log.log import MEASURED_LOGS
from launchid.main import main
from launchid_core.cache import kept_apart

_quiet = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture]
settings.register_profile("other", max_examples=30, deadline=None, suppress_health_check=_quiet)
settings.register_profile("same", max_examples=30, deadline=None, derandomize=True, suppress_health_check=_quiet)
settings.register_profile("long", max_examples=2000, deadline=None, suppress_health_check=_quiet)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))

Progress.LINE = math.inf  # s: no line of progress appears in a file because a machine is slow; processes get --quiet

# tests of one room use helpers of another's: every folder of tests is importable, whichever file is run alone
sys.path += sorted({str(path.parent) for path in Path(__file__).parent.rglob("test_*.py")})

# where the environment forbids bytecode, as containers do, each of some hundred processes would compile all of it anew
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # of `pytest &` in a script; commands that are started inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).resolve().parents[1]
MOTION = ("tests/sim/test_hidden_generator.py", "-k", "clean_flight_is_the_exact_solution")  # flies the generator
WORKERS = 2  # of the whole suite; they share the kernels' cache, and none is compiled twice


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """The whole suite runs in WORKERS processes where pytest-xdist is installed; named files, and -n, as asked."""
    option = config.option
    whole = config.args_source == pytest.Config.ArgsSource.TESTPATHS
    worker = "PYTEST_XDIST_WORKER" in os.environ  # which has this very hook
    if whole and not worker and getattr(option, "numprocesses", 0) is None and not option.tx and not option.usepdb:
        option.numprocesses = WORKERS
        option.dist = "worksteal"  # neighbours, which share a module's fixtures, stay together
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of each: more only wait for one another
        # all is compiled once, beforehand, the independent generator's motion beside it: else each process compiles it
        motion = [sys.executable, "-m", "pytest", "-n", "0", *MOTION]
        with subprocess.Popen(motion, cwd=ROOT, stdout=subprocess.DEVNULL):
            subprocess.run([sys.executable, "-m", "launchid", "warm"], cwd=ROOT, check=False)


def pytest_collection_finish() -> None:
    """Keep the kernels of `hidden`, which knows nothing of the project, where the project's are: compiled once.

    What thousands of tests are made of stays: no search for garbage goes through it again.
    """
    motion = sys.modules.get("hidden.motion")
    for kernel in vars(motion).values() if motion else ():
        if hasattr(kernel, "py_func"):
            with kept_apart(kept_apart) as is_safe:  # the core's folder
                if is_safe:
                    kernel.enable_caching()
    gc.collect()
    gc.freeze()


@pytest.fixture
def launchid(capsys):
    """Run the command; (exit status, stdout, stderr)."""
    def run(*argv: object) -> tuple[int, str, str]:
        capsys.readouterr()
        status = main([str(word) for word in argv])
        return status, *capsys.readouterr()
    return run


@pytest.fixture
def real_logs() -> Path:
    """Folder of the measured logs that come with the package."""
    return MEASURED_LOGS
