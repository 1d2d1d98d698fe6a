"""Causes that begin: every onset of a control loss or of a moment and every gust at once, by superposition.

To first order the response to an acceleration is the sum of the responses to its pieces.  A corrected model has
a piece FORGOTTEN so soon that one run carries many, and a few runs give the responses to all pieces of CELL seconds.
An onset's response is the sum of those after it, a gust's the sum of those it covers, with its shape.
"""

import math
from dataclasses import dataclass

import numpy as np

from sim.effects.environment import gust_angle
from sim.vehicle.kernels import kernel

from ...sums import along, combined, products
from ..causes import Values
from ..data.record import Record
from ..model.nuisance import Problem
from ..model.point import innovations, vehicle
from .fit import Fit

EARLIEST = 2.0         # s: an onset so near an end is no onset, it is a constant cause
CELL = 0.5             # s
MOST_CELLS = 200       # of a long log: cells grow with it
FORGOTTEN = 8.0        # s
LOSS_PIECE = 0.05      # fraction of k1 lost in a piece, to stay in the linear range
GUST_PIECE = 0.01      # rad
MOMENT_PIECE = 0.01    # rad/s^2
DURATIONS = (1.0, 1.5, 2.5, 4.0, 6.5, 10.0, 16.0)  # s
STARTS = 0.25          # of a duration, between gusts tried


@dataclass(frozen=True, eq=False)
class Pieces:
    """Responses of the residual (3n + 5,) to unit pieces, what is in the model projected out.

    t         (j + 1,) [s] ends of the cells
    slope     (j,) response times residual;  energy (j, j) responses' products
    """

    t: np.ndarray
    slope: np.ndarray
    energy: np.ndarray


def pieces(problem: Problem, base: Fit, basis: np.ndarray, rest: np.ndarray, shape: np.ndarray,
           amount: float) -> Pieces:
    """Pieces of an acceleration `shape` (rows,) [rad/s^2 per unit], tried at `amount`.

    basis (3n + 5, k) orthonormal, rest (3n + 5,): what the model explains, and the residual without it
    """
    record = problem.record
    rows, ticks = record.rows, record.every // record.tick
    size = max(1, round(max(CELL, rows * record.period / MOST_CELLS) / record.period))
    cells = max(1, rows // size)
    apart = min(cells, max(1, math.ceil(FORGOTTEN / (size * record.period))))
    cell_of = np.minimum(np.arange(rows) // size, cells - 1)
    still = base.whitened
    responses = np.zeros((cells, len(rest)))
    for first in range(apart):
        active = cell_of % apart == first
        extra = np.repeat(np.where(active, amount * shape, 0.0), ticks)
        moved = problem.counted(problem.filter.whiten(innovations(record, problem.filter, base.point, extra)[0]))
        change = (moved - still) / amount
        for cell in range(first, cells, apart):
            begin = cell * size
            end = rows if cell + apart >= cells else (cell + apart) * size
            responses[cell, 3 * begin:3 * end] = change[begin:end].ravel()
    slope, energy, own = np.zeros(cells), np.zeros((cells, cells)), np.zeros((cells, basis.shape[1]))
    for cell in range(cells):  # in whose rows only the last few pieces are not forgotten
        active = slice(max(0, cell - apart + 1), cell + 1)
        part = slice(3 * cell * size, 3 * (rows if cell == cells - 1 else (cell + 1) * size))
        seen = responses[active, part].T
        slope[active] += along(seen, rest[part])
        energy[active, active] += products(seen, seen)
        own[active] += products(seen, basis[part])
    ends = record.t[0] + record.period * np.minimum(size * np.arange(cells + 1), rows)
    return Pieces(ends, slope, energy - products(own.T, own.T))


def losses(problem: Problem, base: Fit, basis: np.ndarray, rest: np.ndarray) -> tuple[float, Values]:
    """(gain [nats], (fraction, time)) of the best onset of a control loss."""
    record = problem.record
    k1 = _at_rows(record, vehicle(record, base.point).k1)
    return _best_onset(record, pieces(problem, base, basis, rest, -k1 * base.states[:, 2], LOSS_PIECE))


def moments(problem: Problem, base: Fit, basis: np.ndarray, rest: np.ndarray) -> tuple[float, Values]:
    """(gain [nats], (acceleration, time)) of the best onset of a moment that stays."""
    record = problem.record
    return _best_onset(record, pieces(problem, base, basis, rest, np.ones(record.rows), MOMENT_PIECE))


def _best_onset(record: Record, found: Pieces) -> tuple[float, Values]:
    """(gain [nats], (size, time)): the response to an onset is the sum of those of the pieces after it."""
    slope = np.cumsum(found.slope[::-1])[::-1]
    energy = np.diag(np.cumsum(np.cumsum(found.energy[::-1, ::-1], axis=0), axis=1))[::-1]
    onset = found.t[:-1]
    fair = (onset > record.t[0] + EARLIEST) & (onset < record.t[-1] - EARLIEST) & (energy > 0.0)
    if not fair.any():
        return 0.0, (0.0, float(onset[0]))
    gain = np.where(fair, 0.5 * slope**2 / np.where(fair, energy, 1.0), 0.0)
    k = int(np.argmax(gain))
    return float(gain[k]), (float(-slope[k] / energy[k]), float(onset[k]))


def gusts(problem: Problem, base: Fit, basis: np.ndarray, rest: np.ndarray) -> tuple[float, Values]:
    """(gain [nats], (angle, time, duration)) of the best gust."""
    record = problem.record
    found = pieces(problem, base, basis, rest, _at_rows(record, vehicle(record, base.point).a6), GUST_PIECE)
    middle = 0.5 * (found.t[1:] + found.t[:-1])
    shapes = [(float(begin), duration) for duration in DURATIONS
              for begin in np.arange(record.t[0] - 0.3 * duration, record.t[-1] - 0.4 * duration, STARTS * duration)]
    weights = np.zeros((len(shapes), len(middle)))
    gust_angles(np.array(shapes), middle, weights)
    slope = combined(weights, found.slope)
    energy = np.einsum("sk,sk->s", products(weights.T, found.energy), weights)
    gain = np.where(energy > 1e-12 * energy.max(initial=0.0), 0.5 * slope**2 / np.maximum(energy, 1e-300), 0.0)
    k = int(np.argmax(gain))
    return float(gain[k]), (float(-slope[k] / max(energy[k], 1e-300)), *shapes[k])


@kernel
def gust_angles(shapes, t, angles):
    """angles (s, n) out: of gusts (begin, duration) = shapes (s, 2) at t (n,) [s], each of size 1."""
    for s in range(len(shapes)):
        for k in range(len(t)):
            angles[s, k] = gust_angle(1.0, shapes[s, 0], shapes[s, 1], t[k])


def _at_rows(record: Record, half_steps: np.ndarray) -> np.ndarray:
    """Values in the middle of the step from each row, of values at half steps."""
    index = 2 * record.first_step + 2 * record.every * np.arange(record.rows) + record.every
    return half_steps[np.minimum(index, len(half_steps) - 1)]
