"""Sums of products along the rows of a log, added in one order on every machine.

The linear algebra behind numpy (`@`, `np.linalg`) splits long sums among its threads, so that their last digits depend
on how many it has; what is chosen by comparing them then differs too.  `np.einsum` runs in this thread alone.  What is
left for `np.linalg` has as many rows as columns.
"""

import numpy as np

PROJECTIONS = 2      # projections: after the second nothing is left that rounding did not make (Giraud et al. 2005)
DEPENDENT = 1e-13    # of a column's length: what is left of it beside the others is rounding


def square(x: np.ndarray) -> float:
    """Return x' x, the squared length of a vector (n,)."""
    return inner(x, x)


def inner(x: np.ndarray, y: np.ndarray) -> float:
    """Return x' y of two vectors (n,)."""
    return float(np.einsum("n,n->", x, y))


def products(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the product a' b (k, l) of matrices (n, k) and (n, l)."""
    return np.asarray(np.einsum("nk,nl->kl", a, b))


def along(a: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the product a' x (k,) of a matrix (n, k) and a vector (n,)."""
    return np.asarray(np.einsum("nk,n->k", a, x))


def combined(a: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the product a x (n,) of a matrix (n, k) and a vector (k,)."""
    return np.asarray(np.einsum("nk,k->n", a, x))


def orthonormal(a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return q (n, k), r (k, k) of a = q r: columns of q are orthonormal, or 0 if a's depends on those before it.

    Gram and Schmidt, twice.
    """
    k = a.shape[1]
    q, r = np.zeros((k, a.shape[0])), np.zeros((k, k))
    for j in range(k):
        column = np.array(a[:, j])
        length = np.sqrt(square(column))
        for _ in range(PROJECTIONS):
            share = np.einsum("kn,n->k", q[:j], column)
            column -= np.einsum("kn,k->n", q[:j], share)
            r[:j, j] += share
        rest = np.sqrt(square(column))
        if not rest <= DEPENDENT * length:  # nor is what is no number
            r[j, j], q[j] = rest, column / rest
    return np.ascontiguousarray(q.T), r


def least_squares(a: np.ndarray, y: np.ndarray, rcond: float | None = None) -> np.ndarray:
    """Return x (k,) that minimises |y - a x|, the shortest if several do, as `np.linalg.lstsq`; a (n, k), y (n,)."""
    q, r = orthonormal(a)
    least = float(np.finfo(np.float64).eps) * max(a.shape) if rcond is None else rcond
    return np.asarray(np.linalg.lstsq(r, along(q, y), rcond=least)[0])
