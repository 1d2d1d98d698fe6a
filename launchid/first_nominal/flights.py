"""One first nominal out of several flights of one vehicle.

Each flight gives its own, with its own weather, offsets and start.  What is the vehicle's (a6, k1, the servo, the
delay, terms) is pooled, each flight weighted by its information; noise levels too.  Offsets stay those of the flight
that tells most: another flight has others.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..flights.pooled import Joint, Told, pooled
from .answer import First, Number


def of_flights(firsts: Sequence[First]) -> tuple[First, Joint | None, list[Told]]:
    """Return (the nominal of the flights that are of one vehicle, how they agree, what each tells of a6 and k1).

    A flight that cannot tell a6 and k1 (`refused`) is left out; of none that can, the first is returned as it is.  a6
    and k1 that vary are pooled at the times of the flight that tells most of them; flights are compared by their means.
    """
    able = [each for each in firsts if not each.refused]
    if len(able) < 2:
        return (able or list(firsts))[0], None, []
    told = [_told(each) for each in able]
    joint = pooled(told)
    kept = [each for k, each in enumerate(able) if k not in joint.others]
    most = min(kept, key=lambda each: float(np.mean(each.k1_std / np.abs(each.k1))) / len(each.t))
    a6, a6_std = _over(kept, most.t, "a6")
    k1, k1_std = _over(kept, most.t, "k1")
    if len(most.t) == 1:
        a6, k1 = joint.value[:1], joint.value[1:]
        a6_std, k1_std = joint.std[:1], joint.std[1:]
    servos = [each.servo for each in kept if each.servo is not None]
    servo = None if most.servo is None else (_mean([w for w, _ in servos]), _mean([zeta for _, zeta in servos]))
    made = replace(
        most, path=", ".join(Path(each.path).name for each in kept), rows=sum(each.rows for each in kept),
        duration=max(each.duration for each in kept), a6=a6, a6_std=a6_std, k1=k1, k1_std=k1_std,
        terms=_each(kept, most, "terms"), noise=_each(kept, most, "noise"), wind=_each(kept, most, "wind"),
        delay=None if most.delay is None else _mean([each.delay for each in kept if each.delay is not None]),
        servo=servo,
        notes=tuple(dict.fromkeys(f"{Path(each.path).name}: {note}" for each in able for note in each.notes)))
    return made, joint, told


def _told(first: First) -> Told:
    """Return what a flight tells of a6 and k1, in the mean of its times."""
    std = np.array([np.mean(first.a6_std), np.mean(first.k1_std)])
    correlation = np.array([[1.0, first.a6_k1_corr], [first.a6_k1_corr, 1.0]])
    return Told(first.path, np.array([np.mean(first.a6), np.mean(first.k1)]), np.outer(std, std) * correlation)


def _over(firsts: Sequence[First], t: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return (value, standard deviation) (n,) of a6 or k1 at t (n,) [s], each flight weighted by its information."""
    value = np.array([np.interp(t, each.t, getattr(each, name)) for each in firsts])
    weight = np.array([np.interp(t, each.t, getattr(each, f"{name}_std")) for each in firsts])**-2.0
    return np.sum(weight * value, axis=0) / np.sum(weight, axis=0), np.sum(weight, axis=0)**-0.5


def _each(firsts: Sequence[First], most: First, field: str) -> dict[str, Number]:
    """Return the numbers of a field that flight `most` has, pooled over the flights that have them."""
    return {name: _mean([getattr(each, field)[name] for each in firsts if name in getattr(each, field)])
            for name in getattr(most, field)}


def _mean(numbers: Sequence[Number]) -> Number:
    """Return the mean of numbers weighted by their information, those without a deviation as if it were tiny."""
    weight = np.array([max(std, 1e-12 * (1.0 + abs(value)))**-2.0 for value, std in numbers])
    value = float(np.sum(weight * np.array([value for value, _ in numbers])) / np.sum(weight))
    return value, 0.0 if all(std == 0.0 for _, std in numbers) else 1.0 / math.sqrt(float(np.sum(weight)))
