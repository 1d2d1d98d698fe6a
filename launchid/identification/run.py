"""The one way from a log to judged windows: for `identify`, `launchid.identify` and `reproduce`."""

from dataclasses import dataclass, replace

from launchid_core import Config, Estimate, Estimator

from ..diagnosis.data.rates import HELD, as_held, rate_of
from ..diagnosis.data.stops import without_stops
from ..log.log import Log
from ..running import run
from .input_delay import Lead, delay
from .window_validation import Judged, judge, refused, withdrawn


@dataclass(frozen=True, eq=False)
class Identified:
    """A log that was identified.

    log        as it was fed;  config  as it was used;  estimator  for its counters and changes
    estimates  of every window that closed, as the estimator gave them;  judged  the same judged by the log itself
    delay      by how much beta leads, of what no nominal judges
    foreign    of which other quantity than their names say whole columns are, in words (`checked.foreign`)
    """

    log: Log
    config: Config
    estimator: Estimator
    estimates: list[Estimate]
    judged: Judged
    delay: Lead | None
    foreign: str = ""

    @property
    def is_held(self) -> bool:
        """Whether beta was integrated as held from each of its values to the next."""
        return self.config.beta_held


def identified(config: Config, log: Log, foreign: str = "", refuse: bool = False) -> Identified:
    """Feed a log to the estimator and judge its windows.

    foreign  as in `Identified`;  refuse  every window: no number of this log is of one motion
    Of `filtered`, which judges itself, those are refused that a contradiction of the model follows within 20 s.
    """
    kind = rate_of(log.t, log.beta).kind
    if kind == HELD and config.formulation == "integral":
        config = replace(config, beta_held=True)
    estimates, estimator = run(config, log.rows())
    measured = without_stops(as_held(log) if kind == HELD else log)
    is_filtered = config.formulation == "filtered"
    lead = None if is_filtered else delay(measured, config)
    judged = judge(measured, config, withdrawn(estimates) if is_filtered else estimates, lead, kind)
    if refuse:
        judged = replace(judged, estimates=[refused(e) if e.valid else e for e in judged.estimates])
    return Identified(log, config, estimator, estimates, judged, lead, foreign)
