"""Monte Carlo campaigns: jobs -> one table, or a list in memory, on any `concurrent.futures.Executor`.

    jobs = draw_jobs("constant", "box", seeds=range(100_000))
    run_campaign(jobs, work, "table.csv")                             # processes, one a core
    run_campaign(jobs, work, "table.csv", client.get_executor())      # dask.distributed's, any number of machines
    run_jobs(jobs, work)                                              # what work returns, whatever it is, in order

`work(job)` is a function of a module (it travels by its name) that returns one row, a dict of plain values, and
decides it by the job alone: seeds are in the job.  Then the table is the same, bit for bit, whatever the workers,
the chunks and the interruptions.

Finished jobs go to a journal beside the table (`table.csv.journal`), so that a campaign that was interrupted goes on
where it was when it is run again; the journal goes when the table is there.  A job whose work raises is a row with
the error's one line.  A chunk whose worker died is sent again; after ATTEMPTS deaths its jobs are sent one by one,
nothing else running, so that the one that kills is found and becomes a failed row.

Assumptions: one campaign writes a journal at a time (`journal.locked` holds a folder for one); a Ctrl-C of a given
executor's workers is that executor's.
"""

import asyncio
import functools
import hashlib
import os
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import (
    ALL_COMPLETED,
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from multiprocessing.reduction import ForkingPickler
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sim.errors import InputError, UsageError

from .journal import Journal, Outcome, Row, Table, Value, write_table

ATTEMPTS = 3        # deaths of a chunk's workers before its jobs run alone; of a lone job before it is a failed row
CHUNK = 16          # jobs a future at most: 1 s of flights, so that an interruption costs at most that a worker
CHUNKS_A_WORKER = 4  # at least so many, so that the last ones keep all workers busy
IN_FLIGHT = 3       # futures a worker: one runs, two wait; memory does not grow with the campaign
WATCH_PERIOD = 1.0  # s, between a worker's looks whether its runner is there
MESSAGE = 200       # characters of an error's line

Work = Callable[[Any], Row]
Enough = Callable[[int, Outcome], int | None]
Chunk = list[tuple[int, Any]]   # (job's number, job)


class Died(str):
    """The error line of a job whose worker processes died, in place of its work's outcome."""


class Job(NamedTuple):
    """One flight to fly: nominal, scenario, seed, and the deviations by which a6 = a6_0 (1 + sigma delta_a6) and k1 =
    k1_0 (1 + sigma delta_k1).  Any NamedTuple of plain values may be a job."""

    nominal: str
    scenario: str
    seed: int
    delta_a6: float   # a6 = a6_0 (1 + sigma delta)
    delta_k1: float


def draw_jobs(nominal: str, scenario: str, seeds: Iterable[int], spread: float = 1.0) -> list[Job]:
    """Return one job a seed, delta uniform in [-spread, spread]^2; a seed draws the same delta in every scenario."""
    return [Job(nominal, scenario, seed, *drawn_delta(seed, spread)) for seed in seeds]


def drawn_delta(seed: int, spread: float = 1.0) -> tuple[float, float]:
    """Return (delta_a6, delta_k1) of a seed, uniform in [-spread, spread]^2, from their own random stream."""
    delta = np.random.default_rng((605, seed)).uniform(-spread, spread, 2)
    return float(delta[0]), float(delta[1])


# ---- in the worker


def run_chunk(work: Work, chunk: Chunk) -> list[tuple[int, Outcome]]:
    """Run the work on each job; return (number, row) or, if it raised, (number, its error in one line)."""
    return [(number, _outcome(work, job)) for number, job in chunk]


def call_chunk(work: Callable[[Any], Any], chunk: Chunk) -> list[tuple[int, Any]]:
    """Run the work on each job; return (number, what it returned); an exception of the work is raised."""
    return [(number, work(job)) for number, job in chunk]


def _outcome(work: Work, job: Any) -> Outcome:
    try:
        return {name: _plain(name, value) for name, value in work(job).items()}
    except Exception as error:  # whatever the work raises is that job's result
        text = str(error).strip().splitlines() or [""]
        return f"{type(error).__name__}: {text[0]}"[:MESSAGE]


def _plain(name: str, value: Any) -> Value:
    """Return a value as Python number or text (numpy's converted, so that tables do not depend on it); else
    TypeError."""
    value = value.item() if isinstance(value, np.generic) else value
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, (int, float, str)):
        return value
    raise TypeError(f"{name} = {value!r}: expected a number or a text")


def _begin_worker(runner: int) -> None:
    """Prepare a worker process: ignore Ctrl-C, which the runner handles, and end when the runner is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with, args=(runner,), daemon=True).start()


def _end_with(runner: int) -> None:
    while os.getppid() == runner:
        time.sleep(WATCH_PERIOD)
    os._exit(1)


def _processes(workers: int) -> Executor:
    return ProcessPoolExecutor(workers, initializer=_begin_worker, initargs=(os.getpid(),))


# ---- in the runner


def run_campaign(jobs: Sequence[Any], work: Work, path: str | Path,
                 executor: Executor | Callable[[], Executor] | None = None, workers: int | None = None,
                 chunk: int | None = None, progress: Callable[[int], object] | None = None,
                 definition: str = "", enough: Enough | None = None) -> Table:
    """Run every job once and write the table; continue a campaign that was interrupted.

    jobs        NamedTuples of plain values, all of one kind
    work        a function of a module: job -> row
    path        of the table; must not exist, for it is hours of work
    executor    None: processes.  A function that makes one is called again when it breaks; one that is given is not
                shut down, and if it breaks, run again with another
    workers     how many the executor has; None: one a core
    chunk       jobs a future; None: at most CHUNK
    progress    called with the number of jobs newly finished, at first those of the journal
    definition  what else decides the rows (a nominal's text, options): continuing needs the same
    enough      is given each finished job's number and outcome, in whatever order they end; once it answers with a
                number n nothing more is sent and the table is of the first n jobs, of which it has been given all;
                it may refuse an outcome with an InputError, and nothing is lost
    Raises UsageError for no jobs; InputError if the table exists or the journal is another campaign's.
    """
    path = Path(path)
    if len(jobs) == 0:
        raise UsageError("a campaign of no jobs: expected at least one")
    workers, chunk = _sizes(len(jobs), workers, chunk)
    beside = path.with_name(f"{path.name}.journal")
    if path.exists() and not beside.exists():
        raise InputError(f"{path}: the table of a campaign that is finished; expected a new name, or remove it")
    journal = Journal(beside, campaign_hash(jobs, work, definition), len(jobs))
    report = progress or (lambda _: None)
    report(sum(journal.done))
    ask = _Asked(enough)
    try:
        ask(journal.outcomes() if enough is not None else ())
        if ask.first is None and not all(journal.done):
            with _Fleet(executor, workers) as fleet:
                fleet.check(work, jobs[0])
                for outcomes in _Dispatch(_chunks(jobs, journal.done, chunk), run_chunk, work, fleet).outcomes():
                    report(journal.append(outcomes))
                    if ask(outcomes):
                        break
    finally:
        journal.close()
    table = write_table(beside, path, jobs[:ask.first])
    beside.unlink()
    return table


class _Asked:
    """Calls `enough` with each finished job until it answers; `first`: that number of jobs, None before."""

    def __init__(self, enough: Enough | None) -> None:
        self._enough = enough
        self.first: int | None = None

    def __call__(self, outcomes: Iterable[tuple[int, Outcome]]) -> bool:
        for number, outcome in outcomes:
            if self._enough is None or self.first is not None:
                break
            self.first = self._enough(number, outcome)
        return self.first is not None


def run_jobs(jobs: Sequence[Any], work: Callable[[Any], Any],
             executor: Executor | Callable[[], Executor] | None = None, workers: int | None = None,
             chunk: int | None = None, progress: Callable[[int], object] | None = None,
             done: Callable[[int, Any], object] | None = None) -> list[Any]:
    """Return what `work` returns for each job, in the order of the jobs; no journal, for minutes of work.

    Arguments as of `run_campaign`, but what `work` returns is anything that travels, and what it raises is raised;
    done   called with a job's number and outcome as soon as it is there
    Raises UsageError if a job's worker processes die.
    """
    if len(jobs) == 0:
        return []
    workers, chunk = _sizes(len(jobs), workers, chunk)
    report = progress or (lambda _: None)
    results: list[Any] = [None] * len(jobs)
    with _Fleet(executor, workers) as fleet:
        fleet.check(work, jobs[0])
        for outcomes in _Dispatch(_chunks(jobs, bytearray(len(jobs)), chunk), call_chunk, work, fleet).outcomes():
            for number, outcome in outcomes:
                if isinstance(outcome, Died):
                    raise UsageError(f"{jobs[number]}: {outcome}")
                results[number] = outcome
                if done is not None:
                    done(number, outcome)
            report(len(outcomes))
    return results


def _sizes(jobs: int, workers: int | None, chunk: int | None) -> tuple[int, int]:
    """Return (workers, jobs a future), defaults filled in; UsageError if below 1."""
    workers = workers or os.cpu_count() or 1
    if workers < 1 or (chunk is not None and chunk < 1):
        raise UsageError(f"workers {workers!r}, chunk {chunk!r}: expected at least 1")
    return workers, chunk or max(1, min(CHUNK, jobs // (CHUNKS_A_WORKER * workers)))


def campaign_hash(jobs: Sequence[Any], work: Work, definition: str = "") -> str:
    """Return a SHA-256 that identifies a campaign: its work's name, every job in order, and `definition`."""
    digest = hashlib.sha256(f"{_name(work)}\n{definition}\n{jobs[0]._fields}\n".encode())
    for job in jobs:
        digest.update(repr(tuple(job)).encode() + b"\n")
    return digest.hexdigest()


def _name(work: Work) -> str:
    """Return the work's name, equal in every process; of a `functools.partial` with its arguments."""
    if isinstance(work, functools.partial):
        return f"{_name(work.func)}{work.args!r}{sorted(work.keywords.items())!r}"
    named = work if hasattr(work, "__qualname__") else type(work)
    return f"{named.__module__}.{named.__qualname__}"


def _chunks(jobs: Sequence[Any], done: bytearray, size: int) -> Iterator[Chunk]:
    """Yield the jobs not yet done, with their numbers, `size` at a time."""
    chunk: Chunk = []
    for number, job in enumerate(jobs):
        if not done[number]:
            chunk.append((number, job))
        if len(chunk) == size:
            yield chunk
            chunk = []
    if chunk:
        yield chunk


class _Fleet:
    """An executor, and the means to replace it when it breaks."""

    def __init__(self, given: Executor | Callable[[], Executor] | None, workers: int) -> None:
        self.in_flight = IN_FLIGHT * workers
        self._own = not isinstance(given, Executor)
        self._make = given if callable(given) else functools.partial(_processes, workers)
        self.executor = given if isinstance(given, Executor) else self._make()

    def __enter__(self) -> "_Fleet":
        return self

    def __exit__(self, *_: object) -> None:
        if self._own:
            self.executor.shutdown(wait=True, cancel_futures=True)

    def check(self, work: Work, job: Any) -> None:
        """Refuse what cannot travel to a process before it is sent: a pool that meets it may hang at its end
        (CPython issues 94777, 105829)."""
        if isinstance(self.executor, ProcessPoolExecutor):
            try:
                ForkingPickler.dumps((work, job))
            except Exception as error:  # pickling raises what the object's own methods raise
                raise _cannot(error) from error

    def renew(self, error: BaseException) -> None:
        """Replace the executor, which broke; UsageError if it was given, so that no other can be made."""
        if not self._own:
            raise UsageError(f"the executor broke ({type(error).__name__}); run again to continue, with a new one, or "
                             "give a function that makes them") from error
        self.executor.shutdown(wait=True, cancel_futures=True)
        self.executor = self._make()


class _Parcel(NamedTuple):
    """A chunk to be sent: how many workers died of it, and whether it must run with nothing else running."""

    chunk: Chunk
    deaths: int = 0
    alone: bool = False


class _Dispatch:
    """Sends chunks, yields their outcomes; a chunk whose worker dies is sent again, then job by job alone."""

    def __init__(self, fresh: Iterator[Chunk], run: Callable[[Any, Chunk], list[tuple[int, Any]]], work: Any,
                 fleet: _Fleet) -> None:
        self._fresh, self._run, self._work, self._fleet = fresh, run, work, fleet
        self._running: dict[Future[list[tuple[int, Any]]], _Parcel] = {}
        self._again: deque[_Parcel] = deque()
        self._alone: deque[_Parcel] = deque()
        self._broken: BaseException | None = None  # the executor's end: nothing is sent until there is another

    def outcomes(self) -> Iterator[list[tuple[int, Any]]]:
        """Yield the outcomes of each chunk, in the order in which chunks end."""
        try:
            while self._fill():
                until = FIRST_COMPLETED if self._broken is None else ALL_COMPLETED
                for future in wait(self._running, return_when=until).done:
                    parcel = self._running.pop(future)
                    error = _death(future)
                    if error is None:
                        yield future.result()
                    else:
                        yield from self._lost(parcel, error)
                if self._broken is not None and not self._running:
                    self._fleet.renew(self._broken)
                    self._broken = None
        finally:
            for future in self._running:
                future.cancel()

    def _fill(self) -> bool:
        """Send chunks while there is room; return False when nothing is left."""
        while self._broken is None and len(self._running) < self._fleet.in_flight:
            parcel = self._next()
            if parcel is None:
                break
            try:
                self._running[self._fleet.executor.submit(self._run, self._work, parcel.chunk)] = parcel
            except BrokenExecutor as error:
                self._broken = error
                (self._alone if parcel.alone else self._again).appendleft(parcel)
        return bool(self._running) or self._broken is not None

    def _next(self) -> _Parcel | None:
        if self._again:
            return self._again.popleft()
        chunk = next(self._fresh, None)
        if chunk is not None:
            return _Parcel(chunk)
        return self._alone.popleft() if self._alone and not self._running else None

    def _lost(self, parcel: _Parcel, error: BaseException) -> Iterator[list[tuple[int, Outcome]]]:
        """Queue a chunk whose worker died, to be sent again; yield a failed outcome for a job that killed while
        alone."""
        if isinstance(error, BrokenExecutor):
            self._broken = error
        deaths = parcel.deaths + 1
        if deaths < ATTEMPTS:
            (self._alone if parcel.alone else self._again).append(parcel._replace(deaths=deaths))
        elif not parcel.alone:
            self._alone.extend(_Parcel([job], alone=True) for job in parcel.chunk)
        else:
            text = f"WorkerDied: {deaths} times, nothing else running ({type(error).__name__})"
            yield [(parcel.chunk[0][0], Died(text))]


def _death(future: Future[Any]) -> BaseException | None:
    """Return the exception that ended the worker, or None; UsageError when the executor cannot run the work at all."""
    try:
        error = future.exception()
    except CancelledError as cancelled:
        return cancelled
    if error is None or isinstance(error, (BrokenExecutor, asyncio.CancelledError, ConnectionError)) \
            or type(error).__module__.startswith("distributed"):  # KilledWorker, CommClosedError
        return error
    if _raised_in(error) == "distributed.cfexecutor":  # done, and its worker killed before the result was fetched
        return error
    raise _cannot(error) from error


def _raised_in(error: BaseException) -> str:
    """Return the name of the module whose line raised the error."""
    trace, name = error.__traceback__, ""
    while trace is not None:
        name = str(trace.tb_frame.f_globals.get("__name__", ""))
        trace = trace.tb_next
    return name


def _cannot(error: BaseException) -> UsageError:
    return UsageError(f"the executor cannot run the work ({type(error).__name__}: {error}); expected a function of a "
                      "module that its workers can import")
