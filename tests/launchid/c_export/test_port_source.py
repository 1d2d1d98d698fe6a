"""The exported source by the rules of flight software: no warning, no required MISRA rule broken, loops and calls."""

import csv
import platform
import re
import shutil
import subprocess
from collections import Counter
from pathlib import Path

import pytest
from ported import CERTIFIED, CONFIGS, WARNINGS, some, written

MISRA = Path(__file__).parents[2] / "misra_c2012.csv"
COMPILERS = ("gcc", "clang")


@pytest.mark.skipif(shutil.which("clang") is None, reason="no clang here")
@pytest.mark.parametrize("name", some("filtered-vega-range", "filtered-still", "integral-lasso"))
def test_no_compiler_warns(name, tmp_path):
    """clang; with the same options and -Werror every program of these tests is built by gcc."""
    folder = written(tmp_path, CONFIGS[name])
    files = sorted(path.name for path in folder.glob("*.c"))
    done = subprocess.run(["clang", "-std=c99", *WARNINGS, "-fsyntax-only", *files], cwd=folder, capture_output=True,
                          text=True, check=False)
    assert done.stderr == "" and done.returncode == 0


# ---- options that break NaN or the order of sums


NO_NAN, REORDERS, WIDER, SHORTER = (
    "expected NaN and infinities", "every operation as it is written", "expected plain double precision",
    "expected doubles of 64 bits")
REFUSED = [
    *((compiler, options, said) for compiler in COMPILERS for options, said in (
        ("-ffast-math", NO_NAN), ("-ffinite-math-only", NO_NAN), ("-Ofast", NO_NAN),
        ("-U__DBL_MANT_DIG__ -D__DBL_MANT_DIG__=24", SHORTER))),
    *(("gcc", options, REORDERS) for options in (
        "-funsafe-math-optimizations", "-freciprocal-math", "-fno-signed-zeros",
        "-fassociative-math -fno-signed-zeros -fno-trapping-math")),
    *([("gcc", "-mfpmath=387", WIDER)] if platform.machine() == "x86_64" else [])]


@pytest.mark.parametrize(("compiler", "options", "said"), REFUSED)
def test_an_option_without_nan_is_refused(compiler, options, said, tmp_path):
    """And one that reorders sums, or whose doubles are wider or shorter."""
    if shutil.which(compiler) is None:
        pytest.skip(f"no {compiler} here")
    folder = written(tmp_path, CERTIFIED["integral"])
    done = subprocess.run([compiler, "-std=c99", "-w", *options.split(), "-fsyntax-only", "launchid.c"], cwd=folder,
                          capture_output=True, text=True, check=False)
    assert done.returncode != 0 and said in done.stderr


@pytest.mark.skipif(platform.machine() != "x86_64", reason="options of x86-64")
@pytest.mark.parametrize(("compiler", "options"), [
    ("gcc", "-std=gnu99 -ffp-contract=fast"), ("clang", "-ffp-contract=on"), *(
        pytest.param(*each, marks=pytest.mark.campaign) for each in (
            ("gcc", "-std=gnu99"), ("clang", "-funsafe-math-optimizations -ffp-contract=on")))])
def test_pragmas_forbid_to_contract(compiler, options, tmp_path):
    """Not one fused multiply-add, on a machine that has them."""
    if shutil.which(compiler) is None:
        pytest.skip(f"no {compiler} here")
    folder = written(tmp_path, CERTIFIED["integral"])
    build = [compiler, "-O2", "-mfma", *options.split(), "-S", "launchid.c", "-o"]
    subprocess.run([*build, "out.s"], cwd=folder, check=True)
    assert not re.search(r"vfn?m(add|sub)", (folder / "out.s").read_text(encoding="utf-8"))
    source = (folder / "launchid.c").read_text(encoding="utf-8")
    (folder / "launchid.c").write_text(source.replace("#pragma", "//"), encoding="utf-8")
    subprocess.run([*build, "free.s"], cwd=folder, check=True)
    assert re.search(r"vfn?m(add|sub)", (folder / "free.s").read_text(encoding="utf-8"))  # which they would be


# ---- what cannot run

UNREACHABLE = ("-Wunreachable-code-aggressive", "-Wunused", "-Wtautological-compare", "-Werror")
NO_TURN = re.compile(r"for \(int64_t (\w+) = (\d+); \1 < (\d+);")


@pytest.mark.skipif(shutil.which("clang") is None, reason="no clang here")
@pytest.mark.parametrize("name", some("vega_like", "integral", of=CERTIFIED))
def test_nothing_is_there_that_cannot_run(name, tmp_path):
    """No branch that a constant decides, no loop of no turns, no function that nothing calls."""
    folder = written(tmp_path, CERTIFIED[name])
    done = subprocess.run(["clang", "-std=c99", *UNREACHABLE, "-fsyntax-only", "launchid.c"], cwd=folder,
                          capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    source = (folder / "launchid.c").read_text(encoding="utf-8")
    loops = [(int(low), int(high)) for _, low, high in NO_TURN.findall(source)]
    assert len(loops) > 30 and all(low < high for low, high in loops)
    assert not re.search(r"\bif \(!?(true|false|\(?-?\d+ [<>=!]+ -?\d+\)?)\)", source)
    assert not re.search(r"(&&|\|\||\() ?!?(true|false)\b ?(&&|\|\|)|\(\d+ [<>=!]+ \d+\)", source)


# ---- MISRA C:2012


def categories() -> dict[str, str]:
    """Rule -> required, mandatory or advisory."""
    lines = [line for line in MISRA.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    return {row["rule"]: row["category"] for row in csv.DictReader(lines)}


def findings(folder: Path, tool: str = "cppcheck") -> Counter[str]:
    """The number of times that launchid.c breaks each rule, by cppcheck's MISRA add-on."""
    done = subprocess.run([tool, "--std=c99", "--addon=misra", "-D__STDC__", "-U__FAST_MATH__", "-UFLT_EVAL_METHOD",
                           "--enable=style", "-q", "--template={id}", "launchid.c"], cwd=folder, capture_output=True,
                          text=True, check=True)
    return Counter(line.removeprefix("misra-c2012-") for line in done.stderr.splitlines()
                   if line.startswith("misra-c2012-"))


needs_cppcheck = pytest.mark.skipif(shutil.which("cppcheck") is None, reason="no cppcheck here")


@needs_cppcheck
@pytest.mark.parametrize("name", some("integral-lasso"))
def test_no_required_or_mandatory_rule_is_broken(name, tmp_path):
    known = categories()
    found = findings(written(tmp_path, CONFIGS[name]))
    assert found.total() > 0  # advisory ones: the add-on has run
    assert {rule: count for rule, count in found.items() if known[rule] != "advisory"} == {}
