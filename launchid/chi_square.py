"""The chi-square law: its tail, for p-values, and its quantiles, for limits and intervals.

References
----------
NIST Digital Library of Mathematical Functions, 8.4.10, 8.4.15 (the tail of whole degrees of freedom) and 8.11.4 (the
series of the distribution).
"""

import math

HALVINGS = 200  # of the interval that holds a quantile: to the last digit


def tail(x: float, degrees: int) -> float:
    """Return P(chi square > x), `degrees` of freedom.

    Examples
    --------
    >>> round(tail(5.991, 2), 4), round(tail(3.841, 1), 4)
    (0.05, 0.05)
    """
    if x <= 0.0:
        return 1.0
    half, odd = 0.5 * x, 0.5 * (degrees % 2)
    return (math.erfc(math.sqrt(half)) if odd else 0.0) + sum(
        math.exp((k + odd) * math.log(half) - half - math.lgamma(k + odd + 1.0)) for k in range(degrees // 2))


def quantile(probability: float, degrees: float) -> float:
    """Return x with P(chi square <= x) = probability; `degrees` of freedom, which need not be whole.

    Examples
    --------
    >>> round(quantile(0.95, 2), 3)
    5.991
    """
    a = 0.5 * degrees

    def cumulative(x: float) -> float:
        term = total = 1.0
        k = 0
        while term > 1e-17 * total:
            k += 1
            term *= x / (a + k)
            total += term
        return total * math.exp(a * math.log(x) - x - math.lgamma(a + 1.0))

    low, high = -700.0, math.log(a + 20.0 * math.sqrt(a) + 40.0)  # of log x, x = chi2/2
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if cumulative(math.exp(middle)) < probability else (low, middle)
    return 2.0 * math.exp(0.5 * (low + high))
