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

LOWEST, HIGHEST, SPACING = 0.1, 1.5, 0.04  # Hz: band of the frequency-domain method
DRIFT = 0.15            # s: a parameter's random walk has the relative std DRIFT/window after one window; see `walk`
PRIOR_STD = 0.25        # relative, of the parameters before the first row: the nominals' uncertainty
NOZZLE_RATE_STD = 0.5   # rad/s, of beta_dot before the first row
NO_PRIOR = 1.0e6        # first covariance of recursive least squares over a typical squared parameter
THRESHOLD = 0.5         # 1/s^2, of the ten-term fits: launchid's own default
HALF_WIDTH = 0.11       # s at 1 s, growing with the root of the window: half a subdomain of the tuned weak form
MANY = 400              # subdomains of the weak form

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


def pysindy_weak_tuned(log: Log, window: float, model: Model) -> np.ndarray:
    """pysindy's weak form on theta and beta with 400 subdomains of 2 HALF_WIDTH sqrt(window).

    Reinbold, Gurevich & Grigoriev, PRE 101, 2020; Messenger & Bortz, Multiscale Model. Simul. 19, 2021.
    FAVOUR: subdomains and their weights are built once, outside the timing after the first flight; tuned on `constant`
    and `vega_like`, where half a width of 0.1 s was best at 1 s, and 0.25..0.4 s at 10 s.
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


def frequency(log: Log, window: float, model: Model) -> np.ndarray:
    """Real-time equation error in the frequency domain, transforms restarted with every window.

    Morelli, AIAA-99-4043: recursive Fourier transform on a band (0.1..1.5 Hz by 0.04 Hz), derivative by i omega.
    FAVOUR: not in the publication, the window's end values of the rate, q(T) exp(-i omega T) - q(0), are unknowns too;
    the transient term of Pintelon & Schoukens, System Identification: A Frequency Domain Approach, 2nd ed., chapter 6.
    """
    omega = 2.0 * math.pi * np.arange(LOWEST, HIGHEST + 1e-9, SPACING)
    bounds = edges(log, window)
    signal = np.column_stack([log.theta, log.beta, log.theta_dot])
    transform = np.zeros((len(bounds) - 1, 3, len(omega)), complex)
    _recursive_transform(signal, bounds, np.exp(-1j * omega * log.period), transform)
    transform *= log.period
    out = np.full((len(transform), 2), np.nan)
    for w, (theta, beta, rate) in enumerate(transform):
        last = np.exp(-1j * omega * log.period * (bounds[w + 1] - bounds[w] - 1))
        matrix = np.column_stack([theta, beta, -last, np.ones(len(omega), complex)])
        right = 1j * omega * rate
        real = np.concatenate([matrix.real, matrix.imag])
        scale = np.linalg.norm(real, axis=0)
        scale[scale == 0.0] = 1.0
        out[w] = np.linalg.lstsq(real / scale, np.concatenate([right.real, right.imag]), rcond=None)[0][:2] / scale[:2]
    return out


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
def _extended_filter(z, command, unit, h, nozzle, noise, x, p, step, read, out):
    """Extended Kalman filter over (theta, theta_dot, beta, beta_dot, a6/unit, k1/unit).

    z (n, 3) measurements;  command (n,);  unit (n, 2) of the parameters over the step from each row
    noise (5,) variances;  x (6,), p (6, 6) inout;  step: variance of the walk per row
    read (w,) int64 rows: parameters read after;  out (w, 2)
    """
    f, work, gain, w = np.eye(6), np.zeros((6, 6)), np.zeros((4, 2)), 0
    for i in range(z.shape[0]):
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


def _profile(log: Log, model: Model) -> np.ndarray:
    """The nominal's a6 and k1 in the middle of the step from each row, shape (n, 2)."""
    middle = log.t + 0.5 * log.period
    return np.column_stack([np.interp(middle, model.profile_t, values)
                            for values in (model.profile_a6, model.profile_k1)])


def extended_kalman_profile(log: Log, window: float, model: Model) -> np.ndarray:
    """Extended Kalman filter over state and a6, k1, with the actuator's model and the command.

    Jategaonkar, Flight Vehicle System Identification, 2nd ed., chapter 7.  Noises from the nominal; started there
    +- 25 %; the parameters are random walks (`walk`) of the deviations from the nominal's profile.
    FAVOUR: knows the profile, as launchid does; compare with its tracked estimate, which also uses all data so far.
    """
    if model.delay:
        raise ValueError(f"model.delay={model.delay!r}: this filter knows no delay")
    h, noise, unit = log.period, model.variances(log.period), _profile(log, model)
    z = np.column_stack([log.theta, log.theta_dot, log.beta])
    x = np.array([*z[0], 0.0, model.profile_a6[0] / unit[0, 0], model.profile_k1[0] / unit[0, 1]])
    p = np.diag([*noise[:3], NOZZLE_RATE_STD**2, PRIOR_STD**2, PRIOR_STD**2])
    read = edges(log, window)[1:] - 1
    out = np.full((len(read), 2), np.nan)
    _extended_filter(z, log.beta_cmd, unit, h, _nozzle(model, h), noise, x, p, walk(h, window), read, out)
    return out


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
    Method("pysindy weak, tuned", pysindy_weak_tuned, pysindy=True),
    Method("integral", integral),
    Method("RLS, forgetting", recursive_least_squares, memory=True),
    Method("frequency domain", frequency),
    Method("extended Kalman, profile", extended_kalman_profile, at_end=True, memory=True),
    Method("launchid filtered", filtered),
    Method("launchid tracked", tracked, at_end=True, memory=True),
)
