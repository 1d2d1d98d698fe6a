"""The one class: samples in by `update`, estimates out by `estimate`."""

import math

import numpy as np

from . import regression as rg
from . import ring as rb
from .compress import first_state
from .config import Config
from .estimate import Estimate
from .library import MAX_POWER, centred_variables, term_codes
from .sample import NAN, Sample
from .sparse import SOLVERS
from .status import EstimateStatus, Status

_STATUSES = tuple(Status(code) for code in range(Status.BUSY, Status.CLOCK_RESET + 1))


def _limits(config: Config) -> np.ndarray:
    limits = np.zeros(rb.N_LIMITS)
    limits[rb.PERIOD], limits[rb.WINDOW], limits[rb.MAX_GAP] = config.sample_period, config.window, config.max_gap
    limits[rb.LIMIT_FIRST:] = (config.t_limit, config.theta_limit, config.theta_dot_limit, config.beta_limit,
                               config.theta_ddot_limit, config.beta_cmd_limit)
    return limits


def _plan(config: Config) -> rg.Plan:
    codes = term_codes(config.terms)

    def place(term: str) -> int:
        return config.terms.index(term) if term in config.terms else -1

    plan = np.zeros(rg.N_PLAN, np.int64)
    plan[rg.KEEP] = config.kept_rows
    plan[rg.SOLVER] = SOLVERS.index(config.solver)
    plan[rg.TERM_A6], plan[rg.TERM_K1] = place("theta"), place("beta")
    plan[rg.TERM_A6_DOT], plan[rg.TERM_K1_DOT] = place("tau*theta"), place("tau*beta")
    plan[rg.MEASURED] = int(config.formulation == "measured")
    saturation = np.full(rb.N_COLUMNS, math.inf)
    saturation[rb.THETA], saturation[rb.THETA_DOT] = config.theta_saturation, config.theta_dot_saturation
    saturation[rb.BETA] = config.beta_saturation
    return rg.Plan(codes, centred_variables(codes), plan, np.array([config.threshold]),
                   np.array([config.max_gap]), saturation)


class Estimator:
    """On-board identification of theta_ddot = a6 theta + k1 beta from samples, one at a time.

    Everything is validated, allocated and compiled in the constructor.  One
    estimator belongs to one thread; a second caller gets Status.BUSY.
    """

    def __init__(self, config: Config) -> None:
        self.config = config
        m, p, q = config.rows, config.kept_rows, len(config.terms)
        self._limits = _limits(config)
        self._clock = np.zeros(rb.N_CLOCK)
        self._count = np.zeros(rb.N_COUNT, np.int64)
        self._ring = np.zeros((m + 1, rb.N_COLUMNS))
        self._random = np.zeros(1, np.int64)
        self._plan = _plan(config)
        self._work = rg.regression_work(m, p, q, MAX_POWER + 1)
        self._outcome = rg.outcome(q)
        self._close = rg.close_integral if config.formulation == "integral" else rg.close_pointwise
        self._push = rb.push
        self._busy = False
        self._has_estimate = False
        self._compile()
        self.reset()

    def _compile(self) -> None:
        """Compile (or load from the cache) both kernels, then refuse to compile in flight: an int is cast."""
        self.update(Sample(NAN, NAN, NAN, NAN))
        self._close(self._plan, self._work, self._outcome, self._ring, self._count, self._random, 0.0)
        if hasattr(self._push, "disable_compile"):
            self._push.disable_compile()

    def reset(self) -> None:
        """Forget every sample and estimate and restart the row generator; configuration and memory stay."""
        self._clock[:] = 0.0
        self._count[:] = 0
        self._ring[:, :] = 0.0
        self._random[0] = first_state(self.config.seed)
        rg.clear_outcome(self._outcome, int(EstimateStatus.SHORT))
        self._has_estimate = False
        self._busy = False

    def update(self, sample: Sample) -> Status:
        """Take one sample (six floats in the order of `Sample`); never raises for any float."""
        if self._busy:
            self._count[rb.COUNT_FIRST] += 1  # Status.BUSY is the first counter
            return Status.BUSY
        self._busy = True
        try:
            code = self._push(self._limits, self._clock, self._count, self._ring, *sample)
            if code == rb.WINDOW_COMPLETE:
                t_centre = self._clock[rb.T_CLOSED] + 0.5 * self.config.window
                self._close(self._plan, self._work, self._outcome, self._ring, self._count, self._random, t_centre)
                self._has_estimate = True
        finally:
            self._busy = False
        return _STATUSES[code - rb.BUSY]

    def estimate(self) -> Estimate | None:
        """The estimate of the last window that closed; None before the first."""
        if not self._has_estimate:
            return None
        number = [float(x) for x in self._outcome.number]
        status = EstimateStatus(int(self._outcome.flag[rg.STATUS]))
        xi, support = self._outcome.xi.copy(), self._outcome.support.copy()
        xi.flags.writeable = support.flags.writeable = False
        t_start = float(self._clock[rb.T_CLOSED])
        return Estimate(
            t_start=t_start, t_end=t_start + self.config.window, valid=status == EstimateStatus.OK, status=status,
            a6=number[rg.A6], k1=number[rg.K1], a6_std=number[rg.A6_STD], k1_std=number[rg.K1_STD],
            a6_k1_corr=number[rg.CORRELATION], a6_dot=number[rg.A6_DOT], k1_dot=number[rg.K1_DOT],
            a6_bound=number[rg.A6_BOUND], k1_bound=number[rg.K1_BOUND], condition=number[rg.CONDITION],
            xi=xi, support=support, terms=self.config.terms,
            rows=int(self._outcome.flag[rg.USED]), gaps=int(self._outcome.flag[rg.GAPS]))

    @property
    def counts(self) -> dict[str, int]:
        """How often `update` gave each status, by name; their sum is the number of calls."""
        return {status.name: int(self._count[rb.COUNT_FIRST + status - Status.BUSY]) for status in Status}

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays this estimator owns; constant after construction."""
        sparse = self._work.sparse
        arrays = [self._limits, self._clock, self._count, self._ring, self._random, *self._plan, *self._outcome,
                  *sparse, *(array for array in self._work if array is not sparse)]
        return sum(array.nbytes for array in arrays)
