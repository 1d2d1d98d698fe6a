"""What a nominal says of its plant: a6 and k1 over time, its effects packed for a step, modes, dispersions."""

import math
from collections.abc import Callable, Iterable

import numpy as np

from .effects import Changes, Effect, effect, pack, plant
from .errors import InputError
from .nominal import Nominal
from .sections import Bending, InTime, Slosh

CLOCK_DIGITS = 12  # decimals of a time [s] in the log, and wherever a time is compared with a given one
Factor = float | Callable[[np.ndarray], np.ndarray]  # of a parameter: a number, or a function of time [s]


def parameters(nominal: Nominal, t: np.ndarray, a6_factor: Factor = 1.0,
               k1_factor: Factor = 1.0, effects: Iterable[Effect] = ()) -> tuple[np.ndarray, np.ndarray]:
    """Return true a6 and k1 at times t (n,) [s]: the nominal's times the factors, with its effects and `effects`.

    Of a plant given by terms they are the coefficients of `theta` and `beta`.
    """
    a6, k1 = nominal.vehicle.at(t)
    a6 = a6 * (a6_factor(t) if callable(a6_factor) else a6_factor)
    k1 = k1 * (k1_factor(t) if callable(k1_factor) else k1_factor)
    changes = packed(nominal, effects)
    return plant.parameters(changes, np.round(t, CLOCK_DIGITS), a6, k1) if changes.parameters else (a6, k1)


def packed(nominal: Nominal, effects: Iterable[Effect] = (), centre: float | None = None) -> Changes:
    """Return what the nominal's further terms, its effects and `effects` change, together.

    centre  [s] a `middle` that is not given; None: of the nominal's flight
    """
    simulation = nominal.simulation
    step = simulation.step if simulation is not None else 0.0
    if centre is None:
        centre = 0.5 * simulation.duration if simulation is not None else math.nan
    terms = [effect("missing_term", term=term, coefficient=value) for term, value in nominal.terms]
    changes = pack([*terms, *nominal.effects, *effects], step, centre)
    changes.modes += mode_rows(nominal)
    return changes


def modes_of(nominal: Nominal) -> tuple[Slosh | Bending, ...]:
    """Return the modes of [[slosh]] and [[bending]], in this order."""
    return (*nominal.slosh, *nominal.bending)


def tuned(mode: Slosh | Bending, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return stiffness [1/s^2], drag [1/s] and gain of a mode (n,) each at times t (n,) [s]; of bending that the
    attitude sensor does not see the gyro's gain."""
    w, z = mode.frequency.at(t), mode.damping_ratio.at(t)
    if isinstance(mode, Slosh):
        return w * w, 2.0 * z * w, mode.coupling.at(t) * w * w
    gain = mode.gain if any(mode.gain.value) or mode.gyro_gain is None else mode.gyro_gain
    return w * w, 2.0 * z * w, gain.at(t)


def mode_rows(nominal: Nominal) -> list[tuple[float, ...]]:
    """Return the rows of [[slosh]] and [[bending]] for `Changes.modes`, with their numbers at t = 0."""
    rows, zero = [], np.zeros(1)
    for mode in modes_of(nominal):
        stiffness, drag, gain = (float(x[0]) for x in tuned(mode, zero))
        angle, rate = 1.0, 1.0
        if isinstance(mode, Bending) and mode.gyro_gain is not None:
            angle, rate = gyro_shares(mode)
        rows.append((float(isinstance(mode, Bending)), stiffness, drag, gain, angle, rate, *[0.0] * 6))
    return rows


def gyro_shares(mode: Bending) -> tuple[float, float]:
    """Return what attitude sensor and gyro show of a bending mode, in units of the gain that drives it."""
    if mode.gyro_gain is None:
        return 1.0, 1.0
    if not any(mode.gain.value):
        return 0.0, 1.0
    t = np.union1d(mode.gain.t, mode.gyro_gain.t)
    gain = mode.gain.at(t)
    return 1.0, float(mode.gyro_gain.at(t) @ gain / (gain @ gain))


def tuning(nominal: Nominal, modes: int, steps: int, h: float) -> np.ndarray | None:
    """Return `Vehicle.tuning` of the last of so many modes, those of sections, at steps of h [s]; None if constant."""
    own = modes_of(nominal)
    if all(len(x.t) == 1 for mode in own for x in vars(mode).values() if isinstance(x, InTime)):
        return None
    if len(own) < modes:
        raise InputError(f"{nominal.path}: [[slosh]] or [[bending]] over time beside an effect slosh or bending: "
                         "expected sections alone")
    return np.stack([np.stack(tuned(mode, np.arange(steps) * h)) for mode in own])


def dispersion(nominal: Nominal, delta_a6: float, delta_k1: float) -> tuple[Factor, Factor]:
    """Return the functions of t [s] 1 + sigma(t) delta by which a6 and k1 are multiplied (the paper's eq. 7)."""
    nominal.require("uncertainty")
    sigma = nominal.uncertainty
    assert sigma is not None
    return lambda t: 1.0 + delta_a6 * sigma.at(t)[0], lambda t: 1.0 + delta_k1 * sigma.at(t)[1]
