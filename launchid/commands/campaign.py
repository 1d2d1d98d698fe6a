"""Monte Carlo campaigns that prove requirements: `launchid campaign`, `launchid.campaign`."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sim.errors import UsageError, extra_needed

from ..argument_checks import integer, several
from ..cli.common import check_outputs, read_nominal
from ..cli.options import NOMINAL_HELP, add_command, given
from ..cli.terminal import answer, say
from ..progress import Counter
from ..report.answer import Answer, flat

if TYPE_CHECKING:
    from sim.nominal import Nominal
    from sim.result import Columns, Figure

    from ..monte_carlo.journal import Row
    from ..monte_carlo.requirement.folder import Flights
    from ..monte_carlo.requirement.grammar import Requirement
    from ..sources import NominalSource

VERDICT, PICTURE = "verdict.json", "campaign.png"
STOPS = ("decided", "never")
SCHEDULER_TIMEOUT = 10.0  # s, for a scheduler to answer
EXECUTOR_FORM = "expected local, or dask:ADDRESS such as dask:tcp://node1:8786"


def check_executor(text: str) -> None:
    """Raise UsageError unless the text is an executor: "local" or "dask:ADDRESS"."""
    if text != "local" and not (text.startswith("dask:") and len(text) > len("dask:")):
        raise UsageError(f"--executor {text!r}: {EXECUTOR_FORM}")


@contextlib.contextmanager
def executor_of(text: str, workers: int | None) -> Iterator[tuple[Executor | None, int | None]]:
    """Give (executor, number of its workers) in this context: of a dask scheduler, UsageError if none answers; for
    "local" (None, workers), since the campaign makes its own processes."""
    check_executor(text)
    if text == "local":
        yield None, workers
        return
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise extra_needed(error) from None
    address = text.removeprefix("dask:")
    try:
        client = Client(address, timeout=SCHEDULER_TIMEOUT)
    except (OSError, ValueError) as error:
        raise UsageError(f"--executor {text}: no scheduler answers there ({type(error).__name__}); "
                         f"{EXECUTOR_FORM}") from None
    with client:
        threads = sum(client.nthreads().values())
        if threads == 0:
            raise UsageError(f"--executor {text}: the scheduler has no workers")
        yield client.get_executor(), workers or threads


def add(commands: Any) -> None:
    """Add `launchid campaign` and its options to argparse's subparsers `commands`."""
    sub = add_command(commands, "campaign", "fly many randomly drawn vehicles, and prove a requirement",
                      "launchid campaign vega_like --flights 10000 --requirement 'lost<0.00135@0.9' --out proof",
                      campaign)
    sub.add_argument("nominal", metavar="NOMINAL.toml", help=f"fly {NOMINAL_HELP}")
    sub.add_argument("--flights", type=int, metavar="N",
                     help="fly at most this many, one a seed (default: none, required unless --merge)")
    sub.add_argument("--out", required=True, metavar="DIR",
                     help="write flights.csv, verdict.json and, with launchid[plots], campaign.png into this folder; "
                          "an interrupted campaign in it is continued")
    sub.add_argument("--requirement", action="append", metavar="TEXT",
                     help="prove this: lost<PROBABILITY@CONFIDENCE, or METRIC<VALUE:SHARE@CONFIDENCE with "
                          "METRIC one of max_theta_error | max_theta_dot | max_alpha | max_beta | max_beta_rate; "
                          "may be given several times (default: none)")
    sub.add_argument("--stop", choices=STOPS,
                     help="stop at the first flight that decides every requirement, by a sequential test (decided), or "
                          "fly all N and judge them by order statistics (never) (default %(default)s)")
    sub.add_argument("--seed", type=int, metavar="N",
                     help="set the seed of the first flight, 0 or above; each next flight has the next seed (default "
                          "%(default)s)")
    sub.add_argument("--executor", metavar="local|dask:ADDRESS",
                     help="fly in processes of this machine (local), or on the workers of a dask scheduler such as "
                          "dask:tcp://node1:8786, which needs launchid[cluster] (default %(default)s)")
    sub.add_argument("--workers", type=int, metavar="N", help="use this many processes (default: one a core)")
    sub.add_argument("--merge", nargs="+", metavar="DIR",
                     help="fly nothing, and judge the flights of these campaigns' folders, such as a job array's "
                          "(default: none)")
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid campaign` with its parsed arguments: fly into the folder --out, and print the verdict."""
    check_executor(args.executor)
    nominal = read_nominal(args.nominal)
    check_outputs(folder=args.out)
    is_flown = not args.merge and (args.flights or 0) > 0
    for line in foreseen(nominal, args.flights, args.requirement, args.stop) if is_flown else ():
        say(line)
    args.progress = progress = Counter(args.flights or 1, "flights")
    try:
        result = campaign(nominal, **given(campaign, args))
    except KeyboardInterrupt:
        if progress.done > 0:
            say(f"{args.out}: {progress.done} flights are kept; the same command goes on from there")
        raise
    try:
        result.plot(f"{args.out}/{PICTURE}")
    except UsageError as error:
        say(f"{args.out}: no {PICTURE}: {error}")
    answer(result.summary(args.out))


def campaign(nominal: NominalSource, *, out: str | PathLike[str], flights: int | None = None,
             requirement: str | Sequence[str] = (), seed: int = 0, stop: str = "decided", executor: str = "local",
             workers: int | None = None, merge: Sequence[str | PathLike[str]] = (),
             progress: Callable[[int], object] | None = None) -> Campaign:
    """Fly many randomly drawn vehicles of a nominal, and prove requirements; a folder with flights is continued.

    Parameters
    ----------
    nominal : path, name of a built-in one, or Nominal
    out : path
        Folder of the campaign; one that was interrupted or is done is continued.
    flights : int, optional
        At most so many, one a seed from `seed` on; required unless `merge` is given.
    requirement : str, or several
        Such as "lost<0.00135@0.9" or "max_alpha<0.2:0.99@0.9".
    seed : int
        Of the first flight.
    stop : str
        "decided": as soon as every requirement is; "never": all `flights` are flown, then judged.
    executor : str
        "local", or "dask:ADDRESS".
    workers : int, optional
        Processes; None: one a core, or all that the scheduler has.
    merge : paths
        Folders of campaigns to judge together; nothing is flown.
    progress : callable, optional
        Called with the number of flights newly done.

    Returns
    -------
    Campaign
    """
    from sim.files import as_path

    from ..monte_carlo.requirement.folder import Definition, fly
    from ..monte_carlo.requirement.folder import merge as merged
    from ..monte_carlo.requirement.verdict import judged
    from ..sources import load_nominal
    nominal = load_nominal(nominal)
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
    made = Campaign(table, asked, judged(definition, asked, table), notes)
    made.write(folder)
    return made


@dataclass(frozen=True, eq=False)
class Campaign(Answer):
    """Result of `campaign`: the flights, the requirements, and whether they are met."""

    flights: Flights
    requirements: Sequence[Requirement]
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    @property
    def verdict(self) -> str | None:
        """"met", "not met" or "undecided" for all requirements together; None if there are none."""
        verdict: str | None = self.report["verdict"]
        return verdict

    def summary(self, of: str = "campaign") -> str:
        from ..monte_carlo.requirement.verdict import said
        return said(self.report, of)

    def columns(self) -> Columns:
        rows: list[Row] = [{"seed": seed, **(outcome if isinstance(outcome, dict) else {"error": outcome})}
                           for seed, outcome in zip(self.flights.seeds, self.flights.outcomes, strict=True)]
        return flat(rows)

    def _figure(self) -> Figure:
        from ..report.campaign_figures import campaign_figure
        return campaign_figure(self.report, self.requirements, self.flights)

    def write(self, folder: str | Path) -> None:
        """Write verdict.json into the folder."""
        from sim.files import write_text
        write_text(Path(folder) / VERDICT, [self.to_json(), "\n"])


def foreseen(nominal: Nominal, flights: int, requirement: str | Sequence[str], stop: str) -> tuple[str, ...]:
    """Return notes for the user before the first flight: a short profile, no range, too few flights for a proof."""
    from ..log.check import profile_note
    from ..monte_carlo.requirement.sequential import Planned, Sequential
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
    from ..monte_carlo.requirement import grammar
    listed = [texts] if isinstance(texts, str) else several("--requirement", texts, "one or a list of texts")
    return [grammar.requirement(text) for text in listed]
