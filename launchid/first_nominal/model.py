"""The model that is fitted to a log: its structure and numbers, and one run of the likelihood's filter over the log.

    theta'' = sum of coefficients*terms + c(t) w + m + white,     b  the nozzle
    command:  b  behind a servo whose input is the command u(t - delay) and white noise
    nozzle :  b  a process of its own (no command in the log), of which the motion's stamps lag by `delay`
    direct :  b   = u(t - delay)

w is the wind (turbulence of first order, and a random walk) in units of a given c(t), which does not move with a6:
whitening must not depend on what is fitted (docs/method.md, wind).  m is a constant moment; the gyro has a constant
offset.  Stamps are never resampled: rows of the motion and of a nozzle that is late are laid in one order of time.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from ..likelihood import kernel, likelihood
from ..likelihood.likelihood import Parameters, Run
from .channels import Channels

BY_COMMAND, BY_MEASUREMENT, BY_INPUT = "command", "measurement", "input"   # where the nozzle comes from
LONG_GAP = 0.2         # s: over a longer gap nothing of the motion is kept,
GAP_PERIODS = 20.0     # sample periods, where that is longer: of a slower log the vehicle is slower, too
FILTER_STEP = 0.002    # s of the filter between two rows, at most: a swing of 5 rad/s has its a6 to 2e-5
DIFFUSE_FACTOR = 1e3   # times a channel's size: what is not known before the first sample
WIDE_FACTOR = 10.0     # the same of the nozzle, which moves about where it was
FIRST_ROWS = 10        # rows in which the start is found
COEFFICIENT_DIFFERENCE = 1e-4  # of its size, over which a coefficient's slope is taken
VARIANCES = {"q_a": "acceleration_noise", "r_theta": "theta_noise", "r_theta_dot": "theta_dot_noise",
             "r_beta": "beta_noise", "q_b": "command_noise"}   # numbers that are variances or densities: the filter's
PLAIN = {"walk": "walk_noise", "turbulence": "turbulence_noise", "turbulence_time": "turbulence_time",
         "servo": "frequency", "damping": "damping_ratio"}     # numbers that are the filter's own
SERVO_OF = {BY_COMMAND: kernel.SECOND_ORDER_SERVO, BY_MEASUREMENT: kernel.FREE_NOZZLE, BY_INPUT: kernel.NO_SERVO}


@dataclass(frozen=True, eq=False)
class Model:
    """Structure and numbers of a vehicle's model.

    source         of the nozzle: BY_COMMAND, BY_MEASUREMENT or BY_INPUT
    node_a, node_k (n,) [s] nodes of a6 and k1;  linear (q,)  a6 and k1 at them, then theta_dot, sign(theta_dot)
    offsets        (o,) moment [rad/s^2], and the gyro's [rad/s] if the log has attitude and rate
    numbers        of VARIANCES and PLAIN, in their own units, and `delay` [s]
    free           names of those numbers that are fitted: by their logarithms, but for `delay`
    """

    source: str
    node_a: np.ndarray
    node_k: np.ndarray
    linear: np.ndarray
    offsets: np.ndarray
    numbers: dict[str, float]
    free: tuple[str, ...]
    sine: bool = False
    damping: bool = False
    friction: bool = False
    smooth: float = 1.0      # rad/s, over which sign(theta_dot) turns
    no_input: bool = False   # k1 is held at 0
    node_c: np.ndarray = field(default_factory=lambda: np.zeros(1))
    coupling: np.ndarray = field(default_factory=lambda: np.ones(1))  # rad/s^2 of a unit of wind at node_c
    sizes: dict[str, float] = field(default_factory=dict)  # of the channels
    bounds: dict[str, tuple[float, float]] = field(default_factory=dict)  # of numbers, beyond which the log is blind

    @property
    def walk(self) -> bool:
        return "walk" in self.numbers

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

    @property
    def coefficients(self) -> np.ndarray:
        """Return what the acceleration and the gyro are linear in, (q + o,)."""
        return np.concatenate([self.linear, self.offsets])

    def with_coefficients(self, values: np.ndarray) -> "Model":
        q = len(self.linear)
        return replace(self, linear=values[:q], offsets=values[q:])

    def coefficient_sizes(self) -> np.ndarray:
        """Return how large each coefficient would be if it made all the motion, (q + o,)."""
        s, moment = self.sizes, self.sizes["moment"]
        rest = [moment / s["theta_dot"]] * self.damping + [moment] * self.friction
        return np.array([moment / s["theta"]] * len(self.node_a) + [moment / s["beta"]] * len(self.node_k) + rest
                        + [moment, s["theta_dot"]][:len(self.offsets)])


@dataclass(frozen=True, eq=False)
class Pass:
    """One run of the filter: innovations e (c,), their variances, channel (0 theta, 1 theta_dot, 2 beta) and log row of
    each, where they stand in the run (at); ln L."""

    run: Run
    at: np.ndarray
    e: np.ndarray
    variance: np.ndarray
    channel: np.ndarray
    row: np.ndarray
    counted: np.ndarray   # (c,) bool: not of a channel's first rows, where nothing is known
    ln_l: float


def command(c: Channels) -> np.ndarray:
    """Return the input (n,) [rad]: the command, or the measured nozzle if no command is logged."""
    return c.beta_cmd if c.has("beta_cmd") else c.beta


def laid_out(model: Model, c: Channels) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the times (n,) [s] of all measurements in order, the measurements (n, 3) there, and the log's row (n, 3)
    of each, -1 where there is none."""
    late = model.numbers["delay"] if model.source == BY_MEASUREMENT else 0.0   # by which the motion lags beta
    columns = [(c.theta, 0.0), (c.theta_dot, 0.0)]
    if model.source != BY_INPUT and c.has("beta"):
        columns.append((c.beta, late))
    there = [np.flatnonzero(np.isfinite(x)) for x, _ in columns]
    t = np.unique(np.concatenate([c.t[rows] + shift for rows, (_, shift) in zip(there, columns, strict=True)]))
    z, row = np.full((len(t), 3), np.nan), np.full((len(t), 3), -1)
    for channel, (rows, (x, shift)) in enumerate(zip(there, columns, strict=True)):
        place = np.searchsorted(t, c.t[rows] + shift)
        z[place, channel], row[place, channel] = x[rows], rows
    return t, z, row


def held_mean(c: Channels, edges: np.ndarray) -> np.ndarray:
    """Return the mean (m,) [rad] of the command, each value held until the next, between the times edges (m + 1,)."""
    u = command(c)
    known = np.flatnonzero(np.isfinite(u))
    ticks, values = c.t[known], u[known]
    integral = np.append(0.0, np.cumsum(values[:-1] * np.diff(ticks)))
    total = np.interp(edges, ticks, integral)
    total += np.minimum(edges - ticks[0], 0.0) * values[0] + np.maximum(edges - ticks[-1], 0.0) * values[-1]
    return np.diff(total) / np.diff(edges)


def parameters(model: Model, c: Channels, t: np.ndarray, z: np.ndarray) -> Parameters:
    """Return the filter's parameters for measurements z (n, 3) at times t (n,) [s]."""
    n, numbers = np.zeros(1, kernel.NUMBERS), model.numbers
    n["gyro_scale"], n["sign_rate"] = 1.0, model.smooth
    n["longest_gap"] = max(LONG_GAP, GAP_PERIODS * c.period)
    n["walk_time"], n["turbulence_time"], n["servo"] = math.inf, 1.0, SERVO_OF[model.source]
    for name, value in numbers.items():
        if name in VARIANCES:
            n[VARIANCES[name]] = math.sqrt(value)
        elif name in PLAIN:
            n[PLAIN[name]] = value
    n["theta_start"], n["omega_start"] = (DIFFUSE_FACTOR * model.sizes[name] ** 2 for name in ("theta", "theta_dot"))
    n["g_start"] = numbers.get("turbulence", 0.0) ** 2
    if model.source != BY_INPUT:   # else the input is known
        n["b_start"], n["v_start"] = (WIDE_FACTOR * model.sizes[name] ** 2 for name in ("beta", "beta_rate"))
    moment, *gyro = model.offsets
    n["gyro_bias"] = gyro[0] if gyro else 0.0
    rest = model.rest.tolist()
    damping = rest.pop(0) if model.damping else 0.0
    n["sign"] = rest.pop(0) if model.friction else 0.0
    t = np.append(t, t[-1] + c.period)
    middle = 0.5 * (t[:-1] + t[1:])
    rows = np.zeros(len(z), kernel.ROW)
    (a6, rows["beta"]), path = model.at(middle), np.interp(middle, c.t, c.gamma)
    rows["force"], rows["theta_dot"] = moment, damping
    if model.sine:                 # sin(theta - path)
        rows["sine"], rows["cosine"] = a6 * np.cos(path), -a6 * np.sin(path)
    else:
        rows["theta"] = a6
        rows["force"] -= a6 * path
    if model.walk:
        rows["m"] = rows["g"] = np.interp(middle, model.node_c, model.coupling)
    sub = max(1, math.ceil(c.period / FILTER_STEP - 1e-9))
    u = np.zeros((len(z), sub))
    if model.source != BY_MEASUREMENT:
        edges = np.append((t[:-1, None] + np.diff(t)[:, None] * np.arange(sub) / sub).ravel(), t[-1])
        u = held_mean(c, edges - numbers["delay"]).reshape(u.shape)
    return Parameters(t, z, u, rows, n, likelihood.no_modes(len(z)))


def run(model: Model, c: Channels) -> Pass:
    """Run the filter over a log."""
    t, z, row = laid_out(model, c)
    made = likelihood.run(parameters(model, c, t, z))
    at = np.flatnonzero(np.isfinite(z.ravel()))
    e, s, rows = made.E.ravel()[at], made.S.ravel()[at], row.ravel()[at]
    counted = rows >= FIRST_ROWS
    ln_l = -0.5 * float(np.sum(np.log(s[counted]) + e[counted] ** 2 / s[counted])) if len(e) else -math.inf
    return Pass(made, at, e, s, at % 3, rows, counted, ln_l if math.isfinite(ln_l) else -math.inf)


def slopes(model: Model, c: Channels, base: Pass) -> np.ndarray:
    """Return the derivatives (c, q + o) of the innovations of `base` for the coefficients, its gains held."""
    t, z, _ = laid_out(model, c)
    values, out = model.coefficients, np.empty((len(base.e), len(model.coefficients)))
    for k, size in enumerate(model.coefficient_sizes()):
        moved = values.copy()
        moved[k] += COEFFICIENT_DIFFERENCE * size
        E = likelihood.follow(base.run, parameters(model.with_coefficients(moved), c, t, z))
        out[:, k] = (E.ravel()[base.at] - base.e) / (moved[k] - values[k])
    return out
