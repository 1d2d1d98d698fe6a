"""Every command of the README and the pages runs as it stands there, in an empty folder, one after the other.

Quick ones of the README in every run, in this process; with `-m campaign` all of them, by a shell.  What a page
shows as a file (a block whose first line is `# NAME`) is written beforehand, and so are the logs that it presumes.
"""

import functools
import itertools
import math
import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hobby_rocket import Rocket, as_hobby_csv, fly

import launchid
from launchid.main import main

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
USAGE = re.compile(r"\[OPTION\.\.\.\]|(?:^|[ =])[A-Z]+(?:\.\w+)?(?: |$)|^#SBATCH|\$SLURM")  # a form, no command
ELSEWHERE = {   # what begins so is run elsewhere, or is no command of this project; why
    "python3 -m venv": "`.ci/run` runs the README's test command in a fresh environment",
    ". .venv/bin/activate": "the same", "npm pack": "renews a library by hand", "eval ": "a shell's profile",
    "some_program": "stands for the reader's own", "socat": "another project's", "#!/bin/sh": "a job of a cluster",
    "N=": "the same", "launchid watch udp": "waits for a sender", "launchid watch tcp": "waits for a sender",
    "launchid watch - ": "waits for a writer",
    "python benchmarks/real_suite.py": "needs logs that are not shipped",
    "launchid campaign vega_like --merge": "merges what a cluster's jobs wrote"}
QUICK = ("simulate", "identify", "uncertainty", "effects", "convert")  # a second or so each, kernels being compiled
WRITES = ("--out", "--json", "--plot", "--resid", "--report")
ENDLESS = "launchid watch"       # without --once it ends by Ctrl-C
PATIENCE = 30.0                  # s that one is watched
INTERRUPTED = 130
LONGEST = 6 * 3600.0             # s of a command: a benchmark's whole campaign
FOREIGN = "time_ms,pitch_deg,pitch_rate_deg,nozzle_deg,command_deg"


def commands(page: Path) -> list[str]:
    """The commands of a page's shell blocks, examples and tables of commands, comments taken off."""
    text = page.read_text(encoding="utf-8")
    lines = [line for kind, block in BLOCK.findall(text) if kind == "sh" for line in block.splitlines()]
    lines += re.findall(r"^(?:Example: `|\| `(?=launchid ))(.+?)`(?: \||$)", text, re.MULTILINE)
    plain = (re.sub(r"\s+#(?!SBATCH).*| &$", "", line).strip() for line in lines)
    return [line for line in plain if line and not USAGE.search(line) and not line.startswith(tuple(ELSEWHERE))]


def inputs_of(words: list[str]) -> set[str]:
    """The words that may be files a command reads."""
    return {word.split("/")[0] for k, word in enumerate(words) if words[k - 1] not in WRITES}


def outputs_of(words: list[str]) -> set[str]:
    """The files and folders that a command writes."""
    return {word for option, word in itertools.pairwise(words) if option in WRITES}


def quick(lines: list[str]) -> Iterator[list[str]]:
    """The words of the quick commands, but of none that reads what a long one wrote."""
    unwritten: set[str] = set()
    for line in lines:
        words = shlex.split(line)
        if words[0] == "launchid" and words[1] in QUICK and not inputs_of(words) & unwritten and "|" not in words:
            yield words[1:]
        else:
            unwritten |= outputs_of(words)


def written_by_the_page(page: Path, folder: Path) -> None:
    """Write the files that a page shows."""
    for _, block in BLOCK.findall(page.read_text(encoding="utf-8")):
        if name := re.match(r"# (\w+\.toml)\n", block):
            (folder / name[1]).write_text(block, encoding="utf-8")


@functools.cache
def flight(nominal: str, seed: int = 3) -> Any:
    """A flight of a built-in nominal, flown once."""
    return launchid.simulate(nominal, seed=seed)


def presumed(lines: list[str], folder: Path) -> None:
    """Write what the commands read and no command of the page wrote before: logs of `vega_like`, a log in degrees."""
    known = {path.name for path in folder.iterdir()}
    for line in lines:
        words = shlex.split(line)
        for word in inputs_of(words) - known:
            if word == "degrees.csv":
                in_degrees(folder / word)
            elif re.fullmatch(r"rocket\d?\.csv", word):
                number = int(re.sub(r"\D", "", word) or 1)
                (folder / word).write_text(as_hobby_csv(fly(Rocket(), 10 + number)), encoding="utf-8")
            elif word.endswith(".csv"):
                seed = int(re.sub(r"\D", "", word) or 3)  # flight1.csv and flight2.csv are two flights
                flight("constant" if "constant" in words else "vega_like", seed).write(folder / word)
            elif word.endswith((".ulg", ".toml")):
                stand_in(folder, word)
        known |= outputs_of(words) | {path.name for path in folder.iterdir()}


def in_degrees(path: Path) -> None:
    """A flight as the recipe for other units has it: milliseconds, degrees, the nozzle's sign reversed."""
    log = flight("constant").log
    degree = math.degrees(1.0)
    columns = [1e3 * log.t, degree * log.theta, degree * log.theta_dot, -degree * log.beta, -degree * log.beta_cmd]
    rows = (",".join(map(repr, map(float, row))) for row in zip(*columns, strict=True))
    path.write_text("\n".join([FOREIGN, *rows]) + "\n", encoding="utf-8")


def stand_in(folder: Path, word: str) -> None:
    """A flight in the place of a PX4 log, with its map; a nominal by another name."""
    if word.endswith(".ulg"):
        flight("vega_like").write(folder / word)
    elif word in ("px4.toml", "ours.toml"):
        names = ("theta", "theta_dot", "beta", "beta_cmd")
        columns = "".join(f"[columns.{name}]\nfrom = \"{name}\"\n" for name in names)
        (folder / word).write_text("[time]\nname = \"t\"\nunit = \"s\"\n" + columns, encoding="utf-8")
    else:
        launchid.load_nominal("vega_like").write(folder / word)


def prepared(page: Path, folder: Path) -> list[str]:
    """A page's commands, in a folder in which they can run."""
    lines = commands(page)
    written_by_the_page(page, folder)
    presumed(lines, folder)
    return lines


def test_commands_are_collected():
    lines = {page.name: commands(page) for page in PAGES}
    assert "launchid diagnose flight.csv vega_like --report report" in lines["start.md"]
    assert {"python benchmarks/rates.py", "launchid reproduce"} <= set(lines["results.md"])
    assert len(lines["howto.md"]) >= 12 and len(lines["commands.md"]) >= 13 and len(lines["README.md"]) >= 4


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT", "0") != "0", reason="minutes without compiled kernels")
def test_the_quick_commands_of_the_readme_run_as_written(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for words in quick(prepared(ROOT / "README.md", tmp_path)):
        assert main(words) == 0, f"launchid {shlex.join(words)}: {capsys.readouterr().err}"
        assert all((tmp_path / name).exists() for name in outputs_of(words) - {"-"})


# ---- all of them


def shell(line: str, folder: Path) -> int:
    """Run a line by a shell, `launchid` and `python` being this checkout's; the exit status."""
    (folder / "bin").mkdir(exist_ok=True)
    for name, words in (("launchid", f"{sys.executable} -m sim"), ("python", sys.executable),
                        ("pytest", f"{sys.executable} -m pytest")):
        (folder / "bin" / name).write_text(f'#!/bin/sh\nexec {words} "$@"\n', encoding="utf-8")
        (folder / "bin" / name).chmod(0o755)
    for name in ("benchmarks", "tests", "docs", "sim", "launchid_core"):
        if not (folder / name).exists():
            (folder / name).symlink_to(ROOT / name)
    env = os.environ | {"PATH": f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
    with (folder / "stderr").open("w", encoding="utf-8") as said, \
            (folder / "printed").open("a", encoding="utf-8") as printed, \
            subprocess.Popen(["bash", "-c", line], cwd=folder, env=env, stdout=printed, stderr=said,
                             start_new_session=True) as process:
        endless = line.startswith(ENDLESS) and "--once" not in line
        try:
            return process.wait(PATIENCE if endless else LONGEST)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGINT if endless else signal.SIGKILL)
            status = process.wait(PATIENCE)
            return 0 if endless and status in (INTERRUPTED, -signal.SIGINT) else status or 1


def fails(lines: list[str], folder: Path) -> list[str]:
    """The lines whose exit status is not 0, each with the end of what it said."""
    said = folder / "stderr"
    return [f"{line}: {said.read_text(encoding='utf-8')[-800:]}" for line in lines if shell(line, folder)]


def is_benchmark(line: str) -> bool:
    """Whether a command runs for hours, or anew what another test is."""
    return "benchmarks/" in line or "pytest" in line


@pytest.mark.campaign
@pytest.mark.parametrize("page", [page for page in PAGES if commands(page)], ids=lambda page: page.name)
def test_every_command_of_a_page_runs_as_written(page, tmp_path):
    assert fails([line for line in prepared(page, tmp_path) if not is_benchmark(line)], tmp_path) == []


def numbers_and_words(line: str) -> tuple[str, list[float]]:
    """A line with # for each number, and the numbers."""
    number = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?")
    return " ".join(number.sub("#", line).split()), [float(x) for x in number.findall(line)]


def is_printed(line: str, printed: list[tuple[str, list[float]]]) -> bool:
    """Whether a line was printed, with numbers that differ by a tenth at most."""
    words, numbers = numbers_and_words(line)
    return any(words == there and all(abs(x - y) <= 0.1 * abs(x) + 0.01 for x, y in zip(numbers, of, strict=True))
               for there, of in printed)


@pytest.mark.campaign
def test_the_start_page_shows_what_its_commands_print(tmp_path):
    """Its commands run as written, and print the lines that the page shows (`...`: some are left out)."""
    page, said = ROOT / "docs" / "start.md", list[str]()
    for line in prepared(page, tmp_path):
        assert shell(line, tmp_path) == 0, line
        said += (tmp_path / "stderr").read_text(encoding="utf-8").splitlines()
    said += (tmp_path / "printed").read_text(encoding="utf-8").splitlines()
    printed = [numbers_and_words(line) for line in said]
    shown = [line for kind, block in BLOCK.findall(page.read_text(encoding="utf-8")) if not kind
             for line in block.splitlines() if line != "..." and not block.startswith("time_ms")]
    assert len(shown) > 10 and [line for line in shown if not is_printed(line, printed)] == []
