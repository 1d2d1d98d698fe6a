"""The result of `compare` for several flights: the comparison of each, and how well each nominal predicts them all."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sim.errors import UsageError
from sim.result import Columns

from .answer import Answer
from .comparison import Comparison
from .headline import closing

if TYPE_CHECKING:
    from sim.result import Figure


class Comparisons(Answer):
    """Comparisons of several flights with the same nominals."""

    def __init__(self, flights: Sequence[Comparison]) -> None:
        self.flights = list(flights)
        self.report = {**_words(self.flights), "flights": [{"log": each.log.path, **each.report} for each in flights]}
        self.warnings = tuple(dict.fromkeys(line for each in flights for line in each.warnings))

    def summary(self) -> str:
        """Return the comparison of each flight, then of all."""
        parts = [f"{Path(each.log.path).name}: {each.report['headline']}" for each in self.flights]
        return "\n".join([*parts, *closing(self.report)])

    def columns(self) -> Columns:
        """Return the statistics of each flight's channels, with its name."""
        tables = [(Path(each.log.path).name, each.columns()) for each in self.flights]
        names = list(dict.fromkeys(name for _, table in tables for name in table))
        rows = {name: [x for _, table in tables for x in table.get(name, [None] * _length(table))] for name in names}
        return {"flight": [flight for flight, table in tables for _ in range(_length(table))], **rows}

    def _figure(self) -> "Figure":
        raise UsageError("compare: --plot draws one log; write a report of several")

    def write_report(self, folder: str | Path) -> None:
        """Write the report of each flight into a folder of its name within this one."""
        for each in self.flights:
            each.write_report(Path(folder) / Path(each.log.path).stem)


def _length(table: Columns) -> int:
    return len(next(iter(table.values()), []))


def _words(flights: Sequence[Comparison]) -> dict[str, str]:
    """Return the headline of all flights, and the command to run next."""
    fits: dict[str, list[float]] = {}
    for flight in flights:
        for each in flight.report["nominals"]:
            found: dict[str, Any] = each["channels"].get("theta", {}).get("ahead", {})
            known = {h: one["fit"] for h, one in found.items() if one["fit"] is not None}
            if known:
                fits.setdefault(each["nominal"], []).append(known[max(known, key=float)])
    if not fits:
        return {"headline": "No nominal predicts these flights far enough ahead to be judged.",
                "next": f"launchid show {' '.join(each.log.path for each in flights)}"}
    best = max(fits, key=lambda name: float(np.mean(fits[name])))
    others = ", ".join(f"{name} {np.mean(x):.1f} %" for name, x in fits.items() if name != best)
    worst = min(flights, key=lambda each: each.report["nominals"][0]["channels"].get("theta", {}).get("ahead", {}).get(
        "1", {}).get("fit") or 0.0)
    return {"headline": f"{best} predicts theta of {len(flights)} flights to {np.mean(fits[best]):.1f} % in the mean "
                        f"({np.min(fits[best]):.1f} to {np.max(fits[best]):.1f} %)"
                        + (f", beside {others}" if others else "") + ".", "next": worst.report["next"]}
