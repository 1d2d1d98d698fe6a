"""Put the nominal's `[[effects]]`, `[drift]` and `[wind]` into the terms of the diagnosis' model.

Most effects are nominal values of the model's numbers.  Those that depend on the time or on the motion (gusts, modes,
flight path) are a known forcing: it is made of the filtered motion and joins the model's.
"""

import math
from typing import NamedTuple

import numpy as np

from sim.effects import Changes
from sim.effects.actuator import PLAY, WASHOUT, slowed
from sim.effects.environment import GUST_KIND, JUMP_KIND
from sim.effects.plant import parameters
from sim.kernels import kernel
from sim.nominal import Nominal
from sim.plant import modes_of, packed, tuned
from sim.sections import Actuator
from sim.vehicle.record import NUMBER_EFFECTS

from ..likelihood.kernel import MODE, NUMBERS
from ..weakform.modes import column
from .track import Track

DIFFERS = 1e-12   # from the neutral value
NEUTRAL = {name: float(getattr(Changes(), name)) for name in NUMBER_EFFECTS}   # of what effects change
OF_SENSORS = tuple(name for name in NUMBERS.names or () if name in NEUTRAL)   # numbers of the filter by the same name
CHANGE_OF = {"damping": "aero_damping", "cubic": "aero_cubic", "friction": "friction",
             "misalignment": "thrust_misalignment", "inertia": "nozzle_inertia", "wind": "steady_wind",
             "delay": "actuator_delay", "gain": "actuator_gain", "null_angle": "actuator_bias",
             "nozzle_bias": "nozzle_sensor_bias", **{name: name for name in OF_SENSORS}}   # number: change of a flight


class Believed(NamedTuple):
    """The nominal's effects in the model's terms: numbers {name: nominal value} that are not neutral; terms {library
    term: coefficient} of the acceleration; a6, k1 (n,) [1/s^2] with the effects on them; z_alpha, z_beta (n,) [1/s] of
    the flight path; of the wind walk [rad/sqrt(s)], turbulence [rad] and its time [s], initial [rad]."""

    changes: Changes
    numbers: dict[str, float]
    terms: dict[str, float]
    a6: np.ndarray
    k1: np.ndarray
    z_alpha: np.ndarray
    z_beta: np.ndarray
    walk: float
    turbulence: float
    turbulence_time: float
    initial: float


def believed(track: Track, servo: Actuator) -> Believed:
    """Return the effects, drift and wind of a track's nominal, in the model's terms."""
    nominal, r = track.nominal, track.record
    changes = packed(nominal, centre=r.centre)
    t = track.t[:-1] + 0.5 * np.diff(track.t)
    a6, k1 = parameters(changes, t, track.a6, track.k1)
    terms = dict(nominal.terms)
    for each in nominal.effects:
        if each.name == "missing_term":
            term, coefficient = str(each.values[0]), float(each.values[1])
            terms[term] = terms.get(term, 0.0) + coefficient
    z_alpha, z_beta = np.full(len(t), changes.z_alpha), np.full(len(t), changes.z_beta)
    if nominal.drift is not None:
        drift = nominal.drift.at(t + r.shift)
        z_alpha, z_beta = z_alpha + drift[0], z_beta + drift[1]
    if r.path.size:
        z_alpha, z_beta = 0.0 * z_alpha, 0.0 * z_beta
    return Believed(changes, _numbers(changes, servo), terms, a6, k1, z_alpha, z_beta, *_weather(nominal, changes))


def modes(track: Track, changes: Changes) -> np.ndarray:
    """Return the nominal's slosh and bending (n, m) as the filter's modes over each row: those of effects, then those
    of sections, which may change with time."""
    t = track.t[:-1] + 0.5 * np.diff(track.t) + track.record.shift
    own = modes_of(track.nominal)
    out = np.zeros((len(t), len(changes.modes)), MODE)
    for j, (bends, stiffness, drag, gain, angle, rate, *_) in enumerate(changes.modes):
        k, m = j - (len(changes.modes) - len(own)), out[:, j]
        k2, c, size = tuned(own[k], t) if k >= 0 else (stiffness, drag, gain)
        m["frequency"], m["damping_ratio"], m["bends"] = np.sqrt(k2), 0.5 * c / np.sqrt(k2), bends
        if bends:
            m["theta"], m["theta_dot"] = angle * size, rate * size
        else:
            m["force"] = size
    return out


def _numbers(c: Changes, servo: Actuator) -> dict[str, float]:
    w, lag = servo.frequency, 0.0
    for scale, share in c.bandwidths:
        w, more = slowed(scale, share, w, 1.0 if servo.is_first_order else servo.damping_ratio)
        lag += more
    washout = sum(1.0 / time for kind, time, _ in c.inputs if kind == WASHOUT)
    play = sum(width for kind, width, _ in c.inputs if kind == PLAY)
    all_of_them = {name: (getattr(c, own), NEUTRAL[own]) for name, own in CHANGE_OF.items()} | {
        "bandwidth": (w / servo.frequency, 1.0), "lag": (lag, 0.0), "washout": (washout, 0.0), "play": (play, 0.0),
        "rate_limit": (1.0 / c.rate_limit, 0.0)}
    return {name: value for name, (value, neutral) in all_of_them.items() if abs(value - neutral) > DIFFERS}


def _weather(nominal: Nominal, c: Changes) -> tuple[float, float, float, float]:
    wind = nominal.wind
    walks = [level for level, _ in c.walks] + ([wind.walk] if wind is not None else [])
    gusty = [*c.turbulences, *([(wind.turbulence, wind.turbulence_time)] if wind is not None else [])]
    strongest = max(gusty, default=(0.0, 1.0))
    return (math.hypot(*walks), math.hypot(*(level for level, _ in gusty)), strongest[1],
            wind.initial if wind is not None else 0.0)


def forcing(known: Believed, track: Track, terms: dict[str, float],
            motion: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the known forcing that depends on time or motion: moments of vehicle and of air (n,) [rad/s^2], and shift
    (n, 3) of the measurements.

    terms   those that the filter does not have;  motion (n, 3) attitude, rate and nozzle
    """
    c, t = known.changes, track.t[:-1] + 0.5 * np.diff(track.t)
    force, shift = np.zeros(len(t)), np.zeros((len(t), 3))
    wind = track.wind.copy()
    for kind, amount, first, second in c.timed:
        if kind == GUST_KIND:
            phase = (t - first) / second
            wind += amount * np.where((phase > 0.0) & (phase < 1.0), 0.5 - 0.5 * np.cos(2.0 * np.pi * phase), 0.0)
        elif kind == JUMP_KIND:
            force += amount * np.clip((track.t[1:] - first) / np.diff(track.t), 0.0, 1.0)
        else:
            force += amount * np.sin(first * t + second)
    theta, omega, beta = motion.T
    for term, coefficient in terms.items():
        force += coefficient * column(term, theta, omega, beta, t)
    if np.any(known.z_alpha != 0.0) or np.any(known.z_beta != 0.0):
        wind = wind - _path(theta + wind, beta + c.thrust_misalignment, known.z_alpha, known.z_beta, np.diff(track.t))
    shift[:, 0] += c.attitude_bias
    return force, known.a6 * wind, shift


def bending(nozzle: np.ndarray, w: float, zeta: float, track: Track) -> np.ndarray:
    """Return the shift (n, 3) of measurements by a mode of unit gain, frequency w [rad/s], under nozzle (n sub,)."""
    shift, step = np.zeros((len(track.z), 3)), track.period / track.sub
    for channel in (0, 1):
        shift[:, channel] = mode(nozzle, w, zeta, step, (0.0, w * w * channel, w * w * (1 - channel)))[::track.sub]
    return shift


@kernel
def _path(attack, beta, z_alpha, z_beta, h):
    """Return the flight path (n,) [rad] at each step's middle: gamma' = z_alpha (attack - gamma) + z_beta beta."""
    out, gamma = np.empty(len(h)), 0.0
    for i in range(len(h)):
        rate = z_alpha[i] * (attack[i] - gamma) + z_beta[i] * beta[i]
        out[i] = gamma + 0.5 * h[i] * rate
        gamma += h[i] * rate
    return out


@kernel
def _two_pole(x, b0, b1, b2, a1, a2, y):
    x1 = x2 = y1 = y2 = 0.0
    for i in range(len(x)):
        now = x[i] - x[0]
        y[i] = b0 * now + b1 * x1 + b2 * x2 - a1 * y1 - a2 * y2
        x2, x1, y2, y1 = x1, now, y1, y[i]


def mode(x: np.ndarray, w: float, zeta: float, period: float, top: tuple[float, float, float]) -> np.ndarray:
    """Return x (n,) filtered by (t2 s^2 + t1 s + t0)/(s^2 + 2 zeta w s + w^2), Tustin's rule prewarped at w [rad/s]."""
    c = w / math.tan(min(0.5 * w * period, 1.5))
    a0 = c * c + 2.0 * zeta * w * c + w * w
    t2, t1, t0 = top
    y = np.empty(len(x))
    _two_pole(np.ascontiguousarray(x), (t2 * c * c + t1 * c + t0) / a0, 2.0 * (t0 - t2 * c * c) / a0,
              (t2 * c * c - t1 * c + t0) / a0, 2.0 * (w * w - c * c) / a0, (c * c - 2.0 * zeta * w * c + w * w) / a0, y)
    return y
