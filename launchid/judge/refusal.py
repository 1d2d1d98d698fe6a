"""Refuse an estimate: without a number, and with a status that says why."""

import math
from dataclasses import replace

import numpy as np

from launchid_core import Estimate, EstimateStatus

from .table import TESTS

WITHDRAWN_BEFORE = TESTS["no contradiction after"].limit  # s


def active_terms(estimate: Estimate) -> tuple[str, ...]:
    """Return the terms that the estimate has in its equation for theta_ddot."""
    return tuple(term for term, on in zip(estimate.terms, estimate.support[:, 1].tolist(), strict=True) if on)


def refused(estimate: Estimate, status: EstimateStatus = EstimateStatus.MODEL) -> Estimate:
    """Return the estimate as not valid, with this status and NaN for its numbers."""
    nan = math.nan
    xi, support = np.full_like(estimate.xi, nan), np.zeros_like(estimate.support)
    xi.flags.writeable = support.flags.writeable = False
    return replace(estimate, valid=False, status=status, xi=xi, support=support, absent={}, terms_std={},
                   a6=nan, k1=nan, a6_std=nan, k1_std=nan, a6_k1_corr=nan, a6_dot=nan, k1_dot=nan,
                   a6_bound=nan, k1_bound=nan, condition=nan)


def withdrawn(estimates: list[Estimate]) -> list[Estimate]:
    """Return the filter's estimates, refused where a contradiction of the model follows within WITHDRAWN_BEFORE s: its
    cause was there before the filter could tell."""
    contradicted = [e.t_end for e in estimates if e.status == EstimateStatus.MODEL]
    followed = [any(0.0 < t - e.t_end <= WITHDRAWN_BEFORE for t in contradicted) for e in estimates]
    return [_without_air(refused(e) if e.valid else e) if no else e for e, no in zip(estimates, followed, strict=True)]


def _without_air(estimate: Estimate) -> Estimate:
    """Return the estimate without wind, offsets, servo and tracked estimate, as while the model is contradicted."""
    nan, tracked, servo = math.nan, estimate.tracked, estimate.actuator
    if tracked is not None:
        tracked = tracked._replace(valid=False, **dict.fromkeys(tracked._fields[1:], nan))
    if servo is not None:
        servo = {name: each._replace(value=nan, std=nan) for name, each in servo.items()}
    return replace(estimate, wind=nan, wind_std=nan, offsets={}, actuator=servo, tracked=tracked)


def disbelieved(estimate: Estimate) -> Estimate:
    """Return the estimate refused and without any number, for a log whose columns are not what their names say."""
    return replace(_without_air(refused(estimate)), uncertainty=None)
