"""Types of effects: a cause's description, an effect with its values, and the sum of all changes to a flight.

A `Cause` describes a kind (docs/formats.md, "Causes and effects"), an `Effect` is a cause with its values.  To the
compiled step most effects are numbers, whose neutral values change no bit of a flight; those with a memory, and those
that there may be many of, are rows.
"""

import math
from dataclasses import dataclass, field

import numpy as np


def record(*numbers: str, counts: tuple[str, ...] = ()) -> np.dtype:
    """Return a numpy record dtype with float64 fields `numbers` and int64 fields `counts`, read as attributes."""
    return np.dtype((np.record, [(name, np.float64) for name in numbers] + [(name, np.int64) for name in counts]))


# an oscillator x'' = -drag x' - stiffness x + ..., with the scratch of Runge-Kutta: its state when the step began, its
# weighted slopes
# of bending shown by attitude sensor and gyro: angle x, rate x_dot
MODE = record("bends", "stiffness", "drag", "gain", "angle", "rate", "x", "x_dot", "start", "start_dot", "total",
              "total_dot")
TERM = record("coefficient", "theta", "theta_dot", "beta", "function", "argument")  # exponents; of which of the three
TIMED = record("kind", "amount", "first", "second")  # what the time decides
INPUT_EFFECT = record("kind", "value", "x")        # what remembers between command and servo

LARGEST_PARAMETER = 1.0e12  # of a parameter in its unit: beyond it sums of doubles lose what they are added to
CENTRE = math.inf  # s, default of a `middle`: the centre of the flight, or of the log


@dataclass(frozen=True)
class Parameter:
    """One parameter of a cause: unit, neutral value, allowed range.

    neutral  value that changes nothing; None: there is none, so the parameter is required unless it has a default
    default  [unit] taken when left out, for parameters without a neutral value
    low, high  [unit] allowed, ends included; `above`: the low end is not
    into     number of `Changes` that it joins: a factor where its neutral value is 1, else a summand; '': none
    """

    name: str
    unit: str
    neutral: float | None = None
    default: float | None = None
    low: float = -math.inf
    high: float = math.inf
    above: bool = False
    into: str = ""

    @property
    def is_term(self) -> bool:
        """Whether its value is the name of a library term, not a number."""
        return self.unit == "term"

    @property
    def is_required(self) -> bool:
        return self.neutral is None and self.default is None

    @property
    def expected(self) -> str:
        """The allowed values, in words for an error message."""
        if self.is_term:
            return "a library term of theta, theta_dot, beta such as theta^3 or sin(theta)"
        low = f" above {self.low:g}" if self.above else f" of at least {self.low:g}" if self.low > -math.inf else ""
        high = f" of at most {self.high:g}" if self.high < math.inf else ""
        joined = " and".join(part for part in (low, high) if part)
        return f"a number{joined}" + (f" [{self.unit}]" if self.unit else "")

    def allows(self, value: float) -> bool:
        """Whether the value is in range and finite (or the neutral value or default itself, as an infinite rate)."""
        if not math.isfinite(value):
            return value in (self.neutral, self.default)
        return self.low <= value <= self.high and not (self.above
                                                       and value == self.low) and abs(value) < LARGEST_PARAMETER


@dataclass(frozen=True)
class Cause:
    """A kind of effect: name, place (plant, environment, actuator, sensor, controller), and parameters in order.

    meaning  the equation as text: u is the command on its way to the actuator, b the true nozzle angle, z_ the measured
             signals
    """

    name: str
    where: str
    parameters: tuple[Parameter, ...]
    meaning: str


@dataclass(frozen=True)
class Effect:
    """A cause (`name`) with its values, one per parameter of the cause; made and checked by `catalogue.effect`."""

    name: str
    values: tuple[float | str, ...]


@dataclass
class Changes:
    """What the effects of a flight change, all together: of several effects of one kind numbers are added, factors
    multiplied, and rows listed."""

    parameters: list[tuple[str, dict[str, float]]] = field(default_factory=list)  # name and values, of those on a6, k1
    modes: list[tuple[float, ...]] = field(default_factory=list)
    terms: list[tuple[float, ...]] = field(default_factory=list)
    timed: list[tuple[float, ...]] = field(default_factory=list)
    inputs: list[tuple[float, ...]] = field(default_factory=list)
    bandwidths: list[tuple[float, float]] = field(default_factory=list)   # (scale, share of the lag) of the servo
    walks: list[tuple[float, float]] = field(default_factory=list)        # (level [rad/sqrt(s)], start [rad])
    turbulences: list[tuple[float, float]] = field(default_factory=list)  # (level [rad], time constant [s])
    # plant
    aero_damping: float = 0.0          # 1/s
    aero_cubic: float = 0.0            # 1/rad^2
    friction: float = 0.0              # rad/s^2
    thrust_misalignment: float = -0.0  # rad
    nozzle_inertia: float = 0.0
    z_alpha: float = -0.0              # 1/s
    z_beta: float = -0.0               # 1/s
    # environment
    steady_wind: float = -0.0          # rad
    # actuator
    actuator_delay: float = 0.0        # s
    actuator_gain: float = 1.0
    actuator_bias: float = -0.0        # rad
    rate_limit: float = math.inf       # rad/s
    rate_reach: float = math.inf       # rad/s, of the demanded rate
    # sensor
    attitude_delay: float = 0.0        # s
    attitude_bias: float = -0.0        # rad
    gyro_delay: float = 0.0            # s
    gyro_scale: float = 1.0
    gyro_bias: float = -0.0            # rad/s
    nozzle_sensor_bias: float = -0.0   # rad
    # controller
    kp_scale: float = 1.0
    kd_scale: float = 1.0
    computing_time: float = 0.0        # s

    def join(self, parameter: Parameter, value: float) -> None:
        """Add `value` to the field named `parameter.into`, or multiply it there if the neutral value is 1; in place."""
        now = getattr(self, parameter.into)
        setattr(self, parameter.into, now * value if parameter.neutral == 1.0 else now + value)
