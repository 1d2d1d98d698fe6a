"""The check whether the logged command is the nominal rate controller's.  It is kp e + ki integral(e), e = theta_dot -
rate_ref, both of which the log holds as the controller saw them; so any difference is one of gains or of computing
time.

What the integral was before the log began, and after the command met its limit (which holds it), is not known: every
stretch between two limits has a constant of its own.
"""

import math
from dataclasses import replace

import numpy as np

from sim.flight import excitation, packed

from ...controller_replay import NEAR_LIMIT, later
from ...sums import combined, least_squares, products
from ..data.record import THETA_DOT, Record
from .check import EXPLAINED, LAG_STEP, LONGEST_LAG, SAME_RECOMPUTED
from .kind import FEWEST, NONE, ROUNDING, UNKNOWN, ControllerCheck

FINE = 41            # computing times from a step before the best to one behind it


def check_rate(record: Record) -> ControllerCheck | None:
    """The check of a rate controller; None where it is not possible: no command, rate or its reference, another period,
    too few commands in a row, or filters beside the law."""
    own = record.law
    if own is None or own.filters or record.input != "beta_cmd" or record.every != record.tick or record.fine > 1 or \
            abs(record.period / own.period - 1.0) > SAME_RECOMPUTED:
        return None
    error = record.z[:, THETA_DOT] - record.rate_reference
    logged = record.commands if record.logged is None else np.where(record.logged, record.commands, math.nan)
    limit = record.nominal.actuator.deflection_limit if record.nominal.actuator is not None else math.inf
    stretch = _stretches(np.isfinite(error) & np.isfinite(logged) & ~(np.abs(logged) >= NEAR_LIMIT * limit))
    fair = stretch >= 0
    if fair.sum() < FEWEST:
        return None
    error = np.where(np.isfinite(error), error, 0.0)
    changes = packed(record.nominal)
    kp, ki = changes.kp_scale * own.kp * error, own.ki * own.period * np.cumsum(error)
    test = excitation(record.nominal, record.first_step // record.tick + len(error), own.period)[-len(error):]
    early = changes.computing_time / own.period

    def apart(x: np.ndarray) -> np.ndarray:
        """x (n, columns) in the fair rows, less each stretch's mean."""
        rows, x = stretch[fair], x[fair]
        return np.asarray(x - (np.apply_along_axis(lambda of: np.bincount(rows, of), 0, x)
                               / np.maximum(np.bincount(rows), 1)[:, None])[rows])

    def fitted(lag: float, is_ki_free: bool) -> tuple[float, np.ndarray, np.ndarray]:
        """(rms [rad], kp and ki over the nominal's, their std) of this computing time [periods]."""
        kp_part, ki_part, test_part = (later(each, early + lag) for each in (kp, ki, test))
        parts = apart(np.column_stack([kp_part, ki_part, logged - test_part]))
        design = parts[:, :2] if is_ki_free else parts[:, :1]
        wanted = parts[:, 2] if is_ki_free else parts[:, 2] - parts[:, 1]
        scale = least_squares(design, wanted)
        after = float(np.sqrt(np.mean((wanted - combined(design, scale))**2)))
        spread = max(after, ROUNDING) * np.sqrt(np.maximum(np.diag(np.linalg.pinv(products(design, design))), 0.0))
        return after, scale, spread

    made = apart((logged - later(kp + ki + test, early))[:, None])
    before = float(np.sqrt(np.mean(made**2)))
    if before < max(ROUNDING, record.nominal.diagnosis.command):
        return ControllerCheck(NONE, before, before)
    lag = 0.0
    for grid in (np.arange(0.0, LONGEST_LAG, LAG_STEP), np.linspace(-LAG_STEP, LAG_STEP, FINE)):
        lags = np.maximum(lag + grid, 0.0).tolist()
        lag = min(lags, key=lambda each: fitted(each, False)[0])
    after, scale, spread = fitted(lag, False)
    found = ControllerCheck("", before, after, float(scale[0]), delay=lag * own.period,
                            std=(float(spread[0]), 0.0, 2.0 * LAG_STEP / (FINE - 1) * own.period / math.sqrt(12.0)),
                            evidence=float(fair.sum() * math.log(before / max(after, ROUNDING))))
    found = found.of_kind(SAME_RECOMPUTED, own.period)
    if found.kind != NONE and after <= max(EXPLAINED * before, ROUNDING):
        return found
    with_ki, scales, _ = fitted(0.0, True)
    told = with_ki <= max(EXPLAINED * before, ROUNDING)
    return replace(found, kind=UNKNOWN, integral_scale=float(scales[1]) if told else None,
                   kp_scale=float(scales[0]) if told else found.kp_scale)


def _stretches(fair: np.ndarray) -> np.ndarray:
    """(n,) the number of the stretch that a row is of, -1: of none, being not fair (n,) bool, or so soon after what is
    not that its command may answer it, or in a stretch too short to tell more than its own constant."""
    lead = round(LONGEST_LAG) + 2
    stretch, number = np.full(len(fair), -1), 0
    ends = np.flatnonzero(np.diff(np.concatenate([[False], fair, [False]]).astype(np.int8)))
    for begin, end in ends.reshape(-1, 2):
        if end - begin > lead + FEWEST:
            stretch[begin + lead:end] = number
            number += 1
    return stretch
