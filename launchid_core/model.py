"""What the filtered formulation believes of the vehicle: profile, actuator, noises."""

import math
from dataclasses import dataclass, fields

import numpy as np

NOISES = ("theta_std", "theta_dot_std", "beta_std", "command_noise_std", "acceleration_noise_std")
N_NOISES = len(NOISES)


@dataclass(frozen=True, kw_only=True)
class Model:
    """Nominal of theta_ddot = a6(t) theta + k1(t) beta behind a second-order actuator.

    profile_t  [s], profile_a6, profile_k1 [1/s^2]  nodes, linear between, held beyond; one node: constant
    natural_frequency [rad/s], damping_ratio, delay [s]  beta_ddot = w^2 (u(t - delay) - beta) - 2 zeta w beta_dot
    theta_std [rad], theta_dot_std [rad/s], beta_std [rad]  white sensor noise, one draw per sample
    command_noise_std [rad], acceleration_noise_std [rad/s^2]  process noise, one draw per `noise_period`
    noise_period [s]       how long a draw of the process noise is held
    sigma_t [s], sigma_a6, sigma_k1  nodes of the relative range a = a0 (1 + sigma delta), |delta| <= 1, linear between,
                           held beyond; empty: no uncertainty level is asked for

    A wrong value raises ValueError naming field, value and allowed range.
    """

    profile_t: tuple[float, ...]
    profile_a6: tuple[float, ...]
    profile_k1: tuple[float, ...]
    natural_frequency: float
    damping_ratio: float
    theta_std: float
    theta_dot_std: float
    beta_std: float
    command_noise_std: float
    acceleration_noise_std: float
    noise_period: float
    delay: float = 0.0
    sigma_t: tuple[float, ...] = ()
    sigma_a6: tuple[float, ...] = ()
    sigma_k1: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for field in fields(self):
            if field.name.startswith("profile"):
                values = tuple(float(x) for x in getattr(self, field.name))
                object.__setattr__(self, field.name, values)
                if not values or not all(map(math.isfinite, values)) or len(values) != len(self.profile_t):
                    raise ValueError(f"{field.name}={values!r}: expected {len(self.profile_t)} finite numbers, "
                                     "as many as profile_t")
            elif field.name.startswith("sigma"):
                self._require_sigma(field.name)
            else:
                value = float(getattr(self, field.name))
                object.__setattr__(self, field.name, value)
                least = field.name in ("delay", "damping_ratio")
                if not (math.isfinite(value) and (value > 0 or (least and value == 0))):
                    raise ValueError(f"{field.name}={value!r}: expected a finite number "
                                     f"{'of at least' if least else 'above'} 0")
        if any(b <= a for a, b in zip(self.profile_t, self.profile_t[1:], strict=False)):
            raise ValueError(f"profile_t={self.profile_t!r}: expected increasing times")
        if any(b <= a for a, b in zip(self.sigma_t, self.sigma_t[1:], strict=False)):
            raise ValueError(f"sigma_t={self.sigma_t!r}: expected increasing times")

    def _require_sigma(self, name: str) -> None:
        """As many finite numbers as sigma_t; a range is above 0."""
        values = tuple(float(x) for x in getattr(self, name))
        object.__setattr__(self, name, values)
        good = all(math.isfinite(x) and (x > 0 or name == "sigma_t") for x in values)
        if not good or len(values) != len(self.sigma_t):
            raise ValueError(f"{name}={values!r}: expected {len(self.sigma_t)} finite numbers"
                             f"{'' if name == 'sigma_t' else ' above 0'}, as many as sigma_t")

    def variances(self, sample_period: float) -> np.ndarray:
        """Variances (5,) in the order of NOISES; process noise keeps its spectral density at the sample period."""
        held = self.noise_period / sample_period
        scale = np.array([1.0, 1.0, 1.0, held, held])
        variances: np.ndarray = scale * np.array([getattr(self, name) for name in NOISES]) ** 2
        return variances
