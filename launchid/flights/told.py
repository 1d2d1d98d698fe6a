"""What the windows of each flight tell of a6 and k1."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .pooled import Told

if TYPE_CHECKING:
    from launchid_core import Estimate
    from sim.nominal import Nominal


def told_by(log: str, estimates: Sequence[Estimate], nominal: Nominal | None, is_shared: bool) -> Told | None:
    """Return what the valid windows of a flight tell of a6 and k1, weighted by their information; None if no window
    tells both.  With a nominal they are factors of its own.

    is_shared  the windows share an error, that of a servo which no sensor shows: together they tell no more than one
    """
    information, sum_, count = np.zeros((2, 2)), np.zeros(2), 0
    for e in estimates:
        if not (e.valid and e.a6_std > 0.0 and e.k1_std > 0.0 and math.isfinite(e.a6 + e.k1 + e.a6_k1_corr)):
            continue
        scale = np.ones(2) if nominal is None else \
            np.ravel(nominal.vehicle.at(np.array([0.5 * (e.t_start + e.t_end)])))
        value, std = np.array([e.a6, e.k1]) / scale, np.array([e.a6_std, e.k1_std]) / scale
        weight = np.linalg.inv(np.outer(std, std) * np.array([[1.0, e.a6_k1_corr], [e.a6_k1_corr, 1.0]]))
        information, sum_, count = information + weight, sum_ + weight @ value, count + 1
    if not np.any(information):
        return None
    covariance = np.linalg.inv(information)
    return Told(log, covariance @ sum_, covariance * (count if is_shared else 1))


def is_relative(nominal: Nominal | None) -> bool:
    """Whether flights are compared as factors of the nominal: it has an a6 and a k1 that are 0 nowhere."""
    return nominal is not None and not nominal.terms and bool(
        np.all(nominal.vehicle.a6 != 0.0) and np.all(nominal.vehicle.k1 != 0.0))
