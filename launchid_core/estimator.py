"""The one class: samples in by `update`, estimates out by `estimate`."""

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from . import changes as ch
from . import onboard as ob
from . import regression as rg
from . import ring as rb
from . import uncertainty as un
from . import window as wn
from .belief import Belief
from .choices import SOLVERS
from .compress import first_state
from .config import Config
from .estimate import Change, Estimate, Level, Tracked, Uncertainty
from .filtered import BLOCK
from .library import MAX_POWER, centred_variables, term_codes
from .model import NOISES
from .sample import NAN, Sample
from .status import EstimateStatus, Status
from .tracker import FIRST_STD

KNOWN = 0.9  # of FIRST_STD: the data have said something of a parameter

_STATUSES = tuple(Status(code) for code in range(Status.BUSY, Status.CLOCK_RESET + 1))


def _limits(config: Config) -> np.ndarray:
    limits = np.zeros(rb.N_LIMITS)
    limits[rb.PERIOD], limits[rb.WINDOW], limits[rb.MAX_GAP] = config.sample_period, config.window, config.max_gap
    limits[rb.LIMIT_FIRST:] = (config.t_limit, config.theta_limit, config.theta_dot_limit, config.beta_limit,
                               config.theta_ddot_limit, config.beta_cmd_limit)
    return limits


def _plan(config: Config) -> wn.Plan:
    codes = term_codes(config.terms)

    def place(term: str) -> int:
        return config.terms.index(term) if term in config.terms else -1

    plan = np.zeros(wn.N_PLAN, np.int64)
    plan[wn.KEEP] = config.kept_rows
    plan[wn.SOLVER] = SOLVERS.index(config.solver)
    plan[wn.TERM_A6], plan[wn.TERM_K1] = place("theta"), place("beta")
    plan[wn.TERM_A6_DOT], plan[wn.TERM_K1_DOT] = place("tau*theta"), place("tau*beta")
    plan[wn.MEASURED] = int(config.formulation == "measured")
    saturation = np.full(rb.N_COLUMNS, math.inf)
    saturation[rb.THETA], saturation[rb.THETA_DOT] = config.theta_saturation, config.theta_dot_saturation
    saturation[rb.BETA] = config.beta_saturation
    return wn.Plan(codes, centred_variables(codes), plan, np.array([config.threshold]),
                   np.array([config.max_gap]), saturation)


def _belief(config: Config) -> Belief:
    model = config.model
    assert model is not None
    term = np.array([config.terms.index("theta"), config.terms.index("beta")])
    return Belief(np.array(model.profile_t), np.array(model.profile_a6), np.array(model.profile_k1),
                  np.array([model.natural_frequency, model.damping_ratio, model.delay, config.sample_period,
                            config.theta_saturation, config.theta_dot_saturation, config.beta_saturation]),
                  model.variances(config.sample_period), term_codes(config.terms), term)


def _arrays(value: object) -> Iterator[np.ndarray]:
    """All arrays of a nest of tuples."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, tuple):
        for item in value:
            yield from _arrays(item)


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
        self._outcome = wn.outcome(q)
        self._work: wn.Work | None = None
        self._memory: ob.Store = ob.Store(np.zeros(0), np.zeros(0, np.int64), 0, 0)
        self._onboard: ob.Onboard | None = None
        self._range = un.GaugeStore(np.zeros(0), np.zeros(0, np.int64), 0)
        self._gauge: un.Gauge | None = None
        if config.formulation == "filtered":
            self._memory, self._onboard = ob.new_store(_belief(config), config.noise == "estimated")
            self._take = self._take_filtered
            if config.model is not None and config.model.sigma_t:
                self._range, self._gauge = un.new_gauge(config.model.sigma_t, config.model.sigma_a6,
                                                        config.model.sigma_k1)
        else:
            self._work = wn.regression_work(m, p, q, MAX_POWER + 1)
            self._take = self._take_regression
        self._close = rg.close_integral if config.formulation == "integral" else rg.close_pointwise
        self._enough = max(q + 2, (p + 1) // 2)
        self._push = rb.push
        self._waiting = 0
        self._busy = False
        self._has_estimate = False
        self._compile()
        self.reset()

    def _compile(self) -> None:
        """Compile (or load from the cache) every kernel, then refuse to compile in flight: an int is cast."""
        self.update(Sample(NAN, NAN, NAN, NAN))
        self._take(rb.WINDOW_COMPLETE)
        if self._onboard is not None:
            ob.abandon_window(*self._memory)
        if hasattr(self._push, "disable_compile"):
            self._push.disable_compile()

    def _state(self) -> tuple[np.ndarray, ...]:
        """Arrays that persist between samples."""
        return (self._clock, self._count, self._ring, self._random, *self._outcome, self._memory.floats,
                self._memory.integers, self._range.floats, self._range.integers)

    def __getstate__(self) -> dict[str, object]:
        """For copy and pickle: the choices and what persists; memory is allocated anew."""
        return {"config": self.config, "state": tuple(array.copy() for array in self._state()),
                "waiting": self._waiting, "has_estimate": self._has_estimate}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        self.__init__(saved["config"])  # type: ignore[misc]
        for array, given in zip(self._state(), saved["state"], strict=True):
            array[...] = given
        self._waiting, self._has_estimate = saved["waiting"], saved["has_estimate"]

    def reset(self) -> None:
        """Forget every sample and estimate and restart the row generator; configuration and memory stay."""
        self._clock[:] = 0.0
        self._count[:] = 0
        self._ring[:, :] = 0.0
        self._random[0] = first_state(self.config.seed)
        rg.clear_outcome(self._outcome, int(EstimateStatus.SHORT))
        if self._onboard is not None:
            ob.restart(*self._memory)
        if self._gauge is not None:
            un.restart_gauge(*self._range)
        self._waiting = 0
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
            if code >= 0:
                self._take(code)
        finally:
            self._busy = False
        status: Status = _STATUSES[code - rb.BUSY]
        return status

    def _take_regression(self, code: int) -> None:
        """A sample was accepted: the formulations that regress on the rows of a whole window."""
        if code == rb.WINDOW_COMPLETE:
            t_centre = self._clock[rb.T_CLOSED] + 0.5 * self.config.window
            self._close(self._plan, self._work, self._outcome, self._ring, self._count, self._random, t_centre)
            self._has_estimate = True

    def _take_filtered(self, code: int) -> None:
        """A sample was accepted: the predictor takes them a block at a time."""
        self._waiting += 1
        if self._waiting < BLOCK and code in (rb.ACCEPTED, rb.AFTER_GAP):
            return
        memory, config = self._memory, self.config
        spare = self._count[rb.CLOSED_BACK] if code == rb.WINDOW_COMPLETE else int(code == rb.CLOCK_RESET)
        closed = int(code == rb.WINDOW_COMPLETE)
        ob.take_samples(*memory, self._ring, self._count, self._waiting, spare, closed, config.max_gap,
                        config.sample_period)
        self._waiting = int(spare)
        if code == rb.WINDOW_COMPLETE:
            t_centre = self._clock[rb.T_CLOSED] + 0.5 * config.window
            ob.close_filtered(*memory, self._outcome, t_centre, self._enough)
            self._has_estimate = True
        elif code == rb.CLOCK_RESET:
            ob.abandon_window(*memory)
        if self._gauge is not None:
            self._watch_range(code)

    def _watch_range(self, code: int) -> None:
        """A block was tracked: the uncertainty level follows."""
        assert self._onboard is not None
        bank, watch, clock = self._onboard.bank, self._onboard.watch, self._clock
        un.watch_range(*self._range, bank.total, self._onboard.filter.time, clock[rb.T_FIRST], watch.counts,
                       watch.event)
        if code == rb.WINDOW_COMPLETE:
            un.close_range(*self._range, bank.total, clock[rb.T_CLOSED] + self.config.window)

    def estimate(self) -> Estimate | None:
        """The estimate of the last window that closed; None before the first."""
        if not self._has_estimate:
            return None
        number = [float(x) for x in self._outcome.number]
        status = EstimateStatus(int(self._outcome.flag[wn.STATUS]))
        xi, support = self._outcome.xi.copy(), self._outcome.support.copy()
        xi.flags.writeable = support.flags.writeable = False
        t_start = float(self._clock[rb.T_CLOSED])
        return Estimate(
            t_start=t_start, t_end=t_start + self.config.window, valid=status == EstimateStatus.OK, status=status,
            a6=number[wn.A6], k1=number[wn.K1], a6_std=number[wn.A6_STD], k1_std=number[wn.K1_STD],
            a6_k1_corr=number[wn.CORRELATION], a6_dot=number[wn.A6_DOT], k1_dot=number[wn.K1_DOT],
            a6_bound=number[wn.A6_BOUND], k1_bound=number[wn.K1_BOUND], condition=number[wn.CONDITION],
            xi=xi, support=support, terms=self.config.terms,
            rows=int(self._outcome.flag[wn.USED]), gaps=int(self._outcome.flag[wn.GAPS]),
            tracked=self._tracked(t_start + self.config.window), uncertainty=self._uncertainty())

    def _profile(self, t: float) -> tuple[float, float]:
        """The nominal's a6 and k1 at t."""
        model = self.config.model
        assert model is not None
        return (float(np.interp(t, model.profile_t, model.profile_a6)),
                float(np.interp(t, model.profile_t, model.profile_k1)))

    def _known(self) -> bool:
        """At least one parameter is known better than before the first sample."""
        assert self._onboard is not None
        a, k, v_aa, _, v_kk = self._onboard.bank.total.tolist()
        return min(v_aa, v_kk) < (KNOWN * FIRST_STD) ** 2 and math.isfinite(a + k)

    def _tracked(self, t: float) -> Tracked | None:
        if self._onboard is None:
            return None
        a, k, v_aa, v_ak, v_kk = self._onboard.bank.total.tolist()
        if not self._known():
            return Tracked(False, NAN, NAN, NAN, NAN, NAN)
        a6, k1 = self._profile(t)
        sign = math.copysign(1.0, a6 * k1)
        return Tracked(True, a6 * (1.0 + a), k1 * (1.0 + k), abs(a6) * math.sqrt(v_aa), abs(k1) * math.sqrt(v_kk),
                       sign * v_ak / math.sqrt(v_aa * v_kk))

    def _uncertainty(self) -> Uncertainty | None:
        if self._gauge is None:
            return None
        valid, levels = self._known(), []
        for p in range(2):
            raised = bool(self._gauge.flag[p, un.RAISED])
            since = float(self._gauge.since[p]) if raised else NAN
            if valid:
                band = int(self._gauge.band[p])
                levels.append(Level(float(self._gauge.delta[p]), float(self._gauge.delta_std[p]),
                                    un.UNDECIDED if band == un.NO_BAND else un.BANDS[band],
                                    tuple(self._gauge.probability[p].tolist()), not raised, since))
            else:
                levels.append(Level(NAN, NAN, un.UNDECIDED, (NAN,) * len(un.BANDS), not raised, since))
        return Uncertainty(valid, *levels)

    def changes(self) -> tuple[Change, ...]:
        """Sudden changes found so far, oldest first (the last MAX_EVENTS alarms; formulation `filtered`)."""
        if self._onboard is None:
            return ()
        found = []
        events = int(self._onboard.watch.counts[ch.EVENTS])
        for number in range(max(0, events - ch.MAX_EVENTS), events):
            event = self._onboard.watch.event[number % ch.MAX_EVENTS].tolist()
            t = event[ch.E_TIME]
            rows = {"a6": (ch.E_A6_BEFORE, ch.E_A6_AFTER, ch.E_A6_VARIANCE),
                    "k1": (ch.E_K1_BEFORE, ch.E_K1_AFTER, ch.E_K1_VARIANCE)}
            for name, nominal in zip(("a6", "k1"), self._profile(t), strict=True):
                if name in ch.KINDS[int(event[ch.E_KIND])]:
                    before, after, variance = (event[k] for k in rows[name])
                    found.append(Change(t, event[ch.E_TIME_STD], name, nominal * (1 + before), nominal * (1 + after),
                                        nominal * (after - before), abs(nominal) * math.sqrt(variance),
                                        event[ch.E_ALARM], bool(event[ch.E_FINAL])))
        return tuple(found)

    @property
    def noise_levels(self) -> dict[str, float]:
        """Noise levels believed now, over the model's declared ones, by name (formulation `filtered`)."""
        if self._onboard is None:
            return {}
        return {name: math.exp(level) for name, level in zip(NOISES, self._onboard.filter.level.tolist(), strict=True)}

    @property
    def counts(self) -> dict[str, int]:
        """How often `update` gave each status, by name; their sum is the number of calls."""
        return {status.name: int(self._count[rb.COUNT_FIRST + status - Status.BUSY]) for status in Status}

    @property
    def nbytes(self) -> int:
        """Bytes of all arrays this estimator owns; constant after construction."""
        owned = (self._limits, self._clock, self._count, self._ring, self._random, self._plan, self._outcome,
                 self._work, self._memory, self._range)
        return sum(array.nbytes for array in _arrays(owned))
