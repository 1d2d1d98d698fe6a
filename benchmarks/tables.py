"""Run the commands of docs/results.md and keep what they print, to compare the page's figures with it.

    python benchmarks/tables.py WORD... [--out tables]

runs each command of the page that holds a WORD (a benchmark's name, an option), without a WORD says which there are.
What a command prints is kept as OUT/NAME.txt, below a line with version, date and command.
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


class Section(NamedTuple):
    """A section of the page: its heading, its text, the commands of benchmarks in it."""

    heading: str
    text: str
    commands: list[str]


def sections(page: str) -> list[Section]:
    """Return the sections of a page that name a benchmark's command."""
    parts = re.split(r"^#+ (.+)$", page, flags=re.MULTILINE)
    made = [Section(heading, text, commands_of(text)) for heading, text in zip(parts[1::2], parts[2::2], strict=True)]
    return [section for section in made if section.commands]


def commands_of(text: str) -> list[str]:
    """Return the benchmarks' commands of a text, in blocks and between backticks, each once."""
    prose = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    spans = [" ".join(span.split()) for span in re.findall(r"`([^`]+)`", prose)]
    lines = [line for block in re.findall(r"```sh\n(.*?)```", text, flags=re.DOTALL) for line in block.splitlines()]
    return list(dict.fromkeys(match.group().strip() for line in [*lines, *spans] if (match := COMMAND.match(line))))


def file_name(command: str) -> str:
    """Return the file name for a command: its words, joined."""
    return re.sub(r"[^\w.=-]+", "_", command.split("benchmarks/", 1)[1]) + ".txt"


def run(command: str, out: Path) -> bool:
    """Run one command from the project's folder, write what it prints to `out`; return whether it ended well."""
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
    """Run the commands that hold a given word, or list all; return the exit status."""
    parser = argparse.ArgumentParser(description="Run the commands of docs/results.md and keep what they print.")
    parser.add_argument("words", nargs="*", metavar="WORD", help="run the commands with it (default: list them all)")
    parser.add_argument("--out", type=Path, default=Path("tables"), help="keep the output here (default %(default)s)")
    args = parser.parse_args()
    page = sections(PAGE.read_text(encoding="utf-8"))
    if not args.words:
        for section in page:
            print(section.heading, *section.commands, sep="\n    ")
        return 0
    args.out.mkdir(parents=True, exist_ok=True)
    every = dict.fromkeys(command for section in page for command in section.commands)
    chosen = [command for command in every if any(word in command for word in args.words)]
    if not chosen:
        print(f"no command of {PAGE.name} holds {' or '.join(args.words)}", file=sys.stderr)
        return 2
    return int(not all([run(command, args.out) for command in chosen]))


if __name__ == "__main__":
    sys.exit(main())
