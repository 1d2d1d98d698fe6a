"""Bounds out of information matrices."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Bound:
    """The bound in each window of one flight.  Arrays (windows,); standard deviations are relative to the true
    value."""

    t_start: np.ndarray      # s
    a6: np.ndarray           # relative standard deviation
    k1: np.ndarray
    correlation: np.ndarray
    servo: np.ndarray        # (windows, unknown ones): relative frequency, relative damping ratio, delay [s]


def without_offset(information: np.ndarray) -> np.ndarray:
    """The information (w, n - 4, n - 4) from (w, n, n), with the unknown initial state removed by a Schur complement.

    A state of which no measurement says anything (the nozzle's rate behind a first-order servo) drops out.
    """
    nuisance = information[:, :4, :4]
    cross = information[:, :4, 4:]
    scale = np.sqrt(np.einsum("wii->wi", nuisance))
    silent = scale == 0.0
    scale = np.where(silent, 1.0, scale)
    scaled = nuisance / scale[:, :, None] / scale[:, None, :] + silent[:, :, None] * np.eye(4)
    explained = np.einsum("wki,wkj->wij", cross / scale[:, :, None],
                          np.linalg.solve(scaled, cross / scale[:, :, None]))
    return information[:, 4:, 4:] - explained


def with_prior(information: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """The information (w, 2 + u, 2 + u) from (w, 5, 5) about a6, k1 and servo: what is known of it before the flight,
    one sigma (3,), added; the u numbers of which all is known, 0, left out."""
    unknown = np.flatnonzero(sigma > 0.0)
    kept = np.concatenate([[0, 1], 2 + unknown])
    prior = np.diag(np.concatenate([np.zeros(2), sigma[unknown] ** -2.0]))
    return information[:, kept][:, :, kept] + prior


def bounds_of(information: np.ndarray, window: float) -> Bound:
    """Bounds from information matrices (w, n, n), of a6, k1 and what is unknown of the servo, of windows end to end."""
    covariance = np.linalg.inv(information)
    std = np.sqrt(np.einsum("wii->wi", covariance))
    return Bound(np.arange(len(std)) * window, std[:, 0], std[:, 1], covariance[:, 0, 1] / (std[:, 0] * std[:, 1]),
                 std[:, 2:])
