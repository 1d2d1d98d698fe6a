"""A campaign's journal on disk: a line per finished job, appended while it runs, and the table made from it at the end.

The first line identifies the campaign (a hash) and its number of jobs; each other is `[job, row]`, the row an
object of plain values, or `[job, "error"]`.  JSON with Python's shortest floats, so that what is read back has the
same bits.  A line counts once its newline is there: the last one, torn by a kill, is cut off when the journal is
opened again.  A job that stands twice (a worker that was thought dead and was not) counts once, the first.  Whatever
else stands there is an InputError that names the line.

A folder is locked by the system, on one file in it: however a run ends, it holds nothing afterwards, and the file that
a killed run left is taken over.  Where the file system has no locks there is none.
"""

import contextlib
import csv
import json
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from sim.errors import InputError
from sim.files import atomic_path

Value = float | int | str
Row = dict[str, Value]
Outcome = Row | str   # of a job: its row, or the one line of its error

JOURNAL_FORMAT = "launchid campaign 1"
ERROR_COLUMN = "error"  # the table's last column: empty, or why the job has no row
JOURNAL_LINE = 1 << 24  # bytes of a line: a row has a few hundred


class Journal:
    """A campaign's finished jobs on disk: `done[job]` is 1 for each; `append` adds more.

    Opening an existing file continues it; InputError if it is another campaign's or cannot be used.
    """

    def __init__(self, path: Path, definition: str, jobs: int) -> None:
        self.path = path
        self.done = bytearray(jobs)
        header = [JOURNAL_FORMAT, definition, jobs]
        try:
            whole = self._read(header) if path.exists() else 0
            self._file = path.open("ab")
            self._file.truncate(whole)
        except OSError as error:
            raise InputError(f"{path}: journal cannot be used ({error.strerror})") from None
        if whole == 0:
            self._write([header])

    def _read(self, header: list[Any]) -> int:
        """Mark the jobs in the file as done; return the number of bytes of its whole lines."""
        whole = 0
        for number, end, value in read_lines(self.path):
            if number == 1 and (not isinstance(value, list) or value != header):
                raise InputError(f"{self.path}: the journal of another campaign (other jobs, work or options): finish "
                                 "that one, or remove this file")
            if number > 1:
                self.done[_job(self.path, number, value, len(self.done))] = 1
            whole = end
        return whole

    def _write(self, lines: Iterable[Any]) -> None:
        self._file.write("".join(json.dumps(line) + "\n" for line in lines).encode())
        self._file.flush()
        os.fsync(self._file.fileno())

    def append(self, outcomes: Iterable[tuple[int, Outcome]]) -> int:
        """Write outcomes (job, outcome) of jobs not yet in the journal, to disk at once; return how many were new."""
        new = [(job, outcome) for job, outcome in outcomes if not self.done[job]]
        self._write(new)
        for job, _ in new:
            self.done[job] = 1
        return len(new)

    def outcomes(self) -> Iterator[tuple[int, Outcome]]:
        """Yield (job, outcome) of the finished jobs in the order in which they ended; a job that stands twice in the
        file comes twice."""
        for number, _, value in read_lines(self.path):
            if number > 1:
                yield value[0], value[1]

    def close(self) -> None:
        """Close the file; nothing can be appended afterwards."""
        self._file.close()


def read_lines(path: Path) -> Iterator[tuple[int, int, Any]]:
    """Yield (line number, byte where the line ends, its JSON value) of every whole line; a torn last line is left out.

    InputError for a line that is no JSON and not the last, or the first: no interruption leaves that.
    """
    with path.open("rb") as file:
        number, end, broken = 0, 0, 0
        while line := file.readline(JOURNAL_LINE):
            number += 1
            if broken:
                raise _damaged(path, broken)
            end += len(line)
            try:
                if not line.endswith(b"\n"):
                    raise ValueError
                value = json.loads(line)
            except (ValueError, RecursionError):
                if number == 1 and line.endswith(b"\n"):
                    raise _damaged(path, 1) from None
                broken = number
                continue
            yield number, end, value


def _damaged(path: Path, line: int) -> InputError:
    return InputError(f"{path}: line {line}: not a journal's line; remove the file to start anew")


def _job(path: Path, number: int, value: Any, jobs: int) -> int:
    """Return the job number of a journal's line; InputError if the line is none."""
    if isinstance(value, list) and len(value) == 2:
        job, outcome = value
        plain = isinstance(outcome, str) or (isinstance(outcome, dict) and all(
            isinstance(cell, (int, float, str)) for cell in outcome.values()))
        if plain and type(job) is int and 0 <= job < jobs:
            return job
    raise _damaged(path, number)


class Table(NamedTuple):
    """A campaign's table on disk: its path, how many jobs it has, and how many of them failed (rows with an error)."""

    path: Path
    jobs: int
    failed: int   # rows with an error


def write_table(journal: Path, path: Path, jobs: Sequence[Any]) -> Table:
    """Write the table (CSV) of `jobs`, in order, from a journal that has all of them: job's fields, row, `error`.

    The journal may have further jobs, which are left out.  Rows are fetched one at a time from where the journal has
    them, so memory does not grow with their width.
    """
    place = [-1] * len(jobs)
    first: dict[str, int] = {}  # column -> the earliest job that has it
    start, failed = 0, 0
    for number, end, value in read_lines(journal):
        if number > 1 and value[0] < len(jobs) and place[value[0]] < 0:
            job, outcome = value
            place[job] = start
            failed += isinstance(outcome, str)
            for name in outcome if isinstance(outcome, dict) else ():
                first[name] = min(job, first.get(name, job))
        start = end
    order = {name: k for k, name in enumerate(_in_order(journal, place, first))}
    fields = jobs[0]._fields
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file, \
            journal.open("rb") as lines:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*fields, *order, ERROR_COLUMN])
        for job, at in zip(jobs, place, strict=True):
            outcome = _outcome(lines, at)
            row = outcome if isinstance(outcome, dict) else {}
            error = outcome if isinstance(outcome, str) else ""
            writer.writerow([*map(_cell, job), *(_cell(row.get(name, "")) for name in order), error])
    return Table(path, len(jobs), failed)


def _outcome(lines: Any, at: int) -> Outcome:
    lines.seek(at)
    outcome: Outcome = json.loads(lines.readline())[1]
    return outcome


def _in_order(journal: Path, place: list[int], first: dict[str, int]) -> Iterator[str]:
    """Yield the rows' columns by the first job that has them, in that row's order: whatever order the journal is in."""
    with journal.open("rb") as lines:
        for job in sorted(set(first.values())):
            yield from (name for name in _outcome(lines, place[job]) if first[str(name)] == job)


def _cell(value: Value) -> str:
    return value if isinstance(value, str) else repr(value)


try:
    import fcntl
except ImportError:  # not a POSIX system
    fcntl = None  # type: ignore[assignment]
    import msvcrt

LOCK = ".launchid.lock"
_held = set[int]()  # descriptors: a process that is forked meanwhile lets go of them


def _let_go() -> None:
    """Close the locks in a forked worker, which may outlive a run that is killed: the lock ends with the run."""
    while _held:
        os.close(_held.pop())


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_let_go)


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Lock the folder for this run while the context lasts; InputError if another run holds it."""
    handle = None
    while handle is None:
        handle = _claimed(folder)
    _held.add(handle)
    try:
        yield
    finally:
        with contextlib.suppress(OSError):  # while it is locked: the next run's is another
            os.unlink(folder / LOCK)
        _held.discard(handle)
        os.close(handle)


def _claimed(folder: Path) -> int | None:
    """Return a descriptor that holds the lock; None if the run that had it has just taken the file away."""
    path = folder / LOCK
    try:
        handle = os.open(path, os.O_CREAT | os.O_RDWR | getattr(os, "O_NOFOLLOW", 0), 0o666)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from None
    try:
        _lock(handle)
        if os.path.samestat(os.fstat(handle), os.stat(path)):
            return handle
    except FileNotFoundError:
        pass
    except (BlockingIOError, PermissionError):
        os.close(handle)
        raise InputError(f"{folder}: another run is writing into this folder; expected its end, or another folder"
                         ) from None
    os.close(handle)
    return None


def _lock(handle: int) -> None:
    """Lock the file; BlockingIOError, on some systems PermissionError, if another run has it."""
    if fcntl is None:
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        return
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:  # a file system without locks
        return
