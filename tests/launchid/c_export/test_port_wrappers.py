"""Frames for cFS, F Prime and Simulink: each compiles against stubs of its interface, runs, and passes on the bits."""

import shutil
import subprocess
from functools import cache
from pathlib import Path

import pytest
from ported import CC, CONFIGS, SHARED, STRICT, needs_compiler

from launchid.c_export.kit import OUTPUTS, exported
from launchid.c_export.vectors import flown
from launchid_core import Estimator
from sim.nominal import load_nominal

STUBS = SHARED / "stubs"
CXX = shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
NAME = "measured-stls"
PLAIN = tuple(flag for flag in STRICT if flag not in ("-std=c99", "-pedantic"))


@cache
def flights():
    """The flights of the vectors."""
    return flown(load_nominal("constant"), CONFIGS[NAME])


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    made = tmp_path_factory.mktemp("wrappers")
    for name, text in exported(CONFIGS[NAME], flights()).items():
        (made / name).write_text(text, encoding="utf-8")
    return made


def build(folder: Path, *words: str) -> list[str]:
    """The lines that the program prints."""
    subprocess.run([*words, "-I.", "-o", "frame"], cwd=folder, check=True)
    return subprocess.run(["./frame"], cwd=folder, capture_output=True, text=True, check=True).stdout.splitlines()


@cache
def expected() -> list[str]:
    """t_end and a6 of the first flight's windows."""
    estimates = Estimator(CONFIGS[NAME]).replay(flights()[0])
    return [f"{e.t_end.hex()} {e.a6.hex()}" for e in estimates]


def estimates(lines: list[str]) -> list[str]:
    return [" ".join(float.fromhex(word).hex() for word in line.split()[1:]) for line in lines
            if line.startswith("estimate")]


@needs_compiler
def test_the_cfs_app_sends_the_estimates(folder):
    lines = build(folder, str(CC), *STRICT, f"-I{STUBS / 'cfs'}", "launchid_cfs.c", str(STUBS / "cfs" / "bus.c"),
                  "launchid.c", "-lm")
    assert estimates(lines) == expected() and len(expected()) >= 2
    assert lines[0] == "event 1" and lines.count("event 2") == 2 and lines[-1] == "exit 1"


@needs_compiler
@pytest.mark.skipif(CXX is None, reason="no C++ compiler here")
def test_the_f_prime_component_writes_the_estimates(folder):
    subprocess.run([str(CC), *STRICT, "-c", "launchid.c", "-o", "launchid.o"], cwd=folder, check=True)
    lines = build(folder, str(CXX), "-std=c++14", *PLAIN, f"-I{STUBS / 'fprime'}", "Launchid.cpp",
                  str(STUBS / "fprime" / "main.cpp"), "launchid.o", "-lm")
    assert estimates(lines) == expected()
    assert "refused -1" in lines


@needs_compiler
def test_the_simulink_function_holds_the_estimates(folder):
    lines = build(folder, str(CC), *PLAIN, "-std=c99", f"-I{STUBS / 'simulink'}", "launchid_sfun.c", "launchid.c",
                  "-lm")
    assert estimates(lines) == expected()


def test_every_frame_gives_what_the_description_says(folder):
    for name, *_ in OUTPUTS:
        assert f"telemetry {name}: F64" in (folder / "Launchid.fpp").read_text(encoding="utf-8")
        assert f"app.out.{name} = " in (folder / "launchid_cfs.c").read_text(encoding="utf-8")
        assert f"tlmWrite_{name}(" in (folder / "Launchid.cpp").read_text(encoding="utf-8")
