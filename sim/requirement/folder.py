"""A campaign's folder: `campaign.json` says what it is, `flights.csv` has a row a flight; flown, continued, or merged.

`campaign.json` is there before the first flight, `flights.csv.journal` beside it while it is flown, `flights.csv` when
it is done.  The same campaign run again in its folder goes on where it was; when it was done already it is only judged.
"""

import csv
import json
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..campaign import run_campaign
from ..errors import InputError
from ..files import make_folder, write_text
from ..journal import ERROR, Outcome
from .flight import METRICS, Flyer, flight_jobs
from .grammar import Requirement
from .identity import Definition
from .watch import Watch

CAMPAIGN, FLIGHTS = "campaign.json", "flights.csv"
NUMBERS = ("end", *METRICS)
SAME = ("format", "version", "nominal_sha256")  # of parts that make one campaign


@dataclass(frozen=True)
class Flights:
    """A table in memory: seeds in order, and each flight's row or its error's one line."""

    seeds: Sequence[int]
    outcomes: Sequence[Outcome]


def fly(definition: Definition, requirements: Sequence[Requirement], folder: Path, executor: Executor | None,
        workers: int | None, progress: Callable[[int], object] | None) -> Flights:
    """Fly what is not flown yet, until the requirements are decided (if it is not `planned`), and return the table."""
    is_begun = _is_ours(folder, definition.as_json())
    table = folder / FLIGHTS
    if not table.exists() or table.with_name(f"{FLIGHTS}.journal").exists():
        jobs = flight_jobs(definition.nominal, definition.seed, definition.flights)
        Flyer(definition.nominal)(jobs[0])  # what cannot fly is said at once, and what compiles does so once
        if not is_begun:
            _begin(folder, definition.as_json())
        watch = Watch(requirements, definition.planned) if requirements and not definition.planned else None
        run_campaign(jobs, Flyer(definition.nominal), table, executor, workers, progress=progress, enough=watch,
                     definition=json.dumps(definition.as_json()))
    return read_flights(table)


def _is_ours(folder: Path, said: dict[str, Any]) -> bool:
    """Is this campaign's definition there; InputError if the folder is another's."""
    if not (folder / CAMPAIGN).exists():
        if (folder / FLIGHTS).exists():
            raise InputError(f"{folder / FLIGHTS}: a table without its {CAMPAIGN}; expected a new folder")
        return False
    found = read_campaign(folder)
    for key, value in said.items():
        if found.get(key) != value:
            raise InputError(f"{folder / CAMPAIGN}: another campaign's folder ({key} {_short(found.get(key))}, not "
                             f"{_short(value)}); expected a new one")
    return True


def _begin(folder: Path, said: dict[str, Any]) -> None:
    make_folder(folder)
    write_text(folder / CAMPAIGN, [json.dumps(said, indent=1), "\n"])


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:40] + "..."


def read_campaign(folder: Path) -> dict[str, Any]:
    """What stands in a folder's campaign.json."""
    path = folder / CAMPAIGN
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError:
        raise InputError(f"{path}: no campaign's definition; expected what `launchid campaign` wrote") from None
    if not isinstance(found, dict):
        raise InputError(f"{path}: no campaign's definition; expected what `launchid campaign` wrote")
    return found


def read_flights(path: Path) -> Flights:
    """A finished table."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    try:
        return Flights([int(row["seed"]) for row in rows], [_outcome(row) for row in rows])
    except (KeyError, TypeError, ValueError):
        raise InputError(f"{path}: not a table of flights; expected what `launchid campaign` wrote") from None


def _outcome(row: dict[str, str]) -> Outcome:
    if row[ERROR]:
        return row[ERROR]
    return {"lost": int(row["lost"]), **{name: float(row[name]) for name in NUMBERS}}


# ---- parts


def merge(definition: Definition, parts: Sequence[Path], folder: Path) -> tuple[Definition, Flights]:
    """What the parts are together, and one table of their flights: whole, of this nominal, of consecutive seeds.

    definition  its seed and flights are not looked at, they are the parts' own
    """
    found = sorted(((_part(definition, part), part) for part in parts), key=lambda each: int(each[0]["seed"]))
    lines: list[str] = []
    seed = first = int(found[0][0]["seed"])
    for said, part in found:
        if int(said["seed"]) != seed:
            kind = "are missing" if int(said["seed"]) > seed else "stand twice"
            raise InputError(f"{part}: seeds from {min(seed, int(said['seed']))} to {max(seed, int(said['seed'])) - 1} "
                             f"{kind}; expected parts of consecutive seeds")
        header, *rows = (part / FLIGHTS).read_text(encoding="utf-8").splitlines(keepends=True)
        if len(rows) != int(said["flights"]):
            raise InputError(f"{part / FLIGHTS}: {len(rows)} of {said['flights']} flights: a part is flown whole, "
                             "without --requirement")
        if lines and header != lines[0]:
            raise InputError(f"{part / FLIGHTS}: other columns than in {found[0][1] / FLIGHTS}")
        lines += [*([] if lines else [header]), *rows]
        seed += len(rows)
    whole = Definition(definition.nominal, first, seed - first, definition.requirements, definition.planned)
    if not _is_ours(folder, whole.as_json()):
        _begin(folder, whole.as_json())
    write_text(folder / FLIGHTS, lines)
    return whole, read_flights(folder / FLIGHTS)


def _part(definition: Definition, part: Path) -> dict[str, Any]:
    """What a part is; InputError if it is not one of this campaign's, or not flown yet."""
    said, expected = read_campaign(part), definition.as_json()
    for key in SAME:
        if said.get(key) != expected[key]:
            raise InputError(f"{part / CAMPAIGN}: a part of another campaign ({key} {_short(said.get(key))}, not "
                             f"{_short(expected[key])})")
    if not isinstance(said.get("seed"), int) or not isinstance(said.get("flights"), int):
        raise InputError(f"{part / CAMPAIGN}: no seed and number of flights; expected what `launchid campaign` wrote")
    if not (part / FLIGHTS).is_file() or (part / f"{FLIGHTS}.journal").exists():
        raise InputError(f"{part}: not flown to its end; run its command again")
    return said
