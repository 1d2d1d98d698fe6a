"""The world's part in a log that makes no model wrong: states that every model carries, null and causes alike.

    x' = -x/T + white noise of a level         wind: a6 x; offsets: k1 x, x, or on a sensor; x rad or as it enters
    x' = white noise of a level                a walk, T = inf
    x' = 0                                     a constant that nobody knows, one sigma `initial`

Beside what the nominal declares ([wind], [offsets]) there is always a slow moment: no thrust is aligned better than an
arc minute, and no flight path is so straight that the air does not press on the vehicle by as little.  It lies below
what a diagnosis may call a cause, so a log's slow moments up to it are nobody's fault.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sim.nominal import Nominal

WIND, NOZZLE, MOMENT, ATTITUDE, GYRO, NOZZLE_SENSOR = range(6)  # where a state enters: a6 x, k1 x, x; the sensors
ARC_MINUTE = 2.9e-4     # rad of nozzle: the undeclared slow moment's one sigma is k1 times it
SLOW = 20.0             # s, its time constant: slow beside the vehicle, several times in a flight
WEATHER = (0.05, 2.0)   # factors within which a declared level of the wind may be fitted: a calm day contradicts nobody
LEAST = 1e-3            # of the level where a search begins
WINDY = 40.0            # of a wind that is sought: more than 0.2 rad is no weather to fly in
SOUGHT = 0.005          # rad, rad/sqrt(s): where the search of weather begins
SOUGHT_MOMENT = 10.0    # times the undeclared slow moment, the same
ENTRY_OF = {"thrust_misalignment": NOZZLE, "attitude_bias": ATTITUDE, "gyro_bias": GYRO,
            "nozzle_sensor_bias": NOZZLE_SENSOR, "moment": MOMENT}
TURBULENCE, WALK, SLOW_MOMENT = "turbulence", "wind_walk", "moment"


class Source(NamedTuple):
    """One state.

    level    one sigma of it where T [s] `time_constant` is finite, else per sqrt(s); 0: a constant
    initial  one sigma at the first row;  span  factors of the level within which it may be fitted
    unsought  level of it that is nobody's fault, of one that is sought beyond; None: it is not
    """

    name: str
    entry: int
    level: float
    initial: float
    time_constant: float = math.inf
    span: tuple[float, float] = (1.0, 1.0)
    unsought: float | None = None

    @property
    def is_stochastic(self) -> bool:
        return self.level > 0.0

    @property
    def is_sought(self) -> bool:
        """Whether it is sought, and not declared."""
        return self.unsought is not None

    def keep(self, period: float, z_alpha: float = 0.0) -> float:
        """The share of the state that is left after a period [s], with a flight path that turns by z_alpha [1/s] of the
        angle of attack.

        The path turns with a wind that wanders, so that less of it is left in the angle of attack (more, where
        z_alpha < 0): of w and the gamma that it makes, gamma' = z_alpha (w - gamma), the state is w - gamma.  A gust is
        over before the path has turned.
        """
        if self.entry == WIND and math.isinf(self.time_constant):
            return math.exp(-z_alpha * period)
        return math.exp(-period / self.time_constant)

    def fresh(self, period: float) -> float:
        """Variance that a period [s] adds, of a unit level."""
        return period if math.isinf(self.time_constant) else 1.0 - self.keep(period)**2

    def first(self, level: float) -> float:
        """One sigma at the first row, of a fitted level."""
        return self.initial if math.isinf(self.time_constant) else level


@dataclass(frozen=True)
class World:
    """The states, in the order in which the filter carries them."""

    sources: tuple[Source, ...] = ()

    @property
    def levels(self) -> tuple[Source, ...]:
        """The sources with a level, in the order of the levels behind the vehicle's own five."""
        return tuple(each for each in self.sources if each.is_stochastic)

    def table(self, period: float, z_alpha: float) -> np.ndarray:
        """(states, 2) entry, and what is left after a row of this period [s] (`Source.keep`)."""
        return np.array([[each.entry, each.keep(period, z_alpha)] for each in self.sources]).reshape(-1, 2)

    def with_weather(self, source: Source) -> "World":
        """The world with one source of any level in the place of the one of its name."""
        return replace(self, sources=(*(each for each in self.sources if each.name != source.name), source))


CALM = World()


def world_of(nominal: Nominal, k1: np.ndarray) -> World:
    """The world that this nominal declares;  k1 (any,) [1/s^2] along the log."""
    floor = ARC_MINUTE * max(float(np.sqrt(np.mean(k1**2))), 1e-3)
    sources = [Source(SLOW_MOMENT, MOMENT, floor, floor, SLOW)]
    wind, offsets = nominal.wind, nominal.offsets
    if wind is not None and (wind.walk > 0.0 or wind.initial > 0.0):
        sources.append(Source(WALK, WIND, wind.walk, wind.initial, span=WEATHER))
    if wind is not None and wind.turbulence > 0.0:
        sources.append(Source(TURBULENCE, WIND, wind.turbulence, wind.turbulence, wind.turbulence_time, WEATHER))
    for name, entry in ENTRY_OF.items() if offsets is not None else ():
        sigma = getattr(offsets, name)
        if sigma > 0.0:
            sources.append(Source(f"{name} offset", entry, 0.0, sigma))
    return World(tuple(sources))


def sought(name: str, nominal: Nominal, floor: float, time_constant: float = 1.0, most: float = math.inf) -> Source:
    """Weather of any level, to be fitted.

    name  TURBULENCE, WALK or SLOW_MOMENT;  floor  [rad/s^2] of the undeclared slow moment;  most  [rad/s^2] of one that
    is sought: what is stronger than all that moves the vehicle is no disturbance of it
    """
    wind = nominal.wind
    if name == WALK:
        initial = max(SOUGHT, wind.initial if wind is not None else 0.0)
        return Source(WALK, WIND, SOUGHT, initial, span=(LEAST, WINDY), unsought=0.0)
    if name == TURBULENCE:
        return Source(TURBULENCE, WIND, SOUGHT, SOUGHT, time_constant, (LEAST, WINDY), 0.0)
    level = SOUGHT_MOMENT * floor
    return Source(SLOW_MOMENT, MOMENT, level, level, time_constant, (LEAST, most / level), floor)
