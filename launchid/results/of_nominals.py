"""Answers from a nominal alone: simulate, plan, export-c."""

import functools
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from launchid_core import Config, Sample
from sim.effects import Effect, from_table, from_text, values
from sim.errors import UsageError
from sim.files import make_folder, write_text
from sim.flight import Flight, fly_whole
from sim.nominal import Nominal, rewrite_nominal
from sim.result import Columns
from sim.shown import SLOW

from ..argument_checks import WINDOW, integer, real, several
from ..c_export.kit import exported
from ..c_export.vectors import flown
from ..log.check import profile_note
from ..log.log import Log, flown_log, log_of, write_flight
from ..onboard import onboard_model
from ..robustness import level
from ..test_input import Plan
from ..test_input import plan as planned
from .answer import Answer

if TYPE_CHECKING:
    from sim.result import Figure


# ---- simulate

GivenEffect = str | Mapping[str, Any] | Effect
Effects = GivenEffect | Iterable[GivenEffect]


@dataclass(frozen=True, eq=False)
class Flown(Answer):
    """A flight, with its truth."""

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
        """The flight's log, as `read_log` reads what `write` writes."""
        return flown_log(self.flight)

    def columns(self) -> Columns:
        truth = {f"true_{name}": getattr(self.flight, name) for name in ("a6", "k1", "wind")}
        return {name: x.tolist() for name, x in (self.log.measured() | truth).items()}

    def _figure(self) -> "Figure":
        from .figures import flight_figure
        return flight_figure(self.flight, self.nominal)

    def write(self, path: str | Path) -> None:
        """The log, as CSV."""
        write_flight(path, self.flight)


def simulate(nominal: Nominal, *, seed: int = 0, suite: str = "flight", period: float | None = None,
             effects: Effects = ()) -> Flown:
    """Fly a nominal.

    seed     of all noise;  suite `flight` or `ideal`;  period [s] of the log, None: the suite's
    effects  one or several, each as `NAME:PARAMETER=VALUE,...`, as a dict of name and parameters, or an `Effect`
    """
    seed = integer("--seed", seed, 0)
    period = None if period is None else real("--period", period, "a number of seconds")
    chosen = _chosen(effects)
    flight = fly_whole(nominal, seed, suite, period, effects=chosen)
    said = _beside_the_flight(nominal, flight.period, chosen)
    return Flown(flight, nominal, {"rows": len(flight.t), "period": flight.period, "seed": seed, "lost": flight.lost},
                 said)


def _beside_the_flight(nominal: Nominal, period: float, effects: list[Effect]) -> tuple[str, ...]:
    """Notes on what of a flight is not as its user may believe: rows a `period` [s] apart, effects that begin after its
    end."""
    assert nominal.simulation is not None  # else it would not have flown
    end = nominal.simulation.duration
    said = profile_note(nominal, end, "the flight")
    if period > SLOW:
        said += (f"{nominal.path}: rows {period:g} s apart (sensors.period {nominal.sensors.period:g} s): no launcher "
                 f"is logged as slowly, expected at most {SLOW:g} s",)
    begins = {each.name: time for each in (*nominal.effects, *effects)
              if isinstance(time := values(each).get("time"), float) and time >= end}
    return said + tuple(f"{name} begins at {time:g} s, after the flight's end at {end:g} s: it is not in the log"
                        for name, time in begins.items())


def _chosen(effects: Effects) -> list[Effect]:
    listed = [effects] if isinstance(effects, (str, Mapping, Effect)) else several(
        "--effect", effects, "one or a list of effects such as 'gyro_bias:rate=0.01'")
    return [_effect(each) for each in listed]


def _effect(given: object) -> Effect:
    """An effect from a text, from a dict as in a nominal's [[effects]], or as it is."""
    if isinstance(given, Effect):
        return given
    if isinstance(given, str):
        return from_text(given)
    if isinstance(given, Mapping):
        return from_table(dict(given))
    raise UsageError(f"--effect {given!r}: expected a text such as 'gyro_bias:rate=0.01' or a dict such as "
                     "{'name': 'gyro_bias', 'rate': 0.01}")


# ---- plan


@dataclass(frozen=True, eq=False)
class Planned(Answer):
    """A test input, and what it buys."""

    plan: Plan
    window: float
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    @property
    def nominal(self) -> Nominal:
        """The nominal with its [test_input]."""
        return self.plan.nominal

    def summary(self, of: str = "test input") -> str:
        plan, multisine = self.plan, self.plan.nominal.test_input
        head = (f"smallest possible standard deviation (Cramer-Rao bound) of the less certain of a6 and k1, median of "
                f"{self.window:g} s windows: {100 * plan.before:.3g} % without a test input, {100 * plan.after:.3g} % "
                "with it")
        if multisine is None:
            return f"{head}\n{of}: no test input needed"
        sines = ", ".join(f"{a:.3g} rad at {f:.3g} rad/s"
                          for a, f in zip(multisine.amplitude, multisine.frequency, strict=True))
        return f"{head}\n{of}: test input of {sines}; {plan.root_mean_square:.2e} rad rms, peak {plan.peak:.2e} rad"

    def columns(self) -> Columns:
        names, multisine = ("frequency", "amplitude", "phase"), self.plan.nominal.test_input
        return {name: [] if multisine is None else list(getattr(multisine, name)) for name in names}

    def _figure(self) -> "Figure":
        from .figures import plan_figure
        return plan_figure(self.plan)

    def write(self, path: str | Path) -> None:
        """The nominal, as TOML: the file that it came from, with what is new."""
        rewrite_nominal(self.nominal, path)


def plan(nominal: Nominal, *, accuracy: float, window: float) -> Planned:
    """Design the smallest test input that reaches `accuracy` (relative, one sigma) in windows of `window` [s]."""
    accuracy = real("--accuracy", accuracy, "a relative accuracy such as 0.01")
    designed = planned(nominal, accuracy, real("--window", window, "a number of seconds"))
    multisine = designed.nominal.test_input
    names = ("start", "duration", "frequency", "amplitude", "phase")
    return Planned(designed, window, {
        "before": designed.before, "after": designed.after, "rms": designed.root_mean_square, "peak": designed.peak,
        "test_input": None if multisine is None else {name: getattr(multisine, name) for name in names}})


# ---- export-c


@dataclass(frozen=True, eq=False)
class Exported(Answer):
    """The estimator in C."""

    files: dict[str, str]
    config: Config
    samples: list[Sample]   # of the vectors that it is checked with
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    def summary(self, of: str = "C files") -> str:
        proof = "; make check" if "check.c" in self.files else ""
        return f"{of}: {', '.join(self.files)}; cc -std=c99 -O2 -ffp-contract=off launchid.c{proof}"

    def columns(self) -> Columns:
        return {"file": list(self.files), "lines": [text.count("\n") for text in self.files.values()]}

    def _figure(self) -> "Figure":
        columns = dict(zip(Sample._fields, np.array(self.samples).T, strict=True))
        known = {name: x for name, x in columns.items() if np.isfinite(x).any()}
        return log_of(known, "vectors.h")._figure()

    def write(self, folder: str | Path) -> None:
        """The files, into a folder that is made if need be."""
        place = make_folder(folder)
        for name, text in self.files.items():
            write_text(place / name, [text])


def export_c(nominal: Nominal, *, window: float = WINDOW, period: float | None = None, formulation: str | None = None,
             **choices: Any) -> Exported:
    """The estimator for this nominal as C files; `window` and `period` (None: the nominal's) in s."""
    formulation = formulation or "filtered"
    model = None
    if formulation == "filtered":
        model = level.ranged_model(nominal) if nominal.uncertainty is not None else onboard_model(nominal)
    try:
        config = Config(window=window, sample_period=nominal.sensors.period if period is None else period,
                        formulation=formulation, model=model, **choices)
    except ValueError as error:
        raise UsageError(str(error)) from None
    except TypeError as error:  # of Python's: a word that is none of Config's
        raise UsageError(f"export-c: {str(error).removeprefix('Config.__init__() ')}") from None
    samples = flown(nominal, config)
    files = exported(config, samples)
    return Exported(files, config, samples, {"files": list(files)})
