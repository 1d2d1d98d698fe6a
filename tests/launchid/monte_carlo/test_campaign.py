"""The campaign runner: one table, the same whatever the workers, the chunks, the executor and the interruptions.

A campaign's folder that is not what its definition says is exit status 3 in one line, and what it has stays; one run
at a time writes into it, and a run that is killed leaves no lock.
"""

import csv
import functools
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from test_requirement_folder import files, nominal_of

from launchid.commands.campaign import campaign
from launchid.main import main
from launchid.monte_carlo.campaign import ATTEMPTS, run_campaign
from launchid.monte_carlo.journal import LOCK, locked
from launchid.monte_carlo.requirement.folder import CAMPAIGN, FLIGHTS_FILE, JOURNAL
from sim.errors import InputError
from sim.nominal import Nominal, Offsets, load_nominal


class Point(NamedTuple):
    scenario: str
    seed: int
    delta: float


def points(n: int, scenario: str = "quick") -> list[Point]:
    return [Point(scenario, seed, float(np.random.default_rng(seed).uniform())) for seed in range(n)]


def draw(point: Point) -> dict[str, float | int | str]:
    """A row of numbers that only the job decides, with all that a float can be."""
    rng = np.random.default_rng(point.seed)
    return {"x": rng.standard_normal() * point.delta, "n": np.int64(point.seed), "good": np.bool_(True),
            "odd": [np.nan, np.inf, 1e-310][point.seed % 3], "name": f"a,{point.seed}"}


def fail_at_three(point: Point) -> dict[str, float | int | str]:
    if point.seed % 10 == 3:
        raise ValueError(f"seed {point.seed} is no good\nand more lines")
    return draw(point)


def log_and_draw(folder: Path, point: Point) -> dict[str, float | int | str]:
    """Leave a mark each time that it runs."""
    with (folder / f"{point.seed}").open("a") as file:
        file.write("x")
    return draw(point)


def die_once(folder: Path, point: Point) -> dict[str, float | int | str]:
    """Seed 11 kills its process the first time."""
    mark = folder / "died"
    if point.seed == 11 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return draw(point)


def die_always(point: Point) -> dict[str, float | int | str]:
    if point.seed == 11:
        os.kill(os.getpid(), signal.SIGKILL)
    return draw(point)


def slow(folder: Path, point: Point) -> dict[str, float | int | str]:
    time.sleep(0.02)
    return log_and_draw(folder, point)


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def reference(tmp_path: Path) -> bytes:
    """The table of 50 points without any executor's processes."""
    with ThreadPoolExecutor(1) as executor:
        return run_campaign(points(50), draw, tmp_path / "reference.csv", executor, workers=1).path.read_bytes()


# ---- the table


def test_the_table_has_every_job_in_order_and_reads_back_to_the_bit(tmp_path, reference):
    rows = rows_of(tmp_path / "reference.csv")
    assert list(rows[0]) == ["scenario", "seed", "delta", "x", "n", "good", "odd", "name", "error"]
    for point, row in zip(points(50), rows, strict=True):
        expected = draw(point)
        assert float(row["delta"]) == point.delta and float(row["x"]) == expected["x"]
        assert (row["n"], row["good"], row["name"], row["error"]) == (str(point.seed), "1", expected["name"], "")
        np.testing.assert_equal(float(row["odd"]), expected["odd"])


@pytest.mark.parametrize(("workers", "chunk"), [(1, None), (2, 1), (3, 7), (2, 1000)])
def test_workers_and_chunks_change_no_bit(tmp_path, reference, workers, chunk):
    table = run_campaign(points(50), draw, tmp_path / "t.csv", workers=workers, chunk=chunk)
    assert table.path.read_bytes() == reference and (table.jobs, table.failed) == (50, 0)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["reference.csv", "t.csv"], "no journal left"


def test_jobs_that_raise_are_rows_with_one_line(tmp_path):
    table = run_campaign(points(30), fail_at_three, tmp_path / "t.csv", workers=2)
    failed = [row for row in rows_of(table.path) if row["error"]]
    assert table.failed == 3 and [row["seed"] for row in failed] == ["3", "13", "23"]
    assert failed[0]["error"] == "ValueError: seed 3 is no good" and failed[0]["x"] == ""


@pytest.mark.parametrize(("workers", "chunk"), [(1, 1), (2, 3), (3, 16)])
def test_enough_is_the_first_jobs_whatever_else_was_done(tmp_path, reference, workers, chunk):
    """The table ends where it was said, in the order of the jobs, though others were finished."""
    given: dict[int, object] = {}

    def enough(number: int, outcome: object) -> int | None:
        given[number] = outcome
        return 20 if set(range(20)) <= set(given) else None

    table = run_campaign(points(50), draw, tmp_path / "t.csv", workers=workers, chunk=chunk, enough=enough)
    assert table.jobs == 20 and table.path.read_bytes() == b"".join(reference.splitlines(keepends=True)[:21])
    assert not (tmp_path / "t.csv.journal").exists()


# ---- interruption


class Stop(Exception):
    """An exception in the place of Ctrl-C."""


def interrupted(jobs: list[Point], folder: Path, path: Path, after: int) -> None:
    done = 0

    def progress(n: int) -> None:
        nonlocal done
        done += n
        if done >= after:
            raise Stop

    with pytest.raises(Stop):
        run_campaign(jobs, functools.partial(slow, folder), path, workers=2, chunk=2, progress=progress)


def test_interrupted_and_continued_is_the_same_table_and_repeats_no_finished_job(tmp_path, reference):
    folder, path = tmp_path / "marks", tmp_path / "t.csv"
    folder.mkdir()
    interrupted(points(50), folder, path, 10)
    assert not path.exists()
    journal = tmp_path / "t.csv.journal"
    finished = {int(line[1:line.index(b",")]) for line in journal.read_bytes().splitlines()[1:]}
    assert 10 <= len(finished) < 50
    seen: list[int] = []
    run_campaign(points(50), functools.partial(slow, folder), path, workers=1, chunk=5, progress=seen.append)
    assert path.read_bytes() == reference and not journal.exists()
    assert seen[0] == len(finished) and sum(seen) == 50
    assert all((folder / f"{seed}").read_text() == "x" for seed in finished), "a finished job ran again"


RUNNER = """
import functools, signal, sys
from pathlib import Path
signal.signal(signal.SIGINT, signal.default_int_handler)  # a background shell's children ignore it
sys.path[:0] = {path!r}
from launchid.monte_carlo.campaign import run_campaign
from test_campaign import points, slow
run_campaign(points(50), functools.partial(slow, Path({folder!r})), {table!r}, workers=2, chunk=1)
"""


@pytest.mark.campaign
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_a_killed_runner_is_continued_and_leaves_no_worker(tmp_path, reference, how):
    folder, path = tmp_path / "marks", tmp_path / "t.csv"
    folder.mkdir()
    text = RUNNER.format(path=sys.path, folder=str(folder), table=str(path))
    with subprocess.Popen([sys.executable, "-c", text], stderr=subprocess.PIPE) as process:
        while len(list(folder.iterdir())) < 10 and process.poll() is None:
            time.sleep(0.01)
        process.send_signal(how)
        process.stderr.read()  # ends when the last worker that has it is gone
    assert process.returncode != 0 and not path.exists()
    run_campaign(points(50), functools.partial(slow, folder), path, workers=2)
    assert path.read_bytes() == reference


@pytest.mark.parametrize("torn", [
    b'[49, {"x": 1}]', b"garbage\n",
    *(pytest.param(each, marks=pytest.mark.campaign) for each in (b"[49", b'[49, {"x": 0.1', b"\x00\x00\x00"))])
def test_torn_last_line_is_dropped(tmp_path, reference, torn):
    folder, path = tmp_path / "marks", tmp_path / "t.csv"
    folder.mkdir()
    interrupted(points(50), folder, path, 10)
    with (tmp_path / "t.csv.journal").open("ab") as file:
        file.write(torn)
    run_campaign(points(50), functools.partial(slow, folder), path, workers=2)
    assert path.read_bytes() == reference


def test_another_definition_is_refused(tmp_path):
    folder, path = tmp_path / "marks", tmp_path / "t.csv"
    folder.mkdir()
    interrupted(points(50), folder, path, 10)
    same = {"jobs": points(50), "work": functools.partial(slow, folder), "path": path}
    for other in ({"jobs": points(50, "another")}, {"work": draw}, {"definition": "sigma 0.3"}):
        with pytest.raises(InputError, match="another campaign"):
            run_campaign(**(same | other))


def test_finished_table_is_not_overwritten(tmp_path, reference):
    with pytest.raises(InputError, match="finished"):
        run_campaign(points(50), draw, tmp_path / "reference.csv")


# ---- workers that die


def test_a_killed_process_loses_nothing_and_doubles_nothing(tmp_path, reference):
    table = run_campaign(points(50), functools.partial(die_once, tmp_path), tmp_path / "t.csv", workers=2, chunk=4)
    assert (tmp_path / "died").exists()
    assert table.path.read_bytes() == reference


def test_a_job_that_always_kills_is_found_and_fails_alone(tmp_path):
    table = run_campaign(points(24), die_always, tmp_path / "t.csv", workers=2, chunk=4)
    failed = [row for row in rows_of(table.path) if row["error"]]
    assert [row["seed"] for row in failed] == ["11"]
    assert failed[0]["error"].startswith(f"WorkerDied: {ATTEMPTS} times")


# ---- an engine beyond one machine


@pytest.mark.campaign
def test_dask_worker_killed_in_the_middle_loses_nothing_and_doubles_nothing(tmp_path, reference):
    """Of a real local cluster of three worker processes."""
    distributed = pytest.importorskip("distributed", reason="distributed (extra `cluster`) is not installed")
    folder = tmp_path / "marks"
    folder.mkdir()
    killed: list[int] = []

    def progress(_: int) -> None:
        if not killed and len(list(folder.iterdir())) >= 10:
            os.kill(pids[0], signal.SIGKILL)
            killed.append(pids[0])

    with distributed.LocalCluster(n_workers=3, threads_per_worker=1, processes=True, dashboard_address=None) as made, \
            distributed.Client(made) as client:
        pids = list(client.run(os.getpid).values())
        table = run_campaign(points(50), functools.partial(slow, folder), tmp_path / "t.csv", client.get_executor(),
                             workers=3, chunk=2, progress=progress)
    assert killed and len(pids) == 3
    assert table.path.read_bytes() == reference


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


@pytest.mark.parametrize(("name", "file", "damages", "parts"), [
    ("whole", FLIGHTS_FILE, TABLES, ("whole", "next")), ("stopped", FLIGHTS_FILE, TABLES, ("stopped", "next")),
    ("whole", CAMPAIGN, DEFINITIONS, ("whole",)), ("begun", JOURNAL, JOURNALS, ())])
def test_a_damaged_table_definition_or_journal_is_not_believed(place, capsys, name, file, damages, parts):
    """Exit status 3 where it is judged again, and as a part; nothing in the folder changes."""
    path = place / name / file
    for damage in damaged(path, damages):
        before = files(place / name)
        assert str(path) in refused(capsys, place, *again(place, name)), damage
        if parts:
            assert str(path) in refused(capsys, place, "--merge", *(str(place / part) for part in parts), "--out",
                                        str(place / "merged")), damage
        assert files(place / name) == before and not (place / "merged").exists(), damage


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
