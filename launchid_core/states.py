"""State of the innovations form: x, its covariance, sensitivities, and what runs beside them (`predictor`)."""

from typing import NamedTuple

import numpy as np

from .kernels import shared
from .library import MAX_POWER, N_VARIABLES
from .memory import take, take2, take3
from .records import store
from .servo import N_STEP

N_STATES = 4    # of the vehicle
N_CHANNELS = 3  # theta, theta_dot, beta
N_TESTS = 4     # slopes of a6 and k1; what no model has: an acceleration that stays, an offset of the gyro
SLOPE_A6, SLOPE_K1, MOMENT_TEST, GYRO_TEST = range(4)
N_SLOPES = 2
MAX_DELAY_SAMPLES = 64

# time (f8)
LAST, RUNNING, FIRST = range(3)  # stamp of the last sample [s]; 1 if there was one in this segment; the first of all
N_TIME = 3

# note (i8): what the filter did of its own accord since the start
OUTLIERS, RESTARTS, LEVEL_CLAMPS, SEGMENTS, WITHDRAWN_CHANGES = range(5)
N_NOTES = 5

# path (f8): flight-path angle at the last stamp [rad]
GAMMA_NOW = 0

# process noise (index of the command's and the acceleration's levels)
COMMAND_NOISE, ACCELERATION_NOISE = 3, 4


@store
class Filter(NamedTuple):
    """State of the predictor: n states, L noise levels."""

    x: np.ndarray          # (n,) predicted state
    p: np.ndarray          # (n, n) its covariance
    s: np.ndarray          # (n, n + q + N_TESTS) sensitivities: offset at the block's start, terms, tests
    p_bar: np.ndarray      # (2,) relative deviations of a6, k1 it is linearised about
    level: np.ndarray      # (L,) log of noise standard deviations over the declared ones
    sx: np.ndarray         # (n, L) derivative of x for the levels
    sp: np.ndarray         # (L, n, n) derivative of p for the levels
    command: np.ndarray    # (MAX_DELAY_SAMPLES,) past commands, newest first
    time: np.ndarray       # (N_TIME,) LAST, RUNNING, FIRST
    path: np.ndarray       # (1,) GAMMA_NOW
    step: np.ndarray       # (N_STEP,) constants of the last time step
    cell: np.ndarray       # (1,) int64 cell of the profile
    outliers: np.ndarray   # (3,) int64 measurements in a row that each channel's gate refused
    note: np.ndarray       # (N_NOTES,) int64 counters


@store
class FilterWork(NamedTuple):
    """Scratch of the predictor."""

    transition: np.ndarray  # (n, n) about the parameters believed
    steady: np.ndarray     # (n, n) about the nominal's, for the gains
    matrix: np.ndarray     # (n, n)
    push: np.ndarray       # (r,) acceleration that a unit of each nuisance is
    column: np.ndarray     # (n,)
    gain: np.ndarray       # (n,)
    shown: np.ndarray      # (n,)
    slope: np.ndarray      # (n,)
    taylor: np.ndarray     # (4, 5, 5)
    raw: np.ndarray        # (4,)
    powers: np.ndarray     # (4, MAX_POWER + 1)
    row: np.ndarray        # (q,)
    drive: np.ndarray      # (2, q) effect of each term on theta, theta_dot over a step
    out: np.ndarray        # (n + q + N_TESTS,) sensitivities of the last innovation
    de: np.ndarray         # (L,) its derivative for the noise levels
    dv: np.ndarray         # (L,) relative derivative of its variance for them


@shared
def view_filter(f, at, i, m, q, n, levels):
    """Cut it from floats f at `at` and integers i at `m`: q terms, n states; returns (it, next at, next m)."""
    x, at = take(f, at, n)
    p, at = take2(f, at, n, n)
    s, at = take2(f, at, n, n + q + N_TESTS)
    p_bar, at = take(f, at, 2)
    level, at = take(f, at, levels)
    sx, at = take2(f, at, n, levels)
    sp, at = take3(f, at, levels, n, n)
    command, at = take(f, at, MAX_DELAY_SAMPLES)
    time, at = take(f, at, N_TIME)
    path, at = take(f, at, 1)
    step, at = take(f, at, N_STEP)
    cell, m = take(i, m, 1)
    outliers, m = take(i, m, N_CHANNELS)
    note, m = take(i, m, N_NOTES)
    return Filter(x, p, s, p_bar, level, sx, sp, command, time, path, step, cell, outliers, note), at, m


@shared
def view_filter_work(f, at, i, m, q, n, levels):
    """Cut it from floats f at `at` and integers i at `m`: q terms, n states; returns (it, next at, next m)."""
    transition, at = take2(f, at, n, n)
    steady, at = take2(f, at, n, n)
    matrix, at = take2(f, at, n, n)
    push, at = take(f, at, n - N_STATES)
    column, at = take(f, at, n)
    gain, at = take(f, at, n)
    shown, at = take(f, at, n)
    slope, at = take(f, at, n)
    taylor, at = take3(f, at, 4, 5, 5)
    raw, at = take(f, at, N_VARIABLES)
    powers, at = take2(f, at, N_VARIABLES, MAX_POWER + 1)
    row, at = take(f, at, q)
    drive, at = take2(f, at, 2, q)
    out, at = take(f, at, n + q + N_TESTS)
    de, at = take(f, at, levels)
    dv, at = take(f, at, levels)
    return FilterWork(transition, steady, matrix, push, column, gain, shown, slope, taylor, raw, powers, row, drive,
                      out, de, dv), at, m
