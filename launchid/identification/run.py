"""The one way from a log to judged windows: for `identify`, `launchid.identify` and `reproduce`."""

from dataclasses import dataclass, replace

from launchid_core import Config, Estimate, Estimator

from ..log.check import CheckedLog
from ..log.rates import HELD_WORD
from ..running import run
from ..weakform.windows import Judged, judged_windows, refused, withdrawn


@dataclass(frozen=True, eq=False)
class Identified:
    """A log that was identified.

    log        as it was checked;  config  as it was used;  estimator  for its counters and changes
    estimates  of every window that closed, as the estimator gave them;  judged  the same judged by the log itself
    is_weak    the numbers of the judged are the weak form's
    """

    log: CheckedLog
    config: Config
    estimator: Estimator
    estimates: list[Estimate]
    judged: Judged
    is_weak: bool

    @property
    def is_held(self) -> bool:
        """Whether beta was integrated as held from each of its values to the next."""
        return self.config.beta_held


def identified(config: Config, seen: CheckedLog, is_weak: bool = False, optional: tuple[str, ...] = ()) -> Identified:
    """Feed a log to the estimator and judge its windows; where a column is of another quantity than its name says, no
    number of it is believed.

    is_weak   the estimator gives the windows and the counts of rows, and the weak form their numbers
    optional  terms that the weak form has too where they are more than their deviation
    Of `filtered`, which judges itself, those are refused that a contradiction of the model follows within 20 s.
    """
    if seen.rates["beta"].kind == HELD_WORD and config.formulation == "integral":
        config = replace(config, beta_held=True)
    estimates, estimator = run(config, seen.log.rows())
    is_filtered = config.formulation == "filtered"
    judged = judged_windows(seen, config, withdrawn(estimates) if is_filtered else estimates, is_weak, optional)
    if seen.foreign or (not is_filtered and seen.doubtful):
        judged = replace(judged, estimates=[refused(e) for e in judged.estimates])
    return Identified(seen, config, estimator, estimates, judged, is_weak)
