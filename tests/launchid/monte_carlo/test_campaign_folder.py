"""A campaign's folder that is not what its definition says is exit status 3 in one line, and what it has stays; one run
at a time writes into it, and a run that is killed leaves no lock."""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from test_requirement_folder import files, nominal_of

from launchid.cli.main import main
from launchid.commands.campaign import campaign
from launchid.monte_carlo.journal import LOCK, locked
from launchid.monte_carlo.requirement.folder import CAMPAIGN, FLIGHTS_FILE, JOURNAL
from sim.nominal import Nominal, Offsets, load_nominal

ROOT = Path(__file__).resolve().parents[3]
N = 30
ASKED = "lost<0.2@0.9"   # decided by the 18th flight without a failure
Damage = Callable[[bytes], bytes]


def small(folder: Path, duration: float = 0.1) -> Nominal:
    return nominal_of(folder, duration, offsets=Offsets(moment=1e-3))


@pytest.fixture(scope="module")
def flown(tmp_path_factory) -> Path:
    """A folder with the nominal and four campaigns: one that is whole, one that stopped, one that was interrupted, and
    the part after the first."""
    folder = tmp_path_factory.mktemp("flown")
    nominal = small(folder)
    assert campaign(nominal, out=folder / "whole", flights=N, workers=1).report["lost"] == 0
    stopped = campaign(nominal, out=folder / "stopped", flights=N, requirement=ASKED, workers=1)
    assert stopped.verdict == "met" and 8 < stopped.report["flown"] < N
    campaign(nominal, out=folder / "next", flights=N, seed=N, workers=1)

    def stop(newly: int) -> None:
        if newly:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        campaign(nominal, out=folder / "begun", flights=N, workers=1, progress=stop)
    assert (folder / "begun" / JOURNAL).is_file()
    return folder


@pytest.fixture
def place(flown, tmp_path) -> Path:
    """A copy of it, to be damaged."""
    shutil.copytree(flown, tmp_path, dirs_exist_ok=True)
    return tmp_path


def refused(capsys, place: Path, *words: str) -> str:
    """The one line of a campaign that is exit status 3."""
    assert main(["campaign", str(place / "n.toml"), "--workers", "1", *words]) == 3
    said = capsys.readouterr()
    (line,) = said.err.splitlines()
    assert said.out == "" and line.startswith("launchid: ")
    return line


def again(place: Path, name: str) -> list[str]:
    """The words of the campaign that was flown there."""
    return ["--flights", str(N), "--out", str(place / name), *(["--requirement", ASKED] if name == "stopped" else [])]


def damaged(path: Path, damages: dict[str, Damage]) -> Iterator[str]:
    """The names of the damages, while the file has each of them."""
    whole = path.read_bytes()
    for name, damage in damages.items():
        path.write_bytes(damage(whole))
        assert path.read_bytes() != whole, name
        yield name
    path.write_bytes(whole)


# ---- flights that the definition does not say


def lines(change: Callable[[list[bytes]], list[bytes]]) -> Damage:
    return lambda data: b"".join(change(data.splitlines(keepends=True)))


def cell(row: int, column: int, text: bytes) -> Damage:
    """Another text in a cell; row 1 is the first flight."""
    def change(data: list[bytes]) -> list[bytes]:
        cells = data[row].rstrip(b"\n").split(b",")
        cells[column] = text
        return [*data[:row], b",".join(cells) + b"\n", *data[row + 1:]]
    return lines(change)


TABLES: dict[str, Damage] = {
    "emptied": lambda data: b"",
    "its header alone": lines(lambda rows: rows[:1]),
    "one copy of a row more": lines(lambda rows: [*rows, rows[-1]]),
    "a row in the place of another": lines(lambda rows: [*rows[:5], rows[4], *rows[6:]]),
    "its first row missing": lines(lambda rows: rows[:1] + rows[2:]),
    "its last row torn": lambda data: data[:-40],
    "another seed's vehicle": cell(4, 1, b"0.5"),
    "lost twice": cell(4, 3, b"2"),
    "a magnitude below 0": cell(4, 6, b"-0.1"),
    "a word": cell(4, 6, b"high"),
    "a byte 0xff": cell(4, 6, b"\xff"),
    "a cell too many": cell(4, 6, b"0.1,0.1"),
    "a column that no flight has": cell(0, 10, b"merit"),
    "an archive": lambda data: b"\x1f\x8b" + data,
}


@pytest.mark.parametrize("name", ["whole", "stopped"])
def test_a_finished_table_is_not_believed(place, capsys, name):
    """Exit status 3 where it is judged again, and as a part; nothing in the folder changes."""
    table = place / name / FLIGHTS_FILE
    for damage in damaged(table, TABLES):
        before = files(place / name)
        assert str(table) in refused(capsys, place, *again(place, name)), damage
        assert str(table) in refused(capsys, place, "--merge", str(place / name), str(place / "next"),
                                     "--out", str(place / "merged")), damage
        assert files(place / name) == before and not (place / "merged").exists(), damage


def test_a_table_that_stopped_ends_where_the_requirement_was_decided(place, flown, capsys):
    """No row earlier, and not a row later but with all of them, as a merged table has."""
    nominal = load_nominal(place / "n.toml")
    table = place / "stopped" / FLIGHTS_FILE
    whole = (flown / "whole" / FLIGHTS_FILE).read_bytes().splitlines(keepends=True)
    decided = table.read_bytes().count(b"\n") - 1
    for rows in range(N + 1):
        table.write_bytes(b"".join(whole[:rows + 1]))
        if rows not in (decided, N):
            assert f"{rows} of {N} flights" in refused(capsys, place, *again(place, "stopped"))
            continue
        made = campaign(nominal, out=place / "stopped", flights=N, requirement=ASKED)
        assert (made.verdict, made.report["flown"], made.report["lost"]) == ("met", rows, 0)
        assert made.report["results"][0]["decided_at"] == decided


# ---- damaged definitions and journals


def replaced(key: str, value: object) -> Damage:
    return lambda data: json.dumps({**json.loads(data), key: value}).encode()


DEEP = b"[" * 100_000 + b"]" * 100_000
DEFINITIONS: dict[str, Damage] = {
    "nested": lambda data: DEEP,
    "a number of 5000 digits": lambda data: data.replace(b'"seed": 0', b'"seed": ' + b"9" * 5000),
    "a number of 400 digits": lambda data: data.replace(b'"seed": 0', b'"seed": ' + b"9" * 400),
    "no flights": replaced("flights", 0), "half a seed": replaced("seed", 0.5),
    "requirements of numbers": replaced("requirements", [[[1]]]), "an empty map": lambda data: b"{}",
    "cut": lambda data: data[:-9], "no UTF-8": lambda data: b"\xff" + data,
}


def test_a_damaged_definition_is_one_line(place, capsys):
    path = place / "whole" / CAMPAIGN
    for damage in damaged(path, DEFINITIONS):
        before = files(place / "whole")
        assert str(path) in refused(capsys, place, *again(place, "whole")), damage
        assert str(path) in refused(capsys, place, "--merge", str(place / "whole"), "--out",
                                    str(place / "merged")), damage
        assert files(place / "whole") == before and not (place / "merged").exists(), damage


def journal_line(row: object, at: int = 2) -> Damage:
    return lines(lambda rows: [*rows[:at], json.dumps(row).encode() + b"\n", *rows[at:]])


def second(text: bytes) -> Damage:
    """Another text where the first flight is."""
    return lines(lambda rows: [rows[0], text + b"\n", *rows[2:]])


ROW = {"lost": 0, "end": 0.1, "max_theta_error": 0.1, "max_theta_dot": 0.1, "max_alpha": 0.1, "max_beta": 0.1,
       "max_beta_rate": 0.1}
JOURNALS: dict[str, Damage] = {
    "nested": lambda data: DEEP + b"\n", "rubbish": second(b"\xff\xfe"),
    "a job alone": second(b"[0]"), "a job that there is not": journal_line([N, ROW]),
    "a list for a row": journal_line([0, [1]]),
    "a row of something else": journal_line([0, {"x": 1}], 1),
    "lost twice": journal_line([0, {**ROW, "lost": 2}], 1),
    "a column twice": journal_line([0, {**ROW, "seed": 7}], 1),
    "another campaign's": lambda data: data.replace(b"launchid campaign", b"launchid champagne"),
    "more jobs": lines(lambda rows: [rows[0].replace(b", 30]", b", 31]"), *rows[1:]]),
}


def test_a_damaged_journal_is_one_line(place, capsys):
    path = place / "begun" / JOURNAL
    for damage in damaged(path, JOURNALS):
        before = files(place / "begun")
        assert str(path) in refused(capsys, place, *again(place, "begun")), damage
        assert files(place / "begun") == before, damage


# ---- one run at a time


def test_a_folder_in_use_is_one_line_for_each_who_would_write(place, capsys):
    for name, words in (("whole", again(place, "whole")), ("begun", again(place, "begun")),
                        ("new", again(place, "new")), ("new", ["--merge", str(place / "whole"), "--out",
                                                               str(place / "new")])):
        (place / name).mkdir(exist_ok=True)
        before = files(place / name)
        with locked(place / name):
            assert refused(capsys, place, *words) == (
                f"launchid: {place / name}: another run is writing into this folder; expected its end, or another "
                "folder")
            assert files(place / name) == {**before, LOCK: b""}
        assert files(place / name) == before, "the lock's file goes with the run"


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_a_second_run_is_refused_and_a_killed_one_leaves_no_lock(tmp_path, capsys):
    """The run is killed with its worker alive, which goes a second later: the lock is not the worker's."""
    nominal = small(tmp_path, 10.0)
    words = ["campaign", str(tmp_path / "n.toml"), "--flights", "150", "--workers", "1", "--out", str(tmp_path / "out")]
    journal = tmp_path / "out" / JOURNAL
    with subprocess.Popen([sys.executable, "-m", "sim", *words], cwd=ROOT, stderr=subprocess.DEVNULL) as process:
        while process.poll() is None and not (journal.exists() and journal.read_bytes().count(b"\n") > 10):
            time.sleep(0.01)
        assert main(words) == 3
        assert "another run is writing into this folder" in capsys.readouterr().err
        process.kill()
    assert (tmp_path / "out" / LOCK).exists() and journal.exists()
    seen: list[int] = []
    made = campaign(nominal, out=tmp_path / "out", flights=150, workers=1, progress=seen.append)
    assert made.report["flown"] == 150 and seen[0] >= 10, "finished flights are kept"
    assert set(files(tmp_path / "out")) == {CAMPAIGN, FLIGHTS_FILE, "verdict.json"}
