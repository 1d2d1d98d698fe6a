"""Find units and signs that only the vehicle shows: beta and its command both reversed, or the whole log in degrees.

theta_dot between blocks changes by the integral of a6 alpha + k1 beta: a regression on both, with the nominal's a6 and
k1, gives k1 over the nominal's.  In a flight it is 0.8 to 1.3; a wind that nobody measured, which the loop answers,
draws it to 0 and leaves little explained; a bending mode that the loop excites has made it 22 at most.  A reversed sign
or degrees are beyond that.  A log all in degrees obeys the equation as before: its noise is 57 times the declared, and
theta 57 times what the guidance commands.

For an estimate such a fault is a warning; for a diagnosis it is a further doubt where no effect explains the log.
"""

import math

import numpy as np

from sim.nominal import Nominal

from ..series import white_variance
from ..sums import combined, inner, least_squares, square
from .fault import Fault
from .log import Log
from .slope import (
    DEGREES,
    ENOUGH_BLOCKS,
    RATE_BLOCK,
    SAME_UNIT,
    SHARED_RESIDUALS,
    SLOPE_SIGMAS,
    block_means,
    near,
    regress,
)

SIGN_LEAST = 0.4     # a ratio of -1 within this and its inverse
BETA_SHARE = 0.5     # share of the variance without it that beta must explain
GUIDANCE_SHARE = 0.8  # share of theta's variance that the guidance explains: in strong wind 0.93
NOISE_CHANNELS = (("theta", "theta_std", "theta_step"), ("theta_dot", "theta_dot_std", "theta_dot_step"),
                  ("beta", "beta_std", "beta_step"))
NOISE_SLACK = 2.2    # noise is declared less well than a parameter, and a loop follows its guidance as well


def plant_faults(log: Log, nominal: Nominal, masks: dict[str, np.ndarray]) -> list[Fault]:
    """Return [Fault] of beta, of theta or of all angles (unit or sign), by the nominal's k1 and noise, or [].

    masks  column -> (n,) bool: the values that may be used
    """
    rows = masks["theta"] & masks["beta"]
    if np.count_nonzero(rows) < ENOUGH_BLOCKS:
        return []
    t = log.t[rows]
    message = None if nominal.terms else of_ratio(*_ratio(log, nominal, masks, rows))
    if message is not None:
        return [Fault(message[0], message[1], float(t[0]), float(t[-1]), len(t), message[2])]
    return [_of_all(t, "their noise is about 57 times the nominal's")] if _all_noise_in_degrees(log, nominal, masks) \
        else []


def guided_faults(log: Log, nominal: Nominal, masks: dict[str, np.ndarray]) -> list[Fault]:
    """Return [Fault] of all angles in degrees, or []: theta is 57 times the guidance, and k1 does not contradict it.

    masks  column -> (n,) bool: the values that may be used
    """
    rows = masks["theta"] & masks["beta"]
    if nominal.guidance is None or np.count_nonzero(rows) < ENOUGH_BLOCKS:
        return []
    t = log.t[rows]
    fit = regress(log.theta[rows], [nominal.guidance.attitude_at(t)])
    if not (fit.explained > GUIDANCE_SHARE and near(fit.gain[0], DEGREES, NOISE_SLACK)):
        return []
    if not nominal.terms and of_ratio(*_ratio(log, nominal, masks, rows)) is not None:
        return []  # beta is not of the unit of theta, and `plant_faults` says of which of the two that is
    return [_of_all(t, f"theta is {fit.gain[0]:.1f} times what the guidance asks for")]


def _of_all(t: np.ndarray, why: str) -> Fault:
    return Fault("unit", None, float(t[0]), float(t[-1]), len(t),
                 f"all angles look like degrees over the whole log: {why}; multiply them by pi/180")


def of_ratio(ratio: float, std: float, explained: float) -> tuple[str, str, str] | None:
    """Return (kind, column, message) of a column's fault, by the ratio of k1 to the nominal's, its deviation and the
    share of the motion that beta explains; None if the ratio may be true."""
    if not (explained > BETA_SHARE and abs(ratio) > SLOPE_SIGMAS * std):
        return None
    said = f"k1 comes out {ratio:.2g} times the nominal's"
    for factor, column in ((DEGREES, "theta"), (1.0 / DEGREES, "beta")):
        if 1.0 / SAME_UNIT < abs(ratio) / factor < SAME_UNIT:
            sign = ", and of the opposite sign," if ratio < 0.0 else ""
            return "unit", column, (f"{column} looks like degrees{sign} over the whole log: {said}; "
                                    "multiply it by pi/180")
    if -1.0 / SIGN_LEAST < ratio < -SIGN_LEAST:
        return "sign", "beta", (f"beta, or theta and its rate, has the opposite sign over the whole log: {said}; "
                                "multiply it by -1")
    return None


def _ratio(log: Log, nominal: Nominal, masks: dict[str, np.ndarray], rows: np.ndarray) -> tuple[float, float, float]:
    """Return (k1 over the nominal's, its std, share that beta explains) in rows (n,) bool; (NaN, NaN, 0) of few."""
    with_rate = np.count_nonzero(masks["theta_dot"] & rows) > 0.5 * np.count_nonzero(rows)
    rows = rows & masks["theta_dot"] if with_rate else rows
    t, theta, size = log.t[rows], log.theta[rows], max(2, round(RATE_BLOCK / log.period))
    if len(t) // size < ENOUGH_BLOCKS:
        return math.nan, math.nan, 0.0
    gamma = log.flight_path[rows]
    alpha = theta - np.where(np.isfinite(gamma), gamma, 0.0)
    a6, k1 = nominal.vehicle.at(t)

    def integral(x: np.ndarray) -> np.ndarray:
        return np.concatenate(([0.0], np.cumsum(0.5 * (x[1:] + x[:-1]) * np.diff(t))))

    def change(x: np.ndarray) -> np.ndarray:
        once = integral(x)
        return np.diff(block_means(once, size)) if with_rate else np.diff(block_means(integral(once), size), n=2)

    y = np.diff(block_means(log.theta_dot[rows], size)) if with_rate else np.diff(block_means(theta, size), n=2)
    beta, others = change(k1 * log.beta[rows]), np.stack([change(a6 * alpha), np.ones(len(y))], axis=1)
    beta, y = (x - combined(others, least_squares(others, x, 1e-10)) for x in (beta, y))
    power, total = square(beta), square(y)
    if not (power > 0.0 and total > 0.0 and math.isfinite(power + total)):
        return math.nan, math.nan, 0.0
    ratio = inner(beta, y) / power
    left = float(np.sum((y - ratio * beta) ** 2))
    return ratio, math.sqrt(SHARED_RESIDUALS * left / (len(y) - 3) / power), 1.0 - left / total


def _all_noise_in_degrees(log: Log, nominal: Nominal, masks: dict[str, np.ndarray]) -> bool:
    """Whether every column with declared noise, at least two, has about 57 times that noise."""
    ratios = []
    for name, std, step in NOISE_CHANNELS:
        declared = math.hypot(getattr(nominal.sensors, std), getattr(nominal.sensors, step) / math.sqrt(12.0))
        x = getattr(log, name)[masks[name]]
        if declared > 0.0 and len(x) >= ENOUGH_BLOCKS:
            ratios.append(math.sqrt(white_variance(x, typical=True)) / declared)
    return len(ratios) > 1 and all(1.0 / NOISE_SLACK < ratio / DEGREES < NOISE_SLACK for ratio in ratios)
