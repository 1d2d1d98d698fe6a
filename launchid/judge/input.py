"""Ask when beta acts, and whether beta of another time explains as much (placebo)."""

import math
from dataclasses import replace

import numpy as np

from ..placebo import is_placebo, of_other_times
from ..sums import along, products
from ..weakform.estimate import slopes_of
from ..weakform.fit import MIN_COLUMN_LEFT, noise_likelihoods
from ..weakform.late import LAGS_FORGOTTEN, SHIFT, Late, Lead, acting_later, with_betas, without_beginnings
from ..weakform.modes import term_modes, together
from ..weakform.pieces import Piece, fitted, likelihood, moved
from ..weakform.rows import Rows
from .table import TESTS

STRETCH = TESTS["stretches without a gap"].limit  # s
TERM_SIGMAS = TESTS["no further term"].limit  # standard deviations
MOST_DELAY = 0.3     # s either way
DELAY_STEP = 0.0125  # s of the first search
LAGS = (0.0, 0.01, 0.02, 0.035, 0.055, 0.08, 0.12, 0.18, 0.27, 0.4)  # s of a servo or motor, that are tried
GAUSS_NEWTON_STEPS = 4
NUDGE = 0.05         # of the lag: of a difference quotient
LEAST_DELAY = -0.025  # s behind a lag: beta acts no sooner, and the best may lie at none
FEWEST_CLOCK = 6     # pieces that say when beta acts, for a clock that runs slow
SHIFTS = tuple(0.1 + 0.8 * k / 19 for k in range(20))  # of the log, circular: placebos
SAME_INPUT = 0.9     # |correlation| of a shifted beta with itself: an input that repeats is no placebo
BEYOND = TESTS["no placebo"].limit  # of the likelihood that beta gains
MOST_PLACEBO = 12    # pieces, evenly over the log, of which placebos are asked


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
    beyond LAGS, or if stretches are too short to tell. The search among LAGS is by a parabola through the best and its
    neighbours; `refined` takes it from there.
    """
    begins = LAGS_FORGOTTEN * LAGS[-1]
    if rows.stretch < begins + MOST_DELAY + STRETCH:
        return None
    terms, rival = (*terms, *slopes_of(terms)), (*rival, *slopes_of(rival)) if rival else ()

    def tried(order: int, lag: float) -> tuple[float, Lead]:
        """Return (the logarithm of the likelihood behind a lag, the delay that is most likely with it)."""
        def delayed(lead: float) -> np.ndarray:
            return without_beginnings(acting_later(rows, lead, lag, order), begins).beta

        late_rows = without_beginnings(acting_later(rows, 0.0, lag, order), begins)
        pieces = [replace(piece, delayed=delayed if rows.is_held else None)
                  for piece in fitted([(late_rows, term_modes(late_rows, terms))])]
        left = lead_of(pieces, terms, rows, LEAST_DELAY) or Lead(0.0, math.inf)
        left = left if left.value > 0.0 else Lead(0.0, left.std)
        return likelihood([moved(piece, left.value) for piece in pieces], terms), left

    shapes = [(order, lag) for order in (1, 2) for lag in LAGS[order - 1:]]
    found = [tried(*shape) for shape in shapes]
    gains = 2.0 * (np.array([each for each, _ in found]) - found[0][0])
    best = int(np.argmax(gains))
    largest, late = found[0][0], Late(found[0][1])
    if gains[best] > (0.0 if rows.is_command else TERM_SIGMAS**2):   # behind a command there is a servo
        order, largest_lag = shapes[best]
        if largest_lag == LAGS[-1]:
            return None
        near = [best - 1 if shapes[best - 1][0] == order else 0, best, best + 1]
        bend, slope, _ = np.polyfit([shapes[k][1] for k in near], -0.5 * gains[near], 2).tolist()
        if not bend > 0.0:
            return None
        late = refined(rows, terms, Late(found[best][1], (-0.5 * slope / bend, 1.0 / math.sqrt(2.0 * bend)), order),
                       begins)
        largest = found[best][0]
    if not (late.lag[0] or late.lead.is_sure):
        return None
    return None if rival and largest < likelihood([without_beginnings(rows, begins)], rival) else late


def refined(rows: Rows, terms: tuple[str, ...], late: Late, begins: float) -> Late:
    """Return the delay and the lag at which terms leave least, with their deviations, by Gauss and Newton: one
    regression on the terms and on what either changes of them. Rows of the first `begins` [s] of stretches are left
    out."""
    lead, lag = late.lead.value, late.lag[0]
    for _ in range(GAUSS_NEWTON_STEPS):
        acting = without_beginnings(acting_later(rows, lead, lag, late.order), begins)
        m = term_modes(acting, terms)
        fit = fitted([(acting, m)])[0].fit
        if fit.is_singular:
            return late
        step = NUDGE * lag
        betas = [without_beginnings(acting_later(rows, lead + by, lag + lag_by, late.order), begins).beta
                 for by, lag_by in ((-step, 0.0), (step, 0.0), (0.0, -step), (0.0, step))]
        at = with_betas(acting, m, terms, betas) @ fit.xi
        phi = np.column_stack([m.phi, (at[:, 1::2] - at[:, ::2]) / (2.0 * step)]) / np.sqrt(fit.variance)[:, None]
        size = np.sqrt(np.maximum(np.sum(phi**2, axis=0), 1e-300))
        phi /= size
        inverse = np.linalg.pinv(products(phi, phi), MIN_COLUMN_LEFT, hermitian=True)
        by_lead, by_lag = (inverse @ along(phi, m.y / np.sqrt(fit.variance)) / size)[-2:].tolist()
        covariance = (inverse / np.outer(size, size))[-2:, -2:]
        if not min(covariance[0, 0], covariance[1, 1]) > 0.0:   # the motion does not tell one of them
            return late
        moved_by = max(by_lead, -lead)   # beta acts no sooner than it is asked for
        by_lag += covariance[0, 1] / covariance[0, 0] * (moved_by - by_lead)
        lead, lag = lead + moved_by, lag * min(max(1.0 + by_lag / lag, 0.5), 2.0)
    trade = covariance[0, 1] / covariance[1, 1]
    left = max(covariance[0, 0] - trade * covariance[0, 1], 0.0)
    return Late(Lead(lead, math.sqrt(left)), (lag, math.sqrt(covariance[1, 1])), late.order, trade)


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
    """Whether beta taken from another time of the log explains the motion about as well as beta at the time at which it
    acts.

    Each has one set of coefficients, with which every beta is an input of one sign, and the noise that is most likely
    with it: what a beta that acts does not explain is white, what another one does not explain wanders. An input that
    repeats explains as much a period later, and is left out.
    """
    if not any("beta" in term for term in terms):
        return False
    few = [pieces[k] for k in np.unique(np.linspace(0, len(pieces) - 1, MOST_PLACEBO).round().astype(int))]
    whole = together([piece.modes for piece in few])

    def of(columns: list[np.ndarray]) -> np.ndarray:
        """Return the likelihoods (k,) of k sets of columns (n, k, q), one array a piece."""
        phi = np.concatenate(columns)
        noises = noise_likelihoods([replace(whole, phi=phi[:, k]) for k in range(phi.shape[1])])
        return np.array([float(np.max(noise.largest)) for noise in noises])

    still = [k for k, term in enumerate(terms) if "beta" not in term]
    none = float(of([piece.modes.phi[:, None, still] for piece in few])[0])
    moved = [each for each in of_other_times(rows.beta, SHIFTS)
             if not abs(np.corrcoef(each, rows.beta)[0, 1]) > SAME_INPUT]
    own = float(of([piece.modes.phi[:, None] for piece in few])[0])
    if lead is not None:
        own = max(own, float(of([piece.shifted(terms, [lead.at(piece.rows)]) for piece in few])[0]))
    at = [rows.within(piece.rows) for piece in few]
    others = of([with_betas(piece.rows, piece.modes, terms, [each[part] for each in moved])
                 for piece, part in zip(few, at, strict=True)]) if moved else np.zeros(0)
    return is_placebo(own - none, others - none, BEYOND, 0.5 * TERM_SIGMAS**2)
