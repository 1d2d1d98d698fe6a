"""The three numbers of a controller: kp and kd over the nominal's, and the logarithm of the derivative's time constant
over the nominal's.  They are found by Gauss-Newton, and as few of them as the evidence allows differ."""

import itertools
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ...sums import along, products

NEUTRAL = np.array([1.0, 1.0, 0.0])
SLOPE_STEPS = np.array([0.01, 0.01, 0.02])
LARGEST_STEP = 0.3
LOW, HIGH = np.array([0.05, 0.05, -3.0]), np.array([20.0, 20.0, 3.0])
RIDGE = 1e-12          # of the information's trace
FREE_NUMBER = 4.0      # nats that a further free number must bring
FILTER = 2             # which of the numbers is the filter's

Residual = Callable[[np.ndarray], np.ndarray]


def lowest(cost: Callable[[float], float], low: float, high: float, steps: int) -> float:
    """The place where a cost with one minimum between low and high is least, by golden section."""
    for _ in range(steps):
        left, right = low + 0.382 * (high - low), low + 0.618 * (high - low)
        low, high = (low, right) if cost(left) < cost(right) else (left, high)
    return 0.5 * (low + high)


def newton(residual: Residual, x: np.ndarray, iterations: int) -> tuple[np.ndarray, np.ndarray]:
    """(x (3,) where 1/2 |residual|^2 is least, its information (3, 3))."""
    information = np.zeros((3, 3))
    for _ in range(iterations):
        r = residual(x)
        jacobian = np.column_stack([(residual(x + away) - r) / away.sum() for away in np.diag(SLOPE_STEPS)])
        information = products(jacobian, jacobian)
        information += RIDGE * np.trace(information) * np.eye(3)
        step = -np.linalg.solve(information, along(jacobian, r))
        x = np.clip(x + np.clip(step, -LARGEST_STEP, LARGEST_STEP), LOW, HIGH)
    return x, information


class Simplest(NamedTuple):
    """Numbers (3,), their std (3,), 0 of those that are the nominal's, and what they cost [nats]."""

    x: np.ndarray
    std: np.ndarray
    cost: float


def simplest(x: np.ndarray, information: np.ndarray, clearly: float, late: bool = False) -> Simplest:
    """The numbers, as many of them the nominal's as the evidence allows.

    clearly  nats that another filter must bring beside other gains, or beside computing time (late)
    """
    covariance = np.linalg.inv(information)
    best = Simplest(NEUTRAL, np.zeros(3), math.inf)
    for count in range(4):
        for free in itertools.combinations(range(3), count):
            fixed = [k for k in range(3) if k not in free]
            away = (NEUTRAL - x)[fixed]
            pull = np.linalg.solve(covariance[np.ix_(fixed, fixed)], away)
            both = clearly if FILTER in free and (count > 1 or late) else 0.0
            cost = 0.5 * float(away @ pull) + FREE_NUMBER * count + both
            if cost < best.cost:
                std = np.zeros(3)
                std[list(free)] = np.sqrt(np.diag(np.linalg.inv(information[np.ix_(free, free)])))
                best = Simplest(x + covariance[:, fixed] @ pull, std, cost)
    return best
