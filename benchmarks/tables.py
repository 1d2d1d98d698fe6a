"""A run of the commands of docs/results.md and keeps what they print, so that the page's figures can be compared with
it.

    python benchmarks/tables.py WORD... [--out tables] [--check]

runs each command of the page that holds a WORD (a benchmark's name, an option), without a WORD says which there are.
What a command prints is kept as OUT/NAME.txt, below a line with version, date and command.  `--check` lists, section by
section, the figures of the page's tables that stand in none of the section's kept outputs.
"""

import argparse
import datetime
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "results.md"
COMMAND = re.compile(r"(?:[A-Z_]+=\S+ )?python benchmarks/(?!tables)[^`#\n]+")
FIGURE = re.compile(r"(?<![\w.])\d[\d,]*\.?\d*(?:e-?\d+)?")


class Section(NamedTuple):
    """One section of the page: its heading, its text, the commands of benchmarks in it."""

    heading: str
    text: str
    commands: list[str]


def sections(page: str) -> list[Section]:
    """The sections of a page that name a benchmark's command."""
    parts = re.split(r"^#+ (.+)$", page, flags=re.MULTILINE)
    made = [Section(heading, text, commands_of(text)) for heading, text in zip(parts[1::2], parts[2::2], strict=True)]
    return [section for section in made if section.commands]


def commands_of(text: str) -> list[str]:
    """The benchmarks' commands of a text, in blocks and between backticks, each once."""
    prose = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    spans = [" ".join(span.split()) for span in re.findall(r"`([^`]+)`", prose)]
    lines = [line for block in re.findall(r"```sh\n(.*?)```", text, flags=re.DOTALL) for line in block.splitlines()]
    return list(dict.fromkeys(match.group().strip() for line in [*lines, *spans] if (match := COMMAND.match(line))))


def file_name(command: str) -> str:
    """A file's name for a command: its words, joined."""
    return re.sub(r"[^\w.=-]+", "_", command.split("benchmarks/", 1)[1]) + ".txt"


def missing(section: Section, printed: str) -> list[str]:
    """The figures in the cells of a section's tables, but for the first column, that are not among the printed numbers:
    equal as numbers, or as per cent, to half of their last digit."""
    known = {value * factor for value in map(number, FIGURE.findall(printed)) for factor in (1.0, 100.0)}
    rows = [line for line in section.text.splitlines() if line.startswith("|") and not line.startswith("|---")]
    figures = [figure for row in rows for cell in row.strip("|").split("|")[1:] for figure in FIGURE.findall(cell)]
    absent = []
    for figure in figures:
        digits, _, exponent = figure.replace(",", "").partition("e")
        half = 0.501 * 10.0**(int(exponent or 0) - len(digits.partition(".")[2]))
        if not any(abs(number(figure) - value) <= half for value in known):
            absent.append(figure)
    return absent


def number(figure: str) -> float:
    """The value of a figure as it is written, commas between thousands."""
    return float(figure.replace(",", ""))


def run(command: str, out: Path) -> bool:
    """Run one command from the project's folder and keep what it prints; whether it ended well."""
    from launchid_core import __version__
    words = command.replace("python ", f"{sys.executable} ", 1)
    print(f"+ {command}", file=sys.stderr, flush=True)
    done = subprocess.run(words, shell=True, cwd=ROOT, capture_output=True, text=True, check=False)
    head = f"# launchid {__version__}, {datetime.date.today().isoformat()}: {command}\n"
    (out / file_name(command)).write_text(head + done.stdout, encoding="utf-8")
    if done.returncode:
        print(f"{command}: exit status {done.returncode}\n{done.stderr[-2000:]}", file=sys.stderr)
    return done.returncode == 0


def main() -> int:
    """Run what the words choose; the exit status."""
    parser = argparse.ArgumentParser(description="Run the commands of docs/results.md and keep what they print.")
    parser.add_argument("words", nargs="*", metavar="WORD", help="run the commands with it (default: list them all)")
    parser.add_argument("--out", type=Path, default=Path("tables"), help="keep the output here (default %(default)s)")
    parser.add_argument("--check", action="store_true", help="list the page's figures that no kept output holds")
    args = parser.parse_args()
    page = sections(PAGE.read_text(encoding="utf-8"))
    if not args.words and not args.check:
        for section in page:
            print(section.heading, *section.commands, sep="\n    ")
        return 0
    args.out.mkdir(parents=True, exist_ok=True)
    every = dict.fromkeys(command for section in page for command in section.commands)
    chosen = [command for command in every if any(word in command for word in args.words)]
    if args.words and not chosen:
        print(f"no command of {PAGE.name} holds {' or '.join(args.words)}", file=sys.stderr)
        return 2
    well = [run(command, args.out) for command in chosen]
    if args.check:
        for section in page:
            kept = [args.out / file_name(command) for command in section.commands]
            if printed := "".join(path.read_text(encoding="utf-8") for path in kept if path.is_file()):
                print(f"{section.heading}: {', '.join(missing(section, printed)) or 'every figure was printed'}")
    return 0 if all(well) else 1


if __name__ == "__main__":
    sys.exit(main())
