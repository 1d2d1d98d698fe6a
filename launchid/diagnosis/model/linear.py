"""The linear part of a model, of the simulator's own numbers."""

import math
from typing import NamedTuple

import numpy as np

from sim.vehicle.record import Vehicle

from .predictor import N_RIGID

SAME_MODE = 0.4   # of a log frequency: a mode that moved further in a fit is another one


class Mode(NamedTuple):
    """An oscillator of the plant: whether it bends, or sloshes, at which frequency [rad/s]."""

    bends: float
    frequency: float


Modes = tuple[Mode, ...]


def modes_of(v: Vehicle) -> Modes:
    """The vehicle's oscillators in their order."""
    return tuple(Mode(float(mode.bends), math.sqrt(mode.stiffness)) for mode in v.modes)


def matched(known: Modes, modes: Modes) -> list[int]:
    """The place of the value of each of `modes` among the states of a filter made for `known`, -1: not there."""
    free, slots = list(range(len(known))), []
    for mode in modes:
        near = [(abs(math.log(known[k].frequency / mode.frequency)), k) for k in free if known[k].bends == mode.bends]
        distance, k = min(near, default=(math.inf, -1))
        if distance < SAME_MODE:
            free.remove(k)
            slots.append(N_RIGID + 2 * k)
        else:
            slots.append(-1)
    return slots


def slots_of(v: Vehicle, known: Modes) -> np.ndarray:
    """The place of each mode of the vehicle in gains made for `known`, -1: not there."""
    return np.array(matched(known, modes_of(v)), np.int64)


def state_matrices(v: Vehicle, a6: np.ndarray, k1: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """a (b, m, m): x' = a x of theta, theta_dot, beta, beta_dot, command, acceleration, modes, with a6, k1 (b,); and
    c (3, m): what the sensors see.  Linear effects only: damping, modes, the nozzle's inertia."""
    own, modes = v.flight[0], v.modes
    m, w = N_RIGID + 2 * len(modes), own.frequency
    a, c = np.zeros((len(a6), m, m)), np.zeros((3, m))
    c[0, 0] = c[1, 1] = c[2, 2] = 1.0
    a[:, 0, 1] = 1.0
    swing = np.zeros(m)  # beta_ddot
    if own.first_order:
        a[:, 2, 2], a[:, 2, 4] = -w, w
        swing[2], swing[4] = w * w, -w * w
    else:
        swing[2], swing[3], swing[4] = -w * w, -2.0 * own.damping * w, w * w
        a[:, 2, 3], a[:, 3] = 1.0, swing
    a[:, 1, 0], a[:, 1, 1], a[:, 1, 2], a[:, 1, 5] = a6, -own.aero_damping, k1, 1.0
    places = range(N_RIGID, m, 2)
    for k, mode in zip(places, modes, strict=True):
        a[:, 1, k] = 0.0 if mode.bends else mode.gain
    a[:, 1] += own.nozzle_inertia * swing
    for k, mode in zip(places, modes, strict=True):
        a[:, k, k + 1] = 1.0
        if mode.bends:
            a[:, k + 1, 2] = mode.stiffness * mode.gain
            c[0, k] = c[1, k + 1] = 1.0
        else:
            a[:, k + 1] = -a[:, 1]
        a[:, k + 1, k] -= mode.stiffness
        a[:, k + 1, k + 1] -= mode.drag
    return a, c
