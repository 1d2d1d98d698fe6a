"""The frequency response of a flight as measured, with coherence and 95 % intervals, beside that of a nominal.

    beta -> theta_ddot, the airframe: k1 s^2 / (s^2 - a6);    beta_cmd -> beta, the servo behind its hold and delay

Welch's method: segments that overlap by half, each less its mean, times a Hann window w; cross spectra are means over
the segments.  Where the reference moves the loop, input, output and instrument are differenced twice before: their
relation stays, and a reference of ramps, whose steep spectrum leaks from a low frequency into those above it, becomes
pulses, whose spectrum is flat (prewhitening: Bendat and Piersol, ch. 11).  Where theta_ddot is not measured its
windowed transform follows from that of theta_dot, exactly and without a difference, by parts:

    F[w theta_ddot] = j omega F[w theta_dot] - F[w' theta_dot]

In closed loop what disturbs the output comes back to the input, and S_uy/S_uu is drawn from the response towards the
negative inverse of the controller, the more the weaker the coherence.  An instrument r, which no disturbance reaches,
takes that away: S_ry/S_ru.  It is the nominal's test input where one flies, else the attitude's reference; without
either the estimate is the first one and is said to be biased.

The residual e = y - H u has S_ee = S_yy - 2 Re(H* S_uy) + |H|^2 S_uu; of n segments that are worth independent ones

    var |H| / |H|^2 = var arg H = S_ee / (2 n |H|^2 S_uu g^2),   g^2 = |S_ru|^2 / (S_rr S_uu)  (1 where r is u)

which for r = u is (1 - coherence) / (2 n coherence).

References
----------
J. S. Bendat, A. G. Piersol, Random Data, 4th ed., Wiley, 2010, ch. 9 and 11: coherence, random errors.
M. B. Tischler, R. K. Remple, Aircraft and Rotorcraft System Identification, 2nd ed., AIAA, 2012, ch. 5, 7 and 8:
frequency responses of flight data, closed-loop bias, coherence above 0.6 as the mark of what can be used.
P. D. Welch, IEEE Trans. Audio Electroacoust. 15 (1967) 70: overlapped segments.  L. Ljung, System Identification,
2nd ed., ch. 13.5: instruments in closed loop.
"""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sim.effects import values
from sim.nominal import Nominal
from sim.plant import packed, parameters

from ..log.log import Log
from ..series import filled
from ..spectra import hann, segments

WANTED_SEGMENTS = 8     # lengths of a segment that a log holds, at least
LONGEST = 10.0          # s, of a segment: a6 and k1 are frozen in its middle
SHORTEST_SEGMENT = 2.0  # s
MIN_SEGMENTS = 4        # segments that have a spread
LOBE = 2.0              # bins, of the Hann window's main lobe to each side
FIRST_BIN = 2           # below, the window does not tell a frequency from a mean
NYQUIST_SHARE = 0.8     # of half the sampling rate that is shown
SERVO_TIMES = 3.0       # of the servo's frequency: beyond it nothing answers
MEASURED_SHARE = 0.98   # of a segment's rows that are measured; the rest lies on lines
HANN_OVERLAP = 1.0 / 36.0   # squared correlation of neighbouring Hann segments that overlap by half (Welch 1967)
MOVING_VARIANCE = 1e-9  # of an instrument's variance over its mean square: less is a constant
COHERENT = 0.6          # that a frequency is usable from (Tischler and Remple)
DECIBEL = 20.0 / math.log(10.0)   # of a relative change
BIASED = "in closed loop it is drawn towards the controller's inverse, the more the lower the coherence"
PREWHITENED = 2         # differences of a loop that a reference of ramps moves
PAIRS = (("beta", "theta_ddot"), ("beta_cmd", "beta"))


class Spectra(NamedTuple):
    """Windowed transforms of input u, output y and instrument r, (segments, bins) each, at frequency (bins,) [Hz];
    middles (segments,) [s] of the segments; resolution [Hz]: one over their length."""

    frequency: np.ndarray
    u: np.ndarray
    y: np.ndarray
    r: np.ndarray
    middles: np.ndarray
    resolution: float


class Response(NamedTuple):
    """A frequency response as measured, and the nominal's; arrays over frequency [Hz].

    source, to   names of input and output;  instrument: "test_input", "theta_ref", or None: the input itself
    gain, nominal   complex response, measured and of the nominal
    std          of the measured gain, relative, which is that of its phase [rad] too
    coherence    of input and output; with an instrument the smaller one of instrument and input, instrument and output
    """

    source: str
    to: str
    instrument: str | None
    frequency: np.ndarray
    gain: np.ndarray
    std: np.ndarray
    coherence: np.ndarray
    nominal: np.ndarray


def frequency_responses(log: Log, nominal: Nominal) -> list[Response]:
    """Return a response for each of PAIRS that the log has columns, rows and motion for: one with the instrument, if
    there is one, and one of the input itself."""
    made = []
    name, series = instrument(log, nominal)
    order = PREWHITENED if name == "theta_ref" else 0
    lines = () if nominal.test_input is None else tuple(np.asarray(nominal.test_input.frequency) / (2.0 * np.pi))
    ways = ((name, series), (None, None)) if name is not None else ((None, None),)
    for (source, to), (name, series) in itertools.product(PAIRS, ways):
        spectra = transforms(log, source, to, series, order, lines)
        if spectra is None:
            continue
        gain, std, coherence = estimated(spectra)
        top = NYQUIST_SHARE / (2.0 * log.period)
        if nominal.actuator is not None:
            top = min(top, SERVO_TIMES * nominal.actuator.frequency / (2.0 * np.pi))
        kept = np.flatnonzero((spectra.frequency <= top) & np.isfinite(gain))
        kept = kept[spectra.frequency[kept] >= FIRST_BIN * spectra.resolution]
        if len(kept):
            believed = of_nominal(spectra, nominal, (source, to), min(
                [log.period, *([nominal.controller.period] if nominal.controller is not None else [])]))
            made.append(Response(source, to, name, *(x[kept] for x in (spectra.frequency, gain, std, coherence,
                                                                       believed))))
    return made


def instrument(log: Log, nominal: Nominal) -> tuple[str | None, np.ndarray | None]:
    """Return (name, values (n,)) of what moves the loop from outside, test input or reference; else (None, None)."""
    t = np.where(np.isfinite(log.t), log.t, -1.0)
    test = np.zeros(len(t)) if nominal.test_input is None else nominal.test_input.at(t)
    for name, series in (("test_input", test), ("theta_ref", log.theta_ref)):
        known = series[np.isfinite(series)]
        if len(known) and np.var(known) > MOVING_VARIANCE * np.mean(known**2):
            return name, series
    return None, None


def transforms(log: Log, source: str, to: str, series: np.ndarray | None, order: int = 0,
               lines: Sequence[float] = ()) -> Spectra | None:
    """Return windowed transforms of the log's segments in which at least MEASURED_SHARE of the rows are measured; None
    if they are fewer than MIN_SEGMENTS.

    source, to   columns of input and output;  theta_ddot is made of theta_dot if it is not measured
    series       (n,) the instrument; None: the input;  order: how often all are differenced before
    lines        [Hz] frequencies of sines in the test input
    """
    if to == "theta_ddot" and not np.isfinite(log.theta_ddot).any():
        to = "theta_dot"
    usable = np.isfinite(log.t)
    t, period = log.t[usable], log.period
    if len(t) < 2 or np.any(np.diff(t) <= 0.0):
        return None
    rows = round(min(LONGEST, max(SHORTEST_SEGMENT, (t[-1] - t[0]) / WANTED_SEGMENTS)) / period)
    grid = t[0] + period * np.arange(round((t[-1] - t[0]) / period) + 1)
    nearest = np.clip(np.searchsorted(t, grid - 0.5 * period), 0, len(t) - 1)
    columns = np.stack([getattr(log, source), getattr(log, to), getattr(log, source) if series is None else series])
    on_grid = np.where(np.abs(t[nearest] - grid) < 0.5 * period, columns[:, usable][:, nearest], np.nan)
    there = np.asarray(np.isfinite(on_grid).all(axis=0))
    if not there.any():
        return None
    on_grid = np.stack([filled(x, grid, there) for x in on_grid])
    on_grid, there = np.diff(on_grid, n=order, axis=1), there[order:]
    starts = [k for k in range(0, len(there) - rows + 1, max(1, rows // 2))
              if np.mean(there[k:k + rows]) >= MEASURED_SHARE]
    if len(starts) < MIN_SEGMENTS or rows < 4 * FIRST_BIN:
        return None
    angle = 2.0 * np.pi * np.arange(rows) / rows
    slope = np.pi / (rows * period) * np.sin(angle)   # of the window
    frequency = frequencies(np.asarray(lines, dtype=float), rows, period)
    basis = np.exp(-2j * np.pi * np.outer(period * np.arange(rows), frequency))
    u, y, r = segments(on_grid, starts, hann(rows)) @ basis
    if to == "theta_dot":
        y = 2j * np.pi * frequency * y - segments(on_grid[1], starts, slope) @ basis
    return Spectra(frequency, u, y, r, grid[starts] + 0.5 * (rows + order) * period, 1.0 / (rows * period))


def frequencies(lines: np.ndarray, rows: int, period: float) -> np.ndarray:
    """Return the frequencies (bins,) [Hz] of a segment of `rows` at which a response is estimated, ascending.

    Those of its whole periods; near a line (sine of the input, `lines` [Hz]) the window shows the line's response, so
    the line's own frequency replaces those within its main lobe, if no other line is as near.
    """
    bins, lobe = np.fft.rfftfreq(rows, period), LOBE / (rows * period)
    apart = np.array([line for k, line in enumerate(lines) if np.all(np.abs(np.delete(lines, k) - line) >= lobe)])
    return np.sort(np.concatenate([bins[np.all(np.abs(bins[:, None] - apart) >= lobe, axis=1)], apart]))


def estimated(of: Spectra) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return complex gain, its relative standard deviation, and coherence, (bins,) each, from the transforms."""
    def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.asarray(np.mean(np.conj(a) * b, axis=0))

    segments = len(of.u)
    n = segments / (1.0 + 2.0 * HANN_OVERLAP * (segments - 1) / segments)
    uu, yy, rr = (cross(x, x).real for x in (of.u, of.y, of.r))
    ru, ry, uy = cross(of.r, of.u), cross(of.r, of.y), cross(of.u, of.y)
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = ry / ru
        residual = yy - 2.0 * (np.conj(gain) * uy).real + np.abs(gain)**2 * uu
        residual *= n / (n - 1.0)    # one complex number was fitted
        reach = np.abs(ru)**2 / (rr * uu)
        std = np.sqrt(residual / (2.0 * n * np.abs(gain)**2 * uu * reach))
        coherence = np.minimum(np.abs(ry)**2 / (rr * yy), reach)
    return gain, std, coherence


# ---- the nominal's


def of_nominal(of: Spectra, nominal: Nominal, pair: tuple[str, str], hold: float) -> np.ndarray:
    """Return the nominal's response (bins,): that of frozen a6 and k1 in each segment's middle, averaged with the
    weights of the estimate, each segment's cross spectrum of instrument and input.  hold: [s] of a command."""
    if pair[1] == "beta":
        return servo(nominal, of.frequency, hold)
    a6, k1 = parameters(nominal, of.middles)
    each = airframe(nominal, a6[:, None], k1[:, None], of.frequency)
    weight = np.conj(of.r) * of.u
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.sum(weight * each, axis=0) / np.sum(weight, axis=0))


def airframe(nominal: Nominal, a6: np.ndarray, k1: np.ndarray, frequency: np.ndarray) -> np.ndarray:
    """Return the response beta -> theta_ddot at frequencies [Hz] for frozen a6 and k1 [1/s^2], with damping, sloshing
    masses and nozzle inertia of the nominal's effects; its other effects are not in it."""
    s, changes = 2j * np.pi * frequency, packed(nominal)
    top, bottom = k1 + changes.nozzle_inertia * s**2, s**2 + changes.aero_damping * s - a6
    for effect in nominal.effects:
        if effect.name == "slosh":
            has = {name: float(x) for name, x in values(effect).items()}
            w = has["frequency"]
            bottom = bottom + s**2 * has["coupling"] * w**2 / (s**2 + 2.0 * has["damping_ratio"] * w * s + w**2)
    return np.asarray(s**2 * top / bottom)


def servo(nominal: Nominal, frequency: np.ndarray, hold: float) -> np.ndarray:
    """Return the response beta_cmd -> beta at frequencies [Hz], of a command held over `hold` [s] and a nozzle that is
    read when the next one is issued: the sampled servo, exactly; NaN if the nominal has no actuator.

    A command waits `whole` holds and a part of one; in each hold the older command acts first, for that part.
    """
    actuator = nominal.actuator
    if actuator is None:
        return np.full(len(frequency), np.nan, complex)
    changes = packed(nominal)
    delay = actuator.delay + changes.actuator_delay
    w = actuator.frequency * math.prod(scale for scale, _ in changes.bandwidths)
    poles = np.array([-w]) if actuator.is_first_order else np.roots([1.0, 2.0 * actuator.damping_ratio * w, w * w])
    if len(poles) == 2 and poles[0] == poles[1]:
        poles = poles * np.array([1.0 - 1e-6, 1.0 + 1e-6])   # residues of a double pole, to twelve digits
    residues = np.array([w]) if actuator.is_first_order else w * w / np.array([poles[0] - poles[1],
                                                                               poles[1] - poles[0]])
    whole = int(delay / hold + 1e-9)
    part = max(0.0, delay - whole * hold)
    z = np.exp(2j * np.pi * frequency * hold)[:, None]
    newer, older = (np.exp(poles * (hold - part)) - 1.0) / poles, \
        np.exp(poles * (hold - part)) * (np.exp(poles * part) - 1.0) / poles
    modes = residues * (newer + older / z) / (z - np.exp(poles * hold))
    return np.asarray(changes.actuator_gain * modes.sum(axis=1) * z[:, 0]**-whole)


def decibels_and_degrees(of: Response) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return gain [dB] and phase [deg] as measured, then of the nominal, (bins,) each.  Phases have no jumps; the
    nominal's begins in -270 to 90, the measured one near it, and it follows itself where it is coherent."""
    believed = np.where(np.isfinite(of.nominal), of.nominal, 1.0)
    lost, usable = ~np.isfinite(of.nominal), of.coherence > COHERENT
    phase = np.degrees(np.unwrap(np.angle(believed)))
    phase -= 360.0 * np.ceil((phase[0] - 90.0) / 360.0)
    off = np.angle(of.gain / believed)
    off[usable] = np.unwrap(off[usable])
    return (DECIBEL * np.log(np.abs(of.gain)), phase + np.degrees(off),
            np.where(lost, np.nan, DECIBEL * np.log(np.abs(believed))), np.where(lost, np.nan, phase))
