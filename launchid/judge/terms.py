"""Ask which further term a log shows beside those of an answer."""

import numpy as np

from ..sums import combined, square
from ..weakform.fit import least, rest
from ..weakform.late import SHIFT, Lead
from ..weakform.modes import FAST_THETA, increments, term_modes
from ..weakform.pieces import JUDGE_PIECE, PER_COEFFICIENT, Piece, beside, fitted, likelihood, moved, pooled
from ..weakform.rows import Rows
from .input import TERM_SIGMAS, lead_of
from .lack import LACKING, Lack
from .table import TESTS

RELATIVE_TOLERANCE = TESTS["what is lacking moves little"].limit  # relative
ONE_COLUMN = 0.98    # of a column's square that others explain (|correlation| 0.99): it is one with them in this log
SIMPLER = 0.7        # of the gain of the best term, for which a simpler one is preferred
SEEN = 5.0           # times its sensor's noise: less of a fast theta is told from it by chance
RUNS = 3.0           # times its fast part, that all of theta is where it runs along a flight path
LARGE = 0.5          # rad: below it sin(theta) is theta within 4 %
WIDE_FREQUENCY = 15.0  # rad/s: shares are told of changes over 0.2 s and more
MOST_LACKS = 3       # that are named
MOST_OF_ERROR = TESTS["rows left out are predicted"].limit  # of their error
JUDGE_FOLDS = 3      # parts of the log that are left out in turn
INCREMENT = 0.2      # s, of theta_dot, that a fit is shown to predict: sensor noise is small beside it


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
             and (rows.has_theta or term not in (FAST_THETA, "sin(theta)"))
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
        shifted = {shift: [moved(piece, shift) for piece in pieces]
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
