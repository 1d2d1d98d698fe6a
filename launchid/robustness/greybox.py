"""Grey box: the range sigma of a6 and k1, fitted from flights.  First-principle model (the nominal) plus data.

Each log is identified with the nominal (`filtered`, windows of BIN seconds, each by its own data), which gives
relative deviations d_ib = a/a0 - 1 of flight i in bin b with standard deviations s_ib; and, weighted by 1/s^2, one
deviation d_i with s_i for the whole flight.

The range is a tolerance limit: with `confidence`, |d| <= sigma for at least a `share` of all vehicles, of which the
flights are a sample.  It is centred on the nominal, so the sum of squares about the nominal decides:

* order statistic, for n flights enough and noise below half of the variance: the r-th largest |d| of n with
  sum_{j<r} C(n, j) (1 - share)^j share^(n-j) <= 1 - confidence (`requirement.sequential`; 59 flights for
  95/95).  No law is assumed.  The noise is taken out by shrinking each d_i by tau/sqrt(tau^2 + s_i^2) towards the
  nominal, which keeps the spread of the ensemble right (Louis, JASA 79, 1984).
* normal, for fewer: sigma = z_((1+share)/2) sqrt(n S^2/chi2_(1-confidence; n) - s^2), S^2 = mean d_i^2,
  s^2 = mean s_i^2: Howe's factor (JASA 64, 1969) for a known mean, the estimates' variance taken out after the
  bound on the variance.  A mean off the nominal or a bounded law (the box) makes it larger than need be.

To both comes what the deviation does within a flight: w^2 = mean over bins of (d_ib - d_i)^2 (n_bins/(n_bins - 1))
- s_ib^2, added in quadrature to the normal's variance, and as z w in quadrature to the order statistic.

Over flight time (`profile`): the same in each bin of at least MIN_FLIGHTS flights whose noise is below half of the
spread; other bins take the constant range.
"""

import dataclasses
import math
from statistics import NormalDist

import numpy as np

from launchid_core import Config
from sim.errors import InputError
from sim.nominal import Nominal, Profile, constant_profile
from sim.onboard import onboard_model

from .. import chi_square
from ..identification.windows import run
from ..judge.line import undeclared_line
from ..log.check import CheckedLog
from ..monte_carlo.requirement.sequential import wilks_rank
from .level import UNCERTAIN_PARAMETERS, require_cover

BIN = 10.0          # s: long enough for a window's own data to say something of a6 and k1 in a calm flight
MIN_FLIGHTS = 10    # of a bin: below it the normal's factor is above 3.1
FEWEST_FLIGHTS = 3  # that show a spread: of two its standard deviation is as large as itself
MIN_SIGMA = 1.0e-3  # sigma: a range of 0 is none
MOST_NOISE = 0.5    # share of the variance of a bin's deviations that may be the estimates' own
ROWS_LEAST = 20     # of a log


@dataclasses.dataclass(frozen=True, eq=False)
class Deviations:
    """Deviations a/a0 - 1 of one flight from the nominal: value, std (b, 2) of (a6, k1), NaN where a window at t (b,)
    [s] does not identify them; span = first and last time [s] of the log."""

    path: str
    span: tuple[float, float]  # s, first and last time of the log
    t: np.ndarray      # (b,) s, centres
    value: np.ndarray  # (b, 2)
    std: np.ndarray    # (b, 2)


@dataclasses.dataclass(frozen=True)
class Range:
    """Fitted range `sigma` of a6 or k1, relative to the nominal.  spread (of vehicles), within (a flight) and noise are
    rms; held = share of the fitted flights inside; method = "order statistic" or "normal"."""

    sigma: float
    method: str        # `order statistic` or `normal`
    spread: float      # root mean square of the vehicles' deviations, noise taken out
    within: float      # root mean square of what a deviation does within a flight
    noise: float       # root mean square of the flights' standard deviations
    held: float        # share of these flights whose deviation is inside


@dataclasses.dataclass(frozen=True, eq=False)
class Fit:
    """Ranges fitted from `flights` flights: one each for a6, k1, and `profile`, sigma over flight time, or None."""

    flights: int
    share: float
    confidence: float
    ranges: tuple[Range, ...]
    profile: Profile | None


def deviations(seen: CheckedLog, nominal: Nominal) -> Deviations:
    """Identify a log with the nominal, in windows of BIN s; InputError if it is too short, has a mode that the nominal
    does not declare, or no window has a6 or k1."""
    log, mode = seen.estimated, undeclared_line(seen, nominal)
    if mode is not None:
        raise InputError(f"{log.path}: {mode.words}")
    model = onboard_model(nominal, log.period, log.path)
    require_cover(log, nominal, nominal.vehicle, "vehicle")
    first, last = log.span()
    rows = math.floor(min(BIN, last - first + log.period) / log.period + 1e-6)
    if rows < ROWS_LEAST:
        raise InputError(f"{log.path}: {rows} rows; expected at least {ROWS_LEAST} for a flight")
    config = Config(window=rows * log.period, sample_period=log.period, formulation="filtered", model=model,
                    max_gap=seen.bridged or None)
    estimates, _ = run(config, log.rows())
    centre = np.array([0.5 * (e.t_start + e.t_end) for e in estimates])
    believed = np.stack(nominal.vehicle.at(centre), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):  # a nominal of 0 has no relative deviation
        value = np.array([[e.a6, e.k1] for e in estimates]).reshape(-1, 2) / believed - 1.0
        std = np.array([[e.a6_std, e.k1_std] for e in estimates]).reshape(-1, 2) / np.abs(believed)
    in_log = (first <= centre) & (centre <= last)  # a bad stamp opens a window at no time of the log
    good = np.isfinite(value) & np.isfinite(std) & (std > 0.0) & in_log[:, None]
    if not good.any(axis=0).all():
        raise InputError(f"{log.path}: a6 and k1 cannot be identified in any window of {config.window:g} s; "
                         "expected a flight with manoeuvres")
    value, std = np.where(good, value, np.nan), np.where(good, std, np.nan)
    return Deviations(log.path, (first, last), centre[in_log], value[in_log], std[in_log])


def pooled(value: np.ndarray, std: np.ndarray) -> tuple[float, float]:
    """Return the mean of value (b,) weighted by 1/std^2, and its standard deviation; NaN are left out."""
    weight = 1.0 / std**2
    total = float(np.nansum(weight))
    return float(np.nansum(weight * value)) / total, 1.0 / math.sqrt(total)


def fit_range(value: np.ndarray, std: np.ndarray, within: float, share: float, confidence: float) -> Range:
    """Fit the range of a6 or k1 that holds `share` of vehicles with `confidence`, from the deviations of n flights,
    value (n,) with std (n,), and their rms `within` a flight."""
    n = len(value)
    noise = float(np.mean(std**2))
    spread = max(float(np.mean(value**2)) - noise, 0.0)
    z = NormalDist().inv_cdf(0.5 * (1.0 + share))
    rank = wilks_rank(n, share, confidence)
    ordered = rank > 0 and noise <= MOST_NOISE * (spread + noise)
    if ordered:
        shrunk = np.abs(value) * np.sqrt(spread / (spread + std**2))
        sigma = math.hypot(float(np.sort(shrunk)[-rank]), z * within)
    else:
        bound = n * float(np.mean(value**2)) / chi_square.quantile(1.0 - confidence, n) - noise
        sigma = z * math.sqrt(max(bound, noise / n) + within**2)
    sigma = max(sigma, MIN_SIGMA)
    return Range(sigma, "order statistic" if ordered else "normal", math.sqrt(spread), within, math.sqrt(noise),
                 float(np.mean(np.abs(value) <= sigma)))


def spread_within(flights: list[Deviations], p: int) -> float:
    """Return the rms by which the deviation of parameter p (0 a6, 1 k1) varies within a flight, noise taken out."""
    total, count = 0.0, 0
    for flight in flights:
        good = np.isfinite(flight.value[:, p])
        value, std = flight.value[good, p], flight.std[good, p]
        mean, mean_std = pooled(value, std)
        known = std**2 <= np.median(std**2)  # the better half: the others only add noise
        total += float(np.sum((value - mean)[known] ** 2 - np.maximum(std[known] ** 2 - mean_std**2, 0.0)))
        count += int(np.sum(known))
    return math.sqrt(max(total / max(count, 1), 0.0))


def fit(flights: list[Deviations], share: float, confidence: float, over_time: bool = False) -> Fit:
    """Fit the range of a6 and k1 that holds `share` of vehicles with `confidence`, from each flight's deviations.
    over_time: also sigma over flight time."""
    ranges = []
    for p in range(len(UNCERTAIN_PARAMETERS)):
        pairs = np.array([pooled(flight.value[:, p], flight.std[:, p]) for flight in flights])
        ranges.append(fit_range(pairs[:, 0], pairs[:, 1], spread_within(flights, p), share, confidence))
    profile = range_profile(flights, ranges, share, confidence) if over_time else None
    return Fit(len(flights), share, confidence, tuple(ranges), profile)


def range_profile(flights: list[Deviations], ranges: list[Range], share: float, confidence: float) -> Profile:
    """Return sigma of a6, k1 over flight time: nodes at the centres of bins of BIN s and at both ends of the
    flights."""
    first, last = min(flight.span[0] for flight in flights), max(flight.span[1] for flight in flights)
    bins = max(1, math.floor((last - first) / BIN + 0.5))
    t = first + BIN * (0.5 + np.arange(bins))
    sigma = np.empty((2, bins))
    for p in range(2):
        sigma[p] = ranges[p].sigma
        for b in range(bins):
            rows = [(f.value[k, p], f.std[k, p]) for f in flights for k in range(len(f.t))
                    if abs(f.t[k] - t[b]) <= 0.5 * BIN and np.isfinite(f.value[k, p])]
            value, std = np.array(rows).reshape(-1, 2).T
            if len(value) >= MIN_FLIGHTS and np.mean(std**2) <= MOST_NOISE * np.mean(value**2):
                sigma[p, b] = fit_range(value, std, 0.0, share, confidence).sigma
    nodes = np.concatenate([[first], t[(first < t) & (t < last)], [last]])
    return Profile(nodes, np.interp(nodes, t, sigma[0]), np.interp(nodes, t, sigma[1]))


def with_range(nominal: Nominal, result: Fit) -> Nominal:
    """Return the nominal with [uncertainty] replaced by the fit's profile, or by its constant ranges if it has none."""
    sigma = result.profile or constant_profile(*(r.sigma for r in result.ranges))
    return dataclasses.replace(nominal, uncertainty=sigma)


def factor(result: Fit) -> float:
    """Return the normal method's range over the rms deviation of as many flights, without noise; it falls with
    flights."""
    degrees = chi_square.quantile(1.0 - result.confidence, result.flights)
    return NormalDist().inv_cdf(0.5 * (1.0 + result.share)) * math.sqrt(result.flights / degrees)


def table(result: Fit, out: str) -> str:
    """Return the fit as text for a terminal; `out` names the file that it begins with."""
    few = result.flights < FEWEST_FLIGHTS
    flights = "1 flight" if result.flights == 1 else f"{result.flights} flights"
    lines = [f"{out}: range of {flights} that holds {100 * result.share:g} % of vehicles with confidence "
             f"{100 * result.confidence:g} %" + (f"; so few tell no spread: expected at least {FEWEST_FLIGHTS}"
                                                 if few else "")]
    for name, r in zip(UNCERTAIN_PARAMETERS, result.ranges, strict=True):
        lines.append(f"sigma_{name} = {r.sigma:.4g} ({r.method}); spread of the vehicles {r.spread:.3g}, "
                     f"within a flight {r.within:.3g}, noise {r.noise:.3g} rms"
                     + ("" if few else f"; {100 * r.held:.1f} % of these flights inside"))
    if result.flights < MIN_FLIGHTS:
        lines.append(f"few flights: the range is {factor(result):.1f} times their spread; more flights narrow it")
    if result.profile is not None:
        lines.append(f"{'t [s]':>8} {'sigma_a6':>9} {'sigma_k1':>9}")
        rows = zip(result.profile.t, result.profile.a6, result.profile.k1, strict=True)
        lines += [f"{t:>8.1f} {a:>9.4g} {k:>9.4g}" for t, a, k in rows]
    return "\n".join(lines)
