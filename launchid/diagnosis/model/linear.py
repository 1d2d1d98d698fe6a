"""The linear part of a model, read off the simulator's own functions by unit steps of its states."""

import math
from typing import NamedTuple

import numpy as np

from sim.effects import actuator, plant
from sim.effects.plant import AERO_DAMPING, BENDING, NOZZLE_INERTIA, SLOSH
from sim.effects.table import CODE, MEMORY, MEMORY_DOT, N_COLUMNS, P1
from sim.vehicle import step as st
from sim.vehicle.actuator import nozzle_acceleration
from sim.vehicle.kernels import kernel
from sim.vehicle.plant import angular_acceleration

from .predictor import N_RIGID

SAME_MODE = 0.4   # of a log frequency: a mode that moved further in a fit is another one


class Mode(NamedTuple):
    """An oscillator of the plant: which effect, at which frequency [rad/s]."""

    code: float
    frequency: float


Modes = tuple[Mode, ...]


def modes_of(v: st.Vehicle) -> tuple[Modes, np.ndarray]:
    """The vehicle's oscillators in their order, and for each row of its plant effects where its value stands among the
    states (-1: it has none)."""
    slots = np.full(len(v.plant), -1, np.int64)
    found: list[Mode] = []
    for e in range(len(v.plant)):
        if v.plant[e, CODE] in (SLOSH, BENDING):
            slots[e] = N_RIGID + 2 * len(found)
            found.append(Mode(float(v.plant[e, CODE]), float(v.plant[e, P1])))
    return tuple(found), slots


def matched(known: Modes, modes: Modes) -> list[int]:
    """The place of the value of each of `modes` among the states of a filter made for `known`, -1: not there."""
    free, slots = list(range(len(known))), []
    for mode in modes:
        near = [(abs(math.log(known[k].frequency / mode.frequency)), k) for k in free if known[k].code == mode.code]
        distance, k = min(near, default=(math.inf, -1))
        if distance < SAME_MODE:
            free.remove(k)
            slots.append(N_RIGID + 2 * k)
        else:
            slots.append(-1)
    return slots


def slots_of(v: st.Vehicle, known: Modes) -> np.ndarray:
    """The place of the mode of each row of the vehicle's plant effects in gains made for `known`."""
    modes, own = modes_of(v)
    slots = np.full(len(v.plant), -1, np.int64)
    slots[own >= 0] = matched(known, modes)
    return slots


@kernel
def slopes(fx, slots, a6, k1, w, zeta, lag, x, dx):
    """dx (m,) out = derivative of the state x (m,); fx (rows, columns) scratch: linear effects; lag: a servo of first
    order, its time constant 1/w."""
    for e in range(len(slots)):
        if slots[e] >= 0:
            fx[e, MEMORY], fx[e, MEMORY_DOT] = x[slots[e]], x[slots[e] + 1]
    dx[:] = 0.0
    dx[0] = x[1]
    if lag:
        dx[2] = w * (x[4] - x[2])
        swing = -w * dx[2]
    else:
        dx[2] = x[3]
        dx[3] = swing = nozzle_acceleration(w, zeta, x[4], x[2], x[3])
    dx[1] = (angular_acceleration(a6, k1, x[0], x[2], x[5])
             + plant.acceleration(fx, a6, k1, x[0], x[0], x[1], x[2]) + plant.reaction(fx, swing))
    for e in range(len(slots)):
        if slots[e] >= 0:
            dx[slots[e]] = x[slots[e] + 1]
            dx[slots[e] + 1] = plant.mode_acceleration(fx, e, dx[1], x[2])


@kernel
def state_matrix(moments, servo, slots, a6, k1, frequency, damping, lag, a, c):
    """a (m, m) out: x' = a x of theta, theta_dot, beta, beta_dot, command, acceleration, modes; c (3, m) out: what the
    sensors see.

    moments (rows, columns), servo (rows, columns)   in   the plant's and the actuator's effects
    """
    m = len(a)
    linear, where = np.zeros((len(moments), N_COLUMNS)), np.full(len(moments), -1, np.int64)
    count = 0
    for e in range(len(moments)):
        code = moments[e, CODE]
        if code in (SLOSH, BENDING, AERO_DAMPING, NOZZLE_INERTIA):
            linear[count] = moments[e]
            where[count] = slots[e]
            count += 1
    fx, at = linear[:count], where[:count]
    w = actuator.servo(servo, frequency, damping)[0]
    x, dx = np.zeros(m), np.zeros(m)
    c[:, :] = 0.0
    for j in range(m):
        x[:] = 0.0
        x[j] = 1.0
        slopes(fx, at, a6, k1, w, damping, lag, x, dx)
        a[:, j] = dx
        eta, eta_dot = plant.deflection(fx)
        c[0, j], c[1, j], c[2, j] = x[0] + eta, x[1] + eta_dot, x[2]
