"""Fit the windows of a log, with deviations of its own noise, of drifts, and of a beta that acts at another time."""

import math
from dataclasses import replace

import numpy as np

from launchid_core import Estimate

from ..chi_square import quantile
from .bands import NUISANCES, disagreements
from .fit import SPAN, Fit, Prior, gls_of_all, least, least_squares_covariance, noise_likelihoods
from .late import with_betas
from .modes import Modes, term_modes
from .pieces import Whole
from .rows import Rows

POOLED = 0.2         # of the likelihood of the noise's ratios in the whole log, that counts in each of its windows
UNTRUE = 1.5         # times what its deviations say, that the spread of coefficients that stand still may be
UNLIKE = 1.0         # mean square of neighbours' differences over the variance, 2 of what is white, beyond which
#                      coefficients do not change but scatter
FEWEST_ALIKE = 6     # pieces, of which that is asked
CHANGED = 0.999       # of chi square: a term that changes less from piece to piece may be constant
SCATTERED = 0.95     # the same of a term that a nominal says is constant
CHANCE_DRIFT = 6.0   # chi square of two, 95 %: what a drift of a6 and k1 moves them by beyond is in the deviations


def slopes_of(terms: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names tau*term of the linear drifts in time of a6 and k1 that `terms` do not have."""
    return tuple(f"tau*{term}" for term in ("theta", "sin(theta)", "beta")
                 if term in terms and f"tau*{term}" not in terms)


def window_fits(rows: Rows, windows: list[tuple[Rows, tuple[str, ...], Modes | None]],
                whole: Whole, doubts: list[np.ndarray], is_weak: bool) -> list[Fit | None]:
    """Return the fits of windows (rows, terms, regression), None of too few rows: with noise ratios by their own
    likelihood and POOLED of the log's, optional terms as the whole log tells them, and covariances widened by drifts of
    a6 and k1, by other betas (`doubts`), and in the weak form by scatter."""
    fits: list[Fit | None] = [None] * len(windows)
    grid = len(SPAN), len(SPAN)
    pooled = POOLED * np.sum([np.zeros(grid), *(piece.noise.restricted for piece in whole.pieces)], axis=0)
    for is_whole in (True, False):
        at = [k for k, (part, _, m) in enumerate(windows) if m and (len(part.t) > 0.9 * len(rows.t)) == is_whole]
        regressions = [m for k in at if (m := windows[k][2])]
        prior: Prior = () if is_whole else [(whole.terms.index(term), *known) for term, known in whole.known.items()]
        noises = noise_likelihoods(regressions)
        made = gls_of_all(regressions, [noise.restricted + pooled for noise in noises], noises, prior)
        for k, each in zip(at, made, strict=True):
            fits[k] = each
    rate, scatter = changes_of(whole)
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


def changes_of(whole: Whole) -> tuple[dict[str, float], dict[str, float]]:
    """Return by term (how fast [its unit/s] a6 and k1 change in the log, the variances by which coefficients scatter).

    The spread of the pieces' own beyond their deviations (DerSimonian and Laird 1986) is a change, as of one that goes
    up and down once. Where neighbours are as unlike as others (von Neumann 1941) it is scatter too, which no vehicle
    does and the deviations of windows do not know; so are the whole spread of coefficients that are constant, as a
    nominal has them, and what slow modes say otherwise than all (`bands`). Nothing is found where it may be chance.
    """
    pieces, change = whole.pieces, dict[str, float]()
    scatter = {term: each for term, each in zip(whole.terms, disagreements(pieces).tolist(), strict=False) if each}
    for term, each in whole.doubt.items():
        scatter[term] = scatter.get(term, 0.0) + each
    span = pieces[-1].rows.t[0] - pieces[0].rows.t[0] if pieces else 0.0
    for k, term in enumerate(whole.terms):
        told = [(p.fit.xi[k], p.fit.covariance[k, k]) for p in pieces if not p.fit.is_singular]
        asked = term not in NUISANCES if whole.is_constant else term in ("theta", "sin(theta)", "beta")
        if not asked or len(told) < 2 or not span > 0.0:
            continue
        x, v = np.array(told).T
        w = 1.0 / v
        free, spread = len(x) - 1, float(np.sum(w * (x - np.sum(w * x) / np.sum(w)) ** 2))
        if spread > (quantile(SCATTERED, free) if whole.is_constant else UNTRUE * quantile(CHANGED, free)):
            beyond = float((spread - free) / (np.sum(w) - np.sum(w**2) / np.sum(w)))
            w = 1.0 / (v + beyond)
            variance = np.average((x - np.average(x, weights=w)) ** 2, weights=w)
            apart = np.average(np.diff(x) ** 2, weights=1.0 / (v[1:] + v[:-1] + 2.0 * beyond))
            if whole.is_constant or (len(x) >= FEWEST_ALIKE and apart > UNLIKE * variance):
                scatter[term] = scatter.get(term, 0.0) + beyond
            if not whole.is_constant:
                change[term] = 2.0 * math.pi / span * math.sqrt(beyond)
    return change, scatter


def drift(bent: Fit, fit: Fit, terms: tuple[str, ...], rate: dict[str, float]) -> np.ndarray:
    """Return the covariance (q, q) that drifts of a6 and k1 within a window add to that of its coefficients: of drifts
    at the `rate` [1/s] that the log shows, and of what lines in time change the coefficients by beyond chance (Hausman
    1978).

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


def widened(e: Estimate, m: Modes, fit: Fit, terms: tuple[str, ...], formulation: str) -> Estimate:
    """Return the estimate of `difference` or `integral` with no smaller deviations than the log's own noise gives such
    least squares: their own are of the autocorrelation of a window's residuals, of which it shows few periods."""
    if not e.valid or formulation not in ("difference", "integral") or fit.is_singular:
        return e
    own = np.sqrt(np.diag(least_squares_covariance(m, fit.variance, formulation)))
    std = {term: max(e.terms_std.get(term, 0.0), float(value)) for term, value in zip(terms, own, strict=True)}
    return replace(e, terms_std={term: std.get(term, value) for term, value in e.terms_std.items()},
                   a6_std=std.get("theta", e.a6_std), k1_std=std.get("beta", e.k1_std))
