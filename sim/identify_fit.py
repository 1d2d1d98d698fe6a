"""What the log itself says against a window's answer, where no nominal does.

All of it is in the weak form: increments of theta_dot over 0.2 s against the integrals of the terms over the same time,
which no differencing makes noisy.  Three questions:

* does the fit of a window's first two thirds predict its last third (`fit`);
* does beta at its own time explain more than beta at other times of the same log, the placebo: a k1 that a shifted beta
  gives as well is none;
* by how much beta leads (`delay`): the shift at which it explains most.

A window whose fit predicts nothing, or whose beta is no better than the placebos, is refused with status `MODEL`; so
are all if beta follows theta_ddot: a term is missing; and, on a stand, those with theta where sin(theta) leaves clearly
less.
"""

import dataclasses
import itertools
import math
from dataclasses import dataclass

import numpy as np

from launchid_core import Config, Estimate, EstimateStatus, parse_term

from .log import Log

INCREMENT = 0.2      # s: above it sensor noise is small beside what moves, below it a loop's period is seen
SLOPE = 0.05         # s to either side of a rate that is the attitude's slope: small beside an increment
HELD_OUT = 3         # the last of so many parts is held out
LEAST_HELD_OUT = 5   # increments without overlap in it: below, its share of the variance is chance
LIMIT = 1.645        # standard deviations to the upper 95 % limit
OVERLAP = 2.0        # of the variance of a sum of 0.2 s blocks: an increment that begins in one ends in the next
LAGS = 4             # of the portmanteau; even, for which its probability is elementary
LEAST_WHITE = 2 * LAGS
LEAST_STEP = 1.0e-6  # of the median step: nothing is known of a rate between stamps that are nearer
ABSURD = 1000.0      # times the log's length: a stamp further from its middle is no time of this log
SHIFTS = tuple(0.1 + 0.8 * k / 19 for k in range(20))  # of the log, circular: placebos
BY_CHANCE = 1        # placebos of these 20 that may explain more in a window: the 95 % quantile; in the log none
SEARCHED = 0.5       # of the gain at the best delay, which was sought, that a placebo, which was not, may have
SURE = 3.0           # standard deviations by which beta must follow its effect, beyond
WEAK = 1.5           # of the least squares: coefficients that leave more are drawn towards 0
SAME_TIME = 2.0      # sample periods that stamps may be off, before no window is believed
WITHDRAWN = 20.0     # s before a contradiction: as long as the estimator takes to forget one
LEAST_ALONE = 5      # increments in a window that is judged for itself too; shorter ones by the log's sum alone
MOST_DELAY = 0.3     # s either way
MOVING = ("tau*theta", "tau*beta")   # what a6 and k1 that drift look like in a piece, which is no trim
FUNCTIONS = (np.ones_like, np.sin, np.cos, np.sign)  # by their code in a term
LARGE = 0.5          # rad: below it sin(theta) is theta within 4 %
STRAIGHT = 0.8       # of the squares that theta leaves: if sin(theta) leaves less, theta is the wrong term
PIECE = 5.0          # s over which one set of coefficients holds while a delay, or another term, is sought


@dataclass(frozen=True, eq=False)
class Rows:
    """The usable rows of a log: times that increase, everything finite."""

    t: np.ndarray
    theta: np.ndarray
    theta_dot: np.ndarray
    beta: np.ndarray
    span: int  # rows in an increment

    def cut(self, t_start: float, t_end: float) -> slice:
        """Rows of a window."""
        first, end = np.searchsorted(self.t, (t_start, t_end)).tolist()
        return slice(first, end)

    def shifted(self, share: float) -> np.ndarray:
        """beta of another time of the log."""
        return np.roll(self.beta, round(share * len(self.t)))


def usable(log: Log) -> Rows | None:
    """None without two increments; where no rate is measured it is the attitude's (`slope`).  What the estimator
    rejects as out of range is no row here either."""
    finite = log.in_range("t") & log.in_range("theta") & log.in_range("beta")
    has_rate = bool(log.in_range("theta_dot").any())
    if has_rate:
        finite &= log.in_range("theta_dot")
    finite[finite] = near_all(log.t[finite], log.period)
    finite[finite] = forward(log.t[finite], LEAST_STEP * log.period)
    span = max(1, round(INCREMENT / log.period))
    if np.count_nonzero(finite) < 2 * span + 2:
        return None
    t, theta = log.t[finite], log.theta[finite]
    rate = log.theta_dot[finite] if has_rate else slope(t, theta, max(1, round(SLOPE / log.period)))
    return Rows(t, theta, rate, log.beta[finite], span)


def slope(t: np.ndarray, x: np.ndarray, rows: int) -> np.ndarray:
    """(n,) difference quotient of x (n,) over so many rows before and after, fewer at the ends."""
    at = np.arange(len(t))
    before, after = np.maximum(at - rows, 0), np.minimum(at + rows, len(t) - 1)
    return (x[after] - x[before]) / (t[after] - t[before])


def near_all(t: np.ndarray, period: float) -> np.ndarray:
    """Which stamps are times of this log."""
    return np.abs(t - np.median(t)) <= ABSURD * len(t) * period if len(t) else np.zeros(0, bool)


def forward(t: np.ndarray, least: float) -> np.ndarray:
    """Stamps that go forward by more than `least` [s]: later than all before, or earlier than all after, whichever
    leaves more.

    One stamp too late spoils the first, one too early the second.
    """
    if len(t) == 0:
        return np.zeros(0, bool)
    later = np.concatenate([[True], t[1:] - np.maximum.accumulate(t)[:-1] > least])
    earlier = np.concatenate([np.minimum.accumulate(t[::-1])[::-1][1:] - t[:-1] > least, [True]])
    return later if np.count_nonzero(later) >= np.count_nonzero(earlier) else earlier


def column(term: str, theta: np.ndarray, theta_dot: np.ndarray, beta: np.ndarray, tau: np.ndarray) -> np.ndarray:
    """A library term at every row."""
    *powers, function, argument = parse_term(term)
    value = np.ones(len(theta))
    for power, x in zip(powers, (theta, theta_dot, beta, tau), strict=True):
        value = value * x**power
    if function:
        value = value * FUNCTIONS[function]((theta, theta_dot, beta)[argument])
    return value


def increments(rows: Rows, at: slice, terms: tuple[str, ...], beta: np.ndarray) -> tuple[np.ndarray, ...]:
    """Of a window, from every row that has one: times they begin and end, of theta_dot (k,), of the terms (k, n)."""
    t, span = rows.t[at], rows.span
    if len(t) <= span:
        return t[:0], t[:0], t[:0], np.zeros((0, len(terms)))
    tau = t - 0.5 * (t[0] + t[-1])
    half = 0.5 * np.diff(t)
    made = []
    for term in terms:
        x = column(term, rows.theta[at], rows.theta_dot[at], beta[at], tau)
        whole = np.concatenate([[0.0], np.cumsum(half * (x[1:] + x[:-1]))])
        made.append(whole[span:] - whole[:-span])
    rate = rows.theta_dot[at]
    near = t[span:] - t[:-span] <= 1.5 * INCREMENT  # no gap within
    phi = np.column_stack(made) if made else np.zeros((len(t) - span, 0))
    return t[:-span][near], t[span:][near], (rate[span:] - rate[:-span])[near], phi[near]


def left(phi: np.ndarray, y: np.ndarray) -> np.ndarray:
    """What least squares leaves of y."""
    return y - phi @ np.linalg.lstsq(phi, y, rcond=None)[0] if phi.shape[1] else y


def ljung_box(e: np.ndarray) -> float | None:
    """p-value of whiteness (Ljung & Box, Biometrika 65, 1978); None for too few."""
    n = len(e)
    e = e - e.mean() if n else e
    square = float(e @ e)
    if n < LEAST_WHITE or square == 0.0:
        return None
    q = n * (n + 2) * sum((float(e[k:] @ e[:-k]) / square) ** 2 / (n - k) for k in range(1, LAGS + 1))
    return math.exp(-0.5 * q) * sum((0.5 * q) ** k / math.factorial(k) for k in range(LAGS // 2))


@dataclass(frozen=True)
class Fit:
    """Of a window's last third: share of the variance predicted, its upper 95 % limit, whiteness; None: too short."""

    r2: float | None = None
    upper: float | None = None
    whiteness: float | None = None


def held_out(rows: Rows, estimate: Estimate) -> Fit:
    """How well the first two thirds of a window predict its last third."""
    terms = active_terms(estimate)
    begin, end, y, phi = increments(rows, rows.cut(estimate.t_start, estimate.t_end), terms, rows.beta)
    split = estimate.t_end - (estimate.t_end - estimate.t_start) / HELD_OUT
    fitted, judged = end <= split, begin >= split
    n = np.count_nonzero(judged)
    if n < (LEAST_HELD_OUT - 1) * rows.span or np.count_nonzero(fitted) <= len(terms):
        return Fit()
    xi = np.linalg.lstsq(phi[fitted], y[fitted], rcond=None)[0] if terms else np.zeros(0)
    e, s = y[judged] - phi[judged] @ xi, y[judged] - y[judged].mean()
    e = e - e.mean()  # of the variance: a steady moment is no contradiction
    if not s @ s > 0.0:
        return Fit()
    blocks = np.arange(n) // rows.span
    ratio = float(e @ e) / float(s @ s)
    off = np.bincount(blocks, e * e) - ratio * np.bincount(blocks, s * s)
    std = math.sqrt(OVERLAP * float(off @ off) * len(off) / (len(off) - 1)) / float(s @ s)
    return Fit(1.0 - ratio, 1.0 - ratio + LIMIT * std, ljung_box(e[::rows.span]))


def active_terms(estimate: Estimate) -> tuple[str, ...]:
    """Of the theta_ddot equation."""
    return tuple(term for term, on in zip(estimate.terms, estimate.support[:, 1].tolist(), strict=True) if on)


def gain(rows: Rows, at: slice, terms: tuple[str, ...], beta: np.ndarray) -> float | None:
    """By how much the terms in beta lower the squared error; None where there are too few increments to say."""
    others = tuple(k for k, term in enumerate(terms) if "beta" not in term)
    _, _, y, phi = increments(rows, at, terms, beta)
    if len(y) <= len(terms):
        return None
    before, after = left(phi[:, others], y), left(phi, y)
    return float(before @ before - after @ after)


def placebo(rows: Rows, estimates: list[Estimate]) -> list[bool]:
    """Of each window, whether its beta explains no more than that of other times; of all, if that holds of the sum.

    A beta that was thresholded away is asked too: that the beta of another time does nothing says nothing of k1.
    """
    asked = {k: terms if any("beta" in term for term in terms) else (*terms, "beta")
             for k, e in enumerate(estimates) for terms in [active_terms(e)]
             if e.valid and any("beta" in term for term in e.terms)}
    found: dict[int, list[float | None]] = {k: [] for k in asked}
    for share in (0.0, *SHIFTS):  # of the true beta, then of the shifted ones, each as long as the log: one at a time
        beta = rows.shifted(share)
        for k, terms in asked.items():
            found[k].append(gain(rows, rows.cut(estimates[k].t_start, estimates[k].t_end), terms, beta))
    gains = {k: np.array(each, dtype=float) for k, each in found.items() if None not in each}
    total = sum(gains.values(), np.zeros(1 + len(SHIFTS)))
    all_in_vain = bool(gains) and bool(np.any(total[1:] >= total[0]))
    alone = [e.t_end - e.t_start > (LEAST_ALONE - 0.5) * INCREMENT for e in estimates]
    return [k in gains and (all_in_vain or (alone[k] and bool(np.sum(gains[k][1:] >= gains[k][0]) > BY_CHANCE)))
            for k in range(len(estimates))]


def bent(rows: Rows, estimates: list[Estimate]) -> list[bool]:
    """Of each window, whether theta is the wrong term in it: the log has large angles (a test stand), and over pieces
    of it sin(theta), alone or with damping and dry friction, leaves clearly less in its place."""
    asked = [e.valid and "theta" in active_terms(e) for e in estimates]
    if not any(asked) or not np.max(np.abs(rows.theta)) > LARGE:
        return [False] * len(estimates)
    terms = active_terms(estimates[asked.index(True)])
    sine = tuple("sin(theta)" if term == "theta" else term for term in terms)
    rest = tuple(term for term in ("theta_dot", "sign(theta_dot)") if term not in terms)
    straight, *others = (sum(squares(rows, at, each) for at in pieces_of(rows))
                         for each in (terms, sine, (*sine, *rest)))
    return [each and min(others) < STRAIGHT * straight for each in asked]


def misplaced(rows: Rows, estimates: list[Estimate], lead: dict[str, float] | None) -> list[bool]:
    """Of each window, whether its a6 or k1 move by more than SURE of their standard deviations when beta is taken as
    late as it is, or when a steady moment is allowed for that explains the log clearly better: the numbers are then
    those of another input, or of a trim."""
    asked = next((active_terms(e) for e in estimates if e.valid), ())
    if not asked:
        return [False] * len(estimates)
    late = None if lead is None or not abs(lead["value"]) > SURE * lead["std"] else \
        np.interp(rows.t - lead["value"], rows.t, rows.beta)
    others: list[tuple[np.ndarray, tuple[str, ...]]] = [] if late is None else [(late, ())]
    if "1" not in asked:
        pieces = pieces_of(rows)
        for beta in (rows.beta,) if late is None else (rows.beta, late):
            moving = (*asked, *(term for term in MOVING if term not in asked))
            plain, trimmed = (sum(squares(rows, at, of, beta) for at in pieces) for of in (moving, (*moving, "1")))
            others += [(beta, ("1",))] if trimmed < STRAIGHT * plain else []
    return [e.valid and any(_moves(rows, e, beta, more) for beta, more in others) for e in estimates]


def attenuated(rows: Rows, estimates: list[Estimate]) -> list[bool]:
    """Of each window, whether its coefficients leave clearly more of its increments than others would: noise in the
    regressors, or a rate that had to be made out of the attitude, draws coefficients towards 0."""
    return [e.valid and _leaves(rows, e) for e in estimates]


def _leaves(rows: Rows, estimate: Estimate) -> bool:
    """More than WEAK times the squares that least squares leave."""
    at, terms = rows.cut(estimate.t_start, estimate.t_end), active_terms(estimate)
    _, _, y, phi = increments(rows, at, terms, rows.beta)
    if len(y) < LEAST_ALONE * rows.span:
        return False
    xi = estimate.xi[estimate.support[:, 1], 1]
    own, best = y - phi @ xi, left(phi, y)
    return float(own @ own) > WEAK * float(best @ best)


def _moves(rows: Rows, estimate: Estimate, beta: np.ndarray, more: tuple[str, ...]) -> bool:
    """Another beta, or more terms, give other coefficients."""
    at, terms = rows.cut(estimate.t_start, estimate.t_end), active_terms(estimate)
    found = []
    for each, of in ((rows.beta, terms), (beta, (*terms, *more))):
        _, _, y, phi = increments(rows, at, of, each)
        if len(y) <= len(of):
            return False
        found.append(np.linalg.lstsq(phi, y, rcond=None)[0][:len(terms)])
    by = dict(zip(terms, np.abs(found[1] - found[0]).tolist(), strict=True))
    return any(by.get(term, 0.0) > SURE * std for term, std in (("theta", estimate.a6_std), ("beta", estimate.k1_std)))


def squares(rows: Rows, at: slice, terms: tuple[str, ...], beta: np.ndarray | None = None) -> float:
    """What the terms leave of the increments of some rows."""
    _, _, y, phi = increments(rows, at, terms, rows.beta if beta is None else beta)
    return float(np.sum(left(phi, y) ** 2))


def pieces_of(rows: Rows) -> list[slice]:
    """Pieces of about PIECE."""
    count = max(1, round(len(rows.t) * float(np.median(np.diff(rows.t))) / PIECE))
    edges = np.linspace(0, len(rows.t), count + 1).astype(int).tolist()
    return [slice(a, b) for a, b in itertools.pairwise(edges)]


def refused(estimate: Estimate) -> Estimate:
    """The window's numbers contradict the log."""
    nan = math.nan
    xi, support = np.full_like(estimate.xi, math.nan), np.zeros_like(estimate.support)
    xi.flags.writeable = support.flags.writeable = False
    return dataclasses.replace(estimate, valid=False, status=EstimateStatus.MODEL, xi=xi, support=support, absent={},
                               a6=nan, k1=nan, a6_std=nan, k1_std=nan, a6_k1_corr=nan, a6_dot=nan, k1_dot=nan,
                               a6_bound=nan, k1_bound=nan, condition=nan)


def withdrawn(estimates: list[Estimate]) -> list[Estimate]:
    """The estimates, without those that a contradiction of the model follows within WITHDRAWN s: what contradicts it
    was there before it was told, and the estimator could not know; a log that is whole can."""
    told = [e.t_end for e in estimates if e.status == EstimateStatus.MODEL]
    followed = [any(0.0 < t - e.t_end <= WITHDRAWN for t in told) for e in estimates]
    return [_without_air(refused(e) if e.valid else e) if no else e for e, no in zip(estimates, followed, strict=True)]


def _without_air(estimate: Estimate) -> Estimate:
    """Without wind, offsets and tracked estimate, as while the model is contradicted."""
    nan = math.nan
    tracked = estimate.tracked
    if tracked is not None:
        tracked = tracked._replace(valid=False, **dict.fromkeys(tracked._fields[1:], nan))
    return dataclasses.replace(estimate, wind=nan, wind_std=nan, offsets={}, tracked=tracked)


def judge(log: Log, config: Config, estimates: list[Estimate],
          lead: dict[str, float] | None = None) -> tuple[list[Estimate], list[Fit]]:
    """The estimates, those refused that the log contradicts (`filtered` judges itself), and the fit of each.

    lead   `delay` of the log: a beta that follows what it should cause contradicts every window
    """
    rows = usable(log)
    if rows is None:
        return estimates, [Fit() for _ in estimates]
    fits = [held_out(rows, e) if e.valid else Fit() for e in estimates]
    if config.formulation == "filtered":
        return estimates, [dataclasses.replace(fit, whiteness=each.whiteness if math.isfinite(each.whiteness) else None)
                           for fit, each in zip(fits, estimates, strict=True)]
    late = lead is not None and lead["value"] + SURE * lead["std"] < -SAME_TIME * config.sample_period
    gates = zip(placebo(rows, estimates), bent(rows, estimates), misplaced(rows, estimates, lead),
                attenuated(rows, estimates), fits, strict=True)
    wrong = [late or vain or curved or moved or small or (fit.upper is not None and fit.upper < 0.0)
             for vain, curved, moved, small, fit in gates]
    return [refused(e) if no and e.valid else e for e, no in zip(estimates, wrong, strict=True)], fits


def delay(log: Log, config: Config) -> dict[str, float] | None:
    """By how much beta leads [s], and its standard deviation; None where beta explains nothing."""
    rows = usable(log)
    if rows is None or not any("beta" in term for term in config.terms):
        return None
    t, period = rows.t, float(np.median(np.diff(rows.t)))
    pieces = pieces_of(rows)

    def explained(beta: np.ndarray) -> float:
        return sum(gain(rows, at, config.terms, beta) or 0.0 for at in pieces)

    def moved(lead: float) -> np.ndarray:
        return np.interp(t - lead, t, rows.beta)

    step = max(period, MOST_DELAY / 60.0)
    most = round(MOST_DELAY / step)
    gains = [explained(moved(k * step)) for k in range(-most, most + 1)]
    best = int(np.argmax(gains))
    vain = [explained(rows.shifted(share)) for share in SHIFTS]
    if not gains[best] > 0.0 or best in (0, 2 * most) or max(vain) >= SEARCHED * gains[best]:
        return None
    low, middle, high = gains[best - 1:best + 2]
    bend = low - 2.0 * middle + high
    value = (best - most) * step + (0.5 * step * (low - high) / bend if bend < 0.0 else 0.0)
    above = below = 0.0
    for at in pieces:
        _, _, y, phi = increments(rows, at, config.terms, moved(value))
        if len(y) <= len(config.terms):
            continue
        xi = np.linalg.lstsq(phi, y, rcond=None)[0]
        later, sooner = (increments(rows, at, config.terms, moved(value + side * step))[3] for side in (1, -1))
        slope = left(phi, (later - sooner) @ xi / (2.0 * step))
        v = slope * (y - phi @ xi)
        lags = min(2 * rows.span, len(v) - 1)
        above += float(v @ v) + 2.0 * sum((1.0 - k / (lags + 1)) * float(v[k:] @ v[:-k]) for k in range(1, lags + 1))
        below += float(slope @ slope)
    if not (below > 0.0 and above >= 0.0):
        return None
    return {"value": value, "std": math.sqrt(above) / below}
