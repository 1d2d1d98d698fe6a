"""The figures of `diagnosis.py`: what is demanded of the diagnosis, and what was measured of it."""

import math
from typing import Any, NamedTuple

import numpy as np
from diagnosis_cases import CALM, CAUSES, OTHER, PLAIN, WINDY, Flight, twin

EXCESS = 0.05         # of the floor: a smaller excess of the error is not there to be taken away
WIDTHS = np.geomspace(0.02, 1.0, 40)      # of the odds' rise, in log size
MIDDLES = np.geomspace(0.2, 5.0, 200)     # sizes over the limit, of even odds
NOT_SMOOTH = ("actuator_backlash", "actuator_rate_limit")  # judged by coverage: no bound of theirs holds
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

    @property
    def asked(self) -> str:
        low, high = (self.form.format(x) if math.isfinite(x) else "" for x in (self.low, self.high))
        return f"{low} to {high}" if low and high else f"at least {low}" if low else f"at most {high}" if high else ""

    @property
    def met(self) -> str:
        return "" if not self.flights or not self.asked else "NO" if self.missed else "yes"

    @property
    def said(self) -> str:
        return self.form.format(self.measured) if self.flights else ""


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
    """The share of the excess error over 1 s that the extension took, of flights with a cause in the plant.  A flight
    without the right extension counts as nothing; one whose excess would not be seen is not there."""
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


def over_bound(rows: list[Flight]) -> float:
    """RMS of the sizes' errors over their bounds."""
    ratios = values([row for row in rows if row["causes"] not in NOT_SMOOTH], "over_bound")
    return float(np.sqrt(np.mean(ratios**2))) if len(ratios) else math.nan


def demands(calm: list[Flight], groups: dict[str, list[Flight]], floors: Floors) -> list[Demand]:
    """The issue's, in its order."""
    inf = math.inf
    twice, dropped, half, two, foreign, odds = (groups[name] for name in
                                                ("twice", "dropped", "half", "pairs", "unlisted", "odds"))
    names = {row["causes"] for row in twice}
    worst = min((share([row for row in twice if row["causes"] == name], "right") for name in names), default=math.nan)
    whole = [row for row in calm if not row["drop"]]
    alarms = [row["verdict"] != "consistent" for row in whole]
    hidden = [row for rows in groups.values() for row in rows if row["group"] != "unlisted"]
    seconds, gone = timed(twice), excess_gone(twice, floors)
    plain = [row for row in twice if row["variant"] == PLAIN]
    other = [row for row in twice if row["variant"] == OTHER]
    each = {name: over_bound([row for row in plain if row["causes"] == name]) for name in names}
    over = np.array([ratio for ratio in each.values() if math.isfinite(ratio)])
    return [
        Demand("twice", "right name or set", share(twice, "right"), 0.95, inf, len(twice)),
        Demand("twice", "the worst effect's", worst, 0.90, inf, len(twice)),
        Demand("all but unlisted", "wrong names", share(hidden, "wrong"), -inf, 0.01, len(hidden)),
        Demand("dropped", "right name or set", share(dropped, "right"), 0.90, inf, len(dropped)),
        Demand("clean", "false alarms", mean(np.array(alarms)), -inf, 0.01, len(alarms)),
        Demand("half", "consistent or right", share(half, "good"), 0.98, inf, len(half)),
        Demand("pairs", "both right", share(two, "right"), 0.85, inf, len(two)),
        Demand("pairs", "none wrong", 1.0 - share(two, "wrong"), 0.97, inf, len(two)),
        Demand("unlisted", "wrongly named", share(foreign, "wrong"), -inf, 0.05, len(foreign)),
        Demand("unlisted", "place right", share(foreign, "place_right"), 0.80, inf, len(foreign)),
        Demand("twice, plain form", "RMS size error over the bound", over_bound(plain), -inf, 1.15,
               len(values(plain, "over_bound")), "{:.2f}"),
        Demand("twice, plain form", "the worst effect's", float(over.max()) if len(over) else math.nan, -inf, 1.35,
               len(values(plain, "over_bound")), "{:.2f}"),
        Demand("twice, plain form", "95 % intervals cover", mean(values(plain, "covered")), 0.92, 0.98,
               len(values(plain, "covered"))),
        Demand("twice, other form", "95 % intervals cover", mean(values(other, "covered")), 0.92, 0.98,
               len(values(other, "covered"))),
        Demand("twice", "size error of the deviation, median", median(values(twice, "size_error")), -inf, inf,
               len(values(twice, "size_error"))),
        Demand("twice", "onset error, median, s", median(values(twice, "onset_error")), -inf, 0.5,
               len(values(twice, "onset_error")), "{:.2f}"),
        Demand("twice", "excess 1 s error gone, plant, median", median(gone), 0.90, inf, len(gone)),
        Demand("odds", "even odds over the limit", even_odds(odds) if odds else math.nan, 1 / 1.5, 1.5, len(odds),
               "{:.2f}"),
        Demand("twice", "seconds a log, median", median(seconds), -inf, 6.0, len(seconds), "{:.1f}"),
        Demand("twice", "seconds a log, nine of ten", float(np.percentile(seconds, 90)) if len(seconds) else math.nan,
               -inf, 20.0, len(seconds), "{:.1f}"),
    ]


def columns(of: dict[str, list[Demand]]) -> list[str]:
    """The table with calm and windy air side by side, a line a demand."""
    airs = [air for air in (CALM, WINDY) if air in of]
    head = ["| group | figure | asked |" + "".join(f" {air} | met | flights |" for air in airs),
            "|---|---|---|" + "---|---|---|" * len(airs)]
    rows = [f"| {same[0].group} | {same[0].what} | {same[0].asked} |"
            + "".join(f" {each.said} | {each.met} | {each.flights} |" for each in same)
            for same in zip(*(of[air] for air in airs), strict=True)]
    return [*head, *rows]
