"""Answers from logs: identify, uncertainty, diagnose, fit-lft."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from launchid_core import Change, Config, Estimate
from sim.errors import InputError, UsageError
from sim.nominal import Nominal, rewrite_nominal
from sim.result import Columns, drawn

from .. import progress
from ..argument_checks import integer, real, word
from ..cli.options import WITHIN
from ..diagnosis.answer import extension
from ..diagnosis.answer import lines as diagnosis_lines
from ..diagnosis.answer import report as diagnosis_report
from ..diagnosis.verdict import Result
from ..diagnosis.verdict import diagnose as examine
from ..identification.windows import identified, log_config, report_of, servo_note, table
from ..log.check import data_warnings, faults, foreign, ideal_note, profile_note, warned
from ..log.log import Log
from ..robustness import greybox, level
from .answer import Answer, flat
from .residuals import residuals

if TYPE_CHECKING:
    from sim.result import Figure

    from .control_systems import ControlPlant
    from .of_margins import FlightMargins


# ---- identify


@dataclass(frozen=True, eq=False)
class Identification(Answer):
    """a6, k1 and the active terms of a log, window by window."""

    log: Log
    nominal: Nominal | None
    config: Config
    estimates: list[Estimate]
    report: dict[str, Any]
    library: str
    changes: tuple[Change, ...] = ()
    warnings: tuple[str, ...] = ()

    def summary(self) -> str:
        c = self.config
        head = (f"{self.log.path}: formulation {c.formulation}, library {self.library}, solver {c.solver}, "
                f"window {c.window:g} s, period {c.sample_period:g} s, {c.kept_rows} of {c.rows} rows a window")
        return "\n".join([head, table(self.report) if self.estimates else _too_short(self.log, c.window)])

    def columns(self) -> Columns:
        return flat(self.report["windows"])

    def _figure(self) -> "Figure":
        from .figures import identify_figure
        terms = {term for estimate in self.estimates for term in estimate.terms}
        asked = [name for name, term in (("a6", "theta"), ("k1", "beta")) if term in terms or not self.estimates]
        return identify_figure(self.log, self.report, self.nominal, asked)

    def write_report(self, folder: str | Path) -> None:
        """report.html, identify.json and the figures."""
        from .reports import identify_report
        identify_report(self, folder)

    def margins(self) -> "FlightMargins":
        """The stability margins of the loop as identified, with the nominal's controller."""
        from .of_margins import margins_of
        c, is_tracked = self.config, any("tracked" in window for window in self.report["windows"])
        if self.nominal is None or c.formulation != "filtered" or c.terms != ("theta", "beta"):
            raise UsageError("margins: expected what the formulation `filtered` identified with a nominal, library "
                             "rigid-body")
        return margins_of(self.log, self.nominal, c, self.estimates, self.changes, is_tracked)

    def to_control(self, t: float | None = None) -> "ControlPlant":
        """The airframe as identified in the window that holds t [s], None: in the last valid one, as python-control's
        StateSpace and TransferFunction, with the covariance of a6 and k1 (extra `control`)."""
        from .control_systems import control_plant
        return control_plant(self.estimates, self.log.path, t)

    def residuals(self, path: str | Path | None = None) -> "Figure":
        """A figure of the windows' residuals, whether they are white, and predictions over horizons."""
        left = residuals(self.log, self.estimates, self.nominal if self.config.formulation == "filtered" else None)

        def figure() -> "Figure":
            from .figures import residual_figure
            return residual_figure(self.log, left, self.report["windows"])

        return drawn(figure, path)


def _too_short(log: Log, window: float) -> str:
    t = log.t[np.isfinite(log.t)]
    if reason := log.unusable():
        return f"no window of {window:g} s is complete: {reason}"
    return (f"no window of {window:g} s is complete: the log has {len(t)} rows over {np.ptp(t):.4g} s; "
            "expected a longer log, or a smaller window")


def identify(log: Log, nominal: Nominal | None = None, *, window: float | str = 1.0, formulation: str | None = None,
             tracked: bool = False, strict: bool = False, library: str = "rigid-body",
             **choices: Any) -> Identification:
    """Identify a log.

    window   [s], or `all`;  strict: what the data check finds is an InputError
    choices  further fields of `launchid_core.Config`
    """
    window = window if isinstance(window, str) else real("--window", window, "seconds or 'all'")
    noted = faults(log, nominal)
    said = warned(log, noted, strict) + ideal_note(log)
    config = log_config(log, nominal, str(window), formulation, tracked, library=library, **choices)
    if config.missing_commands > 0.0:
        said += (f"{log.path}: slower than the controller: the commands between its rows are taken as held, and the "
                 "standard deviations are wider for it",)
    if config.formulation == "filtered":
        said += servo_note(log, nominal, config)
    if config.formulation == "filtered" and not foreign(noted):
        said += profile_note(nominal, level.log_span(log)[1], log.path)
    result = identified(config, log, foreign(noted), any(fault.kind == "motion" for fault in noted))
    if result.is_held:
        said += (f"{log.path}: beta is integrated as held from each of its values to the next",)
    return Identification(log, nominal, result.config, result.estimates, report_of(result, tracked), library,
                          result.estimator.changes() if config.formulation == "filtered" else (), said)


# ---- uncertainty


@dataclass(frozen=True, eq=False)
class UncertaintyLevel(Answer):
    """The place of each parameter in its range, window by window."""

    log: Log
    nominal: Nominal
    window: float
    estimates: list[Estimate]
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    def summary(self) -> str:
        head = (f"{self.log.path}: delta of a = a0*(1 + sigma*delta) from the tracked estimate, "
                f"window {self.window:g} s, period {self.log.period:g} s, range of {self.nominal.name}")
        return "\n".join([head, level.table(self.estimates) if self.estimates else _too_short(self.log, self.window)])

    def columns(self) -> Columns:
        return flat(self.report["windows"])

    def _figure(self) -> "Figure":
        from .figures import uncertainty_figure
        return uncertainty_figure(self.log, self.estimates, self.nominal)


def uncertainty(log: Log, nominal: Nominal, *, window: float = 1.0, strict: bool = False) -> UncertaintyLevel:
    """Follow the uncertainty level of a log; `window` in s."""
    said = data_warnings(log, nominal, strict)
    try:
        estimates = level.follow(log, nominal, window)
    except ValueError as error:
        raise UsageError(str(error)) from None
    return UncertaintyLevel(log, nominal, window, estimates, level.report(estimates), said)


# ---- diagnose


@dataclass(frozen=True, eq=False)
class Diagnosed(Answer):
    """The answer of `diagnose`: what the simulation gets wrong on a log, and why."""

    diagnosis: Result
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    @property
    def verdict(self) -> str:
        return str(self.report["verdict"])

    @property
    def extension(self) -> Nominal | None:
        """The nominal with the named causes, if any."""
        return extension(self.diagnosis)

    def summary(self) -> str:
        return "\n".join(diagnosis_lines(self.diagnosis))

    def columns(self) -> Columns:
        rows = [{"cause": cause["cause"], "where": cause["where"], "parameter": name, **value}
                for cause in self.report["causes"] for name, value in cause["parameters"].items()]
        return flat(rows) or {name: [] for name in ("cause", "where", "parameter", "value", "std", "unit")}

    def _figure(self) -> "Figure":
        from ..diagnosis.report.figures import DRAWN, drawable
        for name in drawable(self.diagnosis):
            if figure := DRAWN[name](self.diagnosis):
                return figure
        return super()._figure()

    def write_report(self, folder: str | Path) -> None:
        """report.html, verdict.json, extension.toml and the figures."""
        from ..diagnosis.report.page import write_report
        write_report(self.diagnosis, self.report, folder)


def diagnose(log: Log, nominal: Nominal, *, holdout: Log | None = None, bootstrap: int = 0, strict: bool = False,
             say: Callable[[str], None] = lambda text: None, noise: str = "bounded") -> Diagnosed:
    """Diagnose a log.

    holdout    a second log, to judge the extended model on
    bootstrap  clean flights of the nominal that are diagnosed too, to count false alarms
    say        told what is being done
    noise      how far levels may be from the declared: "bounded", "declared" or "free"
    """
    bootstrap, noise = integer("--bootstrap", bootstrap, 0), word("--noise", noise, WITHIN)
    for each in (log, holdout):
        if each is not None:
            each.check_clock()
    if strict:
        data_warnings(log, nominal, strict)
    result = examine(log, nominal, holdout, bootstrap=bootstrap, say=say, noise=noise)
    return Diagnosed(result, diagnosis_report(result), ideal_note(log))


# ---- fit-lft


@dataclass(frozen=True, eq=False)
class FittedRange(Answer):
    """The range sigma of a6 and k1, from flights."""

    fit: greybox.Fit
    nominal: Nominal        # with its [uncertainty]
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    def summary(self, of: str = "fitted range") -> str:
        return greybox.table(self.fit, of)

    def columns(self) -> Columns:
        return flat([{"parameter": name, **values} for name, values in self.report["ranges"].items()])

    def _figure(self) -> "Figure":
        from sim.pictures import range_figure
        return range_figure(self.nominal)

    def write(self, path: str | Path) -> None:
        """The nominal, as TOML: the file that it came from, with what is new."""
        rewrite_nominal(self.nominal, path)


def fit_lft(logs: Sequence[Log], nominal: Nominal, *, share: float = 0.95, confidence: float = 0.95,
            profile: bool = False, strict: bool = False) -> FittedRange:
    """Fit the range that holds a `share` of vehicles with `confidence`; `profile`: over flight time.

    InputError for a log whose columns are in another unit, of another sign or exchanged: a range holds what it is fed.
    """
    if not logs:
        raise UsageError("fit-lft: expected at least one log")
    for k, log in enumerate(logs):
        if again := next((one for one in logs[:k] if log.is_same(one)), None):
            raise InputError(f"{log.path}: the same flight as {again.path}; expected each once")
    for name, value in (("share", share), ("confidence", confidence)):
        if not 0.0 < real(name, value, "a number between 0 and 1") < 1.0:
            raise UsageError(f"{name} {value!r}: expected a number between 0 and 1")
    said: tuple[str, ...] = ()
    flights = []
    for log in progress.each(logs, "logs fitted"):
        said += data_warnings(log, nominal, strict, refuse_columns=True)
        flights.append(greybox.deviations(log, nominal))
    fit = greybox.fit(flights, share, confidence, profile)
    ranges = {name: {key: getattr(each, key) for key in ("sigma", "method", "spread", "within", "noise", "held")}
              for name, each in zip(level.PARAMETERS, fit.ranges, strict=True)}
    return FittedRange(fit, greybox.with_range(nominal, fit), {"flights": fit.flights, "ranges": ranges}, said)
