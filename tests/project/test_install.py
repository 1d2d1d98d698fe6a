"""The README's two installations, in either order, twice, in one virtual environment: `launchid` works after each.

Five in turn hold both orders twice.

What is proved: pip's two ways of installing this project may follow one another in any order, with use between them,
so that caches are there; run from another folder, so that the sources beside the tests help nobody.  What is not:
downloading.  Dependencies are lent by the environment that runs the tests (a path in the new one's site-packages),
and pip builds with that one's setuptools.
"""

import os
import shutil
import subprocess
import sys
import sysconfig
from importlib.metadata import version
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
INSTALL = {"plain": ["."], "editable": ["-e", "."]}
ORDER = ("plain", "editable", "plain")


@pytest.fixture(scope="module")
def sources(tmp_path_factory) -> Path:
    """A copy, for pip leaves a `build` folder."""
    if int(version("setuptools").split(".")[0]) < 77:
        pytest.skip("the build needs setuptools 77 (extra `dev`), which this environment lacks")
    copy = tmp_path_factory.mktemp("sources")
    for name in ("launchid", "launchid_core", "sim"):
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        if (ROOT / name).exists():
            shutil.copy(ROOT / name, copy / name)
    return copy


class Environment:
    """A new virtual environment with the packages of this one."""

    def __init__(self, folder: Path) -> None:
        self.elsewhere = folder / "elsewhere"
        self.elsewhere.mkdir()
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder / "venv")], check=True)
        self.bin = folder / "venv" / ("Scripts" if os.name == "nt" else "bin")
        self.variables = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "NUMBA_CACHE_DIR")}
        self.packages = Path(self.python("-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip())
        lent = [*os.environ.get("PYTHONPATH", "").split(os.pathsep), sysconfig.get_path("purelib")]
        (self.packages / "lent.pth").write_text("".join(f"{os.path.abspath(p)}\n" for p in lent
                                                        if p and not (Path(p) / "sim").exists()))

    def run(self, *words: object, cwd: Path | None = None, **variables: str) -> str:
        done = subprocess.run([str(word) for word in words], cwd=cwd or self.elsewhere, env=self.variables | variables,
                              capture_output=True, text=True, timeout=600, check=False)
        assert done.returncode == 0, f"{words}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    def python(self, *words: object, cwd: Path | None = None) -> str:
        return self.run(self.bin / "python", *words, cwd=cwd)


@pytest.mark.campaign  # `.ci/run` runs it
def test_both_installations_in_either_order_leave_a_working_command(tmp_path, sources):
    place = Environment(tmp_path)
    for turn, how in enumerate(ORDER):
        place.python("-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation", "--disable-pip-version-check",
                     *INSTALL[how], cwd=sources)
        log = place.elsewhere / f"{turn}{how}.csv"
        place.run(place.bin / "launchid", "simulate", "constant", "--period", "0.1", "--out", log)
        table = place.run(place.bin / "launchid", "identify", log, NUMBA_DISABLE_JIT="1")  # the flight has compiled
        assert "samples accepted" in table
        where = Path(place.python("-c", "import launchid_core; print(launchid_core.__file__)").strip())
        assert where.is_relative_to(sources if how == "editable" else place.packages)
        assert list(place.packages.rglob("*.nbi")) == []


def test_caches_that_an_earlier_version_left_in_the_packages_shadow_nothing(tmp_path, sources):
    """The files of numba were kept in the packages until version 0.1, where pip leaves them."""
    place = Environment(tmp_path)
    for name in ("launchid_core", "sim"):
        left = place.packages / name / "__pycache__"
        left.mkdir(parents=True)
        (left / "linsolve.dot-22.py311.1.nbc").write_bytes(b"")
    place.python("-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation", "--disable-pip-version-check",
                 *INSTALL["editable"], cwd=sources)
    assert place.run(place.bin / "launchid", "--help").startswith("usage: launchid")
