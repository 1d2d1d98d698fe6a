"""Compare what slow modes of a log say of the coefficients with what faster ones say.

The weak form weighs each frequency by its noise.  If the equation is true, slow and fast motion have the same
coefficients, and those of the slow modes alone differ from those of all by chance (Hausman 1978).  What an equation
lacks (a compliance, a motor's or a sensor's filter, a backlash, a friction that sticks) acts more at some frequencies
than at others.  It is no noise: no length of the log makes its effect on the coefficients less.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .fit import Fit, passed_by, whitened_columns
from .modes import FRICTION, Modes
from .pieces import PER_COEFFICIENT, Piece

CUTS = 16            # frequencies, evenly in their logarithm, below which modes are called slow
APART = 4.0          # standard deviations, beyond which a difference is no chance: 1e-3 for CUTS and two coefficients
TELLS = 0.05         # of what is known of a coefficient, that slow modes tell and that faster ones tell: else nothing
#                      is compared
NUISANCES = ("1", "theta_dot", FRICTION)   # terms that are fitted beside those that are asked for


class Bands(NamedTuple):
    """What the modes of each of p pieces below each of k cuts [rad/s] tell of q coefficients; the last cut is inf.

    information (p, k, q, q)  on the coefficients;  white (p, k, q, q)  the variance of their score (p, k, q), which is
    taken at each piece's coefficients by all modes;  modes (k,)  how many there are in all pieces
    """

    cuts: np.ndarray
    information: np.ndarray
    white: np.ndarray
    score: np.ndarray
    modes: np.ndarray


def bands_of(pieces: Sequence[Piece]) -> Bands | None:
    """Return the bands of fitted pieces; None if no piece tells its coefficients."""
    told = [piece for piece in pieces if not piece.fit.is_singular]
    if not told:
        return None
    frequencies = np.concatenate([piece.modes.frequency for piece in told])
    cuts = np.append(np.geomspace(frequencies.min(), frequencies.max(), CUTS + 2)[1:-1], math.inf)
    parts = [_below(piece.modes, piece.fit, cuts) for piece in told]
    information, white, score, count = (np.stack(each) for each in zip(*parts, strict=True))
    return Bands(cuts, information, white, score, np.sum(count, axis=0))


def _below(m: Modes, fit: Fit, cuts: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return a piece's part of `Bands`: information, white, score, count."""
    whitened = whitened_columns(m, fit.variance)
    of_square, of_motion, of_turn = passed_by(m)
    passed, turned = m.step**2 * of_square / fit.variance, of_turn / fit.variance
    score = whitened * fit.whitened[:, None] + np.outer(passed, m.sensor @ fit.xi) \
        + np.outer(turned, m.turned * fit.xi) + np.outer(of_motion / fit.variance, m.motion) \
        - np.outer(fit.disturbed, m.ahead)
    below = [m.frequency <= cut for cut in cuts.tolist()]
    white = np.stack([whitened[at].T @ whitened[at] for at in below])
    sensed, moved = (np.array([float(np.sum(x[at])) for at in below])[:, None, None] for x in (passed, turned))
    return (white - m.sensor * sensed - np.diag(m.turned) * moved, white,
            np.stack([np.sum(score[at], axis=0) for at in below]), np.array([np.count_nonzero(at) for at in below]))


def differences(bands: Bands, top: int) -> tuple[np.ndarray, np.ndarray]:
    """Return by how much the coefficients of modes below each cut differ from those of modes below cut number `top`,
    and the standard deviations of that, (top, q) each; a deviation is inf where nothing is compared.

    Each piece has its own coefficients: what differs between pieces is a change of the vehicle, and is not asked here.
    """
    q = bands.score.shape[2]
    off, std = np.zeros((top, q)), np.full((top, q), math.inf)
    if not _tells(bands.information[:, top]):
        return off, std
    of_top = np.linalg.inv(bands.information[:, top])
    moved = np.einsum("pqr,pr->pq", of_top, bands.score[:, top])
    known = np.diag(np.linalg.inv(np.sum(bands.information[:, top], axis=0)))
    for k in range(top):
        whole = np.sum(bands.information[:, k], axis=0)
        if bands.modes[k] < PER_COEFFICIENT * q or not _tells(whole[None]):
            continue
        white, inverse = bands.white[:, k], np.linalg.inv(whole)
        score = np.sum(bands.score[:, k] - np.einsum("pqr,pr->pq", bands.information[:, k], moved), axis=0)
        spread = np.sum(white - white @ of_top @ white, axis=0)
        variance, own = np.diag(inverse @ spread @ inverse), np.diag(inverse)
        asked = (own * TELLS < known) & (variance > TELLS * own)
        off[k] = inverse @ score
        std[k, asked] = np.sqrt(variance[asked])
    return off, std


def _tells(information: np.ndarray) -> bool:
    """Whether matrices (p, q, q) of information tell every coefficient."""
    size = np.sqrt(np.maximum(np.einsum("pkk->pk", information), 1e-300))
    return bool(np.all(np.linalg.eigvalsh(information / (size[:, :, None] * size[:, None, :])) > 1e-9))


def agreeing_top(pieces: Sequence[Piece], terms: Sequence[str]) -> float:
    """Return the highest frequency [rad/s] below which slow and fast modes agree on the terms that are no NUISANCES, or
    which leaves a piece just modes enough to be tested; inf if all modes agree."""
    bands, asked = bands_of(pieces), [k for k, term in enumerate(terms) if term not in NUISANCES]
    if bands is None or not asked:
        return math.inf
    tops = np.flatnonzero(bands.modes >= PER_COEFFICIENT * (len(terms) + 1) * len(bands.score)).tolist()
    for top in reversed(tops):
        off, std = differences(bands, top)
        if np.all(np.abs(off[:, asked]) <= APART * std[:, asked]):
            return float(bands.cuts[top])
    return float(bands.cuts[tops[0]]) if tops else math.inf


def disagreements(pieces: Sequence[Piece]) -> np.ndarray:
    """Return the variances (q,) by which coefficients of slow modes differ from those of all, beyond chance; 0 where
    they agree."""
    bands = bands_of(pieces)
    if bands is None:
        return np.zeros(0)
    off, std = differences(bands, CUTS)
    sigmas = np.abs(off) / std
    worst = np.argmax(sigmas, axis=0), np.arange(off.shape[1])
    return np.where(sigmas[worst] > APART, np.maximum(off[worst] ** 2 - std[worst] ** 2, 0.0), 0.0)

