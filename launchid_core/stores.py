"""The memory of the filtered formulation: what never changes, what persists between samples, scratch."""

from typing import NamedTuple

import numpy as np

from . import ring as rb
from .belief import Belief, view_belief
from .changes import Watch, view_watch
from .filtered import Accumulator, AccumulatorWork, start_window, view_accumulator, view_accumulator_work
from .gusts import Gust, gust_size, view_gust
from .kernels import shared
from .memory import take, take2
from .records import store
from .states import Filter, FilterWork, view_filter, view_filter_work
from .structure import PRIOR, Learner
from .stuck import N_LEARNED, N_WATCHED
from .tracker import FIRST_STD, Bank, BankWork, restart_bank, view_bank, view_bank_work
from .undeclared import Undeclared, UndeclaredWork, restart_undeclared, view_undeclared, view_undeclared_work
from .whiteness import Check, view_check
from .window import Outcome, view_outcome

# option (i8)
ESTIMATE_LEVELS, ENOUGH = range(2)  # follow the noise levels; samples below which a window is SHORT
N_OPTIONS = 2


@store
class Fixed(NamedTuple):
    """Never changes in flight."""

    limits: np.ndarray  # (N_LIMITS,) of the gate and the windows
    belief: Belief
    option: np.ndarray  # (N_OPTIONS,) int64


@store
class State(NamedTuple):
    """What persists between samples."""

    clock: np.ndarray   # (N_CLOCK,)
    counts: np.ndarray  # (N_COUNT,) int64
    ring: np.ndarray    # (m + 1, 7)
    seals: np.ndarray   # (m + 1,) int64 of the ring's rows
    guard: np.ndarray   # (2,) int64 seals of clock and counts, of what is carried on
    outcome: Outcome
    filter: Filter
    acc: Accumulator
    bank: Bank
    watch: Watch
    gust: Gust
    check: Check
    undeclared: Undeclared
    active: np.ndarray  # (q,) int64, 1 for the terms believed to be there
    repeats: np.ndarray  # (3, 2) learned of theta, theta_dot and beta: share of repeats, smallest step


@store
class Work(NamedTuple):
    """Meaningless between samples."""

    filter: FilterWork
    acc: AccumulatorWork
    bank: BankWork
    gust: np.ndarray    # (g,)
    undeclared: UndeclaredWork


@shared
def view_fixed(f, at, i, m, q, nodes, r, levels, air_nodes):
    """Cut it from floats f at `at` and integers i at `m` for q terms, r nuisances; returns (it, next at, next m)."""
    limits, at = take(f, at, rb.N_LIMITS)
    belief, at, m = view_belief(f, at, i, m, q, nodes, r, levels, air_nodes)
    option, m = take(i, m, N_OPTIONS)
    return Fixed(limits, belief, option), at, m


@shared
def view_state(f, at, i, m, q, rows, n, levels, samples):
    """Cut it from floats f at `at`, integers i at `m`: q terms, n states, `samples` a block; returns (it, next at,
    next m)."""
    clock, counts, ring, seals, guard, at, m = rb.view_ring(f, at, i, m, rows)
    outcome, at, m = view_outcome(f, at, i, m, q)
    fil, at, m = view_filter(f, at, i, m, q, n, levels)
    acc, at, m = view_accumulator(f, at, i, m, q, n, levels, samples)
    bank, at, m = view_bank(f, at, i, m)
    watch, at, m = view_watch(f, at, i, m, n)
    gust, at = view_gust(f, at, n)
    check, at, m = view_check(f, at, i, m)
    undeclared, at, m = view_undeclared(f, at, i, m, n)
    active, m = take(i, m, q)
    repeats, at = take2(f, at, N_WATCHED, N_LEARNED)
    return State(clock, counts, ring, seals, guard, outcome, fil, acc, bank, watch, gust, check, undeclared, active,
                 repeats), at, m


@shared
def view_work(f, at, i, m, q, n, levels):
    """Cut it from floats f at `at` and integers i at `m`: q terms, n states; returns (it, next at, next m)."""
    fil, at, m = view_filter_work(f, at, i, m, q, n, levels)
    acc, at, m = view_accumulator_work(f, at, i, m, q, n, levels)
    bank, at, m = view_bank_work(f, at, i, m)
    gust, at = take(f, at, gust_size(n))
    undeclared, at = view_undeclared_work(f, at, q, n)
    return Work(fil, acc, bank, gust, undeclared), at, m


def restart(fixed: Fixed, state: State, learner: Learner | None) -> None:
    """What is not zero before the first sample."""
    acc, bank = state.acc, state.bank
    np.fill_diagonal(acc.level_information, fixed.belief.prior)
    start_window(acc)
    bank.weight[...] = 1.0 / len(bank.weight)
    restart_bank(bank, 0.0, 0.0, FIRST_STD * FIRST_STD, 0.0, FIRST_STD * FIRST_STD)
    restart_undeclared(state.undeclared)
    state.active[...] = 1
    if learner is not None:
        np.fill_diagonal(learner.r[:-1, :-1], PRIOR)
