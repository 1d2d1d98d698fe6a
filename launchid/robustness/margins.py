"""Classical margins of the discrete loop, cut at the controller's output: at one or many delta, or the worst of a box.

The loop gain L(z) is the sampled one (`lft.loop_gain`, `loops.Loops.gain`), so the hold, the sampling and the delay are
in it exactly.
The closed loop has a root on the unit circle at gain factor g exactly where 1 + g L = 0.

Two gain margins.  The plant is unstable (a6 > 0): cut the feedback and the launcher falls over, so the gain may
neither rise nor fall too far.  At z = 1 the hold keeps the plant's static gain -k1/a6, L(1) = kp k1/a6, and the loop
is lost when g kp |k1| no longer beats a6: the low-frequency (aerodynamic) margin, g = -a6/(kp k1) < 1.  At the upper
phase crossover actuator, hold and delay have eaten the controller's lead: the high-frequency margin, g > 1
(Greensite, Analysis and Design of Space Vehicle Flight Control Systems, NASA CR-820 ff., 1967-68).  The loop is stable
for all g between the two and at neither.  A stable plant (a6 < 0) may lose the feedback: its low margin is 0.

Limitation: crossings are bracketed on a frequency grid; two within one step (5 %, or 0.3 rad of phase) are not seen.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from sim.nominal import Nominal

from .blocks import peaks_of
from .lft import Lft, Sampled, lft_at, sample, spectral_radius
from .loops import Loops

LOWEST = 1e-5          # of half the sampling rate: where the frequency grid starts
LOG_POINTS = 240       # 5 % apart
PHASE_STEP = 0.3       # rad a linear step may turn the delay, the hold and the filter
NEAR_PEAK = np.geomspace(1e-4, 0.05, 24)  # relative distances of the grid from a mode's frequency
LAG_PERIODS = 3.0      # periods of lag beside the delay
SECANTS = 10           # of a bracket 5 % wide, where L is all but straight: to rounding
ZOOMS = 6              # of the modulus margin's minimum
ZOOM_POINTS = 17       # a zoom
BOX_POINTS = 5         # to a side, of the worst case over a box
BOX_ZOOMS = 2          # of it


class Margins(NamedTuple):
    """Margins of m loops, arrays (m,): gain as factor below (low) and above 1 (high), phase [rad], delay [s], modulus =
    least |1 + L|.  NaN where the loop is unstable; inf where nothing limits it."""

    stable: np.ndarray       # bool: every eigenvalue of the closed loop inside the unit circle
    gain_low: np.ndarray     # the factor the loop gain may fall to, below 1; 0 if it may vanish
    gain_high: np.ndarray    # the factor it may rise to, above 1
    phase: np.ndarray        # rad, the least over the gain crossovers, either sign
    delay: np.ndarray        # s, the least lag/omega over the gain crossovers
    modulus: np.ndarray      # least |1 + L|; its inverse is the largest sensitivity

    @property
    def phase_deg(self) -> np.ndarray:
        return np.degrees(self.phase)

    @property
    def gain_low_db(self) -> np.ndarray:
        with np.errstate(divide="ignore"):
            return 20.0 * np.log10(self.gain_low)

    @property
    def gain_high_db(self) -> np.ndarray:
        return 20.0 * np.log10(self.gain_high)


def frequency_grid(period: float, delay: float, peaks: Sequence[float] = ()) -> np.ndarray:
    """Return increasing omega [rad/s] from near 0 to half the sampling rate, dense enough for a delay [s], and around
    the peaks [rad/s] of modes."""
    top = math.pi / period
    linear = math.ceil(math.pi * (delay / period + LAG_PERIODS) / PHASE_STEP)
    omega = np.union1d(np.geomspace(LOWEST * top, top, LOG_POINTS), np.linspace(0.0, top, linear + 1)[1:])
    near = np.concatenate([peak * np.exp(sign * NEAR_PEAK) for peak in peaks for sign in (-1.0, 1.0)] or [np.zeros(0)])
    return np.union1d(omega, near[near < top]) if len(near) else omega


def crossings(loop: Sampled | Loops, f: Callable[[np.ndarray], np.ndarray], omega: np.ndarray,
              gain: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find where f(L) changes sign along the grid, by the Illinois secant (Dowell and Jarratt, BIT 11, 1971).

    loop   m loops;  omega (p,), or of each loop (m, p), [rad/s] the grid;  gain (m, p) L on it
    f      L -> real, sign-changing at the crossing
    Return for k crossings: the loop's number (k,), omega (k,) [rad/s], L there (k,).
    """
    value = f(gain)
    above = value > 0.0
    which, place = np.nonzero(above[:, 1:] != above[:, :-1])
    if len(which) == 0:
        return which, np.zeros(0), np.zeros(0, complex)
    low, high = at_index(omega, which, place), at_index(omega, which, place + 1)
    f_low, f_high = value[which, place], value[which, place + 1]
    loops, least = loop.take(which), np.minimum(np.abs(f_low), np.abs(f_high))
    at, f_at, kept = low, f_low, np.zeros(len(which))  # which end the last point replaced
    for _ in range(SECANTS):
        apart = f_low - f_high
        at = low + f_low / np.where(apart == 0.0, np.inf, apart) * (high - low)
        f_at = f(loops.gain(at[:, None])[:, 0])
        is_low = (f_at > 0.0) == (f_low > 0.0)
        f_low = np.where(is_low, f_at, np.where(kept == -1.0, 0.5 * f_low, f_low))
        f_high = np.where(is_low, np.where(kept == 1.0, 0.5 * f_high, f_high), f_at)
        low, high, kept = np.where(is_low, at, low), np.where(is_low, high, at), np.where(is_low, 1.0, -1.0)
    met = np.abs(f_at) <= least  # else the sign changed through infinity, at a pole on the circle
    return which[met], at[met], loops.gain(at[:, None])[met, 0]


def at_index(omega: np.ndarray, which: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return the frequencies [rad/s] at places (k,) of the grid, which is the same for all loops or each its own."""
    return omega[place] if omega.ndim == 1 else omega[which, place]


def margins(lft: Lft, delta: np.ndarray | tuple[float, float] = (0.0, 0.0)) -> Margins:
    """Return the margins of the loop at each delta (m, 2) or (2,), any real, in sigma of a6 and k1."""
    delta = np.atleast_2d(np.asarray(delta, dtype=float))
    static, peaks = lft.static(delta), peaks_of(lft.plant, lft.law)
    loop, omega = sample(lft, delta), frequency_grid(lft.period, lft.delay, peaks)
    stable, gain = spectral_radius(loop) < 1.0, loop.gain(omega)
    low, high = gain_margins(loop, omega, gain, static)
    phase, delay = phase_margins(loop, omega, gain)
    modulus = modulus_margin(loop, omega, gain)
    return Margins(stable, *(np.where(stable, x, np.nan) for x in (low, high, phase, delay, modulus)))


def gain_margins(loop: Sampled | Loops, omega: np.ndarray, gain: np.ndarray,
                  static: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the gain factors g (m,) next below and above 1 at which 1 + g L = 0 (L real): 0 and inf if there are none.

    omega (p,) [rad/s];  gain (m, p) L on it;  static (m,) the factor at z = 1"""
    inside = slice(0, -1)    # the last frequency is z = -1, where L is real
    which, _, at = crossings(loop, np.imag, omega[..., inside], gain[:, inside])
    with np.errstate(divide="ignore", invalid="ignore"):
        alternating, between = -1.0 / gain[:, -1].real, -1.0 / at.real
    every = np.arange(len(gain))
    which = np.concatenate([every, every, which])
    factor = np.concatenate([static, alternating, between])
    low, high = np.zeros(len(gain)), np.full(len(gain), np.inf)
    falls, rises = factor < 1.0, factor > 1.0  # what is negative is below `low` as it stands
    np.maximum.at(low, which[falls], factor[falls])
    np.minimum.at(high, which[rises], factor[rises])
    return low, high


def phase_margins(loop: Sampled | Loops, omega: np.ndarray, gain: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least phase margin [rad] and delay margin [s] (m,) where |L| = 1; inf if it never is.  gain (m, p): L
    at omega (p,) [rad/s]."""
    which, at_omega, at = crossings(loop, lambda x: x.real**2 + x.imag**2 - 1.0, omega, gain)
    phase, delay = np.full(len(gain), np.inf), np.full(len(gain), np.inf)
    np.minimum.at(phase, which, np.abs(np.angle(-at)))
    np.minimum.at(delay, which, np.mod(np.angle(-at), 2.0 * math.pi) / at_omega)
    return phase, delay


def modulus_margin(loop: Sampled | Loops, omega: np.ndarray, gain: np.ndarray, zooms: int = ZOOMS,
                   distance_of: Callable[[np.ndarray], np.ndarray] = lambda x: np.abs(1.0 + x)) -> np.ndarray:
    """Return the least |1 + L| (m,), or another distance, sought around the least on the grid by grids that are 8 times
    as fine each.

    omega (p,) [rad/s];  gain (m, p) L on it;  zooms  each of which costs as much as ZOOM_POINTS of the grid
    """
    least = np.argmin(distance_of(gain), axis=1)
    every = np.arange(len(gain))
    low = at_index(omega, every, np.maximum(least - 1, 0))
    high = at_index(omega, every, np.minimum(least + 1, omega.shape[-1] - 1))
    for _ in range(zooms):
        points = np.linspace(low, high, ZOOM_POINTS, axis=-1)
        distance = distance_of(loop.gain(points))
        least = np.argmin(distance, axis=1)
        low = points[every, np.maximum(least - 1, 0)]
        high = points[every, np.minimum(least + 1, ZOOM_POINTS - 1)]
    return distance[every, least]


def disk_margin(loop: Sampled | Loops, omega: np.ndarray, gain: np.ndarray, zooms: int = ZOOMS) -> np.ndarray:
    """Return the symmetric disk margin (m,) = 2 min |1 + L|/|1 - L|, arguments as of `modulus_margin`: gain and phase
    may move at once, by any factor (1 + d/2)/(1 - d/2) with |d| below it (Seiler, Packard and Gahinet, IEEE Control
    Systems Magazine 40 (5), 2020, for the skew 0)."""
    return modulus_margin(loop, omega, gain, zooms,
                          lambda x: 2.0 * np.abs(1.0 + x) / np.maximum(np.abs(1.0 - x), 1e-300))


def worst_margins(lft: Lft, centre: tuple[float, float] = (0.0, 0.0),
                  radius: tuple[float, float] = (1.0, 1.0)) -> Margins:
    """Return the worst of each margin over the box centre +- radius of delta, arrays (1,).

    Vertices, edges and inside on a grid, then finer grids around each worst: exact where the worst is a vertex (the
    gain margins at these vehicles), else within the last grid's step.  NaN if a loop on the grid is unstable.
    """
    middle, half = np.asarray(centre, dtype=float), np.asarray(radius, dtype=float)
    low, high = middle - half, middle + half
    side = np.linspace(-1.0, 1.0, BOX_POINTS)
    pattern = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    delta = middle + half * pattern
    for zoom in range(BOX_ZOOMS + 1):
        corner = margins(lft, delta)
        if not corner.stable.all():
            return Margins(np.array([False]), *(np.array([np.nan]) for _ in range(5)))
        badness = (-corner.gain_low, corner.gain_high, corner.phase, corner.delay, corner.modulus)
        worst = delta[[int(np.argmin(x)) for x in badness]]
        best_of = Margins(np.array([True]), corner.gain_low.max(keepdims=True), *(
            x.min(keepdims=True) for x in badness[1:]))
        step = half * (2.0 / (BOX_POINTS - 1)) ** (zoom + 1)
        delta = np.unique(np.clip(worst[:, None] + step * pattern, low, high).reshape(-1, 2), axis=0)
    return best_of


def margins_over_time(nominal: Nominal, times: np.ndarray, centre: np.ndarray | tuple[float, float] = (0.0, 0.0),
                      radius: np.ndarray | tuple[float, float] = (1.0, 1.0)) -> Margins:
    """Return the worst margins (n,) at times (n,) [s] over the box centre +- radius of delta, each (2,) or (n, 2).

    The full box is what is known before identification; after it, centre and radius are the estimate and its
    half-width in delta.
    """
    times = np.asarray(times, dtype=float)
    centres, radii = (np.broadcast_to(np.asarray(x, dtype=float), (len(times), 2)) for x in (centre, radius))
    rows = [worst_margins(lft_at(nominal, float(t)), tuple(c), tuple(r))
            for t, c, r in zip(times, centres, radii, strict=True)]
    return Margins(*(np.concatenate(column) for column in zip(*rows, strict=True)))
