"""exp, log and erfc of the core: close to the true value everywhere, exact at the edges, the same jitted or not."""

import math
from decimal import Decimal, getcontext

import numpy as np
import pytest
from compiled import compiled
from hypothesis import given
from hypothesis import strategies as hs

from launchid_core.elementary import LARGEST, SMALLEST, erfc_of, exp_of, log_of

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


@pytest.mark.parametrize(("function", "x", "value"), [
    (exp_of, 0.0, 1.0), (exp_of, -math.inf, 0.0), (exp_of, math.inf, math.inf), (exp_of, SMALLEST - 1.0, 0.0),
    (exp_of, LARGEST + 1.0, math.inf), (exp_of, -744.4400719213812, 5e-324), (log_of, 1.0, 0.0),
    (log_of, 0.0, -math.inf), (log_of, math.inf, math.inf), (log_of, -1.0, math.nan), (log_of, -math.inf, math.nan),
    (log_of, 5e-324, -744.4400719213812), (erfc_of, 30.0, 0.0), (erfc_of, -30.0, 2.0), (erfc_of, math.inf, 0.0),
    (exp_of, math.nan, math.nan), (log_of, math.nan, math.nan), (erfc_of, math.nan, math.nan)])
def test_at_the_edges(function, x, value):
    assert function(x) == value or (math.isnan(value) and math.isnan(function(x)))


@pytest.mark.parametrize("function", [exp_of, log_of, erfc_of])
def test_compiled_and_not_they_are_the_same_bits(function):
    rng, made = np.random.default_rng(1), compiled(function)
    for x in [*rng.uniform(-5.0, 25.0, 300), *rng.uniform(0.0, 2.0, 300), *10.0**rng.uniform(-300, 300, 300)]:
        assert repr(float(function(float(x)))) == repr(float(made(float(x)))), x
