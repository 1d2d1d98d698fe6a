"""Wind that is chance: of the causes `turbulence` and `wind_walk`, and as the weather of a whole flight (`Spec.wind`).

Plain: a stationary first-order process (Ornstein and Uhlenbeck) and a random walk.  Other: a Dryden spectrum of second
order, (1 + sqrt(3) T s)/(1 + T s)^2 of white noise (MIL-F-8785C, lateral gusts), and shear as a polygon: the walk's own
values every few seconds, straight lines between.  Drawn on a grid of GRID seconds, linear between.
"""

import math

import numpy as np

from .motion import fast
from .spec import OTHER, Weather

GRID = 2.5e-3      # s: a hundredth of the shortest correlation that a log at 50 Hz tells from white
LAYER = 2.0        # s, between nodes of the shear: at 500 m/s layers of a kilometre


def grid_steps(duration: float) -> int:
    """Steps of GRID that cover a flight [s]."""
    return math.ceil(duration / GRID) + 1


@fast
def recursive(move, fresh, white, x):
    """x (n, m) inout: x[k] = move x[k-1] + fresh white[k], x[0] given; move, fresh (m, m), white (n, m)."""
    for k in range(1, len(x)):
        for i in range(x.shape[1]):
            total = 0.0
            for j in range(x.shape[1]):
                total += move[i, j] * x[k - 1, j] + fresh[i, j] * white[k, j]
            x[k, i] = total


def first_order(white: np.ndarray, time_constant: float) -> np.ndarray:
    """(n,) stationary, of unit variance, correlation exp(-s/time constant); white (n, 1)."""
    stay = math.exp(-GRID / time_constant)
    x = white.copy()
    recursive(np.array([[stay]]), np.array([[math.sqrt(1.0 - stay * stay)]]), white, x)
    return x[:, 0]


def dryden(white: np.ndarray, time_constant: float) -> np.ndarray:
    """(n,) stationary, of unit variance, correlation exp(-s/T) (1 - s/(2T)), T twice the time constant, so that its
    slow part is as strong as the plain form's; white (n, 2).

    States x1' = -x1/T + n, x2' = -x2/T + x1, n of unit density; the gust is sqrt(3) x1 + (1 - sqrt(3)) x2/T over its
    standard deviation.  Their stationary covariance P is in closed form; a step adds P - F P F'.
    """
    t = 2.0 * time_constant
    left = math.exp(-GRID / t)
    move = left * np.array([[1.0, 0.0], [GRID, 1.0]])
    stationary = np.array([[t / 2.0, t**2 / 4.0], [t**2 / 4.0, t**3 / 4.0]])
    fresh = np.linalg.cholesky(stationary - move @ stationary @ move.T)
    x = np.zeros((len(white), 2))
    x[0] = np.linalg.cholesky(stationary) @ white[0]
    recursive(move, fresh, white, x)
    output = np.array([math.sqrt(3.0), (1.0 - math.sqrt(3.0)) / t])
    return x @ output / math.sqrt(output @ stationary @ output)


def walk(white: np.ndarray) -> np.ndarray:
    """(n,) random walk of unit variance a second, from 0; white (n,)."""
    return math.sqrt(GRID) * np.concatenate([[0.0], np.cumsum(white[1:])])


def polygon(white: np.ndarray) -> np.ndarray:
    """(n,) the walk's values every LAYER seconds, straight lines between."""
    k = np.arange(len(white))
    nodes = np.arange(0, len(white) + round(LAYER / GRID), round(LAYER / GRID))
    nodes = np.minimum(nodes, len(white) - 1)
    return np.interp(k, nodes, walk(white)[nodes])


def turbulence(rng: np.random.Generator, level: float, time_constant: float, variant: str, t: np.ndarray) -> np.ndarray:
    """Wind angle [rad] at t [s], of this level [rad]."""
    white = rng.standard_normal((grid_steps(float(t[-1])), 2))
    gust = dryden(white, time_constant) if variant == OTHER else first_order(white[:, :1], time_constant)
    return level * np.interp(t, GRID * np.arange(len(gust)), gust)


def wandering(rng: np.random.Generator, level: float, variant: str, t: np.ndarray) -> np.ndarray:
    """Wind angle [rad] at t [s], of this level [rad/sqrt(s)]."""
    white = rng.standard_normal(grid_steps(float(t[-1])))
    path = polygon(white) if variant == OTHER else walk(white)
    return level * np.interp(t, GRID * np.arange(len(path)), path)


def blown(of: Weather, streams: tuple[np.random.Generator, np.random.Generator], t: np.ndarray) -> np.ndarray:
    """Wind angle [rad] at t [s] of a flight's weather; 0 if it is calm.  streams: of turbulence, of walk."""
    angle = np.zeros(len(t))
    if of.turbulence > 0.0:
        angle += turbulence(streams[0], of.turbulence, of.time_constant, of.variant, t)
    if of.walk > 0.0 or of.initial > 0.0:
        first = of.initial * float(streams[1].standard_normal())
        angle += first + wandering(streams[1], of.walk, of.variant, t)
    return angle
