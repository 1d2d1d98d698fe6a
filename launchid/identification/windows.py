"""Run the on-board estimator over a log, and judge its windows."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from launchid_core import Config, Estimate, Estimator, Sample

from .. import progress
from ..judge.nominal import FITS, NominalTest, lines, tested
from ..judge.refusal import disbelieved, withdrawn
from ..judge.scale import between_scales
from ..judge.windows import Judged, judged_windows
from ..log.check import CheckedLog
from ..log.rates import HELD_WORD

PART = 50_000  # samples between two reports of progress: about a fifth of a second


def run(config: Config, samples: np.ndarray | Iterable[Sample]) -> tuple[list[Estimate], Estimator]:
    """Replay samples, (n, 7) or one by one; return (the estimate of every window that closed, the estimator)."""
    estimator = Estimator(config)
    if not isinstance(samples, np.ndarray):
        return estimator.replay(samples), estimator
    estimates = []
    for k in range(0, len(samples), PART):
        progress.report("samples", k, len(samples))
        estimates += estimator.replay(samples[k:k + PART])
    return estimates, estimator


@dataclass(frozen=True, eq=False)
class Identified:
    """The result of identifying a log.

    log        as it was checked;  config  as it was used;  estimator  after the run, with its counters and changes
    estimates  of every window that closed, by the estimator;  judged  these after they were tested against the log
    is_weak    whether the numbers in `judged` are the weak form's;  told  what the log shows of the nominal
    """

    log: CheckedLog
    config: Config
    estimator: Estimator
    estimates: list[Estimate]
    judged: Judged
    is_weak: bool
    told: NominalTest = FITS

    @property
    def warnings(self) -> tuple[str, ...]:
        """Lines on the nominal that a user should read."""
        return lines(self.log, self.told)

    @property
    def is_held(self) -> bool:
        """Whether beta was integrated as constant from each of its values to the next."""
        return self.config.beta_held


def identified(config: Config, seen: CheckedLog, is_weak: bool = False, optional: tuple[str, ...] = (),
               joining: tuple[str, ...] = ()) -> Identified:
    """Run the estimator over a log and judge its windows; refuse all of them if a column holds another quantity than
    its name says (or may, and the formulation is not `filtered`).

    is_weak   take the windows and their counts of rows from the estimator, the numbers from the weak form
    optional  terms that the weak form adds where their coefficient exceeds its standard deviation
    joining   terms that the weak form adds where the log shows that they act
    Of `filtered`, which judges itself, windows are refused that a contradiction of the model follows within 20 s.
    """
    if seen.rates["beta"].kind == HELD_WORD and config.formulation == "integral":
        config = replace(config, beta_held=True)
    estimates, estimator = run(config, seen.estimated.rows())
    is_filtered = config.formulation == "filtered"
    judged = judged_windows(seen, config, withdrawn(estimates) if is_filtered else estimates, is_weak, optional,
                            joining)
    coarse = seen.sensed.coarse if is_filtered and seen.sensed is not None else ""
    if seen.foreign or coarse or (not is_filtered and seen.doubtful):
        judged = replace(judged, estimates=[disbelieved(e) for e in judged.estimates])
    if seen.sensed is not None and seen.sensed.nozzle_scale != 1.0:
        judged = replace(judged, estimates=[between_scales(e, seen.sensed.nozzle_scale) for e in judged.estimates])
    told = tested(seen, seen.nominal, judged.estimates, config) if is_filtered else FITS
    if told.refuses:
        judged = replace(judged, estimates=[disbelieved(e) for e in judged.estimates])
    return Identified(seen, config, estimator, estimates, judged, is_weak, told)
