"""Residuals of identified windows on a log, and predictions of theta by them.

residual    the weak form's (`launchid.weakform`): the increment of theta_dot over 0.2 s less the integral of the terms,
            over that time [rad/s^2], in the window that gave the estimate
prediction  theta over a horizon, run free from the measured theta and theta_dot with the measured beta, under the
            estimate of its own window and under that of the fitted window before, which has not seen it
noise       what the sensors' noise alone leaves of both under a model without an error: of the log's own levels, by
            third differences of its columns, drawn onto its rows

With a nominal, a6 and k1 follow its profile within a window, as the estimator has them (`shapes`). What is steady in a
window's residual (wind, offsets) is no contradiction: it is shown, taken off where whiteness is asked for, and part of
what the window predicts.
"""

import dataclasses
import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from launchid_core import Estimate
from sim.errors import InputError
from sim.nominal import Nominal

from ..judge.refusal import active_terms
from ..judge.terms import INCREMENT
from ..log.check import checked
from ..log.log import Log
from ..sums import inner, square
from ..weakform.late import Late
from ..weakform.modes import column, increments
from ..weakform.noise import noise_variance
from ..weakform.prepare import usable
from ..weakform.rows import Rows, slope

HORIZONS = (0.1, 0.5, 1.0)  # s
# increments from one to the next that counts for whiteness: neighbours share a sample and its noise
LAG_OF_WHITENESS = 2
MIN_PARAMETER = 1e-3  # 1/s^2: a parameter of the profile below it has no shape to speak of
RESIDUAL_LAGS = 10
MIN_PREDICTIONS = 5  # predictions with a fit
RESIDUAL_DRAWS = 4   # of the noise: 20 predictions then tell its share to 8 %
SEED = 0             # of the draws, the same each time
RIGID = {"theta", "beta"}


@dataclass(frozen=True, eq=False)
class Correlation:
    """Autocorrelation of residuals at lags 1, 2, ... (lags,); band: 99 % of white noise's values are within +-band."""

    values: np.ndarray
    band: float


@dataclass(frozen=True, eq=False)
class Predicted:
    """Predictions of theta over one horizon [s]: (n,) times t [s] predicted for, theta there [rad] measured, predicted
    by its own window's estimate (`within`) and by the window before (`before`, NaN: there is none)."""

    horizon: float
    t: np.ndarray
    measured: np.ndarray
    within: np.ndarray
    before: np.ndarray
    change: np.ndarray  # measured, over the horizon
    noise: np.ndarray   # (n, RESIDUAL_DRAWS) [rad] errors that noise alone makes

    @property
    def fits(self) -> tuple[float, float]:
        """(within, before) fits [%], 100 (1 - |error| / |change of theta over the horizon|): 0 is no better than no
        change; NaN of fewer than MIN_PREDICTIONS."""
        return _fit(self.measured - self.within, self.change), _fit(self.measured - self.before, self.change)

    @property
    def ceiling(self) -> float:
        """Fit [%] that a true model would have, with the sensors' noise alone as error; only chance exceeds it."""
        return _fit(np.sqrt(np.mean(self.noise**2, axis=1)), self.change)


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals (k,) [rad/s^2] at t (k,) [s], the middles of increments; noise (k,): the part of sensor noise alone;
    their autocorrelation (None: too few); predictions, one item a horizon."""

    t: np.ndarray
    residual: np.ndarray
    noise: np.ndarray
    correlation: Correlation | None
    predicted: tuple[Predicted, ...]


@dataclass(frozen=True, eq=False)
class Shaped:
    """Rows of a log, and a6 and k1 of the nominal's profile at them (2, n) [1/s^2]; None: constant within a window."""

    rows: Rows
    profile: np.ndarray | None

    def shapes(self, estimate: Estimate) -> np.ndarray:
        """Return a6 and k1 of the profile at every row (2, n), relative to their values in the window's middle; 1 where
        the estimate has other terms than theta and beta, or there is no profile."""
        if self.profile is None or not set(active_terms(estimate)) <= RIGID:
            return np.ones((2, len(self.rows.t)))
        middle = 0.5 * (estimate.t_start + estimate.t_end)
        at = np.array([[np.interp(middle, self.rows.t, row)] for row in self.profile])
        return np.where(np.abs(at) > MIN_PARAMETER, self.profile / np.where(np.abs(at) > MIN_PARAMETER, at, 1.0), 1.0)


def residuals(log: Log, estimates: list[Estimate], nominal: Nominal | None = None,
              late: Late | None = None) -> Residuals:
    """Return residuals and predictions of the fitted windows, also of those that the log contradicts (status `MODEL`).

    nominal  whose profile the estimates follow (`filtered`); None: constant in a window
    late     how much later than logged beta acts in the estimates; None: as logged
    InputError if no window was fitted or the log is too short.  A rate that is not measured is the slope of theta.
    """
    rows = usable(checked(log), is_steadied=False)
    if rows is None or rows.t[-1] - rows.t[0] < 2.0 * INCREMENT:
        raise InputError(f"{log.path}: residuals need theta and beta over more than {2.0 * INCREMENT:g} s, which the "
                         "log lacks")
    rows = rows if late is None else late.acting(rows)
    valid = [estimate for estimate in estimates if estimate.valid]
    if not valid:
        raise InputError(f"{log.path}: no window has a fit, so there are no residuals; expected a log that identify, "
                         "without residuals, finds valid windows in")
    shaped = Shaped(rows, None if nominal is None else np.array(nominal.vehicle.at(rows.t)))
    noisy = [with_noise(rows, np.random.default_rng((SEED, k))) for k in range(RESIDUAL_DRAWS)]
    left = [_weak(shaped, estimate) for estimate in valid]
    t, e = (np.concatenate([each[k] for each in left]) for k in (0, 1))
    same = Shaped(noisy[0], shaped.profile)
    alone = np.concatenate([_weak(same, estimate)[1] for estimate in valid]) - e
    fitted = [(estimate, float(each[1].mean()) if len(each[1]) else 0.0)
              for estimate, each in zip(valid, left, strict=True)]
    apart = LAG_OF_WHITENESS * max(1, round(INCREMENT / rows.period))
    return Residuals(t, e, alone, _correlation([each[1] for each in left], apart),
                     tuple(_ahead(shaped, _joined(noisy), fitted, horizon) for horizon in HORIZONS))


def with_noise(rows: Rows, rng: np.random.Generator) -> Rows:
    """Return the rows with white noise of their own level added; a rate that is not measured is theta's slope."""
    def drawn(x: np.ndarray) -> np.ndarray:
        return np.asarray(x + np.sqrt(noise_variance(x)) * rng.standard_normal(len(x)))

    theta, beta = drawn(rows.theta), drawn(rows.beta)
    return dataclasses.replace(rows, theta=theta, beta=beta,
                               theta_dot=drawn(rows.theta_dot) if rows.has_rate else
                               slope(rows.t, theta, max(1, round(rows.reach / rows.period))))


def _joined(parts: list[Rows]) -> Rows:
    """Return several draws of the same rows, one after the other."""
    columns: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts])
                               for name in ("t", "theta", "gamma", "theta_dot", "beta")}
    return dataclasses.replace(parts[0], **columns)


def _weak(shaped: Shaped, estimate: Estimate) -> tuple[np.ndarray, np.ndarray]:
    """Return (times (k,) [s], residual (k,) [rad/s^2]) of a window."""
    terms, (a6, k1) = active_terms(estimate), shaped.shapes(estimate)
    rows = shaped.rows
    rows = dataclasses.replace(rows, theta=a6 * rows.theta, gamma=a6 * rows.gamma, beta=k1 * rows.beta)
    begin, end, y, phi = increments(rows.part(rows.cut(estimate.t_start, estimate.t_end)), terms, INCREMENT)
    return 0.5 * (begin + end), (y - phi @ _coefficients(estimate)) / (end - begin)


def _correlation(left: list[np.ndarray], spacing: int) -> Correlation | None:
    """Return the autocorrelation of residuals `spacing` rows apart, each window's mean removed; None if too few."""
    e = np.concatenate([(e - e.mean())[::spacing] for e in left if len(e)] or [np.zeros(0)])
    lags = min(RESIDUAL_LAGS, len(e) // 3)
    if lags < 1 or not np.any(e != 0.0):
        return None
    values = np.array([inner(e[lag:], e[:len(e) - lag]) for lag in range(1, lags + 1)]) / square(e)
    return Correlation(values, 2.576 / float(np.sqrt(len(e))))  # 99 % of a normal


def _coefficients(estimate: Estimate) -> np.ndarray:
    return np.asarray(estimate.xi[estimate.support[:, 1], 1])


def _ahead(shaped: Shaped, noisy: Rows, fitted: list[tuple[Estimate, float]], horizon: float) -> Predicted:
    """Return predictions from rows a horizon [s] apart, which join without overlap, in windows that are long enough.

    noisy   RESIDUAL_DRAWS of the rows with noise, joined
    fitted  (estimate, its steady acceleration [rad/s^2]) of each window
    """
    rows = shaped.rows
    period = float(np.median(np.diff(rows.t)))
    steps = max(1, round(horizon / period))
    parts = []
    for previous, fit in itertools.pairwise([None, *fitted]):
        assert fit is not None
        estimate = fit[0]
        at = rows.cut(estimate.t_start, estimate.t_end)
        start = np.arange(at.start, min(at.stop + 1, len(rows.t)) - steps, steps)  # to the next window's first row
        start = start[rows.t[start + steps] - rows.t[start] <= 1.5 * steps * period]  # no gap within
        if len(start):
            ahead, before = (_run(rows, shaped.shapes(each[0]), *each, start, steps) if each is not None else
                             np.full(len(start), np.nan) for each in (fit, previous))
            theta = rows.theta[start + steps]
            many = (start[:, None] + len(rows.t) * np.arange(RESIDUAL_DRAWS)).ravel()
            error = noisy.theta[many + steps] - _run(noisy, np.tile(shaped.shapes(estimate), RESIDUAL_DRAWS), *fit,
                                                     many, steps)
            parts.append((rows.t[start + steps], theta, ahead, before, theta - rows.theta[start],
                          error.reshape(-1, RESIDUAL_DRAWS) - (theta - ahead)[:, None]))
    joined = [np.concatenate(each) for each in zip(*parts, strict=True)] if parts else \
        [*[np.zeros(0)] * 5, np.zeros((0, RESIDUAL_DRAWS))]
    return Predicted(horizon, *joined)


def _run(rows: Rows, shapes: np.ndarray, estimate: Estimate, steady: float, start: np.ndarray,
         steps: int) -> np.ndarray:
    """Return theta (m,) `steps` rows after each start (m,), by Heun's rule on the measured beta; a6 and k1 times
    `shapes` (2, n) at the rows."""
    a6, k1 = shapes
    terms, xi, middle = active_terms(estimate), _coefficients(estimate), 0.5 * (estimate.t_start + estimate.t_end)
    theta, theta_dot = rows.theta[start].copy(), rows.theta_dot[start].copy()

    def acceleration(at: np.ndarray, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        total = np.full(len(at), steady)
        for term, coefficient in zip(terms, xi.tolist(), strict=True):
            total += coefficient * column(term, a6[at] * (x - rows.gamma[at]), v, k1[at] * rows.beta[at],
                                          rows.t[at] - middle)
        return total

    for k in range(steps):
        h = rows.t[start + k + 1] - rows.t[start + k]
        first = acceleration(start + k, theta, theta_dot)
        second = acceleration(start + k + 1, theta + h * theta_dot, theta_dot + h * first)
        theta = theta + h * theta_dot + 0.5 * h * h * first
        theta_dot = theta_dot + 0.5 * h * (first + second)
    return theta


def _fit(error: np.ndarray, change: np.ndarray) -> float:
    seen = np.isfinite(error)
    scale = float(np.sum(change[seen]**2))
    if np.count_nonzero(seen) < MIN_PREDICTIONS or not scale > 0.0:
        return float("nan")
    return 100.0 * (1.0 - float(np.sqrt(np.sum(error[seen]**2) / scale)))
