"""The smallest test input that makes a flight informative enough.

An orthogonal multisine on the command, as flight tests use (Morelli, J. Aircraft
49, 2012): harmonics of the window's length with Schroeder phases (low peaks).
The power of each harmonic is chosen by multiplicative updates of an optimal
design (Torsney 1988): what it adds to the information of the parameter that is
known worst decides its share.  The total is then found by bisection on the true
bound of the flight that flies it.

Assumption: information adds over harmonics (they are orthogonal over a window);
the bisection's flights do not assume it.
"""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from sim.errors import InputError, UsageError
from sim.nominal import Nominal
from sim.sections import Multisine

from .bound.flights import flight_information
from .bound.information import bounds_of

HIGHEST_FREQUENCY = 12.0  # rad/s: above it the attitude hardly moves and bending modes begin
MAX_HARMONICS = 12
PROBE = 0.004           # rad, of one harmonic while its information is measured
DESIGN_PASSES = 60
SMALLEST_SHARE = 0.02   # of the power: harmonics below it are dropped
TEST_INPUT_SEED = 0


@dataclass(frozen=True, eq=False)
class Plan:
    """A nominal with the designed test input; before, after: accuracy without and with it, the median over windows of
    the larger relative Cramer-Rao bound of a6 and k1."""

    nominal: Nominal
    before: float
    after: float
    root_mean_square: float  # rad, of the input
    peak: float              # rad


def harmonics(nominal: Nominal, window: float) -> np.ndarray:
    """Return frequencies [rad/s] with whole periods in a window [s], thinned to MAX_HARMONICS."""
    count = max(1, math.floor(HIGHEST_FREQUENCY * window / (2.0 * math.pi)))
    chosen = np.unique(np.round(np.geomspace(1, count, MAX_HARMONICS)).astype(int))
    return 2.0 * math.pi * chosen / window


def with_input(nominal: Nominal, frequency: np.ndarray, amplitude: np.ndarray) -> Nominal:
    """Return the nominal that flies sines of frequencies [rad/s] and amplitudes [rad] (h,) over its whole flight."""
    assert nominal.simulation is not None
    keep = amplitude > 0.0
    n = int(np.sum(keep))
    if n == 0:
        return dataclasses.replace(nominal, test_input=None)
    share = np.cumsum(amplitude[keep] ** 2) / np.sum(amplitude**2)
    phase = -2.0 * math.pi * np.concatenate([[0.0], np.cumsum(share)[:-1]])  # Schroeder, IEEE Trans. IT 16, 1970
    multisine = Multisine(start=0.0, duration=nominal.simulation.duration, frequency=tuple(frequency[keep].tolist()),
                          amplitude=tuple(amplitude[keep].tolist()), phase=tuple(phase.tolist()))
    return dataclasses.replace(nominal, test_input=multisine)


def accuracy_of(information: np.ndarray, window: float) -> float:
    """Return the median over windows of the larger relative bound of a6 and k1, from their information (w, 2, 2)."""
    bound = bounds_of(information, window)
    return float(np.median(np.maximum(bound.a6, bound.k1)))


def typical(information: np.ndarray, window: float) -> int:
    """Return the index of the window whose larger relative bound is the median, from information (w, 2, 2)."""
    bound = bounds_of(information, window)
    worse = np.maximum(bound.a6, bound.k1)
    return int(np.argsort(worse)[len(worse) // 2])


def design_shares(base: np.ndarray, gains: np.ndarray, power: float) -> np.ndarray:
    """Return the shares (h,) of `power` among harmonics that make the larger variance of the two parameters small.

    base (2, 2): information without input; gains (h, 2, 2): what each harmonic adds to it per unit of power
    """
    shares = np.full(len(gains), 1.0 / len(gains))
    for _ in range(DESIGN_PASSES):
        covariance = np.linalg.inv(base + power * np.einsum("h,hij->ij", shares, gains))
        worst = int(np.argmax(np.diag(covariance)[:2]))
        slope = np.einsum("i,hij,j->h", covariance[worst], gains, covariance[worst])
        shares = shares * np.maximum(slope, 0.0)
        shares /= np.sum(shares)
    shares[shares < SMALLEST_SHARE] = 0.0
    return shares / np.sum(shares)


def probe(nominal: Nominal, frequency: np.ndarray, window: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the information of the flight without test input (w, 2, 2), and what each harmonic adds per rad^2 (h, w,
    2, 2); InputError if a small input already loses the vehicle."""
    base = flight_information(nominal, window, TEST_INPUT_SEED)
    added = []
    for k in range(len(frequency)):
        amplitude = np.zeros(len(frequency))
        amplitude[k] = PROBE
        flown = flight_information(with_input(nominal, frequency, amplitude), window, TEST_INPUT_SEED)
        if len(flown) < len(base):
            raise InputError(f"{nominal.path}: the vehicle is lost with a test input of {PROBE} rad; "
                             "no input can be planned")
        values, vectors = np.linalg.eigh((flown - base) / PROBE**2)
        added.append(np.einsum("wij,wj,wkj->wik", vectors, np.maximum(values, 0.0), vectors))
    return base, np.array(added)


def plan(nominal: Nominal, accuracy: float, window: float) -> Plan:
    """Design the smallest input whose flight reaches `accuracy` (relative, one sigma) in windows of `window` seconds.

    Raise UsageError for a wrong accuracy or window, InputError if the deflection limit does not allow it.
    """
    nominal.require("actuator", "controller", "guidance", "simulation")
    assert nominal.simulation is not None and nominal.actuator is not None
    if not 0.0 < accuracy < 1.0:
        raise UsageError(f"accuracy {accuracy!r}: expected a relative accuracy above 0 and below 1, such as 0.01")
    if not 4.0 * nominal.sensors.period <= window <= nominal.simulation.duration:
        raise UsageError(f"window {window!r}: expected seconds from {4 * nominal.sensors.period:g} to the flight's "
                         f"{nominal.simulation.duration:g}")
    frequency = harmonics(nominal, window)
    base, added = probe(nominal, frequency, window)
    before = accuracy_of(base, window)
    if before <= accuracy:
        return Plan(dataclasses.replace(nominal, test_input=None), before, before, 0.0, 0.0)
    middle = typical(base, window)
    gains = added[:, middle]
    wanted = max((before / accuracy) ** 2 - 1.0, 1e-3) * np.trace(base[middle]) / np.trace(gains.mean(axis=0))
    shape = np.sqrt(2.0 * design_shares(base[middle], gains, float(wanted)))
    low, high = 0.0, nominal.actuator.deflection_limit / float(np.sum(shape))
    after = reached(nominal, frequency, high * shape, window, len(base))
    if not after <= accuracy:
        raise InputError(f"{nominal.path}: accuracy {accuracy:g} in {window:g} s windows is out of reach: at the "
                         f"deflection limit of {nominal.actuator.deflection_limit:g} rad it is {after:.3g} "
                         f"(without input {before:.3g})")
    for _ in range(14):  # the amplitude to 1 in 16,000
        scale = 0.5 * (low + high)
        value = reached(nominal, frequency, scale * shape, window, len(base))
        if value <= accuracy:
            high, after = scale, value
        else:
            low = scale
    planned = with_input(nominal, frequency, high * shape)
    assert planned.test_input is not None
    angle = planned.test_input.at(np.arange(0.0, nominal.simulation.duration, nominal.sensors.period))
    return Plan(planned, before, after, float(np.sqrt(np.mean(angle**2))), float(np.max(np.abs(angle))))


def reached(nominal: Nominal, frequency: np.ndarray, amplitude: np.ndarray, window: float, windows: int) -> float:
    """Return the accuracy (`accuracy_of`) of the flight with this input; inf if the vehicle is lost."""
    information = flight_information(with_input(nominal, frequency, amplitude), window, TEST_INPUT_SEED)
    return accuracy_of(information, window) if len(information) == windows else math.inf
