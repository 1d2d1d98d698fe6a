"""Every figure of the README stands in the page of results; every table there names the command that measured it."""

import re
from pathlib import Path

import pytest

from benchmarks.tables import COMMAND

ROOT = Path(__file__).resolve().parents[2]
FIGURE = re.compile(r"(?<![\w.#-])\d[\d,]*(?:\.\d+)?")


def anchor(heading: str) -> str:
    """The name of a heading in a link."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def claims() -> list[tuple[str, list[str]]]:
    """Measured cell and linked sections of each row of the README's table of what it reaches."""
    text = (ROOT / "README.md").read_text(encoding="utf-8").split("## What it reaches")[1].split("\n## ")[0]
    rows = [row.strip("|").split("|") for row in text.splitlines() if row.startswith("|") and "results.md#" in row]
    return [(row[1].strip(), re.findall(r"results\.md#([\w-]+)", row[2])) for row in rows]


def test_the_readme_claims_something():
    assert len(claims()) >= 10 and all(FIGURE.search(measured) and linked for measured, linked in claims())


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
    assert len(figures) >= 6 and [figure for figure in figures if figure not in known] == []


def test_results_say_their_version_and_every_section_its_command():
    text = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    assert re.search(r"\bVersion \d+\.\d+\.\d+\b.*\b20\d\d\b", "\n".join(text.splitlines()[:6]))
    parts = re.split(r"^## (.+)$", text, flags=re.MULTILINE)
    tables = [heading for heading, body in zip(parts[1::2], parts[2::2], strict=True) if "\n|" in body]
    assert len(tables) >= 7
    without = [heading for heading, body in zip(parts[1::2], parts[2::2], strict=True)
               if heading in tables and not (COMMAND.search(body) or "```sh" in body)]
    assert without == []
