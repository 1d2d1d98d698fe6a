"""What the nominal says of noise and air, and how far a log may correct it."""

import math
from typing import NamedTuple

import numpy as np

from ..likelihood.estimate import Noise
from ..likelihood.likelihood import LEVELS
from ..series import white_variance
from .known import KnownLog

ARC_MINUTE = 2.9e-4    # rad of nozzle: no thrust is aligned better, so a moment that slow and small is nobody's fault
MOMENT_TIME = 20.0     # s, the time of that moment: slow beside the vehicle, several times in a flight
WIND_LEVEL = 0.005     # rad, rad/sqrt(s): of weather that nobody declared, where its fit begins
WIND_SPREAD = 2.0      # sigma of the logarithm of that level
WIND_CAP = 40.0        # times that level: the largest
WEATHER = {"turbulence": LEVELS.index("turbulence"), "wind_walk": LEVELS.index("walk")}   # causes that are a level
DISTURBANCE_TIME = 0.1  # s, of a stranger's motion that no model has: between its rows and the vehicle's time
DISTURBANCE = 0.02     # of the acceleration, where the fit of its size begins; it moves at most half as much
DENSEST = 30.0         # times the declared, up to which a sensor's noise of a stand may be fitted
LOUDEST = 1e4          # times the declared, of the acceleration of a stand: nominals of others declare what they like
FLOWN_SPREAD = (0.5, 0.5, 0.5, 0.5, 0.3, 1.0, 1.0)     # sigma of each level's logarithm, of LEVELS, where the nominal's
FLOWN_CAP = (3.0, 3.0, 3.0, 3.0, 3.0, 2.0, 2.0)        # own simulation flew; times the declared, the largest
STRANGE_SPREAD = (1.0, 1.0, 1.0, 2.5, 1.0, 1.5, 2.0)   # the same of a stranger's log
STRANGE_CAP = (DENSEST, DENSEST, DENSEST, LOUDEST, DENSEST, 10.0, 25.0)
FREE_SPREAD = 5.0      # the same where levels are asked to be free


class Air(NamedTuple):
    """The slow disturbance and the turbulence: weather that is fitted ("": as the nominal says), whether they act as
    wind does (else the slow one is a moment), their times [s], one sigma of the slow one before the first row."""

    weather: str
    is_windy: bool
    walk_time: float
    turbulence_time: float
    start: float


def noise_of(log: KnownLog, bounds: str, weather: str = "") -> tuple[Noise, Air]:
    """Return what is believed of noise and air.

    bounds   how far levels may be from the declared: "bounded", "declared" or "free"
    weather  a key of WEATHER: air that is turbulent, or a wind that walks, of a level that is fitted
    """
    air, walk, turbulence = _air(log)
    sensors = _sensors(log)
    levels = np.log(np.array([*sensors, *_input_noise(log), max(walk, 1e-12), max(turbulence, 1e-12)]))
    if log.is_flown:
        spread, cap = np.array(FLOWN_SPREAD), np.log(FLOWN_CAP)
        spread[5:] *= [air.is_windy, turbulence > 0.0]
    else:
        spread, cap = np.array(STRANGE_SPREAD), np.log(STRANGE_CAP)
    if bounds == "declared":
        spread[:] = 0.0
    elif bounds == "free":
        spread, cap = np.where(spread > 0.0, FREE_SPREAD, 0.0), np.full(len(cap), math.log(LOUDEST))
    spread[:3] *= [log.has["theta"], log.has["theta_dot"], log.has["beta"]]
    if weather:
        k = WEATHER[weather]
        air = air._replace(weather=weather)
        if weather == "wind_walk":
            air = air._replace(is_windy=True, walk_time=math.inf, start=WIND_LEVEL)
        levels[k], spread[k], cap[k] = math.log(WIND_LEVEL), WIND_SPREAD, math.log(WIND_CAP)
    return Noise(levels, spread, cap), air


def _air(log: KnownLog) -> tuple[Air, float, float]:
    """Return the air with the sigmas of the slow disturbance and of the turbulence."""
    known = log.known
    if known.walk > 0.0 or known.turbulence > 0.0:
        turns = float(np.mean(known.z_alpha))   # the path turns with a wind that wanders, which is then less felt
        time = 1.0 / turns if turns > 0.0 else math.inf
        walk = known.walk * (math.sqrt(0.5 * time) if turns > 0.0 else 1.0)
        return Air("", True, time, known.turbulence_time, known.initial), walk, known.turbulence
    if log.is_flown:
        moment = ARC_MINUTE * max(float(np.sqrt(np.mean(log.k1**2))), 1e-3)
        return Air("", False, MOMENT_TIME, 1.0, moment), moment, 0.0
    slow, fast = DISTURBANCE * log.scales.acceleration / math.sqrt(5.0), DISTURBANCE * log.scales.acceleration
    return Air("", False, math.inf, DISTURBANCE_TIME, 0.0), slow, fast


def _sensors(log: KnownLog) -> list[float]:
    """Return one sigma of each sensor: as declared, of a stranger's not far above what its column shows."""
    s, out = log.nominal.sensors, []
    given = [(s.theta_std, s.theta_step), (s.theta_dot_std, s.theta_dot_step), (s.beta_std, s.beta_step)]
    for k, (white_part, step) in enumerate(given):
        white, std = math.sqrt(white_variance(log.z[:, k])), math.hypot(white_part, step / math.sqrt(12.0))
        if not log.is_flown and white > 0.0:
            std = min(std, 3.0 * white)
        out.append(max(std, 0.05 * white, 1e-9))
    return out


def _input_noise(log: KnownLog) -> tuple[float, float]:
    """Return the densities of the noise of acceleration [rad/s^1.5] and of the command [rad sqrt(s)]."""
    nominal, r = log.nominal, log.track.record
    noise = nominal.simulation.acceleration_noise_std if nominal.simulation is not None else 0.0
    acceleration = max(noise, 1e-3 * log.scales.acceleration) * math.sqrt(log.tick)
    if log.is_commanded:
        a = nominal.actuator
        command = math.hypot((a.command_noise_std if a is not None else 0.0) * math.sqrt(log.tick),
                             r.between * math.sqrt(r.tick * r.step))
    else:
        command = nominal.sensors.beta_std * math.sqrt(log.track.period)
    return acceleration, max(command, 1e-12)
