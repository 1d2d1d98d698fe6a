"""Identify a log, from the data check to judged windows: what `identify` and `margins` share."""

import math
from dataclasses import dataclass
from typing import Any

from sim.nominal import Nominal

from ..argument_checks import DEFAULT_WINDOW, Default, real, window_for
from ..judge.lack import FRICTION
from ..log.check import profile_note
from ..log.commanded import with_nozzle
from ..log.log import Log
from ..log.phases import checked_flight
from ..log.rate_alone import with_attitude
from ..weakform.bands import NUISANCES
from .config import chosen_formulation, is_weak, log_config, refuse_too_long, servo_note
from .windows import Identified, identified


@dataclass(frozen=True, eq=False)
class IdentifiedLog:
    """A log, as it was checked, and the result of identifying it; library: as it was asked for, or its default."""

    log: Log
    result: Identified
    library: str
    warnings: tuple[str, ...]


def identified_log(log: Log, nominal: Nominal | None = None, *, window: float | str = DEFAULT_WINDOW,
                   tracked: bool = False, library: str | None = None, formulation: str | None = None,
                   strict: bool = False, **choices: Any) -> IdentifiedLog:
    """Check a log, choose how to identify it, run the estimator and judge the windows.

    Parameters are those of `launchid.identify`; choices: solver, threshold, compression, seed, noise.
    """
    if not isinstance(window, (str, Default)):
        window = real("--window", window, "seconds or 'all'")
    seen = checked_flight(log, nominal, strict=strict)
    is_filtered = chosen_formulation(seen.log, nominal, formulation, tracked) == "filtered"
    seen, believed, said = with_nozzle(seen, nominal, is_held=not is_filtered)
    log, said = seen.log, (*seen.warnings, *said)
    window = window_for(window, log)
    if window == "all":
        refuse_too_long(log)
    weak = is_weak(log, nominal, formulation, library, choices)
    optional = ("theta_dot",) if weak and library is None and nominal is None else ()
    joining = () if not weak or library is not None else (FRICTION,) if nominal is None else NUISANCES
    library = ("theta,beta,1" if optional else "rigid-body") if library is None else library
    config = log_config(log, believed, str(window), formulation, tracked, seen.bridged, library=library, **choices)
    if config.missing_commands > 0.0:
        said += (f"{log.path}: slower than the controller: the commands between its rows are taken as held, and the "
                 "standard deviations are wider for it",)
    if config.formulation == "filtered":
        said += servo_note(log, nominal, config)
    if config.formulation == "filtered" and not seen.foreign:
        said += profile_note(nominal, log.span()[1], log.path)
    seen, note = with_attitude(seen, config.terms if weak else ("theta",))
    log, said = seen.log, (*said, *note)
    result = identified(config, seen, weak, optional, joining)
    said += result.warnings
    is_told = any(estimate.valid for estimate in result.judged.estimates)
    if is_told and nominal is not None and result.judged.joined:
        said += (f"{log.path}: {', '.join(result.judged.joined)} act in it, which {nominal.path or nominal.name} does "
                 "not have: fitted too",)
    if is_told and math.isfinite(result.judged.top):
        said += (f"{log.path}: what is faster than {result.judged.top:.3g} rad/s has other coefficients than what is "
                 "slower (a motor, a filter, a friction that sticks?): it is not used",)
    if result.is_held:
        said += (f"{log.path}: beta is integrated as held from each of its values to the next",)
    return IdentifiedLog(log, result, library, said)
