"""The wheel alone, in a fresh virtual environment: every command works, or says in one line which extra it needs.

Of this environment's packages the new one sees those that the wheel declares, numpy and numba (with llvmlite), and no
other; nothing is downloaded.
"""

import os
import re
import shutil
import subprocess
import sys
import sysconfig
from importlib.metadata import version
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LENT = ("numpy", "numba", "llvmlite")
SHORT = 8.0     # s of the flight that the commands are tried on
LONGEST = 1800  # s that one command may take, compilation included
MAP = '[time]\nname = "t"\n[columns.theta]\nfrom = "theta"\n[columns.beta]\nfrom = "beta"\n'
WORKS = ("--version", "effects", "simulate short.toml --out log.csv --seed 3", "identify log.csv",
         "identify log.csv --nominal short.toml --window 2 --tracked --json identified.json",
         "uncertainty log.csv short.toml --window 2", "nominal log.csv --out first.toml",
         "plan short.toml --accuracy 0.05 --window 4 --out plan.toml", "fit-lft log.csv short.toml --out range.toml",
         "diagnose log.csv short.toml --report report", "export-c short.toml --out port",
         "campaign short.toml --flights 2 --workers 1 --out proof",
         "convert log.csv --map map.toml --out converted.csv",
         "watch log.csv --nominal short.toml --once", "identify dfki_pendulum_dircol --window all",
         "watch log.csv --nominal short.toml --once --map map.toml")
NEEDS = {"identify log.csv --plot x.png": "plots", "identify log.csv --resid x.png": "plots",
         "uncertainty log.csv short.toml --plot x.png": "plots",
         "convert log.mat --map map.toml --out y.csv": "logs", "identify log.mat --map map.toml": "logs",
         "watch log.mat --nominal short.toml --once --map map.toml": "logs",
         "campaign short.toml --flights 2 --out dask --executor dask:tcp://127.0.0.1:1": "cluster"}
WITHOUT_FIGURES = "reproduce --case windowed --seeds 1 --out r"  # whose tables and verdicts need no extra
pytestmark = [pytest.mark.campaign, pytest.mark.skipif(sys.platform == "win32", reason="symbolic links are lent")]


class Fresh:
    """A virtual environment with the wheel, and a folder to work in."""

    def __init__(self, folder: Path) -> None:
        self.at = folder / "elsewhere"
        self.at.mkdir()
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder / "venv")], check=True)
        self.bin = folder / "venv" / "bin"
        packages = next((folder / "venv" / "lib").glob("python*")) / "site-packages"
        for path in Path(sysconfig.get_path("purelib")).iterdir():
            if re.split(r"[-.]", path.name)[0] in LENT:
                (packages / path.name).symlink_to(path)
        self.variables = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
        subprocess.run([sys.executable, "-m", "pip", "--python", str(self.bin / "python"), "install", "-q", "--no-deps",
                        "--no-index", "--disable-pip-version-check", str(wheel_of(folder))], check=True)

    def run(self, *words: str) -> tuple[int, str, str]:
        done = subprocess.run([str(self.bin / words[0]), *words[1:]], cwd=self.at, env=self.variables, text=True,
                              capture_output=True, timeout=LONGEST, check=False)
        told = [line for line in done.stderr.splitlines() if not line.startswith("launchid: compiling")]
        return done.returncode, done.stdout, "\n".join(told)


def wheel_of(folder: Path) -> Path:
    """The wheel, built of a copy, for pip leaves a `build` folder."""
    if int(version("setuptools").split(".")[0]) < 77:
        pytest.skip("the build needs setuptools 77 (extra `dev`), which this environment lacks")
    copy = folder / "sources"
    for name in ("launchid", "launchid_core", "sim"):
        shutil.copytree(ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy / name)
    subprocess.run([sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation",
                    "--disable-pip-version-check", "-w", str(folder), str(copy)], check=True)
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def fresh(tmp_path_factory) -> Fresh:
    place = Fresh(tmp_path_factory.mktemp("fresh"))
    text = (ROOT / "sim" / "data" / "nominal" / "constant.toml").read_text(encoding="utf-8")
    (place.at / "short.toml").write_text(text.replace("duration = 70.0", f"duration = {SHORT}"), encoding="utf-8")
    (place.at / "map.toml").write_text(MAP, encoding="utf-8")
    (place.at / "log.mat").write_bytes(b"MATLAB 5.0 MAT-file" + bytes(200))
    return place


def test_nothing_but_the_wheel_and_its_dependencies_is_there(fresh):
    for module in ("matplotlib", "scipy", "pandas"):
        assert fresh.run("python", "-c", f"import {module}")[0] != 0
    assert fresh.run("python", "-c", "import launchid, launchid_core, sim; print(launchid.__file__)")[1].startswith(
        str(fresh.bin.parent))


def test_every_command_is_tried(fresh):
    listed = re.findall(r"^    ([a-z][a-z-]+)(?: |$)", fresh.run("launchid", "--help")[1], re.MULTILINE)
    assert set(listed) == {words.split()[0] for words in (*WORKS, *NEEDS, WITHOUT_FIGURES)} - {"--version"}


def test_every_command_works_or_names_its_extra(fresh):
    """One after the other, for the later take what the earlier wrote."""
    for words in WORKS:
        status, out, err = fresh.run("launchid", *words.split())
        assert status == 0, f"{words}: {err}"
        assert "Traceback" not in out + err
    for words, extra in NEEDS.items():
        status, out, err = fresh.run("launchid", *words.split())
        assert (status, out) == (2, ""), f"{words}: {status} {out} {err}"
        assert len(err.splitlines()) == 1 and f"pip install 'launchid[{extra}]'" in err, f"{words}: {err}"
    status, out, err = fresh.run("launchid", *WITHOUT_FIGURES.split())
    assert (status, err) == (0, "") and "no figures (pip install 'launchid[plots]'" in out.splitlines()[-1]
    assert (fresh.at / "report" / "report.html").is_file() and (fresh.at / "port" / "launchid.c").is_file()
