"""Begin with everything that is plausible: every usual number, the shapes that a scan finds, noise levels, air."""

import math

import numpy as np

from ..likelihood.estimate import Fit, evaluate, fit_levels, gauss_newton, log_likelihood
from ..sums import square
from .candidates import CANDIDATE_KINDS
from .elimination import RIVAL_SHARE
from .model import Model
from .noise import WEATHER
from .scan import SQUARES_PROMISED, Found, Scanner, scan, with_shape

SERVO_DELAYS = (0.008, 0.015, 0.025, 0.04, 0.07, 0.12)  # s, delays of a servo that are tried
SLOW_SERVOS = (0.6, 0.35, 0.2, 0.12)   # of its bandwidth, of a servo that are tried
FAR_LESS = 0.7         # of the squares that the nominal leaves, for a limited servo to be the start
WEATHER_NATS = 20.0    # nats by which weather must be better than causes,
CALMER = (0.3, 0.1, 0.03, 0.01)  # and than the moment that always wanders, so many times as large
MOST_SHAPES = 3        # shapes that are taken into a model


def everything(m: Model) -> tuple[Model, np.ndarray]:
    """Fit every usual number, the shapes that the scan finds and the noise levels; return the model and the numbers."""
    m, start = best_start(m) if m.log.is_commanded and m.log.is_flown else (m, best_delay(m))
    fit = gauss_newton(m, start, all_of(m), frozenset(), 3)
    m = fit_levels(m, fit.p)
    fit = gauss_newton(m, fit.p, fit.free, frozenset(), 3)
    m = fit_levels(m, fit.p)
    for k in range(MOST_SHAPES):
        windy = weather(m, fit) if k == 1 else m
        if windy is not m:
            fit = gauss_newton(windy, windy.table.null, all_of(windy), frozenset(), 3)
            m = fit_levels(windy, fit.p)
            fit = gauss_newton(m, fit.p, fit.free, frozenset(), 2)
        m, p = with_found(m, fit, fit.p, 2.0 * SQUARES_PROMISED)   # what promises less is sought later
        if len(p) == len(fit.p):
            break
        m, fit = with_levels(m, p)
    return without_weather(m, fit) if m.air.weather and m.shapes else (m, fit.p)


def with_levels(m: Model, p: np.ndarray) -> tuple[Model, Fit]:
    """Return the model with all numbers fitted from p, its noise levels fitted to what they leave, and the fit: what a
    shape explains is noise no longer."""
    fit = gauss_newton(m, p, all_of(m), frozenset(), 4)
    return fit_levels(m, fit.p, 2), fit


def all_of(m: Model) -> tuple[int, ...]:
    """Return the indices of all numbers."""
    return tuple(range(len(m.table)))


def without_weather(m: Model, fit: Fit) -> tuple[Model, np.ndarray]:
    """Return the model in calm air and its numbers, unless the weather still explains WEATHER_NATS more beside the
    shapes that were found since; else the model as it is, and the fit's."""
    calm = m.in_weather("")
    once = gauss_newton(calm, fit.p, fit.free, frozenset(), 3)
    calm = fit_levels(calm, once.p, 4)
    p = gauss_newton(calm, once.p, fit.free, frozenset(), 3).p
    is_calm = log_likelihood(calm, evaluate(calm, p)) + WEATHER_NATS > log_likelihood(m, evaluate(m, fit.p))
    return (calm, p) if is_calm else (m, fit.p)


def with_found(m: Model, fit: Fit, p: np.ndarray, least: float = 0.0) -> tuple[Model, np.ndarray]:
    """Return the model, settled on the fit's motion, with the one or two shapes added that promise most, and the
    numbers p with theirs; p itself if none does."""
    there = {shape.kind.name for shape in m.shapes if not shape.kind.once}
    m, promising = scan(m, fit)
    found = [each for each in promising if each.kind.name not in there]
    if found and found[0].saves > least:
        for each in [each for each in found if each.saves > RIVAL_SHARE * found[0].saves][:2]:
            m, p = with_shape(m, p, each)
    return m, p


def best_start(m: Model) -> tuple[Model, np.ndarray]:
    """Return the model and numbers to start from: with a shape, a delay, a slower servo or a trim where one leaves
    clearly less than none, for a servo so limited or so late, a mode that swings as far as the vehicle, or a vehicle
    that its trim has lost, is no small forcing of another."""
    null, at = m.table.null, m.table.index
    plain = square(evaluate(m, null).e)
    late = np.repeat(null[None], len(SERVO_DELAYS) + len(SLOW_SERVOS), axis=0)
    late[:len(SERVO_DELAYS), at("delay")] += SERVO_DELAYS
    late[len(SERVO_DELAYS):, at("bandwidth")] *= SLOW_SERVOS
    trim = gauss_newton(m, null, tuple(at(name) for name in ("misalignment",) if name in m.table))
    least, p = min(((square(evaluate(m, q).e), q) for q in (*late, trim.p)), key=lambda each: each[0])
    best, scanner = (m, p), Scanner(m, trim)
    for kind in (kind for kind in CANDIDATE_KINDS if kind.cause and kind.bounds and kind.fits(m) and kind.starts(m)):
        if kind.place == "actuator":
            found = [(m, null, Found(kind, values, np.ones(1), plain)) for values in kind.starts(m)]
        else:
            found = [(scanner.m, trim.p, each) for each in (scanner.best(kind),) if each is not None]
        for model, start, each in found:
            tried = with_shape(model, start, each)
            left = square(evaluate(*tried).e)
            if left < least:
                least, best = left, tried
    return best if least < FAR_LESS * plain else (m, null)


def weather(m: Model, fit: Fit) -> Model:
    """Return the model in the weather that explains more than everything else does, with the usual numbers within their
    tolerances; the model itself if none does.

    A walk begins at no disturbance, so what it saves of the moment that is taken to wander always is no weather's.
    """
    if not m.log.is_flown or m.air.is_windy or not m.log.is_unstable:
        return m
    walk = WEATHER["wind_walk"]
    calmer = [m.levels + math.log(share) * (np.arange(len(m.levels)) == walk) for share in CALMER]
    most = max(log_likelihood(each, evaluate(each, fit.p)) for each in (m, *map(m.with_levels, calmer))) + WEATHER_NATS
    plain, best = m.usual(), m
    band = frozenset(j for j, each in enumerate(plain.table.numbers) if each.tol > 0.0)
    for name in WEATHER:
        windy = plain.in_weather(name)
        alone = gauss_newton(windy, windy.table.null, tuple(sorted(band)), band, 2)
        fitted = fit_levels(windy, alone.p, 4)
        value = log_likelihood(fitted, evaluate(fitted, alone.p))
        if value > most:
            most, best = value, windy
    return best


def best_delay(m: Model) -> np.ndarray:
    """Return numbers to start a fit from: fitted at the best of a few delays; the nominal's for a flown log."""
    null = m.table.null
    if "delay" not in m.table or m.log.is_flown:
        return null
    row = m.log.period
    free = tuple(j for j, each in enumerate(m.table.numbers) if each.name not in (
        "delay", "lag", "washout", "bandwidth", "gyro_delay", "attitude_delay"))
    least, best = math.inf, null
    for delay in (0.0, *np.geomspace(max(0.01, 0.5 * row), max(0.15, 3.0 * row), 5)):
        q = null.copy()
        q[m.table.index("delay")] = delay
        fit = gauss_newton(m, q, free, frozenset(), 2)
        value = square(fit.e) * (1.0 if delay else FAR_LESS)
        if value < least:
            least, best = value, fit.p
    return best
