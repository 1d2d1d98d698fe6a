"""exp, log, erfc, sin and cos of the core: close to the true value, exact at the edges, the same jitted or not."""

import math
from decimal import Decimal, getcontext

import numpy as np
import pytest
from every import every
from hypothesis import given
from hypothesis import strategies as hs
from unjitted import unjitted

from launchid_core.algebra.elementary import (
    LARGEST_ARGUMENT,
    LOG_LARGEST,
    LOG_SMALLEST,
    TURN,
    cos_of,
    erfc_of,
    exp_of,
    log_of,
    sin_of,
)

getcontext().prec = 50
ULP_ERFC = 8  # of the value, against libm's, which is within 1


def ulps(own: float, true: Decimal) -> float:
    return float(abs(Decimal(own) - true) / Decimal(math.ulp(float(true))))


@given(hs.floats(-700.0, 700.0) | hs.floats(-1.0, 1.0))
def test_exp_is_within_one_ulp(x):
    assert ulps(exp_of(x), Decimal(x).exp()) < 1.0


@given(hs.floats(1e-300, 1e300) | hs.floats(0.5, 2.0))
def test_log_is_within_one_ulp(x):
    assert ulps(log_of(x), Decimal(x).ln()) < 1.0 or x == 1.0 == 1.0 + log_of(x)


@given(hs.floats(-6.0, 26.0))
def test_erfc_is_within_eight_ulp(x):
    assert abs(erfc_of(x) - math.erfc(x)) <= ULP_ERFC * math.ulp(math.erfc(x))


def libm_is_within_one_ulp(own, of_libm) -> bool:
    """libm's is within 1 ulp too."""
    return abs(own - of_libm) <= 2.0 * math.ulp(of_libm)


def sine(x: Decimal) -> Decimal:
    """sin(x) for |x| up to 4 by its series, to 45 digits."""
    term, total, k = x, x, 1
    while abs(term) > Decimal(10)**-48 * abs(total):
        term *= -x * x / ((2 * k) * (2 * k + 1))
        total, k = total + term, k + 1
    return total


HALF_TURN = Decimal("3.14159265358979323846264338327950288419716939937510582097494459230781640628620899")


@given(hs.floats(-LARGEST_ARGUMENT, LARGEST_ARGUMENT, exclude_max=True, exclude_min=True) | hs.floats(-4.0, 4.0)
       | hs.integers(1, 600_000).map(lambda n: n * math.pi / 2.0))
def test_sin_and_cos_are_within_one_ulp(x):
    turns = (Decimal(x) / (2 * HALF_TURN)).to_integral_value()
    left = Decimal(x) - turns * 2 * HALF_TURN
    assert ulps(sin_of(x), sine(left)) < 1.0 or x == 0.0
    assert ulps(cos_of(x), sine(left + HALF_TURN / 2)) < 1.0


@given(hs.floats(LARGEST_ARGUMENT, 1e308))
def test_from_far_on_they_are_those_of_a_number_half_an_ulp_away(x):
    """`fmod` takes off whole TURNs, which is wrong by half of its last place: that much of x."""
    assert libm_is_within_one_ulp(sin_of(x), math.sin(math.fmod(x, TURN)))
    assert libm_is_within_one_ulp(cos_of(-x), math.cos(math.fmod(x, TURN)))


@every(("function", "x", "value"), [
    (sin_of, 0.0, 0.0), (cos_of, 0.0, 1.0), (cos_of, -0.0, 1.0), (sin_of, 5e-324, 5e-324), (sin_of, -1e-20, -1e-20),
    (sin_of, math.inf, math.nan), (cos_of, -math.inf, math.nan), (sin_of, math.nan, math.nan),
    (exp_of, 0.0, 1.0), (exp_of, -math.inf, 0.0), (exp_of, math.inf, math.inf), (exp_of, LOG_SMALLEST - 1.0, 0.0),
    (exp_of, LOG_LARGEST + 1.0, math.inf), (exp_of, -744.4400719213812, 5e-324), (log_of, 1.0, 0.0),
    (log_of, 0.0, -math.inf), (log_of, math.inf, math.inf), (log_of, -1.0, math.nan), (log_of, -math.inf, math.nan),
    (log_of, 5e-324, -744.4400719213812), (erfc_of, 30.0, 0.0), (erfc_of, -30.0, 2.0), (erfc_of, math.inf, 0.0),
    (exp_of, math.nan, math.nan), (log_of, math.nan, math.nan), (erfc_of, math.nan, math.nan)])
def test_at_the_edges(function, x, value):
    assert function(x) == value or (math.isnan(value) and math.isnan(function(x)))


@pytest.mark.parametrize("function", [exp_of, log_of, erfc_of, sin_of, cos_of])
def test_compiled_and_not_they_are_the_same_bits(function):
    rng, made = np.random.default_rng(1), unjitted(function)
    for x in [*rng.uniform(-5.0, 25.0, 300), *rng.uniform(0.0, 2.0, 300), *10.0**rng.uniform(-300, 300, 300),
              *rng.uniform(-LARGEST_ARGUMENT, LARGEST_ARGUMENT, 300)]:
        assert repr(float(function(float(x)))) == repr(float(made(float(x)))), x
