"""The counts of what makes prose hard to read: lines a page, words that only the developers understand, docstrings
without a subject.

`python tests/prose.py [FOLDER]` prints the counts of a checkout; `tests/test_prose.py` holds their limits.
"""

import ast
import functools
import re
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
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
NAMES = ("made", "found", "of", "own", "told")
PACKAGES = ("launchid", "launchid_core", "sim")
FOLDERS = (*PACKAGES, "tests", "benchmarks")
OPENINGS = {
    "a question or a relative clause": "What Which Where When Who Whose How Why Wherever Whatever Whichever However",
    "a pronoun of nothing": "It Its They Their Them Those These That",
    "a preposition": "Of With Without As By At From In On For To After Before Between Against Within Beside About "
                     "Above Below Along During Behind Beyond Into Since Until Up Per",
    "a conjunction or an adverb": "And Or But So Not Nor Also Only Once Then Else Here If Because Meanwhile Elsewhere",
    "a verb without subject": "Is Are Was Has Does Did Adds Gives Takes Makes Says Tells Returns Prints Writes Reads "
                              "Sends Keeps Serves Flies Leaves",
    "a case, not the thing": "None Nobody Other",
}
OPENING = re.compile(rf"(?:{'|'.join(' '.join(OPENINGS.values()).split())})(?![\w-])", re.IGNORECASE)
UNIT = r"\[(?:rad|s|1|nats?|rows|periods?|bytes|ns)\b[^]]*\]"
SHAPE = r"\([^()]*,\)|\((?:\b[a-z]\b|\d+[a-z]?|[-+ ,*/])+\)"
QUANTITY = re.compile(rf"(?:(?:{UNIT}|{SHAPE}),?\s+)*")     # before the first word; a tuple of names is a subject
SENTENCE = re.compile(r"[.?](?:\s|$)")
FIRST_LINES = 2                      # the first sentence of a docstring ends within these
WITHOUT_HISTORY = {"CHANGELOG.md"}   # history is this page's subject


def pages(root: Path) -> list[Path]:
    """README, CHANGELOG and the pages of `docs`."""
    return [root / "README.md", root / "CHANGELOG.md", *sorted((root / "docs").glob("*.md"))]


def places(path: Path, pattern: re.Pattern[str]) -> list[tuple[int, str]]:
    """Line number and text of each place of a page where the pattern stands, also across a line's end."""
    text = path.read_text(encoding="utf-8")
    flat = text.replace("\n", " ")
    return [(text.count("\n", 0, match.start()) + 1, match.group()) for match in pattern.finditer(flat)]


def is_without_subject(text: str) -> bool:
    """Whether a docstring opens with a word of OPENINGS, behind a shape or a unit if there is one.

    `Whether` is allowed: so begins what gives a truth value.  A verb in the imperative has its subject.
    """
    quantity = QUANTITY.match(text)
    return OPENING.match(text[quantity.end() if quantity else 0:]) is not None


def is_endless(text: str) -> bool:
    """Whether the first sentence of a docstring does not end within FIRST_LINES."""
    return SENTENCE.search("\n".join(text.splitlines()[:FIRST_LINES])) is None


@functools.cache
def nodes(path: Path) -> tuple[ast.AST, ...]:
    """All nodes of a file's syntax tree, parsed once."""
    return tuple(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


def docstrings(root: Path, folders: Sequence[str] = FOLDERS) -> Iterator[tuple[str, str]]:
    """Place and text of each docstring in the folders."""
    for folder in folders:
        for path in sorted((root / folder).rglob("*.py")):
            for node in nodes(path):
                if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                    if (text := ast.get_docstring(node)) is not None:
                        line = getattr(node, "lineno", 1)
                        yield f"{path.relative_to(root).as_posix()}:{line}", text


def vague_names(root: Path) -> Iterator[tuple[str, str]]:
    """Place and name of each binding of a vague name in the packages, but for `of` of the public `summary(of)`."""
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            public = {id(arg) for node in nodes(path) if isinstance(node, ast.FunctionDef) and node.name == "summary"
                      for arg in node.args.args}
            for node in nodes(path):
                name = node.id if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) else \
                    node.arg if isinstance(node, ast.arg) and id(node) not in public else ""
                if name in NAMES:
                    yield f"{path.relative_to(root).as_posix()}:{node.lineno}", name


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
    without = [place for place, text in every if is_without_subject(text)]
    print(f"docstrings without a subject: {len(without)} of {len(every)}; "
          f"whose first sentence does not end in {FIRST_LINES} lines: {sum(is_endless(text) for _, text in every)}")
    by_folder = Counter(place.split(":")[0].rsplit("/", 1)[0].split("/")[0] for place in without)
    print("  " + ", ".join(f"{name} {count}" for name, count in by_folder.most_common()))
    counts = Counter(name for _, name in vague_names(root))
    print("vague names bound: " + ", ".join(f"{name} {count}" for name, count in counts.most_common()))


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "."))
