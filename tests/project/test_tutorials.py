"""The tutorials run, and what stands in them is what a run gives; no notebook software is needed for that.

The first flight in every run; all of them, diagnoses and the emulated board, with `-m campaign`.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.ipynb"))
TO_THE_LETTER = ("first_flight",)   # the others say what a search or a compiler of this machine says
LONGEST = 3000                      # s, of a diagnosis on a machine that does much else
RUN = """
import ast, contextlib, io, json, sys

def run(source, names):
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "cell", "exec"), names)
    return None if last is None else eval(compile(ast.Expression(last.value), "cell", "eval"), names)

def shown(value):  # as a notebook does
    makers = ((kind, getattr(value, f"_repr_{name}_", None)) for kind, name in
              (("text/html", "html"), ("image/png", "png")))
    return [kind for kind, make in makers if make is not None and make()]

book, names, answers = json.load(open(sys.argv[1], encoding="utf-8")), {"__name__": "__main__"}, []
for cell in book["cells"]:
    if cell["cell_type"] == "code":
        said = io.StringIO()
        with contextlib.redirect_stdout(said):
            kinds = shown(run("".join(cell["source"]), names))
        answers.append([said.getvalue(), kinds])
print(json.dumps(answers))
"""


def book_of(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))


def code_cells(path: Path) -> list[dict[str, Any]]:
    return [cell for cell in book_of(path)["cells"] if cell["cell_type"] == "code"]


def kept(cell: dict[str, Any]) -> tuple[str, list[str]]:
    """The text and the kinds of picture and table that stand below a cell."""
    said = "".join("".join(out["text"]) for out in cell["outputs"] if out["output_type"] == "stream")
    kinds = {kind for out in cell["outputs"] for kind in out.get("data", {}) if kind != "text/plain"}
    return said, sorted(kinds)


def executed(name: str, folder: Path) -> list[tuple[str, list[str]]]:
    """The same of a run, for each cell of code."""
    pytest.importorskip("matplotlib")
    pytest.importorskip("pandas")
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    done = subprocess.run([sys.executable, "-c", RUN, str(ROOT / "docs" / "tutorials" / f"{name}.ipynb")], cwd=folder,
                          env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)}, capture_output=True, text=True,
                          timeout=LONGEST, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return [(said, sorted(kinds)) for said, kinds in json.loads(done.stdout)]


@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_its_outputs_are_kept_and_its_links_lead_somewhere(path):
    assert [cell["execution_count"] for cell in code_cells(path)] == list(range(1, 1 + len(code_cells(path))))
    assert sum(bool(cell["outputs"]) for cell in code_cells(path)) >= 3
    text = "".join("".join(cell["source"]) for cell in book_of(path)["cells"] if cell["cell_type"] == "markdown")
    for link in re.findall(r"\]\(([^)#]+)\)", text):
        assert (path.parent / link).is_file(), link


def check(name: str, folder: Path) -> list[str]:
    """A run gives what is kept: pictures and tables where they stand, the text to the letter where that can be."""
    answers, cells = executed(name, folder), code_cells(ROOT / "docs" / "tutorials" / f"{name}.ipynb")
    assert [kinds for _, kinds in answers] == [kept(cell)[1] for cell in cells]
    said, stands = [said for said, _ in answers], [kept(cell)[0] for cell in cells]
    assert [bool(each) for each in said] == [bool(each) for each in stands]
    if name in TO_THE_LETTER:
        assert said == stands
    return said


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT", "0") != "0", reason="minutes without compiled kernels")
def test_the_first_flight_runs_and_says_what_stands_there(tmp_path):
    said = "".join(check("first_flight", tmp_path))
    assert "sudden change of k1 at 60.000" in said and "18 of 19 windows" in said


@pytest.mark.campaign
def test_the_real_log_s_gravity_is_found(tmp_path):
    said = "".join(check("real_log", tmp_path))
    gravity = re.search(r"^gravity (\d+\.\d)", said, re.MULTILINE)
    assert gravity is not None and 0.85 * 20.3 < float(gravity[1]) < 1.15 * 21.4
    assert "DOMINANT (plant)" in said and "lacks -20." in said


@pytest.mark.campaign
def test_the_servo_is_found_in_declared_wind(tmp_path):
    said = check("wind", tmp_path)
    assert any("EXPLAINED (actuator): actuator_delay" in each for each in said)
    assert "actuator_delay" in said[-1] and "turbulence" in said[-1], "of the nominal that believes in calm air"


@pytest.mark.campaign
def test_the_port_runs_on_an_emulated_board(tmp_path):
    """The cells say so where a compiler or the emulator is missing; the test is then skipped."""
    said = "".join(check("to_c", tmp_path))
    assert "FAILED" not in said
    assert said.count("0 differences") + said.count("skipped, ") == 2
    if skipped := re.findall(r"^make .*skipped, .*$", said, re.MULTILINE):
        pytest.skip("; ".join(skipped))


@pytest.mark.campaign
def test_without_a_compiler_the_tutorial_says_so_and_goes_on(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert shutil.which("make") is None
    said = [said for said, _ in executed("to_c", tmp_path)]
    assert [each for each in said if each.startswith("make ")] == [
        "make check: skipped, make and cc not found\n",
        "make check-m7: skipped, make and arm-none-eabi-gcc and qemu-system-arm not found\n"]
