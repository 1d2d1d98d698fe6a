"""Judge windows that no nominal judges: test each assumption behind their numbers on this log.

There are three answers: it holds; it does not hold (`Lack`: what, how much, what to do); it cannot be tested
(`UNCHECKED`, with what would allow it). The tests are made once, in pieces of JUDGE_PIECE seconds of the whole log,
whatever the windows are, and what they find counts in each window whose numbers it would move. Tested is, in this
order, whether beta is known between its own values, whether it acts when it is logged, whether beta of another time
explains as much (placebo), whether a term that the answer lacks explains what is left, and whether that is as white as
was assumed.
"""

import itertools
import math
from dataclasses import dataclass, field, replace

import numpy as np

from ..sums import combined, square
from .fit import MIN_COLUMN_LEFT, Fit, Noise, gls_of_all, least, noise_likelihoods, rest, spectrum, whiteness
from .rows import (
    FAST_THETA,
    LAGS_FORGOTTEN,
    Modes,
    Rows,
    acting_later,
    ends_of,
    in_modes,
    increments,
    later,
    term_modes,
    values_of,
    without_beginnings,
)

JUDGE_PIECE = 5.0    # s over which one set of coefficients holds while the log is asked,
ROWS_A_PIECE = 250   # and rows: of a slow log the vehicle is slower, too
MOST_PIECES = 60     # evenly over a longer log: the work is bounded
PER_COEFFICIENT = 5  # modes, without which an answer cannot be tested
STRETCH = 1.0        # s, the least stretch without a gap: what is slower, and a shift of beta, is not seen in shorter
TERM_SIGMAS = 5.0    # standard deviations of a term that is there
SHIFT = 3.0          # the same of a shift of beta
WRONG = 2.0          # the same of a number that no vehicle has
DRIVES = 0.2         # of the largest term, that a damping of the wrong sign is: less is drawn from disturbances
RELATIVE_TOLERANCE = 0.02  # relative: a6 and k1 may be off by that without being wrong, as in [diagnosis]
ONE_COLUMN = 0.98    # of a column's square that others explain (|correlation| 0.99): it is one with them in this log
SIMPLER = 0.7        # of the gain of the best term, for which a simpler one is preferred
SEEN = 5.0           # times its sensor's noise: less of a fast theta is told from it by chance
RUNS = 3.0           # times its fast part, that all of theta is where it runs along a flight path
LARGE = 0.5          # rad: below it sin(theta) is theta within 4 %
MOST_DELAY = 0.3     # s either way
DELAY_STEP = 0.0125  # s of the first search
MOST_TOGETHER = 100_000  # rows of shifted betas that are computed at once: some 20 MB
LAGS = (0.0, 0.01, 0.02, 0.035, 0.055, 0.08, 0.12, 0.18, 0.27, 0.4)  # s of a servo or motor, that are tried
LEAST_DELAY = -0.025  # s behind a lag: beta acts no sooner, and the best may lie at none
FEWEST_CLOCK = 6     # pieces that say when beta acts, for a clock that runs slow
SHIFTS = tuple(0.1 + 0.8 * k / 19 for k in range(20))  # of the log, circular: placebos
SAME_INPUT = 0.9     # |correlation| of a shifted beta with itself: an input that repeats is no placebo
BEYOND = 0.5         # of the likelihood that beta gains, that the best placebo must not
MOST_PLACEBO = 12    # pieces, evenly over the log, of which placebos are asked
WIDE_FREQUENCY = 15.0  # rad/s: shares are told of changes over 0.2 s and more
FINE_BANDS = 24      # in which the rest is asked whether it is white
WHITENESS_P = 1.0e-6  # p-value below which the rest is not as white as its noise
STRONG = 0.05        # of the changes of theta_dot, that a term explains beside a beta that is no input of them
MOST_LACKS = 3
MOST_OF_ERROR = 0.5  # of the error of rows left out
JUDGE_FOLDS = 3      # parts of the log that are left out in turn
INCREMENT = 0.2      # s, of theta_dot, that a fit is shown to predict: sensor noise is small beside it
LIBRARY = ("1", "theta_dot", "sin(theta)", "sign(theta_dot)", "beta^2")  # terms that a library may have
LACKING = ("1", "theta_dot", "gamma", FAST_THETA, "sin(theta)", "sign(theta_dot)", "beta^2",
           "beta_ddot")  # terms that an answer may lack, the simpler first


@dataclass(frozen=True)
class Lack:
    """Something that the fitted terms lack to describe a log, or for which no numbers of it can be right.

    what     a term, or delay, clock, placebo, driving, interpolated, beta at rest, unexplained, coefficients
    before, after   share of the weighted squares that is explained without and with it
    size     coefficient of the term [its units], delay [s], frequency [rad/s]; None for the others
    std      its standard deviation;  is_most  with it half of the error of held-out rows is gone
    """

    what: str
    before: float = math.nan
    after: float = math.nan
    size: float | None = None
    std: float = math.nan
    is_most: bool = False

    @property
    def shares(self) -> str:
        """Shares of the changes of theta_dot that are explained with what is lacking and without it, in words."""
        return (f"with it {100.0 * self.after:.3g} % of the changes of theta_dot are explained, without "
                f"{100.0 * self.before:.3g} %")


@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch of the log, its regression on the terms of the equation, the fit, and the noise's likelihood."""

    rows: Rows
    modes: Modes
    fit: Fit
    noise: Noise

    @property
    def weight(self) -> np.ndarray:
        """One over the standard deviation (n,) of each mode."""
        return np.asarray(1.0 / np.sqrt(self.fit.variance))

    def shifted(self, terms: tuple[str, ...], leads: list[float]) -> np.ndarray:
        """Return the columns (n, k, q) of terms in n modes, with beta delayed by each of k leads [s]."""
        return with_betas(self.rows, self.modes, terms, [later(self.rows, lead) for lead in leads])

    def unexplained(self, terms: tuple[str, ...], leads: list[float]) -> np.ndarray:
        """Return the weighted squares (k,) that terms leave with beta delayed by each of k leads [s]."""
        if len(leads) > 1 and len(leads) * len(self.rows.t) > MOST_TOGETHER:
            half = len(leads) // 2
            return np.concatenate([self.unexplained(terms, leads[:half]), self.unexplained(terms, leads[half:])])
        w, ends = self.weight, np.repeat(self.modes.ends[:, None, :], len(leads), axis=1)
        phi = np.transpose(np.concatenate([self.shifted(terms, leads), ends], axis=2), (1, 2, 0))
        phi = np.multiply(phi, w, order="C")
        phi /= np.sqrt(np.maximum(np.einsum("kqn,kqn->kq", phi, phi), 1e-300))[:, :, None]
        inverse = np.linalg.pinv(np.einsum("kqn,krn->kqr", phi, phi), MIN_COLUMN_LEFT, hermitian=True)
        y = self.modes.y * w
        xi = np.einsum("kqr,kr->kq", inverse, np.einsum("kqn,n->kq", phi, y))
        left = y - np.einsum("kq,kqn->kn", xi, phi)
        return np.einsum("kn,kn->k", left, left)


def with_betas(rows: Rows, m: Modes, terms: tuple[str, ...], betas: list[np.ndarray]) -> np.ndarray:
    """Return the columns (n, k, q) of terms, those of regression m, with each of k betas (rows,) instead."""
    places = [k for k, term in enumerate(terms) if "beta" in term]
    moving = tuple(terms[k] for k in places)
    values = [np.column_stack([values_of(rows, term, rows.attack, rows.theta_dot, beta) for term in moving])
              for beta in betas]
    ends = [ends_of(rows, moving, each, beta) for each, beta in zip(values, betas, strict=True)]
    phi = in_modes(rows, np.hstack(values), np.hstack(ends), with_doubt=False)
    whole = np.repeat(m.phi[:, None, :], len(betas), axis=1)
    whole[:, :, places] = np.reshape(phi, (len(phi), len(betas), len(places)))
    return whole


@dataclass(frozen=True)
class Lead:
    """The time [s] by which beta leads its effect, acting later than it is logged, and its standard deviation.

    grows    [s/s] over the log where that is sure, by two clocks, else 0;  middle  [s] when the lead is `value`
    """

    value: float
    std: float
    grows: float = 0.0
    middle: float = 0.0

    def at(self, rows: Rows) -> float:
        """Return the lead [s] in the middle of `rows`."""
        return self.value + self.grows * (0.5 * float(rows.t[0] + rows.t[-1]) - self.middle)

    @property
    def json(self) -> dict[str, float | None]:
        """The lead as the `delay` of the identify JSON."""
        return {"value": self.value, "std": self.std if math.isfinite(self.std) else None}

    @property
    def is_sure(self) -> bool:
        """Whether the lead is significant: |value| > SHIFT std."""
        return abs(self.value) > SHIFT * self.std


@dataclass(frozen=True)
class Late:
    """How beta acts later than it is logged: after a delay, and filtered by `order` equal first-order lags.

    lag   sum of their time constants [s], and its standard deviation; (0, 0): none
    """

    lead: Lead
    lag: tuple[float, float] = (0.0, 0.0)
    order: int = 1

    def acting(self, rows: Rows, lead_by: float = 0.0, lag_by: float = 0.0) -> Rows:
        """Return the rows with beta as it acts, `lead_by`, `lag_by` [s] later still, less beginnings of stretches."""
        late = acting_later(rows, self.lead.value + lead_by, self.lag[0] + lag_by, self.order)
        return without_beginnings(late, self.lead.value + LAGS_FORGOTTEN * self.lag[0])

    def doubts(self, rows: Rows) -> list[np.ndarray]:
        """Return betas (rows,) of `acting` with the delay, and with the lag, larger by its standard deviation."""
        lead_by = self.lead.std if math.isfinite(self.lead.std) else 0.0
        return [self.acting(rows, *by).beta for by in ((lead_by, 0.0), (0.0, self.lag[1])) if any(by)]

    @property
    def json(self) -> dict[str, object]:
        """The delay and the lag as the `late` of the identify JSON."""
        lag = {"value": self.lag[0], "std": self.lag[1]} if self.lag[0] else None
        return {"delay": self.lead.json, "lag": lag, "order": self.order}


@dataclass(frozen=True, eq=False)
class Question:
    """Result of testing whether `terms` describe a log: fitted pieces, lead of beta, lacks, or why unchecked."""

    rows: Rows
    terms: tuple[str, ...]
    pieces: list[Piece]
    lead: Lead | None
    lacks: list[Lack]
    unchecked: str = ""
    known: dict[str, tuple[float, float]] = field(default_factory=dict)   # of optional terms: coefficient, deviation

    @property
    def is_placebo(self) -> bool:
        """Whether beta of another time explains about as much as beta itself; then no window is valid."""
        return any(lack.what == "placebo" for lack in self.lacks)


def pieces_of(rows: Rows, terms: tuple[str, ...]) -> list[Piece]:
    """Cut rows into pieces and fit those that are long enough, with one noise ratio by the likelihood of all."""
    count = max(1, round((rows.t[-1] - rows.t[0]) / max(JUDGE_PIECE, ROWS_A_PIECE * rows.period)))
    edges = np.linspace(rows.t[0], rows.t[-1] + rows.period, count + 1)
    parts = [rows.part(rows.cut(a, b)) for a, b in itertools.pairwise(edges.tolist())]
    asked = parts if len(parts) <= MOST_PIECES else \
        [parts[k] for k in np.linspace(0, len(parts) - 1, MOST_PIECES).round().astype(int)]
    made = [(part, term_modes(part, terms)) for part in asked if len(part.t) > 1]
    return fitted([(part, m) for part, m in made if len(m.y) >= PER_COEFFICIENT * (len(terms) + 1)])


def fitted(made: list[tuple[Rows, Modes]]) -> list[Piece]:
    """Fit (rows, their regression) pairs with noise ratios by the likelihood of all; return them as pieces."""
    regressions = [m for _, m in made]
    noises = noise_likelihoods(regressions)
    whole = np.sum([noise.restricted for noise in noises], axis=0)
    fits = gls_of_all(regressions, [whole] * len(made), noises)
    return [Piece(part, m, fit, own) for (part, m), fit, own in zip(made, fits, noises, strict=True)]


def likelihood(pieces: list[Rows], terms: tuple[str, ...]) -> float:
    """Return the largest log-likelihood of terms in pieces, each with its coefficients, all with one noise."""
    noises = noise_likelihoods([term_modes(rows, terms) for rows in pieces])
    return float(np.max(np.sum([noise.largest for noise in noises], axis=0)))


def question(rows: Rows | None, terms: tuple[str, ...], optional: tuple[str, ...] = (), *,
             is_late: bool = False) -> Question:
    """Test whether terms describe a log, with those of `optional` whose coefficient exceeds its deviation.

    rows      None: nothing can be tested;  is_late   when beta acts was fitted before, and no shift of it is tested
    """
    if rows is None:
        return Question(rows, terms, [], None, [], "theta and beta have no two rows together")  # type: ignore[arg-type]
    typical = rows.stretch
    if typical < min(STRETCH, 0.9 * (rows.t[-1] - rows.t[0])):
        return Question(rows, terms, [], None, [], f"gaps leave stretches of {typical:.2g} s: a shift of beta, and "
                        f"what is slower, cannot be tested; log at least {STRETCH:g} s without a gap")
    whole = pieces_of(rows, terms)
    pieces = [piece for piece in whole if not piece.fit.is_singular]
    if not pieces:
        reason = (f"{len(rows.t)} rows are too few to test {len(terms)} coefficients; log longer, or more often"
                  if not whole else "theta and beta hardly move, or move as one: no coefficient can be tested; log a "
                  "stretch in which beta moves by itself")
        return Question(rows, terms, [], None, [], reason)
    known = {}
    for term in optional:
        more = beside(pieces, (*terms, term))
        size, std, _ = pooled(more)
        if abs(size) > std:
            terms, pieces, known[term] = (*terms, term), more, (size, std)
    lacks, lead = lacks_of(rows, terms, pieces, is_late)
    wider = (*terms, *(lack.what for lack in lacks if lack.what in LACKING))
    asked = pieces if wider == terms else beside(pieces, wider)
    clear = any(lack.is_most for lack in lacks)
    if not clear and placebo(asked, wider, rows, lead):   # of a beta that explains nothing no shift is proved
        strong = [lack for lack in lacks if lack.what not in ("delay", "clock") and lack.after - lack.before > STRONG]
        return Question(rows, terms, pieces, None, [*strong, Lack("placebo")], known=known)
    return Question(rows, terms, pieces, lead, lacks, known=known)


# ---- terms


def pooled(pieces: list[Piece]) -> tuple[float, float, float]:
    """Return (coefficient, standard deviation, share of its column that the others explain) of the last term, with one
    coefficient in all pieces; the others have one in each."""
    told = [piece for piece in pieces if not piece.fit.is_singular]
    below = sum(1.0 / float(piece.fit.covariance[-1, -1]) for piece in told)
    if not below > 0.0:
        return 0.0, math.inf, 1.0
    size = sum(float(piece.fit.xi[-1] / piece.fit.covariance[-1, -1]) for piece in told) / below
    columns = [piece.modes.phi * piece.weight[:, None] for piece in pieces]
    left, whole = (sum(map(square, each)) for each in (
        [rest(phi[:, :-1], phi[:, -1]) for phi in columns], [phi[:, -1] for phi in columns]))
    return size, 1.0 / math.sqrt(below), 1.0 - left / whole if whole > 0.0 else 1.0


def lacks_of(rows: Rows, terms: tuple[str, ...], pieces: list[Piece],
             is_late: bool) -> tuple[list[Lack], Lead | None]:
    """Return (what `terms` lack to describe the log, the lead of beta beside that): of further terms that explain about
    as much the simplest first, then the lead.

    A term is lacking if its coefficient is significant with the noise fitted beside it: without it, its effect looks
    like noise. A shift of beta is a nuisance there, none or the best one without the term, whichever is more likely
    with it. A term that halves the error of held-out rows is lacking whatever the noise is.
    """
    fast = rows.fast         # where theta runs far beside it, a flight path that is missing comes before all else
    path = FAST_THETA if np.var(rows.theta) > RUNS**2 * np.var(fast) else ""
    bent = bool(np.ptp(rows.attack) > LARGE)
    names = [term for term in LACKING if term not in terms and (term != "sin(theta)" or bent)
             and (term != "gamma" or rows.has_gamma) and (term != "beta_ddot" or rows.has_rate)
             and (term != FAST_THETA or (not (rows.has_gamma or "sin(theta)" in terms)
                  and np.var(fast) > SEEN**2 * rows.theta_noise))]
    found = list[Lack]()
    while True:
        lead = None if is_late else lead_of(pieces, terms, rows)
        if lead is not None and lead.grows:
            before = explained(pieces, terms)
            return [*found, Lack("clock", before, before, lead.grows)], lead
        if len(found) == MOST_LACKS:
            break
        shifts = [0.0] if lead is None or not lead.is_sure else [0.0, lead.value]
        shifted = {shift: [moved(piece.rows, shift) for piece in pieces]
                   for shift in (0.0, *([lead.value] if lead else []))}
        plain = max(likelihood(shifted[shift], terms) for shift in shifts)
        left, total = ahead(rows, terms), sum(square(piece.modes.y * piece.weight) for piece in pieces)
        asked = dict[str, tuple[float, float, float, bool]]()
        for term in names:
            if term not in terms:
                at = [lead.value] if term == "beta_ddot" and lead else shifts   # a late beta looks like it
                least_gain = SHIFT**2 if term == path else max(TERM_SIGMAS**2, RELATIVE_TOLERANCE**2 * total)
                there = term_beside(rows, terms, term, [shifted[shift] for shift in at], plain, left, least_gain)
                asked |= {} if there is None else {term: there}
        if not asked:
            break
        most = {term: each for term, each in asked.items() if each[3]} or asked
        best = max(each[0] for each in most.values())
        term = next(term for term, each in most.items() if each[0] >= SIMPLER * best or term in ("gamma", path))
        _, size, std, is_most = most[term]
        before, pieces = explained(pieces, terms), beside(pieces, (*terms, term))
        terms = (*terms, term)
        if is_most:
            _, _, y, phi = increments(rows, terms, INCREMENT)
            size = float(least(phi, y)[-1])
        found.append(Lack(term, before, explained(pieces, terms), size, std, is_most))
    if "beta_ddot" in terms:   # as its column is made, it lags
        return found, None
    if lead is not None and lead.is_sure:
        found.append(Lack("delay", explained(pieces, terms), explained(pieces, terms, lead.value), lead.value,
                          lead.std))
    return found, lead


def term_beside(rows: Rows, terms: tuple[str, ...], term: str, shifted: list[list[Rows]], plain: float, left: float,
                least_gain: float) -> tuple[float, float, float, bool] | None:
    """Return (gain of twice the log-likelihood, coefficient, deviation, whether it halves the error of held-out rows)
    of a further `term` that the log shows beside `terms`; None if it does not.

    shifted   the pieces' rows, one list a shift of beta;  plain   log-likelihood without the term
    left      share of held-out rows not predicted without it;  least_gain   that the gain must reach
    """
    wider = (*terms, term)
    likelihoods = [likelihood(each, wider) for each in shifted]
    without = ahead(rows, wider) if left > RELATIVE_TOLERANCE**2 else left
    is_most = without < MOST_OF_ERROR * left and left - without > RELATIVE_TOLERANCE**2
    gain = 2.0 * (max(likelihoods) - plain)
    if not is_most and not gain > least_gain:
        return None
    pieces = fitted([(each, term_modes(each, wider)) for each in shifted[int(np.argmax(likelihoods))]])
    size, std, share = pooled(pieces)
    is_apart = share < ONE_COLUMN or term in ("1", "gamma")
    if term == FAST_THETA and "theta" in terms:   # a flight path takes of what theta does slowly, adds nothing
        slow = [piece.fit.xi[terms.index("theta")] for piece in pieces if not piece.fit.is_singular]
        is_apart &= size * (size + float(np.median(slow or [0.0]))) > 0.0
    if term == "beta_ddot" and rows.stretch < min(JUDGE_PIECE, 0.9 * (rows.t[-1] - rows.t[0])):
        is_apart = False   # the beginnings of stretches spoil the column
    return (gain, size, std, is_most) if is_most or (is_apart and min(gain, (size / std) ** 2) > least_gain) else None


def beside(pieces: list[Piece], terms: tuple[str, ...]) -> list[Piece]:
    """Fit other terms to the stretches of `pieces`, and return them as new pieces."""
    return fitted([(piece.rows, term_modes(piece.rows, terms)) for piece in pieces])


def moved(rows: Rows, lead: float) -> Rows:
    """Return the rows with beta delayed by `lead` [s]."""
    return replace(rows, beta=later(rows, lead)) if lead else rows


def ahead(rows: Rows, terms: tuple[str, ...]) -> float:
    """Return the share of the variance of theta_dot's increments over INCREMENT that is not predicted in JUDGE_FOLDS
    parts of the log, each by the coefficients of the others; 1 of too few."""
    begin, _, y, phi = increments(rows, terms, INCREMENT)
    if len(y) < JUDGE_FOLDS * PER_COEFFICIENT * (len(terms) + 1):
        return 1.0
    fold = np.minimum((JUDGE_FOLDS * (begin - begin[0]) / max(begin[-1] - begin[0], 1e-300)).astype(int),
                      JUDGE_FOLDS - 1)
    left = 0.0
    for k in range(JUDGE_FOLDS):
        out = fold == k
        if not out.any() or out.all():
            continue
        e = y[out] - combined(phi[out], least(phi[~out], y[~out]))
        left += square(e - e.mean())
    whole = square(y - y.mean())
    return min(left / whole, 1.0) if whole > 0.0 else 1.0


def explained(pieces: list[Piece], terms: tuple[str, ...], lead: float = 0.0) -> float:
    """Return the share of theta_dot's changes slower than WIDE_FREQUENCY that terms explain; beta `lead` [s] later."""
    left = whole = 0.0
    for piece in pieces:
        m = piece.modes
        slow = m.frequency < WIDE_FREQUENCY
        phi = piece.shifted(terms, [lead])[:, 0] if lead else term_modes(piece.rows, terms).phi
        left += square(rest(phi[slow], m.y[slow]))
        whole += square(m.y[slow])
    return max(1.0 - left / whole, 0.0) if whole > 0.0 else 0.0


# ---- the input


def lead_of(pieces: list[Piece], terms: tuple[str, ...], rows: Rows, least: float = -MOST_DELAY) -> Lead | None:
    """Return the time [s] by which beta leads its effect, the shift from `least` to MOST_DELAY at which terms leave
    least; None where beta is in no term, or the best shift is at an end."""
    if not any("beta" in term for term in terms):
        return None
    grid = DELAY_STEP * np.arange(round(least / DELAY_STEP), round(MOST_DELAY / DELAY_STEP) + 1)
    at = np.array([piece.unexplained(terms, grid.tolist()) for piece in pieces])
    k = int(np.argmin(np.sum(at, axis=0)))
    if not 0 < k < len(grid) - 1:
        return None
    value, std = float(grid[k]), None
    for step in (DELAY_STEP, 0.25 * DELAY_STEP, 0.1 * DELAY_STEP):
        leads = [value - step, value, value + step]
        low, middle, high = np.sum([piece.unexplained(terms, leads) for piece in pieces], axis=0).tolist()
        bend = low - 2.0 * middle + high
        if not bend > 0.0:   # flatter than the numbers' own error
            break
        value += step * float(np.clip(0.5 * (low - high) / bend, -1.0, 1.0))
        std = step * math.sqrt(2.0 / bend)
    return None if std is None else clocked(pieces, at, Lead(value, std), rows)


def late_input(rows: Rows, terms: tuple[str, ...], rival: tuple[str, ...] = ()) -> Late | None:
    """Return how much later than it is logged beta acts, by the largest likelihood: after a delay, and behind a lag (of
    first order, or two of half its length) where that is more likely than a delay alone. One set of coefficients, with
    linear drifts of a6 and k1, holds for the whole log: in a piece with its own coefficients in which little else
    moves, the controller's instant response to noise would pass for the time at which beta acts.

    None if neither is significant, if the terms of `rival` with a beta that acts at once are more likely, if the lag is
    beyond LAGS, or if stretches are too short to tell. The lag and its deviation are those of the parabola through the
    best of LAGS and its neighbours.
    """
    begins, tried = LAGS_FORGOTTEN * LAGS[-1], list[tuple[float, Lead]]()
    if rows.stretch < begins + MOST_DELAY + STRETCH:
        return None
    terms, rival = (*terms, *slopes_of(terms)), (*rival, *slopes_of(rival)) if rival else ()
    shapes = [(order, lag) for order in (1, 2) for lag in LAGS[order - 1:]]
    for order, each in shapes:
        late_rows = without_beginnings(acting_later(rows, 0.0, each, order), begins)
        pieces = fitted([(late_rows, term_modes(late_rows, terms))])
        left = lead_of(pieces, terms, rows, LEAST_DELAY) or Lead(0.0, math.inf)
        left = left if left.value > 0.0 else Lead(0.0, left.std)
        tried.append((likelihood([moved(piece.rows, left.value) for piece in pieces], terms), left))
    gains = 2.0 * (np.array([each for each, _ in tried]) - tried[0][0])
    best = int(np.argmax(gains))
    if gains[best] > TERM_SIGMAS**2:
        order, largest = shapes[best]
        if largest == LAGS[-1]:
            return None
        near = [best - 1 if shapes[best - 1][0] == order else 0, best, best + 1]
        bend, slope, _ = np.polyfit([shapes[k][1] for k in near], -0.5 * gains[near], 2).tolist()
        if not bend > 0.0:
            return None
        late = Late(tried[best][1], (-0.5 * slope / bend, 1.0 / math.sqrt(2.0 * bend)), order)
    else:
        best, late = 0, Late(tried[0][1])
    if not (late.lag[0] or late.lead.is_sure):
        return None
    return None if rival and tried[best][0] < likelihood([without_beginnings(rows, begins)], rival) else late


def slopes_of(terms: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names tau*term of the linear drifts in time of a6 and k1 that `terms` do not have."""
    return tuple(f"tau*{term}" for term in ("theta", "sin(theta)", "beta")
                 if term in terms and f"tau*{term}" not in terms)


def clocked(pieces: list[Piece], at: np.ndarray, lead: Lead, rows: Rows) -> Lead:
    """Return the lead, with its growth where that of two clocks is sure.

    at (pieces, shifts)   weighted squares that each piece leaves at the shifts that were tried
    The growth is the slope of a line through the leads of single pieces; its deviation is by their scatter about the
    line, if that is more than their own: what a model does not explain makes leads that come and go, and no clock.
    """
    told = list[tuple[float, float, float]]()
    for piece, left in zip(pieces, at, strict=True):
        k = int(np.argmin(left))
        bend = left[k - 1] - 2.0 * left[k] + left[k + 1] if 0 < k < len(left) - 1 else 0.0
        if bend > 0.0:
            off = 0.5 * (left[k - 1] - left[k + 1]) / bend
            told.append((0.5 * float(piece.rows.t[0] + piece.rows.t[-1]),
                         DELAY_STEP * (k - 0.5 * (len(left) - 1) + off), DELAY_STEP * math.sqrt(2.0 / bend)))
    if len(told) < FEWEST_CLOCK:
        return lead
    t, leads, stds = np.array(told).T
    w = 1.0 / stds**2
    middle = float(np.sum(w * t) / np.sum(w))
    centred, mean = t - middle, float(np.sum(w * leads) / np.sum(w))
    below = float(np.sum(w * centred**2))
    grows = float(np.sum(w * centred * leads)) / below
    scatter = float(np.sum(w * (leads - mean - grows * centred) ** 2)) / (len(t) - 2)
    if abs(grows) > SHIFT * math.sqrt(max(scatter, 1.0) / below) and abs(grows) * float(np.ptp(t)) > rows.period:
        return Lead(mean, lead.std, grows, middle)
    return lead


def placebo(pieces: list[Piece], terms: tuple[str, ...], rows: Rows, lead: Lead | None) -> bool:
    """Whether beta of another time explains the motion about as well as beta, shifted to when it acts, does.

    Each has the noise that is most likely with it: what a beta that acts does not explain is white, what another one
    does not explain wanders. An input that repeats explains as much a period later, and is left out.
    """
    if not any("beta" in term for term in terms):
        return False
    few = [pieces[k] for k in np.unique(np.linspace(0, len(pieces) - 1, MOST_PLACEBO).round().astype(int))]

    def of(columns: list[np.ndarray]) -> np.ndarray:
        """Return the likelihoods (k,) of k sets of columns (n, k, q), one array a piece."""
        each = [[noise.largest for noise in noise_likelihoods([replace(piece.modes, phi=phi[:, k])
                                                                for k in range(phi.shape[1])])]
                for piece, phi in zip(few, columns, strict=True)]
        return np.asarray(np.max(np.sum(each, axis=0), axis=(1, 2)))

    others = [k for k, term in enumerate(terms) if "beta" not in term]
    none = float(of([piece.modes.phi[:, None, others] for piece in few])[0])
    moved = [np.roll(rows.beta, round(share * len(rows.t))) for share in SHIFTS]
    moved = [each for each in moved if not abs(np.corrcoef(each, rows.beta)[0, 1]) > SAME_INPUT]
    own = float(of([piece.modes.phi[:, None] for piece in few])[0])
    if lead is not None:
        own = max(own, float(of([piece.shifted(terms, [lead.at(piece.rows)]) for piece in few])[0]))
    at = [rows.within(piece.rows) for piece in few]
    most = float(np.max(of([with_betas(piece.rows, piece.modes, terms, [each[part] for each in moved])
                            for piece, part in zip(few, at, strict=True)]), initial=none)) if moved else none
    return own - most < max(0.5 * TERM_SIGMAS**2, BEYOND * (own - none))


# ---- a window


def moved_by(rows: Rows, terms: tuple[str, ...], fit: Fit, lack: Lack, m: Modes) -> np.ndarray:
    """Return by how much the coefficients (q,) of a window would move if its terms had what they lack."""
    w, size = 1.0 / np.sqrt(fit.variance), lack.size or 0.0
    phi = m.phi * w[:, None]
    if lack.what == "delay":
        other = with_betas(rows, m, terms, [later(rows, size)])[:, 0] * w[:, None]
        return least(other, m.y * w) - least(phi, m.y * w)
    return size * least(phi, term_modes(rows, (lack.what,)).phi[:, 0] * w)


def against(rows: Rows, terms: tuple[str, ...], xi: np.ndarray, std: np.ndarray, fit: Fit, m: Modes,
            lacks: list[Lack]) -> list[Lack]:
    """Return those of `lacks` for which a window with coefficients xi (q,) +- std (q,) is refused: with a placebo all,
    a clock, what halves the error of held-out rows, and what would move a coefficient by more than its std and more
    than RELATIVE_TOLERANCE of itself and of the largest term."""
    sizes = np.sqrt(np.sum(m.phi**2, axis=0))
    largest = RELATIVE_TOLERANCE * float(np.max(np.abs(xi) * sizes, initial=0.0))
    if any(lack.what == "placebo" for lack in lacks):
        return lacks
    found = []
    for lack in lacks:
        if lack.is_most or lack.what == "clock":
            found.append(lack)
            continue
        by = np.abs(moved_by(rows, terms, fit, lack, m))
        if np.any((by > np.maximum(std, RELATIVE_TOLERANCE * np.abs(xi))) & (by * sizes > largest)):
            found.append(lack)
    return found


def is_driving(value: float, std: float, parts: np.ndarray, k: int) -> bool:
    """Whether a rate damping has the wrong sign and counts among the parts (q,) of the motion, of which it is number k:
    then beta answers the rate, and little else moves."""
    return value > WRONG * std and bool(parts[k] > DRIVES * np.max(parts))


def left_over(fit: Fit, m: Modes) -> tuple[float | None, Lack | None]:
    """Return (p-value of white residuals in the bands that coefficients rest on, None of few; a Lack if not white)."""
    frequency, squares, many, share = spectrum(fit, m, FINE_BANDS)
    asked = share > RELATIVE_TOLERANCE
    squares = np.maximum(squares, 1.0)   # less noise than was taken widens the deviations, and is no contradiction
    p = whiteness(squares[asked], many[asked])
    if p is None or p >= WHITENESS_P:
        return p, None
    worst = int(np.argmax(np.where(asked, many * (squares - 1.0 - np.log(squares)), 0.0)))
    return p, Lack("unexplained", size=float(frequency[worst]), after=float(squares[worst]))
