"""Draw the wind, the constant offsets and the modes of a flight, which nobody knows before it.

Each source has its own random stream, so that one is left alone by the others and by the noises of
`sim.flight`; same seed, same draws.
"""

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np

from .effects import Changes, Effect, effect
from .kernels import kernel
from .sections import InTime, Nominal, Offsets, Wind

_DISTURBANCE_STREAMS = {"offsets": 100, "walk": 101, "turbulence": 102, "modes": 103}  # beyond those of the noises
NO_CHANGES = Changes()
OFFSET_DRAWS = ("thrust_misalignment", "attitude_bias", "gyro_bias", "nozzle_sensor_bias", "moment")


def _draws(seed: int, stream: str, count: int, source: int = 0) -> np.ndarray:
    """Return `count` standard normal draws of stream and seed; `source` counts the sources of one stream."""
    key = (_DISTURBANCE_STREAMS[stream], seed, source) if source > 0 else (_DISTURBANCE_STREAMS[stream], seed)
    return np.random.default_rng(key).standard_normal(count)


# ---- offsets


def drawn_offsets(offsets: Offsets | None, seed: int) -> dict[str, float]:
    """Draw the offsets whose sigma is above 0 by the seed; return name -> value [unit of the offset]."""
    if offsets is None:
        return {}
    draws = _draws(seed, "offsets", len(OFFSET_DRAWS)).tolist()
    return {name: getattr(offsets, name) * draw for name, draw in zip(OFFSET_DRAWS, draws, strict=True)
            if getattr(offsets, name) > 0.0}


def offset_effects(drawn: dict[str, float]) -> tuple[Effect, ...]:
    """Return the drawn offsets (name -> value) as effects of the catalogue; the moment, which is none, is left out."""
    return tuple(effect(name, **{"rate" if name == "gyro_bias" else "angle": value})
                 for name, value in drawn.items() if name != "moment")


# ---- slosh and bending

MOST_SIGMAS = 2.5  # of a mode's draw: beyond, nobody who declares a sigma believes it
LEAST_FACTOR = 0.1  # of a frequency or a damping ratio, which are above 0


def drawn_modes(nominal: Nominal, seed: int) -> Nominal:
    """Draw what [[slosh]] and [[bending]] declare as not known, by the seed; return the nominal with it.

    Each number with a sigma is its own times 1 + sigma n, n normal and within MOST_SIGMAS; both gains of a bending mode
    are off together.
    """
    return replace(nominal, slosh=tuple(_drawn(mode, seed, k) for k, mode in enumerate(nominal.slosh)),
                   bending=tuple(_drawn(mode, seed, len(nominal.slosh) + k) for k, mode in enumerate(nominal.bending)))


def _drawn(mode: Any, seed: int, source: int) -> Any:
    names = [f.name.removesuffix("_sigma") for f in fields(mode) if f.name.endswith("_sigma")]
    draws = np.clip(_draws(seed, "modes", len(names), source), -MOST_SIGMAS, MOST_SIGMAS)
    changed: dict[str, InTime] = {}
    for name, draw in zip(names, draws.tolist(), strict=True):
        factor = max(1.0 + getattr(mode, f"{name}_sigma") * draw, LEAST_FACTOR)
        for key in (name, "gyro_gain") if name == "gain" else (name,):
            number = getattr(mode, key)
            if number is not None and factor != 1.0:
                changed[key] = InTime(number.t, tuple(factor * x for x in number.value))
    return replace(mode, **changed)


# ---- wind


def drawn_wind(wind: Wind | None, seed: int, steps: int, step: float,
               changes: Changes = NO_CHANGES) -> np.ndarray | None:
    """Draw the wind angle (steps + 1,) [rad] at every step (of `step` [s]) of the flight; None if it is calm.

    changes  of the effects: each source of chance is drawn by itself, the nominal's first
    """
    walks, turbulences = sources(wind, changes)
    if (wind is None or wind.is_calm) and not walks and not turbulences:
        return None
    total = np.zeros(steps + 1) if wind is None or wind.profile is None else \
        wind.profile.at(np.arange(steps + 1) * step)
    for source, (walk, initial) in enumerate(walks):
        increments = _draws(seed, "walk", steps + 1, source)
        increments[0] *= initial
        increments[1:] *= walk * math.sqrt(step)
        total += np.cumsum(increments)
    for source, (level, time) in enumerate(turbulences):
        total += coloured(_draws(seed, "turbulence", steps + 1, source), math.exp(-step / time)) * level
    return total


Pairs = list[tuple[float, float]]


def sources(wind: Wind | None, changes: Changes) -> tuple[Pairs, Pairs]:
    """Return the random sources of wind above 0, the nominal's first: walks (level [rad/sqrt(s)], one sigma at t = 0
    [rad]) and turbulences (level [rad], time constant [s]).  A `wind_walk` among the effects begins at 0: use
    `steady_wind` for more."""
    walks = [(wind.walk, wind.initial)] if wind is not None else []
    turbulences = [(wind.turbulence, wind.turbulence_time)] if wind is not None else []
    return ([walk for walk in (*walks, *changes.walks) if max(walk) > 0.0],
            [each for each in (*turbulences, *changes.turbulences) if each[0] > 0.0])


@kernel
def coloured(white, share):
    """Turn white noise into a stationary first-order process of unit variance, exact at the steps:
    x_k = share x_(k-1) + sqrt(1 - share^2) n_k.

    white (n,) inout  standard normal draws in, the process out, also returned;  share  exp(-step/time constant)
    """
    fresh = math.sqrt(1.0 - share * share)
    for k in range(1, white.shape[0]):
        white[k] = share * white[k - 1] + fresh * white[k]
    return white
