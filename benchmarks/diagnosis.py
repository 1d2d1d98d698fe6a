"""`launchid diagnose` on flights in which something is hidden: right names, false alarms, sizes, gain, limits.

    OPENBLAS_NUM_THREADS=1 python benchmarks/diagnosis.py [--quick] [--seeds N] [--first N] [--out DIR] [--jobs 2]

In calm air, and in the wind that the nominal then declares (turbulence of 0.005 rad, a walk of 0.002 rad/sqrt(s)).
First clean flights: what is found in them is a false alarm, and what the diagnosis says it could have found sizes the
effects of the rest.  Then, on constant and vega_like each:
  twice     every listed cause at twice its printed limit;  half  at half of it
  dropped   at twice the limit of the log without theta_dot, or without beta
  pairs     two causes of different places, each at three times its limit
  unlisted  every effect that the contract does not list, clearly visible or twice that
  odds      a few causes at 0.5 to 2 times the limit: where half of the flights are found
Odd seeds fly a rough reference (unlisted: the nominal's), every other pair of seeds the cause's physically other
form, every other four of the windy seeds Dryden turbulence and shear in layers; noise 0.67 to 1.5 of the declared,
dispersion 2 %, logs of 50, 100 or 200 Hz are drawn from the seed.
`--first N`, a multiple of 4, begins at another seed: flights that nobody has seen.
`--quick` flies 2 seeds of each effect, one a nominal.  Sizes are judged over the Cramer-Rao bound of that log, at the
true values with all free that was free in the answer; of flights whose first named cause is the true one, not its
rival.  The generator's other forms have a size by convention only: their coverage stands apart.
A flight in which what is hidden costs the vehicle before half of it counts like any other, and is named.
The excess of the 1 s error is over that of the clean flight; where the cause was not named, none of it is gone.
Frequencies, durations and times are near those for which the limit is printed (`diagnosis_cases._near`).

Every run is a row of a CSV in DIR, beside it `confusion.png`.  A run that was interrupted goes on when it is started
again; another engine, generator or choice of flights goes to files of its own.  Flights go by their seed, all effects
in turn, so that a run that is cut off has some seeds of each: `--so-far` prints its tables.
"""

import argparse
import csv
import hashlib
import math
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from diagnosis_cases import (
    AIRS,
    CAUSES,
    GROUPS,
    NOMINALS,
    ROOT,
    Case,
    Flight,
    calibrated,
    clean,
    diagnosed,
    sized,
    wanted,
)
from diagnosis_tables import SHOWN, drawn, printed

from launchid.cli.terminal import shown_counter
from launchid.monte_carlo.campaign import run_campaign
from launchid.monte_carlo.journal import Row, read_lines

DECIDES = ("launchid_core", "sim", "tests/hidden")  # with the cases: decide the rows


# ---- flying


def definition() -> str:
    """A hash of the sources that decide the rows."""
    digest = hashlib.sha256((ROOT / "benchmarks" / "diagnosis_cases.py").read_bytes())
    for folder in DECIDES:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in (".py", ".toml", ".csv"):
                digest.update(path.read_bytes())
    return digest.hexdigest()


def campaign(name: str, cases: list[Case], work: Callable[[Case], Row], args: argparse.Namespace) -> list[Flight]:
    """The rows of these flights: flown, continued, or read where they are there already; so far: read what is there."""
    source = definition()
    path = args.out / f"{name}-{hashlib.sha256(f'{source}{cases!r}'.encode()).hexdigest()[:10]}.csv"
    journal = path.with_name(f"{path.name}.journal")
    if args.so_far and not path.exists():
        rows = [flight(cells) for cells in finished(journal, cases)]
    else:
        if not path.exists() or journal.exists():
            run_campaign(cases, work, path, workers=args.jobs, chunk=1, progress=shown_counter(len(cases), "cases"),
                         definition=source)
        with path.open(encoding="utf-8", newline="") as file:
            rows = [flight(cells) for cells in csv.DictReader(file)]
    failed = [row for row in rows if row["error"]]
    print(f"{name}: {len(rows)} of {len(cases)} flights, {len(failed)} failed, in {path.name}", flush=True)
    for row in failed[:SHOWN]:
        print(f"  failed: {row['nominal']} {row['causes'] or 'clean'} seed {row['seed']:.0f}: {row['error']}")
    return rows


def finished(journal: Path, cases: list[Case]) -> Iterator[dict[str, str]]:
    """The rows of a campaign that was cut off, as its table would have them."""
    lines = read_lines(journal) if journal.exists() else iter(())
    outcomes = {value[0]: value[1] for number, _, value in lines if number > 1}
    names = dict.fromkeys(name for outcome in outcomes.values() if isinstance(outcome, dict) for name in outcome)
    for job in sorted(outcomes):
        failed = isinstance(outcomes[job], str)
        row = dict.fromkeys(names, "") if failed else outcomes[job]
        yield {name: str(value) for name, value in (*cases[job]._asdict().items(), *row.items())} \
            | {"error": outcomes[job] if failed else ""}


def in_turn(cases: list[Case]) -> list[Case]:
    """The cases by seed, each group's seeds over the same time."""
    last: dict[str, int] = {}
    for each in cases:
        last[each.group] = max(last.get(each.group, 0), each.seed)
    first = min((each.seed for each in cases), default=0)
    return sorted(cases, key=lambda each: (each.seed - first) / (last[each.group] - first + 1))


def flight(cells: dict[str, str]) -> Flight:
    """A row of the table; in a flight that failed nothing was found, and what was said is wrong."""
    row: Flight = {}
    for name, cell in cells.items():
        try:
            row[name] = float(cell)
        except ValueError:
            row[name] = cell
    if row["error"]:
        row |= dict.fromkeys(("right", "place_right", "found"), 0.0) | {"wrong": 1.0, "verdict": "failed"}
        row |= {name: math.nan for name, value in row.items() if value == ""}
        row |= {"causes": cells["causes"], "drop": cells["drop"], "named": "", "limits": "", "achieved": row["factor"]}
    return row


def said_lost(rows: list[Flight]) -> str:
    """A line on the flights that ended before half of the flight, the vehicle lost to what was hidden; they count as
    all others."""
    longest: dict[Any, float] = {}
    for row in rows:
        longest[row["nominal"]] = max(longest.get(row["nominal"], 0.0), float(row.get("t_end") or 0.0))
    gone = [row for row in rows if not row["error"] and row["lost"] and row["t_end"] < 0.5 * longest[row["nominal"]]]
    return ", ".join(f"{row['causes']} {row['t_end']:.1f} s" for row in gone) or "none"


def without_limit(cases: list[Case], left: list[Case]) -> str:
    """A line on the flights that are not flown, since the log of their clean twin cannot show the effect at any
    size."""
    gone = Counter((each.group, each.causes) for each in cases) - Counter((each.group, each.causes) for each in left)
    return ", ".join(f"{group} {causes} {count}" for (group, causes), count in gone.items()) or "none"


def main() -> int:
    """Fly and print; exit status 1 if a demand is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="2 seeds of each effect, a part of the groups")
    parser.add_argument("--seeds", type=int, help="of each effect; the groups keep their shares")
    parser.add_argument("--first", type=int, default=0, help="first seed, a multiple of 4: forms and references go in "
                        "fours")
    parser.add_argument("--out", type=Path, default=Path("diagnosis-benchmark"), help="directory of the tables")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    parser.add_argument("--groups", nargs="+", choices=GROUPS, default=list(GROUPS))
    parser.add_argument("--causes", nargs="+", choices=list(CAUSES), default=list(CAUSES))
    parser.add_argument("--nominals", nargs="+", choices=NOMINALS, default=list(NOMINALS))
    parser.add_argument("--air", nargs="+", choices=AIRS, default=list(AIRS))
    parser.add_argument("--rate", type=float, default=0.0, help="Hz of every log; default: drawn from 50, 100, 200")
    parser.add_argument("--so-far", action="store_true", help="fly nothing, print the tables of what has been flown")
    args = parser.parse_args()
    if args.first % 4 or args.first < 0:
        parser.error(f"--first {args.first}: not a multiple of 4 from 0 on")
    args.out.mkdir(parents=True, exist_ok=True)
    cases = wanted(args)
    calm = campaign("clean", clean(args, cases), calibrated, args)
    asked, cases = cases, in_turn(sized(cases, calm))
    print(f"not flown, no limit in such a log: {without_limit(asked, cases)}", flush=True)
    rows = campaign("hidden", cases, diagnosed, args) if cases else []
    print(f"vehicle lost before half of its flight: {said_lost(rows)}", flush=True)
    missed = printed(calm, rows)
    drawn(rows, args.out / "confusion.png")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
