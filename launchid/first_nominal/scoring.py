"""Maximum likelihood by Fisher scoring, and covariances that hold when the innovations are not white.

Score and information are the likelihood's (`likelihood.estimate`).  Derivatives for the coefficients are differences of
innovations with the gains held, those for the noise levels, the delay and the servo differences of two runs.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from ..likelihood.estimate import fisher_information, score
from ..sums import products
from .channels import Channels
from .model import Model, Pass, run, slopes

LOG_DIFFERENCE = 0.02  # of a logarithm
DELAY_SHARE = 0.05     # of a sample period: the same for the delay
LOG_STEP = 1.0         # of a logarithm
DELAY_MOST = 2.0       # sample periods that the delay moves in one step
DONE = 0.02            # nats that the next step would gain
TRIALS = 5             # of a step, shorter and shorter
MOST_STEPS = 25        # a fit that has not ended by then is compared as it is
SCORE_BLOCK = 0.5      # s: of the scores that are summed before their correlation is asked for
TINY = 1e-30        # of a number that is sought: it is none
BEYOND_ANY = 1e30   # of a number that is sought: no data tell it


@dataclass(frozen=True, eq=False)
class Fitted:
    """A model at its maximum of the likelihood, the filter's pass there, and covariance (p, p) of (linear,
    offsets, free): of logarithms of the free numbers, but for the delay."""

    model: Model
    final: Pass    # of the filter, at the maximum
    covariance: np.ndarray
    information: np.ndarray
    sought: int   # numbers of the covariance beside the coefficients

    @property
    def ln_l(self) -> float:
        return self.final.ln_l

    @property
    def bic(self) -> float:
        """Return ln L less Schwarz' penalty, half ln n for each number (larger is better)."""
        return penalised(self.ln_l, self.model, self.final)

    def std(self, name: str) -> float:
        """Return the standard deviation of a free number: of its logarithm, of the delay in s."""
        k = len(self.model.coefficients) + self.model.free.index(name)
        return math.sqrt(max(self.covariance[k, k], 0.0))


def penalised(ln_l: float, model: Model, done: Pass) -> float:
    """Return ln_l less Schwarz' half ln n for each number of the model, n the innovations counted in `done`."""
    n = int(np.count_nonzero(done.counted))
    return ln_l - 0.5 * math.log(max(n, 2)) * (len(model.linear) + len(model.free))


def moved(model: Model, step: np.ndarray) -> Model:
    """Return the model after a step (p,) in (linear, offsets, free), within bounds: coefficients and delay by sums, the
    others by factors exp(step)."""
    q = len(model.coefficients)
    numbers = dict(model.numbers)
    for name, change in zip(model.free, step[q:].tolist(), strict=True):
        if name == "delay":
            low, high = model.bounds.get(name, (-BEYOND_ANY, BEYOND_ANY))
            numbers[name] = min(max(numbers[name] + change, low), high)
        else:
            low, high = model.bounds.get(name, (TINY, BEYOND_ANY))
            numbers[name] = min(max(numbers[name] * math.exp(change), low), high)
    return replace(model.with_coefficients(model.coefficients + step[:q]), numbers=numbers)


def scores(model: Model, c: Channels, base: Pass) -> tuple[np.ndarray, np.ndarray]:
    """Return each innovation's score (n, p) and the information (p, p) about (linear, offsets, free), from the
    pass `base`."""
    q, free = len(model.coefficients), model.free
    used = base.counted
    e, s = base.e[used], base.variance[used]
    de, ds = np.zeros((len(e), q + len(free))), np.zeros((len(e), q + len(free)))
    de[:, :q] = slopes(model, c, base)[used]
    known = de.copy(), ds.copy()   # of the information
    for k, name in enumerate(free, start=q):
        step = np.zeros(q + len(free))
        step[k] = DELAY_SHARE * c.period if name == "delay" else LOG_DIFFERENCE
        e1, s1, same = aligned(run(moved(model, step), c), base)
        if np.mean(same) < 0.5:   # a step back passes no other event
            step[k] = -step[k]
            e1, s1, same = aligned(run(moved(model, step), c), base)
        de[:, k], ds[:, k] = (e1[used] - e) / step[k], (s1[used] - s) / step[k]
        kept = same[used] / math.sqrt(max(float(np.mean(same[used])), 0.1))
        known[0][:, k], known[1][:, k] = de[:, k] * kept, ds[:, k] * kept
    known[0][:, :q] = de[:, :q]
    root = np.sqrt(s)[:, None]
    return score(e / root[:, 0], de / root, ds / s[:, None]), \
        fisher_information(known[0] / root, known[1] / s[:, None])


def aligned(other: Pass, base: Pass) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return e and variance of another pass in the order of `base`, and whether each stood in the same place: where two
    events changed places only the sum of their scores is a derivative."""
    if np.array_equal(other.row, base.row) and np.array_equal(other.channel, base.channel):
        return other.e, other.variance, np.ones(len(base.e), bool)
    place = np.empty(len(base.e), np.int64)
    place[np.lexsort((base.channel, base.row))] = np.lexsort((other.channel, other.row))
    return other.e[place], other.variance[place], place == np.arange(len(place))


def solved(information: np.ndarray, gradient: np.ndarray, damping: float) -> np.ndarray:
    """Return the step (p,) of (information + damping times its diagonal) step = gradient; 0 where nothing is known."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    m = information / np.outer(scale, scale) + damping * np.eye(len(scale))
    return np.linalg.lstsq(m, gradient / scale, rcond=1e-12)[0] / scale


def fit(model: Model, c: Channels, free: tuple[str, ...] | None = None) -> Fitted:
    """Fit the model to its maximum of the likelihood, starting from its numbers.

    free   the numbers to fit beside the coefficients; None: the model's.  The result has the model's own `free` again.
    """
    names, q = model.free, len(model.coefficients)
    if free is not None:
        model = replace(model, free=free)
    held = slice(len(model.node_a), len(model.node_a) + len(model.node_k)) if model.no_input else slice(0, 0)
    limit = np.array([DELAY_MOST * c.period if name == "delay" else LOG_STEP for name in model.free])
    base, damping = run(model, c), 1e-8
    row_scores, information = scores(model, c, base)
    for _ in range(MOST_STEPS):
        gradient = row_scores.sum(axis=0)
        gradient[held] = 0.0
        step = solved(information, gradient, damping)
        if 0.5 * float(gradient @ step) < DONE:
            break
        for _ in range(TRIALS):
            step[held] = 0.0
            step[q:] = np.clip(step[q:], -limit, limit)
            trial = moved(model, step)
            done = run(trial, c)
            if done.ln_l > base.ln_l:
                break
            damping = max(10.0 * damping, 1e-4)
            step = solved(information, gradient, damping)
        else:
            break
        model, base = trial, done
        damping = max(0.1 * damping, 1e-8)
        row_scores, information = scores(model, c, base)
    covariance = sandwich(row_scores, information, base, c)
    return Fitted(replace(model, free=names), base, covariance, information, len(model.free))


def sandwich(each: np.ndarray, information: np.ndarray, done: Pass, c: Channels) -> np.ndarray:
    """Return the covariance (p, p) of the numbers: I^-1 J I^-1, J of the sums of the scores `each` over blocks (Newey &
    West 1987), in no direction below I^-1."""
    diagonal = np.diag(information)
    scale = np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))   # a number held where it is has none
    inverse = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-12)
    block = (c.t[done.row[done.counted]] / SCORE_BLOCK).astype(int)
    count = int(block.max()) + 1 if len(block) else 1
    sums = np.stack([np.bincount(block, each[:, k] / scale[k], count) for k in range(each.shape[1])], axis=1)
    sums -= sums.mean(axis=0)
    lags = max(1, round(count ** (1.0 / 3.0)))
    j = products(sums, sums)
    for lag in range(1, min(lags, count - 1) + 1):
        cross = products(sums[lag:], sums[:-lag])
        j += (1.0 - lag / (lags + 1)) * (cross + cross.T)
    robust = inverse @ j @ inverse
    ratio = np.sqrt(np.maximum(np.diag(robust) / np.maximum(np.diag(inverse), 1e-300), 1.0))
    return inverse * np.outer(ratio, ratio) / np.outer(scale, scale)
