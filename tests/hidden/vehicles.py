"""The three vehicles as the contract's nominal files describe them, copied as numbers.

Sources: the nominal files `constant.toml`, `vega_like.toml`, `greensite_cr826.toml` (values copied by hand, so
that a change there shows as a failing test) and the profile tables t [s], a6 [1/s^2], k1 [1/s^2] beside them,
read as plain data.  SI units (s, rad).
"""

import csv
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

PROFILES = Path(__file__).resolve().parents[2] / "sim" / "data" / "profiles"


@dataclass(frozen=True, eq=False)
class Vehicle:
    """One nominal.  Angles [rad], times [s]; the defaults are what the three files share."""

    name: str
    duration: float                 # s
    node_t: np.ndarray              # (n,) s
    node_a6: np.ndarray             # (n,) 1/s^2, linear between the nodes
    node_k1: np.ndarray             # (n,) 1/s^2
    servo_frequency: float          # rad/s
    kp: float
    kd: float                       # s
    turn_t: tuple[float, ...]       # s, nodes of the attitude programme
    turn: tuple[float, ...]         # rad
    servo_damping: float = 0.7
    command_noise: float = 7.0e-4   # rad, white, one draw per controller period
    deflection_limit: float = 0.12  # rad
    filter_time: float = 0.05       # s, of the pseudo-derivative
    period: float = 0.01            # s, of the controller
    attitude_noise: float = 3.5e-4  # rad, white, one draw per sample
    gyro_noise: float = 5.2e-4      # rad/s
    nozzle_noise: float = 3.5e-4    # rad
    push_noise: float = 8.7e-4      # rad/s^2, one draw per controller period

    def parameters(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(a6, k1) [1/s^2] at times t [s]."""
        return np.interp(t, self.node_t, self.node_a6), np.interp(t, self.node_t, self.node_k1)

    @property
    def turn_amplitude(self) -> float:
        """Largest angle of the attitude programme [rad]."""
        return float(np.max(np.abs(self.turn)))

    @property
    def turn_rate(self) -> float:
        """Largest rate of the attitude programme [rad/s]."""
        return float(np.max(np.abs(np.diff(self.turn) / np.diff(self.turn_t))))

    def windy(self) -> tuple[float, float]:
        """(first, last) time [s] at which a6 is at least 0.4 of its largest: where wind can be felt at all."""
        t = np.arange(0.0, self.duration, 0.5)
        a6 = self.parameters(t)[0]
        felt = t[a6 >= 0.4 * a6.max()]
        return float(felt[0]), float(felt[-1])

    def turning(self) -> tuple[tuple[float, float], ...]:
        """Stretches (start, end) [s] in which the programme turns at 0.6 of its largest rate or more."""
        rate = np.abs(np.diff(self.turn) / np.diff(self.turn_t))
        return tuple((self.turn_t[k], min(self.turn_t[k + 1], self.duration))
                     for k in range(len(rate)) if rate[k] >= 0.6 * self.turn_rate)


def _table(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    with (PROFILES / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    t, a6, k1 = (np.array([float(row[column]) for row in rows]) for column in ("t", "a6", "k1"))
    return t, a6, k1


TURN_T = (0.0, 6.0, 16.0, 28.0, 34.0, 44.0, 48.0, 56.0, 70.0)                             # s
TURN_CONSTANT = (0.0, 0.0, -0.1396, -0.1396, -0.0524, -0.0873, -0.0873, -0.0262, -0.0524)  # rad
TURN_LAUNCHER = (0.0, 0.0, -0.0977, -0.0977, -0.0367, -0.0611, -0.0611, -0.0183, -0.0367, -0.0611)  # rad
NAMES = ("constant", "vega_like", "greensite_cr826")


@cache
def vehicle(name: str) -> Vehicle:
    """The vehicle of this name (`greensite` will do); ValueError naming the ones there are."""
    if name == "constant":
        return Vehicle(name, 70.0, np.zeros(1), np.array([2.0]), np.array([-7.0]), servo_frequency=50.0,
                       kp=1.2, kd=0.5, turn_t=TURN_T, turn=TURN_CONSTANT)
    if name == "vega_like":
        return Vehicle(name, 95.0, *_table(name), servo_frequency=40.3, kp=2.0, kd=0.8,
                       turn_t=(*TURN_T, 95.0), turn=TURN_LAUNCHER)
    if name in ("greensite", "greensite_cr826"):
        return Vehicle("greensite_cr826", 150.0, *_table("greensite_cr826"), servo_frequency=40.3, kp=2.0, kd=0.8,
                       turn_t=(*TURN_T, 150.0), turn=TURN_LAUNCHER)
    raise ValueError(f"vehicle {name!r}: expected one of {', '.join(NAMES)}")
