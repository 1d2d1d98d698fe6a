"""exp, log, erfc, sin and cos of their own: sums, products and powers of two alone, so the same bits on every machine.

A platform's libm rounds the last digit as it likes (within glibc even by the processor, with and without fused
multiply-add); these round as IEEE 754 says.  Within 1 ulp of the true value (exp, log, sin, cos), 8 ulp (erfc).

The other functions of the kernels are exact, or rounded once, by definition: sqrt, fabs, floor, fmod, copysign, frexp,
ldexp.
"""

import math

import numpy as np

from ..kernels import kernel

LN2_HIGH = 0.6931471803691238        # ln 2 to 32 bits: a whole number below 2^20 times it is exact
LN2_LOW = 1.9082149292705877e-10     # the rest
INVERSE_LN2 = 1.4426950408889634
LOG_LARGEST = 709.782712893384       # log of the largest double
LOG_SMALLEST = -745.1332191019412    # log of the smallest
ROOT_HALF = math.sqrt(0.5)
SPLIT = 134217729.0                  # 2^27 + 1 splits a double into two of 26 bits (Dekker 1971)
ERFC_END = 27.3                      # erfc is 0 beyond
TWO_OVER_PI = 2.0 / math.pi
TURN = 2.0 * math.pi                 # to half a unit in its last place
LARGEST_ARGUMENT = 1.0e6             # rad; below it there are fewer than 2^20 quarters of a turn
QUARTER = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487111665e-21, 8.4784276603689e-32)
# pi/2 in three parts of 33 bits, of which a whole number below 2^20 times each is exact, and the rest
ERFC_CENTRE = 3.75                   # of erfc's variable (x - ERFC_CENTRE)/(x + ERFC_CENTRE)
EXP = np.array([1.0 / math.factorial(k) for k in range(15)])   # |r| <= ln2/2: the next is below 2^-60 of the sum
ATANH = np.array([2.0 / (2 * k + 1) for k in range(13)])       # |s| <= 0.1716: the next is below 2^-66
# |r| <= pi/4: the next is below 2^-63
SINE_SERIES = np.array([(-1.0)**k / math.factorial(2 * k + 1) for k in range(9)])
COSINE = np.array([(-1.0)**k / math.factorial(2 * k) for k in range(10)])      # and 2^-68
# Chebyshev coefficients of (1 + 2x) exp(x^2) erfc(x) (Shepherd and Laframboise, Math. Comp. 36, 1981), computed to 50
# digits from the function; the next is below 2^-58
ERFC = np.array([
    1.1775789345674017, -0.004590054580646478, -0.08424913336651792, 0.05920993999819189, -0.026658668435305753,
    0.009074997670705265, -0.002413163540417608, 0.0004907758365258086, -6.916973302501207e-05, 4.13902798607301e-06,
    7.74038306619849e-07, -2.1886401049234397e-07, 1.076499946567091e-08, 4.521959811218287e-09,
    -7.754400208831351e-10, -6.318088340886684e-11, 2.86879501093067e-11, 1.9455868545777347e-13,
    -9.65469674843344e-13, 3.25254814814874e-14, 3.3478119482868056e-14, -1.864562880419313e-15,
    -1.2507950530688648e-15, 7.418235256624044e-17, 5.068148904796111e-17])


@kernel
def fraction_of(x):
    """The fraction x / 2^exponent_of(x), of magnitude 0.5 to 1; the C port has a function of its own for it."""
    return math.frexp(x)[0]


@kernel
def exponent_of(x):
    """The exponent of two of x, x = m 2^e with 0.5 <= |m| < 1; the C port has a function of its own for it."""
    return math.frexp(x)[1]


@kernel
def scaled(x, n):
    """The product x 2^n, rounded once; the C port has a function of its own for it."""
    return math.ldexp(x, n)


@kernel
def exp_of(x):
    """exp(x) = 2^n exp(r), x = n ln 2 + r; inf above LOG_LARGEST, 0 below LOG_SMALLEST, NaN of NaN."""
    if not (LOG_SMALLEST <= x <= LOG_LARGEST):
        if np.isnan(x):
            return x
        return math.inf if x > 0.0 else 0.0
    n = math.floor(x * INVERSE_LN2 + 0.5)
    high, low = x - n * LN2_HIGH, n * LN2_LOW
    r = high - low
    z = r * r
    even, odd = EXP[14] * z + EXP[12], EXP[13]  # two sums, side by side
    for back in range(5):
        even = even * z + EXP[10 - 2 * back]
        odd = odd * z + EXP[11 - 2 * back]
    return scaled(1.0 + (high - (low - z * (even + r * odd))), int(n))  # what is rounded is small beside 1


@kernel
def log_of(x):
    """log(x) = n ln 2 + 2 artanh(f/(2 + f)), x = 2^n (1 + f); -inf of 0, NaN of negative numbers and NaN."""
    if not (0.0 < x < math.inf):
        if x == 0.0:
            return -math.inf
        return x if x > 0.0 else math.nan
    n, fraction = exponent_of(x), fraction_of(x)
    if fraction < ROOT_HALF:
        n -= 1
        fraction *= 2.0
    f = fraction - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    odd, even = ATANH[11], ATANH[12]
    for back in range(5):
        odd = odd * w + ATANH[9 - 2 * back]
        even = even * w + ATANH[10 - 2 * back]
    total = z * (odd + z * even)
    half = 0.5 * f * f  # log(1 + f) = f - (half - s (half + total)): what is rounded is small beside f
    return n * LN2_HIGH - ((half - (s * (half + total) + n * LN2_LOW)) - f)


@kernel
def erfc_of(x):
    """erfc(x) = exp(-x^2) P(t) / (1 + 2x) for x >= 0, 2 - erfc(-x) below."""
    if np.isnan(x):
        return x
    a = abs(x)
    if a > ERFC_END:
        return 0.0 if x > 0.0 else 2.0
    t = (a - ERFC_CENTRE) / (a + ERFC_CENTRE)
    before, now = 0.0, 0.0
    for back in range(24):  # Clenshaw
        before, now = now, 2.0 * t * now - before + ERFC[24 - back]
    value = t * now - before + ERFC[0]
    wide = SPLIT * a
    high = wide - (wide - a)
    low = a - high
    value *= exp_of(-high * high) * exp_of(-low * (a + high)) / (1.0 + 2.0 * a)
    return value if x >= 0.0 else 2.0 - value


@kernel
def difference(a, b):
    """The difference a - b as the rounded one and what rounding took from it, exactly (Knuth 1969)."""
    rounded = a - b
    back = rounded - a
    return rounded, (a - (rounded - back)) - (b + back)


@kernel
def wave(a, ahead):
    """sin(a + ahead pi/2), a >= 0 and finite: sin or cos of what is left of the nearest quarter of a turn.

    From LARGEST_ARGUMENT on that of a number within half a unit in the last place of a: whole turns are taken off by
    fmod, exactly.
    """
    x = a if a < LARGEST_ARGUMENT else np.fmod(a, TURN)
    n = math.floor(x * TWO_OVER_PI + 0.5)
    first, lost = difference(x - n * QUARTER[0], n * QUARTER[1])
    second, more = difference(first, n * QUARTER[2])
    rest = (lost + more) - n * QUARTER[3]
    r = second + rest
    rest += second - r
    z = r * r
    quarter = (int(n) + ahead) % 4
    if quarter % 2 == 0:
        total = SINE_SERIES[8]
        for back in range(6):
            total = total * z + SINE_SERIES[7 - back]
        value = r + (rest + z * (r * (total * z + SINE_SERIES[1]) - 0.5 * rest))  # sin(r + rest)
    else:
        total = COSINE[9]
        for back in range(7):
            total = total * z + COSINE[8 - back]
        half = 0.5 * z
        near = 1.0 - half
        value = near + (((1.0 - near) - half) + (z * z * total - r * rest))
    return value if quarter < 2 else -value


@kernel
def sin_of(x):
    """sin(x); NaN of what is not finite."""
    return math.copysign(1.0, x) * wave(abs(x), 0) if np.isfinite(x) else math.nan


@kernel
def cos_of(x):
    """cos(x); NaN of what is not finite."""
    return wave(abs(x), 1) if np.isfinite(x) else math.nan
