"""Find where in the nominal's range sigma a6 and k1 of a log are, window by window; JSON and table of the answer."""

import dataclasses
import math
from typing import Any

from launchid_core import BANDS, Config, Estimate, Level, Model, Uncertainty
from sim.errors import InputError
from sim.nominal import Nominal, Profile
from sim.onboard import onboard_model

from ..formatting import json_number, with_std
from ..identification.windows import run
from ..judge.nominal import tested
from ..log.check import CheckedLog
from ..log.log import Log

UNCERTAIN_PARAMETERS = ("a6", "k1")


def ranged_model(nominal: Nominal, period: float | None = None, path: str = "") -> Model:
    """Return the estimator's model with the nominal's range of a6 and k1; InputError without [uncertainty], and as
    `onboard_model`, which takes period [s] and path of the log."""
    nominal.require("uncertainty")
    sigma = nominal.uncertainty
    assert sigma is not None
    return dataclasses.replace(onboard_model(nominal, period, path), sigma_t=tuple(sigma.t), sigma_a6=tuple(sigma.a6),
                               sigma_k1=tuple(sigma.k1))


def require_cover(log: Log, nominal: Nominal, profile: Profile, section: str) -> None:
    """Raise InputError unless the profile of `section` covers the log's times to a sample; one node covers all
    times."""
    if len(profile.t) == 1:
        return
    first, last = log.span()
    if profile.t[0] > first + log.period or profile.t[-1] < last - log.period:
        raise InputError(f"{profile.path or nominal.path}: column t: the profile of [{section}] covers "
                         f"{profile.t[0]:g}..{profile.t[-1]:g} s; expected {first:g}..{last:g} s, "
                         f"the times of {log.path}")


def config_of(seen: CheckedLog, nominal: Nominal, window: float) -> Config:
    """Return how a log's level is followed in windows of `window` [s]."""
    return Config(window=window, sample_period=seen.log.period, formulation="filtered", max_gap=seen.bridged or None,
                  model=ranged_model(nominal, seen.log.period, seen.log.path))


def follow(seen: CheckedLog, nominal: Nominal, window: float) -> list[Estimate]:
    """Return an estimate with uncertainty level per window of `window` [s]; none is valid if columns hold another
    quantity, or the nominal is of another vehicle. InputError: a profile does not cover the log; ValueError: window out
    of range."""
    log, config = seen.log, config_of(seen, nominal, window)
    assert nominal.uncertainty is not None
    require_cover(log, nominal, nominal.vehicle, "vehicle")
    require_cover(log, nominal, nominal.uncertainty, "uncertainty")
    estimates, _ = run(config, seen.estimated.rows())
    is_other = bool(seen.foreign) or tested(seen, nominal, estimates, config).refuses
    return [_unknown(estimate) for estimate in estimates] if is_other else estimates


def _unknown(estimate: Estimate) -> Estimate:
    """Return the estimate with an invalid level of NaN: its log's columns hold other quantities than they name."""
    assert estimate.uncertainty is not None
    nothing = Level(math.nan, math.nan, "undecided", (math.nan,) * len(BANDS), True, math.nan)
    return dataclasses.replace(estimate, uncertainty=Uncertainty(False, nothing, nothing))


def level_json(level: Level) -> dict[str, Any]:
    """Return the level of a6 or k1 as JSON: delta, its std, likeliest band, probability by band, whether in range."""
    return {"delta": json_number(level.delta), "delta_std": json_number(level.delta_std), "band": level.band,
            "probability": {band: json_number(p) for band, p in zip(BANDS, level.probability, strict=True)},
            "in_range": level.in_range, "out_since": json_number(level.out_since)}


def report(estimates: list[Estimate]) -> dict[str, Any]:
    """Return the JSON of `launchid uncertainty`: each window's t_start, t_end [s], valid, level of a6 and of k1."""
    windows = []
    for e in estimates:
        u = e.uncertainty
        assert u is not None
        windows.append({"t_start": e.t_start, "t_end": e.t_end, "valid": u.valid,
                        "a6": level_json(u.a6), "k1": level_json(u.k1)})
    return {"windows": windows}


def departures(estimates: list[Estimate]) -> list[tuple[str, float, float, float]]:
    """Return each departure of a6 or k1 from its range: (parameter, since when, end of the window with the alarm, end
    of the first window back in range or NaN) [s]; in order of alarm."""
    rows = []
    for name in UNCERTAIN_PARAMETERS:
        inside = True
        for e in estimates:
            level: Level = getattr(e.uncertainty, name)
            if inside and not level.in_range:
                rows.append((name, level.out_since, e.t_end, math.nan))
            elif not inside and level.in_range:
                rows[-1] = (*rows[-1][:3], e.t_end)
            inside = level.in_range
    return sorted(rows, key=lambda row: row[2])


def table(estimates: list[Estimate]) -> str:
    """Return the level of a6 and k1 in each window as text for a terminal, and when one of them left its range."""
    heads = (f"  {f'delta_{name} +- std':>16} {'band [%]':>9} {'P(band)':>7}" for name in UNCERTAIN_PARAMETERS)
    lines = [f"{'t_start':>9} {'t_end':>9}" + "".join(heads)]
    for e in estimates:
        u = e.uncertainty
        assert u is not None
        line = f"{e.t_start:>9.3f} {e.t_end:>9.3f}"
        for level in (u.a6, u.k1):
            if not u.valid:
                line += f"  {'-':>16} {'-':>9} {'-':>7}"
                continue
            best = max(level.probability)
            line += f"  {with_std(level.delta, level.delta_std):>16} {level.band:>9} {best:>7.3f}"
        lines.append(line)
    for name, since, said, back in departures(estimates):
        lines.append(f"{name} is out of its range since {since:.2f} s (alarm by {said:.2f} s): something other "
                     "than dispersion acts, such as a fault or wind"
                     + (f"; back in range at {back:.2f} s" if math.isfinite(back) else ""))
    if not any(e.uncertainty is not None and e.uncertainty.valid for e in estimates):
        lines.append("no window of this log determines where in their range a6 and k1 are")
    elif not departures(estimates):
        lines.append("a6 and k1 are in their range throughout")
    return "\n".join(lines)
