"""Weak-form rows of a log, and one score: the squared error of rows that were left out of a fit.

A weak-form row is the mean of a column over a time window with a smooth weight that is 0 at both ends.  The mean of a
derivative is then, by parts, a mean of the column itself with the weight's derivative, so no noisy column is
differenced.  Rows of two window lengths are used: the short one sees what is fast, the long one what is small and slow.
"""

from dataclasses import dataclass, replace

import numpy as np

from launchid.sums import inner, products, square

FOLDS = 6        # each is predicted by the others
PASSES = 3       # so often the folds go round the log: 18 stretches of it
BLOCKS = 24      # stretches whose gains give a gain's standard error
LONG = 4.0       # so many times longer is the second window
LONGEST = 1.0 / 12.0  # of the log, of a window
OVERLAP = 4      # windows begin so often within the length of one
FEWEST = 6       # steps in a window
NOISY = 0.03     # of a column's variance in the shortest window that is sensor noise, at most
GROWS = 1.25     # from one window length tried to the next
MEAN = {1: 1.0 / 6.0, 2: 1.0 / 12.0}  # of either neighbour, beside a first and a second derivative
RIDGE = 1.0e-9   # of the columns' squares: columns that are alike get no large coefficients of either sign


def weights_of(order: int, steps: int, period: float, beside: int = 1) -> np.ndarray:
    """(steps + 1,) The weights on samples a period [s] apart that make the mean of a column's derivative of an order.

    The weight is (1 - x^2)^3, which is smooth at both ends.  Derivatives are central differences of it; the mean of an
    undifferenced column beside a derivative of the order `beside` has the weights under which both are of fourth
    order: Simpson's for the first, Numerov's for the second.
    """
    x = np.linspace(-1.0, 1.0, steps + 1)
    p = (1.0 - x * x) ** 3
    p = np.concatenate([[0.0], p / p.sum(), [0.0]])
    if order == 1:
        return (p[:-2] - p[2:]) / (2.0 * period)
    if order == 2:
        return (p[2:] - 2.0 * p[1:-1] + p[:-2]) / period**2
    side = MEAN[beside]
    return side * p[2:] + (1.0 - 2.0 * side) * p[1:-1] + side * p[:-2]


def convolved(x: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(n - steps,) The weighted sums of x (n,) over the windows that begin at each sample."""
    size = len(x) + len(weights) - 1
    fast = 1 << (size - 1).bit_length()
    product = np.fft.rfft(x, fast) * np.fft.rfft(weights[::-1], fast)
    return np.fft.irfft(product, fast)[len(weights) - 1:len(x)]


def shortest(x: np.ndarray, order: int, noise: float, period: float) -> int:
    """Steps of the shortest window in which noise [rms] is no more than NOISY of the variance of x's derivative."""
    best, steps = (np.inf, FEWEST), FEWEST
    while steps < LONGEST * len(x):
        weights = weights_of(order, steps, period)
        share = noise**2 * square(weights) / max(float(np.var(convolved(x, weights))), 1e-300)
        best = min(best, (share, steps))
        if share < NOISY:
            break
        steps = int(GROWS * steps) + 1
    return best[1]


@dataclass(frozen=True, eq=False)
class Rows:
    """The weak-form rows of a log.

    period [s], n   of its samples
    order           of the derivative that the equation is of
    steps           of the windows, one for each length
    first           of each length: samples at which its windows begin
    weight (k,)     of each row in the score
    """

    period: float
    n: int
    order: int
    steps: tuple[int, ...]
    first: tuple[np.ndarray, ...]
    weight: np.ndarray

    @property
    def middle(self) -> np.ndarray:
        """(k,) [s] The middle of each window, from the first sample on."""
        return np.concatenate([(at + 0.5 * steps) * self.period
                               for at, steps in zip(self.first, self.steps, strict=True)])

    def stretch(self, count: int) -> np.ndarray:
        """(k,) The stretch of each row, of `count` equal ones."""
        return np.minimum(self.middle / (self.n * self.period) * count, count - 1).astype(int)

    @property
    def fold(self) -> np.ndarray:
        """(k,) The fold of each row."""
        return self.stretch(FOLDS * PASSES) % FOLDS

    def mean(self, x: np.ndarray, order: int = 0) -> np.ndarray:
        """(k,) The weighted means of the derivative of an order of x (n,)."""
        return self.weight * np.concatenate([
            convolved(x, weights_of(order, steps, self.period, self.order))[at]
            for steps, at in zip(self.steps, self.first, strict=True)])

    def weighed(self, left: np.ndarray) -> "Rows":
        """The rows with weights such that both lengths have the same mean square of `left` (k,), of unweighted rows."""
        parts, at = [], 0
        for first in self.first:
            some = left[at:at + len(first)]
            parts.append(np.full(len(first), 1.0 / np.sqrt(max(square(some), 1e-300))))
            at += len(first)
        return replace(self, weight=np.concatenate(parts))


def rows_of(n: int, period: float, order: int, short: int, missing: np.ndarray) -> Rows | None:
    """Unweighted rows of windows of `short` and LONG * short steps without a missing (n,) sample; None: too few."""
    longest = int(LONGEST * n)
    lengths = (short,) if LONG * short > longest else (short, int(LONG * short))
    gaps = np.concatenate([[0], np.cumsum(missing)])
    first = []
    for steps in lengths:
        at = np.arange(0, n - steps - 1, max(1, steps // OVERLAP))
        first.append(at[gaps[at + steps + 1] == gaps[at]])
    made = Rows(period, n, order, lengths, tuple(first), np.ones(sum(len(at) for at in first)))
    return made if len(np.unique(made.stretch(BLOCKS))) > BLOCKS // 2 and len(first[0]) > 2 * BLOCKS else None


@dataclass(frozen=True, eq=False)
class Fitted:
    """A regression, and how it predicts rows left out.

    errors (k,)  of the rows, each predicted by the folds that do not hold it;  xi (c,)  by all rows
    at           which of several designs all rows prefer; each fold's rows are predicted by what the others prefer
    """

    errors: np.ndarray
    xi: np.ndarray
    at: int


def left_out(designs: list[np.ndarray], y: np.ndarray, fold: np.ndarray) -> Fitted:
    """The regression of y (k,) on the best of several designs (k, c)."""
    cost = np.full((len(designs), FOLDS + 1), np.inf)
    every, errors = [], np.empty((len(designs), len(y)))
    total = np.array([square(y[fold == f]) for f in range(FOLDS)])
    for j, design in enumerate(designs):
        size = np.sqrt(np.mean(design**2, axis=0)) + 1e-300
        x = design / size
        gram = np.array([products(x[fold == f], x[fold == f]) for f in range(FOLDS)])
        with_y = np.array([products(x[fold == f], y[fold == f, None])[:, 0] for f in range(FOLDS)])
        ridge = RIDGE * len(y) * np.eye(x.shape[1])
        for f in range(FOLDS + 1):
            kept = [g for g in range(FOLDS) if g != f]
            right = with_y[kept].sum(axis=0)
            xi = np.linalg.solve(gram[kept].sum(axis=0) + ridge, right) if x.shape[1] else right
            cost[j, f] = total[kept].sum() - inner(right, xi)
            if f < FOLDS:
                at = fold == f
                errors[j, at] = y[at] - np.einsum("kc,c->k", x[at], xi)
            else:
                every.append(xi / size)
    chosen = np.argmin(cost, axis=0)
    best = np.empty(len(y))
    for f in range(FOLDS):
        best[fold == f] = errors[chosen[f], fold == f]
    return Fitted(best, every[chosen[-1]], int(chosen[-1]))


def gain(before: np.ndarray, after: np.ndarray, block: np.ndarray) -> tuple[float, float]:
    """(By how much squared errors (k,) are less after than before, the part of it that noise may make: one sigma).

    before'before - after'after = d'd + 2 after'd with d = before - after, of which chance is the second part: its sums
    over blocks (k,) have the variance of their sum.
    """
    difference = before - after
    chance = np.bincount(block, 2.0 * after * difference)
    return square(before) - square(after), float(np.sqrt(square(chance)))
