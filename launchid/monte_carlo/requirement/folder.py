"""A campaign's folder: `campaign.json` defines it, `flights.csv` has a row per flight; flown, continued, or merged.

`campaign.json` is there before the first flight, `flights.csv.journal` beside it while it is flown, `flights.csv` when
it is done.  The same campaign run again in its folder goes on where it was; when it was done already it is only judged.
One run at a time writes into it (`journal.locked`).

A folder is always checked: `read_campaign` and `read_flights` alone read it, and raise InputError if it is not valid.
Its flights are those of the definition's seeds, drawn as the seeds draw them, each once, in order, and all of them or
all up to the one that decided.
"""

import contextlib
import csv
import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, fields, is_dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from launchid_core import __version__
from sim.csv_text import AS_TEXT, rows
from sim.errors import InputError
from sim.files import atomic_path, make_folder, write_text
from sim.nominal import Nominal

from ..campaign import Enough, run_campaign
from ..journal import ERROR_COLUMN, Outcome, locked
from .flight import FlightJob, Flyer, flight_job, flight_jobs, flown_row
from .grammar import requirement
from .sequential import Watch

FLIGHTS_FORMAT = "launchid flights 1"
NOT_FLOWN = ("name", "diagnosis")  # of a nominal: how it is called and judged


@dataclass(frozen=True)
class Definition:
    """A campaign: a nominal, seeds `seed` ... `seed + flights - 1`, and requirements (texts) to prove.  planned: all
    flights are flown, then judged once; else it ends when decided."""

    nominal: Nominal
    seed: int
    flights: int
    requirements: Sequence[str]
    planned: bool

    def as_json(self) -> dict[str, Any]:
        """Return the content of the folder's campaign.json, with the nominal as name and digest."""
        return {"format": FLIGHTS_FORMAT, "version": __version__, "nominal": self.nominal.name,
                "nominal_sha256": digest_of(self.nominal), "seed": self.seed, "flights": self.flights,
                "requirements": list(self.requirements), "stop": "never" if self.planned else "decided"}


def digest_of(nominal: Nominal) -> str:
    """Return a SHA-256 of a nominal, equal for nominals that fly alike, whatever their names and files' paths."""
    flown = {key.name: getattr(nominal, key.name) for key in fields(nominal) if key.name not in NOT_FLOWN}
    return hashlib.sha256(_text(flown).encode()).hexdigest()


def _text(part: Any) -> str:
    """Return every number of a part as text, to the last bit, without the paths of files."""
    if is_dataclass(part):
        part = {key.name: getattr(part, key.name) for key in fields(part)}
    if isinstance(part, dict):
        return f"{{{','.join(f'{key}={_text(value)}' for key, value in part.items() if key != 'path')}}}"
    if isinstance(part, np.ndarray):
        return repr(part.tolist())
    if isinstance(part, tuple | list):
        return f"[{','.join(map(_text, part))}]"
    return repr(part)


CAMPAIGN, FLIGHTS_FILE = "campaign.json", "flights.csv"
JOURNAL = f"{FLIGHTS_FILE}.journal"
CAMPAIGN_FILE = 1 << 20  # bytes of a campaign.json: it has a few hundred
MOST_SEEDS = 1 << 63  # seeds: as many as anybody flies
COMMON_KEYS = ("format", "version", "nominal_sha256")  # of parts that make one campaign
KEY_TYPES = {"format": str, "version": str, "nominal": str, "nominal_sha256": str, "seed": int, "flights": int,
             "requirements": list, "stop": str}  # what stands in a campaign.json


@dataclass(frozen=True)
class Flights:
    """A campaign's flights in memory: seeds in order, and for each its row or the one line of its error."""

    seeds: Sequence[int]
    outcomes: Sequence[Outcome]


def fly(definition: Definition, folder: Path, executor: Executor | None, workers: int | None,
        progress: Callable[[int], object] | None) -> Flights:
    """Fly the flights not yet flown, until the requirements are decided (all if `planned`); return the table.
    progress: called with the number newly flown."""
    flyer = Flyer(definition.nominal)
    if not _is_done(folder):
        flyer(flight_job(definition.nominal, definition.seed))  # what cannot fly is said at once, and what compiles
    with _held(definition, folder):                             # does so once
        if not _is_done(folder):
            run_campaign(flight_jobs(definition.nominal, definition.seed, definition.flights), flyer,
                         folder / FLIGHTS_FILE,
                         executor, workers, progress=progress, enough=_enough(definition, folder / JOURNAL),
                         definition=json.dumps(definition.as_json()))
        return read_flights(folder / FLIGHTS_FILE, definition)


def _is_done(folder: Path) -> bool:
    return (folder / FLIGHTS_FILE).exists() and not (folder / JOURNAL).exists()


def _enough(definition: Definition, journal: Path) -> Enough:
    """Return a function (number, outcome) -> number of flights that decide, or None; it raises InputError for a row
    that is no flight's."""
    watch = _watch(definition)

    def enough(number: int, outcome: Outcome) -> int | None:
        try:
            return watch(number, outcome if isinstance(outcome, str) else flown_row(outcome))
        except ValueError:
            raise InputError(f"{journal}: job {number}: not a flight's row; remove the file to start anew") from None

    return enough


def _watch(definition: Definition) -> Watch:
    return Watch([requirement(text) for text in definition.requirements], definition.planned)


@contextlib.contextmanager
def _held(definition: Definition, folder: Path) -> Iterator[None]:
    """Lock the folder for this run and write this campaign's definition, if it is new; InputError if the folder is
    another campaign's."""
    make_folder(folder)
    with locked(folder):
        if (folder / CAMPAIGN).exists():
            _check_same(folder, definition, KEY_TYPES, "another campaign's folder", "expected a new one")
        elif (folder / FLIGHTS_FILE).exists():
            raise InputError(f"{folder / FLIGHTS_FILE}: a table without its {CAMPAIGN}; expected a new folder")
        else:
            write_text(folder / CAMPAIGN, [json.dumps(definition.as_json(), indent=1), "\n"])
        yield


def _check_same(folder: Path, definition: Definition, keys: Iterable[str], what: str, expected: str) -> dict[str, Any]:
    """Return the folder's campaign.json; InputError unless these keys of it are the definition's."""
    content, said = read_campaign(folder), definition.as_json()
    for key in keys:
        if content[key] != said[key]:
            raise InputError(f"{folder / CAMPAIGN}: {what} ({key} {_short(content[key])}, not {_short(said[key])}); "
                             f"{expected}")
    return content


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:40] + "..."


# ---- what a valid folder is


def read_campaign(folder: Path) -> dict[str, Any]:
    """Return the content of a folder's campaign.json; InputError unless each key has a value of its kind."""
    path = folder / CAMPAIGN
    wrong = InputError(f"{path}: no campaign's definition; expected what `launchid campaign` wrote")
    try:
        with path.open("rb") as file:
            text = file.read(CAMPAIGN_FILE)
        content = json.loads(text) if len(text) < CAMPAIGN_FILE else None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except (ValueError, RecursionError):
        raise wrong from None
    if not isinstance(content, dict) or any(type(content.get(key)) is not kind for key, kind in KEY_TYPES.items()):
        raise wrong
    if not 0 <= content["seed"] < MOST_SEEDS or not 1 <= content["flights"] < MOST_SEEDS or not all(
            isinstance(text, str) for text in content["requirements"]):
        raise wrong
    return content


def read_flights(path: Path, definition: Definition) -> Flights:
    """Return the flights of a finished table; InputError unless they are this definition's, all or up to a decision."""
    watch, enough = _watch(definition), None
    seeds, outcomes = list[int](), list[Outcome]()
    for number, (seed, outcome) in enumerate(_flown(path, definition)):
        seeds.append(seed)
        outcomes.append(outcome)
        if enough is None:
            enough = watch(number, outcome)
    if len(seeds) not in (definition.flights, enough):
        raise InputError(f"{path}: {len(seeds)} of {definition.flights} flights; expected all, or those that decide (a "
                         "part is flown whole, without --requirement); remove the file to fly them anew")
    return Flights(seeds, outcomes)


def _flown(path: Path, definition: Definition) -> Iterator[tuple[int, Outcome]]:
    """Yield (seed, outcome) of every row of a table; InputError for a row that is not of the seed whose turn it is."""
    table = table_rows(path)
    _, header = next(table)
    keys = len(FlightJob._fields)
    for seed, (line, cells) in enumerate(table, start=definition.seed):
        job = flight_job(definition.nominal, seed)
        if cells[:keys] != list(map(repr, job)):
            raise InputError(f"{path}: line {line}: not the flight of seed {seed}, which its {CAMPAIGN} says; remove "
                             "the file to fly them anew")
        try:
            yield seed, cells[-1] or flown_row(dict(zip(header[keys:-1], cells[keys:-1], strict=True)))
        except ValueError:
            raise InputError(f"{path}: line {line}: not a flight's row; remove the file to fly them anew") from None


def table_rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield (line number, cells) of a table of flights, its header first; InputError if the file is no such table."""
    try:
        with path.open(**AS_TEXT) as file:
            table = rows(str(path), file)
            line, header = next(table, (1, []))
            keys = len(FlightJob._fields)
            if header[:keys] != list(FlightJob._fields) or header[-1] != ERROR_COLUMN:
                raise InputError(f"{path}: not a table of flights; expected what `launchid campaign` wrote")
            yield line, header
            for line, cells in table:
                if len(cells) != len(header):
                    raise InputError(f"{path}: line {line}: {len(cells)} cells, expected {len(header)}")
                yield line, cells
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None


# ---- parts


def merge(definition: Definition, parts: Sequence[Path], folder: Path) -> tuple[Definition, Flights]:
    """Merge finished parts into one table in `folder`; return the whole's definition and its flights.  InputError
    unless the parts are of this nominal and of consecutive seeds.

    definition  its seed and flights are not used: they follow from the parts
    """
    ordered = sorted(((_part(definition, part), part) for part in parts), key=lambda each: each[0].seed)
    first = seed = ordered[0][0].seed
    header = _header(ordered[0][1])
    for said, part in ordered:
        if said.seed != seed:
            kind = "are missing" if said.seed > seed else "stand twice"
            low, high = sorted((seed, said.seed))
            raise InputError(f"{part}: seeds from {low} to {high - 1} {kind}; expected parts of consecutive seeds")
        read_flights(part / FLIGHTS_FILE, said)
        if _header(part) != header:
            raise InputError(f"{part / FLIGHTS_FILE}: other columns than in {ordered[0][1] / FLIGHTS_FILE}")
        seed += said.flights
    whole = replace(definition, seed=first, flights=seed - first)
    with _held(whole, folder):
        with atomic_path(folder / FLIGHTS_FILE) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(header)
            for _, part in ordered:
                writer.writerows(cells for _, cells in islice(table_rows(part / FLIGHTS_FILE), 1, None))
        return whole, read_flights(folder / FLIGHTS_FILE, whole)


def _header(part: Path) -> list[str]:
    return next(table_rows(part / FLIGHTS_FILE))[1]


def _part(definition: Definition, part: Path) -> Definition:
    """Return a part's definition; InputError if it is not a part of this campaign, or not flown to its end."""
    said = _check_same(part, definition, COMMON_KEYS, "a part of another campaign", "expected parts of this one")
    if not _is_done(part):
        raise InputError(f"{part}: not flown to its end; run its command again")
    return replace(definition, seed=said["seed"], flights=said["flights"], requirements=())
