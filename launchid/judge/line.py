"""Ask a log once for a line in what the rigid model leaves of theta_dot: a mode that its nominal does not declare.

A bending mode or a tone that no nominal declares draws k1 and a6 by several deviations, and the whiteness of a window's
innovations passes one such window in ten. Its power stands in a narrow band, which noise, weather and errors of a6, k1
or the servo do not: so the spectrum of the rest is held against its own surroundings.
"""

import math
from typing import NamedTuple

import numpy as np

from sim.effects import values
from sim.nominal import Nominal

from ..chi_square import quantile
from ..log.check import CheckedLog
from ..spectra import hann, segments
from ..weakform.prepare import usable
from ..weakform.rows import Rows
from .table import TESTS

SEGMENT = 10.0       # s: long enough for bands of 0.15 Hz, which a mode of a few per cent of damping fills
FEWEST_SEGMENTS = 5  # whose periodograms are averaged
FEWEST_ROWS = 64     # of a segment
LOWEST = 1.5         # Hz: below it weather and the control loop have their own peaks
HIGHEST = 0.95       # of half the rate
AROUND = 1.5         # Hz to either side, whose median is the surroundings
OWN = 2              # frequencies to either side that are the line's own
NOT_RIGID = 0.15     # of the acceleration by the nominal, that may be left because a6, k1 or the servo are others
OVERLAP = 0.9        # independent periodograms a segment, of segments that overlap by a half under a Hann window
DECLARED = 0.3       # of a declared mode's frequency, to either side, in which it may stand


class Line(NamedTuple):
    """A mode or tone that is missing: its frequency [rad/s], its power over that of its surroundings (of slosh its size
    in standard deviations), `bending` or `slosh`."""

    frequency: float
    ratio: float
    kind: str = "bending"

    @property
    def words(self) -> str:
        """What was found and what to do, in words."""
        if self.kind == "slosh":
            return (f"the log contradicts the nominal, and does not with a slosh near {self.frequency:.3g} rad/s: "
                    f"declare [[slosh]] near {self.frequency:.3g} rad/s")
        return (f"theta_dot has a line near {self.frequency:.3g} rad/s, {self.ratio:.2g} times its surroundings, of "
                f"which the nominal has no mode: declare [[bending]] near {self.frequency:.3g} rad/s")


def undeclared_line(seen: CheckedLog, nominal: Nominal) -> Line | None:
    """Return the strongest line of a log that no mode of its nominal accounts for; None without one, or of a log that
    is too short, has no gyro or is too slow to tell."""
    rows = usable(seen, is_steadied=False)
    if rows is None or not rows.has_rate:
        return None
    length = max(min(round(SEGMENT / rows.period), len(rows.t) // (FEWEST_SEGMENTS // 2 + 1)), FEWEST_ROWS)
    left, rigid = _increments(rows, nominal)
    power, count = _spectrum(left, rows, length)
    if count < FEWEST_SEGMENTS:
        return None
    frequency = np.fft.rfftfreq(length, rows.period)
    expected = _surroundings(power, frequency, count) + \
        NOT_RIGID**2 * sum((_spectrum(each, rows, length)[0] for each in rigid), np.zeros(len(power)))
    asked = (frequency > LOWEST) & (frequency < HIGHEST * 0.5 / rows.period)
    for mode, share in declared_modes(nominal):
        asked &= np.abs(math.tau * frequency - mode) > share * mode
    if not asked.any():
        return None
    ratio = np.divide(power, expected, out=np.zeros(len(power)), where=asked & (expected > 0.0))
    at = int(np.argmax(ratio))
    chance = TESTS["no undeclared line"].limit / np.count_nonzero(asked)
    if not ratio[at] > quantile(1.0 - chance, _freedom(count)) / _freedom(count):
        return None
    near = slice(max(at - OWN, 0), at + OWN + 1)
    return Line(math.tau * float(np.average(frequency[near], weights=power[near])), float(ratio[at]))


def declared_modes(nominal: Nominal) -> list[tuple[float, float]]:
    """Return (frequency [rad/s], share of it within which it may stand) of each mode and tone that is declared."""
    modes = [(each.frequency, each.frequency_sigma) for each in nominal.slosh]
    modes += [(each.frequency, each.frequency_sigma) for each in nominal.bending]
    found = [(at, DECLARED + 3.0 * sigma) for frequency, sigma in modes for at in frequency.value]
    return found + [(float(values(each)["frequency"]), DECLARED) for each in nominal.effects
                    if "frequency" in values(each)]


def _increments(rows: Rows, nominal: Nominal) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return what the nominal's a6 and k1 leave of the increments of theta_dot (n - 1,), and their own two parts."""
    a6, k1 = nominal.vehicle.at(rows.t)
    step = np.diff(rows.t)
    parts = [0.5 * step * (x[1:] + x[:-1]) for x in (a6 * rows.attack, k1 * rows.beta)]
    return np.diff(rows.theta_dot) - parts[0] - parts[1], parts


def _spectrum(x: np.ndarray, rows: Rows, length: int) -> tuple[np.ndarray, int]:
    """Return the mean periodogram (length // 2 + 1,) of increments x (n - 1,) in segments that overlap by a half, none
    over a gap, and how many there are (Welch, IEEE Trans. Audio Electroacoustics 15, 1967)."""
    starts = [begin for first, last in rows.stretches for begin in range(first, last - length, length // 2)]
    if not starts:
        return np.zeros(length // 2 + 1), 0
    return np.mean(np.abs(np.fft.rfft(segments(x, starts, hann(length))))**2, axis=0), len(starts)


def _surroundings(power: np.ndarray, frequency: np.ndarray, count: int) -> np.ndarray:
    """Return what a spectrum (m,) has around each frequency: the median within AROUND, as the mean it belongs to."""
    reach = max(3 * OWN, round(AROUND / frequency[1]))
    out = np.full(len(power), math.inf)
    for k in range(1, len(power)):
        below, above = power[max(1, k - reach):max(1, k - OWN)], power[k + OWN + 1:k + reach + 1]
        if len(below) + len(above):
            out[k] = np.median(np.concatenate([below, above]))
    return out * _freedom(count) / quantile(0.5, _freedom(count))


def _freedom(count: int) -> float:
    """Return the degrees of freedom of the mean of so many periodograms that overlap."""
    return max(2.0 * OVERLAP * count, 2.0)
