"""The proposal of what the catalogue does not hold: a missing term of the plant, found by sparse regression.

The angular acceleration that the filter had to add, row by row, is regressed on library terms of theta, theta_dot and
beta by the estimator's own sequentially thresholded least squares (Brunton, Proctor and Kutz 2016).  The filter's
acceleration is late and too small, so the regression only proposes: each term is then fitted as the effect
`missing_term` like any cause, and judged by the same evidence.
"""

from dataclasses import dataclass

import numpy as np

from launchid_core import Config, Estimator, Sample

from ..causes import Cause, Hypothesis, missing_term
from ..model.nuisance import Problem
from .fit import Fit
from .profile import Model
from .scan import scan
from .selection import FAR, FURTHER, SINE, Say, Selection, select_from
from .weather import in_its_weather

TERMS = ("1", "theta", "theta_dot", "beta", "theta^2", "theta*theta_dot", "theta*beta", "theta_dot^2", "theta_dot*beta",
         "beta^2", "theta^3", "theta_dot^3", "beta^3")
AVERAGED = 0.2                 # s over which the acceleration is averaged
SPARSE = 0.15                  # of a coefficient, everything scaled to unit RMS: smaller is not proposed
OWN = ("theta", "beta")        # terms that the nominal's plant has already
MOST_TERMS = 3
SCANNED = 4                    # terms proposed by their score beside the regression's


@dataclass(frozen=True, eq=False)
class Proposal:
    """A model with missing terms: its equation in words, whether it passed every test is said by the verdict."""

    model: Model
    equation: str

    def __str__(self) -> str:
        return self.equation


def acceleration(fitted: Fit) -> np.ndarray:
    """The acceleration (n,) [rad/s^2] that the filter had to add to the rate's derivative at each row."""
    e = np.where(np.isfinite(fitted.innovations), fitted.innovations, 0.0)
    return np.einsum("kc,kc->k", fitted.filter.gains[:, 1, :], e) / fitted.record.period


def sparse_terms(fitted: Fit) -> list[str]:
    """Terms that sparse regression keeps for the acceleration the filter had to add."""
    record = fitted.record
    size = max(1, round(AVERAGED / record.period))
    blocks = record.rows // size
    columns = np.column_stack([fitted.states[:, :3], acceleration(fitted)])[:blocks * size]
    means = columns.reshape(blocks, size, 4).mean(axis=1)
    scale = np.sqrt(np.mean(means**2, axis=0))
    if blocks < 2 * len(TERMS) or not np.all(scale > 0.0) or not np.all(np.isfinite(scale)):
        return []
    scaled = means / scale
    period = size * record.period
    terms = tuple(term for term in TERMS if term not in OWN)
    estimator = Estimator(Config(window=blocks * period, sample_period=period, library=terms, formulation="measured",
                                 solver="stls", threshold=SPARSE))
    for k, (theta, theta_dot, beta, theta_ddot) in enumerate(scaled.tolist()):
        estimator.update(Sample(k * period, theta, theta_dot, beta, theta_ddot))
    estimate = estimator.estimate()
    if estimate is None or not estimate.valid:
        return []
    return [term for j, term in enumerate(estimate.terms) if estimate.support[j, 1]]


def proposed(nominal: Model) -> list[Hypothesis]:
    """Missing terms worth a fit: the sparse regression's, and those with the best scores."""
    fitted = nominal.fit
    theta = fitted.states[:, 0]
    terms = [term for term in TERMS if term not in OWN]
    if np.all(np.isfinite(theta)) and float(np.max(np.abs(theta))) > FAR:
        terms.append(SINE)
    problem = Problem(fitted.record, fitted.filter)
    scores = []
    for term in terms:
        best = scan(problem, fitted, (missing_term(term),))
        scores.append((best[0].gain if best else 0.0, term))
    scored = [term for score, term in sorted(scores, reverse=True)[:SCANNED] if score > FURTHER]
    chosen = [*sparse_terms(fitted), *scored]
    return [missing_term(term) for term in dict.fromkeys(chosen)]


def propose(of: Selection, threshold: float, say: Say) -> tuple[Proposal, Selection] | None:
    """The nominal of a selection with the missing terms that its log asks for, in the weather that is still needed
    then; None if none reaches the threshold."""
    say("missing terms")
    found = select_from(of.nominal, proposed(of.nominal), threshold, MOST_TERMS, say)
    found = in_its_weather(of, found, threshold, say)
    if not found.model.causes:
        return None
    return Proposal(found.model, equation(found.model.causes)), found


def equation(causes: tuple[Cause, ...]) -> str:
    """The terms that are missing in theta_ddot, in words."""
    parts = []
    for cause in causes:
        value, term = cause.values[0], dict(cause.hypothesis.fixed)["term"]
        parts.append(f"{'+' if value >= 0.0 else '-'}{abs(value):.4g}" + ("" if term == "1" else f" {term}"))
    return "missing: " + " ".join(parts)

