"""Slosh and bending as further states of the bound's vehicle, and their numbers."""

from typing import NamedTuple

import numpy as np

from sim.effects import values
from sim.nominal import Nominal

NUMBERS = ("frequency", "size", "damping_ratio")   # of a mode, in this order; size: coupling of slosh, gain of bending


class Modes(NamedTuple):
    """m modes over n rows (n = 1: they do not change): psi of slosh or eta of bending and its rate are two states
    each."""

    bends: np.ndarray     # (m,) int64: 1 bending, 0 slosh
    numbers: np.ndarray   # (n, m, 3) frequency [rad/s], size, damping ratio, over the step from the row
    shown: np.ndarray     # (m, 2) what the attitude's sensor shows of eta, the gyro of its rate; of slosh 0
    sigma: np.ndarray     # (m, 3) one sigma of the numbers before the flight, relative; 0: known


NO_MODES = Modes(np.zeros(0, np.int64), np.zeros((1, 0, 3)), np.zeros((0, 2)), np.zeros((0, 3)))


def modes_of(nominal: Nominal, t: np.ndarray) -> Modes:
    """Return a nominal's modes, those of its effects too, at times t (n,) [s].

    Of bending the size is the gain at the attitude's sensor, which then shows all of eta; 1 at the gyro alone, if only
    that sees it.
    """
    found = []
    for slosh in nominal.slosh:
        found.append((0, slosh.frequency.at(t), slosh.coupling.at(t), slosh.damping_ratio.at(t), (0.0, 0.0),
                      (slosh.frequency_sigma, slosh.coupling_sigma, slosh.damping_ratio_sigma)))
    for bending in nominal.bending:
        gain, gyro = bending.gain.at(t), (bending.gyro_gain or bending.gain).at(t)
        shown = (1.0, float(gyro[0] / gain[0])) if np.any(gain) else (0.0, 1.0)
        found.append((1, bending.frequency.at(t), gain if np.any(gain) else gyro, bending.damping_ratio.at(t), shown,
                      (bending.frequency_sigma, bending.gain_sigma, bending.damping_ratio_sigma)))
    for effect in nominal.effects:
        if effect.name in ("slosh", "bending"):
            bends = effect.name == "bending"
            given = {name: np.full(len(t), float(x)) for name, x in values(effect).items()}
            found.append((int(bends), given["frequency"], given["gain" if bends else "coupling"],
                          given["damping_ratio"], (1.0, 1.0) if bends else (0.0, 0.0), (0.0, 0.0, 0.0)))
    if not found:
        return NO_MODES
    bends, *numbers, shown, sigma = zip(*found, strict=True)
    return Modes(np.array(bends, np.int64), np.ascontiguousarray(np.transpose(numbers, (2, 1, 0))), np.array(shown),
                 np.array(sigma))
