"""The extension's gain for the user of the on-board estimator: error and coverage of a6 and k1.

Flights of the extended nominal are identified twice: with the on-board model of the nominal, and with that of the
extension.  Effects of sensors and of the command that the on-board model has no place for are taken off the samples,
as a flight computer would; what can neither be modelled nor taken off leaves no answer.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import starmap

import numpy as np

from launchid_core import Config, Estimate, Sample
from sim.effects import values
from sim.errors import InputError
from sim.flight import Flight, fly_whole, parameters
from sim.nominal import Nominal

from ...identification.windows import MODELLED, onboard_model, run
from ..causes import RECORDS

WINDOW = 5.0          # s
FLIGHTS = 3
INTERVAL = 1.96       # standard deviations, 95 %


@dataclass(frozen=True)
class UserGain:
    """The gain of a6 and k1 over all windows that gave an answer: RMS relative error and share of 95 % intervals that
    hold the truth, (nominal, extended) each.  NaN where there is nothing to tell: no error is relative to a truth of
    zero, and what the nominal has at zero (a lander's a6) is held there, rightly and without a standard deviation."""

    error: dict[str, tuple[float, float]]
    coverage: dict[str, tuple[float, float]]
    windows: tuple[int, int]


def user_gain(nominal: Nominal, extension: Nominal) -> UserGain | None:
    """The gain for the user; None where the on-board model cannot hold the extension, or the nominal cannot fly."""
    names = {effect.name for effect in extension.effects}
    removable = {name for name, of in RECORDS.items() if of.corrections is not None}
    if not names <= {*MODELLED, *removable} or extension.guidance is None or extension.simulation is None:
        return None
    try:
        flights = [fly_whole(extension, seed) for seed in range(FLIGHTS)]
        models = onboard_model(nominal, flights[0].period), onboard_model(_modelled(extension), flights[0].period)
    except InputError:
        return None
    results = []
    for model, removes in zip(models, (False, True), strict=True):
        made = []
        for flight in flights:
            config = Config(window=WINDOW, sample_period=flight.period, formulation="filtered", model=model)
            estimates, _ = run(config, samples(flight, extension) if removes else flight.samples())
            made += [_judged(extension, each) for each in estimates if each.valid]
        results.append(np.array(made).reshape(-1, 4))
    if not all(len(each) for each in results):
        return None
    before, after = results

    def of(column: int) -> tuple[float, float]:
        first, second = (math.sqrt(_mean(each[:, column]**2)) for each in (before, after))
        return first, second

    def held(column: int) -> tuple[float, float]:
        first, second = (_mean(np.where(np.isnan(each[:, column]), math.nan, np.abs(each[:, column]) <= INTERVAL))
                         for each in (before, after))
        return first, second

    return UserGain({"a6": of(0), "k1": of(1)}, {"a6": held(2), "k1": held(3)}, (len(before), len(after)))


def _mean(x: np.ndarray) -> float:
    """The mean of what is no NaN; NaN if nothing is left."""
    x = x[~np.isnan(x)]
    return float(np.mean(x)) if len(x) else math.nan


def _modelled(extension: Nominal) -> Nominal:
    """The extension with the effects that the on-board model holds."""
    return replace(extension, effects=tuple(e for e in extension.effects if e.name in MODELLED))


def _judged(extension: Nominal, estimate: Estimate) -> tuple[float, float, float, float]:
    """Relative errors of a6 and k1 at the window's centre, and the same in standard deviations; NaN where there is
    none, see `UserGain`."""
    middle = np.array([0.5 * (estimate.t_start + estimate.t_end)])
    a6, k1 = (float(x[0]) for x in parameters(extension, middle))
    found = [(getattr(estimate, name), getattr(estimate, f"{name}_std"), true)
             for name, true in (("a6", a6), ("k1", k1))]
    relative = [(value - true) / abs(true) if true else math.nan for value, _, true in found]
    scaled = [(value - true) / std if std > 0.0 else math.nan if value == true else math.inf
              for value, std, true in found]
    return relative[0], relative[1], scaled[0], scaled[1]


def samples(flight: Flight, extension: Nominal) -> Iterator[Sample]:
    """The flight's samples with the removable effects taken off."""
    columns = {name: getattr(flight, name) for name in ("theta", "theta_dot", "beta", "beta_cmd")}
    known = [(correction, values(effect)) for effect in extension.effects
             for correction in RECORDS[effect.name].corrections or ()]
    for correction, of in sorted(known, key=lambda pair: pair[0].is_outer):
        columns[correction.column] = correction.without(columns[correction.column], of)
    theta, theta_dot, beta, command = columns.values()
    return starmap(Sample, zip(*(column.tolist() for column in (flight.t, theta, theta_dot, beta, flight.theta_ddot,
                                                                command)), strict=True))
