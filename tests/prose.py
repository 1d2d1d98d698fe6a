"""The counts of what makes prose hard to read: lines a page, words that only the developers understand, docstrings
without a subject.

`python tests/prose.py [FOLDER]` prints the counts of a checkout; `tests/test_prose.py` holds their limits.
"""

import ast
import re
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

HISTORY = re.compile(r"""
    \b(?:asked|demanded)\b | counted\ (?:once|by\ hand) | \bby\ hand\b
    | \b(?:earlier|first|present|whole|same)?\s?engines?\ (?:before|of|of\ today|was)\b | \b(?:earlier|present)\ engine
    | nothing\ was\ chosen | no\ setting\ (?:was|had) | nothing\ was\ tuned | (?:built|was)\ on\ these\ seeds
    | \bthe\ contract(?:'s)?\b | hostile\ testers? | busy\ (?:machine|cores|2-core) | quieter\ day | other\ jobs
    | \bit\ (?:was|had)\ \d | \d\ before\) | \bbefore,\ (?:it|a|one|on|the)\b | fresh\ seeds? | since\ then""",
    re.IGNORECASE | re.VERBOSE)
PRIVATE = re.compile(r"\bfeign|\bhonest companions?\b|\bthe weather\b|\bweather that\b|\blegacy\b|\bnot told from\b"
                     r"|\bis told (?:to|from|after)\b|\bare told from\b|\bof its own accord\b|\blikes best\b"
                     r"|\beven odds\b|\bsecants\b|\bown placebo\b", re.IGNORECASE)
NO_SUBJECT = re.compile(r"(?:What|Of|It|With|As|None where|Where|Its)\b")
NAMES = ("made", "found", "of", "own", "told")
PACKAGES = ("launchid", "launchid_core", "sim")
WITHOUT_HISTORY = {"CHANGELOG.md"}   # history is this page's subject


def pages(root: Path) -> list[Path]:
    """README, CHANGELOG and the pages of `docs`."""
    return [root / "README.md", root / "CHANGELOG.md", *sorted((root / "docs").glob("*.md"))]


def places(path: Path, pattern: re.Pattern[str]) -> list[tuple[int, str]]:
    """Line number and text of each place of a page where the pattern stands, also across a line's end."""
    text = path.read_text(encoding="utf-8")
    flat = text.replace("\n", " ")
    return [(text.count("\n", 0, match.start()) + 1, match.group()) for match in pattern.finditer(flat)]


def docstrings(root: Path) -> Iterator[tuple[str, str]]:
    """Place and text of each docstring of the packages."""
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                    if (text := ast.get_docstring(node)) is not None:
                        line = getattr(node, "lineno", 1)
                        yield f"{path.relative_to(root).as_posix()}:{line}", text


def names(root: Path) -> Counter[str]:
    """The number of times that each of the vague names is bound in the packages."""
    counts: Counter[str] = Counter()
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                    counts[node.id] += node.id in NAMES
                elif isinstance(node, ast.arg):
                    counts[node.arg] += node.arg in NAMES
    return +counts


def main(root: Path) -> None:
    """Print the counts."""
    print("| page | lines | only for developers | private words |\n|---|---|---|---|")
    sums = [0, 0, 0]
    for path in pages(root):
        lines = path.read_text(encoding="utf-8").splitlines()
        row = [len(lines), len(places(path, HISTORY)), len(places(path, PRIVATE))]
        print(f"| {path.name} | {row[0]} | {row[1]} | {row[2]} |")
        if path.name not in WITHOUT_HISTORY:
            sums = [a + b for a, b in zip(sums, row, strict=True)]
    print(f"| all but the changelog | {sums[0]} | {sums[1]} | {sums[2]} |\n")
    every = list(docstrings(root))
    without = [place for place, text in every if NO_SUBJECT.match(text)]
    print(f"docstrings without a subject: {len(without)} of {len(every)}")
    by_folder = Counter(place.split(":")[0].rsplit("/", 1)[0].split("/")[0] for place in without)
    print("  " + ", ".join(f"{name} {count}" for name, count in by_folder.most_common()))
    print("vague names bound: " + ", ".join(f"{name} {count}" for name, count in names(root).most_common()))


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
