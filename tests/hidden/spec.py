"""The description of a flight: what is flown (Spec), what is wrong with it (Hidden), and the truth (Label)."""

from dataclasses import dataclass, field
from typing import Any

PLAIN = "plain"  # the cause in the contract's own form
OTHER = "other"  # a physically different form of the same cause


@dataclass(frozen=True)
class Noise:
    """Factors on the vehicle's declared noise levels; 0 silences a source."""

    attitude: float = 1.0
    gyro: float = 1.0
    nozzle: float = 1.0
    command: float = 1.0
    push: float = 1.0  # of the unmodelled angular acceleration


QUIET = Noise(0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Hidden:
    """One thing that is wrong: the generator's own name for it, sizes in the units their names end in, its form."""

    name: str
    values: tuple[tuple[str, float], ...] = ()
    variant: str = PLAIN

    def __getitem__(self, key: str) -> float:
        return dict(self.values)[key]


@dataclass(frozen=True)
class Weather:
    """Wind that blows through a flight without being what is wrong with it; calm by default (see `weather`).

    turbulence     [rad], with its time constant [s]
    walk           [rad/sqrt(s)]; initial [rad]: one sigma of the wind at t = 0
    variant        PLAIN, or OTHER: a Dryden spectrum, a polygon
    """

    turbulence: float = 0.0
    walk: float = 0.0
    time_constant: float = 1.0
    initial: float = 0.0
    variant: str = PLAIN


@dataclass(frozen=True)
class Spec:
    """One flight, repeatable.

    nominal     a name of `vehicles`
    seed        of all noise
    rate        [Hz] of the log: any whole number of sub-steps a row
    effects     what is wrong; one of each kind
    dispersion  relative deviation of (a6, k1) over the whole flight
    reference   `nominal`, the vehicle's own attitude programme, or `rough`, one drawn from the seed
    drop        columns left out
    duration    [s]; None: the vehicle's
    wind        the weather it flies in
    first_order the servo is one of first order, as late (2 zeta/w) as the vehicle's own: time constant of the nominal
    """

    nominal: str = "constant"
    seed: int = 0
    rate: float = 100.0
    effects: tuple[Hidden, ...] = ()
    noise: Noise = field(default_factory=Noise)
    dispersion: tuple[float, float] = (0.0, 0.0)
    reference: str = "nominal"
    drop: tuple[str, ...] = ()
    duration: float | None = None
    wind: Weather = field(default_factory=Weather)
    first_order: bool = False


@dataclass(frozen=True)
class Label:
    """The truth about a flight.

    causes    listed effects in the contract's words: {"cause": NAME, "parameters": {P: value}}, contract units
    unlisted  own names of the effects that the contract's list does not have
    places    one set of acceptable places for each effect, in the order of spec.effects
    as_noise  True if every effect is coloured noise, which a diagnosis may also call a noise level
    lost      the vehicle left +-0.5 rad and its log ends there
    t_end     [s] of the last row
    spec      everything that was drawn; its repr is what a failing test should print
    """

    causes: tuple[dict[str, Any], ...]
    unlisted: tuple[str, ...]
    places: tuple[frozenset[str], ...]
    as_noise: bool
    lost: bool
    t_end: float
    spec: Spec

    @property
    def seed(self) -> int:
        return self.spec.seed

    @property
    def names(self) -> tuple[str, ...]:
        """Contract names of the listed causes."""
        return tuple(str(cause["cause"]) for cause in self.causes)
