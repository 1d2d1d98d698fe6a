"""Estimate by the weak form, and judge, the windows of a log that no nominal judges."""

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from launchid_core import Config, Estimate, EstimateStatus

from ..log.check import CheckedLog
from ..log.rates import INTERPOLATED
from ..sums import combined, square
from .fit import SPAN, Fit, Prior, gls_of_all, least, least_squares_covariance, noise_likelihoods
from .judge import (
    INCREMENT,
    LACKING,
    PER_COEFFICIENT,
    RELATIVE_TOLERANCE,
    Lack,
    Late,
    Lead,
    Question,
    against,
    is_driving,
    late_input,
    lead_of,
    left_over,
    question,
    slopes_of,
    with_betas,
)
from .rows import Modes, Rows, increments, term_modes, usable

POOLED = 0.2         # of the likelihood of the noise's ratios in the whole log, that counts in each of its windows
ALIKE, VAGUE = 0.99, 0.3   # |correlation| of a6 and k1, relative deviations, beyond which they are not told apart
WORTH = 0.5          # of the largest term, that one standard deviation of the term of a6 or k1 may be
UNTRUE = 1.5         # times what its deviations say, that the spread of coefficients that stand still may be
UNLIKE = 1.0         # mean square of neighbours' differences over the variance, 2 of what is white, beyond which
#                      coefficients do not change but scatter
FEWEST_ALIKE = 6     # pieces, of which that is asked
CHANCE_DRIFT = 6.0   # chi square of two, 95 %: what a drift of a6 and k1 moves them by beyond is in the deviations
HELD_OUT_PARTS = 3   # the last of so many parts of a window is held out for its `fit`
LEAST_HELD_OUT = 5   # increments without overlap in it: below, its share of the variance is chance
AGREEMENT_SIGMAS = 2.0  # standard deviations of the weak form, within which another formulation agrees with it
CONTRADICTING_RATIO = 3.0  # times as large a deviation of the weak form contradicts that of another formulation
MOST_NUISANCES = 3   # that are fitted one after the other: a friction, a delay of beta, what is left of it
FRICTION, AT_REST = "sign(theta_dot)", "beta at rest"
WITHDRAWN_NATS = 20.0  # s before a contradiction: as long as the estimator takes to forget one
WEAK_STATUSES = (EstimateStatus.SEPARATION, EstimateStatus.LOW_INFORMATION)  # what something missing may look like


@dataclass(frozen=True)
class WindowFit:
    """Share of variance of a window's last third that the rest predicts, p-value of white residuals, or None."""

    r2: float | None = None
    whiteness: float | None = None


@dataclass(frozen=True, eq=False)
class Judged:
    """The windows as judged: estimates (refused if the log contradicts them), fit of each, lacks, when beta acts, what
    was not tested, the weak form's estimates before, terms that were tested."""

    estimates: list[Estimate]
    fits: list[WindowFit]
    lacks: list[Lack]
    lead: Lead | None = None
    late: Late | None = None
    unchecked: str = ""
    fitted: list[Estimate] = field(default_factory=list)
    terms: tuple[str, ...] = ()


def active_terms(estimate: Estimate) -> tuple[str, ...]:
    """Return the terms that the estimate has in its equation for theta_ddot."""
    return tuple(term for term, on in zip(estimate.terms, estimate.support[:, 1].tolist(), strict=True) if on)


def refused(estimate: Estimate, status: EstimateStatus = EstimateStatus.MODEL) -> Estimate:
    """Return the estimate as not valid, with this status and NaN for its numbers."""
    nan = math.nan
    xi, support = np.full_like(estimate.xi, nan), np.zeros_like(estimate.support)
    xi.flags.writeable = support.flags.writeable = False
    return replace(estimate, valid=False, status=status, xi=xi, support=support, absent={}, terms_std={},
                   a6=nan, k1=nan, a6_std=nan, k1_std=nan, a6_k1_corr=nan, a6_dot=nan, k1_dot=nan,
                   a6_bound=nan, k1_bound=nan, condition=nan)


def withdrawn(estimates: list[Estimate]) -> list[Estimate]:
    """Return the filter's estimates, refused where a contradiction of the model follows within WITHDRAWN_NATS s: its
    cause was there before the filter could tell."""
    contradicted = [e.t_end for e in estimates if e.status == EstimateStatus.MODEL]
    followed = [any(0.0 < t - e.t_end <= WITHDRAWN_NATS for t in contradicted) for e in estimates]
    return [_without_air(refused(e) if e.valid else e) if no else e for e, no in zip(estimates, followed, strict=True)]


def _without_air(estimate: Estimate) -> Estimate:
    """Return the estimate without wind, offsets, servo and tracked estimate, as while the model is contradicted."""
    nan, tracked, servo = math.nan, estimate.tracked, estimate.actuator
    if tracked is not None:
        tracked = tracked._replace(valid=False, **dict.fromkeys(tracked._fields[1:], nan))
    if servo is not None:
        servo = {name: each._replace(value=nan, std=nan) for name, each in servo.items()}
    return replace(estimate, wind=nan, wind_std=nan, offsets={}, actuator=servo, tracked=tracked)


def disbelieved(estimate: Estimate) -> Estimate:
    """Return the estimate refused and without any number, for a log whose columns are not what their names say."""
    return replace(_without_air(refused(estimate)), uncertainty=None)


def held_out(rows: Rows, estimate: Estimate, whiteness: float | None) -> WindowFit:
    """Return how well a window's first two thirds predict its last third; `whiteness` is passed on."""
    terms = active_terms(estimate)
    part = rows.part(rows.cut(estimate.t_start, estimate.t_end))
    span = max(1, round(INCREMENT / rows.period))
    split = estimate.t_end - (estimate.t_end - estimate.t_start) / HELD_OUT_PARTS
    if np.count_nonzero(part.t >= split) - span < (LEAST_HELD_OUT - 1) * span:
        return WindowFit(None, whiteness)
    begin, end, y, phi = increments(part, terms, INCREMENT)
    fitted, judged = end <= split, begin >= split
    if np.count_nonzero(judged) < (LEAST_HELD_OUT - 1) * span or np.count_nonzero(fitted) <= len(terms):
        return WindowFit(None, whiteness)
    xi = least(phi[fitted], y[fitted])
    e, s = y[judged] - combined(phi[judged], xi), y[judged] - y[judged].mean()
    e = e - e.mean()  # of the variance: a steady moment is no contradiction
    return WindowFit(1.0 - square(e) / square(s), whiteness) if square(s) > 0.0 else WindowFit(None, whiteness)


def judged_windows(seen: CheckedLog, config: Config, estimates: list[Estimate], is_weak: bool,
                   optional: tuple[str, ...] = ()) -> Judged:
    """Test the numbers of each window on the whole log, and refuse those that it contradicts.

    is_weak   replace the numbers of the estimates by those of the weak form; only their windows are used
    optional  terms that the answer has too where their coefficient exceeds its deviation
    """
    if config.formulation == "filtered":   # it judges itself: of it the fits alone
        rows = usable(seen)
        fits = [held_out(rows, e, e.whiteness if math.isfinite(e.whiteness) else None)
                if rows is not None and e.valid else WindowFit() for e in estimates]
        return Judged(estimates, fits, [])
    if seen.rates["beta"].kind == INTERPOLATED:
        return Judged([refused(e) for e in estimates], [WindowFit() for _ in estimates], [Lack(INTERPOLATED)],
                      fitted=estimates)
    rows, asked, late, doubts = question_to(seen, config.terms if is_weak else asked_terms(config, estimates),
                                            optional if is_weak else (), is_weak)
    if rows is None:
        return Judged([refused(e, EstimateStatus.SHORT) if e.valid else e for e in estimates],
                      [WindowFit() for _ in estimates], [], unchecked=asked.unchecked, fitted=estimates)
    made = _made(rows, estimates, asked, doubts, is_weak, config.formulation)
    lacks = {lack.what: lack for _, _, each, _ in made for lack in each}
    untested = sum(e.status == EstimateStatus.UNCHECKED for e, *_ in made)
    reason = asked.unchecked or (f"{untested} windows have too few rows to test {len(asked.terms)} coefficients: "
                                 "longer windows, or fewer gaps, allow it" if untested else "")
    terms, moving = asked.terms if is_weak else config.terms, tuple(x for x in config.terms if "beta" not in x)
    if is_weak and not np.ptp(rows.beta) and {"theta", "sin(theta)"} & set(moving) and moving != config.terms:
        rest = question(rows, tuple(dict.fromkeys((*moving, *optional))))
        if rest.pieces:
            terms, reason = rest.terms, ""
            lacks = {lack.what: lack for lack in (Lack(AT_REST), *rest.lacks)}
    return Judged([e for e, *_ in made], [fit for _, fit, *_ in made], list(lacks.values()), asked.lead, late, reason,
                  [fitted for *_, fitted in made], terms)


@lru_cache(maxsize=1)
def question_to(seen: CheckedLog, terms: tuple[str, ...], optional: tuple[str, ...],
                is_weak: bool) -> tuple[Rows | None, Question, Late | None, list[np.ndarray]]:
    """Return (usable rows of a log, the tests of its terms, how beta acts later than it is logged, betas (n,) that may
    act instead (`Late.doubts`)); cached, for one answer holds for all windows of a log.

    is_weak   the numbers are fitted to these rows: a beta that acts later than it is logged does so in them, a friction
              joins terms that nobody chose (`optional`), and the tests are made again
    """
    logged = rows = usable(seen)
    asked, late, doubts = question(rows, terms, optional), None, list[np.ndarray]()
    for _ in range(MOST_NUISANCES if is_weak else 0):
        found = {lack.what: lack for lack in asked.lacks}
        if asked.is_placebo or "clock" in found or not found or logged is None:
            break
        if optional and FRICTION in found and (found[FRICTION].size or 0.0) < 0.0:
            terms = (*terms, FRICTION)
        elif late is None:
            wider = (*asked.terms, *(what for what in found if what in LACKING))
            lead = asked.lead if "delay" in found else lead_of(asked.pieces, asked.terms, logged)
            if lead is None or not lead.is_sure or lead.value < 0.0:
                break
            late = late_input(logged, wider) if "delay" in found else late_input(logged, asked.terms, wider)
            if late is None:
                break
            rows, doubts = late.acting(logged), late.doubts(logged)
        else:
            break
        asked = question(rows, terms, optional, is_late=late is not None)
    return rows, asked if late is None else replace(asked, lead=late.lead), late, doubts


def asked_terms(config: Config, estimates: list[Estimate]) -> tuple[str, ...]:
    """Return those of the library's terms that any valid window has, all if no window is valid; and always beta, to
    test its placebo."""
    seen = {term for e in estimates if e.valid for term in active_terms(e)} or set(config.terms)
    return tuple(term for term in config.terms if term in seen or term == "beta")


def _made(rows: Rows, estimates: list[Estimate], asked: Question, doubts: list[np.ndarray],
          is_weak: bool, formulation: str) -> list[tuple[Estimate, WindowFit, list[Lack], Estimate]]:
    """Return for every window (estimate, its fit, what it lacks, the estimate before it was refused)."""
    windows = list[tuple[Rows, tuple[str, ...], Modes | None]]()
    for e in estimates:
        terms = asked.terms if is_weak or not e.valid else active_terms(e)
        part = rows.part(rows.cut(e.t_start, e.t_end))
        m = term_modes(part, terms) if len(part.t) > 1 else None
        windows.append((part, terms, m if m and len(m.y) >= PER_COEFFICIENT * (len(terms) + 1) else None))
    fits = window_fits(rows, windows, asked, doubts, is_weak)
    return [((refused(e, EstimateStatus.UNCHECKED) if e.valid else e), WindowFit(), [], e) if m is None or fit is None
            else _of_window(rows, part, m, fit, e, terms, asked, is_weak, formulation)
            for e, (part, terms, m), fit in zip(estimates, windows, fits, strict=True)]


def _of_window(rows: Rows, part: Rows, m: Modes, fit: Fit, e: Estimate, terms: tuple[str, ...], asked: Question,
               is_weak: bool, formulation: str) -> tuple[Estimate, WindowFit, list[Lack], Estimate]:
    """Return (a window's estimate, its fit, what it lacks, the estimate before it was refused)."""
    made = of_fit(part, m, fit, e, terms) if is_weak else widened(e, m, fit, terms, formulation)
    if asked.unchecked:
        return (refused(made, EstimateStatus.UNCHECKED) if made.valid else made), WindowFit(), [], made
    p, unexplained = left_over(fit, m) if not fit.is_singular else (None, None)
    shown = held_out(rows, made, p) if made.valid else WindowFit()
    if not made.valid:
        lacking = [lack for lack in asked.lacks if lack.is_most] or asked.lacks
        lacking = lacking if made.status in WEAK_STATUSES or asked.is_placebo else []
        return (refused(made) if lacking else made), shown, lacking, made
    values = dict(zip(made.terms, made.xi[:, 1].tolist(), strict=True))
    xi = np.array([values[term] for term in terms])
    std = np.array([made.terms_std.get(term, 0.0) for term in terms])
    lacking = against(part, terms, xi, std, fit, m, asked.lacks)
    if unexplained is not None and not lacking:
        lacking = [unexplained]
    if "theta_dot" in asked.known:   # which nobody asked for
        k = terms.index("theta_dot")
        if is_driving(xi[k], std[k], np.abs(xi) * np.sqrt(np.sum(m.phi**2, axis=0)), k):
            lacking = [Lack("driving", size=float(xi[k]), std=float(std[k]))]
    if not is_weak and not lacking and not fit.is_singular:
        own = np.sqrt(np.diag(fit.covariance))
        off = np.abs(xi - fit.xi)
        sizes = np.sqrt(np.sum(m.phi**2, axis=0))
        counts = RELATIVE_TOLERANCE * np.max(np.abs(fit.xi) * sizes) / np.maximum(sizes, 1e-300)
        differ = (off > np.maximum(AGREEMENT_SIGMAS * np.hypot(own, std),
                                   RELATIVE_TOLERANCE * np.abs(fit.xi))) & (off > counts)
        # nothing is known better than by weights
        if np.any(differ | ((own > CONTRADICTING_RATIO * std) & (own > counts))):
            lacking = [Lack("coefficients")]
    return (refused(made) if lacking else made), shown, lacking, made


def window_fits(rows: Rows, windows: list[tuple[Rows, tuple[str, ...], Modes | None]],
                asked: Question, doubts: list[np.ndarray], is_weak: bool) -> list[Fit | None]:
    """Return the fits of windows (rows, terms, regression), None of too few rows: with noise ratios by their own
    likelihood and POOLED of the log's, optional terms as the whole log tells them, and covariances widened by drifts of
    a6 and k1, by other betas (`doubts`), and in the weak form by scatter."""
    fits: list[Fit | None] = [None] * len(windows)
    grid = len(SPAN), len(SPAN)
    pooled = POOLED * np.sum([np.zeros(grid), *(piece.noise.restricted for piece in asked.pieces)], axis=0)
    for is_whole in (True, False):
        at = [k for k, (part, _, m) in enumerate(windows) if m and (len(part.t) > 0.9 * len(rows.t)) == is_whole]
        regressions = [m for k in at if (m := windows[k][2])]
        prior: Prior = () if is_whole else [(asked.terms.index(term), *known) for term, known in asked.known.items()]
        noises = noise_likelihoods(regressions)
        made = gls_of_all(regressions, [noise.restricted + pooled for noise in noises], noises, prior)
        for k, each in zip(at, made, strict=True):
            fits[k] = each
    rate, scatter = changes_of(asked)
    drifting = list[tuple[int, Fit, Modes]]()
    for k, ((part, terms, _), fit) in enumerate(zip(windows, fits, strict=True)):
        if fit and not fit.is_singular and len(slopes := slopes_of(terms)) == 2:
            drifting.append((k, fit, term_modes(part, (*terms, *slopes))))
    more = dict[int, np.ndarray]()
    for (k, fit, _), each in zip(drifting, gls_of_all([m for *_, m in drifting]), strict=True):
        more[k] = drift(each, fit, windows[k][1], rate)
    for k, ((part, terms, m), fit) in enumerate(zip(windows, fits, strict=True)):
        if fit is None or fit.is_singular:
            continue
        covariance = fit.covariance + more.get(k, 0.0)
        if is_weak and scatter:
            covariance = covariance + np.diag([scatter.get(term, 0.0) for term in terms])
        if doubts and m:
            others = with_betas(part, m, terms, [beta[rows.within(part)] for beta in doubts])
            w = 1.0 / np.sqrt(fit.variance)
            for j in range(others.shape[1]):
                by = least(others[:, j] * w[:, None], m.y * w) - least(m.phi * w[:, None], m.y * w)
                covariance = covariance + np.outer(by, by)
        fits[k] = replace(fit, covariance=covariance)
    return fits


def of_fit(rows: Rows, m: Modes, fit: Fit, e: Estimate, terms: tuple[str, ...]) -> Estimate:
    """Return a window's estimate with the weak form's numbers; refused if these are vague or cannot be told apart."""
    blank = replace(refused(e), terms=terms, xi=np.full((len(terms), 3), math.nan),
                    support=np.zeros((len(terms), 3), bool))
    if fit.is_singular:
        moves = all(np.ptp(x) > 0.0 for x in (rows.theta, rows.beta))
        return replace(blank, status=EstimateStatus.LOW_INFORMATION if moves else EstimateStatus.RANK)
    covariance = fit.covariance
    std = np.sqrt(np.diag(covariance))
    place = {term: k for k, term in enumerate(terms)}
    pair = [place.get("theta", place.get("sin(theta)", -1)), place.get("beta", -1)]
    if min(pair) >= 0:
        correlation = covariance[pair[0], pair[1]] / std[pair[0]] / std[pair[1]]
        relative = std[pair] / np.abs(fit.xi[pair])
        sizes = np.sqrt(np.sum(m.phi**2, axis=0))
        worth = std[pair] * sizes[pair] / np.max(np.abs(fit.xi) * sizes)
        if relative[1] > 1.0 or np.max(worth) > WORTH:   # a beta that may do nothing may be any column
            return replace(blank, status=EstimateStatus.LOW_INFORMATION)
        if abs(correlation) > ALIKE and np.all(relative > VAGUE):
            return replace(blank, status=EstimateStatus.SEPARATION)
    xi, support = np.zeros((len(terms), 3)), np.zeros((len(terms), 3), bool)
    xi[:, 1], support[:, 1] = fit.xi, True
    xi.flags.writeable = support.flags.writeable = False

    def of(term: str) -> tuple[float, float]:
        return (float(fit.xi[place[term]]), float(std[place[term]])) if term in place else (math.nan, math.nan)

    (a6, a6_std), (k1, k1_std) = of("theta"), of("beta")
    both = "theta" in place and "beta" in place
    corr = float(covariance[place["theta"], place["beta"]] / a6_std / k1_std) if both else math.nan
    return replace(
        e, valid=True, status=EstimateStatus.OK, terms=terms, xi=xi, support=support, a6=a6, k1=k1, a6_std=a6_std,
        k1_std=k1_std, a6_k1_corr=corr, a6_dot=of("tau*theta")[0], k1_dot=of("tau*beta")[0], a6_bound=math.nan,
        k1_bound=math.nan, absent={}, terms_std=dict(zip(terms, std.tolist(), strict=True)), rows=len(rows.t))


def widened(e: Estimate, m: Modes, fit: Fit, terms: tuple[str, ...], formulation: str) -> Estimate:
    """Return the estimate of `difference` or `integral` with no smaller deviations than the log's own noise gives such
    least squares: their own are of the autocorrelation of a window's residuals, of which it shows few periods."""
    if not e.valid or formulation not in ("difference", "integral") or fit.is_singular:
        return e
    own = np.sqrt(np.diag(least_squares_covariance(m, fit.variance, formulation)))
    std = {term: max(e.terms_std.get(term, 0.0), float(value)) for term, value in zip(terms, own, strict=True)}
    return replace(e, terms_std={term: std.get(term, value) for term, value in e.terms_std.items()},
                   a6_std=std.get("theta", e.a6_std), k1_std=std.get("beta", e.k1_std))


def changes_of(asked: Question) -> tuple[dict[str, float], dict[str, float]]:
    """Return by term (how fast [its unit/s] a6 and k1 change in the log, the variances by which they scatter).

    The spread of the pieces' own beyond their deviations (DerSimonian and Laird 1986) is a change, as of one that goes
    up and down once. Where neighbours are as unlike as others (von Neumann 1941) it is scatter too, which no vehicle
    does and the deviations of windows do not know. Nothing is found where it may be chance.
    """
    pieces, change, scatter = asked.pieces, dict[str, float](), dict[str, float]()
    span = pieces[-1].rows.t[0] - pieces[0].rows.t[0] if pieces else 0.0
    for k, term in enumerate(asked.terms):
        told = [(p.fit.xi[k], p.fit.covariance[k, k]) for p in pieces if not p.fit.is_singular]
        if term not in ("theta", "sin(theta)", "beta") or len(told) < 2 or not span > 0.0:
            continue
        x, v = np.array(told).T
        w = 1.0 / v
        free, spread = len(x) - 1, float(np.sum(w * (x - np.sum(w * x) / np.sum(w)) ** 2))
        chance = UNTRUE * free * (1.0 - 2.0 / (9.0 * free) + 3.09 * math.sqrt(2.0 / (9.0 * free))) ** 3
        if spread > chance:   # chi square, 99.9 % (Wilson and Hilferty 1931)
            beyond = float((spread - free) / (np.sum(w) - np.sum(w**2) / np.sum(w)))
            w = 1.0 / (v + beyond)
            variance = np.average((x - np.average(x, weights=w)) ** 2, weights=w)
            apart = np.average(np.diff(x) ** 2, weights=1.0 / (v[1:] + v[:-1] + 2.0 * beyond))
            if len(x) >= FEWEST_ALIKE and apart > UNLIKE * variance:
                scatter[term] = beyond
            change[term] = 2.0 * math.pi / span * math.sqrt(beyond)
    return change, scatter


def drift(bent: Fit, fit: Fit, terms: tuple[str, ...], rate: dict[str, float]) -> np.ndarray:
    """Return the covariance (q, q) that drifts of a6 and k1 add to a window's coefficients: drifts at the log's `rate`
    [1/s], and what lines in time move them by in this window beyond chance (Hausman 1978).

    bent   the fit of the window with lines in time of a6 and k1
    """
    q = len(terms)
    pair = [terms.index(slope.removeprefix("tau*")) for slope in slopes_of(terms)]
    steep = np.array([rate.get(terms[k], 0.0) for k in pair])
    if bent.is_singular:
        return np.diag(np.full(q, math.inf)) if steep.any() else np.zeros((q, q))
    information = np.linalg.inv(bent.covariance)
    moved = np.linalg.solve(information[:q, :q], information[:q, q:]) * steep   # by each line, left out
    covariance = np.asarray(moved @ moved.T)
    off = (bent.xi[:q] - fit.xi)
    spread = bent.covariance[np.ix_(pair, pair)] - fit.covariance[np.ix_(pair, pair)]
    scale = np.sqrt(np.maximum(np.diag(bent.covariance)[pair], 1e-300))
    value, vector = np.linalg.eigh(spread / np.outer(scale, scale))
    along = vector.T @ (off[pair] / scale)
    chi = float(np.sum(along**2 / np.maximum(value, 1e-3)))
    return covariance + np.outer(off, off) * (1.0 - 2.0 / chi) if chi > CHANCE_DRIFT else covariance
