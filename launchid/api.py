"""The functions of the package `launchid`: each hands its arguments to the result of its command."""

from __future__ import annotations

from typing import TYPE_CHECKING

from launchid.argument_checks import integer
from launchid.log.log import Log
from sim.errors import InputError, UsageError
from sim.sections import Nominal

from .commands import campaign as of_campaign
from .commands import export_c as of_export_c
from .commands import plan as of_plan
from .commands import simulate as of_simulate
from .onboard import onboard_model
from .sources import DataWarning, LogSource, NominalSource, each_of, from_python, load_nominal, read_log

if TYPE_CHECKING:
    from collections.abc import Sequence

    from launchid.comparison.result import Comparison
    from launchid.results.of_logs import Diagnosed, FittedRange, Identification, UncertaintyLevel
    from launchid.results.of_margins import FlightMargins

__all__ = ["DataWarning", "InputError", "Log", "LogSource", "Nominal", "NominalSource", "UsageError", "campaign",
           "compare", "diagnose", "export_c", "fit_lft", "identify", "load_nominal", "margins", "onboard_model", "plan",
           "read_log", "simulate", "uncertainty"]


@from_python
def identify(log: LogSource, nominal: NominalSource | None = None, *, window: float | str = 1.0,
             tracked: bool = False, library: str = "rigid-body", formulation: str | None = None, solver: str = "stls",
             threshold: float | None = None, compression: int = 1, seed: int = 0, noise: str = "estimated",
             strict: bool = False) -> Identification:
    """a6, k1 and the active terms of a log, window by window.

    nominal      what the simulation believes; None: nothing is believed
    window       [s], or "all": the whole log is one
    tracked      also the estimate from all samples so far, and sudden changes
                 (needs a nominal)
    library      candidate terms: a name, or a comma list such as "theta,beta,sin(theta)"
    formulation  measured | difference | integral | filtered; None: the best that log and nominal allow
    solver       stls | sr3 | ssr | lasso
    threshold    a term whose coefficient is smaller, in its own unit, is left out; None: the library's
    compression  keep one of N rows at random, by `seed`
    noise        filtered: the nominal's levels are a prior ("estimated") or exact ("declared")
    """
    from launchid.results import of_logs
    return of_logs.identify(
        read_log(log), None if nominal is None else load_nominal(nominal), window=window, tracked=tracked,
        library=library, formulation=formulation, solver=solver, threshold=threshold, compression=compression,
        seed=seed, noise=noise, strict=strict)


@from_python
def uncertainty(log: LogSource, nominal: NominalSource, *, window: float = 1.0,
                strict: bool = False) -> UncertaintyLevel:
    """Give the place of each parameter in its range, window by window of `window` [s], and the time when it left it."""
    from launchid.results import of_logs
    return of_logs.uncertainty(read_log(log), load_nominal(nominal), window=window, strict=strict)


@from_python
def margins(log: LogSource, nominal: NominalSource, *, window: float = 5.0, tracked: bool = False,
            strict: bool = False) -> FlightMargins:
    """The stability margins of the flight's loop as identified, with 95 % intervals, window by window of `window` [s].

    tracked  also those of the tracked estimate at each window's end
    """
    from launchid.results import of_margins
    return of_margins.margins(read_log(log), load_nominal(nominal), window=window, tracked=tracked, strict=strict)


@from_python
def diagnose(log: LogSource, nominal: NominalSource, *, holdout: LogSource | None = None, bootstrap: int = 0,
             noise: str = "bounded", strict: bool = False) -> Diagnosed:
    """Find why a simulation disagrees with a log, and how much the fix improves its predictions.

    holdout    a second log, to judge the extended model on; None: parts of the first
    bootstrap  so many clean flights of the nominal that are diagnosed too, to count false alarms
    noise      how far levels may be from the declared: "bounded", "declared" or "free"
    """
    from launchid.results import of_logs
    second = None if holdout is None else read_log(holdout, ("t",))
    return of_logs.diagnose(read_log(log, ("t",)), load_nominal(nominal), holdout=second,
                            bootstrap=bootstrap, strict=strict, noise=noise)


@from_python
def compare(log: LogSource, *nominals: NominalSource, flights: int = 200, strict: bool = False) -> Comparison:
    """Hold a log beside nominals: predicted 0.1, 0.5 and 1 s ahead, flown from its reference, its place among dispersed
    flights, frequency responses.

    nominals  one or several, such as a nominal and the extension that `diagnose` made of it
    flights   dispersed ones of each nominal; 0: none
    """
    from launchid.comparison import result
    return result.compare(read_log(log), [load_nominal(nominal) for nominal in nominals],
                          flights=integer("--flights", flights, 0), strict=strict)


@from_python
def fit_lft(logs: Sequence[LogSource], nominal: NominalSource, *, share: float = 0.95, confidence: float = 0.95,
            profile: bool = False, strict: bool = False) -> FittedRange:
    """The range sigma of a6 and k1 that holds a `share` of vehicles with `confidence`, from one log a flight.

    profile  sigma over flight time, where the flights tell it
    """
    from launchid.results import of_logs
    return of_logs.fit_lft([read_log(log) for log in each_of(logs)], load_nominal(nominal), share=share,
                           confidence=confidence, profile=profile, strict=strict)


simulate = from_python(of_simulate.simulate)
plan = from_python(of_plan.plan)
export_c = from_python(of_export_c.export_c)
campaign = from_python(of_campaign.campaign)
