"""The log's own evidence against a window's answer, where no nominal gives any.

A window is refused (`MODEL`) where something that it lacks (`lacking`) is most of the error, or would move a
coefficient by more than its standard deviation and 2 %; numbers that it leaves where they are stand.  Windows
that could not tell a6 and k1 apart, or saw only noise, say what is missing instead.  A
beta between whose values a resampling drew lines is not known, nor is what it causes.  `filtered` judges itself.
"""

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from launchid_core import Config, Estimate, EstimateStatus

from ..log.log import Log
from ..log.rates import INTERPOLATED, OWN
from ..sums import combined, inner, least_squares, square
from .input_delay import Lead
from .missing_terms import TOLERANCE, Lack, Question, active_terms, is_moved, lacks, question
from .weak_form import Rows, thinned, usable, window_increments

WITHDRAWN = 20.0     # s before a contradiction: as long as the estimator takes to forget one
HELD_OUT = 3         # the last of so many parts of a window is held out for its `fit`
LEAST_HELD_OUT = 5   # increments without overlap in it: below, its share of the variance is chance
WEAK = 1.5           # of the least squares: coefficients that leave more are drawn off
LEAST_ALONE = 5      # increments of a window that is judged by itself
LAGS = 4             # of the portmanteau; even, for which its probability is elementary
LEAST_WHITE = 2 * LAGS
UNTOLD = (EstimateStatus.SEPARATION, EstimateStatus.LOW_INFORMATION)  # what something missing may look like


@dataclass(frozen=True)
class Fit:
    """Share of the variance of a window's last third that the rest predicts, and its whiteness; None: too short."""

    r2: float | None = None
    whiteness: float | None = None


def ljung_box(e: np.ndarray) -> float | None:
    """p-value of whiteness (Ljung & Box, Biometrika 65, 1978); None for too few."""
    n = len(e)
    e = e - e.mean() if n else e
    whole = square(e)
    if n < LEAST_WHITE or whole == 0.0:
        return None
    q = n * (n + 2) * sum((inner(e[k:], e[:-k]) / whole) ** 2 / (n - k) for k in range(1, LAGS + 1))
    return math.exp(-0.5 * q) * sum((0.5 * q) ** k / math.factorial(k) for k in range(LAGS // 2))


def held_out(rows: Rows, estimate: Estimate) -> Fit:
    """The fit of a window: how well its first two thirds predict its last third."""
    terms = active_terms(estimate)
    begin, end, y, phi = window_increments(rows, rows.cut(estimate.t_start, estimate.t_end), terms)
    split = estimate.t_end - (estimate.t_end - estimate.t_start) / HELD_OUT
    fitted, judged = end <= split, begin >= split
    if np.count_nonzero(judged) < (LEAST_HELD_OUT - 1) * rows.span or np.count_nonzero(fitted) <= len(terms):
        return Fit()
    xi = least_squares(phi[fitted], y[fitted])
    e, s = y[judged] - combined(phi[judged], xi), y[judged] - y[judged].mean()
    e = e - e.mean()  # of the variance: a steady moment is no contradiction
    return Fit(1.0 - square(e) / square(s), ljung_box(e[::rows.span])) if square(s) > 0.0 else Fit()


def refused(estimate: Estimate) -> Estimate:
    """The window without its numbers, which the log contradicts."""
    nan = math.nan
    xi, support = np.full_like(estimate.xi, math.nan), np.zeros_like(estimate.support)
    xi.flags.writeable = support.flags.writeable = False
    return dataclasses.replace(estimate, valid=False, status=EstimateStatus.MODEL, xi=xi, support=support, absent={},
                               terms_std={}, a6=nan, k1=nan, a6_std=nan, k1_std=nan, a6_k1_corr=nan, a6_dot=nan,
                               k1_dot=nan, a6_bound=nan, k1_bound=nan, condition=nan)


def withdrawn(estimates: list[Estimate]) -> list[Estimate]:
    """The estimates, without those that a contradiction of the model follows within WITHDRAWN s: what contradicts it
    was there before it was told, and the estimator could not know; a log that is whole can."""
    contradicted = [e.t_end for e in estimates if e.status == EstimateStatus.MODEL]
    followed = [any(0.0 < t - e.t_end <= WITHDRAWN for t in contradicted) for e in estimates]
    return [_without_air(refused(e) if e.valid else e) if no else e for e, no in zip(estimates, followed, strict=True)]


def _without_air(estimate: Estimate) -> Estimate:
    """The estimate without wind, offsets, servo and tracked estimate, as while the model is contradicted."""
    nan = math.nan
    tracked = estimate.tracked
    if tracked is not None:
        tracked = tracked._replace(valid=False, **dict.fromkeys(tracked._fields[1:], nan))
    servo = estimate.actuator
    if servo is not None:
        servo = {name: each._replace(value=nan, std=nan) for name, each in servo.items()}
    return dataclasses.replace(estimate, wind=nan, wind_std=nan, offsets={}, actuator=servo, tracked=tracked)


@dataclass(frozen=True, eq=False)
class Judged:
    """The estimates with those refused that the log contradicts, the fit of each, and what they were refused for."""

    estimates: list[Estimate]
    fits: list[Fit]
    lacks: list[Lack]


def judge(log: Log, config: Config, estimates: list[Estimate], lead: Lead | None = None,
          kind: str = OWN) -> Judged:
    """Judge the windows of a log (`filtered` judges itself: of it the fits alone).

    lead   `delay` of the log;  kind  of its beta, as `log.rates` tells it
    """
    rows = usable(log)
    if rows is None or not estimates:
        return Judged(estimates, [Fit() for _ in estimates], [])
    fits = [held_out(rows, e) if e.valid else Fit() for e in estimates]
    if config.formulation == "filtered":
        fits = [dataclasses.replace(fit, whiteness=e.whiteness if math.isfinite(e.whiteness) else None)
                for fit, e in zip(fits, estimates, strict=True)]
        return Judged(estimates, fits, [])
    if kind == INTERPOLATED:
        return Judged([refused(e) if e.valid else e for e in estimates], fits, [Lack(kind, math.nan, math.nan)])
    delayed = lead.significant() if lead is not None else None
    longest, fewer = max(e.t_end - e.t_start for e in estimates), thinned(rows)
    asked = None if fewer is None else question(fewer, asked_terms(config, estimates), delayed, longest)
    if fewer is None or asked is None:
        return Judged(estimates, fits, [])
    missing = lacks(asked, delayed)
    against = [_against(asked, e, missing) for e in estimates]
    said = {lack.what: lack for each in against for lack in each}
    judged = [refused(e) if each else e for e, each in zip(estimates, against, strict=True)]
    return Judged(judged, fits, list(said.values()))


def _against(asked: Question, e: Estimate, missing: list[Lack]) -> list[Lack]:
    """The lacks for which a window is refused."""
    if not e.valid:
        return missing if e.status in UNTOLD else []
    values = dict(zip(e.terms, e.xi[:, 1].tolist(), strict=True))
    answer = {term: (values[term], e.terms_std.get(term, 0.0)) for term in active_terms(e)}
    at = asked.rows.cut(e.t_start, e.t_end)
    drawn = drawn_off(asked.rows, e)
    return [*(lack for lack in missing if is_moved(asked, at, answer, lack)), *([drawn] if drawn is not None else [])]


def drawn_off(rows: Rows, e: Estimate) -> Lack | None:
    """A lack where other coefficients of a window's terms leave clearly less of its increments, and are more than its
    standard deviations and TOLERANCE away: noise in the columns, or something slow, has drawn its own off."""
    terms = active_terms(e)
    _, _, y, phi = window_increments(rows, rows.cut(e.t_start, e.t_end), terms)
    if len(y) < LEAST_ALONE * rows.span:
        return None
    given = np.asarray(e.xi[e.support[:, 1], 1])
    best = least_squares(phi, y)
    left, least, whole = (square(y - combined(phi, xi)) for xi in (given, best, 0.0 * best))
    off = any(abs(b - a) > max(e.terms_std.get(term, 0.0), TOLERANCE * abs(a))
              for term, a, b in zip(terms, given.tolist(), best.tolist(), strict=True))
    if not (left > WEAK * least and off and whole > 0.0):
        return None
    return Lack("coefficients", 1.0 - left / whole, 1.0 - least / whole)


def asked_terms(config: Config, estimates: list[Estimate]) -> tuple[str, ...]:
    """The terms that any valid window has, those of the library where none is; beta with them, whose placebo is asked
    for, if the library has it."""
    seen = {term for e in estimates if e.valid for term in active_terms(e)} or set(config.terms)
    return tuple(term for term in config.terms if term in seen or term == "beta")
