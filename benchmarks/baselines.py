"""The tools that a user could take instead of launchid's filtered form: one function a tool, one flight at a time.

Every function gets the log of one flight (`Log`, one row a sample, `flight` suite),
the window [s] and the `Model` (nominal profile, actuator, noises; most ignore it),
and returns (a6, k1) of every window, shape (windows, 2), NaN where it has none.
Windows lie end to end from the first row on.  Nothing here draws random numbers
but pysindy's weak library, whose subdomains are seeded.

Choices that favour the baseline are marked FAVOUR.
"""

import functools
import itertools
import math
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numba
import numpy as np

from launchid_core import Config, Estimator, Model, Sample, Status
from launchid_core.algebra.library import LIBRARIES

LOWEST, HIGHEST, SPACING = 0.1, 1.5, 0.04  # Hz: band of the frequency-domain method
DRIFT = 0.15            # s: a parameter's random walk has the relative std DRIFT/window after one window; see `walk`
SLOW = 0.0015           # 1/sqrt(s): relative random walk of the slow filter, the slowest in launchid's own tracker
PRIOR_STD = 0.25        # relative, of the parameters before the first row: the nominals' uncertainty
RESTART_STD = 2.0       # relative, of the parameters at each restart: of no weight where the bound is below 30 %
NOZZLE_RATE_STD = 0.5   # rad/s, of beta_dot before the first row
NO_PRIOR = 1.0e6        # first covariance of recursive least squares over a typical squared parameter
THRESHOLD = 0.5         # 1/s^2, of the ten-term fits: launchid's own default
HALF_WIDTH = 0.11       # s at 1 s, growing with the root of the window: half a subdomain of the tuned weak form
SUBDOMAINS, MANY = 100, 400  # pysindy's default; the tuned weak form's

kernel = numba.njit(cache=True, error_model="numpy", nogil=True)


class Log(NamedTuple):
    """Arrays of one flight, equal length."""

    t: np.ndarray          # s
    theta: np.ndarray      # rad
    theta_dot: np.ndarray  # rad/s
    beta: np.ndarray       # rad
    beta_cmd: np.ndarray   # rad

    @property
    def period(self) -> float:
        """Time between rows [s]."""
        return float(self.t[1] - self.t[0])


def edges(log: Log, window: float) -> np.ndarray:
    """First row of every complete window, and the row after the last: shape (windows + 1,)."""
    t = log.t - log.t[0]
    count = math.floor((t[-1] + 1.5 * log.period) / window)
    index = np.floor(t / window + 1e-9)
    return np.searchsorted(index, np.arange(count + 1))


# --- launchid itself -------------------------------------------------------------------------------------------------

def launchid(log: Log, window: float, model: Model | None = None, tracked: bool = False,
             **choices: Any) -> np.ndarray:
    """launchid's Estimator fed by a host loop; `tracked`: the tracked estimate at the window's end instead."""
    estimator = Estimator(Config(window=window, sample_period=log.period, model=model, **choices))
    update, rows = estimator.update, []
    columns = [column.tolist() for column in (log.t, log.theta, log.theta_dot, log.beta)]
    for t, theta, theta_dot, beta, command in zip(*columns, log.beta_cmd.tolist(), strict=True):
        if update(Sample(t, theta, theta_dot, beta, math.nan, command)) == Status.WINDOW_COMPLETE:
            estimate = estimator.estimate()
            assert estimate is not None
            chosen = estimate.tracked if tracked else estimate
            rows.append((chosen.a6, chosen.k1))
    return np.array(rows).reshape(-1, 2)


def filtered(log: Log, window: float, model: Model) -> np.ndarray:
    """launchid's filtered form, noise declared: a window's own data only."""
    return launchid(log, window, model, formulation="filtered", noise="declared")


def tracked(log: Log, window: float, model: Model) -> np.ndarray:
    """launchid's tracked estimate at each window's end: all data so far."""
    return launchid(log, window, model, tracked=True, formulation="filtered", noise="declared")


def integral(log: Log, window: float, model: Model) -> np.ndarray:
    """launchid's integral form on theta and beta: no model needed."""
    return launchid(log, window, formulation="integral")


def difference_ten(log: Log, window: float, model: Model) -> np.ndarray:
    """Differenced rate, sequentially thresholded least squares on the ten quadratic terms.

    Navarro-Tapia et al.'s way, and Brunton, Proctor & Kutz, PNAS 113, 2016, with launchid's five-point differences.
    """
    return launchid(log, window, formulation="difference", library="quadratic", threshold=THRESHOLD)


def difference_two(log: Log, window: float, model: Model) -> np.ndarray:
    """Differenced rate, least squares on theta and beta."""
    return launchid(log, window, formulation="difference", library="rigid-body")


def integral_profile(log: Log, window: float, model: Model) -> np.ndarray:
    """The integral form with the nominal's profile in its regressors: deviations are constant over a window.

    FAVOUR: launchid's own integral form knows no profile; this row tells what the profile alone brings.
    """
    ratio = np.column_stack([np.interp(log.t, model.profile_t, values)
                             for values in (model.profile_a6, model.profile_k1)])
    rows = ratio * np.column_stack([log.theta, log.beta])
    bounds = edges(log, window)
    out = np.full((len(bounds) - 1, 2), np.nan)
    for w, (first, end) in enumerate(itertools.pairwise(bounds)):
        piece = rows[first:end]
        integrals = np.zeros_like(piece)
        integrals[1:] = np.cumsum(0.5 * log.period * (piece[1:] + piece[:-1]), axis=0)
        scale = np.linalg.norm(integrals, axis=0)
        rate = log.theta_dot[first:end]
        deviation = np.linalg.lstsq((integrals - integrals.mean(axis=0)) / scale, rate - rate.mean(), rcond=None)[0]
        centre = log.t[first] + 0.5 * window
        out[w] = deviation / scale * (np.interp(centre, model.profile_t, model.profile_a6),
                                      np.interp(centre, model.profile_t, model.profile_k1))
    return out


# --- pysindy ---------------------------------------------------------------------------------------------------------

def _fit(library: Any, threshold: float, rows: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Coefficients of the theta_dot equation: pysindy.SINDy, STLSQ without ridge, default differentiation."""
    import pysindy

    model = pysindy.SINDy(feature_library=library, optimizer=pysindy.STLSQ(threshold=threshold, alpha=0.0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(rows, t=t)
    return np.asarray(model.coefficients())[1]


def _pysindy(log: Log, window: float, library: Callable[[np.ndarray], Any], threshold: float,
             places: tuple[int, int]) -> np.ndarray:
    """A pysindy fit of (theta, theta_dot, beta) per window; `places` of theta and beta in the library."""
    states = np.column_stack([log.theta, log.theta_dot, log.beta])
    bounds = edges(log, window)
    out = np.full((len(bounds) - 1, 2), np.nan)
    for w, (first, end) in enumerate(itertools.pairwise(bounds)):
        grid = np.arange(end - first) * log.period
        out[w] = _fit(library(grid), threshold, states[first:end], grid)[list(places)]
    return out


def _theta_beta() -> Any:
    """A pysindy library of theta and beta alone, out of (theta, theta_dot, beta)."""
    import pysindy

    return pysindy.CustomLibrary(library_functions=[lambda theta, rate, beta: theta, lambda theta, rate, beta: beta])


def pysindy_ten(log: Log, window: float, model: Model) -> np.ndarray:
    """pysindy, ten quadratic terms, default finite differences (second order).  de Silva et al., JOSS 5, 2020."""
    import pysindy

    names = LIBRARIES["quadratic"]
    return _pysindy(log, window, lambda grid: pysindy.PolynomialLibrary(degree=2), THRESHOLD,
                    (names.index("theta"), names.index("beta")))


def pysindy_two(log: Log, window: float, model: Model) -> np.ndarray:
    """pysindy, theta and beta, default finite differences: least squares, no threshold."""
    return _pysindy(log, window, lambda grid: _theta_beta(), 0.0, (0, 1))


@functools.lru_cache(maxsize=32)
def _weak_library(rows: int, period: float, half_width: float | None, subdomains: int) -> Any:
    """pysindy's weak library on a window's time grid; its random subdomains are always the same."""
    import pysindy

    state = np.random.get_state()
    np.random.seed(0)  # the library draws from the global generator
    grid = np.arange(rows) * period
    width = None if half_width is None else [min(half_width, 0.45 * grid[-1])]
    library = pysindy.WeakPDELibrary(function_library=_theta_beta(), spatiotemporal_grid=grid, K=subdomains,
                                     H_xt=width)
    np.random.set_state(state)
    return library


def pysindy_weak(log: Log, window: float, model: Model) -> np.ndarray:
    """pysindy's weak form on theta and beta, all defaults (100 subdomains of a tenth of the window).

    Reinbold, Gurevich & Grigoriev, PRE 101, 2020; Messenger & Bortz, Multiscale Model. Simul. 19, 2021.
    FAVOUR: subdomains and their weights are built once, outside the timing after the first flight.
    """
    return _pysindy(log, window, lambda grid: _weak_library(len(grid), log.period, None, SUBDOMAINS), 0.0, (0, 1))


def pysindy_weak_tuned(log: Log, window: float, model: Model) -> np.ndarray:
    """The same with 400 subdomains of 2 HALF_WIDTH sqrt(window).

    FAVOUR: tuned on `constant` and `vega_like`, where half a width of 0.1 s was best at 1 s, and 0.25..0.4 s at 10 s.
    """
    half_width = HALF_WIDTH * math.sqrt(window)
    return _pysindy(log, window, lambda grid: _weak_library(len(grid), log.period, half_width, MANY), 0.0, (0, 1))


# --- recursive least squares -----------------------------------------------------------------------------------------

@kernel
def _forgetting(rows, target, factor, read, out):
    """Exponentially weighted recursive least squares of two parameters.

    rows (n, 2), target (n,) in;  factor in, 0..1;  read (w,) in int64, rows after which to read;  out (w, 2) out
    """
    p00, p01, p11 = NO_PRIOR, 0.0, NO_PRIOR
    a, k, w = 0.0, 0.0, 0
    for i in range(rows.shape[0]):
        x, y = rows[i, 0], rows[i, 1]
        g0, g1 = p00 * x + p01 * y, p01 * x + p11 * y
        scale = 1.0 / (factor + x * g0 + y * g1)
        e = (target[i] - a * x - k * y) * scale
        a += g0 * e
        k += g1 * e
        p00, p01, p11 = (p00 - g0 * g0 * scale) / factor, (p01 - g0 * g1 * scale) / factor, \
            (p11 - g1 * g1 * scale) / factor
        while w < read.shape[0] and read[w] == i:
            out[w, 0], out[w, 1] = a, k
            w += 1


def recursive_least_squares(log: Log, window: float, model: Model) -> np.ndarray:
    """Recursive least squares on the centrally differenced rate, forgetting 1 - period/window (memory: one window).

    Ljung, System Identification, 2nd ed., section 11.2.  Uses data from before the window, with half the variance of
    a rectangular window of the same memory.  FAVOUR: compared with the truth at the window's centre although its data
    are one window old on average.
    """
    rate = (log.theta_dot[2:] - log.theta_dot[:-2]) / (log.t[2:] - log.t[:-2])
    rows = np.column_stack([log.theta, log.beta])[1:-1]
    read = np.clip(edges(log, window)[1:] - 2, 0, len(rows) - 1)
    out = np.full((len(read), 2), np.nan)
    _forgetting(np.ascontiguousarray(rows), rate, 1.0 - log.period / window, read, out)
    return out


# --- frequency domain ------------------------------------------------------------------------------------------------

@kernel
def _recursive_transform(signal, bounds, turn, out):
    """Recursive discrete Fourier transform of every window, restarted at its first row.

    signal (n, s), bounds (w + 1,) in;  turn (f,) in, exp(-i omega h);  out (w, s, f) complex, sum of x exp(-i omega t)
    """
    rotor = np.ones(turn.shape[0], np.complex128)
    for w in range(bounds.shape[0] - 1):
        rotor[:] = 1.0
        for i in range(bounds[w], bounds[w + 1]):
            weight = 0.5 if i == bounds[w] or i == bounds[w + 1] - 1 else 1.0  # trapezoidal rule
            for f in range(turn.shape[0]):
                for s in range(signal.shape[1]):
                    out[w, s, f] += weight * signal[i, s] * rotor[f]
                rotor[f] *= turn[f]


def _frequency(log: Log, window: float, ends: bool) -> np.ndarray:
    """Complex least squares of i omega q = a6 theta + k1 beta per window; with `ends` the window's end values of q,
    q(T) exp(-i omega T) - q(0), are unknowns too."""
    omega = 2.0 * math.pi * np.arange(LOWEST, HIGHEST + 1e-9, SPACING)
    bounds = edges(log, window)
    signal = np.column_stack([log.theta, log.beta, log.theta_dot])
    transform = np.zeros((len(bounds) - 1, 3, len(omega)), complex)
    _recursive_transform(signal, bounds, np.exp(-1j * omega * log.period), transform)
    transform *= log.period
    out = np.full((len(transform), 2), np.nan)
    for w, (theta, beta, rate) in enumerate(transform):
        columns = [theta, beta]
        if ends:
            last = np.exp(-1j * omega * log.period * (bounds[w + 1] - bounds[w] - 1))
            columns += [-last, np.ones(len(omega), complex)]
        matrix = np.column_stack(columns)
        right = 1j * omega * rate
        real = np.concatenate([matrix.real, matrix.imag])
        scale = np.linalg.norm(real, axis=0)
        scale[scale == 0.0] = 1.0
        out[w] = np.linalg.lstsq(real / scale, np.concatenate([right.real, right.imag]), rcond=None)[0][:2] / scale[:2]
    return out


def frequency(log: Log, window: float, model: Model) -> np.ndarray:
    """Real-time equation error in the frequency domain as published, transforms restarted with every window.

    Morelli, AIAA-99-4043: recursive Fourier transform on a band (0.1..1.5 Hz by 0.04 Hz), derivative by i omega.
    Limitation: the derivative's transform lacks the values at the window's ends, harmless from trim to trim only.
    """
    return _frequency(log, window, ends=False)


def frequency_ends(log: Log, window: float, model: Model) -> np.ndarray:
    """The same with the rate's two end values as unknowns.

    FAVOUR: not in the publication; the transient term of Pintelon & Schoukens, System Identification: A Frequency
    Domain Approach, 2nd ed., chapter 6.
    """
    return _frequency(log, window, ends=True)


# --- parameters as states --------------------------------------------------------------------------------------------

def walk(period: float, window: float) -> float:
    """Variance per row of the relative random walk of a parameter, matched to the window.

    A random walk whose std after one window is the std that one window's data give makes the steady-state memory one
    window.  The bounds of the nominals are about 0.15 s / window (15, 3, 1.5 % for 1, 5, 10 s): DRIFT.
    """
    return (DRIFT / window) ** 2 * period / window


@kernel
def _scalar_update(x, p, channel, z, r):
    """Measurement z of state `channel` with variance r; covariance kept symmetric."""
    n = x.shape[0]
    scale = 1.0 / (p[channel, channel] + r)
    e = (z - x[channel]) * scale
    column = p[:, channel].copy()
    for i in range(n):
        x[i] += column[i] * e
        for j in range(n):
            p[i, j] -= column[i] * column[j] * scale


@kernel
def _congruence(f, p, work):
    """p <- f p f'."""
    n = p.shape[0]
    for i in range(n):
        for j in range(n):
            value = 0.0
            for k in range(n):
                value += f[i, k] * p[k, j]
            work[i, j] = value
    for i in range(n):
        for j in range(n):
            value = 0.0
            for k in range(n):
                value += work[i, k] * f[j, k]
            p[i, j] = value


@kernel
def _linear_filter(theta, rate, beta, h, x, p, r, q, read, out):
    """Kalman filter over (theta_dot, a6, k1): theta and beta are regressors, theta_dot is measured.

    x (3,), p (3, 3) inout;  r measurement variance;  q (3,) process variances per row
    """
    f, work, w = np.eye(3), np.zeros((3, 3)), 0
    for i in range(theta.shape[0]):
        _scalar_update(x, p, 0, rate[i], r)
        while w < read.shape[0] and read[w] == i:
            out[w, 0], out[w, 1] = x[1], x[2]
            w += 1
        if i + 1 < theta.shape[0]:
            f[0, 1] = 0.5 * h * (theta[i] + theta[i + 1])
            f[0, 2] = 0.5 * h * (beta[i] + beta[i + 1])
            x[0] += f[0, 1] * x[1] + f[0, 2] * x[2]
            _congruence(f, p, work)
            for j in range(3):
                p[j, j] += q[j]


def linear_kalman(log: Log, window: float, model: Model) -> np.ndarray:
    """Linear Kalman filter with the parameters as random-walk states, theta and beta as measured regressors.

    The idea of the Sindy Kalman filter (Pillonetto, Yazdani & Aravkin, arXiv 2511.11178), its library reduced to the
    active terms, plus the rate itself as a state so that its noise is filtered and not differenced.  Noises from the
    nominal; the regressors' noise counts as process noise.  Read at each window's end.
    """
    h, noise = log.period, model.variances(log.period)
    a6, k1 = _typical(model)
    acceleration = noise[4] + a6**2 * noise[0] + k1**2 * noise[2]
    step = walk(h, window)
    x = np.array([log.theta_dot[0], model.profile_a6[0], model.profile_k1[0]])
    p = np.diag([noise[1], (PRIOR_STD * a6) ** 2, (PRIOR_STD * k1) ** 2])
    read = edges(log, window)[1:] - 1
    out = np.full((len(read), 2), np.nan)
    _linear_filter(log.theta, log.theta_dot, log.beta, h, x, p, noise[1],
                   np.array([h**2 * acceleration, step * a6**2, step * k1**2]), read, out)
    return out


def _typical(model: Model) -> tuple[float, float]:
    """Mean size of the nominal's a6 and k1 over the flight."""
    return float(np.mean(np.abs(model.profile_a6))), float(np.mean(np.abs(model.profile_k1)))


def _nozzle(model: Model, h: float) -> np.ndarray:
    """Rows beta, beta_dot after a step h and the integral and double integral of beta over it, as functions of
    (beta, beta_dot, held command): shape (4, 3).  Matrix exponential by its Taylor series."""
    w = model.natural_frequency
    a = np.zeros((5, 5))
    a[0, 1] = a[1, 2] = a[2, 3] = 1.0
    a[3, 2:] = -w * w, -2.0 * model.damping_ratio * w, w * w
    term = total = np.eye(5)
    for order in range(1, 25):
        term = term @ a * (h / order)
        total = total + term
    return np.ascontiguousarray(total[[2, 3, 1, 0], 2:])


@kernel
def _predict_extended(x, a6, k1, u, h, nozzle, f, gain):
    """Time update of (theta, theta_dot, beta, beta_dot); fills the Jacobian f (6, 6) for parameters in the unit of
    a6, k1, and gain (4, 2), the effect of a held command and a held acceleration."""
    b, r = x[2], x[3]
    once = nozzle[2, 0] * b + nozzle[2, 1] * r + nozzle[2, 2] * u
    twice = nozzle[3, 0] * b + nozzle[3, 1] * r + nozzle[3, 2] * u
    c, s = 1.0 + 0.5 * a6 * h * h, h + a6 * h * h * h / 6.0
    th, q = x[0], x[1]
    f[0, 0], f[0, 1], f[1, 0], f[1, 1] = c, s, a6 * s, c
    for j in range(2):
        f[0, 2 + j], f[1, 2 + j] = k1 * nozzle[3, j], k1 * nozzle[2, j]
        f[2, 2 + j], f[3, 2 + j] = nozzle[0, j], nozzle[1, j]
    f[0, 4], f[1, 4] = 0.5 * h * h * th + h * h * h / 6.0 * q, h * th + 0.5 * h * h * q
    f[0, 5], f[1, 5] = twice, once
    x[0], x[1] = c * th + s * q + k1 * twice, a6 * s * th + c * q + k1 * once
    x[2] = nozzle[0, 0] * b + nozzle[0, 1] * r + nozzle[0, 2] * u
    x[3] = nozzle[1, 0] * b + nozzle[1, 1] * r + nozzle[1, 2] * u
    gain[0, 0], gain[1, 0], gain[2, 0], gain[3, 0] = k1 * nozzle[3, 2], k1 * nozzle[2, 2], nozzle[0, 2], nozzle[1, 2]
    gain[0, 1], gain[1, 1] = 0.5 * h * h, h


@kernel
def _extended_filter(z, command, unit, h, nozzle, noise, x, p, step, restart, read, out):
    """Extended Kalman filter over (theta, theta_dot, beta, beta_dot, a6/unit, k1/unit).

    z (n, 3) measurements;  command (n,);  unit (n, 2) of the parameters over the step from each row
    noise (5,) variances;  x (6,), p (6, 6) inout;  step: variance of the walk per row
    restart (r,), read (w,) int64 rows: parameters forgotten before, read after;  out (w, 2)
    """
    f, work, gain, w, r = np.eye(6), np.zeros((6, 6)), np.zeros((4, 2)), 0, 0
    for i in range(z.shape[0]):
        if r < restart.shape[0] and restart[r] == i:
            r += 1
            x[4:] = 1.0
            p[4:, :] = 0.0
            p[:, 4:] = 0.0
            p[4, 4] = p[5, 5] = RESTART_STD * RESTART_STD
        for channel in range(3):
            _scalar_update(x, p, channel, z[i, channel], noise[channel])
        while w < read.shape[0] and read[w] == i:
            out[w, 0], out[w, 1] = x[4] * unit[i, 0], x[5] * unit[i, 1]
            w += 1
        _predict_extended(x, x[4] * unit[i, 0], x[5] * unit[i, 1], command[i], h, nozzle, f, gain)
        f[0, 4] *= unit[i, 0]
        f[1, 4] *= unit[i, 0]
        f[0, 5] *= unit[i, 1]
        f[1, 5] *= unit[i, 1]
        _congruence(f, p, work)
        for j in range(4):
            for k in range(4):
                p[j, k] += gain[j, 0] * gain[k, 0] * noise[3] + gain[j, 1] * gain[k, 1] * noise[4]
        p[4, 4] += step
        p[5, 5] += step


def _extended(log: Log, window: float, model: Model, unit: np.ndarray, step: float,
              restart: bool = False) -> np.ndarray:
    """The extended filter with parameters in `unit` (n, 2) [1/s^2], started at the nominal; `step` of their walk."""
    if model.delay:
        raise ValueError(f"model.delay={model.delay!r}: this filter knows no delay")
    h, noise = log.period, model.variances(log.period)
    z = np.column_stack([log.theta, log.theta_dot, log.beta])
    x = np.array([*z[0], 0.0, model.profile_a6[0] / unit[0, 0], model.profile_k1[0] / unit[0, 1]])
    p = np.diag([*noise[:3], NOZZLE_RATE_STD**2, PRIOR_STD**2, PRIOR_STD**2])
    bounds = edges(log, window)
    out = np.full((len(bounds) - 1, 2), np.nan)
    _extended_filter(z, log.beta_cmd, unit, h, _nozzle(model, h), noise, x, p, step,
                     bounds[:-1] if restart else bounds[:0], bounds[1:] - 1, out)
    return out


def extended_kalman(log: Log, window: float, model: Model) -> np.ndarray:
    """Extended Kalman filter over state and a6, k1 as random walks, with the actuator's model and the command.

    Jategaonkar, Flight Vehicle System Identification, 2nd ed., chapter 7.  Noises from the nominal; started at the
    nominal's first a6, k1 +- 25 % of their mean over the flight; walk as in `walk`, relative to that mean.
    """
    unit = np.tile(_typical(model), (len(log.t), 1))
    return _extended(log, window, model, unit, walk(log.period, window))


def _profile(log: Log, model: Model) -> np.ndarray:
    """The nominal's a6 and k1 in the middle of the step from each row, shape (n, 2)."""
    middle = log.t + 0.5 * log.period
    return np.column_stack([np.interp(middle, model.profile_t, values)
                            for values in (model.profile_a6, model.profile_k1)])


def extended_kalman_profile(log: Log, window: float, model: Model) -> np.ndarray:
    """The same, the random walks being the deviations relative to the nominal's profile: it knows what launchid does.

    FAVOUR: nobody's default; compare with launchid's tracked estimate, which also uses all data since lift-off.
    """
    return _extended(log, window, model, _profile(log, model), walk(log.period, window))


def extended_kalman_slow(log: Log, window: float, model: Model) -> np.ndarray:
    """The same with a walk of SLOW per sqrt(s) whatever the window.

    FAVOUR: these flights' deviations do not drift at all, so that the slowest walk is the best.
    """
    return _extended(log, window, model, _profile(log, model), SLOW**2 * log.period)


def extended_kalman_restarted(log: Log, window: float, model: Model) -> np.ndarray:
    """The same without a walk, its parameters forgotten (nominal +- RESTART_STD) when a window begins.

    The filter's answer to the same question as launchid's filtered form, but the vehicle's state is carried over
    from the window before, which the bound does not count: a few per cent in short windows.
    """
    return _extended(log, window, model, _profile(log, model), 0.0, restart=True)


class Method(NamedTuple):
    """A row of the comparison."""

    name: str
    run: Callable[[Log, float, Model], np.ndarray]
    at_end: bool = False   # compared with the truth at the window's end, not at its centre
    memory: bool = False   # knows data from before the window (or a prior), which the window's bound does not
    pysindy: bool = False  # needs pysindy; slow


METHODS = (
    Method("difference, ten terms", difference_ten),
    Method("difference, two terms", difference_two),
    Method("pysindy, ten terms", pysindy_ten, pysindy=True),
    Method("pysindy, two terms", pysindy_two, pysindy=True),
    Method("pysindy weak, default", pysindy_weak, pysindy=True),
    Method("pysindy weak, tuned", pysindy_weak_tuned, pysindy=True),
    Method("integral", integral),
    Method("integral, profile", integral_profile),
    Method("RLS, forgetting", recursive_least_squares, memory=True),
    Method("frequency domain", frequency),
    Method("frequency domain, ends", frequency_ends),
    Method("linear Kalman", linear_kalman, at_end=True, memory=True),
    Method("extended Kalman", extended_kalman, at_end=True, memory=True),
    Method("extended Kalman, profile", extended_kalman_profile, at_end=True, memory=True),
    Method("extended Kalman, slow", extended_kalman_slow, at_end=True, memory=True),
    Method("extended Kalman, restart", extended_kalman_restarted, at_end=True, memory=True),
    Method("launchid filtered", filtered),
    Method("launchid tracked", tracked, at_end=True, memory=True),
)
