"""The answer of a campaign of flights: campaign."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sim.errors import UsageError
from sim.files import as_path, write_text
from sim.nominal import Nominal
from sim.result import Columns

from ..argument_checks import integer, several
from ..log.check import profile_note
from ..monte_carlo.journal import Row
from ..monte_carlo.requirement.executor import executor_of
from ..monte_carlo.requirement.folder import Flights, fly
from ..monte_carlo.requirement.folder import merge as merged
from ..monte_carlo.requirement.grammar import Requirement, requirement
from ..monte_carlo.requirement.identity import Definition
from ..monte_carlo.requirement.order_statistics import Planned
from ..monte_carlo.requirement.sequential import Sequential
from ..monte_carlo.requirement.verdict import judged, said
from .answer import Answer, flat

if TYPE_CHECKING:
    from sim.result import Figure

VERDICT, PICTURE = "verdict.json", "campaign.png"
STOPS = ("decided", "never")


@dataclass(frozen=True, eq=False)
class Campaign(Answer):
    """Flights, and what they prove."""

    flights: Flights
    requirements: Sequence[Requirement]
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    @property
    def verdict(self) -> str | None:
        """met, not met or undecided, of all requirements; None if nothing was asked."""
        verdict: str | None = self.report["verdict"]
        return verdict

    def summary(self, of: str = "campaign") -> str:
        return said(self.report, of)

    def columns(self) -> Columns:
        rows: list[Row] = [{"seed": seed, **(outcome if isinstance(outcome, dict) else {"error": outcome})}
                           for seed, outcome in zip(self.flights.seeds, self.flights.outcomes, strict=True)]
        return flat(rows)

    def _figure(self) -> "Figure":
        from ..monte_carlo.requirement.figures import campaign_figure
        return campaign_figure(self.report, self.requirements, self.flights)

    def write(self, folder: str | Path) -> None:
        """The verdict, beside the table."""
        write_text(Path(folder) / VERDICT, [self.to_json(), "\n"])


def campaign(nominal: Nominal, *, out: str | PathLike[str], flights: int | None = None,
             requirement: str | Sequence[str] = (), seed: int = 0, stop: str = "decided", executor: str = "local",
             workers: int | None = None, merge: Sequence[str | PathLike[str]] = (),
             progress: Callable[[int], object] | None = None) -> Campaign:
    """Fly a nominal with drawn vehicles and weather, and judge requirements.

    out       folder of the campaign; of one that was interrupted, or is done: it goes on
    flights   at most so many, of the seeds seed, seed + 1, ...
    stop      `decided`: as soon as every requirement is; `never`: all flights are flown, then judged
    executor  `local` or `dask:ADDRESS`;  workers  None: one a core, or all that the scheduler has
    merge     folders of campaigns whose flights are taken; nothing is flown
    progress  called with the number of flights newly done
    """
    asked, merge = _asked(requirement), several("--merge", merge, "a list of folders")
    if stop not in STOPS:
        raise UsageError(f"--stop {stop!r}: expected one of {', '.join(STOPS)}")
    if (flights is None) == (not merge):
        raise UsageError("campaign: expected --flights N, or --merge DIR..." if flights is None else
                         "campaign: --flights and --merge: expected one of them")
    for name, value, least in (("--flights", flights, 1), ("--seed", seed, 0), ("--workers", workers, 1)):
        if value is not None:
            integer(name, value, least)
    nominal.require("actuator", "controller", "guidance", "simulation")
    definition = Definition(nominal, seed, flights or 0, [each.text for each in asked], stop == "never")
    folder = as_path(out)
    if merge:
        definition, table = merged(definition, [as_path(part) for part in merge], folder)
    else:
        with executor_of(executor, workers) as (engine, count):
            table = fly(definition, folder, engine, count, progress)
    notes = () if merge else foreseen(nominal, flights or 0, requirement, stop)
    answer = Campaign(table, asked, judged(definition, asked, table), notes)
    answer.write(folder)
    return answer


def foreseen(nominal: Nominal, flights: int, requirement: str | Sequence[str], stop: str) -> tuple[str, ...]:
    """Notes before the first flight: what a user may have meant otherwise."""
    nominal.require("simulation")
    assert nominal.simulation is not None
    notes = profile_note(nominal, nominal.simulation.duration, "the flight")
    if nominal.uncertainty is None:
        notes += (f"{nominal.path or nominal.name}: no [uncertainty]: every flight is of the nominal a6 and k1",)
    for asked in _asked(requirement):
        rule = (Planned if stop == "never" else Sequential)(asked.probability, asked.confidence)
        least, plan = rule.flights_needed(0), Planned(asked.probability, asked.confidence).flights_needed(0)
        if flights < least:
            notes += (f"{asked.text}: {flights} flights cannot prove it, {least} without a failure would"
                      + (f"; with --stop never {plan} would" if plan < least else ""),)
    return notes


def _asked(texts: str | Sequence[str]) -> list[Requirement]:
    listed = [texts] if isinstance(texts, str) else several("--requirement", texts, "one or a list of texts")
    return [requirement(text) for text in listed]
