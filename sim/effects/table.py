"""The types of an effect: its description, one instance of it, and the packed table that kernels read.

A `Cause` describes (the contract's table, section 4), an `Effect` is a cause with
its values, and `Table` is what the compiled step runs: one array a place, its rows
sorted by effect, then by value, so that the order in which effects are given changes
no bit.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

PLACES = ("plant", "environment", "actuator", "sensor", "controller")

# columns of a row: which effect of its place, its parameters in the cause's order, the code of its library term,
# its states (slosh, bending: value and rate; backlash: play; bandwidth, wash-out: lag), and scratch of Runge-Kutta
# (states at the step's start, weighted slopes)
(CODE, P0, P1, P2, TERM, _, _, _, _, _, MEMORY, MEMORY_DOT, START, START_DOT, TOTAL, TOTAL_DOT) = range(16)
N_COLUMNS = 16

LARGEST = 1.0e12   # of a parameter in its unit: beyond it sums of doubles lose what they are added to
CENTRE = math.inf  # s, default of a `middle`: the centre of the flight, or of the log


@dataclass(frozen=True)
class Parameter:
    """One parameter: unit, neutral value, allowed range.

    neutral  changes nothing; None: there is none, so the parameter is required unless it has a default
    default  [unit] taken when left out, for parameters without a neutral value
    low, high  [unit] allowed, ends included; `above`: the low end is not
    """

    name: str
    unit: str
    neutral: float | None = None
    default: float | None = None
    low: float = -math.inf
    high: float = math.inf
    above: bool = False

    @property
    def is_term(self) -> bool:
        """Whether its value is the name of a library term, not a number."""
        return self.unit == "term"

    @property
    def is_required(self) -> bool:
        return self.neutral is None and self.default is None

    @property
    def expected(self) -> str:
        """The values that it may have, in words."""
        if self.is_term:
            return "a library term of theta, theta_dot, beta such as theta^3 or sin(theta)"
        low = f" above {self.low:g}" if self.above else f" of at least {self.low:g}" if self.low > -math.inf else ""
        high = f" of at most {self.high:g}" if self.high < math.inf else ""
        joined = " and".join(part for part in (low, high) if part)
        return f"a number{joined}" + (f" [{self.unit}]" if self.unit else "")

    def allows(self, value: float) -> bool:
        """Finite (or the neutral value or default itself, as an infinite rate) and in range."""
        if not math.isfinite(value):
            return value in (self.neutral, self.default)
        return self.low <= value <= self.high and not (self.above and value == self.low) and abs(value) < LARGEST


@dataclass(frozen=True)
class Cause:
    """One row of the contract's table: where it acts, its name, its parameters in the order its kernel takes them."""

    name: str
    where: str
    parameters: tuple[Parameter, ...]


@dataclass(frozen=True)
class Effect:
    """A cause with its values, one per parameter of the cause; made and checked by `catalogue.effect`."""

    name: str
    values: tuple[float | str, ...]


class Table(NamedTuple):
    """Effects as arrays (n, N_COLUMNS), one a place, one row an effect."""

    plant: np.ndarray
    environment: np.ndarray
    actuator: np.ndarray
    sensor: np.ndarray
    controller: np.ndarray


def empty_table() -> Table:
    """No effect anywhere."""
    return Table(*(np.zeros((0, N_COLUMNS)) for _ in PLACES))
