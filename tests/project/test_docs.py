"""The documentation says what is there: links, tests, commands, options, constants, names; its host loop runs.

Every figure of the README stands in the page of results; every table there names the command that measured it.
"""

import ast
import contextlib
import functools
import io
import re
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import numba
import pytest

from launchid.cli.reference import causes_table
from launchid.main import main
from launchid_core import LIBRARIES, EstimateStatus, Status, __version__
from sim.nominal import (
    BUILT_IN,
    Actuator,
    Controller,
    Diagnosis,
    Drift,
    Guidance,
    Multisine,
    Offsets,
    Required,
    Sensors,
    Simulation,
    Wind,
)

ROOT = Path(__file__).resolve().parents[2]
README = ROOT / "README.md"
DOCS = sorted((ROOT / "docs").glob("*.md"))
PAGES = [README, ROOT / "CHANGELOG.md", *DOCS]
FENCED = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
TEST = re.compile(r"`(tests/[\w/]+\.py|\.ci/run|benchmarks/\w+\.py)(?:::(\w+))?`")


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@functools.cache
def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def code_of(path: Path) -> Iterator[str]:
    """The spans in backticks, and the lines of shell."""
    text = text_of(path)
    for language, block in FENCED.findall(text):
        if language == "sh":
            yield from (line.split(" #")[0] for line in block.splitlines())
    yield from (" ".join(span.split()) for span in re.findall(r"`([^`]+)`", FENCED.sub("", text)))


def anchors(path: Path) -> set[str]:
    """The names of a page's headings in a link."""
    headings = re.findall(r"^#+ (.+)$", FENCED.sub("", text_of(path)), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@functools.cache
def help_of(*words: str) -> str:
    """The text that `launchid WORDS --help` prints."""
    with contextlib.redirect_stdout(io.StringIO()) as said, pytest.raises(SystemExit):
        main([*words, "--help"])
    return said.getvalue()


def commands() -> list[str]:
    """The commands that `launchid --help` lists."""
    return re.findall(r"^    ([a-z][a-z-]+)(?: |$)", help_of(), re.MULTILINE)


@functools.cache
def functions_of(path: Path) -> frozenset[str]:
    return frozenset(node.name for node in ast.walk(ast.parse(text_of(path))) if isinstance(node, ast.FunctionDef))


# ---- pages


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_and_pictures_exist(page):
    missing = []
    for link in LINK.findall(FENCED.sub("", text_of(page))):
        target, _, anchor = link.partition("#")
        if "://" in link:
            continue
        path = (page.parent / target).resolve() if target else page
        if not path.is_file() or (anchor and anchor not in anchors(path)):
            missing.append(link)
    assert missing == []


# ---- what is named


def test_every_guarantee_has_its_test():
    page = ROOT / "docs" / "guarantees.md"
    found = TEST.findall(text_of(page))
    assert len(found) >= 40
    missing = [f"{file}::{function}" for file, function in found
               if not (ROOT / file).is_file() or (function and function not in functions_of(ROOT / file))]
    assert missing == []
    rows = re.findall(r"^\| (?!guarantee).*", text_of(page), re.MULTILINE)
    assert [row for row in rows if not TEST.search(row)] == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_files_of_code_exist_by_their_names(page):
    folders = (ROOT / name for name in ("launchid_core", "sim", "launchid", "tests", "benchmarks"))
    known = {path.name for folder in folders for path in folder.rglob("*.py")}
    named = {name for code in code_of(page) for name in re.findall(r"\b\w+\.py\b", code)}
    assert named <= known


# ---- the command


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_and_their_options_exist(page):
    wrong = []
    for code in code_of(page):
        for command, words in re.findall(r"\blaunchid ([a-z][a-z-]*)((?: [^&|]*)?)", code):
            options = re.findall(r"--[a-z][a-z-]*", words)
            if command not in commands() or any(option not in help_of(command) for option in options):
                wrong.append(code)
    assert wrong == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_benchmarks_have_the_options_they_are_quoted_with(page):
    missing = []
    for code in code_of(page):
        match = re.match(r"(?:\S+=\S+ )?(?:python )?(?:benchmarks/)?(\w+\.py)( .*)?$", code)
        if match is None or not (ROOT / "benchmarks" / match[1]).is_file():
            continue
        known = options_of(ROOT / "benchmarks" / match[1])
        missing += [code for option in re.findall(r"--[a-z][\w-]*", match[2] or "") if option not in known]
    assert missing == []


def options_of(path: Path) -> set[str]:
    """The options of a benchmark: those that it names, and the arguments of `flights.arguments`."""
    calls = [node for node in ast.walk(ast.parse(text_of(path))) if isinstance(node, ast.Call)]
    named = {word.value for call in calls for word in call.args
             if isinstance(word, ast.Constant) and str(word.value).startswith("--")}
    shared = [call for call in calls if isinstance(call.func, ast.Name | ast.Attribute)
              and "arguments" in (getattr(call.func, "id", ""), getattr(call.func, "attr", ""))]
    words = {word.arg for call in shared for word in call.keywords} | ({"nominal"} if shared else set())
    return named | {f"--{word.replace('_', '-')}" for word in words}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_selections_of_tests_select_something(page):
    for code in code_of(page):
        for file, word in re.findall(r"(tests/[\w/]+\.py)(?: -k (\w+))?", code):
            assert any(word in function for function in functions_of(ROOT / file)), code
            assert "-m campaign" not in code or "mark.campaign" in text_of(ROOT / file), code


# ---- numbers and names of the code


def constants_of_the_core() -> dict[str, set[str]]:
    """Name -> the values, as they are written, that module constants of this name have."""
    found: dict[str, set[str]] = {}
    for path in sorted((ROOT / "launchid_core").rglob("*.py")):
        for node in ast.parse(text_of(path)).body:
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                found.setdefault(node.targets[0].id, set()).add(ast.unparse(node.value))
    return found


def test_constants_of_the_method_are_the_code_s():
    table = re.findall(r"^\| `([A-Z_]+)` \| ([^|]+) \|", text_of(ROOT / "docs" / "method.md"), re.MULTILINE)
    assert len(table) >= 20
    known = constants_of_the_core()
    written = {name: ast.unparse(ast.parse(value.strip(), mode="eval")) for name, value in table}
    assert [name for name, value in written.items() if value not in known.get(name, ())] == []


def test_the_table_of_causes_is_the_catalogue_s():
    assert "\n".join(causes_table()) in text_of(ROOT / "docs" / "formats.md"), \
        "write_causes('docs/formats.md') of launchid.cli.reference writes it"


@pytest.mark.parametrize("section", [Actuator, Controller, Diagnosis, Drift, Guidance, Multisine, Offsets, Required,
                                     Sensors, Simulation, Wind])
def test_every_key_of_a_nominal_is_in_the_formats(section):
    named = set(code_of(ROOT / "docs" / "formats.md"))
    assert {field.name for field in fields(section)} - {"path"} <= named


def test_names_of_the_command_line_are_in_the_formats():
    named = set(code_of(ROOT / "docs" / "formats.md"))
    assert {*LIBRARIES, *BUILT_IN} <= named
    assert {status.name for status in EstimateStatus} <= named
    assert {status.name for status in Status if status < 0} <= named


def test_one_version_everywhere():
    version = __version__  # pyproject.toml takes it from there
    assert f"\nversion: {version}\n" in text_of(ROOT / "CITATION.cff")
    assert f"\n## [{version}] - " in text_of(ROOT / "CHANGELOG.md")


# ---- the host loop


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="NUMBA_DISABLE_JIT=1: seven thousand samples take minutes")
def test_the_host_loop_of_the_readme_runs(capsys):
    (loop,) = [block for language, block in FENCED.findall(text_of(README)) if language == "python"]
    exec(compile(loop, "README.md", "exec"), {})
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 14 and all("rejected" not in line for line in lines)
    tracked = re.search(r"tracked (\S+) \+- (\S+);.*tracked (\S+) \+- (\S+)", lines[-1])
    assert tracked is not None
    a6, a6_std, k1, k1_std = map(float, tracked.groups())
    assert abs(a6 - 2.0) < 5.0 * a6_std < 1.0 and abs(k1 + 7.0) < 5.0 * k1_std < 3.5


FIGURE = re.compile(r"(?<![\w.#-])\d[\d,]*(?:\.\d+)?")


def anchor(heading: str) -> str:
    """The name of a heading in a link."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def claims() -> list[tuple[str, list[str]]]:
    """Measured cell and linked sections of each row of the README's table of what it reaches."""
    text = (ROOT / "README.md").read_text(encoding="utf-8").split("## What it reaches")[1].split("\n## ")[0]
    rows = [row.strip("|").split("|") for row in text.splitlines() if row.startswith("|") and "results.md#" in row]
    return [(row[1].strip(), re.findall(r"results\.md#([\w-]+)", row[2])) for row in rows]


@pytest.mark.parametrize(("measured", "linked"), claims(), ids=lambda x: x if isinstance(x, str) else "")
def test_every_figure_of_the_readme_stands_in_the_section_it_names(measured, linked):
    text = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    parts = re.split(r"^#+ (.+)$", text, flags=re.MULTILINE)
    section = "".join(body for heading, body in zip(parts[1::2], parts[2::2], strict=True) if anchor(heading) in linked)
    known = set(FIGURE.findall(section))
    assert [figure for figure in FIGURE.findall(measured) if figure not in known] == []


def test_every_figure_of_the_readme_s_prose_stands_in_results_or_limits():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    prose = text.split("![")[0] + text.split("## Limits")[1].split("\n## ")[0]
    known = {figure for name in ("results.md", "limits.md")
             for figure in FIGURE.findall((ROOT / "docs" / name).read_text(encoding="utf-8"))}
    figures = FIGURE.findall(prose)
    assert len(figures) >= 3 and [figure for figure in figures if figure not in known] == []
