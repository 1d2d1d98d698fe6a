"""The figures of `diagnosis.py`: what is demanded of the diagnosis, and what was measured of it."""

import math
from typing import Any, NamedTuple

import numpy as np
from diagnosis_cases import CAUSES, OTHER, PLAIN, Flight, twin

EXCESS = 0.05         # of the floor: a smaller excess of the error is not there to be taken away
SIZE_WITHIN = 0.15
WIDTHS = np.geomspace(0.02, 1.0, 40)      # of the odds' rise, in log size
MIDDLES = np.geomspace(0.2, 5.0, 200)     # sizes over the limit, of even odds
LOG_RATE = 100.0      # Hz, of the log whose seconds are demanded
Floors = dict[tuple[Any, ...], float]   # twin -> RMS error [rad] over 1 s with nothing wrong


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
    """Of flights with a cause in the plant: how much of the excess error over 1 s the extension took.  A flight without
    the right extension counts as nothing; one whose excess would not be seen is not there."""
    gone = []
    for row in rows:
        if CAUSES[row["causes"]].place != "plant":
            continue
        floor = floors.get(twin(row), math.nan)
        excess = row["before"] - floor
        if not row["right"]:
            gone.append(0.0)
        elif excess > EXCESS * floor:
            gone.append((row["before"] - row["after"]) / excess)
    return np.array(gone)


def timed(twice: list[Flight]) -> np.ndarray:
    """Seconds of the logs of 70 s at LOG_RATE with one cause."""
    return values([row for row in twice if row["nominal"] == "constant" and row["flown_rate"] == LOG_RATE], "seconds")


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
    seconds = timed(twice)
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
        *(each for name in ("twice", "large") for form, rows in forms(groups[name]).items()
          for each in _size_demands(f"{name}{form}", rows, floors)),
        Demand("odds", "even odds over the limit", even_odds(odds) if odds else math.nan, 1 / 1.5, 1.5, len(odds),
               "{:.2f}"),
        Demand("twice", "seconds a log, median", median(seconds), -inf, 5.0, len(seconds), "{:.1f}"),
    ]


def forms(rows: list[Flight]) -> dict[str, list[Flight]]:
    """All of them, and apart those of the contract's physics and those in another form, whose size is the generator's
    convention of what is equal."""
    parts = {f", {name} form": [row for row in rows if row["variant"] == name] for name in (PLAIN, OTHER)}
    return {"": rows} | {name: part for name, part in parts.items() if part}


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
