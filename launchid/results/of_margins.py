"""Answers about margins: of a log, or of what was identified in it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from launchid_core import Change, Config, Estimate
from sim.nominal import Nominal
from sim.result import Columns

from ..identification.run import identified
from ..identification.windows import log_config, next_step, servo_note, why
from ..log.check import data_warnings
from ..log.log import Log
from ..robustness import flight_margins as fm
from ..robustness.flight_margins import Servo, WindowMargins, declared_servo
from .answer import Answer, flat

if TYPE_CHECKING:
    from sim.result import Figure


@dataclass(frozen=True, eq=False)
class FlightMargins(Answer):
    """The stability margins of a flight's loop, window by window."""

    log: Log
    nominal: Nominal
    config: Config
    windows: list[WindowMargins]
    servo: Servo
    report: dict[str, Any]
    warnings: tuple[str, ...] = ()

    def summary(self) -> str:
        required = self.nominal.margins
        head = (f"{self.log.path}: margins of the loop of {self.nominal.name} as identified, window "
                f"{self.config.window:g} s, value (95 % interval); required: {required.gain_db:g} dB, "
                f"{required.phase_deg:g} degrees" + (f", {required.delay_ms:g} ms" if required.delay_ms > 0.0 else ""))
        if not self.windows:
            return (f"{head}\nno window of {self.config.window:g} s is complete: expected a longer log, or a smaller "
                    "window")
        return "\n".join([head, fm.table(self.report), *(self.report[words] for words in ("why", "next")
                                                          if words in self.report)])

    def columns(self) -> Columns:
        return flat(self.report["windows"])

    def write_report(self, folder: str | Path) -> None:
        """report.html, margins.json and the figure."""
        from .reports import margins_report
        margins_report(self, folder)

    def _figure(self) -> "Figure":
        from .margin_figures import margins_figure
        return margins_figure(self.log, self.nominal, self.windows, self.report)


def margins(log: Log, nominal: Nominal, *, window: float = 5.0, tracked: bool = False,
            strict: bool = False) -> FlightMargins:
    """The margins of a log's loop; `window` in s."""
    declared_servo(nominal)
    config = log_config(log, nominal, str(window), "filtered", True, library="rigid-body")
    said = (*data_warnings(log, nominal, strict), *servo_note(log, nominal, config))
    result = identified(config, log)
    return margins_of(log, nominal, result.config, result.judged.estimates, result.estimator.changes(), tracked, said)


def margins_of(log: Log, nominal: Nominal, config: Config, estimates: Sequence[Estimate], changes: Sequence[Change],
               tracked: bool, said: tuple[str, ...] = ()) -> FlightMargins:
    """The margins of what was identified."""
    flown = fm.loop_that_flew(log, nominal, estimates)
    windows = fm.flight_margins(nominal, estimates, changes, flown.refused)
    servo = fm.last_servo(declared_servo(nominal), estimates)
    report = fm.report(windows, servo, nominal.margins, tracked, flown)
    if not any(window["valid"] for window in report["windows"]):
        report["why"] = why(report["windows"]).replace("is valid", "has margins")
    of_others = [{"status": e.status.name} for k, e in enumerate(estimates) if k not in flown.refused]
    if config.model is not None and (asked := next_step(of_others, config.model)):
        report["next"] = asked
    return FlightMargins(log, nominal, config, windows, servo, report, said)
