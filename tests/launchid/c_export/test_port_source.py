"""The exported source by the rules of flight software: no warning, no required MISRA rule broken, loops and calls."""

import csv
import re
import shutil
import subprocess
from collections import Counter
from pathlib import Path

import pytest
from ported import CONFIGS, WARNINGS, some, written

MISRA = Path(__file__).parents[2] / "misra_c2012.csv"
COMPILERS = ("gcc", "clang")


@pytest.mark.parametrize("compiler", COMPILERS)
@pytest.mark.parametrize("name", some("filtered-vega-range", "filtered-wind", "integral-lasso"))
def test_no_compiler_warns(compiler, name, tmp_path):
    if shutil.which(compiler) is None:
        pytest.skip(f"no {compiler} here")
    folder = written(tmp_path, CONFIGS[name])
    files = sorted(path.name for path in folder.glob("*.c"))
    done = subprocess.run([compiler, "-std=c99", *WARNINGS, "-fsyntax-only", *files], cwd=folder, capture_output=True,
                          text=True, check=False)
    assert done.stderr == "" and done.returncode == 0


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
def test_the_add_on_sees_a_required_rule_broken(tmp_path):
    (tmp_path / "launchid.c").write_text("int f(int a);\nint f(int a)\n{\n    if (a) {\n        a = 0;\n    }\n"
                                         "    return a + 0 * a;\n}\n", encoding="utf-8")
    found = findings(tmp_path)
    assert {"14.4", "2.2"} <= set(found)


@needs_cppcheck
@pytest.mark.parametrize("name", some("integral-lasso"))
def test_no_required_or_mandatory_rule_is_broken(name, tmp_path):
    known = categories()
    found = findings(written(tmp_path, CONFIGS[name]))
    assert found.total() > 0  # advisory ones: the add-on has run
    assert {rule: count for rule, count in found.items() if known[rule] != "advisory"} == {}


def test_the_table_of_rules_is_whole():
    known = categories()
    assert Counter(known.values()).keys() == {"required", "mandatory", "advisory"}
    assert (known["17.3"], known["17.2"], known["12.1"]) == ("mandatory", "required", "advisory")
    assert all(re.fullmatch(r"\d+\.\d+", rule) for rule in known)
