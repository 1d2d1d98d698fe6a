"""The memory of an estimator, from the table: structured type, views by name, numbers before the first sample.

Nothing is compiled here.
"""

import math
from collections import namedtuple
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, NamedTuple

import numba
import numpy as np

from ..algebra.library import centred_variables, default_own_share, term_codes
from ..choices import SOLVERS
from ..config import Config
from ..filter import states as sx
from ..filter.filtered import BLOCK, LEVEL_PRIOR, WIND_PRIOR
from ..filter.modes import N_MODE_COLUMNS, NODE_T
from ..gate import ring as rb
from ..model import ATTITUDE_BIAS, MISALIGNMENT, N_NOISES, SPREADS, WIND_NOISES, Model
from ..watch.tracker import MINUTE, slopes_of
from . import table as tb
from .table import CARRIED_FROM, FIXED, I8, SIZE, STATE, Extent, Size, Struct, largest_size


def extents(shape: tuple[Extent, ...], size: Mapping[str, int]) -> tuple[int, ...]:
    """Shape of an array, as much of it as is in use."""
    def of(extent: Extent) -> int:
        if isinstance(extent, tuple):
            return math.prod(of(each) for each in extent)
        return extent if isinstance(extent, int) else size[extent]

    return tuple(of(each) for each in shape)


@cache
def dtype_of(struct: Struct, with_modes: bool = False) -> "np.dtype[Any]":
    """The structured type of a struct, with the extents of `largest_size`."""
    largest = largest_size(with_modes)._asdict()
    return np.dtype([(line.name, dtype_of(line.kind, with_modes), ()) if isinstance(line.kind, Struct)
                     else (line.name, line.kind, extents(line.shape, largest)) for line in struct.lines], align=True)


@cache
def members_of(struct: Struct) -> type[tuple[Any, ...]]:
    """The named tuple of a struct's arrays, numbers and structs.

    Its elements are views; the name of a number reads and writes the number itself, as in a kernel.
    """
    made: type[tuple[Any, ...]] = namedtuple(struct.name, [line.name for line in struct.lines])  # type: ignore[misc]
    made.__doc__ = struct.about
    for place, line in enumerate(struct.lines):
        if line.is_number:
            setattr(made, line.name, _number(place))
    return made


def _number(place: int) -> property:
    """The number that a named tuple has a view of at this place."""
    def read(self: tuple[Any, ...]) -> Any:
        return self[place][()]

    def write(self: tuple[Any, ...], value: float) -> None:
        self[place][()] = value

    return property(read, write)


def members(struct: Struct, block: np.ndarray, size: Size) -> Any:
    """Views of a block (1,) by their names, as much as is in use; `Size` itself, whose integers never change."""
    if struct is SIZE:
        return Size(*block[0].tolist())
    values: list[Any] = []
    for line in struct.lines:
        part = block[line.name]
        if isinstance(line.kind, Struct):
            values.append(members(line.kind, part, size))
        elif line.is_number:
            values.append(part.reshape(()))
        else:
            values.append(part[0][tuple(map(slice, extents(line.shape, size._asdict())))])
    return members_of(struct)(*values)


def named_arrays(value: Any, prefix: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Every array and number of a nest of named tuples, by its dotted name."""
    if isinstance(value, np.ndarray):
        yield prefix, value
    elif isinstance(value, tuple):
        for name, each in zip(value._fields, value, strict=True):  # type: ignore[attr-defined]
            yield from named_arrays(each, f"{prefix}.{name}" if prefix else name)


class Memory(NamedTuple):
    """All that an estimator has."""

    size: Size         # how much of it is in use
    struct: Struct     # the table of its block
    block: np.ndarray  # (1,) of the structured type
    words: np.ndarray  # of the block what is carried on, seen as int64
    parts: Any         # its arrays by name, as much as is in use
    apart: dict[str, np.ndarray]  # by name, what grows with the window, the rate or a profile

    @property
    def seen(self) -> Any:
        """The block as kernels take it: the array, or its members where nothing is compiled."""
        return (self.parts,) if numba.config.DISABLE_JIT else self.block  # type: ignore[attr-defined]

    @property
    def given(self) -> dict[str, np.ndarray | None]:
        """What stands apart as entries take it: None in place of an array that the model has no use for."""
        return {name: None if name in tb.OPTIONAL and not array.size else array for name, array in self.apart.items()}

    def state_arrays(self) -> list[tuple[str, np.ndarray]]:
        """The arrays that persist between samples, by name, in the order in which they are saved."""
        apart = [(name, self.apart[name]) for name, part, *_ in tb.SEPARATE_ARRAYS[self.struct.name] if part == STATE]
        return [*named_arrays(self.parts.state, STATE), *apart]


def size_of(config: Config) -> Size:
    """The sizes of the memory that a configuration uses."""
    model = config.model
    q = len(config.terms)
    if config.formulation == "filtered":
        assert model is not None
        return tb.size_of(q, len(model.nuisances), len(model.levels), len(model.servo_sigma),
                          config.terms.index("theta"), config.terms.index("beta"), known=model.known,
                          modes=model.mode_counts,
                          structured=int(q > 2),
                          ranged=int(bool(model.sigma_t)))
    return tb.size_of(q, integral=int(config.formulation == "integral"), solver=SOLVERS.index(config.solver),
                      by_share=int(_thresholds(config)[1] > 0.0))


def allocate(config: Config) -> Memory:
    """Memory for a configuration, with what never changes in flight; what persists is zero."""
    size = size_of(config)
    struct = tb.FILTERED if config.formulation == "filtered" else tb.REGRESSION
    kind = dtype_of(struct, size.modes > 0)
    block = np.zeros(1, kind)
    grown = size._asdict() | {"held": config.rows + 1, "window": config.rows, "kept": config.kept_rows}
    if config.model is not None:
        grown |= {"innovations": sx.N_CHANNELS * block_samples(config), "nodes": len(config.model.profile_t),
                  "air_nodes": max(1, len(_air_times(config.model))),
                  "mode_nodes": len(_mode_times(config.model)), "mode_columns": 1 + N_MODE_COLUMNS * size.modes,
                  "known_nodes": _known_nodes(config.model),
                  "channels_shown": sx.N_CHANNELS * size.shows, "range_nodes": len(config.model.sigma_t)}
    fixed = block[FIXED]["belief"] if struct is tb.FILTERED else block[FIXED]
    for name, number in size._asdict().items():
        fixed["size"][name] = number
    apart = {name: np.zeros(extents(shape, grown), kind) for name, _, kind, shape,
             _ in tb.SEPARATE_ARRAYS[struct.name]}
    state, begin = kind[STATE], kind.fields[STATE][1]  # type: ignore[index]
    carried = begin + state.fields[CARRIED_FROM[struct.name]][1]  # type: ignore[index]
    words = block.view(np.int64)[carried // I8.itemsize:(begin + state.itemsize) // I8.itemsize]
    memory = Memory(size, struct, block, words, members(struct, block, size), apart)
    limits = memory.parts.fixed.limits
    limits.period, limits.window, limits.max_gap = config.sample_period, config.window, config.max_gap
    limits.largest[:] = (config.t_limit, config.theta_limit, config.theta_dot_limit, config.beta_limit,
                         config.theta_ddot_limit, config.beta_cmd_limit, config.gamma_limit)
    if config.model is not None and struct is tb.FILTERED:
        _fill_filtered(config, config.model, memory)
    else:
        _fill_regression(config, memory.parts.fixed)
    return memory


def enough(config: Config) -> int:
    """Rows below which a window is SHORT: half of what it keeps, and two more than there are terms."""
    return max(len(config.terms) + 2, (config.kept_rows + 1) // 2)


def block_samples(config: Config) -> int:
    """Samples of a block: BLOCK in whole ones, one at least, and no more than a window has."""
    return min(max(math.floor(BLOCK / config.sample_period + 0.5), 1), config.rows)


def _fill_filtered(config: Config, model: Model, memory: Memory) -> None:
    belief, option = memory.parts.fixed.belief, memory.parts.fixed.option
    profile, sigma = memory.apart["profile"], memory.apart["sigma"]
    profile[:] = np.transpose([model.profile_t, model.profile_a6, model.profile_k1])
    sigma[:] = np.transpose([model.sigma_t, model.sigma_a6, model.sigma_k1])
    constant = belief.constant
    for line in tb.CONSTANT.lines:  # what has a name of the model is filled by it
        if hasattr(model, line.name):
            setattr(constant, line.name, getattr(model, line.name))
    constant.frequency = model.natural_frequency
    constant.damping = model.damping_ratio
    constant.controller_period = config.sample_period
    constant.missing = config.missing_commands
    constant.held = float(model.walk > 0.0 or model.turbulence > 0.0)
    constant.airy = float(bool(model.forecast_t or model.drift_t))
    constant.lean = model.known_lean
    constant.offset[:] = model.known_theta, model.known_theta_dot, model.known_beta
    constant.saturation[:] = config.theta_saturation, config.theta_dot_saturation, config.beta_saturation
    constant.aero_damping = model.known_damping
    constant.block_share = block_samples(config) * config.sample_period / BLOCK
    constant.a6_drift, constant.k1_drift = model.a6_drift / MINUTE, model.k1_drift / MINUTE
    belief.variance[:] = model.variances(config.sample_period)
    belief.prior[:], belief.prior[N_NOISES:] = LEVEL_PRIOR, WIND_PRIOR
    _fill_nuisances(model, belief, memory.apart["air"])
    belief.servo[:] = model.servo_sigma
    belief.slopes[:] = slopes_of(model.a6_drift, model.k1_drift)
    _fill_modes(model, size_of(config), belief, memory.apart["modes"], memory.apart["shown"])
    if model.moment_t:
        memory.apart["known"][:] = np.transpose([model.moment_t, model.known_moment])
    belief.codes[:] = term_codes(config.terms)
    belief.known_codes[:] = term_codes(tuple(name for name, _ in model.known_terms))
    belief.known_coefficient[:] = [coefficient for _, coefficient in model.known_terms]
    belief.sines[:] = np.reshape(model.sines, (-1, 3))
    belief.cubic = model.known_cubic
    belief.rate_limit, belief.rate_reach = model.rate_limit, model.rate_limit * (1.0 + model.rate_wind_up)
    belief.command[:] = (model.backlash, model.command_lag, model.washout)
    option.estimate_levels, option.least_samples = int(config.noise == "estimated"), enough(config)


def _air_times(model: Model) -> tuple[float, ...]:
    """Nodes at which forecast or drift are given; none without them."""
    return tuple(sorted({*model.forecast_t, *model.drift_t}))


def _mode_times(model: Model) -> tuple[float, ...]:
    """Nodes at which numbers of modes are given; none without modes."""
    return tuple(sorted({t for mode in model.modes for t in mode.t}))


def _known_nodes(model: Model) -> int:
    """Nodes of the known acceleration: one, which stays 0, where the model knows other things of `filter.known`."""
    acts, _, _, shaped = model.known
    return len(model.moment_t) or int(bool(acts or shaped or model.rate_limit > 0.0))


def _fill_nuisances(model: Model, belief: Any, air: np.ndarray) -> None:
    """The disturbances' parts of what is believed."""
    times, levels = _air_times(model), model.levels
    if times:
        air[:, sx.AIR_T] = times
        for column, nodes, values in ((sx.AIR_WIND, model.forecast_t, model.forecast),
                                      (sx.AIR_ALPHA, model.drift_t, model.drift_alpha),
                                      (sx.AIR_BETA, model.drift_t, model.drift_beta)):
            if nodes:
                air[:, column] = np.interp(times, nodes, values)
    belief.partner[:] = sx.ABSENT
    for k, role in enumerate(model.nuisances):
        belief.role[k], belief.spread[k], belief.level[k] = role, getattr(model, SPREADS[role]), sx.ABSENT
        if role < MISALIGNMENT and WIND_NOISES[role] in levels:
            belief.level[k] = levels.index(WIND_NOISES[role])
        if role > ATTITUDE_BIAS:
            belief.partner[role - ATTITUDE_BIAS] = sx.N_STATES + k


def _fill_modes(model: Model, size: Size, belief: Any, nodes: np.ndarray, shown: np.ndarray) -> None:
    """The modes' parts of what is believed, and what sensors show of them and of the nozzle's inertia."""
    belief.inertia = model.nozzle_inertia
    if size.shows:
        shown[0, 2], shown[1, 3] = model.nozzle_inertia, model.nozzle_inertia
    nodes[:, NODE_T] = _mode_times(model)
    number = 0
    for i, mode in enumerate(model.modes):
        for k, (name, values) in enumerate(mode.numbers()):
            nodes[:, NODE_T + 1 + N_MODE_COLUMNS * i + k] = np.interp(nodes[:, NODE_T], mode.t, values)
            sigma = getattr(mode, f"{name}_sigma")
            if sigma > 0.0:
                belief.number[number], belief.mode_of[number], belief.number_sigma[number] = k, i, sigma
                number += 1
        at = size.mode_at + 2 * i
        if size.shows:
            shown[0, at], shown[1, at + 1] = mode.angle, mode.rate


def _thresholds(config: Config) -> tuple[float, float]:
    """RAW and OWN_SHARE: what a term must exceed to stay, one of them 0."""
    if config.threshold is None:
        return 0.0, default_own_share(config.terms)
    return config.threshold, 0.0


def _fill_regression(config: Config, fixed: Any) -> None:
    def place(term: str) -> int:
        return config.terms.index(term) if term in config.terms else -1

    fixed.codes[:] = term_codes(config.terms)
    fixed.centred[:] = centred_variables(fixed.codes)
    plan = fixed.plan
    plan.keep, plan.enough = config.kept_rows, enough(config)
    plan.term[0], plan.term[1] = place("theta"), place("beta")
    plan.slope[0], plan.slope[1] = place("tau*theta"), place("tau*beta")
    plan.measured = int(config.formulation == "measured")
    plan.held = int(config.beta_held)
    fixed.threshold.raw, fixed.threshold.own_share = _thresholds(config)
    plan.sparse = int(any(_thresholds(config)) or config.solver in ("sr3", "lasso"))
    fixed.saturation[:] = math.inf
    fixed.saturation[rb.THETA], fixed.saturation[rb.THETA_DOT] = config.theta_saturation, config.theta_dot_saturation
    fixed.saturation[rb.BETA] = config.beta_saturation
