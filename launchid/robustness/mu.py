"""Structured singular value of the closed loop for the two real parameters, over a box of delta centred anywhere.

1/mu = the least r for which some delta in centre + r [-radius, radius] puts a closed-loop root on the unit circle
(Zhou, Doyle & Glover, Robust and Optimal Control, 1996, ch. 11; the Delta-block real, diagonal).  mu < 1: the whole
box is stable.  It is exact for the sampled loop, whose lifted M(z) has no finite matrix (see `lft`), because with
two real parameters the boundary can be drawn: D-decomposition (Ackermann, Robust Control, 2002, ch. 2; Barmish, New
Tools for Robustness of Linear Systems, 1994, zero exclusion).  k1 is a gain, so a root at z = exp(i omega T) needs

    k1 = F(omega, a6) = -k1_centre/L(z; a6, k1_centre),   real, omega in (0, pi/T)

and the boundary is the curve Im F = 0, the line z = -1, and z = 1, where the hold keeps the static gain:
a6 + kp k1 = 0, or another line where the loop has more parts (the distance to it is exact).  Bending and what else
passes k1 by make L a straight line of k1 in place of a multiple; F is then what that line needs.
From a stable centre the first boundary point met is the answer.

Why not mu on a frequency grid: for real parameters mu(omega) is not continuous (Barmish, Khargonekar, Shi & Tempo,
Systems & Control Letters 15, 1990).  The crossover hardly depends on a6, so mu(omega) is a spike that a grid misses.
Here omega is searched, not gridded: branch and bound over cells of (omega, a6).

Bounds.  Lower: 1/r of a boundary point found, refined on the exact response.  Upper: every cell is excluded, since
Im F keeps its sign on it or since F stays out of the box of (1 - tolerance) of the r found.  A cell's range is that of
its 3 x 3 points plus their whole deviation from a bilinear function (four times what its quarters deviate, to second
order): measured, not interval arithmetic.

Assumptions: delta constant in time (frozen parameters); what `lft` says of the loop.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sim.nominal import Nominal

from .blocks import peaks_of
from .lft import Lft, lft_at, loop_gain, sample, spectral_radius

BOUNDS_GAP = 2e-3           # relative gap of the bounds
SPLITTINGS = 30             # of splitting; what is left then widens the bounds
MOST_CELLS = 5_000          # the same of cells that are left: their points take 200 MB
# of half the sampling rate; Im F/sin is even about both ends, nothing hides there
LOWEST_OMEGA = 1e-5
HIGHEST_OMEGA = 1.0 - 1e-6
LOG_CELLS = 60         # of frequency
A6_CELLS = 8           # of a6
MU_PHASE_STEP = 0.6    # rad that a cell may turn
LAG_PERIODS = 3.0      # periods of lag beside the delay
MU_SECTIONS = 16       # of a bracket in omega, in
POWER_ROUNDS = 10      # rounds: 1e-12 of it is left
NEAR_PEAK = np.geomspace(1e-3, 0.1, 9)  # relative distances of cells from a mode's frequency


@dataclass(frozen=True, eq=False)
class Mu:
    """Bounds lower <= mu <= upper over a box at t [s]; inf if its centre is not `stable`.  delta (2,) of a6, k1: the
    nearest that destabilises; omega [rad/s] of its root."""

    t: float              # s
    stable: bool          # at the centre; if not, lower = upper = inf
    lower: float
    upper: float
    delta: np.ndarray     # (2,) of a6, k1: on the stability boundary, outside the box if mu < 1
    omega: float          # rad/s of the root there

    @property
    def margin(self) -> tuple[float, float]:
        """Return the bounds (low, high) of 1/mu: by what factor the box may grow about its centre."""
        return 1.0 / self.upper, 1.0 / self.lower


class Box(NamedTuple):
    """A loop and the box centre (2,) +- radius (2,) of delta; p (a6), q (k1) are delta scaled to +-1 on its sides."""

    lft: Lft
    centre: np.ndarray    # (2,) delta
    radius: np.ndarray    # (2,) delta, above 0


class Cells(NamedTuple):
    """m rectangles of (p, omega [rad/s]), p = scaled delta of a6; omega_low = omega_high: piece of the line z = -1."""

    p_low: np.ndarray
    p_high: np.ndarray
    omega_low: np.ndarray   # rad/s
    omega_high: np.ndarray

    def take(self, index: np.ndarray) -> "Cells":
        return Cells(*(x[index] for x in self))

    def quarters(self) -> "Cells":
        p, omega = 0.5 * (self.p_low + self.p_high), 0.5 * (self.omega_low + self.omega_high)
        line = self.omega_low == self.omega_high
        below = Cells(*map(np.concatenate, ((self.p_low, p), (p, self.p_high), (self.omega_low,) * 2, (omega,) * 2)))
        above = Cells(*map(np.concatenate, ((self.p_low, p), (p, self.p_high), (omega,) * 2, (self.omega_high,) * 2)))
        area = above.take(~np.concatenate([line, line]))
        return Cells(*(np.concatenate(pair) for pair in zip(below, area, strict=True)))

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Return p (m, 3) and omega (m, 3) of the 3 x 3 points of each cell: low end, middle, high end."""
        return (np.stack([self.p_low, 0.5 * (self.p_low + self.p_high), self.p_high], axis=-1),
                np.stack([self.omega_low, 0.5 * (self.omega_low + self.omega_high), self.omega_high], axis=-1))


class Found(NamedTuple):
    """Point of the stability boundary: (p, q) = scaled delta of (a6, k1), r = max(|p|, |q|), its root's omega
    [rad/s]."""

    r: float
    p: float
    q: float
    omega: float            # rad/s


def mu(nominal: Nominal, t: float, centre: tuple[float, float] = (0.0, 0.0),
       radius: tuple[float, float] = (1.0, 1.0)) -> Mu:
    """Return bounds of mu at time t [s] over the box centre +- radius of (delta_a6, delta_k1).

    Raises ValueError: radius not above 0, centre not finite; InputError as `lft_at`.
    """
    box = Box(lft_at(nominal, t), np.array(centre, dtype=float), np.array(radius, dtype=float))
    if not (np.all(np.isfinite(box.centre)) and np.all(np.isfinite(box.radius)) and np.all(box.radius > 0.0)):
        raise ValueError(f"centre = {centre}, radius = {radius}: expected finite numbers, radius above 0")
    if not spectral_radius(sample(box.lft, box.centre)) < 1.0:
        return Mu(float(t), False, math.inf, math.inf, box.centre, math.nan)
    best, floor = _search(box, _static(box))
    delta = box.centre + box.radius * np.array([best.p, best.q])
    return Mu(float(t), True, 1.0 / best.r, 1.0 / float(floor), delta, best.omega)


def mu_over_time(nominal: Nominal, times: np.ndarray, centre: np.ndarray | tuple[float, float] = (0.0, 0.0),
                 radius: np.ndarray | tuple[float, float] = (1.0, 1.0)) -> list[Mu]:
    """Return mu at times (n,) [s] over the box centre +- radius of (delta_a6, delta_k1), each (2,) or (n, 2)."""
    centres, radii = (np.broadcast_to(np.asarray(x, dtype=float), (len(times), 2)) for x in (centre, radius))
    return [mu(nominal, float(t), tuple(c), tuple(r)) for t, c, r in zip(times, centres, radii, strict=True)]


def _static(box: Box) -> Found:
    """Return how far the range may grow until a corner of it meets the line s = 0 on which the loop has a pole at z =
    1: |s|/(|ds/dp| + |ds/dq|)."""
    (a6, k1), (of_a6, of_k1, rest) = box.lft.parameters(box.centre), box.lft.static_line()
    s = of_a6 * a6 + of_k1 * k1 + rest
    slope = box.lft.sigma * box.radius * np.array([of_a6 * box.lft.a6, of_k1 * box.lft.k1])
    r = abs(s) / np.abs(slope).sum()
    p, q = -np.sign(s) * np.sign(slope) * r
    return Found(float(r), float(p), float(q), 0.0)


def _needed(box: Box, p: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Return complex q (..., k) that puts a root at omega (..., k) [rad/s] when p is (...); real on the boundary."""
    delta = np.stack([box.centre[0] + box.radius[0] * p, np.full_like(p, box.centre[1])], axis=-1)
    sigma = box.lft.sigma[1]
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = -1.0 / loop_gain(sample(box.lft, delta), omega)
        if box.lft.has_other_paths:   # L is a straight line of k1
            none = delta.copy()
            none[..., 1] = -1.0 / sigma
            without = loop_gain(sample(box.lft, none), omega)
            factor = -(1.0 + without) / (-1.0 / factor - without)
    return (factor - 1.0) * (1.0 + sigma * box.centre[1]) / (sigma * box.radius[1])


def _search(box: Box, best: Found) -> tuple[Found, float]:
    """Return a nearest boundary point and a lower bound of its r, by branch and bound from boundary point `best`."""
    cells, q = _first_cells(box, best.r)
    floor = math.inf
    for _ in range(SPLITTINGS):
        best = _improve(box, cells, q, best)
        least = _least(box, cells, q)
        keep = least < (1.0 - BOUNDS_GAP) * best.r
        if np.count_nonzero(keep) > MOST_CELLS:
            floor = min(floor, least.min())
            break
        floor = min(floor, least[~keep].min(initial=math.inf))
        if not keep.any():
            break
        cells = cells.take(keep).quarters()
        q = _survey(box, cells)
    else:
        floor = min(floor, least[keep].min())
    return best, min(floor, best.r)


def _first_cells(box: Box, r: float) -> tuple[Cells, np.ndarray]:
    """Return cells over |p| <= r and all frequencies, and q (m, 3, 3) at their points (evaluated once where shared)."""
    top = math.pi / box.lft.period
    turns = math.ceil(math.pi * (box.lft.delay / box.lft.period + LAG_PERIODS) / MU_PHASE_STEP)
    edges = np.union1d(np.geomspace(LOWEST_OMEGA, HIGHEST_OMEGA, LOG_CELLS + 1),
                       np.linspace(0.0, HIGHEST_OMEGA, turns + 1)[1:]) * top
    peaks = peaks_of(box.lft.plant, box.lft.law)
    near = [peak * np.exp(sign * NEAR_PEAK) for peak in peaks for sign in (-1.0, 0.0, 1.0)]
    if near:
        edges = np.union1d(edges, np.concatenate(near)[np.concatenate(near) < edges[-1]])
    omega = np.sort(np.concatenate([edges, 0.5 * (edges[1:] + edges[:-1])]))
    p = np.linspace(-r, r, 2 * A6_CELLS + 1)
    q = _needed(box, p, np.append(omega, top))
    blocks = np.lib.stride_tricks.sliding_window_view(q[:, :-1], (3, 3))[::2, ::2].reshape(-1, 3, 3)
    low, first = (x.ravel() for x in np.meshgrid(np.arange(0, len(p) - 1, 2), np.arange(0, len(omega) - 1, 2),
                                                 indexing="ij"))
    area = Cells(p[low], p[low + 2], omega[first], omega[first + 2])
    rows = np.arange(0, len(p) - 1, 2)
    line = Cells(p[rows], p[rows + 2], np.full(len(rows), top), np.full(len(rows), top))
    ends = np.stack([q[rows, -1], q[rows + 1, -1], q[rows + 2, -1]], axis=-1)
    return (Cells(*(np.concatenate(pair) for pair in zip(area, line, strict=True))),
            np.concatenate([blocks, np.repeat(ends[:, :, None], 3, axis=2)]))


def _survey(box: Box, cells: Cells) -> np.ndarray:
    """Return q (m, 3, 3) at the points of the cells: p along axis 1, omega along axis 2."""
    p, omega = cells.points()
    return _needed(box, p, np.repeat(omega[:, None], 3, axis=1))


def _imaginary(box: Box, cells: Cells, q: np.ndarray) -> np.ndarray:
    """Return Im q/sin(omega T) (m, 3, 3), smooth and even at both ends of the circle; 0 on the line z = -1."""
    _, omega = cells.points()
    line = cells.omega_low == cells.omega_high
    return np.where(line[:, None, None], 0.0, q.imag / np.sin(omega * box.lft.period)[:, None])


def _range(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return least and largest (m,) of x (m, 3, 3) over each cell: over its points, widened by their deviation."""
    middle = 0.5 * (x[:, :, :1] + x[:, :, 2:])
    plane = np.concatenate([x[:, :, :1], middle, x[:, :, 2:]], axis=2)
    bilinear = np.concatenate([plane[:, :1], 0.5 * (plane[:, :1] + plane[:, 2:]), plane[:, 2:]], axis=1)
    deviation = np.abs(x - bilinear).max(axis=(1, 2))
    return x.min(axis=(1, 2)) - deviation, x.max(axis=(1, 2)) + deviation


def _distance(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the distance of 0 from [low, high]; 0 where an end is not finite (nothing is known there)."""
    return np.where(np.isfinite(low) & np.isfinite(high), np.maximum(0.0, np.maximum(low, -high)), 0.0)


def _least(box: Box, cells: Cells, q: np.ndarray) -> np.ndarray:
    """Return the least size r (m,) at which a boundary point can lie in each cell; inf where none can.

    On the boundary Im F = 0, so Re F may be replaced by Re F - slope Im F: with the cell's slope along omega that
    hardly varies with omega, and the cell need not be small to be judged.
    """
    y = _imaginary(box, cells, q)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        slope = (q.real[:, 1, 2] - q.real[:, 1, 0]) / (y[:, 1, 2] - y[:, 1, 0])
        slope = np.where(np.isfinite(slope), slope, 0.0)
        straight = _distance(*_range(q.real - slope[:, None, None] * y))
        size = np.maximum(straight, _distance(*_range(q.real)))
        apart = _distance(*_range(y)) > 0.0
    size = np.maximum(size, _distance(cells.p_low, cells.p_high))
    return np.where(apart, math.inf, size)


def _improve(box: Box, cells: Cells, q: np.ndarray, known: Found) -> Found:
    """Return the nearest boundary point on the cells' rows of constant p, or `known` if that is nearer."""
    y, (p, omega) = _imaginary(box, cells, q), cells.points()
    line = np.flatnonzero(cells.omega_low == cells.omega_high)
    size = np.maximum(np.abs(p[line]), np.abs(q.real[line, :, 0]))
    if size.size and np.nanmin(size) < known.r:
        i, j = np.unravel_index(np.nanargmin(size), size.shape)
        known = Found(float(size[i, j]), float(p[line[i], j]), float(q.real[line[i], j, 0]), float(omega[line[i], 0]))
    cell, row, column = np.nonzero((y[:, :, 1:] > 0.0) != (y[:, :, :-1] > 0.0))
    if not len(cell):
        return known
    with np.errstate(invalid="ignore", divide="ignore"):
        y0, y1 = y[cell, row, column], y[cell, row, column + 1]
        q0, q1 = q.real[cell, row, column], q.real[cell, row, column + 1]
        size = np.maximum(np.abs(p[cell, row]), np.abs(q0 - y0 * (q1 - q0) / (y1 - y0)))
    best = int(np.argmin(np.where(np.isfinite(size), size, math.inf)))
    if not size[best] < known.r:
        return known
    i, k = cell[best], column[best]
    refined = _refine(box, float(p[i, row[best]]), float(omega[i, k]), float(omega[i, k + 1]))
    return refined if refined.r < known.r else known


def _refine(box: Box, p: float, low: float, high: float) -> Found:
    """Return the boundary point at p between two frequencies [rad/s] where Im F changes sign, on the exact response."""
    where = np.array(p)
    for _ in range(POWER_ROUNDS):
        omega = np.linspace(low, high, MU_SECTIONS + 1)
        above = _needed(box, where, omega).imag > 0.0
        k = int(np.argmax(above[1:] != above[:-1]))
        low, high = float(omega[k]), float(omega[k + 1])
    q = float(_needed(box, where, np.array([low]))[0].real)
    return Found(max(abs(p), abs(q)), p, q, low)
