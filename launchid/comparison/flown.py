"""A log's reference flown again by a nominal, in closed loop with its controller, by the simulator (`sim.flight`).

A flight begins at t = 0 at attitude 0, as every one of a nominal does; a log that begins later is none of those.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim.flight import Flight, fly_whole, is_whole
from sim.nominal import Nominal
from sim.sections import Guidance, Wind

from ..log.log import Log

FLOWN_CHANNELS = ("theta", "theta_dot", "beta", "beta_cmd")
LATEST_START = 1.0  # s, first stamp of a log that begins where a flight does
CHANCE = ("turbulence", "wind_walk")   # effects that are drawn


def along(log: Log, nominal: Nominal) -> Nominal | None:
    """Return the nominal with the log's duration and, where it has one, the log's reference; None where it cannot fly:
    no [controller], [actuator], [simulation] or reference, or a log that begins later."""
    t = log.t[np.isfinite(log.t)]
    known = np.isfinite(log.t) & np.isfinite(log.theta_ref)
    if nominal.controller is None or nominal.actuator is None or nominal.simulation is None or \
            (nominal.guidance is None and not known.any()) or not 0.0 <= t.min() <= LATEST_START:
        return None
    duration = float(t.max()) + min(log.period, nominal.controller.period)
    nominal = replace(nominal, simulation=replace(nominal.simulation, duration=duration))
    if not known.any():
        return nominal
    first = np.unique(log.t[known], return_index=True)[1]   # each stamp once, in order
    rate = log.rate_ref[known][first]
    reference = Guidance(tuple(log.t[known][first].tolist()), tuple(log.theta_ref[known][first].tolist()),
                         tuple(rate.tolist()) if np.isfinite(rate).all() else ())
    return replace(nominal, guidance=reference)


def quiet(nominal: Nominal) -> Nominal:
    """Return the nominal without anything that is drawn: noises, wind but for its forecast, offsets."""
    assert nominal.actuator is not None and nominal.simulation is not None
    sensors = replace(nominal.sensors, theta_std=0.0, theta_dot_std=0.0, beta_std=0.0, gamma_std=0.0)
    wind = None if nominal.wind is None else Wind(profile=nominal.wind.profile)
    return replace(nominal, sensors=sensors, offsets=None, wind=wind,
                   actuator=replace(nominal.actuator, command_noise_std=0.0),
                   simulation=replace(nominal.simulation, acceleration_noise_std=0.0),
                   effects=tuple(each for each in nominal.effects if each.name not in CHANCE))


def flown(log: Log, nominal: Nominal) -> dict[str, np.ndarray] | None:
    """Return the channels (rows,) of a flight of the log's reference without noise, NaN after the vehicle was lost;
    None where the log has no reference, or `along` has no flight."""
    craft = along(log, nominal) if np.isfinite(log.theta_ref).any() else None
    if craft is None:
        return None
    flight = fly_whole(quiet(craft), period=period_of(log, craft))
    return at_rows(flight, log.t, FLOWN_CHANNELS)


def period_of(log: Log, nominal: Nominal) -> float:
    """Return the log's period [s] or, where the simulator cannot log at that, its step."""
    assert nominal.simulation is not None
    step = nominal.simulation.step
    return round(log.period / step) * step if is_whole(log.period, step) else step


def at_rows(flight: Flight, t: np.ndarray, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Return the columns of a flight at its rows nearest to the times t (n,) [s]; NaN beyond its end and where t is."""
    place = np.round(np.where(np.isfinite(t), t, -1.0) / flight.period).astype(np.int64)
    there = (place >= 0) & (place < len(flight.t))
    return {name: np.where(there, getattr(flight, name)[np.where(there, place, 0)], np.nan) for name in names}
