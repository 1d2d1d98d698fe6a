"""The pages are as long as a reader bears, say nothing that only developers understand, and every figure stands once.

`python tests/prose.py` prints what is counted here.
"""

import re
from pathlib import Path

import pytest
from every import every
from prose import (
    HISTORY,
    OPENINGS,
    PRIVATE,
    WITHOUT_HISTORY,
    docstrings,
    is_endless,
    is_without_subject,
    pages,
    places,
    vague_names,
)

from benchmarks.tables import COMMAND, figures_of_tables, main, missing, sections

ROOT = Path(__file__).resolve().parents[1]
MOST_LINES = {"README.md": 140, "results.md": 450, "limits.md": 100}
MOST_PLACES = {"developing.md": 1}  # the kernel `asked`; elsewhere none
LEAST_TERMS = 40
STILL_VAGUE = ("sim/diagnosis/", "sim/export_c/", "launchid_core/filter/", "launchid_core/order/")   # it only shrinks
RELEASE = 60                      # lines of the newest release in the changelog, at most
FIGURE = re.compile(r"(?<![\w.#-])\d[\d,]*(?:\.\d+)?")


@pytest.mark.parametrize("name", MOST_LINES)
def test_a_page_is_no_longer_than_a_reader_bears(name):
    (page,) = [page for page in pages(ROOT) if page.name == name]
    assert len(page.read_text(encoding="utf-8").splitlines()) <= MOST_LINES[name]


@pytest.mark.parametrize("page", [page for page in pages(ROOT) if page.name not in WITHOUT_HISTORY],
                         ids=lambda page: page.name)
def test_a_page_says_nothing_that_only_the_developers_understand(page):
    said = places(page, HISTORY) + places(page, PRIVATE)
    assert len(said) <= MOST_PLACES.get(page.name, 0), said


def test_docstrings_have_a_subject():
    """The rule holds for every docstring, public and private, of packages, tests and benchmarks."""
    assert [place for place, text in docstrings(ROOT) if is_without_subject(text)] == []


def test_the_first_sentence_of_a_docstring_ends_soon():
    assert [place for place, text in docstrings(ROOT) if is_endless(text)] == []


def test_names_say_what_they_hold():
    assert [place for place in vague_names(ROOT) if not place[0].startswith(STILL_VAGUE)] == []


@every("text, without", [
    *((f"{word} is left.", True) for words in OPENINGS.values() for word in words.split()),
    ("(n,) [s] of the rows.", True), ("[rad], as declared.", True), ("what is left.", True),
    ("(n,) [s] The times of the rows.", False), ("Offsets of the log.", False), ("Itself a rule.", False),
    ("Whether it is left.", False), ("Write the page.", False), ("theta_ddot = a6 theta.", False)])
def test_an_opening_without_a_subject_is_seen(text, without):
    assert is_without_subject(text) == without


@every("text, endless", [
    ("One sentence.", False), ("One sentence\nof two lines. And more.", False), ("No stop", True),
    ("One sentence\nof three\nlines.", True), ("A version 1.2\nwithout its end", True), ("", True)])
def test_a_first_sentence_without_an_end_is_seen(text, endless):
    assert is_endless(text) == endless


def test_the_glossary_has_the_words_of_the_terminal():
    text = (ROOT / "docs" / "notation.md").read_text(encoding="utf-8")
    words = re.findall(r"^\| ([a-z][\w ,()-]+) \| .{15,} \|$", text.split("## Words")[1], re.MULTILINE)
    assert len(words) >= LEAST_TERMS
    said = ", ".join(words)
    assert [word for word in ("nominal", "window", "tracked", "dominant", "evidence", "nat", "held-out error", "bound",
                              "coverage", "whiteness", "catalogue", "extension") if word not in said] == []


def test_the_newest_release_is_told_in_few_lines():
    releases = re.split(r"^## ", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]
    assert len(releases) >= 2 and len(releases[0].splitlines()) <= RELEASE


# ---- every figure once


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
