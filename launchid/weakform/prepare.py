"""Prepare the rows of a checked log for the weak form: which, with which noise, thinned."""

import itertools
import math
from dataclasses import replace

import numpy as np

from ..log.check import BRIDGED, CheckedLog
from ..log.rate_alone import has_attitude
from ..log.rates import HELD_WORD
from ..series import filled
from .noise import noise_variance, nozzle_noise, with_noise_levels
from .rows import MIN_ROWS_A_STRETCH, Rows, before, rate_of

FINE = 0.005         # s from row to row: nothing that a vehicle does is faster
JUDGED_ROWS = 50_000  # that are judged: of a long log means of more of them
LEAST_STEP = 1.0e-6  # of the median step: nothing is known of a rate between stamps that are nearer
FARTHEST_STAMP = 1000.0  # times the log's length: a stamp further from its middle is no time of this log
LONGEST_ROW_STEP = 1.5  # median steps: no row reaches over a longer one
STEADY_TIME = 0.25   # s to either side at most, over which theta_dot's integral tells what theta does


def usable(seen: CheckedLog, *, is_steadied: bool = True) -> Rows | None:
    """Return the rows of a log that the weak form can use, means over FINE [s] if they are closer; None of too few.

    is_steadied   take fast motion of theta from theta_dot, with less noise than its sensor's; else theta as measured
    One or two missing cells in a row are bridged by lines; a rate that is not measured is the slope of theta.
    """
    log = seen.estimated
    times = log.in_range("t")
    if np.count_nonzero(times) < MIN_ROWS_A_STRETCH:
        return None
    times[times] = near_all(log.t[times], log.period)
    times[times] = forward(log.t[times], LEAST_STEP * log.period)
    t, has_rate = log.t[times], bool(np.mean(log.in_range("theta_dot")) > 0.5)
    names = ("theta", "beta", "theta_dot") if has_rate else ("theta", "beta")
    columns, there = dict[str, np.ndarray](), np.ones(len(t), bool)
    for name in names:
        columns[name], known = bridged(t, np.where(log.in_range(name), getattr(log, name), math.nan)[times])
        there &= known
    if np.count_nonzero(there) < MIN_ROWS_A_STRETCH:
        return None
    t, row = t[there], np.flatnonzero(there)
    theta, beta = columns["theta"][there], columns["beta"][there]
    path = log.flight_path[times][there]
    rate, reach, is_fine = (columns["theta_dot"][there], 0.0, False) if has_rate else rate_of(t, theta, log.period)
    step = np.diff(t)
    cuts = np.flatnonzero((step > LONGEST_ROW_STEP * np.median(step)) | (np.diff(row) > 1)) + 1
    rows = Rows(t, theta, filled(path, t), rate, beta, has_rate, bool(np.isfinite(path).any()),
                np.concatenate([[0], cuts, [len(t)]]), is_held=seen.rates["beta"].kind == HELD_WORD,
                has_theta=has_attitude(seen.raw), reach=reach, is_fine=is_fine)
    command = log.beta_cmd[times][there]
    if np.array_equal(command, beta):   # a command holds until the next
        rows = replace(rows, is_held=True, is_command=True)
    noise, doubt = nozzle_noise(rows, [theta, *([rate] if has_rate else []), *([command] if np.isfinite(command).all()
                                                                             else [])])
    means = thinned(replace(rows, theta=steadied(rows)) if has_rate and is_steadied else rows)
    return with_noise_levels(replace(means, beta_noise=noise * rows.period / means.period,
                                     beta_doubt=doubt * rows.period / means.period))


def steadied(rows: Rows) -> np.ndarray:
    """Return theta (n,) [rad] with less noise: the integral of a measured theta_dot, about a running mean of theta over
    as many rows as make the noise of both least.

    What the controller answers to theta's own noise is correlated with it: to a regression on theta it is a motion.
    """
    least_noise = math.sqrt(3.0 * noise_variance(rows.theta) / noise_variance(rows.theta_dot)) / rows.period
    most = int(min(least_noise, STEADY_TIME / rows.period))
    parts = []
    for a, b in itertools.pairwise(rows.bounds.tolist()):
        t, rate, at = rows.t[a:b], rows.theta_dot[a:b], np.arange(b - a)
        turned = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(t) * (rate[1:] + rate[:-1]))])
        whole = np.concatenate([[0.0], np.cumsum(rows.theta[a:b] - turned)])
        reach = np.minimum(np.minimum(at, at[::-1]), most)
        parts.append(turned + (whole[at + reach + 1] - whole[at - reach]) / (2 * reach + 1))
    return np.concatenate(parts)


def bridged(t: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return (x (n,) interpolated over all gaps, (n,) bool: measured, or in a gap of at most BRIDGED cells)."""
    good = np.isfinite(x)
    if good.all() or not good.any():
        return x, good
    at = np.arange(len(x))
    before = np.maximum.accumulate(np.where(good, at, -len(x)))
    after = np.minimum.accumulate(np.where(good, at, 2 * len(x))[::-1])[::-1]
    known = good | (after - before <= BRIDGED + 1)
    return filled(x, t), known


def thinned(rows: Rows) -> Rows:
    """Return means over as many rows as make FINE [s], or leave JUDGED_ROWS in all; the rows as they are if one.

    All that is linear between the columns holds of their means too.
    """
    many = max(int(FINE / rows.period * (1.0 + 1e-9)), math.ceil(len(rows.t) / JUDGED_ROWS))
    if many < 2:
        return rows
    if rows.is_held:   # by lines between the rows it has the integral of its steps where it is the mean of both
        rows = replace(rows, beta=0.5 * (rows.beta + before(rows.beta)), is_held=False)
    whole = [(a, b - (b - a) % many) for a, b in zip(rows.bounds[:-1].tolist(), rows.bounds[1:].tolist(), strict=True)]
    whole = [(a, b) for a, b in whole if b - a >= MIN_ROWS_A_STRETCH * many]
    if not whole:
        return rows
    at = np.concatenate([np.arange(a, b) for a, b in whole])
    means = {name: getattr(rows, name)[at].reshape(-1, many).mean(axis=1)
             for name in ("t", "theta", "gamma", "theta_dot", "beta")}
    return replace(rows, **means, bounds=np.cumsum([0, *((b - a) // many for a, b in whole)]))


def near_all(t: np.ndarray, period: float) -> np.ndarray:
    """Return (n,) bool: stamps t (n,) [s] that are within FARTHEST_STAMP lengths of the log from their median."""
    return np.abs(t - np.median(t)) <= FARTHEST_STAMP * len(t) * period if len(t) else np.zeros(0, bool)


def forward(t: np.ndarray, least: float) -> np.ndarray:
    """Return (n,) bool: stamps t (n,) [s] that go forward by more than `least` [s]: later than all before, or earlier
    than all after, whichever leaves more (one stamp too late spoils the first, one too early the second)."""
    if len(t) == 0:
        return np.zeros(0, bool)
    later = np.concatenate([[True], t[1:] - np.maximum.accumulate(t)[:-1] > least])
    earlier = np.concatenate([np.minimum.accumulate(t[::-1])[::-1][1:] - t[:-1] > least, [True]])
    return later if np.count_nonzero(later) >= np.count_nonzero(earlier) else earlier
