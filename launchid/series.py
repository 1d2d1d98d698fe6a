"""One column of a log by itself: lines over what was not measured, and the white noise that it shows."""

import math

import numpy as np

MEDIAN_OF_NORMAL = 0.6745   # median of |x| of a normal x of deviation 1
THIRD = 3                   # order of the differences that tell white noise from motion
LEAST = 5                   # values of which differences tell a noise


def filled(x: np.ndarray, t: np.ndarray | None = None, known: np.ndarray | None = None,
           at: np.ndarray | None = None) -> np.ndarray:
    """Return a column with straight lines over what is not known, and its first and last known value beyond.

    Parameters
    ----------
    x : (n,) array
        The column.
    t : (n,) array, optional
        Stamps [s], ascending; default: row numbers.
    known : (n,) array of bool, optional
        Values to take; default: those that are finite.  Of none known the result is 0.
    at : (m,) array, optional
        Where the result is wanted; default: t.
    """
    t = np.arange(len(x)) if t is None else t
    known = np.isfinite(x) if known is None else known
    at = t if at is None else at
    return np.interp(at, t[known], x[known]) if known.any() else np.zeros(len(at))


def white_variance(x: np.ndarray, *, typical: bool = False) -> float:
    """Return the variance of the white noise on a column of smooth motion, by its third differences.

    Parameters
    ----------
    x : (n,) array
        Rows at even steps; values that are NaN are left out.  Fewer than LEAST give 0.
    typical : bool
        By the median of the differences, which a few large ones (steps, spikes) do not move; else by their variance.
    """
    x = x[np.isfinite(x)]
    return of_differences(np.diff(x, THIRD), THIRD, typical=typical) if len(x) >= LEAST else 0.0


def of_differences(differences: np.ndarray, order: int, *, typical: bool = False) -> float:
    """Return the variance of white noise whose differences of `order` are given (n,); typical: as `white_variance`.

    Differences of order k of white noise have (2k)!/(k!)^2 of its variance; motion has less of them the higher k is.
    """
    square = (float(np.median(np.abs(differences))) / MEDIAN_OF_NORMAL)**2 if typical else float(np.var(differences))
    return square / math.comb(2 * order, order)


def white_squares(x: np.ndarray) -> np.ndarray:
    """Return values (n,) whose mean over any rows is the variance of the white noise in those rows of x (n,)."""
    return np.diff(x, THIRD, prepend=np.full(THIRD, x[0]))**2 / math.comb(2 * THIRD, THIRD)
