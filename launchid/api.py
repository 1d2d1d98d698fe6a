"""The functions of the package `launchid`: each hands its arguments to the result of its command."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from launchid.argument_checks import integer
from launchid.log.log import Log
from sim.errors import InputError, UsageError
from sim.sections import Nominal

from .argument_checks import WINDOW
from .onboard import onboard_model
from .sources import DataWarning, LogSource, NominalSource, each_of, from_python, load_nominal, read_log

if TYPE_CHECKING:
    from collections.abc import Sequence
    from os import PathLike

    from launchid.comparison.result import Comparison
    from launchid.results.of_campaigns import Campaign
    from launchid.results.of_logs import Diagnosed, FittedRange, Identification, UncertaintyLevel
    from launchid.results.of_margins import FlightMargins
    from launchid.results.of_nominals import Effects, Exported, Flown, Planned

__all__ = ["DataWarning", "InputError", "Log", "LogSource", "Nominal", "NominalSource", "UsageError", "campaign",
           "compare", "diagnose", "export_c", "fit_lft", "identify", "load_nominal", "margins", "onboard_model", "plan",
           "read_log", "simulate", "uncertainty"]


@from_python
def identify(log: LogSource, nominal: NominalSource | None = None, *, window: float | str = WINDOW,
             tracked: bool = False, library: str | None = None, formulation: str | None = None, solver: str = "stls",
             threshold: float | None = None, compression: int = 1, seed: int = 0, noise: str = "estimated",
             strict: bool = False) -> Identification:
    """a6, k1 and the active terms of a log, window by window.

    nominal      what the simulation believes; None: nothing is believed
    window       [s], or "all": the whole log is one
    tracked      also the estimate from all data so far, followed from block to block, and sudden changes
                 (needs a nominal)
    library      candidate terms: a name, or a comma list such as "theta,beta,sin(theta)"; None: theta, beta, with a
                 constant (and rate damping where there is any) without a nominal
    formulation  measured | difference | integral | filtered; None: the best that log and nominal allow, which without
                 a nominal is the weak form under the log's own noise
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
def uncertainty(log: LogSource, nominal: NominalSource, *, window: float = WINDOW,
                strict: bool = False) -> UncertaintyLevel:
    """Give the place of each parameter in its range, window by window of `window` [s], and the time when it left it."""
    from launchid.results import of_logs
    return of_logs.uncertainty(read_log(log), load_nominal(nominal), window=window, strict=strict)


@from_python
def margins(log: LogSource, nominal: NominalSource, *, window: float = WINDOW, tracked: bool = False,
            strict: bool = False) -> FlightMargins:
    """The stability margins of the flight's loop as identified, with 95 % intervals, window by window of `window` [s].

    tracked  also those of the tracked estimate at each window's end
    """
    from launchid.results import of_margins
    return of_margins.margins(read_log(log), load_nominal(nominal), window=window, tracked=tracked, strict=strict)


@from_python
def diagnose(log: LogSource, nominal: NominalSource, *, holdout: LogSource | None = None, bootstrap: int = 0,
             noise: str = "bounded", strict: bool = False) -> Diagnosed:
    """Names what the simulation gets wrong on a log, and what fixing it gains.

    holdout    a second log, to judge the extended model on; None: parts of the first
    bootstrap  measure the threshold on so many clean flights of the nominal; 0: the built-in one
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


@from_python
def simulate(nominal: NominalSource, *, seed: int = 0, suite: str = "flight", period: float | None = None,
             effects: Effects = ()) -> Flown:
    """Fly a nominal.

    seed     of all noise, from 0 on
    suite    "flight": the nominal's sensors; "ideal": the truth
    period   between rows [s]; None: the suite's own
    effects  one or several causes of the catalogue, each "NAME:PARAMETER=VALUE,...", a dict such as
             {"name": "gyro_bias", "rate": 0.01}, or an `Effect`
    """
    from launchid.results import of_nominals
    return of_nominals.simulate(load_nominal(nominal), seed=seed, suite=suite, period=period, effects=effects)


@from_python
def plan(nominal: NominalSource, *, accuracy: float, window: float) -> Planned:
    """The smallest test input that reaches `accuracy` (relative, one sigma) in windows of `window` [s]."""
    from launchid.results import of_nominals
    return of_nominals.plan(load_nominal(nominal), accuracy=accuracy, window=window)


@from_python
def export_c(nominal: NominalSource, *, window: float = WINDOW, period: float | None = None,
             **choices: Any) -> Exported:
    """The estimator in C, with the same bits; window, period (None: the nominal's) in s, choices as `identify`'s."""
    from launchid.results import of_nominals
    return of_nominals.export_c(load_nominal(nominal), window=window, period=period, **choices)


@from_python
def campaign(nominal: NominalSource, *, out: str | PathLike[str], flights: int | None = None,
             requirement: str | Sequence[str] = (), seed: int = 0, stop: str = "decided", executor: str = "local",
             workers: int | None = None, merge: Sequence[str | PathLike[str]] = ()) -> Campaign:
    """Fly many drawn vehicles of a nominal into the folder `out`, and prove requirements; where it was, it goes on.

    flights      at most so many, one a seed from `seed` on
    requirement  "lost<0.00135@0.9", "max_alpha<0.2:0.99@0.9", or several
    stop         "decided": as soon as every requirement is; "never": `flights` is a plan, all are flown
    executor     "local", or "dask:ADDRESS";  workers  None: one a core
    merge        folders of campaigns to judge together; nothing is flown
    """
    from launchid.results import of_campaigns
    return of_campaigns.campaign(
        load_nominal(nominal), out=out, flights=flights, requirement=requirement, seed=seed, stop=stop,
        executor=executor, workers=workers, merge=merge)
