"""The two calls that make an estimator, `step` and `report`, for each family of formulations.

Python calls the entries below: one block of memory (`memory.Block`), cut into the named parts that the kernels work
on.  A C port has those parts as structs and calls what the entries call: `update_*` and `report_now`.

A regression's entries are `update_*` in two, so that a sample that closes no window pays for none of its memory: the
close is a function of its own, which cuts what it needs.
"""

from .batch import view_fixed as view_regression
from .batch import view_state as view_regression_state
from .batch import view_work as view_regression_work
from .kernels import inner, kernel, once, shared
from .onboard import report_now, update_filtered
from .regression import complete_integral, complete_pointwise, take_sample
from .report import view_report
from .ring import WINDOW_COMPLETE
from .states import N_STATES
from .stores import view_fixed, view_state, view_work
from .structure import view_learner, view_learning
from .uncertainty import view_gauge, view_sigma

# sizes (i8): the first integers of a block
TERMS, WINDOW_ROWS, KEPT_ROWS, NODES, RANGE_NODES, STATES, LEVELS, AIR_NODES, BLOCK_SAMPLES = range(9)
N_SIZES = 9


@shared
def cut_sample(f, i):
    """Parts of the formulations that regress on a window that every sample needs: (Fixed, State, floats, integers)."""
    q = i[TERMS]
    fixed, at, m = view_regression(f, 0, i, N_SIZES, q)
    state, at, m = view_regression_state(f, at, i, m, q, i[WINDOW_ROWS])
    return fixed, state, at, m


@shared
def cut_regression(f, i):
    """All their parts: (Fixed, State, Work, floats, integers)."""
    q, rows = i[TERMS], i[WINDOW_ROWS]
    fixed, state, at, m = cut_sample(f, i)
    work, at, m = view_regression_work(f, at, i, m, q, rows, i[KEPT_ROWS])
    return fixed, state, work, at, m


@shared
def cut_filtered(f, i):
    """Parts of the filtered formulation that it always has: (Fixed, State, Work, Report, floats, integers)."""
    q, n, levels = i[TERMS], i[STATES], i[LEVELS]
    fixed, at, m = view_fixed(f, 0, i, N_SIZES, q, i[NODES], n - N_STATES, levels, i[AIR_NODES])
    state, at, m = view_state(f, at, i, m, q, i[WINDOW_ROWS], n, levels, i[BLOCK_SAMPLES])
    work, at, m = view_work(f, at, i, m, q, n, levels)
    rep, at, m = view_report(f, at, i, m)
    return fixed, state, work, rep, at, m


@shared
def cut_structure(f, at, i, m):
    """Parts that learn which of many terms there are: (Learner, Learning, next at, next m)."""
    learner, at, m = view_learner(f, at, i, m, i[TERMS])
    learning, at, m = view_learning(f, at, i, m, i[TERMS])
    return learner, learning, at, m


@shared
def cut_range(f, at, i, m):
    """Parts of the uncertainty level: (Sigma, Gauge, next at, next m)."""
    sigma, at, m = view_sigma(f, at, i, m, i[RANGE_NODES])
    gauge, at, m = view_gauge(f, at, i, m)
    return sigma, gauge, at, m


@once
def cut_whole(f, i, structured, ranged):
    """Parts of the filtered formulation: (Fixed, State, Work, Learner, Learning, Sigma, Gauge), None where there are
    none; structured, ranged as of `step_filtered`."""
    fixed, state, work, _, at, m = cut_filtered(f, i)
    if structured is None:
        learner, learning = None, None
    else:
        learner, learning, at, m = cut_structure(f, at, i, m)
    if ranged is None:
        sigma, gauge = None, None
    else:
        sigma, gauge, at, m = cut_range(f, at, i, m)
    return fixed, state, work, learner, learning, sigma, gauge


@inner
def finish_pointwise(f, i):
    """The close of a window that a sample completed, formulations `measured` and `difference`; returns its Status."""
    fixed, state, work, _, _ = cut_regression(f, i)
    return complete_pointwise(fixed, state, work)


@inner
def finish_integral(f, i):
    """As `finish_pointwise`, formulation `integral`."""
    fixed, state, work, _, _ = cut_regression(f, i)
    return complete_integral(fixed, state, work)


@kernel
def step_pointwise(f, i, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Take one sample, formulations `measured` and `difference`; returns its Status.

    f, i  inout  of a `memory.Block`;  the rest: a Sample
    """
    fixed, state, _, _ = cut_sample(f, i)
    code = take_sample(fixed, state, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    return finish_pointwise(f, i) if code == WINDOW_COMPLETE else code


@kernel
def step_integral(f, i, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Take one sample, formulation `integral`; as `step_pointwise`."""
    fixed, state, _, _ = cut_sample(f, i)
    code = take_sample(fixed, state, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    return finish_integral(f, i) if code == WINDOW_COMPLETE else code


@kernel
def step_filtered(f, i, structured, ranged, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Take one sample, formulation `filtered`; returns its Status.

    f, i        inout  of a `memory.Block`
    structured, ranged  in  None: without the structure of many terms, without the uncertainty level; else 1
    """
    fixed, state, work, learner, learning, sigma, gauge = cut_whole(f, i, structured, ranged)
    return update_filtered(fixed, state, work, learner, learning, sigma, gauge, t, theta, theta_dot, beta, theta_ddot,
                           beta_cmd, gamma)


@kernel
def report_filtered(f, i, structured, ranged):
    """Fill the `Report`; arguments as of `step_filtered`."""
    fixed, state, _, rep, at, m = cut_filtered(f, i)
    if structured is not None:
        _, _, at, m = cut_structure(f, at, i, m)
    if ranged is None:
        gauge = None
    else:
        _, gauge, at, m = cut_range(f, at, i, m)
    report_now(fixed, state, gauge, rep)
