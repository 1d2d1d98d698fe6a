"""Every figure of the README stands in the page of results; every table there names the command that measured it."""

import re
from pathlib import Path

import pytest

from benchmarks.tables import COMMAND, figures_of_tables, main, missing, sections

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


# ---- the command that writes the tables

PAGE = """# Results
## Speed
```sh
python benchmarks/speed.py --seed 1   # a comment
```
| what | measured |
|---|---|
| rounds | 1,200 |
| share | 97.1 % |
| other | 3.5 |
"""


def test_a_section_s_commands_and_figures_are_collected():
    (section,) = sections(PAGE)
    assert section.heading == "Speed" and section.commands == ["python benchmarks/speed.py --seed 1"]
    assert figures_of_tables(section.text) == ["1,200", "97.1", "3.5"]


@pytest.mark.parametrize(("printed", "left"), [
    ("1200 rounds, share 0.971, other 3.49", []), ("1200 rounds, share 0.971", ["3.5"]),
    ("1201 rounds, 97.14 %, 3.56", ["1,200", "3.5"]), ("", ["1,200", "97.1", "3.5"])])
def test_a_figure_is_one_that_was_printed_up_to_its_last_digit(printed, left):
    (section,) = sections(PAGE)
    assert missing(section, printed) == left


def test_a_word_that_no_command_holds_is_said(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["tables.py", "no_such_benchmark"])
    assert main() == 2 and "no command of results.md holds no_such_benchmark" in capsys.readouterr().err


def test_what_a_command_prints_is_kept_with_version_and_date(tmp_path, monkeypatch, capsys):
    page = tmp_path / "results.md"
    page.write_text("# Results\n## Help\n```sh\npython benchmarks/nothing.py\n```\n| a | 1 |\n",
                    encoding="utf-8")
    monkeypatch.setattr("benchmarks.tables.PAGE", page)
    monkeypatch.setattr("sys.argv", ["tables.py", "nothing", "--out", str(tmp_path / "out"), "--check"])
    assert main() == 1, "a command that fails is said"
    (kept,) = (tmp_path / "out").iterdir()
    head = r"# launchid \d+\.\d+\.\d+, 20\d\d-\d\d-\d\d: python benchmarks/nothing.py\n"
    assert re.match(head, kept.read_text(encoding="utf-8"))
    assert "exit status" in capsys.readouterr().err
