"""The world outside a flight that nobody knows before: wind and offsets, drawn.

Each source has a random stream of its own, so that one is left alone by the others and by the noises of
`sim.flight`; same seed, same draws.
"""

import math

import numpy as np

from .effects import Effect, effect
from .sections import Offsets, Wind
from .vehicle.kernels import kernel

_STREAMS = {"offsets": 100, "walk": 101, "turbulence": 102}  # beyond those of the noises
OFFSETS = ("thrust_misalignment", "attitude_bias", "gyro_bias", "nozzle_sensor_bias", "moment")


def _draws(seed: int, stream: str, count: int) -> np.ndarray:
    """`count` standard normal draws of a source."""
    return np.random.default_rng((_STREAMS[stream], seed)).standard_normal(count)


# ---- offsets


def drawn_offsets(offsets: Offsets | None, seed: int) -> dict[str, float]:
    """Name -> value of the constants that are not known to be 0; empty if all are."""
    if offsets is None:
        return {}
    draws = _draws(seed, "offsets", len(OFFSETS)).tolist()
    return {name: getattr(offsets, name) * draw for name, draw in zip(OFFSETS, draws, strict=True)
            if getattr(offsets, name) > 0.0}


def offset_effects(drawn: dict[str, float]) -> tuple[Effect, ...]:
    """Those of them that are causes of the catalogue; `moment_of` has the other."""
    return tuple(effect(name, **{"rate" if name == "gyro_bias" else "angle": value})
                 for name, value in drawn.items() if name != "moment")


def moment_of(drawn: dict[str, float]) -> float:
    """[rad/s^2] on theta_ddot; -0.0, which changes no bit of a sum, where there is none."""
    return drawn.get("moment", -0.0)


# ---- wind


def drawn_wind(wind: Wind | None, seed: int, steps: int, step: float) -> np.ndarray:
    """(steps + 1,) [rad] at every step [s] of the flight, or (0,) if it is calm."""
    if wind is None or wind.is_calm:
        return np.zeros(0)
    total = np.zeros(steps + 1) if wind.profile is None else wind.profile.at(np.arange(steps + 1) * step)
    if wind.walk > 0.0 or wind.initial > 0.0:
        increments = _draws(seed, "walk", steps + 1)
        increments[0] *= wind.initial
        increments[1:] *= wind.walk * math.sqrt(step)
        total += np.cumsum(increments)
    if wind.turbulence > 0.0:
        total += coloured(_draws(seed, "turbulence", steps + 1), math.exp(-step / wind.turbulence_time)) \
            * wind.turbulence
    return total


@kernel
def coloured(white, share):
    """A stationary first-order process of unit variance, exact at the steps:
    x_k = share x_(k-1) + sqrt(1 - share^2) n_k.

    white (n,) inout  standard normal draws in, the process out, which is returned;  share  exp(-step/time constant)
    """
    fresh = math.sqrt(1.0 - share * share)
    for k in range(1, white.shape[0]):
        white[k] = share * white[k - 1] + fresh * white[k]
    return white
