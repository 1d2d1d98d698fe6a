"""Fly a log's reference again with a nominal, in closed loop with its controller, by the simulator (`sim.flight`).

A flight begins at t = 0 at attitude 0, as every one of a nominal does; a log that begins later cannot be flown.

Find the place of a log among dispersed flights of a nominal.

The nominal flies the log's reference DISPERSED_FLIGHTS times, each time with its own a6 and k1 (uniform over
[uncertainty], as a campaign draws them), servo (normal, by the sigmas of [actuator]), wind, offsets and noise.  At each
time, and for the largest value of each channel, the log's place is the share of the flights that are below it: uniform
over 0 to 1, and 10 % of the time outside the band of 5 to 95 %, where the log is a flight of that nominal.
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sim.flight import Flight, fly_whole, is_whole
from sim.nominal import Nominal
from sim.plant import dispersion
from sim.sections import Guidance, Wind

from ..log.log import Log
from ..monte_carlo.campaign import drawn_delta, run_jobs

FLOWN_CHANNELS = ("theta", "theta_dot", "beta", "beta_cmd")
LATEST_START = 1.0  # s, first stamp of a log that begins where a flight does
CHANCE = ("turbulence", "wind_walk")   # effects that are drawn


def along(log: Log, nominal: Nominal) -> Nominal | None:
    """Return the nominal with the log's duration and, where it has one, the log's reference; None where it cannot fly:
    no [controller], [actuator], [simulation] or reference, or a log that begins later than LATEST_START."""
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
    """Return the nominal without random parts: no noise, offsets or wind, except for a wind forecast."""
    assert nominal.actuator is not None and nominal.simulation is not None
    sensors = replace(nominal.sensors, theta_std=0.0, theta_dot_std=0.0, beta_std=0.0, gamma_std=0.0)
    wind = None if nominal.wind is None else Wind(profile=nominal.wind.profile)
    return replace(nominal, sensors=sensors, offsets=None, wind=wind,
                   actuator=replace(nominal.actuator, command_noise_std=0.0),
                   simulation=replace(nominal.simulation, acceleration_noise_std=0.0),
                   effects=tuple(each for each in nominal.effects if each.name not in CHANCE))


def flown(log: Log, nominal: Nominal) -> dict[str, np.ndarray] | None:
    """Return channel -> values (rows,) of a noiseless flight of the log's reference, NaN after the vehicle was lost;
    None if the log has no reference, or the nominal cannot fly it (`along`)."""
    craft = along(log, nominal) if np.isfinite(log.theta_ref).any() else None
    if craft is None:
        return None
    flight = fly_whole(quiet(craft), period=period_of(log, craft))
    return at_rows(flight, log.t, FLOWN_CHANNELS)


def period_of(log: Log, nominal: Nominal) -> float:
    """Return the log's period [s], or the simulator's step if the period is no multiple of it."""
    assert nominal.simulation is not None
    step = nominal.simulation.step
    return round(log.period / step) * step if is_whole(log.period, step) else step


def at_rows(flight: Flight, t: np.ndarray, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Return name -> values (n,) of a flight at its rows nearest to times t (n,) [s]; NaN after its end."""
    place = np.round(np.where(np.isfinite(t), t, -1.0) / flight.period).astype(np.int64)
    there = (place >= 0) & (place < len(flight.t))
    return {name: np.where(there, getattr(flight, name)[np.where(there, place, 0)], np.nan) for name in names}


DISPERSED_FLIGHTS = 200
FIRST_SEED = 1_000_000   # of the flights: none that a user is likely to have flown the log with
SERVO_STREAM = 606       # of the random numbers of the servo
PERCENTILES = (0.05, 0.95)
TIMES_KEPT = 1_000       # times at most at which the flights are kept
LEAST_SERVO = 0.1        # of the nominal's frequency and damping ratio: no draw is below it


class Draw(NamedTuple):
    """Job of one dispersed flight: the seed of its random numbers."""

    seed: int


class Place(NamedTuple):
    """Place of one channel of the log among the dispersed flights.

    t (m,) [s], measured (m,), low, middle, high (m,)   the log, and the 5, 50 and 95 % of the flights, in its unit
    below (m,)   share of the flights below the log at each time, NaN where it is not measured
    outside      share of the time in which the log is outside low to high
    peak         share of the flights whose largest absolute value is below the log's
    """

    t: np.ndarray
    measured: np.ndarray
    low: np.ndarray
    middle: np.ndarray
    high: np.ndarray
    below: np.ndarray
    outside: float
    peak: float


class Dispersed(NamedTuple):
    """Place of each channel of the log (by name) among dispersed flights; lost: how many of them were lost."""

    places: dict[str, Place]
    lost: int


def drawn(nominal: Nominal, seed: int) -> tuple[Nominal, float, float]:
    """Return (the nominal with a servo drawn by the seed, delta of a6, delta of k1); deltas 0 without [uncertainty]."""
    assert nominal.actuator is not None
    servo = nominal.actuator
    frequency, damping, delay = np.random.default_rng((SERVO_STREAM, seed)).standard_normal(3)
    servo = replace(servo, natural_frequency=servo.natural_frequency
                    * max(LEAST_SERVO, 1.0 + servo.natural_frequency_sigma * frequency),
                    damping_ratio=servo.damping_ratio * max(LEAST_SERVO, 1.0 + servo.damping_ratio_sigma * damping),
                    delay=max(0.0, servo.delay + servo.delay_sigma * delay))
    deltas = drawn_delta(seed) if nominal.uncertainty is not None else (0.0, 0.0)
    return replace(nominal, actuator=servo), *deltas


def fly_drawn(nominal: Nominal, t: np.ndarray, there: np.ndarray, period: float,
              draw: Draw) -> tuple[np.ndarray, np.ndarray, bool]:
    """Fly one draw with rows a `period` [s] apart.  there (4, n) bool: what the log measured at its times t (n,) [s].

    Return (channels (4, m) at every `thinning`-th time, largest absolute values (4,) over `there`, was it lost).
    """
    craft, *deltas = drawn(nominal, draw.seed)
    factors = dispersion(craft, *deltas) if craft.uncertainty is not None else (1.0, 1.0)
    flight = fly_whole(craft, draw.seed, "flight", period, *factors)
    columns = np.stack(list(at_rows(flight, t, FLOWN_CHANNELS).values()))
    peaks = np.max(np.abs(np.nan_to_num(np.where(there, columns, 0.0))), axis=1, initial=0.0)
    return columns[:, ::thinning(len(t))], peaks, flight.lost


def thinning(rows: int) -> int:
    """Return k so that every k-th of the rows makes at most TIMES_KEPT."""
    return max(1, -(-rows // TIMES_KEPT))


def dispersed(log: Log, nominal: Nominal, flights: int = DISPERSED_FLIGHTS,
              progress: Callable[[int], object] | None = None) -> Dispersed | None:
    """Return the log's place among `flights` dispersed flights of the nominal; None if it cannot fly (`along`)."""
    craft = along(log, nominal)
    if craft is None:
        return None
    columns = np.stack([getattr(log, name) for name in FLOWN_CHANNELS])
    there = np.isfinite(columns) & np.isfinite(log.t)
    work = functools.partial(fly_drawn, craft, log.t, there, period_of(log, craft))
    made = run_jobs([Draw(FIRST_SEED + k) for k in range(flights)], work, progress=progress)
    series, peaks = np.stack([each[0] for each in made]), np.stack([each[1] for each in made])
    places = {}
    every = thinning(len(log.t))
    for c, name in enumerate(FLOWN_CHANNELS):
        if there[c].any():
            own = float(np.max(np.abs(columns[c, there[c]])))
            places[name] = place(log.t[::every], np.where(there[c], columns[c], np.nan)[::every], series[:, c],
                                 float(np.mean(peaks[:, c] < own)))
    return Dispersed(places, sum(each[2] for each in made))


def place(t: np.ndarray, measured: np.ndarray, flights: np.ndarray, peak: float) -> Place:
    """Return the place of a measured channel (m,) among flights (f, m), NaN after their end; peak: as in `Place`."""
    alive = np.isfinite(flights).any(axis=0)
    low, middle, high = (np.full(len(t), np.nan) for _ in range(3))
    low[alive], middle[alive], high[alive] = np.nanquantile(flights[:, alive], (PERCENTILES[0], 0.5, PERCENTILES[1]),
                                                            axis=0)
    known = alive & np.isfinite(measured)
    below = np.full(len(t), np.nan)
    below[known] = np.sum(flights[:, known] < measured[known], axis=0) / np.isfinite(flights[:, known]).sum(axis=0)
    out = (measured[known] < low[known]) | (measured[known] > high[known])
    return Place(t, measured, low, middle, high, below, float(np.mean(out)) if known.any() else float("nan"), peak)
