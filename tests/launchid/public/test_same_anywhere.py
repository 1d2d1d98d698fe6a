"""The same bytes anywhere: whatever locale, time zone, hash seed or encoding of the terminal; sums and orthonormal
bases in one order.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from launchid.sums import orthonormal

ROOT = Path(__file__).resolve().parents[3]
SHORT = (ROOT / "sim" / "data" / "nominal" / "constant.toml").read_text(encoding="utf-8")
EVERYTHING = """
import sys
from launchid.__main__ import command
folder = sys.argv[1] + "/"
for words in (["simulate", folder + "short.toml", "--out", folder + "log.csv", "--seed", "3", "--quiet"],
              ["identify", folder + "log.csv", "--nominal", folder + "short.toml", "--tracked", "--json",
               folder + "identify.json", "--quiet"],
              ["diagnose", folder + "log.csv", folder + "short.toml", "--json", "-", "--quiet"]):
    sys.argv[1:] = words
    assert command() == 0
"""
EACH = """
import sys
from launchid.__main__ import command
for log in sys.argv[1:]:
    sys.argv[1:] = ["identify", log]
    assert command() == 0
    print("----")
"""
PLACES = {
    "C": {"LC_ALL": "C", "TZ": "UTC", "PYTHONHASHSEED": "0"},
    "German": {"LC_ALL": "de_DE.UTF-8", "TZ": "America/St_Johns", "PYTHONHASHSEED": "1"},
    "Turkish": {"LC_ALL": "tr_TR.UTF-8", "TZ": "Asia/Kathmandu", "PYTHONHASHSEED": "4294967295"},
    "an ASCII terminal": {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": "ascii",
                          "PYTHONHASHSEED": "random"}}


def made(folder: Path, variables: dict[str, str]) -> dict[str, bytes]:
    """The files that the commands write, stdout and stderr among them; in a folder whose name is not ASCII."""
    folder.mkdir(parents=True)
    (folder / "short.toml").write_text(SHORT.replace("duration = 70.0", "duration = 3.0"), encoding="utf-8")
    done = subprocess.run([sys.executable, "-c", EVERYTHING, "."], cwd=folder, capture_output=True, timeout=900,
                          check=False, env={**os.environ, "PYTHONPATH": str(ROOT), **variables})
    assert done.returncode == 0, done.stderr.decode()
    return {path.name: path.read_bytes() for path in folder.iterdir()} | {"stdout": done.stdout, "stderr": done.stderr}


@pytest.fixture(scope="module")
def here(tmp_path_factory) -> dict[str, bytes]:
    return made(tmp_path_factory.mktemp("here") / "\u00e9t\u00e9", {"LC_ALL": "C.UTF-8"})


@pytest.fixture(scope="module")
def locales(tmp_path_factory) -> dict[str, str]:
    """The environment in which glibc finds the German and the Turkish locale: of the system, or compiled for the
    test."""
    known = subprocess.run(["locale", "-a"], capture_output=True, text=True, check=False).stdout.lower() \
        if shutil.which("locale") else ""
    if "de_de.utf8" in known and "tr_tr.utf8" in known:
        return {}
    if not shutil.which("localedef"):
        pytest.skip("no German and Turkish locale here, and no localedef")
    folder = tmp_path_factory.mktemp("locales")
    for name in ("de_DE", "tr_TR"):
        compiled = subprocess.run(["localedef", "-i", name, "-f", "UTF-8", str(folder / f"{name}.UTF-8")],
                                  capture_output=True, text=True, check=False)
        if not (folder / f"{name}.UTF-8").exists():
            pytest.skip(f"the locale {name} cannot be compiled here ({compiled.stderr.strip()[:80]})")
    return {"LOCPATH": str(folder)}


@pytest.mark.skipif(os.name != "posix", reason="POSIX locales")
@pytest.mark.parametrize("place", [place if place == "Turkish" else pytest.param(
    place, marks=pytest.mark.campaign) for place in PLACES])
def test_the_bytes_are_the_same(tmp_path, request, here, place):
    variables = PLACES[place]
    if "_" in variables["LC_ALL"]:
        variables = variables | request.getfixturevalue("locales")
    assert made(tmp_path / "\u00e9t\u00e9", variables) == here


@pytest.mark.skipif(os.name != "posix", reason="POSIX file names")
@pytest.mark.parametrize("encoding", ["ascii", pytest.param("utf-8", marks=pytest.mark.campaign)])
def test_any_name_of_a_file_can_be_said(tmp_path, encoding):
    """The name is printed on a terminal that knows ASCII alone, and if its bytes are no text."""
    logs = [os.path.join(os.fsencode(tmp_path), name) for name in ("\u00e9t\u00e9.csv".encode(), b"\xff\xfe.csv")]
    rows = "".join(f"{k / 100},{k % 7 / 100},{k % 5 / 100}\n" for k in range(600))
    for log in logs:
        Path(os.fsdecode(log)).write_text("t,theta,beta\n" + rows)
    done = subprocess.run([sys.executable, "-c", EACH, *logs], cwd=ROOT, capture_output=True, timeout=300, check=False,
                          env={**os.environ, "PYTHONIOENCODING": encoding})
    assert done.returncode == 0, done.stderr.decode()
    said = done.stdout.split(b"----\n")
    assert len(said) == len(logs) + 1 and all(each.count(b"\n") > 3 for each in said[:-1])


A = np.random.default_rng(8).standard_normal((50, 4))


@pytest.mark.parametrize("scale", [1e-100, 1.0, 1e100])
def test_a_basis_is_orthonormal_and_gives_the_columns_back(scale):
    for a in (A, np.vander(np.linspace(0.0, 1.0, 50), 8)):  # the second of condition 1e6
        q, r = orthonormal(scale * a)
        assert q.T @ q == pytest.approx(np.eye(a.shape[1]), abs=1e-12)
        assert q @ (r / scale) == pytest.approx(a, rel=1e-12, abs=1e-13) and np.array_equal(r, np.triu(r))


def test_a_column_that_depends_on_those_before_is_nothing_and_one_that_hardly_does_is_kept():
    """A column that is off by rounding, or by a part in 1e10 of its length."""
    of_others = A[:, 0] - 2.0 * A[:, 1]
    length = np.linalg.norm(of_others)
    for off, kept in ((0.0, False), (1e-15, False), (1e-10, True)):
        q, _ = orthonormal(np.column_stack([A[:, :2], of_others + off * length * A[:, 3], A[:, 2], np.zeros(50)]))
        assert [bool(q[:, k].any()) for k in range(5)] == [True, True, kept, True, False]
