"""Table of the shapes that may be wrong beyond the usual numbers, with or without a cause's name."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..likelihood.command import nozzle_input
from ..likelihood.estimate import Number
from .believed import bending, mode
from .known import CURVES
from .model import Model

CYCLES = 10.0          # of a line in a log, fewer are a drift
LEAST_CLIMB = 3.5      # turns of phase that its climb makes to either end, fewer are a line
FASTEST_CLIMB = 9.0    # rad/s, from the middle of a log to its end, of a tone that climbs
SLOSH = (1.0, 12.0)    # rad/s: liquid propellant
BENDING = (6.0, 300.0)  # rad/s: a structure
MODE_STEPS = 28        # frequencies tried in each range
START_DAMPING = 0.03   # at which they are tried
DAMPING_RANGE = (0.002, 0.2)  # ratios of a mode; beyond it is a filter for anything
GUSTS = (1.5, 2.5, 4.0, 6.0)                 # s, durations tried
ONSET_TIMES = 60       # times tried along a log
PLAYS = (3e-4, 8e-4, 2e-3, 5e-3, 1.5e-2)   # rad
RATES = (0.02, 0.04, 0.07, 0.12, 0.2, 0.35)  # of the fastest command


# ---- shapes beyond them


class Column(NamedTuple):
    """The effect of a unit amplitude: a moment (n,) [rad/s^2], a command (n, 1) or (n, sub) [rad], a shift (n, 3) of
    the measurements; None where there is none."""

    force: np.ndarray | None = None
    command: np.ndarray | None = None
    shift: np.ndarray | None = None


@dataclass(frozen=True)
class Shape:
    """A candidate that is in the model: its kind, the names of its numbers, the linear ones first, and its `chance`."""

    kind: "Kind"
    names: tuple[str, ...]
    chance: float = 1.0

    def columns(self, m: Model, nonlinear: tuple[float, ...]) -> list[Column]:
        """Return a column per unit amplitude at these nonlinear values; cached in m, as they change seldom."""
        key = (self.kind.name, *nonlinear)
        if key not in m.columns:
            if len(m.columns) > 400:
                m.columns.clear()
            m.columns[key] = self.kind.make(m, *nonlinear)
        return list(m.columns[key])

    def effect(self, m: Model, values: tuple[float, ...]) -> Column:
        """Return the sum of the columns times the amplitudes; values: the shape's numbers, amplitudes first."""
        if self.kind.effective:
            return Column()
        sizes, columns = values[:self.kind.linear], self.columns(m, values[self.kind.linear:])
        together = [[size * x for size, x in zip(sizes, each, strict=True) if x is not None]
                    for each in zip(*columns, strict=True)]
        return Column(*(sum(each) if each else None for each in together))

    def effectiveness(self, m: Model, values: tuple[float, ...]) -> np.ndarray | float:
        """Return the factor (n,) on the input's effect, 1 unless the kind is `effective`; values: its numbers."""
        return 1.0 - values[0] * after(m, values[1]) if self.kind.effective else 1.0


@dataclass(frozen=True)
class Kind:
    """A kind of candidate beyond the usual numbers.

    cause       in the catalogue's words, "" for a shape that has no name there
    parameters  names of its numbers, `linear` of them amplitudes
    make        (model, nonlinear values) -> its `Column`s, of unit amplitudes
    when        names of Model's flags that must all be true;  starts  the nonlinear values that a scan tries
    prior       one sigma of the amplitudes;  bounds  (step, low, high) of each nonlinear number
    effective   it scales the input's effect;  once  it happens once
    curve       the filter's own name of the term that it is, "": its columns act, along the path as filtered
    """

    name: str
    cause: str
    parameters: tuple[str, ...]
    linear: int
    make: Callable[..., list[Column]]
    when: str = ""
    starts: Callable[[Model], list[tuple[float, ...]]] = lambda m: [()]
    prior: Callable[[Model], float] = lambda m: 1.0
    bounds: tuple[tuple[float, float, float], ...] = ()
    place: str = "plant"
    effective: bool = False
    once: bool = False
    curve: str = ""

    def fits(self, m: Model) -> bool:
        return all(getattr(m.log, each) for each in self.when.split())

    def numbers(self, m: Model, shape: Shape, nonlinear: tuple[float, ...]) -> list[Number]:
        """Return the model's numbers of a shape that a scan found at these nonlinear values, amplitudes first."""
        out = [Number(name, 0.0, 0.0, self.prior(m), 1e-3 * self.prior(m), cause=self.cause, parameter=parameter)
               for name, parameter in zip(shape.names[:self.linear], self.parameters, strict=False)]
        for name, parameter, value, (step, low, high) in zip(shape.names[self.linear:], self.parameters[self.linear:],
                                                             nonlinear, self.bounds, strict=True):
            wide = {"time": 1.0, "duration": 1.0}.get(parameter, 0.3 * abs(value))
            out.append(Number(name, value, 0.0, wide, step, low, high, self.cause, parameter))
        return out


def after(m: Model, time: float) -> np.ndarray:
    """Return the share (n,) of each row's interval that lies after a time [s]."""
    return np.clip((m.log.t[1:] - time) / m.log.dt, 0.0, 1.0)


def _hats(m: Model, count: int) -> np.ndarray:
    """Return (n, count) hat functions: 1 at one of `count` nodes along the log, linear to 0 at its neighbours."""
    nodes = np.linspace(-1.0, 1.0, count)
    return np.clip(1.0 - np.abs(m.log.tau[:, None] - nodes) / (nodes[1] - nodes[0]), 0.0, None)


def _tone(x: np.ndarray | float, phase: np.ndarray) -> list[Column]:
    """Return two columns: moment x (n,) [rad/s^2] times sine and times cosine of a phase (n,) [rad]."""
    return [Column(x * np.sin(phase)), Column(x * np.cos(phase))]


def _shift(m: Model, channel: int, x: np.ndarray) -> list[Column]:
    shift = np.zeros((m.log.n, 3))
    shift[:, channel] = x
    return [Column(shift=shift)]


def _gust(m: Model, time: float, duration: float) -> list[Column]:
    phase = (m.log.t[:-1] + 0.5 * m.log.dt - time) / max(duration, 1e-3)
    pulse = np.where((phase > 0.0) & (phase < 1.0), 0.5 - 0.5 * np.cos(2.0 * np.pi * phase), 0.0)
    return [Column(m.log.a6 * pulse)]


def _slosh(m: Model, frequency: float, damping: float) -> list[Column]:
    psi = mode(m.path.motion[:, 0], frequency, damping, m.log.track.period, (-1.0, 0.0, 0.0))
    return [Column(frequency**2 * np.append(0.5 * (psi[1:] + psi[:-1]), psi[-1]))]


def _limited(m: Model, rate: float) -> list[Column]:
    """Return the change of the command by a rate limit."""
    log, u = m.log, m.log.base_input.ravel()
    out = np.empty(len(u))
    nozzle_input(u, log.widths, log.servo_numbers(log.nominal_value), 0.0, 0.0, rate, out)
    return [Column(command=(out - u).reshape(log.n, -1))]


def _played(m: Model, width: float) -> list[Column]:
    """Return the change of the command by a play of this width."""
    def get(name: str, missing: float = 0.0) -> float:
        return m.log.nominal_value(name, missing) + width * (name == "play")

    return [Column(command=m.log.input_of(get) - m.log.base_input)]


# ---- where they are looked for


def _modes(m: Model, span: tuple[float, float]) -> list[tuple[float, ...]]:
    top = min(span[1], 0.9 * math.pi / m.log.track.period)
    return [(float(w), START_DAMPING) for w in np.geomspace(span[0], top, MODE_STEPS)] if top > span[0] else []


def _onsets(m: Model) -> list[tuple[float, ...]]:
    return [(float(x),) for x in m.log.t[0] + (m.log.t[-2] - m.log.t[0]) * np.linspace(0.04, 0.96, ONSET_TIMES)]


def _pulses(m: Model) -> list[tuple[float, ...]]:
    first, last = float(m.log.t[0]), float(m.log.t[-2])
    return [(float(x), d) for d in GUSTS if d < (last - first) / 3.0
            for x in np.arange(first + 0.02 * (last - first), last - d, 0.4 * d)]


def _windows(m: Model) -> list[tuple[float, ...]]:
    first, last = float(m.log.t[0]), float(m.log.t[-2])
    return [(float(x), d) for d in (0.8, 1.6) for x in np.arange(first, last - d, 0.5 * d) if last - first >= 10.0]


def lines_in(m: Model, e: np.ndarray, channel: int, climbs: bool = False) -> list[tuple[float, ...]]:
    """Return the frequencies [rad/s], of at least CYCLES, where the periodogram of a channel's whitened innovations e
    (r,) peaks; climbs: pairs with the climb [rad/s^2] that makes the peak highest, for frequencies that never are 0."""
    x = np.zeros(m.log.n)
    mine = m.log.channel == channel
    x[m.log.rows[mine]] = e[mine]
    x *= np.hanning(m.log.n)
    size, half = 1 << (2 * m.log.n - 1).bit_length(), 0.5 * m.log.span
    w = 2.0 * np.pi * np.fft.rfftfreq(size, m.log.track.period)
    most, apart = FASTEST_CLIMB / half, 2.0 * math.pi / half**2     # a turn of phase from the middle to either end
    rates = np.arange(-most, most, apart)
    found: list[tuple[float, float, float]] = []
    for climb in rates[np.abs(rates) > LEAST_CLIMB * apart] if climbs else (0.0,):
        turned = x * np.exp(-0.5j * climb * m.log.middle**2) if climbs else x
        power = np.abs(np.fft.fft(turned, size)[:len(w)])**2
        power[w < np.maximum(math.pi * CYCLES / half, abs(climb) * half)] = 0.0
        power[w > 0.8 * np.pi / m.log.track.period] = 0.0
        for _ in range(1 if climbs else 3):
            i = int(np.argmax(power))
            found += [(float(power[i]), float(w[i]), float(climb))] if power[i] > 0.0 else []
            power[max(0, i - 12):i + 13] = 0.0
    return [each[1:3 if climbs else 2] for each in sorted(found, reverse=True)[:3]]


def _rates(m: Model) -> list[tuple[float, ...]]:
    fastest = float(np.quantile(np.abs(np.diff(m.log.track.commands)) / np.diff(m.log.track.ticks)[:-1], 0.999))
    return [(x * fastest,) for x in RATES] if fastest > 0.0 else []


def _lines_below(m: Model) -> list[tuple[float, ...]]:
    return [(float(w),) for w in np.linspace(0.6, 4.0, 40)] if m.log.is_long else []


def _quantiles(x: np.ndarray, of: Sequence[float] | np.ndarray) -> list[tuple[float, ...]]:
    return [(float(each),) for each in np.quantile(x, of)]


def _product(term: str, first: int, second: int, when: str) -> Kind:
    """Return the kind of a term of the second order: the product of two of attitude, rate and nozzle."""
    def make(m: Model) -> list[Column]:
        x = m.path.motion[:, first] * m.path.motion[:, second]
        return [Column(np.append(0.5 * (x[1:] + x[:-1]), x[-1]))]

    def prior(m: Model) -> float:
        sizes = m.log.scales
        size = (sizes.theta, sizes.omega, sizes.beta)
        return sizes.acceleration / (size[first] * size[second])
    return Kind(term, "missing_term", (term,), 1, make, when, prior=prior, curve=CURVES[term])


ANYWHEN = (0.02, -1e9, 1e9)   # step and range of an event's time [s]
LASTING = (0.02, 0.2, 20.0)   # the same of its duration [s]
TONE = ("sine", "cosine", "frequency")
CANDIDATE_KINDS = (
    Kind("control_loss", "control_loss", ("fraction", "time"), 1,
         lambda m, time: [Column(-m.log.k1 * m.path.motion[:, 2] * after(m, time))], "input_moves", _onsets,
         lambda m: 0.5, (ANYWHEN,), effective=True, once=True),
    _product("theta^2", 0, 0, "has_theta"), _product("theta*theta_dot", 0, 1, "has_theta"),
    _product("theta_dot^2", 1, 1, ""), _product("theta*beta", 0, 2, "has_theta input_moves"),
    _product("theta_dot*beta", 1, 2, "input_moves"),
    Kind("moment_step", "moment_step", ("acceleration", "time"), 1, lambda m, time: [Column(after(m, time))],
         starts=_onsets, prior=lambda m: m.log.scales.acceleration, bounds=(ANYWHEN,), once=True),
    Kind("gust", "gust", ("angle", "time", "duration"), 1, _gust, "is_flown is_unstable", _pulses, lambda m: 0.2,
         (ANYWHEN, LASTING), "environment", once=True),
    Kind("periodic_disturbance", "periodic_disturbance", TONE, 2,
         lambda m, frequency: _tone(1.0, frequency * m.log.middle), "is_flown", lambda m: [],
         lambda m: m.log.scales.acceleration, ((2e-4, 0.05, 300.0),), "environment"),
    Kind("slosh", "slosh", ("coupling", "frequency", "damping_ratio"), 1, _slosh, "has_theta is_flown",
         lambda m: _modes(m, SLOSH), bounds=((2e-3, 0.2, 25.0), (1e-3, *DAMPING_RANGE))),
    Kind("bending", "bending", ("gain", "frequency", "damping_ratio"), 1,
         lambda m, frequency, damping: [Column(shift=bending(m.path.nozzle, frequency, damping, m.log.track))],
         "is_flown has_commands", lambda m: _modes(m, BENDING), lambda m: 0.1,
         ((2e-2, *BENDING), (1e-3, *DAMPING_RANGE))),
    Kind("lateral_drift", "lateral_drift", ("z_alpha", "z_beta"), 2,
         lambda m: [Column(-m.log.a6 * np.append(0.0, np.cumsum(x[:-1] * m.log.dt[:-1])))
                    for x in m.path.motion[:, [0, 2]].T],
         "has_theta is_unstable has_no_path", prior=lambda m: 0.1),
    Kind("actuator_backlash", "actuator_backlash", ("share", "half_width"), 1, _played, "shows_servo",
         lambda m: [(x,) for x in PLAYS], bounds=((2e-5, 1e-6, 0.2),), place="actuator"),
    Kind("actuator_rate_limit", "actuator_rate_limit", ("share", "rate"), 1, _limited, "shows_servo", _rates,
         bounds=((1e-3, 1e-3, 50.0),), place="actuator"),
    # in no list: what they explain is not named
    Kind("servo_curve", "", ("size",), 1, lambda m: [Column(command=m.path.input * np.abs(m.path.input))],
         "has_commands", place="actuator"),
    Kind("servo_asymmetry", "", ("size",), 1, lambda m: [Column(command=m.path.input**2)], "has_commands",
         place="actuator"),
    Kind("servo_friction", "", ("size", "soft"), 1,
         lambda m, soft: [Column(command=-np.tanh(m.path.nozzle_rate[:, None] / soft))], "has_commands",
         lambda m: [(0.005,), (0.02,)], bounds=((1e-3, 1e-3, 1.0),), place="actuator"),
    Kind("attitude_curve", "", ("size",), 1, lambda m: _shift(m, 0, m.path.motion[:, 0]**3), "has_both",
         prior=lambda m: 0.3 / m.log.scales.theta**2, place="sensor"),
    Kind("attitude_knee", "", ("size", "at"), 1, lambda m, at: _shift(m, 0, np.abs(m.path.motion[:, 0] - at)),
         "has_both", lambda m: _quantiles(m.path.motion[:, 0], np.linspace(0.1, 0.9, 9)), bounds=((1e-3, -3.0, 3.0),),
         place="sensor"),
    Kind("attitude_walk", "", ("size",), 1, lambda m: _shift(m, 0, m.log.tau), "has_both",
         prior=lambda m: m.log.scales.theta, place="sensor"),
    Kind("gyro_ceiling", "", ("size", "at"), 1,
         lambda m, at: _shift(m, 1, np.clip(m.path.motion[:, 1], -at, at) - m.path.motion[:, 1]), "has_both",
         lambda m: [(float(x * np.max(np.abs(m.path.motion[:, 1]))),) for x in (0.5, 0.65, 0.8, 0.9, 0.96)],
         bounds=((1e-3, 1e-6, 1e3),), place="sensor"),
    Kind("gyro_dead_zone", "", ("size", "at"), 1,
         lambda m, at: _shift(m, 1, -np.clip(m.path.motion[:, 1] / at, -1.0, 1.0)), "has_both",
         lambda m: _quantiles(np.abs(m.path.motion[:, 1]) + 1e-6, (0.1, 0.2, 0.35, 0.5, 0.7)),
         lambda m: m.log.scales.omega, ((1e-4, 1e-7, 1e3),), "sensor"),
    Kind("gyro_flip", "", ("size", "time", "duration"), 1, lambda m, time, duration: _shift(
             m, 1, m.path.motion[:, 1] * ((m.log.t[:-1] >= time) & (m.log.t[:-1] < time + duration))), "has_both",
         _windows, lambda m: 2.0, (ANYWHEN, LASTING), "sensor", once=True),
    Kind("gyro_warming", "", ("size",), 1, lambda m: _shift(m, 1, m.path.motion[:, 1] * m.log.tau), "has_both",
         place="sensor"),
    Kind("pickup_drift", "", ("size",), 1, lambda m: _shift(m, 2, m.log.tau), "has_beta has_commands",
         prior=lambda m: m.log.scales.beta, place="sensor"),
    Kind("aero_flutter", "", TONE, 2,
         lambda m, frequency: _tone(m.log.a6 * m.path.motion[:, 0], frequency * m.log.middle),
         "is_unstable", _lines_below, bounds=((1e-3, 0.1, 30.0),)),
    Kind("thrust_flutter", "", TONE, 2,
         lambda m, frequency: _tone(m.log.k1 * m.path.motion[:, 2], frequency * m.log.middle),
         "input_moves", _lines_below, bounds=((1e-3, 0.1, 30.0),)),
    Kind("chirp", "", (*TONE, "climb"), 2,
         lambda m, frequency, climb: _tone(1.0, frequency * m.log.middle + 0.5 * climb * m.log.middle**2), "is_long",
         lambda m: [], lambda m: m.log.scales.acceleration, ((1e-3, 0.05, 300.0), (1e-4, -10.0, 10.0)), "environment"),
    Kind("beat", "", (*(f"a{k}" for k in range(16)), "frequency"), 16, lambda m, frequency: [
             column for hat in _hats(m, 8).T for column in _tone(hat, frequency * m.log.middle)], "is_long",
         lambda m: [], lambda m: m.log.scales.acceleration, ((1e-3, 0.05, 300.0),), "environment"),
    Kind("a6_drift", "", ("size",), 1, lambda m: [Column(m.log.a6 * m.path.motion[:, 0] * m.log.tau)], "is_unstable"),
    Kind("wander", "", tuple(f"a{k}" for k in range(9)), 9, lambda m: [Column(x) for x in _hats(m, 10)[:, 1:].T],
         prior=lambda m: m.log.scales.acceleration, place="environment"),
)
LINES = ("periodic_disturbance", "beat", "chirp")   # whose frequencies the periodogram proposes
