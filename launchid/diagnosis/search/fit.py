"""Fitting causes to a log: the least whitened innovations (`model.nuisance.Problem`) over the causes' free numbers and
the deviations of a6 and k1, by Levenberg-Marquardt with numerical slopes.

The Kalman gains and the factor L stay fixed in a fit and are made anew between fits (`model.noise`).  The deviations
are small, so their slopes are not made anew at every step.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...sums import along, products, square
from ..causes import Cause
from ..data.record import Record
from ..model.noise import Filter
from ..model.nuisance import DEVIATION_STEPS, Problem, within_sign
from ..model.point import DEVIATIONS, Point

ITERATIONS = 12
SMALL_GAIN = 0.02      # nats that a further step must promise; and of what it promised, the part it must keep
FIRST_DAMPING = 1e-4   # of the curvature
LEAST_DAMPING = 1e-9
MOST_DAMPING = 1e6
RESOLVED = 0.49        # rad a step, of an oscillation's frequency (`sim.effects.catalogue` refuses 0.5)
LARGEST_LOGARITHM = 50.0  # whose exponential stays finite
NEARBY = 20.0          # nats: a step that gained more moved too far to keep the deviations' slopes
SLIGHT = 1.0           # nats: after a step that gained less all slopes are kept
RENEWED = 4            # steps after which all slopes are made anew


@dataclass(frozen=True, eq=False)
class Fit:
    """Causes fitted to a log under one filter.

    delta        (5,) deviations, as `Point`
    cost         [nats] minimum, up to the filter's constant
    covariance   (k, k) of the free numbers of all causes in order (logarithms where searched so), then the
                 deviations; from the innovations' information
    slopes       (3n, k) derivatives of the whitened innovations, k as the covariance; None until asked for
    """

    record: Record
    filter: Filter
    causes: tuple[Cause, ...]
    delta: np.ndarray
    cost: float
    whitened: np.ndarray
    innovations: np.ndarray
    states: np.ndarray
    slopes: np.ndarray
    covariance: np.ndarray

    @property
    def point(self) -> Point:
        return point_of(self.causes, self.delta)

    def std(self, index: int) -> tuple[float, ...]:
        """Standard deviations of cause `index`'s values, in their units."""
        first = sum(len(cause.values) for cause in self.causes[:index])
        cause = self.causes[index]
        spread = np.sqrt(np.maximum(np.diag(self.covariance)[first:first + len(cause.values)], 0.0))
        own = [float(s * value) if free.logarithmic else float(s)
               for s, value, free in zip(spread, cause.values, cause.hypothesis.free, strict=True)]
        return (math.hypot(own[0], cause.hypothesis.dithered * float(self.filter.levels[3])), *own[1:])


def point_of(causes: Sequence[Cause], delta: np.ndarray) -> Point:
    """The model at these values."""
    return Point(tuple(cause.hypothesis.effect(cause.values) for cause in causes), tuple(float(d) for d in delta))


def pack_values(causes: Sequence[Cause], delta: np.ndarray) -> np.ndarray:
    """All numbers of a fit as one vector; logarithms where searched so."""
    packed = [math.log(value) if free.logarithmic else value
              for cause in causes for value, free in zip(cause.values, cause.hypothesis.free, strict=True)]
    return np.array([*packed, *delta])


def unpack_values(causes: Sequence[Cause], x: np.ndarray, record: Record) -> tuple[tuple[Cause, ...], np.ndarray]:
    """The other way, cut to the ranges and to what the record's step resolves."""
    made, k = [], 0
    for cause in causes:
        values = []
        for free in cause.hypothesis.free:
            value = math.exp(min(x[k], LARGEST_LOGARITHM)) if free.logarithmic else float(x[k])
            values.append(min(max(value, free.low), free.high, _resolved(free.name, record)))
            k += 1
        made.append(Cause(cause.hypothesis, tuple(values)))
    return tuple(made), within_sign(x[k:k + DEVIATIONS])


def _resolved(name: str, record: Record) -> float:
    """The largest value of a parameter that the integration step resolves, and the log's end for a time."""
    if name == "time":
        return float(record.t[-1])
    return RESOLVED / record.resolution if name == "frequency" else math.inf


def steps_of(causes: Sequence[Cause]) -> np.ndarray:
    """Steps of the numerical slopes."""
    return np.array([*(free.step for cause in causes for free in cause.hypothesis.free),
                     *DEVIATION_STEPS])


def slopes_at(problem: Problem, causes: Sequence[Cause], delta: np.ndarray, r: np.ndarray,
              known: np.ndarray | None = None) -> np.ndarray:
    """The slopes (3n + 5, k) of the residual at a point where it is r.

    known  slopes at a point nearby, whose deviations' columns are taken over; None: all are made
    """
    x, steps = pack_values(causes, delta), steps_of(causes)
    jacobian = np.zeros((len(r), len(x)))
    if known is not None:
        jacobian[:, -DEVIATIONS:] = known[:, -DEVIATIONS:]
        steps = steps[:-DEVIATIONS]

    def cut(moved: np.ndarray) -> tuple[np.ndarray, Point]:
        made, d = unpack_values(causes, moved, problem.record)
        return pack_values(made, d), point_of(made, d)

    problem.fill_slopes(x, steps, r, cut, jacobian)
    return jacobian


def fit(problem: Problem, causes: Sequence[Cause], delta: np.ndarray, iterations: int = ITERATIONS) -> Fit:
    """Levenberg-Marquardt from these values (Nocedal and Wright, Numerical Optimization, 2nd ed., ch. 10.3)."""
    causes = tuple(causes)
    r = problem.residual(point_of(causes, delta))
    cost, damping = 0.5 * square(r), FIRST_DAMPING
    jacobian = slopes_at(problem, causes, delta, r)
    hessian = products(jacobian, jacobian)
    for iteration in range(1, iterations + 1):
        slope = along(jacobian, r)
        scale = np.diag(hessian) + 1e-12 * np.max(np.diag(hessian)) + 1e-300
        promised = -0.5 * float(slope @ _step(hessian, LEAST_DAMPING * scale, slope))
        if promised < SMALL_GAIN:
            break
        x, moved = pack_values(causes, delta), None
        while damping < MOST_DAMPING:
            step = _step(hessian, damping * scale, slope)
            if not np.all(np.isfinite(step)):
                break
            made, d = unpack_values(causes, x + step, problem.record)
            new_r = problem.residual(point_of(made, d))
            new_cost = 0.5 * square(new_r)
            if new_cost < cost:
                moved = made, d
                break
            damping *= 10.0
        if moved is None:
            break
        gained = cost - new_cost
        (causes, delta), r, cost, damping = moved, new_r, new_cost, max(0.1 * damping, LEAST_DAMPING)
        if gained < SMALL_GAIN * promised:
            break
        if gained > SLIGHT or iteration % RENEWED == 0:
            near = gained < NEARBY and iteration % RENEWED > 0
            jacobian = slopes_at(problem, causes, delta, r, jacobian if near else None)
            hessian = products(jacobian, jacobian)
    return _finished(problem, causes, delta, cost, jacobian, hessian)


def _step(hessian: np.ndarray, damping: np.ndarray, slope: np.ndarray) -> np.ndarray:
    return -np.linalg.solve(hessian + np.diag(damping), slope)


def _finished(problem: Problem, causes: tuple[Cause, ...], delta: np.ndarray, cost: float,
              jacobian: np.ndarray, hessian: np.ndarray) -> Fit:
    white, e, states, _ = problem.white(point_of(causes, delta))
    scale = np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    covariance = np.linalg.pinv(hessian / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale)
    return Fit(problem.record, problem.filter, causes, delta, cost, white, e, states, jacobian[:-DEVIATIONS],
               covariance)
