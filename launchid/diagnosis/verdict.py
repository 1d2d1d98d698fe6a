"""Diagnose one log: estimate everything, take away what left-out rows do not need, and decide what that means."""

import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sim.flight import fly_whole
from sim.nominal import Nominal

from ..log.log import Log, flown_log
from ..log.vehicle import plant_faults
from ..sums import square
from .adapter import FEWEST_ROWS, Reading, read
from .decision import decided
from .elimination import MIN_SQUARES_SAVED, Search
from .gain import held_out
from .model import Model, Stopped
from .named import Result
from .scan import with_rivals
from .start import everything, with_found, with_levels
from .stranger import judged
from .track import Track

MOST_GROWTH = 16.0     # nats in a row: ten million times, beyond which the filter sets a motion back to the log


def diagnose(log: Log, nominal: Nominal, holdout: Log | None = None, bootstrap: int = 0,
             say: Callable[[str], None] = lambda text: None, noise: str = "bounded") -> Result:
    """Diagnose why measurement and simulation part.

    Parameters
    ----------
    log, nominal : what was measured, what is believed
    holdout : a second log, to judge the extension on
    bootstrap : clean flights of the nominal that are diagnosed too, to count false alarms
    noise : how far levels may be from the declared: "bounded", "declared" or "free"
    say : told what is being done
    """
    if bootstrap > 0:
        wrong = 0
        for seed in range(bootstrap):
            say(f"clean flight {seed + 1} of {bootstrap}")
            clean = flown_log(fly_whole(nominal, seed), f"clean flight {seed}")
            wrong += diagnose(clean, nominal, noise=noise).verdict != "consistent"
        result = diagnose(log, nominal, holdout, say=say, noise=noise)
        words = f"{wrong} of {bootstrap} clean flights of this nominal are not found consistent"
        return replace(result, notes=(*result.notes, words),
                       false_alarms={"flights": bootstrap, "not_consistent": wrong})
    say("data check")
    reading = read(log, nominal)
    if reading.track is None:
        few = f"fewer than {FEWEST_ROWS} rows can be used: log longer, or more often"
        return Result(reading, nominal, None, None, "bad-data", "data") if reading.is_bad else Result(
            reading, nominal, None, None, "unexplained", None, doubts=(few,))
    if runs_away(nominal, log.period):
        return Result(reading, nominal, None, None, "unexplained", None, doubts=(
            "the nominal's motion grows more than ten million times from row to row: correct sign and unit of its "
            "terms",))
    m = replace(Model.of(reading.track, noise), brake=time.monotonic() + nominal.diagnosis.time_limit)
    try:
        return examined(m, reading, nominal, holdout, say)
    except Stopped:
        return Result(reading, nominal, None, None, "unexplained", None, is_cut_short=True)


def runs_away(nominal: Nominal, period: float) -> bool:
    """Return whether the nominal's rigid body grows by more than MOST_GROWTH in a period [s]."""
    damping = dict(nominal.terms).get("theta_dot", 0.0)
    growth = 0.5 * damping + math.sqrt(0.25 * damping**2 + max(float(np.max(nominal.vehicle.a6)), 0.0))
    return growth * period > MOST_GROWTH


def examined(m: Model, reading: Reading, nominal: Nominal, holdout: Log | None, say: Callable[[str], None]) -> Result:
    """Diagnose a track: fit all numbers, eliminate, decide; judge the gain on `holdout` if given."""
    say("everything free")
    m, p = everything(m)
    say("taking away" if m.log.is_flown else "one at a time")
    result = flown(m, p, reading, nominal) if m.log.is_flown else judged(m, p, reading, nominal)
    if result.verdict == "unexplained":   # for the unit or the sign of a column, which no cause of the vehicle is
        whole = plant_faults(reading.log, nominal, reading.data.masks)
        result = replace(result, doubts=(*(fault.message for fault in whole), *result.doubts))
    el = result.elimination
    if holdout is None or el is None:
        return result
    second = read(holdout, nominal)
    if second.track is None:
        return replace(result, notes=(*result.notes, "the second log cannot be used: the gain is of the first"))
    fitted = [(of_another(each, second.track), fit) for each, fit in result.fitted]
    nats = result.gain.nats if result.gain is not None else math.nan
    return replace(result, gain=held_out(fitted, nats, is_another=True))


def of_another(m: Model, track: Track) -> Model:
    """Return a model, with all that was found of its log, of another log."""
    return replace(Model.of(track, m.bounds).retime(m.log.retimed), table=m.table, shapes=m.shapes, levels=m.levels,
                   noise=m.noise, air=m.air, brake=m.brake)


def flown(m: Model, p: np.ndarray, reading: Reading, nominal: Nominal) -> Result:
    """Diagnose a log that the nominal's own simulation may have flown, of which everything is fitted with numbers p:
    take away what its left-out rows do not need, and decide."""
    el = Search(m).run(p)
    if any(k.group.name == "gyro_delay" for k in el.kept):
        timed = m.retime(float(el.final.p[m.table.index("gyro_delay")]))
        if timed is not m:
            m, fit = with_levels(timed, el.full.p)
            el = Search(m).run(fit.p)
    m, p = with_found(m, el.final, el.full.p)   # shapes that show once the numbers that are not needed are gone
    if len(p) > len(el.full.p):
        m, fit = with_levels(m, p)
        el = Search(m).run(fit.p)
    wider, p = with_rivals(m, el)
    if len(p) > len(el.full.p):
        rival = Search(wider).go_on(el, p)
        if square(rival.e_final) < square(el.e_final) + MIN_SQUARES_SAVED:   # else it found a worse minimum
            m, el = wider, rival
    return decided(m, reading, nominal, el)
