"""Fly a nominal and write its log: `launchid simulate`, `launchid.simulate`."""

from __future__ import annotations

import argparse
import functools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sim.errors import UsageError

from ..argument_checks import integer, real, several
from ..cli.common import at_least, check_outputs, read_nominal, warn
from ..cli.options import NOMINAL_HELP, add_command, given
from ..cli.terminal import say
from ..formatting import SLOWEST_PERIOD
from ..progress import report
from ..report.answer import Answer

if TYPE_CHECKING:
    from pathlib import Path

    from sim.effects import Effect
    from sim.flight import Flight
    from sim.nominal import Nominal
    from sim.result import Columns, Figure

    from ..log.log import Log
    from ..sources import NominalSource

    GivenEffect = str | Mapping[str, Any] | Effect
    Effects = GivenEffect | Iterable[GivenEffect]


def add(commands: Any) -> None:
    """Add `launchid simulate` and its options to argparse's subparsers `commands`."""
    sub = add_command(commands, "simulate", "fly a nominal and write its log",
                      "launchid simulate vega_like --out v.csv --seed 3 --effect control_loss:fraction=0.3,time=60",
                      simulate)
    sub.add_argument("nominal", metavar="NOMINAL.toml", help=f"fly {NOMINAL_HELP}")
    sub.add_argument("--out", required=True, metavar="LOG.csv", help="write the log to this file")
    sub.add_argument("--seed", type=int, metavar="N",
                     help="seed all random draws, 0 or above; the same seed gives the same bytes (default %(default)s)")
    sub.add_argument("--suite", choices=["flight", "ideal"],
                     help="log what the nominal's sensors measure (flight), or the truth with theta_ddot (ideal) "
                          "(default %(default)s)")
    sub.add_argument("--period", type=float, metavar="S",
                     help="set the time between rows [s], a multiple of the simulation's step (default: the nominal's "
                          "sensor period; ideal: the step)")
    sub.add_argument("--effect", action="append", dest="effects", metavar="NAME:PARAMETER=VALUE[,PARAMETER=VALUE...]",
                     help="add an effect of the catalogue, see launchid effects; may be given several times (default: "
                          "none)")
    sub.add_argument("--believed", metavar="NOMINAL.toml",
                     help="nominal of the estimator on board, which filters with follow ask (default: the one that "
                          "flies)")
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid simulate` with its parsed arguments: fly the nominal, and write its log."""
    at_least("--seed", args.seed, 0)
    nominal = read_nominal(args.nominal)
    check_outputs(args.out)
    args.believed = None if args.believed is None else read_nominal(args.believed)
    report(f"flying {nominal.name}")
    result = simulate(nominal, **given(simulate, args))
    report(f"writing {args.out}")
    result.write(args.out)
    warn(result)
    say(result.summary(args.out))


def simulate(nominal: NominalSource, *, seed: int = 0, suite: str = "flight", period: float | None = None,
             effects: Effects = (), believed: NominalSource | None = None) -> Flown:
    """Fly a nominal, and return the flight with its truth.

    Parameters
    ----------
    nominal : path, name of a built-in one, or Nominal
    seed : int
        Of all noise, from 0 on.
    suite : str
        "flight": the nominal's sensors; "ideal": the truth.
    period : float, optional
        Time between rows [s]; None: the suite's own.
    effects : one or several
        Causes of the catalogue, each "NAME:PARAMETER=VALUE,...", a dict such as {"name": "gyro_bias", "rate": 0.01}, or
        an `Effect`.
    believed : path, name of a built-in one, or Nominal, optional
        That of the estimator on board, which filters with `follow` ask; None: the one that flies.

    Returns
    -------
    Flown
    """
    from sim.flight import fly_whole

    from ..sources import load_nominal
    nominal = load_nominal(nominal)
    seed = integer("--seed", seed, 0)
    period = None if period is None else real("--period", period, "a number of seconds")
    chosen = _chosen(effects)
    flight = fly_whole(nominal, seed, suite, period, effects=chosen,
                       believed=None if believed is None else load_nominal(believed))
    said = _beside_the_flight(nominal, flight.period, chosen)
    return Flown(flight, nominal, {"rows": len(flight.t), "period": flight.period, "seed": seed, "lost": flight.lost},
                 said)


@dataclass(frozen=True, eq=False)
class Flown(Answer):
    """Result of `simulate`: a flight, with its truth."""

    flight: Flight
    nominal: Nominal
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    def summary(self, of: str = "flight") -> str:
        r = self.report
        return (f"{of}: {r['rows']} rows, {r['period']:g} s apart, seed {r['seed']}"
                + ("; the vehicle was LOST and the log ends there" if r["lost"] else ""))

    @functools.cached_property
    def log(self) -> Log:
        """Return the flight as the log that `read_log` would read from the written file."""
        from ..log.log import flown_log
        return flown_log(self.flight)

    def columns(self) -> Columns:
        truth = {f"true_{name}": getattr(self.flight, name) for name in ("a6", "k1", "wind")}
        return {name: x.tolist() for name, x in (self.log.measured() | truth).items()}

    def _figure(self) -> Figure:
        from ..report.flight_figures import flight_figure
        return flight_figure(self.flight, self.nominal)

    def write(self, path: str | Path) -> None:
        """Write the log as CSV to `path`."""
        from ..log.log import write_flight
        write_flight(path, self.flight)


def _beside_the_flight(nominal: Nominal, period: float, effects: list[Effect]) -> tuple[str, ...]:
    """Return notes on what a user may not expect: rows a `period` [s] apart, effects that begin after the end."""
    from sim.effects import values

    from ..log.check import profile_note
    assert nominal.simulation is not None  # else it would not have flown
    end = nominal.simulation.duration
    said = profile_note(nominal, end, "the flight")
    if period > SLOWEST_PERIOD:
        said += (f"{nominal.path}: rows {period:g} s apart (sensors.period {nominal.sensors.period:g} s): no launcher "
                 f"is logged as slowly, expected at most {SLOWEST_PERIOD:g} s",)
    begins = {each.name: time for each in (*nominal.effects, *effects)
              if isinstance(time := values(each).get("time"), float) and time >= end}
    return said + tuple(f"{name} begins at {time:g} s, after the flight's end at {end:g} s: it is not in the log"
                        for name, time in begins.items())


def _chosen(effects: Effects) -> list[Effect]:
    from sim.effects import Effect
    listed = [effects] if isinstance(effects, (str, Mapping, Effect)) else several(
        "--effect", effects, "one or a list of effects such as 'gyro_bias:rate=0.01'")
    return [_effect(each) for each in listed]


def _effect(given: object) -> Effect:
    """Return an effect given as a text, a dict (as in a nominal's [[effects]]) or an `Effect`; else UsageError."""
    from sim.effects import Effect, from_table, from_text
    if isinstance(given, Effect):
        return given
    if isinstance(given, str):
        return from_text(given)
    if isinstance(given, Mapping):
        return from_table(dict(given))
    raise UsageError(f"--effect {given!r}: expected a text such as 'gyro_bias:rate=0.01' or a dict such as "
                     "{'name': 'gyro_bias', 'rate': 0.01}")
