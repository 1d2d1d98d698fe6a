"""The results that leave the estimator."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from .status import EstimateStatus

EMPTY = np.zeros((0, 0))
EMPTY.setflags(write=False)


class Tracked(NamedTuple):
    """The tracked estimate at a window's end, or at the last sample where `estimate` is asked later: all data so far,
    the slow deviation from the nominal followed.

    valid        at least one parameter is known better than before the first sample
    a6, k1       [1/s^2] then: what is believed of their share times the nominal at that time, with standard deviations
                 and correlation; NaN if not valid
    """

    valid: bool
    a6: float
    k1: float
    a6_std: float
    k1_std: float
    a6_k1_corr: float


class Offset(NamedTuple):
    """A constant that nobody knew before the flight, as it is believed at t_end, with its standard deviation."""

    value: float
    std: float


class Mode(NamedTuple):
    """A mode of slosh or bending as it is believed at t_end, from all data so far; NaN while the model is contradicted.

    name                 `slosh1` .. or `bending1` ..
    frequency [rad/s], frequency_std
    size, size_std       coupling of slosh, gain of bending [rad/rad]; a number that is declared as known has 0
    """

    name: str
    frequency: float
    frequency_std: float
    size: float
    size_std: float


class Level(NamedTuple):
    """The place of one parameter in its range, a = a0 (1 + sigma delta).

    delta, delta_std   the tracked estimate at t_end; NaN if nothing is known yet
    band               one of `launchid_core.BANDS` if its probability is at least 0.95, else `undecided`
    probability        of each of BANDS, in that order
    in_range           False while the sequential alarm is raised: another factor is at play (fault, wind)
    out_since  [s]     when that began; NaN if in_range
    """

    delta: float
    delta_std: float
    band: str
    probability: tuple[float, ...]
    in_range: bool
    out_since: float


class Uncertainty(NamedTuple):
    """The uncertainty level at a window's end.  valid: the tracked estimate's."""

    valid: bool
    a6: Level
    k1: Level


class Change(NamedTuple):
    """A sudden change of a6 or k1.

    t, t_std [s]   when it began
    parameter      `a6` or `k1` (a change of both is two entries)
    before, after  [1/s^2] at t;  size = after - before, with its standard deviation
    alarm    [s]   when the alarm was raised
    final          the size is based on two seconds of data after the change
    """

    t: float
    t_std: float
    parameter: str
    before: float
    after: float
    size: float
    size_std: float
    alarm: float
    final: bool


@dataclass(frozen=True, eq=False)
class Estimate:
    """Result of one window.  Numbers are NaN when `valid` is False, never a guess.

    t_start, t_end [s]   the window; parameters hold at its centre
    valid                `status` is OK: the theta_ddot equation was identified
    status               why, or why not
    a6, k1       [1/s^2] coefficients of theta and beta in theta_ddot; 0 if thresholded away, NaN if not in the library
    a6_std, k1_std       their standard deviations (filtered: from the noise levels; others: from the residual and its
                         autocorrelation, widened by what a drift within the window changes); of a term that was
                         thresholded away what it would have
    a6_k1_corr           their correlation
    a6_dot, k1_dot [1/s^3]  coefficients of tau*theta, tau*beta
    a6_bound, k1_bound   Cramer-Rao bound of the window as standard deviations; NaN unless a noise model was given
    condition            first pivot over last of the standardised library
    xi           (q, 3)  Xi: rows the terms, columns the equations theta_dot, theta_ddot, beta_dot; read-only
    support      (q, 3)  bool: the active terms; read-only
    terms_std            standard deviation of each active term of theta_ddot, in its own unit; read-only
    terms                names of the rows
    rows                 rows used;  gaps: gaps inside the window
    tracked              the tracked estimate (formulation `filtered`), else None
    uncertainty          the uncertainty level (a model with sigma), else None
    wind, wind_std [rad] all of the wind angle at t_end (a model with wind), else NaN
    offsets              what the model does not know, by its name in `Model`, at t_end
    actuator             the servo's natural_frequency [rad/s], damping_ratio and delay [s], each with its standard
                         deviation, at t_end, from all data so far (a model with a sigma of it, else None)
    actuator_corr        correlations of natural_frequency with damping_ratio and with delay, of damping_ratio with
                         delay; empty where actuator is None
    modes                slosh and bending of the model at t_end, in its order
    modes_covariance     (2 + 2 m, 2 + 2 m) of a6, k1 and of frequency and size of each of m modes, as the modes' filter
                         has them at t_end; what is known has 0; empty without modes, NaN while the model is
                         contradicted; read-only
    whiteness            p-value of the innovations until t_end, were the model true (formulation `filtered`), else NaN
    absent               95 % limit of each term of theta_ddot that is not active, in its own unit; inf: not told
                         from the active ones; read-only
    """

    t_start: float
    t_end: float
    valid: bool
    status: EstimateStatus
    a6: float
    k1: float
    a6_std: float
    k1_std: float
    a6_k1_corr: float
    a6_dot: float
    k1_dot: float
    a6_bound: float
    k1_bound: float
    condition: float
    xi: np.ndarray
    support: np.ndarray
    terms: tuple[str, ...]
    rows: int
    gaps: int
    tracked: Tracked | None = None
    uncertainty: Uncertainty | None = None
    wind: float = math.nan
    wind_std: float = math.nan
    offsets: Mapping[str, Offset] = field(default_factory=dict)
    actuator: Mapping[str, Offset] | None = None
    actuator_corr: tuple[float, ...] = ()
    modes: tuple[Mode, ...] = ()
    modes_covariance: np.ndarray = field(default_factory=lambda: EMPTY)
    whiteness: float = math.nan
    absent: Mapping[str, float] = field(default_factory=dict)
    terms_std: Mapping[str, float] = field(default_factory=dict)
