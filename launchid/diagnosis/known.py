"""What a log and its nominal say before anything is fitted: rows, commands, the nominal's effects, sizes, flags."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from sim.nominal import Nominal

from ..likelihood.command import nozzle_input, played
from ..likelihood.kernel import FIRST_ORDER_SERVO, NUMBERS, SECOND_ORDER_SERVO
from ..series import filled
from .believed import Believed, believed, modes
from .track import Track

MODEL_FOLDS = 6        # of the score
FOLD_PASSES = 3        # times that they go round the log
SCORE_BLOCKS = 24      # stretches that tell the score's error
GAP = 20.0             # times the first row's length: after a longer one the motion is unknown again
LONG = 20.0            # s, of a log that shows what changes slowly
SMOOTH_INPUT = 0.4     # second over first differences of a measured input, up to which its acceleration is known
SLOPE_TIME = 0.2       # s over which the size of the acceleration is measured
CURVES = {"sin(theta)": "sine", "cos(theta)": "cosine", "theta^2": "square", "theta^3": "cube",
          "sign(theta_dot)": "sign", "theta*theta_dot": "cross", "theta_dot^2": "rate_square",
          "theta*beta": "theta_beta", "theta_dot*beta": "rate_beta", "beta^2": "beta_square"}   # term: kernel's name
INPUTS_KEPT = 24       # of the servo's inputs for other delays, lags, ...


class Scales(NamedTuple):
    """The sizes of a log's motion: acceleration [rad/s^2], attitude, rate, nozzle, command (rms about the mean)."""

    acceleration: float
    theta: float
    omega: float
    beta: float


@dataclass(frozen=True, eq=False)
class KnownLog:
    """A track with all that follows from it and its nominal alone.

    z         (n, 3) measurements, the gyro's put earlier by `retimed` [s]
    middle    (n,) times [s] of the rows' middles from the log's own;  tau (n,) time from -1 to 1 over the log
    rows, channel, scored (r,)   of the innovations that are scored, `scored` an index into all;  fold, block (r,)
    """

    track: Track
    z: np.ndarray
    retimed: float = 0.0
    inputs: dict[tuple[float, ...], np.ndarray] = field(default_factory=dict, init=False, repr=False)  # a memo

    # ---- rows

    @property
    def t(self) -> np.ndarray:
        return self.track.t

    @property
    def n(self) -> int:
        return len(self.z)

    @cached_property
    def dt(self) -> np.ndarray:
        return np.diff(self.t)

    @cached_property
    def period(self) -> float:
        """The usual time [s] between two rows."""
        return float(np.median(self.dt))

    @property
    def span(self) -> float:
        return float(self.t[-1] - self.t[0])

    @property
    def centre(self) -> float:
        return float(0.5 * (self.t[0] + self.t[-2]))

    @cached_property
    def about(self) -> np.ndarray:
        """The rows' times (n,) [s] from the log's middle."""
        return self.t[:-1] - self.centre

    @cached_property
    def middle(self) -> np.ndarray:
        return self.t[:-1] + 0.5 * self.dt - self.centre

    @cached_property
    def tau(self) -> np.ndarray:
        return np.linspace(-1.0, 1.0, self.n)

    @property
    def longest_gap(self) -> float:
        """The time [s] between two rows after which the motion is unknown again."""
        return float(GAP * self.dt[0])

    @cached_property
    def _scored(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows and channels to score: not the first, nor those after a gap, while the filter settles."""
        ok, skip = np.isfinite(self.z), max(10, self.n // 200)
        for k in (0, *(np.flatnonzero(self.dt > self.longest_gap) + 1)):
            ok[k:k + skip] = False
        rows, channel = np.nonzero(ok)
        return rows, channel, np.flatnonzero(ok.ravel())

    @property
    def rows(self) -> np.ndarray:
        return self._scored[0]

    @property
    def channel(self) -> np.ndarray:
        return self._scored[1]

    @property
    def scored(self) -> np.ndarray:
        return self._scored[2]

    @cached_property
    def fold(self) -> np.ndarray:
        return self.fold_of(self.rows)

    def fold_of(self, rows: np.ndarray) -> np.ndarray:
        """Return the fold that each row belongs to."""
        return rows * (MODEL_FOLDS * FOLD_PASSES) // self.n % MODEL_FOLDS

    @cached_property
    def block(self) -> np.ndarray:
        return self.rows * SCORE_BLOCKS // self.n

    # ---- what the nominal believes

    @property
    def nominal(self) -> Nominal:
        return self.track.nominal

    @property
    def servo(self) -> Any:
        return self.track.record.actuator

    @cached_property
    def known(self) -> Believed:
        return believed(self.track, self.servo)

    @property
    def a6(self) -> np.ndarray:
        return self.known.a6

    @property
    def k1(self) -> np.ndarray:
        return self.known.k1

    @property
    def terms(self) -> dict[str, float]:
        return self.known.terms

    @property
    def given(self) -> dict[str, float]:
        return self.known.numbers

    @cached_property
    def modes(self) -> np.ndarray:
        """The nominal's slosh and bending (n, m) over each row."""
        return modes(self.track, self.known.changes)

    @property
    def law(self) -> Any:
        return self.nominal.controller or self.track.record.law

    @cached_property
    def tick(self) -> float:
        """The time [s] over which a command is held."""
        return self.law.period if self.law is not None else self.period

    # ---- what kind of log it is: the flags that candidates ask for

    @cached_property
    def has(self) -> dict[str, bool]:
        """Whether a column was measured, by its name."""
        there = np.isfinite(self.track.z).any(axis=0)
        return {name: bool(is_there) for name, is_there in zip(("theta", "theta_dot", "beta"), there, strict=True)}

    @property
    def has_theta(self) -> bool:
        return self.has["theta"]

    @property
    def has_beta(self) -> bool:
        return self.has["beta"]

    @property
    def has_both(self) -> bool:
        return self.has["theta"] and self.has["theta_dot"]

    @property
    def has_no_path(self) -> bool:
        return not self.track.record.path.size

    @property
    def is_long(self) -> bool:
        return self.span > LONG

    @property
    def is_commanded(self) -> bool:
        """Whether the input is a command: of the measured nozzle nothing is told of the servo."""
        return self.track.record.input != "beta"

    @property
    def is_flown(self) -> bool:
        """Whether the nominal's own simulation may have flown the log."""
        return self.law is not None and self.nominal.simulation is not None

    @property
    def is_blind(self) -> bool:
        """Whether nothing shows what a stranger's input does on its way: no nozzle is measured behind a command."""
        return not self.is_flown and not (self.is_commanded and self.has_beta)

    @property
    def shows_servo(self) -> bool:
        return self.has_commands and not self.is_blind

    @cached_property
    def is_smooth(self) -> bool:
        """Whether a measured input shows its acceleration."""
        u = self.track.commands
        return float(np.std(np.diff(u, 2))) < SMOOTH_INPUT * float(np.std(np.diff(u)))

    @cached_property
    def is_unstable(self) -> bool:
        return bool(np.any(self.a6 != 0.0))

    @property
    def has_stiffness(self) -> bool:
        """Whether the nominal has a moment that depends on the angle: a6 or a term in theta."""
        return self.is_unstable or any(term.startswith(("theta^", "sin(", "cos(")) or term == "theta"
                                       for term in self.terms)

    @cached_property
    def input_moves(self) -> bool:
        return bool(np.any(self.k1 != 0.0)) and self.scales.beta > 1e-9

    @property
    def has_commands(self) -> bool:
        return self.is_commanded and self.input_moves

    @property
    def unsure(self) -> float:
        """Squares that commands may feign which no row saw."""
        return 2.0 * self.track.record.unsure * self.n

    @cached_property
    def scales(self) -> Scales:
        z = self.track.z
        theta = filled(z[:, 0]) if self.has["theta"] else np.cumsum(filled(z[:, 1]) * self.dt)
        omega = filled(z[:, 1]) if self.has["theta_dot"] else np.gradient(theta, self.t[:-1])
        apart = max(2, round(SLOPE_TIME / self.period))
        acceleration = float(np.std(omega[apart:] - omega[:-apart])) / (apart * self.period)
        return Scales(acceleration + 1e-12, float(np.std(theta)) + 1e-12, float(np.std(omega)) + 1e-12,
                      float(np.std(self.track.commands)) + 1e-12)

    # ---- from the commands to the servo's input

    @cached_property
    def widths(self) -> np.ndarray:
        """The steps (n steps,) [s] of the filter."""
        return np.repeat(self.dt / self.track.sub, self.track.sub)

    @cached_property
    def integral(self) -> np.ndarray:
        """The commands' integral (m + 1,) [rad s] at every tick."""
        return np.append(0.0, np.cumsum(self.track.commands * np.diff(self.track.ticks)))

    def nominal_value(self, name: str, missing: float = 0.0) -> float:
        """Return the nominal's value of a number by its effects, `missing` if it has none."""
        return self.given.get(name, missing)

    def slowness(self, get: Callable[..., float]) -> float:
        """Return the lateness [s] of the nominal's servo at the bandwidth that `get` tells."""
        return self.servo.lag / max(get("bandwidth", 1.0), 0.01) if self.is_commanded else 0.0

    def servo_numbers(self, get: Callable[..., float]) -> np.ndarray:
        """Return (1,) NUMBERS with the servo's, of which `get` tells (name, missing)."""
        c = np.zeros(1, NUMBERS)
        c["servo"] = FIRST_ORDER_SERVO if self.servo.is_first_order else SECOND_ORDER_SERVO
        c["frequency"] = self.servo.frequency * max(get("bandwidth", 1.0), 0.01)
        c["damping_ratio"] = 1.0 if self.servo.is_first_order else self.servo.damping_ratio
        return c

    def input_of(self, get: Callable[..., float]) -> np.ndarray:
        """Return the servo's input (n, steps) [rad]: commands after delay, lag, washout, play, rate limit and gain, of
        which `get` tells (name, missing)."""
        delay, lag, washout, play, limit = (get("delay"), max(get("lag"), 0.0), max(get("washout"), 0.0), get("play"),
                                            get("rate_limit"))
        if self.is_blind:   # `delay` is then all of the lateness, of which the lag and a slower servo are a part
            delay -= lag - self.given.get("lag", 0.0) + self.slowness(get) - self.slowness(self.nominal_value)
        key = (delay, lag, washout, play, limit, get("bandwidth", 1.0) if limit > 0.0 else 1.0)
        if key not in self.inputs:
            ticks, edges = self.track.ticks, self.track.edges - (self.servo.delay * self.is_commanded + delay)
            commands, integral = self.track.commands, self.integral
            if play > 0.0:
                commands = np.empty(len(commands))
                played(self.track.commands, play, self.servo.command_noise_std * self.is_commanded, commands)
                integral = np.append(0.0, np.cumsum(commands * np.diff(ticks)))
            total = np.interp(edges, ticks, integral)
            total = np.where(edges < ticks[0], (edges - ticks[0]) * commands[0], total)
            total = np.where(edges > ticks[-1], integral[-1] + (edges - ticks[-1]) * commands[-1], total)
            u = sent = np.diff(total) / self.widths
            if lag > 0.0 or washout > 0.0 or limit > 0.0:
                u = np.empty(len(u))
                nozzle_input(sent, self.widths, self.servo_numbers(get), lag, washout,
                             1.0 / limit if limit > 0.0 else 0.0, u)
            if len(self.inputs) > INPUTS_KEPT:
                self.inputs.pop(next(iter(self.inputs)))
            self.inputs[key] = u.reshape(self.n, self.track.sub)
        return get("gain", 1.0) * self.inputs[key] + get("null_angle")

    @cached_property
    def base_input(self) -> np.ndarray:
        """The servo's input (n, steps) [rad] as the nominal believes it."""
        return self.input_of(self.nominal_value)
