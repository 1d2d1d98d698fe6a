"""The campaign runner: one table, the same whatever the workers, the chunks, the executor and the interruptions."""

import csv
import functools
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from launchid.monte_carlo.campaign import ATTEMPTS, Job, draw_jobs, run_campaign
from sim.errors import InputError, UsageError


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


def test_a_seed_draws_the_same_delta_in_every_scenario_and_stays_in_the_box():
    box, loss = draw_jobs("constant", "box", range(300)), draw_jobs("constant", "k1-loss", range(300))
    assert [job[2:] for job in box] == [job[2:] for job in loss] and isinstance(box[0], Job)
    delta = np.array([job[3:] for job in box])
    assert np.all(np.abs(delta) <= 1.0) and np.all(np.abs(delta.mean(axis=0)) < 0.1)


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


def test_what_was_enough_before_a_kill_is_enough_after_it(tmp_path, reference):
    """The journal has all that is needed: nothing runs again."""
    folder, path = tmp_path / "marks", tmp_path / "t.csv"
    folder.mkdir()
    interrupted(points(50), folder, path, 30)
    marks = len(list(folder.iterdir()))
    given: set[int] = set()

    def enough(number: int, _: object) -> int | None:
        given.add(number)
        return 10 if set(range(10)) <= given else None

    run_campaign(points(50), functools.partial(slow, folder), path, workers=2, enough=enough)
    assert path.read_bytes() == b"".join(reference.splitlines(keepends=True)[:11])
    assert len(list(folder.iterdir())) == marks


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


@pytest.mark.parametrize("how", [signal.SIGKILL, pytest.param(signal.SIGINT, marks=pytest.mark.campaign)])
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


@pytest.mark.parametrize("other", ["jobs", "work", "options"])
def test_another_definition_is_refused(tmp_path, other):
    folder, path = tmp_path / "marks", tmp_path / "t.csv"
    folder.mkdir()
    interrupted(points(50), folder, path, 10)
    jobs = points(50, "another") if other == "jobs" else points(50)
    work = draw if other == "work" else functools.partial(slow, folder)
    with pytest.raises(InputError, match="another campaign"):
        run_campaign(jobs, work, path, definition="sigma 0.3" if other == "options" else "")


def test_finished_table_is_not_overwritten(tmp_path, reference):
    with pytest.raises(InputError, match="finished"):
        run_campaign(points(50), draw, tmp_path / "reference.csv")


@pytest.mark.parametrize("wrong", [{"workers": -1}, {"chunk": 0}])
def test_wrong_numbers_are_refused(tmp_path, wrong):
    with pytest.raises(UsageError):
        run_campaign(points(1), draw, tmp_path / "t.csv", **wrong)
    with pytest.raises(UsageError, match="no jobs"):
        run_campaign([], draw, tmp_path / "t.csv")


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


@pytest.fixture
def cluster() -> Iterator[object]:
    """A real local cluster of three worker processes."""
    distributed = pytest.importorskip("distributed", reason="distributed (extra `cluster`) is not installed")
    with distributed.LocalCluster(n_workers=3, threads_per_worker=1, processes=True, dashboard_address=None) as made, \
            distributed.Client(made) as client:
        yield client


@pytest.mark.campaign
def test_dask_worker_killed_in_the_middle_loses_nothing_and_doubles_nothing(tmp_path, reference, cluster):
    folder = tmp_path / "marks"
    folder.mkdir()
    pids = list(cluster.run(os.getpid).values())
    killed = []

    def progress(_: int) -> None:
        if not killed and len(list(folder.iterdir())) >= 10:
            os.kill(pids[0], signal.SIGKILL)
            killed.append(pids[0])

    table = run_campaign(points(50), functools.partial(slow, folder), tmp_path / "t.csv", cluster.get_executor(),
                         workers=3, chunk=2, progress=progress)
    assert killed and len(pids) == 3
    assert table.path.read_bytes() == reference
