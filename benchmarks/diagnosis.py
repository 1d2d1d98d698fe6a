"""`launchid diagnose` on flights in which something is hidden: right names, false alarms, sizes, gain, limits.

    OPENBLAS_NUM_THREADS=1 python benchmarks/diagnosis.py [--quick] [--seeds N] [--first N] [--out DIR] [--jobs 2]

First clean flights: what is found in them is a false alarm, and what the diagnosis says it could have found sizes the
effects of the rest.  Then, on constant and vega_like each:
  twice     every listed cause at twice its printed limit
  large     at five times (a scale's deviation at most 30 %);  half  at half of it
  dropped   at twice the limit of the log without theta_dot, or without beta
  pairs     two causes of different places, each at three times its limit
  unlisted  every effect that the contract does not list, clearly visible or twice that
  odds      a few causes at 0.5 to 2 times the limit: where half of the flights are found
Odd seeds fly a rough reference (unlisted: the nominal's), every other pair of seeds the cause's physically other
form; noise 0.67 to 1.5 of the declared, dispersion 2 %, logs of 50, 100 or 200 Hz are drawn from the seed.
`--first N`, a multiple of 4, begins at another seed: flights that nobody has seen.
`--quick` flies 4 seeds of each effect, two a nominal, and 1 or 2 in the other groups.  Sizes are judged twice: of the
deviation from the neutral value, and of the value.  The excess of the 1 s error is over that of the clean flight.

Every run is a row of a CSV in DIR, beside it `confusion.png`.  A run that was interrupted goes on when it is started
again; another engine, generator or choice of flights goes to files of its own.
"""

import argparse
import csv
import hashlib
import math
import os
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from bar import bar
from diagnosis_cases import (
    CAUSES,
    GROUPS,
    NOMINALS,
    ROOT,
    UNLISTED,
    Case,
    Flight,
    calibrated,
    clean,
    diagnosed,
    sized,
    twin,
    wanted,
)

from sim.campaign import run_campaign
from sim.journal import Row

DECIDES = ("sim/diagnosis", "sim/effects", "sim/vehicle", "sim/data", "tests/hidden")  # with the cases: decide the rows
SHOWN = 60            # flights at most that are listed as not right
EXCESS = 0.05         # of the floor: a smaller excess of the error is not there to be taken away
SIZE_WITHIN = 0.15
WIDTHS = np.geomspace(0.02, 1.0, 40)      # of the odds' rise, in log size
MIDDLES = np.geomspace(0.2, 5.0, 200)     # sizes over the limit, of even odds
LOG_RATE = 100.0      # Hz, of the log whose seconds are demanded
Floors = dict[tuple[object, ...], float]   # twin -> RMS error [rad] over 1 s with nothing wrong
OTHERS = ("missing_term", "several", "unexplained", "consistent", "bad-data", "failed")


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
    """The rows of these flights: flown, continued, or read where they are there already."""
    source = definition()
    path = args.out / f"{name}-{hashlib.sha256(f'{source}{cases!r}'.encode()).hexdigest()[:10]}.csv"
    if not path.exists() or path.with_name(f"{path.name}.journal").exists():
        with bar(len(cases)) as update:
            run_campaign(cases, work, path, workers=args.jobs, chunk=1, progress=update, definition=source)
    with path.open(encoding="utf-8", newline="") as file:
        rows = [flight(row) for row in csv.DictReader(file)]
    failed = [row for row in rows if row["error"]]
    print(f"{name}: {len(rows)} flights, {len(failed)} failed, in {path.name}", flush=True)
    for row in failed[:SHOWN]:
        print(f"  failed: {row['nominal']} {row['causes'] or 'clean'} seed {row['seed']:.0f}: {row['error']}")
    return rows


def flight(cells: dict[str, str]) -> Flight:
    """A row of the table; a flight that failed has not been found."""
    row: Flight = {}
    for name, cell in cells.items():
        try:
            row[name] = float(cell)
        except ValueError:
            row[name] = cell
    if row["error"]:
        row |= dict.fromkeys(("right", "wrong", "place_right", "found"), 0.0) | {"verdict": "failed"}
        row |= {name: math.nan for name, value in row.items() if value == ""}
        row |= {"causes": cells["causes"], "drop": cells["drop"], "named": "", "limits": "", "achieved": row["factor"]}
    return row


# ---- figures


class Demand(NamedTuple):
    """A figure and what is demanded of it: low <= measured <= high.  flights: behind it."""

    group: str
    what: str
    measured: float
    low: float
    high: float
    flights: int
    form: str = "{:.1%}"

    @property
    def missed(self) -> bool:
        return self.flights > 0 and not self.low <= self.measured <= self.high

    def line(self) -> str:
        low, high = (self.form.format(x) if math.isfinite(x) else "" for x in (self.low, self.high))
        asked = f"{low} to {high}" if low and high else f"at least {low}" if low else f"at most {high}"
        answer = "no flights" if not self.flights else "NO" if self.missed else "yes"
        measured = self.form.format(self.measured) if self.flights else ""
        return f"| {self.group} | {self.what} | {measured} | {asked} | {answer} | {self.flights} |"


def share(rows: list[Flight], name: str) -> float:
    return float(np.mean([row[name] for row in rows])) if rows else math.nan


def values(rows: list[Flight], name: str) -> np.ndarray:
    """The finite ones."""
    found = np.array([row[name] for row in rows], dtype=float)
    return found[np.isfinite(found)]


def median(x: np.ndarray) -> float:
    return float(np.median(x)) if len(x) else math.nan


def mean(x: np.ndarray) -> float:
    return float(np.mean(x)) if len(x) else math.nan


def excess_gone(rows: list[Flight], floors: Floors) -> np.ndarray:
    """Of flights with a cause in the plant that was named: how much of the excess error over 1 s the extension took."""
    gone = []
    for row in rows:
        floor = floors.get(twin(row), math.nan)
        excess = row["before"] - floor
        if row["right"] and CAUSES[row["causes"]].place == "plant" and excess > EXCESS * floor:
            gone.append((row["before"] - row["after"]) / excess)
    return np.array(gone)


def even_odds(rows: list[Flight]) -> float:
    """Size over the limit at which half of the flights are found: a logistic curve in the log size, most likely fit."""
    size = np.log([row["achieved"] for row in rows])
    hit = np.array([row["right"] for row in rows]) > 0.5
    if hit.all() or not hit.any():
        return math.nan
    z = (size[None, None] - np.log(MIDDLES)[:, None, None]) / WIDTHS[None, :, None]
    cost = np.logaddexp(0.0, np.where(hit, -z, z)).sum(axis=2)
    return float(MIDDLES[np.unravel_index(np.argmin(cost), cost.shape)[0]])


def demands(calm: list[Flight], groups: dict[str, list[Flight]], floors: Floors) -> list[Demand]:
    """The issue's, in its order."""
    inf = math.inf
    twice, dropped, half, two, foreign, odds = (groups[name] for name in
                                                ("twice", "dropped", "half", "pairs", "unlisted", "odds"))
    worst = min((share([row for row in twice if row["causes"] == name], "right") for name in
                 {row["causes"] for row in twice}), default=math.nan)
    whole = [row for row in calm if not row["drop"]]
    alarms = [row["verdict"] != "consistent" for row in whole]
    timed = values([row for row in twice if row["nominal"] == "constant" and row["flown_rate"] == LOG_RATE], "seconds")
    return [
        Demand("twice", "right name or set", share(twice, "right"), 0.97, inf, len(twice)),
        Demand("twice", "the worst effect's", worst, 0.90, inf, len(twice)),
        Demand("dropped", "right name or set", share(dropped, "right"), 0.90, inf, len(dropped)),
        Demand("clean", "false alarms", mean(np.array(alarms)), -inf, 0.01, len(alarms)),
        Demand("half", "consistent or right", share(half, "good"), 0.98, inf, len(half)),
        Demand("pairs", "both right", share(two, "right"), 0.85, inf, len(two)),
        Demand("pairs", "none wrong", 1.0 - share(two, "wrong"), 0.97, inf, len(two)),
        Demand("unlisted", "wrongly named", share(foreign, "wrong"), -inf, 0.05, len(foreign)),
        Demand("unlisted", "place right", share(foreign, "place_right"), 0.80, inf, len(foreign)),
        *_size_demands("twice", twice, floors),
        *_size_demands("large", groups["large"], floors),
        Demand("odds", "even odds over the limit", even_odds(odds) if odds else math.nan, 1 / 1.5, 1.5, len(odds),
               "{:.2f}"),
        Demand("twice", "seconds a log, median", median(timed), -inf, 5.0, len(timed), "{:.1f}"),
    ]


def _size_demands(group: str, rows: list[Flight], floors: Floors) -> list[Demand]:
    """How well sizes, intervals, onsets and the extension are, of the causes that were named."""
    size, value = values(rows, "size_error"), values(rows, "value_error")
    covered, onset, gone = values(rows, "covered"), values(rows, "onset_error"), excess_gone(rows, floors)
    inf = math.inf
    return [
        Demand(group, "size within 15 % of the deviation", mean(size <= SIZE_WITHIN), 0.95, inf, len(size)),
        Demand(group, "size error of the deviation, median", median(size), -inf, 0.03, len(size)),
        Demand(group, "size error of the value, median", median(value), -inf, 0.03, len(value)),
        Demand(group, "95 % intervals cover", mean(covered), 0.90, 0.98, len(covered)),
        Demand(group, "onset error, median, s", median(onset), -inf, 0.5, len(onset), "{:.2f}"),
        Demand(group, "excess 1 s error gone, plant, median", median(gone), 0.90, inf, len(gone)),
    ]


# ---- printing


def printed(calm: list[Flight], rows: list[Flight]) -> int:
    """All tables; how many demands are missed."""
    groups = {name: [row for row in rows if row["group"] == name] for name in GROUPS[1:]}
    for row in (*calm, *rows):
        row["good"] = is_good(row)
    floors = {twin(row): row["floor"] for row in calm}
    asked = demands(calm, groups, floors)
    print("\n| group | figure | measured | demanded | met | flights |\n|---|---|---|---|---|---|")
    print("\n".join(each.line() for each in asked))
    for group in ("twice", "large"):
        _print_effects(group, groups[group], floors)
    _print_odds(groups["odds"])
    _print_parts(groups, [row for row in calm if not row["drop"]])
    _print_confusion(groups)
    _print_misses(groups, calm)
    return sum(each.missed for each in asked)


def _print_effects(group: str, flights: list[Flight], floors: Floors) -> None:
    print(f"\n| {group} | right | wrong | unexplained | consistent | size error | of value | covered "
          "| onset s | excess gone |\n|---|---|---|---|---|---|---|---|---|---|")
    for name in CAUSES:
        rows = [row for row in flights if row["causes"] == name]
        if rows:
            said = Counter(row["verdict"] for row in rows)
            numbers = [median(values(rows, "size_error")), median(values(rows, "value_error")),
                       mean(values(rows, "covered")),
                       median(values(rows, "onset_error")), median(excess_gone(rows, floors))]
            print(f"| {name} | {sum(row['right'] for row in rows):.0f} of {len(rows)} "
                  f"| {sum(row['wrong'] for row in rows):.0f} | {said['unexplained']} | {said['consistent']} | "
                  + " | ".join(f"{x:.3f}" if math.isfinite(x) else "" for x in numbers) + " |")


def _print_odds(odds: list[Flight]) -> None:
    if not odds:
        return
    sizes = sorted({row["factor"] for row in odds})
    print("\n| found at this size over the limit | " + " | ".join(f"{size:g}" for size in sizes) + " | even odds |\n"
          + "|---" * (len(sizes) + 2) + "|")
    for name in dict.fromkeys(row["causes"] for row in odds):
        rows = [row for row in odds if row["causes"] == name]
        cells = [f"{share([row for row in rows if row['factor'] == size], 'right'):.2f}" for size in sizes]
        print(f"| {name} | {' | '.join(cells)} | {even_odds(rows):.2f} |")


def is_good(row: Flight) -> bool:
    """The answer that is wanted; of sizes near the limit, that nothing wrong is said."""
    if row["group"] == "clean":
        return bool(row["verdict"] == "consistent")
    if row["group"] == "unlisted":
        return bool(not row["wrong"] and row["place_right"] > 0.0)
    if row["group"] == "odds":
        return not row["wrong"]
    return bool(row["right"] > 0.0 or (row["group"] == "half" and row["verdict"] == "consistent"))


def _print_parts(groups: dict[str, list[Flight]], calm: list[Flight]) -> None:
    """Good answers by what was drawn."""
    print("\n| good by | value | " + " | ".join(("clean", *groups)) + " |\n" + "|---" * (len(groups) + 3) + "|")
    tables = {"clean": calm} | groups
    for key in ("nominal", "flown_rate", "reference", "variant", "drop"):
        for value in sorted({row[key] for rows in tables.values() for row in rows if row[key] == row[key]}):
            parts = [[row for row in rows if row[key] == value] for rows in tables.values()]
            print(f"| {key} | {value or 'none'} | "
                  + " | ".join(f"{share(part, 'good'):.2f} of {len(part)}" if part else "" for part in parts) + " |")


def answer(row: Flight) -> str:
    """What was said of a flight: the true causes where that is right."""
    if row["verdict"] != "explained":
        return str(row["verdict"])
    return str(row["causes"]) if row["right"] else "+".join(sorted(each.split("/")[0] for each in
                                                                   row["named"].split("+")))


def _print_confusion(groups: dict[str, list[Flight]]) -> None:
    for group in ("twice", "large", "dropped", "unlisted"):
        if groups[group]:
            print(f"\n{group}: truth -> what was said")
        for name in dict.fromkeys(row["causes"] for row in groups[group]):
            counts = Counter(answer(row) for row in groups[group] if row["causes"] == name)
            print(f"  {name} -> " + ", ".join(f"{said} {n}" for said, n in counts.most_common()))


def _print_misses(groups: dict[str, list[Flight]], calm: list[Flight]) -> None:
    """What was not good, one line each."""
    misses = [row for row in (*calm, *(row for rows in groups.values() for row in rows)) if not row["good"]]
    print(f"\nnot good: {len(misses)}" + (f", the first {SHOWN} of each group" if len(misses) > SHOWN else ""))
    seen: Counter[str] = Counter()
    for row in misses:
        seen[row["group"]] += 1
        if seen[row["group"]] <= SHOWN:
            print(f"  {row['group']} {row['causes']} x{row['factor']:g} {row['variant']} {row['nominal']} "
                  f"seed {row['seed']:.0f} {row['flown_rate']:.0f} Hz {row['reference']} {row['drop']}: "
                  f"{row['verdict']} {row.get('where', '')} {row['named']} "
                  f"(nearest {row['nearest']}, {row['evidence']} nats) {row['doubts']}")


def drawn(rows: list[Flight], path: Path) -> None:
    """The confusion matrix of what is clearly visible: listed causes at twice the limit, and unlisted effects."""
    import matplotlib
    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    columns = (*CAUSES, *OTHERS)
    shown = [row for row in rows if row["group"] in ("twice", "unlisted")]
    names = [name for name in (*CAUSES, *UNLISTED) if any(row["causes"] == name for row in shown)]
    counts = np.zeros((len(names), len(columns)))
    for row in shown:
        said = answer(row)
        counts[names.index(row["causes"]), columns.index(said if said in columns else "several")] += 1
    if not shown:
        return
    figure, axes = plt.subplots(figsize=(0.32 * len(columns) + 3, 0.25 * len(names) + 3), layout="constrained")
    part = counts / counts.sum(axis=1, keepdims=True)
    axes.imshow(part, cmap="Greys", vmin=0.0, vmax=1.0, aspect="auto")
    for y, x in zip(*np.nonzero(counts), strict=True):
        axes.text(x, y, f"{counts[y, x]:.0f}", ha="center", va="center", fontsize=7,
                  color="white" if part[y, x] > 0.5 else "black")
    axes.set_xticks(range(len(columns)), columns, rotation=90, fontsize=8)
    axes.set_yticks(range(len(names)), names, fontsize=8)
    axes.axvline(len(CAUSES) - 0.5, color="0.5", lw=0.8)
    axes.axhline(sum(name in CAUSES for name in names) - 0.5, color="0.5", lw=0.8)
    axes.set(xlabel="what the diagnosis said", ylabel="what was hidden",
             title="Listed causes at twice the printed limit; below the line effects that are in no list")
    figure.savefig(path, dpi=150)
    plt.close(figure)


def main() -> int:
    """Fly and print; exit status 1 if a demand is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="4 seeds, a part of the groups: under 20 minutes")
    parser.add_argument("--seeds", type=int, help="of each effect; the groups keep their shares")
    parser.add_argument("--first", type=int, default=0, help="first seed, a multiple of 4: forms and references go in "
                        "fours")
    parser.add_argument("--out", type=Path, default=Path("diagnosis-benchmark"), help="directory of the tables")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    parser.add_argument("--groups", nargs="+", choices=GROUPS, default=list(GROUPS))
    parser.add_argument("--causes", nargs="+", choices=list(CAUSES), default=list(CAUSES))
    parser.add_argument("--nominals", nargs="+", choices=NOMINALS, default=list(NOMINALS))
    parser.add_argument("--rate", type=float, default=0.0, help="Hz of every log; default: drawn from 50, 100, 200")
    args = parser.parse_args()
    if args.first % 4 or args.first < 0:
        parser.error(f"--first {args.first}: not a multiple of 4 from 0 on")
    args.out.mkdir(parents=True, exist_ok=True)
    cases = wanted(args)
    calm = campaign("clean", clean(args, cases), calibrated, args)
    cases = sized(cases, calm)
    rows = campaign("hidden", cases, diagnosed, args) if cases else []
    missed = printed(calm, rows)
    drawn(rows, args.out / "confusion.png")
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
