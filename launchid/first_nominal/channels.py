"""Prepare a log for the fit of a first nominal: usable rows, single bad values masked, missing columns NaN."""

import math
from dataclasses import dataclass, replace

import numpy as np

from sim.errors import InputError
from sim.plant import CLOCK_DIGITS

from ..formatting import slow_hint
from ..log.log import Log
from ..log.slope import ONE_MOTION
from ..log.stamps import usable_rows
from ..series import filled
from ..sums import combined, least_squares, products, square

MIN_ROWS_A_LOG = 60    # rows, 1.2 s at 50 Hz: below, noise levels and a held-out part are chance
SPIKE_OVER_MEDIAN = 20.0  # times the median distance from the median of five rows: one in a million is at 8
SPIKE_OVER_LARGEST = 4.0  # times the largest step beside it: fast motion is no spike
ROWS_BESIDE_SPIKE = 6  # rows beside it
RATE_LAG = 0.25        # sample periods by which a measured rate may lag the slope of theta
RATE_SCALE = 0.02      # by which it may differ from it
OUTLIER_SIGMAS = 4.0   # standard deviations beyond


@dataclass(frozen=True, eq=False)
class Channels:
    """Rows with increasing stamps t (n,) [s] from 0; theta, beta [rad], rates [rad/s] (n,): NaN where not measured.

    start [s] of the log;  period [s];  notes  what was left out, in words
    """

    path: str
    start: float
    period: float
    t: np.ndarray
    theta: np.ndarray
    theta_dot: np.ndarray
    beta: np.ndarray
    beta_cmd: np.ndarray
    gamma: np.ndarray      # rad, at every row; 0 where the log has no flight path
    notes: tuple[str, ...]
    driven: bool = False   # the command is what drives, in however few rows it is

    def has(self, name: str) -> bool:
        """Whether column `name` was measured in more than half of the rows."""
        if name == "beta_cmd" and self.driven:
            return True
        return bool(np.mean(np.isfinite(getattr(self, name))) > 0.5)

    def part(self, first: int, end: int) -> "Channels":
        """Return rows first to end - 1."""
        at = slice(first, end)
        return replace(self, t=self.t[at], theta=self.theta[at], theta_dot=self.theta_dot[at], beta=self.beta[at],
                       beta_cmd=self.beta_cmd[at], gamma=self.gamma[at])


def channels(log: Log) -> Channels:
    """Return a log's usable rows, single spikes masked; InputError if it has no motion, no input, or too few rows."""
    moving = [name for name in ("theta", "theta_dot") if name in log.columns]
    driven = [name for name in ("beta", "beta_cmd") if name in log.columns]
    if not moving or not driven:
        missing = "theta, theta_dot" if not moving else "beta, beta_cmd"
        raise InputError(f"{log.path}: line 1: expected at least one of the columns {missing}")
    if hint := slow_hint(log.period):
        raise InputError(f"{log.path}: column t: expected seconds{hint}")
    rows = usable_rows(log.t)
    rows &= np.any([np.isfinite(getattr(log, name)) for name in (*moving, *driven)], axis=0)
    if np.count_nonzero(rows) < MIN_ROWS_A_LOG:
        raise InputError(f"{log.path}: {np.count_nonzero(rows)} usable rows; a first nominal needs at least "
                         f"{MIN_ROWS_A_LOG}: log at a higher rate, or for longer")
    t = log.t[rows]
    notes: list[str] = []
    if np.count_nonzero(~rows):
        notes.append(f"{np.count_nonzero(~rows)} rows without a usable stamp or value were left out")
    x: dict[str, np.ndarray] = {}
    for name in ("theta", "theta_dot", "beta", "beta_cmd"):
        raw = np.where(np.isfinite(getattr(log, name)[rows]), getattr(log, name)[rows], math.nan)
        bad = spikes(raw) if name != "beta_cmd" else np.zeros(len(raw), bool)
        if bad.any():
            notes.append(f"{name}: {np.count_nonzero(bad)} single values that their neighbours contradict left out")
        x[name] = np.where(bad, math.nan, raw)
    period = round(float(np.median(np.diff(t))), CLOCK_DIGITS)
    cut = Channels(log.path, float(t[0]), period, t - t[0], x["theta"], x["theta_dot"], x["beta"], x["beta_cmd"],
                   filled(log.flight_path[rows], t), tuple(notes))
    for names in (moving, driven):
        if not any(cut.has(name) for name in names):
            raise InputError(f"{log.path}: {' and '.join(names)}: expected a value in most rows")
    return cut if not (cut.has("theta") and cut.has("theta_dot")) else without_foreign_rate(cut)


def spikes(x: np.ndarray) -> np.ndarray:
    """Return (n,) bool: single values far from the median of five rows and from every step near them."""
    if len(x) < 2 * ROWS_BESIDE_SPIKE or np.isnan(x).mean() > 0.5:
        return np.zeros(len(x), bool)
    whole = filled(x)
    around = np.lib.stride_tricks.sliding_window_view(np.pad(whole, 2, mode="edge"), 5)
    off = np.abs(whole - np.median(around, axis=1))
    usual = float(np.median(off[off > 0.0])) if np.any(off > 0.0) else 0.0
    bad = np.zeros(len(x), bool)
    for k in np.flatnonzero(off > SPIKE_OVER_MEDIAN * usual).tolist() if usual > 0.0 else ():
        beside = np.concatenate([whole[max(0, k - ROWS_BESIDE_SPIKE):k], whole[k + 1:k + ROWS_BESIDE_SPIKE + 1]])
        bad[k] = off[k] > SPIKE_OVER_LARGEST * np.max(np.abs(np.diff(beside)))
    return bad


def without_foreign_rate(c: Channels) -> Channels:
    """Return the channels without theta_dot if it is not theta's slope: filtered, delayed or scaled by the device.

    Increments of theta over eight rows against the integral of theta_dot, and that of its slope (a lag).  Where more of
    them than 1 - ONE_MOTION is noise nothing is removed: in a closed loop the noise of theta moves theta_dot, which
    looks like a lag.
    """
    good = np.isfinite(c.theta) & np.isfinite(c.theta_dot)
    t, theta, rate = c.t[good], c.theta[good], c.theta_dot[good]
    rows = 8
    area = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(t) * (rate[1:] + rate[:-1]))])
    phi = np.column_stack([area[rows:] - area[:-rows], rate[rows:] - rate[:-rows], t[rows:] - t[:-rows]])
    y = theta[rows:] - theta[:-rows]
    keep = phi[:, 2] < 2.0 * rows * c.period
    phi, y = phi[keep][::rows], y[keep][::rows]
    if len(y) < 20:
        return c
    scale = np.sqrt(np.mean(phi**2, axis=0)) + 1e-300
    phi = phi / scale
    xi = least_squares(phi, y)
    left = y - combined(phi, xi)
    if square(left) > (1.0 - ONE_MOTION) * square(y - y.mean()):
        return c
    try:
        covariance = np.linalg.inv(products(phi, phi)) * square(left) / (len(y) - 3)
    except np.linalg.LinAlgError:
        return c
    xi, std = xi / scale, np.sqrt(np.diag(covariance)) / scale
    off = [abs(xi[0] - 1.0) - OUTLIER_SIGMAS * std[0] > RATE_SCALE,
           abs(xi[1]) - OUTLIER_SIGMAS * std[1] > RATE_LAG * c.period]
    if not any(off):
        return c
    words = (f"theta_dot is not the slope of theta (scale {1.0 / xi[0]:.3f}, lag {1e3 * xi[1]:.1f} ms): "
             "a device's filter; theta alone was used")
    return replace(c, theta_dot=np.full(len(c.t), math.nan), notes=(*c.notes, words))
