"""Estimate a6, k1 and the active terms of a log: `launchid identify`, `launchid.identify`."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from sim.errors import UsageError

from .. import progress
from ..argument_checks import DEFAULT_WINDOW
from ..cli.common import check_outputs, read_nominal, read_noting, reading, tell
from ..cli.options import (
    LOG_HELP,
    NOMINAL_HELP,
    add_choices,
    add_command,
    add_logs,
    add_map,
    add_outputs,
    add_report,
    add_strict,
    given,
    logs_of,
)
from ..log.table import DRIVEN, MOVING
from ..report.answer import Answer, flat

if TYPE_CHECKING:
    from launchid_core import Change, Config, Estimate
    from sim.nominal import Nominal
    from sim.result import Columns, Figure

    from ..identification.control_systems import ControlPlant
    from ..log.log import Log
    from ..report.flights import JointAnswer
    from ..sources import LogSource, LogSources, NominalSource
    from ..weakform.late import Late
    from .margins import FlightMargins


def add(commands: Any) -> None:
    """Add `launchid identify` and its options to argparse's subparsers `commands`."""
    sub = add_command(commands, "identify", "estimate a6, k1 and the active terms of a log, window by window",
                      "launchid identify v.csv --nominal vega_like --window 5 --tracked --plot v.png", identify)
    add_logs(sub, LOG_HELP, f"identify with {NOMINAL_HELP} (default: none, the log alone)")
    sub.add_argument("--window", metavar="S|all",
                     help="set the length of a window [s], or all: one window, the whole log (default %(default)s, at "
                          "most a third of the log)")
    add_choices(sub, "theta,beta,1 without a nominal, else rigid-body")
    sub.add_argument("--tracked", action="store_true",
                     help="also print the tracked estimate (from all samples so far, at each window's end) and sudden "
                          "changes; needs --nominal")
    add_report(sub, "identify.json")
    add_map(sub)
    add_strict(sub)
    add_outputs(sub, plot=True)
    sub.add_argument("--resid", metavar="PATH",
                     help="draw the residuals of the windows, their whiteness, and predictions 0.1, 0.5 and 1 s ahead "
                          "into this .png, .svg or .pdf (default: none)")
    sub.set_defaults(run=run)


def run(args: argparse.Namespace) -> None:
    """Run `launchid identify` with its parsed arguments: print the windows, and write what options ask for."""
    names, nominals = logs_of(args)
    if args.resid and len(names) > 1:
        raise UsageError(f"--resid {args.resid}: draws the residuals of one log; found {len(names)}")
    logs = [read_noting(name, *(MOVING if nominals else DRIVEN), **reading(args)) for name in names]
    nominal = read_nominal(nominals[0]) if nominals else None
    check_outputs(args.json, plots=(args.plot, args.resid), folder=args.report)
    result = identify(logs if len(logs) > 1 else logs[0], nominal, **given(identify, args))
    if args.report:
        result.write_report(args.report)
    if args.resid and isinstance(result, Identification):
        result.residuals(args.resid)
    tell(result, args.json, args.plot)


def identify(log: LogSources, nominal: NominalSource | None = None, *, window: float | str = DEFAULT_WINDOW,
             tracked: bool = False, library: str | None = None, formulation: str | None = None, solver: str = "stls",
             threshold: float | None = None, compression: int = 1, seed: int = 0, noise: str = "estimated",
             strict: bool = False) -> Identification | JointAnswer:
    """Estimate a6, k1 and the active terms of a log, window by window; of several flights, the joint a6 and k1 too.

    Parameters
    ----------
    log : path, data frame, mapping of arrays, Log; or a list of these
        A list: flights of one vehicle, each with its own weather, offsets and start.
    nominal : path, name of a built-in one, or Nominal, optional
        What the simulation believes; None: the log alone.
    window : float or "all"
        Length of a window [s]; "all": the whole log is one.
    tracked : bool
        Also the estimate from all samples so far, and sudden changes; needs a nominal.
    library : str, optional
        Candidate terms: a name, or a comma list such as "theta,beta,sin(theta)"; None: theta and beta, with a constant
        (and rate damping and friction where there is any) without a nominal.
    formulation : str, optional
        measured | difference | integral | filtered; None: the best that log and nominal allow, which without a nominal
        is the weak form under the log's own noise.
    solver : str
        stls | sr3 | ssr | lasso.
    threshold : float, optional
        A term whose coefficient is smaller, in its own unit, is left out; None: the library's.
    compression : int
        Keep one of so many rows at random, by `seed`.
    noise : str
        filtered: the nominal's levels are a prior ("estimated") or exact ("declared").
    strict : bool
        Raise InputError where the data check finds a fault.

    Returns
    -------
    Identification
        Of a list of logs a JointAnswer, which holds that of each.
    """
    from ..identification.log import identified_log
    from ..report.headline import of_identified, shown_path
    from ..report.identification import report_of
    from ..sources import is_several, load_nominal, read_log, several_logs
    nominal = None if nominal is None else load_nominal(nominal)
    required = DRIVEN if nominal is None else MOVING   # a nominal may have no term with theta
    if is_several(log):
        from ..report.flights import joined
        asked: dict[str, Any] = {
            "window": window, "tracked": tracked, "library": library, "formulation": formulation, "solver": solver,
            "threshold": threshold, "compression": compression, "seed": seed, "noise": noise, "strict": strict}
        found = [cast("Identification", identify(each, nominal, **asked))
                 for each in progress.each(several_logs(log, required), "logs identified")]
        return joined(found, nominal) if len(found) > 1 else found[0]
    made = identified_log(read_log(cast("LogSource", log), required), nominal, window=window,
                          tracked=tracked, library=library, formulation=formulation, strict=strict, solver=solver,
                          threshold=threshold, compression=compression, seed=seed, noise=noise)
    log, result = made.log, made.result
    fitted = result.judged.fitted if result.is_weak else result.estimates
    report = report_of(result, tracked)
    believes = None if nominal is None else shown_path(nominal.path or nominal.name)
    report |= of_identified(report, log.path, log.options, believes,
                            nominal is not None and nominal.controller is not None)
    changes = result.estimator.changes() if result.config.formulation == "filtered" else ()
    return Identification(log, nominal, result.config, result.judged.estimates, fitted, report, made.library, changes,
                          made.warnings, result.is_weak, result.judged.late)


@dataclass(frozen=True, eq=False)
class Identification(Answer):
    """Result of `identify`: a6, k1 and the active terms of a log, window by window.

    estimates  of the windows; one that the log contradicts is not valid and has no numbers
    fitted     of the windows as they were fitted, before any was refused, for the residuals
    """

    log: Log
    nominal: Nominal | None
    config: Config
    estimates: list[Estimate]
    fitted: list[Estimate]
    report: dict[str, Any]
    library: str
    changes: tuple[Change, ...] = ()
    warnings: tuple[str, ...] = ()
    is_weak: bool = False   # the numbers are the weak form's
    late: Late | None = None   # how beta acts in them later than it is logged

    def summary(self) -> str:
        from ..report.headline import closing
        from ..report.identification import table
        c = self.config
        how = "weak" if self.is_weak else c.formulation
        head = (f"{self.log.path}: formulation {how}, library {self.library}, solver {c.solver}, window "
                f"{c.window:g} s, period {c.sample_period:g} s, {c.kept_rows} of {c.rows} rows a window")
        shown = {name: value for name, value in self.report.items() if name not in ("why", "next")}
        return "\n".join([head, table(shown) if self.estimates else self.log.too_short(c.window),
                          *closing(self.report)])

    def columns(self) -> Columns:
        return flat(self.report["windows"])

    def _figure(self) -> Figure:
        from ..report.identify_figures import identify_figure
        terms = {term for estimate in self.estimates for term in estimate.terms}
        asked = [name for name, term in (("a6", "theta"), ("k1", "beta")) if term in terms or not self.estimates]
        return identify_figure(self.log, self.report, self.nominal, asked)

    def write_report(self, folder: str | Path) -> None:
        """Write report.html, identify.json and the figures into a folder."""
        from ..report.identify_page import identify_report
        identify_report(self, folder)

    def margins(self) -> FlightMargins:
        """Return the stability margins of the loop as identified anew by `margins`, in windows of this length.

        Raise UsageError unless `filtered` identified a6 and k1 alone (library rigid-body), with a nominal.
        """
        from .margins import FlightMargins, margins
        c, is_tracked = self.config, any("tracked" in window for window in self.report["windows"])
        if self.nominal is None or c.formulation != "filtered" or c.terms != ("theta", "beta"):
            raise UsageError("margins: expected what the formulation `filtered` identified with a nominal, library "
                             "rigid-body")
        found = margins(self.log, self.nominal, window=c.window, tracked=is_tracked)
        assert isinstance(found, FlightMargins)
        return found

    def to_control(self, t: float | None = None) -> ControlPlant:
        """Return the airframe as identified in the window that holds t [s] (None: the last valid one), as
        python-control's StateSpace and TransferFunction, with the covariance of a6 and k1 (extra `control`)."""
        from ..identification.control_systems import control_plant
        return control_plant(self.estimates, self.log.path, t)

    def residuals(self, path: str | Path | None = None) -> Figure:
        """Return a figure of the windows' residuals, their whiteness, and predictions over horizons.

        path  of a .png, .svg or .pdf, which is written too
        """
        from ..identification.residuals import residuals
        nominal = self.nominal if self.config.formulation == "filtered" else None
        left = residuals(self.log, self.fitted, nominal, self.late)

        def figure() -> Figure:
            from ..report.residual_figures import residual_figure
            return residual_figure(self.log, left, self.report["windows"])

        from sim.result import drawn
        return drawn(figure, path)
