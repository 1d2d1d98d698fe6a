"""What leaves the estimator."""

from dataclasses import dataclass

import numpy as np

from .status import EstimateStatus


@dataclass(frozen=True, eq=False)
class Estimate:
    """Result of one window.  Numbers are NaN when `valid` is False, never a guess.

    t_start, t_end [s]   the window; parameters hold at its centre
    valid                `status` is OK: the theta_ddot equation was identified
    status               why, or why not
    a6, k1       [1/s^2] coefficients of theta and beta in theta_ddot; 0 if thresholded away, NaN if not in the library
    a6_std, k1_std       their standard deviations from the window's own residual; NaN where the term is not active
    a6_k1_corr           their correlation
    a6_dot, k1_dot [1/s^3]  coefficients of tau*theta, tau*beta
    a6_bound, k1_bound   Cramer-Rao bound of the window as standard deviations; NaN unless a noise model was given
    condition            first pivot over last of the standardised library
    xi           (q, 3)  Xi: rows the terms, columns the equations theta_dot, theta_ddot, beta_dot; read-only
    support      (q, 3)  bool: the active terms; read-only
    terms                names of the rows
    rows                 rows used;  gaps: gaps inside the window
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
