"""The model that is fitted to a log: its structure and numbers, and one pass of the filter over the log."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from . import filter as fl
from .channels import Channels

LONG_GAP = 0.2         # s: over a longer gap nothing of the motion is kept,
GAP_PERIODS = 20.0     # sample periods, where that is longer: of a slower log the vehicle is slower, too
FREE_NUMBERS = {"q_a": fl.Q_A, "r_theta": fl.R_THETA, "r_theta_dot": fl.R_OMEGA, "r_beta": fl.R_BETA, "q_b": fl.Q_B,
                "walk": fl.WALK_DENSITY, "turbulence": fl.TURBULENCE_STD, "turbulence_time": fl.TURBULENCE_CORRELATION,
                "servo": fl.SERVO_FREQUENCY,
                # numbers that are sought, by their logarithms; `delay` is sought beside them
                "damping": fl.SERVO_DAMPING_RATIO}


@dataclass(frozen=True, eq=False)
class Model:
    """Structure and numbers of a vehicle's model.

    source         of the nozzle: filter.BY_COMMAND, BY_MEASUREMENT or BY_INPUT
    node_a, node_k (n,) [s] nodes of a6 and k1;  linear (q,)  a6 and k1 at them, then theta_dot, sign(theta_dot)
    numbers        of FREE_NUMBERS, in their own units (variances, densities), and `delay` [s]
    free           names of those numbers that are fitted
    """

    source: int
    node_a: np.ndarray
    node_k: np.ndarray
    linear: np.ndarray
    numbers: dict[str, float]
    free: tuple[str, ...]
    sine: bool = False
    damping: bool = False
    friction: bool = False
    gyro_offset: bool = False
    smooth: float = 1.0      # rad/s, over which sign(theta_dot) turns
    no_input: bool = False   # k1 is held at 0
    node_c: np.ndarray = field(default_factory=lambda: np.zeros(1))
    coupling: np.ndarray = field(default_factory=lambda: np.ones(1))  # rad/s^2 of a unit of wind at node_c
    sizes: dict[str, float] = field(default_factory=dict)  # of the channels
    bounds: dict[str, tuple[float, float]] = field(default_factory=dict)  # of numbers, beyond which the log is blind

    @property
    def walk(self) -> bool:
        return "walk" in self.numbers

    @property
    def turbulence(self) -> bool:
        return "turbulence" in self.numbers

    def shape(self) -> fl.Shape:
        gyro = fl.BASE if self.gyro_offset else -1
        walk = fl.BASE + self.gyro_offset if self.walk else -1
        turbulence = fl.BASE + self.gyro_offset + self.walk if self.turbulence else -1
        states = fl.BASE + self.gyro_offset + self.walk + self.turbulence
        return fl.Shape(self.source, self.sine, gyro, walk, turbulence, states, self.damping, self.friction)

    def with_nodes(self, node_a: np.ndarray, node_k: np.ndarray) -> "Model":
        """Return the model with a6 and k1 interpolated to other nodes [s]."""
        a, k = self.at(node_a)[0], self.at(node_k)[1]
        return replace(self, node_a=node_a, node_k=node_k, linear=np.concatenate([a, k, self.rest]))

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return a6 and k1 at t (n,) [s], each (n,)."""
        na, nk = len(self.node_a), len(self.node_k)
        return (np.interp(t, self.node_a, self.linear[:na]), np.interp(t, self.node_k, self.linear[na:na + nk]))

    @property
    def rest(self) -> np.ndarray:
        """Return the coefficients of theta_dot and sign(theta_dot), those that the model has."""
        return self.linear[len(self.node_a) + len(self.node_k):]


@dataclass(frozen=True, eq=False)
class Pass:
    """One run of the filter: innovations e (c,), their variances, derivatives h (c, q) of the predictions, channel (0
    theta, 1 theta_dot, 2 beta) and log row of each; ln L."""

    e: np.ndarray
    variance: np.ndarray
    h: np.ndarray
    channel: np.ndarray
    row: np.ndarray
    counted: np.ndarray   # (c,) bool: not of a channel's first rows, where nothing is known
    ln_l: float
    end: tuple[np.ndarray, np.ndarray, np.ndarray]  # state, covariance, derivatives (q, states) after the last row


def events(c: Channels, model: Model) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times [s], kinds and rows (m,) of a log's events, in order; at one time the input changes last, and acts
    from then on."""
    source, delay = model.source, model.numbers["delay"]  # [s] of the command; MEASURED: by which the motion lags beta
    moving = np.flatnonzero(np.isfinite(c.theta) | np.isfinite(c.theta_dot))
    parts = [(c.t[moving], fl.MOTION_ROW, moving)]
    if source != fl.BY_INPUT and c.has("beta"):
        seen = np.flatnonzero(np.isfinite(c.beta))
        parts.append((c.t[seen] + (delay if source == fl.BY_MEASUREMENT else 0.0), fl.NOZZLE_ROW, seen))
    if source != fl.BY_MEASUREMENT:
        u = command(c)
        known = np.flatnonzero(np.isfinite(u))
        known = known[np.concatenate([[True], np.diff(u[known]) != 0.0])]  # a held value is one event
        parts.append((c.t[known] + delay, fl.INPUT_CHANGE, known))
    t = np.concatenate([part[0] for part in parts])
    kind = np.concatenate([np.full(len(part[0]), part[1]) for part in parts])
    row = np.concatenate([part[2] for part in parts])
    order = np.lexsort((kind, t))
    return t[order], kind[order], row[order]


def command(c: Channels) -> np.ndarray:
    """Return the input (n,) [rad]: the command, or the measured nozzle if no command is logged."""
    return c.beta_cmd if c.has("beta_cmd") else c.beta


def run(model: Model, c: Channels, sensitive: bool = True) -> Pass:
    """Run the filter over a log; sensitive: also compute the derivatives for the coefficients."""
    shape, numbers = model.shape(), np.zeros(fl.N_FILTER_NUMBERS)
    numbers[fl.TURBULENCE_CORRELATION], numbers[fl.FRICTION_RATE] = 1.0, model.smooth
    numbers[fl.LONGEST_GAP] = max(LONG_GAP, GAP_PERIODS * c.period)
    for name, place in FREE_NUMBERS.items():
        numbers[place] = model.numbers.get(name, numbers[place])
    wide = np.zeros(shape.states)
    sizes = model.sizes
    for place, name in enumerate(("theta", "theta_dot", "beta", "beta_rate", "moment")):
        wide[place] = (fl.DIFFUSE_FACTOR if place < 2 else 10.0) * sizes[name] ** 2
    if shape.gyro >= 0:
        wide[shape.gyro] = 10.0 * sizes["theta_dot"] ** 2
    if shape.turbulence >= 0:
        wide[shape.turbulence] = model.numbers["turbulence"] ** 2
    t, kind, row = events(c, model)
    na, nk = len(model.node_a), len(model.node_k)
    rate = np.zeros(2)
    rest = model.rest.tolist()
    if model.damping:
        rate[0] = rest.pop(0)
    if model.friction:
        rate[1] = rest.pop(0)
    most, q = 3 * len(c.t), len(model.linear) if sensitive else 0
    e, variance, h = np.zeros(most), np.ones(most), np.zeros((most, q))
    channel, rows = np.zeros(most, np.int64), np.zeros(most, np.int64)
    end = np.zeros(shape.states), np.zeros((shape.states, shape.states)), np.zeros((q, shape.states))
    path = np.interp(t, c.t, c.gamma)
    n = fl.run(t, kind, row, path, command(c), c.theta, c.theta_dot, c.beta, shape, numbers, wide, model.node_a,
               model.linear[:na], model.node_k, model.linear[na:na + nk], model.node_c,
               model.coupling, rate, e, variance, h, channel, rows, *end)
    e, variance, h, channel, rows = e[:n], variance[:n], h[:n], channel[:n], rows[:n]
    counted = rows >= FIRST_ROWS
    s, d = variance[counted], e[counted]
    ln_l = -0.5 * float(np.sum(np.log(s) + d * d / s)) if n else -math.inf
    return Pass(e, variance, h, channel, rows, counted, ln_l if math.isfinite(ln_l) else -math.inf, end)


FIRST_ROWS = 10        # rows in which the start is found
