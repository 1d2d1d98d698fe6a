"""Memory of the formulations that regress on the rows of a window: `Fixed`, `State`, `Work`."""

from typing import NamedTuple

import numpy as np

from . import ring as rb
from .kernels import shared
from .library import CODE_LENGTH, N_VARIABLES
from .memory import at_quad, take, take2
from .records import store
from .sparse import SparseWork, Whole, view_sparse, view_whole
from .stuck import N_LEARNED, N_WATCHED
from .window import EQUATIONS, Outcome, view_outcome

# plan (i8): what is fixed at construction
KEEP, SOLVER, TERM_A6, TERM_K1, TERM_A6_DOT, TERM_K1_DOT, MEASURED, INTEGRAL, HELD, ENOUGH = range(10)
N_PLAN = 10

# threshold (f8): what a term must exceed to stay
RAW, OWN_SHARE = range(2)
N_THRESHOLDS = 2

PAIR = 2  # a6 and k1, and their drifts tau*theta and tau*beta: neighbours in `plan` and in an outcome's numbers


@store
class Fixed(NamedTuple):
    """Never changes in flight."""

    limits: np.ndarray      # (N_LIMITS,) of the gate and the windows
    codes: np.ndarray       # (q, 6) int64 terms
    centred: np.ndarray     # (4,) int64 variables that may be centred
    plan: np.ndarray        # (N_PLAN,) int64
    threshold: np.ndarray   # (2,) RAW: in units of each coefficient; OWN_SHARE: of the squares
    saturation: np.ndarray  # (7,) end stops by ring column


@store
class State(NamedTuple):
    """What persists between samples."""

    clock: np.ndarray       # (N_CLOCK,)
    counts: np.ndarray      # (N_COUNT,) int64
    ring: np.ndarray        # (m + 1, 7)
    seals: np.ndarray       # (m + 1,) int64 of the ring's rows
    guard: np.ndarray       # (2,) int64 seals of clock and counts, of `random`
    outcome: Outcome
    random: np.ndarray      # (1,) int64 generator of the row choice
    repeats: np.ndarray     # (3, 2) learned of theta, theta_dot and beta: share of repeats, smallest step


@store
class Work(NamedTuple):
    """Scratch of a window's close."""

    signal: np.ndarray      # (7, m) samples by column
    slope: np.ndarray       # (3, m) derivatives of theta, theta_dot, beta
    segment: np.ndarray     # (m,) int64
    usable: np.ndarray      # (m,) int64
    kept: np.ndarray        # (m,) int64
    phi: np.ndarray         # (q*p,) library columns one after the other
    target: np.ndarray      # (3*p,)
    centre: np.ndarray      # (4,)
    scale: np.ndarray       # (4,)
    raw: np.ndarray         # (4, m) theta, theta_dot, beta, tau by row
    z: np.ndarray           # (4, m) the same, standardised
    half: np.ndarray        # (m,) scratch of the integrals; later products of residuals by lag
    weight: np.ndarray      # (4, m) of the rows around a step in the integral over it
    error: np.ndarray       # (m,) by how much the numerical derivative or integral of a row may be off
    value: np.ndarray       # (m,) a library column at every row; later as `half`
    order: np.ndarray       # (q,) int64
    tau: np.ndarray         # (q,)
    norms: np.ndarray       # (q,)
    tt: np.ndarray          # (q, q)
    mt: np.ndarray          # (q, q)
    xi: np.ndarray          # (q,)
    active: np.ndarray      # (q,) int64
    whole: Whole
    sparse: SparseWork
    drift: np.ndarray       # (2*p,) drift columns, later in the coordinates of the factor
    extended: np.ndarray    # ((q + 2)*p,) active and drift columns, and their factor
    extended_order: np.ndarray     # (q + 2,) int64
    extended_tau: np.ndarray       # (q + 2,)
    extended_norms: np.ndarray     # (q + 2,)
    extended_solution: np.ndarray  # (q + 2,)
    extended_inverse: np.ndarray   # (q + 2, q + 2)
    series: np.ndarray      # (4*p,) residual, influences of a6 and k1, later times it; residual of the active terms
    change: np.ndarray      # (2,) of a6 and k1 where they may drift
    numeric: np.ndarray     # (2,) of a6 and k1, squared: what quadrature, differencing and rounding may be off
    covariance: np.ndarray  # (2, 2)
    trial: np.ndarray       # (q,)
    direction: np.ndarray   # (1, q)
    length: np.ndarray      # (1,)


@shared
def view_fixed(f, at, i, m, q):
    """Cut it from floats f at `at` and integers i at `m` for q terms; returns (it, next at, next m)."""
    limits, at = take(f, at, rb.N_LIMITS)
    codes, m = take2(i, m, q, CODE_LENGTH)
    centred, m = take(i, m, N_VARIABLES)
    plan, m = take(i, m, N_PLAN)
    threshold, at = take(f, at, N_THRESHOLDS)
    saturation, at = take(f, at, rb.N_COLUMNS)
    return Fixed(limits, codes, centred, plan, threshold, saturation), at, m


@shared
def view_state(f, at, i, m, q, rows):
    """Cut it from floats f at `at`, integers i at `m`: q terms, `rows` a window; returns (it, next at, next m)."""
    clock, counts, ring, seals, guard, at, m = rb.view_ring(f, at, i, m, rows)
    outcome, at, m = view_outcome(f, at, i, m, q)
    random, m = take(i, m, 1)
    repeats, at = take2(f, at, N_WATCHED, N_LEARNED)
    return State(clock, counts, ring, seals, guard, outcome, random, repeats), at, m


@shared
def view_work(f, at, i, m, q, rows, p):
    """Cut it from floats f at `at` and integers i at `m`: q terms, p of `rows` kept; returns (it, next at, next m)."""
    signal, at = take2(f, at, rb.N_COLUMNS, rows)
    slope, at = take2(f, at, EQUATIONS, rows)
    segment, m = take(i, m, rows)
    usable, m = take(i, m, rows)
    kept, m = take(i, m, rows)
    phi, at = take(f, at_quad(at), q * p)
    target, at = take(f, at_quad(at), EQUATIONS * p)
    centre, at = take(f, at, N_VARIABLES)
    scale, at = take(f, at, N_VARIABLES)
    raw, at = take2(f, at, N_VARIABLES, rows)
    z, at = take2(f, at, N_VARIABLES, rows)
    half, at = take(f, at, rows)
    weight, at = take2(f, at, 4, rows)
    error, at = take(f, at, rows)
    value, at = take(f, at, rows)
    order, m = take(i, m, q)
    tau, at = take(f, at, q)
    norms, at = take(f, at, q)
    tt, at = take2(f, at, q, q)
    mt, at = take2(f, at, q, q)
    xi, at = take(f, at, q)
    active, m = take(i, m, q)
    whole, at, m = view_whole(f, at, i, m, q)
    sparse, at, m = view_sparse(f, at, i, m, q)
    width = q + PAIR
    drift, at = take(f, at_quad(at), PAIR * p)
    extended, at = take(f, at_quad(at), width * p)
    extended_order, m = take(i, m, width)
    extended_tau, at = take(f, at, width)
    extended_norms, at = take(f, at, width)
    extended_solution, at = take(f, at, width)
    extended_inverse, at = take2(f, at, width, width)
    series, at = take(f, at_quad(at), (2 + PAIR) * p)
    change, at = take(f, at, PAIR)
    numeric, at = take(f, at, PAIR)
    covariance, at = take2(f, at, PAIR, PAIR)
    trial, at = take(f, at, q)
    direction, at = take2(f, at, 1, q)
    length, at = take(f, at, 1)
    return Work(signal, slope, segment, usable, kept, phi, target, centre, scale, raw, z, half, weight, error, value,
                order, tau, norms, tt, mt, xi, active, whole, sparse, drift, extended, extended_order, extended_tau,
                extended_norms, extended_solution, extended_inverse, series, change, numeric, covariance, trial,
                direction, length), at, m
