"""The sections of a nominal as frozen dataclasses.  SI units (s, rad); `nominal.py` reads and writes them."""

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from .errors import InputError

if TYPE_CHECKING:
    from .effects import Effect


@dataclass(frozen=True, eq=False)
class Profile:
    """a6 and k1 over flight time, linear between the nodes.  Arrays of equal length, t increasing."""

    t: np.ndarray    # s
    a6: np.ndarray   # 1/s^2
    k1: np.ndarray   # 1/s^2
    path: str = ""   # of the CSV file it was read from

    def at(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(a6, k1) at times t [s], held constant beyond the ends."""
        return np.interp(t, self.t, self.a6), np.interp(t, self.t, self.k1)


@dataclass(frozen=True)
class Actuator:
    """beta_ddot = w^2 (u - beta) - 2 zeta w beta_dot, u the delayed command plus noise."""

    natural_frequency: float          # w, rad/s
    damping_ratio: float              # zeta
    command_noise_std: float = 0.0    # rad, one draw per controller period
    deflection_limit: float = math.inf  # rad, on the controller's output
    delay: float = 0.0                # s


@dataclass(frozen=True)
class Controller:
    """command = kp e + kd d, d = (tau d + e - e_previous)/(tau + period), e = theta_measured - theta_ref."""

    kp: float
    kd: float                         # s
    derivative_time_constant: float   # s
    period: float                     # s


@dataclass(frozen=True)
class Guidance:
    """Attitude reference, linear between the nodes, held beyond the ends."""

    t: tuple[float, ...]              # s, increasing
    theta_ref: tuple[float, ...]      # rad


@dataclass(frozen=True)
class Multisine:
    """Test input: sum of amplitude sin(frequency (t - start) + phase) while start <= t < start + duration,
    added to the controller's output before the deflection limit."""

    start: float                      # s
    duration: float                   # s
    frequency: tuple[float, ...]      # rad/s
    amplitude: tuple[float, ...]      # rad
    phase: tuple[float, ...]          # rad

    def at(self, t: np.ndarray) -> np.ndarray:
        """Its angle [rad] at times t [s]; -0.0, which changes no bit of a sum, outside."""
        angle = np.zeros(len(t))
        for frequency, amplitude, phase in zip(self.frequency, self.amplitude, self.phase, strict=True):
            angle += amplitude * np.sin(frequency * (t - self.start) + phase)
        return np.where((self.start <= t) & (t < self.start + self.duration), angle, -0.0)


@dataclass(frozen=True)
class Sensors:
    """White noise, one draw per sample; quantisation 0 is none."""

    period: float                     # s
    theta_std: float                  # rad
    theta_dot_std: float              # rad/s
    beta_std: float                   # rad
    theta_step: float = 0.0           # rad
    theta_dot_step: float = 0.0       # rad/s
    beta_step: float = 0.0            # rad


@dataclass(frozen=True)
class Simulation:
    """How it is integrated."""

    duration: float                   # s
    step: float = 0.001               # s, Runge-Kutta 4
    acceleration_noise_std: float = 0.0  # rad/s^2, one draw per controller period


@dataclass(frozen=True)
class Diagnosis:
    """One-sigma relative error of a6 and k1 that is not worth calling wrong."""

    tolerance: float = 0.02


@dataclass(frozen=True, eq=False)
class Nominal:
    """One nominal file.  Sections a command does not need may be absent (None); `require` asks for them.

    theta_ddot = a6 theta + k1 beta + sum coefficient*term.  Of a plant given by [vehicle.terms] `vehicle` holds
    the coefficients of `theta` and `beta`, constant, and `terms` all others, by their names in the library.
    """

    name: str
    vehicle: Profile
    sensors: Sensors
    uncertainty: Profile | None = None   # sigma of a6 and k1 over time
    actuator: Actuator | None = None
    controller: Controller | None = None
    guidance: Guidance | None = None
    simulation: Simulation | None = None
    diagnosis: Diagnosis = field(default_factory=Diagnosis)
    test_input: Multisine | None = None
    effects: tuple["Effect", ...] = ()
    terms: tuple[tuple[str, float], ...] = ()  # (library term, coefficient)
    path: str = ""

    def require(self, *sections: str) -> None:
        """Raise InputError naming the first of these sections that the file lacks."""
        for section in sections:
            if getattr(self, section) is None:
                raise InputError(f"{self.path}: section [{section}] is missing; this command needs it")
