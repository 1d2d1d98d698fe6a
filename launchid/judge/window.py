"""Judge one window: what the log lacks that would move its numbers, whiteness, vague numbers, agreement."""

import math
from dataclasses import dataclass, replace

import numpy as np

from launchid_core import Estimate, EstimateStatus

from ..sums import combined, square
from ..weakform.bands import NUISANCES
from ..weakform.fit import Fit, least, spectrum, whiteness
from ..weakform.late import later, with_betas
from ..weakform.modes import Modes, increments, term_modes
from ..weakform.rows import Rows
from .lack import LIBRARY, Lack
from .refusal import active_terms, refused
from .table import TESTS
from .terms import INCREMENT, RELATIVE_TOLERANCE

WRONG = TESTS["damping of a right sign"].limit  # standard deviations
SMALL_TERMS = (*LIBRARY, "beta_ddot")   # that may act a little beside an answer
SMALL = 0.3          # of a coefficient, by which something lacking moves it, that its deviation may hold
MOVES = ("theta", "sin(theta)")    # the term that a6 multiplies, the first that there is
DRIVES_BY = ("beta", "beta^2")     # the same of k1
DRIVES = 0.2         # of the largest term, that a damping of the wrong sign is: less is drawn from disturbances
FINE_BANDS = 24      # in which the rest is asked whether it is white
WHITENESS_P = TESTS["white rest"].limit  # p-value
ALIKE = TESTS["a6 and k1 apart"].limit  # |correlation|
VAGUE = 0.3          # relative deviation of both, of which the correlation is asked
WORTH = TESTS["numbers above noise"].limit  # of the largest term
HELD_OUT_PARTS = 3   # the last of so many parts of a window is held out for its `fit`
LEAST_HELD_OUT = 5   # increments without overlap in it: below, its share of the variance is chance
AGREEMENT_SIGMAS = TESTS["agreement with the weak form"].limit  # standard deviations
CONTRADICTING_RATIO = 3.0  # times as large a deviation of the weak form contradicts that of another formulation


@dataclass(frozen=True)
class WindowFit:
    """Share of variance of a window's last third that the rest predicts, p-value of white residuals, or None."""

    r2: float | None = None
    whiteness: float | None = None


def moved_by(rows: Rows, terms: tuple[str, ...], fit: Fit, lack: Lack, m: Modes) -> np.ndarray:
    """Return by how much the coefficients (q,) of a window would change if what its terms miss (`lack`: a further term,
    or a delay of beta) were in the regression."""
    w, size = 1.0 / np.sqrt(fit.variance), lack.size or 0.0
    phi = m.phi * w[:, None]
    if lack.what == "delay":
        other = with_betas(rows, m, terms, [later(rows, size)])[:, 0] * w[:, None]
        return least(other, m.y * w) - least(phi, m.y * w)
    return size * least(phi, term_modes(rows, (lack.what,)).phi[:, 0] * w)


def against(rows: Rows, terms: tuple[str, ...], xi: np.ndarray, std: np.ndarray, fit: Fit, m: Modes,
            lacks: list[Lack]) -> list[Lack]:
    """Return those of `lacks` because of which a window with coefficients xi (q,) +- std (q,) is refused: all of them
    if one is a placebo; a clock; what halves the error of held-out rows; what would change a coefficient by more than
    its std and more than RELATIVE_TOLERANCE of itself and of the largest term."""
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


def small_effect(rows: Rows, terms: tuple[str, ...], fit: Fit, m: Modes, lacks: list[Lack]) -> np.ndarray | None:
    """Return by how much the coefficients (q,) would change with the terms that are lacking; None if that is more than
    SMALL of one that is no nuisance, if what is lacking is no term beside the others, or if it halves the error of
    held-out rows."""
    if any(lack.what not in SMALL_TERMS or lack.is_most for lack in lacks):
        return None
    by = np.sqrt(np.sum([moved_by(rows, terms, fit, lack, m) ** 2 for lack in lacks], axis=0))
    asked = np.array([term not in NUISANCES for term in terms])
    return by if np.all((by <= SMALL * np.abs(fit.xi)) | ~asked) else None


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
    pair = [next((place[term] for term in names if term in place), -1) for names in (MOVES, DRIVES_BY)]
    sizes, relative = np.sqrt(np.sum(m.phi**2, axis=0)), std / np.abs(fit.xi)
    worth = std * sizes / np.max(np.abs(fit.xi) * sizes)
    if any(worth[k] > WORTH for k in pair if k >= 0) or (pair[1] >= 0 and relative[pair[1]] > 1.0):
        return replace(blank, status=EstimateStatus.LOW_INFORMATION)   # a beta that may do nothing may be any column
    if min(pair) >= 0:
        correlation = covariance[pair[0], pair[1]] / std[pair[0]] / std[pair[1]]
        if abs(correlation) > ALIKE and np.all(relative[pair] > VAGUE):
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


def agrees(m: Modes, fit: Fit, xi: np.ndarray, std: np.ndarray) -> bool:
    """Whether coefficients xi (q,) +- std (q,) of another formulation are those of the log's own noise, and are not
    said to be known far better: nothing is known better than by weights."""
    own = np.sqrt(np.diag(fit.covariance))
    off = np.abs(xi - fit.xi)
    sizes = np.sqrt(np.sum(m.phi**2, axis=0))
    counts = RELATIVE_TOLERANCE * np.max(np.abs(fit.xi) * sizes) / np.maximum(sizes, 1e-300)
    differ = (off > np.maximum(AGREEMENT_SIGMAS * np.hypot(own, std), RELATIVE_TOLERANCE * np.abs(fit.xi))) \
        & (off > counts)
    return not np.any(differ | ((own > CONTRADICTING_RATIO * std) & (own > counts)))
