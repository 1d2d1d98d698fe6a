"""An estimator's memory, from its configuration: allocated exactly, cut, filled.  Nothing is compiled here."""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from . import batch as rg
from . import ring as rb
from . import step as st
from .belief import AIR_ALPHA, AIR_BETA, AIR_T, AIR_WIND, AT_BETA, AT_THETA, NONE, Belief
from .choices import SOLVERS
from .compress import first_state
from .config import Config
from .filtered import BLOCK, LEVEL_PRIOR, WIND_PRIOR
from .guard import CARRIED, seal_of
from .library import centred_variables, default_own_share, term_codes
from .memory import Block, quads_of
from .model import ATTITUDE_BIAS, MISALIGNMENT, N_NOISES, WIND_NOISES, Model
from .report import Report
from .states import N_STATES
from .status import EstimateStatus
from .stores import ENOUGH, ESTIMATE_LEVELS, Fixed, State, Work
from .stores import restart as restart_filtered
from .structure import Learner, Learning
from .uncertainty import Gauge, Sigma, restart_gauge
from .window import clear_outcome

FIXED, STATE, WORK = "fixed", "state", "work"


class Parts(NamedTuple):
    """Views of a block, by what they are for; None: this configuration does without.  A port to another language has
    them as structs."""

    fixed: Fixed | rg.Fixed
    state: State | rg.State
    work: Work | rg.Work
    learner: Learner | None = None
    learning: Learning | None = None
    sigma: Sigma | None = None
    gauge: Gauge | None = None
    report: Report | None = None


KINDS = {"fixed": FIXED, "state": STATE, "work": WORK, "learner": STATE, "learning": WORK, "sigma": FIXED,
         "gauge": STATE, "report": WORK}  # of the parts


def _sizes(config: Config) -> list[int]:
    model = config.model
    sizes = [0] * st.N_SIZES
    sizes[st.TERMS], sizes[st.WINDOW_ROWS], sizes[st.KEPT_ROWS] = len(config.terms), config.rows, config.kept_rows
    if model is not None:
        sizes[st.NODES], sizes[st.RANGE_NODES] = len(model.profile_t), len(model.sigma_t)
        sizes[st.STATES], sizes[st.LEVELS] = N_STATES + len(model.nuisances), len(model.levels)
        sizes[st.AIR_NODES], sizes[st.BLOCK_SAMPLES] = max(1, len(_air_times(model))), block_samples(config)
    return sizes


def is_structured(config: Config) -> bool:
    """More terms than theta and beta: which of them are there is learned."""
    return config.formulation == "filtered" and len(config.terms) > 2


def is_ranged(config: Config) -> bool:
    """The model has a range, so there is an uncertainty level."""
    return config.formulation == "filtered" and config.model is not None and bool(config.model.sigma_t)


def cut(config: Config, f: np.ndarray, i: np.ndarray) -> tuple[Parts, int, int]:
    """The parts of a block's buffers, in the order of `step`'s entries, and how much of the buffers they take."""
    if config.formulation != "filtered":
        fixed, state, work, at, m = st.cut_regression(f, i)
        return Parts(fixed, state, work), at, m
    parts: dict[str, Any] = {}
    fixed, state, work, parts["report"], at, m = st.cut_filtered(f, i)
    if is_structured(config):
        parts["learner"], parts["learning"], at, m = st.cut_structure(f, at, i, m)
    if is_ranged(config):
        parts["sigma"], parts["gauge"], at, m = st.cut_range(f, at, i, m)
    return Parts(fixed, state, work, **parts), at, m


class _Endless(np.ndarray):
    """Counts instead of cutting: every slice is as long as it is asked to be."""

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, slice):
            return np.broadcast_to(np.zeros((), self.dtype), key.stop - key.start)
        return super().__getitem__(key)


def allocate(config: Config) -> tuple[Block, Parts]:
    """Memory for a configuration, filled and ready for the first sample."""
    sizes = _sizes(config)
    floats, integers = np.zeros(1).view(_Endless), np.array(sizes).view(_Endless)
    _, at, m = cut(config, floats, integers)
    block = Block(quads_of(at), np.zeros(m, np.int64))
    block.integers[:st.N_SIZES] = sizes
    parts, _, _ = cut(config, *block)
    fill(config, parts)
    restart(config, parts)
    return block, parts


def fill(config: Config, parts: Parts) -> None:
    """What never changes."""
    limits = parts.fixed.limits
    limits[rb.PERIOD], limits[rb.WINDOW], limits[rb.MAX_GAP] = config.sample_period, config.window, config.max_gap
    limits[rb.LIMIT_FIRST:] = (config.t_limit, config.theta_limit, config.theta_dot_limit, config.beta_limit,
                               config.theta_ddot_limit, config.beta_cmd_limit, config.gamma_limit)
    if isinstance(parts.fixed, Fixed):
        assert config.model is not None
        _fill_filtered(config, config.model, parts)
    else:
        _fill_regression(config, parts.fixed)


def enough(config: Config) -> int:
    """Rows below which a window is SHORT: half of what it keeps, and two more than there are terms."""
    return max(len(config.terms) + 2, (config.kept_rows + 1) // 2)


def block_samples(config: Config) -> int:
    """Samples of a block: BLOCK in whole ones, one at least, and no more than a window has."""
    return min(max(math.floor(BLOCK / config.sample_period + 0.5), 1), config.rows)


def _fill_filtered(config: Config, model: Model, parts: Parts) -> None:
    assert isinstance(parts.fixed, Fixed)
    belief, option = parts.fixed.belief, parts.fixed.option
    belief.time[:], belief.a6[:], belief.k1[:] = model.profile_t, model.profile_a6, model.profile_k1
    belief.constant[:] = (model.natural_frequency, model.damping_ratio, model.time_constant, model.delay,
                          config.sample_period, config.missing_commands,
                          float(model.walk > 0.0 or model.turbulence > 0.0),
                          float(bool(_air_times(model))), model.turbulence_time, model.gamma_std, model.known_lean,
                          model.gyro_scale, model.command_gain, model.command_offset,
                          model.known_theta, model.known_theta_dot, model.known_beta,
                          config.theta_saturation, config.theta_dot_saturation, config.beta_saturation,
                          model.known_damping, block_samples(config) * config.sample_period / BLOCK)
    belief.variance[:] = model.variances(config.sample_period)
    belief.prior[:], belief.prior[N_NOISES:] = LEVEL_PRIOR, WIND_PRIOR
    _fill_nuisances(model, belief)
    belief.codes[:] = term_codes(config.terms)
    belief.term[AT_THETA], belief.term[AT_BETA] = config.terms.index("theta"), config.terms.index("beta")
    option[ESTIMATE_LEVELS], option[ENOUGH] = int(config.noise == "estimated"), enough(config)
    if parts.sigma is not None:
        sigma = parts.sigma
        sigma.time[:], sigma.a6[:], sigma.k1[:] = model.sigma_t, model.sigma_a6, model.sigma_k1


def _air_times(model: Model) -> tuple[float, ...]:
    """Nodes at which forecast or drift are given; none without them."""
    return tuple(sorted({*model.forecast_t, *model.drift_t}))


def _fill_nuisances(model: Model, belief: Belief) -> None:
    """The disturbances' parts of what is believed."""
    times, levels = _air_times(model), model.levels
    if times:
        belief.air[:, AIR_T] = times
        for column, nodes, values in ((AIR_WIND, model.forecast_t, model.forecast),
                                      (AIR_ALPHA, model.drift_t, model.drift_alpha),
                                      (AIR_BETA, model.drift_t, model.drift_beta)):
            if nodes:
                belief.air[:, column] = np.interp(times, nodes, values)
    belief.partner[:] = NONE
    for k, role in enumerate(model.nuisances):
        belief.role[k], belief.spread[k], belief.level[k] = role, model.spread(role), NONE
        if role < MISALIGNMENT and WIND_NOISES[role] in levels:
            belief.level[k] = levels.index(WIND_NOISES[role])
        if role > ATTITUDE_BIAS:
            belief.partner[role - ATTITUDE_BIAS] = N_STATES + k


def _fill_regression(config: Config, fixed: rg.Fixed) -> None:
    def place(term: str) -> int:
        return config.terms.index(term) if term in config.terms else -1

    fixed.codes[:] = term_codes(config.terms)
    fixed.centred[:] = centred_variables(fixed.codes)
    plan = fixed.plan
    plan[rg.KEEP], plan[rg.SOLVER], plan[rg.ENOUGH] = config.kept_rows, SOLVERS.index(config.solver), enough(config)
    plan[rg.TERM_A6], plan[rg.TERM_K1] = place("theta"), place("beta")
    plan[rg.TERM_A6_DOT], plan[rg.TERM_K1_DOT] = place("tau*theta"), place("tau*beta")
    plan[rg.MEASURED] = int(config.formulation == "measured")
    plan[rg.INTEGRAL] = int(config.formulation == "integral")
    plan[rg.HELD] = int(config.beta_held)
    fixed.threshold[rg.RAW] = 0.0 if config.threshold is None else config.threshold
    fixed.threshold[rg.OWN_SHARE] = default_own_share(config.terms) if config.threshold is None else 0.0
    fixed.saturation[:] = math.inf
    fixed.saturation[rb.THETA], fixed.saturation[rb.THETA_DOT] = config.theta_saturation, config.theta_dot_saturation
    fixed.saturation[rb.BETA] = config.beta_saturation


def state_arrays(value: Any, kind: str | None = None) -> Iterator[np.ndarray]:
    """Arrays that persist between samples."""
    for name, part in zip(value._fields, value, strict=True):
        of = kind or KINDS[name]
        if of != STATE or part is None:
            continue
        if isinstance(part, np.ndarray):
            yield part
        else:
            yield from state_arrays(part, of)


def restart(config: Config, parts: Parts) -> None:
    """Forget every sample: the state as it is before the first."""
    for array in state_arrays(parts):
        array[...] = 0
    clear_outcome(parts.state.outcome, int(EstimateStatus.SHORT))
    if isinstance(parts.state, State):
        assert isinstance(parts.fixed, Fixed)
        restart_filtered(parts.fixed, parts.state, parts.learner)
    else:
        parts.state.random[0] = first_state(config.seed)
    if parts.gauge is not None:
        restart_gauge(parts.gauge)
    parts.state.guard[CARRIED] = seal_of(carried(parts))


def carried(parts: Parts) -> Iterator[np.ndarray]:
    """What the seal CARRIED is over: what persists but for what has seals of its own and the last outcome."""
    state = parts.state
    own = (state.clock, state.counts, state.ring, state.seals, state.guard, *state.outcome)
    return (array for array in state_arrays(parts) if all(array is not each for each in own))
